//! What is kept for how long, what it will take, and which files go.

use super::open::with_end;
use super::period::Period;
use super::period::Tier;
use crate::signal::Timestamp;
use std::fs;
use std::io;
use std::path::Path;
use std::path::PathBuf;
use std::time::UNIX_EPOCH;

/// How long each tier is kept, days.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Retention {
    /// Every window.
    pub windows_days: u32,
    /// Minutes.
    pub minutes_days: u32,
    /// Hours.
    pub hours_days: u32,
}

impl Default for Retention {
    fn default() -> Self {
        Self { windows_days: 30, minutes_days: 90, hours_days: 1830 }
    }
}

impl Retention {
    fn days(&self, tier: Tier) -> u32 {
        match tier {
            Tier::Windows => self.windows_days,
            Tier::Minutes => self.minutes_days,
            Tier::Hours => self.hours_days,
        }
    }
}

/// Files and bytes of trends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Holdings {
    /// Files, those put aside included.
    pub n_files: u64,
    /// Their bytes, logs included.
    pub bytes: u64,
    /// Of them those of logs, which are used again and again.
    pub log_bytes: u64,
    /// Files removed since the start.
    pub n_removed: u64,
    /// Damaged files put aside since the start.
    pub n_set_aside: u64,
}

/// Features of a channel assumed until some are stored.
const ASSUMED_FEATURES: f64 = 64.0;

/// Bytes of a stored value with what is made coarser of it: measured on noise, the worst there is (docs/performance.md).
const BYTES_PER_VALUE: f64 = 3.6;

/// Bytes that verdicts, keys and pages add to a window.
const BYTES_PER_WINDOW: f64 = 100.0;

/// Bytes that keys and pages add to a block of a coarser tier.
const BYTES_PER_BLOCK: f64 = 200.0;

/// Bytes that trends will take when they are as old as they may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Projection {
    /// Every window.
    pub windows_bytes: u64,
    /// Minutes.
    pub minutes_bytes: u64,
    /// Hours.
    pub hours_bytes: u64,
}

impl Projection {
    /// All tiers.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.windows_bytes.saturating_add(self.minutes_bytes).saturating_add(self.hours_bytes)
    }
}

/// Bytes that `n_channels` with a window every `hop_s` will take; `features`: how many a channel has, if
/// that is known.
#[must_use]
pub fn project(
    retention: &Retention,
    n_channels: usize,
    hop_s: f64,
    features: Option<f64>,
) -> Projection {
    let n = n_channels as f64;
    let features = features.unwrap_or(ASSUMED_FEATURES).max(1.0);
    // Smallest, mean and largest are values as others are; the number of values hardly takes anything.
    let block = |points: f64| 3.0 * features * BYTES_PER_VALUE * points + BYTES_PER_BLOCK;
    let window = features * BYTES_PER_VALUE + BYTES_PER_WINDOW;
    // A file goes as a whole: a tier holds up to a file more than its days.
    let days = |days: u32, more: f64| f64::from(days) + more;
    let bytes = |bytes: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let bytes = bytes.ceil() as u64;
        bytes
    };
    Projection {
        windows_bytes: bytes(days(retention.windows_days, 1.0) * n * window * 86_400.0 / hop_s),
        minutes_bytes: bytes(days(retention.minutes_days, 31.0) * n * 24.0 * block(60.0)),
        hours_bytes: bytes(days(retention.hours_days, 366.0) * n * block(24.0)),
    }
}

/// The files of trends in a folder, finest tier first, oldest first.
pub(super) fn files(folder: &Path) -> Vec<(Period, PathBuf)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<(Period, PathBuf)> = entries
        .filter_map(|entry| {
            let name = entry.file_name();
            let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
            Some((Period::parse(name.to_str().filter(|_| is_file)?)?, entry.path()))
        })
        .collect();
    found.sort();
    found
}

/// Number, bytes and bytes of logs of everything in the folder that trends are or were in.
pub(super) fn held(folder: &Path) -> (u64, u64, u64) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let sizes = entries.filter_map(|entry| {
        let name = entry.file_name();
        let length = entry.metadata().ok().filter(fs::Metadata::is_file)?.len();
        let is_log = name.to_str().is_some_and(|n| n.ends_with("-wal") || n.ends_with("-shm"));
        Some((is_log, length))
    });
    sizes.fold((0, 0, 0), |(n, bytes, log_bytes), (is_log, length)| match is_log {
        true => (n, bytes + length, log_bytes + length),
        false => (n + 1, bytes + length, log_bytes),
    })
}

/// A file with its log.
fn bytes_of(path: &Path) -> u64 {
    let length = |end| fs::metadata(with_end(path, end)).map_or(0, |found| found.len());
    length("") + length("-wal") + length("-shm")
}

/// When a file was written last, UTC.
fn written(path: &Path) -> Timestamp {
    let since = |end| {
        let changed = fs::metadata(with_end(path, end)).and_then(|found| found.modified());
        changed.ok()?.duration_since(UNIX_EPOCH).ok()
    };
    let newest = since("").max(since("-wal")).unwrap_or_default();
    Timestamp(i64::try_from(newest.as_nanos()).unwrap_or(i64::MAX))
}

/// The files that are too old, and the oldest while all take more than `max_bytes`, finest tier first;
/// never the newest of a tier. A file is as old as its period, or as its last writing where that is later:
/// what an old capture says is new when it is played.
pub(super) fn too_many(
    folder: &Path,
    retention: &Retention,
    now: Timestamp,
    max_bytes: u64,
) -> Vec<(Period, PathBuf, u64)> {
    let mut all: Vec<(Timestamp, Period, PathBuf, u64)> = files(folder)
        .into_iter()
        .map(|(period, path)| {
            let (at, bytes) = (period.end().max(written(&path)), bytes_of(&path));
            (at, period, path, bytes)
        })
        .collect();
    all.sort_by_key(|file| (file.1.tier, file.0, file.1));
    let newest: Vec<PathBuf> = Tier::ALL
        .iter()
        .filter_map(|tier| all.iter().rfind(|file| file.1.tier == *tier))
        .map(|file| file.2.clone())
        .collect();
    let mut total = held(folder).1;
    let mut gone = Vec::new();
    for (at, period, path, bytes) in all {
        let days = i64::from(retention.days(period.tier));
        let is_old = now.0.saturating_sub(at.0) > days.saturating_mul(86_400_000_000_000);
        if (is_old || total > max_bytes) && !newest.contains(&path) {
            total = total.saturating_sub(bytes);
            gone.push((period, path, bytes));
        }
    }
    gone
}

/// Removes a file with its log.
pub(super) fn remove(path: &Path) -> io::Result<()> {
    for end in ["-wal", "-shm"] {
        // Without the file they mean nothing; usually they are gone with its last connection.
        let _usually_gone = fs::remove_file(with_end(path, end));
    }
    fs::remove_file(path)
}
