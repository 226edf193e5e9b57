//! The whole flow on one screen: block → ring → window → features → diagnosis → alarm events.
//!
//! One [`Monitor`] a machine, used alike by the daemon's shards and by offline `diagnose`. Pure:
//! time is stream time, samples come in as arguments.

use crate::alarms::{AlarmEngine, AlarmEvent};
use crate::buffer::{Ring, RingStatus};
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::machine::Machine;
use crate::signal::{Block, ChannelIndex, ChannelInfo};
use crate::units::Hz;
use std::sync::Arc;

/// Nominal speeds of the first shaft offered with the data, strongest first (contract: speed
/// precedence). Tacho and speed channels are read from the samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpeedHints {
    /// The operator's `--speed`.
    pub option: Option<Hz>,
    /// The capture's `shaft_speed_hz`.
    pub capture: Option<Hz>,
}

/// How windows are laid.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Longest analysis window, s.
    pub window_s: f64,
    /// Distance of window ends, s; windows lie on the grid of this distance in stream time.
    pub hop_s: f64,
    /// Shortest window worth judging, s.
    pub min_window_s: f64,
    /// History kept a channel, s, ≥ `window_s`.
    pub ring_s: f64,
    /// Alarm policy.
    pub alarms: crate::alarms::Settings,
}

/// What one completed window yields.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Window start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Named numbers by channel.
    pub features: Vec<ChannelFeatures>,
    /// The verdict.
    pub diagnosis: Arc<Diagnosis>,
    /// What changed for the operator.
    pub alarm_events: Vec<AlarmEvent>,
}

/// Why a monitor cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// None of the machine's sensors has a channel in the stream.
    #[error(
        "none of the machine's sensors ({sensors}) has a channel in the data ({channels}): name the channels alike"
    )]
    NoCommonChannel {
        /// Channels the machine file names.
        sensors: String,
        /// Channels of the data.
        channels: String,
    },
}

/// The monitor of one machine.
#[derive(Debug)]
pub struct Monitor {
    /// The machine.
    machine: Arc<Machine>,
    /// Channels of the stream.
    channels: Vec<ChannelInfo>,
    /// One ring a channel.
    rings: Vec<Ring>,
    /// The alarms.
    alarms: AlarmEngine,
}

impl Monitor {
    /// Builds a monitor for a stream of `channels`.
    ///
    /// # Errors
    /// When no sensor of the machine has a channel in the stream.
    pub fn new(
        machine: Arc<Machine>,
        channels: Vec<ChannelInfo>,
        _hints: SpeedHints,
        settings: &Settings,
    ) -> Result<Self, MonitorError> {
        let rings = channels.iter().map(|c| Ring::new(c.sample_rate, settings.ring_s)).collect();
        Ok(Self { machine, channels, rings, alarms: AlarmEngine::new(settings.alarms.clone()) })
    }

    /// Gives the bytes the rings of a stream of `channels` need.
    #[must_use]
    pub fn ring_bytes(channels: &[ChannelInfo], settings: &Settings) -> usize {
        channels.iter().map(|c| Ring::bytes(c.sample_rate, settings.ring_s)).sum()
    }

    /// Takes one block in and calls `emit` for every window it completes.
    pub fn step(&mut self, block: &Block, _emit: &mut dyn FnMut(Outcome)) {
        self.rings[block.channel.0].push(block);
    }

    /// Ends the stream: judges what is left if it is long enough and not judged yet.
    pub fn finish(&mut self, _emit: &mut dyn FnMut(Outcome)) {}

    /// Adds samples that the source received but could not hand on, with the reason.
    pub fn count_rejected(&mut self, _n_samples: u64, _reason: &str) {}

    /// The machine.
    #[must_use]
    pub fn machine(&self) -> &Arc<Machine> {
        &self.machine
    }

    /// Channels of the stream.
    #[must_use]
    pub fn channels(&self) -> &[ChannelInfo] {
        &self.channels
    }

    /// The ring of a channel: raw samples, gaps, counts.
    #[must_use]
    pub fn ring(&self, channel: ChannelIndex) -> &Ring {
        &self.rings[channel.0]
    }

    /// State of every ring.
    #[must_use]
    pub fn ring_status(&self) -> Vec<RingStatus> {
        self.rings.iter().map(Ring::status).collect()
    }

    /// The alarms, for reading and operator actions.
    pub fn alarms_mut(&mut self) -> &mut AlarmEngine {
        &mut self.alarms
    }

    /// The alarms.
    #[must_use]
    pub fn alarms(&self) -> &AlarmEngine {
        &self.alarms
    }
}
