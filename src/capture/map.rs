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

    /// This map, and what `below` says of names this one does not have.
    #[must_use]
    pub fn over(&self, below: &Self) -> Self {
        let mut entries = below.entries.clone();
        entries.extend(self.entries.clone());
        Self { entries }
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
        if name.starts_with('@') {
            entry.check_fact(name)?;
        }
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
        let mut entry = Self::at(path, origin);
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

    /// Refuses what an entry of the whole recording cannot have.
    fn check_fact(&self, name: &str) -> Result<(), String> {
        if Place::parse(&self.path).is_none() {
            return Err(format!("{}; expected /path or /path@attribute", self.path));
        }
        let unit_alone = Self {
            unit: if name == SHAFT_SPEED { self.unit.clone() } else { None },
            ..Self::at(&self.path, &self.origin)
        };
        if *self == unit_alone {
            return Ok(());
        }
        let allowed = if name == SHAFT_SPEED { "unit=Hz or unit=rpm" } else { "none" };
        Err(format!("an option that {name} does not have; allowed: {allowed}"))
    }

    /// An entry without options.
    fn at(path: &str, origin: &str) -> Self {
        Self {
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
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn one(option: &str) -> MapEntry {
        let map = ChannelMap::of_options(&[option]).unwrap();
        let (_, entry) = map.iter().next().unwrap();
        entry.clone()
    }

    fn wrong(option: &str) -> String {
        ChannelMap::of_options(&[option]).unwrap_err().to_string()
    }

    fn place(path: Option<&str>, attribute: Option<&str>) -> Place {
        Place { path: path.map(str::to_owned), attribute: attribute.map(str::to_owned) }
    }

    #[test]
    fn every_option_is_read() {
        let entry = one("x = /a/b , column=2, rate = @fs,unit=/u@name,scale=-2e-3,offset=/off");
        let expected = MapEntry {
            column: Some(2),
            rate: Some(NumberAt::At(place(None, Some("fs")))),
            unit: Some(TextAt::At(place(Some("/u"), Some("name")))),
            scale: Some(NumberAt::Value(-2e-3)),
            offset: Some(NumberAt::At(place(Some("/off"), None))),
            ..MapEntry::at("/a/b", "--map")
        };
        assert_eq!(entry, expected);
        let entry = one("x=/t,row=0,interval=1e-4,unit=m/s^2");
        assert_eq!((entry.row, entry.interval), (Some(0), Some(NumberAt::Value(1e-4))));
        assert_eq!(entry.unit, Some(TextAt::Value("m/s^2".into())));
        assert_eq!(one("x=/y,time=/t").time, Some(place(Some("/t"), None)));
        // An = behind the first belongs to the path.
        assert_eq!(one("x=/a=b").path, "/a=b");
    }

    #[test]
    fn places_are_told_from_values() {
        for (text, expected) in [
            ("@fs", Some(place(None, Some("fs")))),
            ("/g/x@fs", Some(place(Some("/g/x"), Some("fs")))),
            ("/@fs", Some(place(Some("/"), Some("fs")))),
            ("/fs", Some(place(Some("/fs"), None))),
            ("fs", None),
            ("x@fs", None),
            ("/x@", None),
            ("@", None),
            ("", None),
        ] {
            assert_eq!(Place::parse(text), expected, "{text}");
        }
    }

    #[test]
    fn every_mistake_names_the_entry_and_the_remedy() {
        for (option, words) in [
            ("x", "expected NAME=/path"),
            ("=/x", "expected NAME=/path"),
            ("x=y", "a path begins with /"),
            ("a/b=/x", "a name has no /"),
            ("x=/x,colum=1", "options are column, row"),
            ("x=/x,column", "options are column, row"),
            ("x=/x,column=-1", "a whole number from 0"),
            ("x=/x,column=1,row=1", "give one of them"),
            ("x=/x,rate=1,time=/t", "give one of them"),
            ("x=/x,rate=1,rate=2", "rate stands twice"),
            ("x=/x,rate=fast", "a number, or its place"),
            ("x=/x,rate=inf", "a number, or its place"),
            ("x=/x,time=1", "the place of the times"),
            ("@speed=/x", "@shaft_speed, @start_time"),
            ("@shaft_speed=/x,rate=2", "allowed: unit=Hz or unit=rpm"),
            ("@start_time=/x,unit=g", "allowed: none"),
            ("@start_time=/x@", "/path@attribute"),
        ] {
            let text = wrong(option);
            assert!(text.starts_with(&format!("--map: {option}: ")), "{text}");
            assert!(text.contains(words), "{option}: {text}");
        }
        let twice = ChannelMap::of_options(&["x=/a", "x=/b"]).unwrap_err().to_string();
        assert_eq!(twice, "--map: x=/b: x is mapped twice; name each channel once");
        let table = BTreeMap::from([("x".to_owned(), "/a,hz=1".to_owned())]);
        let text = ChannelMap::of_table(&table, "rig.toml").unwrap_err().to_string();
        assert!(
            text.starts_with("[capture.map] of rig.toml: x = \"/a,hz=1\": unknown option"),
            "{text}"
        );
    }

    #[test]
    fn options_stand_over_the_machine_file_channel_by_channel() {
        let table = BTreeMap::from([
            ("x".to_owned(), "/a,rate=1".to_owned()),
            ("y".to_owned(), "/b".to_owned()),
        ]);
        let below = ChannelMap::of_table(&table, "rig.toml").unwrap();
        let map =
            ChannelMap::of_options(&["x=/c", "@shaft_speed=/rpm,unit=rpm"]).unwrap().over(&below);
        let paths: Vec<_> = map.iter().map(|(name, entry)| (name, entry.path.as_str())).collect();
        assert_eq!(paths, [("@shaft_speed", "/rpm"), ("x", "/c"), ("y", "/b")]);
        assert_eq!(map.get("x").unwrap().rate, None);
        assert_eq!(map.channels().count(), 2);
    }
}
