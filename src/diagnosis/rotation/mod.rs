//! Shafts and gears, judged jointly: "something once a revolution" does not name the part.
//!
//! Displacement at 1×, CWT amplitude at 1× and the localised difference signal, each against the
//! baseline, are read together in the joint table of docs/theory.md (J1). What was not measured
//! leaves the parts it would separate undetermined.

mod signs;
mod turned;
mod cause;
mod alone;
mod higher;
mod shaft;
mod run;
mod gear;
mod gear_signs;
mod gear_figures;
mod gear_place;

use super::Context;
use super::confidence;
use super::fault::FaultMode;
use super::fault::State;
use super::severity;
use super::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use signs::Indicator;
use signs::ShaftSigns;

/// Ratio to baseline that counts as "up": what a healthy straight shaft stays below with other parts
/// damaged (≤ 3), far under what a bow or a worn tooth shows.
pub const UP_RATIO: f64 = 3.0;

/// Ratio that counts as damaged: ten times "up".
pub const DAMAGED_RATIO: f64 = 30.0;

/// Most confidence in an unbalance: a bow is not excluded.
const UNBALANCE_CONFIDENCE: f64 = 0.8;

/// Most confidence in an unbalance whose 2× and 3× lie beyond the sampling: misalignment and looseness are not excluded either.
const UNBALANCE_BY_1X_CONFIDENCE: f64 = 0.6;

/// Most confidence in a rise whose cause is not proven.
const UNNAMED_CONFIDENCE: f64 = 0.9;

/// Most confidence in a 1× that only points elsewhere: a mark or a probe that was moved turns it as well.
const TURNED_CONFIDENCE: f64 = 0.6;

/// Most confidence in a cause that is proven.
const NAMED_CONFIDENCE: f64 = 0.85;

/// Judges every shaft and gear; `bearings`: what was said of the bearings before.
#[must_use]
pub fn judge(
    features: &WindowFeatures,
    bearings: &[ComponentDiagnosis],
    context: &Context<'_>,
) -> Vec<ComponentDiagnosis> {
    let machine = context.machine;
    let signs: Vec<ShaftSigns> =
        (0..machine.shafts.len()).map(|s| signs::signs(ShaftIndex(s), features, context)).collect();
    let mut verdicts: Vec<ComponentDiagnosis> = signs
        .iter()
        .enumerate()
        .map(|(s, signs)| shaft::judge_shaft(ShaftIndex(s), signs, features, context))
        .collect();
    let beside = Beside { shafts: &signs, bearings };
    verdicts.extend(
        (0..machine.gears.len()).map(|g| gear::judge_gear(GearIndex(g), beside, features, context)),
    );
    verdicts.iter_mut().for_each(|verdict| context.baseline.qualify(verdict));
    verdicts
}

/// What else is known of the machine when a gear is judged.
#[derive(Clone, Copy)]
struct Beside<'a> {
    /// Signs of every shaft.
    shafts: &'a [ShaftSigns],
    /// Verdicts on bearings.
    bearings: &'a [ComponentDiagnosis],
}

/// Whether a probe sees that a shaft moves more than it did: its 1× displacement is up.
#[must_use]
pub(super) fn is_moved(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let signs = signs::signs(shaft, features, &as_usual(context));
    signs.displacement.as_ref().is_some_and(Indicator::is_up)
}

/// The same context, in which a rise counts as there by the usual measure: what spares others need not be as sure as what accuses.
fn as_usual<'a>(context: &Context<'a>) -> Context<'a> {
    Context { false_alarm_probability: confidence::FALSE_ALARM_PROBABILITY, ..*context }
}

/// Whether anything tells that a shaft turns otherwise than it did and loads its bearings so: its 1× is up in a probe or a housing.
#[must_use]
pub(super) fn is_loaded_otherwise(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let signs = signs::signs(shaft, features, &as_usual(context));
    let once = [&signs.displacement, &signs.cwt, &signs.housing];
    once.into_iter().flatten().any(Indicator::is_up)
}

/// Why neither shaft nor gear can be judged, if so; `without`: what to say when no baseline was
/// offered.
fn cannot_look(features: &WindowFeatures, context: &Context<'_>, without: &str) -> Option<String> {
    if features.speed.first.is_none() {
        return Some("shaft speed is not known".to_owned());
    }
    if !context.baseline.records.is_empty() {
        return None;
    }
    if let Some(why) = context.void_baselines {
        return Some(format!("no baseline that can be used: {why}"));
    }
    let offered = context.offered_baselines > 0;
    let unfit = if features.load.is_some() {
        "no baseline at this speed and load"
    } else {
        "no baseline at this speed"
    };
    Some(if offered { unfit } else { without }.to_owned())
}

fn accuse(
    verdict: &mut ComponentDiagnosis,
    by: &Indicator,
    fault: Option<FaultMode>,
    features: &WindowFeatures,
) {
    let named = fault.map_or(UNNAMED_CONFIDENCE, |_| NAMED_CONFIDENCE);
    accuse_at(verdict, by, (fault, named), features);
}

/// Accuses with at most the confidence `named`.
fn accuse_at(
    verdict: &mut ComponentDiagnosis,
    by: &Indicator,
    (fault, named): (Option<FaultMode>, f64),
    features: &WindowFeatures,
) {
    let severity = severity::of_ratio(by.ratio, UP_RATIO, DAMAGED_RATIO);
    verdict.state = severity::state(severity);
    verdict.fault = fault;
    verdict.severity = Some(severity);
    verdict.confidence =
        Some(named * (0.5 + 0.5 * features.speed.confidence) * (1.0 - by.probability));
}

fn acquit(verdict: &mut ComponentDiagnosis, ratio: f64, why: String, features: &WindowFeatures) {
    verdict.state = State::Healthy;
    verdict.severity =
        Some(severity::not_accused(severity::of_ratio(ratio, UP_RATIO, DAMAGED_RATIO)));
    verdict.confidence = Some(0.85 * (0.5 + 0.5 * features.speed.confidence));
    verdict.why = why;
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod alone_tests;
#[cfg(test)]
mod higher_tests;
#[cfg(test)]
mod gear_tests;
#[cfg(test)]
mod run_tests;
#[cfg(test)]
mod turned_tests;
