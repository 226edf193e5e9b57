//! The simulator's hard cases.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

mod errors;
mod scenes;

use errors::{Exact, stepped, worst};
use rotorwatch::simulator::reference::scene::Setting;
use scenes::{A3, D0, D3, bow_run_up};

#[test]
#[ignore = "study"]
fn study_time() {
    for (name, scene) in
        [("A3", A3.scene()), ("D3", D3.scene()), ("D0", D0.scene()), ("bow", bow_run_up())]
    {
        let setting = Setting::new(&scene).unwrap();
        let t0 = std::time::Instant::now();
        let exact = Exact::new(&setting, 2.5e-6, 0.1, 1e-12);
        println!("{name}: {:?} {}", t0.elapsed(), exact.n_forces);
        let loose = Exact::new(&setting, 50e-6, 0.1, 1e-10);
        let (a, b) = (loose.at(50e-6), exact.at(50e-6));
        println!(
            "  1e-10: {:.1e} {:.1e}",
            worst(&a.bearings, &b.bearings),
            worst(&a.sensors, &b.sensors)
        );
        for aligned in [true, false] {
            for h in [50e-6, 20e-6, 10e-6, 5e-6, 2.5e-6] {
                let (a, b) = (stepped(&setting, h, 0.1, aligned), exact.at(h));
                println!(
                    "  {aligned} {h:.1e}: {:.2e} {:.2e}",
                    worst(&a.bearings, &b.bearings),
                    worst(&a.sensors, &b.sensors)
                );
            }
        }
    }
}

#[test]
#[ignore = "study"]
fn study_reduction() {
    let (h, seconds) = (5e-6, 0.05);
    for (name, rig) in [("A3", A3), ("D3", D3), ("D0", D0)] {
        let with = |modes: String| {
            let modes: &'static str = Box::leak(modes.into_boxed_str());
            let scene = scenes::Rig { modes, ..rig }.scene();
            let setting = Setting::new(&scene).unwrap();
            let record = stepped(&setting, h, seconds, true);
            (setting, record)
        };
        let (full_setting, _) =
            with("count = 12\ndamping = 0.002\nelements_per_span = 4".to_owned());
        let n_dof = full_setting.plan.n_dof;
        let (setting, full) =
            with(format!("count = {}\ndamping = 0.002\nelements_per_span = 4", n_dof - 2));
        println!("{name}: {n_dof} dof, {} shapes", setting.model.basis.len());
        for n in [4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 36, 40] {
            let (setting, found) =
                with(format!("count = {n}\ndamping = 0.002\nelements_per_span = 4"));
            println!(
                "  {n} + {}: highest mode {:.0} Hz, shape {:.0}: bearings {:.2e} sensors {:.2e}",
                setting.plan.n_attachments,
                setting.plan.highest_hz,
                setting.model.basis.omega_rad_per_s.last().unwrap() / std::f64::consts::TAU,
                worst(&found.bearings, &full.bearings),
                worst(&found.sensors, &full.sensors)
            );
        }
    }
}
