//! Shaft phase over time.
//!
//! A [`PhaseTrack`] says how far the shaft has turned at each instant: from tacho pulses, from knots
//! of a smooth motion, or from a speed taken as constant. Revolution 0 is at the first pulse (at t = 0
//! for a constant speed). Must not know where the pulses come from.

use crate::dsp::hermite;
use crate::dsp::real::floor_index;
use crate::dsp::stats;

/// Intervals on either side of one that decide what a normal interval is.
const NEIGHBOURS: usize = 4;

/// Turns of a shaft as a function of time, s from the first sample.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseTrack {
    knots: Knots,
    n_missing: usize,
    n_double: usize,
}

#[derive(Debug, Clone, PartialEq)]
enum Knots {
    Constant {
        speed_hz: f64,
    },
    Pulses {
        times_s: Vec<f64>,
        revolutions: Vec<f64>,
    },
    /// Cubic between the knots, with the speed at each.
    Smooth {
        times_s: Vec<f64>,
        revolutions: Vec<f64>,
        speed_hz: Vec<f64>,
    },
}

impl PhaseTrack {
    /// A shaft that turns at `speed_hz` all the time, revolution 0 at t = 0; `None` unless the speed
    /// is positive and finite.
    #[must_use]
    pub fn constant(speed_hz: f64) -> Option<Self> {
        let turns = speed_hz > 0.0 && speed_hz.is_finite();
        turns.then_some(Self { knots: Knots::Constant { speed_hz }, n_missing: 0, n_double: 0 })
    }

    /// Builds the track of ascending pulse times (D20).
    ///
    /// A pulse less than half a normal interval after the last one is dropped as double; an interval
    /// of about k normal ones counts as k − 1 missing pulses. Normal is the median of the nine
    /// intervals around. `None` with no `pulses_per_rev` or fewer than two pulses left.
    #[must_use]
    pub fn from_pulses(pulse_times_s: &[f64], pulses_per_rev: u32) -> Option<Self> {
        if pulses_per_rev == 0 {
            return None;
        }
        let intervals: Vec<f64> = pulse_times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let mut times_s = vec![*pulse_times_s.first()?];
        let mut revolutions = vec![0.0];
        let (mut n_missing, mut n_double) = (0, 0);
        let (mut last_s, mut n_pulses) = (pulse_times_s[0], 0.0);
        for (i, time_s) in pulse_times_s.iter().enumerate().skip(1) {
            let from = (i - 1).saturating_sub(NEIGHBOURS);
            let around = &intervals[from..intervals.len().min(i + NEIGHBOURS)];
            let mut sorted = [0.0; 2 * NEIGHBOURS + 1];
            sorted[..around.len()].copy_from_slice(around);
            let normal_s = stats::median(&mut sorted[..around.len()])?;
            let n_intervals = (time_s - last_s) / normal_s;
            // Not a number or infinite: repeated times around.
            if !n_intervals.is_finite() || n_intervals < 0.5 {
                n_double += 1;
                continue;
            }
            let n_intervals = n_intervals.round().max(1.0);
            n_missing += floor_index(n_intervals - 1.0);
            n_pulses += n_intervals;
            last_s = *time_s;
            times_s.push(*time_s);
            revolutions.push(n_pulses / f64::from(pulses_per_rev));
        }
        let enough = times_s.len() >= 2;
        enough.then_some(Self {
            knots: Knots::Pulses { times_s, revolutions },
            n_missing,
            n_double,
        })
    }

    /// Passes a smooth, ever forward motion through knots (D60).
    ///
    /// `times_s`, `revolutions`: equally many, at least two, finite, both strictly ascending; else
    /// `None`. A steady speed and a steady acceleration are met exactly between the knots; other
    /// motions within h³/(9√3)·|jerk| (a third of that away from the ends), h the distance of two knots.
    #[must_use]
    pub fn from_knots(times_s: &[f64], revolutions: &[f64]) -> Option<Self> {
        let ascends = |x: &[f64]| x.windows(2).all(|pair| pair[1] > pair[0]);
        let is_finite = |x: &[f64]| x.iter().all(|value| value.is_finite());
        let are_knots = |x: &[f64]| x.len() >= 2 && is_finite(x) && ascends(x);
        if times_s.len() != revolutions.len() || !are_knots(times_s) || !are_knots(revolutions) {
            return None;
        }
        let speed_hz = hermite::slopes(times_s, revolutions);
        let (times_s, revolutions) = (times_s.to_vec(), revolutions.to_vec());
        let knots = Knots::Smooth { times_s, revolutions, speed_hz };
        Some(Self { knots, n_missing: 0, n_double: 0 })
    }

    /// The same motion seen from `delay_s` later on: what was at t = `delay_s` is at t = 0.
    #[must_use]
    pub fn seen_from(&self, delay_s: f64) -> Self {
        let earlier = |times_s: &[f64]| times_s.iter().map(|t| t - delay_s).collect();
        let knots = match &self.knots {
            Knots::Constant { speed_hz } => Knots::Constant { speed_hz: *speed_hz },
            Knots::Pulses { times_s, revolutions } => {
                Knots::Pulses { times_s: earlier(times_s), revolutions: revolutions.clone() }
            }
            Knots::Smooth { times_s, revolutions, speed_hz } => Knots::Smooth {
                times_s: earlier(times_s),
                revolutions: revolutions.clone(),
                speed_hz: speed_hz.clone(),
            },
        };
        Self { knots, ..*self }
    }

    /// The motion of a shaft that turns `ratio` times as far; `None` unless that is positive and finite.
    #[must_use]
    pub fn times(&self, ratio: f64) -> Option<Self> {
        if !(ratio > 0.0 && ratio.is_finite()) {
            return None;
        }
        let scaled = |list: &[f64]| list.iter().map(|value| value * ratio).collect();
        let knots = match &self.knots {
            Knots::Constant { speed_hz } => Knots::Constant { speed_hz: speed_hz * ratio },
            Knots::Pulses { times_s, revolutions } => {
                Knots::Pulses { times_s: times_s.clone(), revolutions: scaled(revolutions) }
            }
            Knots::Smooth { times_s, revolutions, speed_hz } => Knots::Smooth {
                times_s: times_s.clone(),
                revolutions: scaled(revolutions),
                speed_hz: scaled(speed_hz),
            },
        };
        Some(Self { knots, ..*self })
    }

    /// The same motion, ahead by what a cubic through `knots` gives: (revolutions, how far ahead), ascending, two at least,
    /// over the stretch to be kept; `None` if it would turn back, or for pulses, which are right by themselves.
    #[must_use]
    pub fn moved_ahead(&self, knots: &[(f64, f64)]) -> Option<Self> {
        let moved: Vec<(f64, f64)> = match &self.knots {
            Knots::Pulses { .. } => return None,
            Knots::Constant { speed_hz } => {
                knots.iter().map(|(at, ahead)| (at / speed_hz, at + ahead)).collect()
            }
            Knots::Smooth { times_s, revolutions, .. } => {
                // Rises as the motion does, so that the cubic's limits do not touch it.
                let (at, ends): (Vec<f64>, Vec<f64>) =
                    knots.iter().map(|(at, ahead)| (*at, at + ahead)).unzip();
                let slopes = hermite::slopes(&at, &ends);
                let inside = times_s.iter().zip(revolutions);
                inside
                    .filter_map(|(t, r)| Some((*t, hermite::value_at(&at, &ends, &slopes, *r)?)))
                    .collect()
            }
        };
        let (times_s, revolutions): (Vec<f64>, Vec<f64>) = moved.into_iter().unzip();
        Self::from_knots(&times_s, &revolutions)
    }

    /// The same motion, its angle counted from a mark that comes so many revolutions earlier; `None` for a constant speed,
    /// whose angle counts from no mark.
    #[must_use]
    pub fn counted_from(&self, earlier: f64) -> Option<Self> {
        let more = |list: &[f64]| list.iter().map(|turned| turned + earlier).collect();
        let knots = match &self.knots {
            Knots::Constant { .. } => return None,
            Knots::Pulses { times_s, revolutions } => {
                Knots::Pulses { times_s: times_s.clone(), revolutions: more(revolutions) }
            }
            Knots::Smooth { times_s, revolutions, speed_hz } => Knots::Smooth {
                times_s: times_s.clone(),
                revolutions: more(revolutions),
                speed_hz: speed_hz.clone(),
            },
        };
        Some(Self { knots, ..*self })
    }

    /// Pulses that were missing and have been bridged.
    #[must_use]
    pub fn n_missing(&self) -> usize {
        self.n_missing
    }

    /// Pulses that came too early and have been dropped.
    #[must_use]
    pub fn n_double(&self) -> usize {
        self.n_double
    }

    /// Gives the revolutions turned at `time_s`, linear between pulses, cubic between knots; `None`
    /// outside of them.
    #[must_use]
    pub fn revolutions_at(&self, time_s: f64) -> Option<f64> {
        match &self.knots {
            Knots::Constant { speed_hz } => Some(time_s * speed_hz),
            Knots::Pulses { times_s, revolutions } => interpolate(times_s, revolutions, time_s),
            Knots::Smooth { times_s, revolutions, speed_hz } => {
                hermite::value_at(times_s, revolutions, speed_hz, time_s)
            }
        }
    }

    /// Gives the speed at `time_s`, Hz: the slope of what [`Self::revolutions_at`] gives; `None` outside.
    #[must_use]
    pub fn speed_at(&self, time_s: f64) -> Option<f64> {
        match &self.knots {
            Knots::Constant { speed_hz } => Some(*speed_hz),
            Knots::Pulses { times_s, revolutions } => {
                let (below, above) = around(times_s, time_s)?;
                Some((revolutions[above] - revolutions[below]) / (times_s[above] - times_s[below]))
            }
            Knots::Smooth { times_s, revolutions, speed_hz } => {
                hermite::slope_at(times_s, revolutions, speed_hz, time_s)
            }
        }
    }

    /// Gives the time at which `revolutions` are turned; `None` outside the pulses.
    #[must_use]
    pub fn time_at(&self, revolutions: f64) -> Option<f64> {
        match &self.knots {
            Knots::Constant { speed_hz } => Some(revolutions / speed_hz),
            Knots::Pulses { times_s, revolutions: turned } => {
                interpolate(turned, times_s, revolutions)
            }
            Knots::Smooth { times_s, revolutions: turned, speed_hz } => {
                hermite::place_of(times_s, turned, speed_hz, revolutions)
            }
        }
    }

    /// Gives the revolutions between `start_s` and `end_s` that the track covers, first and last.
    #[must_use]
    pub fn covered_revolutions(&self, start_s: f64, end_s: f64) -> Option<(f64, f64)> {
        let (first, last) = match &self.knots {
            Knots::Constant { .. } => (start_s, end_s),
            Knots::Pulses { times_s, .. } | Knots::Smooth { times_s, .. } => {
                (times_s.first()?.max(start_s), times_s.last()?.min(end_s))
            }
        };
        let covered = (self.revolutions_at(first)?, self.revolutions_at(last)?);
        (covered.0 < covered.1).then_some(covered)
    }

    /// Mean speed over the whole track, Hz.
    #[must_use]
    pub fn mean_speed_hz(&self) -> f64 {
        match &self.knots {
            Knots::Constant { speed_hz } => *speed_hz,
            Knots::Pulses { times_s, revolutions } | Knots::Smooth { times_s, revolutions, .. } => {
                let span = |values: &[f64]| match values {
                    [first, .., last] => last - first,
                    [] | [_] => f64::NAN,
                };
                span(revolutions) / span(times_s)
            }
        }
    }

    /// Largest minus smallest mean speed over this many whole revolutions in a row, over the mean speed; 0 for a constant
    /// speed, `None` if so many are not covered.
    #[must_use]
    pub fn relative_excursion(&self, n_revolutions: u32) -> Option<f64> {
        let stretch = f64::from(n_revolutions);
        let (times_s, revolutions) = match &self.knots {
            Knots::Constant { .. } => return Some(0.0),
            Knots::Pulses { times_s, revolutions } | Knots::Smooth { times_s, revolutions, .. } => {
                (times_s, revolutions)
            }
        };
        let (mut slowest, mut fastest) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut end = 0;
        for (start_s, start) in times_s.iter().zip(revolutions) {
            // Half a pulse of slack against rounding of n/pulses_per_rev.
            while end < revolutions.len() && revolutions[end] < start + stretch - 1e-9 {
                end += 1;
            }
            let Some((end_s, end_rev)) = times_s.get(end).zip(revolutions.get(end)) else { break };
            let speed_hz = (end_rev - start) / (end_s - start_s);
            slowest = slowest.min(speed_hz);
            fastest = fastest.max(speed_hz);
        }
        (fastest >= slowest).then(|| (fastest - slowest) / self.mean_speed_hz())
    }
}

/// Linear interpolation of `y` over ascending `x`; `None` outside.
fn interpolate(x: &[f64], y: &[f64], at: f64) -> Option<f64> {
    let (below, above) = around(x, at)?;
    let (x0, x1) = (x[below], x[above]);
    Some(y[below] + (y[above] - y[below]) * (at - x0) / (x1 - x0))
}

/// The two places of ascending `x` that `at` lies between, ends included; `None` outside.
pub(in crate::dsp) fn around(x: &[f64], at: f64) -> Option<(usize, usize)> {
    let above = x.partition_point(|knot| *knot <= at).min(x.len().checked_sub(1)?);
    let below = above.checked_sub(1)?;
    (at >= x[below] && at <= x[above]).then_some((below, above))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regular(n: usize) -> Vec<f64> {
        (0..n).map(|i| 0.05 + 0.1 * i as f64).collect()
    }

    #[test]
    fn a_regular_train_turns_steadily() {
        let track = PhaseTrack::from_pulses(&regular(21), 1).unwrap();
        assert!((track.mean_speed_hz() - 10.0).abs() < 1e-12);
        assert!(track.relative_excursion(1).unwrap() < 1e-12);
        assert!((track.revolutions_at(0.3).unwrap() - 2.5).abs() < 1e-12);
        assert!((track.time_at(2.5).unwrap() - 0.3).abs() < 1e-12);
        assert_eq!((track.revolutions_at(0.04), track.revolutions_at(2.06)), (None, None));
        assert!((track.revolutions_at(2.05).unwrap() - 20.0).abs() < 1e-9, "ends included");
        let (first, last) = track.covered_revolutions(0.0, 1.0).unwrap();
        assert!(first.abs() < 1e-12 && (last - 9.5).abs() < 1e-12);
    }

    #[test]
    fn a_track_moved_ahead_is_ahead_by_that() {
        let knots: Vec<(f64, f64)> =
            (0..=20).map(|i| (f64::from(i), 0.01 * f64::from(i))).collect();
        let times_s: Vec<f64> = (0..=40).map(|i| 0.05 * f64::from(i)).collect();
        let turned: Vec<f64> = times_s.iter().map(|t| 10.0 * t).collect();
        let smooth = PhaseTrack::from_knots(&times_s, &turned).unwrap();
        for track in [PhaseTrack::constant(10.0).unwrap(), smooth] {
            let moved = track.moved_ahead(&knots).unwrap();
            for time_s in [0.0, 0.33, 1.0, 1.99] {
                let found = moved.revolutions_at(time_s).unwrap();
                assert!((found - 10.1 * time_s).abs() < 1e-9, "{found} at {time_s} s");
            }
            assert_eq!(moved.revolutions_at(2.01), None, "nothing is known beyond the knots");
            let back = [(0.0, 0.0), (20.0, -21.0)];
            assert_eq!(track.moved_ahead(&back), None);
        }
        let pulses = PhaseTrack::from_pulses(&regular(21), 1).unwrap();
        assert_eq!(pulses.moved_ahead(&knots), None, "a tacho is right by itself");
    }

    #[test]
    fn a_track_counted_from_an_earlier_mark_is_the_same_motion() {
        let pulses = PhaseTrack::from_pulses(&regular(21), 1).unwrap();
        let smooth = PhaseTrack::from_knots(&regular(21), &regular(21)).unwrap();
        for track in [pulses, smooth] {
            let found = track.counted_from(0.25).unwrap();
            let ahead = found.revolutions_at(0.3).unwrap() - track.revolutions_at(0.3).unwrap();
            assert!((ahead - 0.25).abs() < 1e-12, "{ahead}");
            assert!((found.speed_at(0.3).unwrap() - track.speed_at(0.3).unwrap()).abs() < 1e-9);
        }
        assert_eq!(PhaseTrack::constant(10.0).unwrap().counted_from(0.25), None);
    }

    #[test]
    fn missing_and_double_pulses_are_counted_and_bridged() {
        let mut times_s = regular(40);
        times_s.remove(30);
        times_s.remove(12);
        times_s.remove(12);
        times_s.insert(5, times_s[4] + 0.01);
        let track = PhaseTrack::from_pulses(&times_s, 4).unwrap();
        assert_eq!((track.n_missing(), track.n_double()), (3, 1));
        // 39 intervals of a quarter revolution, as if nothing had happened.
        assert!((track.revolutions_at(regular(40)[39]).unwrap() - 9.75).abs() < 1e-9);
        assert!(track.relative_excursion(1).unwrap() < 1e-9);
    }

    #[test]
    fn a_run_up_is_not_taken_for_faults() {
        // 10 to 20 Hz in 100 revolutions, angle 10t + αt²/2.
        let rate = (400.0 - 100.0) / 200.0;
        let time = |rev: f64| ((100.0 + 2.0 * rate * rev).sqrt() - 10.0) / rate;
        let times_s: Vec<f64> = (0..=100).map(|rev| time(f64::from(rev))).collect();
        let track = PhaseTrack::from_pulses(&times_s, 1).unwrap();
        assert_eq!((track.n_missing(), track.n_double()), (0, 0));
        // (20 − 10)/15 less half an interval at either end.
        assert!((track.relative_excursion(1).unwrap() - 0.66).abs() < 0.01);
        // Over fifty the slowest and the fastest half are left: the means of 10 … √250 and √250 … 20 Hz.
        let halves = 0.5 * (20.0 - 10.0) / 15.0;
        assert!((track.relative_excursion(50).unwrap() - halves).abs() < 0.01);
        assert_eq!(track.relative_excursion(101), None);
    }

    #[test]
    fn a_constant_speed_covers_all_times() {
        let track = PhaseTrack::constant(12.5).unwrap();
        assert_eq!(track.revolutions_at(2.0), Some(25.0));
        assert_eq!(track.time_at(25.0), Some(2.0));
        assert_eq!(track.relative_excursion(1), Some(0.0));
        assert_eq!(track.covered_revolutions(0.0, 1.0), Some((0.0, 12.5)));
        for speed_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(PhaseTrack::constant(speed_hz), None);
        }
    }

    #[test]
    fn knots_of_a_steady_acceleration_are_met_exactly() {
        // Angle 3t + 2t² from rest of a wheel with uneven marks; 12 r/s of mean speed.
        let turned = |t: f64| 3.0 * t + 2.0 * t * t;
        let times_s: Vec<f64> = (0..20).map(|i| 0.25 * f64::from(i + i % 3 / 2)).collect();
        let mut times_s = times_s;
        times_s.dedup();
        let revolutions: Vec<f64> = times_s.iter().map(|t| turned(*t)).collect();
        let track = PhaseTrack::from_knots(&times_s, &revolutions).unwrap();
        for i in 0..=400 {
            let t = 0.01 * f64::from(i);
            // Rounding of 50 revolutions, and of the search for the time.
            assert!((track.revolutions_at(t).unwrap() - turned(t)).abs() < 1e-12, "{t}");
            assert!((track.speed_at(t).unwrap() - 3.0 - 4.0 * t).abs() < 1e-11, "{t}");
            assert!((track.time_at(turned(t)).unwrap() - t).abs() < 1e-12, "{t}");
        }
        assert_eq!((track.revolutions_at(-0.1), track.speed_at(9.0)), (None, None));
        assert_eq!(track.time_at(-0.1), None);
    }

    #[test]
    fn what_is_no_motion_forward_has_no_track() {
        for (times_s, revolutions) in [
            (vec![], vec![]),
            (vec![1.0], vec![1.0]),
            (vec![1.0, 1.0], vec![0.0, 1.0]),
            (vec![1.0, 2.0], vec![1.0, 1.0]),
            (vec![1.0, 2.0, 3.0], vec![0.0, 1.0]),
            (vec![1.0, f64::NAN, 3.0], vec![0.0, 1.0, 2.0]),
            (vec![1.0, 2.0], vec![0.0, f64::INFINITY]),
        ] {
            assert_eq!(PhaseTrack::from_knots(&times_s, &revolutions), None);
        }
        // A motion that nearly stops between two knots still never turns back.
        let track =
            PhaseTrack::from_knots(&[0.0, 1.0, 2.0, 3.0], &[0.0, 5.0, 5.001, 10.0]).unwrap();
        let angle: Vec<f64> =
            (0..=300).map(|i| track.revolutions_at(0.01 * f64::from(i)).unwrap()).collect();
        assert!(angle.windows(2).all(|pair| pair[1] >= pair[0]));
    }

    #[test]
    fn too_few_pulses_make_no_track() {
        assert_eq!(PhaseTrack::from_pulses(&[], 1), None);
        assert_eq!(PhaseTrack::from_pulses(&[1.0], 1), None);
        assert_eq!(PhaseTrack::from_pulses(&[1.0, 1.0], 1), None);
        assert_eq!(PhaseTrack::from_pulses(&[1.0, 1.0, 1.0, 1.0, 2.0], 1), None);
        assert_eq!(PhaseTrack::from_pulses(&[1.0, 2.0], 0), None);
        let track = PhaseTrack::from_pulses(&[1.0, 2.0], 4).unwrap();
        assert_eq!(track.relative_excursion(1), None, "a quarter of a revolution");
    }
}
