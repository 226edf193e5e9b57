//! Measured speed: tacho pulses and speed channels; and the notes when speeds disagree.

use super::Window;
use super::sensor::SensorReading;
use super::speed::Speed;
use super::speed::SpeedSource;
use crate::dsp::order::PhaseTrack;
use crate::dsp::stats::Moments;
use crate::dsp::tacho::Edge;
use crate::dsp::tacho::Threshold;
use crate::machine::Machine;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::machine::sensor::TachoEdge;
use crate::signal::ChannelInfo;
use crate::units::Hz;

/// Speeds that differ by more than this, relative, are reported.
const DISAGREEMENT: f64 = 0.02;

/// Fewest pulses or samples a measured speed rests on.
const MIN_PULSES: usize = 3;

/// Measures the speed of the first shaft by tacho, else by a speed channel; `None` when there is
/// neither, or neither gives a speed.
#[must_use]
pub fn measured_speed(
    machine: &Machine,
    channels: &[ChannelInfo],
    window: &Window<'_>,
    sensors: &[SensorReading],
) -> Option<Speed> {
    let of_kind = |kind: SensorKind| {
        sensors.iter().filter(move |r| machine.sensors[r.sensor].kind == kind).filter_map(|r| {
            let run = window.channels.get(r.channel.0).copied().flatten()?;
            Some((&machine.sensors[r.sensor], &channels[r.channel.0], run.samples))
        })
    };
    let by_tacho = of_kind(SensorKind::Tacho).find_map(|(s, info, x)| tacho(machine, s, info, x));
    by_tacho.or_else(|| {
        of_kind(SensorKind::Speed).find_map(|(s, info, x)| speed_channel(machine, s, info, x))
    })
}

/// Ratio of the sensor's shaft to the first.
fn ratio(machine: &Machine, sensor: &Sensor) -> Option<f64> {
    let shaft = match machine.shaft_at(sensor) {
        Some(index) => machine.shaft(index),
        None => machine.shafts.first()?,
    };
    shaft.ratio_to_first.filter(|r| *r > 0.0)
}

fn tacho(machine: &Machine, sensor: &Sensor, info: &ChannelInfo, x: &[f32]) -> Option<Speed> {
    let mark = sensor.tacho?;
    let ratio = ratio(machine, sensor)?;
    let threshold = Threshold::of(x, &mut Vec::new())?;
    let edge = match mark.edge {
        TachoEdge::Rising => Edge::Rising,
        TachoEdge::Falling => Edge::Falling,
    };
    let mut times_s = Vec::new();
    threshold.edges(x, info.sample_rate.0, edge, &mut times_s);
    if times_s.len() < MIN_PULSES {
        return None;
    }
    let phase = PhaseTrack::from_pulses(&times_s, mark.pulses_per_rev)?;
    let mean = phase.mean_speed_hz();
    if !(mean.is_finite() && mean > 0.0) {
        return None;
    }
    let mut notes = Vec::new();
    let odd = phase.n_missing() + phase.n_double();
    if odd > 0 {
        notes.push(format!(
            "tacho `{}`: {} pulses missing, {} double",
            info.name,
            phase.n_missing(),
            phase.n_double()
        ));
    }
    let bad = odd as f64 / times_s.len() as f64;
    Some(Speed {
        first: Some(Hz(mean / ratio)),
        source: Some(SpeedSource::Tacho),
        confidence: (1.0 - bad).max(0.5),
        excursion: phase.relative_excursion().unwrap_or(0.0),
        phase: ((ratio - 1.0).abs() < 1e-9).then_some(phase),
        notes,
    })
}

fn speed_channel(
    machine: &Machine,
    sensor: &Sensor,
    info: &ChannelInfo,
    x: &[f32],
) -> Option<Speed> {
    let ratio = ratio(machine, sensor)?;
    if x.len() < MIN_PULSES {
        return None;
    }
    let moments = Moments::of(x);
    let mean = moments.mean + info.offset;
    let span = moments.max - moments.min;
    (mean.is_finite() && mean >= 0.0).then(|| Speed {
        first: Some(Hz(mean / ratio)),
        source: Some(SpeedSource::SpeedChannel),
        confidence: 0.97,
        excursion: if mean > 0.0 { span / mean } else { 0.0 },
        phase: None,
        notes: Vec::new(),
    })
}

/// Adds a note when the measured speed and a nominal one disagree.
#[must_use]
pub fn with_disagreement(mut measured: Speed, nominal: Option<(Hz, SpeedSource)>) -> Speed {
    if let (Some(first), Some((nominal, source))) = (measured.first, nominal) {
        measured.notes.extend(disagreement("the measured speed", first, source.name(), nominal));
    }
    measured
}

/// A sentence when two speeds differ by more than 2 %.
#[must_use]
pub fn disagreement(a_name: &str, a: Hz, b_name: &str, b: Hz) -> Option<String> {
    let differ = (a.0 - b.0).abs() > DISAGREEMENT * b.0.abs().max(a.0.abs());
    differ.then(|| {
        format!("{a_name} ({:.3} Hz) and {b_name} ({:.3} Hz) disagree by more than 2 %", a.0, b.0)
    })
}
