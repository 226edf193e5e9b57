//! The source's bearing signature: a line in the absolute vibration that has grown over the baseline.
//!
//! Used where the envelope bands accuse nobody: the absolute vibration also hears defects whose
//! impacts excite no resonance. It needs a baseline, for a healthy bearing may show such a line too.

use super::accept::Accepted;
use super::doubt::Doubt;
use super::doubt::Seen;
use super::doubt::Sorted;
use super::place;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::rotation;
use crate::diagnosis::severity;
use crate::features::WindowFeatures;
use crate::features::absolute;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::DefectLine;
use crate::features::overall;
use crate::machine::BearingIndex;

/// Growth of the line's amplitude over the baseline that proves a defect: at least 180 was seen of a
/// damaged bearing, and 5 is what other damage of the machine stays below.
pub(super) const GROWN_RATIO: f64 = 5.0;

/// Growth that counts as damaged: ten times that.
const DAMAGED_RATIO: f64 = 50.0;

/// A line that has grown.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grown<'a> {
    pub(super) line: &'a AbsoluteLine,
    pub(super) ratio: f64,
    pub(super) probability: f64,
}

impl Grown<'_> {
    /// What was found, in words.
    pub(super) fn sentence(&self, context: &Context<'_>) -> String {
        let (x, y) = self.line.pair;
        format!(
            "{} {:.1} Hz in the absolute vibration of {} and {} is {:.1} times its baseline",
            self.line.line.name(),
            self.line.reading.frequency.0,
            context.channel_name(x),
            context.channel_name(y),
            self.ratio,
        )
    }

    /// Severity of the growth.
    pub(super) fn severity(&self) -> f64 {
        severity_of(self.ratio)
    }
}

/// What has grown at a bearing.
#[derive(Debug, Clone, Copy)]
pub(super) enum Growth<'a> {
    /// A line that nothing else explains.
    Proven(Grown<'a>),
    /// A line beside one that has grown as well: a stronger one, or one at the same rate at another bearing that is about as strong.
    Beside(Grown<'a>, &'a AbsoluteLine),
    /// A line whose rate a bearing may have that no pair listens to.
    Unheard(Grown<'a>, BearingIndex),
    /// A line under a shaft that moves more than it did: its bow or unbalance turns and loads all elements more, which pass sound races
    /// at the same rates.
    Carried(Grown<'a>),
}

/// Lines of a bearing in the absolute vibration that may have grown: not those of its cage, which strikes nothing.
fn own(bearing: BearingIndex, features: &WindowFeatures) -> impl Iterator<Item = &AbsoluteLine> {
    let lines = features.absolute_lines.iter().filter(|l| is_searched(l));
    lines.filter(move |l| l.bearing == bearing && !l.reading.is_explained())
}

fn is_searched(line: &AbsoluteLine) -> bool {
    line.line != DefectLine::Ftf
}

/// Among how many lines of a bearing the strongest is picked.
pub(super) fn n_looks(bearing: BearingIndex, features: &WindowFeatures) -> f64 {
    own(bearing, features).count().max(1) as f64
}

/// The strongest line of `seen.bearing` that has grown: it stands over the noise *and* over the baseline,
/// and neither a line accepted elsewhere nor the shaft's events explain it. Beside a stronger one it proves
/// nothing: what strikes hard in one place moves all lines of the machine. `sorted`: what the envelopes say of the bearing.
pub(super) fn strongest<'a>(seen: &Seen<'a>, sorted: &Sorted<'_>) -> Option<Growth<'a>> {
    let Seen { bearing, features, context, .. } = *seen;
    // A baseline is of one speed.
    if features.speed.is_transient() {
        return None;
    }
    let looks = n_looks(bearing, features);
    let grown = own(bearing, features).filter_map(|line| {
        let (ratio, over_baseline) = growth(line, features, context)?;
        let over_noise = confidence::harmonic_tail(&line.reading.harmonics[0]?);
        // Both must hold, so the larger probability counts.
        let probability = (looks * over_noise.max(over_baseline)).min(1.0);
        Some(Grown { line, ratio, probability })
    });
    let grown = grown
        .filter(|g| g.probability <= context.false_alarm_probability)
        .filter(|g| !is_anothers(g.line, seen, sorted))
        .max_by(|a, b| a.line.amplitude.total_cmp(&b.line.amplitude))?;
    let beside = features
        .absolute_lines
        .iter()
        .filter(|l| is_searched(l))
        .find(|other| is_rival(other, grown.line, seen));
    let shaft = context.machine.bearing(bearing).shaft;
    Some(match (beside, place::without_pair(grown.line, features, context)) {
        (Some(other), _) => Growth::Beside(grown, other),
        (None, Some(unheard)) => Growth::Unheard(grown, unheard),
        (None, None) if rotation::is_moved(shaft, features, context) => Growth::Carried(grown),
        (None, None) => Growth::Proven(grown),
    })
}

/// Whether a line accepted in the envelopes explains this one, unless it is this very line and all that keeps it from accusing is what
/// growth tells: how much of it there is, and where it is strongest.
fn is_anothers(line: &AbsoluteLine, seen: &Seen<'_>, sorted: &Sorted<'_>) -> bool {
    let (at, resolution) = (line.reading.frequency, seen.features.resolution());
    let mut doubts = sorted.doubts.iter().filter(|(_, c)| c.search.line == line.line);
    let is_told_by_growth = doubts.all(|(doubt, _)| is_of_effect_or_place(*doubt));
    let is_own = |a: &Accepted<'_>| {
        let is_of = a.owners.is_empty() || a.is_of(line.bearing, line.line);
        is_told_by_growth && is_of && a.is_at(at, resolution)
    };
    seen.accepted.iter().any(|a| a.explains(at, resolution) && !is_own(a))
}

/// Whether a doubt about a line in the envelopes is one of effect or of place, not of whose rate it is: that neither growth tells nor other bands.
pub(super) fn is_of_effect_or_place(doubt: Doubt) -> bool {
    match doubt {
        Doubt::Unplaced | Doubt::InQuiet | Doubt::Smooth | Doubt::OfTone | Doubt::NearLimit => true,
        Doubt::Bare
        | Doubt::Unturned
        | Doubt::Carried
        | Doubt::Lone
        | Doubt::OfElements
        | Doubt::SideLine
        | Doubt::Contested
        | Doubt::NearMultiple
        | Doubt::OfMains
        | Doubt::OfEvents
        | Doubt::Overheard
        | Doubt::NotGrown => false,
    }
}

/// Whether `other` leaves open what has grown: stronger than `line`, or at its rate at another bearing and no less than 3 dB weaker (C45).
fn is_rival(other: &AbsoluteLine, line: &AbsoluteLine, seen: &Seen<'_>) -> bool {
    let (a, b) = (other.reading.frequency, line.reading.frequency);
    let is_at_its_rate =
        other.bearing != line.bearing && (a.0 - b.0).abs() <= seen.features.resolution().0;
    let limit = if is_at_its_rate { place::AS_LOUD.sqrt() } else { 1.0 };
    other.amplitude > limit * line.amplitude && growth(other, seen.features, seen.context).is_some()
}

/// How far this line of the bearing has grown in the absolute vibration, in the pair where it has most; `None` without
/// a baseline of it, or too little to count.
pub(super) fn ratio(
    bearing: BearingIndex,
    line: DefectLine,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<f64> {
    // A baseline is of one speed.
    if features.speed.is_transient() {
        return None;
    }
    let own = features.absolute_lines.iter().filter(|l| (l.bearing, l.line) == (bearing, line));
    own.filter_map(|l| growth(l, features, context)).map(|(ratio, _)| ratio).max_by(f64::total_cmp)
}

/// Severity of a growth.
pub(super) fn severity_of(ratio: f64) -> f64 {
    severity::of_ratio(ratio, GROWN_RATIO, DAMAGED_RATIO)
}

/// Ratio of a line's amplitude to its baseline, and the probability of that by chance; `None` if it is too small to
/// count.
fn growth(
    line: &AbsoluteLine,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<(f64, f64)> {
    let channel = context.channel_name(line.pair.0);
    let name = absolute::line_name(line.line, &context.machine.bearing(line.bearing).id);
    let compared = context.baseline.compare(channel, &name, line.amplitude)?;
    let is_grown = compared.ratio >= GROWN_RATIO * rest_ratio(line, features, context);
    is_grown.then(|| (compared.ratio, confidence::normal_tail(compared.z())))
}

/// How much everything but the shafts' lines has risen in the pair's first channel, at least 1: a machine
/// that shakes altogether raises every line.
fn rest_ratio(line: &AbsoluteLine, features: &WindowFeatures, context: &Context<'_>) -> f64 {
    let channel = context.channel_name(line.pair.0);
    let value = features.channel(line.pair.0).and_then(|c| c.get(overall::RMS_BESIDE_SHAFTS));
    let compared = value
        .and_then(|value| context.baseline.compare(channel, overall::RMS_BESIDE_SHAFTS, value));
    compared.map_or(1.0, |c| c.ratio.max(1.0))
}

/// Whether the healthy machine showed this line of the bearing in the absolute vibration too, and it
/// has not grown since (C9).
pub(super) fn is_as_when_healthy(
    bearing: BearingIndex,
    line: DefectLine,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let of_line = |l: &&AbsoluteLine| l.bearing == bearing && l.line == line;
    let ratios: Vec<f64> = features
        .absolute_lines
        .iter()
        .filter(of_line)
        .filter_map(|l| {
            let name = absolute::line_name(l.line, &context.machine.bearing(bearing).id);
            let channel = context.channel_name(l.pair.0);
            context.baseline.compare(channel, &name, l.amplitude).map(|compared| compared.ratio)
        })
        .collect();
    !ratios.is_empty() && ratios.iter().all(|ratio| *ratio < GROWN_RATIO)
}
