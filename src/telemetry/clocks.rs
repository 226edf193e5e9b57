//! Gauges of the clocks of live senders: one stands only where something is known of it.

use super::Metrics;
use super::labels::ChannelLabels;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::atomic::AtomicU64;

impl Metrics {
    /// How the sample clock of a live channel runs.
    #[must_use]
    pub fn clock_drift(&self, machine: &str, channel: &str) -> Gauge<f64, AtomicU64> {
        let labels = ChannelLabels { machine: machine.to_owned(), channel: channel.to_owned() };
        self.clock_drift.get_or_create_owned(&labels)
    }

    /// How far the clock of a live channel's sender is behind.
    #[must_use]
    pub fn clock_offset(&self, machine: &str, channel: &str) -> Gauge<f64, AtomicU64> {
        let labels = ChannelLabels { machine: machine.to_owned(), channel: channel.to_owned() };
        self.clock_offset.get_or_create_owned(&labels)
    }
}
