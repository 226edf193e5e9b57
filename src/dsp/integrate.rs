//! Velocity RMS of a band, whatever the sensor measures.
//!
//! Severity standards rate the RMS velocity in 10–1000 Hz. Integration is a division by 2πf in the
//! frequency domain, inside the band only, so neither offset nor drift enters. Must not know limits.

use std::f64::consts::TAU;

use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::spectrum::HannTransform;

/// What the samples are; decides the power of 2πf and the factor to mm/s.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Acceleration, m/s².
    Acceleration,
    /// Velocity, mm/s.
    Velocity,
    /// Displacement, µm.
    Displacement,
}

/// The general band of ISO 20816-1, Hz.
pub const GENERAL_BAND_HZ: (f64, f64) = (10.0, 1000.0);

/// Bins a record must have below the lower edge: fewer, and the window's lobe straddles the edge.
const MIN_BINS_BELOW: f64 = 4.0;

/// A velocity RMS and the band it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityRms {
    /// RMS, mm/s.
    pub mm_per_s: f64,
    /// Upper edge actually reached, Hz: the asked one or Nyquist.
    pub high_hz: f64,
}

/// Band-limited velocity RMS by integration in the frequency domain (D18).
#[derive(Debug)]
pub struct VelocityPlan<T: Real> {
    transform: HannTransform<T>,
}

impl<T: Real> VelocityPlan<T> {
    /// Plans for `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        Self { transform: HannTransform::new(n, n, cache) }
    }

    /// Computes the RMS velocity of `x` in `low_hz`…`high_hz` (both edges included).
    ///
    /// `x`: n samples at `fs_hz` in the unit of `quantity`. `None` if the band is empty, the record
    /// holds fewer than 4 periods of the lower edge, or Nyquist lies below it.
    ///
    /// Error for a stationary sine at f, bins Δ = fs/n apart: (Δ/f)²/2 relative inside the band;
    /// within 2Δ of an edge its Hann lobe is cut: at the edge itself about 9 % are missing, 2Δ outside
    /// nothing is left. An offset does not enter; a sine d bins below the band leaks in with about
    /// its amplitude/(π·d³).
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn process(
        &mut self,
        x: &[T],
        fs_hz: f64,
        quantity: Quantity,
        (low_hz, high_hz): (f64, f64),
    ) -> Option<VelocityRms> {
        let n = self.transform.n_samples();
        let bin_hz = fs_hz / n as f64;
        let reached_hz = high_hz.min(0.5 * fs_hz);
        let holds_band = low_hz >= MIN_BINS_BELOW * bin_hz && low_hz < reached_hz;
        if !holds_band {
            return None;
        }
        let scale = 1.0 / (n as f64 * self.transform.window.sum_of_squares);
        let n_padded = self.transform.n_padded();
        let (x_hat, _) = self.transform.process(x);
        let mut power = 0.0;
        for (k, value) in x_hat.iter().enumerate().skip(1) {
            let f_hz = k as f64 * bin_hz;
            if f_hz < low_hz * (1.0 - 1e-12) || f_hz > reached_hz * (1.0 + 1e-12) {
                continue;
            }
            let sides = if 2 * k == n_padded { 1.0 } else { 2.0 };
            let gain = quantity.mm_per_s(f_hz);
            power += sides * gain * gain * value.norm_sqr().to_f64();
        }
        Some(VelocityRms { mm_per_s: (power * scale).sqrt(), high_hz: reached_hz })
    }
}

impl Quantity {
    /// Velocity amplitude in mm/s of a unit amplitude of this quantity at `f_hz`.
    fn mm_per_s(self, f_hz: f64) -> f64 {
        match self {
            Self::Acceleration => 1e3 / (TAU * f_hz),
            Self::Velocity => 1.0,
            Self::Displacement => 1e-3 * TAU * f_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const FS_HZ: f64 = 10_000.0;

    fn velocity<T: Real>(x: &[f64], quantity: Quantity) -> Option<f64> {
        let mut plan = VelocityPlan::<T>::new(x.len(), &mut FftCache::new());
        let rms = plan.process(&narrow(x), FS_HZ, quantity, GENERAL_BAND_HZ)?;
        Some(rms.mm_per_s)
    }

    #[test]
    fn a_sine_reads_the_same_from_all_three_quantities() {
        // 10 mm/s amplitude at 80 Hz: 10/√2 mm/s RMS; 5.027 m/s²; 19.89 µm.
        let omega = TAU * 80.0;
        let amplitudes = [
            (Quantity::Acceleration, 10e-3 * omega),
            (Quantity::Velocity, 10.0),
            (Quantity::Displacement, 10e3 / omega),
        ];
        for (quantity, amplitude) in amplitudes {
            let x = sine(10_000, FS_HZ, 80.0, amplitude, 0.2);
            let rms = velocity::<f64>(&x, quantity).unwrap();
            // (Δ/f)²/2 with Δ = 1 Hz: 8e-5.
            assert!((rms / (10.0 / 2f64.sqrt()) - 1.0).abs() < 1e-4, "{quantity:?}: {rms}");
            let single = velocity::<f32>(&x, quantity).unwrap();
            assert!((single / rms - 1.0).abs() < 1e-6, "f32 rounding of samples and FFT");
        }
    }

    #[test]
    fn offset_and_slow_motion_stay_outside() {
        let x = sum(&[
            sine(20_000, FS_HZ, 80.0, 1.0, 0.0),
            sine(20_000, FS_HZ, 1.3, 50.0, 0.0),
            vec![1e3; 20_000],
        ]);
        let clean = velocity::<f64>(&sine(20_000, FS_HZ, 80.0, 1.0, 0.0), Quantity::Acceleration);
        let rms = velocity::<f64>(&x, Quantity::Acceleration).unwrap();
        // 1.3 Hz, d = 17 bins below the edge: 50/(π·d³) = 3e-3 m/s² in some bins at 10 Hz, 4 % of
        // the velocity of 1 m/s² at 80 Hz, so about 1e-3 of the RMS.
        assert!((rms / clean.unwrap() - 1.0).abs() < 2e-3, "{rms}");
    }

    #[test]
    fn edges_are_as_stated() {
        let rms_at = |f_hz: f64| {
            let x = sine(10_000, FS_HZ, f_hz, 2f64.sqrt(), 0.0);
            velocity::<f64>(&x, Quantity::Velocity).unwrap()
        };
        assert!((rms_at(12.0) - 1.0).abs() < 1e-6 && (rms_at(998.0) - 1.0).abs() < 1e-6);
        // Lobe powers 1/6, 2/3, 1/6: √(5/6) = 0.913 at the edge.
        assert!((rms_at(10.0) - (5.0_f64 / 6.0).sqrt()).abs() < 1e-6);
        assert!((rms_at(1000.0) - (5.0_f64 / 6.0).sqrt()).abs() < 1e-6);
        assert!(rms_at(8.0) < 1e-6 && rms_at(1002.0) < 1e-6);
    }

    #[test]
    fn noise_power_is_that_of_the_band() {
        let x = gaussian_noise(100_000, 5);
        let rms = velocity::<f32>(&x, Quantity::Velocity).unwrap();
        // 990 of 5000 Hz of unit variance; 2·9900 degrees of freedom scatter by about 1 %.
        assert!((rms * rms / 0.198 - 1.0).abs() < 0.04, "{rms}");
    }

    #[test]
    fn what_the_record_cannot_hold_is_none() {
        assert_eq!(velocity::<f64>(&[1.0], Quantity::Velocity), None);
        assert_eq!(velocity::<f64>(&vec![0.0; 3999], Quantity::Velocity), None);
        assert_eq!(velocity::<f64>(&vec![5.0; 4000], Quantity::Velocity), Some(0.0));
        let mut plan = VelocityPlan::<f64>::new(1000, &mut FftCache::new());
        let x = sine(1000, 500.0, 80.0, 2f64.sqrt(), 0.0);
        let rms = plan.process(&x, 500.0, Quantity::Velocity, GENERAL_BAND_HZ).unwrap();
        assert!((rms.mm_per_s - 1.0).abs() < 1e-6 && (rms.high_hz - 250.0).abs() < 1e-12);
        assert_eq!(plan.process(&x, 15.0, Quantity::Velocity, GENERAL_BAND_HZ), None);
    }
}
