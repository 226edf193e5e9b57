//! Opening: attributes and data sets of a file, checked against the layout and the limits.

use super::channel_unit;
use super::convert::Conversion;
use super::error::CaptureError;
use super::hdf5::{self, Attribute, Dataset, Entry, File, NumberType, Storage};
use super::info::{CaptureInfo, ChannelDescription};
use super::root::{self, RootAttribute};
use super::segments::Segments;
use super::stream::{self, Source};
use crate::machine::Machine;
use crate::signal::{ChannelIndex, ChannelInfo, Timestamp};
use crate::units::Hz;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Value of the root attribute `format`.
pub(super) const FORMAT: &str = "rotorwatch-capture";

/// Version of the layout.
pub(super) const VERSION: u32 = 1;

/// Channels of a capture at most.
const CHANNELS_MAX: usize = 1024;

/// Bytes of an attribute's text at most.
const TEXT_BYTES_MAX: usize = 1 << 20;

/// Segments of a capture at most.
const SEGMENTS_MAX: usize = 1_000_000;

/// Uncompressed bytes of one chunk of every channel together at most: they are held at once.
const CHUNK_BYTES_MAX: u64 = 64 << 20;

/// Chunks of a capture at most; each costs about 100 bytes of index in memory.
const CHUNKS_MAX: u64 = 1_000_000;

/// Uncompressed size over file size at most (deflate reaches 1032), beyond `SMALL_BYTES`.
const EXPANSION_MAX: u64 = 2000;

/// Uncompressed size that is always allowed, bytes.
const SMALL_BYTES: u64 = 64 << 20;

/// Sample rates that make sense, Hz.
const RATE_RANGE_HZ: (f64, f64) = (1e-6, 1e9);

/// An opened capture.
pub(super) struct Opened {
    pub(super) info: CaptureInfo,
    pub(super) sources: Vec<Source>,
    pub(super) segments: Segments,
}

/// Opens and checks everything but the samples.
pub(super) fn open(path: &Path, machine: Option<&Machine>) -> Result<Opened, CaptureError> {
    let file_bytes = std::fs::metadata(path)
        .map_err(|source| CaptureError::Io { file: path.into(), action: "open it", source })?
        .len();
    let attributes = root::attributes(path)?;
    let file = File::open(path).map_err(|source| CaptureError::Library {
        file: path.into(),
        object: "the file".into(),
        source,
    })?;
    let layout = Layout { path, file_bytes, file, machine };
    let header = layout.header(&attributes)?;
    let (described, sources, ignored) = layout.channels()?;
    let (segments, listed) = layout.segments(&sources)?;
    let absent_channels = machine.map_or_else(Vec::new, |machine| {
        let known = |name: &str| described.iter().any(|channel| channel.info.name == name);
        machine.sensors.iter().map(|s| &s.channel).filter(|name| !known(name)).cloned().collect()
    });
    let info = CaptureInfo {
        file: path.into(),
        file_bytes,
        format_stated: header.format_stated,
        start_time: header.start_time,
        machine: header.machine,
        shaft_speed: header.shaft_speed,
        segments: listed.then(|| segments.len()),
        duration_s: duration_s(&described, &segments),
        channels: described,
        other_attributes: header.others,
        ignored,
        absent_channels,
    };
    Ok(Opened { info, sources, segments })
}

/// End of the last segment of the longest channel, s.
fn duration_s(channels: &[ChannelDescription], segments: &Segments) -> f64 {
    let last = u32::try_from(segments.len().saturating_sub(1)).unwrap_or(u32::MAX);
    let end_s = |channel: &ChannelDescription| {
        let rate = channel.info.sample_rate;
        let start = segments.span(last, rate).map_or(0, |span| span.start);
        segments.last_time_s() + channel.n_samples.saturating_sub(start) as f64 / rate.0
    };
    channels.iter().map(end_s).fold(0.0, f64::max)
}

/// What the root attributes say.
struct Header {
    format_stated: bool,
    start_time: Option<Timestamp>,
    machine: Option<String>,
    shaft_speed: Option<Hz>,
    others: Vec<String>,
}

/// The file under examination, and what its channels add up to.
struct Layout<'a> {
    path: &'a Path,
    file_bytes: u64,
    file: File,
    machine: Option<&'a Machine>,
}

/// What the chunks seen so far add up to.
#[derive(Debug, Default)]
struct Chunks {
    count: u64,
    bytes: u64,
}

type Attributes = BTreeMap<String, RootAttribute>;

impl Layout<'_> {
    fn header(&self, attributes: &Attributes) -> Result<Header, CaptureError> {
        const KNOWN: [&str; 5] = ["format", "version", "start_time", "machine", "shaft_speed_hz"];
        let format = self.root_text(attributes, "format")?;
        if let Some(text) = format.as_deref().filter(|text| *text != FORMAT) {
            let expected = format!("\"{FORMAT}\", or no such attribute");
            return Err(self.attribute_error("/", "format", format!("\"{text}\""), expected));
        }
        if let Some(version) = self.root_number(attributes, "version")? {
            #[expect(clippy::float_cmp, reason = "integers are exact")]
            let known = version == f64::from(VERSION);
            if !known {
                let expected = format!("{VERSION}; a newer version of this program may read it");
                return Err(self.attribute_error("/", "version", version.to_string(), expected));
            }
        }
        let shaft_speed = self.root_number(attributes, "shaft_speed_hz")?;
        if let Some(speed) = shaft_speed.filter(|speed| !(0.0..=RATE_RANGE_HZ.1).contains(speed)) {
            let expected = "a frequency in Hz, 0 for standstill".into();
            return Err(self.attribute_error("/", "shaft_speed_hz", speed.to_string(), expected));
        }
        let others = attributes.keys().filter(|name| !KNOWN.contains(&name.as_str()));
        Ok(Header {
            format_stated: format.is_some(),
            start_time: self.start_time(attributes)?,
            machine: self.root_text(attributes, "machine")?,
            shaft_speed: shaft_speed.map(Hz),
            others: others.cloned().collect(),
        })
    }

    fn start_time(&self, attributes: &Attributes) -> Result<Option<Timestamp>, CaptureError> {
        let Some(text) = self.root_text(attributes, "start_time")? else { return Ok(None) };
        let instant: Option<jiff::Timestamp> = text.trim().parse().ok();
        match instant.and_then(|instant| i64::try_from(instant.as_nanosecond()).ok()) {
            Some(nanoseconds) => Ok(Some(Timestamp(nanoseconds))),
            None => {
                let expected = "an RFC 3339 time such as 2026-03-01T12:00:00Z".into();
                let found = Attribute::Text(text).describe();
                Err(self.attribute_error("/", "start_time", found, expected))
            }
        }
    }

    fn root_number(
        &self,
        attributes: &Attributes,
        name: &str,
    ) -> Result<Option<f64>, CaptureError> {
        match attributes.get(name) {
            None => Ok(None),
            Some(RootAttribute::Value(Attribute::Number(value))) => Ok(Some(*value)),
            Some(other) => {
                Err(self.attribute_error("/", name, describe_root(other), "one number".into()))
            }
        }
    }

    fn root_text(
        &self,
        attributes: &Attributes,
        name: &str,
    ) -> Result<Option<String>, CaptureError> {
        match attributes.get(name) {
            None => Ok(None),
            Some(RootAttribute::Text) => {
                let text = self.file.root_text(name).map_err(|e| self.library("/", e))?;
                self.bounded_text("/", name, text).map(Some)
            }
            Some(other) => {
                Err(self.attribute_error("/", name, describe_root(other), "a text".into()))
            }
        }
    }

    fn bounded_text(&self, object: &str, name: &str, text: String) -> Result<String, CaptureError> {
        if text.len() <= TEXT_BYTES_MAX {
            return Ok(text);
        }
        let what = format!("{object}: bytes of attribute {name}");
        Err(self.limit(what, text.len() as u64, TEXT_BYTES_MAX as u64, "shorten the text"))
    }

    #[expect(clippy::type_complexity, reason = "three lists that are taken apart at once")]
    fn channels(
        &self,
    ) -> Result<(Vec<ChannelDescription>, Vec<Source>, Vec<String>), CaptureError> {
        let library = |e| library_error(self.path, "/channels", e);
        let Some(entries) = self.file.entries("channels").map_err(library)? else {
            let mut names = self.file.root_names().map_err(library)?;
            names.truncate(20);
            let found = if names.is_empty() { "nothing".into() } else { names.join(", ") };
            return Err(CaptureError::ForeignLayout { file: self.path.into(), found });
        };
        if entries.len() > CHANNELS_MAX {
            let what = "/channels: number of channels".into();
            let remedy = "split the capture";
            return Err(self.limit(what, entries.len() as u64, CHANNELS_MAX as u64, remedy));
        }
        let (mut described, mut sources, mut ignored) = (Vec::new(), Vec::new(), Vec::new());
        let mut chunks = Chunks::default();
        for (name, entry) in entries {
            match entry {
                Entry::Dataset => {
                    let (channel, source) =
                        self.channel(&name, ChannelIndex(sources.len()), &mut chunks)?;
                    described.push(channel);
                    sources.push(source);
                }
                Entry::Other => ignored.push(name),
                Entry::Outside => {
                    return Err(self.dataset_error(
                        &path_of(&name),
                        "a link out of this file",
                        "data in this file",
                    ));
                }
                Entry::Unreadable(reason) => {
                    let expected = "a data set this program can read";
                    return Err(self.dataset_error(&path_of(&name), &reason, expected));
                }
            }
        }
        let empty = |found| CaptureError::Empty { file: self.path.into(), found };
        match described.iter().map(|channel| channel.n_samples).max() {
            None => Err(empty("no data set under /channels")),
            Some(0) => Err(empty("every channel has 0 samples")),
            Some(_) => Ok((described, sources, ignored)),
        }
    }

    fn channel(
        &self,
        name: &str,
        channel: ChannelIndex,
        chunks: &mut Chunks,
    ) -> Result<(ChannelDescription, Source), CaptureError> {
        let path = path_of(name);
        let dataset = self.file.dataset(&path).map_err(|e| self.library(&path, e))?;
        let n_samples = self.length(&dataset, &path)?;
        let kind = match dataset.number_type().map_err(|e| self.library(&path, e))? {
            Ok(kind) => kind,
            Err(found) => {
                let expected = "float32, float64, int16 or int32 (signed, either byte order)";
                return Err(self.dataset_error(&path, &found, expected));
            }
        };
        let (chunk, storage) = self.storage(&dataset, &path, n_samples, kind.bytes(), chunks)?;
        let rate = self.sample_rate(&dataset, &path)?;
        let unit_text = self.text(&dataset, &path, "unit")?;
        let sensor_of = |machine: &'_ Machine| {
            machine.sensors.iter().find(|sensor| sensor.channel == name).cloned()
        };
        let unit =
            channel_unit::resolve(self.machine.and_then(sensor_of).as_ref(), unit_text.as_deref());
        let conversion = self.conversion(&dataset, &path, kind, n_samples, unit.unit.factor)?;
        let description = ChannelDescription {
            info: ChannelInfo {
                name: name.into(),
                sample_rate: rate,
                unit: unit.unit.canonical,
                offset: conversion.offset,
                unit_conflict: unit.conflict,
                full_scale: conversion.full_scale(kind),
            },
            n_samples,
            duration_s: n_samples as f64 / rate.0,
            number_type: kind.name(),
            storage,
            unit_text,
            sensor: self.text(&dataset, &path, "sensor")?,
        };
        let source =
            Source { channel, path, dataset, kind, length: n_samples, rate, conversion, chunk };
        Ok((description, source))
    }

    /// Number of elements of a 1-D data set.
    fn length(&self, dataset: &Dataset, path: &str) -> Result<u64, CaptureError> {
        match dataset.shape()[..] {
            [length] => Ok(length as u64),
            ref shape => {
                let expected = "one dimension: one data set per channel";
                Err(self.dataset_error(path, &format!("shape {shape:?}"), expected))
            }
        }
    }

    /// Checks what the storage declares; gives the chunk length (1 if not chunked) and a text.
    fn storage(
        &self,
        dataset: &Dataset,
        path: &str,
        length: u64,
        element_bytes: usize,
        chunks: &mut Chunks,
    ) -> Result<(u64, String), CaptureError> {
        let bytes = length.saturating_mul(element_bytes as u64);
        let holds = format!("at most what {} bytes of file can hold", self.file_bytes);
        let too_long = |this: &Self| {
            this.dataset_error(path, &format!("{length} elements declared, {bytes} bytes"), &holds)
        };
        let (chunk_dims, filters) = match dataset.storage().map_err(|e| self.library(path, e))? {
            Storage::Elsewhere(what) => {
                return Err(self.dataset_error(path, what, "data in this file"));
            }
            Storage::Plain if bytes > self.file_bytes => return Err(too_long(self)),
            Storage::Plain => return Ok((1, "contiguous".into())),
            Storage::Chunked(chunk_dims, filters) => (chunk_dims, filters),
        };
        let &[chunk @ 1..=usize::MAX] = &chunk_dims[..] else {
            return Err(self.dataset_error(
                path,
                &format!("chunks of {chunk_dims:?}"),
                "one dimension",
            ));
        };
        let chunk = chunk as u64;
        if bytes > SMALL_BYTES.max(self.file_bytes.saturating_mul(EXPANSION_MAX)) {
            return Err(too_long(self));
        }
        let chunk_bytes = chunk.saturating_mul(element_bytes as u64);
        chunks.bytes = chunks.bytes.saturating_add(chunk_bytes);
        chunks.count = chunks.count.saturating_add(length.div_ceil(chunk));
        if chunks.bytes > CHUNK_BYTES_MAX {
            let what = format!("{path}: uncompressed bytes of one chunk of each channel so far");
            let remedy = "store smaller chunks, e.g. h5repack -l CHUNK=65536";
            return Err(self.limit(what, chunks.bytes, CHUNK_BYTES_MAX, remedy));
        }
        if chunks.count > CHUNKS_MAX {
            let what = format!("{path}: number of chunks so far");
            let remedy = "store larger chunks, e.g. h5repack -l CHUNK=65536";
            return Err(self.limit(what, chunks.count, CHUNKS_MAX, remedy));
        }
        let mut text = format!("chunks of {chunk}");
        for id in filters {
            let name = hdf5::filter_name(id).map_err(|found| {
                let expected = "gzip, shuffle, fletcher32, lzf, zstd or another filter of docs/hdf5.md; h5repack converts";
                self.dataset_error(path, &found, expected)
            })?;
            text = format!("{text}, {name}");
        }
        Ok((chunk, text))
    }

    fn sample_rate(&self, dataset: &Dataset, path: &str) -> Result<Hz, CaptureError> {
        let (low, high) = RATE_RANGE_HZ;
        let expected = format!("samples a second, a number from {low} to {high}");
        match self.number(dataset, path, "sample_rate_hz", &expected)? {
            Some(rate) if (low..=high).contains(&rate) => Ok(Hz(rate)),
            found => {
                let found = found.map_or("none".into(), |rate| rate.to_string());
                Err(self.attribute_error(path, "sample_rate_hz", found, expected))
            }
        }
    }

    fn conversion(
        &self,
        dataset: &Dataset,
        path: &str,
        kind: NumberType,
        length: u64,
        factor: f64,
    ) -> Result<Conversion, CaptureError> {
        let scale = self.number(dataset, path, "scale", "a number other than 0")?.unwrap_or(1.0);
        let offset = self.number(dataset, path, "offset", "a number")?.unwrap_or(0.0);
        let first = match kind {
            NumberType::F32 | NumberType::I16 => None,
            NumberType::F64 | NumberType::I32 => {
                let first = stream::read(dataset, kind, 0, length.min(1024));
                Some(first.map_err(|e| self.library(path, e))?)
            }
        };
        Conversion::new(kind, scale, offset, factor, first.as_ref()).ok_or_else(|| {
            let found = format!("scale {scale} and offset {offset}");
            let expected = "finite numbers, scale not 0, the result within float32".into();
            self.attribute_error(path, "scale", found, expected)
        })
    }

    fn number(
        &self,
        dataset: &Dataset,
        path: &str,
        name: &str,
        expected: &str,
    ) -> Result<Option<f64>, CaptureError> {
        match dataset.attribute(name).map_err(|e| self.library(path, e))? {
            None => Ok(None),
            Some(Attribute::Number(value)) => Ok(Some(value)),
            Some(other) => Err(self.attribute_error(path, name, other.describe(), expected.into())),
        }
    }

    fn text(
        &self,
        dataset: &Dataset,
        path: &str,
        name: &str,
    ) -> Result<Option<String>, CaptureError> {
        match dataset.attribute(name).map_err(|e| self.library(path, e))? {
            None => Ok(None),
            Some(Attribute::Text(text)) => self.bounded_text(path, name, text).map(Some),
            Some(other) => Err(self.attribute_error(path, name, other.describe(), "a text".into())),
        }
    }

    /// Reads `/segments`; the flag tells whether there is one.
    fn segments(&self, sources: &[Source]) -> Result<(Segments, bool), CaptureError> {
        let rate = sources.iter().map(|source| source.rate).fold(Hz(0.0), fastest);
        let longest = sources.iter().filter(|s| s.rate == rate).map(|s| s.length).max();
        let library = |e| library_error(self.path, "/segments", e);
        let Some(entries) = self.file.entries("segments").map_err(library)? else {
            return Ok((Segments::one(rate), false));
        };
        let present = |name: &str| entries.contains(&(name.to_owned(), Entry::Dataset));
        for name in ["start_sample", "time_s"] {
            if !present(name) {
                let expected = "a data set; /segments needs start_sample and time_s";
                return Err(self.dataset_error(&format!("/segments/{name}"), "none", expected));
            }
        }
        let (starts, count) = self.segment_list("segments/start_sample", 1)?;
        let starts = starts.integers(count).map_err(library)?;
        let (times, count) = self.segment_list("segments/time_s", 4)?;
        let times_s = times.floats(count).map_err(library)?;
        let segments = Segments::new(&starts, times_s, rate, longest.unwrap_or(0));
        segments.map(|segments| (segments, true)).map_err(|problem| CaptureError::Content {
            file: self.path.into(),
            object: "/segments".into(),
            problem,
        })
    }

    fn segment_list(&self, path: &str, bytes: usize) -> Result<(Dataset, usize), CaptureError> {
        let dataset = self.file.dataset(path).map_err(|e| self.library(path, e))?;
        let count = self.length(&dataset, path)?;
        if count > SEGMENTS_MAX as u64 {
            let what = format!("/{path}: number of segments");
            return Err(self.limit(what, count, SEGMENTS_MAX as u64, "split the capture"));
        }
        self.storage(&dataset, path, count, bytes, &mut Chunks::default())?;
        Ok((dataset, usize::try_from(count).unwrap_or(SEGMENTS_MAX)))
    }

    fn attribute_error(
        &self,
        object: &str,
        name: &str,
        found: String,
        expected: String,
    ) -> CaptureError {
        CaptureError::Attribute {
            file: self.path.into(),
            object: object.into(),
            attribute: name.into(),
            found,
            expected,
        }
    }

    fn dataset_error(&self, path: &str, found: &str, expected: &str) -> CaptureError {
        CaptureError::Dataset {
            file: PathBuf::from(self.path),
            dataset: path.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    fn limit(&self, what: String, found: u64, limit: u64, remedy: &'static str) -> CaptureError {
        CaptureError::Limit { file: self.path.into(), what, found, limit, remedy }
    }

    fn library(&self, object: &str, source: super::error::LibraryError) -> CaptureError {
        library_error(self.path, object, source)
    }
}

fn library_error(path: &Path, object: &str, source: super::error::LibraryError) -> CaptureError {
    CaptureError::Library { file: path.into(), object: object.into(), source }
}

fn path_of(channel: &str) -> String {
    format!("channels/{channel}")
}

fn fastest(a: Hz, b: Hz) -> Hz {
    if b > a { b } else { a }
}

fn describe_root(attribute: &RootAttribute) -> String {
    match attribute {
        RootAttribute::Value(value) => value.describe(),
        RootAttribute::Text => "a text".into(),
        RootAttribute::Unreadable(reason) => reason.clone(),
    }
}
