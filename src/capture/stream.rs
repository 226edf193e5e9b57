//! One channel as a stream of blocks.

use super::convert::{self, Conversion, Raw};
use super::error::LibraryError;
use super::hdf5::{Dataset, NumberType};
use super::segments::{Segments, Span};
use crate::signal::{Block, ChannelIndex, SampleIndex};
use crate::units::Hz;

/// Elements read ahead of what a block needs, for very slow channels.
const UNIT_SAMPLES_MIN: u64 = 4096;

/// A channel being read.
pub(super) struct ChannelStream {
    pub(super) channel: ChannelIndex,
    pub(super) path: String,
    pub(super) dataset: Dataset,
    pub(super) kind: NumberType,
    pub(super) length: u64,
    pub(super) rate: Hz,
    pub(super) conversion: Conversion,
    /// Samples of a block at most.
    block: u64,
    /// Elements fetched at once: whole chunks, so that none is decompressed twice.
    unit: u64,
    /// Whether fetches end on multiples of `unit`; otherwise a fetch is exactly a block.
    aligned: bool,
    at: u64,
    span: Span,
    pending: Raw,
    pending_at: usize,
}

/// What one step of a channel yields.
pub(super) struct Step {
    pub(super) blocks: Vec<Block>,
    pub(super) n_rejected: u64,
}

/// What a channel is opened with.
pub(super) struct Source {
    pub(super) channel: ChannelIndex,
    pub(super) path: String,
    pub(super) dataset: Dataset,
    pub(super) kind: NumberType,
    pub(super) length: u64,
    pub(super) rate: Hz,
    pub(super) conversion: Conversion,
    /// Elements of a chunk; 1 if not chunked.
    pub(super) chunk: u64,
}

impl ChannelStream {
    /// Starts at sample 0; `block_max` = samples of a block at most.
    pub(super) fn new(source: Source, segments: &Segments, block_max: u64) -> Option<Self> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a positive rate; float to int casts saturate"
        )]
        let second = source.rate.0.ceil() as u64;
        let block = second.clamp(1, block_max);
        let unit = block.max(UNIT_SAMPLES_MIN.min(block_max)).next_multiple_of(source.chunk);
        let aligned = source.chunk > 1 || unit > block;
        let span = segments.span(0, source.rate)?;
        Some(Self {
            channel: source.channel,
            path: source.path,
            dataset: source.dataset,
            kind: source.kind,
            length: source.length,
            rate: source.rate,
            conversion: source.conversion,
            block,
            unit,
            aligned,
            at: 0,
            span,
            pending: Raw::F32(Vec::new()),
            pending_at: 0,
        })
    }

    /// Stream time of the next sample, s; `None` at the end.
    pub(super) fn next_time_s(&self) -> Option<f64> {
        (self.at < self.length).then(|| self.time_s(self.at))
    }

    fn time_s(&self, sample: u64) -> f64 {
        self.span.time_s + sample.saturating_sub(self.span.start) as f64 / self.rate.0
    }

    /// Reads the next run of at most a block, inside one segment.
    pub(super) fn step(&mut self, segments: &Segments) -> Result<Step, LibraryError> {
        self.fill()?;
        let end = self.span.end.min(self.length).min(self.at + self.block);
        let left = (self.pending.len() - self.pending_at) as u64;
        let count = end.saturating_sub(self.at).min(left);
        let raw = take(&mut self.pending, &mut self.pending_at, to_usize(count));
        let samples = self.conversion.samples(raw);
        let start = self.at;
        let step = self.blocks(start, samples);
        self.at += count;
        self.advance_segment(segments);
        Ok(step)
    }

    /// Fetches the next unit if nothing is pending.
    fn fill(&mut self) -> Result<(), LibraryError> {
        if self.pending_at < self.pending.len() {
            return Ok(());
        }
        // Contiguous storage has no chunk to align to: fetch exactly the block, to move it on.
        let count = if self.aligned {
            self.unit - self.at % self.unit
        } else {
            self.block.min(self.span.end.saturating_sub(self.at))
        };
        self.pending = read(&self.dataset, self.kind, self.at, count.min(self.length - self.at))?;
        self.pending_at = 0;
        Ok(())
    }

    /// Moves to the segment that holds the next sample.
    fn advance_segment(&mut self, segments: &Segments) {
        while self.at >= self.span.end {
            match segments.span(self.span.segment.saturating_add(1), self.rate) {
                Some(next) => self.span = next,
                None => return,
            }
        }
    }

    /// Makes blocks of the finite runs of `samples`.
    fn blocks(&self, start: u64, samples: Vec<f32>) -> Step {
        let block = |at: u64, samples: Vec<f32>| Block {
            channel: self.channel,
            start: SampleIndex(at),
            segment: self.span.segment,
            time_s: self.time_s(at),
            samples,
        };
        if convert::all_finite(&samples) {
            return Step { blocks: vec![block(start, samples)], n_rejected: 0 };
        }
        let mut blocks = Vec::new();
        let mut n_finite = 0;
        let mut at = 0;
        for run in samples.split(|sample| !sample.is_finite()) {
            if !run.is_empty() {
                blocks.push(block(start + at, run.to_vec()));
            }
            n_finite += run.len() as u64;
            at += run.len() as u64 + 1;
        }
        Step { blocks, n_rejected: samples.len() as u64 - n_finite }
    }
}

/// Reads `count` elements of a channel, as stored.
pub(super) fn read(
    dataset: &Dataset,
    kind: NumberType,
    start: u64,
    count: u64,
) -> Result<Raw, LibraryError> {
    let (start, count) = (to_usize(start), to_usize(count));
    Ok(match kind {
        NumberType::F32 => Raw::F32(dataset.slice(start, count)?),
        NumberType::F64 => Raw::F64(dataset.slice(start, count)?),
        NumberType::I16 => Raw::I16(dataset.slice(start, count)?),
        NumberType::I32 => Raw::I32(dataset.slice(start, count)?),
    })
}

/// Takes `count` elements from `at` on; all of them without a copy.
fn take(pending: &mut Raw, at: &mut usize, count: usize) -> Raw {
    if *at == 0 && count == pending.len() {
        return std::mem::replace(pending, Raw::F32(Vec::new()));
    }
    let range = *at..*at + count;
    *at += count;
    match pending {
        Raw::F32(raw) => Raw::F32(raw[range].to_vec()),
        Raw::F64(raw) => Raw::F64(raw[range].to_vec()),
        Raw::I16(raw) => Raw::I16(raw[range].to_vec()),
        Raw::I32(raw) => Raw::I32(raw[range].to_vec()),
    }
}

/// Sample counts come from data set shapes, which are `usize`.
fn to_usize(count: u64) -> usize {
    usize::try_from(count).unwrap_or(usize::MAX)
}
