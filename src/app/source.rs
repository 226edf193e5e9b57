//! A source's thread: plays a capture into its machine's link, paced by the clock, and records it.
//!
//! The recorder writes on this thread: a replay waits for the disk as it waits for the shard and
//! loses nothing. A live source, which cannot wait, will need a queue of its own before a recorder.

use super::link::Input;
use super::link::Link;
use super::recording::Recording;
use super::stop::Stop;
use crate::api::view::SourceState;
use crate::ingest::replay;
use crate::ingest::replay::End;
use crate::ingest::replay::ReplayError;
use crate::ingest::replay::Step;
use crate::ingest::replay::Stream;
use std::cell::RefCell;
use std::error::Error;
use std::ops::ControlFlow;
use std::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::time::Duration;

/// Longest wait for one block: a time stamp beyond it is a mistake, not a date.
const MAX_WAIT_S: f64 = 1e9;

/// Plays until the end, an error or the stop, and tells the shard which.
pub fn run(
    settings: &replay::Settings,
    open: &mut dyn FnMut() -> Result<Stream, ReplayError>,
    link: &Link,
    stop: &Stop,
    recording: Option<Recording>,
) {
    let started = super::now();
    let recording = RefCell::new(recording);
    let mut wait = |due_s: f64| {
        // A time that cannot be waited for (NaN, before the start) is due at once.
        let due = Duration::try_from_secs_f64(due_s.min(MAX_WAIT_S)).unwrap_or_default();
        let due = started + due;
        loop {
            let flush_due = recording.borrow().as_ref().and_then(Recording::flush_due);
            if stop.wait_until(flush_due.map_or(due, |flush_due| flush_due.min(due))) {
                return ControlFlow::Break(());
            }
            if flush_due.is_none_or(|flush_due| flush_due > due) {
                return ControlFlow::Continue(());
            }
            if let Some(recording) = recording.borrow_mut().as_mut() {
                recording.tick();
            }
        }
    };
    let mut sink = |step| {
        let input = match step {
            Step::Block(block) => Input::Block(block, super::now()),
            Step::Received(run) => {
                if let Some(recording) = recording.borrow_mut().as_mut() {
                    recording.take(run);
                }
                return ControlFlow::Continue(());
            }
            Step::Rejected { n_samples, reason } => Input::Rejected { n_samples, reason },
            Step::End => return ControlFlow::Continue(()),
        };
        if link.send(input).is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let played =
        catch_unwind(AssertUnwindSafe(|| replay::run(settings, open, &mut wait, &mut sink)));
    // However it ended: what was received is on the disk before anybody hears of the end.
    if let Some(recording) = recording.into_inner() {
        recording.finish();
    }
    let state = match played {
        Ok(Ok(End::Stopped)) => return,
        Ok(Ok(End::Finished)) => SourceState::Finished,
        Ok(Err(error)) => SourceState::Failed(with_causes(&error)),
        Err(_) => SourceState::Failed("internal error while reading, see the log".to_owned()),
    };
    // Closed: the daemon is stopping, and nobody is left to tell.
    let _closed = link.send(Input::Source(state));
}

/// An error's message followed by those of its causes.
#[must_use]
pub fn with_causes(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}
