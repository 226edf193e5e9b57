//! The demonstration: a signal in closed form, and the files a daemon needs to watch it.
//!
//! ```text
//! Scene (what turns, what is broken) ──impulses──▶ samples ──files──▶ capture, machine file
//! ```
//!
//! Closed-form impulses, not a simulation of a rig: good for showing the program and for tests that
//! need to know the answer, no proof of accuracy. Equations M1–M7 of `docs/theory.md`. Must
//! not know what a diagnosis makes of it.

pub mod impulses;
pub mod files;
