//! Recursive filters as second-order sections: streaming with state, and forward and backward.
//!
//! Coefficients and state are f64 whatever the samples are: with a cut-off far below the rate the poles
//! of f32 would not lie where they should. Must not know how a filter was designed.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;

/// b₀ + b₁z⁻¹ + b₂z⁻² over 1 + a₁z⁻¹ + a₂z⁻².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Numerator b₀, b₁, b₂.
    pub b: [f64; 3],
    /// Denominator a₁, a₂; a₀ is 1. Stable for |a₂| < 1 and |a₁| < 1 + a₂.
    pub a: [f64; 2],
}

impl Section {
    /// Gain for a constant, Σb/(1 + Σa).
    fn constant_gain(&self) -> f64 {
        self.b.iter().sum::<f64>() / (1.0 + self.a[0] + self.a[1])
    }

    /// Largest magnitude of its poles.
    fn pole_radius(&self) -> f64 {
        let half = 0.5 * self.a[0];
        let square = half * half - self.a[1];
        if square > 0.0 { half.abs() + square.sqrt() } else { self.a[1].sqrt() }
    }
}

/// Complex gain of a cascade at `f_hz`: Π b(z)/a(z), z = e^(j2πf/fs).
#[must_use]
pub fn response(sections: &[Section], f_hz: f64, fs_hz: f64) -> Complex<f64> {
    let step = Complex::from_polar(1.0, -TAU * f_hz / fs_hz);
    let gain = |s: &Section| {
        (step * step * s.b[2] + step * s.b[1] + s.b[0])
            / (step * step * s.a[1] + step * s.a[0] + 1.0)
    };
    sections.iter().map(gain).product()
}

/// Below this a state is nothing: a filter that hears silence would else end in denormal numbers, a
/// hundred times slower, and may stay there.
const NOTHING: f64 = 1e-150;

/// Samples after which that is looked for; counted through, so that blocks do not matter.
const LOOK_EVERY: u32 = 64;

/// A cascade with its state: blocks of any lengths give what the whole would, bit by bit (D37).
///
/// Transposed direct form II. Rounding does not add up: an error of ε in a state has died after
/// 1/(1 − r) samples, r the largest pole radius, so the error stays below about ε/(1 − r) of the
/// largest state however long it runs.
#[derive(Debug, Clone)]
pub struct SosFilter {
    sections: Vec<Section>,
    states: Vec<[f64; 2]>,
    n_since_look: u32,
}

impl SosFilter {
    /// Makes a filter at rest; without sections it copies.
    #[must_use]
    pub fn new(sections: Vec<Section>) -> Self {
        let states = vec![[0.0; 2]; sections.len()];
        Self { sections, states, n_since_look: 0 }
    }

    /// The sections, in the order of processing.
    #[must_use]
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Forgets everything: at rest.
    pub fn reset(&mut self) {
        self.states.fill([0.0; 2]);
        self.n_since_look = 0;
    }

    /// Puts the filter where an endless constant `value` would have brought it, so that a first sample
    /// of that (a gap voltage) makes no step.
    pub fn settle(&mut self, value: f64) {
        let mut x = value;
        for (section, state) in self.sections.iter().zip(&mut self.states) {
            let y = section.constant_gain() * x;
            *state = [y - section.b[0] * x, section.b[2] * x - section.a[1] * y];
            x = y;
        }
        self.n_since_look = 0;
    }

    /// Filters `x` into `out`, behind what came before.
    ///
    /// `x`, `out`: any length, one unit. A sine at f comes out with the gain and lag of [`response`],
    /// once what the start made has died away.
    ///
    /// # Panics
    ///
    /// If the slices differ in length.
    pub fn process<T: Real>(&mut self, x: &[T], out: &mut [T]) {
        assert_eq!(x.len(), out.len(), "one sample per sample");
        for (out, x) in out.iter_mut().zip(x) {
            *out = T::rounded(self.step(x.to_f64()));
        }
    }

    fn step(&mut self, mut x: f64) -> f64 {
        for (section, state) in self.sections.iter().zip(&mut self.states) {
            let ([b0, b1, b2], [a1, a2]) = (section.b, section.a);
            let y = b0 * x + state[0];
            *state = [b1 * x - a1 * y + state[1], b2 * x - a2 * y];
            x = y;
        }
        self.n_since_look += 1;
        if self.n_since_look == LOOK_EVERY {
            self.n_since_look = 0;
            self.drop_nothing();
        }
        x
    }

    fn drop_nothing(&mut self) {
        for value in self.states.as_flattened_mut() {
            if value.abs() < NOTHING {
                *value = 0.0;
            }
        }
    }
}

/// What the transient of a filter may have left when the extension of a record ends.
const LEFT: f64 = 1e-3;

/// A cascade run forward and backward over a record: no lag, the gain squared (D38).
///
/// Beyond either end the record goes on as its own point reflection (2x₀ − x), from a state settled on
/// its first value. Within [`ZeroPhasePlan::n_edge`] samples of an end the result depends on that.
#[derive(Debug)]
pub struct ZeroPhasePlan {
    filter: SosFilter,
    n: usize,
    n_edge: usize,
    extended: Vec<f64>,
}

impl ZeroPhasePlan {
    /// Plans for `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, sections: Vec<Section>) -> Self {
        assert!(n > 0, "a record has at least one sample");
        let radius = sections.iter().map(Section::pole_radius).fold(0.0, f64::max);
        let n_edge = ceil_index(LEFT.ln() / radius.ln()).max(6 * sections.len());
        let n_pad = n_edge.min(n - 1);
        Self { filter: SosFilter::new(sections), n, n_edge, extended: vec![0.0; n + 2 * n_pad] }
    }

    /// Samples at either end that depend on how the record was continued: what the slowest pole needs
    /// to fall to 1e-3. A record shorter than twice that is edge throughout.
    #[must_use]
    pub fn n_edge(&self) -> usize {
        self.n_edge
    }

    /// Writes the filtered record.
    ///
    /// `x`, `out`: n samples, one unit. A sine at f comes out in phase with |H(f)|², so −6 dB where one
    /// pass has −3 dB.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process<T: Real>(&mut self, x: &[T], out: &mut [T]) {
        assert!(x.len() == self.n && out.len() == self.n, "samples of the plan");
        let n_pad = (self.extended.len() - self.n) / 2;
        let (first, last) = (x[0].to_f64(), x[self.n - 1].to_f64());
        let (before, rest) = self.extended.split_at_mut(n_pad);
        let (middle, behind) = rest.split_at_mut(self.n);
        for (to, from) in before.iter_mut().rev().zip(&x[1..]) {
            *to = 2.0 * first - from.to_f64();
        }
        for (to, from) in behind.iter_mut().zip(x[..self.n - 1].iter().rev()) {
            *to = 2.0 * last - from.to_f64();
        }
        for (to, from) in middle.iter_mut().zip(x) {
            *to = from.to_f64();
        }
        self.pass(false);
        self.pass(true);
        for (to, from) in out.iter_mut().zip(&self.extended[n_pad..]) {
            *to = T::rounded(*from);
        }
    }

    fn pass(&mut self, is_backward: bool) {
        let filter = &mut self.filter;
        let start = if is_backward { self.extended.last() } else { self.extended.first() };
        filter.settle(start.copied().unwrap_or(0.0));
        let mut advance = |value: &mut f64| *value = filter.step(*value);
        if is_backward {
            self.extended.iter_mut().rev().for_each(&mut advance);
        } else {
            self.extended.iter_mut().for_each(&mut advance);
        }
    }
}

#[cfg(test)]
#[path = "sos_tests.rs"]
mod tests;
