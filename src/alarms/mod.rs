//! Diagnosis → operator: one alarm per component, its life in the words of ISA-18.2.
//!
//! [`AlarmEngine::observe`] takes verdicts, [`AlarmEngine::acknowledge`] takes operators' acts, both
//! with stream time as an argument; everything that happens is an [`AlarmEvent`]. Must not know
//! where verdicts come from, how alarms are shown, or what time it is.

pub mod state;
pub mod policy;

pub use policy::{Level, Settings};

use crate::diagnosis::fault::{ComponentKind, FaultMode, State};
use crate::diagnosis::verdict::{ComponentDiagnosis, Diagnosis};
use policy::{LevelTracker, Observation};
use state::{AlarmInput, AlarmState};
use std::collections::{BTreeMap, VecDeque};

/// Longest author or comment an operator may leave, in characters.
pub const MAX_TEXT_CHARS: usize = 2000;

/// Who acknowledged, when and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Acknowledgement {
    /// Who.
    pub author: String,
    /// Why; may be empty.
    pub comment: String,
    /// Stream time, s.
    pub time_s: f64,
}

/// One alarm: from the raising of a condition until it is both gone and acknowledged.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    /// Unique within the machine, never used again.
    pub id: u64,
    /// Component's id.
    pub component: String,
    /// Component's kind.
    pub kind: ComponentKind,
    /// Level now, or the last one when the condition is gone.
    pub level: Level,
    /// State.
    pub state: AlarmState,
    /// Fault of the accusing verdict it rests on: the newest, except that a named cause outlasts
    /// accusations that say otherwise for less than the off-delay. `None`: cause not proven.
    pub fault: Option<FaultMode>,
    /// Sentence of that verdict.
    pub why: String,
    /// Severity of that verdict.
    pub severity: Option<f64>,
    /// Confidence of that verdict.
    pub confidence: Option<f64>,
    /// Stream time at which it was first raised, s.
    pub raised_at_s: f64,
    /// Stream time of its last event, s.
    pub changed_at_s: f64,
    /// How often the condition came, ≥ 1.
    pub occurrences: u32,
    /// The last acknowledgement; an escalation or return of the condition asks for a new one.
    pub acknowledgement: Option<Acknowledgement>,
}

impl Alarm {
    /// Takes over what an accusing verdict says.
    fn take_over(&mut self, component: &ComponentDiagnosis) {
        self.fault = component.fault;
        self.why.clone_from(&component.why);
        self.severity = component.severity;
        self.confidence = component.confidence;
    }
}

/// What happened to an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// The condition came.
    Raised,
    /// Warning became damaged.
    Escalated,
    /// Damaged became warning.
    DeEscalated,
    /// The condition went before anybody acknowledged it.
    Returned,
    /// An operator acknowledged.
    Acknowledged,
    /// Gone and acknowledged: the alarm is over.
    Cleared,
}

impl EventKind {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raised => "raised",
            Self::Escalated => "escalated",
            Self::DeEscalated => "de_escalated",
            Self::Returned => "returned",
            Self::Acknowledged => "acknowledged",
            Self::Cleared => "cleared",
        }
    }
}

/// A transition of an alarm.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmEvent {
    /// Number of the event within the machine, from 1, without holes.
    pub sequence: u64,
    /// What happened.
    pub kind: EventKind,
    /// Stream time, s.
    pub time_s: f64,
    /// The alarm right after.
    pub alarm: Alarm,
}

/// Why an operator's action was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ActionError {
    /// No such alarm is standing.
    #[error("no alarm {id} is standing: it is unknown or already over")]
    UnknownAlarm {
        /// The id asked for.
        id: u64,
    },
    /// Somebody was first.
    #[error("alarm {id} is already acknowledged by {author}")]
    AlreadyAcknowledged {
        /// The alarm.
        id: u64,
        /// Who acknowledged it.
        author: String,
    },
    /// An acknowledgement must be signed.
    #[error("the author of an acknowledgement must not be empty")]
    NoAuthor,
    /// Author or comment is too long.
    #[error("{field} has {found} characters, at most {MAX_TEXT_CHARS} are allowed")]
    TextTooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        found: usize,
    },
}

/// One component's level and, while one is standing, its alarm.
#[derive(Debug, Clone, Default)]
struct Slot {
    tracker: LevelTracker,
    alarm: Option<Alarm>,
    cause: CauseDelay,
}

/// Evidence time for which verdicts have said another cause than the one an alarm names.
#[derive(Debug, Clone, Copy, Default)]
struct CauseDelay {
    other_s: f64,
}

impl CauseDelay {
    /// Whether an alarm takes over what this verdict says of its cause.
    ///
    /// A cause that was named stands for as long as the alarm itself would without evidence
    /// ([`Settings::off_delay_s`]): the one window in which damage comes or is mended mixes two
    /// conditions and proves neither. A verdict that names the same cause, or is worse than all
    /// before it, is taken over at once.
    fn takes(
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

/// The alarms of one machine.
#[derive(Debug, Clone)]
pub struct AlarmEngine {
    settings: Settings,
    slots: BTreeMap<(ComponentKind, String), Slot>,
    /// Stream time of the newest verdict.
    last_verdict_s: Option<f64>,
    next_id: u64,
    next_sequence: u64,
    history: VecDeque<AlarmEvent>,
}

impl AlarmEngine {
    /// An engine without alarms.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            slots: BTreeMap::new(),
            last_verdict_s: None,
            next_id: 1,
            next_sequence: 1,
            history: VecDeque::new(),
        }
    }

    /// Takes a verdict at stream time `time_s` in and gives the transitions it causes.
    ///
    /// A component that is absent from the verdict was not judged and keeps its alarm. Stream time
    /// that goes back adds no evidence time.
    pub fn observe(&mut self, diagnosis: &Diagnosis, time_s: f64) -> Vec<AlarmEvent> {
        let evidence_s = self.evidence_since_last(diagnosis.duration_s, time_s);
        let mut events = Vec::new();
        for component in &diagnosis.components {
            let observation = Observation::of(component.state, diagnosis.operating_state);
            let slot = self.slots.entry((component.kind, component.id.clone())).or_default();
            let level = slot.tracker.observe(observation, evidence_s, &self.settings);
            match &mut slot.alarm {
                Some(alarm) => {
                    if slot.cause.takes(alarm, component, evidence_s, &self.settings) {
                        alarm.take_over(component);
                    }
                }
                None => slot.cause = CauseDelay::default(),
            }
            let Some((kind, alarm)) =
                transition(&mut slot.alarm, component, level, time_s, &mut self.next_id)
            else {
                continue;
            };
            events.push(self.record(kind, time_s, alarm));
        }
        events
    }

    /// Stream time the newest window adds to what was already judged, s.
    fn evidence_since_last(&mut self, window_s: f64, time_s: f64) -> f64 {
        let elapsed_s = self.last_verdict_s.map_or(0.0, |last| time_s - last);
        self.last_verdict_s = Some(time_s);
        // `max` and `min` also drop NaN: what is no number proves nothing.
        elapsed_s.min(window_s).max(0.0)
    }

    /// Takes an operator's acknowledgement at stream time `time_s` in; gives the alarm after it and
    /// the transitions: `Acknowledged`, and `Cleared` when the condition is already gone.
    ///
    /// # Errors
    /// When no such alarm is standing, it needs no acknowledgement, or a text is missing or too long.
    pub fn acknowledge(
        &mut self,
        id: u64,
        author: &str,
        comment: &str,
        time_s: f64,
    ) -> Result<(Alarm, Vec<AlarmEvent>), ActionError> {
        let author = author.trim();
        check_texts(author, comment)?;
        let alarm_slot = self
            .slots
            .values_mut()
            .map(|slot| &mut slot.alarm)
            .find(|alarm| alarm.as_ref().is_some_and(|alarm| alarm.id == id));
        let Some(alarm_slot) = alarm_slot else { return Err(ActionError::UnknownAlarm { id }) };
        let Some(alarm) = alarm_slot else { return Err(ActionError::UnknownAlarm { id }) };
        if !alarm.state.awaits_acknowledgement() {
            let author = alarm.acknowledgement.as_ref().map(|a| a.author.clone());
            return Err(ActionError::AlreadyAcknowledged {
                id,
                author: author.unwrap_or_default(),
            });
        }
        alarm.state = alarm.state.after(AlarmInput::Acknowledge);
        alarm.changed_at_s = time_s;
        alarm.acknowledgement = Some(Acknowledgement {
            author: author.to_owned(),
            comment: comment.trim().to_owned(),
            time_s,
        });
        let alarm = alarm.clone();
        if alarm.state == AlarmState::Normal {
            *alarm_slot = None;
        }
        let mut events = vec![self.record(EventKind::Acknowledged, time_s, alarm.clone())];
        if alarm.state == AlarmState::Normal {
            events.push(self.record(EventKind::Cleared, time_s, alarm.clone()));
        }
        Ok((alarm, events))
    }

    /// All alarms that are not back to normal, newest first.
    #[must_use]
    pub fn standing(&self) -> Vec<Alarm> {
        let mut alarms: Vec<Alarm> =
            self.slots.values().filter_map(|slot| slot.alarm.clone()).collect();
        alarms.sort_by_key(|alarm| std::cmp::Reverse(alarm.id));
        alarms
    }

    /// The events held, oldest first; at most [`Settings::history_len`].
    #[must_use]
    pub fn history(&self) -> &VecDeque<AlarmEvent> {
        &self.history
    }

    /// Number of events that fell out of the history.
    #[must_use]
    pub fn history_dropped(&self) -> u64 {
        self.next_sequence - 1 - self.history.len() as u64
    }

    fn record(&mut self, kind: EventKind, time_s: f64, alarm: Alarm) -> AlarmEvent {
        let event = AlarmEvent { sequence: self.next_sequence, kind, time_s, alarm };
        self.next_sequence += 1;
        self.history.push_back(event.clone());
        while self.history.len() > self.settings.history_len {
            self.history.pop_front();
        }
        event
    }
}

fn check_texts(author: &str, comment: &str) -> Result<(), ActionError> {
    if author.is_empty() {
        return Err(ActionError::NoAuthor);
    }
    for (field, text) in [("author", author), ("comment", comment)] {
        let found = text.chars().count();
        if found > MAX_TEXT_CHARS {
            return Err(ActionError::TextTooLong { field, found });
        }
    }
    Ok(())
}

/// Moves a component's alarm to `level` and gives what happened, with the alarm after it.
fn transition(
    slot: &mut Option<Alarm>,
    component: &ComponentDiagnosis,
    level: Option<Level>,
    time_s: f64,
    next_id: &mut u64,
) -> Option<(EventKind, Alarm)> {
    let Some(alarm) = slot else {
        let alarm = raise(component, level?, time_s, *next_id);
        *next_id += 1;
        *slot = Some(alarm.clone());
        return Some((EventKind::Raised, alarm));
    };
    let before = (alarm.state, alarm.level);
    let (input, kind) = match level {
        None => (
            AlarmInput::Cleared,
            match alarm.state {
                AlarmState::Acknowledged => EventKind::Cleared,
                AlarmState::Normal
                | AlarmState::Unacknowledged
                | AlarmState::ReturnedUnacknowledged => EventKind::Returned,
            },
        ),
        Some(level) => {
            let rose = level > alarm.level;
            alarm.level = level;
            if !before.0.is_active() {
                alarm.occurrences = alarm.occurrences.saturating_add(1);
                (AlarmInput::Active, EventKind::Raised)
            } else if rose {
                (AlarmInput::Escalated, EventKind::Escalated)
            } else {
                (AlarmInput::Active, EventKind::DeEscalated)
            }
        }
    };
    alarm.state = alarm.state.after(input);
    if (alarm.state, alarm.level) == before {
        return None;
    }
    alarm.changed_at_s = time_s;
    let alarm = alarm.clone();
    if alarm.state == AlarmState::Normal {
        *slot = None;
    }
    Some((kind, alarm))
}

fn raise(component: &ComponentDiagnosis, level: Level, time_s: f64, id: u64) -> Alarm {
    Alarm {
        id,
        component: component.id.clone(),
        kind: component.kind,
        level,
        state: AlarmState::Normal.after(AlarmInput::Active),
        fault: component.fault,
        why: component.why.clone(),
        severity: component.severity,
        confidence: component.confidence,
        raised_at_s: time_s,
        changed_at_s: time_s,
        occurrences: 1,
        acknowledgement: None,
    }
}

#[cfg(test)]
mod tests;
