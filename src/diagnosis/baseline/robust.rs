//! Where numbers lie and how they scatter, told so that a few wrong ones among them do not matter.

/// Makes the median absolute deviation of a normal sample its standard deviation: 1/Φ⁻¹(¾).
const NORMAL: f64 = 1.482_602_218_505_602;

/// Factors for samples of five to nine, in which the deviation is about a median of their own.
const SMALL: [f64; 5] = [1.206, 1.200, 1.140, 1.129, 1.107];

/// Fewest numbers whose scatter is told.
pub const FEWEST: usize = 5;

/// The median; `None` of nothing. NaN is not allowed.
#[must_use]
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    if sorted.len() % 2 == 1 {
        return Some(upper);
    }
    let lower = *sorted.get(sorted.len() / 2 - 1)?;
    Some(0.5 * (lower + upper))
}

/// Standard deviation by the median absolute deviation (C30): half of the numbers may be anything.
/// `None` of fewer than [`FEWEST`].
#[must_use]
pub fn scatter(values: &[f64]) -> Option<f64> {
    let n = values.len();
    if n < FEWEST {
        return None;
    }
    let middle = median(values)?;
    let deviations: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    let of_size = SMALL.get(n - FEWEST).copied().unwrap_or(n as f64 / (n as f64 - 0.8));
    Some(NORMAL * of_size * median(&deviations)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::Distribution;
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn the_median_is_the_middle_or_between_the_two() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0]), Some(3.0));
        assert_eq!(median(&[3.0, 1.0]), Some(2.0));
        assert_eq!(median(&[9.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[1.0, 1e300, 2.0, -1e300]), Some(1.5));
    }

    #[test]
    fn the_scatter_of_a_normal_sample_is_its_standard_deviation_at_every_size() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for n in [5, 6, 7, 8, 9, 10, 20, 101] {
            let n_samples = 20_000;
            let mean: f64 = (0..n_samples)
                .map(|_| {
                    let sample: Vec<f64> =
                        StandardNormal.sample_iter(&mut random).take(n).collect();
                    scatter(&sample).unwrap()
                })
                .sum::<f64>()
                / f64::from(n_samples);
            // Its own relative scatter is 0.55 at n = 5 and falls as 1.17/sqrt(2n): 20000 samples give 0.4 % at
            // worst, and the tabulated factors are right to about 1 %.
            assert!((mean - 1.0).abs() < 0.02, "{n}: {mean}");
        }
    }

    #[test]
    fn two_wrong_in_five_change_little() {
        let good = [1.0, 1.1, 0.9];
        let with = |bad: f64| [good[0], good[1], good[2], bad, 2.0 * bad];
        for bad in [50.0, 1e9] {
            assert!((median(&with(bad)).unwrap() - 1.1).abs() < 1e-12);
            // Deviations from 1.1: 0.1, 0, 0.2, huge, huge.
            let expected = 1.206 * 1.482_602_218_505_602 * 0.2;
            assert!((scatter(&with(bad)).unwrap() - expected).abs() < 1e-12);
        }
        assert_eq!(scatter(&good), None, "three tell no scatter");
    }
}
