//! Speed against error of the simulator: classes of scenes at several accuracies asked for.
//!
//! `error` compares the beginning of a record, its start included, with the reference, `cost` measures processor time, `precision` compares methods and
//! steps, those of others (`steppers`) among them, `shapes` compares numbers of shapes, `parts` tells what each part of a model costs.

mod cost;
mod error;
pub mod precision;
pub mod shapes;
pub mod parts;
mod steppers;

use super::scenes::{self, A3};
use super::table::{Cell, Column};
use super::{BenchError, Tell};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use crate::simulator::scene::builtin;
use crate::simulator::scene::{Scene, Start};
use crate::simulator::simulation::Simulation;
pub use cost::Cost;
use serde_json::{Value, json};
use std::error::Error;

/// Writes the whole scene of a simulation into a capture.
pub type Record<'a> = dyn FnMut(&mut Simulation) -> Result<(), Box<dyn Error + Send + Sync>> + 'a;

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Accuracies asked for.
    pub accuracies: &'static [f64],
    /// Scenes, the first of the list.
    pub n_scenes: usize,
    /// Length of the record that is compared, s.
    pub compared_s: f64,
    /// Tolerance of the reference, and the looser one that tells what the reference errs.
    pub tolerances: [f64; 2],
    /// Repeats of each measurement of time.
    pub n_repeats: usize,
    /// Processor time of a repeat, s, about.
    pub repeat_s: f64,
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self {
        accuracies: &[1e-3, 1e-4, 1e-5, 1e-6],
        n_scenes: usize::MAX,
        compared_s: 0.1,
        tolerances: [1e-12, 1e-10],
        n_repeats: 7,
        repeat_s: 0.2,
    };

    /// Minutes of work, for every change: the errors of every class.
    pub const THINNED: Self = Self {
        accuracies: &[1e-3, 1e-5],
        compared_s: 0.02,
        n_repeats: 1,
        repeat_s: 0.005,
        ..Self::WHOLE
    };

    /// Seconds of work: shows that it works.
    pub const QUICK: Self = Self {
        accuracies: &[1e-3, 1e-4],
        n_scenes: 2,
        compared_s: 0.01,
        tolerances: [1e-11, 1e-9],
        n_repeats: 3,
        repeat_s: 0.005,
    };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "compared_s": self.compared_s,
            "reference_tolerance": self.tolerances[0],
            "reference_looser_tolerance": self.tolerances[1],
            "repeats": self.n_repeats,
        })
    }
}

/// The columns of the table.
pub const COLUMNS: [Column; 18] = [
    Column { name: "scene", width: 24 },
    Column { name: "requested", width: 9 },
    Column { name: "step_us", width: 8 },
    Column { name: "shapes", width: 6 },
    Column { name: "error", width: 8 },
    Column { name: "error_bearings", width: 8 },
    Column { name: "error_sensors", width: 8 },
    Column { name: "error_step_us", width: 0 },
    Column { name: "reference_error", width: 8 },
    Column { name: "expected_error", width: 0 },
    Column { name: "setup_cpu_s", width: 8 },
    Column { name: "cpu_s_per_s", width: 8 },
    Column { name: "yardsticks", width: 0 },
    Column { name: "spread", width: 0 },
    Column { name: "speed", width: 8 },
    Column { name: "hdf5_cpu_s_per_s", width: 8 },
    Column { name: "measured_s", width: 0 },
    Column { name: "channels", width: 0 },
];

/// The scenes: name, and what is simulated. All begin at rest but the linear bow, of which the free motion is
/// the larger part of the cost.
fn scenes(n: usize) -> Result<Vec<(&'static str, Scene)>, BenchError> {
    let absent = |name| BenchError::Absent { case: name, what: "such built-in scene" };
    let built_in = |name: &'static str| -> Result<Scene, BenchError> {
        let mut scene = Scene::parse(builtin::text(name).ok_or_else(|| absent(name))?, name)?;
        scene.start = Start::Rest;
        Ok(scene)
    };
    let list = [
        ("set A, bearing 3", A3.noisy_scene()?),
        ("linear unbalance", scenes::linear(false)?),
        ("linear bow", scenes::linear(true)?),
        ("seed-bearing-40hz-3", built_in("seed-bearing-40hz-3")?),
        ("BG_BS_BB", built_in("BG_BS_BB")?),
    ];
    Ok(list.into_iter().take(n).collect())
}

/// Measures all, and hands on each row when it is there.
///
/// # Errors
///
/// [`BenchError`] when a scene cannot be built or run, or a capture not be written.
pub fn run(
    effort: &Effort,
    record: &mut Record<'_>,
    tell: &mut Tell<'_>,
) -> Result<Vec<Vec<Cell>>, BenchError> {
    let mut rows = Vec::new();
    for (name, mut scene) in scenes(effort.n_scenes)? {
        for accuracy in effort.accuracies {
            scene.accuracy = *accuracy;
            let row = row(name, &scene, effort, record)?;
            tell(&row)?;
            rows.push(row);
        }
    }
    Ok(rows)
}

fn row(
    name: &str,
    scene: &Scene,
    effort: &Effort,
    record: &mut Record<'_>,
) -> Result<Vec<Cell>, BenchError> {
    let found = error::measure(scene, effort.compared_s, effort.tolerances)?;
    let cost = cost::measure(scene, (effort.n_repeats, effort.repeat_s), record)?;
    let plan = &cost.plan;
    let n_shapes = plan.n_modes + plan.n_attachments;
    Ok(vec![
        Cell::Text(name.to_owned()),
        Cell::Number(scene.accuracy, 0),
        Cell::Plain(1e6 * plan.step_s(), 2),
        Cell::Plain(n_shapes as f64, 0),
        Cell::Number(found.bearings.max(found.sensors), 1),
        Cell::Number(found.bearings, 1),
        Cell::Number(found.sensors, 1),
        Cell::Plain(1e6 * found.step_s, 2),
        Cell::Number(found.of_reference, 1),
        Cell::Number(plan.expected_error, 1),
        Cell::Number(cost.setup_s, 2),
        Cell::Number(cost.run_s_per_s, 2),
        Cell::Plain(cost.yardsticks, 0),
        Cell::Plain(cost.spread, 2),
        Cell::Plain(1.0 / cost.run_s_per_s, 1),
        Cell::Number(cost.written_s_per_s, 2),
        Cell::Number(cost.seconds, 2),
        Cell::Plain(scene.sensors.len() as f64, 0),
    ])
}

/// Rows whose error is above the accuracy asked for.
#[must_use]
pub fn n_missed(rows: &[Vec<Cell>]) -> usize {
    let is_missed = |row: &&Vec<Cell>| {
        let (asked, error) = (number(row, "requested"), number(row, "error"));
        asked.zip(error).is_none_or(|(asked, error)| error.is_nan() || error > asked)
    };
    rows.iter().filter(is_missed).count()
}

fn number(row: &[Cell], name: &str) -> Option<f64> {
    COLUMNS.iter().zip(row).find_map(|(column, cell)| match cell {
        Cell::Number(number, _) if column.name == name => Some(*number),
        Cell::Number(..) | Cell::Plain(..) | Cell::Text(_) | Cell::Flag(_) => None,
    })
}

/// Error against cost, a line a scene.
#[must_use]
pub fn plot(rows: &[Vec<Cell>]) -> Option<String> {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let Some(Cell::Text(name)) = row.first() else { continue };
        let (cost, error) = (number(row, "cpu_s_per_s"), number(row, "error"));
        if series.last().is_none_or(|last| last.name != *name) {
            series.push(Series { name: name.clone(), points: Vec::new() });
        }
        if let Some(last) = series.last_mut() {
            last.points.extend(cost.zip(error));
        }
    }
    let words = Words {
        title: "Simulator: error against cost",
        x: "processor time a simulated second, s",
        y: "largest error ÷ largest value",
    };
    log_log::log_log(&words, &series)
}
