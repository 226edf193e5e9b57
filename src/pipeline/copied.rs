//! The samples of a window out of a ring: of one segment, without a gap. Must not know what they are read for.

use crate::buffer::Ring;
use crate::features::ChannelWindow;
use crate::signal::SampleIndex;
use crate::units::Hz;

/// The samples of one channel in a window.
pub(super) struct Copied {
    start: u64,
    time_s: f64,
    samples: Vec<f32>,
}

impl Copied {
    /// Copies the contiguous samples of a ring in a window: all of it, or the longest half; none of another segment.
    pub(super) fn of(
        ring: &Ring,
        Hz(rate): Hz,
        segment: Option<u32>,
        (start_s, end_s): (f64, f64),
    ) -> Option<Self> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let wanted = (((end_s - start_s) * rate).round() as usize).max(1);
        // A quarter of a sample of slack against the rounding of index/rate: the sample at `end_s` is the next window's.
        let end = ring.end_at(end_s - 0.25 / rate)?;
        let last = SampleIndex(end.0.checked_sub(1)?);
        if ring.segment_of(last) != segment {
            return None;
        }
        // A channel that ended early holds older samples: those before the window do not count.
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let held = ((ring.time_of(last)? - start_s) * rate + 1.25).max(0.0) as usize;
        let held = held.min(wanted);
        let floor = end.0.saturating_sub(held as u64);
        let (mut start, mut n) = ring.contiguous_before(end, held);
        if 2 * n < wanted && start.0 > floor {
            let before = ring.newest_before(start).unwrap_or(start);
            let room = usize::try_from(before.0.saturating_sub(floor)).unwrap_or(0);
            let earlier = ring.contiguous_before(before, room);
            if earlier.1 > n {
                (start, n) = earlier;
            }
        }
        if n == 0 || 2 * n < wanted {
            return None;
        }
        let time_s = ring.time_of(start)?;
        let mut samples = vec![0.0_f32; n];
        ring.copy(start, &mut samples).then_some(Self { start: start.0, time_s, samples })
    }

    /// What is measured.
    pub(super) fn window(&self) -> ChannelWindow<'_> {
        ChannelWindow { start: self.start, time_s: self.time_s, samples: &self.samples }
    }
}
