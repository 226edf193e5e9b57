//! The log: what is stored has a place, once, for good; receivers find theirs again.

use super::super::sqlite::SqliteStore;
use super::super::tests::batch;
use super::super::tests::event;
use super::super::tests::open;
use super::super::tests::plain;
use super::super::*;
use super::*;
use crate::alarms::EventKind;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use tempfile::TempDir;

fn opened() -> (TempDir, SqliteStore, SqliteEvents) {
    let dir = TempDir::new().unwrap();
    let (store, _) = open(dir.path());
    let events = SqliteEvents::join(dir.path()).unwrap();
    (dir, store, events)
}

fn raised(sequence: u64) -> AlarmEvent {
    event(sequence, EventKind::Raised, &plain(sequence))
}

fn change(subject: Subject, state: State) -> HealthChange {
    HealthChange {
        subject,
        time_s: 20.0,
        health: Health { state, fault: Some(FaultMode::InnerRace) },
        before: Some(State::Healthy),
        severity: Some(0.6),
        confidence: None,
        why: "lines at BPFI".to_owned(),
    }
}

fn bearing() -> Subject {
    Subject::Component(ComponentKind::Bearing, "right".to_owned())
}

fn places(entries: &[LogEntry]) -> Vec<u64> {
    entries.iter().map(|entry| entry.place).collect()
}

#[test]
fn what_happened_is_read_in_its_order_and_whole() {
    let (_dir, mut store, events) = opened();
    let healths = vec![change(Subject::Machine, State::Warning), change(bearing(), State::Damaged)];
    let first = Batch { health: healths.clone(), ..batch(vec![raised(1), raised(2)]) };
    let second = Batch { machine: "rig-2".to_owned(), ..batch(vec![raised(1)]) };
    store.keep(&[first.clone(), second]).unwrap();
    let found = events.after(0, 100).unwrap();
    assert_eq!(places(&found), [1, 2, 3, 4, 5]);
    assert_eq!(found[0].what, Happened::Alarm(Box::new(raised(1))));
    assert_eq!(found[2].what, Happened::Health(healths[0].clone()));
    assert_eq!(found[3].what, Happened::Health(healths[1].clone()));
    assert_eq!((found[4].machine.as_str(), found[4].start), ("rig-2", first.stream.start));
    assert!(found.iter().all(|entry| entry.recorded == first.now.utc));
    assert_eq!(places(&events.after(2, 2).unwrap()), [3, 4]);
    assert!(events.after(5, 100).unwrap().is_empty());
    assert_eq!(events.extent().unwrap(), Extent { newest: 5, removed_until: 0 });
    let known = events.health("rig-1").unwrap();
    assert_eq!(known.len(), 2);
    assert_eq!(known[&bearing()], healths[1].health);
    assert!(events.health("rig-3").unwrap().is_empty());
}

#[test]
fn a_transition_that_is_stored_again_has_no_second_place() {
    let (_dir, mut store, events) = opened();
    store.keep(&[batch(vec![raised(1)])]).unwrap();
    store.keep(&[batch(vec![raised(1), raised(2)])]).unwrap();
    let found = events.after(0, 100).unwrap();
    let sequences: Vec<u64> = found
        .iter()
        .map(|entry| match &entry.what {
            Happened::Alarm(event) => event.sequence,
            Happened::Health(_) | Happened::Configuration(_) | Happened::Maintenance(_) => 0,
        })
        .collect();
    assert_eq!(sequences, [1, 2]);
}

#[test]
fn the_oldest_give_way_by_kind_and_no_place_is_given_again() {
    let (_dir, mut store, events) = opened();
    for n in 1..=10 {
        let health = vec![change(bearing(), State::Warning)];
        store.keep(&[Batch { health, ..batch(vec![raised(n)]) }]).unwrap();
    }
    let prune = |store: &SqliteStore, alarms, health| {
        let transaction = store.connection().unchecked_transaction().unwrap();
        prune_to(&transaction, alarms, health).unwrap();
        transaction.commit().unwrap();
    };
    prune(&store, 10, 3);
    // Alarms have odd places, changes of health even ones.
    assert_eq!(
        places(&events.after(0, 100).unwrap()),
        [1, 3, 5, 7, 9, 11, 13, 15, 16, 17, 18, 19, 20]
    );
    assert_eq!(events.extent().unwrap(), Extent { newest: 20, removed_until: 14 });
    prune(&store, 0, 0);
    assert!(events.after(0, 100).unwrap().is_empty());
    store.keep(&[batch(vec![raised(11)])]).unwrap();
    assert_eq!(places(&events.after(0, 100).unwrap()), [21]);
    assert_eq!(events.extent().unwrap(), Extent { newest: 21, removed_until: 20 });
}

#[test]
fn an_older_database_brings_its_history_into_the_log() {
    let dir = TempDir::new().unwrap();
    let (mut store, _) = open(dir.path());
    store.keep(&[batch(vec![raised(1), raised(2)])]).unwrap();
    // Back to what schema 3 was, as a database of the version before.
    store
        .connection()
        .execute_batch(
            "DROP TABLE event; DROP TABLE event_log; DROP TABLE health; DROP TABLE receiver;
             DROP TABLE capture; DROP TABLE alarm_capture; DROP TABLE capture_alarm; DROP TABLE decision;
             DROP TABLE advance; DROP TABLE advance_last; DROP TABLE feedback; ALTER TABLE baseline DROP COLUMN described;
             PRAGMA user_version = 3;",
        )
        .unwrap();
    drop(store);
    let (store, _) = open(dir.path());
    let events = SqliteEvents::join(dir.path()).unwrap();
    assert_eq!(places(&events.after(0, 100).unwrap()), [1, 2]);
    assert_eq!(events.begin("room").unwrap().settled_until, 2, "nobody is told of old alarms");
    drop(store);
}

#[test]
fn maintenance_is_told_with_who_why_and_until_when() {
    let (_dir, mut store, events) = opened();
    let change = |outcome, until| MaintenanceChange {
        outcome,
        author: "M. Ito".to_owned(),
        reason: "new belt".to_owned(),
        until,
    };
    let told = [
        change(MaintenanceOutcome::Began, Some(Timestamp(7))),
        change(MaintenanceOutcome::Ended, None),
        change(MaintenanceOutcome::Over, Some(Timestamp(9))),
    ];
    store.keep(&[Batch { maintenance: told.to_vec(), ..batch(Vec::new()) }]).unwrap();
    let found = events.after(0, 10).unwrap();
    assert!(found.iter().all(|entry| entry.machine == "rig-1"));
    let found: Vec<Happened> = found.into_iter().map(|entry| entry.what).collect();
    assert_eq!(found, told.map(Happened::Maintenance));
}

#[test]
fn a_receiver_begins_with_what_comes_and_finds_its_place_again() {
    let (dir, mut store, events) = opened();
    store.keep(&[batch(vec![raised(1), raised(2)])]).unwrap();
    let begun = events.begin("room").unwrap();
    assert_eq!(begun, Progress { settled_until: 2, ..Progress::default() });
    store.keep(&[batch(vec![raised(3)])]).unwrap();
    assert_eq!(events.begin("room").unwrap(), begun, "not moved by what came");
    let progress = Progress { settled_until: 3, n_delivered: 1, n_refused: 2, n_given_up: 3 };
    events.keep("room", &progress).unwrap();
    events.begin("other").unwrap();
    let again = SqliteEvents::join(dir.path()).unwrap();
    assert_eq!(again.begin("room").unwrap(), progress);
    assert_eq!(again.forget_others(&["room"]).unwrap(), ["other"]);
    assert!(again.forget_others(&["room"]).unwrap().is_empty());
    // An older copy of the database was put in place.
    events.keep("room", &Progress { settled_until: 99, ..progress }).unwrap();
    assert_eq!(events.begin("room").unwrap().settled_until, 3);
}
