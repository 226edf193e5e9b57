//! Where samples come from: one source a machine, each on a thread of its own.
//!
//! A source hands blocks on through a closure and waits by another, both given by `app`: it knows
//! neither the clock nor the queue behind them. Must not know what becomes of the samples.

pub mod interleave;
pub mod live;
mod shift;
pub mod outgoing;
pub mod replay;
pub mod simulated;
