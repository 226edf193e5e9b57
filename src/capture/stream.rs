//! One table of samples as a stream of blocks of each of its channels.

use super::convert;
use super::error::CaptureError;
use super::received::{RawSamples, Received};
use super::rows::Source;
use super::segments::{Segments, Span};
use crate::signal::{Block, ChannelIndex, SampleIndex};

/// Rows read ahead of what a block needs, for very slow channels.
const UNIT_ROWS_MIN: u64 = 4096;

/// A table being read.
pub(super) struct TableStream {
    source: Source,
    /// Samples of a block at most.
    block: u64,
    /// Rows fetched at once: whole chunks, so that none is decompressed twice.
    unit: u64,
    /// Whether fetches end on multiples of `unit`; otherwise a fetch is exactly a block.
    aligned: bool,
    at: u64,
    span: Span,
    /// Rows fetched and not yet handed on, a column each.
    pending: Vec<RawSamples>,
    pending_at: usize,
}

/// What one step of a table yields.
#[derive(Default)]
pub(super) struct Step {
    pub(super) blocks: Vec<Block>,
    pub(super) received: Vec<Received>,
    pub(super) n_rejected: u64,
}

impl TableStream {
    /// Starts at row 0; `block_max` = samples of a block at most.
    pub(super) fn new(source: Source, segments: &Segments, block_max: u64) -> Option<Self> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a positive rate; float to int casts saturate"
        )]
        let second = source.rate.0.ceil() as u64;
        let block = second.clamp(1, block_max);
        let unit = block.max(UNIT_ROWS_MIN.min(block_max)).next_multiple_of(source.chunk.max(1));
        let aligned = source.chunk > 1 || unit > block;
        let span = segments.span(0, source.rate)?;
        let pending = Vec::new();
        Some(Self { source, block, unit, aligned, at: 0, span, pending, pending_at: 0 })
    }

    /// Stream time of the next row, s; `None` at the end.
    pub(super) fn next_time_s(&self) -> Option<f64> {
        (self.at < self.source.length).then(|| self.time_s(self.at))
    }

    fn time_s(&self, row: u64) -> f64 {
        self.span.time_s + row.saturating_sub(self.span.start) as f64 / self.source.rate.0
    }

    /// Reads the next run of at most a block, inside one segment; `keep_received` also hands on
    /// the raw elements.
    pub(super) fn step(
        &mut self,
        segments: &Segments,
        keep_received: bool,
    ) -> Result<Step, CaptureError> {
        self.fill()?;
        let end = self.span.end.min(self.source.length).min(self.at + self.block);
        let left = (self.n_pending() - self.pending_at) as u64;
        let count = usize::try_from(end.saturating_sub(self.at).min(left)).unwrap_or(0);
        let mut step = Step::default();
        let whole = self.pending_at == 0 && count == self.n_pending();
        for column in 0..self.pending.len() {
            let raw = take(&mut self.pending[column], self.pending_at, count, whole);
            let channel = self.source.columns[column].channel;
            if keep_received {
                step.received.push(self.received(channel, raw.clone()));
            }
            let samples = self.source.columns[column].conversion.samples(raw);
            self.push_blocks(channel, samples, &mut step);
        }
        self.pending_at = if whole { 0 } else { self.pending_at + count };
        self.at += count as u64;
        self.advance_segment(segments);
        Ok(step)
    }

    /// Rows fetched, those handed on included.
    fn n_pending(&self) -> usize {
        self.pending.first().map_or(0, RawSamples::len)
    }

    /// Fetches the next unit if nothing is pending.
    fn fill(&mut self) -> Result<(), CaptureError> {
        if self.pending_at < self.n_pending() {
            return Ok(());
        }
        // Contiguous storage has no chunk to align to: fetch exactly the block, to move it on.
        let count = if self.aligned {
            self.unit - self.at % self.unit
        } else {
            self.block.min(self.span.end.saturating_sub(self.at))
        };
        let count = count.min(self.source.length - self.at);
        self.pending = self.source.rows.read(self.at, count)?;
        self.pending_at = 0;
        let complete = |raw: &RawSamples| raw.len() as u64 == count;
        if self.pending.len() == self.source.columns.len() && self.pending.iter().all(complete) {
            return Ok(());
        }
        let found = self.pending.iter().map(|raw| raw.len() as u64).min().unwrap_or(0);
        let (file, object) = (self.source.file.clone(), self.source.object.clone());
        Err(CaptureError::Short { file, object, at: self.at, expected: count, found })
    }

    /// Moves to the segment that holds the next row.
    fn advance_segment(&mut self, segments: &Segments) {
        while self.at >= self.span.end {
            match segments.span(self.span.segment.saturating_add(1), self.source.rate) {
                Some(next) => self.span = next,
                None => return,
            }
        }
    }

    fn received(&self, channel: ChannelIndex, raw: RawSamples) -> Received {
        let (start, time_s) = (SampleIndex(self.at), self.time_s(self.at));
        Received { channel, start, segment: self.span.segment, time_s, raw }
    }

    /// Makes blocks of the finite runs of `samples`, which begin at the current row.
    fn push_blocks(&self, channel: ChannelIndex, samples: Vec<f32>, step: &mut Step) {
        let block = |at: u64, samples: Vec<f32>| Block {
            channel,
            start: SampleIndex(at),
            segment: self.span.segment,
            time_s: self.time_s(at),
            samples,
        };
        if convert::all_finite(&samples) {
            step.blocks.push(block(self.at, samples));
            return;
        }
        let mut at = self.at;
        step.n_rejected += samples.len() as u64;
        for run in samples.split(|sample| !sample.is_finite()) {
            if !run.is_empty() {
                step.blocks.push(block(at, run.to_vec()));
            }
            step.n_rejected -= run.len() as u64;
            at += run.len() as u64 + 1;
        }
    }
}

/// Takes `count` elements from `at` on; `whole`: these are all, and are moved.
fn take(pending: &mut RawSamples, at: usize, count: usize, whole: bool) -> RawSamples {
    if whole {
        return std::mem::replace(pending, RawSamples::F32(Vec::new()));
    }
    let range = at..at + count;
    match pending {
        RawSamples::F32(raw) => RawSamples::F32(raw[range].to_vec()),
        RawSamples::F64(raw) => RawSamples::F64(raw[range].to_vec()),
        RawSamples::I16(raw) => RawSamples::I16(raw[range].to_vec()),
        RawSamples::I32(raw) => RawSamples::I32(raw[range].to_vec()),
    }
}
