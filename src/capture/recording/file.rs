//! One file being recorded: every flushed sample survives a kill, at any moment.
//!
//! The file has its name from its first flush on; before, it is a temporary one. What is flushed
//! is visible in the order segments, samples, checksums: a reader never finds a sample without its
//! time, nor a checksum without its samples.

use super::super::attachment::{self, Attachment};
use super::super::checksums;
use super::super::error::{CaptureError, LibraryError};
use super::super::hdf5::{ElementType, RecordingFile};
use super::super::integrity::{ChannelFacts, Statement};
use super::super::layout::{FORMAT, VERSION};
use super::super::received::{Received, ReceivedChannel};
use super::super::segments::Segments;
use super::super::writer::CaptureHeader;
use super::column::{Column, little_endian};
use crate::units::Hz;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Samples of a chunk at least: slower channels would need too many chunks.
const CHUNK_SAMPLES_MIN: u64 = 1024;

/// Bytes of one chunk of all channels together at most: half of what the reader accepts.
const CHUNK_BYTES_MAX: u64 = 32 << 20;

/// Rows of a chunk of the segment lists.
const SEGMENT_CHUNK: u64 = 64;

/// Rows of a chunk of the checksums.
const CHECKSUM_CHUNK: u64 = 256;

/// Chunks or segments of one file at most: below what the reader accepts.
const ROWS_MAX: u64 = 900_000;

/// What a recording states at its root.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordingHeader {
    /// As in every capture.
    pub capture: CaptureHeader,
    /// Hash of the daemon's configuration.
    pub configuration: Option<String>,
    /// What the file keeps beside its channels, in the group [`attachment::GROUP`].
    pub evidence: Vec<Attachment>,
}

/// A recording that was closed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    /// The file; `None` if there was nothing to keep.
    pub file: Option<PathBuf>,
    /// Samples of all channels.
    pub n_samples: u64,
    /// Length of the file, bytes.
    pub bytes: u64,
}

/// A file being recorded.
pub struct Recorder {
    path: PathBuf,
    file: RecordingFile,
    /// Until the first flush; dropped after `file`.
    temporary: Unnamed,
    /// A shared lock that tells others that the file is being written; readers do not mind.
    _lock: Option<File>,
    channels: Vec<Channel>,
    reference_rate: Hz,
    starts: Column,
    times_s: Column,
    /// Start, in samples of the fastest channel, and time of the newest segment.
    newest: Option<(u64, f64)>,
}

/// One channel of the file.
struct Channel {
    name: String,
    rate: Hz,
    kind: super::super::received::NumberType,
    /// Index in the stream of the file's first sample; `None`: has no part in this file.
    base: Option<u64>,
    samples: Column,
    checksums: Column,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Recorder {
    /// Starts a file; `gzip`: level 1 to 9, `None` stores samples as they are.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Io`] if there is such a file, [`CaptureError::Write`] if the folder cannot
    /// be written, [`CaptureError::Content`] for a name or a time that no reader would accept.
    pub fn create(
        path: &Path,
        header: &RecordingHeader,
        channels: &[ReceivedChannel],
        gzip: Option<u32>,
    ) -> Result<Self, CaptureError> {
        if path.exists() {
            let source = io::Error::from(io::ErrorKind::AlreadyExists);
            return Err(CaptureError::Io { file: path.into(), action: "record to it", source });
        }
        if let Some(channel) = channels.iter().find(|c| c.name.is_empty() || c.name.contains('/')) {
            return Err(CaptureError::Content {
                file: path.into(),
                object: format!("channels/{}", channel.name),
                problem: "a channel's name must be a text without /".into(),
            });
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let start_time = match header.capture.start_time {
            None => None,
            Some(time) => Some(
                jiff::Timestamp::from_nanosecond(i128::from(time.0))
                    .map_err(|error| CaptureError::Content {
                        file: path.into(),
                        object: "start_time".into(),
                        problem: error.to_string(),
                    })?
                    .to_string(),
            ),
        };
        let started = start(&temporary, header, start_time.as_deref(), channels, gzip);
        let (file, columns) = started.map_err(|source| {
            // Nothing of it is worth keeping; if it cannot be removed the next start does.
            let _ = fs::remove_file(&temporary);
            CaptureError::Write { file: path.into(), object: "the file".into(), source }
        })?;
        let lock = File::open(&temporary).ok().filter(|lock| lock.try_lock_shared().is_ok());
        let reference_rate = channels.iter().map(|c| c.sample_rate).fold(Hz(0.0), Columns::faster);
        let Columns { starts, times_s, channels } = columns;
        let (path, temporary) = (path.to_owned(), Unnamed(Some(temporary)));
        let newest = None;
        Ok(Self {
            path,
            temporary,
            file,
            _lock: lock,
            channels,
            reference_rate,
            starts,
            times_s,
            newest,
        })
    }

    /// The file's name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Begins a stretch in this file, if its layout can say so; else nothing is changed.
    ///
    /// `starts`: index in the stream of each channel's first sample, `time_s`: its stream time.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn begin(&mut self, starts: &[Option<u64>], time_s: f64) -> Result<bool, CaptureError> {
        let Some(start) = self.segment_start(starts, time_s) else { return Ok(false) };
        if self.newest.is_none() {
            for (channel, start) in self.channels.iter_mut().zip(starts) {
                channel.base = *start;
            }
        }
        let row = i64::try_from(start).unwrap_or(i64::MAX).to_le_bytes();
        let written = self
            .starts
            .push(&mut self.file, &row)
            .and_then(|_| self.times_s.push(&mut self.file, &time_s.to_le_bytes()));
        written.map_err(|source| self.write_error("segments", source))?;
        self.newest = Some((start, time_s));
        Ok(true)
    }

    /// Where the stretch begins, in samples of the fastest channel of this file; `None` if the
    /// rule of `/segments` cannot express it.
    fn segment_start(&self, starts: &[Option<u64>], time_s: f64) -> Option<u64> {
        let Some((newest, newest_s)) = self.newest else { return Some(0) };
        if self.starts.length() >= ROWS_MAX || time_s < newest_s {
            return None;
        }
        let places: Vec<Option<Option<u64>>> = self
            .channels
            .iter()
            .zip(starts)
            .map(|(channel, start)| match (channel.base, start) {
                (Some(base), Some(start)) => Some(start.checked_sub(base)),
                (None, Some(_)) => Some(None),
                (_, None) => None,
            })
            .collect();
        let is_fastest = |channel: &Channel| channel.rate >= self.reference_rate;
        let start = self
            .channels
            .iter()
            .zip(&places)
            .find_map(|(channel, place)| place.filter(|_| is_fastest(channel)))??;
        let fits = self.channels.iter().zip(&places).all(|(channel, place)| {
            let scaled = Segments::scaled(start, channel.rate, self.reference_rate);
            match place {
                Some(place) => *place == Some(scaled) && channel.samples.length() == scaled,
                None => channel.samples.length() <= scaled,
            }
        });
        (start > newest && fits).then_some(start)
    }

    /// Adds samples that follow those of their channel.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Content`] if they do not follow or are of another number type than was
    /// declared, [`CaptureError::Write`] if the disk or the library refuses.
    pub fn write(&mut self, run: &Received) -> Result<(), CaptureError> {
        let place = run.channel.0;
        let Some(channel) = self.channels.get_mut(place) else { return Ok(()) };
        let follows = channel.base.map(|base| base + channel.samples.length()) == Some(run.start.0);
        if !follows || run.raw.number_type() != channel.kind {
            return Err(CaptureError::Content {
                file: self.path.clone(),
                object: format!("channels/{}", channel.name),
                problem: format!(
                    "{} from sample {} on do not continue {} {}",
                    run.raw.number_type().name(),
                    run.start.0,
                    channel.samples.length(),
                    channel.kind.name()
                ),
            });
        }
        let bytes = little_endian(&run.raw);
        let written = channel.samples.push(&mut self.file, &bytes).and_then(|sums| {
            let sums: Vec<u8> = sums.iter().flat_map(|sum| sum.to_le_bytes()).collect();
            channel.checksums.push(&mut self.file, &sums)
        });
        match written {
            Ok(_) => Ok(()),
            Err(source) => {
                let object = format!("channels/{}", self.channels[place].name);
                Err(self.write_error(&object, source))
            }
        }
    }

    /// Puts on the disk, visible to readers, what was added: all of it in uncompressed channels,
    /// whole chunks in the others.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] or [`CaptureError::Io`].
    pub fn flush(&mut self) -> Result<(), CaptureError> {
        self.store(false).map_err(|source| self.write_error("the file", source))?;
        // A file without a sample is none yet.
        if self.channels.iter().any(|channel| channel.samples.stored() > 0) {
            self.name().map_err(|source| CaptureError::Io {
                file: self.path.clone(),
                action: "give it its name",
                source,
            })?;
        }
        Ok(())
    }

    /// Whether the file has so many chunks that another must follow.
    #[must_use]
    pub fn is_full(&self) -> bool {
        let columns = self.channels.iter();
        columns.map(|c| c.samples.n_chunks() + c.checksums.n_chunks()).sum::<u64>() >= ROWS_MAX
    }

    /// Samples taken so far, over all channels.
    #[must_use]
    pub fn n_samples(&self) -> u64 {
        self.channels.iter().map(|channel| channel.samples.length()).sum()
    }

    /// Samples that are in the file, as far as it was flushed since, over all channels.
    #[must_use]
    pub fn n_stored(&self) -> u64 {
        self.channels.iter().map(|channel| channel.samples.stored()).sum()
    }

    /// Length of the file now, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let path = self.temporary.0.as_ref().unwrap_or(&self.path);
        fs::metadata(path).map_or(0, |metadata| metadata.len())
    }

    /// Completes the file: it opens everywhere from then on.
    ///
    /// # Errors
    ///
    /// [`CaptureError::Write`] or [`CaptureError::Io`]; what was flushed is in the file.
    pub fn close(mut self) -> Result<Finished, CaptureError> {
        self.store(true).map_err(|source| self.write_error("the file", source))?;
        let n_samples = self.n_samples();
        let path = self.path.clone();
        if n_samples == 0 {
            return Ok(Finished { file: None, n_samples, bytes: 0 });
        }
        let io = |action| {
            let file = path.clone();
            move |source| CaptureError::Io { file, action, source }
        };
        self.name().map_err(io("give it its name"))?;
        let Self { file, .. } = self;
        file.close().map_err(|source| CaptureError::Write {
            file: path.clone(),
            object: "the file".into(),
            source,
        })?;
        let bytes = fs::metadata(&path).map_err(io("look at it"))?.len();
        Ok(Finished { file: Some(path), n_samples, bytes })
    }

    /// Stores what is pending; the library shows it to readers in the order of the data sets.
    fn store(&mut self, last: bool) -> Result<(), LibraryError> {
        self.starts.store(&mut self.file, last)?;
        self.times_s.store(&mut self.file, last)?;
        for channel in &mut self.channels {
            channel.samples.store(&mut self.file, last)?;
            channel.checksums.store(&mut self.file, last)?;
        }
        self.file.flush()
    }

    fn name(&mut self) -> io::Result<()> {
        let Some(temporary) = &self.temporary.0 else { return Ok(()) };
        if self.path.exists() {
            return Err(io::Error::from(io::ErrorKind::AlreadyExists));
        }
        fs::rename(temporary, &self.path)?;
        self.temporary.0 = None;
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
    }

    fn write_error(&self, object: &str, source: LibraryError) -> CaptureError {
        CaptureError::Write { file: self.path.clone(), object: object.into(), source }
    }
}

/// Removes a file that never got its name; one that did keeps what was flushed.
struct Unnamed(Option<PathBuf>);

impl Drop for Unnamed {
    fn drop(&mut self) {
        if let Some(temporary) = self.0.take() {
            let _ = fs::remove_file(temporary);
        }
    }
}

/// The data sets of a file.
struct Columns {
    starts: Column,
    times_s: Column,
    channels: Vec<Channel>,
}

impl Columns {
    fn faster(a: Hz, b: Hz) -> Hz {
        if b > a { b } else { a }
    }
}

/// Declares everything and opens the file to readers.
fn start(
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
