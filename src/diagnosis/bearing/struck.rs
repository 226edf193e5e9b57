//! A race that turns and is struck: its rate's comb in the acceleration itself leads (docs/theory.md, C36).
//!
//! What tells it from a sound race that a bent shaft loads at one place: what elements impose by passing is smooth, so its
//! harmonics fall. Needs no resonance and no amplitudes that are right, but a sensor pair; and, for a sound bearing may have
//! a comb too, a baseline that it has outgrown or blows that keep its rate as well.

use super::LEAD_POWER_RATIO;
use super::accept::Accepted;
use super::blows;
use super::candidate;
use super::evidence::order;
use super::grown;
use super::grown::GROWN_RATIO;
use super::mains;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::level;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::bearing::LineSearch;
use crate::features::comb;
use crate::features::comb::Comb;
use crate::features::impulses::Blows;
use crate::features::impulses::Impulses;
use crate::features::reach;
use crate::machine::BearingIndex;
use crate::machine::bearing::Bearing;
use crate::signal::ChannelIndex;
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
struct Proof {
    /// How many times the part of the vibration's amplitude that it has in the baseline, if that knows it.
    growth: Option<f64>,
    /// How much of the energy at most comes in blows at the comb's rate where it is heard.
    blows: f64,
}

impl Proof {
    /// Whether blows hold as much as accuses of lines.
    fn has_blows(self) -> bool {
        self.blows >= blows::PART
    }

    /// Severity of what is struck; at most a warning, for its part of the vibration depends on what else shakes.
    fn severity(self) -> f64 {
        let of_growth = self.growth.map_or(0.0, grown::severity_of);
        let of_blows = if self.has_blows() { severity::of_depth(2.0 * self.blows) } else { 0.0 };
        severity::not_damaged(of_growth.max(of_blows))
    }

    /// What is said of it.
    fn sentence(self) -> String {
        let growth = self
            .growth
            .map(|ratio| format!(", in amplitude {ratio:.1} times as much as in the baseline"));
        let blows = format!(
            ", and up to {:.0} % of the energy comes in blows at that rate",
            100.0 * self.blows
        );
        growth.unwrap_or_default() + if self.has_blows() { &blows } else { "" }
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
    let resolution = features.resolution();
    let own = features.combs.iter().filter(|c| c.bearing == bearing && is_struck(c));
    own.filter(|c| mains::multiple(context.machine, c.frequency, resolution).is_none())
        .filter(|c| !may_be_of_coupling(c, features, context))
        .filter(|c| !accepted.iter().any(|a| is_others(a, c, resolution)))
        .filter(|c| is_loudest(c, features, context))
        .filter_map(|comb| {
            Some(Struck { comb, proof: proof(comb, features, context, resolution)? })
        })
        .max_by(|a, b| a.proof.severity().total_cmp(&b.proof.severity()))
}

/// How near, relative, a whole multiple of a speed that nothing confirms may be the shaft's: such speeds are read off and rounded.
const UNSURE: f64 = 0.01;

/// Whether a coupling's jaws, or vanes, may make the comb (C48): nothing confirms the speed, and at one near by it is a multiple of the shaft's.
fn may_be_of_coupling(comb: &Comb, features: &WindowFeatures, context: &Context<'_>) -> bool {
    let order = order(comb.frequency, comb.bearing, features, context);
    let is_near = |order: f64| (order - order.round()).abs() <= UNSURE * order;
    features.speed.is_unconfirmed() && order.is_some_and(is_near)
}

/// Growth over the baseline that is enough where blows hold a quarter of the energy as well (6 dB).
const GROWN_WITH_BLOWS: f64 = level::WARNING_RATIO;

/// What makes a comb accuse: its part of the amplitude has outgrown the baseline's, not by chance, fivefold or beside blows twofold;
/// without a baseline of it, blows.
fn proof(
    comb: &Comb,
    features: &WindowFeatures,
    context: &Context<'_>,
    resolution: Hz,
) -> Option<Proof> {
    let name = comb::feature_name(comb.line, &context.machine.bearing(comb.bearing).id);
    let channel = context.channel_name(comb.pair.0);
    let heard = features.impulses.iter();
    let heard = heard.filter(|h| [comb.pair.0, comb.pair.1].contains(&h.channel));
    let part = |heard: &Impulses| {
        heard.agreed(|blows| at_rate(blows, heard.channel, (comb, resolution), features))
    };
    let most = heard.map(part).fold(0.0, f64::max);
    let compared = context.baseline.compare(channel, &name, comb.part.sqrt());
    let proof = Proof { growth: compared.map(|c| c.ratio), blows: most };
    let needed = if proof.has_blows() { GROWN_WITH_BLOWS } else { GROWN_RATIO };
    let is_enough = match compared {
        Some(compared) => {
            compared.ratio >= needed
                && confidence::normal_tail(compared.z()) <= context.false_alarm_probability
        }
        None => proof.has_blows(),
    };
    is_enough.then_some(proof)
}

/// Part of a band's energy in blows that keep the comb's rate: strikes at one rate make its line in the squared envelope, or a multiple,
/// at least as deep as the part they hold (F25), so no more than the line read there is deep. None where no line stands over
/// the noise at that rate: few blows at random have deep lines at any, and as deep ones beside it.
fn at_rate(
    blows: &Blows,
    channel: ChannelIndex,
    (comb, resolution): (&Comb, Hz),
    features: &WindowFeatures,
) -> f64 {
    let own =
        |s: &&LineSearch| (s.bearing, s.line, s.channel) == (comb.bearing, comb.line, channel);
    let readings =
        features.bearing_lines.iter().filter(own).flat_map(|s| s.outcome.iter().flatten());
    let same = readings.filter(|reading| {
        let apart = (reading.frequency.0 - comb.frequency.0).abs();
        reading.band == blows.band && apart <= resolution.0 && candidate::stands(reading)
    });
    let depths = same.flat_map(|reading| reading.harmonics.iter().flatten().map(|h| h.depth));
    depths.fold(0.0, f64::max).min(blows.part)
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
    format!(
        "{} {:.1} Hz repeats in the acceleration of {}: the weakest of its harmonics {} to {} hold {:.0} times the power of those of \
         any rate near by, and harmonics {} to {} hold {:.1} % of the vibration{}",
        comb.line.name(),
        comb.frequency.0,
        pair_name(comb, context),
        comb::HARMONICS.start(),
        comb::HARMONICS.end(),
        comb.lead,
        comb::UPPER.start(),
        comb::UPPER.end(),
        100.0 * comb.part,
        struck.proof.sentence(),
    )
}

fn pair_name(comb: &Comb, context: &Context<'_>) -> String {
    let (x, y) = comb.pair;
    format!("{} and {}", context.channel_name(x), context.channel_name(y))
}

/// The comb, for the record.
pub(super) fn evidence(comb: &Comb, features: &WindowFeatures, context: &Context<'_>) -> Evidence {
    let (x, y) = comb.pair;
    Evidence {
        indicator: format!("comb_{}", comb.line.slug()),
        channel: format!("{}+{}", context.channel_name(x), context.channel_name(y)),
        detector: None,
        frequency: Some(comb.frequency),
        expected: Some(comb.expected),
        order: order(comb.frequency, comb.bearing, features, context),
        value: comb.lead,
        unit: Unit::One,
        threshold: Some(LEAD_POWER_RATIO),
        false_alarm_probability: None,
        sample_range: Some(comb.sample_range),
    }
}

#[cfg(test)]
#[path = "struck_tests.rs"]
mod tests;
