//! Trials of the simulated rig: eight combinations of good and bad gear, shaft and bearing.
//!
//! The built-in combined scene with its numbers changed: speed, size of the race defect, clearance, mesh
//! load, seed; then noise on every sensor. What a baseline holds is the same rig without faults, with
//! another seed.

use super::Measured;
use super::Trial;
use super::simulated::NotMade;
use super::simulated::measure;
use super::simulated::table;
use super::vibration;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::fault::FaultMode;
use crate::dsp::line;
use crate::dsp::real::Real;
use crate::evaluation::truth::Known;
use crate::evaluation::truth::KnownFault;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelInfo;
use crate::simulator::scene::builtin;
use crate::units::Hz;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use toml::Table;
use toml::Value;

/// Scene and machine file that everything is made of.
const SCENE: &str = "BG_BS_BB";
const MACHINE: &str = "../machines/rig.toml";

/// Which parts are bad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bad {
    /// A worn tooth.
    pub gear: bool,
    /// A bent shaft.
    pub shaft: bool,
    /// A defect on the inner race of the right bearing: its number, 1 to 3.
    pub bearing: Option<u8>,
}

impl Bad {
    /// A rig in good health.
    pub const NOTHING: Self = Self { gear: false, shaft: false, bearing: None };

    /// The source's name of the combination, as in `GG_BS_BB`.
    #[must_use]
    pub fn name(self) -> String {
        let word = |bad: bool| if bad { 'B' } else { 'G' };
        let (gear, shaft, bearing) =
            (word(self.gear), word(self.shaft), word(self.bearing.is_some()));
        format!("{gear}G_{shaft}S_{bearing}B")
    }

    /// What is to be found: of gear and shaft only what a baseline can tell.
    fn known(self, has_baseline: bool) -> Vec<KnownFault> {
        let fault = |is_there: bool, fault: FaultMode, component: &str| {
            is_there.then(|| KnownFault { fault, component: Some(component.to_owned()) })
        };
        [
            fault(self.bearing.is_some(), FaultMode::InnerRace, DAMAGED),
            fault(self.shaft && has_baseline, FaultMode::Bow, "main"),
            fault(self.gear && has_baseline, FaultMode::ToothDamage, "mesh-1"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// One trial of the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// What is bad.
    pub bad: Bad,
    /// Speed of the shaft.
    pub speed: Hz,
    /// Radial clearance of both bearings, µm; below 0: interference.
    pub clearance_um: f64,
    /// Torque through the mesh, N·m.
    pub torque_nm: f64,
    /// Makes the record.
    pub seed: u64,
}

/// The rig as it was simulated, without noise.
#[derive(Debug, Clone)]
pub struct Rig {
    setting: Setting,
    measured: Measured,
    /// Of each channel of the bearing that may be damaged.
    lines: Vec<(usize, Lines)>,
    /// The same of the rig without the defect.
    sound_lines: Option<Vec<(usize, Lines)>>,
}

/// Amplitudes of the first harmonics of BPFI in one channel.
type Lines = [f64; HARMONICS];

/// What there is to hear of a defect.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Heard {
    /// Whether its lines stand over the noise (T7).
    is_visible: bool,
    /// How many times as high those that do are as without the defect (T11).
    over_sound: Option<f64>,
}

impl Rig {
    /// Simulates a setting for ten seconds.
    ///
    /// # Errors
    /// When scene or machine cannot be built, or the motion diverges.
    pub fn simulate(setting: &Setting) -> Result<Self, NotMade> {
        let name = format!("{} at {} Hz", setting.bad.name(), setting.speed.0);
        let text = scene_text(setting)
            .ok_or_else(|| NotMade { name: name.clone(), why: "no built-in scene".to_owned() })?;
        let machine_text = builtin::machine(MACHINE).unwrap_or_default();
        let measured = measure(&name, &text, machine_text, setting.seed)?;
        let lines = defect_lines(&measured, setting.speed);
        Ok(Self { setting: *setting, measured, lines, sound_lines: None })
    }

    /// Holds the lines of the defect against those of `sound`, if that is the same rig without it.
    #[must_use]
    pub fn beside(self, sound: Option<&Self>) -> Self {
        let without = Setting { bad: Bad { bearing: None, ..self.setting.bad }, ..self.setting };
        let sound = sound.filter(|sound| sound.setting == without);
        let sound_lines = sound.map(|sound| sound.lines.clone());
        Self { sound_lines, ..self }
    }

    /// Simulates the same rig without faults and with another seed.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    pub fn healthy_twin(setting: &Setting) -> Result<Self, NotMade> {
        let seed = setting.seed + 1_000_000;
        Self::simulate(&Setting { bad: Bad::NOTHING, seed, ..*setting })
    }

    /// Whether two of the first four harmonics of BPFI stand over noise of these levels in one channel of the damaged
    /// bearing (T7), and how far over the same rig without the defect (T11); `None` without a defect.
    fn hear_defect(&self, levels: &[f64]) -> Option<Heard> {
        self.setting.bad.bearing?;
        let (mut is_visible, mut over_sound) = (false, None);
        for (at, (channel, lines)) in self.lines.iter().enumerate() {
            let (x, rate_hz) =
                (&self.measured.samples[*channel], self.measured.channels[*channel].sample_rate.0);
            let (length_s, density) =
                (x.len() as f64 / rate_hz, 2.0 * levels[*channel].powi(2) / rate_hz);
            let stands = |amplitude: f64| {
                amplitude > 0.0 && amplitude.powi(2) * length_s >= 2.0 * STANDS_OUT * density
            };
            let is_shown = lines.iter().filter(|a| stands(**a)).count() >= ENOUGH;
            is_visible |= is_shown;
            let Some(sound) = self.sound_lines.as_ref().filter(|_| is_shown) else { continue };
            let pairs = lines.iter().zip(&sound[at].1).filter(|(a, _)| stands(**a));
            let mut ratios: Vec<f64> = pairs.map(|(a, sound)| (a / sound).min(MOST)).collect();
            ratios.sort_by(|a, b| b.total_cmp(a));
            over_sound = Some(ratios[ENOUGH - 1].max(over_sound.unwrap_or(0.0)));
        }
        Some(Heard { is_visible, over_sound })
    }

    /// The trial with noise `noise_db` below the vibration of each sensor (`None`: none), held against the
    /// healthy twin with noise of the same strength, if one is given.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel.
    pub fn trial(
        &self,
        group: &str,
        noise_db: Option<f64>,
        twin: Option<&Self>,
    ) -> Result<Trial, NotMade> {
        let name = self.setting.bad.name();
        let mut baseline = Baseline::default();
        let levels: Vec<f64> =
            self.measured.samples.iter().map(|x| rms(x) * gain(noise_db)).collect();
        if let Some(twin) = twin {
            let measured = noisy(&twin.measured, &levels, twin.setting.seed);
            let record = measured.learn("healthy");
            let why = |e: crate::pipeline::MonitorError| NotMade {
                name: name.clone(),
                why: e.to_string(),
            };
            baseline.records.push(record.map_err(why)?);
        }
        let defect = self.setting.bad.bearing.map_or(String::new(), |n| format!(" #{n}"));
        let heard = self.hear_defect(&levels);
        Ok(Trial {
            group: group.to_owned(),
            label: name.clone(),
            name: format!("{group}, {name}{defect}, {:?}, noise {noise_db:?} dB", self.setting),
            known: Known::Faults(self.setting.bad.known(twin.is_some())),
            speed: self.setting.speed,
            is_visible: heard.map(|heard| heard.is_visible),
            over_sound: heard.and_then(|heard| heard.over_sound),
            measured: noisy(&self.measured, &levels, self.setting.seed),
            baseline,
        })
    }
}

/// The bearing that is damaged, and how its channels begin.
const DAMAGED: &str = "right";

/// Harmonics of a defect's line that are looked at, and how many of them must stand out.
const HARMONICS: usize = 4;
const ENOUGH: usize = 2;

/// A²T/(2S) from which a line stands out, S the one-sided power density of the noise beside it: 20 is 13 dB.
const STANDS_OUT: f64 = 20.0;

/// What is written for a line that is not there at all without the defect.
const MOST: f64 = 1e6;

/// Amplitudes of BPFI's harmonics in the channels of the bearing that may be damaged.
fn defect_lines(measured: &Measured, speed: Hz) -> Vec<(usize, Lines)> {
    let damaged = measured.machine.bearings.iter().find(|b| b.id == DAMAGED);
    let Some(rates) = damaged.and_then(|bearing| bearing.fault_rates(speed)) else {
        return Vec::new();
    };
    let channels = measured.channels.iter().zip(&measured.samples).enumerate();
    let of_bearing = channels.filter(|(_, (info, _))| info.name.starts_with(DAMAGED));
    let lines = |(i, (info, x)): (usize, (&ChannelInfo, &Vec<f32>))| {
        let amplitude = |k: usize| {
            let line = line::line_at(x, info.sample_rate.0, (k + 1) as f64 * rates.bpfi.0);
            line.map_or(0.0, |line| line.amplitude)
        };
        (i, std::array::from_fn(amplitude))
    };
    of_bearing.map(lines).collect()
}

fn gain(noise_db: Option<f64>) -> f64 {
    noise_db.map_or(0.0, |db| 10.0_f64.powf(-db / 20.0))
}

/// RMS without the mean.
fn rms(x: &[f32]) -> f64 {
    crate::dsp::stats::Moments::of(x).variance().unwrap_or(0.0).sqrt()
}

fn noisy(measured: &Measured, levels: &[f64], seed: u64) -> Measured {
    let mut noisy = measured.clone();
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x6e_6f_69_73_65);
    let channels = measured.channels.iter().zip(&mut noisy.samples).zip(levels);
    for ((info, samples), level) in channels {
        let is_tacho = measured
            .machine
            .sensors
            .iter()
            .any(|s| s.channel == info.name && s.kind == SensorKind::Tacho);
        if !is_tacho && *level > 0.0 {
            for value in samples {
                *value = f32::rounded(f64::from(*value) + level * vibration::normal(&mut random));
            }
        }
    }
    noisy
}

/// Width, in, and depth, mil, of the source's defects.
fn defect_size(number: u8) -> (f64, f64) {
    match number {
        1 => (0.03, 1.5),
        2 => (0.04, 2.5),
        _ => (0.05, 4.0),
    }
}

/// The combined scene with the numbers of a setting.
fn scene_text(setting: &Setting) -> Option<String> {
    let mut scene: Table = builtin::text(SCENE)?.parse().ok()?;
    table(&mut scene, "speed")?.insert("constant_hz".to_owned(), setting.speed.0.into());
    if !setting.bad.shaft {
        scene.remove("bow");
    }
    for bearing in scene.get_mut("bearing")?.as_array_mut()? {
        let bearing = bearing.as_table_mut()?;
        bearing.insert("clearance_um".to_owned(), setting.clearance_um.into());
        let Some(defects) = bearing.get_mut("defect").and_then(Value::as_array_mut) else {
            continue;
        };
        match setting.bad.bearing {
            None => {
                bearing.remove("defect");
            }
            Some(number) => {
                let (width_in, depth_mil) = defect_size(number);
                let defect = defects.first_mut()?.as_table_mut()?;
                defect.insert("width_in".to_owned(), width_in.into());
                defect.insert("depth_mil".to_owned(), depth_mil.into());
            }
        }
    }
    for gear in scene.get_mut("gear")?.as_array_mut()? {
        let gear = gear.as_table_mut()?;
        gear.insert("torque_nm".to_owned(), setting.torque_nm.into());
        if !setting.bad.gear {
            gear.remove("fault");
        }
    }
    Some(scene.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::fault::State;

    /// The comb's lead and what is said of both bearings.
    fn beside_a_bow(bearing: Option<u8>, twin: &Rig) -> [(f64, State, Option<FaultMode>); 2] {
        let bad = Bad { gear: false, shaft: true, bearing };
        let setting = Setting { bad, ..twin.setting };
        let trial = Rig::simulate(&setting).unwrap().trial("", None, Some(twin)).unwrap();
        let diagnosis = trial.diagnose().unwrap().unwrap();
        ["left", "right"].map(|id| {
            let verdict = diagnosis.components.iter().find(|c| c.id == id).unwrap();
            let comb = verdict.evidence.iter().find(|e| e.indicator == "comb_bpfi").unwrap();
            (comb.value, verdict.state, verdict.fault)
        })
    }

    #[test]
    fn of_lines_that_stand_out_the_second_tells_how_far_they_are_over_a_sound_bearing() {
        let machine_text = builtin::machine(MACHINE).unwrap();
        let machine = crate::machine::file::parse(machine_text, MACHINE).unwrap();
        let channel = |name: &str| {
            let unit = crate::units::Unit::MetrePerSecondSquared;
            crate::trials::channel(name, unit, Hz(1000.0))
        };
        let measured = Measured {
            machine: machine.into(),
            machine_text: machine_text.into(),
            channels: vec![channel("right_x"), channel("right_y")],
            samples: vec![vec![0.0; 10_000]; 2],
            hints: crate::pipeline::SpeedHints::default(),
        };
        let bad = Bad { bearing: Some(1), ..Bad::NOTHING };
        let setting = Setting { bad, speed: Hz(10.0), clearance_um: 2.0, torque_nm: 1.0, seed: 1 };
        let rig = |bearing, lines: [Lines; 2]| Rig {
            setting: Setting { bad: Bad { bearing, ..bad }, ..setting },
            measured: measured.clone(),
            lines: lines.into_iter().enumerate().collect(),
            sound_lines: None,
        };
        // Noise of 1 m/s²: a line stands out from 0.09 m/s² on.
        let levels = [1.0, 1.0];
        let sound = rig(None, [[0.01, 0.1, 0.1, 0.0], [0.001; HARMONICS]]);
        let hear = |lines| rig(Some(1), lines).beside(Some(&sound)).hear_defect(&levels).unwrap();
        let high = hear([[0.3, 0.2, 0.15, 0.05], [0.5, 0.08, 0.08, 0.08]]);
        assert!(high.is_visible);
        assert!((high.over_sound.unwrap() - 2.0).abs() < 1e-9, "of 30, 2 and 1.5: {high:?}");
        let other = hear([[0.3, 0.2, 0.15, 0.05], [0.5, 0.4, 0.0, 0.0]]);
        assert!((other.over_sound.unwrap() - 400.0).abs() < 1e-9, "the other channel: {other:?}");
        let low = hear([[0.3, 0.08, 0.08, 0.08], [0.0; HARMONICS]]);
        assert_eq!(low, Heard { is_visible: false, over_sound: None });
        let other_load =
            Rig { setting: Setting { torque_nm: 2.0, ..sound.setting }, ..sound.clone() };
        let lines = [[0.3, 0.2, 0.15, 0.05], [0.0; HARMONICS]];
        let alone = rig(Some(1), lines).beside(Some(&other_load)).hear_defect(&levels).unwrap();
        assert_eq!(alone, Heard { is_visible: true, over_sound: None });
        assert_eq!(sound.hear_defect(&levels), None);
    }

    #[test]
    #[ignore = "two simulations of ten seconds: minutes in the dev profile"]
    fn a_race_is_named_between_the_blows_of_a_worn_tooth_and_a_sound_one_is_not() {
        // The tooth's blows are most of what is heard, and elements modulate them at the race's own rate and its side bands' (F12).
        let judged = |bearing| {
            let bad = Bad { gear: true, shaft: false, bearing };
            let speed = Hz(10.0);
            let setting = Setting { bad, speed, clearance_um: 8.0, torque_nm: 1.0, seed: 3 };
            let trial = Rig::simulate(&setting).unwrap().trial("", Some(20.0), None).unwrap();
            let diagnosis = trial.diagnose().unwrap().unwrap();
            ["left", "right"].map(|id| {
                let verdict = diagnosis.components.iter().find(|c| c.id == id).unwrap();
                (verdict.state.is_accusation(), verdict.fault, verdict.why.clone())
            })
        };
        let [left, right] = judged(Some(1));
        assert!(!left.0, "{left:?}");
        assert_eq!(right.1, Some(FaultMode::InnerRace), "{right:?}");
        assert!(right.2.contains("between the shaft's events"), "{right:?}");
        for sound in judged(None) {
            assert!(!sound.0, "{sound:?}");
        }
    }

    #[test]
    #[ignore = "three simulations of ten seconds: minutes in the dev profile"]
    fn a_race_is_struck_beside_a_shaft_that_is_bent_far_and_a_sound_one_is_not() {
        // At half the critical speed the accelerometers are at the ends of their range, and the shaft moves in thirteenths of a turn.
        let (bad, speed) = (Bad::NOTHING, Hz(60.0));
        let setting = Setting { bad, speed, clearance_um: 2.0, torque_nm: 1.0, seed: 3 };
        let twin = Rig::healthy_twin(&setting).unwrap();
        for (lead, state, _) in beside_a_bow(None, &twin) {
            assert!(lead < 2.0 && !state.is_accusation(), "{lead} {state:?}");
        }
        let [left, right] = beside_a_bow(Some(2), &twin);
        assert!(!left.1.is_accusation(), "{left:?}");
        assert!(right.0 > 4.0, "{right:?}");
        assert_eq!((right.1, right.2), (State::Warning, Some(FaultMode::InnerRace)));
    }
}
