//! Opening the state database: a lock beside the file keeps a second daemon away, the file is checked as a
//! whole, and what is damaged, foreign or newer is refused with the remedy.

use super::StoreError;
use super::backup;
use super::schema;
use rusqlite::Connection;
use rusqlite::ErrorCode;
use rusqlite::OpenFlags;
use rusqlite::TransactionBehavior;
use std::fs;
use std::fs::File;
use std::fs::TryLockError;
use std::path::Path;
use std::time::Duration;

/// Name of the database in the store's folder.
pub const FILE: &str = "state.db";

/// Name of the lock beside it.
pub(super) const LOCK: &str = "state.lock";

/// How long a connection waits for the other.
pub(super) const BUSY: Duration = Duration::from_secs(5);

/// Transactions wait for the other connection when they begin: one that read first and then writes cannot, for what it has read may
/// be old by then, and it fails at once whatever [`BUSY`] says.
const WRITING: TransactionBehavior = TransactionBehavior::Immediate;

/// Takes the lock of the store in `directory`, and makes the folder where it is missing.
pub(super) fn lock(directory: &Path) -> Result<File, StoreError> {
    let refused = |source| StoreError::Folder { directory: directory.to_owned(), source };
    fs::create_dir_all(directory).map_err(refused)?;
    let lock_file = directory.join(LOCK);
    let lock = File::create(&lock_file).map_err(refused)?;
    lock.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => StoreError::InUse { file: lock_file },
        TryLockError::Error(source) => refused(source),
    })?;
    Ok(lock)
}

/// Opens the database in `directory` for writing as its only process, and brings it up to date.
pub(super) fn alone(directory: &Path) -> Result<(Connection, File), StoreError> {
    let lock = lock(directory)?;
    if backup::is_unfinished(directory) {
        return Err(StoreError::Unfinished { directory: directory.to_owned() });
    }
    let file = directory.join(FILE);
    let connection = writing(&file).map_err(|error| with_place(error, &file))?;
    Ok((connection, lock))
}

/// Opens another connection for writing to a database that a daemon has, and changes nothing in it.
pub(super) fn beside(file: &Path) -> Result<Connection, StoreError> {
    let opening = |source| failed("opening the store", source);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let mut connection = Connection::open_with_flags(file, flags).map_err(opening)?;
    connection.busy_timeout(BUSY).map_err(opening)?;
    connection.set_transaction_behavior(WRITING);
    connection.pragma_update(None, "synchronous", "FULL").map_err(opening)?;
    let found: u32 =
        connection.query_row("PRAGMA user_version", (), |row| row.get(0)).map_err(opening)?;
    if found == schema::newest() {
        Ok(connection)
    } else {
        Err(StoreError::OtherVersion { file: file.to_owned(), found, known: schema::newest() })
    }
}

fn writing(file: &Path) -> Result<Connection, StoreError> {
    let opening = |source| failed("opening the store", source);
    let mut connection = Connection::open(file).map_err(opening)?;
    connection.busy_timeout(BUSY).map_err(opening)?;
    connection.set_transaction_behavior(WRITING);
    check(&connection, file)?;
    let mode: String = connection
        .pragma_update_and_check(None, "journal_mode", "WAL", |row| row.get(0))
        .map_err(opening)?;
    if mode != "wal" {
        tracing::warn!(mode, "the store's file system allows no write-ahead log");
    }
    connection.pragma_update(None, "synchronous", "FULL").map_err(opening)?;
    schema::migrate(&mut connection, file, schema::newest())?;
    Ok(connection)
}

pub(super) fn reading(file: &Path) -> Result<Connection, StoreError> {
    let opening = |source| failed("opening the store for reading", source);
    let connection = Connection::open(file).map_err(opening)?;
    connection.busy_timeout(BUSY).map_err(opening)?;
    connection.pragma_update(None, "query_only", true).map_err(opening)?;
    Ok(connection)
}

/// Refuses a database of another program and one that is damaged.
pub(super) fn check(connection: &Connection, file: &Path) -> Result<(), StoreError> {
    let reading = |source| failed("checking the store", source);
    let id: u32 =
        connection.query_row("PRAGMA application_id", (), |row| row.get(0)).map_err(reading)?;
    let n_tables: u32 = connection
        .query_row("SELECT count(*) FROM sqlite_schema", (), |row| row.get(0))
        .map_err(reading)?;
    if n_tables > 0 && id != schema::APPLICATION_ID {
        return Err(StoreError::Foreign { file: file.to_owned() });
    }
    let found: String =
        connection.query_row("PRAGMA quick_check(1)", (), |row| row.get(0)).map_err(reading)?;
    if found == "ok" { Ok(()) } else { Err(corrupt(file, found)) }
}

fn corrupt(file: &Path, found: String) -> StoreError {
    let backup = schema::readable_backup(file);
    StoreError::Corrupt { file: file.to_owned(), found, backup }
}

/// An error of the database says what was damaged, but not where.
pub(super) fn with_place(error: StoreError, file: &Path) -> StoreError {
    if let StoreError::Database { source, .. } = &error
        && let Some(rusqlite::Error::SqliteFailure(code, _)) = source.downcast_ref()
        && matches!(code.code, ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
    {
        return corrupt(file, source.to_string());
    }
    error
}

pub(super) fn failed(doing: &'static str, source: rusqlite::Error) -> StoreError {
    StoreError::Database { doing, source: Box::new(source) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    #[test]
    fn who_reads_and_then_writes_waits_for_the_other_and_is_not_refused() {
        let dir = tempfile::tempdir().unwrap();
        let (daemon, _lock) = alone(dir.path()).unwrap();
        daemon.execute_batch("CREATE TABLE noted (by TEXT NOT NULL)").unwrap();
        let mut command = beside(&dir.path().join(FILE)).unwrap();
        let transaction = command.transaction().unwrap();
        let n: u32 =
            transaction.query_row("SELECT count(*) FROM noted", (), |row| row.get(0)).unwrap();
        assert_eq!(n, 0);
        let noting = thread::spawn(move || {
            daemon.execute("INSERT INTO noted VALUES ('daemon')", ()).unwrap();
            daemon
        });
        // Long enough for the daemon to get in between, were it let in.
        thread::sleep(Duration::from_millis(200));
        transaction.execute("INSERT INTO noted VALUES ('command')", ()).unwrap();
        transaction.commit().unwrap();
        let daemon = noting.join().unwrap();
        let n: u32 = daemon.query_row("SELECT count(*) FROM noted", (), |row| row.get(0)).unwrap();
        assert_eq!(n, 2);
    }
}
