//! From configuration to machines on shards: opens the sources, checks memory, deals out.

use super::Clock;
use super::baselines;
use super::captures::CapturesPlan;
use super::fitted;
use super::fitted::Fitted;
use super::http::MetricsText;
use super::keeper::Keeper;
use super::keeper::KeeperPlan;
use super::keeper::MachineKeeper;
use super::link::Link;
use super::link::ShardQueue;
use super::live;
use super::live::Port;
use super::monitored::Monitored;
use super::monitored::Opened;
use super::notify::Notifier;
use super::recording::Recording;
use super::renewal::InForce;
use super::shard;
use super::shard::Heartbeat;
use super::simulated::Desk;
use super::start_error::StartError;
use super::stores;
use super::stores::Stores;
use super::trending;
use super::trending::TrendPlan;
use super::trending::Trending;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::Decisions;
use crate::api::handles::BaselineHandle;
use crate::api::handles::CaptureHandle;
use crate::api::handles::EventsHandle;
use crate::api::handles::FeedbackHandle;
use crate::api::handles::MachineHandle;
use crate::api::handles::SimulationHandle;
use crate::api::handles::Submit;
use crate::api::handles::TrendHandle;
use crate::api::view::SourceState;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::config::SourceConfig;
use crate::ingest::replay;
use crate::ingest::replay::Speed;
use crate::ingest::replay::StreamInfo;
use crate::ingest::simulated;
use crate::notify::HealthWatch;
use crate::pipeline::Monitor;
use crate::pipeline::Settings;
use crate::signal::Timestamp;
use crate::store::Archive;
use crate::store::StreamKey;
use crate::store::active_records;
use crate::telemetry::Metrics;
use std::fs;
use std::sync::Arc;
use std::thread;
use std::time::UNIX_EPOCH;
use tokio::sync::watch;

/// Bytes of blocks that may wait for a shard: about 20 s of ten channels at 25.6 kHz.
pub const QUEUE_BYTES: usize = 16 << 20;

/// Questions that may wait for a shard.
const MAX_REQUESTS: usize = 64;

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
    /// Whether the shard holds what was received.
    pub(super) is_captured: bool,
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
    /// The ways to the machines, in the order of the configuration.
    pub(super) links: Vec<Link>,
    /// By which the sources are told what holds, in the same order.
    pub(super) in_force: Vec<watch::Sender<InForce>>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) keeper: Keeper,
    pub(super) keeping: KeeperPlan,
    pub(super) baselines: BaselineHandle,
    pub(super) feedback: FeedbackHandle,
    pub(super) events: EventsHandle,
    pub(super) notify: Notifier,
    pub(super) trending: TrendPlan,
    pub(super) trends: TrendHandle,
    /// The ways of live senders.
    pub(super) ports: Vec<Arc<Port>>,
    /// The thread that writes captures, and HTTP's way to them.
    pub(super) captures: Option<(CapturesPlan, CaptureHandle)>,
}

/// Builds everything.
///
/// # Errors
/// When memory does not suffice, the store cannot be used or a machine has no channel in its stream. A source that cannot be
/// opened is no error: its machine is shown as failed, and the others are monitored.
pub(super) fn plan(config: &Config) -> Result<Plan, StartError> {
    let streams = config.machines.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let n_shards = n_shards(config);
    let needed_bytes = check_memory(config, &streams, n_shards)?;
    let room = Arc::new(live::Room::new(config.memory_limit_bytes - needed_bytes));
    let metrics = Arc::new(Metrics::new());
    let infos = config.machines.iter().zip(&streams);
    let infos: Vec<_> = infos
        .filter_map(|(entry, stream)| Some((&*entry.machine, &stream.as_ref().ok()?.info)))
        .collect();
    let stores = Stores::open(config, &infos, &metrics)?;
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
    let (mut sources, mut handles, mut ports) = (Vec::new(), Vec::new(), Vec::new());
    let (mut links, mut in_force) = (Vec::new(), Vec::new());
    for ((entry, stream), shard) in config.machines.iter().zip(streams).zip(assigned) {
        let shard = &mut shards[shard];
        let link = Link::new(Arc::clone(&shard.queue), shard.machines.len());
        links.push(link.clone());
        for note in &entry.machine.notes {
            tracing::warn!(machine = entry.machine.id, note, "machine file");
        }
        let tells_store = handles.is_empty();
        let joined = match &entry.source {
            SourceConfig::Live(_) => {
                let shared = (&stores, &metrics, &room);
                live::joining::join(config, entry, link, shared, tells_store)?
            }
            SourceConfig::Replay(_) | SourceConfig::Simulated(_) => {
                join(config, entry, stream, link, (&stores, &metrics), tells_store)?
            }
        };
        ports.extend(joined.port);
        shard.machines.push(joined.monitored);
        sources.extend(joined.source);
        handles.push(joined.handle);
        in_force.push(joined.in_force);
    }
    // The ways to the threads of trends and captures that are kept here end now: those threads end with the shards.
    let Stores { keeper, keeping, baselines, feedback, events, notify, trending, trends, .. } =
        stores;
    let captures = stores.captures.map(|captures| (captures.plan, captures.handle));
    Ok(Plan {
        shards,
        sources,
        handles,
        links,
        in_force,
        metrics,
        keeper,
        keeping,
        baselines,
        feedback,
        events,
        notify,
        trending,
        trends,
        ports,
        captures,
    })
}

/// A machine with its source and what HTTP sees of it.
pub(super) struct Joined {
    pub(super) monitored: Monitored,
    pub(super) source: Option<SourcePlan>,
    pub(super) port: Option<Arc<Port>>,
    pub(super) handle: MachineHandle,
    pub(super) in_force: watch::Sender<InForce>,
}

/// Joins a machine to its source and to the stores. `tells_store`: it tells when the store fails.
fn join(
    config: &Config,
    entry: &MachineConfig,
    stream: Result<Stream, String>,
    link: Link,
    (stores, metrics): (&Stores, &Metrics),
    tells_store: bool,
) -> Result<Joined, StartError> {
    let id = &entry.machine.id;
    let (in_force, holds) = watch::channel(InForce::of(config, entry));
    let recorded = stream.as_ref().ok().zip(stores.recordings.as_ref());
    let recorded = recorded.and_then(|(stream, store)| {
        let told = (metrics.recording(id), stores.keeper.troubles.clone());
        Recording::new(&holds, &stream.info, store, told)
    });
    let (recording, recording_view) = recorded.unzip();
    let (info, simulated) = match stream {
        Ok(stream) => (Ok(stream.info), stream.simulated),
        Err(reason) => (Err(reason), None),
    };
    let capturer = stores.captures.as_ref().map(|captures| captures.capturer.clone());
    let capturing = info
        .as_ref()
        .ok()
        .zip(capturer)
        .and_then(|(info, capturer)| stores::capturing(config, entry, info, capturer));
    let is_captured = capturing.is_some();
    let opened = monitor(config, entry, info, stores, tells_store)?;
    let (work, simulation) = work(entry, simulated, metrics);
    let machine = Arc::clone(&entry.machine);
    let source = work.filter(|_| opened.monitor.is_some()).map(|work| SourcePlan {
        machine,
        work,
        link: link.clone(),
        recording,
        is_captured,
    });
    let traffic = Arc::clone(link.traffic());
    let (monitored, view) =
        Monitored::new(Arc::clone(&entry.machine), opened, capturing, (traffic, metrics));
    let submit: Submit = Arc::new(move |request| link.ask(request));
    let handle = MachineHandle {
        id: id.clone(),
        view,
        recording: recording_view,
        simulation,
        ingest: None,
        submit,
    };
    Ok(Joined { monitored, source, port: None, handle, in_force })
}

impl Plan {
    /// What `/metrics` shows.
    pub(super) fn metrics_text(&self, hub: Option<Arc<live::Hub>>) -> MetricsText {
        let metrics = Arc::clone(&self.metrics);
        Arc::new(move || {
            if let Some(hub) = &hub {
                hub.count(&metrics);
            }
            metrics.encode()
        })
    }
}

/// CRC-32 of the configuration as it was resolved, the machine files included.
pub(in crate::app) fn configuration_hash(config: &Config) -> String {
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
        // Its senders say what it is.
        SourceConfig::Live(_) => Ok(Ok(Stream { info: live::unknown_stream(), simulated: None })),
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
        (SourceConfig::Simulated(_), None) | (SourceConfig::Live(_), _) => (None, None),
    }
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
        SourceConfig::Replay(_) | SourceConfig::Simulated(_) | SourceConfig::Live(_) => None,
    };
    StreamKey { identity, start, judged_by: Some(judged_by) }
}

/// Lets an engine go on with what is stored of its machine; gives what that causes, and the delays that were stored.
pub(super) fn restore(
    engine: &mut AlarmEngine,
    machine: &str,
    stream: &StreamKey,
    archive: &dyn Archive,
    clock: Clock,
) -> Result<(Vec<AlarmEvent>, Option<Decisions>), StartError> {
    let now = clock.moment(0.0);
    let kept = archive.load(machine, stream, now, engine.settings().history_len)?;
    if !kept.alarms.is_empty() {
        tracing::info!(machine, n_alarms = kept.alarms.len(), "alarms of before the start stand");
    }
    let decisions = kept.decisions.clone();
    Ok((engine.restore(kept, now), decisions))
}

/// Makes the monitor of a machine whose source could be opened.
fn monitor(
    config: &Config,
    entry: &MachineConfig,
    stream: Result<StreamInfo, String>,
    stores: &Stores,
    tells_store: bool,
) -> Result<Opened, StartError> {
    let machine = &entry.machine;
    let keeper = &stores.keeper;
    let health = stores.events.log.health(&machine.id)?;
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
            let key = StreamKey { start: start_time, ..StreamKey::default() };
            let (alarm_events, _) = restore(&mut idle, &machine.id, &key, archive, clock)?;
            let keeper = keeper_of(&key);
            let (monitor, is_live, alarms) = (None, false, idle);
            return Ok(Opened {
                configuration: configuration_hash(config).into(),
                monitor,
                source,
                start_time,
                is_live,
                alarms,
                alarm_events,
                health: HealthWatch::new(health, None),
                keeper,
                trending: None,
                opener: None,
            });
        }
    };
    let (hints, fitted) = (fitted::hints(&info), Fitted::of(config, machine, &info));
    let settings = Settings { baseline: baselines::named(entry)?, ..fitted.settings };
    let mut monitor = Monitor::new(Arc::clone(machine), info.channels, hints, &settings)
        .map_err(|source| StartError::Monitor { machine: machine.id.clone(), source })?;
    monitor.use_signed(active_records(&*stores.baselines.store, &machine.id)?);
    let key = stream_key(config, entry, info.start_time);
    let (alarm_events, _) = restore(monitor.alarms_mut(), &machine.id, &key, archive, clock)?;
    let judged_until_s = monitor.alarms().judged_until_s();
    let trending =
        Trending::new(stores.trend_keeper.clone(), &machine.id, &key, monitor.channels());
    Ok(Opened {
        configuration: configuration_hash(config).into(),
        trending: Some(trending),
        monitor: Some(monitor),
        source: SourceState::Starting,
        start_time: info.start_time,
        is_live: matches!(entry.source, SourceConfig::Simulated(_)),
        alarms: idle,
        alarm_events,
        health: HealthWatch::new(health, judged_until_s),
        keeper: keeper_of(&key),
        opener: None,
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

/// Holds the memory that a start needs for rings, queues and captures, and the room for trends on the disk, against their limits: what
/// `check` says is what `serve` says. Sources are opened for what they hold, and the newest trends read; a source that cannot be opened
/// needs nothing.
///
/// # Errors
/// When there is too little, or a scene cannot be built.
pub fn check_fits(config: &Config) -> Result<(), StartError> {
    let streams = config.machines.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    check_memory(config, &streams, n_shards(config))?;
    let n_channels = streams.iter().flatten().map(|stream| stream.info.channels.len()).sum();
    trending::limits(config, n_channels).map(drop)
}

/// Refuses to start when rings and queues would need more than the limit; gives what they need.
fn check_memory(
    config: &Config,
    streams: &[Result<Stream, String>],
    n_shards: usize,
) -> Result<u64, StartError> {
    let queues = (n_shards * QUEUE_BYTES) as u64;
    let needs = config.machines.iter().zip(streams).filter_map(|(entry, stream)| {
        let info = &stream.as_ref().ok()?.info;
        let fitted = Fitted::of(config, &entry.machine, info);
        Some((fitted.memory_bytes(info), &entry.machine.id))
    });
    let needs: Vec<_> = needs.collect();
    let Some((most, id)) = needs.iter().max() else {
        return Ok(queues.min(config.memory_limit_bytes));
    };
    let rings = needs.iter().fold(0_u64, |sum, (bytes, _)| sum.saturating_add(*bytes));
    let needed_bytes = rings.saturating_add(queues);
    if needed_bytes <= config.memory_limit_bytes {
        return Ok(needed_bytes);
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
