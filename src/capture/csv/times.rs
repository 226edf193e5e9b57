//! The time column: times of the rows to one rate and the gaps, in one pass and little memory.
//!
//! Times are taken as uniform if each lies within one sample interval and one unit of its last
//! printed digit of a straight line, so that coarsely printed ones pass. A step of more than one and
//! a half intervals, beyond that digit, is a gap.

use super::cell;
use crate::units::Hz;

/// Rows whose times are kept until the interval can be told.
const KEPT_ROWS_MAX: usize = 1 << 16;

/// A day, and the fall from which on times of day have passed midnight, ns.
const DAY_NS: i64 = 86_400_000_000_000;
const MIDNIGHT_NS: i64 = DAY_NS / 24 * 23;

/// Gaps of a file at most.
const GAPS_MAX: usize = 100_000;

/// Steps that tell the interval span as many units of the last digit.
const CLEAR_UNITS: f64 = 20.0;

/// How the cells of a time column are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TimeKind {
    /// Numbers, and seconds in one of them.
    Number { unit_s: f64 },
    /// Numbers that count from 1970 on, and nanoseconds in one of them.
    Since1970 { unit_ns: i64 },
    /// Dates with times of day.
    Instant,
    /// Times of day.
    OfDay,
}

/// A row's time, s, and what its last printed digit is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RowTime {
    pub(super) time_s: f64,
    pub(super) line: u64,
    quantum_s: f64,
}

/// Reads a time of day, with a date or without: nanoseconds, from 1970 on if there is a date.
pub(super) fn instant(cell: &[u8]) -> Option<(i64, bool)> {
    if !cell.first()?.is_ascii_digit() || !cell.contains(&b':') || cell.len() > 64 {
        return None;
    }
    let text = std::str::from_utf8(cell).ok()?;
    let of_timestamp = |time: jiff::Timestamp| i64::try_from(time.as_nanosecond()).ok();
    if let Ok(time) = text.parse::<jiff::Timestamp>() {
        return Some((of_timestamp(time)?, true));
    }
    if let Ok(time) = text.parse::<jiff::civil::DateTime>() {
        let utc = time.to_zoned(jiff::tz::TimeZone::UTC).ok()?;
        return Some((of_timestamp(utc.timestamp())?, true));
    }
    let time = text.parse::<jiff::civil::Time>().ok()?;
    let midnight = jiff::civil::Time::midnight();
    let span = time.duration_since(midnight);
    Some((i64::try_from(span.as_nanos()).ok()?, false))
}

/// Reads a number of units since 1970 as nanoseconds, digit by digit: float64 has too few.
fn since_1970_ns(cell: &[u8], unit_ns: i64) -> Option<i64> {
    let (mut ns, mut digit_ns, mut behind) = (0_i64, unit_ns, false);
    for &byte in cell {
        match byte {
            b'0'..=b'9' if behind => {
                digit_ns /= 10;
                ns = ns.checked_add(digit_ns * i64::from(byte - b'0'))?;
            }
            b'0'..=b'9' => {
                ns = ns.checked_mul(10)?.checked_add(unit_ns * i64::from(byte - b'0'))?;
            }
            b'.' | b',' if !behind => behind = true,
            _ => return None,
        }
    }
    (ns > 0).then_some(ns)
}

/// Reads the cells of a time column.
#[derive(Debug, Clone)]
pub(super) struct Clock {
    kind: TimeKind,
    decimal_comma: bool,
    /// Of instants, the first.
    first_ns: Option<i64>,
    /// Of times of day, the last, and the days that have passed, both ns.
    last_ns: i64,
    days_ns: i64,
    /// Most digits seen behind the separator, and in all.
    behind: i32,
    significant: i32,
}

impl Clock {
    pub(super) fn new(kind: TimeKind, decimal_comma: bool) -> Self {
        Self {
            kind,
            decimal_comma,
            first_ns: None,
            last_ns: 0,
            days_ns: 0,
            behind: i32::MIN,
            significant: 1,
        }
    }

    /// Nanoseconds since 1970 of the first row, if its date is known.
    pub(super) fn start_ns(&self) -> Option<i64> {
        match self.kind {
            TimeKind::Instant | TimeKind::Since1970 { .. } => self.first_ns,
            TimeKind::Number { .. } | TimeKind::OfDay => None,
        }
    }

    /// Reads a cell; `None` if it is no time.
    pub(super) fn read(&mut self, cell: &[u8], line: u64) -> Option<RowTime> {
        let (time_s, quantum_s) = match self.kind {
            TimeKind::Number { unit_s } => {
                let value = cell::number(cell, self.decimal_comma).filter(|t| t.is_finite())?;
                (value * unit_s, self.quantum(cell, value) * unit_s)
            }
            TimeKind::Since1970 { unit_ns } => {
                let ns = since_1970_ns(cell, unit_ns)?;
                let (behind, _) = cell::digits(cell);
                self.behind = self.behind.max(behind);
                let printed = unit_ns as f64 * 1e-9 * 10_f64.powi(self.behind.saturating_neg());
                (self.since_first_s(ns)?, printed.max(1e-9))
            }
            TimeKind::Instant => {
                let (ns, _) = instant(cell)?;
                (self.since_first_s(ns)?, self.quantum_of_seconds(cell))
            }
            TimeKind::OfDay => {
                let (ns, _) = instant(cell)?;
                self.days_ns += if self.last_ns - ns > MIDNIGHT_NS { DAY_NS } else { 0 };
                self.last_ns = ns;
                (self.since_first_s(ns + self.days_ns)?, self.quantum_of_seconds(cell))
            }
        };
        Some(RowTime { time_s, line, quantum_s })
    }

    fn since_first_s(&mut self, ns: i64) -> Option<f64> {
        let first = *self.first_ns.get_or_insert(ns);
        Some(ns.checked_sub(first)? as f64 * 1e-9)
    }

    /// Worth of the last digit: of the most digits seen, for zeros at the end may be left out.
    fn quantum(&mut self, cell: &[u8], value: f64) -> f64 {
        let (behind, significant) = cell::digits(cell);
        self.behind = self.behind.max(behind);
        self.significant = self.significant.max(significant);
        let leading = if value == 0.0 { 0.0 } else { value.abs().log10().floor() + 1.0 };
        let of_digits = 10_f64.powf(leading - f64::from(self.significant));
        let printed = 10_f64.powi(self.behind.saturating_neg()).max(of_digits);
        printed.max(value.abs() * f64::EPSILON)
    }

    fn quantum_of_seconds(&mut self, cell: &[u8]) -> f64 {
        let fraction = cell.iter().rposition(|&byte| byte == b'.' || byte == b',');
        let digits = fraction.map_or(0, |at| {
            cell[at + 1..].iter().take_while(|byte| byte.is_ascii_digit()).take(9).count()
        });
        self.behind = self.behind.max(i32::try_from(digits).unwrap_or(9));
        10_f64.powi(-self.behind).max(1e-9)
    }
}

/// What is wrong with the times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TimeFault {
    /// The line, if one can be named.
    pub(super) line: Option<u64>,
    pub(super) problem: String,
}

/// The times of all rows, as they come.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    /// The first rows, while the interval is not known.
    kept: Vec<RowTime>,
    interval_s: Option<f64>,
    /// The row before.
    last: Option<RowTime>,
    /// The same of the rows that are placed.
    placed: Option<RowTime>,
    n_placed: u64,
    /// First row and time of each segment.
    starts: Vec<(u64, f64)>,
    /// Seconds and steps inside segments that have ended.
    ended_s: f64,
    ended_steps: u64,
    quantum_s: f64,
    /// The intervals that all rows allow, s, and the lines that say so.
    at_least: Option<(f64, u64)>,
    at_most: Option<(f64, u64)>,
}

/// The outcome.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timed {
    pub(super) rate: Hz,
    /// First row and time since the first row, s, of each segment.
    pub(super) starts: Vec<(u64, f64)>,
}

impl Timeline {
    /// Takes the next row.
    pub(super) fn push(&mut self, row: RowTime) -> Result<(), TimeFault> {
        if let Some(last) = self.last.filter(|last| row.time_s < last.time_s) {
            let back_s = last.time_s - row.time_s;
            let problem = format!("the time falls back by {back_s:.6} s; sort or cut the file");
            return Err(TimeFault { line: Some(row.line), problem });
        }
        self.last = Some(row);
        if self.interval_s.is_some() {
            return self.place(row);
        }
        self.kept.push(row);
        if self.kept.len() < KEPT_ROWS_MAX { Ok(()) } else { self.begin() }
    }

    /// Tells the interval from the rows kept, and places them.
    fn begin(&mut self) -> Result<(), TimeFault> {
        let kept = std::mem::take(&mut self.kept);
        let problem = "the times tell no rate: too few rows, or too few digits";
        let none = || TimeFault { line: None, problem: problem.to_owned() };
        self.interval_s = Some(interval_of(&kept).ok_or_else(none)?);
        kept.into_iter().try_for_each(|row| self.place(row))
    }

    fn place(&mut self, row: RowTime) -> Result<(), TimeFault> {
        let at = self.n_placed;
        self.n_placed += 1;
        self.quantum_s = self.quantum_s.max(row.quantum_s);
        let longest_s = 1.5 * self.interval_s.unwrap_or(0.0) + row.quantum_s;
        match (self.placed.replace(row), self.starts.last()) {
            (Some(before), Some(&(start, start_s))) if row.time_s - before.time_s <= longest_s => {
                self.bound(row, (at - start) as f64, row.time_s - start_s);
                return Ok(());
            }
            (Some(before), _) => self.end_segment(before, at),
            (None, _) => {}
        }
        self.starts.push((at, row.time_s));
        if self.starts.len() > GAPS_MAX {
            let problem = format!("more than {GAPS_MAX} gaps in the times");
            return Err(TimeFault { line: Some(row.line), problem });
        }
        Ok(())
    }

    /// Bounds the interval: row `steps` after the start of its segment lies within one interval and
    /// one digit of the line through it.
    fn bound(&mut self, row: RowTime, steps: f64, since_s: f64) {
        let least = (since_s - row.quantum_s) / (steps + 1.0);
        if self.at_least.is_none_or(|(known, _)| least > known) {
            self.at_least = Some((least, row.line));
        }
        let most = (since_s + row.quantum_s) / (steps - 1.0);
        if steps > 1.0 && self.at_most.is_none_or(|(known, _)| most < known) {
            self.at_most = Some((most, row.line));
        }
    }

    /// Notes the segment that ends before row `end`.
    fn end_segment(&mut self, last: RowTime, end: u64) {
        if let Some(&(start, start_s)) = self.starts.last() {
            self.ended_s += last.time_s - start_s;
            self.ended_steps += end - 1 - start;
        }
    }

    /// Concludes: the rate over all segments, if every time fits it.
    pub(super) fn finish(mut self) -> Result<Timed, TimeFault> {
        if self.interval_s.is_none() {
            self.begin()?;
        }
        if let Some(last) = self.placed {
            self.end_segment(last, self.n_placed);
        }
        let interval_s = self.ended_s / self.ended_steps as f64;
        if !(interval_s.is_finite() && interval_s > 0.0) {
            let problem = "the times tell no rate: a gap after every row".to_owned();
            return Err(TimeFault { line: None, problem });
        }
        let slack = 1e-9 * interval_s;
        let early = self.at_most.filter(|(most, _)| interval_s > most + slack);
        let late = self.at_least.filter(|(least, _)| interval_s < least - slack);
        if let Some((_, line)) = early.or(late) {
            let problem = format!(
                "the time lies off the straight line of one row every {interval_s:.9} s: the rows are not uniform"
            );
            return Err(TimeFault { line: Some(line), problem });
        }
        let first_s = self.starts.first().map_or(0.0, |&(_, time_s)| time_s);
        let starts = self.starts.iter().map(|&(row, time_s)| (row, time_s - first_s)).collect();
        let relative = 2.0 * self.quantum_s / self.ended_s.max(f64::MIN_POSITIVE);
        Ok(Timed { rate: Hz(plain(interval_s.recip(), relative)), starts })
    }
}

/// The whole number next to a rate, if the printed digits cannot tell the two apart.
fn plain(rate_hz: f64, relative: f64) -> f64 {
    let whole = rate_hz.round();
    if (whole - rate_hz).abs() <= rate_hz * (relative + 1e-12) { whole } else { rate_hz }
}

/// Median step of rows that lie so far apart that the digits tell it.
fn interval_of(rows: &[RowTime]) -> Option<f64> {
    let quantum_s = rows.iter().map(|row| row.quantum_s).fold(0.0, f64::max);
    let mut lag = 1;
    while lag < rows.len() {
        let mut steps: Vec<f64> =
            rows.iter().zip(&rows[lag..]).map(|(a, b)| b.time_s - a.time_s).collect();
        steps.sort_by(f64::total_cmp);
        let median_s = steps[steps.len() / 2];
        let is_last = 2 * lag >= rows.len();
        if (is_last || median_s >= CLEAR_UNITS * quantum_s) && median_s > 0.0 {
            return Some(median_s / lag as f64);
        }
        lag *= 2;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(cells: impl IntoIterator<Item = String>, kind: TimeKind) -> Result<Timed, TimeFault> {
        let mut clock = Clock::new(kind, false);
        let mut line = Timeline::default();
        for (at, cell) in cells.into_iter().enumerate() {
            line.push(clock.read(cell.as_bytes(), at as u64 + 2).unwrap())?;
        }
        line.finish()
    }

    const SECONDS: TimeKind = TimeKind::Number { unit_s: 1.0 };

    #[test]
    fn the_rate_survives_coarse_printing() {
        // 12 kHz for 2 s, printed to 100 ns, 1 µs, and, 12 rows alike, to 1 ms.
        for digits in [7_u16, 6, 3] {
            let places = usize::from(digits);
            let cells = (0..24_000).map(|i| format!("{:.places$}", f64::from(i) / 12_000.0));
            let found = timed(cells, SECONDS).unwrap();
            assert_eq!(found.starts, [(0, 0.0)], "{digits}");
            // A digit at either end of 2 s, at most.
            let scatter = 12_000.0 * 0.1_f64.powi(i32::from(digits));
            assert!((found.rate.0 - 12_000.0).abs() <= scatter, "{digits}: {:?}", found.rate);
        }
    }

    #[test]
    fn zeros_left_out_and_growing_times_are_no_gaps() {
        let cells = (0..5000).map(|i| format!("{}", f64::from(i) / 1000.0));
        assert_eq!(
            timed(cells, SECONDS).unwrap(),
            Timed { rate: Hz(1000.0), starts: vec![(0, 0.0)] }
        );
        // Six significant digits, as %g prints: 10 ms apart, digits of 1 ms beyond 100 s.
        let six = |t: f64| {
            let leading = [100.0, 10.0, 1.0, 0.1, 0.01].iter().filter(|&&x| t >= x).count();
            format!("{t:.*}", 8 - leading)
        };
        let cells = (0..20_000).map(|i| six(f64::from(i) / 100.0));
        assert_eq!(timed(cells, SECONDS).unwrap().rate, Hz(100.0));
    }

    #[test]
    fn gaps_begin_segments_and_do_not_change_the_rate() {
        let at = |i: i32| f64::from(i) / 500.0 + if i < 300 { 0.0 } else { 60.0 };
        let found = timed((0..1000).map(|i| format!("{:.4}", at(i) + 7.0)), SECONDS).unwrap();
        assert_eq!(found.rate, Hz(500.0));
        assert_eq!(found.starts.len(), 2);
        assert_eq!(found.starts[1].0, 300);
        // Printed to 0.1 ms.
        assert!((found.starts[1].1 - 60.6).abs() < 1e-4, "{:?}", found.starts);
        // One row lost is a gap too.
        let cells = (0..1000).filter(|i| *i != 400).map(|i| format!("{:.4}", f64::from(i) / 500.0));
        assert_eq!(timed(cells, SECONDS).unwrap().starts.len(), 2);
    }

    #[test]
    fn times_that_fall_back_or_bend_are_refused_with_their_line() {
        let cells = [0.0, 0.1, 0.2, 0.15, 0.3].map(|t: f64| t.to_string());
        assert_eq!(timed(cells, SECONDS).unwrap_err().line, Some(5));
        // Steps grow by 30 % over the file: no step is a gap, yet the middle is 4 % early.
        let cells = (0..1000).map(|i| {
            let x = f64::from(i);
            format!("{:.6}", 1e-3 * (x + 0.15e-3 * x * x))
        });
        let fault = timed(cells, SECONDS).unwrap_err();
        assert!(fault.line.is_some() && fault.problem.contains("not uniform"), "{fault:?}");
        assert!(timed(["1".to_owned()], SECONDS).is_err());
        assert!(timed(std::iter::repeat_n("3".to_owned(), 100), SECONDS).is_err());
    }

    #[test]
    fn instants_and_units_are_seconds() {
        let cells = (0..100).map(|i| {
            format!("2026-03-01 12:00:{:02}.{:03}", i / 100 + 59 * (i / 100), (i % 100) * 10)
        });
        let found = timed(cells, TimeKind::Instant).unwrap();
        assert_eq!(found.rate, Hz(100.0));
        let cells = (0..100).map(|i| format!("2026-03-01T12:00:00.{:03}+01:00", i * 10));
        assert_eq!(timed(cells, TimeKind::Instant).unwrap().rate, Hz(100.0));
        let cells = (0..100).map(|i| format!("{}", i * 2));
        let found = timed(cells, TimeKind::Number { unit_s: 1e-3 }).unwrap();
        assert_eq!(found.rate, Hz(500.0));
        assert_eq!(instant(b"2026-03-01T12:00:00Z"), Some((1_772_366_400_000_000_000, true)));
        assert_eq!(instant(b"2026-03-01 12:00:00"), Some((1_772_366_400_000_000_000, true)));
        assert_eq!(instant(b"00:00:01.5"), Some((1_500_000_000, false)));
        assert_eq!(instant(b"10:"), None);
    }
}
