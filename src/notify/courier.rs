//! One receiver: what is sent to it next and when.
//!
//! One event at a time, in the order of the log, so that the order of each machine is kept; the next is sent
//! only when the one before is settled. Time is monotonic and an argument: a clock that is set changes nothing.

use super::backoff::Backoff;
use super::queue::Progress;
use super::queue::Queue;

/// Longest wait that a receiver may ask for, s.
const MAX_ASKED_S: f64 = 3600.0;

/// Answers by which a receiver says that this very event is none it can take: it would say so again.
const OF_THE_EVENT: [u16; 6] = [400, 406, 409, 413, 415, 422];

/// What came of sending an event.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// An answer of HTTP, and how long it asks to wait, s.
    Status(u16, Option<f64>),
    /// No answer; why.
    Failed(String),
}

impl Answer {
    /// Whether the event may be taken another time.
    #[must_use]
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::Status(200..=299, _) => false,
            Self::Status(status, _) => !OF_THE_EVENT.contains(status),
            Self::Failed(_) => true,
        }
    }
}

/// What to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// Nothing waits.
    Idle,
    /// Wait until this time, s.
    At(f64),
    /// Send the event at this place.
    Send(u64),
}

/// One receiver.
#[derive(Debug, Clone)]
pub struct Courier {
    queue: Queue,
    backoff: Backoff,
    n_failures: u32,
    not_before_s: f64,
    failure: Option<String>,
}

impl Courier {
    /// Begins with a queue.
    #[must_use]
    pub fn new(queue: Queue, backoff: Backoff) -> Self {
        Self { queue, backoff, n_failures: 0, not_before_s: f64::NEG_INFINITY, failure: None }
    }

    /// Takes in an event of the log.
    pub fn see(&mut self, place: u64, is_wanted: bool) {
        self.queue.see(place, is_wanted);
    }

    /// What waits.
    #[must_use]
    pub fn queue(&self) -> &Queue {
        &self.queue
    }

    /// What to keep.
    #[must_use]
    pub fn progress(&self) -> Progress {
        self.queue.progress()
    }

    /// Why nothing gets through at the moment.
    #[must_use]
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// What to do at `now_s`.
    #[must_use]
    pub fn next(&self, now_s: f64) -> Next {
        match self.queue.head() {
            None => Next::Idle,
            Some(_) if now_s < self.not_before_s => Next::At(self.not_before_s),
            Some(place) => Next::Send(place),
        }
    }

    /// Takes in what came of sending the next event, at `now_s`. `jitter`: 0 to 1.
    ///
    /// Taken: any 2xx. Refused for good, and counted: answers about this very event (400, 406, 409, 413, 415,
    /// 422). All else is about the way there, wrong address, key or a receiver that is down, also 410 and
    /// redirections: the event waits and is tried again, for an alarm path is not ended by its receiver.
    pub fn answered(&mut self, answer: &Answer, now_s: f64, jitter: f64) {
        let (why, asked_s) = match answer {
            Answer::Status(200..=299, _) => {
                self.queue.delivered();
                return self.recovered();
            }
            Answer::Status(status, _) if OF_THE_EVENT.contains(status) => {
                self.queue.refused();
                return self.recovered();
            }
            Answer::Status(status, asked_s) => (format!("answers with status {status}"), *asked_s),
            Answer::Failed(why) => (why.clone(), None),
        };
        self.n_failures = self.n_failures.saturating_add(1);
        let asked_s = asked_s.filter(|s| s.is_finite()).unwrap_or(0.0).min(MAX_ASKED_S);
        self.not_before_s = now_s + self.backoff.wait_s(self.n_failures, jitter).max(asked_s);
        self.failure = Some(why);
    }

    /// The event that is next is no longer in the log: nobody can be told of it.
    pub fn gone(&mut self) {
        self.queue.refused();
    }

    /// The way to the receiver is open again, though it has not taken anything yet.
    pub fn connected(&mut self) {
        self.not_before_s = f64::NEG_INFINITY;
        self.failure = None;
    }

    /// When to try again after a failure, s.
    #[must_use]
    pub fn retry_at_s(&self) -> f64 {
        self.not_before_s
    }

    fn recovered(&mut self) {
        self.n_failures = 0;
        self.not_before_s = f64::NEG_INFINITY;
        self.failure = None;
    }
}
