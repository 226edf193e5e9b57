//! The machine as a whole: levels against limits and baseline. Abnormal is not a cause.

use super::Context;
use super::baseline::Comparison;
use super::bearing::Unplaced;
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
    /// Whether it exceeds a limit that somebody stated: a promise to say so, whatever else is accused.
    is_of_limit: bool,
    probability: Option<f64>,
    text: String,
    evidence: Evidence,
}

/// Judges the level; `explained`: a component is accused already, so a level raised over its baseline adds no cause. `unplaced`: damage of a bearing that none
/// can be accused of by itself.
#[must_use]
pub fn judge(
    features: &WindowFeatures,
    context: &Context<'_>,
    explained: bool,
    unplaced: Option<Unplaced>,
) -> ComponentDiagnosis {
    let mut verdict = ComponentDiagnosis::undetermined(
        &context.machine.id,
        ComponentKind::Machine,
        without_measure(context).to_owned(),
    );
    let mut findings: Vec<Finding> = Vec::new();
    for channel in &features.channels {
        findings.extend(against_limits(channel, context));
        findings.extend(against_baseline(channel, features, context));
    }
    let highest = |counts: &dyn Fn(&Finding) -> bool| {
        let those = findings.iter().filter(|found| counts(found));
        those.max_by(|a, b| a.severity.total_cmp(&b.severity))
    };
    let is_abnormal = |f: &Finding| f.proven && severity::state(f.severity).is_accusation();
    let accusing = highest(&|f| is_abnormal(f) && (f.is_of_limit || !explained));
    match (accusing, highest(&is_abnormal), highest(&|_| true)) {
        (Some(found), ..) => {
            verdict.state = severity::state(found.severity);
            verdict.fault = Some(FaultMode::AbnormalLevel);
            verdict.severity = Some(found.severity);
            verdict.confidence = Some((0.95 * (1.0 - found.probability.unwrap_or(0.0))).min(0.99));
            verdict.why = format!("{}, cause not proven", found.text);
        }
        (None, Some(found), _) => {
            verdict.why = format!("{}, explained by the accused component", found.text);
        }
        (None, None, Some(found)) => {
            verdict.state = State::Healthy;
            verdict.severity = Some(severity::not_accused(found.severity));
            verdict.confidence = Some(0.9);
            verdict.why = format!("no level is proven abnormal: {}", found.text);
            if !findings.iter().any(|found| found.is_of_limit) {
                context.baseline.qualify(&mut verdict);
            }
        }
        (None, None, None) => {}
    }
    if let Some(found) = unplaced {
        blame_whole(&mut verdict, &found);
    }
    verdict.evidence = findings.into_iter().map(|f| f.evidence).collect();
    verdict
}

/// Why there is nothing to hold a level against.
fn without_measure(context: &Context<'_>) -> &'static str {
    let limits = context.machine.limits_in_force();
    let has_limits = limits.velocity_rms_warning_mm_per_s.is_some()
        || limits.velocity_rms_damaged_mm_per_s.is_some();
    if has_limits {
        "limits are stated, but no channel is in a unit from which a velocity can be told (volts need sensitivity_v_per_unit), and there is no baseline"
    } else {
        "no limits and no baseline to hold the level against"
    }
}

/// Accuses the machine of what is damaged in one of several bearings, which is not told: abnormal, whatever its level.
fn blame_whole(verdict: &mut ComponentDiagnosis, found: &Unplaced) {
    let level = verdict.severity.filter(|_| verdict.state.is_accusation());
    let besides = level.map_or_else(String::new, |_| format!("; besides, {}", verdict.why));
    let severity = level.unwrap_or(0.0).max(found.severity);
    verdict.state = severity::state(severity);
    verdict.fault = Some(FaultMode::AbnormalLevel);
    verdict.severity = Some(severity);
    verdict.confidence =
        Some(found.confidence.max(verdict.confidence.filter(|_| level.is_some()).unwrap_or(0.0)));
    verdict.why = format!("{}{besides}", found.why);
}

/// Velocity RMS against the limits in force.
fn against_limits(channel: &ChannelFeatures, context: &Context<'_>) -> Option<Finding> {
    let limits = context.machine.limits_in_force();
    let warning = limits.velocity_rms_warning_mm_per_s;
    let damaged = limits.velocity_rms_damaged_mm_per_s;
    let lowest = warning.or(damaged)?;
    let value = channel.get(overall::VELOCITY_RMS)?;
    let name = context.channel_name(channel.channel);
    let severity = of_limits(value, warning, damaged);
    let stated: Vec<String> =
        [warning, damaged].iter().flatten().map(|limit| format!("{limit:.2}")).collect();
    Some(Finding {
        severity,
        proven: true,
        is_of_limit: true,
        probability: None,
        text: format!("velocity RMS {value:.2} mm/s of {name} (limits: {})", stated.join(", ")),
        evidence: Evidence {
            indicator: overall::VELOCITY_RMS.to_owned(),
            channel: name.to_owned(),
            detector: Some(Detector::Rms),
            frequency: None,
            expected: None,
            order: None,
            value,
            unit: Unit::MillimetrePerSecond,
            threshold: Some(lowest),
            false_alarm_probability: None,
            sample_range: Some(channel.sample_range),
        },
    })
}

/// Severity of a level against its limits, either of which may be absent: alone, the warning limit
/// never claims damage, and the damage limit has nothing between.
///
/// A value exactly on a boundary belongs to the better zone (ISO 20816-1).
fn of_limits(value: f64, warning: Option<f64>, damaged: Option<f64>) -> f64 {
    let below = |part: f64| part * (1.0 - 1e-9);
    let over_damaged = damaged.filter(|limit| value > *limit);
    let over_warning = warning.filter(|limit| value > *limit);
    match (over_damaged, over_warning) {
        (Some(limit), _) => {
            severity::of_ratio(value / limit * DAMAGED_RATIO, WARNING_RATIO, DAMAGED_RATIO)
        }
        (None, Some(low)) => {
            let up = match damaged {
                Some(high) => (value - low) / (high - low),
                None => 1.0 - low / value,
            };
            severity::WARNING + below((severity::DAMAGED - severity::WARNING) * up)
        }
        (None, None) => {
            let lowest = warning.or(damaged).unwrap_or(f64::INFINITY);
            below(severity::WARNING * value / lowest)
        }
    }
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
        proven: probability <= context.false_alarm_probability,
        is_of_limit: false,
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

#[cfg(test)]
mod tests {
    use super::*;

    fn state(value: f64, warning: Option<f64>, damaged: Option<f64>) -> State {
        severity::state(of_limits(value, warning, damaged))
    }

    #[test]
    fn each_limit_holds_alone_and_both_together() {
        // Group 2 rigid of ISO 20816-3: B/C 2.8, C/D 4.5 mm/s; on the boundary the better zone.
        let both = (Some(2.8), Some(4.5));
        assert_eq!(state(2.8, both.0, both.1), State::Healthy);
        assert_eq!(state(2.9, both.0, both.1), State::Warning);
        assert_eq!(state(4.5, both.0, both.1), State::Warning);
        assert_eq!(state(4.6, both.0, both.1), State::Damaged);
        assert_eq!(state(100.0, Some(2.8), None), State::Warning);
        assert_eq!(state(2.8, Some(2.8), None), State::Healthy);
        assert_eq!(state(4.4, None, Some(4.5)), State::Healthy);
        assert_eq!(state(4.6, None, Some(4.5)), State::Damaged);
    }

    #[test]
    fn damage_of_one_of_several_bearings_is_the_machines_and_keeps_what_the_level_says() {
        let why = "a or b".to_owned();
        let found = Unplaced { bearings: Vec::new(), severity: 0.45, confidence: 0.8, why };
        let open = || {
            let why = "no limits".to_owned();
            ComponentDiagnosis::undetermined("m", ComponentKind::Machine, why)
        };
        let mut alone = open();
        blame_whole(&mut alone, &found);
        assert_eq!((alone.state, alone.fault), (State::Warning, Some(FaultMode::AbnormalLevel)));
        assert_eq!((alone.severity, alone.confidence), (Some(0.45), Some(0.8)));
        assert_eq!(alone.why, "a or b");
        let mut loud = ComponentDiagnosis {
            state: State::Damaged,
            fault: Some(FaultMode::AbnormalLevel),
            severity: Some(0.7),
            confidence: Some(0.9),
            ..open()
        };
        blame_whole(&mut loud, &found);
        assert_eq!((loud.state, loud.severity), (State::Damaged, Some(0.7)));
        assert_eq!((loud.confidence, loud.why.as_str()), (Some(0.9), "a or b; besides, no limits"));
    }
}
