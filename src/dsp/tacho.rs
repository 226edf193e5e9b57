//! Edges of a tacho waveform.
//!
//! Turns an analogue or 0/1 tacho signal into the interpolated times of its edges. What an edge means
//! for the shaft angle is [`crate::dsp::order`]'s part. Must not know shafts.

use crate::dsp::real::Real;
use crate::dsp::stats;

/// Which edge marks the angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

/// Part of the span low…high a signal must cross around the threshold to count as an edge.
const HYSTERESIS: f64 = 0.2;

/// Below this share of the wide span the 5–95 % span is noise beside narrow pulses.
const NARROW_PULSE_SHARE: f64 = 0.25;

/// The level an edge was read at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threshold {
    /// Level, unit of the waveform.
    pub level: f64,
    /// Full width of the hysteresis around it, same unit.
    pub hysteresis: f64,
    /// The pulses fill less than 5 % of the time, so the middle of the 0.1 and 99.9 % quantiles was
    /// taken instead of that of the 5 and 95 % quantiles.
    pub narrow_pulses: bool,
}

impl Threshold {
    /// Chooses the threshold of a waveform (D19); `None` for no samples or a constant.
    ///
    /// `scratch` is overwritten; it grows only if its capacity is below the length of `x`.
    #[must_use]
    pub fn of<T: Real>(x: &[T], scratch: &mut Vec<T>) -> Option<Self> {
        scratch.clear();
        scratch.extend_from_slice(x);
        let mut quantile = |q: f64| stats::quantile(scratch, q).map(T::to_f64);
        let (low, high) = (quantile(0.05)?, quantile(0.95)?);
        let (lowest, highest) = (quantile(0.001)?, quantile(0.999)?);
        let narrow_pulses = high - low < NARROW_PULSE_SHARE * (highest - lowest);
        let (low, high) = if narrow_pulses { (lowest, highest) } else { (low, high) };
        (high > low).then_some(Self {
            level: 0.5 * (low + high),
            hysteresis: HYSTERESIS * (high - low),
            narrow_pulses,
        })
    }

    /// Writes the times of the edges of `x` into `times_s`, s from the first sample, ascending.
    ///
    /// An edge counts once the signal has come from half the hysteresis below the level to half of it
    /// above; its time is where the line between two samples last crossed the level. `times_s` is
    /// cleared first; it grows only if its capacity does not suffice.
    pub fn edges<T: Real>(&self, x: &[T], fs_hz: f64, edge: Edge, times_s: &mut Vec<f64>) {
        times_s.clear();
        let sign = match edge {
            Edge::Rising => 1.0,
            Edge::Falling => -1.0,
        };
        let half = 0.5 * self.hysteresis;
        let mut armed = false;
        let mut crossing = 0.0;
        let mut previous = f64::INFINITY;
        for (i, value) in x.iter().enumerate() {
            let value = sign * (value.to_f64() - self.level);
            if previous < 0.0 && value >= 0.0 {
                crossing = i as f64 - value / (value - previous);
            }
            if value <= -half {
                armed = true;
            } else if armed && value >= half {
                armed = false;
                times_s.push(crossing / fs_hz);
            }
            previous = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    const FS_HZ: f64 = 10_000.0;

    fn edges<T: Real>(x: &[f64], edge: Edge) -> (Vec<f64>, Threshold) {
        let x = narrow::<T>(x);
        let threshold = Threshold::of(&x, &mut Vec::new()).unwrap();
        let mut times_s = Vec::new();
        threshold.edges(&x, FS_HZ, edge, &mut times_s);
        (times_s, threshold)
    }

    #[test]
    fn a_sine_crosses_where_it_should() {
        // sin(2π·7.3·t) = cos(… − π/2) + 2: rising at k/7.3, falling half a period later.
        let x: Vec<f64> = sine(10_000, FS_HZ, 7.3, 3.0, 0.5 * std::f64::consts::PI)
            .iter()
            .map(|v| v + 2.0)
            .collect();
        let (rising, threshold) = edges::<f64>(&x, Edge::Rising);
        assert!(!threshold.narrow_pulses);
        // Not whole periods: the middle of the quantiles is off the mean by some per cent of 3.
        assert!((threshold.level - 2.0).abs() < 0.1);
        assert_eq!(rising.len(), 7, "the one at t = 0 has no low before it");
        let period: Vec<f64> = rising.windows(2).map(|w| w[1] - w[0]).collect();
        // Linear interpolation of a smooth crossing: 1e-8 s.
        assert!(period.iter().all(|p| (p - 1.0 / 7.3).abs() < 1e-7));
        let (falling, _) = edges::<f32>(&x, Edge::Falling);
        assert_eq!(falling.len(), 7);
        let half = rising.first().unwrap() - falling.first().unwrap();
        assert!((half - 0.5 / 7.3).abs() < 1e-3, "a level off the mean moves the two apart");
    }

    #[test]
    fn noise_below_the_hysteresis_makes_no_edges() {
        let clean = sine(10_000, FS_HZ, 20.0, 1.0, 0.0);
        let noise = gaussian_noise(10_000, 1);
        // 5 σ of noise = 0.15, hysteresis ± 0.2.
        let x: Vec<f64> = clean.iter().zip(&noise).map(|(a, b)| a + 0.03 * b).collect();
        assert_eq!(edges::<f32>(&x, Edge::Rising).0.len(), 20);
    }

    #[test]
    fn narrow_pulses_are_found_and_said_so() {
        // 2 % duty with noise: the 95 % quantile is in the base line.
        let noise = gaussian_noise(10_000, 2);
        let pulse = |i: usize| if i % 500 < 10 { 5.0 } else { 0.0 };
        let x: Vec<f64> = (0..10_000).map(|i| pulse(i) + 0.05 * noise[i]).collect();
        let (times_s, threshold) = edges::<f32>(&x, Edge::Rising);
        assert!(threshold.narrow_pulses);
        assert_eq!(times_s.len(), 19, "the pulse at sample 0 has no low before it");
        // Between the samples 499 and 500.
        assert!((times_s[0] - 499.5 / FS_HZ).abs() < 0.1 / FS_HZ);
    }

    #[test]
    fn constants_have_no_threshold() {
        for x in [vec![], vec![1.0], vec![5.0_f32; 100]] {
            assert_eq!(Threshold::of(&x, &mut Vec::new()), None);
        }
    }
}
