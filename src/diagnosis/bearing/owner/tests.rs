//! One found rate, several lines: the same answer in every order, and no cause that is a guess.

use super::*;
use crate::diagnosis::Context;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::bearing::judge;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::bands::Band;
use crate::features::bearing::BandReading;
use crate::features::bearing::Harmonic;
use crate::features::bearing::Searched;
use crate::features::speed::Speed;
use crate::machine::BearingIndex;
use crate::machine::file;
use crate::machine::uncertainty::RelativeBand;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Unit;

const NARROW: RelativeBand = RelativeBand { low: -0.003, high: 0.003 };
const WIDE: RelativeBand = RelativeBand { low: -0.1, high: 0.1 };

/// A bearing's line, the order expected, its band, and whether its side bands stand.
type Line = (&'static str, DefectLine, f64, RelativeBand, bool);

fn harmonic(power_ratio: f64) -> Harmonic {
    Harmonic { power_ratio, depth: 0.75, floor_dof: 100.0, searched: Searched::peaks(60.0) }
}

/// A search that found the line of order 5 by a shaft of 30 Hz in four bands, if it may stand there.
fn search(place: usize, (_, line, order, band, side): Line) -> LineSearch {
    let reading = |i: u32| {
        let low = f64::from(i) * 1e3;
        let band = Band { low: Hz(low), high: Hz(low + 1e3), whitened: false };
        let read = BandReading::of_test(band, Hz(150.0), &[harmonic(900.0), harmonic(400.0)]);
        BandReading { side_band: Some(harmonic(if side { 100.0 } else { 1.0 })), ..read }
    };
    let (low, high) = reach::searched_range(line, Hz(30.0 * order), band);
    let is_near = (low.0 - 0.2..high.0 + 0.2).contains(&150.0);
    LineSearch {
        bearing: BearingIndex(place),
        channel: ChannelIndex(0),
        line,
        is_at_rest: line == DefectLine::Bpfo,
        expected: Hz(30.0 * order),
        band,
        shaft_speed: Hz(30.0),
        side_band_spacing: Hz(if line == DefectLine::TwoBsf { 12.0 } else { 30.0 }),
        resolution: Hz(0.2),
        sample_range: (0, 1),
        outcome: Ok((0..if is_near { 4 } else { 0 }).map(reading).collect()),
        covered: Vec::new(),
        coincides: None,
        octaves: Vec::new(),
    }
}

/// Verdicts by bearing id where the bearings stand in the order of `ids` in the machine file.
fn judged(ids: &[&str], lines: &[Line]) -> Vec<ComponentDiagnosis> {
    let place = |line: &Line| ids.iter().position(|id| *id == line.0).unwrap();
    judged_by(ids, lines.iter().map(|l| search(place(l), *l)).collect())
}

/// The same by searches.
fn judged_by(ids: &[&str], mut searches: Vec<LineSearch>) -> Vec<ComponentDiagnosis> {
    let bearings: String = ids
        .iter()
        .map(|id| {
            format!(
                "[[bearing]]\nid='{id}'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\n\
                 pitch_diameter_mm=39.04\n"
            )
        })
        .collect();
    let text = format!(
        "[machine]\nid='m'\n[[shaft]]\nid='s'\n{bearings}[[sensor]]\nchannel='a'\n\
         kind='accelerometer'\nunit='g'\nat={{shaft='s'}}\n[[sensor]]\nchannel='b'\nkind='accelerometer'\nunit='g'\nat={{shaft='s'}}\n\
         [[motor]]\nshaft='s'\npoles=2\nline_frequency_hz=60.0\n"
    );
    searches.sort_by_key(|s| s.bearing.0);
    // Races that show nothing, so that every bearing could be looked at.
    for (i, line) in (0..ids.len()).flat_map(|i| [(i, DefectLine::Bpfi), (i, DefectLine::Bpfo)]) {
        if !searches.iter().any(|s| (s.bearing.0, s.line) == (i, line)) {
            let silent = ("", line, 9.0, RelativeBand::default(), false);
            searches.push(LineSearch { outcome: Ok(Vec::new()), ..search(i, silent) });
        }
    }
    judged_below(&text, searches, Vec::new())
}

/// Verdicts on the bearings of a machine with two sensors, by these lines in all of the band and those in the sets below.
pub(in crate::diagnosis::bearing) fn judged_below(
    text: &str,
    bearing_lines: Vec<LineSearch>,
    lower_lines: Vec<Vec<LineSearch>>,
) -> Vec<ComponentDiagnosis> {
    judged_besides(text, bearing_lines, (lower_lines, Vec::new()))
}

/// The same, and by lines between the shaft's events.
pub(in crate::diagnosis::bearing) fn judged_besides(
    text: &str,
    bearing_lines: Vec<LineSearch>,
    (lower_lines, between_lines): (Vec<Vec<LineSearch>>, Vec<LineSearch>),
) -> Vec<ComponentDiagnosis> {
    let machine = file::parse(text, "m.toml").unwrap();
    let speed = Speed { first: Some(Hz(30.0)), confidence: 1.0, ..Speed::unknown() };
    let features = WindowFeatures {
        time_s: (0.0, 10.0),
        speed,
        load: None,
        sensors: Vec::new(),
        channels: Vec::new(),
        shaft_lines: Vec::new(),
        bearing_lines,
        lower_lines: lower_lines.into(),
        between_lines: between_lines.into(),
        elsewhere: Vec::new(),
        absolute_lines: Vec::new(),
        impulses: Vec::new(),
        combs: Vec::new(),
        gears: Vec::new(),
        pieces: Vec::new(),
        laws: Vec::new(),
    };
    let channels = ["a", "b"].map(|name| ChannelInfo {
        name: name.into(),
        sample_rate: Hz(1e4),
        unit: Unit::MetrePerSecondSquared,
        full_scale: None,
        offset: 0.0,
        unit_conflict: None,
    });
    let baseline = Baseline { records: Vec::new(), provisional: false };
    let context = Context {
        machine: &machine,
        channels: &channels,
        channel_of_sensor: &[Some(ChannelIndex(0)), Some(ChannelIndex(1))],
        baseline: &baseline,
        runs: &baseline,
        offered_baselines: 0,
        void_baselines: None,
        false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
    };
    judge(&features, &context).0
}

fn of<'a>(verdicts: &'a [ComponentDiagnosis], id: &str) -> &'a ComponentDiagnosis {
    verdicts.iter().find(|c| c.id == id).unwrap()
}

#[test]
fn the_bearing_known_well_goes_before_the_wide_one_in_either_order() {
    let lines =
        [("a", DefectLine::Bpfo, 5.3, WIDE, false), ("b", DefectLine::Bpfi, 5.02, NARROW, true)];
    for ids in [["a", "b"], ["b", "a"]] {
        let verdicts = judged(&ids, &lines);
        assert_eq!(of(&verdicts, "b").fault, Some(FaultMode::InnerRace), "{ids:?}");
        assert!(!of(&verdicts, "a").state.is_accusation(), "{ids:?}: {}", of(&verdicts, "a").why);
    }
}

#[test]
fn equal_bearings_on_one_sensor_are_both_left_open_in_either_order() {
    let lines = ["a", "b"].map(|id| (id, DefectLine::Bpfo, 5.02, NARROW, false));
    for ids in [["a", "b"], ["b", "a"]] {
        let verdicts = judged(&ids, &lines);
        for id in ids {
            let verdict = of(&verdicts, id);
            assert_eq!(verdict.state, State::Undetermined, "{}", verdict.why);
            let said = verdict.why.contains("the bearings a and b may have this rate")
                || verdict.why.contains("the bearings b and a may have this rate");
            assert!(said, "{}", verdict.why);
        }
    }
}

#[test]
fn side_bands_tell_elements_that_coincide_apart() {
    let verdict = |race: bool, element: bool| {
        let lines = [
            ("a", DefectLine::Bpfi, 5.02, NARROW, race),
            ("a", DefectLine::TwoBsf, 4.98, NARROW, element),
        ];
        let verdicts = judged(&["a"], &lines);
        (verdicts[0].state.is_accusation(), verdicts[0].fault)
    };
    assert_eq!(verdict(true, false), (true, Some(FaultMode::InnerRace)));
    assert_eq!(verdict(false, true), (true, Some(FaultMode::RollingElement)));
    assert_eq!(verdict(true, true), (true, None));
    assert_eq!(verdict(false, false), (true, None));
}

#[test]
fn side_bands_at_the_cages_rate_are_no_sign_of_elements_where_their_race_at_rest_is_nearer() {
    // Found at 5.0.
    let fault = |bpfo: f64, two_bsf: f64| {
        let lines = [
            ("a", DefectLine::Bpfo, bpfo, NARROW, false),
            ("a", DefectLine::TwoBsf, two_bsf, NARROW, true),
        ];
        let verdicts = judged(&["a"], &lines);
        (verdicts[0].state.is_accusation(), verdicts[0].fault)
    };
    assert_eq!(fault(5.005, 4.95), (true, None));
    assert_eq!(fault(5.03, 4.99), (true, Some(FaultMode::RollingElement)));
}

#[test]
fn an_element_just_out_of_its_range_is_not_excluded() {
    // Found at 5.0: 2·BSF of 5.12 is sought from 5.018 on, of 5.14 from 5.037 on; half of a percent more is 0.026.
    let fault = |two_bsf: f64| {
        let lines = [
            ("a", DefectLine::Bpfi, 5.02, NARROW, false),
            ("a", DefectLine::TwoBsf, two_bsf, RelativeBand::default(), false),
        ];
        let lines = judged(&["a"], &lines);
        (lines[0].state.is_accusation(), lines[0].fault)
    };
    assert_eq!(fault(5.12), (true, None));
    assert_eq!(fault(5.14), (true, Some(FaultMode::InnerRace)));
}

#[test]
fn a_line_out_of_reach_of_all_others_is_accused_as_ever() {
    let lines = [
        ("a", DefectLine::Bpfo, 5.02, NARROW, false),
        ("a", DefectLine::TwoBsf, 6.0, NARROW, false),
    ];
    assert_eq!(judged(&["a"], &lines)[0].fault, Some(FaultMode::OuterRace));
}

#[test]
fn side_bands_in_a_quarter_of_the_bands_are_enough_and_paid_for() {
    let stands = |power_ratios: &[f64]| {
        let mut found = search(0, ("a", DefectLine::TwoBsf, 4.98, NARROW, false));
        found.outcome.as_mut().unwrap().truncate(power_ratios.len());
        for (reading, ratio) in found.outcome.as_mut().unwrap().iter_mut().zip(power_ratios) {
            let side = Harmonic { searched: Searched::largest(6.0, 2.0), ..harmonic(*ratio) };
            // Not so high that side bands a tenth as high would be seen.
            reading.harmonics[0] = Some(harmonic(400.0));
            reading.side_band = Some(side);
        }
        has_side_bands(&found, Hz(150.0))
    };
    assert!(!stands(&[1.0; 4]));
    assert!(stands(&[40.0, 1.0, 1.0, 1.0]));
    // Enough in a band that is looked at alone, not in one of four.
    let tail = |ratio: f64| {
        let side = Harmonic { searched: Searched::largest(6.0, 2.0), ..harmonic(ratio) };
        confidence::harmonic_tail(&side)
    };
    let ratio = (80..200).map(|z| f64::from(z) / 10.0).find(|z| tail(*z) <= 8e-4).unwrap();
    assert!(stands(&[ratio]) && !stands(&[ratio, 1.0, 1.0, 1.0]));
}

/// A line that stands so high in eight bands that side bands a tenth as high would be seen, with those of these power ratios.
fn clear(side_bands: [f64; 8], lines: &[Line]) -> Vec<LineSearch> {
    let place = |line: &Line| if line.0 == "a" { 0 } else { 1 };
    let mut found: Vec<LineSearch> = lines.iter().map(|l| search(place(l), *l)).collect();
    let readings = found[0].outcome.as_mut().unwrap();
    readings.extend(readings.clone());
    for (reading, ratio) in readings.iter_mut().zip(side_bands) {
        reading.harmonics[0] = Some(harmonic(5000.0));
        let side = Harmonic { searched: Searched::largest(6.0, 2.0), ..harmonic(ratio) };
        reading.side_band = Some(side);
    }
    found
}

#[test]
fn a_load_modulates_what_is_struck_in_all_bands() {
    let stands = |side_bands: [f64; 8]| {
        let found = clear(side_bands, &[("a", DefectLine::TwoBsf, 4.98, NARROW, true)]);
        has_side_bands(&found[0], Hz(150.0))
    };
    assert!(stands([60.0; 8]) && stands([60.0, 60.0, 60.0, 60.0, 2.0, 2.0, 2.0, 2.0]));
    assert!(!stands([60.0, 60.0, 60.0, 2.0, 2.0, 2.0, 2.0, 2.0]), "something else stands in three");
}

#[test]
fn a_turning_race_without_its_side_bands_may_be_anothers_race_at_rest() {
    let verdicts = |side: f64, bpfo: f64| {
        let lines = [
            ("a", DefectLine::Bpfi, 5.02, NARROW, true),
            ("b", DefectLine::Bpfo, bpfo, NARROW, false),
        ];
        let mut searches = clear([side; 8], &lines);
        // Heard by the other's sensor alone.
        searches[1].channel = ChannelIndex(1);
        searches[1].outcome = Ok(Vec::new());
        judged_by(&["a", "b"], searches)
    };
    let open = verdicts(2.0, 5.02);
    for (id, other) in [("a", "BPFO of b"), ("b", "BPFI of a")] {
        let verdict = of(&open, id);
        assert_eq!(verdict.state, State::Undetermined, "{}", verdict.why);
        assert!(verdict.why.contains(other), "{}", verdict.why);
    }
    let told = verdicts(60.0, 5.02);
    assert_eq!(of(&told, "a").fault, Some(FaultMode::InnerRace), "{}", of(&told, "a").why);
    // At a rate of its own it is a's, if anybody's (C50).
    let nobodys = verdicts(2.0, 5.3);
    assert!(of(&nobodys, "a").why.contains("passes the load once a turn"));
    for verdicts in [told, nobodys] {
        assert_eq!(of(&verdicts, "b").state, State::Healthy, "{}", of(&verdicts, "b").why);
    }
}

#[test]
fn a_race_louder_than_anothers_elements_with_their_cages_side_bands_is_not_accused() {
    let verdicts = |side: bool| {
        let mut element = search(1, ("b", DefectLine::TwoBsf, 5.02, NARROW, side));
        element.channel = ChannelIndex(1);
        element.outcome.iter_mut().flatten().for_each(|r| r.mean_square = 0.1);
        let race = search(0, ("a", DefectLine::Bpfo, 5.02, NARROW, false));
        judged_by(&["a", "b"], vec![race, element])
    };
    let open = verdicts(true);
    for (id, other) in [("a", "2·BSF of b"), ("b", "BPFO of a")] {
        let verdict = of(&open, id);
        assert_eq!(verdict.state, State::Undetermined, "{}", verdict.why);
        assert!(verdict.why.contains(other), "{}", verdict.why);
    }
    assert_eq!(of(&verdicts(false), "a").fault, Some(FaultMode::OuterRace));
}
