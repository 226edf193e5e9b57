//! Velocity and displacement RMS of a band, whatever the sensor measures.
//!
//! Severity standards rate the RMS velocity in 10–1000 Hz, on slow machines also from 2 Hz and the
//! displacement. Integration is a division by 2πf in the frequency domain, inside the band only, so
//! neither offset nor drift enters. Must not know limits.

use std::f64::consts::TAU;

use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::spectrum::HannTransform;

/// What the samples are; decides the power of 2πf and the factor to mm/s and µm.
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

/// The band for machines below 600 r/min (ISO 20816-3), Hz.
pub const SLOW_BAND_HZ: (f64, f64) = (2.0, 1000.0);

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

/// A displacement RMS and the band it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplacementRms {
    /// RMS, µm.
    pub um: f64,
    /// Upper edge actually reached, Hz: the asked one or Nyquist.
    pub high_hz: f64,
}

/// Band-limited velocity and displacement RMS by integration in the frequency domain (D18, D48).
///
/// The band has straight edges. They lie inside the tolerance of ISO 2954 for the relative sensitivity:
/// 0.8…1.1 at the edges, 0.9…1.1 from twice the lower to half the upper.
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
        band_hz: (f64, f64),
    ) -> Option<VelocityRms> {
        let gain = |f_hz| quantity.mm_per_s(f_hz);
        let (mm_per_s, high_hz) = self.band_rms(x, fs_hz, band_hz, gain)?;
        Some(VelocityRms { mm_per_s, high_hz })
    }

    /// Computes the RMS displacement of `x`, as [`VelocityPlan::process`] does the velocity.
    ///
    /// From an acceleration the error of a sine is 3·(Δ/f)² inside the band, and noise at the lower
    /// edge counts (high/low)⁴ times as much as at the upper.
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn process_displacement(
        &mut self,
        x: &[T],
        fs_hz: f64,
        quantity: Quantity,
        band_hz: (f64, f64),
    ) -> Option<DisplacementRms> {
        let gain = |f_hz: f64| quantity.mm_per_s(f_hz) * 1e3 / (TAU * f_hz);
        let (um, high_hz) = self.band_rms(x, fs_hz, band_hz, gain)?;
        Some(DisplacementRms { um, high_hz })
    }

    /// RMS of what `gain(f)` makes of the band, and the upper edge reached.
    fn band_rms(
        &mut self,
        x: &[T],
        fs_hz: f64,
        (low_hz, high_hz): (f64, f64),
        gain: impl Fn(f64) -> f64,
    ) -> Option<(f64, f64)> {
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
            // Squared in f64: counts of a converter leave f32 in long records.
            let (re, im) = (value.re.to_f64() * gain(f_hz), value.im.to_f64() * gain(f_hz));
            power += sides * (re * re + im * im);
        }
        Some(((power * scale).sqrt(), reached_hz))
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
    fn displacement_is_the_velocity_integrated() {
        // 25 µm at 25 Hz from all three quantities; (Δ/f)² with Δ = 1 Hz: 1.6e-3, thrice.
        let omega = TAU * 25.0;
        let amplitudes = [
            (Quantity::Acceleration, 25e-6 * omega * omega, 6e-3),
            (Quantity::Velocity, 25e-3 * omega, 1e-3),
            (Quantity::Displacement, 25.0, 1e-9),
        ];
        for (quantity, amplitude, tolerance) in amplitudes {
            let x = sine(10_000, FS_HZ, 25.0, amplitude, 0.2);
            let mut plan = VelocityPlan::<f64>::new(x.len(), &mut FftCache::new());
            let rms = plan.process_displacement(&x, FS_HZ, quantity, GENERAL_BAND_HZ).unwrap();
            assert!(
                (rms.um / (25.0 / 2f64.sqrt()) - 1.0).abs() < tolerance,
                "{quantity:?}: {rms:?}"
            );
        }
        // The same sine with bins ten times finer: a hundredth of the error.
        let x = sine(100_000, FS_HZ, 25.0, 25e-6 * omega * omega, 0.2);
        let mut plan = VelocityPlan::<f32>::new(x.len(), &mut FftCache::new());
        let rms = plan
            .process_displacement(&narrow(&x), FS_HZ, Quantity::Acceleration, GENERAL_BAND_HZ)
            .unwrap();
        assert!((rms.um / (25.0 / 2f64.sqrt()) - 1.0).abs() < 6e-5, "{rms:?}");
    }

    #[test]
    fn relative_sensitivity_is_inside_iso_2954() {
        // ISO 2954, relative sensitivity at frequencies of the band: limits of the 10 Hz to 1000 Hz
        // band, and the same limits on the bands from 2 Hz (ISO 20816-3) and from 2 Hz to 10 Hz.
        let limits = [
            (10.0, 0.8, 1.1),
            (20.0, 0.9, 1.1),
            (40.0, 0.9, 1.1),
            (80.0, 0.99, 1.01),
            (160.0, 0.9, 1.1),
            (500.0, 0.9, 1.1),
            (1000.0, 0.8, 1.1),
        ];
        let check = |f_hz: f64, band_hz: (f64, f64), least: f64, most: f64| {
            // 4 s, and a frequency between two bins as well as on one.
            for f_hz in [f_hz, f_hz + 0.125] {
                if f_hz > band_hz.1 {
                    continue;
                }
                let acceleration = TAU * f_hz * 1e-3 * 2f64.sqrt();
                let x = sine(40_000, FS_HZ, f_hz, acceleration, 0.3);
                let mut plan = VelocityPlan::<f64>::new(x.len(), &mut FftCache::new());
                let rms = plan.process(&x, FS_HZ, Quantity::Acceleration, band_hz).unwrap();
                let sensitivity = rms.mm_per_s;
                assert!(
                    (least..=most).contains(&sensitivity),
                    "{f_hz} in {band_hz:?}: {sensitivity}"
                );
                // Displacement, referred to what it is.
                let um = plan
                    .process_displacement(&x, FS_HZ, Quantity::Acceleration, band_hz)
                    .unwrap()
                    .um;
                let sensitivity = um * TAU * f_hz * 1e-3;
                assert!(
                    (least..=most).contains(&sensitivity),
                    "{f_hz} in {band_hz:?}: {sensitivity}"
                );
            }
        };
        for (f_hz, least, most) in limits {
            check(f_hz, GENERAL_BAND_HZ, least, most);
        }
        for (f_hz, least, most) in
            [(2.0, 0.8, 1.1), (4.0, 0.9, 1.1), (10.0, 0.9, 1.1), (80.0, 0.99, 1.01)]
        {
            check(f_hz, SLOW_BAND_HZ, least, most);
        }
        for (f_hz, least, most) in
            [(2.0, 0.8, 1.1), (4.0, 0.9, 1.1), (5.0, 0.9, 1.1), (10.0, 0.8, 1.1)]
        {
            check(f_hz, (2.0, 10.0), least, most);
        }
    }

    #[test]
    fn hard_records_have_finite_values() {
        // Gap voltage, 1e6 times the signal: rounds the samples to 1e-10.
        let clean = sine(10_007, FS_HZ, 80.0, 1.0, 0.1);
        let raised: Vec<f64> = clean.iter().map(|v| v + 1e6).collect();
        let (a, b) = (
            velocity::<f64>(&clean, Quantity::Velocity),
            velocity::<f64>(&raised, Quantity::Velocity),
        );
        assert!((a.unwrap() - b.unwrap()).abs() < 1e-9);
        // 24 bits at the rail: |X|² leaves f32 at this length.
        let rail = sine(100_000, FS_HZ, 80.0, 8_388_607.0, 0.1);
        let counts = velocity::<f32>(&rail, Quantity::Velocity).unwrap();
        assert!((counts / (8_388_607.0 / 2f64.sqrt()) - 1.0).abs() < 1e-6, "{counts}");
        let mut impulse = vec![0.0; 10_007];
        impulse[5000] = 1e-40;
        for x in [impulse, vec![0.0; 10_007], vec![-3.3; 10_007]] {
            assert!(velocity::<f32>(&x, Quantity::Displacement).unwrap().is_finite());
        }
        // Nyquist and 0 are outside.
        let nyquist = sine(10_000, FS_HZ, 5000.0, 1.0, 0.0);
        assert!(velocity::<f64>(&nyquist, Quantity::Velocity).unwrap() < 1e-12);
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
