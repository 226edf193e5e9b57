//! Combs that strikes make, and blows at no rate.

use super::super::doubt::tests::absolute_line;
use super::super::doubt::tests::changed;
use super::super::doubt::tests::judged_at;
use super::super::doubt::tests::judged_with;
use super::super::doubt::tests::search;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::bands::Band;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::comb::Comb;
use crate::features::impulses::Blows;
use crate::features::impulses::Impulses;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::machine::BearingIndex;
use crate::signal::ChannelIndex;
use crate::units::Hz;

/// A comb at a bearing's BPFI that accuses: at a 400 times as loud as at b, and 14 times as much as when healthy.
fn comb_at(bearing: usize) -> Comb {
    let is_a = bearing == 0;
    Comb {
        bearing: BearingIndex(bearing),
        pair: (ChannelIndex(bearing), ChannelIndex(bearing)),
        line: DefectLine::Bpfi,
        expected: Hz(162.5),
        frequency: Hz(161.0),
        lead: 9.0,
        part: 0.02,
        loudness: if is_a { 400.0 } else { 1.0 / 400.0 },
        is_slower: false,
        sample_range: (0, 1),
    }
}

/// The verdict on bearing a by the combs of both.
fn struck(combs: [Comb; 2]) -> ComponentDiagnosis {
    judged_with(1.0, Vec::new(), Vec::new(), combs.to_vec()).remove(0)
}

#[test]
fn a_comb_that_leads_and_has_grown_warns_where_it_is_loudest() {
    let both = judged_with(1.0, Vec::new(), Vec::new(), vec![comb_at(0), comb_at(1)]);
    let (a, b) = (&both[0], &both[1]);
    assert_eq!((a.state, a.fault), (State::Warning, Some(FaultMode::InnerRace)), "{}", a.why);
    assert!(a.why.contains("161.0 Hz") && a.why.contains("2.0 %"), "{}", a.why);
    assert_eq!(b.state, State::Healthy, "{}", b.why);
    let shown = a.evidence.iter().find(|e| e.indicator == "comb_bpfi").unwrap();
    assert_eq!((shown.value, shown.threshold), (9.0, Some(4.0)));
    // Each gate by itself.
    let without = |change: fn(&mut Comb)| {
        let mut own = comb_at(0);
        change(&mut own);
        struck([own, comb_at(1)]).state
    };
    assert_eq!(without(|c| c.lead = 3.9), State::Healthy);
    assert_eq!(without(|c| c.part = 0.0024), State::Healthy, "4.9 times the healthy 0.01");
    assert_eq!(without(|c| c.part = 0.0026), State::Warning);
    assert_eq!(without(|c| c.is_slower = true), State::Healthy);
    assert_eq!(without(|c| c.loudness = 3.9), State::Healthy);
    // An equal bearing nobody listens to may be the one.
    let unheard = judged_with(1.0, Vec::new(), Vec::new(), vec![comb_at(0)]).remove(0);
    assert_eq!(unheard.state, State::Healthy, "{}", unheard.why);
}

#[test]
fn strikes_grow_in_severity_and_remain_a_warning() {
    let severity = |part: f64| struck([Comb { part, ..comb_at(0) }, comb_at(1)]).severity.unwrap();
    let rising = [0.003, 0.01, 0.05, 0.5].map(severity);
    assert!(rising.windows(2).all(|w| w[0] < w[1]), "{rising:?}");
    assert!(rising.iter().all(|s| (0.25..0.5).contains(s)), "{rising:?}");
}

#[test]
fn a_race_that_is_struck_is_told_from_one_that_a_moving_shaft_loads() {
    let moving = |combs: Vec<Comb>| {
        let grown = vec![absolute_line(0, DefectLine::Bpfi, 6.0)];
        judged_with(20.0, Vec::new(), grown, combs).remove(0)
    };
    assert_eq!(moving(Vec::new()).state, State::Undetermined);
    let told = moving(vec![comb_at(0), comb_at(1)]);
    assert_eq!((told.state, told.fault), (State::Warning, Some(FaultMode::InnerRace)));
}

#[test]
fn a_line_that_is_nobodys_in_the_envelope_does_not_hide_strikes_at_its_rate() {
    // The case of a line heard best where the shaft's events explain it.
    let lines = || {
        let louder = changed(search(1, DefectLine::Bpfi, 0.6), |reading| {
            reading.mean_square = 5.0;
            reading.shaft_depth = 1.5;
        });
        vec![search(0, DefectLine::Bpfi, 0.6), louder]
    };
    let of = |frequency: f64| {
        let own = Comb { frequency: Hz(frequency), ..comb_at(0) };
        judged_with(1.0, lines(), Vec::new(), vec![own, comb_at(1)]).remove(0)
    };
    assert_eq!(of(150.0).state, State::Warning, "{}", of(150.0).why);
    // A side line of it explains them.
    assert_eq!(of(180.0).state, State::Undetermined, "{}", of(180.0).why);
}

/// Blows in a channel: this part of the energy in two bands of seven.
fn blows(channel: usize, part: f64, is_others: bool) -> Impulses {
    let parts = [0.9, part, 0.1, 0.0, 0.0, 0.0, 0.0];
    let blows = |(low, part)| {
        let band = Band { low: Hz(low), high: Hz(low + 1e3), whitened: false };
        Blows { band, part, is_others }
    };
    let bands = (0..7).map(|i| 1e3 * f64::from(i)).zip(parts).map(blows).collect();
    Impulses { channel: ChannelIndex(channel), sample_range: (0, 1), bands }
}

/// What the envelope reads of a line of bearing a at this frequency; the comb's is 161 Hz.
fn read_at(frequency: f64, line: DefectLine, depth: f64) -> Vec<LineSearch> {
    vec![changed(search(0, line, depth), |reading| reading.frequency = Hz(frequency))]
}

/// What is said of bearings a and b where a quarter of the bands of a channel, and one band more, have this part of their energy in
/// blows.
fn struck_at_no_rate(
    channel: usize,
    part: f64,
    lines: Vec<LineSearch>,
    excursion: f64,
) -> Vec<ComponentDiagnosis> {
    let heard = blows(channel, part, false);
    let speed = Speed { excursion, ..Speed::unknown() };
    judged_at(speed, 1.0, lines, (Vec::new(), Vec::new(), vec![heard]))
}

#[test]
fn blows_that_nothing_explains_leave_a_bearing_open() {
    let of_a = |part: f64| struck_at_no_rate(0, part, Vec::new(), 0.0);
    let open = of_a(0.3);
    assert_eq!((open[0].state, open[1].state), (State::Undetermined, State::Healthy));
    assert!(open[0].why.starts_with("30 % of the energy") && open[0].why.contains("bands of a"));
    let shown = open[0].evidence.iter().find(|e| e.indicator == "impulsive_part").unwrap();
    assert_eq!((shown.value, shown.threshold), (0.3, Some(0.25)));
    assert_eq!(of_a(0.24)[0].state, State::Healthy, "one band of seven is not a quarter");
    // What strikes is known; and at changing speed the level itself changes.
    let line = search(0, DefectLine::Bpfi, 0.6);
    let accused = struck_at_no_rate(0, 0.3, vec![line], 0.0);
    assert_eq!((accused[0].state, accused[1].state), (State::Warning, State::Healthy));
    assert_eq!(struck_at_no_rate(0, 0.3, Vec::new(), 0.02)[0].state, State::Healthy);
}

#[test]
fn at_a_speed_that_nothing_confirms_half_of_such_blows_leave_a_bearing_open() {
    let of_a = |part: f64, confidence: f64| {
        let source = Some(SpeedSource::Capture);
        let speed = Speed { source, confidence, ..Speed::unknown() };
        let heard = blows(0, part, false);
        judged_at(speed, 1.0, Vec::new(), (Vec::new(), Vec::new(), vec![heard])).remove(0)
    };
    let open = of_a(0.13, 0.85);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("the speed, which nothing confirms"), "{}", open.why);
    assert_eq!(of_a(0.12, 0.85).state, State::Healthy);
    assert_eq!(of_a(0.13, 0.98).state, State::Healthy, "a harmonic confirms it");
}

#[test]
fn blows_that_were_there_in_good_health_acquit() {
    let of_b = |part: f64| struck_at_no_rate(1, part, Vec::new(), 0.0).remove(1);
    // √(η/(1 − η)) was 0.5; twice that is η = ½.
    assert_eq!(of_b(0.49).state, State::Healthy);
    let grown = of_b(0.51);
    assert_eq!(grown.state, State::Undetermined);
    assert!(grown.why.ends_with("more than in the baseline"), "{}", grown.why);
}

#[test]
fn blows_at_a_rate_that_is_no_bearings_leave_nothing_open() {
    let of = |is_others: bool| {
        let heard = vec![blows(0, 0.6, is_others)];
        judged_at(Speed::unknown(), 1.0, Vec::new(), (Vec::new(), Vec::new(), heard)).remove(0)
    };
    assert_eq!((of(false).state, of(true).state), (State::Undetermined, State::Healthy));
}

#[test]
fn without_a_baseline_a_comb_warns_where_enough_comes_in_blows() {
    // Of the combs of BPFO nothing is known.
    let comb = |bearing: usize| Comb { line: DefectLine::Bpfo, ..comb_at(bearing) };
    let of = |heard: Vec<Impulses>, line: fn(usize) -> Comb| {
        let heard = (Vec::new(), vec![line(0), line(1)], heard);
        let read = read_at(161.0, DefectLine::Bpfo, 0.3);
        judged_at(Speed::unknown(), 1.0, read, heard).remove(0)
    };
    let told = of(vec![blows(0, 0.26, false)], comb);
    assert_eq!((told.state, told.fault), (State::Warning, Some(FaultMode::OuterRace)));
    assert!(
        told.why.ends_with("and up to 26 % of the energy comes in blows at that rate"),
        "{}",
        told.why
    );
    // Whoever makes the blows: the comb tells at which rate.
    assert_eq!(of(vec![blows(0, 0.26, true)], comb).state, State::Warning);
    // The line alone accuses nobody (C42).
    assert_eq!(of(vec![blows(0, 0.24, false)], comb).state, State::Undetermined);
    assert_eq!(of(vec![blows(1, 0.9, false)], comb).state, State::Undetermined, "heard elsewhere");
    // More blows make it worse, never damaged.
    let severity = |part| of(vec![blows(0, part, false)], comb).severity.unwrap();
    assert!(0.25 <= severity(0.26) && severity(0.26) < severity(0.8) && severity(0.8) < 0.5);
    // A strikes, so that b hears it leaves nothing open there.
    let both = [blows(0, 0.3, false), blows(1, 0.3, false)].to_vec();
    let heard = (Vec::new(), vec![comb(0), comb(1)], both);
    let read = read_at(161.0, DefectLine::Bpfo, 0.3);
    let of_b = judged_at(Speed::unknown(), 1.0, read, heard).remove(1);
    assert_eq!(of_b.state, State::Healthy, "{}", of_b.why);
    // Where the baseline has as much, blows prove nothing of it.
    let as_before = |bearing: usize| Comb { part: 1e-3, ..comb_at(bearing) };
    assert_eq!(of(vec![blows(0, 0.9, false)], as_before).state, State::Undetermined);
}

#[test]
fn blows_at_another_rate_than_the_combs_prove_nothing_of_it() {
    let of = |read: Vec<LineSearch>, part: f64| {
        let comb = |bearing: usize| Comb { line: DefectLine::Bpfo, ..comb_at(bearing) };
        let heard = (Vec::new(), vec![comb(0), comb(1)], vec![blows(0, part, false)]);
        judged_at(Speed::unknown(), 1.0, read, heard).remove(0)
    };
    let told = of(read_at(161.0, DefectLine::Bpfo, 0.3), 0.9);
    assert_eq!((told.state, told.fault), (State::Warning, Some(FaultMode::OuterRace)));
    assert!(
        told.why.ends_with("and up to 30 % of the energy comes in blows at that rate"),
        "{}",
        told.why
    );
    let is_accused = |read: Vec<LineSearch>| of(read, 0.9).state.is_accusation();
    assert!(!is_accused(Vec::new()), "random blows");
    assert!(!is_accused(read_at(161.0, DefectLine::Bpfo, 0.24)), "shallower than such blows");
    assert!(!is_accused(read_at(161.3, DefectLine::Bpfo, 0.3)), "more than 2/T away");
    assert!(!is_accused(read_at(161.0, DefectLine::Bpfi, 0.3)), "another line");
    let chance = changed(read_at(161.0, DefectLine::Bpfo, 0.3).remove(0), |reading| {
        reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 3.0);
    });
    assert!(!is_accused(vec![chance]), "as high as what is beside it");
    let elsewhere = changed(read_at(161.0, DefectLine::Bpfo, 0.3).remove(0), |reading| {
        reading.band.low = Hz(reading.band.low.0 + 500.0);
    });
    assert!(!is_accused(vec![elsewhere]), "in other bands");
}

#[test]
fn beside_blows_a_comb_that_has_grown_less_than_fivefold_warns() {
    // The part of the amplitude was 0.01 when healthy.
    let of = |growth: f64, part: f64| {
        let own = Comb { part: (0.01 * growth).powi(2), ..comb_at(0) };
        let heard = (Vec::new(), vec![own, comb_at(1)], vec![blows(0, part, true)]);
        let read = read_at(161.0, DefectLine::Bpfi, 0.3);
        judged_at(Speed::unknown(), 1.0, read, heard).remove(0)
    };
    assert_eq!(of(4.9, 0.24).state, State::Undetermined, "by the line alone");
    let told = of(4.9, 0.26);
    assert_eq!((told.state, told.fault), (State::Warning, Some(FaultMode::InnerRace)));
    assert!(
        told.why.contains("4.9 times") && told.why.contains("up to 26 % of the energy"),
        "{}",
        told.why
    );
}

#[test]
fn a_comb_at_a_multiple_of_a_speed_that_nothing_confirms_may_be_a_couplings() {
    // The shaft turns at 30 Hz as it is stated; five jaws, a third of a percent off.
    let at = |frequency_hz: f64, confidence: f64| {
        let source = Some(SpeedSource::Capture);
        let speed = Speed { source, confidence, ..Speed::unknown() };
        let expected = Hz(frequency_hz);
        let combs = [0, 1].map(|b| Comb { frequency: expected, expected, ..comb_at(b) });
        let others = (Vec::new(), combs.to_vec(), Vec::new());
        judged_at(speed, 1.0, Vec::new(), others).remove(0).fault
    };
    assert_eq!(at(149.5, 0.85), None);
    assert_eq!(at(149.5, 0.98), Some(FaultMode::InnerRace), "harmonics of the shaft confirm it");
    assert_eq!(at(161.0, 0.85), Some(FaultMode::InnerRace));
}
