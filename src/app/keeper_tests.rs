//! Alarms of a shard while its store refuses, and after.

use super::alarming::Alarming;
use super::keeper::Keeper;
use super::keeper::MachineKeeper;
use super::link::Input;
use super::tests::Running;
use super::tests::running_on;
use crate::alarms::Act;
use crate::alarms::Action;
use crate::alarms::Alarm;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmSource;
use crate::alarms::DataFlow;
use crate::alarms::Moment;
use crate::alarms::Settings;
use crate::alarms::state::ShownState;
use crate::api::view::ActFailure;
use crate::api::view::MachineView;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::store::Archive;
use crate::store::Batch;
use crate::store::ConfigurationEntry;
use crate::store::EventQuery;
use crate::store::StateStore;
use crate::store::StoreError;
use crate::store::StreamKey;
use crate::store::sqlite;
use crate::store::sqlite::SqliteStore;
use crate::telemetry::Metrics;
use prometheus_client::metrics::counter::Counter;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::thread;
use tempfile::TempDir;
use tokio::sync::oneshot;

/// A store that refuses while it is told to.
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

fn act(running: &Running, alarm: u64, action: Action) -> Result<Alarm, ActFailure> {
    let (reply, answer) = oneshot::channel();
    let (author, comment) = ("M. Ito".to_owned(), String::new());
    let act = Act { alarm, action, author, comment };
    running.link.ask(ShardRequest::Act { act, reply }).unwrap();
    answer.blocking_recv().unwrap()
}

fn of<'v>(view: &'v MachineView, source: &AlarmSource) -> Option<&'v Alarm> {
    view.alarms.iter().find(|alarm| alarm.source == *source)
}

#[test]
fn alarms_are_raised_served_and_acted_on_while_the_store_refuses_and_stored_when_it_recovers() {
    let folder = TempDir::new().unwrap();
    let (store, archive) = sqlite::open(folder.path()).unwrap();
    let (archive, refuses) = (Arc::new(archive), Arc::new(AtomicBool::new(true)));
    let refusing = Refusing { store, refuses: Arc::clone(&refuses) };
    let reading = Arc::clone(&archive) as Arc<dyn Archive>;
    let mut running = running_on(1 << 20, folder, Box::new(refusing), reading);
    running.link.send(Input::Source(SourceState::Failed("gone".to_owned()))).unwrap();
    // Its own alarm, and that of the store which could not store it.
    let view = running.wait_until(|view| of(view, &AlarmSource::Store).is_some());
    let store_alarm = of(&view, &AlarmSource::Store).unwrap();
    assert!(store_alarm.why.contains("disk is full"), "{store_alarm:?}");
    let data = of(&view, &AlarmSource::Data).unwrap().id;
    let Err(ActFailure::NotStored(why)) = act(&running, data, Action::Acknowledge) else {
        panic!("answered as if it were stored")
    };
    assert!(why.contains("disk is full"), "{why}");
    let shown = |view: &MachineView| of(view, &AlarmSource::Data).map(Alarm::shown);
    let in_effect = |view: &MachineView| shown(view) == Some(ShownState::Acknowledged);
    running.wait_until(in_effect);
    refuses.store(false, Ordering::SeqCst);
    running.wait_until(|view| of(view, &AlarmSource::Store).is_some_and(|a| !a.state.is_active()));
    let alarm = act(&running, data, Action::Shelve { for_s: 60.0 }).unwrap();
    // Answered: so it is there, and everything before it.
    let kept = archive.load("rig-1", &StreamKey::default(), Moment::of_stream(0.0), 100).unwrap();
    let sequences: Vec<u64> = kept.history.iter().map(|event| event.sequence).collect();
    assert_eq!(sequences, (1..=sequences.len() as u64).collect::<Vec<_>>());
    let stored = kept.alarms.iter().find(|alarm| alarm.id == data).unwrap();
    assert_eq!((stored.shown(), alarm.shown()), (ShownState::Shelved, ShownState::Shelved));
    assert_eq!(stored.acknowledgement, alarm.acknowledgement);
    running.end();
}

#[test]
fn the_history_has_no_hole_and_nothing_twice_while_the_store_lags() {
    const N_ACTS: u64 = 40;
    let folder = TempDir::new().unwrap();
    let (store, archive) = sqlite::open(folder.path()).unwrap();
    let metrics = Metrics::new();
    // Held back: what is sent waits until its thread runs.
    let (keeper, keeping) = Keeper::new(Box::new(store), Arc::new(archive), metrics.store());
    let reading = Arc::clone(&keeper.archive);
    let sender = MachineKeeper::new(keeper, "rig-1", StreamKey::default(), false);
    let (transitions, load) = (Counter::default(), metrics.alarm_load("rig-1"));
    let mut alarming = Alarming::new("rig-1", sender, true, transitions, load);
    // The engine remembers five transitions.
    let settings = Settings { history_len: 5, ..Settings::default() };
    let mut engine = AlarmEngine::new("rig-1", settings);
    let raised = engine.tick(Moment::of_stream(1.0), DataFlow::Failed("gone"), None);
    alarming.keep(&engine, raised, Vec::new(), 1.0);
    let mut answers = Vec::new();
    for n in 0..N_ACTS {
        let action = if n % 2 == 0 { Action::Shelve { for_s: 60.0 } } else { Action::Unshelve };
        let (author, comment) = ("M. Ito".to_owned(), n.to_string());
        let (reply, answer) = oneshot::channel();
        let act = Act { alarm: 1, action, author, comment };
        alarming.act(&mut engine, &act, 2.0, |_| (), reply);
        answers.push(answer);
    }
    let mut together = || {
        let held = alarming.history(&engine);
        let oldest_held = held.events[0].sequence;
        assert_eq!(held.dropped, oldest_held - 1);
        let machine = "rig-1".to_owned();
        let query =
            EventQuery { machine, before: oldest_held, limit: 1000, ..EventQuery::default() };
        let older = reading.events(&query).unwrap().into_iter().rev();
        let all = older.chain(held.events).map(|event| event.sequence).collect::<Vec<_>>();
        assert_eq!(all, (1..=N_ACTS + 1).collect::<Vec<_>>());
        held.dropped
    };
    assert_eq!(together(), 0, "all of it is in memory");
    let writing = thread::spawn(move || keeping.run());
    while together() < N_ACTS - 4 {
        thread::yield_now();
    }
    for answer in answers {
        answer.blocking_recv().unwrap().unwrap();
    }
    drop(alarming);
    writing.join().unwrap();
}
