//! Streams of samples: the same however they are asked for, and faults that come while they run.

use super::*;
use crate::simulator::scene::builtin;
use crate::simulator::scene::{Bow, BowShape};
use std::convert::Infallible;

fn scene(name: &str, change: &[(&str, &str)]) -> Scene {
    let mut text = builtin::text(name).unwrap().to_owned();
    for (from, to) in change {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Scene::parse(&text, name).unwrap()
}

/// Physical values of every channel, asked for in these pieces.
fn run(simulation: &mut Simulation, pieces: &[u64]) -> Vec<Vec<f64>> {
    let infos: Vec<SimulatedChannel> = simulation.channels().cloned().collect();
    let mut out = vec![Vec::new(); infos.len()];
    for n in pieces {
        let mut take = |channel: usize, samples: Samples<'_>| {
            let (scale, offset) = (infos[channel].scale, infos[channel].offset);
            match samples {
                Samples::Int16(list) => {
                    out[channel].extend(list.iter().map(|x| f64::from(*x) * scale + offset));
                }
                Samples::Float32(list) => out[channel].extend(list.iter().map(|x| f64::from(*x))),
                Samples::Float64(list) => out[channel].extend_from_slice(list),
            }
            Ok::<(), Infallible>(())
        };
        simulation.advance(*n, &mut take).unwrap();
    }
    out
}

#[test]
fn how_samples_are_asked_for_and_how_often_changes_none() {
    for name in ["seed-bearing-40hz", "seed-bow-2hz"] {
        let scene = scene(name, &[]);
        let whole = run(&mut Simulation::new(&scene, 3).unwrap(), &[700]);
        let parts = run(&mut Simulation::new(&scene, 3).unwrap(), &[1, 299, 50, 350]);
        assert_eq!(whole, parts, "{name}: bit by bit");
        let other = run(&mut Simulation::new(&scene, 4).unwrap(), &[700]);
        assert_ne!(whole[0], other[0], "{name}: another seed, other noise");
        assert_eq!(whole[0].len(), 700);
    }
}

#[test]
fn a_slower_channel_has_the_samples_of_its_own_rate() {
    let slow = "channel = \"mid_x\"\nkind = \"proximitor\"\nat_in = 10.5\n";
    let change = format!("{slow}rate_hz = 2000.0\nclean = true\nnumber = \"float64\"\n");
    let fast = format!("{slow}clean = true\nnumber = \"float64\"\n");
    let slow_run =
        run(&mut Simulation::new(&scene("seed-bow-2hz", &[(slow, &change)]), 1).unwrap(), &[999]);
    let fast_run =
        run(&mut Simulation::new(&scene("seed-bow-2hz", &[(slow, &fast)]), 1).unwrap(), &[999]);
    let picked: Vec<f64> = fast_run[4].iter().step_by(5).copied().collect();
    assert_eq!(slow_run[4], picked);
}

#[test]
fn a_bow_that_comes_while_it_runs_keeps_the_motion() {
    let clean = "kind = \"proximitor\"\nclean = true\nnumber = \"float64\"\n";
    let bowed = scene("seed-bow-2hz", &[("kind = \"proximitor\"\nat", &format!("{clean}at"))]);
    let mut simulation = Simulation::new(&bowed, 1).unwrap();
    let before = run(&mut simulation, &[2000]);
    let straight = Faults::default();
    simulation.set_faults(&straight).unwrap();
    let after = run(&mut simulation, &[2000]);
    let jump = (after[4][0] - before[4][1999]).abs();
    // From 203 µm at 117 Hz the first 0.1 ms move 203·(2π·117·1e-4)²/2 = 0.5 µm.
    assert!(jump < 1.0, "{jump}");
    // A free shaft's bow of 203 µm becomes a vibration about zero.
    let highest = after[4].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(highest > 150.0, "{highest}");
    let amplitude_m = 203.2e-6;
    let again = Faults {
        bow: Some(Bow { shaft: None, angle_rad: 0.0, shape: BowShape::HalfSine { amplitude_m } }),
        ..straight
    };
    simulation.set_faults(&again).unwrap();
}

#[test]
fn a_defect_that_comes_while_it_runs_is_heard() {
    let healthy = scene("seed-bearing-40hz-0", &[("gravity = true", "")]);
    let healthy_text = healthy.text.replace("clearance_um = 2.0 ", "interference_um = 0.5 ");
    let healthy = Scene::parse(&healthy_text, "s").unwrap();
    let faults = scene("seed-bearing-40hz-3", &[]).faults();
    let mut simulation = Simulation::new(&healthy, 1).unwrap();
    let rms = |list: &[f64]| (list.iter().map(|x| x * x).sum::<f64>() / list.len() as f64).sqrt();
    let before = rms(&run(&mut simulation, &[2000])[2]);
    simulation.set_faults(&faults).unwrap();
    let after = rms(&run(&mut simulation, &[2000])[2]);
    assert!(after > 5.0 * before, "{before} {after}");
    let unknown = Faults {
        defects: faults.defects.iter().map(|(_, d)| ("middle".to_owned(), *d)).collect(),
        ..Faults::default()
    };
    let text = simulation.set_faults(&unknown).unwrap_err().to_string();
    assert!(text.contains("the id of a ball bearing: left, right"), "{text}");
    simulation.set_faults(&Faults::default()).unwrap();
    let last = run(&mut simulation, &[4000]);
    assert!(rms(&last[2][2000..]) < 0.5 * after, "healed");
}

#[test]
fn a_touched_probe_and_a_clipped_converter_are_told() {
    let change = (
        "at_in = 10.5\naxis_deg = 0.0\nfull_scale = 1000.0",
        "at_in = 10.5\nrest = 100.0\nfull_scale = 150.0",
    );
    let mut simulation = Simulation::new(&scene("seed-bow-2hz", &[change]), 1).unwrap();
    let out = run(&mut simulation, &[5000]);
    let told = simulation.warnings().join("\n");
    assert!(
        told.contains("mid_x: the shaft moved 203.") && told.contains("gap of 100 um"),
        "{told}"
    );
    assert!(
        told.contains("mid_x: ") && told.contains("beyond the converter's full_scale"),
        "{told}"
    );
    let highest = out[4].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Clipped at rest + range, one count below it.
    assert!((highest - 250.0).abs() < 0.01, "{highest}");
    assert_eq!(simulation.warnings().len(), 2);
}

#[test]
fn a_run_up_and_a_reversal_are_integrated() {
    let change = [("constant_hz = 2.0", "points = [[0.0, 0.0], [0.1, 20.0], [0.2, -20.0]]")];
    let scene = scene("seed-bow-2hz", &change);
    let mut simulation = Simulation::new(&scene, 1).unwrap();
    assert!(!simulation.plan().is_linear);
    let out = run(&mut simulation, &[3000]);
    assert!(out.iter().all(|list| list.len() == 3000 && list.iter().all(|x| x.is_finite())));
}

#[test]
fn a_damper_too_stiff_for_the_usual_step_gets_a_shorter_one_or_is_refused() {
    let with = |damping: &str| {
        let bearing = format!("stiffness_n_per_m = 1.078e8\ndamping_n_s_per_m = {damping}");
        scene(
            "seed-bow-2hz",
            &[
                ("constant_hz = 2.0", "points = [[0.0, 2.0], [0.05, 60.0]]"),
                ("start = \"rotating\"", "start = \"rest\""),
                ("stiffness_n_per_m = 1.078e8", &bearing),
            ],
        )
    };
    let usual = Simulation::new(&with("200.0"), 1).unwrap();
    let mut stiff = Simulation::new(&with("2e4"), 1).unwrap();
    assert!(stiff.plan().steps_per_sample > usual.plan().steps_per_sample);
    assert!(run(&mut stiff, &[1000]).iter().flatten().all(|x| x.is_finite()));
    let refused = Simulation::new(&with("1e8"), 1).unwrap_err().to_string();
    assert!(refused.contains("0.5 µs") && refused.contains("less damping"), "{refused}");
}

#[test]
fn a_light_ring_on_many_balls_gets_a_step_that_follows_it() {
    // 50 balls of 0.7 mm, a ring of 0.2 g, next to no damping: in steps of 20 µs the motion is lost.
    let text = r#"
[scene]
name = "light ring"
duration_s = 0.1
start = "rotating"
gravity = true
accuracy = 1e-5
[speed]
constant_hz = 10.8
[modes]
damping = 2.4e-5
[shaft]
length_m = 0.24
diameter_m = 4.8e-3
young_gpa = 216.0
density_kg_per_m3 = 1060.0
[[bearing]]
id = "ball"
at_m = 0.021
ring_mass_kg = 1.7e-4
kind = "ball"
elements = 50
element_diameter_m = 7.4e-4
pitch_diameter_m = 1.31e-2
conformity = 0.567
interference_m = 8.2e-8
damping_n_s_per_m = 0.0
[[bearing]]
id = "plain"
at_m = 0.225
kind = "linear"
stiffness_n_per_m = [[6.8e7, 0.0], [0.0, 7.0e7]]
damping_n_s_per_m = 1.7e4
[[disc]]
at_m = 0.11
diameter_m = 8.6e-3
width_m = 2.1e-3
density_kg_per_m3 = 6800.0
eccentricity_m = 3e-6
[[sensor]]
channel = "x"
kind = "accelerometer"
bearing = "ball"
axis_deg = 0.0
clean = true
number = "float64"
"#;
    let mut simulation = Simulation::new(&Scene::parse(text, "s").unwrap(), 1).unwrap();
    assert!(simulation.plan().step_s() < 15e-6, "{}", simulation.plan().step_s());
    assert!(simulation.plan().expected_error < 1e-2, "{}", simulation.plan().expected_error);
    let seen = run(&mut simulation, &[1000]);
    assert!(seen[0].iter().all(|x| x.is_finite()));
}

#[test]
fn overdamped_bearings_at_constant_speed_go_the_fast_way() {
    let change = [("damping_n_s_per_m = 200.0", "damping_n_s_per_m = 2e5")];
    let mut simulation = Simulation::new(&scene("seed-bearing-40hz-3", &change), 1).unwrap();
    assert!(simulation.plan().is_filtered, "not integrated in all coordinates");
    assert!(run(&mut simulation, &[500]).iter().flatten().all(|x| x.is_finite()));
}

#[test]
fn drift_and_dropouts_are_the_sensors_own() {
    let clean = "at_in = 10.5\naxis_deg = 0.0\nclean = true\nnumber = \"float64\"\n";
    let faulty = format!("{clean}drift_per_s = 50.0\ndropouts_s = [[0.1, 0.2]]\nrest = 300.0\n");
    let record = |lines: &str| {
        let scene = scene("seed-bow-2hz", &[("at_in = 10.5\naxis_deg = 0.0\n", lines)]);
        run(&mut Simulation::new(&scene, 1).unwrap(), &[3000]).swap_remove(4)
    };
    for (i, (plain, faulty)) in record(clean).iter().zip(record(&faulty)).enumerate() {
        let time_s = i as f64 / 10_000.0;
        let lost = (1000..2000).contains(&i);
        let expected = if lost { 0.0 } else { plain + 300.0 + 50.0 * time_s };
        assert!((faulty - expected).abs() < 1e-9, "{i}: {faulty} {expected}");
    }
}
