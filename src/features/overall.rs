//! Broadband levels of a channel: RMS, peak, crest factor, kurtosis, velocity RMS 10–1000 Hz.

use super::Feature;
use super::limit;
use super::shaft;
use super::speed;
use crate::dsp::real::floor_index;
use crate::dsp::stats::Moments;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Name of the RMS feature.
pub const RMS: &str = "rms";
/// Name of the feature "RMS of what the surroundings of the shaft lines 1×…3× leave".
pub const RMS_BESIDE_SHAFTS: &str = "rms_beside_shafts";
/// Name of the kurtosis feature.
pub const KURTOSIS: &str = "kurtosis";
/// Name of the velocity feature: velocity RMS in the band of ISO 20816, 10–1000 Hz.
pub const VELOCITY_RMS: &str = "velocity_rms_10_1000_hz";
/// Band of [`VELOCITY_RMS`], Hz.
pub const VELOCITY_BAND_HZ: (f64, f64) = (10.0, 1000.0);

/// Bins to either side of a line beyond which the side lobes of Hann are together 50 dB below it.
const LOBE_BINS: f64 = 6.0;

/// Part of the power that may be theirs.
const SIDE_LOBES: f64 = 2e-5;

/// Gives the RMS of what lies beside 1×…3× of shafts of these speeds (F24): of the Hann-weighted spectrum without ± 3 % of each, as far
/// as a nominal speed may be off, or a clock that is not even smears a line; at least ± 6 bins. `None` when nothing measurable remains.
///
/// `x_hat`: unnormalised one-sided DFT of n samples, mean removed.
#[must_use]
pub fn beside_shafts(
    (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
    speeds: &[Hz],
    unit: Unit,
) -> Option<Feature> {
    let bin_hz = rate.0 / n as f64;
    let reach = |order_hz: f64| (speed::REFINE_RANGE * order_hz).max(LOBE_BINS * bin_hz);
    let lines = speeds.iter().flat_map(|speed| shaft::ORDERS.map(|k| f64::from(k) * speed.0));
    let bins = |at: f64| {
        let (low, high) = (at - reach(at), at + reach(at));
        floor_index((low.max(0.0) / bin_hz).ceil())..=floor_index(high / bin_hz)
    };
    let taken: Vec<RangeInclusive<usize>> = lines.map(bins).collect();
    let last = x_hat.len().checked_sub(2)?;
    let (mut whole, mut left) = (0.0, 0.0);
    for k in 1..=last {
        let power = shaft::hann_magnitude(x_hat, k).powi(2);
        whole += power;
        if !taken.iter().any(|range| range.contains(&k)) {
            left += power;
        }
    }
    (left > SIDE_LOBES * whole).then(|| Feature {
        name: Arc::from(RMS_BESIDE_SHAFTS),
        value: limit::hann_rms(left, n),
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
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;

    /// RMS of a line of unit amplitude at 5.02 Hz with a square wave of ±0.1 as the rest, both 10 s long, beside a shaft of 5 Hz.
    fn rest(sine: f64, square: f64) -> Option<f64> {
        let x: Vec<f32> = (0..1000)
            .map(|i| {
                let sign = if i % 2 == 0 { square } else { -square };
                let t = f64::from(i) / 100.0;
                f32::rounded(
                    sine * (std::f64::consts::TAU * 5.02 * t).cos()
                        + sign * (std::f64::consts::TAU * 0.3 * t).sin(),
                )
            })
            .collect();
        let mut plan = ForwardPlan::new(x.len(), &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(&x, &mut x_hat);
        let found = beside_shafts((&x_hat, x.len(), Hz(100.0)), &[Hz(5.0)], Unit::One);
        found.map(|f| f.value)
    }

    #[test]
    fn what_lies_beside_a_shafts_line_is_the_rest_wherever_in_three_percent_the_line_is() {
        // 0.1·sin at 50 ∓ 0.3 Hz: RMS 0.1/√2, whatever the line at 1× does.
        for sine in [0.0, 1.0, 5.0] {
            let found = rest(sine, 0.1).unwrap();
            assert!((found / (0.1 / 2.0_f64.sqrt()) - 1.0).abs() < 0.02, "{sine}: {found}");
        }
        assert!(rest(1.0, 0.0).is_none(), "a line alone leaves nothing");
    }
}
