//! The counters of a machine on its shard: what has been counted since they were told last.

use crate::buffer::RingStatus;
use crate::signal::ChannelInfo;
use crate::telemetry::ChannelMetrics;
use crate::telemetry::MachineMetrics;
use crate::telemetry::Metrics;

/// The machine's counters, and the counts they have been given.
#[derive(Debug)]
pub(super) struct Meters {
    pub(super) machine: MachineMetrics,
    channels: Vec<(ChannelMetrics, RingStatus)>,
    blocks_dropped: u64,
}

impl Meters {
    pub(super) fn new(metrics: &Metrics, machine: &str, channels: &[ChannelInfo]) -> Self {
        let counted = |channel: &ChannelInfo| {
            (metrics.channel(machine, &channel.name), RingStatus::default())
        };
        Self {
            machine: metrics.machine(machine),
            channels: channels.iter().map(counted).collect(),
            blocks_dropped: 0,
        }
    }

    /// Counts for the channels of another stream.
    pub(super) fn take_channels(
        &mut self,
        metrics: &Metrics,
        machine: &str,
        channels: &[ChannelInfo],
    ) {
        self.channels = Self::new(metrics, machine, channels).channels;
    }

    /// Adds what was counted since the last time.
    pub(super) fn update(&mut self, rings: &[RingStatus], blocks_dropped: u64) {
        for ((counters, before), now) in self.channels.iter_mut().zip(rings) {
            counters.received.inc_by(now.received - before.received);
            counters.missing.inc_by(now.missing - before.missing);
            counters.duplicated.inc_by(now.duplicated - before.duplicated);
            *before = *now;
        }
        self.machine.blocks_dropped.inc_by(blocks_dropped - self.blocks_dropped);
        self.blocks_dropped = blocks_dropped;
    }
}
