//! Captures of raw data around alarms: every shard's way to the thread that writes them, bounded in bytes, nobody waits.

mod again;
mod writing;

use super::room::CapturesGiveWay;
use super::trouble::Troubles;
use crate::capture::held::Held;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::capture::recording::store::Store;
use crate::capture::recording::store::StoreEvent;
use crate::capture::writer::CaptureHeader;
use crate::causes::with_causes;
use crate::config;
use crate::config::Config;
use crate::evidence::kept::Judged;
use crate::pipeline::Passed;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::captures::CaptureEntry;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureQuery;
use crate::store::captures::CaptureState;
use crate::store::captures::Ending;
use crate::store::captures::SqliteCaptures;
use crate::telemetry::CaptureMetrics;
use crate::telemetry::RoomMetrics;
use std::collections::BTreeMap;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc;
use std::sync::mpsc::TrySendError;
use std::time::Duration;
use tokio::sync::oneshot;
use toml::Table;
pub(super) use writing::CapturesPlan;

/// Folder of captures in the store.
pub(super) const FOLDER: &str = "captures";

/// Why a capture is gone.
const FOR_NEWER: &str = "it gave way to newer ones (captures.max_bytes)";
const FOR_ROOM: &str = "it was given up: the disk was full";

/// Jobs that may wait; their bytes are what bounds them.
const QUEUE: usize = 4096;

/// How long a capture may get nothing before it is closed: whoever should have ended it is gone.
const IDLE: Duration = Duration::from_secs(600);

/// A capture to be made.
#[derive(Debug)]
pub(super) struct Order {
    pub(super) machine: String,
    pub(super) header: CaptureHeader,
    pub(super) judged: Arc<Judged>,
    /// Hash of the configuration by which its windows were judged.
    pub(super) configuration: String,
    pub(super) about: Table,
    pub(super) runs: Vec<Arc<Received>>,
    pub(super) windows: Vec<Arc<Passed>>,
    pub(super) from_s: f64,
    pub(super) trigger_s: f64,
    pub(super) ends_s: f64,
    pub(super) requested: Timestamp,
    pub(super) alarms: Vec<u64>,
    /// The operator who asked for it.
    pub(super) by: Option<(String, String)>,
    /// Who waits for its id.
    pub(super) reply: Option<oneshot::Sender<Result<String, String>>>,
}

/// What the thread is told.
#[derive(Debug)]
enum Job {
    Begin(u64, Box<Order>),
    GoOn(u64, Arc<Received>),
    /// What follows was lost.
    CutShort(u64),
    /// It has all that it should, or what is noted.
    End(u64, Option<String>),
    Refuse {
        machine: String,
        alarms: Vec<u64>,
        why: String,
    },
}

/// A shard's way to the thread; cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct Capturer {
    jobs: mpsc::SyncSender<Job>,
    waiting: Arc<AtomicUsize>,
    max_waiting: Arc<AtomicUsize>,
    keys: Arc<AtomicU64>,
}

impl Capturer {
    /// Has a capture begun; gives its key, or nothing if there is no room, which is told where the alarm is.
    pub(super) fn begin(&self, mut order: Order) -> Option<u64> {
        let key = self.keys.fetch_add(1, Ordering::Relaxed);
        let bytes = order.runs.iter().map(|run| run.bytes()).sum();
        let (machine, alarms) = (order.machine.clone(), order.alarms.clone());
        let reply = order.reply.take();
        if !self.has_room(bytes) {
            let why = "the disk does not keep up with captures: too many bytes wait".to_owned();
            if let Some(reply) = reply {
                // Who asked may have gone: then the answer is dropped.
                drop(reply.send(Err(why.clone())));
            }
            self.refuse(&machine, alarms, why);
            return None;
        }
        order.reply = reply;
        self.send(Job::Begin(key, Box::new(order)), bytes).then_some(key)
    }

    /// Hands on what follows.
    pub(super) fn go_on(&self, key: u64, run: Arc<Received>) {
        let bytes = run.bytes();
        if !self.has_room(bytes) || !self.send(Job::GoOn(key, run), bytes) {
            self.send(Job::CutShort(key), 0);
        }
    }

    /// Says that a capture has all that it should, or what is noted; false: there was no room for that, say it again.
    pub(super) fn end(&self, key: u64, note: Option<String>) -> bool {
        !matches!(self.jobs.try_send(Job::End(key, note)), Err(TrySendError::Full(_)))
    }

    /// Says why alarms have no capture.
    pub(super) fn refuse(&self, machine: &str, alarms: Vec<u64>, why: String) {
        tracing::warn!(machine, ?alarms, why, "no capture is made");
        self.send(Job::Refuse { machine: machine.to_owned(), alarms, why }, 0);
    }

    /// Lets so much more wait for the disk: a stream has become known.
    pub(super) fn allow_more(&self, bytes: usize) {
        self.max_waiting.fetch_add(bytes, Ordering::Relaxed);
    }

    fn has_room(&self, bytes: usize) -> bool {
        let would_wait = self.waiting.load(Ordering::Relaxed).saturating_add(bytes);
        would_wait <= self.max_waiting.load(Ordering::Relaxed)
    }

    fn send(&self, job: Job, bytes: usize) -> bool {
        self.waiting.fetch_add(bytes, Ordering::Relaxed);
        let is_sent = self.jobs.try_send(job).is_ok();
        if !is_sent {
            self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            tracing::error!("a job of a capture is lost, too many wait");
        }
        is_sent
    }
}

/// Captures in the daemon.
#[derive(Debug)]
pub(super) struct Captures {
    pub(super) capturer: Capturer,
    pub(super) plan: CapturesPlan,
    pub(super) handle: crate::api::handles::CaptureHandle,
}

/// Bytes that captures of a stream need in memory: what is held, and what waits for the disk.
pub(super) fn memory_bytes(
    settings: Option<config::Captures>,
    channels: &[ReceivedChannel],
) -> usize {
    let held = settings.map_or(0, |captures| Held::bytes(channels, captures.before_s));
    held.saturating_add(waiting_bytes(settings, channels))
}

/// Bytes of a capture of a stream, which may wait for the disk as a whole.
pub(super) fn waiting_bytes(
    settings: Option<config::Captures>,
    channels: &[ReceivedChannel],
) -> usize {
    settings.map_or(0, |captures| Held::bytes(channels, captures.before_s + captures.after_s))
}

/// Opens the folder and the index, recovers what was left open and brings both together; `None` if captures are
/// off. `max_waiting`: bytes that may wait for the disk.
///
/// # Errors
/// When the index cannot be opened.
pub(super) fn open(
    config: &Config,
    max_waiting: usize,
    (metrics, room): (CaptureMetrics, RoomMetrics),
    (troubles, give_way): (Troubles, Arc<CapturesGiveWay>),
) -> Result<Option<Captures>, StoreError> {
    let Some(settings) = config.captures else { return Ok(None) };
    let index: Arc<dyn CaptureIndex> = Arc::new(SqliteCaptures::join(&config.store.directory)?);
    let root = config.store.directory.join(FOLDER);
    let (store, events) = Store::open(&root, settings.max_bytes);
    if let Err(error) = reconcile(&*index, &root, &events) {
        tracing::error!(error = with_causes(&error), "the index of captures is behind");
    }
    metrics.bytes.set(i64::try_from(store.bytes()).unwrap_or(i64::MAX));
    let (jobs, inbox) = mpsc::sync_channel(QUEUE);
    let waiting = Arc::new(AtomicUsize::new(0));
    let max_waiting = Arc::new(AtomicUsize::new(max_waiting));
    let capturer =
        Capturer { jobs, waiting: Arc::clone(&waiting), max_waiting, keys: Arc::default() };
    let judge = Arc::new(again::judge);
    let handle = crate::api::handles::CaptureHandle { index: Arc::clone(&index), root, judge };
    let plan = CapturesPlan {
        jobs: inbox,
        waiting,
        index,
        store,
        metrics,
        room,
        troubles,
        give_way,
        idle: IDLE,
    };
    Ok(Some(Captures { capturer, plan, handle }))
}

/// The file of a capture: its id is the name of the file, in the folder that the name begins with.
pub(super) fn file_of(root: &Path, id: &str) -> Option<PathBuf> {
    let (machine, _) = id.rsplit_once('-')?;
    crate::capture::recording::store::recording(root, machine, &format!("{id}.h5"))
}

/// Brings the index up to date with the files: what was being written, and what is gone.
fn reconcile(
    index: &dyn CaptureIndex,
    root: &Path,
    events: &[StoreEvent],
) -> Result<(), StoreError> {
    let mut recovered = BTreeMap::new();
    for event in events {
        log(event);
        if let StoreEvent::Recovered { file, samples } = event {
            let n: u64 = samples.iter().map(|(_, n)| n).sum();
            recovered.insert(id_of(file), n);
        }
        note_removed(index, event, FOR_NEWER);
    }
    let mut query = CaptureQuery { limit: 1000, ..CaptureQuery::default() };
    loop {
        let page = index.list(&query)?;
        for entry in page.iter().filter(|entry| entry.state.has_file()) {
            if let Some(ending) =
                ending_of(entry, file_of(root, &entry.id), recovered.get(&entry.id))
            {
                index.end(&entry.id, &ending)?;
            }
        }
        match page.last() {
            Some(last) if page.len() == query.limit => query.after = Some(last.id.clone()),
            Some(_) | None => return Ok(()),
        }
    }
}

/// What became of a capture while nobody looked; `None`: nothing.
fn ending_of(
    entry: &CaptureEntry,
    file: Option<PathBuf>,
    n_recovered: Option<&u64>,
) -> Option<Ending> {
    let bytes = file.as_ref().and_then(|file| file.metadata().ok()).map(|found| found.len());
    let ending = |state, note: String, bytes| Ending { state, note: Some(note), bytes, to_s: None };
    match (entry.state, file, n_recovered) {
        (CaptureState::Writing, Some(_), n) => {
            let n = n.map_or_else(String::new, |n| format!(", {n} samples"));
            let note = format!("its writing was cut off; what had reached the disk is there{n}");
            Some(ending(CaptureState::Recovered, note, bytes))
        }
        (CaptureState::Writing, None, _) => {
            let note = "its writing was cut off before any of it had reached the disk".to_owned();
            Some(ending(CaptureState::Failed, note, Some(0)))
        }
        (CaptureState::Complete | CaptureState::Recovered, None, _) => {
            let note = "its file is not there any more".to_owned();
            Some(ending(CaptureState::Removed, note, Some(0)))
        }
        (_, _, _) => None,
    }
}

fn id_of(file: &Path) -> String {
    file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

fn note_removed(index: &dyn CaptureIndex, event: &StoreEvent, why: &str) {
    if let StoreEvent::Removed { file, .. } = event {
        let note = Some(why.to_owned());
        let ending = Ending { state: CaptureState::Removed, note, bytes: Some(0), to_s: None };
        if let Err(error) = index.end(&id_of(file), &ending) {
            tracing::error!(error = with_causes(&error), "a removed capture is still in the index");
        }
    }
}

fn log(event: &StoreEvent) {
    match event {
        StoreEvent::Recovered { file, samples } => {
            let n_samples: u64 = samples.iter().map(|(_, n)| n).sum();
            tracing::warn!(file = %file.display(), n_samples, "capture left open was recovered");
        }
        StoreEvent::Damaged { file, aside, error } => {
            let (file, aside, error) = (file.display(), aside.display(), with_causes(error));
            tracing::error!(%file, %aside, error, "capture cannot be recovered, put aside");
        }
        StoreEvent::TemporaryRemoved { file } => {
            tracing::warn!(file = %file.display(), "capture that was never complete removed");
        }
        StoreEvent::Removed { file, bytes } => {
            tracing::info!(file = %file.display(), bytes, "oldest capture removed");
        }
        StoreEvent::Unusable { place, error } => {
            tracing::error!(place = %place.display(), %error, "captures cannot be kept");
        }
    }
}

#[cfg(test)]
mod tests;
