//! One thing that can raise an alarm: how its level moves the alarm, and what the alarm says.

use super::alarm::Alarm;
use super::alarm::AlarmSource;
use super::alarm::EventKind;
use super::policy::Level;
use super::policy::LevelTracker;
use super::policy::Settings;
use super::state::AlarmInput;
use super::state::AlarmState;
use super::state::LifeInput;
use super::state::Position;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;

/// A level and, while one is standing, its alarm.
#[derive(Debug, Clone, Default)]
pub(super) struct Slot {
    pub(super) tracker: LevelTracker,
    pub(super) alarm: Option<Alarm>,
    pub(super) cause: CauseDelay,
}

impl Slot {
    /// Goes on with an alarm of before a restart, at its level.
    pub(super) fn restored(alarm: Alarm) -> Self {
        let level = alarm.state.is_active().then_some(alarm.level);
        Self { tracker: LevelTracker::at(level), alarm: Some(alarm), ..Self::default() }
    }

    /// Takes up delays of before a restart, unless they speak of another condition than the alarm.
    pub(super) fn go_on(&mut self, tracker: LevelTracker) {
        if tracker.level().is_some() == self.tracker.level().is_some() {
            self.tracker = tracker;
        }
    }
}

/// Evidence time for which verdicts have said another cause than the one an alarm names.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CauseDelay {
    other_s: f64,
}

impl CauseDelay {
    /// Whether an alarm takes over what this verdict says of its cause.
    ///
    /// A cause that was named stands for as long as the alarm itself would without evidence
    /// ([`Settings::off_delay_s`]): the one window in which damage comes or is mended mixes two
    /// conditions and proves neither. A verdict that names the same cause, or is worse than all
    /// before it, is taken over at once.
    pub(super) fn takes(
        &mut self,
        alarm: &Alarm,
        component: &ComponentDiagnosis,
        evidence_s: f64,
        settings: &Settings,
    ) -> bool {
        if !component.state.is_accusation() {
            return false;
        }
        self.other_s += evidence_s;
        let open = alarm.fault.is_none() || !alarm.state.is_active();
        let same = alarm.fault == component.fault;
        let worse = component.state == State::Damaged && alarm.level == Level::Warning;
        let takes = open || same || worse || self.other_s >= settings.off_delay_s;
        if takes {
            self.other_s = 0.0;
        }
        takes
    }
}

/// What an alarm says when it is raised.
#[derive(Debug)]
pub(super) struct Finding {
    pub(super) component: String,
    pub(super) kind: ComponentKind,
    pub(super) source: AlarmSource,
    pub(super) latching: bool,
    pub(super) fault: Option<FaultMode>,
    pub(super) why: String,
    pub(super) severity: Option<f64>,
    pub(super) confidence: Option<f64>,
}

impl Finding {
    /// What a verdict says.
    pub(super) fn of(component: &ComponentDiagnosis) -> Self {
        Self {
            component: component.id.clone(),
            kind: component.kind,
            source: AlarmSource::Diagnosis,
            latching: false,
            fault: component.fault,
            why: component.why.clone(),
            severity: component.severity,
            confidence: component.confidence,
        }
    }
}

impl Alarm {
    /// Takes over what an accusing verdict says.
    pub(super) fn take_over(&mut self, component: &ComponentDiagnosis) {
        self.fault = component.fault;
        self.why.clone_from(&component.why);
        self.severity = component.severity;
        self.confidence = component.confidence;
    }
}

/// Moves an alarm to `level` at stream time `time_s` and gives what happened, with the alarm after
/// it. `finding` is asked only when an alarm is raised, comes again or rises.
pub(super) fn transition(
    slot: &mut Option<Alarm>,
    level: Option<Level>,
    time_s: f64,
    next_id: &mut u64,
    finding: &dyn Fn() -> Finding,
) -> Option<(EventKind, Alarm)> {
    let Some(level) = level else { return end(slot, time_s) };
    let Some(alarm) = slot else {
        let alarm = raise(finding(), level, time_s, *next_id);
        *next_id += 1;
        *slot = Some(alarm.clone());
        return Some((EventKind::Raised, alarm));
    };
    let before = (alarm.state, alarm.level);
    // A latching alarm keeps its highest level until it is reset.
    let level = if alarm.latching { level.max(alarm.level) } else { level };
    let (input, kind) = if !alarm.state.is_active() {
        (LifeInput::Active, EventKind::Raised)
    } else if level > alarm.level {
        (LifeInput::Escalated, EventKind::Escalated)
    } else {
        (LifeInput::Active, EventKind::DeEscalated)
    };
    let after = alarm.position().after(AlarmInput::Life(input), alarm.latching).ok()?;
    (alarm.state, alarm.level) = (after.life, level);
    if (alarm.state, alarm.level) == before {
        return None;
    }
    if kind == EventKind::Raised {
        alarm.occurrences = alarm.occurrences.saturating_add(1);
        alarm.active_since_s = time_s;
    }
    let is_worse = matches!(kind, EventKind::Raised | EventKind::Escalated);
    if is_worse && alarm.source != AlarmSource::Diagnosis {
        alarm.why = finding().why;
    }
    alarm.changed_at_s = time_s;
    Some((kind, alarm.clone()))
}

/// Ends the condition of an alarm at stream time `time_s`, if one is standing and it is present.
fn end(slot: &mut Option<Alarm>, time_s: f64) -> Option<(EventKind, Alarm)> {
    let alarm = slot.as_mut().filter(|alarm| alarm.state.is_active())?;
    let kind = kind_of_going(alarm);
    let cleared = AlarmInput::Life(LifeInput::Cleared);
    let after = alarm.position().after(cleared, alarm.latching).ok()?;
    alarm.state = after.life;
    alarm.changed_at_s = time_s;
    let alarm = alarm.clone();
    if after.is_over() {
        *slot = None;
    }
    Some((kind, alarm))
}

/// Ends an alarm of what is no longer configured.
pub(super) fn remove(mut alarm: Alarm, time_s: f64) -> Option<(EventKind, Alarm)> {
    let after = alarm.position().after(AlarmInput::Removed, alarm.latching).ok()?;
    (alarm.state, alarm.silencing) = (after.life, None);
    alarm.changed_at_s = time_s;
    Some((EventKind::ConfigurationRemoved, alarm))
}

/// What it is called when the condition of an alarm goes.
fn kind_of_going(alarm: &Alarm) -> EventKind {
    match alarm.state {
        AlarmState::Acknowledged if alarm.latching => EventKind::Latched,
        AlarmState::Acknowledged => EventKind::Cleared,
        AlarmState::Normal
        | AlarmState::Unacknowledged
        | AlarmState::ReturnedUnacknowledged
        | AlarmState::Latched => EventKind::Returned,
    }
}

fn raise(finding: Finding, level: Level, time_s: f64, id: u64) -> Alarm {
    let active = AlarmInput::Life(LifeInput::Active);
    let raised = Position::NORMAL.after(active, finding.latching);
    Alarm {
        id,
        component: finding.component,
        kind: finding.kind,
        source: finding.source,
        level,
        state: raised.map_or(AlarmState::Unacknowledged, |position| position.life),
        silencing: None,
        latching: finding.latching,
        fault: finding.fault,
        why: finding.why,
        severity: finding.severity,
        confidence: finding.confidence,
        raised_at_s: time_s,
        active_since_s: time_s,
        changed_at_s: time_s,
        occurrences: 1,
        acknowledgement: None,
    }
}
