//! How the passes of a repeated replay join: as one stream that goes on.

use crate::capture::received::Received;
use crate::signal::Block;

/// What a pass adds to the capture's own indices, segments and times, so that the stream goes on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shift {
    /// By channel.
    pub(super) index: Vec<u64>,
    pub(super) segment: u32,
    pub(super) time_s: f64,
}

impl Shift {
    pub(super) fn none(n_channels: usize) -> Self {
        Self { index: vec![0; n_channels], segment: 0, time_s: 0.0 }
    }

    pub(super) fn apply(&self, block: &mut Block) {
        block.start.0 += self.index[block.channel.0];
        block.segment = block.segment.wrapping_add(self.segment);
        block.time_s += self.time_s;
    }

    pub(super) fn apply_to_received(&self, run: &mut Received) {
        run.start.0 += self.index[run.channel.0];
        run.segment = run.segment.wrapping_add(self.segment);
        run.time_s += self.time_s;
    }
}

/// Where a pass got to.
pub(super) struct Reached {
    pub(super) n_samples: u64,
    /// Shift of the next pass.
    pub(super) shift: Shift,
}

impl Reached {
    /// Notes how far a channel has come. Blocks end before samples that are no numbers, what was
    /// received does not.
    pub(super) fn note(&mut self, channel: usize, end: u64, segment: u32, end_s: f64) {
        self.shift.index[channel] = self.shift.index[channel].max(end);
        self.shift.segment = self.shift.segment.max(segment.wrapping_add(1));
        self.shift.time_s = self.shift.time_s.max(end_s);
    }
}
