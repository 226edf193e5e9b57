//! Bilinear time-frequency distributions: Wigner–Ville, pseudo, smoothed pseudo, Choi–Williams.
//!
//! All are sums over lags of z[u + m]·z*[u − m], z the analytic signal, weighted over lag m and time u
//! (D105). A lag step is two samples, so that bins k = 0…N_f − 1 lie at k·fs/(2·N_f); because z has no
//! negative frequencies nothing folds. `kernel` has the weights. Must not know shafts or meshes.

pub mod kernel;

use std::fmt;
use std::sync::Arc;

use realfft::ComplexToReal;
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::bilinear::kernel::Kernel;
use crate::dsp::bilinear::kernel::Smoother;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;

/// Most values that a plan holds between its two passes, and most that it writes.
pub const MAX_CELLS: usize = 1 << 22;

/// Most samples of a record.
pub const MAX_SAMPLES: usize = 1 << 16;

/// Which distribution, and where it is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSpec {
    /// Weights over time.
    pub kernel: Kernel,
    /// Largest lag step M, at most (n − 1)/2: lags ±2M/fs.
    pub n_lags: usize,
    /// Whether lags are weighted by Hann's window, cos²(πm/(2M + 2)): pseudo distributions. Otherwise all
    /// up to M count alike.
    pub is_lag_windowed: bool,
    /// Frequencies N_f ≥ 2M + 1 of 0 to fs/2.
    pub n_frequencies: usize,
    /// Instants: the middles of so many equal parts of the record.
    pub n_times: usize,
}

impl JointSpec {
    /// The Wigner–Ville distribution of `n` samples (D106): every lag there is.
    #[must_use]
    pub fn wigner_ville(n: usize, n_times: usize) -> Self {
        let n_lags = n.saturating_sub(1) / 2;
        Self {
            kernel: Kernel::Delta,
            n_lags,
            is_lag_windowed: false,
            n_frequencies: 2 * n_lags + 2,
            n_times,
        }
    }
}

/// A distribution of records of n samples (D105, D106, D107, D108).
pub struct JointPlan<T: Real> {
    n: usize,
    fs_hz: f64,
    spec: JointSpec,
    analytic: BandInverse<T>,
    z: Vec<Complex<T>>,
    lag_weights: Vec<f64>,
    instants: Vec<usize>,
    smoother: Smoother<T>,
    /// Sums of an instant over time, lag by lag.
    sums: Vec<Complex<T>>,
    of_lag: Vec<Complex<T>>,
    to_frequency: Arc<dyn ComplexToReal<T>>,
    lags: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> JointPlan<T> {
    /// Plans records of `n` samples at `fs_hz`.
    ///
    /// `None` unless 4 ≤ `n` ≤ [`MAX_SAMPLES`], lags, frequencies and instants are as [`JointSpec`] says (1 ≤ M,
    /// 1 ≤ instants ≤ n), the kernel's parameter is positive, and instants times lags and times frequencies
    /// do not exceed [`MAX_CELLS`].
    #[must_use]
    pub fn new(n: usize, fs_hz: f64, spec: JointSpec, cache: &mut FftCache<T>) -> Option<Self> {
        let JointSpec { n_lags, n_frequencies, n_times, .. } = spec;
        let fits = |columns: usize| n_times.checked_mul(columns).is_some_and(|c| c <= MAX_CELLS);
        let lags_fit = n_lags >= 1 && n_lags <= n.saturating_sub(1) / 2 && fits(n_lags + 1);
        let frequencies_fit = n_frequencies > 2 * n_lags && fits(n_frequencies);
        let is_sound = (4..=MAX_SAMPLES).contains(&n) && (1..=n).contains(&n_times);
        if !(is_sound && lags_fit && frequencies_fit && fs_hz > 0.0) {
            return None;
        }
        let smoother = Smoother::new(spec.kernel, n, cache)?;
        let weight = |m: usize| {
            if spec.is_lag_windowed {
                let angle = std::f64::consts::FRAC_PI_2 * m as f64 / (n_lags + 1) as f64;
                angle.cos().powi(2)
            } else {
                1.0
            }
        };
        let to_frequency = RealFftPlanner::new().plan_fft_inverse(n_frequencies);
        Some(Self {
            n,
            fs_hz,
            spec,
            // Without the bins that are their own mirror: z has positive frequencies alone.
            analytic: BandInverse::new(n, 1..n.div_ceil(2), n, cache, |_| 1.0),
            z: vec![Complex::zero(); n],
            lag_weights: (0..=n_lags).map(weight).collect(),
            instants: (0..n_times).map(|j| (2 * j + 1) * n / (2 * n_times)).collect(),
            smoother,
            sums: vec![Complex::zero(); n_times * (n_lags + 1)],
            of_lag: vec![Complex::zero(); n_times],
            lags: to_frequency.make_input_vec(),
            scratch: to_frequency.make_scratch_vec(),
            to_frequency,
        })
    }

    /// Values per call: instants × frequencies.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.spec.n_times * self.spec.n_frequencies
    }

    /// Sample of each instant.
    #[must_use]
    pub fn instants(&self) -> &[usize] {
        &self.instants
    }

    /// Frequency of bin k: k times this, Hz.
    #[must_use]
    pub fn bin_width_hz(&self) -> f64 {
        0.5 * self.fs_hz / self.spec.n_frequencies as f64
    }

    /// Writes the distribution, instant by instant.
    ///
    /// `x_hat`: the spectrum of n samples ([`crate::dsp::fft::ForwardPlan`]), unit u; the record is treated as
    /// periodic for z, and what lies outside of it counts as 0 in products. `out`: u²/Hz of z (a line of amplitude A
    /// has A², not A²/2), of either sign.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [T]) {
        assert_eq!(out.len(), self.out_len(), "instants times frequencies");
        self.analytic.process(x_hat, &mut self.z);
        self.distribute(out);
    }

    /// The distribution of the analytic signal in `z`.
    fn distribute(&mut self, out: &mut [T]) {
        let Self { n, z, instants, smoother, sums, of_lag, .. } = self;
        let n_rows = self.spec.n_lags + 1;
        for m in 0..n_rows {
            // z[u + m]·z*[u − m], u = m…n − 1 − m.
            let products = |u: usize| {
                let inside = u >= m && u + m < *n;
                if inside { z[u + m] * z[u - m].conj() } else { Complex::zero() }
            };
            smoother.sums(m, products, instants, of_lag);
            let weight = T::rounded(self.lag_weights[m]);
            for (row, sum) in sums.chunks_exact_mut(n_rows).zip(of_lag.iter()) {
                row[m] = *sum * weight;
            }
        }
        let scale = T::rounded(2.0 / self.fs_hz);
        let rows =
            self.sums.chunks_exact(n_rows).zip(out.chunks_exact_mut(self.spec.n_frequencies));
        for (row, out) in rows {
            // Lag −m is the conjugate of lag m, so the sum over lags is real; sign − by the conjugate.
            self.lags.fill(Complex::zero());
            for (to, from) in self.lags.iter_mut().zip(row) {
                *to = from.conj() * scale;
            }
            self.lags[0].im = T::zero();
            let done =
                self.to_frequency.process_with_scratch(&mut self.lags, out, &mut self.scratch);
            debug_assert!(done.is_ok(), "lengths are the plan's own, lag 0 is real");
        }
    }
}

impl<T: Real> fmt::Debug for JointPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("JointPlan")
            .field("n", &self.n)
            .field("fs_hz", &self.fs_hz)
            .field("spec", &self.spec)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests;
