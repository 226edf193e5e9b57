//! The simulator's hard cases: each row of `bench::stability` holds. `--nocapture` prints the table.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

mod cases;
mod tables;
