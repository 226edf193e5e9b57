//! Samples of one channel.

use super::cursor::{Cursor, at_most};
use super::{MAX_BLOCK_SAMPLES, MAX_INDEX, WireError};

/// The time of a block whose sender knows none.
pub const NO_TIME: i64 = i64::MIN;

/// What a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    /// Signed, 16 bits.
    I16,
    /// Signed, 24 bits in three bytes.
    I24,
    /// IEEE single precision.
    F32,
    /// IEEE double precision.
    F64,
    /// Signed, 32 bits.
    I32,
}

impl SampleType {
    /// Every type.
    pub const ALL: [Self; 5] = [Self::I16, Self::I24, Self::F32, Self::F64, Self::I32];

    /// Its number in frames.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::I16 => 1,
            Self::I24 => 2,
            Self::F32 => 3,
            Self::F64 => 4,
            Self::I32 => 5,
        }
    }

    /// Its name in JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::I16 => "i16",
            Self::I24 => "i24",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::I32 => "i32",
        }
    }

    /// Bytes of a sample.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::I24 => 3,
            Self::F32 | Self::I32 => 4,
            Self::F64 => 8,
        }
    }

    /// Lowest and highest value; `None` for floats.
    #[must_use]
    pub fn ends(self) -> Option<(f64, f64)> {
        match self {
            Self::I16 => Some((f64::from(i16::MIN), f64::from(i16::MAX))),
            Self::I24 => Some((-8_388_608.0, 8_388_607.0)),
            Self::I32 => Some((f64::from(i32::MIN), f64::from(i32::MAX))),
            Self::F32 | Self::F64 => None,
        }
    }

    pub(super) fn read(from: &mut Cursor<'_>) -> Result<Self, WireError> {
        let found = from.u8("a sample type")?;
        let value = WireError::Value { what: "a sample type", found: u64::from(found) };
        Self::ALL.into_iter().find(|kind| kind.number() == found).ok_or(value)
    }
}

/// Samples as they travel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Samples<'a> {
    kind: SampleType,
    /// A whole number of samples.
    bytes: &'a [u8],
}

impl<'a> Samples<'a> {
    /// Samples of `kind` as little-endian bytes; `None`: the last one is cut.
    #[must_use]
    pub fn new(kind: SampleType, bytes: &'a [u8]) -> Option<Self> {
        bytes.len().is_multiple_of(kind.bytes()).then_some(Self { kind, bytes })
    }

    /// What each one is.
    #[must_use]
    pub fn kind(&self) -> SampleType {
        self.kind
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bytes.len() / self.kind.bytes()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Those from number `start` on.
    #[must_use]
    pub fn skip(self, start: usize) -> Self {
        let at = start.saturating_mul(self.kind.bytes()).min(self.bytes.len());
        Self { kind: self.kind, bytes: &self.bytes[at..] }
    }

    /// The bytes.
    #[must_use]
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The bytes of each one, `N` being those of the type.
    pub fn each<const N: usize>(&self) -> impl ExactSizeIterator<Item = &'a [u8; N]> {
        self.bytes.as_chunks::<N>().0.iter()
    }
}

/// A run of consecutive samples of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block<'a> {
    /// Place of the channel in the hello.
    pub stream: u16,
    /// Number of the block in its channel and epoch, from 0.
    pub sequence: u64,
    /// Number of its first sample in its channel and epoch; what the sender did not measure is left out.
    pub first: u64,
    /// UTC of the first sample by the sender's clock, ns since 1970; [`NO_TIME`]: not known.
    pub time_ns: i64,
    /// The samples.
    pub samples: Samples<'a>,
}

impl<'a> Block<'a> {
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        let n = self.samples.len();
        at_most("samples of a block", n as u64, MAX_BLOCK_SAMPLES as u64)?;
        at_most("a sequence", self.sequence, MAX_INDEX)?;
        at_most("a sample index", self.first, MAX_INDEX)?;
        out.extend_from_slice(&self.stream.to_le_bytes());
        out.push(self.samples.kind.number());
        out.push(0);
        out.extend_from_slice(&u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes());
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&self.first.to_le_bytes());
        out.extend_from_slice(&self.time_ns.to_le_bytes());
        out.extend_from_slice(self.samples.bytes);
        Ok(())
    }

    pub(super) fn read(mut from: Cursor<'a>) -> Result<Self, WireError> {
        let stream = from.u16("a channel's place")?;
        let kind = SampleType::read(&mut from)?;
        let reserved = from.u8("the reserved byte")?;
        if reserved != 0 {
            return Err(WireError::Value { what: "the reserved byte", found: reserved.into() });
        }
        let n = from.u32("the number of samples")?;
        at_most("samples of a block", n.into(), MAX_BLOCK_SAMPLES as u64)?;
        let sequence = from.index("a sequence")?;
        let first = from.index("a sample index")?;
        let time_ns = from.i64("a block's time")?;
        let n_bytes = usize::try_from(n).unwrap_or(usize::MAX).saturating_mul(kind.bytes());
        let bytes = from.take(n_bytes, "the samples")?;
        from.end()?;
        let samples = Samples { kind, bytes };
        Ok(Self { stream, sequence, first, time_ns, samples })
    }
}
