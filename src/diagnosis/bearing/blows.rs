//! Blows that nothing found explains (docs/theory.md, C37): neither a verdict nor health.
//!
//! Elements that slip, and defects on them most of all, strike at no fixed rate, and their blows leave no line. So do things beside
//! the machine. What is known is that something strikes, hard enough to accuse if it kept a rate.

use super::doubt::Seen;
use crate::diagnosis::Context;
use crate::diagnosis::level;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::Evidence;
use crate::features::bearing::LineSearch;
use crate::features::impulses;
use crate::features::impulses::Impulses;
use crate::units::Unit;

/// Part of the energy from which blows count: blows that kept a rate would have lines twice as deep (S1), which accuse.
pub(super) const PART: f64 = severity::WARNING_DEPTH / 2.0;

/// Why a bearing is not acquitted beside blows that nothing explains, if there are such.
pub(super) fn why_open(searches: &[&LineSearch], seen: &Seen<'_>) -> Option<String> {
    // At changing speed the level changes too, which the median takes for bursts; what is accepted strikes.
    if seen.features.speed.is_transient() || !seen.accepted.is_empty() {
        return None;
    }
    let is_new = |heard: &Impulses| {
        over_baseline(heard, seen).is_none_or(|ratio| ratio >= level::WARNING_RATIO)
    };
    let counts = |heard: &&Impulses| heard.unexplained() >= PART && is_new(heard);
    let most = heard_at(searches, seen)
        .filter(counts)
        .max_by(|a, b| a.unexplained().total_cmp(&b.unexplained()))?;
    Some(format!(
        "{:.0} % of the energy in a quarter of the bands of {} comes in blows that neither a shaft's speed nor a defect's rate \
         explains: elements that slip strike so, and so may something beside the bearing; {}",
        100.0 * most.unexplained(),
        seen.context.channel_name(most.channel),
        match over_baseline(most, seen) {
            Some(_) => "more than in the baseline",
            None => "a baseline that knows them would tell",
        },
    ))
}

/// What is heard in the channels that lines of this bearing could be read in.
fn heard_at<'a>(
    searches: &'a [&LineSearch],
    seen: &Seen<'a>,
) -> impl Iterator<Item = &'a Impulses> {
    let listens = |heard: &&Impulses| {
        searches.iter().any(|s| s.outcome.is_ok() && s.channel == heard.channel)
    };
    seen.features.impulses.iter().filter(listens)
}

/// Amplitude of the blows over that of the healthy machine's, if its baseline knows them.
fn over_baseline(heard: &Impulses, seen: &Seen<'_>) -> Option<f64> {
    let channel = seen.context.channel_name(heard.channel);
    let compared = seen.context.baseline.compare(channel, impulses::BLOWS, heard.over_rest());
    compared.map(|compared| compared.ratio)
}

/// The blows of the bearing's channels, for the record.
pub(super) fn evidence(heard: &Impulses, context: &Context<'_>) -> Evidence {
    Evidence {
        indicator: "impulsive_part".to_owned(),
        channel: context.channel_name(heard.channel).to_owned(),
        detector: None,
        frequency: None,
        expected: None,
        order: None,
        value: heard.unexplained(),
        unit: Unit::One,
        threshold: Some(PART),
        false_alarm_probability: None,
        sample_range: Some(heard.sample_range),
    }
}
