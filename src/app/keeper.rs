//! The way of alarms to the store: each machine's end of it, and the thread that writes.
//!
//! A shard never waits for the store. Its queue is bounded; what finds no room is lost, counted, and
//! repaired by sending all standing alarms with the next batch.

use super::Clock;
use super::trouble::Troubles;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::Signature;
use crate::notify::HealthChange;
use crate::store::Archive;
use crate::store::Batch;
use crate::store::ConfigurationEntry;
use crate::store::StateStore;
use crate::store::StreamKey;
use crate::store::events::ConfigurationChange;
use crate::store::events::MaintenanceChange;
use crate::store::writer::Done;
use crate::store::writer::Job;
use crate::store::writer::MAX_WAITING;
use crate::store::writer::Status;
use crate::store::writer::Writer;
use crate::telemetry::StoreMetrics;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::mpsc::SyncSender;
use std::sync::mpsc::TrySendError;
use std::sync::mpsc::sync_channel;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::watch;

/// Jobs that may wait for the writer.
const QUEUE: usize = 4096;

/// Jobs of one commit, at most.
const GROUP: usize = 256;

/// How long the writer waits before it tries again what the store refused.
const RETRY: Duration = Duration::from_secs(1);

/// How often delays of alarms are kept while nothing happens: a kill takes so much of them.
const KEEP_DECISIONS_EVERY: Duration = Duration::from_secs(60);

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
    /// What else goes wrong with the store.
    pub troubles: Troubles,
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
        let (clock, troubles) = (Clock::start(), Troubles::default());
        (Self { jobs, archive, status, stored, clock, troubles }, plan)
    }
}

impl Keeper {
    /// Has what became of a configuration stored; what finds no room is counted as lost.
    pub fn tell(&self, configuration: Vec<ConfigurationChange>, holds: Option<ConfigurationEntry>) {
        let n = configuration.len();
        let now = self.clock.moment(0.0);
        let batch = Batch { now, configuration, holds, ..Batch::new("", Vec::new()) };
        if self.jobs.try_send(Job { batch, done: None }).is_err() {
            self.status.count_lost(n);
        }
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
            let received = jobs.recv_timeout(RETRY);
            let begun = super::now();
            let refused = match received {
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
            if status.n_stored() != n_stored {
                let took = super::now().saturating_duration_since(begun);
                metrics.commit_s.observe(took.as_secs_f64());
                status.note_commit(super::wall_clock(), took.as_secs_f64());
            }
            metrics.stored.inc_by(status.n_stored() - n_stored);
            // What is refused is told too.
            if status.n_stored() != n_stored || refused.is_err() {
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
    /// Send all silences in advance: they changed.
    send_advance: bool,
    /// Acts that go with the next batch.
    acts: Vec<(&'static str, Signature)>,
    /// What became of maintenances, which does, too.
    maintenance: Vec<MaintenanceChange>,
    /// Transitions that are not stored yet, oldest first: what falls out of the engine's history before it is
    /// stored shall still be shown. As many as may wait for the store.
    unstored: VecDeque<AlarmEvent>,
    n_lost_seen: u64,
    /// When delays were kept, and up to which stream time they had gone, s.
    decisions_at: (Instant, Option<f64>),
    is_ending: bool,
}

impl MachineKeeper {
    /// Makes the end of a machine.
    #[must_use]
    pub fn new(keeper: Keeper, machine: &str, stream: StreamKey, tells_store: bool) -> Self {
        let machine = machine.to_owned();
        let decisions_at = (super::now(), None);
        Self {
            keeper,
            machine,
            stream,
            tells_store,
            send_standing: false,
            send_advance: false,
            acts: Vec::new(),
            maintenance: Vec::new(),
            unstored: VecDeque::new(),
            n_lost_seen: 0,
            decisions_at,
            is_ending: false,
        }
    }

    /// The daemon's clocks.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.keeper.clock
    }

    /// What goes wrong with the store, if this machine is the one to say it.
    #[must_use]
    pub fn failure_to_tell(&self) -> Option<String> {
        if !self.tells_store {
            return None;
        }
        let failure = self.keeper.status.failure();
        let alarms = failure.map(|why| format!("alarms cannot be stored: {why}"));
        let troubles = self.keeper.troubles.told(super::now());
        let all: Vec<String> = alarms.into_iter().chain(troubles).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }

    /// What follows is judged by the configuration with this hash: after a restart with it, what is kept is taken up.
    pub fn renew(&mut self, configuration: &str) {
        let Some(before) = &mut self.stream.judged_by else { return };
        let before = std::mem::replace(before, configuration.to_owned());
        if let Some(identity) = &mut self.stream.identity
            && let Some(stream) = identity.strip_suffix(&before)
        {
            *identity = format!("{stream}{configuration}");
        }
    }

    /// Sends events on their way; `done` is told when they are stored, or why not.
    pub fn keep(
        &mut self,
        engine: &AlarmEngine,
        (events, health): (Vec<AlarmEvent>, Vec<HealthChange>),
        stream_s: f64,
        done: Option<Done>,
    ) {
        let is_news = !events.is_empty() || !health.is_empty() || done.is_some();
        if !is_news
            && !self.send_standing
            && !self.send_advance
            && !self.has_decisions_to_keep(engine)
        {
            return;
        }
        let maintenance = std::mem::take(&mut self.maintenance);
        let n_events = events.len() + health.len();
        self.forget_stored();
        self.unstored.extend(events.iter().cloned());
        let batch = Batch {
            machine: self.machine.clone(),
            stream: self.stream.clone(),
            now: self.keeper.clock.moment(stream_s),
            judged_until_s: engine.judged_until_s(),
            events,
            health,
            standing: self.send_standing.then(|| engine.standing()),
            // An engine that has judged nothing knows no more than what is kept.
            configuration: Vec::new(),
            holds: None,
            advance: (self.send_standing || self.send_advance)
                .then(|| (engine.advance().to_vec(), engine.last_advance())),
            acts: std::mem::take(&mut self.acts),
            maintenance,
            decisions: (self.stream.judged_by.is_some() && engine.judged_until_s().is_some())
                .then(|| engine.decisions()),
        };
        self.decisions_at = (super::now(), batch.judged_until_s);
        match self.keeper.jobs.try_send(Job { batch, done }) {
            Ok(()) => (self.send_standing, self.send_advance) = (false, false),
            Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) => {
                self.keeper.status.count_lost(n_events);
                self.send_standing = true;
                (self.acts, self.maintenance) = (job.batch.acts, job.batch.maintenance);
                if let Some(done) = job.done {
                    done(Err("the store does not keep up".to_owned()));
                }
            }
        }
    }

    /// Silences in advance changed by this act: they go with the next batch.
    pub fn note_advance(&mut self, act: &'static str, by: Signature) {
        self.send_advance = true;
        self.acts.push((act, by));
    }

    /// What became of the maintenance of the machine: it goes with the next batch.
    pub fn note_maintenance(&mut self, change: MaintenanceChange) {
        self.send_advance = true;
        self.maintenance.push(change);
    }

    /// The transitions before number `before` that may not be in the store yet, oldest first and without a hole up
    /// to it.
    pub fn unstored_before(&mut self, before: u64) -> Vec<AlarmEvent> {
        self.forget_stored();
        self.unstored.iter().take_while(|event| event.sequence < before).cloned().collect()
    }

    fn forget_stored(&mut self) {
        let stored_until = self.keeper.status.stored_until(&self.machine);
        let is_stored = |event: &AlarmEvent| event.sequence <= stored_until;
        while self.unstored.front().is_some_and(is_stored) || self.unstored.len() > MAX_WAITING {
            self.unstored.pop_front();
        }
    }

    /// Whether delays have gone on for a minute since they were kept. While the store refuses they are not: what
    /// waits for it shall be what happened.
    fn has_decisions_to_keep(&self, engine: &AlarmEngine) -> bool {
        let (at, judged_until_s) = self.decisions_at;
        let age = super::now().saturating_duration_since(at);
        let is_due = self.is_ending || age >= KEEP_DECISIONS_EVERY;
        let is_news = engine.judged_until_s() != judged_until_s;
        is_due && is_news && self.keeper.status.failure().is_none()
    }

    /// Keeps delays as they are, because the program ends.
    pub fn end(&mut self, engine: &AlarmEngine, stream_s: f64) {
        self.is_ending = true;
        self.keep(engine, (Vec::new(), Vec::new()), stream_s, None);
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
