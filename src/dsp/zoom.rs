//! Zoom: the spectrum of a narrow band on a grid as fine as wanted.
//!
//! For looking at side bands. Exact: the same sums as the discrete Fourier transform, at frequencies
//! of any distance. It interpolates; what separates two lines is the length of the record. Must not
//! know what stands in the band.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft::FftCache;
use crate::dsp::length::quick_len_at_least;
use crate::dsp::real::Real;
use crate::dsp::real::scaled_to_u128;
use crate::dsp::stats;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Complex amplitudes at equidistant frequencies by the chirp-z transform (D30).
///
/// Two transforms of n + lines points, in f64 whatever the samples are: the chirp spreads a line over
/// all of them, and f32 would leave 4e-7 of it. For a handful of frequencies [`crate::dsp::line`] is
/// quicker.
pub struct ZoomPlan {
    low_hz: f64,
    step_hz: f64,
    /// w[i]·e^(−j2π(c₀i + ½c₁i²)).
    chirp: Vec<Complex<f64>>,
    /// Transform of e^(jπc₁m²), over the padded length.
    filter: Vec<Complex<f64>>,
    /// Normalisation times e^(−jπc₁k²).
    untwist: Vec<Complex<f64>>,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
    work: Vec<Complex<f64>>,
    scratch: Vec<Complex<f64>>,
}

/// The frequencies of a zoom: `n_lines` of them, `low_hz` + k·`step_hz`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZoomGrid {
    /// First frequency, Hz, 0…fs/2.
    pub low_hz: f64,
    /// Distance of two, Hz, positive.
    pub step_hz: f64,
    /// Their number, at least 1.
    pub n_lines: usize,
}

impl ZoomPlan {
    /// Plans for `n` samples at `fs_hz` under a window; `None` if the grid is empty, not a number or
    /// not inside 0…fs/2.
    ///
    /// # Panics
    ///
    /// If `n` is 0 or a Kaiser window's β is not finite.
    #[must_use]
    pub fn new(
        n: usize,
        shape: Shape,
        fs_hz: f64,
        grid: ZoomGrid,
        cache: &mut FftCache<f64>,
    ) -> Option<Self> {
        assert!(n > 0, "a transform needs at least one sample");
        let (c0, c1) = (grid.low_hz / fs_hz, grid.step_hz / fs_hz);
        let last = c0 + c1 * grid.n_lines.checked_sub(1)? as f64;
        // The last line may be Nyquist but for the rounding of the product.
        let is_inside = c0 >= 0.0 && c1 > 0.0 && last <= 0.5 * (1.0 + 1e-12) && last.is_finite();
        if !is_inside {
            return None;
        }
        let window = Window::<f64>::new(shape, n);
        let (start, half_step) = (Turns::new(c0), Turns::new(0.5 * c1));
        let chirp = window
            .weights
            .iter()
            .zip(0_u128..)
            .map(|(weight, i)| phasor(-start.times(i) - half_step.times(i * i), *weight));
        let chirp: Vec<Complex<f64>> = chirp.collect();
        let is_own_mirror = |c: f64| c <= 0.0 || c >= 0.5 * (1.0 - 1e-12);
        let untwist = (0..grid.n_lines).zip(0_u128..).map(|(k, square)| {
            let sides = if is_own_mirror(c0 + c1 * k as f64) { 1.0 } else { 2.0 };
            phasor(-half_step.times(square * square), sides / window.sum)
        });
        let untwist = untwist.collect();
        let length = quick_len_at_least(n + grid.n_lines - 1);
        let forward = cache.complex_forward(length);
        let inverse = cache.complex_inverse(length);
        let n_scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        let mut scratch = vec![Complex::zero(); n_scratch];
        let mut filter = vec![Complex::zero(); length];
        for (m, square) in (0..n.max(grid.n_lines)).zip(0_u128..) {
            let value = phasor(half_step.times(square * square), 1.0 / length as f64);
            if m < grid.n_lines {
                filter[m] = value;
            }
            if m > 0 && m < n {
                filter[length - m] = value;
            }
        }
        forward.process_with_scratch(&mut filter, &mut scratch);
        Some(Self {
            low_hz: grid.low_hz,
            step_hz: grid.step_hz,
            chirp,
            filter,
            untwist,
            forward,
            inverse,
            work: vec![Complex::zero(); length],
            scratch,
        })
    }

    /// Values written per call.
    #[must_use]
    pub fn n_lines(&self) -> usize {
        self.untwist.len()
    }

    /// Frequency of value `k`, Hz.
    #[must_use]
    pub fn frequency_hz(&self, k: usize) -> f64 {
        self.low_hz + self.step_hz * k as f64
    }

    /// Writes the complex amplitudes A·e^(−jφ) and returns the mean of `x`, which is removed first.
    ///
    /// `x`: n samples, unit u. `out`: zero-to-peak amplitude and lag, as
    /// [`crate::dsp::spectrum::AmplitudePlan`] has it at these frequencies: 2/Σw times the sum, 1/Σw
    /// at 0 and Nyquist. A sine reads its amplitude at its own frequency, but for what the window
    /// leaks from −f (below 1e-3 from 10 bins on with Hann).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process<T: Real>(&mut self, x: &[T], out: &mut [Complex<T>]) -> f64 {
        assert_eq!(x.len(), self.chirp.len(), "samples of the plan");
        assert_eq!(out.len(), self.n_lines(), "lines of the plan");
        let mean = stats::mean(x).unwrap_or(0.0);
        let (signal, padding) = self.work.split_at_mut(x.len());
        for ((work, x), chirp) in signal.iter_mut().zip(x).zip(&self.chirp) {
            *work = chirp.scale(x.to_f64() - mean);
        }
        padding.fill(Complex::zero());
        self.forward.process_with_scratch(&mut self.work, &mut self.scratch);
        for (work, filter) in self.work.iter_mut().zip(&self.filter) {
            *work *= *filter;
        }
        self.inverse.process_with_scratch(&mut self.work, &mut self.scratch);
        for ((out, work), untwist) in out.iter_mut().zip(&self.work).zip(&self.untwist) {
            let value = *work * *untwist;
            *out = Complex::new(T::rounded(value.re), T::rounded(value.im));
        }
        mean
    }
}

impl fmt::Debug for ZoomPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ZoomPlan")
            .field("n", &self.chirp.len())
            .field("low_hz", &self.low_hz)
            .field("step_hz", &self.step_hz)
            .field("n_lines", &self.n_lines())
            .finish_non_exhaustive()
    }
}

/// Turns a step as a fixed-point number with 100 fractional bits: c·i² keeps its fraction exactly,
/// where a product of f64 loses 1e-11 of a turn at 1e5 samples.
struct Turns(u128);

impl Turns {
    const BITS: i32 = 100;

    /// `cycles`: 0…½.
    fn new(cycles: f64) -> Self {
        Self(scaled_to_u128(cycles, Self::BITS))
    }

    /// The fraction of a turn after `steps` of them, 0…1. Whole turns fall out by wrapping.
    fn times(&self, steps: u128) -> f64 {
        let fraction = self.0.wrapping_mul(steps) & ((1 << Self::BITS) - 1);
        fraction as f64 / 2f64.powi(Self::BITS)
    }
}

/// r·e^(j2πt).
fn phasor(turns: f64, r: f64) -> Complex<f64> {
    Complex::from_polar(r, TAU * turns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::line::line_at;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const FS_HZ: f64 = 10_000.0;

    fn zoomed<T: Real>(x: &[f64], shape: Shape, grid: ZoomGrid) -> Vec<Complex<f64>> {
        let mut plan = ZoomPlan::new(x.len(), shape, FS_HZ, grid, &mut FftCache::new()).unwrap();
        let mut out = vec![Complex::<T>::zero(); plan.n_lines()];
        plan.process(&narrow::<T>(x), &mut out);
        out.iter().map(|c| Complex::new(c.re.to_f64(), c.im.to_f64())).collect()
    }

    /// The fraction of c·i turns: 26 bits of c times an i below 2²⁷ is exact, and so is what is left.
    fn turns(c: f64, i: usize) -> f64 {
        let high = (c * 2f64.powi(26)).floor() / 2f64.powi(26);
        (high * i as f64).fract() + (c - high) * i as f64
    }

    /// 2/Σw·Σ w·(x − x̄)·e^(−j2π(low + k·step)i/fs).
    fn slow(x: &[f64], shape: Shape, grid: ZoomGrid, k: usize) -> Complex<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let window = Window::<f64>::new(shape, x.len());
        let at = |(i, x): (usize, &f64)| {
            let turns = turns(grid.low_hz / FS_HZ, i) + turns(grid.step_hz / FS_HZ, k * i);
            Complex::from_polar(window.weights[i] * (x - mean), -TAU * turns)
        };
        // In pieces: one long sum would round off 2e-14 of it, more than what is tested.
        let terms: Vec<Complex<f64>> = x.iter().enumerate().map(at).collect();
        let pieces = terms.chunks(64).map(|piece| piece.iter().sum::<Complex<f64>>());
        let pieces: Vec<Complex<f64>> = pieces.collect();
        let total: Complex<f64> =
            pieces.chunks(64).map(|piece| piece.iter().sum::<Complex<f64>>()).sum();
        total * (2.0 / window.sum)
    }

    fn worst<T: Real>(x: &[f64], shape: Shape, grid: ZoomGrid) -> f64 {
        let out = zoomed::<T>(x, shape, grid);
        let error = |(k, value): (usize, &Complex<f64>)| (value - slow(x, shape, grid, k)).norm();
        out.iter().enumerate().map(error).fold(0.0, f64::max)
    }

    #[test]
    fn is_the_direct_sum_at_any_frequencies() {
        for (n, low_hz, step_hz, n_lines) in [
            (1000, 100.0, 0.37, 301),
            (97, 10.0, 13.7, 40),
            (10_007, 680.0, 0.01, 600),
            (5, 1.0, 3.0, 50),
        ] {
            let tones = [
                sine(n, FS_HZ, 683.1, 1.0, 0.3),
                gaussian_noise(n, 3).iter().map(|v| 0.1 * v).collect(),
            ];
            let x = sum(&tones);
            let grid = ZoomGrid { low_hz, step_hz, n_lines };
            for shape in [Shape::Hann, Shape::FlatTop] {
                // Of a line of 1. f64: rounding of two transforms of n + lines points, and of the
                // reference's own sum; f32: samples and results are rounded, 6e-8 each.
                let (wide, single) = (worst::<f64>(&x, shape, grid), worst::<f32>(&x, shape, grid));
                assert!(wide < 1e-14, "{n} {shape:?}: {wide}");
                assert!(single < 1.5e-7, "{n} {shape:?}: {single}");
            }
        }
    }

    #[test]
    fn long_records_keep_their_phase() {
        // c·i² reaches 1e5 turns: with f64 products 1e-11 would be left.
        let n = 100_000;
        let x = sine(n, FS_HZ, 683.123, 1.0, 0.3);
        let grid = ZoomGrid { low_hz: 683.0, step_hz: 0.041, n_lines: 7 };
        let error = worst::<f64>(&x, Shape::Hann, grid);
        assert!(error < 1e-14, "{error}");
        let out = zoomed::<f64>(&x, Shape::Hann, grid);
        let line = line_at(&x, FS_HZ, 683.123).unwrap();
        assert!((out[3].norm() - line.amplitude).abs() < 1e-9 && (out[3].arg() + 0.3).abs() < 1e-9);
        let single = zoomed::<f32>(&x, Shape::Hann, grid);
        assert!((single[3] - out[3]).norm() < 1.5e-7, "{}", (single[3] - out[3]).norm());
    }

    #[test]
    fn two_lines_a_bin_and_a_half_apart_are_seen_between_the_bins() {
        let n = 10_000;
        let x = sum(&[sine(n, FS_HZ, 1000.3, 1.0, 0.0), sine(n, FS_HZ, 1004.3, 0.5, 1.0)]);
        let grid = ZoomGrid { low_hz: 998.3, step_hz: 0.1, n_lines: 100 };
        let out = zoomed::<f64>(&x, Shape::Hann, grid);
        // Four bins apart a Hann lobe of the other leaves 1/(π·4·15) = 0.5 %.
        assert!((out[20].norm() - 1.0).abs() < 5e-3 && (out[60].norm() - 0.5).abs() < 6e-3);
    }

    #[test]
    fn constant_and_nyquist_read_as_in_the_amplitude_spectrum() {
        let n = 64;
        let grid = ZoomGrid { low_hz: 0.0, step_hz: FS_HZ / 64.0, n_lines: 33 };
        let nyquist: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 2.0 } else { -2.0 }).collect();
        let out = zoomed::<f64>(&nyquist, Shape::Hann, grid);
        assert!((out[32].norm() - 2.0).abs() < 1e-14 && out[0].norm() < 1e-14);
        for shape in [Shape::Hann, Shape::BlackmanHarris] {
            let constant = zoomed::<f32>(&vec![1e6; n], shape, grid);
            assert!(constant.iter().all(|value| value.norm() <= 0.0));
        }
        let x = sine(512, FS_HZ, 683.0, 1.0, 0.1);
        let raised: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
        let grid = ZoomGrid { low_hz: 600.0, step_hz: 5.0, n_lines: 30 };
        let (clean, offset) =
            (zoomed::<f64>(&x, Shape::Hann, grid), zoomed::<f64>(&raised, Shape::Hann, grid));
        for (a, b) in clean.iter().zip(&offset) {
            // 1e6 rounds the samples to 1e-10.
            assert!((a - b).norm() < 1e-10);
        }
    }

    #[test]
    fn impulses_and_denormals_stay_finite() {
        let grid = ZoomGrid { low_hz: 10.0, step_hz: 1.0, n_lines: 9 };
        let mut impulse = vec![0.0; 101];
        impulse[50] = 1.0;
        for out in [
            zoomed::<f32>(&impulse, Shape::Hann, grid),
            zoomed::<f32>(&[1e-44; 101], Shape::Hann, grid),
        ] {
            assert!(out.iter().all(|value| value.norm().is_finite()));
        }
        // w = 1 in the middle, nearly: 2/Σw = 2/50.5, less the removed mean.
        let out = zoomed::<f64>(&impulse, Shape::Hann, ZoomGrid { low_hz: 3000.0, ..grid });
        assert!((out[0].norm() - 2.0 / 50.5).abs() < 1e-4);
    }

    #[test]
    fn a_grid_outside_the_spectrum_is_none() {
        let none = |low_hz, step_hz, n_lines| {
            let grid = ZoomGrid { low_hz, step_hz, n_lines };
            ZoomPlan::new(100, Shape::Hann, FS_HZ, grid, &mut FftCache::new()).is_none()
        };
        assert!(none(0.0, 1.0, 0) && none(-1.0, 1.0, 5) && none(4999.0, 1.0, 3));
        assert!(none(10.0, 0.0, 3) && none(f64::NAN, 1.0, 3) && none(1.0, f64::INFINITY, 2));
        assert!(!none(4999.0, 1.0, 2) && !none(0.0, 5000.0, 2));
    }
}
