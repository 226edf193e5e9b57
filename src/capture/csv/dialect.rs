//! How a text is written: separator, decimal comma, where its table begins, what stands above it.
//!
//! Guessed from the first lines, by counting; every guess is shown ([`Dialect::describe`]).

use super::cell::Shape;
use super::commas;
use super::heading::{Heading, unit_of};
use super::records::cells_of;

/// Lines before the table at most.
pub(super) const HEADER_LINES_MAX: usize = 1000;

/// Lines of the table that are looked at.
const TABLE_LINES: usize = 200;

/// Of those, the last, which tell the number of columns.
const COUNTED_LINES: usize = 100;

/// Separators, the more likely first.
const SEPARATORS: [u8; 4] = [b',', b';', b'\t', b' '];

/// How a text is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dialect {
    pub(super) separator: u8,
    pub(super) decimal_comma: bool,
    /// Byte at which the table's first line begins, and the line's number.
    pub(super) table_at: u64,
    pub(super) table_line: u64,
    pub(super) n_columns: usize,
    /// Line of the names.
    pub(super) header_line: Option<u64>,
    /// Line of the units, if they have one of their own.
    pub(super) units_line: Option<u64>,
    /// A heading for each column; empty ones without a header.
    pub(super) headings: Vec<Heading>,
    /// Whether it begins with a byte-order mark.
    pub(super) marked: bool,
    /// Whether it is no UTF-8, and taken for Latin-1.
    pub(super) latin_1: bool,
    /// The first lines of the table, cell by cell.
    pub(super) first_rows: Vec<Vec<Vec<u8>>>,
    /// Why the numbers cannot be told for sure, and the line that shows it.
    pub(super) doubt: Option<(u64, &'static str)>,
}

/// A line of the head.
struct Line<'a> {
    number: u64,
    at: u64,
    text: &'a [u8],
}

/// A separator tried out.
struct Trial {
    separator: u8,
    /// Cells of each line.
    rows: Vec<Vec<Vec<u8>>>,
    n_columns: usize,
    /// Whether each column holds numbers or times.
    is_value: Vec<bool>,
    /// Part of the cells that do.
    score: f64,
}

/// Guesses from the beginning of a text; `whole`: there is no more. `None`: no table of numbers.
pub(super) fn guess(head: &[u8], whole: bool) -> Option<Dialect> {
    let marked = head.starts_with(b"\xef\xbb\xbf");
    let lines = lines_of(head, if marked { 3 } else { 0 }, whole);
    let mut best: Option<Trial> = None;
    for separator in SEPARATORS {
        let Some(trial) = Trial::new(&lines, separator) else { continue };
        let rank = |t: &Trial| (t.score, t.n_columns);
        if best.as_ref().is_none_or(|known| rank(&trial) > rank(known)) {
            best = Some(trial);
        }
    }
    let mut trial = best?;
    let mut first = trial.first_row()?;
    if trial.separator == b',' && trial.n_columns == 2 {
        let is_titled = first > 0 && trial.rows[first - 1].len() == 1;
        if commas::are_decimal(&trial.rows[first..], is_titled) {
            trial = Trial::new(&lines, b';')?;
            first = trial.first_row()?;
        }
    }
    let doubt = doubt(&lines, &trial, first);
    let shapes = || trial.rows[first..].iter().filter(|row| row.len() == trial.n_columns).flatten();
    let count = |shape| shapes().filter(|cell| Shape::of(cell) == shape).count();
    let decimal_comma = trial.separator != b',' && count(Shape::Comma) > count(Shape::Point);
    let latin_1 = lines.iter().any(|line| std::str::from_utf8(line.text).is_err());
    let (headings, header, units) = trial.headings(first, latin_1);
    let number = |row: Option<usize>| row.map(|row| lines[row].number);
    Some(Dialect {
        separator: trial.separator,
        decimal_comma,
        table_at: lines[first].at,
        table_line: lines[first].number,
        n_columns: trial.n_columns,
        header_line: number(header),
        units_line: number(units),
        headings,
        marked,
        latin_1,
        first_rows: trial.rows.split_off(first),
        doubt,
    })
}

/// Why the commas of a table cannot be told for sure, and the line that shows it.
fn doubt(lines: &[Line<'_>], trial: &Trial, first: usize) -> Option<(u64, &'static str)> {
    let counted = &lines[lines.len().saturating_sub(COUNTED_LINES)..];
    let texts: Vec<&[u8]> = counted.iter().map(|line| line.text).collect();
    if let Some(at) = commas::thousands(&texts) {
        let problem = "a number whose thousands are set apart; export without thousands separators";
        return Some((counted[at].number, problem));
    }
    let n_names = first.checked_sub(1).map_or(0, |above| trial.rows[above].len());
    let in_both = trial.separator == b',' && commas::are_both(&trial.rows[first..], n_names);
    let problem = "twice as many cells as names, as if commas stood between the cells and inside the numbers; \
                   export with semicolons, or with decimal points";
    in_both.then_some((lines[first].number, problem))
}

/// The lines that are not blank; the last one only if it is complete.
fn lines_of(head: &[u8], skip: usize, whole: bool) -> Vec<Line<'_>> {
    let mut lines = Vec::new();
    let (mut at, mut number) = (skip, 1);
    while at < head.len() && lines.len() < HEADER_LINES_MAX + TABLE_LINES {
        let end = head[at..].iter().position(|&byte| byte == b'\n').map(|n| at + n);
        if end.is_none() && !whole {
            break;
        }
        let text = &head[at..end.unwrap_or(head.len())];
        if !text.trim_ascii().is_empty() {
            lines.push(Line { number, at: at as u64, text });
        }
        number += 1;
        at = end.map_or(head.len(), |end| end + 1);
    }
    lines
}

impl Trial {
    /// Splits every line; `None` if no column holds numbers.
    fn new(lines: &[Line<'_>], separator: u8) -> Option<Self> {
        let rows: Vec<Vec<Vec<u8>>> =
            lines.iter().map(|line| cells_of(line.text, separator).unwrap_or_default()).collect();
        let counted = &rows[rows.len().saturating_sub(COUNTED_LINES)..];
        let n_columns = most_frequent(counted.iter().map(Vec::len))?;
        let fitting: Vec<Vec<Shape>> = counted
            .iter()
            .filter(|row| row.len() == n_columns)
            .map(|row| row.iter().map(|cell| shape(cell, separator)).collect())
            .collect();
        let is_value: Vec<bool> = (0..n_columns)
            .map(|column| {
                let n_values = fitting.iter().filter(|row| row[column].is_value()).count();
                let n_texts = fitting.iter().filter(|row| row[column] == Shape::Text).count();
                n_values > n_texts
            })
            .collect();
        let n_values = fitting.iter().flatten().filter(|shape| shape.is_value()).count();
        let n_cells = counted.iter().flatten().filter(|cell| !cell.is_empty()).count();
        let some = is_value.contains(&true) && 2 * fitting.len() > counted.len();
        let score = n_values as f64 / n_cells.max(1) as f64;
        some.then_some(Self { separator, rows, n_columns, is_value, score })
    }

    /// The first line of the table: numbers wherever the table has them, and a like one below.
    fn first_row(&self) -> Option<usize> {
        let fits = |row: &Vec<Vec<u8>>| {
            let shapes = row.iter().map(|cell| shape(cell, self.separator)).zip(&self.is_value);
            row.len() == self.n_columns
                && shapes.clone().all(|(s, value)| !value || s.is_value() || s == Shape::Empty)
                && shapes.clone().any(|(s, value)| *value && s.is_value())
        };
        (0..self.rows.len().saturating_sub(1))
            .take(HEADER_LINES_MAX + 1)
            .filter(|&at| !is_numbered(&self.rows[at]))
            .find(|&at| fits(&self.rows[at]) && self.rows[at + 1].len() == self.n_columns)
    }

    /// Names and units above row `first`, and the rows they stand in.
    fn headings(
        &self,
        first: usize,
        latin_1: bool,
    ) -> (Vec<Heading>, Option<usize>, Option<usize>) {
        let none = vec![Heading::default(); self.n_columns];
        let above = |distance: usize| {
            let row = first.checked_sub(distance)?;
            Some((row, self.texts_of(row, latin_1)?))
        };
        let Some((row, texts)) = above(1) else { return (none, None, None) };
        let is_unit = |text: &&String| text.is_empty() || unit_of(text).is_some();
        let named = above(2).filter(|_| texts.iter().all(|text| is_unit(&text)));
        let Some((names_row, names)) = named else {
            return (texts.iter().map(|text| Heading::parse(text)).collect(), Some(row), None);
        };
        let with_unit = |(name, unit): (&String, &String)| {
            let heading = Heading::parse(name);
            Heading { unit: unit_of(unit).or(heading.unit.clone()), ..heading }
        };
        (names.iter().zip(&texts).map(with_unit).collect(), Some(names_row), Some(row))
    }

    /// The cells of a row if it may be a header: as many as the table has, and no number.
    fn texts_of(&self, row: usize, latin_1: bool) -> Option<Vec<String>> {
        let mut cells = self.rows[row].clone();
        let mark = cells.first().and_then(|cell| cell.first()).copied();
        if matches!(mark, Some(b'#' | b'%')) {
            cells[0].remove(0); // As numpy writes it; a lone mark is a cell of its own.
            if cells[0].trim_ascii().is_empty() && cells.len() > self.n_columns {
                cells.remove(0);
            }
        }
        // A separator at the end of each line of the table, but not of the header.
        if cells.len() + 1 == self.n_columns && !self.is_value.last().copied().unwrap_or(true) {
            cells.push(Vec::new());
        }
        let fits = cells.len() == self.n_columns
            && cells.iter().any(|cell| !cell.is_empty())
            && (is_numbered(&cells)
                || cells.iter().all(|cell| !shape(cell.trim_ascii(), self.separator).is_value()));
        fits.then(|| cells.iter().map(|cell| text_of(cell, latin_1)).collect())
    }
}

/// Whether a row is a header that numbers the columns behind an unnamed one, as pandas writes it.
fn is_numbered(cells: &[Vec<u8>]) -> bool {
    let Some((first, others)) = cells.split_first() else { return false };
    let counts = |(at, cell): (usize, &Vec<u8>)| *cell == at.to_string().into_bytes();
    first.is_empty() && !others.is_empty() && others.iter().enumerate().all(counts)
}

/// The shape of a cell, a comma counting as part of a number only where it does not separate.
fn shape(cell: &[u8], separator: u8) -> Shape {
    let shape = Shape::of(cell);
    if shape == Shape::Comma && separator == b',' { Shape::Text } else { shape }
}

fn most_frequent(counts: impl Iterator<Item = usize>) -> Option<usize> {
    let mut seen = std::collections::BTreeMap::new();
    counts.for_each(|count| *seen.entry(count).or_insert(0_usize) += 1);
    seen.into_iter().filter(|(count, _)| *count > 0).max_by_key(|(_, n)| *n).map(|(count, _)| count)
}

fn text_of(cell: &[u8], latin_1: bool) -> String {
    let text: String = if latin_1 {
        cell.iter().map(|&byte| char::from(byte)).collect()
    } else {
        String::from_utf8_lossy(cell).into_owned()
    };
    text.trim().to_owned()
}

impl Dialect {
    /// What was guessed, for people.
    pub(super) fn describe(&self) -> Vec<String> {
        let separator = match self.separator {
            _ if self.n_columns == 1 => "one column".to_owned(),
            b'\t' => "separator tab".to_owned(),
            b' ' => "separated by blanks".to_owned(),
            other => format!("separator '{}'", char::from(other)),
        };
        let decimal = if self.decimal_comma { "decimal comma" } else { "decimal point" };
        let header = match (self.header_line, self.units_line) {
            (Some(names), Some(units)) => format!("header in line {names}, units in line {units}"),
            (Some(names), None) => format!("header in line {names}"),
            (None, _) => format!("no header, table from line {}", self.table_line),
        };
        let mut guessed = vec![separator, decimal.to_owned(), header];
        if self.latin_1 {
            guessed.push("Latin-1".to_owned());
        }
        guessed
    }
}
