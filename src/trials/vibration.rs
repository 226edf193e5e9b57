//! What sensors hear: strikes through random transfer paths, noise, tones (T2–T4).

use super::motion::Turn;
use rand::RngExt;
use rand_distr::Distribution;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Modes of a transfer path, fewest and most.
const MODES: (u32, u32) = (3, 8);

/// Damping ratios of the modes.
const DAMPING: (f64, f64) = (0.01, 0.06);

/// Part of the sampling rate between which modes lie.
const MODE_BAND: (f64, f64) = (0.07, 0.46);

/// A ring-down is followed over so many samples: the slowest has decayed to 2 % by then.
const N_RING: usize = 600;

/// Draws a number of mean 0 and variance 1.
pub fn normal(random: &mut Pcg64Mcg) -> f64 {
    StandardNormal.sample(random)
}

/// The way from where something strikes to a sensor: an impulse response of unit energy (T2).
#[derive(Debug, Clone)]
pub struct Path(Vec<f64>);

impl Path {
    /// Draws a path of three to eight modes.
    #[must_use]
    pub fn draw(random: &mut Pcg64Mcg) -> Self {
        let mut response = vec![0.0; N_RING];
        for _ in 0..random.random_range(MODES.0..=MODES.1) {
            let omega = TAU * random.random_range(MODE_BAND.0..MODE_BAND.1);
            let damping = random.random_range(DAMPING.0..DAMPING.1);
            let amplitude = normal(random);
            for (i, value) in response.iter_mut().enumerate() {
                let angle = omega * i as f64;
                *value += amplitude * (-damping * angle).exp() * angle.sin();
            }
        }
        let energy: f64 = response.iter().map(|v| v * v).sum();
        response.iter_mut().for_each(|value| *value /= energy.sqrt());
        Self(response)
    }

    /// Hears strikes of given strengths, one a sample.
    #[must_use]
    pub fn hear(&self, strikes: &[f64]) -> Vec<f64> {
        let mut heard = vec![0.0; strikes.len()];
        for (at, strength) in strikes.iter().enumerate().filter(|(_, s)| s.abs() > 0.0) {
            for (value, response) in heard[at..].iter_mut().zip(&self.0) {
                *value += strength * response;
            }
        }
        heard
    }
}

/// A train of strikes at `order` times the shaft's angle (T3).
#[derive(Debug, Clone, Copy)]
pub struct Strikes {
    /// Strikes a revolution, slip included.
    pub order: f64,
    /// Standard deviation of a strike's place, as part of their distance.
    pub jitter: f64,
    /// Standard deviation of the strength, relative.
    pub scatter: f64,
    /// Modulation of the strength: order and depth of 1 + d·cos(2π·order·turns), not below 0.
    pub modulation: (f64, f64),
}

impl Strikes {
    /// Strengths sample by sample.
    #[must_use]
    pub fn make(&self, turn: &Turn, n: usize, rate_hz: f64, random: &mut Pcg64Mcg) -> Vec<f64> {
        let mut strikes = vec![0.0; n];
        let duration_s = n as f64 / rate_hz;
        let mut place = random.random_range(0.0..1.0) / self.order;
        let mut t_s = 0.0;
        while t_s < duration_s {
            let struck = place + self.jitter * normal(random) / self.order;
            t_s = turn.time_s(struck, t_s);
            let (order, depth) = self.modulation;
            let load = (1.0 + depth * (TAU * order * struck).cos()).max(0.0);
            let at = t_s * rate_hz;
            if at >= 0.0 && at < n as f64 {
                strikes[crate::dsp::real::floor_index(at)] +=
                    load * (1.0 + self.scatter * normal(random));
            }
            place += 1.0 / self.order;
        }
        strikes
    }
}

/// Adds `gain` times `x` brought to unit RMS; silence stays silent.
pub fn add_scaled(to: &mut [f64], x: &[f64], gain: f64) {
    let mean_square = x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64;
    if mean_square > 0.0 {
        let gain = gain / mean_square.sqrt();
        to.iter_mut().zip(x).for_each(|(to, x)| *to += gain * x);
    }
}

/// Noise of unit RMS as a machine makes it: white noise through a path, on a white floor 10 dB lower.
#[must_use]
pub fn machine_noise(n: usize, random: &mut Pcg64Mcg) -> Vec<f64> {
    let path = Path::draw(random);
    let white: Vec<f64> = (0..n).map(|_| normal(random)).collect();
    let mut noise = path.hear(&white);
    noise.iter_mut().for_each(|value| *value += 0.3 * normal(random));
    let mut scaled = vec![0.0; n];
    add_scaled(&mut scaled, &noise, 1.0);
    scaled
}

/// Adds a tone at an order of the shaft.
pub fn add_order(
    to: &mut [f64],
    turn: &Turn,
    rate_hz: f64,
    order: f64,
    amplitude: f64,
    phase: f64,
) {
    for (i, value) in to.iter_mut().enumerate() {
        *value += amplitude * (TAU * order * turn.revolutions(i as f64 / rate_hz) + phase).cos();
    }
}

/// Adds a tone at a fixed frequency.
pub fn add_tone(to: &mut [f64], rate_hz: f64, frequency_hz: f64, amplitude: f64, phase: f64) {
    for (i, value) in to.iter_mut().enumerate() {
        *value += amplitude * (TAU * frequency_hz * i as f64 / rate_hz + phase).cos();
    }
}
