//! Continuous wavelet transform with the Morlet wavelet.
//!
//! W(a,b) = (1/a)∫x(t)ψ*((t−b)/a)dt (L1), ψ̂(ω) = 2e^(−(ω−ω₀)²/2) for ω > 0: a unit sine reads
//! |W| = 1 at its own frequency f = ω₀/(2πa) (D13). The transform of one frequency is one decimated
//! inverse of the shared spectrum. Must not know shafts or meshes.

use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;

use rustfft::num_complex::Complex;

use crate::dsp::fft;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::inverse::Results;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;

/// Centre frequency of the wavelet by default, rad: σ_t = 1/f.
pub const DEFAULT_OMEGA0: f64 = TAU;

/// Standard deviations of ψ̂ kept on either side: what is left out is below 1.6e-7 of a line.
pub const SUPPORT_SIGMA: f64 = 5.6;

/// Standard deviations σ_t that a valid coefficient keeps from either end of the record (1 %).
pub const CONE_SIGMA: f64 = 2.25;

/// Which part of the coefficients a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// |W|: what every ratio uses.
    Modulus,
    /// |Re W|: the picture of a real Morlet, zero twice a period of a steady line.
    Real,
}

impl Part {
    /// Writes this part of coefficients.
    pub(in crate::dsp) fn of_results<T: Real>(self, results: &Results<'_, T>, out: &mut [T]) {
        match self {
            Self::Modulus => results.map_to(out, |re, im| (re * re + im * im).square_root()),
            Self::Real => results.map_to(out, |re, _| re.abs()),
        }
    }
}

/// Bins of the spectrum of `n` samples within `sigmas` standard deviations of ψ̂ at `f_hz`; `None`
/// unless 0 < `f_hz` < fs/2, `omega0` > 0 and there is one.
pub(in crate::dsp) fn support(
    n: usize,
    fs_hz: f64,
    f_hz: f64,
    omega0: f64,
    sigmas: f64,
) -> Option<Range<usize>> {
    if !(n > 0 && omega0 > 0.0 && f_hz > 0.0 && f_hz < 0.5 * fs_hz) {
        return None;
    }
    let bin_hz = fs_hz / n as f64;
    let reach_hz = sigmas * f_hz / omega0;
    let first = ceil_index((f_hz - reach_hz) / bin_hz).max(1);
    let end = (floor_index((f_hz + reach_hz) / bin_hz) + 1).min(fft::n_bins(n));
    (first < end).then_some(first..end)
}

/// Half of ψ̂ at bin k: an inverse doubles each bin for the analytic signal (Nyquist excepted).
pub(in crate::dsp) fn gain(n: usize, fs_hz: f64, f_hz: f64, omega0: f64) -> impl Fn(usize) -> f64 {
    let bin_hz = fs_hz / n as f64;
    move |k| {
        let sigmas = omega0 * (k as f64 * bin_hz / f_hz - 1.0);
        (-0.5 * sigmas * sigmas).exp()
    }
}

/// Coefficients at least [`CONE_SIGMA`]·σ_t from both ends of `n` coefficients every `step_s`.
pub(in crate::dsp) fn outside_cone(n: usize, step_s: f64, sigma_t_s: f64) -> Range<usize> {
    let margin = ceil_index(CONE_SIGMA * sigma_t_s / step_s);
    let end = n.saturating_sub(margin.saturating_sub(1)).min(n);
    if margin < end { margin..end } else { 0..0 }
}

/// Morlet transform at one frequency (D13).
pub struct MorletPlan<T: Real> {
    inverse: BandInverse<T>,
    /// Room for a modulus a coefficient.
    w: Vec<T>,
    fs_hz: f64,
    sigma_t_s: f64,
}

impl<T: Real> MorletPlan<T> {
    /// Plans the frequency `f_hz` for records of `n` samples at `fs_hz`.
    ///
    /// `None` unless 0 < `f_hz` < fs/2, `omega0` > 0 and at least one bin lies in the support.
    #[must_use]
    pub fn new(
        n: usize,
        fs_hz: f64,
        f_hz: f64,
        omega0: f64,
        cache: &mut FftCache<T>,
    ) -> Option<Self> {
        Self::with_length(n, fs_hz, f_hz, omega0, cache, fft::cheapest_inverse_len::<T>)
    }

    /// As [`Self::new`], with the output length chosen from the width of the support in bins.
    fn with_length(
        n: usize,
        fs_hz: f64,
        f_hz: f64,
        omega0: f64,
        cache: &mut FftCache<T>,
        length: impl Fn(usize) -> usize,
    ) -> Option<Self> {
        let bins = support(n, fs_hz, f_hz, omega0, SUPPORT_SIGMA)?;
        let length = length(bins.len());
        let gain = gain(n, fs_hz, f_hz, omega0);
        let inverse = BandInverse::new(n, bins, length, cache, gain);
        let sigma_t_s = omega0 / (TAU * f_hz);
        Some(Self { inverse, w: vec![T::zero(); length], fs_hz, sigma_t_s })
    }

    /// Coefficients per call.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.w.len()
    }

    /// Time between two coefficients, s; the first is at the first sample.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        self.inverse.n_samples() as f64 / (self.fs_hz * self.out_len() as f64)
    }

    /// Standard deviation of the wavelet in time, s.
    #[must_use]
    pub fn sigma_t_s(&self) -> f64 {
        self.sigma_t_s
    }

    /// Coefficients at least 2.25 σ_t from both ends of the record; empty if it is too short.
    #[must_use]
    pub fn valid_range(&self) -> Range<usize> {
        outside_cone(self.out_len(), self.step_s(), self.sigma_t_s)
    }

    /// Writes W at the times i·[`step_s`](Self::step_s) into `out`.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), unit u. `out`: u, true phase; the
    /// record is treated as periodic, so see [`Self::valid_range`].
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
        self.inverse.process(x_hat, out);
    }

    /// Computes the mean of |W| over the valid times, u (D14); `None` if there is none.
    ///
    /// # Panics
    ///
    /// If `x_hat` does not have the plan's length.
    pub fn mean_magnitude(&mut self, x_hat: &[Complex<T>]) -> Option<f64> {
        let valid = self.valid_range();
        self.mean_over(x_hat, valid)
    }

    /// Computes the mean of |W| over the whole record, u, for a record that *is* periodic (one
    /// revolution of a synchronous average).
    ///
    /// # Panics
    ///
    /// If `x_hat` does not have the plan's length.
    pub fn mean_magnitude_periodic(&mut self, x_hat: &[Complex<T>]) -> f64 {
        let all = 0..self.out_len();
        self.mean_over(x_hat, all).unwrap_or(0.0)
    }

    fn mean_over(&mut self, x_hat: &[Complex<T>], range: Range<usize>) -> Option<f64> {
        if range.is_empty() {
            return None;
        }
        let n = range.len() as f64;
        Some(self.inverse.results(x_hat).sum_of_moduli(range) / n)
    }
}

impl<T: Real> fmt::Debug for MorletPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MorletPlan")
            .field("inverse", &self.inverse)
            .field("fs_hz", &self.fs_hz)
            .field("sigma_t_s", &self.sigma_t_s)
            .finish_non_exhaustive()
    }
}

/// Morlet picture: rows of frequencies, columns of equal times (D13).
#[derive(Debug)]
pub struct ScalogramPlan<T: Real> {
    rows: Vec<MorletPlan<T>>,
    n_columns: usize,
}

impl<T: Real> ScalogramPlan<T> {
    /// Plans one row per frequency of `f_hz`, each of `n_columns` columns over `n` samples.
    ///
    /// `None` if `n_columns` is 0 or a frequency cannot be planned (see [`MorletPlan::new`]).
    #[must_use]
    pub fn new(
        n: usize,
        fs_hz: f64,
        f_hz: &[f64],
        omega0: f64,
        n_columns: usize,
        cache: &mut FftCache<T>,
    ) -> Option<Self> {
        if n_columns == 0 {
            return None;
        }
        let length = |width: usize| n_columns * width.div_ceil(n_columns);
        let row = |f_hz: &f64| MorletPlan::with_length(n, fs_hz, *f_hz, omega0, cache, length);
        Some(Self { rows: f_hz.iter().map(row).collect::<Option<_>>()?, n_columns })
    }

    /// Values per call: rows × columns.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.rows.len() * self.n_columns
    }

    /// Columns of row `row` that are valid (see [`MorletPlan::valid_range`]).
    #[must_use]
    pub fn valid_columns(&self, row: usize) -> Option<Range<usize>> {
        let plan = self.rows.get(row)?;
        let valid = plan.valid_range();
        let per_column = plan.out_len() / self.n_columns;
        let end = valid.end / per_column;
        Some(valid.start.div_ceil(per_column).min(end)..end)
    }

    /// Writes the picture row by row; a column holds the largest value of its share of the record.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], part: Part, out: &mut [T]) {
        assert_eq!(out.len(), self.out_len(), "rows times columns");
        for (plan, out) in self.rows.iter_mut().zip(out.chunks_mut(self.n_columns)) {
            part.of_results(&plan.inverse.results(x_hat), &mut plan.w);
            let per_column = plan.w.len() / self.n_columns;
            for (value, share) in out.iter_mut().zip(plan.w.chunks(per_column)) {
                let larger = |a: T, b: T| if b > a { b } else { a };
                *value = share.iter().copied().fold(T::zero(), larger);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rustfft::num_traits::Zero;

    use super::*;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    const FS_HZ: f64 = 10_000.0;

    fn spectrum<T: Real>(x: &[f64], cache: &mut FftCache<T>) -> Vec<Complex<T>> {
        let mut forward = ForwardPlan::new(x.len(), cache);
        let mut x_hat = vec![Complex::zero(); forward.n_bins()];
        forward.process(&narrow::<T>(x), &mut x_hat);
        x_hat
    }

    fn coefficients<T: Real>(x: &[f64], f_hz: f64) -> (Vec<Complex<T>>, MorletPlan<T>) {
        let mut cache = FftCache::new();
        let x_hat = spectrum(x, &mut cache);
        let mut plan = MorletPlan::new(x.len(), FS_HZ, f_hz, DEFAULT_OMEGA0, &mut cache).unwrap();
        let mut w = vec![Complex::zero(); plan.out_len()];
        plan.process(&x_hat, &mut w);
        (w, plan)
    }

    /// W(a, b) in the time domain: ψ(t) = (2/√2π)e^(−t²/2)e^(jω₀t), summed over the samples.
    fn slow_coefficient(x: &[f64], f_hz: f64, b_s: f64) -> Complex<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let a_s = DEFAULT_OMEGA0 / (TAU * f_hz);
        let norm = 2.0 / TAU.sqrt() / a_s / FS_HZ;
        let term = |(i, value): (usize, &f64)| {
            let t = (i as f64 / FS_HZ - b_s) / a_s;
            let weight = norm * (value - mean) * (-0.5 * t * t).exp();
            Complex::from_polar(weight, -DEFAULT_OMEGA0 * t)
        };
        x.iter().enumerate().map(term).sum()
    }

    #[test]
    fn a_unit_sine_reads_one_at_its_frequency() {
        for f_hz in [10.0, 29.7, 161.3, 683.1, 2000.0, 3200.0, 4400.0] {
            let x = sine(10_000, FS_HZ, f_hz, 1.0, 0.4);
            let (_, mut plan) = coefficients::<f64>(&x, f_hz);
            let mut cache = FftCache::new();
            let mean = plan.mean_magnitude(&spectrum(&x, &mut cache)).unwrap();
            // The ends of the record jump; 2.25 σ_t keeps single values within 1 %, the mean of
            // 10 periods and more within 2e-3, of 100 and more within 1e-4 ...
            let tolerance = if f_hz < 100.0 { 2e-3 } else { 1e-4 };
            assert!((mean - 1.0).abs() < tolerance, "{f_hz} Hz: {mean}");
            // ... and in the middle of 3200 Hz nothing of them is left: 3e-7 of truncation.
            let (w, plan) = coefficients::<f64>(&x, f_hz);
            if f_hz > 29.0 {
                let middle = w[plan.out_len() / 2].norm();
                assert!((middle - 1.0).abs() < 1e-6, "{f_hz} Hz: {middle}");
            }
        }
    }

    #[test]
    fn matches_the_time_domain_integral() {
        let x = gaussian_noise(2000, 8);
        for f_hz in [40.0, 161.3, 683.1] {
            let (w, plan) = coefficients::<f64>(&x, f_hz);
            let (narrow, _) = coefficients::<f32>(&x, f_hz);
            let interior = 6.0 * plan.sigma_t_s();
            let mut n_compared = 0;
            for (i, w) in w.iter().enumerate() {
                let b_s = i as f64 * plan.step_s();
                if b_s > interior && b_s < 0.2 - interior {
                    let slow = slow_coefficient(&x, f_hz, b_s);
                    // 5.3 σ of support against an integral that keeps all: 3e-7 of the spectrum's
                    // size; 2 more digits of f32 rounding over 2000 samples.
                    assert!((w - slow).norm() < 1e-6, "{f_hz} Hz at {b_s} s");
                    let single = Complex::new(f64::from(narrow[i].re), f64::from(narrow[i].im));
                    assert!((single - slow).norm() < 2e-6, "{f_hz} Hz at {b_s} s");
                    n_compared += 1;
                }
            }
            assert!(f_hz < 100.0 || n_compared > 10);
        }
    }

    #[test]
    fn a_record_shorter_than_the_cone_has_no_mean() {
        // 10 Hz: 2.25 σ_t = 0.225 s at either end of 0.4 s.
        let x = sine(4000, FS_HZ, 10.0, 1.0, 0.0);
        let (_, mut plan) = coefficients::<f32>(&x, 10.0);
        assert!(plan.valid_range().is_empty());
        assert_eq!(plan.mean_magnitude(&spectrum(&x, &mut FftCache::new())), None);
    }

    #[test]
    fn impossible_frequencies_are_not_planned() {
        let mut cache = FftCache::<f64>::new();
        for f_hz in [0.0, -1.0, 5000.0, 9000.0, f64::NAN] {
            assert!(MorletPlan::new(1000, FS_HZ, f_hz, DEFAULT_OMEGA0, &mut cache).is_none());
        }
        assert!(MorletPlan::new(0, FS_HZ, 10.0, DEFAULT_OMEGA0, &mut cache).is_none());
        assert!(MorletPlan::new(1, FS_HZ, 10.0, DEFAULT_OMEGA0, &mut cache).is_none());
    }

    #[test]
    fn a_periodic_record_needs_no_cone() {
        // One revolution of 360 points: order 28 exactly periodic, so exact everywhere.
        let x = sine(360, 360.0, 28.0, 0.5, 1.0);
        let mut cache = FftCache::<f64>::new();
        let x_hat = spectrum(&x, &mut cache);
        let mut plan = MorletPlan::new(360, 360.0, 28.0, DEFAULT_OMEGA0, &mut cache).unwrap();
        assert!((plan.mean_magnitude_periodic(&x_hat) - 0.5).abs() < 1e-13);
    }

    #[test]
    fn the_real_part_of_a_line_vanishes_twice_a_period() {
        let x = sine(8000, 1000.0, 10.0, 1.0, 0.0);
        let mut cache = FftCache::<f64>::new();
        let x_hat = spectrum(&x, &mut cache);
        let mut plan =
            ScalogramPlan::new(8000, 1000.0, &[10.0, 40.0], DEFAULT_OMEGA0, 800, &mut cache)
                .unwrap();
        let (mut modulus, mut real) = (vec![0.0_f64; 1600], vec![0.0_f64; 1600]);
        plan.process(&x_hat, Part::Modulus, &mut modulus);
        plan.process(&x_hat, Part::Real, &mut real);
        // 10 columns a period, cos(2πi/10): zeros fall between columns, values are |cos|.
        let valid = plan.valid_columns(0).unwrap();
        for i in valid {
            let expected = (TAU * i as f64 / 10.0).cos().abs();
            assert!((modulus[i] - 1.0).abs() < 1e-2 && (real[i] - expected).abs() < 1e-2);
        }
        assert!(modulus[800..].iter().all(|w| *w < 1e-2), "40 Hz holds nothing");
        assert_eq!(plan.valid_columns(2), None);
    }
}
