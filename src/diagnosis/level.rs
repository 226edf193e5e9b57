//! The machine as a whole: levels against limits and baseline. Abnormal is not a cause.

use super::Context;
use super::baseline::Comparison;
use super::confidence;
use super::fault::ComponentKind;
use super::fault::Detector;
use super::fault::FaultMode;
use super::fault::State;
use super::severity;
use super::verdict::ComponentDiagnosis;
use super::verdict::Evidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::overall;
use crate::units::Unit;

/// Level ratio to baseline that makes a warning: 6 dB, twice the healthy level.
pub const WARNING_RATIO: f64 = 2.0;

/// Level ratio that counts as damaged: 20 dB, ten times the healthy level.
pub const DAMAGED_RATIO: f64 = 10.0;

/// A level held against something.
struct Finding {
    severity: f64,
    proven: bool,
    probability: Option<f64>,
    text: String,
    evidence: Evidence,
}

/// Judges the level; `explained`: a component is accused already, so a raised level adds no cause.
#[must_use]
pub fn judge(
    features: &WindowFeatures,
    context: &Context<'_>,
    explained: bool,
) -> ComponentDiagnosis {
    let mut verdict = ComponentDiagnosis::undetermined(
        &context.machine.id,
        ComponentKind::Machine,
        "no limits and no baseline to hold the level against".to_owned(),
    );
    let mut findings: Vec<Finding> = Vec::new();
    for channel in &features.channels {
        findings.extend(against_limits(channel, context));
        findings.extend(against_baseline(channel, features, context));
    }
    let worst =
        findings.iter().filter(|f| f.proven).max_by(|a, b| a.severity.total_cmp(&b.severity));
    let highest = findings.iter().max_by(|a, b| a.severity.total_cmp(&b.severity));
    match (worst, highest) {
        (Some(found), _) if severity::state(found.severity).is_accusation() => {
            if explained {
                verdict.why = format!("{}, explained by the accused component", found.text);
            } else {
                verdict.state = severity::state(found.severity);
                verdict.fault = Some(FaultMode::AbnormalLevel);
                verdict.severity = Some(found.severity);
                verdict.confidence =
                    Some((0.95 * (1.0 - found.probability.unwrap_or(0.0))).min(0.99));
                verdict.why = format!("{}, cause not proven", found.text);
            }
        }
        (_, Some(found)) => {
            verdict.state = State::Healthy;
            verdict.severity = Some(severity::not_accused(found.severity));
            verdict.confidence = Some(0.9);
            verdict.why = format!("levels are normal: {}", found.text);
        }
        (_, None) => {}
    }
    verdict.evidence = findings.into_iter().map(|f| f.evidence).collect();
    verdict
}

/// Velocity RMS against the limits in force.
fn against_limits(channel: &ChannelFeatures, context: &Context<'_>) -> Option<Finding> {
    let limits = context.machine.limits_in_force();
    let warning = limits.velocity_rms_warning_mm_per_s?;
    let damaged = limits.velocity_rms_damaged_mm_per_s?;
    let value = channel.get(overall::VELOCITY_RMS)?;
    let name = context.channel_name(channel.channel);
    // A value exactly on a boundary belongs to the better zone (ISO 20816-1).
    let severity = if value <= warning {
        severity::WARNING * (value / warning) * (1.0 - 1e-9)
    } else if value <= damaged {
        severity::WARNING
            + (severity::DAMAGED - severity::WARNING) * (value - warning) / (damaged - warning)
                * (1.0 - 1e-9)
    } else {
        severity::of_ratio(value / damaged * DAMAGED_RATIO, WARNING_RATIO, DAMAGED_RATIO)
    };
    Some(Finding {
        severity,
        proven: true,
        probability: None,
        text: format!(
            "velocity RMS {value:.2} mm/s of {name} (limits {warning:.2} and {damaged:.2})"
        ),
        evidence: Evidence {
            indicator: overall::VELOCITY_RMS.to_owned(),
            channel: name.to_owned(),
            detector: Some(Detector::Rms),
            frequency: None,
            expected: None,
            order: None,
            value,
            unit: Unit::MillimetrePerSecond,
            threshold: Some(warning),
            false_alarm_probability: None,
            sample_range: Some(channel.sample_range),
        },
    })
}

/// RMS against the baseline. A fall is no alarm (run-in).
fn against_baseline(
    channel: &ChannelFeatures,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Finding> {
    let value = channel.get(overall::RMS)?;
    let name = context.channel_name(channel.channel);
    let Comparison { ratio, sigma, .. } = context.baseline.compare(name, overall::RMS, value)?;
    let looks = features.channels.len().max(1) as f64;
    let probability = (confidence::normal_tail(ratio.ln() / sigma) * looks).min(1.0);
    Some(Finding {
        severity: severity::of_ratio(ratio, WARNING_RATIO, DAMAGED_RATIO),
        proven: probability <= confidence::FALSE_ALARM_PROBABILITY,
        probability: Some(probability),
        text: format!("RMS of {name} is {ratio:.2} times its baseline"),
        evidence: Evidence {
            indicator: "rms_ratio_to_baseline".to_owned(),
            channel: name.to_owned(),
            detector: Some(Detector::Rms),
            frequency: None,
            expected: None,
            order: None,
            value: ratio,
            unit: Unit::One,
            threshold: Some(WARNING_RATIO),
            false_alarm_probability: Some(probability),
            sample_range: Some(channel.sample_range),
        },
    })
}
