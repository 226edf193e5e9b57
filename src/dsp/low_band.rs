//! The lowest part of a spectrum as a signal of few samples.
//!
//! Shaft harmonics lie in the lowest percent of what an accelerometer is sampled for. Must not know what is looked
//! for there.

use rustfft::num_complex::Complex;

use crate::dsp::fft;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;

/// The bins 1…K − 1 of n samples, as L ≥ 2K samples over the same time (D83).
///
/// The cut is sharp and the record is treated as periodic: what the jump between its ends makes rings for some 1/f_K
/// seconds at the first and last.
#[derive(Debug)]
pub struct LowBandPlan<T: Real> {
    inverse: BandInverse<T>,
}

impl<T: Real> LowBandPlan<T> {
    /// Plans for the bins 1…`n_bins` − 1 of the spectrum of `n` samples; `None` unless there are such bins, all below
    /// Nyquist.
    #[must_use]
    pub fn new(n: usize, n_bins: usize, cache: &mut FftCache<T>) -> Option<Self> {
        let is_inside = n_bins >= 2 && n_bins <= n.div_ceil(2);
        let length = || fft::cheapest_inverse_len::<T>(2 * n_bins);
        is_inside
            .then(|| Self { inverse: BandInverse::new(n, 1..n_bins, length(), cache, |_| 1.0) })
    }

    /// Samples of the signal.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.inverse.out_len()
    }

    /// Rate of the signal for input at `fs_hz`, Hz: fs·L/n.
    #[must_use]
    pub fn out_rate_hz(&self, fs_hz: f64) -> f64 {
        fs_hz * self.out_len() as f64 / self.inverse.n_samples() as f64
    }

    /// Writes the signal into `out`, L samples of the unit of the input, without its mean.
    ///
    /// `x_hat`: the unnormalised one-sided DFT of n samples ([`fft::ForwardPlan`]).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [T]) {
        assert_eq!(out.len(), self.out_len(), "output of the plan");
        self.inverse.results(x_hat).map_to(out, |re, _| re);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::ForwardPlan;
    use std::f64::consts::TAU;

    const N: usize = 12_000;

    fn spectrum(x: &[f64]) -> Vec<Complex<f64>> {
        let mut plan = ForwardPlan::new(N, &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(x, &mut x_hat);
        x_hat
    }

    #[test]
    fn whole_periods_below_the_cut_are_the_same_signal_and_those_above_are_gone() {
        let low = |t: f64| 2.0 * (TAU * 7.0 * t + 0.4).cos() + 0.5 * (TAU * 99.0 * t).sin();
        let x: Vec<f64> = (0..N)
            .map(|i| i as f64 / N as f64)
            .map(|t| 5.0 + low(t) + 3.0 * (TAU * 2500.0 * t).sin())
            .collect();
        let mut plan = LowBandPlan::new(N, 100, &mut FftCache::new()).unwrap();
        assert!(plan.out_len() >= 200 && plan.out_len() < 400);
        assert!((plan.out_rate_hz(12_000.0) - plan.out_len() as f64).abs() < 1e-9);
        let mut out = vec![0.0; plan.out_len()];
        plan.process(&spectrum(&x), &mut out);
        for (i, value) in out.iter().enumerate() {
            let exact = low(i as f64 / plan.out_len() as f64);
            // Rounding of two f64 transforms of lines 3 high.
            assert!((value - exact).abs() < 1e-11, "{i}: {value} for {exact}");
        }
    }

    #[test]
    fn bins_that_are_not_there_are_not_planned() {
        let mut cache = FftCache::<f32>::new();
        for (n, n_bins) in [(100, 0), (100, 1), (100, 51), (3, 3)] {
            assert!(LowBandPlan::new(n, n_bins, &mut cache).is_none(), "{n}, {n_bins}");
        }
        assert!(LowBandPlan::new(100, 50, &mut cache).is_some());
    }
}
