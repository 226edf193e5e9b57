//! Broadband levels of a channel: RMS, peak, crest factor, kurtosis, velocity RMS 10–1000 Hz.

use super::Feature;
use crate::dsp::stats::Moments;
use crate::units::Unit;
use std::sync::Arc;

/// Name of the RMS feature.
pub const RMS: &str = "rms";
/// Name of the kurtosis feature.
pub const KURTOSIS: &str = "kurtosis";
/// Name of the velocity feature: velocity RMS in the band of ISO 20816, 10–1000 Hz.
pub const VELOCITY_RMS: &str = "velocity_rms_10_1000_hz";
/// Band of [`VELOCITY_RMS`], Hz.
pub const VELOCITY_BAND_HZ: (f64, f64) = (10.0, 1000.0);

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
