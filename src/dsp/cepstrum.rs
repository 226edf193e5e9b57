//! Cepstrum: families of equidistant lines as one peak, and what is edited there.
//!
//! Side bands at a spacing Δf and harmonics of Δf gather at the quefrency 1/Δf. Removing a quefrency
//! removes the whole family. Must not know whose family it is.

use std::fmt;
use std::sync::Arc;

use realfft::RealToComplex;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;

/// What is added to the power before its logarithm, relative to the largest power: −120 dB.
const FLOOR: f64 = 1e-12;

/// Which cepstrum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// F⁻¹{ln(S + ε)}.
    Power,
    /// Half of it: F⁻¹{ln √(S + ε)}.
    Real,
    /// Its square, as Bogert, Healy & Tukey 1963 have it.
    Squared,
}

/// Power cepstrum c_p(q) = F⁻¹{ln(|X_k|² + ε)}, ε = 1e-12 of the largest |X_k|² (D34).
#[derive(Debug)]
pub struct CepstrumPlan<T: Real> {
    even: EvenTransform<T>,
}

impl<T: Real> CepstrumPlan<T> {
    /// Plans for the spectra of `n` samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        Self { even: EvenTransform::new(n, cache) }
    }

    /// Values written per call: ⌊n/2⌋ + 1, at the quefrencies q/fs; the rest is their mirror.
    #[must_use]
    pub fn n_values(&self) -> usize {
        self.even.n_bins()
    }

    /// Writes the cepstrum and returns ε, u²; `None` (and zeros) for a spectrum of zeros.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), unit u. `out`: dimensionless; the
    /// value at 0 is the mean log power. Scaling x adds to that one alone, but for rounding. Bin 0,
    /// whose mean was removed, counts as ε.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], kind: Kind, out: &mut [T]) -> Option<f64> {
        assert_eq!(x_hat.len(), self.n_values(), "bins of the plan");
        assert_eq!(out.len(), self.n_values(), "values of the plan");
        let Some(floor) = floor_of(x_hat) else {
            out.fill(T::zero());
            return None;
        };
        self.even.set(|k| if k == 0 { floor.ln() } else { log_power(x_hat[k], floor) });
        self.even.transform();
        let scale = match kind {
            Kind::Power | Kind::Squared => 1.0 / self.even.n_samples() as f64,
            Kind::Real => 0.5 / self.even.n_samples() as f64,
        };
        for (out, value) in out.iter_mut().zip(&self.even.output) {
            let value = value.re.to_f64() * scale;
            *out = T::rounded(if kind == Kind::Squared { value * value } else { value });
        }
        Some(floor)
    }
}

/// Quefrencies that are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lifter {
    /// Those up to `quefrency_s`: the smooth course of the spectrum, its resonances.
    ShortPass {
        /// Last quefrency kept, s.
        quefrency_s: f64,
    },
    /// Those above `quefrency_s`, and 0 (the level): the lines without the resonances.
    LongPass {
        /// Last quefrency removed, s.
        quefrency_s: f64,
    },
    /// All but the multiples of `period_s`, each ± `half_width_s`: the spectrum without the harmonics
    /// and side bands at that spacing.
    WithoutComb {
        /// Period of the family, s: one over its spacing.
        period_s: f64,
        /// Half width of each tooth, s; at least the sample next to it goes.
        half_width_s: f64,
    },
}

/// Edits a spectrum by its real cepstrum and keeps the phases (D35).
#[derive(Debug)]
pub struct LifterPlan<T: Real> {
    even: EvenTransform<T>,
    is_kept: Vec<bool>,
}

impl<T: Real> LifterPlan<T> {
    /// Plans for the spectra of `n` samples at `fs_hz`; `None` for a quefrency that is negative or
    /// not a number, or a comb whose period is below two samples.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, fs_hz: f64, lifter: Lifter, cache: &mut FftCache<T>) -> Option<Self> {
        let is_kept = kept(fft::n_bins(n), fs_hz, lifter)?;
        Some(Self { even: EvenTransform::new(n, cache), is_kept })
    }

    /// Writes the edited spectrum: |Y_k| from the cepstral values kept, the phase of X_k.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), unit u. `out`: as many bins, u; back
    /// to samples by [`crate::dsp::synthesis::SynthesisPlan`]. With everything kept it is x̂ but for ε: bins
    /// far below −120 dB of the largest rise to that. Bins of 0 stay 0; bin 0 is copied, and counts with
    /// the level of bin 1, because the mean that was removed says nothing about the course there.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
        let n = self.even.n_samples() as f64;
        assert_eq!(x_hat.len(), self.even.n_bins(), "bins of the plan");
        assert_eq!(out.len(), x_hat.len(), "one bin per bin");
        let Some(floor) = floor_of(x_hat) else {
            out.fill(Complex::zero());
            return;
        };
        // What is removed is transformed, not what is kept: the rest of the logarithm stays as it is.
        let first = usize::from(x_hat.len() > 1);
        self.even.set(|k| log_power(x_hat[k.max(first)], floor));
        self.even.transform();
        for (k, is_kept) in self.is_kept.iter().enumerate() {
            let removed = if *is_kept { 0.0 } else { self.even.output[k].re.to_f64() / n };
            self.even.set_one(k, removed);
        }
        self.even.transform();
        for ((out, x), removed) in out.iter_mut().zip(x_hat).zip(&self.even.output) {
            let log_amplitude = 0.5 * (log_power(*x, floor) - removed.re.to_f64());
            *out = unit(*x).scale(T::rounded(log_amplitude.exp()));
        }
        out[0] = x_hat[0];
    }
}

/// Cepstral pre-whitening X_k/|X_k| (D36): the real cepstrum set to zero, the phases kept.
///
/// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]). `out`: as many bins, dimensionless, of
/// magnitude 1, or 0 where x̂ is 0; [`crate::dsp::synthesis::SynthesisPlan`] gives the samples, of RMS
/// 1/√n. Lines of all heights become equal to the noise between them, rounding noise included: a
/// signal without any noise becomes that. [`crate::dsp::whiten`] divides by a local level instead.
///
/// # Panics
///
/// If the slices differ in length.
pub fn prewhiten<T: Real>(x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
    assert_eq!(out.len(), x_hat.len(), "one bin per bin");
    for (out, x) in out.iter_mut().zip(x_hat) {
        *out = unit(*x);
    }
}

/// x/|x|; 0 for 0.
fn unit<T: Real>(x: Complex<T>) -> Complex<T> {
    let (re, im) = (x.re.to_f64(), x.im.to_f64());
    let norm = re.hypot(im);
    if norm > 0.0 {
        Complex::new(T::rounded(re / norm), T::rounded(im / norm))
    } else {
        Complex::zero()
    }
}

/// ε of a spectrum; `None` if it is 0.
fn floor_of<T: Real>(x_hat: &[Complex<T>]) -> Option<f64> {
    let largest = x_hat.iter().map(|x| power(*x)).fold(0.0, f64::max);
    // The smallest power whose ε is not 0 itself.
    (largest > f64::MIN_POSITIVE / FLOOR).then_some(largest * FLOOR)
}

fn log_power<T: Real>(x: Complex<T>, floor: f64) -> f64 {
    (power(x) + floor).ln()
}

fn power<T: Real>(x: Complex<T>) -> f64 {
    let (re, im) = (x.re.to_f64(), x.im.to_f64());
    re * re + im * im
}

fn kept(n_values: usize, fs_hz: f64, lifter: Lifter) -> Option<Vec<bool>> {
    let mut is_kept = vec![true; n_values];
    let samples = |quefrency_s: f64| {
        let samples = quefrency_s * fs_hz;
        (samples >= 0.0 && samples.is_finite()).then_some(samples)
    };
    match lifter {
        Lifter::ShortPass { quefrency_s } => {
            let first = floor_index(samples(quefrency_s)? + 1e-9).saturating_add(1);
            is_kept.iter_mut().skip(first).for_each(|kept| *kept = false);
        }
        Lifter::LongPass { quefrency_s } => {
            let n = floor_index(samples(quefrency_s)? + 1e-9);
            is_kept.iter_mut().skip(1).take(n).for_each(|kept| *kept = false);
        }
        Lifter::WithoutComb { period_s, half_width_s } => {
            let (period, half_width) = (samples(period_s)?, samples(half_width_s)?.max(0.5));
            if period < 2.0 {
                return None;
            }
            let mut tooth = 1.0;
            while tooth * period - half_width < n_values as f64 {
                let first = ceil_index(tooth * period - half_width - 1e-9).max(1);
                let last = floor_index(tooth * period + half_width + 1e-9);
                is_kept
                    .iter_mut()
                    .skip(first)
                    .take((last + 1).saturating_sub(first))
                    .for_each(|kept| *kept = false);
                tooth += 1.0;
            }
        }
    }
    Some(is_kept)
}

/// Transform of a real, even sequence of n values, given by its first half: real, even, and its own
/// inverse but for 1/n.
struct EvenTransform<T: Real> {
    plan: Arc<dyn RealToComplex<T>>,
    input: Vec<T>,
    output: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> EvenTransform<T> {
    fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        let plan = cache.real_forward(n);
        let scratch = plan.make_scratch_vec();
        let output = vec![Complex::zero(); fft::n_bins(n)];
        Self { plan, input: vec![T::zero(); n], output, scratch }
    }

    fn n_samples(&self) -> usize {
        self.input.len()
    }

    fn n_bins(&self) -> usize {
        self.output.len()
    }

    fn set(&mut self, value: impl Fn(usize) -> f64) {
        for k in 0..self.n_bins() {
            self.set_one(k, value(k));
        }
    }

    fn set_one(&mut self, k: usize, value: f64) {
        let n = self.n_samples();
        self.input[k] = T::rounded(value);
        self.input[(n - k) % n] = T::rounded(value);
    }

    fn transform(&mut self) {
        let done =
            self.plan.process_with_scratch(&mut self.input, &mut self.output, &mut self.scratch);
        debug_assert!(done.is_ok(), "lengths are the plan's own");
    }
}

impl<T: Real> fmt::Debug for EvenTransform<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EvenTransform").field("n", &self.n_samples()).finish_non_exhaustive()
    }
}

#[cfg(test)]
#[path = "cepstrum_tests.rs"]
mod tests;
