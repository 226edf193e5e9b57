//! Captures that a truth table lists, diagnosed one after another.

use super::EvaluateError;
use crate::causes::with_causes;
use crate::cli::input;
use crate::cli::input::InputError;
use crate::cli::progress::Progress;
use crate::diagnosis::baseline;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::verdict::Diagnosis;
use crate::evaluation::score;
use crate::evaluation::summary::Record;
use crate::evaluation::truth::Role;
use crate::evaluation::truth::TruthRow;
use crate::evaluation::truth::TruthTable;
use crate::machine::Machine;
use crate::offline;
use crate::offline::OfflineError;
use crate::offline::Reference;
use crate::offline::names;
use cpu_time::ThreadTime;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Bytes of a truth table at most: some hundred thousand lines.
const TABLE_BYTES_MAX: u64 = 64 << 20;

/// A record that was diagnosed and scored, or could not be.
#[derive(Debug)]
pub(super) struct Case<'t> {
    /// Its row.
    pub(super) row: &'t TruthRow,
    /// The capture.
    pub(super) file: PathBuf,
    /// The machine.
    pub(super) machine: Arc<Machine>,
    /// The diagnosis, if there is one.
    pub(super) diagnosis: Option<Diagnosis>,
    /// What came of it.
    pub(super) record: Record,
}

/// A truth table with all machines it needs.
#[derive(Debug)]
pub(super) struct Task {
    table: TruthTable,
    /// What files of the table count from.
    folder: PathBuf,
    machines: BTreeMap<String, Arc<Machine>>,
    /// The folder of the machine files.
    machine_folder: PathBuf,
}

/// Baselines measured so far, by data set and file; or why they cannot be used.
type Learned = BTreeMap<(String, String), Result<baseline::Record, String>>;

impl Task {
    /// Reads a truth table and the machine file of every data set in it.
    pub(super) fn read(truth: &Path, machines: Option<&Path>) -> Result<Self, EvaluateError> {
        let table = TruthTable::parse(&read_text(truth)?, &truth.display().to_string())?;
        let folder = truth.parent().unwrap_or(Path::new("")).to_owned();
        let machines = machines.map_or_else(|| folder.join("machines"), Path::to_owned);
        let machine_folder = machines;
        let machines = read_machines(&table, &machine_folder, truth)?;
        if !table.ignored.is_empty() {
            let columns = table.ignored.join(", ");
            tracing::warn!("{}: columns that mean nothing here: {columns}", truth.display());
        }
        Ok(Self { table, folder, machines, machine_folder })
    }

    /// Every file that is read beside the table.
    pub(super) fn inputs(&self) -> Vec<PathBuf> {
        let machines = self.machines.keys();
        let mut files: Vec<PathBuf> =
            machines.map(|name| self.machine_folder.join(format!("{name}.toml"))).collect();
        for row in &self.table.rows {
            files.extend(row.baseline.iter().chain([&row.file]).map(|name| self.folder.join(name)));
        }
        files
    }

    /// Diagnoses and scores every row that is to be scored, and hands on what came of it.
    pub(super) fn diagnose<'t>(
        &'t self,
        show_progress: bool,
        take: &mut dyn FnMut(Case<'t>) -> Result<(), EvaluateError>,
    ) -> Result<(), EvaluateError> {
        let progress = Progress::new(show_progress);
        let mut learned = Learned::new();
        for row in self.table.rows.iter().filter(|row| row.role == Role::Score) {
            let Some(machine) = self.machines.get(&row.dataset) else { continue };
            take(self.case(row, machine, &mut learned, &progress))?;
        }
        Ok(())
    }

    fn case<'t>(
        &self,
        row: &'t TruthRow,
        machine: &Arc<Machine>,
        learned: &mut Learned,
        progress: &Progress,
    ) -> Case<'t> {
        let file = self.folder.join(&row.file);
        let mut processor_s = None;
        let found = self.baseline(row, machine, learned, progress).and_then(|baseline| {
            let machine = Some(Arc::clone(machine));
            let reference = Reference { machine, baseline, ..Reference::default() };
            let begun = ThreadTime::now();
            let found = progress.of(&file, |told| offline::diagnose(&file, &reference, told));
            processor_s = Some(begun.elapsed().as_secs_f64());
            found.map_err(|error| why(&file, &error))
        });
        let (diagnosis, score) = match found {
            Ok(diagnosis) => {
                let scored = score::score(&row.known, &row.acceptable, &diagnosis);
                (Some(diagnosis), scored.map_err(|error| error.to_string()))
            }
            Err(why) => (None, Err(why)),
        };
        let record = Record {
            file: row.file.clone(),
            dataset: row.dataset.clone(),
            label: row.label.clone(),
            known: row.known.clone(),
            score,
            is_visible: None,
            over_sound: None,
            processor_s: diagnosis.as_ref().and(processor_s),
        };
        Case { row, file, machine: Arc::clone(machine), diagnosis, record }
    }

    /// The healthy records a row names, each measured once.
    fn baseline(
        &self,
        row: &TruthRow,
        machine: &Arc<Machine>,
        learned: &mut Learned,
        progress: &Progress,
    ) -> Result<Baseline, String> {
        let mut records = Vec::new();
        let files: Vec<PathBuf> = row.baseline.iter().map(|name| self.folder.join(name)).collect();
        let (once, _) = names::distinct(&files);
        for (name, file) in row.baseline.iter().zip(&files) {
            if !once.iter().any(|kept| std::ptr::eq(*kept, file)) {
                continue; // An earlier one is the same record.
            }
            let learn = || {
                let machine = Some(Arc::clone(machine));
                let reference = Reference { machine, ..Reference::default() };
                let learned = progress.of(file, |told| offline::learn(file, &reference, told));
                learned.map_err(|error| {
                    format!("the baseline {name} cannot be used: {}", why(file, &error))
                })
            };
            let key = (row.dataset.clone(), name.clone());
            records.push(learned.entry(key).or_insert_with(learn).clone()?);
        }
        Ok(Baseline { records, provisional: false })
    }
}

/// Why a capture could not be diagnosed, in one text.
fn why(file: &Path, error: &OfflineError) -> String {
    match input::not_a_capture(file) {
        Some(other) => with_causes(&other),
        None => with_causes(error),
    }
}

fn read_text(file: &Path) -> Result<String, EvaluateError> {
    let cannot = |source| EvaluateError::Read { file: file.to_owned(), source };
    let mut bytes = Vec::new();
    let opened = File::open(file).map_err(cannot)?;
    opened.take(TABLE_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(cannot)?;
    if bytes.len() as u64 > TABLE_BYTES_MAX {
        return Err(EvaluateError::TooLong { file: file.to_owned(), limit: TABLE_BYTES_MAX });
    }
    String::from_utf8(bytes).map_err(|_| EvaluateError::NoText { file: file.to_owned() })
}

/// The machine of every data set, or all that lack or have mistakes.
fn read_machines(
    table: &TruthTable,
    folder: &Path,
    truth: &Path,
) -> Result<BTreeMap<String, Arc<Machine>>, EvaluateError> {
    let (mut machines, mut mistakes) = (BTreeMap::new(), Vec::new());
    let mut first_lines: BTreeMap<&str, u64> = BTreeMap::new();
    for row in &table.rows {
        first_lines.entry(&row.dataset).or_insert(row.line);
    }
    for (dataset, line) in first_lines {
        let file = folder.join(format!("{dataset}.toml"));
        if !file.exists() {
            mistakes.push(format!(
                "{}:{line}: dataset `{dataset}`: there is no machine file {}; write it, or name its folder with --machines",
                truth.display(),
                file.display()
            ));
            continue;
        }
        match input::machine(&file) {
            Ok(machine) => {
                machines.insert(dataset.to_owned(), Arc::new(machine));
            }
            Err(InputError::Mistakes(wrong)) => mistakes.push(wrong.to_string()),
            Err(error) => mistakes.push(format!("error: {}", with_causes(&error))),
        }
    }
    if mistakes.is_empty() {
        Ok(machines)
    } else {
        Err(EvaluateError::Machines(mistakes.join("\n")))
    }
}
