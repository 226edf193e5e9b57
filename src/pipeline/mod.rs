//! The whole flow on one screen: block → ring → window → features → diagnosis → alarm events.
//!
//! One [`Monitor`] a machine, used alike by the daemon's shards and by offline `diagnose`. Pure:
//! time is stream time, samples come in as arguments.

mod copied;
mod renewal;
mod settings;
mod trail;
pub mod windows;

use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::limit::Measured;
use crate::buffer::Ring;
use crate::buffer::RingStatus;
use crate::diagnosis::Context;
use crate::diagnosis::baseline;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Offered;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::drift;
use crate::diagnosis::summary;
use crate::diagnosis::summary::Judged;
use crate::diagnosis::summary::SetAsideCount;
use crate::diagnosis::verdict::BaselineUse;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::features::Extractor;
use crate::features::Window;
pub use crate::features::plans::Plans;
use crate::features::run_up::RunUp;
pub use crate::features::speed::SpeedHints;
use crate::machine::Machine;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::units::Hz;
use copied::Copied;
pub use renewal::Renewal;
pub use settings::Settings;
use settings::fitting;
use std::sync::Arc;
use trail::Trail;
pub use trail::{Carried, Passed, Run};
use windows::WindowGrid;

/// What one completed window yields.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Window start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Named numbers by channel.
    pub features: Vec<ChannelFeatures>,
    /// Channels of which the window holds too little.
    pub absent: Vec<ChannelIndex>,
    /// The verdict on this window.
    pub diagnosis: Arc<Diagnosis>,
    /// The window's part of a verdict over several windows ([`summary::conclude`]).
    pub judged: Judged,
    /// What changed for the operator.
    pub alarm_events: Vec<AlarmEvent>,
}

impl Outcome {
    /// The window as a baseline takes it.
    #[must_use]
    pub fn offered(&self) -> Offered<'_> {
        let (point, unfit) = (self.judged.point(), self.judged.unfit_for_baseline());
        Offered { point, unfit, features: &self.features }
    }
}

/// Why a monitor cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// None of the machine's sensors has a channel in the stream.
    #[error(
        "none of the machine's sensors ({sensors}) has a channel in the data ({channels}): name the channels alike"
    )]
    NoCommonChannel {
        /// Channels the machine file names.
        sensors: String,
        /// Channels of the data.
        channels: String,
    },
}

/// Why samples in a window were not used.
const SET_ASIDE: &str = "set aside with single samples far off, which are no motion";

/// The monitor of one machine.
#[derive(Debug)]
pub struct Monitor {
    machine: Arc<Machine>,
    channels: Vec<ChannelInfo>,
    settings: Settings,
    rings: Vec<Ring>,
    grid: WindowGrid,
    segment: Option<u32>,
    extractor: Extractor,
    run_up: RunUp,
    baseline: Arc<Baseline>,
    drift: drift::Watch,
    trail: Trail,
    /// Contiguous runs that have ended.
    n_runs: u64,
    provisional: Vec<(Option<Hz>, Vec<ChannelFeatures>)>,
    rejected: Vec<(String, u64)>,
    set_aside: SetAsideCount,
    alarms: AlarmEngine,
}

impl Monitor {
    /// Builds a monitor for a stream of `channels`.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel in the stream.
    pub fn new(
        machine: Arc<Machine>,
        channels: Vec<ChannelInfo>,
        hints: SpeedHints,
        settings: &Settings,
    ) -> Result<Self, MonitorError> {
        let extractor = Extractor::new(Arc::clone(&machine), channels.clone(), hints);
        if extractor.channel_of_sensor().iter().all(Option::is_none) {
            let list = |names: Vec<&str>| {
                if names.is_empty() { "none".to_owned() } else { names.join(", ") }
            };
            return Err(MonitorError::NoCommonChannel {
                sensors: list(machine.sensors.iter().map(|s| s.channel.as_str()).collect()),
                channels: list(channels.iter().map(|c| c.name.as_str()).collect()),
            });
        }
        let settings = fitting(&channels, settings);
        let baseline = settings.baseline.in_units_of(&channels);
        let ring = |c: &ChannelInfo| {
            Ring::new(c.sample_rate, settings.ring_s).with_full_scale(c.full_scale)
        };
        Ok(Self {
            rings: channels.iter().map(ring).collect(),
            grid: WindowGrid::new(settings.window_s, settings.hop_s),
            segment: None,
            extractor,
            run_up: RunUp::default(),
            baseline: Arc::new(baseline),
            drift: drift::Watch::default(),
            trail: Trail::default(),
            n_runs: 0,
            provisional: Vec::new(),
            rejected: Vec::new(),
            set_aside: SetAsideCount::default(),
            alarms: AlarmEngine::of_machine(&machine, &channels, settings.alarms.clone()),
            settings,
            machine,
            channels,
        })
    }

    /// The same, which demodulates in the first so many levels of bands: costs less and finds less. For benches
    /// of just that.
    #[must_use]
    pub fn in_band_levels(self, levels: usize) -> Self {
        Self { extractor: self.extractor.in_levels(levels), ..self }
    }

    /// Gives the bytes the rings of a stream of `channels` need.
    #[must_use]
    pub fn ring_bytes(channels: &[ChannelInfo], settings: &Settings) -> usize {
        let seconds = fitting(channels, settings).ring_s;
        channels.iter().map(|c| Ring::bytes(c.sample_rate, seconds)).sum()
    }

    /// Takes one block in and calls `emit` for every window it completes.
    ///
    /// A block of a channel that no sensor names is kept to be looked at; windows neither wait for it nor begin or end by it.
    pub fn step(&mut self, block: &Block, emit: &mut dyn FnMut(Outcome)) {
        if !self.extractor.channel_of_sensor().contains(&Some(block.channel)) {
            self.rings[block.channel.0].push(block);
            return;
        }
        let (_, fastest) = self.reached();
        let other_segment = self.segment.is_some_and(|segment| segment != block.segment);
        // A hole longer than a window ends the run: no windows are laid over nothing.
        if other_segment || block.time_s > fastest + self.settings.window_s {
            self.finish(emit);
        }
        self.segment = Some(block.segment);
        self.rings[block.channel.0].push(block);
        self.grid.begin(block.time_s);
        let (slowest, fastest) = self.reached();
        // A channel that fell behind by more than a hop is not waited for.
        let reached = slowest.max(fastest - self.settings.hop_s);
        while let Some(span) = self.grid.next_due(reached) {
            let outcome = self.judge(span);
            emit(outcome);
        }
    }

    /// Ends the run (segment or stream): judges what is left if it is long enough.
    pub fn finish(&mut self, emit: &mut dyn FnMut(Outcome)) {
        let (_, fastest) = self.reached();
        if let Some(span) = self.grid.finish(fastest) {
            let outcome = self.judge(span);
            emit(outcome);
        }
        self.segment = None;
        self.n_runs += 1;
        self.run_up.clear();
    }

    /// Adds samples that the source received but could not hand on, with the reason.
    pub fn count_rejected(&mut self, n_samples: u64, reason: &str) {
        match self.rejected.iter_mut().find(|(known, _)| known == reason) {
            Some((_, n)) => *n += n_samples,
            None => self.rejected.push((reason.to_owned(), n_samples)),
        }
    }

    /// The machine.
    #[must_use]
    pub fn machine(&self) -> &Arc<Machine> {
        &self.machine
    }

    /// Channels of the stream.
    #[must_use]
    pub fn channels(&self) -> &[ChannelInfo] {
        &self.channels
    }

    /// Uses these records of signed baselines from now on, instead of those before; captures that were only
    /// named stay. What a stream's own beginning gave gives way.
    pub fn use_signed(&mut self, records: Vec<Record>) {
        let named = self.baseline.records.iter().filter(|record| record.baseline.is_none());
        let is_kept = records.is_empty() || !self.baseline.provisional;
        let named = named.filter(|_| is_kept).cloned();
        let provisional = is_kept && self.baseline.provisional;
        let records: Vec<Record> = named.chain(records).collect();
        if records != self.baseline.records {
            self.baseline = Arc::new(Baseline { records, provisional });
            // What was judged against another baseline cannot be judged again with this one.
            self.trail.clear();
        }
    }

    /// The plans kept from window to window: monitors of one thread may exchange them, so that each needs none of
    /// its own.
    pub fn plans_mut(&mut self) -> &mut Plans {
        self.extractor.plans_mut()
    }

    /// The ring of a channel: raw samples, gaps, counts.
    #[must_use]
    pub fn ring(&self, channel: ChannelIndex) -> &Ring {
        &self.rings[channel.0]
    }

    /// State of every ring.
    #[must_use]
    pub fn ring_status(&self) -> Vec<RingStatus> {
        self.rings.iter().map(Ring::status).collect()
    }

    /// The alarms, for reading and operator actions.
    pub fn alarms_mut(&mut self) -> &mut AlarmEngine {
        &mut self.alarms
    }

    /// The alarms.
    #[must_use]
    pub fn alarms(&self) -> &AlarmEngine {
        &self.alarms
    }

    /// Makes the document of several windows of this stream: [`summary::conclude`] and what only
    /// the stream knows. `None` when no window was judged.
    #[must_use]
    pub fn conclude(&self, windows: &[Judged]) -> Option<Diagnosis> {
        let mut diagnosis = summary::conclude(&self.machine.id, windows)?;
        self.add_stream_facts(&mut diagnosis);
        Some(diagnosis)
    }

    /// Earliest and latest stream time reached by the channels in use, in the current segment.
    fn reached(&self) -> (f64, f64) {
        let used = self.extractor.channel_of_sensor().iter().flatten();
        let times = used.map(|channel| {
            let ring = &self.rings[channel.0];
            let status = ring.status();
            let last = status.newest.0.checked_sub(1).map(SampleIndex);
            let current = last.and_then(|i| ring.segment_of(i)) == self.segment && last.is_some();
            if current { status.newest_time_s } else { f64::NEG_INFINITY }
        });
        times.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)))
    }

    /// Copies a window out of the rings, measures and judges it.
    fn judge(&mut self, time_s: (f64, f64)) -> Outcome {
        self.make_provisional();
        let copies: Vec<Option<Copied>> = (self.rings.iter().zip(&self.channels))
            .map(|(ring, info)| Copied::of(ring, info.sample_rate, self.segment, time_s))
            .collect();
        let channels = copies.iter().map(|c| c.as_ref().map(Copied::window)).collect();
        let window = Window { time_s, channels };
        let before = self.trail.is_kept().then(|| self.carried());
        let outcome = self.judge_window(&window);
        if let Some(before) = before {
            let raised = self.alarms.raised();
            let origin_s = self.grid.origin_s();
            let place = (self.segment.unwrap_or(0), self.n_runs, origin_s);
            let passed = Passed::new(&window, place, before, &outcome, raised);
            self.trail.push(passed);
        }
        outcome
    }

    /// Measures and judges a window, and lets what follows know of it.
    fn judge_window(&mut self, window: &Window<'_>) -> Outcome {
        let time_s = window.time_s;
        let mut features = self.extractor.extract(window);
        self.run_up.follow(&self.machine, &mut features);
        features.load = features.load.or(self.settings.load);
        let point = OperatingPoint { speed: features.speed.first, load: features.load };
        let (baseline, uses) = self.baseline.at(&point, &self.machine.limits.load_bins);
        let has_run = !features.laws.is_empty();
        let void = if baseline.records.is_empty() { self.baseline.why_void() } else { None };
        let runs = if has_run { self.baseline.of_runs() } else { Baseline::default() };
        let context = Context {
            machine: &self.machine,
            channels: &self.channels,
            channel_of_sensor: self.extractor.channel_of_sensor(),
            baseline: &baseline,
            runs: &runs,
            offered_baselines: uses.len(),
            void_baselines: void.as_deref(),
            false_alarm_probability: self.settings.false_alarms.per_decision,
        };
        let judged = summary::judge_window(&features, self.segment.unwrap_or(0), &context, uses);
        self.count_set_aside(&judged);
        let is_fit = judged.unfit_for_baseline().is_none();
        let window = drift::Window { time_s, features: &features.channels, is_fit };
        self.drift.observe(&window, &baseline, &self.channels);
        let mut diagnosis = summary::of_window(&self.machine.id, &judged);
        self.add_stream_facts(&mut diagnosis);
        let measured = Measured {
            operating: diagnosis.operating_state,
            speed: features.speed.first,
            channels: &features.channels,
            baseline: &baseline,
        };
        let sensors = features.sensors.iter();
        let absent: Vec<_> = sensors.filter(|s| s.absent.is_some()).map(|s| s.channel).collect();
        let alarm_events =
            self.alarms.observe_window(&diagnosis, time_s.1, Some(&measured), &absent);
        let mut shown = features.channels.clone();
        for channel in &mut shown {
            let name = &self.channels[channel.channel.0].name;
            channel.values.extend(baseline.cwt_ratios(name, channel));
        }
        let outcome = Outcome {
            time_s,
            features: shown,
            absent,
            diagnosis: Arc::new(diagnosis),
            judged,
            alarm_events,
        };
        self.learn_provisional((features.speed.first, features.channels));
        outcome
    }

    /// Collects the windows of the first segments; a provisional baseline is made of them when the
    /// next segment is judged.
    fn learn_provisional(&mut self, features: (Option<Hz>, Vec<ChannelFeatures>)) {
        let first = self.settings.provisional_segments.filter(|_| self.baseline.records.is_empty());
        if first.is_some_and(|n| self.segment.is_some_and(|segment| segment < n)) {
            self.provisional.push(features);
        }
    }

    fn make_provisional(&mut self) {
        let Some(n) = self.settings.provisional_segments else { return };
        let ready = self.segment.is_some_and(|s| s >= n) && !self.provisional.is_empty();
        if !ready || !self.baseline.records.is_empty() {
            return;
        }
        let record =
            |w| Record::of_windows("first segments", std::slice::from_ref(w), &self.channels);
        let records = self.provisional.iter().map(record).collect();
        self.baseline = Arc::new(Baseline { records, provisional: true });
        self.trail.clear();
        self.provisional.clear();
    }

    /// A verdict with the counts of now: samples may be rejected after its window was judged.
    #[must_use]
    pub fn recounted(&self, diagnosis: &Diagnosis) -> Diagnosis {
        let mut now = diagnosis.clone();
        self.count(&mut now);
        now
    }

    fn count(&self, diagnosis: &mut Diagnosis) {
        diagnosis.samples_rejected = self.rejected.iter().map(|(_, n)| n).sum();
        diagnosis.rejected_because =
            self.rejected.iter().map(|(why, n)| format!("{n} samples: {why}")).collect();
    }

    /// Counts what the window sets aside beyond what those before it have.
    fn count_set_aside(&mut self, judged: &Judged) {
        let n = self.set_aside.count_new(judged);
        if n > 0 {
            self.count_rejected(n, SET_ASIDE);
        }
    }

    /// Adds counts, unit conflicts and absent channels.
    fn add_stream_facts(&self, diagnosis: &mut Diagnosis) {
        self.count(diagnosis);
        diagnosis.notes.extend(self.settings.false_alarms.note());
        let sensors = self.machine.sensors.iter().zip(self.extractor.channel_of_sensor());
        for (sensor, channel) in sensors {
            match channel {
                None => diagnosis
                    .warnings
                    .push(format!("sensor `{}` has no channel in the data", sensor.channel)),
                Some(channel) => {
                    diagnosis.warnings.extend(self.channels[channel.0].unit_conflict_text());
                }
            }
        }
        // Records of which nothing is left: those of another speed or load are no surprise.
        let is_void = |one: &&BaselineUse| !one.used && one.n_windows == 0;
        let told = |one: &BaselineUse| format!("baseline {} is not used: {}", one.name, one.reason);
        let void: Vec<String> = diagnosis.baselines.iter().filter(is_void).map(told).collect();
        diagnosis.warnings.extend(void);
        let drifts = self.drift.drifts(&self.channels);
        diagnosis.warnings.extend(drifts.iter().map(drift::Drift::text));
        let n_used = diagnosis.baselines.iter().filter(|b| b.used).count();
        diagnosis
            .notes
            .extend(baseline::scatter_note(n_used).filter(|_| !self.baseline.provisional));
        if self.baseline.provisional {
            let n = self.baseline.records.len();
            diagnosis.provisional_baseline = Some(format!("the first {n} windows of this record"));
            diagnosis.baselines.clear();
        }
    }
}

#[cfg(test)]
mod tests;
