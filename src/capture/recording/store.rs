//! The folder of recordings: names, recovery at start, and the limit on its bytes.
//!
//! One folder a machine, `<machine>/<machine>-<number>.h5`. Shared by the recorders of all
//! machines. Only finished files are ever removed, the oldest first.

use super::super::error::CaptureError;
use super::repair::{self, Repair};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Digits of the number in a name.
const DIGITS: usize = 8;

/// What was found when the store was opened, or done to keep its limit.
#[derive(Debug)]
pub enum StoreEvent {
    /// A recording left open was closed and read to its last sample.
    Recovered {
        /// The file.
        file: PathBuf,
        /// Samples of each channel, by name.
        samples: Vec<(String, u64)>,
    },
    /// A recording left open cannot be read; it was put aside.
    Damaged {
        /// The file.
        file: PathBuf,
        /// Its name now; the old one if it cannot be renamed.
        aside: PathBuf,
        /// What is wrong with it.
        error: CaptureError,
    },
    /// A file that never was complete was removed.
    TemporaryRemoved {
        /// The file.
        file: PathBuf,
    },
    /// The oldest finished recording gave way.
    Removed {
        /// The file.
        file: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// A folder or file cannot be looked at or removed.
    Unusable {
        /// Which.
        place: PathBuf,
        /// Why.
        error: io::Error,
    },
}

/// Files and bytes of a machine, the file being written included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Holdings {
    /// Files.
    pub n_files: u64,
    /// Their bytes.
    pub bytes: u64,
}

/// The store.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    max_bytes: u64,
    /// Bytes of finished recordings, the oldest first.
    finished: BTreeMap<(SystemTime, PathBuf), u64>,
    /// Bytes of recordings being written.
    growing: BTreeMap<PathBuf, u64>,
}

impl Store {
    /// Opens the folder `root`, closes recordings left open in it and removes temporary files.
    ///
    /// Recordings that other recorders are writing are left alone. Nothing here is an error: a
    /// folder that cannot be used shows when something is to be written.
    #[must_use]
    pub fn open(root: &Path, max_bytes: u64) -> (Self, Vec<StoreEvent>) {
        let (finished, growing) = (BTreeMap::new(), BTreeMap::new());
        let mut store = Self { root: root.to_owned(), max_bytes, finished, growing };
        let mut events = Vec::new();
        for folder in entries(root, &mut events) {
            if folder.is_dir() {
                for file in entries(&folder, &mut events) {
                    store.take_in(file, &mut events);
                }
            }
        }
        events.extend(store.keep_limit());
        (store, events)
    }

    fn take_in(&mut self, file: PathBuf, events: &mut Vec<StoreEvent>) {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with('.') && name.ends_with(".part") {
            events.push(match fs::remove_file(&file) {
                Ok(()) => StoreEvent::TemporaryRemoved { file },
                Err(error) => StoreEvent::Unusable { place: file, error },
            });
            return;
        }
        if !name.ends_with(".h5") {
            return;
        }
        if repair::is_flagged(&file) || fs::metadata(&file).is_ok_and(|found| found.len() == 0) {
            match repair::repair(&file) {
                Ok(Repair::NothingToDo) => {}
                Ok(Repair::Repaired { samples }) => {
                    events.push(StoreEvent::Recovered { file: file.clone(), samples });
                }
                // Another recorder has it.
                Err(CaptureError::Content { object, .. }) if object == "the file" => return,
                Err(error) => {
                    let aside = put_aside(&file);
                    events.push(StoreEvent::Damaged { file, aside, error });
                    return;
                }
            }
        }
        if let Err(error) = self.note_finished(&file) {
            events.push(StoreEvent::Unusable { place: file, error });
        }
    }

    /// A name for the next recording of a machine, higher than any there is; makes the folder.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made or read.
    pub fn next_file(&self, machine: &str) -> io::Result<PathBuf> {
        let machine = as_name(machine);
        let folder = self.root.join(&machine);
        fs::create_dir_all(&folder)?;
        let mut highest = 0;
        for entry in fs::read_dir(&folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            highest = highest.max(number(&name, &machine).unwrap_or(0));
        }
        Ok(folder.join(format!("{machine}-{:0DIGITS$}.h5", highest + 1)))
    }

    /// Notes how long a recording being written is; removes finished ones over the limit.
    pub fn note_growing(&mut self, file: &Path, bytes: u64) -> Vec<StoreEvent> {
        self.growing.insert(file.to_owned(), bytes);
        self.keep_limit()
    }

    /// Notes that a recording is written no longer: it may be removed from now on.
    ///
    /// # Errors
    ///
    /// If there is no such file.
    pub fn note_finished(&mut self, file: &Path) -> io::Result<()> {
        self.growing.remove(file);
        let found = fs::metadata(file)?;
        let at = found.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        self.finished.insert((at, file.to_owned()), found.len());
        Ok(())
    }

    /// Notes that a recording being written came to nothing.
    pub fn forget(&mut self, file: &Path) {
        self.growing.remove(file);
    }

    /// What there is of a machine.
    #[must_use]
    pub fn holdings(&self, machine: &str) -> Holdings {
        let folder = self.root.join(as_name(machine));
        let finished = self.finished.iter().map(|((_, file), bytes)| (file, bytes));
        let all = finished.chain(&self.growing).filter(|(file, _)| file.parent() == Some(&folder));
        all.fold(Holdings::default(), |sum, (_, bytes)| Holdings {
            n_files: sum.n_files + 1,
            bytes: sum.bytes + bytes,
        })
    }

    fn keep_limit(&mut self) -> Vec<StoreEvent> {
        let mut events = Vec::new();
        let mut total: u64 = self.finished.values().chain(self.growing.values()).sum();
        while total > self.max_bytes {
            let Some(((_, file), bytes)) = self.finished.pop_first() else { break };
            total -= bytes;
            events.push(match fs::remove_file(&file) {
                Ok(()) => StoreEvent::Removed { file, bytes },
                Err(error) => StoreEvent::Unusable { place: file, error },
            });
        }
        events
    }
}

/// The entries of a folder by name; none if there is no such folder yet.
fn entries(folder: &Path, events: &mut Vec<StoreEvent>) -> Vec<PathBuf> {
    let listed: io::Result<Vec<PathBuf>> = fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.path())).collect());
    match listed {
        Ok(mut found) => {
            found.sort();
            found
        }
        Err(error) => {
            if error.kind() != io::ErrorKind::NotFound {
                events.push(StoreEvent::Unusable { place: folder.to_owned(), error });
            }
            Vec::new()
        }
    }
}

/// Renames a file that cannot be read; gives its name then.
fn put_aside(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(".damaged");
    let aside = PathBuf::from(name);
    if !aside.exists() && fs::rename(file, &aside).is_ok() { aside } else { file.to_owned() }
}

/// The number in a name of this machine, whatever follows it.
fn number(name: &str, machine: &str) -> Option<u64> {
    let rest = name.trim_start_matches('.').strip_prefix(machine)?.strip_prefix('-')?;
    rest.get(..rest.find('.')?)?.parse().ok()
}

/// A machine's id as the name of a folder.
fn as_name(machine: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    machine.chars().map(safe).collect()
}
