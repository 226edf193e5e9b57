//! A source's thread: plays a capture into its machine's link, paced by the clock.

use super::link::Input;
use super::link::Link;
use super::stop::Stop;
use crate::api::view::SourceState;
use crate::ingest::replay;
use crate::ingest::replay::End;
use crate::ingest::replay::ReplayError;
use crate::ingest::replay::Step;
use crate::ingest::replay::Stream;
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
) {
    let started = super::now();
    let mut wait = |due_s: f64| {
        // A time that cannot be waited for (NaN, before the start) is due at once.
        let due = Duration::try_from_secs_f64(due_s.min(MAX_WAIT_S)).unwrap_or_default();
        if stop.wait_until(started + due) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let mut sink = |step| {
        let input = match step {
            Step::Block(block) => Input::Block(block, super::now()),
            Step::Rejected { n_samples, reason } => Input::Rejected { n_samples, reason },
            Step::End => return ControlFlow::Continue(()),
        };
        if link.send(input).is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let played =
        catch_unwind(AssertUnwindSafe(|| replay::run(settings, open, &mut wait, &mut sink)));
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
