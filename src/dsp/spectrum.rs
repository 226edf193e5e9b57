//! Amplitude spectrum.
//!
//! For looking. The height of a bin is up to 15 % below the amplitude of a line
//! between two bins: an amplitude at a known frequency comes from [`crate::dsp::line`]. Must not know
//! which lines matter.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::Real;
use crate::dsp::split::Split;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Hann-weighted transform of n samples, mean removed, zero-padded to a longer length.
#[derive(Debug)]
pub(in crate::dsp) struct HannTransform<T: Real> {
    pub(in crate::dsp) window: Window<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
}

impl<T: Real> HannTransform<T> {
    pub(in crate::dsp) fn new(n: usize, n_padded: usize, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0 && n_padded >= n, "padding makes a record longer");
        Self {
            window: Window::new(Shape::Hann, n),
            forward: ForwardPlan::new_padded(n, n_padded, cache),
            x_hat: vec![Complex::zero(); fft::n_bins(n_padded)],
        }
    }

    pub(in crate::dsp) fn n_samples(&self) -> usize {
        self.window.weights.len()
    }

    pub(in crate::dsp) fn n_padded(&self) -> usize {
        self.forward.n_samples()
    }

    pub(in crate::dsp) fn n_bins(&self) -> usize {
        self.x_hat.len()
    }

    /// As [`Self::process`], the spectrum as it comes.
    fn process_split(&mut self, x: &[T]) -> (&Split<T>, f64) {
        self.forward.process_split(x, &self.window.weights)
    }

    /// Returns the spectrum of (x − mean)·w and the mean.
    pub(in crate::dsp) fn process(&mut self, x: &[T]) -> (&[Complex<T>], f64) {
        let mean = self.forward.process_weighted(x, &self.window.weights, &mut self.x_hat);
        (&self.x_hat, mean)
    }
}

/// Single-sided zero-to-peak Hann amplitude spectrum (D7).
#[derive(Debug)]
pub struct AmplitudePlan<T: Real> {
    transform: HannTransform<T>,
}

impl<T: Real> AmplitudePlan<T> {
    /// Plans for `n` samples; bins every fs/n.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        Self::new_padded(n, n, cache)
    }

    /// Plans for `n` samples on the finer grid fs/`n_padded` (interpolated, no more resolution).
    ///
    /// # Panics
    ///
    /// If `n` is 0 or `n_padded` < `n`.
    #[must_use]
    pub fn new_padded(n: usize, n_padded: usize, cache: &mut FftCache<T>) -> Self {
        Self { transform: HannTransform::new(n, n_padded, cache) }
    }

    /// Samples per call.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.transform.n_samples()
    }

    /// Amplitudes written per call: ⌊n_padded/2⌋ + 1.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.transform.n_bins()
    }

    /// Distance of two bins, Hz.
    #[must_use]
    pub fn bin_width_hz(&self, fs_hz: f64) -> f64 {
        fs_hz / self.transform.n_padded() as f64
    }

    /// Writes the amplitude at k·fs/n_padded into `out[k]` and returns the mean of `x`.
    ///
    /// `x`: n samples, unit u; its mean is removed first. `out`: zero-to-peak amplitudes, u. A sine
    /// of amplitude A on a bin reads A; between two bins down to 0.849 A (unpadded).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], out: &mut [T]) -> f64 {
        assert_eq!(out.len(), self.n_bins(), "bins of the plan");
        let n_padded = self.transform.n_padded();
        let line = T::rounded(2.0 / self.transform.window.sum);
        let (x_hat, mean) = self.transform.process_split(x);
        x_hat.moduli(line, out);
        let half = T::rounded(0.5);
        out[0] *= half;
        if n_padded.is_multiple_of(2) {
            out[n_padded / 2] *= half;
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::dft;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    fn amplitudes<T: Real>(x: &[f64]) -> Vec<T> {
        let mut plan = AmplitudePlan::new(x.len(), &mut FftCache::new());
        let mut out = vec![T::zero(); plan.n_bins()];
        plan.process(&narrow::<T>(x), &mut out);
        out
    }

    /// The amplitude spectrum as its definition says.
    fn slow_amplitudes(x: &[f64]) -> Vec<f64> {
        let n = x.len();
        let mean = x.iter().sum::<f64>() / n as f64;
        let w = |i: usize| 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / n as f64).cos();
        let gain: f64 = (0..n).map(w).sum();
        let weighted = |(i, v): (usize, &f64)| Complex::new((v - mean) * w(i), 0.0);
        let spectrum = dft(&x.iter().enumerate().map(weighted).collect::<Vec<_>>());
        let sides = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        (0..=n / 2).map(|k| sides(k) * spectrum[k].norm() / gain).collect()
    }

    #[test]
    fn matches_the_definition() {
        for n in [3, 64, 97, 250] {
            let x = gaussian_noise(n, 1);
            // f64: rounding of an FFT; f32: 1e-7 of the largest line, times some.
            assert!(largest_difference(&amplitudes::<f64>(&x), &slow_amplitudes(&x)) < 1e-13);
            assert!(largest_difference(&amplitudes::<f32>(&x), &slow_amplitudes(&x)) < 1e-6);
        }
    }

    #[test]
    fn a_sine_on_a_bin_reads_its_amplitude_whatever_the_offset() {
        let x: Vec<f64> = sine(1000, 1000.0, 50.0, 2.5, 1.0).iter().map(|v| v + 1e3).collect();
        let spectrum = amplitudes::<f64>(&x);
        // 1e3 of offset leaves 1e-13 of rounding per sample.
        assert!((spectrum[50] - 2.5).abs() < 1e-11);
        assert!(spectrum[0] < 1e-11 && spectrum[200] < 1e-11);
        // Half a bin off: the Hann scalloping loss 8/(3π) = 0.8488, textbook.
        let between = amplitudes::<f64>(&sine(1000, 1000.0, 50.5, 1.0, 0.0));
        assert!((between[50] - 8.0 / (3.0 * std::f64::consts::PI)).abs() < 1e-4);
    }

    #[test]
    fn constants_zeros_and_single_samples_read_zero() {
        for x in [vec![5.0], vec![5.0, 5.0], vec![3.0; 17], vec![0.0; 16]] {
            assert!(amplitudes::<f32>(&x).iter().all(|a| a.abs() <= 0.0));
        }
    }
}
