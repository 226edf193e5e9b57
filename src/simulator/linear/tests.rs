//! The exact propagation against closed forms and against the integrator.

use super::*;
use crate::simulator::modes::Basis;
use crate::simulator::run::Run;
use crate::simulator::speed::SpeedProfile;

fn jeffcott(zeta: f64, speed_hz: f64) -> Model {
    let basis = Basis {
        omega_rad_per_s: vec![100.0],
        shapes: DMatrix::from_element(2, 1, 1.0),
        gyroscopic: DMatrix::zeros(1, 1),
    };
    Model::new(basis, zeta, SpeedProfile::Constant(speed_hz))
}

fn watch(axis_rad: f64) -> Watch {
    Watch { row: vec![1.0], axis_rad, quantity: Quantity::Displacement }
}

/// (e·r² + δ₀·e^{iβ})/(1 − r² + 2iζr).
fn closed_form(zeta: f64, e: f64, bow: f64, beta: f64, r: f64) -> (f64, f64) {
    let (top_re, top_im) = (e * r * r + bow * beta.cos(), bow * beta.sin());
    let (low_re, low_im) = (1.0 - r * r, 2.0 * zeta * r);
    let square = low_re * low_re + low_im * low_im;
    ((top_re * low_re + top_im * low_im) / square, (top_im * low_re - top_re * low_im) / square)
}

fn amplitude(r: f64, bow: f64, beta: f64) -> (f64, f64) {
    let speed_hz = 100.0 * r / TAU;
    let mut model = jeffcott(0.05, speed_hz);
    model.shafts[0].unbalance.add(&[1.0], 0.0);
    model.shafts[0].bow.add(&[bow * 1e4], beta);
    let run =
        LinearRun::new(&model, speed_hz, &[watch(0.0), watch(0.25 * TAU)], 1e4, None).unwrap();
    // The phasor of x is conjugate to the complex displacement turned with the shaft.
    let phasor = |seen: &Seen| (seen.still[1], -seen.still[2]);
    let ((re, im), (y_re, y_im)) = (phasor(&run.seen[0]), phasor(&run.seen[1]));
    assert!((y_re - im).abs() < 1e-9 && (y_im + re).abs() < 1e-9, "y lags x by a quarter");
    (re, im)
}

#[test]
fn jeffcott_with_unbalance_and_bow_is_the_closed_form() {
    for i in 1..=60 {
        let r = 0.05 * f64::from(i) + 0.05;
        for (bow, beta) in [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5 * TAU), (0.5, 1.0)] {
            let (re, im) = amplitude(r, bow, beta);
            let (x, y) = closed_form(0.05, 1.0, bow, beta, r);
            // x = Re((x + iy)·e^{iφ}); rounding, times the resonance's ten.
            assert!((re - x).abs() < 1e-9 && (im - y).abs() < 1e-9, "{r}: {re} {im}, {x} {y}");
        }
    }
    let size = |(re, im): (f64, f64)| re.hypot(im);
    assert!(size(amplitude(0.5_f64.sqrt(), 0.5, 0.5 * TAU)) < 1e-12, "they cancel");
    for (bow, beta, expected) in [(0.0, 0.0, 10.0), (0.5, 0.0, 15.0), (0.5, 0.5 * TAU, 5.0)] {
        let found = size(amplitude(1.0, bow, beta));
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn a_free_motion_keeps_amplitude_and_phase() {
    let omega = TAU * 117.0;
    let basis = Basis {
        omega_rad_per_s: vec![omega],
        shapes: DMatrix::from_element(2, 1, 1.0),
        gyroscopic: DMatrix::zeros(1, 1),
    };
    let model = Model::new(basis, 0.0, SpeedProfile::Constant(0.0));
    let start = (vec![1.0, 0.0], vec![0.0, 0.0]);
    let state = Some((&start.0[..], &start.1[..]));
    let mut run = LinearRun::new(&model, 0.0, &[watch(0.0)], 1e4, state).unwrap();
    let mut out = vec![Vec::new()];
    for _ in 0..100 {
        run.fill(1000, &mut out); // 10 s in all
    }
    let (q, v) = run.state();
    let size = q[0].hypot(v[0] / omega);
    let phase = (-v[0] / omega).atan2(q[0]); // 1170 whole turns
    assert!((size - 1.0).abs() < 1e-10, "{size}");
    // 1e-9 rad a second.
    assert!(phase.abs() < 1e-8, "{phase}");
}

#[test]
fn the_exact_run_and_the_integrator_agree() {
    use crate::simulator::model::LinearSeat;
    use crate::simulator::rotor::tests::rig;
    let plane = rig(12).assemble();
    let basis = Basis::new(&plane, 4, &[plane.displacement_at(3.5148 * 0.0254)]).unwrap();
    let mut model = Model::new(basis, 0.02, SpeedProfile::Constant(30.0));
    model.add_unbalance(&plane, 0.2, 1e-4, 0.4);
    model.add_acceleration(&plane, [0.0, -9.81]);
    let row = model.basis.row(plane.displacement_at(3.5148 * 0.0254));
    model.linear_seats.push(LinearSeat {
        row,
        stiffness_n_per_m: [[2e6, 3e5], [-3e5, 1e6]],
        damping_n_s_per_m: [[300.0, 20.0], [20.0, 200.0]],
    });
    let mid = model.basis.row(plane.displacement_at(10.5 * 0.0254));
    let watches: Vec<Watch> = [Quantity::Displacement, Quantity::Acceleration]
        .into_iter()
        .flat_map(|quantity| {
            [0.3, 1.7].map(|axis_rad| Watch { row: mid.clone(), axis_rad, quantity })
        })
        .collect();
    let zero = vec![0.0; 2 * model.basis.len()];
    let state = Some((&zero[..], &zero[..]));
    let mut exact = LinearRun::new(&model, 30.0, &watches, 1e4, state).unwrap();
    let mut out = vec![Vec::new(); watches.len()];
    exact.fill(1000, &mut out);
    let mut run = Run::new(model, 2e-6, None);
    let largest: Vec<f64> =
        out.iter().map(|list| list.iter().fold(0.0_f64, |m, x| m.max(x.abs()))).collect();
    for i in 0..1000 {
        run.step();
        for ((list, watch), largest) in out.iter().zip(&watches).zip(&largest) {
            let found = run.observe(watch);
            // The integrator's h⁴; both planes start from rest.
            assert!((list[i] - found).abs() < 1e-8 * largest, "{i}: {} {found}", list[i]);
        }
        for _ in 1..50 {
            run.step();
        }
    }
}

/// The rig on bearings with cross terms and dampers from rest, displacement and acceleration in the
/// middle.
fn rig_from_rest() -> LinearRun {
    use crate::simulator::model::LinearSeat;
    use crate::simulator::rotor::tests::rig;
    let plane = rig(12).assemble();
    let basis = Basis::new(&plane, 8, &[plane.displacement_at(3.5148 * 0.0254)]).unwrap();
    let mid = basis.row(plane.displacement_at(10.5 * 0.0254));
    let row = basis.row(plane.displacement_at(3.5148 * 0.0254));
    let mut model = Model::new(basis, 0.02, SpeedProfile::Constant(30.0));
    model.add_unbalance(&plane, 0.2, 1e-4, 0.4);
    model.add_acceleration(&plane, [0.0, -9.81]);
    model.linear_seats.push(LinearSeat {
        row,
        stiffness_n_per_m: [[2e6, 3e5], [-3e5, 1e6]],
        damping_n_s_per_m: [[300.0, 20.0], [20.0, 200.0]],
    });
    let watches = [Quantity::Displacement, Quantity::Acceleration].map(|quantity| Watch {
        row: mid.clone(),
        axis_rad: 0.3,
        quantity,
    });
    let zero = vec![0.0; 2 * model.basis.len()];
    LinearRun::new(&model, 30.0, &watches, 1e4, Some((&zero[..], &zero[..]))).unwrap()
}

#[test]
fn coordinates_go_where_the_matrix_exponential_goes() {
    let mut fast = rig_from_rest();
    let mut slow = fast.clone().by_propagator();
    let mut lists = [vec![Vec::new(); 2], vec![Vec::new(); 2]];
    let mut largest = [0.0_f64; 2];
    // 2 s: the highest coordinates die out on the way.
    for block in 0..20 {
        fast.fill(1000, &mut lists[0]);
        slow.fill(1000, &mut lists[1]);
        for ((fast, slow), largest) in lists[0].iter().zip(&lists[1]).zip(&mut largest) {
            assert_eq!(fast.len(), 1000);
            *largest = slow.iter().fold(*largest, |most, x| most.max(x.abs()));
            // Condition of the vectors times what 20 000 products of the dense one round.
            let gap = fast.iter().zip(slow).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(gap < 1e-10 * *largest, "{block}: {gap:e} of {largest:e}");
        }
    }
    let (fast, slow) = (fast.state(), slow.state());
    let largest = slow.0.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(fast.0.iter().zip(&slow.0).all(|(a, b)| (a - b).abs() < 1e-10 * largest));
}

#[test]
fn how_a_linear_run_is_cut_into_calls_changes_no_bit() {
    let (mut whole, mut cut) = (rig_from_rest(), rig_from_rest());
    let (mut all, mut part) = (vec![Vec::new(); 2], vec![Vec::new(); 2]);
    whole.fill(2000, &mut all);
    let mut pieces = vec![Vec::<f64>::new(); 2];
    for n in [1, 7, 8, 9, 3, 972, 1000] {
        cut.fill(n, &mut part);
        pieces.iter_mut().zip(&part).for_each(|(list, part)| list.extend(part));
    }
    assert!(all == pieces && whole.state() == cut.state(), "bit by bit");
}

#[test]
fn a_state_in_the_middle_of_a_chunk_goes_on_from_there() {
    let mut run = rig_from_rest();
    let mut list = vec![Vec::new(); 2];
    let mut other = run.clone();
    run.fill(1003, &mut list);
    let (q, v) = run.state();
    run.begin_again(&q, &v);
    run.fill(100, &mut list);
    let mut expected = vec![Vec::new(); 2];
    other.fill(1103, &mut expected);
    for (found, expected) in list.iter().zip(&expected) {
        let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let late = &expected[1003..];
        // Two changes of coordinates.
        assert!(found.iter().zip(late).all(|(a, b)| (a - b).abs() < 1e-10 * largest));
    }
}

#[test]
fn a_cross_coupled_bearing_can_make_motions_grow() {
    use crate::simulator::model::LinearSeat;
    let seat = |cross: f64| LinearSeat {
        row: vec![1.0],
        stiffness_n_per_m: [[0.0, cross], [-cross, 0.0]],
        damping_n_s_per_m: [[0.0; 2]; 2],
    };
    let growth = |cross: f64| {
        let mut model = jeffcott(0.05, 1.0);
        model.linear_seats.push(seat(cross));
        LinearSystem::new(&model, TAU).growth_rad_per_s()
    };
    // The limit is 2ζω² = 1000: at k/(2ω) = ζω the circling motion neither grows nor dies.
    assert!((growth(0.0) + 5.0).abs() < 1e-9);
    assert!(growth(990.0) < 0.0 && growth(1010.0) > 0.0);
}
