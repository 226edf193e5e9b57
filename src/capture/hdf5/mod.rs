//! The HDF5 library behind a narrow door: the only folder that names the crate.
//!
//! Every call is guarded: a panic inside the library becomes a [`LibraryError`]. Nothing here
//! allocates from a declared size; callers ask for slices whose length they have bounded.

mod swmr;

pub(super) use swmr::{ElementType, RecordingFile};

use super::error::LibraryError;
use super::filters::ChunkFilter;
use super::received::NumberType;
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;

pub(super) use ::hdf5::format;
use ::hdf5::format::messages::attribute::AttributeMessage;
pub(super) use ::hdf5::format::messages::datatype::IeeeFormat;
use ::hdf5::{ByteOrder, H5Dataset, H5File};
pub(super) use ::hdf5::{DatatypeMessage, H5Group, H5Type, Hdf5Error, LinkClass};
use ::hdf5::{StorageLayout, VarLenUnicode};

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs a library call; a panic in it becomes an error and prints nothing.
pub(super) fn guarded<T, E: std::fmt::Display>(
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, LibraryError> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !QUIET.get() {
                previous(info);
            }
        }));
    });
    let before = QUIET.replace(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(work));
    QUIET.set(before);
    match outcome {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(LibraryError { message: error.to_string() }),
        Err(payload) => {
            let text = payload
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| payload.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            Err(LibraryError { message: format!("the HDF5 library gave up: {text}") })
        }
    }
}

/// An attribute's value, as far as captures use attributes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Attribute {
    /// Any integer or IEEE float, one element.
    Number(f64),
    /// A fixed or variable-length string.
    Text(String),
    /// Anything else, described.
    Other(String),
}

impl Attribute {
    /// Decodes a numeric value; `None` if the type is a string (whose text lives elsewhere).
    pub(super) fn decode(message: &AttributeMessage) -> Option<Self> {
        Self::from_parts(&message.datatype, &message.data)
    }

    pub(super) fn from_parts(datatype: &DatatypeMessage, data: &[u8]) -> Option<Self> {
        if is_text(datatype) {
            return None;
        }
        Some(match number(datatype, data) {
            Some(value) => Self::Number(value),
            None => Self::Other(format!("{datatype}, {} bytes", data.len())),
        })
    }

    /// Describes the value for an error message.
    pub(super) fn describe(&self) -> String {
        match self {
            Self::Number(value) => format!("{value}"),
            Self::Text(text) => format!("\"{}\"", text.chars().take(60).collect::<String>()),
            Self::Other(text) => text.clone(),
        }
    }
}

fn is_text(datatype: &DatatypeMessage) -> bool {
    matches!(datatype, DatatypeMessage::FixedString { .. } | DatatypeMessage::VarLenString { .. })
}

/// Reads exactly one number of any standard numeric type and byte order.
#[expect(clippy::wildcard_enum_match_arm, reason = "two of the library's many types are numbers")]
#[expect(clippy::cast_possible_wrap, reason = "reinterprets the sign bit, which is meant")]
fn number(datatype: &DatatypeMessage, data: &[u8]) -> Option<f64> {
    let (order, signed) = match datatype {
        DatatypeMessage::FixedPoint { byte_order, signed, bit_offset: 0, .. } => {
            (*byte_order, Some(*signed))
        }
        DatatypeMessage::FloatingPoint { byte_order, .. } => {
            datatype.ieee_format()?;
            (*byte_order, None)
        }
        _ => return None,
    };
    let size = datatype.element_size() as usize;
    if size == 0 || size > 8 || data.len() != size {
        return None;
    }
    let mut bytes = [0_u8; 8];
    bytes[..size].copy_from_slice(data);
    if order == ByteOrder::BigEndian {
        bytes[..size].reverse();
    }
    let bits = u64::from_le_bytes(bytes);
    let shift = 64 - 8 * size;
    match signed {
        Some(true) => Some((((bits << shift) as i64) >> shift) as f64),
        Some(false) => Some(bits as f64),
        None => match datatype.ieee_format()? {
            IeeeFormat::Binary16 => None,
            IeeeFormat::Binary32 => {
                let four = [bytes[0], bytes[1], bytes[2], bytes[3]];
                Some(f64::from(f32::from_le_bytes(four)))
            }
            IeeeFormat::Binary64 => Some(f64::from_bits(bits)),
        },
    }
}

/// An open file, for reading.
pub(super) struct File {
    pub(super) inner: H5File,
}

/// What a name in a group stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Entry {
    /// A data set of this file.
    Dataset,
    /// Anything else of this file.
    Other,
    /// A link that leads out of the file.
    Outside,
    /// There, but the library cannot read it.
    Unreadable(String),
}

impl File {
    pub(super) fn open(path: &Path) -> Result<Self, LibraryError> {
        let inner = guarded(|| H5File::options().best_effort_locking().open(path))?;
        Ok(Self { inner })
    }

    /// Names in the root group, with a trailing `/` on groups.
    pub(super) fn root_names(&self) -> Result<Vec<String>, LibraryError> {
        guarded(|| self.inner.root_group().link_names())
    }

    /// Names and kinds in `group` (one level below the root); `None` if there is no such group.
    pub(super) fn entries(
        &self,
        group: &str,
    ) -> Result<Option<Vec<(String, Entry)>>, LibraryError> {
        let root = self.inner.root_group();
        if !guarded(|| root.group_names())?.iter().any(|name| name == group) {
            return self.no_group(group).map(|()| None);
        }
        guarded(|| {
            let group = root.group(group)?;
            let mut names = group.link_names()?;
            names.sort();
            let datasets = group.dataset_names()?;
            let mut entries = Vec::with_capacity(names.len());
            for name in names {
                let outside =
                    !matches!(group.link_class(&name)?, LinkClass::Hard | LinkClass::Soft { .. });
                let entry = if outside {
                    Entry::Outside
                } else if let Some(reason) = group.unreadable_reason(&name)? {
                    Entry::Unreadable(reason)
                } else if datasets.contains(&name) {
                    Entry::Dataset
                } else {
                    Entry::Other
                };
                entries.push((name, entry));
            }
            Ok::<_, Hdf5Error>(Some(entries))
        })
    }

    /// Tells a group that is not there from one that is linked and cannot be read: an error.
    fn no_group(&self, group: &str) -> Result<(), LibraryError> {
        let root = self.inner.root_group();
        if let Some(message) = guarded(|| root.unreadable_reason(group))? {
            return Err(LibraryError { message });
        }
        let among = |names: Vec<String>| names.iter().any(|name| name == group);
        if among(guarded(|| root.link_names())?) && !among(guarded(|| root.dataset_names())?) {
            let message = "the link leads to no group of this file".into();
            return Err(LibraryError { message });
        }
        Ok(())
    }

    /// Text of a root attribute known to be a string.
    pub(super) fn root_text(&self, name: &str) -> Result<String, LibraryError> {
        guarded(|| self.inner.attr_string(name))
    }

    pub(super) fn dataset(&self, path: &str) -> Result<Dataset, LibraryError> {
        guarded(|| self.inner.dataset(path)).map(|inner| Dataset { inner })
    }
}

#[expect(clippy::wildcard_enum_match_arm, reason = "two of the library's many types are numbers")]
fn channel_type(datatype: &DatatypeMessage) -> Option<NumberType> {
    match *datatype {
        DatatypeMessage::FixedPoint {
            size, signed: true, bit_offset: 0, bit_precision, ..
        } => match (size, bit_precision) {
            (2, 16) => Some(NumberType::I16),
            (4, 32) => Some(NumberType::I32),
            _ => None,
        },
        DatatypeMessage::FloatingPoint { .. } => match datatype.ieee_format()? {
            IeeeFormat::Binary16 => None,
            IeeeFormat::Binary32 => Some(NumberType::F32),
            IeeeFormat::Binary64 => Some(NumberType::F64),
        },
        _ => None,
    }
}

/// Where a data set's bytes are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Storage {
    /// One run of bytes, or inside the header.
    Plain,
    /// Chunks of so many elements along each dimension, through these filters.
    Chunked(Vec<usize>, Vec<ChunkFilter>),
    /// Made of other data sets or files: not read.
    Elsewhere(&'static str),
}

/// An open data set.
pub(super) struct Dataset {
    pub(super) inner: H5Dataset,
}

impl Dataset {
    pub(super) fn shape(&self) -> Vec<usize> {
        self.inner.shape()
    }

    /// The channel number type, or a description of the type that is none.
    pub(super) fn number_type(&self) -> Result<Result<NumberType, String>, LibraryError> {
        // Describing a damaged type may panic too, so that is inside.
        guarded(|| {
            let datatype = self.inner.datatype()?;
            Ok::<_, Hdf5Error>(match channel_type(&datatype) {
                Some(kind) => Ok(kind),
                None => Err(datatype.to_string()),
            })
        })
    }

    pub(super) fn storage(&self) -> Result<Storage, LibraryError> {
        guarded(|| {
            Ok::<_, Hdf5Error>(match self.inner.storage_layout()? {
                StorageLayout::Virtual => Storage::Elsewhere("a virtual data set"),
                StorageLayout::Contiguous if !self.inner.external_files()?.is_empty() => {
                    Storage::Elsewhere("data in external files")
                }
                StorageLayout::Contiguous | StorageLayout::Compact => Storage::Plain,
                StorageLayout::Chunked => {
                    let filters = self.inner.filters()?.iter().map(ChunkFilter::new).collect();
                    Storage::Chunked(self.inner.chunk_dims().unwrap_or_default(), filters)
                }
            })
        })
    }

    /// Reads an attribute; `None` if there is none of that name.
    pub(super) fn attribute(&self, name: &str) -> Result<Option<Attribute>, LibraryError> {
        guarded(|| {
            if !self.inner.attr_names()?.iter().any(|known| known == name) {
                return Ok(None);
            }
            let attribute = self.inner.attr(name)?;
            let datatype = attribute.datatype()?;
            match Attribute::from_parts(&datatype, &attribute.read_raw()?) {
                Some(value) => Ok(Some(value)),
                None => Ok::<_, Hdf5Error>(Some(Attribute::Text(attribute.read_string()?))),
            }
        })
    }

    /// Reads `count` elements from `start` on, in host byte order.
    pub(super) fn slice<T: H5Type>(
        &self,
        start: usize,
        count: usize,
    ) -> Result<Vec<T>, LibraryError> {
        guarded(|| self.inner.read_slice::<T>(&[start], &[count]))
    }

    /// Reads `count` integers of any width, floats that are whole numbers too, or an error naming the first that does not fit.
    pub(super) fn integers(&self, count: usize) -> Result<Vec<i64>, LibraryError> {
        guarded(|| self.inner.read_numeric_slice_as::<i64>(&[0], &[count])).or_else(|error| {
            let floats = guarded(|| self.inner.read_numeric_slice_as::<f64>(&[0], &[count]));
            let whole = floats.ok().and_then(|all| all.into_iter().map(whole_number).collect());
            whole.ok_or(error)
        })
    }

    /// Reads `count` floats of either width, or integers.
    pub(super) fn floats(&self, count: usize) -> Result<Vec<f64>, LibraryError> {
        guarded(|| self.inner.read_numeric_slice_as::<f64>(&[0], &[count])).or_else(|error| {
            let integers = guarded(|| self.inner.read_numeric_slice_as::<i64>(&[0], &[count]));
            let floats = integers.map(|all| all.into_iter().map(|value| value as f64).collect());
            floats.map_err(|_| error)
        })
    }
}

/// A float as the integer it is, if it is one that a float holds exactly.
#[expect(clippy::cast_possible_truncation, reason = "whole and within 2^53")]
fn whole_number(value: f64) -> Option<i64> {
    (value.fract() == 0.0 && value.abs() <= 2.0_f64.powi(53)).then_some(value as i64)
}

/// A file being written; incomplete until [`NewFile::close`].
pub(super) struct NewFile {
    pub(super) inner: H5File,
}

/// How a new data set is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct NewStorage {
    /// (elements of a chunk, gzip level), with shuffle; `None` = contiguous.
    pub(super) compressed: Option<(usize, u32)>,
    /// Most significant byte first.
    pub(super) big_endian: bool,
}

impl NewFile {
    pub(super) fn create(path: &Path) -> Result<Self, LibraryError> {
        guarded(|| H5File::options().best_effort_locking().create(path)).map(|inner| Self { inner })
    }

    pub(super) fn text(&self, name: &str, value: &str) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_attr_string(name, value))
    }

    pub(super) fn number<T: H5Type>(&self, name: &str, value: T) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_attr_numeric(name, &value))
    }

    pub(super) fn group(&self, name: &str) -> Result<NewGroup, LibraryError> {
        guarded(|| self.inner.create_group(name)).map(|inner| NewGroup { inner })
    }

    /// Completes the file and hands it to the disk.
    pub(super) fn close(self) -> Result<(), LibraryError> {
        guarded(|| self.inner.close())
    }
}

/// A group being filled.
pub(super) struct NewGroup {
    inner: H5Group,
}

impl NewGroup {
    pub(super) fn dataset<T: H5Type>(
        &self,
        name: &str,
        data: &[T],
        storage: NewStorage,
    ) -> Result<NewDataset, LibraryError> {
        guarded(|| {
            let mut builder = self.inner.new_dataset::<T>().shape([data.len()]);
            if storage.big_endian {
                builder = builder.datatype(big_endian(T::hdf5_type()));
            }
            if let Some((chunk, level)) = storage.compressed {
                builder =
                    builder.chunk(&[chunk.clamp(1, data.len().max(1))]).shuffle_deflate(level);
            }
            let inner = builder.create(name)?;
            inner.write_raw(data)?;
            Ok::<_, Hdf5Error>(NewDataset { inner })
        })
    }
}

impl NewGroup {
    pub(super) fn group(&self, name: &str) -> Result<Self, LibraryError> {
        guarded(|| self.inner.create_group(name)).map(|inner| Self { inner })
    }

    pub(super) fn text(&self, name: &str, value: &str) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_attr_string(name, value))
    }

    pub(super) fn number<T: H5Type>(&self, name: &str, value: T) -> Result<(), LibraryError> {
        guarded(|| self.inner.set_attr_numeric(name, &value))
    }

    /// An empty data set that grows by chunks of so many elements.
    pub(super) fn growing<T: H5Type>(
        &self,
        name: &str,
        chunk: usize,
    ) -> Result<GrowingDataset, LibraryError> {
        guarded(|| {
            let builder = self.inner.new_dataset::<T>().shape([0]).chunk(&[chunk]);
            let inner = builder.max_shape(&[None]).create(name)?;
            Ok::<_, ::hdf5::Hdf5Error>(GrowingDataset { dataset: NewDataset { inner } })
        })
    }
}

/// A data set that grows at its end.
pub(super) struct GrowingDataset {
    dataset: NewDataset,
}

impl std::fmt::Debug for GrowingDataset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GrowingDataset").finish_non_exhaustive()
    }
}

impl GrowingDataset {
    /// Adds elements of the data set's own type.
    pub(super) fn append<T: H5Type>(&self, data: &[T]) -> Result<(), LibraryError> {
        if data.is_empty() {
            return Ok(());
        }
        guarded(|| self.dataset.inner.append(data))
    }

    pub(super) fn text(&self, name: &str, value: &str) -> Result<(), LibraryError> {
        self.dataset.text(name, value)
    }

    pub(super) fn number<T: H5Type>(&self, name: &str, value: T) -> Result<(), LibraryError> {
        self.dataset.number(name, value)
    }
}

/// A data set just written.
pub(super) struct NewDataset {
    inner: H5Dataset,
}

impl NewDataset {
    pub(super) fn text(&self, name: &str, value: &str) -> Result<(), LibraryError> {
        guarded(|| self.inner.new_attr::<VarLenUnicode>().create(name)?.write_string(value))
    }

    pub(super) fn number<T: H5Type>(&self, name: &str, value: T) -> Result<(), LibraryError> {
        guarded(|| self.inner.new_attr::<T>().create(name)?.write_numeric(&value))
    }
}

#[expect(clippy::wildcard_enum_match_arm, reason = "only numbers have a byte order to change")]
fn big_endian(mut datatype: DatatypeMessage) -> DatatypeMessage {
    match &mut datatype {
        DatatypeMessage::FixedPoint { byte_order, .. }
        | DatatypeMessage::FloatingPoint { byte_order, .. } => *byte_order = ByteOrder::BigEndian,
        _ => {}
    }
    datatype
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_in_the_library_is_an_error() {
        let numbers: Vec<u8> = Vec::new();
        let error = guarded(|| Ok::<u8, String>(numbers[0])).unwrap_err();
        assert!(error.to_string().contains("gave up: index out of bounds"), "{error}");
        assert!(!QUIET.get(), "other panics are reported as ever");
        assert_eq!(guarded(|| Ok::<u8, String>(7)).unwrap(), 7);
    }
}
