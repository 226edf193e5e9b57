//! The state database: one SQLite file with a write-ahead log, every commit on the disk before it is
//! answered (`synchronous = FULL`).
//!
//! One connection writes, one reads (`opening` makes them).

use super::Archive;
use super::Batch;
use super::ConfigurationEntry;
use super::EventQuery;
use super::StateStore;
use super::StoreError;
use super::StreamKey;
use super::advance;
use super::decisions;
use super::events;
pub use super::opening::FILE;
use super::opening::alone;
use super::opening::beside;
use super::opening::failed;
use super::opening::reading;
use super::opening::with_place;
use super::rows;
use super::rows::Reader;
use super::rows::whole;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::Kept;
use crate::alarms::Moment;
use crate::signal::Timestamp;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Transaction;
use rusqlite::params;
use rusqlite::params_from_iter;
use rusqlite::types::Value;
use std::fs::File;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;

/// Transitions kept; older ones give way. About 0.25 GB.
const MAX_TRANSITIONS: i64 = 1_000_000;

/// Transitions between two looks at their number.
const LOOK_EVERY: u64 = 1000;

/// The writing connection.
#[derive(Debug)]
pub struct SqliteStore {
    connection: Connection,
    max_transitions: i64,
    n_since_look: u64,
    /// Held as long as the store is.
    _lock: File,
}

/// The reading connection.
#[derive(Debug)]
pub struct SqliteArchive {
    connection: Mutex<Connection>,
}

/// Opens the database in `directory`, makes both where they are missing and brings the schema up to date.
///
/// # Errors
/// When it cannot be used as it is; nothing was changed then.
pub fn open(directory: &Path) -> Result<(SqliteStore, SqliteArchive), StoreError> {
    let (connection, lock) = alone(directory)?;
    let file = directory.join(FILE);
    let reading = reading(&file).map_err(|error| with_place(error, &file))?;
    let store = SqliteStore {
        connection,
        max_transitions: MAX_TRANSITIONS,
        n_since_look: LOOK_EVERY,
        _lock: lock,
    };
    Ok((store, SqliteArchive { connection: Mutex::new(reading) }))
}

/// Opens the database in `directory` for reading alone, beside a daemon or without; `None`: there is none.
///
/// # Errors
/// When it cannot be used, or a daemon with another schema has it.
pub fn read_only(directory: &Path) -> Result<Option<SqliteArchive>, StoreError> {
    let file = directory.join(FILE);
    if !file.is_file() {
        return Ok(None);
    }
    // Without a daemon it is checked, and brought up to date.
    match alone(directory) {
        Ok(_) => {}
        Err(StoreError::InUse { .. }) => drop(beside(&file)?),
        Err(error) => return Err(error),
    }
    let reading = reading(&file).map_err(|error| with_place(error, &file))?;
    Ok(Some(SqliteArchive { connection: Mutex::new(reading) }))
}

impl SqliteStore {
    /// Folder's name of the database, for messages.
    #[must_use]
    pub fn path(&self) -> Option<PathBuf> {
        self.connection.path().map(PathBuf::from)
    }

    /// Removes the oldest transitions above the number kept.
    fn prune(transaction: &Transaction<'_>, max: i64) -> rusqlite::Result<()> {
        let newest: Option<i64> =
            transaction.query_row("SELECT max(rowid) FROM transition", (), |row| row.get(0))?;
        let last_gone = newest.unwrap_or(0).saturating_sub(max);
        transaction.execute("DELETE FROM transition WHERE rowid <= ?1", [last_gone])?;
        Ok(())
    }

    fn write(&mut self, batches: &[Batch]) -> rusqlite::Result<()> {
        let transaction = self.connection.transaction()?;
        let mut n_new = 0;
        for batch in batches {
            n_new += write_events(&transaction, batch)?;
            let of = (batch.machine.as_str(), batch.stream.start, batch.now.utc);
            events::write_health(&transaction, of, &batch.health)?;
            events::write_maintenance(&transaction, (of.0, of.2), &batch.maintenance)?;
            events::write_configuration(&transaction, batch.now.utc, &batch.configuration)?;
            if let Some(entry) = &batch.holds {
                write_holds(&transaction, entry)?;
            }
            n_new += (batch.len() - batch.events.len()) as u64;
            if batch.machine.is_empty() {
                continue;
            }
            if let Some(standing) = &batch.standing {
                transaction.execute("DELETE FROM alarm WHERE machine = ?1", [&batch.machine])?;
                for alarm in standing {
                    write_alarm(&transaction, batch, alarm)?;
                }
            }
            write_stream(&transaction, batch)?;
            advance::write(&transaction, batch)?;
            decisions::write(&transaction, batch)?;
        }
        let look = self.n_since_look + n_new >= LOOK_EVERY;
        if look {
            Self::prune(&transaction, self.max_transitions)?;
            events::prune(&transaction)?;
        }
        transaction.commit()?;
        self.n_since_look = if look { 0 } else { self.n_since_look + n_new };
        Ok(())
    }

    #[cfg(test)]
    pub(super) fn connection(&self) -> &Connection {
        &self.connection
    }

    #[cfg(test)]
    pub(super) fn keep_transitions(&mut self, max: i64) {
        self.max_transitions = max;
        self.n_since_look = LOOK_EVERY;
    }
}

/// Stores a batch's events and what they make of its alarms; gives the number that was not stored yet.
fn write_events(transaction: &Transaction<'_>, batch: &Batch) -> rusqlite::Result<u64> {
    let columns = format!("{}, {}", rows::EVENT, rows::ALARM);
    let mut insert = transaction.prepare_cached(&format!(
        "INSERT INTO transition ({columns}) VALUES ({}) ON CONFLICT (machine, sequence) DO NOTHING",
        rows::places(&columns)
    ))?;
    let mut audit = transaction.prepare_cached(
        "INSERT INTO audit (recorded_utc, author, action, machine, number, comment)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    )?;
    let mut n_new = 0;
    for event in &batch.events {
        let values = rows::event_values(&batch.machine, event, batch.stream.start, batch.now);
        if insert.execute(params_from_iter(values))? == 0 {
            continue;
        }
        n_new += 1;
        events::write_alarm(transaction, &batch.machine, event.sequence, batch.now.utc)?;
        if event.alarm.position().is_over() {
            transaction.execute(
                "DELETE FROM alarm WHERE machine = ?1 AND number = ?2",
                params![batch.machine, whole(event.alarm.id)],
            )?;
        } else {
            write_alarm(transaction, batch, &event.alarm)?;
        }
        if let Some(by) = &event.by {
            audit.execute(params![
                batch.now.utc.0,
                by.author,
                event.kind.name(),
                batch.machine,
                whole(event.alarm.id),
                by.comment
            ])?;
        }
    }
    Ok(n_new)
}

fn write_alarm(
    transaction: &Transaction<'_>,
    batch: &Batch,
    alarm: &Alarm,
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(&format!(
        "INSERT OR REPLACE INTO alarm (machine, {}) VALUES (?, {})",
        rows::ALARM,
        rows::places(rows::ALARM)
    ))?;
    let machine = Value::Text(batch.machine.clone());
    let values = rows::alarm_values(alarm, batch.stream.start, batch.now);
    insert.execute(params_from_iter(std::iter::once(machine).chain(values)))?;
    Ok(())
}

/// Notes how far the stream and its numbers have come; neither numbers ever go back.
fn write_stream(transaction: &Transaction<'_>, batch: &Batch) -> rusqlite::Result<()> {
    let sequence = batch.events.iter().map(|event| event.sequence).max().unwrap_or(0);
    let standing = batch.standing.iter().flatten();
    let numbers = batch.events.iter().map(|event| &event.alarm).chain(standing);
    let number = numbers.map(|alarm| alarm.id).max().unwrap_or(0);
    transaction.execute(
        "INSERT INTO stream (machine, identity, judged_until_s, last_sequence, last_number)
         VALUES (?1, ?2, ?3, ?4, ?5)
         ON CONFLICT (machine) DO UPDATE SET
            identity = excluded.identity, judged_until_s = excluded.judged_until_s,
            last_sequence = max(last_sequence, excluded.last_sequence),
            last_number = max(last_number, excluded.last_number)",
        params![
            batch.machine,
            batch.stream.identity,
            batch.judged_until_s.filter(|time_s| time_s.is_finite()),
            whole(sequence),
            whole(number)
        ],
    )?;
    Ok(())
}

/// Notes the configuration that holds, unless it is the newest already.
fn write_holds(connection: &Connection, entry: &ConfigurationEntry) -> rusqlite::Result<()> {
    let done = connection.execute(
        "INSERT INTO configuration (hash, version, since_utc) SELECT ?1, ?2, ?3 WHERE NOT EXISTS (
            SELECT 1 FROM (SELECT hash, version FROM configuration ORDER BY id DESC LIMIT 1)
            WHERE hash = ?1 AND version = ?2)",
        params![entry.hash, entry.version, entry.since.0],
    );
    done.map(drop)
}

impl StateStore for SqliteStore {
    fn keep(&mut self, batches: &[Batch]) -> Result<(), StoreError> {
        self.write(batches).map_err(|source| failed("storing alarms", source))
    }

    fn note_configuration(&mut self, entry: &ConfigurationEntry) -> Result<(), StoreError> {
        write_holds(&self.connection, entry)
            .map_err(|source| failed("storing the configuration's hash", source))
    }
}

impl SqliteArchive {
    /// The connection is consistent between any two statements, so a poisoned lock is as good.
    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read_events(
    connection: &Connection,
    query: &EventQuery,
    now: Moment,
) -> Result<Vec<AlarmEvent>, StoreError> {
    let reading = |source| failed("reading the history", source);
    let mut statement = connection
        .prepare_cached(&format!(
            "SELECT {}, {} FROM transition WHERE machine = ?1 AND sequence < ?2
             AND (?3 IS NULL OR component = ?3) AND (?4 IS NULL OR number = ?4)
             AND (?5 IS NULL OR coalesce(start_utc, 0) + time_s * 1e9 >= ?5)
             ORDER BY sequence DESC LIMIT ?6",
            rows::EVENT,
            rows::ALARM
        ))
        .map_err(reading)?;
    let mut rows = statement
        .query(params![
            query.machine,
            whole(query.before),
            query.component,
            query.alarm.map(whole),
            query.since.map(|since| since.0),
            i64::try_from(query.limit).unwrap_or(i64::MAX)
        ])
        .map_err(reading)?;
    let reader = Reader { start: query.start, now };
    let mut events = Vec::new();
    while let Some(row) = rows.next().map_err(reading)? {
        events.push(reader.event(row)?);
    }
    Ok(events)
}

impl Archive for SqliteArchive {
    fn load(
        &self,
        machine: &str,
        stream: &StreamKey,
        now: Moment,
        history_len: usize,
    ) -> Result<Kept, StoreError> {
        let reading = |source| failed("reading the alarms", source);
        let connection = self.connection();
        let known: Option<(Option<String>, Option<f64>, i64, i64)> = connection
            .query_row(
                "SELECT identity, judged_until_s, last_sequence, last_number FROM stream
                 WHERE machine = ?1",
                [machine],
                |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)),
            )
            .optional()
            .map_err(reading)?;
        let Some((identity, judged_until_s, last_sequence, last_id)) = known else {
            return Ok(Kept::default());
        };
        let is_same = identity.is_some() && identity == stream.identity;
        let mut statement = connection
            .prepare(&format!("SELECT {} FROM alarm WHERE machine = ?1", rows::ALARM))
            .map_err(reading)?;
        let mut found = statement.query([machine]).map_err(reading)?;
        let reader = Reader { start: stream.start, now };
        let mut alarms = Vec::new();
        while let Some(row) = found.next().map_err(reading)? {
            alarms.push(reader.alarm(row)?);
        }
        let query = EventQuery {
            machine: machine.to_owned(),
            before: u64::MAX,
            limit: history_len,
            start: stream.start,
            ..EventQuery::default()
        };
        let mut history = read_events(&connection, &query, now)?;
        history.reverse();
        let (advance, last_advance) = advance::read(&connection, machine, now)?;
        Ok(Kept {
            advance,
            last_advance,
            alarms,
            history,
            last_id: u64::try_from(last_id).unwrap_or(0),
            last_sequence: u64::try_from(last_sequence).unwrap_or(0),
            judged_until_s: judged_until_s.filter(|_| is_same),
            decisions: decisions::read(&connection, machine, stream)?,
        })
    }

    fn events(&self, query: &EventQuery) -> Result<Vec<AlarmEvent>, StoreError> {
        read_events(&self.connection(), query, Moment::of_stream(0.0))
    }

    fn oldest(&self, machine: &str) -> Result<Option<u64>, StoreError> {
        let oldest: Option<i64> = self
            .connection()
            .query_row(
                "SELECT min(sequence) FROM transition WHERE machine = ?1",
                [machine],
                |row| row.get(0),
            )
            .map_err(|source| failed("reading the history", source))?;
        Ok(oldest.and_then(|oldest| u64::try_from(oldest).ok()))
    }

    fn configurations(&self) -> Result<Vec<ConfigurationEntry>, StoreError> {
        let reading = |source| failed("reading the configurations", source);
        let connection = self.connection();
        let mut statement = connection
            .prepare(
                "SELECT hash, version, since_utc FROM configuration ORDER BY id DESC LIMIT 1000",
            )
            .map_err(reading)?;
        let entry = |row: &rusqlite::Row<'_>| {
            let since = Timestamp(row.get(2)?);
            Ok(ConfigurationEntry { hash: row.get(0)?, version: row.get(1)?, since })
        };
        let rows = statement.query_map((), entry).map_err(reading)?;
        rows.collect::<rusqlite::Result<_>>().map_err(reading)
    }
}
