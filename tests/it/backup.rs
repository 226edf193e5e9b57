//! A backup of the state while operators act, as docs/operating.md says, and the daemon in its place.

use crate::notify::alarms;
use crate::notify::folder;
use crate::notify::history;
use crate::notify::operate;
use crate::reload;
use crate::support;
use crate::support::Daemon;
use crate::support::Ended;
use rusqlite::Connection;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering;
use std::thread;
use tempfile::TempDir;

/// Backups made one after the other, so that commits come before, during and after them.
const N_BACKUPS: u64 = 5;

#[test]
fn a_backup_made_while_acts_are_stored_is_whole_and_goes_on_from_there() {
    let mut daemon = Daemon::start_in(folder(&[]));
    let standing = alarms(&daemon);
    let elsewhere = TempDir::new().unwrap();
    let backup = |n: u64| elsewhere.path().join(format!("backup-{n}.db"));
    let n_answers = AtomicU64::new(0);
    let mut answered_before = Vec::new();
    thread::scope(|scope| {
        for (id, state) in &standing {
            let (url, n_answers) = (&daemon.base_url, &n_answers);
            scope.spawn(move || operate(url, id, state.clone(), n_answers));
        }
        for n in 0..N_BACKUPS {
            // Something has happened since the one before.
            let before = n_answers.load(Ordering::SeqCst);
            while n_answers.load(Ordering::SeqCst) < before + 4 {
                thread::yield_now();
            }
            answered_before.push(n_answers.load(Ordering::SeqCst));
            let state = Connection::open(daemon.dir.path().join("data/state.db")).unwrap();
            let file = backup(n).to_string_lossy().into_owned();
            state.execute("VACUUM INTO ?1", [file]).unwrap();
        }
        daemon.signal("KILL");
    });
    daemon.child.wait().unwrap();
    for (n, answered) in (0..N_BACKUPS).zip(answered_before) {
        let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
        let data = dir.path().join("data");
        for gone in ["state.db", "state.db-wal", "state.db-shm"] {
            let _not_there = fs::remove_file(data.join(gone));
        }
        fs::copy(backup(n), data.join("state.db")).unwrap();
        daemon = Daemon::start_in(dir);
        // The raising of each alarm, and every act that was answered before the backup began.
        let told = history(&daemon);
        let expected: Vec<String> = (1..=told.len()).map(|n| format!("rig-1#{n}")).collect();
        assert_eq!(told, expected, "no hole, nothing twice");
        assert!(told.len() as u64 >= answered + standing.len() as u64, "{} {answered}", told.len());
        let again = alarms(&daemon);
        assert!(standing.keys().eq(again.keys()), "{again:?}");
        let id = standing.keys().next().unwrap();
        let body = json!({ "author": "M. Ito", "comment": "after the restore" });
        let (status, _) = daemon.post_json(&format!("/api/v1/alarms/{id}/out-of-service"), &body);
        assert_eq!(status, 200);
        assert_eq!(history(&daemon).len(), told.len() + 1);
        daemon.signal("KILL");
        daemon.child.wait().unwrap();
    }
}

fn backup(config: &Path, out: &Path) -> Ended {
    let mut command = support::command();
    command.args(["backup", "--captures", "--config"]).arg(config).arg("--out").arg(out);
    support::run(&mut command)
}

fn restore(archive: &Path, store: &Path, more: &[&str]) -> Ended {
    let mut command = support::command();
    command.arg("restore").arg(archive).arg("--store").arg(store).args(more);
    support::run(&mut command)
}

#[test]
fn a_store_is_backed_up_while_it_is_in_use_and_restored_as_a_whole_or_not_at_all() {
    let daemon = reload::start();
    reload::change(&daemon, "rig.toml", &reload::limit(0.1));
    let raised = support::wait_until("the alarm", || reload::alarm(&daemon));
    let path = format!("/api/v1/alarms/{}/ack", raised["id"].as_str().unwrap());
    assert_eq!(daemon.post_json(&path, &json!({ "author": "M. Ito", "comment": "seen" })).0, 200);
    let capture = support::wait_until("the capture", || {
        let (_, list) = daemon.get_json("/api/v1/captures?machine=rig-1");
        let item = list["items"][0].clone();
        (item["state"] == "complete").then_some(item)
    });
    let elsewhere = TempDir::new().unwrap();
    let archive = elsewhere.path().join("monday.tar.gz");
    let config = daemon.dir.path().join("serve.toml");
    let made = backup(&config, &archive);
    assert_eq!(made.status.code(), Some(0), "{}", made.stderr);
    let again = backup(&config, &archive);
    assert!(again.stderr.contains("nothing is written over"), "{}", again.stderr);
    // Never under a running daemon, and nothing that is there without the word.
    let in_use = daemon.dir.path().join("data");
    let refused = restore(&archive, &in_use, &["--force"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(refused.stderr.contains("in use by another process"), "{}", refused.stderr);
    let acknowledged = reload::alarm(&daemon).unwrap();
    assert_eq!(acknowledged["state"], "acknowledged");
    assert_eq!(daemon.terminate().status.code(), Some(0));

    let to = TempDir::new().unwrap();
    let (store, folder) = (to.path().join("data"), to.path().to_string_lossy().into_owned());
    fs::create_dir(&store).unwrap();
    fs::write(store.join("other"), "kept").unwrap();
    let refused = restore(&archive, &store, &[]);
    assert!(refused.stderr.contains("--force"), "{}", refused.stderr);
    // A byte that is another one, or an end that is missing: nothing changes.
    let whole = fs::read(&archive).unwrap();
    let bad = elsewhere.path().join("bad.tar.gz");
    for damaged in [&whole[..whole.len() / 2], &flipped(&whole)[..], b"no archive"] {
        fs::write(&bad, damaged).unwrap();
        let refused = restore(&bad, &store, &["--force", "--config-dir", &folder]);
        assert_eq!(refused.status.code(), Some(2), "{}", refused.stdout);
        assert!(refused.stderr.contains("bad.tar.gz"), "{}", refused.stderr);
        assert_eq!(fs::read_to_string(store.join("other")).unwrap(), "kept");
        assert!(!to.path().join("serve.toml").exists());
    }
    let done = restore(&archive, &store, &["--force", "--config-dir", &folder]);
    assert_eq!(done.status.code(), Some(0), "{}", done.stderr);
    let aside = done.stdout.lines().find_map(|line| line.strip_prefix("put aside: ")).unwrap();
    assert_eq!(fs::read_to_string(Path::new(aside).join("other")).unwrap(), "kept");
    support::write_ramp(&to, "x.h5", 1000.0, 3000);
    let daemon = Daemon::start_in(to);
    assert_eq!(reload::alarm(&daemon).unwrap()["acknowledged"], acknowledged["acknowledged"]);
    let id = capture["id"].as_str().unwrap();
    let (status, _, bytes) = daemon.get_binary(&format!("/api/v1/captures/{id}"), &[]);
    assert_eq!((status, bytes.len() as u64), (200, capture["bytes"].as_u64().unwrap()));
}

/// With one bit of its middle turned.
fn flipped(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    bytes
}
