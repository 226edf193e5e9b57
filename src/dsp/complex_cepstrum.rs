//! Complex cepstrum: the cepstrum that keeps the phase and gives the samples back.
//!
//! Products of spectra become sums: a record and its echoes, a source and its path. Causal parts stand at
//! positive quefrencies, what is before its time at negative ones. Must not know what is taken apart.

use std::f64::consts::PI;
use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use realfft::ComplexToReal;
use realfft::RealFftPlanner;
use realfft::RealToComplex;
use rustfft::num_complex::Complex;

use crate::dsp::real::Real;

/// What is added to the power before its logarithm, relative to the largest power: −240 dB, what f64 can tell.
const FLOOR: f64 = 1e-24;

/// What the complex cepstrum leaves out, and how sure the phase is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Removed {
    /// Delay that was taken out, samples.
    pub delay_samples: i64,
    /// Whether the sign was turned: the sum of the samples is negative.
    pub is_negative: bool,
    /// Largest step of the phase between two bins, rad, without the mean delay: near π it is a guess which
    /// way round, and more padding is needed.
    pub largest_step_rad: f64,
}

/// ĉ = F⁻¹{ln|X| + j·arg X} with the phase unwrapped and its linear part removed (D109).
pub struct ComplexCepstrumPlan<T: Real> {
    n: usize,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
    samples: Vec<f64>,
    spectrum: Vec<Complex<f64>>,
    forward_scratch: Vec<Complex<f64>>,
    inverse_scratch: Vec<Complex<f64>>,
    phase: Vec<f64>,
    of: std::marker::PhantomData<T>,
}

impl<T: Real> ComplexCepstrumPlan<T> {
    /// Plans records of `n` samples, followed by zeros up to `n_padded`; eight times `n` or more resolves the
    /// phase of most records and keeps the cepstrum, which has no end, from folding.
    ///
    /// `None` unless 1 ≤ `n` ≤ `n_padded`, and `n_padded` is even.
    #[must_use]
    pub fn new(n: usize, n_padded: usize) -> Option<Self> {
        if n == 0 || n_padded < n || !n_padded.is_multiple_of(2) {
            return None;
        }
        let mut planner = RealFftPlanner::new();
        let forward = planner.plan_fft_forward(n_padded);
        let inverse = planner.plan_fft_inverse(n_padded);
        let spectrum = forward.make_output_vec();
        Some(Self {
            n,
            samples: vec![0.0; n_padded],
            phase: vec![0.0; spectrum.len()],
            spectrum,
            forward_scratch: forward.make_scratch_vec(),
            inverse_scratch: inverse.make_scratch_vec(),
            forward,
            inverse,
            of: std::marker::PhantomData,
        })
    }

    /// Values of a cepstrum: quefrencies 0, 1, … samples, the negative ones from the end back.
    #[must_use]
    pub fn n_values(&self) -> usize {
        self.samples.len()
    }

    /// Writes the cepstrum of `x`; its mean stays. `None` (and zeros) for a record of zeros, or one whose sum is
    /// too near zero to have a sign.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], out: &mut [T]) -> Option<Removed> {
        assert_eq!(out.len(), self.n_values(), "values of the plan");
        let found = self.transform(x).and_then(|floor| {
            let removed = self.unwrap_phase(floor)?;
            for (value, phase) in self.spectrum.iter_mut().zip(&self.phase) {
                *value = Complex::new(0.5 * (value.norm_sqr() + floor).ln(), *phase);
            }
            Some(removed)
        });
        if found.is_none() {
            out.fill(T::zero());
            return None;
        }
        self.back(out);
        found
    }

    /// Writes the samples whose cepstrum this is (the record and the zeros behind it).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn invert(&mut self, cepstrum: &[T], removed: &Removed, out: &mut [T]) {
        assert_eq!((cepstrum.len(), out.len()), (self.n_values(), self.n_values()), "values");
        for (to, from) in self.samples.iter_mut().zip(cepstrum) {
            *to = from.to_f64();
        }
        self.run_forward();
        let half = (self.spectrum.len() - 1) as f64;
        let sign = if removed.is_negative { -1.0 } else { 1.0 };
        for (k, value) in self.spectrum.iter_mut().enumerate() {
            let lag = PI * removed.delay_samples as f64 * k as f64 / half;
            *value = Complex::from_polar(sign * value.re.exp(), value.im - lag);
        }
        self.back(out);
    }

    /// Writes the minimum-phase sequence with the magnitudes of `x` (D110): what stands at negative quefrencies of
    /// the real cepstrum is folded onto the positive ones. `None` (and zeros) for a record of zeros.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn minimum_phase(&mut self, x: &[T], out: &mut [T]) -> Option<()> {
        assert_eq!(out.len(), self.n_values(), "values of the plan");
        let Some(floor) = self.transform(x) else {
            out.fill(T::zero());
            return None;
        };
        for value in &mut self.spectrum {
            *value = Complex::new(0.5 * (value.norm_sqr() + floor).ln(), 0.0);
        }
        self.run_inverse();
        let n = self.samples.len();
        for q in 1..n {
            let factor = match (2 * q).cmp(&n) {
                std::cmp::Ordering::Less => 2.0,
                std::cmp::Ordering::Equal => 1.0,
                std::cmp::Ordering::Greater => 0.0,
            };
            self.samples[q] *= factor / n as f64;
        }
        self.samples[0] /= n as f64;
        self.run_forward();
        for value in &mut self.spectrum {
            *value = Complex::from_polar(value.re.exp(), value.im);
        }
        self.back(out);
        Some(())
    }

    /// The spectrum of x, padded, and what is added to its power; `None` for zeros.
    fn transform(&mut self, x: &[T]) -> Option<f64> {
        assert_eq!(x.len(), self.n, "samples of the plan");
        self.samples.fill(0.0);
        for (to, from) in self.samples.iter_mut().zip(x) {
            *to = from.to_f64();
        }
        self.run_forward();
        let largest = self.spectrum.iter().map(Complex::norm_sqr).fold(0.0, f64::max);
        (largest * FLOOR > f64::MIN_POSITIVE && largest.is_finite()).then_some(largest * FLOOR)
    }

    /// Fills `phase` with the unwrapped phase of the spectrum, its delay and sign taken out.
    fn unwrap_phase(&mut self, floor: f64) -> Option<Removed> {
        let (first, last) = (self.spectrum[0], self.spectrum[self.spectrum.len() - 1]);
        if first.norm_sqr() <= floor || last.norm_sqr() <= floor {
            return None;
        }
        let is_negative = first.re < 0.0;
        // Without the delay of the middle of the energy the phase turns least from bin to bin.
        let (mut moment, mut energy) = (0.0, 0.0);
        for pair in self.spectrum.windows(2) {
            let product = pair[1] * pair[0].conj();
            (moment, energy) = (moment - product.arg() * product.norm(), energy + product.norm());
        }
        let (step_rad, mut total, mut largest_step_rad) = (-moment / energy, 0.0, 0.0_f64);
        // The sum of the samples, but for the sign that is taken out, has phase 0.
        self.phase[0] = 0.0;
        for (pair, phase) in self.spectrum.windows(2).zip(&mut self.phase[1..]) {
            let step = (pair[1] * pair[0].conj() * Complex::from_polar(1.0, -step_rad)).arg();
            total += step + step_rad;
            largest_step_rad = largest_step_rad.max(step.abs());
            *phase = total;
        }
        let half = (self.phase.len() - 1) as f64;
        let turns = (total / PI).round();
        for (k, phase) in self.phase.iter_mut().enumerate() {
            *phase -= PI * turns * k as f64 / half;
        }
        #[expect(
            clippy::cast_possible_truncation,
            reason = "at most π a bin: within the number of bins"
        )]
        let delay_samples = -turns as i64;
        Some(Removed { delay_samples, is_negative, largest_step_rad })
    }

    fn run_forward(&mut self) {
        let Self { forward, samples, spectrum, forward_scratch, .. } = self;
        let done = forward.process_with_scratch(samples, spectrum, forward_scratch);
        debug_assert!(done.is_ok(), "lengths are the plan's own");
    }

    /// Into `samples`, not normalised.
    fn run_inverse(&mut self) {
        let Self { inverse, samples, spectrum, inverse_scratch, .. } = self;
        let last = spectrum.len() - 1;
        (spectrum[0].im, spectrum[last].im) = (0.0, 0.0);
        let done = inverse.process_with_scratch(spectrum, samples, inverse_scratch);
        debug_assert!(done.is_ok(), "lengths are the plan's own, both ends are real");
    }

    fn back(&mut self, out: &mut [T]) {
        self.run_inverse();
        let scale = 1.0 / self.samples.len() as f64;
        for (to, from) in out.iter_mut().zip(&self.samples) {
            *to = T::rounded(from * scale);
        }
    }
}

impl<T: Real> fmt::Debug for ComplexCepstrumPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ComplexCepstrumPlan")
            .field("n", &self.n)
            .field("n_padded", &self.samples.len())
            .field("bin_rad", &(TAU / self.samples.len() as f64))
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;

    const N_PADDED: usize = 4096;

    fn cepstrum(x: &[f64]) -> (Vec<f64>, Removed) {
        let mut plan = ComplexCepstrumPlan::new(x.len(), N_PADDED).unwrap();
        let mut out = vec![0.0; N_PADDED];
        let removed = plan.process(x, &mut out).unwrap();
        (out, removed)
    }

    #[test]
    fn an_echo_stands_at_its_multiples_and_on_the_causal_side() {
        // ln(1 + a·z^−d) = Σ (−1)^(m+1)·a^m/m·z^−md.
        for (a, d) in [(0.5, 17), (-0.8, 30)] {
            let mut x = vec![0.0; 64];
            (x[0], x[d]) = (1.0, a);
            let (c, removed) = cepstrum(&x);
            assert_eq!((removed.delay_samples, removed.is_negative), (0, false));
            for (q, value) in c.iter().enumerate() {
                let m = i32::try_from(q / d).unwrap();
                let is_multiple = q > 0 && q.is_multiple_of(d);
                let sign = if m % 2 == 0 { -1.0 } else { 1.0 };
                let right = if is_multiple { sign * f64::powi(a, m) / f64::from(m) } else { 0.0 };
                // Folding: a^m/m beyond 4096 is below 1e-13 even for 0.8 at every 30th.
                assert!((value - right).abs() < 1e-13, "{a} {q}: {value} {right}");
            }
        }
    }

    #[test]
    fn what_is_before_its_time_stands_at_negative_quefrencies() {
        // 0.6 + z^−1 = z^−1·(1 + 0.6·z): a delay of one sample, then the maximum-phase part.
        let (c, removed) = cepstrum(&[0.6, 1.0]);
        assert_eq!(removed.delay_samples, 1);
        for (m, power) in (1..20).zip(1..) {
            let sign = if m % 2 == 0 { -1.0 } else { 1.0 };
            let right = sign * 0.6_f64.powi(power) / f64::from(power);
            assert!((c[N_PADDED - m] - right).abs() < 1e-13 && c[m].abs() < 1e-13, "{m}");
        }
    }

    #[test]
    fn samples_come_back() {
        for seed in 0..20 {
            let x = gaussian_noise(200, seed);
            let mut plan = ComplexCepstrumPlan::new(200, 2048).unwrap();
            let (mut c, mut back) = (vec![0.0; 2048], vec![0.0; 2048]);
            let removed = plan.process(&x, &mut c).unwrap();
            plan.invert(&c, &removed, &mut back);
            assert!(largest_difference(&back[..200], &x) < 1e-10, "{seed}");
            assert!(back[200..].iter().all(|v| v.abs() < 1e-10));
            let mut plan = ComplexCepstrumPlan::new(200, 2048).unwrap();
            let (mut c, mut back) = (vec![0.0_f32; 2048], vec![0.0_f32; 2048]);
            let removed = plan.process(&narrow(&x), &mut c).unwrap();
            plan.invert(&c, &removed, &mut back);
            // The cepstrum itself is rounded to f32.
            assert!(largest_difference(&back[..200], &x) < 1e-4, "{seed}");
        }
    }

    #[test]
    fn a_delay_and_a_sign_are_told_and_change_nothing_else() {
        let pulse: Vec<f64> =
            (0..40).map(|i| 0.8_f64.powi(i) * (0.5 * f64::from(i)).cos()).collect();
        let mut late = vec![0.0; 300];
        for (to, from) in late[123..].iter_mut().zip(&pulse) {
            *to = -from;
        }
        let ((c, at_once), (c_late, removed)) = (cepstrum(&pulse), cepstrum(&late));
        assert_eq!(removed.delay_samples - at_once.delay_samples, 123);
        assert!(removed.is_negative && !at_once.is_negative);
        assert!(largest_difference(&c_late, &c) < 1e-10);
        assert!(removed.largest_step_rad < 0.1);
    }

    #[test]
    fn minimum_phase_turns_zeros_inside() {
        // (1 − 2z^−1)(1 + 0.5z^−1) → (2 − z^−1)·(1 + 0.5z^−1)·(−1)² : a zero at 2 becomes one at ½.
        let mut plan = ComplexCepstrumPlan::<f64>::new(3, N_PADDED).unwrap();
        let mut out = vec![0.0; N_PADDED];
        plan.minimum_phase(&[1.0, -1.5, -1.0], &mut out).unwrap();
        let right = [2.0, 0.0, -0.5];
        assert!(out.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", &out[..4]);
        assert!(out[3..].iter().all(|v| v.abs() < 1e-12));
    }

    #[test]
    fn what_has_no_logarithm_has_no_cepstrum() {
        let mut plan = ComplexCepstrumPlan::new(4, 16).unwrap();
        let mut out = [1.0; 16];
        assert_eq!(plan.process(&[0.0; 4], &mut out), None);
        assert!(out.iter().all(|v| *v == 0.0));
        assert_eq!(plan.process(&[1.0, -1.0, 0.0, 0.0], &mut out), None, "no sign");
        assert_eq!(plan.minimum_phase(&[0.0; 4], &mut out), None);
        assert!(ComplexCepstrumPlan::<f64>::new(0, 16).is_none());
        assert!(ComplexCepstrumPlan::<f64>::new(8, 4).is_none());
        assert!(ComplexCepstrumPlan::<f64>::new(8, 9).is_none());
    }
}
