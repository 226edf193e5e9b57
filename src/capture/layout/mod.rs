//! Opening: attributes and data sets of a file, checked against the layout and the limits.

mod header;
#[cfg(test)]
mod tests;

use super::channel_unit;
use super::checks::{Checks, Chunks};
use super::checksums;
use super::convert::Conversion;
use super::dataset::{self, DatasetRows};
use super::error::CaptureError;
use super::hdf5::{Attribute, Dataset, Entry, File};
use super::hints::{Hints, Overruled};
use super::info::{CaptureInfo, CaptureKind, ChannelDescription};
use super::open::Opened;
use super::received::NumberType;
use super::recording::repair;
use super::root::{self, RootAttribute};
use super::rows::{Column, Source};
use super::segments::Segments;
use crate::machine::Machine;
use crate::signal::{ChannelIndex, ChannelInfo, Timestamp};
use crate::units::Hz;
use std::collections::BTreeMap;
use std::path::Path;

/// Value of the root attribute `format`.
pub(super) const FORMAT: &str = "rotorwatch-capture";

/// Version of the layout.
pub(super) const VERSION: u32 = 1;

/// Root attribute of a file made by a recorder, whose end may have come at any moment.
const RECORDING: &str = "recording";

/// Channels of a capture at most.
pub(super) const CHANNELS_MAX: usize = 1024;

/// Segments of a capture at most.
const SEGMENTS_MAX: usize = 1_000_000;

/// Shaft speeds that make sense, Hz: up to this, as in machine files.
pub(super) const MAX_SPEED_HZ: f64 = 10_000.0;

/// Sample rates that make sense, Hz.
pub(super) const RATE_RANGE_HZ: (f64, f64) = (1e-6, 1e9);

/// Opens and checks everything but the samples; `notes`: what is to be told beside.
pub(super) fn open(
    checks: &Checks<'_>,
    file: &File,
    machine: Option<&Machine>,
    hints: &Hints,
    notes: Vec<String>,
) -> Result<Opened, CaptureError> {
    let path = checks.path;
    let attributes = root::attributes(path)?;
    let is_recording = attributes.contains_key(RECORDING);
    let layout = Layout { checks, file, machine, hints, is_recording };
    if !attributes.contains_key("format") || !is_ours(checks, file, &attributes)? {
        layout.entries()?; // A foreign file is told so, not what its attributes should be.
    }
    let header = layout.header(&attributes)?;
    let Channels { described, sources, ignored, passed_over } = layout.channels()?;
    let (segments, listed, note) = layout.segments(&sources)?;
    let left_open = repair::is_flagged(path).then(|| repair::LEFT_OPEN.to_owned());
    let absent_channels = absent_channels(machine, &described);
    let hints = layout.hints_not_used(&described);
    let of_segments = note.into_iter().chain(segments.overlap());
    let of_channels = hints.into_iter().chain(passed_over);
    let notes = left_open.into_iter().chain(of_segments).chain(of_channels).chain(notes);
    let mut info = CaptureInfo {
        file: path.into(),
        file_bytes: checks.file_bytes,
        format_stated: header.format_stated,
        is_mapped: false,
        start_time: header.start_time,
        machine: header.machine,
        shaft_speed: header.shaft_speed,
        load: header.load,
        segments: listed.then(|| segments.len()),
        duration_s: duration_s(&described, &segments),
        channels: described,
        other_attributes: header.others,
        ignored,
        absent_channels,
        kind: CaptureKind::Hdf5,
        notes: notes.collect(),
        options: None,
    };
    let stated = header.checksum;
    let (checks, file) = (&layout.checks, &layout.file);
    let sources = checksums::attach(checks, file, stated, &mut info, &segments, sources)?;
    Ok(Opened { info, sources, segments })
}

/// The attribute of a data set that makes it a channel.
const RATE: &str = "sample_rate_hz";

/// Whether a number can be a sampling rate, Hz.
fn is_rate(hz: f64) -> bool {
    (RATE_RANGE_HZ.0..=RATE_RANGE_HZ.1).contains(&hz)
}

/// Whether the file states our format, or a data set under `/channels` states `sample_rate_hz`.
pub(super) fn is_ours(
    checks: &Checks<'_>,
    file: &File,
    attributes: &Attributes,
) -> Result<bool, CaptureError> {
    if attributes.get("format") == Some(&RootAttribute::Text)
        && file.root_text("format").is_ok_and(|format| format == FORMAT)
    {
        return Ok(true);
    }
    let entries = file.entries("channels").map_err(|e| checks.library("/channels", e))?;
    let is_channel = |(name, entry): &(String, Entry)| {
        let dataset = (*entry == Entry::Dataset).then(|| file.dataset(&path_of(name)));
        let rate = dataset.and_then(Result::ok).map(|dataset| dataset.attribute(RATE));
        matches!(rate, Some(Ok(Some(_))))
    };
    Ok(entries.is_some_and(|entries| entries.iter().any(is_channel)))
}

/// Channels that sensors of the machine name and the file lacks.
pub(super) fn absent_channels(
    machine: Option<&Machine>,
    described: &[ChannelDescription],
) -> Vec<String> {
    let known = |name: &str| described.iter().any(|channel| channel.info.name == name);
    let named = machine.into_iter().flat_map(|machine| &machine.sensors);
    named.map(|sensor| &sensor.channel).filter(|name| !known(name)).cloned().collect()
}

/// Whether a file bears the mark of a recorder; false if it cannot be told.
pub(super) fn is_recording(path: &Path) -> bool {
    root::attributes(path).is_ok_and(|attributes| attributes.contains_key(RECORDING))
}

/// Reads an RFC 3339 time.
pub(super) fn start_time_of(text: &str) -> Option<Timestamp> {
    let text = text.trim();
    let instant: jiff::Timestamp = text.parse().ok()?;
    i64::try_from(instant.as_nanosecond()).ok().map(Timestamp)
}

/// From the first sample to the end of the last segment of the longest channel, s.
pub(super) fn duration_s(channels: &[ChannelDescription], segments: &Segments) -> f64 {
    let last = u32::try_from(segments.len().saturating_sub(1)).unwrap_or(u32::MAX);
    let end_s = |channel: &ChannelDescription| {
        let rate = channel.info.sample_rate;
        let start = segments.span(last, rate).map_or(0, |span| span.start);
        segments.last_time_s() + channel.n_samples.saturating_sub(start) as f64 / rate.0
    };
    let start_s = segments.first_time_s();
    channels.iter().map(|channel| end_s(channel) - start_s).fold(0.0, f64::max)
}

/// The file under examination, and what its channels add up to.
struct Layout<'a> {
    checks: &'a Checks<'a>,
    file: &'a File,
    machine: Option<&'a Machine>,
    hints: &'a Hints,
    /// Whether a recorder made it: then every data set is a channel.
    is_recording: bool,
}

/// What is under `/channels`.
#[derive(Default)]
struct Channels {
    described: Vec<ChannelDescription>,
    sources: Vec<Source>,
    /// Names that are no data sets.
    ignored: Vec<String>,
    /// What is said of data sets that are no channels.
    passed_over: Vec<String>,
}

/// Root attributes by name.
pub(super) type Attributes = BTreeMap<String, RootAttribute>;

impl Layout<'_> {
    /// Names and kinds under `/channels`.
    fn entries(&self) -> Result<Vec<(String, Entry)>, CaptureError> {
        let library = |e| self.checks.library("/channels", e);
        if let Some(entries) = self.file.entries("channels").map_err(library)? {
            return Ok(entries);
        }
        let mut names = self.file.root_names().map_err(library)?;
        names.truncate(20);
        let found = if names.is_empty() { "nothing".into() } else { names.join(", ") };
        Err(CaptureError::ForeignLayout { file: self.checks.path.into(), found })
    }

    fn channels(&self) -> Result<Channels, CaptureError> {
        let entries = self.entries()?;
        if entries.len() > CHANNELS_MAX {
            let what = "/channels: number of channels".into();
            let remedy = "split the capture";
            return Err(self.checks.limit(what, entries.len() as u64, CHANNELS_MAX as u64, remedy));
        }
        let (mut found, mut first_wrong) = (Channels::default(), None);
        let mut chunks = Chunks::default();
        for (name, entry) in entries {
            let wrong = |found: &str, expected| {
                Err(self.checks.dataset_error(&path_of(&name), found, expected))
            };
            let channel = match entry {
                Entry::Dataset => {
                    self.channel(&name, ChannelIndex(found.sources.len()), &mut chunks)
                }
                Entry::Other => {
                    found.ignored.push(name);
                    continue;
                }
                Entry::Outside => wrong("a link out of this file", "data in this file"),
                Entry::Unreadable(why) => wrong(&why, "a data set this program can read"),
            };
            match channel {
                Ok((channel, source)) => {
                    found.described.push(channel);
                    found.sources.push(source);
                }
                Err(error) if self.is_foreign(&name, &error) => {
                    found.passed_over.push(self.passed_over(&error));
                    first_wrong.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        let empty = |found| CaptureError::Empty { file: self.checks.path.into(), found };
        match found.described.iter().map(|channel| channel.n_samples).max() {
            None => Err(first_wrong.unwrap_or_else(|| empty("no data set under /channels"))),
            Some(0) => Err(empty("every channel has 0 samples")),
            Some(_) => Ok(found),
        }
    }

    /// Whether what is wrong with a data set is of no concern: no sensor of the machine names it; without a machine, it
    /// is a text or table that does not say of itself to be a channel.
    fn is_foreign(&self, name: &str, error: &CaptureError) -> bool {
        // A limit is one of the whole capture.
        if self.is_recording || matches!(error, CaptureError::Limit { .. }) {
            return false;
        }
        let Some(machine) = self.machine else {
            let Ok(dataset) = self.file.dataset(&path_of(name)) else { return false };
            let is_other =
                dataset.shape().len() != 1 || matches!(dataset.number_type(), Ok(Err(_)));
            return is_other && matches!(dataset.attribute(RATE), Ok(None));
        };
        !machine.sensors.iter().any(|sensor| sensor.channel == name)
    }

    /// What is said of a data set that is not read.
    fn passed_over(&self, error: &CaptureError) -> String {
        let text = error.to_string();
        let file = format!("{}: ", self.checks.path.display());
        format!("{}: not a channel, ignored", text.strip_prefix(&file).unwrap_or(&text))
    }

    fn channel(
        &self,
        name: &str,
        channel: ChannelIndex,
        chunks: &mut Chunks,
    ) -> Result<(ChannelDescription, Source), CaptureError> {
        let path = path_of(name);
        let dataset = self.file.dataset(&path).map_err(|e| self.checks.library(&path, e))?;
        let n_samples = self.checks.length(&dataset, &path)?;
        let kind = match dataset.number_type().map_err(|e| self.checks.library(&path, e))? {
            Ok(kind) => kind,
            Err(found) => {
                let expected = "float32, float64, int16 or int32 (signed, either byte order)";
                return Err(self.checks.dataset_error(&path, &found, expected));
            }
        };
        let (chunk, storage) =
            self.checks.storage(&dataset, &path, n_samples, kind.bytes(), chunks)?;
        let rate = self.sample_rate(&dataset, &path)?;
        let unit_text = self.checks.text(&dataset, &path, "unit")?.or(self.hints.unit.clone());
        let sensor_of = |machine: &'_ Machine| {
            machine.sensors.iter().find(|sensor| sensor.channel == name).cloned()
        };
        let unit =
            channel_unit::resolve(self.machine.and_then(sensor_of).as_ref(), unit_text.as_deref());
        let (scale, offset) = self.calibration(&dataset, &path)?;
        let factor = unit.unit.factor;
        let conversion =
            self.conversion(&dataset, &path, n_samples, kind, (scale, offset, factor))?;
        let description = ChannelDescription {
            info: ChannelInfo {
                name: name.into(),
                sample_rate: rate,
                unit: unit.unit.canonical,
                offset: conversion.offset,
                unit_conflict: unit.conflict,
                full_scale: conversion.full_scale(kind.ends()),
            },
            n_samples,
            duration_s: n_samples as f64 / rate.0,
            number_type: kind,
            scale,
            offset,
            raw_zero: conversion.raw_zero,
            storage,
            unit_text,
            sensor: self.checks.text(&dataset, &path, "sensor")?,
        };
        let file = self.checks.path.to_owned();
        let source = Source {
            file: file.clone(),
            object: path.clone(),
            rows: Box::new(DatasetRows { file, object: path, dataset, kind }),
            columns: vec![Column { channel, conversion }],
            length: n_samples,
            rate,
            chunk,
            width: 1,
        };
        Ok((description, source))
    }

    fn sample_rate(&self, dataset: &Dataset, path: &str) -> Result<Hz, CaptureError> {
        let (low, high) = RATE_RANGE_HZ;
        let expected = format!(
            "samples a second, a number from {low} to {high}; --rate HZ or a --map gives what the file lacks \
             (`rotorwatch check` prints one)"
        );
        let found = dataset.attribute(RATE).map_err(|e| self.checks.library(path, e))?;
        match (found, self.hints.rate) {
            (Some(Attribute::Number(rate)), _) if is_rate(rate) => Ok(Hz(rate)),
            (_, Some(rate)) => Ok(rate),
            (found, None) => {
                let found = found.map_or("none".into(), |found| found.describe());
                Err(self.checks.attribute_error(path, RATE, found, expected))
            }
        }
    }

    /// What is said of rates in the file that are none, where the caller's stands for them, and of hints that the
    /// file contradicts.
    fn hints_not_used(&self, channels: &[ChannelDescription]) -> Vec<String> {
        let (mut told, mut overruled) = (Vec::new(), Overruled::default());
        for channel in channels {
            let path = path_of(&channel.info.name);
            // Without the file's word it is that of the hint.
            if let Some(unit) = &channel.unit_text {
                overruled.unit(self.hints, &path, unit);
            }
            let Some(rate) = self.hints.rate else { continue };
            let found = self.file.dataset(&path).and_then(|dataset| dataset.attribute(RATE));
            match found.ok().flatten() {
                Some(Attribute::Number(rate)) if is_rate(rate) => {
                    overruled.rate(self.hints, &path, Hz(rate));
                }
                Some(found) => {
                    let (found, rate) = (found.describe(), rate.0);
                    told.push(format!(
                        "{path}: attribute {RATE} is {found}: not used, {rate} Hz of --rate are"
                    ));
                }
                None => {}
            }
        }
        told.extend(overruled.notes(channels.len()));
        told
    }

    /// Attributes `scale` and `offset`.
    fn calibration(&self, dataset: &Dataset, path: &str) -> Result<(f64, f64), CaptureError> {
        let scale = self.checks.number(dataset, path, "scale", "a number other than 0")?;
        let offset = self.checks.number(dataset, path, "offset", "a number")?;
        Ok((scale.unwrap_or(1.0), offset.unwrap_or(0.0)))
    }

    fn conversion(
        &self,
        dataset: &Dataset,
        path: &str,
        length: u64,
        kind: NumberType,
        (scale, offset, factor): (f64, f64, f64),
    ) -> Result<Conversion, CaptureError> {
        let first = match kind {
            NumberType::F32 | NumberType::I16 => None,
            NumberType::F64 | NumberType::I32 => {
                let first = dataset::read(dataset, kind, 0, length.min(1024));
                Some(first.map_err(|e| self.checks.library(path, e))?)
            }
        };
        Conversion::new(kind, scale, offset, factor, first.as_ref()).ok_or_else(|| {
            let found = format!("scale {scale} and offset {offset}");
            let expected = "finite numbers, scale not 0, the result within float32".into();
            self.checks.attribute_error(path, "scale", found, expected)
        })
    }

    /// Reads `/segments`; the flag tells whether there is one, the text what is odd about it.
    fn segments(
        &self,
        sources: &[Source],
    ) -> Result<(Segments, bool, Option<String>), CaptureError> {
        let rate = sources.iter().map(|source| source.rate).fold(Hz(0.0), fastest);
        let longest = sources.iter().filter(|s| s.rate == rate).map(|s| s.length).max();
        let library = |e| self.checks.library("/segments", e);
        let Some(entries) = self.file.entries("segments").map_err(library)? else {
            return Ok((Segments::one(rate), false, None));
        };
        let present = |name: &str| entries.contains(&(name.to_owned(), Entry::Dataset));
        for name in ["start_sample", "time_s"] {
            if !present(name) {
                let expected = "a data set; /segments needs start_sample and time_s";
                return Err(self.checks.dataset_error(
                    &format!("/segments/{name}"),
                    "none",
                    expected,
                ));
            }
        }
        let (starts, count) = self.segment_list("segments/start_sample", 1)?;
        let starts = starts.integers(count).map_err(library)?;
        let (times, count) = self.segment_list("segments/time_s", 4)?;
        let times_s = times.floats(count).map_err(library)?;
        let longest = longest.unwrap_or(0);
        let segments = if self.is_recording {
            Segments::of_recording(&starts, times_s, rate, longest)
        } else {
            Segments::new(&starts, times_s, rate, longest).map(|segments| (segments, None))
        };
        let problem = |problem| CaptureError::Content {
            file: self.checks.path.into(),
            object: "/segments".into(),
            problem,
        };
        segments.map(|(segments, note)| (segments, true, note)).map_err(problem)
    }

    fn segment_list(&self, path: &str, bytes: usize) -> Result<(Dataset, usize), CaptureError> {
        let dataset = self.file.dataset(path).map_err(|e| self.checks.library(path, e))?;
        let count = self.checks.length(&dataset, path)?;
        if count > SEGMENTS_MAX as u64 {
            let what = format!("/{path}: number of segments");
            return Err(self.checks.limit(what, count, SEGMENTS_MAX as u64, "split the capture"));
        }
        self.checks.storage(&dataset, path, count, bytes, &mut Chunks::default())?;
        Ok((dataset, usize::try_from(count).unwrap_or(SEGMENTS_MAX)))
    }
}

fn path_of(channel: &str) -> String {
    format!("channels/{channel}")
}

fn fastest(a: Hz, b: Hz) -> Hz {
    if b > a { b } else { a }
}
