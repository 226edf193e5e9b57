//! The thread that writes captures.
//!
//! A capture is in the index before its file is named, and its file has its name at the first flush; so after a kill
//! each is listed, with what had reached the disk.

use super::FOR_NEWER;
use super::FOR_ROOM;
use super::Job;
use super::Order;
use super::id_of;
use super::log;
use super::note_removed;
use crate::app::Clock;
use crate::app::room::CapturesGiveWay;
use crate::app::trouble::Troubles;
use crate::capture::received::Received;
use crate::capture::recording::file::RecordingHeader;
use crate::capture::recording::store::Store;
use crate::capture::recording::store::StoreEvent;
use crate::capture::recording::triggered::Next;
use crate::capture::recording::triggered::Plan;
use crate::capture::recording::triggered::Triggered;
use crate::causes::with_causes;
use crate::evidence;
use crate::evidence::kept;
use crate::pipeline::Run;
use crate::store::captures::CaptureEntry;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureState;
use crate::store::captures::Ending;
use crate::telemetry::CaptureMetrics;
use crate::telemetry::RoomMetrics;
use std::collections::BTreeMap;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;
use std::time::Instant;
use toml::Table;
use toml::Value;

/// Captures open at once, all machines together.
const MAX_OPEN: usize = 64;

/// Longest time between two flushes.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// The thread before it starts.
pub(in crate::app) struct CapturesPlan {
    pub(super) jobs: mpsc::Receiver<Job>,
    pub(super) waiting: Arc<AtomicUsize>,
    pub(super) index: Arc<dyn CaptureIndex>,
    pub(super) store: Store,
    pub(super) metrics: CaptureMetrics,
    pub(super) room: RoomMetrics,
    pub(super) troubles: Troubles,
    pub(super) give_way: Arc<CapturesGiveWay>,
    /// How long a capture may get nothing before it is closed.
    pub(super) idle: Duration,
}

impl std::fmt::Debug for CapturesPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CapturesPlan").finish_non_exhaustive()
    }
}

/// What a capture says of itself.
fn about(mut about: Table, configuration: &str) -> Table {
    let facts = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("processor", evidence::processor()),
        ("configuration", configuration.to_owned()),
    ];
    about.extend(facts.map(|(key, text)| (key.to_owned(), Value::String(text))));
    about
}

/// Stream time one past a run, s.
fn end_s(run: &Received, rates_hz: &[f64]) -> f64 {
    let rate_hz = rates_hz.get(run.channel.0).copied().unwrap_or(f64::INFINITY);
    run.time_s + run.raw.len() as f64 / rate_hz
}

/// A capture being written.
struct Open {
    id: String,
    file: PathBuf,
    capture: Triggered,
    rates_hz: Vec<f64>,
    ends_s: f64,
    /// Stream time of the newest sample written, s.
    to_s: f64,
    flushed: Instant,
    /// When it got something last.
    fed: Instant,
    note: Option<String>,
}

impl CapturesPlan {
    /// Writes until every sender is gone and everything is written.
    pub(in crate::app) fn run(mut self, clock: Clock) {
        let mut open: BTreeMap<u64, Open> = BTreeMap::new();
        self.show();
        loop {
            match self.jobs.recv_timeout(FLUSH_EVERY) {
                Ok(job) => self.take(job, &mut open, clock),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let now = crate::app::now();
            let is_due = |open: &Open| now.saturating_duration_since(open.flushed) >= FLUSH_EVERY;
            let due: Vec<u64> =
                open.iter().filter(|(_, o)| is_due(o)).map(|(key, _)| *key).collect();
            for key in due {
                self.flush(key, &mut open);
            }
            self.close_idle(&mut open, now);
            self.give_way();
        }
        for (_, mut left) in open {
            left.note.get_or_insert_with(|| "the program ended before it was complete".to_owned());
            self.close(left);
        }
    }

    /// Closes what gets nothing any more and was not ended.
    fn close_idle(&mut self, open: &mut BTreeMap<u64, Open>, now: Instant) {
        let idle = self.idle;
        let is_idle = |open: &Open| now.saturating_duration_since(open.fed) >= idle;
        let keys: Vec<u64> = open.iter().filter(|(_, o)| is_idle(o)).map(|(key, _)| *key).collect();
        for mut left in keys.iter().filter_map(|key| open.remove(key)).collect::<Vec<Open>>() {
            left.note = Some(format!("nothing came for it for {} s", idle.as_secs()));
            self.close(left);
        }
    }

    /// Removes the oldest capture if the disk has no room.
    fn give_way(&mut self) {
        self.give_way.set_finished(self.store.n_finished());
        if !self.give_way.take() {
            return;
        }
        if let Some(event) = self.store.give_way() {
            log(&event);
            if matches!(event, StoreEvent::Removed { .. }) {
                self.room.captures.inc();
            }
            note_removed(&*self.index, &event, FOR_ROOM);
        }
        self.give_way.set_finished(self.store.n_finished());
        self.show();
    }

    /// Counts and tells what could not be made whole.
    fn note_failed(&self, why: &str) {
        self.metrics.failed.inc();
        let why = format!("a capture of an alarm is not whole: {why}");
        self.troubles.lost("captures", why, crate::app::now());
    }

    fn take(&mut self, job: Job, open: &mut BTreeMap<u64, Open>, clock: Clock) {
        match job {
            Job::Begin(key, order) => {
                let bytes = order.runs.iter().map(|run| run.bytes()).sum();
                if let Some(begun) = self.begin(*order, open.len()) {
                    open.insert(key, begun);
                }
                self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            }
            Job::GoOn(key, run) => {
                let bytes = run.bytes();
                self.go_on(key, &run, open);
                self.waiting.fetch_sub(bytes, Ordering::Relaxed);
            }
            Job::CutShort(key) => {
                if let Some(mut cut) = open.remove(&key) {
                    cut.note = Some("it ends early: the disk did not keep up".to_owned());
                    self.close(cut);
                }
            }
            Job::End(key, note) => {
                if let Some(mut done) = open.remove(&key) {
                    done.note = note.or(done.note);
                    self.close(done);
                }
            }
            Job::Refuse { machine, alarms, why } => {
                self.metrics.refused.inc();
                let at = clock.moment(0.0).utc;
                if let Err(error) = self.index.refuse(&machine, &alarms, &why, at) {
                    tracing::error!(
                        error = with_causes(&error),
                        "why an alarm has no capture is not stored"
                    );
                }
            }
        }
    }

    /// Begins a capture and answers who asked for it.
    fn begin(&mut self, mut order: Order, n_open: usize) -> Option<Open> {
        let (machine, alarms, at) = (order.machine.clone(), order.alarms.clone(), order.requested);
        let reply = order.reply.take();
        let begun = if n_open < MAX_OPEN {
            self.try_begin(order)
        } else {
            Err(format!("{MAX_OPEN} captures are being written"))
        };
        let answer = begun.as_ref().map(|open| open.id.clone()).map_err(Clone::clone);
        if let Some(reply) = reply {
            // Who asked may have gone: then the answer is dropped.
            drop(reply.send(answer));
        }
        begun
            .map_err(|why| {
                tracing::error!(machine, why, "a capture cannot be made");
                self.note_failed(&why);
                if let Err(error) = self.index.refuse(&machine, &alarms, &why, at) {
                    tracing::error!(
                        error = with_causes(&error),
                        "why an alarm has no capture is not stored"
                    );
                }
            })
            .ok()
    }

    fn try_begin(&mut self, order: Order) -> Result<Open, String> {
        let received = &order.judged.received;
        let plan = Plan::new(&order.runs, received, order.from_s)
            .ok_or("no raw data of the time before the alarm are held")?;
        let place = |channel: usize, segment: u32, run: &Run| {
            plan.place(channel, segment, run.start, run.n_samples as u64)
        };
        let windows = kept::placed(&order.windows, &place);
        let about = about(order.about, &order.configuration);
        let evidence = kept::lists(&about, &order.judged, windows, &place);
        let n_windows = windows.len() as u64;
        let used = self.index.highest(&order.machine).map_err(|error| with_causes(&error))?;
        let next = self.store.next_file_after(&order.machine, used);
        let (number, file) = next.map_err(|error| format!("its folder cannot be used: {error}"))?;
        let entry = CaptureEntry {
            id: id_of(&file),
            machine: order.machine,
            number,
            by: order.by,
            requested: order.requested,
            start: order.header.start_time,
            trigger_s: order.trigger_s,
            span_s: (Some(plan.begins_s()), None),
            state: CaptureState::Writing,
            note: None,
            bytes: 0,
            n_windows,
            alarms: order.alarms,
        };
        self.index.begin(&entry).map_err(|error| with_causes(&error))?;
        let header = RecordingHeader {
            capture: order.header,
            configuration: Some(order.configuration),
            evidence,
        };
        let rates_hz: Vec<f64> = received.iter().map(|channel| channel.sample_rate.0).collect();
        let ends = order.runs.iter().map(|run| end_s(run, &rates_hz));
        let to_s = ends.fold(plan.begins_s(), f64::max);
        match plan.create(&file, &header, received) {
            Ok(capture) => {
                let bytes = capture.bytes();
                tracing::info!(machine = entry.machine, file = %file.display(), n_windows, "capture begun");
                self.metrics.taken.inc();
                let now = crate::app::now();
                let open = Open {
                    id: entry.id,
                    file,
                    capture,
                    rates_hz,
                    ends_s: order.ends_s,
                    to_s,
                    flushed: now,
                    fed: now,
                    note: None,
                };
                self.note_growing(&open.file, bytes);
                Ok(open)
            }
            Err(error) => {
                let why = with_causes(&error);
                self.note_end(&entry.id, CaptureState::Failed, Some(why.clone()), Some(0), None);
                Err(why)
            }
        }
    }

    fn go_on(&mut self, key: u64, run: &Arc<Received>, open: &mut BTreeMap<u64, Open>) {
        let Some(goes_on) = open.get_mut(&key) else { return };
        goes_on.fed = crate::app::now();
        if run.time_s >= goes_on.ends_s {
            return;
        }
        let end_s = end_s(run, &goes_on.rates_hz);
        match goes_on.capture.take(Received::clone(run)) {
            Ok(Next::GoesOn) => goes_on.to_s = goes_on.to_s.max(end_s),
            Ok(Next::Ends) => {
                if let Some(mut done) = open.remove(&key) {
                    done.note = Some("it ends where samples were lost".to_owned());
                    self.close(done);
                }
            }
            Err(error) => self.give_up(key, &with_causes(&error), open),
        }
    }

    fn flush(&mut self, key: u64, open: &mut BTreeMap<u64, Open>) {
        let Some(due) = open.get_mut(&key) else { return };
        due.flushed = crate::app::now();
        match due.capture.flush() {
            Ok(()) => {
                let (file, bytes) = (due.file.clone(), due.capture.bytes());
                self.note_growing(&file, bytes);
            }
            Err(error) => self.give_up(key, &with_causes(&error), open),
        }
    }

    /// What was flushed is kept; the next start makes it whole.
    fn give_up(&mut self, key: u64, why: &str, open: &mut BTreeMap<u64, Open>) {
        let Some(failed) = open.remove(&key) else { return };
        tracing::error!(file = %failed.file.display(), why, "a capture is cut off");
        self.note_failed(why);
        let (id, file, to_s) = (failed.id.clone(), failed.file.clone(), failed.to_s);
        drop(failed);
        self.store.forget(&file);
        let is_whole = crate::capture::recording::repair::repair(&file).is_ok();
        let is_kept = is_whole && self.store.note_finished(&file).is_ok();
        let state = if is_kept { CaptureState::Recovered } else { CaptureState::Failed };
        let bytes = file.metadata().map_or(0, |found| found.len());
        self.note_end(&id, state, Some(format!("it was cut off: {why}")), Some(bytes), Some(to_s));
    }

    fn close(&mut self, done: Open) {
        let Open { id, file, capture, to_s, note, .. } = done;
        match capture.close() {
            Ok(finished) => {
                self.note_growing(&file, finished.bytes);
                if let Err(error) = self.store.note_finished(&file) {
                    tracing::error!(%error, file = %file.display(), "a capture is gone");
                }
                tracing::info!(file = %file.display(), bytes = finished.bytes, "capture complete");
                let bytes = Some(finished.bytes);
                self.note_end(&id, CaptureState::Complete, note, bytes, Some(to_s));
            }
            Err(error) => {
                let why = with_causes(&error);
                tracing::error!(file = %file.display(), why, "a capture cannot be completed");
                self.note_failed(&why);
                self.store.forget(&file);
                let state = CaptureState::Failed;
                self.note_end(&id, state, Some(why), None, Some(to_s));
            }
        }
        self.show();
    }

    fn note_growing(&mut self, file: &Path, bytes: u64) {
        for event in self.store.note_growing(file, bytes) {
            log(&event);
            if matches!(event, StoreEvent::Removed { .. }) {
                self.metrics.removed.inc();
            }
            note_removed(&*self.index, &event, FOR_NEWER);
        }
        self.show();
    }

    fn note_end(
        &self,
        id: &str,
        state: CaptureState,
        note: Option<String>,
        bytes: Option<u64>,
        to_s: Option<f64>,
    ) {
        if let Err(error) = self.index.end(id, &Ending { state, note, bytes, to_s }) {
            tracing::error!(error = with_causes(&error), id, "the index of captures is behind");
        }
    }

    fn show(&self) {
        self.metrics.bytes.set(i64::try_from(self.store.bytes()).unwrap_or(i64::MAX));
    }
}
