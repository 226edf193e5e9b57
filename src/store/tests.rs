//! The store on real files: what goes in comes out, once, and what cannot be used is refused.

use super::sqlite;
use super::sqlite::SqliteArchive;
use super::sqlite::SqliteStore;
use super::*;
use crate::alarms::Acknowledgement;
use crate::alarms::AlarmSource;
use crate::alarms::Deadline;
use crate::alarms::EventKind;
use crate::alarms::Level;
use crate::alarms::Signature;
use crate::alarms::Silencing;
use crate::alarms::state::AlarmState;
use crate::alarms::state::Silence;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use rusqlite::Connection;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const START: Timestamp = Timestamp(1_700_000_000_000_000_000);

fn now(monotonic_s: f64, utc_s: f64) -> Moment {
    Moment { stream_s: 0.0, monotonic_s, utc: START.plus_seconds(utc_s) }
}

/// An alarm with every part filled.
pub(super) fn full(id: u64) -> Alarm {
    Alarm {
        id,
        component: "right".to_owned(),
        kind: ComponentKind::Bearing,
        source: AlarmSource::Limit("envelope".to_owned()),
        level: Level::Damaged,
        state: AlarmState::Acknowledged,
        silencing: Some(Silencing {
            silence: Silence::Shelved,
            author: "A. Berg".to_owned(),
            comment: "new oil; 'quoted'".to_owned(),
            since_s: 20.0,
            until: Some(Deadline { monotonic_s: 160.0, utc: START.plus_seconds(100.0) }),
        }),
        latching: true,
        fault: Some(FaultMode::InnerRace),
        why: "BPFI stands 31 dB over the floor".to_owned(),
        severity: Some(0.62),
        confidence: Some(0.97),
        raised_at_s: 10.0,
        active_since_s: 12.0,
        changed_at_s: 20.0,
        occurrences: 3,
        acknowledgement: Some(Acknowledgement {
            author: "M. Ito".to_owned(),
            comment: "seen".to_owned(),
            time_s: 15.0,
        }),
    }
}

/// An alarm with as little as possible.
pub(super) fn plain(id: u64) -> Alarm {
    Alarm {
        source: AlarmSource::Data,
        state: AlarmState::Unacknowledged,
        silencing: None,
        latching: false,
        fault: None,
        severity: None,
        confidence: None,
        acknowledgement: None,
        ..full(id)
    }
}

pub(super) fn event(sequence: u64, kind: EventKind, alarm: &Alarm) -> AlarmEvent {
    let by = (kind == EventKind::Shelved)
        .then(|| Signature { author: "A. Berg".to_owned(), comment: "new oil".to_owned() });
    AlarmEvent { sequence, kind, time_s: 20.0, by, alarm: alarm.clone() }
}

pub(super) fn batch(events: Vec<AlarmEvent>) -> Batch {
    let identity = Some("x.h5".to_owned());
    let stream = StreamKey { identity, start: Some(START), judged_by: None };
    let now = now(100.0, 40.0);
    Batch { stream, now, judged_until_s: Some(20.0), ..Batch::new("rig-1", events) }
}

pub(super) fn open(directory: &Path) -> (SqliteStore, SqliteArchive) {
    sqlite::open(directory).unwrap()
}

fn query(limit: usize) -> EventQuery {
    EventQuery {
        machine: "rig-1".to_owned(),
        before: u64::MAX,
        limit,
        start: Some(START),
        ..EventQuery::default()
    }
}

pub(super) fn load(archive: &SqliteArchive) -> Kept {
    archive.load("rig-1", &batch(Vec::new()).stream, now(100.0, 40.0), 100).unwrap()
}

#[test]
fn what_is_kept_is_found_again_whole() {
    let dir = TempDir::new().unwrap();
    let events =
        vec![event(1, EventKind::Raised, &plain(1)), event(2, EventKind::Shelved, &full(2))];
    {
        let (mut store, _) = open(dir.path());
        store.keep(&[batch(events.clone())]).unwrap();
    }
    let (_store, archive) = open(dir.path());
    let kept = load(&archive);
    assert_eq!(kept.alarms, [plain(1), full(2)]);
    // What is read as history has no shelf to leave by this clock.
    let mut without_clock = kept.history.clone();
    for alarm in without_clock.iter_mut().map(|event| &mut event.alarm) {
        let until = alarm.silencing.as_mut().and_then(|s| s.until.as_mut());
        if let Some(until) = until {
            until.monotonic_s = 160.0;
        }
    }
    assert_eq!(without_clock, events);
    assert_eq!((kept.last_id, kept.last_sequence, kept.judged_until_s), (2, 2, Some(20.0)));
    assert_eq!(
        archive.load("rig-2", &StreamKey::default(), now(0.0, 0.0), 9).unwrap(),
        Kept::default()
    );
}

#[test]
fn the_same_transition_twice_is_one_row_and_wakes_no_alarm_that_is_over() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    let raised = batch(vec![event(1, EventKind::Raised, &plain(1))]);
    let over = Alarm { state: AlarmState::Normal, ..plain(1) };
    let cleared = batch(vec![event(2, EventKind::Cleared, &over)]);
    store.keep(&[raised.clone(), cleared.clone()]).unwrap();
    store.keep(&[raised]).unwrap();
    store.keep(&[cleared]).unwrap();
    let kept = load(&archive);
    assert_eq!((kept.alarms.len(), kept.history.len()), (0, 2));
    assert_eq!((kept.last_id, kept.last_sequence), (1, 2), "numbers are never used again");
    let n: u32 =
        store.connection().query_row("SELECT count(*) FROM audit", (), |r| r.get(0)).unwrap();
    assert_eq!(n, 0, "nobody did anything");
}

#[test]
fn a_shelf_goes_on_with_the_smaller_of_what_was_left_and_what_the_clock_says() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    // 60 s were left when it was stored, at 40 s of 100 s by the wall clock.
    store.keep(&[batch(vec![event(1, EventKind::Shelved, &full(1))])]).unwrap();
    for (utc_s, left_s) in [(40.0, 60.0), (70.0, 30.0), (-3560.0, 60.0), (3640.0, 0.0)] {
        let stream = StreamKey { identity: None, start: Some(START), judged_by: None };
        let kept = archive.load("rig-1", &stream, now(5.0, utc_s), 1).unwrap();
        let until = kept.alarms[0].silencing.as_ref().unwrap().until.unwrap();
        assert!((until.monotonic_s - 5.0 - left_s).abs() < 1e-6, "{utc_s}: {until:?}");
        assert_eq!(until.utc, START.plus_seconds(100.0));
    }
}

#[test]
fn times_keep_their_instant_in_a_stream_that_begins_later() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    store.keep(&[batch(vec![event(1, EventKind::Raised, &full(1))])]).unwrap();
    let load = |start| {
        let stream = StreamKey { identity: Some("x.h5".to_owned()), start, judged_by: None };
        archive.load("rig-1", &stream, now(0.0, 0.0), 1).unwrap()
    };
    let later = load(Some(START.plus_seconds(1000.0)));
    let alarm = &later.alarms[0];
    let times =
        [alarm.raised_at_s, alarm.active_since_s, alarm.changed_at_s, later.history[0].time_s];
    for (found, expected) in times.into_iter().zip([-990.0, -988.0, -980.0, -980.0]) {
        // Nanoseconds of UTC.
        assert!((found - expected).abs() < 1e-9, "{found}");
    }
    assert!((load(None).alarms[0].raised_at_s - 10.0).abs() < 1e-12, "no start: as they were");
}

#[test]
fn a_stream_that_is_another_one_is_judged_from_its_beginning() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    store.keep(&[batch(vec![event(1, EventKind::Raised, &plain(1))])]).unwrap();
    let judged = |identity: Option<&str>| {
        let stream = StreamKey {
            identity: identity.map(str::to_owned),
            start: Some(START),
            judged_by: None,
        };
        archive.load("rig-1", &stream, now(0.0, 0.0), 1).unwrap().judged_until_s
    };
    assert_eq!(judged(Some("x.h5")), Some(20.0));
    assert_eq!((judged(Some("y.h5")), judged(None)), (None, None));
}

#[test]
fn the_history_is_read_by_page_component_alarm_and_time() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    let other = Alarm { component: "left".to_owned(), ..plain(2) };
    let late = AlarmEvent { time_s: 50.0, ..event(4, EventKind::Raised, &plain(3)) };
    let events = vec![
        event(1, EventKind::Raised, &plain(1)),
        event(2, EventKind::Raised, &other),
        event(3, EventKind::Escalated, &plain(1)),
        late,
    ];
    store.keep(&[batch(events)]).unwrap();
    let found = |query: EventQuery| -> Vec<u64> {
        archive.events(&query).unwrap().iter().map(|event| event.sequence).collect()
    };
    assert_eq!(found(query(3)), [4, 3, 2]);
    assert_eq!(found(EventQuery { before: 2, ..query(3) }), [1]);
    assert_eq!(found(EventQuery { component: Some("left".to_owned()), ..query(9) }), [2]);
    assert_eq!(found(EventQuery { alarm: Some(1), ..query(9) }), [3, 1]);
    let since = Some(START.plus_seconds(50.0));
    assert_eq!(found(EventQuery { since, ..query(9) }), [4]);
    assert_eq!(found(EventQuery { machine: "rig-2".to_owned(), ..query(9) }), [0; 0]);
    assert_eq!(
        (archive.oldest("rig-1").unwrap(), archive.oldest("rig-2").unwrap()),
        (Some(1), None)
    );
}

#[test]
fn the_oldest_transitions_give_way_and_alarms_stay() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    let events = (1..=50).map(|n| event(n, EventKind::Raised, &plain(n))).collect();
    store.keep(&[batch(events)]).unwrap();
    store.keep_transitions(10);
    store.keep(&[batch(vec![event(51, EventKind::Raised, &plain(51))])]).unwrap();
    assert_eq!(archive.oldest("rig-1").unwrap(), Some(42));
    assert_eq!(load(&archive).alarms.len(), 51);
}

#[test]
fn a_commit_survives_without_an_end() {
    let (dir, copy) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let (mut store, _archive) = open(dir.path());
    store.keep(&[batch(vec![event(1, EventKind::Raised, &plain(1))])]).unwrap();
    // What a killed process leaves: the files as they are, nothing closed.
    for entry in fs::read_dir(dir.path()).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
    }
    let (_store, archive) = open(copy.path());
    assert_eq!(load(&archive).alarms, [plain(1)]);
}

#[test]
fn a_second_daemon_is_kept_away() {
    let dir = TempDir::new().unwrap();
    let held = open(dir.path());
    let text = sqlite::open(dir.path()).unwrap_err().to_string();
    assert!(text.contains("in use by another process"), "{text}");
    drop(held);
    drop(open(dir.path()));
}

/// A database of schema 1 with an act and its audit's material.
fn of_schema_1(directory: &Path) {
    let file = directory.join(sqlite::FILE);
    let mut connection = Connection::open(&file).unwrap();
    schema::migrate(&mut connection, &file, 1).unwrap();
    let columns = format!("{}, {}", rows::EVENT, rows::ALARM);
    let values = rows::event_values(
        "rig-1",
        &event(1, EventKind::Shelved, &full(1)),
        Some(START),
        now(100.0, 40.0),
    );
    let insert = format!("INSERT INTO transition ({columns}) VALUES ({})", rows::places(&columns));
    connection.execute(&insert, rusqlite::params_from_iter(values)).unwrap();
}

#[test]
fn an_older_schema_is_brought_up_to_date_after_a_backup() {
    let dir = TempDir::new().unwrap();
    of_schema_1(dir.path());
    let (mut store, archive) = open(dir.path());
    let audited: (String, String, String) = store
        .connection()
        .query_row("SELECT author, action, comment FROM audit", (), |row| {
            Ok((row.get(0)?, row.get(1)?, row.get(2)?))
        })
        .unwrap();
    assert_eq!(audited, ("A. Berg".to_owned(), "shelved".to_owned(), "new oil".to_owned()));
    assert_eq!(archive.events(&query(9)).unwrap()[0].alarm.component, "right");
    let entry = |hash: &str, s| ConfigurationEntry {
        hash: hash.to_owned(),
        version: "0.1.0".to_owned(),
        since: START.plus_seconds(s),
    };
    for (hash, s) in [("a", 0.0), ("a", 1.0), ("b", 2.0), ("a", 3.0)] {
        store.note_configuration(&entry(hash, s)).unwrap();
    }
    assert_eq!(
        archive.configurations().unwrap(),
        [entry("a", 3.0), entry("b", 2.0), entry("a", 0.0)]
    );
    // The backup is a whole database of the old schema.
    let backup = schema::backup_of(&dir.path().join(sqlite::FILE), 1);
    let old = Connection::open(backup).unwrap();
    let version: u32 = old.query_row("PRAGMA user_version", (), |row| row.get(0)).unwrap();
    let n: u32 = old.query_row("SELECT count(*) FROM transition", (), |row| row.get(0)).unwrap();
    assert_eq!((version, n), (1, 1));
}

#[test]
fn a_schema_from_nothing_and_step_by_step_is_the_same() {
    let columns = |steps: &[u32]| -> Vec<String> {
        let dir = TempDir::new().unwrap();
        let file = dir.path().join("x.db");
        let mut connection = Connection::open(&file).unwrap();
        for step in steps {
            schema::migrate(&mut connection, &file, *step).unwrap();
        }
        let sql = "SELECT name || coalesce(sql, '') FROM sqlite_schema ORDER BY name";
        let mut statement = connection.prepare(sql).unwrap();
        statement.query_map((), |row| row.get(0)).unwrap().map(Result::unwrap).collect()
    };
    let steps: Vec<u32> = (1..=schema::newest()).collect();
    assert!(steps.len() > 1);
    assert_eq!(columns(&steps), columns(&[schema::newest()]));
}

#[test]
fn a_newer_schema_is_refused_with_the_backup_named() {
    let dir = TempDir::new().unwrap();
    of_schema_1(dir.path());
    drop(open(dir.path()));
    let file = dir.path().join(sqlite::FILE);
    Connection::open(&file).unwrap().pragma_update(None, "user_version", 77).unwrap();
    let before = fs::read(&file).unwrap();
    let text = sqlite::open(dir.path()).unwrap_err().to_string();
    assert!(text.contains("schema 77") && text.contains("state.schema-1.db"), "{text}");
    assert_eq!(fs::read(&file).unwrap(), before, "nothing was changed");
}

#[test]
fn what_is_damaged_or_foreign_is_refused_with_the_remedy() {
    let refused = |damage: fn(&mut Vec<u8>)| {
        let dir = TempDir::new().unwrap();
        let (mut store, archive) = open(dir.path());
        let events = (1..=200).map(|n| event(n, EventKind::Raised, &plain(n))).collect();
        store.keep(&[batch(events)]).unwrap();
        drop((store, archive));
        let file = dir.path().join(sqlite::FILE);
        let mut bytes = fs::read(&file).unwrap();
        damage(&mut bytes);
        fs::write(&file, bytes).unwrap();
        sqlite::open(dir.path()).unwrap_err().to_string()
    };
    for damage in [
        (|bytes: &mut Vec<u8>| bytes[..16].fill(b'?')) as fn(&mut Vec<u8>),
        |bytes| bytes[4096..].fill(0xA5),
        |bytes| bytes.truncate(bytes.len() / 2),
    ] {
        let text = refused(damage);
        assert!(text.contains("is damaged (") && text.contains("restore a backup"), "{text}");
    }
    let dir = TempDir::new().unwrap();
    let foreign = Connection::open(dir.path().join(sqlite::FILE)).unwrap();
    foreign.execute_batch("CREATE TABLE notes (text TEXT)").unwrap();
    let text = sqlite::open(dir.path()).unwrap_err().to_string();
    assert!(text.contains("another program"), "{text}");
    let file = dir.path().join("no-folder");
    fs::write(&file, "").unwrap();
    let text = sqlite::open(&file).unwrap_err().to_string();
    assert!(text.contains("[store] directory"), "{text}");
}

#[test]
fn standing_alarms_repair_what_lost_events_left() {
    let dir = TempDir::new().unwrap();
    let (mut store, archive) = open(dir.path());
    store.keep(&[batch(vec![event(1, EventKind::Raised, &plain(1))])]).unwrap();
    // Events 2 to 8 were lost: alarm 1 is over, alarm 5 stands.
    let repair = Batch { standing: Some(vec![plain(5)]), ..batch(Vec::new()) };
    store.keep(&[repair]).unwrap();
    let kept = load(&archive);
    assert_eq!(kept.alarms, [plain(5)]);
    assert_eq!(kept.last_id, 5);
}
