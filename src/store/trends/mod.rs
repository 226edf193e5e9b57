//! The history of what was measured and judged: every window, and minutes and hours of it.
//!
//! A [`Minute`] is what one stream of a machine said in one minute; it is stored as a whole, and storing
//! it again changes nothing. [`TrendStore`] is what the daemon writes and [`TrendArchive`] what it reads.
//! Windows lie in a file a day, minutes (smallest, mean, largest) in one a month, hours in one a
//! year; what is too old goes file by file. Nothing is interpolated: what is not there is a gap. Must not
//! decide anything about alarms, read the clock or start threads.

mod codec;
mod block;
mod windows;
mod minute;
mod period;
mod open;
mod file;
mod roll;
mod settled;
mod retention;
mod sqlite;
mod read;
mod table;
pub mod queue;

pub use minute::ChannelMinute;
pub use minute::Minute;
pub use period::Tier;
pub use read::SqliteTrendArchive;
pub use retention::Holdings;
pub use retention::Projection;
pub use retention::Retention;
pub use retention::project;
pub use roll::numbers_of;
pub use sqlite::FOLDER;
pub use sqlite::SqliteTrends;
pub use sqlite::features_per_channel;
pub use table::Column;
pub use table::Table;

use super::StoreError;
use crate::diagnosis::fault::ComponentKind;
use crate::signal::Timestamp;
use crate::units::Unit;
use std::ops::ControlFlow;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// The files of trends in a folder.
pub(super) fn files(folder: &Path) -> Vec<PathBuf> {
    retention::files(folder).into_iter().map(|(_, path)| path).collect()
}

/// Whether a file that nobody has open is one of trends, whole and not of a newer program.
pub(super) fn check_copy(path: &Path) -> Result<(), StoreError> {
    open::check_copy(path)
}

/// Name and unit of a feature.
pub type FeatureName = (Arc<str>, Unit);

/// What a trend is of.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The features of a channel.
    Channel(String),
    /// The verdicts on a component: [`STATE`], [`SEVERITY`] and [`CONFIDENCE`].
    Component(ComponentKind, String),
}

/// State of a component as a number: 1 healthy, 2 warning, 3 damaged; none where it was not judged. The
/// largest of a stretch is the worst.
pub const STATE: &str = "state";

/// Severity of a component.
pub const SEVERITY: &str = "severity";

/// Confidence of a verdict.
pub const CONFIDENCE: &str = "confidence";

/// Which trend to read.
#[derive(Debug, Clone, PartialEq)]
pub struct TrendQuery {
    /// Of this machine.
    pub machine: String,
    /// Of what.
    pub subject: Subject,
    /// At this time or later. Of streams without a start only the newest is read; its times are at
    /// 1970-01-01 and its stream time, as those of alarms.
    pub from: Timestamp,
    /// Before this time.
    pub to: Timestamp,
    /// How finely.
    pub tier: Tier,
    /// Of these features; `None`: of all.
    pub features: Option<Vec<String>>,
    /// UTC of stream time 0 that the times of the answer count from; `None`: from 1970-01-01.
    pub origin: Option<Timestamp>,
}

/// What was stored of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Kept {
    /// Points (a window in a channel) that are new.
    pub n_new: u64,
    /// Points that were stored already.
    pub n_again: u64,
}

/// The writing side.
pub trait TrendStore: Send {
    /// Stores minutes; when it returns they survive a kill. Windows that are stored already change
    /// nothing.
    ///
    /// # Errors
    /// When they cannot be stored; they may be offered again as they are.
    fn keep(&mut self, minutes: &[Minute], now: Timestamp) -> Result<Kept, StoreError>;

    /// Does a piece of what is not urgent: minutes and hours of what is complete, and returning the log to
    /// the files. Gives whether there is more to do at once.
    ///
    /// # Errors
    /// When it cannot be done; it is taken up again by the next call.
    fn tidy(&mut self, now: Timestamp) -> Result<bool, StoreError>;

    /// Removes files that are too old, or the oldest while all take more than `max_bytes`.
    fn prune(&mut self, now: Timestamp, max_bytes: u64) -> Holdings;

    /// Keeps everything for so long from now on; what is too old goes with the next [`Self::prune`].
    fn retain(&mut self, retention: Retention);
}

/// The reading side.
pub trait TrendArchive: Send + Sync {
    /// The trend asked for, times rising.
    ///
    /// # Errors
    /// When it cannot be read, or is more than one answer holds.
    fn trend(&self, query: &TrendQuery) -> Result<Table, StoreError>;

    /// What was stored of a machine between two times, minute by minute in the order of time; `each` may end
    /// it. Gives the files that could not be read, with the reason.
    ///
    /// # Errors
    /// When it cannot be read.
    fn minutes(
        &self,
        machine: &str,
        span: (Timestamp, Timestamp),
        each: &mut dyn FnMut(&Minute) -> ControlFlow<()>,
    ) -> Result<Vec<String>, StoreError>;

    /// Everything that trends of a machine are held of, in any tier.
    ///
    /// # Errors
    /// When it cannot be read.
    fn subjects(&self, machine: &str) -> Result<Vec<Subject>, StoreError>;

    /// Times between which a machine has anything in a tier; `None`: nothing.
    ///
    /// # Errors
    /// When it cannot be read.
    fn span(&self, machine: &str, tier: Tier)
    -> Result<Option<(Timestamp, Timestamp)>, StoreError>;
}

/// The tier that suits a span: the finest of which it is not too much, or a coarser one where that reaches
/// further back.
///
/// # Errors
/// When the archive cannot be read.
pub fn tier_for(
    archive: &dyn TrendArchive,
    machine: &str,
    (from, to): (Timestamp, Timestamp),
) -> Result<Tier, StoreError> {
    const DAY_NS: i64 = 86_400_000_000_000;
    let span_ns = to.0.saturating_sub(from.0);
    let mut tier = if span_ns <= DAY_NS {
        Tier::Windows
    } else if span_ns <= 31 * DAY_NS {
        Tier::Minutes
    } else {
        Tier::Hours
    };
    while let Some(coarser) = tier.coarser() {
        let Some((held_from, _)) = archive.span(machine, tier)? else { break };
        let further = archive.span(machine, coarser)?.is_some_and(|(coarser_from, _)| {
            // A block may begin before its first point.
            coarser_from.0.saturating_add(coarser.block_s() * 1_000_000_000) < held_from.0
        });
        if held_from <= from || !further {
            break;
        }
        tier = coarser;
    }
    Ok(tier)
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod retention_tests;
