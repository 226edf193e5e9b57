//! 2× and 3× of a shaft that have risen though 1× has not (docs/theory.md, J9): something bends, loosens, rubs or cracks, and nothing
//! tells which.

use super::UP_RATIO;
use super::alone;
use super::signs;
use super::signs::Indicator;
use crate::diagnosis::Context;
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

/// Power over the noise from which a line counts (16 dB): what was a third as large then still stood twice as high as the noise, which alone
/// makes no ratio of three.
const SURE_POWER: f64 = 40.0;

/// Multiples of the mains that a motor's field shakes its housing with.
const OF_MAINS: u32 = 6;

/// Multiples of a shaft of another speed that may be as strong.
const OF_ANOTHER: u32 = 6;

/// 2× or 3× of a shaft in these channels, whichever has risen more among those that stand over the noise, matter beside 1× and are no
/// multiples of the mains or of a shaft of another speed.
pub(super) fn higher(
    shaft: ShaftIndex,
    channels: &[&ChannelFeatures],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Indicator> {
    // Read beside the line, nothing tells how large it is, or was.
    if features.speed.is_unconfirmed() {
        return None;
    }
    let speed = context.machine.shaft_speed(shaft, features.speed.first?)?;
    let id = &context.machine.shaft(shaft).id;
    let names = ORDERS.map(|order| shaft::line_name(order, id));
    let order_of = |name: &str| {
        ORDERS.into_iter().zip(&names).find(|(_, named)| *named == name).map(|(order, _)| order)
    };
    let tells = |channel: &ChannelFeatures, name: &str| {
        order_of(name).is_some_and(|order| {
            let rate = Hz(f64::from(order) * speed.0);
            stands_over((shaft, order), SURE_POWER, channel, features)
                && matters((shaft, order), channel, context)
                && !is_of_mains(rate, features, context.machine)
                && !is_of_another((shaft, rate), features, context)
        })
    };
    let mut risen = signs::strongest(channels, &names, features, context, &tells)?;
    let order = order_of(&risen.name).map(f64::from)?;
    risen.evidence.order = Some(order);
    risen.evidence.frequency = Some(Hz(order * speed.0));
    Some(risen)
}

/// Whether the line stands over the noise with so many times its power.
fn stands_over(
    line: (ShaftIndex, u8),
    power_ratio: f64,
    channel: &ChannelFeatures,
    features: &WindowFeatures,
) -> bool {
    signs::of_line(line, channel, features).any(|line| line.power_ratio >= power_ratio)
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

/// Whether a rate is a multiple of what feeds a motor, or of the mains: a field is stronger under load. A stated frequency may be an
/// inverter's, beside which the mains are still there.
fn is_of_mains(rate: Hz, features: &WindowFeatures, machine: &Machine) -> bool {
    let of_motors = machine.motors.iter().filter_map(|motor| {
        motor.supply_frequency(machine.shaft_speed(motor.shaft, features.speed.first?)?)
    });
    let fed: Vec<f64> = of_motors.map(|supply| supply.0).collect();
    let is_mains = |fed: &f64| MAINS_HZ.iter().any(|hz| (hz - fed).abs() <= MAINS_WANDER * hz);
    let is_known = fed.iter().any(is_mains);
    let mains = MAINS_HZ.iter().filter(|_| !is_known);
    fed.iter().chain(mains).any(|line| {
        (1..=OF_MAINS).any(|multiple| {
            let hz = line * f64::from(multiple);
            (rate.0 - hz).abs() <= features.resolution().0 + MAINS_WANDER * hz
        })
    })
}

/// Whether a rate is one of the first multiples of a shaft of another speed, or a mesh: what they do there is not this shaft's.
fn is_of_another(
    (shaft, rate): (ShaftIndex, Hz),
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let (Some(first), machine) = (features.speed.first, context.machine) else { return false };
    let others = (0..machine.shafts.len()).map(ShaftIndex);
    let others = others.filter(|other| !signs::same_speed(*other, shaft, context));
    let of_shafts = others
        .filter_map(|other| machine.shaft_speed(other, first))
        .flat_map(|speed| (1..=OF_ANOTHER).map(move |multiple| f64::from(multiple) * speed.0));
    let of_meshes = machine.gears.iter().filter_map(|gear| {
        Some(gear.mesh_frequency(machine.shaft_speed(gear.driving.shaft, first)?).0)
    });
    of_shafts.chain(of_meshes).any(|hz| (rate.0 - hz).abs() <= features.resolution().0)
}

/// What is said of it.
pub(super) fn sentence(risen: &Indicator, kind: SensorKind) -> String {
    let of_what = if kind == SensorKind::Proximitor { "displacement" } else { "on the housing" };
    format!(
        "{}× {of_what} is {:.1} times its baseline in {}, and 1× is not proven to have risen: misalignment, looseness, a rub or a crack raises \
         it, and so do vanes or lobes under another load",
        risen.evidence.order.unwrap_or_default(),
        risen.ratio,
        risen.evidence.channel
    )
}
