//! What follows the log for one receiver: reads on, sends what is due, keeps the place.
//!
//! The time is an argument and sending a function, so that hours of a dead receiver are tested in no time.

use super::Begun;
use crate::api::handles::ReceiverView;
use crate::notify::Answer;
use crate::notify::Backoff;
use crate::notify::Courier;
use crate::notify::Filter;
use crate::notify::Next;
use crate::notify::Progress;
use crate::notify::Queue;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::events::EventLog;
use crate::store::events::Happened;
use crate::store::events::LogEntry;
use crate::store::events::Receivers;
use crate::store::writer::Status;
use crate::telemetry::ReceiverMetrics;
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::watch;

/// Entries of the log read at a time.
const PAGE: usize = 200;

/// Entries that are none of the receiver's own after which its place is kept all the same.
const KEEP_EVERY: u64 = 1000;

/// Wait after the log could not be read, s.
const RETRY_S: f64 = 1.0;

/// Wait after what is not stored could not be sent, s.
const UNSTORED_RETRY_S: f64 = 5.0;

/// When to come back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Due {
    /// When something is stored.
    Stored,
    /// At this time, s, or when something is stored.
    At(f64),
}

/// Follows the log for one receiver.
pub(super) struct Follower {
    name: String,
    filter: Filter,
    courier: Courier,
    log: Arc<dyn EventLog>,
    receivers: Arc<dyn Receivers>,
    /// What is kept in the store.
    kept: Progress,
    told: watch::Sender<ReceiverView>,
    last_delivered: Option<Timestamp>,
    metrics: ReceiverMetrics,
    store_refuses: bool,
    status: Arc<Status>,
    /// Number of the last transition that was sent without being stored.
    told_unstored: u64,
    /// When what is due was stored, UTC.
    due_since: Timestamp,
    /// Place of each event that waits, and when it was stored, UTC; those that are settled are forgotten when it is asked.
    stored: VecDeque<(u64, Timestamp)>,
}

impl Follower {
    /// Goes on where the receiver's progress ended. `limits`: events that may wait, waits between attempts.
    pub(super) fn new(begun: Begun, name: &str, filter: Filter, limits: (usize, Backoff)) -> Self {
        let Begun { log, receivers, progress, told, metrics, status } = begun;
        let courier = Courier::new(Queue::new(progress, limits.0), limits.1);
        let name = name.to_owned();
        let mut follower = Self {
            name,
            filter,
            courier,
            log,
            receivers,
            kept: progress,
            told,
            last_delivered: None,
            metrics,
            store_refuses: false,
            status,
            told_unstored: 0,
            due_since: Timestamp::default(),
            stored: VecDeque::new(),
        };
        // What waits from before the start is told from the start.
        if let Err(error) = follower.read_on() {
            tracing::error!(receiver = follower.name, %error, "the events cannot be read");
        }
        follower.tell();
        follower
    }

    /// The receiver's name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Takes in all that was stored since the last time.
    pub(super) fn read_on(&mut self) -> Result<(), StoreError> {
        let given_up = self.courier.progress().n_given_up;
        loop {
            let entries = self.log.after(self.courier.queue().seen_until(), PAGE)?;
            for entry in &entries {
                let is_wanted = match &entry.what {
                    Happened::Alarm(event) => self.filter.takes(&entry.machine, event),
                    Happened::Health(_) | Happened::Configuration(_) | Happened::Maintenance(_) => {
                        false
                    }
                };
                self.courier.see(entry.place, is_wanted);
                if is_wanted {
                    self.stored.push_back((entry.place, entry.recorded));
                }
            }
            self.waiting_since();
            if entries.len() < PAGE {
                break;
            }
        }
        let lost = self.courier.progress().n_given_up - given_up;
        if lost > 0 {
            tracing::error!(
                receiver = self.name,
                n_events = lost,
                "too many events wait, the oldest are given up"
            );
        }
        Ok(())
    }

    /// What to send at `now_s`; `Err`: when to come back.
    pub(super) fn due(&mut self, now_s: f64) -> Result<LogEntry, Due> {
        loop {
            let place = match self.courier.next(now_s) {
                Next::Idle => return Err(Due::Stored),
                Next::At(at_s) => return Err(Due::At(at_s)),
                Next::Send(place) => place,
            };
            match self.log.after(place.saturating_sub(1), 1).map(|mut found| found.pop()) {
                Ok(Some(entry)) if entry.place == place => {
                    self.due_since = entry.recorded;
                    return Ok(entry);
                }
                // Removed from the log while it waited.
                Ok(_) => self.courier.gone(),
                Err(error) => {
                    tracing::error!(receiver = self.name, %error, "the event cannot be read");
                    return Err(Due::At(now_s + RETRY_S));
                }
            }
        }
    }

    /// Takes in what came of sending what was due.
    pub(super) fn answered(
        &mut self,
        answer: &Answer,
        (now_s, utc): (f64, Timestamp),
        jitter: f64,
    ) {
        let before = (self.courier.failure().map(str::to_owned), self.courier.progress());
        self.courier.answered(answer, now_s, jitter);
        let progress = self.courier.progress();
        if progress.n_delivered > before.1.n_delivered {
            self.last_delivered = Some(utc);
            let after_ns = utc.0.saturating_sub(self.due_since.0);
            self.metrics.after_s.observe(after_ns.max(0) as f64 * 1e-9);
        }
        if let Answer::Status(status, _) = answer
            && progress.n_refused > before.1.n_refused
        {
            tracing::error!(receiver = self.name, status, "an event was refused for good");
        }
        match (before.0, self.courier.failure()) {
            (None, Some(why)) => {
                tracing::warn!(receiver = self.name, why, "cannot be told, events wait")
            }
            (Some(_), None) => tracing::info!(receiver = self.name, "is told again"),
            _ => {}
        }
    }

    /// The way to the receiver is open, though it has not taken anything yet.
    pub(super) fn connected(&mut self) {
        if self.courier.failure().is_some() {
            tracing::info!(receiver = self.name, "is connected again");
        }
        self.courier.connected();
        self.tell();
    }

    /// When to try again after a failure, s.
    pub(super) fn retry_at_s(&self) -> f64 {
        self.courier.retry_at_s()
    }

    /// Keeps the place, if it has moved, and tells how the receiver is doing.
    pub(super) fn keep(&mut self, is_last: bool) {
        self.tell();
        let progress = self.courier.progress();
        let settled = Progress { settled_until: self.kept.settled_until, ..progress };
        let moved = progress.settled_until - self.kept.settled_until;
        let is_due = settled != self.kept || moved >= KEEP_EVERY || (is_last && moved > 0);
        if !is_due {
            return;
        }
        match self.receivers.keep(&self.name, &progress) {
            Ok(()) => {
                self.kept = progress;
                self.store_refuses = false;
            }
            Err(error) if !self.store_refuses => {
                self.store_refuses = true;
                tracing::error!(
                    receiver = self.name,
                    %error,
                    "its place cannot be stored: after a kill events may be sent twice, with the same id"
                );
            }
            Err(_) => {}
        }
    }

    /// When the oldest event that waits was stored, UTC.
    fn waiting_since(&mut self) -> Option<Timestamp> {
        let head = self.courier.queue().head().unwrap_or(u64::MAX);
        while self.stored.front().is_some_and(|(place, _)| *place < head) {
            self.stored.pop_front();
        }
        self.stored.front().map(|(_, at)| *at)
    }

    fn tell(&mut self) {
        let waiting_since = self.waiting_since();
        let progress = self.courier.progress();
        let n_waiting = self.courier.queue().n_waiting();
        let raise = |counter: &prometheus_client::metrics::counter::Counter, to: u64| {
            counter.inc_by(to.saturating_sub(counter.get()));
        };
        raise(&self.metrics.delivered, progress.n_delivered);
        raise(&self.metrics.refused, progress.n_refused);
        raise(&self.metrics.given_up, progress.n_given_up);
        self.metrics.waiting.set(i64::try_from(n_waiting).unwrap_or(i64::MAX));
        self.metrics.failing.set(i64::from(self.courier.failure().is_some()));
        self.told.send_replace(ReceiverView {
            n_waiting,
            progress,
            failure: self.courier.failure().map(str::to_owned),
            last_delivered: self.last_delivered,
            waiting_since,
        });
    }

    /// Sends everything that is due at `now_s` and keeps the place after each. `send`: sends one event; `now`:
    /// the clocks; `jitter`: 0 to 1.
    pub(super) fn carry(
        &mut self,
        now: &dyn Fn() -> (f64, Timestamp),
        send: &mut dyn FnMut(&LogEntry) -> Answer,
        jitter: &mut dyn FnMut() -> f64,
        is_stopping: &dyn Fn() -> bool,
    ) -> Due {
        if let Err(error) = self.read_on() {
            tracing::error!(receiver = self.name, %error, "the events cannot be read");
            return Due::At(now().0 + RETRY_S);
        }
        loop {
            if is_stopping() {
                return Due::Stored;
            }
            let entry = match self.due(now().0) {
                Ok(entry) => entry,
                Err(due) => {
                    self.keep(false);
                    return match due {
                        Due::Stored => self.carry_unstored(now, send, is_stopping),
                        Due::At(_) => due,
                    };
                }
            };
            let answer = send(&entry);
            self.answered(&answer, now(), jitter());
            self.keep(false);
        }
    }

    /// Sends what the store refuses, so that a full disk silences no alarm. It is no part of the queue: when it is
    /// stored, it is sent again as everything is.
    fn carry_unstored(
        &mut self,
        now: &dyn Fn() -> (f64, Timestamp),
        send: &mut dyn FnMut(&LogEntry) -> Answer,
        is_stopping: &dyn Fn() -> bool,
    ) -> Due {
        while let Some((number, entry)) = self.status.unstored_after(self.told_unstored) {
            if is_stopping() {
                break;
            }
            let is_wanted = match &entry.what {
                Happened::Alarm(event) => self.filter.takes(&entry.machine, event),
                Happened::Health(_) | Happened::Configuration(_) | Happened::Maintenance(_) => {
                    false
                }
            };
            if is_wanted {
                let answer = send(&entry);
                if answer.is_temporary() {
                    return Due::At(now().0 + UNSTORED_RETRY_S);
                }
            }
            self.told_unstored = number;
        }
        Due::Stored
    }
}
