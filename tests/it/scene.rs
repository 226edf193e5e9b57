//! A recording whose truth is known: impacts of a damaged inner race in closed form.
//!
//! At each impact, BPFI times a second with 0.5 % jitter, a 3 kHz resonance rings down; the load
//! zone modulates its strength once a revolution. Each channel also has a 1× line and noise.

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::writer::{CaptureHeader, CaptureWriter};
use rotorwatch::capture::writer::{ChannelHeader, ChannelSamples, ChannelStorage};
use rotorwatch::signal::SampleIndex;
use rotorwatch::units::Hz;
use std::f64::consts::TAU;
use std::path::Path;

/// Samples a second of every channel.
pub(crate) const RATE_HZ: f64 = 12_000.0;

/// Samples of every channel: 12 s.
pub(crate) const N_SAMPLES: usize = 144_000;

/// Speed of the shaft.
pub(crate) const SPEED_HZ: f64 = 25.0;

/// Kinematic BPFI of the bearing `right`: Z/2·(1 + d/D)·f, 9 balls of 7.94 mm on 39.04 mm.
pub(crate) const BPFI_HZ: f64 = 4.5 * (1.0 + 7.94 / 39.04) * SPEED_HZ;

/// Amplitude of the 1× line in every channel, zero to peak, m/s².
pub(crate) const LINE_1X: f64 = 0.5;

/// Its channels: name, and how much of the impacts they hear.
pub(crate) const CHANNELS: [(&str, f64); 3] = [("right_x", 1.0), ("right_y", 0.7), ("left_x", 0.1)];

/// The machine measured: the damaged bearing is `right`.
pub(crate) const MACHINE: &str = r#"
[machine]
id = "rig-1"
name = "Rig"
[[shaft]]
id = "main"
speed_hz = 25.0
[[bearing]]
id = "right"
shaft = "main"
elements = 9
element_diameter_mm = 7.94
pitch_diameter_mm = 39.04
[[bearing]]
id = "left"
shaft = "main"
elements = 8
element_diameter_mm = 6.746
pitch_diameter_mm = 28.499
[[sensor]]
channel = "right_x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 0.0
[[sensor]]
channel = "right_y"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 90.0
[[sensor]]
channel = "left_x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "left" }
axis_deg = 0.0
"#;

const RESONANCE_HZ: f64 = 3000.0;

/// Decay of the resonance, 1/s: damping ratio 0.05.
const DECAY: f64 = 0.05 * TAU * RESONANCE_HZ;

/// First peak of an impact, m/s².
const IMPACT: f64 = 10.0;

/// RMS of the noise, m/s².
const NOISE: f64 = 0.3;

/// The samples of all channels; the same seed gives the same bits.
pub(crate) fn samples(seed: u64) -> Vec<Vec<f32>> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let impacts = impacts(&mut random);
    let channel = |(at, (_, gain)): (usize, &(&str, f64))| {
        let phase = at as f64 * TAU / 4.0;
        let mut x: Vec<f64> = (0..N_SAMPLES)
            .map(|i| {
                let turn = TAU * SPEED_HZ * i as f64 / RATE_HZ;
                LINE_1X * (turn - phase).cos() + NOISE * gaussian(&mut random)
            })
            .collect();
        for &(time_s, strength) in &impacts {
            ring(&mut x, time_s, gain * strength);
        }
        #[expect(clippy::cast_possible_truncation, reason = "f32 is what a channel holds")]
        x.iter().map(|v| *v as f32).collect()
    };
    CHANNELS.iter().enumerate().map(channel).collect()
}

/// Times and strengths of the impacts.
fn impacts(random: &mut Pcg64Mcg) -> Vec<(f64, f64)> {
    let (mut time_s, mut impacts) = (0.0, Vec::new());
    while time_s < N_SAMPLES as f64 / RATE_HZ {
        impacts.push((time_s, IMPACT * (1.0 + 0.8 * (TAU * SPEED_HZ * time_s).cos())));
        time_s += (1.0 + 0.005 * gaussian(random)) / BPFI_HZ;
    }
    impacts
}

/// Adds a ring-down. Its phase makes its integral zero, so that it adds nothing at 1×.
fn ring(x: &mut [f64], time_s: f64, strength: f64) {
    let omega = TAU * RESONANCE_HZ;
    let phase = (DECAY / omega).atan();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 144000")]
    let first = (time_s * RATE_HZ).ceil() as usize;
    // After 200 samples it has decayed to 1e-7.
    for (i, value) in x.iter_mut().enumerate().skip(first).take(200) {
        let t = i as f64 / RATE_HZ - time_s;
        *value += strength * (-DECAY * t).exp() * (omega * t + phase).cos();
    }
}

/// A number of mean 0 and variance 1, nearly normal: the sum of twelve uniform ones.
fn gaussian(random: &mut Pcg64Mcg) -> f64 {
    (0..12).map(|_| random.random_range(-0.5..0.5)).sum()
}

/// Writes channels of `CHANNELS` in m/s² as float32; `segments`: first samples and times.
pub(crate) fn write(path: &Path, channels: &[Vec<f32>], segments: Option<(&[u64], &[f64])>) {
    let header = CaptureHeader { shaft_speed: Some(Hz(SPEED_HZ)), ..CaptureHeader::default() };
    let mut writer = CaptureWriter::create(path, &header).unwrap();
    for ((name, _), samples) in CHANNELS.iter().zip(channels) {
        let header = ChannelHeader {
            name: (*name).to_owned(),
            sample_rate: Hz(RATE_HZ),
            unit: Some("m/s^2".to_owned()),
            sensor: None,
            storage: ChannelStorage::Contiguous,
        };
        writer.channel(&header, ChannelSamples::F32(samples)).unwrap();
    }
    if let Some((starts, times_s)) = segments {
        let starts: Vec<SampleIndex> = starts.iter().copied().map(SampleIndex).collect();
        writer.segments(&starts, times_s).unwrap();
    }
    writer.finish().unwrap();
}
