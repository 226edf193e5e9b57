//! What each part of the daemon counts with: handles of metrics that are registered elsewhere.

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use std::sync::atomic::AtomicU64;

/// Counters of one channel.
#[derive(Debug, Clone, Default)]
pub struct ChannelMetrics {
    /// Samples received and kept.
    pub received: Counter,
    /// Samples never received.
    pub missing: Counter,
    /// Samples received again or too late.
    pub duplicated: Counter,
}

/// Counters of one machine.
#[derive(Debug, Clone)]
pub struct MachineMetrics {
    /// Samples that the source could not hand on, such as values that are no numbers.
    pub rejected: Counter,
    /// Blocks lost because the queue was full.
    pub blocks_dropped: Counter,
    /// Windows judged.
    pub windows_judged: Counter,
    /// Alarm transitions.
    pub alarm_transitions: Counter,
    /// From the arrival of the block that completes a window to its published verdict, s.
    pub verdict_latency_s: Histogram,
    /// How long ago the newest sample came, s.
    pub sample_age_s: Gauge<f64, AtomicU64>,
}

/// Counters of what is recorded of a machine.
#[derive(Debug, Clone, Default)]
pub struct RecordingMetrics {
    /// Samples recorded.
    pub recorded: Counter,
    /// Samples received and not recorded.
    pub lost: Counter,
    /// Times the disk or the library refused.
    pub failures: Counter,
    /// Recordings removed for the store's limit.
    pub removed: Counter,
    /// Recordings in the store.
    pub files: Gauge,
    /// Their bytes.
    pub bytes: Gauge,
}

/// What became of captures, all machines together.
#[derive(Debug, Clone, Default)]
pub struct CaptureMetrics {
    /// Begun.
    pub taken: Counter,
    /// Alarms' captures that were not made.
    pub refused: Counter,
    /// Captures that could not be begun or went wrong.
    pub failed: Counter,
    /// Captures that gave way to newer ones.
    pub removed: Counter,
    /// Bytes of the captures there are.
    pub bytes: Gauge,
}

/// Gauges of what the alarms of a machine ask of an operator.
#[derive(Debug, Clone, Default)]
pub struct AlarmLoadMetrics {
    /// Alarms that are not over.
    pub standing: Gauge,
    /// Of these, conditions that are present and nobody has acknowledged.
    pub unacknowledged: Gauge,
    /// Of these, those that are silent.
    pub silenced: Gauge,
    /// Alarms annunciated within the last hour.
    pub last_hour: Gauge,
    /// Alarms annunciated within the last ten minutes.
    pub last_ten_minutes: Gauge,
    /// 1 during a flood.
    pub flood: Gauge,
    /// Alarms that chatter.
    pub chattering: Gauge,
    /// Alarms that are stale.
    pub stale: Gauge,
    /// 1 while the machine is maintained.
    pub in_maintenance: Gauge,
}

/// How the store of alarms is doing.
#[derive(Debug, Clone)]
pub struct StoreMetrics {
    /// Events stored.
    pub stored: Counter,
    /// Events that will never be.
    pub lost: Counter,
    /// Events that wait for the store to recover.
    pub waiting: Gauge,
    /// 1 while it refuses.
    pub failing: Gauge,
    /// Time of a commit, s.
    pub commit_s: Histogram,
}

impl Default for StoreMetrics {
    fn default() -> Self {
        let [stored, lost] = [Counter::default(), Counter::default()];
        let [waiting, failing] = [Gauge::default(), Gauge::default()];
        Self { stored, lost, waiting, failing, commit_s: Histogram::new([]) }
    }
}

/// How a receiver of notifications is doing.
#[derive(Debug, Clone)]
pub struct ReceiverMetrics {
    /// Transitions that it took.
    pub delivered: Counter,
    /// Transitions that it refused for good.
    pub refused: Counter,
    /// Transitions given up because too many waited.
    pub given_up: Counter,
    /// Transitions that wait.
    pub waiting: Gauge,
    /// 1 while nothing gets through.
    pub failing: Gauge,
    /// From the storing of a transition to its being taken, s.
    pub after_s: Histogram,
}

/// Streams of events over HTTP.
#[derive(Debug, Clone, Default)]
pub struct StreamMetrics {
    /// Streams that are open.
    pub open: Gauge,
    /// Streams that were refused because too many were open.
    pub refused: Counter,
    /// Connections cut because their reader took nothing any more.
    pub stalled: Counter,
}

/// How the store of trends is doing.
#[derive(Debug, Clone, Default)]
pub struct TrendMetrics {
    /// Points stored.
    pub stored: Counter,
    /// Points that will never be.
    pub lost: Counter,
    /// Points that wait for the store to recover.
    pub waiting: Gauge,
    /// 1 while it refuses.
    pub failing: Gauge,
    /// Bytes on the disk.
    pub bytes: Gauge,
    /// Files.
    pub files: Gauge,
    /// Damaged files put aside since the start.
    pub set_aside: Gauge,
}

/// What gave way because the disk had no room.
#[derive(Debug, Clone, Default)]
pub struct RoomMetrics {
    /// Recordings.
    pub recordings: Counter,
    /// Captures.
    pub captures: Counter,
    /// Files of trends.
    pub trends: Counter,
    /// Bytes that are free on the disk of the store.
    pub free: Gauge,
}

/// Labels of senders refused.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct RefusalLabels {
    reason: String,
}

/// What becomes of connections of senders.
#[derive(Debug, Clone, Default)]
pub struct IngestMetrics {
    /// Connections there are.
    pub connections: Gauge,
    /// Those refused or cut off.
    pub(super) refusals: Family<RefusalLabels, Counter>,
    /// Samples of the blocks for which they were.
    pub(super) refused_samples: Family<RefusalLabels, Counter>,
}

impl IngestMetrics {
    /// Connections refused or cut off with an error.
    #[must_use]
    pub fn refused(&self, reason: &str) -> Counter {
        self.refusals.get_or_create_owned(&RefusalLabels { reason: reason.to_owned() })
    }

    /// Samples of blocks that were refused with who sent them, as far as their number is known.
    #[must_use]
    pub fn refused_samples(&self, reason: &str) -> Counter {
        self.refused_samples.get_or_create_owned(&RefusalLabels { reason: reason.to_owned() })
    }
}

/// Gauges of a simulated source.
#[derive(Debug, Clone, Default)]
pub struct SimulationMetrics {
    /// Simulated time, s.
    pub simulated_s: Gauge<f64, AtomicU64>,
    /// How late the newest block was, s.
    pub lag_s: Gauge<f64, AtomicU64>,
    /// Lag given up since the start, s.
    pub given_up_s: Gauge<f64, AtomicU64>,
}
