//! Amplitude and phase of a line at a known frequency.
//!
//! A bin height is up to 15 % low; this reads at the exact frequency by a Hann-weighted least-squares
//! fit of a·cos + b·sin + constant (D9, D10), so one stationary sine and a constant are read without
//! any error of their own, however few periods the record holds. Must not know what the line is.

use std::f64::consts::TAU;

mod phasors;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::real::Real;
use crate::dsp::stats;
use phasors::Hann;
use phasors::Partial;
use phasors::Phasors;
use phasors::Table;
use phasors::Turn;
use phasors::rotation;

/// Periods a record must hold, and bins a line must stay below Nyquist, to be read at all.
pub const MIN_PERIODS: f64 = 3.0;

/// Lines that [`lines_at`] fits in one pass over the samples: as many tables as the first-level cache
/// holds beside the samples. A multiple of [`phasors::TOGETHER`].
const BATCH: usize = 12;

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
    let mut tables = [Table::EMPTY; BATCH];
    let mut turns = [Turn::default(); BATCH];
    for ((table, turn), cycles) in tables.iter_mut().zip(&mut turns).zip(cycles) {
        table.fill(*cycles);
        *turn = Turn::new(*cycles);
    }
    let mut hann = Hann::new(n);
    let mut partials = [Partial::EMPTY; BATCH];
    let mut sums = [Complex::zero(); BATCH];
    let n_used = cycles.len().next_multiple_of(phasors::TOGETHER);
    let phasors = Phasors {
        tables: &tables[..n_used],
        turns: &mut turns[..n_used],
        partials: &mut partials[..n_used],
        sums: &mut sums[..n_used],
    };
    let constant = phasors.read(x, mean, &mut hann);
    for ((line, cycles), sum) in lines.iter_mut().zip(cycles).zip(&sums) {
        let fit = is_readable(*cycles, n).then(|| Fit::new(*cycles, n)).flatten();
        *line = fit.map(|fit| fit.line(*sum, constant));
    }
}

/// Reads the same lines from record after record of one length.
///
/// Tables and normal equations are made once; a record costs its products alone.
#[derive(Debug)]
pub struct LinesPlan<T: Real> {
    n: usize,
    tables: Vec<Table<T>>,
    turns: Vec<Turn>,
    partials: Vec<Partial<T>>,
    sums: Vec<Complex<f64>>,
    fits: Vec<Option<Fit>>,
    hann: Hann<T>,
}

impl<T: Real> LinesPlan<T> {
    /// Plans the lines at exactly `f_hz` in records of `n` samples at `fs_hz`.
    #[must_use]
    pub fn new(n: usize, fs_hz: f64, f_hz: &[f64]) -> Self {
        let n_lists = f_hz.len().next_multiple_of(phasors::TOGETHER);
        let mut tables = vec![Table::EMPTY; n_lists];
        let mut turns = vec![Turn::default(); n_lists];
        for ((table, turn), f_hz) in tables.iter_mut().zip(&mut turns).zip(f_hz) {
            table.fill(f_hz / fs_hz);
            *turn = Turn::new(f_hz / fs_hz);
        }
        let fit = |f_hz: &f64| {
            let cycles = f_hz / fs_hz;
            is_readable(cycles, n).then(|| Fit::new(cycles, n)).flatten()
        };
        Self {
            n,
            tables,
            turns,
            partials: vec![Partial::EMPTY; n_lists],
            sums: vec![Complex::zero(); n_lists],
            fits: f_hz.iter().map(fit).collect(),
            hann: Hann::new(n),
        }
    }

    /// Lines read per call.
    #[must_use]
    pub fn n_lines(&self) -> usize {
        self.fits.len()
    }

    /// Reads the lines from `x`, each as [`line_at`] does.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], lines: &mut [Option<Line>]) {
        assert_eq!(x.len(), self.n, "samples of the plan");
        assert_eq!(lines.len(), self.fits.len(), "one place per line");
        let mean = stats::mean(x).unwrap_or(0.0);
        self.sums.fill(Complex::zero());
        let Self { tables, turns, partials, sums, .. } = self;
        let constant = Phasors { tables, turns, partials, sums }.read(x, mean, &mut self.hann);
        for ((line, fit), sum) in lines.iter_mut().zip(&self.fits).zip(&self.sums) {
            *line = fit.as_ref().map(|fit| fit.line(*sum, constant));
        }
    }
}

/// Normal equations of a line (D10), all but the sums of the samples.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// S₁/S₀.
    s1: Complex<f64>,
    /// α and β over the determinant.
    alpha: f64,
    beta: Complex<f64>,
}

impl Fit {
    fn new(cycles: f64, n: usize) -> Option<Self> {
        let (s0, s1) = (hann_sum(0.0, n).re, hann_sum(cycles, n));
        let s2 = hann_sum(2.0 * cycles, n);
        let alpha = 0.5 * (s0 - s1.norm_sqr() / s0);
        let beta = (s2 - s1 * s1 / s0) * 0.5;
        let determinant = alpha * alpha - beta.norm_sqr();
        (determinant > 0.0).then(|| Self {
            s1: s1 / s0,
            alpha: alpha / determinant,
            beta: beta / determinant,
        })
    }

    /// The line from P and C of D9.
    fn line(&self, sum: Complex<f64>, constant: f64) -> Line {
        let q = sum - self.s1 * constant;
        let phasor = q * self.alpha - self.beta * q.conj();
        Line { amplitude: phasor.norm(), phase_lag_rad: -phasor.arg() }
    }
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
    fn a_plan_reads_what_single_calls_read() {
        let f_hz = [10.0, 33.3, 68.0, 280.0, 1e9, 555.5, 5000.0];
        let mut plan = LinesPlan::<f32>::new(5003, FS_HZ, &f_hz);
        assert_eq!(plan.n_lines(), 7);
        // The second record shows that nothing of the first is left.
        for seed in [2, 3] {
            let x = narrow::<f32>(&gaussian_noise(5003, seed));
            let mut lines = [None; 7];
            plan.process(&x, &mut lines);
            for (line, f_hz) in lines.iter().zip(f_hz) {
                assert_eq!(*line, line_at(&x, FS_HZ, f_hz));
            }
        }
        LinesPlan::<f64>::new(0, FS_HZ, &[]).process(&[], &mut []);
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
