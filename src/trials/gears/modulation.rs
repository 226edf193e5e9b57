//! Mesh harmonics that the teeth modulate in amplitude and phase (T5).
//!
//! A tooth that gives way takes load from the mesh and lags while it is in contact (McFadden 1986).

use super::Kind;
use super::Occasion;
use super::Pair;
use super::RATE_HZ;
use crate::trials::vibration;
use crate::trials::vibration::Path;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Mesh harmonics.
const N_HARMONICS: usize = 3;

/// Half of the contact of a tooth, pitches: contact ratio 1.6.
const HALF_CONTACT: f64 = 0.8;

/// A drawn mesh.
#[derive(Debug, Clone)]
pub(super) struct Voice {
    /// Amplitude and phase of each harmonic.
    harmonics: [(f64, f64); N_HARMONICS],
    /// Standard deviation of a tooth's amplitude, relative, and of its phase, rad.
    errors: (f64, f64),
    /// Depth and phase, rad, of the modulation by a damaged tooth.
    damage: (f64, f64),
    /// Orders of ghost tones as shares of the teeth, amplitude, phase.
    ghosts: [(f64, f64, f64); 2],
    /// RMS of strikes, or of ghosts, over that of the mesh.
    strikes: f64,
    /// Growth of the second and third harmonic by wear.
    wear: [f64; 2],
}

impl Voice {
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        let mut harmonic = |most: f64| {
            let amplitude = most * random.random_range(0.4..1.0);
            (amplitude, random.random_range(0.0..TAU))
        };
        let harmonics = [harmonic(1.0), harmonic(0.6), harmonic(0.4)];
        let errors = (random.random_range(0.01..0.04), random.random_range(0.01..0.04));
        let damage = (random.random_range(0.3..0.7), random.random_range(0.2..0.8));
        let ghosts = [0, 1].map(|_| {
            let share = random.random_range(0.6..2.7);
            (share, random.random_range(0.1..0.4), random.random_range(0.0..TAU))
        });
        let strikes = random.random_range(0.2..0.6);
        let wear = [random.random_range(4.0..8.0), random.random_range(4.0..8.0)];
        Self { harmonics, errors, damage, ghosts, strikes, wear }
    }

    pub(super) fn mesh(
        &self,
        pair: &Pair,
        occasion: &Occasion,
        _random: &mut Pcg64Mcg,
    ) -> Vec<f64> {
        let (kind, z) = (occasion.kind, f64::from(pair.teeth[0]));
        let swing = super::swing_depth(kind);
        let gives_way = matches!(kind, Kind::Cracked | Kind::Broken);
        let sample = |i: usize| {
            let turned = occasion.turn.revolutions(i as f64 / RATE_HZ);
            let local = if gives_way { bump(pair.pitches_past_damage(turned)) } else { 0.0 };
            let error = error_at(pair, turned);
            let (depth, lag) = self.damage;
            let amplitude = occasion.load
                * pair.swing(turned, swing)
                * (1.0 + self.errors.0 * error - depth * local);
            let phase = self.errors.1 * error - lag * local;
            let harmonics = (1..).map(f64::from).zip(&self.harmonics).zip(self.growth(kind));
            let sum: f64 = harmonics
                .map(|((h, (a, at)), growth)| {
                    growth * a * (h * (TAU * z * turned + phase) + at).cos()
                })
                .sum();
            amplitude * sum
        };
        (0..super::N_SAMPLES).map(sample).collect()
    }

    fn growth(&self, kind: Kind) -> [f64; N_HARMONICS] {
        if kind == Kind::Worn { [1.2, self.wear[0], self.wear[1]] } else { [1.0; N_HARMONICS] }
    }

    fn ghost(&self, pair: &Pair, turned: f64) -> f64 {
        let turns = pair.turns(turned);
        let tones = self.ghosts.iter().zip(turns).zip(pair.teeth).zip(&pair.run_out);
        tones
            .map(|((((share, amplitude, phase), turn), teeth), run_out)| {
                let order = (share * f64::from(teeth)).round();
                // A mesh order is no ghost.
                let order =
                    if order.rem_euclid(f64::from(teeth)) < 0.5 { order + 3.0 } else { order };
                let swing = 1.0 + 0.2 * (TAU * (turn - run_out)).cos();
                swing * amplitude * (TAU * order * turn + phase).cos()
            })
            .sum()
    }

    /// What is not the mesh: ghosts; a broken tooth's successor, which strikes; pits, which strike a little, each time
    /// another.
    pub(super) fn add_strikes(
        &self,
        x: &mut [f64],
        pair: &Pair,
        occasion: &Occasion,
        path: &Path,
        random: &mut Pcg64Mcg,
    ) {
        if occasion.kind == Kind::Ghost {
            let turned = |i: usize| occasion.turn.revolutions(i as f64 / RATE_HZ);
            let ghosts: Vec<f64> = (0..x.len()).map(|i| self.ghost(pair, turned(i))).collect();
            vibration::add_scaled(x, &path.hear(&ghosts), self.strikes);
            return;
        }
        let (n_teeth, scatter) = match occasion.kind {
            Kind::Broken => (1, 0.1),
            Kind::Pitted => (3, 0.4),
            Kind::Healthy
            | Kind::Eccentric
            | Kind::Ghost
            | Kind::Cracked
            | Kind::Worn
            | Kind::Disturbed(_) => return,
        };
        let mut strikes = vec![0.0; x.len()];
        let mut before = pair.pitches_past_damage(0.0);
        for (i, strike) in strikes.iter_mut().enumerate() {
            let past = pair.pitches_past_damage(occasion.turn.revolutions(i as f64 / RATE_HZ));
            for tooth in 0..n_teeth {
                let at = f64::from(tooth) - 0.5 * f64::from(n_teeth - 1);
                if before < at && past >= at && past - before < 1.0 {
                    *strike += 1.0 + scatter * vibration::normal(random);
                }
            }
            before = past;
        }
        vibration::add_scaled(x, &path.hear(&strikes), self.strikes);
    }
}

/// How much of the contact the tooth has that is `pitches` away: 1 at the pitch point, 0 outside.
fn bump(pitches: f64) -> f64 {
    if pitches.abs() >= HALF_CONTACT {
        return 0.0;
    }
    0.5 + 0.5 * (std::f64::consts::PI * pitches / HALF_CONTACT).cos()
}

/// Error of the teeth in contact: that of the pair at the pitch point, linear to the next.
fn error_at(pair: &Pair, turned: f64) -> f64 {
    let turns = pair.turns(turned);
    let gears = turns.iter().zip(&pair.errors).zip(&pair.tooth_1_at);
    gears
        .map(|((turn, errors), first)| {
            let n = errors.len();
            let place = ((turn - first) * n as f64).rem_euclid(n as f64);
            let below = crate::dsp::real::floor_index(place);
            let part = place - below as f64;
            errors[below % n] * (1.0 - part) + errors[(below + 1) % n] * part
        })
        .sum()
}
