//! What a cell holds: a number, a time, text.

/// Bytes of a number at most.
const NUMBER_BYTES_MAX: usize = 64;

/// Shape of a cell, before its value counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Empty,
    /// A number without a decimal separator, or a word such as NaN.
    Whole,
    /// A number with a point.
    Point,
    /// A number with a comma.
    Comma,
    /// A date with a time of day, or a time of day alone.
    Instant,
    Text,
}

impl Shape {
    /// Tells the shape of a cell without outer blanks.
    pub(super) fn of(cell: &[u8]) -> Self {
        if cell.is_empty() {
            return Self::Empty;
        }
        if super::times::instant(cell).is_some() {
            return Self::Instant;
        }
        let comma = cell.iter().position(|&byte| byte == b',');
        match comma {
            Some(at) if !cell.get(at + 1).is_some_and(u8::is_ascii_digit) => Self::Text,
            Some(_) if number(cell, true).is_some() => Self::Comma,
            None if number(cell, false).is_some() => {
                if cell.contains(&b'.') {
                    Self::Point
                } else {
                    Self::Whole
                }
            }
            Some(_) | None => Self::Text,
        }
    }

    /// Whether a table may hold it where numbers stand.
    pub(super) fn is_value(self) -> bool {
        match self {
            Self::Whole | Self::Point | Self::Comma | Self::Instant => true,
            Self::Empty | Self::Text => false,
        }
    }
}

/// Reads a number; `None` for anything else. NaN and infinity are numbers.
pub(super) fn number(cell: &[u8], decimal_comma: bool) -> Option<f64> {
    if !decimal_comma || !cell.contains(&b',') {
        let is_grouped = decimal_comma && cell.contains(&b'.');
        return if is_grouped { None } else { std::str::from_utf8(cell).ok()?.parse().ok() };
    }
    let mut point = [0; NUMBER_BYTES_MAX];
    let point = point.get_mut(..cell.len())?;
    let mut n_commas = 0;
    for (to, &from) in point.iter_mut().zip(cell) {
        n_commas += usize::from(from == b',');
        *to = match from {
            b',' => b'.',
            b'.' => return None, // thousands
            other => other,
        };
    }
    if n_commas > 1 {
        return None;
    }
    std::str::from_utf8(point).ok()?.parse().ok()
}

/// Digits behind the decimal separator and significant digits of a number as written.
pub(super) fn digits(cell: &[u8]) -> (i32, i32) {
    let (mut behind, mut significant, mut seen_separator) = (0, 0, false);
    for (at, &byte) in cell.iter().enumerate() {
        match byte {
            b'0'..=b'9' => {
                behind += i32::from(seen_separator);
                significant += i32::from(significant > 0 || byte != b'0');
            }
            b'.' | b',' => seen_separator = true,
            b'e' | b'E' => {
                let exponent = std::str::from_utf8(&cell[at + 1..]).ok();
                let exponent: i32 = exponent.and_then(|text| text.parse().ok()).unwrap_or(0);
                return (behind.saturating_sub(exponent), significant);
            }
            _ => {}
        }
    }
    (behind, significant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_and_nothing_else() {
        for (cell, comma, value) in [
            ("1.5", false, Some(1.5)),
            ("+1", false, Some(1.0)),
            ("-1e-3", false, Some(-1e-3)),
            ("1,5", true, Some(1.5)),
            ("-2,5E3", true, Some(-2500.0)),
            ("7", true, Some(7.0)),
            ("1,5", false, None),
            ("1.234,5", true, None),
            ("1,234,5", true, None),
            ("1.5", true, None),
            ("0x10", false, None),
            ("", false, None),
            ("1 2", false, None),
        ] {
            assert_eq!(number(cell.as_bytes(), comma), value, "{cell}");
        }
        assert!(number(b"NaN", false).is_some_and(f64::is_nan));
    }

    #[test]
    fn digits_are_counted_as_written() {
        assert_eq!(digits(b"0.00125"), (5, 3));
        assert_eq!(digits(b"12,500"), (3, 5));
        assert_eq!(digits(b"-1.25e-3"), (5, 3));
        assert_eq!(digits(b"100"), (0, 3));
        assert_eq!(digits(b"1e999999999999"), (0, 1));
    }

    #[test]
    fn shapes_tell_decimal_commas_from_separators() {
        for (cell, shape) in [
            ("1", Shape::Whole),
            ("1.", Shape::Point),
            ("1,", Shape::Text),
            ("1,5", Shape::Comma),
            ("ok", Shape::Text),
            ("2026-03-01 12:00:00.5", Shape::Instant),
            ("2026-03-01T12:00:00Z", Shape::Instant),
            ("12:00:00.250", Shape::Instant),
        ] {
            assert_eq!(Shape::of(cell.as_bytes()), shape, "{cell}");
        }
    }
}
