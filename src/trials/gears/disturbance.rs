//! What a sound pair may also be heard beside, and its baseline lacks (T10): nothing of it is a tooth's.
//!
//! A knock a turn of either shaft is not among it: that is taken for a tooth.

use super::N_SAMPLES;
use super::Pair;
use super::RATE_HZ;
use crate::trials::motion::Motion;
use crate::trials::motion::Turn;
use crate::trials::vibration;
use crate::trials::vibration::Path;
use crate::trials::vibration::Strikes;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// What is new beside the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// White noise.
    White,
    /// Noise of equal power an octave.
    Pink,
    /// Strikes at random times.
    RandomStrikes,
    /// Eight harmonics of the mains.
    Hum,
    /// Twelve tones at any orders.
    Tones,
    /// Nothing is heard: the speed wanders.
    Wander,
    /// A machine beside it: another speed, knocks and a bearing's defect of its own.
    Neighbour,
    /// A defect of a bearing on one of the shafts, at the race at rest.
    Bearing,
}

/// Standard deviation of the speed that wanders, relative, drawn evenly in the logarithm; and of that of the machine beside it.
const WANDER: (f64, f64) = (2e-4, 3e-3);
const OWN_WANDER: f64 = 1e-3;

/// RMS over that of the mesh, drawn evenly in the logarithm. The whole record stays below twice its baseline, which is a warning by itself.
const GAINS: (f64, f64) = (0.15, 1.5);

/// Rates this near to a whole multiple of a shaft's, in turns of it, are no other machine's.
const FROM_A_MULTIPLE: f64 = 0.04;

impl Disturbance {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::White,
        Self::Pink,
        Self::RandomStrikes,
        Self::Hum,
        Self::Tones,
        Self::Wander,
        Self::Neighbour,
        Self::Bearing,
    ];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "healthy: white noise",
            Self::Pink => "healthy: pink noise",
            Self::RandomStrikes => "healthy: random strikes",
            Self::Hum => "healthy: mains hum",
            Self::Tones => "healthy: tones",
            Self::Wander => "healthy: speed wanders",
            Self::Neighbour => "healthy: machine beside it",
            Self::Bearing => "healthy: defect of a bearing",
        }
    }

    /// How the pair's speed wanders, if otherwise than in the baseline.
    pub(super) fn wander(self, random: &mut Pcg64Mcg) -> Option<f64> {
        (self == Self::Wander).then(|| even_in_log(WANDER, random))
    }

    /// Adds what is heard to a record in which the mesh has unit RMS.
    pub(super) fn add(self, x: &mut [f64], pair: &Pair, turn: &Turn, random: &mut Pcg64Mcg) {
        let gain = even_in_log(GAINS, random);
        let sound = match self {
            Self::Wander => return,
            Self::White => (0..N_SAMPLES).map(|_| vibration::normal(random)).collect(),
            Self::Pink => vibration::pink(N_SAMPLES, RATE_HZ, random),
            Self::RandomStrikes => random_strikes(random),
            Self::Hum => hum(random),
            Self::Tones => tones(pair, turn, random),
            Self::Neighbour => neighbour(pair, random),
            Self::Bearing => bearing(pair, turn, random),
        };
        vibration::add_scaled(x, &sound, gain);
    }
}

fn even_in_log((low, high): (f64, f64), random: &mut Pcg64Mcg) -> f64 {
    low * (high / low).powf(random.random_range(0.0..1.0))
}

/// Five to sixty a second in the mean, of waits that are exponential but for parts of a sample.
fn random_strikes(random: &mut Pcg64Mcg) -> Vec<f64> {
    let chance = random.random_range(5.0..60.0) / RATE_HZ;
    let strike = |_| {
        let is_struck = random.random_bool(chance);
        if is_struck { 1.0 + 0.3 * vibration::normal(random) } else { 0.0 }
    };
    let strikes: Vec<f64> = (0..N_SAMPLES).map(strike).collect();
    Path::draw(random).hear(&strikes)
}

fn hum(random: &mut Pcg64Mcg) -> Vec<f64> {
    let mains_hz = if random.random_bool(0.5) { 50.0 } else { 60.0 };
    let mut sound = vec![0.0; N_SAMPLES];
    for harmonic in (1..=8).map(f64::from) {
        let (amplitude, phase) =
            (random.random_range(0.0..1.0) / harmonic, random.random_range(0.0..TAU));
        vibration::add_tone(&mut sound, RATE_HZ, mains_hz * harmonic, amplitude, phase);
    }
    sound
}

/// At orders of the driving shaft up to its third mesh harmonic.
fn tones(pair: &Pair, turn: &Turn, random: &mut Pcg64Mcg) -> Vec<f64> {
    let mut sound = vec![0.0; N_SAMPLES];
    for _ in 0..12 {
        let order = random.random_range(0.3..3.0 * f64::from(pair.teeth[0]));
        let (amplitude, phase) = (random.random_range(0.1..1.0), random.random_range(0.0..TAU));
        vibration::add_order(&mut sound, turn, RATE_HZ, order, amplitude, phase);
    }
    sound
}

/// Two trains of strikes of a machine whose speed is its own.
fn neighbour(pair: &Pair, random: &mut Pcg64Mcg) -> Vec<f64> {
    let duration_s = N_SAMPLES as f64 / RATE_HZ;
    // Turns of either shaft of the pair between two of its knocks, and between two of its bearing's.
    let is_foreign = |speed_hz: f64| {
        pair.turns(pair.speed_hz).iter().all(|own_hz| {
            let orders = speed_hz / own_hz;
            orders < 1.0 - FROM_A_MULTIPLE || (orders - orders.round()).abs() > FROM_A_MULTIPLE
        })
    };
    let (speed_hz, order) = loop {
        let speed_hz = pair.speed_hz * random.random_range(0.3..2.5);
        let order = random.random_range(2.3..7.7);
        if is_foreign(speed_hz) && is_foreign(order * speed_hz) {
            break (speed_hz, order);
        }
    };
    let turn = Turn::draw(Motion::Wander(OWN_WANDER), speed_hz, duration_s, random);
    let mut sound = vec![0.0; N_SAMPLES];
    for (strikes, gain) in [(knocks(1.0), 0.7), (rolling(order), 1.0)] {
        let strikes = strikes.make(&turn, N_SAMPLES, RATE_HZ, random);
        vibration::add_scaled(&mut sound, &Path::draw(random).hear(&strikes), gain);
    }
    sound
}

/// Of the race at rest, with slip, at an order that is no whole number of its shaft's.
fn bearing(pair: &Pair, turn: &Turn, random: &mut Pcg64Mcg) -> Vec<f64> {
    let order: f64 = loop {
        let order: f64 = random.random_range(2.3..7.7);
        if (order - order.round()).abs() > FROM_A_MULTIPLE {
            break order;
        }
    };
    let of_driving = order * pair.turns(1.0)[usize::from(random.random_bool(0.5))];
    let strikes = rolling(of_driving).make(turn, N_SAMPLES, RATE_HZ, random);
    Path::draw(random).hear(&strikes)
}

fn knocks(order: f64) -> Strikes {
    Strikes { order, jitter: 0.0, drift: 0.0, scatter: 0.2, modulation: (1.0, 0.0) }
}

/// Strikes of rolling elements: their distances scatter, and what one is off by adds up.
fn rolling(order: f64) -> Strikes {
    Strikes { jitter: 0.01, drift: 0.005, ..knocks(order) }
}
