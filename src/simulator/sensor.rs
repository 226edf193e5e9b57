//! What a sensor and its converter make of a motion: anti-alias filter, noise, drift, range, counts.
//!
//! A chain takes values at the inner rate and gives samples at its own. Must not know rotors.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Order of the anti-alias filter.
const FILTER_ORDER: u32 = 8;

/// A sensor with its converter.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorModel {
    /// Inner samples for each sample given, at least 1.
    pub oversampling: u32,
    /// Rate of the samples given, Hz.
    pub rate_hz: f64,
    /// Corner of the anti-alias filter, Hz (Butterworth of eighth order); `None`: no filter.
    pub corner_hz: Option<f64>,
    /// One-sided noise density, unit/√Hz; 0: clean.
    pub noise_density: f64,
    /// Slow drift, unit/s.
    pub drift_per_s: f64,
    /// What the sensor reads at rest, unit (a probe's gap).
    pub rest: f64,
    /// Converter range ±, unit, and bits; `None`: floating point without a range.
    pub converter: Option<Converter>,
    /// Times between which the sensor gives 0, s.
    pub dropouts_s: Vec<(f64, f64)>,
}

/// An analogue-to-digital converter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Converter {
    /// Largest value, unit; the smallest is its negative.
    pub range: f64,
    /// Bits, 2 to 16.
    pub bits: u32,
}

impl Converter {
    /// Unit a count.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.range / f64::from(1_u32 << (self.bits - 1))
    }

    /// The count of a value, clipped to the range.
    #[must_use]
    pub fn count(&self, value: f64) -> i16 {
        let half = f64::from(1_u32 << (self.bits - 1));
        // Rounded by cutting a positive number off: without a call in a default build.
        let shifted = (value / self.scale() + (half + 0.5)).clamp(0.0, 2.0 * half - 0.5);
        #[expect(clippy::cast_possible_truncation, reason = "clamped to at most 16 bits")]
        let count = (shifted as i32 - (1_i32 << (self.bits - 1))) as i16;
        count
    }
}

/// A sensor in use.
#[derive(Debug, Clone)]
pub struct Chain {
    model: SensorModel,
    filter: Vec<Biquad>,
    random: Pcg64Mcg,
    /// Standard deviation of the noise, unit.
    deviation: f64,
    /// Whether samples depend on their time.
    is_timed: bool,
    n_in: u64,
    n_out: u64,
}

/// A second-order section with its state (direct form II, transposed).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Biquad {
    b0: f64,
    b1: f64,
    a1: f64,
    a2: f64,
    s1: f64,
    s2: f64,
}

impl Biquad {
    /// Sections of a Butterworth low-pass (bilinear transform with the corner kept in place).
    fn butterworth(corner_hz: f64, rate_hz: f64) -> Vec<Self> {
        let k = (PI * corner_hz / rate_hz).tan();
        let section = |i: u32| {
            let angle = PI * f64::from(2 * i + 1) / f64::from(2 * FILTER_ORDER);
            let damping = 2.0 * angle.sin();
            let norm = 1.0 / (1.0 + damping * k + k * k);
            Self {
                b0: k * k * norm,
                b1: 2.0 * k * k * norm,
                a1: 2.0 * (k * k - 1.0) * norm,
                a2: (1.0 - damping * k + k * k) * norm,
                s1: 0.0,
                s2: 0.0,
            }
        };
        (0..FILTER_ORDER / 2).map(section).collect()
    }

    fn process(&mut self, x: f64) -> f64 {
        let y = self.b0 * x + self.s1;
        self.s1 = self.b1 * x - self.a1 * y + self.s2;
        self.s2 = self.b0 * x - self.a2 * y;
        y
    }

    /// As if `x` had stood at the input for ever; the section passes a constant unchanged.
    fn settle(&mut self, x: f64) {
        self.s2 = self.b0 * x - self.a2 * x;
        self.s1 = self.b1 * x - self.a1 * x + self.s2;
    }
}

impl Chain {
    /// Begins with seed and number of the channel: each channel has noise of its own, the same at
    /// every run.
    #[must_use]
    pub fn new(model: SensorModel, seed: u64, channel: u64) -> Self {
        let inner_hz = model.rate_hz * f64::from(model.oversampling);
        let filter = model.corner_hz.map(|corner| Biquad::butterworth(corner, inner_hz));
        let mut random =
            Pcg64Mcg::seed_from_u64(seed ^ channel.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        // Seeds that differ in few bits give streams that begin alike: let them part.
        for _ in 0..16 {
            let _: u64 = random.random();
        }
        Self {
            filter: filter.unwrap_or_default(),
            // A one-sided density over the band up to rate/2.
            deviation: model.noise_density * (0.5 * model.rate_hz).sqrt(),
            is_timed: model.drift_per_s.abs() > 0.0 || !model.dropouts_s.is_empty(),
            model,
            random,
            n_in: 0,
            n_out: 0,
        }
    }

    /// Takes a value of the inner rate; every `oversampling`-th, the first included, gives a sample.
    pub fn push(&mut self, value: f64) -> Option<f64> {
        if self.n_in == 0 {
            self.filter.iter_mut().for_each(|section| section.settle(value));
        }
        let filtered = self.filter.iter_mut().fold(value, |x, section| section.process(x));
        let due = self.n_in.is_multiple_of(u64::from(self.model.oversampling));
        self.n_in += 1;
        due.then(|| self.sample(filtered))
    }

    /// A sample of a value that is already band-limited.
    pub fn sample(&mut self, value: f64) -> f64 {
        let noise = if self.deviation > 0.0 {
            self.deviation * self.random.sample::<f64, _>(StandardNormal)
        } else {
            0.0
        };
        let number = self.n_out;
        self.n_out += 1;
        if !self.is_timed {
            return self.model.rest + value + noise;
        }
        let time_s = number as f64 / self.model.rate_hz;
        if self.model.dropouts_s.iter().any(|(from, to)| (*from..*to).contains(&time_s)) {
            return 0.0;
        }
        self.model.rest + value + self.model.drift_per_s * time_s + noise
    }
}

/// Voltage of a once-a-turn mark, 0 to 1: rises through ½ at angle 0 and falls after `duty` of a turn.
///
/// The edges are ramps of `rise_rad`, at least three samples' turn, so that the instant of the edge
/// survives sampling.
#[must_use]
pub fn tacho_mark(angle_rad: f64, duty: f64, rise_rad: f64) -> f64 {
    let middle = 0.5 * duty * TAU;
    let from_middle = angle_rad - middle - TAU * ((angle_rad - middle) / TAU).round();
    (0.5 + (middle - from_middle.abs()) / rise_rad).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(noise_density: f64) -> SensorModel {
        SensorModel {
            oversampling: 5,
            rate_hz: 10_000.0,
            corner_hz: Some(4000.0),
            noise_density,
            drift_per_s: 0.0,
            rest: 0.0,
            converter: None,
            dropouts_s: Vec::new(),
        }
    }

    /// Amplitude at which a unit sine of this frequency comes out.
    fn gain(frequency_hz: f64) -> f64 {
        let mut chain = Chain::new(model(0.0), 1, 0);
        let inner = |i: u32| (TAU * frequency_hz * f64::from(i) / 50_000.0).sin();
        let out: Vec<f64> = (0..50_000).filter_map(|i| chain.push(inner(i))).collect();
        let settled = &out[2000..];
        (2.0 * settled.iter().map(|x| x * x).sum::<f64>() / settled.len() as f64).sqrt()
    }

    #[test]
    fn the_filter_is_the_butterworth_of_its_corner() {
        let warped = |f: f64| (PI * f / 50_000.0).tan() / (PI * 4000.0 / 50_000.0).tan();
        for f in [100.0, 2010.0, 4010.0, 7010.0] {
            let expected = (1.0 + warped(f).powi(16)).powf(-0.5);
            // The mean of sin² over 0.8 s is ½ within 1e-4.
            assert!((gain(f) - expected).abs() < 5e-4, "{f}: {} {expected}", gain(f));
        }
        // What would appear at 206 Hz: 9794 Hz, 36 times 272 Hz.
        assert!(gain(9794.0) < 1e-3);
    }

    #[test]
    fn a_constant_comes_out_at_once() {
        let mut chain = Chain::new(model(0.0), 1, 0);
        let out: Vec<f64> = (0..100).filter_map(|_| chain.push(-3.0)).collect();
        assert!(out.iter().all(|x| (x + 3.0).abs() < 1e-12), "{out:?}");
    }

    #[test]
    fn noise_has_its_density_and_each_channel_its_own() {
        let draw = |channel| {
            let mut chain = Chain::new(model(2e-3), 7, channel);
            (0..20_000).map(|_| chain.sample(0.0)).collect::<Vec<f64>>()
        };
        let (a, b) = (draw(0), draw(1));
        assert_eq!(a, draw(0), "the same at every run");
        let power = a.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        // (2e-3)²·5000 Hz = 0.02; the variance estimate of 20 000 has a scatter of 1 %.
        assert!((power / 0.02 - 1.0).abs() < 0.05, "{power}");
        let together = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() / 20_000.0 / 0.02;
        // 4 σ of a correlation of independent noise.
        assert!(together.abs() < 4.0 / 20_000.0_f64.sqrt(), "{together}");
    }

    #[test]
    fn a_converter_rounds_and_clips() {
        let converter = Converter { range: 10.0, bits: 12 };
        assert!((converter.scale() - 10.0 / 2048.0).abs() < 1e-15);
        assert_eq!([99.0, -99.0, 0.0].map(|x| converter.count(x)), [2047, -2048, 0]);
        assert_eq!(converter.count(converter.scale() * 17.4), 17);
    }

    #[test]
    fn the_mark_rises_through_one_half_at_angle_zero() {
        for turns in [0.0, 1.0, 57.0] {
            let at = |rad: f64| tacho_mark(TAU * turns + rad, 0.1, 0.06);
            assert!((at(0.0) - 0.5).abs() < 1e-9 && at(0.031) >= 1.0 && at(-0.031) <= 0.0);
            assert!((at(0.1 * TAU) - 0.5).abs() < 1e-9);
        }
    }
}
