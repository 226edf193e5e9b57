//! What flows: sample blocks, their place in time, channels.
//!
//! The sample index is the clock of analysis (a `u64` per channel, 0 at the start of the stream);
//! stream time in seconds follows from it inside a segment. Must not know where samples come from.

use crate::units::{Hz, Unit};

/// Position of a sample in its channel's stream, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SampleIndex(pub u64);

/// Place of a channel in the list of its machine's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ChannelIndex(pub usize);

/// UTC time in nanoseconds since 1970-01-01T00:00:00Z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// Adds seconds; saturates at the ends of the range (years 1677 and 2262).
    #[must_use]
    pub fn plus_seconds(self, seconds: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
        let nanoseconds = (seconds * 1e9).round() as i64;
        Self(self.0.saturating_add(nanoseconds))
    }
}

/// What is constant about one channel of a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelInfo {
    /// Name in the capture or stream; a machine file's sensor refers to it.
    pub name: String,
    /// Samples a second, > 0 and finite.
    pub sample_rate: Hz,
    /// Unit of the block's samples (and of `offset`).
    pub unit: Unit,
    /// Constant left out of the samples to keep f32 resolution: physical = sample + offset.
    pub offset: f64,
    /// The unit of the data and that of the machine file, where they differ (the latter was used).
    pub unit_conflict: Option<(String, String)>,
    /// Raw values at the ends of the source's number range (integers); `None` for float sources.
    /// In the same unit as the samples: a sample at or beyond either end is clipped.
    pub full_scale: Option<(f32, f32)>,
}

impl ChannelInfo {
    /// What is said of a unit of the data that the machine file states otherwise, for people.
    #[must_use]
    pub fn unit_conflict_text(&self) -> Option<String> {
        let (data, machine) = self.unit_conflict.as_ref()?;
        Some(format!(
            "channel `{}`: the data say {data}, the machine file {machine}; the machine file was used",
            self.name
        ))
    }
}

/// A run of consecutive finite samples of one channel.
///
/// Blocks are idempotent by (machine, stream, channel, start): a block whose samples were already
/// received changes nothing and is counted as duplicate.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Which channel of the stream.
    pub channel: ChannelIndex,
    /// Index of the first sample.
    pub start: SampleIndex,
    /// Segment number; analysis never spans two segments, even where indices continue.
    pub segment: u32,
    /// Stream time of the first sample, s from the start of the stream.
    pub time_s: f64,
    /// Samples in the channel's canonical unit, `offset` removed, all finite.
    pub samples: Vec<f32>,
}

impl Block {
    /// Index one past the last sample.
    #[must_use]
    pub fn end(&self) -> SampleIndex {
        SampleIndex(self.start.0 + self.samples.len() as u64)
    }
}
