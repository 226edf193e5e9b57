//! Schemas of the state database, one migration each, and how a database is brought up to date.

use super::StoreError;
use rusqlite::Connection;
use std::fs;
use std::path::Path;
use std::path::PathBuf;

/// Marks a database as ours: "rotw".
pub(super) const APPLICATION_ID: u32 = 0x726f_7477;

/// What leads from each schema to the next; the first from an empty database. Released ones never
/// change.
const MIGRATIONS: &[&str] = &[
    // 1: alarms and what happened to them. Times in s are stream time, counted from start_utc; UTC in ns.
    "CREATE TABLE transition (
        machine TEXT NOT NULL, sequence INTEGER NOT NULL, event TEXT NOT NULL, time_s REAL NOT NULL,
        recorded_utc INTEGER NOT NULL, author TEXT, comment TEXT, start_utc INTEGER,
        number INTEGER NOT NULL, component TEXT NOT NULL, kind TEXT NOT NULL, source TEXT NOT NULL,
        limit_id TEXT, level TEXT NOT NULL, state TEXT NOT NULL, silence TEXT, silence_author TEXT,
        silence_comment TEXT, silence_since_s REAL, until_utc INTEGER, remaining_s REAL,
        latching INTEGER NOT NULL, fault TEXT, why TEXT NOT NULL, severity REAL, confidence REAL,
        raised_at_s REAL NOT NULL, active_since_s REAL NOT NULL, changed_at_s REAL NOT NULL,
        occurrences INTEGER NOT NULL, ack_author TEXT, ack_comment TEXT, ack_time_s REAL,
        UNIQUE (machine, sequence));
     CREATE INDEX transition_of_alarm ON transition (machine, number, sequence);
     CREATE TABLE alarm (
        machine TEXT NOT NULL, start_utc INTEGER,
        number INTEGER NOT NULL, component TEXT NOT NULL, kind TEXT NOT NULL, source TEXT NOT NULL,
        limit_id TEXT, level TEXT NOT NULL, state TEXT NOT NULL, silence TEXT, silence_author TEXT,
        silence_comment TEXT, silence_since_s REAL, until_utc INTEGER, remaining_s REAL,
        latching INTEGER NOT NULL, fault TEXT, why TEXT NOT NULL, severity REAL, confidence REAL,
        raised_at_s REAL NOT NULL, active_since_s REAL NOT NULL, changed_at_s REAL NOT NULL,
        occurrences INTEGER NOT NULL, ack_author TEXT, ack_comment TEXT, ack_time_s REAL,
        PRIMARY KEY (machine, number)) WITHOUT ROWID;
     CREATE TABLE stream (
        machine TEXT PRIMARY KEY, identity TEXT, judged_until_s REAL, last_sequence INTEGER NOT NULL,
        last_number INTEGER NOT NULL) WITHOUT ROWID;",
    // 2: who did what, and which configuration ran.
    "CREATE TABLE audit (
        id INTEGER PRIMARY KEY, recorded_utc INTEGER NOT NULL, author TEXT NOT NULL, action TEXT NOT NULL,
        machine TEXT, number INTEGER, comment TEXT NOT NULL);
     INSERT INTO audit (recorded_utc, author, action, machine, number, comment)
        SELECT recorded_utc, author, event, machine, number, coalesce(comment, '') FROM transition
        WHERE author IS NOT NULL ORDER BY rowid;
     CREATE TABLE configuration (
        id INTEGER PRIMARY KEY, hash TEXT NOT NULL, version TEXT NOT NULL, since_utc INTEGER NOT NULL);",
    // 3: signed baselines. Values are logarithms; what the id digests is in these four tables.
    "CREATE TABLE baseline (
        id TEXT PRIMARY KEY, machine TEXT NOT NULL, author TEXT NOT NULL, comment TEXT NOT NULL,
        at_utc INTEGER NOT NULL, active INTEGER NOT NULL) WITHOUT ROWID;
     CREATE INDEX baseline_of_machine ON baseline (machine, at_utc);
     CREATE TABLE baseline_record (
        baseline TEXT NOT NULL, number INTEGER NOT NULL, name TEXT NOT NULL, speed_hz REAL, load REAL,
        n_windows INTEGER NOT NULL, PRIMARY KEY (baseline, number)) WITHOUT ROWID;
     CREATE TABLE baseline_left_out (
        baseline TEXT NOT NULL, number INTEGER NOT NULL, reason TEXT NOT NULL, n INTEGER NOT NULL,
        PRIMARY KEY (baseline, number, reason)) WITHOUT ROWID;
     CREATE TABLE baseline_feature (
        baseline TEXT NOT NULL, number INTEGER NOT NULL, channel TEXT NOT NULL, feature TEXT NOT NULL,
        log_value REAL NOT NULL, log_scatter REAL, n_windows INTEGER NOT NULL,
        PRIMARY KEY (baseline, number, channel, feature)) WITHOUT ROWID;
     ALTER TABLE audit ADD COLUMN baseline TEXT;",
    // 4: one log of what happened by its place, transitions by their number and changes of health; the health
    // told last; how far each receiver of notifications has come.
    "CREATE TABLE event (
        place INTEGER PRIMARY KEY AUTOINCREMENT, machine TEXT NOT NULL, recorded_utc INTEGER NOT NULL,
        sequence INTEGER, start_utc INTEGER, time_s REAL, kind TEXT, component TEXT, state TEXT, before TEXT,
        fault TEXT, severity REAL, confidence REAL, why TEXT);
     CREATE INDEX event_of_alarm ON event (place) WHERE sequence IS NOT NULL;
     CREATE INDEX event_of_health ON event (place) WHERE sequence IS NULL;
     INSERT INTO event (machine, recorded_utc, sequence)
        SELECT machine, recorded_utc, sequence FROM transition ORDER BY rowid;
     CREATE TABLE event_log (removed_until INTEGER NOT NULL);
     INSERT INTO event_log VALUES (0);
     CREATE TABLE health (
        machine TEXT NOT NULL, kind TEXT NOT NULL, component TEXT NOT NULL, state TEXT NOT NULL, fault TEXT,
        PRIMARY KEY (machine, kind, component)) WITHOUT ROWID;
     CREATE TABLE receiver (
        name TEXT PRIMARY KEY, settled_until INTEGER NOT NULL, n_delivered INTEGER NOT NULL,
        n_refused INTEGER NOT NULL, n_given_up INTEGER NOT NULL) WITHOUT ROWID;",
    // 5: captures of alarms and of operators, and which alarm has which, or why none.
    "CREATE TABLE capture (
        seq INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, machine TEXT NOT NULL, number INTEGER NOT NULL,
        author TEXT, comment TEXT, requested_utc INTEGER NOT NULL, start_utc INTEGER, trigger_s REAL NOT NULL,
        from_s REAL, to_s REAL, state TEXT NOT NULL, note TEXT, bytes INTEGER NOT NULL,
        windows INTEGER NOT NULL);
     CREATE INDEX capture_of_machine ON capture (machine, number);
     CREATE TABLE alarm_capture (
        machine TEXT NOT NULL, number INTEGER NOT NULL, capture TEXT, reason TEXT,
        recorded_utc INTEGER NOT NULL, PRIMARY KEY (machine, number)) WITHOUT ROWID;
     CREATE INDEX alarm_of_capture ON alarm_capture (capture);",
    // 6: delays and hysteresis of a machine's alarms: numbers (f64, little end first) and words, each with a zero
    // byte behind it.
    "CREATE TABLE decision (
        machine TEXT PRIMARY KEY, judged_by TEXT NOT NULL, numbers BLOB NOT NULL, words TEXT NOT NULL)
        WITHOUT ROWID;",
    // 7: the log of events tells of configurations, of kind 'configuration': the component is the hash, the state what
    // became of it, and no machine is the daemon as a whole.
    "UPDATE event_log SET removed_until = removed_until;",
    // 8: silences in advance of a machine: of a component, a limit or a channel; and their highest number.
    "CREATE TABLE advance (
        machine TEXT NOT NULL, number INTEGER NOT NULL, sort TEXT NOT NULL, kind TEXT, name TEXT NOT NULL,
        silence TEXT NOT NULL, author TEXT NOT NULL, comment TEXT NOT NULL, since_utc INTEGER NOT NULL,
        until_utc INTEGER, remaining_s REAL, PRIMARY KEY (machine, number)) WITHOUT ROWID;
     CREATE TABLE advance_last (machine TEXT PRIMARY KEY, number INTEGER NOT NULL) WITHOUT ROWID;",
    // 9: the machine file with which a baseline was used last; null: not used since it was learned or activated.
    "ALTER TABLE baseline ADD COLUMN described TEXT;",
    // 10: the log of events tells of maintenance, of kind 'maintenance', with its author and its end; a silence in
    // advance may be of sort 'machine'; and what people found of a verdict, with the verdict as it was then.
    "ALTER TABLE event ADD COLUMN author TEXT;
     ALTER TABLE event ADD COLUMN until_utc INTEGER;
     CREATE TABLE feedback (
        id INTEGER PRIMARY KEY AUTOINCREMENT, machine TEXT NOT NULL, recorded_utc INTEGER NOT NULL,
        author TEXT NOT NULL, outcome TEXT NOT NULL, kind TEXT NOT NULL, component TEXT NOT NULL, found TEXT,
        note TEXT NOT NULL, state TEXT NOT NULL, fault TEXT, severity REAL, confidence REAL, why TEXT NOT NULL,
        judged_utc INTEGER, judged_by TEXT NOT NULL);
     CREATE INDEX feedback_of_machine ON feedback (machine, id);",
    // 11: all captures of an alarm; alarm_capture has the newest of them, or why there is none.
    "CREATE TABLE capture_alarm (
        capture TEXT NOT NULL, machine TEXT NOT NULL, number INTEGER NOT NULL,
        PRIMARY KEY (capture, number)) WITHOUT ROWID;
     CREATE INDEX capture_of_alarm ON capture_alarm (machine, number);
     INSERT INTO capture_alarm SELECT capture, machine, number FROM alarm_capture WHERE capture IS NOT NULL;",
];

/// The newest schema.
pub(super) fn newest() -> u32 {
    u32::try_from(MIGRATIONS.len()).unwrap_or(u32::MAX)
}

/// Where the backup of a database of schema `version` is put before it is changed.
pub(super) fn backup_of(file: &Path, version: u32) -> PathBuf {
    file.with_extension(format!("schema-{version}.db"))
}

/// The newest backup beside a database that this program can read.
pub(super) fn readable_backup(file: &Path) -> Option<PathBuf> {
    (1..=newest()).rev().map(|version| backup_of(file, version)).find(|backup| backup.is_file())
}

/// Brings a database to schema `to`, after a backup if it holds anything.
pub(super) fn migrate(connection: &mut Connection, file: &Path, to: u32) -> Result<(), StoreError> {
    let from: u32 = connection
        .query_row("PRAGMA user_version", (), |row| row.get(0))
        .map_err(|source| super::opening::failed("reading the schema", source))?;
    if from > to {
        let backup = readable_backup(file);
        return Err(StoreError::Newer { file: file.to_owned(), found: from, known: to, backup });
    }
    if from == to {
        return Ok(());
    }
    let done = if from == 0 { Ok(()) } else { back_up(connection, &backup_of(file, from)) };
    done.and_then(|()| step(connection, from, to)).map_err(|source| StoreError::Migration {
        file: file.to_owned(),
        from,
        to,
        source,
    })
}

type AnyError = Box<dyn std::error::Error + Send + Sync>;

/// Writes a consistent copy; an older one of the same schema gives way.
fn back_up(connection: &Connection, backup: &Path) -> Result<(), AnyError> {
    let half = backup.with_extension("part");
    for stale in [&half, backup] {
        if stale.exists() {
            fs::remove_file(stale)?;
        }
    }
    connection.execute("VACUUM INTO ?1", [half.to_string_lossy()])?;
    fs::File::open(&half)?.sync_all()?;
    fs::rename(&half, backup)?;
    Ok(())
}

/// All steps in one transaction: it happens as a whole or not at all.
fn step(connection: &mut Connection, from: u32, to: u32) -> Result<(), AnyError> {
    let transaction = connection.transaction()?;
    let (skip, end) = (usize::try_from(from)?, usize::try_from(to)?);
    for migration in MIGRATIONS.iter().take(end).skip(skip) {
        transaction.execute_batch(migration)?;
    }
    transaction.pragma_update(None, "user_version", to)?;
    transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
    transaction.commit()?;
    Ok(())
}
