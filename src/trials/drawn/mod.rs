//! Machines drawn at random (T8, T9): the trials whose every number differs.
//!
//! Sampling rate, length, speed and how it is told, bearings, sensors, transfer paths, noise and what
//! else disturbs come from the seed: other trials keep some of it fixed, and a rule may fit just that. [`plant`] draws the
//! machine, [`sounds`] what it sounds like beside the defect. Seeds below 1000 are for those who set rules, figures
//! come from the others. Must not know how verdicts come about.

pub mod plant;
pub mod sounds;

use super::Measured;
use super::Trial;
use super::defect::Defect;
use super::vibration;
use super::vibration::Path;
use super::vibration::Strikes;
use crate::diagnosis::baseline::Baseline;
use crate::dsp::real::Real;
use crate::evaluation::truth::Known;
use crate::evaluation::truth::KnownFault;
use crate::machine::bearing::FaultOrders;
use crate::machine::file::MachineFileErrors;
use crate::pipeline::SpeedHints;
use crate::units::Unit;
use plant::Kind;
use plant::Plant;
use plant::Told;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use sounds::Sounds;

/// Machines of one seed at most: numbers of the next seed's follow.
pub const MAX_NUMBER: u64 = 64;

/// One trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// What kind of machine.
    pub kind: Kind,
    /// What is damaged at the first bearing, and the range of the power of its ringing over that of the noise where it is
    /// heard best, dB.
    pub defect: Option<(Defect, (f64, f64))>,
    /// Which machine of the seed, below [`MAX_NUMBER`].
    pub number: u64,
    /// Makes the record.
    pub seed: u64,
}

/// Slip of a bearing, relative, and what a rolling element's rate differs beside it.
const SLIP: (f64, f64) = (-0.015, 0.003);
const ELEMENT_SLIP: f64 = 0.01;

/// Part of the defects that strike twice: where an element enters, and where it leaves, this part of a distance later.
const STRIKES_TWICE: f64 = 0.3;
const LEAVES_AFTER: (f64, f64) = (0.05, 0.3);

/// How much weaker than the nearest the other sensors hear a source.
const FAR: (f64, f64) = (0.1, 0.6);

/// Makes a trial.
///
/// # Errors
/// Never, as long as the drawn machine files are right.
pub fn trial(group: &str, setting: &Setting) -> Result<Trial, MachineFileErrors> {
    let number = setting.seed.wrapping_mul(MAX_NUMBER).wrapping_add(setting.number);
    let mut random = Pcg64Mcg::seed_from_u64(number);
    let plant = Plant::draw(setting.kind, &mut random)?;
    let mut sounds = Sounds::draw(&plant, setting.defect.is_none(), &mut random);
    let mut name = format!("{group}, seed {}, number {}: {plant}", setting.seed, setting.number);
    if let Some((defect, db)) = setting.defect {
        let db = random.random_range(db.0..db.1);
        let strikes = strikes(&plant, defect, &mut random);
        sounds.strike(strikes, 10.0_f64.powf(db / 20.0), &mut random);
        name += &format!("; {} {db:.1} dB", defect.fault().name());
    }
    name += &sounds.names().iter().map(|name| format!("; {name}")).collect::<String>();
    // All sensors in one unit: who hears it louder is told by that.
    let gain = log_normal(0.0, 2.0, &mut random);
    let mut channels = Vec::new();
    let mut samples = Vec::new();
    for sensor in 0..plant.n_sensors {
        channels.push(super::channel(
            &plant::channel(sensor),
            Unit::MetrePerSecondSquared,
            plant.rate,
        ));
        samples.push(recorded(&sounds.at(&plant, sensor, &mut random), gain, &mut random));
    }
    if plant.told == Told::Tacho {
        channels.push(super::channel(plant::TACHO, Unit::Volt, plant.rate));
        let is_mark = |turned: &f64| turned.rem_euclid(1.0) < 0.1;
        samples.push(plant.turned.iter().map(|t| if is_mark(t) { 5.0 } else { 0.0 }).collect());
    }
    let known = setting.defect.map(|(defect, _)| KnownFault {
        fault: defect.fault(),
        component: Some(plant::DAMAGED.to_owned()),
    });
    Ok(Trial {
        group: group.to_owned(),
        name,
        label: setting.defect.map_or("healthy", |(defect, _)| defect.fault().name()).to_owned(),
        known: Known::Faults(known.into_iter().collect()),
        speed: plant.mean_speed(),
        is_visible: None,
        over_sound: None,
        measured: Measured {
            hints: SpeedHints { option: None, capture: plant.written },
            machine: plant.machine,
            machine_text: plant.machine_text,
            channels,
            samples,
        },
        baseline: Baseline::default(),
    })
}

/// Strikes of a defect of the first bearing (T3, T8).
fn strikes(plant: &Plant, defect: Defect, random: &mut Pcg64Mcg) -> Vec<f64> {
    let Some(orders) = plant.fault_orders() else {
        return Vec::new();
    };
    let strikes = rhythm(defect, &orders, random);
    let mut struck = strikes.make(&plant.turn, plant.turned.len(), plant.rate.0, random);
    if random.random_bool(STRIKES_TWICE) {
        let part = random.random_range(LEAVES_AFTER.0..LEAVES_AFTER.1);
        let strength =
            random.random_range(0.4..1.0) * if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let later = crate::dsp::real::floor_index(
            part * plant.rate.0 / (strikes.order * plant.mean_speed().0),
        );
        for at in (later..struck.len()).rev() {
            struck[at] += strength * struck[at - later];
        }
    }
    struck
}

/// Strikes of a defect of a bearing whose elements slip, and do so unevenly (T3, T8).
#[must_use]
pub fn rhythm(defect: Defect, orders: &FaultOrders, random: &mut Pcg64Mcg) -> Strikes {
    let mut slip = random.random_range(SLIP.0..SLIP.1);
    let depth = match defect {
        Defect::InnerRace => random.random_range(0.4..1.0),
        Defect::OuterRace => {
            if random.random_bool(0.33) {
                0.3
            } else {
                0.0
            }
        }
        Defect::RollingElement => {
            slip += random.random_range(-ELEMENT_SLIP..ELEMENT_SLIP);
            random.random_range(0.3..1.0)
        }
    };
    let order = defect.order(orders) * (1.0 + slip);
    let unevenness = random.random_range(0.002..0.02);
    let drifts = random.random_bool(0.5);
    Strikes {
        order,
        jitter: if drifts { 0.0 } else { unevenness },
        drift: if drifts { unevenness } else { 0.0 },
        scatter: random.random_range(0.1..0.4),
        modulation: (defect.load_order(orders), depth),
    }
}

/// What the nearest and the other sensors hear of a source, the nearest being the first.
fn levels(n_sensors: usize, nearest: f64, random: &mut Pcg64Mcg) -> Vec<f64> {
    let far = |_| nearest * random.random_range(FAR.0..FAR.1);
    std::iter::once(nearest).chain((1..n_sensors).map(far)).collect()
}

/// A path drawn in Hz (T8): stiffer modes move more.
#[must_use]
pub fn path(rate_hz: f64, random: &mut Pcg64Mcg) -> Path {
    let top_hz = random.random_range(6e3..25e3_f64).min(0.45 * rate_hz);
    let lowest_hz = (0.03 * top_hz).max(300.0);
    let tilt = random.random_range(0.0..1.3);
    let n_modes = random.random_range(2..=8);
    let mode = |_| {
        let frequency_hz = log_uniform((lowest_hz, top_hz), random);
        vibration::Mode {
            omega: std::f64::consts::TAU * frequency_hz / rate_hz,
            damping: random.random_range(0.01..0.06),
            amplitude: vibration::normal(random) * (frequency_hz / top_hz).powf(tilt),
        }
    };
    Path::of(&(0..n_modes).map(mode).collect::<Vec<_>>())
}

/// As a recorder gives it: of a machine that shakes so much, some channels with an offset, some in coarse steps.
fn recorded(x: &[f64], gain: f64, random: &mut Pcg64Mcg) -> Vec<f32> {
    let rms = (x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64).sqrt();
    let offset = if random.random_bool(0.3) { 5.0 * rms * vibration::normal(random) } else { 0.0 };
    let step = random.random_bool(0.2).then(|| rms / random.random_range(5.0..50.0));
    let stepped = |v: f64| step.map_or(v, |step| (v / step).round() * step);
    x.iter().map(|v| f32::rounded(gain * stepped(v + offset))).collect()
}

/// Draws a number whose logarithm is even.
fn log_uniform(range: (f64, f64), random: &mut Pcg64Mcg) -> f64 {
    random.random_range(range.0.ln()..range.1.ln()).exp()
}

/// exp of a normal number of this mean and deviation.
fn log_normal(mean: f64, deviation: f64, random: &mut Pcg64Mcg) -> f64 {
    (mean + deviation * vibration::normal(random)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    const DEFECT: (Defect, (f64, f64)) = (Defect::InnerRace, (5.0, 10.0));

    #[test]
    fn the_seed_makes_the_record_and_every_number_another() {
        let setting = |number| Setting { kind: Kind::Usual, defect: Some(DEFECT), number, seed: 7 };
        let make = |number: u64| trial("t", &setting(number)).unwrap();
        let (one, again, other) = (make(1), make(1), make(2));
        assert_eq!(one.name, again.name);
        assert_eq!(one.measured.samples, again.measured.samples);
        assert_ne!(one.measured.samples, other.measured.samples);
        assert_eq!(one.measured.channels.len(), one.measured.samples.len());
        assert!(one.measured.samples.iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn rates_speeds_sensors_and_disturbances_are_all_drawn() {
        let (mut rates, mut told, mut names) = (BTreeSet::new(), Vec::new(), BTreeSet::new());
        for number in 0..150 {
            let mut random = Pcg64Mcg::seed_from_u64(number);
            let plant = Plant::draw(Kind::Usual, &mut random).unwrap();
            rates.insert(plant.rate.0.to_bits());
            told.push((plant.told, plant.n_sensors, plant.machine.bearings.len()));
            let first = |name: &String| name.split(' ').next().unwrap_or_default().to_owned();
            names.extend(Sounds::draw(&plant, true, &mut random).names().iter().map(first));
            let (plate, mean) = (plant.machine.nominal_speed().unwrap(), plant.mean_speed());
            assert!((plate.0 / mean.0 - 1.0).abs() <= 0.02);
            assert_eq!(plant.written.is_some(), plant.told == Told::Written);
        }
        assert_eq!(rates.len(), 17);
        assert_eq!(names.len(), 14, "{names:?}");
        for wanted in [Told::Written, Told::NamePlate, Told::Tacho] {
            assert!(told.iter().any(|(told, ..)| *told == wanted));
        }
        assert_eq!(told.iter().map(|(_, sensors, _)| *sensors).max(), Some(3));
    }

    #[test]
    fn slow_and_fast_machines_turn_so() {
        for (kind, range) in [(Kind::Slow, 0.5..8.0), (Kind::Fast, 50.0..500.0)] {
            for number in 0..20 {
                let mut random = Pcg64Mcg::seed_from_u64(number);
                let plant = Plant::draw(kind, &mut random).unwrap();
                // Half of a ramp of 15 % to either side, a wander of 0.3 %.
                let speed_hz = plant.mean_speed().0;
                assert!(range.start * 0.9 < speed_hz && speed_hz < range.end * 1.1, "{plant}");
            }
        }
    }

    #[test]
    fn a_speed_that_swings_does_so_within_a_few_revolutions() {
        for number in 0..20 {
            let mut random = Pcg64Mcg::seed_from_u64(number);
            let plant = Plant::draw(Kind::Swinging, &mut random).unwrap();
            let speed_hz = plant.mean_speed().0;
            // Over a period of the longest swing it goes through both its ends; means lie within it.
            let times_s = (0..400).map(|i| f64::from(i) * 0.1 / speed_hz);
            let speeds: Vec<f64> = times_s.map(|t| plant.turn.speed_hz(t) / speed_hz).collect();
            let most = speeds.iter().copied().fold(0.0, f64::max);
            let least = speeds.iter().copied().fold(2.0, f64::min);
            assert!((0.0039..0.11).contains(&(most - least)), "{plant}: {least} {most}");
        }
    }

    #[test]
    fn bearings_that_are_alike_have_the_same_rates_and_a_sensor_each() {
        let mut n_bearings = BTreeSet::new();
        for number in 0..20 {
            let mut random = Pcg64Mcg::seed_from_u64(number);
            let plant = Plant::draw(Kind::Alike, &mut random).unwrap();
            let bearings = &plant.machine.bearings;
            assert!(bearings.iter().all(|b| b.fault_orders() == bearings[0].fault_orders()));
            assert!(plant.n_sensors >= bearings.len());
            n_bearings.insert(bearings.len());
        }
        assert_eq!(n_bearings, BTreeSet::from([2, 3, 4]));
    }

    #[test]
    fn a_defect_rings_as_loud_as_stated_at_the_first_sensor() {
        for seed in 0..4 {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let plant = Plant::draw(Kind::Usual, &mut random).unwrap();
            let mut sounds = Sounds::silent(&plant);
            let strikes = strikes(&plant, Defect::OuterRace, &mut random);
            let power = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
            let quiet = power(&sounds.at(&plant, 0, &mut random));
            sounds.strike(strikes, 3.0, &mut random);
            let loud = power(&sounds.at(&plant, 0, &mut random));
            // Nine times the noise; the two meet by chance.
            assert!((quiet - 1.0).abs() < 1e-9 && (loud - 10.0).abs() < 0.5, "{quiet} {loud}");
        }
    }

    #[test]
    fn channels_of_a_machine_keep_their_proportion() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let x: Vec<f64> = (0..20_000).map(|_| vibration::normal(&mut random)).collect();
        for _ in 0..20 {
            let recorded = recorded(&x, 3.0, &mut random);
            let rms = crate::dsp::stats::Moments::of(&recorded).variance().unwrap().sqrt();
            // σ of 20 000 values 0.5 %; steps of a fifth of σ add 0.2 %.
            assert!((rms / 3.0 - 1.0).abs() < 0.03, "{rms}");
        }
    }
}
