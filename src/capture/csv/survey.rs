//! The first pass: counts the rows, checks every line, reads the times. Memory does not grow with
//! the file.

use super::super::error::CaptureError;
use super::cell;
use super::columns::{TimeColumn, is_one};
use super::dialect::Dialect;
use super::records::{COLUMNS_MAX, LINE_BYTES_MAX, RecordError, Records};
use super::times::{Clock, TimeFault, Timed, Timeline};
use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::Path;

/// Bytes fetched at once.
const BUFFER_BYTES: usize = 256 << 10;

/// Characters of a cell shown in a message at most.
const SHOWN_CHARS: usize = 40;

/// What the first pass found.
#[derive(Debug, Default)]
pub(super) struct Survey {
    pub(super) n_rows: u64,
    pub(super) columns: Vec<ColumnSurvey>,
    /// The outcome for the times, if there is a column of them.
    pub(super) timed: Option<Result<Timed, TimeFault>>,
    /// Nanoseconds since 1970 of the first row.
    pub(super) start_ns: Option<i64>,
    /// Number of a last line that ends in its middle, and is not used.
    pub(super) cut_line: Option<u64>,
    /// Whether the first column counts the rows.
    pub(super) counts_rows: bool,
}

/// Cells of one column that hold no number.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct ColumnSurvey {
    pub(super) n_not_numbers: u64,
    pub(super) n_empty: u64,
    /// The first: line, and what stands there.
    pub(super) first: Option<(u64, String)>,
}

/// Opens a text at its table.
pub(super) fn records(
    path: &Path,
    dialect: &Dialect,
) -> Result<Records<BufReader<File>>, CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "read it", source };
    let mut file = File::open(path).map_err(io)?;
    file.seek(SeekFrom::Start(dialect.table_at)).map_err(io)?;
    let input = BufReader::with_capacity(BUFFER_BYTES, file);
    Ok(Records::new(input, dialect.separator, dialect.table_line))
}

/// The error of a line that cannot be taken apart.
pub(super) fn record_error(path: &Path, error: RecordError) -> CaptureError {
    let line = |line, problem| CaptureError::Line { file: path.into(), line, problem };
    match error {
        RecordError::Io(source) => {
            CaptureError::Io { file: path.into(), action: "read it", source }
        }
        RecordError::TooLong(at) => line(
            at,
            format!(
                "more than {LINE_BYTES_MAX} bytes up to here in one line; is a quotation mark open?"
            ),
        ),
        RecordError::TooWide(at) => {
            line(at, format!("more than {COLUMNS_MAX} cells in one line; split the table"))
        }
    }
}

/// Reads the whole table once.
pub(super) fn survey(
    path: &Path,
    dialect: &Dialect,
    time: Option<TimeColumn>,
    ends_with_line: bool,
) -> Result<Survey, CaptureError> {
    let mut records = records(path, dialect)?;
    let mut found = Survey {
        columns: vec![ColumnSurvey::default(); dialect.n_columns],
        counts_rows: true,
        ..Survey::default()
    };
    let mut times = time.map(|time| Times::new(time, dialect));
    let mut last_count = None;
    while records.advance().map_err(|error| record_error(path, error))? {
        let line = records.line();
        if records.len() != dialect.n_columns {
            let n_cells = records.len();
            let more = records.advance().map_err(|error| record_error(path, error))?;
            if more || ends_with_line {
                return Err(wrong_width(path, line, n_cells, dialect.n_columns));
            }
            found.cut_line = Some(line);
            break;
        }
        for (at, column) in found.columns.iter_mut().enumerate() {
            if time.is_some_and(|time| time.column == at) {
                continue;
            }
            let cell = records.cell(at);
            match cell::number(cell, dialect.decimal_comma) {
                Some(value) if at == 0 && found.counts_rows => {
                    found.counts_rows = last_count.is_none_or(|last| is_one(value - last));
                    last_count = Some(value);
                }
                Some(_) => {}
                None => column.note(line, cell),
            }
        }
        if let Some(times) = &mut times {
            times.take(records.cell(times.column), line);
        }
        found.n_rows += 1;
    }
    found.counts_rows &= last_count.is_some();
    if let Some(times) = times {
        found.start_ns = times.clock.start_ns();
        found.timed = Some(times.finish());
    }
    Ok(found)
}

impl ColumnSurvey {
    fn note(&mut self, line: u64, cell: &[u8]) {
        self.n_not_numbers += 1;
        self.n_empty += u64::from(cell.is_empty());
        if self.first.is_none() {
            self.first = Some((line, shown(cell)));
        }
    }
}

/// The times, up to the first fault in them.
struct Times {
    column: usize,
    clock: Clock,
    line: Timeline,
    fault: Option<TimeFault>,
}

impl Times {
    fn new(time: TimeColumn, dialect: &Dialect) -> Self {
        let clock = Clock::new(time.kind, dialect.decimal_comma);
        Self { column: time.column, clock, line: Timeline::default(), fault: None }
    }

    fn take(&mut self, cell: &[u8], line: u64) {
        if self.fault.is_some() {
            return;
        }
        let placed = match self.clock.read(cell, line) {
            Some(row) => self.line.push(row),
            None => {
                let problem = format!("\"{}\" in the time column is no time", shown(cell));
                Err(TimeFault { line: Some(line), problem })
            }
        };
        self.fault = placed.err();
    }

    fn finish(self) -> Result<Timed, TimeFault> {
        match self.fault {
            Some(fault) => Err(fault),
            None => self.line.finish(),
        }
    }
}

fn wrong_width(path: &Path, line: u64, found: usize, expected: usize) -> CaptureError {
    let cells = if found == 1 { "cell" } else { "cells" };
    let problem = format!(
        "{found} {cells} where the table has {expected}; take the line out, or complete it"
    );
    CaptureError::Line { file: path.into(), line, problem }
}

fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(cell);
    text.chars().filter(|c| !c.is_control()).take(SHOWN_CHARS).collect()
}
