//! Shafts and gears, judged jointly: "something once a revolution" does not name the part.
//!
//! Displacement at 1×, CWT amplitude at 1× and the localised difference signal, each against the
//! baseline, are read together in the joint table of docs/theory.md (J1). What was not measured
//! leaves the parts it would separate undetermined.

use super::Context;
use super::baseline::Comparison;
use super::confidence;
use super::fault::ComponentKind;
use super::fault::Detector;
use super::fault::FaultMode;
use super::fault::GearSide;
use super::fault::State;
use super::severity;
use super::verdict::ComponentDiagnosis;
use super::verdict::Evidence;
use super::verdict::GearFinding;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::gear;
use crate::features::gear::GearReading;
use crate::features::shaft;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::units::Hz;
use crate::units::Unit;

/// Ratio to baseline that counts as "up": what a healthy straight shaft stays below with other parts
/// damaged (≤ 3), far under what a bow or a worn tooth shows.
pub const UP_RATIO: f64 = 3.0;

/// Ratio that counts as damaged: ten times "up".
pub const DAMAGED_RATIO: f64 = 30.0;

/// Unbalance is excluded when the eccentricity it would need exceeds ten times the ISO 21940-11
/// grade G 40: e·ω = 40 mm/s.
const ECCENTRICITY_SPEED_MM_PER_S: f64 = 400.0;

/// The rule holds well below the first critical speed only.
const MAX_SPEED_PER_CRITICAL: f64 = 0.3;

/// One indicator against the baseline, the strongest of its channels.
#[derive(Debug, Clone)]
struct Indicator {
    ratio: f64,
    probability: f64,
    evidence: Evidence,
}

impl Indicator {
    fn is_up(&self) -> bool {
        self.ratio >= UP_RATIO && self.probability <= confidence::FALSE_ALARM_PROBABILITY
    }
}

/// What is known of one shaft.
struct ShaftSigns {
    displacement: Option<Indicator>,
    cwt: Option<Indicator>,
    /// Localised difference signal of the gears on this shaft.
    local: Vec<(GearIndex, Option<Indicator>)>,
}

/// Judges every shaft and gear.
#[must_use]
pub fn judge(features: &WindowFeatures, context: &Context<'_>) -> Vec<ComponentDiagnosis> {
    let machine = context.machine;
    let signs: Vec<ShaftSigns> =
        (0..machine.shafts.len()).map(|s| signs(ShaftIndex(s), features, context)).collect();
    let mut verdicts: Vec<ComponentDiagnosis> = signs
        .iter()
        .enumerate()
        .map(|(s, signs)| judge_shaft(ShaftIndex(s), signs, features, context))
        .collect();
    verdicts.extend(
        (0..machine.gears.len()).map(|g| judge_gear(GearIndex(g), &signs, features, context)),
    );
    verdicts
}

fn signs(shaft: ShaftIndex, features: &WindowFeatures, context: &Context<'_>) -> ShaftSigns {
    let machine = context.machine;
    let id = &machine.shaft(shaft).id;
    let hears = |channel: &ChannelFeatures, kind: SensorKind| {
        let sensor =
            machine.sensors.iter().find(|s| s.channel == context.channel_name(channel.channel));
        sensor.is_some_and(|s| {
            s.kind == kind && machine.shaft_at(s).is_none_or(|at| same_speed(at, shaft, context))
        })
    };
    let of_kind = |kind: SensorKind| {
        features.channels.iter().filter(move |c| hears(c, kind)).collect::<Vec<_>>()
    };
    let probes = of_kind(SensorKind::Proximitor);
    let housings = of_kind(SensorKind::Accelerometer);
    let displacement = strongest(&probes, &[shaft::line_name(1, id)], features, context);
    let single = shaft::cwt_name(id);
    let absolute = format!("absolute_{single}");
    let cwt = strongest(&housings, &[absolute], features, context)
        .or_else(|| strongest(&housings, &[single], features, context));
    let on_shaft = machine.gears.iter().enumerate().filter(|(_, g)| {
        [g.driving.shaft, g.driven.shaft].into_iter().any(|s| same_speed(s, shaft, context))
    });
    let local = on_shaft
        .map(|(g, described)| {
            let names: Vec<String> = [described.driving.shaft, described.driven.shaft]
                .into_iter()
                .filter(|s| same_speed(*s, shaft, context))
                .map(|s| gear::local_name(&described.id, &machine.shaft(s).id))
                .collect();
            (GearIndex(g), strongest(&housings, &names, features, context))
        })
        .collect();
    ShaftSigns { displacement, cwt, local }
}

/// Two shafts whose once-a-revolution events cannot be told apart.
fn same_speed(a: ShaftIndex, b: ShaftIndex, context: &Context<'_>) -> bool {
    let ratio = |s: ShaftIndex| context.machine.shaft(s).ratio_to_first;
    a == b || matches!((ratio(a), ratio(b)), (Some(x), Some(y)) if (x - y).abs() < 1e-9)
}

/// The largest ratio among channels and names, its probability paid for the looks.
fn strongest(
    channels: &[&ChannelFeatures],
    names: &[String],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Indicator> {
    let mut found: Vec<Indicator> = Vec::new();
    for channel in channels {
        for name in names {
            let Some(feature) = channel.values.iter().find(|f| *f.name == **name) else { continue };
            let channel_name = context.channel_name(channel.channel);
            let Some(comparison) = context.baseline.compare(channel_name, name, feature.value)
            else {
                continue;
            };
            found.push(indicator(name, channel_name, channel, comparison, features));
        }
    }
    let looks = found.len() as f64;
    let mut best = found.into_iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio))?;
    best.probability = (best.probability * looks).min(1.0);
    best.evidence.false_alarm_probability = Some(best.probability);
    Some(best)
}

fn indicator(
    name: &str,
    channel_name: &str,
    channel: &ChannelFeatures,
    comparison: Comparison,
    features: &WindowFeatures,
) -> Indicator {
    let probability = confidence::normal_tail(comparison.z());
    Indicator {
        ratio: comparison.ratio,
        probability,
        evidence: Evidence {
            indicator: format!("{name}_ratio_to_baseline"),
            channel: channel_name.to_owned(),
            detector: Some(Detector::ZeroToPeak),
            frequency: features.speed.first,
            expected: None,
            order: None,
            value: comparison.ratio,
            unit: Unit::One,
            threshold: Some(UP_RATIO),
            false_alarm_probability: Some(probability),
            sample_range: Some(channel.sample_range),
        },
    }
}

fn blank(id: &str, kind: ComponentKind, why: String) -> ComponentDiagnosis {
    ComponentDiagnosis {
        id: id.to_owned(),
        kind,
        state: State::Undetermined,
        fault: None,
        severity: None,
        confidence: None,
        why,
        evidence: Vec::new(),
        other_faults: Vec::new(),
        gear: None,
    }
}

/// Why neither shaft nor gear can be judged, if so.
fn cannot_look(features: &WindowFeatures, context: &Context<'_>) -> Option<String> {
    if features.speed.first.is_none() {
        return Some("shaft speed is not known".to_owned());
    }
    let probe = context
        .machine
        .sensors
        .iter()
        .zip(context.channel_of_sensor)
        .any(|(s, channel)| s.kind == SensorKind::Proximitor && channel.is_some());
    context.baseline.records.is_empty().then(|| {
        if probe {
            "no baseline to compare the displacement with"
        } else {
            "no proximity probe and no baseline"
        }
        .to_owned()
    })
}

fn judge_shaft(
    shaft: ShaftIndex,
    signs: &ShaftSigns,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> ComponentDiagnosis {
    let id = &context.machine.shaft(shaft).id;
    let mut verdict = blank(id, ComponentKind::Shaft, String::new());
    if let Some(why) = cannot_look(features, context) {
        verdict.why = why;
        return verdict;
    }
    let indicators = [&signs.displacement, &signs.cwt];
    verdict.evidence =
        indicators.iter().filter_map(|i| i.as_ref()).map(|i| i.evidence.clone()).collect();
    let local_up = signs.local.iter().any(|(_, i)| i.as_ref().is_some_and(Indicator::is_up));
    match (&signs.displacement, &signs.cwt) {
        (Some(d), _) if d.is_up() => {
            let bow = excludes_unbalance(shaft, features, context);
            accuse(&mut verdict, d, bow.then_some(FaultMode::Bow), features);
            verdict.why = format!(
                "1× displacement is {:.1} times its baseline in {}{}",
                d.ratio,
                d.evidence.channel,
                if bow {
                    "; unbalance would need more than ten times G 40"
                } else {
                    ", cause not proven"
                }
            );
        }
        (Some(d), _) => acquit(
            &mut verdict,
            format!("1× displacement is {:.2} times its baseline", d.ratio),
            features,
        ),
        (None, Some(c)) if c.is_up() && signs.local.is_empty() => {
            accuse(&mut verdict, c, None, features);
            verdict.why = format!(
                "CWT amplitude at 1× is {:.1} times its baseline in {}; unbalance, bow and coupling are not separable without a probe",
                c.ratio, c.evidence.channel
            );
        }
        (None, Some(c)) if c.is_up() && local_up => {
            verdict.why = "1× is up and the gear explains it; a shaft fault beside it needs a proximity probe".to_owned();
        }
        (None, Some(c)) if c.is_up() => {
            verdict.why = format!(
                "CWT amplitude at 1× is {:.1} times its baseline; shaft and gear are not separable without a proximity probe",
                c.ratio
            );
        }
        (None, Some(c)) => acquit(
            &mut verdict,
            format!("CWT amplitude at 1× is {:.2} times its baseline", c.ratio),
            features,
        ),
        (None, None) => verdict.why = "the baseline has no 1× amplitude of this shaft".to_owned(),
    }
    verdict
}

fn accuse(
    verdict: &mut ComponentDiagnosis,
    by: &Indicator,
    fault: Option<FaultMode>,
    features: &WindowFeatures,
) {
    let severity = severity::of_ratio(by.ratio, UP_RATIO, DAMAGED_RATIO);
    verdict.state = severity::state(severity);
    verdict.fault = fault;
    verdict.severity = Some(severity);
    let named = if fault.is_some() { 0.85 } else { 0.9 };
    verdict.confidence =
        Some(named * (0.5 + 0.5 * features.speed.confidence) * (1.0 - by.probability));
}

fn acquit(verdict: &mut ComponentDiagnosis, why: String, features: &WindowFeatures) {
    verdict.state = State::Healthy;
    let ratio = verdict.evidence.first().map_or(1.0, |e| e.value);
    verdict.severity =
        Some(severity::of_ratio(ratio, UP_RATIO, DAMAGED_RATIO).min(severity::WARNING - 1e-6));
    verdict.confidence = Some(0.85 * (0.5 + 0.5 * features.speed.confidence));
    verdict.why = why;
}

/// Whether the 1× displacement needs an eccentricity no unbalance has: e = A(1 − r²)/r² above ten
/// times G 40 (docs/theory.md, J2).
fn excludes_unbalance(shaft: ShaftIndex, features: &WindowFeatures, context: &Context<'_>) -> bool {
    let described = context.machine.shaft(shaft);
    let speed = features.speed.first.zip(described.ratio_to_first).map(|(f, r)| Hz(f.0 * r));
    let (Some(speed), Some(critical)) = (speed, described.first_critical) else { return false };
    let r = speed.0 / critical.0;
    if r >= MAX_SPEED_PER_CRITICAL || r <= 0.0 {
        return false;
    }
    let name = shaft::line_name(1, &described.id);
    let amplitude_um = features
        .channels
        .iter()
        .filter(|c| context.channels[c.channel.0].unit == Unit::Micrometre)
        .filter_map(|c| c.get(&name))
        .fold(0.0, f64::max);
    let eccentricity_um = amplitude_um * (1.0 - r * r) / (r * r);
    eccentricity_um * 1e-3 * speed.to_rad_per_s().0 > ECCENTRICITY_SPEED_MM_PER_S
}

fn judge_gear(
    gear: GearIndex,
    signs: &[ShaftSigns],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> ComponentDiagnosis {
    let id = &context.machine.gear(gear).id;
    let mut verdict = blank(id, ComponentKind::Gear, String::new());
    if let Some(why) = cannot_look(features, context) {
        verdict.why = why.replace("no proximity probe and no baseline", "no baseline");
        return verdict;
    }
    let local = signs
        .iter()
        .enumerate()
        .flat_map(|(s, signs)| signs.local.iter().map(move |(g, i)| (ShaftIndex(s), signs, *g, i)))
        .filter(|(_, _, g, _)| *g == gear)
        .filter_map(|(s, signs, _, i)| i.as_ref().map(|i| (s, signs, i)))
        .max_by(|a, b| a.2.ratio.total_cmp(&b.2.ratio));
    let Some((shaft, signs, local)) = local else {
        verdict.why =
            "no synchronous average: a tacho, or a speed confirmed by shaft harmonics, is needed"
                .to_owned();
        return verdict;
    };
    verdict.evidence = [Some(local), signs.cwt.as_ref()]
        .into_iter()
        .flatten()
        .map(|i| i.evidence.clone())
        .collect();
    let cwt_up = signs.cwt.as_ref().is_some_and(Indicator::is_up);
    if !local.is_up() {
        let why =
            format!("the localised difference signal is {:.2} times its baseline", local.ratio);
        acquit(&mut verdict, why, features);
        return verdict;
    }
    let fault = cwt_up.then_some(FaultMode::ToothDamage);
    accuse(&mut verdict, local, fault, features);
    verdict.why = format!(
        "the difference signal of the synchronous average is {:.1} times its baseline at one place of the revolution in {}{}",
        local.ratio,
        local.evidence.channel,
        if cwt_up { ", with 1× up" } else { ", 1× is not up: cause not proven" }
    );
    verdict.gear = Some(finding(gear, shaft, features, context));
    verdict
}

/// Member, angle and tooth, as far as the average tells.
fn finding(
    gear: GearIndex,
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> GearFinding {
    let described = context.machine.gear(gear);
    let one_to_one = same_speed(described.driving.shaft, described.driven.shaft, context);
    let (side, member) = if same_speed(described.driving.shaft, shaft, context) {
        (GearSide::Driving, &described.driving)
    } else {
        (GearSide::Driven, &described.driven)
    };
    let reading = features
        .gears
        .iter()
        .filter(|r: &&GearReading| r.gear == gear && same_speed(r.shaft, shaft, context))
        .max_by(|a, b| a.local_amplitude.total_cmp(&b.local_amplitude));
    let mut finding =
        GearFinding { member: (!one_to_one).then_some(side), ..GearFinding::default() };
    if let Some(reading) = reading.filter(|r| r.has_angle) {
        let offset =
            context.machine.sensors.iter().find_map(|s| s.tacho).map_or(0.0, |t| t.offset_deg);
        let angle = (reading.localisation.centre_rev * 360.0 + offset).rem_euclid(360.0);
        finding.angle_deg = Some(angle);
        finding.source_zero_crossing_deg = Some(reading.zero_crossing_deg);
        finding.tooth = member.tooth_1_at_deg.map(|at| tooth(angle, at, member.teeth));
    }
    finding
}

/// tooth = 1 + round((angle − tooth_1_at)·z/360) mod z.
fn tooth(angle_deg: f64, tooth_1_at_deg: f64, teeth: u32) -> u32 {
    let steps = ((angle_deg - tooth_1_at_deg) * f64::from(teeth) / 360.0)
        .round()
        .rem_euclid(f64::from(teeth));
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 ≤ steps < teeth"
    )]
    let steps = steps as u32;
    1 + steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn teeth_are_counted_from_tooth_one_around_the_circle() {
        assert_eq!(tooth(0.0, 0.0, 28), 1);
        assert_eq!(tooth(360.0 / 28.0, 0.0, 28), 2);
        assert_eq!(tooth(359.0, 0.0, 28), 1);
        assert_eq!(tooth(0.0, 360.0 / 28.0, 28), 28);
    }
}
