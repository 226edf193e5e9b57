//! One file being recorded: every flushed sample survives a kill, at any moment.
//!
//! The file has its name from its first flush on; before, it is a temporary one. What is flushed
//! is visible in the order segments, samples, checksums: a reader never finds a sample without its
//! time, nor a checksum without its samples.

use super::super::attachment::Attachment;
use super::super::error::{CaptureError, LibraryError};
use super::super::hdf5::RecordingFile;
use super::super::received::{Received, ReceivedChannel};
use super::super::segments::Segments;
use super::super::writer::CaptureHeader;
use super::column::{Column, little_endian};
use super::declare::{Channel, Columns, start};
use crate::units::Hz;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Chunks or segments of one file at most: below what the reader accepts.
const ROWS_MAX: u64 = 900_000;

/// What a recording states at its root.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordingHeader {
    /// As in every capture.
    pub capture: CaptureHeader,
    /// Hash of the daemon's configuration.
    pub configuration: Option<String>,
    /// What the file keeps beside its channels, in the group [`GROUP`](super::super::attachment::GROUP).
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
        let reference_rate = channels.iter().map(|c| c.sample_rate).fold(Hz(0.0), faster);
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

fn faster(a: Hz, b: Hz) -> Hz {
    if b > a { b } else { a }
}
