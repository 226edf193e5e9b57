//! Envelope lines of small effect that have grown over the baseline (docs/theory.md, C38): a warning without a cause.
//!
//! What is significant and small is no damage by itself: sound bearings show such lines. One that was not there when the machine was healthy
//! is news. Which element it is of stays open: balls show the lines of the races that they strike, and outer races those of the
//! inner.

use super::accept;
use super::candidate::Candidate;
use super::doubt;
use super::doubt::Seen;
use super::sentence;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::fault::State;
use crate::diagnosis::level;
use crate::diagnosis::rotation;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::features::bearing;
use crate::features::bearing::DefectLine;
use crate::features::overall;
use crate::machine::BearingIndex;

/// Growth of a depth from which it counts: a depth is of the squared envelope, so that twice the blows (S2) have four times of it.
const GROWN: f64 = level::WARNING_RATIO * level::WARNING_RATIO;

/// Warns of bearings that would be acquitted beside a line that has grown (C38).
pub(super) fn warn(
    verdicts: &mut [ComponentDiagnosis],
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    // A baseline is of one speed.
    if features.speed.is_transient() || context.baseline.records.is_empty() {
        return;
    }
    for (index, verdict) in verdicts.iter_mut().enumerate() {
        if verdict.state != State::Healthy {
            continue;
        }
        let seen = Seen { bearing: BearingIndex(index), features, context, accepted: &[] };
        if let Some(risen) = strongest(&seen) {
            let blows = risen.ratio.sqrt();
            let severity = severity::of_ratio(blows, level::WARNING_RATIO, level::DAMAGED_RATIO);
            verdict.state = State::Warning;
            verdict.severity = Some(severity::not_damaged(severity));
            let speed = 0.5 + 0.5 * features.speed.confidence;
            verdict.confidence = Some(0.7 * speed * (1.0 - risen.probability));
            verdict.why = format!(
                "{}; too small to name a cause, but a quarter of the bands show it {:.1} times as deep as the baseline",
                sentence(&risen.line, context),
                risen.ratio,
            );
        }
    }
}

/// A line that has grown.
struct Risen<'a> {
    line: Candidate<'a>,
    ratio: f64,
    probability: f64,
}

/// The line of a bearing that has grown most: it stands over the noise, nothing else explains it, and neither its shaft moves more than it did
/// nor did what it is read against get less.
fn strongest<'a>(seen: &Seen<'a>) -> Option<Risen<'a>> {
    let (features, context) = (seen.features, seen.context);
    let looks = accept::n_looks(features, seen.bearing);
    let own = features.bearing_lines.iter().filter(|s| s.bearing == seen.bearing);
    let lines = own
        .filter(|s| s.outcome.is_ok() && s.line != DefectLine::Ftf)
        .map(|s| Candidate::weigh(s, seen.accepted, looks))
        .filter(|line| line.least_probability() <= context.false_alarm_probability)
        .filter(|line| !line.is_bare() && !doubt::is_passing(line, seen));
    let risen = lines.filter_map(|line| {
        let (ratio, over_baseline) = growth(&line, features, context)?;
        let probability = line.least_probability().max((looks * over_baseline).min(1.0));
        Some(Risen { line, ratio, probability })
    });
    let is_sure = |risen: &Risen<'_>| {
        risen.ratio >= GROWN && risen.probability <= context.false_alarm_probability
    };
    let shaft = context.machine.bearing(seen.bearing).shaft;
    risen
        .filter(is_sure)
        .max_by(|a, b| a.ratio.total_cmp(&b.ratio))
        .filter(|_| !rotation::is_loaded_otherwise(shaft, features, context))
}

/// How much deeper a line is than in the baseline, and the probability of that by chance. Where the channel is quieter than it was the
/// depth is brought to the old level: the same blows are deeper in less.
fn growth(
    line: &Candidate<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<(f64, f64)> {
    let search = line.search;
    let channel = context.channel_name(search.channel);
    let compare = |name: &str, value: f64| context.baseline.compare(channel, name, value);
    let name = bearing::line_name(search.line, &context.machine.bearing(search.bearing).id);
    let depth = compare(&name, search.usual_depth()?)?;
    let heard = features.channel(search.channel);
    let beside = heard.and_then(|channel| channel.get(overall::RMS_BESIDE_SHAFTS));
    let rest = beside.and_then(|value| compare(overall::RMS_BESIDE_SHAFTS, value));
    let quieter = rest.map_or(1.0, |rest| rest.ratio.min(1.0).powi(2));
    Some((depth.ratio * quieter, confidence::normal_tail(depth.z())))
}
