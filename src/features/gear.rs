//! Synchronous averages at gears: energy that stays at one place of the revolution.
//!
//! The difference signal (mesh, its ± 1 side bands and the first two shaft orders removed) of a
//! single axis tells a damaged tooth from a bow, which the mesh side bands do not (docs/theory.md,
//! F10).

use super::Feature;
use super::speed::Speed;
use super::speed::SpeedSource;
use crate::dsp::demodulate::MeshDemodPlan;
use crate::dsp::fft::FftCache;
pub use crate::dsp::gear::GearFigures;
use crate::dsp::gear::GearPlan;
pub use crate::dsp::gear::Localisation;
pub use crate::dsp::gear::WIDTHS;
use crate::dsp::mesh_angle;
use crate::dsp::mesh_angle::MeshAngle;
use crate::dsp::mesh_angle::MeshLines;
use crate::dsp::order::PhaseTrack;
use crate::dsp::real::floor_index;
use crate::dsp::stats::Moments;
use crate::dsp::tsa::TsaPlan;
use crate::machine::GearIndex;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Unit;
use std::sync::Arc;

/// A channel offered to the averages.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// Place in the machine's sensors.
    pub sensor: usize,
    /// Its channel.
    pub channel: ChannelIndex,
    /// Stream time of the first sample, s.
    pub time_s: f64,
    /// All samples of the window.
    pub samples: &'a [f32],
    /// First sample and one past the last.
    pub range: (u64, u64),
}

/// Which orders of an average the difference signal holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All.
    Whole,
    /// Those around mesh harmonic h, (h ± ½)·z: noise that rings elsewhere is left out.
    Around(usize),
}

impl Part {
    /// All parts that are read.
    pub const ALL: [Self; 1 + MESH_HARMONICS] =
        [Self::Whole, Self::Around(1), Self::Around(2), Self::Around(3)];
}

/// Spread and peakedness of a signal over the revolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Standard deviation, unit of the channel.
    pub deviation: f64,
    /// Kurtosis; 3 of Gaussian noise.
    pub kurtosis: f64,
}

impl Shape {
    fn of(x: &[f64]) -> Option<Self> {
        let moments = Moments::of(x);
        Some(Self { deviation: moments.variance()?.sqrt(), kurtosis: moments.kurtosis()? })
    }
}

/// One part of one gear's average in one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct GearReading {
    /// Which mesh.
    pub gear: GearIndex,
    /// Whose revolution.
    pub shaft: ShaftIndex,
    /// Which channel.
    pub channel: ChannelIndex,
    /// Orders of the difference signal.
    pub part: Part,
    /// Whole revolutions averaged.
    pub revolutions: usize,
    /// Whether a tacho gave the angle (else a constant speed, and no angle means anything).
    pub has_angle: bool,
    /// Whether the angle is known to a small part of a tooth: a tacho followed the shaft, on it or through the gears, or the
    /// mesh keeps its phase all along the record (D111).
    pub is_sharp: bool,
    /// Amplitudes of the first mesh harmonics, zero-to-peak, unit of the channel; 0 beyond the band.
    pub mesh: [f64; MESH_HARMONICS],
    /// Their powers in the whole average ÷ what chance leaves there (D26 of one line); 0 beyond the band.
    pub mesh_over_scatter: [f64; MESH_HARMONICS],
    /// Figures of merit.
    pub figures: GearFigures,
    /// Of the whole: the residual signal. Around a mesh harmonic: its amplitude demodulated (D65).
    pub shape: Option<Shape>,
    /// Around a mesh harmonic: how far its demodulated phase swings, rad peak to peak (D65).
    pub phase_swing_rad: Option<f64>,
    /// Where the energy sits.
    pub localisation: Localisation,
    /// Largest amplitude of the difference signal, smoothed over one tooth, unit of the channel.
    pub local_amplitude: f64,
    /// Power that stays at that place over [`N_BLOCKS`] parts of the record ÷ what chance leaves there
    /// (D26); `None` where the parts do not differ.
    pub persistence: Option<f64>,
    /// Teeth of the gear: places the energy may have sat at.
    pub teeth: u32,
    /// Shaft angle of the negative-to-positive crossing of the once-a-revolution component, degrees.
    pub zero_crossing_deg: f64,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
}

/// Fewest revolutions an average is worth: 1/√R leaves a quarter of what is not synchronous.
const MIN_REVOLUTIONS: usize = 16;

/// Parts of the record that are compared: each still averages two revolutions or more, and a foreign
/// line that the whole average keeps in part turns from one to the next.
pub const N_BLOCKS: usize = 8;

/// Mesh harmonics that are read one by one.
pub const MESH_HARMONICS: usize = 3;

/// Without a tacho the angle drifts by speed error × revolutions; only a speed confirmed by a comb
/// of shaft harmonics is averaged on.
const MIN_CONFIDENCE_WITHOUT_TACHO: f64 = 0.95;

/// Name of the feature "local amplitude of the difference signal of `gear` over `shaft`, in these orders".
#[must_use]
pub fn local_name(part: Part, gear: &str, shaft: &str) -> String {
    match part {
        Part::Whole => format!("tsa_local_{gear}_{shaft}"),
        Part::Around(h) => format!("tsa_local_{h}_{gear}_{shaft}"),
    }
}

/// Name of the feature "standard deviation of the residual signal", or of the demodulated amplitude around a harmonic.
#[must_use]
pub fn shape_name(part: Part, gear: &str, shaft: &str) -> String {
    match part {
        Part::Whole => format!("tsa_residual_{gear}_{shaft}"),
        Part::Around(h) => format!("tsa_envelope_{h}_{gear}_{shaft}"),
    }
}

/// Name of the feature "amplitude of harmonic `h` of the mesh `gear` in the average over `shaft`".
#[must_use]
pub fn mesh_name(h: usize, gear: &str, shaft: &str) -> String {
    format!("tsa_mesh_{h}_{gear}_{shaft}")
}

/// What a baseline keeps of a gear's average: nothing where its angle is not sharp.
#[must_use]
pub fn features(
    machine: &Machine,
    reading: &GearReading,
    channels: &[ChannelInfo],
) -> Vec<Feature> {
    // An angle that drifts blurs high orders: nothing compares, least of all with a sharper average.
    if !reading.is_sharp {
        return Vec::new();
    }
    let gear = &machine.gear(reading.gear).id;
    let shaft = &machine.shaft(reading.shaft).id;
    let unit = channels[reading.channel.0].unit;
    let name = local_name(reading.part, gear, shaft);
    let mut features =
        vec![Feature { name: Arc::from(name), value: reading.local_amplitude, unit }];
    features.extend(reading.shape.map(|shape| Feature {
        name: Arc::from(shape_name(reading.part, gear, shaft)),
        value: shape.deviation,
        unit,
    }));
    if reading.part != Part::Whole {
        return features;
    }
    features.extend((1..).zip(reading.mesh).map(|(h, value)| Feature {
        name: Arc::from(mesh_name(h, gear, shaft)),
        value,
        unit,
    }));
    if let Some(value) = reading.figures.fm4 {
        features.push(Feature {
            name: Arc::from(format!("fm4_{gear}_{shaft}")),
            value,
            unit: Unit::One,
        });
    }
    features
}

/// Averages every gear in every channel offered.
#[must_use]
pub fn read(
    machine: &Machine,
    channels: &[ChannelInfo],
    speed: &Speed,
    inputs: &[Input<'_>],
    cache: &mut FftCache<f64>,
) -> Vec<GearReading> {
    let Some(first) = speed.first.filter(|f| f.0 > 0.0) else { return Vec::new() };
    let mut found = Vec::new();
    for (g, gear) in machine.gears.iter().enumerate() {
        let mut done: Vec<f64> = Vec::new();
        for member in [&gear.driving, &gear.driven] {
            let Some(ratio) = machine.shaft(member.shaft).ratio_to_first else { continue };
            if done.iter().any(|r| (r - ratio).abs() < 1e-9) {
                continue;
            }
            done.push(ratio);
            let Some(followed) = follow(speed, ratio, first.0) else { continue };
            for input in inputs {
                let rate = channels[input.channel.0].sample_rate.0;
                let track = followed.track.seen_from(input.time_s - followed.start_s);
                let usable = super::bands::usable_band(
                    &machine.sensors[input.sensor],
                    channels[input.channel.0].sample_rate,
                );
                let task = Average {
                    rate,
                    samples_per_rev: rate / (first.0 * ratio),
                    teeth: member.teeth,
                    max_order: floor_index(usable.1.0 / (first.0 * ratio)),
                };
                let parts = task.run(input, &track, followed.by_tacho, cache);
                found.extend(parts.into_iter().flatten().map(|r| GearReading {
                    gear: GearIndex(g),
                    shaft: member.shaft,
                    has_angle: followed.is_marked,
                    ..r
                }));
            }
        }
    }
    found
}

/// The angle of a shaft.
struct Followed {
    track: PhaseTrack,
    /// Stream time of the track's t = 0, s.
    start_s: f64,
    /// Whether revolution 0 is a mark on the shaft.
    is_marked: bool,
    by_tacho: bool,
}

/// The angle of a shaft: by tacho when there is one on the first shaft's speed, through the gears if need be; by the
/// shaft's harmonics where its speed changes; else constant.
fn follow(speed: &Speed, ratio: f64, first_hz: f64) -> Option<Followed> {
    if let Some(phase) = &speed.phase {
        let is_same = (ratio - 1.0).abs() < 1e-9;
        let track = if is_same { phase.track.clone() } else { phase.track.times(ratio)? };
        let is_marked = is_same && phase.is_marked;
        return Some(Followed { track, start_s: phase.start_s, is_marked, by_tacho: true });
    }
    // What a speed channel adds up to drifts by more than a tooth.
    let by_harmonics =
        speed.turning.as_ref().filter(|_| speed.source != Some(SpeedSource::SpeedChannel));
    if let Some(turning) = by_harmonics {
        let (track, start_s) = (turning.track.times(ratio)?, turning.start_s);
        return Some(Followed { track, start_s, is_marked: false, by_tacho: false });
    }
    let steady = speed.confidence >= MIN_CONFIDENCE_WITHOUT_TACHO && speed.excursion < 1e-3;
    let track = PhaseTrack::constant(first_hz * ratio)?;
    steady.then_some(Followed { track, start_s: 0.0, is_marked: false, by_tacho: false })
}

/// One average to make.
struct Average {
    rate: f64,
    samples_per_rev: f64,
    teeth: u32,
    max_order: usize,
}

impl Average {
    fn run(
        &self,
        input: &Input<'_>,
        track: &PhaseTrack,
        by_tacho: bool,
        cache: &mut FftCache<f64>,
    ) -> Option<Vec<GearReading>> {
        let points = floor_index(self.samples_per_rev).next_power_of_two().clamp(256, 4096);
        let order_kept = floor_index(0.43 * self.samples_per_rev.min(points as f64));
        let tsa = TsaPlan::new(points, self.samples_per_rev);
        let top = self.max_order.min(order_kept);
        let teeth = self.teeth as usize;
        let orders: Vec<usize> =
            (1..=MESH_HARMONICS).map(|h| h * teeth).filter(|order| *order <= top).collect();
        let along =
            |track: &PhaseTrack| Averaged::along(track, &tsa, (self.rate, input.samples), &orders);
        let mut averaged = along(track)?;
        let mut is_sharp = by_tacho;
        if !by_tacho {
            let parted = tsa.whole_revolutions(input.samples.len(), self.rate, track);
            let corrected = |ahead: &[f64]| mesh_angle::corrected(track, parted, ahead);
            (averaged, is_sharp) = averaged.sharpened(|ahead| along(&corrected(ahead)?));
        }
        let mut mesh_over_scatter = [0.0; MESH_HARMONICS];
        for (of_h, z) in mesh_over_scatter.iter_mut().zip(averaged.mesh.powers_over_scatter()) {
            *of_h = z;
        }
        let read = |part| self.part(part, top, &averaged, input, cache);
        let parts = Part::ALL.into_iter().filter_map(read);
        Some(parts.map(|r| GearReading { is_sharp, mesh_over_scatter, ..r }).collect())
    }

    /// Reads a part of an average in orders up to `top`.
    fn part(
        &self,
        part: Part,
        top: usize,
        Averaged { y, blocks, revolutions, .. }: &Averaged,
        input: &Input<'_>,
        cache: &mut FftCache<f64>,
    ) -> Option<GearReading> {
        let teeth = usize::try_from(self.teeth).ok()?;
        let mut plan = match part {
            Part::Whole => GearPlan::new(y.len(), teeth, top, cache),
            Part::Around(h) => GearPlan::around(h, y.len(), teeth, top, cache),
        }?;
        let figures = plan.process(y);
        let mesh = std::array::from_fn(|i| plan.harmonic_amplitude(i + 1).unwrap_or(0.0));
        let localisation = plan.localise()?;
        let local_amplitude =
            figures.difference_rms * (2.0 * localisation.peak_over_mean[0]).sqrt();
        let (shape, phase_swing_rad) = match part {
            Part::Whole => (Shape::of(plan.residual()), None),
            Part::Around(h) => demodulated(y, teeth, h, cache),
        };
        Some(GearReading {
            gear: GearIndex(0),
            shaft: ShaftIndex(0),
            channel: input.channel,
            part,
            revolutions: *revolutions,
            has_angle: false,
            is_sharp: false,
            mesh,
            mesh_over_scatter: [0.0; MESH_HARMONICS],
            figures,
            shape,
            phase_swing_rad,
            localisation,
            local_amplitude,
            persistence: plan.persistence(blocks, localisation.centre_rev),
            teeth: self.teeth,
            zero_crossing_deg: zero_crossing_deg(y),
            sample_range: input.range,
        })
    }
}

/// One revolution, averaged over the record and over [`N_BLOCKS`] parts of it.
struct Averaged {
    y: Vec<f64>,
    blocks: Vec<Vec<f64>>,
    /// The mesh harmonics inside the band, in the parts.
    mesh: MeshLines,
    revolutions: usize,
}

impl Averaged {
    /// Averages along `track`; `None` if that is of too few revolutions.
    fn along(
        track: &PhaseTrack,
        tsa: &TsaPlan,
        (rate, samples): (f64, &[f32]),
        orders: &[usize],
    ) -> Option<Self> {
        let mut y = vec![0.0_f64; tsa.points_per_rev()];
        let mut blocks = vec![y.clone(); N_BLOCKS];
        let revolutions = tsa.process_blocks(samples, rate, track, &mut y, &mut blocks);
        let mesh = MeshLines::of(&blocks, orders);
        (revolutions >= MIN_REVOLUTIONS).then_some(Self { y, blocks, mesh, revolutions })
    }

    /// The average along the angle that the mesh tells, made anew by `again` where it drifts (D111), and whether that is sharp; if
    /// it is not, the average as it is.
    fn sharpened(self, again: impl Fn(&[f64]) -> Option<Self>) -> (Self, bool) {
        match self.mesh.angle() {
            MeshAngle::Sharp => (self, true),
            MeshAngle::Unknown => (self, false),
            MeshAngle::Drifts(ahead) => match again(&ahead).filter(|a| a.mesh.are_kept()) {
                Some(sharp) => (sharp, true),
                None => (self, false),
            },
        }
    }
}

/// Amplitude and swing of the phase of mesh harmonic `h` over the revolution `y`.
fn demodulated(
    y: &[f64],
    teeth: usize,
    h: usize,
    cache: &mut FftCache<f64>,
) -> (Option<Shape>, Option<f64>) {
    let Some(mut mesh) = MeshDemodPlan::new(y.len(), teeth, h, cache) else { return (None, None) };
    if !mesh.process(y) {
        return (None, None);
    }
    let (least, most) = mesh
        .phase_rad()
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), p| (l.min(*p), m.max(*p)));
    (Shape::of(mesh.amplitude()), Some(most - least))
}

/// Angle at which the first harmonic of one revolution crosses zero upwards: with the component
/// A·cos(θ − φ) it is φ − 90°.
fn zero_crossing_deg(y: &[f64]) -> f64 {
    let (mut c, mut s) = (0.0, 0.0);
    for (i, value) in y.iter().enumerate() {
        let angle = std::f64::consts::TAU * i as f64 / y.len() as f64;
        c += value * angle.cos();
        s += value * angle.sin();
    }
    (s.atan2(c).to_degrees() - 90.0).rem_euclid(360.0)
}

#[cfg(test)]
#[path = "gear_tests.rs"]
mod tests;
