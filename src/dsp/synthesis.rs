//! From a one-sided spectrum back to samples.
//!
//! For what is edited in the frequency domain and wanted in time. Must not know what was edited.

use std::fmt;
use std::sync::Arc;

use realfft::ComplexToReal;
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::real::Real;

/// Inverse of [`fft::ForwardPlan`] (D31): Σ X_k·e^(j2πki/n)/n over all n bins, the upper half mirrored.
pub struct SynthesisPlan<T: Real> {
    plan: Arc<dyn ComplexToReal<T>>,
    spectrum: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> SynthesisPlan<T> {
    /// Plans for `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        let plan = RealFftPlanner::new().plan_fft_inverse(n);
        let scratch = plan.make_scratch_vec();
        Self { plan, spectrum: vec![Complex::zero(); fft::n_bins(n)], scratch }
    }

    /// Samples per call.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.plan.len()
    }

    /// Writes the samples of a spectrum.
    ///
    /// `x_hat`: ⌊n/2⌋ + 1 bins, not normalised; bins that are their own mirror (0, and Nyquist of an
    /// even n) count with their real part. `out`: n samples.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [T]) {
        assert_eq!(x_hat.len(), self.spectrum.len(), "bins of the plan");
        assert_eq!(out.len(), self.n_samples(), "samples of the plan");
        let scale = T::rounded(1.0 / out.len() as f64);
        for (to, from) in self.spectrum.iter_mut().zip(x_hat) {
            *to = from.scale(scale);
        }
        self.spectrum[0].im = T::zero();
        if out.len().is_multiple_of(2) {
            self.spectrum[out.len() / 2].im = T::zero();
        }
        let done = self.plan.process_with_scratch(&mut self.spectrum, out, &mut self.scratch);
        debug_assert!(done.is_ok(), "lengths were checked, mirrors are real");
    }
}

impl<T: Real> fmt::Debug for SynthesisPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SynthesisPlan").field("n", &self.n_samples()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;

    #[test]
    fn undoes_the_forward_transform() {
        for n in [1, 2, 3, 16, 97, 100, 1009] {
            let x = gaussian_noise(n, 7);
            let mut forward = ForwardPlan::<f64>::new(n, &mut FftCache::new());
            let mut x_hat = vec![Complex::zero(); forward.n_bins()];
            let mean = forward.process(&x, &mut x_hat);
            let mut back = vec![0.0; n];
            SynthesisPlan::new(n).process(&x_hat, &mut back);
            let mut single = vec![0.0_f32; n];
            let mut forward = ForwardPlan::<f32>::new(n, &mut FftCache::new());
            let mut x_hat = vec![Complex::zero(); forward.n_bins()];
            forward.process(&narrow(&x), &mut x_hat);
            SynthesisPlan::new(n).process(&x_hat, &mut single);
            for ((x, back), single) in x.iter().zip(&back).zip(&single) {
                // Rounding of two transforms of values up to 4.
                assert!(
                    (x - mean - back).abs() < 1e-14 && (back - f64::from(*single)).abs() < 2e-6
                );
            }
        }
    }

    #[test]
    fn imaginary_parts_of_mirrors_do_not_count() {
        let mut out = [0.0_f64; 4];
        let bins = [(0.0, 5.0), (0.0, -2.0), (4.0, 3.0)].map(|(re, im)| Complex::new(re, im));
        SynthesisPlan::new(4).process(&bins, &mut out);
        // sin(2πi/4) and cos(πi).
        for (value, exact) in out.iter().zip([1.0, 0.0, 1.0, -2.0]) {
            assert!((value - exact).abs() < 1e-15, "{out:?}");
        }
    }
}
