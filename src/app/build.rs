//! From configuration to machines on shards: opens the sources, checks memory, deals out.

use super::Clock;
use super::baselines;
use super::client::ClientError;
use super::http::MetricsText;
use super::keeper::Keeper;
use super::keeper::KeeperPlan;
use super::keeper::MachineKeeper;
use super::link::Link;
use super::link::ShardQueue;
use super::monitored::Monitored;
use super::monitored::Opened;
use super::notify;
use super::notify::NotifyPlan;
use super::recording;
use super::recording::Recording;
use super::shard;
use super::shard::Heartbeat;
use super::simulated::Desk;
use super::trending;
use super::trending::Budget;
use super::trending::TrendKeeper;
use super::trending::TrendPlan;
use super::trending::Trending;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::api::view::BaselineHandle;
use crate::api::view::EventsHandle;
use crate::api::view::MachineHandle;
use crate::api::view::SimulationHandle;
use crate::api::view::SourceState;
use crate::api::view::Submit;
use crate::api::view::TrendHandle;
use crate::capture::recording::store::Store as Recordings;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::config::SourceConfig;
use crate::diagnosis::baseline::Record;
use crate::ingest::replay;
use crate::ingest::replay::Speed;
use crate::ingest::replay::StreamInfo;
use crate::ingest::simulated;
use crate::notify::Health;
use crate::notify::HealthWatch;
use crate::notify::Subject;
use crate::offline::OfflineError;
use crate::pipeline::Monitor;
use crate::pipeline::MonitorError;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::signal::Timestamp;
use crate::store::Archive;
use crate::store::ConfigurationEntry;
use crate::store::StateStore;
use crate::store::StoreError;
use crate::store::StreamKey;
use crate::store::active_records;
use crate::store::sqlite;
use crate::store::trends;
use crate::store::trends::SqliteTrends;
use crate::telemetry::Metrics;
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::Mutex;
use std::thread;
use std::time::UNIX_EPOCH;

/// Bytes of blocks that may wait for a shard: about 20 s of ten channels at 25.6 kHz.
pub const QUEUE_BYTES: usize = 16 << 20;

/// Questions that may wait for a shard.
const MAX_REQUESTS: usize = 64;

/// Why the daemon cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The rings do not fit.
    #[error(
        "the rings and queues need {needed_bytes} bytes and memory_limit_bytes is {limit_bytes}: \
         raise it, shorten ring_seconds, or monitor fewer channels ({largest})"
    )]
    Memory {
        /// What they need.
        needed_bytes: u64,
        /// What is allowed.
        limit_bytes: u64,
        /// The machine that needs most, and how much.
        largest: String,
    },
    /// A machine cannot be monitored with its source.
    #[error("machine {machine:?} cannot be monitored")]
    Monitor {
        /// Machine id.
        machine: String,
        /// Why.
        source: MonitorError,
    },
    /// A scene cannot be simulated.
    #[error("the source of machine {machine:?} cannot be simulated")]
    Scene {
        /// Machine id.
        machine: String,
        /// Why.
        source: Box<simulated::OpenError>,
    },
    /// A healthy capture cannot be measured.
    #[error("the baseline {} of machine {machine:?} cannot be used", file.display())]
    Baseline {
        /// Machine id.
        machine: String,
        /// The capture.
        file: PathBuf,
        /// Why.
        source: Box<OfflineError>,
    },
    /// The trends that are to be kept do not fit.
    #[error(
        "the trends of {n_channels} channels will take about {needed_bytes} bytes ({windows_bytes} for trend_days, \
         {minutes_bytes} for trend_1min_days, {hours_bytes} for trend_1h_days) and {limit_bytes} of store.max_bytes \
         are for them: raise max_bytes, keep trends for fewer days, or lengthen hop_seconds"
    )]
    Trends {
        /// Channels.
        n_channels: usize,
        /// All tiers.
        needed_bytes: u64,
        /// Every window.
        windows_bytes: u64,
        /// Minutes.
        minutes_bytes: u64,
        /// Hours.
        hours_bytes: u64,
        /// What is allowed.
        limit_bytes: u64,
    },
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A receiver of notifications cannot be told.
    #[error("{receiver:?} cannot be notified")]
    Notify {
        /// Its name.
        receiver: String,
        /// Why.
        source: ClientError,
    },
    /// The port cannot be bound.
    #[error("the address {address} cannot be bound, choose another in [server] bind")]
    Bind {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The system does not give a thread or a signal handler.
    #[error("the system refused {what}")]
    System {
        /// What was asked for.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
}

/// A shard before its thread starts.
#[derive(Debug)]
pub(super) struct ShardPlan {
    pub(super) queue: Arc<ShardQueue>,
    pub(super) machines: Vec<Monitored>,
    pub(super) heartbeat: Arc<Heartbeat>,
}

/// A source before its thread starts.
#[derive(Debug)]
pub(super) struct SourcePlan {
    pub(super) machine: Arc<crate::machine::Machine>,
    pub(super) work: Work,
    pub(super) link: Link,
    pub(super) recording: Option<Recording>,
}

/// What a source's thread does.
#[derive(Debug)]
pub(super) enum Work {
    /// Plays a capture.
    Replay(replay::Settings),
    /// Runs a scene.
    Simulate(Box<simulated::Source>, Desk),
}

/// A source that is open.
#[derive(Debug)]
struct Stream {
    info: StreamInfo,
    simulated: Option<Box<simulated::Source>>,
}

/// Everything before any thread starts.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) shards: Vec<ShardPlan>,
    pub(super) sources: Vec<SourcePlan>,
    pub(super) handles: Vec<MachineHandle>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) keeper: Keeper,
    pub(super) keeping: KeeperPlan,
    pub(super) baselines: BaselineHandle,
    pub(super) events: EventsHandle,
    pub(super) notify: NotifyPlan,
    pub(super) trending: TrendPlan,
    pub(super) trends: TrendHandle,
}

/// Builds everything.
///
/// # Errors
/// When memory does not suffice, the store cannot be used or a machine has no channel in its stream. A source that cannot be
/// opened is no error: its machine is shown as failed, and the others are monitored.
pub(super) fn plan(config: &Config) -> Result<Plan, StartError> {
    let streams = config.machines.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let n_shards = n_shards(config);
    check_memory(config, &streams, n_shards)?;
    let metrics = Arc::new(Metrics::new());
    let (keeper, keeping) = open_keeper(config, &metrics)?;
    let baselines = baselines::handle(config)?;
    let (events, notify) = notify::plan(config, &keeper, &metrics)?;
    let store = recording::open_store(config);
    let (trend_keeper, trending, trends) = open_trends(config, &streams, &metrics, store.clone())?;
    let mut shards: Vec<ShardPlan> = (0..n_shards)
        .map(|_| ShardPlan {
            queue: Arc::new(ShardQueue::new(QUEUE_BYTES, MAX_REQUESTS)),
            machines: Vec::new(),
            heartbeat: Arc::default(),
        })
        .collect();
    let loads: Vec<_> = config
        .machines
        .iter()
        .zip(&streams)
        .map(|(entry, stream)| (entry.machine.id.as_str(), load(stream)))
        .collect();
    let assigned = shard::assign(&loads, n_shards);
    let (mut sources, mut handles) = (Vec::new(), Vec::new());
    for ((entry, stream), shard) in config.machines.iter().zip(streams).zip(assigned) {
        let shard = &mut shards[shard];
        let link = Link::new(Arc::clone(&shard.queue), shard.machines.len());
        for note in &entry.machine.notes {
            tracing::warn!(machine = entry.machine.id, note, "machine file");
        }
        let recorded = stream.as_ref().ok().zip(store.as_ref()).and_then(|(stream, store)| {
            let metrics = metrics.recording(&entry.machine.id);
            Recording::new(config, entry, &stream.info, store, metrics)
        });
        let (recording, recording_view) = recorded.unzip();
        let (info, simulated) = match stream {
            Ok(stream) => (Ok(stream.info), stream.simulated),
            Err(reason) => (Err(reason), None),
        };
        let tells_store = handles.is_empty();
        let learned = active_records(&*baselines.store, &entry.machine.id)?;
        let health = events.log.health(&entry.machine.id)?;
        let keepers = (&keeper, tells_store, &trend_keeper);
        let opened = monitor(config, entry, info, keepers, (learned, health))?;
        let (work, simulation) = work(entry, simulated, &metrics);
        if opened.monitor.is_some() {
            let machine = Arc::clone(&entry.machine);
            sources.extend(work.map(|work| SourcePlan {
                machine,
                work,
                link: link.clone(),
                recording,
            }));
        }
        let losses = Arc::clone(link.losses());
        let (monitored, view) =
            Monitored::new(Arc::clone(&entry.machine), opened, losses, &metrics);
        shard.machines.push(monitored);
        let submit: Submit = Arc::new(move |request| link.ask(request));
        handles.push(MachineHandle {
            machine: Arc::clone(&entry.machine),
            view,
            recording: recording_view,
            simulation,
            submit,
        });
    }
    Ok(Plan {
        shards,
        sources,
        handles,
        metrics,
        keeper,
        keeping,
        baselines,
        events,
        notify,
        trending,
        trends,
    })
}

impl Plan {
    /// What `/metrics` shows.
    pub(super) fn metrics_text(&self) -> MetricsText {
        let metrics = Arc::clone(&self.metrics);
        Arc::new(move || metrics.encode())
    }
}

/// CRC-32 of the configuration as it was resolved, the machine files included.
pub(super) fn configuration_hash(config: &Config) -> String {
    format!("crc32:{:08x}", crc32fast::hash(format!("{config:?}").as_bytes()))
}

/// Opens a machine's source for what is known before the first sample; or why it cannot be.
///
/// # Errors
/// A scene that cannot be built, as it is a mistake in a file.
fn open(entry: &MachineConfig) -> Result<Result<Stream, String>, StartError> {
    match &entry.source {
        SourceConfig::Replay(settings) => {
            let opened = replay::open(&settings.file, &entry.machine, &settings.hints);
            let opened = opened.map(|stream| Stream { info: stream.info, simulated: None });
            Ok(opened.map_err(|error| with_causes(&error)))
        }
        SourceConfig::Simulated(settings) => {
            let source = simulated::Source::open(settings, &entry.machine).map_err(|source| {
                StartError::Scene { machine: entry.machine.id.clone(), source: Box::new(source) }
            })?;
            // At the pace of the clock, times of the stream are times of the clock.
            let is_live =
                matches!(settings.speed, Speed::Times(factor) if (factor - 1.0).abs() < 1e-12);
            let start_time = is_live.then(super::wall_clock);
            let info = StreamInfo { start_time, ..source.info().clone() };
            Ok(Ok(Stream { info, simulated: Some(Box::new(source)) }))
        }
    }
}

/// What the source's thread will do, and HTTP's way to a simulated one.
fn work(
    entry: &MachineConfig,
    simulated: Option<Box<simulated::Source>>,
    metrics: &Metrics,
) -> (Option<Work>, Option<SimulationHandle>) {
    match (&entry.source, simulated) {
        (SourceConfig::Replay(settings), _) => (Some(Work::Replay(settings.clone())), None),
        (SourceConfig::Simulated(_), Some(source)) => {
            let (desk, handle) = Desk::new(&source, metrics.simulation(&entry.machine.id));
            (Some(Work::Simulate(source, desk)), Some(handle))
        }
        (SourceConfig::Simulated(_), None) => (None, None),
    }
}

/// Opens the store and notes the configuration in it.
fn open_keeper(config: &Config, metrics: &Metrics) -> Result<(Keeper, KeeperPlan), StartError> {
    let (mut store, archive) = sqlite::open(&config.store.directory)?;
    let entry = ConfigurationEntry {
        hash: configuration_hash(config),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        since: super::wall_clock(),
    };
    // A disk that is full now may have room later: alarms are raised all the same.
    if let Err(error) = store.note_configuration(&entry) {
        tracing::error!(error = with_causes(&error), "the configuration's hash is not stored");
    }
    Ok(Keeper::new(Box::new(store), Arc::new(archive), metrics.store()))
}

/// Opens the store of trends, says what they will take, and refuses what cannot fit.
fn open_trends(
    config: &Config,
    streams: &[Result<Stream, String>],
    metrics: &Metrics,
    recordings: Option<Arc<Mutex<Recordings>>>,
) -> Result<(TrendKeeper, TrendPlan, TrendHandle), StartError> {
    let directory = &config.store.directory;
    let store = SqliteTrends::open(directory, config.store.trends)?;
    let channels =
        streams.iter().filter_map(|stream| Some(stream.as_ref().ok()?.info.channels.len()));
    let (n_channels, hop_s) = (channels.sum(), config.monitor.hop_s);
    let features = store.features_per_channel();
    let needed = trends::project(&config.store.trends, n_channels, hop_s, features);
    let segment_bytes = config.recording.map_or(0, |recording| recording.segment_bytes);
    let budget = Budget {
        max_bytes: config.store.max_bytes,
        for_recordings: segment_bytes.saturating_mul(config.machines.len() as u64 + 1),
        recordings,
    };
    let limit_bytes = budget.max_bytes.saturating_sub(budget.for_recordings);
    let trends::Projection { windows_bytes, minutes_bytes, hours_bytes } = needed;
    let needed_bytes = needed.total();
    tracing::info!(
        n_channels,
        needed_bytes,
        windows_bytes,
        minutes_bytes,
        hours_bytes,
        limit_bytes,
        "projected size of trends"
    );
    if needed_bytes > limit_bytes {
        return Err(StartError::Trends {
            n_channels,
            needed_bytes,
            windows_bytes,
            minutes_bytes,
            hours_bytes,
            limit_bytes,
        });
    }
    Ok(trending::open(directory, store, budget, metrics.trends()))
}

/// What tells a stream from others after a restart: a capture that is played once, as it is on the disk,
/// judged by the same configuration.
fn stream_key(config: &Config, entry: &MachineConfig, start: Option<Timestamp>) -> StreamKey {
    let judged_by = configuration_hash(config);
    let identity = match &entry.source {
        SourceConfig::Replay(settings) if !settings.repeat => {
            fs::metadata(&settings.file).ok().map(|file| {
                let changed =
                    file.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok());
                let changed_s = changed.map_or(0.0, |since| since.as_secs_f64());
                format!("{} {} {changed_s:.6} {judged_by}", settings.file.display(), file.len())
            })
        }
        SourceConfig::Replay(_) | SourceConfig::Simulated(_) => None,
    };
    StreamKey { identity, start }
}

/// Lets an engine go on with what is stored of its machine.
fn restore(
    engine: &mut AlarmEngine,
    machine: &str,
    stream: &StreamKey,
    archive: &dyn Archive,
    clock: Clock,
) -> Result<Vec<AlarmEvent>, StartError> {
    let now = clock.moment(0.0);
    let kept = archive.load(machine, stream, now, engine.settings().history_len)?;
    if !kept.alarms.is_empty() {
        tracing::info!(machine, n_alarms = kept.alarms.len(), "alarms of before the start stand");
    }
    Ok(engine.restore(kept, now))
}

/// Makes the monitor of a machine whose source could be opened.
fn monitor(
    config: &Config,
    entry: &MachineConfig,
    stream: Result<StreamInfo, String>,
    (keeper, tells_store, trends): (&Keeper, bool, &TrendKeeper),
    (learned, health): (Vec<Record>, BTreeMap<Subject, Health>),
) -> Result<Opened, StartError> {
    let machine = &entry.machine;
    let mut idle = AlarmEngine::of_machine(machine, &[], config.monitor.alarms.clone());
    let keeper_of =
        |key: &StreamKey| MachineKeeper::new(keeper.clone(), &machine.id, key.clone(), tells_store);
    let (archive, clock) = (&*keeper.archive, keeper.clock);
    let info = match stream {
        Ok(info) => info,
        Err(reason) => {
            tracing::error!(machine = machine.id, reason, "source failed");
            let source = SourceState::Failed(reason);
            // Without a stream its alarms count from now.
            let start_time = Some(super::wall_clock());
            let key = StreamKey { identity: None, start: start_time };
            let alarm_events = restore(&mut idle, &machine.id, &key, archive, clock)?;
            let keeper = keeper_of(&key);
            let (monitor, is_live, alarms) = (None, false, idle);
            return Ok(Opened {
                monitor,
                source,
                start_time,
                is_live,
                alarms,
                alarm_events,
                health: HealthWatch::new(health, None),
                keeper,
                trending: None,
            });
        }
    };
    let hints = SpeedHints { option: None, capture: info.shaft_speed };
    let (baseline, load) = (baselines::named(entry)?, info.load);
    let settings = Settings { baseline, load, ..config.monitor.clone() };
    let mut monitor = Monitor::new(Arc::clone(machine), info.channels, hints, &settings)
        .map_err(|source| StartError::Monitor { machine: machine.id.clone(), source })?;
    monitor.use_signed(learned);
    let key = stream_key(config, entry, info.start_time);
    let alarm_events = restore(monitor.alarms_mut(), &machine.id, &key, archive, clock)?;
    let judged_until_s = monitor.alarms().judged_until_s();
    let trending = Trending::new(trends.clone(), &machine.id, &key, monitor.channels());
    Ok(Opened {
        trending: Some(trending),
        monitor: Some(monitor),
        source: SourceState::Starting,
        start_time: info.start_time,
        is_live: matches!(entry.source, SourceConfig::Simulated(_)),
        alarms: idle,
        alarm_events,
        health: HealthWatch::new(health, judged_until_s),
        keeper: keeper_of(&key),
    })
}

/// Number of shards: as configured, never more than machines, at least one.
fn n_shards(config: &Config) -> usize {
    let n_cores = thread::available_parallelism().map_or(1, usize::from);
    let wanted = if config.workers == 0 { n_cores.saturating_sub(1) } else { config.workers };
    wanted.min(config.machines.len()).max(1)
}

/// Samples a second of a stream, all channels together.
fn load(stream: &Result<Stream, String>) -> f64 {
    let channels = stream.as_ref().map_or(&[][..], |stream| &stream.info.channels);
    channels.iter().map(|channel| channel.sample_rate.0).sum()
}

/// Refuses to start when rings and queues would need more than the limit.
fn check_memory(
    config: &Config,
    streams: &[Result<Stream, String>],
    n_shards: usize,
) -> Result<(), StartError> {
    let needs = config.machines.iter().zip(streams).filter_map(|(entry, stream)| {
        let info = &stream.as_ref().ok()?.info;
        Some((Monitor::ring_bytes(&info.channels, &config.monitor) as u64, &entry.machine.id))
    });
    let needs: Vec<_> = needs.collect();
    let Some((most, id)) = needs.iter().max() else { return Ok(()) };
    let rings = needs.iter().fold(0_u64, |sum, (bytes, _)| sum.saturating_add(*bytes));
    let needed_bytes = rings.saturating_add((n_shards * QUEUE_BYTES) as u64);
    if needed_bytes <= config.memory_limit_bytes {
        return Ok(());
    }
    Err(StartError::Memory {
        needed_bytes,
        limit_bytes: config.memory_limit_bytes,
        largest: format!("most for machine {id:?}: {most} bytes"),
    })
}

#[cfg(test)]
#[path = "build_tests.rs"]
mod tests;
