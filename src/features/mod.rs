//! dsp × machine → named numbers of one analysis window.
//!
//! [`Extractor`] turns the contiguous samples of a window into [`WindowFeatures`]: speed first, then
//! levels, shaft lines, CWT amplitudes, bearing defect lines and gear signals. It measures and never
//! judges: no threshold of health stands here. Must not know baselines, verdicts or alarms.

pub mod plans;
mod settle;
pub mod shaft_lines;
pub mod speed;
pub mod tacho;
mod trace;
pub mod load;
pub mod turning;
mod following;
pub mod reception;
pub mod sensor;
pub mod overall;
pub mod shaft;
pub mod bands;
pub mod bearing;
pub mod reach;
mod targets;
pub mod impulses;
pub mod sets;
pub mod lines;
pub mod absolute;
pub mod comb;
pub mod gear;
pub mod limit;
pub mod vector;
pub mod orbit;
mod outburst;
pub mod run_up;
mod at_speed;
pub mod extract;

use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

pub use extract::Extractor;
pub use targets::MIN_WIDTH_PER_LINE;

/// One named number of one channel, e.g. `rms`, `velocity_rms_10_1000_hz`, `line_1x_main`.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Name, stable between windows.
    pub name: Arc<str>,
    /// Value, finite.
    pub value: f64,
    /// Unit of the value.
    pub unit: Unit,
}

/// The features of one channel over one window.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFeatures {
    /// Which channel.
    pub channel: ChannelIndex,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
    /// The numbers, in a fixed order.
    pub values: Vec<Feature>,
}

impl ChannelFeatures {
    /// Looks a feature up by name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|f| &*f.name == name).map(|f| f.value)
    }
}

/// The contiguous samples of one channel in a window.
#[derive(Debug, Clone, Copy)]
pub struct ChannelWindow<'a> {
    /// Index of the first sample.
    pub start: u64,
    /// Stream time of the first sample, s.
    pub time_s: f64,
    /// Samples, canonical unit, channel offset left out.
    pub samples: &'a [f32],
}

/// The samples of one window, one entry a channel of the stream; `None` where none are held
/// contiguously.
#[derive(Debug, Clone)]
pub struct Window<'a> {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Samples by channel.
    pub channels: Vec<Option<ChannelWindow<'a>>>,
}

impl Window<'_> {
    /// Duration, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.time_s.1 - self.time_s.0
    }
}

/// Searches for bearing defect lines at another speed than the one that is written down.
#[derive(Debug, Clone)]
pub struct Elsewhere {
    /// Speed of the first shaft.
    pub first: crate::units::Hz,
    /// The searches.
    pub lines: Vec<bearing::LineSearch>,
}

/// Everything measured in one window.
#[derive(Debug, Clone)]
pub struct WindowFeatures {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Speed of the first shaft and how it was found.
    pub speed: speed::Speed,
    /// Mean load, where a sensor measures it, in its unit.
    pub load: Option<f64>,
    /// Health of each sensor of the machine that has a channel.
    pub sensors: Vec<sensor::SensorReading>,
    /// Named numbers by channel: what baselines and trends hold.
    pub channels: Vec<ChannelFeatures>,
    /// Lines of the shafts over the noise around them, by channel.
    pub shaft_lines: Vec<shaft::OverFloor>,
    /// Searches for bearing defect lines.
    pub bearing_lines: Vec<bearing::LineSearch>,
    /// The same searches in sets of bands of the lower half of the usable band, of its lower quarter, and so on (F4): all channels in each, in the lowest
    /// set they have. Empty where no channel has one.
    pub lower_lines: Arc<[Vec<bearing::LineSearch>]>,
    /// The searches in all of the usable band, lines of races that turn read between the shaft's events where these hide them (F31). Empty where they hide none.
    pub between_lines: Arc<[bearing::LineSearch]>,
    /// The same at speeds the shaft may turn at as well, where its speed is only written down (F22).
    pub elsewhere: Vec<Elsewhere>,
    /// Absolute-vibration lines of x/y pairs.
    pub absolute_lines: Vec<absolute::AbsoluteLine>,
    /// Blows in the channels that listen for bearing lines, whatever their rate.
    pub impulses: Vec<impulses::Impulses>,
    /// Combs of the acceleration of x/y pairs at the rates of races that turn.
    pub combs: Vec<comb::Comb>,
    /// Synchronous averages at gears.
    pub gears: Vec<gear::GearReading>,
    /// Vectors of 1× of the probes, a piece of the window each.
    pub pieces: Vec<run_up::Piece>,
    /// What the vectors of the run up to this window say of a probe's shaft.
    pub laws: Vec<run_up::ShaftLaw>,
}

impl WindowFeatures {
    /// The features of a channel, if it was in the window.
    #[must_use]
    pub fn channel(&self, channel: ChannelIndex) -> Option<&ChannelFeatures> {
        self.channels.iter().find(|c| c.channel == channel)
    }

    /// Within what two readings of the window are of one line: 2/T.
    #[must_use]
    pub fn resolution(&self) -> Hz {
        Hz(2.0 / (self.time_s.1 - self.time_s.0).max(f64::MIN_POSITIVE))
    }
}
