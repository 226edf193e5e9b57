//! Files that can be read while they are written, and after their writer was killed.

use super::super::error::LibraryError;
use super::super::received::NumberType;
use super::guarded;
use ::hdf5::format::messages::filter::FilterPipeline;
use ::hdf5::swmr::SwmrFileWriter;
use ::hdf5::{DatatypeMessage, H5Type};
use std::path::Path;

/// Number types of growing data sets; elements are handed over least significant byte first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::capture) enum ElementType {
    /// Unsigned, 8 bits: text.
    U8,
    /// Signed, 16 bits.
    I16,
    /// Signed, 32 bits.
    I32,
    /// Signed, 64 bits.
    I64,
    /// Unsigned, 32 bits.
    U32,
    /// IEEE single precision.
    F32,
    /// IEEE double precision.
    F64,
}

impl ElementType {
    /// Bytes of one element.
    pub(in crate::capture) fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::F64 => 8,
        }
    }

    fn datatype(self) -> DatatypeMessage {
        match self {
            Self::U8 => u8::hdf5_type(),
            Self::I16 => i16::hdf5_type(),
            Self::I32 => i32::hdf5_type(),
            Self::I64 => i64::hdf5_type(),
            Self::U32 => u32::hdf5_type(),
            Self::F32 => f32::hdf5_type(),
            Self::F64 => f64::hdf5_type(),
        }
    }
}

impl From<NumberType> for ElementType {
    fn from(kind: NumberType) -> Self {
        match kind {
            NumberType::I16 => Self::I16,
            NumberType::I32 => Self::I32,
            NumberType::F32 => Self::F32,
            NumberType::F64 => Self::F64,
        }
    }
}

/// A file being recorded: everything is declared first, then samples are added and flushed.
///
/// A reader sees what was there at the last [`RecordingFile::flush`], also after a kill.
pub(in crate::capture) struct RecordingFile {
    inner: SwmrFileWriter,
}

impl RecordingFile {
    /// Makes the file anew.
    pub(in crate::capture) fn create(path: &Path) -> Result<Self, LibraryError> {
        let locking = ::hdf5::FileLocking::BestEffort;
        guarded(|| SwmrFileWriter::create_with_locking(path, locking)).map(|inner| Self { inner })
    }

    pub(in crate::capture) fn text(&mut self, name: &str, value: &str) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_group_attr_string("/", name, value))
    }

    pub(in crate::capture) fn number<T: H5Type>(
        &mut self,
        name: &str,
        value: T,
    ) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_group_attr_numeric("/", name, &value))
    }

    /// Makes a group below the root.
    pub(in crate::capture) fn group(&mut self, name: &str) -> Result<(), LibraryError> {
        guarded(|| self.inner.create_group("/", name))
    }

    /// Makes an empty data set that grows by chunks; gives its number. `level`: shuffle and gzip.
    pub(in crate::capture) fn column(
        &mut self,
        group: &str,
        name: &str,
        element: ElementType,
        chunk: u64,
        level: Option<u32>,
    ) -> Result<usize, LibraryError> {
        let width = u32::try_from(element.bytes()).unwrap_or(1);
        let pipeline = level.map(|level| FilterPipeline::shuffle_deflate(width, level));
        guarded(|| {
            let full_name = format!("{group}/{name}");
            let (dims, max) = (&[0][..], &[None][..]);
            let column = self.inner.create_grid_dataset_with_max(
                &full_name,
                element.datatype(),
                dims,
                max,
                &[chunk],
                pipeline,
            )?;
            self.inner.assign_dataset_to_group(&format!("/{group}"), column)?;
            Ok::<_, ::hdf5::Hdf5Error>(column)
        })
    }

    pub(in crate::capture) fn column_text(
        &mut self,
        column: usize,
        name: &str,
        value: &str,
    ) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_dataset_attr_string(column, name, value))
    }

    pub(in crate::capture) fn column_number<T: H5Type>(
        &mut self,
        column: usize,
        name: &str,
        value: T,
    ) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_dataset_attr_numeric(column, name, &value))
    }

    /// Ends the declarations: from here on a reader may open the file.
    pub(in crate::capture) fn start(&mut self) -> Result<(), LibraryError> {
        guarded(|| self.inner.start_swmr())
    }

    /// Writes chunk number `chunk` of a column, a whole one, and makes the column `length` long.
    ///
    /// The length moves last: a chunk that cannot be written is never counted.
    pub(in crate::capture) fn chunk(
        &mut self,
        column: usize,
        chunk: u64,
        bytes: &[u8],
        length: u64,
    ) -> Result<(), LibraryError> {
        guarded(|| {
            self.inner.write_chunk_at(column, &[chunk], bytes)?;
            self.inner.set_extent(column, &[length])
        })
    }

    /// Shows readers what was written so far; it is on the disk when this returns.
    pub(in crate::capture) fn flush(&mut self) -> Result<(), LibraryError> {
        guarded(|| self.inner.flush())
    }

    /// Completes the file: it opens everywhere, as any other.
    pub(in crate::capture) fn close(self) -> Result<(), LibraryError> {
        guarded(|| self.inner.close())
    }
}

#[cfg(test)]
impl super::NewFile {
    /// As the libraries of 1.6 wrote it: symbol tables, no checksums.
    pub(in crate::capture) fn create_as_of_1_6(path: &Path) -> Self {
        let options = ::hdf5::H5File::options().libver(::hdf5::LibverBound::Earliest);
        Self { inner: options.create(path).unwrap() }
    }
}
