//! What is chosen and what is refused.

use super::*;
use crate::simulator::scene::BowShape;
use crate::simulator::scene::builtin;

fn scene(name: &str) -> Scene {
    Scene::parse(builtin::text(name).unwrap(), name).unwrap()
}

fn changed(name: &str, from: &str, to: &str) -> Result<Built, SceneErrors> {
    let text = builtin::text(name).unwrap();
    assert!(text.contains(from), "{from}");
    build(&Scene::parse(&text.replace(from, to), "s.toml").unwrap())
}

#[test]
fn steps_follow_the_accuracy_and_divide_the_sample() {
    let steps = |accuracy: &str| {
        let plan = changed("seed-bearing-40hz", "accuracy = 1e-4", accuracy).unwrap().plan;
        assert!(plan.expected_error <= accuracy.split(' ').next_back().unwrap().parse().unwrap());
        plan.steps_per_sample
    };
    // 10 µs give 2e-5: 15 µs 1e-4, 4.7 µs 1e-6; and 20 µs are the longest.
    assert_eq!(
        [steps("accuracy = 1e-2"), steps("accuracy = 1e-4"), steps("accuracy = 1e-6")],
        [5, 7, 22]
    );
}

#[test]
fn modes_reach_beyond_the_band_of_the_sensors() {
    let built = build(&scene("seed-bow-2hz")).unwrap();
    let plan = &built.plan;
    assert!(plan.is_linear && plan.steps_per_sample == 1);
    assert!(plan.highest_hz > 6000.0 && plan.n_modes <= MODES.1, "{plan:?}");
    assert_eq!(plan.n_attachments, 2);
    assert!(plan.n_dof >= DOF_PER_MODE * plan.n_modes);
    let slow = changed(
        "seed-bow-2hz",
        "at_in = 10.5\naxis_deg = 0.0\n",
        "at_in = 10.5\naxis_deg = 0.0\ncorner_hz = 50.0\n",
    )
    .unwrap()
    .plan;
    assert_eq!(slow.n_modes, plan.n_modes, "the widest band counts");
}

#[test]
fn the_gyroscopic_coupling_is_left_out_only_where_it_does_not_show() {
    let slow = changed("seed-bow-2hz", "constant_hz = 2.0", "constant_hz = 0.005").unwrap().plan;
    assert!(!slow.has_gyroscopic && slow.gyroscopic_effect < 1e-5, "{slow:?}");
    let plan = build(&scene("seed-bow-2hz")).unwrap().plan;
    assert!(plan.has_gyroscopic && plan.gyroscopic_effect > 1e-5);
}

#[test]
fn what_would_grow_or_lie_beyond_the_modes_is_refused() {
    let cross = "stiffness_n_per_m = [[1.078e8, 5e7], [-5e7, 1.078e8]]";
    let text =
        changed("seed-bow-2hz", "stiffness_n_per_m = 1.078e8", cross).unwrap_err().to_string();
    assert!(
        text.contains("bearing[0]: found stiffness and damping under which motion grows"),
        "{text}"
    );
    let fast = "constant_hz = 5000.0";
    let text = changed("seed-bearing-40hz", "constant_hz = 40.0", fast).unwrap_err().to_string();
    assert!(text.contains("speed: found 5000 Hz, which excites 34"), "{text}");
    let many =
        changed("seed-bearing-40hz", "[modes]\n", "[modes]\ncount = 150\nelements_per_span = 1\n");
    let text = many.unwrap_err().to_string();
    assert!(text.contains("modes: found 150 modes of 14 degrees of freedom"), "{text}");
}

#[test]
fn a_bow_through_points_bends_as_the_free_shaft_would() {
    let scene = scene("seed-bow-2hz");
    let built = build(&scene).unwrap();
    let (left, right) = (3.5148 * 0.0254, 17.4852 * 0.0254);
    let middle = 0.5 * (left + right);
    let points = vec![(left, 0.0), (middle, 1e-3), (right, 0.0)];
    let shape = bow_shape(&scene, &built.plane, 0, &BowShape::Points(points)).unwrap();
    // Three-point bending; with shear a little more pointed than Euler's 11/16 of the middle at the
    // quarter points.
    let at = |at_m: f64| shape[built.plane.displacement_at(at_m)];
    assert!((at(middle) - 1e-3).abs() < 1e-12 && at(left).abs() < 1e-12);
    let quarter = left + 0.25 * (right - left);
    let node = built.plane.displacement_at(quarter) / 2;
    let part = (built.plane.nodes_m[node] - left) / (right - left);
    let euler = 3.0 * part - 4.0 * part.powi(3);
    assert!((shape[2 * node] / 1e-3 - euler).abs() < 5e-3, "{} {euler}", shape[2 * node]);
    // Held only at the points: no force anywhere else.
    let force = &built.plane.shaft_stiffness * &shape;
    let held: Vec<usize> = [left, middle, right].map(|at| built.plane.displacement_at(at)).to_vec();
    let largest = force.amax();
    let loose = (0..force.len()).filter(|i| !held.contains(i)).map(|i| force[i].abs());
    assert!(loose.fold(0.0_f64, f64::max) < 1e-6 * largest);
    // A half sine has the slopes of its heights.
    let sine = BowShape::HalfSine { amplitude_m: 1e-3 };
    let sine = bow_shape(&scene, &built.plane, 0, &sine).unwrap();
    for node in 1..built.plane.nodes_m.len() {
        let length = built.plane.nodes_m[node] - built.plane.nodes_m[node - 1];
        let slope = 0.5 * (sine[2 * node + 1] + sine[2 * node - 1]);
        let rise = (sine[2 * node] - sine[2 * node - 2]) / length;
        // The trapezoid's error, (π/L)³·A·h²/12 with 31 mm elements at most.
        assert!((slope - rise).abs() < 6e-5, "{node}: {slope} {rise}");
    }
}

#[test]
fn a_gear_brings_torsion_and_its_place_a_shape() {
    let built = build(&scene("GG_GS_GB")).unwrap();
    let (plan, model) = (&built.plan, &built.model);
    assert_eq!(plan.n_attachments, 3);
    assert!(!plan.is_linear && plan.n_torsion == model.torsion.as_ref().unwrap().len());
    // The mesh holds the gear, 1 mm of approach a mean stiffness of force: the static shape sees to it.
    let gear = &model.gears[0];
    let omega = &model.torsion.as_ref().unwrap().basis.omega_rad_per_s;
    let rest = model.torsion.as_ref().unwrap().rest();
    let approach: f64 = -gear.turn.iter().zip(&rest).map(|(a, b)| a * b).sum::<f64>();
    let base_m = scene("GG_GS_GB").gears[0].design.gear.base_radius_m();
    let expected = 2.0 / base_m / gear.held_n_per_m;
    assert!((approach / expected - 1.0).abs() < 1e-9, "{approach} {expected}");
    assert!(omega[0] > 0.0 && omega.windows(2).all(|pair| pair[0] <= pair[1]));
    let rigid =
        changed("GG_GS_GB", "torque_nm = 2.0", "torsion = \"rigid\"\ntorque_nm = 2.0").unwrap();
    assert_eq!(rigid.plan.n_torsion, 1);
    assert!(rigid.plan.torsion_hz > plan.torsion_hz);
    let none = build(&scene("run-up")).unwrap();
    assert!(none.model.torsion.is_none() && none.plan.n_torsion == 0);
}
