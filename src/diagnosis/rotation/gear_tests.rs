//! Verdicts on a gear: one tooth, all teeth or neither; beside bearings and shafts that strike once a turn.

use super::tests::HEALTHY;
use super::tests::ONE_TOOTH;
use super::tests::Signs;
use super::tests::gear_reading;
use super::tests::judged_beside;
use super::tests::judged_with;
use super::tests::of;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::gear::GearReading;
use crate::features::gear::Part;
use crate::features::gear::Shape;

#[test]
fn a_defect_that_comes_into_the_load_once_a_turn_is_no_tooth_unless_all_orders_grow() {
    let state = |fault: Option<FaultMode>, around: f64| {
        let mut bearing =
            ComponentDiagnosis::undetermined("right", ComponentKind::Bearing, String::new());
        (bearing.state, bearing.fault) = (State::Warning, fault);
        // The baseline of every feature is that of ratio 1.
        let signs =
            Signs { once: 30.0, local: Some(around.max(1.0)), around: Some(6.0), ..Signs::HEALTHY };
        let gears = vec![
            gear_reading(1000.0, 20.0),
            GearReading { part: Part::Around(1), ..gear_reading(1000.0, 20.0) },
        ];
        let verdicts = judged_beside(&[bearing], signs, (true, true), gears);
        let gear = of(&verdicts, "mesh");
        (gear.state, gear.fault)
    };
    let tooth = (State::Warning, Some(FaultMode::ToothDamage));
    let open = (State::Undetermined, None);
    assert_eq!(state(Some(FaultMode::InnerRace), 1.0), open, "some orders have grown");
    assert_eq!(state(None, 1.0), open, "lines of several elements");
    assert_eq!(state(Some(FaultMode::InnerRace), 5.0), tooth, "all have");
    assert_eq!(state(Some(FaultMode::OuterRace), 1.0), tooth, "a defect at rest meets one load");
}

#[test]
fn energy_that_wanders_from_turn_to_turn_is_no_tooth() {
    let signs = Signs {
        displacement: Some(1.0),
        once: 30.0,
        local: Some(20.0),
        higher: None,
        ..Signs::HEALTHY
    };
    let gear = |persistence: f64| {
        let verdicts = judged_with(signs, true, true, vec![gear_reading(persistence, ONE_TOOTH)]);
        let gear = of(&verdicts, "mesh");
        (gear.state, gear.fault)
    };
    // (1 + z/7)^−7·28·4 ≤ 10⁻³ from z = 29.8 on.
    assert_eq!(gear(29.0), (State::Healthy, None));
    assert_eq!(gear(31.0), (State::Warning, Some(FaultMode::ToothDamage)));
}

#[test]
fn why_a_damage_has_no_tooth_is_told() {
    let signs = Signs { once: 30.0, local: Some(20.0), ..Signs::HEALTHY };
    let why = |has_angle: bool| {
        let reading = GearReading { has_angle, ..gear_reading(1000.0, ONE_TOOTH) };
        of(&judged_with(signs, true, true, vec![reading]), "mesh").why.clone()
    };
    assert!(why(false).contains("no tooth is told: no tacho marks"), "{}", why(false));
    assert!(!why(true).contains("no tacho"), "{}", why(true));
}

#[test]
fn figures_of_merit_are_shown_against_the_baseline() {
    let shape = |deviation: f64, kurtosis: f64| Some(Shape { deviation, kurtosis });
    let whole = GearReading { shape: shape(2.0 * HEALTHY, 3.0), ..gear_reading(1000.0, 2.0) };
    let mut mesh = GearReading { shape: shape(3.0 * HEALTHY, 2.0), ..gear_reading(1000.0, 2.0) };
    (mesh.part, mesh.phase_swing_rad) = (Part::Around(1), Some(0.7));
    let verdicts = judged_with(Signs::HEALTHY, true, true, vec![whole, mesh]);
    let value = |name: &str| {
        let evidence = &of(&verdicts, "mesh").evidence;
        evidence.iter().find(|e| e.indicator == name).map(|e| e.value)
    };
    // Kurtosis times the fourth power of the ratio of deviations.
    assert!((value("na4_star_mesh_motor").unwrap() - 3.0 * 16.0).abs() < 1e-9);
    assert!((value("nb4_star_mesh_motor").unwrap() - 2.0 * 81.0).abs() < 1e-9);
    assert_eq!(value("mesh_phase_swing_rad_mesh_motor"), Some(0.7));
    assert_eq!(value("fm4_mesh_motor"), None, "the average has none");
}

/// State and fault of the gear, 1× not up.
fn gear_alone(local: f64, q: f64, mesh: [f64; 3]) -> (State, Option<FaultMode>) {
    gear_beside(1.0, local, q, mesh)
}

/// The same where 1× on the housing has grown so much.
fn gear_beside(once: f64, local: f64, q: f64, mesh: [f64; 3]) -> (State, Option<FaultMode>) {
    let signs = Signs {
        displacement: Some(1.0),
        once,
        local: Some(local),
        higher: None,
        mesh,
        around: None,
    };
    let verdicts = judged_with(signs, true, true, vec![gear_reading(1000.0, q)]);
    assert_eq!(of(&verdicts, "main").state, State::Healthy);
    let gear = of(&verdicts, "mesh");
    (gear.state, gear.fault)
}

#[test]
fn energy_of_one_tooth_is_named_without_1x_and_that_of_all_is_nobodys() {
    let even = [1.0; 3];
    let tooth = Some(FaultMode::ToothDamage);
    assert_eq!(gear_alone(20.0, ONE_TOOTH, even), (State::Warning, tooth));
    assert_eq!(gear_alone(20.0, 6.0, even), (State::Undetermined, None), "ghost orders");
    assert_eq!(gear_beside(30.0, 20.0, ONE_TOOTH, even), (State::Warning, tooth));
    assert_eq!(gear_beside(30.0, 20.0, 6.0, even), (State::Undetermined, None), "and 1× up");
    assert_eq!(gear_alone(2.9, 20.0, even), (State::Healthy, None), "too small an effect");
}

#[test]
fn wear_is_what_all_higher_mesh_harmonics_and_no_tooth_show() {
    let wear = Some(FaultMode::DistributedWear);
    assert_eq!(gear_alone(2.0, 2.0, [1.2, 6.0, 5.0]), (State::Warning, wear));
    assert_eq!(gear_alone(6.0, 2.0, [1.2, 6.0, 5.0]), (State::Warning, wear), "all teeth strike");
    // One tooth that stands out raises all orders: wear of all is not proven.
    assert_eq!(gear_alone(6.0, 20.0, [1.2, 6.0, 5.0]), (State::Warning, None));
    // One that met a resonance; a load or a gain that is three times as high.
    assert_eq!(gear_alone(2.0, 2.0, [1.0, 6.0, 1.0]), (State::Healthy, None));
    assert_eq!(gear_alone(2.0, 2.0, [3.5, 3.5, 3.5]), (State::Healthy, None));
    let tooth = Some(FaultMode::ToothDamage);
    assert_eq!(gear_alone(20.0, 20.0, [1.2, 6.0, 5.0]), (State::Warning, tooth), "and a tooth");
    // (1 + z/7)^−7 ≤ 10⁻³ from z = 11.8 on: what noise leaves at a mesh harmonic has no ratio.
    let of_noise = |z: f64| {
        let signs = Signs { local: Some(2.0), mesh: [1.2, 6.0, 5.0], ..Signs::HEALTHY };
        let reading = GearReading { mesh_over_scatter: [z; 3], ..gear_reading(1000.0, 2.0) };
        of(&judged_with(signs, true, true, vec![reading]), "mesh").fault
    };
    assert_eq!((of_noise(11.0), of_noise(12.0)), (None, wear));
}
