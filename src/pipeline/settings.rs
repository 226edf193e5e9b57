//! How windows are laid and what they are held against.

use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::rate::FalseAlarms;
use crate::signal::ChannelInfo;

/// Fewest samples of the fastest channel in a window.
const MIN_WINDOW_SAMPLES: f64 = 64.0;

/// How windows are laid and what they are held against.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Longest analysis window, s.
    pub window_s: f64,
    /// Distance of window ends, s; windows lie on the grid of this distance in stream time.
    pub hop_s: f64,
    /// History kept a channel, s; at least a window and a hop are kept.
    pub ring_s: f64,
    /// Healthy reference records.
    pub baseline: Baseline,
    /// Make a provisional baseline of the first so many segments, when there is no other.
    pub provisional_segments: Option<u32>,
    /// Alarm policy.
    pub alarms: crate::alarms::Settings,
    /// Load that the data state, in the unit of the load sensor; one that a sensor measures goes before.
    pub load: Option<f64>,
    /// How many false alarms are allowed.
    pub false_alarms: FalseAlarms,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            window_s: 10.0,
            hop_s: 5.0,
            ring_s: 30.0,
            baseline: Baseline::default(),
            provisional_segments: None,
            alarms: crate::alarms::Settings::default(),
            load: None,
            false_alarms: FalseAlarms::default(),
        }
    }
}

impl Settings {
    /// The same for windows of this length and distance, s: alarms wait for as many of them, and as many false ones are allowed a year; a
    /// ring that holds both.
    #[must_use]
    pub fn in_windows(&self, window_s: f64, hop_s: f64) -> Self {
        let ring_s = self.ring_s.max(window_s + hop_s);
        let longer = window_s / self.window_s;
        let alarms = crate::alarms::Settings {
            on_delay_s: longer * self.alarms.on_delay_s,
            off_delay_s: longer * self.alarms.off_delay_s,
            ..self.alarms.clone()
        };
        let false_alarms = self.false_alarms.in_windows((window_s, hop_s), alarms.on_delay_s);
        Self { window_s, hop_s, ring_s, alarms, false_alarms, ..self.clone() }
    }

    /// `new` for a stream that goes on: its windows lie and its rings reach as before, and what is the stream's stays.
    #[must_use]
    pub fn renewed(&self, new: &Self) -> Self {
        let Self { load, provisional_segments, ring_s, .. } = *self;
        let new = Self { load, provisional_segments, ring_s, ..new.clone() };
        new.in_windows(self.window_s, self.hop_s)
    }
}

/// Settings with windows never shorter than a few samples of the fastest channel (a capture may
/// declare any rate), and a history of a window and a hop at least.
pub(super) fn fitting(channels: &[ChannelInfo], settings: &Settings) -> Settings {
    let fastest = channels.iter().map(|c| c.sample_rate.0).fold(0.0, f64::max);
    let shortest_s = MIN_WINDOW_SAMPLES / fastest.max(f64::MIN_POSITIVE);
    let window_s = settings.window_s.max(shortest_s);
    let hop_s = settings.hop_s.max(shortest_s);
    let ring_s = settings.ring_s.max(window_s + hop_s);
    Settings { window_s, hop_s, ring_s, ..settings.clone() }
}
