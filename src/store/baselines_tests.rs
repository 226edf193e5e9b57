//! Baselines on real files: what goes in comes out bit by bit, each act is whole, in the audit, and survives.

use super::baselines::SqliteBaselines;
use super::*;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::units::Hz;
use rusqlite::Connection;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const AT: Timestamp = Timestamp(1_700_000_000_000_000_000);

fn record(name: &str, speed: Option<f64>, value: f64) -> Record {
    let usual =
        |value: f64, log_scatter| Usual { log_value: value.ln(), log_scatter, n_windows: 7 };
    let key = |feature: &str| ("x 'y'".to_owned(), feature.to_owned());
    Record {
        name: name.to_owned(),
        point: OperatingPoint { speed: speed.map(Hz), load: Some(-0.0) },
        usual: BTreeMap::from([
            (key("rms"), usual(value, Some(0.1))),
            (key("kurtosis"), usual(1.0, None)),
            (key("tiny"), usual(f64::MIN_POSITIVE, Some(1e-300))),
        ]),
        n_windows: 7,
        left_out: BTreeMap::from([("not running".to_owned(), 2), ("no sensor".to_owned(), 1)]),
        ..Record::default()
    }
}

fn signed(machine: &str, speed: f64, value: f64) -> Signed {
    let records = vec![record("a.h5", Some(speed), value), record("b.h5", None, value)];
    Signed::new(machine, ("A. Berg", "it's new"), AT, records, &[]).unwrap()
}

fn by(author: &str) -> Act<'_> {
    Act { author, comment: "why", at: AT.plus_seconds(60.0) }
}

fn audit(directory: &Path) -> Vec<(String, String, String)> {
    let connection = Connection::open(directory.join(sqlite::FILE)).unwrap();
    let mut rows =
        connection.prepare("SELECT author, action, baseline FROM audit ORDER BY id").unwrap();
    let found = rows.query_map((), |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap();
    found.map(Result::unwrap).collect()
}

#[test]
fn what_is_learned_is_found_again_bit_by_bit_and_intact() {
    let dir = TempDir::new().unwrap();
    let one = signed("rig-1", 10.0, 0.1 + 0.2);
    SqliteBaselines::open(dir.path()).unwrap().learn(&one, &[]).unwrap();
    let store = SqliteBaselines::open(dir.path()).unwrap();
    let held = store.baselines("rig-1").unwrap();
    assert_eq!(held, [Held { signed: one.clone(), is_active: true, is_intact: true }]);
    for (found, put) in held[0].signed.records.iter().zip(&one.records) {
        let bits = |r: &Record| -> Vec<u64> {
            r.usual.values().map(|usual| usual.log_value.to_bits()).collect()
        };
        assert_eq!(bits(found), bits(put));
    }
    assert!(store.baselines("rig-2").unwrap().is_empty());
    assert!(store.learn(&one, &[]).is_err(), "learned once is learned");
    assert_eq!(audit(dir.path()).len(), 1, "a refused act leaves no line");
}

#[test]
fn every_act_is_whole_and_has_its_line_in_the_audit() {
    let dir = TempDir::new().unwrap();
    let store = SqliteBaselines::open(dir.path()).unwrap();
    let (a, b) = (signed("rig-1", 10.0, 1.0), signed("rig-1", 10.0, 2.0));
    store.learn(&a, &[]).unwrap();
    store.learn(&b, std::slice::from_ref(&a.id)).unwrap();
    let active = || -> Vec<Arc<str>> {
        let held = store.baselines("rig-1").unwrap();
        held.iter().filter(|h| h.is_active).map(|h| Arc::clone(&h.signed.id)).collect()
    };
    assert_eq!(active(), [Arc::clone(&b.id)]);
    assert!(store.activate(("rig-1", &a.id), &[Arc::clone(&b.id)], &by("M. Ito")).unwrap());
    assert_eq!(active(), [Arc::clone(&a.id)]);
    assert!(!store.activate(("rig-2", &a.id), &[], &by("M. Ito")).unwrap(), "of another machine");
    assert!(store.remove(("rig-1", &b.id), &by("M. Ito")).unwrap());
    assert!(!store.remove(("rig-1", &b.id), &by("M. Ito")).unwrap(), "removed once");
    assert_eq!(store.baselines("rig-1").unwrap().len(), 1);
    let line = |author: &str, action: &str, one: &Signed| {
        (author.to_owned(), action.to_owned(), one.id.to_string())
    };
    let expected = [
        line("A. Berg", "baseline_learned", &a),
        line("A. Berg", "baseline_learned", &b),
        line("M. Ito", "baseline_activated", &a),
        line("M. Ito", "baseline_removed", &b),
    ];
    assert_eq!(audit(dir.path()), expected);
    let rows: u32 = Connection::open(dir.path().join(sqlite::FILE))
        .unwrap()
        .query_row("SELECT count(*) FROM baseline_feature WHERE baseline = ?1", [&*b.id], |r| {
            r.get(0)
        })
        .unwrap();
    assert_eq!(rows, 0);
}

#[test]
fn the_description_a_baseline_is_used_with_stays_until_somebody_activates_it_again() {
    let dir = TempDir::new().unwrap();
    let store = SqliteBaselines::open(dir.path()).unwrap();
    let (a, b) = (signed("rig-1", 10.0, 1.0), signed("rig-2", 10.0, 2.0));
    store.learn(&a, &[]).unwrap();
    store.learn(&b, &[]).unwrap();
    let described = || store.described("rig-1").unwrap();
    let id = a.id.to_string();
    assert_eq!(described(), [(id.clone(), None)]);
    store.describe("rig-1", "first").unwrap();
    store.describe("rig-1", "second").unwrap();
    assert_eq!(described(), [(id.clone(), Some("first".to_owned()))]);
    assert_eq!(store.described("rig-2").unwrap()[0].1, None);
    // Twice: one line in the audit; the other machine's is not touched.
    for _ in 0..2 {
        store.retire("rig-1", &[id.clone(), b.id.to_string()], &by("rotorwatch")).unwrap();
    }
    assert!(described().is_empty());
    assert_eq!(store.described("rig-2").unwrap().len(), 1);
    let stale = audit(dir.path()).into_iter().filter(|line| line.1 == "baseline_stale");
    assert_eq!(stale.count(), 1);
    assert!(store.activate(("rig-1", &a.id), &[], &by("M. Ito")).unwrap());
    assert_eq!(described(), [(id, None)], "it holds for what the machine is now");
}

#[test]
fn a_baseline_that_was_changed_by_hand_is_told() {
    let dir = TempDir::new().unwrap();
    let store = SqliteBaselines::open(dir.path()).unwrap();
    for change in [
        "UPDATE baseline SET author = 'somebody'",
        "UPDATE baseline_feature SET log_value = log_value + 1e-9 WHERE feature = 'rms' AND number = 1",
        "UPDATE baseline_record SET load = 1 WHERE number = 0",
        "DELETE FROM baseline_left_out WHERE reason = 'no sensor'",
        "DELETE FROM baseline_record WHERE number = 1",
    ] {
        let one = signed("rig-1", 10.0, 3.0);
        store.learn(&one, &[]).unwrap();
        assert!(store.baselines("rig-1").unwrap()[0].is_intact);
        assert_eq!(active_records(&store, "rig-1").unwrap(), one.records);
        let before = store.version().unwrap();
        Connection::open(dir.path().join(sqlite::FILE)).unwrap().execute_batch(change).unwrap();
        assert!(!store.baselines("rig-1").unwrap()[0].is_intact, "{change}");
        assert!(active_records(&store, "rig-1").unwrap().is_empty(), "and never used");
        assert_ne!(store.version().unwrap(), before, "another's change is seen");
        assert!(store.remove(("rig-1", &one.id), &by("M. Ito")).unwrap());
    }
}

#[test]
fn beside_a_daemon_of_this_version_only_and_seen_by_it() {
    let dir = TempDir::new().unwrap();
    let daemon = sqlite::open(dir.path()).unwrap();
    let of_daemon = SqliteBaselines::join(dir.path()).unwrap();
    let (before, no_act) = (of_daemon.version().unwrap(), of_daemon.newest_act().unwrap());
    let of_command = SqliteBaselines::open(dir.path()).unwrap();
    of_command.learn(&signed("rig-1", 10.0, 1.0), &[]).unwrap();
    assert_ne!(of_daemon.version().unwrap(), before);
    let learned = of_daemon.newest_act().unwrap();
    assert!(learned > no_act);
    assert_eq!(of_daemon.baselines("rig-1").unwrap().len(), 1);
    let (before, other) = (of_daemon.version().unwrap(), signed("rig-1", 20.0, 1.0));
    of_daemon.learn(&other, &[]).unwrap();
    assert_eq!(of_daemon.version().unwrap(), before, "its own act is no news");
    let newest = of_daemon.newest_act().unwrap();
    assert!(newest > learned);
    // What others write beside baselines is no act on one.
    let beside = "INSERT INTO audit (recorded_utc, author, action, machine, comment)
         VALUES (1, 'A. Berg', 'shelved', 'rig-1', '')";
    Connection::open(dir.path().join(sqlite::FILE)).unwrap().execute(beside, ()).unwrap();
    assert_ne!(of_daemon.version().unwrap(), before);
    assert_eq!(of_daemon.newest_act().unwrap(), newest);
    let file = dir.path().join(sqlite::FILE);
    Connection::open(file).unwrap().pragma_update(None, "user_version", 2).unwrap();
    let text = SqliteBaselines::open(dir.path()).unwrap_err().to_string();
    assert!(text.contains("daemon whose schema is 2"), "{text}");
    drop(daemon);
}

#[test]
fn an_act_survives_without_an_end() {
    let (dir, copy) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let store = SqliteBaselines::open(dir.path()).unwrap();
    let one = signed("rig-1", 10.0, 1.0);
    store.learn(&one, &[]).unwrap();
    // What a killed process leaves: the files as they are, nothing closed.
    for entry in fs::read_dir(dir.path()).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
    }
    let store = SqliteBaselines::open(copy.path()).unwrap();
    assert_eq!(store.baselines("rig-1").unwrap()[0].signed, one);
}

/// A database as the program of schema 2 left it, with an act in its audit.
fn of_schema_2(directory: &Path) {
    let file = directory.join(sqlite::FILE);
    let mut connection = Connection::open(&file).unwrap();
    schema::migrate(&mut connection, &file, 2).unwrap();
    connection
        .execute_batch(
            "INSERT INTO audit (recorded_utc, author, action, machine, number, comment)
             VALUES (1, 'A. Berg', 'shelved', 'rig-1', 4, 'oil');
             INSERT INTO configuration (hash, version, since_utc) VALUES ('h', '0.1.0', 1);",
        )
        .unwrap();
}

#[test]
fn the_schema_before_is_brought_up_to_date_and_keeps_what_it_held() {
    let dir = TempDir::new().unwrap();
    of_schema_2(dir.path());
    let (_store, archive) = sqlite::open(dir.path()).unwrap();
    assert_eq!(archive.configurations().unwrap()[0].hash, "h");
    let store = SqliteBaselines::join(dir.path()).unwrap();
    store.learn(&signed("rig-1", 10.0, 1.0), &[]).unwrap();
    let connection = Connection::open(dir.path().join(sqlite::FILE)).unwrap();
    let line: (String, Option<i64>, Option<String>) = connection
        .query_row("SELECT action, number, baseline FROM audit WHERE id = 1", (), |row| {
            Ok((row.get(0)?, row.get(1)?, row.get(2)?))
        })
        .unwrap();
    assert_eq!(line, ("shelved".to_owned(), Some(4), None));
    assert!(schema::backup_of(&dir.path().join(sqlite::FILE), 2).is_file());
}
