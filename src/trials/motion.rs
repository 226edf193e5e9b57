//! How a shaft turns: speeds over time and the angle in closed form (T1).

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Kinds of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// One speed.
    Steady,
    /// A slow random wander of this standard deviation, relative, between 0.05 and 0.5 Hz.
    Wander(f64),
    /// A swing of ± this part, once in so many seconds.
    Swing(f64, f64),
    /// From the speed times the first to the speed times the second, evenly.
    Ramp(f64, f64),
}

/// Period of a swing over many revolutions, s.
pub const SLOW_SWING_S: f64 = 5.0;

/// Sines of a wander.
const N_SINES: u32 = 8;

/// Slowest and fastest sine of a wander, Hz.
const WANDER_HZ: (f64, f64) = (0.05, 0.5);

/// A motion with its numbers drawn: speed f·(1 + r·t + Σ a·cos(2πνt + φ)).
#[derive(Debug, Clone)]
pub struct Turn {
    speed_hz: f64,
    rate_per_s: f64,
    /// Amplitude, frequency, phase.
    sines: Vec<(f64, f64, f64)>,
}

impl Turn {
    /// Draws a motion about `speed_hz` over `duration_s`.
    #[must_use]
    pub fn draw(motion: Motion, speed_hz: f64, duration_s: f64, random: &mut Pcg64Mcg) -> Self {
        let phase = |random: &mut Pcg64Mcg| random.random_range(0.0..TAU);
        let still = Self { speed_hz, rate_per_s: 0.0, sines: Vec::new() };
        match motion {
            Motion::Steady => still,
            Motion::Wander(deviation) => {
                let amplitude = deviation * (2.0 / f64::from(N_SINES)).sqrt();
                let sine = |_| {
                    let frequency_hz = random.random_range(WANDER_HZ.0..WANDER_HZ.1);
                    (amplitude, frequency_hz, phase(random))
                };
                Self { sines: (0..N_SINES).map(sine).collect(), ..still }
            }
            Motion::Swing(depth, period_s) => {
                Self { sines: vec![(depth, 1.0 / period_s, phase(random))], ..still }
            }
            Motion::Ramp(from, to) => Self {
                speed_hz: from * speed_hz,
                rate_per_s: (to / from - 1.0) / duration_s,
                ..still
            },
        }
    }

    /// Revolutions turned at `t_s`; 0 at 0.
    #[must_use]
    pub fn revolutions(&self, t_s: f64) -> f64 {
        let swung = self.sines.iter().map(|(a, frequency_hz, phase)| {
            let omega = TAU * frequency_hz;
            a * ((omega * t_s + phase).sin() - phase.sin()) / omega
        });
        self.speed_hz * (t_s + 0.5 * self.rate_per_s * t_s * t_s + swung.sum::<f64>())
    }

    /// Speed at `t_s`, Hz.
    #[must_use]
    pub fn speed_hz(&self, t_s: f64) -> f64 {
        let swing = |(a, nu, phase): &(f64, f64, f64)| a * (TAU * nu * t_s + phase).cos();
        let swings: f64 = self.sines.iter().map(swing).sum();
        self.speed_hz * (1.0 + self.rate_per_s * t_s + swings)
    }

    /// The time at which `revolutions` are turned, from a guess: Newton's steps, the speed never being 0.
    #[must_use]
    pub fn time_s(&self, revolutions: f64, guess_s: f64) -> f64 {
        (0..8).fold(guess_s, |t, _| t - (self.revolutions(t) - revolutions) / self.speed_hz(t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn the_angle_is_the_integral_of_the_speed_and_its_inverse_is_exact() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for motion in
            [Motion::Steady, Motion::Wander(0.003), Motion::Swing(0.2, 5.0), Motion::Ramp(0.5, 1.2)]
        {
            let turn = Turn::draw(motion, 30.0, 10.0, &mut random);
            let (mut turned, step) = (0.0, 1e-4);
            for i in 0..100_000 {
                turned += step * turn.speed_hz((f64::from(i) + 0.5) * step);
            }
            // The midpoint rule of motions this slow: far below the rounding of 1e5 additions.
            assert!((turned - turn.revolutions(10.0)).abs() < 1e-7, "{motion:?}");
            let t = turn.time_s(turn.revolutions(7.3), 7.0);
            assert!((t - 7.3).abs() < 1e-10, "{motion:?}");
        }
    }
}
