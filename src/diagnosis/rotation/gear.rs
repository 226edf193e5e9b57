//! Verdict on a gear: energy that stays at one place of the revolution.

use super::Beside;
use super::accuse;
use super::acquit;
use super::cannot_look;
use super::gear_figures;
use super::gear_place;
use super::gear_place::Growth;
use super::gear_place::Owner;
use super::gear_place::Wear;
use super::shaft::is_near_critical;
use super::signs::Indicator;
use super::signs::ShaftSigns;
use super::signs::same_speed;
use crate::diagnosis::Context;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::GearSide;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::GearFinding;
use crate::features::WindowFeatures;
use crate::features::gear::GearReading;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use crate::machine::bearing::RotatingRing;

pub(super) fn judge_gear(
    gear: GearIndex,
    beside: Beside<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> ComponentDiagnosis {
    let all_signs = beside.shafts;
    let id = &context.machine.gear(gear).id;
    let mut verdict = ComponentDiagnosis::undetermined(id, ComponentKind::Gear, String::new());
    if let Some(why) = cannot_look(features, context, "no baseline") {
        verdict.why = why;
        return verdict;
    }
    let local = strongest_local(gear, all_signs);
    let Some((shaft, signs, local)) = local else {
        verdict.why =
            "no synchronous average, here or in the baseline: a tacho, or a speed confirmed by shaft harmonics and a mesh that \
             keeps its phase, is needed"
                .to_owned();
        return verdict;
    };
    verdict.evidence = [Some(local), signs.cwt.as_ref()]
        .into_iter()
        .flatten()
        .map(|i| i.evidence.clone())
        .collect();
    let cwt_up = signs.cwt.as_ref().is_some_and(Indicator::is_up);
    let heard_in = local.evidence.channel.as_str();
    let reading = gear_place::reading((gear, shaft), local, features, context);
    if let Some(reading) = reading {
        verdict.evidence.extend(gear_figures::figures(reading, features, context));
    }
    let mesh = reading.and_then(|reading| mesh_growth(reading, features, context));
    let wear = mesh.as_ref().and_then(|mesh| mesh.wear.as_ref());
    let outgrows = gear_place::outgrows(local.ratio, mesh.as_ref());
    let at_one_tooth = reading.is_some_and(gear_place::is_one_tooth);
    if let Some(wear) = wear.filter(|_| !local.is_up() || !outgrows) {
        let is_moved = cwt_up || moved_by(shaft, all_signs, context).is_some();
        judge_wear(&mut verdict, wear, local, (at_one_tooth, is_moved), features);
        return verdict;
    }
    if !local.is_up() {
        not_up(&mut verdict, gear, local, all_signs, features, context);
        return verdict;
    }
    if let Some(moved) = shaken_by(shaft, all_signs, features, context) {
        verdict.why = format!(
            "the localised difference signal is {:.1} times its baseline, but {moved} whirls near its first critical \
             speed and strikes the mesh once a turn: not separable",
            local.ratio
        );
        return verdict;
    }
    let is_short = || reading.is_some_and(|r| gear_place::is_short(r, features, context));
    if let Some(bearing) = struck_by(shaft, beside.bearings, context).filter(|_| !is_short()) {
        verdict.why = format!(
            "the localised difference signal is {:.1} times its baseline in {heard_in}, but not in all orders, and the \
             defect of bearing {bearing} comes into the load once a turn: not separable",
            local.ratio
        );
        return verdict;
    }
    if !at_one_tooth {
        let beside_it = if cwt_up { "though 1× is up" } else { "with 1× not up" };
        verdict.why = format!(
            "the difference signal of the synchronous average is {:.1} times its baseline in {heard_in}, but all round the \
             revolution, {beside_it}: orders that are no mesh, or all teeth; no single tooth",
            local.ratio
        );
        return verdict;
    }
    let named = (gear, shaft, reading);
    accuse_of_a_tooth(&mut verdict, named, (local, cwt_up), features, context);
    verdict
}

/// The strongest localised sign of a gear over any shaft.
fn strongest_local(
    gear: GearIndex,
    all_signs: &[ShaftSigns],
) -> Option<(ShaftIndex, &ShaftSigns, &Indicator)> {
    all_signs
        .iter()
        .enumerate()
        .flat_map(|(s, signs)| signs.local.iter().map(move |(g, i)| (ShaftIndex(s), signs, *g, i)))
        .filter(|(_, _, g, _)| *g == gear)
        .filter_map(|(s, signs, _, i)| i.as_ref().map(|i| (s, signs, i)))
        .max_by(|a, b| a.2.ratio.total_cmp(&b.2.ratio))
}

/// Tooth damage, with member, angle and tooth as far as they are known.
fn accuse_of_a_tooth(
    verdict: &mut ComponentDiagnosis,
    (gear, shaft, reading): (GearIndex, ShaftIndex, Option<&GearReading>),
    (local, cwt_up): (&Indicator, bool),
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let heard_in = local.evidence.channel.as_str();
    accuse(verdict, local, Some(FaultMode::ToothDamage), features);
    verdict.why = format!(
        "the difference signal of the synchronous average is {:.1} times its baseline at one place of the revolution in {heard_in}{}",
        local.ratio,
        if cwt_up { ", with 1× up" } else { "" }
    );
    let owner =
        reading.map_or(Owner::Shaft(shaft), |r| gear_place::owner(gear, r, features, context));
    let found = match owner {
        Owner::Shaft(shaft) => {
            let at = reading.and_then(|r| gear_place::clearest(r, shaft, features, context));
            finding(gear, shaft, at, context)
        }
        Owner::Unclear => GearFinding::default(),
    };
    if let Some(why) = why_no_tooth(owner, &found, features, context) {
        verdict.why = format!("{}; no tooth is told: {why}", verdict.why);
    }
    verdict.gear = Some(found);
}

/// Why a damage has no tooth, or not even an angle; `None` if it has both.
fn why_no_tooth(
    owner: Owner,
    found: &GearFinding,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<String> {
    let Owner::Shaft(shaft) = owner else {
        return Some("it shows in the averages over both shafts".to_owned());
    };
    let id = &context.machine.shaft(shaft).id;
    let is_as_first = same_speed(shaft, ShaftIndex(0), context);
    match (found.angle_deg, found.tooth) {
        (Some(_), Some(_)) => None,
        (None, _) if !is_as_first => Some(
            "angles are told of shafts alone that turn as the first one of the machine file"
                .to_owned(),
        ),
        (Some(_), None) => {
            Some(format!("tooth_1_at_deg of the gear on {id} is not in the machine file"))
        }
        (None, _) if features.speed.phase.as_ref().is_some_and(|phase| !phase.is_marked) => {
            Some("the tacho gives several pulses a revolution".to_owned())
        }
        (None, _) => Some(format!("no tacho marks {id}")),
    }
}

/// Growth of the mesh harmonics in the channel of an average.
fn mesh_growth(
    reading: &GearReading,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Growth> {
    let channel = features.channels.iter().find(|c| c.channel == reading.channel)?;
    gear_place::growth(reading, channel, context)
}

/// The higher mesh harmonics have grown and no tooth more than the mesh: wear of all teeth, unless one tooth stands out,
/// which raises all orders, or 1× is up, for a shaft that moves misaligns the mesh.
fn judge_wear(
    verdict: &mut ComponentDiagnosis,
    wear: &Wear,
    local: &Indicator,
    (at_one_tooth, is_moved): (bool, bool),
    features: &WindowFeatures,
) {
    let grown = format!(
        "every higher mesh harmonic is {:.1} times its baseline or more in {}, the fundamental less than half of that",
        wear.ratio, local.evidence.channel
    );
    verdict.evidence.extend(wear.evidence.iter().cloned());
    if is_moved {
        verdict.why = format!(
            "{grown}, but 1× is up, and a shaft that moves misaligns the mesh: not separable"
        );
        return;
    }
    let by = Indicator { ratio: wear.ratio, probability: wear.probability, ..local.clone() };
    let (fault, what) = if at_one_tooth {
        (None, "; one tooth stands out of the others, which raises them as well: cause not proven")
    } else {
        (Some(FaultMode::DistributedWear), ", and no tooth stands out of the mesh")
    };
    accuse(verdict, &by, fault, features);
    verdict.why = format!("{grown}{what}");
}

/// Healthy, or the other member could not be looked at.
fn not_up(
    verdict: &mut ComponentDiagnosis,
    gear: GearIndex,
    local: &Indicator,
    all_signs: &[ShaftSigns],
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let described = context.machine.gear(gear);
    let missing = [&described.driving, &described.driven].into_iter().find(|member| {
        let of_member = &all_signs[member.shaft.0].local;
        !of_member.iter().any(|(g, sign)| *g == gear && sign.is_some())
    });
    if let Some(member) = missing {
        let id = &context.machine.shaft(member.shaft).id;
        verdict.why = format!("the gear on {id} could not be averaged: its angle is not known");
        return;
    }
    let why = format!("the localised difference signal is {:.2} times its baseline", local.ratio);
    let why = if local.ratio >= super::UP_RATIO && local.probability >= 1.0 {
        format!("{why}, but does not stay at one place of the revolution")
    } else {
        why
    };
    acquit(verdict, local.ratio, why, features);
}

/// A shaft of the mesh's speed whose displacement is up.
fn moved_by(
    shaft: ShaftIndex,
    all_signs: &[ShaftSigns],
    context: &Context<'_>,
) -> Option<ShaftIndex> {
    let moves = |s: &ShaftIndex| {
        same_speed(*s, shaft, context)
            && all_signs[s.0].displacement.as_ref().is_some_and(Indicator::is_up)
    };
    (0..all_signs.len()).map(ShaftIndex).find(moves)
}

/// The id of a bearing at the mesh's speed whose turning race is damaged, or may be (J8).
fn struck_by<'b>(
    shaft: ShaftIndex,
    bearings: &'b [ComponentDiagnosis],
    context: &Context<'_>,
) -> Option<&'b str> {
    let is_struck = |verdict: &&ComponentDiagnosis| {
        let described = context.machine.bearings.iter().find(|b| b.id == verdict.id);
        let Some(bearing) = described.filter(|_| verdict.state.is_accusation()) else {
            return false;
        };
        let turning = match bearing.rotating_ring {
            RotatingRing::Inner => FaultMode::InnerRace,
            RotatingRing::Outer => FaultMode::OuterRace,
        };
        let is_turning = verdict.fault.is_none_or(|fault| fault == turning)
            || verdict.other_faults.iter().any(|other| other.fault == turning);
        is_turning && same_speed(bearing.shaft, shaft, context)
    };
    bearings.iter().find(is_struck).map(|verdict| verdict.id.as_str())
}

/// The id of a shaft of the mesh's speed whose own motion loads the mesh once a turn: its displacement is
/// up, and so near the critical speed it is the run-out of its gears.
fn shaken_by<'m>(
    shaft: ShaftIndex,
    all_signs: &[ShaftSigns],
    features: &WindowFeatures,
    context: &Context<'m>,
) -> Option<&'m str> {
    let moving = moved_by(shaft, all_signs, context);
    let found = moving.filter(|s| is_near_critical(*s, features, context))?;
    Some(context.machine.shaft(found).id.as_str())
}

/// Member, angle and tooth, as far as the average tells.
pub(super) fn finding(
    gear: GearIndex,
    shaft: ShaftIndex,
    reading: Option<&GearReading>,
    context: &Context<'_>,
) -> GearFinding {
    let described = context.machine.gear(gear);
    let one_to_one = same_speed(described.driving.shaft, described.driven.shaft, context);
    let (side, member) = if same_speed(described.driving.shaft, shaft, context) {
        (GearSide::Driving, &described.driving)
    } else {
        (GearSide::Driven, &described.driven)
    };
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
pub(super) fn tooth(angle_deg: f64, tooth_1_at_deg: f64, teeth: u32) -> u32 {
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
