//! `--map` and `[capture.map]`: where channels stand in a file of a foreign layout.
//!
//! One entry a channel, `NAME=/path[,option=value]…`; the options are those of [`MapEntry`]. Where a
//! number or a text is expected, `@attribute` (of the data set itself), `/path@attribute` or `/path`
//! (a data set of one element) names the place in the file it stands at. Parsing only: must not
//! know files.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Name of the entry that says where the speed of the first shaft stands; its `unit` may be `rpm`.
pub const SHAFT_SPEED: &str = "@shaft_speed";

/// Name of the entry that says where the start time stands.
pub const START_TIME: &str = "@start_time";

/// Options of an entry, for error messages.
const OPTIONS: &str = "column, row, rate, interval, time, unit, scale, offset";

/// Where each channel stands, by the channel's name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ChannelMap {
    entries: BTreeMap<String, MapEntry>,
}

/// Where one channel stands.
#[derive(Debug, Clone, PartialEq)]
pub struct MapEntry {
    /// Who says so, for errors: `--map` or `[capture.map] of rig.toml`.
    pub origin: String,
    /// Path of the data set, or name of the CSV or WAV column, with a leading `/`.
    pub path: String,
    /// `column=K`: of a table, the channel numbered K from 0 across the shorter dimension.
    pub column: Option<usize>,
    /// `row=K`: row K of the data set as HDF5 shows it; time runs along the row.
    pub row: Option<usize>,
    /// `rate=`: samples a second.
    pub rate: Option<NumberAt>,
    /// `interval=`: seconds a sample, instead of a rate.
    pub interval: Option<NumberAt>,
    /// `time=`: place of the samples' times, s, instead of a rate.
    pub time: Option<Place>,
    /// `unit=`: one of [`crate::units::SourceUnit::ACCEPTED`].
    pub unit: Option<TextAt>,
    /// `scale=`: physical = raw·scale + offset.
    pub scale: Option<NumberAt>,
    /// `offset=`.
    pub offset: Option<NumberAt>,
}

/// A number, or where in the file it stands.
#[derive(Debug, Clone, PartialEq)]
pub enum NumberAt {
    /// The number.
    Value(f64),
    /// Its place.
    At(Place),
}

/// A text, or where in the file it stands.
#[derive(Debug, Clone, PartialEq)]
pub enum TextAt {
    /// The text.
    Value(String),
    /// Its place.
    At(Place),
}

/// A place in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Path of the object, with a leading `/`; `None`: the channel's own data set.
    pub path: Option<String>,
    /// Attribute of the object; `None`: its only element (of `time`: its elements).
    pub attribute: Option<String>,
}

/// Why a text is no map entry.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{origin}: {entry}: {problem}")]
pub struct MapError {
    /// Who said so.
    pub origin: String,
    /// The entry as written.
    pub entry: String,
    /// What is wrong, and what is allowed.
    pub problem: String,
}

impl ChannelMap {
    /// Reads `--map` options, `NAME=/path[,option=value]…` each.
    ///
    /// # Errors
    ///
    /// The first entry that is wrong, or that names a channel a second time.
    pub fn of_options<T: AsRef<str>>(options: &[T]) -> Result<Self, MapError> {
        let mut map = Self::default();
        for text in options.iter().map(AsRef::as_ref) {
            let failed = |problem: String| MapError {
                origin: "--map".to_owned(),
                entry: text.to_owned(),
                problem,
            };
            let (name, value) = text
                .split_once('=')
                .filter(|(name, _)| !name.trim().is_empty())
                .ok_or_else(|| failed("expected NAME=/path[,option=value]…".to_owned()))?;
            map.add(name.trim(), value, "--map").map_err(failed)?;
        }
        Ok(map)
    }

    /// Reads a machine's `[capture.map]`; `file` is its name, for errors.
    ///
    /// # Errors
    ///
    /// The first entry that is wrong.
    pub fn of_table(table: &BTreeMap<String, String>, file: &str) -> Result<Self, MapError> {
        let mut map = Self::default();
        let origin = format!("[capture.map] of {file}");
        for (name, value) in table {
            map.add(name, value, &origin).map_err(|problem| MapError {
                origin: origin.clone(),
                entry: format!("{name} = \"{value}\""),
                problem,
            })?;
        }
        Ok(map)
    }

    /// Whether it says nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The entries by channel name, `@…` included.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &MapEntry)> {
        self.entries.iter().map(|(name, entry)| (name.as_str(), entry))
    }

    /// The entries that name channels.
    pub fn channels(&self) -> impl Iterator<Item = (&str, &MapEntry)> {
        self.iter().filter(|(name, _)| !name.starts_with('@'))
    }

    /// The entry of this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&MapEntry> {
        self.entries.get(name)
    }

    fn add(&mut self, name: &str, value: &str, origin: &str) -> Result<(), String> {
        if name.contains('/') || name == "." {
            return Err(format!("channel name {name:?}; a name has no /"));
        }
        if name.starts_with('@') && name != SHAFT_SPEED && name != START_TIME {
            return Err(format!("{name}; of names with @ there are {SHAFT_SPEED}, {START_TIME}"));
        }
        let entry = MapEntry::parse(value, origin)?;
        match self.entries.entry(name.to_owned()) {
            Entry::Vacant(place) => {
                place.insert(entry);
                Ok(())
            }
            Entry::Occupied(_) => Err(format!("{name} is mapped twice; name each channel once")),
        }
    }
}

impl MapEntry {
    fn parse(text: &str, origin: &str) -> Result<Self, String> {
        let mut parts = text.split(',').map(str::trim);
        let path = parts.next().unwrap_or_default();
        if !path.starts_with('/') {
            return Err(format!("path {path:?}; a path begins with /"));
        }
        let mut entry = Self {
            origin: origin.to_owned(),
            path: path.to_owned(),
            column: None,
            row: None,
            rate: None,
            interval: None,
            time: None,
            unit: None,
            scale: None,
            offset: None,
        };
        for part in parts {
            let (key, value) =
                part.split_once('=').ok_or_else(|| format!("{part:?}; options are {OPTIONS}"))?;
            entry.set(key.trim(), value.trim())?;
        }
        if entry.column.is_some() && entry.row.is_some() {
            return Err("column and row; give one of them".to_owned());
        }
        let rates = [entry.rate.is_some(), entry.interval.is_some(), entry.time.is_some()];
        if rates.iter().filter(|given| **given).count() > 1 {
            return Err("more than one of rate, interval and time; give one of them".to_owned());
        }
        Ok(entry)
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        match key {
            "column" => once(&mut self.column, key, index(key, value)?),
            "row" => once(&mut self.row, key, index(key, value)?),
            "rate" => once(&mut self.rate, key, number_at(key, value)?),
            "interval" => once(&mut self.interval, key, number_at(key, value)?),
            "scale" => once(&mut self.scale, key, number_at(key, value)?),
            "offset" => once(&mut self.offset, key, number_at(key, value)?),
            "unit" => {
                let place = Place::parse(value);
                once(&mut self.unit, key, place.map_or(TextAt::Value(value.to_owned()), TextAt::At))
            }
            "time" => {
                let place = Place::parse(value).ok_or_else(|| {
                    format!("time={value}; the place of the times, a path that begins with /")
                })?;
                once(&mut self.time, key, place)
            }
            _ => Err(format!("unknown option {key:?}; options are {OPTIONS}")),
        }
    }
}

impl Place {
    /// Reads `@attribute`, `/path@attribute` or `/path`; `None` for any other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (path, attribute) = match text.rsplit_once('@') {
            Some((path, attribute)) => (path, Some(attribute)),
            None => (text, None),
        };
        let is_place = attribute != Some("")
            && if path.is_empty() { attribute.is_some() } else { path.starts_with('/') };
        is_place.then(|| Self {
            path: (!path.is_empty()).then(|| path.to_owned()),
            attribute: attribute.map(str::to_owned),
        })
    }
}

fn once<T>(slot: &mut Option<T>, key: &str, value: T) -> Result<(), String> {
    match slot.replace(value) {
        None => Ok(()),
        Some(_) => Err(format!("{key} stands twice")),
    }
}

fn index(key: &str, value: &str) -> Result<usize, String> {
    value.parse().map_err(|_| format!("{key}={value}; a whole number from 0"))
}

fn number_at(key: &str, value: &str) -> Result<NumberAt, String> {
    if let Some(place) = Place::parse(value) {
        return Ok(NumberAt::At(place));
    }
    match value.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(NumberAt::Value(number)),
        Ok(_) | Err(_) => Err(format!(
            "{key}={value}; a number, or its place: @attribute, /path@attribute, /path"
        )),
    }
}
