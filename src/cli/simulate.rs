//! `rotorwatch simulate`: a scene → a capture with its truth.

use super::output::Output;
use super::output::Spared;
use super::progress::Progress;
use crate::capture::error::CaptureError;
use crate::capture::streaming::GrowingChannel;
use crate::capture::streaming::GrowingSamples;
use crate::capture::streaming::GrowingType;
use crate::capture::streaming::StreamingWriter;
use crate::capture::streaming::Truth;
use crate::capture::writer::CaptureHeader;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use crate::simulator::explain;
use crate::simulator::scene::MachineText;
use crate::simulator::scene::NumberKind;
use crate::simulator::scene::Scene;
use crate::simulator::scene::SceneErrors;
use crate::simulator::scene::builtin;
use crate::simulator::simulation::AdvanceError;
use crate::simulator::simulation::Samples;
use crate::simulator::simulation::SimulatedChannel;
use crate::simulator::simulation::Simulation;
use crate::simulator::speed::SpeedProfile;
use crate::units::Hz;
use clap::Args;
use cpu_time::ProcessTime;
use std::convert::Infallible;
use std::fs::File;
use std::io;
use std::io::Read;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch simulate seed-bearing-40hz --out bad.h5
  rotorwatch simulate BG_BS_BB --seed 2 --out all.h5
  rotorwatch simulate seed-bearing-40hz-0 --out healthy.h5 --seed 7
  rotorwatch simulate --explain my-rig.toml
  rotorwatch diagnose bad.h5

SCENE is a scene file (docs/simulator.md) or a built-in scene: GG_GS_GB to BG_BS_BB (gear, shaft, bearing
good or bad, 10 Hz), seed-bearing-40hz (which is -3), seed-bearing-40hz-0 to -3 (the damaged bearings of
the source, 0 is healthy), seed-bow-2hz, seed-gear-10hz, run-up. `rotorwatch demo` runs
GG_GS_GB. Same scene and same seed give the same capture, bit by bit.

Exit codes: 0 done; 2 the scene has mistakes or the capture could not be written.";

/// Arguments of `simulate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Scene file, or name of a built-in scene.
    #[arg(value_name = "SCENE")]
    pub scene: String,
    /// Capture to be written; it appears when it is complete.
    #[arg(long, value_name = "CAPTURE", required_unless_present = "explain")]
    pub out: Option<PathBuf>,
    /// Seed of the noise, instead of the scene's.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Say what is modelled, what is left out and why, the expected error and the cost.
    #[arg(long)]
    pub explain: bool,
}

/// Why there is no capture.
#[derive(Debug, thiserror::Error)]
pub(super) enum SimulateError {
    /// The scene is neither a file nor built in.
    #[error("{name}: there is no such file and no such built-in scene; built in are {known}")]
    Unknown {
        /// As given.
        name: String,
        /// What there is.
        known: String,
    },
    /// A file cannot be read.
    #[error("{}: cannot be read", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The scene has mistakes.
    #[error(transparent)]
    Scene(#[from] SceneErrors),
    /// The machine file the scene names has mistakes.
    #[error(transparent)]
    Machine(#[from] MachineFileErrors),
    /// The motion diverged, or the capture could not be written.
    #[error(transparent)]
    Advance(#[from] AdvanceError<CaptureError>),
    /// The capture could not be written.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The explanation could not be written.
    #[error(transparent)]
    Output(#[from] super::output::OutputError),
}

/// Simulates; exit code 0, or 2 on any mistake.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match simulate(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(SimulateError::Scene(mistakes)) => super::fail_lines(&mistakes),
        Err(SimulateError::Machine(mistakes)) => super::fail_lines(&mistakes),
        Err(error) => super::fail(&error),
    }
}

fn simulate(arguments: &Arguments) -> Result<(), SimulateError> {
    let scene = load(&arguments.scene)?;
    let machine = machine(&scene, &arguments.scene)?;
    let seed = arguments.seed.unwrap_or(scene.seed);
    let mut simulation = Simulation::new(&scene, seed)?;
    if arguments.explain {
        let cost = cost(&scene, seed)?;
        Output::stdout().write(&(explain::explain(&simulation) + &cost))?;
    }
    let Some(out) = &arguments.out else { return Ok(()) };
    Spared::nothing().and(inputs(&scene, &arguments.scene)).refuse(out)?;
    let progress = Progress::new(true);
    progress.of(out, |tell| write(&mut simulation, (machine, seed), out, tell))?;
    for warning in simulation.warnings() {
        tracing::warn!("{}: {warning}", scene.name);
    }
    Ok(())
}

/// The files a scene is read from.
fn inputs(scene: &Scene, name: &str) -> Vec<PathBuf> {
    let path = Path::new(name);
    let beside = path.parent().unwrap_or(Path::new(""));
    let machine = match &scene.machine {
        Some(MachineText::File(file)) => Some(beside.join(file)),
        Some(MachineText::Inline(_)) | None => None,
    };
    let files = std::iter::once(path.to_owned()).chain(machine);
    if path.exists() { files.collect() } else { Vec::new() }
}

/// Reads a scene by file or by name; files come first.
pub(super) fn load(name: &str) -> Result<Scene, SimulateError> {
    let path = Path::new(name);
    if path.exists() {
        return Ok(Scene::parse(&read(path)?, name)?);
    }
    let text = builtin::text(name).ok_or_else(|| SimulateError::Unknown {
        name: name.to_owned(),
        known: builtin::names().collect::<Vec<_>>().join(", "),
    })?;
    Ok(Scene::parse(text, name)?)
}

/// Reads a text file, not much more of it than is allowed.
fn read(path: &Path) -> Result<String, SimulateError> {
    let mut text = String::new();
    let limit = file::MAX_TEXT_BYTES as u64 + 1;
    let opened = File::open(path).and_then(|file| file.take(limit).read_to_string(&mut text));
    opened.map_err(|source| SimulateError::Read { file: path.to_owned(), source })?;
    Ok(text)
}

/// The text of the scene's machine file; a path counts from the scene's folder.
fn machine(scene: &Scene, name: &str) -> Result<Option<String>, SimulateError> {
    match &scene.machine {
        None => Ok(None),
        Some(MachineText::Inline(text)) => Ok(Some(text.clone())),
        // A built-in scene names one of the machine files beside it.
        Some(MachineText::File(file)) if !Path::new(name).exists() => {
            Ok(builtin::machine(file).map(str::to_owned))
        }
        Some(MachineText::File(file)) => {
            let path = Path::new(name).parent().unwrap_or(Path::new("")).join(file);
            let text = read(&path)?;
            file::parse(&text, &path.display().to_string())?;
            Ok(Some(text))
        }
    }
}

/// Runs a short trial and tells the processor time a simulated second takes.
fn cost(scene: &Scene, seed: u64) -> Result<String, SimulateError> {
    let mut trial = Simulation::new(scene, seed)?;
    let rate_hz = trial.rate_hz();
    let mut nowhere = |_: usize, _: Samples<'_>| Ok::<(), Infallible>(());
    // The first part pays for tables.
    let mut advance = |n| trial.advance(n, &mut nowhere);
    let seconds = if trial_is_cheap(scene) { 2.0 } else { 0.05 };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "rates are bounded"
    )]
    let n = (rate_hz * seconds).ceil().max(1.0) as u64;
    let warm = advance(n.div_ceil(10));
    let begun = ProcessTime::now();
    let done = advance(n);
    let taken = begun.elapsed().as_secs_f64() * rate_hz / n as f64;
    Ok(match warm.and(done) {
        Ok(()) => format!(
            "cost:\n  {taken:.3e} s of processor time a simulated second, measured over {:.3} s of it\n",
            n as f64 / rate_hz
        ),
        Err(error) => format!("cost:\n  not measured: {error}\n"),
    })
}

fn trial_is_cheap(scene: &Scene) -> bool {
    !scene.has_contacts() && matches!(scene.speed, SpeedProfile::Constant(_))
}

/// Runs the whole scene into a capture, without showing how far it is.
pub(super) fn record(
    scene: &Scene,
    machine: Option<String>,
    seed: u64,
    out: &Path,
) -> Result<(), SimulateError> {
    write(&mut Simulation::new(scene, seed)?, (machine, seed), out, &mut |_| ())
}

/// Runs the whole scene into a capture.
pub(super) fn write(
    simulation: &mut Simulation,
    (machine, seed): (Option<String>, u64),
    out: &Path,
    tell: &mut dyn FnMut(f64),
) -> Result<(), SimulateError> {
    let scene = simulation.scene().clone();
    let shaft_speed = match scene.speed {
        SpeedProfile::Constant(speed_hz) => Some(Hz(speed_hz.abs())),
        SpeedProfile::Table(_) => None,
    };
    let header = CaptureHeader {
        start_time: None,
        machine,
        shaft_speed: shaft_speed.filter(|speed| speed.0 > 0.0),
    };
    let texts =
        [("scene", scene.text.clone()), ("name", scene.name.clone()), ("faults", scene.truth())];
    let texts = texts.map(|(name, text)| (name.to_owned(), text)).to_vec();
    let mut writer = StreamingWriter::create(out, &header, &Truth { texts, seed })?;
    for channel in simulation.channels() {
        writer.channel(&growing(channel))?;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "both are bounded")]
    let n_samples = (scene.duration_s * simulation.rate_hz()).round().max(1.0) as u64;
    let piece = n_samples.div_ceil(200).clamp(1000, 100_000);
    let mut done = 0;
    while done < n_samples {
        let n = piece.min(n_samples - done);
        simulation.advance(n, &mut |channel, samples| writer.append(channel, appended(samples)))?;
        done += n;
        tell(done as f64 / n_samples as f64);
    }
    let warnings = simulation.warnings();
    if !warnings.is_empty() {
        writer.add_truth("warnings", &warnings.join("\n"))?;
    }
    Ok(writer.finish()?)
}

fn growing(channel: &SimulatedChannel) -> GrowingChannel {
    GrowingChannel {
        name: channel.name.clone(),
        sample_rate: Hz(channel.rate_hz),
        unit: Some(channel.unit.to_owned()),
        sensor: Some(channel.sensor.clone()),
        number: match channel.number {
            NumberKind::Int16 => GrowingType::I16 { scale: channel.scale, offset: channel.offset },
            NumberKind::Float32 => GrowingType::F32,
            NumberKind::Float64 => GrowingType::F64,
        },
    }
}

fn appended(samples: Samples<'_>) -> GrowingSamples<'_> {
    match samples {
        Samples::Int16(samples) => GrowingSamples::I16(samples),
        Samples::Float32(samples) => GrowingSamples::F32(samples),
        Samples::Float64(samples) => GrowingSamples::F64(samples),
    }
}
