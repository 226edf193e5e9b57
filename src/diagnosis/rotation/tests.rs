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
use crate::features::shaft::ORDERS;
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
pub(super) const HEALTHY: f64 = 2.0;

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
pub(super) const ONE_TOOTH: f64 = 8.5;

/// The average behind `tsa_local_mesh_motor`.
pub(super) fn gear_reading(persistence: f64, peak: f64) -> GearReading {
    GearReading {
        gear: GearIndex(0),
        shaft: ShaftIndex(0),
        channel: ChannelIndex(1),
        part: Part::Whole,
        revolutions: 99,
        has_angle: true,
        is_sharp: true,
        mesh: [1.0; 3],
        mesh_over_scatter: [1e3; 3],
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

/// A window of these features, its lines far over the noise.
pub(super) fn window(channels: Vec<ChannelFeatures>) -> WindowFeatures {
    WindowFeatures {
        time_s: (0.0, 10.0),
        speed: Speed::unknown(),
        load: None,
        sensors: Vec::new(),
        channels,
        shaft_lines: (0..2)
            .flat_map(|s| [(s, 0), (s, 1)])
            .flat_map(|(s, channel)| ORDERS.map(|order| (s, channel, order)))
            .map(|(shaft, channel, order)| OverFloor {
                shaft: ShaftIndex(shaft),
                order,
                channel: ChannelIndex(channel),
                power_ratio: 1000.0,
                floor_dof: 50.0,
            })
            .collect(),
        bearing_lines: Vec::new(),
        lower_lines: std::sync::Arc::default(),
        between_lines: std::sync::Arc::default(),
        elsewhere: Vec::new(),
        absolute_lines: Vec::new(),
        impulses: Vec::new(),
        combs: Vec::new(),
        gears: Vec::new(),
        pieces: Vec::new(),
        laws: Vec::new(),
    }
}

/// A speed that a tacho gives.
pub(super) fn by_tacho(first: Hz) -> Speed {
    let (first, source) = (Some(first), Some(SpeedSource::Tacho));
    Speed { first, source, confidence: 1.0, ..Speed::unknown() }
}

/// The verdict on the shaft of a machine without gear, against these features of good health at the same speed.
pub(super) fn judged_against(
    machine: &Machine,
    channels: &[ChannelInfo],
    healthy: Vec<ChannelFeatures>,
    features: &WindowFeatures,
) -> ComponentDiagnosis {
    let record = Record::of_windows("h", &[(features.speed.first, healthy)], channels);
    let baseline = Baseline { records: vec![record], provisional: false };
    let context = Context {
        machine,
        channels,
        channel_of_sensor: &[None, Some(ChannelIndex(1))],
        baseline: &baseline,
        runs: &Baseline::default(),
        offered_baselines: 1,
        void_baselines: None,
        false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
    };
    of(&judge(features, &[], &context), "main").clone()
}

fn judged(signs: Signs, with_gear: bool, with_baseline: bool) -> Vec<ComponentDiagnosis> {
    judged_with(signs, with_gear, with_baseline, vec![gear_reading(1000.0, ONE_TOOTH)])
}

pub(super) fn judged_with(
    signs: Signs,
    with_gear: bool,
    with_baseline: bool,
    gears: Vec<GearReading>,
) -> Vec<ComponentDiagnosis> {
    judged_beside(&[], signs, (with_gear, with_baseline), gears)
}

/// The same beside verdicts on bearings.
pub(super) fn judged_beside(
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
    let speed = by_tacho(Hz(10.0));
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
            void_baselines: None,
            false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
        },
    )
}

pub(super) fn of<'a>(verdicts: &'a [ComponentDiagnosis], id: &str) -> &'a ComponentDiagnosis {
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
