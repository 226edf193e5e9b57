//! Spectrum of the squared envelope of one band, from the samples on.
//!
//! For a record of which one band is looked at: [`crate::dsp::envelope`] takes a spectrum that others
//! share, here only the band's bins of it are ever made. Same result. Must not know which band or
//! line is of interest.

use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::envelope::EnvelopeSpectrumPlan;
use crate::dsp::envelope::SquaredEnvelopePlan;
use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::forward;
use crate::dsp::forward::PairTransform;
use crate::dsp::inverse::Inverse;
use crate::dsp::inverse::Workspace;
use crate::dsp::power_sums;
use crate::dsp::real::Real;
use crate::dsp::split::Split;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Modulation depth of a band of n samples (D11 and D12 without padding) by way of D77.
pub struct BandEnvelopePlan<T: Real> {
    n: usize,
    /// Samples of e².
    length: usize,
    way: Way<T>,
}

enum Way<T: Real> {
    Pairs(Box<Pairs<T>>),
    /// Lengths and bands that have no such way.
    Parts(Box<Parts<T>>),
}

impl<T: Real> BandEnvelopePlan<T> {
    /// Plans for the bins `band_bins` ([`bins_of_band`](crate::dsp::envelope::bins_of_band)) of the
    /// spectrum of `n` samples.
    ///
    /// # Panics
    ///
    /// If the band is empty or reaches above ⌊n/2⌋ + 1.
    #[must_use]
    pub fn new(n: usize, band_bins: Range<usize>, cache: &mut FftCache<T>) -> Self {
        let is_inside = band_bins.start < band_bins.end && band_bins.end <= fft::n_bins(n);
        assert!(is_inside, "a band inside the spectrum");
        let length = fft::cheapest_inverse_len::<T>(2 * band_bins.len());
        let way = match Pairs::new(n, band_bins.clone(), length, cache) {
            Some(pairs) => Way::Pairs(Box::new(pairs)),
            None => Way::Parts(Box::new(Parts::new(n, band_bins, cache))),
        };
        Self { n, length, way }
    }

    /// Depths written per call: one for every fs/n from 0 to the width of the band and a little more.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        fft::n_bins(self.length)
    }

    /// Writes the modulation depth at k·fs/n into `depth[k]`, returns mean(e²), u².
    ///
    /// `x`: n samples, unit u; what lies above the last depth is 0 but for the window's leakage.
    /// `None` (and depths of 0) if the mean is 0: no signal, nothing modulated.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], depth: &mut [T]) -> Option<f64> {
        assert_eq!(x.len(), self.n, "samples of the plan");
        assert_eq!(depth.len(), self.n_bins(), "bins of the plan");
        match &mut self.way {
            Way::Pairs(pairs) => pairs.process(x, depth),
            Way::Parts(parts) => parts.process(x, depth),
        }
    }
}

impl<T: Real> fmt::Debug for BandEnvelopePlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BandEnvelopePlan").field("n", &self.n).finish_non_exhaustive()
    }
}

/// By the plans of a shared spectrum.
struct Parts<T: Real> {
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    squared: SquaredEnvelopePlan<T>,
    e2: Vec<T>,
    spectrum: EnvelopeSpectrumPlan<T>,
}

impl<T: Real> Parts<T> {
    fn new(n: usize, bins: Range<usize>, cache: &mut FftCache<T>) -> Self {
        let forward = ForwardPlan::new(n, cache);
        let squared = SquaredEnvelopePlan::new(n, bins, cache);
        let length = squared.out_len();
        Self {
            x_hat: vec![Complex::zero(); forward.n_bins()],
            forward,
            squared,
            e2: vec![T::zero(); length],
            spectrum: EnvelopeSpectrumPlan::unpadded(length, cache),
        }
    }

    fn process(&mut self, x: &[T], depth: &mut [T]) -> Option<f64> {
        self.forward.process(x, &mut self.x_hat);
        self.squared.process(&self.x_hat, &mut self.e2);
        self.spectrum.process(&self.e2, depth)
    }
}

/// One half of the samples of e²: the even or the odd ones.
struct Half<T: Real> {
    workspace: Workspace<T>,
    weights: Vec<T>,
}

/// By transforms of half the lengths (D77).
struct Pairs<T: Real> {
    arch: Arch,
    bins: Range<usize>,
    samples: PairTransform<T>,
    /// e^(j2πk/n)/n of the band's bins.
    unfold: Split<T>,
    /// 1/n.
    mean_factor: T,
    band: Split<T>,
    /// e^(j2πk/L) of the band's bins.
    shift: Split<T>,
    inverse: Inverse<T>,
    halves: [Half<T>; 2],
    envelope: PairTransform<T>,
    envelope_turns: Split<T>,
    spectrum: Split<T>,
    /// 2/Σw.
    line: f64,
}

impl<T: Real> Pairs<T> {
    fn new(n: usize, bins: Range<usize>, length: usize, cache: &mut FftCache<T>) -> Option<Self> {
        // Bins at DC and Nyquist have another factor.
        if bins.start == 0 || 2 * (bins.end - 1) >= n || !length.is_multiple_of(2) {
            return None;
        }
        let samples = PairTransform::new(n, cache)?;
        let envelope = PairTransform::new(length, cache)?;
        let inverse = Inverse::new(length / 2, cache);
        let window = Window::new(Shape::Hann, length);
        let half = |first: usize| Half {
            workspace: Workspace::new(std::iter::once(&inverse)),
            weights: window.weights.iter().skip(first).step_by(2).copied().collect(),
        };
        let halves = [half(0), half(1)];
        let mut shift = Split::zeros(bins.len());
        for (i, k) in bins.clone().enumerate() {
            let (sin, cos) = (TAU * (k % length) as f64 / length as f64).sin_cos();
            (shift.re[i], shift.im[i]) = (T::rounded(cos), T::rounded(sin));
        }
        Some(Self {
            arch: Arch::new(),
            unfold: forward::half_turns(n, bins.clone(), 2.0 / n as f64),
            mean_factor: T::rounded(1.0 / n as f64),
            band: Split::zeros(bins.len()),
            bins,
            samples,
            shift,
            inverse,
            halves,
            envelope,
            envelope_turns: forward::half_turns(length, 0..length / 2 + 1, 1.0),
            spectrum: Split::zeros(length / 2 + 1),
            line: 2.0 / window.sum,
        })
    }

    fn process(&mut self, x: &[T], depth: &mut [T]) -> Option<f64> {
        let mean = self.band_of(x);
        if mean <= 0.0 {
            depth.fill(T::zero());
            return None;
        }
        // From here on of a band whose e² has the mean 1.
        self.lay_out(T::rounded(mean.sqrt().recip()));
        let (even, odd) = self.envelope.points();
        let mut left = 0.0;
        for (half, out) in self.halves.iter_mut().zip([even, odd]) {
            let results = self.inverse.run(&mut half.workspace);
            left += results.squares_to(T::one(), &half.weights, out);
        }
        let z = self.envelope.run(0..self.spectrum.re.len());
        forward::unfold(z, &self.envelope_turns, &mut self.spectrum);
        // What the samples' own mean leaves of the bins' power stands in the first two bins of a Hann window.
        let length = 2 * self.envelope.len();
        let left = left / length as f64;
        let of_window = T::rounded(left / self.line);
        self.spectrum.re[0] -= of_window + of_window;
        self.spectrum.re[1] += of_window;
        self.spectrum.moduli(T::rounded(self.line / (1.0 + left)), depth);
        let last = depth.len() - 1;
        for end in [0, last] {
            depth[end] *= T::rounded(0.5);
        }
        Some(mean * (1.0 + left))
    }

    /// Makes the band's bins, times 2/n, and returns the mean of e²: their power.
    fn band_of(&mut self, x: &[T]) -> f64 {
        // Any offset is in bin 0 alone; without it sums round less.
        let offset = T::rounded(power_sums::rough_mean(x));
        self.samples.fill(x, (offset, T::zero()), None);
        let h = self.samples.len();
        let (start, end) = (self.bins.start, self.bins.end);
        let z = self.samples.run(start.min(h + 1 - end)..end.max(h + 1 - start));
        let (turns, band) = (&self.unfold, &mut self.band);
        let here = (&z.re[start..end], &z.im[start..end]);
        let mirror = h + 1 - end..h + 1 - start;
        let there = (&z.re[mirror.clone()], &z.im[mirror]);
        let factor = self.mean_factor;
        self.arch.dispatch(Bins { here, there, turns, factor, band });
        power_sums::of_list(&self.band.re, &self.band.im)
    }

    /// Puts the band's bins times `factor` where the two inverse transforms have them, those of the odd
    /// samples shifted by one of L.
    fn lay_out(&mut self, factor: T) {
        let Self { band, shift, bins, halves: [even, odd], inverse, arch, .. } = self;
        let (length, n) = (inverse.len(), bins.len());
        let first = bins.start % length;
        let n_before = n.min(length - first);
        for half in [&mut *even, &mut *odd] {
            for list in [&mut half.workspace.grid.re, &mut half.workspace.grid.im] {
                list[first + n_before..length].fill(T::zero());
                list[n - n_before..first].fill(T::zero());
            }
        }
        let parts = [(0..n_before, first), (n_before..n, 0)];
        for (from, to) in parts {
            let to = to..to + from.len();
            let [even, odd] = [&mut *even, &mut *odd].map(|half| {
                let grid = &mut half.workspace.grid;
                [&mut grid.re[to.clone()], &mut grid.im[to.clone()]]
            });
            arch.dispatch(Shifted { band, shift, factor, from, even, odd });
        }
    }
}

/// Bins of real samples (D51) times 2/n, from the transform of their pairs at the bins and mirrored.
struct Bins<'a, T: Real> {
    here: (&'a [T], &'a [T]),
    there: (&'a [T], &'a [T]),
    turns: &'a Split<T>,
    factor: T,
    band: &'a mut Split<T>,
}

impl<T: Real> WithSimd for Bins<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { here, there, turns, factor, band } = self;
        let turns = (&turns.re[..], &turns.im[..]);
        forward::unfold_lists((here, there), turns, factor, &mut band.re, &mut band.im);
    }
}

/// Numbers times a factor, and those turned.
struct Shifted<'a, T: Real> {
    band: &'a Split<T>,
    shift: &'a Split<T>,
    factor: T,
    from: Range<usize>,
    even: [&'a mut [T]; 2],
    odd: [&'a mut [T]; 2],
}

impl<T: Real> WithSimd for Shifted<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { band, shift, factor, from, even: [re, im], odd: [odd_re, odd_im] } = self;
        let n = re.len();
        let (a, b) = (&band.re[from.clone()][..n], &band.im[from.clone()][..n]);
        let (c, s) = (&shift.re[from.clone()][..n], &shift.im[from][..n]);
        let (im, odd_re, odd_im) = (&mut im[..n], &mut odd_re[..n], &mut odd_im[..n]);
        for i in 0..n {
            let (a, b) = (a[i] * factor, b[i] * factor);
            (re[i], im[i]) = (a, b);
            odd_re[i] = a * c[i] - b * s[i];
            odd_im[i] = a * s[i] + b * c[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::envelope;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;

    const FS_HZ: f64 = 1000.0;

    /// Depths at every fs/n as the definitions say: Hilbert transform by its sum, e² at the full
    /// rate, Hann window, Fourier sum.
    fn slow(x: &[f64], bins: Range<usize>) -> (Vec<f64>, f64) {
        let n = x.len();
        let offset = x.iter().sum::<f64>() / n as f64;
        let turn =
            |k: usize, i: usize| Complex::from_polar(1.0, TAU * ((k * i) % n) as f64 / n as f64);
        let bin = |k: usize| -> Complex<f64> {
            x.iter().enumerate().map(|(i, x)| turn(k, i).conj() * (x - offset)).sum()
        };
        let side = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let band: Vec<(usize, Complex<f64>)> =
            bins.map(|k| (k, bin(k) * (side(k) / n as f64))).collect();
        let z = |i: usize| -> Complex<f64> { band.iter().map(|(k, x)| turn(*k, i) * x).sum() };
        let e2: Vec<f64> = (0..n).map(|i| z(i).norm_sqr()).collect();
        let mean = e2.iter().sum::<f64>() / n as f64;
        let weight = |i: usize| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos();
        let depth = |k: usize| {
            let terms =
                e2.iter().enumerate().map(|(i, e2)| turn(k, i).conj() * ((e2 - mean) * weight(i)));
            let sum: Complex<f64> = terms.sum();
            // Σw = n/2.
            side(k) * sum.norm() / (0.5 * n as f64) / mean
        };
        ((0..=n / 2).map(depth).collect(), mean)
    }

    fn found<T: Real>(x: &[f64], bins: Range<usize>) -> (Vec<T>, f64, bool) {
        let mut plan = BandEnvelopePlan::new(x.len(), bins, &mut FftCache::new());
        let mut depth = vec![T::one(); plan.n_bins()];
        let mean = plan.process(&narrow::<T>(x), &mut depth).unwrap();
        (depth, mean, matches!(plan.way, Way::Pairs(_)))
    }

    /// Largest difference of a depth, and of the mean, from the exact ones.
    fn gap_of<T: Real>(x: &[f64], bins: Range<usize>, (exact, mean): (&[f64], f64)) -> f64 {
        let (depth, found_mean, _) = found::<T>(x, bins.clone());
        // The last depth of an even length is a mirror of two, halved.
        let shared = exact.len().min(depth.len() - 1);
        // The band's width, and the window's leakage into the next.
        let above = exact.get(bins.len() + 1..).unwrap_or_default();
        assert!(above.iter().all(|depth| *depth < 1e-13), "nothing is left out");
        let gap = largest_difference(&depth[..shared], &exact[..shared]);
        gap.max((found_mean / mean - 1.0).abs())
    }

    #[test]
    fn both_ways_give_what_the_definitions_say() {
        // Lengths with pairs (640, 1000: other widths of vectors) and without; bands from low to high, at DC and at Nyquist.
        let cases =
            [(640, 100..181), (1000, 200..401), (1000, 1..40), (1000, 420..500), (242, 30..80)];
        for (n, bins) in cases.into_iter().chain([(1000, 0..120), (1000, 400..501), (241, 30..80)])
        {
            let x: Vec<f64> = gaussian_noise(n, 5)
                .iter()
                .enumerate()
                .map(|(i, x)| 3.0 + x * (1.0 + 0.8 * (TAU * 7.0 * i as f64 / n as f64).cos()))
                .collect();
            let (exact, exact_mean) = slow(&x, bins.clone());
            let largest = exact.iter().fold(0.0_f64, |m, d| m.max(*d));
            let gap = gap_of::<f64>(&x, bins.clone(), (&exact, exact_mean));
            assert!(gap < 1e-13 * largest, "{n} {bins:?}: {gap:e}");
            let gap = gap_of::<f32>(&x, bins.clone(), (&exact, exact_mean));
            assert!(gap < 3e-7 * largest, "{n} {bins:?}: {gap:e}");
        }
        let x = gaussian_noise(640, 1);
        assert!(!found::<f32>(&x, 0..120).2 && !found::<f32>(&x, 240..321).2);
        let has_vectors = Inverse::<f32>::new(16, &mut FftCache::new());
        assert_eq!(found::<f32>(&x, 100..181).2, matches!(has_vectors, Inverse::Grid(_)));
    }

    #[test]
    fn agrees_with_the_plans_of_a_shared_spectrum_whatever_the_offset() {
        let n = 10_000;
        let bins = envelope::bins_of_band(n, 10.0 * FS_HZ, 2000.0, 4000.0).unwrap();
        for offset in [0.0, 1e3] {
            let x: Vec<f64> = gaussian_noise(n, 9).iter().map(|x| x + offset).collect();
            let x = narrow::<f32>(&x);
            let mut cache = FftCache::new();
            let mut plan = BandEnvelopePlan::new(n, bins.clone(), &mut cache);
            let mut depth = vec![0.0; plan.n_bins()];
            let mean = plan.process(&x, &mut depth).unwrap();
            let mut parts = Parts::new(n, bins.clone(), &mut cache);
            let mut shared = vec![0.0; plan.n_bins()];
            let of_parts = parts.process(&x, &mut shared).unwrap();
            // Both are within 1.5e-7 of a largest depth of about 0.1.
            let gap = depth.iter().zip(&shared).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // 3e-7 of the largest depth of such noise, 0.17.
            assert!(gap < 5e-8 && (mean / of_parts - 1.0).abs() < 3e-7, "{gap:e}");
        }
    }

    #[test]
    fn silence_and_constants_have_no_depth() {
        for x in [[0.0_f32; 1000], [0.1; 1000], [1e30; 1000]] {
            let mut plan = BandEnvelopePlan::new(1000, 200..401, &mut FftCache::new());
            let mut depth = vec![1.0; plan.n_bins()];
            assert_eq!(plan.process(&x, &mut depth), None);
            assert!(depth.iter().all(|d| *d <= 0.0));
        }
    }

    #[test]
    fn the_smallest_numbers_have_their_depths() {
        let x: Vec<f64> = gaussian_noise(640, 3);
        let (exact, _, _) = found::<f32>(&x, 100..181);
        for (scale, tolerance) in [(1e-15, 3e-7), (1e-18, 1e-3), (1e-22, 1e-3)] {
            let small: Vec<f32> = narrow(&x.iter().map(|x| x * scale).collect::<Vec<_>>());
            let mut plan = BandEnvelopePlan::new(640, 100..181, &mut FftCache::new());
            let mut depth = vec![0.0; plan.n_bins()];
            let mean = plan.process(&small, &mut depth);
            let gap = depth.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // Squares of 1e-38 and less lose their digits, those of 1e-46 all of them: None then.
            assert!(mean.is_none() || gap < tolerance, "{scale:e}: {gap:e}");
            assert_eq!(mean.is_none(), scale < 1e-20, "{scale:e}");
        }
    }
}
