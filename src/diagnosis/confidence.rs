//! From readings to false-alarm probability: the null, its tail, and what searching costs.
//!
//! Null: the squared envelope of a stationary signal has an exponential power in each spectral cell,
//! independent of its neighbours, whose mean is estimated from about m cells around it. Tails below
//! 1e-4 rest on this parametric form; they are bounds by assumption, not by count.

use crate::features::bearing::BandReading;
use crate::features::bearing::Harmonic;

/// Declared probability of a false warning or damaged verdict a component and record, and the probability from
/// which a line or side band counts as there, whatever a decision is held to
/// ([`super::Context::false_alarm_probability`]).
pub const FALSE_ALARM_PROBABILITY: f64 = 1e-3;

/// No smaller probability is ever reported.
const SMALLEST: f64 = 1e-300;

/// Probability that noise exceeds `power_ratio` in one cell (C1): (1 + z/m)^−m, the F(2, 2m) tail of
/// an exponential power over a mean of m exponential powers.
#[must_use]
pub fn cell_tail(power_ratio: f64, floor_dof: f64) -> f64 {
    (-floor_dof * (power_ratio.max(0.0) / floor_dof).ln_1p()).exp()
}

/// Probability that noise exceeds a harmonic's reading anywhere in what was searched (C2).
#[must_use]
pub fn harmonic_tail(harmonic: &Harmonic) -> f64 {
    let Harmonic { power_ratio, floor_dof, .. } = *harmonic;
    (cells(harmonic, power_ratio) * cell_tail(power_ratio, floor_dof)).min(1.0)
}

/// Cells that the search for a harmonic costs at a power ratio, which a floor that is estimated too low exceeds most easily.
fn cells(harmonic: &Harmonic, power_ratio: f64) -> f64 {
    harmonic.searched.cells(power_ratio / (1.0 + power_ratio / harmonic.floor_dof))
}

/// Power ratio that noise exceeds with probability `p` in what was searched for this harmonic: C2 solved by repeated
/// insertion, for the cells change slowly with it.
#[must_use]
pub fn power_ratio_at(harmonic: &Harmonic, p: f64) -> f64 {
    let dof = harmonic.floor_dof;
    (0..8).fold(harmonic.power_ratio, |z, _| {
        let per_cell = p / cells(harmonic, z).max(f64::MIN_POSITIVE);
        (dof * (per_cell.powf(-1.0 / dof) - 1.0)).max(1.0)
    })
}

/// Probability of a band's reading under noise (C3): the fundamental *and* at least one of the
/// higher harmonics must stand out, so the larger of the two counts.
#[must_use]
pub fn band_probability(reading: &BandReading) -> f64 {
    let Some(fundamental) = reading.harmonics[0] else { return 1.0 };
    let higher: Vec<f64> = reading.harmonics[1..].iter().flatten().map(harmonic_tail).collect();
    let best = higher.iter().copied().fold(1.0, f64::min);
    let support = (best * higher.len() as f64).min(1.0);
    harmonic_tail(&fundamental).max(support)
}

/// Combines the probabilities of dependent bands (C4): n/k times the k-th smallest, k = ⌈part·n⌉.
///
/// Valid under any dependence (Rüger 1978); it asks that this part of the bands agree.
#[must_use]
pub fn combine(probabilities: &[f64], part: f64) -> f64 {
    let mut sorted = probabilities.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let k = (1..=n).find(|k| *k as f64 >= part * n as f64 - 1e-9).unwrap_or(n);
    match sorted.get(k.wrapping_sub(1)) {
        Some(p) => (p * n as f64 / k as f64).clamp(SMALLEST, 1.0),
        None => 1.0,
    }
}

/// Probability that a standard normal exceeds `z` (C7), one-sided; an upper bound by Mills' ratio above
/// z = 1, else ½ as the cautious answer.
#[must_use]
pub fn normal_tail(z: f64) -> f64 {
    if z <= 1.0 {
        return 0.5;
    }
    ((-0.5 * z * z).exp() / (z * (2.0 * std::f64::consts::PI).sqrt())).max(SMALLEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::bands::Band;
    use crate::features::bearing::Searched;
    use crate::units::Hz;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
        #[test]
        fn the_tail_is_never_lighter_than_a_known_floors(z in 0.0..200.0_f64, m in 2.0..500.0_f64) {
            prop_assert!(cell_tail(z, m) >= (-z).exp() * (1.0 - 1e-12));
        }

        #[test]
        fn combining_never_gains_on_the_best(p in proptest::collection::vec(1e-12..1.0_f64, 1..30)) {
            let best = p.iter().copied().fold(1.0, f64::min);
            prop_assert!(combine(&p, 0.5) >= best && combine(&p, 0.25) >= best);
        }
    }

    #[test]
    fn a_wider_search_makes_the_same_line_less_probable_to_be_none() {
        let reading = |bins: f64| {
            let searched = Searched::peaks(bins);
            let fundamental =
                Harmonic { power_ratio: 25.0, depth: 0.3, floor_dof: 100.0, searched };
            let second = Harmonic { searched: Searched::largest(3.0, 1.0), ..fundamental };
            let band = Band { low: Hz(0.0), high: Hz(5000.0), whitened: false };
            BandReading::of_test(band, Hz(100.0), &[fundamental, second])
        };
        // 60 bins for slip alone, 140 with 2 % of geometry: the price is the ratio of the bins.
        let (exact, wide) = (band_probability(&reading(60.0)), band_probability(&reading(140.0)));
        assert!((wide / exact - 140.0 / 60.0).abs() < 0.01, "{exact:e} {wide:e}");
    }

    #[test]
    fn the_power_ratio_of_a_probability_has_it() {
        for floor_dof in [15.0, 300.0] {
            let searched = Searched::peaks(60.0);
            let read = Harmonic { power_ratio: 3.0, depth: 0.3, floor_dof, searched };
            let power_ratio = power_ratio_at(&read, 1e-4);
            let found = harmonic_tail(&Harmonic { power_ratio, ..read });
            assert!((found / 1e-4 - 1.0).abs() < 1e-3, "{found:e} at {power_ratio}");
        }
    }

    #[test]
    fn the_part_asked_for_must_agree() {
        let mut p = vec![1e-9; 7];
        p.extend([1.0; 7]);
        assert!((combine(&p, 0.5) - 2e-9).abs() < 1e-20, "k = 7 of 14");
        p[0] = 1.0;
        assert!((combine(&p, 0.5) - 1.0).abs() < 1e-15, "six of fourteen are not most");
        assert!((combine(&p, 0.25) - 3.5e-9).abs() < 1e-20, "k = 4 of 14");
        assert!((combine(&[], 0.5) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn mills_bound_lies_above_the_true_tail() {
        // True upper tails of the standard normal: 2.275e-2 at 2, 1.350e-3 at 3.
        assert!(normal_tail(2.0) > 2.275e-2 && normal_tail(2.0) < 2.8e-2);
        assert!(normal_tail(3.0) > 1.350e-3 && normal_tail(3.0) < 1.5e-3);
    }
}
