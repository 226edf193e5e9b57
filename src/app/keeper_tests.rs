//! Alarms of a shard while its store refuses, and after.

use super::link::Input;
use super::tests::Running;
use super::tests::running_on;
use crate::alarms::Act;
use crate::alarms::Action;
use crate::alarms::Alarm;
use crate::alarms::AlarmSource;
use crate::alarms::Moment;
use crate::alarms::state::ShownState;
use crate::api::view::ActFailure;
use crate::api::view::MachineView;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::store::Archive;
use crate::store::Batch;
use crate::store::ConfigurationEntry;
use crate::store::StateStore;
use crate::store::StoreError;
use crate::store::StreamKey;
use crate::store::sqlite;
use crate::store::sqlite::SqliteStore;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
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
