//! Opening a file of trends: a SQLite database with a write-ahead log, made, checked, refused.
//!
//! `row` holds a block of one series by `block << 24 | series`, `windows` the times and verdicts of a minute
//! by `minute << 24 | stream`, `dirty` the blocks of the coarser tier that are older than what they are made
//! of.

use super::super::StoreError;
use super::super::opening::failed;
use rusqlite::Connection;
use rusqlite::ErrorCode;
use rusqlite::OpenFlags;
use std::path::Path;
use std::path::PathBuf;
use std::time::Duration;

/// Marks a database as one of trends: "rott".
const APPLICATION_ID: u32 = 0x726f_7474;

/// The schema of this program.
const SCHEMA: u32 = 1;

const TABLES: &str = "
    CREATE TABLE stream (
        id INTEGER PRIMARY KEY, machine TEXT NOT NULL, name TEXT NOT NULL, start_utc INTEGER,
        begun_utc INTEGER NOT NULL, channels TEXT NOT NULL, UNIQUE (machine, name));
    CREATE TABLE series (
        id INTEGER PRIMARY KEY, stream INTEGER NOT NULL, kind TEXT NOT NULL, name TEXT NOT NULL,
        UNIQUE (stream, kind, name));
    CREATE TABLE layout (id INTEGER PRIMARY KEY, features TEXT NOT NULL UNIQUE);
    CREATE TABLE row (
        key INTEGER PRIMARY KEY, layout INTEGER NOT NULL, n INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE TABLE windows (key INTEGER PRIMARY KEY, data BLOB NOT NULL);
    CREATE TABLE dirty (
        block INTEGER NOT NULL, stream INTEGER NOT NULL, PRIMARY KEY (block, stream)) WITHOUT ROWID;";

/// How long a connection waits for another.
const BUSY: Duration = Duration::from_secs(5);

/// Opens a file for writing; makes it where it is missing.
pub(super) fn writing(path: &Path) -> Result<Connection, StoreError> {
    let opening = |source| problem(path, "opening a file of trends", source);
    let connection = Connection::open(path).map_err(opening)?;
    connection.busy_timeout(BUSY).map_err(opening)?;
    let found = version(&connection, path)?;
    let set = |name: &str, value: i64| connection.pragma_update(None, name, value);
    if found == 0 {
        set("page_size", 16_384).map_err(opening)?;
    }
    connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(())).map_err(opening)?;
    connection.pragma_update(None, "synchronous", "NORMAL").map_err(opening)?;
    // The log is returned to the file between two commits, not in one of them.
    connection
        .pragma_update_and_check(None, "wal_autocheckpoint", 0, |_| Ok(()))
        .map_err(opening)?;
    if found == 0 {
        connection.execute_batch(&format!("BEGIN IMMEDIATE;{TABLES}")).map_err(opening)?;
        set("user_version", i64::from(SCHEMA)).map_err(opening)?;
        set("application_id", i64::from(APPLICATION_ID)).map_err(opening)?;
        connection.execute_batch("COMMIT").map_err(opening)?;
    }
    Ok(connection)
}

/// Opens a file for reading; `None`: there is none yet.
pub(super) fn reading(path: &Path) -> Result<Option<Connection>, StoreError> {
    if !path.is_file() {
        return Ok(None);
    }
    let opening = |source| problem(path, "opening a file of trends for reading", source);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags).map_err(opening)?;
    connection.busy_timeout(BUSY).map_err(opening)?;
    connection.pragma_update(None, "query_only", true).map_err(opening)?;
    Ok((version(&connection, path)? > 0).then_some(connection))
}

/// The schema of a file; 0: it is new. Refuses what is not ours, newer or damaged.
fn version(connection: &Connection, path: &Path) -> Result<u32, StoreError> {
    let reading = |source| problem(path, "checking a file of trends", source);
    let number = |name: &str| {
        connection.query_row(&format!("PRAGMA {name}"), (), |row| row.get::<_, u32>(0))
    };
    let n_tables: u32 = connection
        .query_row("SELECT count(*) FROM sqlite_schema", (), |row| row.get(0))
        .map_err(reading)?;
    if n_tables == 0 {
        return Ok(0);
    }
    if number("application_id").map_err(reading)? != APPLICATION_ID {
        return Err(StoreError::Foreign { file: path.to_owned() });
    }
    let found = number("user_version").map_err(reading)?;
    if found > SCHEMA {
        return Err(StoreError::NewerTrends { file: path.to_owned(), found, known: SCHEMA });
    }
    Ok(found)
}

/// Whether a file that nobody has open is one of trends, whole and not of a newer program.
pub(super) fn check_copy(path: &Path) -> Result<(), StoreError> {
    let checking = |source| problem(path, "checking a file of trends", source);
    let Some(connection) = reading(path)? else { return Ok(()) };
    let found: String =
        connection.query_row("PRAGMA quick_check(1)", (), |row| row.get(0)).map_err(checking)?;
    if found == "ok" {
        return Ok(());
    }
    Err(StoreError::DamagedTrends { file: path.to_owned(), found })
}

/// An error with the file it is about, if the file is what is wrong.
pub(super) fn problem(path: &Path, doing: &'static str, source: rusqlite::Error) -> StoreError {
    let code = source.sqlite_error_code();
    if matches!(code, Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)) {
        return StoreError::DamagedTrends { file: path.to_owned(), found: source.to_string() };
    }
    failed(doing, source)
}

/// A path with something appended to its name.
pub(super) fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}
