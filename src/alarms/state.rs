//! States of an alarm and every transition between them, in the words of ISA-18.2.

/// State of an alarm (ANSI/ISA-18.2, alarm state transition diagram).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AlarmState {
    /// Condition absent, nothing to acknowledge.
    Normal,
    /// Condition present, nobody has acknowledged it.
    Unacknowledged,
    /// Condition present, acknowledged.
    Acknowledged,
    /// Condition gone before anybody acknowledged it.
    ReturnedUnacknowledged,
}

impl AlarmState {
    /// All states, for tables.
    pub const ALL: [Self; 4] =
        [Self::Normal, Self::Unacknowledged, Self::Acknowledged, Self::ReturnedUnacknowledged];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Unacknowledged => "unacknowledged",
            Self::Acknowledged => "acknowledged",
            Self::ReturnedUnacknowledged => "returned_unacknowledged",
        }
    }

    /// Whether the condition is present.
    #[must_use]
    pub fn is_active(self) -> bool {
        matches!(self, Self::Unacknowledged | Self::Acknowledged)
    }

    /// Whether an operator may acknowledge.
    #[must_use]
    pub fn awaits_acknowledgement(self) -> bool {
        matches!(self, Self::Unacknowledged | Self::ReturnedUnacknowledged)
    }

    /// Gives the state after `input`. Total: an input that changes nothing gives the same state.
    #[must_use]
    pub fn after(self, input: AlarmInput) -> Self {
        match self {
            Self::Normal => match input {
                AlarmInput::Active | AlarmInput::Escalated => Self::Unacknowledged,
                AlarmInput::Cleared | AlarmInput::Acknowledge => Self::Normal,
            },
            Self::Unacknowledged => match input {
                AlarmInput::Active | AlarmInput::Escalated => Self::Unacknowledged,
                AlarmInput::Cleared => Self::ReturnedUnacknowledged,
                AlarmInput::Acknowledge => Self::Acknowledged,
            },
            Self::Acknowledged => match input {
                AlarmInput::Active | AlarmInput::Acknowledge => Self::Acknowledged,
                AlarmInput::Escalated => Self::Unacknowledged,
                AlarmInput::Cleared => Self::Normal,
            },
            Self::ReturnedUnacknowledged => match input {
                AlarmInput::Active | AlarmInput::Escalated => Self::Unacknowledged,
                AlarmInput::Cleared => Self::ReturnedUnacknowledged,
                AlarmInput::Acknowledge => Self::Normal,
            },
        }
    }
}

/// What can happen to an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlarmInput {
    /// The condition is present, at the level known or below.
    Active,
    /// The condition is present at a higher level than acknowledged: it must be seen again.
    Escalated,
    /// The condition is gone.
    Cleared,
    /// An operator acknowledges.
    Acknowledge,
}

impl AlarmInput {
    /// All inputs, for tables.
    pub const ALL: [Self; 4] = [Self::Active, Self::Escalated, Self::Cleared, Self::Acknowledge];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_and_input_has_its_place_in_the_table() {
        use AlarmState::Unacknowledged as U;
        use AlarmState::{Acknowledged as A, Normal as N, ReturnedUnacknowledged as R};
        // Rows: state; columns: Active, Escalated, Cleared, Acknowledge.
        let table = [(N, [U, U, N, N]), (U, [U, U, R, A]), (A, [A, U, N, A]), (R, [U, U, R, N])];
        for (state, row) in table {
            for (input, expected) in AlarmInput::ALL.into_iter().zip(row) {
                assert_eq!(state.after(input), expected, "{state:?} after {input:?}");
            }
        }
        assert_eq!(table.map(|(state, _)| state), AlarmState::ALL);
    }

    #[test]
    fn a_present_condition_is_never_normal_and_an_absent_one_never_active() {
        for state in AlarmState::ALL {
            assert!(state.after(AlarmInput::Active).is_active());
            assert_eq!(state.after(AlarmInput::Escalated), AlarmState::Unacknowledged);
            assert!(!state.after(AlarmInput::Cleared).is_active());
            assert!(!state.after(AlarmInput::Acknowledge).awaits_acknowledgement());
        }
    }
}
