//! Records made on the fly with a known answer, to try the diagnosis on: of a stand in closed form
//! ([`stand`]), of gear pairs ([`gears`]), of machines every number of which is drawn ([`drawn`]), of the simulated
//! rig ([`rig`]) and of its rotor's runs ([`runs`]).
//!
//! [`grid`] says which. A trial hands the monitor samples, channels and what a machine file would say, nothing of the
//! answer; the verdict is scored like that on any recording. Pure: the seed makes the record. Must not know
//! files, the clock, or how verdicts come about.

pub mod defect;
pub mod drawn;
pub mod gears;
pub mod grid;
pub mod motion;
pub mod rig;
pub mod runs;
mod simulated;
pub mod stand;
pub mod vibration;

use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Offered;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::verdict::Diagnosis;
use crate::evaluation::truth::Known;
use crate::features::bands;
use crate::machine::Machine;
use crate::machine::sensor::SensorKind;
use crate::pipeline::Monitor;
use crate::pipeline::MonitorError;
use crate::pipeline::Outcome;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::pipeline::windows;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Length of the blocks in which channels are handed in by turns, s.
const TURN_S: f64 = 0.5;

/// Samples of all channels of a machine, and what a monitor is told beside them.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The machine.
    pub machine: Arc<Machine>,
    /// Its machine file, as text.
    pub machine_text: Arc<str>,
    /// The channels.
    pub channels: Vec<ChannelInfo>,
    /// Samples of each channel.
    pub samples: Vec<Vec<f32>>,
    /// Speeds that are written down somewhere.
    pub hints: SpeedHints,
}

/// A record and its answer.
#[derive(Debug, Clone)]
pub struct Trial {
    /// What kind of trial it is, for tables.
    pub group: String,
    /// What is wrong, for tables.
    pub label: String,
    /// Which one: enough to make it again.
    pub name: String,
    /// The answer.
    pub known: Known,
    /// True speed of the first shaft, mean.
    pub speed: Hz,
    /// Whether the lines of its bearing defect stand over the noise (T7); `None` where that is not told.
    pub is_visible: Option<bool>,
    /// How many times as high these lines are as in the same machine without the defect (T11); `None` where that is
    /// not told.
    pub over_sound: Option<f64>,
    /// The record.
    pub measured: Measured,
    /// Healthy records to hold it against.
    pub baseline: Baseline,
}

impl Trial {
    /// The trial without the pulses of a tacho: all there is to know the speed by is a written one that is off by the
    /// part `error` of it.
    #[must_use]
    pub fn without_tacho(mut self, error: f64) -> Self {
        let machine = Arc::clone(&self.measured.machine);
        let is_tacho = |name: &str| {
            machine.sensors.iter().any(|s| s.channel == name && s.kind == SensorKind::Tacho)
        };
        let keep: Vec<bool> = self.measured.channels.iter().map(|c| !is_tacho(&c.name)).collect();
        let mut kept = keep.iter();
        self.measured.channels.retain(|_| kept.next().copied().unwrap_or(true));
        let mut kept = keep.iter();
        self.measured.samples.retain(|_| kept.next().copied().unwrap_or(true));
        self.measured.hints.capture = Some(Hz(self.speed.0 * (1.0 + error)));
        self
    }

    /// What the monitor says of it; `None` if there is nothing to judge.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel.
    pub fn diagnose(&self) -> Result<Option<Diagnosis>, MonitorError> {
        self.diagnose_thinned(self.measured.window_s(), bands::LEVELS)
    }

    /// The same, judged in windows of this length one behind the other, s, and in so many levels of demodulation bands.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel.
    pub fn diagnose_thinned(
        &self,
        window_s: f64,
        band_levels: usize,
    ) -> Result<Option<Diagnosis>, MonitorError> {
        let baseline = self.baseline.clone();
        let (monitor, outcomes) = self.measured.run(baseline, window_s, band_levels)?;
        let judged: Vec<_> = outcomes.into_iter().map(|o| o.judged).collect();
        Ok(monitor.conclude(&judged))
    }
}

impl Measured {
    /// The record as a baseline's.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel.
    pub fn learn(&self, name: &str) -> Result<Record, MonitorError> {
        let (monitor, outcomes) = self.run(Baseline::default(), self.window_s(), bands::LEVELS)?;
        let offered: Vec<Offered<'_>> = outcomes.iter().map(Outcome::offered).collect();
        let load_bins = &self.machine.limits.load_bins;
        Ok(Record::of_offered(name, &offered, monitor.channels(), load_bins))
    }

    fn duration_s(&self) -> f64 {
        let seconds = self.channels.iter().zip(&self.samples);
        seconds.map(|(info, samples)| samples.len() as f64 / info.sample_rate.0).fold(0.0, f64::max)
    }

    /// Length of equal windows end to end, as a capture is judged in.
    fn window_s(&self) -> f64 {
        windows::equal_s(self.duration_s(), windows::longest_s(&self.machine, self.hints))
    }

    fn run(
        &self,
        baseline: Baseline,
        window_s: f64,
        band_levels: usize,
    ) -> Result<(Monitor, Vec<Outcome>), MonitorError> {
        let settings = Settings { window_s, hop_s: window_s, baseline, ..Settings::default() };
        let machine = Arc::clone(&self.machine);
        let monitor = Monitor::new(machine, self.channels.clone(), self.hints, &settings)?;
        let mut monitor = monitor.in_band_levels(band_levels);
        let mut outcomes = Vec::new();
        for block in self.blocks() {
            monitor.step(&block, &mut |outcome| outcomes.push(outcome));
        }
        monitor.finish(&mut |outcome| outcomes.push(outcome));
        Ok((monitor, outcomes))
    }

    /// The record as a recorder gives it, turn by turn: a window must not be judged before every channel has it.
    fn blocks(&self) -> impl Iterator<Item = Block> {
        let turns = (0_u32..).map(|turn| f64::from(turn) * TURN_S);
        let longest_s = self.duration_s();
        turns.take_while(move |begin_s| *begin_s < longest_s).flat_map(move |begin_s| {
            let channels = self.channels.iter().zip(&self.samples).enumerate();
            channels.filter_map(move |(index, (info, samples))| {
                let place = |time_s: f64| {
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a place in a record of seconds"
                    )]
                    let place = (time_s * info.sample_rate.0).round() as usize;
                    place.min(samples.len())
                };
                let (from, to) = (place(begin_s), place(begin_s + TURN_S));
                (from < to).then(|| Block {
                    channel: ChannelIndex(index),
                    start: SampleIndex(from as u64),
                    segment: 0,
                    time_s: from as f64 / info.sample_rate.0,
                    samples: samples[from..to].to_vec(),
                })
            })
        })
    }
}

/// A channel of physical values, as a trial's sensors give them.
fn channel(name: &str, unit: Unit, sample_rate: Hz) -> ChannelInfo {
    ChannelInfo {
        name: name.to_owned(),
        sample_rate,
        unit,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    }
}
