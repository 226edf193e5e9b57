//! The recordings of one machine: one file after another, and what to do when the disk refuses.
//!
//! Whatever fails, the caller goes on: samples that cannot be recorded are counted, the failure is
//! told, and after a pause another file is tried.

use super::super::error::CaptureError;
use super::super::received::{Received, ReceivedChannel};
use super::align::{Act, Aligner};
use super::file::{Recorder, RecordingHeader};
use super::repair;
use super::store::{Holdings, Store, StoreEvent};
use crate::causes::with_causes;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Pause after a failure, s.
pub const RETRY_S: f64 = 10.0;

/// How recordings are cut and stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Longest file, s of stream time.
    pub segment_s: f64,
    /// Largest file, bytes; it ends at the next second after.
    pub segment_bytes: u64,
    /// Longest time between two flushes, s of the caller's clock.
    pub flush_s: f64,
    /// gzip level 1 to 9; `None` stores samples as they are.
    pub gzip: Option<u32>,
}

/// What happened.
#[derive(Debug)]
pub enum Event {
    /// A file was begun.
    Began {
        /// The file.
        file: PathBuf,
    },
    /// A file was completed.
    Finished {
        /// The file.
        file: PathBuf,
        /// Samples of all channels.
        n_samples: u64,
        /// Its length.
        bytes: u64,
    },
    /// The disk or the library refused; what was flushed is kept.
    Failed {
        /// Why.
        error: CaptureError,
    },
    /// Something about the store.
    Store(StoreEvent),
}

/// What was done so far.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Counts {
    /// Samples handed to files.
    pub n_recorded: u64,
    /// Samples that were received and are in no file.
    pub n_lost: u64,
    /// Failures.
    pub n_failures: u64,
    /// Finished recordings removed for the limit, of whatever machine.
    pub n_removed: u64,
    /// Files and bytes there are.
    pub holdings: Holdings,
    /// The file being written.
    pub file: Option<PathBuf>,
    /// Why nothing is recorded at the moment.
    pub failure: Option<String>,
}

/// A machine being recorded.
#[derive(Debug)]
pub struct MachineRecorder {
    machine: String,
    header: RecordingHeader,
    channels: Vec<ReceivedChannel>,
    settings: Settings,
    store: Arc<Mutex<Store>>,
    aligner: Aligner,
    file: Option<Recorder>,
    /// Stream time at which the file shall end, s.
    file_ends_s: f64,
    /// Whether another file was asked for already.
    rolls: bool,
    flushed_at_s: f64,
    /// Samples of the file that a kill cannot take.
    n_flushed: u64,
    retry_at_s: f64,
    counts: Counts,
}

impl MachineRecorder {
    /// Makes it; the first file is begun with the first samples.
    #[must_use]
    pub fn new(
        machine: &str,
        header: RecordingHeader,
        channels: Vec<ReceivedChannel>,
        settings: Settings,
        store: Arc<Mutex<Store>>,
    ) -> Self {
        let rates_hz = channels.iter().map(|channel| channel.sample_rate.0).collect();
        Self {
            machine: machine.to_owned(),
            header,
            channels,
            settings,
            store,
            aligner: Aligner::new(rates_hz),
            file: None,
            file_ends_s: f64::INFINITY,
            rolls: false,
            flushed_at_s: 0.0,
            n_flushed: 0,
            retry_at_s: 0.0,
            counts: Counts::default(),
        }
    }

    /// Files that are begun from now on say this of the machine and of the configuration; the one that is open keeps what it
    /// says.
    pub fn renew(&mut self, machine: String, configuration: String) {
        self.header.capture.machine = Some(machine);
        self.header.configuration = Some(configuration);
    }

    /// What was done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let holdings = self.store().holdings(&self.machine);
        Counts { holdings, ..self.counts.clone() }
    }

    /// Records a run; `now_s` counts from any fixed moment.
    pub fn take(&mut self, run: Received, now_s: f64) -> Vec<Event> {
        let mut events = Vec::new();
        let ends_s = run.time_s
            + run.raw.len() as f64
                / self.channels.get(run.channel.0).map_or(1.0, |channel| channel.sample_rate.0);
        let wants_file = self.file.is_none() && now_s >= self.retry_at_s;
        if !self.rolls && (ends_s > self.file_ends_s || wants_file && self.counts.n_failures > 0) {
            self.aligner.roll();
            self.rolls = true;
        }
        for act in self.aligner.take(run) {
            self.act(act, now_s, &mut events);
        }
        events.extend(self.tick(now_s));
        events
    }

    /// Flushes if it is time to.
    pub fn tick(&mut self, now_s: f64) -> Vec<Event> {
        let mut events = Vec::new();
        if self.flush_due_s().is_some_and(|due_s| now_s >= due_s) {
            self.flush(now_s, &mut events);
        }
        events
    }

    /// When [`MachineRecorder::tick`] will have something to do; `None`: not before the next run.
    #[must_use]
    pub fn flush_due_s(&self) -> Option<f64> {
        self.file.as_ref().map(|_| self.flushed_at_s + self.settings.flush_s)
    }

    /// Completes the last file; nothing more will come.
    pub fn finish(&mut self, now_s: f64) -> Vec<Event> {
        let mut events = Vec::new();
        for act in self.aligner.finish() {
            self.act(act, now_s, &mut events);
        }
        self.close(now_s, &mut events);
        events
    }

    fn act(&mut self, act: Act, now_s: f64, events: &mut Vec<Event>) {
        match act {
            Act::Begin { joins, starts, time_s } => {
                self.begin(joins, &starts, time_s, now_s, events);
            }
            Act::Skip { n_samples } => self.counts.n_lost += n_samples,
            Act::Write(run) => {
                let n_samples = run.raw.len() as u64;
                match self.file.as_mut().map(|file| file.write(&run)) {
                    Some(Ok(())) => self.counts.n_recorded += n_samples,
                    Some(Err(error)) => {
                        self.counts.n_lost += n_samples;
                        self.fail(error, now_s, events);
                    }
                    None => self.counts.n_lost += n_samples,
                }
            }
        }
    }

    /// Begins a stretch in the file there is, or in a new one.
    fn begin(
        &mut self,
        joins: bool,
        starts: &[Option<u64>],
        time_s: f64,
        now_s: f64,
        events: &mut Vec<Event>,
    ) {
        if joins && let Some(file) = &mut self.file {
            match file.begin(starts, time_s) {
                Ok(true) => return,
                Ok(false) => {}
                Err(error) => return self.fail(error, now_s, events),
            }
        }
        self.close(now_s, events);
        self.rolls = false;
        if now_s < self.retry_at_s {
            return;
        }
        match self.open(starts, time_s) {
            Ok(file) => {
                self.counts.failure = None;
                self.counts.file = Some(file.path().to_owned());
                self.file_ends_s = time_s + self.settings.segment_s;
                (self.flushed_at_s, self.n_flushed) = (now_s, 0);
                events.push(Event::Began { file: file.path().to_owned() });
                self.file = Some(file);
            }
            Err(error) => self.fail(error, now_s, events),
        }
    }

    fn open(&self, starts: &[Option<u64>], time_s: f64) -> Result<Recorder, CaptureError> {
        let path = self.store().next_file(&self.machine).map_err(|source| CaptureError::Io {
            file: PathBuf::from(&self.machine),
            action: "make a folder for its recordings",
            source,
        })?;
        let (header, gzip) = (&self.header, self.settings.gzip);
        let mut file = Recorder::create(&path, header, &self.channels, gzip)?;
        file.begin(starts, time_s)?;
        Ok(file)
    }

    fn flush(&mut self, now_s: f64, events: &mut Vec<Event>) {
        let Some(file) = &mut self.file else { return };
        self.flushed_at_s = now_s;
        if let Err(error) = file.flush() {
            return self.fail(error, now_s, events);
        }
        self.n_flushed = file.n_stored();
        let (path, bytes, is_full) = (file.path().to_owned(), file.bytes(), file.is_full());
        if (bytes >= self.settings.segment_bytes || is_full) && !self.rolls {
            self.aligner.roll();
            self.rolls = true;
        }
        let done = self.store().note_growing(&path, bytes);
        self.note(done, events);
    }

    fn close(&mut self, now_s: f64, events: &mut Vec<Event>) {
        let Some(file) = self.file.take() else { return };
        let (path, n_samples) = (file.path().to_owned(), file.n_samples());
        (self.counts.file, self.file_ends_s) = (None, f64::INFINITY);
        match file.close() {
            Ok(finished) => {
                let Some(file) = finished.file else { return self.store().forget(&path) };
                let (n_samples, bytes) = (finished.n_samples, finished.bytes);
                let mut done = self.store().note_growing(&file, bytes);
                if let Err(error) = self.store().note_finished(&file) {
                    done.push(StoreEvent::Unusable { place: file.clone(), error });
                }
                events.push(Event::Finished { file, n_samples, bytes });
                self.note(done, events);
            }
            Err(error) => {
                self.lose(n_samples);
                self.fail_at(&path, error, now_s, events);
            }
        }
    }

    /// Counts as lost what a file took and did not flush.
    fn lose(&mut self, n_taken: u64) {
        let n_lost = n_taken.saturating_sub(self.n_flushed);
        self.counts.n_recorded = self.counts.n_recorded.saturating_sub(n_lost);
        self.counts.n_lost += n_lost;
    }

    /// Gives the file up: what was flushed stays, and a new file is tried after a pause.
    fn fail(&mut self, error: CaptureError, now_s: f64, events: &mut Vec<Event>) {
        let file = self.file.take().map(|file| (file.path().to_owned(), file.n_samples()));
        let (path, n_taken) = file.unwrap_or_default();
        self.lose(n_taken);
        self.fail_at(&path, error, now_s, events);
    }

    fn fail_at(
        &mut self,
        path: &std::path::Path,
        error: CaptureError,
        now_s: f64,
        events: &mut Vec<Event>,
    ) {
        (self.counts.file, self.file_ends_s, self.rolls) = (None, f64::INFINITY, false);
        self.counts.n_failures += 1;
        self.counts.failure = Some(with_causes(&error));
        self.retry_at_s = now_s + RETRY_S;
        events.push(Event::Failed { error });
        let mut store = self.store();
        store.forget(path);
        // Whatever cannot be closed now is looked at again at the next start.
        if path.is_file() && repair::repair(path).is_ok() {
            let _counted_at_the_next_start = store.note_finished(path);
        }
    }

    fn note(&mut self, done: Vec<StoreEvent>, events: &mut Vec<Event>) {
        let removed = done.iter().filter(|event| matches!(event, StoreEvent::Removed { .. }));
        self.counts.n_removed += removed.count() as u64;
        events.extend(done.into_iter().map(Event::Store));
    }

    fn store(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
