//! Ring buffer of one channel: bounded, overwrites the oldest, knows its gaps.
//!
//! Samples lie densely in one fixed allocation; a short list of *runs* says which indices, segment
//! and stream time they have. A run ends where an index range is missing or the segment changes,
//! so that nobody reads across a boundary by accident. Must not know what the samples mean.

use crate::signal::{Block, SampleIndex};
use crate::units::Hz;
use std::collections::VecDeque;

/// Most samples a ring holds (128 MiB), whatever rate the data declare.
pub const MAX_SAMPLES: usize = 1 << 25;

/// Most runs a ring remembers; with more boundaries than this the oldest run is given up.
pub const MAX_RUNS: usize = 1024;

/// Part of a sample by which a time may miss a sample instant and still mean it. Stream times of
/// 10⁷ s at 10⁵ samples/s carry a rounding error near 2·10⁻⁴ samples.
const TIME_TOLERANCE_SAMPLES: f64 = 1e-3;

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

/// Consecutive samples of one segment.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Run {
    /// Index of the run's first sample, which may be overwritten by now.
    first: u64,
    /// Samples written to the ring before the run's first.
    written_before: u64,
    /// Segment.
    segment: u32,
    /// Stream time of the first sample, s.
    time_s: f64,
}

/// The ring.
///
/// Indices of a stream grow. A block whose indices were already passed is a duplicate or late and
/// is counted, not used; only a block of a *newer segment* may go back, which is a restart of the
/// source: the samples held are given up and the stream goes on from there.
#[derive(Debug, Clone)]
pub struct Ring {
    /// Sample number k (counted as written) lies at k mod length.
    samples: Vec<f32>,
    /// Samples a second.
    rate_hz: f64,
    /// Raw values at the ends of the source's number range.
    full_scale: Option<(f32, f32)>,
    /// Samples written since the start.
    written: u64,
    /// Runs that still hold samples, oldest first; indices grow from run to run.
    runs: VecDeque<Run>,
    /// Counts (`oldest`, `newest` and `newest_time_s` are filled in by [`Self::status`]).
    counts: RingStatus,
}

impl Ring {
    /// Makes a ring for `seconds` of samples at `sample_rate`, at most [`MAX_SAMPLES`].
    #[must_use]
    pub fn new(sample_rate: Hz, seconds: f64) -> Self {
        Self {
            samples: vec![0.0; capacity(sample_rate, seconds)],
            rate_hz: sample_rate.0,
            full_scale: None,
            written: 0,
            runs: VecDeque::new(),
            counts: RingStatus::default(),
        }
    }

    /// Lets the ring count samples at or beyond the ends of the source's number range as clipped.
    #[must_use]
    pub fn with_full_scale(mut self, full_scale: Option<(f32, f32)>) -> Self {
        self.full_scale = full_scale;
        self
    }

    /// Bytes such a ring needs: its samples and the longest list of runs.
    #[must_use]
    pub fn bytes(sample_rate: Hz, seconds: f64) -> usize {
        capacity(sample_rate, seconds) * size_of::<f32>() + MAX_RUNS * size_of::<Run>()
    }

    /// Number of samples the ring can hold.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.samples.len()
    }

    /// Takes a block in: appends, notes a gap before it, or counts what is already there.
    ///
    /// The time of a block counts only where a run begins; inside a run time follows from the
    /// index. A block longer than the ring leaves its newest part.
    pub fn push(&mut self, block: &Block) {
        let n_samples = block.samples.len() as u64;
        if n_samples == 0 {
            return;
        }
        let Some(end) = block.start.0.checked_add(n_samples) else {
            self.counts.duplicated += n_samples; // beyond the last index there is
            return;
        };
        let Some((newest, segment)) = self.runs.back().map(|run| (self.end_of(run), run.segment))
        else {
            self.begin_run(block, 0);
            self.append(&block.samples);
            return;
        };
        let is_restart = block.start.0 < newest && block.segment > segment;
        if is_restart {
            self.runs.clear();
            self.begin_run(block, 0);
            self.append(&block.samples);
            return;
        }
        if end <= newest {
            self.counts.duplicated += n_samples;
            return;
        }
        let n_known = newest.saturating_sub(block.start.0);
        self.counts.duplicated += n_known;
        let n_missing = block.start.0.saturating_sub(newest);
        if n_missing > 0 {
            self.counts.missing += n_missing;
            self.counts.gaps += 1;
        }
        if n_missing > 0 || block.segment != segment {
            self.begin_run(block, n_known);
        }
        // n_known < n_samples, which is a length
        let n_known = usize::try_from(n_known).unwrap_or(block.samples.len());
        self.append(&block.samples[n_known..]);
    }

    /// Longest contiguous run (one segment, no gap) that ends at `end`, at most `max_len` samples:
    /// first index and the number of samples; (`end`, 0) when the sample before `end` is not held.
    #[must_use]
    pub fn contiguous_before(&self, end: SampleIndex, max_len: usize) -> (SampleIndex, usize) {
        let Some(run) = end.0.checked_sub(1).and_then(|last| self.run_of(last)) else {
            return (end, 0);
        };
        let n_held = usize::try_from(end.0 - self.start_of(run)).unwrap_or(usize::MAX);
        let len = n_held.min(max_len);
        (SampleIndex(end.0 - len as u64), len)
    }

    /// One past the newest sample held whose index is below `end`; `None` when there is none.
    #[must_use]
    pub fn newest_before(&self, end: SampleIndex) -> Option<SampleIndex> {
        let n_runs = self.runs.partition_point(|run| self.start_of(run) < end.0);
        let run = self.runs.get(n_runs.checked_sub(1)?)?;
        Some(SampleIndex(self.end_of(run).min(end.0)))
    }

    /// One past the newest sample held that is earlier than stream time `time_s`; `None` when
    /// there is none.
    #[must_use]
    pub fn end_at(&self, time_s: f64) -> Option<SampleIndex> {
        let run = self.runs.iter().rev().find(|run| {
            self.time_in(run, self.start_of(run)) + TIME_TOLERANCE_SAMPLES / self.rate_hz < time_s
        })?;
        let samples = (time_s - run.time_s) * self.rate_hz - TIME_TOLERANCE_SAMPLES;
        #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
        #[expect(clippy::cast_sign_loss, reason = "time_s is later than the run's first sample")]
        let n_samples = samples.ceil() as u64;
        Some(SampleIndex(run.first.saturating_add(n_samples).min(self.end_of(run))))
    }

    /// Stream time of a held sample, s.
    #[must_use]
    pub fn time_of(&self, index: SampleIndex) -> Option<f64> {
        self.run_of(index.0).map(|run| self.time_in(run, index.0))
    }

    /// Segment of a held sample.
    #[must_use]
    pub fn segment_of(&self, index: SampleIndex) -> Option<u32> {
        self.run_of(index.0).map(|run| run.segment)
    }

    /// Copies samples `start .. start + out.len()` into `out`; false, with `out` untouched, if any
    /// of them is not held or a boundary lies between them.
    pub fn copy(&self, start: SampleIndex, out: &mut [f32]) -> bool {
        if out.is_empty() {
            return true;
        }
        let Some(run) = self.run_of(start.0) else { return false };
        if self.end_of(run) - start.0 < out.len() as u64 {
            return false;
        }
        let from = self.place(run.written_before + (start.0 - run.first));
        let n_first = out.len().min(self.samples.len() - from);
        let (first, second) = out.split_at_mut(n_first);
        first.copy_from_slice(&self.samples[from..from + n_first]);
        second.copy_from_slice(&self.samples[..second.len()]);
        true
    }

    /// Extent and counts.
    #[must_use]
    pub fn status(&self) -> RingStatus {
        let (Some(oldest), Some(newest)) = (self.runs.front(), self.runs.back()) else {
            return self.counts;
        };
        let end = self.end_of(newest);
        RingStatus {
            oldest: SampleIndex(self.start_of(oldest)),
            newest: SampleIndex(end),
            newest_time_s: self.time_in(newest, end),
            ..self.counts
        }
    }

    /// Begins a run with the block's sample number `n_skipped`.
    fn begin_run(&mut self, block: &Block, n_skipped: u64) {
        if self.runs.len() == MAX_RUNS {
            self.runs.pop_front();
        }
        self.runs.push_back(Run {
            first: block.start.0 + n_skipped,
            written_before: self.written,
            segment: block.segment,
            time_s: block.time_s + n_skipped as f64 / self.rate_hz,
        });
    }

    /// Writes samples behind the newest and forgets the runs they overwrite.
    fn append(&mut self, samples: &[f32]) {
        self.counts.received += samples.len() as u64;
        if let Some((low, high)) = self.full_scale {
            let clipped = samples.iter().filter(|&&x| x <= low || x >= high).count();
            self.counts.clipped += clipped as u64;
        }
        let n_skipped = samples.len().saturating_sub(self.samples.len());
        self.written += n_skipped as u64;
        let kept = &samples[n_skipped..];
        let at = self.place(self.written);
        let n_first = kept.len().min(self.samples.len() - at);
        self.samples[at..at + n_first].copy_from_slice(&kept[..n_first]);
        self.samples[..kept.len() - n_first].copy_from_slice(&kept[n_first..]);
        self.written += kept.len() as u64;

        let oldest_held = self.oldest_held();
        let n_overwritten = (1..self.runs.len())
            .take_while(|&next| self.runs[next].written_before <= oldest_held)
            .count();
        self.runs.drain(..n_overwritten);
    }

    /// Number of the oldest sample that is not overwritten, counted as written.
    fn oldest_held(&self) -> u64 {
        self.written.saturating_sub(self.samples.len() as u64)
    }

    /// Place of sample number `k`, counted as written, in the allocation.
    fn place(&self, k: u64) -> usize {
        usize::try_from(k % self.samples.len() as u64).unwrap_or(0) // below a length
    }

    /// The run that holds sample `index`, if it is held.
    fn run_of(&self, index: u64) -> Option<&Run> {
        let n_runs = self.runs.partition_point(|run| run.first <= index);
        let run = self.runs.get(n_runs.checked_sub(1)?)?;
        (self.start_of(run) <= index && index < self.end_of(run)).then_some(run)
    }

    /// Oldest index of a run that is still held.
    fn start_of(&self, run: &Run) -> u64 {
        run.first + self.oldest_held().saturating_sub(run.written_before)
    }

    /// One past the newest index of a run.
    fn end_of(&self, run: &Run) -> u64 {
        let next = self.runs.partition_point(|r| r.written_before <= run.written_before);
        let written = self.runs.get(next).map_or(self.written, |next| next.written_before);
        run.first + (written - run.written_before)
    }

    /// Stream time of index `index` by the clock of `run`, s.
    fn time_in(&self, run: &Run, index: u64) -> f64 {
        run.time_s + (index - run.first) as f64 / self.rate_hz
    }
}

/// Number of samples of a ring: at least one, at most [`MAX_SAMPLES`], whatever is declared.
fn capacity(sample_rate: Hz, seconds: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
    #[expect(clippy::cast_sign_loss, reason = "negative and NaN become 0, then 1")]
    let wanted = (sample_rate.0 * seconds).ceil() as usize;
    wanted.clamp(1, MAX_SAMPLES)
}

#[cfg(test)]
mod tests;
