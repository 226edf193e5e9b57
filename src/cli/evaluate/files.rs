//! The folder of `--out`: the document, a line a record, a page a record.

use super::EvaluateError;
use super::table::Case;
use crate::api::wire::evaluation::EvaluationDocument;
use crate::bench::table;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use crate::cli::output::Output;
use crate::diagnosis::fault::State;
use crate::evaluation::summary::Record;
use crate::evaluation::summary::Summary;
use std::fs;
use std::path::Path;
use std::path::PathBuf;

/// Columns of `verdicts.csv`.
const COLUMNS: [&str; 15] = [
    "file",
    "dataset",
    "label",
    "labelled_component",
    "labelled_severity",
    "outcome",
    "accepted",
    "state",
    "component",
    "fault",
    "severity",
    "confidence",
    "undetermined",
    "processor_s",
    "error",
];

/// The folder, being filled.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    rows: Vec<Vec<Cell>>,
}

impl Folder {
    /// Makes the folder, before any work is done.
    pub(super) fn make(path: &Path) -> Result<Self, EvaluateError> {
        let cannot = |source| EvaluateError::Folder { folder: path.to_owned(), source };
        fs::create_dir_all(path).map_err(cannot)?;
        Ok(Self { path: path.to_owned(), rows: Vec::new() })
    }

    /// Takes a record.
    pub(super) fn add(&mut self, case: &Case<'_>) -> Result<(), EvaluateError> {
        self.rows.push(row(case));
        Ok(())
    }

    /// Writes what is told of all records.
    pub(super) fn finish(
        self,
        _records: &[Record],
        _summary: &Summary<'_>,
        document: &EvaluationDocument,
    ) -> Result<(), EvaluateError> {
        let columns = COLUMNS.map(|name| Column { name, width: 0 });
        self.file("verdicts.csv", &table::csv(&columns, &self.rows))?;
        self.file("evaluation.json", &(serde_json::to_string_pretty(document)? + "\n"))
    }

    fn file(&self, name: &str, text: &str) -> Result<(), EvaluateError> {
        let mut output = Output::open(Some(&self.path.join(name)))?;
        output.write(text)?;
        Ok(output.finish()?)
    }
}

/// The line of a record: what was accused first, worst state first.
fn row(case: &Case<'_>) -> Vec<Cell> {
    let text = |text: &str| Cell::Text(text.to_owned());
    let number = |value: Option<f64>| match value {
        Some(value) => Cell::Plain(value, 3),
        None => Cell::Text(String::new()),
    };
    let score = case.record.score.as_ref().ok();
    let accusation = score.and_then(|score| {
        let severity = |s: Option<f64>| s.unwrap_or(0.0);
        score
            .accusations
            .iter()
            .max_by(|a, b| severity(a.severity).total_cmp(&severity(b.severity)))
    });
    let components = case.diagnosis.iter().flat_map(|d| &d.components);
    let open: Vec<&str> =
        components.filter(|c| c.state == State::Undetermined).map(|c| c.id.as_str()).collect();
    let labelled = match &case.row.known {
        crate::evaluation::truth::Known::Faults(faults) => {
            faults.iter().filter_map(|f| f.component.as_deref()).collect::<Vec<_>>().join(";")
        }
        crate::evaluation::truth::Known::RunToFailure => String::new(),
    };
    vec![
        text(&case.record.file),
        text(&case.record.dataset),
        text(&case.record.label),
        text(&labelled),
        text(&case.row.severity),
        text(score.map_or("", |s| s.outcome.name())),
        text(score.map_or("", |s| if s.accepted { "yes" } else { "no" })),
        text(case.diagnosis.as_ref().map_or("", |d| d.state.name())),
        text(accusation.map_or("", |a| a.component.as_str())),
        text(accusation.and_then(|a| a.fault).map_or("", |fault| fault.name())),
        number(accusation.and_then(|a| a.severity)),
        number(accusation.and_then(|a| a.confidence)),
        text(&open.join(";")),
        number(case.record.processor_s),
        text(case.record.score.as_ref().err().map_or("", String::as_str)),
    ]
}
