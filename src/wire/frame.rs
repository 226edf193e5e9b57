//! Frames in a stream of bytes: header, length, checksum.

use super::cursor::{Cursor, at_most};
use super::{
    Ack, Block, Bye, HEADER_BYTES, Hello, MAGIC, MAX_PAYLOAD_BYTES, Message, Problem, VERSION,
    Welcome, WireError,
};

const HELLO: u8 = 1;
const WELCOME: u8 = 2;
const BLOCK: u8 = 3;
const ACK: u8 = 4;
const PROBLEM: u8 = 5;
const BYE: u8 = 6;
const PING: u8 = 7;

/// Bytes that the checksum covers before the payload.
const COVERED_BYTES: usize = 8;

/// Room that is made for what comes next, bytes.
const STEP_BYTES: usize = 64 << 10;

/// Appends a frame to `out`.
///
/// # Errors
/// When something is longer than the protocol takes; `out` is as it was then.
pub fn encode(message: &Message<'_>, out: &mut Vec<u8>) -> Result<(), WireError> {
    let begin = out.len();
    out.extend_from_slice(&MAGIC);
    out.push(VERSION);
    out.push(kind(message));
    out.extend_from_slice(&[0; HEADER_BYTES - 4]);
    let written = match message {
        Message::Hello(hello) => hello.write(out),
        Message::Welcome(welcome) => welcome.write(out),
        Message::Block(block) => block.write(out),
        Message::Ack(ack) => ack.write(out),
        Message::Problem(problem) => problem.write(out),
        Message::Bye(bye) => {
            bye.write(out);
            Ok(())
        }
        Message::Ping => Ok(()),
    };
    let n = out.len() - begin - HEADER_BYTES;
    let fits = written.and_then(|()| at_most("a payload", n as u64, MAX_PAYLOAD_BYTES as u64));
    if let Err(error) = fits {
        out.truncate(begin);
        return Err(error);
    }
    let n = u32::try_from(n).unwrap_or(u32::MAX); // below the limit
    out[begin + 4..begin + COVERED_BYTES].copy_from_slice(&n.to_le_bytes());
    let checksum = checksum(&out[begin..]);
    out[begin + COVERED_BYTES..begin + HEADER_BYTES].copy_from_slice(&checksum.to_le_bytes());
    Ok(())
}

fn kind(message: &Message<'_>) -> u8 {
    match message {
        Message::Hello(_) => HELLO,
        Message::Welcome(_) => WELCOME,
        Message::Block(_) => BLOCK,
        Message::Ack(_) => ACK,
        Message::Problem(_) => PROBLEM,
        Message::Bye(_) => BYE,
        Message::Ping => PING,
    }
}

/// CRC-32C of a frame but for the checksum itself.
fn checksum(frame: &[u8]) -> u32 {
    let covered = crc32c::crc32c(&frame[..COVERED_BYTES]);
    crc32c::crc32c_append(covered, &frame[HEADER_BYTES..])
}

/// Bytes as they arrive, cut into frames. It holds a frame at most, and what one read brings.
#[derive(Debug, Default)]
pub struct Frames {
    bytes: Vec<u8>,
    /// First byte that was not handed out, and one past the last that arrived.
    begin: usize,
    end: usize,
}

impl Frames {
    /// Room for bytes to come.
    pub fn space(&mut self) -> &mut [u8] {
        if self.begin == self.end {
            (self.begin, self.end) = (0, 0);
        }
        if self.bytes.len() - self.end < STEP_BYTES / 2 {
            self.bytes.copy_within(self.begin..self.end, 0);
            (self.begin, self.end) = (0, self.end - self.begin);
        }
        if self.bytes.len() - self.end < STEP_BYTES / 2 {
            // No further than a frame needs: `take` refuses a longer one before it comes here.
            self.bytes.resize(self.end + STEP_BYTES.max(self.end), 0);
        }
        &mut self.bytes[self.end..]
    }

    /// So many bytes have come into [`Self::space`].
    pub fn filled(&mut self, n: usize) {
        self.end = (self.end + n).min(self.bytes.len());
    }

    /// Takes bytes that are there already.
    pub fn push(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let space = self.space();
            let n = space.len().min(bytes.len());
            space[..n].copy_from_slice(&bytes[..n]);
            self.filled(n);
            bytes = &bytes[n..];
        }
    }

    /// Whether a part of a frame is there, and the rest is not.
    #[must_use]
    pub fn is_within(&self) -> bool {
        self.begin < self.end
    }

    /// Bytes of memory held.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.bytes.capacity()
    }

    /// The next frame with its length, if it is there as a whole.
    ///
    /// # Errors
    /// When the bytes are no frame; nothing that follows can be one then.
    pub fn take(&mut self) -> Result<Option<(Message<'_>, usize)>, WireError> {
        let there = &self.bytes[self.begin..self.end];
        let Some(n) = frame_bytes(there)?.filter(|n| *n <= there.len()) else { return Ok(None) };
        let frame = &self.bytes[self.begin..self.begin + n];
        self.begin += n;
        Ok(Some((decode(frame)?, n)))
    }
}

/// Length of the frame that these bytes begin; `None`: more must come before that is known.
fn frame_bytes(bytes: &[u8]) -> Result<Option<usize>, WireError> {
    if let Some(found) = bytes.first_chunk::<2>()
        && *found != MAGIC
    {
        return Err(WireError::Magic { found: *found });
    }
    if let Some(&found) = bytes.get(2)
        && found != VERSION
    {
        return Err(WireError::Version { found });
    }
    if let Some(&found) = bytes.get(3)
        && !(HELLO..=PING).contains(&found)
    {
        return Err(WireError::Kind { found });
    }
    let Some(length) = bytes.get(4..).and_then(|rest| rest.first_chunk::<4>()) else {
        return Ok(None);
    };
    let length = u32::from_le_bytes(*length);
    at_most("a payload", length.into(), MAX_PAYLOAD_BYTES as u64)?;
    Ok(Some(HEADER_BYTES + usize::try_from(length).unwrap_or(usize::MAX)))
}

/// Reads a frame of the right length.
fn decode(frame: &[u8]) -> Result<Message<'_>, WireError> {
    let mut header = Cursor(&frame[COVERED_BYTES..HEADER_BYTES]);
    let (stated, computed) = (header.u32("the checksum")?, checksum(frame));
    if stated != computed {
        return Err(WireError::Checksum { stated, computed });
    }
    let payload = Cursor(&frame[HEADER_BYTES..]);
    match frame[3] {
        HELLO => Hello::read(payload).map(Message::Hello),
        WELCOME => Welcome::read(payload).map(Message::Welcome),
        BLOCK => Block::read(payload).map(Message::Block),
        ACK => Ack::read(payload).map(Message::Ack),
        PROBLEM => Problem::read(payload).map(Message::Problem),
        BYE => Bye::read(payload).map(Message::Bye),
        PING => payload.end().map(|()| Message::Ping),
        found => Err(WireError::Kind { found }),
    }
}
