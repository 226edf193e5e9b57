//! `rotorwatch baseline`: what is normal of a daemon's machines, learned from captures.
//!
//! Writes into the store of the configuration. A daemon that runs takes it up within a second or two.

use super::input;
use super::input::InputError;
use super::progress::Progress;
use crate::api::wire::baselines::BaselineDetailWire;
use crate::api::wire::baselines::BaselineItemWire;
use crate::api::wire::baselines::BaselineListWire;
use crate::app;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::config::MachineConfig;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::signed;
use crate::diagnosis::baseline::signed::SignError;
use crate::diagnosis::baseline::signed::Signed;
use crate::features::vector;
use crate::offline;
use crate::offline::OfflineError;
use crate::offline::Reference;
use crate::offline::names;
use crate::store;
use crate::store::Act;
use crate::store::BaselineStore;
use crate::store::Held;
use crate::store::KeepError;
use crate::store::SqliteBaselines;
use crate::store::StoreError;
use clap::Args;
use clap::Subcommand;
use clap::ValueEnum;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch baseline learn --config rotorwatch.toml --author 'M. Ito' --comment 'new bearing' healthy.h5
  rotorwatch baseline list --config rotorwatch.toml
  rotorwatch baseline show --config rotorwatch.toml 4b1c
  rotorwatch baseline activate --config rotorwatch.toml --author 'M. Ito' 4b1c
  rotorwatch baseline remove --config rotorwatch.toml --author 'M. Ito' 4b1c

A baseline belongs to a machine at one speed (± 5 %) and load, is signed and never changes; a new one takes the
place of the one in use at its operating state. An id may be cut short as long as it names one baseline. A running
daemon takes up a change within two seconds; to learn from what it has just seen, POST to
/api/v1/machines/ID/baselines (docs/api.md).

Exit codes: 0 done; 2 an error, nothing has changed.";

/// Arguments of `baseline`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub act: ActArguments,
}

/// What to do with baselines.
#[derive(Debug, Subcommand)]
pub enum ActArguments {
    /// Learn a baseline from healthy captures and use it
    Learn(LearnArguments),
    /// List the baselines
    List(ListArguments),
    /// Show a baseline with its numbers
    Show(ShowArguments),
    /// Use a baseline again, instead of the one of its operating state
    Activate(OneArguments),
    /// Remove a baseline
    Remove(OneArguments),
}

/// Arguments of `baseline learn`.
#[derive(Debug, Args)]
pub struct LearnArguments {
    /// Healthy captures of one machine, all at one operating state.
    #[arg(required = true, value_name = "CAPTURE")]
    pub captures: Vec<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub of: Of,
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub by: By,
}

/// Arguments of `baseline list`.
#[derive(Debug, Args)]
pub struct ListArguments {
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub of: Of,
    /// How to print.
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Arguments of `baseline show`.
#[derive(Debug, Args)]
pub struct ShowArguments {
    /// Id, or its beginning.
    #[arg(value_name = "ID")]
    pub id: String,
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub of: Of,
    /// How to print.
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Arguments of acts on one baseline.
#[derive(Debug, Args)]
pub struct OneArguments {
    /// Id, or its beginning.
    #[arg(value_name = "ID")]
    pub id: String,
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub of: Of,
    #[command(flatten)]
    #[allow(missing_docs, reason = "its text would stand in the help")]
    pub by: By,
}

/// Whose baselines.
#[derive(Debug, Args)]
pub struct Of {
    /// Configuration of the daemon.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Machine id; may be left out where there is one machine.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
}

/// Who acts.
#[derive(Debug, Args)]
pub struct By {
    /// Who acts.
    #[arg(long, value_name = "NAME")]
    pub author: String,
    /// Why, or of what.
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub comment: String,
}

/// How to print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
}

/// Why it was not done.
#[derive(Debug, thiserror::Error)]
enum BaselineError {
    #[error(transparent)]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Sign(#[from] SignError),
    #[error("the document cannot be written")]
    Json(#[from] serde_json::Error),
    #[error("{} cannot be learned from", file.display())]
    Measure { file: PathBuf, source: Box<OfflineError> },
    #[error(transparent)]
    Machine(#[from] NoSuchMachine),
    #[error(
        "no baseline of {machine:?} has an id that begins with {id:?}; `rotorwatch baseline list` shows them"
    )]
    Unknown { machine: String, id: String },
    #[error("{n} baselines have an id that begins with {id:?}: write more of it")]
    Ambiguous { id: String, n: usize },
    #[error(transparent)]
    Keep(#[from] KeepError),
}

/// Why it is not clear which machine is meant.
#[derive(Debug, thiserror::Error)]
pub(super) enum NoSuchMachine {
    #[error("no machine {wanted:?} is configured; there is: {there}")]
    Unknown { wanted: String, there: String },
    #[error("several machines are configured: name one with --machine: {there}")]
    Which { there: String },
}

/// Works on baselines; exit code 0, or 2 when nothing was done.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let done = match &arguments.act {
        ActArguments::Learn(arguments) => learn(arguments),
        ActArguments::List(arguments) => list(arguments),
        ActArguments::Show(arguments) => show(arguments),
        ActArguments::Activate(arguments) => activate(arguments),
        ActArguments::Remove(arguments) => remove(arguments),
    };
    match done {
        Ok(text) => super::print(text.as_bytes()),
        Err(BaselineError::Configuration(mistakes)) => super::fail_lines(&mistakes),
        Err(error) => super::fail(&error),
    }
}

/// The machine that is meant.
pub(super) fn machine<'c>(
    config: &'c Config,
    wanted: Option<&str>,
) -> Result<&'c MachineConfig, NoSuchMachine> {
    let ids: Vec<&str> = config.machines.iter().map(|entry| entry.machine.id.as_str()).collect();
    let there = || if ids.is_empty() { "none".to_owned() } else { ids.join(", ") };
    match (wanted, config.machines.as_slice()) {
        (None, [only]) => Ok(only),
        (None, _) => Err(NoSuchMachine::Which { there: there() }),
        (Some(id), entries) => entries
            .iter()
            .find(|entry| entry.machine.id == id)
            .ok_or_else(|| NoSuchMachine::Unknown { wanted: id.to_owned(), there: there() }),
    }
}

fn learn(arguments: &LearnArguments) -> Result<String, BaselineError> {
    let By { author, comment } = &arguments.by;
    signed::check_by(author, comment)?;
    let config = config::load(&arguments.of.config)?;
    let entry = machine(&config, arguments.of.machine.as_deref())?;
    let machine = Arc::clone(&entry.machine);
    let reference = Reference { machine: Some(Arc::clone(&machine)), ..Reference::default() };
    let progress = Progress::new(true);
    let mut records: Vec<Record> = Vec::new();
    let mut warnings = String::new();
    let (captures, again) = names::distinct(&arguments.captures);
    for (file, earlier) in again {
        let (file, earlier) = (file.display(), earlier.display());
        warnings
            .push_str(&format!("warning: {file}: the same record as {earlier}, learned once\n"));
    }
    for file in captures {
        let learned = progress.of(file, |told| offline::learn_and_judge(file, &reference, told));
        let (record, accused) = learned.map_err(|source| match input::not_a_capture(file) {
            Some(other) => BaselineError::Input(other),
            None => BaselineError::Measure { file: file.clone(), source: Box::new(source) },
        })?;
        records.push(record);
        for accused in accused {
            warnings.push_str(&format!("warning: {}: {accused}\n", file.display()));
        }
    }
    let bins = &machine.limits.load_bins;
    let signed = Signed::new(&machine.id, (author, comment), app::wall_clock(), records, bins)?;
    let store = SqliteBaselines::open(&config.store.directory)?;
    let (held, replaced) = store::keep(&store, signed, bins)?;
    let mut text = line(&held);
    for id in replaced {
        text.push_str(&format!("takes the place of {id}\n"));
    }
    Ok(text + &warnings)
}

fn list(arguments: &ListArguments) -> Result<String, BaselineError> {
    let config = config::load(&arguments.of.config)?;
    let entries: Vec<&MachineConfig> = match arguments.of.machine.as_deref() {
        Some(id) => vec![machine(&config, Some(id))?],
        None => config.machines.iter().collect(),
    };
    let store = SqliteBaselines::open(&config.store.directory)?;
    let mut held = Vec::new();
    for entry in entries {
        held.extend(store.baselines(&entry.machine.id)?);
    }
    if arguments.format == Format::Json {
        let items = held.iter().map(BaselineItemWire::new).collect();
        return Ok(serde_json::to_string_pretty(&BaselineListWire { items })? + "\n");
    }
    if held.is_empty() {
        return Ok("no baselines; `rotorwatch baseline learn` makes one\n".to_owned());
    }
    Ok(held.iter().map(line).collect())
}

fn show(arguments: &ShowArguments) -> Result<String, BaselineError> {
    let config = config::load(&arguments.of.config)?;
    let entry = machine(&config, arguments.of.machine.as_deref())?;
    let store = SqliteBaselines::open(&config.store.directory)?;
    let held = find(&store, &entry.machine.id, &arguments.id)?;
    if arguments.format == Format::Json {
        return Ok(serde_json::to_string_pretty(&BaselineDetailWire::new(&held))? + "\n");
    }
    let mut text = line(&held);
    for record in &held.signed.records {
        text.push_str(&format!("  {}: {}\n", record.name, record.windows_text()));
        for ((channel, feature), usual) in &record.usual {
            let scatter = match usual.log_scatter {
                Some(scatter) if vector::is_direction(feature) => format!(", ± {scatter:.3}"),
                Some(scatter) => format!(", ± {:.1} %", 100.0 * scatter),
                None => String::new(),
            };
            let value = usual.value(feature);
            text.push_str(&format!("    {channel} {feature}: {value:.4e}{scatter}\n"));
        }
    }
    Ok(text)
}

fn activate(arguments: &OneArguments) -> Result<String, BaselineError> {
    let By { author, comment } = &arguments.by;
    signed::check_by(author, comment)?;
    let config = config::load(&arguments.of.config)?;
    let machine = &machine(&config, arguments.of.machine.as_deref())?.machine;
    let store = SqliteBaselines::open(&config.store.directory)?;
    let found = find(&store, &machine.id, &arguments.id)?;
    let act = Act { author, comment, at: app::wall_clock() };
    let meant = (&*machine.id, &*found.signed.id);
    Ok(line(&store::use_again(&store, meant, &machine.limits.load_bins, &act)?))
}

fn remove(arguments: &OneArguments) -> Result<String, BaselineError> {
    let By { author, comment } = &arguments.by;
    signed::check_by(author, comment)?;
    let config = config::load(&arguments.of.config)?;
    let machine = &machine(&config, arguments.of.machine.as_deref())?.machine;
    let store = SqliteBaselines::open(&config.store.directory)?;
    let found = find(&store, &machine.id, &arguments.id)?;
    let act = Act { author, comment, at: app::wall_clock() };
    store::take_away(&store, (&machine.id, &found.signed.id), &act)?;
    Ok(format!("{} removed\n", found.signed.id))
}

/// The baseline whose id begins so.
fn find(store: &SqliteBaselines, machine: &str, id: &str) -> Result<Held, BaselineError> {
    let all = store.baselines(machine)?;
    let mut begin = all.iter().filter(|held| !id.is_empty() && held.signed.id.starts_with(id));
    match (begin.next(), begin.count()) {
        (Some(found), 0) => Ok(found.clone()),
        (Some(_), n) => Err(BaselineError::Ambiguous { id: id.to_owned(), n: n + 1 }),
        (None, _) => Err(BaselineError::Unknown { machine: machine.to_owned(), id: id.to_owned() }),
    }
}

/// A baseline on one line.
fn line(held: &Held) -> String {
    let wire = BaselineItemWire::new(held);
    let state = match (held.is_intact, held.is_active) {
        (false, _) => "CHANGED SINCE IT WAS SIGNED, not used",
        (true, true) => "in use",
        (true, false) => "not in use",
    };
    let number = |value: Option<f64>, unit: &str| {
        value.map_or_else(|| "any".to_owned(), |value| format!("{value:.4}{unit}"))
    };
    let windows: usize = held.signed.records.iter().map(|record| record.n_windows).sum();
    format!(
        "{}  {}  {state}  speed {}  load {}  {} records, {windows} windows  {}  {}{}\n",
        wire.id,
        wire.machine,
        number(wire.speed_hz, " Hz"),
        number(wire.load, ""),
        wire.records.len(),
        wire.learned_at,
        wire.author,
        if wire.comment.is_empty() { String::new() } else { format!(": {}", wire.comment) },
    )
}
