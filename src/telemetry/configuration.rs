//! What became of configurations that were read while the daemon ran.

use super::Metrics;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

/// Counts configurations that were read while the daemon ran.
#[derive(Debug, Clone, Default)]
pub struct ConfigurationMetrics {
    /// Those that hold, or held.
    pub applied: Counter,
    /// Those that were refused.
    pub rejected: Counter,
    /// Whether the newest was refused.
    pub failing: Gauge,
    /// What of the newest waits for a restart.
    pub waiting: Gauge,
}

impl ConfigurationMetrics {
    pub(super) fn register(&self, registry: &mut Registry) {
        let Self { applied, rejected, failing, waiting } = self.clone();
        registry.register("config_applied", "Configurations taken over while running", applied);
        registry.register("config_rejected", "Configurations refused while running", rejected);
        let text = "Whether the configuration on the disk is refused, and that of before holds";
        registry.register("config_failing", text, failing);
        let text = "Changes of the configuration that wait for a restart";
        registry.register("config_waiting_for_restart", text, waiting);
    }
}

impl Metrics {
    /// Counters of configurations that are read while the daemon runs.
    #[must_use]
    pub fn configuration(&self) -> ConfigurationMetrics {
        self.configuration.clone()
    }
}
