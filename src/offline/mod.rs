//! A capture from end to end: read, step the monitor, conclude. What `diagnose` runs, and how
//! healthy captures become baselines; the same `Monitor` as in the daemon. Must not know the clock,
//! the terminal or documents.

pub mod names;

use crate::capture::error::CaptureError;
use crate::capture::hints::Hints;
use crate::capture::info::CaptureInfo;
use crate::capture::reader::CaptureReader;
use crate::capture::reader::ReadReport;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Offered;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::rate::FalseAlarms;
use crate::diagnosis::summary;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelWindow;
use crate::features::Extractor;
use crate::features::Window;
use crate::machine::Machine;
use crate::machine::file::MachineFileErrors;
use crate::machine::limits::Limits;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::pipeline::Monitor;
use crate::pipeline::MonitorError;
use crate::pipeline::Outcome;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::pipeline::windows;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Samples of all channels in a window at most: bounds memory for fast or many channels.
const MAX_WINDOW_SAMPLES: f64 = 4e6;

/// A capture with so many segments gets a provisional baseline from its first tenth.
const MIN_SEGMENTS_FOR_PROVISIONAL: usize = 50;

/// Why a capture could not be diagnosed.
#[derive(Debug, thiserror::Error)]
pub enum OfflineError {
    /// The capture cannot be read.
    #[error("reading the capture failed")]
    Capture(#[from] CaptureError),
    /// The machine text inside the capture is wrong.
    #[error("the machine description inside {} is wrong", file.display())]
    Machine {
        /// The capture.
        file: PathBuf,
        /// Every mistake.
        source: MachineFileErrors,
    },
    /// Machine and capture do not fit.
    #[error("{} does not fit the machine", file.display())]
    Monitor {
        /// The capture.
        file: PathBuf,
        /// Why.
        source: MonitorError,
    },
    /// Nothing to judge.
    #[error("{} holds no window of contiguous samples: record at least a few revolutions", file.display())]
    Empty {
        /// The capture.
        file: PathBuf,
    },
    /// Nothing to judge, because of what was rejected.
    #[error(
        "{} holds no window of contiguous samples: {n_rejected} of {n_samples} are no finite numbers in single precision \
         (NaN, infinite, or beyond 3.4e38 in the unit of analysis){}",
        file.display(),
        if n_rejected == n_samples { "" } else { ", and what lies between them is too short" }
    )]
    Rejected {
        /// The capture.
        file: PathBuf,
        /// Samples that cannot be used, of all.
        n_rejected: u64,
        /// All.
        n_samples: u64,
    },
}

/// What to hold a capture against.
#[derive(Debug, Clone, Default)]
pub struct Reference {
    /// The machine; `None`: the capture's own `machine` attribute, else levels and data health only.
    pub machine: Option<Arc<Machine>>,
    /// The operator's speed.
    pub speed: Option<Hz>,
    /// What is known beside the captures.
    pub hints: Hints,
    /// Healthy records.
    pub baseline: Baseline,
    /// Probability of a false accusation a component and record that is allowed.
    pub false_alarms: FalseAlarms,
}

/// A contiguous run of samples of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The channel.
    pub info: ChannelInfo,
    /// Index of the first sample.
    pub start: u64,
    /// Stream time of the first sample, s.
    pub start_s: f64,
    /// The samples.
    pub samples: Vec<f32>,
}

/// What a run over a capture gives.
struct Run {
    monitor: Monitor,
    outcomes: Vec<Outcome>,
    /// How the capture was read.
    notes: Vec<String>,
    /// What is wrong with channels that are judged.
    warnings: Vec<String>,
    /// What was read of it.
    read: ReadReport,
}

/// Why nothing can be judged.
fn nothing(file: &Path, read: &ReadReport) -> OfflineError {
    let (file, n_rejected) = (file.to_owned(), read.samples_rejected());
    if n_rejected == 0 {
        return OfflineError::Empty { file };
    }
    let n_samples = read.samples_read + n_rejected;
    OfflineError::Rejected { file, n_rejected, n_samples }
}

/// Diagnoses one capture; `progress` is told the part done, 0…1.
///
/// # Errors
/// When the capture cannot be read to its end, its machine text is wrong, machine and capture do not
/// fit, or there is nothing to judge.
pub fn diagnose(
    file: &Path,
    reference: &Reference,
    progress: &mut dyn FnMut(f64),
) -> Result<Diagnosis, OfflineError> {
    let run = run(file, reference, progress)?;
    let judged: Vec<_> = run.outcomes.into_iter().map(|o| o.judged).collect();
    let diagnosis = run.monitor.conclude(&judged);
    let diagnosis = diagnosis.ok_or_else(|| nothing(file, &run.read))?;
    let notes = run.notes.into_iter().chain(diagnosis.notes).collect();
    let warnings = run.warnings.into_iter().chain(diagnosis.warnings).collect();
    Ok(Diagnosis { notes, warnings, ..diagnosis })
}

/// Measures a healthy capture for a baseline.
///
/// # Errors
/// As [`diagnose`].
pub fn learn(
    file: &Path,
    reference: &Reference,
    progress: &mut dyn FnMut(f64),
) -> Result<Record, OfflineError> {
    let run = run(file, reference, progress)?;
    let sensors = &run.monitor.machine().sensors;
    let is_heard = |channel: &&ChannelInfo| sensors.iter().any(|s| s.channel == channel.name);
    let channels = run.monitor.channels().iter().filter(is_heard).cloned().collect();
    Ok(Record { channels, ..learned(file, &run) })
}

/// Measures a capture for a baseline, and says what accuses it, a sentence each: a baseline learned of damage hides it; and which of
/// its units the machine file states otherwise.
///
/// # Errors
/// As [`diagnose`].
pub fn learn_and_judge(
    file: &Path,
    reference: &Reference,
    progress: &mut dyn FnMut(f64),
) -> Result<(Record, Vec<String>), OfflineError> {
    let run = run(file, reference, progress)?;
    let record = learned(file, &run);
    let conflicts = run.monitor.channels().iter().filter_map(ChannelInfo::unit_conflict_text);
    let conflicts: Vec<String> = conflicts.collect();
    let judged: Vec<_> = run.outcomes.into_iter().map(|o| o.judged).collect();
    let diagnosis = run.monitor.conclude(&judged);
    let components = diagnosis.as_ref().map_or(&[][..], |diagnosis| &diagnosis.components);
    let accused = components.iter().filter(|component| component.state.is_accusation());
    let told = accused.map(|component| {
        let fault = component.fault.map_or("cause not proven", FaultMode::name);
        let (id, state) = (&component.id, component.state.name());
        format!("{id} is accused in it ({fault}, {state}): a baseline learned of damage hides it")
    });
    let warnings = told.chain(conflicts).collect();
    Ok((record, warnings))
}

fn learned(file: &Path, run: &Run) -> Record {
    let offered: Vec<Offered<'_>> = run.outcomes.iter().map(Outcome::offered).collect();
    let (channels, machine) = (run.monitor.channels(), run.monitor.machine());
    let name = file.display().to_string();
    Record::of_offered(&name, &offered, channels, &machine.limits.load_bins)
}

/// The machine by which a capture is judged: the one given, its own, or an implied one of sensors only.
///
/// # Errors
/// When the capture cannot be opened or its machine text is wrong.
pub fn machine_of(file: &Path, reference: &Reference) -> Result<Arc<Machine>, OfflineError> {
    Ok(open(file, reference)?.1)
}

/// Reads again the samples a diagnosis rests on: of each channel of `ranges` (name, first sample, one past the
/// last) the last contiguous run inside, and of that the longest window at most.
///
/// # Errors
/// When the capture cannot be read.
pub fn stretches(
    file: &Path,
    reference: &Reference,
    ranges: &[(String, u64, u64)],
) -> Result<Vec<Stretch>, OfflineError> {
    let (mut reader, machine) = open(file, reference)?;
    let longest_s = windows::longest_s(&machine, hints(reader.info(), reference));
    let channels: Vec<ChannelInfo> =
        reader.info().channels.iter().map(|c| c.info.clone()).collect();
    let n_channels = channels.len().max(1) as f64;
    let mut found: Vec<Option<(u32, Stretch)>> = vec![None; channels.len()];
    while let Some(block) = reader.next_block()? {
        let (at, info) = (block.channel.0, &channels[block.channel.0]);
        let range = ranges.iter().find(|(name, ..)| *name == info.name);
        let Some((_, first, end)) = range else { continue };
        let (first, end) = ((*first).max(block.start.0), (*end).min(block.end().0));
        let inside = |index: u64| usize::try_from(index.saturating_sub(block.start.0)).ok();
        let part = match (inside(first), inside(end)) {
            (Some(from), Some(to)) if from < to => &block.samples[from..to],
            (_, _) => continue,
        };
        let begins = |stretch: &Stretch| stretch.start + stretch.samples.len() as u64 == first;
        let is_next =
            |(segment, stretch): &(u32, Stretch)| *segment == block.segment && begins(stretch);
        if !found[at].as_ref().is_some_and(is_next) {
            let start_s = block.time_s + (first - block.start.0) as f64 / info.sample_rate.0;
            let info = info.clone();
            found[at] =
                Some((block.segment, Stretch { info, start: first, start_s, samples: Vec::new() }));
        }
        if let Some((_, stretch)) = &mut found[at] {
            stretch.samples.extend_from_slice(part);
            stretch
                .keep_last((longest_s * info.sample_rate.0).min(MAX_WINDOW_SAMPLES / n_channels));
        }
    }
    Ok(found.into_iter().flatten().map(|(_, stretch)| stretch).collect())
}

/// Of each channel whose lines are read at equal angles in these stretches, for the speed changes by more than they can bear, the samples that
/// they are read from, by name, with their rate.
///
/// # Errors
/// When the capture cannot be read.
pub fn evened(
    file: &Path,
    reference: &Reference,
    stretches: &[Stretch],
) -> Result<Vec<(String, Vec<f32>, Hz)>, OfflineError> {
    let (reader, machine) = open(file, reference)?;
    let start_s = stretches.iter().map(|stretch| stretch.start_s).fold(f64::INFINITY, f64::min);
    let end_s = stretches.iter().map(Stretch::end_s).fold(f64::NEG_INFINITY, f64::max);
    let channels: Vec<ChannelInfo> = stretches.iter().map(|stretch| stretch.info.clone()).collect();
    let window = Window {
        time_s: (start_s, end_s),
        channels: stretches.iter().map(|stretch| Some(stretch.run())).collect(),
    };
    let mut extractor = Extractor::new(machine, channels, hints(reader.info(), reference));
    let named = |(channel, samples, rate): (ChannelIndex, Vec<f32>, Hz)| {
        (stretches[channel.0].info.name.clone(), samples, rate)
    };
    Ok(extractor.evened(&window).into_iter().map(named).collect())
}

impl Stretch {
    /// Its samples as a window has them.
    fn run(&self) -> ChannelWindow<'_> {
        ChannelWindow { start: self.start, time_s: self.start_s, samples: &self.samples }
    }

    /// Stream time one past the last sample, s.
    fn end_s(&self) -> f64 {
        self.start_s + self.samples.len() as f64 / self.info.sample_rate.0
    }

    /// Drops all but the last `n` samples.
    fn keep_last(&mut self, n: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "bounded by the caller"
        )]
        let excess = self.samples.len().saturating_sub(n.max(1.0) as usize);
        self.samples.drain(..excess);
        self.start += excess as u64;
        self.start_s += excess as f64 / self.info.sample_rate.0;
    }
}

fn run(
    file: &Path,
    reference: &Reference,
    progress: &mut dyn FnMut(f64),
) -> Result<Run, OfflineError> {
    let (mut reader, machine) = open(file, reference)?;
    let info = reader.info();
    let channels: Vec<ChannelInfo> = info.channels.iter().map(|c| c.info.clone()).collect();
    let hints = hints(info, reference);
    let settings = settings(info, &channels, (&machine, hints), reference);
    let duration_s = info.duration_s;
    let notes = info.notes.clone();
    let is_named = |name: &str| machine.sensors.iter().any(|sensor| sensor.channel == name);
    let is_heard: Vec<bool> = channels.iter().map(|channel| is_named(&channel.name)).collect();
    let judged = info.channels.iter().zip(&is_heard).filter(|(_, is_heard)| **is_heard);
    let warnings = judged.filter_map(|(channel, _)| channel.unknown_unit()).collect();
    let mut monitor = Monitor::new(machine, channels, hints, &settings)
        .map_err(|source| OfflineError::Monitor { file: file.to_owned(), source })?;
    let mut outcomes: Vec<Outcome> = Vec::new();
    let mut first_s = None;
    let mut heard = 0;
    let mut keep = |outcome: Outcome| outcomes.push(outcome);
    while let Some(block) = reader.next_block()? {
        monitor.step(&block, &mut keep);
        if is_heard[block.channel.0] {
            heard += block.samples.len() as u64;
        }
        let start_s = *first_s.get_or_insert(block.time_s);
        progress(((block.time_s - start_s) / duration_s).clamp(0.0, 1.0));
    }
    let report = reader.report();
    if report.samples_rejected() > 0 {
        monitor.count_rejected(report.samples_rejected(), &report.reasons().join("; "));
    }
    monitor.finish(&mut keep);
    progress(1.0);
    let (in_windows, _) = summary::samples_in(outcomes.iter().map(|outcome| &outcome.judged));
    if heard > in_windows {
        let reason = "in no window: of a stretch too short for one, or beyond its last";
        monitor.count_rejected(heard - in_windows, reason);
    }
    Ok(Run { monitor, outcomes, notes, warnings, read: report })
}

/// Opens a capture with the machine given, its own, or an implied one.
fn open(file: &Path, reference: &Reference) -> Result<(CaptureReader, Arc<Machine>), OfflineError> {
    let hints = &reference.hints;
    if let Some(machine) = &reference.machine {
        return Ok((CaptureReader::open(file, Some(machine), hints)?, Arc::clone(machine)));
    }
    let reader = CaptureReader::open(file, None, hints)?;
    match &reader.info().machine {
        Some(text) => {
            let name = format!("{} (attribute `machine`)", file.display());
            let machine = crate::machine::file::parse(text, &name)
                .map_err(|source| OfflineError::Machine { file: file.to_owned(), source })?;
            let machine = Arc::new(machine);
            Ok((CaptureReader::open(file, Some(&machine), hints)?, machine))
        }
        None => {
            let machine = Arc::new(implied_machine(reader.info()));
            Ok((reader, machine))
        }
    }
}

/// A machine of nothing but sensors: levels and data health can still be told.
fn implied_machine(info: &CaptureInfo) -> Machine {
    let sensor = |channel: &ChannelInfo| Sensor {
        channel: channel.name.clone(),
        kind: match channel.unit {
            Unit::MillimetrePerSecond => SensorKind::Velocity,
            Unit::Micrometre => SensorKind::Proximitor,
            Unit::Hertz => SensorKind::Speed,
            Unit::MetrePerSecondSquared | Unit::Volt | Unit::One | Unit::Unknown => {
                SensorKind::Accelerometer
            }
        },
        unit: None,
        at: None,
        axis_deg: None,
        direction: None,
        usable: None,
        sensitivity_v_per_unit: None,
        gap_v: None,
        tacho: None,
    };
    Machine {
        id: "unknown".to_owned(),
        name: "machine not described".to_owned(),
        iso_group: None,
        power_kw: None,
        shafts: Vec::new(),
        bearings: Vec::new(),
        motors: Vec::new(),
        gears: Vec::new(),
        sensors: info.channels.iter().map(|c| sensor(&c.info)).collect(),
        limits: Limits::default(),
        alarm_limits: crate::machine::alarm_limit::AlarmLimits::default(),
        capture_map: std::collections::BTreeMap::new(),
        notes: Vec::new(),
    }
}

/// Speeds that are stated for a capture.
fn hints(info: &CaptureInfo, reference: &Reference) -> SpeedHints {
    SpeedHints { option: reference.speed, capture: info.shaft_speed }
}

/// Equal windows of at most [`windows::longest_s`], end to end.
fn settings(
    info: &CaptureInfo,
    channels: &[ChannelInfo],
    (machine, hints): (&Machine, SpeedHints),
    reference: &Reference,
) -> Settings {
    let rate: f64 = channels.iter().map(|c| c.sample_rate.0).sum();
    let longest = windows::longest_s(machine, hints).min(MAX_WINDOW_SAMPLES / rate.max(1.0));
    let whole = info.segments.is_none() && info.duration_s > 0.0;
    let window_s = if whole { windows::equal_s(info.duration_s, longest) } else { longest };
    let provisional = info.segments.filter(|n| *n >= MIN_SEGMENTS_FOR_PROVISIONAL);
    let none_given = reference.baseline.records.is_empty();
    Settings {
        window_s,
        hop_s: window_s,
        ring_s: 2.0 * window_s,
        baseline: reference.baseline.clone(),
        provisional_segments: provisional
            .filter(|_| none_given)
            .and_then(|n| u32::try_from(n.div_ceil(10)).ok()),
        load: info.load,
        false_alarms: reference.false_alarms,
        alarms: crate::pipeline::Settings::default().alarms,
    }
}

#[cfg(test)]
mod tests;
