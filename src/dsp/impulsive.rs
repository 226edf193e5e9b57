//! Part of a band's energy that comes in bursts: impulsiveness without a rate.
//!
//! A line of the squared envelope tells of blows that repeat; blows that slip, or come from nowhere in particular, make none. Noise of
//! any colour has an envelope whose median tells its mean, and what the mean has beyond that came in bursts. Unlike kurtosis this is a
//! part of the energy: one click of any height weighs no more than its energy. Must not know what strikes.

use crate::dsp::real::Real;
use crate::dsp::real::floor_index;
use crate::dsp::stats;

/// Fraction of the golden ratio: its multiples modulo 1 fill an interval evenly and keep step with no period.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Standard deviation of ln(median) of n independent exponential values, times √n: 1/ln 2.
const MEDIAN_SCATTER: f64 = std::f64::consts::LOG2_E;

/// Standard deviations taken off: one side, 5 %.
const DEVIATIONS: f64 = 1.645;

/// Part of the energy of a band that comes in bursts (D112), 0…1: 1 − median(e²)/(ln 2·mean(e²)), less what chance leaves open of it.
///
/// `e2`: squared envelope ([`super::envelope::SquaredEnvelopePlan`]), u²; `mean`: its mean. `n_independent`: values of it that are
/// independent, the bins of the band. The median is that of as many values as `scratch` holds, spread over the whole.
#[must_use]
pub fn part<T: Real>(e2: &[T], mean: f64, n_independent: usize, scratch: &mut [T]) -> f64 {
    let n = e2.len() as f64;
    for (i, slot) in scratch.iter_mut().enumerate() {
        let place = floor_index((i as f64 * GOLDEN).fract() * n);
        *slot = e2.get(place).copied().unwrap_or_else(T::zero);
    }
    let independent = n_independent.min(scratch.len()).max(1) as f64;
    let Some(median) = stats::median(scratch).filter(|_| mean > 0.0) else { return 0.0 };
    let noise = median.to_f64() / std::f64::consts::LN_2 / mean;
    // As much may be noise as the median may be too low.
    let at_most = noise * (1.0 + DEVIATIONS * MEDIAN_SCATTER / independent.sqrt());
    (1.0 - at_most).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::envelope::SquaredEnvelopePlan;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::fft::n_bins;
    use crate::dsp::reference::gaussian_noise;
    use rustfft::num_complex::Complex;

    /// Part of the energy of `x` between a fifth and four fifths of its band.
    fn of(x: &[f64]) -> f64 {
        let mut cache = FftCache::<f64>::new();
        let mut x_hat = vec![Complex::default(); n_bins(x.len())];
        ForwardPlan::new(x.len(), &mut cache).process(x, &mut x_hat);
        let bins = x.len() / 10..4 * x.len() / 10;
        let n = bins.len();
        let mut plan = SquaredEnvelopePlan::new(x.len(), bins, &mut cache);
        let mut e2 = vec![0.0; plan.out_len()];
        plan.process(&x_hat, &mut e2);
        let mean = e2.iter().sum::<f64>() / e2.len() as f64;
        part(&e2, mean, n, &mut [0.0; 4096])
    }

    /// Noise with a burst of noise in every `period` samples, `length` long, `height` times as high.
    fn bursts(period: usize, length: usize, height: f64) -> Vec<f64> {
        let gain = |i: usize| if i % period < length { height } else { 1.0 };
        gaussian_noise(40_000, 7).iter().enumerate().map(|(i, v)| v * gain(i)).collect()
    }

    #[test]
    fn noise_and_tones_have_no_bursts() {
        for seed in 0..20 {
            assert!(
                of(&gaussian_noise(40_000, seed)) < 0.03,
                "once in 20: two deviations are 0.045"
            );
        }
        let tone: Vec<f64> = (0..40_000).map(|i| (f64::from(i) * 1.3).cos()).collect();
        assert!(of(&tone) < 1e-12, "a constant envelope lies over its own median");
    }

    #[test]
    fn bursts_count_with_their_part_of_the_energy() {
        // In a twentieth of the time, 100 times the power: 5 of 5.95 parts of the energy are theirs; the median is that of noise of which
        // a twentieth is missing, 8 % high.
        let found = of(&bursts(1000, 50, 10.0));
        let energy = 5.0 / 5.95;
        assert!((found - energy).abs() < 0.05, "{found} of {energy}");
        // However often: what counts is their part.
        assert!((of(&bursts(2000, 100, 10.0)) - found).abs() < 0.03);
        // One click of the height of all others together is still one.
        let mut click = gaussian_noise(40_000, 3);
        click[20_000] += 60.0;
        assert!(of(&click) < 0.12, "3600 of 43 600");
    }

    #[test]
    fn few_values_prove_little() {
        let values: Vec<f64> = (1..=40).map(|i| -(f64::from(i) / 41.0).ln()).collect();
        let mean = 1.6 * values.iter().sum::<f64>() / 40.0;
        let many = part(&values, mean, 4096, &mut [0.0; 4096]);
        assert!(many > 0.3 && part(&values, mean, 40, &mut [0.0; 4096]) < 0.2);
        assert!(part(&values, 0.0, 40, &mut [0.0; 8]).abs() < 1e-15, "silence");
        assert!(part::<f64>(&[], 1.0, 0, &mut []).abs() < 1e-15);
    }
}
