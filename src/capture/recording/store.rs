//! The folder of recordings: names, recovery at start, and the limit on its bytes.
//!
//! One folder a machine, `<machine>/<machine>-<number>.h5`. Shared by the recorders of all
//! machines. Only finished recordings are ever removed, the oldest first: a file of another name, or
//! without the mark of a recording, is none and is left alone.

use super::super::error::CaptureError;
use super::super::layout;
use super::repair::{self, Repair};
use std::collections::BTreeMap;
use std::fs::{self, TryLockError};
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
    /// Bytes of recordings put aside as damaged: they count, and only people remove them.
    damaged_bytes: u64,
}

impl Store {
    /// Opens the folder `root`, closes recordings left open in it and removes temporary files.
    ///
    /// Recordings that other recorders are writing are left alone. Nothing here is an error: a
    /// folder that cannot be used shows when something is to be written.
    #[must_use]
    pub fn open(root: &Path, max_bytes: u64) -> (Self, Vec<StoreEvent>) {
        let (finished, growing) = (BTreeMap::new(), BTreeMap::new());
        let root = root.to_owned();
        let mut store = Self { root, max_bytes, finished, growing, damaged_bytes: 0 };
        let mut events = Vec::new();
        for folder in entries(&store.root, &mut events) {
            // What a link leads to is not ours.
            if fs::symlink_metadata(&folder).is_ok_and(|found| found.is_dir()) {
                for file in entries(&folder, &mut events) {
                    store.take_in(file, &mut events);
                }
            }
        }
        events.extend(store.keep_limit());
        (store, events)
    }

    fn take_in(&mut self, file: PathBuf, events: &mut Vec<StoreEvent>) {
        let Some(part) = part_of(&file) else { return };
        let length = match fs::symlink_metadata(&file) {
            Ok(found) if found.is_file() => found.len(),
            Ok(_) => return,
            Err(error) => return events.push(StoreEvent::Unusable { place: file, error }),
        };
        match part {
            Part::Temporary => return events.extend(remove_abandoned(file)),
            Part::Damaged => {
                self.damaged_bytes = self.damaged_bytes.saturating_add(length);
                return;
            }
            Part::Recording => {}
        }
        if repair::is_flagged(&file) || length == 0 {
            match repair::repair(&file) {
                Ok(Repair::NothingToDo) => {}
                Ok(Repair::Repaired { samples }) => {
                    events.push(StoreEvent::Recovered { file: file.clone(), samples });
                }
                // Another recorder has it.
                Err(CaptureError::Content { object, .. }) if object == "the file" => return,
                Err(error) => {
                    let aside = put_aside(&file);
                    self.damaged_bytes = self.damaged_bytes.saturating_add(length);
                    events.push(StoreEvent::Damaged { file, aside, error });
                    return;
                }
            }
        }
        if !layout::is_recording(&file) {
            return;
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
        self.next_file_after(machine, 0).map(|(_, file)| file)
    }

    /// The same, with a number above `used` too; gives the number with it.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made or read.
    pub fn next_file_after(&self, machine: &str, used: u64) -> io::Result<(u64, PathBuf)> {
        let machine = as_name(machine);
        let folder = self.root.join(&machine);
        fs::create_dir_all(&folder)?;
        let mut highest = used;
        for entry in fs::read_dir(&folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            highest = highest.max(number(&name, &machine).unwrap_or(0));
        }
        let number = highest.saturating_add(1);
        Ok((number, folder.join(format!("{machine}-{number:0DIGITS$}.h5"))))
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

    /// Lets recordings take so many bytes from now on; kept when the next of them grows.
    pub fn set_limit(&mut self, max_bytes: u64) {
        self.max_bytes = max_bytes;
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

    /// Bytes of everything there is.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let held = self.finished.values().chain(self.growing.values());
        held.fold(self.damaged_bytes, |sum, bytes| sum.saturating_add(*bytes))
    }

    /// Removes the oldest finished recording because the disk has no room; `None`: there is none.
    pub fn give_way(&mut self) -> Option<StoreEvent> {
        while let Some(((at, file), bytes)) = self.finished.pop_first() {
            match fs::remove_file(&file) {
                Ok(()) => return Some(StoreEvent::Removed { file, bytes }),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => {
                    self.finished.insert((at, file.clone()), bytes);
                    return Some(StoreEvent::Unusable { place: file, error });
                }
            }
        }
        None
    }

    /// Recordings that may be removed.
    #[must_use]
    pub fn n_finished(&self) -> usize {
        self.finished.len()
    }

    fn keep_limit(&mut self) -> Vec<StoreEvent> {
        let (mut events, mut stuck) = (Vec::new(), Vec::new());
        let held = self.finished.values().chain(self.growing.values());
        let mut total = held.fold(self.damaged_bytes, |sum, bytes| sum.saturating_add(*bytes));
        while total > self.max_bytes {
            let Some(((at, file), bytes)) = self.finished.pop_first() else { break };
            match fs::remove_file(&file) {
                Ok(()) => {
                    total -= bytes;
                    events.push(StoreEvent::Removed { file, bytes });
                }
                Err(error) if error.kind() == io::ErrorKind::NotFound => total -= bytes,
                Err(error) => {
                    events.push(StoreEvent::Unusable { place: file.clone(), error });
                    stuck.push(((at, file), bytes));
                }
            }
        }
        // Still there, still counted, tried again the next time.
        self.finished.extend(stuck);
        events
    }
}

/// The file of a machine's recording with this name under `root`; `None`: it is no name of one, or there
/// is none.
#[must_use]
pub fn recording(root: &Path, machine: &str, name: &str) -> Option<PathBuf> {
    let file = root.join(as_name(machine)).join(name);
    // A name with a folder in it would lead elsewhere.
    let is_plain = Path::new(name).file_name().is_some_and(|plain| plain == name);
    let is_recording = is_plain && matches!(part_of(&file), Some(Part::Recording));
    let is_file = || fs::symlink_metadata(&file).is_ok_and(|found| found.is_file());
    (is_recording && is_file()).then_some(file)
}

/// A recording in the store, being written or not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// Name of its file.
    pub name: String,
    /// Bytes.
    pub bytes: u64,
    /// When it was written last, if the file system says so.
    pub written: Option<SystemTime>,
}

/// Recordings of a machine under `root`, newest first; none if there is no such folder.
///
/// # Errors
///
/// If the folder cannot be read.
pub fn recorded(root: &Path, machine: &str) -> io::Result<Vec<Recorded>> {
    let listed = match fs::read_dir(root.join(as_name(machine))) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        listed => listed?,
    };
    let mut found = Vec::new();
    for entry in listed {
        let file = entry?.path();
        let Some(name) = file.file_name().and_then(|name| name.to_str()) else { continue };
        // A link, or a file that is gone since, is none.
        let Ok(facts) = fs::symlink_metadata(&file) else { continue };
        if facts.is_file() && matches!(part_of(&file), Some(Part::Recording)) {
            let written = facts.modified().ok();
            found.push(Recorded { name: name.to_owned(), bytes: facts.len(), written });
        }
    }
    // Numbers have the same digits, but for those of eight nines and more.
    found.sort_by(|a, b| (b.name.len(), &b.name).cmp(&(a.name.len(), &a.name)));
    Ok(found)
}

/// What a file in a machine's folder is to the store.
enum Part {
    Recording,
    Temporary,
    Damaged,
}

/// Tells by its name what a file is; `None`: nothing of ours.
fn part_of(file: &Path) -> Option<Part> {
    let name = file.file_name()?.to_str()?;
    let folder = file.parent()?.file_name()?.to_str()?;
    let rest = name.trim_start_matches('.').strip_prefix(folder)?.strip_prefix('-')?;
    let (digits, rest) = rest.split_once('.')?;
    if digits.len() < DIGITS || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    match (name.starts_with('.'), rest) {
        (false, "h5") => Some(Part::Recording),
        (false, "h5.damaged") => Some(Part::Damaged),
        (true, rest) => {
            let process = rest.strip_prefix("h5.")?.strip_suffix(".part")?;
            process.bytes().all(|byte| byte.is_ascii_digit()).then_some(Part::Temporary)
        }
        (false, _) => None,
    }
}

/// Removes a file that never was complete, unless its recorder, which holds a lock, is at work.
fn remove_abandoned(file: PathBuf) -> Option<StoreEvent> {
    let unlocked = fs::File::open(&file).and_then(|open| match open.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    });
    match unlocked
        .and_then(|free| if free { fs::remove_file(&file).map(|()| true) } else { Ok(false) })
    {
        Ok(true) => Some(StoreEvent::TemporaryRemoved { file }),
        Ok(false) => None,
        Err(error) => Some(StoreEvent::Unusable { place: file, error }),
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
