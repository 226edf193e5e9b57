//! How much a count of successes proves: exact intervals of a binomial share (C20).

/// What an interval claims: of intervals computed so, that many hold the true share.
pub const LEVEL: f64 = 0.95;

/// Halvings of a bracket of width 1: below the spacing of numbers near 1e-9, the smallest shares of interest.
const HALVINGS: usize = 80;

/// A count among a number of cases, with what it proves of the share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Cases counted.
    pub count: usize,
    /// Of so many.
    pub of: usize,
    /// Interval of the true share, see [`interval`].
    pub interval: (f64, f64),
    /// One-sided: the true share is below this with at least 95 % probability.
    pub upper_bound: f64,
}

impl Rate {
    /// Counts `count` among `of`; more than `of` are taken as `of`.
    #[must_use]
    pub fn new(count: usize, of: usize) -> Self {
        let count = count.min(of);
        let upper_bound = if count == of { 1.0 } else { upper(count, of, 1.0 - LEVEL) };
        Self { count, of, interval: interval(count, of), upper_bound }
    }

    /// The share; `None` of nothing.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.of > 0).then(|| self.count as f64 / self.of as f64)
    }
}

/// The interval of Clopper and Pearson (C20) at 95 %: (0, 1) for no case at all.
///
/// Each end leaves 2.5 % outside; with no success or nothing but successes there is one end only, and it leaves
/// the whole 5 %, so that 0 of n proves a share below 3/n.
#[must_use]
pub fn interval(count: usize, of: usize) -> (f64, f64) {
    let outside = 1.0 - LEVEL;
    if of == 0 {
        (0.0, 1.0)
    } else if count == 0 {
        (0.0, upper(0, of, outside))
    } else if count >= of {
        (1.0 - upper(0, of, outside), 1.0)
    } else {
        // Failures are counted as successes were: the lower end is the upper one of the failures.
        (1.0 - upper(of - count, of, 0.5 * outside), upper(count, of, 0.5 * outside))
    }
}

/// The share at which `count` or fewer of `of` come with probability `tail`; `count` < `of`.
fn upper(count: usize, of: usize, tail: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if at_most(count, of, middle) > tail {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Probability of `count` or fewer successes in `of` trials of probability `share`, inside 0…1.
///
/// Terms are built one from the other in logarithms: no factorial, no overflow.
#[must_use]
pub fn at_most(count: usize, of: usize, share: f64) -> f64 {
    if share <= 0.0 || count >= of {
        return 1.0;
    } else if share >= 1.0 {
        return 0.0;
    }
    let odds = share.ln() - (-share).ln_1p();
    let mut log_term = of as f64 * (-share).ln_1p();
    let mut sum = log_term.exp();
    for i in 1..=count {
        log_term += ((of - i + 1) as f64 / i as f64).ln() + odds;
        sum += log_term.exp();
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn near(found: (f64, f64), expected: (f64, f64), tolerance: f64) {
        let off = (found.0 - expected.0).abs().max((found.1 - expected.1).abs());
        assert!(off <= tolerance, "{found:?} instead of {expected:?}");
    }

    #[test]
    fn ends_are_those_of_closed_forms() {
        // n = 2, k = 1: P(X ≤ 1) = 1 − p² = α/2, and by symmetry.
        let p = 0.975_f64.sqrt();
        near(interval(1, 2), (1.0 - p, p), 1e-12);
        // n = 1: nothing but one end, (1 − p) = α.
        near(interval(0, 1), (0.0, 0.95), 1e-12);
        near(interval(1, 1), (0.05, 1.0), 1e-12);
        near(interval(0, 0), (0.0, 1.0), 0.0);
        for n in [5_usize, 100, 3000] {
            let expected = 1.0 - 0.05_f64.powf(1.0 / n as f64);
            near(interval(0, n), (0.0, expected), 1e-12);
            assert!(expected < 3.0 / n as f64, "the rule of three");
        }
    }

    #[test]
    fn ends_are_those_of_published_tables() {
        // Two-sided 95 %, as printed to four figures in tables of exact binomial limits.
        near(interval(1, 10), (0.0025, 0.4450), 5e-5);
        near(interval(5, 10), (0.1871, 0.8129), 5e-5);
        near(interval(8, 20), (0.1912, 0.6395), 5e-5);
        near(interval(10, 100), (0.0490, 0.1762), 5e-5);
    }

    #[test]
    fn one_alarm_in_4750_records_is_still_below_one_in_a_thousand() {
        assert!(Rate::new(0, 3000).upper_bound < 1e-3);
        assert!(Rate::new(1, 4750).upper_bound < 1e-3);
        assert!(Rate::new(1, 4700).upper_bound > 1e-3);
        assert!(Rate::new(0, 2900).upper_bound > 1e-3);
    }

    #[test]
    fn of_nothing_there_is_no_share() {
        let rate = Rate::new(0, 0);
        assert_eq!((rate.share(), rate.interval), (None, (0.0, 1.0)));
        assert_eq!(Rate::new(3, 2).count, 2);
        assert_eq!(Rate::new(1, 4).share(), Some(0.25));
    }

    /// The same sum with exact binomials, as far as f64 holds them.
    fn slowly(count: u32, of: u32, share: f64) -> f64 {
        let choose = |k: u32| (0..k).fold(1.0, |c, i| c * f64::from(of - i) / f64::from(i + 1));
        let power = |base: f64, n: u32| (0..n).fold(1.0, |p, _| p * base);
        (0..=count).map(|k| choose(k) * power(share, k) * power(1.0 - share, of - k)).sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]
        #[test]
        fn tails_agree_with_a_plain_sum(of in 1_u32..60, part in 0.0..1.0_f64, share in 0.001..0.999_f64) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 60")]
            let count = (part * f64::from(of)) as u32;
            let found = at_most(count as usize, of as usize, share);
            // 60 terms, each of some rounding errors.
            prop_assert!((found - slowly(count, of, share)).abs() < 1e-12);
        }

        #[test]
        fn the_interval_covers_at_its_level(of in 1_usize..40, share in 0.01..0.99_f64) {
            let pmf = |k: usize| at_most(k, of, share) - if k > 0 { at_most(k - 1, of, share) } else { 0.0 };
            let holds = |k: &usize| { let (low, high) = interval(*k, of); low <= share && share <= high };
            let covered: f64 = (0..=of).filter(holds).map(pmf).sum();
            // Ends of one side may both leave out 5 %: no share is left out by both by more than that.
            prop_assert!(covered >= 1.0 - 2.0 * 0.05, "{covered}");
        }
    }
}
