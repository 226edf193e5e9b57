//! Weights over time of bilinear distributions.
//!
//! Must not know what is weighted.

use std::fmt;
use std::sync::Arc;

use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;

/// Weights over time at lag 2m/fs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// None: (pseudo) Wigner–Ville.
    Delta,
    /// Hann's window of ± this many samples at every lag, its sum 1: smoothed pseudo Wigner–Ville (D107).
    Hann(usize),
    /// Choi and Williams' exp(−θ²τ²/σ): a Gaussian over time, wider for longer lags, its sum 1 (D108).
    ChoiWilliams(f64),
}

/// Sums of products over time with a kernel's weights.
pub(in crate::dsp) enum Smoother<T: Real> {
    Delta,
    /// Weights of −G…G.
    Hann(Vec<T>),
    Gaussian(Box<Gaussian<T>>),
}

/// Convolution with Gaussians of any width by transforms of twice the record.
pub(in crate::dsp) struct Gaussian<T: Real> {
    sigma: f64,
    forward: Arc<dyn Fft<T>>,
    inverse: Arc<dyn Fft<T>>,
    products: Vec<Complex<T>>,
    weights: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
    n: usize,
}

impl<T: Real> Smoother<T> {
    /// Plans for records of `n` samples; `None` for σ that is not positive and finite, or a window longer than
    /// the record.
    pub(in crate::dsp) fn new(kernel: Kernel, n: usize, cache: &mut FftCache<T>) -> Option<Self> {
        match kernel {
            Kernel::Delta => Some(Self::Delta),
            Kernel::Hann(half) if half < n => {
                let hann = |s: usize| {
                    let place = s as f64 / (2 * (half + 1)) as f64;
                    (std::f64::consts::PI * (place - 0.5)).cos().powi(2)
                };
                let weights: Vec<f64> = (1..=2 * half + 1).map(hann).collect();
                let sum: f64 = weights.iter().sum();
                Some(Self::Hann(weights.iter().map(|w| T::rounded(w / sum)).collect()))
            }
            Kernel::ChoiWilliams(sigma) if sigma > 0.0 && sigma.is_finite() => {
                Some(Self::Gaussian(Box::new(Gaussian::new(sigma, n, cache))))
            }
            Kernel::Hann(_) | Kernel::ChoiWilliams(_) => None,
        }
    }

    /// Writes Σ_u w_m(u − t)·product(u) for each instant t into `out`.
    pub(in crate::dsp) fn sums(
        &mut self,
        m: usize,
        product: impl Fn(usize) -> Complex<T>,
        instants: &[usize],
        out: &mut [Complex<T>],
    ) {
        match self {
            Self::Delta => {
                for (out, t) in out.iter_mut().zip(instants) {
                    *out = product(*t);
                }
            }
            Self::Hann(weights) => {
                let half = weights.len() / 2;
                for (out, t) in out.iter_mut().zip(instants) {
                    // Outside of the record the product is 0 by itself; before its start there is no index.
                    let skipped = half.saturating_sub(*t);
                    let places = (t + skipped - half..).zip(&weights[skipped..]);
                    *out = places.map(|(u, weight)| product(u) * *weight).sum();
                }
            }
            Self::Gaussian(gaussian) => gaussian.sums(m, product, instants, out),
        }
    }
}

impl<T: Real> Gaussian<T> {
    fn new(sigma: f64, n: usize, cache: &mut FftCache<T>) -> Self {
        let length = fft::fast_len_at_least(2 * n);
        let (forward, inverse) = (cache.complex_forward(length), cache.complex_inverse(length));
        let n_scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        Self {
            sigma,
            forward,
            inverse,
            products: vec![Complex::zero(); length],
            weights: vec![Complex::zero(); length],
            scratch: vec![Complex::zero(); n_scratch],
            n,
        }
    }

    fn sums(
        &mut self,
        m: usize,
        product: impl Fn(usize) -> Complex<T>,
        instants: &[usize],
        out: &mut [Complex<T>],
    ) {
        if m == 0 {
            // Nothing to weigh: δ.
            for (out, t) in out.iter_mut().zip(instants) {
                *out = product(*t);
            }
            return;
        }
        let Self { sigma, forward, inverse, products, weights, scratch, n } = self;
        let length = products.len();
        let (deviation, sum) = gaussian_of_lag(*sigma, m);
        // With the transforms' 1/length.
        let scale = 1.0 / (sum * length as f64);
        weights.fill(Complex::zero());
        for s in 0..*n {
            let place = s as f64 / deviation;
            let weight = T::rounded((-0.5 * place * place).exp() * scale);
            weights[s].re = weight;
            weights[(length - s) % length].re = weight;
        }
        for (u, value) in products.iter_mut().enumerate() {
            *value = if u < *n { product(u) } else { Complex::zero() };
        }
        forward.process_with_scratch(products, scratch);
        forward.process_with_scratch(weights, scratch);
        for (product, weight) in products.iter_mut().zip(weights.iter()) {
            // The transform of even weights is real.
            *product = product.scale(weight.re);
        }
        inverse.process_with_scratch(products, scratch);
        for (out, t) in out.iter_mut().zip(instants) {
            *out = products[*t];
        }
    }
}

/// Standard deviation m·√(8/σ) samples of the weights at lag 2m, and their sum over all samples.
pub(in crate::dsp) fn gaussian_of_lag(sigma: f64, m: usize) -> (f64, f64) {
    let deviation = m as f64 * (8.0 / sigma).sqrt();
    let sum = if deviation > 3.0 {
        // Poisson's sum: the next term is e^(−2π²·9) = 1e-77.
        std::f64::consts::TAU.sqrt() * deviation
    } else {
        let weight = |s: u32| (-0.5 * (f64::from(s) / deviation).powi(2)).exp();
        1.0 + 2.0 * (1..=27).map(weight).sum::<f64>()
    };
    (deviation, sum)
}

impl<T: Real> fmt::Debug for Smoother<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Delta => "Delta",
            Self::Hann(_) => "Hann",
            Self::Gaussian(_) => "Gaussian",
        })
    }
}
