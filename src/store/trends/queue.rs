//! Groups minutes into commits, and keeps what could not be stored.
//!
//! Pure but for the store behind it. While the store refuses, minutes wait in memory, bounded in bytes;
//! beyond that the oldest are lost and counted.

use super::Minute;
use super::Tier;
use super::TrendStore;
use super::period::Period;
use crate::causes::with_causes;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::writer::Status;
use std::collections::VecDeque;

/// Bytes of minutes that may wait while the store refuses.
pub const MAX_WAITING_BYTES: usize = 64 << 20;

/// Channels' minutes of one commit: about 2 MB.
const GROUP: usize = 800;

/// Writes minutes to a store.
pub struct Queue<'s> {
    store: Box<dyn TrendStore>,
    status: &'s Status,
    waiting: VecDeque<Minute>,
    bytes: usize,
    max_bytes: usize,
    /// A file is refused for good, as far as this program can tell.
    refused: Option<String>,
}

impl std::fmt::Debug for Queue<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Queue").field("status", &self.status).finish_non_exhaustive()
    }
}

impl<'s> Queue<'s> {
    /// Begins with nothing waiting.
    #[must_use]
    pub fn new(store: Box<dyn TrendStore>, status: &'s Status) -> Self {
        let (waiting, max_bytes) = (VecDeque::new(), MAX_WAITING_BYTES);
        Self { store, status, waiting, bytes: 0, max_bytes, refused: None }
    }

    /// Lets fewer bytes wait.
    #[must_use]
    pub fn with_max_bytes(self, max_bytes: usize) -> Self {
        Self { max_bytes, ..self }
    }

    /// The store.
    pub fn store(&mut self) -> &mut dyn TrendStore {
        &mut *self.store
    }

    /// Adds a minute to what waits.
    pub fn push(&mut self, minute: Minute) {
        self.bytes += minute.bytes();
        self.waiting.push_back(minute);
    }

    /// Stores what waits, a commit a group; gives whether anything is refused.
    pub fn flush(&mut self, now: Timestamp) -> bool {
        let mut failure = None;
        while !self.waiting.is_empty() {
            let n = self.group();
            match self.store.keep(&self.waiting.make_contiguous()[..n], now) {
                Ok(kept) => {
                    self.status.count_stored(kept.n_new);
                    self.refused = None;
                    self.drop_first(n);
                }
                Err(error @ (StoreError::NewerTrends { .. } | StoreError::Foreign { .. })) => {
                    // Waiting would not help, and would hold up what another file takes.
                    self.refused = Some(with_causes(&error));
                    let lost: u64 = self.waiting.iter().take(n).map(Minute::n_points).sum();
                    self.status.count_lost(usize::try_from(lost).unwrap_or(usize::MAX));
                    self.drop_first(n);
                }
                Err(error) => {
                    failure = Some(with_causes(&error));
                    self.bound();
                    break;
                }
            }
        }
        let failure = failure.or_else(|| self.refused.clone());
        self.status.set_waiting(self.waiting.iter().map(Minute::n_points).sum());
        let is_failing = failure.is_some();
        match (self.status.failure(), &failure) {
            (None, Some(why)) => tracing::error!(why, "trends cannot be stored"),
            (Some(_), None) => tracing::warn!("trends are stored again"),
            (None, None) | (Some(_), Some(_)) => {}
        }
        self.status.set_failure(failure);
        is_failing
    }

    /// Minutes of the next commit: of one file, at least one.
    fn group(&self) -> usize {
        let day = |minute: &Minute| Period::of(Tier::Windows, minute.minute);
        let Some(first) = self.waiting.front().map(day) else { return 0 };
        let mut rows = 0;
        let fits = |minute: &&Minute| {
            rows += minute.channels.len().max(1);
            day(minute) == first && rows <= GROUP
        };
        self.waiting.iter().take_while(fits).count().max(1)
    }

    fn drop_first(&mut self, n: usize) {
        for minute in self.waiting.drain(..n) {
            self.bytes = self.bytes.saturating_sub(minute.bytes());
        }
    }

    /// Loses the oldest minutes beyond the bound.
    fn bound(&mut self) {
        while self.bytes > self.max_bytes {
            let Some(oldest) = self.waiting.pop_front() else { break };
            self.bytes = self.bytes.saturating_sub(oldest.bytes());
            self.status.count_lost(usize::try_from(oldest.n_points()).unwrap_or(usize::MAX));
        }
    }
}
