//! A scene in motion: blocks of samples of every channel, without end, in constant memory.

use super::build::{self, Built, Plan};
use super::linear::{LinearRun, LinearSystem};
use super::model::Model;
use super::rotor::Plane;
use super::run::{Quantity, Run, Watch};
use super::scene::{Faults, NumberKind, Scene, SceneErrors, SceneSensor, SensorKind, Start};
use super::sensor::{Chain, Converter, SensorModel, tacho_mark};
use std::f64::consts::TAU;

/// Most samples of the fastest channel that are computed at a time.
const BLOCK: usize = 1000;

/// Run-in of a scene with contacts that begins rotating: with raised damping, then with its own, s.
const RUN_IN_S: (f64, f64) = (0.4, 0.2);

/// Damping ratio of the first part of the run-in.
const RUN_IN_DAMPING: f64 = 0.1;

/// Voltage of the tacho's mark, and the part of a turn it lasts.
const MARK_V: f64 = 5.0;
const MARK_DUTY: f64 = 0.1;

/// Shortest ramp of the mark: of a turn, and samples.
const MARK_RISE: (f64, f64) = (0.01, 3.0);

/// What a channel states about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedChannel {
    /// Name.
    pub name: String,
    /// Unit of physical values.
    pub unit: &'static str,
    /// Samples a second.
    pub rate_hz: f64,
    /// Number type of the samples.
    pub number: NumberKind,
    /// Physical = raw·scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// What watches, for people.
    pub sensor: String,
}

/// Samples of one channel, in order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples<'a> {
    /// Counts.
    Int16(&'a [i16]),
    /// Physical values.
    Float32(&'a [f32]),
    /// Physical values.
    Float64(&'a [f64]),
}

/// Why a simulation does not go on.
#[derive(Debug, thiserror::Error)]
pub enum AdvanceError<E> {
    /// The motion is no number any more.
    #[error(
        "the motion grew without bound before {time_s} s; lower `accuracy` or check the scene's stiffnesses"
    )]
    Diverged {
        /// Time of the last sample, s.
        time_s: f64,
    },
    /// Who takes the samples refused them.
    #[error(transparent)]
    Sink(#[from] E),
}

/// A scene in motion.
#[derive(Debug)]
pub struct Simulation {
    scene: Scene,
    plane: Plane,
    model: Model,
    plan: Plan,
    watches: Vec<Watch>,
    engine: Engine,
    channels: Vec<Channel>,
    n_samples: u64,
    /// Values of every watch in the present block, linear scenes only.
    motion: Vec<Vec<f64>>,
}

#[derive(Debug)]
enum Engine {
    Linear(Box<LinearRun>),
    Stepped(Box<Run>),
}

/// A sensor at work.
#[derive(Debug)]
struct Channel {
    info: SimulatedChannel,
    sensor: SceneSensor,
    /// Number of its watch; `None`: the tacho.
    watch: Option<usize>,
    /// Samples of the fastest channel for each of its own.
    every: u64,
    chain: Chain,
    converter: Option<Converter>,
    counts: Vec<i16>,
    singles: Vec<f32>,
    doubles: Vec<f64>,
    n_clipped: u64,
    furthest: f64,
}

impl Simulation {
    /// Builds a scene with this seed of the noise and brings it to time 0.
    ///
    /// # Errors
    ///
    /// What cannot be built: a free shaft, more modes than degrees of freedom, speeds beyond the
    /// modelled band, bearings under which motion grows, no steady motion to begin with.
    pub fn new(scene: &Scene, seed: u64) -> Result<Self, SceneErrors> {
        let Built { plane, model, plan } = build::build(scene)?;
        let watching = |sensor: &&SceneSensor| sensor.kind != SensorKind::Tacho;
        let watches: Vec<Watch> = scene
            .sensors
            .iter()
            .filter(watching)
            .map(|sensor| Watch {
                row: model.basis.row(plane.displacement_at(sensor.at_m)),
                axis_rad: sensor.axis_rad,
                quantity: match sensor.kind {
                    SensorKind::Accelerometer => Quantity::Acceleration,
                    SensorKind::Proximitor | SensorKind::Tacho => Quantity::Displacement,
                },
            })
            .collect();
        let engine = engine(scene, &model, &plan, &watches)?;
        let mut next = 0;
        let channels = scene.sensors.iter().enumerate().map(|(i, sensor)| {
            let watch = (sensor.kind != SensorKind::Tacho).then_some(next);
            next += usize::from(watch.is_some());
            Channel::new(sensor, watch, &plan, (seed, i as u64))
        });
        let channels = channels.collect();
        let motion = vec![Vec::new(); watches.len()];
        let scene = scene.clone();
        Ok(Self { scene, plane, model, plan, watches, engine, channels, n_samples: 0, motion })
    }

    /// The channels, in the order of the scene's sensors.
    pub fn channels(&self) -> impl Iterator<Item = &SimulatedChannel> {
        self.channels.iter().map(|channel| &channel.info)
    }

    /// What was chosen for the scene.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Samples a second of the fastest channel: what [`Simulation::advance`] counts.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.plan.rate_hz
    }

    /// Computes the next `n_samples` of the fastest channel, and of the slower ones what falls into
    /// the same time, and hands blocks of them to `sink` by number of the channel. How the samples
    /// are cut into calls changes none of them.
    ///
    /// # Errors
    ///
    /// [`AdvanceError`] when the motion diverges or the sink refuses.
    pub fn advance<E>(
        &mut self,
        n_samples: u64,
        sink: &mut impl FnMut(usize, Samples<'_>) -> Result<(), E>,
    ) -> Result<(), AdvanceError<E>> {
        let mut left = n_samples;
        while left > 0 {
            let n = usize::try_from(left).unwrap_or(BLOCK).min(BLOCK);
            self.block(n);
            for (i, channel) in self.channels.iter_mut().enumerate() {
                if let Some(samples) = channel.taken() {
                    sink(i, samples)?;
                }
                channel.clear();
            }
            let finite = match &self.engine {
                Engine::Linear(_) => true,
                Engine::Stepped(run) => run.state().0.iter().all(|q| q.is_finite()),
            };
            if !finite {
                let time_s = self.n_samples as f64 / self.plan.rate_hz;
                return Err(AdvanceError::Diverged { time_s });
            }
            left -= n as u64;
        }
        Ok(())
    }

    /// Exchanges the faults of bearings and shaft from the next sample on. The motion goes on from
    /// where it is: no reset, no step in the displacement.
    ///
    /// # Errors
    ///
    /// A defect of a bearing that is no ball bearing of the scene, or a bow the shaft cannot take;
    /// nothing is changed then. The points of a bow go to the nearest nodes.
    pub fn set_faults(&mut self, faults: &Faults) -> Result<(), SceneErrors> {
        let mut model = self.model.clone();
        build::set_faults(&self.scene, &self.plane, &mut model, faults)?;
        match &mut self.engine {
            Engine::Linear(run) => {
                if !run.set_loads(&model, &self.watches) {
                    return Err(no_steady(&self.scene));
                }
            }
            Engine::Stepped(run) => run.change(|running| {
                running.bow = model.bow.clone();
                for (seat, new) in running.seats.iter_mut().zip(&model.seats) {
                    seat.contacts = new.contacts.clone();
                }
                for (gear, new) in running.gears.iter_mut().zip(&model.gears) {
                    gear.mesh = new.mesh.clone();
                }
            }),
        }
        self.model = model;
        Ok(())
    }

    /// What went beyond what the scene can tell so far: ball loads beyond yield, probes touched,
    /// converters clipped. One sentence each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Engine::Stepped(run) = &self.engine {
            let loads = self.scene.ball_bearings().zip(&run.model().seats);
            for ((id, ball), seat) in loads {
                let load_n = seat.contacts.peak_force_n();
                if let Some(limit) = ball.yield_load_n.filter(|limit| load_n > *limit) {
                    warnings.push(format!(
                        "bearing {id}: a ball carried {load_n:.0} N, beyond the {limit:.0} N at which its contact \
                         reaches 4200 MPa and yields; the model stays elastic"
                    ));
                }
            }
        }
        for channel in &self.channels {
            let (name, gap) = (&channel.info.name, channel.sensor.rest.abs());
            let is_probe = channel.sensor.kind == SensorKind::Proximitor;
            if is_probe && gap > 0.0 && channel.furthest > gap {
                let (most, unit) = (channel.furthest, channel.info.unit);
                warnings.push(format!(
                    "{name}: the shaft moved {most:.3} {unit}, more than the gap of {gap} {unit}"
                ));
            }
            if channel.n_clipped > 0 {
                let n = channel.n_clipped;
                warnings.push(format!("{name}: {n} samples beyond the converter's full_scale"));
            }
        }
        warnings
    }

    fn block(&mut self, n: usize) {
        let start = self.n_samples;
        let rate_hz = self.plan.rate_hz;
        match &mut self.engine {
            Engine::Linear(run) => {
                run.fill(n, &mut self.motion);
                for channel in &mut self.channels {
                    let values = channel.watch.map(|watch| &self.motion[watch][..]);
                    for i in 0..n as u64 {
                        if !(start + i).is_multiple_of(channel.every) {
                            continue;
                        }
                        #[expect(clippy::cast_possible_truncation, reason = "below a block")]
                        let value = values.map(|values| values[i as usize]);
                        let time_s = (start + i) as f64 / rate_hz;
                        channel.sample(value, time_s, &self.scene);
                    }
                }
            }
            Engine::Stepped(run) => {
                for i in 0..n as u64 {
                    for step in 0..self.plan.steps_per_sample {
                        run.step();
                        for channel in &mut self.channels {
                            match channel.watch {
                                Some(watch) => channel.push(run.observe(&self.watches[watch])),
                                None if step == 0 && (start + i).is_multiple_of(channel.every) => {
                                    let time_s = (start + i) as f64 / rate_hz;
                                    channel.sample(None, time_s, &self.scene);
                                }
                                None => {}
                            }
                        }
                    }
                }
            }
        }
        self.n_samples += n as u64;
    }
}

fn no_steady(scene: &Scene) -> SceneErrors {
    let allowed = "loads with a finite steady motion: damping above 0, or another speed";
    scene.mistake("speed", "a speed exactly at an undamped resonance", allowed)
}

/// The engine at time 0.
fn engine(
    scene: &Scene,
    model: &Model,
    plan: &Plan,
    watches: &[Watch],
) -> Result<Engine, SceneErrors> {
    let at_start = scene.speed.at(0.0);
    let speed_hz = at_start.speed_rad_per_s / TAU;
    let zero = vec![0.0; 2 * model.basis.len()];
    if plan.is_linear {
        let rest = (scene.start == Start::Rest).then_some((&zero[..], &zero[..]));
        let run = LinearRun::new(model, speed_hz, watches, plan.rate_hz, rest);
        return run.map(|run| Engine::Linear(Box::new(run))).ok_or_else(|| no_steady(scene));
    }
    let step_s = 1.0 / (plan.rate_hz * f64::from(plan.steps_per_sample));
    if scene.start == Start::Rest {
        return Ok(Engine::Stepped(Box::new(Run::new(model.clone(), step_s, None))));
    }
    let system = LinearSystem::new(model, at_start.speed_rad_per_s);
    let steady = system.steady(model).ok_or_else(|| no_steady(scene))?;
    if model.seats.is_empty() && model.gears.is_empty() {
        let state = Some(steady.at(&system, at_start.angle_rad));
        return Ok(Engine::Stepped(Box::new(Run::new(model.clone(), step_s, state))));
    }
    #[expect(clippy::cast_possible_truncation, reason = "some ten thousand")]
    let before = |seconds: f64| -(seconds / step_s).round() as i64;
    let mut relaxed = model.clone();
    relaxed.damp_at_least(RUN_IN_DAMPING);
    let (first, second) = (before(RUN_IN_S.0 + RUN_IN_S.1), before(RUN_IN_S.1));
    let from = scene.speed.at(first as f64 * step_s);
    let state = Some(steady.at(&system, from.angle_rad));
    let mut run = Run::new(relaxed, step_s, state).beginning_at(first);
    (first..second).for_each(|_| run.step());
    let state = (run.state().0.to_vec(), run.state().1.to_vec());
    let mut run = Run::new(model.clone(), step_s, Some(state)).beginning_at(second);
    (second..0).for_each(|_| run.step());
    Ok(Engine::Stepped(Box::new(run)))
}

impl Channel {
    fn new(
        sensor: &SceneSensor,
        watch: Option<usize>,
        plan: &Plan,
        (seed, number): (u64, u64),
    ) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to 1e5")]
        let every = (plan.rate_hz / sensor.rate_hz).round() as u32;
        let is_filtered = !plan.is_linear && watch.is_some();
        let converter = (sensor.number == NumberKind::Int16)
            .then_some(Converter { range: sensor.full_scale, bits: sensor.bits });
        let kind = match sensor.kind {
            SensorKind::Accelerometer => "simulated accelerometer",
            SensorKind::Proximitor => "simulated proximity probe",
            SensorKind::Tacho => "simulated tacho, one mark a turn",
        };
        let chain = SensorModel {
            oversampling: if is_filtered { every * plan.steps_per_sample } else { 1 },
            rate_hz: sensor.rate_hz,
            corner_hz: is_filtered.then_some(sensor.corner_hz),
            noise_density: sensor.noise_density,
            drift_per_s: sensor.drift_per_s,
            rest: sensor.rest,
            converter,
            dropouts_s: sensor.dropouts_s.clone(),
        };
        Self {
            info: SimulatedChannel {
                name: sensor.channel.clone(),
                unit: sensor.unit,
                rate_hz: sensor.rate_hz,
                number: sensor.number,
                scale: converter.map_or(1.0, |converter| converter.scale()),
                offset: if converter.is_some() { sensor.rest } else { 0.0 },
                sensor: kind.to_owned(),
            },
            sensor: sensor.clone(),
            watch,
            every: u64::from(every),
            chain: Chain::new(chain, seed, number),
            converter,
            counts: Vec::new(),
            singles: Vec::new(),
            doubles: Vec::new(),
            n_clipped: 0,
            furthest: 0.0,
        }
    }

    /// Takes a value of the inner rate, SI.
    fn push(&mut self, value: f64) {
        let value = value * self.sensor.per_si;
        self.furthest = self.furthest.max(value.abs());
        if let Some(sample) = self.chain.push(value) {
            self.keep(sample);
        }
    }

    /// Takes a value that needs no filter, SI; `None`: the tacho makes its own.
    fn sample(&mut self, value: Option<f64>, time_s: f64, scene: &Scene) {
        let value = match value {
            Some(value) => value * self.sensor.per_si,
            None => {
                let turning = scene.speed.at(time_s);
                let a_sample = turning.speed_rad_per_s.abs() / self.sensor.rate_hz;
                let rise = (MARK_RISE.0 * TAU).max(MARK_RISE.1 * a_sample);
                MARK_V * tacho_mark(turning.angle_rad, MARK_DUTY, rise)
            }
        };
        self.furthest = self.furthest.max(value.abs());
        let sample = self.chain.sample(value);
        self.keep(sample);
    }

    fn keep(&mut self, sample: f64) {
        match (self.converter, self.info.number) {
            (Some(converter), _) => {
                let value = sample - self.info.offset;
                self.n_clipped += u64::from(value.abs() > converter.range);
                self.counts.push(converter.count(value));
            }
            (None, NumberKind::Float64) => self.doubles.push(sample),
            #[expect(clippy::cast_possible_truncation, reason = "asked for")]
            (None, NumberKind::Float32 | NumberKind::Int16) => self.singles.push(sample as f32),
        }
    }

    fn taken(&self) -> Option<Samples<'_>> {
        let samples = match self.info.number {
            NumberKind::Int16 => Samples::Int16(&self.counts),
            NumberKind::Float32 => Samples::Float32(&self.singles),
            NumberKind::Float64 => Samples::Float64(&self.doubles),
        };
        let is_empty = match samples {
            Samples::Int16(list) => list.is_empty(),
            Samples::Float32(list) => list.is_empty(),
            Samples::Float64(list) => list.is_empty(),
        };
        (!is_empty).then_some(samples)
    }

    fn clear(&mut self) {
        self.counts.clear();
        self.singles.clear();
        self.doubles.clear();
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod gear_tests;
