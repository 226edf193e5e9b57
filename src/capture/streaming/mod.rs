//! Writes captures of any length in constant memory: channels grow block by block.
//!
//! As [`super::writer`] does, a file is complete and durable under its name, or not there at all.

use super::checksums;
use super::error::{CaptureError, LibraryError};
use super::hdf5::{GrowingDataset, NewFile, NewGroup, NewStorage};
use super::integrity::{BLOCK_SAMPLES, BlockSums, ChannelFacts, Statement};
use super::layout::{FORMAT, VERSION};
use super::received::NumberType;
use super::writer::CaptureHeader;
use crate::units::{Hz, SourceUnit};
use std::convert::Infallible;
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};

/// Samples of a chunk: 32 to 128 kB, and at most this much of a channel is held back.
pub const CHUNK_SAMPLES: usize = 16_384;

/// Longest text of the truth, bytes: an attribute holds 64 kB with its name.
pub const MAX_TRUTH_BYTES: usize = 65_000;

/// Number type of a growing channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GrowingType {
    /// Counts of 16 bits; physical = raw·scale + offset.
    I16 {
        /// Physical units a count.
        scale: f64,
        /// Physical value of count 0.
        offset: f64,
    },
    /// Physical values, single precision.
    F32,
    /// Physical values, double precision.
    F64,
}

/// What a growing channel states about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct GrowingChannel {
    /// Name: not empty, without `/`.
    pub name: String,
    /// Samples a second.
    pub sample_rate: Hz,
    /// Unit of physical values, one of [`SourceUnit::ACCEPTED`].
    pub unit: Option<String>,
    /// What measures it, for people.
    pub sensor: Option<String>,
    /// Number type.
    pub number: GrowingType,
}

/// Samples to be added to a channel of the same number type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GrowingSamples<'a> {
    /// Counts.
    I16(&'a [i16]),
    /// Physical values.
    F32(&'a [f32]),
    /// Physical values.
    F64(&'a [f64]),
}

/// What a simulation knows and no diagnosis may read: the group `/truth`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Truth {
    /// Text attributes by name.
    pub texts: Vec<(String, String)>,
    /// Seed of the noise.
    pub seed: u64,
}

/// A channel with the samples that do not fill a chunk yet.
#[derive(Debug)]
struct Column {
    header: GrowingChannel,
    dataset: GrowingDataset,
    held: Held,
    n_samples: u64,
    /// Of whole blocks so far, four bytes each.
    sums: Vec<u32>,
    summed: BlockSums,
}

#[derive(Debug)]
enum Held {
    I16(Vec<i16>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// A capture being written under a temporary name beside its own; its channels grow.
///
/// Without [`StreamingWriter::finish`] nothing remains.
pub struct StreamingWriter {
    path: PathBuf,
    temporary: PathBuf,
    header: CaptureHeader,
    columns: Vec<Column>,
    channels: Option<NewGroup>,
    truth: Option<NewGroup>,
    file: Option<NewFile>,
}

impl std::fmt::Debug for StreamingWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StreamingWriter").field("path", &self.path).finish_non_exhaustive()
    }
}

impl StreamingWriter {
    /// Starts a capture that will replace `path`.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] if the folder cannot be written, [`CaptureError::Content`] for a
    /// start time outside RFC 3339 or a truth that is too long.
    pub fn create(
        path: &Path,
        header: &CaptureHeader,
        truth: &Truth,
    ) -> Result<Self, CaptureError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let mut writer = Self {
            path: path.into(),
            temporary,
            header: header.clone(),
            columns: Vec::new(),
            channels: None,
            truth: None,
            file: None,
        };
        let start_time = header.start_time.map(|time| {
            jiff::Timestamp::from_nanosecond(i128::from(time.0))
                .map_err(|error| writer.content("start_time", error.to_string()))
        });
        let start_time = start_time.transpose()?;
        if let Some((name, text)) = truth.texts.iter().find(|t| t.1.len() > MAX_TRUTH_BYTES) {
            let problem = format!("{} bytes; up to {MAX_TRUTH_BYTES} are written", text.len());
            return Err(writer.content(&format!("truth/{name}"), problem));
        }
        let failed = |source| writer.write_error("the file", source);
        let file = NewFile::create(&writer.temporary).map_err(failed)?;
        let declare = || {
            file.text("format", FORMAT)?;
            file.number("version", i64::from(VERSION))?;
            if let Some(time) = start_time {
                file.text("start_time", &time.to_string())?;
            }
            if let Some(text) = &header.machine {
                file.text("machine", text)?;
            }
            if let Some(speed) = header.shaft_speed {
                file.number("shaft_speed_hz", speed.0)?;
            }
            let group = file.group("truth")?;
            for (name, text) in &truth.texts {
                group.text(name, text)?;
            }
            group.number("seed", truth.seed)?;
            Ok((group, file.group("channels")?))
        };
        let groups = declare().map_err(failed);
        writer.file = Some(file);
        let (truth, channels) = groups?;
        (writer.truth, writer.channels) = (Some(truth), Some(channels));
        Ok(writer)
    }

    /// Adds a text to the truth that is known only at the end.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] for a text that is too long, [`CaptureError::Write`] if the disk or the
    /// library refuses.
    pub fn add_truth(&mut self, name: &str, text: &str) -> Result<(), CaptureError> {
        let object = format!("truth/{name}");
        match &self.truth {
            Some(group) if text.len() <= MAX_TRUTH_BYTES => {
                group.text(name, text).map_err(|source| self.write_error(&object, source))
            }
            _ => Err(self.content(&object, format!("up to {MAX_TRUTH_BYTES} bytes are written"))),
        }
    }

    /// Declares the next channel; channels are numbered from 0 in this order.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] for a name, rate, unit or scale that no reader would accept,
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn channel(&mut self, channel: &GrowingChannel) -> Result<(), CaptureError> {
        let object = format!("channels/{}", channel.name);
        check(channel).map_err(|problem| self.content(&object, problem))?;
        let Some(group) = &self.channels else {
            return Err(self.content(&object, "the capture is finished".into()));
        };
        let made = declare(group, channel).map_err(|source| self.write_error(&object, source))?;
        self.columns.push(made);
        Ok(())
    }

    /// Adds samples to the channel of this number.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] for a channel there is none of, or samples of another type,
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn append(
        &mut self,
        channel: usize,
        samples: GrowingSamples<'_>,
    ) -> Result<(), CaptureError> {
        let Some(column) = self.columns.get_mut(channel) else {
            let object = format!("channel {channel}");
            return Err(self.content(&object, "there is none of this number".into()));
        };
        let name = format!("channels/{}", column.header.name);
        match column.take(samples) {
            Ok(true) => Ok(()),
            Ok(false) => Err(self.content(&name, "samples of another number type".into())),
            Err(source) => Err(self.write_error(&name, source)),
        }
    }

    /// Completes the file, waits until it is on the disk and gives it its name.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] for a channel without samples, [`CaptureError::Write`] or
    /// [`CaptureError::Io`]; an older file of that name is then untouched.
    pub fn finish(mut self) -> Result<(), CaptureError> {
        let mut columns = std::mem::take(&mut self.columns);
        for column in &mut columns {
            let name = format!("channels/{}", column.header.name);
            column.flush(1).map_err(|source| self.write_error(&name, source))?;
            if column.n_samples == 0 {
                return Err(self.content(&name, "no samples".into()));
            }
        }
        (self.channels, self.truth) = (None, None);
        if let Some(file) = self.file.take() {
            let summed = self.write_sums(&file, &mut columns);
            drop(columns);
            summed
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

    /// Writes `/checksums` and the checksum of what the file states about itself.
    fn write_sums(&self, file: &NewFile, columns: &mut [Column]) -> Result<(), LibraryError> {
        let group = file.group(checksums::GROUP)?;
        for column in columns.iter_mut() {
            column.sums.extend(column.summed.rest().map(|(_, sum)| sum));
            let name = &column.header.name;
            let table = group.dataset(name, &column.sums, NewStorage::default())?;
            table.number(checksums::BLOCK, BLOCK_SAMPLES)?;
            table.number(checksums::SAMPLES, column.n_samples)?;
        }
        let CaptureHeader { start_time, machine, shaft_speed } = &self.header;
        let mut statement =
            Statement::new(Some(FORMAT), *start_time, machine.as_deref(), *shaft_speed);
        let mut sorted: Vec<&GrowingChannel> =
            columns.iter().map(|column| &column.header).collect();
        sorted.sort_by(|a, b| a.name.cmp(&b.name));
        for channel in sorted {
            let (number_type, scale, offset) = match channel.number {
                GrowingType::I16 { scale, offset } => (NumberType::I16, scale, offset),
                GrowingType::F32 => (NumberType::F32, 1.0, 0.0),
                GrowingType::F64 => (NumberType::F64, 1.0, 0.0),
            };
            statement.channel(&ChannelFacts {
                name: &channel.name,
                number_type,
                sample_rate: channel.sample_rate,
                unit: channel.unit.as_deref(),
                sensor: channel.sensor.as_deref(),
                scale,
                offset,
            });
        }
        statement.segments(None);
        file.number(checksums::STATEMENT, statement.sum())
    }

    fn content(&self, object: &str, problem: String) -> CaptureError {
        CaptureError::Content { file: self.path.clone(), object: object.into(), problem }
    }

    fn write_error(&self, object: &str, source: LibraryError) -> CaptureError {
        CaptureError::Write { file: self.path.clone(), object: object.into(), source }
    }
}

impl Drop for StreamingWriter {
    /// Removes the temporary file; after [`StreamingWriter::finish`] there is none.
    fn drop(&mut self) {
        self.columns.clear();
        (self.channels, self.truth) = (None, None);
        if let Some(file) = self.file.take() {
            // Closing an abandoned file may fail; it is removed in either case.
            let _ = file.close();
        }
        let _ = fs::remove_file(&self.temporary);
    }
}

impl Column {
    /// Takes samples and writes whole chunks; `false` for samples of another type.
    fn take(&mut self, samples: GrowingSamples<'_>) -> Result<bool, LibraryError> {
        let (sums, summed) = (&mut self.sums, &mut self.summed);
        let mut keep = |_: u64, sum: u32| {
            sums.push(sum);
            Ok::<(), Infallible>(())
        };
        let n = match (&mut self.held, samples) {
            (Held::I16(held), GrowingSamples::I16(samples)) => {
                let Ok(()) = summed.add(samples, &mut keep);
                held.extend_from_slice(samples);
                samples.len()
            }
            (Held::F32(held), GrowingSamples::F32(samples)) => {
                let Ok(()) = summed.add(samples, &mut keep);
                held.extend_from_slice(samples);
                samples.len()
            }
            (Held::F64(held), GrowingSamples::F64(samples)) => {
                let Ok(()) = summed.add(samples, &mut keep);
                held.extend_from_slice(samples);
                samples.len()
            }
            _ => return Ok(false),
        };
        self.n_samples += n as u64;
        self.flush(CHUNK_SAMPLES).map(|()| true)
    }

    /// Writes as many whole pieces of `piece` samples as are held.
    fn flush(&mut self, piece: usize) -> Result<(), LibraryError> {
        let whole = |n: usize| n - n % piece;
        match &mut self.held {
            Held::I16(held) => {
                let n = whole(held.len());
                self.dataset.append(&held[..n])?;
                held.drain(..n);
            }
            Held::F32(held) => {
                let n = whole(held.len());
                self.dataset.append(&held[..n])?;
                held.drain(..n);
            }
            Held::F64(held) => {
                let n = whole(held.len());
                self.dataset.append(&held[..n])?;
                held.drain(..n);
            }
        }
        Ok(())
    }
}

fn declare(group: &NewGroup, channel: &GrowingChannel) -> Result<Column, LibraryError> {
    let name = &channel.name;
    let (dataset, held) = match channel.number {
        GrowingType::I16 { .. } => {
            (group.growing::<i16>(name, CHUNK_SAMPLES)?, Held::I16(Vec::new()))
        }
        GrowingType::F32 => (group.growing::<f32>(name, CHUNK_SAMPLES)?, Held::F32(Vec::new())),
        GrowingType::F64 => (group.growing::<f64>(name, CHUNK_SAMPLES)?, Held::F64(Vec::new())),
    };
    dataset.number("sample_rate_hz", channel.sample_rate.0)?;
    if let Some(unit) = &channel.unit {
        dataset.text("unit", unit)?;
    }
    if let Some(sensor) = &channel.sensor {
        dataset.text("sensor", sensor)?;
    }
    if let GrowingType::I16 { scale, offset } = channel.number {
        dataset.number("scale", scale)?;
        dataset.number("offset", offset)?;
    }
    let (sums, summed) = (Vec::new(), BlockSums::new(BLOCK_SAMPLES));
    Ok(Column { header: channel.clone(), dataset, held, n_samples: 0, sums, summed })
}

fn check(channel: &GrowingChannel) -> Result<(), String> {
    if channel.name.is_empty() || channel.name.contains('/') || channel.name == "." {
        return Err("a channel's name must be a text without /".into());
    }
    let rate = channel.sample_rate.0;
    if !(rate.is_finite() && rate > 0.0) {
        return Err(format!("sample rate {rate} Hz; it must be a finite number above 0"));
    }
    if let Some(unit) = channel.unit.as_deref().filter(|unit| SourceUnit::parse(unit).is_none()) {
        return Err(format!("unit \"{unit}\" is none of {}", SourceUnit::ACCEPTED.join(", ")));
    }
    match channel.number {
        GrowingType::I16 { scale, offset }
            if !(scale.is_finite() && scale.abs() > 0.0 && offset.is_finite()) =>
        {
            Err(format!("scale {scale}, offset {offset}; finite numbers, scale not 0"))
        }
        GrowingType::I16 { .. } | GrowingType::F32 | GrowingType::F64 => Ok(()),
    }
}

#[cfg(test)]
mod tests;
