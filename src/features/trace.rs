//! One vibration channel on its way through a window. Must not know what its samples will be read for.

use super::ChannelWindow;
use super::Feature;
use super::plans::Plans;
use super::sensor::SensorReading;
use crate::dsp::fft;
use crate::dsp::stats::Moments;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use rustfft::num_complex::Complex;
use std::borrow::Cow;

/// Samples, spectrum and levels of a channel, and the features read so far.
#[derive(Debug)]
pub(super) struct Trace<'a> {
    /// Index of the sensor in the machine.
    pub(super) sensor: usize,
    pub(super) channel: ChannelIndex,
    /// Samples a second of `samples`.
    pub(super) rate: Hz,
    /// Newest samples of a length that transforms fast: as sampled, or, of a shaft whose speed changes,
    /// at equal angles ([`super::turning`]).
    pub(super) samples: Cow<'a, [f32]>,
    /// All samples of the window, as sampled.
    pub(super) all: ChannelWindow<'a>,
    /// First sample of the window and one past the last.
    pub(super) range: (u64, u64),
    /// Moments of all samples of the window.
    pub(super) moments: Moments,
    /// Unnormalised one-sided DFT of `samples`, mean removed.
    pub(super) x_hat: Vec<Complex<f32>>,
    pub(super) features: Vec<Feature>,
}

impl<'a> Trace<'a> {
    /// Takes up the samples of a sensor.
    pub(super) fn new(
        reading: &SensorReading,
        run: ChannelWindow<'a>,
        rate: Hz,
        plans: &mut Plans,
    ) -> Self {
        let n = fft::fast_len_at_most(run.samples.len());
        let samples = &run.samples[run.samples.len() - n..];
        Self {
            sensor: reading.sensor,
            channel: reading.channel,
            rate,
            samples: Cow::Borrowed(samples),
            all: run,
            range: range_of(run),
            moments: Moments::of(run.samples),
            x_hat: transform(samples, plans),
            features: Vec::new(),
        }
    }

    /// Goes on with other samples of the same vibration, the newest of a length that transforms fast.
    pub(super) fn replace(&mut self, mut samples: Vec<f32>, rate: Hz, plans: &mut Plans) {
        let n = fft::fast_len_at_most(samples.len());
        samples.drain(..samples.len() - n);
        self.x_hat = transform(&samples, plans);
        self.samples = Cow::Owned(samples);
        self.rate = rate;
    }

    /// Whether sample by sample both were taken at the same instants, to half a sample: indices of two senders count from
    /// different instants.
    pub(super) fn is_simultaneous(&self, other: &Self) -> bool {
        let apart = (self.start_s() - other.start_s()).abs() * self.rate.0;
        self.rate == other.rate
            && self.samples.len() == other.samples.len()
            && self.all.samples.len() == other.all.samples.len()
            && apart <= 0.5
    }

    /// Stream time of the first of all samples, s.
    pub(super) fn start_s(&self) -> f64 {
        self.all.time_s
    }
}

/// Unnormalised one-sided DFT of samples, mean removed.
pub(super) fn transform(samples: &[f32], plans: &mut Plans) -> Vec<Complex<f32>> {
    let plan = plans.forward(samples.len());
    let mut x_hat = vec![Complex::default(); plan.n_bins()];
    plan.process(samples, &mut x_hat);
    x_hat
}

/// First sample of a run and one past the last.
pub(super) fn range_of(run: ChannelWindow<'_>) -> (u64, u64) {
    (run.start, run.start + run.samples.len() as u64)
}
