//! The numbers behind a bearing's verdict.

use super::accept::Candidate;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::fault::Detector;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::DefectLine;
use crate::machine::BearingIndex;
use crate::units::Unit;

/// The best reading of each line, and the absolute-vibration lines.
pub(super) fn evidence(
    bearing: BearingIndex,
    candidates: &[Candidate<'_>],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let mut found = Vec::new();
    for line in DefectLine::ALL {
        let of_line = candidates.iter().filter(|c| c.search.line == line);
        if let Some(best) = of_line.max_by(|a, b| {
            (a.depth(), -a.probability)
                .partial_cmp(&(b.depth(), -b.probability))
                .unwrap_or(std::cmp::Ordering::Equal)
        }) {
            found.push(envelope_evidence(best, context));
        }
    }
    let absolute = features.absolute_lines.iter().filter(|l| l.bearing == bearing);
    found.extend(absolute.map(|l| absolute_evidence(l, context)));
    found
}

fn envelope_evidence(candidate: &Candidate<'_>, context: &Context<'_>) -> Evidence {
    let search = candidate.search;
    Evidence {
        indicator: format!("envelope_line_{}", search.line.slug()),
        channel: context.channel_name(search.channel).to_owned(),
        detector: None,
        frequency: candidate.best.map(|b| b.frequency),
        expected: Some(search.expected),
        order: candidate.best.map(|b| b.frequency.0 / search.shaft_speed.0),
        value: candidate.depth(),
        unit: Unit::One,
        threshold: Some(severity::WARNING_DEPTH),
        false_alarm_probability: Some(candidate.probability),
        sample_range: Some(search.sample_range),
    }
}

fn absolute_evidence(line: &AbsoluteLine, context: &Context<'_>) -> Evidence {
    let (x, y) = line.pair;
    let tail = line.reading.harmonics[0].map_or(1.0, |h| confidence::harmonic_tail(&h));
    // Power ratio at which one search of this width reaches the declared probability.
    let z = line.reading.harmonics[0].map_or(0.0, |h| {
        let per_cell = confidence::FALSE_ALARM_PROBABILITY / h.n_cells;
        h.floor_dof * (per_cell.powf(-1.0 / h.floor_dof) - 1.0)
    });
    Evidence {
        indicator: format!("absolute_vibration_{}", line.line.slug()),
        channel: format!("{}+{}", context.channel_name(x), context.channel_name(y)),
        detector: Some(Detector::ZeroToPeak),
        frequency: Some(line.reading.frequency),
        expected: Some(line.expected),
        order: None,
        value: line.amplitude,
        unit: context.channels[x.0].unit,
        threshold: Some(line.floor * z.sqrt()),
        false_alarm_probability: Some(tail),
        sample_range: Some(line.sample_range),
    }
}
