//! A race that turns and is struck: its rate's comb in the acceleration itself leads (docs/theory.md, C36).
//!
//! What tells it from a sound race that a bent shaft loads at one place: what elements impose by passing is smooth, so its
//! harmonics fall. Needs no resonance and no amplitudes that are right, but a sensor pair; and, for a sound bearing may have
//! a comb too, a baseline that it has outgrown or blows that would accuse if the envelope told their rate.

use super::LEAD_POWER_RATIO;
use super::accept::Accepted;
use super::blows;
use super::grown;
use super::grown::GROWN_RATIO;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::comb;
use crate::features::comb::Comb;
use crate::features::impulses::Impulses;
use crate::features::reach;
use crate::machine::BearingIndex;
use crate::machine::bearing::Bearing;
use crate::units::Hz;
use crate::units::Unit;

/// Part of a pair's vibration in the upper harmonics from which a race counts as struck: an effect too small to be felt below
/// it. Sound bearings of the rig beside a shaft bent by 8 mil leave less than half of it at their rate.
const STRUCK_PART: f64 = 0.002;

/// A comb of strikes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Struck<'a> {
    pub(super) comb: &'a Comb,
    proof: Proof,
}

/// What makes a comb one that accuses.
#[derive(Debug, Clone, Copy)]
enum Proof {
    /// So many times the part of the vibration's amplitude that it has in the baseline.
    Growth(f64),
    /// Without a baseline: so much of the energy comes in blows where it is heard.
    Blows(f64),
}

impl Proof {
    /// Severity of what is struck; at most a warning, for its part of the vibration depends on what else shakes.
    fn severity(self) -> f64 {
        severity::not_damaged(match self {
            Self::Growth(ratio) => grown::severity_of(ratio),
            Self::Blows(part) => severity::of_depth(2.0 * part),
        })
    }
}

/// Whether this comb is one of strikes, by itself: it stands over all others near by, holds power, and nothing slower makes it.
fn is_struck(comb: &Comb) -> bool {
    comb.lead >= LEAD_POWER_RATIO && comb.part >= STRUCK_PART && !comb.is_slower
}

/// The bearing's race that is struck, if one is: more than in the baseline, heard best there, and no line accepted elsewhere
/// explains it (C36).
pub(super) fn strongest<'a>(
    bearing: BearingIndex,
    features: &'a WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> Option<Struck<'a>> {
    // A baseline is of one speed.
    if features.speed.is_transient() {
        return None;
    }
    let resolution = Hz(2.0 / (features.time_s.1 - features.time_s.0).max(f64::MIN_POSITIVE));
    let own = features.combs.iter().filter(|c| c.bearing == bearing && is_struck(c));
    own.filter(|c| !accepted.iter().any(|a| is_others(a, c, resolution)))
        .filter(|c| is_loudest(c, features, context))
        .filter_map(|comb| Some(Struck { comb, proof: proof(comb, features, context)? }))
        .max_by(|a, b| a.proof.severity().total_cmp(&b.proof.severity()))
}

/// What makes a comb accuse: its part of the amplitude has outgrown the baseline's, not by chance; without a baseline of it, blows.
fn proof(comb: &Comb, features: &WindowFeatures, context: &Context<'_>) -> Option<Proof> {
    let name = comb::feature_name(comb.line, &context.machine.bearing(comb.bearing).id);
    let channel = context.channel_name(comb.pair.0);
    if let Some(compared) = context.baseline.compare(channel, &name, comb.part.sqrt()) {
        let is_grown = compared.ratio >= GROWN_RATIO
            && confidence::normal_tail(compared.z()) <= context.false_alarm_probability;
        return is_grown.then_some(Proof::Growth(compared.ratio));
    }
    let heard =
        features.impulses.iter().filter(|h| [comb.pair.0, comb.pair.1].contains(&h.channel));
    let most = heard.map(Impulses::agreed).max_by(f64::total_cmp)?;
    (most >= blows::PART).then_some(Proof::Blows(most))
}

/// Whether an accepted line explains the comb: not where it is this line itself, be it nobody's in the envelope.
fn is_others(line: &Accepted<'_>, comb: &Comb, resolution: Hz) -> bool {
    let is_itself = line.is_of(comb.bearing, comb.line)
        || (line.owners.is_empty() && line.is_at(comb.frequency, resolution));
    !is_itself && line.explains(comb.frequency, resolution)
}

/// Whether the comb leads by 6 dB wherever else one can listen, and every other bearing whose turning race may have this rate has
/// a pair to listen with.
fn is_loudest(comb: &Comb, features: &WindowFeatures, context: &Context<'_>) -> bool {
    let machine = context.machine;
    let may_have_rate = |described: &Bearing| {
        let speed = machine.shaft_speed(described.shaft, features.speed.first?)?;
        let line = comb.line;
        let (low, high) = reach::searched_range(
            line,
            line.rate_of(&described.fault_rates(speed)?),
            line.band_of(&described.bands),
        );
        Some((low.0..=high.0).contains(&comb.frequency.0))
    };
    let is_heard = |bearing: usize| features.combs.iter().any(|c| c.bearing.0 == bearing);
    let mut bearings = machine.bearings.iter().enumerate();
    comb.loudness >= LEAD_POWER_RATIO
        && bearings.all(|(i, described)| is_heard(i) || !may_have_rate(described).unwrap_or(false))
}

/// Severity of what is struck.
pub(super) fn severity_of(struck: &Struck<'_>) -> f64 {
    struck.proof.severity()
}

/// What was found, in words.
pub(super) fn sentence(struck: &Struck<'_>, context: &Context<'_>) -> String {
    let comb = struck.comb;
    let proof = match struck.proof {
        Proof::Growth(ratio) => {
            format!("in amplitude {ratio:.0} times as much as in the baseline")
        }
        Proof::Blows(part) => format!("and {:.0} % of the energy comes in blows", 100.0 * part),
    };
    format!(
        "{} {:.1} Hz repeats in the acceleration of {}: the weakest of its harmonics {} to {} hold {:.0} times the power of those of \
         any rate near by, and harmonics {} to {} hold {:.1} % of the vibration, {proof}",
        comb.line.name(),
        comb.frequency.0,
        pair_name(comb, context),
        comb::HARMONICS.start(),
        comb::HARMONICS.end(),
        comb.lead,
        comb::UPPER.start(),
        comb::UPPER.end(),
        100.0 * comb.part,
    )
}

fn pair_name(comb: &Comb, context: &Context<'_>) -> String {
    let (x, y) = comb.pair;
    format!("{} and {}", context.channel_name(x), context.channel_name(y))
}

/// The comb, for the record.
pub(super) fn evidence(comb: &Comb, context: &Context<'_>) -> Evidence {
    let (x, y) = comb.pair;
    Evidence {
        indicator: format!("comb_{}", comb.line.slug()),
        channel: format!("{}+{}", context.channel_name(x), context.channel_name(y)),
        detector: None,
        frequency: Some(comb.frequency),
        expected: Some(comb.expected),
        order: None,
        value: comb.lead,
        unit: Unit::One,
        threshold: Some(LEAD_POWER_RATIO),
        false_alarm_probability: None,
        sample_range: Some(comb.sample_range),
    }
}
