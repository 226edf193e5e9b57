//! `rotorwatch diagnose`: captures → verdicts.

use super::EXIT_ERROR;
use super::hints::HintArguments;
use super::input;
use super::input::InputError;
use super::output::Output;
use super::output::OutputError;
use super::output::Spared;
use super::page;
use super::progress::Progress;
use super::replayed;
use super::report;
use super::report::Layout;
use super::terminal::Page;
use crate::api::wire::diagnosis::DiagnosisDocument;
use crate::capture::content;
use crate::capture::content::Content;
use crate::capture::error::CaptureError;
use crate::capture::map::MapError;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::State;
use crate::diagnosis::rate::FalseAlarms;
use crate::diagnosis::verdict::BaselineUse;
use crate::diagnosis::verdict::Diagnosis;
use crate::evidence;
use crate::evidence::EvidenceError;
use crate::evidence::again::Again;
use crate::offline;
use crate::offline::OfflineError;
use crate::offline::Reference;
use crate::offline::names;
use crate::units::Hz;
use clap::Args;
use clap::ValueEnum;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Exit code when `--fail-on` is met.
const EXIT_ACCUSED: u8 = 1;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch diagnose --machine rig.toml run-7.h5
  rotorwatch diagnose --machine rig.toml --baseline healthy.h5 run-7.h5 run-8.h5
  rotorwatch diagnose --machine rig.toml --format json --out verdicts.jsonl runs/*.h5
  rotorwatch diagnose --machine rig.toml --format html --out run-7.html run-7.h5
  rotorwatch diagnose --machine rig.toml --fail-on damaged run-7.h5 || page-someone
  rotorwatch diagnose --evidence rig-1-00000007.h5
  rotorwatch diagnose --machine rig.toml --rate 12000 --map 'DE=/acc x,unit=g' run-7.csv
  rotorwatch diagnose --machine rig.toml --map DE=/ch1,unit=V,scale=1.5e-4 run-7.wav

Captures are HDF5, CSV or WAV: the content decides. `rotorwatch check` shows what is in one.

Without --machine the capture's own machine description is used; without that only levels and the
health of the sensors can be told.

A capture that the daemon made of an alarm is held against the baseline inside unless --baseline says otherwise;
--evidence judges its windows again, and ends with 2 if one is not the same bit by bit.

Exit codes: 0 done; 1 the state named by --fail-on was found; 2 something could not be read, judged
or written (the other captures still are), or a window judged again is another one.";

/// Arguments of `diagnose`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Captures (HDF5, CSV, WAV); each is diagnosed on its own.
    #[arg(required = true, value_name = "CAPTURE")]
    pub captures: Vec<PathBuf>,
    /// Machine file: what turns, where the sensors are.
    #[arg(long, value_name = "FILE")]
    pub machine: Option<PathBuf>,
    /// A capture of the same machine in good health; may be repeated.
    #[arg(long, value_name = "CAPTURE")]
    pub baseline: Vec<PathBuf>,
    /// Nominal speed of the first shaft, Hz; a tacho or speed channel wins over it.
    #[arg(long, value_name = "HZ", value_parser = super::positive)]
    pub speed: Option<f64>,
    /// What the files do not say.
    #[command(flatten)]
    pub hints: HintArguments,
    /// Probability of a false accusation of a healthy part in a record, 1e-12 to 1e-3; below 1e-4 it rests on the
    /// assumed form of the noise.
    #[arg(long, value_name = "P", value_parser = probability, default_value = "1e-3")]
    pub false_alarm_probability: f64,
    /// Text for people, one JSON document a line for each capture, or a page with pictures of one capture.
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
    /// Show the evidence for every component, not only for those accused (JSON always has it). A capture that the
    /// daemon made of an alarm is not diagnosed as a whole: the windows that the alarm rests on are judged again, with
    /// the machine, settings and baseline inside, and held against what was found then, bit by bit.
    #[arg(long)]
    pub evidence: bool,
    /// Write to this file instead of stdout; it appears when it is complete.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// End with exit code 1 if a capture is in this state or worse.
    #[arg(long, value_enum, value_name = "STATE")]
    pub fail_on: Option<FailOn>,
}

/// How verdicts are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// For programs: `docs/schemas/diagnosis-1.schema.json`.
    Json,
    /// One page of HTML that needs nothing else.
    Html,
}

/// From which state on the exit code is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FailOn {
    /// Warning or damaged.
    Warning,
    /// Damaged only.
    Damaged,
}

impl FailOn {
    fn is_met_by(self, state: State) -> bool {
        match self {
            Self::Warning => state.is_accusation(),
            Self::Damaged => state == State::Damaged,
        }
    }
}

/// Why nothing at all was diagnosed.
#[derive(Debug, thiserror::Error)]
enum DiagnoseError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("the baseline {} cannot be used", file.display())]
    Baseline { file: PathBuf, source: Box<OfflineError> },
    #[error("--format html makes a page of one capture, here are {0}; call it once for each")]
    Pages(usize),
    #[error("the page cannot be made")]
    Page(#[from] Box<OfflineError>),
    #[error("the verdict cannot be written as JSON")]
    Json(#[from] serde_json::Error),
}

/// What became of all captures.
#[derive(Debug, Default)]
struct Tally {
    n_failed: usize,
    n_diagnosed: usize,
    fail_on_met: bool,
}

impl Tally {
    fn exit_code(&self) -> ExitCode {
        if self.n_failed > 0 {
            ExitCode::from(EXIT_ERROR)
        } else if self.fail_on_met {
            ExitCode::from(EXIT_ACCUSED)
        } else {
            ExitCode::SUCCESS
        }
    }
}

impl Tally {
    /// Counts a capture whose windows were judged again.
    fn count(&mut self, again: &Again, fail_on: Option<FailOn>) {
        self.n_diagnosed += 1;
        self.n_failed += usize::from(!again.is_equal());
        let state = again.diagnosis.as_ref().map(|diagnosis| diagnosis.state);
        self.fail_on_met |= fail_on.zip(state).is_some_and(|(fail_on, s)| fail_on.is_met_by(s));
    }
}

/// Reads a probability of false alarms.
fn probability(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (1e-12..=1e-3).contains(&number) => Ok(number),
        Ok(_) | Err(_) => Err("not a number from 1e-12 to 1e-3".to_owned()),
    }
}

/// Diagnoses every capture; what fails is told on stderr and does not hold up the others.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match diagnose_all(arguments) {
        Ok(tally) => tally.exit_code(),
        Err(DiagnoseError::Input(InputError::Mistakes(mistakes))) => super::fail_lines(&mistakes),
        Err(error) => super::fail(&error),
    }
}

fn diagnose_all(arguments: &Arguments) -> Result<Tally, DiagnoseError> {
    let read = arguments.captures.iter().chain(&arguments.baseline).chain(&arguments.machine);
    let spared = Spared::nothing().and(read);
    arguments.out.as_deref().map_or(Ok(()), |out| spared.refuse(out))?; // Before minutes of work.
    if arguments.format == Format::Html && arguments.captures.len() > 1 {
        return Err(DiagnoseError::Pages(arguments.captures.len()));
    }
    let progress = Progress::new(arguments.format != Format::Json);
    let machine = arguments.machine.as_deref().map(input::machine).transpose()?;
    let mut reference = Reference {
        machine: machine.map(Arc::new),
        speed: arguments.speed.map(Hz),
        hints: arguments.hints.hints()?,
        baseline: Baseline::default(),
        false_alarms: FalseAlarms {
            per_decision: arguments.false_alarm_probability,
            ..FalseAlarms::default()
        },
    };
    let (baselines, repeated) = names::distinct(&arguments.baseline);
    let held = Held { repeated: repeated.into_iter().map(same_record).collect(), baselines };
    reference.baseline = learn(&held.baselines, &reference, &progress)?;
    let mut output = Output::open(arguments.out.as_deref(), &spared)?;
    let writer = Writer::new(arguments, &output);
    let mut tally = Tally::default();
    for file in &arguments.captures {
        if output.is_closed() && arguments.fail_on.is_none() {
            break; // Nobody reads on, and nobody asked for the exit code.
        }
        if arguments.evidence
            && arguments.format != Format::Html
            && let Some(again) = again(file, &mut tally)
        {
            let Some(again) = again else { continue };
            output.write(&writer.replayed(&again, file, tally.n_diagnosed == 0)?)?;
            tally.count(&again, arguments.fail_on);
            continue;
        }
        let reference = match with_kept(file, &reference, &arguments.baseline) {
            Ok(reference) => reference,
            Err(error) => {
                tally.n_failed += 1;
                super::tell(&error);
                continue;
            }
        };
        let found = progress.of(file, |told| offline::diagnose(file, &reference, told));
        match found {
            Ok(mut diagnosis) => {
                held.tell(file, &mut diagnosis);
                let text = writer.text(&diagnosis, file, &reference, tally.n_diagnosed == 0)?;
                output.write(&text)?;
                tally.n_diagnosed += 1;
                let met = |fail_on: FailOn| fail_on.is_met_by(diagnosis.state);
                tally.fail_on_met |= arguments.fail_on.is_some_and(met);
            }
            Err(error) => {
                tally.n_failed += 1;
                tell_failure(file, &error);
            }
        }
    }
    if tally.n_diagnosed > 0 {
        output.finish()?;
    }
    Ok(tally)
}

/// Judges the windows again that a capture keeps. `None`: it keeps none; `Some(None)`: they cannot be, which was told.
fn again(file: &Path, tally: &mut Tally) -> Option<Option<Again>> {
    if !is_hdf5(file) {
        return None;
    }
    match evidence::again::judge(file) {
        Ok(again) => again.map(Some),
        Err(error) => {
            tally.n_failed += 1;
            if let EvidenceError::Machine { source, .. } = &error {
                super::tell_lines(source);
            } else {
                super::tell(&error);
            }
            Some(None)
        }
    }
}

/// What a capture is held against: without `--baseline`, the baseline that an alarm's capture keeps.
fn with_kept(
    file: &Path,
    reference: &Reference,
    given: &[PathBuf],
) -> Result<Reference, EvidenceError> {
    let mut reference = reference.clone();
    if given.is_empty() && is_hdf5(file) {
        // What cannot be read at all is told by whoever reads it.
        let kept = match evidence::again::baseline(file) {
            Err(EvidenceError::Capture(CaptureError::Library { .. })) => None,
            kept => kept?,
        };
        reference.baseline = kept.unwrap_or_default();
    }
    Ok(reference)
}

fn is_hdf5(file: &Path) -> bool {
    let content = fs::File::open(file).and_then(|mut file| content::of(&mut file));
    matches!(content, Ok(Content::Hdf5))
}

/// What was given to hold captures against.
struct Held<'a> {
    /// Each once.
    baselines: Vec<&'a PathBuf>,
    /// What one of them is already.
    repeated: Vec<BaselineUse>,
}

impl Held<'_> {
    /// Lists what was given twice, and warns of a capture that is held against itself.
    fn tell(&self, file: &Path, diagnosis: &mut Diagnosis) {
        diagnosis.baselines.extend(self.repeated.iter().cloned());
        if self.baselines.iter().any(|baseline| names::is_same(baseline, file)) {
            let warning = format!(
                "{} is its own baseline: held against itself nothing has changed; give records of good health other than it",
                file.display()
            );
            diagnosis.warnings.push(warning);
        }
    }
}

/// A baseline that is an earlier one by another name.
fn same_record((file, earlier): (&PathBuf, &PathBuf)) -> BaselineUse {
    let reason = format!("the same record as {}", earlier.display());
    BaselineUse { name: file.display().to_string(), used: false, reason, id: None, n_windows: 0 }
}

fn learn(
    files: &[&PathBuf],
    reference: &Reference,
    progress: &Progress,
) -> Result<Baseline, DiagnoseError> {
    let mut records: Vec<Record> = Vec::new();
    for file in files {
        let learned = progress.of(file, |told| offline::learn(file, reference, told));
        records.push(learned.map_err(|source| match input::not_a_capture(file) {
            Some(other) => DiagnoseError::Input(other),
            None => DiagnoseError::Baseline { file: (*file).clone(), source: Box::new(source) },
        })?);
    }
    Ok(Baseline { records, provisional: false })
}

/// Tells why a capture could not be diagnosed, once.
fn tell_failure(file: &Path, error: &OfflineError) {
    if let Some(other) = input::not_a_capture(file) {
        super::tell(&other);
    } else if let OfflineError::Machine { source, .. } = error {
        super::tell_lines(source);
    } else if let OfflineError::Capture(source) = error {
        super::tell(source); // Names the file itself.
    } else {
        super::tell(error);
    }
}

/// Sets verdicts as text or documents.
#[derive(Debug)]
struct Writer {
    format: Format,
    layout: Layout,
}

impl Writer {
    fn new(arguments: &Arguments, output: &Output) -> Self {
        let page = if output.is_stdout() { Page::of_stdout() } else { Page::PLAIN };
        let layout = Layout { page, all_evidence: arguments.evidence };
        Self { format: arguments.format, layout }
    }

    /// What is said of a capture whose windows were judged again.
    fn replayed(
        &self,
        again: &Again,
        file: &Path,
        is_first: bool,
    ) -> Result<String, DiagnoseError> {
        let name = file.display().to_string();
        if self.format == Format::Json {
            return Ok(serde_json::to_string(&replayed::document(again, &name))? + "\n");
        }
        let gap = if is_first { "" } else { "\n" };
        let verdict = again.diagnosis.as_ref().map(|d| report::text(d, &name, &self.layout));
        Ok(format!("{gap}{}{}", verdict.unwrap_or_default(), replayed::text(again)))
    }

    fn text(
        &self,
        diagnosis: &Diagnosis,
        file: &Path,
        reference: &Reference,
        is_first: bool,
    ) -> Result<String, DiagnoseError> {
        let name = file.display().to_string();
        match self.format {
            Format::Text => {
                let gap = if is_first { "" } else { "\n" };
                Ok(format!("{gap}{}", report::text(diagnosis, &name, &self.layout)))
            }
            Format::Json => {
                let document = DiagnosisDocument::new(diagnosis, Some(&name));
                Ok(serde_json::to_string(&document)? + "\n")
            }
            Format::Html => {
                let made = page::of(file, &name, diagnosis, reference, "");
                Ok(made.map_err(Box::new)?)
            }
        }
    }
}
