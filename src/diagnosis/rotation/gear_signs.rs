//! Where a gear is judged: in the channel that hears its mesh best, and only by what stays there.

use super::signs::same_speed;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::gear;
use crate::features::gear::GearReading;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use crate::signal::ChannelIndex;
use crate::units::Unit;

/// Of the channels whose average both window and baseline have, the one with the largest mesh
/// amplitude: it is nearest to the teeth, and least of what else runs once a revolution is heard
/// there. Channels of different units do not compare: one of each.
pub(super) fn hearing_best<'a>(
    gear: GearIndex,
    names: &[String],
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Vec<&'a ChannelFeatures> {
    let has_baseline = |channel: &ChannelFeatures| {
        let of_channel = context.channel_name(channel.channel);
        names.iter().any(|name| {
            let value = channel.get(name);
            value.is_some_and(|v| context.baseline.compare(of_channel, name, v).is_some())
        })
    };
    let mesh = |channel: &ChannelFeatures| {
        let readings = features.gears.iter();
        let of_channel = readings.filter(|r| r.gear == gear && r.channel == channel.channel);
        of_channel.map(|r| r.figures.mesh_amplitude).fold(0.0, f64::max)
    };
    let mut best: Vec<(Unit, &ChannelFeatures)> = Vec::new();
    for channel in features.channels.iter().filter(|c| has_baseline(c)) {
        let unit = context.channels[channel.channel.0].unit;
        match best.iter_mut().find(|(u, _)| *u == unit) {
            Some(slot) if mesh(channel) > mesh(slot.1) => slot.1 = channel,
            Some(_) => {}
            None => best.push((unit, channel)),
        }
    }
    best.into_iter().map(|(_, channel)| channel).collect()
}

/// Probability that what stands in the average of a gear would stay at its place of the revolution
/// by chance (C8): the tail C1 of D26 with ν = B − 1, times the teeth it may have sat at and the parts of
/// the average.
pub(super) fn chance_of_persistence(reading: &GearReading) -> f64 {
    let nu = gear::N_BLOCKS as f64 - 1.0;
    // Parts of the record that do not differ at all hold nothing of chance.
    let tail = reading.persistence.map_or(0.0, |z| confidence::cell_tail(z, nu));
    (tail * f64::from(reading.teeth) * gear::Part::ALL.len() as f64).min(1.0)
}

/// Whether a mesh harmonic of so much power over the scatter of the parts is no noise (J5): by chance (C1, ν = B − 1) it is as
/// rare as a false alarm may be. What noise leaves scatters too widely to have a ratio.
pub(super) fn stands_out(over_scatter: f64, context: &Context<'_>) -> bool {
    let nu = gear::N_BLOCKS as f64 - 1.0;
    confidence::cell_tail(over_scatter, nu) <= context.false_alarm_probability
}

/// Whether the feature `name` is the local amplitude of this reading.
pub(super) fn is_of(reading: &GearReading, name: &str, context: &Context<'_>) -> bool {
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(reading.gear).id, &machine.shaft(reading.shaft).id);
    gear::local_name(reading.part, gear, shaft) == name
}

/// Whether the energy of the feature `name` heard in `channel` stays at its place: a bearing's line near an order of the
/// shaft is left in an average too, but wanders.
pub(super) fn persists(
    (gear, shaft): (GearIndex, ShaftIndex),
    channel: ChannelIndex,
    name: &str,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    features
        .gears
        .iter()
        .filter(|r| (r.gear, r.channel) == (gear, channel) && same_speed(r.shaft, shaft, context))
        .filter(|r| is_of(r, name, context))
        .any(|r| chance_of_persistence(r) <= context.false_alarm_probability)
}
