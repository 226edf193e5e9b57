//! The golden signals of the stages: how long each takes, how much goes through, what is refused, how full it is.

use super::LATENCY_BOUNDS_S;
use super::Metrics;
use super::labels::MachineLabels;
use super::labels::ReceiverLabels;
use super::labels::ShardLabels;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use std::sync::atomic::AtomicU64;

/// Upper bounds of the bins of what people wait for, s: answers of memory take a tenth of a millisecond.
const ANSWER_BOUNDS_S: [f64; 12] =
    [0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5, 2.0, 10.0];

/// Upper bounds of the bins of what waits for others, s: a receiver may be down for a week-end.
const DELIVERY_BOUNDS_S: [f64; 10] =
    [0.01, 0.05, 0.2, 1.0, 5.0, 30.0, 300.0, 3600.0, 86_400.0, 604_800.0];

/// Labels of an answer over HTTP.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct AnswerLabels {
    method: String,
    route: String,
    status: u16,
}

/// Labels of a route.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RouteLabels {
    route: String,
}

/// Labels of a component.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ComponentLabels {
    machine: String,
    kind: String,
    component: String,
}

/// Labels of what has a limit.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct WhatLabels {
    what: &'static str,
}

/// A shard.
#[derive(Debug, Clone)]
pub struct ShardMetrics {
    /// Blocks waiting, bytes.
    pub queue_bytes: Gauge,
    /// From the arrival of a block to its being taken, s.
    pub wait_s: Histogram,
    /// Time in which it worked, s.
    pub busy_s: Counter<f64, AtomicU64>,
}

/// Requests over HTTP.
#[derive(Debug, Clone)]
pub struct HttpMetrics {
    answers: Family<AnswerLabels, Counter>,
    seconds: Family<RouteLabels, Histogram, fn() -> Histogram>,
    /// Requests that are being answered.
    pub in_flight: Gauge,
}

impl HttpMetrics {
    /// Counts an answer: method, route as it is registered, status; and the time it took, s.
    pub fn count(&self, (method, route, status): (&str, &str, u16), seconds: f64) {
        let labels = AnswerLabels { method: method.to_owned(), route: route.to_owned(), status };
        self.answers.get_or_create(&labels).inc();
        self.seconds.get_or_create(&RouteLabels { route: route.to_owned() }).observe(seconds);
    }
}

/// What is known of components.
#[derive(Debug, Clone, Default)]
pub struct ComponentMetrics {
    state: Family<ComponentLabels, Gauge>,
    severity: Family<ComponentLabels, Gauge<f64, AtomicU64>>,
    alarm: Family<ComponentLabels, Gauge>,
}

impl ComponentMetrics {
    /// Shows a component (machine, kind, id): state (0 undetermined, 1 healthy, 2 warning, 3 damaged), severity, and level
    /// of the alarm that asks for somebody (0 none, 1 warning, 2 damaged).
    pub fn show(&self, of: (&str, &str, &str), state: i64, severity: Option<f64>, alarm: i64) {
        let labels = labels(of);
        self.state.get_or_create(&labels).set(state);
        self.severity.get_or_create(&labels).set(severity.unwrap_or(f64::NAN));
        self.alarm.get_or_create(&labels).set(alarm);
    }

    /// Forgets one that there is no more.
    pub fn forget(&self, of: (&str, &str, &str)) {
        let labels = labels(of);
        self.state.remove(&labels);
        self.severity.remove(&labels);
        self.alarm.remove(&labels);
    }
}

fn labels((machine, kind, component): (&str, &str, &str)) -> ComponentLabels {
    let [machine, kind, component] = [machine, kind, component].map(str::to_owned);
    ComponentLabels { machine, kind, component }
}

/// All of them.
#[derive(Debug)]
pub(super) struct StageMetrics {
    queue_wait_s: Family<ShardLabels, Histogram, fn() -> Histogram>,
    shard_busy_s: Family<ShardLabels, Counter<f64, AtomicU64>>,
    commit_s: Histogram,
    notified_after_s: Family<ReceiverLabels, Histogram, fn() -> Histogram>,
    http: HttpMetrics,
    components: ComponentMetrics,
    sample_age_s: Family<MachineLabels, Gauge<f64, AtomicU64>>,
    capacity: Family<WhatLabels, Gauge>,
}

impl Default for StageMetrics {
    fn default() -> Self {
        Self {
            queue_wait_s: Family::new_with_constructor(|| Histogram::new(LATENCY_BOUNDS_S)),
            shard_busy_s: Family::default(),
            commit_s: Histogram::new(LATENCY_BOUNDS_S),
            notified_after_s: Family::new_with_constructor(|| Histogram::new(DELIVERY_BOUNDS_S)),
            http: HttpMetrics {
                answers: Family::default(),
                seconds: Family::new_with_constructor(|| Histogram::new(ANSWER_BOUNDS_S)),
                in_flight: Gauge::default(),
            },
            components: ComponentMetrics::default(),
            sample_age_s: Family::default(),
            capacity: Family::default(),
        }
    }
}

impl StageMetrics {
    pub(super) fn register(&self, registry: &mut Registry) {
        let text = "From the arrival of a block to its being taken by its shard";
        registry.register("queue_wait_seconds", text, self.queue_wait_s.clone());
        let text = "Time in which a shard worked";
        registry.register("shard_busy_seconds", text, self.shard_busy_s.clone());
        let text = "Time of a commit of the store of alarms";
        registry.register("store_commit_seconds", text, self.commit_s.clone());
        let text = "From the storing of a transition to its being taken by a receiver";
        registry.register("notified_after_seconds", text, self.notified_after_s.clone());
        let text = "Time of an answer over HTTP, to its first byte";
        registry.register("http_answer_seconds", text, self.http.seconds.clone());
        let text = "Answers over HTTP";
        registry.register("http_answers", text, self.http.answers.clone());
        let text = "Requests over HTTP that are being answered";
        registry.register("http_in_flight", text, self.http.in_flight.clone());
        let text = "State of a component: 0 undetermined, 1 healthy, 2 warning, 3 damaged";
        registry.register("component_state", text, self.components.state.clone());
        let text = "Severity of a component, 0 to 1";
        registry.register("component_severity", text, self.components.severity.clone());
        let text = "Level of the alarm of a component that asks for somebody: 0 none, 1 warning, 2 damaged";
        registry.register("component_alarm", text, self.components.alarm.clone());
        let text =
            "How long ago the newest sample of a machine came; before the first, since the start";
        registry.register("sample_age_seconds", text, self.sample_age_s.clone());
        let text = "Most there may be at a time";
        registry.register("capacity", text, self.capacity.clone());
    }
}

impl Metrics {
    /// A shard.
    #[must_use]
    pub fn shard(&self, shard: u64) -> ShardMetrics {
        let labels = ShardLabels { shard };
        ShardMetrics {
            queue_bytes: self.queue_bytes.get_or_create_owned(&labels),
            wait_s: self.stages.queue_wait_s.get_or_create_owned(&labels),
            busy_s: self.stages.shard_busy_s.get_or_create_owned(&labels),
        }
    }

    /// Requests over HTTP.
    #[must_use]
    pub fn http(&self) -> HttpMetrics {
        self.stages.http.clone()
    }

    /// What is known of components.
    #[must_use]
    pub fn components(&self) -> ComponentMetrics {
        self.stages.components.clone()
    }

    /// How long ago a machine's newest sample came, s.
    pub(super) fn sample_age_s(&self, labels: &MachineLabels) -> Gauge<f64, AtomicU64> {
        self.stages.sample_age_s.get_or_create_owned(labels)
    }

    /// Times of commits.
    pub(super) fn commit_s(&self) -> Histogram {
        self.stages.commit_s.clone()
    }

    /// How long a receiver's transitions took, s.
    pub(super) fn notified_after_s(&self, labels: &ReceiverLabels) -> Histogram {
        self.stages.notified_after_s.get_or_create_owned(labels)
    }

    /// States how much there may be of something.
    pub fn state_capacity(&self, what: &'static str, most: usize) {
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        self.stages.capacity.get_or_create(&WhatLabels { what }).set(most);
    }
}
