//! What the configuration comes to for one machine and its stream: windows as long as its speed needs, captures that hold them.

use crate::config::Captures;
use crate::config::Config;
use crate::ingest::replay::StreamInfo;
use crate::machine::Machine;
use crate::pipeline::Monitor;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;

/// Settings and captures of one machine.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    /// Of its monitor, without a baseline.
    pub(super) settings: Settings,
    /// Of the raw data of its alarms; `None`: nothing is kept.
    pub(super) captures: Option<Captures>,
}

impl Fitted {
    /// Those of `machine` with this stream.
    pub(super) fn of(config: &Config, machine: &Machine, info: &StreamInfo) -> Self {
        let monitor = config.monitor_of((machine, hints(info)), &info.channels);
        let settings = Settings { load: info.load, ..monitor };
        let is_longer = settings.window_s > config.monitor.window_s;
        let hold = |c: Captures| if is_longer { c.holding(&settings) } else { c };
        Self { captures: config.captures.map(hold), settings }
    }

    /// Bytes that its rings, and what is held for captures, need.
    pub(super) fn memory_bytes(&self, info: &StreamInfo) -> u64 {
        let rings = Monitor::ring_bytes(&info.channels, &self.settings);
        let held = super::captures::memory_bytes(self.captures, &info.received);
        rings.saturating_add(held) as u64
    }
}

/// What a stream says of the speed.
pub(super) fn hints(info: &StreamInfo) -> SpeedHints {
    SpeedHints { option: None, capture: info.shaft_speed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;
    use crate::signal::ChannelInfo;
    use crate::units::Hz;
    use crate::units::Unit;

    const MACHINE: &str = "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\n[[bearing]]\nid = 'b'\nshaft = 's'\nelements = 9\n\
        element_diameter_mm = 8.0\npitch_diameter_mm = 40.0\n";

    fn fitted(config: &Config, speed_hz: f64) -> (Fitted, u64) {
        let machine = file::parse(MACHINE, "m").unwrap();
        let channel = ChannelInfo {
            name: "x".to_owned(),
            sample_rate: Hz(1e4),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let info = StreamInfo {
            channels: vec![channel],
            start_time: None,
            shaft_speed: Some(Hz(speed_hz)),
            load: Some(3.0),
            received: Vec::new(),
        };
        let fitted = Fitted::of(config, &machine, &info);
        let bytes = fitted.memory_bytes(&info);
        (fitted, bytes)
    }

    #[test]
    fn rings_and_captures_hold_the_windows_of_a_slow_machine() {
        let config = Config { lengthen_windows: true, ..Config::default() };
        let (usual, few) = fitted(&config, 30.0);
        assert_eq!(usual.settings, Settings { load: Some(3.0), ..config.monitor.clone() });
        assert_eq!(usual.captures, config.captures);
        let (slow, many) = fitted(&config, 1.0);
        let (window_s, hop_s) = (slow.settings.window_s, slow.settings.hop_s);
        let needed_s = window_s + hop_s + slow.settings.alarms.on_delay_s;
        let is = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found}");
        is(window_s, 120.0);
        is(slow.settings.ring_s, 180.0);
        is(slow.captures.unwrap().before_s, needed_s);
        // 150 s more of four-byte samples.
        assert!(many >= few + 6_000_000, "{many} and {few} bytes");
        let (as_stated, as_few) = fitted(&Config { lengthen_windows: false, ..config }, 1.0);
        assert_eq!((as_stated.settings, as_few), (usual.settings, few));
    }
}
