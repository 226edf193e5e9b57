//! `rotorwatch check`: is a file right, and what does it say?

use super::EXIT_ERROR;
use super::hints::HintArguments;
use super::input;
use super::input::FileKind;
use super::input::InputError;
use super::output::Output;
use super::output::OutputError;
use crate::app::build;
use crate::app::start_error::StartError;
use crate::capture::error::CaptureError;
use crate::capture::foreign::inventory::Inventory;
use crate::capture::map::ChannelMap;
use crate::capture::map::MapError;
use crate::capture::reader::CaptureReader;
use crate::capture::recording::repair;
use crate::capture::recording::repair::Repair;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::config::Live;
use crate::config::SourceConfig;
use crate::config::Subscription;
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
  rotorwatch check --repair data/recordings/rig-1/rig-1-00000007.h5
  rotorwatch check --frequencies --speed 29.5 --resolution 0.5 rig.toml
  rotorwatch check --rate 12000 logger.csv
  rotorwatch check export.mat                        # what is inside, and the --map that reads it
  rotorwatch check --map drive_x=/data,column=0,rate=@fs export.mat

What a file is, its content decides: a capture is HDF5, WAV or a table of numbers (CSV), a machine
file has a table [machine], a scene [scene], a configuration of the daemon [server], [pipeline],
[[machine]] or [[source]]. A configuration is also held against its memory_limit_bytes
and, for trends, its store.max_bytes, as `serve` does. Captures are read to their last sample; of CSV and WAV is shown what was guessed, and
options that name it otherwise.

--repair closes recordings that their recorder left open because it was killed: one write of the
superblock, in place; no sample is touched. What then cannot be read to its last sample is put back
as it was. A file that a recorder is writing is refused.

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
    /// Close recordings that were left open, and read them to their last sample.
    #[arg(long, conflicts_with = "frequencies")]
    pub repair: bool,
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
    Start(#[from] StartError),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(
        "{}: this is {found}, not a machine file, a scene, a configuration or a capture{remedy}",
        file.display()
    )]
    Unknown { file: PathBuf, found: &'static str, remedy: String },
    #[error("{}: not of rotorwatch's own layout: {why}; the --map options printed above read it", file.display())]
    Foreign { file: PathBuf, why: String },
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
    let mut output = Output::stdout();
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
        | CheckError::Start(_)
        | CheckError::Map(_)
        | CheckError::Capture(_)
        | CheckError::Unknown { .. }
        | CheckError::Foreign { .. }
        | CheckError::NoSpeed { .. } => {
            super::tell(error);
        }
    }
}

/// Checks one file and writes what it says, as far as it is right.
fn check(path: &Path, arguments: &Arguments, out: &mut String) -> Result<(), CheckError> {
    if arguments.repair {
        return repair_recording(path, out);
    }
    let name = path.display().to_string();
    match input::kind(path)? {
        FileKind::Machine(text) => {
            let machine = file::parse(&text, &name)?;
            out.push_str(&format!(
                "{name}: machine file\n{}",
                indented(&report::summary(&machine))
            ));
            ChannelMap::of_table(&machine.capture_map, &name)?;
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
                let name = entry.file.display().to_string();
                ChannelMap::of_table(&entry.machine.capture_map, &name)?;
                lines(&entry.file, &entry.machine, None, arguments, out)?;
            }
            Ok(build::check_fits(&config)?)
        }
        FileKind::Capture => check_capture(path, arguments, out),
        FileKind::Unknown(found, remedy) => Err(CheckError::Unknown {
            file: path.to_owned(),
            found,
            remedy: if remedy.is_empty() { String::new() } else { format!(": {remedy}") },
        }),
    }
}

/// Closes a recording that was left open.
fn repair_recording(path: &Path, out: &mut String) -> Result<(), CheckError> {
    let name = path.display();
    match repair::repair(path)? {
        Repair::NothingToDo => {
            out.push_str(&format!("{name}: was closed properly, nothing to do\n"))
        }
        Repair::Repaired { samples } => {
            out.push_str(&format!("{name}: was left open by its recorder; closed\n"));
            for (channel, n_samples) in samples {
                out.push_str(&format!(
                    "  channel {channel}: {n_samples} samples, all can be read\n"
                ));
            }
        }
    }
    Ok(())
}

/// Reads a capture to its end, and the machine description inside it.
fn check_capture(path: &Path, arguments: &Arguments, out: &mut String) -> Result<(), CheckError> {
    let mut reader = match CaptureReader::open(path, None, &arguments.hints.hints()?) {
        Ok(reader) => reader,
        Err(error) if arguments.hints.map.is_empty() && error.is_of_layout() => {
            let inventory = Inventory::examine(path)?;
            out.push_str(&inventory.to_string());
            return Err(foreign(path, &inventory, error));
        }
        Err(error) => {
            if let CaptureError::NoRate { guessed, channels, options, .. } = &error {
                let name = path.display().to_string();
                out.push_str(&format!("{name}: CSV\n  {guessed}\n  {channels}\n  missing rate\n"));
                out.push_str(&advice("what would read it", &format!("--rate HZ {options}"), &name));
            }
            return Err(CheckError::Capture(error));
        }
    };
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
    if let Some(options) = &info.options {
        let why = "to name channels or units otherwise, change this";
        out.push_str(&advice(why, options, &path.display().to_string()));
    }
    let Some(text) = &info.machine else { return Ok(()) };
    let name = format!("{} (attribute `machine`)", path.display());
    let machine = file::parse(text, &name)?;
    out.push_str(&indented(&report::summary(&machine)));
    lines(path, &machine, info.shaft_speed, arguments, out)
}

/// What to tell of a file of another layout, once its content is listed.
fn foreign(path: &Path, inventory: &Inventory, error: CaptureError) -> CheckError {
    if inventory.command().is_none() {
        return CheckError::Capture(error);
    }
    let why = if matches!(error, CaptureError::ForeignLayout { .. }) {
        "no group /channels".to_owned()
    } else {
        error.to_string()
    };
    CheckError::Foreign { file: path.to_owned(), why }
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
    let scheme = if config.access.tls.is_some() { "https" } else { "http" };
    let mut text = format!("{name}: configuration, {scheme} on {}, {n} {machines}\n", config.bind);
    if let Some(tokens) = &config.access.tokens {
        text.push_str(&format!("  {} tokens\n", tokens.0.iter().count()));
    }
    if config.recording.is_some() {
        let folder = config.store.directory.join("recordings");
        text.push_str(&format!("  recording to {}\n", folder.display()));
    }
    for entry in &config.machines {
        let pace = |speed: Speed| match speed {
            Speed::Max => "as fast as possible".to_owned(),
            Speed::Times(factor) => format!("at {factor} times real time"),
        };
        let source = match &entry.source {
            SourceConfig::Replay(replay) => {
                let repeat = if replay.repeat { ", again and again" } else { "" };
                format!("replay of {} {}{repeat}\n", replay.file.display(), pace(replay.speed))
            }
            SourceConfig::Simulated(simulated) => {
                format!("simulated scene {} {}\n", simulated.scene.name, pace(simulated.speed))
            }
            SourceConfig::Live(live) => network(config, live),
        };
        text.push_str(&indented(&(report::summary(&entry.machine) + &source)));
    }
    text
}

/// A line for what comes over a network.
fn network(config: &Config, live: &Live) -> String {
    let tokens = if config.access.tokens.is_some() { "with tokens" } else { "without tokens" };
    let is_encrypted = config.access.tls.as_ref().is_some_and(|tls| tls.of_ingest);
    let over = if is_encrypted { "tls" } else { "tcp" };
    let senders =
        live.listens.then(|| format!("senders over {over} on {}, {tokens}\n", config.ingest.bind));
    let broker = |broker: &Subscription| {
        let (n, at) = (broker.topics.len(), &broker.connection);
        format!("{n} topics of the broker at {}:{}\n", at.host, at.port)
    };
    senders.into_iter().chain(live.brokers.iter().map(broker)).collect()
}

/// A command that reads a capture with these options.
fn advice(why: &str, options: &str, file: &str) -> String {
    format!("  {why}:\n    rotorwatch diagnose --machine rig.toml {options} {}\n", quoted(file))
}

/// A name as a shell takes it.
fn quoted(name: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "._-/+:@%".contains(c);
    if name.chars().all(is_plain) {
        name.to_owned()
    } else {
        format!("'{}'", name.replace('\'', r"'\''"))
    }
}

fn indented(text: &str) -> String {
    text.lines().map(|line| format!("  {line}\n")).collect()
}
