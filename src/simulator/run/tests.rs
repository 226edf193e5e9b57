//! The run against closed forms and against itself at finer steps.

use super::*;
use crate::simulator::contact::{BallBearing, Contacts, Defect, DefectPlace, Profile};
use crate::simulator::model::Seat;
use crate::simulator::modes::Basis;
use crate::simulator::rotor::Plane;
use crate::simulator::rotor::tests::rig;
use crate::simulator::speed::SpeedProfile;
use nalgebra::DMatrix;
use std::f64::consts::TAU;

const INCH: f64 = 0.0254;

/// One mass of 1 kg with ω = 100 rad/s.
fn jeffcott() -> Basis {
    Basis {
        omega_rad_per_s: vec![100.0],
        shapes: DMatrix::from_element(2, 1, 1.0),
        gyroscopic: DMatrix::zeros(1, 1),
    }
}

/// Displacement (x, y) at the end of a long run, with the shaft angle there.
fn settle(mut run: Run, seconds: f64) -> ([f64; 2], f64) {
    let watch = |axis_rad| Watch { row: vec![1.0], axis_rad, quantity: Quantity::Displacement };
    while run.time_s() < seconds {
        run.step();
    }
    run.step();
    let at_s = run.time_s() - run.step_s;
    let angle = run.model.speed.at(at_s).angle_rad;
    ([run.observe(&watch(0.0)), run.observe(&watch(0.25 * TAU))], angle)
}

#[test]
fn unbalance_and_bow_of_a_jeffcott_rotor_are_the_closed_form() {
    let (zeta, eccentricity, bow) = (0.05, 1.0, 0.5);
    for (ratio, beta) in
        [(0.3, 0.0), (0.5_f64.sqrt(), 0.5 * TAU), (1.0, 0.0), (1.0, 0.5 * TAU), (2.0, 1.0)]
    {
        let speed_hz = ratio * 100.0 / TAU;
        let mut model = Model::new(jeffcott(), zeta, SpeedProfile::Constant(speed_hz));
        model.shafts[0].unbalance.add(&[eccentricity], 0.0);
        model.shafts[0].bow.add(&[bow * 1e4], beta);
        let (found, angle) = settle(Run::new(model, 1e-4, None), 8.0);
        // (e·r² + δ₀·e^{iβ})/(1 − r² + 2iζr), turned with the shaft.
        let (top_re, top_im) = (eccentricity * ratio * ratio + bow * beta.cos(), bow * beta.sin());
        let (low_re, low_im) = (1.0 - ratio * ratio, 2.0 * zeta * ratio);
        let square = low_re * low_re + low_im * low_im;
        let re = (top_re * low_re + top_im * low_im) / square;
        let im = (top_im * low_re - top_re * low_im) / square;
        let expected = [re * angle.cos() - im * angle.sin(), re * angle.sin() + im * angle.cos()];
        for (found, expected) in found.iter().zip(expected) {
            // The transient has fallen to e^(−0.05·100·8) = 4e-18; the step's h⁴ leaves 2e-10.
            assert!((found - expected).abs() < 1e-9, "{ratio} {beta}: {found} {expected}");
        }
    }
}

/// Set A: rig at 40 Hz on two ball bearings, the right one damaged by a step.
pub(in crate::simulator) fn set_a(width_inch: f64, depth_mil: f64) -> (Model, Plane, Vec<f64>) {
    let mut rotor = rig(24);
    for support in &mut rotor.supports {
        support.ring_mass_kg = 0.05;
    }
    let plane = rotor.assemble();
    let places = [3.5148 * INCH, 17.4852 * INCH];
    let stations = places.map(|at| plane.displacement_at(at));
    let basis = Basis::new(&plane, 12, &stations).unwrap();
    let mut model = Model::new(basis, 0.002, SpeedProfile::Constant(40.0));
    for disc in &rotor.discs {
        model.add_unbalance(&plane, disc.at_m, disc.mass_kg * 100e-6, 0.0);
    }
    for (side, station) in stations.into_iter().enumerate() {
        let defect = Defect {
            place: DefectPlace::InnerRace,
            angle_rad: 0.0,
            half_width_rad: 0.5 * width_inch / 0.503_25,
            profile: Profile::Step { depth_m: depth_mil * 25.4e-6 },
        };
        let bearing = BallBearing {
            balls: 11,
            turns: 1.0,
            contact_factor: 9.239e9,
            clearance_m: -0.5e-6,
            cage_ratio: 1.0 / 2.62,
            spin_ratio: 1.992,
            first_ball_rad: 0.0,
            damping_n_s_per_m: 200.0,
            defects: if side == 1 && width_inch > 0.0 { vec![defect] } else { Vec::new() },
            waves: Vec::new(),
        };
        let row = model.basis.row(station);
        let contacts = Contacts::new(bearing);
        model.seats.push(Seat { row, support_n_per_m: 1.078e8, contacts });
    }
    let row = model.basis.row(stations[1]);
    (model, plane, row)
}

fn displacement(step_s: f64, seconds: f64) -> Vec<f64> {
    let (model, _, row) = set_a(0.05, 4.0);
    let mut run = Run::new(model, step_s, None);
    let watch = |axis_rad| Watch { row: row.clone(), axis_rad, quantity: Quantity::Displacement };
    let (x, y) = (watch(0.0), watch(0.25 * TAU));
    let every = (40e-6 / step_s).round();
    let mut out = Vec::new();
    let mut count = 0.0;
    while run.time_s() <= seconds {
        run.step();
        if count % every == 0.0 {
            out.push(run.observe(&x));
            out.push(run.observe(&y));
        }
        count += 1.0;
    }
    out
}

fn error(found: &[f64], reference: &[f64]) -> f64 {
    let largest = reference.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let worst = found.iter().zip(reference).map(|(a, b)| (a - b).abs());
    worst.fold(0.0_f64, f64::max) / largest
}

#[test]
fn steps_cut_at_the_edges_converge_with_the_fourth_power() {
    let seconds = 0.02;
    let reference = displacement(1e-6, seconds);
    let errors: Vec<f64> =
        [20e-6, 10e-6, 5e-6].map(|h| error(&displacement(h, seconds), &reference)).to_vec();
    // The whole start from rest; steps of 5 µs are the source study's 4e-7 of its longer record.
    assert!(errors[0] < 5e-4 && errors[2] < 2e-6, "{errors:?}");
    let order = 0.5 * (errors[0] / errors[2]).log2();
    assert!(order > 3.5, "{order}: {errors:?}");
}

#[test]
fn a_step_is_divided_where_contacts_have_become_too_stiff_for_it() {
    // So many balls that the potential is round; 1 kg a millimetre deep: 5e4 rad/s, 5 rad in a step of 100 µs.
    let bearing = BallBearing {
        balls: 400,
        turns: 1.0,
        contact_factor: 2.75e8,
        clearance_m: 0.0,
        cage_ratio: 0.4,
        spin_ratio: 2.0,
        first_ball_rad: 0.0,
        damping_n_s_per_m: 0.0,
        defects: Vec::new(),
        waves: Vec::new(),
    };
    let run = |at_m: f64| {
        let mut model = Model::new(jeffcott(), 0.0, SpeedProfile::Constant(1e-9));
        let contacts = Contacts::new(bearing.clone());
        model.seats.push(Seat { row: vec![1.0], support_n_per_m: 0.0, contacts });
        Run::new(model, 1e-4, Some((vec![at_m, 0.0], vec![0.0, 0.0])))
    };
    let mut run_of = run(1e-3);
    assert_eq!(run_of.n_parts(run_of.step_s), 4);
    let mut furthest = 0.0_f64;
    for _ in 0..20_000 {
        run_of.step();
        furthest = furthest.max(run_of.state().0[0].hypot(run_of.state().0[1]));
    }
    // Whole steps leave every number behind within a hundred of them; parts at the edge of stability follow coarsely.
    assert!((0.5e-3..5e-3).contains(&furthest), "{furthest}");
    // At rest nothing is divided.
    assert_eq!(run(0.0).n_parts(1e-4), 1);
}
