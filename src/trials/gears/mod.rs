//! Trials of a gear pair that the simulator has no part in: damaged teeth, wear, healthy gears that only sound
//! like it, and healthy ones beside all kinds of noise ([`disturbance`]).
//!
//! Two models. [`modulation`] writes the mesh down as harmonics that the teeth modulate; [`stiffness`] lets a
//! stiffness that changes from tooth to tooth drive an oscillator. Numbers of teeth, speed, transfer path, errors of the teeth and
//! noise are drawn from the seed; the baseline is the same pair at another load with other noise. Seeds
//! below 1000 are for those who set rules, figures come from the others. Must not know how gears are judged.

pub mod disturbance;
pub mod modulation;
pub mod stiffness;

use super::Measured;
use super::Trial;
use super::motion::Motion;
use super::motion::Turn;
use super::vibration;
use super::vibration::Path;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::GearSide;
use crate::dsp::real::Real;
use crate::evaluation::truth::Known;
use crate::evaluation::truth::KnownFault;
use crate::machine::Machine;
use crate::machine::file;
use crate::pipeline::SpeedHints;
use crate::units::Hz;
use crate::units::Unit;
use disturbance::Disturbance;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::sync::Arc;

const RATE_HZ: f64 = 12_000.0;
const N_SAMPLES: usize = 120_000;

/// The third mesh harmonic stays below this, Hz.
const TOP_HZ: f64 = 4800.0;

/// Standard deviation of the speed, relative: with a tacho, and without one, where an average needs it.
const WANDER: f64 = 1e-3;
const STEADY: f64 = 2e-5;

/// Id of the pair.
const PAIR: &str = "pair";

/// How the mesh's sound is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// Harmonics modulated in amplitude and phase.
    Modulation,
    /// An oscillator on a stiffness that changes.
    Stiffness,
}

/// What is true of the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Errors of the teeth and a little eccentricity.
    Healthy,
    /// Both wheels run out: the load swings by 20 % once a turn.
    Eccentric,
    /// The wheel that cut one of the gears is heard: tones at orders that are no mesh, new since the
    /// baseline (another load brings them out).
    Ghost,
    /// A tooth gives way.
    Cracked,
    /// A tooth is missing: the next strikes.
    Broken,
    /// Three teeth have pits: small strikes, each another.
    Pitted,
    /// All teeth are worn: the higher mesh harmonics have grown.
    Worn,
    /// Healthy, beside something that is no tooth's.
    Disturbed(Disturbance),
}

impl Kind {
    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Healthy => "healthy: errors of the teeth",
            Self::Eccentric => "healthy: eccentric by 20 %",
            Self::Ghost => "healthy: ghost orders",
            Self::Cracked => "cracked tooth",
            Self::Broken => "broken tooth",
            Self::Pitted => "pitted teeth",
            Self::Worn => "distributed wear",
            Self::Disturbed(disturbance) => disturbance.name(),
        }
    }

    /// Whether nothing is wrong with the teeth.
    #[must_use]
    pub fn is_healthy(self) -> bool {
        self.fault().is_none()
    }

    fn fault(self) -> Option<FaultMode> {
        match self {
            Self::Healthy | Self::Eccentric | Self::Ghost | Self::Disturbed(_) => None,
            Self::Cracked | Self::Broken | Self::Pitted => Some(FaultMode::ToothDamage),
            Self::Worn => Some(FaultMode::DistributedWear),
        }
    }
}

/// What each model can be made of, whether there is a baseline or not.
#[must_use]
pub fn kinds(model: Model) -> &'static [Kind] {
    match model {
        Model::Modulation => &[
            Kind::Healthy,
            Kind::Eccentric,
            Kind::Ghost,
            Kind::Cracked,
            Kind::Broken,
            Kind::Pitted,
            Kind::Worn,
        ],
        Model::Stiffness => &[Kind::Healthy, Kind::Eccentric, Kind::Cracked],
    }
}

/// What a pair that has a baseline is heard beside as well: without one nothing of a gear is told. The model has no part in it,
/// and so the first alone is disturbed.
pub fn controls(model: Model) -> impl Iterator<Item = Kind> {
    let is_disturbed = model == Model::Modulation;
    Disturbance::ALL.into_iter().filter(move |_| is_disturbed).map(Kind::Disturbed)
}

/// One trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// How it is made.
    pub model: Model,
    /// What is true.
    pub kind: Kind,
    /// Whether the driving shaft has a tacho; else its speed is written down, off by up to 0.1 %.
    pub has_tacho: bool,
    /// Whether there is a healthy record.
    pub has_baseline: bool,
    /// Makes the record.
    pub seed: u64,
}

/// Where the damage is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Which gear.
    pub side: GearSide,
    /// Revolutions of its shaft after the driving shaft's mark at which the tooth is at the pitch point.
    pub turn: f64,
    /// Teeth of the gear.
    pub teeth: u32,
    /// Its number, tooth 1 being that of the machine file.
    pub tooth: u32,
}

/// A gear pair as it was drawn.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Teeth of the driving and of the driven gear.
    pub teeth: [u32; 2],
    /// Speed of the driving shaft, Hz.
    pub speed_hz: f64,
    /// Revolutions of each shaft at which its tooth 1 is at the pitch point.
    pub tooth_1_at: [f64; 2],
    /// Errors of the teeth of each gear, standard deviation 1.
    pub errors: [Vec<f64>; 2],
    /// Phase of each gear's run-out, revolutions.
    pub run_out: [f64; 2],
    /// Index of the damaged gear, and the tooth's number less one.
    pub damaged: (usize, u32),
}

impl Pair {
    fn draw(random: &mut Pcg64Mcg) -> Self {
        let driving = random.random_range(17..=45_u32);
        let driven = random.random_range(driving..=3 * driving);
        let teeth = [driving, driven];
        let speed_hz = random.random_range(12.0..(TOP_HZ / 3.0 / f64::from(driving)).min(36.0));
        // The teeth of both come to the pitch point together.
        let first = random.random_range(0.0..1.0) / f64::from(driving);
        let ahead = [driving, driven].map(|z| f64::from(random.random_range(0..z)));
        let tooth_1_at = [
            first + ahead[0] / f64::from(driving),
            (first * f64::from(driving) + ahead[1]) / f64::from(driven),
        ];
        let errors = teeth.map(|z| (0..z).map(|_| vibration::normal(random)).collect::<Vec<f64>>());
        let run_out = [0, 1].map(|_| random.random_range(0.0..1.0));
        let gear = usize::from(random.random_bool(0.5));
        let damaged = (gear, random.random_range(0..teeth[gear]));
        Self { teeth, speed_hz, tooth_1_at, errors, run_out, damaged }
    }

    /// Revolutions of each shaft after `turned` of the driving one.
    #[must_use]
    pub fn turns(&self, turned: f64) -> [f64; 2] {
        [turned, turned * f64::from(self.teeth[0]) / f64::from(self.teeth[1])]
    }

    /// Where the damaged tooth is.
    #[must_use]
    pub fn place(&self) -> Place {
        let (gear, tooth) = self.damaged;
        let teeth = self.teeth[gear];
        let turn = self.tooth_1_at[gear] + f64::from(tooth) / f64::from(teeth);
        let side = if gear == 0 { GearSide::Driving } else { GearSide::Driven };
        Place { side, turn: turn.rem_euclid(1.0), teeth, tooth: tooth + 1 }
    }

    /// Distance of the damaged tooth from the pitch point, pitches, −z/2…z/2.
    #[must_use]
    pub fn pitches_past_damage(&self, turned: f64) -> f64 {
        let place = self.place();
        let past = self.turns(turned)[self.damaged.0] - place.turn;
        (past - past.round()) * f64::from(place.teeth)
    }

    /// 1 + depth·cos of both gears' run-out.
    #[must_use]
    pub fn swing(&self, turned: f64, depth: f64) -> f64 {
        let turns = self.turns(turned);
        let sum: f64 = turns.iter().zip(&self.run_out).map(|(t, at)| (TAU * (t - at)).cos()).sum();
        1.0 + depth * sum
    }

    fn machine_text(&self, has_tacho: bool) -> String {
        let [driving, driven] = self.teeth;
        let degrees = self.tooth_1_at[0] * 360.0;
        let tacho =
            "[[sensor]]\nchannel = \"tacho\"\nkind = \"tacho\"\nat = { shaft = \"fast\" }\n";
        format!(
            "[machine]\nid = \"gearbox\"\n[[shaft]]\nid = \"fast\"\n[[shaft]]\nid = \"slow\"\n\
             [[gear]]\nid = \"{PAIR}\"\n\
             driving = {{ shaft = \"fast\", teeth = {driving}, tooth_1_at_deg = {degrees} }}\n\
             driven = {{ shaft = \"slow\", teeth = {driven} }}\n\
             [[sensor]]\nchannel = \"case\"\nkind = \"accelerometer\"\nat = {{ gear = \"{PAIR}\" }}\n{}",
            if has_tacho { tacho } else { "" }
        )
    }
}

/// How far eccentric and other pairs' load swings.
fn swing_depth(kind: Kind) -> f64 {
    if kind == Kind::Eccentric { 0.2 } else { 0.03 }
}

/// What of a record differs from another of the same pair.
struct Occasion {
    kind: Kind,
    load: f64,
    turn: Turn,
}

/// A pair with everything around it.
struct Gearbox {
    machine: Arc<Machine>,
    machine_text: Arc<str>,
    pair: Pair,
    path: Path,
    voice: Voice,
    /// RMS of the noise over that of the healthy mesh.
    noise: f64,
    /// 1×, 2×, 3× of either shaft in turn, amplitudes over the mesh's RMS.
    shaft_lines: [f64; 6],
    has_tacho: bool,
}

impl Gearbox {
    fn draw(setting: &Setting) -> Result<Self, String> {
        let mut random = Pcg64Mcg::seed_from_u64(setting.seed);
        let pair = Pair::draw(&mut random);
        let text = pair.machine_text(setting.has_tacho);
        let machine = file::parse(&text, "gearbox").map_err(|e| e.to_string())?;
        Ok(Self {
            machine: Arc::new(machine),
            machine_text: text.into(),
            pair,
            path: Path::draw(&mut random),
            voice: Voice::draw(setting.model, &mut random),
            noise: 10.0_f64.powf(-random.random_range(0.0..15.0) / 20.0),
            shaft_lines: std::array::from_fn(|_| random.random_range(0.02..0.3)),
            has_tacho: setting.has_tacho,
        })
    }

    /// A record. The first one's sound sets the scale of those that follow.
    fn record(&self, kind: Kind, seed: u64, gain: &mut Option<f64>) -> Measured {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let duration_s = N_SAMPLES as f64 / RATE_HZ;
        let disturbance =
            if let Kind::Disturbed(disturbance) = kind { Some(disturbance) } else { None };
        let usual = if self.has_tacho { WANDER } else { STEADY };
        let wander = disturbance.and_then(|disturbance| disturbance.wander(&mut random));
        let motion = Motion::Wander(wander.unwrap_or(usual));
        let turn = Turn::draw(motion, self.pair.speed_hz, duration_s, &mut random);
        let occasion = Occasion { kind, load: random.random_range(0.9..1.1), turn };
        let mesh = self.path.hear(&self.voice.mesh(&self.pair, &occasion, &mut random));
        let rms = (mesh.iter().map(|v| v * v).sum::<f64>() / mesh.len() as f64).sqrt();
        let gain = *gain.get_or_insert(1.0 / rms);
        let mut x: Vec<f64> = mesh.iter().map(|v| gain * v).collect();
        self.voice.add_strikes(&mut x, &self.pair, &occasion, &self.path, &mut random);
        let background = vibration::machine_noise(N_SAMPLES, &mut random);
        x.iter_mut().zip(&background).for_each(|(x, n)| *x += self.noise * n);
        for (i, amplitude) in (0_u32..).zip(self.shaft_lines) {
            let order = f64::from(1 + i / 2) * self.pair.turns(1.0)[usize::from(i % 2 == 1)];
            let phase = random.random_range(0.0..TAU);
            vibration::add_order(&mut x, &occasion.turn, RATE_HZ, order, amplitude, phase);
        }
        // Drawn from numbers of its own: all else is that of the healthy pair.
        let mut foreign = Pcg64Mcg::seed_from_u64(seed + 1_000_000);
        if let Some(disturbance) = disturbance {
            disturbance.add(&mut x, &self.pair, &occasion.turn, &mut foreign);
        }
        let mut channels = vec![super::channel("case", Unit::MetrePerSecondSquared, Hz(RATE_HZ))];
        let mut samples = vec![x.iter().map(|v| f32::rounded(*v)).collect()];
        if self.has_tacho {
            channels.push(super::channel("tacho", Unit::Volt, Hz(RATE_HZ)));
            samples.push(tacho(&occasion.turn));
        }
        let mean_hz = occasion.turn.revolutions(duration_s) / duration_s;
        let written = Hz(mean_hz * (1.0 + random.random_range(-0.001..0.001)));
        let hints = SpeedHints { option: None, capture: (!self.has_tacho).then_some(written) };
        let (machine, machine_text) = (Arc::clone(&self.machine), Arc::clone(&self.machine_text));
        Measured { machine, machine_text, channels, samples, hints }
    }

    /// The healthy pair as a baseline.
    fn baseline(&self, setting: &Setting, gain: &mut Option<f64>) -> Result<Baseline, String> {
        let before = if setting.kind == Kind::Eccentric { Kind::Eccentric } else { Kind::Healthy };
        let healthy = self.record(before, setting.seed + 1_000_000, gain);
        let mut baseline = Baseline::default();
        if setting.has_baseline {
            baseline.records.push(healthy.learn("healthy").map_err(|e| e.to_string())?);
        }
        Ok(baseline)
    }

    /// A record of `setting` to be held against `baseline`.
    fn trial(&self, setting: &Setting, baseline: Baseline, gain: &mut Option<f64>) -> Trial {
        let measured = self.record(setting.kind, setting.seed + 2_000_000, gain);
        // As of the rig: without a baseline nothing can be told of a gear.
        let fault = setting.kind.fault().filter(|_| setting.has_baseline);
        let known = fault.map(|fault| KnownFault { fault, component: Some(PAIR.to_owned()) });
        let yes = |is: bool, what: &str| if is { what.to_owned() } else { format!("no {what}") };
        let (tacho, with) =
            (yes(setting.has_tacho, "tacho"), yes(setting.has_baseline, "baseline"));
        let model = match setting.model {
            Model::Modulation => "modulation",
            Model::Stiffness => "stiffness",
        };
        let group = format!("gears by {model}, {tacho}, {with}");
        Trial {
            name: format!("{group}, {}, seed {}", setting.kind.name(), setting.seed),
            label: setting.kind.name().to_owned(),
            group,
            known: Known::Faults(known.into_iter().collect()),
            speed: Hz(self.pair.speed_hz),
            is_visible: None,
            over_sound: None,
            measured,
            baseline,
        }
    }
}

/// Makes a trial, and says where the damage is.
///
/// # Errors
/// When machine or baseline cannot be made.
pub fn trial(setting: &Setting) -> Result<(Trial, Place), String> {
    let gearbox = Gearbox::draw(setting)?;
    let mut gain = None;
    let baseline = gearbox.baseline(setting, &mut gain)?;
    let trial = gearbox.trial(setting, baseline, &mut gain);
    Ok((trial, gearbox.pair.place()))
}

/// The model with its numbers drawn.
enum Voice {
    Modulation(modulation::Voice),
    Stiffness(stiffness::Voice),
}

impl Voice {
    fn draw(model: Model, random: &mut Pcg64Mcg) -> Self {
        match model {
            Model::Modulation => Self::Modulation(modulation::Voice::draw(random)),
            Model::Stiffness => Self::Stiffness(stiffness::Voice::draw(random)),
        }
    }

    /// The mesh's sound where it arises.
    fn mesh(&self, pair: &Pair, occasion: &Occasion, random: &mut Pcg64Mcg) -> Vec<f64> {
        match self {
            Self::Modulation(voice) => voice.mesh(pair, occasion, random),
            Self::Stiffness(voice) => voice.mesh(pair, occasion),
        }
    }

    /// What strikes beside it, heard on the same way; the mesh has unit RMS.
    fn add_strikes(
        &self,
        x: &mut [f64],
        pair: &Pair,
        occasion: &Occasion,
        path: &Path,
        random: &mut Pcg64Mcg,
    ) {
        if let Self::Modulation(voice) = self {
            voice.add_strikes(x, pair, occasion, path, random);
        }
    }
}

fn tacho(turn: &Turn) -> Vec<f32> {
    let is_mark = |i: usize| turn.revolutions(i as f64 / RATE_HZ).rem_euclid(1.0) < 0.1;
    (0..N_SAMPLES).map(|i| if is_mark(i) { 5.0 } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests;
