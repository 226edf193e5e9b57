//! CSV: tables of numbers as text, in whatever dialect loggers write them.
//!
//! Two passes, both in bounded memory: [`survey`] checks every line, counts the rows and finds the
//! rate; [`rows`] hands the numbers on. What is guessed about the text is in the notes of
//! [`CaptureInfo`]. Must not know segments' use or blocks.

mod records;
mod commas;
mod cell;
mod heading;
mod times;
mod dialect;
mod columns;
mod survey;
mod rows;

#[cfg(test)]
mod tests;

use super::error::CaptureError;
use super::hints::Hints;
use super::info::{CaptureInfo, CaptureKind, ChannelDescription};
use super::open::Opened;
use super::received::{NumberType, RawSamples};
use super::rows::{Column, Source};
use super::segments::Segments;
use super::since_1970;
use super::table::{self, Choice, Chosen, Facts, Offered, RATE_RANGE_HZ, table_error};
use crate::machine::Machine;
use crate::signal::{ChannelIndex, Timestamp};
use crate::units::Hz;
use columns::TimeColumn;
use dialect::Dialect;
use rows::CsvRows;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use survey::{ColumnSurvey, Survey};
use times::{TimeFault, TimeKind, Timed};

/// Bytes at the beginning from which the dialect is guessed.
const HEAD_BYTES: usize = 1 << 20;

/// One cell in so many may hold no number; with more, a column is refused.
const GOOD_FOR_ONE_BAD: u64 = 1000;

/// Cells without a number that are always allowed.
const BAD_CELLS_ALLOWED: u64 = 3;

/// Whether a text begins with, or is, a table of numbers; `whole`: there is no more of it.
pub(super) fn is_table(head: &[u8], whole: bool) -> bool {
    dialect::guess(head, whole).is_some()
}

/// Opens a text and checks all of it.
pub(super) fn open(
    path: &Path,
    machine: Option<&Machine>,
    hints: &Hints,
) -> Result<Opened, CaptureError> {
    let beginning = Beginning::read(path).map_err(|source| CaptureError::Io {
        file: path.into(),
        action: "read it",
        source,
    })?;
    let guessed = dialect::guess(&beginning.head, beginning.whole);
    let has = |byte| beginning.head.contains(&byte);
    if guessed.is_none() && has(b'\r') && !has(b'\n') {
        let problem = "its lines end with a carriage return alone; convert it, e.g. tr '\\r' '\\n' < in.csv > out.csv";
        return Err(table_error(path, problem.to_owned()));
    }
    let Some(dialect) = guessed else {
        let problem = format!(
            "text without a table of numbers in its first {} lines; a CSV has a line a sample, a column a channel \
             (docs/captures.md)",
            dialect::HEADER_LINES_MAX
        );
        return Err(table_error(path, problem));
    };
    if let Some((line, problem)) = dialect.doubt {
        return Err(CaptureError::Line { file: path.into(), line, problem: problem.to_owned() });
    }
    let table = Table { path, machine, hints, dialect, file_bytes: beginning.file_bytes };
    table.open(beginning.ends_with_line)
}

/// The first bytes of a text, and how it ends.
struct Beginning {
    head: Vec<u8>,
    whole: bool,
    file_bytes: u64,
    ends_with_line: bool,
}

impl Beginning {
    fn read(path: &Path) -> std::io::Result<Self> {
        let mut file = File::open(path)?;
        let file_bytes = file.metadata()?.len();
        let mut head = Vec::new();
        (&mut file).take(HEAD_BYTES as u64).read_to_end(&mut head)?;
        let mut last = [0];
        file.seek(SeekFrom::Start(file_bytes.saturating_sub(1)))?;
        let n_read = file.read(&mut last)?;
        let ends_with_line = n_read == 1 && last[0] == b'\n';
        Ok(Self { whole: head.len() < HEAD_BYTES, head, file_bytes, ends_with_line })
    }
}

/// A text whose dialect is known.
struct Table<'a> {
    path: &'a Path,
    machine: Option<&'a Machine>,
    hints: &'a Hints,
    dialect: Dialect,
    file_bytes: u64,
}

impl Table<'_> {
    fn open(self, ends_with_line: bool) -> Result<Opened, CaptureError> {
        let guessed = columns::time_column(&self.dialect);
        let offered = columns::offered(&self.dialect, guessed.map(|time| time.column));
        let map = table::map_of(self.path, self.machine, self.hints)?;
        let named = |name: &str| {
            let path = format!("/{name}");
            map.as_ref().is_none_or(|map| map.values().any(|entry| entry.path == path))
        };
        if let Some(name) = columns::doubled(&offered).filter(|name| named(name)) {
            let line = self.dialect.header_line.unwrap_or(self.dialect.table_line);
            let problem = format!(
                "two columns are called \"{name}\"; rename one, or number them: --map 'NAME=/,column=K' from 0"
            );
            return Err(self.line_error(line, problem));
        }
        let choice = map.map(|map| table::choose(self.path, &map, &offered)).transpose()?;
        let time = self.time(guessed, choice.as_ref(), &offered)?;
        let survey = survey::survey(self.path, &self.dialect, time, ends_with_line)?;
        let mut notes = vec![self.guessed(time)];
        let (choice, ignored) = self.select(choice, &offered, time, &survey)?;
        let (rate, starts) = self.rate(&choice, &offered, &survey, &mut notes)?;
        if let Some(line) = survey.cut_line {
            notes.push(format!("line {line}, the last, is cut in its middle and not used"));
        }
        let timed = survey.timed.as_ref().is_some_and(Result::is_ok);
        let told = table::told_rate(&choice, self.hints).map(|(rate, _)| rate);
        let options = table::options(told.filter(|_| !timed), &choice.channels, &offered);
        let (channels, source) = self.source(&choice.channels, rate, survey.n_rows)?;
        let segments = self.segments(rate, &starts, survey.n_rows)?;
        let listed = segments.len() > 1;
        let (last_row, last_s) = starts.last().copied().unwrap_or((0, 0.0));
        let info = CaptureInfo {
            file: self.path.into(),
            file_bytes: self.file_bytes,
            is_mapped: false,
            format_stated: false,
            start_time: survey.start_ns.map(Timestamp),
            machine: None,
            shaft_speed: None,
            load: None,
            segments: listed.then(|| segments.len()),
            duration_s: last_s + survey.n_rows.saturating_sub(last_row) as f64 / rate.0,
            absent_channels: table::absent(self.machine, &channels),
            channels,
            other_attributes: Vec::new(),
            ignored,
            kind: CaptureKind::Csv,
            notes,
            options: Some(options),
        };
        Ok(Opened { info, sources: vec![source], segments })
    }

    /// What was guessed, in one line.
    fn guessed(&self, time: Option<TimeColumn>) -> String {
        let mut guessed = self.dialect.describe();
        guessed.push(match time {
            None => "no time column".to_owned(),
            Some(TimeColumn { column, kind }) => {
                let place = format!("time in column {} of {}", column + 1, self.dialect.n_columns);
                let written = &self.dialect.headings[column].written;
                let place =
                    if written.is_empty() { place } else { format!("{place} (\"{written}\")") };
                match kind {
                    TimeKind::Number { unit_s } => format!("{place}, unit {unit_s} s"),
                    TimeKind::Since1970 { unit_ns } => {
                        format!("{place}, {} since 1970", since_1970::name(unit_ns))
                    }
                    TimeKind::Instant => format!("{place}, dates, UTC where no zone stands"),
                    TimeKind::OfDay => format!("{place}, times of day"),
                }
            }
        });
        format!("guessed: {}", guessed.join(", "))
    }

    /// The column of times: the map's, else the one guessed.
    fn time(
        &self,
        guessed: Option<TimeColumn>,
        choice: Option<&Choice>,
        offered: &[Offered],
    ) -> Result<Option<TimeColumn>, CaptureError> {
        let Some(choice) = choice else { return Ok(guessed) };
        let Some(column) = choice.time else {
            // A column that is mapped as a channel is none of times.
            let is_mapped =
                |time: &TimeColumn| choice.channels.iter().any(|c| c.column == time.column);
            return Ok(guessed.filter(|time| !is_mapped(time)));
        };
        let unit_s = self.dialect.headings[column].time_unit_s().unwrap_or(1.0);
        let found = columns::of_kind(&self.dialect, column, unit_s);
        let name = offered.iter().find(|o| o.column == column).map_or("", |o| &o.name);
        let problem = || format!("time=/{name}: the first cells of that column are no times");
        Ok(Some(found.ok_or_else(|| table_error(self.path, problem()))?))
    }

    /// The channels: the mapped ones, else every column of numbers but the times.
    fn select(
        &self,
        choice: Option<Choice>,
        offered: &[Offered],
        time: Option<TimeColumn>,
        survey: &Survey,
    ) -> Result<(Choice, Vec<String>), CaptureError> {
        let allowed = BAD_CELLS_ALLOWED.max(survey.n_rows / GOOD_FOR_ONE_BAD);
        if let Some(choice) = choice {
            for channel in &choice.channels {
                let column = &survey.columns[channel.column];
                if column.n_not_numbers > allowed || column.n_not_numbers == survey.n_rows {
                    return Err(self.not_numbers(&channel.name, column, survey.n_rows));
                }
            }
            return Ok((choice, Vec::new()));
        }
        let (mut choice, mut ignored) = (Choice::default(), Vec::new());
        for o in offered.iter().filter(|o| time.is_none_or(|time| time.column != o.column)) {
            let column = &survey.columns[o.column];
            let bad = column.n_not_numbers;
            let has_numbers = 2 * bad <= survey.n_rows && bad < survey.n_rows;
            if o.column == 0 && survey.counts_rows && offered.len() > 1 {
                ignored.push(format!("{} (counts the rows)", o.name));
            } else if bad <= allowed && bad < survey.n_rows {
                choice.channels.push(Chosen {
                    name: o.name.clone(),
                    column: o.column,
                    unit: o.unit.clone(),
                    scale: None,
                    offset: None,
                });
            } else if has_numbers && columns::has_numbers(&self.dialect, o.column) {
                return Err(self.not_numbers(&o.name, column, survey.n_rows));
            } else if !(o.heading.is_empty() && column.n_empty == survey.n_rows) {
                let n_rows = survey.n_rows;
                ignored.push(format!("{} ({bad} of {n_rows} cells hold no number)", o.name));
            }
        }
        if choice.channels.is_empty() {
            return Err(table_error(self.path, "no column of numbers beside the times".into()));
        }
        choice.channels.sort_by(|a, b| a.name.cmp(&b.name));
        Ok((choice, ignored))
    }

    /// The error of a column of which too many cells hold no number.
    fn not_numbers(&self, name: &str, column: &ColumnSurvey, n_rows: u64) -> CaptureError {
        let (line, text) = column.first.clone().unwrap_or((self.dialect.table_line, String::new()));
        let decimal = if self.dialect.decimal_comma { "comma" } else { "point" };
        let problem = format!(
            "column {name}: {} of {n_rows} cells hold no number with decimal {decimal}, here \"{text}\"; repair the \
             file, or name only the other columns with --map",
            column.n_not_numbers
        );
        self.line_error(line, problem)
    }

    /// Rate and starts of the segments: those told win over those of the time column.
    fn rate(
        &self,
        choice: &Choice,
        offered: &[Offered],
        survey: &Survey,
        notes: &mut Vec<String>,
    ) -> Result<(Hz, Vec<(u64, f64)>), CaptureError> {
        let told = table::told_rate(choice, self.hints);
        match (&survey.timed, told) {
            (None, None) => {
                let names: Vec<&str> = choice.channels.iter().map(|c| c.name.as_str()).collect();
                Err(CaptureError::NoRate {
                    file: self.path.into(),
                    guessed: notes.join("; "),
                    channels: format!("{} rows of {}", survey.n_rows, names.join(", ")),
                    options: table::options(None, &choice.channels, offered),
                })
            }
            (None, Some((rate, _))) => Ok((rate, vec![(0, 0.0)])),
            (Some(Ok(timed)), None) => {
                notes.extend(table::slow(timed.rate));
                self.in_range(timed)
            }
            (Some(Ok(timed)), Some((rate, origin))) => {
                let Timed { rate: found, starts } = timed;
                if !table::agree(*found, rate) {
                    notes.push(format!(
                        "the time column says {} Hz, {origin} {} Hz: the latter is used",
                        found.0, rate.0
                    ));
                }
                let scale = found.0 / rate.0;
                let starts = starts.iter().map(|&(row, time_s)| (row, time_s * scale));
                Ok((rate, starts.collect()))
            }
            (Some(Err(fault)), None) => {
                let TimeFault { line, problem } = fault;
                let problem = format!("{problem}; with --rate HZ the times are passed over");
                Err(match line {
                    Some(line) => self.line_error(*line, problem),
                    None => table_error(self.path, problem),
                })
            }
            (Some(Err(fault)), Some((rate, origin))) => {
                let line = fault.line.map_or(String::new(), |line| format!("line {line}: "));
                let why = &fault.problem;
                notes.push(format!("times passed over ({line}{why}): {origin} gives the rate"));
                Ok((rate, vec![(0, 0.0)]))
            }
        }
    }

    fn in_range(&self, timed: &Timed) -> Result<(Hz, Vec<(u64, f64)>), CaptureError> {
        let (low, high) = RATE_RANGE_HZ;
        if (low..=high).contains(&timed.rate.0) {
            return Ok((timed.rate, timed.starts.clone()));
        }
        let rate = timed.rate.0;
        let problem = format!(
            "the time column says {rate} samples a second, allowed: {low} to {high}; give --rate HZ"
        );
        Err(table_error(self.path, problem))
    }

    fn segments(
        &self,
        rate: Hz,
        starts: &[(u64, f64)],
        n_rows: u64,
    ) -> Result<Segments, CaptureError> {
        if starts.len() <= 1 {
            return Ok(Segments::one(rate));
        }
        let rows: Vec<i64> =
            starts.iter().map(|&(row, _)| i64::try_from(row).unwrap_or(i64::MAX)).collect();
        let times_s = starts.iter().map(|&(_, time_s)| time_s).collect();
        Segments::new(&rows, times_s, rate, n_rows)
            .map_err(|problem| table_error(self.path, problem))
    }

    fn source(
        &self,
        chosen: &[Chosen],
        rate: Hz,
        n_rows: u64,
    ) -> Result<(Vec<ChannelDescription>, Source), CaptureError> {
        let (mut channels, mut columns) = (Vec::<ChannelDescription>::new(), Vec::<Column>::new());
        for (at, channel) in chosen.iter().enumerate() {
            let facts = Facts {
                path: self.path,
                machine: self.machine,
                hints: self.hints,
                kind: NumberType::F64,
                scale: 1.0,
                ends: None,
                rate,
                n_samples: n_rows,
                storage: format!("text, column {}", channel.column + 1),
            };
            let first = self.first_numbers(channel.column);
            let (described, column) = facts.describe(channel, ChannelIndex(at), Some(&first))?;
            channels.push(described);
            columns.push(column);
        }
        let rows = CsvRows::new(
            self.path,
            self.dialect.clone(),
            chosen.iter().map(|channel| channel.column).collect(),
        );
        let source = Source {
            file: self.path.into(),
            object: "the table".into(),
            rows: Box::new(rows),
            columns,
            length: n_rows,
            rate,
            chunk: 1,
            width: self.dialect.n_columns as u64,
        };
        Ok((channels, source))
    }

    fn first_numbers(&self, column: usize) -> RawSamples {
        let cells = self.dialect.first_rows.iter().filter_map(|row| row.get(column));
        let number = |cell: &Vec<u8>| cell::number(cell, self.dialect.decimal_comma);
        RawSamples::F64(cells.filter_map(number).collect())
    }

    fn line_error(&self, line: u64, problem: String) -> CaptureError {
        CaptureError::Line { file: self.path.into(), line, problem }
    }
}
