//! Captures as the world hands them in: written by others, with every filter, and damaged; and
//! what this program writes, read by others.
//!
//! `weigh` reads a capture under a scale: every call into the reader is weighed, and everything
//! the file holds ends in one comparable value.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test may panic; clippy exempts only #[test] functions"
)]
#![expect(clippy::print_stdout, reason = "a skipped test says so, and the damage is reported")]

mod corpus;
mod damage;
mod tables;
mod tools;
mod weigh;
mod written;
