//! Channels of a live source: raw samples as they come, converted as those of a capture are.

use super::channel_unit;
use super::convert::Conversion;
use super::received::{RawSamples, ReceivedChannel};
use crate::machine::Machine;
use crate::signal::ChannelInfo;

/// The conversion of one live channel.
#[derive(Debug, Clone, Copy)]
pub struct LiveChannel {
    conversion: Conversion,
}

impl LiveChannel {
    /// Decides how a channel is converted and what its blocks mean. The unit of the machine's sensor
    /// wins over the channel's. `None` if scale, offset and unit together leave the range of f32.
    #[must_use]
    pub fn new(channel: &ReceivedChannel, machine: &Machine) -> Option<(Self, ChannelInfo)> {
        let sensor = machine.sensors.iter().find(|sensor| sensor.channel == channel.name);
        let unit = channel_unit::resolve(sensor, channel.unit.as_deref());
        let kind = channel.number_type;
        let (scale, offset) = (channel.scale, channel.offset);
        let zero = RawSamples::F64(vec![channel.raw_zero]);
        let conversion = Conversion::new(kind, scale, offset, unit.unit.factor, Some(&zero))?;
        let info = ChannelInfo {
            name: channel.name.clone(),
            sample_rate: channel.sample_rate,
            unit: unit.unit.canonical,
            offset: conversion.offset,
            unit_conflict: unit.conflict,
            full_scale: conversion.full_scale(kind.ends()),
        };
        Some((Self { conversion }, info))
    }

    /// Raw samples as samples of a block: the canonical unit, the channel's constant left out.
    #[must_use]
    pub fn samples(&self, raw: RawSamples) -> Vec<f32> {
        self.conversion.samples(raw)
    }
}

#[cfg(test)]
mod tests {
    use super::super::received::NumberType;
    use super::*;
    use crate::machine::file;
    use crate::units::{Hz, Unit};

    #[test]
    fn a_live_channel_is_converted_as_that_of_a_capture() {
        let text = "[machine]\nid = \"m\"\nname = \"M\"\n[[shaft]]\nid = \"s\"\nspeed_hz = 1.0\n\
             [[sensor]]\nchannel = \"x\"\nkind = \"proximitor\"\nunit = \"mil\"\nat = { shaft = \"s\" }\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let channel = ReceivedChannel {
            name: "x".to_owned(),
            sample_rate: Hz(100.0),
            number_type: NumberType::I16,
            scale: 0.5,
            offset: 2.0,
            raw_zero: 0.0,
            unit: Some("um".to_owned()),
            sensor: None,
        };
        let (live, info) = LiveChannel::new(&channel, &machine).unwrap();
        assert_eq!(info.unit, Unit::Micrometre);
        assert_eq!(info.unit_conflict, Some(("um".to_owned(), "mil".to_owned())));
        // Two counts of half a mil; 25.4 µm a mil.
        let samples = live.samples(RawSamples::I16(vec![2]));
        assert!((f64::from(samples[0]) - 25.4).abs() < 1e-5 && (info.offset - 50.8).abs() < 1e-9);
        let beyond = ReceivedChannel { scale: 1e60, ..channel };
        assert!(LiveChannel::new(&beyond, &machine).is_none());
    }
}
