//! Modes and attachment shapes: what leaving shapes out does to what sensors see, and what it saves.
//!
//! Held against all shapes of the same finite elements, both in steps so short that not even the fastest shape appears at
//! another frequency: the difference is that of the reduction alone. Sensors see means of the acceleration over two
//! steps; points of one that jumps would fold what lies beyond their filters into their band.

use crate::bench::clock::{self, Yardstick};
use crate::bench::records::{Record, mean_accelerations, port_run, stepped, steps, worst};
use crate::bench::scenes::{A3, D0, D3, Rig};
use crate::bench::table::{Cell, Column};
use crate::bench::{BenchError, Tell};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use crate::simulator::reference::scene::Setting;
use crate::simulator::scene::Scene;
use cpu_time::ThreadTime;
use serde_json::{Value, json};

/// The columns of the table.
pub const COLUMNS: [Column; 10] = [
    Column { name: "scene", width: 18 },
    Column { name: "modes", width: 5 },
    Column { name: "attachments", width: 11 },
    Column { name: "automatic", width: 9 },
    Column { name: "highest_hz", width: 10 },
    Column { name: "error_bearings", width: 14 },
    Column { name: "error_sensors", width: 13 },
    Column { name: "cpu_s_per_s", width: 11 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "cost_over_automatic", width: 19 },
];

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Scenes, the first of the list.
    pub n_scenes: usize,
    /// Numbers of modes, each with attachment shapes and without.
    pub modes: &'static [usize],
    /// Accuracies of which the automatic choice is shown.
    pub accuracies: &'static [f64],
    /// Length of the record, s.
    pub seconds: f64,
    /// Its steps, s.
    pub step_s: f64,
    /// Length of the run that is timed, s.
    pub timed_s: f64,
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self {
        n_scenes: usize::MAX,
        modes: &[6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40],
        accuracies: &[1e-3, 1e-4, 1e-5, 1e-6],
        seconds: 0.03,
        step_s: 2e-6,
        timed_s: 1.0,
    };

    /// A minute of work, for every change.
    pub const THINNED: Self = Self {
        n_scenes: 1,
        modes: &[8, 14],
        accuracies: &[1e-3, 1e-4],
        seconds: 0.02,
        timed_s: 0.05,
        ..Self::WHOLE
    };

    /// A second of work: shows that it works.
    pub const QUICK: Self =
        Self { modes: &[10], accuracies: &[1e-4], seconds: 0.002, ..Self::THINNED };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({ "seconds": self.seconds, "step_s": self.step_s, "timed_s": self.timed_s, "timed_step_s": TIMED_STEP_S })
    }
}

/// Step of the runs that are timed, s.
const TIMED_STEP_S: f64 = 10e-6;

/// A choice of shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Choice {
    /// Modes; `None`: as they are chosen for the accuracy.
    n_modes: Option<usize>,
    has_attachments: bool,
    accuracy: f64,
}

/// What came of it.
struct Point {
    choice: Choice,
    setting: Setting,
    record: Record,
    cpu_s_per_s: f64,
    /// The same in yardsticks of the same time.
    yardsticks: f64,
}

/// Measures every choice and hands on its row.
///
/// # Errors
///
/// [`BenchError`] when a scene cannot be built.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let mut rows = Vec::new();
    let scenes = [("A, bearing 3", A3), ("D, bearing 3", D3), ("D, bearing 0", D0)];
    for (name, rig) in scenes.into_iter().take(effort.n_scenes) {
        let scene = Rig { modes: "damping = 0.002\nelements_per_span = 4", ..rig }.scene()?;
        let point = |choice: Choice| point(&scene, choice, effort);
        let automatic = |accuracy: &f64| {
            point(Choice { n_modes: None, has_attachments: true, accuracy: *accuracy })
        };
        let chosen: Vec<Point> =
            effort.accuracies.iter().map(automatic).collect::<Result<_, _>>()?;
        let n_dof = chosen.first().map_or(0, |point| point.setting.plan.n_dof);
        let all = Choice { n_modes: Some(n_dof), has_attachments: false, accuracy: scene.accuracy };
        let all = self::record(&scene, all, effort)?.1;
        // The choice of the scene's own accuracy, if it is among them.
        let usual =
            chosen.iter().find(|point| point.choice.accuracy.total_cmp(&scene.accuracy).is_eq());
        let usual_s = usual.map(|point| point.cpu_s_per_s);
        let both = |n_modes: &usize| {
            [true, false].map(|has_attachments| Choice {
                n_modes: Some(*n_modes),
                has_attachments,
                accuracy: scene.accuracy,
            })
        };
        let further = effort.modes.iter().flat_map(both).map(&point);
        for point in chosen.into_iter().map(Ok).chain(further) {
            let row = row(name, &point?, &all, usual_s);
            tell(&row)?;
            rows.push(row);
        }
    }
    Ok(rows)
}

fn record(scene: &Scene, choice: Choice, effort: &Effort) -> Result<(Setting, Record), BenchError> {
    let mut scene = scene.clone();
    (scene.modes.count, scene.accuracy) = (choice.n_modes, choice.accuracy);
    scene.modes.attachment = choice.has_attachments;
    let setting = Setting::new(&scene)?;
    let record = stepped(&setting, effort.step_s, effort.seconds, true);
    let record = mean_accelerations(&setting, effort.step_s, &record);
    Ok((setting, record))
}

fn point(scene: &Scene, choice: Choice, effort: &Effort) -> Result<Point, BenchError> {
    let (setting, record) = record(scene, choice, effort)?;
    let none = BenchError::Absent { case: "shapes", what: "fast way" };
    let mut run = port_run(&setting, TIMED_STEP_S, false).ok_or(none)?;
    let mut values = vec![Vec::new(); run.n_watches()];
    let begun = ThreadTime::now();
    run.fill(steps(effort.timed_s, TIMED_STEP_S), &mut values);
    let cpu_s_per_s = begun.elapsed().as_secs_f64() / effort.timed_s;
    let yardsticks = cpu_s_per_s / clock::round_s(&mut Yardstick::new(), 0.02);
    Ok(Point { choice, setting, record, cpu_s_per_s, yardsticks })
}

fn row(name: &str, point: &Point, all: &Record, usual_s: Option<f64>) -> Vec<Cell> {
    let plan = &point.setting.plan;
    let automatic = match point.choice.n_modes {
        None => Cell::Number(point.choice.accuracy, 0),
        Some(_) => Cell::Text(String::new()),
    };
    vec![
        Cell::Text(name.to_owned()),
        Cell::Plain(plan.n_modes as f64, 0),
        Cell::Plain(plan.n_attachments as f64, 0),
        automatic,
        Cell::Plain(plan.highest_hz, 0),
        Cell::Number(worst(&point.record.bearings, &all.bearings), 1),
        Cell::Number(worst(&point.record.sensors, &all.sensors), 1),
        Cell::Number(point.cpu_s_per_s, 2),
        Cell::Plain(point.yardsticks, 0),
        usual_s.map_or(Cell::Text(String::new()), |s| Cell::Plain(point.cpu_s_per_s / s, 2)),
    ]
}

/// Choices whose error in what sensors see is above the accuracy they were made for.
#[must_use]
pub fn n_missed(rows: &[Vec<Cell>]) -> usize {
    let is_missed = |row: &&Vec<Cell>| match (&row[3], &row[6]) {
        (Cell::Number(accuracy, _), Cell::Number(error, _)) => error.is_nan() || error > accuracy,
        _ => false,
    };
    rows.iter().filter(is_missed).count()
}

/// Error against the number of shapes, a line a scene, with attachment shapes and without.
#[must_use]
pub fn plot(rows: &[Vec<Cell>]) -> Option<String> {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let [
            Cell::Text(scene),
            Cell::Plain(n_modes, _),
            Cell::Plain(n_attachments, _),
            Cell::Text(_),
            ..,
            Cell::Number(error, _),
            _,
            _,
            _,
        ] = &row[..]
        else {
            continue;
        };
        let which = if *n_attachments > 0.0 { "with attachment" } else { "modes alone" };
        let (name, place) = (format!("{scene}, {which}"), (n_modes + n_attachments, *error));
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(place),
            None => series.push(Series { name, points: vec![place] }),
        }
    }
    let words = Words {
        title: "Simulator: error against shapes",
        x: "shapes of each plane",
        y: "largest error ÷ largest value, as sensors see it",
    };
    log_log::log_log(&words, &series)
}
