//! What HTTP holds of the rest of the daemon: one handle a machine, and one each for what is stored, judged and told.
//!
//! A handle carries interfaces and channels only; how they are kept is the application's affair.

use super::view::MachineView;
use super::view::Measured;
use super::view::RecordingView;
use super::view::ShardBusy;
use super::view::ShardRequest;
use crate::access::Token;
use crate::diagnosis::verdict::Diagnosis;
use crate::ingest::live::Refusal;
use crate::ingest::live::intake::ChannelStatus;
use crate::ingest::simulated;
use crate::machine::Machine;
use crate::notify::Progress;
use crate::signal::Timestamp;
use crate::simulator::scenario::ScenarioError;
use crate::simulator::scenario::Wanted;
use crate::store::Archive;
use crate::store::BaselineStore;
use crate::store::audit::AuditLog;
use crate::store::captures::CaptureIndex;
use crate::store::events::EventLog;
use crate::store::feedback::FeedbackStore;
use crate::store::trends::Holdings;
use crate::store::trends::TrendArchive;
use crate::store::writer::Status;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::oneshot;
use tokio::sync::watch;

/// Baselines as the API sees them.
#[derive(Clone)]
pub struct BaselineHandle {
    /// Where they are kept.
    pub store: Arc<dyn BaselineStore>,
    /// Measures a recording, by name, of a machine.
    pub measure: MeasureRecording,
    /// UTC now.
    pub wall_clock: fn() -> Timestamp,
}

impl std::fmt::Debug for BaselineHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BaselineHandle").finish_non_exhaustive()
    }
}

/// Measures a recording of a machine by its name; or says why it cannot.
pub type MeasureRecording =
    Arc<dyn Fn(&Arc<Machine>, &str) -> Result<Measured, String> + Send + Sync>;

/// What people found of verdicts, as the API sees it.
#[derive(Clone)]
pub struct FeedbackHandle {
    /// Where it is kept.
    pub store: Arc<dyn FeedbackStore>,
    /// UTC now.
    pub wall_clock: fn() -> Timestamp,
}

impl std::fmt::Debug for FeedbackHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FeedbackHandle").finish_non_exhaustive()
    }
}

/// Captures as the API sees them.
#[derive(Clone)]
pub struct CaptureHandle {
    /// What there is.
    pub index: Arc<dyn CaptureIndex>,
    /// Folder of the files.
    pub root: PathBuf,
    /// Judges one again.
    pub judge: JudgeCapture,
}

impl std::fmt::Debug for CaptureHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CaptureHandle").field("root", &self.root).finish_non_exhaustive()
    }
}

/// Judges a capture again, as `rotorwatch diagnose` does; or says why it cannot. Takes seconds.
pub type JudgeCapture = Arc<dyn Fn(&Path) -> Result<JudgedAgain, String> + Send + Sync>;

/// A capture that was judged again.
#[derive(Debug, Clone)]
pub struct JudgedAgain {
    /// Of all of it, as it is found now.
    pub diagnosis: Diagnosis,
    /// The verdict of then on the newest window it keeps, as a document; `None`: it keeps none.
    pub then: Option<String>,
    /// Windows it keeps, and those of them that are the same bit by bit now.
    pub windows: (usize, usize),
    /// Why bits may differ; `None`: the same program on the same processor made it.
    pub made_elsewhere: Option<String>,
}

/// Somebody wants another scenario of a simulated source.
#[derive(Debug)]
pub struct ScenarioRequest {
    /// What shall be damaged; `None`: what is.
    pub wanted: Option<Wanted>,
    /// At which speed the shaft shall turn, Hz; `None`: as it does.
    pub turn_hz: Option<f64>,
    /// Simulated time over which it grows, s.
    pub grow_s: f64,
    /// How the source is doing then, or why not.
    pub reply: oneshot::Sender<Result<Arc<simulated::Status>, ScenarioError>>,
}

/// Why a simulated source did not take a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotTaken {
    /// As many as may be are waiting.
    Busy,
    /// The source has ended.
    Ended,
}

/// A simulated source as the API sees it.
#[derive(Clone)]
pub struct SimulationHandle {
    /// How it is doing.
    pub view: watch::Receiver<Arc<simulated::Status>>,
    /// Asks it for another scenario.
    pub submit: Arc<dyn Fn(ScenarioRequest) -> Result<(), NotTaken> + Send + Sync>,
}

impl std::fmt::Debug for SimulationHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulationHandle").finish_non_exhaustive()
    }
}

/// How the live senders of a machine are doing.
#[derive(Debug, Clone, PartialEq)]
pub struct IngestView {
    /// Senders that are connected.
    pub n_senders: usize,
    /// The channels of the stream, in its order.
    pub channels: Vec<ChannelStatus>,
    /// UTC now.
    pub at: Timestamp,
}

impl IngestView {
    /// Of the clocks of the channels that whose drift is greatest, parts in a million; `None`: too little is known.
    #[must_use]
    pub fn drift_ppm(&self) -> Option<f64> {
        let drifts = self.channels.iter().filter_map(|channel| Some(channel.clock?.ppm));
        drifts.max_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// Of the clocks of the senders how far the one that is off most is behind that of the daemon, s, below 0: ahead; `None`: not
    /// known.
    #[must_use]
    pub fn clock_offset_s(&self) -> Option<f64> {
        let offsets = self.channels.iter().filter_map(|channel| channel.offset_s);
        offsets.max_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// How long before now the newest sample was taken by the clocks of the senders, s, below 0: after it; `None`: no sender
    /// states times.
    #[must_use]
    pub fn sample_age_s(&self) -> Option<f64> {
        let newest = self.channels.iter().filter_map(|channel| channel.stated_until).max()?;
        Some((i128::from(self.at.0) - i128::from(newest.0)) as f64 * 1e-9)
    }
}

/// Tells how the live senders of a machine are doing.
pub type IngestStatus = Arc<dyn Fn() -> IngestView + Send + Sync>;

/// A message of a sender that stands for no frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotUnderstood {
    /// What is wrong with it.
    pub refusal: Refusal,
    /// Samples that it brought, as far as that is known.
    pub n_samples: u64,
}

/// Messages of a sender on a WebSocket, and answers to it; either end may go.
#[derive(Debug)]
pub struct IngestPipe {
    /// What has come, in its order; nothing behind what was not understood.
    pub to_daemon: std::sync::mpsc::SyncSender<Result<Vec<u8>, NotUnderstood>>,
    /// Frames to be sent.
    pub from_daemon: tokio::sync::mpsc::Receiver<Vec<u8>>,
}

/// Lets a sender on a WebSocket in, by the name of where it is and its token, if one is needed; or says why not.
pub type IngestOpen =
    Arc<dyn Fn(String, Option<Arc<Token>>) -> Result<IngestPipe, Refusal> + Send + Sync>;

/// What survives a restart, as the API sees it.
#[derive(Clone)]
pub struct StoreHandle {
    /// Older events.
    pub archive: Arc<dyn Archive>,
    /// How the store is doing.
    pub status: Arc<Status>,
}

impl std::fmt::Debug for StoreHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StoreHandle").field("status", &self.status).finish_non_exhaustive()
    }
}

/// How a receiver of notifications is doing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReceiverView {
    /// Transitions that wait for it.
    pub n_waiting: usize,
    /// What became of the others.
    pub progress: Progress,
    /// Why nothing gets through at the moment.
    pub failure: Option<String>,
    /// When it last took one, UTC, since the start.
    pub last_delivered: Option<Timestamp>,
    /// When the oldest transition that waits was stored, UTC.
    pub waiting_since: Option<Timestamp>,
}

/// A receiver of notifications.
#[derive(Debug, Clone)]
pub struct ReceiverStatus {
    /// Its name.
    pub name: String,
    /// `webhook` or `mqtt`.
    pub kind: &'static str,
    /// How it is doing.
    pub view: watch::Receiver<ReceiverView>,
}

/// The log of what happened, as the API sees it.
#[derive(Clone)]
pub struct EventsHandle {
    /// The log.
    pub log: Arc<dyn EventLog>,
    /// Who did what, and which configurations ran.
    pub audit: Arc<dyn AuditLog>,
    /// Changes when something is stored; ends with the store.
    pub stored: watch::Receiver<u64>,
    /// Streams of events that are open.
    pub open: Gauge,
    /// Streams that were refused because too many were open.
    pub refused: Counter,
    /// Connections cut because their reader took nothing any more.
    pub stalled: Counter,
    /// Who is notified.
    pub receivers: watch::Receiver<Arc<[ReceiverStatus]>>,
}

impl std::fmt::Debug for EventsHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EventsHandle").field("receivers", &self.receivers).finish_non_exhaustive()
    }
}

/// What a part of the store takes on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PartSize {
    /// `alarms`, `trends`, `recordings` or `captures`.
    pub name: &'static str,
    /// Bytes, logs of databases included; `None`: the part is off.
    pub bytes: Option<u64>,
    /// Bytes at which its oldest files are removed; `None`: it has no such limit.
    pub limit_bytes: Option<u64>,
    /// Growth since the first look, bytes a day, without logs and less what was removed; `None`: too short a time.
    pub growth_bytes_per_day: Option<f64>,
    /// Days until the limit is reached if it goes on so, 0 where it is; `None`: unknown, or never.
    pub days_to_limit: Option<f64>,
}

/// What the parts of the store take on the disk, as of the newest look.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StoreSizes {
    /// Time between the first look, at the start of the daemon, and the newest, s.
    pub measured_s: f64,
    /// The parts; none before the first look.
    pub parts: Vec<PartSize>,
    /// Bytes that are free on the disk; `None`: unknown.
    pub free_bytes: Option<u64>,
}

/// The history of trends, as the API sees it.
#[derive(Clone)]
pub struct TrendHandle {
    /// What is stored.
    pub archive: Arc<dyn TrendArchive>,
    /// How storing is doing.
    pub status: Arc<Status>,
    /// What it takes on the disk.
    pub holdings: watch::Receiver<Holdings>,
    /// What all parts of the store take there.
    pub sizes: watch::Receiver<StoreSizes>,
}

impl std::fmt::Debug for TrendHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrendHandle").field("status", &self.status).finish_non_exhaustive()
    }
}

/// Hands a request to a shard.
pub type Submit = Arc<dyn Fn(ShardRequest) -> Result<(), ShardBusy> + Send + Sync>;

/// One machine as the API sees it.
#[derive(Clone)]
pub struct MachineHandle {
    /// Machine id.
    pub id: String,
    /// Newest snapshot.
    pub view: watch::Receiver<Arc<MachineView>>,
    /// What is recorded; `None` if nothing is.
    pub recording: Option<watch::Receiver<RecordingView>>,
    /// The simulated source; `None` for every other.
    pub simulation: Option<SimulationHandle>,
    /// The senders of a live source; `None` for every other.
    pub ingest: Option<IngestStatus>,
    /// Asks the machine's shard.
    pub submit: Submit,
}

impl MachineHandle {
    /// The machine as it is described now.
    #[must_use]
    pub fn machine(&self) -> Arc<Machine> {
        Arc::clone(&self.view.borrow().machine)
    }
}

impl std::fmt::Debug for MachineHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MachineHandle").field("machine", &self.id).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ingest::live::drift::Estimate;
    use crate::ingest::live::ledger::Ledger;
    use crate::signal::ChannelIndex;

    fn view(channels: &[(Option<f64>, Option<i64>)]) -> IngestView {
        let status = |(ppm, until): &(Option<f64>, Option<i64>)| ChannelStatus {
            name: "x".to_owned(),
            channel: ChannelIndex(0),
            ledger: Ledger::default(),
            counted_since: Timestamp(0),
            clock: ppm.map(|ppm| Estimate { ppm, span_s: 60.0 }),
            offset_s: ppm.map(|ppm| -ppm),
            doubt: None,
            stated_until: until.map(Timestamp),
            rate_hz: 1e4,
            sender: None,
        };
        let channels = channels.iter().map(status).collect();
        IngestView { n_senders: 1, channels, at: Timestamp(9_000_000_000) }
    }

    #[test]
    fn of_clocks_the_worst_is_told_and_of_samples_the_newest() {
        let seconds = |s: i64| Some(s * 1_000_000_000);
        let two = view(&[(Some(20.0), seconds(4)), (Some(-35.0), seconds(7)), (None, None)]);
        assert_eq!((two.drift_ppm(), two.clock_offset_s()), (Some(-35.0), Some(35.0)));
        assert!((two.sample_age_s().unwrap() - 2.0).abs() < 1e-9);
        let ahead = view(&[(None, seconds(12))]);
        assert!((ahead.sample_age_s().unwrap() + 3.0).abs() < 1e-9, "its clock is ahead");
        let silent = view(&[(None, None)]);
        assert_eq!((silent.drift_ppm(), silent.sample_age_s()), (None, None));
    }
}
