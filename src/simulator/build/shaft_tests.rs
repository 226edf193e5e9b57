//! Two geared shafts: each by itself, the mesh between them, and what of one shows in the other.

use super::*;
use crate::simulator::linear::LinearSystem;
use crate::simulator::rotor::Place;
use crate::simulator::rotor::tests::rig;
use crate::simulator::run::Run;
use crate::simulator::scene::builtin;
use crate::simulator::torsion::{Rod, Torsion};

fn scene(change: &[(&str, &str)]) -> Scene {
    let mut text = builtin::text("reducer-10hz").unwrap().to_owned();
    for (from, to) in change {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Scene::parse(&text, "reducer-10hz").unwrap()
}

/// Displacement along x and y at a place in the steady motion, at these angles of the first shaft.
fn steady_at(model: &Model, row: &[f64], speed: f64, angles: &[f64]) -> Vec<[f64; 2]> {
    let system = LinearSystem::new(model, speed);
    let steady = system.steady(model).unwrap();
    let n = row.len();
    let dot = |q: &[f64]| row.iter().zip(q).map(|(phi, q)| phi * q).sum();
    let at = |angle: &f64| {
        let (q, _) = steady.at(&system, *angle);
        [dot(&q[..n]), dot(&q[n..2 * n])]
    };
    angles.iter().map(at).collect()
}

#[test]
fn shafts_side_by_side_turn_each_as_if_alone() {
    let turns = -48.0 / 19.0;
    let speed = TAU * 12.0;
    let (first, second) = (rig(24).assemble(), rig(12).assemble());
    let both = Plane::beside(&[(first.clone(), 1.0), (second.clone(), turns)]);
    let place = Place { shaft: 1, at_m: rig(12).discs[1].at_m };
    let mut whole =
        Model::new(Basis::new(&both, 24, &[]).unwrap(), 0.01, SpeedProfile::Constant(12.0));
    let n = whole.basis.len();
    whole.shafts.push(TurningLoads::none(n, turns));
    whole.add_unbalance(&both, 0.2, 3e-5, 0.7);
    whole.add_unbalance(&both, place, 1e-4, 0.3);
    let own = Basis::new(&second, second.n_dof(), &[]).unwrap();
    let mut alone = Model::new(own, 0.01, SpeedProfile::Constant(12.0 * turns));
    alone.add_unbalance(&second, place.at_m, 1e-4, 0.3);
    let angles = [0.0, 0.4, 1.9, 5.0];
    let found = steady_at(&whole, &whole.basis.row(both.displacement_at(place)), speed, &angles);
    let turned = angles.map(|angle| turns * angle);
    let row = alone.basis.row(second.displacement_at(place.at_m));
    let expected = steady_at(&alone, &row, turns * speed, &turned);
    let largest = expected.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (a, b) in found.iter().zip(&expected) {
        // 24 of the 78 shapes of both: what the cut ones would answer to the unbalance.
        let gap = (a[0] - b[0]).hypot(a[1] - b[1]) / largest;
        assert!(gap < 1e-4, "{gap} {a:?} {b:?}");
    }
}

#[test]
fn two_stiff_shafts_on_a_mesh_and_a_coupling_are_two_masses() {
    let rotor = rig(6);
    let rod = Rod::new(&rotor, &rotor.assemble());
    let (inertia, turns) = (rod.whole_kg_m2(), -2.0);
    let mut both = Rod::beside(&[(rod.clone(), 1.0), (rod, turns)]);
    let n = both.inertia.nrows();
    let (mesh, coupling, base) = (3e6, 40.0, (0.05, 0.025));
    both.couple(n - 1, coupling);
    let arms = [(0, base.0), (n / 2, base.1)];
    let basis = both.rigid(&arms, mesh).unwrap();
    // J·θ̈ = −k·r·(rᵀ·θ) − c·θ₂: the two roots of λ² − (a + d)·λ + a·d − b² = 0.
    let a = mesh * base.0 * base.0 / inertia;
    let d = (mesh * base.1 * base.1 + coupling) / inertia;
    let b = mesh * base.0 * base.1 / inertia;
    let root = (0.25 * (a - d) * (a - d) + b * b).sqrt();
    let expected = [0.5 * (a + d) - root, 0.5 * (a + d) + root];
    for (omega, square) in basis.omega_rad_per_s.iter().zip(expected) {
        // The lower root is a difference of two a thousand times as large.
        assert!((omega * omega / square - 1.0).abs() < 1e-9, "{} {square}", omega * omega);
    }
    // A rise of the first shaft's speed is one of −2 times on the second.
    let torsion = Torsion::new(&both, basis, 0.01);
    let of_shafts = [0, n / 2].map(|node| torsion.basis.row(node));
    for (shape, found) in torsion.inertia.iter().enumerate() {
        let expected = inertia * (of_shafts[0][shape] + turns * of_shafts[1][shape]);
        assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    }
}

#[test]
fn the_load_goes_through_the_teeth_into_the_coupling() {
    for text in ["drive = \"shaft\"", "drive = \"shaft\"\ntorsion = \"rigid\""] {
        let scene = scene(&[("drive = \"shaft\"", text)]);
        let built = build(&scene).unwrap();
        let gear = &scene.gears[0];
        let force_n = 2.0 / gear.design.gear.base_radius_m();
        let torsion = built.model.torsion.as_ref().unwrap();
        let rest = torsion.rest();
        let dot = |row: &[f64]| -> f64 { row.iter().zip(&rest).map(|(a, b)| a * b).sum() };
        let approach_m = -dot(&built.model.gears[0].turn);
        let expected = force_n / built.model.gears[0].held_n_per_m;
        assert!((approach_m / expected - 1.0).abs() < 1e-9, "{approach_m} {expected}");
        // What turns the pinion counter-clockwise, against its way, the coupling holds.
        let driven = torsion.basis.row(built.plane.node_at(Place { shaft: 1, at_m: 0.0 }));
        let expected = force_n * gear.design.mate.base_radius_m() / 200.0;
        assert!((dot(&driven) / expected - 1.0).abs() < 1e-6, "{} {expected}", dot(&driven));
    }
}

/// Sums of the displacement of the first shaft at its right bearing, from rest, 20 ms.
fn right_bearing(text: &str) -> Vec<f64> {
    let scene = Scene::parse(text, "scene").unwrap();
    let Built { plane, model, .. } = build(&scene).unwrap();
    let row = model.basis.row(plane.displacement_at(scene.bearings[1].place));
    let n = row.len();
    let mut run = Run::new(model, 5e-6, None);
    let mut seen = Vec::new();
    for i in 0..4000 {
        run.step();
        if i % 20 == 0 {
            let (q, _) = run.state();
            seen.extend([0, n].map(|plane| {
                let q = &q[plane..plane + n];
                row.iter().zip(q).map(|(phi, q)| phi * q).sum::<f64>()
            }));
        }
    }
    seen
}

#[test]
fn a_mate_on_a_shaft_that_yields_nowhere_is_the_prescribed_one() {
    let one = builtin::text("BG_GS_GB").unwrap().replace("accuracy = 1e-4", "accuracy = 1e-3");
    let stout = |id: &str, at: &str| {
        format!(
            "[[bearing]]\nid = \"{id}\"\nshaft = \"stout\"\nkind = \"linear\"\nat_mm = {at}\n\
             stiffness_n_per_m = 1e12\n"
        )
    };
    let shaft = "[[shaft]]\nid = \"stout\"\nlength_mm = 200.0\ndiameter_mm = 300.0\n";
    let two = one
        .replace("[shaft]\n", &format!("{shaft}[[shaft]]\nid = \"main\"\n"))
        .replace("gravity = true", "gravity = false")
        .replace("torque_nm = 2.0", "torque_nm = 2.0\nmate_bore_in = 0.625\ndrive = \"shaft\"\nmate_at_mm = 100.0\nmate_driven_at_mm = 100.0");
    // The first of the two shafts is the one that counts: put it there.
    let (before, after) = two.split_once(shaft).unwrap();
    let two = format!("{before}{after}\n{shaft}{}{}", stout("a", "40.0"), stout("b", "160.0"));
    let one = one.replace("gravity = true", "gravity = false");
    let (found, expected) = (right_bearing(&two), right_bearing(&one));
    let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let gaps = found.iter().zip(&expected).map(|(a, b)| (a - b).abs() / largest);
    let gap = gaps.fold(0.0, f64::max);
    // Supports a thousand times as stiff as the mesh, in series with it; teeth that part and meet
    // turn that into moments of contact a little later.
    assert!(gap < 2e-2 && gap > 0.0, "{gap}");
}

#[test]
fn what_two_shafts_need_is_asked_for() {
    let told = |from: &str, to: &str| {
        let text = builtin::text("reducer-10hz").unwrap();
        assert!(text.contains(from), "{from}");
        Scene::parse(&text.replace(from, to), "s").unwrap_err().to_string()
    };
    let none = told("drive = \"shaft\"", "drive = \"prescribed\"");
    assert!(none.contains("mate_at_in"), "{none}");
    let other = told("shaft = \"pinion\"\nat_in = 5.0", "shaft = \"pinon\"\nat_in = 5.0");
    assert!(other.contains("the id of a shaft: main, pinion"), "{other}");
    let loose =
        told("id = \"pinion_left\"\nshaft = \"pinion\"", "id = \"pinion_left\"\nshaft = \"main\"");
    assert!(loose.contains("1 on shaft pinion"), "{loose}");
    let alone = builtin::text("BG_GS_GB")
        .unwrap()
        .replace("torque_nm = 2.0", "torque_nm = 2.0\ndrive = \"shaft\"");
    let alone = Scene::parse(&alone, "s").unwrap_err().to_string();
    assert!(alone.contains("two tables [[shaft]]"), "{alone}");
}
