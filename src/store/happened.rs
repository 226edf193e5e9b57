//! What the log of events tells of. Must not know how it is kept.

use crate::alarms::AlarmEvent;
use crate::notify::HealthChange;
use crate::signal::Timestamp;

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Happened {
    /// Something to an alarm.
    Alarm(Box<AlarmEvent>),
    /// A verdict changed.
    Health(HealthChange),
    /// A configuration was read while the daemon ran.
    Configuration(ConfigurationChange),
    /// A machine is maintained, or not any more.
    Maintenance(MaintenanceChange),
}

/// What became of a configuration that was read while the daemon ran.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigurationChange {
    /// The machine it concerns; `None`: the daemon as a whole.
    pub machine: Option<String>,
    /// What.
    pub outcome: ConfigurationOutcome,
    /// Hash of the configuration that holds after it.
    pub hash: String,
    /// What has changed, or why it was refused.
    pub text: String,
}

/// What may become of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConfigurationOutcome {
    /// It holds.
    Applied,
    /// It was refused; that of before holds.
    Rejected,
    /// A machine is measured anew for it.
    Rebuilt,
}

impl ConfigurationOutcome {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Applied, Self::Rejected, Self::Rebuilt];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Applied => "config_applied",
            Self::Rejected => "config_rejected",
            Self::Rebuilt => "machine_rebuilt",
        }
    }
}

/// What became of the maintenance of a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MaintenanceChange {
    /// What.
    pub outcome: MaintenanceOutcome,
    /// Who said it.
    pub author: String,
    /// Why.
    pub reason: String,
    /// When it ends, or was to end, UTC.
    pub until: Option<Timestamp>,
}

/// What may become of the maintenance of a machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaintenanceOutcome {
    /// It has begun, or has another time or reason.
    Began,
    /// Somebody ended it.
    Ended,
    /// Its time is over.
    Over,
}

impl MaintenanceOutcome {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Began, Self::Ended, Self::Over];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Began => "maintenance_began",
            Self::Ended => "maintenance_ended",
            Self::Over => "maintenance_over",
        }
    }
}

/// An entry of the log. Its stream times count from `start`.
#[derive(Debug, Clone, PartialEq)]
pub struct LogEntry {
    /// Its place.
    pub place: u64,
    /// Machine id; empty: it concerns the daemon as a whole.
    pub machine: String,
    /// When it was stored, UTC.
    pub recorded: Timestamp,
    /// UTC of stream time 0; `None`: unknown.
    pub start: Option<Timestamp>,
    /// Since when the store refuses, if it could not be stored yet; its place is 0 then.
    pub refused_since: Option<Timestamp>,
    /// What happened.
    pub what: Happened,
}
