//! Filters of finite length: linear phase, streaming, and decimation by whole factors.
//!
//! Sums of the last samples only, so nothing recurs and nothing can drift. Must not know what is
//! filtered.

use std::f64::consts::PI;
use std::f64::consts::TAU;

use pulp::Arch;

use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::window;

/// What a filter lets through, and how well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirSpec {
    /// Lower edge, Hz; 0: down to a constant.
    pub low_hz: f64,
    /// Upper edge, Hz; fs/2: up to Nyquist.
    pub high_hz: f64,
    /// Width of the way from pass to stop band, Hz; an edge is its middle (−6 dB).
    pub transition_hz: f64,
    /// Attenuation of the stop band, dB; the pass band ripples by as little, 10^(−dB/20).
    pub stop_db: f64,
}

/// Designs the symmetric coefficients by a Kaiser window (D40).
///
/// An odd number of them, N = 1 + 2·⌈(A + 2 − 7.95)/(2.285·Δω)/2⌉, so the lag is (N − 1)/2 samples at all
/// frequencies. `None` if the band is empty or not inside 0…fs/2, or the transition is not positive or
/// so narrow that more than a million were needed.
#[must_use]
pub fn design(spec: &FirSpec, fs_hz: f64) -> Option<Vec<f64>> {
    let (low, high) = (spec.low_hz / fs_hz, spec.high_hz / fs_hz);
    let transition = spec.transition_hz / fs_hz;
    let is_possible = low >= 0.0 && low < high && high <= 0.5 && transition > 0.0;
    if !is_possible || !spec.stop_db.is_finite() {
        return None;
    }
    let half = half_length(spec.stop_db, transition);
    let beta = window::kaiser_beta(spec.stop_db + MARGIN_DB);
    (half <= 500_000).then(|| coefficients(low, high, half, beta))
}

/// What Kaiser's formulas may miss, and what the ripples of two edges add to one another.
const MARGIN_DB: f64 = 2.0;

/// Coefficients on either side of the middle; `transition` in cycles a sample.
fn half_length(stop_db: f64, transition: f64) -> usize {
    let least = (stop_db + MARGIN_DB - 7.95).max(1.0) / (2.285 * TAU * transition);
    ceil_index(0.5 * least).max(1)
}

/// The ideal response of a band, in cycles a sample, under a Kaiser window of 2·`half` + 1.
fn coefficients(low: f64, high: f64, half: usize, beta: f64) -> Vec<f64> {
    let ideal = |i: f64| {
        let low_pass = |edge: f64| {
            // Up to Nyquist is everything: 1 at the middle, 0 elsewhere, without the sine's rounding.
            if i.abs() < 0.5 {
                2.0 * edge
            } else if edge >= 0.5 {
                0.0
            } else {
                (TAU * edge * i).sin() / (PI * i)
            }
        };
        low_pass(high) - low_pass(low)
    };
    let at = |i: usize| {
        let distance = i as f64 - half as f64;
        ideal(distance) * window::kaiser(beta, distance / (half as f64 + 1.0))
    };
    (0..=2 * half).map(at).collect()
}

/// Samples taken in at once; a block of any length is cut into these.
const CHUNK: usize = 1024;

/// Parallel accumulators.
const LANES: usize = 16;

/// A finite filter with its history: blocks of any lengths give what the whole would, bit by bit
/// (D41).
///
/// Every output is its own sum in f64, in an order that does not depend on the blocks.
#[derive(Debug, Clone)]
pub struct FirFilter {
    /// Last coefficient first, so that a sum runs forward in time.
    coefficients: Vec<f64>,
    /// The last N − 1 samples, then room for a chunk.
    samples: Vec<f64>,
    step: usize,
    /// Samples to come before the next output.
    wait: usize,
}

impl FirFilter {
    /// Makes a filter at rest: before the first sample there were zeros.
    ///
    /// # Panics
    ///
    /// If there are no coefficients.
    #[must_use]
    pub fn new(coefficients: &[f64]) -> Self {
        Self::with_step(coefficients, 1)
    }

    fn with_step(coefficients: &[f64], step: usize) -> Self {
        assert!(!coefficients.is_empty() && step > 0, "at least one coefficient, a step forward");
        Self {
            coefficients: coefficients.iter().rev().copied().collect(),
            samples: vec![0.0; coefficients.len() - 1 + CHUNK],
            step,
            wait: 0,
        }
    }

    /// Number of coefficients N; the first N − 1 outputs still hold the zeros before the start.
    #[must_use]
    pub fn n_coefficients(&self) -> usize {
        self.coefficients.len()
    }

    /// Lag of a symmetric filter, samples: (N − 1)/2.
    #[must_use]
    pub fn lag_samples(&self) -> f64 {
        0.5 * (self.coefficients.len() - 1) as f64
    }

    /// Forgets everything: zeros before the next sample.
    pub fn reset(&mut self) {
        self.samples.fill(0.0);
        self.wait = 0;
    }

    /// Goes on as if the signal had been `value` for ever: a gap voltage makes no step.
    pub fn settle(&mut self, value: f64) {
        self.samples.fill(value);
    }

    /// Filters `x` into `out`, behind what came before.
    ///
    /// `x`, `out`: any length, one unit.
    ///
    /// # Panics
    ///
    /// If the slices differ in length.
    pub fn process<T: Real>(&mut self, x: &[T], out: &mut [T]) {
        assert_eq!(x.len(), out.len(), "one sample per sample");
        self.advance(x, out);
    }

    /// Takes `x` in and writes the outputs that fall due; returns their number.
    fn advance<T: Real>(&mut self, x: &[T], out: &mut [T]) -> usize {
        let n_history = self.coefficients.len() - 1;
        let mut n_written = 0;
        for chunk in x.chunks(CHUNK) {
            for (to, from) in self.samples[n_history..].iter_mut().zip(chunk) {
                *to = from.to_f64();
            }
            let due = chunk.len().saturating_sub(self.wait).div_ceil(self.step);
            let outputs = &mut out[n_written..n_written + due];
            let (samples, coefficients) = (&self.samples, &self.coefficients);
            Arch::new().dispatch(
                #[inline(always)]
                || {
                    for (k, output) in outputs.iter_mut().enumerate() {
                        let first = self.wait + k * self.step;
                        *output =
                            T::rounded(dot(&samples[first..=first + n_history], coefficients));
                    }
                },
            );
            n_written += due;
            self.wait += due * self.step;
            self.wait -= chunk.len();
            self.samples.copy_within(chunk.len()..chunk.len() + n_history, 0);
        }
        n_written
    }
}

#[inline(always)]
fn dot(x: &[f64], coefficients: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let ((x, x_rest), (h, h_rest)) = (x.as_chunks::<LANES>(), coefficients.as_chunks::<LANES>());
    for (x, h) in x.iter().zip(h) {
        for lane in 0..LANES {
            lanes[lane] += x[lane] * h[lane];
        }
    }
    let rest: f64 = x_rest.iter().zip(h_rest).map(|(x, h)| x * h).sum();
    // Halves added to halves: the additions do not wait for one another.
    let mut width = LANES;
    while width > 1 {
        width /= 2;
        for lane in 0..width {
            lanes[lane] += lanes[lane + width];
        }
    }
    lanes[0] + rest
}

/// Attenuation of what would fold, dB: below the rounding of f32 after the division by √n of a spectrum.
const FOLD_DB: f64 = 120.0;

/// Pass band of a decimator over its new Nyquist frequency.
const PASS: f64 = 0.8;

/// Every M-th sample behind a filter that keeps the rest from folding, streaming (D42).
///
/// Flat to 1e-6 up to 0.8 of the new Nyquist frequency, −120 dB from Nyquist on: what folds does so by
/// no more than that, anywhere. The lag is a whole number of outputs.
#[derive(Debug, Clone)]
pub struct Decimator {
    filter: FirFilter,
}

impl Decimator {
    /// Plans for one output every `factor` samples; a factor of 1 copies.
    ///
    /// # Panics
    ///
    /// If `factor` is 0.
    #[must_use]
    pub fn new(factor: usize) -> Self {
        assert!(factor > 0, "a step forward");
        if factor == 1 {
            return Self { filter: FirFilter::new(&[1.0]) };
        }
        let nyquist = 0.5 / factor as f64;
        let transition = (1.0 - PASS) * nyquist;
        // A lag of whole outputs: half the length a multiple of the factor.
        let half = half_length(FOLD_DB, transition).next_multiple_of(factor);
        let edge = nyquist - 0.5 * transition;
        let mut h = coefficients(0.0, edge, half, window::kaiser_beta(FOLD_DB + MARGIN_DB));
        let sum: f64 = h.iter().sum();
        h.iter_mut().for_each(|h| *h /= sum);
        Self { filter: FirFilter::with_step(&h, factor) }
    }

    /// Samples an output.
    #[must_use]
    pub fn factor(&self) -> usize {
        self.filter.step
    }

    /// Lag in outputs: output k belongs to input sample (k − lag)·factor.
    #[must_use]
    pub fn lag_outputs(&self) -> usize {
        (self.filter.n_coefficients() - 1) / 2 / self.filter.step
    }

    /// Outputs at the start that still hold the zeros before it: twice the lag.
    #[must_use]
    pub fn n_starting(&self) -> usize {
        2 * self.lag_outputs()
    }

    /// Outputs that the next `n` samples will give.
    #[must_use]
    pub fn out_len(&self, n: usize) -> usize {
        n.saturating_sub(self.filter.wait).div_ceil(self.filter.step)
    }

    /// Forgets everything: zeros before the next sample, which gives an output.
    pub fn reset(&mut self) {
        self.filter.reset();
    }

    /// Goes on as if the signal had been `value` for ever.
    pub fn settle(&mut self, value: f64) {
        self.filter.settle(value);
    }

    /// Takes `x` in and writes the outputs that fall due.
    ///
    /// `x`: any length; `out`: [`Decimator::out_len`] of it, same unit. Blocks of any lengths give what
    /// the whole would, bit by bit.
    ///
    /// # Panics
    ///
    /// If `out` does not have that length.
    pub fn process<T: Real>(&mut self, x: &[T], out: &mut [T]) {
        assert_eq!(out.len(), self.out_len(x.len()), "outputs of these samples");
        self.filter.advance(x, out);
    }
}

#[cfg(test)]
#[path = "fir_tests.rs"]
mod tests;
