//! Alarm → the world outside: what is sent to whom, in which order, when again, and what is given up.
//!
//! [`Courier`] decides for one receiver with the time and the jitter as arguments; [`signature`] signs;
//! [`HealthWatch`] says which verdicts are news. Must not know how anything is sent or stored, how a message
//! is written, or what time it is.

mod secret;
mod filter;
mod backoff;
mod queue;
mod courier;
pub mod signature;
pub mod endpoint;
mod health;
pub mod settings;
pub mod topics;

pub use backoff::Backoff;
pub use courier::Answer;
pub use courier::Courier;
pub use courier::Next;
pub use filter::Filter;
pub use health::Health;
pub use health::HealthChange;
pub use health::HealthWatch;
pub use health::Subject;
pub use queue::Progress;
pub use queue::Queue;
pub use secret::Secret;

/// Id of an event that the store has refused since then. Not that of the stored one: should the daemon be killed
/// before it is stored, its number is given again, and a receiver that knew it would drop another event.
#[must_use]
pub fn unstored_id(machine: &str, sequence: u64, refused_since: Timestamp) -> String {
    format!("{}@{}", event_id(machine, sequence), refused_since.0)
}

/// Id of an event across machines: the same however often it is sent.
#[must_use]
pub fn event_id(machine: &str, sequence: u64) -> String {
    format!("{machine}#{sequence}")
}

use crate::signal::Timestamp;

#[cfg(test)]
mod tests;
