//! Absolute vibration √(x² + y²) of a sensor pair: the source's bearing signature and the signal of
//! its CWT ratios (docs/theory.md, F9).

use super::bands::Band;
use super::bearing;
use super::bearing::BandReading;
use super::bearing::DefectLine;
use super::bearing::DepthSpectrum;
use super::bearing::LineTask;
use super::plans::Plans;
use crate::dsp::absolute::OversampledAbsolutePlan;
use crate::dsp::absolute::absolute_vibration;
use crate::machine::BearingIndex;
use crate::signal::ChannelIndex;
use crate::units::Hz;

/// A bearing line in the absolute vibration of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct AbsoluteLine {
    /// Which bearing.
    pub bearing: BearingIndex,
    /// The pair: x and y.
    pub pair: (ChannelIndex, ChannelIndex),
    /// Which line.
    pub line: DefectLine,
    /// Kinematic rate.
    pub expected: Hz,
    /// Amplitude of the line, zero-to-peak, unit of the channels.
    pub amplitude: f64,
    /// Amplitude the local noise floor would show, same unit.
    pub floor: f64,
    /// The reading; its depths are amplitudes ÷ √(mean(x² + y²)).
    pub reading: BandReading,
    /// First sample of x and one past the last.
    pub sample_range: (u64, u64),
}

/// Name of the feature "amplitude of `line` of `bearing` in the absolute vibration".
#[must_use]
pub fn line_name(line: DefectLine, bearing: &str) -> String {
    format!("absolute_{}_{bearing}", line.slug())
}

/// The absolute vibration of a pair.
#[derive(Debug)]
pub struct AbsoluteVibration {
    /// √(x² + y²), its own mean removed.
    pub samples: Vec<f32>,
    /// Its rate: the pair's, or twice that.
    pub sample_rate: Hz,
}

impl AbsoluteVibration {
    /// Takes the absolute vibration of `x` and `y`, at twice the rate when lines above an eighth of
    /// it are read (`top`): the root makes harmonics that would fold onto them.
    #[must_use]
    pub fn of(x: &[f32], y: &[f32], sample_rate: Hz, top: Hz, plans: &mut Plans) -> Self {
        if top.0 <= sample_rate.0 / 8.0 {
            let mut samples = vec![0.0; x.len()];
            absolute_vibration(x, y, &mut samples);
            return Self { samples, sample_rate };
        }
        let mut plan = OversampledAbsolutePlan::new(x.len(), plans.tables());
        let mut samples = vec![0.0; plan.out_len()];
        plan.process(x, y, &mut samples);
        Self { samples, sample_rate: Hz(2.0 * sample_rate.0) }
    }
}

/// The amplitude spectrum of an absolute vibration, scaled as depth.
#[derive(Debug)]
pub struct AbsoluteSpectrum {
    depth: Vec<f32>,
    bin_hz: f64,
    duration_s: f64,
    scale: f64,
}

impl AbsoluteSpectrum {
    /// Transforms the absolute vibration `a` of a pair whose root mean square of √(x² + y²) is
    /// `scale`; `None` when the pair is silent.
    #[must_use]
    pub fn new(a: &AbsoluteVibration, scale: f64, plans: &mut Plans) -> Option<Self> {
        let sample_rate = a.sample_rate;
        let a = &a.samples[..];
        if scale <= 0.0 || a.is_empty() {
            return None;
        }
        let plan = plans.padded(a.len());
        let mut depth = vec![0.0_f32; plan.n_bins()];
        plan.process(a, &mut depth);
        for value in &mut depth {
            #[expect(clippy::cast_possible_truncation, reason = "spectra are f32")]
            let scaled = (f64::from(*value) / scale) as f32;
            *value = scaled;
        }
        Some(Self {
            bin_hz: plan.bin_width_hz(sample_rate.0),
            depth,
            duration_s: a.len() as f64 / sample_rate.0,
            scale,
        })
    }

    /// Reads one line: its reading, amplitude and floor amplitude.
    #[must_use]
    pub fn read(
        &self,
        task: &LineTask<'_>,
        scratch: &mut Vec<f32>,
    ) -> Option<(BandReading, f64, f64)> {
        let spectrum = DepthSpectrum {
            depth: &self.depth,
            bin_hz: self.bin_hz,
            duration_s: self.duration_s,
            mean_square: self.scale * self.scale,
            tone: None,
        };
        let top = Hz(self.bin_hz * self.depth.len() as f64);
        let band = Band { low: Hz(0.0), high: top, whitened: false };
        let read = bearing::read_line(&spectrum, band, task, scratch)?;
        // The amplitude itself holds the smooth motion of the elements that pass the other race, which stands there, too.
        let reading = BandReading { is_mirrored: false, ..read };
        let fundamental = reading.harmonics[0]?;
        let amplitude = fundamental.depth * self.scale;
        let floor = amplitude / fundamental.power_ratio.max(f64::MIN_POSITIVE).sqrt();
        Some((reading, amplitude, floor))
    }
}
