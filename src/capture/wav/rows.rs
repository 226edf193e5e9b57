//! Samples of a WAV file, frame after frame.

use super::super::error::CaptureError;
use super::super::received::RawSamples;
use super::super::rows::Rows;
use super::header::Encoding;
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;

/// Bytes taken from the file at once.
const FETCH_BYTES: usize = 256 << 10;

/// Rows of a file that stands at its first sample.
pub(super) struct WavRows {
    pub(super) path: PathBuf,
    pub(super) file: File,
    pub(super) encoding: Encoding,
    pub(super) n_channels: usize,
    /// Column of each channel.
    pub(super) columns: Vec<usize>,
}

impl Rows for WavRows {
    fn read(&mut self, _start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError> {
        let io = |source| CaptureError::Io { file: self.path.clone(), action: "read it", source };
        let frame_bytes = self.n_channels * self.encoding.bytes();
        let frames_at_once = (FETCH_BYTES / frame_bytes).max(1);
        let mut left = usize::try_from(count).unwrap_or(usize::MAX);
        let mut read: Vec<RawSamples> = self.columns.iter().map(|_| empty(self.encoding)).collect();
        let mut bytes = vec![0; frames_at_once.min(left) * frame_bytes];
        while left > 0 {
            let part = &mut bytes[..frames_at_once.min(left) * frame_bytes];
            self.file.read_exact(part).map_err(io)?;
            for (samples, &column) in read.iter_mut().zip(&self.columns) {
                append(samples, part, self.encoding, column, self.n_channels);
            }
            left -= part.len() / frame_bytes;
        }
        Ok(read)
    }
}

/// No samples, in the native type of an encoding.
fn empty(encoding: Encoding) -> RawSamples {
    match encoding {
        Encoding::U8 | Encoding::I16 => RawSamples::I16(Vec::new()),
        Encoding::I24 | Encoding::I32 => RawSamples::I32(Vec::new()),
        Encoding::F32 => RawSamples::F32(Vec::new()),
        Encoding::F64 => RawSamples::F64(Vec::new()),
    }
}

/// Appends the samples of one column of whole frames.
fn append(to: &mut RawSamples, part: &[u8], encoding: Encoding, column: usize, n_channels: usize) {
    match (to, encoding) {
        (RawSamples::I16(to), Encoding::U8) => {
            decode(to, part, column, n_channels, |[b]| i16::from(b) - 128);
        }
        (RawSamples::I16(to), _) => decode(to, part, column, n_channels, i16::from_le_bytes),
        (RawSamples::I32(to), Encoding::I24) => {
            // The sign comes with the shift back.
            let widen = |[a, b, c]: [u8; 3]| i32::from_le_bytes([0, a, b, c]) >> 8;
            decode(to, part, column, n_channels, widen);
        }
        (RawSamples::I32(to), _) => decode(to, part, column, n_channels, i32::from_le_bytes),
        (RawSamples::F32(to), _) => decode(to, part, column, n_channels, f32::from_le_bytes),
        (RawSamples::F64(to), _) => decode(to, part, column, n_channels, f64::from_le_bytes),
    }
}

fn decode<const N: usize, T>(
    to: &mut Vec<T>,
    part: &[u8],
    column: usize,
    n_channels: usize,
    value: impl Fn([u8; N]) -> T,
) {
    let (samples, _) = part.as_chunks::<N>();
    to.extend(samples.iter().skip(column).step_by(n_channels).map(|bytes| value(*bytes)));
}
