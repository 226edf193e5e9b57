//! Every outcome from diagnoses written by hand.

use super::*;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::DataQuality;
use crate::diagnosis::verdict::OperatingState;
use crate::diagnosis::verdict::OtherFault;
use crate::diagnosis::verdict::Timeline;
use ComponentKind::{Bearing, Gear, Machine, Sensor, Shaft};
use State::{Damaged, Healthy, Undetermined, Warning};

fn diagnosis(components: Vec<ComponentDiagnosis>) -> Diagnosis {
    Diagnosis {
        machine: "rig".to_owned(),
        duration_s: 10.0,
        samples_used: 1,
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: None,
        shaft_speeds: Vec::new(),
        speed_source: None,
        speed_confidence: 0.0,
        operating_state: OperatingState::Running,
        state: Healthy,
        coverage: Coverage::default(),
        data_quality: DataQuality::Ok,
        components,
        warnings: Vec::new(),
        notes: Vec::new(),
        baselines: Vec::new(),
        provisional_baseline: None,
        timeline: None,
        first_warning_s: None,
        first_damaged_s: None,
        sample_ranges: Vec::new(),
    }
}

fn part(
    id: &str,
    kind: ComponentKind,
    state: State,
    fault: Option<FaultMode>,
) -> ComponentDiagnosis {
    let confidence = (state != Undetermined).then_some(0.95);
    let why = format!("because of {id}");
    let open = ComponentDiagnosis::undetermined(id, kind, why);
    ComponentDiagnosis { state, fault, severity: confidence, confidence, ..open }
}

fn healthy(id: &str, kind: ComponentKind) -> ComponentDiagnosis {
    part(id, kind, Healthy, None)
}

fn label(fault: FaultMode, component: &str) -> Known {
    let component = Some(component.to_owned()).filter(|id| !id.is_empty());
    Known::Faults(vec![KnownFault { fault, component }])
}

fn other(fault: FaultMode) -> OtherFault {
    OtherFault {
        fault,
        state: State::Warning,
        severity: 0.3,
        confidence: 0.5,
        why: String::new(),
        evidence: Vec::new(),
    }
}

const NO_FAULT: Known = Known::Faults(Vec::new());

/// The outcome on a machine of two bearings, a shaft and the whole, some of them replaced.
fn outcome(known: &Known, said: &[ComponentDiagnosis]) -> Outcome {
    of(known, said).outcome
}

fn of(known: &Known, said: &[ComponentDiagnosis]) -> Score {
    let mut parts = vec![
        healthy("de", Bearing),
        healthy("fe", Bearing),
        healthy("main", Shaft),
        healthy("rig", Machine),
        part("ch", Sensor, Damaged, Some(FaultMode::Dead)),
    ];
    for said in said {
        match parts.iter_mut().find(|p| p.id == said.id) {
            Some(place) => *place = said.clone(),
            None => parts.push(said.clone()),
        }
    }
    score(known, &[], &diagnosis(parts)).unwrap()
}

#[test]
fn the_labelled_fault_at_its_place_alone_is_right() {
    let inner = label(FaultMode::InnerRace, "de");
    for state in [Warning, Damaged] {
        let said = part("de", Bearing, state, Some(FaultMode::InnerRace));
        assert_eq!(outcome(&inner, &[said]), Outcome::Right);
    }
    let said = part("fe", Bearing, Warning, Some(FaultMode::InnerRace));
    assert_eq!(outcome(&label(FaultMode::InnerRace, ""), &[said]), Outcome::Right, "any bearing");
    // The machine's level blames no part.
    let said = [
        part("de", Bearing, Damaged, Some(FaultMode::InnerRace)),
        part("rig", Machine, Warning, Some(FaultMode::AbnormalLevel)),
    ];
    assert_eq!(outcome(&inner, &said), Outcome::Right);
}

#[test]
fn an_accusation_without_a_cause_is_a_detection() {
    let inner = label(FaultMode::InnerRace, "de");
    assert_eq!(outcome(&inner, &[part("de", Bearing, Warning, None)]), Outcome::Detected);
    let level = part("rig", Machine, Damaged, Some(FaultMode::AbnormalLevel));
    assert_eq!(outcome(&inner, &[level]), Outcome::Detected);
}

#[test]
fn nothing_accused_is_undetermined_or_missed_by_the_labelled_component() {
    let inner = label(FaultMode::InnerRace, "de");
    let open = part("de", Bearing, Undetermined, None);
    let score = of(&inner, std::slice::from_ref(&open));
    assert_eq!(score.outcome, Outcome::Undetermined);
    let reasons: Vec<_> =
        score.open.iter().map(|o| (o.component.as_str(), o.why.as_str())).collect();
    assert_eq!(reasons, [("de", "because of de")]);
    assert_eq!(outcome(&inner, &[]), Outcome::Missed);
    assert_eq!(outcome(&inner, &[part("fe", Bearing, Undetermined, None)]), Outcome::Missed);
    assert_eq!(outcome(&label(FaultMode::Cage, ""), &[open]), Outcome::Undetermined);
    let no_gear = label(FaultMode::ToothDamage, "");
    assert_eq!(outcome(&no_gear, &[]), Outcome::Undetermined, "there is no gear");
    assert_eq!(outcome(&no_gear, &[healthy("mesh", Gear)]), Outcome::Missed);
}

#[test]
fn another_fault_or_component_is_a_wrong_cause() {
    let inner = label(FaultMode::InnerRace, "de");
    let right = part("de", Bearing, Damaged, Some(FaultMode::InnerRace));
    let mut second = part("de", Bearing, Warning, Some(FaultMode::Cage));
    second.other_faults = vec![other(FaultMode::InnerRace)];
    for said in [
        vec![part("de", Bearing, Warning, Some(FaultMode::OuterRace))],
        vec![part("fe", Bearing, Warning, Some(FaultMode::InnerRace))],
        vec![part("fe", Bearing, Warning, None)],
        vec![right.clone(), part("fe", Bearing, Warning, None)],
        vec![right, part("main", Shaft, Warning, Some(FaultMode::Bow))],
        vec![second],
    ] {
        let score = of(&inner, &said);
        assert_eq!(score.outcome, Outcome::WrongCause, "{said:?}");
        assert_eq!(score.accusations.iter().filter(|a| a.stray).count(), 1);
    }
    let score = of(&inner, &[part("fe", Bearing, Warning, None)]);
    assert!(score.accusations[0].is_surely_wrong(), "at 0.95");
}

#[test]
fn a_weaker_fault_beside_the_known_one_is_counted_apart() {
    let mut said = part("de", Bearing, Damaged, Some(FaultMode::InnerRace));
    said.other_faults = vec![other(FaultMode::Cage), other(FaultMode::OuterRace)];
    let score = of(&label(FaultMode::InnerRace, "de"), &[said.clone()]);
    assert_eq!(score.outcome, Outcome::Right);
    let flags: Vec<_> = score.accusations.iter().map(|a| (a.stray, a.beside)).collect();
    assert_eq!(flags, [(false, false), (true, true), (true, true)]);
    let right = score.judgements.iter().filter(|j| j.accused && j.right).count();
    assert_eq!(right, 1, "the confidence of the others was given for nothing");
    assert_eq!(outcome(&NO_FAULT, &[said]), Outcome::FalseAlarm);
}

#[test]
fn anything_accused_on_a_healthy_machine_is_a_false_alarm_and_sensors_do_not_count() {
    assert_eq!(outcome(&NO_FAULT, &[]), Outcome::Right);
    assert_eq!(outcome(&NO_FAULT, &[part("de", Bearing, Undetermined, None)]), Outcome::Right);
    for said in [
        part("de", Bearing, Warning, None),
        part("rig", Machine, Warning, Some(FaultMode::AbnormalLevel)),
        part("main", Shaft, Damaged, Some(FaultMode::Unbalance)),
    ] {
        assert_eq!(outcome(&NO_FAULT, &[said]), Outcome::FalseAlarm);
    }
}

#[test]
fn of_several_faults_all_must_be_named_and_the_worst_counts() {
    let fault = |fault, id: &str| KnownFault { fault, component: Some(id.to_owned()) };
    let both =
        Known::Faults(vec![fault(FaultMode::InnerRace, "de"), fault(FaultMode::Bow, "main")]);
    let bearing = part("de", Bearing, Damaged, Some(FaultMode::InnerRace));
    let bow = part("main", Shaft, Warning, Some(FaultMode::Bow));
    assert_eq!(outcome(&both, &[bearing.clone(), bow]), Outcome::Right);
    assert_eq!(outcome(&both, std::slice::from_ref(&bearing)), Outcome::Missed);
    assert_eq!(
        outcome(&both, &[bearing.clone(), part("main", Shaft, Warning, None)]),
        Outcome::Detected
    );
    assert_eq!(
        outcome(&both, &[bearing, part("main", Shaft, Undetermined, None)]),
        Outcome::Undetermined
    );
}

#[test]
fn what_the_table_accepts_counts_as_right_and_stays_named() {
    let ball = label(FaultMode::RollingElement, "de");
    let open = diagnosis(vec![part("de", Bearing, Undetermined, None)]);
    let accepted = [Acceptable::Outcome(Outcome::Undetermined)];
    let found = score(&ball, &accepted, &open).unwrap();
    assert_eq!((found.outcome, found.counted()), (Outcome::Undetermined, Outcome::Right));
    let missed = diagnosis(vec![healthy("de", Bearing)]);
    assert_eq!(score(&ball, &accepted, &missed).unwrap().counted(), Outcome::Missed);
    let outer = [Acceptable::Fault(FaultMode::OuterRace)];
    let says = |id: &str, fault| {
        let parts = vec![healthy("de", Bearing), healthy("fe", Bearing)];
        let parts = parts.into_iter().filter(|p| p.id != id);
        let said = part(id, Bearing, Warning, Some(fault));
        score(&ball, &outer, &diagnosis(parts.chain([said]).collect())).unwrap().counted()
    };
    assert_eq!(says("de", FaultMode::OuterRace), Outcome::Right);
    assert_eq!(says("de", FaultMode::InnerRace), Outcome::WrongCause);
    assert_eq!(says("fe", FaultMode::OuterRace), Outcome::WrongCause);
}

#[test]
fn a_label_for_a_part_that_is_not_there_is_an_error() {
    let known = label(FaultMode::InnerRace, "drive-end");
    let error = score(&known, &[], &diagnosis(vec![healthy("de", Bearing)])).unwrap_err();
    assert_eq!(error.to_string(), "the truth names component `drive-end`, the machine has de");
}

#[test]
fn confidence_is_judged_where_the_truth_is_known() {
    let judged = |known: &Known, said: &[ComponentDiagnosis]| {
        let score = of(known, said);
        let count = |accused, right| {
            score.judgements.iter().filter(|j| j.accused == accused && j.right == right).count()
        };
        [count(true, true), count(true, false), count(false, true), count(false, false)]
    };
    let inner = label(FaultMode::InnerRace, "de");
    let named = part("de", Bearing, Damaged, Some(FaultMode::InnerRace));
    assert_eq!(judged(&inner, &[named]), [1, 0, 3, 0]);
    assert_eq!(judged(&inner, &[]), [0, 0, 3, 1], "de is called healthy");
    let wrong = part("fe", Bearing, Damaged, Some(FaultMode::InnerRace));
    assert_eq!(judged(&inner, &[wrong]), [0, 1, 2, 1]);
    // Which bearing is bad is not known: of neither can `healthy` be judged.
    assert_eq!(judged(&label(FaultMode::InnerRace, ""), &[]), [0, 0, 2, 0]);
    assert_eq!(judged(&NO_FAULT, &[part("de", Bearing, Undetermined, None)]), [0, 0, 3, 0]);
}

/// A life of ten windows with the first alarm at a window, healthy before it.
fn life(first_alarm: Option<u32>, early: State) -> Score {
    let mut found = diagnosis(vec![part("de", Bearing, Damaged, None)]);
    let state = |i: u32| match first_alarm {
        Some(alarm) if i >= alarm => Warning,
        Some(_) | None if i < 5 => early,
        Some(_) | None => Healthy,
    };
    found.timeline = Some(Timeline {
        time_s: (0..10).map(|i| 100.0 * f64::from(i)).collect(),
        state: (0..10).map(state).collect(),
        component: vec![None; 10],
        severity: vec![None; 10],
    });
    found.first_warning_s = first_alarm.map(|i| 100.0 * f64::from(i));
    score(&Known::RunToFailure, &[], &found).unwrap()
}

#[test]
fn a_life_is_scored_by_its_first_alarm() {
    assert_eq!(life(Some(8), Healthy).outcome, Outcome::Right);
    assert!((life(Some(8), Healthy).first_alarm.unwrap() - 8.0 / 9.0).abs() < 1e-12);
    assert_eq!(life(Some(2), Healthy).outcome, Outcome::FalseAlarm);
    assert_eq!(life(Some(0), Healthy).outcome, Outcome::FalseAlarm);
    assert_eq!(life(Some(9), Healthy).outcome, Outcome::Missed, "at the end, not before it");
    assert_eq!(life(None, Healthy).outcome, Outcome::Missed);
    assert_eq!(life(Some(8), Undetermined).outcome, Outcome::Undetermined, "silence is no health");
    let error = score(&Known::RunToFailure, &[], &diagnosis(Vec::new())).unwrap_err();
    assert_eq!(error, ScoreError::NoTimeline);
}
