//! A cubic that only rises, through rising knots.
//!
//! Piecewise cubic Hermite interpolation (D60): three-point slopes, limited so that no piece turns
//! back, hence with an inverse. Must not know what rises.

use crate::dsp::order::around;

/// Slope at a knot at most this many times that of the lines beside it: enough that no cubic turns
/// back (Fritsch & Carlson 1980).
const STEEPEST: f64 = 3.0;

/// Steps of the search for a place: bisection alone would end at 52.
const MAX_STEPS: usize = 60;

/// Slopes dy/dx at the knots, of the parabola through each knot and its neighbours; at an end of the
/// parabola through the last three; of the line for two knots alone. `x` ascends, `y` rises.
pub(in crate::dsp) fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let secant = |i: usize| (y[i + 1] - y[i]) / (x[i + 1] - x[i]);
    let n = x.len();
    if n < 3 {
        return vec![secant(0); n];
    }
    let at = |i: usize| {
        let middle = i.clamp(1, n - 2);
        let (before, after) = (secant(middle - 1), secant(middle));
        // Divided differences: the parabola's slope at its middle, then along it to the end.
        let (h0, h1) = (x[middle] - x[middle - 1], x[middle + 1] - x[middle]);
        let curvature = (after - before) / (h0 + h1);
        let slope = before + curvature * h0 + 2.0 * curvature * (x[i] - x[middle]);
        let steepest = STEEPEST * secant(i.saturating_sub(1)).min(secant(i.min(n - 2)));
        slope.clamp(0.0, steepest)
    };
    (0..n).map(at).collect()
}

/// Value at `at`; `None` outside the knots.
pub(in crate::dsp) fn value_at(x: &[f64], y: &[f64], slopes: &[f64], at: f64) -> Option<f64> {
    let (below, above) = around(x, at)?;
    let piece = Piece::between(x, y, slopes, below, above);
    Some(piece.value((at - piece.x0) / piece.width))
}

/// Slope at `at`; `None` outside the knots.
pub(in crate::dsp) fn slope_at(x: &[f64], y: &[f64], slopes: &[f64], at: f64) -> Option<f64> {
    let (below, above) = around(x, at)?;
    let piece = Piece::between(x, y, slopes, below, above);
    Some(piece.slope((at - piece.x0) / piece.width) / piece.width)
}

/// Place where the value is `value`; `None` outside the knots.
pub(in crate::dsp) fn place_of(x: &[f64], y: &[f64], slopes: &[f64], value: f64) -> Option<f64> {
    let (below, above) = around(y, value)?;
    let piece = Piece::between(x, y, slopes, below, above);
    Some(piece.x0 + piece.width * piece.solve(value - piece.y0))
}

/// One cubic over u = 0…1.
struct Piece {
    x0: f64,
    width: f64,
    y0: f64,
    rise: f64,
    /// Slopes at both ends, times the width.
    start: f64,
    end: f64,
}

impl Piece {
    fn between(x: &[f64], y: &[f64], slopes: &[f64], below: usize, above: usize) -> Self {
        let width = x[above] - x[below];
        Self {
            x0: x[below],
            width,
            y0: y[below],
            rise: y[above] - y[below],
            start: slopes[below] * width,
            end: slopes[above] * width,
        }
    }

    /// y − y0 as u·(start + u·(c₂ + u·c₃)).
    fn coefficients(&self) -> (f64, f64) {
        let (c2, c3) = (
            3.0 * self.rise - 2.0 * self.start - self.end,
            self.start + self.end - 2.0 * self.rise,
        );
        (c2, c3)
    }

    fn value(&self, u: f64) -> f64 {
        self.y0 + self.above_start(u)
    }

    fn above_start(&self, u: f64) -> f64 {
        let (c2, c3) = self.coefficients();
        u * (self.start + u * (c2 + u * c3))
    }

    fn slope(&self, u: f64) -> f64 {
        let (c2, c3) = self.coefficients();
        self.start + u * (2.0 * c2 + 3.0 * u * c3)
    }

    /// u of a value above y0: Newton's steps, bisection where one leaves the bracket.
    fn solve(&self, value: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        let mut u = (value / self.rise).clamp(0.0, 1.0);
        for _ in 0..MAX_STEPS {
            let excess = self.above_start(u) - value;
            if excess > 0.0 {
                high = u;
            } else {
                low = u;
            }
            let step = excess / self.slope(u);
            let next = u - step;
            // Not a number where the slope is 0: bisect as well.
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - u).abs() < 1e-16 || excess.abs() < 1e-16 * self.rise {
                return u;
            }
            u = next;
        }
        u
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabolas_are_exact_and_cubics_within_the_stated_error() {
        let x = [0.0, 0.3, 1.0, 1.4, 2.5];
        let parabola = |x: f64| 1.0 + 2.0 * x + 0.7 * x * x;
        let y = x.map(parabola);
        let slopes = slopes(&x, &y);
        for i in 0..=250 {
            let at = 0.01 * f64::from(i);
            assert!((value_at(&x, &y, &slopes, at).unwrap() - parabola(at)).abs() < 1e-14);
            assert!((place_of(&x, &y, &slopes, parabola(at)).unwrap() - at).abs() < 1e-14);
        }
        let x: Vec<f64> = (0..=20).map(|i| 0.1 * f64::from(i)).collect();
        let cubic = |x: f64| x + x * x * x / 6.0;
        let y: Vec<f64> = x.iter().map(|x| cubic(*x)).collect();
        let slopes = super::slopes(&x, &y);
        for i in 0..=2000 {
            let at = 0.001 * f64::from(i);
            let error = (value_at(&x, &y, &slopes, at).unwrap() - cubic(at)).abs();
            // Slopes are h²/6·y‴ off inside and h²/3 at an end (the other way round); the Hermite
            // functions of two equal errors of one sign sum to h·√3/18.
            let inside = (0.1..=1.9).contains(&at);
            let bound = 1e-3 / (9.0 * 3f64.sqrt()) * if inside { 1.0 / 3.0 } else { 1.0 };
            assert!(error < bound, "{at}: {error}");
        }
    }

    #[test]
    fn steps_do_not_overshoot() {
        let (x, y) = ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1e-9, 1.0, 1.0 + 1e-9, 2.0]);
        let slopes = slopes(&x, &y);
        let values: Vec<f64> =
            (0..=400).map(|i| value_at(&x, &y, &slopes, 0.01 * f64::from(i)).unwrap()).collect();
        assert!(values.windows(2).all(|pair| pair[1] >= pair[0]));
        for i in 0..=400 {
            let value = 0.005 * f64::from(i);
            let place = place_of(&x, &y, &slopes, value).unwrap();
            assert!((value_at(&x, &y, &slopes, place).unwrap() - value).abs() < 1e-15 * 4.0);
        }
    }
}
