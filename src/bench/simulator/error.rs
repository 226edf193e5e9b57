//! Error of a record's motion as sensors see it, against the slow reference.

use crate::bench::BenchError;
use crate::bench::records::{Exact, ported, steps, worst};
use crate::simulator::reference::scene::Setting;
use crate::simulator::scene::{NumberKind, Scene, SceneSensor, SensorKind, Start};
use crate::simulator::simulation::{Samples, Simulation};
use std::convert::Infallible;
use std::f64::consts::FRAC_PI_2;

/// What was found, each the largest difference ÷ the largest value of the worst channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    /// Of the bearings' displacement along x and y, as clean probes see it.
    pub(super) bearings: f64,
    /// Of the scene's sensors, clean.
    pub(super) sensors: f64,
    /// Of the reference, by a looser tolerance: all of these channels.
    pub(super) of_reference: f64,
    /// Step of the run that was compared, s.
    pub(super) step_s: f64,
}

/// Compares the first `seconds`, the start included.
pub(super) fn measure(
    scene: &Scene,
    seconds: f64,
    tolerances: [f64; 2],
) -> Result<Found, BenchError> {
    let n_own = scene.sensors.iter().filter(|s| s.kind != SensorKind::Tacho).count();
    let scene = observed(scene);
    let mut simulation = Simulation::new(&scene, 0)?;
    let plan = simulation.plan().clone();
    let step_s = plan.step_s();
    let mut setting = Setting::new(&scene)?;
    let contacts = !plan.is_linear;
    let contacts = contacts.then(|| ported(&setting, step_s, seconds, plan.cuts_at_contact));
    let found = match contacts.flatten() {
        // A simulation's own filters are in continuous time; the reference's are digital. What is
        // compared is the motion, both through the digital ones.
        Some(record) => record.sensors,
        None => {
            if scene.start == Start::Rest {
                // A digital filter of a simulation begins settled on the first value; so must this.
                let rest = || vec![0.0; setting.model.oscillators().omega_rad_per_s.len()];
                setting.state = Some((rest(), rest()));
            }
            samples(&mut simulation, seconds)?
        }
    };
    let exact =
        |tolerance: f64| Exact::new(&setting, step_s, seconds, tolerance).at(step_s).sensors;
    let [exact, looser] = tolerances.map(exact);
    Ok(Found {
        bearings: worst(&found[n_own..], &exact[n_own..]),
        sensors: worst(&found[..n_own], &exact[..n_own]),
        of_reference: worst(&looser, &exact),
        step_s,
    })
}

/// The scene with clean sensors, and clean probes at every bearing along x and y behind them.
fn observed(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let rate_hz = scene.sensors.iter().map(|sensor| sensor.rate_hz).fold(0.0, f64::max);
    let at =
        scene.bearings.iter().flat_map(|b| [0.0, FRAC_PI_2].map(|axis_rad| (b.place, axis_rad)));
    let probes: Vec<SceneSensor> = at
        .enumerate()
        .map(|(i, (place, axis_rad))| SceneSensor {
            channel: format!("bearing probe {i}"),
            kind: SensorKind::Proximitor,
            place,
            axis_rad,
            rate_hz,
            corner_hz: 0.4 * rate_hz,
            unit: "um",
            per_si: 1e6,
            noise_density: 0.0,
            full_scale: 1e3,
            bits: 16,
            number: NumberKind::Float64,
            drift_per_s: 0.0,
            rest: 0.0,
            dropouts_s: Vec::new(),
        })
        .collect();
    for sensor in &mut scene.sensors {
        (sensor.noise_density, sensor.drift_per_s, sensor.rest) = (0.0, 0.0, 0.0);
        sensor.number = NumberKind::Float64;
        sensor.dropouts_s.clear();
    }
    scene.sensors.extend(probes);
    scene
}

/// Samples of every channel but tachos, SI.
fn samples(simulation: &mut Simulation, seconds: f64) -> Result<Vec<Vec<f64>>, BenchError> {
    let sensors = simulation.scene().sensors.clone();
    let mut lists = vec![Vec::new(); sensors.len()];
    let n = steps(seconds, 1.0 / simulation.rate_hz());
    simulation.advance(n as u64, &mut |channel, samples| {
        if let Samples::Float64(samples) = samples {
            lists[channel].extend(samples.iter().map(|x| x / sensors[channel].per_si));
        }
        Ok::<(), Infallible>(())
    })?;
    let seen = lists.into_iter().zip(&sensors).filter(|(_, s)| s.kind != SensorKind::Tacho);
    Ok(seen.map(|(list, _)| list).collect())
}
