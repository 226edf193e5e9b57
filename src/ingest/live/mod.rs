//! Samples from senders on a network: who may send what, where each sample belongs, what became of it.
//!
//! ```text
//! frames ──▶ Session ──▶ Intake: one a machine ──▶ blocks, Received
//!            turns,      Lane: one a channel: place, Ledger, Drift, Offset
//!            credit
//! ```
//!
//! Pure: the time is an argument, sockets and queues are `app`'s. Must not know what becomes of the samples.

pub mod drift;
pub mod offset;
pub mod ledger;
mod lane;
mod openings;
mod rules;
pub mod intake;
pub mod pace;
pub mod session;

use crate::wire::ErrorCode;
use crate::wire::WireError;
pub use rules::check_ahead;

/// Why a sender is not listened to any longer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {text}", code.name())]
pub struct Refusal {
    /// What it is.
    pub code: ErrorCode,
    /// What was found and what to do, for people.
    pub text: String,
}

impl Refusal {
    /// A refusal.
    #[must_use]
    pub fn new(code: ErrorCode, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }
}

impl From<WireError> for Refusal {
    fn from(error: WireError) -> Self {
        Self::new(error.code(), error.to_string())
    }
}

#[cfg(test)]
mod tests;
