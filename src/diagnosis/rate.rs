//! How many false alarms are allowed: a probability a record offline, a rate a year in the daemon.
//!
//! The null of each test is that of [`super::confidence`]; here is only counted how often it is asked. Must
//! not know the clock.

use super::confidence;

/// Seconds of a year.
const YEAR_S: f64 = 31_557_600.0;

/// False alarms of a component in a year that a daemon is allowed unless its configuration says otherwise.
pub const A_COMPONENT_YEAR: f64 = 0.1;

/// Below this tails rest on the form of the null alone: no data we have can count them.
pub const COUNTED_DOWN_TO: f64 = 1e-4;

/// Probability with which a component may be accused falsely in one decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FalseAlarms {
    /// A decision and component.
    pub per_decision: f64,
    /// A component and year; `None`: records are judged one by one.
    pub a_year: Option<f64>,
}

impl Default for FalseAlarms {
    /// Of a record that is judged by itself.
    fn default() -> Self {
        Self { per_decision: confidence::FALSE_ALARM_PROBABILITY, a_year: None }
    }
}

impl FalseAlarms {
    /// Of windows of `window_s` every `hop_s`, whose accusation must last for `on_delay_s` to raise an alarm:
    /// `a_year` a component and year, never more than offline.
    #[must_use]
    pub fn a_year(a_year: f64, (window_s, hop_s): (f64, f64), on_delay_s: f64) -> Self {
        let n = independent_windows(window_s, on_delay_s);
        let allowed = per_decision(a_year, YEAR_S / hop_s, (n, n));
        let per_decision = allowed.min(confidence::FALSE_ALARM_PROBABILITY);
        Self { per_decision, a_year: Some(a_year) }
    }

    /// The same rate a component and year where windows lie otherwise; of a record that is judged by itself as it is.
    #[must_use]
    pub fn in_windows(self, windows_s: (f64, f64), on_delay_s: f64) -> Self {
        self.a_year.map_or(self, |a_year| Self::a_year(a_year, windows_s, on_delay_s))
    }

    /// What the reader of a verdict should know of it; `None`: nothing beyond what is counted.
    #[must_use]
    pub fn note(&self) -> Option<String> {
        let p = self.per_decision;
        (p < COUNTED_DOWN_TO).then(|| {
            let rate = self.a_year.map_or_else(String::new, |a_year| {
                format!(" for {a_year} false alarms a component and year")
            });
            format!(
                "accusations are held to a false-alarm probability of {p:.1e} a decision{rate}: below 1e-4 tails rest \
                 on the assumed form of the noise and are not verified by counting"
            )
        })
    }
}

/// Windows without a common sample in the verdicts of an on-delay: the first, and each that begins when the one
/// before has ended.
#[must_use]
pub fn independent_windows(window_s: f64, on_delay_s: f64) -> u32 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate"
    )]
    let later = (on_delay_s / window_s + 1e-9).floor().min(100.0) as u32;
    1 + later
}

/// Alarms a year when each of `decisions` independent decisions accuses with probability `p` and an alarm needs
/// k of n successive ones (C32); an upper bound, within 10 % for p·n ≤ 0.1.
#[must_use]
pub fn alarms_a_year(p: f64, decisions: f64, (k, n): (u32, u32)) -> f64 {
    decisions * p * at_least(k.saturating_sub(1), n.saturating_sub(1), p)
}

/// The probability of a decision at which k of n give a rate of alarms a year (C32 solved), 1 at most.
#[must_use]
pub fn per_decision(a_year: f64, decisions: f64, k_of_n: (u32, u32)) -> f64 {
    // The rate rises with p: halved in the logarithm.
    let (mut low, mut high) = (-700.0_f64, 0.0_f64);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if alarms_a_year(middle.exp(), decisions, k_of_n) < a_year {
            low = middle;
        } else {
            high = middle;
        }
    }
    low.exp()
}

/// Probability of `k` or more among `n` independent events of probability `p`.
fn at_least(k: u32, n: u32, p: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 0.0;
    for i in 0..=n {
        if i >= k {
            let rest = i32::try_from(n - i).unwrap_or(i32::MAX);
            sum += term * (1.0 - p).powi(rest);
        }
        term *= p * f64::from(n - i) / f64::from(i + 1);
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;
    use std::collections::VecDeque;

    #[test]
    fn the_tail_of_the_binomial_is_the_closed_form() {
        let p: f64 = 0.3;
        assert!((at_least(0, 5, p) - 1.0).abs() < 1e-12);
        assert!((at_least(1, 3, p) - (1.0 - 0.7_f64.powi(3))).abs() < 1e-12);
        assert!((at_least(2, 3, p) - (3.0 * 0.09 * 0.7 + 0.027)).abs() < 1e-12);
        assert!((at_least(3, 3, p) - 0.027).abs() < 1e-12);
    }

    /// Alarms among `n_decisions`: raised when k of the last n accuse, over when none does.
    fn simulated(p: f64, n_decisions: u32, (k, n): (usize, usize)) -> f64 {
        let mut random = Pcg64Mcg::seed_from_u64(11);
        let (mut last, mut is_raised, mut n_alarms) = (VecDeque::new(), false, 0_u32);
        for _ in 0..n_decisions {
            last.push_back(random.random::<f64>() < p);
            if last.len() > n {
                last.pop_front();
            }
            let accusing = last.iter().filter(|accuses| **accuses).count();
            if !is_raised && accusing >= k {
                is_raised = true;
                n_alarms += 1;
            }
            is_raised &= accusing > 0;
        }
        f64::from(n_alarms)
    }

    #[test]
    fn k_of_n_independent_decisions_alarm_as_often_as_stated() {
        let n_decisions = 4_000_000;
        for (p, k, n) in [(1e-3, 1, 1), (0.02, 2, 2), (0.01, 2, 3), (0.02, 2, 5), (0.05, 3, 4)] {
            let stated = alarms_a_year(p, f64::from(n_decisions), (k, n));
            let found = simulated(p, n_decisions, (k as usize, n as usize));
            // A bound: never below what is found but for chance (4σ); short by clusters that count once.
            let chance = 4.0 * stated.sqrt();
            assert!(found < stated + chance, "{p} {k}/{n}: {found} of {stated}");
            assert!(found > 0.7 * stated - chance, "{p} {k}/{n}: {found} of {stated}");
        }
    }

    #[test]
    fn the_probability_gives_the_rate_it_was_solved_for() {
        for k_of_n in [(1, 1), (2, 2), (2, 3), (3, 5)] {
            let p = per_decision(0.1, 6.3e6, k_of_n);
            assert!((alarms_a_year(p, 6.3e6, k_of_n) / 0.1 - 1.0).abs() < 1e-9, "{k_of_n:?}");
        }
        // One of one: the rate over the number of decisions.
        assert!((per_decision(0.1, 1e6, (1, 1)) / 1e-7 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn persistence_lets_a_decision_be_less_sure_but_never_less_than_offline() {
        let of = |on_delay_s: f64| FalseAlarms::a_year(0.1, (10.0, 5.0), on_delay_s).per_decision;
        // 6.31 million verdicts a year.
        assert!((of(0.0) / 1.584e-8 - 1.0).abs() < 1e-3, "{:e}", of(0.0));
        assert!(
            (of(9.9) / of(0.0) - 1.0).abs() < 1e-12,
            "the windows of 9.9 s all overlap the first"
        );
        assert!((of(10.0) / 1.259e-4 - 1.0).abs() < 1e-3, "{:e}", of(10.0));
        assert!((of(20.0) / 1e-3 - 1.0).abs() < 1e-12, "as offline");
        assert!((FalseAlarms::default().per_decision / 1e-3 - 1.0).abs() < 1e-12, "offline");
    }

    #[test]
    fn a_tail_that_nobody_counted_is_said_to_be_one() {
        assert_eq!(FalseAlarms::default().note(), None);
        let daemon = FalseAlarms::a_year(0.1, (10.0, 5.0), 0.0).note().unwrap();
        assert!(daemon.contains("1.6e-8 a decision for 0.1 false alarms"), "{daemon}");
        assert!(daemon.contains("not verified by counting"));
    }
}
