//! Blows that nothing found explains (docs/theory.md, C37): neither a verdict nor health.
//!
//! Elements that slip, and defects on them most of all, strike at no fixed rate, and their blows leave no line. So do things beside
//! the machine. What is known is that something strikes, hard enough to accuse if it kept a rate.

use crate::diagnosis::Context;
use crate::diagnosis::fault::State;
use crate::diagnosis::level;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::impulses;
use crate::features::impulses::Impulses;
use crate::machine::BearingIndex;
use crate::units::Unit;

/// Part of the energy from which blows count: blows that kept a rate would have lines twice as deep (S1), which accuse.
pub(super) const PART: f64 = severity::WARNING_DEPTH / 2.0;

/// Part from which they count in this window: half of it where nothing confirms the speed, as lines half as deep as accuse do not acquit (C42), for
/// they may keep the rate of a speed that is another, or changes.
fn part(features: &WindowFeatures) -> f64 {
    if features.speed.is_unconfirmed() { PART / 2.0 } else { PART }
}

/// What is said of them where the speed is why they count.
const SPEED_NOT_CONFIRMED: &str =
    ", and a defect if the speed, which nothing confirms, is another or changes";

/// Leaves bearings open that would be acquitted beside blows that nothing explains (C37).
pub(super) fn reopen(
    verdicts: &mut [ComponentDiagnosis],
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    // At changing speed the level changes too, which the median takes for bursts; what is accused strikes.
    let is_known = verdicts.iter().any(|verdict| verdict.state.is_accusation());
    if features.speed.is_transient() || is_known {
        return;
    }
    for (bearing, verdict) in verdicts.iter_mut().enumerate() {
        if verdict.state != State::Healthy {
            continue;
        }
        if let Some(why) = why_open(BearingIndex(bearing), features, context) {
            verdict.leave_open(why);
        }
    }
}

/// Why a bearing is not acquitted beside blows that nothing explains, if there are such.
fn why_open(
    bearing: BearingIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<String> {
    let listens = |heard: &&Impulses| {
        let mut own = features.bearing_lines.iter().filter(|s| s.bearing == bearing);
        own.any(|s| s.outcome.is_ok() && s.channel == heard.channel)
    };
    let is_new = |heard: &Impulses| {
        over_baseline(heard, context).is_none_or(|ratio| ratio >= level::WARNING_RATIO)
    };
    let most = features
        .impulses
        .iter()
        .filter(listens)
        .filter(|heard| heard.unexplained() >= part(features) && is_new(heard))
        .max_by(|a, b| a.unexplained().total_cmp(&b.unexplained()))?;
    Some(format!(
        "{:.0} % of the energy in a quarter of the bands of {} comes in blows that neither a shaft's speed nor a defect's rate \
         explains: elements that slip strike so, and so may something beside the bearing{}; {}",
        100.0 * most.unexplained(),
        context.channel_name(most.channel),
        if most.unexplained() < PART { SPEED_NOT_CONFIRMED } else { "" },
        match over_baseline(most, context) {
            Some(_) => "more than in the baseline",
            None => "a baseline that knows them would tell",
        },
    ))
}

/// Amplitude of the blows over that of the healthy machine's, if its baseline knows them.
fn over_baseline(heard: &Impulses, context: &Context<'_>) -> Option<f64> {
    let channel = context.channel_name(heard.channel);
    let compared = context.baseline.compare(channel, impulses::BLOWS, heard.over_rest());
    compared.map(|compared| compared.ratio)
}

/// The blows of the bearing's channels, for the record.
pub(super) fn evidence(
    heard: &Impulses,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Evidence {
    Evidence {
        indicator: "impulsive_part".to_owned(),
        channel: context.channel_name(heard.channel).to_owned(),
        detector: None,
        frequency: None,
        expected: None,
        order: None,
        value: heard.unexplained(),
        unit: Unit::One,
        threshold: Some(part(features)),
        false_alarm_probability: None,
        sample_range: Some(heard.sample_range),
    }
}
