//! Places in an HDF5 file: the number or text that a map says stands there.
//!
//! A place is an attribute of a data set or group, or a data set of one element. Must not know what
//! the value is for.

use super::objects::{self, Element, Found, Number};
use crate::capture::checks::{Checks, Chunks};
use crate::capture::error::CaptureError;
use crate::capture::hdf5::{Attribute, Dataset, File};
use crate::capture::map::Place;
use crate::capture::root::{self, RootAttribute};

/// Bytes of a text at most.
const TEXT_BYTES_MAX: u64 = 1 << 16;

/// Names listed in an error at most.
const NAMES_MAX: usize = 10;

/// Why a place is of no use: words for the entry that names it, or a whole error of the file.
#[derive(Debug)]
pub(super) enum Problem {
    Words(String),
    Whole(CaptureError),
}

impl From<CaptureError> for Problem {
    fn from(error: CaptureError) -> Self {
        Self::Whole(error)
    }
}

impl From<String> for Problem {
    fn from(words: String) -> Self {
        Self::Words(words)
    }
}

/// The file in which places are looked up.
#[derive(Clone, Copy)]
pub(super) struct Places<'a> {
    pub(super) checks: &'a Checks<'a>,
    pub(super) file: &'a File,
}

impl Places<'_> {
    /// Opens the data set at `path`; gives its path without soft links too.
    pub(super) fn dataset(&self, path: &str) -> Result<(Dataset, String), Problem> {
        match self.find(path)? {
            Found::Dataset(at) => {
                let dataset = self.file.dataset(&at).map_err(|e| self.checks.library(path, e))?;
                Ok((dataset, at))
            }
            Found::Group(at) => Err(self.is_group(path, &at)?.into()),
            Found::Absent(..) | Found::Outside | Found::Truth | Found::Unreadable(_) => {
                Err(format!("{path} is no data set").into())
            }
        }
    }

    /// What `path` leads to: a data set or a group, everything else is an error.
    fn find(&self, path: &str) -> Result<Found, Problem> {
        let words = match self.file.find(path).map_err(|e| self.checks.library(path, e))? {
            found @ (Found::Dataset(_) | Found::Group(_)) => return Ok(found),
            Found::Absent(group, names) => absent(path, &group, names),
            Found::Outside => format!(
                "{path} is a link out of this file; a recording must not reach into others (h5repack joins them)"
            ),
            Found::Truth => format!("{path}: /truth is never read"),
            Found::Unreadable(reason) => format!("{path} cannot be read: {reason}"),
        };
        Err(words.into())
    }

    fn is_group(&self, path: &str, at: &str) -> Result<String, Problem> {
        let names = self.file.names_in(at).map_err(|e| self.checks.library(path, e))?;
        Ok(format!("{path} is a group, not a data set; it holds {}", listed(&names)))
    }

    /// The number at a place; `own`: the data set of the entry. A text that is a number counts.
    pub(super) fn number(&self, place: &Place, own: Option<&str>) -> Result<f64, Problem> {
        let words = shown(place);
        let expected = "expected one number";
        let text = match (&place.attribute, target(place, own)?) {
            (Some(name), path) => match self.attribute(path, name)? {
                Attribute::Number(value) => return Ok(value),
                Attribute::Text(text) => text,
                Attribute::Other(found) => {
                    return Err(format!("{words} is {found}; {expected}").into());
                }
            },
            (None, path) => match self.element(path)? {
                Attribute::Number(value) => return Ok(value),
                Attribute::Text(text) => text,
                Attribute::Other(found) => {
                    return Err(format!("{words} is {found}; {expected}").into());
                }
            },
        };
        let found = Attribute::Text(text.clone()).describe();
        text.trim().parse().map_err(|_| format!("{words} is {found}; {expected}").into())
    }

    /// The text at a place; `own`: the data set of the entry.
    pub(super) fn text(&self, place: &Place, own: Option<&str>) -> Result<String, Problem> {
        let found = match (&place.attribute, target(place, own)?) {
            (Some(name), path) => self.attribute(path, name)?,
            (None, path) => self.element(path)?,
        };
        match found {
            Attribute::Text(text) => Ok(text),
            Attribute::Number(_) | Attribute::Other(_) => {
                let found = found.describe();
                Err(format!("{} is {found}; expected a text", shown(place)).into())
            }
        }
    }

    /// An attribute of a data set or group.
    pub(super) fn attribute(&self, path: &str, name: &str) -> Result<Attribute, Problem> {
        if objects::is_label(name) {
            return Err(format!("attribute {name}: what may tell the result is never read").into());
        }
        let (found, names) = match self.find(path)? {
            Found::Group(at) => self.group_attribute(&at, name)?,
            Found::Dataset(at) => {
                let library = |e| self.checks.library(path, e);
                let dataset = self.file.dataset(&at).map_err(library)?;
                let found = dataset.attribute(name).map_err(library)?;
                (found, dataset.attribute_names().map_err(library)?)
            }
            Found::Absent(..) | Found::Outside | Found::Truth | Found::Unreadable(_) => {
                (None, Vec::new())
            }
        };
        match found {
            Some(Attribute::Text(text)) => {
                Ok(Attribute::Text(self.checks.bounded_text(path, name, text)?))
            }
            Some(value) => Ok(value),
            None => {
                let path = path.trim_start_matches('/');
                Err(format!("/{path} has no attribute {name}; it has {}", listed(&names)).into())
            }
        }
    }

    /// An attribute of the group at a path of hard links, and the names of all.
    fn group_attribute(
        &self,
        at: &str,
        name: &str,
    ) -> Result<(Option<Attribute>, Vec<String>), Problem> {
        let mut all = root::group_attributes(self.checks.path, at)?;
        let names = all.keys().cloned().collect();
        let found = match all.remove(name) {
            None => None,
            Some(RootAttribute::Value(value)) => Some(value),
            Some(RootAttribute::Unreadable(reason)) => Some(Attribute::Other(reason)),
            Some(RootAttribute::Text) => {
                let text = self.file.group_text(at, name);
                Some(Attribute::Text(text.map_err(|e| self.checks.library(at, e))?))
            }
        };
        Ok((found, names))
    }

    /// The only element of a data set.
    fn element(&self, path: &str) -> Result<Attribute, Problem> {
        let leaf = path.rsplit('/').next().unwrap_or(path);
        if objects::is_label(leaf) {
            return Err(format!("{path}: what may tell the result is never read").into());
        }
        let (dataset, at) = self.dataset(path)?;
        self.value(&dataset, &at)
    }

    /// The value of a data set of one element; a MATLAB text is one.
    pub(super) fn value(&self, dataset: &Dataset, path: &str) -> Result<Attribute, Problem> {
        let shape = dataset.shape();
        let count: u64 = shape.iter().fold(1, |n, &extent| n.saturating_mul(extent as u64));
        let library = |e| self.checks.library(path, e);
        let described = || Attribute::Other(format!("of shape {shape:?}"));
        let starts = vec![0; shape.len()];
        let check = |bytes: usize| {
            let slab: Vec<u64> = shape.iter().map(|&extent| extent as u64).collect();
            let chunks = &mut Chunks::default();
            self.checks.box_storage(dataset, path, (bytes, 8), &slab, chunks).map(|_| ())
        };
        match dataset.element().map_err(library)? {
            Element::Number(Number::U16) if dataset.matlab_class() == "char" => {
                if count > TEXT_BYTES_MAX {
                    return Ok(described());
                }
                check(2)?;
                let units = dataset.numbers(Number::U16, &starts, &shape).map_err(library)?;
                Ok(Attribute::Text(utf16(&units)))
            }
            Element::Number(_) if count != 1 => Ok(described()),
            Element::Number(number) => {
                check(number.bytes())?;
                let values = dataset.numbers(number, &starts, &shape).map_err(library)?;
                Ok(values.first().map_or_else(described, |&value| Attribute::Number(value)))
            }
            Element::Text => {
                let bytes = dataset.element_bytes();
                if count != 1 || bytes as u64 > TEXT_BYTES_MAX {
                    return Ok(described());
                }
                check(bytes)?;
                let texts = dataset.texts().map_err(library)?;
                Ok(texts.into_iter().next().map_or_else(described, Attribute::Text))
            }
            Element::Other(what) => Ok(Attribute::Other(what)),
        }
    }
}

/// Object of a place.
fn target<'a>(place: &'a Place, own: Option<&'a str>) -> Result<&'a str, Problem> {
    let none =
        || Problem::Words("@attribute alone has no data set here; use /path@attribute".into());
    place.path.as_deref().or(own).ok_or_else(none)
}

/// A place as it is written.
pub(super) fn shown(place: &Place) -> String {
    let path = place.path.as_deref().unwrap_or_default();
    match &place.attribute {
        Some(attribute) => format!("{path}@{attribute}"),
        None => path.to_owned(),
    }
}

/// Text of UTF-16 code units held as floats.
fn utf16(units: &[f64]) -> String {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "they were 16-bit numbers"
    )]
    let units = units.iter().map(|&unit| unit as u16);
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// What there is instead of an absent path, the nearest names first.
fn absent(path: &str, group: &str, mut names: Vec<String>) -> String {
    let depth = group.split('/').filter(|name| !name.is_empty()).count();
    let wanted = path.split('/').filter(|name| !name.is_empty()).nth(depth).unwrap_or(path);
    names.retain(|name| !objects::is_label(name));
    names.sort_by_cached_key(|name| distance(&name.to_lowercase(), &wanted.to_lowercase()));
    format!("there is no {path} in the file; /{group} holds {}", listed(&names))
}

/// Names for an error.
fn listed(names: &[String]) -> String {
    let more = names.len().saturating_sub(NAMES_MAX);
    let first: Vec<&str> = names.iter().take(NAMES_MAX).map(String::as_str).collect();
    match (first.is_empty(), more) {
        (true, _) => "nothing".into(),
        (false, 0) => first.join(", "),
        (false, more) => format!("{} and {more} more", first.join(", ")),
    }
}

/// Letters to insert, delete or replace to make one word of the other, words cut at 64 letters.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().take(64).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().take(64).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for j in 0..b.len() {
            let replaced = diagonal + usize::from(letter != b[j]);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_names_come_first() {
        let names = ["zz", "sample_rate", "Data", "label"].map(str::to_owned).to_vec();
        let text = absent("/data", "", names);
        assert_eq!(text, "there is no /data in the file; / holds Data, zz, sample_rate");
        let names = ["vib_1".to_owned(), "vib_2".to_owned()];
        assert_eq!(
            absent("/a/b/vib_2x", "a/b", names.to_vec()),
            "there is no /a/b/vib_2x in the file; /a/b holds vib_2, vib_1"
        );
        assert_eq!(distance("kitten", "sitting"), 3);
    }
}
