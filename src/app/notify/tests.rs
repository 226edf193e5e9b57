//! Carrying from a real store with injected time: dead receivers, restarts, clocks that are set.

use super::carrier::Due;
use super::carrier::Follower;
use super::*;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::AlarmSource;
use crate::alarms::EventKind;
use crate::alarms::Level;
use crate::alarms::state::AlarmState;
use crate::api::wire::events::HappenedWire;
use crate::diagnosis::fault::ComponentKind;
use crate::notify::Answer;
use crate::notify::Backoff;
use crate::notify::Filter;
use crate::notify::event_id;
use crate::signal::Timestamp;
use crate::store::Batch;
use crate::store::ConfigurationEntry;
use crate::store::StateStore;
use crate::store::events::Happened;
use crate::store::events::LogEntry;
use crate::store::sqlite;
use crate::store::sqlite::SqliteStore;
use crate::store::writer::Job;
use crate::store::writer::Writer;
use std::cell::Cell;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use tempfile::TempDir;

const HOUR_S: f64 = 3600.0;

struct World {
    dir: TempDir,
    store: SqliteStore,
    /// Monotonic time, s, and how far the wall clock is from it, s.
    now: Cell<(f64, f64)>,
    up: Cell<bool>,
    metrics: Metrics,
    status: Arc<Status>,
}

impl World {
    fn new() -> Self {
        let dir = TempDir::new().unwrap();
        let (store, _) = sqlite::open(dir.path()).unwrap();
        let (now, up) = (Cell::new((0.0, 0.0)), Cell::new(true));
        Self { dir, store, now, up, metrics: Metrics::new(), status: Arc::default() }
    }

    fn happen(&mut self, machine: &str, sequences: std::ops::RangeInclusive<u64>, level: Level) {
        let events = sequences.map(|sequence| transition(sequence, level)).collect();
        self.store.keep(&[Batch::new(machine, events)]).unwrap();
    }

    /// A follower as a start of the daemon makes it.
    fn follower(
        &self,
        filter: Filter,
        max_waiting: usize,
    ) -> (Follower, watch::Receiver<ReceiverView>) {
        let events = Arc::new(SqliteEvents::join(self.dir.path()).unwrap());
        let log: Arc<dyn EventLog> = Arc::clone(&events) as Arc<dyn EventLog>;
        let receivers: Arc<dyn Receivers> = events;
        let progress = receivers.begin("room").unwrap();
        let (told, view) = watch::channel(ReceiverView::default());
        let metrics = self.metrics.receiver("room");
        let status = Arc::clone(&self.status);
        let begun = Begun { log, receivers, progress, told, metrics, status };
        (Follower::new(begun, "room", filter, (max_waiting, Backoff::default())), view)
    }

    /// Carries once; what arrives goes to `arrived` as `machine#sequence`.
    fn carry(&self, follower: &mut Follower, arrived: &mut Vec<String>) -> Due {
        let now = || {
            let (now_s, off_s) = self.now.get();
            (now_s, Timestamp::default().plus_seconds(now_s + off_s))
        };
        let mut send = |entry: &LogEntry| {
            if !self.up.get() {
                return Answer::Failed("refuses the connection".to_owned());
            }
            let Happened::Alarm(event) = &entry.what else { panic!("{entry:?}") };
            let HappenedWire::Alarm(message) = HappenedWire::new(entry) else {
                panic!("{entry:?}")
            };
            assert_eq!(message.stored, message.id == event_id(&entry.machine, event.sequence));
            arrived.push(message.id);
            Answer::Status(200, None)
        };
        follower.carry(&now, &mut send, &mut || 0.7, &|| false)
    }
}

fn transition(sequence: u64, level: Level) -> AlarmEvent {
    let alarm = Alarm {
        id: sequence,
        component: "right".to_owned(),
        kind: ComponentKind::Bearing,
        source: AlarmSource::Diagnosis,
        level,
        state: AlarmState::Unacknowledged,
        silencing: None,
        latching: false,
        fault: None,
        why: String::new(),
        severity: None,
        confidence: None,
        raised_at_s: 0.0,
        active_since_s: 0.0,
        changed_at_s: 0.0,
        occurrences: 1,
        acknowledgement: None,
    };
    AlarmEvent { sequence, kind: EventKind::Raised, time_s: 0.0, by: None, alarm }
}

fn ids(machine: &str, sequences: std::ops::RangeInclusive<u64>) -> Vec<String> {
    sequences.map(|sequence| format!("{machine}#{sequence}")).collect()
}

#[test]
fn a_receiver_dead_for_an_hour_gets_all_in_order_over_restarts_and_clocks_that_are_set() {
    let mut world = World::new();
    world.happen("rig-1", 1..=5, Level::Warning);
    let (mut follower, mut view) = world.follower(Filter::default(), 10_000);
    let mut arrived = Vec::new();
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert!(arrived.is_empty(), "a new receiver is not told of the past");
    world.up.set(false);
    let (mut sequence, mut n_restarts) = (5, 0);
    while world.now.get().0 < HOUR_S {
        let (now_s, mut off_s) = world.now.get();
        if sequence < 300 {
            sequence += 1;
            world.happen("rig-1", sequence..=sequence, Level::Warning);
            world.happen("rig-2", sequence..=sequence, Level::Warning);
        }
        // The wall clock is set back and forth by an hour.
        off_s = if off_s > 0.0 { -HOUR_S } else { HOUR_S };
        world.now.set((now_s, off_s));
        let Due::At(at_s) = world.carry(&mut follower, &mut arrived) else {
            panic!("nothing waits")
        };
        assert!(at_s > now_s && at_s <= now_s + 60.0, "{now_s} {at_s}");
        assert!(view.borrow().failure.is_some());
        assert!(view.borrow().waiting_since.is_some());
        assert_eq!(world.metrics.receiver("room").failing.get(), 1);
        world.now.set((at_s, off_s));
        if at_s > HOUR_S / 4.0 * f64::from(n_restarts + 1) {
            n_restarts += 1;
            (follower, view) = world.follower(Filter::default(), 10_000);
        }
    }
    assert!(n_restarts >= 3 && arrived.is_empty());
    world.up.set(true);
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    let of = |machine: &str| -> Vec<String> {
        arrived.iter().filter(|id| id.starts_with(machine)).cloned().collect()
    };
    assert_eq!(of("rig-1"), ids("rig-1", 6..=sequence));
    assert_eq!(of("rig-2"), ids("rig-2", 6..=sequence));
    let told = view.borrow().clone();
    assert_eq!((told.n_waiting, told.waiting_since), (0, None));
    assert_eq!((told.n_waiting, told.failure), (0, None));
    assert_eq!(told.progress.n_delivered, arrived.len() as u64);
    assert_eq!(world.metrics.receiver("room").failing.get(), 0);
    // Started again, it has nothing to send.
    let (mut follower, _) = world.follower(Filter::default(), 10_000);
    let n = arrived.len();
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert_eq!(arrived.len(), n);
}

#[test]
fn what_is_too_much_is_given_up_from_the_oldest_and_counted_once() {
    let mut world = World::new();
    let (mut follower, view) = world.follower(Filter::default(), 10);
    world.up.set(false);
    world.happen("rig-1", 1..=25, Level::Warning);
    let mut arrived = Vec::new();
    world.carry(&mut follower, &mut arrived);
    assert_eq!((view.borrow().n_waiting, view.borrow().progress.n_given_up), (10, 15));
    let (mut follower, view) = world.follower(Filter::default(), 10);
    world.carry(&mut follower, &mut arrived);
    assert_eq!((view.borrow().n_waiting, view.borrow().progress.n_given_up), (10, 15));
    world.up.set(true);
    world.now.set((100.0, 0.0));
    world.carry(&mut follower, &mut arrived);
    assert_eq!(arrived, ids("rig-1", 16..=25));
    let text = world.metrics.encode();
    let line = "rotorwatch_notifications_total{receiver=\"room\",outcome=\"given_up\"} 15";
    assert!(text.contains(line), "{text}");
}

#[test]
fn only_what_was_asked_for_is_sent() {
    let mut world = World::new();
    let filter = Filter {
        machines: vec!["rig-2".to_owned()],
        levels: vec![Level::Damaged],
        transitions: vec![EventKind::Raised, EventKind::Escalated],
    };
    let (mut follower, view) = world.follower(filter.clone(), 10);
    world.happen("rig-1", 1..=3, Level::Damaged);
    world.happen("rig-2", 1..=3, Level::Warning);
    world.happen("rig-2", 4..=6, Level::Damaged);
    let mut arrived = Vec::new();
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert_eq!(arrived, ids("rig-2", 4..=6));
    assert_eq!(view.borrow().progress.settled_until, 9);
    let other = AlarmEvent { kind: EventKind::Cleared, ..transition(1, Level::Damaged) };
    assert!(!filter.takes("rig-2", &other));
}

/// A store that refuses until somebody says otherwise.
struct Refusing {
    store: SqliteStore,
    refuses: Arc<AtomicBool>,
}

impl StateStore for Refusing {
    fn keep(&mut self, batches: &[Batch]) -> Result<(), StoreError> {
        if self.refuses.load(Ordering::SeqCst) {
            return Err(StoreError::Database { doing: "storing", source: "disk is full".into() });
        }
        self.store.keep(batches)
    }

    fn note_configuration(&mut self, entry: &ConfigurationEntry) -> Result<(), StoreError> {
        self.store.note_configuration(entry)
    }
}

#[test]
fn what_the_store_refuses_is_sent_at_once_and_again_when_it_is_stored() {
    let World { dir, store, .. } = World::new();
    let refuses = Arc::new(AtomicBool::new(true));
    let status = Arc::new(Status::default());
    let refusing = Refusing { store, refuses: Arc::clone(&refuses) };
    let mut writer = Writer::new(Box::new(refusing), &status);
    // Another store stands in its place in the world, which only reads.
    let store = sqlite::open(TempDir::new().unwrap().path()).unwrap().0;
    let world = World { dir, store, status: Arc::clone(&status), ..World::new() };
    let filter = Filter { levels: vec![Level::Damaged], ..Filter::default() };
    let (mut follower, view) = world.follower(filter, 10);
    let mut happen = |sequences: std::ops::RangeInclusive<u64>| {
        let events = sequences
            .map(|n| transition(n, if n % 2 == 0 { Level::Damaged } else { Level::Warning }));
        writer.take(vec![Job { batch: Batch::new("rig-1", events.collect()), done: None }])
    };
    let mut arrived = Vec::new();
    assert!(happen(1..=4).is_err());
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert_eq!(arrived, ["rig-1#2@0", "rig-1#4@0"], "without waiting for the store");
    // Nothing twice, and a receiver that is away is tried again.
    world.up.set(false);
    assert!(happen(5..=6).is_err());
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::At(5.0));
    world.up.set(true);
    world.now.set((5.0, 0.0));
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert_eq!(arrived[2..], ["rig-1#6@0"]);
    assert_eq!(view.borrow().progress.n_delivered, 0, "that is counted when it is stored");
    refuses.store(false, Ordering::SeqCst);
    happen(7..=8).unwrap();
    assert_eq!(world.carry(&mut follower, &mut arrived), Due::Stored);
    assert_eq!(arrived[3..], ["rig-1#2", "rig-1#4", "rig-1#6", "rig-1#8"], "all, in order");
    assert_eq!(view.borrow().progress.n_delivered, 4);
}
