//! The service over a small shard thread with known signals: answers, refusals, limits.

mod alarms;
pub(super) mod baselines;
mod events;
mod guards;
mod machines;
mod signals;
mod simulation;
