//! What may be something else's than a defect's of the bearing it is read at, or hide one: what the shaft, a load or another bearing makes, and weak
//! lines of several elements (docs/theory.md, C9, C39, C44, C45, C47).
//!
//! Must not know of lines that are proven and doubted: those are `doubt`'s.

use super::accept;
use super::accept::Accepted;
use super::candidate::Candidate;
use super::doubt::Seen;
use super::looked;
use super::nobodys;
use super::owner;
use super::said;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;

/// Lines of several elements in at least this part of the bands, of too little effect to accuse, are
/// more than chance and less than a verdict: structural lines fill one of four bands at most.
const AMBIGUOUS_PART: f64 = 0.25 + 1e-9;

/// Such lines must at least be this deep.
const AMBIGUOUS_DEPTH: f64 = 0.15;

/// Why what stands may be something else's than a defect's of this bearing, or hide one, though no line of it that is proven does.
pub(super) fn of_something_else(
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    seen: &Seen<'_>,
) -> Option<String> {
    let of_several = || {
        let looks = accept::n_looks(seen.features, seen.bearing);
        let readable = searches.iter().filter(|s| s.outcome.is_ok());
        // What may be the shaft's proves nothing: neither damage nor health.
        let lines: Vec<Candidate<'_>> =
            readable.map(|s| Candidate::weigh_all(s, seen.accepted, looks)).collect();
        ambiguous(&lines)
    };
    nobodys::nobodys(searches, seen)
        .or_else(|| of_load_or_cage(candidates, searches, seen))
        .or_else(of_several)
        .or_else(|| hidden_or_lent(searches, seen))
        .or_else(|| as_loud_here(seen))
}

/// The same but for what the shaft's events may make, side lines and those of several elements, and for what leaves open at which of equal bearings a line is.
pub(super) fn of_another(
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    seen: &Seen<'_>,
) -> Option<String> {
    of_load_or_cage(candidates, searches, seen).or_else(|| hidden_or_lent(searches, seen))
}

fn of_load_or_cage(
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    seen: &Seen<'_>,
) -> Option<String> {
    nobodys::of_turning_load(searches, seen).or_else(|| nobodys::of_the_cage(candidates, seen))
}

fn hidden_or_lent(searches: &[&LineSearch], seen: &Seen<'_>) -> Option<String> {
    looked::hidden(searches, seen).or_else(|| lent(seen))
}

/// A line that is heard at another bearing and may be this one's, as loud as it is here (C45).
fn as_loud_here(seen: &Seen<'_>) -> Option<String> {
    let is_here = |a: &&Accepted<'_>| {
        a.rivals.iter().any(|rival| rival.bearing == seen.bearing && rival.is_as_loud())
    };
    let line = seen.accepted.iter().find(is_here)?;
    let heard = line.owners.first()?;
    Some(said::as_loud(line.frequency, heard, seen.context))
}

/// A line that is heard as another bearing's race, and may be this one's (C44).
fn lent(seen: &Seen<'_>) -> Option<String> {
    let of_others = seen.accepted.iter().flat_map(|a| a.owners.iter().map(move |s| (a, s)));
    let mut doubtful = of_others.flat_map(|(a, s)| {
        let contenders = owner::contenders(s, a.frequency, seen.features);
        contenders.into_iter().map(move |own| (a, s, own))
    });
    let (line, heard, own) = doubtful.find(|(_, _, own)| own.bearing == seen.bearing)?;
    Some(said::lent(line.frequency, heard, own, seen.context))
}

/// Whether it is there in more than a quarter of the bands, whatever its effect.
pub(super) fn is_notable(line: &Candidate<'_>) -> bool {
    line.depth() >= AMBIGUOUS_DEPTH && line.noted_part() >= AMBIGUOUS_PART
}

/// Lines of two elements in one channel, each in more than a quarter of the bands, none of effect (C9).
fn ambiguous(candidates: &[Candidate<'_>]) -> Option<String> {
    let found: Vec<&Candidate<'_>> = candidates.iter().filter(|c| is_notable(c)).collect();
    let channel = found.iter().map(|c| c.search.channel).find(|channel| {
        found
            .iter()
            .filter(|c| c.search.channel == *channel && c.search.line != DefectLine::Ftf)
            .count()
            > 1
    })?;
    let names: Vec<&str> = found
        .iter()
        .filter(|c| c.search.channel == channel)
        .map(|c| c.search.line.name())
        .collect();
    Some(format!(
        "weak lines of several elements ({}): more than chance, too little effect to name a cause",
        names.join(", ")
    ))
}
