//! Transforms: one forward FFT that many kernels share, and inverses of a band of its bins.
//!
//! A spectrum `x_hat` is always the unnormalised one-sided DFT of n real samples with their mean
//! removed: `X_k = Σ (x[i] − x̄) e^(−j2πki/n)`, k = 0…⌊n/2⌋ (D5). Must not know what a bin stands for.

use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use realfft::RealFftPlanner;
use realfft::RealToComplex;
use rustfft::Fft;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use crate::dsp::forward::RealTransform;
use crate::dsp::grid;
use crate::dsp::grid::Grid;
use crate::dsp::grid::GridPlan;
use crate::dsp::inverse::Inverse;
use crate::dsp::inverse::Results;
use crate::dsp::inverse::Workspace;
use crate::dsp::real::Real;
use crate::dsp::split::Split;
use crate::dsp::stats;

/// Twiddle factors by length, shared by all plans made from it.
///
/// Owned by whoever builds plans; a plan keeps what it needs, so the cache may be dropped.
pub struct FftCache<T: Real> {
    real: RealFftPlanner<T>,
    complex: FftPlanner<T>,
    grids: BTreeMap<usize, Arc<GridPlan<T>>>,
    /// Lengths asked of the libraries, which keep their tables.
    others: BTreeSet<usize>,
}

impl<T: Real> FftCache<T> {
    /// Makes an empty cache.
    #[must_use]
    pub fn new() -> Self {
        Self {
            real: RealFftPlanner::new(),
            complex: FftPlanner::new(),
            grids: BTreeMap::new(),
            others: BTreeSet::new(),
        }
    }

    /// Lengths of which it holds tables.
    #[must_use]
    pub fn n_lengths(&self) -> usize {
        self.grids.len() + self.others.len()
    }

    /// Tables of the grid of `n` points, if it has one.
    pub(in crate::dsp) fn grid(&mut self, n: usize) -> Option<Arc<GridPlan<T>>> {
        if let Some(plan) = self.grids.get(&n) {
            return Some(Arc::clone(plan));
        }
        let plan = Arc::new(GridPlan::new(n)?);
        self.grids.insert(n, Arc::clone(&plan));
        Some(plan)
    }

    pub(in crate::dsp) fn real_forward(&mut self, n: usize) -> Arc<dyn RealToComplex<T>> {
        self.others.insert(n);
        self.real.plan_fft_forward(n)
    }

    pub(in crate::dsp) fn complex_forward(&mut self, n: usize) -> Arc<dyn Fft<T>> {
        self.others.insert(n);
        self.complex.plan_fft_forward(n)
    }

    pub(in crate::dsp) fn complex_inverse(&mut self, n: usize) -> Arc<dyn Fft<T>> {
        self.others.insert(n);
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

/// Cheapest length ≥ `n` of an inverse transform, the same on every processor.
pub(in crate::dsp) fn cheapest_inverse_len<T: Real>(n: usize) -> usize {
    grid::cheapest_length::<T>(n).unwrap_or_else(|| fast_len_at_least(n))
}

/// Forward transform of `n` real samples, mean removed in f64 (D5).
///
/// Its result feeds the envelope, whitening and Morlet plans of the same `n`.
#[derive(Debug)]
pub struct ForwardPlan<T: Real> {
    transform: RealTransform<T>,
    /// Samples per call; the rest is padding.
    n: usize,
}

impl<T: Real> ForwardPlan<T> {
    /// Plans for `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        Self::new_padded(n, n, cache)
    }

    /// Plans for `n` samples followed by zeros up to `n_padded`.
    ///
    /// # Panics
    ///
    /// If `n` is 0 or `n_padded` < `n`.
    #[must_use]
    pub fn new_padded(n: usize, n_padded: usize, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        assert!(n_padded >= n, "padding makes a record longer");
        Self { transform: RealTransform::new(n_padded, cache), n }
    }

    /// Samples transformed, padding included.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.transform.n_samples()
    }

    /// Bins written per call: ⌊n_padded/2⌋ + 1.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        n_bins(self.n_samples())
    }

    /// Writes the unnormalised spectrum of `x` minus its mean into `x_hat` and returns the mean.
    ///
    /// `x`: n samples, unit u. `x_hat`: ⌊n_padded/2⌋ + 1 bins, u; bin k at k·fs/n_padded.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], x_hat: &mut [Complex<T>]) -> f64 {
        assert_eq!(x.len(), self.n, "samples of the plan");
        assert_eq!(x_hat.len(), self.n_bins(), "bins of the plan");
        let mean = stats::mean(x).unwrap_or(0.0);
        self.transform.process(x, mean, None).copy_to(x_hat);
        mean
    }

    /// Transforms x minus its mean, weighted, padded with zeros; returns the mean.
    pub(in crate::dsp) fn process_weighted(
        &mut self,
        x: &[T],
        weights: &[T],
        x_hat: &mut [Complex<T>],
    ) -> f64 {
        assert_eq!(x_hat.len(), self.n_bins(), "bins of the plan");
        let (list, mean) = self.process_split(x, weights);
        list.copy_to(x_hat);
        mean
    }

    /// As [`Self::process_weighted`], the result as it comes.
    pub(in crate::dsp) fn process_split(&mut self, x: &[T], weights: &[T]) -> (&Split<T>, f64) {
        assert_eq!(x.len(), weights.len(), "samples of the window");
        let mean = stats::mean(x).unwrap_or(0.0);
        (self.transform.process(x, mean, Some(weights)), mean)
    }
}

/// Bins of a one-sided spectrum with a weight each, and where they stand in an inverse transform (D6).
#[derive(Debug)]
pub(in crate::dsp) struct Band<T> {
    bins: Range<usize>,
    gains: Vec<T>,
}

impl<T: Real> Band<T> {
    /// The bins `bins` of a spectrum of `n` samples with `gain(k)`.
    ///
    /// The analytic factor and 1/n are added here: 2/n, and 1/n at DC and at an even n's Nyquist.
    pub(in crate::dsp) fn new(n: usize, bins: Range<usize>, gain: impl Fn(usize) -> f64) -> Self {
        assert!(bins.start < bins.end && bins.end <= n_bins(n), "a band inside the spectrum");
        let analytic = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let gains =
            bins.clone().map(|k| T::rounded(gain(k) * analytic(k) / n as f64)).collect::<Vec<_>>();
        Self { bins, gains }
    }

    /// Puts weighted bins where an inverse of `length` has them, and zeros elsewhere.
    pub(in crate::dsp) fn lay_out(&self, x_hat: &[Complex<T>], length: usize, grid: &mut Grid<T>) {
        let x = &x_hat[self.bins.clone()];
        let (first, n_before) = self.places(length, grid);
        let (before, behind) = self.gains.split_at(n_before);
        let places = first..first + n_before;
        let (re, im) = (&mut grid.re[places.clone()], &mut grid.im[places]);
        let arch = Arch::new();
        arch.dispatch(Weigh { x: &x[..n_before], gains: before, re, im });
        let places = ..x.len() - n_before;
        let (re, im) = (&mut grid.re[places], &mut grid.im[places]);
        arch.dispatch(Weigh { x: &x[n_before..], gains: behind, re, im });
    }

    /// As [`Self::lay_out`], from lists of real and imaginary parts.
    pub(in crate::dsp) fn lay_out_split(&self, x: &Split<T>, length: usize, grid: &mut Grid<T>) {
        let (x_re, x_im) = (&x.re[self.bins.clone()], &x.im[self.bins.clone()]);
        let (first, n_before) = self.places(length, grid);
        let (before, behind) = self.gains.split_at(n_before);
        let places = first..first + n_before;
        let rest = ..x_re.len() - n_before;
        let arch = Arch::new();
        for (x, list) in [(x_re, &mut grid.re), (x_im, &mut grid.im)] {
            let to = &mut list[places.clone()];
            arch.dispatch(Product { a: &x[..n_before], b: before, to });
            let to = &mut list[rest];
            arch.dispatch(Product { a: &x[n_before..], b: behind, to });
        }
    }

    /// First place of the band, and how many of its bins stand from there to the end; the others
    /// stand at the beginning. Clears the places between.
    fn places(&self, length: usize, grid: &mut Grid<T>) -> (usize, usize) {
        let (first, n) = (self.bins.start % length, self.bins.len());
        let n_before = n.min(length - first);
        for list in [&mut grid.re, &mut grid.im] {
            list[first + n_before..length].fill(T::zero());
            list[n - n_before..first].fill(T::zero());
        }
        (first, n_before)
    }

    /// Σ |gain·X|² over the band: the mean of the squared modulus of its inverse.
    pub(in crate::dsp) fn power(&self, x: &Split<T>) -> f64 {
        let (re, im) = (&x.re[self.bins.clone()], &x.im[self.bins.clone()]);
        Arch::new().dispatch(Power { re, im, gains: &self.gains })
    }
}

struct Weigh<'a, T> {
    x: &'a [Complex<T>],
    gains: &'a [T],
    re: &'a mut [T],
    im: &'a mut [T],
}

impl<T: Real> WithSimd for Weigh<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.x.len();
        let (gains, re, im) = (&self.gains[..n], &mut self.re[..n], &mut self.im[..n]);
        for i in 0..n {
            (re[i], im[i]) = (self.x[i].re * gains[i], self.x[i].im * gains[i]);
        }
    }
}

struct Product<'a, T> {
    a: &'a [T],
    b: &'a [T],
    to: &'a mut [T],
}

impl<T: Real> WithSimd for Product<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.to.len();
        let (a, b) = (&self.a[..n], &self.b[..n]);
        for i in 0..n {
            self.to[i] = a[i] * b[i];
        }
    }
}

struct Power<'a, T> {
    re: &'a [T],
    im: &'a [T],
    gains: &'a [T],
}

impl<T: Real> WithSimd for Power<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        const LANES: usize = 16;
        // 32 sums side by side of as many numbers, then f64.
        const BLOCK: usize = 32 * LANES;
        let mut sum = 0.0;
        let lists = self.re.chunks(BLOCK).zip(self.im.chunks(BLOCK));
        for ((re, im), gains) in lists.zip(self.gains.chunks(BLOCK)) {
            let mut lanes = [T::zero(); LANES];
            let (re, re_rest) = re.as_chunks::<LANES>();
            let (im, im_rest) = im.as_chunks::<LANES>();
            let (gains, gains_rest) = gains.as_chunks::<LANES>();
            for ((re, im), gains) in re.iter().zip(im).zip(gains) {
                for i in 0..LANES {
                    lanes[i] += (re[i] * re[i] + im[i] * im[i]) * (gains[i] * gains[i]);
                }
            }
            for ((re, im), gain) in re_rest.iter().zip(im_rest).zip(gains_rest) {
                lanes[0] += (*re * *re + *im * *im) * (*gain * *gain);
            }
            for lane in lanes {
                sum += lane.to_f64();
            }
        }
        sum
    }
}

/// Inverse transform of a weighted band of a one-sided spectrum at a reduced length (D6).
///
/// Bin k goes to place k mod L, so the result is the band's analytic signal itself (not shifted in
/// frequency), sampled every n/L input samples. Exact as long as the band is at most L bins wide.
#[derive(Debug)]
pub(in crate::dsp) struct BandInverse<T: Real> {
    n: usize,
    band: Band<T>,
    inverse: Inverse<T>,
    workspace: Workspace<T>,
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
        assert!(length >= bins.len(), "an inverse no shorter than the band");
        let inverse = Inverse::new(length, cache);
        let workspace = Workspace::new(std::iter::once(&inverse));
        Self { n, band: Band::new(n, bins, gain), inverse, workspace }
    }

    pub(in crate::dsp) fn out_len(&self) -> usize {
        self.inverse.len()
    }

    pub(in crate::dsp) fn n_samples(&self) -> usize {
        self.n
    }

    pub(in crate::dsp) fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
        assert_eq!(out.len(), self.out_len(), "output of the plan");
        self.results(x_hat).copy_to(out);
    }

    /// The inverse, to be made something of.
    pub(in crate::dsp) fn results(&mut self, x_hat: &[Complex<T>]) -> Results<'_, T> {
        assert_eq!(x_hat.len(), n_bins(self.n), "bins of the plan");
        self.band.lay_out(x_hat, self.inverse.len(), &mut self.workspace.grid);
        self.inverse.run(&mut self.workspace)
    }
}

#[cfg(test)]
mod tests {
    use rustfft::num_traits::Zero;

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
