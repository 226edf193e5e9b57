//! The program itself as JSON: readiness, version, losses.

use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// The process answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct LiveWire {
    /// Always true.
    pub live: bool,
}

/// Whether the daemon does its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ReadyWire {
    /// Always true; what is not ready is told as a problem.
    pub ready: bool,
}

/// The newest lines of the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct LogWire {
    /// Oldest first; long ones are cut.
    pub lines: Vec<String>,
}

/// The program and its streams.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct SystemWire {
    /// Program.
    pub name: String,
    /// Version.
    pub version: String,
    /// Hash of the configuration; null without one.
    pub configuration_hash: Option<String>,
    /// What became of it while the daemon ran; null without one.
    pub configuration: Option<ConfigurationStateWire>,
    /// When the daemon started, wall clock.
    pub started_at: Option<String>,
    /// Who may reach it.
    pub security: SecurityWire,
    /// How the store of alarms is doing; null without one.
    pub store: Option<StoreWire>,
    /// What the parts of the store take on the disk, and for how long there is room; null without a store.
    pub sizes: Option<StoreSizesWire>,
    /// Who is notified, and how that goes.
    pub receivers: Vec<ReceiverWire>,
    /// Streams of events over HTTP; null without a store.
    pub event_streams: Option<EventStreamsWire>,
    /// How the store of trends is doing; null without one.
    pub trends: Option<TrendStoreWire>,
    /// One entry a machine.
    pub streams: Vec<StreamWire>,
}

/// Who may reach the daemon.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct SecurityWire {
    /// Whether everybody needs a token.
    pub tokens: bool,
    /// Whether HTTP is encrypted.
    pub encrypted: bool,
    /// What is open that should not be; empty if all is well.
    pub warnings: Vec<String>,
    /// The label of the token this was asked with; null without one.
    pub you: Option<String>,
    /// The role of that token; null without one.
    pub role: Option<String>,
}

/// The configuration that holds, and what became of the newest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ConfigurationStateWire {
    /// Since when it holds, wall clock.
    pub since: String,
    /// What of the newest waits for a restart.
    pub waiting_for_restart: Vec<String>,
    /// When the newest was refused, wall clock; null: it was not.
    pub rejected_at: Option<String>,
    /// Every mistake in it, with its place.
    pub rejected_because: Vec<String>,
}

/// How a receiver of notifications is doing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ReceiverWire {
    /// Its name in the configuration.
    pub name: String,
    /// `webhook` or `mqtt`.
    pub kind: String,
    /// Why nothing gets through at the moment; null if all is well.
    pub failure: Option<String>,
    /// Transitions that wait for it.
    pub waiting: usize,
    /// When the oldest of them was stored, wall clock; null: none waits.
    pub waiting_since: Option<String>,
    /// Transitions that it took, since it is configured.
    pub delivered: u64,
    /// Transitions that it refused for good.
    pub refused: u64,
    /// Transitions given up because too many waited.
    pub given_up: u64,
    /// When it last took one since the daemon started.
    pub last_delivered_at: Option<String>,
}

/// Streams of events over HTTP.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct EventStreamsWire {
    /// Open now.
    pub open: i64,
    /// Refused since the start because too many were open.
    pub refused: u64,
    /// Connections of any kind cut because their reader took nothing any more.
    pub stalled: u64,
}

/// How the store of alarms is doing.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct StoreWire {
    /// Why nothing can be stored at the moment; null if all is well.
    pub failure: Option<String>,
    /// Alarm events stored since the daemon started.
    pub stored: u64,
    /// Alarm events that wait for the store to recover.
    pub waiting: u64,
    /// Alarm events that will never be stored.
    pub lost: u64,
    /// When the oldest event happened that is being written or waits for the store, wall clock; null: none does.
    pub waiting_since: Option<String>,
    /// When the newest commit was over, wall clock; null: there was none since the daemon started.
    pub committed_at: Option<String>,
    /// How long it took, s.
    pub commit_s: Option<f64>,
}

/// What the parts of the store take on the disk, looked at every minute.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct StoreSizesWire {
    /// Time over which growth was measured, s: from a look at the start of the daemon to the newest one.
    pub measured_s: f64,
    /// Bytes that are free on the disk; null: unknown.
    pub free_bytes: Option<u64>,
    /// Alarms, trends, recordings, captures; empty before the first look.
    pub parts: Vec<StorePartWire>,
}

/// What a part of the store takes on the disk.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct StorePartWire {
    /// `alarms`, `trends`, `recordings` or `captures`.
    pub name: String,
    /// Bytes of its files, logs of databases included; null: the part is off.
    pub bytes: Option<u64>,
    /// Bytes at which its oldest files are removed; null: there is no such limit. Recordings may take what trends leave.
    pub limit_bytes: Option<u64>,
    /// Mean growth over `measured_s`, bytes a day, without logs and less what was removed; null until ten minutes have passed.
    pub growth_bytes_per_day: Option<f64>,
    /// Days until the limit is reached, and the oldest files are removed, if it goes on growing so; 0: it is reached;
    /// null: not known, no limit, or it does not grow.
    pub days_to_limit: Option<f64>,
}

/// How the store of trends is doing. A point is a window in a channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct TrendStoreWire {
    /// Why nothing can be stored at the moment; null if all is well.
    pub failure: Option<String>,
    /// Points stored since the daemon started.
    pub stored: u64,
    /// Points that wait for the store to recover.
    pub waiting: u64,
    /// Points that will never be stored.
    pub lost: u64,
    /// Files there are.
    pub files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Files removed for their age or the store's limit since the daemon started.
    pub removed: u64,
    /// Damaged files put aside since the daemon started.
    pub set_aside: u64,
}

/// How a machine's stream is doing.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct StreamWire {
    /// Machine id.
    pub machine: String,
    /// starting, running, finished or failed.
    pub source: String,
    /// Why it failed.
    pub reason: Option<String>,
    /// Blocks waiting to be judged, bytes.
    pub queue_bytes: usize,
    /// How long the newest block that was judged had waited for that, s; null: none has come.
    pub queue_wait_s: Option<f64>,
    /// How far the end of the newest judged window is behind the newest sample, s of stream time: up to a hop if all is well;
    /// null: nothing is judged yet.
    pub verdict_lag_s: Option<f64>,
    /// How much more samples a second of the wall clock come than stated, parts in a million, of the channel that is off
    /// most; null: not live, or too little is known.
    pub clock_drift_ppm: Option<f64>,
    /// How far the clock of the sender whose clock is off most is behind that of the daemon, delays of the way included, s, below 0:
    /// ahead; null: not live, the senders state no times, or for less than a minute. Above 10 or below -1 it is told as a warning.
    pub clock_offset_s: Option<f64>,
    /// How long ago the newest sample was taken by the clock of its sender, s, below 0 where that is ahead; null: not live,
    /// or the senders state no times. It grows while nothing is sent.
    pub sample_age_s: Option<f64>,
    /// Blocks dropped because the queue was full.
    pub dropped_blocks: u64,
    /// Their samples.
    pub dropped_samples: u64,
    /// Samples received and kept, summed over channels.
    pub received: u64,
    /// Samples never received, summed over channels.
    pub missing: u64,
    /// Gaps, summed over channels.
    pub gaps: u64,
    /// Samples received again or too late, summed over channels.
    pub duplicated: u64,
    /// Samples at the ends of the source's number range, summed over channels.
    pub clipped: u64,
    /// How late a simulated source's newest block was, s; null for others.
    pub simulation_lag_s: Option<f64>,
    /// Lag it gave up since the start, s.
    pub simulation_lag_given_up_s: Option<f64>,
    /// What is recorded; null if nothing is.
    pub recording: Option<RecordingWire>,
}

/// What is recorded of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct RecordingWire {
    /// Name of the file being written; null between two.
    pub file: Option<String>,
    /// Why nothing is recorded at the moment; null if all is well.
    pub failure: Option<String>,
    /// Recordings of the machine in the store.
    pub files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Samples recorded since the daemon started, summed over channels.
    pub recorded: u64,
    /// Samples received and not recorded, summed over channels.
    pub lost: u64,
    /// Times the disk or the library refused.
    pub failures: u64,
    /// Recordings removed for the store's limit while this machine was recorded.
    pub removed: u64,
}
