//! Samples as their source gave them: the number type and the counts, before any conversion.
//!
//! A recorder keeps these, so that nothing is lost to the conversion. Must not know files.

use crate::signal::{ChannelIndex, SampleIndex};
use crate::units::Hz;

/// Number types a channel may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberType {
    /// IEEE single precision.
    F32,
    /// IEEE double precision.
    F64,
    /// Signed, 16 bits.
    I16,
    /// Signed, 32 bits.
    I32,
}

impl NumberType {
    /// The type's name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::I16 => "int16",
            Self::I32 => "int32",
        }
    }

    /// Bytes of one element.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::F32 | Self::I32 => 4,
            Self::F64 => 8,
        }
    }
}

impl NumberType {
    /// The extremes of the number range; `None` for floats.
    pub(super) fn ends(self) -> Option<RawSamples> {
        match self {
            Self::F32 | Self::F64 => None,
            Self::I16 => Some(RawSamples::I16(vec![i16::MIN, i16::MAX])),
            Self::I32 => Some(RawSamples::I32(vec![i32::MIN, i32::MAX])),
        }
    }
}

/// Raw elements of one channel; physical = raw·scale + offset, with the channel's scale and offset.
#[derive(Debug, Clone, PartialEq)]
pub enum RawSamples {
    /// IEEE single precision.
    F32(Vec<f32>),
    /// IEEE double precision.
    F64(Vec<f64>),
    /// Counts.
    I16(Vec<i16>),
    /// Counts.
    I32(Vec<i32>),
}

impl RawSamples {
    /// What each element is.
    #[must_use]
    pub fn number_type(&self) -> NumberType {
        match self {
            Self::F32(_) => NumberType::F32,
            Self::F64(_) => NumberType::F64,
            Self::I16(_) => NumberType::I16,
            Self::I32(_) => NumberType::I32,
        }
    }

    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::F32(raw) => raw.len(),
            Self::F64(raw) => raw.len(),
            Self::I16(raw) => raw.len(),
            Self::I32(raw) => raw.len(),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first finite element.
    pub(super) fn first_finite(&self) -> Option<f64> {
        match self {
            Self::F32(raw) => raw.iter().find(|x| x.is_finite()).map(|&x| f64::from(x)),
            Self::F64(raw) => raw.iter().find(|x| x.is_finite()).copied(),
            Self::I16(raw) => raw.first().map(|&x| f64::from(x)),
            Self::I32(raw) => raw.first().map(|&x| f64::from(x)),
        }
    }
}

/// A run of consecutive raw samples of one channel, numbers that are not finite included.
#[derive(Debug, Clone, PartialEq)]
pub struct Received {
    /// Which channel of the stream.
    pub channel: ChannelIndex,
    /// Index of the first sample.
    pub start: SampleIndex,
    /// Segment number; the run lies inside it.
    pub segment: u32,
    /// Stream time of the first sample, s.
    pub time_s: f64,
    /// The samples.
    pub raw: RawSamples,
}

/// What a source states about a channel of [`Received`] runs.
#[derive(Debug, Clone, PartialEq)]
pub struct ReceivedChannel {
    /// Name: not empty, without `/`.
    pub name: String,
    /// Samples a second.
    pub sample_rate: Hz,
    /// What each element is.
    pub number_type: NumberType,
    /// physical = raw·scale + offset, in the unit of `unit`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Raw value that becomes sample 0 of a block; 0 unless the source chose another.
    pub raw_zero: f64,
    /// Unit as the source spells it.
    pub unit: Option<String>,
    /// What measures it, for people.
    pub sensor: Option<String>,
}
