//! Bands of the lower part of the spectrum, where those of all of it accuse nobody.

use super::super::doubt::tests::search;
use super::super::owner::tests::judged_below;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::units::Hz;

pub(in crate::diagnosis::bearing) const MACHINE: &str = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
    [[bearing]]\nid='a'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=39.04\n\
    [[bearing]]\nid='b'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=36.0\n\
    [[sensor]]\nchannel='a'\nkind='accelerometer'\nunit='g'\nat={bearing='a'}\n\
    [[sensor]]\nchannel='b'\nkind='accelerometer'\nunit='g'\nat={bearing='b'}\n\
    [[motor]]\nshaft='s'\npoles=2\nline_frequency_hz=60.0\n";

/// The lines of both inner races, of these depths, at 150 and 270 Hz; outer races that show nothing.
pub(in crate::diagnosis::bearing) fn races(inner: f64, of_b: f64) -> Vec<LineSearch> {
    let silent = |bearing, at| {
        let search = search(bearing, DefectLine::Bpfo, 0.0);
        LineSearch { expected: Hz(at), outcome: Ok(Vec::new()), ..search }
    };
    let of_b = at(270.0, search(1, DefectLine::Bpfi, of_b));
    vec![search(0, DefectLine::Bpfi, inner), silent(0, 107.0), of_b, silent(1, 105.0)]
}

/// The same line at another rate.
pub(in crate::diagnosis::bearing) fn at(rate: f64, mut search: LineSearch) -> LineSearch {
    search.expected = Hz(rate);
    search.outcome.iter_mut().flatten().for_each(|reading| reading.frequency = Hz(rate));
    search
}

/// The verdicts by these lines in all of the band, and those in the sets below.
fn judged(
    bearing_lines: Vec<LineSearch>,
    lower_lines: Vec<Vec<LineSearch>>,
) -> Vec<ComponentDiagnosis> {
    judged_below(MACHINE, bearing_lines, lower_lines)
}

#[test]
fn what_rings_below_alone_accuses_where_all_of_the_band_accuses_nobody() {
    let whole = || races(0.1, 0.01);
    let alone = judged(whole(), Vec::new());
    assert_eq!(alone[0].state, State::Healthy, "{}", alone[0].why);
    let verdicts = judged(whole(), vec![races(0.2, 0.01), races(0.6, 0.01)]);
    assert_eq!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
    assert!(verdicts[0].why.ends_with("; read below 4000 Hz alone"), "{}", verdicts[0].why);
    assert!(!verdicts[0].evidence.is_empty());
    assert_eq!(verdicts[1].state, State::Healthy, "{}", verdicts[1].why);
}

#[test]
fn the_widest_set_that_accuses_decides() {
    let verdicts = judged(races(0.1, 0.01), vec![races(0.6, 0.01), races(0.6, 0.6)]);
    assert_eq!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
    assert_eq!(verdicts[1].state, State::Healthy, "{}", verdicts[1].why);
}

#[test]
fn sets_below_are_not_asked_where_something_is_accused() {
    let verdicts = judged(races(0.1, 0.6), vec![races(0.6, 0.6)]);
    assert_eq!(verdicts[1].fault, Some(FaultMode::InnerRace), "{}", verdicts[1].why);
    assert_ne!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
}

#[test]
fn a_line_that_may_be_something_elses_in_all_of_the_band_is_so_below() {
    // A line beside it is higher by its side bands' distance: it is one of that.
    let mut whole = races(0.6, 0.01);
    for reading in whole[0].outcome.iter_mut().flatten() {
        reading.outdone_by = Some(Hz(180.0));
    }
    let verdicts = judged(whole, vec![races(0.6, 0.01)]);
    assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
    assert!(verdicts[0].why.contains("the line at 180.0 Hz is higher"), "{}", verdicts[0].why);
}

#[test]
fn a_bearing_with_weak_lines_of_several_elements_is_not_accused_below() {
    let mut whole = races(0.17, 0.01);
    whole[1] = at(107.0, search(0, DefectLine::Bpfo, 0.17));
    let verdicts = judged(whole, vec![races(0.6, 0.01)]);
    assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
    assert!(verdicts[0].why.contains("several elements"), "{}", verdicts[0].why);
}

#[test]
fn a_line_half_as_deep_as_accuses_below_leaves_a_sound_bearing_open() {
    let verdicts = judged(races(0.1, 0.01), vec![races(0.25, 0.01)]);
    assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
    assert!(verdicts[0].why.ends_with("; read below 4000 Hz alone"), "{}", verdicts[0].why);
    assert_eq!(verdicts[1].state, State::Healthy, "{}", verdicts[1].why);
}

#[test]
fn every_set_is_paid_for() {
    let probability = |n_sets: usize| {
        let lower = std::iter::repeat_with(|| races(0.6, 0.01)).take(n_sets).collect();
        let verdict = judged(races(0.1, 0.01), lower).remove(0);
        let line = verdict.evidence.iter().find(|e| e.indicator == "envelope_line_bpfi");
        line.and_then(|line| line.false_alarm_probability).unwrap()
    };
    assert!((probability(3) / probability(1) - 2.0).abs() < 1e-9);
}

#[test]
fn what_half_of_the_band_shows_is_less_sure_than_what_all_of_it_does() {
    // All of the band reaches twice as high as the set below, and shows too little.
    let mut whole = races(0.1, 0.01);
    for search in &mut whole {
        for (place, reading) in search.outcome.iter_mut().flatten().enumerate() {
            let low = 2e3 * place as f64;
            (reading.band.low, reading.band.high) = (Hz(low), Hz(low + 2e3));
        }
    }
    let confidence = |verdicts: Vec<ComponentDiagnosis>| verdicts[0].confidence.unwrap();
    let below = confidence(judged(whole, vec![races(0.6, 0.01)]));
    let of_all = confidence(judged(races(0.6, 0.01), vec![races(0.1, 0.01)]));
    // C5 with all bands of half of the band, and of all of it.
    let expected = of_all * (0.6 + 0.4 * 0.5) / (0.6 + 0.4);
    assert!((below / expected - 1.0).abs() < 1e-6, "{below} {of_all}");
}
