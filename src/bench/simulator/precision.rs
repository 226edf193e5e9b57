//! Work against precision: classes of scenes, methods, steps; the automatic choice among them.
//!
//! Only the bearings' displacement is compared: what a classical method gives without the sensors' filters. Every method
//! looks at the same places every step; its time is that of the motion with these looks.

use super::steppers::{self, Method};
use crate::bench::clock::{self, Yardstick};
use crate::bench::records::{Exact, port_run, stepped, steps, worst};
use crate::bench::scenes::{A3, D0, D3, Rig, bow_run_up};
use crate::bench::table::{Cell, Column};
use crate::bench::{BenchError, Tell};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use crate::simulator::reference::scene::Setting;
use crate::simulator::scene::{Scene, Start, builtin};
use crate::simulator::simulation::Simulation;
use cpu_time::ThreadTime;
use serde_json::{Value, json};

/// The columns of the table.
pub const COLUMNS: [Column; 9] = [
    Column { name: "scene", width: 26 },
    Column { name: "method", width: 30 },
    Column { name: "shapes", width: 6 },
    Column { name: "step_us", width: 8 },
    Column { name: "error", width: 8 },
    Column { name: "cpu_s_per_s", width: 11 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "automatic", width: 9 },
    Column { name: "cost_over_best", width: 14 },
];

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Scenes, the first of the list.
    pub n_scenes: usize,
    /// Length of the record, s.
    pub seconds: f64,
    /// Steps, s; each a whole multiple of the last.
    pub steps_s: &'static [f64],
    /// Accuracies of which the automatic choice is marked.
    pub accuracies: &'static [f64],
    /// Tolerance of the reference.
    pub tolerance: f64,
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self {
        n_scenes: usize::MAX,
        seconds: 0.1,
        steps_s: &[20e-6, 10e-6, 5e-6, 2.5e-6],
        accuracies: &[1e-3, 1e-4, 1e-5, 1e-6],
        tolerance: 1e-12,
    };

    /// Minutes of work, for every change.
    pub const THINNED: Self = Self {
        seconds: 0.05,
        steps_s: &[20e-6, 5e-6],
        accuracies: &[1e-4],
        tolerance: 1e-11,
        ..Self::WHOLE
    };

    /// A second of work: shows that it works.
    pub const QUICK: Self = Self { n_scenes: 1, seconds: 0.002, ..Self::THINNED };
}

impl Effort {
    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({ "seconds": self.seconds, "reference_tolerance": self.tolerance })
    }
}

/// A motion with its cost.
struct Point {
    method: String,
    step_s: Option<f64>,
    error: f64,
    cpu_s_per_s: f64,
    /// The accuracy that chose it.
    automatic: Option<f64>,
}

/// Classes of scenes.
fn scenes(n: usize) -> Result<Vec<(&'static str, Scene)>, BenchError> {
    let absent = |name| BenchError::Absent { case: name, what: "such built-in scene" };
    let built_in = |name: &'static str| -> Result<Scene, BenchError> {
        let mut scene = Scene::parse(builtin::text(name).ok_or_else(|| absent(name))?, name)?;
        scene.start = Start::Rest;
        Ok(scene)
    };
    let smooth = Rig { defect: Some((0.05, 4.0, "raised_cosine")), ..A3 };
    let list = [
        ("bearing, step", A3.scene()?),
        ("bearing, raised cosine", smooth.scene()?),
        ("bearing, clearance, defect", D3.scene()?),
        ("bearing, clearance, healthy", D0.scene()?),
        ("bow, run-up", bow_run_up()?),
        ("gear, healthy", built_in("GG_GS_GB")?),
        ("gear, worn", built_in("BG_GS_GB")?),
        ("all faults", built_in("BG_BS_BB")?),
    ];
    Ok(list.into_iter().take(n).collect())
}

/// Measures all and hands on each row.
///
/// # Errors
///
/// [`BenchError`] when a scene cannot be built or run.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let mut rows = Vec::new();
    let mut yardstick = Yardstick::new();
    for (name, scene) in scenes(effort.n_scenes)? {
        let yardstick_s = clock::round_s(&mut yardstick, 0.02);
        let setting = Setting::new(&scene)?;
        let points = points(&scene, &setting, effort)?;
        let n_shapes = setting.model.basis.len() as f64;
        for point in &points {
            let row = row((name, n_shapes), point, &points, yardstick_s);
            tell(&row)?;
            rows.push(row);
        }
    }
    Ok(rows)
}

fn row((name, n_shapes): (&str, f64), point: &Point, all: &[Point], yardstick_s: f64) -> Vec<Cell> {
    let none = || Cell::Text(String::new());
    // The cheapest of any method whose error is no larger.
    let best = all.iter().filter(|other| other.error <= point.error).map(|other| other.cpu_s_per_s);
    let best = best.fold(f64::INFINITY, f64::min);
    vec![
        Cell::Text(name.to_owned()),
        Cell::Text(point.method.clone()),
        Cell::Plain(n_shapes, 0),
        point.step_s.map_or_else(none, |step_s| Cell::Plain(1e6 * step_s, 2)),
        Cell::Number(point.error, 1),
        Cell::Number(point.cpu_s_per_s, 2),
        Cell::Plain(point.cpu_s_per_s / yardstick_s, 0),
        point.automatic.map_or_else(none, |accuracy| Cell::Number(accuracy, 0)),
        Cell::Plain(point.cpu_s_per_s / best, 2),
    ]
}

/// Displacements of the bearings, and processor time, s.
type Timed = (Vec<Vec<f64>>, f64);

fn timed(run: impl FnOnce() -> Vec<Vec<f64>>) -> Timed {
    let begun = ThreadTime::now();
    let found = run();
    (found, begun.elapsed().as_secs_f64())
}

/// The program's own way; what it does once before its first step is not counted (`setup_cpu_s` of the first table).
fn of_ports(setting: &Setting, (step_s, seconds): (f64, f64), cuts: bool) -> Option<Timed> {
    let mut run = port_run(setting, step_s, cuts)?;
    let mut values = vec![Vec::new(); run.n_watches()];
    let (mut values, cpu_s) = timed(|| {
        run.fill(steps(seconds, step_s), &mut values);
        values
    });
    values.truncate(setting.bearings.len());
    Some((values, cpu_s))
}

/// Every method at every step, and what is chosen for each accuracy.
fn points(scene: &Scene, setting: &Setting, effort: &Effort) -> Result<Vec<Point>, BenchError> {
    let seconds = effort.seconds;
    let grid_s = effort.steps_s.last().copied().unwrap_or(5e-6);
    let exact = Exact::new(setting, grid_s, seconds, effort.tolerance);
    let mut points = Vec::new();
    let mut take = |method: &str, step_s: f64, run: &dyn Fn() -> Option<Timed>| {
        if let Some((found, cpu_s)) = run() {
            let error = worst(&found, &exact.at(step_s).bearings);
            let (step_s, cpu_s_per_s) = (Some(step_s), cpu_s / seconds);
            let method = method.to_owned();
            points.push(Point { method, step_s, error, cpu_s_per_s, automatic: None });
        }
    };
    // How teeth meet and part is known to the program's own steps alone.
    let is_plain = setting.model.gears.is_empty();
    for step_s in effort.steps_s {
        let step_s = *step_s;
        let of_ports = |cuts| move || of_ports(setting, (step_s, seconds), cuts);
        take("shipped, parts at touch", step_s, &of_ports(false));
        take("shipped, cut at touch", step_s, &of_ports(true));
        take("ETDRK4, all coordinates", step_s, &|| {
            Some(timed(|| stepped(setting, step_s, seconds, true).bearings))
        });
        for (method, name, is_aligned) in [
            (Method::RungeKutta4, "RK4, aligned", true),
            (Method::RungeKutta4, "RK4, not aligned", false),
            (Method::Newmark, "Newmark, aligned", true),
            (Method::GeneralisedAlpha(0.8), "generalised alpha 0.8, aligned", true),
        ] {
            take(name, step_s, &|| {
                let of = (step_s, seconds);
                is_plain.then(|| timed(|| steppers::displacements(setting, method, of, is_aligned)))
            });
        }
    }
    for tolerance in [1e-5, 1e-8] {
        let begun = ThreadTime::now();
        let step_s = effort.steps_s.first().copied().unwrap_or(grid_s);
        let found = Exact::new(setting, step_s, seconds, tolerance).at(step_s).bearings;
        let cpu_s_per_s = begun.elapsed().as_secs_f64() / seconds;
        let error = worst(&found, &exact.at(step_s).bearings);
        let method = format!("extrapolation, tolerance {tolerance:e}");
        points.push(Point { method, step_s: None, error, cpu_s_per_s, automatic: None });
    }
    for accuracy in effort.accuracies {
        points.extend(automatic(scene, setting, *accuracy, effort)?);
    }
    Ok(points)
}

/// What is chosen for an accuracy, as it runs.
fn automatic(
    scene: &Scene,
    setting: &Setting,
    accuracy: f64,
    effort: &Effort,
) -> Result<Option<Point>, BenchError> {
    let mut scene = scene.clone();
    scene.accuracy = accuracy;
    let plan = Simulation::new(&scene, 1)?.plan().clone();
    let (step_s, seconds) = (plan.step_s(), effort.seconds);
    let found = of_ports(setting, (step_s, seconds), plan.cuts_at_contact);
    let general = || timed(|| stepped(setting, step_s, seconds, true).bearings);
    let (found, cpu_s) = found.unwrap_or_else(general);
    let cpu_s_per_s = cpu_s / seconds;
    let exact = Exact::new(setting, step_s, seconds, effort.tolerance).at(step_s);
    Ok(Some(Point {
        method: "chosen".to_owned(),
        step_s: Some(step_s),
        error: worst(&found, &exact.bearings),
        cpu_s_per_s,
        automatic: Some(accuracy),
    }))
}

/// Choices whose error is above the accuracy they were made for.
#[must_use]
pub fn n_missed(rows: &[Vec<Cell>]) -> usize {
    let is_missed = |row: &&Vec<Cell>| match (&row[4], &row[7]) {
        (Cell::Number(error, _), Cell::Number(accuracy, _)) => error.is_nan() || error > accuracy,
        _ => false,
    };
    rows.iter().filter(is_missed).count()
}

/// Error against cost, a line a method, of each scene.
#[must_use]
pub fn plots(rows: &[Vec<Cell>]) -> Vec<String> {
    let mut scenes: Vec<(String, Vec<Series>)> = Vec::new();
    for row in rows {
        let [
            Cell::Text(scene),
            Cell::Text(method),
            _,
            _,
            Cell::Number(error, _),
            Cell::Number(cost, _),
            ..,
        ] = &row[..]
        else {
            continue;
        };
        if scenes.last().is_none_or(|(name, _)| name != scene) {
            scenes.push((scene.clone(), Vec::new()));
        }
        let Some((_, series)) = scenes.last_mut() else { continue };
        let name = method.split(", tolerance").next().unwrap_or(method);
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push((*cost, *error)),
            None => series.push(Series { name: name.to_owned(), points: vec![(*cost, *error)] }),
        }
    }
    let plot = |(scene, series): &(String, Vec<Series>)| {
        let title = format!("Simulator, {scene}: error against cost");
        let words = Words {
            title: &title,
            x: "processor time a simulated second, s",
            y: "largest error ÷ largest value",
        };
        log_log::log_log(&words, series)
    };
    scenes.iter().filter_map(plot).collect()
}
