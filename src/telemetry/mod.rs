//! The daemon's own health: the log, and the metrics with all their names in one place.
//!
//! Metrics have no global: one [`Metrics`] is made by `app` and handed on. Must not know machines,
//! diagnoses or HTTP.

mod access;
mod clocks;
mod configuration;
mod labels;
mod log;
mod meters;
mod stages;

pub use access::AccessMetrics;
pub use configuration::ConfigurationMetrics;
pub use log::LOG_VARIABLE;
pub use log::LogError;
pub use log::LogFormat;
pub use log::newest_log_lines;
pub use log::set_log_level;
pub use log::start_log;
pub use meters::AlarmLoadMetrics;
pub use meters::CaptureMetrics;
pub use meters::ChannelMetrics;
pub use meters::IngestMetrics;
pub use meters::MachineMetrics;
pub use meters::ReceiverMetrics;
pub use meters::RecordingMetrics;
pub use meters::RoomMetrics;
pub use meters::SimulationMetrics;
pub use meters::StoreMetrics;
pub use meters::StreamMetrics;
pub use meters::TrendMetrics;
pub use stages::ComponentMetrics;
pub use stages::HttpMetrics;
pub use stages::ShardMetrics;

use labels::AlarmLabels;
use labels::ChannelLabels;
use labels::FateLabels;
use labels::MachineLabels;
use labels::NotificationLabels;
use labels::ReceiverLabels;
use labels::ShardLabels;
use prometheus_client::encoding::text;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::Registry;
use stages::StageMetrics;
use std::fmt;
use std::sync::atomic::AtomicU64;

/// Upper bounds of the verdict latency's bins, s: an idle shard answers within milliseconds, one
/// whose queue is full within seconds.
const LATENCY_BOUNDS_S: [f64; 12] =
    [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 5.0, 30.0];

/// All metrics, by name.
pub struct Metrics {
    registry: Registry,
    received: Family<ChannelLabels, Counter>,
    missing: Family<ChannelLabels, Counter>,
    duplicated: Family<ChannelLabels, Counter>,
    rejected: Family<MachineLabels, Counter>,
    blocks_dropped: Family<MachineLabels, Counter>,
    windows_judged: Family<MachineLabels, Counter>,
    alarm_transitions: Family<MachineLabels, Counter>,
    verdict_latency_s: Family<MachineLabels, Histogram, fn() -> Histogram>,
    queue_bytes: Family<ShardLabels, Gauge>,
    samples_recorded: Family<MachineLabels, Counter>,
    samples_not_recorded: Family<MachineLabels, Counter>,
    recording_failures: Family<MachineLabels, Counter>,
    recordings_removed: Family<MachineLabels, Counter>,
    recordings: Family<MachineLabels, Gauge>,
    recording_bytes: Family<MachineLabels, Gauge>,
    simulated: Family<MachineLabels, Gauge<f64, AtomicU64>>,
    simulation_lag: Family<MachineLabels, Gauge<f64, AtomicU64>>,
    simulation_given_up: Family<MachineLabels, Gauge<f64, AtomicU64>>,
    alarms: Family<AlarmLabels, Gauge>,
    alarm_load: Family<AlarmLabels, Gauge>,
    in_maintenance: Family<MachineLabels, Gauge>,
    store: StoreMetrics,
    notifications: Family<NotificationLabels, Counter>,
    notifications_waiting: Family<ReceiverLabels, Gauge>,
    receiver_failing: Family<ReceiverLabels, Gauge>,
    streams: StreamMetrics,
    trends: TrendMetrics,
    captures: CaptureMetrics,
    room: RoomMetrics,
    ingest: IngestMetrics,
    ingested: Family<FateLabels, Counter>,
    clock_drift: Family<ChannelLabels, Gauge<f64, AtomicU64>>,
    clock_offset: Family<ChannelLabels, Gauge<f64, AtomicU64>>,
    configuration: ConfigurationMetrics,
    access: AccessMetrics,
    stages: StageMetrics,
}

impl fmt::Debug for Metrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Metrics").finish_non_exhaustive()
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

impl Metrics {
    /// Registers every metric.
    #[must_use]
    pub fn new() -> Self {
        let mut registry = Registry::with_prefix("rotorwatch");
        let version = [("version", env!("CARGO_PKG_VERSION"))];
        registry.register("build", "The running program", Info::new(version));
        let mut metrics = Self {
            registry: Registry::default(),
            received: Family::default(),
            missing: Family::default(),
            duplicated: Family::default(),
            rejected: Family::default(),
            blocks_dropped: Family::default(),
            windows_judged: Family::default(),
            alarm_transitions: Family::default(),
            verdict_latency_s: Family::new_with_constructor(latency),
            queue_bytes: Family::default(),
            samples_recorded: Family::default(),
            samples_not_recorded: Family::default(),
            recording_failures: Family::default(),
            recordings_removed: Family::default(),
            recordings: Family::default(),
            recording_bytes: Family::default(),
            simulated: Family::default(),
            simulation_lag: Family::default(),
            simulation_given_up: Family::default(),
            alarms: Family::default(),
            alarm_load: Family::default(),
            in_maintenance: Family::default(),
            store: StoreMetrics::default(),
            notifications: Family::default(),
            notifications_waiting: Family::default(),
            receiver_failing: Family::default(),
            streams: StreamMetrics::default(),
            trends: TrendMetrics::default(),
            captures: CaptureMetrics::default(),
            room: RoomMetrics::default(),
            ingest: IngestMetrics::default(),
            ingested: Family::default(),
            clock_drift: Family::default(),
            clock_offset: Family::default(),
            configuration: ConfigurationMetrics::default(),
            access: AccessMetrics::default(),
            stages: StageMetrics::default(),
        };
        let m = &metrics;
        registry.register("samples_received", "Samples received and kept", m.received.clone());
        registry.register("samples_missing", "Samples never received", m.missing.clone());
        registry.register(
            "samples_duplicated",
            "Samples received again or too late, and not used",
            m.duplicated.clone(),
        );
        registry.register(
            "samples_rejected",
            "Samples that a source could not hand on",
            m.rejected.clone(),
        );
        registry.register(
            "blocks_dropped",
            "Blocks lost because the queue was full",
            m.blocks_dropped.clone(),
        );
        registry.register("windows_judged", "Windows judged", m.windows_judged.clone());
        registry.register("alarm_transitions", "Alarm transitions", m.alarm_transitions.clone());
        registry.register(
            "verdict_latency_seconds",
            "Time from the arrival of a window's last block to its published verdict",
            m.verdict_latency_s.clone(),
        );
        registry.register("queue_bytes", "Blocks waiting for a shard", m.queue_bytes.clone());
        metrics.register_recording(&mut registry);
        metrics.register_simulation(&mut registry);
        metrics.register_alarms(&mut registry);
        metrics.register_notifications(&mut registry);
        metrics.register_captures(&mut registry);
        metrics.register_room(&mut registry);
        metrics.register_ingest(&mut registry);
        metrics.configuration.register(&mut registry);
        metrics.access.register(&mut registry);
        metrics.registry = registry;
        metrics
    }

    fn register_recording(&self, registry: &mut Registry) {
        registry.register("samples_recorded", "Samples recorded", self.samples_recorded.clone());
        registry.register(
            "samples_not_recorded",
            "Samples received and not recorded",
            self.samples_not_recorded.clone(),
        );
        registry.register(
            "recording_failures",
            "Times that a recording could not be written",
            self.recording_failures.clone(),
        );
        registry.register(
            "recordings_removed",
            "Recordings removed for the store's limit",
            self.recordings_removed.clone(),
        );
        registry.register("recordings", "Recordings in the store", self.recordings.clone());
        registry.register(
            "recording_bytes",
            "Bytes of the recordings in the store",
            self.recording_bytes.clone(),
        );
    }

    fn register_alarms(&self, registry: &mut Registry) {
        let store = &self.store;
        registry.register("alarms", "Alarms that are not over", self.alarms.clone());
        registry.register(
            "alarm_load",
            "What the alarms ask of an operator, in counts",
            self.alarm_load.clone(),
        );
        let text = "Whether the machine is maintained, its alarms out of service";
        registry.register("machine_in_maintenance", text, self.in_maintenance.clone());
        registry.register("store_events", "Alarm events stored", store.stored.clone());
        registry.register(
            "store_events_lost",
            "Alarm events that could not be stored",
            store.lost.clone(),
        );
        registry.register(
            "store_events_waiting",
            "Alarm events that wait for the store to recover",
            store.waiting.clone(),
        );
        registry.register("store_failing", "Whether the store refuses", store.failing.clone());
        self.stages.register(registry);
        self.register_trends(registry);
    }

    fn register_trends(&self, registry: &mut Registry) {
        let TrendMetrics { stored, lost, waiting, failing, bytes, files, set_aside } = &self.trends;
        registry.register("trend_points_stored", "Trend points stored", stored.clone());
        let text = "Trend points that will never be stored";
        registry.register("trend_points_lost", text, lost.clone());
        let text = "Trend points that wait for the store to recover";
        registry.register("trend_points_waiting", text, waiting.clone());
        registry.register("trends_failing", "Whether trends are refused", failing.clone());
        registry.register("trend_bytes", "Bytes of stored trends", bytes.clone());
        registry.register("trend_files", "Files of stored trends", files.clone());
        let text = "Damaged files of trends put aside since the start";
        registry.register("trend_files_set_aside", text, set_aside.clone());
    }

    fn register_ingest(&self, registry: &mut Registry) {
        let text = "What became of the samples of live senders";
        registry.register("ingest_samples", text, self.ingested.clone());
        let text = "Samples by the wall clock beyond those stated, parts in a million";
        registry.register("clock_drift_ppm", text, self.clock_drift.clone());
        let text = "How far a sender's clock is behind that of the daemon, s";
        registry.register("clock_offset_seconds", text, self.clock_offset.clone());
        let text = "Senders that are connected";
        registry.register("ingest_connections", text, self.ingest.connections.clone());
        let text = "Senders refused or cut off, by the error they were told";
        registry.register("ingest_refused", text, self.ingest.refusals.clone());
        let text = "Samples of blocks that were refused with who sent them, as far as known";
        registry.register("ingest_refused_samples", text, self.ingest.refused_samples.clone());
    }

    /// Counters of senders.
    #[must_use]
    pub fn ingest(&self) -> IngestMetrics {
        self.ingest.clone()
    }

    /// Samples of a live channel that became `fate`.
    #[must_use]
    pub fn ingested(&self, machine: &str, channel: &str, fate: &str) -> Counter {
        let labels = FateLabels {
            machine: machine.to_owned(),
            channel: channel.to_owned(),
            fate: fate.to_owned(),
        };
        self.ingested.get_or_create_owned(&labels)
    }

    fn register_captures(&self, registry: &mut Registry) {
        let CaptureMetrics { taken, refused, failed, removed, bytes } = self.captures.clone();
        registry.register("captures", "Captures of alarms and operators begun", taken);
        registry.register("captures_refused", "Times that alarms were given no capture", refused);
        registry.register("captures_failed", "Captures that could not be made whole", failed);
        registry.register("captures_removed", "Captures that gave way to newer ones", removed);
        registry.register("capture_bytes", "Bytes of the captures in the store", bytes);
    }

    fn register_room(&self, registry: &mut Registry) {
        let RoomMetrics { recordings, captures, trends, free } = self.room.clone();
        let text = "Recordings given up because the disk had no room";
        registry.register("recordings_given_up", text, recordings);
        let text = "Captures given up because the disk had no room";
        registry.register("captures_given_up", text, captures);
        let text = "Files of trends given up because the disk had no room";
        registry.register("trend_files_given_up", text, trends);
        registry.register("store_free_bytes", "Bytes free on the disk of the store", free);
    }

    /// What gives way when the disk has no room.
    #[must_use]
    pub fn room(&self) -> RoomMetrics {
        self.room.clone()
    }

    /// What becomes of captures.
    #[must_use]
    pub fn captures(&self) -> CaptureMetrics {
        self.captures.clone()
    }

    fn register_simulation(&self, registry: &mut Registry) {
        registry.register("simulated_seconds", "Simulated time", self.simulated.clone());
        registry.register(
            "simulation_lag_seconds",
            "How late the newest block of a paced simulation was",
            self.simulation_lag.clone(),
        );
        registry.register(
            "simulation_lag_given_up_seconds",
            "Lag that a paced simulation gave up since the start",
            self.simulation_given_up.clone(),
        );
    }

    fn register_notifications(&self, registry: &mut Registry) {
        registry.register(
            "notifications",
            "Transitions that a receiver took, refused, or that were given up",
            self.notifications.clone(),
        );
        registry.register(
            "notifications_waiting",
            "Transitions that wait for a receiver",
            self.notifications_waiting.clone(),
        );
        registry.register(
            "receiver_failing",
            "Whether nothing gets through to a receiver",
            self.receiver_failing.clone(),
        );
        let streams = &self.streams;
        registry.register("event_streams", "Streams of events that are open", streams.open.clone());
        registry.register(
            "event_streams_refused",
            "Streams of events refused because too many were open",
            streams.refused.clone(),
        );
        registry.register(
            "connections_stalled",
            "Connections cut because their reader took nothing any more",
            streams.stalled.clone(),
        );
    }

    /// How a receiver of notifications is doing.
    #[must_use]
    pub fn receiver(&self, name: &str) -> ReceiverMetrics {
        let receiver = || name.to_owned();
        let became = |what: &str| {
            let labels = NotificationLabels { receiver: receiver(), outcome: what.to_owned() };
            self.notifications.get_or_create_owned(&labels)
        };
        let labels = ReceiverLabels { receiver: receiver() };
        ReceiverMetrics {
            delivered: became("delivered"),
            refused: became("refused"),
            given_up: became("given_up"),
            waiting: self.notifications_waiting.get_or_create_owned(&labels),
            failing: self.receiver_failing.get_or_create_owned(&labels),
            after_s: self.notified_after_s(&labels),
        }
    }

    /// Streams of events over HTTP.
    #[must_use]
    pub fn streams(&self) -> StreamMetrics {
        self.streams.clone()
    }

    /// Gauges of a simulated source.
    #[must_use]
    pub fn simulation(&self, machine: &str) -> SimulationMetrics {
        let labels = MachineLabels { machine: machine.to_owned() };
        SimulationMetrics {
            simulated_s: self.simulated.get_or_create_owned(&labels),
            lag_s: self.simulation_lag.get_or_create_owned(&labels),
            given_up_s: self.simulation_given_up.get_or_create_owned(&labels),
        }
    }

    /// Counters of what is recorded of a machine.
    #[must_use]
    pub fn recording(&self, machine: &str) -> RecordingMetrics {
        let labels = MachineLabels { machine: machine.to_owned() };
        RecordingMetrics {
            recorded: self.samples_recorded.get_or_create_owned(&labels),
            lost: self.samples_not_recorded.get_or_create_owned(&labels),
            failures: self.recording_failures.get_or_create_owned(&labels),
            removed: self.recordings_removed.get_or_create_owned(&labels),
            files: self.recordings.get_or_create_owned(&labels),
            bytes: self.recording_bytes.get_or_create_owned(&labels),
        }
    }

    /// Gauges of the alarms of a machine.
    #[must_use]
    pub fn alarm_load(&self, machine: &str) -> AlarmLoadMetrics {
        let labels =
            |what: &str| AlarmLabels { machine: machine.to_owned(), what: what.to_owned() };
        let alarms = |what| self.alarms.get_or_create_owned(&labels(what));
        let load = |what| self.alarm_load.get_or_create_owned(&labels(what));
        AlarmLoadMetrics {
            standing: alarms("standing"),
            unacknowledged: alarms("unacknowledged"),
            silenced: alarms("silenced"),
            last_hour: load("last_hour"),
            last_ten_minutes: load("last_ten_minutes"),
            flood: load("flood"),
            chattering: load("chattering"),
            stale: load("stale"),
            in_maintenance: self
                .in_maintenance
                .get_or_create_owned(&MachineLabels { machine: machine.to_owned() }),
        }
    }

    /// How the store of alarms is doing.
    #[must_use]
    pub fn store(&self) -> StoreMetrics {
        StoreMetrics { commit_s: self.commit_s(), ..self.store.clone() }
    }

    /// How the store of trends is doing.
    #[must_use]
    pub fn trends(&self) -> TrendMetrics {
        self.trends.clone()
    }

    /// Counters of a channel.
    #[must_use]
    pub fn channel(&self, machine: &str, channel: &str) -> ChannelMetrics {
        let labels = ChannelLabels { machine: machine.to_owned(), channel: channel.to_owned() };
        ChannelMetrics {
            received: self.received.get_or_create_owned(&labels),
            missing: self.missing.get_or_create_owned(&labels),
            duplicated: self.duplicated.get_or_create_owned(&labels),
        }
    }

    /// Counters of a machine.
    #[must_use]
    pub fn machine(&self, machine: &str) -> MachineMetrics {
        let labels = MachineLabels { machine: machine.to_owned() };
        MachineMetrics {
            rejected: self.rejected.get_or_create_owned(&labels),
            blocks_dropped: self.blocks_dropped.get_or_create_owned(&labels),
            windows_judged: self.windows_judged.get_or_create_owned(&labels),
            alarm_transitions: self.alarm_transitions.get_or_create_owned(&labels),
            verdict_latency_s: self.verdict_latency_s.get_or_create_owned(&labels),
            sample_age_s: self.sample_age_s(&labels),
        }
    }

    /// Writes all metrics as OpenMetrics 1.0 text.
    #[must_use]
    pub fn encode(&self) -> String {
        let mut out = String::new();
        // Writing into a String fails only if a metric does, and none of ours can.
        if let Err(error) = text::encode(&mut out, &self.registry) {
            tracing::error!(%error, "metrics cannot be written");
        }
        out
    }
}

fn latency() -> Histogram {
    Histogram::new(LATENCY_BOUNDS_S)
}

#[cfg(test)]
mod tests;
