//! Shaft angle from tacho pulses that are not what they should be.
//!
//! [`PulseTrainPlan`] follows the marks of a wheel pulse by pulse: pulses may be missing, double or
//! jittered, marks unevenly spaced, the shaft may stop. What does not fit is counted; where the train is
//! lost or the shaft stands, the angle ends and begins anew. No angle is invented in between. Must not
//! know where the pulses come from.

mod follow;
mod smooth;
#[cfg(test)]
mod tests;

use std::ops::Range;

use crate::dsp::order::PhaseTrack;

/// Marks of a wheel and what to make of their pulses.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheel {
    /// Place of each mark, revolutions, ascending from 0, below 1.
    pub marks_rev: Vec<f64>,
    /// Speed below which the shaft counts as standing, Hz.
    pub lowest_speed_hz: f64,
    /// Pulses on either side that smooth one at most, as far as they show jitter and no motion (D63); 0: pulses are taken as they are.
    pub smoothing_pulses: usize,
    /// RMS of what rounding alone does to the times, s; 0 if they are exact.
    pub rounding_s: f64,
}

impl Wheel {
    /// A wheel of `pulses_per_rev` even marks, not smoothed.
    #[must_use]
    pub fn even(pulses_per_rev: u32, lowest_speed_hz: f64) -> Self {
        let mark = |i: u32| f64::from(i) / f64::from(pulses_per_rev);
        let marks_rev = (0..pulses_per_rev).map(mark).collect();
        Self { marks_rev, lowest_speed_hz, smoothing_pulses: 0, rounding_s: 0.0 }
    }

    fn is_possible(&self) -> bool {
        let marks = &self.marks_rev;
        let in_order = marks.windows(2).all(|pair| pair[1] > pair[0]);
        let in_one_turn =
            marks.first().is_some_and(|m| m.abs() <= 0.0) && marks.last() < Some(&1.0);
        in_order && in_one_turn && self.lowest_speed_hz > 0.0 && self.lowest_speed_hz.is_finite()
    }
}

/// What was found in a train; every pulse given is in one of the counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PulseCounts {
    /// Pulses given.
    pub n_given: usize,
    /// Pulses that carry the angle.
    pub n_used: usize,
    /// Not finite, or not after the pulse before.
    pub n_rejected: usize,
    /// Second pulses of one mark, and pulses at the place of no mark.
    pub n_extra: usize,
    /// Pulses further from the others' motion than five times their jitter.
    pub n_outliers: usize,
    /// Pulses in pieces too short or too irregular to be followed.
    pub n_unplaced: usize,
    /// Marks that gave no pulse and were bridged (not among the given).
    pub n_missing: usize,
}

/// A stretch over which the angle is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    knots: Range<usize>,
    /// RMS deviation of single pulses from the smooth motion around them, s (D63); `None` for fewer than
    /// ten pulses.
    pub jitter_rms_s: Option<f64>,
}

/// Follows trains of pulses of one wheel (D61, D62).
#[derive(Debug)]
pub struct PulseTrainPlan {
    wheel: Wheel,
    is_even: bool,
    longest_gap_s: f64,
    /// Pulses of the call that are in order.
    pulses_s: Vec<f64>,
    /// Knots of all segments: times, and marks passed since the segment's first revolution began.
    times_s: Vec<f64>,
    marks: Vec<i64>,
    revolutions: Vec<f64>,
    /// The segment in hand: times and marks; how far each is off the motion around it, s.
    knots: Vec<(f64, i64)>,
    residuals_s: Vec<f64>,
    sorted_s: Vec<f64>,
    /// How far each may be off.
    limits_s: Vec<f64>,
    segments: Vec<Segment>,
    counts: PulseCounts,
}

impl PulseTrainPlan {
    /// Plans for at most `max_pulses` a call; `None` unless the wheel has marks in order inside one
    /// revolution and a positive lowest speed.
    #[must_use]
    pub fn new(wheel: Wheel, max_pulses: usize) -> Option<Self> {
        if !wheel.is_possible() {
            return None;
        }
        let n = wheel.marks_rev.len();
        let spacing = |i: usize| wheel.marks_rev.get(i + 1).unwrap_or(&1.0) - wheel.marks_rev[i];
        let spread =
            |(least, most): (f64, f64), i: usize| (spacing(i).min(least), spacing(i).max(most));
        let (least, most) = (0..n).fold((1.0, 0.0), spread);
        Some(Self {
            is_even: most - least < 1e-9,
            longest_gap_s: most / wheel.lowest_speed_hz,
            wheel,
            pulses_s: Vec::with_capacity(max_pulses),
            times_s: Vec::with_capacity(max_pulses),
            marks: Vec::with_capacity(max_pulses),
            knots: Vec::with_capacity(max_pulses),
            residuals_s: Vec::with_capacity(max_pulses),
            sorted_s: Vec::with_capacity(max_pulses),
            limits_s: Vec::with_capacity(max_pulses),
            // A segment begins with four pulses at least.
            segments: Vec::with_capacity(max_pulses / 4),
            counts: PulseCounts::default(),
            revolutions: Vec::with_capacity(max_pulses),
        })
    }

    /// Follows a train and returns the segments found, in time (D61, D62).
    ///
    /// `pulse_times_s`: s. The counts are in [`Self::counts`], the angle in [`Self::track`]. A gap longer
    /// than the widest spacing of marks at the lowest speed ends a segment; so do more than four marks
    /// in succession without a pulse, and four pulses in succession at the place of none.
    ///
    /// # Panics
    ///
    /// If there are more pulses than planned.
    pub fn process(&mut self, pulse_times_s: &[f64]) -> &[Segment] {
        assert!(pulse_times_s.len() <= self.pulses_s.capacity(), "pulses of the plan");
        self.counts = PulseCounts { n_given: pulse_times_s.len(), ..PulseCounts::default() };
        for list in [&mut self.pulses_s, &mut self.times_s, &mut self.revolutions] {
            list.clear();
        }
        self.marks.clear();
        self.segments.clear();
        for time_s in pulse_times_s {
            let after = self.pulses_s.last().is_none_or(|last| time_s > last);
            if time_s.is_finite() && after {
                self.pulses_s.push(*time_s);
            } else {
                self.counts.n_rejected += 1;
            }
        }
        let mut from = 0;
        while from < self.pulses_s.len() {
            let is_stop = |pair: &[f64]| pair[1] - pair[0] > self.longest_gap_s;
            let stop = self.pulses_s[from..].windows(2).position(is_stop);
            let to = stop.map_or(self.pulses_s.len(), |at| from + at + 1);
            self.follow_piece(from..to);
            from = to;
        }
        self.counts.n_used = self.times_s.len();
        &self.segments
    }

    /// Counts of the last call.
    #[must_use]
    pub fn counts(&self) -> PulseCounts {
        self.counts
    }

    /// Segments of the last call.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Knots of a segment of the last call: times, s, and revolutions. Whole revolutions are at the
    /// first mark of an uneven wheel; an even wheel's first pulse is revolution 0.
    #[must_use]
    pub fn knots(&self, segment: &Segment) -> (&[f64], &[f64]) {
        (&self.times_s[segment.knots.clone()], &self.revolutions[segment.knots.clone()])
    }

    /// Gives the angle over a segment of the last call (D60). Allocates: it is a result to keep.
    #[must_use]
    pub fn track(&self, segment: &Segment) -> Option<PhaseTrack> {
        let (times_s, revolutions) = self.knots(segment);
        PhaseTrack::from_knots(times_s, revolutions)
    }

    /// Measures where the marks are, from a segment followed as if they were even (D64).
    ///
    /// The first mark is that of the segment's first pulse; error: jitter·speed/√(revolutions). `None`
    /// for fewer than eight whole revolutions, a mark without pulses, or a wheel of one mark.
    #[must_use]
    pub fn measured_marks(&self, segment: &Segment) -> Option<Vec<f64>> {
        let n_marks = self.wheel.marks_rev.len();
        let n = i64::try_from(n_marks).ok()?;
        let knots = segment.knots.clone();
        let of_first = |i: &usize| self.marks[*i].rem_euclid(n) == 0;
        let turns: Vec<usize> = knots.clone().filter(of_first).collect();
        if turns.len() < 9 || n_marks < 2 {
            return None;
        }
        let times_s: Vec<f64> = turns.iter().map(|i| self.times_s[*i]).collect();
        let whole: Vec<f64> = turns.iter().map(|i| self.marks[*i].div_euclid(n) as f64).collect();
        let track = PhaseTrack::from_knots(&times_s, &whole)?;
        let mut places = vec![Vec::new(); n_marks];
        for i in knots {
            let mark = usize::try_from(self.marks[i].rem_euclid(n)).ok()?;
            if let Some(turned) = track.revolutions_at(self.times_s[i]) {
                places[mark].push(turned - self.marks[i].div_euclid(n) as f64);
            }
        }
        let mean = |list: Vec<f64>| {
            (!list.is_empty()).then(|| list.iter().sum::<f64>() / list.len() as f64)
        };
        let mut marks: Vec<f64> = places.into_iter().map(mean).collect::<Option<_>>()?;
        marks[0] = 0.0;
        Some(marks)
    }

    /// Angle of a mark counted from revolution 0, revolutions.
    fn angle_of(&self, mark: i64) -> f64 {
        let n = self.wheel.marks_rev.len();
        let (turns, place) = split(mark, n);
        turns as f64 + self.wheel.marks_rev[place]
    }
}

/// Whole turns and place in the turn of mark `mark` of a wheel of `n`.
fn split(mark: i64, n: usize) -> (i64, usize) {
    let n = i64::try_from(n).unwrap_or(i64::MAX);
    (mark.div_euclid(n), usize::try_from(mark.rem_euclid(n)).unwrap_or(0))
}
