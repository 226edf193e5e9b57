//! The folder of `--out`: the document, a line a record, a page a record.

use super::EvaluateError;
use super::index;
use super::index::Listed;
use super::table::Case;
use crate::api::wire::evaluation::EvaluationDocument;
use crate::bench::table;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use crate::cli::output::Output;
use crate::cli::output::Spared;
use crate::cli::page;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use crate::evaluation::score::Accusation;
use crate::evaluation::score::Score;
use crate::evaluation::summary::Record;
use crate::evaluation::summary::Summary;
use crate::evaluation::truth::Known;
use crate::offline::Reference;
use crate::plot::escaped;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Columns of `verdicts.csv`.
const COLUMNS: [&str; 17] = [
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
    "visible",
    "over_sound",
    "processor_s",
    "error",
];

/// The folder, being filled.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    spared: Spared,
    rows: Vec<Vec<Cell>>,
    listed: Vec<Listed>,
}

/// Files of the folder.
const VERDICTS: &str = "verdicts.csv";
const DOCUMENT: &str = "evaluation.json";
const INDEX: &str = "index.html";

/// Folder of the pages of records.
pub(super) const PAGES: &str = "records";

/// Characters of a capture's name that its page's name keeps at most.
const NAME_MAX: usize = 80;

impl Folder {
    /// Makes the folder, before any work is done; refuses it if files of it are spared.
    pub(super) fn make(path: &Path, spared: Spared) -> Result<Self, EvaluateError> {
        let cannot = |source| EvaluateError::Folder { folder: path.to_owned(), source };
        fs::create_dir_all(path.join(PAGES)).map_err(cannot)?;
        [VERDICTS, DOCUMENT, INDEX].iter().try_for_each(|name| spared.refuse(&path.join(name)))?;
        Ok(Self { path: path.to_owned(), spared, rows: Vec::new(), listed: Vec::new() })
    }

    /// Takes a record and writes its page.
    pub(super) fn add(&mut self, case: &Case<'_>) -> Result<(), EvaluateError> {
        let page = match &case.diagnosis {
            Some(diagnosis) => {
                let name =
                    format!("{PAGES}/{}-{}.html", self.rows.len() + 1, slug(&case.record.file));
                let reference =
                    Reference { machine: Some(Arc::clone(&case.machine)), ..Reference::default() };
                let page =
                    page::of(&case.file, &case.record.file, diagnosis, &reference, &above(case));
                self.file(&name, &page.map_err(Box::new)?)?;
                Some(name)
            }
            None => None,
        };
        self.rows.push(row(&case.record, &case.row.severity, case.diagnosis.as_ref()));
        self.list(&case.record, page, case.diagnosis.as_ref().map(|d| d.state));
        Ok(())
    }

    /// Takes a trial, which has a page if it was judged wrongly: others can be made again from their names.
    pub(super) fn add_trial(&mut self, record: &Record, page: Option<String>) {
        self.rows.push(row(record, "", None));
        self.list(record, page, None);
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn list(&mut self, record: &Record, page: Option<String>, state: Option<State>) {
        let said =
            |score: &Score| score.accusations.iter().map(words).collect::<Vec<_>>().join("; ");
        let score = record.score.as_ref();
        self.listed.push(Listed {
            file: record.file.clone(),
            page,
            dataset: record.dataset.clone(),
            label: record.label.clone(),
            outcome: score.map(|s| (s.outcome, s.accepted)).map_err(Clone::clone),
            state,
            said: score.map(said).unwrap_or_default(),
        });
    }

    /// Writes what is told of all records.
    pub(super) fn finish(
        self,
        truth: &str,
        summary: &Summary<'_>,
        document: &EvaluationDocument,
    ) -> Result<(), EvaluateError> {
        let columns = COLUMNS.map(|name| Column { name, width: 0 });
        self.file(VERDICTS, &table::csv(&columns, &self.rows))?;
        self.file(DOCUMENT, &(serde_json::to_string_pretty(document)? + "\n"))?;
        self.file(INDEX, &index::page(truth, summary, &self.listed))
    }

    fn file(&self, name: &str, text: &str) -> Result<(), EvaluateError> {
        let mut output = Output::open(Some(&self.path.join(name)), &self.spared)?;
        output.write(text)?;
        Ok(output.finish()?)
    }
}

/// What the table says of a record, over the page of its verdict.
fn above(case: &Case<'_>) -> String {
    let row = case.row;
    let mut label = row.label.clone();
    if !labelled(&case.row.known).is_empty() {
        label.push_str(&format!(" at {}", labelled(&case.row.known)));
    }
    if !row.severity.is_empty() {
        label.push_str(&format!(" ({})", row.severity));
    }
    let outcome = match &case.record.score {
        Ok(score) if score.accepted => format!("{}, which the table accepts", score.outcome.name()),
        Ok(score) => score.outcome.name().to_owned(),
        Err(why) => format!("not scored: {why}"),
    };
    let notes = if row.notes.is_empty() { String::new() } else { format!(" {}", row.notes) };
    format!(
        "<p class=\"soft\"><a href=\"../index.html\">All records</a>. Labelled {}; outcome: {}.{}</p>\n",
        escaped(&label),
        escaped(&outcome.replace('_', " ")),
        escaped(&notes)
    )
}

/// `de: inner_race`.
fn words(accusation: &Accusation) -> String {
    let fault = accusation.fault.map_or("cause not proven", |fault| fault.name());
    format!("{}: {fault}", accusation.component)
}

/// Ids of the labelled components.
fn labelled(known: &Known) -> String {
    match known {
        Known::Faults(faults) => {
            faults.iter().filter_map(|f| f.component.as_deref()).collect::<Vec<_>>().join(";")
        }
        Known::RunToFailure => String::new(),
    }
}

/// A file's name without folders, with nothing in it that links or file systems mind.
pub(super) fn slug(file: &str) -> String {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let mut slug = String::new();
    for character in name.chars().take(NAME_MAX) {
        let kept = character.is_ascii_alphanumeric() || "._".contains(character);
        if kept {
            slug.push(character);
        } else if !slug.ends_with('-') {
            slug.push('-');
        }
    }
    slug
}

/// The line of a record: what was accused first, worst state first.
fn row(record: &Record, severity: &str, diagnosis: Option<&Diagnosis>) -> Vec<Cell> {
    let text = |text: &str| Cell::Text(text.to_owned());
    let number = |value: Option<f64>| match value {
        Some(value) => Cell::Plain(value, 3),
        None => Cell::Text(String::new()),
    };
    let score = record.score.as_ref().ok();
    let accusation = score.and_then(|score| {
        let severity = |s: Option<f64>| s.unwrap_or(0.0);
        score
            .accusations
            .iter()
            .max_by(|a, b| severity(a.severity).total_cmp(&severity(b.severity)))
    });
    let components = diagnosis.iter().flat_map(|d| &d.components);
    let open: Vec<&str> =
        components.filter(|c| c.state == State::Undetermined).map(|c| c.id.as_str()).collect();
    vec![
        text(&record.file),
        text(&record.dataset),
        text(&record.label),
        text(&labelled(&record.known)),
        text(severity),
        text(score.map_or("", |s| s.outcome.name())),
        text(score.map_or("", |s| if s.accepted { "yes" } else { "no" })),
        text(diagnosis.map_or("", |d| d.state.name())),
        text(accusation.map_or("", |a| a.component.as_str())),
        text(accusation.and_then(|a| a.fault).map_or("", |fault| fault.name())),
        number(accusation.and_then(|a| a.severity)),
        number(accusation.and_then(|a| a.confidence)),
        text(&open.join(";")),
        text(record.is_visible.map_or("", |seen| if seen { "yes" } else { "no" })),
        number(record.over_sound),
        number(record.processor_s),
        text(record.score.as_ref().err().map_or("", String::as_str)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_pages_hold_nothing_that_steers() {
        assert_eq!(slug("a/b/run 7, (inner).h5"), "run-7-inner-.h5");
        assert_eq!(slug("..\\x<\"&#?.h5"), "x-.h5");
        assert_eq!(slug(&"é".repeat(300)), "-");
    }

    #[test]
    fn a_truth_table_of_the_same_name_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let table = dir.path().join(VERDICTS);
        fs::write(&table, "file\n").unwrap();
        let make =
            |read: &Path| Folder::make(dir.path(), Spared::nothing().and([&read.to_owned()]));
        make(&dir.path().join("truth.csv")).unwrap();
        for name in [VERDICTS, "records/../verdicts.csv"] {
            let error = make(&dir.path().join(name)).unwrap_err().to_string();
            assert!(error.contains("--out would replace a file that is read"), "{error}");
        }
        let page = dir.path().join("records/1-x.html");
        let folder = make(&page).unwrap();
        assert!(folder.file("records/1-x.html", "").is_err(), "a record that is read");
        folder.file("records/2-x.html", "").unwrap();
    }
}
