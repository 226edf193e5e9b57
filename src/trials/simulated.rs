//! Scenes of the simulator as records: samples of every sensor in physical values.
//!
//! Must not know which faults a scene has.

use super::Measured;
use crate::dsp::real::Real;
use crate::machine::file;
use crate::pipeline::SpeedHints;
use crate::simulator::scene::Scene;
use crate::simulator::simulation::Samples;
use crate::simulator::simulation::Simulation;
use crate::units::Hz;
use crate::units::Unit;
use std::convert::Infallible;
use std::sync::Arc;
use toml::Table;

/// Why a scene of a trial makes no record.
#[derive(Debug, thiserror::Error)]
#[error("{name}: {why}")]
pub struct NotMade {
    /// What was to be made.
    pub name: String,
    /// What is in the way.
    pub why: String,
}

/// Simulates a scene to its end.
///
/// # Errors
/// When scene or machine cannot be built, or the motion diverges.
pub(super) fn measure(
    name: &str,
    scene_text: &str,
    machine_text: &str,
    seed: u64,
) -> Result<Measured, NotMade> {
    let failed = |why: String| NotMade { name: name.to_owned(), why };
    let scene = Scene::parse(scene_text, name).map_err(|e| failed(e.to_string()))?;
    let machine = file::parse(machine_text, name).map_err(|e| failed(e.to_string()))?;
    let mut simulation = Simulation::new(&scene, seed).map_err(|e| failed(e.to_string()))?;
    let (channels, scales): (Vec<_>, Vec<_>) = simulation
        .channels()
        .map(|c| (super::channel(&c.name, unit_of(c.unit), Hz(c.rate_hz)), (c.scale, c.offset)))
        .unzip();
    let mut samples: Vec<Vec<f32>> = vec![Vec::new(); channels.len()];
    let mut keep = |i: usize, new: Samples<'_>| {
        let (scale, offset) = scales[i];
        let physical = |v: f64| f32::rounded(v * scale + offset);
        match new {
            Samples::Int16(new) => samples[i].extend(new.iter().map(|v| physical(f64::from(*v)))),
            Samples::Float32(new) => samples[i].extend(new.iter().map(|v| physical(f64::from(*v)))),
            Samples::Float64(new) => samples[i].extend(new.iter().map(|v| physical(*v))),
        }
        Ok::<(), Infallible>(())
    };
    let n = scene.duration_s * simulation.rate_hz();
    let n = crate::dsp::real::floor_index(n.round()) as u64;
    simulation.advance(n, &mut keep).map_err(|e| failed(e.to_string()))?;
    Ok(Measured {
        machine: Arc::new(machine),
        machine_text: machine_text.into(),
        channels,
        samples,
        hints: SpeedHints::default(),
    })
}

/// A table of a scene that is to be changed.
pub(super) fn table<'t>(scene: &'t mut Table, key: &str) -> Option<&'t mut Table> {
    scene.get_mut(key)?.as_table_mut()
}

fn unit_of(name: &str) -> Unit {
    match name {
        "um" => Unit::Micrometre,
        "V" => Unit::Volt,
        _ => Unit::MetrePerSecondSquared,
    }
}
