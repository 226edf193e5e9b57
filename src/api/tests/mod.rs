//! The service over a small shard thread with known signals: answers, refusals, limits.

mod access;
mod alarms;
mod angles;
pub(super) mod baselines;
pub(super) mod events;
pub(super) mod captures;
mod guards;
mod machines;
mod recordings;
mod signals;
mod silences;
mod simulation;
mod trends;
