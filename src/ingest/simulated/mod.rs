//! A scene that runs for ever as a source of samples: paced, its damage exchanged while it runs.
//!
//! Samples are cut into short blocks, all channels alike. A simulation can wait and cannot skip: when
//! it is late it loses no sample, it lags, and what is beyond [`MAX_LAG_S`] is given up and counted.
//! Must not know the clock, the queue behind it, or what a diagnosis makes of the samples.

use super::replay::Speed;
use super::replay::Step;
use super::replay::StreamInfo;
use crate::capture::live::LiveChannel;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::machine::Machine;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::SampleIndex;
use crate::simulator::scenario;
use crate::simulator::scenario::ScenarioError;
use crate::simulator::scenario::Wanted;
use crate::simulator::scene::Faults;
use crate::simulator::scene::NumberKind;
use crate::simulator::scene::Scene;
use crate::simulator::scene::SceneErrors;
use crate::simulator::simulation::AdvanceError;
use crate::simulator::simulation::Samples;
use crate::simulator::simulation::SimulatedChannel;
use crate::simulator::simulation::Simulation;
use crate::simulator::speed::SpeedProfile;
use crate::units::Hz;
use std::convert::Infallible;
use std::ops::ControlFlow;

/// Longest block, s of simulated time; also at most as much time of the clock.
pub const BLOCK_S: f64 = 0.1;

/// Samples of the fastest channel between two looks at the stop.
const PIECE: u64 = 250;

/// Lag that is caught up, s of the clock; a longer one is given up, so that it cannot grow.
pub const MAX_LAG_S: f64 = 1.0;

/// Which scene, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The scene.
    pub scene: Scene,
    /// Seed of the noise.
    pub seed: u64,
    /// How fast.
    pub speed: Speed,
    /// What it begins with; `None`: the scene's own faults.
    pub scenario: Option<Wanted>,
}

/// Why a simulated source cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The scene cannot be built.
    #[error("the scene cannot be simulated")]
    Scene(#[from] SceneErrors),
    /// It cannot begin with the scenario.
    #[error("the scene cannot begin with this scenario")]
    Scenario(#[from] ScenarioError),
    /// A channel's scale is out of range.
    #[error(
        "channel {name}: its scale and unit leave the range of single precision; change full_scale"
    )]
    Channel {
        /// The channel.
        name: String,
    },
}

/// Why a simulation does not go on.
pub type RunError = AdvanceError<Infallible>;

/// A simulated source.
#[derive(Debug)]
pub struct Source {
    scene: Scene,
    speed: Speed,
    simulation: Simulation,
    channels: Vec<Channel>,
    info: StreamInfo,
    /// Samples of the fastest channel so far, and in a block.
    n_samples: u64,
    n_block: u64,
    damage: Damage,
    lag: Lag,
    /// Of the noise.
    seed: u64,
}

/// A channel and its samples of the present block.
#[derive(Debug)]
struct Channel {
    live: LiveChannel,
    rate_hz: f64,
    n_sent: u64,
    raw: RawSamples,
}

/// What is damaged, and what it grows to.
#[derive(Debug, Clone, PartialEq)]
struct Damage {
    from: Faults,
    to: Faults,
    now: Faults,
    /// Simulated time at which it was asked for, s.
    since_s: f64,
    /// Simulated time it takes, s.
    grow_s: f64,
}

/// How far behind the clock the simulation is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lag {
    /// How late the newest block was, s of the clock.
    pub now_s: f64,
    /// Lag given up so far, s of the clock: simulated time is behind by this for good.
    pub given_up_s: f64,
    /// How often lag was given up.
    pub n_given_up: u64,
    /// Simulated time of the last giving up, s.
    last_s: Option<f64>,
}

/// How a simulated source is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// Name of the scene.
    pub scene: String,
    /// Name of the combination asked for, if it is one.
    pub scenario: Option<&'static str>,
    /// Combinations the scene can have.
    pub possible: Vec<&'static str>,
    /// Faults asked for.
    pub wanted: Faults,
    /// Faults at present.
    pub present: Faults,
    /// Simulated time at which they were asked for, s.
    pub since_s: f64,
    /// Simulated time at which they are fully grown, s.
    pub grown_at_s: f64,
    /// Simulated time so far, s.
    pub simulated_s: f64,
    /// Speed of the shaft, Hz; `None`: the scene has a profile of speeds.
    pub shaft_speed_hz: Option<f64>,
    /// Simulated seconds a second; `None`: as fast as it is taken.
    pub speed: Option<f64>,
    /// Lag.
    pub lag: Lag,
    /// Whether it keeps its pace: no lag was given up in the last [`PACE_S`] of simulated time.
    pub keeps_pace: bool,
    /// What the scene's model does not cover, so far.
    pub warnings: Vec<String>,
}

/// Simulated time without a lag given up after which the pace counts as held again, s.
pub const PACE_S: f64 = 10.0;

impl Source {
    /// Builds the scene and brings it to time 0.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn open(settings: &Settings, machine: &Machine) -> Result<Self, OpenError> {
        let scene = &settings.scene;
        let begins = match &settings.scenario {
            Some(wanted) => scenario::faults(scene, wanted)?,
            None => scene.faults(),
        };
        let simulation = Simulation::new(&scenario::with_faults(scene, &begins), settings.seed)?;
        let received: Vec<ReceivedChannel> = simulation.channels().map(received_channel).collect();
        let (mut channels, mut infos) = (Vec::new(), Vec::new());
        for channel in &received {
            let made = LiveChannel::new(channel, machine);
            let (live, info) =
                made.ok_or_else(|| OpenError::Channel { name: channel.name.clone() })?;
            let raw = empty(channel.number_type);
            channels.push(Channel { live, rate_hz: channel.sample_rate.0, n_sent: 0, raw });
            infos.push(info);
        }
        let shaft_speed = match scene.speed {
            SpeedProfile::Constant(speed_hz) => Some(Hz(speed_hz.abs())),
            SpeedProfile::Table(_) => None,
        };
        let info = StreamInfo {
            channels: infos,
            start_time: None,
            shaft_speed: shaft_speed.filter(|speed| speed.0 > 0.0),
            load: None,
            received,
        };
        let n_block = block_len(simulation.rate_hz(), settings.speed);
        let damage = Damage {
            from: begins.clone(),
            to: begins.clone(),
            now: begins,
            since_s: 0.0,
            grow_s: 0.0,
        };
        let (scene, speed, lag) = (scene.clone(), settings.speed, Lag::default());
        Ok(Self {
            scene,
            speed,
            simulation,
            channels,
            info,
            n_samples: 0,
            n_block,
            damage,
            lag,
            seed: settings.seed,
        })
    }

    /// What is known before the first sample.
    #[must_use]
    pub fn info(&self) -> &StreamInfo {
        &self.info
    }

    /// Simulated time so far, s.
    #[must_use]
    pub fn simulated_s(&self) -> f64 {
        self.n_samples as f64 / self.simulation.rate_hz()
    }

    /// How it is doing.
    #[must_use]
    pub fn status(&self) -> Status {
        let (damage, simulated_s) = (&self.damage, self.simulated_s());
        Status {
            scene: self.scene.name.clone(),
            scenario: scenario::name_of(&self.scene, &damage.to),
            possible: scenario::possible(&self.scene).collect(),
            wanted: damage.to.clone(),
            present: damage.now.clone(),
            since_s: damage.since_s,
            grown_at_s: damage.since_s + damage.grow_s,
            simulated_s,
            shaft_speed_hz: match self.scene.speed {
                SpeedProfile::Constant(speed_hz) => Some(speed_hz),
                SpeedProfile::Table(_) => None,
            },
            speed: match self.speed {
                Speed::Max => None,
                Speed::Times(factor) => Some(factor),
            },
            lag: self.lag,
            keeps_pace: self.lag.last_s.is_none_or(|last_s| simulated_s - last_s > PACE_S),
            warnings: self.simulation.warnings(),
        }
    }

    /// Exchanges the faults from the next block on; they grow from their present size over `grow_s`
    /// of simulated time, block by block. The motion goes on.
    ///
    /// # Errors
    /// See [`ScenarioError`]; nothing is changed then.
    pub fn change(&mut self, wanted: &Wanted, grow_s: f64) -> Result<(), ScenarioError> {
        let to = scenario::faults(&self.scene, wanted)?;
        let refused = |error: SceneErrors| ScenarioError::Refused(error.to_string());
        // What is wanted in the end is tried first: growth shall not stop half way.
        self.simulation.set_faults(&to).map_err(refused)?;
        if grow_s > 0.0 {
            self.simulation.set_faults(&self.damage.now).map_err(refused)?;
        }
        let from = self.damage.now.clone();
        let now = if grow_s > 0.0 { from.clone() } else { to.clone() };
        self.damage = Damage { from, to, now, since_s: self.simulated_s(), grow_s };
        Ok(())
    }

    /// Lets the shaft turn at another speed from the next block on. The motion begins anew, as after a start, with the
    /// damage and the noise that there are; samples and their numbers go on.
    ///
    /// # Errors
    /// When the scene has a profile of speeds, or does not take this one; nothing is changed then.
    pub fn turn(&mut self, speed_hz: f64) -> Result<(), ScenarioError> {
        let SpeedProfile::Constant(before) = self.scene.speed else {
            let text = "the scene has a profile of speeds, and no single one to be changed";
            return Err(ScenarioError::Refused(text.to_owned()));
        };
        let speed = SpeedProfile::Constant(speed_hz.copysign(before));
        let mut scene = self.scene.clone();
        scene.speed = speed;
        // Other noise than that of the beginning: it must not come again.
        let seed = self.seed.wrapping_add(1);
        let damaged = scenario::with_faults(&scene, &self.damage.now);
        let made = Simulation::new(&damaged, seed);
        self.simulation = made.map_err(|error| ScenarioError::Refused(error.to_string()))?;
        (self.scene, self.seed) = (scene, seed);
        Ok(())
    }

    /// Lets the damage of a growing scenario take its size at the middle of the next block.
    fn grow(&mut self) {
        let damage = &self.damage;
        if damage.now == damage.to {
            return;
        }
        let middle_s = self.simulated_s() + 0.5 * self.n_block as f64 / self.simulation.rate_hz();
        let part = (middle_s - damage.since_s) / damage.grow_s;
        let next = scenario::between(&damage.from, &damage.to, part);
        // A size between two that were taken; should it be refused all the same, the last one stays.
        if self.simulation.set_faults(&next).is_ok() {
            self.damage.now = next;
        }
    }

    /// Computes the next block; false if `interrupted` before its end.
    fn compute(&mut self, interrupted: &mut dyn FnMut() -> bool) -> Result<bool, RunError> {
        let mut left = self.n_block;
        while left > 0 {
            if interrupted() {
                return Ok(false);
            }
            let n = left.min(PIECE);
            let channels = &mut self.channels;
            self.simulation.advance(n, &mut |i, samples| {
                append(&mut channels[i].raw, samples);
                Ok::<(), Infallible>(())
            })?;
            left -= n;
        }
        self.n_samples += self.n_block;
        Ok(true)
    }

    /// Notes how late a block was and gives up what is too much.
    fn note_lag(&mut self, late_s: f64) {
        self.lag.now_s = late_s.max(0.0);
        if late_s > MAX_LAG_S {
            self.lag = Lag {
                now_s: 0.0,
                given_up_s: self.lag.given_up_s + late_s,
                n_given_up: self.lag.n_given_up + 1,
                last_s: Some(self.simulated_s()),
            };
        }
    }
}

/// What happens between two blocks: questions are answered, the state is shown.
pub type Between<'a> = &'a mut dyn FnMut(&mut Source);

/// Runs until the motion diverges or somebody asks to stop.
///
/// `wait` returns when so many seconds have passed since the run began, with how late it already
/// was; `interrupted` is asked while a block is computed; `sink` takes what was simulated, with the
/// raw samples too if `with_received`. A block is handed on when its last sample is due.
///
/// # Errors
/// When the motion grew without bound.
pub fn run(
    source: &mut Source,
    with_received: bool,
    between: Between<'_>,
    interrupted: &mut dyn FnMut() -> bool,
    wait: &mut dyn FnMut(f64) -> ControlFlow<(), f64>,
    sink: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> Result<(), RunError> {
    loop {
        between(source);
        source.grow();
        if !source.compute(interrupted)? {
            return Ok(());
        }
        if let Speed::Times(factor) = source.speed {
            let due_s = source.simulated_s() / factor + source.lag.given_up_s;
            match wait(due_s) {
                ControlFlow::Continue(late_s) => source.note_lag(late_s),
                ControlFlow::Break(()) => return Ok(()),
            }
        }
        for i in 0..source.channels.len() {
            if hand_on(i, &mut source.channels[i], with_received, sink).is_break() {
                return Ok(());
            }
        }
    }
}

/// Hands a channel's samples on and empties it.
fn hand_on(
    i: usize,
    channel: &mut Channel,
    with_received: bool,
    sink: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let raw = std::mem::replace(&mut channel.raw, RawSamples::I16(Vec::new()));
    channel.raw = empty(raw.number_type());
    if raw.is_empty() {
        return ControlFlow::Continue(());
    }
    let (index, start) = (ChannelIndex(i), SampleIndex(channel.n_sent));
    let time_s = channel.n_sent as f64 / channel.rate_hz;
    channel.n_sent += raw.len() as u64;
    if with_received {
        let raw = raw.clone();
        sink(Step::Received(Received { channel: index, start, segment: 0, time_s, raw }))?;
    }
    let samples = channel.live.samples(raw);
    if samples.iter().all(|sample| sample.is_finite()) {
        return sink(Step::Block(Block { channel: index, start, segment: 0, time_s, samples }));
    }
    let n_samples = samples.len() as u64;
    sink(Step::Rejected { n_samples, reason: "not finite numbers".to_owned() })
}

/// Samples of the fastest channel in a block: [`BLOCK_S`] of simulated and of the clock's time at most.
fn block_len(rate_hz: f64, speed: Speed) -> u64 {
    let factor = match speed {
        Speed::Max => 1.0,
        Speed::Times(factor) => factor.min(1.0),
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "rates are bounded"
    )]
    let n = (rate_hz * BLOCK_S * factor) as u64;
    n.max(1)
}

fn received_channel(channel: &SimulatedChannel) -> ReceivedChannel {
    ReceivedChannel {
        name: channel.name.clone(),
        sample_rate: Hz(channel.rate_hz),
        number_type: match channel.number {
            NumberKind::Int16 => NumberType::I16,
            NumberKind::Float32 => NumberType::F32,
            NumberKind::Float64 => NumberType::F64,
        },
        scale: channel.scale,
        offset: channel.offset,
        raw_zero: 0.0,
        unit: Some(channel.unit.to_owned()),
        sensor: Some(channel.sensor.clone()),
    }
}

fn empty(kind: NumberType) -> RawSamples {
    match kind {
        NumberType::F32 => RawSamples::F32(Vec::new()),
        NumberType::F64 => RawSamples::F64(Vec::new()),
        NumberType::I16 => RawSamples::I16(Vec::new()),
        NumberType::I32 => RawSamples::I32(Vec::new()),
    }
}

/// Adds samples; a channel has one number type for good.
fn append(raw: &mut RawSamples, samples: Samples<'_>) {
    match (raw, samples) {
        (RawSamples::I16(raw), Samples::Int16(new)) => raw.extend_from_slice(new),
        (RawSamples::F32(raw), Samples::Float32(new)) => raw.extend_from_slice(new),
        (RawSamples::F64(raw), Samples::Float64(new)) => raw.extend_from_slice(new),
        (raw, new) => {
            debug_assert!(false, "{:?} given {new:?}", raw.number_type());
        }
    }
}

#[cfg(test)]
mod tests;
