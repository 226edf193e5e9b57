//! The writer: what waits while the store refuses, who is told, and what is lost.

use super::sqlite::SqliteStore;
use super::tests::batch;
use super::tests::event;
use super::tests::load;
use super::tests::open;
use super::tests::plain;
use super::writer::Job;
use super::writer::Status;
use super::writer::Writer;
use super::*;
use crate::alarms::EventKind;
use std::sync::Arc;
use std::sync::Mutex;
use tempfile::TempDir;

/// Answers of jobs, in the order they came.
type Answers = Arc<Mutex<Vec<Result<(), String>>>>;

fn job(sequence: u64, answers: &Answers) -> Job {
    let answers = Arc::clone(answers);
    let done = move |answer| answers.lock().unwrap().push(answer);
    let batch = batch(vec![event(sequence, EventKind::Raised, &plain(sequence))]);
    Job { batch, done: Some(Box::new(done)) }
}

#[test]
fn a_full_disk_is_told_waited_out_and_recovered_from_without_a_restart() {
    let dir = TempDir::new().unwrap();
    let (store, archive) = open(dir.path());
    // The database may not grow: every commit that needs a page is refused as on a full disk.
    let pages = |n: u32| {
        store
            .connection()
            .query_row(&format!("PRAGMA max_page_count = {n}"), (), |r| r.get::<_, u32>(0))
    };
    let full = pages(1).unwrap();
    let faults = Arc::new(Mutex::new(None));
    let status = Status::default();
    let limited = Limited { store, faults: Arc::clone(&faults), full };
    let mut writer = Writer::new(Box::new(limited), &status);
    let answers = Answers::default();
    let long = "x".repeat(100_000);
    let big = |sequence| {
        let mut job = job(sequence, &answers);
        job.batch.events[0].alarm.why.clone_from(&long);
        job
    };
    assert!(writer.take(vec![big(1)]).is_err());
    let failure = status.failure().unwrap();
    assert!(failure.contains("full"), "{failure}");
    assert_eq!(answers.lock().unwrap().as_slice(), [Err(failure)]);
    assert!(writer.take(vec![big(2)]).is_err());
    assert_eq!((status.n_waiting(), status.n_stored(), status.n_lost()), (2, 0, 0));
    let first = job(1, &answers).batch.now.utc;
    assert_eq!(status.pace().waiting_since, Some(first), "the oldest that waits");
    assert!(load(&archive).history.is_empty());
    *faults.lock().unwrap() = Some(1_000_000);
    writer.flush().unwrap();
    assert_eq!(status.failure(), None);
    assert_eq!(status.pace().waiting_since, None);
    assert_eq!((status.n_waiting(), status.n_stored(), status.n_lost()), (0, 2, 0));
    assert_eq!(load(&archive).last_sequence, 2);
}

/// A store whose size is limited until somebody says otherwise.
struct Limited {
    store: SqliteStore,
    faults: Arc<Mutex<Option<u32>>>,
    full: u32,
}

impl StateStore for Limited {
    fn keep(&mut self, batches: &[Batch]) -> Result<(), StoreError> {
        let limit = self.faults.lock().unwrap().unwrap_or(self.full);
        let pragma = format!("PRAGMA max_page_count = {limit}");
        self.store.connection().query_row(&pragma, (), |row| row.get::<_, u32>(0)).unwrap();
        self.store.keep(batches)
    }

    fn note_configuration(&mut self, entry: &ConfigurationEntry) -> Result<(), StoreError> {
        self.store.note_configuration(entry)
    }
}

/// A store that refuses until somebody says otherwise.
struct Broken {
    works: Arc<Mutex<bool>>,
    kept: Arc<Mutex<Vec<Batch>>>,
}

impl StateStore for Broken {
    fn keep(&mut self, batches: &[Batch]) -> Result<(), StoreError> {
        if *self.works.lock().unwrap() {
            self.kept.lock().unwrap().extend_from_slice(batches);
            return Ok(());
        }
        Err(StoreError::Database { doing: "writing", source: "disk on fire".into() })
    }

    fn note_configuration(&mut self, _: &ConfigurationEntry) -> Result<(), StoreError> {
        Ok(())
    }
}

#[test]
fn what_waits_is_bounded_and_what_is_lost_is_counted() {
    let (works, kept) = (Arc::new(Mutex::new(false)), Arc::new(Mutex::new(Vec::new())));
    let broken = Broken { works: Arc::clone(&works), kept: Arc::clone(&kept) };
    let status = Status::default();
    let mut writer = Writer::new(Box::new(broken), &status).with_max_waiting(3);
    let answers = Answers::default();
    let five = (1..=5).map(|sequence| job(sequence, &answers)).collect();
    assert!(writer.take(five).is_err());
    assert_eq!((status.n_waiting(), status.n_lost()), (3, 2));
    assert_eq!(status.failure().unwrap(), "writing failed: disk on fire");
    *works.lock().unwrap() = true;
    writer.take(vec![job(6, &answers)]).unwrap();
    let sequences: Vec<u64> = kept.lock().unwrap().iter().map(|b| b.events[0].sequence).collect();
    assert_eq!(sequences, [3, 4, 5, 6], "in their order");
    assert_eq!(answers.lock().unwrap().iter().filter(|answer| answer.is_ok()).count(), 1);
    assert_eq!((status.n_waiting(), status.n_lost(), status.n_stored()), (0, 2, 4));
}
