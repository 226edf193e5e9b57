//! The chunks of a WAV file: what the samples are and where they stand. Nothing declared is
//! believed before it is held against the file's length.

use std::io::{self, Read, Seek, SeekFrom};

/// Channels of a file at most.
const CHANNELS_MAX: u16 = 1024;

/// Chunks looked at.
const CHUNKS_MAX: usize = 1000;

/// Format codes.
const PCM: u16 = 1;
const FLOAT: u16 = 3;
const EXTENSIBLE: u16 = 0xfffe;

/// How a sample is stored, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Unsigned, silence at 128.
    U8,
    I16,
    /// Three bytes.
    I24,
    I32,
    F32,
    F64,
}

impl Encoding {
    /// Bytes of a sample.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::I24 => 3,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Name for people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::U8 => "8-bit integers",
            Self::I16 => "16-bit integers",
            Self::I24 => "24-bit integers",
            Self::I32 => "32-bit integers",
            Self::F32 => "32-bit floats",
            Self::F64 => "64-bit floats",
        }
    }
}

/// A WAV file without its samples.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) n_channels: u16,
    pub(super) rate_hz: u32,
    /// Byte at which the samples begin, and samples of each channel.
    pub(super) data_at: u64,
    pub(super) n_frames: u64,
    /// What was not as it should be.
    pub(super) notes: Vec<String>,
}

/// Why the samples cannot be found.
#[derive(Debug)]
pub(super) enum HeaderError {
    Io(io::Error),
    /// What is wrong, and the remedy.
    Problem(String),
}

impl From<io::Error> for HeaderError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

fn problem<T>(text: String) -> Result<T, HeaderError> {
    Err(HeaderError::Problem(text))
}

/// The chunk `fmt `.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Format {
    encoding: Encoding,
    n_channels: u16,
    rate_hz: u32,
}

/// Walks the chunks up to the samples.
pub(super) fn read<R: Read + Seek>(file: &mut R, file_bytes: u64) -> Result<Header, HeaderError> {
    let mut at = 12_u64; // behind RIFF, length, WAVE
    let mut format = None;
    for _ in 0..CHUNKS_MAX {
        let Some((id, length)) = chunk(file, at, file_bytes)? else { break };
        let begin = at + 8;
        match &id {
            b"fmt " => format = Some(read_format(file, begin, u64::from(length), file_bytes)?),
            b"data" => {
                let Some(format) = format else {
                    return problem(
                        "the samples come before their format (chunk fmt); take the original"
                            .into(),
                    );
                };
                return data(file, format, begin, length, file_bytes);
            }
            _ => {}
        }
        at = begin + u64::from(length) + u64::from(length % 2);
    }
    problem("no samples: no chunk \"data\"; the recording was cut off, take it again".to_owned())
}

/// Name and declared length of the chunk at `at`; `None` past the end.
fn chunk<R: Read + Seek>(
    file: &mut R,
    at: u64,
    file_bytes: u64,
) -> io::Result<Option<([u8; 4], u32)>> {
    if at + 8 > file_bytes {
        return Ok(None);
    }
    let (mut id, mut length) = ([0; 4], [0; 4]);
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(&mut id)?;
    file.read_exact(&mut length)?;
    Ok(Some((id, u32::from_le_bytes(length))))
}

fn read_format<R: Read + Seek>(
    file: &mut R,
    begin: u64,
    length: u64,
    file_bytes: u64,
) -> Result<Format, HeaderError> {
    if length < 16 || begin + length > file_bytes {
        return problem(format!(
            "the format (chunk fmt) is {length} bytes long, of 16 or more; take the original"
        ));
    }
    let mut bytes = [0; 40];
    let n_bytes = usize::try_from(length).unwrap_or(40).min(40);
    file.seek(SeekFrom::Start(begin))?;
    file.read_exact(&mut bytes[..n_bytes])?;
    let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let rate_hz = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]);
    let (stated, n_channels, frame_bytes, bits) = (u16_at(0), u16_at(2), u16_at(12), u16_at(14));
    let code = if stated == EXTENSIBLE && n_bytes == 40 { u16_at(24) } else { stated };
    let encoding = match (code, bits) {
        (PCM, 1..=8) => Encoding::U8,
        (PCM, 9..=16) => Encoding::I16,
        (PCM, 17..=24) => Encoding::I24,
        (PCM, 25..=32) => Encoding::I32,
        (FLOAT, 32) => Encoding::F32,
        (FLOAT, 64) => Encoding::F64,
        _ => {
            return problem(format!(
                "samples of {bits} bits in format {code}; read are integers (1) of 8 to 32 bits and floats (3) of 32 \
                 or 64; convert it, e.g. sox in.wav -e signed -b 24 out.wav"
            ));
        }
    };
    if !(1..=CHANNELS_MAX).contains(&n_channels) {
        return problem(format!(
            "{n_channels} channels; allowed: 1 to {CHANNELS_MAX}; take the original"
        ));
    }
    let expected = usize::from(n_channels) * encoding.bytes();
    if usize::from(frame_bytes) != expected {
        return problem(format!(
            "{frame_bytes} bytes for a sample of each channel, where {n_channels} channels of {} take {expected}; \
             take the original",
            encoding.name()
        ));
    }
    Ok(Format { encoding, n_channels, rate_hz })
}

/// Holds the declared length of the samples against the file.
fn data<R: Read + Seek>(
    file: &mut R,
    format: Format,
    begin: u64,
    declared: u32,
    file_bytes: u64,
) -> Result<Header, HeaderError> {
    let room = file_bytes.saturating_sub(begin);
    let frame_bytes = u64::from(format.n_channels) * format.encoding.bytes() as u64;
    let mut notes = Vec::new();
    let length = match declared {
        // A recorder that was killed, or that wrote into a pipe, never learned the length.
        0 if room == 0 || chunks_to_the_end(file, begin, file_bytes)? => 0,
        0 | u32::MAX => {
            notes.push(format!(
                "the header states {declared} bytes of samples, as of a recorder that was killed: all {room} to the \
                 end of the file are read"
            ));
            room
        }
        _ if u64::from(declared) > room => {
            return problem(format!(
                "the header states {declared} bytes of samples, the file has {room}: cut off; take the original, or \
                 make the header fit, e.g. sox --ignore-length in.wav out.wav"
            ));
        }
        _ => u64::from(declared),
    };
    notes.extend(unread(file, (begin, length), file_bytes)?);
    let rest = length % frame_bytes;
    if rest > 0 {
        notes.push(format!("{rest} bytes at the end are no sample of every channel and not used"));
    }
    let n_frames = length / frame_bytes;
    if n_frames == 0 {
        return problem("no samples: the chunk \"data\" is empty; record again".to_owned());
    }
    let Format { encoding, n_channels, rate_hz } = format;
    Ok(Header { encoding, n_channels, rate_hz, data_at: begin, n_frames, notes })
}

/// What stands behind the samples if that is no chunks; an error if it must be samples too.
fn unread<R: Read + Seek>(
    file: &mut R,
    (begin, length): (u64, u64),
    file_bytes: u64,
) -> Result<Option<String>, HeaderError> {
    let end = begin + length + length % 2;
    let n_unread = file_bytes.saturating_sub(end);
    if length == 0 || n_unread == 0 || chunks_to_the_end(file, end, file_bytes)? {
        return Ok(None);
    }
    if n_unread > length {
        return problem(format!(
            "the header states {length} bytes of samples, {n_unread} bytes follow that are no chunks: a length over \
             4 GB is stated without its upper digits; make the header fit, e.g. sox --ignore-length in.wav out.wav"
        ));
    }
    let note = format!(
        "behind the {length} bytes of samples that the header states are {n_unread} more that are no chunks: not used"
    );
    Ok(Some(note))
}

/// Whether chunks follow one another exactly to the end of the file.
fn chunks_to_the_end<R: Read + Seek>(
    file: &mut R,
    mut at: u64,
    file_bytes: u64,
) -> io::Result<bool> {
    for _ in 0..CHUNKS_MAX {
        let Some((id, length)) = chunk(file, at, file_bytes)? else { break };
        if !id.iter().all(|byte| matches!(byte, b' '..=b'~')) {
            return Ok(false);
        }
        at += 8 + u64::from(length) + u64::from(length % 2);
    }
    Ok(at == file_bytes)
}
