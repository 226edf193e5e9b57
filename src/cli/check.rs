//! `rotorwatch check`: is a file right, and what does it say?

use super::EXIT_ERROR;
use super::hints::HintArguments;
use super::input;
use super::input::FileKind;
use super::input::InputError;
use super::output::Output;
use super::output::OutputError;
use crate::capture::error::CaptureError;
use crate::capture::map::MapError;
use crate::capture::reader::CaptureReader;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::config::SourceConfig;
use crate::ingest::replay::Speed;
use crate::machine::Machine;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use crate::machine::kinematics;
use crate::machine::report;
use crate::simulator::explain;
use crate::simulator::scene::Scene;
use crate::simulator::scene::SceneErrors;
use crate::simulator::simulation::Simulation;
use crate::units::Hz;
use clap::Args;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch check rig.toml run-7.h5 rotorwatch.toml
  rotorwatch check --frequencies rig.toml
  rotorwatch check --frequencies --speed 29.5 --resolution 0.5 rig.toml

What a file is, its content decides: a capture is HDF5, a machine file has a table [machine], a
scene [scene], a configuration of the daemon [server], [pipeline], [[machine]] or [[source]]. Captures are read to
their last sample.

Exit codes: 0 every file is right; 2 one is not. Every mistake is told with file, line, key and
what is allowed.";

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Machine files, scenes, configurations, captures.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// List the lines of each machine: shafts, bearings, gears, supply.
    #[arg(long)]
    pub frequencies: bool,
    /// What the captures do not say.
    #[command(flatten)]
    pub hints: HintArguments,
    /// Speed of the first shaft, Hz, for --frequencies; else the capture's or the machine file's.
    #[arg(long, value_name = "HZ", value_parser = super::positive, requires = "frequencies")]
    pub speed: Option<f64>,
    /// Lines closer than this are named as not told apart, Hz; 0.1 is the bin width of a record of
    /// 10 s.
    #[arg(
        long,
        value_name = "HZ",
        value_parser = super::positive,
        default_value = "0.1",
        requires = "frequencies"
    )]
    pub resolution: f64,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
enum CheckError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Machine(#[from] MachineFileErrors),
    #[error(transparent)]
    Scene(#[from] SceneErrors),
    #[error(transparent)]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error("{}: no speed is known to list lines at: give --speed HZ, or speed_hz of the first [[shaft]]", file.display())]
    NoSpeed { file: PathBuf },
}

/// Checks every file; exit code 0 if all are right, else 2.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match check_all(arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_ERROR),
        Err(error) => super::fail(&error),
    }
}

fn check_all(arguments: &Arguments) -> Result<bool, OutputError> {
    let mut output = Output::open(None)?;
    let mut all_right = true;
    for file in &arguments.files {
        let mut text = String::new();
        let checked = check(file, arguments, &mut text);
        output.write(&text)?;
        if let Err(error) = checked {
            all_right = false;
            tell(&error);
        }
    }
    Ok(all_right)
}

/// Tells what is wrong; lists of mistakes name their file in every line.
fn tell(error: &CheckError) {
    match error {
        CheckError::Machine(mistakes) => super::tell_lines(mistakes),
        CheckError::Scene(mistakes) => super::tell_lines(mistakes),
        CheckError::Configuration(mistakes) => super::tell_lines(mistakes),
        CheckError::Input(InputError::Mistakes(mistakes)) => super::tell_lines(mistakes),
        CheckError::Input(_)
        | CheckError::Map(_)
        | CheckError::Capture(_)
        | CheckError::NoSpeed { .. } => {
            super::tell(error);
        }
    }
}

/// Checks one file and writes what it says, as far as it is right.
fn check(path: &Path, arguments: &Arguments, out: &mut String) -> Result<(), CheckError> {
    let name = path.display().to_string();
    match input::kind(path)? {
        FileKind::Machine(text) => {
            let machine = file::parse(&text, &name)?;
            out.push_str(&format!(
                "{name}: machine file\n{}",
                indented(&report::summary(&machine))
            ));
            lines(path, &machine, None, arguments, out)
        }
        FileKind::Scene(text) => {
            let scene = Scene::parse(&text, &name)?;
            let simulation = Simulation::new(&scene, scene.seed)?;
            out.push_str(&format!(
                "{name}: scene file\n{}",
                indented(&explain::explain(&simulation))
            ));
            Ok(())
        }
        FileKind::Configuration => {
            let config = config::load(path)?;
            out.push_str(&configuration(&name, &config));
            for entry in &config.machines {
                lines(&entry.file, &entry.machine, None, arguments, out)?;
            }
            Ok(())
        }
        FileKind::Capture => check_capture(path, arguments, out),
        FileKind::Unknown(found) => Err(CheckError::Input(InputError::Kind {
            file: path.to_owned(),
            found,
            wanted: "a machine file, a scene, a configuration or a capture",
            hint: "",
        })),
    }
}

/// Reads a capture to its end, and the machine description inside it.
fn check_capture(path: &Path, arguments: &Arguments, out: &mut String) -> Result<(), CheckError> {
    let mut reader = CaptureReader::open(path, None, &arguments.hints.hints()?)?;
    out.push_str(&reader.info().to_string());
    while reader.next_block()?.is_some() {}
    let told = reader.report();
    out.push_str(&format!(
        "  all {} samples can be read\n",
        told.samples_read + told.samples_rejected()
    ));
    if told.samples_rejected() > 0 {
        out.push_str(&format!("  not used: {}\n", told.reasons().join("; ")));
    }
    let info = reader.info();
    let Some(text) = &info.machine else { return Ok(()) };
    let name = format!("{} (attribute `machine`)", path.display());
    let machine = file::parse(text, &name)?;
    out.push_str(&indented(&report::summary(&machine)));
    lines(path, &machine, info.shaft_speed, arguments, out)
}

/// Lists the machine's lines, if asked for.
fn lines(
    path: &Path,
    machine: &Machine,
    of_capture: Option<Hz>,
    arguments: &Arguments,
    out: &mut String,
) -> Result<(), CheckError> {
    if !arguments.frequencies {
        return Ok(());
    }
    let speed = arguments.speed.map(Hz).or(of_capture).or(machine.nominal_speed());
    let speed = speed.ok_or_else(|| CheckError::NoSpeed { file: path.to_owned() })?;
    let table = kinematics::frequency_table(machine, speed);
    let resolution = Hz(arguments.resolution);
    out.push_str(&format!("\n{}", report::frequencies(machine, &table, resolution)));
    out.push_str(&format!(
        "({} Hz is the bin width of a record of {:.3} s; --resolution sets another)\n",
        resolution.0,
        1.0 / resolution.0
    ));
    Ok(())
}

fn configuration(name: &str, config: &Config) -> String {
    let n = config.machines.len();
    let machines = if n == 1 { "machine" } else { "machines" };
    let mut text = format!("{name}: configuration, http on {}, {n} {machines}\n", config.bind);
    for entry in &config.machines {
        let SourceConfig::Replay(replay) = &entry.source;
        let speed = match replay.speed {
            Speed::Max => "as fast as possible".to_owned(),
            Speed::Times(factor) => format!("at {factor} times real time"),
        };
        let repeat = if replay.repeat { ", again and again" } else { "" };
        let source = format!("replay of {} {speed}{repeat}\n", replay.file.display());
        text.push_str(&indented(&(report::summary(&entry.machine) + &source)));
    }
    text
}

fn indented(text: &str) -> String {
    text.lines().map(|line| format!("  {line}\n")).collect()
}
