//! A mesh in motion: parametric resonance, loss of contact, events at any speed, order of the
//! integration.

use super::*;
use crate::simulator::build;
use crate::simulator::mesh::{
    Fault, GearShape, Member, Mesh, MeshDesign, Root, Steel, ToothFault, ToothModel,
};
use crate::simulator::model::GearSeat;
use crate::simulator::modes::Basis;
use crate::simulator::scene::{Scene, builtin};
use crate::simulator::speed::SpeedProfile;
use crate::simulator::torsion::Torsion;
use nalgebra::DMatrix;
use std::f64::consts::TAU;

const TEETH: f64 = 28.0;

/// Mass on the line of action, kg.
const MASS_KG: f64 = 0.5;

fn design(contact_ratio: f64, backlash_m: f64) -> MeshDesign {
    let gear = GearShape::standard(28, 2.54e-3, 20_f64.to_radians(), 10e-3, 16e-3);
    let steel = Steel { young_pa: 206.8e9, poisson: 0.3 };
    MeshDesign {
        gear,
        mate: gear,
        model: ToothModel { steel, root: Root::RootCircle, foundation: true },
        path: gear.path(&gear).with_contact_ratio(contact_ratio),
        backlash_m,
        damping_n_s_per_m: 0.0,
        first_tooth_rad: 0.0,
    }
}

/// One degree of freedom along the line of action under a force, held by `held` times the mean
/// stiffness in its shape. Its approach is −q/√m.
fn one_freedom(
    (mesh, damping): (Mesh, f64),
    (force_n, held): (f64, f64),
    speed: SpeedProfile,
) -> Model {
    let shape = |omega: f64| Basis {
        omega_rad_per_s: vec![omega],
        shapes: DMatrix::from_element(2, 1, 1.0),
        gyroscopic: DMatrix::zeros(1, 1),
    };
    let mean = mesh.mean_stiffness_n_per_m();
    let omega = (held * mean / MASS_KG).sqrt();
    let mut model = Model::new(shape(1000.0), 0.01, speed);
    model.torsion = Some(Torsion {
        basis: shape(omega),
        // The same damping force whatever is held.
        damping: vec![damping / held.sqrt()],
        torque: vec![-force_n / MASS_KG.sqrt()],
        inertia: vec![0.0],
    });
    model.gears.push(GearSeat {
        row: vec![0.0],
        turn: vec![1.0 / MASS_KG.sqrt()],
        drive: [1.0, 0.0],
        back: [-1.0, 0.0],
        held_n_per_m: held * mean,
        mesh,
    });
    model
}

fn approach(run: &Run) -> f64 {
    -run.state().0[2] / MASS_KG.sqrt()
}

/// Natural frequency on the mean stiffness, rad/s.
fn natural(mesh: &Mesh) -> f64 {
    (mesh.mean_stiffness_n_per_m() / MASS_KG).sqrt()
}

/// k(s)/mean at a part of the pitch.
fn variation(mesh: &mut Mesh, part: f64) -> f64 {
    let angle = part * TAU / TEETH;
    mesh.set_side(angle);
    mesh.stiffness_n_per_m(angle) / mesh.mean_stiffness_n_per_m()
}

#[test]
fn the_mesh_pumps_as_mathieu_says() {
    let mut mesh = Mesh::new(design(1.15, f64::INFINITY), &[]);
    let n = 20_000;
    let (mut re, mut im) = (0.0, 0.0);
    for i in 0..n {
        let part = (f64::from(i) + 0.5) / f64::from(n);
        let (sin, cos) = (TAU * part).sin_cos();
        let k = variation(&mut mesh, part);
        (re, im) = (re + k * cos, im + k * sin);
    }
    let epsilon = 2.0 * f64::hypot(re, im) / f64::from(n);
    assert!((0.08..0.2).contains(&epsilon), "{epsilon}");
    let omega = natural(&mesh);
    for zeta in [0.005, 0.01, 0.04] {
        // Teeth mesh at twice the natural frequency.
        let speed = SpeedProfile::Constant(2.0 * omega / TAU / TEETH);
        let model = one_freedom((mesh.clone(), zeta), (1000.0, 1.0), speed);
        let period_s = TAU / omega;
        // Three starts; the differences after two meshes are the map of a free motion on the pumping
        // stiffness, and its larger eigenvalue the growth.
        let rest = model.torsion.as_ref().unwrap().rest()[0];
        let by = 0.01 * rest;
        let ends = [(0.0, 0.0), (by, 0.0), (0.0, by * omega)].map(|(dq, dv)| {
            let state = (vec![0.0, 0.0, rest + dq], vec![0.0, 0.0, dv]);
            let mut run = Run::new(model.clone(), period_s / 400.0, Some(state));
            (0..400).for_each(|_| run.step());
            assert!(!run.model().gears[0].mesh.has_parted());
            [run.state().0[2] / by, run.state().1[2] / (by * omega)]
        });
        let column = |k: usize| [ends[k][0] - ends[0][0], ends[k][1] - ends[0][1]];
        let ([a, c], [b, d]) = (column(1), column(2));
        let (half, det) = (0.5 * (a + d), a * d - b * c);
        let largest = half.abs() + (half * half - det).max(0.0).sqrt();
        let growth = largest.max(det.sqrt()).ln() / TAU;
        let expected = epsilon / 4.0 - zeta;
        // Terms of ε² are left out: other harmonics of the stiffness detune the resonance by that.
        assert!((growth - expected).abs() < 0.1 * epsilon * epsilon, "{zeta}: {growth} {expected}");
    }
}

/// RMS of the dynamic approach ÷ static, by frequency of the teeth ÷ natural, on a slow sweep.
fn sweep(from: f64, to: f64, damping: f64) -> (Vec<f64>, bool) {
    let mesh = Mesh::new(design(1.6, 1e-3), &[]);
    let omega = natural(&mesh);
    let hz = |ratio: f64| ratio * omega / TAU / TEETH;
    let period_s = TAU / omega;
    let seconds = 3000.0 * period_s;
    let speed = SpeedProfile::Table(vec![(0.0, hz(from)), (seconds, hz(to))]);
    let force_n = 200.0;
    let at_rest = force_n / mesh.mean_stiffness_n_per_m();
    let model = one_freedom((mesh, damping), (force_n, 1.0), speed);
    let mut run = Run::new(model, period_s / 60.0, Some((vec![0.0; 2], vec![0.0; 2])));
    let mut levels = Vec::new();
    for _ in 0..30 {
        let list: Vec<f64> = (0..6000)
            .map(|_| {
                run.step();
                approach(&run) / at_rest
            })
            .collect();
        let mean = list.iter().sum::<f64>() / 6000.0;
        levels.push((list.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 6000.0).sqrt());
    }
    (levels, run.model().gears[0].mesh.has_parted())
}

#[test]
fn with_backlash_the_way_up_and_the_way_down_differ() {
    let (up, parted) = sweep(0.6, 1.2, 0.02);
    let (mut down, parted_down) = sweep(1.2, 0.6, 0.02);
    down.reverse();
    assert!(parted && parted_down, "contact is lost at the resonance");
    let ratio = |(u, d): (&f64, &f64)| d / u;
    let most = up.iter().zip(&down).map(ratio).fold(0.0, f64::max);
    // Softening by separation: downwards the large motion lasts to lower speeds, then falls.
    assert!(most > 1.5, "{most}: {up:?} {down:?}");
    let peak = |list: &[f64]| {
        let highest = list.iter().copied().fold(0.0, f64::max);
        list.iter().position(|x| *x >= highest).unwrap()
    };
    assert!(peak(&down) < peak(&up), "{up:?} {down:?}");
    // With much damping the teeth stay together and both ways are one.
    let (up, parted) = sweep(0.6, 1.2, 0.3);
    let (mut down, _) = sweep(1.2, 0.6, 0.3);
    down.reverse();
    assert!(!parted);
    let most = up.iter().zip(&down).map(|(u, d)| (d / u - 1.0).abs()).fold(0.0, f64::max);
    assert!(most < 0.1, "{most}");
}

#[test]
fn what_the_shape_holds_is_given_back_and_the_mean_force_is_that_of_the_load() {
    let omega = natural(&Mesh::new(design(1.6, 1e-4), &[]));
    let track = |held: f64| {
        let mesh = Mesh::new(design(1.6, 1e-4), &[]);
        let speed = SpeedProfile::Constant(0.31 * omega / TAU / TEETH);
        let model = one_freedom((mesh, 0.0), (300.0, held), speed);
        let mut run = Run::new(model, 0.01 * TAU / omega, Some((vec![0.0; 2], vec![0.0; 2])));
        // The static rest of another stiffness is another start.
        run.q[2] = -300.0 / (omega * omega * MASS_KG.sqrt());
        let mut list = Vec::new();
        for _ in 0..2000 {
            run.step();
            list.push(approach(&run));
        }
        list
    };
    let (one, two) = (track(1.0), track(2.0));
    let off = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let size = one.iter().copied().fold(0.0, f64::max);
    // Fourth order at 100 steps a period, 20 periods, undamped.
    assert!(off < 1e-4 * size, "{}", off / size);
}

#[test]
fn events_are_met_at_any_speed_forward_backward_and_through_zero() {
    let profiles = [
        SpeedProfile::Constant(10.0),
        SpeedProfile::Constant(-10.0),
        SpeedProfile::Table(vec![(0.0, 12.0), (0.03, -12.0)]),
        SpeedProfile::Constant(0.0),
    ];
    for speed in profiles {
        let end = |step_s: f64| {
            let fault = Fault::Worn { depth_m: 0.0, stiffness_factor: 0.9 };
            let faults = [ToothFault { member: Member::Gear, tooth: 1, fault }];
            let mesh = Mesh::new(design(1.6, 1e-4), &faults);
            let model = one_freedom((mesh, 0.15), (300.0, 1.0), speed.clone());
            let mut run = Run::new(model, step_s, Some((vec![0.0; 2], vec![0.0; 2])));
            let n = (0.03 / step_s).round();
            let mut list = Vec::new();
            let every = (40e-6 / step_s).round();
            let mut i = 0.0;
            while i < n {
                run.step();
                i += 1.0;
                if i % every == 0.0 {
                    list.push(approach(&run));
                }
            }
            assert!(!run.model().gears[0].mesh.has_parted());
            list
        };
        let (exact, middle, coarse) = (end(1e-6), end(5e-6), end(10e-6));
        let size = exact.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let off = |list: &[f64]| {
            let gaps = list.iter().zip(&exact).map(|(a, b)| (a - b).abs());
            gaps.fold(0.0, f64::max) / size
        };
        let (middle, coarse) = (off(&middle), off(&coarse));
        assert!(coarse < 1e-4, "{speed:?}: {coarse}");
        // At rest there is nothing to follow but rounding.
        let order = (coarse / middle).log2();
        assert!(coarse < 1e-12 || order > 3.5, "{speed:?}: {order} {coarse} {middle}");
    }
}

/// Errors of the gear's and right bearing's motion of a built-in scene, relative to their largest,
/// at these steps against a fine one.
fn errors(text: &str, steps_s: [f64; 3], seconds: f64) -> [f64; 3] {
    let scene = Scene::parse(text, "s").unwrap();
    let built = build::build(&scene).unwrap();
    let n = built.model.basis.len();
    let row = built.model.basis.row(built.plane.displacement_at(scene.bearings[1].place));
    let track = |step_s: f64| {
        let rest = Some((vec![0.0; 2 * n], vec![0.0; 2 * n]));
        let mut run = Run::new(built.model.clone(), step_s, rest);
        let every = (40e-6 / step_s).round();
        let (mut out, mut i) = ([Vec::new(), Vec::new()], 0.0);
        while run.time_s() < seconds {
            run.step();
            i += 1.0;
            if i % every == 0.0 {
                let q = run.state().0;
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                out[0].push(dot(&row, &q[..n]));
                out[1].push(dot(&built.model.gears[0].turn, &q[2 * n..]));
            }
        }
        out
    };
    let exact = track(1e-6);
    assert!(exact[0].iter().all(|x| x.is_finite()));
    steps_s.map(|step_s| {
        let found = track(step_s);
        let off = |i: usize| {
            let size = exact[i].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let gaps = found[i].iter().zip(&exact[i]).map(|(a, b)| (a - b).abs());
            gaps.fold(0.0, f64::max) / size
        };
        off(0).max(off(1))
    })
}

#[test]
fn the_whole_rig_converges_with_the_fourth_power() {
    // Bearings pressed together and a softer tooth: nothing parts, so nothing but time makes edges.
    let text = builtin::text("BG_GS_GB")
        .unwrap()
        .replace("depth_mil = 0.5 ", "stiffness_factor = 0.8 ")
        .replace("clearance_um = 2.0 ", "interference_um = 20.0 ")
        .replace("tooth = 23", "tooth = 1");
    let found = errors(&text, [20e-6, 10e-6, 5e-6], 0.02);
    let order = 0.5 * (found[0] / found[2]).log2();
    assert!(order > 3.5, "{order}: {found:?}");
    // As the steps are chosen for: 2e-5 at 10 µs, and a margin.
    assert!(found[1] < 1e-4, "{found:?}");
}

#[test]
fn teeth_that_part_and_meet_keep_the_order() {
    // Balls with clearance, half a mil off a tooth that comes first; the drive flanks part and hit.
    let text = builtin::text("BG_GS_GB").unwrap().replace("tooth = 23", "tooth = 2");
    let found = errors(&text, [20e-6, 10e-6, 5e-6], 0.05);
    let order = 0.5 * (found[0] / found[2]).log2();
    // Without cuts where teeth meet and part: 3.7e-2, 3.9e-2, 1.1e-2.
    assert!(order > 3.5, "{order}: {found:?}");
    // What the steps of scenes with gears are chosen by.
    assert!(found[1] < 2e-4, "{found:?}");
}
