//! A scene's model and watches for the [`Reference`], and for anything that is to be compared with it.

use super::super::build::{self, Built, Plan};
use super::super::linear::LinearSystem;
use super::super::model::Model;
use super::super::rotor::Place;
use super::super::run::{Quantity, Watch};
use super::super::scene::{Scene, SceneErrors, SceneSensor, SensorKind, Start};
use super::super::sensor::{Chain, SensorModel};
use super::Reference;
use std::f64::consts::TAU;

/// What a scene's motion is computed from and what is looked at.
#[derive(Debug, Clone)]
pub struct Setting {
    /// The model.
    pub model: Model,
    /// What was chosen for the scene.
    pub plan: Plan,
    /// Displacement of every bearing along x and y.
    pub bearings: Vec<Watch>,
    /// What each sensor but a tacho looks at, in SI.
    pub sensors: Vec<Watch>,
    /// Rate and corner of those sensors, Hz.
    pub filters: Vec<(f64, f64)>,
    /// Displacements and velocities at time 0; `None`: rest.
    pub state: Option<(Vec<f64>, Vec<f64>)>,
}

impl Setting {
    /// Builds a scene. A scene with ball bearings that starts rotating begins at the linear system's
    /// steady motion, without run-in.
    ///
    /// # Errors
    ///
    /// What [`Simulation::new`](super::super::simulation::Simulation::new) refuses.
    pub fn new(scene: &Scene) -> Result<Self, SceneErrors> {
        let Built { plane, model, plan } = build::build(scene)?;
        let row = |place: Place| model.basis.row(plane.displacement_at(place));
        let both = |place: Place| {
            [0.0, 0.25 * TAU].map(|axis_rad| Watch {
                row: row(place),
                axis_rad,
                quantity: Quantity::Displacement,
            })
        };
        let bearings = scene.bearings.iter().flat_map(|bearing| both(bearing.place)).collect();
        let watching: Vec<&SceneSensor> =
            scene.sensors.iter().filter(|sensor| sensor.kind != SensorKind::Tacho).collect();
        let watch = |sensor: &&SceneSensor| Watch {
            row: row(sensor.place),
            axis_rad: sensor.axis_rad,
            quantity: match sensor.kind {
                SensorKind::Accelerometer => Quantity::Acceleration,
                SensorKind::Proximitor | SensorKind::Tacho => Quantity::Displacement,
            },
        };
        let state = if scene.start == Start::Rotating {
            let system = LinearSystem::new(&model, model.speed.at(0.0).speed_rad_per_s);
            system.steady(&model).map(|steady| steady.at(&system, 0.0))
        } else {
            None
        };
        Ok(Self {
            bearings,
            sensors: watching.iter().map(watch).collect(),
            filters: watching.iter().map(|s| (s.rate_hz, s.corner_hz)).collect(),
            state,
            plan,
            model,
        })
    }

    /// The reference of this motion, to be observed every `step_s`.
    #[must_use]
    pub fn reference(&self, step_s: f64, tolerance: f64) -> Reference {
        Reference::new(self.model.clone(), step_s, self.state.clone(), tolerance)
    }

    /// What a clean sensor makes of values every `step_s`, SI: anti-alias filter and sampling. From rest
    /// the filter begins empty: what the load's onset does to the acceleration at time 0 is beyond its band.
    ///
    /// # Panics
    ///
    /// If there is no such sensor, or its sample is not a whole number of steps.
    #[must_use]
    pub fn sampled(&self, sensor: usize, step_s: f64, values: &[f64]) -> Vec<f64> {
        let (rate_hz, corner_hz) = self.filters[sensor];
        let every = 1.0 / (rate_hz * step_s);
        assert!((every - every.round()).abs() < 1e-6, "{every} steps a sample");
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to 1e5")]
        let oversampling = every.round() as u32;
        let chain = SensorModel {
            oversampling,
            rate_hz,
            corner_hz: Some(corner_hz),
            noise_density: 0.0,
            drift_per_s: 0.0,
            rest: 0.0,
            converter: None,
            dropouts_s: Vec::new(),
        };
        let mut chain = Chain::new(chain, 0, 0);
        let from_rest = self.state.is_none();
        if from_rest {
            for _ in 0..oversampling {
                let _ = chain.push(0.0);
            }
        }
        values.iter().filter_map(|value| chain.push(*value)).collect()
    }
}
