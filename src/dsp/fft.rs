//! Transforms: one forward FFT that many kernels share, and inverses of a band of its bins.
//!
//! A spectrum `x_hat` is always the unnormalised one-sided DFT of n real samples with their mean
//! removed: X_k = Σ (x[i] − x̄) e^(−j2πki/n), k = 0…⌊n/2⌋ (D5). Must not know what a bin stands for.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use realfft::RealFftPlanner;
use realfft::RealToComplex;
use rustfft::Fft;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::real::Real;
use crate::dsp::stats;

/// Twiddle factors by length, shared by all plans made from it.
///
/// Owned by whoever builds plans; a plan keeps what it needs, so the cache may be dropped.
pub struct FftCache<T: Real> {
    real: RealFftPlanner<T>,
    complex: FftPlanner<T>,
}

impl<T: Real> FftCache<T> {
    /// Makes an empty cache.
    #[must_use]
    pub fn new() -> Self {
        Self { real: RealFftPlanner::new(), complex: FftPlanner::new() }
    }

    pub(in crate::dsp) fn real_forward(&mut self, n: usize) -> Arc<dyn RealToComplex<T>> {
        self.real.plan_fft_forward(n)
    }

    pub(in crate::dsp) fn complex_forward(&mut self, n: usize) -> Arc<dyn Fft<T>> {
        self.complex.plan_fft_forward(n)
    }

    pub(in crate::dsp) fn complex_inverse(&mut self, n: usize) -> Arc<dyn Fft<T>> {
        self.complex.plan_fft_inverse(n)
    }
}

impl<T: Real> Default for FftCache<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real> fmt::Debug for FftCache<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FftCache").finish_non_exhaustive()
    }
}

/// Number of bins of the one-sided spectrum of `n` real samples.
#[must_use]
pub fn n_bins(n: usize) -> usize {
    n / 2 + 1
}

/// Smallest length ≥ `n` (and ≥ 1) without a prime factor above 5: quick to transform.
#[must_use]
pub fn fast_len_at_least(n: usize) -> usize {
    (n.max(1)..).find(|length| is_fast(*length)).unwrap_or(n)
}

/// Largest length ≤ `n` without a prime factor above 5 (1 for `n` = 0): records are cut to it.
#[must_use]
pub fn fast_len_at_most(n: usize) -> usize {
    (1..=n).rev().find(|length| is_fast(*length)).unwrap_or(1)
}

fn is_fast(mut length: usize) -> bool {
    for factor in [2, 3, 5] {
        while length.is_multiple_of(factor) {
            length /= factor;
        }
    }
    length == 1
}

/// Forward transform of `n` real samples, mean removed in f64 (D5).
///
/// Its result feeds the envelope, whitening and Morlet plans of the same `n`.
pub struct ForwardPlan<T: Real> {
    plan: Arc<dyn RealToComplex<T>>,
    input: Vec<T>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> ForwardPlan<T> {
    /// Plans for `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        let plan = cache.real_forward(n);
        let scratch = plan.make_scratch_vec();
        Self { plan, input: vec![T::zero(); n], scratch }
    }

    /// Samples per call.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.input.len()
    }

    /// Bins written per call: ⌊n/2⌋ + 1.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        n_bins(self.input.len())
    }

    /// Writes the unnormalised spectrum of `x` minus its mean into `x_hat` and returns the mean.
    ///
    /// `x`: n samples, unit u. `x_hat`: ⌊n/2⌋ + 1 bins, u; bin k at k·fs/n.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], x_hat: &mut [Complex<T>]) -> f64 {
        assert_eq!(x.len(), self.input.len(), "samples of the plan");
        let mean = stats::mean(x).unwrap_or(0.0);
        for (input, value) in self.input.iter_mut().zip(x) {
            *input = T::rounded(value.to_f64() - mean);
        }
        self.transform(x_hat);
        mean
    }

    /// Transforms x minus its mean, weighted, padded with zeros; returns the mean.
    pub(in crate::dsp) fn process_weighted(
        &mut self,
        x: &[T],
        weights: &[T],
        x_hat: &mut [Complex<T>],
    ) -> f64 {
        assert_eq!(x.len(), weights.len(), "samples of the window");
        let mean = stats::mean(x).unwrap_or(0.0);
        let (signal, padding) = self.input.split_at_mut(x.len());
        for ((input, value), weight) in signal.iter_mut().zip(x).zip(weights) {
            *input = T::rounded(value.to_f64() - mean) * *weight;
        }
        padding.fill(T::zero());
        self.transform(x_hat);
        mean
    }

    fn transform(&mut self, x_hat: &mut [Complex<T>]) {
        assert_eq!(x_hat.len(), self.n_bins(), "bins of the plan");
        let done = self.plan.process_with_scratch(&mut self.input, x_hat, &mut self.scratch);
        debug_assert!(done.is_ok(), "lengths were checked");
    }
}

impl<T: Real> fmt::Debug for ForwardPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ForwardPlan").field("n", &self.input.len()).finish_non_exhaustive()
    }
}

/// Inverse transform of a weighted band of a one-sided spectrum at a reduced length (D6).
///
/// Bin k goes to place k mod L, so the result is the band's analytic signal itself (not shifted in
/// frequency), sampled every n/L input samples. Exact as long as the band is at most L bins wide.
pub(in crate::dsp) struct BandInverse<T: Real> {
    n: usize,
    bins: Range<usize>,
    gains: Vec<T>,
    plan: Arc<dyn Fft<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> BandInverse<T> {
    /// Plans for the bins `bins` of a spectrum of `n` samples with `gain(k)`, at `length` ≥ band.
    ///
    /// The analytic factor and 1/n are added here: 2/n, and 1/n at DC and at an even n's Nyquist.
    pub(in crate::dsp) fn new(
        n: usize,
        bins: Range<usize>,
        length: usize,
        cache: &mut FftCache<T>,
        gain: impl Fn(usize) -> f64,
    ) -> Self {
        assert!(bins.start < bins.end && bins.end <= n_bins(n), "a band inside the spectrum");
        assert!(length >= bins.len(), "an inverse no shorter than the band");
        let analytic = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let gains =
            bins.clone().map(|k| T::rounded(gain(k) * analytic(k) / n as f64)).collect::<Vec<_>>();
        let plan = cache.complex_inverse(length);
        let scratch = vec![Complex::zero(); plan.get_inplace_scratch_len()];
        Self { n, bins, gains, plan, scratch }
    }

    pub(in crate::dsp) fn out_len(&self) -> usize {
        self.plan.len()
    }

    pub(in crate::dsp) fn n_samples(&self) -> usize {
        self.n
    }

    pub(in crate::dsp) fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
        assert_eq!(x_hat.len(), n_bins(self.n), "bins of the plan");
        assert_eq!(out.len(), self.out_len(), "output of the plan");
        out.fill(Complex::zero());
        let mut place = self.bins.start % out.len();
        for (value, gain) in x_hat[self.bins.clone()].iter().zip(&self.gains) {
            out[place] = value.scale(*gain);
            place = if place + 1 == out.len() { 0 } else { place + 1 };
        }
        self.plan.process_with_scratch(out, &mut self.scratch);
    }
}

impl<T: Real> fmt::Debug for BandInverse<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BandInverse")
            .field("n", &self.n)
            .field("bins", &self.bins)
            .field("out_len", &self.out_len())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::dft_of_real;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;

    fn error_against_dft<T: Real>(n: usize) -> f64 {
        let x: Vec<f64> = gaussian_noise(n, 11).iter().map(|v| v + 3.0).collect();
        let mut plan = ForwardPlan::<T>::new(n, &mut FftCache::new());
        let mut x_hat = vec![Complex::zero(); plan.n_bins()];
        let mean = plan.process(&narrow(&x), &mut x_hat);
        assert!((mean - x.iter().sum::<f64>() / n as f64).abs() < 1e-6);
        let exact = dft_of_real(&x);
        let difference = |(a, b): (&Complex<T>, &Complex<f64>)| {
            (Complex::new(a.re.to_f64(), a.im.to_f64()) - b).norm()
        };
        x_hat.iter().zip(&exact).map(difference).fold(0.0, f64::max) / (n as f64).sqrt()
    }

    #[test]
    fn any_length_matches_the_definition() {
        for n in [1, 2, 3, 16, 97, 100, 251, 360] {
            // Relative to √n, the size of a noise bin: some roundings of f64 and of f32.
            assert!(error_against_dft::<f64>(n) < 1e-12, "n = {n}");
            assert!(error_against_dft::<f32>(n) < 3e-6, "n = {n}");
        }
    }

    #[test]
    fn fast_lengths() {
        assert_eq!(
            (fast_len_at_least(0), fast_len_at_least(7), fast_len_at_least(97)),
            (1, 8, 100)
        );
        assert_eq!(
            (fast_len_at_most(0), fast_len_at_most(7), fast_len_at_most(121_265)),
            (1, 6, 120_000)
        );
    }

    #[test]
    fn full_band_inverse_returns_the_signal() {
        // Re of the analytic signal of the whole band is the signal: identity to rounding.
        for n in [12, 15] {
            let x = gaussian_noise(n, 5);
            let mut cache = FftCache::<f64>::new();
            let mut plan = ForwardPlan::new(n, &mut cache);
            let mut x_hat = vec![Complex::zero(); plan.n_bins()];
            let mean = plan.process(&x, &mut x_hat);
            let mut inverse = BandInverse::new(n, 0..n_bins(n), n, &mut cache, |_| 1.0);
            let mut z = vec![Complex::zero(); n];
            inverse.process(&x_hat, &mut z);
            for (value, z) in x.iter().zip(&z) {
                assert!((value - mean - z.re).abs() < 1e-13);
            }
        }
    }
}
