//! One machine on its shard: its monitor, what became of it, and the snapshot shown to HTTP.

mod shown;
mod switching;

use super::alarming::Alarming;
use super::capturing::Asked;
use super::capturing::Capturing;
use super::capturing::Seen as SeenNow;
use super::keeper::MachineKeeper;
use super::learning::Seen;
use super::link::Input;
use super::link::Traffic;
use super::live::opening::Opener;
use super::metering::Meters;
use super::trend::TrendStore;
use super::trend::VerdictStore;
use super::trending::Trending;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::api::view::MachineView;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::buffer::RingStatus;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::machine::Machine;
use crate::notify::HealthChange;
use crate::notify::HealthWatch;
use crate::pipeline::Monitor;
use crate::pipeline::Outcome;
use crate::pipeline::Plans;
use crate::signal::Block;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::telemetry::Metrics;
use std::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::watch;

/// What who asks for a capture is told where none are made.
const NO_CAPTURES: &str =
    "no captures are made: captures.enabled is false, or the source cannot be opened";

/// Why a machine is given up whose analysis panicked.
const PANICKED: &str = "internal error in the analysis, see the log";

/// What is known of a machine before its first block.
#[derive(Debug)]
pub struct Opened {
    /// Hash of the configuration.
    pub configuration: Arc<str>,
    /// The monitor; `None` when the source cannot be opened.
    pub monitor: Option<Monitor>,
    /// How the source is doing.
    pub source: SourceState,
    /// UTC of stream time 0.
    pub start_time: Option<Timestamp>,
    /// Whether the source delivers as time passes, so that its silence is a fault.
    pub is_live: bool,
    /// The alarms of a machine without a monitor.
    pub alarms: AlarmEngine,
    /// What the start itself did to alarms.
    pub alarm_events: Vec<AlarmEvent>,
    /// The health that was told last.
    pub health: HealthWatch,
    /// Way to the store.
    pub keeper: MachineKeeper,
    /// Way of trends to the store; `None`: they are not stored.
    pub trending: Option<Trending>,
    /// Opens the streams of live senders; `None`: the stream is known from the start.
    pub opener: Option<Opener>,
}

/// The machine.
#[derive(Debug)]
pub struct Monitored {
    pub(super) machine: Arc<Machine>,
    /// Hash of the configuration that holds.
    pub(super) configuration: Arc<str>,
    /// That by which the newest verdict was judged.
    judged_by: Arc<str>,
    pub(super) monitor: Option<Monitor>,
    /// The alarms when there is no monitor.
    pub(super) idle_alarms: AlarmEngine,
    pub(super) alarming: Alarming,
    health: HealthWatch,
    /// `None`: no captures are made.
    pub(super) capturing: Option<Capturing>,
    source: SourceState,
    start_time: Option<Timestamp>,
    channels: Arc<Vec<ChannelInfo>>,
    diagnosis: Option<Arc<Diagnosis>>,
    state_since_s: Vec<f64>,
    features: Arc<Vec<ChannelFeatures>>,
    /// Stream time of the end of their window, s.
    window_end_s: Option<f64>,
    /// One a channel.
    trends: Vec<TrendStore>,
    /// What was found of components in the newest windows.
    verdicts: VerdictStore,
    /// Their way to the store.
    trending: Option<Trending>,
    /// What opens the stream of live senders.
    pub(super) opener: Option<Opener>,
    /// What its senders' clocks do wrong.
    doubts: Vec<String>,
    /// The windows behind them.
    pub(super) seen: Seen,
    traffic: Arc<Traffic>,
    /// How long the newest block waited in the queue, s.
    queue_wait_s: Option<f64>,
    publisher: watch::Sender<Arc<MachineView>>,
    meters: Meters,
}

impl Monitored {
    /// Makes the machine and the receiver of its snapshots.
    #[must_use]
    pub fn new(
        machine: Arc<Machine>,
        mut opened: Opened,
        capturing: Option<Capturing>,
        (traffic, metrics): (Arc<Traffic>, &Metrics),
    ) -> (Self, watch::Receiver<Arc<MachineView>>) {
        if let (Some(capturing), Some(monitor)) = (&capturing, &mut opened.monitor) {
            capturing.prepare(monitor);
        }
        let channels = opened.monitor.as_ref().map_or(Vec::new(), |m| m.channels().to_vec());
        let meters = Meters::new(metrics, &machine.id, &channels);
        let empty = shown::empty(&machine, &opened.configuration);
        let (publisher, view) = watch::channel(Arc::new(empty));
        let transitions = meters.machine.alarm_transitions.clone();
        let load = metrics.alarm_load(&machine.id);
        let alarming = Alarming::new(&machine.id, opened.keeper, opened.is_live, transitions, load);
        let mut monitored = Self {
            machine,
            judged_by: Arc::clone(&opened.configuration),
            configuration: opened.configuration,
            monitor: opened.monitor,
            idle_alarms: opened.alarms,
            alarming,
            health: opened.health,
            capturing,
            source: opened.source,
            start_time: opened.start_time,
            trends: vec![TrendStore::default(); channels.len()],
            verdicts: VerdictStore::default(),
            trending: opened.trending,
            opener: opened.opener,
            doubts: Vec::new(),
            seen: Seen::default(),
            channels: Arc::new(channels),
            diagnosis: None,
            state_since_s: Vec::new(),
            features: Arc::default(),
            window_end_s: None,
            traffic,
            queue_wait_s: None,
            publisher,
            meters,
        };
        monitored.keep(opened.alarm_events, Vec::new());
        monitored.publish(0);
        (monitored, view)
    }

    /// An input of this machine was taken out of the queue.
    pub fn note_taken(&self) {
        self.traffic.note_taken();
    }

    /// Takes an input in; publishes when a window was judged or the source's state changed.
    pub fn take(&mut self, input: Input, queue_bytes: usize) {
        match input {
            Input::Block(block, arrived) => self.take_block(&block, arrived, queue_bytes),
            Input::Received(run) => {
                if let Some(capturing) = &mut self.capturing {
                    capturing.receive(&run);
                }
            }
            Input::Rejected { n_samples, reason } => {
                self.meters.machine.rejected.inc_by(n_samples);
                tracing::warn!(machine = self.machine.id, n_samples, reason, "samples rejected");
                if let Some(monitor) = &mut self.monitor {
                    monitor.count_rejected(n_samples, &reason);
                }
            }
            Input::Open(info) => self.open(&info, queue_bytes),
            Input::Renew(renewed) => self.renew(&renewed, queue_bytes),
            Input::Doubts(doubts) => {
                for doubt in &doubts {
                    tracing::warn!(machine = self.machine.id, doubt, "a clock runs wrong");
                }
                self.doubts = doubts;
            }
            Input::Source(state) => {
                self.note_source(state);
                if self.source == SourceState::Finished {
                    let outcomes = self.guarded(|monitor, emit| monitor.finish(emit));
                    self.take_outcomes(outcomes, None, queue_bytes);
                    self.trending.iter_mut().for_each(Trending::close);
                    let judged = self.monitor.as_ref().zip(self.diagnosis.as_deref());
                    let recounted = judged.map(|(m, d)| Arc::new(m.recounted(d)));
                    self.diagnosis = recounted.or(self.diagnosis.take());
                }
                if matches!(self.source, SourceState::Finished | SourceState::Failed(_))
                    && let Some(capturing) = &mut self.capturing
                {
                    capturing.end_all();
                }
                self.publish(queue_bytes);
            }
        }
    }

    /// Exchanges the kept plans: those of the shard go where the work is, so that machines need none of their own.
    pub fn exchange_plans(&mut self, plans: &mut Plans) {
        if let Some(monitor) = &mut self.monitor {
            std::mem::swap(monitor.plans_mut(), plans);
        }
    }

    /// Answers a question. Who asked may have gone: then the answer is dropped.
    pub fn answer(&mut self, request: ShardRequest, queue_bytes: usize) {
        match request {
            ShardRequest::Waveform { channel, end, max_samples, reply } => {
                drop(reply.send(self.waveform(channel, end, max_samples)));
            }
            ShardRequest::Trend { channel, reply } => {
                drop(
                    reply.send(self.trends.get(channel).map(TrendStore::copy).unwrap_or_default()),
                );
            }
            ShardRequest::Verdicts { kind, component, reply } => {
                drop(reply.send(self.verdicts.of(kind, &component)));
            }
            ShardRequest::Act { act, reply } => {
                let stream_s = self.stream_time_s();
                let engine = engine(&mut self.monitor, &mut self.idle_alarms);
                let (view, publisher) = (self.publisher.borrow().clone(), &self.publisher);
                let publish = |engine: &AlarmEngine| {
                    let alarms = Arc::new(engine.standing());
                    let changed = MachineView { alarms, ..MachineView::clone(&view) };
                    publisher.send_replace(Arc::new(changed));
                };
                self.alarming.act(engine, &act, stream_s, publish, reply);
                self.publish(queue_bytes);
            }
            ShardRequest::Announce { wanted, reply } => {
                self.announce(&wanted, reply);
                self.publish(queue_bytes);
            }
            ShardRequest::Revoke { number, by, reply } => {
                self.revoke(number, by, reply);
                self.publish(queue_bytes);
            }
            ShardRequest::Capture { author, comment, before_s, after_s, reply } => {
                self.ask_for_capture(Asked { author, comment, before_s, after_s, reply });
            }
            ShardRequest::Measure { span, reply } => {
                let (machine, channels) = (&self.machine, &self.channels);
                drop(reply.send(self.seen.measure(span, machine, channels, &self.trends)));
            }
            ShardRequest::UseBaselines { records, reply } => {
                if let Some(monitor) = &mut self.monitor {
                    monitor.use_signed(records);
                }
                let _asker_is_gone = reply.send(());
            }
            ShardRequest::AlarmHistory { reply } => {
                let engine = engine(&mut self.monitor, &mut self.idle_alarms);
                drop(reply.send(self.alarming.history(engine)));
            }
        }
    }

    fn ask_for_capture(&mut self, asked: Asked) {
        let (time_s, diagnosis) = (self.stream_time_s(), self.diagnosis.as_deref());
        let is_silent = self.alarming.is_silent();
        let seen = SeenNow { monitor: self.monitor.as_ref(), diagnosis };
        // Who asked may have gone: then the answer is dropped.
        let Some(capturing) = &mut self.capturing else {
            return drop(asked.reply.send(Err(NO_CAPTURES.to_owned())));
        };
        capturing.ask(asked, time_s, seen);
        if self.source == SourceState::Finished {
            capturing.end_all();
        } else if is_silent {
            capturing.end_for_silence();
        }
    }

    /// Stream time up to which alarms know the stream, s.
    #[cfg(test)]
    pub(in crate::app) fn judged_until_s(&self) -> Option<f64> {
        self.alarms().judged_until_s()
    }

    /// Takes a verdict in as if a window had been judged so.
    #[cfg(test)]
    pub(in crate::app) fn take_verdict(&mut self, diagnosis: Diagnosis, time_s: f64) {
        let health = self.health.observe(&diagnosis, time_s);
        self.diagnosis = Some(Arc::new(diagnosis));
        self.keep(Vec::new(), health);
    }

    /// Takes in that time has passed and publishes a snapshot.
    pub fn tick(&mut self, queue_bytes: usize) {
        let stream_s = self.stream_time_s();
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        let was_silent = engine.no_data().is_some();
        let events = self.alarming.tick(engine, &self.source, self.traffic.waits(), stream_s);
        let why = engine.no_data().map(|alarm| alarm.why.clone());
        self.capture(&events, stream_s);
        if let Some(capturing) = &mut self.capturing {
            capturing.tick();
            if self.alarming.is_silent() {
                capturing.end_for_silence();
            }
        }
        self.tell_health_of_now(was_silent, why.as_deref(), stream_s);
        self.trending.iter_mut().for_each(Trending::tick);
        self.publish(queue_bytes);
    }

    /// Tells what data that stay away, for the reason `why`, or that come again say of health: what HTTP says of now.
    fn tell_health_of_now(&mut self, was_silent: bool, why: Option<&str>, stream_s: f64) {
        let health = match (was_silent, why) {
            (false, Some(why)) => self.health.lose(stream_s, why),
            (true, None) => self
                .diagnosis
                .as_deref()
                .map_or(Vec::new(), |diagnosis| self.health.regain(diagnosis, stream_s)),
            (true, Some(_)) | (false, None) => return,
        };
        self.keep(Vec::new(), health);
    }

    /// The program ends: keeps what the alarms rest on.
    pub fn end(&mut self) {
        let stream_s = self.stream_time_s();
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        self.alarming.end(engine, stream_s);
    }

    /// The alarms, with or without a monitor.
    fn alarms(&self) -> &AlarmEngine {
        self.monitor.as_ref().map_or(&self.idle_alarms, Monitor::alarms)
    }

    pub(super) fn keep(&mut self, events: Vec<AlarmEvent>, health: Vec<HealthChange>) {
        let stream_s = self.stream_time_s();
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        self.alarming.keep(engine, events, health, stream_s);
    }

    /// Has the raw data behind alarms captured.
    fn capture(&mut self, events: &[AlarmEvent], time_s: f64) {
        if let Some(capturing) = &mut self.capturing {
            let diagnosis = self.diagnosis.as_deref();
            let seen = SeenNow { monitor: self.monitor.as_ref(), diagnosis };
            capturing.note(events, time_s, seen);
        }
    }

    fn take_block(&mut self, block: &Block, arrived: Instant, queue_bytes: usize) {
        self.alarming.note_block(arrived);
        let waited = super::now().saturating_duration_since(arrived);
        self.queue_wait_s = Some(waited.as_secs_f64());
        let is_back = self.opener.is_some() && self.source == SourceState::Finished;
        if self.source == SourceState::Starting || is_back {
            self.note_source(SourceState::Running);
            self.publish(queue_bytes);
        }
        let outcomes = self.guarded(|monitor, emit| monitor.step(block, emit));
        self.take_outcomes(outcomes, Some(arrived), queue_bytes);
        if let Some(capturing) = &mut self.capturing {
            capturing.end_those_complete();
        }
    }

    /// Lets the monitor work. Should it panic, this machine alone is given up: the shard and its
    /// other machines go on.
    fn guarded(
        &mut self,
        work: impl FnOnce(&mut Monitor, &mut dyn FnMut(Outcome)),
    ) -> Vec<Outcome> {
        let mut outcomes = Vec::new();
        let Some(monitor) = &mut self.monitor else { return outcomes };
        let done = catch_unwind(AssertUnwindSafe(|| {
            work(monitor, &mut |outcome| outcomes.push(outcome));
        }));
        if done.is_err() {
            self.give_up_monitor();
            self.note_source(SourceState::Failed(PANICKED.to_owned()));
        }
        outcomes
    }

    fn take_outcomes(
        &mut self,
        outcomes: Vec<Outcome>,
        arrived: Option<Instant>,
        queue_bytes: usize,
    ) {
        for outcome in outcomes {
            let end_s = outcome.time_s.1;
            self.state_since_s = shown::since(
                self.diagnosis.as_deref(),
                &self.state_since_s,
                &outcome.diagnosis,
                end_s,
            );
            self.seen.push(&outcome);
            self.verdicts.push(end_s, &outcome.diagnosis.components);
            self.trending.iter_mut().for_each(|trending| trending.take(&outcome));
            for features in &outcome.features {
                if let Some(trend) = self.trends.get_mut(features.channel.0) {
                    trend.push(end_s, features);
                }
            }
            let health = self.health.observe(&outcome.diagnosis, end_s);
            self.diagnosis = Some(match &self.doubts[..] {
                [] => outcome.diagnosis,
                doubts => Arc::new(outcome.diagnosis.with_doubts(doubts)),
            });
            self.judged_by = Arc::clone(&self.configuration);
            self.features = Arc::new(outcome.features);
            self.window_end_s = Some(end_s);
            self.capture(&outcome.alarm_events, end_s);
            self.keep(outcome.alarm_events, health);
            self.meters.machine.windows_judged.inc();
            self.publish(queue_bytes);
            if let Some(arrived) = arrived {
                let latency = super::now().saturating_duration_since(arrived);
                self.meters.machine.verdict_latency_s.observe(latency.as_secs_f64());
            }
        }
    }

    fn note_source(&mut self, state: SourceState) {
        let machine = &self.machine.id;
        if matches!(self.source, SourceState::Failed(_)) {
            return;
        }
        match &state {
            SourceState::Starting => {}
            SourceState::Running => tracing::info!(machine, "source is running"),
            SourceState::Finished => tracing::info!(machine, "source finished"),
            SourceState::Failed(reason) => tracing::error!(machine, reason, "source failed"),
        }
        self.source = state;
    }

    pub(super) fn stream_time_s(&self) -> f64 {
        let rings = self.monitor.as_ref().map(Monitor::ring_status).unwrap_or_default();
        self.stream_time_of(&rings)
    }

    /// Stream time when the rings stand so, s.
    fn stream_time_of(&self, rings: &[RingStatus]) -> f64 {
        let is_empty = rings.iter().all(|ring| ring.received == 0);
        match self.start_time.filter(|_| self.opener.is_some() && is_empty) {
            // Before the first sample of live senders only the clock says what time it is.
            Some(start) => (super::wall_clock().0.saturating_sub(start.0)) as f64 / 1e9,
            None => shown::newest_time_s(rings),
        }
    }
}

/// The alarms of a machine, with or without a monitor; apart from `self`, so that what uses them may be
/// borrowed beside them.
pub(super) fn engine<'m>(
    monitor: &'m mut Option<Monitor>,
    idle: &'m mut AlarmEngine,
) -> &'m mut AlarmEngine {
    match monitor {
        Some(monitor) => monitor.alarms_mut(),
        None => idle,
    }
}
