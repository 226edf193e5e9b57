//! One rate, several bearings with a sensor each: by how much louder one hears it.

use super::super::doubt::tests::changed;
use super::super::doubt::tests::search;
use super::super::doubt::tests::told_at;
use super::*;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::Elsewhere;
use crate::features::speed::Speed;

fn told(lines: Vec<LineSearch>) -> (Vec<ComponentDiagnosis>, Option<Unplaced>) {
    told_too(lines, Vec::new())
}

/// The same, with these at 31 Hz, a speed the shaft may have as well.
fn told_too(
    lines: Vec<LineSearch>,
    at_31_hz: Vec<LineSearch>,
) -> (Vec<ComponentDiagnosis>, Option<Unplaced>) {
    let is_tried = !at_31_hz.is_empty();
    let elsewhere =
        is_tried.then_some(Elsewhere { first: Hz(31.0), lines: at_31_hz }).into_iter().collect();
    told_at(Speed::unknown(), 1.0, (lines, elsewhere), (Vec::new(), Vec::new(), Vec::new()))
}

/// BPFI of a, two harmonics 0.6 deep in four bands of power 1.
fn own() -> LineSearch {
    search(0, DefectLine::Bpfi, 0.6)
}

/// The same line at the other bearing's sensor, of this power.
fn other(power: f64) -> LineSearch {
    changed(search(1, DefectLine::Bpfi, 0.6), |reading| reading.mean_square = power)
}

/// What noise leaves at the other bearing's sensor: so deep, in bands of this power above the lowest.
fn noise(depth: f64, power: f64) -> LineSearch {
    changed(search(1, DefectLine::Bpfi, depth), |reading| {
        reading.mean_square = if reading.band.low.0 > 0.0 { power } else { 1.0 };
        reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 3.0);
    })
}

fn confidence(verdict: &ComponentDiagnosis) -> f64 {
    verdict.confidence.unwrap_or_default()
}

#[test]
fn a_line_twice_as_loud_at_one_bearing_is_that_ones_and_known_the_better_the_louder() {
    let (alone, none) = told(vec![own()]);
    assert_eq!((alone[0].fault, none), (Some(FaultMode::InnerRace), None));
    let beside = |power: f64| {
        let (verdicts, unplaced) = told(vec![own(), other(power)]);
        assert_eq!(unplaced, None);
        assert_eq!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
        assert_eq!(verdicts[1].state, State::Healthy, "{}", verdicts[1].why);
        confidence(&verdicts[0]) / confidence(&alone[0])
    };
    // Its part of the power of both.
    for power in [0.4, 0.1, 0.01] {
        assert!((beside(power) - 1.0 / (1.0 + power)).abs() < 1e-6, "{power}: {}", beside(power));
    }
}

#[test]
fn a_line_as_loud_at_two_bearings_accuses_neither_and_is_told_of_the_machine() {
    for power in [0.6, 1.0, 1.6] {
        let (verdicts, unplaced) = told(vec![own(), other(power)]);
        for verdict in &verdicts {
            assert_eq!(verdict.state, State::Undetermined, "{power}: {}", verdict.why);
        }
        let unplaced = unplaced.unwrap();
        assert!((severity_floor()..0.5).contains(&unplaced.severity), "{}", unplaced.severity);
        let names =
            unplaced.why.contains("bearings a and b") || unplaced.why.contains("bearings b and a");
        assert!(names && unplaced.why.contains("BPFI 150.0 Hz"), "{}", unplaced.why);
    }
}

fn severity_floor() -> f64 {
    crate::diagnosis::severity::WARNING
}

#[test]
fn a_line_that_an_accused_bearing_may_make_is_not_the_machines() {
    // b is accused of its outer race as well.
    let race = changed(search(1, DefectLine::Bpfo, 0.9), |reading| reading.frequency = Hz(90.0));
    let race = LineSearch { expected: Hz(90.0), ..race };
    let (verdicts, unplaced) = told(vec![own(), other(1.0), race]);
    assert_eq!(verdicts[1].fault, Some(FaultMode::OuterRace), "{}", verdicts[1].why);
    assert_eq!(unplaced, None, "{}", verdicts[0].why);
}

#[test]
fn what_noise_hides_at_the_other_bearing_counts_from_twice_the_line_on() {
    let is_open = |depth: f64, power: f64| {
        let (verdicts, unplaced) = told(vec![own(), noise(depth, power)]);
        let is_open = verdicts[0].state == State::Undetermined;
        assert_eq!(unplaced.is_some(), is_open, "{depth} {power}: {}", verdicts[0].why);
        is_open
    };
    assert!(!is_open(0.6, 1.0) && !is_open(1.15, 1.0) && is_open(1.25, 1.0));
    // Louder there, so quieter here by as much: as deep as here it is not.
    assert!(!is_open(0.6, 40.0) && !is_open(1.15, 40.0) && is_open(1.25, 40.0));
}

#[test]
fn a_shallow_line_of_what_is_louder_there_is_not_the_deep_one_here() {
    let shallow = changed(search(1, DefectLine::Bpfi, 0.05), |reading| reading.mean_square = 40.0);
    let (verdicts, unplaced) = told(vec![own(), shallow]);
    assert_eq!((verdicts[0].fault, unplaced), (Some(FaultMode::InnerRace), None));
}

#[test]
fn a_line_louder_elsewhere_in_the_lowest_band_is_not_placed() {
    let is_open = |low: f64| {
        // At the other sensor next to nothing above the lowest band, and there this power.
        let there = changed(other(0.0), |reading| {
            reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { low };
        });
        told(vec![own(), there]).1.is_some()
    };
    // Four bands of power 1 here: half of that is 2.
    assert!(!is_open(1.9) && is_open(2.1));
}

#[test]
fn a_rate_that_a_bearing_without_a_sensor_has_is_not_placed() {
    // Nine elements of 7.94 mm on 39.04 mm: BPFI is 5.415 times the 30 Hz of the shaft.
    let at = |frequency: f64| {
        let mut line = changed(own(), |reading| reading.frequency = Hz(frequency));
        line.expected = Hz(frequency);
        let deaf = LineSearch {
            outcome: Err(crate::features::bearing::Unreadable::TooShort { needed_s: 1.0 }),
            ..search(1, DefectLine::Bpfi, 0.0)
        };
        let deaf_too = LineSearch { line: DefectLine::Bpfo, ..deaf.clone() };
        told(vec![line, deaf, deaf_too])
    };
    let (verdicts, unplaced) = at(162.0);
    assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
    assert!(unplaced.is_some_and(|u| u.why.contains("bearings a and b")));
    let (verdicts, unplaced) = at(150.0);
    assert_eq!((verdicts[0].fault, unplaced), (Some(FaultMode::InnerRace), None));
}

#[test]
fn a_line_of_another_speed_leaves_every_bearing_open_that_may_have_it() {
    let states = |at_31_hz: Vec<LineSearch>| {
        let (verdicts, unplaced) = told_too(Vec::new(), at_31_hz);
        assert_eq!(unplaced, None, "at a speed that is not the one stated");
        verdicts.iter().for_each(|v| {
            let is_open = v.state == State::Undetermined;
            assert_eq!(is_open, v.why.contains("measure the speed"), "{}", v.why);
        });
        [verdicts[0].state, verdicts[1].state]
    };
    assert_eq!(states(Vec::new()), [State::Healthy; 2]);
    assert_eq!(states(vec![own()]), [State::Undetermined, State::Healthy]);
    assert_eq!(states(vec![own(), other(1.0)]), [State::Undetermined; 2]);
}

#[test]
fn a_cages_rate_is_another_bearings_by_its_cage_alone() {
    // Of the bearing without a sensor FTF is 0.398 times, BPFI 5.415 times the 30 Hz of the shaft.
    let at = |frequency: f64| {
        let mut cage = changed(search(0, DefectLine::Ftf, 0.8), |r| r.frequency = Hz(frequency));
        cage.expected = Hz(frequency);
        let race = changed(search(0, DefectLine::Bpfo, 0.12), |r| r.cage_band = r.harmonics[0]);
        let deaf = |line: DefectLine| LineSearch {
            outcome: Err(crate::features::bearing::Unreadable::TooShort { needed_s: 1.0 }),
            ..search(1, line, 0.0)
        };
        told(vec![cage, race, deaf(DefectLine::Bpfi), deaf(DefectLine::Bpfo)])
    };
    let (verdicts, unplaced) = at(11.9);
    assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
    assert!(unplaced.is_some_and(|u| u.why.contains("bearings a and b")));
    let (verdicts, unplaced) = at(162.0);
    let why = &verdicts[0].why;
    assert_eq!((verdicts[0].fault, unplaced), (Some(FaultMode::Cage), None), "{why}");
}
