//! dsp × machine → named numbers of one analysis window.

use crate::signal::ChannelIndex;
use crate::units::Unit;
use std::sync::Arc;

/// One named number of one channel, e.g. `rms`, `velocity_rms_10_1000_hz`, `line_1x_main`.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Name, stable between windows.
    pub name: Arc<str>,
    /// Value.
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
