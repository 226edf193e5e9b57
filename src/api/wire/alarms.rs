//! Alarms and their events as JSON.

use super::captures::CaptureLinkWire;
use super::names::{AlarmStateName, EventName, FaultName, KindName, LevelName};
use super::{finite, rfc3339};
use crate::alarms::load::Load;
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
    /// Component's id; of missing data the channel.
    pub component: String,
    /// Component's kind.
    pub kind: KindName,
    /// What raised it: `diagnosis`, `limit`, `data` (none come) or `store` (it takes none).
    pub source: String,
    /// Id of the limit in the machine file; null for other sources.
    pub limit: Option<String>,
    /// Level now, or the last one when the condition is gone; of a latching alarm the highest.
    pub level: LevelName,
    /// State; shelved, suppressed and out of service before the others.
    pub state: AlarmStateName,
    /// Whether the condition is present, whatever the state.
    pub active: bool,
    /// Whether it waits for a reset when the condition is gone.
    pub latching: bool,
    /// Who silenced it; null if it is not.
    pub silenced: Option<SilencedWire>,
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
    /// When its condition came last.
    pub active_since: String,
    /// When it last changed.
    pub changed_at: String,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// How often the condition came.
    pub occurrences: u32,
    /// The last acknowledgement.
    pub acknowledgement: Option<AcknowledgementWire>,
    /// The raw data around it, or why there are none; null in events, and where nothing is known of it yet.
    pub capture: Option<CaptureLinkWire>,
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

/// Who silenced an alarm, why and until when.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct SilencedWire {
    /// Who.
    pub author: String,
    /// Why.
    pub comment: String,
    /// Since when, in stream time.
    pub since: String,
    /// Until when, UTC, if the clock is not set; null: not by itself.
    pub until: Option<String>,
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
    /// Who did it; null: it was observed, or its time had come.
    pub author: Option<String>,
    /// Why.
    pub comment: Option<String>,
    /// The alarm right after.
    pub alarm: AlarmWire,
}

/// Events, of before a restart too.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmHistoryWire {
    /// Newest first within a machine, machines in the order of their ids.
    pub items: Vec<AlarmEventWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
    /// Older events of the machines asked for that are held nowhere any more.
    pub dropped: u64,
}

/// One alarm with all that happened to it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmDetailWire {
    /// The alarm.
    #[serde(flatten)]
    pub alarm: AlarmWire,
    /// What happened to it, newest first, at most 1000.
    pub transitions: Vec<TransitionWire>,
    /// What operators did to it, newest first; these are transitions too.
    pub actions: Vec<ActionWire>,
}

/// One thing that happened to an alarm.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TransitionWire {
    /// Number within the machine.
    pub sequence: u64,
    /// What happened.
    pub event: EventName,
    /// When, in stream time.
    pub time: String,
    /// Level right after.
    pub level: LevelName,
    /// State right after.
    pub state: AlarmStateName,
}

/// One thing an operator did.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ActionWire {
    /// Number of the transition within the machine.
    pub sequence: u64,
    /// What.
    pub event: EventName,
    /// When, in stream time.
    pub time: String,
    /// Who.
    pub author: String,
    /// Why.
    pub comment: String,
}

/// What the alarms ask of an operator.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct AlarmLoadWire {
    /// Alarms annunciated within the last hour, all machines together.
    pub last_hour: usize,
    /// Alarms annunciated within the last ten minutes.
    pub last_ten_minutes: usize,
    /// Whether more than 10 came in ten minutes.
    pub flood: bool,
    /// Alarms that came and went three times within 60 s in the last hour.
    pub chattering: Vec<String>,
    /// Alarms whose condition has been present for more than 24 h.
    pub stale: Vec<String>,
    /// One entry a machine.
    pub machines: Vec<MachineLoadWire>,
}

/// What the alarms of one machine ask of an operator, in its stream time.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct MachineLoadWire {
    /// Machine id.
    pub machine: String,
    /// Alarms annunciated within the last hour.
    pub last_hour: usize,
    /// Alarms annunciated within the last ten minutes.
    pub last_ten_minutes: usize,
    /// Whether more than 10 came in ten minutes.
    pub flood: bool,
    /// Of the conditions present that nobody has acknowledged, the one that came first; null if there
    /// is none.
    pub first_out: Option<String>,
}

/// An operator's act.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ActBody {
    /// Who acts, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// Why, or what was done.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub comment: String,
}

/// An operator puts an alarm on the shelf.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ShelveBody {
    /// Who acts, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// Why.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub comment: String,
    /// For how long, s; above 0, at most `alarms.max_shelving_s` of the configuration.
    pub for_s: f64,
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
            source: alarm.source.name().to_owned(),
            limit: alarm.source.limit().map(str::to_owned),
            level: alarm.level.into(),
            state: alarm.shown().into(),
            active: alarm.state.is_active(),
            latching: alarm.latching,
            silenced: alarm.silencing.as_ref().map(|silencing| SilencedWire {
                author: silencing.author.clone(),
                comment: silencing.comment.clone(),
                since: rfc3339(start, silencing.since_s),
                until: silencing.until.map(|until| rfc3339(Some(until.utc), 0.0)),
            }),
            fault: alarm.fault.map(Into::into),
            why: alarm.why.clone(),
            severity: alarm.severity.and_then(finite),
            confidence: alarm.confidence.and_then(finite),
            raised_at: rfc3339(start, alarm.raised_at_s),
            raised_at_s: finite(alarm.raised_at_s),
            active_since: rfc3339(start, alarm.active_since_s),
            changed_at: rfc3339(start, alarm.changed_at_s),
            time_unknown: start.is_none(),
            occurrences: alarm.occurrences,
            acknowledgement: alarm.acknowledgement.as_ref().map(|a| AcknowledgementWire {
                author: a.author.clone(),
                comment: a.comment.clone(),
                time: rfc3339(start, a.time_s),
            }),
            capture: None,
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
            author: event.by.as_ref().map(|by| by.author.clone()),
            comment: event.by.as_ref().map(|by| by.comment.clone()),
            alarm: AlarmWire::new(machine, &event.alarm, start),
        }
    }
}

impl AlarmDetailWire {
    /// Makes the JSON of an alarm of `machine`, whose stream began at `start`, with its events, newest
    /// first.
    #[must_use]
    pub fn new(
        machine: &str,
        alarm: &Alarm,
        events: &[AlarmEvent],
        start: Option<Timestamp>,
    ) -> Self {
        let transition = |event: &AlarmEvent| TransitionWire {
            sequence: event.sequence,
            event: event.kind.into(),
            time: rfc3339(start, event.time_s),
            level: event.alarm.level.into(),
            state: event.alarm.shown().into(),
        };
        let action = |event: &AlarmEvent| {
            event.by.as_ref().map(|by| ActionWire {
                sequence: event.sequence,
                event: event.kind.into(),
                time: rfc3339(start, event.time_s),
                author: by.author.clone(),
                comment: by.comment.clone(),
            })
        };
        Self {
            alarm: AlarmWire::new(machine, alarm, start),
            transitions: events.iter().map(transition).collect(),
            actions: events.iter().filter_map(action).collect(),
        }
    }
}

impl MachineLoadWire {
    /// Makes the JSON of the load of `machine`.
    #[must_use]
    pub fn new(machine: &str, load: &Load) -> Self {
        Self {
            machine: machine.to_owned(),
            last_hour: load.last_hour,
            last_ten_minutes: load.last_ten_minutes,
            flood: load.is_flood(),
            first_out: load.first_out.map(|number| alarm_id(machine, number)),
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
