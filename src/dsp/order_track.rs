//! Computed order tracking: samples at equal angles of the shaft instead of equal times.
//!
//! What turns with the shaft becomes a line at its order, however the speed changes. Must not know
//! where the angle comes from.

use crate::dsp::interpolate;
use crate::dsp::interpolate::SincInterpolator;
use crate::dsp::order::PhaseTrack;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;
use crate::dsp::stats;

/// Samples at the finer angle step that are computed at once.
const CHUNK: usize = 4096;

/// Slack against rounding of the ends, points.
const SLACK: f64 = 1e-6;

/// Resamples records to equal angles (D69).
#[derive(Debug)]
pub struct OrderTrackPlan {
    points_per_rev: usize,
    /// Finer points a point.
    factor: usize,
    interpolator: SincInterpolator,
    /// Keeps orders above half the points from folding; one weight where no finer points are needed.
    weights: Vec<f64>,
    fine: Vec<f64>,
}

/// What was resampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderTracked {
    /// Angle of the first point, revolutions of the track: a multiple of 1/points.
    pub first_rev: f64,
    /// Points written.
    pub n_points: usize,
    /// Slowest and fastest speed over the points, Hz.
    pub speed_hz: (f64, f64),
}

impl OrderTrackPlan {
    /// Plans `points_per_rev` points a revolution for records at `fs_hz` of a shaft that turns at
    /// `lowest_speed_hz` or faster.
    ///
    /// The record is interpolated at a whole multiple of the points that is at least fs at the lowest
    /// speed, so nothing folds there, then cut at half the points. Orders up to 0.42·points keep their
    /// amplitude within 5·10⁻⁴ while their frequency is below 0.25·fs, 10⁻³ below 0.42·fs; orders above
    /// 0.58·points are kept out by 80 dB. At a speed of more than fs/points the orders above fs/(2·speed) are
    /// empty: the record does not hold them.
    ///
    /// `None` for no points, or if rates or speeds are not positive and finite, or if more than 4096
    /// times the points were needed.
    #[must_use]
    pub fn new(points_per_rev: usize, fs_hz: f64, lowest_speed_hz: f64) -> Option<Self> {
        let samples_per_rev = fs_hz / lowest_speed_hz;
        let is_possible = points_per_rev > 0 && lowest_speed_hz > 0.0 && fs_hz > 0.0;
        let factor = ceil_index(samples_per_rev / points_per_rev.max(1) as f64 - 1e-9).max(1);
        if !is_possible || !samples_per_rev.is_finite() || factor > 4096 {
            return None;
        }
        let weights = match factor {
            1 => vec![1.0],
            factor => interpolate::decimation_weights(factor),
        };
        Some(Self {
            points_per_rev,
            factor,
            interpolator: SincInterpolator::new(1.0),
            fine: vec![0.0; CHUNK.max(2 * factor) + weights.len()],
            weights,
        })
    }

    /// Points of a revolution.
    #[must_use]
    pub fn points_per_rev(&self) -> usize {
        self.points_per_rev
    }

    /// Writes `x` at equal angles into `out`, from the first whole multiple of 1/points that record and
    /// track cover with the kernel's margins, as far as both or `out` reach; its mean is kept.
    ///
    /// `x`: samples at the plan's rate, the first at the track's t = 0. Lost at either end: 16 samples,
    /// and 16 points where finer points are needed. `None` if nothing is covered or a sample is no
    /// number. Below the plan's lowest speed, orders from half the points on fold.
    pub fn process<T: Real>(
        &mut self,
        x: &[T],
        fs_hz: f64,
        track: &PhaseTrack,
        out: &mut [T],
    ) -> Option<OrderTracked> {
        if x.iter().any(|value| !value.to_f64().is_finite()) {
            return None;
        }
        let mean = stats::mean(x)?;
        let margin_s = self.interpolator.half_taps() as f64 / fs_hz;
        let end_s = (x.len() as f64 - 1.0) / fs_hz - margin_s;
        let (first, last) = track.covered_revolutions(margin_s, end_s)?;
        // In points, from here on; the finer ones are `factor` times as many.
        let points = self.points_per_rev as f64;
        let reach = self.weights.len() / 2;
        let lost = reach as f64 / self.factor as f64;
        let begin = (first * points + lost - SLACK).ceil();
        let end = (last * points - lost + SLACK).floor();
        if end < begin {
            return None;
        }
        let n_points = (floor_index(end - begin) + 1).min(out.len());
        let mut source = Source {
            x,
            fs_hz,
            track,
            mean,
            covered: (first, last),
            origin: begin * self.factor as f64 - reach as f64,
            step: 1.0 / (points * self.factor as f64),
            slowest: f64::INFINITY,
            fastest: 0.0,
        };
        let per_chunk = (self.fine.len() - 2 * reach) / self.factor;
        for (chunk, out) in out[..n_points].chunks_mut(per_chunk).enumerate() {
            let start = chunk * per_chunk * self.factor;
            let n_fine = (out.len() - 1) * self.factor + 1 + 2 * reach;
            source.fill(&self.interpolator, start, &mut self.fine[..n_fine]);
            for (i, out) in out.iter_mut().enumerate() {
                let fine = &self.fine[i * self.factor..];
                let value: f64 = fine.iter().zip(&self.weights).map(|(x, w)| x * w).sum();
                *out = T::rounded(value + mean);
            }
        }
        (n_points > 0).then_some(OrderTracked {
            first_rev: begin / points,
            n_points,
            speed_hz: (source.slowest, source.fastest),
        })
    }
}

/// The record at the finer points.
struct Source<'a, T> {
    x: &'a [T],
    fs_hz: f64,
    track: &'a PhaseTrack,
    mean: f64,
    /// Revolutions that may be asked for.
    covered: (f64, f64),
    /// Finer points from revolution 0 to the first of the call.
    origin: f64,
    /// Revolutions a finer point.
    step: f64,
    slowest: f64,
    fastest: f64,
}

impl<T: Real> Source<'_, T> {
    fn fill(&mut self, interpolator: &SincInterpolator, start: usize, out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            let place = self.origin + (start + i) as f64;
            let revolution = (place * self.step).clamp(self.covered.0, self.covered.1);
            let time_s = self.track.time_at(revolution);
            let value = time_s.and_then(|t| interpolator.at(self.x, t * self.fs_hz));
            debug_assert!(value.is_some(), "the margin keeps every point inside");
            *out = value.map_or(0.0, |value| value - self.mean);
            if let Some(speed_hz) = time_s.and_then(|t| self.track.speed_at(t)) {
                self.slowest = self.slowest.min(speed_hz);
                self.fastest = self.fastest.max(speed_hz);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::line;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    const FS_HZ: f64 = 10_000.0;

    fn tracked<T: Real>(
        x: &[f64],
        track: &PhaseTrack,
        points: usize,
        low: f64,
    ) -> (Vec<T>, OrderTracked) {
        let mut plan = OrderTrackPlan::new(points, FS_HZ, low).unwrap();
        let mut out = vec![T::zero(); 200_000];
        let found = plan.process(&narrow::<T>(x), FS_HZ, track, &mut out).unwrap();
        out.truncate(found.n_points);
        (out, found)
    }

    /// Amplitude of an order by the exact line.
    fn amplitude(y: &[f64], points: usize, order: f64) -> f64 {
        line::line_at(y, points as f64, order).unwrap().amplitude
    }

    #[test]
    fn amplitude_error_at_a_quarter_of_the_sampling_rate_is_below_a_thousandth() {
        let track = PhaseTrack::constant(10.0).unwrap();
        // 2048 points are finer than the 1000 samples of a revolution; 640 are not: order 250 lies at
        // 0.39·points of the second.
        for (points, f_hz, tolerance) in
            [(2048, 2500.0, 1e-4), (640, 2500.0, 5e-4), (2048, 4200.0, 1e-3), (1024, 777.7, 1e-4)]
        {
            let x = sine(50_000, FS_HZ, f_hz, 1.0, 0.3);
            let (y, _) = tracked::<f64>(&x, &track, points, 10.0);
            let read = amplitude(&y, points, f_hz / 10.0);
            // Asked: 1e-3. The kernel's ripple is 1e-4 at most, twice where points are left out.
            assert!((read - 1.0).abs() < tolerance, "{points} {f_hz}: {read}");
            let (y, _) = tracked::<f32>(&x, &track, points, 10.0);
            let y: Vec<f64> = y.iter().map(|v| f64::from(*v)).collect();
            assert!((amplitude(&y, points, f_hz / 10.0) - read).abs() < 1e-6, "f32 rounding");
        }
    }

    /// A run-up 10 → 30 r/s in 8 s, and its exact angle.
    fn run_up() -> (PhaseTrack, impl Fn(f64) -> f64) {
        let turned = |t: f64| 10.0 * t + 1.25 * t * t;
        let times_s: Vec<f64> = (0..=80).map(|i| 0.1 * f64::from(i)).collect();
        let revolutions: Vec<f64> = times_s.iter().map(|t| turned(*t)).collect();
        (PhaseTrack::from_knots(&times_s, &revolutions).unwrap(), turned)
    }

    #[test]
    fn orders_of_a_run_up_become_lines() {
        let (track, turned) = run_up();
        let orders = [(1.0, 3.0), (2.5, 0.7), (28.0, 1.0), (56.0, 0.2)];
        let x: Vec<f64> = (0..80_001)
            .map(|i| TAU * turned(i as f64 / FS_HZ))
            .map(|a| {
                orders.iter().map(|(k, amplitude)| amplitude * (k * a).cos()).sum::<f64>() + 1e6
            })
            .collect();
        let points = 256;
        let (y, found) = tracked::<f64>(&x, &track, points, 10.0);
        // 16 samples and 16 points at either end: 0.016 + 1/16 and 0.048 + 1/16 revolutions.
        assert!((found.first_rev - 0.08).abs() < 0.005, "{found:?}");
        assert!((found.n_points as f64 / 256.0 - (160.0 - 0.19)).abs() < 0.01, "{found:?}");
        assert!((found.speed_hz.0 - 10.0).abs() < 0.05 && (found.speed_hz.1 - 30.0).abs() < 0.05);
        for (order, exact) in orders {
            // Leakage of the others at these distances is below 1e-6 of a Hann window.
            let read = amplitude(&y, points, order);
            assert!((read / exact - 1.0).abs() < 1e-4, "order {order}: {read}");
        }
        // Point by point, angle and offset included: the kernels' ripple of lines of 4.9 in all, and
        // the rounding of 1e6.
        for (i, value) in y.iter().enumerate() {
            let a = TAU * (found.first_rev + i as f64 / points as f64);
            let exact = orders.iter().map(|(k, amplitude)| amplitude * (k * a).cos()).sum::<f64>();
            assert!((value - 1e6 - exact).abs() < 3e-4, "{i}");
        }
    }

    #[test]
    fn what_would_fold_is_kept_out_at_every_speed() {
        let (track, _) = run_up();
        // A fixed 3 kHz: order 300 falling to 100 at 64 points; and order 45, above 0.58·64 = 37.
        let fixed = sine(80_001, FS_HZ, 3000.0, 1.0, 0.0);
        let (y, _) = tracked::<f64>(&fixed, &track, 64, 10.0);
        let worst = y.iter().fold(0.0, |worst, v| f64::max(worst, v.abs()));
        // 81 dB, and the interpolator's own 1e-4.
        assert!(worst < 2e-4, "{worst}");
        let turned = |t: f64| 10.0 * t + 1.25 * t * t;
        let x: Vec<f64> =
            (0..80_001).map(|i| (TAU * 45.0 * turned(i as f64 / FS_HZ)).cos()).collect();
        let (y, _) = tracked::<f64>(&x, &track, 64, 10.0);
        assert!(y.iter().all(|v| v.abs() < 2e-4));
    }

    #[test]
    fn noise_keeps_the_power_of_the_orders_that_fit() {
        let track = PhaseTrack::constant(10.0).unwrap();
        let (y, _) = tracked::<f64>(&gaussian_noise(100_000, 4), &track, 250, 10.0);
        // A quarter of the band is kept; 25 000 points scatter by 0.9 %, the edge by its shape.
        let power = stats::Moments::of(&y).variance().unwrap();
        assert!((power / 0.25 - 1.0).abs() < 0.04, "{power}");
    }

    #[test]
    fn records_too_short_and_samples_that_are_no_numbers_give_nothing() {
        let track = PhaseTrack::constant(10.0).unwrap();
        let mut plan = OrderTrackPlan::new(64, FS_HZ, 10.0).unwrap();
        let mut out = vec![0.0_f64; 1000];
        // 16 points are 250 samples: less than a revolution can still be enough for some points.
        for (n, is_enough) in [(0, false), (1, false), (400, false), (600, true)] {
            let found = plan.process(&vec![1.5; n], FS_HZ, &track, &mut out);
            assert_eq!(found.is_some(), is_enough, "{n}");
        }
        assert!((out[0] - 1.5).abs() <= 0.0, "a constant stays what it is, exactly");
        let mut x = vec![0.0; 5000];
        assert!(plan.process(&x, FS_HZ, &track, &mut out[..10]).is_some_and(|f| f.n_points == 10));
        assert!(out[..10].iter().all(|v| v.abs() <= 0.0));
        x[4000] = f64::NAN;
        assert_eq!(plan.process(&x, FS_HZ, &track, &mut out), None);
        assert_eq!(plan.process::<f64>(&[0.0; 5000], FS_HZ, &track, &mut []), None);
        for (points, fs_hz, low) in
            [(0, 1e4, 10.0), (64, 0.0, 10.0), (64, 1e4, 0.0), (64, 1e4, f64::NAN), (2, 1e4, 1e-3)]
        {
            assert!(OrderTrackPlan::new(points, fs_hz, low).is_none());
        }
    }

    #[test]
    fn chunks_leave_no_seams() {
        let track = PhaseTrack::constant(7.3).unwrap();
        let x = gaussian_noise(60_000, 8);
        let (whole, found) = tracked::<f64>(&x, &track, 512, 7.3);
        // One point at a time from a direct sum over the finer points.
        let sinc = SincInterpolator::new(1.0);
        let (factor, weights) = (3, interpolate::decimation_weights(3));
        let mean = stats::mean(&x).unwrap();
        for i in (0..whole.len()).step_by(97) {
            let place = (found.first_rev * 512.0).round() + i as f64;
            let exact: f64 = weights
                .iter()
                .enumerate()
                .map(|(tap, w)| {
                    let fine = place * f64::from(factor) + tap as f64 - 47.0;
                    let position = fine / f64::from(512 * factor) / 7.3 * FS_HZ;
                    w * (sinc.at(&x, position).unwrap() - mean)
                })
                .sum();
            // A position of 6e4 samples is rounded by 7e-12, and the noise is as steep as 3 a sample.
            assert!((whole[i] - mean - exact).abs() < 1e-10, "{i}");
        }
    }
}
