//! Slow f64 references and test signals for the tests beside the kernels.
//!
//! Written from the definitions, without plans, windows tables or tricks. Must not be used outside
//! tests.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use crate::dsp::real::Real;

/// Samples A·cos(2πf·t − φ), t = 0 at sample 0.
pub(in crate::dsp) fn sine(
    n: usize,
    fs_hz: f64,
    f_hz: f64,
    amplitude: f64,
    lag_rad: f64,
) -> Vec<f64> {
    (0..n).map(|i| amplitude * (TAU * f_hz * i as f64 / fs_hz - lag_rad).cos()).collect()
}

/// White Gaussian noise of unit variance: SplitMix64 and Box–Muller.
pub(crate) fn gaussian_noise(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut uniform = move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n).map(|_| (-2.0 * (1.0 - uniform()).ln()).sqrt() * (TAU * uniform()).cos()).collect()
}

/// Adds signals sample by sample.
pub(in crate::dsp) fn sum(parts: &[Vec<f64>]) -> Vec<f64> {
    let n = parts.first().map_or(0, Vec::len);
    (0..n).map(|i| parts.iter().map(|part| part[i]).sum()).collect()
}

/// Rounds to the type under test.
pub(in crate::dsp) fn narrow<T: Real>(x: &[f64]) -> Vec<T> {
    x.iter().map(|value| T::rounded(*value)).collect()
}

/// Full DFT Σ x e^(−j2πkn/N) by its definition.
pub(in crate::dsp) fn dft(x: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let n = x.len();
    let twiddle =
        |k: usize, i: usize| Complex::from_polar(1.0, -TAU * ((k * i) % n) as f64 / n as f64);
    (0..n).map(|k| x.iter().enumerate().map(|(i, value)| value * twiddle(k, i)).sum()).collect()
}

/// Full DFT of real samples with their mean removed.
pub(in crate::dsp) fn dft_of_real(x: &[f64]) -> Vec<Complex<f64>> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    dft(&x.iter().map(|value| Complex::new(value - mean, 0.0)).collect::<Vec<_>>())
}

/// Largest absolute difference of two equally long slices.
pub(in crate::dsp) fn largest_difference<T: Real>(a: &[T], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a.to_f64() - b).abs()).fold(0.0, f64::max)
}
