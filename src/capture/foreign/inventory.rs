//! What an HDF5 file of any layout holds: groups, data sets, attributes, and how to read it.
//!
//! For people who have a file and no map. Bounded whatever the file holds; values that may tell what
//! a recording is meant to show (`/truth`, `label`-like names) are not read. Must not know machines.

use super::grid;
use super::objects::{self, Element, Found};
use super::places::Places;
use super::suggest::{self, Suggestion};
use crate::capture::checks::{Checks, Chunks};
use crate::capture::error::CaptureError;
use crate::capture::hdf5::{Attribute, File};
use crate::capture::root::{self, RootAttribute};
use std::fmt;
use std::path::{Path, PathBuf};

/// Objects listed at most.
const OBJECTS_MAX: usize = 200;

/// Groups in groups followed at most.
const DEPTH_MAX: usize = 8;

/// Attributes of one object listed at most.
const ATTRIBUTES_MAX: usize = 40;

/// How the storage of a data set that cannot be read begins.
pub(super) const NOT_READABLE: &str = "not readable: ";

/// What a file holds, and the map that would read it.
#[derive(Debug, Clone, PartialEq)]
pub struct Inventory {
    file: PathBuf,
    file_bytes: u64,
    objects: Vec<Object>,
    /// Whether more objects were left out.
    more: bool,
    suggestion: Suggestion,
}

/// A group or data set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Object {
    /// Without a leading `/`; empty for the root.
    pub(super) path: String,
    pub(super) kind: Kind,
    /// Names and values; `None`: not read.
    pub(super) attributes: Vec<(String, Option<Attribute>)>,
}

/// What an object is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    Group,
    Dataset {
        element: Element,
        shape: Vec<usize>,
        storage: String,
        /// Of one element, if it may be read.
        value: Option<Attribute>,
    },
    /// Neither, in words.
    Remark(String),
}

impl Inventory {
    /// Looks through the file; samples are not read.
    ///
    /// # Errors
    ///
    /// When the file is no HDF5 file, is truncated, or the library cannot list it.
    pub fn examine(path: &Path) -> Result<Self, CaptureError> {
        let file_bytes = std::fs::metadata(path)
            .map_err(|source| CaptureError::Io { file: path.into(), action: "open it", source })?
            .len();
        root::attributes(path)?;
        let checks = Checks { path, file_bytes };
        let file = File::open(path).map_err(|source| checks.library("the file", source))?;
        let mut walk = Walk {
            places: Places { checks: &checks, file: &file },
            objects: Vec::new(),
            more: false,
        };
        walk.group("", 0)?;
        let (objects, more) = (walk.objects, walk.more);
        let suggestion = suggest::of(&objects);
        Ok(Self { file: path.into(), file_bytes, objects, more, suggestion })
    }

    /// `NAME=/path,…` of each channel that could be one, as `--map` takes it.
    #[must_use]
    pub fn map_options(&self) -> Vec<String> {
        let entries = self.suggestion.entries.iter();
        entries.map(|(name, entry)| format!("{name}={entry}")).collect()
    }

    /// The command that diagnoses the file; `None` if nothing in it could be a channel.
    #[must_use]
    pub fn command(&self) -> Option<String> {
        if self.suggestion.entries.is_empty() {
            return None;
        }
        let options: Vec<String> =
            self.map_options().iter().map(|option| format!("--map {}", quoted(option))).collect();
        let file = quoted(&self.file.display().to_string());
        Some(format!("rotorwatch diagnose --machine RIG.toml {} {file}", options.join(" ")))
    }
}

/// A walk over the objects of a file.
struct Walk<'a> {
    places: Places<'a>,
    objects: Vec<Object>,
    more: bool,
}

impl Walk<'_> {
    fn group(&mut self, path: &str, depth: usize) -> Result<(), CaptureError> {
        let attributes = self.group_attributes(path);
        self.objects.push(Object { path: path.into(), kind: Kind::Group, attributes });
        let file = self.places.file;
        let names = file.names_in(path).map_err(|e| self.places.checks.library(path, e))?;
        for name in names {
            if self.objects.len() >= OBJECTS_MAX {
                self.more = true;
                return Ok(());
            }
            let at = if path.is_empty() { name.clone() } else { format!("{path}/{name}") };
            let found = file.find(&at).map_err(|e| self.places.checks.library(&at, e))?;
            let remark = match found {
                Found::Group(target) if target == at && name.starts_with('#') => {
                    "MATLAB's own, not looked into".to_owned()
                }
                Found::Group(target) if target == at && depth >= DEPTH_MAX => {
                    "a group too deep to be looked into".to_owned()
                }
                Found::Group(target) if target == at => {
                    self.group(&at, depth + 1)?;
                    continue;
                }
                Found::Dataset(target) if target == at => {
                    let dataset = self.dataset(&at, &name);
                    self.objects.push(dataset);
                    continue;
                }
                Found::Group(target) | Found::Dataset(target) => format!("a link to /{target}"),
                Found::Absent(..) => "a link to nothing".to_owned(),
                Found::Outside => "a link out of this file, not followed".to_owned(),
                Found::Truth => "not read".to_owned(),
                Found::Unreadable(reason) => format!("cannot be read: {reason}"),
            };
            let kind = Kind::Remark(remark);
            self.objects.push(Object { path: at, kind, attributes: Vec::new() });
        }
        Ok(())
    }

    fn group_attributes(&self, path: &str) -> Vec<(String, Option<Attribute>)> {
        let all = root::group_attributes(self.places.checks.path, path).unwrap_or_default();
        let value = |(name, found): (String, RootAttribute)| {
            let value = match found {
                _ if objects::is_label(&name) => None,
                RootAttribute::Value(value) => Some(value),
                RootAttribute::Text => {
                    self.places.file.group_text(path, &name).ok().map(Attribute::Text)
                }
                RootAttribute::Unreadable(reason) => Some(Attribute::Other(reason)),
            };
            (name, value)
        };
        all.into_iter().take(ATTRIBUTES_MAX).map(value).collect()
    }

    fn dataset(&self, path: &str, name: &str) -> Object {
        let unreadable = |words: String| Kind::Remark(format!("cannot be read: {words}"));
        let dataset = match self.places.file.dataset(path) {
            Ok(dataset) => dataset,
            Err(error) => {
                let kind = unreadable(error.to_string());
                return Object { path: path.into(), kind, attributes: Vec::new() };
            }
        };
        let names = dataset.attribute_names().unwrap_or_default();
        let value = |name: String| {
            let readable = !objects::is_label(&name);
            let value = readable.then(|| dataset.attribute(&name).ok().flatten()).flatten();
            (name, value)
        };
        let attributes: Vec<_> = names.into_iter().take(ATTRIBUTES_MAX).map(value).collect();
        let (element, shape) = match dataset.element() {
            Ok(element) => (element, dataset.shape()),
            Err(error) => {
                let kind = unreadable(error.to_string());
                return Object { path: path.into(), kind, attributes };
            }
        };
        let slab = vec![1; shape.len()];
        let bytes = (dataset.element_bytes(), 1);
        let chunks = &mut Chunks::default();
        let storage = match self.places.checks.box_storage(&dataset, path, bytes, &slab, chunks) {
            Ok((_, storage)) => storage,
            Err(CaptureError::Dataset { found, .. }) => format!("{NOT_READABLE}{found}"),
            Err(_) => format!("{NOT_READABLE}over a limit"),
        };
        let is_short = shape.iter().all(|&extent| extent == 1) || dataset.matlab_class() == "char";
        let value = (is_short && !objects::is_label(name))
            .then(|| self.places.value(&dataset, path).ok())
            .flatten();
        let kind = Kind::Dataset { element, shape, storage, value };
        Object { path: path.into(), kind, attributes }
    }
}

impl fmt::Display for Inventory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file.display();
        writeln!(f, "{file}: HDF5 of another layout, {} bytes", self.file_bytes)?;
        for object in &self.objects {
            write!(f, "{object}")?;
        }
        if self.more {
            writeln!(f, "  … and more: the first {OBJECTS_MAX} objects are listed")?;
        }
        writeln!(
            f,
            "  missing to be a capture: one data set a channel under /channels, with the attribute sample_rate_hz (docs/hdf5.md)"
        )?;
        let Some(command) = self.command() else {
            let n = suggest::SAMPLES_MIN;
            return writeln!(f, "  no data set of {n} numbers or more that could be a channel");
        };
        for remark in &self.suggestion.remarks {
            writeln!(f, "  {}", clean(remark))?;
        }
        writeln!(
            f,
            "  what would read it as it is, RIG.toml being your machine file:\n\n{command}"
        )?;
        writeln!(f, "\n  or in the machine file, once for all such files:\n\n[capture.map]")?;
        for (name, entry) in &self.suggestion.entries {
            writeln!(f, "{} = {}", toml_text(name), toml_text(entry))?;
        }
        writeln!(f)
    }
}

impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = clean(&self.path);
        match &self.kind {
            Kind::Group if self.path.is_empty() && self.attributes.is_empty() => {}
            Kind::Group => writeln!(f, "  /{path}: group")?,
            Kind::Remark(words) => writeln!(f, "  /{path}: {}", clean(words))?,
            Kind::Dataset { element, shape, storage, value } => {
                let element = match element {
                    Element::Number(number) => number.name(),
                    Element::Text => "text",
                    Element::Other(words) => words,
                };
                let shape = grid::times(shape);
                write!(f, "  /{path}: {element}, {shape}, {storage}")?;
                match value {
                    Some(value) => writeln!(f, " = {}", clean(&value.describe()))?,
                    None => writeln!(f)?,
                }
            }
        }
        for (name, value) in &self.attributes {
            let name = clean(name);
            match value {
                Some(value) => writeln!(f, "    @{name} = {}", clean(&value.describe()))?,
                None => writeln!(f, "    @{name}: not read")?,
            }
        }
        Ok(())
    }
}

/// Text from a file, its control characters escaped.
fn clean(text: &str) -> String {
    let mut cleaned = String::with_capacity(text.len());
    for char in text.chars() {
        if char.is_control() {
            cleaned.extend(char.escape_default());
        } else {
            cleaned.push(char);
        }
    }
    cleaned
}

/// A word for a shell.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/_-.,=@+:%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A key or text of TOML.
fn toml_text(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_the_shell_and_toml() {
        assert_eq!(quoted("a=/x,column=0,rate=@fs"), "a=/x,column=0,rate=@fs");
        assert_eq!(quoted("/my data/it's"), r"'/my data/it'\''s'");
        assert_eq!(toml_text(r#"/a"b\c"#), r#""/a\"b\\c""#);
        assert_eq!(clean("a\u{1b}[2J"), "a\\u{1b}[2J");
    }
}
