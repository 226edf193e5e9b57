//! What sensors hear: strikes through random transfer paths, noise, tones (T2–T4).

use super::motion::Turn;
use crate::dsp::real::floor_index;
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

/// Draws a number of mean 0 and variance 1.
pub fn normal(random: &mut Pcg64Mcg) -> f64 {
    StandardNormal.sample(random)
}

/// The way from where something strikes to a sensor: modes that ring, an impulse response of unit energy (T2).
#[derive(Debug, Clone)]
pub struct Path(Vec<Ring>);

/// A mode of a path: A·e^{−ζωi}·sin ωi after a strike, i in samples.
#[derive(Debug, Clone, Copy)]
pub struct Mode {
    /// ω, rad a sample.
    pub omega: f64,
    /// ζ.
    pub damping: f64,
    /// A.
    pub amplitude: f64,
}

/// A mode as a recursion: y_i = a·y_{i−1} + b·y_{i−2} + c·x_{i−1}.
#[derive(Debug, Clone, Copy)]
struct Ring {
    a: f64,
    b: f64,
    c: f64,
}

/// Energy of a response is counted until the slowest mode is down to this part.
const RUNG_OUT: f64 = 1e-4;

/// Longest response counted, samples.
const MAX_RING: f64 = 1e5;

impl Path {
    /// Draws a path of three to eight modes.
    #[must_use]
    pub fn draw(random: &mut Pcg64Mcg) -> Self {
        let n_modes = random.random_range(MODES.0..=MODES.1);
        let mode = |_| Mode {
            omega: TAU * random.random_range(MODE_BAND.0..MODE_BAND.1),
            damping: random.random_range(DAMPING.0..DAMPING.1),
            amplitude: normal(random),
        };
        Self::of(&(0..n_modes).map(mode).collect::<Vec<_>>())
    }

    /// A path of these modes, scaled to unit energy.
    #[must_use]
    pub fn of(modes: &[Mode]) -> Self {
        let ring = |mode: &Mode| {
            let decay = (-mode.damping * mode.omega).exp();
            Ring {
                a: 2.0 * decay * mode.omega.cos(),
                b: -decay * decay,
                c: mode.amplitude * decay * mode.omega.sin(),
            }
        };
        let mut path = Self(modes.iter().map(ring).collect());
        let slowest = modes.iter().map(|m| m.damping * m.omega).fold(f64::INFINITY, f64::min);
        let mut strike = vec![0.0; floor_index((-RUNG_OUT.ln() / slowest).min(MAX_RING)) + 1];
        strike[0] = 1.0;
        let energy: f64 = path.hear(&strike).iter().map(|v| v * v).sum();
        if energy > 0.0 {
            path.0.iter_mut().for_each(|ring| ring.c /= energy.sqrt());
        }
        path
    }

    /// Hears strikes of given strengths, one a sample.
    #[must_use]
    pub fn hear(&self, strikes: &[f64]) -> Vec<f64> {
        let mut heard = vec![0.0; strikes.len()];
        for ring in &self.0 {
            let (mut last, mut before, mut struck) = (0.0, 0.0, 0.0);
            for (value, strength) in heard.iter_mut().zip(strikes) {
                let now = ring.a * last + ring.b * before + ring.c * struck;
                *value += now;
                (last, before, struck) = (now, last, *strength);
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
    /// Standard deviation of a distance, relative: what the k-th is off by grows like √k.
    pub drift: f64,
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
            // Nothing is struck before the record, where a run-up may never have been.
            t_s = if struck < 0.0 { 0.0 } else { turn.time_s(struck, t_s) };
            let (order, depth) = self.modulation;
            let load = (1.0 + depth * (TAU * order * struck).cos()).max(0.0);
            let at = t_s * rate_hz;
            if struck >= 0.0 && at >= 0.0 && at < n as f64 {
                strikes[floor_index(at)] += load * (1.0 + self.scatter * normal(random));
            }
            let slipped = if self.drift > 0.0 { self.drift * normal(random) } else { 0.0 };
            place += (1.0 + slipped) / self.order;
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

/// Lowest corner of pink noise, Hz, and how far the next one is.
const PINK_HZ: f64 = 8.0;
const PINK_STEP: f64 = 3.0;

/// Noise of −3 dB an octave and unit RMS: first-order low-passes an octave and a half apart, of equal power.
#[must_use]
pub fn pink(n: usize, rate_hz: f64, random: &mut Pcg64Mcg) -> Vec<f64> {
    let corners_hz = std::iter::successors(Some(PINK_HZ), |corner| Some(PINK_STEP * corner));
    let corners_hz = corners_hz.take_while(|corner| *corner < 0.5 * rate_hz);
    let poles: Vec<f64> = corners_hz.map(|corner| (-TAU * corner / rate_hz).exp()).collect();
    let mut states = vec![0.0; poles.len()];
    let mut x = Vec::with_capacity(n);
    for _ in 0..n {
        for (state, pole) in states.iter_mut().zip(&poles) {
            *state = pole * *state + (1.0 - pole * pole).sqrt() * normal(random);
        }
        x.push(states.iter().sum());
    }
    let mut scaled = vec![0.0; n];
    add_scaled(&mut scaled, &x, 1.0);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trials::motion::Motion;
    use rand::SeedableRng;

    #[test]
    fn a_path_rings_as_its_modes_are_written_and_has_unit_energy() {
        let modes = [
            Mode { omega: 0.9, damping: 0.03, amplitude: 1.0 },
            Mode { omega: 2.1, damping: 0.01, amplitude: -0.4 },
        ];
        let response = |i: usize| -> f64 {
            let i = i as f64;
            let of =
                |m: &Mode| m.amplitude * (-m.damping * m.omega * i).exp() * (m.omega * i).sin();
            modes.iter().map(of).sum()
        };
        let energy: f64 = (0..4000).map(|i| response(i).powi(2)).sum();
        let mut strikes = vec![0.0; 1000];
        (strikes[100], strikes[140]) = (1.0, 0.5);
        let heard = Path::of(&modes).hear(&strikes);
        for (i, heard) in heard.iter().enumerate() {
            let at = |struck: usize| if i < struck { 0.0 } else { response(i - struck) };
            let meant = (at(100) + 0.5 * at(140)) / energy.sqrt();
            // Rounding of a few hundred steps; energy left beyond what is counted: 1e-8 of it.
            assert!((heard - meant).abs() < 1e-7, "{i}: {heard} {meant}");
        }
    }

    #[test]
    fn places_before_a_run_up_are_struck_by_nothing_and_the_record_ends() {
        // A quarter of the strikes are drawn before the record, many of them where the ramp, run backwards, has turned round.
        for seed in 0..20 {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let turn = Turn::draw(Motion::Ramp(0.55, 1.1), 20.0, 2.0, &mut random);
            let modulation = (1.0, 0.0);
            let strikes =
                Strikes { order: 1.0, jitter: 20.0, drift: 0.0, scatter: 0.0, modulation };
            let struck = strikes.make(&turn, 2000, 1e3, &mut random);
            let n_struck = struck.iter().filter(|s| **s > 0.0).count();
            assert!(n_struck <= 80, "{n_struck} strikes of 33 turns");
        }
    }

    #[test]
    fn a_drift_adds_up_where_jitter_does_not() {
        let off = |jitter: f64, drift: f64| -> f64 {
            let strikes =
                Strikes { order: 1.0, jitter, drift, scatter: 0.0, modulation: (1.0, 0.0) };
            let mut squares = 0.0;
            for seed in 0..200 {
                let mut random = Pcg64Mcg::seed_from_u64(seed);
                let turn = Turn::draw(super::super::motion::Motion::Steady, 1.0, 1.0, &mut random);
                let x = strikes.make(&turn, 40_000, 400.0, &mut random);
                let at: Vec<usize> = (0..x.len()).filter(|i| x[*i] > 0.0).collect();
                squares += ((at[90] - at[0]) as f64 / 400.0 - 90.0).powi(2);
            }
            (squares / 200.0).sqrt()
        };
        // √2·σ of two places, and σ·√90 of ninety distances; 5 % each from 200 tries, in samples of 1/400.
        assert!((off(0.02, 0.0) / 0.0283 - 1.0).abs() < 0.2);
        assert!((off(0.0, 0.02) / 0.190 - 1.0).abs() < 0.2);
    }
}
