//! Silences in advance on a machine's shard: said, ended, stored, answered.

use super::alarming::Alarming;
use super::monitored::Monitored;
use super::monitored::engine;
use crate::alarms::Advance;
use crate::alarms::AdvanceError;
use crate::alarms::AlarmEvent;
use crate::alarms::Announcement;
use crate::alarms::Signature;
use crate::api::view::AdvanceFailure;
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
        let comment = format!("{}: {}", wanted.subject.words(), wanted.comment.trim());
        let by = Signature { author: wanted.author.trim().to_owned(), comment };
        let act = ("silence_announced", by);
        self.alarming.keep_advance(engine, done, act, stream_s, reply);
    }

    /// Ends one.
    pub(super) fn revoke(&mut self, number: u64, by: (String, String), reply: Reply) {
        let stream_s = self.stream_time_s();
        let now = self.alarming.moment(stream_s);
        let engine = engine(&mut self.monitor, &mut self.idle_alarms);
        let done = engine.revoke(number, (&by.0, &by.1), now);
        let words = done.as_ref().map_or(String::new(), |(ended, _)| ended.subject.words());
        let comment = format!("{words}: {}", by.1.trim());
        let act = ("silence_ended", Signature { author: by.0.trim().to_owned(), comment });
        self.alarming.keep_advance(engine, done, act, stream_s, reply);
    }
}

impl Alarming {
    fn keep_advance(
        &mut self,
        engine: &crate::alarms::AlarmEngine,
        done: Result<(Advance, Vec<AlarmEvent>), AdvanceError>,
        (act, by): (&'static str, Signature),
        stream_s: f64,
        reply: Reply,
    ) {
        let (advance, events) = match done {
            Ok(done) => done,
            // Who asked may have gone: then the answer is dropped, here and below.
            Err(error) => return drop(reply.send(Err(error.into()))),
        };
        self.note(&events);
        self.keeper.note_advance(act, by);
        let answer = move |stored: Result<(), String>| {
            let answer = stored.map(|()| advance).map_err(AdvanceFailure::NotStored);
            drop(reply.send(answer));
        };
        let happened = (events, Vec::new());
        self.keeper.keep(engine, happened, stream_s, Some(Box::new(answer)));
    }
}
