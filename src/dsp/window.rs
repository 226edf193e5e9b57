//! Windows and their gains.
//!
//! Periodic (DFT-even) windows; sums in f64, because a gain summed in f32 costs 4e-6 of every
//! amplitude at 100,000 samples. Must not know transforms.

use std::f64::consts::TAU;

use crate::dsp::real::Real;

/// Shape of a window, as the coefficients of its cosine series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Hann, w = ½ − ½cos(2πn/N): the default; resolution 2 bins, side lobes fall with 18 dB/octave.
    Hann,
    /// Flat-top, five terms (ISO 18431-2 coefficients): a peak bin reads within 0.1 %; wide lobe.
    FlatTop,
}

impl Shape {
    /// Signed cosine-series coefficients a_i of `w[n] = Σ a_i cos(2πin/N)` (D4).
    #[must_use]
    pub fn coefficients(self) -> &'static [f64] {
        match self {
            Self::Hann => &[0.5, -0.5],
            Self::FlatTop => {
                &[0.215_578_95, -0.416_631_58, 0.277_263_158, -0.083_578_947, 0.006_947_368]
            }
        }
    }
}

/// A window of fixed length with its gains.
#[derive(Debug, Clone, PartialEq)]
pub struct Window<T> {
    /// Weights w[0…n−1].
    pub weights: Vec<T>,
    /// Σw: divides a sum to give the amplitude of a line (coherent gain times n).
    pub sum: f64,
    /// Σw²: divides a power sum to give a density.
    pub sum_of_squares: f64,
}

impl<T: Real> Window<T> {
    /// Builds the periodic window of `n` samples (D4). A length below 3 gives a window of ones: a
    /// Hann window of one sample would be zero.
    #[must_use]
    pub fn new(shape: Shape, n: usize) -> Self {
        let exact = weights(shape.coefficients(), n);
        Self {
            weights: exact.iter().map(|w| T::rounded(*w)).collect(),
            sum: exact.iter().sum(),
            sum_of_squares: exact.iter().map(|w| w * w).sum(),
        }
    }

    /// Coherent gain Σw/n (Hann ½); `None` for length 0.
    #[must_use]
    pub fn coherent_gain(&self) -> Option<f64> {
        (!self.weights.is_empty()).then(|| self.sum / self.weights.len() as f64)
    }

    /// Equivalent noise bandwidth n·Σw²/(Σw)² in bins (Hann 1.5); `None` for length 0.
    #[must_use]
    pub fn enbw_bins(&self) -> Option<f64> {
        let square = self.sum * self.sum;
        (square > 0.0).then(|| self.weights.len() as f64 * self.sum_of_squares / square)
    }
}

/// The angle is exact every so many samples and turned on by one step in between: a plan of 100,000
/// samples would spend more time on cosines than on transforms. 64 roundings are 1e-14 at most.
const EXACT_EVERY: usize = 64;

fn weights(coefficients: &[f64], n: usize) -> Vec<f64> {
    if n < 3 {
        return vec![1.0; n];
    }
    let (step_sin, step_cos) = (TAU / n as f64).sin_cos();
    let mut weights = Vec::with_capacity(n);
    for start in (0..n).step_by(EXACT_EVERY) {
        let (mut sin, mut cos) = (TAU * start as f64 / n as f64).sin_cos();
        for _ in start..n.min(start + EXACT_EVERY) {
            weights.push(cosine_series(coefficients, cos));
            (sin, cos) = (sin * step_cos + cos * step_sin, cos * step_cos - sin * step_sin);
        }
    }
    weights
}

/// Σ aᵢ·cos(iθ) from cos θ, by cos((i+1)θ) = 2·cos θ·cos(iθ) − cos((i−1)θ).
fn cosine_series(coefficients: &[f64], cos: f64) -> f64 {
    let (mut term, mut next) = (1.0, cos);
    let mut sum = 0.0;
    for a in coefficients {
        sum += a * term;
        (term, next) = (next, 2.0 * cos * next - term);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_series() {
        for (shape, n) in [(Shape::Hann, 3), (Shape::Hann, 10_007), (Shape::FlatTop, 4096)] {
            let window = Window::<f64>::new(shape, n);
            for (i, weight) in window.weights.iter().enumerate() {
                let angle = TAU * i as f64 / n as f64;
                let terms = shape.coefficients().iter().enumerate();
                let exact: f64 = terms.map(|(order, a)| a * (angle * order as f64).cos()).sum();
                // 64 roundings, sixteenfold in the fourth order.
                assert!((weight - exact).abs() < 1e-13, "{shape:?} {n} {i}: {weight} {exact}");
            }
        }
    }

    #[test]
    fn gains_have_their_closed_forms() {
        let hann = Window::<f32>::new(Shape::Hann, 100_000);
        // Exact for the periodic window; 1e-12 is the rounding of 1e5 additions.
        assert!((hann.coherent_gain().unwrap() - 0.5).abs() < 1e-12);
        assert!((hann.enbw_bins().unwrap() - 1.5).abs() < 1e-12);
        let flat = Window::<f64>::new(Shape::FlatTop, 64);
        // ENBW of a cosine series: 1 + ½Σ(a_i/a_0)² = 3.7702.
        assert!((flat.enbw_bins().unwrap() - 3.7702).abs() < 1e-3);
    }

    #[test]
    fn short_windows_do_not_vanish() {
        assert_eq!(Window::<f64>::new(Shape::Hann, 0).coherent_gain(), None);
        assert_eq!(Window::<f64>::new(Shape::Hann, 1).weights, vec![1.0]);
        assert_eq!(Window::<f64>::new(Shape::Hann, 2).sum.to_bits(), 2f64.to_bits());
    }
}
