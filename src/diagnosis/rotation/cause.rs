//! Bow or unbalance, by what a run showed of the speed law: the cause of a 1× that is up, and verdicts on windows in which the
//! speed changes. Must not know how the vectors were read.

use super::UP_RATIO;
use super::signs;
use super::signs::Indicator;
use crate::diagnosis::Context;
use crate::diagnosis::baseline::Comparison;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::run_up;
use crate::features::run_up::Fit;
use crate::features::run_up::IMPLAUSIBLE;
use crate::features::run_up::Known;
use crate::features::run_up::Part;
use crate::features::run_up::ShaftLaw;
use crate::features::shaft;
use crate::machine::ShaftIndex;
use crate::units::Hz;
use crate::units::Unit;

/// Of the vectors at most this part (root mean square) may stay unexplained: else they follow another law.
const MOST_UNEXPLAINED: f64 = 0.3;

/// Standard deviations by which a part may be smaller or larger than it was read: 2.3 % on either side.
const SURE: f64 = 2.0;

/// What the speed law says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    /// What is there at standstill moves the shaft, what rises with speed does not.
    Bow,
    /// The reverse.
    Unbalance,
    /// Both are there, and neither leads.
    Both,
    /// The vectors do not tell.
    Open,
}

impl Cause {
    /// What is said of it.
    pub(super) fn sentence(self) -> &'static str {
        match self {
            Self::Bow => {
                "; over the speeds of the run it stays what it is at standstill, as of a bow, and hardly grows with the square of the speed"
            }
            Self::Unbalance => {
                "; over the speeds of the run it grows with the square of the speed, as of an unbalance, and is little at standstill"
            }
            Self::Both => {
                "; over the speeds of the run one part stays as at standstill and one grows with the square of the speed: bow and \
                 unbalance, cause not proven"
            }
            Self::Open => "",
        }
    }
}

/// What the law predicts of 1× at a steady speed may be off by this part: else the shaft has changed since its run.
const PREDICTED: f64 = 0.3;

/// The laws that probes of `shaft` read, and that say of this window's speed what its 1× is.
fn laws<'a>(
    shaft: ShaftIndex,
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Vec<&'a ShaftLaw> {
    let name = shaft::line_name(1, &context.machine.shaft(shaft).id);
    let predicts = |law: &&ShaftLaw| {
        if features.speed.is_transient() {
            return true;
        }
        let first = features.speed.first;
        let speed = first.and_then(|first| context.machine.shaft_speed(shaft, first));
        let now = features.channel(law.channel).and_then(|channel| channel.get(&name));
        let best = law.law.fits.first();
        let predicted = best.zip(speed).and_then(|(fit, speed)| fit.whole_at(speed.0));
        now.zip(predicted).is_some_and(|(now, whole)| (now - whole).abs() <= PREDICTED * now)
    };
    features.laws.iter().filter(|law| law.shaft == shaft).filter(predicts).collect()
}

/// Highest speed at which probes of a shaft saw it run; `None` without a run.
pub(super) fn top(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Hz> {
    laws(shaft, features, context)
        .iter()
        .map(|law| Hz(law.law.speeds_hz.1))
        .max_by(|a, b| a.0.total_cmp(&b.0))
}

/// What is said of a run whose vectors have no phase; empty of one that a mark gives.
pub(super) fn by_what(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> &'static str {
    let is_by_lengths = |law: &&ShaftLaw| law.law.known == Known::Lengths;
    if laws(shaft, features, context).iter().any(is_by_lengths) {
        " (by amplitudes alone: no mark on the shaft)"
    } else {
        ""
    }
}

/// What the probes of a shaft say of its 1× at a speed (J6): their common word, both parts if they contradict each other. A bow only
/// where the critical speed is declared: far above it an unbalance stays the same as a bow does below.
pub(super) fn cause(
    shaft: ShaftIndex,
    speed: Hz,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Cause {
    let laws = laws(shaft, features, context);
    let looks = laws.len() as f64;
    let mut told: Vec<Cause> = laws.iter().map(|law| cause_of(law, speed, looks)).collect();
    told.retain(|cause| *cause != Cause::Open);
    let common = match told.as_slice() {
        [] => Cause::Open,
        [first, rest @ ..] if rest.iter().all(|cause| cause == first) => *first,
        [_, ..] => Cause::Both,
    };
    let is_below = context.machine.shaft(shaft).first_critical.is_some();
    if common == Cause::Bow && !is_below { Cause::Open } else { common }
}

/// What one probe says: every plausible fit must say it.
fn cause_of(law: &ShaftLaw, speed: Hz, looks: f64) -> Cause {
    let mut told = law.law.fits.iter().map(|fit| cause_by(fit, speed, looks));
    let Some(first) = told.next() else { return Cause::Open };
    if told.all(|cause| cause == first) { first } else { Cause::Open }
}

/// What one fit says. The other cause alone is refused by its chance (`IMPLAUSIBLE` for all looks), and its part at this speed, as
/// large as it may be, is less than a third of the named one's, as small as it may be: too little to be up.
fn cause_by(fit: &Fit, speed: Hz, looks: f64) -> Cause {
    if fit.unexplained > MOST_UNEXPLAINED {
        return Cause::Open;
    }
    let needed = |part: Part| part.chance * looks <= IMPLAUSIBLE;
    let ((bow, of_bow), (unbalance, of_unbalance)) =
        (fit.bow_at(speed.0), fit.unbalance_at(speed.0));
    // Resonance raises both alike: above the critical speed both have turned by half a turn.
    let (bow, unbalance) = (bow.abs(), unbalance.abs());
    let leads = |leader: (f64, f64), other: (f64, f64)| {
        UP_RATIO * (other.0 + SURE * other.1) <= leader.0 - SURE * leader.1
    };
    let (of_bow, of_unbalance) = (of_bow.abs(), of_unbalance.abs());
    match (needed(fit.bow), needed(fit.unbalance)) {
        (true, _) if leads((bow, of_bow), (unbalance, of_unbalance)) => Cause::Bow,
        (_, true) if leads((unbalance, of_unbalance), (bow, of_bow)) => Cause::Unbalance,
        (true, true) => Cause::Both,
        (_, _) => Cause::Open,
    }
}

/// The parts at a speed as evidence, by the best fit of every probe.
pub(super) fn evidence(
    shaft: ShaftIndex,
    speed: Hz,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let laws = laws(shaft, features, context);
    let looks = laws.len() as f64;
    let of_law = |law: &&ShaftLaw| {
        let fit = law.law.fits.first()?;
        let channel = context.channel_name(law.channel);
        let part = |indicator: &str, value: f64, chance: f64| Evidence {
            indicator: indicator.to_owned(),
            channel: channel.to_owned(),
            detector: None,
            frequency: Some(speed),
            expected: None,
            order: Some(1.0),
            value,
            unit: Unit::Micrometre,
            threshold: None,
            false_alarm_probability: Some((chance * looks + IMPLAUSIBLE).min(1.0)),
            sample_range: features.channel(law.channel).map(|c| c.sample_range),
        };
        Some([
            part("bow_part_1x", fit.bow_at(speed.0).0.abs(), fit.bow.chance),
            part("unbalance_part_1x", fit.unbalance_at(speed.0).0.abs(), fit.unbalance.chance),
        ])
    };
    laws.iter().filter_map(of_law).flatten().collect()
}

/// One part of a run against that of healthy runs.
#[derive(Debug, Clone)]
pub(super) struct Grown {
    /// By the smallest that the vectors allow.
    pub(super) least: Indicator,
    /// Ratio of the largest that they allow.
    pub(super) most: f64,
}

/// Bow and unbalance of a shaft against the baseline's runs, by one probe.
#[derive(Debug, Clone)]
pub(super) struct Growth {
    pub(super) bow: Grown,
    pub(super) unbalance: Grown,
    /// Highest speed of the run's vectors.
    pub(super) top: Hz,
}

impl Growth {
    /// The part that has grown more.
    pub(super) fn larger(&self) -> &Indicator {
        let [bow, unbalance] = [&self.bow.least, &self.unbalance.least];
        if bow.ratio >= unbalance.ratio { bow } else { unbalance }
    }

    /// Whether neither part can have grown so much as to be up.
    pub(super) fn is_calm(&self) -> bool {
        self.bow.most < UP_RATIO && self.unbalance.most < UP_RATIO
    }
}

/// How the parts of a run compare with healthy runs (J7): each with the whole that those have at the highest speed of this one, by
/// the probe in which one has grown most; `None` without a law here or there.
pub(super) fn growth(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Growth> {
    let laws = laws(shaft, features, context);
    let looks = 2.0 * laws.len() as f64;
    let id = &context.machine.shaft(shaft).id;
    let names = (run_up::bow_name(id), run_up::unbalance_name(id));
    let by_probe = laws.iter().filter_map(|law| {
        let channel = context.channel_name(law.channel);
        let top = Hz(law.law.speeds_hz.1);
        // What 1 µm is of the healthy parts; resonance raises both alike and cancels.
        let (bow, unbalance) = (
            context.runs.compare(channel, &names.0, 1.0)?,
            context.runs.compare(channel, &names.1, 1.0)?,
        );
        let rise = run_up::rise(top);
        let whole_um = 1.0 / bow.ratio + rise / unbalance.ratio;
        let sigma = bow.sigma.max(unbalance.sigma);
        let grown = |name: &str, of: fn(&Fit) -> Part, rise: f64| {
            let of_one = Comparison { ratio: rise / whole_um, sigma, n_records: bow.n_records };
            grown(law, (name, of), (of_one, looks), features, context)
        };
        Some(Growth {
            bow: grown(&names.0, |fit| fit.bow, 1.0)?,
            unbalance: grown(&names.1, |fit| fit.unbalance, rise)?,
            top,
        })
    });
    by_probe.max_by(|a, b| a.larger().ratio.total_cmp(&b.larger().ratio))
}

/// One part of a law against what 1 µm of it is, every plausible fit heard.
fn grown(
    law: &ShaftLaw,
    (name, of): (&str, fn(&Fit) -> Part),
    (of_one, looks): (Comparison, f64),
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Grown> {
    let channel = features.channel(law.channel)?;
    let parts = || law.law.fits.iter().map(of);
    let amplitude = |part: Part, sigmas: f64| (part.vector.norm() + sigmas * part.sigma).max(0.0);
    let most = parts().map(|part| amplitude(part, SURE)).fold(0.0, f64::max);
    let least = parts().map(|part| amplitude(part, -SURE)).fold(f64::INFINITY, f64::min);
    let of_least = Comparison { ratio: of_one.ratio * least, ..of_one };
    let channel_name = context.channel_name(law.channel);
    let mut sign = signs::indicator(name, channel_name, channel, of_least, features);
    let chance = parts().map(|part| part.chance).fold(0.0, f64::max) + sign.probability;
    sign.probability = (chance * looks).min(1.0);
    sign.evidence.false_alarm_probability = Some(sign.probability);
    sign.evidence.frequency = Some(Hz(law.law.speeds_hz.1));
    sign.evidence.order = Some(1.0);
    Some(Grown { least: sign, most: of_one.ratio * most })
}
