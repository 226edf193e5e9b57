//! One alarm and what happens to it, as data.

use super::action::Action;
use super::policy::Level;
use super::state::AlarmState;
use super::state::Position;
use super::state::ShownState;
use super::state::Silence;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::signal::Timestamp;

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

/// What raised an alarm.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum AlarmSource {
    /// The verdict on a component.
    Diagnosis,
    /// A limit of the machine file, by its id.
    Limit(String),
    /// Data that do not come.
    Data,
    /// The store that does not take what it is given.
    Store,
}

impl AlarmSource {
    /// Name in documents.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Diagnosis => "diagnosis",
            Self::Limit(_) => "limit",
            Self::Data => "data",
            Self::Store => "store",
        }
    }

    /// The limit's id.
    #[must_use]
    pub fn limit(&self) -> Option<&str> {
        match self {
            Self::Limit(id) => Some(id),
            Self::Diagnosis | Self::Data | Self::Store => None,
        }
    }
}

/// Why an alarm is silent, since when and until when.
#[derive(Debug, Clone, PartialEq)]
pub struct Silencing {
    /// Why.
    pub silence: Silence,
    /// Who silenced it.
    pub author: String,
    /// The author's reason; may be empty.
    pub comment: String,
    /// Stream time at which it was silenced, s.
    pub since_s: f64,
    /// When it ends; `None`: not by itself.
    pub until: Option<Deadline>,
}

/// When a shelving ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deadline {
    /// Monotonic time, s: what decides.
    pub monotonic_s: f64,
    /// UTC at which it would end if the clock is not set: a label, and what survives a restart.
    pub utc: Timestamp,
}

/// One alarm: from the raising of a condition until it is gone, acknowledged, reset where it latches,
/// and not silent.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    /// Unique within the machine, never used again.
    pub id: u64,
    /// Component's id; of missing data the channel.
    pub component: String,
    /// Component's kind.
    pub kind: ComponentKind,
    /// What raised it.
    pub source: AlarmSource,
    /// Level now, or the last one when the condition is gone; of a latching alarm the highest.
    pub level: Level,
    /// How far its life has come.
    pub state: AlarmState,
    /// Why it is silent, if it is.
    pub silencing: Option<Silencing>,
    /// Whether it waits for a reset.
    pub latching: bool,
    /// Fault of the accusing verdict it rests on: the newest, except that a named cause outlasts
    /// accusations that say otherwise for less than the off-delay. `None`: cause not proven.
    pub fault: Option<FaultMode>,
    /// Sentence of that verdict, or what the limit found when it was raised.
    pub why: String,
    /// Severity of that verdict.
    pub severity: Option<f64>,
    /// Confidence of that verdict.
    pub confidence: Option<f64>,
    /// Stream time at which it was first raised, s.
    pub raised_at_s: f64,
    /// Stream time at which its condition came last, s.
    pub active_since_s: f64,
    /// Stream time of its last event, s.
    pub changed_at_s: f64,
    /// How often the condition came, ≥ 1.
    pub occurrences: u32,
    /// The last acknowledgement; an escalation or return of the condition asks for a new one.
    pub acknowledgement: Option<Acknowledgement>,
}

impl Alarm {
    /// Where it stands in the transition table.
    #[must_use]
    pub fn position(&self) -> Position {
        Position { life: self.state, silence: self.silencing.as_ref().map(|s| s.silence) }
    }

    /// The state as an operator sees it.
    #[must_use]
    pub fn shown(&self) -> ShownState {
        self.position().shown()
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
    /// The condition went, acknowledged; the alarm waits for its reset.
    Latched,
    /// An operator reset it.
    Reset,
    /// Gone, acknowledged and, where it latches, reset.
    Cleared,
    /// Put on the shelf, or for another time.
    Shelved,
    /// Taken off the shelf, by an operator or by time.
    Unshelved,
    /// Suppressed by design.
    Suppressed,
    /// No longer suppressed.
    Unsuppressed,
    /// Taken out of service.
    RemovedFromService,
    /// Returned to service.
    ReturnedToService,
    /// Over because what it was about is no longer configured.
    ConfigurationRemoved,
}

impl EventKind {
    /// Every one.
    pub const ALL: [Self; 15] = [
        Self::Raised,
        Self::Escalated,
        Self::DeEscalated,
        Self::Returned,
        Self::Acknowledged,
        Self::Latched,
        Self::Reset,
        Self::Cleared,
        Self::Shelved,
        Self::Unshelved,
        Self::Suppressed,
        Self::Unsuppressed,
        Self::RemovedFromService,
        Self::ReturnedToService,
        Self::ConfigurationRemoved,
    ];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raised => "raised",
            Self::Escalated => "escalated",
            Self::DeEscalated => "de_escalated",
            Self::Returned => "returned",
            Self::Acknowledged => "acknowledged",
            Self::Latched => "latched",
            Self::Reset => "reset",
            Self::Cleared => "cleared",
            Self::Shelved => "shelved",
            Self::Unshelved => "unshelved",
            Self::Suppressed => "suppressed",
            Self::Unsuppressed => "unsuppressed",
            Self::RemovedFromService => "removed_from_service",
            Self::ReturnedToService => "returned_to_service",
            Self::ConfigurationRemoved => "configuration_removed",
        }
    }

    /// What the begin of a silence is in the history.
    #[must_use]
    pub fn begin_of(silence: Silence) -> Self {
        match silence {
            Silence::Shelved => Self::Shelved,
            Silence::Suppressed => Self::Suppressed,
            Silence::OutOfService => Self::RemovedFromService,
        }
    }

    /// What the end of a silence is in the history.
    #[must_use]
    pub fn end_of(silence: Silence) -> Self {
        match silence {
            Silence::Shelved => Self::Unshelved,
            Silence::Suppressed => Self::Unsuppressed,
            Silence::OutOfService => Self::ReturnedToService,
        }
    }

    /// What an operator's action is in the history.
    #[must_use]
    pub fn of(action: Action) -> Self {
        match action {
            Action::Acknowledge => Self::Acknowledged,
            Action::Shelve { .. } => Self::Shelved,
            Action::Unshelve => Self::Unshelved,
            Action::Suppress => Self::Suppressed,
            Action::Unsuppress => Self::Unsuppressed,
            Action::TakeOutOfService => Self::RemovedFromService,
            Action::ReturnToService => Self::ReturnedToService,
            Action::Reset => Self::Reset,
        }
    }
}

/// Who did something and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signature {
    /// Who.
    pub author: String,
    /// Why; may be empty.
    pub comment: String,
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
    /// Who did it; `None`: it was observed, or its time had come.
    pub by: Option<Signature>,
    /// The alarm right after.
    pub alarm: Alarm,
}
