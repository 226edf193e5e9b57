//! Opening an HDF5 file of another layout by a map: each channel looked up, checked, and joined
//! with the other channels of its data set into one table.
//!
//! Values the map names are used or refused; attributes of the file that nobody named (`unit`,
//! `scale`, `start_time`, …) are used if they are right and noted if not.

use super::facts::{self, Facts};
use super::grid::{Strip, TableRows};
use super::objects::{Element, Number};
use super::places::{self, Places, Problem};
use super::spelling;
use super::times::TimeAxis;
use crate::capture::channel_unit;
use crate::capture::checks::{Checks, Chunks};
use crate::capture::convert::Conversion;
use crate::capture::error::CaptureError;
use crate::capture::hdf5::{Attribute, Dataset, File};
use crate::capture::hints::{Hints, Overruled};
use crate::capture::info::{CaptureInfo, CaptureKind, ChannelDescription};
use crate::capture::layout::{CHANNELS_MAX, RATE_RANGE_HZ, absent_channels, duration_s};
use crate::capture::map::{ChannelMap, MapEntry, NumberAt, TextAt};
use crate::capture::open::Opened;
use crate::capture::received::RawSamples;
use crate::capture::rows::{Column, Rows, Source};
use crate::capture::segments::Segments;
use crate::capture::table;
use crate::machine::Machine;
use crate::signal::{ChannelIndex, ChannelInfo, Timestamp};
use crate::units::{Hz, SourceUnit};
use std::collections::BTreeMap;

/// Rows read to find the constant that is kept beside the samples.
const FIRST_ROWS: u64 = 1024;

/// Opens the file as `map` says.
pub(in crate::capture) fn open(
    checks: &Checks<'_>,
    file: &File,
    machine: Option<&Machine>,
    hints: &Hints,
    map: &ChannelMap,
) -> Result<Opened, CaptureError> {
    let places = Places { checks, file };
    let facts = facts::read(places, map)?;
    let mut mapped = Mapped {
        places,
        machine,
        hints,
        axes: BTreeMap::new(),
        notes: facts.notes.clone(),
        overruled: Overruled::default(),
        chunks: Chunks::default(),
    };
    let planned = mapped.plan(map)?;
    let segments = mapped.segments(&planned)?;
    let (described, sources) = mapped.tables(planned)?;
    let absent_channels = absent_channels(machine, &described);
    mapped.notes.extend(mapped.overruled.notes(described.len()));
    let Facts { start_time, machine: machine_text, shaft_speed, others, .. } = facts;
    let counted = || mapped.axes.values().find_map(|axis| axis.start_ns).map(Timestamp);
    let start_time = start_time.or_else(counted);
    let several = segments.len() > 1;
    let info = CaptureInfo {
        file: checks.path.into(),
        file_bytes: checks.file_bytes,
        format_stated: false,
        kind: CaptureKind::Hdf5,
        options: None,
        is_mapped: true,
        start_time,
        machine: machine_text,
        shaft_speed,
        load: None,
        segments: several.then(|| segments.len()),
        duration_s: duration_s(&described, &segments),
        channels: described,
        other_attributes: others,
        ignored: Vec::new(),
        absent_channels,
        notes: mapped.notes,
    };
    Ok(Opened { info, sources, segments })
}

/// An error of an entry.
pub(super) fn entry_error(
    checks: &Checks<'_>,
    origin: &str,
    name: &str,
    problem: Problem,
) -> CaptureError {
    match problem {
        Problem::Whole(error) => error,
        Problem::Words(problem) => CaptureError::Mapped {
            file: checks.path.into(),
            origin: origin.to_owned(),
            entry: name.to_owned(),
            problem,
        },
    }
}

/// A channel as its entry says.
struct Planned<'a> {
    name: &'a str,
    entry: &'a MapEntry,
    /// Path of its data set without soft links.
    object: String,
    number: Number,
    strip: Strip,
    rate: Hz,
    /// Path of its times.
    times: Option<String>,
}

/// What is known while channels are looked up.
struct Mapped<'a> {
    places: Places<'a>,
    machine: Option<&'a Machine>,
    hints: &'a Hints,
    /// Vectors of times read, by path and length.
    axes: BTreeMap<(String, u64), TimeAxis>,
    notes: Vec<String>,
    /// What the file says otherwise than the caller.
    overruled: Overruled,
    chunks: Chunks,
}

impl Mapped<'_> {
    /// Looks every channel up, in the order of their names.
    fn plan<'m>(&mut self, map: &'m ChannelMap) -> Result<Vec<Planned<'m>>, CaptureError> {
        let n = map.channels().count();
        if n > CHANNELS_MAX {
            let what = "mapped channels".to_owned();
            let remedy = "split the capture";
            return Err(self.places.checks.limit(what, n as u64, CHANNELS_MAX as u64, remedy));
        }
        let mut planned = Vec::new();
        for (name, entry) in map.channels() {
            let found = self.look_up(name, entry);
            let checks = self.places.checks;
            planned.push(found.map_err(|e| entry_error(checks, &entry.origin, name, e))?);
        }
        match planned.iter().map(|channel| channel.strip.length).max() {
            None => {
                let words = "no entry names a channel; add NAME=/path".to_owned();
                let origin = map.iter().next().map_or("--map", |(_, entry)| &entry.origin);
                Err(entry_error(self.places.checks, origin, "the map", Problem::Words(words)))
            }
            Some(0) => {
                let file = self.places.checks.path.into();
                Err(CaptureError::Empty { file, found: "every channel has 0 samples" })
            }
            Some(_) => Ok(planned),
        }
    }

    fn look_up<'m>(&mut self, name: &'m str, entry: &'m MapEntry) -> Result<Planned<'m>, Problem> {
        let (dataset, object) = self.places.dataset(&entry.path)?;
        let number = self.number_type(&dataset, &object)?;
        let strip = Strip::find(&dataset.shape(), entry.column, entry.row)?;
        let (rate, times) = self.rate(entry, &dataset, &object, strip.length)?;
        let (low, high) = RATE_RANGE_HZ;
        if !(low..=high).contains(&rate.0) {
            return Err(format!("{} samples a second; expected {low} to {high}", rate.0).into());
        }
        Ok(Planned { name, entry, object, number, strip, rate, times })
    }

    /// The stored number type of samples.
    fn number_type(&self, dataset: &Dataset, object: &str) -> Result<Number, Problem> {
        let class = dataset.matlab_class();
        let element = dataset.element().map_err(|e| self.places.checks.library(object, e))?;
        if let Some(words) = no_samples(&class, dataset, &element) {
            return Err(words.into());
        }
        match element {
            Element::Number(number) => Ok(number),
            Element::Text => Err("texts; expected numbers".to_owned().into()),
            Element::Other(what) => {
                Err(format!("{what}; expected integers or floats of 16, 32 or 64 bits").into())
            }
        }
    }

    /// Samples a second: the entry's word, else the data set's, else the caller's.
    fn rate(
        &mut self,
        entry: &MapEntry,
        dataset: &Dataset,
        object: &str,
        length: u64,
    ) -> Result<(Hz, Option<String>), Problem> {
        if let Some(rate) = &entry.rate {
            return Ok((Hz(self.number(rate, object)?), None));
        }
        if let Some(interval) = &entry.interval {
            let interval_s = self.number(interval, object)?;
            return Ok((Hz(1.0 / interval_s), None));
        }
        if let Some(place) = &entry.time {
            let (None, Some(path)) = (&place.attribute, &place.path) else {
                let shown = places::shown(place);
                return Err(format!("time={shown}: expected the path of a data set").into());
            };
            let key = (path.clone(), length);
            if !self.axes.contains_key(&key) {
                let axis = TimeAxis::read(self.places, path, length)?;
                let slow = table::slow(axis.rate);
                self.notes.extend(slow.map(|words| format!("time={path}: {words}")));
                self.axes.insert(key.clone(), axis);
            }
            return Ok((self.axes[&key].rate, Some(path.clone())));
        }
        match dataset
            .attribute("sample_rate_hz")
            .map_err(|e| self.places.checks.library(object, e))?
        {
            Some(Attribute::Number(rate)) => {
                self.overruled.rate(self.hints, object, Hz(rate));
                return Ok((Hz(rate), None));
            }
            Some(other) => self.notes.push(format!(
                "/{object}: attribute sample_rate_hz is {}, not a number: not used",
                other.describe()
            )),
            None => {}
        }
        match self.hints.rate {
            Some(rate) => Ok((rate, None)),
            None => Err("no sample rate; add rate=HZ, interval=S, rate=@attribute, rate=/path or time=/path, or give --rate HZ"
                .to_owned()
                .into()),
        }
    }

    fn number(&self, number: &NumberAt, own: &str) -> Result<f64, Problem> {
        match number {
            NumberAt::Value(value) => Ok(*value),
            NumberAt::At(place) => self.places.number(place, Some(own)),
        }
    }

    /// Contiguous runs, if all channels share one vector of times; gaps in any other are refused.
    fn segments(&self, planned: &[Planned<'_>]) -> Result<Segments, CaptureError> {
        let reference = planned
            .iter()
            .map(|channel| channel.rate)
            .fold(Hz(0.0), |a, b| if b > a { b } else { a });
        let shared = planned.first().and_then(|first| {
            let key = (first.times.clone()?, first.strip.length);
            let alike = |c: &Planned<'_>| c.times == first.times && c.strip.length == key.1;
            planned.iter().all(alike).then_some(key)
        });
        if let Some(axis) = shared.as_ref().and_then(|key| self.axes.get(key)) {
            let length = shared.map_or(0, |(_, length)| length);
            let segments = Segments::new(&axis.starts, axis.times_s.clone(), reference, length);
            return segments.map_err(|problem| CaptureError::Content {
                file: self.places.checks.path.into(),
                object: "the times".into(),
                problem,
            });
        }
        for channel in planned {
            let Some(times) = &channel.times else { continue };
            let axis = &self.axes.get(&(times.clone(), channel.strip.length));
            if let Some(gap) = axis.and_then(|axis| axis.starts.get(1)) {
                let words = format!(
                    "time={times} has a gap before element {gap}, and not every channel has these times; map the others apart"
                );
                let checks = self.places.checks;
                let origin = &channel.entry.origin;
                return Err(entry_error(checks, origin, channel.name, Problem::Words(words)));
            }
        }
        Ok(Segments::one(reference))
    }

    /// Joins the channels of each data set into a table.
    fn tables(
        &mut self,
        planned: Vec<Planned<'_>>,
    ) -> Result<(Vec<ChannelDescription>, Vec<Source>), CaptureError> {
        let mut described: Vec<Option<ChannelDescription>> = planned.iter().map(|_| None).collect();
        let mut tables: BTreeMap<(String, usize, u64), Vec<(usize, Planned<'_>)>> = BTreeMap::new();
        for (index, channel) in planned.into_iter().enumerate() {
            let key = (channel.object.clone(), channel.strip.axis, channel.rate.0.to_bits());
            tables.entry(key).or_default().push((index, channel));
        }
        let mut sources = Vec::new();
        for ((object, ..), channels) in tables {
            sources.push(self.table(object, &channels, &mut described)?);
        }
        sources.sort_by_key(|source| source.columns.first().map(|column| column.channel.0));
        Ok((described.into_iter().flatten().collect(), sources))
    }

    /// One data set, and the channels it holds, with their places in the list of all.
    fn table(
        &mut self,
        object: String,
        channels: &[(usize, Planned<'_>)],
        described: &mut [Option<ChannelDescription>],
    ) -> Result<Source, CaptureError> {
        let checks = self.places.checks;
        let dataset = self.places.file.dataset(&object).map_err(|e| checks.library(&object, e))?;
        let (_, first) = &channels[0];
        let (strip, number, rate) = (first.strip, first.number, first.rate);
        let at: Vec<usize> = channels.iter().map(|(_, channel)| channel.strip.at).collect();
        let (_, width) = TableRows::range(&at);
        let slab: Vec<u64> = strip.extents(1, width).iter().map(|&n| n as u64).collect();
        let bytes = (number.bytes(), number.read_as().bytes());
        let (chunk, storage) =
            checks.box_storage(&dataset, &object, bytes, &slab, &mut self.chunks)?;
        let across = |extents: &Vec<u64>| strip.rank == 2 && extents[1 - strip.axis] > 1;
        let alone = strip.rank == 2 && strip.axis == 1 && !chunk.as_ref().is_some_and(across);
        let length = strip.length;
        let file = checks.path.to_owned();
        let mut rows = TableRows {
            file: file.clone(),
            object: object.clone(),
            dataset,
            number,
            strip,
            places: at,
            alone,
        };
        let begin = rows.read(0, length.min(FIRST_ROWS))?;
        let mut columns = Vec::new();
        for ((index, channel), begin) in channels.iter().zip(begin) {
            let described_as = self.describe(&rows.dataset, channel, &begin, &storage);
            let (description, conversion) = described_as
                .map_err(|e| entry_error(checks, &channel.entry.origin, channel.name, e))?;
            described[*index] = Some(description);
            columns.push(Column { channel: ChannelIndex(*index), conversion });
        }
        let width = if alone { columns.len() } else { width };
        Ok(Source {
            file,
            object,
            rows: Box::new(rows),
            columns,
            length,
            rate,
            chunk: chunk.map_or(1, |extents| extents[strip.axis]),
            width: width as u64,
        })
    }

    fn describe(
        &mut self,
        dataset: &Dataset,
        channel: &Planned<'_>,
        begin: &RawSamples,
        storage: &str,
    ) -> Result<(ChannelDescription, Conversion), Problem> {
        let Planned { name, entry, object, number, strip, rate, .. } = channel;
        let unit_text = self.unit(entry, dataset, object)?;
        let sensor_of =
            |machine: &&Machine| machine.sensors.iter().find(|s| s.channel == *name).cloned();
        let sensor = self.machine.as_ref().and_then(sensor_of);
        let unit = channel_unit::resolve(sensor.as_ref(), unit_text.as_deref());
        let scale = self.calibration("scale", entry.scale.as_ref(), dataset, object)?;
        let offset = self.calibration("offset", entry.offset.as_ref(), dataset, object)?;
        let (scale, offset) = (scale.unwrap_or(1.0), offset.unwrap_or(0.0));
        let kind = number.read_as();
        let conversion = Conversion::new(kind, scale, offset, unit.unit.factor, Some(begin))
            .ok_or_else(|| {
                format!("scale {scale} and offset {offset}; expected finite numbers, scale not 0, the result within float32")
            })?;
        let description = ChannelDescription {
            info: ChannelInfo {
                name: (*name).to_owned(),
                sample_rate: *rate,
                unit: unit.unit.canonical,
                offset: conversion.offset,
                unit_conflict: unit.conflict,
                full_scale: conversion.full_scale(kind.ends()),
            },
            n_samples: strip.length,
            duration_s: strip.length as f64 / rate.0,
            number_type: kind,
            scale,
            offset,
            raw_zero: conversion.raw_zero,
            storage: format!("/{object}, {}, {storage}", number.name()),
            unit_text,
            sensor: None,
        };
        Ok((description, conversion))
    }

    /// Spelling of the unit: the entry's word, else the data set's, else the caller's.
    fn unit(
        &mut self,
        entry: &MapEntry,
        dataset: &Dataset,
        object: &str,
    ) -> Result<Option<String>, Problem> {
        let known = |text: &str| spelling::unit(text).map(str::to_owned);
        let accepted = || SourceUnit::ACCEPTED.join(", ");
        match &entry.unit {
            Some(TextAt::Value(text)) => {
                let unit = known(text)
                    .ok_or_else(|| format!("unit={text}; expected one of {}", accepted()))?;
                return Ok(Some(unit));
            }
            Some(TextAt::At(place)) => {
                let text = self.places.text(place, Some(object))?;
                return Ok(Some(known(&text).unwrap_or(text)));
            }
            None => {}
        }
        for name in ["unit", "units"] {
            let found = dataset.attribute(name);
            let found = found.map_err(|e| self.places.checks.library(object, e))?;
            let Some(Attribute::Text(text)) = found else { continue };
            match known(&text) {
                Some(unit) => {
                    self.overruled.unit(self.hints, object, &unit);
                    return Ok(Some(unit));
                }
                None if text.trim().is_empty() => {}
                None => self.notes.push(format!(
                    "/{object}: attribute {name} is {}, none of {}: not used",
                    Attribute::Text(text).describe(),
                    accepted()
                )),
            }
        }
        Ok(self.hints.unit.clone())
    }

    /// `scale` or `offset`: the entry's word, else the data set's attribute.
    fn calibration(
        &mut self,
        name: &str,
        said: Option<&NumberAt>,
        dataset: &Dataset,
        object: &str,
    ) -> Result<Option<f64>, Problem> {
        if let Some(number) = said {
            return self.number(number, object).map(Some);
        }
        match dataset.attribute(name).map_err(|e| self.places.checks.library(object, e))? {
            Some(Attribute::Number(value))
                if value.is_finite() && !(name == "scale" && value.abs() < f64::MIN_POSITIVE) =>
            {
                Ok(Some(value))
            }
            None => Ok(None),
            Some(other) => {
                let found = other.describe();
                self.notes.push(format!("/{object}: attribute {name} is {found}: not used"));
                Ok(None)
            }
        }
    }
}

/// Why a data set written by MATLAB is no row of samples, and what to do; `None` if it may be one.
fn no_samples(class: &str, dataset: &Dataset, element: &Element) -> Option<String> {
    const REMEDY: &str = "save the array itself, e.g. x = c{1}; save('FILE.mat', 'x', '-v7.3')";
    if matches!(dataset.attribute("MATLAB_empty"), Ok(Some(Attribute::Number(n))) if n > 0.0) {
        return Some("an empty MATLAB array; map another".to_owned());
    }
    let is_other = matches!(element, Element::Other(_));
    match class {
        "char" => Some("a MATLAB text; expected an array of numbers".to_owned()),
        "cell" => Some(format!("a MATLAB cell array, references to its cells; {REMEDY}")),
        "struct" => Some(format!("a MATLAB structure array, references to its fields; {REMEDY}")),
        "" => None,
        other if is_other => Some(format!("a MATLAB {other} of no plain numbers; {REMEDY}")),
        _ => None,
    }
}
