//! Lines as deep as accuses that something else explains, or may: nobody's, and no sign of health either (docs/theory.md, C9, C47).

use super::accept;
use super::accept::Accepted;
use super::candidate;
use super::candidate::Candidate;
use super::doubt;
use super::doubt::Seen;
use super::sentence;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;

/// A line that would accuse, or be left open for being deep in few bands, were it not heard best where the shaft's events explain it: nobody's,
/// and no sign of health either.
pub(super) fn nobodys(searches: &[&LineSearch], seen: &Seen<'_>) -> Option<String> {
    let looks = accept::n_looks(seen.features, seen.bearing);
    let readable = searches.iter().filter(|s| s.outcome.is_ok());
    let is_nobodys = |line: &Candidate<'_>| {
        let mut without_owner = seen.accepted.iter().filter(|a| a.owners.is_empty());
        let frequency = line.best.as_ref().map(|best| best.frequency);
        frequency.is_some_and(|f| without_owner.any(|a| a.is_at(f, line.search.resolution)))
    };
    let proven = readable.map(|s| Candidate::weigh(s, &[], looks)).filter(Candidate::is_proven);
    // Accepted, it would explain itself.
    let weigh = |s| Candidate::weigh(s, &[], 1.0);
    let is_smooth = |line: &Candidate<'_>| {
        !line.is_of_struck_element() && candidate::is_smooth(&doubt::everywhere(line, seen, weigh))
    };
    let would_accuse = |line: &Candidate<'_>| {
        line.is_surely_deep()
            && !line.is_bare()
            && !line.is_carried()
            && !is_turned(line)
            && !is_smooth(line)
            && !doubt::has_not_grown(line, seen)
    };
    let line = proven
        .filter(is_nobodys)
        .filter(would_accuse)
        .max_by(|a, b| a.depth().total_cmp(&b.depth()))?;
    Some(format!(
        "{}; it is heard best where events of the shaft that passing elements modulate would explain it: neither \
         accused nor acquitted",
        sentence(&line, seen.context)
    ))
}

/// Whether it is a line of the race at rest with side bands at 1×: a defect there meets the same load on each turn, and
/// what turns is the shaft's.
fn is_turned(line: &Candidate<'_>) -> bool {
    !line.search.is_of_turning_race()
        && line.search.line != DefectLine::TwoBsf
        && line.has_side_band()
}

/// A line of the race at rest, or of elements, that would accuse but for side bands at the shaft's speed more than half as high: a defect under
/// a load that turns with the shaft has such, and so have events of the shaft that elements modulate as they pass (F12).
pub(super) fn of_turning_load(searches: &[&LineSearch], seen: &Seen<'_>) -> Option<String> {
    // What strikes elsewhere, or what nobody owns, may be what elements modulate.
    let is_own = |a: &Accepted<'_>| {
        !a.owners.is_empty() && a.owners.iter().all(|s| s.bearing == seen.bearing)
    };
    if !seen.accepted.iter().all(is_own) {
        return None;
    }
    let looks = accept::n_looks(seen.features, seen.bearing);
    let readable = searches.iter().filter(|s| s.outcome.is_ok() && s.line != DefectLine::Ftf);
    let lines = readable.map(|s| Candidate::weigh_turned(s, seen.accepted, looks));
    let would_accuse = |line: &Candidate<'_>| {
        let is_turned = line.best.as_ref().is_some_and(|best| best.is_of_turning_load());
        is_turned
            && line.is_proven()
            && line.is_surely_deep()
            && line.is_agreed()
            && !line.is_bare()
            // A load is never negative: its side bands are no higher than the line (F28).
            && line.side_band_of.is_none()
            && !doubt::has_not_grown(line, seen)
    };
    let line = lines.filter(would_accuse).max_by(|a, b| a.depth().total_cmp(&b.depth()))?;
    Some(format!(
        "{}; its side bands at the shaft's speed are more than half as high as it: a load that turns with the shaft makes such beside a \
         defect, and elements that modulate the shaft's events as they pass make them without one: neither accused nor acquitted",
        sentence(&line, seen.context)
    ))
}

/// A cage's line that holds half of a band's energy, and that is not accepted because lines of the races stand beside it that something
/// explains: not the cage's, perhaps, but strikes as it turns.
pub(super) fn of_the_cage(candidates: &[Candidate<'_>], seen: &Seen<'_>) -> Option<String> {
    let line = candidates.iter().find(|line| {
        line.search.line == DefectLine::Ftf
            && line.is_proven()
            && line.is_surely_deep()
            && line.is_agreed()
            && !line.is_carried()
            && !seen.accepted.iter().any(|a| a.is_of(seen.bearing, DefectLine::Ftf))
    })?;
    Some(format!(
        "{}; beside it stand lines of the bearing that something else explains, and elements that the cage carries strike so, too: neither \
         accused nor acquitted",
        sentence(line, seen.context)
    ))
}
