//! How good verdicts are: a diagnosis held against what is known of the record, and many of these counted.
//!
//! [`truth`] reads the table of what is known, [`score`] holds one diagnosis against one row, [`summary`] counts
//! the scores, [`reliability`] asks whether a confidence is a frequency, [`interval`] says how much a count proves.
//! Whoever diagnoses must not know any of this. Must not know files, samples, the clock, or how a
//! record came to be: recorded ones and simulated ones are scored alike.

pub mod truth;
pub mod score;
pub mod interval;
pub mod reliability;
pub mod summary;
