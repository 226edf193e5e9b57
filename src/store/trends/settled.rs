//! Files that are made coarser as a whole: nothing in them is news to the coarser tier, so that a question to it need not
//! open them again. A year of hours would else open every day and every month.

use super::open::with_end;
use super::period::Period;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::SystemTime;

/// What tells a file from the same file after a change: its last writing and its bytes.
pub(super) type Stamp = (SystemTime, u64);

/// The files, as they were when nothing of them was left to be made coarser; cheap to clone, shared by all questions.
#[derive(Debug, Clone, Default)]
pub(super) struct Settled {
    files: Arc<Mutex<BTreeMap<Period, Stamp>>>,
}

impl Settled {
    /// Whether a file is as it was noted.
    pub(super) fn has(&self, folder: &Path, period: Period) -> bool {
        let noted = self.lock().get(&period).copied();
        noted.is_some() && noted == stamp(folder, period)
    }

    /// Notes a file of which nothing is left, as it was before that was read; `None`: it is being written.
    pub(super) fn note(&self, period: Period, stamp: Option<Stamp>) {
        let mut files = self.lock();
        match stamp {
            Some(stamp) => drop(files.insert(period, stamp)),
            None => drop(files.remove(&period)),
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<Period, Stamp>> {
        self.files.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The stamp of a file; `None`: there is none, or some of it stands in its log, which shows no change of the file.
pub(super) fn stamp(folder: &Path, period: Period) -> Option<Stamp> {
    let path = folder.join(period.name());
    let found = fs::metadata(&path).ok()?;
    let log = fs::metadata(with_end(&path, "-wal")).map_or(0, |log| log.len());
    (log == 0).then_some((found.modified().ok()?, found.len()))
}
