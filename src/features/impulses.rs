//! How much of a channel's energy comes in blows, whatever their rate (docs/theory.md, F25).
//!
//! What bearing lines cannot tell: elements that slip strike at no rate. Read in the whitened bands, in which tones and whatever turns
//! with the shafts are down at the noise. Must not know what is healthy.

use super::Feature;
use super::bearing;
use super::bearing::DepthSpectrum;
use super::trace::Trace;
use crate::dsp::impulsive;
use crate::dsp::real::floor_index;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Values of the squared envelope whose median is taken: it is then known to 2.3 %.
const N_VALUES: usize = 4096;

/// Multiples of a shaft's speed at which its events are looked for.
const ORDERS: u32 = 10;

/// Bands that must agree, as a part of them: those that resonate bring blows over the noise, others need not.
const A_QUARTER: f64 = 0.25;

/// Name of the feature "amplitude of blows over that of the rest".
pub const BLOWS: &str = "blows_over_rest";

/// Least value of that feature: what is less cannot be told from noise, and has no ratio.
const LEAST: f64 = 0.1;

/// Blows in one band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blows {
    /// Part of the band's energy.
    pub part: f64,
    /// Whether events of a shaft explain them.
    pub is_shafts: bool,
}

/// Blows in one band: a shaft's if they hold the part η and a line at one of the multiples of its speed is as deep; blows once a turn
/// have lines of depth up to 2η at all of them.
///
/// `e2`: the band's squared envelope, which `spectrum` is of; `n_bins` those of the band.
pub(super) fn read(
    e2: &[f32],
    spectrum: &DepthSpectrum<'_>,
    n_bins: usize,
    shafts: &[Hz],
    scratch: &mut Vec<f32>,
) -> Blows {
    scratch.clear();
    scratch.resize(N_VALUES, 0.0);
    let part = impulsive::part(e2, spectrum.mean_square, n_bins, scratch);
    let multiples = shafts.iter().flat_map(|f| (1..=ORDERS).map(|order| f64::from(order) * f.0));
    let events = multiples.map(|at| bearing::depth_at(spectrum, at)).fold(0.0, f64::max);
    Blows { part, is_shafts: events >= part }
}

/// Blows heard in one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Impulses {
    /// Which channel.
    pub channel: ChannelIndex,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
    /// Blows of the whitened bands.
    pub bands: Vec<Blows>,
}

impl Impulses {
    /// Part of the energy in blows, whatever makes them, that a quarter of the bands reach; 0 without bands.
    #[must_use]
    pub fn agreed(&self) -> f64 {
        Self::quarter(self.bands.iter().map(|blows| blows.part).collect())
    }

    /// The same of blows that no shaft's events explain.
    #[must_use]
    pub fn unexplained(&self) -> f64 {
        let part = |blows: &Blows| if blows.is_shafts { 0.0 } else { blows.part };
        Self::quarter(self.bands.iter().map(part).collect())
    }

    /// What a quarter of the values reach.
    fn quarter(mut sorted: Vec<f64>) -> f64 {
        sorted.sort_by(|a, b| b.total_cmp(a));
        let quarter = floor_index((A_QUARTER * sorted.len() as f64).ceil());
        sorted.get(quarter.saturating_sub(1)).copied().unwrap_or(0.0)
    }

    /// RMS of blows that nothing explains over that of the rest, what trends and baselines hold: √(η/(1 − η)).
    #[must_use]
    pub fn over_rest(&self) -> f64 {
        let part = self.unexplained().clamp(0.0, 1.0 - f64::EPSILON);
        (part / (1.0 - part)).sqrt().max(LEAST)
    }
}

/// Adds the blows to the features of their channels.
pub(super) fn keep(heard: &[Impulses], traces: &mut [Trace<'_>]) {
    for trace in traces {
        let own = heard.iter().find(|heard| heard.channel == trace.channel);
        trace.features.extend(own.map(|own| Feature {
            name: Arc::from(BLOWS),
            value: own.over_rest(),
            unit: Unit::One,
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::envelope;
    use crate::dsp::envelope::EnvelopeSpectrumPlan;
    use crate::dsp::envelope::SquaredEnvelopePlan;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use rustfft::num_complex::Complex;

    /// The part read of ten seconds of noise that is ten times as high for 2 ms every `period` samples of 10 kHz, beside shafts of 20 Hz.
    fn struck_every(period: impl Fn(usize) -> bool) -> Blows {
        let noise = gaussian_noise(100_000, 5);
        let gain = |i: usize| if period(i) { 10.0 } else { 1.0 };
        let x: Vec<f32> =
            noise.iter().enumerate().map(|(i, v)| f32::rounded(v * gain(i))).collect();
        let mut cache = FftCache::<f32>::new();
        let mut x_hat = vec![Complex::default(); crate::dsp::fft::n_bins(x.len())];
        ForwardPlan::new(x.len(), &mut cache).process(&x, &mut x_hat);
        let bins = envelope::bins_of_band(x.len(), 1e4, 1e3, 3e3).unwrap();
        let n_bins = bins.len();
        let mut squared = SquaredEnvelopePlan::new(x.len(), bins, &mut cache);
        let mut e2 = vec![0.0; squared.out_len()];
        squared.process(&x_hat, &mut e2);
        let mut plan = EnvelopeSpectrumPlan::new(e2.len(), &mut cache);
        let mut depth = vec![0.0; plan.n_bins()];
        let mean_square = plan.process(&e2, &mut depth).unwrap();
        let bin_hz = plan.bin_width_hz(squared.out_rate_hz(1e4));
        let spectrum =
            DepthSpectrum { depth: &depth, bin_hz, duration_s: 10.0, mean_square, tone: None };
        read(&e2, &spectrum, n_bins, &[Hz(20.0)], &mut Vec::new())
    }

    #[test]
    fn blows_count_unless_a_shaft_makes_them() {
        // 2 ms of 47: 4.3 of 5.2 parts of the energy.
        let found = struck_every(|i| i % 470 < 20);
        assert!((found.part - 4.3 / 5.2).abs() < 0.06 && !found.is_shafts, "{found:?}");
        // 21.3 a second are no shaft's; 20 and 40 a second are.
        assert!(struck_every(|i| i % 500 < 20).is_shafts);
        assert!(struck_every(|i| i % 250 < 20).is_shafts);
        assert!(struck_every(|_| false).part < 0.05);
    }

    #[test]
    fn a_quarter_of_the_bands_must_agree() {
        let of = |parts: &[f64], is_shafts: bool| {
            let (channel, sample_range) = (ChannelIndex(0), (0, 1));
            let bands = parts.iter().map(|part| Blows { part: *part, is_shafts }).collect();
            Impulses { channel, sample_range, bands }
        };
        let bands = [0.1, 0.9, 0.2, 0.6, 0.0, 0.0, 0.3];
        assert!((of(&bands, false).unexplained() - 0.6).abs() < 1e-15, "two of seven");
        assert!((of(&bands, true).agreed() - 0.6).abs() < 1e-15);
        assert!(of(&bands, true).unexplained().abs() < 1e-15);
        assert!((of(&[0.4], false).agreed() - 0.4).abs() < 1e-15);
        assert!(of(&[], false).agreed().abs() < 1e-15);
        // Half of the energy: as much as the rest; none: what cannot be told from noise.
        assert!((of(&[0.5], false).over_rest() - 1.0).abs() < 1e-12);
        assert!((of(&[0.0], false).over_rest() - LEAST).abs() < 1e-15);
        assert!(of(&[1.0], false).over_rest().is_finite());
    }
}
