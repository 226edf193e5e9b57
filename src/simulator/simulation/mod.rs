//! A scene in motion: blocks of samples of every channel, without end, in constant memory.

mod engine;
mod step_choice;

use super::build::{self, Built, Plan};
use super::model::Model;
use super::ports::Sensed;
use super::rotor::Plane;
use super::run::{Quantity, Watch};
use super::scene::{Faults, NumberKind, Scene, SceneErrors, SceneSensor, SensorKind};
use super::sensor::{Chain, Converter, SensorModel, tacho_mark};
use engine::{Engine, Refusal};
use std::f64::consts::TAU;

/// Most samples of the fastest channel that are computed at a time.
const BLOCK: usize = 1000;

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
    sensed: Vec<Sensed>,
    engine: Engine,
    channels: Vec<Channel>,
    n_samples: u64,
    /// Values of every watch in the present block: one a sample in linear scenes, else one a step.
    motion: Vec<Vec<f64>>,
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
    /// modelled band, bearings under which motion grows, no steady motion to begin with, motion too fast for the shortest step.
    pub fn new(scene: &Scene, seed: u64) -> Result<Self, SceneErrors> {
        let Built { plane, model, mut plan } = build::build(scene)?;
        let watching = |sensor: &&SceneSensor| sensor.kind != SensorKind::Tacho;
        let sensed: Vec<Sensed> = scene
            .sensors
            .iter()
            .filter(watching)
            .map(|sensor| Sensed {
                watch: Watch {
                    row: model.basis.row(plane.displacement_at(sensor.place)),
                    axis_rad: sensor.axis_rad,
                    quantity: match sensor.kind {
                        SensorKind::Accelerometer => Quantity::Acceleration,
                        SensorKind::Proximitor | SensorKind::Tacho => Quantity::Displacement,
                    },
                },
                corner_hz: Some(sensor.corner_hz),
            })
            .collect();
        let begun = Engine::new(scene, &model, &plan, &sensed);
        let (engine, choice) = begun.map_err(|refusal| match refusal {
            Refusal::NoSteady => no_steady(scene),
            Refusal::TooFast => too_fast(scene),
        })?;
        if let Some(choice) = choice {
            plan.steps_per_sample = choice.steps_per_sample;
            plan.cuts_at_contact = choice.cuts_at_contact;
            plan.expected_error = choice.error;
            plan.is_error_measured = true;
        }
        plan.is_filtered = engine.is_filtered();
        let mut next = 0;
        let channels = scene.sensors.iter().enumerate().map(|(i, sensor)| {
            let watch = (sensor.kind != SensorKind::Tacho).then_some(next);
            next += usize::from(watch.is_some());
            Channel::new(sensor, watch, &plan, (seed, i as u64))
        });
        let channels = channels.collect();
        let motion = vec![Vec::new(); sensed.len()];
        let scene = scene.clone();
        Ok(Self { scene, plane, model, plan, sensed, engine, channels, n_samples: 0, motion })
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

    /// Displacements and velocities of all coordinates at the next sample: to be compared with a reference from there on.
    /// `None` where no motion is integrated: a linear scene.
    #[must_use]
    pub fn state(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        self.engine.state()
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
            if !self.engine.is_finite() {
                let time_s = self.n_samples as f64 / self.plan.rate_hz;
                return Err(AdvanceError::Diverged { time_s });
            }
            left -= n as u64;
        }
        Ok(())
    }

    /// Exchanges the faults of bearings, shaft and teeth from the next sample on. The motion goes on from
    /// where it is: no reset, no step in the displacement.
    ///
    /// # Errors
    ///
    /// A defect of a bearing that is no ball bearing of the scene, a fault of a tooth that is not there or
    /// leaves too little of it, or a bow the shaft cannot take;
    /// nothing is changed then. The points of a bow go to the nearest nodes.
    pub fn set_faults(&mut self, faults: &Faults) -> Result<(), SceneErrors> {
        let mut model = self.model.clone();
        build::set_faults(&self.scene, &self.plane, &mut model, faults)?;
        if !self.engine.change(&model, &self.sensed) {
            return Err(no_steady(&self.scene));
        }
        self.model = model;
        Ok(())
    }

    /// What went beyond what the scene can tell so far: the accuracy asked for, ball loads beyond yield, probes touched,
    /// converters clipped. One sentence each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let (asked, expected) = (self.scene.accuracy, self.plan.expected_error);
        if self.plan.is_error_measured && expected > asked {
            warnings.push(format!(
                "the accuracy of {asked:.0e} is not kept: two steps, one half of the other, part by {expected:.0e} at \
                 the beginning, the shortest one too"
            ));
        }
        for ((id, ball), load_n) in self.scene.ball_bearings().zip(self.engine.peak_loads_n()) {
            if let Some(limit) = ball.yield_load_n.filter(|limit| load_n > *limit) {
                warnings.push(format!(
                    "bearing {id}: a ball carried {load_n:.0} N, beyond the {limit:.0} N at which its contact \
                     reaches 4200 MPa and yields; the model stays elastic"
                ));
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
        self.engine.fill(n, &mut self.motion);
        for channel in &mut self.channels {
            match channel.watch {
                Some(watch) if self.plan.is_filtered => channel.pick(&self.motion[watch], start),
                Some(watch) => channel.filter(&self.motion[watch]),
                None => channel.mark((start, n as u64), rate_hz, &self.scene),
            }
            channel.convert();
        }
        self.n_samples += n as u64;
    }
}

fn too_fast(scene: &Scene) -> SceneErrors {
    let found = "parts that move too fast for steps of 0.5 µs: the motion grows without bound";
    let allowed = "softer contacts, less damping of bearings, or heavier parts";
    scene.mistake("bearing[0]", found, allowed)
}

fn no_steady(scene: &Scene) -> SceneErrors {
    let allowed = "loads with a finite steady motion: damping above 0, or another speed";
    scene.mistake("speed", "a speed exactly at an undamped resonance", allowed)
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
        let is_filtered = !plan.is_filtered && watch.is_some();
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

    /// Takes values of the inner rate, SI.
    fn filter(&mut self, values: &[f64]) {
        for value in values {
            let value = value * self.sensor.per_si;
            self.furthest = self.furthest.max(value.abs());
            if let Some(sample) = self.chain.push(value) {
                self.doubles.push(sample);
            }
        }
    }

    /// Takes values of the fastest channel from sample `start` on that need no filter, SI.
    fn pick(&mut self, values: &[f64], start: u64) {
        let first = self.first_after(start);
        #[expect(clippy::cast_possible_truncation, reason = "a ratio of rates")]
        for value in values.iter().skip(first as usize).step_by(self.every as usize) {
            self.sample(value * self.sensor.per_si);
        }
    }

    /// Samples of the fastest channel from number `start` on to the first that is the channel's own too.
    fn first_after(&self, start: u64) -> u64 {
        start.next_multiple_of(self.every) - start
    }

    /// The tacho's samples of `n` of the fastest channel from number `start` on.
    fn mark(&mut self, (start, n): (u64, u64), rate_hz: f64, scene: &Scene) {
        let turns = scene.turns(self.sensor.place.shaft);
        let first = start + self.first_after(start);
        #[expect(clippy::cast_possible_truncation, reason = "a ratio of rates")]
        for i in (first..start + n).step_by(self.every as usize) {
            let turning = scene.speed.at(i as f64 / rate_hz);
            let a_sample = (turns * turning.speed_rad_per_s).abs() / self.sensor.rate_hz;
            let rise = (MARK_RISE.0 * TAU).max(MARK_RISE.1 * a_sample);
            self.sample(MARK_V * tacho_mark(turns * turning.angle_rad, MARK_DUTY, rise));
        }
    }

    /// Takes a value that needs no filter, in the sensor's unit.
    fn sample(&mut self, value: f64) {
        self.furthest = self.furthest.max(value.abs());
        let sample = self.chain.sample(value);
        self.doubles.push(sample);
    }

    /// Turns the block's samples into the channel's numbers.
    fn convert(&mut self) {
        match (self.converter, self.info.number) {
            (Some(converter), _) => {
                let offset = self.info.offset;
                let over = |x: &&f64| (**x - offset).abs() > converter.range;
                self.n_clipped += self.doubles.iter().filter(over).count() as u64;
                self.counts.extend(self.doubles.iter().map(|x| converter.count(x - offset)));
            }
            (None, NumberKind::Float64) => {}
            #[expect(clippy::cast_possible_truncation, reason = "asked for")]
            (None, NumberKind::Float32 | NumberKind::Int16) => {
                self.singles.extend(self.doubles.iter().map(|x| *x as f32));
            }
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
