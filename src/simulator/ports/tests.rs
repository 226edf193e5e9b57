//! The fast way against the slow one, and against itself at finer steps.

use super::*;
use crate::simulator::contact::{Contacts, Defect, DefectPlace, Profile, Wave};
use crate::simulator::run::tests::set_a;
use crate::simulator::run::{Quantity, Run};
use crate::simulator::sensor::{Chain, SensorModel};
use nalgebra::{Complex, DMatrix};
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

fn sensed(model: &Model, corner_hz: Option<f64>) -> Vec<Sensed> {
    watches(model).into_iter().map(|watch| Sensed { watch, corner_hz }).collect()
}

fn port_run(model: &Model, step_s: f64) -> PortRun {
    let run = PortRun::new(model, step_s, 0, None).expect("a diagonal form");
    run.watching(&sensed(model, None), 1)
}

fn fast(mut run: PortRun, n: usize, every: usize) -> Vec<Vec<f64>> {
    let mut out = vec![Vec::new(); run.n_watches()];
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

/// Clearance of 2 µm under gravity: balls touch and leave all the time.
fn set_d(width_inch: f64) -> Model {
    let (mut model, plane, _) = set_a(width_inch, 4.0);
    model.add_acceleration(&plane, [0.0, -9.81]);
    for seat in &mut model.seats {
        let mut bearing = seat.contacts.bearing().clone();
        bearing.clearance_m = 2e-6;
        seat.contacts = Contacts::new(bearing);
    }
    model
}

/// Every kind of defect, and waves, on both bearings.
fn all_kinds() -> Model {
    let mut model = set_d(0.0);
    let half_width_rad = 0.03;
    let defect = |place, profile, angle_rad| Defect { place, angle_rad, half_width_rad, profile };
    let cosine = Profile::RaisedCosine { depth_m: 3e-6 };
    let slot = Profile::Geometric { depth_m: 1e-4, half_width_m: 4e-4, curvature_per_m: 320.0 };
    let kinds = [
        vec![
            defect(DefectPlace::InnerRace, Profile::Step { depth_m: 1e-5 }, 0.4),
            defect(DefectPlace::InnerRace, slot, 2.0),
        ],
        vec![
            defect(DefectPlace::OuterRace, cosine, 4.7),
            defect(DefectPlace::Element(3), cosine, 0.0),
        ],
    ];
    for (seat, defects) in model.seats.iter_mut().zip(kinds) {
        let mut bearing = seat.contacts.bearing().clone();
        bearing.defects = defects;
        bearing.waves = vec![Wave { order: 9, amplitude_m: 2e-7, phase_rad: 1.0 }];
        seat.contacts = Contacts::new(bearing);
    }
    model
}

/// Largest error of what sensors behind their filters see with so many steps a sample of 100 µs,
/// against steps sixteen times shorter, 20 ms from rest.
fn error(base: &PortRun, steps: u32) -> f64 {
    error_in(base, (200, steps), 16)
}

/// The same in so many samples against steps so many times shorter.
fn error_in(base: &PortRun, (n_samples, steps): (usize, u32), times: u32) -> f64 {
    let watches = sensed(&base.model, Some(4000.0));
    let seen = |steps: u32| {
        let run = base.clone().with_step(1e-4 / f64::from(steps), 0);
        fast(run.watching(&watches, steps), n_samples * steps as usize, 1)
    };
    differences(&seen(steps), &seen(times * steps)).into_iter().fold(0.0, f64::max)
}

#[test]
fn filters_are_the_digital_ones_at_a_high_rate() {
    // A step of the acceleration at every edge of the defect passes them.
    let (model, ..) = set_a(0.05, 4.0);
    let steps = 100;
    let exact = port_run(&model, 1e-6).watching(&sensed(&model, Some(4000.0)), steps);
    let exact = fast(exact, 20_000, 1);
    let points = fast(port_run(&model, 1e-6), 20_000, 1);
    let digital = SensorModel {
        oversampling: steps,
        rate_hz: 10_000.0,
        corner_hz: Some(4000.0),
        noise_density: 0.0,
        drift_per_s: 0.0,
        rest: 0.0,
        converter: None,
        dropouts_s: Vec::new(),
    };
    let through = |list: &Vec<f64>| {
        let mut chain = Chain::new(digital.clone(), 1, 0);
        // At rest before the start, as the exact filter is.
        std::iter::once(&0.0).chain(list).filter_map(|x| chain.push(*x)).collect()
    };
    let found: Vec<Vec<f64>> = points.iter().map(through).collect();
    // The digital one is a step late and sees points of a jump: 1 µs of 250 µs a radian of 4 kHz at
    // most, and what warps.
    let found: Vec<Vec<f64>> = found.into_iter().map(|list| list[..200].to_vec()).collect();
    let gaps = differences(&found, &exact);
    assert!(gaps.iter().all(|gap| *gap < 3e-2), "{gaps:?}");
}

#[test]
fn the_fast_way_goes_where_the_slow_one_goes() {
    for (name, model) in [("A", set_a(0.05, 4.0).0), ("D", set_d(0.0)), ("all", all_kinds())] {
        let found = fast(port_run(&model, 2.5e-6), 4000, 4);
        let expected = slow(&model, 2.5e-6, 4000, 4);
        // Both have errors at 2.5 µs: displacement 1e-7, unfiltered acceleration 2e-6 (A), and where
        // balls touch or leave 1e-5.
        let limit = if name == "A" { 3e-6 } else { 3e-5 };
        let differences = differences(&found, &expected);
        assert!(differences.iter().all(|d| *d < limit), "{name}: {differences:?}");
    }
}

#[test]
fn twenty_microseconds_keep_a_ten_thousandth() {
    let run = port_run(&set_a(0.05, 4.0).0, 2e-5);
    let errors = [5, 10, 20].map(|steps| error(&run, steps));
    assert!(errors[0] < 1e-4, "{errors:?}");
    let order = 0.5 * (errors[0] / errors[2]).log2();
    assert!(order > 3.5, "{order}: {errors:?}");
}

#[test]
fn cut_at_contacts_the_order_survives_clearance() {
    let run = port_run(&set_d(0.05), 2e-5);
    let cut = run.clone().cutting_at_contact(true);
    let errors = [5, 20].map(|steps| error(&cut, steps));
    let order = 0.5 * (errors[0] / errors[1]).log2();
    assert!(order > 3.3, "{order}: {errors:?}");
    // Without, what a touch misses goes with the 2.5th power of the step.
    let plain = error(&run.with_parts_of_events(1), 20);
    assert!(plain > 3.0 * errors[1], "{plain:.1e} {errors:?}");
}

#[test]
fn how_a_run_is_cut_into_calls_changes_no_bit() {
    for cuts in [false, true] {
        let run = port_run(&all_kinds(), 2e-5).cutting_at_contact(cuts);
        let whole = fast(run.clone(), 1000, 1);
        let mut pieces = vec![Vec::new(); run.n_watches()];
        let mut piecewise = run;
        for n in [1, 63, 64, 65, 7, 300, 500] {
            piecewise.fill(n, &mut pieces);
        }
        assert!(whole == pieces, "bit by bit");
    }
}

#[test]
fn changed_loads_leave_the_motion_where_it_is() {
    let (model, ..) = set_a(0.0, 4.0);
    let (damaged, ..) = set_a(0.05, 4.0);
    let watches = sensed(&model, Some(4000.0));
    let mut run = port_run(&model, 2e-5).watching(&watches, 1);
    run.fill(500, &mut vec![Vec::new(); watches.len()]);
    let before = run.state();
    assert!(run.change(&damaged, &watches));
    let after = run.state();
    for (before, after) in before.0.iter().zip(&after.0) {
        // Two changes of coordinates of condition 1e4 at most.
        assert!((before - after).abs() < 1e-14 * 1e4 * 1e-6 + 1e-12 * before.abs());
    }
    // From here on it is the run of the damaged bearing from that state.
    let fresh = PortRun::new(&damaged, 2e-5, 500, Some((&after.0[..], &after.1[..]))).unwrap();
    let mut fresh = fresh.watching(&watches, 1);
    let mut lists = [vec![Vec::new(); watches.len()], vec![Vec::new(); watches.len()]];
    run.fill(500, &mut lists[0]);
    fresh.fill(500, &mut lists[1]);
    // The two stand on different mean stiffnesses: the error of 20 µs, once the empty filter has
    // caught up with the one that went on, e^(−0.195·2π·4000·5 ms).
    let late = |list: &Vec<f64>| list[250..].to_vec();
    let [a, b] = lists.map(|lists| lists.iter().map(late).collect::<Vec<_>>());
    let gaps = differences(&a, &b);
    assert!(gaps.iter().all(|gap| *gap < 3e-4), "{gaps:?}");
}

#[test]
fn the_maps_of_a_step_are_the_exponentials() {
    let values = [Complex::new(-3.0, 700.0), Complex::new(-200.0, 9e4), Complex::new(0.0, 5.0)];
    let one = vec![vec![Complex::new(1.0, 0.0); 3]];
    let ported = Ported::new(&values, &one, &one, &[]);
    let mut map = StepMap::new(&ported);
    for step_s in [1e-9, 3e-6, 2e-5, 3e-4] {
        Arch::new().dispatch(SetStep { map: &mut map, ported: &ported, step_s });
        for (found, value) in lanes::numbers(&map.whole, 3).iter().zip(values) {
            let expected = (value * step_s).exp();
            // Series and doublings, each a few roundings.
            assert!((found - expected).norm() < 1e-13, "{step_s}: {found} {expected}");
        }
        // Forces that stay: start + 2·middle + end = h·φ₁ = (e^z − 1)/λ.
        let exact: f64 = values.iter().map(|v| (((v * step_s).exp() - 1.0) / v).re).sum();
        let found = map.weighted[0][0][0] + 2.0 * map.weighted[1][0][0] + map.weighted[2][0][0];
        assert!((found - exact).abs() < 1e-12 * step_s, "{step_s}: {found} {exact}");
    }
}

#[test]
fn a_spectrum_carries_the_state_as_the_matrix_exponential() {
    let (model, ..) = set_a(0.0, 4.0);
    let matrix = LinearSystem::new(&model, TAU * 40.0).matrix().clone();
    let spectrum = Spectrum::of(&matrix).unwrap();
    let n = matrix.nrows();
    let start = nalgebra::DVector::from_fn(n, |i, _| ((i * i) as f64).sin());
    let seconds = 1e-3;
    let grown: Vec<Complex<f64>> = spectrum
        .input(&start)
        .iter()
        .zip(&spectrum.values)
        .map(|(s, value)| s * (value * seconds).exp())
        .collect();
    let expected = (&matrix * seconds).exp() * &start;
    // 66 rad of the fastest: rounding of λ·t and of the exponential's squarings.
    assert!((spectrum.state(&grown) - expected).amax() < 1e-10);
    // Overdamped: −1 and −100 beside a turning pair.
    let damped = DMatrix::from_row_slice(
        4,
        4,
        &[0.0, 1.0, 0.0, 0.0, -100.0, -101.0, 0.0, 0.0, 0.0, 0.0, 0.0, 7.0, 1.0, 0.0, -7.0, -0.1],
    );
    let spectrum = Spectrum::of(&damped).unwrap();
    assert_eq!(spectrum.values.len(), 3);
    let start = nalgebra::DVector::from_vec(vec![1.0, 2.0, -0.5, 0.3]);
    let coordinates = spectrum.input(&start);
    let grown: Vec<Complex<f64>> = coordinates
        .iter()
        .zip(&spectrum.values)
        .map(|(s, value)| s * (value * 0.3).exp())
        .collect();
    let expected = (&damped * 0.3).exp() * &start;
    // Rounding of a few dozen operations.
    assert!((spectrum.state(&grown) - expected).amax() < 1e-12);
    // A double root without two vectors has no such form.
    let defective = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    assert!(Spectrum::of(&defective).is_none());
}

/// A built-in scene's model, with watches of its first two bearings.
fn built(name: &str) -> Model {
    let text = crate::simulator::scene::builtin::text(name).unwrap();
    let scene = crate::simulator::scene::Scene::parse(text, name).unwrap();
    crate::simulator::build::build(&scene).unwrap().model
}

#[test]
fn meshes_go_the_same_way_together_and_parting() {
    // 20 ms from rest: the load sets in at once, the teeth part and meet.
    for name in ["BG_GS_GB", "BG_BS_BB", "reducer-10hz"] {
        let model = built(name);
        let found = fast(port_run(&model, 2.5e-6), 8000, 4);
        let expected = slow(&model, 2.5e-6, 8000, 4);
        let gaps = differences(&found, &expected);
        // Errors of both at 2.5 µs, of unfiltered accelerations, balls that touch and leave included.
        assert!(gaps.iter().all(|gap| *gap < 2e-5), "{name}: {gaps:?}");
    }
}

#[test]
fn steps_in_parts_where_something_happens_are_worth_it() {
    // A flank with half a mil missing lets the teeth part and hit once in a turn, 0.08 s from the
    // start; balls with clearance touch and leave.
    let worn = port_run(&built("BG_GS_GB"), 2e-5);
    let loose = port_run(&set_d(0.05), 2e-5);
    for (name, run, n_samples, times) in [("worn", worn, 1000, 3.0), ("loose", loose, 200, 1.5)] {
        let [whole, parts] = [1, 2]
            .map(|parts| error_in(&run.clone().with_parts_of_events(parts), (n_samples, 8), 4));
        assert!(times * parts < whole, "{name}: {parts:.1e} {whole:.1e}");
    }
}
