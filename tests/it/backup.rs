//! A backup of the state while operators act, as docs/operating.md says, and the daemon in its place.

use crate::notify::alarms;
use crate::notify::folder;
use crate::notify::history;
use crate::notify::operate;
use crate::support::Daemon;
use rusqlite::Connection;
use serde_json::json;
use std::fs;
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
