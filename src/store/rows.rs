//! Alarms and events as rows, and back.
//!
//! Stream times are stored as they are, beside the UTC of stream time 0. Who reads says which stream the
//! times shall count from: of one with another start they are moved, so that they still name the
//! same instant; where either start is unknown they stay.

use super::StoreError;
use super::names;
use crate::alarms::Acknowledgement;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::AlarmSource;
use crate::alarms::Deadline;
use crate::alarms::Moment;
use crate::alarms::Signature;
use crate::alarms::Silencing;
use crate::signal::Timestamp;
use rusqlite::Row;
use rusqlite::types::Value;

/// Columns of an alarm, in the order of [`alarm_values`].
pub(super) const ALARM: &str = "start_utc, number, component, kind, source, limit_id, level, state, \
     silence, silence_author, silence_comment, silence_since_s, until_utc, remaining_s, latching, fault, \
     why, severity, confidence, raised_at_s, active_since_s, changed_at_s, occurrences, ack_author, \
     ack_comment, ack_time_s";

/// Columns of an event before those of its alarm, in the order of [`event_values`].
pub(super) const EVENT: &str = "machine, sequence, event, time_s, recorded_utc, author, comment";

/// `?, ?, …` for so many columns as a list names.
pub(super) fn places(columns: &str) -> String {
    vec!["?"; columns.split(',').count()].join(", ")
}

/// Names as one text, each between line ends: what `instr` looks into. No id has a line end.
pub(super) fn names(names: Option<&[String]>) -> Option<String> {
    names.map(|names| names.iter().fold("\n".to_owned(), |text, name| text + name + "\n"))
}

/// An integer of the database; above 2⁶³ none is ever reached by counting.
pub(super) fn whole(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number that was written by [`whole`].
pub(super) fn count(number: i64) -> u64 {
    u64::try_from(number).unwrap_or(0)
}

/// A time; the database would take NaN for nothing.
fn time(time_s: f64) -> Value {
    Value::Real(if time_s.is_finite() { time_s } else { 0.0 })
}

fn text(text: &str) -> Value {
    Value::Text(text.to_owned())
}

fn optional<T>(value: Option<T>, write: impl Fn(T) -> Value) -> Value {
    value.map_or(Value::Null, write)
}

/// An alarm as it stands at `now`.
pub(super) fn alarm_values(alarm: &Alarm, start: Option<Timestamp>, now: Moment) -> Vec<Value> {
    let silencing = alarm.silencing.as_ref();
    let until = silencing.and_then(|silencing| silencing.until);
    let acknowledgement = alarm.acknowledgement.as_ref();
    vec![
        optional(start, |start| Value::Integer(start.0)),
        Value::Integer(whole(alarm.id)),
        text(&alarm.component),
        text(alarm.kind.name()),
        text(alarm.source.name()),
        optional(alarm.source.limit(), text),
        text(alarm.level.name()),
        text(alarm.state.name()),
        optional(silencing, |silencing| text(silencing.silence.name())),
        optional(silencing, |silencing| text(&silencing.author)),
        optional(silencing, |silencing| text(&silencing.comment)),
        optional(silencing, |silencing| time(silencing.since_s)),
        optional(until, |until| Value::Integer(until.utc.0)),
        optional(until, |until| time((until.monotonic_s - now.monotonic_s).max(0.0))),
        Value::Integer(i64::from(alarm.latching)),
        optional(alarm.fault, |fault| text(fault.name())),
        text(&alarm.why),
        optional(alarm.severity, Value::Real),
        optional(alarm.confidence, Value::Real),
        time(alarm.raised_at_s),
        time(alarm.active_since_s),
        time(alarm.changed_at_s),
        Value::Integer(i64::from(alarm.occurrences)),
        optional(acknowledgement, |by| text(&by.author)),
        optional(acknowledgement, |by| text(&by.comment)),
        optional(acknowledgement, |by| time(by.time_s)),
    ]
}

/// An event with its alarm.
pub(super) fn event_values(
    machine: &str,
    event: &AlarmEvent,
    start: Option<Timestamp>,
    now: Moment,
) -> Vec<Value> {
    let mut values = vec![
        text(machine),
        Value::Integer(whole(event.sequence)),
        text(event.kind.name()),
        time(event.time_s),
        Value::Integer(now.utc.0),
        optional(event.by.as_ref(), |by| text(&by.author)),
        optional(event.by.as_ref(), |by| text(&by.comment)),
    ];
    values.extend(alarm_values(&event.alarm, start, now));
    values
}

/// Reads rows for a stream that began at `start`, at `now`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reader {
    pub(super) start: Option<Timestamp>,
    pub(super) now: Moment,
}

impl Reader {
    /// The event of a row of [`EVENT`] and [`ALARM`].
    pub(super) fn event(self, row: &Row<'_>) -> Result<AlarmEvent, StoreError> {
        let alarm = self.alarm(row)?;
        let shift_s = self.shift_s(row)?;
        let author: Option<String> = get(row, "author")?;
        let comment: Option<String> = get(row, "comment")?;
        let by = author.map(|author| Signature { author, comment: comment.unwrap_or_default() });
        Ok(AlarmEvent {
            sequence: count(get(row, "sequence")?),
            kind: named(row, "event", names::event)?,
            time_s: get::<f64>(row, "time_s")? + shift_s,
            by,
            alarm,
        })
    }

    /// The alarm of a row with the columns of [`ALARM`].
    pub(super) fn alarm(self, row: &Row<'_>) -> Result<Alarm, StoreError> {
        let shift_s = self.shift_s(row)?;
        let time = |name| Ok::<_, StoreError>(get::<f64>(row, name)? + shift_s);
        let fault: Option<String> = get(row, "fault")?;
        let fault = fault.map(|text| known("fault", text, names::fault)).transpose()?;
        let author: Option<String> = get(row, "ack_author")?;
        let acknowledgement = match author {
            None => None,
            Some(author) => Some(Acknowledgement {
                author,
                comment: get::<Option<String>>(row, "ack_comment")?.unwrap_or_default(),
                time_s: get::<Option<f64>>(row, "ack_time_s")?.unwrap_or_default() + shift_s,
            }),
        };
        Ok(Alarm {
            id: count(get(row, "number")?),
            component: get(row, "component")?,
            kind: named(row, "kind", names::component_kind)?,
            source: source(row)?,
            level: named(row, "level", names::level)?,
            state: named(row, "state", names::state)?,
            silencing: self.silencing(row, shift_s)?,
            latching: get(row, "latching")?,
            fault,
            why: get(row, "why")?,
            severity: get(row, "severity")?,
            confidence: get(row, "confidence")?,
            raised_at_s: time("raised_at_s")?,
            active_since_s: time("active_since_s")?,
            changed_at_s: time("changed_at_s")?,
            occurrences: get(row, "occurrences")?,
            acknowledgement,
        })
    }

    fn silencing(self, row: &Row<'_>, shift_s: f64) -> Result<Option<Silencing>, StoreError> {
        let Some(kind) = get::<Option<String>>(row, "silence")? else { return Ok(None) };
        let until: Option<i64> = get(row, "until_utc")?;
        let stored_s = get::<Option<f64>>(row, "remaining_s")?.unwrap_or_default();
        let until = until.map(|until| deadline(until, stored_s, self.now));
        Ok(Some(Silencing {
            silence: known("silence", kind, names::silence)?,
            author: get::<Option<String>>(row, "silence_author")?.unwrap_or_default(),
            comment: get::<Option<String>>(row, "silence_comment")?.unwrap_or_default(),
            since_s: get::<Option<f64>>(row, "silence_since_s")?.unwrap_or_default() + shift_s,
            until,
        }))
    }

    /// What is added to the stream times of a row, s.
    fn shift_s(self, row: &Row<'_>) -> Result<f64, StoreError> {
        let stored: Option<i64> = get(row, "start_utc")?;
        Ok(match (stored, self.start) {
            (Some(stored), Some(start)) => stored.saturating_sub(start.0) as f64 * 1e-9,
            (None, _) | (_, None) => 0.0,
        })
    }
}

/// A deadline goes on with the smaller of what was left when it was stored and what is left by the wall clock: a clock
/// that was set may end a silence early, never keep it.
pub(super) fn deadline(until_utc: i64, stored_s: f64, now: Moment) -> Deadline {
    let by_clock_s = until_utc.saturating_sub(now.utc.0) as f64 * 1e-9;
    let left_s = stored_s.min(by_clock_s).max(0.0);
    Deadline { monotonic_s: now.monotonic_s + left_s, utc: Timestamp(until_utc) }
}

fn source(row: &Row<'_>) -> Result<AlarmSource, StoreError> {
    let name: String = get(row, "source")?;
    let limit: Option<String> = get(row, "limit_id")?;
    match (name.as_str(), limit) {
        ("diagnosis", None) => Ok(AlarmSource::Diagnosis),
        ("limit", Some(id)) => Ok(AlarmSource::Limit(id)),
        ("data", None) => Ok(AlarmSource::Data),
        ("store", None) => Ok(AlarmSource::Store),
        _ => Err(StoreError::Unknown { what: "the source", found: name }),
    }
}

/// A value of a row by the name of its column.
pub(super) fn get<T: rusqlite::types::FromSql>(
    row: &Row<'_>,
    name: &'static str,
) -> Result<T, StoreError> {
    row.get(name).map_err(|source| super::opening::failed("reading a row", source))
}

fn named<T>(
    row: &Row<'_>,
    name: &'static str,
    read: fn(&str) -> Option<T>,
) -> Result<T, StoreError> {
    known(name, get(row, name)?, read)
}

/// Reads a name.
pub(super) fn known<T>(
    what: &'static str,
    found: String,
    read: impl Fn(&str) -> Option<T>,
) -> Result<T, StoreError> {
    read(&found).ok_or(StoreError::Unknown { what, found })
}
