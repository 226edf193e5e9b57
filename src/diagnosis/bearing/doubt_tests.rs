//! Lines that are proven and accuse nobody, each held against the same line that does.

use crate::diagnosis::Context;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::diagnosis::bearing::Unplaced;
use crate::diagnosis::bearing::judge;
use crate::diagnosis::confidence;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Elsewhere;
use crate::features::Feature;
use crate::features::WindowFeatures;
use crate::features::absolute;
use crate::features::absolute::AbsoluteLine;
use crate::features::bands::Band;
use crate::features::bearing;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::Harmonic;
use crate::features::bearing::LineSearch;
use crate::features::bearing::Searched;
use crate::features::comb;
use crate::features::comb::Comb;
use crate::features::impulses;
use crate::features::impulses::Impulses;
use crate::features::shaft;
use crate::features::shaft::OverFloor;
use crate::features::speed::Speed;
use crate::machine::BearingIndex;
use crate::machine::ShaftIndex;
use crate::machine::file;
use crate::machine::uncertainty::RelativeBand;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::sync::Arc;

const MACHINE: &str = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
    [[bearing]]\nid='a'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=39.04\n\
    [[bearing]]\nid='b'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=39.04\n\
    [[sensor]]\nchannel='a'\nkind='accelerometer'\nunit='g'\nat={bearing='a'}\n\
    [[sensor]]\nchannel='b'\nkind='accelerometer'\nunit='g'\nat={bearing='b'}\n\
    [[sensor]]\nchannel='p'\nkind='proximitor'\nunit='um'\nat={shaft='s'}\n\
    [[motor]]\nshaft='s'\npoles=2\nline_frequency_hz=60.0\n";

fn harmonic(depth: f64) -> Harmonic {
    Harmonic { power_ratio: 900.0, depth, floor_dof: 100.0, searched: Searched::peaks(60.0) }
}

/// A line at 150 Hz in four equal bands, each with two harmonics of this depth, heard at the bearing's own sensor.
pub(in crate::diagnosis::bearing) fn search(
    bearing: usize,
    line: DefectLine,
    depth: f64,
) -> LineSearch {
    let reading = |i: u32| {
        let low = f64::from(i) * 1e3;
        let band = Band { low: Hz(low), high: Hz(low + 1e3), whitened: false };
        BandReading::of_test(band, Hz(150.0), &[harmonic(depth); 2])
    };
    LineSearch {
        bearing: BearingIndex(bearing),
        channel: ChannelIndex(bearing),
        line,
        is_at_rest: line == DefectLine::Bpfo,
        expected: Hz(150.0),
        band: RelativeBand::default(),
        shaft_speed: Hz(30.0),
        side_band_spacing: Hz(30.0),
        resolution: Hz(0.2),
        sample_range: (0, 1),
        outcome: Ok((0..4).map(reading).collect()),
        covered: Vec::new(),
        coincides: None,
        octaves: Vec::new(),
    }
}

/// A search out of reach of the others, with nothing in it.
fn silent(bearing: usize, line: DefectLine) -> LineSearch {
    let expected = Hz(270.0);
    LineSearch { expected, outcome: Ok(Vec::new()), ..search(bearing, line, 0.0) }
}

pub(in crate::diagnosis::bearing) fn changed(
    mut search: LineSearch,
    change: impl Fn(&mut BandReading),
) -> LineSearch {
    search.outcome.iter_mut().flatten().for_each(change);
    search
}

/// A line of the absolute vibration of this amplitude.
pub(in crate::diagnosis::bearing) fn absolute_line(
    bearing: usize,
    line: DefectLine,
    amplitude: f64,
) -> AbsoluteLine {
    let band = Band { low: Hz(0.0), high: Hz(500.0), whitened: false };
    AbsoluteLine {
        bearing: BearingIndex(bearing),
        pair: (ChannelIndex(0), ChannelIndex(1)),
        line,
        expected: Hz(150.0),
        amplitude,
        floor: 0.01,
        reading: BandReading::of_test(band, Hz(150.0 + amplitude), &[harmonic(0.3)]),
        sample_range: (0, 1),
    }
}

/// Verdicts on bearings a and b by these lines; every line of the absolute vibration had the amplitude 1 when healthy.
pub(in crate::diagnosis::bearing) fn judged(
    lines: Vec<LineSearch>,
    absolute_lines: Vec<AbsoluteLine>,
) -> Vec<ComponentDiagnosis> {
    judged_on(1.0, lines, absolute_lines)
}

/// The same on a shaft that moves this many times as far as when healthy.
pub(in crate::diagnosis::bearing) fn judged_on(
    moved: f64,
    lines: Vec<LineSearch>,
    absolute_lines: Vec<AbsoluteLine>,
) -> Vec<ComponentDiagnosis> {
    judged_with(moved, lines, absolute_lines, Vec::new())
}

/// The same with combs in the acceleration.
pub(in crate::diagnosis::bearing) fn judged_with(
    moved: f64,
    lines: Vec<LineSearch>,
    absolute_lines: Vec<AbsoluteLine>,
    combs: Vec<Comb>,
) -> Vec<ComponentDiagnosis> {
    judged_at(Speed::unknown(), moved, lines, (absolute_lines, combs, Vec::new()))
}

/// The same with blows, at a speed that changes so.
pub(in crate::diagnosis::bearing) fn judged_at(
    speed: Speed,
    moved: f64,
    lines: Vec<LineSearch>,
    others: (Vec<AbsoluteLine>, Vec<Comb>, Vec<Impulses>),
) -> Vec<ComponentDiagnosis> {
    told_at(speed, moved, (lines, Vec::new()), others).0
}

/// The same, and what is damaged though it is not told where; with the lines of other speeds of the shaft.
pub(in crate::diagnosis::bearing) fn told_at(
    speed: Speed,
    moved: f64,
    lines: (Vec<LineSearch>, Vec<Elsewhere>),
    others: (Vec<AbsoluteLine>, Vec<Comb>, Vec<Impulses>),
) -> (Vec<ComponentDiagnosis>, Option<Unplaced>) {
    told_of(MACHINE, (speed, moved), lines, others)
}

/// The same of another machine file.
fn told_of(
    machine: &str,
    (speed, moved): (Speed, f64),
    (lines, elsewhere): (Vec<LineSearch>, Vec<Elsewhere>),
    (absolute_lines, combs, impulses): (Vec<AbsoluteLine>, Vec<Comb>, Vec<Impulses>),
) -> (Vec<ComponentDiagnosis>, Option<Unplaced>) {
    let machine = file::parse(machine, "m.toml").unwrap();
    let mut bearing_lines = lines;
    for bearing in 0..2 {
        for line in [DefectLine::Bpfi, DefectLine::Bpfo] {
            if !bearing_lines.iter().any(|s| (s.bearing.0, s.line) == (bearing, line)) {
                bearing_lines.push(silent(bearing, line));
            }
        }
    }
    let healthy = absolute_lines.iter().map(|line| {
        let id = &machine.bearing(line.bearing).id;
        (("a".to_owned(), absolute::line_name(line.line, id)), Usual::of_value(1.0))
    });
    let once = shaft::line_name(1, "s");
    let usual_combs = ["a", "b"].map(|id| {
        ((id.to_owned(), comb::feature_name(DefectLine::Bpfi, id)), Usual::of_value(0.01))
    });
    let usual: BTreeMap<_, _> = healthy
        .chain([(("p".to_owned(), once.clone()), Usual::of_value(1.0))])
        .chain(usual_combs)
        // The blows of b are known, and how deep its BPFI was.
        .chain([(("b".to_owned(), impulses::BLOWS.to_owned()), Usual::of_value(0.5))])
        .chain([(
            ("b".to_owned(), bearing::line_name(DefectLine::Bpfi, "b")),
            Usual::of_value(0.05),
        )])
        .collect();
    let displacement = Feature { name: Arc::from(once), value: moved, unit: Unit::Micrometre };
    let record = Record { name: "healthy".to_owned(), usual, n_windows: 1, ..Record::default() };
    let baseline = Baseline { records: vec![record], provisional: false };
    let features = WindowFeatures {
        time_s: (0.0, 10.0),
        // Told for sure unless a source says otherwise.
        speed: Speed {
            first: Some(Hz(30.0)),
            confidence: speed.source.map_or(1.0, |_| speed.confidence),
            ..speed
        },
        sensors: Vec::new(),
        channels: [vec![], vec![], vec![displacement]]
            .into_iter()
            .enumerate()
            .map(|(channel, values)| ChannelFeatures {
                channel: ChannelIndex(channel),
                sample_range: (0, 1),
                values,
            })
            .collect(),
        shaft_lines: vec![OverFloor {
            shaft: ShaftIndex(0),
            order: 1,
            channel: ChannelIndex(2),
            power_ratio: 900.0,
            floor_dof: 100.0,
        }],
        bearing_lines,
        lower_lines: std::sync::Arc::default(),
        between_lines: std::sync::Arc::default(),
        elsewhere,
        absolute_lines,
        impulses,
        combs,
        gears: Vec::new(),
        load: None,
        pieces: Vec::new(),
        laws: Vec::new(),
    };
    let channels = ["a", "b", "p"].map(|name| ChannelInfo {
        name: name.into(),
        sample_rate: Hz(1e4),
        unit: Unit::MetrePerSecondSquared,
        full_scale: None,
        offset: 0.0,
        unit_conflict: None,
    });
    let context = Context {
        machine: &machine,
        channels: &channels,
        channel_of_sensor: &[0, 1, 2].map(|channel| Some(ChannelIndex(channel))),
        baseline: &baseline,
        runs: &Baseline::default(),
        offered_baselines: 1,
        void_baselines: None,
        false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
    };
    judge(&features, &context)
}

#[test]
fn a_line_heard_best_where_the_shaft_explains_it_is_nobodys_and_leaves_its_bearing_open() {
    let own = || search(0, DefectLine::Bpfi, 0.6);
    let alone = judged(vec![own()], Vec::new());
    assert_eq!(alone[0].fault, Some(FaultMode::InnerRace), "{}", alone[0].why);
    // At b it carries five times the power, between harmonics of the shaft that are as deep: passing balls modulate
    // the shaft's events.
    let louder = |shaft_depth: f64| {
        changed(search(1, DefectLine::Bpfi, 0.6), |reading| {
            reading.mean_square = 5.0;
            reading.shaft_depth = shaft_depth;
        })
    };
    let beside = judged(vec![own(), louder(1.5)], Vec::new());
    assert_eq!(beside[0].state, State::Undetermined, "{}", beside[0].why);
    assert!(!beside[1].state.is_accusation(), "{}", beside[1].why);
    assert!(beside[0].why.contains("neither accused nor acquitted"), "{}", beside[0].why);
    // Without the shaft's events it is b's.
    let owned = judged(vec![own(), louder(0.0)], Vec::new());
    assert_eq!(owned[1].fault, Some(FaultMode::InnerRace), "{}", owned[1].why);
    assert!(!owned[0].state.is_accusation(), "{}", owned[0].why);
}

#[test]
fn a_line_higher_over_the_shafts_events_than_where_they_explain_it_is_its_own() {
    // Depth 0.6 at a; at b the same with five times the power between harmonics of the shaft of depth 1.5, and as deep a line
    // at the rate at which elements pass the race at rest.
    let judged = |shaft_depth: f64, passing: f64| {
        let own = changed(search(0, DefectLine::Bpfi, 0.6), |reading| {
            reading.shaft_depth = shaft_depth;
            reading.passing_depth = Some(passing);
        });
        let louder = changed(search(1, DefectLine::Bpfi, 0.6), |reading| {
            reading.mean_square = 5.0;
            reading.shaft_depth = 1.5;
            reading.passing_depth = Some(0.6);
        });
        judged(vec![own, louder], Vec::new()).remove(0)
    };
    let own = judged(0.5, 0.2);
    assert_eq!(
        own.fault,
        Some(FaultMode::InnerRace),
        "1.2 over the events, 0.4 there: {}",
        own.why
    );
    assert_eq!(judged(0.9, 0.2).state, State::Undetermined, "0.67 is less than twice 0.4");
    assert_eq!(
        judged(0.5, 0.4).state,
        State::Undetermined,
        "what the elements modulate may be as deep"
    );
}

#[test]
fn a_line_of_the_race_at_rest_that_turns_with_the_shaft_leaves_nothing_open() {
    let beside = |line: DefectLine, turns: bool| {
        let side_band = turns.then(|| harmonic(0.3));
        let own = changed(search(0, line, 0.6), |reading| reading.side_band = side_band);
        let louder = changed(search(1, line, 0.6), |reading| {
            reading.mean_square = 5.0;
            reading.shaft_depth = 1.5;
        });
        judged(vec![own, louder], Vec::new()).remove(0).state
    };
    assert_eq!(beside(DefectLine::Bpfo, true), State::Healthy);
    // Without side bands at 1x, or of the race that turns, it may be a defect's.
    assert_eq!(beside(DefectLine::Bpfo, false), State::Undetermined);
    assert_eq!(beside(DefectLine::Bpfi, true), State::Undetermined);
}

#[test]
fn other_elements_of_two_bearings_at_one_rate_belong_to_the_one_that_is_louder() {
    // The rate may be BPFI of a as well as BPFO of b, each heard by a sensor of its own; b's is the deeper.
    let verdicts = |power_at_a: f64| {
        let loud = |reading: &mut BandReading| reading.mean_square = power_at_a;
        let at_a = changed(search(0, DefectLine::Bpfi, 0.6), loud);
        judged(vec![at_a, search(1, DefectLine::Bpfo, 0.8)], Vec::new())
    };
    let (loud, quiet) = (verdicts(4.0), verdicts(0.25));
    assert_eq!((loud[0].fault, loud[1].fault), (Some(FaultMode::InnerRace), None));
    assert_eq!(loud[1].state, State::Healthy, "{}", loud[1].why);
    assert_eq!((quiet[0].fault, quiet[1].fault), (None, Some(FaultMode::OuterRace)));
}

#[test]
fn a_small_line_that_is_news_warns_without_a_cause() {
    let at = |bearing: usize, moved: f64, depth: f64| {
        let line = search(bearing, DefectLine::Bpfi, depth);
        judged_on(moved, vec![line], Vec::new()).remove(bearing)
    };
    let news = at(1, 1.0, 0.21);
    assert_eq!((news.state, news.fault), (State::Warning, None), "{}", news.why);
    assert!(news.why.contains("4.2 times as deep as the baseline"), "{}", news.why);
    let shown = news.evidence.iter().find(|e| e.indicator == "envelope_growth_bpfi").unwrap();
    assert!((shown.value - 4.2).abs() < 1e-9 && shown.threshold == Some(4.0), "{shown:?}");
    assert_eq!(at(1, 1.0, 0.19).state, State::Healthy, "3.8 times");
    assert!(at(1, 1.0, 0.3).severity > news.severity, "more of it is worse");
    assert_eq!(at(1, 1.0, 0.6).fault, Some(FaultMode::InnerRace), "large enough by itself");
    // Nobody knows what it was at a, and a shaft that moves loads sound races: half as deep as accuses, it is no sign of health (C42).
    assert_eq!(at(0, 1.0, 0.21).state, State::Undetermined);
    assert_eq!(at(1, 20.0, 0.21).state, State::Undetermined);
    // Lines of two elements, which a baseline knows nothing of at a, and once too little and once too few bands agree: news at b.
    let two = |bearing: usize| {
        let lines = [(DefectLine::Bpfi, 0.3), (DefectLine::Bpfo, 0.2)];
        let lines = lines.map(|(line, depth)| search(bearing, line, depth)).to_vec();
        judged(lines, Vec::new()).remove(bearing)
    };
    assert_eq!(two(0).state, State::Undetermined, "{}", two(0).why);
    assert_eq!((two(1).state, two(1).fault), (State::Warning, None), "{}", two(1).why);
    // Sound elements that pass move smoothly.
    let quiet_above = |reading: &mut BandReading| {
        reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { 1.0 };
    };
    let smooth = changed(search(1, DefectLine::Bpfi, 0.21), quiet_above);
    assert_eq!(judged(vec![smooth], Vec::new()).remove(1).state, State::Healthy);
}

#[test]
fn severity_goes_on_with_growth_where_the_depth_is_full() {
    let of = |absolute: Vec<AbsoluteLine>| {
        let verdict = judged(vec![search(0, DefectLine::Bpfi, 1.2)], absolute).remove(0);
        assert_eq!(verdict.fault, Some(FaultMode::InnerRace), "{}", verdict.why);
        verdict.severity.unwrap()
    };
    let grown = |ratio: f64| of(vec![absolute_line(0, DefectLine::Bpfi, ratio)]);
    let alone = of(Vec::new());
    assert!((grown(6.0) - alone).abs() < 1e-12, "little growth: the depth counts");
    let rising = [alone, grown(300.0), grown(600.0), grown(900.0)];
    assert!(rising.windows(2).all(|w| w[0] <= w[1]) && rising[1] < rising[3], "{rising:?}");
}

#[test]
fn a_tone_modulated_ten_times_as_strongly_leaves_a_line_of_the_race_at_rest_open() {
    // The highest of the four bands is led by a tone of this power.
    let beside = |line: DefectLine, power: f64| {
        let own = changed(search(0, line, 0.6), |reading| {
            if reading.band.low.0 > 2.5e3 {
                reading.carrier = Some(Hz(3360.0));
                reading.mean_square = power;
            }
        });
        judged(vec![own], Vec::new()).remove(0)
    };
    assert_eq!(beside(DefectLine::Bpfo, 9.0).fault, Some(FaultMode::OuterRace));
    let open = beside(DefectLine::Bpfo, 11.0);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("a tone of the machine is modulated"), "{}", open.why);
    // No sound element passes at the rate of the race that turns.
    assert_eq!(beside(DefectLine::Bpfi, 11.0).fault, Some(FaultMode::InnerRace));
}

#[test]
fn weak_lines_of_two_elements_leave_a_bearing_open_and_noise_does_not() {
    // One band of four shows each line beyond doubt; in a second one it has this probability.
    let beside = |p: f64| {
        let own = |line| {
            changed(search(0, line, 0.2), |reading| {
                let at = |h: &Harmonic, p: f64| confidence::power_ratio_at(h, p);
                for h in reading.harmonics.iter_mut().flatten() {
                    h.power_ratio = match reading.band.low.0 {
                        low if low < 0.5e3 => h.power_ratio,
                        low if low < 1.5e3 => at(h, p),
                        _ => 1.0,
                    };
                }
            })
        };
        judged(vec![own(DefectLine::Bpfi), own(DefectLine::Bpfo)], Vec::new()).remove(0)
    };
    let open = beside(0.9e-3);
    assert_eq!(open.state, State::Undetermined, "{}", open.why);
    assert!(open.why.contains("weak lines of several elements"), "{}", open.why);
    assert_eq!(beside(1.1e-3).state, State::Healthy);
}

#[test]
fn a_line_accuses_by_another_channel_of_its_bearing_where_the_loudest_leaves_it_open() {
    // D = 0.51 with most power at a's first channel: too near the limit. As deep as in all these tests in another one.
    let loudest = || {
        changed(search(0, DefectLine::Bpfi, 0.36), |reading| {
            reading.mean_square = 9.0;
            reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 60.0);
        })
    };
    let telling = |frequency: f64| {
        let heard = changed(search(0, DefectLine::Bpfi, 0.6), |r| r.frequency = Hz(frequency));
        LineSearch { channel: ChannelIndex(2), ..heard }
    };
    let open = judged(vec![loudest()], Vec::new());
    assert_eq!(open[0].state, State::Undetermined, "{}", open[0].why);
    let told = judged(vec![loudest(), telling(150.0)], Vec::new());
    assert_eq!(told[0].fault, Some(FaultMode::InnerRace), "{}", told[0].why);
    assert!(told[0].why.contains("envelope of p") && told[0].other_faults.is_empty());
    assert_eq!(told[1].state, State::Healthy, "{}", told[1].why);
}

#[test]
fn a_line_at_a_multiple_of_the_mains_accuses_nobody_unless_a_motor_states_its_own() {
    let mains = |motor: &str, frequency_hz: f64, has_side_band: bool| {
        let line = changed(search(0, DefectLine::Bpfi, 0.8), |band| {
            band.frequency = Hz(frequency_hz);
            band.side_band = band.harmonics[0].filter(|_| has_side_band);
        });
        let line = LineSearch { expected: Hz(frequency_hz), ..line };
        let others = (Vec::new(), Vec::new(), Vec::new());
        let (rest, _) = MACHINE.split_once("[[motor]]").unwrap();
        let machine = format!("{rest}{motor}");
        told_of(&machine, (Speed::unknown(), 1.0), (vec![line], Vec::new()), others).0.remove(0)
    };
    for hum_hz in [100.2, 119.9, 150.0, 200.3, 299.7, 360.0] {
        let open = mains("", hum_hz, false);
        assert_eq!(open.state, State::Undetermined, "{hum_hz} Hz: {}", open.why);
        assert!(open.why.contains("a mains frequency of "), "{}", open.why);
    }
    // Between its multiples, with side bands at the shaft's speed, and where the supply is another.
    let motor =
        |line_hz: f64| format!("[[motor]]\nshaft='s'\npoles=4\nline_frequency_hz={line_hz:?}\n");
    for (motor, frequency_hz, has_side_band) in
        [("", 140.0, false), ("", 119.0, false), ("", 120.0, true), (&motor(50.0), 120.0, false)]
    {
        let accused = mains(motor, frequency_hz, has_side_band);
        assert_eq!(accused.fault, Some(FaultMode::InnerRace), "{motor}: {}", accused.why);
    }
}
