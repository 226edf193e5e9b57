//! Amplitude and phase of a line at a known frequency.
//!
//! A bin height is up to 15 % low; this reads at the exact frequency by a Hann-weighted least-squares
//! fit of a·cos + b·sin + constant (D9, D10), so one stationary sine and a constant are read without
//! any error of their own, however few periods the record holds. Must not know what the line is.

use std::f64::consts::TAU;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::real::Real;
use crate::dsp::stats;

/// Periods a record must hold, and bins a line must stay below Nyquist, to be read at all.
pub const MIN_PERIODS: f64 = 3.0;

/// Samples rotated with one table.
const BLOCK: usize = 256;

/// Lines fitted in one pass over the samples: their tables stay in the first-level cache. A multiple of 4.
const BATCH: usize = 12;

/// Blocks after which sums go on in f64 and phases begin anew, so that neither drifts.
const FLUSH: usize = 16;

/// A spectral line A·cos(2πft − φ), t = 0 at the first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Zero-to-peak amplitude A, unit of the samples.
    pub amplitude: f64,
    /// Lag φ, rad, −π…π.
    pub phase_lag_rad: f64,
}

/// Reads the line at exactly `f_hz` from the samples `x` at `fs_hz` (D9, D10).
///
/// `None` if fewer than [`MIN_PERIODS`] periods fit into the record or `f_hz` is not below Nyquist
/// by that many bins. Error for one sine and a constant: below 1e-9 of their sizes in f64, below
/// 1e-6 in f32; another line d bins away enters as in any Hann spectrum (at worst −38 dB for d = 3,
/// −70 dB for d = 10).
#[must_use]
pub fn line_at<T: Real>(x: &[T], fs_hz: f64, f_hz: f64) -> Option<Line> {
    let mut lines = [None];
    lines_at(x, fs_hz, &[f_hz], &mut lines);
    lines[0]
}

/// Reads several lines in few passes over the samples; each as [`line_at`] does, on its own.
///
/// # Panics
///
/// If `lines` and `f_hz` differ in length.
pub fn lines_at<T: Real>(x: &[T], fs_hz: f64, f_hz: &[f64], lines: &mut [Option<Line>]) {
    assert_eq!(lines.len(), f_hz.len(), "one place per frequency");
    let mean = stats::mean(x).unwrap_or(0.0);
    for (f_hz, lines) in f_hz.chunks(BATCH).zip(lines.chunks_mut(BATCH)) {
        let mut cycles = [0.0; BATCH];
        for (cycles, f_hz) in cycles.iter_mut().zip(f_hz) {
            *cycles = f_hz / fs_hz;
        }
        let cycles = &cycles[..f_hz.len()];
        if cycles.iter().any(|cycles| is_readable(*cycles, x.len())) {
            read_batch(x, mean, cycles, lines);
        } else {
            lines.fill(None);
        }
    }
}

fn is_readable(cycles_per_sample: f64, n: usize) -> bool {
    let bin = cycles_per_sample * n as f64;
    // Written so that a NaN is not readable.
    bin >= MIN_PERIODS && bin <= 0.5 * n as f64 - MIN_PERIODS
}

fn read_batch<T: Real>(x: &[T], mean: f64, cycles: &[f64], lines: &mut [Option<Line>]) {
    let n = x.len();
    let mut read = Sums { constant: 0.0, lines: [Complex::zero(); BATCH] };
    Arch::new().dispatch(Read { x, mean, cycles, sums: &mut read });
    for ((line, cycles), sum) in lines.iter_mut().zip(cycles).zip(&read.lines) {
        let solved = || solve(*sum, read.constant, *cycles, n);
        *line = is_readable(*cycles, n).then(solved).flatten();
    }
}

/// Sums of D9: of the weighted samples, and with the phasor of each line.
struct Sums {
    constant: f64,
    lines: [Complex<f64>; BATCH],
}

struct Read<'a, T> {
    x: &'a [T],
    mean: f64,
    cycles: &'a [f64],
    sums: &'a mut Sums,
}

/// Cosines and negative sines of one block.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Table<T> {
    re: [T; BLOCK],
    im: [T; BLOCK],
}

/// Numbers in the widest vector.
const LANES: usize = 16;

/// Sums in T of some blocks, lanes side by side.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Partial<T> {
    re: [T; LANES],
    im: [T; LANES],
}

impl<T: Real> WithSimd for Read<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { x, mean, cycles, sums } = self;
        let n = x.len();
        let zero = T::zero();
        let mut tables = [Table { re: [zero; BLOCK], im: [zero; BLOCK] }; BATCH];
        for (table, cycles) in tables.iter_mut().zip(cycles) {
            fill_rotation(*cycles, table);
        }
        let mut window = Table { re: [zero; BLOCK], im: [zero; BLOCK] };
        fill_rotation(1.0 / n as f64, &mut window);
        let high = T::rounded(mean);
        let low = T::rounded(mean - high.to_f64());
        // The last place is that of the window.
        let mut turns = [Turn::default(); BATCH + 1];
        for (turn, cycles) in turns.iter_mut().zip(cycles) {
            *turn = Turn::new(*cycles);
        }
        turns[BATCH] = Turn::new(1.0 / n as f64);
        let mut partials = [Partial { re: [zero; LANES], im: [zero; LANES] }; BATCH];
        let mut weighted = Table { re: [zero; BLOCK], im: [zero; BLOCK] };
        for (index, block) in x.chunks(BLOCK).enumerate() {
            for turn in &mut turns {
                turn.go_to(index);
            }
            let seed = turns[BATCH].at;
            let (seed_re, seed_im) = (T::rounded(0.5 * seed.re), T::rounded(0.5 * seed.im));
            let half = T::rounded(0.5);
            let weigh = &mut weighted.re[..block.len()];
            let (w_re, w_im) = (&window.re[..block.len()], &window.im[..block.len()]);
            for i in 0..block.len() {
                let half_cosine = seed_re * w_re[i] - seed_im * w_im[i];
                weigh[i] = (half - half_cosine) * (block[i] - high - low);
            }
            weighted.re[block.len()..].fill(zero);
            sums.constant += sum_of(&weighted.re);
            let lists = tables.chunks_exact(4).zip(partials.chunks_exact_mut(4));
            let lists = lists.zip(turns.chunks_exact(4)).take(cycles.len().div_ceil(4));
            for ((tables, partials), turns) in lists {
                four_lines(simd, &weighted.re, tables, turns, partials);
            }
            if index % FLUSH == FLUSH - 1 {
                flush(&mut partials, &mut sums.lines);
            }
        }
        flush(&mut partials, &mut sums.lines);
    }
}

/// Moves sums in T to those in f64.
#[inline(always)]
fn flush<T: Real>(partials: &mut [Partial<T>; BATCH], sums: &mut [Complex<f64>; BATCH]) {
    for (partial, sum) in partials.iter_mut().zip(sums) {
        for (re, im) in partial.re.iter().zip(&partial.im) {
            *sum += Complex::new(re.to_f64(), im.to_f64());
        }
        *partial = Partial { re: [T::zero(); LANES], im: [T::zero(); LANES] };
    }
}

#[inline(always)]
fn sum_of<T: Real>(values: &[T; BLOCK]) -> f64 {
    let mut lanes = [T::zero(); LANES];
    let (chunks, _) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            lanes[i] += chunk[i];
        }
    }
    let mut sum = 0.0;
    for lane in lanes {
        sum += lane.to_f64();
    }
    sum
}

/// Adds a block's phasor sums of four lines, each turned to the block's place. Eight sums side by
/// side keep both multipliers busy.
#[inline(always)]
fn four_lines<T: Real, S: Simd>(
    simd: S,
    weighted: &[T; BLOCK],
    tables: &[Table<T>],
    turns: &[Turn],
    partials: &mut [Partial<T>],
) {
    let [a, b, c, d] = [&tables[0], &tables[1], &tables[2], &tables[3]];
    let zero = T::splat(simd, T::zero());
    let (mut a_re, mut a_im, mut b_re, mut b_im) = (zero, zero, zero, zero);
    let (mut c_re, mut c_im, mut d_re, mut d_im) = (zero, zero, zero, zero);
    let values = T::vectors::<S>(weighted);
    let n = values.len();
    let (at_re, at_im) = (&T::vectors::<S>(&a.re)[..n], &T::vectors::<S>(&a.im)[..n]);
    let (bt_re, bt_im) = (&T::vectors::<S>(&b.re)[..n], &T::vectors::<S>(&b.im)[..n]);
    let (ct_re, ct_im) = (&T::vectors::<S>(&c.re)[..n], &T::vectors::<S>(&c.im)[..n]);
    let (dt_re, dt_im) = (&T::vectors::<S>(&d.re)[..n], &T::vectors::<S>(&d.im)[..n]);
    for i in 0..n {
        let x = values[i];
        a_re = T::times_plus(simd, x, at_re[i], a_re);
        a_im = T::times_plus(simd, x, at_im[i], a_im);
        b_re = T::times_plus(simd, x, bt_re[i], b_re);
        b_im = T::times_plus(simd, x, bt_im[i], b_im);
        c_re = T::times_plus(simd, x, ct_re[i], c_re);
        c_im = T::times_plus(simd, x, ct_im[i], c_im);
        d_re = T::times_plus(simd, x, dt_re[i], d_re);
        d_im = T::times_plus(simd, x, dt_im[i], d_im);
    }
    add_turned(simd, [a_re, a_im], &turns[0], &mut partials[0]);
    add_turned(simd, [b_re, b_im], &turns[1], &mut partials[1]);
    add_turned(simd, [c_re, c_im], &turns[2], &mut partials[2]);
    add_turned(simd, [d_re, d_im], &turns[3], &mut partials[3]);
}

#[inline(always)]
fn add_turned<T: Real, S: Simd>(
    simd: S,
    [re, im]: [T::Vector<S>; 2],
    turn: &Turn,
    to: &mut Partial<T>,
) {
    let cos = T::splat(simd, T::rounded(turn.at.re));
    let sin = T::splat(simd, T::rounded(turn.at.im));
    let to_re = &mut T::vectors_mut::<S>(&mut to.re)[0];
    *to_re = T::less_times(simd, T::times_plus(simd, re, cos, *to_re), im, sin);
    let to_im = &mut T::vectors_mut::<S>(&mut to.im)[0];
    *to_im = T::times_plus(simd, im, cos, T::times_plus(simd, re, sin, *to_im));
}

/// Rotation at the beginning of a block: exact every so many blocks, turned on by a step in between.
#[derive(Debug, Clone, Copy, Default)]
struct Turn {
    cycles: f64,
    step: Complex<f64>,
    at: Complex<f64>,
}

impl Turn {
    fn new(cycles: f64) -> Self {
        let step = rotation(cycles * BLOCK as f64);
        Self { cycles, step, at: Complex::new(1.0, 0.0) }
    }

    /// To the next block.
    #[inline(always)]
    fn go_to(&mut self, index: usize) {
        self.at = if index.is_multiple_of(FLUSH) {
            rotation(self.cycles * (index * BLOCK) as f64)
        } else {
            self.at * self.step
        };
    }
}

/// Solves the weighted normal equations for the complex amplitude A·e^(−jφ) (D10).
fn solve(sum: Complex<f64>, constant: f64, cycles: f64, n: usize) -> Option<Line> {
    let (s0, s1, s2) = (hann_sum(0.0, n).re, hann_sum(cycles, n), hann_sum(2.0 * cycles, n));
    let q = sum - s1 * (constant / s0);
    let alpha = 0.5 * (s0 - s1.norm_sqr() / s0);
    let beta = (s2 - s1 * s1 / s0) * 0.5;
    let determinant = alpha * alpha - beta.norm_sqr();
    if determinant <= 0.0 {
        return None;
    }
    let phasor = (q * alpha - beta * q.conj()) / determinant;
    Some(Line { amplitude: phasor.norm(), phase_lag_rad: -phasor.arg() })
}

/// Σ w[i] e^(−j2πci) of the Hann window of n samples, by Dirichlet kernels (D9).
fn hann_sum(cycles: f64, n: usize) -> Complex<f64> {
    let step = 1.0 / n as f64;
    dirichlet(cycles, n) * 0.5 - (dirichlet(cycles - step, n) + dirichlet(cycles + step, n)) * 0.25
}

/// Σ e^(−j2πci), i = 0…n−1.
fn dirichlet(cycles: f64, n: usize) -> Complex<f64> {
    let cycles = cycles - cycles.round();
    let n = n as f64;
    let denominator = (0.5 * TAU * cycles).sin();
    let magnitude = if (cycles * n).abs() < 1e-9 {
        n
    } else {
        (0.5 * TAU * (cycles * n).rem_euclid(2.0)).sin() / denominator
    };
    rotation(0.5 * cycles * (n - 1.0)) * magnitude
}

/// e^(−j2πc), exact phase for large c.
fn rotation(cycles: f64) -> Complex<f64> {
    let (sin, cos) = (TAU * cycles.fract()).sin_cos();
    Complex::new(cos, -sin)
}

/// Fills e^(−j2πci), doubling what is filled: eight products in f64 at most.
#[inline(always)]
fn fill_rotation<T: Real>(cycles: f64, table: &mut Table<T>) {
    let (mut re, mut im) = ([0.0; BLOCK], [0.0; BLOCK]);
    re[0] = 1.0;
    let mut filled = 1;
    while filled < BLOCK {
        let step = rotation(cycles * filled as f64);
        let (from_re, to_re) = re.split_at_mut(filled);
        let (from_im, to_im) = im.split_at_mut(filled);
        let (to_re, to_im) = (&mut to_re[..filled], &mut to_im[..filled]);
        for i in 0..filled {
            to_re[i] = from_re[i] * step.re - from_im[i] * step.im;
            to_im[i] = from_re[i] * step.im + from_im[i] * step.re;
        }
        filled *= 2;
    }
    for i in 0..BLOCK {
        (table.re[i], table.im[i]) = (T::rounded(re[i]), T::rounded(im[i]));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const FS_HZ: f64 = 12_000.0;

    #[test]
    fn any_sine_reads_exactly_between_bins() {
        for f_hz in [29.7, 68.123, 683.1, 2049.4, 5900.0] {
            let x: Vec<f64> = sine(9001, FS_HZ, f_hz, 0.7, 2.0).iter().map(|v| v + 50.0).collect();
            let line = line_at(&x, FS_HZ, f_hz).unwrap();
            // Offset 50 rounds samples to 7e-15; phases of 1e4 samples to 1e-12.
            assert!((line.amplitude - 0.7).abs() < 1e-11, "{f_hz}: {line:?}");
            assert!((line.phase_lag_rad - 2.0).abs() < 1e-10, "{f_hz}: {line:?}");
            // f32 with 70 times its size in offset: samples are rounded by 50·6e-8/√12 each, and
            // the average over 9001 of them leaves far less than 1e-6.
            let line = line_at(&narrow::<f32>(&x), FS_HZ, f_hz).unwrap();
            assert!((line.amplitude - 0.7).abs() < 1e-6, "{f_hz}: {line:?}");
        }
    }

    #[test]
    fn long_records_do_not_drift() {
        let n = 2_000_000;
        let line = line_at(&sine(n, FS_HZ, 683.1, 1.0, -1.0), FS_HZ, 683.1).unwrap();
        // Phases of 1e5 cycles are exact to 1e-11 in both generator and table.
        assert!((line.amplitude - 1.0).abs() < 1e-9 && (line.phase_lag_rad + 1.0).abs() < 1e-8);
    }

    #[test]
    fn what_cannot_be_read_is_none() {
        let x = sine(1200, FS_HZ, 100.0, 1.0, 0.0);
        for f_hz in [0.0, -100.0, 29.9, 5970.1, 6000.0, 7000.0, f64::NAN] {
            assert_eq!(line_at(&x, FS_HZ, f_hz), None, "{f_hz}");
        }
        assert!(line_at(&x, FS_HZ, 30.0).is_some() && line_at(&x, FS_HZ, 5970.0).is_some());
        assert_eq!(line_at::<f64>(&[], FS_HZ, 100.0), None);
        assert_eq!(line_at(&[1.0], FS_HZ, 100.0), None);
        for x in [[0.0; 500], [1e6; 500]] {
            assert!(line_at(&x, FS_HZ, 1000.0).unwrap().amplitude.abs() <= 0.0);
        }
    }

    #[test]
    fn lines_in_one_pass_equal_lines_one_by_one() {
        let x = gaussian_noise(5003, 2);
        let f_hz = [10.0, 33.3, 68.0, 280.0, 1e9, 555.5, 5000.0];
        let mut lines = [None; 7];
        lines_at(&x, FS_HZ, &f_hz, &mut lines);
        for (line, f_hz) in lines.iter().zip(f_hz) {
            assert_eq!(*line, line_at(&x, FS_HZ, f_hz));
        }
    }

    #[test]
    fn a_neighbour_enters_as_hann_leakage_only() {
        let x = sum(&[sine(12_000, FS_HZ, 68.0, 1.0, 0.0), sine(12_000, FS_HZ, 280.5, 100.0, 0.0)]);
        let line = line_at(&x, FS_HZ, 68.0).unwrap();
        // 212.5 bins off: 1/(π·d³) = 3.3e-8 of 100.
        assert!((line.amplitude - 1.0).abs() < 1e-5, "{line:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn few_periods_are_enough(
            n in 16_usize..2000, place in 0.0..1.0_f64, lag in -3.0..3.0_f64, dc in -10.0..10.0_f64,
        ) {
            let (lowest, highest) = (MIN_PERIODS, n as f64 / 2.0 - MIN_PERIODS);
            let f_hz = (lowest + place * (highest - lowest)) / n as f64 * FS_HZ * (1.0 - 1e-12);
            let x: Vec<f64> = sine(n, FS_HZ, f_hz, 1.0, lag).iter().map(|v| v + dc).collect();
            if let Some(line) = line_at(&x, FS_HZ, f_hz) {
                // The fit models the sine and the constant fully: only rounding is left.
                prop_assert!((line.amplitude - 1.0).abs() < 1e-10);
                prop_assert!((line.phase_lag_rad - lag).abs() < 1e-10);
            }
        }
    }
}
