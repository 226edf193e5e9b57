//! What is known of records: the rows of a truth table (CSV), every mistake of it at once with its line.
//!
//! Columns `file`, `dataset` and `label` must be there; `severity`, `component`, `baseline`, `acceptable`, `role`
//! and `notes` may. Others, among them `shaft_speed_hz`, are passed over: nobody who diagnoses is to see them.

use super::score::Outcome;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use csv_core::ReadRecordResult;
use csv_core::Reader;
use std::collections::BTreeMap;
use std::fmt;

/// Columns read; the first three must be there.
const COLUMNS: [&str; 9] = [
    "file",
    "dataset",
    "label",
    "severity",
    "component",
    "baseline",
    "acceptable",
    "role",
    "notes",
];
/// So many of them, the first, must be there.
const N_REQUIRED: usize = 3;

/// A column that is known and not read.
const UNREAD_COLUMN: &str = "shaft_speed_hz";

/// Cells of a line at most.
const CELLS_MAX: usize = 1024;

/// Faults of scored components, all that a label can name.
const FAULTS: [FaultMode; 11] = [
    FaultMode::InnerRace,
    FaultMode::OuterRace,
    FaultMode::RollingElement,
    FaultMode::Cage,
    FaultMode::Bow,
    FaultMode::Unbalance,
    FaultMode::Misalignment,
    FaultMode::Looseness,
    FaultMode::ToothDamage,
    FaultMode::DistributedWear,
    FaultMode::AbnormalLevel,
];

/// Other words for faults.
const SYNONYMS: [(&str, FaultMode); 2] =
    [("ball", FaultMode::RollingElement), ("gear_tooth_broken", FaultMode::ToothDamage)];

const HEALTHY: &str = "healthy";
const RUN_TO_FAILURE: &str = "run_to_failure";

/// A fault that is there, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KnownFault {
    /// The fault.
    pub fault: FaultMode,
    /// Id of the component; `None`: any of the fault's kind, it is not known which.
    pub component: Option<String>,
}

/// What a record shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Known {
    /// These faults and no others; with none the machine is healthy.
    Faults(Vec<KnownFault>),
    /// It begins healthy and ends failed, of whatever cause.
    RunToFailure,
}

/// What counts as right although the contract calls it something else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acceptable {
    /// This outcome.
    Outcome(Outcome),
    /// This fault on the labelled component.
    Fault(FaultMode),
}

/// What a row is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It is diagnosed and scored.
    Score,
    /// Other rows name it as their baseline; not scored.
    Baseline,
}

/// One row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthRow {
    /// Line of the table.
    pub line: u64,
    /// Capture, relative to the table's folder.
    pub file: String,
    /// Data set: names the machine file.
    pub dataset: String,
    /// Label as written.
    pub label: String,
    /// What the label says.
    pub known: Known,
    /// Size of the damage as written.
    pub severity: String,
    /// Healthy captures to compare with, relative to the table's folder.
    pub baseline: Vec<String>,
    /// Verdicts that count as right.
    pub acceptable: Vec<Acceptable>,
    /// What it is for.
    pub role: Role,
    /// Remarks as written.
    pub notes: String,
}

/// A truth table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthTable {
    /// The rows in their order.
    pub rows: Vec<TruthRow>,
    /// Columns that mean nothing here.
    pub ignored: Vec<String>,
}

/// All mistakes of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthErrors {
    /// Name of the table.
    pub name: String,
    /// Line and what is wrong there.
    pub mistakes: Vec<(u64, String)>,
}

impl fmt::Display for TruthErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (line, mistake)) in self.mistakes.iter().enumerate() {
            let gap = if i == 0 { "" } else { "\n" };
            write!(f, "{gap}{}:{line}: {mistake}", self.name)?;
        }
        Ok(())
    }
}

impl std::error::Error for TruthErrors {}

/// The kind of component a fault belongs to; `None` for sensors, which are not scored.
#[must_use]
pub fn kind_of(fault: FaultMode) -> Option<ComponentKind> {
    match fault {
        FaultMode::InnerRace
        | FaultMode::OuterRace
        | FaultMode::RollingElement
        | FaultMode::Cage => Some(ComponentKind::Bearing),
        FaultMode::Bow | FaultMode::Unbalance | FaultMode::Misalignment | FaultMode::Looseness => {
            Some(ComponentKind::Shaft)
        }
        FaultMode::ToothDamage | FaultMode::DistributedWear => Some(ComponentKind::Gear),
        FaultMode::AbnormalLevel => Some(ComponentKind::Machine),
        FaultMode::Dead
        | FaultMode::Clipped
        | FaultMode::Stuck
        | FaultMode::Spiking
        | FaultMode::Loose
        | FaultMode::Noisy
        | FaultMode::WrongRange => None,
    }
}

fn fault_of(name: &str) -> Option<FaultMode> {
    let synonym = SYNONYMS.iter().find(|(synonym, _)| *synonym == name);
    synonym
        .map(|(_, fault)| *fault)
        .or_else(|| FAULTS.into_iter().find(|fault| fault.name() == name))
}

impl TruthTable {
    /// Reads a table; `name` is what its mistakes call it.
    ///
    /// # Errors
    /// Every mistake with its line.
    pub fn parse(text: &str, name: &str) -> Result<Self, TruthErrors> {
        let mut mistakes = Vec::new();
        let mut lines = lines(text, &mut mistakes).into_iter();
        let fail = |mistakes| Err(TruthErrors { name: name.to_owned(), mistakes });
        let Some((heading_line, heading)) = lines.next() else {
            mistakes.push((1, "the table is empty: its first line names the columns".to_owned()));
            return fail(mistakes);
        };
        let columns = columns(heading_line, &heading, &mut mistakes);
        let ignored = heading.iter().filter(|h| !COLUMNS.contains(&&***h) && **h != UNREAD_COLUMN);
        let ignored = ignored.filter(|h| !h.is_empty()).cloned().collect();
        if !mistakes.is_empty() {
            return fail(mistakes);
        }
        let mut rows = Vec::new();
        for (line, cells) in lines {
            if cells.len() != heading.len() {
                let (n, wanted) = (cells.len(), heading.len());
                mistakes.push((
                    line,
                    format!(
                        "{n} cells, the heading has {wanted}; a cell with a comma needs quotes"
                    ),
                ));
                continue;
            }
            let cell = |column: &str| columns.get(column).map_or("", |at| cells[*at].trim());
            match row(line, &cell) {
                Ok(row) => rows.push(row),
                Err(wrong) => mistakes.extend(wrong.into_iter().map(|text| (line, text))),
            }
        }
        if rows.is_empty() && mistakes.is_empty() {
            mistakes.push((heading_line, "no row follows the heading".to_owned()));
        }
        if mistakes.is_empty() { Ok(Self { rows, ignored }) } else { fail(mistakes) }
    }
}

/// Places of the columns that are read.
fn columns<'h>(
    line: u64,
    heading: &'h [String],
    mistakes: &mut Vec<(u64, String)>,
) -> BTreeMap<&'h str, usize> {
    let mut columns = BTreeMap::new();
    for (at, name) in heading.iter().enumerate() {
        if columns.insert(name.as_str(), at).is_some() && !name.is_empty() {
            mistakes.push((line, format!("two columns are called `{name}`")));
        }
    }
    for name in COLUMNS[..N_REQUIRED].iter().filter(|name| !columns.contains_key(**name)) {
        mistakes.push((line, format!("no column `{name}`; there are {}", heading.join(", "))));
    }
    columns
}

/// One row, or all that is wrong with it.
fn row<'c>(line: u64, cell: &impl Fn(&str) -> &'c str) -> Result<TruthRow, Vec<String>> {
    let mut wrong = Vec::new();
    for name in COLUMNS[..N_REQUIRED].iter().filter(|name| cell(name).is_empty()) {
        wrong.push(format!("`{name}` is empty"));
    }
    let dataset = cell("dataset");
    if dataset.contains(['/', '\\']) || dataset.starts_with('.') {
        wrong.push(format!("dataset `{dataset}` is not the name of a machine file without .toml"));
    }
    let label = cell("label");
    let component = Some(cell("component")).filter(|id| !id.is_empty()).map(str::to_owned);
    let known = match (label, fault_of(label)) {
        (RUN_TO_FAILURE, _) => Known::RunToFailure,
        (_, Some(fault)) => Known::Faults(vec![KnownFault { fault, component }]),
        (name, None) => {
            if name != HEALTHY && !name.is_empty() {
                wrong.push(format!("label `{name}` is not known; {}", labels()));
            }
            Known::Faults(Vec::new())
        }
    };
    let mut acceptable = Vec::new();
    for name in list(cell("acceptable")) {
        match (Outcome::of_name(&name), fault_of(&name)) {
            (Some(outcome), _) => acceptable.push(Acceptable::Outcome(outcome)),
            (None, Some(fault)) => acceptable.push(Acceptable::Fault(fault)),
            (None, None) => wrong.push(format!(
                "acceptable verdict `{name}` is not known; {} or a fault",
                Outcome::ALL.map(Outcome::name).join(", ")
            )),
        }
    }
    let role = match cell("role") {
        "" | "score" => Role::Score,
        "baseline" => Role::Baseline,
        other => {
            wrong.push(format!("role `{other}` is neither score nor baseline"));
            Role::Score
        }
    };
    if !wrong.is_empty() {
        return Err(wrong);
    }
    Ok(TruthRow {
        line,
        file: cell("file").to_owned(),
        dataset: dataset.to_owned(),
        label: label.to_owned(),
        known,
        severity: cell("severity").to_owned(),
        baseline: list(cell("baseline")),
        acceptable,
        role,
        notes: cell("notes").to_owned(),
    })
}

fn labels() -> String {
    let synonyms = SYNONYMS.iter().map(|(name, _)| *name);
    let names: Vec<&str> = [HEALTHY, RUN_TO_FAILURE]
        .into_iter()
        .chain(FAULTS.iter().map(|fault| fault.name()))
        .chain(synonyms)
        .collect();
    format!("known are {}", names.join(", "))
}

fn list(cell: &str) -> Vec<String> {
    cell.split(';').map(str::trim).filter(|part| !part.is_empty()).map(str::to_owned).collect()
}

/// Lines that are not blank, each with its number and cells.
fn lines(text: &str, mistakes: &mut Vec<(u64, String)>) -> Vec<(u64, Vec<String>)> {
    let (mut reader, mut input) = (Reader::new(), text.as_bytes());
    // A line's cells are never longer than the text.
    let (mut bytes, mut ends) = (vec![0; text.len() + 1], vec![0; CELLS_MAX]);
    let (mut n_bytes, mut n_ends) = (0, 0);
    let mut found = Vec::new();
    loop {
        let before = reader.line();
        let (result, n_in, more_bytes, more_ends) =
            reader.read_record(input, &mut bytes[n_bytes..], &mut ends[n_ends..]);
        input = &input[n_in..];
        n_bytes += more_bytes;
        n_ends += more_ends;
        match result {
            // At the end an empty input tells the reader so.
            ReadRecordResult::InputEmpty => {}
            ReadRecordResult::OutputFull | ReadRecordResult::OutputEndsFull => {
                mistakes.push((before, format!("more than {CELLS_MAX} cells")));
                return found;
            }
            ReadRecordResult::End => return found,
            ReadRecordResult::Record => {
                let mut begin = 0;
                let mut cells = Vec::with_capacity(n_ends);
                for end in &ends[..n_ends] {
                    let cell = String::from_utf8_lossy(&bytes[begin..*end]);
                    cells.push(cell.trim().to_owned());
                    begin = *end;
                }
                (n_bytes, n_ends) = (0, 0);
                if cells.iter().any(|cell| !cell.is_empty()) {
                    found.push((line_of_record(text, input, &reader), cells));
                }
            }
        }
    }
}

/// Number of the line that a record just read ends on.
fn line_of_record(text: &str, rest: &[u8], reader: &Reader) -> u64 {
    let read = &text.as_bytes()[..text.len() - rest.len()];
    reader.line() - u64::from(read.last() == Some(&b'\n'))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADING: &str =
        "file,dataset,label,severity,shaft_speed_hz,component,baseline,acceptable,role,notes\n";

    fn parse(rows: &str) -> Result<TruthTable, String> {
        TruthTable::parse(&format!("{HEADING}{rows}"), "t.csv").map_err(|e| e.to_string())
    }

    #[test]
    fn a_row_says_what_its_cells_say() {
        let text = "a/x.h5,rig,ball,\"0.007 in, small\",29.9,de,a/h.h5; a/i.h5,undetermined;outer_race,score,\"say \"\"hi\"\",\nthen\"\n\
                    b.h5,rig,healthy,,,,,,baseline,\r\n\n\
                    c.h5,rig,run_to_failure,,,,,,,\n";
        let table = parse(text).unwrap();
        let [ball, healthy, life] = &table.rows[..] else { panic!("{table:?}") };
        assert_eq!((ball.file.as_str(), ball.severity.as_str()), ("a/x.h5", "0.007 in, small"));
        assert_eq!(ball.notes, "say \"hi\",\nthen");
        let fault =
            KnownFault { fault: FaultMode::RollingElement, component: Some("de".to_owned()) };
        assert_eq!(ball.known, Known::Faults(vec![fault]));
        assert_eq!(ball.baseline, ["a/h.h5", "a/i.h5"]);
        assert_eq!(
            ball.acceptable,
            [Acceptable::Outcome(Outcome::Undetermined), Acceptable::Fault(FaultMode::OuterRace)]
        );
        assert_eq!((healthy.role, &healthy.known), (Role::Baseline, &Known::Faults(Vec::new())));
        assert_eq!((life.role, &life.known, life.line), (Role::Score, &Known::RunToFailure, 6));
        assert_eq!(table.ignored, Vec::<String>::new());
    }

    #[test]
    fn every_label_is_read_and_every_mistake_told_at_its_line() {
        for fault in FAULTS {
            let row = format!("x.h5,rig,{},,,,,,,\n", fault.name());
            let fault = KnownFault { fault, component: None };
            assert_eq!(parse(&row).unwrap().rows[0].known, Known::Faults(vec![fault]));
            assert!(kind_of(fault_of(&parse(&row).unwrap().rows[0].label).unwrap()).is_some());
        }
        let told = parse("x,rig,rust,,,,,maybe,judge,\ny,rig,dead,,,,,,,\nz,rig\n,../a,,,,,,,,\n");
        let told = told.unwrap_err();
        for part in [
            "t.csv:2: label `rust` is not known; known are healthy,",
            "t.csv:2: acceptable verdict `maybe` is not known; right, detected,",
            "t.csv:2: role `judge` is neither",
            "t.csv:3: label `dead` is not known",
            "t.csv:4: 2 cells, the heading has 10; a cell with a comma needs quotes",
            "t.csv:5: `file` is empty",
            "t.csv:5: `label` is empty",
            "t.csv:5: dataset `../a` is not the name",
        ] {
            assert!(told.contains(part), "{part}\nnot in\n{told}");
        }
    }

    #[test]
    fn columns_that_lack_or_are_doubled_are_told_and_unknown_ones_passed_over() {
        let told = |text: &str| TruthTable::parse(text, "t").unwrap_err().to_string();
        assert_eq!(told(""), "t:1: the table is empty: its first line names the columns");
        assert_eq!(
            told("file,label\nx,healthy\n"),
            "t:1: no column `dataset`; there are file, label"
        );
        assert!(told("file,dataset,label,file\n").contains("two columns are called `file`"));
        assert_eq!(told("file,dataset,label\n"), "t:1: no row follows the heading");
        let table =
            TruthTable::parse("\u{feff}file,dataset,label,colour\nx,d,bow,red", "t").unwrap();
        assert_eq!((table.rows.len(), table.ignored), (1, vec!["colour".to_owned()]));
    }
}
