//! What each column of a table is: a channel to be, the times, or neither.

use super::super::since_1970;
use super::super::table::Offered;
use super::cell::{self, Shape};
use super::dialect::Dialect;
use super::times::{self, Clock, TimeKind, Timeline};

/// A column of times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TimeColumn {
    pub(super) column: usize,
    pub(super) kind: TimeKind,
}

/// Finds the times: by name; else a column of dates; else, without a header, a first column that
/// rises uniformly, but not by ones, for that counts the rows.
pub(super) fn time_column(dialect: &Dialect) -> Option<TimeColumn> {
    let named = |column: usize| {
        let unit_s = dialect.headings[column].time_unit_s()?;
        let is_doubtful = dialect.headings[column].name == "T"; // or a temperature
        let found = of_kind(dialect, column, unit_s)?;
        (!is_doubtful || rises(dialect, found)).then_some(found)
    };
    let dated = |column: usize| {
        let found = of_kind(dialect, column, 1.0)?;
        (found.kind == TimeKind::Instant).then_some(found)
    };
    let columns = || 0..dialect.n_columns;
    columns().find_map(named).or_else(|| columns().find_map(dated)).or_else(|| {
        let first = of_kind(dialect, 0, 1.0).filter(|_| dialect.header_line.is_none());
        first.filter(|first| dialect.n_columns > 1 && rises_uniformly(dialect, *first))
    })
}

/// A column as times, if most of its first cells are such; `unit_s`: seconds in a number's unit.
pub(super) fn of_kind(dialect: &Dialect, column: usize, unit_s: f64) -> Option<TimeColumn> {
    let (mut n_cells, mut n_dated, mut n_of_day, mut n_numbers) = (0, 0, 0, 0);
    for cell in first_cells(dialect, column) {
        n_cells += 1;
        match times::instant(cell) {
            Some((_, true)) => n_dated += 1,
            Some((_, false)) => n_of_day += 1,
            None => n_numbers += i32::from(cell::number(cell, dialect.decimal_comma).is_some()),
        }
    }
    let number = |cell| cell::number(cell, dialect.decimal_comma);
    #[expect(clippy::float_cmp, reason = "1 is what stands for a unit that is not stated")]
    let stated_s = (unit_s != 1.0).then_some(unit_s);
    let unit_ns = first_cells(dialect, column)
        .find_map(number)
        .and_then(|time| since_1970::unit_ns(time, stated_s));
    let kind = if 2 * n_dated > n_cells {
        TimeKind::Instant
    } else if 2 * n_of_day > n_cells {
        TimeKind::OfDay
    } else if 2 * n_numbers > n_cells {
        unit_ns.map_or(TimeKind::Number { unit_s }, |unit_ns| TimeKind::Since1970 { unit_ns })
    } else {
        return None;
    };
    Some(TimeColumn { column, kind })
}

fn first_cells(dialect: &Dialect, column: usize) -> impl Iterator<Item = &[u8]> {
    let rows = dialect.first_rows.iter().filter(|row| row.len() == dialect.n_columns);
    rows.map(move |row| row[column].as_slice())
}

fn first_times_s(dialect: &Dialect, time: TimeColumn) -> Vec<f64> {
    let mut clock = Clock::new(time.kind, dialect.decimal_comma);
    let cells = first_cells(dialect, time.column);
    cells.filter_map(|cell| Some(clock.read(cell, 0)?.time_s)).collect()
}

fn rises(dialect: &Dialect, time: TimeColumn) -> bool {
    let times_s = first_times_s(dialect, time);
    times_s.windows(2).all(|pair| pair[0] <= pair[1]) && times_s.first() < times_s.last()
}

fn rises_uniformly(dialect: &Dialect, time: TimeColumn) -> bool {
    let times_s = first_times_s(dialect, time);
    if times_s.windows(2).all(|pair| is_one(pair[1] - pair[0])) {
        return false;
    }
    let mut clock = Clock::new(time.kind, dialect.decimal_comma);
    let mut line = Timeline::default();
    let mut cells = first_cells(dialect, time.column);
    let placed = cells.all(|cell| clock.read(cell, 0).is_some_and(|row| line.push(row).is_ok()));
    placed && line.finish().is_ok_and(|timed| timed.starts.len() == 1)
}

/// Whether a step counts rows.
pub(super) fn is_one(step: f64) -> bool {
    (step - 1.0).abs() < 1e-9
}

/// Every column as the map may name it.
pub(super) fn offered(dialect: &Dialect, time: Option<usize>) -> Vec<Offered> {
    let mut number = 0;
    let mut offer = |(column, heading): (usize, &super::heading::Heading)| {
        let is_time = time == Some(column);
        number += usize::from(!is_time);
        let without_name = if is_time { "time".to_owned() } else { format!("ch{number}") };
        let name = if heading.name.is_empty() { without_name } else { heading.name.clone() };
        Offered { column, name, heading: heading.written.clone(), unit: heading.unit.clone() }
    };
    dialect.headings.iter().enumerate().map(&mut offer).collect()
}

/// The first name that two columns share.
pub(super) fn doubled(offered: &[Offered]) -> Option<&str> {
    let mut names: Vec<&str> = offered.iter().map(|o| o.name.as_str()).collect();
    names.sort_unstable();
    names.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
}

/// Whether any of a column's first cells is a number.
pub(super) fn has_numbers(dialect: &Dialect, column: usize) -> bool {
    let is_number = |cell| matches!(Shape::of(cell), Shape::Whole | Shape::Point | Shape::Comma);
    first_cells(dialect, column).any(is_number)
}
