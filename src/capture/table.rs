//! Columns of a CSV or WAV file to channels: the map, units, rates and conversions.
//!
//! Must not know how the columns are stored.

use super::channel_unit;
use super::convert::Conversion;
use super::error::CaptureError;
use super::hints::Hints;
use super::info::ChannelDescription;
use super::map::{ChannelMap, MapEntry, NumberAt, TextAt};
use super::received::{NumberType, RawSamples};
use super::rows::Column;
use crate::machine::Machine;
use crate::signal::{ChannelIndex, ChannelInfo};
use crate::units::{Hz, SourceUnit};
use std::collections::BTreeMap;
use std::path::Path;

/// Sample rates that make sense, Hz.
pub(super) const RATE_RANGE_HZ: (f64, f64) = (1e-6, 1e9);

/// Below this, a rate that times give is doubtful.
const SLOW: Hz = Hz(10.0);

/// Relative difference up to which two statements of a rate agree.
const RATE_AGREES: f64 = 1e-3;

/// A column as the file describes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Offered {
    /// Its number in the file, from 0.
    pub(super) column: usize,
    /// Name of the channel, if the map gives no other.
    pub(super) name: String,
    /// The heading as written; empty without one.
    pub(super) heading: String,
    /// The unit as written.
    pub(super) unit: Option<String>,
}

/// A column that becomes a channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chosen {
    pub(super) name: String,
    pub(super) column: usize,
    pub(super) unit: Option<String>,
    pub(super) scale: Option<f64>,
    pub(super) offset: Option<f64>,
}

/// What the map says of a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Choice {
    /// In the order of their names.
    pub(super) channels: Vec<Chosen>,
    /// Rate, and who states it.
    pub(super) rate: Option<(Hz, String)>,
    /// Column of the times.
    pub(super) time: Option<usize>,
}

/// The map that holds for a file: the options over the machine file; `None` if neither says anything.
pub(super) fn map_of(
    path: &Path,
    machine: Option<&Machine>,
    hints: &Hints,
) -> Result<Option<BTreeMap<String, MapEntry>>, CaptureError> {
    let of_machine = match machine {
        Some(machine) => ChannelMap::of_table(&machine.capture_map, &machine.id)
            .map_err(|error| table_error(path, error.to_string()))?,
        None => ChannelMap::default(),
    };
    let entries = of_machine.iter().chain(hints.map.iter());
    let map: BTreeMap<String, MapEntry> =
        entries.map(|(name, entry)| (name.to_owned(), entry.clone())).collect();
    Ok((!map.is_empty()).then_some(map))
}

/// Takes the columns that the map names.
pub(super) fn choose(
    path: &Path,
    map: &BTreeMap<String, MapEntry>,
    offered: &[Offered],
) -> Result<Choice, CaptureError> {
    let mut choice = Choice::default();
    for (name, entry) in map {
        let failed =
            |problem: String| table_error(path, format!("{}: {name}: {problem}", entry.origin));
        if name.starts_with('@') {
            let remedy = "CSV and WAV have no place for it; give --speed to diagnose";
            return Err(failed(remedy.to_owned()));
        }
        let column = column_of(entry, offered).map_err(failed)?;
        if let Some(rate) = rate_of(entry).map_err(failed)? {
            let other = choice.rate.as_ref().is_some_and(|(known, _)| !agree(*known, rate));
            if other {
                return Err(failed(format!(
                    "{} Hz; all columns of a file have one rate, another entry says otherwise",
                    rate.0
                )));
            }
            choice.rate = Some((rate, entry.origin.clone()));
        }
        if let Some(time) = &entry.time {
            let place = time.path.as_deref().filter(|_| time.attribute.is_none());
            let named = place.and_then(|path| named(path, offered));
            let Some(time) = named else {
                return Err(failed(no_column(place.unwrap_or_default(), offered)));
            };
            if choice.time.is_some_and(|known| known != time) {
                return Err(failed("all columns of a file have one time column".to_owned()));
            }
            choice.time = Some(time);
        }
        let (scale, offset) =
            (number(entry.scale.as_ref(), "scale"), number(entry.offset.as_ref(), "offset"));
        let unit = match &entry.unit {
            None => offered.iter().find(|o| o.column == column).and_then(|o| o.unit.clone()),
            Some(TextAt::Value(unit)) if SourceUnit::parse(unit).is_none() => {
                let accepted = SourceUnit::ACCEPTED.join(", ");
                return Err(failed(format!("unit={unit}; expected one of {accepted}")));
            }
            Some(TextAt::Value(unit)) => Some(unit.clone()),
            Some(TextAt::At(_)) => return Err(failed(no_place("unit"))),
        };
        choice.channels.push(Chosen {
            name: name.clone(),
            column,
            unit,
            scale: scale.map_err(failed)?,
            offset: offset.map_err(failed)?,
        });
    }
    Ok(choice)
}

fn column_of(entry: &MapEntry, offered: &[Offered]) -> Result<usize, String> {
    if entry.row.is_some() {
        return Err("row=; time runs down the columns of CSV and WAV, give column=".to_owned());
    }
    match (entry.path.as_str(), entry.column) {
        ("/", Some(column)) if offered.iter().any(|o| o.column == column) => Ok(column),
        ("/", Some(column)) => {
            let n = offered.len();
            Err(format!("column={column}; there are {n}, counted from 0"))
        }
        ("/", None) => Err("the path / needs column=K, counted from 0".to_owned()),
        (_, Some(_)) => {
            Err("name the column, or number it: /NAME, or /,column=K from 0".to_owned())
        }
        (path, None) => named(path, offered).ok_or_else(|| no_column(path, offered)),
    }
}

/// The column of this name or heading.
fn named(path: &str, offered: &[Offered]) -> Option<usize> {
    let name = path.strip_prefix('/')?.trim();
    let by_name = offered.iter().find(|o| o.name == name);
    let found = by_name.or_else(|| offered.iter().find(|o| o.heading == name));
    found.filter(|_| !name.is_empty()).map(|o| o.column)
}

fn no_column(path: &str, offered: &[Offered]) -> String {
    let mut names: Vec<String> = offered.iter().take(20).map(|o| format!("/{}", o.name)).collect();
    if offered.len() > names.len() {
        names.push("…".to_owned());
    }
    format!("no column {path}; there are {}", names.join(", "))
}

fn no_place(option: &str) -> String {
    format!("{option}=; a place in the file, of which CSV and WAV have none: give the value")
}

fn number(found: Option<&NumberAt>, option: &str) -> Result<Option<f64>, String> {
    match found {
        None => Ok(None),
        Some(NumberAt::Value(value)) => Ok(Some(*value)),
        Some(NumberAt::At(_)) => Err(no_place(option)),
    }
}

fn rate_of(entry: &MapEntry) -> Result<Option<Hz>, String> {
    let rate = number(entry.rate.as_ref(), "rate")?;
    let interval = number(entry.interval.as_ref(), "interval")?;
    let Some(rate) = rate.or(interval.map(f64::recip)) else { return Ok(None) };
    let (low, high) = RATE_RANGE_HZ;
    if (low..=high).contains(&rate) {
        return Ok(Some(Hz(rate)));
    }
    Err(format!("{rate} samples a second; allowed: {low} to {high}"))
}

/// Whether two statements of a rate are the same.
pub(super) fn agree(a: Hz, b: Hz) -> bool {
    (a.0 - b.0).abs() <= RATE_AGREES * a.0.max(b.0)
}

/// A word on times that give so low a rate that they may not be in the unit assumed.
pub(super) fn slow(rate: Hz) -> Option<String> {
    let words = || {
        format!(
            "the times give {} samples a second: are they in seconds? if not, give the rate instead",
            rate.0
        )
    };
    (rate < SLOW).then(words)
}

/// Who says a rate beside the file: the map, else `--rate`.
pub(super) fn told_rate(choice: &Choice, hints: &Hints) -> Option<(Hz, String)> {
    let option = hints.rate.map(|rate| (rate, "--rate".to_owned()));
    choice.rate.clone().or(option)
}

/// What is the same for all channels of a file.
pub(super) struct Facts<'a> {
    pub(super) path: &'a Path,
    pub(super) machine: Option<&'a Machine>,
    pub(super) hints: &'a Hints,
    pub(super) kind: NumberType,
    /// Scale of channels for which the map states none.
    pub(super) scale: f64,
    /// Ends of the number range.
    pub(super) ends: Option<RawSamples>,
    pub(super) rate: Hz,
    pub(super) n_samples: u64,
    pub(super) storage: String,
}

impl Facts<'_> {
    /// Describes a channel; `first` holds its first elements.
    pub(super) fn describe(
        &self,
        chosen: &Chosen,
        channel: ChannelIndex,
        first: Option<&RawSamples>,
    ) -> Result<(ChannelDescription, Column), CaptureError> {
        let is_it = |sensor: &&crate::machine::sensor::Sensor| sensor.channel == chosen.name;
        let sensor = self.machine.and_then(|machine| machine.sensors.iter().find(is_it));
        let unit_text = chosen.unit.clone().or_else(|| self.hints.unit.clone());
        let unit = channel_unit::resolve(sensor, unit_text.as_deref());
        let (scale, offset) = (chosen.scale.unwrap_or(self.scale), chosen.offset.unwrap_or(0.0));
        let conversion = Conversion::new(self.kind, scale, offset, unit.unit.factor, first)
            .ok_or_else(|| {
                let name = &chosen.name;
                table_error(
                    self.path,
                    format!(
                        "{name}: scale {scale} and offset {offset}; allowed: finite numbers, scale not 0, the \
                         result within float32"
                    ),
                )
            })?;
        let description = ChannelDescription {
            info: ChannelInfo {
                name: chosen.name.clone(),
                sample_rate: self.rate,
                unit: unit.unit.canonical,
                offset: conversion.offset,
                unit_conflict: unit.conflict,
                full_scale: conversion.full_scale(self.ends.clone()),
            },
            n_samples: self.n_samples,
            duration_s: self.n_samples as f64 / self.rate.0,
            number_type: self.kind,
            scale,
            offset,
            raw_zero: conversion.raw_zero,
            storage: self.storage.clone(),
            unit_text,
            sensor: None,
        };
        Ok((description, Column { channel, conversion }))
    }
}

/// Channels that sensors name and the file lacks.
pub(super) fn absent(machine: Option<&Machine>, channels: &[ChannelDescription]) -> Vec<String> {
    let known = |name: &str| channels.iter().any(|channel| channel.info.name == name);
    let sensors = machine.map_or(&[][..], |machine| &machine.sensors[..]);
    sensors.iter().map(|s| &s.channel).filter(|name| !known(name)).cloned().collect()
}

/// Options of the command line that name all that was found: a start for naming it otherwise.
pub(super) fn options(rate: Option<Hz>, chosen: &[Chosen], offered: &[Offered]) -> String {
    let mut options: Vec<String> = rate.iter().map(|rate| format!("--rate {}", rate.0)).collect();
    for channel in chosen {
        let plain = |o: &&Offered| {
            o.column == channel.column
                && !o.name.contains([',', '@', '\''])
                && named(&format!("/{}", o.name), offered) == Some(o.column)
        };
        let mut entry = match offered.iter().find(plain) {
            Some(o) => format!("{}=/{}", channel.name, o.name),
            None => format!("{}=/,column={}", channel.name, channel.column),
        };
        if let Some(unit) = channel.unit.as_deref().filter(|unit| SourceUnit::parse(unit).is_some())
        {
            entry.push_str(&format!(",unit={unit}"));
        }
        options.push(format!("--map '{}'", entry.replace('\'', r"'\''")));
    }
    options.join(" ")
}

/// What is wrong with a file as a whole.
pub(super) fn table_error(path: &Path, problem: String) -> CaptureError {
    CaptureError::Table { file: path.into(), problem }
}
