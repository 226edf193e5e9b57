//! A replay's thread: plays a capture into its machine's link, paced by the clock.

use super::link::Link;
use super::outlet::Outlet;
use super::recording::Recording;
use super::stop::Stop;
use crate::api::view::SourceState;
use crate::causes::with_causes;
use crate::ingest::replay;
use crate::ingest::replay::End;
use crate::ingest::replay::ReplayError;
use crate::ingest::replay::Stream;

/// Plays until the end, an error or the stop, and tells the shard which.
pub fn run(
    settings: &replay::Settings,
    open: &mut dyn FnMut() -> Result<Stream, ReplayError>,
    link: &Link,
    stop: &Stop,
    (recording, is_captured): (Option<Recording>, bool),
) {
    Outlet::new(link, stop, recording, is_captured).run(|outlet| {
        let mut wait = |due_s| outlet.wait(due_s);
        match replay::run(settings, open, &mut wait, &mut |step| outlet.take(step)) {
            Ok(End::Stopped) => None,
            Ok(End::Finished) => Some(SourceState::Finished),
            Err(error) => Some(SourceState::Failed(with_causes(&error))),
        }
    });
}
