//! Groups what happens into commits, answers after them, and keeps what could not be stored.
//!
//! Pure but for the store behind it: the thread, its queue and the clock belong to `app`. While the store
//! refuses, batches wait in memory, bounded in events; beyond that the oldest are lost and counted, and
//! whoever sends them is told to send all standing alarms with the next batch.

use super::Batch;
use super::StateStore;
use super::events::Happened;
use super::events::LogEntry;
use crate::causes::with_causes;
use crate::signal::Timestamp;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering;

/// Transitions that wait for the store and can be told meanwhile; the oldest give way.
const MAX_TELLABLE: usize = 1000;

/// Events that may wait while the store refuses.
pub const MAX_WAITING: usize = 20_000;

/// What is done when a batch is stored, or why it is not yet.
pub type Done = Box<dyn FnOnce(Result<(), String>) + Send>;

/// A batch on its way to the store.
pub struct Job {
    /// What happened.
    pub batch: Batch,
    /// Who waits for it to be stored.
    pub done: Option<Done>,
}

impl std::fmt::Debug for Job {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job").field("batch", &self.batch).finish_non_exhaustive()
    }
}

/// How the store is doing; shared.
#[derive(Debug, Default)]
pub struct Status {
    failure: Mutex<Option<String>>,
    n_stored: AtomicU64,
    n_lost: AtomicU64,
    n_waiting: AtomicU64,
    unstored: Mutex<Unstored>,
    /// Of each machine the highest number of a transition that is stored.
    stored_until: Mutex<BTreeMap<String, u64>>,
    pace: Mutex<Pace>,
}

/// How far the store is behind what happens.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pace {
    /// When the oldest event happened that is being written or waits because the store refuses, UTC; `None`: none does.
    pub waiting_since: Option<Timestamp>,
    /// When the newest commit was over, UTC, and how long it took, s; `None`: there was none since the start.
    pub committed: Option<(Timestamp, f64)>,
}

/// Transitions that the store refused, in their order, with numbers that rise.
#[derive(Debug, Default)]
struct Unstored {
    entries: VecDeque<(u64, LogEntry)>,
    n: u64,
    /// When the store began to refuse, UTC.
    since: Option<Timestamp>,
}

impl Status {
    /// The first transition after number `after` that waits for the store, with its number.
    #[must_use]
    pub fn unstored_after(&self, after: u64) -> Option<(u64, LogEntry)> {
        let unstored = self.unstored.lock().unwrap_or_else(PoisonError::into_inner);
        unstored.entries.iter().find(|(number, _)| *number > after).cloned()
    }

    /// Highest number of a transition of a machine that was stored since the start; 0: none was.
    #[must_use]
    pub fn stored_until(&self, machine: &str) -> u64 {
        let stored = self.stored_until.lock().unwrap_or_else(PoisonError::into_inner);
        stored.get(machine).copied().unwrap_or(0)
    }

    /// How far the store is behind.
    #[must_use]
    pub fn pace(&self) -> Pace {
        *self.pace.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that a commit was over `at`, UTC, and took so long, s.
    pub fn note_commit(&self, at: Timestamp, took_s: f64) {
        let mut pace = self.pace.lock().unwrap_or_else(PoisonError::into_inner);
        pace.committed = Some((at, took_s));
    }

    /// Notes when the oldest event that is not stored happened, UTC.
    fn set_waiting_since(&self, since: Option<Timestamp>) {
        self.pace.lock().unwrap_or_else(PoisonError::into_inner).waiting_since = since;
    }

    /// Notes that a batch is stored.
    fn note_stored(&self, batch: &Batch) {
        let Some(newest) = batch.events.iter().map(|event| event.sequence).max() else { return };
        let mut stored = self.stored_until.lock().unwrap_or_else(PoisonError::into_inner);
        match stored.get_mut(&batch.machine) {
            Some(until) => *until = newest.max(*until),
            None => {
                stored.insert(batch.machine.clone(), newest);
            }
        }
    }

    /// Lets transitions of a refused batch be told.
    fn tell_unstored(&self, batch: &Batch) {
        let mut unstored = self.unstored.lock().unwrap_or_else(PoisonError::into_inner);
        let since = *unstored.since.get_or_insert(batch.now.utc);
        for event in &batch.events {
            unstored.n += 1;
            let entry = LogEntry {
                place: 0,
                machine: batch.machine.clone(),
                recorded: batch.now.utc,
                start: batch.stream.start,
                refused_since: Some(since),
                what: Happened::Alarm(Box::new(event.clone())),
            };
            let number = unstored.n;
            unstored.entries.push_back((number, entry));
        }
        let too_many = unstored.entries.len().saturating_sub(MAX_TELLABLE);
        unstored.entries.drain(..too_many);
    }

    /// Everything is stored: it is told from there.
    fn forget_unstored(&self) {
        let mut unstored = self.unstored.lock().unwrap_or_else(PoisonError::into_inner);
        unstored.entries.clear();
        unstored.since = None;
    }

    /// Why nothing can be stored at the moment; `None`: it can.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.lock().clone()
    }

    /// Events stored since the start.
    #[must_use]
    pub fn n_stored(&self) -> u64 {
        self.n_stored.load(Ordering::Relaxed)
    }

    /// Events that will never be stored.
    #[must_use]
    pub fn n_lost(&self) -> u64 {
        self.n_lost.load(Ordering::Relaxed)
    }

    /// Events that wait for the store to recover.
    #[must_use]
    pub fn n_waiting(&self) -> u64 {
        self.n_waiting.load(Ordering::Relaxed)
    }

    /// Counts events that were lost on the way.
    pub fn count_lost(&self, n_events: usize) {
        self.n_lost.fetch_add(n_events as u64, Ordering::Relaxed);
    }

    /// Counts what was stored.
    pub(super) fn count_stored(&self, n: u64) {
        self.n_stored.fetch_add(n, Ordering::Relaxed);
    }

    /// Notes how much waits.
    pub(super) fn set_waiting(&self, n: u64) {
        self.n_waiting.store(n, Ordering::Relaxed);
    }

    /// Notes why nothing can be stored, or that it can.
    pub(super) fn set_failure(&self, why: Option<String>) {
        *self.lock() = why;
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Writes to a store.
pub struct Writer<'s> {
    store: Box<dyn StateStore>,
    status: &'s Status,
    waiting: VecDeque<Batch>,
    n_waiting: usize,
    max_waiting: usize,
    /// Of the waiting batches, those that can be told already.
    n_tellable: usize,
}

impl std::fmt::Debug for Writer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("status", &self.status).finish_non_exhaustive()
    }
}

impl<'s> Writer<'s> {
    /// Begins with nothing waiting.
    #[must_use]
    pub fn new(store: Box<dyn StateStore>, status: &'s Status) -> Self {
        let waiting = VecDeque::new();
        Self { store, status, waiting, n_waiting: 0, max_waiting: MAX_WAITING, n_tellable: 0 }
    }

    /// Lets fewer events wait.
    #[must_use]
    pub fn with_max_waiting(self, max_waiting: usize) -> Self {
        Self { max_waiting, ..self }
    }

    /// Stores jobs, in their order and after all that waited before them, in one commit, and tells who
    /// waits for each.
    ///
    /// # Errors
    /// When the store refuses; what is within bounds goes on waiting.
    pub fn take(&mut self, jobs: Vec<Job>) -> Result<(), String> {
        let mut dones = Vec::new();
        for Job { batch, done } in jobs {
            self.n_waiting += batch.len();
            self.waiting.push_back(batch);
            dones.extend(done);
        }
        let stored = self.flush();
        for done in dones {
            done(stored.clone());
        }
        stored
    }

    /// Tries to store what waits.
    ///
    /// # Errors
    /// When the store refuses; what is within bounds goes on waiting.
    pub fn flush(&mut self) -> Result<(), String> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        self.status.set_waiting_since(self.oldest());
        let done = self.store.keep(self.waiting.make_contiguous());
        let answer = done.map_err(|error| with_causes(&error));
        match &answer {
            Ok(()) => {
                self.status.n_stored.fetch_add(self.n_waiting as u64, Ordering::Relaxed);
                self.waiting.iter().for_each(|batch| self.status.note_stored(batch));
                self.waiting.clear();
                (self.n_waiting, self.n_tellable) = (0, 0);
                self.status.forget_unstored();
            }
            Err(why) => {
                if self.status.failure().is_none() {
                    tracing::error!(why, "alarms cannot be stored, they wait in memory");
                }
                for batch in self.waiting.iter().skip(self.n_tellable) {
                    self.status.tell_unstored(batch);
                }
                self.n_tellable = self.waiting.len();
                self.keep_newest_decisions();
                self.bound();
            }
        }
        self.status.n_waiting.store(self.n_waiting as u64, Ordering::Relaxed);
        self.status.set_waiting_since(self.oldest());
        let mut failure = self.status.lock();
        if answer.is_ok() && failure.is_some() {
            tracing::warn!("the store has recovered, what waited is stored");
        }
        *failure = answer.clone().err();
        answer
    }

    /// When the oldest event that waits happened, UTC.
    fn oldest(&self) -> Option<Timestamp> {
        self.waiting.iter().find(|batch| !batch.is_empty()).map(|batch| batch.now.utc)
    }

    /// Of each machine the newest delays alone are kept while batches wait: they are stored in one commit.
    fn keep_newest_decisions(&mut self) {
        let mut seen = BTreeSet::new();
        for batch in self.waiting.iter_mut().rev() {
            if !seen.insert(batch.machine.as_str()) {
                batch.decisions = None;
            }
        }
    }

    /// Loses the oldest batches beyond the bound.
    fn bound(&mut self) {
        while self.n_waiting > self.max_waiting {
            let Some(oldest) = self.waiting.pop_front() else { break };
            self.n_waiting -= oldest.len();
            self.n_tellable = self.n_tellable.saturating_sub(1);
            self.status.count_lost(oldest.len());
        }
    }
}
