//! What a simulation models, what it leaves out and why, in words.

use super::build::{self, Plan};
use super::mesh::Root;
use super::scene::{BearingKind, Scene, SceneGear, SceneMate, Start};
use super::simulation::Simulation;
use super::speed::SpeedProfile;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Describes a simulation for people: one statement a line.
#[must_use]
pub fn explain(simulation: &Simulation) -> String {
    let (scene, plan) = (simulation.scene(), simulation.plan());
    let mut text = format!("scene {}: {} s", scene.name, scene.duration_s);
    let channels: Vec<_> = simulation.channels().map(|c| c.name.as_str()).collect();
    // Writing to a text cannot fail.
    let _ = writeln!(text, ", {} channels ({})", channels.len(), channels.join(", "));
    text.push_str("modelled:\n");
    for line in modelled(scene, plan) {
        let _ = writeln!(text, "  {line}");
    }
    text.push_str("left out:\n");
    for line in left_out(scene, plan) {
        let _ = writeln!(text, "  {line}");
    }
    let _ = writeln!(text, "computed:\n  {}", computed(plan));
    if let Some(error) = build::reduction_error(scene) {
        let _ = writeln!(
            text,
            "  expected relative error of accelerations in the sensors' band, from the shapes left out: {error:.1e}"
        );
    }
    let _ = writeln!(text, "  {}", started(scene, plan));
    text
}

fn modelled(scene: &Scene, plan: &Plan) -> Vec<String> {
    let lowest: Vec<String> = plan.lowest_hz.iter().map(|hz| format!("{hz:.2}")).collect();
    let mut lines = vec![
        format!(
            "{} and {} discs: {} degrees of freedom a plane, reduced to {} modes (lowest {} Hz, highest {:.0} Hz; \
             sensors see up to {:.0} Hz) and {} static attachment shapes",
            if scene.shafts.len() > 1 { "two geared shafts" } else { "shaft" },
            scene.discs.len(),
            plan.n_dof,
            plan.n_modes,
            lowest.join(", "),
            plan.highest_hz,
            build::band_hz(scene),
            plan.n_attachments
        ),
        format!("damping ratio {} of every shape", scene.modes.damping),
    ];
    for bearing in &scene.bearings {
        lines.push(match &bearing.kind {
            BearingKind::Ball(ball) => format!(
                "bearing {}: {} balls, K = {:.4e} N/m^1.5, {} {:.3} µm, damping {} N·s/m, {} defects",
                bearing.id,
                ball.bearing.balls,
                ball.bearing.contact_factor,
                if ball.bearing.clearance_m < 0.0 { "interference" } else { "radial clearance" },
                ball.bearing.clearance_m.abs() * 1e6,
                ball.bearing.damping_n_s_per_m,
                ball.defects.len()
            ),
            BearingKind::Linear { .. } => format!("bearing {}: linear", bearing.id),
        });
    }
    for gear in &scene.gears {
        lines.extend(meshing(scene, plan, gear));
    }
    if plan.has_gyroscopic {
        lines.push(format!(
            "gyroscopic coupling (shifts a frequency by up to {:.1e} of it)",
            plan.gyroscopic_effect
        ));
    }
    if scene.bow.is_some() {
        lines.push("residual bow".to_owned());
    }
    if scene.gravity_rad.is_some() {
        lines.push("gravity".to_owned());
    }
    lines
}

fn meshing(scene: &Scene, plan: &Plan, gear: &SceneGear) -> Vec<String> {
    let design = &gear.design;
    let (foundation, root) = (
        if design.model.foundation { "with" } else { "without" },
        if design.model.root == Root::RootCircle { "root circle" } else { "base circle" },
    );
    let (ratio, teeth) = (design.path.contact_ratio(), design.gear.z());
    let per_turn = 4.0 * teeth;
    let fastest_hz = scene.speed.fastest_rad_per_s() / TAU;
    vec![
        format!(
            "gear {}: {} teeth on {}, module {:.4} mm, contact ratio {ratio:.4} ({:.1} % of the time two pairs or \
             more), mean stiffness {:.4e} N/m (teeth held at the {root}, {foundation} foundation), damping {:.1} N·s/m, \
             backlash {:.1} µm, {} faults of teeth",
            gear.id,
            design.gear.teeth,
            design.mate.teeth,
            1e3 * design.gear.module_m,
            100.0 * (ratio - 1.0).clamp(0.0, 1.0),
            gear.mean_stiffness_n_per_m,
            design.damping_n_s_per_m,
            1e6 * design.backlash_m,
            gear.faults.len()
        ),
        format!(
            "its mate {}; torque {} N·m, mean mesh force {:.2} N; {per_turn:.0} events a turn where \
             pairs meet and part, {:.0} a second",
            match gear.mate {
                SceneMate::Prescribed => "turns as the speed says, its centre at rest".to_owned(),
                SceneMate::Shaft(mate) => format!(
                    "sits on shaft {}, {:.4} turns to one of the first, driven through a coupling of {:.3e} N·m/rad",
                    scene.shafts[1].id,
                    scene.turns(1),
                    mate.coupling_n_m_per_rad
                ),
            },
            gear.torque_n_m,
            gear.torque_n_m.abs() / design.gear.base_radius_m(),
            per_turn * fastest_hz
        ),
        format!(
            "torsion: {} ({} shapes, lowest {:.1} Hz with the mesh in them)",
            match (gear.is_rigid, gear.mate) {
                (true, SceneMate::Prescribed) => "the shaft turns as a whole",
                (true, SceneMate::Shaft(_)) => "each shaft turns as a whole",
                (false, SceneMate::Prescribed) => "a rod with discs",
                (false, SceneMate::Shaft(_)) => "two rods with discs, joined by the mesh",
            },
            plan.n_torsion,
            plan.torsion_hz
        ),
    ]
}

fn left_out(scene: &Scene, plan: &Plan) -> Vec<String> {
    let mut lines = vec!["axial motion, housing: not part of this model".to_owned()];
    if scene.gears.is_empty() {
        lines.push(
            "gear mesh: no gear; torsion: without a mesh nothing turns the shaft unevenly"
                .to_owned(),
        );
    } else {
        lines.push(
            "torsion in the angle at which balls, unbalance and teeth stand: it is some 1e-5 rad"
                .to_owned(),
        );
    }
    if !plan.has_gyroscopic {
        lines.push(format!(
            "gyroscopic coupling: it would shift a frequency by at most {:.1e} of it, below a tenth of the accuracy",
            plan.gyroscopic_effect
        ));
    }
    if scene.ball_bearings().next().is_none() {
        lines.push("contacts: no ball bearing".to_owned());
    }
    if scene.gravity_rad.is_none() {
        lines.push("gravity: not asked for".to_owned());
    }
    if scene.bow.is_none() {
        lines.push("bow: none".to_owned());
    }
    if plan.is_linear {
        lines.push(
            "anti-alias filters: a linear scene at constant speed has no line above its modes; nothing is oversampled"
                .to_owned(),
        );
    }
    lines
}

fn computed(plan: &Plan) -> String {
    if plan.is_linear {
        return format!(
            "exactly, one evaluation a sample at {} Hz; expected error: rounding",
            plan.rate_hz
        );
    }
    let cuts = if plan.cuts_at_contact { ", and where balls touch or leave" } else { "" };
    let by = if plan.is_error_measured {
        "measured on its beginning against steps of half the length"
    } else {
        "by the errors measured in the tables (docs/simulator.md)"
    };
    format!(
        "in steps of {:.3} µs ({} a sample at {} Hz), cut at every edge of a defect, change of tooth \
         pairs and loss of contact between teeth{cuts}; expected relative error \
         of what sensors see {:.1e}, {by}",
        1e6 * plan.step_s(),
        plan.steps_per_sample,
        plan.rate_hz,
        plan.expected_error
    )
}

fn started(scene: &Scene, plan: &Plan) -> String {
    match (scene.start, &scene.speed) {
        (Start::Rest, _) => "from rest: all loads set in at time 0".to_owned(),
        (Start::Rotating, _) if plan.is_linear => {
            "from the steady motion: there is no transient".to_owned()
        }
        (Start::Rotating, SpeedProfile::Table(_)) if !scene.has_contacts() => {
            "from the steady motion at the first speed".to_owned()
        }
        (Start::Rotating, _) => {
            "from the steady motion of the linear system, after a run-in that is not recorded: \
             0.4 s with damping raised to 0.1, then 0.2 s with the scene's own"
                .to_owned()
        }
    }
}
