//! Bands of halves and thirds over a shared spectrum, and the complex envelope of each.
//!
//! The tree of the fast kurtogram: 1, 2, 3, 4, 6, 8, 12, … equal bands from 0 to Nyquist. Must not
//! know what is measured in a band.

use std::f64::consts::PI;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use pulp::Arch;
use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::length::quick_len_at_least;
use crate::dsp::real::Real;
use crate::dsp::real::floor_index;

/// Bins a band must hold: with fewer any figure of its envelope is noise.
pub const MIN_BINS: usize = 16;

/// One band of the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Band {
    /// Bands of its width between 0 and Nyquist: 1, 2, 3, 4, 6, 8, 12, …
    pub n_of_width: usize,
    /// First bin.
    pub start_bin: usize,
    /// First bin behind it.
    pub end_bin: usize,
}

impl Band {
    /// Bins inside, for [`crate::dsp::envelope::SquaredEnvelopePlan`].
    #[must_use]
    pub fn bins(&self) -> Range<usize> {
        self.start_bin..self.end_bin
    }

    /// Number of bins: that of independent complex samples of its envelope.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.end_bin - self.start_bin
    }

    /// Level in the tree, log₂ of the number of bands: 0, 1, 1.585, 2, 2.585, …
    #[must_use]
    pub fn level(&self) -> f64 {
        (self.n_of_width as f64).log2()
    }

    /// Lower and upper edge, Hz: bins span half their distance to either side.
    #[must_use]
    pub fn edges_hz(&self, n: usize, fs_hz: f64) -> (f64, f64) {
        let edge = |bin: usize| (bin as f64 - 0.5) * fs_hz / n as f64;
        (edge(self.start_bin), edge(self.end_bin))
    }
}

/// Complex envelopes of all bands of a tree (D43).
///
/// The envelope is sampled 2L times, L at least the bins of the band: the even ones are the inverse
/// transform of the bins at L points, the odd ones that of the bins turned by e^(jπk/L). Two transforms
/// of L cost less than one of 2L whose input is half zeros.
pub(in crate::dsp) struct FilterBank<T: Real> {
    n: usize,
    bands: Vec<Band>,
    widths: Vec<Width<T>>,
    /// Σ|X|² of the bins before each, in f64.
    powers: Vec<f64>,
    z: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

/// What the bands of one width share.
struct Width<T: Real> {
    /// Place in the list of bands behind the last of this width.
    end: usize,
    inverse: Arc<dyn Fft<T>>,
    /// e^(jπk/L), as many as bins of the widest band.
    half_step: Vec<Complex<T>>,
}

/// Which samples of an envelope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::dsp) enum Half {
    Even,
    Odd,
}

impl<T: Real> FilterBank<T> {
    pub(in crate::dsp) fn new(
        n: usize,
        depth: u32,
        usable: Range<usize>,
        cache: &mut FftCache<T>,
    ) -> Self {
        assert!(n > 0, "a spectrum of at least one sample");
        let (mut bands, mut widths) = (Vec::new(), Vec::new());
        for n_of_width in band_counts(depth) {
            let first = bands.len();
            bands.extend((0..n_of_width).filter_map(|j| band(n, n_of_width, j, &usable)));
            let Some(widest) = bands[first..].iter().map(Band::n_bins).max() else { continue };
            let length = quick_len_at_least(widest);
            let turn = |k: usize| {
                let (sin, cos) = (PI * k as f64 / length as f64).sin_cos();
                Complex::new(T::rounded(cos), T::rounded(sin))
            };
            let half_step = (0..widest).map(turn).collect();
            let inverse = cache.complex_inverse(length);
            widths.push(Width { end: bands.len(), inverse, half_step });
        }
        let most = |size: fn(&Width<T>) -> usize| widths.iter().map(size).max().unwrap_or(0);
        let z = vec![Complex::zero(); most(|width| width.inverse.len())];
        let scratch = vec![Complex::zero(); most(|width| width.inverse.get_inplace_scratch_len())];
        Self { n, bands, widths, powers: vec![0.0; fft::n_bins(n) + 1], z, scratch }
    }

    pub(in crate::dsp) fn bands(&self) -> &[Band] {
        &self.bands
    }

    /// Samples L of half an envelope, by width.
    pub(in crate::dsp) fn half_lengths(&self) -> impl Iterator<Item = usize> {
        self.widths.iter().map(|width| width.inverse.len())
    }

    /// Sums the powers up to each bin, one after another; returns the total.
    fn sum_powers(&mut self, x_hat: &[Complex<T>]) -> f64 {
        let mut sum = 0.0;
        for (to, x) in self.powers[1..].iter_mut().zip(x_hat) {
            sum += power_of(*x);
            *to = sum;
        }
        sum
    }

    /// Calls `measure` with each band and what gives the two halves of its complex envelope, of unit
    /// mean square; `None` where nothing but rounding is in the band.
    pub(in crate::dsp) fn for_each(
        &mut self,
        x_hat: &[Complex<T>],
        mut measure: impl FnMut(usize, &Band, Option<Envelope<'_, T>>),
    ) {
        assert_eq!(x_hat.len(), fft::n_bins(self.n), "bins of the plan");
        let total = self.sum_powers(x_hat);
        let least = T::EPSILON * T::EPSILON * ROUNDING * total / x_hat.len() as f64;
        let mut first = 0;
        for width in &self.widths {
            for (index, band) in self.bands[..width.end].iter().enumerate().skip(first) {
                let bins = &x_hat[band.bins()];
                let mut power = self.powers[band.end_bin] - self.powers[band.start_bin];
                if power < SURE_DIFFERENCE * total {
                    power = bins.iter().map(|x| power_of(*x)).sum();
                }
                if power <= least * bins.len() as f64 || power < f64::MIN_POSITIVE {
                    measure(index, band, None);
                    continue;
                }
                let z = &mut self.z[..width.inverse.len()];
                let scale = 1.0 / power.sqrt();
                measure(
                    index,
                    band,
                    Some(Envelope { bins, scale, width, z, scratch: &mut self.scratch }),
                );
            }
            first = width.end;
        }
    }
}

/// Part of a sum below which a difference of two parts has lost six of its sixteen digits.
const SURE_DIFFERENCE: f64 = 1e-10;

/// A band on its way to its envelope.
pub(in crate::dsp) struct Envelope<'a, T: Real> {
    bins: &'a [Complex<T>],
    /// Makes the mean square 1 (Parseval).
    scale: f64,
    width: &'a Width<T>,
    z: &'a mut [Complex<T>],
    scratch: &'a mut [Complex<T>],
}

/// Scales that any spectrum survives in f32.
const SAFE_SCALES: Range<f64> = 1e-30..1e30;

impl<T: Real> Envelope<'_, T> {
    /// Computes the even or the odd samples.
    pub(in crate::dsp) fn half(&mut self, half: Half) -> &mut [Complex<T>] {
        let (z, padding) = self.z.split_at_mut(self.bins.len());
        let (bins, turns) = (self.bins, &self.width.half_step);
        if SAFE_SCALES.contains(&self.scale) {
            let scale = T::rounded(self.scale);
            Arch::new().dispatch(
                #[inline(always)]
                || match half {
                    Half::Even => z.iter_mut().zip(bins).for_each(|(z, x)| *z = x.scale(scale)),
                    Half::Odd => {
                        for ((z, x), turn) in z.iter_mut().zip(bins).zip(turns) {
                            *z = x.scale(scale) * *turn;
                        }
                    }
                },
            );
        } else {
            for ((z, x), turn) in z.iter_mut().zip(bins).zip(turns) {
                let (re, im) = (x.re.to_f64() * self.scale, x.im.to_f64() * self.scale);
                let x = Complex::new(T::rounded(re), T::rounded(im));
                *z = if half == Half::Odd { x * *turn } else { x };
            }
        }
        padding.fill(Complex::zero());
        self.width.inverse.process_with_scratch(self.z, self.scratch);
        self.z
    }
}

impl<T: Real> fmt::Debug for FilterBank<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FilterBank")
            .field("n", &self.n)
            .field("n_bands", &self.bands.len())
            .finish_non_exhaustive()
    }
}

/// Power of rounding in a bin over the mean power of a bin, in squares of the rounding unit.
const ROUNDING: f64 = 64.0;

/// |X|², in f64: counts of a converter leave f32 in long records.
fn power_of<T: Real>(x: Complex<T>) -> f64 {
    let (re, im) = (x.re.to_f64(), x.im.to_f64());
    re * re + im * im
}

/// 1, 2, 3, 4, 6, 8, 12, … up to 2^depth.
fn band_counts(depth: u32) -> impl Iterator<Item = usize> {
    let halves = (0..=depth.min(40)).map(|level| 1_usize << level);
    halves.flat_map(move |count| {
        let thirds = (count >= 4).then_some(count / 4 * 3);
        thirds.into_iter().chain([count])
    })
}

/// Band `j` of `n_of_width`, without bin 0 and Nyquist; `None` if it holds too little or is not usable.
fn band(n: usize, n_of_width: usize, j: usize, usable: &Range<usize>) -> Option<Band> {
    let n_inner = n.div_ceil(2);
    let edge = |j: usize| floor_index(0.5 + n_inner as f64 * j as f64 / n_of_width as f64);
    let band = Band { n_of_width, start_bin: edge(j).max(1), end_bin: edge(j + 1).min(n_inner) };
    let is_inside = band.start_bin >= usable.start && band.end_bin <= usable.end;
    (is_inside && band.end_bin >= band.start_bin + MIN_BINS).then_some(band)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_tile_the_spectrum() {
        let counts: Vec<usize> = band_counts(4).collect();
        assert_eq!(counts, [1, 2, 3, 4, 6, 8, 12, 16]);
        for n in [4000, 4001, 6007] {
            let bank = FilterBank::<f64>::new(n, 4, 0..fft::n_bins(n), &mut FftCache::new());
            for count in &counts {
                let mut at = 1;
                let of_width: Vec<_> =
                    bank.bands().iter().filter(|band| band.n_of_width == *count).collect();
                assert_eq!(of_width.len(), *count);
                for band in of_width {
                    assert_eq!(band.start_bin, at);
                    at = band.end_bin;
                }
                assert_eq!(at, n.div_ceil(2), "up to below Nyquist");
            }
        }
        // Bands that reach outside or hold too few bins are not in the tree.
        let bank = FilterBank::<f64>::new(4000, 10, 500..1500, &mut FftCache::new());
        assert!(bank.bands().iter().all(|b| b.start_bin >= 500 && b.end_bin <= 1500));
        assert!(bank.bands().iter().all(|b| b.n_bins() >= MIN_BINS) && !bank.bands().is_empty());
        assert!(FilterBank::<f64>::new(30, 3, 0..16, &mut FftCache::new()).bands().is_empty());
    }

    #[test]
    fn edges_and_levels() {
        let band = Band { n_of_width: 3, start_bin: 1000, end_bin: 2000 };
        assert!((band.level() - 3f64.log2()).abs() < 1e-15);
        assert_eq!(band.edges_hz(10_000, 10_000.0), (999.5, 1999.5));
    }
}
