//! The index of captures: what was captured when and for which alarm, or why an alarm has none.
//!
//! [`CaptureIndex`] is what the daemon writes and reads; each act is one commit: when it returns, it survives a kill.
//! Must not know the files.

use super::Act;
use super::StoreError;
use super::opening;
use super::opening::failed;
use super::rows;
use super::rows::whole;
use super::sqlite;
use crate::signal::Timestamp;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Row;
use rusqlite::Transaction;
use rusqlite::params;
use std::path::Path;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;

/// Entries of captures that are gone, and of alarms without one, that are kept.
const MAX_ENTRIES: i64 = 100_000;

/// How a capture is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaptureState {
    /// It is being written.
    Writing,
    /// It is whole.
    Complete,
    /// Its writing was cut off; what had reached the disk is there.
    Recovered,
    /// Its file gave way to newer ones, or was taken away.
    Removed,
    /// There is no file that can be used.
    Failed,
}

impl CaptureState {
    /// All states.
    pub const ALL: [Self; 5] =
        [Self::Writing, Self::Complete, Self::Recovered, Self::Removed, Self::Failed];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Writing => "writing",
            Self::Complete => "complete",
            Self::Recovered => "recovered",
            Self::Removed => "removed",
            Self::Failed => "failed",
        }
    }

    /// Whether there should be a file.
    #[must_use]
    pub fn has_file(self) -> bool {
        match self {
            Self::Writing | Self::Complete | Self::Recovered => true,
            Self::Removed | Self::Failed => false,
        }
    }
}

/// A capture.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureEntry {
    /// Its id: the name of its file without the ending.
    pub id: String,
    /// Machine id.
    pub machine: String,
    /// Number within the machine.
    pub number: u64,
    /// Who asked for it and why; `None`: an alarm did.
    pub by: Option<(String, String)>,
    /// When it was asked for, UTC.
    pub requested: Timestamp,
    /// UTC of stream time 0, if known.
    pub start: Option<Timestamp>,
    /// Stream time at which it was asked for, s.
    pub trigger_s: f64,
    /// Stream time it covers, s, as far as it is known.
    pub span_s: (Option<f64>, Option<f64>),
    /// How it is doing.
    pub state: CaptureState,
    /// What is to be known of it.
    pub note: Option<String>,
    /// Bytes of its file.
    pub bytes: u64,
    /// Windows it holds with everything needed to judge them again.
    pub n_windows: u64,
    /// The alarms it was made for.
    pub alarms: Vec<u64>,
}

/// How a capture ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Ending {
    /// How it is doing then.
    pub state: CaptureState,
    /// What is to be known of it; what was noted before stays if this is `None`.
    pub note: Option<String>,
    /// Bytes of its file; `None`: as they were.
    pub bytes: Option<u64>,
    /// Stream time it ends at, s.
    pub to_s: Option<f64>,
}

/// Which captures to list.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CaptureQuery {
    /// Of these machines only.
    pub machines: Option<Vec<String>>,
    /// Of this alarm of the machine only.
    pub alarm: Option<u64>,
    /// Those before the one with this id.
    pub after: Option<String>,
    /// At most so many.
    pub limit: usize,
}

/// The capture of an alarm, or why it has none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CaptureLink {
    /// It has one, which is doing so.
    Has(String, CaptureState),
    /// It has none.
    None(String),
}

/// The index of captures.
pub trait CaptureIndex: Send + Sync {
    /// Notes that a capture is begun; one an operator asked for with its line in the audit.
    ///
    /// # Errors
    /// When it cannot be stored; nothing has changed then.
    fn begin(&self, entry: &CaptureEntry) -> Result<(), StoreError>;

    /// Notes how a capture ended; an id that is not there is none.
    ///
    /// # Errors
    /// When it cannot be stored.
    fn end(&self, id: &str, ending: &Ending) -> Result<(), StoreError>;

    /// Notes why alarms of a machine have no capture.
    ///
    /// # Errors
    /// When it cannot be stored.
    fn refuse(
        &self,
        machine: &str,
        alarms: &[u64],
        reason: &str,
        at: Timestamp,
    ) -> Result<(), StoreError>;

    /// Captures, newest first.
    ///
    /// # Errors
    /// When they cannot be read.
    fn list(&self, query: &CaptureQuery) -> Result<Vec<CaptureEntry>, StoreError>;

    /// One capture.
    ///
    /// # Errors
    /// When it cannot be read.
    fn find(&self, id: &str) -> Result<Option<CaptureEntry>, StoreError>;

    /// The newest captures of alarms of (machine, number), in their order; `None`: nothing is known of it.
    ///
    /// # Errors
    /// When they cannot be read.
    fn links(&self, alarms: &[(String, u64)]) -> Result<Vec<Option<CaptureLink>>, StoreError>;

    /// The highest number of a machine's captures; 0: it has none.
    ///
    /// # Errors
    /// When it cannot be read.
    fn highest(&self, machine: &str) -> Result<u64, StoreError>;
}

/// The index in the state database, on a connection of its own.
#[derive(Debug)]
pub struct SqliteCaptures {
    connection: Mutex<Connection>,
}

impl SqliteCaptures {
    /// Joins the database in `directory`, which this process has open.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn join(directory: &Path) -> Result<Self, StoreError> {
        let connection = opening::beside(&directory.join(sqlite::FILE))?;
        Ok(Self { connection: Mutex::new(connection) })
    }

    /// The connection is consistent between any two statements, so a poisoned lock is as good.
    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn commit(
        &self,
        work: impl FnOnce(&Transaction<'_>) -> rusqlite::Result<()>,
    ) -> Result<(), StoreError> {
        let mut connection = self.connection();
        let done = || -> rusqlite::Result<()> {
            let transaction = connection.transaction()?;
            work(&transaction)?;
            transaction.commit()
        };
        done().map_err(|source| failed("storing a capture's entry", source))
    }
}

const COLUMNS: &str = "id, machine, number, author, comment, requested_utc, start_utc, trigger_s, from_s, to_s, \
                       state, note, bytes, windows";

fn link(
    transaction: &Transaction<'_>,
    machine: &str,
    alarms: &[u64],
    (capture, reason): (Option<&str>, Option<&str>),
    at: Timestamp,
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO alarm_capture (machine, number, capture, reason, recorded_utc) VALUES (?1, ?2, ?3, ?4, ?5)
         ON CONFLICT (machine, number) DO UPDATE SET capture = coalesce(excluded.capture, capture),
            reason = excluded.reason, recorded_utc = excluded.recorded_utc",
    )?;
    let mut keep = transaction.prepare_cached(
        "INSERT OR IGNORE INTO capture_alarm (capture, machine, number) VALUES (?1, ?2, ?3)",
    )?;
    for alarm in alarms {
        insert.execute(params![machine, whole(*alarm), capture, reason, at.0])?;
        if let Some(capture) = capture {
            keep.execute(params![capture, machine, whole(*alarm)])?;
        }
    }
    Ok(())
}

/// Forgets the oldest of what has no file.
fn prune(transaction: &Transaction<'_>) -> rusqlite::Result<()> {
    let n_gone = transaction.execute(
        "DELETE FROM capture WHERE seq <= (SELECT max(seq) FROM capture) - ?1
         AND state IN ('removed', 'failed')",
        [MAX_ENTRIES],
    )?;
    if n_gone > 0 {
        transaction.execute(
            "DELETE FROM capture_alarm WHERE capture NOT IN (SELECT id FROM capture)",
            (),
        )?;
    }
    transaction.execute(
        "DELETE FROM alarm_capture WHERE (machine, number) IN (SELECT machine, number FROM alarm_capture
         ORDER BY recorded_utc DESC LIMIT -1 OFFSET ?1)",
        [MAX_ENTRIES],
    )?;
    Ok(())
}

fn read(row: &Row<'_>) -> rusqlite::Result<(CaptureEntry, String)> {
    let count = |number: i64| u64::try_from(number).unwrap_or(0);
    let author: Option<String> = row.get(3)?;
    let comment: Option<String> = row.get(4)?;
    let entry = CaptureEntry {
        id: row.get(0)?,
        machine: row.get(1)?,
        number: count(row.get(2)?),
        by: author.map(|author| (author, comment.unwrap_or_default())),
        requested: Timestamp(row.get(5)?),
        start: row.get::<_, Option<i64>>(6)?.map(Timestamp),
        trigger_s: row.get(7)?,
        span_s: (row.get(8)?, row.get(9)?),
        state: CaptureState::Failed,
        note: row.get(11)?,
        bytes: count(row.get(12)?),
        n_windows: count(row.get(13)?),
        alarms: Vec::new(),
    };
    Ok((entry, row.get(10)?))
}

fn state(name: String) -> Result<CaptureState, StoreError> {
    let found = CaptureState::ALL.into_iter().find(|state| state.name() == name);
    found.ok_or(StoreError::Unknown { what: "a state of a capture", found: name })
}

fn alarms_of(connection: &Connection, id: &str) -> rusqlite::Result<Vec<u64>> {
    let mut statement = connection
        .prepare_cached("SELECT number FROM capture_alarm WHERE capture = ?1 ORDER BY number")?;
    let rows = statement.query_map([id], |row| row.get::<_, i64>(0))?;
    rows.map(|number| Ok(u64::try_from(number?).unwrap_or(0))).collect()
}

fn reading(source: rusqlite::Error) -> StoreError {
    failed("reading the index of captures", source)
}

fn whole_entry(
    connection: &Connection,
    (entry, name): (CaptureEntry, String),
) -> Result<CaptureEntry, StoreError> {
    let alarms = alarms_of(connection, &entry.id).map_err(reading)?;
    Ok(CaptureEntry { state: state(name)?, alarms, ..entry })
}

impl CaptureIndex for SqliteCaptures {
    fn begin(&self, entry: &CaptureEntry) -> Result<(), StoreError> {
        self.commit(|transaction| {
            let (author, comment) = match &entry.by {
                Some((author, comment)) => (Some(author), Some(comment)),
                None => (None, None),
            };
            transaction.execute(
                &format!(
                    "INSERT INTO capture ({COLUMNS})
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14)"
                ),
                params![
                    entry.id,
                    entry.machine,
                    whole(entry.number),
                    author,
                    comment,
                    entry.requested.0,
                    entry.start.map(|start| start.0),
                    entry.trigger_s,
                    entry.span_s.0,
                    entry.span_s.1,
                    entry.state.name(),
                    entry.note,
                    whole(entry.bytes),
                    whole(entry.n_windows)
                ],
            )?;
            let to = (Some(&*entry.id), None);
            link(transaction, &entry.machine, &entry.alarms, to, entry.requested)?;
            if let Some((author, comment)) = &entry.by {
                let act = Act { author, comment, at: entry.requested };
                transaction.execute(
                    "INSERT INTO audit (recorded_utc, author, action, machine, comment)
                     VALUES (?1, ?2, 'capture_requested', ?3, ?4)",
                    params![act.at.0, act.author, entry.machine, act.comment],
                )?;
            }
            prune(transaction)
        })
    }

    fn end(&self, id: &str, ending: &Ending) -> Result<(), StoreError> {
        let bytes = ending.bytes.map(whole);
        self.commit(|transaction| {
            transaction.execute(
                "UPDATE capture SET state = ?2, note = coalesce(?3, note), bytes = coalesce(?4, bytes),
                 to_s = coalesce(?5, to_s) WHERE id = ?1",
                params![id, ending.state.name(), ending.note, bytes, ending.to_s],
            )?;
            Ok(())
        })
    }

    fn refuse(
        &self,
        machine: &str,
        alarms: &[u64],
        reason: &str,
        at: Timestamp,
    ) -> Result<(), StoreError> {
        self.commit(|transaction| {
            link(transaction, machine, alarms, (None, Some(reason)), at)?;
            prune(transaction)
        })
    }

    fn list(&self, query: &CaptureQuery) -> Result<Vec<CaptureEntry>, StoreError> {
        let connection = self.connection();
        let read_all = || -> rusqlite::Result<Vec<(CaptureEntry, String)>> {
            let sql = format!(
                "SELECT {COLUMNS} FROM capture
                 WHERE (?1 IS NULL OR instr(?1, char(10) || machine || char(10)) > 0)
                 AND (?2 IS NULL OR id IN
                    (SELECT capture FROM capture_alarm WHERE number = ?2 AND machine = capture.machine))
                 AND (?3 IS NULL OR seq < (SELECT seq FROM capture AS last WHERE last.id = ?3))
                 ORDER BY seq DESC LIMIT ?4"
            );
            let mut statement = connection.prepare_cached(&sql)?;
            let limit = whole(query.limit as u64);
            let values = params![
                rows::names(query.machines.as_deref()),
                query.alarm.map(whole),
                query.after,
                limit
            ];
            statement.query_map(values, read)?.collect()
        };
        let found = read_all().map_err(reading)?;
        found.into_iter().map(|found| whole_entry(&connection, found)).collect()
    }

    fn find(&self, id: &str) -> Result<Option<CaptureEntry>, StoreError> {
        let connection = self.connection();
        let sql = format!("SELECT {COLUMNS} FROM capture WHERE id = ?1");
        let found = connection.query_row(&sql, [id], read).optional().map_err(reading)?;
        found.map(|found| whole_entry(&connection, found)).transpose()
    }

    fn links(&self, alarms: &[(String, u64)]) -> Result<Vec<Option<CaptureLink>>, StoreError> {
        let connection = self.connection();
        let one = |(machine, number): &(String, u64)| {
            let sql = "SELECT capture, reason, state FROM alarm_capture
                       LEFT JOIN capture ON capture.id = alarm_capture.capture
                       WHERE alarm_capture.machine = ?1 AND alarm_capture.number = ?2";
            let mut statement = connection.prepare_cached(sql).map_err(reading)?;
            let row = |row: &Row<'_>| {
                let all: (Option<String>, Option<String>, Option<String>) =
                    (row.get(0)?, row.get(1)?, row.get(2)?);
                Ok(all)
            };
            let found = statement.query_row(params![machine, whole(*number)], row).optional();
            Ok(match found.map_err(reading)? {
                None => None,
                Some((Some(id), _, Some(name))) => Some(CaptureLink::Has(id, state(name)?)),
                Some((id, reason, _)) => {
                    let gone = id.map(|id| format!("capture {id} is no longer known"));
                    Some(CaptureLink::None(reason.or(gone).unwrap_or_default()))
                }
            })
        };
        alarms.iter().map(one).collect()
    }

    fn highest(&self, machine: &str) -> Result<u64, StoreError> {
        let sql = "SELECT coalesce(max(number), 0) FROM capture WHERE machine = ?1";
        let found: rusqlite::Result<i64> =
            self.connection().query_row(sql, [machine], |row| row.get(0));
        Ok(u64::try_from(found.map_err(reading)?).unwrap_or(0))
    }
}
