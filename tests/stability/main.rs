//! The simulator's hard cases: each names what it is held against. `--nocapture` prints the table.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]
#![expect(clippy::panic, reason = "a test may panic; clippy exempts only #[test] functions")]

mod rows;
mod scenes;
mod errors;
mod oscillators;
mod rotors;
mod bearings;
mod tables;
