//! What each part of a model costs: a scene with everything, and the same with parts left out.
//!
//! Only what a scene has is computed. So the whole is the scene of all faults, and each row says what a scene saves that does not
//! have a part: its processor time, with the step that is chosen for it then.

use super::cost;
use crate::bench::table::{Cell, Column};
use crate::bench::{BenchError, Tell};
use crate::simulator::scene::{BearingKind, Scene, builtin};
use serde_json::{Value, json};

/// The columns of the table.
pub const COLUMNS: [Column; 10] = [
    Column { name: "scene", width: 46 },
    Column { name: "shapes", width: 6 },
    Column { name: "torsion", width: 7 },
    Column { name: "gyroscopic", width: 10 },
    Column { name: "step_us", width: 8 },
    Column { name: "setup_cpu_s", width: 11 },
    Column { name: "cpu_s_per_s", width: 11 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "spread", width: 6 },
    Column { name: "cost_over_whole", width: 15 },
];

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Rows, the first of the list.
    pub n_rows: usize,
    /// Repeats, and processor time of each, s, about.
    pub repeats: (usize, f64),
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self { n_rows: usize::MAX, repeats: (7, 0.2) };
    /// Seconds of work, for every change.
    pub const THINNED: Self = Self { repeats: (1, 0.005), ..Self::WHOLE };
    /// Shows that it works.
    pub const QUICK: Self = Self { n_rows: 2, ..Self::THINNED };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({ "repeats": self.repeats.0, "repeat_s": self.repeats.1 })
    }
}

/// The scene that has everything.
const WHOLE: &str = "BG_BS_BB";

/// Leaves a part out.
type LeaveOut = fn(&mut Scene);

/// What is left out, and how.
const PARTS: [(&str, LeaveOut); 15] = [
    ("whole: all faults, 7 sensors", |_| ()),
    ("no noise, no converters", clean),
    ("one sensor", |scene| scene.sensors.truncate(1)),
    ("no gravity", |scene| scene.gravity_rad = None),
    ("no bow", |scene| scene.bow = None),
    ("no defects of bearings", no_defects),
    ("no faults of teeth", no_tooth_faults),
    ("gear turns rigidly on its mesh", rigid),
    ("no gear", |scene| scene.gears.clear()),
    ("no gear, no defects", |scene| {
        scene.gears.clear();
        no_defects(scene);
    }),
    ("linear bearings", linear),
    ("no gear, linear bearings: linear", |scene| {
        scene.gears.clear();
        linear(scene);
    }),
    ("half the modes", |scene| scene.modes.count = Some(7)),
    ("no attachment shapes", |scene| scene.modes.attachment = false),
    ("accuracy 1e-3", |scene| scene.accuracy = 1e-3),
];

fn clean(scene: &mut Scene) {
    use crate::simulator::scene::NumberKind;
    for sensor in &mut scene.sensors {
        (sensor.noise_density, sensor.drift_per_s) = (0.0, 0.0);
        sensor.number = NumberKind::Float64;
    }
}

fn no_defects(scene: &mut Scene) {
    for bearing in &mut scene.bearings {
        if let BearingKind::Ball(ball) = &mut bearing.kind {
            ball.defects.clear();
        }
    }
}

fn no_tooth_faults(scene: &mut Scene) {
    for gear in &mut scene.gears {
        gear.faults.clear();
    }
}

fn rigid(scene: &mut Scene) {
    for gear in &mut scene.gears {
        gear.is_rigid = true;
    }
}

/// Bearings as stiff as those that the modes are made with.
fn linear(scene: &mut Scene) {
    for bearing in &mut scene.bearings {
        let stiffness = bearing.support_n_per_m;
        if let BearingKind::Ball(ball) = &bearing.kind {
            let damping = ball.bearing.damping_n_s_per_m;
            bearing.kind = BearingKind::Linear {
                stiffness_n_per_m: [[stiffness, 0.0], [0.0, stiffness]],
                damping_n_s_per_m: [[damping, 0.0], [0.0, damping]],
            };
        }
    }
}

/// Measures every row and hands it on.
///
/// # Errors
///
/// [`BenchError`] when a scene cannot be built or run.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let absent = || BenchError::Absent { case: WHOLE, what: "such built-in scene" };
    let whole = Scene::parse(builtin::text(WHOLE).ok_or_else(absent)?, WHOLE)?;
    let mut rows = Vec::new();
    let mut whole_s = None;
    for (name, leave_out) in PARTS.into_iter().take(effort.n_rows) {
        let mut scene = whole.clone();
        leave_out(&mut scene);
        // Nothing is written.
        let cost = cost::measure(&scene, effort.repeats, &mut |_| Ok(()))?;
        let of_whole = cost.run_s_per_s / *whole_s.get_or_insert(cost.run_s_per_s);
        let plan = &cost.plan;
        let row = vec![
            Cell::Text(name.to_owned()),
            Cell::Plain((plan.n_modes + plan.n_attachments) as f64, 0),
            Cell::Plain(plan.n_torsion as f64, 0),
            Cell::Text(if plan.has_gyroscopic { "yes" } else { "no" }.to_owned()),
            Cell::Plain(1e6 * plan.step_s(), 2),
            Cell::Number(cost.setup_s, 2),
            Cell::Number(cost.run_s_per_s, 2),
            Cell::Plain(cost.yardsticks, 0),
            Cell::Plain(cost.spread, 2),
            Cell::Plain(of_whole, 2),
        ];
        tell(&row)?;
        rows.push(row);
    }
    Ok(rows)
}
