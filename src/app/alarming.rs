//! The alarms of a machine on its shard: gives their engine the clocks and what only the shell sees,
//! sends what happens to the store, counts and logs it.

use super::keeper::MachineKeeper;
use crate::alarms::Act;
use crate::alarms::Alarm;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::DataFlow;
use crate::alarms::Moment;
use crate::alarms::load;
use crate::alarms::load::Load;
use crate::alarms::state::AlarmState;
use crate::api::view::ActFailure;
use crate::api::view::AlarmHistory;
use crate::api::view::SourceState;
use crate::notify::HealthChange;
use crate::telemetry::AlarmLoadMetrics;
use prometheus_client::metrics::counter::Counter;
use std::time::Instant;
use tokio::sync::oneshot;

/// What the alarms of a machine need besides their engine.
#[derive(Debug)]
pub(super) struct Alarming {
    machine: String,
    pub(super) keeper: MachineKeeper,
    /// Whether silence of the source is a fault: a replay may wait for its next segment.
    is_live: bool,
    last_block: Instant,
    /// Whether a block has come since the start.
    has_begun: bool,
    /// Whether data were missed when time passed last, and none has come since.
    is_silent: bool,
    transitions: Counter,
    metrics: AlarmLoadMetrics,
}

impl Alarming {
    pub(super) fn new(
        machine: &str,
        keeper: MachineKeeper,
        is_live: bool,
        transitions: Counter,
        metrics: AlarmLoadMetrics,
    ) -> Self {
        let machine = machine.to_owned();
        let last_block = super::now();
        let (has_begun, is_silent) = (false, false);
        Self { machine, keeper, is_live, last_block, has_begun, is_silent, transitions, metrics }
    }

    /// This instant, at a stream time.
    pub(super) fn moment(&self, stream_s: f64) -> Moment {
        self.keeper.clock().moment(stream_s)
    }

    pub(super) fn machine(&self) -> &str {
        &self.machine
    }

    /// What follows is judged by the configuration with this hash.
    pub(super) fn renew(&mut self, configuration: &str) {
        self.keeper.renew(configuration);
    }

    /// A block has come.
    pub(super) fn note_block(&mut self, arrived: Instant) {
        self.last_block = arrived;
        self.has_begun = true;
        self.is_silent = false;
    }

    /// Seconds since the newest block came; before the first, since the start.
    pub(super) fn silent_s(&self) -> f64 {
        super::now().saturating_duration_since(self.last_block).as_secs_f64()
    }

    /// Whether data are missed at this moment: the alarm may stand while they come again and are not judged yet.
    pub(super) fn is_silent(&self) -> bool {
        self.is_silent
    }

    /// Takes in that time has passed; gives what happened.
    pub(super) fn tick(
        &mut self,
        engine: &mut AlarmEngine,
        source: &SourceState,
        is_waiting: bool,
        stream_s: f64,
    ) -> Vec<AlarmEvent> {
        let flow = match source {
            SourceState::Failed(why) => DataFlow::Failed(why),
            SourceState::Starting | SourceState::Running if self.is_live => {
                let silent = self.silent_s();
                // What waits of this machine is not judged yet; and what was silent before the start may be so still.
                let is_open = !self.has_begun && silent < engine.settings().missing_after_s;
                if is_waiting || is_open { DataFlow::Unknown } else { DataFlow::SilentFor(silent) }
            }
            SourceState::Starting | SourceState::Running | SourceState::Finished => {
                DataFlow::Flowing
            }
        };
        self.is_silent = match flow {
            DataFlow::Failed(_) => true,
            DataFlow::SilentFor(for_s) => for_s >= engine.settings().missing_after_s,
            DataFlow::Flowing | DataFlow::Unknown => false,
        };
        let now = self.keeper.clock().moment(stream_s);
        let events = engine.tick(now, flow, self.keeper.failure_to_tell().as_deref());
        self.note_ended_maintenances(engine);
        self.keep(engine, events.clone(), Vec::new(), stream_s);
        self.keeper.repair(engine, stream_s);
        events
    }

    /// Sends what happened to the store.
    pub(super) fn keep(
        &mut self,
        engine: &AlarmEngine,
        events: Vec<AlarmEvent>,
        health: Vec<HealthChange>,
        stream_s: f64,
    ) {
        if !events.is_empty() || !health.is_empty() {
            self.note(&events);
            self.keeper.keep(engine, (events, health), stream_s, None);
        }
    }

    /// Keeps what alarms rest on, because the program ends.
    pub(super) fn end(&mut self, engine: &AlarmEngine, stream_s: f64) {
        self.keeper.end(engine, stream_s);
    }

    /// Lets an operator act. Who asked is answered when the act is stored, or why it is not; `publish`
    /// runs before, so that who asked sees the act in the next snapshot.
    pub(super) fn act(
        &mut self,
        engine: &mut AlarmEngine,
        act: &Act,
        stream_s: f64,
        publish: impl FnOnce(&AlarmEngine),
        reply: oneshot::Sender<Result<Alarm, ActFailure>>,
    ) {
        let done = engine.act(act, self.keeper.clock().moment(stream_s));
        publish(engine);
        match done {
            // Who asked may have gone: then the answer is dropped, here and below.
            Err(error) => drop(reply.send(Err(error.into()))),
            Ok((alarm, events)) => {
                self.note(&events);
                let answer = move |stored: Result<(), String>| {
                    let answer = stored.map(|()| alarm).map_err(ActFailure::NotStored);
                    drop(reply.send(answer));
                };
                let happened = (events, Vec::new());
                self.keeper.keep(engine, happened, stream_s, Some(Box::new(answer)));
            }
        }
    }

    /// The newest transitions: those of the engine's history, and before them what the store does not have yet.
    pub(super) fn history(&mut self, engine: &AlarmEngine) -> AlarmHistory {
        let oldest_held = engine.history_dropped() + 1;
        let mut events = self.keeper.unstored_before(oldest_held);
        let dropped = events.first().map_or(oldest_held, |first| first.sequence) - 1;
        events.extend(engine.history().iter().cloned());
        AlarmHistory { events, dropped }
    }

    /// Counts what the standing alarms ask of an operator.
    pub(super) fn load(&self, engine: &AlarmEngine, standing: &[Alarm], stream_s: f64) -> Load {
        let load = load::of(engine.history(), standing, stream_s);
        let set = |gauge: &prometheus_client::metrics::gauge::Gauge, n: usize| {
            gauge.set(i64::try_from(n).unwrap_or(i64::MAX));
        };
        let silenced = standing.iter().filter(|alarm| alarm.silencing.is_some()).count();
        let asking =
            |alarm: &&Alarm| alarm.silencing.is_none() && alarm.state == AlarmState::Unacknowledged;
        set(&self.metrics.standing, standing.len());
        set(&self.metrics.unacknowledged, standing.iter().filter(asking).count());
        set(&self.metrics.silenced, silenced);
        set(&self.metrics.in_maintenance, usize::from(engine.maintenance().is_some()));
        set(&self.metrics.last_hour, load.last_hour);
        set(&self.metrics.last_ten_minutes, load.last_ten_minutes);
        set(&self.metrics.flood, usize::from(load.is_flood()));
        set(&self.metrics.chattering, load.chattering.len());
        set(&self.metrics.stale, load.stale.len());
        load
    }

    pub(super) fn note(&self, events: &[AlarmEvent]) {
        self.transitions.inc_by(events.len() as u64);
        for event in events {
            tracing::warn!(
                machine = self.machine,
                alarm = event.alarm.id,
                component = event.alarm.component,
                source = event.alarm.source.name(),
                level = event.alarm.level.name(),
                transition = event.kind.name(),
                author = event.by.as_ref().map(|by| by.author.as_str()),
                stream_time_s = event.time_s,
                "alarm"
            );
        }
    }
}
