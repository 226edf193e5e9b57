//! Trials of runs: the built-in scene `run-up` with other numbers, from 5 Hz to a quarter, half or three quarters of
//! its critical speed in 15 s and 5 s there, its shaft straight, bent or out of balance; held against a run of the
//! straight one with another seed (T12).

use super::Measured;
use super::Trial;
use super::simulated::NotMade;
use super::simulated::measure;
use super::simulated::table;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::fault::FaultMode;
use crate::evaluation::truth::Known;
use crate::evaluation::truth::KnownFault;
use crate::simulator::scene::builtin;
use crate::units::Hz;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use toml::Table;
use toml::Value;

/// Scene that every run is made of, and its shaft.
const SCENE: &str = "run-up";
const SHAFT: &str = "main";

/// Speeds at which runs end.
pub const ENDS: [Hz; 3] = [Hz(30.0), Hz(60.0), Hz(90.0)];

/// Speed at which they begin, how long they run up, and how long all takes, s.
const BEGIN: Hz = Hz(5.0);
const RUN_UP_S: f64 = 15.0;
const DURATION_S: f64 = 20.0;

/// Eccentricity of the discs that the baseline has, and that of a slight unbalance, three times as much, µm.
const USUAL_UM: f64 = 5.0;
const SLIGHT_UM: f64 = 15.0;

/// Amplitude of a slight bend, mil.
const SLIGHT_MIL: f64 = 0.1;

/// State of the shaft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shaft {
    /// Straight, its discs eccentric by 3 to 7 µm.
    Sound,
    /// Bent by 0.4 to 2 mil.
    Bent,
    /// Bent by 0.1 mil, which the unbalance of a long run exceeds.
    SlightlyBent,
    /// Discs eccentric by 40 to 90 µm.
    Unbalanced,
    /// Discs eccentric by 15 µm.
    SlightlyUnbalanced,
}

impl Shaft {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Sound, Self::Bent, Self::SlightlyBent, Self::Unbalanced, Self::SlightlyUnbalanced];

    /// Name, for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sound => "healthy",
            Self::Bent => "bow",
            Self::SlightlyBent => "slight bow",
            Self::Unbalanced => "unbalance",
            Self::SlightlyUnbalanced => "slight unbalance",
        }
    }

    fn fault(self) -> Option<FaultMode> {
        match self {
            Self::Sound => None,
            Self::Bent | Self::SlightlyBent => Some(FaultMode::Bow),
            Self::Unbalanced | Self::SlightlyUnbalanced => Some(FaultMode::Unbalance),
        }
    }
}

/// A machine and its run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Speed at which the run ends.
    pub end: Hz,
    /// Whether the machine file states the critical speed.
    pub is_declared: bool,
    /// Draws the rest.
    pub seed: u64,
}

/// What is drawn of a run.
#[derive(Debug, Clone, Copy)]
struct Drawn {
    clearance_um: f64,
    eccentricity_um: f64,
    eccentricity_deg: f64,
    bow_mil: Option<f64>,
    bow_deg: f64,
}

impl Drawn {
    fn of(setting: &Setting, shaft: Shaft) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(setting.seed ^ 0x0072_756e_7570);
        let mut even = |low: f64, high: f64| low * (high / low).powf(random.random::<f64>());
        let (usual, bow, unbalance) = (even(3.0, 7.0), even(0.4, 2.0), even(40.0, 90.0));
        let clearance_um = if random.random() { 2.0 } else { 8.0 };
        let (eccentricity_deg, bow_deg) =
            (random.random_range(0.0..360.0), random.random_range(0.0..360.0));
        let (eccentricity_um, bow_mil) = match shaft {
            Shaft::Sound => (usual, None),
            Shaft::Bent => (usual, Some(bow)),
            Shaft::SlightlyBent => (usual, Some(SLIGHT_MIL)),
            Shaft::Unbalanced => (unbalance, None),
            Shaft::SlightlyUnbalanced => (SLIGHT_UM, None),
        };
        Self { clearance_um, eccentricity_um, eccentricity_deg, bow_mil, bow_deg }
    }

    /// The straight shaft of this machine, as its baseline has it.
    fn usual(setting: &Setting) -> Self {
        let drawn = Self::of(setting, Shaft::Sound);
        Self { eccentricity_um: USUAL_UM, eccentricity_deg: 0.0, ..drawn }
    }
}

/// The run that a machine's others are held against.
///
/// # Errors
/// When the scene cannot be simulated or no sensor of the machine has a channel.
pub fn baseline(setting: &Setting) -> Result<Baseline, NotMade> {
    let name = format!("healthy run, {setting:?}");
    let twin = run(&name, setting, &Drawn::usual(setting), setting.seed + 1_000_000)?;
    let record = twin.learn("healthy").map_err(|e| NotMade { name, why: e.to_string() })?;
    Ok(Baseline { records: vec![record], provisional: false })
}

/// The trial of a run with a shaft like this.
///
/// # Errors
/// When the scene cannot be simulated.
pub fn trial(setting: &Setting, shaft: Shaft, baseline: &Baseline) -> Result<Trial, NotMade> {
    let declared = if setting.is_declared { "declared" } else { "not declared" };
    let label = shaft.name();
    let group = format!("run-up, {label}, critical speed {declared}");
    let name = format!("{group}, {setting:?}");
    let known = |fault| KnownFault { fault, component: Some(SHAFT.to_owned()) };
    Ok(Trial {
        group,
        label: label.to_owned(),
        known: Known::Faults(shaft.fault().map(known).into_iter().collect()),
        speed: setting.end,
        is_visible: None,
        over_sound: None,
        measured: run(&name, setting, &Drawn::of(setting, shaft), setting.seed)?,
        baseline: baseline.clone(),
        name,
    })
}

fn run(name: &str, setting: &Setting, drawn: &Drawn, seed: u64) -> Result<Measured, NotMade> {
    let texts = texts(setting, drawn);
    let missing = || NotMade { name: name.to_owned(), why: "no built-in scene".to_owned() };
    let (scene, machine) = texts.ok_or_else(missing)?;
    measure(name, &scene, &machine, seed)
}

/// Scene and machine file of a run.
fn texts(setting: &Setting, drawn: &Drawn) -> Option<(String, String)> {
    let mut scene: Table = builtin::text(SCENE)?.parse().ok()?;
    table(&mut scene, "scene")?.insert("duration_s".to_owned(), DURATION_S.into());
    let points = [(0.0, BEGIN), (RUN_UP_S, setting.end), (DURATION_S, setting.end)];
    let points = points.map(|(time_s, speed)| Value::from(vec![time_s, speed.0]));
    table(&mut scene, "speed")?.insert("points".to_owned(), points.to_vec().into());
    for disc in scene.get_mut("disc")?.as_array_mut()? {
        let disc = disc.as_table_mut()?;
        disc.insert("eccentricity_um".to_owned(), drawn.eccentricity_um.into());
        disc.insert("eccentricity_deg".to_owned(), drawn.eccentricity_deg.into());
    }
    for bearing in scene.get_mut("bearing")?.as_array_mut()? {
        let clearance = ("clearance_um".to_owned(), drawn.clearance_um.into());
        bearing.as_table_mut()?.extend([clearance]);
    }
    if let Some(mil) = drawn.bow_mil {
        let mut bow = Table::new();
        bow.insert("shape".to_owned(), "half_sine".into());
        bow.insert("amplitude_mil".to_owned(), mil.into());
        bow.insert("angle_deg".to_owned(), drawn.bow_deg.into());
        scene.insert("bow".to_owned(), bow.into());
    }
    let machine = table(&mut scene, "machine")?.remove("text")?;
    scene.remove("machine");
    let mut machine: Table = machine.as_str()?.parse().ok()?;
    for shaft in machine.get_mut("shaft")?.as_array_mut()? {
        let shaft = shaft.as_table_mut()?;
        shaft.insert("speed_hz".to_owned(), setting.end.0.into());
        if !setting.is_declared {
            shaft.remove("first_critical_hz");
        }
    }
    Some((scene.to_string(), machine.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;
    use crate::simulator::scene::BowShape;
    use crate::simulator::scene::Scene;

    #[test]
    #[ignore = "four simulations of twenty seconds: a minute in the dev profile"]
    fn a_run_to_a_quarter_of_the_critical_speed_tells_bow_from_unbalance() {
        let setting = Setting { end: ENDS[0], is_declared: true, seed: 4 };
        let baseline = baseline(&setting).unwrap();
        for shaft in [Shaft::Sound, Shaft::Bent, Shaft::Unbalanced] {
            let diagnosis = trial(&setting, shaft, &baseline).unwrap().diagnose().unwrap().unwrap();
            let accused = diagnosis.components.iter().filter(|c| c.state.is_accusation());
            let accused: Vec<_> = accused.map(|c| (c.id.as_str(), c.fault)).collect();
            let known = shaft.fault().map(|fault| (SHAFT, Some(fault)));
            assert_eq!(accused, known.into_iter().collect::<Vec<_>>(), "{shaft:?}");
        }
    }

    #[test]
    fn a_run_has_the_numbers_that_were_drawn_and_states_the_critical_speed_if_declared() {
        for (shaft, is_declared) in
            [(Shaft::SlightlyBent, true), (Shaft::SlightlyUnbalanced, false)]
        {
            let setting = Setting { end: ENDS[1], is_declared, seed: 3 };
            let (scene, machine) = texts(&setting, &Drawn::of(&setting, shaft)).unwrap();
            let machine = file::parse(&machine, SCENE).unwrap();
            assert_eq!(machine.shafts[0].first_critical.is_some(), is_declared);
            let scene = Scene::parse(&scene, SCENE).unwrap();
            assert_eq!(scene.duration_s.to_bits(), DURATION_S.to_bits());
            assert_eq!(scene.bow.is_some(), shaft == Shaft::SlightlyBent);
            if let Some(bow) = scene.bow {
                let (sound, _) = texts(&setting, &Drawn::usual(&setting)).unwrap();
                assert!(Scene::parse(&sound, SCENE).unwrap().bow.is_none());
                let BowShape::HalfSine { amplitude_m } = bow.shape else { panic!("half a sine") };
                assert!((amplitude_m - 2.54e-6).abs() < 1e-12, "0.1 mil: {amplitude_m}");
            } else {
                assert!((scene.discs[0].eccentricity_m - 15e-6).abs() < 1e-12);
            }
        }
    }
}
