//! One window in, its features out: the order of measurement on one screen.

use super::ChannelFeatures;
use super::Feature;
use super::Window;
use super::WindowFeatures;
use super::absolute;
use super::absolute::AbsoluteLine;
use super::absolute::AbsoluteVibration;
use super::bands;
use super::bearing;
use super::comb;
use super::comb::Comb;
use super::following;
use super::gear;
use super::impulses;
use super::impulses::Impulses;
use super::limit;
use super::lines;
use super::lines::LineReader;
use super::load;
use super::orbit;
use super::outburst;
use super::outburst::Quiet;
use super::overall;
use super::plans::Plans;
use super::reception;
use super::run_up;
use super::sensor;
use super::sensor::SensorReading;
use super::settle;
use super::shaft;
use super::speed;
use super::speed::Phase;
use super::speed::SpeedHints;
use super::trace;
use super::trace::Trace;
use super::turning;
use super::turning::Turned;
use crate::dsp::cwt::MorletPlan;
use crate::dsp::fft::FftCache;
use crate::dsp::integrate::Quantity;
use crate::dsp::stats::Moments;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

/// Morlet parameter ω₀ of all CWT amplitudes: about six visible periods of the wavelet.
pub const OMEGA0: f64 = std::f64::consts::TAU;

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
        let mut sensors = self.read_sensors(window);
        let stated = speed::nominal(self.hints, machine.nominal_speed()).map(|(first, _)| first);
        let described = (&*machine, stated);
        let quiet = outburst::set_aside(described, &self.channels, window, &mut sensors);
        let (mut traces, mut cut) = self.vibration_traces(window, &quiet, &sensors);
        for trace in &mut traces {
            let unit = self.channels[trace.channel.0].unit;
            let spectrum = (&trace.x_hat[..], trace.samples.len(), trace.rate);
            trace.features.extend(limit::bands(&machine, trace.sensor, spectrum, unit));
        }
        let heard = if traces.is_empty() { &cut } else { &traces };
        let told = settle::Told { machine: &machine, channels: &self.channels, hints: self.hints };
        let settled = told.speed(window, &sensors, heard);
        let mut speed = following::refine(&machine, settled, heard, &mut self.plans);
        reception::doubt(&machine, speed.first, &traces, &mut sensors);
        let turned = (speed.first.filter(|f| f.0 > 0.0), speed.turning.as_ref());
        let evened = [&mut traces, &mut cut]
            .map(|traces| turning::even(&machine, turned, traces, &mut self.plans));
        speed.is_evened = evened.contains(&Turned::Evened);
        if evened.contains(&Turned::Smeared) {
            speed.notes.extend(speed.turning.as_ref().map(turning::smeared));
        }
        let (mut shaft_lines, mut bearing_lines) = (Vec::new(), Vec::new());
        let (mut absolute_lines, mut combs, mut pieces) = (Vec::new(), Vec::new(), Vec::new());
        let (mut elsewhere, mut heard_blows) = (Vec::new(), Vec::new());
        let mut lower_lines = Arc::default();
        if let Some(first) = speed.first.filter(|f| f.0 > 0.0) {
            shaft_lines = self.along_shafts(&machine, &mut traces, (first, speed.phase.as_ref()));
            elsewhere = speed::elsewhere(&speed);
            let others = elsewhere.iter().map(|other| other.first).collect();
            let mut reader = LineReader::new(&machine, first, speed.told_to())
                .also_at(others)
                .in_levels(self.band_levels);
            let mut of_channels = Vec::new();
            for trace in traces.iter().chain(&cut) {
                let sensor = &machine.sensors[trace.sensor];
                let heard = (trace.channel, trace.rate, trace.range);
                let spectrum = (&trace.x_hat[..], trace.samples.len());
                let lines = reader.envelope_lines(sensor, heard, spectrum, &mut self.plans);
                bearing_lines.extend_from_slice(&lines.here);
                let (channel, bands) = (trace.channel, reader.blows().to_vec());
                heard_blows.push(Impulses { channel, sample_range: trace.range, bands });
                let others = elsewhere.iter_mut().zip(&lines.elsewhere);
                others.for_each(|(at, lines)| at.lines.extend_from_slice(lines));
                of_channels.push(lines);
            }
            lower_lines = lines::lower_lines(&of_channels);
            absolute_lines = self.pairs(&machine, &mut traces, &mut reader, first);
            heard_blows.retain(|heard| !heard.bands.is_empty());
            impulses::keep(&heard_blows, &mut traces);
            bearing::keep(&machine, &bearing_lines, &mut traces);
            combs = comb::read(&machine, first, &traces.iter().chain(&cut).collect::<Vec<_>>());
            keep_combs(&machine, &combs, &mut traces);
            for trace in &traces {
                let info = &self.channels[trace.channel.0];
                let run = (info.sample_rate, info.unit);
                pieces.extend(run_up::pieces(&machine, trace, run, &speed));
            }
        }
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
            shaft_lines,
            bearing_lines,
            lower_lines,
            elsewhere,
            absolute_lines,
            impulses: heard_blows,
            combs,
            gears,
            pieces,
            laws: Vec::new(),
        }
    }

    /// Adds to every trace what is read along the shafts; the 1× lines against the noise around them.
    fn along_shafts(
        &mut self,
        machine: &Machine,
        traces: &mut [Trace<'_>],
        (first, phase): (Hz, Option<&Phase>),
    ) -> Vec<shaft::OverFloor> {
        let mut lines = Vec::new();
        for trace in traces {
            let info = &self.channels[trace.channel.0];
            lines.extend(over_floor(machine, trace, first));
            trace.features.extend(shaft_features(machine, trace, info, first, self.plans.tables()));
            let (sensor, run) = (trace.sensor, (&trace.samples[..], trace.rate));
            trace.features.extend(limit::orders(machine, sensor, run, first, info.unit));
            let run = (trace.all.samples, info.sample_rate);
            let start_s = trace.start_s();
            let found = limit::vector(machine, sensor, run, start_s, phase, info.unit);
            trace.features.extend(found);
        }
        lines
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

    /// Absolute vibration of every pair: its lines, and CWT amplitudes added to x's features.
    fn pairs(
        &mut self,
        machine: &Machine,
        traces: &mut [Trace<'_>],
        reader: &mut LineReader<'_>,
        first: Hz,
    ) -> Vec<AbsoluteLine> {
        let mut found = Vec::new();
        for pair in machine.sensor_pairs() {
            let at = |sensor: usize, traces: &[Trace<'_>]| {
                traces.iter().position(|t| t.sensor == sensor)
            };
            let (Some(ix), Some(iy)) = (at(pair.x, traces), at(pair.y, traces)) else { continue };
            let (x, y) = (&traces[ix], &traces[iy]);
            let info = &self.channels[x.channel.0];
            let other = &self.channels[y.channel.0];
            if info.unit != other.unit || !x.is_simultaneous(y) {
                continue;
            }
            if machine.sensors[pair.x].kind == SensorKind::Proximitor {
                let parts = orbit::parts(machine, (x, y), info.unit, first);
                traces[ix].features.extend(parts);
                continue;
            }
            let a = AbsoluteVibration::of(
                &x.samples,
                &y.samples,
                x.rate,
                reader.top(),
                &mut self.plans,
            );
            let scale =
                (x.moments.variance().unwrap_or(0.0) + y.moments.variance().unwrap_or(0.0)).sqrt();
            let sensor = &machine.sensors[pair.x];
            let heard = ((x.channel, y.channel), x.rate, x.range);
            let lines = reader.absolute_lines(sensor, heard, &a, scale, &mut self.plans);
            let n = a.samples.len();
            let plan = self.plans.forward(n);
            let mut a_hat = vec![Complex::default(); plan.n_bins()];
            plan.process(&a.samples, &mut a_hat);
            let of_pair = (&a_hat[..], n, a.sample_rate);
            let mut extra =
                cwt_features(machine, of_pair, info.unit, first, "absolute_", self.plans.tables());
            extra.extend(lines.iter().map(|line| Feature {
                name: Arc::from(absolute::line_name(line.line, &machine.bearing(line.bearing).id)),
                value: line.amplitude,
                unit: info.unit,
            }));
            found.extend(lines);
            traces[ix].features.extend(extra);
        }
        found
    }
}

/// Adds the combs to the features of the pairs' first channels.
fn keep_combs(machine: &Machine, combs: &[Comb], traces: &mut [Trace<'_>]) {
    for comb in combs {
        if let Some(x) = traces.iter_mut().find(|t| t.channel == comb.pair.0) {
            let name = comb::feature_name(comb.line, &machine.bearing(comb.bearing).id);
            let (name, value) = (Arc::from(name), comb.part.sqrt());
            x.features.push(Feature { name, value, unit: Unit::One });
        }
    }
}

/// The lines of every shaft against the noise around them, half a shaft speed to either side.
fn over_floor(machine: &Machine, trace: &Trace<'_>, first: Hz) -> Vec<shaft::OverFloor> {
    let read = |(s, order): (usize, u8)| {
        let speed = first.0 * machine.shafts[s].ratio_to_first?;
        let (at, half) = (Hz(f64::from(order) * speed), Hz(0.5 * speed));
        let n = trace.samples.len();
        let (power_ratio, floor_dof) = shaft::over_floor(&trace.x_hat, n, trace.rate, at, half)?;
        let (shaft, channel) = (ShaftIndex(s), trace.channel);
        Some(shaft::OverFloor { shaft, order, channel, power_ratio, floor_dof })
    };
    let lines = (0..machine.shafts.len()).flat_map(|s| shaft::ORDERS.map(|order| (s, order)));
    lines.filter_map(read).collect()
}

/// Shaft lines and single-axis CWT amplitudes of one channel.
fn shaft_features(
    machine: &Machine,
    trace: &Trace<'_>,
    info: &ChannelInfo,
    first: Hz,
    cache: &mut FftCache<f32>,
) -> Vec<Feature> {
    let (mut features, mut speeds) = (Vec::new(), Vec::new());
    for shaft in &machine.shafts {
        let Some(ratio) = shaft.ratio_to_first else { continue };
        let speed = Hz(first.0 * ratio);
        features.extend(shaft::lines(&trace.samples, trace.rate, &shaft.id, speed, info.unit));
        speeds.push(speed);
    }
    let spectrum = (&trace.x_hat[..], trace.samples.len(), trace.rate);
    features.extend(overall::beside_shafts(spectrum, &speeds, info.unit));
    features.extend(cwt_features(machine, spectrum, info.unit, first, "", cache));
    features
}

/// Mean CWT magnitudes at shaft and mesh frequencies of one signal's spectrum.
fn cwt_features(
    machine: &Machine,
    (x_hat, n, sample_rate): (&[Complex<f32>], usize, Hz),
    unit: Unit,
    first: Hz,
    prefix: &str,
    cache: &mut FftCache<f32>,
) -> Vec<Feature> {
    let mut features = Vec::new();
    let mut read = |name: String, frequency: Hz| {
        let magnitude = MorletPlan::new(n, sample_rate.0, frequency.0, OMEGA0, cache)
            .and_then(|mut plan| plan.mean_magnitude(x_hat));
        if let Some(value) = magnitude.filter(|v| v.is_finite()) {
            features.push(Feature { name: Arc::from(format!("{prefix}{name}")), value, unit });
        }
    };
    for shaft in &machine.shafts {
        if let Some(ratio) = shaft.ratio_to_first {
            read(shaft::cwt_name(&shaft.id), Hz(first.0 * ratio));
        }
    }
    for gear in &machine.gears {
        if let Some(speed) = machine.shaft_speed(gear.driving.shaft, first) {
            read(shaft::cwt_mesh_name(&gear.id), gear.mesh_frequency(speed));
        }
    }
    features
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
