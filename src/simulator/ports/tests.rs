//! The fast way against the slow one, and against itself at finer steps.

use super::*;
use crate::simulator::contact::{DefectPlace, Profile, Wave};
use crate::simulator::run::Quantity;
use crate::simulator::run::{Run, tests::set_a};
use std::f64::consts::TAU;

/// Motion and acceleration of both bearings along x and y.
pub(crate) fn watches(model: &Model) -> Vec<Watch> {
    let of = |seat: usize, axis_rad: f64, quantity: Quantity| Watch {
        row: model.seats[seat].row.clone(),
        axis_rad,
        quantity,
    };
    let all = [Quantity::Displacement, Quantity::Acceleration];
    let axes = [0.0, 0.25 * TAU];
    let seats = [0, 1];
    seats.iter().flat_map(|s| axes.iter().flat_map(move |a| all.map(|q| of(*s, *a, q)))).collect()
}

fn fast(model: &Model, step_s: f64, n: usize, every: usize) -> Vec<Vec<f64>> {
    let watches = watches(model);
    let mut run = PortRun::new(model, &watches, step_s, 0, None)
        .expect("a diagonal form")
        .cutting_at_contact(std::env::var("CUT").is_ok());
    let mut out = vec![Vec::new(); watches.len()];
    run.fill(n, &mut out);
    out.iter().map(|list| list.iter().copied().step_by(every).collect()).collect()
}

fn slow(model: &Model, step_s: f64, n: usize, every: usize) -> Vec<Vec<f64>> {
    let watches = watches(model);
    let mut run = Run::new(model.clone(), step_s, None);
    let mut out = vec![Vec::new(); watches.len()];
    for i in 0..n {
        run.step();
        if i % every == 0 {
            for (list, watch) in out.iter_mut().zip(&watches) {
                list.push(run.observe(watch));
            }
        }
    }
    out
}

/// Largest difference of each list, of the largest value of the second.
fn differences(found: &[Vec<f64>], expected: &[Vec<f64>]) -> Vec<f64> {
    let of = |(found, expected): (&Vec<f64>, &Vec<f64>)| {
        assert_eq!(found.len(), expected.len());
        let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let gaps = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
        gaps.fold(0.0, f64::max) / largest
    };
    found.iter().zip(expected).map(of).collect()
}

#[test]
fn the_fast_way_goes_where_the_slow_one_goes() {
    let (model, ..) = set_a(0.05, 4.0);
    let reference = slow(&model, 1e-6, 20_000, 20);
    for (step_us, every) in [(20.0, 1), (10.0, 2), (5.0, 4), (2.5, 8)] {
        let n = 1000 * every;
        let f = differences(&fast(&model, step_us * 1e-6, n, every), &reference);
        let s = differences(&slow(&model, step_us * 1e-6, n, every), &reference);
        let text = |list: &[f64]| list.iter().map(|x| format!("{x:.1e} ")).collect::<String>();
        println!("{step_us} fast {} slow {}", text(&f), text(&s));
    }
}

fn filtered(list: &[f64], oversampling: u32) -> Vec<f64> {
    use crate::simulator::sensor::{Chain, SensorModel};
    let model = SensorModel {
        oversampling,
        rate_hz: 10_000.0,
        corner_hz: Some(4000.0),
        noise_density: 0.0,
        drift_per_s: 0.0,
        rest: 0.0,
        converter: None,
        dropouts_s: Vec::new(),
    };
    let mut chain = Chain::new(model, 1, 0);
    list.iter().filter_map(|x| chain.push(*x)).collect()
}

#[test]
fn what_sensors_see() {
    for width in [0.05, 0.0] {
        let (mut model, plane, _) = set_a(width, 4.0);
        if width < 0.5 && std::env::var("D").is_ok() {
            model.add_acceleration(&plane, [0.0, -9.81]);
            for seat in &mut model.seats {
                let mut bearing = seat.contacts.bearing().clone();
                bearing.clearance_m = 2e-6;
                seat.contacts = crate::simulator::contact::Contacts::new(bearing);
            }
        }
        for oversampling in [4_u32, 5, 7, 10, 14, 20, 28, 40] {
            let h = 1e-4 / f64::from(oversampling);
            let n = 1000 * oversampling as usize;
            let reference = fast(&model, h / 16.0, n * 16, 16);
            let found = fast(&model, h, n, 1);
            let raw = differences(&found, &reference);
            let f = |lists: &[Vec<f64>]| -> Vec<Vec<f64>> {
                lists.iter().map(|l| filtered(l, oversampling)).collect()
            };
            let seen = differences(&f(&found), &f(&reference));
            let text = |list: &[f64]| list.iter().map(|x| format!("{x:.1e} ")).collect::<String>();
            println!("{width} {oversampling} {:.1} us raw {} seen {}", h * 1e6, text(&raw), text(&seen));
        }
    }
    let (model, ..) = set_a(0.05, 4.0);
    let run = PortRun::new(&model, &watches(&model), 1e-5, 0, None).unwrap();
    let hz: Vec<String> = run.spectrum.values.iter().map(|v| format!("{:.0}", v.im / TAU)).collect();
    println!("{hz:?}");
}
