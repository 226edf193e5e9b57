//! The tables of docs/simulator.md: errors by step and by number of shapes.
//!
//! `cargo test --release --test stability -- --ignored --nocapture --test-threads 1 tables`

use rotorwatch::bench::records::{Exact, Record, mean_accelerations, ported, stepped, worst};
use rotorwatch::bench::scenes::{A3, D0, D3, Rig, bow_run_up};
use rotorwatch::simulator::model::Model;
use rotorwatch::simulator::reference::scene::Setting;

#[test]
#[ignore = "prints tables of a minute's work; what they say is held by other tests"]
#[expect(clippy::print_stdout, reason = "that is what it is for")]
fn errors_by_step() {
    let scenes = [
        ("A, bearing 3", A3.scene().unwrap()),
        ("D, bearing 3, geometric", D3.scene().unwrap()),
        ("D, bearing 0", D0.scene().unwrap()),
        ("bow, run-up", bow_run_up().unwrap()),
    ];
    println!("| scene | step, µs | bearings | sensors | bearings, uncut | sensors, uncut |");
    println!("|---|---|---|---|---|---|");
    for (name, scene) in scenes {
        let setting = Setting::new(&scene).unwrap();
        let exact = Exact::new(&setting, 2.5e-6, 0.1, 1e-12);
        let (loose, tight) = (Exact::new(&setting, 20e-6, 0.1, 1e-11).at(20e-6), exact.at(20e-6));
        let [bearings, sensors] = both(&loose, &tight);
        println!(
            "| {name} | reference at 1e-11 against 1e-12 | {bearings:.0e} | {sensors:.0e} | | |"
        );
        for step_s in [20e-6, 10e-6, 5e-6, 2.5e-6] {
            let right = exact.at(step_s);
            let [cut, uncut] =
                [true, false].map(|cut| both(&stepped(&setting, step_s, 0.1, cut), &right));
            println!(
                "| {name} | {} | {:.1e} | {:.1e} | {:.1e} | {:.1e} |",
                step_s * 1e6,
                cut[0],
                cut[1],
                uncut[0],
                uncut[1]
            );
        }
    }
}

fn both(found: &Record, right: &Record) -> [f64; 2] {
    [worst(&found.bearings, &right.bearings), worst(&found.sensors, &right.sensors)]
}

#[test]
#[ignore = "prints tables of a minute's work; what they say is held by other tests"]
#[expect(clippy::print_stdout, reason = "that is what it is for")]
fn errors_by_shapes() {
    // Steps so short that not even the fastest shape of all appears at another frequency.
    let (step_s, seconds) = (2e-6, 0.03);
    println!("| scene | shapes | highest mode, Hz | bearings | sensors |\n|---|---|---|---|---|");
    for (name, rig) in [("A, bearing 3", A3), ("D, bearing 3", D3), ("D, bearing 0", D0)] {
        let with = |count: usize| {
            let modes = format!("count = {count}\ndamping = 0.002\nelements_per_span = 4");
            let setting = Setting::new(&Rig { modes: &modes, ..rig }.scene().unwrap()).unwrap();
            let record = stepped(&setting, step_s, seconds, true);
            let record = mean_accelerations(&setting, step_s, &record);
            (setting, record)
        };
        let (whole, _) = with(12);
        let (_, right) = with(whole.plan.n_dof - 2);
        for count in [8, 10, 12, 14, 16, 20, 24, 28, 32, 36, 40] {
            let (setting, found) = with(count);
            let [bearings, sensors] = both(&found, &right);
            let highest = setting.plan.highest_hz;
            let n_attachments = setting.plan.n_attachments;
            println!(
                "| {name} | {count} + {n_attachments} | {highest:.0} | {bearings:.1e} | {sensors:.1e} |"
            );
        }
    }
}

#[test]
#[ignore = "prints tables of a minute's work; what they say is held by other tests"]
#[expect(clippy::print_stdout, reason = "that is what it is for")]
fn errors_of_the_fast_way() {
    let scenes = [("A, bearing 3", A3), ("D, bearing 3, geometric", D3), ("D, bearing 0", D0)];
    println!("| scene | step, µs | bearings | sensors | bearings, cut | sensors, cut |");
    println!("|---|---|---|---|---|---|");
    for (name, rig) in scenes {
        let setting = Setting::new(&rig.scene().unwrap()).unwrap();
        let exact = Exact::new(&setting, 2.5e-6, 0.1, 1e-12);
        for step_s in [20e-6, 10e-6, 5e-6, 2.5e-6] {
            let right = exact.at(step_s);
            let [plain, cut] = [false, true]
                .map(|cuts| both(&ported(&setting, step_s, 0.1, cuts).unwrap(), &right));
            println!(
                "| {name} | {} | {:.1e} | {:.1e} | {:.1e} | {:.1e} |",
                step_s * 1e6,
                plain[0],
                plain[1],
                cut[0],
                cut[1]
            );
        }
    }
}

#[test]
fn the_fast_way_keeps_to_the_reference() {
    // Steps and limits: what the table says, with a factor of two.
    let cases = [(A3, 20e-6, false, 1e-4), (A3, 5e-6, false, 1e-6), (D0, 10e-6, true, 3e-5)];
    for (rig, step_s, cuts, limit) in cases {
        let setting = Setting::new(&rig.scene().unwrap()).unwrap();
        let exact = Exact::new(&setting, step_s, 0.02, 1e-11).at(step_s);
        let [bearings, sensors] = both(&ported(&setting, step_s, 0.02, cuts).unwrap(), &exact);
        assert!(bearings < limit && sensors < limit, "{step_s}: {bearings:e} {sensors:e}");
    }
}

/// Seconds of the record for other programs, and its grid.
const PEER: (f64, f64) = (0.02, 20e-6);

#[test]
#[ignore = "writes target/peers/bearing.csv and modal.csv, what benches/peers compares other programs with"]
fn reference_for_peers() {
    // All shapes of 24 elements and no modal damping: the finite-element equations themselves.
    let modes = "count = 48\ndamping = 0.0\nelements_per_span = 4";
    let setting = Setting::new(&Rig { modes, ..A3 }.scene().unwrap()).unwrap();
    assert_eq!(setting.model.basis.len(), 50, "all shapes");
    let record = Exact::new(&setting, PEER.1, PEER.0, 1e-12).at(PEER.1);
    let mut text = "time_s,right_x_m,right_y_m\n".to_owned();
    for (i, (x, y)) in record.bearings[2].iter().zip(&record.bearings[3]).enumerate() {
        text.push_str(&format!("{:.9},{x:.15e},{y:.15e}\n", PEER.1 * i as f64));
    }
    std::fs::create_dir_all("target/peers").unwrap();
    std::fs::write("target/peers/bearing.csv", text).unwrap();
    std::fs::write("target/peers/modal.csv", modal()).unwrap();
}

/// The reduced model of set A, bearing 3, as lists by name, and its motion.
fn modal() -> String {
    let setting = Setting::new(&A3.scene().unwrap()).unwrap();
    let model = &setting.model;
    let oscillators = model.oscillators();
    let speed = model.speed.at(0.0).speed_rad_per_s;
    let (real, imaginary) = Model::turning_force(&model.shafts[0], speed);
    let mut text = String::new();
    for (name, list) in [
        ("omega_rad_per_s", &oscillators.omega_rad_per_s),
        ("damping", &oscillators.damping),
        ("force_real", &real),
        ("force_imaginary", &imaginary),
        ("left", &model.seats[0].row),
        ("right", &model.seats[1].row),
    ] {
        let numbers: Vec<String> = list.iter().map(|x| format!("{x:e}")).collect();
        text.push_str(&format!("{name},{}\n", numbers.join(",")));
    }
    let record = Exact::new(&setting, PEER.1, PEER.0, 1e-12).at(PEER.1);
    for (i, (x, y)) in record.bearings[2].iter().zip(&record.bearings[3]).enumerate() {
        text.push_str(&format!("motion,{:.9},{x:.15e},{y:.15e}\n", PEER.1 * i as f64));
    }
    text
}

#[test]
#[ignore = "prints processor time of the existing integrator; a figure, not a test"]
#[expect(clippy::print_stdout, reason = "that is what it is for")]
fn cost_by_step() {
    let setting = Setting::new(&A3.scene().unwrap()).unwrap();
    println!("| scene | step, µs | processor time a simulated second, s |\n|---|---|---|");
    for step_s in [50e-6, 20e-6, 10e-6, 5e-6, 2.5e-6] {
        let start = cpu_time::ProcessTime::now();
        std::hint::black_box(stepped(&setting, step_s, 1.0, true));
        let spent_s = start.elapsed().as_secs_f64();
        println!("| A, bearing 3 | {} | {spent_s:.3} |", step_s * 1e6);
    }
}
