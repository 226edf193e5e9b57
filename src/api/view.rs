//! What the daemon's shards show to HTTP, and what HTTP may ask of them.
//!
//! A shard publishes an immutable [`MachineView`] at each hop; anything larger is asked for by a
//! [`ShardRequest`] with a one-shot reply, served between blocks.

use crate::alarms::Act;
use crate::alarms::ActionError;
use crate::alarms::Advance;
use crate::alarms::AdvanceError;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::AlarmSource;
use crate::alarms::Announcement;
use crate::alarms::Level;
use crate::alarms::load::Load;
use crate::buffer::RingStatus;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::machine::Machine;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use std::sync::Arc;
use tokio::sync::oneshot;

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
    /// Stream time of the newest sample received, s; before the first of live senders, of now.
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
    /// Stream time of the end of the window that they are of, s; `None`: there are none yet.
    pub window_end_s: Option<f64>,
    /// All alarms that are not over, newest first.
    pub alarms: Arc<Vec<Alarm>>,
    /// Silences in advance, oldest first.
    pub advance: Arc<[Advance]>,
    /// What they ask of an operator.
    pub alarm_load: Load,
    /// Blocks waiting in the shard's queue, bytes.
    pub queue_bytes: usize,
    /// How long the newest block waited there, s; `None`: none has come.
    pub queue_wait_s: Option<f64>,
    /// Blocks dropped because the queue was full, and their samples.
    pub dropped: (u64, u64),
}

impl MachineView {
    /// The alarm that stands while no data come: verdicts and samples are those of before.
    #[must_use]
    pub fn no_data(&self) -> Option<&Alarm> {
        self.alarms
            .iter()
            .find(|alarm| alarm.kind == ComponentKind::Machine && tells_of_missing_data(alarm))
    }

    /// Whether the newest samples of a channel are old: its source failed, or it delivers none.
    #[must_use]
    pub fn is_stale(&self, channel: &str) -> bool {
        let is_of_channel =
            |alarm: &Alarm| alarm.kind == ComponentKind::Sensor && alarm.component == channel;
        matches!(self.source, SourceState::Failed(_))
            || self.no_data().is_some()
            || self.alarms.iter().any(|alarm| is_of_channel(alarm) && tells_of_missing_data(alarm))
    }
}

/// Alarms that verdicts raised and whose conditions are present, by kind and id of their components.
#[must_use]
pub fn accusations(alarms: &[Alarm]) -> Vec<&Alarm> {
    let is_one = |alarm: &&Alarm| alarm.source == AlarmSource::Diagnosis && alarm.state.is_active();
    let mut found: Vec<&Alarm> = alarms.iter().filter(is_one).collect();
    found.sort_by(|a, b| (a.kind, &a.component).cmp(&(b.kind, &b.component)));
    found
}

/// The state that an alarm of a verdict stands for.
#[must_use]
pub fn accused_state(level: Level) -> State {
    match level {
        Level::Warning => State::Warning,
        Level::Damaged => State::Damaged,
    }
}

fn tells_of_missing_data(alarm: &Alarm) -> bool {
    alarm.source == AlarmSource::Data && alarm.state.is_active()
}

/// Most samples of one [`Waveform`]: 16 MiB, which a shard copies in a few milliseconds.
pub const MAX_WAVEFORM_SAMPLES: usize = 4_194_304;

/// Where a run of samples ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum End {
    /// With the newest one.
    Newest,
    /// Before this index.
    Before(u64),
    /// Before this stream time, s.
    At(f64),
}

impl From<Option<u64>> for End {
    fn from(end: Option<u64>) -> Self {
        end.map_or(Self::Newest, Self::Before)
    }
}

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
    /// Samples of each window; empty for verdicts, which rest on several channels.
    pub n_samples: Vec<u64>,
}

/// What HTTP may ask a shard.
#[derive(Debug)]
pub enum ShardRequest {
    /// The newest contiguous run of at most `max_samples` samples that ends at or before `end`.
    Waveform {
        /// Place in [`MachineView::channels`].
        channel: usize,
        /// Where it ends.
        end: End,
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
    /// The verdicts on a component in the newest windows: state, severity and confidence as the store has them.
    Verdicts {
        /// The component's kind.
        kind: ComponentKind,
        /// Its id.
        component: String,
        /// The columns; none where it was not judged.
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
