//! Trials of a motor stand in closed form: bearing defects, and everything that only looks like one.
//!
//! Two bearings with a sensor each, a tacho or not. No simulation of a rig: strikes at kinematic
//! rates with slip through random transfer paths, noise, tones. Seeds below 1000 are for those who set rules,
//! figures come from the others.

use super::Measured;
use super::Trial;
use super::defect::Defect;
use super::motion::Motion;
use super::motion::Turn;
use super::vibration;
use super::vibration::Path;
use super::vibration::Strikes;
use crate::diagnosis::baseline::Baseline;
use crate::dsp::real::Real;
use crate::evaluation::truth::Known;
use crate::evaluation::truth::KnownFault;
use crate::machine::Machine;
use crate::machine::bearing::Bearing;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use crate::pipeline::SpeedHints;
use crate::units::Hz;
use crate::units::Unit;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::sync::Arc;

const RATE_HZ: f64 = 12_000.0;
const N_SAMPLES: usize = 120_000;
const SPEED_HZ: f64 = 29.95;

/// The bearing that is damaged.
const DAMAGED: &str = "drive-end";

const MACHINE: &str = "[machine]\nid = \"stand\"\nname = \"Motor stand\"\n[[shaft]]\nid = \"motor\"\n\
    [[motor]]\nshaft = \"motor\"\npoles = 4\nline_frequency_hz = 60.0\n\
    [[bearing]]\nid = \"drive-end\"\nshaft = \"motor\"\nelements = 9\nelement_diameter_mm = 7.94\n\
    pitch_diameter_mm = 39.04\n\
    [[bearing]]\nid = \"fan-end\"\nshaft = \"motor\"\nelements = 8\nelement_diameter_mm = 6.746\n\
    pitch_diameter_mm = 28.499\n\
    [[sensor]]\nchannel = \"DE\"\nkind = \"accelerometer\"\nat = { bearing = \"drive-end\" }\n\
    [[sensor]]\nchannel = \"FE\"\nkind = \"accelerometer\"\nat = { bearing = \"fan-end\" }\n";

const TACHO: &str =
    "[[sensor]]\nchannel = \"tacho\"\nkind = \"tacho\"\nat = { shaft = \"motor\" }\n";

/// What a healthy machine may also sound like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// Noise and shaft harmonics alone.
    None,
    /// Noise of equal power an octave.
    Pink,
    /// Strikes at random times, thirty a second.
    RandomStrikes,
    /// Mains hum, twice as strong as the noise.
    Hum,
    /// Twelve strong tones anywhere.
    Tones,
    /// A knock a turn.
    Knock,
    /// A machine beside it: another speed, knocks and a defect of a bearing of its own.
    Neighbour,
    /// A defect of a bearing that the machine file does not know.
    UnknownBearing,
}

impl Disturbance {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::None,
        Self::Pink,
        Self::RandomStrikes,
        Self::Hum,
        Self::Tones,
        Self::Knock,
        Self::Neighbour,
        Self::UnknownBearing,
    ];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "noise",
            Self::Pink => "pink noise",
            Self::RandomStrikes => "random strikes",
            Self::Hum => "mains hum",
            Self::Tones => "tones",
            Self::Knock => "knock a turn",
            Self::Neighbour => "machine beside it",
            Self::UnknownBearing => "unknown bearing",
        }
    }
}

/// One trial of the stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// What is damaged.
    pub defect: Option<Defect>,
    /// Power of the defect's ringing over that of the noise where it is heard best, dB.
    pub defect_db: f64,
    /// What else there is.
    pub disturbance: Disturbance,
    /// How the shaft turns.
    pub motion: Motion,
    /// Whether there is a tacho; else the speed is written down, off by up to 0.2 %.
    pub has_tacho: bool,
    /// Makes the record.
    pub seed: u64,
}

/// Slip of a bearing, relative: what is drawn from.
const SLIP: (f64, f64) = (-0.012, 0.0);

/// How much weaker the other sensor hears a defect.
const CROSS: f64 = 0.3;

/// Makes a trial.
///
/// # Errors
/// Never, as long as the machine text above is right.
pub fn trial(group: &str, setting: &Setting) -> Result<Trial, MachineFileErrors> {
    let text = if setting.has_tacho { format!("{MACHINE}{TACHO}") } else { MACHINE.to_owned() };
    let machine = Arc::new(file::parse(&text, "stand")?);
    let mut random = Pcg64Mcg::seed_from_u64(setting.seed);
    let duration_s = N_SAMPLES as f64 / RATE_HZ;
    let turn = Turn::draw(setting.motion, SPEED_HZ, duration_s, &mut random);
    let mut samples: Vec<Vec<f32>> = vibrations(&machine, setting, &turn, &mut random)
        .iter()
        .map(|x| x.iter().map(|v| f32::rounded(*v)).collect())
        .collect();
    let mut channels = vec![
        super::channel("DE", Unit::MetrePerSecondSquared, Hz(RATE_HZ)),
        super::channel("FE", Unit::MetrePerSecondSquared, Hz(RATE_HZ)),
    ];
    if setting.has_tacho {
        let is_mark = |i: usize| turn.revolutions(i as f64 / RATE_HZ).rem_euclid(1.0) < 0.1;
        samples.push((0..N_SAMPLES).map(|i| if is_mark(i) { 5.0 } else { 0.0 }).collect());
        channels.push(super::channel("tacho", Unit::Volt, Hz(RATE_HZ)));
    }
    let mean_hz = turn.revolutions(duration_s) / duration_s;
    let written = Hz(mean_hz * (1.0 + random.random_range(-0.002..0.002)));
    let known = setting
        .defect
        .map(|defect| KnownFault { fault: defect.fault(), component: Some(DAMAGED.to_owned()) });
    let label = setting.defect.map_or_else(
        || format!("healthy: {}", setting.disturbance.name()),
        |defect| defect.fault().name().to_owned(),
    );
    Ok(Trial {
        group: group.to_owned(),
        name: format!("{group}, {label}, seed {}", setting.seed),
        label,
        known: Known::Faults(known.into_iter().collect()),
        speed: Hz(mean_hz),
        is_visible: None,
        over_sound: None,
        measured: Measured {
            machine,
            machine_text: text.into(),
            channels,
            samples,
            hints: SpeedHints { option: None, capture: (!setting.has_tacho).then_some(written) },
        },
        baseline: Baseline::default(),
    })
}

/// Vibration at the drive end and at the fan end, in units of the noise's RMS.
fn vibrations(
    machine: &Machine,
    setting: &Setting,
    turn: &Turn,
    random: &mut Pcg64Mcg,
) -> [Vec<f64>; 2] {
    let defect = defect_strikes(machine, setting, turn, random);
    let foreign = foreign_strikes(machine, setting.disturbance, turn, random);
    let gain = 10.0_f64.powf(setting.defect_db / 20.0);
    let mut channel = |hears: f64| {
        let mut x = match setting.disturbance {
            Disturbance::Pink => vibration::pink(N_SAMPLES, RATE_HZ, random),
            Disturbance::None
            | Disturbance::RandomStrikes
            | Disturbance::Hum
            | Disturbance::Tones
            | Disturbance::Knock
            | Disturbance::Neighbour
            | Disturbance::UnknownBearing => vibration::machine_noise(N_SAMPLES, random),
        };
        for harmonic in 1..=6 {
            let (amplitude, phase) = tone(1.0, random);
            vibration::add_order(&mut x, turn, RATE_HZ, f64::from(harmonic), amplitude, phase);
        }
        if let Some(strikes) = &defect {
            vibration::add_scaled(&mut x, &Path::draw(random).hear(strikes), gain * hears);
        }
        for (strikes, gain) in &foreign {
            vibration::add_scaled(&mut x, &Path::draw(random).hear(strikes), *gain);
        }
        add_tones(&mut x, setting.disturbance, turn, random);
        x
    };
    [channel(1.0), channel(CROSS)]
}

fn tone(most: f64, random: &mut Pcg64Mcg) -> (f64, f64) {
    (random.random_range(0.0..most), random.random_range(0.0..TAU))
}

fn defect_strikes(
    machine: &Machine,
    setting: &Setting,
    turn: &Turn,
    random: &mut Pcg64Mcg,
) -> Option<Vec<f64>> {
    let defect = setting.defect?;
    let orders = machine.bearings.first()?.fault_orders()?;
    let depth = if defect == Defect::OuterRace { 0.0 } else { 0.8 };
    let order = defect.order(&orders) * (1.0 + random.random_range(SLIP.0..SLIP.1));
    let modulation = (defect.load_order(&orders), depth);
    let strikes = Strikes { order, jitter: 0.01, drift: 0.0, scatter: 0.2, modulation };
    Some(strikes.make(turn, N_SAMPLES, RATE_HZ, random))
}

/// Strikes of a disturbance with their gains over the noise.
fn foreign_strikes(
    machine: &Machine,
    disturbance: Disturbance,
    turn: &Turn,
    random: &mut Pcg64Mcg,
) -> Vec<(Vec<f64>, f64)> {
    let even = |order: f64, jitter: f64| Strikes {
        order,
        jitter,
        drift: 0.0,
        scatter: 0.2,
        modulation: (1.0, 0.0),
    };
    let mut make = |strikes: Strikes, turn: &Turn| strikes.make(turn, N_SAMPLES, RATE_HZ, random);
    match disturbance {
        Disturbance::None | Disturbance::Pink | Disturbance::Hum | Disturbance::Tones => Vec::new(),
        // Places drawn anew each by many times their distance: a Poisson train.
        Disturbance::RandomStrikes => vec![(make(even(1.0, 20.0), turn), 1.5)],
        Disturbance::Knock => vec![(make(even(1.0, 0.0), turn), 1.5)],
        Disturbance::Neighbour => {
            let speed_hz = 23.7;
            let other = Turn::draw(Motion::Steady, speed_hz, 1.0, &mut Pcg64Mcg::seed_from_u64(0));
            let order = 4.94;
            vec![(make(even(1.0, 0.0), &other), 0.7), (make(even(order, 0.01), &other), 1.0)]
        }
        Disturbance::UnknownBearing => {
            let order = unknown_order(machine, random);
            vec![(even(order, 0.01).make(turn, N_SAMPLES, RATE_HZ, random), 1.0)]
        }
    }
}

/// A rate of strikes none of whose first four harmonics is a line of the machine's bearings.
fn unknown_order(machine: &Machine, random: &mut Pcg64Mcg) -> f64 {
    let listed: Vec<f64> = machine
        .bearings
        .iter()
        .filter_map(Bearing::fault_orders)
        .flat_map(|o| [o.bpfo, o.bpfi, o.two_bsf()])
        .collect();
    loop {
        let order = random.random_range(2.0..8.0);
        let meets = |line: &f64| (1..=4).any(|k| (f64::from(k) * order / line - 1.0).abs() < 0.03);
        if !listed.iter().any(meets) {
            return order;
        }
    }
}

fn add_tones(x: &mut [f64], disturbance: Disturbance, turn: &Turn, random: &mut Pcg64Mcg) {
    match disturbance {
        Disturbance::Hum => {
            for harmonic in 1..=8 {
                let (amplitude, phase) = tone(4.0 / f64::from(harmonic), random);
                vibration::add_tone(x, RATE_HZ, 60.0 * f64::from(harmonic), amplitude, phase);
            }
        }
        Disturbance::Tones => {
            for _ in 0..12 {
                let order = random.random_range(0.3..40.0);
                let (amplitude, phase) = tone(2.0, random);
                vibration::add_order(x, turn, RATE_HZ, order, amplitude, phase);
            }
        }
        Disturbance::None
        | Disturbance::Pink
        | Disturbance::RandomStrikes
        | Disturbance::Knock
        | Disturbance::Neighbour
        | Disturbance::UnknownBearing => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::fault::FaultMode;
    use crate::diagnosis::fault::State;
    use crate::diagnosis::verdict::Diagnosis;

    /// What is said of a stand whose sensors were cut at this many standard deviations.
    fn judged(defect: Option<Defect>, at: f32) -> Diagnosis {
        let setting = Setting {
            defect,
            defect_db: 5.0,
            disturbance: Disturbance::None,
            motion: Motion::Steady,
            has_tacho: false,
            seed: 11,
        };
        let mut trial = trial("cut", &setting).unwrap();
        for x in &mut trial.measured.samples {
            let rms = crate::dsp::stats::Moments::of(x).variance().unwrap().sqrt();
            let limit = at * f32::rounded(rms);
            x.iter_mut().for_each(|v| *v = v.clamp(-limit, limit));
        }
        trial.diagnose().unwrap().unwrap()
    }

    #[test]
    fn a_signal_cut_at_its_range_accuses_as_ever_and_acquits_nobody() {
        for defect in [Defect::InnerRace, Defect::OuterRace] {
            for at in [3.0, 2.0] {
                let diagnosis = judged(Some(defect), at);
                let damaged = diagnosis.components.iter().find(|c| c.id == DAMAGED).unwrap();
                assert_eq!(damaged.fault, Some(defect.fault()), "{at}: {}", damaged.why);
                assert!(damaged.why.contains("cut at the ends of its range"), "{}", damaged.why);
            }
        }
        let healthy = judged(None, 2.5);
        let bearings: Vec<_> =
            healthy.components.iter().filter(|c| c.why.contains("a wider range")).collect();
        assert_eq!(bearings.len(), 2, "{:?}", healthy.components);
        assert!(bearings.iter().all(|c| c.state == State::Undetermined));
        assert!(
            !healthy
                .components
                .iter()
                .any(|c| { c.state.is_accusation() && c.fault != Some(FaultMode::Clipped) })
        );
        // Not cut, they are healthy.
        let whole = judged(None, 1e3);
        let is_healthy =
            |id: &str| whole.components.iter().any(|c| c.id == id && c.state == State::Healthy);
        assert!(bearings.iter().all(|c| is_healthy(&c.id)));
    }
}
