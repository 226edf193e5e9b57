//! Lines of the absolute vibration that have grown over the baseline (docs/theory.md, C4).

use super::tests::absolute_line;
use super::tests::changed;
use super::tests::judged;
use super::tests::judged_on;
use super::tests::search;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::units::Hz;

/// A line of the absolute vibration of BPFI at this frequency, so many times as high as when healthy.
fn bpfi_at(bearing: usize, at_hz: f64, ratio: f64) -> AbsoluteLine {
    let mut line = absolute_line(bearing, DefectLine::Bpfi, ratio);
    line.reading.frequency = Hz(at_hz);
    line
}

#[test]
fn a_line_that_grew_accuses_unless_a_stronger_one_grew_as_well() {
    let weak = || absolute_line(0, DefectLine::Bpfi, 6.0);
    let alone = judged(Vec::new(), vec![weak()]);
    assert_eq!(alone[0].fault, Some(FaultMode::InnerRace), "{}", alone[0].why);
    let both = judged(Vec::new(), vec![weak(), absolute_line(1, DefectLine::Bpfo, 9.0)]);
    assert_eq!(both[0].state, State::Undetermined, "{}", both[0].why);
    assert!(both[0].why.contains("BPFO at b has grown too"), "{}", both[0].why);
    assert_eq!(both[1].fault, Some(FaultMode::OuterRace), "{}", both[1].why);
    // A stronger line that was there before explains nothing.
    let old = AbsoluteLine { amplitude: 4.0, ..absolute_line(1, DefectLine::Bpfo, 9.0) };
    let beside_old = judged(Vec::new(), vec![absolute_line(0, DefectLine::Bpfi, 6.0), old]);
    assert_eq!(beside_old[0].fault, Some(FaultMode::InnerRace), "{}", beside_old[0].why);
}

#[test]
fn a_line_that_grew_under_a_moving_shaft_accuses_nobody() {
    let grown = |line: DefectLine, moved: f64| {
        judged_on(moved, Vec::new(), vec![absolute_line(0, line, 6.0)]).remove(0)
    };
    let races =
        [(DefectLine::Bpfi, FaultMode::InnerRace), (DefectLine::Bpfo, FaultMode::OuterRace)];
    for (line, fault) in races {
        let steady = grown(line, 2.0);
        assert_eq!(steady.fault, Some(fault), "{}", steady.why);
        let moving = grown(line, 20.0);
        assert_eq!(moving.state, State::Undetermined, "{}", moving.why);
        assert!(moving.why.contains("loads the elements more"), "{}", moving.why);
    }
}

#[test]
fn growth_accuses_where_an_envelopes_line_wants_of_effect_or_place() {
    let of_tone = || {
        changed(search(0, DefectLine::Bpfo, 0.6), |reading| {
            if reading.band.low.0 > 2.5e3 {
                (reading.carrier, reading.mean_square) = (Some(Hz(3360.0)), 11.0);
            }
        })
    };
    let grown = |line: DefectLine| AbsoluteLine { line, ..bpfi_at(0, 150.0, 6.0) };
    let open = judged(vec![of_tone()], Vec::new()).remove(0);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    let told = judged(vec![of_tone()], vec![grown(DefectLine::Bpfo)]).remove(0);
    assert_eq!(told.fault, Some(FaultMode::OuterRace), "{}", told.why);
    // Whose rate it is growth does not tell: elements without side bands of the cage.
    let bare = search(0, DefectLine::TwoBsf, 0.6);
    let elements = judged(vec![bare], vec![grown(DefectLine::TwoBsf)]).remove(0);
    assert_eq!(elements.state, State::Undetermined, "{}", elements.why);
    // Nor is a line this bearing's that another's explains.
    let at_b = judged(vec![search(1, DefectLine::Bpfi, 0.6)], vec![bpfi_at(0, 150.0, 6.0)]);
    assert!(!at_b[0].state.is_accusation(), "{}", at_b[0].why);
}

#[test]
fn growth_accuses_where_the_shafts_events_explain_the_line_elsewhere_only() {
    // At b the envelope carries five times the power, between harmonics of the shaft that are as deep.
    let lines = || {
        let louder = changed(search(1, DefectLine::Bpfi, 0.6), |reading: &mut BandReading| {
            (reading.mean_square, reading.shaft_depth) = (5.0, 1.5);
        });
        vec![search(0, DefectLine::Bpfi, 0.6), louder]
    };
    let at_b = |ratio: f64| {
        judged(lines(), vec![bpfi_at(0, 150.0, 9.0), bpfi_at(1, 150.0, ratio)]).remove(0)
    };
    assert_eq!(judged(lines(), Vec::new())[0].state, State::Undetermined);
    let told = at_b(6.0);
    assert_eq!(told.fault, Some(FaultMode::InnerRace), "3.5 dB weaker there: {}", told.why);
    let open = at_b(6.6);
    assert_eq!(open.state, State::Undetermined, "2.7 dB: {}", open.why);
    assert!(open.why.contains("less than 3 dB weaker"), "{}", open.why);
}

#[test]
fn growth_at_a_rate_of_two_bearings_accuses_neither_unless_both_are_listened_to() {
    // BPFI of both by geometry, 9 elements at 30 Hz.
    let at_hz = 162.45;
    let alone = judged(Vec::new(), vec![bpfi_at(0, at_hz, 6.0)]).remove(0);
    assert_eq!(alone.state, State::Undetermined, "{}", alone.why);
    assert!(alone.why.contains("no pair of sensors listens to it"), "{}", alone.why);
    let beside = judged(Vec::new(), vec![bpfi_at(0, at_hz, 6.0), bpfi_at(1, at_hz, 1.0)]).remove(0);
    assert_eq!(beside.fault, Some(FaultMode::InnerRace), "{}", beside.why);
    // One pair for both tells as much of either.
    let both = judged(Vec::new(), vec![bpfi_at(0, at_hz, 6.0), bpfi_at(1, at_hz, 6.0)]);
    assert!(both.iter().all(|verdict| !verdict.state.is_accusation()), "{}", both[0].why);
}
