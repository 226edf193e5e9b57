//! Envelope lines of small effect that have grown over the baseline (docs/theory.md, C38): a warning without a cause.
//!
//! What is significant and small is no damage by itself: sound bearings show such lines. One that was not there when the machine was healthy
//! is news. Which element it is of stays open: balls show the lines of the races that they strike, and outer races those of the
//! inner.

use super::accept;
use super::accept::Accepted;
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
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::bearing;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::overall;
use crate::units::Unit;

/// Growth of a depth from which it counts: a depth is of the squared envelope, so that twice the blows (S2) have four times of it.
pub(super) const GROWN: f64 = level::WARNING_RATIO * level::WARNING_RATIO;

/// A line that has grown.
#[derive(Debug)]
pub(super) struct Risen<'a> {
    line: Candidate<'a>,
    ratio: f64,
    probability: f64,
}

impl Risen<'_> {
    /// Fills in a warning without a cause (C38).
    pub(super) fn warn(&self, verdict: &mut ComponentDiagnosis, seen: &Seen<'_>) {
        let blows = self.ratio.sqrt();
        let severity = severity::of_ratio(blows, level::WARNING_RATIO, level::DAMAGED_RATIO);
        verdict.state = State::Warning;
        verdict.severity = Some(severity::not_damaged(severity));
        let speed = 0.5 + 0.5 * seen.features.speed.confidence;
        verdict.confidence = Some(0.7 * speed * (1.0 - self.probability));
        verdict.why = format!(
            "{}; too little to name a cause, but a quarter of the bands show it {:.1} times as deep as the baseline",
            sentence(&self.line, seen.context),
            self.ratio,
        );
        verdict.evidence.push(self.evidence(seen.context));
    }

    /// The growth, for the record.
    fn evidence(&self, context: &Context<'_>) -> Evidence {
        let search = self.line.search;
        Evidence {
            indicator: format!("envelope_growth_{}", search.line.slug()),
            channel: context.channel_name(search.channel).to_owned(),
            detector: None,
            frequency: self.line.best.as_ref().map(|best| best.frequency),
            expected: Some(search.expected),
            order: self.line.best.as_ref().map(|best| best.frequency.0 / search.shaft_speed.0),
            value: self.ratio,
            unit: Unit::One,
            threshold: Some(GROWN),
            false_alarm_probability: Some(self.probability),
            sample_range: Some(search.sample_range),
        }
    }
}

/// The line of a bearing that has grown most: it stands over the noise, nothing else explains it, and neither its shaft moves more than it did
/// nor did what it is read against get less.
pub(super) fn strongest<'a>(seen: &Seen<'a>) -> Option<Risen<'a>> {
    let (features, context) = (seen.features, seen.context);
    // What strikes elsewhere, or what nobody owns, may be what is heard; and a baseline is of one speed.
    let is_own = |s: &LineSearch| s.bearing == seen.bearing;
    let is_others = |a: &Accepted<'_>| a.owners.is_empty() || !a.owners.iter().all(|s| is_own(s));
    if features.speed.is_transient() || seen.accepted.iter().any(is_others) {
        return None;
    }
    let looks = accept::n_looks(features, seen.bearing);
    let own = features.bearing_lines.iter().filter(|s| is_own(s));
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

/// Whether a line is so much deeper than in the baseline as to be news.
pub(super) fn is_news(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    ratio(line, seen).is_some_and(|ratio| ratio >= GROWN)
}

/// Whether a baseline has a line about as deep: it is no news.
pub(super) fn is_known(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    ratio(line, seen).is_some_and(|ratio| ratio < GROWN)
}

/// How many times as deep as in the baseline a line is; `None` without one of it.
pub(super) fn ratio(line: &Candidate<'_>, seen: &Seen<'_>) -> Option<f64> {
    growth(line, seen.features, seen.context).map(|(ratio, _)| ratio)
}

/// How much deeper a line is than in the baseline, and the probability of that by chance. Where the channel is quieter than it was the
/// depth is brought to the old level: the same blows are deeper in less.
fn growth(
    line: &Candidate<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<(f64, f64)> {
    let search = line.search;
    // A channel that is cut has none: rates can be read there, depths cannot.
    let heard = features.channel(search.channel)?;
    let channel = context.channel_name(search.channel);
    let compare = |name: &str, value: f64| context.baseline.compare(channel, name, value);
    let name = bearing::line_name(search.line, &context.machine.bearing(search.bearing).id);
    let depth = compare(&name, search.usual_depth()?)?;
    let beside = heard.get(overall::RMS_BESIDE_SHAFTS);
    let rest = beside.and_then(|value| compare(overall::RMS_BESIDE_SHAFTS, value));
    let ratio = at_the_old_level(depth.ratio, rest.map(|rest| rest.ratio));
    Some((ratio, confidence::normal_tail(depth.z())))
}

/// The ratio of depths that there would be in a channel as loud as it was; `rest`: how loud it is now beside the shafts' lines.
fn at_the_old_level(ratio: f64, rest: Option<f64>) -> f64 {
    ratio * rest.map_or(1.0, |rest| rest.min(1.0).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quieter_channel_makes_no_news() {
        // The same blows in noise of half the RMS are four times as deep.
        assert!((at_the_old_level(4.0, Some(0.5)) - 1.0).abs() < 1e-15);
        assert!((at_the_old_level(4.0, Some(2.0)) - 4.0).abs() < 1e-15, "louder: no excuse");
        assert!((at_the_old_level(4.0, None) - 4.0).abs() < 1e-15);
    }
}
