//! What is read of a window at the speed of its shafts: their lines, those of bearings, blows, combs, pieces of a run.

use super::Elsewhere;
use super::Feature;
use super::absolute;
use super::absolute::AbsoluteLine;
use super::absolute::AbsoluteVibration;
use super::bearing;
use super::comb;
use super::comb::Comb;
use super::impulses;
use super::impulses::Impulses;
use super::limit;
use super::lines::LineReader;
use super::orbit;
use super::overall;
use super::plans::Plans;
use super::run_up;
use super::sets;
use super::shaft;
use super::speed;
use super::speed::Phase;
use super::speed::Speed;
use super::trace::Trace;
use super::vector;
use crate::dsp::cwt::MorletPlan;
use crate::dsp::fft::FftCache;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

/// Morlet parameter ω₀ of all CWT amplitudes: about six visible periods of the wavelet.
const OMEGA0: f64 = std::f64::consts::TAU;

/// All of it, as [`super::WindowFeatures`] holds it; nothing where no shaft is known to turn.
#[derive(Debug, Default)]
pub(super) struct AtSpeed {
    pub(super) shaft_lines: Vec<shaft::OverFloor>,
    pub(super) bearing_lines: Vec<bearing::LineSearch>,
    pub(super) lower_lines: Arc<[Vec<bearing::LineSearch>]>,
    pub(super) between_lines: Arc<[bearing::LineSearch]>,
    pub(super) elsewhere: Vec<Elsewhere>,
    pub(super) absolute_lines: Vec<AbsoluteLine>,
    pub(super) impulses: Vec<Impulses>,
    pub(super) combs: Vec<Comb>,
    pub(super) pieces: Vec<run_up::Piece>,
}

/// Reads windows of one machine's stream.
#[derive(Debug)]
pub(super) struct Reader<'r> {
    pub(super) machine: &'r Machine,
    pub(super) channels: &'r [ChannelInfo],
    /// Levels of demodulation bands.
    pub(super) band_levels: usize,
    pub(super) plans: &'r mut Plans,
}

impl Reader<'_> {
    /// Reads all of it, and adds to the traces the numbers that trends and baselines keep; `cut`: channels of which only rates
    /// are read.
    pub(super) fn read(
        &mut self,
        speed: &Speed,
        traces: &mut [Trace<'_>],
        cut: &[Trace<'_>],
    ) -> AtSpeed {
        let Some(first) = speed.first.filter(|f| f.0 > 0.0) else { return AtSpeed::default() };
        let machine = self.machine;
        let mut found = AtSpeed {
            shaft_lines: self.along_shafts(traces, (first, speed.phase.as_ref())),
            elsewhere: speed::elsewhere(speed),
            ..AtSpeed::default()
        };
        let others = found.elsewhere.iter().map(|other| other.first).collect();
        let mut reader = LineReader::new(machine, first, speed.told_to())
            .also_at(others)
            .in_levels(self.band_levels);
        self.envelopes(&mut reader, traces.iter().chain(cut), &mut found);
        found.absolute_lines = self.pairs(traces, &mut reader, first);
        found.impulses.retain(|heard| !heard.bands.is_empty());
        impulses::keep(&found.impulses, traces);
        bearing::keep(machine, &found.bearing_lines, traces);
        found.combs = comb::read(machine, first, &traces.iter().chain(cut).collect::<Vec<_>>());
        keep_combs(machine, &found.combs, traces);
        for trace in traces {
            let info = &self.channels[trace.channel.0];
            let run = (info.sample_rate, info.unit);
            found.pieces.extend(run_up::pieces(machine, trace, run, speed));
            keep_direction(machine, &found.shaft_lines, (info.sample_rate, speed), trace);
        }
        found
    }

    /// The lines of bearings and the blows in the squared envelopes of every channel.
    fn envelopes<'t, 's: 't>(
        &mut self,
        reader: &mut LineReader<'_>,
        traces: impl Iterator<Item = &'t Trace<'s>>,
        found: &mut AtSpeed,
    ) {
        let mut of_channels = Vec::new();
        for trace in traces {
            let sensor = &self.machine.sensors[trace.sensor];
            let heard = (trace.channel, trace.rate, trace.range);
            let spectrum = (&trace.x_hat[..], trace.samples.len());
            let lines = reader.envelope_lines(sensor, heard, spectrum, self.plans);
            found.bearing_lines.extend_from_slice(&lines.here);
            let (channel, bands) = (trace.channel, reader.blows().to_vec());
            found.impulses.push(Impulses { channel, sample_range: trace.range, bands });
            let others = found.elsewhere.iter_mut().zip(&lines.elsewhere);
            others.for_each(|(at, lines)| at.lines.extend_from_slice(lines));
            of_channels.push(lines);
        }
        found.lower_lines = sets::lower_lines(&of_channels);
        found.between_lines = sets::between_lines(&of_channels);
    }

    /// Adds to every trace what is read along the shafts; the 1× lines against the noise around them.
    fn along_shafts(
        &mut self,
        traces: &mut [Trace<'_>],
        (first, phase): (Hz, Option<&Phase>),
    ) -> Vec<shaft::OverFloor> {
        let (machine, mut lines) = (self.machine, Vec::new());
        for trace in traces {
            let info = &self.channels[trace.channel.0];
            lines.extend(over_floor(machine, trace, first));
            trace.features.extend(shaft_features(machine, trace, info, first, self.plans.tables()));
            let (sensor, run) = (trace.sensor, (&trace.samples[..], trace.rate));
            trace.features.extend(limit::orders(machine, sensor, run, first, info.unit));
            let run = (trace.all.samples, info.sample_rate);
            let start_s = trace.start_s();
            if limit::asks_for_vector(machine, sensor) {
                trace.features.extend(vector::read(run, start_s, phase, info.unit));
            }
        }
        lines
    }

    /// Absolute vibration of every pair: its lines, and CWT amplitudes added to x's features.
    fn pairs(
        &mut self,
        traces: &mut [Trace<'_>],
        reader: &mut LineReader<'_>,
        first: Hz,
    ) -> Vec<AbsoluteLine> {
        let (machine, mut found) = (self.machine, Vec::new());
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
            let a = AbsoluteVibration::of(&x.samples, &y.samples, x.rate, reader.top(), self.plans);
            let scale =
                (x.moments.variance().unwrap_or(0.0) + y.moments.variance().unwrap_or(0.0)).sqrt();
            let sensor = &machine.sensors[pair.x];
            let heard = ((x.channel, y.channel), x.rate, x.range);
            let lines = reader.absolute_lines(sensor, heard, &a, scale, self.plans);
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

/// Adds where 1× points to the features of a probe that looks at the first shaft, whose mark it is, or at one of its speed.
fn keep_direction(
    machine: &Machine,
    lines: &[shaft::OverFloor],
    (rate, speed): (Hz, &Speed),
    trace: &mut Trace<'_>,
) {
    let sensor = &machine.sensors[trace.sensor];
    // What a probe without a place sees is the first shaft's.
    let at = machine.shaft_at(sensor).unwrap_or(ShaftIndex(0));
    let ratio = machine.shafts.get(at.0).and_then(|shaft| shaft.ratio_to_first);
    let is_of_first = ratio.is_some_and(|ratio| (ratio - 1.0).abs() < 1e-9);
    if sensor.kind != SensorKind::Proximitor || !is_of_first || speed.is_transient() {
        return;
    }
    let is_once = |l: &&shaft::OverFloor| (l.shaft, l.order, l.channel) == (at, 1, trace.channel);
    let over_floor = lines.iter().find(is_once).map_or(0.0, |line| line.power_ratio);
    let run = (trace.all.samples, rate);
    let found = vector::direction(run, trace.start_s(), speed.phase.as_ref(), over_floor);
    trace.features.extend(found);
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
