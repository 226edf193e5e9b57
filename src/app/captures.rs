//! The thread that writes captures, and every shard's way to it: bounded in bytes, nobody waits.
//!
//! A capture is in the index before its file is named, and its file has its name at the first flush; so after a kill
//! each is listed, with what had reached the disk.

use super::Clock;
use crate::capture::held::Held;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::capture::recording::file::RecordingHeader;
use crate::capture::recording::store::Store;
use crate::capture::recording::store::StoreEvent;
use crate::capture::recording::triggered::Next;
use crate::capture::recording::triggered::Plan;
use crate::capture::recording::triggered::Triggered;
use crate::capture::writer::CaptureHeader;
use crate::causes::with_causes;
use crate::config::Config;
use crate::evidence;
use crate::evidence::kept;
use crate::evidence::kept::Judged;
use crate::pipeline::Passed;
use crate::pipeline::Run;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::captures::CaptureEntry;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureQuery;
use crate::store::captures::CaptureState;
use crate::store::captures::Ending;
use crate::store::captures::SqliteCaptures;
use crate::telemetry::CaptureMetrics;
use std::collections::BTreeMap;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::oneshot;
use toml::Table;
use toml::Value;

/// Folder of captures in the store.
pub(super) const FOLDER: &str = "captures";

/// Jobs that may wait; their bytes are what bounds them.
const QUEUE: usize = 4096;

/// Longest time between two flushes.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// Captures open at once, all machines together.
const MAX_OPEN: usize = 64;

/// A capture to be made.
#[derive(Debug)]
pub(super) struct Order {
    pub(super) machine: String,
    pub(super) header: CaptureHeader,
    pub(super) judged: Arc<Judged>,
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
    End(u64),
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
    max_waiting: usize,
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

    /// Says that a capture has all that it should.
    pub(super) fn end(&self, key: u64) {
        self.send(Job::End(key), 0);
    }

    /// Says why alarms have no capture.
    pub(super) fn refuse(&self, machine: &str, alarms: Vec<u64>, why: String) {
        tracing::warn!(machine, ?alarms, why, "no capture is made");
        self.send(Job::Refuse { machine: machine.to_owned(), alarms, why }, 0);
    }

    fn has_room(&self, bytes: usize) -> bool {
        self.waiting.load(Ordering::Relaxed).saturating_add(bytes) <= self.max_waiting
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

/// The thread before it starts.
pub(super) struct CapturesPlan {
    jobs: mpsc::Receiver<Job>,
    waiting: Arc<AtomicUsize>,
    index: Arc<dyn CaptureIndex>,
    store: Store,
    configuration: String,
    metrics: CaptureMetrics,
}

impl std::fmt::Debug for CapturesPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CapturesPlan").finish_non_exhaustive()
    }
}

/// Captures in the daemon.
#[derive(Debug)]
pub(super) struct Captures {
    pub(super) capturer: Capturer,
    pub(super) plan: CapturesPlan,
    pub(super) handle: crate::api::view::CaptureHandle,
}

/// Bytes that captures of a stream need in memory: what is held, and what waits for the disk.
pub(super) fn memory_bytes(config: &Config, channels: &[ReceivedChannel]) -> usize {
    let held = config.captures.map_or(0, |captures| Held::bytes(channels, captures.before_s));
    held.saturating_add(waiting_bytes(config, channels))
}

/// Bytes of a capture of a stream, which may wait for the disk as a whole.
pub(super) fn waiting_bytes(config: &Config, channels: &[ReceivedChannel]) -> usize {
    config
        .captures
        .map_or(0, |captures| Held::bytes(channels, captures.before_s + captures.after_s))
}

/// Opens the folder and the index, recovers what was left open and brings both together; `None` if captures are
/// off. `max_waiting`: bytes that may wait for the disk.
///
/// # Errors
/// When the index cannot be opened.
pub(super) fn open(
    config: &Config,
    max_waiting: usize,
    metrics: CaptureMetrics,
) -> Result<Option<Captures>, StoreError> {
    let Some(settings) = config.captures else { return Ok(None) };
    let index: Arc<dyn CaptureIndex> = Arc::new(SqliteCaptures::join(&config.store.directory)?);
    let root = config.store.directory.join(FOLDER);
    let (store, events) = Store::open(&root, settings.max_bytes);
    if let Err(error) = reconcile(&*index, &root, &events) {
        tracing::error!(error = with_causes(&error), "the index of captures is behind");
    }
    let (jobs, inbox) = mpsc::sync_channel(QUEUE);
    let waiting = Arc::new(AtomicUsize::new(0));
    let capturer =
        Capturer { jobs, waiting: Arc::clone(&waiting), max_waiting, keys: Arc::default() };
    let handle = crate::api::view::CaptureHandle { index: Arc::clone(&index), root };
    let configuration = super::build::configuration_hash(config);
    let plan = CapturesPlan { jobs: inbox, waiting, index, store, configuration, metrics };
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
        note_removed(index, event);
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

fn note_removed(index: &dyn CaptureIndex, event: &StoreEvent) {
    if let StoreEvent::Removed { file, .. } = event {
        let note = Some("it gave way to newer ones (captures.max_bytes)".to_owned());
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

/// Stream time one past a run, s.
fn end_s(run: &Received, rates_hz: &[f64]) -> f64 {
    let rate_hz = rates_hz.get(run.channel.0).copied().unwrap_or(f64::INFINITY);
    run.time_s + run.raw.len() as f64 / rate_hz
}

/// A capture being written.
struct Open {
    id: String,
    file: PathBuf,
    capture: Triggered,
    rates_hz: Vec<f64>,
    ends_s: f64,
    /// Stream time of the newest sample written, s.
    to_s: f64,
    flushed: Instant,
    note: Option<String>,
}

impl CapturesPlan {
    /// Writes until every sender is gone and everything is written.
    pub(super) fn run(mut self, clock: Clock) {
        let mut open: BTreeMap<u64, Open> = BTreeMap::new();
        self.show();
        loop {
            match self.jobs.recv_timeout(FLUSH_EVERY) {
                Ok(job) => self.take(job, &mut open, clock),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let now = super::now();
            let is_due = |open: &Open| now.saturating_duration_since(open.flushed) >= FLUSH_EVERY;
            let due: Vec<u64> =
                open.iter().filter(|(_, o)| is_due(o)).map(|(key, _)| *key).collect();
            for key in due {
                self.flush(key, &mut open);
            }
        }
        for (_, mut left) in open {
            left.note.get_or_insert_with(|| "the program ended before it was complete".to_owned());
            self.close(left);
        }
    }

    fn take(&mut self, job: Job, open: &mut BTreeMap<u64, Open>, clock: Clock) {
        match job {
            Job::Begin(key, order) => {
                let bytes = order.runs.iter().map(|run| run.bytes()).sum();
                if let Some(begun) = self.begin(*order, open.len()) {
                    open.insert(key, begun);
                }
                self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            }
            Job::GoOn(key, run) => {
                let bytes = run.bytes();
                self.go_on(key, &run, open);
                self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            }
            Job::CutShort(key) => {
                if let Some(mut cut) = open.remove(&key) {
                    cut.note = Some("it ends early: the disk did not keep up".to_owned());
                    self.close(cut);
                }
            }
            Job::End(key) => {
                if let Some(done) = open.remove(&key) {
                    self.close(done);
                }
            }
            Job::Refuse { machine, alarms, why } => {
                self.metrics.refused.inc();
                let at = clock.moment(0.0).utc;
                if let Err(error) = self.index.refuse(&machine, &alarms, &why, at) {
                    tracing::error!(
                        error = with_causes(&error),
                        "why an alarm has no capture is not stored"
                    );
                }
            }
        }
    }

    /// Begins a capture and answers who asked for it.
    fn begin(&mut self, mut order: Order, n_open: usize) -> Option<Open> {
        let (machine, alarms, at) = (order.machine.clone(), order.alarms.clone(), order.requested);
        let reply = order.reply.take();
        let begun = if n_open < MAX_OPEN {
            self.try_begin(order)
        } else {
            Err(format!("{MAX_OPEN} captures are being written"))
        };
        let answer = begun.as_ref().map(|open| open.id.clone()).map_err(Clone::clone);
        if let Some(reply) = reply {
            // Who asked may have gone: then the answer is dropped.
            drop(reply.send(answer));
        }
        begun
            .map_err(|why| {
                tracing::error!(machine, why, "a capture cannot be made");
                self.metrics.failed.inc();
                if let Err(error) = self.index.refuse(&machine, &alarms, &why, at) {
                    tracing::error!(
                        error = with_causes(&error),
                        "why an alarm has no capture is not stored"
                    );
                }
            })
            .ok()
    }

    fn try_begin(&mut self, order: Order) -> Result<Open, String> {
        let received = &order.judged.received;
        let plan = Plan::new(&order.runs, received, order.from_s)
            .ok_or("no raw data of the time before the alarm are held")?;
        let place = |channel: usize, segment: u32, run: &Run| {
            plan.place(channel, segment, run.start, run.n_samples as u64)
        };
        let windows = kept::placed(&order.windows, &place);
        let about = self.about(order.about);
        let evidence = kept::lists(&about, &order.judged, windows, &place);
        let n_windows = windows.len() as u64;
        let used = self.index.highest(&order.machine).map_err(|error| with_causes(&error))?;
        let next = self.store.next_file_after(&order.machine, used);
        let (number, file) = next.map_err(|error| format!("its folder cannot be used: {error}"))?;
        let entry = CaptureEntry {
            id: id_of(&file),
            machine: order.machine,
            number,
            by: order.by,
            requested: order.requested,
            start: order.header.start_time,
            trigger_s: order.trigger_s,
            span_s: (Some(plan.begins_s()), None),
            state: CaptureState::Writing,
            note: None,
            bytes: 0,
            n_windows,
            alarms: order.alarms,
        };
        self.index.begin(&entry).map_err(|error| with_causes(&error))?;
        let header = RecordingHeader {
            capture: order.header,
            configuration: Some(self.configuration.clone()),
            evidence,
        };
        let rates_hz: Vec<f64> = received.iter().map(|channel| channel.sample_rate.0).collect();
        let ends = order.runs.iter().map(|run| end_s(run, &rates_hz));
        let to_s = ends.fold(plan.begins_s(), f64::max);
        match plan.create(&file, &header, received) {
            Ok(capture) => {
                let bytes = capture.bytes();
                tracing::info!(machine = entry.machine, file = %file.display(), n_windows, "capture begun");
                self.metrics.taken.inc();
                let flushed = super::now();
                let (id, ends_s, note) = (entry.id, order.ends_s, None);
                let open = Open { id, file, capture, rates_hz, ends_s, to_s, flushed, note };
                self.note_growing(&open.file, bytes);
                Ok(open)
            }
            Err(error) => {
                let why = with_causes(&error);
                self.note_end(&entry.id, CaptureState::Failed, Some(why.clone()), Some(0), None);
                Err(why)
            }
        }
    }

    fn about(&self, mut about: Table) -> Table {
        let facts = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("processor", evidence::processor()),
            ("configuration", self.configuration.clone()),
        ];
        about.extend(facts.map(|(key, text)| (key.to_owned(), Value::String(text))));
        about
    }

    fn go_on(&mut self, key: u64, run: &Arc<Received>, open: &mut BTreeMap<u64, Open>) {
        let Some(goes_on) = open.get_mut(&key) else { return };
        if run.time_s >= goes_on.ends_s {
            return;
        }
        let end_s = end_s(run, &goes_on.rates_hz);
        match goes_on.capture.take(Received::clone(run)) {
            Ok(Next::GoesOn) => goes_on.to_s = goes_on.to_s.max(end_s),
            Ok(Next::Ends) => {
                if let Some(mut done) = open.remove(&key) {
                    done.note = Some("it ends where samples were lost".to_owned());
                    self.close(done);
                }
            }
            Err(error) => self.give_up(key, &with_causes(&error), open),
        }
    }

    fn flush(&mut self, key: u64, open: &mut BTreeMap<u64, Open>) {
        let Some(due) = open.get_mut(&key) else { return };
        due.flushed = super::now();
        match due.capture.flush() {
            Ok(()) => {
                let (file, bytes) = (due.file.clone(), due.capture.bytes());
                self.note_growing(&file, bytes);
            }
            Err(error) => self.give_up(key, &with_causes(&error), open),
        }
    }

    /// What was flushed is kept; the next start makes it whole.
    fn give_up(&mut self, key: u64, why: &str, open: &mut BTreeMap<u64, Open>) {
        let Some(failed) = open.remove(&key) else { return };
        tracing::error!(file = %failed.file.display(), why, "a capture is cut off");
        self.metrics.failed.inc();
        let (id, file, to_s) = (failed.id.clone(), failed.file.clone(), failed.to_s);
        drop(failed);
        self.store.forget(&file);
        let is_whole = crate::capture::recording::repair::repair(&file).is_ok();
        let is_kept = is_whole && self.store.note_finished(&file).is_ok();
        let state = if is_kept { CaptureState::Recovered } else { CaptureState::Failed };
        let bytes = file.metadata().map_or(0, |found| found.len());
        self.note_end(&id, state, Some(format!("it was cut off: {why}")), Some(bytes), Some(to_s));
    }

    fn close(&mut self, done: Open) {
        let Open { id, file, capture, to_s, note, .. } = done;
        match capture.close() {
            Ok(finished) => {
                self.note_growing(&file, finished.bytes);
                if let Err(error) = self.store.note_finished(&file) {
                    tracing::error!(%error, file = %file.display(), "a capture is gone");
                }
                tracing::info!(file = %file.display(), bytes = finished.bytes, "capture complete");
                let bytes = Some(finished.bytes);
                self.note_end(&id, CaptureState::Complete, note, bytes, Some(to_s));
            }
            Err(error) => {
                let why = with_causes(&error);
                tracing::error!(file = %file.display(), why, "a capture cannot be completed");
                self.metrics.failed.inc();
                self.store.forget(&file);
                let state = CaptureState::Failed;
                self.note_end(&id, state, Some(why), None, Some(to_s));
            }
        }
        self.show();
    }

    fn note_growing(&mut self, file: &Path, bytes: u64) {
        for event in self.store.note_growing(file, bytes) {
            log(&event);
            if matches!(event, StoreEvent::Removed { .. }) {
                self.metrics.removed.inc();
            }
            note_removed(&*self.index, &event);
        }
        self.show();
    }

    fn note_end(
        &self,
        id: &str,
        state: CaptureState,
        note: Option<String>,
        bytes: Option<u64>,
        to_s: Option<f64>,
    ) {
        if let Err(error) = self.index.end(id, &Ending { state, note, bytes, to_s }) {
            tracing::error!(error = with_causes(&error), id, "the index of captures is behind");
        }
    }

    fn show(&self) {
        self.metrics.bytes.set(i64::try_from(self.store.bytes()).unwrap_or(i64::MAX));
    }
}
