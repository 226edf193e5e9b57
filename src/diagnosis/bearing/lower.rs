//! What bands of the lower part of the spectrum tell where those of all of it accuse nobody (docs/theory.md, C51).
//!
//! Must not know how bands are cut, nor what a baseline holds of depths: that is of the bands of all of the spectrum.

use super::accept;
use super::accept::Accepted;
use super::candidate::Candidate;
use super::doubt;
use super::doubt::Seen;
use super::evidence;
use super::grown;
use super::said;
use super::something_else;
use crate::diagnosis::Context;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::State;
use crate::diagnosis::sensor;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::machine::BearingIndex;
use crate::units::Hz;
use std::cell::LazyCell;

/// Accuses bearings that no bearing's verdict accuses by what the sets of bands below show, the widest that accuses any; where none does,
/// leaves those open that a line half as deep as accuses speaks against there (C42).
pub(super) fn look(
    verdicts: &mut [ComponentDiagnosis],
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) {
    if features.lower_lines.is_empty() {
        return;
    }
    // Asked only where a line is proven below.
    let foreign = LazyCell::new(|| foreign(features, context, accepted));
    let is_foreign = |bearing, line| foreign.contains(&(bearing, line));
    let mut there = features.clone();
    let mut open: Vec<Option<String>> = vec![None; verdicts.len()];
    for lines in features.lower_lines.iter() {
        there.bearing_lines.clone_from(lines);
        let accepted = accept::accept(&there);
        let mut is_any = false;
        for (bearing, verdict) in verdicts.iter_mut().enumerate() {
            let seen = Seen {
                bearing: BearingIndex(bearing),
                features: &there,
                context,
                accepted: &accepted,
            };
            match shown(&verdict.id, &seen, &features.bearing_lines, is_foreign) {
                Shown::Accused(accused) => {
                    *verdict = *accused;
                    is_any = true;
                }
                Shown::Open(why) => open[bearing] = open[bearing].take().or(Some(why)),
                Shown::Nothing => {}
            }
        }
        if is_any {
            return;
        }
    }
    for (verdict, why) in verdicts.iter_mut().zip(open) {
        if let Some(why) = why.filter(|_| verdict.state == State::Healthy) {
            verdict.leave_open(why);
        }
    }
}

/// Lines that may be something else's, as all of the band tells: what stands beside them there tells whose rate it is. All of a bearing where
/// what leaves it open is of no line that is proven.
fn foreign(
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> Vec<(BearingIndex, DefectLine)> {
    let mut foreign = Vec::new();
    for bearing in (0..context.machine.bearings.len()).map(BearingIndex) {
        let seen = Seen { bearing, features, context, accepted };
        let searches: Vec<&LineSearch> =
            features.bearing_lines.iter().filter(|s| s.bearing == bearing).collect();
        let candidates = candidates(bearing, features, accepted);
        if something_else::of_something_else(&candidates, &searches, &seen).is_some() {
            foreign.extend(DefectLine::ALL.map(|line| (bearing, line)));
            continue;
        }
        let sorted = doubt::sort(&candidates, &seen);
        let of_rate = sorted.doubts.iter().filter(|(d, _)| !grown::is_of_effect_or_place(*d));
        foreign.extend(of_rate.map(|(_, line)| (bearing, line.search.line)));
    }
    foreign
}

/// The lines of a bearing, weighed.
pub(super) fn candidates<'a>(
    bearing: BearingIndex,
    features: &'a WindowFeatures,
    accepted: &[Accepted<'_>],
) -> Vec<Candidate<'a>> {
    let looks = accept::n_looks(features, bearing);
    let own = features.bearing_lines.iter().filter(|s| s.bearing == bearing && s.outcome.is_ok());
    own.map(|s| Candidate::weigh(s, accepted, looks)).collect()
}

/// What one set of bands shows of a bearing.
enum Shown {
    Accused(Box<ComponentDiagnosis>),
    Open(String),
    Nothing,
}

/// What the lines of `seen` show of a bearing; `whole` are those of all of the band.
fn shown(
    id: &str,
    seen: &Seen<'_>,
    whole: &[LineSearch],
    is_foreign: impl Fn(BearingIndex, DefectLine) -> bool,
) -> Shown {
    let Seen { bearing, features, context, accepted } = *seen;
    let candidates: Vec<Candidate<'_>> = candidates(bearing, features, accepted)
        .into_iter()
        .map(|line| {
            let covered = part_covered(line.search, whole);
            line.covering(covered)
        })
        .collect();
    let below = |top: Hz| format!("; read below {:.0} Hz alone", top.0);
    let mut sorted = doubt::sort(&candidates, seen);
    super::leave_unsure(&mut sorted, context);
    sorted.proven.retain(|line| !is_foreign(bearing, line.search.line));
    if let Some((first, others)) = sorted.proven.split_first() {
        let mut verdict =
            ComponentDiagnosis::undetermined(id, ComponentKind::Bearing, String::new());
        verdict.evidence = evidence::evidence(bearing, &candidates, accepted, features, context);
        super::accuse(&mut verdict, first, others, &candidates, features, context);
        verdict.why.push_str(&below(top_of(first.search)));
        let heard: Vec<&LineSearch> = candidates.iter().map(|c| c.search).collect();
        verdict.why.push_str(&sensor::cut_note(features, super::heard_in(&heard), context));
        return Shown::Accused(Box::new(verdict));
    }
    let deep = doubt::half_deep(&candidates, seen);
    deep.map_or(Shown::Nothing, |deep| {
        Shown::Open(said::half_deep(deep, seen) + &below(top_of(deep.search)))
    })
}

/// Part of the channel's usable band that the bands of a line below cover.
fn part_covered(below: &LineSearch, whole: &[LineSearch]) -> f64 {
    let of_channel = whole.iter().filter(|search| search.channel == below.channel);
    let usable = of_channel.map(|search| top_of(search).0).fold(0.0, f64::max);
    if usable > 0.0 { (top_of(below).0 / usable).min(1.0) } else { 1.0 }
}

/// Upper edge of the bands that a line was read in.
fn top_of(search: &LineSearch) -> Hz {
    let readings = search.outcome.as_deref().unwrap_or(&[]);
    Hz(readings.iter().map(|r| r.band.high.0).fold(0.0, f64::max))
}

#[cfg(test)]
#[path = "lower_tests.rs"]
pub(super) mod tests;
