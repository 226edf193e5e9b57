//! Broadband levels of a channel: RMS, peak, crest factor, kurtosis, velocity RMS 10–1000 Hz.

use super::Feature;
use crate::dsp::stats::Moments;
use crate::units::Unit;
use std::sync::Arc;

/// Name of the RMS feature.
pub const RMS: &str = "rms";
/// Name of the feature "RMS of what the shaft lines 1×…3× leave".
pub const RMS_BESIDE_SHAFTS: &str = "rms_beside_shafts";
/// Name of the kurtosis feature.
pub const KURTOSIS: &str = "kurtosis";
/// Name of the velocity feature: velocity RMS in the band of ISO 20816, 10–1000 Hz.
pub const VELOCITY_RMS: &str = "velocity_rms_10_1000_hz";
/// Band of [`VELOCITY_RMS`], Hz.
pub const VELOCITY_BAND_HZ: (f64, f64) = (10.0, 1000.0);

/// Gives the RMS that remains when shaft lines of the zero-to-peak amplitudes `lines` are taken out:
/// √(RMS² − ΣA²/2); `None` when nothing measurable remains.
#[must_use]
pub fn beside_shafts(moments: &Moments, lines: &[Feature], unit: Unit) -> Option<Feature> {
    let rms = moments.rms()?;
    let taken: f64 = lines.iter().map(|line| line.value * line.value / 2.0).sum();
    let left = rms * rms - taken;
    (left > 1e-6 * rms * rms).then(|| Feature {
        name: Arc::from(RMS_BESIDE_SHAFTS),
        value: left.sqrt(),
        unit,
    })
}

/// Gives the levels that follow from a channel's moments; those without a value are left out.
#[must_use]
pub fn levels(moments: &Moments, unit: Unit, offset: f64) -> Vec<Feature> {
    let feature = |name: &str, value: Option<f64>, unit| {
        value.map(|value| Feature { name: Arc::from(name), value, unit })
    };
    [
        feature("mean", (moments.n > 0).then_some(moments.mean + offset), unit),
        feature(RMS, moments.rms(), unit),
        feature("peak", moments.peak(), unit),
        feature("crest", moments.crest(), Unit::One),
        feature(KURTOSIS, moments.kurtosis(), Unit::One),
    ]
    .into_iter()
    .flatten()
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_and_its_line_leave_the_rest() {
        // RMS² = ½·2² + 1² with a square wave of ±1 as the rest.
        let x: Vec<f64> = (0..1000)
            .map(|i| {
                let square = if i % 2 == 0 { 1.0 } else { -1.0 };
                2.0 * (std::f64::consts::TAU * 5.0 * f64::from(i) / 1000.0).cos() + square
            })
            .collect();
        let line = |value| Feature { name: Arc::from("line_1x_s"), value, unit: Unit::One };
        let moments = Moments::of(&x);
        let rest = beside_shafts(&moments, &[line(2.0)], Unit::One).unwrap();
        assert!((rest.value - 1.0).abs() < 1e-9);
        assert!(beside_shafts(&moments, &[line(2.0), line(2.0)], Unit::One).is_none());
    }
}
