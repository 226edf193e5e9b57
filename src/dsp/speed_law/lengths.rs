//! The law of speed by lengths alone: bow and unbalance where no mark gives the 1× vectors a phase.
//!
//! |b + u·g|² = |b|² + 2Re(b*u)·g + |u|²·g² is linear in three unknowns, g the square of the speed. What is lost is the sense of the
//! lag between the two parts, which nobody needs to tell them apart.

use super::Fit;
use super::Part;
use super::VectorAt;
use super::chance;
use super::shapes;
use nalgebra::Matrix3;
use nalgebra::Vector3;
use rustfft::num_complex::Complex;

/// Rounds in which the weights and the noise they depend on settle.
const ROUNDS: usize = 6;

/// Noise assumed in the first round, and the least ever, relative to the mean square.
const FIRST_NOISE: f64 = 1e-2;
const LEAST_NOISE: f64 = 1e-20;

/// Deviations at which the ends of a part are told.
const ENDS: f64 = 2.0;

/// Half the degrees of freedom that three real unknowns leave of n lengths.
pub(super) fn exponent(n: usize) -> f64 {
    0.5 * (n as f64 - 3.0)
}

/// A squared length without resonance.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// 1, h and h²: h the square of the speed over that of the highest.
    powers: Vector3<f64>,
    /// |z|² without resonance.
    square: f64,
    /// Variance of z without resonance along any direction, over that of a vector of weight 1.
    spread: f64,
}

impl Row {
    /// The square without what noise adds to it in the mean, 2σ².
    fn freed(&self, noise: f64) -> f64 {
        self.square - 2.0 * self.spread * noise
    }

    /// Reciprocal variance of the square, 4σ²|z|² + 4σ⁴, times σ² of a vector of weight 1.
    fn weight(&self, model: f64, noise: f64) -> f64 {
        1.0 / (4.0 * self.spread * (model.max(0.0) + self.spread * noise))
    }
}

/// Coefficients of the powers, the inverse of their normal matrix, and the weighted sum of squares left.
struct Solved {
    of: Vector3<f64>,
    inverse: Matrix3<f64>,
    noise: f64,
    left: f64,
    weights: Vec<f64>,
}

/// Least squares of both parts at one critical speed, with the weighted sum of squares they leave (D79).
pub(super) fn fit(vectors: &[VectorAt], critical_hz: f64) -> Option<(f64, Fit)> {
    let top = vectors.iter().map(|v| v.speed_hz).fold(0.0, f64::max);
    let row = |v: &VectorAt| {
        let (raised, _) = shapes(v.speed_hz, critical_hz);
        let h = (v.speed_hz / top).powi(2);
        let inverse_square = 1.0 / (raised * raised);
        Row {
            powers: Vector3::new(1.0, h, h * h),
            square: v.vector.norm_sqr() * inverse_square,
            spread: inverse_square / v.weight,
        }
    };
    let rows: Vec<Row> = vectors.iter().map(row).collect();
    let solved = solve(&rows)?;
    let exponent = exponent(rows.len());
    let part = |at: usize, to_reference: f64, lag: f64| {
        let square = solved.of[at];
        let deviation = ENDS * (solved.noise * solved.inverse[(at, at)]).max(0.0).sqrt();
        let end = |shift: f64| (square + shift).max(0.0).sqrt();
        let length = end(0.0);
        let sigma = (end(deviation) - length).max(length - end(-deviation)) / ENDS;
        // What is negative is not there.
        let left = if square > 0.0 { solved.left } else { f64::INFINITY };
        Part {
            vector: Complex::from_polar(length * to_reference, lag),
            sigma: sigma * to_reference,
            chance: chance(left, alone(&rows, &solved, 2 - at), exponent),
        }
    };
    let (bow, both, unbalance) = (solved.of[0].max(0.0), solved.of[1], solved.of[2].max(0.0));
    let product = 2.0 * (bow * unbalance).sqrt();
    let lag = if product > 0.0 { (both / product).clamp(-1.0, 1.0).acos() } else { 0.0 };
    let (mut missed, mut all) = (0.0, 0.0);
    for row in &rows {
        let should = solved.of.dot(&row.powers).max(0.0).sqrt();
        missed += (row.square.sqrt() - should).powi(2) / row.spread;
        all += row.square / row.spread;
    }
    let fit = Fit {
        critical_hz,
        bow: part(0, 1.0, 0.0),
        unbalance: part(2, (super::REFERENCE_HZ / top).powi(2), lag),
        unexplained: (missed / all).sqrt(),
    };
    Some((solved.left, fit))
}

/// Both parts by weighted least squares; weights and noise follow from each other.
fn solve(rows: &[Row]) -> Option<Solved> {
    let n = rows.len() as f64;
    let mean = |of: fn(&Row) -> f64| rows.iter().map(of).sum::<f64>() / n;
    let scale = mean(|row| row.square) / mean(|row| row.spread);
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let mut noise = FIRST_NOISE * scale;
    let mut model: Vec<f64> = rows.iter().map(|row| row.square).collect();
    let mut solved = None;
    for _ in 0..ROUNDS {
        let weights: Vec<f64> =
            rows.iter().zip(&model).map(|(row, model)| row.weight(*model, noise)).collect();
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (row, weight) in rows.iter().zip(&weights) {
            normal += row.powers * row.powers.transpose() * *weight;
            right += row.powers * (weight * row.freed(noise));
        }
        let inverse = normal.cholesky()?.inverse();
        let of = inverse * right;
        let off = |row: &Row| row.freed(noise) - of.dot(&row.powers);
        let left: f64 = rows.iter().zip(&weights).map(|(row, w)| w * off(row).powi(2)).sum();
        solved = Some(Solved { of, inverse, noise, left, weights });
        model = rows.iter().map(|row| of.dot(&row.powers)).collect();
        noise = (left / (n - 3.0)).max(LEAST_NOISE * scale);
    }
    solved
}

/// The weighted sum of squares that one power alone leaves.
fn alone(rows: &[Row], solved: &Solved, at: usize) -> f64 {
    let weighted = || rows.iter().zip(&solved.weights);
    let (mut normal, mut right) = (0.0, 0.0);
    for (row, weight) in weighted() {
        normal += weight * row.powers[at].powi(2);
        right += weight * row.powers[at] * row.freed(solved.noise);
    }
    let of = right / normal;
    weighted().map(|(row, w)| w * (row.freed(solved.noise) - of * row.powers[at]).powi(2)).sum()
}
