//! Angle of a shaft over a run of samples: by the tacho that watches the machine, else of a speed taken as constant.
//!
//! Must not know what is drawn over the angle.

use super::error::ApiError;
use super::signals::{MAX_SAMPLES, Run, samples_in};
use super::state::ApiState;
use super::view::{End, MachineView, ShardRequest, Waveform};
use super::wire::signals::AngleFrom;
use crate::dsp::order::PhaseTrack;
use crate::features::sensor::SensorReading;
use crate::features::tacho::measured_speed;
use crate::features::{ChannelWindow, Window};
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use std::sync::Arc;

/// Revolutions before a run in which the tacho is watched too.
const PULSED_REVOLUTIONS: f64 = 8.0;

/// A shaft and what is known of its speed.
#[derive(Debug, Clone)]
pub(super) struct Turner {
    view: Arc<MachineView>,
    shaft: ShaftIndex,
    /// Newest known or nominal speed of the shaft.
    pub(super) speed: Hz,
}

/// Samples of a tacho.
#[derive(Debug)]
struct Pulses {
    sensor: usize,
    channel: usize,
    waveform: Waveform,
}

/// How a shaft turned while a run of samples was taken.
#[derive(Debug)]
pub(super) struct Turns {
    /// Revolutions of the shaft; t = 0 is the first sample of the run.
    pub(super) track: PhaseTrack,
    /// Where they come from.
    pub(super) from: AngleFrom,
}

impl Turner {
    /// The shaft that the sensor of a channel listens to; the first one where no sensor says.
    pub(super) fn of_channel(view: &Arc<MachineView>, channel: &str) -> Result<Self, ApiError> {
        let machine = &view.machine;
        let sensor = machine.sensors.iter().find(|sensor| sensor.channel == channel);
        let shaft = sensor.and_then(|sensor| machine.shaft_at(sensor)).unwrap_or(ShaftIndex(0));
        let found = view.diagnosis.as_ref().and_then(|diagnosis| diagnosis.shaft_speed);
        let first = found.or_else(|| machine.nominal_speed());
        let speed = first.filter(|_| !machine.shafts.is_empty());
        let speed = speed.and_then(|first| machine.shaft_speed(shaft, first));
        match speed.filter(|speed| speed.0 > 0.0 && speed.0.is_finite()) {
            Some(speed) => Ok(Self { view: Arc::clone(view), shaft, speed }),
            None => Err(ApiError::Conflict(format!(
                "the speed of the shaft at {channel:?} is not known: no tacho, no speed channel, no speed_hz in the \
                 machine file"
            ))),
        }
    }

    /// Id of the shaft.
    pub(super) fn shaft(&self) -> &str {
        &self.view.machine.shaft(self.shaft).id
    }

    /// Samples of a channel in `revolutions` of the shaft, one more for where they begin.
    pub(super) fn samples_of(&self, info: &crate::signal::ChannelInfo, revolutions: f64) -> usize {
        samples_in(info, (revolutions + 1.0) / self.speed.0) + 2
    }

    /// Asks for the tacho's samples of the time of `run`; the rest is for a thread that may compute.
    pub(super) async fn watch(
        self,
        state: &ApiState,
        machine: &str,
        run: &Run,
    ) -> Result<Watched, ApiError> {
        let Some((sensor, channel, rate_hz)) = self.tacho() else {
            return Ok(Watched { turner: self, pulses: None });
        };
        let ratio = rate_hz / run.info.sample_rate.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate, and the number is not negative"
        )]
        let at = |samples: f64| (samples * ratio).ceil() as u64;
        let end = End::At(run.end_s());
        // A speed needs some pulses, however short the run is.
        let before = PULSED_REVOLUTIONS / self.speed.0 * run.info.sample_rate.0;
        let length = at(run.waveform.samples.len() as f64 + before);
        let max_samples = usize::try_from(length).unwrap_or(MAX_SAMPLES).clamp(1, MAX_SAMPLES);
        let question = |reply| ShardRequest::Waveform { channel, end, max_samples, reply };
        let held = state.ask(state.machine(machine)?, question).await?;
        let held = held.filter(|waveform| !waveform.samples.is_empty());
        Ok(Watched {
            turner: self,
            pulses: held.map(|waveform| Pulses { sensor, channel, waveform }),
        })
    }

    /// Sensor, channel and rate of the first tacho whose channel there is.
    fn tacho(&self) -> Option<(usize, usize, f64)> {
        let sensors = self.view.machine.sensors.iter().enumerate();
        sensors.filter(|(_, sensor)| sensor.kind == SensorKind::Tacho).find_map(
            |(index, sensor)| {
                let name = &sensor.channel;
                let channel = self.view.channels.iter().position(|info| info.name == *name)?;
                Some((index, channel, self.view.channels[channel].sample_rate.0))
            },
        )
    }
}

/// A shaft with what its tacho saw.
#[derive(Debug)]
pub(super) struct Watched {
    pub(super) turner: Turner,
    pulses: Option<Pulses>,
}

impl Watched {
    /// How the shaft turned from `start_s`, stream time, on.
    pub(super) fn turns(&self, start_s: f64) -> Result<Turns, ApiError> {
        let Turner { view, shaft, speed } = &self.turner;
        let ratio = view.machine.shaft(*shaft).ratio_to_first;
        let measured = self.pulses.as_ref().and_then(|pulses| pulses.first_shaft(view));
        if let Some(((track, track_start_s, is_marked), ratio)) = measured.zip(ratio)
            && let Some(track) = track.seen_from(start_s - track_start_s).times(ratio)
        {
            let is_same = (ratio - 1.0).abs() < 1e-9;
            let from = if is_marked && is_same { AngleFrom::Mark } else { AngleFrom::Tacho };
            return Ok(Turns { track, from });
        }
        let track = PhaseTrack::constant(speed.0).ok_or(ApiError::Internal)?;
        Ok(Turns { track, from: AngleFrom::Speed })
    }
}

impl Pulses {
    /// Revolutions of the first shaft, the stream time they begin at, and whether whole ones are at a mark on it.
    fn first_shaft(&self, view: &MachineView) -> Option<(PhaseTrack, f64, bool)> {
        let Waveform { start, start_time_s, samples } = &self.waveform;
        let range = (*start, *start + samples.len() as u64);
        let info = &view.channels[self.channel];
        let end_s = start_time_s + samples.len() as f64 / info.sample_rate.0;
        let mut channels = vec![None; view.channels.len()];
        channels[self.channel] =
            Some(ChannelWindow { start: *start, time_s: *start_time_s, samples });
        let window = Window { time_s: (*start_time_s, end_s), channels };
        let reading = SensorReading {
            sensor: self.sensor,
            channel: ChannelIndex(self.channel),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: range,
        };
        let speed = measured_speed(&view.machine, &view.channels, &window, &[reading])?;
        match (speed.phase, speed.turning) {
            (Some(phase), _) => Some((phase.track, phase.start_s, phase.is_marked)),
            (None, Some(turning)) => Some((turning.track, turning.start_s, false)),
            (None, None) => None,
        }
    }
}

/// The last `wanted` whole revolutions of those between two times that a track covers, and their times, s; fewer where
/// there are no more, none where there is no whole one.
pub(super) fn last_whole(
    track: &PhaseTrack,
    (from_s, to_s): (f64, f64),
    wanted: usize,
) -> Option<(f64, f64, [f64; 2])> {
    // Rounding must not cost a revolution.
    const SLACK: f64 = 1e-6;
    let (first, last) = track.covered_revolutions(from_s, to_s)?;
    let (first, last) = ((first - SLACK).ceil(), (last + SLACK).floor());
    let begin = first.max(last - wanted as f64);
    if begin >= last {
        return None;
    }
    let times = [track.time_at(begin).unwrap_or(from_s), track.time_at(last).unwrap_or(to_s)];
    Some((begin, last, times))
}
