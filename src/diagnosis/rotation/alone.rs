//! Whether 1× alone has risen, as of an unbalance (docs/theory.md, J4); misalignment, looseness and rubs raise 2× and 3× too.

use super::UNBALANCE_BY_1X_CONFIDENCE;
use super::UNBALANCE_CONFIDENCE;
use super::UP_RATIO;
use super::signs::Indicator;
use crate::diagnosis::Context;
use crate::diagnosis::baseline::Comparison;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::overall;
use crate::features::shaft;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;

/// 2× and 3× must stay below this part of the rise of 1×: what bends, misaligns or loosens a shaft raises
/// them with it.
const ALONE: f64 = 0.5;

/// Or, on a housing, below this part of 1× as velocity, whatever they were before: bearings that yield more one way than the other make
/// so much of an unbalance itself, and nine tenths of the energy stay at 1×.
pub(super) const SMALL: f64 = 0.2;

/// Part of a channel's energy that 1× must hold where 2× and 3× lie beyond the sampling.
const MOST: f64 = 0.5;

/// How surely 1× rose alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Alone {
    /// 2× and 3× are known, and neither rose with it or matters beside it.
    Proven,
    /// They, or one of them, lie beyond the sampling; what it shows is 1× for the most part.
    AsSampled,
}

impl Alone {
    /// Most confidence in an unbalance.
    pub(super) fn confidence(self) -> f64 {
        match self {
            Self::Proven => UNBALANCE_CONFIDENCE,
            Self::AsSampled => UNBALANCE_BY_1X_CONFIDENCE,
        }
    }

    /// What is said of it.
    pub(super) fn sentence(self) -> &'static str {
        match self {
            Self::Proven => {
                ", 2× and 3× have not risen with it or are small: unbalance; a bow is not excluded"
            }
            Self::AsSampled => {
                ", and most of the vibration is 1×: unbalance; 2× and 3× lie beyond the sampling, so that misalignment, looseness \
                 and a bow are not excluded"
            }
        }
    }
}

/// What a harmonic says.
enum Said {
    Calm,
    BeyondSampling,
    /// It rose, or is not known.
    Against,
}

/// Whether 1× rose alone in the indicator's channel, `None` if not, or not as far as is known.
pub(super) fn rises(
    shaft: ShaftIndex,
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Alone> {
    let said = [2, 3].map(|order| said_by((shaft, order), once, features, context));
    if said.iter().any(|s| matches!(s, Said::Against)) {
        None
    } else if said.iter().all(|s| matches!(s, Said::Calm)) {
        Some(Alone::Proven)
    } else {
        let channel = channel_of(once, features, context)?;
        let (whole, rest) = (channel.get(overall::RMS)?, channel.get(overall::RMS_BESIDE_SHAFTS)?);
        (rest * rest <= (1.0 - MOST) * whole * whole).then_some(Alone::AsSampled)
    }
}

fn said_by(
    (shaft, order): (ShaftIndex, u8),
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Said {
    if lies_beyond((shaft, order), once, features, context) {
        return Said::BeyondSampling;
    }
    let known = harmonic((shaft, order), once, features, context);
    let is_calm = known.is_some_and(|(amplitude, compared)| {
        (compared.ratio < UP_RATIO && compared.ratio <= ALONE * once.ratio)
            || is_small((shaft, order), amplitude, once, features, context)
    });
    if is_calm { Said::Calm } else { Said::Against }
}

/// Whether a harmonic lies above half the sample rate of the indicator's channel.
fn lies_beyond(
    (shaft, order): (ShaftIndex, u8),
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let speed = features.speed.first.and_then(|first| context.machine.shaft_speed(shaft, first));
    let info = context.channels.iter().find(|info| info.name == once.evidence.channel);
    speed
        .zip(info)
        .is_some_and(|(speed, info)| f64::from(order) * speed.0 >= info.sample_rate.0 / 2.0)
}

/// What a line at `order` of a housing's channel is as velocity, times the frequency of 1× where it is an acceleration; `None` of a probe.
pub(super) fn as_velocity(
    amplitude: f64,
    order: u8,
    channel: &str,
    context: &Context<'_>,
) -> Option<f64> {
    let sensor = context.machine.sensors.iter().find(|s| s.channel == channel)?;
    if sensor.kind == SensorKind::Accelerometer {
        Some(amplitude / f64::from(order))
    } else {
        (sensor.kind == SensorKind::Velocity).then_some(amplitude)
    }
}

/// Whether a harmonic of a housing is small beside 1×, as velocity.
fn is_small(
    (shaft, order): (ShaftIndex, u8),
    amplitude: f64,
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let velocity = as_velocity(amplitude, order, &once.evidence.channel, context);
    let first = harmonic((shaft, 1), once, features, context);
    velocity.zip(first).is_some_and(|(velocity, (first, _))| velocity <= SMALL * first)
}

/// Whether 2× or 3× is known to have risen by more than half as much as 1× and to move the shaft by a third as much: what does so is
/// neither bow nor unbalance alone. A probe hears hardly any 2× of a healthy shaft, and its ratio alone is noise.
pub(super) fn rises_with_others(
    shaft: ShaftIndex,
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let of_once = harmonic((shaft, 1), once, features, context);
    let matters = |(amplitude, compared): Harmonic| {
        compared.ratio > ALONE * once.ratio
            && of_once.is_none_or(|(first, _)| UP_RATIO * amplitude >= first)
    };
    [2, 3].into_iter().filter_map(|o| harmonic((shaft, o), once, features, context)).any(matters)
}

/// A harmonic's amplitude, with its comparison to the baseline.
type Harmonic = (f64, Comparison);

/// A harmonic of a shaft in the indicator's channel.
fn harmonic(
    (shaft, order): (ShaftIndex, u8),
    once: &Indicator,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Harmonic> {
    let line = shaft::line_name(order, &context.machine.shaft(shaft).id);
    let value = channel_of(once, features, context)?.get(&line)?;
    Some((value, context.baseline.compare(&once.evidence.channel, &line, value)?))
}

/// The features of the indicator's channel.
fn channel_of<'a>(
    once: &Indicator,
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Option<&'a ChannelFeatures> {
    features.channels.iter().find(|c| context.channel_name(c.channel) == once.evidence.channel)
}
