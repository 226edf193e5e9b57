//! What must survive a restart: alarms, what happened to them, who did what, which configuration ran.
//!
//! [`StateStore`] is what the daemon writes and [`Archive`] what it reads; [`sqlite`] is the one place
//! that knows which database stands behind them. [`writer`] groups what comes into commits and keeps
//! what could not be stored. Must not decide anything about alarms, read the clock or start threads.

mod advance;
pub mod audit;
mod baselines;
mod decisions;
mod happened;
pub mod events;
pub mod captures;
pub mod backup;
pub mod feedback;
mod keep;
mod names;
mod opening;
mod rows;
mod schema;
pub mod sqlite;
pub mod writer;
pub mod trends;

pub use baselines::SqliteBaselines;
pub use keep::{KeepError, keep, take_away, use_again};

use crate::alarms::Advance;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::Decisions;
use crate::alarms::Kept;
use crate::alarms::Moment;
use crate::alarms::Signature;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::signed::Signed;
use crate::notify::HealthChange;
use crate::signal::Timestamp;
use events::ConfigurationChange;
use events::MaintenanceChange;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

/// A stream of a machine, as far as the store must tell it from others.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StreamKey {
    /// What makes it the same stream after a restart, such as a capture that is played again; `None`: it
    /// never comes again.
    pub identity: Option<String>,
    /// UTC of stream time 0; `None`: unknown.
    pub start: Option<Timestamp>,
    /// Hash of the configuration it is judged by: delays of another one are not taken up.
    pub judged_by: Option<String>,
}

/// What happened to the alarms of a machine at once: stored as a whole or not at all.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// Machine id; empty: it concerns the daemon as a whole.
    pub machine: String,
    /// Its stream.
    pub stream: StreamKey,
    /// When.
    pub now: Moment,
    /// Stream time up to which the stream is judged, s; `None`: it is not yet.
    pub judged_until_s: Option<f64>,
    /// The events, by rising number.
    pub events: Vec<AlarmEvent>,
    /// What changed in the health of the machine and its components.
    pub health: Vec<HealthChange>,
    /// All alarms that stand, when events before these may be lost.
    pub standing: Option<Vec<Alarm>>,
    /// Delays and hysteresis as they are at `judged_until_s`.
    pub decisions: Option<Decisions>,
    /// All silences in advance that hold and the highest number so far, if they changed.
    pub advance: Option<(Vec<Advance>, u64)>,
    /// What was done beside alarms, by whom: lines of the audit.
    pub acts: Vec<(&'static str, Signature)>,
    /// What became of the maintenance of the machine.
    pub maintenance: Vec<MaintenanceChange>,
    /// What became of a configuration.
    pub configuration: Vec<ConfigurationChange>,
    /// The configuration that holds from now on.
    pub holds: Option<ConfigurationEntry>,
}

impl Batch {
    /// These events of a machine, at the beginning of a stream of which nothing else is known.
    #[must_use]
    pub fn new(machine: &str, events: Vec<AlarmEvent>) -> Self {
        Self {
            machine: machine.to_owned(),
            stream: StreamKey::default(),
            now: Moment::of_stream(0.0),
            judged_until_s: None,
            events,
            health: Vec::new(),
            standing: None,
            decisions: None,
            advance: None,
            acts: Vec::new(),
            maintenance: Vec::new(),
            configuration: Vec::new(),
            holds: None,
        }
    }

    /// Things that happened.
    #[must_use]
    pub fn len(&self) -> usize {
        self.events.len() + self.health.len() + self.maintenance.len() + self.configuration.len()
    }

    /// Whether nothing happened.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Which events to read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventQuery {
    /// Of this machine.
    pub machine: String,
    /// With a number below this one.
    pub before: u64,
    /// At this time or later; events of streams without a start are at 1970-01-01 and their stream time.
    pub since: Option<Timestamp>,
    /// Of this component.
    pub component: Option<String>,
    /// Of this alarm.
    pub alarm: Option<u64>,
    /// At most so many.
    pub limit: usize,
    /// UTC of stream time 0 that the times of the answer shall count from.
    pub start: Option<Timestamp>,
}

/// A configuration that ran.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigurationEntry {
    /// Its hash.
    pub hash: String,
    /// Version of the program.
    pub version: String,
    /// When it was first used, UTC.
    pub since: Timestamp,
}

/// The writing side.
pub trait StateStore: Send {
    /// Stores all batches in one commit; when it returns, they survive a kill. A batch whose events are
    /// stored already changes nothing.
    ///
    /// # Errors
    /// When they cannot be stored; nothing of them is then.
    fn keep(&mut self, batches: &[Batch]) -> Result<(), StoreError>;

    /// Notes that a configuration is in use.
    ///
    /// # Errors
    /// When it cannot be stored.
    fn note_configuration(&mut self, entry: &ConfigurationEntry) -> Result<(), StoreError>;
}

/// The reading side.
pub trait Archive: Send + Sync {
    /// What the engine of a machine goes on with, at most `history_len` events of it.
    ///
    /// # Errors
    /// When it cannot be read.
    fn load(
        &self,
        machine: &str,
        stream: &StreamKey,
        now: Moment,
        history_len: usize,
    ) -> Result<Kept, StoreError>;

    /// Events, by falling number.
    ///
    /// # Errors
    /// When they cannot be read.
    fn events(&self, query: &EventQuery) -> Result<Vec<AlarmEvent>, StoreError>;

    /// Number of the oldest event held of a machine; `None`: none is held.
    ///
    /// # Errors
    /// When it cannot be read.
    fn oldest(&self, machine: &str) -> Result<Option<u64>, StoreError>;

    /// Configurations that ran, newest first.
    ///
    /// # Errors
    /// When they cannot be read.
    fn configurations(&self) -> Result<Vec<ConfigurationEntry>, StoreError>;
}

/// A baseline as it is held.
#[derive(Debug, Clone, PartialEq)]
pub struct Held {
    /// The baseline.
    pub signed: Signed,
    /// Whether it is used.
    pub is_active: bool,
    /// Whether it is as it was signed; one that is not is never used.
    pub is_intact: bool,
}

/// Who does something to a baseline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Act<'a> {
    /// Who.
    pub author: &'a str,
    /// Why.
    pub comment: &'a str,
    /// When, UTC.
    pub at: Timestamp,
}

/// Signed baselines. Each act is stored with its line in the audit when it returns.
pub trait BaselineStore: Send + Sync {
    /// The baselines of a machine, newest first.
    ///
    /// # Errors
    /// When they cannot be read.
    fn baselines(&self, machine: &str) -> Result<Vec<Held>, StoreError>;

    /// Stores a baseline and uses it instead of those in `replaced`.
    ///
    /// # Errors
    /// When it cannot be stored, also if its id is there already; nothing has changed then.
    fn learn(&self, signed: &Signed, replaced: &[Arc<str>]) -> Result<(), StoreError>;

    /// Uses baselines of a machine no more, because what was measured means something else now; they can be activated
    /// again.
    ///
    /// # Errors
    /// When that cannot be stored; nothing has changed then.
    fn retire(&self, machine: &str, ids: &[String], act: &Act<'_>) -> Result<(), StoreError>;

    /// Active baselines of a machine by id, with the machine file with which each was used last; `None`: not used since
    /// it was learned or activated.
    ///
    /// # Errors
    /// When they cannot be read.
    fn described(&self, machine: &str) -> Result<Vec<(String, Option<String>)>, StoreError>;

    /// Active baselines of a machine that were not used before are used with this machine file.
    ///
    /// # Errors
    /// When that cannot be stored.
    fn describe(&self, machine: &str, text: &str) -> Result<(), StoreError>;

    /// Uses a baseline of (machine, id) instead of those in `replaced`; false: there is none.
    ///
    /// # Errors
    /// When that cannot be stored; nothing has changed then.
    fn activate(
        &self,
        baseline: (&str, &str),
        replaced: &[Arc<str>],
        act: &Act<'_>,
    ) -> Result<bool, StoreError>;

    /// Removes a baseline of (machine, id); the audit keeps its id. False: there is none.
    ///
    /// # Errors
    /// When that cannot be stored; nothing has changed then.
    fn remove(&self, baseline: (&str, &str), act: &Act<'_>) -> Result<bool, StoreError>;

    /// A number that is another one when somebody else has changed the store.
    ///
    /// # Errors
    /// When it cannot be read.
    fn version(&self) -> Result<i64, StoreError>;

    /// A number that is a higher one after each act on a baseline of any machine, whoever did it.
    ///
    /// # Errors
    /// When it cannot be read.
    fn newest_act(&self) -> Result<i64, StoreError>;
}

/// Records of the active baselines of a machine; one that is not as it was signed is logged and left out.
///
/// # Errors
/// When they cannot be read.
pub fn active_records(store: &dyn BaselineStore, machine: &str) -> Result<Vec<Record>, StoreError> {
    let mut records = Vec::new();
    for held in store.baselines(machine)?.into_iter().filter(|held| held.is_active) {
        if held.is_intact {
            records.extend(held.signed.records);
        } else {
            let id = &*held.signed.id;
            tracing::error!(machine, id, "a baseline is not as it was signed and is not used");
        }
    }
    Ok(records)
}

/// Why the store cannot be opened, written or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder cannot be made or written.
    #[error(
        "the store's folder {} cannot be used: choose another in [store] directory, or give this user \
         the right to write there",
        directory.display()
    )]
    Folder {
        /// The folder.
        directory: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another process has it.
    #[error(
        "{} is in use by another process: a store belongs to one daemon, end the other or choose \
         another [store] directory",
        file.display()
    )]
    InUse {
        /// The lock.
        file: PathBuf,
    },
    /// Part of it may be missing.
    #[error(
        "a restore into {} was cut off: restore it again with --force; what was there before is in a folder \
         before-restore-… in it",
        directory.display()
    )]
    Unfinished {
        /// The folder.
        directory: PathBuf,
    },
    /// A daemon of another version has it.
    #[error(
        "{} is in use by a daemon whose schema is {found}, and this program's is {known}: use the \
         program of the daemon, or end the daemon first",
        file.display()
    )]
    OtherVersion {
        /// The database.
        file: PathBuf,
        /// Its schema.
        found: u32,
        /// The schema of this program.
        known: u32,
    },
    /// It is damaged.
    #[error(
        "{} is damaged ({found}): restore a backup{}, or move it and its -wal and -shm away to begin with \
         no alarms and no history",
        file.display(),
        named(backup.as_ref())
    )]
    Corrupt {
        /// The database.
        file: PathBuf,
        /// What was found.
        found: String,
        /// A backup beside it.
        backup: Option<PathBuf>,
    },
    /// It is no store of this program.
    #[error("{} is a database of another program: choose another [store] directory", file.display())]
    Foreign {
        /// The database.
        file: PathBuf,
    },
    /// A newer program wrote it.
    #[error(
        "{} has schema {found}, and this program knows up to {known}: start the newer program, or restore \
         the backup that it made before it changed the schema{}",
        file.display(),
        named(backup.as_ref())
    )]
    Newer {
        /// The database.
        file: PathBuf,
        /// Its schema.
        found: u32,
        /// The newest schema known.
        known: u32,
        /// A backup beside it that this program can read.
        backup: Option<PathBuf>,
    },
    /// The schema cannot be brought up to date; the database is unchanged.
    #[error("{} cannot be brought from schema {from} to {to}, it is unchanged", file.display())]
    Migration {
        /// The database.
        file: PathBuf,
        /// Its schema.
        from: u32,
        /// The wanted one.
        to: u32,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A file of trends that a newer program wrote.
    #[error(
        "{} has trends of schema {found}, and this program knows up to {known}: start the newer program, or \
         move the file away; until then its trends are neither written nor read, and alarms go on",
        file.display()
    )]
    NewerTrends {
        /// The file.
        file: PathBuf,
        /// Its schema.
        found: u32,
        /// The newest schema known.
        known: u32,
    },
    /// A file of trends is damaged.
    #[error(
        "{} is damaged ({found}): restore it from a backup or move it away; trends of its time are lost, \
         alarms go on",
        file.display()
    )]
    DamagedTrends {
        /// The file.
        file: PathBuf,
        /// What was found.
        found: String,
    },
    /// More was asked for than one answer holds.
    #[error(
        "the answer would have more than {max} points: ask for a shorter span or a coarser tier"
    )]
    TooMuch {
        /// Most points.
        max: usize,
    },
    /// A row says what this program does not know.
    #[error("the store holds {what} {found:?}, which this program does not know")]
    Unknown {
        /// What it should be.
        what: &'static str,
        /// What was found.
        found: String,
    },
    /// The database refused.
    #[error("{doing} failed: {source}")]
    Database {
        /// What was attempted.
        doing: &'static str,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

fn named(backup: Option<&PathBuf>) -> String {
    backup.map_or(String::new(), |backup| format!(" ({})", backup.display()))
}

#[cfg(test)]
mod baselines_tests;
#[cfg(test)]
mod captures_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod writer_tests;
