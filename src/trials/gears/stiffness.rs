//! An oscillator on a mesh stiffness that changes as tooth pairs come and go; a cracked tooth is softer (T6).
//!
//! One degree of freedom along the line of action: x″ + 2ζωx′ + ω²κ(t)(x − e) = ω²F. Integrated here, with
//! nothing of the simulator.

use super::Kind;
use super::Occasion;
use super::Pair;
use super::RATE_HZ;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Steps a sample: the natural frequency has 19 of them a period at least.
const STEPS: u32 = 4;

/// Part of a pitch over which a pair takes up its load.
const EDGE: f64 = 0.12;

/// Errors of the teeth, standard deviation as part of the static deflection.
const ERRORS: f64 = 0.05;

/// Time that the motion has to forget its start, s.
const SETTLING_S: f64 = 0.1;

/// A drawn mesh.
#[derive(Debug, Clone)]
pub(super) struct Voice {
    natural_hz: f64,
    damping: f64,
    contact_ratio: f64,
    /// Part of a pair's stiffness that a cracked tooth loses.
    loss: f64,
}

impl Voice {
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        Self {
            natural_hz: random.random_range(800.0..2500.0),
            damping: random.random_range(0.04..0.1),
            contact_ratio: random.random_range(1.3..1.8),
            loss: random.random_range(0.15..0.5),
        }
    }

    /// Acceleration along the line of action, static deflections a second squared.
    pub(super) fn mesh(&self, pair: &Pair, occasion: &Occasion) -> Vec<f64> {
        let mut run = Run { voice: self, pair, occasion, x: 1.0, v: 0.0, t_s: -SETTLING_S };
        let n_before = crate::dsp::real::floor_index(SETTLING_S * RATE_HZ);
        for _ in 0..n_before {
            run.sample();
        }
        (0..super::N_SAMPLES).map(|_| run.sample()).collect()
    }

    /// Stiffness over its mean, and the error of the teeth in contact.
    fn stiffness(&self, pair: &Pair, kind: Kind, turned: f64) -> (f64, f64) {
        let place = (turned - pair.tooth_1_at[0]) * f64::from(pair.teeth[0]);
        let nearest = place.round();
        let (mut stiffness, mut error, mut weights) = (0.0, 0.0, 0.0);
        for step in [-1.0, 0.0, 1.0] {
            let contact = nearest + step;
            let weight = self.share(place - contact);
            if weight <= 0.0 {
                continue;
            }
            // The same contact counted on each wheel.
            let offset = pair.tooth_1_at[0] * f64::from(pair.teeth[0])
                - pair.tooth_1_at[1] * f64::from(pair.teeth[1]);
            let counts = [contact, contact + offset.round()];
            let mut own = weight;
            for (gear, (count, errors)) in counts.iter().zip(&pair.errors).enumerate() {
                let tooth = crate::dsp::real::floor_index(count.rem_euclid(errors.len() as f64));
                let tooth = tooth % errors.len();
                error += weight * errors[tooth];
                let is_damaged = pair.damaged.0 == gear && pair.damaged.1 as usize == tooth;
                if kind == Kind::Cracked && is_damaged {
                    own *= 1.0 - self.loss;
                }
            }
            stiffness += own;
            weights += weight;
        }
        (stiffness / self.contact_ratio, ERRORS * error / weights)
    }

    /// How far a pair has taken up its load that is `pitches` away from the pitch point.
    fn share(&self, pitches: f64) -> f64 {
        let inside = 0.5 * self.contact_ratio - pitches.abs();
        let part = (inside / EDGE + 0.5).clamp(0.0, 1.0);
        part * part * (3.0 - 2.0 * part)
    }
}

/// The motion while it is followed.
struct Run<'a> {
    voice: &'a Voice,
    pair: &'a Pair,
    occasion: &'a Occasion,
    x: f64,
    v: f64,
    t_s: f64,
}

impl Run<'_> {
    /// Mean acceleration over a sample.
    fn sample(&mut self) -> f64 {
        let before = self.v;
        for _ in 0..STEPS {
            self.step(1.0 / (RATE_HZ * f64::from(STEPS)));
        }
        (self.v - before) * RATE_HZ
    }

    /// Stiffness, error of the teeth and load.
    fn drive(&self, t_s: f64) -> (f64, f64, f64) {
        let turned = self.occasion.turn.revolutions(t_s);
        let (stiffness, error) = self.voice.stiffness(self.pair, self.occasion.kind, turned);
        let depth = super::swing_depth(self.occasion.kind);
        (stiffness, error, self.occasion.load * self.pair.swing(turned, depth))
    }

    /// A step of Runge and Kutta's classical way.
    fn step(&mut self, h: f64) {
        let omega = TAU * self.voice.natural_hz;
        let damping = 2.0 * self.voice.damping * omega;
        let acceleration = |(k, e, f): (f64, f64, f64), x: f64, v: f64| {
            omega * omega * (f - k * (x - e)) - damping * v
        };
        let start = self.drive(self.t_s);
        let middle = self.drive(self.t_s + 0.5 * h);
        let end = self.drive(self.t_s + h);
        let (x, v) = (self.x, self.v);
        let a1 = acceleration(start, x, v);
        let (x2, v2) = (x + 0.5 * h * v, v + 0.5 * h * a1);
        let a2 = acceleration(middle, x2, v2);
        let (x3, v3) = (x + 0.5 * h * v2, v + 0.5 * h * a2);
        let a3 = acceleration(middle, x3, v3);
        let (x4, v4) = (x + h * v3, v + h * a3);
        let a4 = acceleration(end, x4, v4);
        self.x += h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
        self.v += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
        self.t_s += h;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::line;
    use crate::trials::motion::Motion;
    use crate::trials::motion::Turn;
    use rand::SeedableRng;

    #[test]
    fn with_one_pair_at_a_time_it_is_the_linear_oscillator() {
        // At a contact ratio of 1 the shares of two pairs add up to 1: the stiffness is constant.
        let voice = Voice { natural_hz: 900.0, damping: 0.05, contact_ratio: 1.0, loss: 0.5 };
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut pair = Pair::draw(&mut random);
        pair.errors = pair.teeth.map(|z| vec![0.0; z as usize]);
        pair.speed_hz = 200.0;
        let turn = Turn::draw(Motion::Steady, pair.speed_hz, 10.0, &mut random);
        let occasion = Occasion { kind: Kind::Eccentric, load: 1.0, turn };
        for turned in [0.0, 0.123, 3.4] {
            let (stiffness, error) = voice.stiffness(&pair, Kind::Healthy, turned);
            assert!((stiffness - 1.0).abs() < 1e-12 && error.abs() < 1e-12);
        }
        let x = voice.mesh(&pair, &occasion);
        let found = line::line_at(&x, RATE_HZ, 200.0).unwrap().amplitude;
        // The load swings by 0.2 at 200 Hz: x = 0.2/√((1 − r²)² + (2ζr)²), acceleration Ω²x; mean over a sample: sinc.
        let (r, omega) = (200.0 / 900.0_f64, TAU * 200.0);
        let x = 0.2 / ((1.0 - r * r).powi(2) + (0.1 * r).powi(2)).sqrt();
        let half = 0.5 * omega / RATE_HZ;
        let exact = omega * omega * x * half.sin() / half;
        // The other shaft's line is many cells away; Runge and Kutta's error at 53 steps a period is 1e-6.
        assert!((found / exact - 1.0).abs() < 1e-4, "{found} {exact}");
    }
}
