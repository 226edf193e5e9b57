//! Whose a found line is, where one rate satisfies several lines a channel listens for: of one
//! bearing at some geometries, of several bearings on one shaft. Never decided by order.

use crate::diagnosis::confidence;
use crate::features::WindowFeatures;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::Harmonic;
use crate::features::bearing::LineSearch;
use crate::features::reach;
use crate::units::Hz;

/// Part of the bands with a line in which its side bands must stand.
const A_QUARTER: f64 = 0.25;

/// Part of the bands that must show side bands if any of this height over the line's would be seen there: of a load that changes by a tenth
/// up and down.
const HALF: f64 = 0.5;
const FAINT: f64 = 0.1;

/// How far beyond the range in which a line is sought it is not excluded beside another of its bearing, relative: the range is what a search
/// pays for (F5), not the most that elements slip.
const BEYOND: f64 = 0.005;

/// The searches of `search`'s channel that the line found at `frequency` may belong to; one if it can
/// be decided.
///
/// A geometry known well goes before one that leaves more open than slip. Then the side bands
/// decide if those of one kind alone stand: at FTF for rolling elements, unless the rate is nearer to that of their race at rest, at 1× for
/// races. None is ruled out because its own do not stand: noise may hide them. Where faint ones would be seen, their absence tells something, too:
/// [`is_unturned`] (C4, C44).
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
        (true, false) => {
            let elements: Vec<&LineSearch> =
                possible.iter().copied().filter(|s| is_element(s)).collect();
            possible
                .retain(|s| is_element(s) || elements.iter().any(|e| is_carried(s, e, frequency)));
        }
        (false, true) => possible.retain(|s| !is_element(s)),
        (true, true) | (false, false) => {}
    }
    possible
}

/// Whether a line found at `frequency` may be that of the race at rest of the bearing whose rolling elements may have it, in spite of side bands at
/// FTF: elements that differ make these there, too, and it lies nearer to BPFO than to 2·BSF.
fn is_carried(race: &LineSearch, elements: &LineSearch, frequency: Hz) -> bool {
    let off = |s: &LineSearch| (frequency.0 / s.expected.0 - 1.0).abs();
    race.is_at_rest && race.bearing == elements.bearing && off(race) < off(elements)
}

/// Whether `frequency` lies in the searched range, or no further `beyond` it than this part of the rate.
pub(super) fn may_stand_at(search: &LineSearch, frequency: Hz, beyond: f64) -> bool {
    let (low, high) = reach::searched_range(search.line, search.expected, search.band);
    let margin = search.resolution.0 + beyond * search.expected.0;
    (low.0 - margin..=high.0 + margin).contains(&frequency.0)
}

/// Whether side bands at the spacing of `search` stand beside its line found at `frequency`.
pub(super) fn has_side_bands(search: &LineSearch, frequency: Hz) -> bool {
    side_bands(search, frequency) == SideBands::Stand
}

/// Whether it is a line found at `frequency` of the race that turns without side bands at the shaft's speed where faint ones would be seen: a defect
/// there goes through the load once a turn.
pub(super) fn is_unturned(search: &LineSearch, frequency: Hz) -> bool {
    search.is_of_turning_race() && side_bands(search, frequency) == SideBands::Absent
}

/// Whether side bands at the cage's rate, seen from its race, stand beside a race's line found at `frequency`.
pub(super) fn has_cage_bands(search: &LineSearch, frequency: Hz) -> bool {
    bands_beside(search, frequency, |r| r.cage_band) == SideBands::Stand
}

/// What is known of a line's side bands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SideBands {
    Stand,
    /// They do not stand where faint ones would be seen.
    Absent,
    /// They do not, and noise may hide them.
    Unknown,
}

/// What is known of those at the spacing of `search` beside its line found at `frequency`.
fn side_bands(search: &LineSearch, frequency: Hz) -> SideBands {
    bands_beside(search, frequency, |r| r.side_band)
}

/// Tells whether those that `read` gives stand in a quarter of the bands where the line was found at `frequency`, and in half of
/// those in which faint ones would be seen (C4): they are weaker than the line, and lost in the noise of bands that hear it less well; but a load modulates what is
/// struck, and so all bands alike.
fn bands_beside(
    search: &LineSearch,
    frequency: Hz,
    read: fn(&BandReading) -> Option<Harmonic>,
) -> SideBands {
    let readings = search.outcome.as_deref().unwrap_or(&[]);
    let stands = |p: f64| p <= confidence::FALSE_ALARM_PROBABILITY;
    let found = || {
        readings
            .iter()
            .filter(|r| (r.frequency.0 - frequency.0).abs() <= search.resolution.0)
            .filter(|r| stands(confidence::band_probability(r)))
    };
    let would_show_faint = |r: &&BandReading| {
        read(r).zip(r.harmonics[0]).is_some_and(|(side, line)| {
            let power_ratio = FAINT * FAINT * line.power_ratio;
            stands(confidence::harmonic_tail(&Harmonic { power_ratio, ..side }))
        })
    };
    let tail = |r: &BandReading| read(r).map_or(1.0, |side| confidence::harmonic_tail(&side));
    let clear: Vec<f64> = found().filter(would_show_faint).map(tail).collect();
    let all: Vec<f64> = found().map(tail).collect();
    if !clear.is_empty() && !stands(confidence::combine(&clear, HALF)) {
        SideBands::Absent
    } else if stands(confidence::combine(&all, A_QUARTER)) {
        SideBands::Stand
    } else {
        SideBands::Unknown
    }
}

/// The lines of other bearings one of which a race's line may be instead (C44): a race at rest, if this one is unturned ([`is_unturned`]); or
/// rolling elements with side bands at FTF at their own sensor.
pub(super) fn contenders<'a>(
    search: &LineSearch,
    frequency: Hz,
    features: &'a WindowFeatures,
) -> Vec<&'a LineSearch> {
    let is_race = matches!(search.line, DefectLine::Bpfi | DefectLine::Bpfo);
    let is_unturned = is_unturned(search, frequency);
    let elsewhere = features.bearing_lines.iter().filter(|s| s.bearing != search.bearing);
    let is_carried =
        |s: &LineSearch| is_race && s.line == DefectLine::TwoBsf && has_side_bands(s, frequency);
    elsewhere
        .filter(|s| may_stand_at(s, frequency, 0.0))
        .filter(|s| is_unturned && s.is_at_rest || is_carried(s))
        .collect()
}

#[cfg(test)]
pub(super) mod tests;
