//! Lines too small to accuse and too deep to acquit (docs/theory.md, C42, C55).

use super::tests::changed;
use super::tests::judged_with;
use super::tests::search;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::units::Hz;

fn judged(lines: Vec<LineSearch>) -> Vec<ComponentDiagnosis> {
    judged_with(1.0, lines, Vec::new(), Vec::new())
}

/// A line whose two harmonics make it so deep.
fn of_depth(bearing: usize, depth: f64) -> LineSearch {
    search(bearing, DefectLine::Bpfi, depth / f64::sqrt(2.0))
}

#[test]
fn a_line_half_as_deep_as_accuses_acquits_nobody() {
    let open = judged(vec![of_depth(0, 0.26)]).remove(0);
    assert_eq!((open.state, open.fault), (State::Undetermined, None), "{}", open.why);
    assert!(open.why.contains("too little to accuse, too much to acquit"), "{}", open.why);
    let small = judged(vec![of_depth(0, 0.24)]).remove(0);
    assert_eq!(small.state, State::Healthy, "{}", small.why);
}

#[test]
fn what_would_tell_a_line_is_a_baseline_or_growth_over_the_one_there_is() {
    // Half of the energy in two bands of twelve; the baseline of b has 0.05 of the line.
    let in_few = |bearing: usize| {
        let reading = |i: u32| {
            let line = of_depth(bearing, if i < 2 { 1.2 } else { 0.02 });
            let line = changed(line, |reading| {
                let low = f64::from(i) * 1e3;
                (reading.band.low.0, reading.band.high.0) = (low, low + 1e3);
                if i >= 2 {
                    reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 1.0);
                }
            });
            line.outcome.unwrap().remove(0)
        };
        let line = of_depth(bearing, 1.2);
        judged(vec![LineSearch { outcome: Ok((0..12).map(reading).collect()), ..line }])
            .remove(bearing)
    };
    let is_told = |verdict: &ComponentDiagnosis, how: &str| {
        assert_eq!(verdict.state, State::Undetermined, "{}", verdict.why);
        assert!(verdict.why.contains(how), "{}", verdict.why);
    };
    is_told(&in_few(0), "a baseline of the healthy machine would tell");
    is_told(&in_few(1), "times as deep as the baseline, and 4 times would be news");
    // Grown enough to warn, did the shaft not move more than it did.
    let moving = judged_with(20.0, vec![of_depth(1, 0.3)], Vec::new(), Vec::new()).remove(1);
    is_told(&moving, "4.2 times as deep as the baseline, but chance, the shaft's motion");
}

#[test]
fn a_small_line_that_chance_or_sound_elements_make_acquits_as_before() {
    let healthy = |line: LineSearch| judged(vec![line]).remove(0).state == State::Healthy;
    let chance = changed(of_depth(0, 0.26), |reading| {
        reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 9.0);
    });
    assert!(healthy(chance));
    // Nothing of it above the lowest band.
    let smooth = changed(of_depth(0, 0.26), |reading| {
        reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { 1.0 };
    });
    assert!(healthy(smooth));
    // The baseline of b has 0.05 of it: less than four times that is no news, more warns (C38).
    let known = |depth: f64| judged(vec![of_depth(1, depth)]).remove(1).state;
    assert_eq!((known(0.26), known(0.29)), (State::Healthy, State::Warning));
}

/// A line that is its fundamental alone.
fn alone(bearing: usize, line: DefectLine, depth: f64) -> LineSearch {
    changed(search(bearing, line, depth), |reading| {
        for lost in reading.harmonics.iter_mut().skip(1).flatten() {
            (lost.power_ratio, lost.depth) = (1.0, 0.01);
        }
    })
}

#[test]
fn a_fundamental_without_its_harmonics_acquits_nobody() {
    let judged_alone = |line: LineSearch| {
        let at = line.bearing.0;
        judged(vec![line]).remove(at)
    };
    for line in [DefectLine::Bpfi, DefectLine::Bpfo, DefectLine::TwoBsf] {
        let open = judged_alone(alone(0, line, 0.9));
        assert_eq!((open.state, open.fault), (State::Undetermined, None), "{}", open.why);
        assert!(open.why.contains("in 4 of 4 bands, without its harmonics"), "{}", open.why);
        assert_eq!(judged_alone(alone(0, line, 0.26)).state, State::Undetermined);
        assert_eq!(judged_alone(alone(0, line, 0.24)).state, State::Healthy);
    }
    let healthy = |line: LineSearch| judged_alone(line).state == State::Healthy;
    assert!(healthy(alone(0, DefectLine::Ftf, 0.26)), "all that elements do swings at the cage's");
    // The baseline of b has 0.05 of it.
    let news = judged_alone(alone(1, DefectLine::Bpfi, 0.26));
    assert!(news.why.contains("5.2 times as deep as the baseline"), "{}", news.why);
    let chance = changed(alone(0, DefectLine::Bpfi, 0.26), |reading| {
        reading.harmonics.iter_mut().flatten().for_each(|h| h.power_ratio = 9.0);
    });
    assert!(healthy(chance));
    // Nothing of it above the lowest band, which ends below what structures ring at, or above it.
    let smooth = |times: f64| {
        changed(alone(0, DefectLine::Bpfo, 0.26), |reading| {
            reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { 1.0 };
            reading.band.low.0 *= times;
            reading.band.high.0 *= times;
        })
    };
    assert_eq!((healthy(smooth(1.0)), healthy(smooth(5.0))), (true, false));
    // A tone that swings at the rate carries it.
    let of_tone = changed(alone(0, DefectLine::Bpfo, 0.26), |reading| {
        reading.carrier = Some(Hz(2500.0)).filter(|_| (reading.band.low.0 - 2e3).abs() < 1.0);
        reading.mean_square = if reading.carrier.is_some() { 20.0 } else { 1.0 };
    });
    assert!(healthy(of_tone));
}

#[test]
fn a_motion_in_a_band_in_which_structures_ring_acquits_nobody() {
    // Nothing above the lowest quarter, which ends at 1 or 5 kHz.
    let smooth = |depth: f64, times: f64| {
        let line = changed(of_depth(0, depth), |reading| {
            reading.mean_square = if reading.band.low.0 > 0.0 { 0.01 } else { 1.0 };
            reading.band.low.0 *= times;
            reading.band.high.0 *= times;
        });
        judged(vec![line]).remove(0)
    };
    assert_eq!(smooth(0.26, 1.0).state, State::Healthy);
    let open = smooth(0.26, 5.0);
    assert_eq!((open.state, open.fault), (State::Undetermined, None), "{}", open.why);
    assert_eq!(smooth(0.24, 5.0).state, State::Healthy, "too small to leave anything open");
}

#[test]
fn beside_what_another_bearing_strikes_a_small_line_leaves_nothing_open() {
    let other = LineSearch { expected: Hz(190.0), ..search(1, DefectLine::Bpfo, 0.6) };
    let at_other = changed(other, |reading| reading.frequency = Hz(190.0));
    let verdicts = judged(vec![of_depth(0, 0.26), at_other]);
    assert!(verdicts[1].state.is_accusation(), "{}", verdicts[1].why);
    assert_eq!(verdicts[0].state, State::Healthy, "{}", verdicts[0].why);
}

#[test]
fn where_there_is_a_baseline_each_way_to_accuse_pays_for_the_others() {
    // Lines that stand ever higher: between those that are nobody's and those that accuse some have less than 10⁻³ and more than a quarter of it.
    let whys: Vec<(State, String)> = (0..400)
        .map(|step| {
            let line = changed(of_depth(0, 0.8), |reading| {
                let harmonics = reading.harmonics.iter_mut().flatten();
                harmonics.for_each(|h| h.power_ratio = 5.0 + 0.1 * f64::from(step));
            });
            let verdict = judged(vec![line]).remove(0);
            (verdict.state, verdict.why)
        })
        .collect();
    let is_unsure = |(state, why): &&(State, String)| {
        *state == State::Undetermined && why.contains("accusations are held to 2.5e-4")
    };
    assert!(whys.iter().any(|why| is_unsure(&why)), "{whys:?}");
    assert!(whys.last().is_some_and(|(state, _)| state.is_accusation()), "{:?}", whys.last());
}
