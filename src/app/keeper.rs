//! The way of alarms to the store: each machine's end of it, and the thread that writes.
//!
//! A shard never waits for the store. Its queue is bounded; what finds no room is lost, counted, and
//! repaired by sending all standing alarms with the next batch.

use super::Clock;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::notify::HealthChange;
use crate::store::Archive;
use crate::store::Batch;
use crate::store::StateStore;
use crate::store::StreamKey;
use crate::store::writer::Done;
use crate::store::writer::Job;
use crate::store::writer::Status;
use crate::store::writer::Writer;
use crate::telemetry::StoreMetrics;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::mpsc::SyncSender;
use std::sync::mpsc::TrySendError;
use std::sync::mpsc::sync_channel;
use std::time::Duration;
use tokio::sync::watch;

/// Jobs that may wait for the writer.
const QUEUE: usize = 4096;

/// Jobs of one commit, at most.
const GROUP: usize = 256;

/// How long the writer waits before it tries again what the store refused.
const RETRY: Duration = Duration::from_secs(1);

/// The store as the daemon's parts see it; cheap to clone.
#[derive(Clone)]
pub struct Keeper {
    jobs: SyncSender<Job>,
    /// The reading side.
    pub archive: Arc<dyn Archive>,
    /// How the store is doing.
    pub status: Arc<Status>,
    /// Things stored since the start: whoever waits for the next one waits for this to change.
    pub stored: watch::Receiver<u64>,
    /// The daemon's clocks.
    pub clock: Clock,
}

impl std::fmt::Debug for Keeper {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Keeper").field("status", &self.status).finish_non_exhaustive()
    }
}

/// The writing side before its thread starts.
pub struct KeeperPlan {
    store: Box<dyn StateStore>,
    jobs: Receiver<Job>,
    status: Arc<Status>,
    stored: watch::Sender<u64>,
    metrics: StoreMetrics,
}

impl std::fmt::Debug for KeeperPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KeeperPlan").field("status", &self.status).finish_non_exhaustive()
    }
}

impl Keeper {
    /// Joins a store's two sides by a queue.
    #[must_use]
    pub fn new(
        store: Box<dyn StateStore>,
        archive: Arc<dyn Archive>,
        metrics: StoreMetrics,
    ) -> (Self, KeeperPlan) {
        let (jobs, inbox) = sync_channel(QUEUE);
        let status = Arc::new(Status::default());
        let (told, stored) = watch::channel(0);
        let plan =
            KeeperPlan { store, jobs: inbox, status: Arc::clone(&status), stored: told, metrics };
        (Self { jobs, archive, status, stored, clock: Clock::start() }, plan)
    }
}

impl KeeperPlan {
    /// Writes until every sender is gone and everything is written.
    pub fn run(self) {
        let Self { store, jobs, status, stored, metrics } = self;
        let mut writer = Writer::new(store, &status);
        let (mut n_stored, mut n_lost) = (0, 0);
        loop {
            let mut is_over = false;
            let refused = match jobs.recv_timeout(RETRY) {
                Ok(first) => {
                    let more = jobs.try_iter().take(GROUP - 1);
                    writer.take(std::iter::once(first).chain(more).collect())
                }
                Err(RecvTimeoutError::Timeout) => writer.flush(),
                Err(RecvTimeoutError::Disconnected) => {
                    is_over = true;
                    writer.flush()
                }
            };
            metrics.stored.inc_by(status.n_stored() - n_stored);
            if status.n_stored() != n_stored {
                stored.send_replace(status.n_stored());
            }
            metrics.lost.inc_by(status.n_lost() - n_lost);
            (n_stored, n_lost) = (status.n_stored(), status.n_lost());
            metrics.waiting.set(i64::try_from(status.n_waiting()).unwrap_or(i64::MAX));
            metrics.failing.set(i64::from(refused.is_err()));
            if is_over {
                if status.n_waiting() > 0 {
                    tracing::error!(n_events = status.n_waiting(), "alarm events were not stored");
                }
                return;
            }
        }
    }
}

/// A machine's end of the way.
#[derive(Debug)]
pub struct MachineKeeper {
    keeper: Keeper,
    machine: String,
    stream: StreamKey,
    /// Whether this machine raises the alarm of the store.
    tells_store: bool,
    /// Send all standing alarms: events were lost.
    send_standing: bool,
    n_lost_seen: u64,
}

impl MachineKeeper {
    /// Makes the end of a machine.
    #[must_use]
    pub fn new(keeper: Keeper, machine: &str, stream: StreamKey, tells_store: bool) -> Self {
        let machine = machine.to_owned();
        Self { keeper, machine, stream, tells_store, send_standing: false, n_lost_seen: 0 }
    }

    /// The daemon's clocks.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.keeper.clock
    }

    /// Why nothing can be stored, if this machine is the one to say it.
    #[must_use]
    pub fn failure_to_tell(&self) -> Option<String> {
        if self.tells_store { self.keeper.status.failure() } else { None }
    }

    /// Sends events on their way; `done` is told when they are stored, or why not.
    pub fn keep(
        &mut self,
        engine: &AlarmEngine,
        (events, health): (Vec<AlarmEvent>, Vec<HealthChange>),
        stream_s: f64,
        done: Option<Done>,
    ) {
        if events.is_empty() && health.is_empty() && done.is_none() && !self.send_standing {
            return;
        }
        let n_events = events.len() + health.len();
        let batch = Batch {
            machine: self.machine.clone(),
            stream: self.stream.clone(),
            now: self.keeper.clock.moment(stream_s),
            judged_until_s: engine.judged_until_s(),
            events,
            health,
            standing: self.send_standing.then(|| engine.standing()),
        };
        match self.keeper.jobs.try_send(Job { batch, done }) {
            Ok(()) => self.send_standing = false,
            Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) => {
                self.keeper.status.count_lost(n_events);
                self.send_standing = true;
                if let Some(done) = job.done {
                    done(Err("the store does not keep up".to_owned()));
                }
            }
        }
    }

    /// Sends all standing alarms if events were lost and the store is well again.
    pub fn repair(&mut self, engine: &AlarmEngine, stream_s: f64) {
        let status = &self.keeper.status;
        let n_lost = status.n_lost();
        if n_lost != self.n_lost_seen && status.failure().is_none() {
            self.n_lost_seen = n_lost;
            self.send_standing = true;
        }
        self.keep(engine, (Vec::new(), Vec::new()), stream_s, None);
    }
}
