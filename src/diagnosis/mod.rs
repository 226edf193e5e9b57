//! Numbers → what is wrong, how badly, how sure, why.
//!
//! [`assess`] is a pure function of a window's features, the machine and a baseline. Two gates stand
//! before every accusation: significance (false-alarm probability after the search is paid for) and
//! effect size. Must not know samples, labels, names of files, or the clock.

pub mod fault;
pub mod verdict;
pub mod confidence;
pub mod rate;
pub mod severity;
pub mod baseline;
pub mod drift;
pub mod sensor;
pub mod bearing;
pub mod rotation;
pub mod level;
pub mod summary;

use crate::features::WindowFeatures;
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use baseline::Baseline;
use verdict::ComponentDiagnosis;

/// What a judgement rests on besides the features.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Channels of the stream.
    pub channels: &'a [ChannelInfo],
    /// Channel of each sensor of the machine.
    pub channel_of_sensor: &'a [Option<ChannelIndex>],
    /// Healthy reference at this window's speed; empty if there is none.
    pub baseline: &'a Baseline,
    /// What does not depend on the speed of healthy records of any speed: parts of their runs.
    pub runs: &'a Baseline,
    /// Healthy records offered, whatever their speed.
    pub offered_baselines: usize,
    /// Why nothing can be held against any of them, whatever the speed; `None`: something can, or none was offered.
    pub void_baselines: Option<&'a str>,
    /// Probability with which a component may be accused falsely in this decision.
    pub false_alarm_probability: f64,
}

impl Context<'_> {
    /// Name of a channel.
    #[must_use]
    pub fn channel_name(&self, channel: ChannelIndex) -> &str {
        &self.channels[channel.0].name
    }
}

/// Judges every component of the machine in one window.
#[must_use]
pub fn assess(features: &WindowFeatures, context: &Context<'_>) -> Vec<ComponentDiagnosis> {
    let (mut components, unplaced) = bearing::judge(features, context);
    components.extend(rotation::judge(features, &components, context));
    let explained = components.iter().any(|c| c.state.is_accusation());
    components.push(level::judge(features, context, explained, unplaced));
    components.extend(sensor::judge(features, context));
    components
}
