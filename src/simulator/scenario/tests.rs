//! Scenarios: names, limits, growth, and that a scene begins and goes on with them.

use super::super::scene::builtin;
use super::super::simulation::{Samples, Simulation};
use super::*;
use std::convert::Infallible;

fn demo() -> Scene {
    Scene::parse(builtin::text("demo").unwrap(), "demo").unwrap()
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
    let scene = demo();
    for (name, n_defects, is_bent) in [
        ("GG_GS_GB", 0, false),
        ("GG_GS_BB", 1, false),
        ("GG_BS_GB", 0, true),
        ("GG_BS_BB", 1, true),
    ] {
        let faults = named(&scene, name).unwrap();
        assert_eq!((faults.defects.len(), faults.bow.is_some()), (n_defects, is_bent), "{name}");
        assert!(faults.defects.iter().all(|(id, _)| id == "right"), "{name}");
        assert_eq!(name_of(&scene, &faults), Some(name));
        assert_eq!(listed(&scene, faults.clone()), Ok(faults), "{name}");
    }
}

#[test]
fn a_name_the_scene_cannot_have_is_refused_with_those_it_can() {
    let scene = demo();
    for (name, words) in [("BG_GS_GB", "needs a gear"), ("bad", "no scenario"), ("", "no scenario")]
    {
        let told = named(&scene, name).unwrap_err().to_string();
        assert!(told.contains(words), "{told}");
        assert!(told.contains("GG_GS_GB, GG_GS_BB, GG_BS_GB, GG_BS_BB"), "{told}");
    }
    let linear = Scene::parse(builtin::text("seed-bow-2hz").unwrap(), "bow").unwrap();
    let told = named(&linear, "GG_GS_BB").unwrap_err().to_string();
    assert!(
        told.contains("needs a ball bearing") && told.ends_with("GG_GS_GB, GG_BS_GB"),
        "{told}"
    );
}

#[test]
fn numbers_out_of_range_are_refused_at_their_place() {
    let scene = demo();
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
        let bow = Bow { angle_rad: 0.0, shape: BowShape::HalfSine { amplitude_m } };
        let bent = Faults { defects: Vec::new(), bow: Some(bow), ..Faults::default() };
        assert!(told(bent).starts_with("bow, amplitude_um"));
    }
}

#[test]
fn damage_grows_in_proportion_and_bows_add_as_vectors() {
    let scene = demo();
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
        bow: Some(Bow { angle_rad, shape: BowShape::HalfSine { amplitude_m: 1e-4 } }),
        ..Faults::default()
    };
    let turned = between(&bent(0.0), &bent(0.5 * PI), 0.5).bow.unwrap();
    // Halfway between two at right angles: both halves, at 45°.
    assert!((amplitude_m(&turned.shape) - 1e-4 / 2.0_f64.sqrt()).abs() < 1e-16);
    assert!((turned.angle_rad - 0.25 * PI).abs() < 1e-12);
    let points = BowShape::Points(vec![(0.1, 0.0), (0.2, -1e-4), (0.3, 0.0)]);
    let other = Faults {
        defects: Vec::new(),
        bow: Some(Bow { angle_rad: 0.0, shape: points }),
        ..Faults::default()
    };
    let sizes = [0.25, 0.5, 0.75].map(|part| {
        between(&other, &bent(0.0), part).bow.map_or(0.0, |bow| amplitude_m(&bow.shape))
    });
    for (size, expected) in sizes.into_iter().zip([0.5e-4, 0.0, 0.5e-4]) {
        assert!((size - expected).abs() < 1e-16, "{sizes:?}");
    }
}

#[test]
fn a_scene_with_faults_begins_with_them() {
    let scene = demo();
    let bad = named(&scene, "GG_BS_BB").unwrap();
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
