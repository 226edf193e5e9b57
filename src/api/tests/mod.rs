//! The service over a small shard thread with known signals: answers, refusals, limits.

mod alarms;
mod guards;
mod machines;
mod signals;
mod simulation;
