//! What the transforms are measured on: a gearbox as an accelerometer hears it.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Samples a second.
pub(in crate::bench) const FS_HZ: f64 = 10_000.0;
/// Shaft speed.
pub(in crate::bench) const SHAFT_HZ: f64 = 29.7;
/// Mesh frequency, 23 teeth.
pub(super) const MESH_HZ: f64 = 683.1;
/// Rate of impacts of a bearing, and what they ring at.
pub(super) const IMPACTS_HZ: f64 = 161.3;
const RING_HZ: f64 = 3200.0;
/// Band of the ringing.
pub(super) const BAND_HZ: (f64, f64) = (2000.0, 4000.0);

/// `n` samples, g: 1×, mesh and its harmonics with side bands, ringing impacts, noise of 0.3 g. Every
/// sample is a number of f32, so that both precisions have the same input.
pub(in crate::bench) fn gearbox(n: usize, seed: u64) -> Vec<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let sample = |i: usize| {
        let t = i as f64 / FS_HZ;
        let line = |f_hz: f64, amplitude: f64| amplitude * (TAU * f_hz * t).cos();
        let mesh = line(MESH_HZ, 1.0) + line(2.0 * MESH_HZ, 0.4) + line(3.0 * MESH_HZ, 0.2);
        let after = (t * IMPACTS_HZ).fract() / IMPACTS_HZ;
        let ringing = 2.0 * (-800.0 * after).exp() * (TAU * RING_HZ * after).sin();
        let noise: f64 = StandardNormal.sample(&mut random);
        let x = line(SHAFT_HZ, 0.5) + mesh * (1.0 + line(SHAFT_HZ, 0.3)) + ringing + 0.3 * noise;
        #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
        let rounded = x as f32;
        f64::from(rounded)
    };
    (0..n).map(sample).collect()
}
