//! A growing column of a file: gathers elements to whole chunks and sums them up.

use super::super::error::LibraryError;
use super::super::hdf5::RecordingFile;
use super::super::received::RawSamples;

/// One data set being filled.
#[derive(Debug)]
pub(super) struct Column {
    /// Number of the data set.
    pub(super) dataset: usize,
    /// Bytes of an element.
    width: usize,
    /// Bytes of a chunk.
    chunk_bytes: usize,
    /// Whether chunks are stored only when they are full: a packed chunk cannot grow in place.
    whole_only: bool,
    /// Whole chunks stored.
    n_whole: u64,
    /// Elements behind them, as bytes.
    pending: Vec<u8>,
    /// How much of `pending` is stored.
    n_stored: usize,
}

impl Column {
    pub(super) fn new(dataset: usize, width: usize, chunk: u64, whole_only: bool) -> Self {
        let chunk_bytes = usize::try_from(chunk).unwrap_or(usize::MAX).saturating_mul(width);
        Self {
            dataset,
            width,
            chunk_bytes,
            whole_only,
            n_whole: 0,
            pending: Vec::new(),
            n_stored: 0,
        }
    }

    /// Elements taken so far.
    pub(super) fn length(&self) -> u64 {
        self.whole_length() + (self.pending.len() / self.width) as u64
    }

    /// Elements that are in the file, as far as it was flushed since.
    pub(super) fn stored(&self) -> u64 {
        self.whole_length() + (self.n_stored / self.width) as u64
    }

    /// Elements of a chunk.
    pub(super) fn chunk(&self) -> u64 {
        (self.chunk_bytes / self.width) as u64
    }

    /// Chunks of the file, a part of one counted whole.
    pub(super) fn n_chunks(&self) -> u64 {
        self.n_whole + u64::from(!self.pending.is_empty())
    }

    fn whole_length(&self) -> u64 {
        self.n_whole * self.chunk()
    }

    /// Adds elements; stores chunks that are full and gives the CRC-32 of each.
    pub(super) fn push(
        &mut self,
        file: &mut RecordingFile,
        mut bytes: &[u8],
    ) -> Result<Vec<u32>, LibraryError> {
        let mut sums = Vec::new();
        while !bytes.is_empty() {
            let room = self.chunk_bytes - self.pending.len();
            let (taken, left) = bytes.split_at(room.min(bytes.len()));
            self.pending.extend_from_slice(taken);
            bytes = left;
            if self.pending.len() == self.chunk_bytes {
                let length = (self.n_whole + 1) * self.chunk();
                file.chunk(self.dataset, self.n_whole, &self.pending, length)?;
                sums.push(crc32fast::hash(&self.pending));
                self.n_whole += 1;
                self.n_stored = 0;
                self.pending.clear();
            }
        }
        Ok(sums)
    }

    /// Stores the part of a chunk that is there; `last`: also if only whole ones are stored.
    pub(super) fn store(
        &mut self,
        file: &mut RecordingFile,
        last: bool,
    ) -> Result<(), LibraryError> {
        let is_new = self.pending.len() > self.n_stored;
        if !is_new || (self.whole_only && !last) {
            return Ok(());
        }
        let (used, length) = (self.pending.len(), self.length());
        self.pending.resize(self.chunk_bytes, 0);
        let stored = file.chunk(self.dataset, self.n_whole, &self.pending, length);
        self.pending.truncate(used);
        stored?;
        self.n_stored = used;
        Ok(())
    }
}

/// The bytes of raw samples, least significant first.
pub(super) fn little_endian(raw: &RawSamples) -> Vec<u8> {
    match raw {
        RawSamples::F32(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::F64(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::I16(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::I32(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
    }
}
