//! Room on the disk: when it comes to an end, the oldest raw data give way, so that alarms can be stored.
//!
//! Recordings first, then captures, then the oldest trends, one file after another until there is room. What another
//! program fills cannot be helped: then alarms wait in memory.

use super::trouble::Troubles;
use crate::capture::recording::store::Store as Recordings;
use crate::capture::recording::store::StoreEvent;
use crate::signal::Timestamp;
use crate::store::trends::TrendStore;
use crate::telemetry::RoomMetrics;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;

/// Of the disk, this part is kept free, ...
const RESERVED_PART: u64 = 16;

/// ... but no more than this, bytes.
const RESERVED_BYTES: u64 = 64 << 20;

/// Files that give way between two looks at other things.
const AT_ONCE: usize = 64;

/// How captures, which another thread has, are asked to give way.
#[derive(Debug, Default)]
pub(super) struct CapturesGiveWay {
    is_wanted: AtomicBool,
    n_finished: AtomicUsize,
}

impl CapturesGiveWay {
    /// Whether the oldest shall go; asked once for each time.
    pub(super) fn take(&self) -> bool {
        self.is_wanted.swap(false, Ordering::Relaxed)
    }

    /// Says how many could go.
    pub(super) fn set_finished(&self, n: usize) {
        self.n_finished.store(n, Ordering::Relaxed);
    }

    /// Asks one to go; false: there is none.
    fn ask(&self) -> bool {
        let is_any = self.n_finished.load(Ordering::Relaxed) > 0;
        if is_any {
            self.is_wanted.store(true, Ordering::Relaxed);
        }
        is_any
    }
}

/// Keeps room.
#[derive(Debug)]
pub(super) struct Room {
    pub(super) root: PathBuf,
    pub(super) recordings: Option<Arc<Mutex<Recordings>>>,
    pub(super) captures: Arc<CapturesGiveWay>,
    pub(super) troubles: Troubles,
    pub(super) metrics: RoomMetrics,
}

/// Bytes that are free, and that shall be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Space {
    free: u64,
    reserved: u64,
}

impl Space {
    fn is_short(self) -> bool {
        self.free < self.reserved
    }
}

impl Room {
    /// Looks, and lets give way what must.
    pub(super) fn keep(&self, trends: &mut dyn TrendStore, now: Timestamp) {
        let Some(mut space) = self.space() else { return };
        let mut gone = Vec::new();
        while space.is_short() && gone.len() < AT_ONCE {
            if let Some(file) = self.remove_recording() {
                self.metrics.recordings.inc();
                gone.push(file);
            } else if self.captures.ask() {
                // Its thread removes it, and counts it.
                gone.push("the oldest capture".to_owned());
                break;
            } else if remove_trends(trends, now) {
                self.metrics.trends.inc();
                gone.push("the oldest trends".to_owned());
            } else {
                break;
            }
            space = self.space().unwrap_or(space);
        }
        self.metrics.free.set(i64::try_from(space.free).unwrap_or(i64::MAX));
        if gone.is_empty() && !space.is_short() {
            return;
        }
        let free = space.free;
        let why = match gone.as_slice() {
            [] => format!("the disk is full: {free} bytes are free, and nothing can give way"),
            [one] => format!("the disk is full: {one} was given up, {free} bytes are free"),
            [first, ..] => {
                let n = gone.len();
                format!(
                    "the disk is full: {first} and {} more were given up, {free} bytes are free",
                    n - 1
                )
            }
        };
        if !gone.is_empty() {
            tracing::error!(
                n_files = gone.len(),
                first = gone[0],
                free,
                "given up: the disk is full"
            );
        }
        self.troubles.lost("room", why, super::now());
    }

    /// What the disk says; `None`: nothing.
    fn space(&self) -> Option<Space> {
        let disk = rustix::fs::statvfs(&self.root).ok()?;
        let total = disk.f_blocks.saturating_mul(disk.f_frsize);
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        Some(Space { free, reserved: (total / RESERVED_PART).min(RESERVED_BYTES) })
    }

    /// Removes the oldest recording; gives its name.
    fn remove_recording(&self) -> Option<String> {
        let recordings = self.recordings.as_ref()?;
        let event = recordings.lock().unwrap_or_else(PoisonError::into_inner).give_way()?;
        match event {
            StoreEvent::Removed { file, .. } => Some(
                file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            ),
            StoreEvent::Unusable { place, error } => {
                tracing::error!(place = %place.display(), %error, "a recording cannot be removed");
                None
            }
            StoreEvent::Recovered { .. }
            | StoreEvent::Damaged { .. }
            | StoreEvent::TemporaryRemoved { .. } => None,
        }
    }
}

/// Removes the oldest file of trends that may go.
fn remove_trends(trends: &mut dyn TrendStore, now: Timestamp) -> bool {
    // Without limits first: that says what there is.
    let held = trends.prune(now, u64::MAX);
    let after = trends.prune(now, held.bytes.saturating_sub(1));
    after.n_removed > held.n_removed
}
