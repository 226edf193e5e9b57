//! Bands of halves and thirds over a shared spectrum, and the complex envelope of each.
//!
//! The tree of the fast kurtogram: 1, 2, 3, 4, 6, 8, 12, … equal bands from 0 to Nyquist. Must not
//! know what is measured in a band.

use std::f64::consts::PI;
use std::fmt;
use std::ops::Range;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::num_complex::Complex;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::grid::Grid;
use crate::dsp::inverse::Inverse;
use crate::dsp::inverse::Workspace;
use crate::dsp::length::quick_len_at_least;
use crate::dsp::power_sums;
use crate::dsp::power_sums::PowerSums;
use crate::dsp::real::Real;
use crate::dsp::real::floor_index;
use crate::dsp::split::Split;

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
/// An envelope is sampled 2L times, L at least the bins of the band: the even samples are the inverse
/// transform of the bins at L points, the odd ones that of the bins turned by e^(jπk/L). Bins keep
/// their frequency, k modulo L, so the even samples of a band are also the sum of all samples of its
/// two halves, whose L is half as large: one transform a band is enough, but for the narrowest.
pub(in crate::dsp) struct FilterBank<T: Real> {
    n: usize,
    bands: Vec<Band>,
    nodes: Vec<Node>,
    widths: Vec<Width<T>>,
    /// The spectrum, of unit mean power of a bin.
    x: Split<T>,
    workspace: Workspace<T>,
    /// Two bands of each generation, side by side until they are added.
    samples: Vec<[Split<T>; 2]>,
}

/// Where a band stands in the tree.
#[derive(Debug, Clone, Copy)]
struct Node {
    width: usize,
    /// Its halves, if their samples can be added.
    halves: Option<[usize; 2]>,
    is_half: bool,
    /// Generations below whose samples are added.
    n_added: u32,
}

/// What the bands of one width share.
struct Width<T: Real> {
    inverse: Inverse<T>,
    /// e^(jπk/L), k < L.
    half_step: Split<T>,
}

impl<T: Real> Width<T> {
    fn new(length: usize, cache: &mut FftCache<T>) -> Self {
        let mut half_step = Split::zeros(length);
        for k in 0..length {
            let (sin, cos) = (PI * k as f64 / length as f64).sin_cos();
            (half_step.re[k], half_step.im[k]) = (T::rounded(cos), T::rounded(sin));
        }
        Self { inverse: Inverse::new(length, cache), half_step }
    }

    /// Puts bins where the inverse has them, turned by e^(jπk/L) for the `odd` samples.
    fn lay_out(&self, x: &Split<T>, bins: Range<usize>, odd: bool, grid: &mut Grid<T>) {
        let length = self.inverse.len();
        let (first, n) = (bins.start % length, bins.len());
        let n_before = n.min(length - first);
        for list in [&mut grid.re, &mut grid.im] {
            list[first + n_before..length].fill(T::zero());
            list[n - n_before..first].fill(T::zero());
        }
        let middle = bins.start + n_before;
        for (bins, place) in [(bins.start..middle, first), (middle..bins.end, 0)] {
            let places = place..place + bins.len();
            // e^(jπ) for every L bins.
            let is_negative = !(bins.start / length).is_multiple_of(2);
            let from = (&x.re[bins.clone()], &x.im[bins]);
            let turns = (&self.half_step.re[places.clone()], &self.half_step.im[places.clone()]);
            let to = (&mut grid.re[places.clone()], &mut grid.im[places]);
            if odd {
                let sign = if is_negative { -T::one() } else { T::one() };
                Arch::new().dispatch(Turn { from, turns, sign, to });
            } else {
                to.0.copy_from_slice(from.0);
                to.1.copy_from_slice(from.1);
            }
        }
    }
}

impl<T: Real> FilterBank<T> {
    pub(in crate::dsp) fn new(
        n: usize,
        depth: u32,
        usable: Range<usize>,
        cache: &mut FftCache<T>,
    ) -> Self {
        assert!(n > 0, "a spectrum of at least one sample");
        let of_width = |count| (0..count).filter_map(move |j| band(n, count, j, &usable));
        let (mut bands, mut counts) = (Vec::new(), Vec::new());
        for count in band_counts(depth) {
            let of_width = of_width.clone();
            let first = bands.len();
            bands.extend(of_width(count));
            if bands.len() > first {
                counts.push(count);
            }
        }
        let lengths = lengths(&bands, &counts);
        let widths: Vec<_> = lengths.iter().map(|length| Width::new(*length, cache)).collect();
        let nodes = nodes(&bands, &counts);
        let n_generations = nodes.iter().map(|node| node.n_added as usize + 1).max().unwrap_or(0);
        let longest = |generation: usize| {
            let own = nodes.iter().filter(|node| node.n_added as usize == generation);
            2 * own.map(|node| lengths[node.width]).max().unwrap_or(0)
        };
        let samples = (0..n_generations)
            .map(|generation| [(); 2].map(|()| Split::zeros(longest(generation))))
            .collect();
        let workspace = Workspace::new(widths.iter().map(|width| &width.inverse));
        let x = Split::zeros(fft::n_bins(n));
        Self { n, bands, nodes, widths, x, workspace, samples }
    }

    pub(in crate::dsp) fn bands(&self) -> &[Band] {
        &self.bands
    }

    /// Samples 2L of an envelope, by width.
    pub(in crate::dsp) fn lengths(&self) -> impl Iterator<Item = usize> {
        self.widths.iter().map(|width| 2 * width.inverse.len())
    }

    /// Calls `measure` once with each band, in any order, and its complex envelope; `None` where nothing
    /// but rounding is in the band.
    pub(in crate::dsp) fn for_each(
        &mut self,
        x_hat: &[Complex<T>],
        mut measure: impl FnMut(usize, &Band, Option<Envelope<'_, T>>),
    ) {
        assert_eq!(x_hat.len(), fft::n_bins(self.n), "bins of the plan");
        let mean = total_power(x_hat) / x_hat.len() as f64;
        if mean < f64::MIN_POSITIVE {
            let bands = self.bands.iter().enumerate();
            bands.for_each(|(index, band)| measure(index, band, None));
            return;
        }
        fill_scaled(x_hat, 1.0 / mean.sqrt(), &mut self.x);
        let Self { bands, nodes, widths, x, workspace, samples, .. } = self;
        let least = T::EPSILON * T::EPSILON * ROUNDING;
        let mut measure_all = |index: usize, samples: &Split<T>, sums: PowerSums| {
            let (band, node): (&Band, &Node) = (&bands[index], &nodes[index]);
            let length = 2 * widths[node.width].inverse.len();
            // Parseval: in units of the mean power of a bin.
            let power = sums.second / length as f64;
            let is_rounding =
                power <= least * band.n_bins() as f64 || power * mean < f64::MIN_POSITIVE;
            let (re, im) = (&samples.re[..length], &samples.im[..length]);
            let envelope = Envelope { re, im, sums, n_added: node.n_added };
            measure(index, band, (!is_rounding).then_some(envelope));
        };
        let mut walk = Walk { bands, nodes, widths, x, workspace, measure: &mut measure_all };
        for root in (0..nodes.len()).filter(|index| !nodes[*index].is_half) {
            walk.envelope(root, 0, &mut samples[..=nodes[root].n_added as usize]);
        }
    }
}

/// The way through the tree, halves first.
struct Walk<'a, T: Real, F> {
    bands: &'a [Band],
    nodes: &'a [Node],
    widths: &'a [Width<T>],
    x: &'a Split<T>,
    workspace: &'a mut Workspace<T>,
    measure: &'a mut F,
}

impl<T: Real, F: FnMut(usize, &Split<T>, PowerSums)> Walk<'_, T, F> {
    /// Computes the samples of a band into the list `side` of the last generation of `samples`.
    fn envelope(&mut self, index: usize, side: usize, samples: &mut [[Split<T>; 2]]) {
        let (node, Some((own, below))) = (self.nodes[index], samples.split_last_mut()) else {
            return;
        };
        let own = &mut own[side];
        let length = self.widths[node.width].inverse.len();
        let mut sums = PowerSums::default();
        if let Some(halves) = node.halves {
            for (side, half) in halves.into_iter().enumerate() {
                self.envelope(half, side, below);
            }
            if let Some([a, b]) = below.last() {
                let to = [&mut own.re[..length], &mut own.im[..length]];
                sums += power_sums::of_sum([&a.re, &a.im], [&b.re, &b.im], to);
            }
        } else {
            sums += self.transform(index, false, 0..length, own);
        }
        sums += self.transform(index, true, length..2 * length, own);
        (self.measure)(index, own, sums);
    }

    /// Writes even or odd samples.
    fn transform(
        &mut self,
        index: usize,
        odd: bool,
        places: Range<usize>,
        own: &mut Split<T>,
    ) -> PowerSums {
        let width = &self.widths[self.nodes[index].width];
        width.lay_out(self.x, self.bands[index].bins(), odd, &mut self.workspace.grid);
        let results = width.inverse.run(self.workspace);
        results.split_to(&mut own.re[places.clone()], &mut own.im[places])
    }
}

/// The complex envelope of a band, its samples in an order of their own.
#[derive(Debug, Clone, Copy)]
pub(in crate::dsp) struct Envelope<'a, T> {
    pub(in crate::dsp) re: &'a [T],
    pub(in crate::dsp) im: &'a [T],
    /// Over all samples.
    pub(in crate::dsp) sums: PowerSums,
    n_added: u32,
}

impl<T> Envelope<'_, T> {
    /// Samples that follow each other at equal distances: the places they stand at, the time of the
    /// first and from one to the next, in samples.
    pub(in crate::dsp) fn runs(&self) -> impl Iterator<Item = (Range<usize>, usize, usize)> {
        let (n, n_added) = (self.re.len(), self.n_added);
        let odd = (0..=n_added).map(move |k| (n >> (k + 1)..n >> k, 1 << k, 2 << k));
        odd.chain([(0..n >> (n_added + 1), 0, 2 << n_added)])
    }
}

struct Turn<'a, T> {
    from: (&'a [T], &'a [T]),
    turns: (&'a [T], &'a [T]),
    sign: T,
    to: (&'a mut [T], &'a mut [T]),
}

impl<T: Real> WithSimd for Turn<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.from.0.len();
        let (x_re, x_im) = (&self.from.0[..n], &self.from.1[..n]);
        let (cos, sin) = (&self.turns.0[..n], &self.turns.1[..n]);
        let (re, im) = (&mut self.to.0[..n], &mut self.to.1[..n]);
        for i in 0..n {
            let (cos, sin) = (self.sign * cos[i], self.sign * sin[i]);
            (re[i], im[i]) = (x_re[i] * cos - x_im[i] * sin, x_re[i] * sin + x_im[i] * cos);
        }
    }
}

/// Scales that any spectrum survives in f32.
const SAFE_SCALES: Range<f64> = 1e-30..1e30;

/// Writes `scale` times the spectrum.
fn fill_scaled<T: Real>(x_hat: &[Complex<T>], scale: f64, to: &mut Split<T>) {
    if SAFE_SCALES.contains(&scale) {
        let scale = T::rounded(scale);
        let (re, im) = (&mut to.re[..x_hat.len()], &mut to.im[..x_hat.len()]);
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for ((re, im), x) in re.iter_mut().zip(im).zip(x_hat) {
                    (*re, *im) = (x.re * scale, x.im * scale);
                }
            },
        );
    } else {
        for ((re, im), x) in to.re.iter_mut().zip(to.im.iter_mut()).zip(x_hat) {
            *re = T::rounded(x.re.to_f64() * scale);
            *im = T::rounded(x.im.to_f64() * scale);
        }
    }
}

/// Points L of each width: of a chain of widths that double, the narrowest's length doubled.
fn lengths(bands: &[Band], counts: &[usize]) -> Vec<usize> {
    let widest = |count: usize| {
        let same = bands.iter().filter(|band| band.n_of_width == count);
        same.map(Band::n_bins).max().unwrap_or(0)
    };
    let mut lengths = vec![0; counts.len()];
    for i in (0..counts.len()).rev() {
        let narrower = counts.iter().position(|count| *count == 2 * counts[i]);
        lengths[i] = match narrower {
            Some(narrower) => 2 * lengths[narrower],
            None => quick_len_at_least(widest(counts[i])),
        };
    }
    lengths
}

/// Joins each band with its halves.
fn nodes(bands: &[Band], counts: &[usize]) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::with_capacity(bands.len());
    for band in bands {
        let width = counts.iter().position(|count| *count == band.n_of_width).unwrap_or(0);
        nodes.push(Node { width, halves: None, is_half: false, n_added: 0 });
    }
    for (i, band) in bands.iter().enumerate().rev() {
        let is_first =
            |b: &Band| b.n_of_width == 2 * band.n_of_width && b.start_bin == band.start_bin;
        let Some(first) = bands.iter().position(is_first) else { continue };
        let Some(second) = bands.get(first + 1) else { continue };
        let is_second = second.n_of_width == 2 * band.n_of_width
            && second.start_bin == bands[first].end_bin
            && second.end_bin == band.end_bin;
        // Samples can be added if they stand in the same order.
        if is_second && nodes[first].n_added == nodes[first + 1].n_added {
            nodes[i].halves = Some([first, first + 1]);
            nodes[i].n_added = nodes[first].n_added + 1;
            nodes[first].is_half = true;
            nodes[first + 1].is_half = true;
        }
    }
    nodes
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

/// Σ|X|², in f64: counts of a converter leave f32 in long records.
fn total_power<T: Real>(x_hat: &[Complex<T>]) -> f64 {
    let mut sums = [0.0; 8];
    let (eights, rest) = x_hat.as_chunks::<8>();
    for eight in eights {
        for (sum, x) in sums.iter_mut().zip(eight) {
            *sum += power_of(*x);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| power_of(*x)).sum::<f64>()
}

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
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::reference::dft_of_real;
    use crate::dsp::reference::gaussian_noise;

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
    fn samples_are_those_of_the_fourier_sum() {
        // 31 bins halve into 15 and 16: one half is no band, so nothing is added there. A usable range
        // leaves bands whose halves reach further down than others.
        for (n, depth, usable) in [(2000, 4, 0..1001), (497, 4, 0..249), (2003, 5, 100..900)] {
            let x = gaussian_noise(n, 5);
            let x_hat: Vec<_> = dft_of_real(&x)[..fft::n_bins(n)].to_vec();
            let mut bank = FilterBank::<f64>::new(n, depth, usable, &mut FftCache::new());
            let mean = total_power(&x_hat) / x_hat.len() as f64;
            let mut seen = vec![0; bank.bands().len()];
            let mut deepest = 0;
            bank.for_each(&x_hat, |index, band, envelope| {
                let envelope = envelope.unwrap();
                let length = envelope.re.len();
                let mut times = vec![false; length];
                for (places, first, step) in envelope.runs() {
                    for (i, place) in places.enumerate() {
                        let time = first + i * step;
                        assert!(!std::mem::replace(&mut times[time], true), "{band:?}");
                        let turn = |k: usize| TAU * (k * time % length) as f64 / length as f64;
                        let bins = band.bins().map(|k| x_hat[k] * Complex::cis(turn(k)));
                        let exact = bins.sum::<Complex<f64>>() / mean.sqrt();
                        let found = Complex::new(envelope.re[place], envelope.im[place]);
                        // Rounding of sums of up to 1000 numbers of size 1.
                        assert!((found - exact).norm() < 1e-11, "{band:?} {time}");
                    }
                }
                assert!(times.iter().all(|seen| *seen), "{band:?}: every time once");
                seen[index] += 1;
                deepest = deepest.max(envelope.n_added);
            });
            assert!(seen.iter().all(|n| *n == 1) && deepest > 1, "{n}: {deepest}");
        }
    }

    #[test]
    fn edges_and_levels() {
        let band = Band { n_of_width: 3, start_bin: 1000, end_bin: 2000 };
        assert!((band.level() - 3f64.log2()).abs() < 1e-15);
        assert_eq!(band.edges_hz(10_000, 10_000.0), (999.5, 1999.5));
    }
}
