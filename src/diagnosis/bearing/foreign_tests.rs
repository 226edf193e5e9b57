//! Lines that something else than the damage they would name may make.

use super::tests::changed;
use super::tests::judged_at;
use super::tests::judged_with;
use super::tests::search;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::Harmonic;
use crate::features::bearing::LineSearch;
use crate::features::bearing::Searched;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::units::Hz;

/// The verdict on the first bearing by these lines, at a speed from this source.
fn judged(source: Option<SpeedSource>, lines: Vec<LineSearch>) -> ComponentDiagnosis {
    let speed = Speed { source, confidence: 0.85, ..Speed::unknown() };
    judged_at(speed, 1.0, lines, (Vec::new(), Vec::new(), Vec::new())).remove(0)
}

/// As high a side band as the line itself.
fn with_side_band(reading: &mut BandReading) {
    reading.side_band = reading.harmonics[0];
}

#[test]
fn a_line_lower_than_its_side_band_in_most_bands_is_one_itself() {
    let lower_in = |n_bands: usize| {
        let mut line = search(0, DefectLine::Bpfi, 0.6);
        let readings = line.outcome.iter_mut().flatten().take(n_bands);
        readings.for_each(|reading| reading.outdone_by = Some(Hz(180.0)));
        judged(None, vec![line])
    };
    let open = lower_in(3);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("the line at 180.0 Hz is higher"), "{}", open.why);
    assert_eq!(lower_in(2).fault, Some(FaultMode::InnerRace));
}

#[test]
fn what_is_no_deeper_than_sound_elements_make_it_in_quiet_does_not_accuse() {
    // Two harmonics in four bands of 1 kHz, 10 s: D²/2/R·B·T is 4 in noise, 0.0004 without.
    let read = |depth: f64, n_quiet: usize| {
        let mut line = search(0, DefectLine::Bpfi, depth);
        for reading in line.outcome.iter_mut().flatten().take(n_quiet) {
            reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 1e7);
        }
        judged(None, vec![line])
    };
    assert_eq!(read(0.6, 2).fault, Some(FaultMode::InnerRace));
    let quiet = read(0.6, 3);
    assert_eq!(quiet.state, State::Undetermined, "{}", quiet.why);
    assert!(quiet.why.contains("next to nothing else is heard there"), "{}", quiet.why);
    // Half of the energy of a band.
    assert_eq!(read(0.75, 4).fault, Some(FaultMode::InnerRace));
}

/// The outer race's line, shallow; side bands at FTF tell that the elements which pass it are disturbed.
fn disturbed() -> LineSearch {
    changed(search(0, DefectLine::Bpfo, 0.2), |reading| reading.cage_band = reading.harmonics[0])
}

#[test]
fn a_cage_is_accused_from_full_modulation_on() {
    // Two harmonics: D = √2 of the depth of each, 0.85 and 1.13.
    let beside = |depth| judged(None, vec![search(0, DefectLine::Ftf, depth), disturbed()]);
    let (carried, damaged) = (beside(0.6), beside(0.8));
    assert_eq!(carried.state, State::Undetermined, "{}", carried.why);
    assert!(carried.why.contains("unequal elements"), "{}", carried.why);
    assert_eq!(damaged.fault, Some(FaultMode::Cage), "{}", damaged.why);
}

#[test]
fn a_cage_is_not_accused_where_no_race_shows_it() {
    let race = search(0, DefectLine::Bpfo, 0.2);
    let elements = search(0, DefectLine::TwoBsf, 0.2);
    for beside in [vec![], vec![race], vec![elements]] {
        let lines = [vec![search(0, DefectLine::Ftf, 0.8)], beside].concat();
        let open = judged(None, lines);
        assert_eq!(open.state, State::Undetermined, "{}", open.why);
        assert!(open.why.contains("a belt"), "{}", open.why);
    }
}

#[test]
fn a_cage_is_not_accused_beside_elements_that_it_carries_through_the_load() {
    let beside = |change: fn(&mut BandReading)| {
        let elements = changed(search(0, DefectLine::TwoBsf, 0.2), change);
        judged(None, vec![search(0, DefectLine::Ftf, 0.8), disturbed(), elements])
    };
    let open = beside(with_side_band);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("side bands at FTF"), "{}", open.why);
    let damaged = beside(|_| ());
    assert_eq!(damaged.fault, Some(FaultMode::Cage), "{}", damaged.why);
}

#[test]
fn near_a_multiple_of_a_name_plates_speed_that_nothing_confirms_nobody_is_accused() {
    let at = |source: SpeedSource, order: f64, change: fn(&mut BandReading)| {
        let line = changed(search(0, DefectLine::Bpfi, 0.6), |reading| {
            reading.frequency = Hz(30.0 * order);
            change(reading);
        });
        judged(Some(source), vec![line])
    };
    // The shaft may turn 3 % faster: its fifth harmonic, at 5.15 times what is written.
    let open = at(SpeedSource::Machine, 5.13, |_| ());
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("at 30.78 Hz this is 5×"), "{}", open.why);
    let accused = [
        at(SpeedSource::Machine, 5.17, |_| ()),
        at(SpeedSource::Capture, 5.13, |_| ()),
        at(SpeedSource::Machine, 5.13, with_side_band),
    ];
    for verdict in accused {
        assert_eq!(verdict.fault, Some(FaultMode::InnerRace), "{}", verdict.why);
    }
    // Side bands tell the spacing to the resolution of 0.2 Hz, its fifth harmonic to five times that.
    let near = at(SpeedSource::Machine, 5.03, with_side_band);
    assert_eq!(near.state, State::Undetermined, "{}", near.why);
}

#[test]
fn a_turning_race_is_not_accused_without_side_bands_where_they_would_be_seen() {
    // A tenth of the line's height is a hundredth of its power.
    let lines = |line: DefectLine, line_power: f64, side_power: f64| {
        changed(search(0, line, 0.8), |reading| {
            for harmonic in reading.harmonics.iter_mut().flatten() {
                harmonic.power_ratio = line_power;
            }
            let own = reading.harmonics[0];
            reading.side_band = own.map(|h| Harmonic {
                power_ratio: side_power,
                searched: Searched::largest(6.0, 2.0),
                ..h
            });
        })
    };
    let beside = |line, line_power, side| judged(None, vec![lines(line, line_power, side)]);
    let open = beside(DefectLine::Bpfi, 1e4, 1.0);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("passes the load once a turn"), "{}", open.why);
    let accused = [
        beside(DefectLine::Bpfi, 1e4, 100.0),
        // Noise would hide them.
        beside(DefectLine::Bpfi, 400.0, 1.0),
    ];
    for verdict in accused {
        assert_eq!(verdict.fault, Some(FaultMode::InnerRace), "{}", verdict.why);
    }
    // A speed of 30 Hz that nothing confirms is told to 0.09 Hz, and 1/T is half of the resolution.
    let within = |resolution: f64| {
        let line = lines(DefectLine::Bpfi, 1e4, 1.0);
        let line = LineSearch { resolution: Hz(resolution), ..line };
        judged(Some(SpeedSource::Capture), vec![line])
    };
    assert!(within(0.2).why.contains("passes the load once a turn"), "{}", within(0.2).why);
    assert_eq!(within(0.17).fault, Some(FaultMode::InnerRace), "{}", within(0.17).why);
    // Another speed, which nothing tells, says nothing of where they lie (F22).
    let speed = Speed { source: Some(SpeedSource::Capture), confidence: 0.0, ..Speed::unknown() };
    let line = vec![lines(DefectLine::Bpfi, 1e4, 1.0)];
    let untold = judged_at(speed, 1.0, line, (Vec::new(), Vec::new(), Vec::new())).remove(0);
    assert_eq!(untold.fault, Some(FaultMode::InnerRace), "{}", untold.why);
    // The race at rest meets the same load on each turn.
    let at_rest = beside(DefectLine::Bpfo, 1e4, 1.0);
    assert_eq!(at_rest.fault, Some(FaultMode::OuterRace), "{}", at_rest.why);
}

/// A line that so many of eight bands show, and one finds as deep as matters.
fn deep_in_one(line: DefectLine, n_showing: usize) -> LineSearch {
    let mut found = search(0, line, 0.1);
    let bands = found.outcome.as_mut().unwrap();
    bands.extend_from_within(..);
    for (i, reading) in bands.iter_mut().enumerate() {
        let low = 1e3 * f64::from(u8::try_from(i).unwrap());
        (reading.band.low, reading.band.high) = (Hz(low), Hz(low + 1e3));
        let (depth, power_ratio) = match i {
            5 => (0.6, 900.0),
            _ if i + n_showing >= 8 => (0.1, 900.0),
            _ => (0.01, 1.0),
        };
        let harmonics = reading.harmonics.iter_mut().flatten();
        harmonics.for_each(|h| (h.depth, h.power_ratio) = (depth, power_ratio));
    }
    found
}

#[test]
fn elements_with_the_side_bands_of_their_cage_are_struck_however_low_they_ring() {
    // Next to all of the power in the lowest band.
    let low = |line: DefectLine, depth: f64| {
        changed(search(0, line, depth), |reading| {
            with_side_band(reading);
            reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { 1.0 };
        })
    };
    let state = |line: DefectLine, depth: f64| {
        let verdict = judged(None, vec![low(line, depth)]);
        (verdict.state, verdict.fault)
    };
    assert_eq!(state(DefectLine::TwoBsf, 0.6).1, Some(FaultMode::RollingElement));
    assert_eq!(state(DefectLine::Bpfi, 0.6), (State::Undetermined, None), "elements may pass so");
    // Half as deep, they are no more what sound elements show.
    assert_eq!(state(DefectLine::TwoBsf, 0.3), (State::Undetermined, None));
    assert_eq!(state(DefectLine::Bpfi, 0.3), (State::Healthy, None));
}

#[test]
fn elements_with_the_side_bands_of_their_cage_need_not_be_deep_in_many_bands() {
    let with_cage = |n_showing| changed(deep_in_one(DefectLine::TwoBsf, n_showing), with_side_band);
    let accused = judged(None, vec![with_cage(3)]);
    assert_eq!(accused.fault, Some(FaultMode::RollingElement), "{}", accused.why);
    assert_eq!(accused.state, State::Warning, "few bands are no measure: {}", accused.why);
    // Too few show it; without the cage; a race, whose sound elements pass.
    let race = changed(deep_in_one(DefectLine::Bpfi, 3), with_side_band);
    for line in [with_cage(0), deep_in_one(DefectLine::TwoBsf, 3), race] {
        let open = judged(None, vec![line]);
        assert_eq!(open.state, State::Undetermined, "{}", open.why);
        assert!(open.why.contains("too few bands have 0.50 to accuse"), "{}", open.why);
    }
}

#[test]
fn a_line_whose_side_bands_a_turning_load_would_make_is_neither_accused_nor_acquitted() {
    let verdict = |line: DefectLine, depth: f64, outdone: Option<Hz>| {
        let turned = changed(search(0, line, depth), |reading| {
            (reading.is_shaft_product, reading.outdone_by) = (true, outdone);
        });
        judged_with(1.0, vec![turned], Vec::new(), Vec::new()).remove(0)
    };
    let open = verdict(DefectLine::Bpfo, 0.6, None);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("a load that turns with the shaft"), "{}", open.why);
    // Side bands higher than the line no load makes; and too little to accuse were it the defect's.
    for (depth, outdone) in [(0.6, Some(Hz(120.0))), (0.15, None)] {
        let sound = verdict(DefectLine::Bpfo, depth, outdone);
        assert_eq!(sound.state, State::Healthy, "{}", sound.why);
    }
}

#[test]
fn a_cages_line_that_is_set_aside_acquits_nobody() {
    let verdict = |depth: f64| {
        let explained = changed(search(0, DefectLine::Bpfi, 0.6), |reading| {
            reading.is_mirrored = true;
        });
        let cage = LineSearch {
            expected: Hz(12.0),
            ..changed(search(0, DefectLine::Ftf, depth), |reading| reading.frequency = Hz(12.0))
        };
        judged_with(1.0, vec![explained, cage], Vec::new(), Vec::new()).remove(0)
    };
    let open = verdict(0.8);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("elements that the cage carries strike so"), "{}", open.why);
    assert_eq!(verdict(0.5).state, State::Healthy, "as much is made by sound elements that differ");
}

#[test]
fn a_turning_race_without_its_side_bands_beside_as_high_harmonics_of_the_shaft_is_left_open() {
    let beside = |shaft_depth: f64, has_side_band: bool, line: DefectLine| {
        let line = changed(search(0, line, 0.6), |reading| {
            reading.shaft_depth = shaft_depth;
            reading.side_band = reading.harmonics[0].filter(|_| has_side_band);
        });
        judged(None, vec![line])
    };
    let open = beside(0.55, false, DefectLine::Bpfi);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("events of the shaft"), "{}", open.why);
    assert_eq!(beside(0.4, false, DefectLine::Bpfi).fault, Some(FaultMode::InnerRace));
    assert_eq!(beside(0.55, true, DefectLine::Bpfi).fault, Some(FaultMode::InnerRace));
    // The mean of the events is modulated, too: a line at the elements' own rate goes with theirs.
    let over = changed(search(0, DefectLine::Bpfi, 0.6), |reading| {
        (reading.shaft_depth, reading.passing_depth) = (0.55, Some(0.2));
    });
    assert_eq!(judged(None, vec![over]).fault, Some(FaultMode::InnerRace));
    assert_eq!(beside(0.55, false, DefectLine::Bpfo).fault, Some(FaultMode::OuterRace));
}

#[test]
fn a_line_of_nobodys_that_is_deep_in_few_bands_leaves_its_bearing_open() {
    // At b it is louder, between harmonics of the shaft that explain it.
    let louder = changed(search(1, DefectLine::Bpfi, 0.6), |reading| {
        reading.mean_square = 5.0;
        reading.shaft_depth = 1.5;
    });
    let open = judged(None, vec![deep_in_one(DefectLine::Bpfi, 8), louder]);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("neither accused nor acquitted"), "{}", open.why);
}
