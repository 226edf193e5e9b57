//! The way of trends to the store: each machine's open minute, and the thread that writes.
//!
//! A shard never waits for the store: what finds no room in the queue is lost and counted. The open
//! minute is in memory; a kill loses it, which shows as a gap.

use super::room::Room;
use super::sizes::Sizes;
use super::sizes::Taken;
use super::start_error::StartError;
use super::stop::Stop;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::api::handles::TrendHandle;
use crate::capture::recording::store::Store as Recordings;
use crate::config::Config;
use crate::pipeline::Outcome;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::store::StreamKey;
use crate::store::trends;
use crate::store::trends::Holdings;
use crate::store::trends::Minute;
use crate::store::trends::Projection;
use crate::store::trends::Retention;
use crate::store::trends::SqliteTrendArchive;
use crate::store::trends::SqliteTrends;
use crate::store::trends::TrendStore;
use crate::store::trends::queue::MAX_WAITING_BYTES;
use crate::store::trends::queue::Queue;
use crate::store::writer::Status;
use crate::telemetry::Metrics;
use crate::telemetry::TrendMetrics;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::mpsc::SyncSender;
use std::sync::mpsc::sync_channel;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::watch;

/// Minutes that may wait for the writer.
const QUEUE: usize = 4096;

/// How long the writer waits before it tries again what the store refused.
const RETRY: Duration = Duration::from_secs(1);

/// Time between two looks at the limits of the store.
const PRUNE_EVERY: Duration = Duration::from_secs(60);

/// A minute that has been open for so long is sent, complete or not: a kill loses no more.
const SEND_AFTER: Duration = Duration::from_secs(60);

/// A way to the writer; cheap to clone.
#[derive(Debug, Clone)]
pub struct TrendKeeper {
    minutes: SyncSender<Minute>,
    /// Bytes in the queue.
    bytes: Arc<AtomicUsize>,
    status: Arc<Status>,
    /// Start of the daemon, UTC.
    run: Timestamp,
}

/// Bytes that the store may take.
#[derive(Debug, Clone)]
pub struct Budget {
    /// Trends and recordings together.
    pub max_bytes: u64,
    /// Of them for recordings, whatever trends take.
    pub for_recordings: u64,
    /// The recordings, which give way to trends.
    pub recordings: Option<Arc<Mutex<Recordings>>>,
}

/// How long trends are kept and what they and recordings may take, once that is other than at the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How long.
    pub retention: Retention,
    /// Bytes of trends and recordings.
    pub max_bytes: u64,
}

/// Where other limits are left for the thread.
pub type NewLimits = Arc<Mutex<Option<Limits>>>;

/// The writing side before its thread starts.
pub struct TrendPlan {
    store: Box<dyn TrendStore>,
    minutes: Receiver<Minute>,
    bytes: Arc<AtomicUsize>,
    status: Arc<Status>,
    budget: Budget,
    holdings: watch::Sender<Holdings>,
    metrics: TrendMetrics,
    /// Keeps room on the disk.
    pub(super) room: Option<Room>,
    /// Other limits than those of the start.
    pub(super) limits: NewLimits,
    /// Looks at what everything in the store takes.
    sizes: Option<Sizes>,
}

impl std::fmt::Debug for TrendPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrendPlan").field("budget", &self.budget).finish_non_exhaustive()
    }
}

/// Opens the trends of the store, says what those of `n_channels` will take and joins them with machines.
///
/// # Errors
/// When their folder cannot be made, or they cannot fit.
pub(super) fn open(
    config: &Config,
    n_channels: usize,
    metrics: &Metrics,
    recordings: Option<Arc<Mutex<Recordings>>>,
) -> Result<(TrendKeeper, TrendPlan, TrendHandle), StartError> {
    let directory = &config.store.directory;
    let store = SqliteTrends::open(directory, config.store.trends)?;
    let (needed, limit_bytes) = needed(config, n_channels);
    let needed_bytes = needed.total();
    let Projection { windows_bytes, minutes_bytes, hours_bytes } = needed;
    tracing::info!(
        n_channels,
        needed_bytes,
        windows_bytes,
        minutes_bytes,
        hours_bytes,
        limit_bytes,
        "projected size of trends"
    );
    let Limits { max_bytes, .. } = fitting(config, n_channels, (needed, limit_bytes))?;
    let budget = Budget { max_bytes, for_recordings: for_recordings(config), recordings };
    let (keeper, mut plan, holdings) = join(Box::new(store), budget, metrics.trends());
    let archive = Arc::new(SqliteTrendArchive::new(directory));
    let status = Arc::clone(&keeper.status);
    let (measured, sizes) = Sizes::new(config, metrics);
    plan.sizes = Some(measured);
    Ok((keeper, plan, TrendHandle { archive, status, holdings, sizes }))
}

/// Bytes that recordings keep whatever trends take.
fn for_recordings(config: &Config) -> u64 {
    let segment_bytes = config.recording.map_or(0, |recording| recording.segment_bytes);
    segment_bytes.saturating_mul(config.machines.len() as u64 + 1)
}

/// The limits of a configuration, unless trends of `n_channels` could not fit into them. Changes nothing.
///
/// # Errors
/// What they need and have.
pub(super) fn limits(config: &Config, n_channels: usize) -> Result<Limits, StartError> {
    fitting(config, n_channels, needed(config, n_channels))
}

/// The same, where it is known what trends take and have.
fn fitting(
    config: &Config,
    n_channels: usize,
    (needed, limit_bytes): (Projection, u64),
) -> Result<Limits, StartError> {
    if needed.total() > limit_bytes {
        return Err(StartError::Trends { n_channels, needed, limit_bytes });
    }
    Ok(Limits { retention: config.store.trends, max_bytes: config.bytes_beside_captures() })
}

/// What trends of `n_channels` will take, by the features stored so far, and the bytes there are for them.
fn needed(config: &Config, n_channels: usize) -> (Projection, u64) {
    let features = trends::features_per_channel(&config.store.directory);
    let hop_s = config.monitor.hop_s;
    let needed = trends::project(&config.store.trends, n_channels, hop_s, features);
    (needed, config.bytes_beside_captures().saturating_sub(for_recordings(config)))
}

/// Joins machines and a store by a queue.
pub(super) fn join(
    store: Box<dyn TrendStore>,
    budget: Budget,
    metrics: TrendMetrics,
) -> (TrendKeeper, TrendPlan, watch::Receiver<Holdings>) {
    let (minutes, inbox) = sync_channel(QUEUE);
    let (bytes, status) = (Arc::new(AtomicUsize::new(0)), Arc::new(Status::default()));
    let (holdings, view) = watch::channel(Holdings::default());
    let keeper = TrendKeeper {
        minutes,
        bytes: Arc::clone(&bytes),
        status: Arc::clone(&status),
        run: super::wall_clock(),
    };
    let room = None;
    let limits = NewLimits::default();
    let plan = TrendPlan {
        store,
        minutes: inbox,
        bytes,
        status,
        budget,
        holdings,
        metrics,
        room,
        limits,
        sizes: None,
    };
    (keeper, plan, view)
}

impl TrendKeeper {
    /// Hands a minute on; what finds no room is lost and counted.
    fn send(&self, minute: Minute) {
        let (bytes, n) = (minute.bytes(), minute.n_points());
        let waiting = self.bytes.fetch_add(bytes, Ordering::Relaxed);
        let has_room = waiting.saturating_add(bytes) <= MAX_WAITING_BYTES || waiting == 0;
        if !has_room || self.minutes.try_send(minute).is_err() {
            self.bytes.fetch_sub(bytes, Ordering::Relaxed);
            self.status.count_lost(usize::try_from(n).unwrap_or(usize::MAX));
        }
    }
}

impl TrendPlan {
    /// Writes until every sender is gone and everything is written.
    pub fn run(self, stop: &Stop) {
        let Self { store, minutes, bytes, status, mut budget, holdings, .. } = self;
        let Self { metrics, room, limits, mut sizes, .. } = self;
        let mut queue = Queue::new(store, &status);
        let mut prune_at = super::now();
        let (mut is_over, mut has_more) = (false, false);
        let (mut n_stored, mut n_lost) = (0, 0);
        while !is_over {
            let wait = if has_more { Duration::ZERO } else { RETRY };
            match minutes.recv_timeout(wait) {
                Ok(first) => {
                    for minute in std::iter::once(first).chain(minutes.try_iter().take(QUEUE)) {
                        bytes.fetch_sub(minute.bytes(), Ordering::Relaxed);
                        queue.push(minute);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => is_over = true,
            }
            let now = super::wall_clock();
            let is_failing = queue.flush(now);
            if let Some(room) = &room {
                let why = status.failure().map(|why| format!("trends cannot be stored: {why}"));
                room.troubles.note("trends", why);
                room.keep(queue.store(), now);
            }
            if let Some(new) = limits.lock().unwrap_or_else(PoisonError::into_inner).take() {
                queue.store().retain(new.retention);
                budget.max_bytes = new.max_bytes;
                prune_at = super::now();
            }
            if !stop.is_set() {
                has_more = queue.store().tidy(now).unwrap_or_else(|error| {
                    tracing::error!(%error, "minutes and hours of trends cannot be made yet");
                    false
                });
                if super::now() >= prune_at {
                    prune_at = super::now() + PRUNE_EVERY;
                    let held = budget.prune(queue.store(), now);
                    let count = |n: u64| i64::try_from(n).unwrap_or(i64::MAX);
                    metrics.bytes.set(count(held.bytes));
                    metrics.files.set(count(held.n_files));
                    metrics.set_aside.set(count(held.n_set_aside));
                    holdings.send_replace(held);
                    if let Some(sizes) = &mut sizes {
                        sizes.look(&budget.taken(held), super::now());
                    }
                }
            }
            metrics.stored.inc_by(status.n_stored() - n_stored);
            metrics.lost.inc_by(status.n_lost() - n_lost);
            (n_stored, n_lost) = (status.n_stored(), status.n_lost());
            metrics.waiting.set(i64::try_from(status.n_waiting()).unwrap_or(i64::MAX));
            metrics.failing.set(i64::from(is_failing));
        }
        if status.n_waiting() > 0 {
            tracing::error!(n_points = status.n_waiting(), "trends were not stored");
        }
    }
}

impl Budget {
    /// What trends and recordings take of it.
    fn taken(&self, trends: Holdings) -> Taken {
        let recordings = self.recordings.as_ref();
        Taken {
            trends,
            trends_limit: self.max_bytes.saturating_sub(self.for_recordings),
            recordings: recordings
                .map(|store| store.lock().unwrap_or_else(PoisonError::into_inner).bytes()),
            recordings_limit: self.max_bytes.saturating_sub(trends.bytes),
        }
    }

    /// Lets recordings give way to trends, and trends to the limit.
    fn prune(&self, store: &mut dyn TrendStore, now: Timestamp) -> Holdings {
        let held = store.prune(now, self.max_bytes.saturating_sub(self.for_recordings));
        if let Some(recordings) = &self.recordings {
            let mut recordings = recordings.lock().unwrap_or_else(PoisonError::into_inner);
            recordings.set_limit(self.max_bytes.saturating_sub(held.bytes));
        }
        held
    }
}

/// A machine's end of the way: its open minute.
#[derive(Debug)]
pub struct Trending {
    keeper: TrendKeeper,
    stream: Arc<PastStream>,
    open: Option<(Minute, Instant)>,
}

impl Trending {
    /// The end of a machine with the stream `key` of `channels`.
    #[must_use]
    pub fn new(
        keeper: TrendKeeper,
        machine: &str,
        key: &StreamKey,
        channels: &[ChannelInfo],
    ) -> Self {
        let begun = keeper.run;
        // A stream that never comes again is told by when it began.
        let name = key.identity.clone().unwrap_or_else(|| format!("live {}", begun.0));
        let stream = PastStream {
            machine: machine.to_owned(),
            name,
            start: key.start,
            begun,
            channels: channels.iter().map(|channel| channel.name.clone()).collect(),
        };
        Self { keeper, stream: Arc::new(stream), open: None }
    }

    /// Takes in a window that was judged.
    pub fn take(&mut self, outcome: &Outcome) {
        let time_s = outcome.time_s.1;
        let run = self.keeper.run;
        let window = PastWindow::of(&outcome.diagnosis, time_s, &outcome.absent, run);
        let minute = Minute::of(&self.stream, time_s);
        // Stream time that goes back begins a minute anew; the store puts the parts together.
        let goes_on = |open: &Minute| {
            open.minute == minute && open.windows.last().is_none_or(|last| last.time_s < time_s)
        };
        if !self.open.as_ref().is_some_and(|(open, _)| goes_on(open)) {
            self.close();
        }
        let stream = &self.stream;
        let (open, _) = self
            .open
            .get_or_insert_with(|| (Minute::new(Arc::clone(stream), minute), super::now()));
        open.push(window, &outcome.features);
    }

    /// Sends what has been open for long.
    pub fn tick(&mut self) {
        let is_old = |since: &Instant| super::now().saturating_duration_since(*since) >= SEND_AFTER;
        if self.open.as_ref().is_some_and(|(_, since)| is_old(since)) {
            self.close();
        }
    }

    /// Sends the open minute.
    pub fn close(&mut self) {
        if let Some((minute, _)) = self.open.take() {
            self.keeper.send(minute);
        }
    }
}

impl Drop for Trending {
    fn drop(&mut self) {
        self.close();
    }
}
