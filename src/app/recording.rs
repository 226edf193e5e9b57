//! A machine's recorder on its source's thread: gives it the clock, logs and shows what it does.

use super::renewal::InForce;
use super::trouble::Troubles;
use crate::api::view::RecordingView;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::capture::recording::file::RecordingHeader;
use crate::capture::recording::machine::Counts;
use crate::capture::recording::machine::Event;
use crate::capture::recording::machine::MachineRecorder;
use crate::capture::recording::store::Store;
use crate::capture::recording::store::StoreEvent;
use crate::capture::writer::CaptureHeader;
use crate::causes::with_causes;
use crate::config::Config;
use crate::ingest::replay::StreamInfo;
use crate::telemetry::RecordingMetrics;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::Mutex;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::watch;

/// Folder of recordings in the store.
pub(super) const FOLDER: &str = "recordings";

/// The recorder of one machine.
#[derive(Debug)]
pub struct Recording {
    machine: String,
    recorder: MachineRecorder,
    started: Instant,
    publisher: watch::Sender<RecordingView>,
    metrics: RecordingMetrics,
    troubles: Troubles,
    /// The settings that hold.
    in_force: watch::Receiver<InForce>,
    /// What the metrics know already.
    told: Counts,
}

/// Where recordings are.
pub(super) fn root(config: &Config) -> PathBuf {
    config.store.directory.join(FOLDER)
}

/// Opens the store of recordings, recovers what was left open in it and says what was found;
/// `None` if nothing is recorded, in which case nothing is removed for the store's limit either.
pub(super) fn open_store(config: &Config) -> Option<Arc<Mutex<Store>>> {
    let limit = config.recording.map_or(u64::MAX, |_| config.bytes_beside_captures());
    let (store, events) = Store::open(&root(config), limit);
    events.iter().for_each(|event| log_store(None, event));
    config.recording.map(|_| Arc::new(Mutex::new(store)))
}

impl Recording {
    /// Makes the recorder of a machine and the receiver of its state; `None` if nothing is
    /// recorded.
    pub(super) fn new(
        in_force: &watch::Receiver<InForce>,
        info: &StreamInfo,
        store: &Arc<Mutex<Store>>,
        (metrics, troubles): (RecordingMetrics, Troubles),
    ) -> Option<(Self, watch::Receiver<RecordingView>)> {
        let (publisher, view) = watch::channel(RecordingView::default());
        let recording = Self::with_view(in_force, info, store, (metrics, publisher, troubles))?;
        Some((recording, view))
    }

    /// Makes a recorder that shows its state where others of the machine did before; `None` if nothing is recorded.
    pub(super) fn with_view(
        in_force: &watch::Receiver<InForce>,
        info: &StreamInfo,
        store: &Arc<Mutex<Store>>,
        (metrics, publisher, troubles): (RecordingMetrics, watch::Sender<RecordingView>, Troubles),
    ) -> Option<Self> {
        let mut in_force = in_force.clone();
        let InForce { config, entry, configuration } = in_force.borrow_and_update().clone();
        let settings = config.recording?;
        let machine = entry.machine.id.clone();
        let header = RecordingHeader {
            capture: CaptureHeader {
                start_time: info.start_time,
                machine: Some(entry.text.0.to_string()),
                shaft_speed: info.shaft_speed,
            },
            configuration: Some(configuration.to_string()),
            evidence: Vec::new(),
        };
        let channels: Vec<ReceivedChannel> = info.received.clone();
        let store = Arc::clone(store);
        let recorder = MachineRecorder::new(&machine, header, channels, settings, store);
        let (started, told) = (super::now(), Counts::default());
        Some(Self { machine, recorder, started, publisher, metrics, troubles, in_force, told })
    }

    /// Records a run. A file that is begun for it says of the machine what holds then.
    pub fn take(&mut self, run: Received) {
        // Closed: the daemon is stopping, and nothing changes any more.
        if self.in_force.has_changed().unwrap_or(false) {
            let InForce { entry, configuration, .. } = &*self.in_force.borrow_and_update();
            self.recorder.renew(entry.text.0.to_string(), configuration.to_string());
        }
        let events = self.recorder.take(run, self.now_s());
        self.tell(&events);
    }

    /// Flushes if it is time to.
    pub fn tick(&mut self) {
        let events = self.recorder.tick(self.now_s());
        self.tell(&events);
    }

    /// When [`Recording::tick`] will have something to do.
    #[must_use]
    pub fn flush_due(&self) -> Option<Instant> {
        let due_s = self.recorder.flush_due_s()?;
        Some(self.started + Duration::try_from_secs_f64(due_s).unwrap_or_default())
    }

    /// Completes the file.
    pub fn finish(mut self) {
        let events = self.recorder.finish(self.now_s());
        self.tell(&events);
    }

    fn now_s(&self) -> f64 {
        super::now().duration_since(self.started).as_secs_f64()
    }

    fn tell(&mut self, events: &[Event]) {
        for event in events {
            self.log(event);
        }
        let counts = self.recorder.counts();
        let (metrics, told) = (&self.metrics, &self.told);
        metrics.recorded.inc_by(counts.n_recorded.saturating_sub(told.n_recorded));
        metrics.lost.inc_by(counts.n_lost.saturating_sub(told.n_lost));
        metrics.failures.inc_by(counts.n_failures - told.n_failures);
        metrics.removed.inc_by(counts.n_removed - told.n_removed);
        metrics.bytes.set(i64::try_from(counts.holdings.bytes).unwrap_or(i64::MAX));
        metrics.files.set(i64::try_from(counts.holdings.n_files).unwrap_or(i64::MAX));
        if counts != *told || !events.is_empty() {
            self.publisher.send_replace(view(&counts));
        }
        // What a failed file took back is not counted down: a counter only rises.
        let n_recorded = counts.n_recorded.max(told.n_recorded);
        self.told = Counts { n_recorded, ..counts };
    }

    fn log(&self, event: &Event) {
        let machine = self.machine.as_str();
        match event {
            Event::Began { file } => {
                tracing::info!(machine, file = %file.display(), "recording");
            }
            Event::Finished { file, n_samples, bytes } => {
                tracing::info!(machine, file = %file.display(), n_samples, bytes, "recorded");
            }
            Event::Failed { error } => {
                let error = with_causes(error);
                tracing::error!(machine, error, "recording failed, another file is tried later");
                let why = format!("raw data of {machine} are not recorded: {error}");
                self.troubles.lost(&format!("recording {machine}"), why, super::now());
            }
            Event::Store(event) => log_store(Some(machine), event),
        }
    }
}

/// What HTTP shows.
fn view(counts: &Counts) -> RecordingView {
    let name =
        |file: &std::path::PathBuf| file.file_name().map(|n| n.to_string_lossy().into_owned());
    RecordingView {
        file: counts.file.as_ref().and_then(name),
        failure: counts.failure.clone(),
        n_files: counts.holdings.n_files,
        bytes: counts.holdings.bytes,
        n_recorded: counts.n_recorded,
        n_lost: counts.n_lost,
        n_failures: counts.n_failures,
        n_removed: counts.n_removed,
    }
}

fn log_store(machine: Option<&str>, event: &StoreEvent) {
    match event {
        StoreEvent::Recovered { file, samples } => {
            let n_samples: u64 = samples.iter().map(|(_, n)| n).sum();
            let by_channel: Vec<_> =
                samples.iter().map(|(name, n)| format!("{name} {n}")).collect();
            let (file, by_channel) = (file.display(), by_channel.join(", "));
            tracing::warn!(%file, n_samples, by_channel, "recording left open was recovered");
        }
        StoreEvent::Damaged { file, aside, error } => {
            let (file, aside, error) = (file.display(), aside.display(), with_causes(error));
            tracing::error!(%file, %aside, error, "recording cannot be recovered, put aside");
        }
        StoreEvent::TemporaryRemoved { file } => {
            tracing::warn!(file = %file.display(), "file that was never complete removed");
        }
        StoreEvent::Removed { file, bytes } => {
            let file = file.display();
            tracing::info!(machine, %file, bytes, "oldest recording removed, store is full");
        }
        StoreEvent::Unusable { place, error } => {
            tracing::error!(machine, place = %place.display(), %error, "store cannot be used");
        }
    }
}
