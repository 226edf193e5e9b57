//! Whose a found line is, where one rate satisfies several lines a channel listens for: of one
//! bearing at some geometries, of several bearings on one shaft. Never decided by order.

use crate::diagnosis::confidence;
use crate::features::WindowFeatures;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::reach;
use crate::units::Hz;

/// Part of the bands with a line in which its side bands must stand.
const A_QUARTER: f64 = 0.25;

/// How far beyond the range in which a line is sought it is not excluded beside another of its bearing, relative: the range is what a search
/// pays for (F5), not the most that elements slip.
const BEYOND: f64 = 0.005;

/// The searches of `search`'s channel that the line found at `frequency` may belong to; one if it can
/// be decided.
///
/// A geometry known well goes before one that leaves more open than slip. Then the side bands
/// decide if those of one kind alone stand: at FTF for rolling elements, at 1× for races. Their
/// absence proves nothing.
pub(super) fn owners<'a>(
    features: &'a WindowFeatures,
    search: &'a LineSearch,
    frequency: Hz,
) -> Vec<&'a LineSearch> {
    let is_cage = |s: &LineSearch| s.line == DefectLine::Ftf;
    let beyond = |s: &LineSearch| if s.bearing == search.bearing { BEYOND } else { 0.0 };
    let mut possible: Vec<&LineSearch> = features
        .bearing_lines
        .iter()
        .filter(|s| s.channel == search.channel && is_cage(s) == is_cage(search))
        .filter(|s| std::ptr::eq(*s, search) || may_stand_at(s, frequency, beyond(s)))
        .collect();
    if possible.iter().any(|s| !reach::is_wide(s.band)) {
        possible.retain(|s| !reach::is_wide(s.band));
    }
    let is_element = |s: &LineSearch| s.line == DefectLine::TwoBsf;
    let stands = |element: bool| {
        let mut of_kind = possible.iter().filter(|s| is_element(s) == element);
        of_kind.any(|s| has_side_bands(s, frequency))
    };
    match (stands(true), stands(false)) {
        (true, false) => possible.retain(|s| is_element(s)),
        (false, true) => possible.retain(|s| !is_element(s)),
        (true, true) | (false, false) => {}
    }
    possible
}

/// Whether `frequency` lies in the searched range, or no further `beyond` it than this part of the rate.
fn may_stand_at(search: &LineSearch, frequency: Hz, beyond: f64) -> bool {
    let (low, high) = reach::searched_range(search.line, search.expected, search.band);
    let margin = search.resolution.0 + beyond * search.expected.0;
    (low.0 - margin..=high.0 + margin).contains(&frequency.0)
}

/// Whether side bands at the spacing of `search` stand beside its line found at `frequency` in a quarter of the bands where it was
/// found there (C4): they are weaker than the line, and lost in the noise of bands that hear it less well.
pub(super) fn has_side_bands(search: &LineSearch, frequency: Hz) -> bool {
    let readings = search.outcome.as_deref().unwrap_or(&[]);
    let tails: Vec<f64> = readings
        .iter()
        .filter(|r| (r.frequency.0 - frequency.0).abs() <= search.resolution.0)
        .filter(|r| confidence::band_probability(r) <= confidence::FALSE_ALARM_PROBABILITY)
        .map(|r| r.side_band.map_or(1.0, |side| confidence::harmonic_tail(&side)))
        .collect();
    confidence::combine(&tails, A_QUARTER) <= confidence::FALSE_ALARM_PROBABILITY
}

#[cfg(test)]
mod tests;
