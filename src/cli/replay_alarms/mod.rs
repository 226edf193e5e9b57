//! `rotorwatch replay-alarms`: what other limits or delays would have raised.
//!
//! Stored verdicts and features go through the engine of the daemon; nothing is measured or judged anew,
//! and nothing is written.

mod history;
mod text;
#[cfg(test)]
mod tests;

use super::EXIT_ERROR;
use super::output::Output;
use super::output::OutputError;
use super::output::Spared;
use crate::alarms::Settings;
use crate::api::wire::rerun::RerunDocument;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::config::MachineConfig;
use crate::diagnosis::baseline::Record;
use crate::machine::Machine;
use crate::machine::file;
use crate::offline;
use crate::offline::OfflineError;
use crate::offline::Reference;
use crate::pipeline::SpeedHints;
use crate::signal::Timestamp;
use crate::store::BaselineStore;
use crate::store::SqliteBaselines;
use crate::store::StoreError;
use crate::store::sqlite;
use crate::store::trends::SqliteTrendArchive;
use crate::store::trends::Tier;
use crate::store::trends::TrendArchive;
use clap::Args;
use clap::ValueEnum;
use history::Question;
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch replay-alarms --config rotorwatch.toml --with machines/rig-strict.toml
  rotorwatch replay-alarms --config rotorwatch.toml --machine rig-1 --from 2026-11-01T00:00:00Z
  rotorwatch replay-alarms --config new.toml --from 2026-11-01T00:00:00Z --to 2026-11-08T00:00:00Z --format json

The configuration says where the store is, and which limits and delays hold unless --with names others: a machine
file (its limits, the configuration's delays) or another configuration. The daemon may run meanwhile. What is printed
first is what would have been raised, then how that differs from what was raised, then what the history cannot tell.

Exit codes: 0 done; 2 an error.";

/// Arguments of `replay-alarms`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Configuration of the daemon whose store is read.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Machine id; may be left out where there is one machine.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
    /// Limits and delays to try: a machine file, or a configuration.
    #[arg(long, value_name = "FILE")]
    pub with: Option<PathBuf>,
    /// From this time on (RFC 3339); from the beginning by default.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub from: Option<Timestamp>,
    /// Before this time (RFC 3339); to the end by default.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub to: Option<Timestamp>,
    /// How to print.
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
    /// Where to print; stdout by default.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// How to print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON document, `rotorwatch.replay-alarms/1`.
    Json,
}

/// Reads a time of the command line.
pub(super) fn time(text: &str) -> Result<Timestamp, String> {
    let read = text.parse::<jiff::Timestamp>().ok();
    let time = read.and_then(|time| i64::try_from(time.as_nanosecond()).ok());
    time.map(Timestamp).ok_or_else(|| "not a time such as 2026-05-04T12:00:00Z".to_owned())
}

/// Why it was not done.
#[derive(Debug, thiserror::Error)]
enum RerunError {
    #[error(transparent)]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Machine(#[from] super::baseline::NoSuchMachine),
    #[error("{} cannot be read", file.display())]
    Read { file: PathBuf, source: io::Error },
    #[error("{mistakes}")]
    MachineFile { mistakes: String },
    #[error("{} is of machine {found:?}, asked for is {wanted:?}", file.display())]
    OtherMachine { file: PathBuf, found: String, wanted: String },
    #[error(
        "nothing is stored of machine {machine:?} in {}: a daemon with this configuration stores verdicts and \
         features as it runs",
        directory.display()
    )]
    Nothing { machine: String, directory: PathBuf },
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{} cannot be measured", file.display())]
    Measure { file: PathBuf, source: Box<OfflineError> },
    #[error("the document cannot be written")]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Runs the history through the engine; exit code 0, or 2 on an error.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match answer(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(RerunError::Configuration(mistakes)) => {
            super::tell_lines(&mistakes);
            ExitCode::from(EXIT_ERROR)
        }
        Err(error) => super::fail(&error),
    }
}

fn answer(arguments: &Arguments) -> Result<(), RerunError> {
    let config = config::load(&arguments.config)?;
    let mut spared = Spared::of(&config).and(&arguments.with);
    if let Some(Ok(other)) = arguments.with.as_deref().map(config::load) {
        spared = spared.and(other.inputs());
    }
    arguments.out.as_deref().map_or(Ok(()), |out| spared.refuse(out))?;
    let entry = super::baseline::machine(&config, arguments.machine.as_deref())?;
    let id = &entry.machine.id;
    let (machine, settings) = match &arguments.with {
        Some(file) => tried(file, &config, id)?,
        None => (Arc::clone(&entry.machine), delays(&config, &entry.machine)),
    };
    let directory = &config.store.directory;
    let trends = SqliteTrendArchive::new(directory);
    let nothing = || RerunError::Nothing { machine: id.clone(), directory: directory.clone() };
    let held = trends.span(id, Tier::Windows)?.ok_or_else(nothing)?;
    let archive = sqlite::read_only(directory)?.ok_or_else(nothing)?;
    let span = (arguments.from.unwrap_or(held.0), arguments.to.unwrap_or(held.1));
    let records = records(&machine, entry, directory)?;
    let question = Question { machine, settings, span, records };
    let answer = history::ask(&question, &archive, &trends)?;
    let printed = match arguments.format {
        Format::Text => text::of(&question, &answer),
        Format::Json => {
            let document: RerunDocument = text::document(&question, &answer);
            serde_json::to_string_pretty(&document)? + "\n"
        }
    };
    let mut output = Output::open(arguments.out.as_deref(), &spared)?;
    output.write(&printed)?;
    output.finish()?;
    Ok(())
}

/// Limits and delays of a machine file, or of another configuration.
fn tried(file: &Path, config: &Config, id: &str) -> Result<(Arc<Machine>, Settings), RerunError> {
    let read = |source| RerunError::Read { file: file.to_owned(), source };
    let text = fs::read_to_string(file).map_err(read)?;
    let is_machine =
        text.parse::<toml::Table>().is_ok_and(|t| t.get("machine").is_some_and(|m| m.is_table()));
    if !is_machine {
        let config = config::load(file)?;
        let entry = super::baseline::machine(&config, Some(id))?;
        return Ok((Arc::clone(&entry.machine), delays(&config, &entry.machine)));
    }
    let machine = file::parse(&text, &file.display().to_string())
        .map_err(|mistakes| RerunError::MachineFile { mistakes: mistakes.to_string() })?;
    if machine.id != id {
        let (found, wanted) = (machine.id, id.to_owned());
        return Err(RerunError::OtherMachine { file: file.to_owned(), found, wanted });
    }
    let delays = delays(config, &machine);
    Ok((Arc::new(machine), delays))
}

/// Delays of a machine's alarms: longer where it turns slowly, as far as the machine file states its speed.
fn delays(config: &Config, machine: &Machine) -> Settings {
    config.monitor_of((machine, SpeedHints::default()), &[]).alarms
}

/// The records that windows may have been held against, if any limit asks for them.
fn records(
    machine: &Arc<Machine>,
    entry: &MachineConfig,
    directory: &Path,
) -> Result<BTreeMap<(Option<String>, String), Record>, RerunError> {
    let mut found = BTreeMap::new();
    if !machine.alarm_limits.limits.iter().any(|limit| limit.relative_to_baseline) {
        return Ok(found);
    }
    let store = SqliteBaselines::open(directory)?;
    for held in store.baselines(&machine.id)?.into_iter().filter(|held| held.is_intact) {
        for record in held.signed.records {
            found.insert((Some(held.signed.id.to_string()), record.name.clone()), record);
        }
    }
    for file in &entry.baseline {
        let of = Some(Arc::clone(&entry.machine));
        let reference = Reference { machine: of, ..Reference::default() };
        let learned = offline::learn(file, &reference, &mut |_| ());
        let record = learned.map_err(|source| RerunError::Measure {
            file: file.clone(),
            source: Box::new(source),
        })?;
        found.insert((None, record.name.clone()), record);
    }
    Ok(found)
}
