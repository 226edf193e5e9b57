//! A smooth function of the place on the path of contact as pieces of Chebyshev polynomials (R23):
//! what the loop evaluates in place of integrals.

use std::f64::consts::PI;

/// Degree that is tried; what is below the tolerance is cut off.
const DEGREE: usize = 28;

/// Largest relative error of a piece against the function.
pub(super) const TOLERANCE: f64 = 1e-10;

/// A piecewise polynomial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    pieces: Vec<Piece>,
}

#[derive(Debug, Clone, PartialEq)]
struct Piece {
    from: f64,
    to: f64,
    /// Of the Chebyshev polynomials.
    coefficients: Vec<f64>,
    /// The same of the powers of x, four by four, and x = scale·at + shift.
    powers: Vec<[f64; 4]>,
    scale: f64,
    shift: f64,
}

impl Curve {
    /// Fits `f` between the first and the last of `marks`, rising; each is the end of a piece.
    pub(super) fn fit(marks: &[f64], f: impl Fn(f64) -> f64) -> Self {
        let pieces = marks.windows(2).map(|ends| Piece::fit(ends[0], ends[1], &f)).collect();
        Self { pieces }
    }

    /// The curve times a number.
    pub(super) fn times(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        for piece in &mut scaled.pieces {
            let powers = piece.powers.as_flattened_mut().iter_mut();
            powers.chain(&mut piece.coefficients).for_each(|c| *c *= factor);
        }
        scaled
    }

    /// Number of the piece at a place; the nearest one outside.
    pub(super) fn piece(&self, at: f64) -> usize {
        let inside = self.pieces.iter().position(|piece| at <= piece.to);
        inside.unwrap_or(self.pieces.len().saturating_sub(1))
    }

    /// Places between pieces.
    pub(super) fn bends(&self) -> impl Iterator<Item = f64> + '_ {
        self.pieces.iter().skip(1).map(|piece| piece.from)
    }

    /// The value by this piece, continued smoothly beyond its ends.
    pub(super) fn at(&self, piece: usize, at: f64) -> f64 {
        self.pieces.get(piece).map_or(0.0, |piece| piece.at(at))
    }

    /// ∫ over the whole curve.
    pub(super) fn integral(&self) -> f64 {
        let of_piece = |piece: &Piece| {
            let even = piece.coefficients.iter().enumerate().step_by(2);
            let sum: f64 = even.map(|(k, c)| 2.0 * c / (1.0 - (k * k) as f64)).sum();
            0.5 * (piece.to - piece.from) * sum
        };
        self.pieces.iter().map(of_piece).sum()
    }
}

impl Piece {
    fn fit(from: f64, to: f64, f: impl Fn(f64) -> f64) -> Self {
        let n = DEGREE + 1;
        let angle = |j: usize| PI * (j as f64 + 0.5) / n as f64;
        let values: Vec<f64> =
            (0..n).map(|j| f(0.5 * (from + to) + 0.5 * (to - from) * angle(j).cos())).collect();
        let coefficient = |k: usize| {
            let sum: f64 = (0..n).map(|j| values[j] * (k as f64 * angle(j)).cos()).sum();
            sum * if k == 0 { 1.0 } else { 2.0 } / n as f64
        };
        let mut coefficients: Vec<f64> = (0..n).map(coefficient).collect();
        let small = 0.01 * TOLERANCE * coefficients[0].abs();
        while coefficients.len() > 1 && coefficients.last().is_some_and(|c| c.abs() < small) {
            coefficients.pop();
        }
        let (scale, shift) = (2.0 / (to - from), -(from + to) / (to - from));
        Self { from, to, powers: powers(&coefficients), coefficients, scale, shift }
    }

    /// Horner's rule in x⁴, the four powers below it side by side.
    #[inline]
    fn at(&self, at: f64) -> f64 {
        let x = self.scale * at + self.shift;
        let square = x * x;
        let fourth = square * square;
        let mut sums = [0.0; 4];
        for four in self.powers.iter().rev() {
            for (sum, c) in sums.iter_mut().zip(four) {
                *sum = *sum * fourth + c;
            }
        }
        (sums[0] + sums[1] * x) + (sums[2] + sums[3] * x) * square
    }
}

/// Coefficients of the powers of x from those of the Chebyshev polynomials. Rounding grows with
/// Σ |cₖ|·(1 + √2)ᵏ over |c₀|; coefficients of smooth functions fall faster.
fn powers(coefficients: &[f64]) -> Vec<[f64; 4]> {
    let n = coefficients.len();
    let mut sum = vec![[0.0; 4]; n.div_ceil(4)];
    // Tₖ₊₁ = 2x·Tₖ − Tₖ₋₁, from T₀ and T₋₁ = T₁.
    let (mut now, mut before) = (vec![0.0; n + 1], vec![0.0; n + 1]);
    now[0] = 1.0;
    for (k, c) in coefficients.iter().enumerate() {
        let places = sum.as_flattened_mut().iter_mut();
        places.zip(&now).for_each(|(place, power)| *place += c * power);
        let twice = if k == 0 { 1.0 } else { 2.0 };
        let next = (0..=n).map(|i| if i == 0 { 0.0 } else { twice * now[i - 1] } - before[i]);
        let next: Vec<f64> = next.collect();
        before = std::mem::replace(&mut now, next);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_function_is_met_to_the_tolerance_and_its_integral_too() {
        let curve = Curve::fit(&[-1.0, 0.5, 2.0], |x| 1.0 / (3.0 + x));
        for i in 0..=300 {
            let x = -1.0 + f64::from(i) * 0.01;
            let found = curve.at(curve.piece(x), x) * (3.0 + x);
            assert!((found - 1.0).abs() < TOLERANCE, "{x}: {found}");
        }
        assert!((curve.integral() / 2.5_f64.ln() - 1.0).abs() < TOLERANCE);
        assert_eq!(curve.bends().collect::<Vec<_>>(), [0.5]);
        assert!((curve.times(2.0).at(0, 0.0) - 2.0 / 3.0).abs() < TOLERANCE);
    }
}
