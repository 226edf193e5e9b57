//! Silences in advance on a machine's shard: said, ended, stored, answered.

use super::alarming::Alarming;
use super::monitored::Monitored;
use super::monitored::engine;
use crate::alarms::Advance;
use crate::alarms::AdvanceError;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::Announcement;
use crate::alarms::Signature;
use crate::api::view::AdvanceFailure;
use crate::store::events::MaintenanceChange;
use crate::store::events::MaintenanceOutcome;
use tokio::sync::oneshot;

/// Who is answered when an act is stored, or why it is not.
type Reply = oneshot::Sender<Result<Advance, AdvanceFailure>>;

impl Monitored {
    /// Says a silence in advance.
    pub(super) fn announce(&mut self, wanted: &Announcement, reply: Reply) {
        let stream_s = self.stream_time_s();
        let now = self.alarming.moment(stream_s);
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        let done = engine.announce(wanted, now);
        if let Ok((said, _)) = &done {
            self.alarming.note_said(MaintenanceOutcome::Began, said, said.by.clone());
        }
        self.alarming.keep_advance(engine, done, stream_s, reply);
    }

    /// Ends one.
    pub(super) fn revoke(&mut self, number: u64, by: (String, String), reply: Reply) {
        let stream_s = self.stream_time_s();
        let now = self.alarming.moment(stream_s);
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        let done = engine.revoke(number, (&by.0, &by.1), now);
        if let Ok((ended, _)) = &done {
            let [author, comment] = [&by.0, &by.1].map(|text| text.trim().to_owned());
            let by = Signature { author, comment };
            self.alarming.note_said(MaintenanceOutcome::Ended, ended, by);
        }
        self.alarming.keep_advance(engine, done, stream_s, reply);
    }
}

impl Alarming {
    /// Notes for the audit, and of a maintenance for the log of events, that `one` was said or ended.
    fn note_said(&mut self, outcome: MaintenanceOutcome, one: &Advance, by: Signature) {
        if one.is_maintenance() {
            self.keeper.note_advance(outcome.name(), by.clone());
            return self.note_maintenance(outcome, one, by);
        }
        let act = match outcome {
            MaintenanceOutcome::Began => "silence_announced",
            MaintenanceOutcome::Ended | MaintenanceOutcome::Over => "silence_ended",
        };
        let comment = format!("{}: {}", one.subject.words(), by.comment);
        self.keeper.note_advance(act, Signature { comment, ..by });
    }

    fn note_maintenance(&mut self, outcome: MaintenanceOutcome, one: &Advance, by: Signature) {
        let Signature { author, comment: reason } = by;
        tracing::warn!(
            machine = self.machine(),
            what = outcome.name(),
            author,
            reason,
            "maintenance"
        );
        let until = one.until.map(|until| until.utc);
        self.keeper.note_maintenance(MaintenanceChange { outcome, author, reason, until });
    }

    /// Notes the maintenances whose time is over.
    pub(super) fn note_ended_maintenances(&mut self, engine: &mut AlarmEngine) {
        for one in engine.take_ended_maintenances() {
            self.note_maintenance(MaintenanceOutcome::Over, &one, one.by.clone());
        }
    }

    fn keep_advance(
        &mut self,
        engine: &AlarmEngine,
        done: Result<(Advance, Vec<AlarmEvent>), AdvanceError>,
        stream_s: f64,
        reply: Reply,
    ) {
        let (advance, events) = match done {
            Ok(done) => done,
            // Who asked may have gone: then the answer is dropped, here and below.
            Err(error) => return drop(reply.send(Err(error.into()))),
        };
        self.note(&events);
        let answer = move |stored: Result<(), String>| {
            let answer = stored.map(|()| advance).map_err(AdvanceFailure::NotStored);
            drop(reply.send(answer));
        };
        let happened = (events, Vec::new());
        self.keeper.keep(engine, happened, stream_s, Some(Box::new(answer)));
    }
}
