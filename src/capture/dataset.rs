//! A one-dimensional HDF5 data set as a table of one column.

use super::error::{CaptureError, LibraryError};
use super::hdf5::Dataset;
use super::received::{NumberType, RawSamples};
use super::rows::Rows;
use std::path::PathBuf;

/// Rows of a one-dimensional data set.
pub(super) struct DatasetRows {
    pub(super) file: PathBuf,
    /// Path inside the file.
    pub(super) object: String,
    pub(super) dataset: Dataset,
    pub(super) kind: NumberType,
}

impl Rows for DatasetRows {
    fn read(&mut self, start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError> {
        let raw = read(&self.dataset, self.kind, start, count).map_err(|source| {
            CaptureError::Library { file: self.file.clone(), object: self.object.clone(), source }
        })?;
        Ok(vec![raw])
    }
}

/// Reads `count` elements of a data set, as stored.
pub(super) fn read(
    dataset: &Dataset,
    kind: NumberType,
    start: u64,
    count: u64,
) -> Result<RawSamples, LibraryError> {
    let (start, count) = (to_usize(start), to_usize(count));
    Ok(match kind {
        NumberType::F32 => RawSamples::F32(dataset.slice(start, count)?),
        NumberType::F64 => RawSamples::F64(dataset.slice(start, count)?),
        NumberType::I16 => RawSamples::I16(dataset.slice(start, count)?),
        NumberType::I32 => RawSamples::I32(dataset.slice(start, count)?),
    })
}

/// Sample counts come from data set shapes, which are `usize`.
pub(super) fn to_usize(count: u64) -> usize {
    usize::try_from(count).unwrap_or(usize::MAX)
}
