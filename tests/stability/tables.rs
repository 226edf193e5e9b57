//! The tables of docs/simulator.md: errors by step.
//!
//! `cargo test --release --test stability -- --ignored --nocapture --test-threads 1 tables`

use rotorwatch::bench::records::{Exact, Record, ported, stepped, worst};
use rotorwatch::bench::scenes::{A3, D0, D3, Rig, bow_run_up};
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
#[ignore = "writes target/peers/bearing.csv, what benches/peers compares other programs with"]
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
