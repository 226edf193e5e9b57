//! Anti-alias filters in continuous time, as coordinates of the linear system (equation R35).
//!
//! A filter is its poles: each is one more coordinate that turns and decays by itself. What passes is
//! exact whatever the step is, jumps of the acceleration included. Must not know what is filtered.

use nalgebra::Complex;
use std::f64::consts::{PI, TAU};

/// Order of the filter.
const ORDER: u32 = 8;

/// A Butterworth low-pass H(s) = Σ R/(s − μ).
#[derive(Debug, Clone)]
pub(super) struct LowPass {
    /// All poles μ, rad/s: the upper half first, then their conjugates.
    poles: Vec<Complex<f64>>,
    corner_rad_per_s: f64,
}

impl LowPass {
    /// The low-pass with −3 dB at this frequency.
    pub(super) fn butterworth(corner_hz: f64) -> Self {
        let corner_rad_per_s = TAU * corner_hz;
        let pole = |i: u32| {
            let angle = PI * f64::from(2 * i + ORDER + 1) / f64::from(2 * ORDER);
            Complex::from_polar(corner_rad_per_s, angle)
        };
        let upper: Vec<Complex<f64>> = (0..ORDER / 2).map(pole).collect();
        let poles = upper.iter().copied().chain(upper.iter().map(|pole| pole.conj())).collect();
        Self { poles, corner_rad_per_s }
    }

    /// One pole of each conjugate pair, with its residue R.
    pub(super) fn halves(&self) -> impl Iterator<Item = (Complex<f64>, Complex<f64>)> {
        let halves = self.poles.iter().take(self.poles.len() / 2).enumerate();
        halves.map(|(i, pole)| {
            let others = self.poles.iter().enumerate().filter(move |(j, _)| *j != i);
            // Divided one by one: the corner to the eighth power would lose no digits, but range.
            let residue = others.fold(Complex::new(self.corner_rad_per_s, 0.0), |r, (_, other)| {
                r * self.corner_rad_per_s / (pole - other)
            });
            (*pole, residue)
        })
    }

    /// H(s).
    pub(super) fn response(&self, s: Complex<f64>) -> Complex<f64> {
        self.poles
            .iter()
            .fold(Complex::new(1.0, 0.0), |h, pole| h * self.corner_rad_per_s / (s - pole))
    }
}
