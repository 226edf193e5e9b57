//! The report says what the diagnosis holds, at any width.

use super::*;
use crate::cli::terminal::columns;
use crate::diagnosis::verdict::BaselineUse;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::Evidence;
use crate::diagnosis::verdict::OtherFault;
use crate::units::Hz;
use crate::units::Unit;

fn component(id: &str, kind: ComponentKind, state: State) -> ComponentDiagnosis {
    ComponentDiagnosis {
        id: id.into(),
        kind,
        state,
        fault: None,
        severity: (state != State::Undetermined).then_some(0.1),
        confidence: (state != State::Undetermined).then_some(0.9),
        why: format!("the reason of {id}"),
        evidence: vec![],
        other_faults: vec![],
        gear: None,
    }
}

fn line() -> Evidence {
    Evidence {
        indicator: "envelope_line_bpfi".into(),
        channel: "right_x".into(),
        detector: None,
        frequency: Some(Hz(67.9)),
        expected: Some(Hz(68.03)),
        order: Some(6.79),
        value: 0.61,
        unit: Unit::One,
        threshold: Some(0.5),
        false_alarm_probability: Some(1e-20),
        sample_range: Some((0, 400_000)),
    }
}

/// A damaged and a healthy bearing, a shaft that could not be judged, a clipped sensor.
pub(super) fn diagnosis() -> Diagnosis {
    let mut right = component("right", ComponentKind::Bearing, State::Damaged);
    right.fault = Some(FaultMode::InnerRace);
    (right.severity, right.confidence) = (Some(0.62), Some(0.97));
    right.evidence = vec![line()];
    right.other_faults = vec![OtherFault {
        fault: FaultMode::RollingElement,
        state: State::Warning,
        severity: 0.3,
        confidence: 0.8,
        why: "2·BSF too".into(),
        evidence: vec![],
    }];
    let mut left = component("left", ComponentKind::Bearing, State::Healthy);
    left.evidence = vec![Evidence { channel: "left_x".into(), ..line() }];
    let mut sensor = component("right_y", ComponentKind::Sensor, State::Warning);
    sensor.fault = Some(FaultMode::Clipped);
    Diagnosis {
        machine: "rig-1".into(),
        duration_s: 10.0,
        samples_used: 400_000,
        samples_rejected: 3,
        rejected_because: vec!["3 samples: not finite".into()],
        shaft_speed: Some(Hz(10.0)),
        shaft_speeds: vec![("main".into(), Hz(10.0)), ("motor".into(), Hz(25.0))],
        speed_source: Some(SpeedSource::Estimated),
        speed_confidence: 0.9,
        operating_state: OperatingState::Running,
        state: State::Damaged,
        coverage: Coverage { judged: 2, undetermined: vec!["main".into()] },
        data_quality: DataQuality::Degraded,
        components: vec![
            component("main", ComponentKind::Shaft, State::Undetermined),
            left,
            right,
            sensor,
        ],
        warnings: vec!["channel `left_x`: the data say g".into()],
        notes: vec!["guessed: separator ';', decimal comma".into()],
        baselines: vec![
            BaselineUse {
                name: "a.h5".into(),
                used: true,
                reason: "speed fits".into(),
                id: None,
                n_windows: 1,
            },
            BaselineUse {
                name: "b.h5".into(),
                used: false,
                reason: "its speed differs".into(),
                id: None,
                n_windows: 1,
            },
        ],
        provisional_baseline: Some("the first 5 windows of this record".into()),
        timeline: None,
        first_warning_s: None,
        first_damaged_s: None,
        sample_ranges: vec![],
    }
}

fn rendered(width: usize, all_evidence: bool) -> String {
    let layout = Layout { page: Page { width, colour: false }, all_evidence };
    text(&diagnosis(), "x.h5", &layout)
}

#[test]
fn every_fact_of_the_diagnosis_is_told() {
    let text = rendered(120, false);
    for fact in [
        "x.h5: DAMAGED\n",
        "machine: rig-1, 10 s, 400,000 samples; 3 samples rejected (3 samples: not finite)",
        "speed: 10.000 Hz (600 r/min), estimated from shaft harmonics, confidence 0.90; motor 25.000 Hz",
        "judged: 2 of 3 parts; not judged: main",
        "sensors: 1 with flaws, see below",
        "bearing right: DAMAGED, inner race\n  severity 0.62, confidence 0.97\n  the reason of right\n",
        "  also rolling element, severity 0.30, confidence 0.80: 2·BSF too",
        "envelope_line_bpfi  right_x  67.90        68.03  6.790  0.610      0.500       <1e-12",
        "bearing left: healthy\n",
        "shaft main: undetermined\n  the reason of main\n",
        "sensor right_y: WARNING, clipped\n",
        "note: guessed: separator ';', decimal comma\nwarning: channel `left_x`: the data say g",
        "  a.h5: used, speed fits",
        "  b.h5: not used, its speed differs",
        "it can prove change, not health",
    ] {
        assert!(text.contains(fact), "{fact}\nnot in\n{text}");
    }
    assert!(!text.contains('\u{1b}'), "no colour was asked for");
}

#[test]
fn the_accused_come_first_and_sensors_last() {
    let text = rendered(120, false);
    let at = |words: &str| text.find(words).unwrap();
    assert!(at("bearing right") < at("bearing left"));
    assert!(at("bearing left") < at("shaft main"));
    assert!(at("shaft main") < at("sensor right_y"));
}

#[test]
fn evidence_of_the_healthy_is_shown_on_request() {
    assert!(!rendered(120, false).contains("left_x  "));
    assert!(rendered(120, true).contains("left_x  "));
}

#[test]
fn lines_fit_the_page() {
    for width in [40, 60, 80, 120] {
        let text = rendered(width, true);
        for line in text.lines() {
            assert!(columns(line) <= width, "{width}: {line}");
        }
    }
}

#[test]
fn one_line_names_the_worst() {
    assert_eq!(
        accusation(&diagnosis()).unwrap(),
        "bearing right, inner race, severity 0.62, confidence 0.97"
    );
    let mut calm = diagnosis();
    calm.components.retain(|c| !c.state.is_accusation() || c.kind == ComponentKind::Sensor);
    assert_eq!(accusation(&calm), None, "a sensor is no part of the machine");
}

#[test]
fn a_cause_that_is_not_proven_is_said_so() {
    let told = |fault: Option<FaultMode>| {
        let mut unclear = diagnosis();
        unclear.components[2].fault = fault;
        let layout = Layout { page: Page::PLAIN, all_evidence: false };
        text(&unclear, "x.h5", &layout)
    };
    let text = told(None);
    assert!(text.contains("bearing right: DAMAGED, cause not proven"), "{text}");
    let text = told(Some(FaultMode::AbnormalLevel));
    assert!(text.contains("bearing right: DAMAGED, abnormal, cause not proven"), "{text}");
}

#[test]
fn names_from_files_cannot_steer_the_terminal() {
    let mut hostile = diagnosis();
    hostile.components[2].id = "a\u{1b}[2Jb".into();
    hostile.components[2].evidence[0].channel = "c\u{1b}[2Jd".into();
    hostile.machine = "m\u{1b}[2J".into();
    let layout = Layout { page: Page::PLAIN, all_evidence: true };
    assert!(!text(&hostile, "f\u{1b}[2J.h5", &layout).contains('\u{1b}'));
}
