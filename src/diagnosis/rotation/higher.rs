//! 2× and 3× of a shaft that have risen though 1× has not (docs/theory.md, J9): something bends, loosens, rubs or cracks, and nothing
//! tells which.

use super::UP_RATIO;
use super::alone;
use super::signs;
use super::signs::Indicator;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::shaft;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::motor::MAINS_HZ;
use crate::machine::motor::MAINS_WANDER;
use crate::machine::sensor::SensorKind;
use crate::units::Hz;

/// Multiples of 1× that are looked at.
const ORDERS: [u8; 2] = [2, 3];

/// Multiples of the mains that a motor's field shakes its housing with.
const OF_MAINS: u32 = 6;

/// 2× or 3× of a shaft in these channels, whichever has risen more among those that stand over the noise, matter beside 1× and are no
/// multiples of the mains.
pub(super) fn higher(
    shaft: ShaftIndex,
    channels: &[&ChannelFeatures],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Indicator> {
    let speed = context.machine.shaft_speed(shaft, features.speed.first?)?;
    let id = &context.machine.shaft(shaft).id;
    let resolution = features.resolution();
    let names = ORDERS.map(|order| shaft::line_name(order, id));
    let order_of = |name: &str| {
        ORDERS.into_iter().zip(&names).find(|(_, named)| *named == name).map(|(order, _)| order)
    };
    let tells = |channel: &ChannelFeatures, name: &str| {
        order_of(name).is_some_and(|order| {
            is_over_noise((shaft, order), channel, features)
                && matters((shaft, order), channel, context)
                && !is_of_mains(Hz(f64::from(order) * speed.0), resolution, context.machine)
        })
    };
    let mut risen = signs::strongest(channels, &names, features, context, &tells)?;
    let order = order_of(&risen.name).map(f64::from)?;
    risen.evidence.order = Some(order);
    risen.evidence.frequency = Some(Hz(order * speed.0));
    Some(risen)
}

/// Whether the line is there and not the noise's, in any of the cells it is the highest of.
pub(super) fn is_over_noise(
    (shaft, order): (ShaftIndex, u8),
    channel: &ChannelFeatures,
    features: &WindowFeatures,
) -> bool {
    features.shaft_lines.iter().any(|line| {
        (line.shaft, line.order, line.channel) == (shaft, order, channel.channel)
            && confidence::cell_tail(line.power_ratio, line.floor_dof) * shaft::LINE_CELLS
                <= confidence::FALSE_ALARM_PROBABILITY
    })
}

/// Whether it is large beside 1×, by what keeps an unbalance from being named: a third of the displacement, a fifth of the velocity.
fn matters(
    (shaft, order): (ShaftIndex, u8),
    channel: &ChannelFeatures,
    context: &Context<'_>,
) -> bool {
    let id = &context.machine.shaft(shaft).id;
    let read = |order: u8| channel.get(&shaft::line_name(order, id));
    let (Some(first), Some(line)) = (read(1), read(order)) else { return false };
    match alone::as_velocity(line, order, context.channel_name(channel.channel), context) {
        Some(velocity) => velocity > alone::SMALL * first,
        None => UP_RATIO * line >= first,
    }
}

/// Whether a rate is a multiple of the mains, stated or possible: a field is stronger under load.
fn is_of_mains(rate: Hz, resolution: Hz, machine: &Machine) -> bool {
    let stated: Vec<f64> =
        machine.motors.iter().filter_map(|motor| motor.line_frequency).map(|f| f.0).collect();
    let lines = if stated.is_empty() { MAINS_HZ.to_vec() } else { stated };
    lines.iter().any(|line| {
        (1..=OF_MAINS).any(|multiple| {
            let hz = line * f64::from(multiple);
            (rate.0 - hz).abs() <= resolution.0 + MAINS_WANDER * hz
        })
    })
}

/// What is said of it.
pub(super) fn sentence(risen: &Indicator, kind: SensorKind) -> String {
    let of_what = if kind == SensorKind::Proximitor { "displacement" } else { "on the housing" };
    format!(
        "{}× {of_what} is {:.1} times its baseline in {}, and 1× has not risen: misalignment, looseness, a rub and a crack raise it",
        risen.evidence.order.unwrap_or_default(),
        risen.ratio,
        risen.evidence.channel
    )
}
