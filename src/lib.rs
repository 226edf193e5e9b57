//! rotorwatch: an open condition monitor for gear-rotor-bearing drivetrains.
//!
//! The modules stand in the order in which a signal passes them, from sensor to operator. The
//! core (`units` to `wire`) is pure and synchronous; the shell (`causes` to `cli`) does the
//! input, output and waiting. `tests/layering.rs` holds the arrows between them.

pub mod units;
pub mod signal;
pub mod tape;
pub mod machine;
pub mod dsp;
pub mod buffer;
pub mod features;
pub mod diagnosis;
pub mod alarms;
pub mod pipeline;
pub mod simulator;
pub mod evaluation;
pub mod trials;
pub mod plot;
pub mod html;
pub mod notify;
pub mod wire;
pub mod causes;
pub mod access;
pub mod capture;
pub mod offline;
pub mod ingest;
pub mod bench;
pub mod store;
pub mod api;
pub mod evidence;
pub mod dashboard;
pub mod config;
pub mod telemetry;
pub mod app;
pub mod cli;
