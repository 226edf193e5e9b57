//! The numbers behind a bearing's verdict.

use super::accept::Accepted;
use super::blows;
use super::candidate::Candidate;
use super::grown;
use super::struck;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::fault::Detector;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::DefectLine;
use crate::machine::BearingIndex;
use crate::units::Hz;
use crate::units::Unit;

/// One reading of each line, and the absolute-vibration lines that no accepted line explains.
///
/// Of an accepted line it is the reading it was accepted by, of any other the deepest.
pub(super) fn evidence(
    bearing: BearingIndex,
    candidates: &[Candidate<'_>],
    accepted: &[Accepted<'_>],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let mut found = Vec::new();
    for line in DefectLine::ALL {
        let of_line = || candidates.iter().filter(|c| c.search.line == line);
        let is_accepted = |c: &&Candidate<'_>| accepted.iter().any(|a| a.is_by(c.search));
        let rank = |c: &Candidate<'_>| (c.depth(), -c.probability());
        let deepest = || {
            of_line().max_by(|a, b| {
                let (a, b) = (rank(a), rank(b));
                a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
            })
        };
        let shown = of_line().find(is_accepted).or_else(deepest);
        found.extend(shown.map(|c| envelope_evidence(c, context)));
    }
    let resolution = features.bearing_lines.iter().map(|s| s.resolution.0).fold(0.0, f64::max);
    let explained = |l: &AbsoluteLine| {
        let others = accepted.iter().filter(|a| !a.is_of(bearing, l.line));
        others.into_iter().any(|a| a.explains(l.reading.frequency, Hz(resolution)))
    };
    let absolute = features.absolute_lines.iter().filter(|l| l.bearing == bearing && !explained(l));
    let looks = grown::n_looks(bearing, features);
    found.extend(absolute.map(|l| absolute_evidence(l, looks, features, context)));
    let is_heard = |channel| candidates.iter().any(|c| c.search.channel == channel);
    let heard = features.impulses.iter().filter(|heard| is_heard(heard.channel));
    found.extend(heard.map(|heard| blows::evidence(heard, features, context)));
    let combs = features.combs.iter().filter(|c| c.bearing == bearing);
    found.extend(combs.map(|c| struck::evidence(c, features, context)));
    found
}

/// A line in the envelopes, for the record.
pub(super) fn envelope_evidence(candidate: &Candidate<'_>, context: &Context<'_>) -> Evidence {
    let search = candidate.search;
    Evidence {
        indicator: format!("envelope_line_{}", search.line.slug()),
        channel: context.channel_name(search.channel).to_owned(),
        detector: None,
        frequency: candidate.best.as_ref().map(|b| b.frequency),
        expected: Some(search.expected),
        order: candidate.best.as_ref().map(|b| b.frequency.0 / search.shaft_speed.0),
        value: candidate.depth(),
        unit: Unit::One,
        threshold: Some(severity::WARNING_DEPTH),
        false_alarm_probability: Some(candidate.probability()),
        sample_range: Some(search.sample_range),
    }
}

/// A frequency in speeds of the bearing's shaft.
pub(super) fn order(
    frequency: Hz,
    bearing: BearingIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<f64> {
    let shaft = context.machine.bearing(bearing).shaft;
    let speed = context.machine.shaft_speed(shaft, features.speed.first?)?;
    (speed.0 > 0.0).then(|| frequency.0 / speed.0)
}

/// A line in the absolute vibration, for the record; `looks`: among how many of its bearing the strongest is picked.
fn absolute_evidence(
    line: &AbsoluteLine,
    looks: f64,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Evidence {
    let (x, y) = line.pair;
    let tail = line.reading.harmonics[0].map_or(1.0, |h| confidence::harmonic_tail(&h));
    // Power ratio at which a search of this width reaches the declared probability.
    let z = line.reading.harmonics[0]
        .map_or(0.0, |h| confidence::power_ratio_at(&h, context.false_alarm_probability / looks));
    Evidence {
        indicator: format!("absolute_vibration_{}", line.line.slug()),
        channel: format!("{}+{}", context.channel_name(x), context.channel_name(y)),
        detector: Some(Detector::ZeroToPeak),
        frequency: Some(line.reading.frequency),
        expected: Some(line.expected),
        order: order(line.reading.frequency, line.bearing, features, context),
        value: line.amplitude,
        unit: context.channels[x.0].unit,
        threshold: Some(line.floor * z.sqrt()),
        false_alarm_probability: Some((looks * tail).min(1.0)),
        sample_range: Some(line.sample_range),
    }
}
