//! How much the alarm system asks of an operator: alarms an hour, floods, chatter, stale alarms, which
//! came first.
//!
//! Counted in stream time from the events held, so a replay at any speed has the load of its
//! recording. Figures of ISA-18.2 and EEMUA 191: a flood is more than 10 alarms in 10 min, an alarm
//! chatters with 3 transitions in 60 s and is stale after 24 h. What is silent asks for nothing.

use super::alarm::Alarm;
use super::alarm::AlarmEvent;
use super::alarm::EventKind;
use super::state::AlarmState;
use crate::diagnosis::fault::ComponentKind;
use std::collections::BTreeMap;
use std::collections::VecDeque;

/// An hour, s.
const HOUR_S: f64 = 3600.0;

/// Time over which a flood is counted, s.
pub const FLOOD_S: f64 = 600.0;

/// More alarms than this within [`FLOOD_S`] are a flood.
pub const FLOOD_ALARMS: usize = 10;

/// Time within which an alarm chatters, s.
pub const CHATTER_S: f64 = 60.0;

/// Comings and goings within [`CHATTER_S`] that make an alarm chatter.
pub const CHATTER_TRANSITIONS: usize = 3;

/// A condition that has been present for longer than this is stale, s.
pub const STALE_S: f64 = 86_400.0;

/// The load of one machine's alarms.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Load {
    /// Alarms annunciated within the last hour.
    pub last_hour: usize,
    /// Alarms annunciated within the last ten minutes.
    pub last_ten_minutes: usize,
    /// Alarms that came and went [`CHATTER_TRANSITIONS`] times within [`CHATTER_S`] in the last hour,
    /// rising.
    pub chattering: Vec<u64>,
    /// Standing alarms whose condition is present for longer than [`STALE_S`], rising.
    pub stale: Vec<u64>,
    /// Of the conditions that are present and nobody has acknowledged, the one that came first.
    pub first_out: Option<u64>,
}

impl Load {
    /// Whether it is a flood.
    #[must_use]
    pub fn is_flood(&self) -> bool {
        self.last_ten_minutes > FLOOD_ALARMS
    }
}

/// Whether an event asks an operator to look.
fn is_annunciated(event: &AlarmEvent) -> bool {
    if event.alarm.silencing.is_some() {
        return false;
    }
    match event.kind {
        EventKind::Raised | EventKind::Escalated => true,
        EventKind::Unshelved | EventKind::Unsuppressed | EventKind::ReturnedToService => {
            event.alarm.state == AlarmState::Unacknowledged
        }
        EventKind::DeEscalated
        | EventKind::Returned
        | EventKind::Acknowledged
        | EventKind::Latched
        | EventKind::Reset
        | EventKind::Cleared
        | EventKind::Shelved
        | EventKind::Suppressed
        | EventKind::RemovedFromService
        | EventKind::ConfigurationRemoved => false,
    }
}

/// Whether an event is a coming or going of a condition, not an act.
fn is_condition(event: &AlarmEvent) -> bool {
    let moves = matches!(
        event.kind,
        EventKind::Raised | EventKind::Returned | EventKind::Cleared | EventKind::Latched
    );
    moves && event.by.is_none()
}

/// What an alarm is about, whatever its id: kind, component, limit.
type Subject<'a> = (ComponentKind, &'a str, Option<&'a str>);

/// Counts the load at stream time `now_s` from the events held, oldest first, and the standing alarms.
#[must_use]
pub fn of(history: &VecDeque<AlarmEvent>, standing: &[Alarm], now_s: f64) -> Load {
    // An event of a stream whose start is not known may lie ahead after a restart.
    let within = |span_s: f64| {
        history.iter().filter(move |event| (0.0..=span_s).contains(&(now_s - event.time_s)))
    };
    let annunciated = |span_s: f64| within(span_s).filter(|e| is_annunciated(e)).count();
    let mut moves: BTreeMap<Subject<'_>, Vec<(f64, u64)>> = BTreeMap::new();
    for event in within(HOUR_S).filter(|e| is_condition(e) && e.alarm.silencing.is_none()) {
        let alarm = &event.alarm;
        let subject = (alarm.kind, alarm.component.as_str(), alarm.source.limit());
        moves.entry(subject).or_default().push((event.time_s, alarm.id));
    }
    let chatters = |moves: &Vec<(f64, u64)>| {
        let mut runs = moves.windows(CHATTER_TRANSITIONS);
        let found = runs.rfind(|run| run[run.len() - 1].0 - run[0].0 <= CHATTER_S)?;
        Some(found[found.len() - 1].1)
    };
    let mut chattering: Vec<u64> = moves.values().filter_map(chatters).collect();
    chattering.sort_unstable();
    let asking = |alarm: &&Alarm| alarm.state.is_active() && alarm.silencing.is_none();
    let active = || standing.iter().filter(asking);
    let mut stale: Vec<u64> =
        active().filter(|alarm| now_s - alarm.active_since_s > STALE_S).map(|a| a.id).collect();
    stale.sort_unstable();
    let first = active()
        .filter(|alarm| alarm.state == AlarmState::Unacknowledged)
        .min_by(|a, b| a.active_since_s.total_cmp(&b.active_since_s).then(a.id.cmp(&b.id)));
    Load {
        last_hour: annunciated(HOUR_S),
        last_ten_minutes: annunciated(FLOOD_S),
        chattering,
        stale,
        first_out: first.map(|alarm| alarm.id),
    }
}
