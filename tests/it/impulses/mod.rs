//! Vibration of a bearing with a local defect, in closed form: a train of decaying impulses.
//!
//! The scene, the seed and the duration are arguments; the same three give the same bits. No
//! simulation of a rig: it has what a local defect's vibration must have (strikes at the kinematic
//! rate, load zone, ring-down, slip, noise) and a known answer. f_d: rate of the strikes, N: standard
//! normal, θ: shaft angle.
//!
//! | no. | equation |
//! |---|---|
//! | M1 | t₀ = U/f_d, t_k+1 = t_k + max(1 + s·N_k, 0.1)/f_d; f_d = BPFI, BPFO or 2·BSF |
//! | M2 | q(ψ) = max(0, 1 − (1 − cos ψ)/(2ε))^1.5 (Stribeck) |
//! | M3 | a_k = A·q(ψ(t_k)); ψ = θ (inner race), 0 (outer race), 2π·FTF·t (rolling element) |
//! | M4 | r(t) = Σ_k a_k·e^(−ζω(t − t_k))·sin(ω√(1 − ζ²)·(t − t_k)), t ≥ t_k |
//! | M5 | h(t) = Σ_{n=1..3} B_n·cos(n(θ − λ)); λ = 0 in x, π/2 in y |
//! | M6 | tacho: trapezoid once a turn, 5 V, rising through 2.5 V at θ = 0 |
//! | M7 | x, y = r + h + σ·N, ω and N of their own for each axis |

pub(crate) mod files;

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::machine::bearing::FaultOrders;
use rotorwatch::units::Hz;
use std::f64::consts::PI;
use std::f64::consts::TAU;

/// Fault orders of the bearing in [`files::MACHINE`] (9 balls of 7.94 mm on 39.04 mm, SKF
/// 6205).
pub(crate) const ORDERS: FaultOrders = FaultOrders {
    ftf: 0.398_309_426_229_508_2,
    bpfo: 3.584_784_836_065_574,
    bpfi: 5.415_215_163_934_426,
    bsf: 2.356_747_713_383_160_5,
};

/// A ring-down is followed until it has decayed to this part.
const NEGLIGIBLE: f64 = 1e-6;

/// Most samples a channel is made of: 24 h at 12 kHz would be ten times as many.
const MAX_SAMPLES: f64 = 1e8;

/// High level of the tacho, V.
const TACHO_V: f64 = 5.0;

/// Length of the tacho's pulse, and of each of its two ramps, as parts of a revolution.
const TACHO_PULSE: (f64, f64) = (0.25, 0.05);

/// Where the bearing is damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Defect {
    /// Struck at BPFI, while it turns through the load zone.
    InnerRace,
    /// Struck at BPFO, always in the load zone.
    OuterRace,
    /// Strikes both races, so at 2·BSF, while the cage carries it through the load zone.
    RollingElement,
}

/// What is measured, and what is broken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scene {
    /// Samples a second of every channel, > 0.
    pub(crate) sample_rate: Hz,
    /// Speed of the shaft, constant, > 0.
    pub(crate) shaft_speed: Hz,
    /// The bearing, inner ring turning.
    pub(crate) bearing: FaultOrders,
    /// What is broken; `None`: a healthy bearing.
    pub(crate) defect: Option<Defect>,
    /// First peak of a ring-down, damping left aside, where the load is greatest: A, m/s².
    pub strike_m_per_s2: f64,
    /// Part of the way around over which the bearing carries load, Stribeck's ε: 0.5 without
    /// clearance, less with clearance, more with preload.
    pub(crate) load_zone: f64,
    /// Standard deviation of the time between two strikes, relative: s.
    pub(crate) slip_jitter: f64,
    /// Resonances of the housing in x and y.
    pub(crate) resonance: [Hz; 2],
    /// Damping ratio of both, 0 < ζ < 1.
    pub(crate) damping_ratio: f64,
    /// Amplitudes of the shaft's harmonics 1×, 2×, 3×, zero to peak, m/s².
    pub shaft_lines_m_per_s2: [f64; 3],
    /// White Gaussian noise of each accelerometer, RMS, m/s².
    pub noise_rms_m_per_s2: f64,
}

/// Samples of a scene, channels of equal length.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recording {
    /// Accelerometer at 0°, m/s².
    pub(crate) x: Vec<f32>,
    /// Accelerometer at 90°, m/s².
    pub(crate) y: Vec<f32>,
    /// Tacho, V: one pulse a revolution, its rising edge through half height at angle 0.
    pub(crate) tacho: Vec<f32>,
}

impl Scene {
    /// A healthy bearing of the demonstration's machine at 25 Hz, 12 kHz.
    #[must_use]
    pub(crate) const fn healthy() -> Self {
        Self {
            sample_rate: Hz(12_000.0),
            shaft_speed: Hz(25.0),
            bearing: ORDERS,
            defect: None,
            strike_m_per_s2: 10.0,
            load_zone: 0.5,
            slip_jitter: 0.005,
            resonance: [Hz(3200.0), Hz(2700.0)],
            damping_ratio: 0.05,
            shaft_lines_m_per_s2: [0.4, 0.2, 0.1],
            noise_rms_m_per_s2: 1.0,
        }
    }

    /// The same with a defect.
    #[must_use]
    pub(crate) const fn with(defect: Defect) -> Self {
        Self { defect: Some(defect), ..Self::healthy() }
    }

    /// Mean rate of the strikes (M1); `None` for a healthy bearing.
    #[must_use]
    pub(crate) fn strike_rate(&self) -> Option<Hz> {
        let order = match self.defect? {
            Defect::InnerRace => self.bearing.bpfi,
            Defect::OuterRace => self.bearing.bpfo,
            Defect::RollingElement => self.bearing.two_bsf(),
        };
        Some(Hz(order * self.shaft_speed.0))
    }

    /// Samples a channel of `duration_s` has, 10⁸ at most.
    #[must_use]
    pub(crate) fn n_samples(&self, duration_s: f64) -> usize {
        let n = (duration_s * self.sample_rate.0).round().clamp(0.0, MAX_SAMPLES);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to 0…10⁸; NaN gives 0"
        )]
        let n = n as usize;
        n
    }

    /// Makes `duration_s` seconds of the scene, the first sample at time 0 (M7).
    #[must_use]
    pub(crate) fn record(&self, seed: u64, duration_s: f64) -> Recording {
        let n = self.n_samples(duration_s);
        let strikes = self.strikes(&mut stream(seed, 0), n as f64 / self.sample_rate.0);
        let axis = |axis: usize, source: u64| {
            let mut samples = self.shaft_lines(n, axis);
            self.add_noise(&mut samples, &mut stream(seed, source));
            self.add_ring_downs(&mut samples, &strikes, self.resonance[axis]);
            samples.into_iter().map(single).collect()
        };
        Recording { x: axis(0, 1), y: axis(1, 2), tacho: self.tacho(n) }
    }

    /// Times and amplitudes of the strikes before `duration_s`, s and m/s² (M1–M3).
    fn strikes(&self, random: &mut Pcg64Mcg, duration_s: f64) -> Vec<(f64, f64)> {
        let Some(rate) = self.strike_rate().filter(|rate| rate.0 > 0.0) else {
            return Vec::new();
        };
        let loaded_once_in = match self.defect {
            Some(Defect::InnerRace) => self.shaft_speed,
            Some(Defect::RollingElement) => Hz(self.bearing.ftf * self.shaft_speed.0),
            Some(Defect::OuterRace) | None => Hz(0.0),
        };
        let mut strikes = Vec::new();
        let mut time_s = random.random::<f64>() / rate.0;
        while time_s < duration_s {
            let load = self.load(TAU * loaded_once_in.0 * time_s);
            if load > 0.0 {
                strikes.push((time_s, self.strike_m_per_s2 * load));
            }
            // Rolling has a direction: no strike comes before the one before it.
            time_s += (1.0 + self.slip_jitter * gaussian(random)).max(0.1) / rate.0;
        }
        strikes
    }

    /// Load at `angle_rad` from its direction, as a part of the greatest (M2, Stribeck).
    fn load(&self, angle_rad: f64) -> f64 {
        (1.0 - (1.0 - angle_rad.cos()) / (2.0 * self.load_zone)).max(0.0).powf(1.5)
    }

    /// Adds the ring-down of every strike (M4).
    fn add_ring_downs(&self, samples: &mut [f64], strikes: &[(f64, f64)], resonance: Hz) {
        let omega = resonance.to_rad_per_s().0;
        let decay_per_s = self.damping_ratio * omega;
        let damped_omega = omega * (1.0 - self.damping_ratio * self.damping_ratio).sqrt();
        let length_s = -NEGLIGIBLE.ln() / decay_per_s;
        let rate = self.sample_rate.0;
        for &(time_s, amplitude) in strikes {
            let first = index_at_or_after(time_s * rate);
            let last = index_at_or_after((time_s + length_s) * rate).min(samples.len());
            for (i, sample) in samples.iter_mut().enumerate().take(last).skip(first) {
                let since_s = i as f64 / rate - time_s;
                *sample +=
                    amplitude * (-decay_per_s * since_s).exp() * (damped_omega * since_s).sin();
            }
        }
    }

    /// Harmonics of the shaft; y sees the turning force a quarter of a revolution after x (M5).
    fn shaft_lines(&self, n: usize, axis: usize) -> Vec<f64> {
        let lag_rad = if axis == 0 { 0.0 } else { 0.5 * PI };
        let at = |i: usize| {
            let angle_rad = TAU * self.shaft_speed.0 * i as f64 / self.sample_rate.0 - lag_rad;
            let lines = self.shaft_lines_m_per_s2.iter().zip(1_u8..);
            lines.map(|(amplitude, h)| amplitude * (f64::from(h) * angle_rad).cos()).sum()
        };
        (0..n).map(at).collect()
    }

    fn add_noise(&self, samples: &mut [f64], random: &mut Pcg64Mcg) {
        for sample in samples {
            *sample += self.noise_rms_m_per_s2 * gaussian(random);
        }
    }

    /// One trapezoid a revolution (M6): interpolation finds its edge between two samples.
    fn tacho(&self, n: usize) -> Vec<f32> {
        let (pulse, ramp) = TACHO_PULSE;
        let at = |i: usize| {
            let turns = self.shaft_speed.0 * i as f64 / self.sample_rate.0 + 0.5 * ramp;
            let part = turns.fract();
            single(TACHO_V * (part / ramp).min((pulse + ramp - part) / ramp).clamp(0.0, 1.0))
        };
        (0..n).map(at).collect()
    }
}

/// A source of random numbers for each purpose, so that one does not shift another.
fn stream(seed: u64, purpose: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed.wrapping_mul(4).wrapping_add(purpose))
}

/// A standard normal number (Box and Muller 1958).
fn gaussian(random: &mut Pcg64Mcg) -> f64 {
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
}

/// First whole number at or after `place`, 0 at least.
fn index_at_or_after(place: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate; the place is inside a recording"
    )]
    let index = place.ceil() as usize;
    index
}

fn single(sample: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "samples are f32 by design")]
    let sample = sample as f32;
    sample
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing but the strikes of a defect.
    fn bare(defect: Defect) -> Scene {
        Scene {
            noise_rms_m_per_s2: 0.0,
            shaft_lines_m_per_s2: [0.0; 3],
            slip_jitter: 0.0,
            ..Scene::with(defect)
        }
    }

    #[test]
    fn the_seed_decides_every_bit_and_nothing_else_does() {
        let scene = Scene::with(Defect::InnerRace);
        assert_eq!(scene.record(7, 0.2), scene.record(7, 0.2));
        let other = scene.record(8, 0.2);
        assert_ne!(scene.record(7, 0.2).x, other.x);
        assert_eq!(scene.record(7, 0.2).tacho, other.tacho, "the tacho has no chance in it");
        let recording = scene.record(7, 0.2);
        assert_ne!(recording.x, recording.y);
    }

    #[test]
    fn the_orders_are_those_of_the_machine_file() {
        let machine = rotorwatch::machine::file::parse(super::files::MACHINE, "demo.toml");
        let orders = machine.unwrap().bearings[0].fault_orders().unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12; // a few roundings of numbers near 5
        assert!(close(orders.bpfi, ORDERS.bpfi) && close(orders.bpfo, ORDERS.bpfo), "{orders:?}");
        assert!(close(orders.bsf, ORDERS.bsf) && close(orders.ftf, ORDERS.ftf), "{orders:?}");
    }

    #[test]
    fn strikes_come_at_the_rate_of_the_defect() {
        for (defect, rate_hz) in [
            (Defect::InnerRace, 135.38),
            (Defect::OuterRace, 89.62),
            (Defect::RollingElement, 117.84),
        ] {
            let scene = bare(defect);
            assert!((scene.strike_rate().unwrap().0 - rate_hz).abs() < 0.005, "{defect:?}");
            // Preload: no strike falls outside the load zone.
            let scene = Scene { load_zone: 2.0, ..scene };
            let strikes = scene.strikes(&mut stream(1, 0), 10.0);
            let mean_s = (strikes.last().unwrap().0 - strikes[0].0) / (strikes.len() - 1) as f64;
            assert!((mean_s * scene.strike_rate().unwrap().0 - 1.0).abs() < 1e-9, "{defect:?}");
        }
        assert_eq!(Scene::healthy().strike_rate(), None);
    }

    #[test]
    fn an_inner_race_is_loaded_once_a_turn_and_an_outer_race_always() {
        let amplitudes = |defect| -> Vec<(f64, f64)> {
            bare(defect).strikes(&mut stream(1, 0), 4.0).into_iter().collect()
        };
        assert!(amplitudes(Defect::OuterRace).iter().all(|(_, a)| (a - 10.0).abs() < 1e-12));
        for (time_s, amplitude) in amplitudes(Defect::InnerRace) {
            // M2 at ε = ½: cos^1.5 of the angle.
            let expected = 10.0 * (TAU * 25.0 * time_s).cos().powf(1.5);
            assert!((amplitude - expected).abs() < 1e-9 * 10.0, "{time_s}");
        }
    }

    #[test]
    fn a_ring_down_has_the_energy_of_its_closed_form() {
        let scene = bare(Defect::OuterRace);
        let x: Vec<f64> = scene.record(3, 10.0).x.into_iter().map(f64::from).collect();
        let mean_square = x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
        // ∫ e^(−2at) sin²(bt) dt = b²/(4a(a²+b²)), strikes long decayed when the next comes; the sum
        // over samples stands for the integral as the square stays below half the sampling rate.
        let omega = TAU * scene.resonance[0].0;
        let (a, zeta) = (scene.damping_ratio * omega, scene.damping_ratio);
        let expected = 100.0 * (1.0 - zeta * zeta) / (4.0 * a) * scene.strike_rate().unwrap().0;
        // 3 %: overlap of neighbours e^(−a/f) ≈ 1e-5, whole number of strikes 1/900, tail beyond the band.
        assert!((mean_square / expected - 1.0).abs() < 0.03, "{mean_square} {expected}");
    }

    #[test]
    fn a_healthy_bearing_gives_shaft_lines_and_noise() {
        let x = Scene::healthy().record(1, 10.0).x;
        let expected = (1.0 + 0.5 * (0.16 + 0.04 + 0.01_f64)).sqrt();
        // 120,000 samples: standard error of an RMS 1/√(2n) = 0.2 %, three of them.
        let square: f64 = x.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / x.len() as f64;
        assert!((square.sqrt() / expected - 1.0).abs() < 0.006);
    }

    #[test]
    fn slip_jitter_has_the_deviation_stated() {
        let scene = Scene { slip_jitter: 0.01, ..bare(Defect::OuterRace) };
        let times: Vec<f64> =
            scene.strikes(&mut stream(5, 0), 100.0).into_iter().map(|(t, _)| t).collect();
        let rate = scene.strike_rate().unwrap().0;
        let steps: Vec<f64> = times.windows(2).map(|w| (w[1] - w[0]) * rate - 1.0).collect();
        let square = steps.iter().map(|s| s * s).sum::<f64>() / steps.len() as f64;
        // 9,000 steps: standard error 1/√(2n) = 0.75 %, four of them.
        assert!((square.sqrt() / 0.01 - 1.0).abs() < 0.03, "{}", square.sqrt());
    }

    #[test]
    fn the_tacho_rises_through_half_its_height_at_every_turn() {
        let scene = Scene { shaft_speed: Hz(17.3), ..Scene::healthy() };
        let tacho = scene.record(1, 2.0).tacho;
        // Where the straight line between two samples rises through half of 5 V.
        let rising = |(i, pair): (usize, &[f32])| {
            let (below, above) = (f64::from(pair[0]) - 2.5, f64::from(pair[1]) - 2.5);
            (below < 0.0 && above >= 0.0)
                .then(|| (i as f64 - below / (above - below)) / scene.sample_rate.0)
        };
        let times_s: Vec<f64> = tacho.windows(2).enumerate().filter_map(rising).collect();
        assert_eq!(times_s.len(), 34);
        for (turn, time_s) in (1_u8..).zip(times_s) {
            // Linear ramps of f32: interpolation is exact to the rounding of 5 V over the slope.
            assert!((time_s - f64::from(turn) / 17.3).abs() < 1e-8, "{turn} {time_s}");
        }
    }

    #[test]
    fn lengths_are_bounded_whatever_is_asked() {
        let scene = Scene::healthy();
        assert_eq!(scene.n_samples(f64::NAN), 0);
        assert_eq!(scene.n_samples(-1.0), 0);
        assert_eq!(scene.n_samples(f64::INFINITY), 100_000_000);
        assert_eq!(scene.record(1, 0.0).x.len(), 0);
    }
}
