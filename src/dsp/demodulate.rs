//! Narrow-band demodulation of a synchronous average around one mesh harmonic.
//!
//! A damaged tooth holds the mesh back for a moment: the amplitude dips and the phase lags there. f64
//! only: an average is short. Must not know which tooth is which.

use std::f64::consts::PI;
use std::f64::consts::TAU;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::stats::Moments;

/// A band below this share of the average's RMS is rounding: it has no phase.
const ROUNDING: f64 = 1e-12;

/// Demodulates averages of `n` points around mesh harmonic h: orders hz ± (⌊z/2⌋ − 1) (D65).
#[derive(Debug)]
pub struct MeshDemodPlan {
    carrier: usize,
    harmonic: usize,
    forward: ForwardPlan<f64>,
    band: BandInverse<f64>,
    y_hat: Vec<Complex<f64>>,
    analytic: Vec<Complex<f64>>,
    amplitude: Vec<f64>,
    phase_rad: Vec<f64>,
}

impl MeshDemodPlan {
    /// Plans for a gear of `teeth` ≥ 4 teeth; `None` if the band around h·z does not lie between order
    /// 1 and the last below Nyquist.
    #[must_use]
    pub fn new(n: usize, teeth: usize, harmonic: usize, cache: &mut FftCache<f64>) -> Option<Self> {
        let half = (teeth / 2).checked_sub(1).filter(|half| *half > 0)?;
        let carrier = harmonic.checked_mul(teeth)?;
        let low = carrier.checked_sub(half).filter(|low| *low > 0)?;
        let high = carrier + half;
        if 2 * high >= n {
            return None;
        }
        Some(Self {
            carrier,
            harmonic,
            forward: ForwardPlan::new(n, cache),
            band: BandInverse::new(n, low..high + 1, n, cache, |_| 1.0),
            y_hat: vec![Complex::zero(); fft::n_bins(n)],
            analytic: vec![Complex::zero(); n],
            amplitude: vec![0.0; n],
            phase_rad: vec![0.0; n],
        })
    }

    /// Points of an average.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.amplitude.len()
    }

    /// The mesh harmonic h demodulated.
    #[must_use]
    pub fn harmonic(&self) -> usize {
        self.harmonic
    }

    /// Demodulates `y`, n points of one revolution, its mean of no matter; returns whether there is
    /// anything in the band above rounding. Without it amplitude and phase are 0.
    ///
    /// The revolution is a circle: there are no edges.
    ///
    /// # Panics
    ///
    /// If `y` does not have the plan's length.
    pub fn process(&mut self, y: &[f64]) -> bool {
        self.forward.process(y, &mut self.y_hat);
        self.band.process(&self.y_hat, &mut self.analytic);
        let power: f64 = self.analytic.iter().map(Complex::norm_sqr).sum();
        let floor = ROUNDING * Moments::of(y).rms().unwrap_or(0.0);
        // Written so that a NaN has nothing in the band.
        let is_signal = 0.5 * power > floor * floor * y.len() as f64;
        if !is_signal {
            self.amplitude.fill(0.0);
            self.phase_rad.fill(0.0);
            return false;
        }
        self.demodulate();
        true
    }

    fn demodulate(&mut self) {
        let n = self.analytic.len();
        let (mut previous, mut sum) = (0.0, 0.0);
        for (i, z) in self.analytic.iter().enumerate() {
            self.amplitude[i] = z.norm();
            let turned = (self.carrier * i % n) as f64 / n as f64;
            let wrapped = (*z * Complex::from_polar(1.0, -TAU * turned)).arg();
            // Whole turns that bring it within half a turn of the point before.
            let phase_rad = wrapped - TAU * ((wrapped - previous + PI) / TAU).floor();
            let phase_rad = if i == 0 { wrapped } else { phase_rad };
            self.phase_rad[i] = phase_rad;
            previous = phase_rad;
            sum += phase_rad;
        }
        let mean = sum / n as f64;
        self.phase_rad.iter_mut().for_each(|phase| *phase -= mean);
    }

    /// Amplitude |z_b| of the last call, unit of y.
    #[must_use]
    pub fn amplitude(&self) -> &[f64] {
        &self.amplitude
    }

    /// Phase arg z_b − hzθ of the last call, unwrapped, its mean removed, rad; positive: the mesh is
    /// ahead. Where the amplitude passes zero the phase is that of noise and a turn may be lost.
    #[must_use]
    pub fn phase_rad(&self) -> &[f64] {
        &self.phase_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::sine;

    const N: usize = 1024;
    const Z: usize = 28;

    fn plan(harmonic: usize) -> MeshDemodPlan {
        MeshDemodPlan::new(N, Z, harmonic, &mut FftCache::new()).unwrap()
    }

    fn modulated(n: usize, carrier: f64, depth: f64, swing_rad: f64) -> Vec<f64> {
        let at = |i: usize| {
            let theta = TAU * i as f64 / n as f64;
            let amplitude = 2.0 * (1.0 + depth * (theta - 0.4).cos());
            amplitude * (carrier * theta + swing_rad * (2.0 * theta).sin() + 1.1).cos()
        };
        (0..n).map(at).collect()
    }

    #[test]
    fn amplitude_and_phase_modulation_are_read_as_they_were_made() {
        for (n, harmonic) in [(N, 1), (N, 2), (997, 3)] {
            let mut plan = MeshDemodPlan::new(n, Z, harmonic, &mut FftCache::new()).unwrap();
            let mut y = modulated(n, (harmonic * Z) as f64, 0.3, 0.5);
            // A mesh harmonic outside of the band, shaft orders and an offset take no part.
            let others = sine(n, n as f64, 1.0, 9.0, 0.0);
            let far = sine(n, n as f64, ((harmonic + 1) * Z) as f64, 4.0, 0.0);
            for i in 0..n {
                y[i] += others[i] + far[i] + 1e3;
            }
            assert!(plan.process(&y));
            for i in 0..n {
                let theta = TAU * i as f64 / n as f64;
                let amplitude = 2.0 * (1.0 + 0.3 * (theta - 0.4).cos());
                // Side bands beyond ± 13: J₆(0.5) = 4e-9 of the carrier, with those of the amplitude.
                assert!((plan.amplitude()[i] - amplitude).abs() < 1e-7);
                // The constant 1.1 rad is the mean that was removed.
                assert!((plan.phase_rad()[i] - 0.5 * (2.0 * theta).sin()).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn a_phase_of_several_turns_is_unwrapped() {
        let mut plan = plan(2);
        // 6 rad of swing at one a revolution: side bands up to ± 13 hold all but J₁₄(6) = 1e-3.
        let y: Vec<f64> = (0..N)
            .map(|i| TAU * i as f64 / N as f64)
            .map(|theta| (56.0 * theta + 6.0 * theta.sin()).cos())
            .collect();
        assert!(plan.process(&y));
        for (i, phase) in plan.phase_rad().iter().enumerate() {
            assert!((phase - 6.0 * (TAU * i as f64 / N as f64).sin()).abs() < 5e-3);
        }
    }

    #[test]
    fn the_band_reaches_to_half_the_teeth_less_one() {
        // z = 28: orders 15…41 are in, 14 and 42 are out; odd z = 29: 16…42.
        for (teeth, inside, outside) in [(28, [15, 41], [14, 42]), (29, [16, 42], [15, 43])] {
            let mut plan = MeshDemodPlan::new(N, teeth, 1, &mut FftCache::new()).unwrap();
            for order in inside {
                assert!(plan.process(&sine(N, N as f64, f64::from(order), 1.0, 0.0)), "{order}");
                assert!(plan.amplitude().iter().all(|a| (a - 1.0).abs() < 1e-12));
            }
            for order in outside {
                assert!(!plan.process(&sine(N, N as f64, f64::from(order), 1.0, 0.0)), "{order}");
            }
        }
    }

    #[test]
    fn nothing_in_the_band_has_no_phase() {
        let mut plan = plan(1);
        assert!(plan.process(&gaussian_noise(N, 4)));
        for y in [vec![0.0; N], vec![7.7; N], sine(N, N as f64, 3.0, 1.0, 0.0)] {
            assert!(!plan.process(&y));
            assert!(plan.amplitude().iter().chain(plan.phase_rad()).all(|v| v.abs() <= 0.0));
        }
        assert!(!plan.process(&[f64::NAN; N]));
    }

    #[test]
    fn bands_outside_of_the_orders_are_not_planned() {
        let mut cache = FftCache::new();
        for (n, teeth, harmonic) in
            [(N, 3, 1), (N, 28, 0), (N, 0, 1), (82, 28, 1), (N, 28, 18), (0, 28, 1)]
        {
            assert!(MeshDemodPlan::new(n, teeth, harmonic, &mut cache).is_none());
        }
        assert!(MeshDemodPlan::new(83, 28, 1, &mut cache).is_some(), "41 < 83/2");
    }
}
