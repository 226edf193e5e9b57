//! A 1× that points elsewhere than in good health.

use super::tests::by_tacho;
use super::tests::channels;
use super::tests::judged_against;
use super::tests::machine;
use super::tests::window;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::WindowFeatures;
use crate::features::vector;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// A probe that sees a vector: its size in µm and its lag; 2× beside it, and 3×, in µm.
fn probe((size_um, lag_deg): (f64, f64), second_um: f64) -> Vec<ChannelFeatures> {
    let (sin, cos) = lag_deg.to_radians().sin_cos();
    let [of_cos, of_sin] = vector::DIRECTION;
    let named = [
        ("line_1x_main", size_um),
        ("line_2x_main", second_um),
        ("line_3x_main", 0.1),
        (of_cos, cos),
        (of_sin, sin),
        ("rms_beside_shafts", 1.0),
    ];
    let feature = |(name, value)| Feature { name: Arc::from(name), value, unit: Unit::Micrometre };
    let values = named.map(feature).to_vec();
    vec![ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values }]
}

/// A window at a speed: what `probe` sees.
fn at(speed_hz: f64, vector: (f64, f64), second_um: f64) -> WindowFeatures {
    WindowFeatures { speed: by_tacho(Hz(speed_hz)), ..window(probe(vector, second_um)) }
}

/// The verdict on a shaft with a critical speed of 117 Hz, whose probe sees a vector in good health and a window now.
fn judged_by(healthy: (f64, f64), now: &WindowFeatures) -> ComponentDiagnosis {
    judged_against(&machine(false), &channels(), probe(healthy, 0.1), now)
}

fn judged(healthy: (f64, f64), now: (f64, f64)) -> ComponentDiagnosis {
    judged_by(healthy, &at(20.0, now, 0.1))
}

/// Of the evidence on where 1× points: the change, and what it is held to.
fn change(verdict: &ComponentDiagnosis) -> Option<(f64, Option<f64>)> {
    let found = verdict.evidence.iter().find(|e| e.indicator == "vector_1x_change");
    found.map(|e| (e.value, e.threshold))
}

#[test]
fn what_points_elsewhere_warns_though_it_is_no_larger() {
    let quarter = judged((40.0, 30.0), (44.0, 125.0));
    assert_eq!((quarter.state, quarter.fault), (State::Warning, None), "{}", quarter.why);
    let turned = judged((40.0, 30.0), (44.0, 200.0));
    assert_eq!((turned.state, turned.fault), (State::Warning, None), "{}", turned.why);
    assert!(turned.why.contains("1.10 times its baseline in probe"), "{}", turned.why);
    assert!(turned.why.contains("200° behind the mark, 30° in the baseline"), "{}", turned.why);
    assert!(turned.confidence.unwrap() <= 0.6, "a mark may have been moved");
    let expected = (1.0_f64 + 1.21 - 2.2 * 170.0_f64.to_radians().cos()).sqrt();
    let (value, threshold) = change(&turned).unwrap();
    assert!((value - expected).abs() < 1e-9 && threshold.is_some(), "{value}");
}

#[test]
fn what_points_less_than_a_quarter_elsewhere_or_has_shrunk_is_healthy() {
    for now in [(40.0, 30.0), (48.0, 110.0), (110.0, 60.0), (12.0, 210.0)] {
        let verdict = judged((40.0, 30.0), now);
        assert_eq!(verdict.state, State::Healthy, "{now:?}: {}", verdict.why);
        assert!(change(&verdict).is_some());
    }
}

/// A quarter of the boundary B/C is 65 µm peak to peak at 1200 r/min; the standard has none at 600.
#[test]
fn small_vectors_may_point_anywhere() {
    let small = judged((10.0, 30.0), (11.0, 200.0));
    assert_eq!(small.state, State::Healthy, "{}", small.why);
    assert_eq!(change(&small).unwrap().1, None);
    let slow = judged_by((40.0, 30.0), &at(10.0, (44.0, 200.0), 0.1));
    assert_eq!(slow.state, State::Healthy, "{}", slow.why);
}

/// A small change of stiffness turns the vector there.
#[test]
fn near_a_critical_speed_directions_say_nothing() {
    let verdict = judged_by((40.0, 30.0), &at(40.0, (40.0, 210.0), 0.1));
    assert_eq!(verdict.state, State::Healthy, "{}", verdict.why);
    assert_eq!(change(&verdict), None);
}

#[test]
fn a_vector_lost_in_noise_points_nowhere() {
    let mut features = at(20.0, (40.0, 210.0), 0.1);
    features.shaft_lines.iter_mut().for_each(|line| line.power_ratio = 2.0);
    let verdict = judged_by((40.0, 30.0), &features);
    assert_eq!(verdict.state, State::Healthy, "{}", verdict.why);
}

#[test]
fn what_rises_beside_it_is_told_as_well() {
    let verdict = judged_by((40.0, 30.0), &at(20.0, (40.0, 210.0), 30.0));
    assert_eq!((verdict.state, verdict.fault), (State::Damaged, None), "{}", verdict.why);
    for said in ["2× displacement is 300.0 times its baseline", "points 210° behind the mark"] {
        assert!(verdict.why.contains(said), "{}", verdict.why);
    }
}

/// 47 µm where a run-out of 15 µm was: 32 µm more if they point alike, which an unbalance of less than ten times G 40 may make at 10 Hz
/// (47 µm), but 62 µm if they point against each other, unless the mark was moved.
#[test]
fn a_run_out_is_subtracted_as_the_vector_it_is() {
    let judged = |healthy| judged_by(healthy, &at(10.0, (47.0, 30.0), 0.1));
    let alike = judged((15.0, 30.0));
    assert_eq!(alike.fault, Some(FaultMode::Unbalance), "{}", alike.why);
    let against = judged((15.0, 210.0));
    assert_eq!(against.fault, Some(FaultMode::Bow), "{}", against.why);
    assert!(against.confidence.unwrap() <= 0.6, "{}", against.why);
}
