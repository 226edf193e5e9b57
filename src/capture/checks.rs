//! What attributes and data sets may declare: types, limits, and the errors that name them.

use super::error::{CaptureError, LibraryError};
use super::filters;
use super::hdf5::{Attribute, Dataset, Storage};
use std::path::Path;

/// Bytes of an attribute's text at most.
const TEXT_BYTES_MAX: usize = 1 << 20;

/// Uncompressed bytes of one chunk of every channel together at most: they are held at once.
const CHUNK_BYTES_MAX: u64 = 64 << 20;

/// Chunks of a capture at most; each costs about 100 bytes of index in memory.
const CHUNKS_MAX: u64 = 1_000_000;

/// Uncompressed size over file size at most (deflate reaches 1032), beyond `SMALL_BYTES`.
const EXPANSION_MAX: u64 = 2000;

/// Uncompressed size that is always allowed, bytes.
const SMALL_BYTES: u64 = 64 << 20;

/// What the chunks seen so far add up to.
#[derive(Debug, Default)]
pub(super) struct Chunks {
    count: u64,
    bytes: u64,
}

/// The checks on one file.
pub(super) struct Checks<'a> {
    pub(super) path: &'a Path,
    pub(super) file_bytes: u64,
}

impl Checks<'_> {
    pub(super) fn bounded_text(
        &self,
        object: &str,
        name: &str,
        text: String,
    ) -> Result<String, CaptureError> {
        if text.len() <= TEXT_BYTES_MAX {
            return Ok(text);
        }
        let what = format!("{object}: bytes of attribute {name}");
        Err(self.limit(what, text.len() as u64, TEXT_BYTES_MAX as u64, "shorten the text"))
    }

    /// Number of elements of a 1-D data set.
    pub(super) fn length(&self, dataset: &Dataset, path: &str) -> Result<u64, CaptureError> {
        match dataset.shape()[..] {
            [length] => Ok(length as u64),
            ref shape => {
                let expected = "one dimension: one data set per channel";
                Err(self.dataset_error(path, &format!("shape {shape:?}"), expected))
            }
        }
    }

    /// Adds a data set of `count` chunks of `bytes` each.
    fn add_chunks(
        &self,
        path: &str,
        count: u64,
        bytes: u64,
        chunks: &mut Chunks,
    ) -> Result<(), CaptureError> {
        chunks.bytes = chunks.bytes.saturating_add(bytes);
        chunks.count = chunks.count.saturating_add(count);
        if chunks.bytes > CHUNK_BYTES_MAX {
            let what = format!("{path}: uncompressed bytes of one chunk of each channel so far");
            let remedy = "store smaller chunks, e.g. h5repack -l CHUNK=65536";
            return Err(self.limit(what, chunks.bytes, CHUNK_BYTES_MAX, remedy));
        }
        if chunks.count > CHUNKS_MAX {
            let what = format!("{path}: number of chunks so far");
            let remedy = "store larger chunks, e.g. h5repack -l CHUNK=65536";
            return Err(self.limit(what, chunks.count, CHUNKS_MAX, remedy));
        }
        Ok(())
    }

    /// Checks what the storage declares; gives the chunk length (1 if not chunked) and a text.
    pub(super) fn storage(
        &self,
        dataset: &Dataset,
        path: &str,
        length: u64,
        element_bytes: usize,
        chunks: &mut Chunks,
    ) -> Result<(u64, String), CaptureError> {
        let (chunk_dims, text) = self.stored(dataset, path, length, element_bytes)?;
        let Some(chunk_dims) = chunk_dims else { return Ok((1, text)) };
        let &[chunk @ 1..=u64::MAX] = &chunk_dims[..] else {
            return Err(self.dataset_error(
                path,
                &format!("chunks of {chunk_dims:?}"),
                "one dimension",
            ));
        };
        self.add_chunks(
            path,
            length.div_ceil(chunk),
            chunk.saturating_mul(element_bytes as u64),
            chunks,
        )?;
        Ok((chunk, text))
    }

    /// The same for a data set of any number of dimensions of which `slab[d]` elements along
    /// dimension d are held at once at least, each as `held_bytes`; gives the elements of a chunk
    /// along each dimension.
    pub(super) fn box_storage(
        &self,
        dataset: &Dataset,
        path: &str,
        (element_bytes, held_bytes): (usize, usize),
        slab: &[u64],
        chunks: &mut Chunks,
    ) -> Result<(Option<Vec<u64>>, String), CaptureError> {
        let shape: Vec<u64> = dataset.shape().iter().map(|&extent| extent as u64).collect();
        let elements = product(&shape);
        let (chunk_dims, text) = self.stored(dataset, path, elements, element_bytes)?;
        let Some(chunk_dims) = chunk_dims else { return Ok((None, text)) };
        if chunk_dims.len() != shape.len() || chunk_dims.contains(&0) {
            let found = format!("chunks of {chunk_dims:?}");
            return Err(self.dataset_error(path, &found, "as many dimensions as the data set"));
        }
        let per_axis = |(&extent, &chunk): (&u64, &u64)| extent.div_ceil(chunk);
        let count: Vec<u64> = shape.iter().zip(&chunk_dims).map(per_axis).collect();
        let held: Vec<u64> = chunk_dims.iter().zip(slab).map(|(&c, &s)| c.max(s)).collect();
        let bytes = product(&held).saturating_mul(element_bytes.max(held_bytes) as u64);
        self.add_chunks(path, product(&count), bytes, chunks)?;
        Ok((Some(chunk_dims), text))
    }

    /// Checks size and filters; gives the elements of a chunk along each dimension, `None` if not
    /// chunked, and a text.
    fn stored(
        &self,
        dataset: &Dataset,
        path: &str,
        length: u64,
        element_bytes: usize,
    ) -> Result<(Option<Vec<u64>>, String), CaptureError> {
        let bytes = length.saturating_mul(element_bytes as u64);
        let holds = format!("at most what {} bytes of file can hold", self.file_bytes);
        let too_long = |this: &Self| {
            this.dataset_error(path, &format!("{length} elements declared, {bytes} bytes"), &holds)
        };
        let (chunk_dims, filters) = match dataset.storage().map_err(|e| self.library(path, e))? {
            Storage::Elsewhere(what) => {
                return Err(self.dataset_error(path, what, "data in this file"));
            }
            Storage::Plain if bytes > self.file_bytes => return Err(too_long(self)),
            Storage::Plain => return Ok((None, "contiguous".into())),
            Storage::Chunked(chunk_dims, filters) => (chunk_dims, filters),
        };
        if bytes > SMALL_BYTES.max(self.file_bytes.saturating_mul(EXPANSION_MAX)) {
            return Err(too_long(self));
        }
        let of: Vec<String> = chunk_dims.iter().map(ToString::to_string).collect();
        let mut text = format!("chunks of {}", of.join(" × "));
        for id in filters {
            let name = filters::filter_name(id).map_err(|found| {
                let expected = "gzip, shuffle, fletcher32, lzf, zstd or another filter of docs/hdf5.md; h5repack converts";
                self.dataset_error(path, &found, expected)
            })?;
            text = format!("{text}, {name}");
        }
        Ok((Some(chunk_dims.iter().map(|&extent| extent as u64).collect()), text))
    }

    pub(super) fn number(
        &self,
        dataset: &Dataset,
        path: &str,
        name: &str,
        expected: &str,
    ) -> Result<Option<f64>, CaptureError> {
        match dataset.attribute(name).map_err(|e| self.library(path, e))? {
            None => Ok(None),
            Some(Attribute::Number(value)) => Ok(Some(value)),
            Some(other) => Err(self.attribute_error(path, name, other.describe(), expected.into())),
        }
    }

    pub(super) fn text(
        &self,
        dataset: &Dataset,
        path: &str,
        name: &str,
    ) -> Result<Option<String>, CaptureError> {
        match dataset.attribute(name).map_err(|e| self.library(path, e))? {
            None => Ok(None),
            Some(Attribute::Text(text)) => self.bounded_text(path, name, text).map(Some),
            Some(other) => Err(self.attribute_error(path, name, other.describe(), "a text".into())),
        }
    }

    pub(super) fn attribute_error(
        &self,
        object: &str,
        name: &str,
        found: String,
        expected: String,
    ) -> CaptureError {
        CaptureError::Attribute {
            file: self.path.into(),
            object: object.into(),
            attribute: name.into(),
            found,
            expected,
        }
    }

    pub(super) fn dataset_error(&self, path: &str, found: &str, expected: &str) -> CaptureError {
        CaptureError::Dataset {
            file: self.path.into(),
            dataset: path.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    pub(super) fn limit(
        &self,
        what: String,
        found: u64,
        limit: u64,
        remedy: &'static str,
    ) -> CaptureError {
        CaptureError::Limit { file: self.path.into(), what, found, limit, remedy }
    }

    pub(super) fn library(&self, object: &str, source: LibraryError) -> CaptureError {
        CaptureError::Library { file: self.path.into(), object: object.into(), source }
    }
}

fn product(extents: &[u64]) -> u64 {
    extents.iter().fold(1, |product, &extent| product.saturating_mul(extent))
}
