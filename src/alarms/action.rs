//! What operators do to alarms, and why it may be refused.

use super::state::AlarmInput;
use super::state::LifeInput;
use super::state::Refusal;
use super::state::Silence;
use crate::signal::Timestamp;

/// Longest author or comment an operator may leave, in characters.
pub const MAX_TEXT_CHARS: usize = 2000;

/// Longest time an alarm may be shelved for unless the settings say otherwise, s: a day.
pub const MAX_SHELVING_S: f64 = 86_400.0;

/// The clocks at one instant, as the shell read them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Stream time, s.
    pub stream_s: f64,
    /// Monotonic time since any fixed instant, s: what shelving runs by.
    pub monotonic_s: f64,
    /// UTC; a label, it decides nothing.
    pub utc: Timestamp,
}

impl Moment {
    /// An instant of which only the stream time matters.
    #[must_use]
    pub fn of_stream(stream_s: f64) -> Self {
        Self { stream_s, monotonic_s: 0.0, utc: Timestamp::default() }
    }
}

/// What an operator does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Has seen it.
    Acknowledge,
    /// Puts it aside for a limited time, s.
    Shelve {
        /// For how long, s; above 0.
        for_s: f64,
    },
    /// Takes it off the shelf before its time.
    Unshelve,
    /// Says that it means nothing by design.
    Suppress,
    /// Ends that.
    Unsuppress,
    /// Takes it out of service for maintenance.
    TakeOutOfService,
    /// Returns it to service.
    ReturnToService,
    /// Resets it when it latched.
    Reset,
}

impl Action {
    /// Name in documents and paths.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Acknowledge => "ack",
            Self::Shelve { .. } => "shelve",
            Self::Unshelve => "unshelve",
            Self::Suppress => "suppress",
            Self::Unsuppress => "unsuppress",
            Self::TakeOutOfService => "out-of-service",
            Self::ReturnToService => "return",
            Self::Reset => "reset",
        }
    }

    /// What it is to the transition table.
    #[must_use]
    pub fn input(self) -> AlarmInput {
        match self {
            Self::Acknowledge => AlarmInput::Life(LifeInput::Acknowledge),
            Self::Reset => AlarmInput::Life(LifeInput::Reset),
            Self::Shelve { .. } => AlarmInput::Silence(Silence::Shelved),
            Self::Suppress => AlarmInput::Silence(Silence::Suppressed),
            Self::TakeOutOfService => AlarmInput::Silence(Silence::OutOfService),
            Self::Unshelve => AlarmInput::EndOf(Silence::Shelved),
            Self::Unsuppress => AlarmInput::EndOf(Silence::Suppressed),
            Self::ReturnToService => AlarmInput::EndOf(Silence::OutOfService),
        }
    }
}

/// An act as it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Act {
    /// Which alarm.
    pub alarm: u64,
    /// What is done.
    pub action: Action,
    /// Who does it.
    pub author: String,
    /// Why; may be empty.
    pub comment: String,
}

/// Why an operator's action was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
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
    /// The act does not fit the alarm's state.
    #[error("alarm {id} {}", refusal_text(*why))]
    NotInState {
        /// The alarm.
        id: u64,
        /// Why not.
        why: Refusal,
    },
    /// An act must be signed.
    #[error("the author of an action must not be empty")]
    NoAuthor,
    /// Author or comment is too long.
    #[error("{field} has {found} characters, at most {MAX_TEXT_CHARS} are allowed")]
    TextTooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        found: usize,
    },
    /// An alarm cannot be shelved for such a time.
    #[error("an alarm can be shelved for more than 0 and at most {max_s} s, not for {found_s} s")]
    ShelvingTime {
        /// As asked for, s.
        found_s: f64,
        /// Longest time allowed, s.
        max_s: f64,
    },
}

fn refusal_text(why: Refusal) -> String {
    match why {
        Refusal::NothingToAcknowledge => "has nothing to acknowledge".to_owned(),
        Refusal::NotAcknowledged => "must be acknowledged before it is reset".to_owned(),
        Refusal::NotLatched => "does not wait for a reset".to_owned(),
        Refusal::StillPresent => "cannot be reset: its condition is present".to_owned(),
        Refusal::AlreadySilent(silence) => format!("is {} already", words(silence)),
        Refusal::NotSilent(silence) => format!("is not {}", words(silence)),
    }
}

fn words(silence: Silence) -> &'static str {
    match silence {
        Silence::Shelved => "shelved",
        Silence::Suppressed => "suppressed",
        Silence::OutOfService => "out of service",
    }
}

impl Act {
    /// Checks what does not depend on the alarm; `max_shelving_s`: longest shelving allowed.
    pub(super) fn check(&self, max_shelving_s: f64) -> Result<(), ActionError> {
        if self.author.trim().is_empty() {
            return Err(ActionError::NoAuthor);
        }
        for (field, text) in [("author", &self.author), ("comment", &self.comment)] {
            let found = text.chars().count();
            if found > MAX_TEXT_CHARS {
                return Err(ActionError::TextTooLong { field, found });
            }
        }
        match self.action {
            // Written so that NaN is refused.
            Action::Shelve { for_s } if !(for_s > 0.0 && for_s <= max_shelving_s) => {
                Err(ActionError::ShelvingTime { found_s: for_s, max_s: max_shelving_s })
            }
            Action::Shelve { .. }
            | Action::Acknowledge
            | Action::Unshelve
            | Action::Suppress
            | Action::Unsuppress
            | Action::TakeOutOfService
            | Action::ReturnToService
            | Action::Reset => Ok(()),
        }
    }
}
