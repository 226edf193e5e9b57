//! What is inside a capture, for people and for callers that must decide before reading.

use super::received::NumberType;
use crate::signal::{ChannelInfo, Timestamp};
use crate::units::{Hz, SourceUnit, Unit};
use std::fmt;
use std::path::PathBuf;

/// Everything a capture states about itself, samples aside.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureInfo {
    /// The file.
    pub file: PathBuf,
    /// Its length on disk, bytes.
    pub file_bytes: u64,
    /// Whether it carries `format = "rotorwatch-capture"`; accepted without, if the layout is right.
    pub format_stated: bool,
    /// Whether a map says where its channels stand, not our layout.
    pub is_mapped: bool,
    /// UTC time of stream time 0.
    pub start_time: Option<Timestamp>,
    /// The machine file's text.
    pub machine: Option<String>,
    /// Nominal speed of the machine's first shaft.
    pub shaft_speed: Option<Hz>,
    /// Load, in the unit of the machine's load sensor (root attribute `load`, if it is a number).
    pub load: Option<f64>,
    /// Channels in the order of their names; a block's `channel` is the place in this list.
    pub channels: Vec<ChannelDescription>,
    /// Number of segments; `None` if the channels are contiguous throughout.
    pub segments: Option<usize>,
    /// From the first sample to the end of the last one of the longest channel, gaps included, s.
    pub duration_s: f64,
    /// Names of root attributes that mean nothing to this program; their values are not read.
    pub other_attributes: Vec<String>,
    /// Names under `/channels` that are no data sets, and are ignored.
    pub ignored: Vec<String>,
    /// Channels that the machine's sensors name and the capture lacks.
    pub absent_channels: Vec<String>,
    /// What kind of file it is.
    pub kind: CaptureKind,
    /// What was guessed, left out or overruled in reading it, a text each.
    pub notes: Vec<String>,
    /// Command-line options that name, of a CSV or WAV file, what was found and what it lacks.
    pub options: Option<String>,
}

/// Kinds of files that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaptureKind {
    /// HDF5.
    Hdf5,
    /// A table of numbers as text.
    Csv,
    /// RIFF WAVE.
    Wav,
}

impl CaptureKind {
    /// Name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hdf5 => "capture",
            Self::Csv => "CSV",
            Self::Wav => "WAV",
        }
    }
}

/// One channel of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelDescription {
    /// What the channel's blocks mean.
    pub info: ChannelInfo,
    /// Samples in the file.
    pub n_samples: u64,
    /// Their length at the channel's rate, gaps left out, s.
    pub duration_s: f64,
    /// Stored number type; other integers are read as float64.
    pub number_type: NumberType,
    /// physical = raw·scale + offset, in the unit of `unit_text`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Raw value that becomes sample 0 of the channel's blocks.
    pub raw_zero: f64,
    /// How they are stored, e.g. `chunks of 10000, shuffle, gzip`.
    pub storage: String,
    /// The `unit` attribute as written.
    pub unit_text: Option<String>,
    /// The `sensor` attribute as written.
    pub sensor: Option<String>,
}

impl ChannelDescription {
    /// What is said of a unit that is written in a way nobody knows and that nothing else states, for people; `None`: it is known,
    /// or none is written.
    #[must_use]
    pub fn unknown_unit(&self) -> Option<String> {
        let text = self.unit_text.as_deref().filter(|_| self.info.unit == Unit::Unknown)?;
        let known = SourceUnit::ACCEPTED.join(", ");
        Some(format!(
            "channel `{}`: its unit \"{text}\" is none of {known}: it counts as unknown, and no absolute limit applies; state the \
             unit in the machine file",
            self.info.name
        ))
    }
}

impl CaptureInfo {
    /// Names what a diagnosis will miss in this capture.
    #[must_use]
    pub fn missing(&self) -> Vec<String> {
        let mut missing = Vec::new();
        if !self.format_stated && !self.is_mapped && self.kind == CaptureKind::Hdf5 {
            missing.push("format: no attribute, accepted by its layout".to_owned());
        }
        if self.machine.is_none() {
            missing.push("machine: no machine text; give a machine file".to_owned());
        }
        if self.shaft_speed.is_none() {
            missing
                .push("shaft_speed_hz: none; a tacho, a machine file or an option must say".into());
        }
        if self.start_time.is_none() {
            missing.push("start_time: none; times count from 1970-01-01".to_owned());
        }
        for channel in &self.channels {
            let name = &channel.info.name;
            match &channel.unit_text {
                None => missing.push(format!("unit of {name}: none")),
                Some(text) if SourceUnit::parse(text).is_none() => {
                    let known = SourceUnit::ACCEPTED.join(", ");
                    missing.push(format!("unit of {name}: \"{text}\" is none of {known}"));
                }
                Some(_) => {}
            }
            if channel.n_samples == 0 {
                missing.push(format!("samples of {name}: none"));
            }
        }
        missing.extend(
            self.absent_channels
                .iter()
                .map(|name| format!("channel {name}: named by a sensor, not in the capture")),
        );
        missing
    }
}

impl fmt::Display for CaptureInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {}, {} bytes, {} s",
            self.file.display(),
            self.kind.name(),
            self.file_bytes,
            self.duration_s
        )?;
        for note in &self.notes {
            writeln!(f, "  {note}")?;
        }
        if let Some(speed) = self.shaft_speed {
            writeln!(f, "  shaft speed {} Hz", speed.0)?;
        }
        if let Some(text) = &self.machine {
            writeln!(f, "  machine file inside, {} lines", text.lines().count())?;
        }
        match self.segments {
            Some(1) => writeln!(f, "  1 segment")?,
            Some(count) => writeln!(f, "  {count} segments")?,
            None => writeln!(f, "  one contiguous recording")?,
        }
        for channel in &self.channels {
            writeln!(f, "  {channel}")?;
        }
        if !self.other_attributes.is_empty() {
            writeln!(f, "  other attributes, ignored: {}", self.other_attributes.join(", "))?;
        }
        if !self.ignored.is_empty() {
            writeln!(f, "  not channels, ignored: {}", self.ignored.join(", "))?;
        }
        for line in self.missing() {
            writeln!(f, "  missing {line}")?;
        }
        Ok(())
    }
}

impl ChannelDescription {
    /// The unit as written, and that which samples are converted to where it is another one.
    fn unit(&self) -> String {
        let canonical = self.info.unit;
        match &self.unit_text {
            None => canonical.symbol().to_owned(),
            Some(text) if text == canonical.symbol() => text.clone(),
            Some(text) if canonical == Unit::Unknown => format!("{text}, which is not known"),
            Some(text) => format!("{text}, converted to {}", canonical.symbol()),
        }
    }
}

impl fmt::Display for ChannelDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let info = &self.info;
        write!(
            f,
            "channel {}: {} samples at {} Hz, {} s, {} ({}), unit {}",
            info.name,
            self.n_samples,
            info.sample_rate.0,
            self.duration_s,
            self.number_type.name(),
            self.storage,
            self.unit()
        )?;
        if let Some((capture, machine)) = &info.unit_conflict {
            write!(
                f,
                "; the capture says {capture}, the machine file {machine}: the latter is used"
            )?;
        }
        Ok(())
    }
}
