//! The index of captures: what is begun, ended, refused, and found again.

use super::captures::CaptureEntry;
use super::captures::CaptureIndex;
use super::captures::CaptureLink;
use super::captures::CaptureQuery;
use super::captures::CaptureState;
use super::captures::Ending;
use super::captures::SqliteCaptures;
use super::sqlite;
use crate::signal::Timestamp;
use rusqlite::Connection;
use tempfile::TempDir;

fn entry(machine: &str, number: u64, alarms: &[u64]) -> CaptureEntry {
    CaptureEntry {
        id: format!("{machine}-{number:08}"),
        machine: machine.to_owned(),
        number,
        by: None,
        requested: Timestamp(1_000_000_000 * i64::try_from(number).unwrap()),
        start: Some(Timestamp(5)),
        trigger_s: 12.5,
        span_s: (Some(2.5), None),
        state: CaptureState::Writing,
        note: None,
        bytes: 0,
        n_windows: 4,
        alarms: alarms.to_vec(),
    }
}

fn index() -> (TempDir, SqliteCaptures) {
    let dir = TempDir::new().unwrap();
    // The writing connection makes the schema; it is closed again.
    drop(sqlite::open(dir.path()).unwrap());
    let index = SqliteCaptures::join(dir.path()).unwrap();
    (dir, index)
}

fn ids(found: &[CaptureEntry]) -> Vec<&str> {
    found.iter().map(|entry| entry.id.as_str()).collect()
}

#[test]
fn what_was_begun_and_ended_is_found_again_also_after_a_restart() {
    let (dir, index) = index();
    let whole = entry("rig-1", 7, &[3, 4]);
    index.begin(&whole).unwrap();
    assert!(index.begin(&whole).is_err(), "an id is used once");
    let note = Some("it ends where samples were lost".to_owned());
    let ending =
        Ending { state: CaptureState::Complete, note, bytes: Some(1234), to_s: Some(15.0) };
    index.end(&whole.id, &ending).unwrap();
    index.end("rig-1-00000099", &ending).unwrap();
    drop(index);
    let index = SqliteCaptures::join(dir.path()).unwrap();
    let found = index.find(&whole.id).unwrap().unwrap();
    let expected = CaptureEntry {
        state: CaptureState::Complete,
        note: ending.note.clone(),
        bytes: 1234,
        span_s: (Some(2.5), Some(15.0)),
        ..whole
    };
    assert_eq!(found, expected);
    assert_eq!((index.highest("rig-1").unwrap(), index.highest("rig-2").unwrap()), (7, 0));
    assert!(index.find("rig-1-00000099").unwrap().is_none());
}

#[test]
fn lists_are_newest_first_by_machine_and_alarm_and_in_pages() {
    let (_dir, index) = index();
    for (machine, number) in [("a", 1), ("b", 1), ("a", 2), ("a", 3)] {
        index.begin(&entry(machine, number, &[10 + number])).unwrap();
    }
    let query = CaptureQuery { limit: 2, ..CaptureQuery::default() };
    let first = index.list(&query).unwrap();
    assert_eq!(ids(&first), ["a-00000003", "a-00000002"]);
    let after = Some("a-00000002".to_owned());
    let second = index.list(&CaptureQuery { after, ..query.clone() }).unwrap();
    assert_eq!(ids(&second), ["b-00000001", "a-00000001"]);
    let machines = Some(vec!["b".to_owned()]);
    assert_eq!(
        ids(&index.list(&CaptureQuery { machines, ..query.clone() }).unwrap()),
        ["b-00000001"]
    );
    let of_alarm = CaptureQuery { machines: Some(vec!["a".to_owned()]), alarm: Some(11), ..query };
    assert_eq!(ids(&index.list(&of_alarm).unwrap()), ["a-00000001"], "not b's alarm 11");
}

#[test]
fn an_alarm_has_a_capture_or_a_reason_and_keeps_the_capture_it_had() {
    let (_dir, index) = index();
    index.begin(&entry("a", 1, &[5])).unwrap();
    index.refuse("a", &[5, 6], "too many within the hour", Timestamp(9)).unwrap();
    let asked = [("a", 5), ("a", 6), ("a", 7), ("b", 5)].map(|(m, n)| (m.to_owned(), n));
    let links = index.links(&asked).unwrap();
    let has = CaptureLink::Has("a-00000001".to_owned(), CaptureState::Writing);
    let none = CaptureLink::None("too many within the hour".to_owned());
    assert_eq!(links, [Some(has), Some(none), None, None]);
}

#[test]
fn an_alarm_that_is_captured_again_keeps_its_first_capture() {
    let (_dir, index) = index();
    index.begin(&entry("a", 1, &[5])).unwrap();
    index.begin(&entry("a", 2, &[5, 6])).unwrap();
    let query = CaptureQuery { limit: 9, ..CaptureQuery::default() };
    let all = index.list(&query).unwrap();
    assert_eq!(ids(&all), ["a-00000002", "a-00000001"]);
    assert_eq!((&all[0].alarms[..], &all[1].alarms[..]), (&[5, 6][..], &[5][..]));
    let of = CaptureQuery { machines: Some(vec!["a".to_owned()]), alarm: Some(5), ..query };
    assert_eq!(ids(&index.list(&of).unwrap()), ["a-00000002", "a-00000001"]);
    let newest = CaptureLink::Has("a-00000002".to_owned(), CaptureState::Writing);
    assert_eq!(index.links(&[("a".to_owned(), 5)]).unwrap(), [Some(newest)]);
}

#[test]
fn who_asked_is_in_the_audit_in_the_same_commit() {
    let (dir, index) = index();
    let by = Some(("M. Ito".to_owned(), "noise at the start".to_owned()));
    let asked = CaptureEntry { by, ..entry("a", 1, &[]) };
    index.begin(&asked).unwrap();
    assert!(index.begin(&asked).is_err());
    assert_eq!(index.find(&asked.id).unwrap().unwrap().by, asked.by);
    let connection = Connection::open(dir.path().join(sqlite::FILE)).unwrap();
    let rows: i64 = connection
        .query_row(
            "SELECT count(*) FROM audit WHERE author = 'M. Ito' AND action = 'capture_requested'
             AND machine = 'a' AND comment = 'noise at the start'",
            (),
            |row| row.get(0),
        )
        .unwrap();
    assert_eq!(rows, 1, "what was refused left no line");
}
