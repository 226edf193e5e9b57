//! Slow references in f64: the sums of the definitions, without a fast transform.

use crate::dsp::cwt;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::ops::Range;

/// Cosine and sine of k/n turns, k = 0 … n − 1.
fn turns(n: usize) -> Vec<Complex64> {
    (0..n).map(|k| Complex64::from_polar(1.0, TAU * k as f64 / n as f64)).collect()
}

pub(super) fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Σ (x − mean)·w·e^(−j2πki/n) of the bins asked for, zeros behind x up to `n`.
pub(super) fn spectrum(
    x: &[f64],
    weight: impl Fn(usize) -> f64,
    n: usize,
    bins: impl Iterator<Item = usize>,
) -> Vec<Complex64> {
    let (mean, turns) = (mean(x), turns(n));
    let y: Vec<f64> = x.iter().enumerate().map(|(i, v)| (v - mean) * weight(i)).collect();
    let bin = |k: usize| -> Complex64 {
        let mut place = 0;
        let mut sum = Complex64::default();
        for y in &y {
            sum += turns[place].conj() * *y;
            place = (place + k) % n;
        }
        sum
    };
    bins.map(bin).collect()
}

/// Hann weight i of n.
pub(super) fn hann(i: usize, n: usize) -> f64 {
    0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()
}

/// Hann amplitudes of bins (D7).
pub(super) fn amplitudes(x: &[f64], n: usize, bins: &[usize]) -> Vec<f64> {
    let gain: f64 = (0..x.len()).map(|i| hann(i, x.len())).sum();
    let spectrum = spectrum(x, |i| hann(i, x.len()), n, bins.iter().copied());
    let side = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
    spectrum.iter().zip(bins).map(|(x, k)| side(*k) * x.norm() / gain).collect()
}

/// Densities of bins (D8), segments of n, half overlapped.
pub(super) fn densities(x: &[f64], n: usize, fs_hz: f64, bins: &[usize]) -> Vec<f64> {
    let squares: f64 = (0..n).map(|i| hann(i, n).powi(2)).sum();
    let mut sums = vec![0.0; bins.len()];
    let mut n_segments = 0.0;
    for segment in x.windows(n).step_by(n / 2) {
        let found = spectrum(segment, |i| hann(i, n), n, bins.iter().copied());
        for ((sum, x), k) in sums.iter_mut().zip(found).zip(bins) {
            let side = if *k == 0 || 2 * k == n { 1.0 } else { 2.0 };
            *sum += side * x.norm_sqr() / (fs_hz * squares);
        }
        n_segments += 1.0;
    }
    sums.iter().map(|sum| sum / n_segments).collect()
}

/// Amplitude of a line by weighted least squares of cosine, sine and constant (D10).
pub(super) fn line(x: &[f64], cycles: f64) -> f64 {
    // Normal equations of three unknowns with their right side.
    let mut a = [[0.0; 4]; 3];
    for (i, value) in x.iter().enumerate() {
        let (sin, cos) = (TAU * (cycles * i as f64).fract()).sin_cos();
        let row = [cos, sin, 1.0, *value];
        let weight = hann(i, x.len());
        for (equation, factor) in a.iter_mut().zip(row) {
            for (sum, value) in equation.iter_mut().zip(row) {
                *sum += weight * factor * value;
            }
        }
    }
    for pivot in 0..3 {
        let upper = a[pivot];
        for (_, equation) in a.iter_mut().enumerate().filter(|(row, _)| *row != pivot) {
            let factor = equation[pivot] / upper[pivot];
            for (value, upper) in equation.iter_mut().zip(upper) {
                *value -= factor * upper;
            }
        }
    }
    (a[0][3] / a[0][0]).hypot(a[1][3] / a[1][1])
}

/// Squared envelope of a band at `length` times (D11).
pub(super) fn squared_envelope(x: &[f64], bins: Range<usize>, length: usize) -> Vec<f64> {
    let n = x.len();
    let spectrum = spectrum(x, |_| 1.0, n, bins.clone());
    let turns = turns(length);
    let side = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
    let at = |m: usize| -> Complex64 {
        let bins = bins.clone().zip(&spectrum);
        bins.map(|(k, x)| x * turns[k * m % length] * (side(k) / n as f64)).sum()
    };
    (0..length).map(|m| at(m).norm_sqr()).collect()
}

/// Kurtosis, M6, M8 and RMS (D3) in two passes.
pub(super) fn moments(x: &[f64]) -> [f64; 4] {
    let (n, mean) = (x.len() as f64, mean(x));
    let central = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>() / n;
    let rms = central(2).sqrt();
    [rms, central(4) / rms.powi(4), central(6) / rms.powi(6), central(8) / rms.powi(8)]
}

/// Morlet transform (D13) by its sum over all bins of a spectrum of n samples.
pub(super) struct Morlet<'a> {
    /// All bins.
    pub(super) spectrum: &'a [Complex64],
    /// Samples, padding included.
    pub(super) n: usize,
    /// Samples a second.
    pub(super) fs_hz: f64,
}

impl Morlet<'_> {
    /// W at `f_hz` and `at` samples after the first, where that need not be whole.
    pub(super) fn at(&self, f_hz: f64, at: f64) -> Complex64 {
        let (n, omega0) = (self.n as f64, cwt::DEFAULT_OMEGA0);
        let bins = self.spectrum.iter().enumerate().skip(1);
        let term = |(k, x): (usize, &Complex64)| {
            let sigmas = omega0 * (k as f64 * self.fs_hz / n / f_hz - 1.0);
            let side = if 2 * k == self.n { 1.0 } else { 2.0 };
            let gain = side / n * (-0.5 * sigmas * sigmas).exp();
            if gain < 1e-20 / n {
                return Complex64::default();
            }
            x * Complex64::from_polar(gain, TAU * (k as f64 * at / n).fract())
        };
        bins.map(term).sum()
    }

    /// RMS over the transform's length, of n_record samples.
    pub(super) fn rms(&self, f_hz: f64, n_record: usize) -> f64 {
        let (n, omega0) = (self.n as f64, cwt::DEFAULT_OMEGA0);
        let power = |(k, x): (usize, &Complex64)| {
            let sigmas = omega0 * (k as f64 * self.fs_hz / n / f_hz - 1.0);
            let side = if 2 * k == self.n { 1.0 } else { 2.0 };
            x.norm_sqr() * (side / n * (-0.5 * sigmas * sigmas).exp()).powi(2)
        };
        let sum: f64 = self.spectrum.iter().enumerate().skip(1).map(power).sum();
        (sum * n / n_record as f64).sqrt()
    }
}
