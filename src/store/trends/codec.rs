//! Numbers and texts as bytes: byte-shuffled and deflated, checked when they are read.
//!
//! Bytes of equal weight stand together, so that the signs and exponents of a slowly varying feature
//! become runs. The zlib container holds a checksum; what is read must have exactly the expected length.

use flate2::Compress;
use flate2::Compression;
use flate2::Decompress;
use flate2::FlushCompress;
use flate2::FlushDecompress;
use flate2::Status;

/// Longest row that is read: far above what a minute of a machine can be.
const MAX_BYTES: usize = 256 << 20;

/// Bytes a zlib stream may add.
const OVERHEAD: usize = 1024;

/// Deflates; keeps its tables from row to row.
pub(super) struct Deflater(Compress);

impl std::fmt::Debug for Deflater {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Deflater").finish_non_exhaustive()
    }
}

impl Deflater {
    pub(super) fn new() -> Self {
        Self(Compress::new(Compression::fast(), true))
    }

    /// The zlib stream of some bytes; `None`: the library failed, which memory alone can make it do.
    pub(super) fn deflate(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        self.0.reset();
        let mut out = Vec::with_capacity(bytes.len() + bytes.len() / 8 + OVERHEAD);
        let done = self.0.compress_vec(bytes, &mut out, FlushCompress::Finish).ok()?;
        (done == Status::StreamEnd).then_some(out)
    }
}

/// Reads a zlib stream that holds exactly `len` bytes.
pub(super) fn inflate(bytes: &[u8], len: usize) -> Option<Vec<u8>> {
    if len > MAX_BYTES {
        return None;
    }
    // A byte more than declared shows that there is more.
    let mut out = Vec::with_capacity(len + 1);
    let mut state = Decompress::new(true);
    let done = state.decompress_vec(bytes, &mut out, FlushDecompress::Finish).ok()?;
    (done == Status::StreamEnd && out.len() == len).then_some(out)
}

/// Puts bytes of equal place in their number together.
pub(super) fn shuffle(bytes: &[u8], width: usize, out: &mut Vec<u8>) {
    for place in 0..width {
        out.extend(bytes.iter().skip(place).step_by(width));
    }
}

fn unshuffle(bytes: &[u8], width: usize) -> Vec<u8> {
    let n = bytes.len() / width;
    let mut out = vec![0; n * width];
    for (place, plane) in bytes.chunks_exact(n.max(1)).take(width).enumerate() {
        for (to, byte) in out.iter_mut().skip(place).step_by(width).zip(plane) {
            *to = *byte;
        }
    }
    out
}

/// Columns of f32, shuffled as a whole and deflated.
pub(super) fn write_f32(deflater: &mut Deflater, columns: &[Vec<f32>]) -> Option<Vec<u8>> {
    let plain: Vec<u8> = columns.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let mut shuffled = Vec::with_capacity(plain.len());
    shuffle(&plain, 4, &mut shuffled);
    deflater.deflate(&shuffled)
}

/// Reads what [`write_f32`] wrote: so many columns of `n` values.
pub(super) fn read_f32(bytes: &[u8], n_columns: usize, n: usize) -> Option<Vec<Vec<f32>>> {
    let len = n_columns.checked_mul(n)?.checked_mul(4)?;
    let plain = unshuffle(&inflate(bytes, len)?, 4);
    if n == 0 {
        return Some(vec![Vec::new(); n_columns]);
    }
    let column = |bytes: &[u8]| {
        let values = bytes.as_chunks::<4>().0;
        values.iter().map(|value| f32::from_le_bytes(*value)).collect()
    };
    Some(plain.chunks_exact(4 * n).map(column).collect())
}

/// Writes a row of several columns.
#[derive(Debug, Default)]
pub(super) struct Writer(Vec<u8>);

impl Writer {
    pub(super) fn u32(&mut self, value: usize) {
        // Counts of a minute are small; a larger one is refused when it is read.
        self.0.extend(u32::try_from(value).unwrap_or(u32::MAX).to_le_bytes());
    }

    pub(super) fn text(&mut self, text: &str) {
        self.u32(text.len());
        self.0.extend(text.as_bytes());
    }

    /// A column of numbers with its length.
    pub(super) fn u16s(&mut self, values: &[u16]) {
        self.u32(values.len());
        let plain: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        shuffle(&plain, 2, &mut self.0);
    }

    pub(super) fn i64s(&mut self, values: &[i64]) {
        self.u32(values.len());
        let plain: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        shuffle(&plain, 8, &mut self.0);
    }

    pub(super) fn f64s(&mut self, values: &[f64]) {
        let bits: Vec<i64> = values.iter().map(|value| value.to_bits().cast_signed()).collect();
        self.i64s(&bits);
    }

    /// The row: its length, then what was written, deflated.
    pub(super) fn finish(self, deflater: &mut Deflater) -> Option<Vec<u8>> {
        let mut out = u32::try_from(self.0.len()).ok()?.to_le_bytes().to_vec();
        out.extend(deflater.deflate(&self.0)?);
        Some(out)
    }
}

/// Reads a row of several columns.
#[derive(Debug)]
pub(super) struct Reader {
    bytes: Vec<u8>,
    at: usize,
}

impl Reader {
    pub(super) fn new(row: &[u8]) -> Option<Self> {
        let (len, body) = row.split_first_chunk::<4>()?;
        let len = usize::try_from(u32::from_le_bytes(*len)).ok()?;
        Some(Self { bytes: inflate(body, len)?, at: 0 })
    }

    fn take(&mut self, n: usize) -> Option<&[u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(n)?)?;
        self.at += n;
        Some(taken)
    }

    pub(super) fn u32(&mut self) -> Option<usize> {
        let bytes = self.take(4)?.first_chunk::<4>()?;
        usize::try_from(u32::from_le_bytes(*bytes)).ok()
    }

    pub(super) fn text(&mut self) -> Option<String> {
        let n = self.u32()?;
        String::from_utf8(self.take(n)?.to_vec()).ok()
    }

    pub(super) fn u16s(&mut self) -> Option<Vec<u16>> {
        let n = self.u32()?;
        let plain = unshuffle(self.take(n.checked_mul(2)?)?, 2);
        Some(plain.as_chunks::<2>().0.iter().map(|value| u16::from_le_bytes(*value)).collect())
    }

    pub(super) fn i64s(&mut self) -> Option<Vec<i64>> {
        let n = self.u32()?;
        let plain = unshuffle(self.take(n.checked_mul(8)?)?, 8);
        Some(plain.as_chunks::<8>().0.iter().map(|value| i64::from_le_bytes(*value)).collect())
    }

    pub(super) fn f64s(&mut self) -> Option<Vec<f64>> {
        Some(self.i64s()?.into_iter().map(|bits| f64::from_bits(bits.cast_unsigned())).collect())
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.bytes.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn any_floats_come_back_bit_by_bit(
            bits in prop::collection::vec(any::<u32>(), 0..300),
            n_columns in 1_usize..7,
        ) {
            let n = bits.len() / n_columns;
            let columns: Vec<Vec<f32>> = (0..n_columns)
                .map(|c| bits[c * n..(c + 1) * n].iter().map(|b| f32::from_bits(*b)).collect())
                .collect();
            let row = write_f32(&mut Deflater::new(), &columns).unwrap();
            let back = read_f32(&row, n_columns, n).unwrap();
            let of = |columns: &[Vec<f32>]| -> Vec<Vec<u32>> {
                columns.iter().map(|c| c.iter().map(|v| v.to_bits()).collect()).collect()
            };
            prop_assert_eq!(of(&back), of(&columns));
            // Of another shape it is no row at all.
            prop_assert!(read_f32(&row, n_columns, n + 1).is_none());
        }

        #[test]
        fn a_row_comes_back_and_a_damaged_one_is_refused(
            numbers in prop::collection::vec(any::<i64>(), 0..50),
            text in "\\PC{0,40}",
            flipped in any::<prop::sample::Index>(),
        ) {
            let mut writer = Writer::default();
            writer.text(&text);
            writer.i64s(&numbers);
            let floats: Vec<f64> = numbers.iter().map(|n| f64::from_bits(n.cast_unsigned())).collect();
            writer.f64s(&floats);
            let row = writer.finish(&mut Deflater::new()).unwrap();
            let read = |row: &[u8]| {
                let mut reader = Reader::new(row)?;
                let (text, i, f) = (reader.text()?, reader.i64s()?, reader.f64s()?);
                let bits: Vec<u64> = f.iter().map(|v| v.to_bits()).collect();
                reader.is_at_end().then_some((text, i, bits))
            };
            let bits: Vec<u64> = floats.iter().map(|v| v.to_bits()).collect();
            prop_assert_eq!(read(&row), Some((text, numbers, bits)));
            let mut damaged = row.clone();
            let place = flipped.index(row.len());
            damaged[place] ^= 0x55;
            prop_assert!(read(&damaged).is_none() || read(&damaged) == read(&row));
        }
    }
}
