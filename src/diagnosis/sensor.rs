//! Sensor flaws → verdicts on sensors; they never change the whole, only the data quality.

use super::Context;
use super::fault::ComponentKind;
use super::fault::FaultMode;
use super::fault::State;
use super::verdict::ComponentDiagnosis;
use super::verdict::DataQuality;
use crate::features::WindowFeatures;
use crate::features::sensor::SensorFlaw;
use crate::features::sensor::SensorReading;
use crate::signal::ChannelIndex;
use std::collections::BTreeSet;

/// Judges every sensor that has a channel; healthy sensors are not listed.
#[must_use]
pub fn judge(features: &WindowFeatures, context: &Context<'_>) -> Vec<ComponentDiagnosis> {
    features.sensors.iter().filter_map(|reading| judge_one(reading, context)).collect()
}

fn judge_one(reading: &SensorReading, context: &Context<'_>) -> Option<ComponentDiagnosis> {
    let id = context.channel_name(reading.channel);
    let (fault, state, severity, why) = match (reading.flaw, &reading.absent) {
        (Some(SensorFlaw::Dead), _) => (
            Some(FaultMode::Dead),
            State::Damaged,
            1.0,
            "every sample has the same value".to_owned(),
        ),
        (Some(SensorFlaw::Stuck { part }), _) => (
            Some(FaultMode::Stuck),
            State::Damaged,
            0.5 + 0.5 * part,
            format!("the signal stays at one value for {:.0} % of the window", 100.0 * part),
        ),
        (Some(SensorFlaw::Clipped { part }), _) => (
            Some(FaultMode::Clipped),
            State::Warning,
            0.25 + 0.25 * part.min(0.99),
            format!("{:.2} % of the samples lie at the end of the range", 100.0 * part),
        ),
        (Some(SensorFlaw::Spiking { count, part }), _) => (
            Some(FaultMode::Spiking),
            State::Warning,
            0.25 + 0.25 * part.min(0.99),
            format!(
                "{count} single samples stand far out of their neighbours and hold {:.0} % of the energy: look at plug, \
                 cable and earth",
                100.0 * part
            ),
        ),
        (Some(SensorFlaw::WrongRange { levels }), _) => (
            Some(FaultMode::WrongRange),
            State::Warning,
            0.3,
            format!("the signal takes {levels} values only: the range is too wide for it"),
        ),
        (Some(SensorFlaw::Magnitude { largest }), _) => (
            Some(FaultMode::WrongRange),
            State::Damaged,
            0.75,
            format!(
                "the signal deviates from its mean by up to {largest:.1e}, which no machine does in any unit: look at scale, unit and type of the data"
            ),
        ),
        (Some(SensorFlaw::Gap { volts, allowed: (low, high) }), _) => (
            Some(FaultMode::WrongRange),
            State::Warning,
            0.3,
            format!(
                "the gap voltage is {volts:.2} V; the probe may be believed from {low} to {high} V (gap_v)"
            ),
        ),
        (None, Some(reason)) => {
            return Some(ComponentDiagnosis::undetermined(
                id,
                ComponentKind::Sensor,
                reason.clone(),
            ));
        }
        (None, None) => return None,
    };
    let mut verdict = ComponentDiagnosis::undetermined(id, ComponentKind::Sensor, why);
    verdict.state = state;
    verdict.fault = fault;
    verdict.severity = Some(severity);
    verdict.confidence = Some(0.95);
    Some(verdict)
}

/// Names of those of `channels` that are cut at the ends of their range, and whether all are.
fn cut(
    features: &WindowFeatures,
    channels: impl Iterator<Item = ChannelIndex>,
    context: &Context<'_>,
) -> (String, bool) {
    let channels: BTreeSet<ChannelIndex> = channels.collect();
    let is_cut =
        |c: &&ChannelIndex| features.sensors.iter().any(|r| r.channel == **c && r.is_cut());
    let found: Vec<&str> =
        channels.iter().filter(is_cut).map(|c| context.channel_name(*c)).collect();
    let all = !channels.is_empty() && found.len() == channels.len();
    (found.join(", "), all)
}

/// Why nothing is acquitted by these channels, if all of them are cut.
pub(super) fn all_cut(
    features: &WindowFeatures,
    channels: impl Iterator<Item = ChannelIndex>,
    context: &Context<'_>,
) -> Option<String> {
    let (names, all) = cut(features, channels, context);
    all.then(|| {
        format!("{names} is cut at the ends of its range: what is missing may have been cut off; choose a wider range")
    })
}

/// What an accusation by these channels says of those that are cut; empty if none is.
pub(super) fn cut_note(
    features: &WindowFeatures,
    channels: impl Iterator<Item = ChannelIndex>,
    context: &Context<'_>,
) -> String {
    let (names, _) = cut(features, channels, context);
    if names.is_empty() {
        return names;
    }
    format!("; {names} is cut at the ends of its range, which lowers depth and severity")
}

/// Data quality over the machine's sensors: bad when none is left to judge by.
#[must_use]
pub fn data_quality(features: &WindowFeatures) -> DataQuality {
    let unusable = |r: &SensorReading| {
        r.absent.is_some() || matches!(r.flaw, Some(SensorFlaw::Dead | SensorFlaw::Stuck { .. }))
    };
    let flawed = features.sensors.iter().any(|r| r.flaw.is_some() || r.absent.is_some());
    if features.sensors.iter().all(unusable) {
        DataQuality::Bad
    } else if flawed {
        DataQuality::Degraded
    } else {
        DataQuality::Ok
    }
}
