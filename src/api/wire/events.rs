//! What is pushed as JSON: transitions and changes of health, as events, webhook messages and MQTT payloads.

use super::alarms::{AlarmEventWire, AlarmWire};
use super::machines::{ComponentHealthWire, HealthWire};
use super::names::{FaultName, KindName, OperatingStateName, StateName};
use super::{finite, rfc3339};
use crate::alarms::AlarmEvent;
use crate::notify::{self, HealthChange, Subject};
use crate::signal::Timestamp;
use crate::store::events::{Happened, LogEntry};
use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// Name and version of [`TransitionMessageWire`].
pub const SCHEMA: &str = "rotorwatch.notification/1";

/// A transition of an alarm, as it is pushed.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TransitionMessageWire {
    /// `rotorwatch.notification/1`.
    pub schema: String,
    /// `machine#number`: the same however often it is sent. While it is not stored, `machine#number@…`: it is sent
    /// again, under its own id, when it is.
    pub id: String,
    /// Whether it is stored; false: the store refuses, and should the daemon be killed now, it is not in the history.
    pub stored: bool,
    /// Its place among everything that happened; rises; 0 while it is not stored.
    pub place: u64,
    /// Machine id.
    pub machine: String,
    /// When it was stored, or handed to the store that refuses, wall clock.
    pub recorded_at: String,
    /// The transition, with the alarm right after.
    #[serde(flatten)]
    pub event: AlarmEventWire,
}

/// A change of the health of a component or machine.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct HealthChangeWire {
    /// Its place among everything that happened; rises.
    pub place: u64,
    /// Machine id.
    pub machine: String,
    /// When it was stored, wall clock.
    pub recorded_at: String,
    /// Component's kind; null: the machine as a whole.
    pub kind: Option<KindName>,
    /// Component's id; null: the machine as a whole.
    pub component: Option<String>,
    /// State now.
    pub state: StateName,
    /// State before; null: the first verdict.
    pub before: Option<StateName>,
    /// Strongest fault.
    pub fault: Option<FaultName>,
    /// When, in stream time.
    pub time: String,
    /// The same in seconds of stream time.
    pub time_s: Option<f64>,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// Effect size, 0…1.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
    /// One plain sentence; empty for the machine as a whole.
    pub why: String,
}

/// What became of a configuration that was read while the daemon ran.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ConfigurationChangeWire {
    /// Its place among everything that happened; rises.
    pub place: u64,
    /// `config_applied`, `config_rejected` (that of before holds) or `machine_rebuilt`.
    pub event: String,
    /// Machine id; null: it concerns the daemon as a whole.
    pub machine: Option<String>,
    /// When it was stored, wall clock.
    pub recorded_at: String,
    /// Hash of the configuration that holds after it.
    pub configuration_hash: String,
    /// What has changed, what waits for a restart, or why it was refused.
    pub why: String,
}

/// What became of the maintenance of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct MaintenanceChangeWire {
    /// Its place among everything that happened; rises.
    pub place: u64,
    /// `maintenance_began`, `maintenance_ended` (somebody ended it) or `maintenance_over` (its time is over).
    pub event: String,
    /// Machine id.
    pub machine: String,
    /// When it was stored, wall clock.
    pub recorded_at: String,
    /// Who said it.
    pub author: String,
    /// Why.
    pub reason: String,
    /// When it ends, or was to end.
    pub until: Option<String>,
}

/// What was measured in the window that was judged last.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct WindowFeaturesWire {
    /// Machine id.
    pub machine: String,
    /// End of the window, in stream time.
    pub time: String,
    /// The same in seconds of stream time.
    pub time_s: Option<f64>,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// Each channel with a feature that was asked for.
    pub channels: Vec<ChannelFeaturesWire>,
}

/// Features of a channel in one window, in columns.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ChannelFeaturesWire {
    /// Channel.
    pub channel: String,
    /// First sample.
    pub start_sample: u64,
    /// Samples.
    pub n_samples: u64,
    /// Names.
    pub name: Vec<String>,
    /// Units.
    pub unit: Vec<String>,
    /// Values.
    pub value: Vec<Option<f64>>,
}

/// Where a stream of events begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct PlaceWire {
    /// The place after which events follow.
    pub place: u64,
}

/// The state of a machine as it stands in its MQTT topic.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct MachineStateWire {
    /// Machine id.
    pub machine: String,
    /// State of the whole.
    pub state: StateName,
    /// Since when.
    pub since: Option<String>,
    /// Whether it runs.
    pub operating_state: OperatingStateName,
    /// starting, running, finished or failed.
    pub source: String,
    /// Why it failed.
    pub reason: Option<String>,
}

/// The state of a component as it stands in its MQTT topic.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ComponentStateWire {
    /// Machine id.
    pub machine: String,
    /// The component.
    #[serde(flatten)]
    pub component: ComponentHealthWire,
}

/// What happened, by what it is.
#[derive(Debug, Clone, PartialEq)]
pub enum HappenedWire {
    /// A transition.
    Alarm(Box<TransitionMessageWire>),
    /// A change of health.
    Health(Box<HealthChangeWire>),
    /// A configuration.
    Configuration(Box<ConfigurationChangeWire>),
    /// A maintenance.
    Maintenance(Box<MaintenanceChangeWire>),
}

impl HappenedWire {
    /// Makes the JSON of an entry of the log.
    #[must_use]
    pub fn new(entry: &LogEntry) -> Self {
        match &entry.what {
            Happened::Alarm(event) => {
                Self::Alarm(Box::new(TransitionMessageWire::new(entry, event)))
            }
            Happened::Health(change) => {
                Self::Health(Box::new(HealthChangeWire::new(entry, change)))
            }
            Happened::Configuration(change) => {
                Self::Configuration(Box::new(ConfigurationChangeWire {
                    place: entry.place,
                    event: change.outcome.name().to_owned(),
                    machine: change.machine.clone(),
                    recorded_at: utc(entry.recorded),
                    configuration_hash: change.hash.clone(),
                    why: change.text.clone(),
                }))
            }
            Happened::Maintenance(change) => Self::Maintenance(Box::new(MaintenanceChangeWire {
                place: entry.place,
                event: change.outcome.name().to_owned(),
                machine: entry.machine.clone(),
                recorded_at: utc(entry.recorded),
                author: change.author.clone(),
                reason: change.reason.clone(),
                until: change.until.map(utc),
            })),
        }
    }

    /// Its name among events.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Alarm(_) => "alarm",
            Self::Health(_) => "health",
            Self::Configuration(_) => "configuration",
            Self::Maintenance(_) => "maintenance",
        }
    }

    /// As text.
    ///
    /// # Errors
    /// Never: these documents have a JSON form.
    pub fn text(&self) -> Result<String, serde_json::Error> {
        match self {
            Self::Alarm(message) => serde_json::to_string(message),
            Self::Health(change) => serde_json::to_string(change),
            Self::Configuration(change) => serde_json::to_string(change),
            Self::Maintenance(change) => serde_json::to_string(change),
        }
    }
}

impl TransitionMessageWire {
    /// Makes the JSON of a transition that stands in `entry`.
    #[must_use]
    pub fn new(entry: &LogEntry, event: &AlarmEvent) -> Self {
        let (machine, number) = (&entry.machine, event.sequence);
        let id = match entry.refused_since {
            None => notify::event_id(machine, number),
            Some(since) => notify::unstored_id(machine, number, since),
        };
        Self {
            schema: SCHEMA.to_owned(),
            id,
            stored: entry.refused_since.is_none(),
            place: entry.place,
            machine: entry.machine.clone(),
            recorded_at: utc(entry.recorded),
            event: AlarmEventWire::new(&entry.machine, event, entry.start),
        }
    }
}

impl HealthChangeWire {
    fn new(entry: &LogEntry, change: &HealthChange) -> Self {
        let (kind, component) = match &change.subject {
            Subject::Machine => (None, None),
            Subject::Component(kind, id) => (Some((*kind).into()), Some(id.clone())),
        };
        Self {
            place: entry.place,
            machine: entry.machine.clone(),
            recorded_at: utc(entry.recorded),
            kind,
            component,
            state: change.health.state.into(),
            before: change.before.map(Into::into),
            fault: change.health.fault.map(Into::into),
            time: rfc3339(entry.start, change.time_s),
            time_s: finite(change.time_s),
            time_unknown: entry.start.is_none(),
            severity: change.severity.and_then(finite),
            confidence: change.confidence.and_then(finite),
            why: change.why.clone(),
        }
    }
}

/// The payloads of a machine's retained state topics but its alarms, with whose they are.
///
/// # Errors
/// Never: these documents have a JSON form.
pub fn state_payloads(health: &HealthWire) -> Result<Vec<(Subject, String)>, serde_json::Error> {
    let whole = MachineStateWire {
        machine: health.machine.clone(),
        state: health.state,
        since: health.since.clone(),
        operating_state: health.operating_state,
        source: health.data.source.clone(),
        reason: health.data.reason.clone(),
    };
    let mut payloads = vec![(Subject::Machine, serde_json::to_string(&whole)?)];
    for component in &health.components {
        let subject = Subject::Component(component.kind.into(), component.id.clone());
        let machine = health.machine.clone();
        let wire = ComponentStateWire { machine, component: component.clone() };
        payloads.push((subject, serde_json::to_string(&wire)?));
    }
    Ok(payloads)
}

/// The payload of the topic of an alarm.
///
/// # Errors
/// Never: this document has a JSON form.
pub fn alarm_payload(alarm: &AlarmWire) -> Result<String, serde_json::Error> {
    serde_json::to_string(alarm)
}

fn utc(at: Timestamp) -> String {
    rfc3339(Some(at), 0.0)
}
