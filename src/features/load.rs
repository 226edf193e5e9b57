//! The load of a window, where a sensor measures it.

use super::Window;
use crate::machine::Machine;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;

/// Mean of the first load sensor that has samples in the window, in its unit.
#[must_use]
pub fn of(
    machine: &Machine,
    channels: &[ChannelInfo],
    channel_of_sensor: &[Option<ChannelIndex>],
    window: &Window<'_>,
) -> Option<f64> {
    let sensors = machine.sensors.iter().zip(channel_of_sensor);
    let mut loads = sensors.filter(|(sensor, _)| sensor.kind == SensorKind::Load);
    loads.find_map(|(_, channel)| {
        let channel = (*channel)?;
        let run = window.channels.get(channel.0).copied().flatten()?;
        let n = run.samples.len();
        if n == 0 {
            return None;
        }
        let sum: f64 = run.samples.iter().map(|x| f64::from(*x)).sum();
        Some(sum / n as f64 + channels[channel.0].offset)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::ChannelWindow;
    use crate::machine::file;
    use crate::units::Hz;
    use crate::units::Unit;

    #[test]
    fn the_first_load_sensor_with_samples_tells_the_mean_with_its_offset() {
        let text = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
                    [[sensor]]\nchannel='a'\nkind='load'\n[[sensor]]\nchannel='b'\nkind='load'\nunit='kN'\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let channel = |name: &str| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(10.0),
            unit: Unit::Unknown,
            offset: 100.0,
            unit_conflict: None,
            full_scale: None,
        };
        let channels = [channel("a"), channel("b")];
        let samples = [1.0_f32, 2.0, 6.0];
        let run = Some(ChannelWindow { start: 0, time_s: 0.0, samples: &samples });
        let places = [Some(ChannelIndex(0)), Some(ChannelIndex(1))];
        let load = |runs: Vec<Option<ChannelWindow<'_>>>| {
            of(&machine, &channels, &places, &Window { time_s: (0.0, 1.0), channels: runs })
        };
        assert_eq!(load(vec![run, None]), Some(103.0));
        assert_eq!(load(vec![None, run]), Some(103.0));
        assert_eq!(load(vec![None, None]), None);
    }
}
