//! The signs of one shaft, each a ratio to the baseline: displacement, CWT and housing line at 1×,
//! localised difference signal.

use super::UP_RATIO;
use super::gear_signs;
use super::higher;
use super::turned;
use super::turned::Turned;
use crate::diagnosis::Context;
use crate::diagnosis::baseline::Comparison;
use crate::diagnosis::confidence;
use crate::diagnosis::verdict::Evidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::gear;
use crate::features::overall;
use crate::features::shaft;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::units::Unit;

/// One indicator against the baseline, the strongest of its channels.
#[derive(Debug, Clone)]
pub(super) struct Indicator {
    /// Name of the feature.
    pub(super) name: String,
    pub(super) ratio: f64,
    pub(super) probability: f64,
    /// What the probability is held to.
    pub(super) allowed: f64,
    /// Ratio to baseline of what the shaft lines leave in the same channel.
    pub(super) rest: Option<f64>,
    pub(super) evidence: Evidence,
}

impl Indicator {
    /// Pays for so many chances to be in error.
    pub(super) fn pay_for(&mut self, chances: f64) {
        self.probability = (self.probability * chances).min(1.0);
        self.evidence.false_alarm_probability = Some(self.probability);
    }

    /// Whether the rise is more than that of everything else in the channel.
    pub(super) fn stands_out(&self) -> bool {
        self.ratio >= MORE_THAN_THE_REST * self.rest.unwrap_or(1.0).max(1.0)
    }

    pub(super) fn is_up(&self) -> bool {
        self.ratio >= UP_RATIO && self.probability <= self.allowed
    }
}

/// A 1× that tells of the shaft rises at least this much more than the rest of its channel (6 dB):
/// a changed gain or a machine that shakes altogether raises everything.
const MORE_THAN_THE_REST: f64 = 2.0;

/// Ways in which a shaft may be accused at one speed: by 1×, and by 2× or 3×; and by where 1× points, if that is known.
const N_WAYS: f64 = 2.0;
const N_WAYS_WITH_DIRECTION: f64 = 3.0;

/// Sensors of what a housing does.
const HOUSING: [SensorKind; 2] = [SensorKind::Accelerometer, SensorKind::Velocity];

/// What is known of one shaft.
pub(super) struct ShaftSigns {
    pub(super) displacement: Option<Indicator>,
    pub(super) cwt: Option<Indicator>,
    /// Change of the vector of 1×, by every probe that has it.
    pub(super) turned: Vec<Turned>,
    /// 1× line of the housings, single axis: what is left without a probe.
    pub(super) housing: Option<Indicator>,
    /// 2× or 3×, of the probes where they see 1×, else of the housings.
    pub(super) higher: Option<Indicator>,
    /// Localised difference signal of the gears on this shaft.
    pub(super) local: Vec<(GearIndex, Option<Indicator>)>,
}

impl ShaftSigns {
    /// All ways to accuse the shaft together have the declared probability.
    fn pay_for_ways(&mut self) {
        let n_ways = if self.turned.is_empty() { N_WAYS } else { N_WAYS_WITH_DIRECTION };
        let ways = [&mut self.displacement, &mut self.cwt, &mut self.housing, &mut self.higher];
        let turned = self.turned.iter_mut().map(|turned| &mut turned.indicator);
        ways.into_iter().flatten().chain(turned).for_each(|way| way.pay_for(n_ways));
    }

    /// The probe by which the shaft is accused of pointing elsewhere: in which its vector has changed most.
    pub(super) fn most_turned(&self) -> Option<&Turned> {
        let accusing = self.turned.iter().filter(|turned| turned.is_up());
        accusing.max_by(|a, b| a.change.total_cmp(&b.change))
    }
}

pub(super) fn signs(
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> ShaftSigns {
    let machine = context.machine;
    let id = &machine.shaft(shaft).id;
    let hears = |channel: &ChannelFeatures, kinds: &[SensorKind]| {
        let sensor =
            machine.sensors.iter().find(|s| s.channel == context.channel_name(channel.channel));
        sensor.is_some_and(|s| {
            kinds.contains(&s.kind)
                && machine.shaft_at(s).is_none_or(|at| same_speed(at, shaft, context))
        })
    };
    let of_kind = |kinds: &[SensorKind]| {
        features.channels.iter().filter(|c| hears(c, kinds)).collect::<Vec<_>>()
    };
    // What a probe sees is its own shaft's, not that of another that turns at the same speed.
    let sees = |channel: &&ChannelFeatures| observes(shaft, channel, context);
    let probes: Vec<&ChannelFeatures> =
        of_kind(&[SensorKind::Proximitor]).into_iter().filter(sees).collect();
    let housings = of_kind(&HOUSING);
    let line = shaft::line_name(1, id);
    // A 1× that is lost in noise has no ratio: its amplitude is the noise's, which scatters widely.
    let shows_line =
        |channel: &ChannelFeatures, _: &str| is_over_noise((shaft, 1), channel, features);
    let displacement =
        strongest(&probes, std::slice::from_ref(&line), features, context, &shows_line);
    let any = |_: &ChannelFeatures, _: &str| true;
    let single = shaft::cwt_name(id);
    let absolute = format!("absolute_{single}");
    let cwt = strongest(&housings, &[absolute], features, context, &any)
        .or_else(|| strongest(&housings, &[single], features, context, &any));
    let housing = strongest(&housings, &[line], features, context, &shows_line);
    let on_shaft = machine.gears.iter().enumerate().filter(|(_, g)| {
        [g.driving.shaft, g.driven.shaft].into_iter().any(|s| same_speed(s, shaft, context))
    });
    let local = on_shaft
        .map(|(g, described)| {
            let names: Vec<String> = [described.driving.shaft, described.driven.shaft]
                .into_iter()
                .filter(|s| same_speed(*s, shaft, context))
                .map(|s| &machine.shaft(s).id)
                .flat_map(|s| gear::Part::ALL.map(|part| gear::local_name(part, &described.id, s)))
                .collect();
            let gear = GearIndex(g);
            let heard = gear_signs::hearing_best(gear, &names, features, context);
            let persists = |c: &ChannelFeatures, name: &str| {
                gear_signs::persists((gear, shaft), c.channel, name, features, context)
            };
            (gear, strongest(&heard, &names, features, context, &persists))
        })
        .collect();
    let seen = if displacement.is_some() { &probes } else { &housings };
    let higher = higher::higher(shaft, seen, features, context);
    let turned = turned::turned(shaft, &probes, features, context);
    let mut signs = ShaftSigns { displacement, cwt, turned, housing, higher, local };
    signs.pay_for_ways();
    let speed = features.speed.first.and_then(|first| machine.shaft_speed(shaft, first));
    let once = [&mut signs.displacement, &mut signs.cwt, &mut signs.housing];
    let local = signs.local.iter_mut().map(|(_, i)| i);
    for indicator in once.into_iter().chain(local).flatten() {
        indicator.evidence.frequency = speed;
        indicator.evidence.order = speed.map(|_| 1.0);
    }
    signs
}

/// Whether the line is there and not the noise's, in any of the cells it is the highest of.
pub(super) fn is_over_noise(
    (shaft, order): (ShaftIndex, u8),
    channel: &ChannelFeatures,
    features: &WindowFeatures,
) -> bool {
    of_line((shaft, order), channel, features).any(|line| {
        confidence::cell_tail(line.power_ratio, line.floor_dof) * shaft::LINE_CELLS
            <= confidence::FALSE_ALARM_PROBABILITY
    })
}

/// The readings of a line over the noise in a channel: one, or none.
pub(super) fn of_line<'a>(
    (shaft, order): (ShaftIndex, u8),
    channel: &ChannelFeatures,
    features: &'a WindowFeatures,
) -> impl Iterator<Item = &'a shaft::OverFloor> {
    let channel = channel.channel;
    let lines = features.shaft_lines.iter();
    lines.filter(move |l| (l.shaft, l.order, l.channel) == (shaft, order, channel))
}

/// Whether a probe looks at `shaft`, by the machine file; one without a place looks at any.
fn observes(shaft: ShaftIndex, channel: &ChannelFeatures, context: &Context<'_>) -> bool {
    let machine = context.machine;
    let name = context.channel_name(channel.channel);
    let sensor = machine.sensors.iter().find(|s| s.channel == name);
    sensor.is_some_and(|s| machine.shaft_at(s).is_none_or(|at| at == shaft))
}

/// Two shafts whose once-a-revolution events cannot be told apart.
pub(super) fn same_speed(a: ShaftIndex, b: ShaftIndex, context: &Context<'_>) -> bool {
    let ratio = |s: ShaftIndex| context.machine.shaft(s).ratio_to_first;
    a == b || matches!((ratio(a), ratio(b)), (Some(x), Some(y)) if (x - y).abs() < 1e-9)
}

/// The largest ratio among channels and names, its probability paid for the looks; in a channel that
/// does not show what the ratio is of, the probability is 1.
pub(super) fn strongest(
    channels: &[&ChannelFeatures],
    names: &[String],
    features: &WindowFeatures,
    context: &Context<'_>,
    shows: &dyn Fn(&ChannelFeatures, &str) -> bool,
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
            let rest = channel.get(overall::RMS_BESIDE_SHAFTS).and_then(|value| {
                context.baseline.compare(channel_name, overall::RMS_BESIDE_SHAFTS, value)
            });
            let mut sign = indicator(name, channel_name, channel, comparison, features);
            sign.rest = rest.map(|c| c.ratio);
            sign.allowed = context.false_alarm_probability;
            if !shows(channel, name) {
                sign.probability = 1.0;
            }
            found.push(sign);
        }
    }
    let looks = found.len() as f64;
    // What is proven comes before what is larger.
    let rank = |i: &Indicator| (i.probability < 1.0, i.ratio);
    let mut best = found.into_iter().max_by(|a, b| {
        let (a, b) = (rank(a), rank(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    })?;
    best.pay_for(looks);
    Some(best)
}

pub(super) fn indicator(
    name: &str,
    channel_name: &str,
    channel: &ChannelFeatures,
    comparison: Comparison,
    features: &WindowFeatures,
) -> Indicator {
    let probability = confidence::normal_tail(comparison.z());
    Indicator {
        name: name.to_owned(),
        ratio: comparison.ratio,
        probability,
        allowed: confidence::FALSE_ALARM_PROBABILITY,
        rest: None,
        evidence: Evidence {
            indicator: format!("{name}_ratio_to_baseline"),
            channel: channel_name.to_owned(),
            detector: None,
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
