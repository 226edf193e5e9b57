//! Jitter of pulses, outliers, smoothing: each pulse against the motion of those around it (D63).

use super::PulseTrainPlan;
use crate::dsp::stats;

/// Pulses on either side that one is compared with.
const HALF_WIDTH: usize = 4;

/// A pulse this many robust standard deviations off is no pulse of this motion.
const OUTLIER: f64 = 5.0;

/// Pulses on either side of those nearest.
const NEAREST: usize = 2;

/// Beyond its end a parabola through eight pulses misses by what a third derivative adds; one through the four nearest differs from it
/// by four fifths of that, and by less where a fourth derivative takes it back.
const CURVED: f64 = 3.0;

/// Correlation of what successive pulses are off the parabola through the four nearest: −0.8 of jitter alone, for that is a fourth difference;
/// of a speed that swings, the cosine of the angle a pulse takes of the swing.
const WHITE: f64 = -0.5;

/// Times the jitter that pulses may be off the parabola that smooths them: then it misses no more of the motion than there is jitter.
const MISSED: f64 = std::f64::consts::SQRT_2;

/// Rounds of taking outliers out.
const MAX_PASSES: usize = 4;

/// Angle as a parabola in time, by least squares; a line through two or three points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parabola {
    origin_s: f64,
    scale_s: f64,
    angle: f64,
    coefficients: [f64; 3],
    /// Sums of powers of the local time.
    normal: [[f64; 3]; 3],
    /// RMS deviation of the points, revolutions.
    pub(super) rms: f64,
}

impl Parabola {
    /// Fits `n` points (time, angle) in an order of time; `None` for fewer than two or for equal times.
    pub(super) fn fit(n: usize, point: impl Fn(usize) -> (f64, f64)) -> Option<Self> {
        let last = n.checked_sub(1).filter(|last| *last > 0)?;
        let (first, last) = (point(0), point(last));
        let (origin_s, scale_s) = (0.5 * (first.0 + last.0), 0.5 * (last.0 - first.0).abs());
        let is_line = n < 4;
        let mut normal = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for i in 0..n {
            let (time_s, angle) = point(i);
            let x = powers((time_s - origin_s) / scale_s);
            for row in 0..3 {
                right[row] += x[row] * (angle - first.1);
                for column in 0..3 {
                    normal[row][column] += x[row] * x[column];
                }
            }
        }
        if is_line {
            // No third coefficient.
            (normal[0][2], normal[1][2]) = (0.0, 0.0);
            normal[2] = [0.0, 0.0, 1.0];
            right[2] = 0.0;
        }
        let coefficients = solve(normal, right)?;
        let mut fitted = Self { origin_s, scale_s, angle: first.1, coefficients, normal, rms: 0.0 };
        let square = |i: usize| (fitted.at(point(i).0) - point(i).1).powi(2);
        fitted.rms = ((0..n).map(square).sum::<f64>() / n as f64).sqrt();
        Some(fitted)
    }

    /// Angle at a time, revolutions.
    pub(super) fn at(&self, time_s: f64) -> f64 {
        let x = powers((time_s - self.origin_s) / self.scale_s);
        self.angle + dot(x, self.coefficients)
    }

    /// Variance of [`Self::at`] over that of a point.
    fn variance_at(&self, time_s: f64) -> Option<f64> {
        let x = powers((time_s - self.origin_s) / self.scale_s);
        solve(self.normal, x).map(|weights| dot(x, weights))
    }
}

fn powers(u: f64) -> [f64; 3] {
    [1.0, u, u * u]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Solves three symmetric, positive equations; `None` if they are singular.
fn solve(mut matrix: [[f64; 3]; 3], mut right: [f64; 3]) -> Option<[f64; 3]> {
    for pivot in 0..3 {
        let upper = matrix[pivot];
        let is_regular = upper[pivot] > 1e-12;
        if !is_regular {
            return None;
        }
        for row in pivot + 1..3 {
            let factor = matrix[row][pivot] / upper[pivot];
            for (value, above) in matrix[row].iter_mut().zip(upper) {
                *value -= factor * above;
            }
            right[row] -= factor * right[pivot];
        }
    }
    for row in (0..3).rev() {
        for column in row + 1..3 {
            right[row] -= matrix[row][column] * right[column];
        }
        right[row] /= matrix[row][row];
    }
    Some(right)
}

impl PulseTrainPlan {
    /// Writes how far each knot is off the parabola through the eight around it, s, over what the
    /// parabola itself is uncertain; returns the RMS. `None` for fewer than ten knots.
    pub(super) fn measure_jitter(&mut self) -> Option<f64> {
        self.measure_residuals(HALF_WIDTH)
    }

    /// The same for the parabola through so many knots on either side.
    fn measure_residuals(&mut self, half_width: usize) -> Option<f64> {
        self.residuals_s.clear();
        if self.knots.len() < 2 * half_width + 2 {
            return None;
        }
        for i in 0..self.knots.len() {
            let residual_s = self.residual_s(i, half_width)?;
            self.residuals_s.push(residual_s);
        }
        stats::rms(&self.residuals_s)
    }

    /// How far a knot is off the parabola through those around it, s, over what jitter makes of that: its RMS is the jitter's, whatever the width.
    fn residual_s(&self, i: usize, half_width: usize) -> Option<f64> {
        let (fitted, speed_hz) = self.around(i, half_width)?;
        let (time_s, mark) = self.knots[i];
        let miss_s = (self.angle_of(mark) - fitted.at(time_s)) / speed_hz;
        Some(miss_s / (1.0 + fitted.variance_at(time_s)?).sqrt())
    }

    /// The parabola through the knots around one without itself, and the mean speed over them: at a start from rest the one at the
    /// knot is 0.
    fn around(&self, i: usize, half_width: usize) -> Option<(Parabola, f64)> {
        let width = 2 * half_width + 1;
        let start = i.saturating_sub(half_width).min(self.knots.len() - width);
        let other = |k: usize| start + k + usize::from(start + k >= i);
        let point = |k: usize| (self.knots[other(k)].0, self.angle_of(self.knots[other(k)].1));
        let (first, last) = (self.knots[start], self.knots[start + width - 1]);
        let speed_hz = (self.angle_of(last.1) - self.angle_of(first.1)) / (last.0 - first.0);
        Some((Parabola::fit(width - 1, point)?, speed_hz))
    }

    /// How far a knot may miss because the motion around it is no parabola, which tells beyond an end, s, over the same as its
    /// residual.
    fn curved_s(&self, i: usize) -> Option<f64> {
        let time_s = self.knots[i].0;
        let ((long, speed_hz), (short, _)) =
            (self.around(i, HALF_WIDTH)?, self.around(i, NEAREST)?);
        let apart_s = (long.at(time_s) - short.at(time_s)).abs() / speed_hz;
        Some(CURVED * apart_s / (1.0 + long.variance_at(time_s)?).sqrt())
    }

    /// Removes knots further than five robust deviations from the motion around them: the worst of
    /// each neighbourhood, which makes its neighbours look bad, then what is still bad.
    pub(super) fn take_out_outliers(&mut self) {
        for _ in 0..MAX_PASSES {
            if self.measure_jitter().is_none() {
                return;
            }
            self.sorted_s.clear();
            self.sorted_s.extend(self.residuals_s.iter().map(|r| r.abs()));
            let typical_s = stats::median(&mut self.sorted_s).unwrap_or(0.0) * stats::SIGMA_PER_MAD;
            // Without jitter: the rounding of the times.
            let rounding_s = 1e-12 * self.knots.last().map_or(0.0, |knot| knot.0.abs());
            let limit_s = OUTLIER * typical_s + rounding_s;
            let n = self.knots.len();
            self.limits_s.clear();
            for i in 0..n {
                let is_far = self.residuals_s[i].abs() > limit_s;
                let curved_s = if is_far { self.curved_s(i) } else { None };
                self.limits_s.push(limit_s.max(curved_s.unwrap_or(0.0)));
            }
            let mut kept = 0;
            for i in 0..n {
                let miss_s = self.residuals_s[i].abs();
                let around = i.saturating_sub(HALF_WIDTH)..n.min(i + HALF_WIDTH + 1);
                let is_worst = self.residuals_s[around].iter().all(|r| r.abs() <= miss_s);
                if miss_s <= self.limits_s[i] || !is_worst {
                    self.knots[kept] = self.knots[i];
                    kept += 1;
                }
            }
            self.counts.n_outliers += n - kept;
            self.knots.truncate(kept);
            if kept == n {
                return;
            }
        }
    }

    /// Knots on either side that smooth one: the most, by halves of those asked for, over which a parabola misses no more of the motion than there
    /// is jitter (D63); 0 if none does, and those asked for where there are too few to tell. `jitter_rms_s`: what [`Self::measure_jitter`] gave.
    pub(super) fn smoothing_half_width(&mut self, jitter_rms_s: Option<f64>) -> usize {
        let asked = self.wheel.smoothing_pulses;
        if asked < NEAREST || self.knots.len() < 2 * asked.max(HALF_WIDTH) + 2 {
            return asked;
        }
        let bearable_s = MISSED * self.white_jitter_s().max(self.wheel.rounding_s);
        let mut half_width = asked;
        loop {
            let missed_s = match half_width {
                HALF_WIDTH => jitter_rms_s,
                _ => self.measure_residuals(half_width),
            };
            if missed_s.is_some_and(|missed_s| missed_s <= bearable_s) {
                return half_width;
            }
            if half_width == NEAREST {
                return 0;
            }
            half_width = (half_width / 2).max(NEAREST);
        }
    }

    /// RMS of what knots are off the parabola through the four nearest, s, if successive ones are off as jitter lets them be; 0 otherwise.
    fn white_jitter_s(&mut self) -> f64 {
        if self.measure_residuals(NEAREST).is_none() {
            return 0.0;
        }
        // At the ends the parabola is not centred.
        let centred = &self.residuals_s[NEAREST..self.residuals_s.len() - NEAREST];
        let square: f64 = centred.iter().map(|r| r * r).sum();
        let product: f64 = centred.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let is_white = square > 0.0 && product <= WHITE * square;
        if is_white { (square / centred.len() as f64).sqrt() } else { 0.0 }
    }

    /// Angle at a knot's time by the parabola through the knots around it, revolutions; `None` if they
    /// are not to be smoothed or are too few.
    pub(super) fn smoothed(&self, i: usize, half: usize) -> Option<f64> {
        let width = (2 * half + 1).min(self.knots.len());
        if half == 0 || width < 5 {
            return None;
        }
        let start = i.saturating_sub(half).min(self.knots.len() - width);
        let point = |k: usize| (self.knots[start + k].0, self.angle_of(self.knots[start + k].1));
        Parabola::fit(width, point).map(|fitted| fitted.at(self.knots[i].0))
    }
}
