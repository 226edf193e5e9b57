//! What a drawn machine sounds like beside a defect: its shaft, its noise, and what disturbs (T9).

use super::levels;
use super::log_normal;
use super::log_uniform;
use super::path;
use super::plant::Plant;
use crate::machine::bearing::Bearing;
use crate::trials::vibration;
use crate::trials::vibration::Strikes;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// What may disturb.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Disturbance {
    /// Hum at eight harmonics of the mains.
    Mains,
    /// A mesh that the machine file does not list, modulated by both its shafts.
    Mesh,
    /// A joint of a belt: strikes slower than the shaft.
    Belt,
    /// Knocks each turn, each other, or twice a turn.
    Knock,
    /// Strikes at random times.
    RandomStrikes,
    /// A defect of a bearing that the machine file does not list.
    UnknownBearing,
    /// Tones of a converter.
    Converter,
    /// Noise that vanes modulate.
    Vanes,
    /// Noise that rolling elements of a sound bearing modulate a little.
    Compliance,
    /// Knocks of a shaft that the machine file does not list.
    OtherShaft,
    /// Blades that strike unevenly.
    Blades,
    /// Noise modulated at twice the mains.
    HumModulation,
    /// Noise modulated a little at an order of nothing.
    StrangeModulation,
    /// A part of the record that is louder.
    Burst,
}

/// How often each is there in a machine with a defect; in a sound one [`MORE_IN_SOUND`] times as often.
const CHANCES: [(Disturbance, f64); 14] = [
    (Disturbance::Mains, 0.5),
    (Disturbance::Mesh, 0.25),
    (Disturbance::Belt, 0.15),
    (Disturbance::Knock, 0.15),
    (Disturbance::RandomStrikes, 0.15),
    (Disturbance::UnknownBearing, 0.2),
    (Disturbance::Converter, 0.2),
    (Disturbance::Vanes, 0.25),
    (Disturbance::Compliance, 0.15),
    (Disturbance::OtherShaft, 0.12),
    (Disturbance::Blades, 0.12),
    (Disturbance::HumModulation, 0.15),
    (Disturbance::StrangeModulation, 0.1),
    (Disturbance::Burst, 0.1),
];
const MORE_IN_SOUND: f64 = 1.6;

/// A source, and how loud each sensor hears it over the noise.
#[derive(Debug, Clone)]
struct Voice {
    source: Source,
    levels: Vec<f64>,
}

#[derive(Debug, Clone)]
enum Source {
    /// Strikes that each sensor hears through a path of its own.
    Struck(Vec<f64>),
    /// A sound as it is heard, in units of the noise's RMS.
    Heard(Vec<f64>),
}

/// All that a machine sounds like.
#[derive(Debug, Clone)]
pub struct Sounds {
    rate_hz: f64,
    n_sensors: usize,
    voices: Vec<Voice>,
    /// Factor of the noise, sample by sample.
    modulation: Vec<f64>,
    names: Vec<String>,
}

/// What strikes, and how.
struct Struck {
    name: &'static str,
    /// Of the places and of the strengths (as [`Strikes`] has them).
    jitter: f64,
    scatter: f64,
    /// Mean and deviation of the logarithm of how loud.
    loudness: (f64, f64),
}

const BELT: Struck = Struck { name: "belt", jitter: 0.003, scatter: 0.2, loudness: (-0.7, 0.5) };
const KNOCK: Struck = Struck { name: "knock", jitter: 0.0, scatter: 0.3, loudness: (-0.3, 0.5) };
const AT_RANDOM: Struck =
    Struck { name: "random strikes", jitter: 20.0, scatter: 0.4, loudness: (-0.3, 0.6) };
const UNKNOWN: Struck =
    Struck { name: "unknown", jitter: 0.01, scatter: 0.2, loudness: (-0.7, 0.5) };
const OTHER_SHAFT: Struck =
    Struck { name: "other shaft", jitter: 0.001, scatter: 0.2, loudness: (-0.3, 0.5) };

impl Sounds {
    /// Noise alone.
    pub(super) fn silent(plant: &Plant) -> Self {
        Self {
            rate_hz: plant.rate.0,
            n_sensors: plant.n_sensors,
            voices: Vec::new(),
            modulation: vec![1.0; plant.turned.len()],
            names: Vec::new(),
        }
    }

    /// Draws what the machine sounds like without a defect.
    #[must_use]
    pub fn draw(plant: &Plant, is_sound: bool, random: &mut Pcg64Mcg) -> Self {
        let mut sounds = Self::silent(plant);
        let mut shaft = vec![0.0; plant.turned.len()];
        let loudness = log_normal(0.0, 0.7, random);
        for harmonic in 1..=10 {
            let most = loudness * 10.0_f64.powf(-0.1 * f64::from(harmonic - 1));
            let amplitude = random.random_range(0.0..most);
            add_order(&mut shaft, plant, f64::from(harmonic), amplitude, random);
        }
        sounds.hear(shaft, 1.0, random);
        let more = if is_sound { MORE_IN_SOUND } else { 1.0 };
        for (disturbance, chance) in CHANCES {
            if random.random_bool((chance * more).min(1.0)) {
                sounds.disturb(disturbance, plant, random);
            }
        }
        sounds
    }

    /// What disturbs, for the name of a trial.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Adds strikes whose ringing the first sensor hears so many times as loud as the noise.
    pub fn strike(&mut self, strikes: Vec<f64>, level: f64, random: &mut Pcg64Mcg) {
        let levels = levels(self.n_sensors, level, random);
        self.voices.push(Voice { source: Source::Struck(strikes), levels });
    }

    fn hear(&mut self, sound: Vec<f64>, level: f64, random: &mut Pcg64Mcg) {
        let levels = levels(self.n_sensors, level, random);
        self.voices.push(Voice { source: Source::Heard(sound), levels });
    }

    /// Vibration at a sensor, in units of its noise's RMS.
    #[must_use]
    pub fn at(&self, plant: &Plant, sensor: usize, random: &mut Pcg64Mcg) -> Vec<f64> {
        let mut x = self.noise(plant, random);
        x.iter_mut().zip(&self.modulation).for_each(|(x, factor)| *x *= factor);
        for voice in &self.voices {
            let Some(&level) = voice.levels.get(sensor) else { continue };
            match &voice.source {
                Source::Struck(strikes) => {
                    let heard = path(self.rate_hz, random).hear(strikes);
                    vibration::add_scaled(&mut x, &heard, level);
                }
                Source::Heard(sound) => {
                    x.iter_mut().zip(sound).for_each(|(x, sound)| *x += level * sound);
                }
            }
        }
        x
    }

    /// White noise, pink noise and noise through a path in drawn parts, of unit RMS together.
    fn noise(&self, plant: &Plant, random: &mut Pcg64Mcg) -> Vec<f64> {
        let n = plant.turned.len();
        let white = |random: &mut Pcg64Mcg| (0..n).map(|_| vibration::normal(random)).collect();
        let mut x = vec![0.0; n];
        let first: Vec<f64> = white(random);
        vibration::add_scaled(&mut x, &first, random.random_range(0.2..1.0));
        let pink = vibration::pink(n, self.rate_hz, random);
        vibration::add_scaled(&mut x, &pink, random.random_range(0.2..1.0));
        let second: Vec<f64> = white(random);
        let heard = path(self.rate_hz, random).hear(&second);
        vibration::add_scaled(&mut x, &heard, random.random_range(0.0..1.0));
        let mut scaled = vec![0.0; n];
        vibration::add_scaled(&mut scaled, &x, 1.0);
        scaled
    }

    /// Adds a disturbance of drawn strength (T9).
    fn disturb(&mut self, disturbance: Disturbance, plant: &Plant, random: &mut Pcg64Mcg) {
        match disturbance {
            Disturbance::Mains => self.mains(plant, random),
            Disturbance::Mesh => self.mesh(plant, random),
            Disturbance::Belt => {
                let order = random.random_range(0.25..0.9);
                self.strikes(&BELT, order, plant, random);
            }
            Disturbance::Knock => {
                let order = [1.0, 1.0, 0.5, 2.0][random.random_range(0..4_usize)];
                self.strikes(&KNOCK, order, plant, random);
            }
            // Places drawn anew each by many times their distance: a Poisson train.
            Disturbance::RandomStrikes => {
                let order = log_uniform((0.37, 7.4), random);
                self.strikes(&AT_RANDOM, order, plant, random);
            }
            Disturbance::UnknownBearing => {
                if let Some(order) = unknown_order(plant, random) {
                    self.strikes(&UNKNOWN, order, plant, random);
                }
            }
            Disturbance::Converter => self.converter(plant, random),
            Disturbance::Vanes => {
                let vanes = f64::from(random.random_range(1..=7_u32));
                let depth = random.random_range(0.1..0.9);
                self.modulate("vanes", vanes, depth, plant, random);
            }
            Disturbance::Compliance => {
                let Some(orders) = plant.fault_orders() else { return };
                let order = if random.random_bool(0.5) { orders.bpfo } else { orders.bpfi };
                let slipped = order * (1.0 + random.random_range(super::SLIP.0..super::SLIP.1));
                let depth = random.random_range(0.03..0.2);
                self.modulate("compliance", slipped, depth, plant, random);
            }
            Disturbance::OtherShaft => {
                let slower = random.random_bool(0.5);
                let orders = if slower { (0.15, 0.95) } else { (1.05, 4.0) };
                let order = random.random_range(orders.0..orders.1);
                self.strikes(&OTHER_SHAFT, order, plant, random);
            }
            Disturbance::Blades => self.blades(plant, random),
            Disturbance::HumModulation => self.hum_modulation(plant, random),
            Disturbance::StrangeModulation => {
                let order = random.random_range(0.2..9.0);
                let depth = random.random_range(0.1..0.25);
                self.modulate("modulation", order, depth, plant, random);
            }
            Disturbance::Burst => self.burst(random),
        }
    }

    /// Strikes at an order.
    fn strikes(&mut self, of: &Struck, order: f64, plant: &Plant, random: &mut Pcg64Mcg) {
        let Struck { name, jitter, scatter, loudness: (mean, deviation) } = *of;
        let strikes = Strikes { order, jitter, drift: 0.0, scatter, modulation: (1.0, 0.0) };
        let struck = strikes.make(&plant.turn, plant.turned.len(), self.rate_hz, random);
        self.names.push(format!("{name} {order:.3}"));
        self.strike(struck, log_normal(mean, deviation, random), random);
    }

    fn modulate(
        &mut self,
        name: &str,
        order: f64,
        depth: f64,
        plant: &Plant,
        random: &mut Pcg64Mcg,
    ) {
        let phase = random.random_range(0.0..TAU);
        for (factor, turned) in self.modulation.iter_mut().zip(&plant.turned) {
            *factor *= 1.0 + depth * (TAU * order * turned + phase).cos();
        }
        self.names.push(format!("{name} {order:.3} by {depth:.2}"));
    }

    fn mains(&mut self, plant: &Plant, random: &mut Pcg64Mcg) {
        let Some(line_hz) = plant.line_hz else { return };
        let mut hum = vec![0.0; plant.turned.len()];
        for harmonic in 1..=8 {
            let harmonic = f64::from(harmonic);
            let amplitude = random.random_range(0.0..1.0) / harmonic;
            let phase = random.random_range(0.0..TAU);
            vibration::add_tone(&mut hum, self.rate_hz, harmonic * line_hz, amplitude, phase);
        }
        self.names.push("mains".to_owned());
        let level = log_normal(-0.5, 0.7, random);
        self.hear(hum, level, random);
    }

    fn converter(&mut self, plant: &Plant, random: &mut Pcg64Mcg) {
        let Some(line_hz) = plant.line_hz else { return };
        let carrier_hz = random.random_range(0.15..0.45) * self.rate_hz;
        let mut tones = vec![0.0; plant.turned.len()];
        for k in [-4.0, -2.0, 0.0, 2.0, 4.0] {
            let amplitude = random.random_range(0.0..1.0);
            let phase = random.random_range(0.0..TAU);
            let frequency_hz = carrier_hz + k * line_hz;
            vibration::add_tone(&mut tones, self.rate_hz, frequency_hz, amplitude, phase);
        }
        self.names.push("converter".to_owned());
        let level = log_normal(-0.7, 0.6, random);
        self.hear(tones, level, random);
    }

    fn mesh(&mut self, plant: &Plant, random: &mut Pcg64Mcg) {
        let teeth = f64::from(random.random_range(15..60_u32));
        let ratio = random.random_range(0.2..0.9);
        let mut mesh = vec![0.0; plant.turned.len()];
        for harmonic in 1..=3 {
            let order = f64::from(harmonic) * teeth;
            let mut draw = |most: f64| random.random_range(0.0..most);
            let (amplitude, phase) = (draw(1.0), draw(TAU));
            let (by_first, by_second) = (draw(0.3), draw(0.3));
            if order * plant.mean_speed().0 >= 0.4 * self.rate_hz {
                continue;
            }
            for (value, turned) in mesh.iter_mut().zip(&plant.turned) {
                let first = by_first * (TAU * turned).cos();
                let second = by_second * (TAU * ratio * turned + 1.0).cos();
                *value += amplitude * (1.0 + first + second) * (TAU * order * turned + phase).cos();
            }
        }
        self.names.push(format!("mesh of {teeth}, other shaft {ratio:.3}"));
        let level = log_normal(-0.3, 0.7, random);
        self.hear(mesh, level, random);
    }

    fn blades(&mut self, plant: &Plant, random: &mut Pcg64Mcg) {
        let n_blades = random.random_range(3..=8_u32);
        let mut struck = vec![0.0; plant.turned.len()];
        for _ in 0..n_blades {
            let strength = log_normal(0.0, 0.3, random);
            let strikes = Strikes {
                order: 1.0,
                jitter: 0.002,
                drift: 0.0,
                scatter: 0.1,
                modulation: (1.0, 0.0),
            };
            let one = strikes.make(&plant.turn, struck.len(), self.rate_hz, random);
            struck.iter_mut().zip(one).for_each(|(sum, one)| *sum += strength * one);
        }
        self.names.push(format!("blades {n_blades}"));
        let level = log_normal(-0.3, 0.5, random);
        self.strike(struck, level, random);
    }

    fn hum_modulation(&mut self, plant: &Plant, random: &mut Pcg64Mcg) {
        let Some(line_hz) = plant.line_hz else { return };
        let (depth, phase) = (random.random_range(0.1..0.6), random.random_range(0.0..TAU));
        for (i, factor) in self.modulation.iter_mut().enumerate() {
            let t_s = i as f64 / self.rate_hz;
            *factor *= 1.0 + depth * (TAU * 2.0 * line_hz * t_s + phase).cos();
        }
        self.names.push(format!("twice the mains by {depth:.2}"));
    }

    fn burst(&mut self, random: &mut Pcg64Mcg) {
        let n = self.modulation.len() as f64;
        let begin = random.random_range(0.0..0.8) * n;
        let end = begin + random.random_range(0.02..0.2) * n;
        let louder = random.random_range(2.0..6.0);
        for (i, factor) in self.modulation.iter_mut().enumerate() {
            if (begin..end).contains(&(i as f64)) {
                *factor *= louder;
            }
        }
        self.names.push(format!("burst of {louder:.1}"));
    }
}

fn add_order(to: &mut [f64], plant: &Plant, order: f64, amplitude: f64, random: &mut Pcg64Mcg) {
    let phase = random.random_range(0.0..TAU);
    for (value, turned) in to.iter_mut().zip(&plant.turned) {
        *value += amplitude * (TAU * order * turned + phase).cos();
    }
}

/// Draws of an order of strikes before it is given up that lines of the machine lie everywhere.
const TRIES: usize = 1000;

/// A rate none of whose first four harmonics is one of the first three of a line of the machine's bearings.
fn unknown_order(plant: &Plant, random: &mut Pcg64Mcg) -> Option<f64> {
    let orders = plant.machine.bearings.iter().filter_map(Bearing::fault_orders);
    let lines: Vec<f64> = orders.flat_map(|o| [o.bpfo, o.bpfi, o.two_bsf()]).collect();
    let is_known = |order: f64| {
        lines.iter().any(|line| {
            let meets = |m: u32| {
                (1..=4)
                    .any(|k: u32| (f64::from(k) * order / (f64::from(m) * line) - 1.0).abs() < 0.03)
            };
            (1..=3).any(meets)
        })
    };
    (0..TRIES).map(|_| random.random_range(1.5..9.0)).find(|order| !is_known(*order))
}
