//! What could not be looked for, and what known lines of the machine may hide (docs/theory.md, F5, C39).

use super::accept::Accepted;
use super::doubt::Seen;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::severity;
use crate::features::WindowFeatures;
use crate::features::bands;
use crate::features::bearing;
use crate::features::bearing::Covered;
use crate::features::bearing::DefectLine;
use crate::features::bearing::Harmonic;
use crate::features::bearing::LineSearch;
use crate::features::bearing::Unreadable;
use crate::machine::BearingIndex;

/// A window must hold this many revolutions to acquit: in fewer, what accuses stands out, but small defects do not.
const REVOLUTIONS_TO_ACQUIT: f64 = 20.0;

/// Why a bearing cannot be looked at, if so.
pub(super) fn cannot_look(
    bearing: BearingIndex,
    searches: &[&LineSearch],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<String> {
    let described = &context.machine.bearings[bearing.0];
    if described.geometry.is_none() {
        let name = described.catalogue.as_deref().unwrap_or("unnamed");
        return Some(format!(
            "geometry of `{name}` is not known: state elements and diameters in the machine file"
        ));
    }
    if features.speed.first.is_none() {
        return Some("shaft speed is not known".to_owned());
    }
    if searches.is_empty() {
        return Some("no usable vibration channel at this bearing or its shaft".to_owned());
    }
    None
}

/// Why a race could not be read in any channel, or lies where a known line of the machine does, if so: nothing acquits the
/// bearing then, though another of its lines may accuse it, or this one where slip takes it (C39).
pub(super) fn race_not_read(searches: &[&LineSearch]) -> Option<String> {
    [DefectLine::Bpfi, DefectLine::Bpfo].into_iter().find_map(|line| not_read(line, searches))
}

/// Why a window that shows nothing acquits nobody: it is too short for that in every channel.
pub(super) fn too_short_to_acquit(searches: &[&LineSearch]) -> Option<String> {
    let read = searches.iter().filter(|s| s.outcome.is_ok());
    let longest = read.map(|s| s.revolutions()).reduce(f64::max);
    let longest = longest.filter(|n| *n < REVOLUTIONS_TO_ACQUIT)?;
    Some(format!(
        "window too short: {} revolutions show no defect, and {REVOLUTIONS_TO_ACQUIT} are needed to say that there is none; {LONGER}",
        longest.floor()
    ))
}

/// What to do about windows that are too short.
const LONGER: &str =
    "record longer, or set lengthen_windows, or a larger window_seconds, of the daemon";

/// Why a bearing whose lines do not stand is not acquitted: a race's line as deep as accuses would not stand either, in most bands of any
/// channel (C46).
pub(super) fn would_not_be_seen(searches: &[&LineSearch], context: &Context<'_>) -> Option<String> {
    [DefectLine::Bpfi, DefectLine::Bpfo].into_iter().find_map(|line| {
        let read = searches.iter().filter(|s| s.line == line && s.outcome.is_ok());
        let needed = read.filter_map(|s| Some((*s, needed_depth(s)?)));
        let (search, depth) = needed.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (depth > severity::WARNING_DEPTH).then(|| {
            format!(
                "{} of {:.1} Hz would stand over the noise in half of the bands of {} from modulation depth {depth:.1} on, and {:.2} \
                 accuses: what strikes at no rate, or the shortness of the window, hides it",
                line.name(),
                search.expected.0,
                context.channel_name(search.channel),
                severity::WARNING_DEPTH,
            )
        })
    })
}

/// Depth from which a line of a search would stand in half of its bands; `None` without bands.
fn needed_depth(search: &LineSearch) -> Option<f64> {
    let fundamentals = search.outcome.as_deref().ok()?.iter().filter_map(|r| r.harmonics[0]);
    let mut needed: Vec<f64> = fundamentals.map(|h| needed_of(&h)).collect();
    needed.sort_by(f64::total_cmp);
    needed.get(needed.len().div_ceil(2).max(1) - 1).copied()
}

/// Depth that a harmonic would need for noise to exceed it at the probability at which a line counts as there.
fn needed_of(harmonic: &Harmonic) -> f64 {
    if harmonic.power_ratio <= 0.0 {
        return 0.0;
    }
    let stands = confidence::power_ratio_at(harmonic, confidence::FALSE_ALARM_PROBABILITY);
    harmonic.depth * (stands / harmonic.power_ratio).sqrt()
}

/// Why a line could not be read in any channel at its kinematic rate, if so.
pub(super) fn not_read(line: DefectLine, searches: &[&LineSearch]) -> Option<String> {
    let mut of_line = searches.iter().filter(|s| s.line == line);
    if of_line.clone().any(|s| s.outcome.is_ok() && s.coincides.is_none()) {
        return None;
    }
    of_line.find_map(|s| unreadable(s))
}

fn unreadable(search: &LineSearch) -> Option<String> {
    let line = format!("{} {:.1} Hz", search.line.name(), search.expected.0);
    if let Some(with) = &search.coincides {
        let resolution_hz = search.resolution.0;
        return Some(format!(
            "{line} coincides with {with} within the resolution of {resolution_hz:.2} Hz"
        ));
    }
    Some(match search.outcome.as_ref().err()? {
        Unreadable::TooSlow { usable, needed } => format!(
            "sampled too slowly: {line} is out of reach, a band up to {:.0} Hz is needed and {:.0} Hz are there",
            needed.0, usable.0
        ),
        Unreadable::TooShort { needed_s } => format!(
            "window too short: {line} needs {needed_s:.1} s to be told from shaft harmonics; {LONGER}"
        ),
        Unreadable::GeometryUncertain { with, band } => format!(
            "geometry too uncertain: {line} is known to {:.1} % and may stand where {} does; \
             name the maker, or state elements and diameters in the machine file",
            100.0 * band.widest(),
            with.name()
        ),
    })
}

/// Why a bearing is not acquitted where a known line of the machine may hide a defect's: what stands there, in a quarter of the bands
/// of a channel, is as deep as accuses, and no event of the shaft explains it, which would have the multiples beside it, too (C39).
pub(super) fn hidden(searches: &[&LineSearch], seen: &Seen<'_>) -> Option<String> {
    let of_elements = searches.iter().filter(|s| s.line != DefectLine::Ftf);
    let hidden = of_elements.filter_map(|search| Some((*search, deepest(search, seen.accepted)?)));
    let depth = |(_, covered): &(&LineSearch, &Covered)| covered.harmonic.depth;
    let (search, deepest) = hidden.max_by(|a, b| depth(a).total_cmp(&depth(b)))?;
    Some(format!(
        "{:.1} Hz in the envelope of {}, modulation depth {:.2}, may be {} of {:.1} Hz as well as {}: within the resolution of {:.2} Hz \
         they are not told apart; a longer record would, or one at another speed",
        deepest.frequency.0,
        seen.context.channel_name(search.channel),
        deepest.harmonic.depth,
        search.line.name(),
        search.expected.0,
        deepest.with,
        search.resolution.0
    ))
}

/// The deepest of what may hide a line of one search, if a quarter of the bands have such.
fn deepest<'a>(search: &'a LineSearch, accepted: &[Accepted<'_>]) -> Option<&'a Covered> {
    let hiding = search.covered.iter().filter(|c| may_hide(c, search, accepted));
    let depths = hiding.clone().map(|c| c.harmonic.depth);
    let n_bands = search.outcome.as_ref().map_or(0, Vec::len).max(search.covered.len());
    let elsewhere = std::iter::repeat_n(0.0, n_bands.saturating_sub(hiding.clone().count()));
    let is_agreed = bands::quarter_reach(depths.chain(elsewhere)) > 0.0;
    hiding.max_by(|a, b| a.harmonic.depth.total_cmp(&b.harmonic.depth)).filter(|_| is_agreed)
}

fn may_hide(covered: &Covered, search: &LineSearch, accepted: &[Accepted<'_>]) -> bool {
    let depth = covered.harmonic.depth;
    depth >= severity::WARNING_DEPTH
        && depth >= bearing::STANDS_ALONE * covered.beside
        && confidence::harmonic_tail(&covered.harmonic) <= confidence::FALSE_ALARM_PROBABILITY
        && !accepted.iter().any(|a| a.explains(covered.frequency, search.resolution))
}

#[cfg(test)]
mod tests {
    use super::super::doubt::tests::changed;
    use super::super::doubt::tests::judged_with;
    use super::super::doubt::tests::search;
    use super::*;
    use crate::diagnosis::fault::FaultMode;
    use crate::diagnosis::fault::State;
    use crate::diagnosis::verdict::ComponentDiagnosis;
    use crate::features::bands::Band;
    use crate::features::bearing::Searched;
    use crate::units::Hz;

    fn judged(lines: Vec<LineSearch>) -> Vec<ComponentDiagnosis> {
        judged_with(1.0, lines, Vec::new(), Vec::new())
    }

    /// BPFI whose four bands show nothing but a line on the fifth shaft harmonic, in the first so many of them.
    fn on_a_shaft_harmonic(n_bands: u32, depth: f64, beside: f64) -> LineSearch {
        let quiet = search(0, DefectLine::Bpfi, 0.0);
        let covered = |i: u32| {
            let low = f64::from(i) * 1e3;
            Covered {
                band: Band { low: Hz(low), high: Hz(low + 1e3), whitened: false },
                frequency: Hz(150.1),
                harmonic: Harmonic {
                    power_ratio: 900.0,
                    depth,
                    floor_dof: 100.0,
                    searched: Searched::peaks(60.0),
                },
                with: "5× s".to_owned(),
                beside,
            }
        };
        LineSearch { covered: (0..n_bands).map(covered).collect(), ..quiet }
    }

    #[test]
    fn what_stands_on_a_shaft_harmonic_hides_a_defect_unless_the_shaft_explains_it() {
        let state = |line: LineSearch| {
            let verdict = judged(vec![line]).remove(0);
            (verdict.state, verdict.why)
        };
        let (open, why) = state(on_a_shaft_harmonic(1, 0.6, 0.1));
        assert_eq!(open, State::Undetermined, "{why}");
        assert!(why.contains("may be BPFI of 150.0 Hz as well as 5× s"), "{why}");
        // A comb of the shaft has its neighbours; too little effect; in no band.
        for (n_bands, depth, beside) in [(4, 0.6, 0.4), (4, 0.4, 0.1), (0, 0.6, 0.1)] {
            let (healthy, why) = state(on_a_shaft_harmonic(n_bands, depth, beside));
            assert_eq!(healthy, State::Healthy, "{n_bands} {depth} {beside}: {why}");
        }
    }

    #[test]
    fn a_race_that_coincides_is_accused_where_slip_takes_it_and_never_acquitted() {
        let coinciding = |depth: f64| LineSearch {
            coincides: Some("5× s".to_owned()),
            ..search(0, DefectLine::Bpfi, depth)
        };
        let silent = judged(vec![coinciding(0.0)]).remove(0);
        assert_eq!(silent.state, State::Undetermined);
        assert!(silent.why.contains("coincides with 5× s within the resolution"), "{}", silent.why);
        let found = judged(vec![coinciding(0.6)]).remove(0);
        assert_eq!(found.fault, Some(FaultMode::InnerRace), "{}", found.why);
        // Nor does it keep another line of the bearing from accusing.
        let elsewhere = LineSearch { expected: Hz(270.0), ..coinciding(0.0) };
        let other = judged(vec![elsewhere, search(0, DefectLine::Bpfo, 0.6)]).remove(0);
        assert_eq!(other.fault, Some(FaultMode::OuterRace), "{}", other.why);
    }

    #[test]
    fn a_race_that_cannot_be_read_hides_no_doubt_about_another_line() {
        let coinciding = LineSearch {
            coincides: Some("9× s".to_owned()),
            expected: Hz(270.0),
            ..search(0, DefectLine::Bpfi, 0.0)
        };
        let verdict = judged(vec![coinciding, search(0, DefectLine::Bpfo, 0.3)]).remove(0);
        assert_eq!(verdict.state, State::Undetermined);
        let said = ["BPFO", "too little to accuse", "besides, BPFI 270.0 Hz coincides with 9× s"];
        assert!(said.iter().all(|part| verdict.why.contains(part)), "{}", verdict.why);
    }

    #[test]
    fn what_would_not_be_seen_acquits_nobody() {
        // Noise whose power is twice its mean at the line, of this depth.
        let noise = |depth: f64| {
            changed(search(0, DefectLine::Bpfi, 0.0), |reading| {
                reading.harmonics.iter_mut().flatten().for_each(|h| {
                    (h.power_ratio, h.depth) = (2.0, depth);
                });
            })
        };
        // It would take some twelve times the power, 3.5 times the depth.
        let (hidden, seen) =
            (judged(vec![noise(0.3)]).remove(0), judged(vec![noise(0.1)]).remove(0));
        assert_eq!(hidden.state, State::Undetermined, "{}", hidden.why);
        assert!(hidden.why.contains("BPFI of 150.0 Hz would stand"), "{}", hidden.why);
        assert_eq!(seen.state, State::Healthy, "{}", seen.why);
    }

    #[test]
    fn few_revolutions_accuse_but_do_not_acquit() {
        // 30 Hz: 2/T of 0.2 Hz are 300 revolutions, of 3.75 Hz 16, of 3 Hz 20.
        let verdict = |depth: f64, resolution: f64| {
            let quiet = search(0, DefectLine::Bpfo, 0.0);
            let other = LineSearch { expected: Hz(270.0), outcome: Ok(Vec::new()), ..quiet };
            let lines = [search(0, DefectLine::Bpfi, depth), other];
            let lines = lines.map(|line| LineSearch { resolution: Hz(resolution), ..line });
            judged(lines.to_vec()).remove(0)
        };
        let open = verdict(0.0, 3.75);
        assert_eq!(open.state, State::Undetermined, "{}", open.why);
        assert!(open.why.contains("window too short: 16 revolutions"), "{}", open.why);
        assert_eq!(verdict(0.75, 3.75).fault, Some(FaultMode::InnerRace));
        assert_eq!(verdict(0.0, 2.9).state, State::Healthy);
    }
}
