//! The joint table, row by row, on features of stated size.

use super::judge;
use crate::diagnosis::Context;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::WindowFeatures;
use crate::features::gear::GearFigures;
use crate::features::gear::GearReading;
use crate::features::gear::Localisation;
use crate::features::gear::Part;
use crate::features::gear::Shape;
use crate::features::shaft::OverFloor;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::machine::GearIndex;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::file;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

const RIG: &str = r#"
[machine]
id = "rig"
name = "rig"
[[shaft]]
id = "motor"
ratio_to = { shaft = "main", ratio = 1.0 }
[[shaft]]
id = "main"
speed_hz = 10.0
first_critical_hz = 117.0
[[bearing]]
id = "right"
elements = 9
element_diameter_mm = 7.94
pitch_diameter_mm = 39.04
shaft = "main"
[[gear]]
id = "mesh"
driving = { shaft = "motor", teeth = 28 }
driven = { shaft = "main", teeth = 28 }
[[sensor]]
channel = "probe"
kind = "proximitor"
unit = "um"
at = { shaft = "main" }
[[sensor]]
channel = "acc"
kind = "accelerometer"
unit = "m/s^2"
at = { gear = "mesh" }
"#;

pub(super) fn machine(with_gear: bool) -> Machine {
    let text = if with_gear {
        RIG.to_owned()
    } else {
        let gear = RIG.find("[[gear]]").unwrap();
        let sensor = RIG.find("[[sensor]]").unwrap();
        format!("{}{}", &RIG[..gear], &RIG[sensor..]).replace("gear = \"mesh\"", "shaft = \"main\"")
    };
    file::parse(&text, "rig.toml").unwrap()
}

pub(super) fn channels() -> Vec<ChannelInfo> {
    [("probe", Unit::Micrometre), ("acc", Unit::MetrePerSecondSquared)]
        .into_iter()
        .map(|(name, unit)| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(10_000.0),
            unit,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        })
        .collect()
}

/// Ratios to the baseline; `None` = not measured.
#[derive(Clone, Copy)]
pub(super) struct Signs {
    pub(super) displacement: Option<f64>,
    pub(super) once: f64,
    pub(super) local: Option<f64>,
    /// 2× and 3× of the probe and of the housing, beside a 1× line of the housing.
    pub(super) higher: Option<f64>,
    /// Mesh harmonics.
    pub(super) mesh: [f64; 3],
    /// The localised difference signal around the first of them.
    pub(super) around: Option<f64>,
}

impl Signs {
    /// As in good health.
    pub(super) const HEALTHY: Self = Self {
        displacement: Some(1.0),
        once: 1.0,
        local: Some(1.0),
        higher: Some(1.0),
        mesh: [1.0; 3],
        around: None,
    };
}

/// Size of every feature of the healthy machine; the displacement in µm.
const HEALTHY: f64 = 2.0;

pub(super) fn features(signs: Signs) -> Vec<ChannelFeatures> {
    let feature = |name: &str, ratio: f64| Feature {
        name: Arc::from(name),
        value: HEALTHY * ratio,
        unit: Unit::One,
    };
    let mut acc = vec![feature("cwt_1x_main", signs.once), feature("cwt_1x_motor", signs.once)];
    acc.extend(["tsa_residual_mesh_motor", "tsa_envelope_1_mesh_motor"].map(|n| feature(n, 1.0)));
    acc.extend(signs.local.map(|r| feature("tsa_local_mesh_motor", r)));
    acc.extend(signs.around.map(|r| feature("tsa_local_1_mesh_motor", r)));
    let harmonics = (1..).zip(signs.mesh);
    acc.extend(harmonics.map(|(h, r)| feature(&format!("tsa_mesh_{h}_mesh_motor"), r)));
    let higher = |r: f64| [feature("line_2x_main", r), feature("line_3x_main", r)];
    acc.extend(signs.higher.into_iter().flat_map(higher));
    let probe = signs.displacement.map(|r| {
        let higher = signs.higher.into_iter().flat_map(higher);
        std::iter::once(feature("line_1x_main", r)).chain(higher).collect()
    });
    [probe, Some(acc)]
        .into_iter()
        .enumerate()
        .filter_map(|(i, values)| {
            Some(ChannelFeatures {
                channel: ChannelIndex(i),
                sample_range: (0, 1),
                values: values?,
            })
        })
        .collect()
}

/// Peak over mean of one tooth of 28 that stands out: 7.9 by chance once in 100 (C21).
const ONE_TOOTH: f64 = 8.5;

/// The average behind `tsa_local_mesh_motor`.
fn gear_reading(persistence: f64, peak: f64) -> GearReading {
    GearReading {
        gear: GearIndex(0),
        shaft: ShaftIndex(0),
        channel: ChannelIndex(1),
        part: Part::Whole,
        revolutions: 99,
        has_angle: true,
        is_sharp: true,
        mesh: [1.0; 3],
        mesh_over_scatter: [Some(1e3); 3],
        figures: GearFigures {
            fm0: None,
            fm4: None,
            m6a: None,
            m8a: None,
            energy_ratio: None,
            sideband_level_factor: None,
            residual_kurtosis: None,
            difference_rms: 1.0,
            mesh_amplitude: 1.0,
        },
        shape: None,
        phase_swing_rad: None,
        localisation: Localisation { peak_over_mean: [peak, 1.0, 1.0], centre_rev: 0.5 },
        local_amplitude: 1.0,
        persistence: Some(persistence),
        teeth: 28,
        zero_crossing_deg: 0.0,
        sample_range: (0, 1),
    }
}

/// A window of these features, its 1× lines far over the noise.
pub(super) fn window(channels: Vec<ChannelFeatures>) -> WindowFeatures {
    WindowFeatures {
        time_s: (0.0, 10.0),
        speed: Speed::unknown(),
        load: None,
        sensors: Vec::new(),
        channels,
        shaft_lines: (0..2)
            .flat_map(|s| [(s, 0), (s, 1)])
            .map(|(shaft, channel)| OverFloor {
                shaft: ShaftIndex(shaft),
                channel: ChannelIndex(channel),
                power_ratio: 1000.0,
                floor_dof: 50.0,
            })
            .collect(),
        bearing_lines: Vec::new(),
        elsewhere: Vec::new(),
        absolute_lines: Vec::new(),
        gears: Vec::new(),
        pieces: Vec::new(),
        laws: Vec::new(),
    }
}

fn judged(signs: Signs, with_gear: bool, with_baseline: bool) -> Vec<ComponentDiagnosis> {
    judged_with(signs, with_gear, with_baseline, vec![gear_reading(1000.0, ONE_TOOTH)])
}

fn judged_with(
    signs: Signs,
    with_gear: bool,
    with_baseline: bool,
    gears: Vec<GearReading>,
) -> Vec<ComponentDiagnosis> {
    judged_beside(&[], signs, (with_gear, with_baseline), gears)
}

/// The same beside verdicts on bearings.
fn judged_beside(
    bearings: &[ComponentDiagnosis],
    signs: Signs,
    (with_gear, with_baseline): (bool, bool),
    gears: Vec<GearReading>,
) -> Vec<ComponentDiagnosis> {
    let (machine, channels) = (machine(with_gear), channels());
    let healthy = features(Signs { around: Some(1.0), ..Signs::HEALTHY });
    let record = Record::of_windows("h", &[(Some(Hz(10.0)), healthy)], &channels);
    let records = if with_baseline { vec![record] } else { Vec::new() };
    let baseline = Baseline { records, provisional: false };
    let speed = Speed {
        first: Some(Hz(10.0)),
        source: Some(SpeedSource::Tacho),
        confidence: 1.0,
        ..Speed::unknown()
    };
    let features = WindowFeatures { speed, gears, ..window(features(signs)) };
    let with_probe = signs.displacement.is_some();
    let channel_of_sensor = [with_probe.then_some(ChannelIndex(0)), Some(ChannelIndex(1))];
    judge(
        &features,
        bearings,
        &Context {
            machine: &machine,
            channels: &channels,
            channel_of_sensor: &channel_of_sensor,
            baseline: &baseline,
            runs: &Baseline::default(),
            offered_baselines: baseline.records.len(),
            false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
        },
    )
}

fn of<'a>(verdicts: &'a [ComponentDiagnosis], id: &str) -> &'a ComponentDiagnosis {
    verdicts.iter().find(|c| c.id == id).unwrap()
}

/// States of the probed shaft and of the gear, and the gear's fault.
fn states(displacement: Option<f64>, once: f64, local: f64) -> (State, State, Option<FaultMode>) {
    let verdicts = judged(
        Signs { displacement, once, local: Some(local), higher: None, ..Signs::HEALTHY },
        true,
        true,
    );
    let gear = of(&verdicts, "mesh");
    (of(&verdicts, "main").state, gear.state, gear.fault)
}

#[test]
fn the_rows_of_the_joint_table() {
    use State::{Damaged, Healthy, Undetermined};
    let tooth = Some(FaultMode::ToothDamage);
    assert_eq!(states(Some(1.0), 1.0, 1.0), (Healthy, Healthy, None), "healthy");
    assert_eq!(states(Some(200.0), 30.0, 1.1), (Damaged, Healthy, None), "shaft");
    assert_eq!(states(Some(1.1), 30.0, 50.0), (Healthy, Damaged, tooth), "gear");
    assert_eq!(states(Some(200.0), 40.0, 50.0), (Damaged, Damaged, tooth), "shaft and gear");
    assert_eq!(states(None, 30.0, 1.0).0, Undetermined, "not separable without a probe");
}

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
fn a_bow_needs_more_eccentricity_than_any_unbalance() {
    // 400 µm at r = 10/117: e = A(1 − r²)/r² = 54 mm, e·ω = 3400 mm/s, beyond 10 × G 40.
    let bowed = judged(
        Signs {
            displacement: Some(200.0),
            once: 1.0,
            local: Some(1.0),
            higher: None,
            ..Signs::HEALTHY
        },
        true,
        true,
    );
    assert_eq!(of(&bowed, "main").fault, Some(FaultMode::Bow));
    // 20 µm: e = 2.7 mm, e·ω = 171 mm/s: an unbalance could do that.
    let either = judged(
        Signs {
            displacement: Some(10.0),
            once: 1.0,
            local: Some(1.0),
            higher: None,
            ..Signs::HEALTHY
        },
        true,
        true,
    );
    assert_eq!(of(&either, "main").state, State::Warning);
    assert_eq!(of(&either, "main").fault, None);
}

#[test]
fn without_a_gear_and_a_probe_the_shaft_is_accused_without_a_cause() {
    let verdicts = judged(
        Signs { displacement: None, once: 8.0, local: None, higher: None, ..Signs::HEALTHY },
        false,
        true,
    );
    let shaft = of(&verdicts, "main");
    assert_eq!((shaft.state, shaft.fault), (State::Warning, None));
    assert!(verdicts.iter().all(|c| c.kind == ComponentKind::Shaft));
}

#[test]
fn one_times_alone_is_unbalance_and_no_surer_than_a_bow_leaves_it() {
    let judged = |displacement: Option<f64>, higher: f64| {
        let signs =
            Signs { displacement, once: 8.0, local: None, higher: Some(higher), ..Signs::HEALTHY };
        of(&judged(signs, false, true), "main").clone()
    };
    for displacement in [None, Some(8.0)] {
        let shaft = judged(displacement, 1.2);
        assert_eq!(shaft.fault, Some(FaultMode::Unbalance), "{}", shaft.why);
        assert!(shaft.confidence.unwrap() <= 0.8 && shaft.why.ends_with("a bow is not excluded"));
        // 3.5 is up; 2.5 is not, at a 1× of 8 it has not risen by half as much; a bow of 200 is a bow.
        assert_eq!(judged(displacement, 3.5).fault, None);
        assert_eq!(judged(displacement, 2.5).fault, Some(FaultMode::Unbalance));
    }
    assert_eq!(judged(Some(200.0), 1.2).fault, Some(FaultMode::Bow));
}

#[test]
fn a_rise_within_the_scatter_accuses_nobody() {
    // 2.9 < 3 and ln 2.9 is 3.8 of the assumed 0.28: significant, but too small an effect.
    let verdicts = judged(
        Signs {
            displacement: Some(2.9),
            once: 2.9,
            local: Some(2.9),
            higher: None,
            ..Signs::HEALTHY
        },
        true,
        true,
    );
    assert!(verdicts.iter().all(|c| c.state == State::Healthy), "{verdicts:?}");
}

#[test]
fn without_a_baseline_nothing_is_judged_and_the_reason_is_given() {
    let verdicts = judged(
        Signs { displacement: None, once: 9.0, local: Some(9.0), higher: None, ..Signs::HEALTHY },
        true,
        false,
    );
    assert!(verdicts.iter().all(|c| c.state == State::Undetermined));
    assert_eq!(of(&verdicts, "main").why, "no proximity probe and no baseline");
    assert_eq!(of(&verdicts, "mesh").why, "no baseline");
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

#[test]
fn a_shaft_without_a_probe_does_not_mirror_one_of_equal_speed() {
    let signs = Signs {
        displacement: Some(200.0),
        once: 30.0,
        local: Some(1.0),
        higher: None,
        ..Signs::HEALTHY
    };
    let verdicts = judged(signs, true, true);
    assert_eq!(of(&verdicts, "main").state, State::Damaged);
    let motor = of(&verdicts, "motor");
    assert_eq!((motor.state, motor.fault), (State::Undetermined, None), "{motor:?}");
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
        let reading = GearReading { mesh_over_scatter: [Some(z); 3], ..gear_reading(1000.0, 2.0) };
        of(&judged_with(signs, true, true, vec![reading]), "mesh").fault
    };
    assert_eq!((of_noise(11.0), of_noise(12.0)), (None, wear));
}
