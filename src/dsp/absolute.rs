//! Absolute vibration of a pair of perpendicular sensors.
//!
//! a = √((x − x̄)² + (y − ȳ)²), its own mean removed (D15): a defect that turns with the shaft loads
//! x and y in turn and becomes a plain line in a. The root rectifies: a line at f on one axis appears
//! at 2f, and content reaches twice the input band and beyond. Must not know which sensors form a pair.

use std::fmt;
use std::sync::Arc;

use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::stats;

/// Writes the absolute vibration of `x` and `y` into `out` (D15).
///
/// `x`, `y`, `out`: equally long, one unit and rate, starting at one instant. For lines above fs/8
/// use [`OversampledAbsolutePlan`]: what the root makes above fs/2 folds back here.
///
/// # Panics
///
/// If the lengths differ.
pub fn absolute_vibration<T: Real>(x: &[T], y: &[T], out: &mut [T]) {
    assert_eq!(x.len(), y.len(), "a pair is equally long");
    assert_eq!(x.len(), out.len(), "one value per sample");
    let mean_x = stats::mean(x).unwrap_or(0.0);
    let mean_y = stats::mean(y).unwrap_or(0.0);
    for ((out, x), y) in out.iter_mut().zip(x).zip(y) {
        let (x, y) = (x.to_f64() - mean_x, y.to_f64() - mean_y);
        *out = T::rounded((x * x + y * y).sqrt());
    }
    remove_mean(out);
}

/// Absolute vibration at twice the input rate (D16).
///
/// x + jy is interpolated × 2 by FFT before the root, so what the root makes up to 3/2·fs does not
/// fold into the band below fs/2. The record is treated as periodic: the jump between its ends rings
/// near both, which a Hann-weighted reading hardly sees.
pub struct OversampledAbsolutePlan<T: Real> {
    forward: Arc<dyn Fft<T>>,
    inverse: Arc<dyn Fft<T>>,
    z: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> OversampledAbsolutePlan<T> {
    /// Plans for `n` samples of each axis.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        let forward = cache.complex_forward(n);
        let inverse = cache.complex_inverse(2 * n);
        let n_scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        Self {
            forward,
            inverse,
            z: vec![Complex::zero(); 2 * n],
            scratch: vec![Complex::zero(); n_scratch],
        }
    }

    /// Values per call: 2n, at 2·fs.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.z.len()
    }

    /// Writes the absolute vibration of `x` and `y` at 2·fs into `out`.
    ///
    /// `x`, `y`: n samples, one unit. `out`: 2n values, that unit, mean removed.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], y: &[T], out: &mut [T]) {
        let n = self.forward.len();
        assert!(x.len() == n && y.len() == n, "samples of the plan");
        assert_eq!(out.len(), self.out_len(), "output of the plan");
        let mean_x = stats::mean(x).unwrap_or(0.0);
        let mean_y = stats::mean(y).unwrap_or(0.0);
        for ((z, x), y) in self.z.iter_mut().zip(x).zip(y) {
            let re = T::rounded(x.to_f64() - mean_x);
            *z = Complex::new(re, T::rounded(y.to_f64() - mean_y));
        }
        self.forward.process_with_scratch(&mut self.z[..n], &mut self.scratch);
        self.insert_zeros(n);
        self.inverse.process_with_scratch(&mut self.z, &mut self.scratch);
        let scale = T::rounded(1.0 / n as f64);
        for (out, z) in out.iter_mut().zip(&self.z) {
            *out = z.norm_sqr().square_root() * scale;
        }
        remove_mean(out);
    }

    /// Moves the negative frequencies to the end of the doubled spectrum.
    fn insert_zeros(&mut self, n: usize) {
        let n_positive = n.div_ceil(2);
        self.z.copy_within(n_positive..n, n_positive + n);
        self.z[n_positive..n_positive + n].fill(Complex::zero());
        if n.is_multiple_of(2) {
            // The input's Nyquist bin belongs half to either sign.
            let half = self.z[n_positive + n].scale(T::rounded(0.5));
            self.z[n_positive] = half;
            self.z[n_positive + n] = half;
        }
    }
}

impl<T: Real> fmt::Debug for OversampledAbsolutePlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OversampledAbsolutePlan")
            .field("n", &self.forward.len())
            .finish_non_exhaustive()
    }
}

fn remove_mean<T: Real>(x: &mut [T]) {
    let mean = stats::mean(x).unwrap_or(0.0);
    for value in x {
        *value = T::rounded(value.to_f64() - mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::line::line_at;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    const FS_HZ: f64 = 10_000.0;

    fn absolute<T: Real>(x: &[f64], y: &[f64]) -> Vec<T> {
        let mut out = vec![T::zero(); x.len()];
        absolute_vibration(&narrow::<T>(x), &narrow::<T>(y), &mut out);
        out
    }

    fn oversampled<T: Real>(x: &[f64], y: &[f64]) -> Vec<T> {
        let mut plan = OversampledAbsolutePlan::new(x.len(), &mut FftCache::new());
        let mut out = vec![T::zero(); plan.out_len()];
        plan.process(&narrow::<T>(x), &narrow::<T>(y), &mut out);
        out
    }

    #[test]
    fn a_single_axis_line_doubles_its_frequency_whatever_the_offset() {
        // |A cos θ| = (2A/π)(1 + (2/3)cos 2θ − …): 4A/(3π) at 2f.
        let x: Vec<f64> = sine(10_000, FS_HZ, 68.0, 1.0, 0.0).iter().map(|v| v + 9.8).collect();
        let a = absolute::<f64>(&x, &vec![-3.0; 10_000]);
        let line = line_at(&a, FS_HZ, 136.0).unwrap();
        // The kinks hold harmonics beyond fs/2 that fold to other lines: below 1e-4.
        assert!((line.amplitude - 4.0 / (3.0 * std::f64::consts::PI)).abs() < 1e-3);
        assert!(line_at(&a, FS_HZ, 68.0).unwrap().amplitude < 1e-3);
    }

    #[test]
    fn a_modulated_rotating_load_shows_its_own_line() {
        // A load turning with 40 Hz, amplitude 1 + m cos(2π·272t): x and y hold 232 and 312 Hz, the
        // absolute vibration holds exactly m·cos(2π·272t): the reason for this transform.
        let m = 0.3;
        let turn = |lag: f64| sine(10_000, FS_HZ, 40.0, 1.0, lag);
        let load: Vec<f64> = sine(10_000, FS_HZ, 272.0, m, 0.5).iter().map(|v| 1.0 + v).collect();
        let times = |a: &[f64]| a.iter().zip(&load).map(|(a, b)| a * b).collect::<Vec<_>>();
        let x = times(&turn(0.0));
        let y = times(&turn(std::f64::consts::FRAC_PI_2));
        let a = absolute::<f64>(&x, &y);
        let line = line_at(&a, FS_HZ, 272.0).unwrap();
        // Whole periods: rounding only.
        assert!((line.amplitude - m).abs() < 1e-11 && (line.phase_lag_rad - 0.5).abs() < 1e-10);
        assert!(line_at(&a, FS_HZ, 232.0).unwrap().amplitude < 1e-11);
        assert!(largest_difference(&absolute::<f32>(&x, &y), &a) < 3e-7, "f32 rounding of 1.3");
    }

    #[test]
    fn oversampling_keeps_high_lines_from_folding() {
        // One axis, 0.45·fs: 2f = 0.9·fs folds to 0.1·fs at the plain rate, but stands at its own
        // place at 2·fs.
        let f_hz = 4500.0;
        let x = sine(10_000, FS_HZ, f_hz, 1.0, 0.0);
        let y = vec![0.0; 10_000];
        let expected = 4.0 / (3.0 * std::f64::consts::PI);
        let folded = line_at(&absolute::<f64>(&x, &y), FS_HZ, FS_HZ - 2.0 * f_hz).unwrap();
        assert!(folded.amplitude > 0.9 * expected, "the trap: {folded:?}");
        let doubled = oversampled::<f64>(&x, &y);
        let kept = line_at(&doubled, 2.0 * FS_HZ, 2.0 * f_hz).unwrap();
        // 4f and more fold onto other lines still: a few per cent.
        assert!((kept.amplitude / expected - 1.0).abs() < 0.05, "{kept:?}");
    }

    #[test]
    fn even_samples_of_the_oversampled_equal_the_plain_before_means() {
        // Interpolation passes through the samples; only the two means differ.
        for n in [1, 2, 3, 97, 100] {
            let (x, y) = (gaussian_noise(n, 1), gaussian_noise(n, 2));
            let (plain, fine) = (absolute::<f64>(&x, &y), oversampled::<f64>(&x, &y));
            let shift = plain[0] - fine[0];
            for (i, value) in plain.iter().enumerate() {
                assert!((value - fine[2 * i] - shift).abs() < 1e-13, "n = {n}");
            }
            let single = oversampled::<f32>(&x, &y);
            assert!(largest_difference(&single, &fine) < 3e-6, "f32 FFT of {n}");
        }
    }

    #[test]
    fn no_motion_gives_zero() {
        assert!(absolute::<f64>(&[], &[]).is_empty());
        assert!(absolute::<f32>(&[7.0; 5], &[-1.0; 5]).iter().all(|a| a.abs() <= 0.0));
        assert!(oversampled::<f32>(&[7.0; 6], &[1.0; 6]).iter().all(|a| a.abs() <= 0.0));
    }
}
