//! Verdict on a shaft: by its probe where there is one, else by what the housing shows.

use super::NAMED_CONFIDENCE;
use super::TURNED_CONFIDENCE;
use super::UNNAMED_CONFIDENCE;
use super::accuse_at;
use super::acquit;
use super::alone;
use super::cannot_look;
use super::cause;
use super::cause::Cause;
use super::higher;
use super::run;
use super::signs::Indicator;
use super::signs::ShaftSigns;
use super::turned::Turned;
use crate::diagnosis::Context;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::Detector;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Evidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::orbit;
use crate::features::shaft;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::units::Hz;
use crate::units::Unit;

/// Unbalance is excluded when the eccentricity it would need exceeds ten times the ISO 21940-11
/// grade G 40: e·ω = 40 mm/s.
const ECCENTRICITY_SPEED_MM_PER_S: f64 = 400.0;

/// The rule holds well below the first critical speed only.
const MAX_SPEED_PER_CRITICAL: f64 = 0.3;

/// What is said where a probe sees a rise of which nothing tells the cause, and where a housing does.
const NOT_PROVEN: &str = ", cause not proven";
const NOT_SEPARABLE: &str = "; unbalance, bow and coupling are not separable without a probe";

pub(super) fn judge_shaft(
    shaft: ShaftIndex,
    signs: &ShaftSigns,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> ComponentDiagnosis {
    let id = &context.machine.shaft(shaft).id;
    let mut verdict = ComponentDiagnosis::undetermined(id, ComponentKind::Shaft, String::new());
    if features.speed.is_transient() {
        run::judge_run(&mut verdict, shaft, features, context);
        return verdict;
    }
    let probe = context
        .machine
        .sensors
        .iter()
        .zip(context.channel_of_sensor)
        .any(|(s, channel)| s.kind == SensorKind::Proximitor && channel.is_some());
    let without = if probe {
        "no baseline to compare the displacement with"
    } else {
        "no proximity probe and no baseline"
    };
    if let Some(why) = cannot_look(features, context, without) {
        verdict.why = why;
        run::judge_by_run(&mut verdict, shaft, features, context);
        return verdict;
    }
    let indicators = [&signs.displacement, &signs.cwt, &signs.housing];
    verdict.evidence =
        indicators.iter().filter_map(|i| i.as_ref()).map(|i| i.evidence.clone()).collect();
    verdict.evidence.extend(signs.turned.iter().map(|turned| turned.indicator.evidence.clone()));
    match &signs.displacement {
        Some(d) if d.is_up() => {
            accuse_by_probe(&mut verdict, shaft, (d, &signs.turned), features, context);
        }
        Some(d) => {
            let why = format!("1× displacement is {:.2} times its baseline", d.ratio);
            acquit(&mut verdict, d.ratio, why, features);
            look_higher(&mut verdict, signs, SensorKind::Proximitor, features);
            if let Some(turned) = signs.most_turned() {
                turned.accuse(&mut verdict, features);
            }
        }
        None if run::judge_by_run(&mut verdict, shaft, features, context) => {}
        None => judge_by_housing(&mut verdict, shaft, signs, features, context),
    }
    verdict
}

/// A probe sees more 1× than the baseline: bow, unbalance or neither proven.
fn accuse_by_probe(
    verdict: &mut ComponentDiagnosis,
    shaft: ShaftIndex,
    (once, turned): (&Indicator, &[Turned]),
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let speed = features.speed.first.and_then(|first| context.machine.shaft_speed(shaft, first));
    let told = speed.map_or(Cause::Open, |speed| cause::cause(shaft, speed, features, context));
    let excluded = excludes_unbalance(shaft, (once, turned), features, context);
    let with_others = alone::rises_with_others(shaft, once, features, context);
    let alone = alone::rises(shaft, once, features, context)
        .filter(|_| !is_near_critical(shaft, features, context));
    let (fault, named, said) = match (told, excluded) {
        (Cause::Bow, _) if !with_others => {
            (Some(FaultMode::Bow), NAMED_CONFIDENCE, told.sentence())
        }
        (Cause::Unbalance, None) if !with_others => {
            (Some(FaultMode::Unbalance), NAMED_CONFIDENCE, told.sentence())
        }
        (Cause::Both | Cause::Open, Some(by)) if !with_others => {
            (Some(FaultMode::Bow), by.confidence(), by.sentence())
        }
        (Cause::Both, _) => (None, UNNAMED_CONFIDENCE, told.sentence()),
        (Cause::Bow | Cause::Unbalance, _) => (None, UNNAMED_CONFIDENCE, NOT_PROVEN),
        (Cause::Open, _) => alone.map_or((None, UNNAMED_CONFIDENCE, NOT_PROVEN), |alone| {
            (Some(FaultMode::Unbalance), alone.confidence(), alone.sentence())
        }),
    };
    accuse_at(verdict, once, (fault, named), features);
    if let Some(speed) = speed {
        verdict.evidence.extend(cause::evidence(shaft, speed, features, context));
        verdict.evidence.extend(orbit_evidence(shaft, speed, features, context));
    }
    verdict.why = format!(
        "1× displacement is {:.1} times its baseline in {}{said}",
        once.ratio, once.evidence.channel
    );
}

/// Takes back the verdict of health on a shaft of which 2× or 3× has risen: accused without a cause, or open where a gear of its speed, whose
/// tooth strikes once a turn, raises them too (J9).
fn look_higher(
    verdict: &mut ComponentDiagnosis,
    signs: &ShaftSigns,
    kind: SensorKind,
    features: &WindowFeatures,
) {
    let Some(risen) = signs.higher.as_ref().filter(|risen| risen.is_up() && risen.stands_out())
    else {
        return;
    };
    verdict.evidence.push(risen.evidence.clone());
    let text = higher::sentence(risen, kind);
    if signs.local.is_empty() {
        accuse_at(verdict, risen, (None, UNNAMED_CONFIDENCE), features);
        verdict.why = format!("{text}; cause not proven");
    } else {
        verdict.leave_open(format!("{text}, and so may its gear: not accused"));
    }
}

/// What of the orbit turns with the shaft and what against it, where a pair of probes shows it.
fn orbit_evidence(
    shaft: ShaftIndex,
    speed: Hz,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let id = &context.machine.shaft(shaft).id;
    let of_channel = |channel: &ChannelFeatures| {
        let part = |(forward, order): (bool, u8)| {
            let name = orbit::name(forward, order, id);
            let found = channel.values.iter().find(|f| *f.name == name)?;
            Some(Evidence {
                indicator: name,
                channel: context.channel_name(channel.channel).to_owned(),
                detector: Some(Detector::ZeroToPeak),
                frequency: Some(Hz(f64::from(order) * speed.0)),
                expected: None,
                order: Some(f64::from(order)),
                value: found.value,
                unit: found.unit,
                threshold: None,
                false_alarm_probability: None,
                sample_range: Some(channel.sample_range),
            })
        };
        [(true, 1), (false, 1), (true, 2), (false, 2)].map(part)
    };
    features.channels.iter().flat_map(of_channel).flatten().collect()
}

/// Judges a shaft that no probe observes: the joint table's last row.
pub(super) fn judge_by_housing(
    verdict: &mut ComponentDiagnosis,
    shaft: ShaftIndex,
    signs: &ShaftSigns,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    // Two looks at the same rise: the larger ratio, its probability doubled.
    let once = [&signs.cwt, &signs.housing].into_iter().flatten();
    let Some(mut once) = once.max_by(|a, b| a.ratio.total_cmp(&b.ratio)).cloned() else {
        verdict.why = "the baseline has no 1× amplitude of this shaft".to_owned();
        return;
    };
    once.probability = (2.0 * once.probability).min(1.0);
    let text = format!(
        "1× on the housing is {:.2} times its baseline in {}",
        once.ratio, once.evidence.channel
    );
    let local_up = signs.local.iter().any(|(_, i)| i.as_ref().is_some_and(Indicator::is_up));
    if !once.is_up() {
        acquit(verdict, once.ratio, text, features);
        look_higher(verdict, signs, SensorKind::Accelerometer, features);
    } else if !once.stands_out() {
        verdict.why = format!("{text}, but the whole channel rose with it");
    } else if signs.local.is_empty() {
        let alone = alone::rises(shaft, &once, features, context)
            .filter(|_| !is_near_critical(shaft, features, context));
        let (told, cause) = match alone {
            Some(alone) => ((Some(FaultMode::Unbalance), alone.confidence()), alone.sentence()),
            None => ((None, UNNAMED_CONFIDENCE), NOT_SEPARABLE),
        };
        accuse_at(verdict, &once, told, features);
        verdict.why = format!("{text}{cause}");
    } else if local_up {
        verdict.why =
            format!("{text}, explained by the gear; a shaft fault beside it needs a probe");
    } else {
        verdict.why = format!("{text}; shaft and gear are not separable without a probe");
    }
}

/// Whether the shaft turns so near its first critical speed that a bow moves it like an unbalance, and
/// neither can be told (J4).
pub(super) fn is_near_critical(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    speed_per_critical(shaft, features, context).is_some_and(|(_, r)| r >= MAX_SPEED_PER_CRITICAL)
}

/// Speed of a shaft, and what part of its first critical speed that is.
fn speed_per_critical(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<(Hz, f64)> {
    let speed = context.machine.shaft_speed(shaft, features.speed.first?)?;
    let critical = context.machine.shaft(shaft).first_critical?;
    Some((speed, speed.0 / critical.0))
}

/// By what an unbalance is excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Excluded {
    /// By how much larger 1× is than in the baseline.
    BySize,
    /// Only if what was there before is subtracted as the vector it was.
    ByVector,
}

impl Excluded {
    fn confidence(self) -> f64 {
        match self {
            Self::BySize => NAMED_CONFIDENCE,
            Self::ByVector => TURNED_CONFIDENCE,
        }
    }

    fn sentence(self) -> &'static str {
        match self {
            Self::BySize => "; unbalance would need more than ten times G 40",
            Self::ByVector => {
                "; with what was there before, which points elsewhere unless mark or probe were moved since, unbalance would need more \
                 than ten times G 40"
            }
        }
    }
}

/// By what it is known that the 1× displacement needs an eccentricity no unbalance has: e = A(1 − r²)/r² above ten
/// times G 40 (docs/theory.md, J2).
fn excludes_unbalance(
    shaft: ShaftIndex,
    (once, turned): (&Indicator, &[Turned]),
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Excluded> {
    let (speed, r) = speed_per_critical(shaft, features, context)?;
    if r >= MAX_SPEED_PER_CRITICAL || r <= 0.0 {
        return None;
    }
    let name = shaft::line_name(1, &context.machine.shaft(shaft).id);
    let amplitude_um = features
        .channels
        .iter()
        .filter(|c| context.channel_name(c.channel) == once.evidence.channel)
        .filter(|c| context.channels[c.channel.0].unit == Unit::Micrometre)
        .filter_map(|c| c.get(&name))
        .fold(0.0, f64::max);
    // What was there in good health, run-out first of all, is no part of it.
    let is_too_much = |grown: f64| {
        let eccentricity_um = amplitude_um * grown / once.ratio * (1.0 - r * r) / (r * r);
        eccentricity_um * 1e-3 * speed.to_rad_per_s().0 > ECCENTRICITY_SPEED_MM_PER_S
    };
    let of_channel = |turned: &&Turned| turned.indicator.evidence.channel == once.evidence.channel;
    let as_vector = turned.iter().find(of_channel).map(|turned| turned.change);
    if is_too_much(once.ratio - 1.0) {
        Some(Excluded::BySize)
    } else {
        as_vector.filter(|change| is_too_much(*change)).map(|_| Excluded::ByVector)
    }
}
