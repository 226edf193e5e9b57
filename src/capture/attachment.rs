//! What a capture keeps beside its channels: named lists of one group, none of which a diagnosis reads.
//!
//! Must not know what they mean. A list is read only if its bytes can be in the file; a checksum over all of them
//! tells damage.

use super::error::{CaptureError, LibraryError};
use super::hdf5::{Dataset, Entry, File};
use std::path::Path;

/// The group.
pub const GROUP: &str = "evidence";

/// Bytes of one list at most.
const BYTES_MAX: u64 = 64 << 20;

/// Name of the list that holds the checksum of the others.
const CHECKSUM: &str = "checksum";

/// A named list.
#[derive(Debug, Clone, PartialEq)]
pub struct Attachment {
    /// Its name, without `/`.
    pub name: String,
    /// What it holds.
    pub content: Content,
}

/// What a list holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// UTF-8, a byte an element.
    Text(String),
    /// float64.
    Numbers(Vec<f64>),
    /// int64.
    Counts(Vec<i64>),
}

/// Kinds of lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`Content::Text`].
    Text,
    /// [`Content::Numbers`].
    Numbers,
    /// [`Content::Counts`].
    Counts,
}

impl Content {
    /// Number of elements; of a text, bytes.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Text(text) => text.len(),
            Self::Numbers(numbers) => numbers.len(),
            Self::Counts(counts) => counts.len(),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The elements, least significant byte first.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            Self::Numbers(numbers) => numbers.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Counts(counts) => counts.iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }
}

/// Adds the checksum of lists to them.
#[must_use]
pub fn with_checksum(mut lists: Vec<Attachment>) -> Vec<Attachment> {
    let sum = i64::from(checksum(&lists));
    lists.push(Attachment { name: CHECKSUM.to_owned(), content: Content::Counts(vec![sum]) });
    lists
}

/// CRC-32 of names, lengths and elements, in their order.
fn checksum(lists: &[Attachment]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    for Attachment { name, content } in lists {
        sum.update(name.as_bytes());
        sum.update(&(content.len() as u64).to_le_bytes());
        sum.update(&content.bytes());
    }
    sum.finalize()
}

/// Reads lists by name, in this order; `None`: the file keeps none. A list that is not there is empty.
///
/// # Errors
///
/// When the file cannot be read, or what it keeps is not what was written.
pub fn read(path: &Path, names: &[(&str, Kind)]) -> Result<Option<Vec<Attachment>>, CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "read it", source };
    let file_bytes = std::fs::metadata(path).map_err(io)?.len();
    let library = |object: &str| {
        let object = object.to_owned();
        move |source| CaptureError::Library { file: path.into(), object, source }
    };
    let file = File::open(path).map_err(library("the file"))?;
    let Some(entries) = file.entries(GROUP).map_err(library(GROUP))? else { return Ok(None) };
    let is_there =
        |name: &str| entries.iter().any(|(found, kind)| found == name && *kind == Entry::Dataset);
    let mut lists = Vec::new();
    for &(name, kind) in names.iter().chain(&[(CHECKSUM, Kind::Counts)]) {
        let content = if is_there(name) {
            let object = format!("{GROUP}/{name}");
            let dataset = file.dataset(&object).map_err(library(&object))?;
            content(&dataset, kind, file_bytes).map_err(library(&object))?
        } else {
            empty(kind)
        };
        lists.push(Attachment { name: name.to_owned(), content });
    }
    let stated = lists.pop().map(|list| list.content);
    if stated != Some(Content::Counts(vec![i64::from(checksum(&lists))])) {
        return Err(CaptureError::Content {
            file: path.into(),
            object: GROUP.to_owned(),
            problem:
                "it is damaged: its checksum is not that of its content; take a copy that is whole"
                    .into(),
        });
    }
    Ok(Some(lists))
}

fn empty(kind: Kind) -> Content {
    match kind {
        Kind::Text => Content::Text(String::new()),
        Kind::Numbers => Content::Numbers(Vec::new()),
        Kind::Counts => Content::Counts(Vec::new()),
    }
}

fn content(dataset: &Dataset, kind: Kind, file_bytes: u64) -> Result<Content, LibraryError> {
    let wrong = |message: String| LibraryError { message };
    let [length] = dataset.shape()[..] else {
        return Err(wrong("it has more than one dimension".to_owned()));
    };
    let width: u64 = if kind == Kind::Text { 1 } else { 8 };
    let bytes = (length as u64).saturating_mul(width);
    if bytes > file_bytes.min(BYTES_MAX) {
        return Err(wrong(format!("it declares {bytes} bytes, more than the file can hold")));
    }
    Ok(match kind {
        Kind::Text => {
            let bytes = dataset.slice::<u8>(0, length)?;
            let text = String::from_utf8(bytes).map_err(|error| wrong(error.to_string()))?;
            Content::Text(text)
        }
        Kind::Numbers => Content::Numbers(dataset.floats(length)?),
        Kind::Counts => Content::Counts(dataset.integers(length)?),
    })
}
