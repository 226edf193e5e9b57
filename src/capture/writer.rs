//! Writes finished captures: complete and durable under their name, or not there at all.

use super::checksums;
use super::error::{CaptureError, LibraryError};
use super::hdf5::{NewFile, NewGroup, NewStorage};
use super::integrity::{self, BLOCK_SAMPLES, ChannelFacts, Statement};
use super::layout::{FORMAT, VERSION};
use super::received::NumberType;
use super::segments::Segments;
use crate::signal::{SampleIndex, Timestamp};
use crate::units::{Hz, SourceUnit};
use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};

/// What a capture states at its root.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CaptureHeader {
    /// UTC time of stream time 0.
    pub start_time: Option<Timestamp>,
    /// The machine file's text.
    pub machine: Option<String>,
    /// Nominal speed of the machine's first shaft.
    pub shaft_speed: Option<Hz>,
}

/// How a channel's samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ChannelStorage {
    /// One run of bytes.
    #[default]
    Contiguous,
    /// Shuffled and gzipped chunks.
    Compressed {
        /// Samples of a chunk.
        chunk_samples: usize,
        /// gzip level, 1 to 9.
        level: u32,
    },
}

/// What a channel states about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelHeader {
    /// Name: not empty, without `/`.
    pub name: String,
    /// Samples a second.
    pub sample_rate: Hz,
    /// Unit of physical values, one of [`SourceUnit::ACCEPTED`].
    pub unit: Option<String>,
    /// What measures it, for people.
    pub sensor: Option<String>,
    /// How it is stored.
    pub storage: ChannelStorage,
}

/// Samples of a channel; for integers physical = raw·scale + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChannelSamples<'a> {
    /// Physical values.
    F32(&'a [f32]),
    /// Physical values.
    F64(&'a [f64]),
    /// Counts.
    I16 {
        /// As the converter gave them.
        counts: &'a [i16],
        /// Physical units a count.
        scale: f64,
        /// Physical value of count 0.
        offset: f64,
    },
    /// Counts.
    I32 {
        /// As the converter gave them.
        counts: &'a [i32],
        /// Physical units a count.
        scale: f64,
        /// Physical value of count 0.
        offset: f64,
    },
}

impl ChannelSamples<'_> {
    fn len(self) -> usize {
        match self {
            Self::F32(samples) => samples.len(),
            Self::F64(samples) => samples.len(),
            Self::I16 { counts, .. } => counts.len(),
            Self::I32 { counts, .. } => counts.len(),
        }
    }

    fn number_type(self) -> NumberType {
        match self {
            Self::F32(_) => NumberType::F32,
            Self::F64(_) => NumberType::F64,
            Self::I16 { .. } => NumberType::I16,
            Self::I32 { .. } => NumberType::I32,
        }
    }

    /// (scale, offset) of counts.
    fn calibration(self) -> Option<(f64, f64)> {
        match self {
            Self::F32(_) | Self::F64(_) => None,
            Self::I16 { scale, offset, .. } | Self::I32 { scale, offset, .. } => {
                Some((scale, offset))
            }
        }
    }

    /// Checksums of the raw samples.
    fn sums(self) -> Vec<u32> {
        match self {
            Self::F32(samples) => integrity::sums(samples, BLOCK_SAMPLES),
            Self::F64(samples) => integrity::sums(samples, BLOCK_SAMPLES),
            Self::I16 { counts, .. } => integrity::sums(counts, BLOCK_SAMPLES),
            Self::I32 { counts, .. } => integrity::sums(counts, BLOCK_SAMPLES),
        }
    }
}

/// A capture being written under a temporary name beside its own.
///
/// Without [`CaptureWriter::finish`] nothing remains.
pub struct CaptureWriter {
    path: PathBuf,
    temporary: PathBuf,
    file: Option<NewFile>,
    groups: Option<Groups>,
    header: CaptureHeader,
    /// By name.
    written: BTreeMap<String, Written>,
    segments: Option<Segments>,
    fastest: Hz,
    longest: u64,
    big_endian: bool,
}

/// What was written about a channel.
struct Written {
    header: ChannelHeader,
    number_type: NumberType,
    scale: f64,
    offset: f64,
}

/// The groups that are filled channel by channel.
struct Groups {
    channels: NewGroup,
    checksums: NewGroup,
}

impl std::fmt::Debug for CaptureWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CaptureWriter").field("path", &self.path).finish_non_exhaustive()
    }
}

impl CaptureWriter {
    /// Starts a capture that will replace `path`.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] if the folder cannot be written, [`CaptureError::Content`] for a
    /// start time outside RFC 3339.
    pub fn create(path: &Path, header: &CaptureHeader) -> Result<Self, CaptureError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let mut writer = Self {
            path: path.into(),
            temporary,
            file: None,
            groups: None,
            header: header.clone(),
            written: BTreeMap::new(),
            segments: None,
            fastest: Hz(0.0),
            longest: 0,
            big_endian: false,
        };
        let failed = |source| writer.write_error("the file", source);
        let file = NewFile::create(&writer.temporary).map_err(failed)?;
        write_header(&file, header).map_err(failed)?;
        if let Some(time) = header.start_time {
            let text = jiff::Timestamp::from_nanosecond(i128::from(time.0))
                .map_err(|error| writer.content("start_time", error.to_string()))?;
            file.text("start_time", &text.to_string()).map_err(failed)?;
        }
        let channels = file.group("channels").map_err(failed)?;
        let checksums = file.group(checksums::GROUP).map_err(failed)?;
        writer.groups = Some(Groups { channels, checksums });
        writer.file = Some(file);
        Ok(writer)
    }

    /// Adds a channel with all its samples.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] for a name, rate, unit or scale that no reader would accept,
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn channel(
        &mut self,
        header: &ChannelHeader,
        samples: ChannelSamples<'_>,
    ) -> Result<(), CaptureError> {
        let object = format!("channels/{}", header.name);
        check(header, samples).map_err(|problem| self.content(&object, problem))?;
        let Some(groups) = &self.groups else {
            return Err(self.content(&object, "the capture is finished".into()));
        };
        let compressed = match header.storage {
            ChannelStorage::Contiguous => None,
            ChannelStorage::Compressed { chunk_samples, level } => Some((chunk_samples, level)),
        };
        let storage = NewStorage { compressed, big_endian: self.big_endian };
        write_channel(&groups.channels, header, samples, storage)
            .and_then(|()| write_sums(&groups.checksums, &header.name, samples))
            .map_err(|source| self.write_error(&object, source))?;
        let (scale, offset) = samples.calibration().unwrap_or((1.0, 0.0));
        let number_type = samples.number_type();
        let written = Written { header: header.clone(), number_type, scale, offset };
        self.written.insert(header.name.clone(), written);
        let length = samples.len() as u64;
        if header.sample_rate > self.fastest {
            (self.fastest, self.longest) = (header.sample_rate, length);
        } else if header.sample_rate >= self.fastest {
            self.longest = self.longest.max(length);
        }
        Ok(())
    }

    /// States where the channels are contiguous: after all channels, at most once.
    ///
    /// `starts`: first samples, counted in the fastest channel; `times_s`: their stream times.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] if the lists are no segments of these channels,
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn segments(
        &mut self,
        starts: &[SampleIndex],
        times_s: &[f64],
    ) -> Result<(), CaptureError> {
        let problem = |text| self.content("segments", text);
        let starts: Vec<i64> =
            starts.iter().map(|start| i64::try_from(start.0).unwrap_or(i64::MAX)).collect();
        let segments = Segments::new(&starts, times_s.to_vec(), self.fastest, self.longest)
            .map_err(problem)?;
        let Some(file) = &self.file else {
            return Err(problem("the capture is finished".into()));
        };
        let storage = NewStorage { compressed: None, big_endian: self.big_endian };
        let write = || {
            let group = file.group("segments")?;
            group.dataset("start_sample", &starts, storage)?;
            group.dataset("time_s", times_s, storage).map(|_| ())
        };
        write().map_err(|source| self.write_error("segments", source))?;
        self.segments = Some(segments);
        Ok(())
    }

    /// Completes the file, waits until it is on the disk and gives it its name.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] or [`CaptureError::Io`]; an older file of that name is then untouched.
    pub fn finish(mut self) -> Result<(), CaptureError> {
        self.groups = None;
        if let Some(file) = self.file.take() {
            file.number(checksums::STATEMENT, self.statement())
                .and_then(|()| file.close())
                .map_err(|source| self.write_error("the file", source))?;
        }
        let io = |action| {
            let file = self.path.clone();
            move |source| CaptureError::Io { file, action, source }
        };
        let sync = |path: &Path| OpenOptions::new().read(true).open(path)?.sync_all();
        sync(&self.temporary).map_err(io("flush it to the disk"))?;
        fs::rename(&self.temporary, &self.path).map_err(io("give it its name"))?;
        let folder = match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        sync(folder).map_err(io("flush its folder to the disk"))
    }

    /// The checksum of what the file states about itself.
    fn statement(&self) -> u32 {
        let CaptureHeader { start_time, machine, shaft_speed } = &self.header;
        let mut statement =
            Statement::new(Some(FORMAT), *start_time, machine.as_deref(), *shaft_speed);
        for Written { header, number_type, scale, offset } in self.written.values() {
            statement.channel(&ChannelFacts {
                name: &header.name,
                number_type: *number_type,
                sample_rate: header.sample_rate,
                unit: header.unit.as_deref(),
                sensor: header.sensor.as_deref(),
                scale: *scale,
                offset: *offset,
            });
        }
        statement.segments(self.segments.as_ref());
        statement.sum()
    }

    /// Stores the samples most significant byte first, as foreign recorders do.
    #[cfg(test)]
    pub(super) fn store_big_endian(&mut self) {
        self.big_endian = true;
    }

    fn content(&self, object: &str, problem: String) -> CaptureError {
        CaptureError::Content { file: self.path.clone(), object: object.into(), problem }
    }

    fn write_error(&self, object: &str, source: LibraryError) -> CaptureError {
        CaptureError::Write { file: self.path.clone(), object: object.into(), source }
    }
}

impl Drop for CaptureWriter {
    /// Removes the temporary file; after [`CaptureWriter::finish`] there is none.
    fn drop(&mut self) {
        self.groups = None;
        if let Some(file) = self.file.take() {
            // Closing an abandoned file may fail; it is removed in either case.
            let _ = file.close();
        }
        let _ = fs::remove_file(&self.temporary);
    }
}

fn write_header(file: &NewFile, header: &CaptureHeader) -> Result<(), LibraryError> {
    file.text("format", FORMAT)?;
    file.number("version", i64::from(VERSION))?;
    if let Some(text) = &header.machine {
        file.text("machine", text)?;
    }
    header.shaft_speed.map_or(Ok(()), |speed| file.number("shaft_speed_hz", speed.0))
}

fn check(header: &ChannelHeader, samples: ChannelSamples<'_>) -> Result<(), String> {
    if header.name.is_empty() || header.name.contains('/') || header.name == "." {
        return Err("a channel's name must be a text without /".into());
    }
    let rate = header.sample_rate.0;
    if !(rate.is_finite() && rate > 0.0) {
        return Err(format!("sample rate {rate} Hz; it must be a finite number above 0"));
    }
    if let Some(unit) = header.unit.as_deref().filter(|unit| SourceUnit::parse(unit).is_none()) {
        return Err(format!("unit \"{unit}\" is none of {}", SourceUnit::ACCEPTED.join(", ")));
    }
    if samples.len() == 0 {
        return Err("no samples".into());
    }
    let (scale, offset) = samples.calibration().unwrap_or((1.0, 0.0));
    let usable = scale.is_finite() && scale.abs() > 0.0 && offset.is_finite();
    let problem = || format!("scale {scale}, offset {offset}; finite numbers, scale not 0");
    if usable { Ok(()) } else { Err(problem()) }
}

fn write_channel(
    group: &NewGroup,
    header: &ChannelHeader,
    samples: ChannelSamples<'_>,
    storage: NewStorage,
) -> Result<(), LibraryError> {
    let name = &header.name;
    let dataset = match samples {
        ChannelSamples::F32(samples) => group.dataset(name, samples, storage)?,
        ChannelSamples::F64(samples) => group.dataset(name, samples, storage)?,
        ChannelSamples::I16 { counts, .. } => group.dataset(name, counts, storage)?,
        ChannelSamples::I32 { counts, .. } => group.dataset(name, counts, storage)?,
    };
    dataset.number("sample_rate_hz", header.sample_rate.0)?;
    if let Some(unit) = &header.unit {
        dataset.text("unit", unit)?;
    }
    if let Some(sensor) = &header.sensor {
        dataset.text("sensor", sensor)?;
    }
    if let Some((scale, offset)) = samples.calibration() {
        dataset.number("scale", scale)?;
        dataset.number("offset", offset)?;
    }
    Ok(())
}

/// The table of a finished channel's checksums.
fn write_sums(
    group: &NewGroup,
    name: &str,
    samples: ChannelSamples<'_>,
) -> Result<(), LibraryError> {
    let table = group.dataset(name, &samples.sums(), NewStorage::default())?;
    table.number(checksums::BLOCK, BLOCK_SAMPLES)?;
    table.number(checksums::SAMPLES, samples.len() as u64)
}
