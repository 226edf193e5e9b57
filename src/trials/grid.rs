//! The grid: which trials are made, for one range of seeds.
//!
//! Rules are set on seeds below 1000 and reported on those from 1000 on.

use super::Trial;
use super::defect::Defect;
use super::drawn;
use super::drawn::plant::Kind;
use super::gears;
use super::motion::Motion;
use super::motion::SLOW_SWING_S;
use super::rig;
use super::rig::Bad;
use super::rig::Rig;
use super::runs;
use super::runs::Shaft;
use super::stand;
use super::stand::Disturbance;
use crate::units::Hz;
use std::ops::ControlFlow;

/// First seed that figures are reported on.
pub const FIRST_REPORTED_SEED: u64 = 1000;

/// A part of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The motor stand.
    Stand,
    /// Machines drawn at random.
    Drawn,
    /// The same, slower and faster than most.
    Paces,
    /// Machines drawn at random whose bearings, two to four, are of one type.
    Alike,
    /// Machines drawn at random whose speed swings within a few revolutions.
    Swinging,
    /// Gear pairs.
    Gears,
    /// Runs of the simulated rotor.
    Runs,
    /// The simulated rig.
    Rig,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Stand,
        Self::Drawn,
        Self::Paces,
        Self::Alike,
        Self::Swinging,
        Self::Gears,
        Self::Runs,
        Self::Rig,
    ];

    /// Name of the part.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stand => "stand",
            Self::Drawn => "drawn",
            Self::Paces => "paces",
            Self::Alike => "alike",
            Self::Swinging => "swinging",
            Self::Gears => "gears",
            Self::Runs => "runs",
            Self::Rig => "rig",
        }
    }
}

/// What of the grid is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// First seed.
    pub first_seed: u64,
    /// Seeds of each cell of the stand; the rig and, beside other parts, the runs take the first.
    pub n_seeds: u64,
    /// One speed, clearance, load, size and noise of the rig instead of all, and drawn machines at usual, even speeds, with
    /// bearings that differ, only.
    pub is_thin: bool,
    /// Only machines in good health.
    pub is_healthy: bool,
    /// This part instead of all.
    pub part: Option<Part>,
}

/// What of the grid is made on its own.
#[derive(Debug, Clone)]
pub enum Task {
    /// One record of the stand, with the name of its group.
    Stand(String, stand::Setting),
    /// One record of a machine drawn at random, with the name of its group.
    Drawn(String, drawn::Setting),
    /// One record of a gear pair.
    Gears(gears::Setting),
    /// Runs of one machine with shafts like these.
    Runs {
        /// The machine and how it runs up.
        setting: runs::Setting,
        /// States of its shaft.
        shafts: Vec<Shaft>,
    },
    /// All combinations of the rig at one speed, clearance and load, at these strengths of noise.
    Rig {
        /// Setting of the healthy twin.
        healthy: rig::Setting,
        /// Noise below the vibration, dB.
        noise_db: Vec<Option<f64>>,
        /// At which of it the rig is tried without its tacho too.
        no_tacho_db: &'static [f64],
        /// Combinations.
        bad: Vec<Bad>,
    },
}

/// Motions of the stand's trials and whether there is a tacho.
const MOTIONS: [(&str, Motion, bool); 5] = [
    ("steady", Motion::Steady, false),
    ("wander of 0.3 %", Motion::Wander(0.003), false),
    ("wander of 0.3 %, tacho", Motion::Wander(0.003), true),
    ("swing of 10 %, tacho", Motion::Swing(0.1, SLOW_SWING_S), true),
    ("run-up to the double, tacho", Motion::Ramp(0.55, 1.1), true),
];

/// Strengths of a defect over the noise, dB.
const DEFECT_DB: [f64; 4] = [-10.0, -5.0, 0.0, 5.0];

/// Clearance, µm (below 0: preload), and mesh load, N·m, of the rig.
const LOADS: [(f64, f64); 6] =
    [(2.0, 1.0), (2.0, 2.0), (8.0, 1.0), (8.0, 2.0), (-2.0, 1.0), (-2.0, 2.0)];

/// Noise below the vibration, dB, at which the rig is tried without its tacho too, and how far the written speed is
/// off then, to either side.
const NO_TACHO_NOISE_DB: [f64; 1] = [20.0];
const WRITTEN_SPEED_ERROR: f64 = 0.02;

/// All tasks of a plan, in order.
#[must_use]
pub fn tasks(plan: &Plan) -> Vec<Task> {
    let has = |part: Part| plan.part.is_none_or(|only| only == part);
    let mut tasks = Vec::new();
    if has(Part::Stand) {
        tasks.extend(stand_tasks(plan));
    }
    if has(Part::Drawn) {
        tasks.extend(drawn_tasks(plan, Kind::Usual));
    }
    if has(Part::Paces) && !plan.is_thin {
        tasks.extend([Kind::Slow, Kind::Fast].into_iter().flat_map(|kind| drawn_tasks(plan, kind)));
    }
    if has(Part::Alike) && !plan.is_thin {
        tasks.extend(drawn_tasks(plan, Kind::Alike));
    }
    if has(Part::Swinging) && !plan.is_thin {
        tasks.extend(drawn_tasks(plan, Kind::Swinging));
    }
    if has(Part::Gears) {
        tasks.extend(gear_tasks(plan));
    }
    if has(Part::Runs) && !plan.is_thin {
        tasks.extend(run_tasks(plan));
    }
    if has(Part::Rig) {
        tasks.extend(rig_tasks(plan));
    }
    tasks
}

fn stand_tasks(plan: &Plan) -> Vec<Task> {
    let mut tasks = Vec::new();
    for (name, motion, has_tacho) in MOTIONS {
        for seed in plan.first_seed..plan.first_seed + plan.n_seeds {
            let healthy = stand::Setting {
                defect: None,
                defect_db: 0.0,
                disturbance: Disturbance::None,
                motion,
                has_tacho,
                seed,
            };
            tasks.extend(Disturbance::ALL.map(|disturbance| {
                let setting = stand::Setting { disturbance, ..healthy };
                Task::Stand(format!("stand, {name}"), setting)
            }));
            let defects_db = if plan.is_healthy { &[][..] } else { &DEFECT_DB[..] };
            for &defect_db in defects_db {
                tasks.extend(Defect::ALL.map(|defect| {
                    let setting = stand::Setting { defect: Some(defect), defect_db, ..healthy };
                    Task::Stand(format!("stand, {name}, defect {defect_db} dB"), setting)
                }));
            }
        }
    }
    tasks
}

/// Strengths of a drawn machine's defect over its noise, dB.
const DRAWN_DB: [(f64, f64); 4] = [(-10.0, -5.0), (-5.0, 0.0), (0.0, 5.0), (5.0, 10.0)];

/// As many sound machines as damaged ones are drawn.
fn drawn_tasks(plan: &Plan, kind: Kind) -> Vec<Task> {
    let of = kind.group();
    let strengths = if plan.is_thin { &DRAWN_DB[2..3] } else { &DRAWN_DB[..] };
    let mut tasks = Vec::new();
    for seed in plan.first_seed..plan.first_seed + plan.n_seeds {
        let defects = strengths.iter().flat_map(|db| Defect::ALL.map(|defect| (defect, *db)));
        let mut number = 0;
        for (defect, db) in defects {
            let sound = drawn::Setting { kind, defect: None, number, seed };
            tasks.push(Task::Drawn(format!("{of}, sound"), sound));
            if !plan.is_healthy {
                let group = format!("{of}, defect {} to {} dB", db.0, db.1);
                let damaged =
                    drawn::Setting { kind, defect: Some((defect, db)), number: number + 1, seed };
                tasks.push(Task::Drawn(group, damaged));
            }
            number += 2;
        }
    }
    tasks
}

/// Whether the gears' trials have a tacho, and a baseline.
const GEARS_HAVE: [(bool, bool); 3] = [(true, true), (false, true), (true, false)];

fn gear_tasks(plan: &Plan) -> Vec<Task> {
    let mut tasks = Vec::new();
    for model in [gears::Model::Modulation, gears::Model::Stiffness] {
        for (has_tacho, has_baseline) in GEARS_HAVE {
            for seed in plan.first_seed..plan.first_seed + plan.n_seeds {
                let controls = gears::controls(model).filter(|_| has_baseline);
                let kinds = gears::kinds(model).iter().copied().chain(controls);
                tasks.extend(kinds.filter(|k| k.is_healthy() || !plan.is_healthy).map(|kind| {
                    Task::Gears(gears::Setting { model, kind, has_tacho, has_baseline, seed })
                }));
            }
        }
    }
    tasks
}

/// Every second machine file states the critical speed. Simulated as the rig is: of the whole grid the first seed only.
fn run_tasks(plan: &Plan) -> Vec<Task> {
    let n_seeds = if plan.part.is_some() { plan.n_seeds } else { 1 };
    let shafts: Vec<Shaft> = if plan.is_healthy { vec![Shaft::Sound] } else { Shaft::ALL.to_vec() };
    let seeds = plan.first_seed..plan.first_seed + n_seeds;
    let settings = seeds.flat_map(|seed| {
        (0_u64..).zip(runs::ENDS).map(move |(at, end)| runs::Setting {
            end,
            is_declared: (seed + at).is_multiple_of(2),
            seed,
        })
    });
    settings.map(|setting| Task::Runs { setting, shafts: shafts.clone() }).collect()
}

fn rig_tasks(plan: &Plan) -> Vec<Task> {
    let (speeds, loads) = if plan.is_thin {
        (vec![10.0], vec![(2.0, 2.0)])
    } else {
        (vec![5.0, 10.0, 20.0, 40.0, 60.0], LOADS.to_vec())
    };
    let sizes: Vec<Option<u8>> =
        if plan.is_thin { vec![None, Some(3)] } else { vec![None, Some(1), Some(2), Some(3)] };
    let noise_db =
        if plan.is_thin { vec![Some(6.0)] } else { vec![None, Some(20.0), Some(6.0), Some(0.0)] };
    let mut bad = Vec::new();
    for gear in [false, true] {
        for shaft in [false, true] {
            bad.extend(sizes.iter().map(|bearing| Bad { gear, shaft, bearing: *bearing }));
        }
    }
    if plan.is_healthy {
        bad.retain(|bad| *bad == Bad::NOTHING);
    }
    let mut tasks = Vec::new();
    for speed in &speeds {
        for (clearance_um, torque_nm) in &loads {
            tasks.push(Task::Rig {
                healthy: rig::Setting {
                    bad: Bad::NOTHING,
                    speed: Hz(*speed),
                    clearance_um: *clearance_um,
                    torque_nm: *torque_nm,
                    seed: plan.first_seed,
                },
                noise_db: noise_db.clone(),
                no_tacho_db: if plan.is_thin { &[] } else { &NO_TACHO_NOISE_DB },
                bad: bad.clone(),
            });
        }
    }
    tasks
}

/// Takes a trial, or why it could not be made, and says whether it has had enough.
pub type Sink<'s> = &'s mut dyn FnMut(Result<Trial, String>) -> ControlFlow<()>;

impl Task {
    /// Trials that [`Self::each`] makes, if all can be made.
    #[must_use]
    pub fn n_trials(&self) -> usize {
        match self {
            Self::Stand(..) | Self::Drawn(..) | Self::Gears(_) => 1,
            Self::Runs { shafts, .. } => shafts.len(),
            Self::Rig { noise_db, no_tacho_db, bad, .. } => {
                let is_tried =
                    |noise: &&Option<f64>| noise.is_some_and(|db| no_tacho_db.contains(&db));
                let without_tacho = noise_db.iter().filter(is_tried).count();
                bad.len() * 2 * (noise_db.len() + 2 * without_tacho)
            }
        }
    }

    /// Makes the part's trials one after another, until the sink has had enough. What cannot be made is handed on as a sentence.
    pub fn each(&self, sink: Sink<'_>) -> ControlFlow<()> {
        match self {
            Self::Stand(group, setting) => {
                sink(stand::trial(group, setting).map_err(|e| e.to_string()))
            }
            Self::Drawn(group, setting) => {
                sink(drawn::trial(group, setting).map_err(|e| e.to_string()))
            }
            Self::Runs { setting, shafts } => match runs::baseline(setting) {
                Ok(baseline) => shafts.iter().try_for_each(|shaft| {
                    sink(runs::trial(setting, *shaft, &baseline).map_err(|e| e.to_string()))
                }),
                Err(error) => sink(Err(error.to_string())),
            },
            Self::Gears(setting) => sink(gears::trial(setting).map(|(trial, _)| trial)),
            Self::Rig { healthy, noise_db, no_tacho_db, bad } => match Rig::healthy_twin(healthy) {
                Ok(twin) => each_rig((healthy, &twin), bad, (noise_db, no_tacho_db), sink),
                Err(error) => sink(Err(error.to_string())),
            },
        }
    }
}

fn each_rig(
    (healthy, twin): (&rig::Setting, &Rig),
    bad: &[Bad],
    noise_db: (&[Option<f64>], &[f64]),
    sink: Sink<'_>,
) -> ControlFlow<()> {
    // Each damaged bearing comes after the same rig without its defect.
    let mut sound: Option<Rig> = None;
    for bad in bad {
        let rig = match Rig::simulate(&rig::Setting { bad: *bad, ..*healthy }) {
            Ok(rig) => rig.beside(sound.as_ref()),
            Err(error) => {
                sink(Err(error.to_string()))?;
                continue;
            }
        };
        each_noise(&rig, twin, noise_db, sink)?;
        if bad.bearing.is_none() {
            sound = Some(rig);
        }
    }
    ControlFlow::Continue(())
}

fn each_noise(
    rig: &Rig,
    twin: &Rig,
    (noise_db, no_tacho_db): (&[Option<f64>], &[f64]),
    sink: Sink<'_>,
) -> ControlFlow<()> {
    for noise in noise_db {
        let level = noise.map_or("no noise".to_owned(), |db| format!("noise {db} dB below"));
        for (baseline, twin) in [("no baseline", None), ("baseline", Some(twin))] {
            let group = format!("rig, {level}, {baseline}");
            sink(rig.trial(&group, *noise, twin).map_err(|e| e.to_string()))?;
            if noise.is_none_or(|db| !no_tacho_db.contains(&db)) {
                continue;
            }
            for (name, error) in [("low", -WRITTEN_SPEED_ERROR), ("high", WRITTEN_SPEED_ERROR)] {
                let group = format!("{group}, no tacho, speed 2 % {name}");
                let trial = rig.trial(&group, *noise, twin).map_err(|e| e.to_string());
                sink(trial.map(|trial| trial.without_tacho(error)))?;
            }
        }
    }
    ControlFlow::Continue(())
}
