//! Which data sets of a file could be channels, and the map entries that would read them.
//!
//! Rates, intervals, times and units are recognised by the names that MATLAB scripts, LabVIEW and
//! h5py users give them. Nothing is read by a suggestion: it is printed for people to judge.

use super::inventory::{Kind, NOT_READABLE, Object};
use super::objects::Element;
use super::spelling;
use crate::capture::hdf5::Attribute;
use crate::capture::layout::{RATE_RANGE_HZ, start_time_of};
use crate::capture::map::{SHAFT_SPEED, START_TIME};
use std::collections::BTreeSet;

/// Samples a data set has at least to be taken for a channel.
pub(super) const SAMPLES_MIN: usize = 256;

/// Channels of one data set at most: what has more is a picture.
const COLUMNS_MAX: usize = 64;

/// Entries at most.
const ENTRIES_MAX: usize = 64;

/// Names of rates; compared without case and signs.
const RATES: [&str; 21] = [
    "fs",
    "fsamp",
    "fsample",
    "fshz",
    "sr",
    "srate",
    "rate",
    "ratehz",
    "samplerate",
    "sampleratehz",
    "samplingrate",
    "samplingratehz",
    "samplefreq",
    "samplefrequency",
    "samplingfreq",
    "samplingfrequency",
    "samplingfrequencyhz",
    "samplesrate",
    "samplespersecond",
    "acquisitionrate",
    "scanrate",
];

/// Names of intervals, s.
const INTERVALS: [&str; 12] = [
    "dt",
    "dts",
    "ts",
    "deltat",
    "wfincrement",
    "xincrement",
    "timestep",
    "samplinginterval",
    "sampleinterval",
    "samplingperiod",
    "sampleperiod",
    "samplingtime",
];

/// Names of vectors of times, s.
const TIMES: [&str; 7] = ["t", "time", "times", "timestamps", "timevector", "tvec", "timesec"];

/// Names of units.
const UNITS: [&str; 8] = [
    "unit",
    "units",
    "unitstring",
    "niunitdescription",
    "yunit",
    "engineeringunit",
    "engineeringunits",
    "eu",
];

/// Names of start times.
const STARTS: [&str; 6] =
    ["starttime", "wfstarttime", "timestamp", "datetime", "recordedat", "starttimeutc"];

/// Entries that would read a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Suggestion {
    /// Name and value, `/path,option=…`.
    pub(super) entries: Vec<(String, String)>,
    /// What has to be filled in or could not be named.
    pub(super) remarks: Vec<String>,
}

/// Finds the channels among the objects of a file.
pub(super) fn of(objects: &[Object]) -> Suggestion {
    let mut found = Suggestion::default();
    let mut names = BTreeSet::new();
    let mut unrated = false;
    for object in objects {
        let Some((length, n_columns)) = series(object) else { continue };
        if !is_expressible(&object.path) {
            let path = &object.path;
            found.remarks.push(format!("/{path}: a map cannot name it (a comma or @ in its path)"));
            continue;
        }
        let clue = rate(objects, object, length);
        unrated |= clue.is_none();
        let rate = clue.unwrap_or_else(|| "rate=HZ".to_owned());
        let unit = unit(objects, object).map(|unit| format!(",{unit}")).unwrap_or_default();
        for column in 0..n_columns {
            let suffix = if n_columns > 1 { format!("_{column}") } else { String::new() };
            let option = if n_columns > 1 { format!(",column={column}") } else { String::new() };
            let name = unique(&mut names, &object.path, &suffix);
            found.entries.push((name, format!("/{}{option},{rate}{unit}", object.path)));
        }
    }
    if found.entries.len() > ENTRIES_MAX {
        let more = found.entries.len() - ENTRIES_MAX;
        found.entries.truncate(ENTRIES_MAX);
        found.remarks.push(format!("{more} more data sets or columns could be channels"));
    }
    if unrated {
        found.remarks.push(
            "no sample rate was found: put the samples a second in place of HZ in rate=HZ"
                .to_owned(),
        );
    }
    if !found.entries.is_empty() {
        found.remarks.push(
            "the names before = are the file's; give them those of the machine file's sensors"
                .to_owned(),
        );
        found.entries.extend(whole(objects));
    }
    found
}

/// Samples and channels of a data set that could hold channels.
fn series(object: &Object) -> Option<(usize, usize)> {
    let Kind::Dataset { element: Element::Number(_), shape, storage, .. } = &object.kind else {
        return None;
    };
    if storage.starts_with(NOT_READABLE) {
        return None;
    }
    let is_vector = shape.iter().filter(|&&extent| extent > 1).count() <= 1;
    if is_vector && is_named(leaf(&object.path), &TIMES) || is_text(object) {
        return None;
    }
    let (length, n_columns) = match shape[..] {
        [length] => (length, 1),
        [a, b] => (a.max(b), a.min(b)),
        _ => return None,
    };
    let is_series = length >= SAMPLES_MIN && (1..=COLUMNS_MAX).contains(&n_columns);
    let of_segments = object.path.starts_with("segments/");
    (is_series && !of_segments).then_some((length, n_columns))
}

/// Whether MATLAB says that the numbers are characters, or none at all.
fn is_text(object: &Object) -> bool {
    object.attributes.iter().any(|(name, value)| match (name.as_str(), value) {
        ("MATLAB_class", Some(Attribute::Text(class))) => class == "char",
        ("MATLAB_empty", _) => true,
        _ => false,
    })
}

/// The option that gives the rate, by the data set's own attributes, then its group and those above.
fn rate(objects: &[Object], dataset: &Object, length: usize) -> Option<String> {
    for (option, names) in [("rate", &RATES[..]), ("interval", &INTERVALS[..])] {
        for (name, value) in &dataset.attributes {
            let own = name == "sample_rate_hz" || is_named(name, names);
            if own && is_option(name) && is_rate(option, value.as_ref()) {
                return Some(format!("{option}=@{name}"));
            }
        }
    }
    let groups = above(&dataset.path);
    for group in &groups {
        let facts = facts(objects, group);
        for (option, names) in [("rate", &RATES[..]), ("interval", &INTERVALS[..])] {
            let right = |(name, _, value): &&(String, String, &Attribute)| {
                is_named(name, names) && is_rate(option, Some(value))
            };
            if let Some((_, place, _)) = facts.iter().find(right) {
                return Some(format!("{option}={place}"));
            }
        }
    }
    let times = |group: &&str| {
        objects.iter().find(|object| {
            let fits = match &object.kind {
                Kind::Dataset { element: Element::Number(_), shape, .. } => {
                    shape.iter().product::<usize>() == length && shape.contains(&length)
                }
                Kind::Dataset { .. } | Kind::Group | Kind::Remark(_) => false,
            };
            fits && parent(&object.path) == *group
                && is_named(leaf(&object.path), &TIMES)
                && is_expressible(&object.path)
        })
    };
    groups.iter().find_map(times).map(|object| format!("time=/{}", object.path))
}

/// Names, places and values of what stands in a group: its attributes, its data sets of one element.
fn facts<'a>(objects: &'a [Object], group: &str) -> Vec<(String, String, &'a Attribute)> {
    let mut facts = Vec::new();
    for object in objects {
        if let Kind::Dataset { value: Some(value), .. } = &object.kind
            && parent(&object.path) == group
            && is_expressible(&object.path)
        {
            facts.push((leaf(&object.path).to_owned(), format!("/{}", object.path), value));
        }
        if object.kind == Kind::Group && object.path == group && is_expressible(group) {
            let options = object.attributes.iter().filter(|(name, _)| is_option(name));
            facts.extend(options.filter_map(|(name, value)| {
                Some((name.clone(), format!("/{group}@{name}"), value.as_ref()?))
            }));
        }
    }
    facts
}

fn is_rate(option: &str, value: Option<&Attribute>) -> bool {
    let number = match value {
        Some(Attribute::Number(number)) => *number,
        Some(Attribute::Text(text)) => text.trim().parse().unwrap_or(0.0),
        Some(Attribute::Other(_)) | None => return false,
    };
    let rate = if option == "rate" { number } else { 1.0 / number };
    (RATE_RANGE_HZ.0..=RATE_RANGE_HZ.1).contains(&rate)
}

/// The option that gives the unit: an attribute of the data set, or what stands beside it.
fn unit(objects: &[Object], dataset: &Object) -> Option<String> {
    let is_unit = |name: &str, value: &Attribute| match value {
        Attribute::Text(text) => is_named(name, &UNITS) && spelling::unit(text).is_some(),
        Attribute::Number(_) | Attribute::Other(_) => false,
    };
    let own = dataset.attributes.iter().find(|(name, value)| {
        is_option(name) && value.as_ref().is_some_and(|value| is_unit(name, value))
    });
    if let Some((name, _)) = own {
        return Some(format!("unit=@{name}"));
    }
    let beside = facts(objects, parent(&dataset.path));
    let found = beside.into_iter().find(|(name, _, value)| is_unit(name, value));
    found.map(|(_, place, _)| format!("unit={place}"))
}

/// Entries of the whole recording: speed of the shaft, start.
fn whole(objects: &[Object]) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let all: Vec<_> = objects
        .iter()
        .filter(|object| object.kind == Kind::Group)
        .flat_map(|group| facts(objects, &group.path))
        .collect();
    let speed = all.iter().find_map(|(name, place, value)| {
        let Attribute::Number(number) = value else { return None };
        let name = bare(name);
        let unit = match name.as_str() {
            "shaftspeed" | "shaftspeedhz" | "shaftfrequency" | "rotationfrequency" => "Hz",
            _ if name.ends_with("rpm") || name.ends_with("shaftspeedrpm") => "rpm",
            _ => return None,
        };
        (*number > 0.0 && place != "/@shaft_speed_hz").then(|| format!("{place},unit={unit}"))
    });
    found.extend(speed.map(|entry| (SHAFT_SPEED.to_owned(), entry)));
    let start = all.iter().find(|(name, place, value)| {
        let is_time = matches!(value, Attribute::Text(text) if start_time_of(text).is_some());
        is_time && is_named(name, &STARTS) && place != "/@start_time"
    });
    found.extend(start.map(|(_, place, _)| (START_TIME.to_owned(), place.clone())));
    found
}

/// A channel's name from the path of its data set, not used yet.
fn unique(names: &mut BTreeSet<String>, path: &str, suffix: &str) -> String {
    let keep = |c: char| if c.is_alphanumeric() || "_-.".contains(c) { c } else { '_' };
    let short = leaf(path).chars().map(keep).take(100).collect::<String>();
    let long = path.chars().map(keep).take(100).collect::<String>();
    let numbered = (2..).map(|n: u32| format!("{long}{suffix}_{n}"));
    let mut tries =
        [format!("{short}{suffix}"), format!("{long}{suffix}")].into_iter().chain(numbered);
    let is_name = |name: &String| !name.is_empty() && name != "." && name != "..";
    let name = tries.find(|name| is_name(name) && !names.contains(name)).unwrap_or_default();
    names.insert(name.clone());
    name
}

/// Groups from that of `path` up to the root.
fn above(path: &str) -> Vec<&str> {
    let mut groups = vec![parent(path)];
    while let Some(last) = groups.last().filter(|group| !group.is_empty()) {
        groups.push(parent(last));
    }
    groups
}

fn parent(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(parent, _)| parent)
}

fn leaf(path: &str) -> &str {
    path.rsplit_once('/').map_or(path, |(_, leaf)| leaf)
}

/// Whether the name, without case and signs, is one of these.
fn is_named(name: &str, names: &[&str]) -> bool {
    names.contains(&bare(name).as_str())
}

fn bare(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Whether a map can name this path.
fn is_expressible(path: &str) -> bool {
    is_option(path)
}

fn is_option(text: &str) -> bool {
    !text.contains([',', '@']) && text.trim() == text && !text.chars().any(char::is_control)
}
