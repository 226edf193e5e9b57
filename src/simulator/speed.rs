//! Shaft angle, speed and angular acceleration as functions of time (equation R8).

use std::f64::consts::TAU;

/// How the shaft turns.
#[derive(Debug, Clone, PartialEq)]
pub enum SpeedProfile {
    /// For ever at one speed, Hz.
    Constant(f64),
    /// Straight lines between (time s, speed Hz), times rising; before the first and after the last
    /// constant.
    Table(Vec<(f64, f64)>),
}

/// The shaft at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    /// Angle φ, rad, 0 at time 0.
    pub angle_rad: f64,
    /// Speed Ω, rad/s.
    pub speed_rad_per_s: f64,
    /// Acceleration, rad/s².
    pub acceleration_rad_per_s2: f64,
}

impl SpeedProfile {
    /// The shaft at a time ≥ 0, s; at a bend as after it.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Turning {
        self.at_side(time_s, time_s)
    }

    /// The shaft at a time, s, on the straight line that holds at `side_s`: at a bend, and in a step
    /// that ends or begins there, the acceleration is that of the side.
    #[must_use]
    pub fn at_side(&self, time_s: f64, side_s: f64) -> Turning {
        let points = match self {
            Self::Constant(speed_hz) => return steady(*speed_hz, time_s),
            Self::Table(points) => points,
        };
        let Some(&(first_s, first_hz)) = points.first() else { return steady(0.0, time_s) };
        if side_s < first_s {
            return steady(first_hz, time_s);
        }
        let mut turns = first_hz * first_s;
        for pair in points.windows(2) {
            let ((from_s, from_hz), (to_s, to_hz)) = (pair[0], pair[1]);
            let slope = (to_hz - from_hz) / (to_s - from_s);
            if side_s < to_s {
                let t = time_s - from_s;
                return Turning {
                    angle_rad: TAU * (turns + from_hz * t + 0.5 * slope * t * t),
                    speed_rad_per_s: TAU * (from_hz + slope * t),
                    acceleration_rad_per_s2: TAU * slope,
                };
            }
            turns += 0.5 * (from_hz + to_hz) * (to_s - from_s);
        }
        let (last_s, last_hz) = points[points.len() - 1];
        let after = steady(last_hz, time_s - last_s);
        Turning { angle_rad: after.angle_rad + TAU * turns, ..after }
    }

    /// The first time after `after_s` and up to `until_s` at which the angle passes `angle_rad`, in
    /// either sense; `None` if it does not.
    ///
    /// The interval lies between two bends of the profile or holds no reversal of the speed.
    #[must_use]
    pub fn passes(&self, angle_rad: f64, after_s: f64, until_s: f64) -> Option<f64> {
        if let Self::Constant(speed_hz) = self {
            let speed = TAU * speed_hz;
            let time_s = angle_rad / speed;
            return (time_s > after_s && time_s <= until_s).then_some(time_s);
        }
        let offset = |time_s: f64| self.at(time_s).angle_rad - angle_rad;
        let (mut low, mut high) = (after_s, until_s);
        let (at_low, at_high) = (offset(low), offset(high));
        let crosses = (at_low < 0.0) != (at_high < 0.0) || at_high.abs() <= 0.0;
        if !crosses || at_low.abs() <= 0.0 {
            return None;
        }
        // Bisection to the last bit: about 50 halvings of a step.
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if (offset(middle) < 0.0) == (at_low < 0.0) { low = middle } else { high = middle }
        }
        Some(high)
    }

    /// The speed, rad/s, if it never changes.
    #[must_use]
    pub fn constant_rad_per_s(&self) -> Option<f64> {
        match self {
            Self::Constant(speed_hz) => Some(TAU * speed_hz),
            Self::Table(_) => None,
        }
    }

    /// The first time between two, both excluded, at which the speed passes zero inside a straight
    /// line of the profile.
    #[must_use]
    pub fn reversal(&self, after_s: f64, before_s: f64) -> Option<f64> {
        let Self::Table(points) = self else { return None };
        let zero = |pair: &[(f64, f64)]| {
            let ((from_s, from_hz), (to_s, to_hz)) = (pair[0], pair[1]);
            let crosses = (from_hz < 0.0) != (to_hz < 0.0);
            crosses.then(|| from_s + (to_s - from_s) * from_hz / (from_hz - to_hz))
        };
        points.windows(2).filter_map(zero).find(|t| *t > after_s && *t < before_s)
    }

    /// Fastest speed, rad/s, without sign.
    #[must_use]
    pub fn fastest_rad_per_s(&self) -> f64 {
        match self {
            Self::Constant(speed_hz) => TAU * speed_hz.abs(),
            Self::Table(points) => points.iter().map(|(_, hz)| TAU * hz.abs()).fold(0.0, f64::max),
        }
    }
}

fn steady(speed_hz: f64, time_s: f64) -> Turning {
    let speed_rad_per_s = TAU * speed_hz;
    Turning { angle_rad: speed_rad_per_s * time_s, speed_rad_per_s, acceleration_rad_per_s2: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_is_the_integral_of_the_speed() {
        let profile = SpeedProfile::Table(vec![(0.5, 10.0), (1.5, 30.0), (2.0, -10.0)]);
        let (mut sum, h) = (0.0, 1e-4);
        for i in 0..30_000_u32 {
            let t = f64::from(i) * h;
            let mid = profile.at(t + 0.5 * h);
            sum += mid.speed_rad_per_s * h;
            // The midpoint rule is exact on straight lines; bends lie on the grid.
            let end = profile.at(t + h).angle_rad;
            assert!((end - sum).abs() < 1e-8, "{t}: {end} {sum}");
        }
        assert!((profile.at(1.0).acceleration_rad_per_s2 - TAU * 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_reversal_is_found_once() {
        let profile = SpeedProfile::Table(vec![(0.5, 10.0), (1.5, -30.0), (2.0, 10.0)]);
        let first = profile.reversal(0.0, 3.0).unwrap();
        assert!((first - 0.75).abs() < 1e-15 && profile.at(first).speed_rad_per_s.abs() < 1e-12);
        let second = profile.reversal(first, 3.0).unwrap();
        assert!((second - 1.875).abs() < 1e-15, "{second}");
        assert_eq!(profile.reversal(second, 3.0), None);
        assert_eq!(SpeedProfile::Constant(-1.0).reversal(0.0, 1.0), None);
    }

    #[test]
    fn at_a_bend_the_side_decides() {
        let profile = SpeedProfile::Table(vec![(0.0, 0.0), (0.5, 10.0), (1.5, 30.0)]);
        for (time_s, before_s, after_s) in [(0.5, 0.4, 0.6), (1.5, 1.4, 1.6), (0.0, -0.1, 0.1)] {
            let (before, after) =
                (profile.at_side(time_s, before_s), profile.at_side(time_s, after_s));
            // Angle and speed have no jump, but for rounding; the acceleration has.
            assert!((before.angle_rad - after.angle_rad).abs() < 1e-12);
            assert!((before.speed_rad_per_s - after.speed_rad_per_s).abs() < 1e-12);
            let jump = after.acceleration_rad_per_s2 - before.acceleration_rad_per_s2;
            let expected = if time_s > 1.0 {
                -20.0
            } else if time_s > 0.0 {
                0.0
            } else {
                20.0
            };
            assert!((jump - TAU * expected).abs() < 1e-9, "{time_s}: {jump}");
            assert_eq!(profile.at(time_s), after, "at the bend as after it");
        }
    }

    #[test]
    fn passing_an_angle_is_found_at_any_speed() {
        let ramp = SpeedProfile::Table(vec![(0.0, 0.0), (2.0, 40.0)]);
        let found = ramp.passes(5.0, 0.0, 1.0).unwrap();
        // φ = 2π·10·t²
        assert!((found - (5.0 / (TAU * 10.0)).sqrt()).abs() < 1e-14, "{found}");
        assert_eq!(ramp.passes(5.0, found, 1.0), None, "an event is not found twice");
        let steady = SpeedProfile::Constant(40.0);
        assert!((steady.passes(TAU, 0.0, 1.0).unwrap() - 0.025).abs() < 1e-16);
        assert_eq!(SpeedProfile::Constant(0.0).passes(1.0, 0.0, 1.0), None);
    }
}
