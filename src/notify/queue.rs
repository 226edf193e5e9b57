//! What one receiver has still to be told, as places in the store's log of events.
//!
//! The log is the queue: an event waits for a receiver from the commit that stores it. Here are only the places,
//! and one number is enough to find them again after a restart: up to where everything is settled.

use std::collections::VecDeque;

/// How far a receiver has come; what is kept of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Every event up to this place was delivered, refused, given up or is none of its own.
    pub settled_until: u64,
    /// Events that it took.
    pub n_delivered: u64,
    /// Events that it refused for good.
    pub n_refused: u64,
    /// Events given up because too many waited.
    pub n_given_up: u64,
}

/// Places of the events that wait for a receiver, oldest first, bounded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Queue {
    max_waiting: usize,
    waiting: VecDeque<u64>,
    seen_until: u64,
    progress: Progress,
}

impl Queue {
    /// Goes on where `progress` ended; at most `max_waiting` events wait.
    #[must_use]
    pub fn new(progress: Progress, max_waiting: usize) -> Self {
        let seen_until = progress.settled_until;
        Self { max_waiting: max_waiting.max(1), waiting: VecDeque::new(), seen_until, progress }
    }

    /// Place after which the log is to be read on.
    #[must_use]
    pub fn seen_until(&self) -> u64 {
        self.seen_until
    }

    /// Takes in an event of the log, `is_wanted` or not; places rise. Gives up the oldest if too many wait.
    pub fn see(&mut self, place: u64, is_wanted: bool) {
        if place <= self.seen_until {
            return;
        }
        self.seen_until = place;
        if is_wanted {
            self.waiting.push_back(place);
            if self.waiting.len() > self.max_waiting {
                self.waiting.pop_front();
                self.progress.n_given_up += 1;
            }
        }
        self.settle();
    }

    /// The event that is next.
    #[must_use]
    pub fn head(&self) -> Option<u64> {
        self.waiting.front().copied()
    }

    /// Events that wait.
    #[must_use]
    pub fn n_waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The next event was taken.
    pub(super) fn delivered(&mut self) {
        self.progress.n_delivered += u64::from(self.waiting.pop_front().is_some());
        self.settle();
    }

    /// The next event was refused for good.
    pub(super) fn refused(&mut self) {
        self.progress.n_refused += u64::from(self.waiting.pop_front().is_some());
        self.settle();
    }

    fn settle(&mut self) {
        let until = self.waiting.front().map_or(self.seen_until, |head| head.saturating_sub(1));
        self.progress.settled_until = self.progress.settled_until.max(until);
    }

    /// What to keep.
    #[must_use]
    pub fn progress(&self) -> Progress {
        self.progress
    }
}
