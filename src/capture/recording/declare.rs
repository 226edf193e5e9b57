//! What a recording states before its first sample: its columns, what is kept beside them, the checksum of all of it.

use super::super::attachment::{self, Attachment};
use super::super::checksums;
use super::super::error::LibraryError;
use super::super::hdf5::{ElementType, RecordingFile};
use super::super::integrity::{ChannelFacts, Statement};
use super::super::layout::{FORMAT, VERSION};
use super::super::received::{NumberType, ReceivedChannel};
use super::super::writer::CaptureHeader;
use super::column::Column;
use super::file::RecordingHeader;
use crate::units::Hz;
use std::path::Path;

/// Samples of a chunk at least: slower channels would need too many chunks.
const CHUNK_SAMPLES_MIN: u64 = 1024;

/// Bytes of one chunk of all channels together at most: half of what the reader accepts.
const CHUNK_BYTES_MAX: u64 = 32 << 20;

/// Rows of a chunk of the segment lists.
const SEGMENT_CHUNK: u64 = 64;

/// Rows of a chunk of the checksums.
const CHECKSUM_CHUNK: u64 = 256;

/// One channel of the file.
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) rate: Hz,
    pub(super) kind: NumberType,
    /// Index in the stream of the file's first sample; `None`: has no part in this file.
    pub(super) base: Option<u64>,
    pub(super) samples: Column,
    pub(super) checksums: Column,
}

/// The data sets of a file.
pub(super) struct Columns {
    pub(super) starts: Column,
    pub(super) times_s: Column,
    pub(super) channels: Vec<Channel>,
}

/// Declares everything and opens the file to readers.
pub(super) fn start(
    path: &Path,
    header: &RecordingHeader,
    start_time: Option<&str>,
    channels: &[ReceivedChannel],
    gzip: Option<u32>,
) -> Result<(RecordingFile, Columns), LibraryError> {
    let mut file = RecordingFile::create(path)?;
    file.text("format", FORMAT)?;
    file.number("version", i64::from(VERSION))?;
    file.number("recording", 1_i64)?;
    let texts = [
        ("start_time", start_time),
        ("machine", header.capture.machine.as_deref()),
        ("configuration", header.configuration.as_deref()),
    ];
    for (name, text) in texts {
        text.map_or(Ok(()), |text| file.text(name, text))?;
    }
    if let Some(speed) = header.capture.shaft_speed {
        file.number("shaft_speed_hz", speed.0)?;
    }
    file.number(checksums::STATEMENT, i64::from(statement(&header.capture, channels)))?;
    // Readers see new rows in this order: no sample before its segment, no checksum before either.
    for group in ["segments", "channels", "checksums"] {
        file.group(group)?;
    }
    let mut rows = |name, element: ElementType| {
        let dataset = file.column("segments", name, element, SEGMENT_CHUNK, None)?;
        Ok::<_, LibraryError>(Column::new(dataset, element.bytes(), SEGMENT_CHUNK, false))
    };
    let starts = rows("start_sample", ElementType::I64)?;
    let times_s = rows("time_s", ElementType::F64)?;
    let samples: Vec<Column> = channels
        .iter()
        .map(|channel| samples_column(&mut file, channel, channels.len(), gzip))
        .collect::<Result<_, _>>()?;
    let channels = channels
        .iter()
        .zip(samples)
        .map(|(channel, samples)| {
            let checksums = checksum_column(&mut file, channel, samples.chunk())?;
            let (name, rate, kind) =
                (channel.name.clone(), channel.sample_rate, channel.number_type);
            Ok(Channel { name, rate, kind, base: None, samples, checksums })
        })
        .collect::<Result<_, LibraryError>>()?;
    let kept = attachments(&mut file, &header.evidence)?;
    file.start()?;
    for (mut column, bytes) in kept {
        column.push(&mut file, &bytes)?;
    }
    Ok((file, Columns { starts, times_s, channels }))
}

/// Declares what is kept beside the channels, each list as one chunk; gives what is to be written.
fn attachments(
    file: &mut RecordingFile,
    kept: &[Attachment],
) -> Result<Vec<(Column, Vec<u8>)>, LibraryError> {
    if !kept.is_empty() {
        file.group(attachment::GROUP)?;
    }
    let mut columns = Vec::new();
    for Attachment { name, content } in kept.iter().filter(|kept| !kept.content.is_empty()) {
        let element = match content {
            attachment::Content::Text(_) => ElementType::U8,
            attachment::Content::Numbers(_) => ElementType::F64,
            attachment::Content::Counts(_) => ElementType::I64,
        };
        let length = content.len() as u64;
        let dataset = file.column(attachment::GROUP, name, element, length, None)?;
        columns.push((Column::new(dataset, element.bytes(), length, false), content.bytes()));
    }
    Ok(columns)
}

/// The checksum of what the file states about itself, segments aside: they are yet to come.
fn statement(header: &CaptureHeader, channels: &[ReceivedChannel]) -> u32 {
    let CaptureHeader { start_time, machine, shaft_speed } = header;
    let mut statement = Statement::new(Some(FORMAT), *start_time, machine.as_deref(), *shaft_speed);
    let mut sorted: Vec<&ReceivedChannel> = channels.iter().collect();
    sorted.sort_by(|a, b| a.name.cmp(&b.name));
    for channel in sorted {
        statement.channel(&ChannelFacts {
            name: &channel.name,
            number_type: channel.number_type,
            sample_rate: channel.sample_rate,
            unit: channel.unit.as_deref(),
            sensor: channel.sensor.as_deref(),
            scale: channel.scale,
            offset: channel.offset,
        });
    }
    statement.sum()
}

/// Declares a channel. A chunk is a second, but of slow channels at least `CHUNK_SAMPLES_MIN`
/// samples; those are not compressed, so that they can be flushed before a chunk is full.
fn samples_column(
    file: &mut RecordingFile,
    channel: &ReceivedChannel,
    n_channels: usize,
    gzip: Option<u32>,
) -> Result<Column, LibraryError> {
    let width = channel.number_type.bytes();
    let most = (CHUNK_BYTES_MAX / (n_channels * width).max(1) as u64).max(1);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a positive rate; float to int casts saturate"
    )]
    let second = channel.sample_rate.0.ceil() as u64;
    let chunk = second.max(CHUNK_SAMPLES_MIN).min(most);
    let gzip = gzip.filter(|_| second >= CHUNK_SAMPLES_MIN);
    let element = ElementType::from(channel.number_type);
    let dataset = file.column("channels", &channel.name, element, chunk, gzip)?;
    file.column_number(dataset, "sample_rate_hz", channel.sample_rate.0)?;
    file.column_number(dataset, "scale", channel.scale)?;
    file.column_number(dataset, "offset", channel.offset)?;
    for (name, text) in [("unit", &channel.unit), ("sensor", &channel.sensor)] {
        text.as_ref().map_or(Ok(()), |text| file.column_text(dataset, name, text))?;
    }
    Ok(Column::new(dataset, width, chunk, gzip.is_some()))
}

/// Declares the checksums of a channel.
fn checksum_column(
    file: &mut RecordingFile,
    channel: &ReceivedChannel,
    block_samples: u64,
) -> Result<Column, LibraryError> {
    let element = ElementType::U32;
    let dataset = file.column("checksums", &channel.name, element, CHECKSUM_CHUNK, None)?;
    let block_samples = i64::try_from(block_samples).unwrap_or(i64::MAX);
    file.column_number(dataset, "block_samples", block_samples)?;
    Ok(Column::new(dataset, element.bytes(), CHECKSUM_CHUNK, false))
}
