//! Frames without samples: where to go on, what has come, why it ends.

use super::cursor::{Cursor, at_most, put_count, put_text};
use super::error::ErrorCode;
use super::{MAX_CHANNELS, MAX_TEXT_BYTES, WireError};

/// The answer to a hello.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Welcome {
    /// Bytes of frames that may be under way, sent and not acknowledged.
    pub credit_bytes: u32,
    /// What is wanted of each channel, in the order of the hello.
    pub wanted: Vec<Wanted>,
}

/// Where a channel goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// The next block.
    pub sequence: u64,
    /// The next sample.
    pub index: u64,
}

/// What the daemon has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ack {
    /// Bytes of frames that may be under way from now on.
    pub credit_bytes: u32,
    /// Channels of which it has more than before.
    pub progress: Vec<Progress>,
}

/// How far a channel has come: every block before `sequence` is settled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Place of the channel in the hello.
    pub stream: u16,
    /// The next block that is wanted.
    pub sequence: u64,
}

/// Why the connection ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// What it is.
    pub code: ErrorCode,
    /// What was found and what to do, for people.
    pub text: String,
}

/// How a sender ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bye {
    /// It will be back and go on.
    Pause,
    /// Its stream is complete: what is left of a window is judged now.
    End,
}

impl Welcome {
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        out.extend_from_slice(&self.credit_bytes.to_le_bytes());
        put_count(out, "channels", self.wanted.len(), MAX_CHANNELS)?;
        for wanted in &self.wanted {
            out.extend_from_slice(&wanted.sequence.to_le_bytes());
            out.extend_from_slice(&wanted.index.to_le_bytes());
        }
        Ok(())
    }

    pub(super) fn read(mut from: Cursor<'_>) -> Result<Self, WireError> {
        let credit_bytes = from.u32("the credit")?;
        let n = from.u16("the number of channels")?;
        at_most("channels", n.into(), MAX_CHANNELS as u64)?;
        let mut wanted = Vec::new();
        for _ in 0..n {
            let sequence = from.index("a sequence")?;
            wanted.push(Wanted { sequence, index: from.index("a sample index")? });
        }
        from.end()?;
        Ok(Self { credit_bytes, wanted })
    }
}

impl Ack {
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        out.extend_from_slice(&self.credit_bytes.to_le_bytes());
        put_count(out, "channels", self.progress.len(), MAX_CHANNELS)?;
        for progress in &self.progress {
            out.extend_from_slice(&progress.stream.to_le_bytes());
            out.extend_from_slice(&progress.sequence.to_le_bytes());
        }
        Ok(())
    }

    pub(super) fn read(mut from: Cursor<'_>) -> Result<Self, WireError> {
        let credit_bytes = from.u32("the credit")?;
        let n = from.u16("the number of channels")?;
        at_most("channels", n.into(), MAX_CHANNELS as u64)?;
        let mut progress = Vec::new();
        for _ in 0..n {
            let stream = from.u16("a channel's place")?;
            progress.push(Progress { stream, sequence: from.index("a sequence")? });
        }
        from.end()?;
        Ok(Self { credit_bytes, progress })
    }
}

impl Problem {
    /// A problem with as much of the text as a frame takes.
    #[must_use]
    pub fn new(code: ErrorCode, text: &str) -> Self {
        let end = (0..=MAX_TEXT_BYTES.min(text.len())).rev().find(|at| text.is_char_boundary(*at));
        Self { code, text: text[..end.unwrap_or(0)].to_owned() }
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        out.extend_from_slice(&self.code.number().to_le_bytes());
        put_text(out, "the text", &self.text, MAX_TEXT_BYTES)
    }

    pub(super) fn read(mut from: Cursor<'_>) -> Result<Self, WireError> {
        let found = from.u16("the code")?;
        let unknown = WireError::Value { what: "an error's code", found: found.into() };
        let code = ErrorCode::of(found).ok_or(unknown)?;
        let text = from.text("the text", MAX_TEXT_BYTES)?;
        from.end()?;
        Ok(Self { code, text })
    }
}

impl Bye {
    pub(super) fn write(self, out: &mut Vec<u8>) {
        out.push(match self {
            Self::Pause => 0,
            Self::End => 1,
        });
    }

    pub(super) fn read(mut from: Cursor<'_>) -> Result<Self, WireError> {
        let found = from.u8("how it ends")?;
        from.end()?;
        match found {
            0 => Ok(Self::Pause),
            1 => Ok(Self::End),
            _ => Err(WireError::Value { what: "how it ends", found: found.into() }),
        }
    }
}
