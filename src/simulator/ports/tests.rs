//! The fast way against the slow one, and against itself at finer steps.

use super::*;
use crate::simulator::contact::{DefectPlace, Profile, Wave};
use crate::simulator::run::Quantity;
use crate::simulator::run::{Run, tests::set_a};
use std::f64::consts::TAU;

/// Motion and acceleration of both bearings along x and y.
fn watches(model: &Model) -> Vec<Watch> {
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
    let mut run = PortRun::new(model, &watches, step_s, 0, None).expect("a diagonal form");
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
