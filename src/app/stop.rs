//! The daemon's one stop signal, and waiting that it cuts short.

use std::sync::Condvar;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Instant;

/// Set once, seen by every thread.
#[derive(Debug, Default)]
pub struct Stop {
    set: Mutex<bool>,
    changed: Condvar,
}

impl Stop {
    /// Asks every thread to end.
    pub fn set(&self) {
        *self.set.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_all();
    }

    /// Whether the stop was asked for.
    #[must_use]
    pub fn is_set(&self) -> bool {
        *self.set.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `deadline` or the stop; true when it is the stop.
    #[must_use]
    pub fn wait_until(&self, deadline: Instant) -> bool {
        let guard = self.set.lock().unwrap_or_else(PoisonError::into_inner);
        let left = deadline.saturating_duration_since(super::now());
        let (guard, _) = self
            .changed
            .wait_timeout_while(guard, left, |set| !*set)
            .unwrap_or_else(PoisonError::into_inner);
        *guard
    }
}
