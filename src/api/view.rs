//! What the daemon's shards show to HTTP, and what HTTP may ask of them.
//!
//! A shard publishes an immutable [`MachineView`] at each hop; anything larger is asked for by a
//! [`ShardRequest`] with a one-shot reply, served between blocks.

use crate::access::Token;
use crate::alarms::Act;
use crate::alarms::ActionError;
use crate::alarms::Advance;
use crate::alarms::AdvanceError;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::Announcement;
use crate::alarms::load::Load;
use crate::buffer::RingStatus;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::ingest::live::Refusal;
use crate::ingest::live::intake::ChannelStatus;
use crate::ingest::simulated;
use crate::machine::Machine;
use crate::notify::Progress;
use crate::signal::ChannelInfo;
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

/// How a source of samples is doing.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceState {
    /// Not opened yet.
    Starting,
    /// Delivering samples.
    Running,
    /// Came to its end (a finished replay).
    Finished,
    /// Gave up, with the reason.
    Failed(String),
}

/// Immutable snapshot of one machine.
#[derive(Debug, Clone)]
pub struct MachineView {
    /// The machine as it is described now.
    pub machine: Arc<Machine>,
    /// Hash of the configuration by which the newest verdict was judged.
    pub judged_by: Arc<str>,
    /// The source.
    pub source: SourceState,
    /// Stream time of the newest sample judged or received, s.
    pub stream_time_s: f64,
    /// UTC of stream time 0; `None`: unknown, times are counted from 1970-01-01.
    pub start_time: Option<Timestamp>,
    /// Channels of the stream; empty until the source opened.
    pub channels: Arc<Vec<ChannelInfo>>,
    /// State of the rings, one a channel.
    pub rings: Vec<RingStatus>,
    /// Newest verdict.
    pub diagnosis: Option<Arc<Diagnosis>>,
    /// Stream time since which each component (same order as in the diagnosis) and the machine
    /// (last) has its state, s.
    pub state_since_s: Vec<f64>,
    /// Newest features.
    pub features: Arc<Vec<ChannelFeatures>>,
    /// All alarms that are not over, newest first.
    pub alarms: Arc<Vec<Alarm>>,
    /// Silences in advance, oldest first.
    pub advance: Arc<[Advance]>,
    /// What they ask of an operator.
    pub alarm_load: Load,
    /// Blocks waiting in the shard's queue, bytes.
    pub queue_bytes: usize,
    /// Blocks dropped because the queue was full, and their samples.
    pub dropped: (u64, u64),
}

/// Most samples of one [`Waveform`]: 16 MiB, which a shard copies in a few milliseconds.
pub const MAX_WAVEFORM_SAMPLES: usize = 4_194_304;

/// A run of raw samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Waveform {
    /// First sample.
    pub start: u64,
    /// Stream time of the first sample, s.
    pub start_time_s: f64,
    /// Samples, contiguous, canonical unit, channel offset left out.
    pub samples: Vec<f32>,
}

/// Trend of one channel, in columns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trend {
    /// Window ends, s of stream time.
    pub time_s: Vec<f64>,
    /// Feature name, unit and values, each as long as `time_s`.
    pub columns: Vec<(String, crate::units::Unit, Vec<f64>)>,
}

/// What HTTP may ask a shard.
#[derive(Debug)]
pub enum ShardRequest {
    /// The newest contiguous run of at most `max_samples` samples that ends at or before `end`
    /// (`None`: the newest).
    Waveform {
        /// Place in [`MachineView::channels`].
        channel: usize,
        /// One past the last sample wanted.
        end: Option<u64>,
        /// At most this many, [`MAX_WAVEFORM_SAMPLES`] at most.
        max_samples: usize,
        /// `None` when nothing is held.
        reply: oneshot::Sender<Option<Waveform>>,
    },
    /// The trend held in memory.
    Trend {
        /// Place in [`MachineView::channels`].
        channel: usize,
        /// The columns.
        reply: oneshot::Sender<Trend>,
    },
    /// An operator does something to an alarm.
    Act {
        /// What.
        act: Act,
        /// The alarm after the act once that is stored, or why not.
        reply: oneshot::Sender<Result<Alarm, ActFailure>>,
    },
    /// An operator says a silence in advance.
    Announce {
        /// What.
        wanted: Announcement,
        /// It, once that is stored, or why not.
        reply: oneshot::Sender<Result<Advance, AdvanceFailure>>,
    },
    /// An operator ends a silence that was said in advance.
    Revoke {
        /// Its number.
        number: u64,
        /// Who, and why.
        by: (String, String),
        /// It, once that is stored, or why not.
        reply: oneshot::Sender<Result<Advance, AdvanceFailure>>,
    },
    /// The alarm events held in memory.
    AlarmHistory {
        /// The events.
        reply: oneshot::Sender<AlarmHistory>,
    },
    /// An operator asks for a capture of what was received.
    Capture {
        /// Who.
        author: String,
        /// Why.
        comment: String,
        /// Stream time of the past, s, as far as it is held; `None`: all of it.
        before_s: Option<f64>,
        /// Stream time to come, s; `None`: as configured.
        after_s: Option<f64>,
        /// Its id once it is stored, or why there is none.
        reply: oneshot::Sender<Result<String, String>>,
    },
    /// A record of windows that were judged, for a baseline.
    Measure {
        /// Which.
        span: Span,
        /// The record, or why there is none.
        reply: oneshot::Sender<Result<Measured, String>>,
    },
    /// Use these records of signed baselines from now on.
    UseBaselines {
        /// The records.
        records: Vec<Record>,
        /// Told when they are used.
        reply: oneshot::Sender<()>,
    },
}

/// Windows of a stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Span {
    /// The newest.
    Last(usize),
    /// Those that lie wholly between two stream times, s.
    Between(f64, f64),
}

/// A record measured of windows.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The record.
    pub record: Record,
    /// What speaks against learning from it, for people.
    pub warnings: Vec<String>,
}

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

/// Measures a recording of a machine by its name; or says why it cannot.
pub type MeasureRecording =
    Arc<dyn Fn(&Arc<Machine>, &str) -> Result<Record, String> + Send + Sync>;

impl std::fmt::Debug for BaselineHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BaselineHandle").finish_non_exhaustive()
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

impl std::fmt::Debug for CaptureHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CaptureHandle").field("root", &self.root).finish_non_exhaustive()
    }
}

/// Why an operator's act is not answered with the alarm after it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ActFailure {
    /// It was refused; nothing has changed.
    #[error(transparent)]
    Refused(#[from] ActionError),
    /// It is in effect, but would be lost if the program ended now; the reason.
    #[error("the act is in effect but not stored yet: {0}")]
    NotStored(String),
}

/// Why a silence in advance is not answered with itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdvanceFailure {
    /// It was refused; nothing has changed.
    #[error(transparent)]
    Refused(#[from] AdvanceError),
    /// It is in effect, but would be lost if the program ended now; the reason.
    #[error("the act is in effect but not stored yet: {0}")]
    NotStored(String),
}

/// Alarm events held in memory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AlarmHistory {
    /// Oldest first.
    pub events: Vec<AlarmEvent>,
    /// Number of older events that fell out.
    pub dropped: u64,
}

/// Why a shard did not take a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the shard's queue is full, try again")]
pub struct ShardBusy;

/// What is recorded of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RecordingView {
    /// Name of the file being written.
    pub file: Option<String>,
    /// Why nothing is recorded at the moment.
    pub failure: Option<String>,
    /// Recordings there are.
    pub n_files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Samples recorded since the start.
    pub n_recorded: u64,
    /// Samples received and not recorded.
    pub n_lost: u64,
    /// Failures.
    pub n_failures: u64,
    /// Recordings removed for the store's limit, of whatever machine.
    pub n_removed: u64,
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
}

/// Tells how the live senders of a machine are doing.
pub type IngestStatus = Arc<dyn Fn() -> IngestView + Send + Sync>;

/// Messages of a sender on a WebSocket, and answers to it; either end may go.
#[derive(Debug)]
pub struct IngestPipe {
    /// Bytes that have come, in their order.
    pub to_daemon: std::sync::mpsc::SyncSender<Vec<u8>>,
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

/// The history of trends, as the API sees it.
#[derive(Clone)]
pub struct TrendHandle {
    /// What is stored.
    pub archive: Arc<dyn TrendArchive>,
    /// How storing is doing.
    pub status: Arc<Status>,
    /// What it takes on the disk.
    pub holdings: watch::Receiver<Holdings>,
}

impl std::fmt::Debug for TrendHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrendHandle").field("status", &self.status).finish_non_exhaustive()
    }
}

/// The configuration that holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigurationView {
    /// Its hash.
    pub hash: String,
    /// Since when, UTC.
    pub since: Timestamp,
    /// What of the newest waits for a restart.
    pub restart: Vec<String>,
    /// When the newest was refused, and why; `None`: it was not.
    pub rejected: Option<(Timestamp, Vec<String>)>,
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
