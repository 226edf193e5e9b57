//! Squared envelope of a band and its spectrum.
//!
//! Impacts of a damaged bearing modulate a resonance; the spectrum of the band's squared envelope
//! shows the impact rate as a modulation depth, independent of the sensor's gain. Must not know which
//! band or line is of interest.

use std::ops::Range;

use rustfft::num_complex::Complex;

use crate::dsp::fft;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::spectrum::AmplitudePlan;

/// Squared envelope e² = |x_band + jH{x_band}|² at a reduced rate (D11).
///
/// Only the band's bins are inverted, at L ≥ 2 × their number: e² spans at most ± the band's width,
/// so it has no alias at that rate. H is taken by FFT: the record is treated as periodic, and the
/// first and last 2/bandwidth seconds hold what the jump between its ends makes.
#[derive(Debug)]
pub struct SquaredEnvelopePlan<T: Real> {
    inverse: BandInverse<T>,
}

impl<T: Real> SquaredEnvelopePlan<T> {
    /// Plans for the bins `band_bins` (see [`bins_of_band`]) of the spectrum of `n` samples.
    ///
    /// # Panics
    ///
    /// If the band is empty or reaches above ⌊n/2⌋ + 1.
    #[must_use]
    pub fn new(n: usize, band_bins: Range<usize>, cache: &mut FftCache<T>) -> Self {
        let length = fft::cheapest_inverse_len::<T>(2 * band_bins.len());
        Self { inverse: BandInverse::new(n, band_bins, length, cache, |_| 1.0) }
    }

    /// Samples of e² per call.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.inverse.out_len()
    }

    /// Rate of e² for input at `fs_hz`, Hz: fs·L/n.
    #[must_use]
    pub fn out_rate_hz(&self, fs_hz: f64) -> f64 {
        fs_hz * self.out_len() as f64 / self.inverse.n_samples() as f64
    }

    /// Writes e² into `out`.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), unit u. `out`: L samples, u²; a
    /// sine of amplitude A inside the band gives e² = A².
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [T]) {
        assert_eq!(out.len(), self.out_len(), "output of the plan");
        self.inverse.results(x_hat).map_to(out, |re, im| re * re + im * im);
    }
}

/// Bins of the spectrum of `n` samples at `fs_hz` that lie in `low_hz`…`high_hz` (both included);
/// `None` if there is none.
#[must_use]
pub fn bins_of_band(n: usize, fs_hz: f64, low_hz: f64, high_hz: f64) -> Option<Range<usize>> {
    let bin = |f_hz: f64| f_hz * n as f64 / fs_hz;
    // A border meant to lie on a bin must not miss it by the rounding of the division.
    const SLACK: f64 = 1e-9;
    let start = ceil_index(bin(low_hz) - SLACK);
    let end = ceil_index(bin(high_hz) + SLACK).min(fft::n_bins(n));
    (start < end).then_some(start..end)
}

/// Spectrum of a squared envelope as modulation depth (D12).
///
/// Amplitude (Hann, zero-padded × 2) of e² − mean, divided by mean(e²): 1 is full sinusoidal
/// modulation of e².
#[derive(Debug)]
pub struct EnvelopeSpectrumPlan<T: Real> {
    amplitude: AmplitudePlan<T>,
}

impl<T: Real> EnvelopeSpectrumPlan<T> {
    /// Plans for `n` samples of e².
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        Self { amplitude: AmplitudePlan::new_padded(n, 2 * n, cache) }
    }

    /// Plans for `n` samples of e² without padding: half as many bins, every rate/n, for half the time.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn unpadded(n: usize, cache: &mut FftCache<T>) -> Self {
        Self { amplitude: AmplitudePlan::new(n, cache) }
    }

    /// Depths written per call: n + 1; unpadded ⌊n/2⌋ + 1.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.amplitude.n_bins()
    }

    /// Distance of two bins, Hz, for e² at `rate_hz`: half the resolution step rate/n; all of it unpadded.
    #[must_use]
    pub fn bin_width_hz(&self, rate_hz: f64) -> f64 {
        self.amplitude.bin_width_hz(rate_hz)
    }

    /// Writes the modulation depth at k·rate/(2n) (unpadded k·rate/n) into `depth[k]`, returns mean(e²), u².
    ///
    /// `None` (and depths of 0) if the mean is 0: no signal, nothing modulated.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, e2: &[T], depth: &mut [T]) -> Option<f64> {
        let mean = self.amplitude.process(e2, depth);
        if mean > 0.0 {
            // Of the smallest numbers there are, the reciprocal is none.
            let factor = T::rounded(mean.recip());
            for value in depth {
                *value = if factor.to_f64().is_finite() {
                    *value * factor
                } else {
                    T::rounded(value.to_f64() / mean)
                };
            }
            Some(mean)
        } else {
            depth.fill(T::zero());
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rustfft::num_traits::Zero;

    use super::*;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::line::line_at;
    use crate::dsp::real::floor_index;
    use crate::dsp::reference::dft_of_real;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;

    const FS_HZ: f64 = 10_000.0;

    fn squared_envelope<T: Real>(x: &[f64], bins: Range<usize>) -> (Vec<T>, f64) {
        let mut cache = FftCache::new();
        let mut forward = ForwardPlan::new(x.len(), &mut cache);
        let mut x_hat = vec![Complex::zero(); forward.n_bins()];
        forward.process(&narrow::<T>(x), &mut x_hat);
        let mut plan = SquaredEnvelopePlan::new(x.len(), bins, &mut cache);
        let mut e2 = vec![T::zero(); plan.out_len()];
        plan.process(&x_hat, &mut e2);
        (e2, plan.out_rate_hz(FS_HZ))
    }

    /// A(1 + m·cos 2πf_m t)·cos 2πf_c t.
    fn am_tone(n: usize, amplitude: f64, m: f64, f_m_hz: f64, f_c_hz: f64) -> Vec<f64> {
        let t = |i: usize| i as f64 / FS_HZ;
        let modulation = |i: usize| 1.0 + m * (TAU * f_m_hz * t(i)).cos();
        (0..n).map(|i| amplitude * modulation(i) * (TAU * f_c_hz * t(i)).cos()).collect()
    }

    /// e² at the reduced times by the naive Hilbert transform: the full-length analytic band
    /// signal, interpolated by evaluating its Fourier sum at every output time.
    fn slow_envelope(x: &[f64], bins: Range<usize>, length: usize) -> Vec<f64> {
        let (n, spectrum) = (x.len(), dft_of_real(x));
        let side = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let at = |m: usize| -> Complex<f64> {
            let turn = |k: usize| Complex::from_polar(1.0, TAU * (k * m) as f64 / length as f64);
            bins.clone().map(|k| spectrum[k] * turn(k) * (side(k) / n as f64)).sum()
        };
        (0..length).map(|m| at(m).norm_sqr()).collect()
    }

    #[test]
    fn amplitude_modulated_tone_has_its_closed_form() {
        // e² = A²(1 + m cos)²: mean A²(1 + m²/2), depth 2m/(1 + m²/2) at f_m, (m²/2)/(…) at 2f_m.
        let (a, m, f_m_hz) = (3.0, 0.4, 50.0);
        let x = am_tone(10_000, a, m, f_m_hz, 3000.0);
        let bins = bins_of_band(10_000, FS_HZ, 2500.0, 3500.0).unwrap();
        let (e2, rate_hz) = squared_envelope::<f64>(&x, bins.clone());
        let mut plan = EnvelopeSpectrumPlan::new(e2.len(), &mut FftCache::new());
        let mut depth = vec![0.0; plan.n_bins()];
        let mean = plan.process(&e2, &mut depth).unwrap();
        let norm = 1.0 + m * m / 2.0;
        let place = |f_hz: f64| floor_index(f_hz / plan.bin_width_hz(rate_hz) + 0.5);
        // All periods are whole, so only rounding is left.
        assert!((mean - a * a * norm).abs() < 1e-11);
        assert!((depth[place(f_m_hz)] - 2.0 * m / norm).abs() < 1e-12);
        assert!((depth[place(2.0 * f_m_hz)] - m * m / 2.0 / norm).abs() < 1e-12);
        let mut plain = EnvelopeSpectrumPlan::unpadded(e2.len(), &mut FftCache::new());
        let mut every_second = vec![0.0; plain.n_bins()];
        plain.process(&e2, &mut every_second).unwrap();
        for (plain, padded) in every_second.iter().zip(depth.iter().step_by(2)) {
            assert!((plain - padded).abs() < 1e-12, "the same transform at half the grid");
        }
        let line = line_at(&e2, rate_hz, f_m_hz).unwrap();
        assert!((line.amplitude / mean - 2.0 * m / norm).abs() < 1e-12);
        // f32: FFT rounding 1e-7 of the largest line, squared and summed.
        let (narrow, _) = squared_envelope::<f32>(&x, bins);
        let worst = narrow.iter().zip(&e2).map(|(a, b)| (f64::from(*a) - b).abs());
        assert!(worst.fold(0.0, f64::max) < 2e-5);
    }

    #[test]
    fn matches_the_naive_transform_on_noise() {
        for (n, bins) in [(240, 30..80), (241, 0..121), (240, 0..121), (101, 50..51)] {
            let x = gaussian_noise(n, 4);
            let (e2, _) = squared_envelope::<f64>(&x, bins.clone());
            let slow = slow_envelope(&x, bins, e2.len());
            for (fast, slow) in e2.iter().zip(&slow) {
                assert!((fast - slow).abs() < 1e-11, "rounding of sums of {n} terms");
            }
        }
    }

    #[test]
    fn silence_has_no_depth() {
        let mut plan = EnvelopeSpectrumPlan::<f32>::new(16, &mut FftCache::new());
        let mut depth = vec![1.0; plan.n_bins()];
        assert_eq!(plan.process(&[0.0; 16], &mut depth), None);
        assert!(depth.iter().all(|d| *d <= 0.0));
    }

    #[test]
    fn bands_hold_their_borders() {
        assert_eq!(bins_of_band(1000, 1000.0, 10.0, 20.0), Some(10..21));
        assert_eq!(bins_of_band(1000, 1000.0, 10.2, 10.8), None);
        assert_eq!(bins_of_band(1000, 1000.0, 400.0, 900.0), Some(400..501));
        assert_eq!(bins_of_band(1000, 1000.0, 600.0, 900.0), None);
    }
}
