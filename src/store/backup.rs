//! Copies of a store while its daemon runs, and their way back into its place. Must not know archives.

use super::StoreError;
use super::captures::CaptureIndex;
use super::captures::CaptureQuery;
use super::captures::CaptureState;
use super::captures::SqliteCaptures;
use super::opening;
use super::opening::failed;
use super::schema;
use super::sqlite;
use super::trends;
use rusqlite::Connection;
use rusqlite::OpenFlags;
use std::fs;
use std::fs::File;
use std::io;
use std::path::Path;
use std::path::PathBuf;

/// Begins the names of folders in a store that hold what was there before a restore.
pub const BEFORE: &str = "before-restore-";

/// Folder in a store in which a restore gathers what it will put in place.
pub const GATHERED: &str = ".restoring";

/// Its name from when that begins: as long as it is there, part of the store may be missing.
const PLACING: &str = ".placing";

/// Captures listed at a time.
const PAGE: usize = 1000;

/// Why a store was not copied or put in place.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There is no store.
    #[error("{} has no state.db: there is nothing to back up", directory.display())]
    None {
        /// The folder.
        directory: PathBuf,
    },
    /// There is a store already.
    #[error(
        "{} is not empty ({found}): choose another folder, or say --force to put what is there aside",
        directory.display()
    )]
    NotEmpty {
        /// The folder.
        directory: PathBuf,
        /// A name in it.
        found: String,
    },
    /// A file refused.
    #[error("{doing} {} failed", file.display())]
    File {
        /// What was attempted.
        doing: &'static str,
        /// With what.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Says what was attempted with which file.
pub fn told<'f>(doing: &'static str, file: &'f Path) -> impl Fn(io::Error) -> BackupError + 'f {
    move |source| BackupError::File { doing, file: file.to_owned(), source }
}

/// Copies the databases of the store in `directory` into the folder `to`, each as it stood at one moment, the state
/// first; a daemon may run.
///
/// # Errors
/// When one cannot be read, or the copy not be written.
pub fn copy_databases(directory: &Path, to: &Path) -> Result<(), BackupError> {
    let state = directory.join(sqlite::FILE);
    if !state.is_file() {
        return Err(BackupError::None { directory: directory.to_owned() });
    }
    copy(&state, &to.join(sqlite::FILE))?;
    let (from, to) = (directory.join(trends::FOLDER), to.join(trends::FOLDER));
    fs::create_dir_all(&to).map_err(told("making", &to))?;
    for file in trends::files(&from) {
        let name = file.file_name().unwrap_or_default();
        match copy(&file, &to.join(name)) {
            // What was too old went meanwhile.
            Err(_) if !file.exists() => {}
            done => done?,
        }
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<(), StoreError> {
    let copying = |source| failed("copying a database", source);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(from, flags).map_err(copying)?;
    connection.busy_timeout(opening::BUSY).map_err(copying)?;
    connection.execute("VACUUM INTO ?1", [to.to_string_lossy()]).map(drop).map_err(copying)
}

/// Machines and ids of the captures that are whole, by the copy of the state in `copied`.
///
/// # Errors
/// When the copy cannot be read.
pub fn captures(copied: &Path) -> Result<Vec<(String, String)>, StoreError> {
    let index = SqliteCaptures::join(copied)?;
    let mut query = CaptureQuery { limit: PAGE, ..CaptureQuery::default() };
    let mut found = Vec::new();
    loop {
        let page = index.list(&query)?;
        let is_whole = |state| matches!(state, CaptureState::Complete | CaptureState::Recovered);
        let whole = page.iter().filter(|one| is_whole(one.state));
        found.extend(whole.map(|one| (one.machine.clone(), one.id.clone())));
        match page.last() {
            Some(last) if page.len() == query.limit => query.after = Some(last.id.clone()),
            Some(_) | None => return Ok(found),
        }
    }
}

/// The schema that copies of this program have.
#[must_use]
pub fn newest_schema() -> u32 {
    schema::newest()
}

/// Checks the databases of a copy: each ours, whole, and none of a newer program.
///
/// # Errors
/// What is wrong with which.
pub fn check(copied: &Path) -> Result<(), StoreError> {
    check_state(&copied.join(sqlite::FILE))?;
    trends::files(&copied.join(trends::FOLDER)).iter().try_for_each(|file| trends::check_copy(file))
}

fn check_state(file: &Path) -> Result<(), StoreError> {
    let opening = |source| failed("opening a copy of the store", source);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let checked = || {
        let connection = Connection::open_with_flags(file, flags).map_err(opening)?;
        opening::check(&connection, file)?;
        let version = connection.query_row("PRAGMA user_version", (), |row| row.get(0));
        version.map_err(opening)
    };
    let found: u32 = checked().map_err(|error| opening::with_place(error, file))?;
    let known = schema::newest();
    if found > known {
        return Err(StoreError::Newer { file: file.to_owned(), found, known, backup: None });
    }
    Ok(())
}

/// The place of a store: held as long as nobody else may use it.
#[derive(Debug)]
pub struct Place {
    directory: PathBuf,
    _lock: File,
}

impl Place {
    /// Takes the place `directory`, and makes it where it is missing. What is there is refused unless `may_replace`.
    ///
    /// # Errors
    /// When a daemon has it, or there is something already.
    pub fn take(directory: &Path, may_replace: bool) -> Result<Self, BackupError> {
        let lock = opening::lock(directory)?;
        let place = Self { directory: directory.to_owned(), _lock: lock };
        if let Some(found) = place.held()?.first().filter(|_| !may_replace) {
            let found = found.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Err(BackupError::NotEmpty { directory: directory.to_owned(), found });
        }
        Ok(place)
    }

    /// An empty folder for what will be put in place.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn gather(&self) -> Result<PathBuf, BackupError> {
        let gathered = self.directory.join(GATHERED);
        if gathered.exists() {
            fs::remove_dir_all(&gathered).map_err(told("removing", &gathered))?;
        }
        fs::create_dir(&gathered).map_err(told("making", &gathered))?;
        Ok(gathered)
    }

    /// Everything of a store that is there.
    fn held(&self) -> Result<Vec<PathBuf>, BackupError> {
        let reading = told("reading", &self.directory);
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.directory).map_err(&reading)? {
            let entry = entry.map_err(&reading)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_ours =
                [opening::LOCK, GATHERED].contains(&name.as_str()) || name.starts_with(BEFORE);
            if !is_ours {
                found.push(entry.path());
            }
        }
        found.sort();
        Ok(found)
    }

    /// Puts what was gathered in place, and what was there before into a folder `before-restore-WHEN`, which is given.
    ///
    /// # Errors
    /// When something cannot be moved. Nothing is lost: a daemon refuses to start until the restore is done again.
    pub fn put(&self, when: &str) -> Result<Option<PathBuf>, BackupError> {
        let (gathered, placing) = (self.directory.join(GATHERED), self.directory.join(PLACING));
        let before = self.directory.join(format!("{BEFORE}{when}"));
        let held = self.held()?;
        if !held.is_empty() {
            fs::create_dir_all(&before).map_err(told("making", &before))?;
        }
        let into = |folder: &Path, from: &Path| {
            let to = folder.join(from.file_name().unwrap_or_default());
            fs::rename(from, &to).map_err(told("moving", from))
        };
        for from in &held {
            // What an earlier restore that was cut off had gathered goes aside last.
            into(&before, from)?;
        }
        fs::rename(&gathered, &placing).map_err(told("moving", &gathered))?;
        for entry in fs::read_dir(&placing).map_err(told("reading", &placing))? {
            into(&self.directory, &entry.map_err(told("reading", &placing))?.path())?;
        }
        File::open(&self.directory)
            .and_then(|folder| folder.sync_all())
            .map_err(told("writing", &self.directory))?;
        fs::remove_dir(&placing).map_err(told("removing", &placing))?;
        Ok((!held.is_empty()).then_some(before))
    }
}

/// Whether part of a store may be missing because a restore was cut off.
pub(super) fn is_unfinished(directory: &Path) -> bool {
    directory.join(PLACING).exists()
        || (directory.join(GATHERED).exists() && !directory.join(sqlite::FILE).exists())
}

#[cfg(test)]
mod tests {
    use super::super::tests::batch;
    use super::super::*;
    use super::*;
    use tempfile::TempDir;

    fn store(directory: &Path) -> sqlite::SqliteStore {
        let (mut store, _) = sqlite::open(directory).unwrap();
        store.keep(&[batch(Vec::new())]).unwrap();
        store
    }

    #[test]
    fn a_copy_of_a_store_in_use_is_put_in_place_and_what_was_there_aside() {
        let dir = TempDir::new().unwrap();
        let [from, copied, to] = ["from", "copied", "to"].map(|name| dir.path().join(name));
        let running = store(&from);
        fs::create_dir(&copied).unwrap();
        copy_databases(&from, &copied).unwrap();
        check(&copied).unwrap();
        assert!(captures(&copied).unwrap().is_empty());
        assert!(matches!(
            Place::take(&from, true),
            Err(BackupError::Store(StoreError::InUse { .. }))
        ));
        drop(running);
        drop(store(&to));
        assert!(matches!(Place::take(&to, false), Err(BackupError::NotEmpty { .. })));
        let place = Place::take(&to, true).unwrap();
        let gathered = place.gather().unwrap();
        fs::copy(copied.join("state.db"), gathered.join("state.db")).unwrap();
        let before = place.put("now").unwrap().unwrap();
        assert!(before.join("state.db").is_file());
        drop(place);
        drop(sqlite::open(&to).unwrap());
        // A place that holds nothing but that is still refused without a word.
        assert!(Place::take(&to, false).is_err());
    }

    #[test]
    fn a_restore_that_was_cut_off_is_told_and_done_again() {
        let dir = TempDir::new().unwrap();
        fs::create_dir(dir.path().join(PLACING)).unwrap();
        let refused = sqlite::open(dir.path()).map(drop).unwrap_err();
        assert!(refused.to_string().contains("restore it again with --force"), "{refused}");
        let place = Place::take(dir.path(), true).unwrap();
        let _empty = place.gather().unwrap();
        place.put("now").unwrap();
        drop(place);
        drop(sqlite::open(dir.path()).unwrap());
    }

    #[test]
    fn what_is_damaged_newer_or_another_programs_is_no_copy() {
        let dir = TempDir::new().unwrap();
        drop(store(dir.path()));
        let file = dir.path().join("state.db");
        let set = |pragma: &str| Connection::open(&file).unwrap().execute_batch(pragma).unwrap();
        set("PRAGMA user_version = 99");
        assert!(matches!(check(dir.path()), Err(StoreError::Newer { .. })));
        set("PRAGMA user_version = 11; PRAGMA application_id = 7");
        assert!(matches!(check(dir.path()), Err(StoreError::Foreign { .. })));
        fs::write(&file, vec![7; 8192]).unwrap();
        assert!(matches!(check(dir.path()), Err(StoreError::Corrupt { .. })));
        fs::remove_file(&file).unwrap();
        assert!(check(dir.path()).is_err(), "missing");
    }
}
