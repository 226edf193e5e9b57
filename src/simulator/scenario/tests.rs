//! Scenarios: names, limits, growth, and that a scene begins and goes on with them.

use super::super::mesh::Crack;
use super::super::scene::builtin;
use super::super::simulation::{Samples, Simulation};
use super::*;
use std::convert::Infallible;
use std::f64::consts::PI;

fn scene(name: &str) -> Scene {
    Scene::parse(builtin::text(name).unwrap(), name).unwrap()
}

/// The rig with the gear, healthy.
fn rig() -> Scene {
    scene("GG_GS_GB")
}

fn named(scene: &Scene, name: &str) -> Result<Faults, ScenarioError> {
    faults(scene, &Wanted::Combination(name.to_owned()))
}

fn listed(scene: &Scene, faults: Faults) -> Result<Faults, ScenarioError> {
    super::faults(scene, &Wanted::Faults(faults))
}

fn one(defect: SceneDefect) -> Faults {
    Faults { defects: vec![("right".to_owned(), defect)], bow: None, ..Faults::default() }
}

#[test]
fn each_name_means_what_it_says_and_is_found_again() {
    let rig = rig();
    for name in COMBINATIONS {
        let faults = named(&rig, name).unwrap();
        let found = (faults.teeth.len(), faults.bow.is_some(), faults.defects.len());
        let bad = |part: &str| name.contains(part);
        assert_eq!(found, (bad("BG").into(), bad("BS"), bad("BB").into()), "{name}");
        assert!(faults.defects.iter().all(|(id, _)| id == "right"), "{name}");
        // The scene of the same name begins with the same damage, and so does one that is given it.
        assert_eq!(faults, scene(name).faults(), "{name}");
        assert_eq!(faults, with_faults(&rig, &faults).faults(), "{name}");
        assert_eq!(name_of(&rig, &faults), Some(name));
        assert_eq!(listed(&rig, faults.clone()), Ok(faults), "{name}");
    }
}

#[test]
fn a_name_the_scene_cannot_have_is_refused_with_those_it_can() {
    let scene = scene("seed-bearing-40hz-0");
    for (name, words) in [("BG_GS_GB", "needs a gear"), ("bad", "no scenario"), ("", "no scenario")]
    {
        let told = named(&scene, name).unwrap_err().to_string();
        assert!(told.contains(words), "{told}");
        assert!(told.contains("GG_GS_GB, GG_GS_BB, GG_BS_GB, GG_BS_BB"), "{told}");
    }
    let linear = self::scene("seed-bow-2hz");
    let told = named(&linear, "GG_GS_BB").unwrap_err().to_string();
    assert!(
        told.contains("needs a ball bearing") && told.ends_with("GG_GS_GB, GG_BS_GB"),
        "{told}"
    );
}

#[test]
fn numbers_out_of_range_are_refused_at_their_place() {
    let scene = rig();
    let told = |faults| listed(&scene, faults).unwrap_err().to_string();
    let d = BAD_BEARING;
    // π·(33.5 − 7.9375) mm between eleven balls.
    let widest = "inner_race of right, width_mm: found 7.4 mm, allowed: above 0 and below 7.301 mm";
    assert_eq!(told(one(SceneDefect { width_m: 7.4e-3, ..d })), widest);
    for width_m in [0.0, -1e-3, f64::NAN, f64::INFINITY] {
        assert!(
            told(one(SceneDefect { width_m, ..d })).starts_with("inner_race of right, width_mm")
        );
    }
    assert!(
        told(one(SceneDefect { depth_m: 0.2, ..d })).starts_with("inner_race of right, depth_um")
    );
    assert!(
        told(one(SceneDefect { angle_rad: f64::NAN, ..d }))
            .starts_with("inner_race of right, angle_deg")
    );
    let ball = SceneDefect { place: DefectPlace::Element(11), ..d };
    assert_eq!(told(one(ball)), "rolling_element of right, ball: found 11, allowed: 0 to 10");
    let elsewhere =
        Faults { defects: vec![("middle".to_owned(), d)], bow: None, ..Faults::default() };
    assert!(told(elsewhere).ends_with("a ball bearing of the scene: left, right"));
    for amplitude_m in [0.0, -1e-3, 0.1, f64::NAN] {
        let bow = Bow { shaft: None, angle_rad: 0.0, shape: BowShape::HalfSine { amplitude_m } };
        let bent = Faults { defects: Vec::new(), bow: Some(bow), ..Faults::default() };
        assert!(told(bent).starts_with("bow, amplitude_um"));
    }
}

#[test]
fn damage_grows_in_proportion_and_bows_add_as_vectors() {
    let scene = rig();
    let (good, bad) = (named(&scene, "GG_GS_GB").unwrap(), named(&scene, "GG_BS_BB").unwrap());
    assert_eq!(between(&good, &bad, 0.0), good);
    assert_eq!(between(&good, &bad, 1.0), bad);
    let way = between(&good, &bad, 0.25);
    // A quarter of 0.05 in, 4 mil and 8 mil; exact but for rounding.
    let (_, defect) = &way.defects[0];
    assert!((defect.width_m - 0.25 * 1.27e-3).abs() < 1e-15);
    assert!((defect.depth_m - 0.25 * 101.6e-6).abs() < 1e-15);
    assert!((amplitude_m(&way.bow.unwrap().shape) - 0.25 * 203.2e-6).abs() < 1e-15);
    let back = between(&bad, &good, 0.75);
    assert!((back.defects[0].1.width_m - 0.25 * 1.27e-3).abs() < 1e-15);
    let larger = one(SceneDefect { width_m: 3.0 * 1.27e-3, ..BAD_BEARING });
    let grown = between(&one(BAD_BEARING), &larger, 0.5);
    assert!((grown.defects[0].1.width_m - 2.0 * 1.27e-3).abs() < 1e-15 && grown.defects.len() == 1);
    let bent = |angle_rad| Faults {
        defects: Vec::new(),
        bow: Some(Bow { shaft: None, angle_rad, shape: BowShape::HalfSine { amplitude_m: 1e-4 } }),
        ..Faults::default()
    };
    let turned = between(&bent(0.0), &bent(0.5 * PI), 0.5).bow.unwrap();
    // Halfway between two at right angles: both halves, at 45°.
    assert!((amplitude_m(&turned.shape) - 1e-4 / 2.0_f64.sqrt()).abs() < 1e-16);
    assert!((turned.angle_rad - 0.25 * PI).abs() < 1e-12);
    let points = BowShape::Points(vec![(0.1, 0.0), (0.2, -1e-4), (0.3, 0.0)]);
    let other = Faults {
        defects: Vec::new(),
        bow: Some(Bow { shaft: None, angle_rad: 0.0, shape: points }),
        ..Faults::default()
    };
    let sizes = [0.25, 0.5, 0.75].map(|part| {
        between(&other, &bent(0.0), part).bow.map_or(0.0, |bow| amplitude_m(&bow.shape))
    });
    for (size, expected) in sizes.into_iter().zip([0.5e-4, 0.0, 0.5e-4]) {
        assert!((size - expected).abs() < 1e-16, "{sizes:?}");
    }
}

fn worn(tooth: u32, depth_m: f64, stiffness_factor: f64) -> ToothFault {
    let fault = Fault::Worn { depth_m, stiffness_factor };
    ToothFault { member: Member::Gear, tooth, fault }
}

fn teeth(list: &[ToothFault]) -> Faults {
    let teeth = list.iter().map(|fault| ("mesh-1".to_owned(), *fault)).collect();
    Faults { teeth, ..Faults::default() }
}

#[test]
fn teeth_that_are_not_there_or_cannot_be_are_refused_at_their_place() {
    let scene = rig();
    let told = |list: &[ToothFault]| listed(&scene, teeth(list)).unwrap_err().to_string();
    let good = worn(27, 12.7e-6, 0.6);
    assert!(listed(&scene, teeth(&[good])).is_ok());
    let expected = "tooth_damage of mesh-1, tooth: found 29, allowed: 1 to 28";
    assert_eq!(told(&[worn(28, 1e-6, 1.0)]), expected);
    let largest = ToothFault { tooth: u32::MAX, ..good };
    assert!(told(&[largest]).contains("found 4294967296"));
    let one = |fault: Fault| ToothFault { fault, ..good };
    let crack = |depth_m, deg: f64| Fault::Cracked(Crack { depth_m, angle_rad: deg.to_radians() });
    for (fault, key) in [
        (Fault::Worn { depth_m: -1e-6, stiffness_factor: 1.0 }, "depth_um: found -1, "),
        (Fault::Worn { depth_m: 0.02, stiffness_factor: 1.0 }, "depth_um: found 20000, "),
        (Fault::Worn { depth_m: f64::NAN, stiffness_factor: 1.0 }, "depth_um: found NaN, "),
        (Fault::Worn { depth_m: 0.0, stiffness_factor: 0.0 }, "stiffness_factor: found 0, "),
        (Fault::Worn { depth_m: 0.0, stiffness_factor: 1.5 }, "stiffness_factor: found 1.5, "),
        (crack(0.0, 60.0), "depth_um: found 0, allowed: above 0"),
        (crack(f64::NAN, 60.0), "depth_um: found NaN, "),
        (crack(1e-3, 120.0), "crack_angle_deg: found 12"),
        (Fault::Profile { slope_m: 0.02, form_m: 0.0 }, "slope_um: found 20000, "),
        (Fault::Profile { slope_m: 0.0, form_m: f64::INFINITY }, "form_um: found inf, "),
        (Fault::Pitch { offset_m: -0.02 }, "offset_um: found -20000, "),
        // A tooth of module 2.54 mm is 4 mm thick at its pitch circle.
        (Fault::Worn { depth_m: 4e-3, stiffness_factor: 1.0 }, "depth_um: found tooth 28 worn"),
        (crack(5e-3, 90.0), "depth_um: found tooth 28 worn and cracked down to"),
    ] {
        let told = told(&[one(fault)]);
        assert!(told.starts_with(&format!("tooth_damage of mesh-1, {key}")), "{told}");
    }
    assert!(listed(&scene, teeth(&[one(crack(1e-3, 90.0))])).is_ok(), "a limit is allowed");
    // One alone can be, both together cannot.
    let both =
        [worn(3, 1.2e-3, 1.0), ToothFault { fault: crack(2.4e-3, 90.0), ..worn(3, 0.0, 1.0) }];
    for alone in both {
        assert!(listed(&scene, teeth(&[alone])).is_ok(), "{alone:?}");
    }
    assert!(told(&both).contains("tooth 4 worn and cracked"));
    assert!(told(&[good, good]).contains("two faults of the same kind of tooth 28"));
    assert!(listed(&scene, teeth(&[good, ToothFault { member: Member::Mate, ..good }])).is_ok());
    let elsewhere = Faults { teeth: vec![("mesh-2".to_owned(), good)], ..Faults::default() };
    let error = listed(&scene, elsewhere.clone()).unwrap_err().to_string();
    assert!(error.ends_with("found \"mesh-2\", allowed: the id of a gear of the scene: mesh-1"));
    let gearless = self::scene("run-up");
    let error = listed(&gearless, elsewhere).unwrap_err().to_string();
    assert!(error.ends_with("allowed: no gear: the scene has none"), "{error}");
}

#[test]
fn teeth_wear_in_proportion_and_go_missing_at_the_end() {
    let scene = rig();
    let (good, bad) = (named(&scene, "GG_GS_GB").unwrap(), named(&scene, "BG_GS_GB").unwrap());
    let size = |faults: &Faults| match faults.teeth[..] {
        [(_, ToothFault { fault: Fault::Worn { depth_m, stiffness_factor }, tooth, .. })] => {
            (tooth, depth_m, stiffness_factor)
        }
        _ => panic!("{faults:?}"),
    };
    let close = |found: (u32, f64, f64), expected: (u32, f64, f64)| {
        // Rounding of lengths below a millimetre and of a factor of one.
        let near = (found.1 - expected.1).abs() < 1e-18 && (found.2 - expected.2).abs() < 1e-15;
        assert!(found.0 == expected.0 && near, "{found:?} {expected:?}");
    };
    close(size(&between(&good, &bad, 0.25)), (22, 0.25 * 12.7e-6, 1.0));
    close(size(&between(&bad, &good, 0.25)), (22, 0.75 * 12.7e-6, 1.0));
    close(size(&between(&good, &teeth(&[worn(4, 8e-6, 0.6)]), 0.5)), (4, 4e-6, 0.8));
    let (less, more) = (teeth(&[worn(4, 8e-6, 0.6)]), teeth(&[worn(4, 16e-6, 0.2)]));
    close(size(&between(&less, &more, 0.5)), (4, 12e-6, 0.4));
    let of = |fault: Fault| teeth(&[ToothFault { fault, ..worn(4, 0.0, 1.0) }]);
    let only = |faults: Faults| faults.teeth[0].1.fault;
    let crack = |depth_m, angle_rad| of(Fault::Cracked(Crack { depth_m, angle_rad }));
    let Fault::Cracked(half) = only(between(&good, &crack(2e-3, 0.8), 0.5)) else {
        panic!("crack")
    };
    assert!((half.depth_m - 1e-3).abs() < 1e-18 && (half.angle_rad - 0.8).abs() < 1e-15);
    let other = between(&crack(1e-3, 1.0), &crack(2e-3, 0.8), 0.5);
    assert_eq!(other.teeth.len(), 1, "a crack turns into the other: {other:?}");
    let errors = of(Fault::Profile { slope_m: 4e-6, form_m: -2e-6 });
    let Fault::Profile { slope_m, form_m } = only(between(&good, &errors, 0.5)) else {
        panic!("a profile")
    };
    assert!((slope_m - 2e-6).abs() < 1e-18 && (form_m + 1e-6).abs() < 1e-18);
    let Fault::Pitch { offset_m } =
        only(between(&of(Fault::Pitch { offset_m: 8e-6 }), &good, 0.75))
    else {
        panic!("a pitch")
    };
    assert!((offset_m - 2e-6).abs() < 1e-18);
    let gone = of(Fault::Missing);
    assert_eq!(between(&good, &gone, 0.99), good);
    assert_eq!(between(&good, &gone, 1.0), gone);
    assert_eq!(between(&gone, &good, 0.99), gone);
    assert_eq!(between(&gone, &gone, 0.5), gone);
    // Two kinds of damage to one tooth are two faults.
    let both = between(&less, &crack(2e-3, 0.8), 0.5);
    assert_eq!(both.teeth.len(), 2);
    assert_eq!(listed(&scene, both.clone()), Ok(both));
}

#[test]
fn a_scene_with_faults_begins_with_them() {
    let scene = rig();
    let bad = named(&scene, "BG_BS_BB").unwrap();
    let damaged = with_faults(&scene, &bad);
    assert_eq!(damaged.faults(), bad);
    assert_eq!(with_faults(&damaged, &Faults::default()).faults(), scene.faults());
    let mut simulation = Simulation::new(&damaged, 1).unwrap();
    let probe = simulation.channels().position(|c| c.name == "mid_x").unwrap();
    let (mut low, mut high) = (i16::MAX, i16::MIN);
    let mut watch = |channel: usize, samples: Samples<'_>| {
        if let (true, Samples::Int16(counts)) = (channel == probe, samples) {
            low = low.min(*counts.iter().min().unwrap());
            high = high.max(*counts.iter().max().unwrap());
        }
        Ok::<(), Infallible>(())
    };
    simulation.advance(1000, &mut watch).unwrap();
    // One turn from time 0 on: 1× of the bow, 1000 µm full scale over 2¹⁵ counts; what resonance
    // at 117 Hz and the bearings add to 203 µm is below 10 %.
    let swing_um = (f64::from(high) - f64::from(low)) * 1000.0 / 32_768.0;
    assert!((swing_um / (2.0 * 203.2) - 1.0).abs() < 0.1, "{swing_um}");
}
