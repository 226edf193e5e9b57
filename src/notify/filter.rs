//! Which transitions a receiver is told of.

use crate::alarms::AlarmEvent;
use crate::alarms::EventKind;
use crate::alarms::Level;

/// Which transitions; an empty list takes all.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Filter {
    /// Of these machines.
    pub machines: Vec<String>,
    /// Of alarms that are at one of these levels right after.
    pub levels: Vec<Level>,
    /// These.
    pub transitions: Vec<EventKind>,
}

impl Filter {
    /// Whether a transition on `machine` is one of them.
    #[must_use]
    pub fn takes(&self, machine: &str, event: &AlarmEvent) -> bool {
        let of_machine = self.machines.is_empty() || self.machines.iter().any(|m| m == machine);
        let of_level = self.levels.is_empty() || self.levels.contains(&event.alarm.level);
        let of_kind = self.transitions.is_empty() || self.transitions.contains(&event.kind);
        of_machine && of_level && of_kind
    }
}
