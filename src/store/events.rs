//! One log of what happened, alarms and health, by its place; and how far each receiver has come in it.
//!
//! A place is given in the commit that stores what happened, rises, and is never given again. Reading and
//! what receivers keep go over a connection of their own, beside that of the alarms.

pub use super::happened::ConfigurationChange;
pub use super::happened::ConfigurationOutcome;
pub use super::happened::Happened;
pub use super::happened::LogEntry;
pub use super::happened::MaintenanceChange;
pub use super::happened::MaintenanceOutcome;

use super::StoreError;
use super::names;
use super::opening;
use super::opening::failed;
use super::rows;
use super::rows::Reader;
use super::rows::whole;
use super::sqlite;
use crate::alarms::AlarmEvent;
use crate::alarms::Moment;
use crate::notify::Health;
use crate::notify::HealthChange;
use crate::notify::Progress;
use crate::notify::Subject;
use crate::signal::Timestamp;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Row;
use rusqlite::Transaction;
use rusqlite::params;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;

/// Alarm events kept in the log; as many as transitions are.
const MAX_ALARM_EVENTS: i64 = 1_000_000;

/// Changes of health kept in the log.
const MAX_HEALTH_CHANGES: i64 = 100_000;

/// What stands as the kind of an entry that is neither of an alarm nor of health.
const CONFIGURATION: &str = "configuration";
const MAINTENANCE: &str = "maintenance";

/// Which places the log has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Extent {
    /// The newest place; 0: nothing has happened.
    pub newest: u64,
    /// Entries up to this place may have been removed.
    pub removed_until: u64,
}

/// The reading side of the log.
pub trait EventLog: Send + Sync {
    /// The entries after a place, oldest first, at most `limit`.
    ///
    /// # Errors
    /// When they cannot be read.
    fn after(&self, place: u64, limit: usize) -> Result<Vec<LogEntry>, StoreError>;

    /// Which places there are.
    ///
    /// # Errors
    /// When that cannot be read.
    fn extent(&self) -> Result<Extent, StoreError>;

    /// The health of a machine as it was last told.
    ///
    /// # Errors
    /// When it cannot be read.
    fn health(&self, machine: &str) -> Result<BTreeMap<Subject, Health>, StoreError>;
}

/// How far receivers have come.
pub trait Receivers: Send + Sync {
    /// Progress of a receiver; one that is new begins at the newest place.
    ///
    /// # Errors
    /// When it cannot be read or stored.
    fn begin(&self, name: &str) -> Result<Progress, StoreError>;

    /// Keeps a receiver's progress; when it returns, it survives a kill.
    ///
    /// # Errors
    /// When it cannot be stored.
    fn keep(&self, name: &str, progress: &Progress) -> Result<(), StoreError>;

    /// Forgets all receivers but these; gives those forgotten.
    ///
    /// # Errors
    /// When that cannot be stored.
    fn forget_others(&self, names: &[&str]) -> Result<Vec<String>, StoreError>;
}

/// The log in the state database.
#[derive(Debug)]
pub struct SqliteEvents {
    connection: Mutex<Connection>,
}

impl SqliteEvents {
    /// Joins the database in `directory`, which this process has open.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn join(directory: &Path) -> Result<Self, StoreError> {
        let connection = opening::beside(&directory.join(sqlite::FILE))?;
        Ok(Self { connection: Mutex::new(connection) })
    }

    /// The connection is consistent between any two statements, so a poisoned lock is as good.
    pub(super) fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Gives a transition that was just stored its place.
pub(super) fn write_alarm(
    transaction: &Transaction<'_>,
    machine: &str,
    sequence: u64,
    recorded: Timestamp,
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO event (machine, recorded_utc, sequence) VALUES (?1, ?2, ?3)",
    )?;
    insert.execute(params![machine, recorded.0, whole(sequence)]).map(drop)
}

/// Stores changes of health, and what is told last.
pub(super) fn write_health(
    transaction: &Transaction<'_>,
    (machine, start, recorded): (&str, Option<Timestamp>, Timestamp),
    changes: &[HealthChange],
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO event (machine, recorded_utc, start_utc, time_s, kind, component, state, before, fault,
            severity, confidence, why)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
    )?;
    let mut tell = transaction.prepare_cached(
        "INSERT OR REPLACE INTO health (machine, kind, component, state, fault) VALUES (?1, ?2, ?3, ?4, ?5)",
    )?;
    for change in changes {
        let (kind, component) = subject_texts(&change.subject);
        let state = change.health.state.name();
        let fault = change.health.fault.map(|fault| fault.name());
        insert.execute(params![
            machine,
            recorded.0,
            start.map(|start| start.0),
            if change.time_s.is_finite() { change.time_s } else { 0.0 },
            kind,
            component,
            state,
            change.before.map(|before| before.name()),
            fault,
            change.severity,
            change.confidence,
            change.why
        ])?;
        tell.execute(params![machine, kind, component, state, fault])?;
    }
    Ok(())
}

/// Stores what became of a configuration.
pub(super) fn write_configuration(
    transaction: &Transaction<'_>,
    recorded: Timestamp,
    changes: &[ConfigurationChange],
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO event (machine, recorded_utc, kind, component, state, why)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    )?;
    for change in changes {
        let (hash, outcome) = (&change.hash, change.outcome.name());
        let machine = change.machine.as_deref().unwrap_or_default();
        insert.execute(params![machine, recorded.0, CONFIGURATION, hash, outcome, change.text])?;
    }
    Ok(())
}

/// Stores what became of the maintenance of a machine.
pub(super) fn write_maintenance(
    transaction: &Transaction<'_>,
    (machine, recorded): (&str, Timestamp),
    changes: &[MaintenanceChange],
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO event (machine, recorded_utc, kind, state, author, why, until_utc)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    )?;
    for change in changes {
        let (outcome, until) = (change.outcome.name(), change.until.map(|until| until.0));
        let (author, reason) = (&change.author, &change.reason);
        insert.execute(params![
            machine,
            recorded.0,
            MAINTENANCE,
            outcome,
            author,
            reason,
            until
        ])?;
    }
    Ok(())
}

fn maintenance(row: &Row<'_>) -> Result<MaintenanceChange, StoreError> {
    let named = |text: &str| MaintenanceOutcome::ALL.into_iter().find(|one| one.name() == text);
    Ok(MaintenanceChange {
        outcome: rows::known("outcome", rows::get(row, "state")?, named)?,
        author: rows::get(row, "author")?,
        reason: rows::get(row, "why")?,
        until: rows::get::<Option<i64>>(row, "until_utc")?.map(Timestamp),
    })
}

fn configuration(row: &Row<'_>) -> Result<ConfigurationChange, StoreError> {
    let named = |text: &str| ConfigurationOutcome::ALL.into_iter().find(|one| one.name() == text);
    let machine: String = rows::get(row, "machine")?;
    Ok(ConfigurationChange {
        machine: Some(machine).filter(|machine| !machine.is_empty()),
        outcome: rows::known("outcome", rows::get(row, "state")?, named)?,
        hash: rows::get(row, "component")?,
        text: rows::get(row, "why")?,
    })
}

/// Removes the oldest entries above the numbers kept.
pub(super) fn prune(transaction: &Transaction<'_>) -> rusqlite::Result<()> {
    prune_to(transaction, MAX_ALARM_EVENTS, MAX_HEALTH_CHANGES)
}

fn prune_to(
    transaction: &Transaction<'_>,
    max_alarms: i64,
    max_health: i64,
) -> rusqlite::Result<()> {
    let kinds = [("sequence IS NOT NULL", max_alarms), ("sequence IS NULL", max_health)];
    for (kind, max) in kinds {
        let last_gone: Option<i64> = transaction
            .query_row(
                &format!(
                    "SELECT place FROM event WHERE {kind} ORDER BY place DESC LIMIT 1 OFFSET ?1"
                ),
                [max],
                |row| row.get(0),
            )
            .optional()?;
        let Some(last_gone) = last_gone else { continue };
        transaction
            .execute(&format!("DELETE FROM event WHERE {kind} AND place <= ?1"), [last_gone])?;
        transaction
            .execute("UPDATE event_log SET removed_until = max(removed_until, ?1)", [last_gone])?;
    }
    Ok(())
}

/// The machine as a whole has no kind and no id.
fn subject_texts(subject: &Subject) -> (&str, &str) {
    match subject {
        Subject::Machine => ("", ""),
        Subject::Component(kind, id) => (kind.name(), id),
    }
}

fn subject(kind: &str, component: String) -> Result<Subject, StoreError> {
    if kind.is_empty() {
        return Ok(Subject::Machine);
    }
    let kind = rows::known("kind", kind.to_owned(), names::component_kind)?;
    Ok(Subject::Component(kind, component))
}

fn health(state: String, fault: Option<String>) -> Result<Health, StoreError> {
    Ok(Health {
        state: rows::known("state", state, names::health)?,
        fault: fault.map(|fault| rows::known("fault", fault, names::fault)).transpose()?,
    })
}

fn change(row: &Row<'_>) -> Result<HealthChange, StoreError> {
    let before: Option<String> = rows::get(row, "before")?;
    Ok(HealthChange {
        subject: subject(&rows::get::<String>(row, "kind")?, rows::get(row, "component")?)?,
        time_s: rows::get(row, "time_s")?,
        health: health(rows::get(row, "state")?, rows::get(row, "fault")?)?,
        before: before.map(|before| rows::known("state", before, names::health)).transpose()?,
        severity: rows::get(row, "severity")?,
        confidence: rows::get(row, "confidence")?,
        why: rows::get(row, "why")?,
    })
}

/// A transition with the start of its own stream, from which its times count; `None`: no longer held.
fn transition(
    connection: &Connection,
    machine: &str,
    sequence: i64,
) -> Result<Option<(AlarmEvent, Option<Timestamp>)>, StoreError> {
    let reading = |source| failed("reading a transition", source);
    let mut statement = connection
        .prepare_cached(&format!(
            "SELECT {}, {} FROM transition WHERE machine = ?1 AND sequence = ?2",
            rows::EVENT,
            rows::ALARM
        ))
        .map_err(reading)?;
    let mut found = statement.query(params![machine, sequence]).map_err(reading)?;
    let Some(row) = found.next().map_err(reading)? else { return Ok(None) };
    let start = rows::get::<Option<i64>>(row, "start_utc")?.map(Timestamp);
    let reader = Reader { start, now: Moment::of_stream(0.0) };
    Ok(Some((reader.event(row)?, start)))
}

fn entry(connection: &Connection, row: &Row<'_>) -> Result<Option<LogEntry>, StoreError> {
    let machine: String = rows::get(row, "machine")?;
    let sequence: Option<i64> = rows::get(row, "sequence")?;
    let (what, start) = match sequence {
        Some(sequence) => match transition(connection, &machine, sequence)? {
            Some((event, start)) => (Happened::Alarm(Box::new(event)), start),
            None => return Ok(None),
        },
        None => match rows::get::<Option<String>>(row, "kind")?.as_deref() {
            Some(CONFIGURATION) => (Happened::Configuration(configuration(row)?), None),
            Some(MAINTENANCE) => (Happened::Maintenance(maintenance(row)?), None),
            _ => {
                let start = rows::get::<Option<i64>>(row, "start_utc")?.map(Timestamp);
                (Happened::Health(change(row)?), start)
            }
        },
    };
    let place = rows::count(rows::get(row, "place")?);
    let recorded = Timestamp(rows::get(row, "recorded_utc")?);
    Ok(Some(LogEntry { place, machine, recorded, start, refused_since: None, what }))
}

impl EventLog for SqliteEvents {
    fn after(&self, place: u64, limit: usize) -> Result<Vec<LogEntry>, StoreError> {
        let reading = |source| failed("reading the events", source);
        let connection = self.connection();
        let mut statement = connection
            .prepare_cached("SELECT * FROM event WHERE place > ?1 ORDER BY place")
            .map_err(reading)?;
        let mut found = statement.query([whole(place)]).map_err(reading)?;
        let mut entries = Vec::new();
        while entries.len() < limit
            && let Some(row) = found.next().map_err(reading)?
        {
            entries.extend(entry(&connection, row)?);
        }
        Ok(entries)
    }

    fn extent(&self) -> Result<Extent, StoreError> {
        let connection = self.connection();
        let found = connection.query_row(
            "SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'event'), 0),
                (SELECT removed_until FROM event_log)",
            (),
            |row| Ok((row.get(0)?, row.get(1)?)),
        );
        let (newest, removed_until) =
            found.map_err(|source| failed("reading the events", source))?;
        Ok(Extent { newest: rows::count(newest), removed_until: rows::count(removed_until) })
    }

    fn health(&self, machine: &str) -> Result<BTreeMap<Subject, Health>, StoreError> {
        let reading = |source| failed("reading what was told of health", source);
        let connection = self.connection();
        let mut statement = connection
            .prepare("SELECT kind, component, state, fault FROM health WHERE machine = ?1")
            .map_err(reading)?;
        let mut found = statement.query([machine]).map_err(reading)?;
        let mut known = BTreeMap::new();
        while let Some(row) = found.next().map_err(reading)? {
            let subject =
                subject(&rows::get::<String>(row, "kind")?, rows::get(row, "component")?)?;
            known.insert(subject, health(rows::get(row, "state")?, rows::get(row, "fault")?)?);
        }
        Ok(known)
    }
}

impl Receivers for SqliteEvents {
    fn begin(&self, name: &str) -> Result<Progress, StoreError> {
        let newest = self.extent()?.newest;
        let connection = self.connection();
        let found = connection
            .query_row(
                "SELECT settled_until, n_delivered, n_refused, n_given_up FROM receiver WHERE name = ?1",
                [name],
                |row| {
                    Ok(Progress {
                        settled_until: rows::count(row.get(0)?),
                        n_delivered: rows::count(row.get(1)?),
                        n_refused: rows::count(row.get(2)?),
                        n_given_up: rows::count(row.get(3)?),
                    })
                },
            )
            .optional();
        drop(connection);
        if let Some(progress) = found.map_err(|source| failed("reading a receiver", source))? {
            // After an older copy was put in place the log ends before.
            return Ok(Progress { settled_until: progress.settled_until.min(newest), ..progress });
        }
        let progress = Progress { settled_until: newest, ..Progress::default() };
        self.keep(name, &progress)?;
        Ok(progress)
    }

    fn keep(&self, name: &str, progress: &Progress) -> Result<(), StoreError> {
        let done = self.connection().execute(
            "INSERT OR REPLACE INTO receiver (name, settled_until, n_delivered, n_refused, n_given_up)
             VALUES (?1, ?2, ?3, ?4, ?5)",
            params![
                name,
                whole(progress.settled_until),
                whole(progress.n_delivered),
                whole(progress.n_refused),
                whole(progress.n_given_up)
            ],
        );
        done.map(drop).map_err(|source| failed("storing what was delivered", source))
    }

    fn forget_others(&self, names: &[&str]) -> Result<Vec<String>, StoreError> {
        let doing = |source| failed("forgetting receivers", source);
        let connection = self.connection();
        let mut statement = connection.prepare("SELECT name FROM receiver").map_err(doing)?;
        let found = statement.query_map((), |row| row.get(0)).map_err(doing)?;
        let all = found.collect::<rusqlite::Result<Vec<String>>>().map_err(doing)?;
        let others: Vec<String> =
            all.into_iter().filter(|name| !names.contains(&name.as_str())).collect();
        for name in &others {
            connection.execute("DELETE FROM receiver WHERE name = ?1", [name]).map_err(doing)?;
        }
        Ok(others)
    }
}

#[cfg(test)]
#[path = "events_tests.rs"]
mod tests;
