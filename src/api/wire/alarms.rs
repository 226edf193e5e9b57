//! Alarms and their events as JSON.

use super::names::{AlarmStateName, EventName, FaultName, KindName, LevelName};
use super::{finite, rfc3339};
use crate::alarms::{Alarm, AlarmEvent};
use crate::signal::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// One alarm.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmWire {
    /// `machine:number`, unique among all machines and never used again.
    pub id: String,
    /// Machine id.
    pub machine: String,
    /// Component's id.
    pub component: String,
    /// Component's kind.
    pub kind: KindName,
    /// Level now, or the last one when the condition is gone.
    pub level: LevelName,
    /// State.
    pub state: AlarmStateName,
    /// Fault; null: cause not proven.
    pub fault: Option<FaultName>,
    /// One plain sentence.
    pub why: String,
    /// Effect size, 0…1.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
    /// When it was first raised.
    pub raised_at: String,
    /// The same in seconds of stream time.
    pub raised_at_s: Option<f64>,
    /// When it last changed.
    pub changed_at: String,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// How often the condition came.
    pub occurrences: u32,
    /// The last acknowledgement.
    pub acknowledgement: Option<AcknowledgementWire>,
}

/// Who acknowledged, when and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct AcknowledgementWire {
    /// Who.
    pub author: String,
    /// Why.
    pub comment: String,
    /// When, in stream time.
    pub time: String,
}

/// Alarms that stand.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmListWire {
    /// Newest first within a machine, machines in the order of their ids.
    pub items: Vec<AlarmWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

/// One event.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmEventWire {
    /// Number within the machine, without holes.
    pub sequence: u64,
    /// What happened.
    pub event: EventName,
    /// When, in stream time.
    pub time: String,
    /// The same in seconds of stream time.
    pub time_s: Option<f64>,
    /// The alarm right after.
    pub alarm: AlarmWire,
}

/// Events held in memory.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmHistoryWire {
    /// Newest first within a machine, machines in the order of their ids.
    pub items: Vec<AlarmEventWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
    /// Older events of the machines asked for that are no longer held.
    pub dropped: u64,
}

/// An operator's acknowledgement.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AcknowledgeBody {
    /// Who acknowledges; not empty.
    #[schema(min_length = 1, max_length = 2000)]
    pub author: String,
    /// Why, or what was done.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub comment: String,
}

impl AlarmWire {
    /// Makes the JSON of an alarm of `machine`, whose stream began at `start`.
    #[must_use]
    pub fn new(machine: &str, alarm: &Alarm, start: Option<Timestamp>) -> Self {
        Self {
            id: alarm_id(machine, alarm.id),
            machine: machine.to_owned(),
            component: alarm.component.clone(),
            kind: alarm.kind.into(),
            level: alarm.level.into(),
            state: alarm.state.into(),
            fault: alarm.fault.map(Into::into),
            why: alarm.why.clone(),
            severity: alarm.severity.and_then(finite),
            confidence: alarm.confidence.and_then(finite),
            raised_at: rfc3339(start, alarm.raised_at_s),
            raised_at_s: finite(alarm.raised_at_s),
            changed_at: rfc3339(start, alarm.changed_at_s),
            time_unknown: start.is_none(),
            occurrences: alarm.occurrences,
            acknowledgement: alarm.acknowledgement.as_ref().map(|a| AcknowledgementWire {
                author: a.author.clone(),
                comment: a.comment.clone(),
                time: rfc3339(start, a.time_s),
            }),
        }
    }
}

impl AlarmEventWire {
    /// Makes the JSON of an event on `machine`, whose stream began at `start`.
    #[must_use]
    pub fn new(machine: &str, event: &AlarmEvent, start: Option<Timestamp>) -> Self {
        Self {
            sequence: event.sequence,
            event: event.kind.into(),
            time: rfc3339(start, event.time_s),
            time_s: finite(event.time_s),
            alarm: AlarmWire::new(machine, &event.alarm, start),
        }
    }
}

/// Gives an alarm's id across machines.
#[must_use]
pub fn alarm_id(machine: &str, number: u64) -> String {
    format!("{machine}:{number}")
}

/// Reads an id made by [`alarm_id`].
#[must_use]
pub fn parse_alarm_id(id: &str) -> Option<(&str, u64)> {
    let (machine, number) = id.rsplit_once(':')?;
    let all_digits = !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit());
    all_digits.then(|| number.parse().ok()).flatten().map(|number| (machine, number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_machines_with_any_name_round_trip() {
        for machine in ["rig-1", "a:b", ""] {
            assert_eq!(parse_alarm_id(&alarm_id(machine, 12)), Some((machine, 12)));
        }
        for wrong in ["12", "rig:", "rig:x", "rig:-1", "rig:+1", "rig:99999999999999999999"] {
            assert_eq!(parse_alarm_id(wrong), None, "{wrong}");
        }
    }
}
