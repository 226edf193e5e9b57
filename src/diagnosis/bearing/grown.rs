//! The source's bearing signature: a line in the absolute vibration that has grown over the baseline.
//!
//! Used where the envelope bands prove nothing: the absolute vibration also hears defects whose
//! impacts excite no resonance. It needs a baseline, for a healthy bearing may show such a line too.

use super::accept::Accepted;
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
use crate::units::Hz;

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
    /// A line beside a stronger one that has grown as well: of another element, or at another bearing.
    Beside(Grown<'a>, &'a AbsoluteLine),
    /// A line under a shaft that moves more than it did: its bow or unbalance turns and loads all elements more, which pass sound races
    /// at the same rates.
    Carried(Grown<'a>),
}

/// The strongest line of `bearing` that has grown: it stands over the noise *and* over the baseline,
/// and neither a line accepted elsewhere nor the shaft's events explain it. Beside a stronger one it proves
/// nothing: what strikes hard in one place moves all lines of the machine.
pub(super) fn strongest<'a>(
    bearing: BearingIndex,
    features: &'a WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> Option<Growth<'a>> {
    // A baseline is of one speed.
    if features.speed.is_transient() {
        return None;
    }
    let is_searched = |l: &&AbsoluteLine| l.line != DefectLine::Ftf;
    let own: Vec<&AbsoluteLine> = features
        .absolute_lines
        .iter()
        .filter(is_searched)
        .filter(|l| l.bearing == bearing && !l.reading.is_explained())
        .collect();
    let looks = own.len() as f64;
    let grown = own.into_iter().filter_map(|line| {
        let (ratio, over_baseline) = growth(line, features, context)?;
        let over_noise = confidence::harmonic_tail(&line.reading.harmonics[0]?);
        // Both must hold, so the larger probability counts.
        let probability = (looks * over_noise.max(over_baseline)).min(1.0);
        Some(Grown { line, ratio, probability })
    });
    let resolution = Hz(2.0 / (features.time_s.1 - features.time_s.0).max(f64::MIN_POSITIVE));
    let grown = grown
        .filter(|g| g.probability <= context.false_alarm_probability)
        .filter(|g| !accepted.iter().any(|a| a.explains(g.line.reading.frequency, resolution)))
        .max_by(|a, b| a.line.amplitude.total_cmp(&b.line.amplitude))?;
    let stronger = features
        .absolute_lines
        .iter()
        .filter(is_searched)
        .filter(|l| l.amplitude > grown.line.amplitude)
        .find(|l| growth(l, features, context).is_some());
    let shaft = context.machine.bearing(bearing).shaft;
    Some(match stronger {
        Some(other) => Growth::Beside(grown, other),
        None if rotation::is_moved(shaft, features, context) => Growth::Carried(grown),
        None => Growth::Proven(grown),
    })
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
