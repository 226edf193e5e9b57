//! Finds a regular stretch of pulses and follows the marks from there both ways (D61, D62).

use std::ops::Range;

use super::PulseTrainPlan;
use super::Segment;
use super::smooth::Parabola;
use super::split;

/// Pulses the next one is predicted from.
const RECENT: usize = 12;

/// Furthest a pulse may be from its mark, parts of the distance to the next mark.
const TOLERANCE: f64 = 0.35;

/// Most marks in succession without a pulse that are bridged.
const MAX_MISSING: i64 = 4;

/// Pulses in succession at no mark after which the train is lost.
const MAX_EXTRA: usize = 4;

/// Places tried at once as the regular stretch to begin at.
const MAX_SEEDS: usize = 256;

/// RMS deviation of a stretch that is begun at without looking further, parts of the spacing.
const GOOD_SEED: f64 = 0.05;

/// Largest RMS deviation of a stretch to begin at at all.
const SEED_TOLERANCE: f64 = 0.2;

/// A regular stretch: its first pulse, that pulse's mark, and how many there are.
#[derive(Debug, Clone, Copy)]
struct Seed {
    first: usize,
    mark: i64,
    n: usize,
}

impl PulseTrainPlan {
    /// Follows one piece without stops; where the train is lost a new segment begins.
    pub(super) fn follow_piece(&mut self, piece: Range<usize>) {
        let mut from = piece.start;
        while from < piece.end {
            from = match self.seed(from..piece.end) {
                Some(seed) => self.follow_seed(from..piece.end, seed),
                None => {
                    let to = piece.end.min(from + MAX_SEEDS);
                    self.counts.n_unplaced += to - from;
                    to
                }
            };
        }
    }

    /// Follows the marks from a seed both ways and adds the segment. Returns the first pulse behind it.
    fn follow_seed(&mut self, piece: Range<usize>, seed: Seed) -> usize {
        self.knots.clear();
        for i in 0..seed.n {
            self.knots.push((self.pulses_s[seed.first + i], seed.mark + i as i64));
        }
        // Backwards: the list begins with the latest and grows into the past.
        self.knots.reverse();
        let before = self.walk(seed.first - piece.start, |i| seed.first - 1 - i, -1);
        self.counts.n_unplaced += seed.first - piece.start - before;
        self.knots.reverse();
        let next = seed.first + seed.n;
        let after = self.walk(piece.end - next, |i| next + i, 1);
        self.add_segment();
        next + after
    }

    /// Adds the knots that the next `n` pulses give, `pulse(i)` the i-th of them, in the `direction` of
    /// the marks; returns how many pulses were dealt with before the train was lost.
    fn walk(&mut self, n: usize, pulse: impl Fn(usize) -> usize, direction: i64) -> usize {
        let mut n_extra = 0;
        let mut last_miss = 0.0;
        for i in 0..n {
            let time_s = self.pulses_s[pulse(i)];
            let Some(angle) = self.predict(time_s) else { return i };
            let (mark, miss) = self.nearest_mark(angle);
            let steps = (mark - self.knots.last().map_or(0, |knot| knot.1)) * direction;
            if steps > MAX_MISSING + 1 {
                return i - n_extra;
            }
            if steps >= 1 && miss.abs() <= TOLERANCE {
                self.counts.n_extra += n_extra;
                self.counts.n_missing += usize::try_from(steps - 1).unwrap_or(0);
                (n_extra, last_miss) = (0, miss);
                self.knots.push((time_s, mark));
                continue;
            }
            // Of two pulses at one mark the one nearer to it is kept.
            if steps == 0 && miss.abs() < 0.5 * f64::abs(last_miss) {
                if let Some(knot) = self.knots.last_mut() {
                    knot.0 = time_s;
                }
                last_miss = miss;
            }
            n_extra += 1;
            if n_extra == MAX_EXTRA {
                return i + 1 - n_extra;
            }
        }
        self.counts.n_extra += n_extra;
        n
    }

    /// Angle at `time_s` by the last knots, revolutions.
    fn predict(&self, time_s: f64) -> Option<f64> {
        let recent = &self.knots[self.knots.len().saturating_sub(RECENT)..];
        let point = |i: usize| (recent[i].0, self.angle_of(recent[i].1));
        Parabola::fit(recent.len(), point).map(|parabola| parabola.at(time_s))
    }

    /// The mark nearest to an angle, and how far the angle is beyond it, parts of the spacing there.
    fn nearest_mark(&self, angle: f64) -> (i64, f64) {
        let n = self.wheel.marks_rev.len();
        let turns = angle.floor();
        let below = self.wheel.marks_rev.partition_point(|mark| *mark <= angle - turns).max(1) - 1;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "saturates; such an angle fits nothing"
        )]
        let below = (turns as i64).saturating_mul(n as i64).saturating_add(below as i64);
        let spacing = self.angle_of(below + 1) - self.angle_of(below);
        let share = (angle - self.angle_of(below)) / spacing;
        if share <= 0.5 { (below, share) } else { (below + 1, share - 1.0) }
    }

    /// A regular stretch near the start of a piece; with uneven marks also which mark it begins with.
    fn seed(&self, piece: Range<usize>) -> Option<Seed> {
        let n_marks = self.wheel.marks_rev.len();
        let (least, wanted) = if self.is_even { (4, 6) } else { (n_marks + 2, n_marks + 4) };
        let n = wanted.min(piece.len());
        if n < least {
            return None;
        }
        let n_offsets = if self.is_even { 1 } else { n_marks };
        let n_places = (piece.len() - n + 1).min(MAX_SEEDS);
        let mut best = (f64::INFINITY, Seed { first: piece.start, mark: 0, n });
        for first in piece.start..piece.start + n_places {
            for offset in 0..n_offsets {
                let seed = Seed { first, mark: offset as i64, n };
                let miss = self.seed_miss(seed).unwrap_or(f64::INFINITY);
                best = if miss < best.0 { (miss, seed) } else { best };
            }
            if best.0 < GOOD_SEED {
                break;
            }
        }
        (best.0 < SEED_TOLERANCE).then_some(best.1)
    }

    /// RMS deviation of a seed from a steady acceleration, parts of the mean spacing.
    fn seed_miss(&self, seed: Seed) -> Option<f64> {
        let point = |i: usize| (self.pulses_s[seed.first + i], self.angle_of(seed.mark + i as i64));
        let fitted = Parabola::fit(seed.n, point)?;
        Some(fitted.rms * self.wheel.marks_rev.len() as f64)
    }

    /// Turns the knots of a walk into a segment: outliers out, smoothed, revolutions from the first.
    fn add_segment(&mut self) {
        let first = self.knots.first().map_or(0, |knot| knot.1);
        let n_marks = self.wheel.marks_rev.len();
        // An even wheel does not say which mark is which.
        let origin = if self.is_even { first } else { split(first, n_marks).0 * n_marks as i64 };
        for knot in &mut self.knots {
            knot.1 -= origin;
        }
        self.take_out_outliers();
        let jitter_rms_s = self.measure_jitter();
        let half_width = self.smoothing_half_width(jitter_rms_s);
        let from = self.times_s.len();
        for i in 0..self.knots.len() {
            let (time_s, mark) = self.knots[i];
            let turned = self.smoothed(i, half_width).unwrap_or_else(|| self.angle_of(mark));
            if self.revolutions[from..].last().is_none_or(|last| turned > *last) {
                self.times_s.push(time_s);
                self.marks.push(mark);
                self.revolutions.push(turned);
            } else {
                self.counts.n_outliers += 1;
            }
        }
        let knots = from..self.times_s.len();
        self.segments.push(Segment { knots, jitter_rms_s });
    }
}
