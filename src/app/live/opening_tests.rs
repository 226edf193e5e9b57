//! A machine whose stream is opened by its senders: once, again, in vain.

use super::Room;
use super::joining;
use crate::api::support::sample_diagnosis;
use crate::api::view::MachineView;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::app::Clock;
use crate::app::captures::Captures;
use crate::app::link::Input;
use crate::app::link::Link;
use crate::app::link::ShardQueue;
use crate::app::monitored::Monitored;
use crate::app::stores::Stores;
use crate::app::tests::machine;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::config::Config;
use crate::config::FileText;
use crate::config::Live;
use crate::config::MachineConfig;
use crate::config::SourceConfig;
use crate::config::Store;
use crate::diagnosis::baseline::signed::Signed;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::DataQuality;
use crate::ingest::replay::StreamInfo;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::store::Act;
use crate::store::BaselineStore;
use crate::store::Held;
use crate::store::StoreError;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureState;
use crate::store::events::EventLog;
use crate::telemetry::Metrics;
use crate::units::Hz;
use crate::units::Unit;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;
use std::time::Instant;
use tempfile::TempDir;
use tokio::sync::oneshot;
use tokio::sync::watch;

const RATE_HZ: f64 = 1000.0;

/// A machine with live senders, on no thread.
struct Opened {
    monitored: Monitored,
    /// The way to it; nobody takes out of its queue.
    link: Link,
    view: watch::Receiver<Arc<MachineView>>,
    log: Arc<dyn EventLog>,
    captures: Arc<dyn CaptureIndex>,
    _folder: TempDir,
}

/// A store that falls over while it is told to, as a mistake of ours would.
struct Falling(Arc<AtomicBool>);

impl BaselineStore for Falling {
    fn baselines(&self, _: &str) -> Result<Vec<Held>, StoreError> {
        assert!(!self.0.load(Ordering::SeqCst), "as a mistake of ours would");
        Ok(Vec::new())
    }

    fn learn(&self, _: &Signed, _: &[Arc<str>]) -> Result<(), StoreError> {
        Ok(())
    }

    fn activate(&self, _: (&str, &str), _: &[Arc<str>], _: &Act<'_>) -> Result<bool, StoreError> {
        Ok(false)
    }

    fn retire(&self, _: &str, _: &[String], _: &Act<'_>) -> Result<(), StoreError> {
        Ok(())
    }

    fn described(&self, _: &str) -> Result<Vec<(String, Option<String>)>, StoreError> {
        Ok(Vec::new())
    }

    fn describe(&self, _: &str, _: &str) -> Result<(), StoreError> {
        Ok(())
    }

    fn remove(&self, _: (&str, &str), _: &Act<'_>) -> Result<bool, StoreError> {
        Ok(false)
    }

    fn version(&self) -> Result<i64, StoreError> {
        Ok(0)
    }

    fn newest_act(&self) -> Result<i64, StoreError> {
        Ok(0)
    }
}

fn live() -> Opened {
    live_with(None)
}

fn live_with(baselines: Option<Arc<dyn BaselineStore>>) -> Opened {
    live_of(Config::default(), baselines)
}

/// A machine with senders whose data are missed when a millisecond has passed.
fn impatient() -> Opened {
    let mut config = Config::default();
    config.monitor.alarms.missing_after_s = 1e-3;
    live_of(config, None)
}

fn live_of(config: Config, baselines: Option<Arc<dyn BaselineStore>>) -> Opened {
    let folder = TempDir::new().unwrap();
    let entry = MachineConfig {
        text: FileText::default(),
        file: PathBuf::new(),
        machine: machine("rig-1"),
        baseline: Vec::new(),
        source: SourceConfig::Live(Live::listening()),
    };
    let directory = folder.path().to_owned();
    let config = Config {
        store: Store { directory, ..Store::default() },
        machines: vec![entry.clone()],
        ..config
    };
    let metrics = Arc::new(Metrics::new());
    let mut stores =
        Stores::open(&config, &[(&entry.machine, &super::unknown_stream())], &metrics).unwrap();
    stores.baselines.store = baselines.unwrap_or(stores.baselines.store);
    let room = Arc::new(Room::new(config.memory_limit_bytes));
    let link = Link::new(Arc::new(ShardQueue::new(1 << 20, 4)), 0);
    let way = link.clone();
    let joined = joining::join(&config, &entry, way, (&stores, &metrics, &room), true).unwrap();
    let Stores { keeping, events, captures, .. } = stores;
    thread::spawn(move || keeping.run());
    let Captures { plan, handle, .. } = captures.unwrap();
    thread::spawn(move || plan.run(Clock::start()));
    let (monitored, view) = (joined.monitored, joined.handle.view);
    Opened { monitored, link, view, log: events.log, captures: handle.index, _folder: folder }
}

fn stream(name: &str, rate_hz: f64) -> Input {
    let channel = ChannelInfo {
        name: name.to_owned(),
        sample_rate: Hz(rate_hz),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    let received = ReceivedChannel {
        name: name.to_owned(),
        sample_rate: Hz(rate_hz),
        number_type: NumberType::F32,
        scale: 1.0,
        offset: 0.0,
        raw_zero: 0.0,
        unit: None,
        sensor: None,
    };
    let (channels, received) = (vec![channel], vec![received]);
    Input::Open(Box::new(StreamInfo { channels, received, ..super::unknown_stream() }))
}

impl Opened {
    /// Time passes; nothing has come since what was taken in.
    fn miss(&mut self) {
        thread::sleep(Duration::from_millis(2));
        self.monitored.tick(0);
    }

    /// Waits until what was told of health is as wanted: how many are healthy.
    fn wait_for_told(&self, is_it: impl Fn(usize) -> bool) {
        let deadline = crate::app::now() + Duration::from_secs(30);
        loop {
            let told = self.log.health("rig-1").unwrap();
            let n_healthy = told.values().filter(|one| one.state == State::Healthy).count();
            if is_it(n_healthy) {
                return;
            }
            assert!(crate::app::now() < deadline, "{told:?}");
            thread::sleep(Duration::from_millis(10));
        }
    }

    fn source(&self) -> SourceState {
        self.view.borrow().source.clone()
    }

    /// Takes in so many seconds of a tone from `start` s on.
    fn play(&mut self, start: u16, seconds: u16) {
        self.play_at(start, seconds, crate::app::now());
    }

    /// The same; it arrived at `arrived`.
    fn play_at(&mut self, start: u16, seconds: u16, arrived: Instant) {
        for second in start..start + seconds {
            let first = u64::from(second) * 1000;
            let samples = (0..1000).map(|i: u16| (0.1 * f32::from(i)).sin()).collect();
            let (channel, start) = (ChannelIndex(0), SampleIndex(first));
            let block = Block { channel, start, segment: 1, time_s: second.into(), samples };
            self.monitored.take(Input::Block(block, arrived), 0);
        }
    }
}

#[test]
fn a_stream_that_cannot_be_opened_fails_the_machine_until_one_can() {
    let mut live = live();
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(0, 1);
    assert_eq!(live.source(), SourceState::Running);
    // None of its channels is a sensor's; what comes of it meets nothing of the stream before.
    live.monitored.take(stream("nobody", RATE_HZ), 0);
    assert!(matches!(live.source(), SourceState::Failed(why) if why.contains("nobody")));
    live.play(1, 1);
    assert!(live.view.borrow().rings.is_empty());
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(2, 1);
    assert_eq!(live.source(), SourceState::Running);
    live.monitored.publish(0);
    assert_eq!(live.view.borrow().rings[0].received, 1000);
}

#[test]
fn an_opening_that_panics_fails_the_machine_alone() {
    let falls = Arc::new(AtomicBool::new(true));
    let mut live = live_with(Some(Arc::new(Falling(Arc::clone(&falls)))));
    live.monitored.take(stream("x", RATE_HZ), 0);
    falls.store(false, Ordering::SeqCst);
    assert!(matches!(live.source(), SourceState::Failed(why) if why.contains("internal error")));
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(0, 1);
    assert_eq!(live.source(), SourceState::Running);
}

#[test]
fn a_clock_that_runs_wrong_degrades_the_data_until_it_runs_right() {
    let mut live = live();
    live.monitored.take(stream("x", RATE_HZ), 0);
    let doubt = "channel `x`: +2.40 % more samples come".to_owned();
    let judged = |live: &Opened| live.view.borrow().diagnosis.clone().unwrap();
    live.play(0, 12);
    let before = judged(&live).data_quality;
    live.monitored.take(Input::Doubts(vec![doubt.clone()]), 0);
    live.play(12, 12);
    let doubted = judged(&live);
    assert!(doubted.warnings.contains(&doubt), "{:?}", doubted.warnings);
    assert_eq!(doubted.data_quality, before.max(DataQuality::Degraded));
    assert_eq!(before, DataQuality::Ok);
    live.monitored.take(Input::Doubts(Vec::new()), 0);
    live.play(24, 12);
    assert!(!judged(&live).warnings.contains(&doubt));
}

#[test]
fn what_was_judged_before_another_stream_is_not_judged_again() {
    let mut live = live();
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(0, 22);
    let judged_until_s = |live: &Opened| live.monitored.judged_until_s();
    let before = judged_until_s(&live).unwrap();
    assert!(before >= 15.0, "{before}");
    live.monitored.take(stream("x", RATE_HZ / 2.0), 0);
    assert!(judged_until_s(&live).unwrap() >= before);
}

#[test]
fn data_are_missed_whatever_others_have_in_the_queue() {
    let mut live = impatient();
    // What waits is of machine 1 of the shard, this one is machine 0.
    thread::sleep(Duration::from_millis(2));
    live.monitored.tick(1 << 20);
    assert!(live.view.borrow().no_data().is_some());
}

#[test]
fn nothing_is_missed_while_something_of_the_machine_waits() {
    let mut live = impatient();
    live.link.send(Input::Doubts(Vec::new())).unwrap();
    live.miss();
    assert!(live.view.borrow().no_data().is_none());
    live.monitored.note_taken();
    live.miss();
    assert!(live.view.borrow().no_data().is_some());
}

#[test]
fn a_sender_that_waits_for_room_is_not_silent() {
    let mut live = impatient();
    assert_eq!(live.link.keep_room(1 << 19), Ok(true));
    assert_eq!(live.link.keep_room(1 << 20), Ok(false));
    live.miss();
    assert!(live.view.borrow().no_data().is_none());
}

#[test]
fn what_was_healthy_is_told_to_be_undetermined_while_no_data_come() {
    let mut live = impatient();
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(0, 1);
    let mut healthy = sample_diagnosis();
    healthy.state = State::Healthy;
    healthy.components.truncate(1);
    healthy.components[0].state = State::Healthy;
    live.monitored.take_verdict(healthy, 1.0);
    live.wait_for_told(|n_healthy| n_healthy == 2);
    live.miss();
    live.wait_for_told(|n_healthy| n_healthy == 0);
    // They come again: what the newest verdict says holds, before there is another one.
    live.play_at(1, 1, crate::app::now() + Duration::from_secs(60));
    live.monitored.tick(0);
    assert!(live.view.borrow().no_data().is_none());
    live.wait_for_told(|n_healthy| n_healthy == 2);
}

#[test]
fn before_the_first_sample_stream_time_is_that_of_now() {
    let mut live = impatient();
    live.miss();
    // A day before the start is stream time 0.
    let from_start = |live: &Opened| live.view.borrow().stream_time_s - super::BEFORE_START_S;
    assert!((0.0..60.0).contains(&from_start(&live)), "{}", from_start(&live));
    live.monitored.take(stream("x", RATE_HZ), 0);
    live.play(7, 1);
    live.miss();
    assert!((live.view.borrow().stream_time_s - 8.0).abs() < 1e-9);
}

#[test]
fn a_capture_that_waits_for_data_ends_when_none_come() {
    let mut live = impatient();
    live.monitored.take(stream("x", RATE_HZ), 0);
    let (channel, start) = (ChannelIndex(0), SampleIndex(0));
    let raw = RawSamples::F32(vec![0.5; 1000]);
    let run = Received { channel, start, segment: 1, time_s: 0.0, raw };
    live.monitored.take(Input::Received(Arc::new(run)), 0);
    live.play(0, 1);
    let [author, comment] = ["M. Ito", "why"].map(str::to_owned);
    let (reply, answer) = oneshot::channel();
    let (before_s, after_s) = (None, Some(10.0));
    let asked = ShardRequest::Capture { author, comment, before_s, after_s, reply };
    live.monitored.answer(asked, 0);
    let id = answer.blocking_recv().unwrap().unwrap();
    live.miss();
    let deadline = crate::app::now() + Duration::from_secs(30);
    let mut entry = live.captures.find(&id).unwrap().unwrap();
    while entry.state == CaptureState::Writing {
        assert!(crate::app::now() < deadline, "{entry:?}");
        thread::sleep(Duration::from_millis(20));
        entry = live.captures.find(&id).unwrap().unwrap();
    }
    assert_eq!(entry.state, CaptureState::Complete);
    assert_eq!(entry.note.as_deref(), Some("it ends early: no data come any more"));
}
