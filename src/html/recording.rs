//! The samples a verdict rests on, as far as pictures need them.

use crate::signal::ChannelInfo;
use crate::units::Hz;

/// A contiguous run of samples of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The channel.
    pub info: ChannelInfo,
    /// Index of the first sample.
    pub start: u64,
    /// Stream time of the first sample, s.
    pub start_s: f64,
    /// The samples, in the channel's unit, its offset left out.
    pub samples: Vec<f32>,
    /// The samples that lines were read from, and their rate, where they are others: at equal angles of a shaft whose speed changes.
    pub even: Option<(Vec<f32>, Hz)>,
}

impl Track {
    /// Samples in a time, at most all.
    pub(super) fn first(&self, seconds: f64) -> &[f32] {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate, and the number is not negative"
        )]
        let n = (seconds * self.info.sample_rate.0).max(0.0) as usize;
        &self.samples[..n.min(self.samples.len())]
    }

    /// The samples that lines were read from, and their rate.
    pub(super) fn for_lines(&self) -> (&[f32], Hz) {
        match &self.even {
            Some((samples, rate)) => (samples, *rate),
            None => (&self.samples, self.info.sample_rate),
        }
    }

    /// The channel's rate, Hz.
    pub(super) fn fs_hz(&self) -> f64 {
        self.info.sample_rate.0
    }
}

/// The channel of a name.
pub(super) fn find<'t>(tracks: &'t [Track], name: &str) -> Option<&'t Track> {
    tracks.iter().find(|track| track.info.name == name)
}
