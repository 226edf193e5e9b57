//! Who was not let in, and what is open that should not be.

use super::Metrics;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

/// Labels of those who were not let in.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ReasonLabels {
    reason: &'static str,
}

/// Labels of what is open.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct WhatLabels {
    what: &'static str,
}

/// Counts of access.
#[derive(Debug, Clone, Default)]
pub struct AccessMetrics {
    denied: Family<ReasonLabels, Counter>,
    insecure: Family<WhatLabels, Gauge>,
    /// Connections for which there was no place.
    pub connections_refused: Counter,
}

impl AccessMetrics {
    pub(super) fn register(&self, registry: &mut Registry) {
        let text = "Requests and senders that were not let in or not allowed, by reason";
        registry.register("access_denied", text, self.denied.clone());
        let text = "Connections that were closed at once because as many as may be were open";
        registry.register("http_connections_refused", text, self.connections_refused.clone());
        let text = "Whether other hosts can reach the daemon without tokens, or without encryption";
        registry.register("insecure", text, self.insecure.clone());
    }

    /// Those who were not let in for a reason.
    #[must_use]
    pub fn denied(&self, reason: &'static str) -> Counter {
        self.denied.get_or_create_owned(&ReasonLabels { reason })
    }

    /// Whether something is open: `no_tokens`, `plain_text`.
    #[must_use]
    pub fn insecure(&self, what: &'static str) -> Gauge {
        self.insecure.get_or_create_owned(&WhatLabels { what })
    }
}

impl Metrics {
    /// Counts of access.
    #[must_use]
    pub fn access(&self) -> AccessMetrics {
        self.access.clone()
    }
}
