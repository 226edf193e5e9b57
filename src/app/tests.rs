//! Sources, shards and snapshots together, on synthetic streams.

use super::daemon::Daemon;
use super::keeper::Keeper;
use super::keeper::MachineKeeper;
use super::link::Input;
use super::link::Link;
use super::link::ShardQueue;
use super::monitored::Monitored;
use super::monitored::Opened;
use super::shard;
use super::shard::Heartbeat;
use super::source;
use super::start_error::StartError;
use super::stop::Stop;
use crate::alarms::AlarmEngine;
use crate::api::view::End;
use crate::api::view::MachineView;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::capture::hints::Hints;
use crate::config::Config;
use crate::config::Store;
use crate::ingest::replay;
use crate::ingest::replay::ReplayError;
use crate::ingest::replay::Speed;
use crate::ingest::replay::Step;
use crate::ingest::replay::Stream;
use crate::ingest::replay::StreamInfo;
use crate::machine::Machine;
use crate::machine::file;
use crate::notify::HealthWatch;
use crate::pipeline::Monitor;
use crate::pipeline::SpeedHints;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::store::Archive;
use crate::store::StateStore;
use crate::store::StreamKey;
use crate::store::sqlite;
use crate::telemetry::Metrics;
use crate::units::Hz;
use crate::units::Unit;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use tempfile::TempDir;
use tokio::sync::oneshot;
use tokio::sync::watch;

const RATE_HZ: u64 = 1000;

/// A machine with one sensor, on channel `x`.
pub(super) fn machine(id: &str) -> Arc<Machine> {
    let text = format!(
        "[machine]\nid = {id:?}\nname = \"Rig\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 10.0\n\
         [[sensor]]\nchannel = \"x\"\nkind = \"accelerometer\"\nat = {{ shaft = \"main\" }}\n"
    );
    Arc::new(file::parse(&text, "rig.toml").unwrap())
}

fn channel() -> ChannelInfo {
    ChannelInfo {
        name: "x".to_owned(),
        sample_rate: Hz(RATE_HZ as f64),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    }
}

/// A stream of `seconds` whose samples say their own index.
fn stream(seconds: u64) -> Stream {
    let mut second = 0;
    let next = move || {
        if second == seconds {
            return Ok(Step::End);
        }
        let start = second * RATE_HZ;
        second += 1;
        Ok(Step::Block(Block {
            channel: ChannelIndex(0),
            start: SampleIndex(start),
            segment: 0,
            time_s: start as f64 / RATE_HZ as f64,
            samples: (start..start + RATE_HZ).map(|i| i as f32).collect(),
        }))
    };
    let info = StreamInfo {
        channels: vec![channel()],
        start_time: None,
        shaft_speed: None,
        load: None,
        received: Vec::new(),
    };
    Stream { info, next: Box::new(next) }
}

/// A shard with one machine, on its thread.
pub(super) struct Running {
    queue: Arc<ShardQueue>,
    pub(super) link: Link,
    pub(super) view: watch::Receiver<Arc<MachineView>>,
    metrics: Arc<Metrics>,
    shard: JoinHandle<()>,
    _store: TempDir,
}

/// Starts a shard whose queue takes `queue_bytes`.
fn running(queue_bytes: usize) -> Running {
    let folder = TempDir::new().unwrap();
    let (store, archive) = sqlite::open(folder.path()).unwrap();
    running_on(queue_bytes, folder, Box::new(store), Arc::new(archive))
}

/// Starts a shard over a store in `folder`.
pub(super) fn running_on(
    queue_bytes: usize,
    folder: TempDir,
    store: Box<dyn StateStore>,
    archive: Arc<dyn Archive>,
) -> Running {
    let queue = Arc::new(ShardQueue::new(queue_bytes, 4));
    let link = Link::new(Arc::clone(&queue), 0);
    let metrics = Arc::new(Metrics::new());
    let monitor = Monitor::new(
        machine("rig-1"),
        vec![channel()],
        SpeedHints::default(),
        &Config::default().monitor,
    );
    let (keeper, keeping) = Keeper::new(store, archive, metrics.store());
    let opened = Opened {
        configuration: "".into(),
        monitor: Some(monitor.unwrap()),
        source: SourceState::Starting,
        start_time: None,
        is_live: false,
        alarms: AlarmEngine::new("rig-1", Config::default().monitor.alarms),
        health: HealthWatch::default(),
        alarm_events: Vec::new(),
        keeper: MachineKeeper::new(keeper, "rig-1", StreamKey::default(), true),
        trending: None,
        opener: None,
    };
    thread::spawn(move || keeping.run());
    let (monitored, view) =
        Monitored::new(machine("rig-1"), opened, None, (Arc::clone(link.traffic()), &metrics));
    let (shard_queue, gauge) = (Arc::clone(&queue), metrics.shard(0));
    let shard = thread::spawn(move || {
        shard::run(&shard_queue, &mut [monitored], &Heartbeat::new(), &gauge);
    });
    Running { queue, link, view, metrics, shard, _store: folder }
}

impl Running {
    /// Waits for the snapshot that shows `state`.
    fn wait_for(&mut self, state: &SourceState) -> Arc<MachineView> {
        self.wait_until(|view| view.source == *state)
    }

    /// Waits for a snapshot.
    pub(super) fn wait_until(&mut self, is_it: impl Fn(&MachineView) -> bool) -> Arc<MachineView> {
        let found = tokio::runtime::Builder::new_current_thread()
            .build()
            .unwrap()
            .block_on(async { self.view.wait_for(|view| is_it(view)).await.map(|v| v.clone()) });
        found.unwrap()
    }

    fn play(&self, settings: &replay::Settings, seconds: u64) {
        source::run(
            settings,
            &mut || Ok(stream(seconds)),
            &self.link,
            &Stop::default(),
            (None, false),
        );
    }

    pub(super) fn end(self) {
        self.queue.close();
        self.shard.join().unwrap();
    }
}

fn at_full_speed() -> replay::Settings {
    replay::Settings {
        file: PathBuf::from("x.h5"),
        hints: Hints::default(),
        speed: Speed::Max,
        repeat: false,
    }
}

#[test]
fn a_replay_through_a_small_queue_loses_nothing() {
    let mut running = running(1); // one block at a time
    running.play(&at_full_speed(), 40);
    let view = running.wait_for(&SourceState::Finished);
    let [ring] = &view.rings[..] else { panic!("one ring") };
    assert_eq!((ring.received, ring.missing, ring.duplicated), (40_000, 0, 0));
    assert_eq!(ring.newest.0 - ring.oldest.0, 30 * RATE_HZ); // ring_seconds
    assert!((view.stream_time_s - 40.0).abs() < 1e-9); // 40,000 samples at 1,000 a second
    assert_eq!(view.dropped, (0, 0));
    let metrics = running.metrics.encode();
    let line = "rotorwatch_samples_received_total{machine=\"rig-1\",channel=\"x\"} 40000";
    assert!(metrics.contains(line), "{metrics}");
    running.end();
}

#[test]
fn a_finished_machine_still_answers() {
    let mut running = running(1 << 20);
    running.play(&at_full_speed(), 3);
    running.wait_for(&SourceState::Finished);
    let ask = |end, max_samples| {
        let (reply, answer) = oneshot::channel();
        let request = ShardRequest::Waveform { channel: 0, end, max_samples, reply };
        running.link.ask(request).unwrap();
        answer.blocking_recv().unwrap()
    };
    let newest = ask(End::Newest, 4).unwrap();
    assert_eq!((newest.start, newest.samples), (2996, vec![2996.0, 2997.0, 2998.0, 2999.0]));
    assert!((newest.start_time_s - 2.996).abs() < 1e-9);
    let earlier = ask(End::Before(10), usize::MAX).unwrap();
    assert_eq!((earlier.start, earlier.samples.len()), (0, 10));
    assert_eq!(ask(End::Before(0), 4), None);
    let by_time = ask(End::At(1.5), 4).unwrap();
    assert_eq!(by_time.samples, [1496.0, 1497.0, 1498.0, 1499.0]);
    let (reply, answer) = oneshot::channel();
    let nowhere = ShardRequest::Waveform { channel: 7, end: End::Newest, max_samples: 1, reply };
    running.link.ask(nowhere).unwrap();
    assert_eq!(answer.blocking_recv().unwrap(), None);
    let (reply, gone) = oneshot::channel();
    drop(gone); // the client has left: the shard does not mind
    running.link.ask(ShardRequest::Trend { channel: 0, reply }).unwrap();
    assert!(ask(End::Newest, 1).is_some());
    running.end();
}

#[test]
fn a_source_that_cannot_read_fails_with_its_causes() {
    let mut running = running(1 << 20);
    let mut open = || {
        let source = "disk on fire".into();
        Err(ReplayError::Open { file: PathBuf::from("x.h5"), source })
    };
    source::run(&at_full_speed(), &mut open, &running.link, &Stop::default(), (None, false));
    let reason = "opening x.h5 failed: disk on fire".to_owned();
    running.wait_for(&SourceState::Failed(reason));
    running.end();
}

#[test]
fn a_stop_ends_a_source_that_waits_for_its_time() {
    let running = running(1 << 20);
    let slow = replay::Settings { speed: Speed::Times(1e-6), ..at_full_speed() };
    let stop = Stop::default();
    stop.set();
    source::run(&slow, &mut || Ok(stream(10)), &running.link, &stop, (None, false)); // returns at once
    running.end();
}

#[test]
fn a_stop_ends_a_source_that_waits_for_room() {
    let queue = Arc::new(ShardQueue::new(1, 1)); // nobody takes anything out
    let link = Link::new(Arc::clone(&queue), 0);
    link.send(Input::Source(SourceState::Running)).unwrap();
    let source = thread::spawn(move || {
        source::run(
            &at_full_speed(),
            &mut || Ok(stream(10)),
            &link,
            &Stop::default(),
            (None, false),
        );
    });
    queue.close();
    source.join().unwrap();
}

#[test]
fn machines_are_dealt_out_by_load_and_always_alike() {
    let loads = [("d", 10.0), ("a", 100.0), ("c", 60.0), ("b", 50.0)];
    // a → 0, b → 1, c → 1 (50 < 100), d → 0 (100 < 110)
    assert_eq!(shard::assign(&loads, 2), [0, 0, 1, 1]);
    let idle = [("a", 0.0), ("b", 0.0), ("c", 0.0)];
    assert_eq!(shard::assign(&idle, 3), [0, 1, 2]);
}

#[test]
fn a_taken_port_is_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let folder = TempDir::new().unwrap();
    let store = Store { directory: folder.path().to_owned(), ..Config::default().store };
    let config = Config { bind: taken.local_addr().unwrap(), store, ..Config::default() };
    let error = Daemon::start(&config).unwrap_err();
    assert!(matches!(error, StartError::Bind { address, .. } if address == config.bind));
}
