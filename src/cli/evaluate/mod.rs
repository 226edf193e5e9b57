//! `rotorwatch evaluate`: captures or trials of which the truth is known → how often the diagnosis is right.
//!
//! `grid` makes trials, until `stop` is asked; `table` diagnoses what a truth table lists and scores it; `text`, `files` and `index`
//! say what came of it. A diagnosis gets the samples and attributes of its capture, the machine file of its data set and the
//! baselines of its row: no label, no speed and no name of the table.

mod files;
mod grid;
mod index;
mod kept;
mod stop;
mod table;
mod text;

use super::EXIT_ERROR;
use super::output::Output;
use super::output::OutputError;
use super::output::Spared;
use super::progress::Progress;
use super::terminal::Page;
use crate::api::wire::evaluation::EvaluationDocument;
use crate::capture::error::CaptureError;
use crate::evaluation::summary::Record;
use crate::evaluation::summary::Summary;
use crate::evaluation::truth::TruthErrors;
use crate::offline::OfflineError;
use crate::trials::grid::FIRST_REPORTED_SEED;
use crate::trials::grid::Part;
use crate::trials::grid::Plan;
use clap::Args;
use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use clap::builder::TypedValueParser;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use stop::Stop;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch evaluate truth.csv
  rotorwatch evaluate truth.csv --machines machines --out figures
  rotorwatch evaluate truth.csv --format json > evaluation.json
  rotorwatch evaluate --grid
  rotorwatch evaluate --grid --seeds 2 --thin
  rotorwatch evaluate --grid --part drawn --seeds 20
  rotorwatch evaluate --grid --part runs --seeds 4

TRUTH.csv has a line a capture: file, dataset, label (healthy, a fault as in the diagnosis document, ball,
gear_tooth_broken, run_to_failure), and may have component, baseline (captures with ; between), acceptable (verdicts
that count as right, with ; between), role (score, baseline), severity, shaft_speed_hz, notes. Captures count from its
folder, the machine file of a data set is DIR/DATASET.toml. The diagnosis sees neither labels nor shaft_speed_hz.

right: the labelled fault at its component and nothing else accused, or healthy and nothing accused;
detected: accused without a cause; undetermined, missed: nothing accused, the component open or called
healthy; wrong cause: another fault or component accused; false alarm: anything accused on a healthy
machine. A run to failure is right if its first alarm comes in its second half and before its end.

--grid makes its records: a motor stand with bearing defects of four strengths and eight kinds of disturbance, at
steady and changing speed; machines of which everything is drawn, sampling rate, speed, bearings and fourteen kinds of
disturbance; gear pairs by two models with damaged, worn and merely eccentric or ghost-ridden teeth; runs of the simulated rotor;
the simulated rig with good and bad gear, shaft and bearing at five speeds, two clearances and preload, two loads, four
strengths of noise, with and without a baseline (an hour and a half on two cores for one seed; more seeds add to the
other parts). Ctrl-C or SIGTERM stops it and tells of what was tried so far, which is of all parts alike; a second
one ends at once. Where stderr is no terminal, a line a minute says how far it is.

Exit codes: 0 done, whatever the verdicts; 2 something could not be read, judged or written.";

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What is known of which captures.
    #[arg(value_name = "TRUTH.csv", required_unless_present = "grid", conflicts_with = "grid")]
    pub truth: Option<PathBuf>,
    /// Trials made on the fly instead: a motor stand in closed form, drawn machines, gear pairs, runs and the simulated rig.
    #[arg(long, conflicts_with = "machines")]
    pub grid: bool,
    /// Seeds of each cell of the grid's stand.
    #[arg(long, default_value_t = 25, value_name = "N", requires = "grid",
          value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub seeds: u64,
    /// First seed: rules are set on those below 1000, figures come from the others.
    #[arg(long, default_value_t = FIRST_REPORTED_SEED, value_name = "SEED", requires = "grid",
          value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub first_seed: u64,
    /// One cell of the rig instead of all: speed, clearance, load, noise.
    #[arg(long, requires = "grid")]
    pub thin: bool,
    /// Machines in good health only: how often they are accused.
    #[arg(long, requires = "grid")]
    pub healthy: bool,
    /// One part of the grid instead of all.
    #[arg(long, requires = "grid", value_name = "PART",
          value_parser = PossibleValuesParser::new(Part::ALL.map(Part::name)).try_map(part))]
    pub part: Option<Part>,
    /// Folder of the machine files, one a data set; `machines` beside TRUTH.csv by default.
    #[arg(long, value_name = "DIR")]
    pub machines: Option<PathBuf>,
    /// Folder for evaluation.json, verdicts.csv and a page on each record, of the grid on those judged wrongly with the captures
    /// themselves (index.html); made if it is not there.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// What is printed.
    #[arg(long, value_enum, default_value = "text", value_name = "FORMAT")]
    pub format: Format,
}

/// The part of this name.
fn part(name: String) -> Result<Part, String> {
    Part::ALL.into_iter().find(|part| part.name() == name).ok_or(name)
}

/// Forms of the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Tables for people.
    Text,
    /// One JSON document: `docs/schemas/evaluation-1.schema.json`.
    Json,
}

/// Why nothing was evaluated, or what came of it could not be written.
#[derive(Debug, thiserror::Error)]
pub(super) enum EvaluateError {
    #[error("{}: cannot be read", file.display())]
    Read { file: PathBuf, source: io::Error },
    #[error("{}: this is no truth table: it is longer than {limit} bytes", file.display())]
    TooLong { file: PathBuf, limit: u64 },
    #[error("{}: this is no truth table: it is not text in UTF-8", file.display())]
    NoText { file: PathBuf },
    #[error(transparent)]
    Truth(#[from] TruthErrors),
    #[error("{0}")]
    Machines(String),
    #[error("{}: cannot be made", folder.display())]
    Folder { folder: PathBuf, source: io::Error },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("a record that was judged wrongly cannot be kept")]
    Keep(#[from] CaptureError),
    #[error("the page of a record cannot be made")]
    Page(#[from] Box<OfflineError>),
    #[error("the evaluation cannot be written as JSON")]
    Json(#[from] serde_json::Error),
}

/// Evaluates; exit code 0, or 2 if anything could not be done.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match evaluate(arguments) {
        Ok(records) if records.iter().all(|record| record.score.is_ok()) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(EXIT_ERROR),
        Err(EvaluateError::Truth(mistakes)) => {
            super::tell_lines(&mistakes);
            ExitCode::from(EXIT_ERROR)
        }
        Err(EvaluateError::Machines(mistakes)) => {
            super::tell_lines(&EvaluateError::Machines(mistakes));
            ExitCode::from(EXIT_ERROR)
        }
        Err(error) => super::fail(&error),
    }
}

fn evaluate(arguments: &Arguments) -> Result<Vec<Record>, EvaluateError> {
    let Some(truth) = &arguments.truth else { return evaluate_grid(arguments) };
    let task = table::Task::read(truth, arguments.machines.as_deref())?;
    let spared = Spared::nothing().and([truth]).and(task.inputs());
    let made = arguments.out.as_deref().map(|out| files::Folder::make(out, spared));
    let mut folder = made.transpose()?;
    let mut records = Vec::new();
    task.diagnose(arguments.format == Format::Text, &mut |case| {
        if let Some(folder) = &mut folder {
            folder.add(&case)?;
        }
        records.push(case.record);
        Ok(())
    })?;
    let truth = truth.display().to_string();
    tell(&records, &truth, arguments.format, folder)?;
    Ok(records)
}

fn evaluate_grid(arguments: &Arguments) -> Result<Vec<Record>, EvaluateError> {
    let plan = Plan {
        first_seed: arguments.first_seed,
        n_seeds: arguments.seeds,
        is_thin: arguments.thin,
        is_healthy: arguments.healthy,
        part: arguments.part,
    };
    let made = arguments.out.as_deref().map(|out| files::Folder::make(out, Spared::nothing()));
    let mut folder = made.transpose()?;
    let mut kept = folder.as_ref().map(|folder| kept::Kept::new(folder.path()));
    let mut keep = |record: &Record, wrong: &grid::Wrong| {
        kept.as_mut().map_or(Ok(None), |kept| kept.take(record, wrong))
    };
    let progress = Progress::of_hours(arguments.format == Format::Text);
    let grid::Scored { name, records } =
        grid::score(&plan, progress, &Stop::on_signals(), &mut keep)?;
    if let Some(folder) = &mut folder {
        records.iter().for_each(|(record, page)| folder.add_trial(record, page.clone()));
    }
    let records: Vec<Record> = records.into_iter().map(|(record, _)| record).collect();
    tell(&records, &name, arguments.format, folder)?;
    Ok(records)
}

/// Prints what came of scored records and completes the folder, if there is one.
fn tell(
    records: &[Record],
    truth: &str,
    format: Format,
    folder: Option<files::Folder>,
) -> Result<(), EvaluateError> {
    let summary = Summary::of(records);
    let document = EvaluationDocument::new(records, &summary, truth);
    if let Some(folder) = folder {
        folder.finish(truth, &summary, &document)?;
    }
    let mut stdout = Output::stdout();
    match format {
        Format::Text => stdout.write(&text::of(records, &summary, truth, &Page::of_stdout()))?,
        Format::Json => stdout.write(&(serde_json::to_string(&document)? + "\n"))?,
    }
    Ok(stdout.finish()?)
}
