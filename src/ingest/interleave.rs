//! Cuts a capture's blocks into short pieces and orders them as a live acquisition would.
//!
//! A capture gives a second of one channel, then a second of the next. Handed on like that, a
//! paced replay would run ahead in one channel and lag in another.

use super::replay::ReplayError;
use super::replay::Step;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::SampleIndex;
use std::collections::VecDeque;

/// Longest piece, s of stream time.
pub const MAX_BLOCK_S: f64 = 0.25;

/// Most samples of a piece, whatever the rate.
const MAX_BLOCK_SAMPLES: usize = 1 << 16;

/// Orders the pieces of blocks by the time of their last sample.
///
/// Blocks must come in the order in which they begin. Then every piece that ends no later than the
/// newest block read begins can be handed on: nothing unread ends before it. So what is held is
/// bounded by the blocks of all channels that overlap in time.
#[derive(Debug)]
pub struct Interleaver {
    /// Samples a second, by channel.
    rates_hz: Vec<f64>,
    /// Pieces in waiting, by channel.
    pending: Vec<VecDeque<Block>>,
    /// Where the newest block read begins, s; infinite after the last.
    read_to_s: f64,
}

impl Interleaver {
    /// Makes one for channels of these rates.
    #[must_use]
    pub fn new(rates_hz: Vec<f64>) -> Self {
        let pending = vec![VecDeque::new(); rates_hz.len()];
        Self { rates_hz, pending, read_to_s: f64::NEG_INFINITY }
    }

    /// Gives the next piece, reading as far ahead as its place in the order demands.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn next(
        &mut self,
        read: &mut dyn FnMut() -> Result<Step, ReplayError>,
    ) -> Result<Step, ReplayError> {
        loop {
            let earliest = self.earliest();
            if let Some((channel, end_s)) = earliest
                && end_s <= self.read_to_s
                && let Some(block) = self.pending[channel].pop_front()
            {
                return Ok(Step::Block(block));
            }
            if self.read_to_s == f64::INFINITY {
                return Ok(Step::End);
            }
            match read()? {
                Step::Block(block) => self.take(block),
                Step::End => self.read_to_s = f64::INFINITY,
                told @ (Step::Rejected { .. } | Step::Received(_)) => return Ok(told),
            }
        }
    }

    /// Cuts a block and puts the pieces in waiting.
    fn take(&mut self, block: Block) {
        let rate_hz = self.rates_hz[block.channel.0];
        self.read_to_s = block.time_s;
        let len = piece_len(rate_hz);
        for (i, samples) in block.samples.chunks(len).enumerate() {
            let offset = i * len;
            self.pending[block.channel.0].push_back(Block {
                channel: ChannelIndex(block.channel.0),
                start: SampleIndex(block.start.0 + offset as u64),
                segment: block.segment,
                time_s: block.time_s + offset as f64 / rate_hz,
                samples: samples.to_vec(),
            });
        }
    }

    /// Channel whose first piece in waiting ends first, and when, s.
    fn earliest(&self) -> Option<(usize, f64)> {
        let ends = self.pending.iter().zip(&self.rates_hz).enumerate();
        ends.filter_map(|(channel, (pieces, rate_hz))| {
            let piece = pieces.front()?;
            Some((channel, piece.time_s + piece.samples.len() as f64 / rate_hz))
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Samples of a piece: at least one.
fn piece_len(rate_hz: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
    #[expect(clippy::cast_sign_loss, reason = "negative and NaN become 0, then 1")]
    let len = (rate_hz * MAX_BLOCK_S) as usize;
    len.clamp(1, MAX_BLOCK_SAMPLES)
}
