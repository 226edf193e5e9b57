//! Which of several bearings a line comes from whose rate more than one of them may have: by how much louder it is at one sensor than at the
//! others (docs/theory.md, C45). Must not know how lines are proven.

use super::accept::Accepted;
use super::candidate::Candidate;
use super::owner;
use crate::diagnosis::Context;
use crate::features::WindowFeatures;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::reach;
use crate::machine::BearingIndex;
use crate::units::Hz;

/// Power at another bearing's sensor, over that of the line, from which loudness tells nothing (3 dB): resonances on the way make as much.
pub(super) const AS_LOUD: f64 = 0.5;

/// What noise may hide at another bearing's sensor counts by this part: whatever comes from there is louder there, and by 3 dB at least if
/// loudness is to tell, so that it is what is heard here only if twice as much of it is hidden.
const HIDDEN: f64 = AS_LOUD * AS_LOUD;

/// Depth at another bearing's sensor, over that of the line, below which it is not the line's source: a source is as deep at its own sensor, as
/// long as noise there leaves half of it.
const AS_DEEP: f64 = 0.5;

/// A bearing that may have a line where another's was found, and a sensor of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rival {
    pub(super) bearing: BearingIndex,
    /// Power that its sensors hear there, or a quarter of what noise may hide of it, over that of the line.
    pub(super) power_ratio: f64,
}

impl Rival {
    /// Whether the line may as well come from there.
    pub(super) fn is_as_loud(&self) -> bool {
        self.power_ratio > AS_LOUD
    }
}

/// What is damaged, though not where: each of these bearings may have the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Unplaced {
    /// The bearings it may be of.
    pub bearings: Vec<BearingIndex>,
    /// Severity 0…1 of the line, below what counts as damaged.
    pub severity: f64,
    /// Confidence 0…1 that it is there.
    pub confidence: f64,
    /// The sentence.
    pub why: String,
}

/// The other bearings that may have the line `heard`, found at `frequency`, by what their own sensors hear of it or may hear below their noise,
/// loudest first.
///
/// Held against each other above the lowest band and in all bands, and the larger part counts: high frequencies die out on their way, low ones
/// shake the whole machine, but where most of the power is low the rest tells little.
pub(super) fn rivals(
    features: &WindowFeatures,
    heard: &Candidate<'_>,
    frequency: Hz,
    accepted: &[Accepted<'_>],
) -> Vec<Rival> {
    let own = heard.search;
    let is_cage = |s: &LineSearch| s.line == DefectLine::Ftf;
    let others = features.bearing_lines.iter().filter(|s| {
        s.bearing != own.bearing
            && s.channel != own.channel
            && s.outcome.is_ok()
            && is_cage(s) == is_cage(own)
            && owner::may_stand_at(s, frequency, 0.0)
            && !accepted.iter().any(|a| a.is_of(s.bearing, s.line))
            // What is heard there are the shaft's events, and not what is heard here (C35).
            && !heard.outdoes_events_at(s)
    });
    let rival = |s: &LineSearch| {
        let there = Candidate::weigh_all(s, accepted, 1.0);
        let (here, at) = (&heard.power, &there.power);
        let seen = (at.heard() / here.heard()).max(at.whole() / here.whole());
        let hidden = HIDDEN * at.at_most() / here.heard();
        // A line that comes along with what is louder there is as shallow here (one as deep makes the loudness itself).
        let is_deep = there.depth() >= AS_DEEP * heard.depth();
        let louder = at.louder_than(here);
        let power_ratio = if is_deep { seen.max(hidden) } else { seen.max(hidden) / louder };
        Rival { bearing: s.bearing, power_ratio }
    };
    let mut rivals: Vec<Rival> = others.map(rival).collect();
    rivals.sort_by(|a, b| b.power_ratio.total_cmp(&a.power_ratio));
    rivals
}

/// A bearing that no sensor listens to and whose geometry gives it the rate of this line, too.
pub(super) fn unheard(
    line: &Candidate<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<BearingIndex> {
    let at = line.best.as_ref()?.frequency;
    let is_cage = line.search.line == DefectLine::Ftf;
    let is_heard =
        |bearing| features.bearing_lines.iter().any(|s| s.bearing == bearing && s.outcome.is_ok());
    bearings(context)
        .filter(|b| !is_heard(*b))
        .find(|b| has_rate(*b, at, is_cage, features, context))
}

/// A bearing that no pair of sensors listens to and whose geometry gives it the rate of this line of the absolute vibration, too.
pub(super) fn without_pair(
    line: &AbsoluteLine,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<BearingIndex> {
    let (at, is_cage) = (line.reading.frequency, line.line == DefectLine::Ftf);
    let is_heard = |bearing| features.absolute_lines.iter().any(|l| l.bearing == bearing);
    bearings(context)
        .filter(|b| !is_heard(*b))
        .find(|b| has_rate(*b, at, is_cage, features, context))
}

fn bearings(context: &Context<'_>) -> impl Iterator<Item = BearingIndex> {
    (0..context.machine.bearings.len()).map(BearingIndex)
}

/// Whether a line of this bearing, the cage's or another, may be at this rate by its geometry and slip.
fn has_rate(
    bearing: BearingIndex,
    at: Hz,
    is_cage: bool,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let described = context.machine.bearing(bearing);
    let ratio = context.machine.shafts[described.shaft.0].ratio_to_first;
    let speed = features.speed.first.zip(ratio).map(|(first, ratio)| Hz(first.0 * ratio));
    let rates = speed.and_then(|speed| described.fault_rates(speed));
    rates.is_some_and(|rates| {
        let bands = described.bands;
        let lines = [
            (DefectLine::Ftf, rates.ftf, bands.ftf),
            (DefectLine::Bpfi, rates.bpfi, bands.bpfi),
            (DefectLine::Bpfo, rates.bpfo, bands.bpfo),
            (DefectLine::TwoBsf, rates.two_bsf(), bands.two_bsf),
        ];
        let mut of_kind =
            lines.into_iter().filter(|(line, ..)| (*line == DefectLine::Ftf) == is_cage);
        of_kind.any(|(line, expected, band)| {
            let (low, high) = reach::searched_range(line, expected, band);
            (low.0..=high.0).contains(&at.0)
        })
    })
}

#[cfg(test)]
#[path = "place_tests.rs"]
mod tests;
