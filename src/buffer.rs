//! Ring buffer of one channel: bounded, overwrites the oldest, knows its gaps.

use crate::signal::{Block, SampleIndex};
use crate::units::Hz;

/// Counts and extent of a ring.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RingStatus {
    /// Oldest sample held.
    pub oldest: SampleIndex,
    /// One past the newest sample received.
    pub newest: SampleIndex,
    /// Stream time one past the newest sample, s.
    pub newest_time_s: f64,
    /// Samples received and kept.
    pub received: u64,
    /// Samples never received: sizes of gaps.
    pub missing: u64,
    /// Number of gaps.
    pub gaps: u64,
    /// Samples received again or too late, and not used.
    pub duplicated: u64,
    /// Samples at the ends of the source's number range.
    pub clipped: u64,
}

/// The ring.
#[derive(Debug, Clone)]
pub struct Ring {
    samples: Vec<f32>,
}

impl Ring {
    /// Makes a ring for `seconds` of samples at `sample_rate`.
    #[must_use]
    pub fn new(_sample_rate: Hz, _seconds: f64) -> Self {
        Self { samples: Vec::new() }
    }

    /// Bytes such a ring needs.
    #[must_use]
    pub fn bytes(_sample_rate: Hz, _seconds: f64) -> usize {
        0
    }

    /// Takes a block in: appends, notes a gap before it, or counts what is already there.
    pub fn push(&mut self, block: &Block) {
        self.samples.extend_from_slice(&block.samples);
    }

    /// Longest contiguous run (one segment, no gap) that ends at `end`, at most `max_len` samples:
    /// first index and the number of samples.
    #[must_use]
    pub fn contiguous_before(&self, _end: SampleIndex, _max_len: usize) -> (SampleIndex, usize) {
        (SampleIndex(0), 0)
    }

    /// Copies samples `start .. start + out.len()` into `out`; false if any of them is not held or
    /// a gap lies between them.
    pub fn copy(&self, _start: SampleIndex, _out: &mut [f32]) -> bool {
        false
    }

    /// Extent and counts.
    #[must_use]
    pub fn status(&self) -> RingStatus {
        RingStatus::default()
    }
}
