//! One window in, its features out: the order of measurement on one screen.

use super::ChannelFeatures;
use super::Feature;
use super::Window;
use super::WindowFeatures;
use super::at_speed;
use super::bands;
use super::following;
use super::gear;
use super::limit;
use super::load;
use super::outburst;
use super::outburst::Quiet;
use super::overall;
use super::plans::Plans;
use super::reception;
use super::sensor;
use super::sensor::SensorReading;
use super::settle;
use super::speed;
use super::speed::Speed;
use super::speed::SpeedHints;
use super::trace;
use super::trace::Trace;
use super::turning;
use super::turning::Turned;
use crate::dsp::integrate::Quantity;
use crate::dsp::stats::Moments;
use crate::machine::Machine;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Channel of each sensor, if the stream has it.
fn places(machine: &Machine, channels: &[ChannelInfo]) -> Vec<Option<ChannelIndex>> {
    let place = |name: &str| channels.iter().position(|c| c.name == name).map(ChannelIndex);
    machine.sensors.iter().map(|sensor| place(&sensor.channel)).collect()
}

/// Measures windows of one machine's stream.
#[derive(Debug)]
pub struct Extractor {
    machine: Arc<Machine>,
    channels: Vec<ChannelInfo>,
    hints: SpeedHints,
    /// Channel of each sensor, if the stream has it.
    channel_of_sensor: Vec<Option<ChannelIndex>>,
    /// Levels of demodulation bands.
    band_levels: usize,
    plans: Plans,
}

impl Extractor {
    /// Prepares for a stream of `channels`.
    #[must_use]
    pub fn new(machine: Arc<Machine>, channels: Vec<ChannelInfo>, hints: SpeedHints) -> Self {
        let channel_of_sensor = places(&machine, &channels);
        let (band_levels, plans) = (bands::LEVELS, Plans::new());
        Self { machine, channels, hints, channel_of_sensor, band_levels, plans }
    }

    /// The same, which demodulates in the first so many levels of bands ([`bands::LEVELS`]).
    #[must_use]
    pub fn in_levels(self, band_levels: usize) -> Self {
        Self { band_levels, ..self }
    }

    /// Measures by another description of the machine from now on.
    pub fn describe(&mut self, machine: Arc<Machine>) {
        self.channel_of_sensor = places(&machine, &self.channels);
        self.machine = machine;
    }

    /// Channel of each sensor of the machine, in its order.
    #[must_use]
    pub fn channel_of_sensor(&self) -> &[Option<ChannelIndex>] {
        &self.channel_of_sensor
    }

    /// The plans kept from window to window. They may be those of another extractor: nothing but time depends on
    /// them.
    pub fn plans_mut(&mut self) -> &mut Plans {
        &mut self.plans
    }

    /// Measures one window.
    #[must_use]
    pub fn extract(&mut self, window: &Window<'_>) -> WindowFeatures {
        let machine = Arc::clone(&self.machine);
        let (mut sensors, quiet) = self.heard(window);
        let (mut traces, cut, speed) = self.turned(window, &quiet, &mut sensors);
        let mut reader = at_speed::Reader {
            machine: &machine,
            channels: &self.channels,
            band_levels: self.band_levels,
            plans: &mut self.plans,
        };
        let read = reader.read(&speed, &mut traces, &cut);
        let inputs = gear_inputs(&machine, &traces);
        let gears = gear::read(&machine, &self.channels, &speed, &inputs, self.plans.wide_tables());
        for reading in &gears {
            if let Some(trace) = traces.iter_mut().find(|t| t.channel == reading.channel) {
                trace.features.extend(gear::features(&machine, reading, &self.channels));
            }
        }
        let mut channels: Vec<ChannelFeatures> = traces
            .into_iter()
            .map(|t| ChannelFeatures {
                channel: t.channel,
                sample_range: t.range,
                values: t.features,
            })
            .collect();
        channels.sort_by_key(|c| c.channel);
        WindowFeatures {
            time_s: window.time_s,
            speed,
            load: load::of(&machine, &self.channels, &self.channel_of_sensor, window),
            sensors,
            channels,
            shaft_lines: read.shaft_lines,
            bearing_lines: read.bearing_lines,
            lower_lines: read.lower_lines,
            between_lines: read.between_lines,
            elsewhere: read.elsewhere,
            absolute_lines: read.absolute_lines,
            impulses: read.impulses,
            combs: read.combs,
            gears,
            pieces: read.pieces,
            laws: Vec::new(),
        }
    }

    /// The samples that the lines of a window are read from, each channel's newest, with their rate: at equal angles where the speed changes
    /// by more than lines can bear; empty where it does not.
    #[must_use]
    pub fn evened(&mut self, window: &Window<'_>) -> Vec<(ChannelIndex, Vec<f32>, Hz)> {
        let (mut sensors, quiet) = self.heard(window);
        let (traces, cut, speed) = self.turned(window, &quiet, &mut sensors);
        let of_angle = traces.into_iter().chain(cut).filter(|_| speed.is_evened);
        of_angle.map(|trace| (trace.channel, trace.samples.into_owned(), trace.rate)).collect()
    }

    /// Health of every sensor, and what is left of those that had outbursts.
    fn heard(&self, window: &Window<'_>) -> (Vec<SensorReading>, Vec<Quiet>) {
        let mut sensors = self.read_sensors(window);
        let nominal = speed::nominal(self.hints, self.machine.nominal_speed());
        let described = (&*self.machine, nominal.map(|(first, _)| first));
        let quiet = outburst::set_aside(described, &self.channels, window, &mut sensors);
        (sensors, quiet)
    }

    /// The vibration of a window, that which is cut at the range apart, and the speed along which it is read.
    fn turned<'a>(
        &mut self,
        window: &Window<'a>,
        quiet: &'a [Quiet],
        sensors: &mut [SensorReading],
    ) -> (Vec<Trace<'a>>, Vec<Trace<'a>>, Speed) {
        let machine = Arc::clone(&self.machine);
        let (mut traces, mut cut) = self.vibration_traces(window, quiet, sensors);
        for trace in &mut traces {
            let unit = self.channels[trace.channel.0].unit;
            let spectrum = (&trace.x_hat[..], trace.samples.len(), trace.rate);
            trace.features.extend(limit::bands(&machine, trace.sensor, spectrum, unit));
        }
        let heard = if traces.is_empty() { &cut } else { &traces };
        let told = settle::Told { machine: &machine, channels: &self.channels, hints: self.hints };
        let settled = told.speed(window, sensors, heard);
        let mut speed = following::refine(&machine, settled, heard, &mut self.plans);
        reception::doubt(&machine, speed.first, &traces, sensors);
        let turned = (speed.first.filter(|f| f.0 > 0.0), speed.turning.as_ref());
        let evened = [&mut traces, &mut cut]
            .map(|traces| turning::even(&machine, turned, traces, &mut self.plans));
        speed.is_evened = evened.contains(&Turned::Evened);
        if evened.contains(&Turned::Smeared) {
            speed.notes.extend(speed.turning.as_ref().map(turning::smeared));
        }
        (traces, cut, speed)
    }

    /// Health of every sensor that has a channel.
    fn read_sensors(&self, window: &Window<'_>) -> Vec<SensorReading> {
        let with_channel = self.channel_of_sensor.iter().enumerate();
        with_channel
            .filter_map(|(sensor, channel)| channel.map(|c| (sensor, c)))
            .map(|(sensor, channel)| match window.channels.get(channel.0).copied().flatten() {
                None => SensorReading {
                    sensor,
                    channel,
                    absent: Some("no contiguous samples in this window".to_owned()),
                    doubts: Vec::new(),
                    lost: Vec::new(),
                    flaw: None,
                    sample_range: (0, 0),
                },
                Some(run) => {
                    let info = &self.channels[channel.0];
                    let moments = Moments::of(run.samples);
                    SensorReading {
                        sensor,
                        channel,
                        absent: None,
                        doubts: Vec::new(),
                        lost: Vec::new(),
                        flaw: match self.machine.sensors[sensor].kind {
                            SensorKind::Accelerometer
                            | SensorKind::Velocity
                            | SensorKind::Proximitor => {
                                let described = &self.machine.sensors[sensor];
                                let gap = || {
                                    let mean = moments.mean + info.offset;
                                    sensor::find_gap(described, info.unit, mean)
                                };
                                sensor::find_flaw(run.samples, &moments, info.full_scale)
                                    .or_else(gap)
                            }
                            SensorKind::Tacho
                            | SensorKind::Speed
                            | SensorKind::Load
                            | SensorKind::Temperature
                            | SensorKind::Process => None,
                        },
                        sample_range: trace::range_of(run),
                    }
                }
            })
            .collect()
    }

    /// Levels and spectra of the vibration channels whose sensor is alive; apart, those that are cut at the range, of
    /// which only rates can be read: a level is too low, and a cut sine has harmonics.
    fn vibration_traces<'a>(
        &mut self,
        window: &Window<'a>,
        quiet: &'a [Quiet],
        sensors: &[SensorReading],
    ) -> (Vec<Trace<'a>>, Vec<Trace<'a>>) {
        let (mut traces, mut cut) = (Vec::new(), Vec::new());
        for reading in sensors {
            let sensor = &self.machine.sensors[reading.sensor];
            let Some(run) = window.channels.get(reading.channel.0).copied().flatten() else {
                continue;
            };
            if quantity(sensor.kind).is_none() || run.samples.len() < 16 {
                continue;
            }
            let info = &self.channels[reading.channel.0];
            if reading.is_cut() {
                cut.push(Trace::new(reading, run, info.sample_rate, &mut self.plans));
            }
            if reading.flaw.is_some() {
                continue;
            }
            let (heard, set_aside) = outburst::of(quiet, reading.channel, run);
            let mut trace = Trace::new(reading, heard, info.sample_rate, &mut self.plans);
            if set_aside.is_some_and(|quiet| !quiet.is_of_lost_samples) {
                trace.moments = Moments::of(run.samples);
            }
            trace.features = overall::levels(&trace.moments, info.unit, info.offset);
            trace.features.extend(velocity(&trace.samples, info, sensor.kind, &mut self.plans));
            let (samples, asked) = ((&trace.samples[..], trace.rate), (info.unit, &mut self.plans));
            trace.features.extend(limit::displacements(
                &self.machine,
                trace.sensor,
                samples,
                &trace.moments,
                asked,
            ));
            traces.push(trace);
        }
        (traces, cut)
    }
}

/// Velocity RMS 10–1000 Hz, where the unit is known.
fn velocity(
    samples: &[f32],
    info: &ChannelInfo,
    kind: SensorKind,
    plans: &mut Plans,
) -> Option<Feature> {
    let quantity = match info.unit {
        Unit::MetrePerSecondSquared => Quantity::Acceleration,
        Unit::MillimetrePerSecond => Quantity::Velocity,
        Unit::Micrometre | Unit::Volt | Unit::Hertz | Unit::One | Unit::Unknown => return None,
    };
    if kind == SensorKind::Proximitor {
        return None;
    }
    let plan = plans.velocity(samples.len());
    let read = plan.process(samples, info.sample_rate.0, quantity, overall::VELOCITY_BAND_HZ)?;
    Some(Feature {
        name: Arc::from(overall::VELOCITY_RMS),
        value: read.mm_per_s,
        unit: Unit::MillimetrePerSecond,
    })
}

/// Whether a kind of sensor measures vibration.
fn quantity(kind: SensorKind) -> Option<Quantity> {
    match kind {
        SensorKind::Accelerometer => Some(Quantity::Acceleration),
        SensorKind::Velocity => Some(Quantity::Velocity),
        SensorKind::Proximitor => Some(Quantity::Displacement),
        SensorKind::Tacho
        | SensorKind::Speed
        | SensorKind::Load
        | SensorKind::Temperature
        | SensorKind::Process => None,
    }
}

fn gear_inputs<'a>(machine: &Machine, traces: &'a [Trace<'_>]) -> Vec<gear::Input<'a>> {
    traces
        .iter()
        .filter(|t| machine.sensors[t.sensor].kind == SensorKind::Accelerometer)
        .map(|t| gear::Input {
            sensor: t.sensor,
            channel: t.channel,
            time_s: t.all.time_s,
            samples: t.all.samples,
            range: t.range,
        })
        .collect()
}
