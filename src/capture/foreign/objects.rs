//! Objects of an HDF5 file of any layout: what a path leads to, what a group holds, what the
//! elements of a data set are.
//!
//! Links are followed here, one by one, so that a path never leaves the file and never enters
//! `/truth`. Must not know maps, channels or units.

use crate::capture::error::LibraryError;
use crate::capture::hdf5::{
    self, Attribute, Dataset, DatatypeMessage, File, H5Group, H5Type, Hdf5Error,
};
use crate::capture::hdf5::{IeeeFormat, LinkClass};
use crate::capture::received::{NumberType, RawSamples};
use std::collections::VecDeque;

/// Soft links followed on one path at most.
const SOFT_LINKS_MAX: usize = 32;

/// The group nobody looks into.
const TRUTH: &str = "truth";

/// What a path leads to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Found {
    /// A data set; its path without soft links.
    Dataset(String),
    /// A group; its path without soft links, empty for the root.
    Group(String),
    /// Nothing: the group that lacks the next name, and the names it has.
    Absent(String, Vec<String>),
    /// A link that leads out of the file.
    Outside,
    /// The ground truth: not for this program.
    Truth,
    /// There, but of no use, and why.
    Unreadable(String),
}

/// Whether the value of this name may tell what a recording is meant to show.
pub(super) fn is_label(name: &str) -> bool {
    const WORDS: [&str; 9] = [
        "label",
        "truth",
        "fault",
        "defect",
        "damage",
        "diagnos",
        "severity",
        "health",
        "condition",
    ];
    let name = name.to_lowercase();
    let class = name == "class" || name.ends_with("_class") && name != "matlab_class";
    class || WORDS.iter().any(|word| name.contains(word))
}

impl File {
    /// Follows a path from the root, through soft links of this file.
    pub(super) fn find(&self, path: &str) -> Result<Found, LibraryError> {
        let mut ahead: VecDeque<String> = components(path);
        let mut behind: Vec<String> = Vec::new();
        let mut n_soft = 0;
        while let Some(name) = ahead.pop_front() {
            if behind.is_empty() && name.eq_ignore_ascii_case(TRUTH) {
                return Ok(Found::Truth);
            }
            let here = behind.join("/");
            let Some(group) = self.group(&here)? else {
                return Ok(Found::Absent(here, Vec::new()));
            };
            let names = hdf5::guarded(|| group.link_names())?;
            if !names.contains(&name) {
                return Ok(Found::Absent(here, names));
            }
            match hdf5::guarded(|| group.link_class(&name))? {
                LinkClass::Hard => behind.push(name),
                LinkClass::Soft { path } => {
                    n_soft += 1;
                    if n_soft > SOFT_LINKS_MAX {
                        return Ok(Found::Unreadable("soft links in a circle".into()));
                    }
                    if path.starts_with('/') {
                        behind.clear();
                    }
                    for name in components(&path).into_iter().rev() {
                        ahead.push_front(name);
                    }
                }
                LinkClass::External { .. } | LinkClass::UserDefined { .. } => {
                    return Ok(Found::Outside);
                }
            }
        }
        self.kind(&behind)
    }

    /// What a path of hard links stands for.
    fn kind(&self, names: &[String]) -> Result<Found, LibraryError> {
        let path = names.join("/");
        let Some((name, above)) = names.split_last() else { return Ok(Found::Group(path)) };
        let Some(parent) = self.group(&above.join("/"))? else {
            return Ok(Found::Absent(above.join("/"), Vec::new()));
        };
        if hdf5::guarded(|| parent.group_names())?.contains(name) {
            return Ok(Found::Group(path));
        }
        if let Some(reason) = hdf5::guarded(|| parent.unreadable_reason(name))? {
            return Ok(Found::Unreadable(reason));
        }
        match self.dataset(&path) {
            Ok(_) => Ok(Found::Dataset(path)),
            Err(error) => Ok(Found::Unreadable(error.to_string())),
        }
    }

    /// The group of this path of hard links; `None` if it is none.
    fn group(&self, path: &str) -> Result<Option<H5Group>, LibraryError> {
        let root = self.inner.root_group();
        if path.is_empty() {
            return Ok(Some(root));
        }
        match hdf5::guarded(|| Ok::<_, Hdf5Error>(root.group(path)))? {
            Ok(group) => Ok(Some(group)),
            Err(Hdf5Error::NotFound(_)) => Ok(None),
            Err(error) => Err(LibraryError { message: error.to_string() }),
        }
    }

    /// Names in the group of this path, sorted; none if it is no group.
    pub(super) fn names_in(&self, path: &str) -> Result<Vec<String>, LibraryError> {
        match self.group(path)? {
            Some(group) => hdf5::guarded(|| group.link_names()),
            None => Ok(Vec::new()),
        }
    }

    /// Text of an attribute, known to be a string, of a group.
    pub(super) fn group_text(&self, path: &str, name: &str) -> Result<String, LibraryError> {
        match self.group(path)? {
            Some(group) => hdf5::guarded(|| group.attr_string(name)),
            None => Err(LibraryError { message: format!("/{path} is no group") }),
        }
    }
}

fn components(path: &str) -> VecDeque<String> {
    let names = path.split('/').filter(|name| !name.is_empty() && *name != ".");
    names.map(str::to_owned).collect()
}

/// What the elements of a data set are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Element {
    /// IEEE floats and integers of whole bytes.
    Number(Number),
    /// Characters, of a fixed or variable number an element.
    Text,
    /// Anything else, in words.
    Other(String),
}

/// A stored number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    F16,
    F32,
    F64,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
}

impl Number {
    /// Name in documents.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::I8 => "int8",
            Self::I16 => "int16",
            Self::I32 => "int32",
            Self::I64 => "int64",
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U32 => "uint32",
            Self::U64 => "uint64",
        }
    }

    /// Bytes of a stored element.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::F16 | Self::I16 | Self::U16 => 2,
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// What it is read as.
    pub(super) fn read_as(self) -> NumberType {
        match self {
            Self::F32 => NumberType::F32,
            Self::I16 => NumberType::I16,
            Self::I32 => NumberType::I32,
            Self::F16
            | Self::F64
            | Self::I8
            | Self::I64
            | Self::U8
            | Self::U16
            | Self::U32
            | Self::U64 => NumberType::F64,
        }
    }
}

fn element(datatype: &DatatypeMessage) -> Element {
    let other = |what: &str| Element::Other(format!("{what} ({datatype})"));
    match datatype {
        DatatypeMessage::FixedPoint { size, signed, bit_offset, bit_precision, .. } => {
            let whole = *bit_offset == 0 && u32::from(*bit_precision) == size.saturating_mul(8);
            match (whole, size, signed) {
                (true, 1, true) => Element::Number(Number::I8),
                (true, 1, false) => Element::Number(Number::U8),
                (true, 2, true) => Element::Number(Number::I16),
                (true, 2, false) => Element::Number(Number::U16),
                (true, 4, true) => Element::Number(Number::I32),
                (true, 4, false) => Element::Number(Number::U32),
                (true, 8, true) => Element::Number(Number::I64),
                (true, 8, false) => Element::Number(Number::U64),
                _ => other("integers of an unusual width"),
            }
        }
        DatatypeMessage::FloatingPoint { .. } => match datatype.ieee_format() {
            Some(IeeeFormat::Binary16) => Element::Number(Number::F16),
            Some(IeeeFormat::Binary32) => Element::Number(Number::F32),
            Some(IeeeFormat::Binary64) => Element::Number(Number::F64),
            None => other("floats that are not IEEE 754 of 16, 32 or 64 bits"),
        },
        DatatypeMessage::FixedString { .. } | DatatypeMessage::VarLenString { .. } => Element::Text,
        DatatypeMessage::Compound { .. } => other("compound elements (records or complex numbers)"),
        DatatypeMessage::Enum { .. } => other("enumerated values"),
        DatatypeMessage::Reference { .. } => other("references to other objects"),
        DatatypeMessage::BitField { .. } => other("bit fields"),
        DatatypeMessage::Opaque { .. } => other("opaque bytes"),
        DatatypeMessage::VarLenSequence { .. } => other("sequences of varying length"),
        DatatypeMessage::Array { .. } => other("arrays as elements"),
    }
}

impl Dataset {
    /// What its elements are.
    pub(super) fn element(&self) -> Result<Element, LibraryError> {
        // Describing a damaged type may panic too, so that is inside.
        hdf5::guarded(|| Ok::<_, Hdf5Error>(element(&self.inner.datatype()?)))
    }

    /// Bytes of a stored element.
    pub(super) fn element_bytes(&self) -> usize {
        self.inner.element_size()
    }

    /// Names of its attributes, sorted.
    pub(super) fn attribute_names(&self) -> Result<Vec<String>, LibraryError> {
        let mut names = hdf5::guarded(|| self.inner.attr_names())?;
        names.sort();
        Ok(names)
    }

    /// Text of a MATLAB class attribute, empty if there is none.
    pub(super) fn matlab_class(&self) -> String {
        match self.attribute("MATLAB_class") {
            Ok(Some(Attribute::Text(class))) => class,
            Ok(_) | Err(_) => String::new(),
        }
    }

    /// Reads `counts` elements from `starts` on, last dimension fastest.
    pub(super) fn box_of(
        &self,
        number: Number,
        starts: &[usize],
        counts: &[usize],
    ) -> Result<RawSamples, LibraryError> {
        Ok(match number {
            Number::F32 => RawSamples::F32(self.elements(starts, counts)?),
            Number::F64 => RawSamples::F64(self.elements(starts, counts)?),
            Number::I16 => RawSamples::I16(self.elements(starts, counts)?),
            Number::I32 => RawSamples::I32(self.elements(starts, counts)?),
            Number::I8 => wide(&self.elements::<i8>(starts, counts)?, |&x| f64::from(x)),
            Number::U8 => wide(&self.elements::<u8>(starts, counts)?, |&x| f64::from(x)),
            Number::U16 => wide(&self.elements::<u16>(starts, counts)?, |&x| f64::from(x)),
            Number::U32 => wide(&self.elements::<u32>(starts, counts)?, |&x| f64::from(x)),
            Number::I64 => wide(&self.elements::<i64>(starts, counts)?, |&x| x as f64),
            Number::U64 => wide(&self.elements::<u64>(starts, counts)?, |&x| x as f64),
            Number::F16 if starts.is_empty() => {
                RawSamples::F64(hdf5::guarded(|| self.inner.read_numeric_as::<f64>())?)
            }
            Number::F16 => RawSamples::F64(hdf5::guarded(|| {
                self.inner.read_numeric_slice_as::<f64>(starts, counts)
            })?),
        })
    }

    /// The same as float64.
    pub(super) fn numbers(
        &self,
        number: Number,
        starts: &[usize],
        counts: &[usize],
    ) -> Result<Vec<f64>, LibraryError> {
        Ok(match self.box_of(number, starts, counts)? {
            RawSamples::F32(raw) => raw.iter().map(|&x| f64::from(x)).collect(),
            RawSamples::F64(raw) => raw,
            RawSamples::I16(raw) => raw.iter().map(|&x| f64::from(x)).collect(),
            RawSamples::I32(raw) => raw.iter().map(|&x| f64::from(x)).collect(),
        })
    }

    /// Integers of 64 bits, which float64 would round; `None` for other numbers.
    ///
    /// Unsigned ones are wrapped, so that their differences are right.
    pub(super) fn integers_of_64_bits(
        &self,
        number: Number,
        starts: &[usize],
        counts: &[usize],
    ) -> Result<Option<Vec<i64>>, LibraryError> {
        Ok(match number {
            Number::I64 => Some(self.elements(starts, counts)?),
            Number::U64 => {
                let raw = self.elements::<u64>(starts, counts)?;
                Some(raw.into_iter().map(u64::cast_signed).collect())
            }
            Number::F16 | Number::F32 | Number::F64 => None,
            Number::I8 | Number::I16 | Number::I32 => None,
            Number::U8 | Number::U16 | Number::U32 => None,
        })
    }

    fn elements<T: H5Type>(
        &self,
        starts: &[usize],
        counts: &[usize],
    ) -> Result<Vec<T>, LibraryError> {
        if starts.is_empty() {
            // One element without dimensions, which the library gives only whole.
            return hdf5::guarded(|| self.inner.read_raw::<T>());
        }
        hdf5::guarded(|| self.inner.read_slice::<T>(starts, counts))
    }

    /// Its texts; only for data sets of few elements.
    pub(super) fn texts(&self) -> Result<Vec<String>, LibraryError> {
        hdf5::guarded(|| self.inner.read_strings_lossy())
    }
}

fn wide<T>(raw: &[T], widen: impl Fn(&T) -> f64) -> RawSamples {
    RawSamples::F64(raw.iter().map(widen).collect())
}
