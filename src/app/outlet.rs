//! What every source's thread does with what it has: waits by the clock, records, hands on, tells the
//! end.
//!
//! The recorder writes on this thread: a source waits for the disk as it waits for the shard and
//! loses nothing. A source that cannot wait will need a queue of its own before a recorder.

use super::link::Input;
use super::link::Link;
use super::recording::Recording;
use super::stop::Stop;
use crate::api::view::SourceState;
use crate::capture::received::Received;
use crate::ingest::replay::Step;
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::sync::Arc;
use std::time::Duration;
use std::time::Instant;

/// Longest wait for one block: a time stamp beyond it is a mistake, not a date.
const MAX_WAIT_S: f64 = 1e9;

/// The way out of a source.
#[derive(Debug)]
pub(super) struct Outlet<'a> {
    link: &'a Link,
    stop: &'a Stop,
    recording: RefCell<Option<Recording>>,
    /// Whether the shard holds what was received.
    is_captured: bool,
    started: Instant,
}

impl<'a> Outlet<'a> {
    /// Begins: waits count from now.
    pub(super) fn new(
        link: &'a Link,
        stop: &'a Stop,
        recording: Option<Recording>,
        is_captured: bool,
    ) -> Self {
        let recording = RefCell::new(recording);
        Self { link, stop, recording, is_captured, started: super::now() }
    }

    /// Seconds since the beginning.
    pub(super) fn elapsed_s(&self) -> f64 {
        super::now().saturating_duration_since(self.started).as_secs_f64()
    }

    /// Waits until so many seconds after the beginning; breaks at the stop.
    pub(super) fn wait(&self, due_s: f64) -> ControlFlow<()> {
        // A time that cannot be waited for (NaN, before the start) is due at once.
        let due = Duration::try_from_secs_f64(due_s.min(MAX_WAIT_S)).unwrap_or_default();
        let due = self.started + due;
        loop {
            let flush_due = self.recording.borrow().as_ref().and_then(Recording::flush_due);
            if self.stop.wait_until(flush_due.map_or(due, |flush_due| flush_due.min(due))) {
                return ControlFlow::Break(());
            }
            if flush_due.is_none_or(|flush_due| flush_due > due) {
                return ControlFlow::Continue(());
            }
            if let Some(recording) = self.recording.borrow_mut().as_mut() {
                recording.tick();
            }
        }
    }

    /// Hands a step on, or records it; breaks when the daemon is stopping.
    pub(super) fn take(&self, step: Step) -> ControlFlow<()> {
        let input = match step {
            Step::Block(block) => Input::Block(block, super::now()),
            Step::Received(run) => {
                let run = Arc::new(run);
                if let Some(recording) = self.recording.borrow_mut().as_mut() {
                    recording.take(Received::clone(&run));
                }
                if !self.is_captured {
                    return ControlFlow::Continue(());
                }
                Input::Received(run)
            }
            Step::Rejected { n_samples, reason } => Input::Rejected { n_samples, reason },
            Step::End => return ControlFlow::Continue(()),
        };
        if self.link.send(input).is_err() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// Runs the source and tells its shard how it ended; `None` from `play`: it was stopped.
    pub(super) fn run(self, play: impl FnOnce(&Self) -> Option<SourceState>) {
        let played = catch_unwind(AssertUnwindSafe(|| play(&self)));
        // However it ended: what was received is on the disk before anybody hears of the end.
        if let Some(recording) = self.recording.into_inner() {
            recording.finish();
        }
        let state = match played {
            Ok(None) => return,
            Ok(Some(state)) => state,
            Err(_) => SourceState::Failed("internal error while reading, see the log".to_owned()),
        };
        // Closed: the daemon is stopping, and nobody is left to tell.
        let _closed = self.link.send(Input::Source(state));
    }
}
