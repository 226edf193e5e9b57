//! What commas mean where they could mean two things: the end of a cell, a decimal separator,
//! thousands. Must not know headings or times.

use super::records::cells_of;

/// Rows that must show a sign of thousands.
const ROWS_OF_THOUSANDS: usize = 2;

/// Whether a table of two cells, split at commas, is one column of numbers with decimal commas;
/// `is_titled`: one cell stands above it.
///
/// The first part must be whole and the second without sign. Whole numbers of two columns look
/// alike, but have no zeros in front: a zero as in `1,05` or `-0,5` tells, or else a lone title
/// above digits of one number.
pub(super) fn are_decimal(rows: &[Vec<Vec<u8>>], is_titled: bool) -> bool {
    let fits = |row: &Vec<Vec<u8>>| match &row[..] {
        [whole] => is_whole(whole),
        [whole, fraction] => is_whole(whole) && is_fraction(fraction),
        _ => false,
    };
    let parts = || rows.iter().filter_map(|row| Some((row.first()?, row.get(1)?)));
    let tells = |(whole, fraction): (&Vec<u8>, &Vec<u8>)| {
        whole.starts_with(b"-0") || fraction.len() > 1 && fraction.starts_with(b"0")
    };
    let mut lengths = parts().map(|(_, fraction)| fraction.len());
    let length = lengths.next();
    let alike = lengths.all(|other| Some(other) == length);
    rows.iter().all(fits) && (parts().any(tells) || is_titled && alike)
}

/// Whether commas stand both between the cells and inside the numbers: twice as many cells as
/// names, whole numbers and digits in turn.
pub(super) fn are_both(rows: &[Vec<Vec<u8>>], n_names: usize) -> bool {
    let is_part = |(at, cell): (usize, &Vec<u8>)| {
        if at % 2 == 0 { is_whole(cell) } else { is_fraction(cell) }
    };
    let fits = |row: &Vec<Vec<u8>>| row.len() == 2 * n_names && row.iter().enumerate().all(is_part);
    n_names > 1 && rows.iter().all(fits)
}

/// The first of the lines with a number in which thousands are set apart, such as `1.234,5`, if
/// several have one.
pub(super) fn thousands(lines: &[&[u8]]) -> Option<usize> {
    let has_one = |line: &&[u8]| {
        let grouped = |separator| {
            let cells = cells_of(line, separator).unwrap_or_default();
            cells.len() > 1 && cells.iter().any(|cell| is_grouped(cell))
        };
        grouped(b';') || grouped(b'\t')
    };
    let mut found = lines.iter().enumerate().filter(|(_, line)| has_one(line)).map(|(at, _)| at);
    let first = found.next();
    first.filter(|_| found.count() + 1 >= ROWS_OF_THOUSANDS)
}

fn is_digits(text: &[u8]) -> bool {
    !text.is_empty() && text.iter().all(u8::is_ascii_digit)
}

fn is_whole(cell: &[u8]) -> bool {
    is_digits(cell.strip_prefix(b"-").or(cell.strip_prefix(b"+")).unwrap_or(cell))
}

/// Digits, and perhaps an exponent.
fn is_fraction(cell: &[u8]) -> bool {
    let at = cell.iter().position(|byte| matches!(byte, b'e' | b'E'));
    at.map_or(is_digits(cell), |at| is_digits(&cell[..at]) && is_whole(&cell[at + 1..]))
}

/// Whether thousands are set apart by one sign and decimals by the other.
pub(super) fn is_grouped(cell: &[u8]) -> bool {
    let unsigned = cell.strip_prefix(b"-").unwrap_or(cell);
    [(b'.', b','), (b',', b'.')].iter().any(|&(group, decimal)| {
        let Some(end) = unsigned.iter().position(|&byte| byte == decimal) else { return false };
        let mut groups = unsigned[..end].split(|&byte| byte == group);
        let first = groups.next().is_some_and(|digits| is_digits(digits) && digits.len() <= 3);
        let mut n_groups = 0;
        let whole = groups.all(|digits| {
            n_groups += 1;
            is_digits(digits) && digits.len() == 3
        });
        first && whole && n_groups > 0 && is_digits(&unsigned[end + 1..])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Vec<Vec<Vec<u8>>> {
        text.split(' ').map(|line| cells_of(line.as_bytes(), b',').unwrap()).collect()
    }

    #[test]
    fn fractions_are_told_from_columns() {
        for (text, is_titled, expected) in [
            ("0,1234 -0,2200 1,5000", false, true),
            ("0,12 1,05 3", false, true),
            ("0,1234 0,2200", true, true),
            ("512,498 511,501", false, false),
            ("512,498 511,0,1", false, false),
            ("0,1234 0,-2200", true, false),
            ("0.5,1234 0.1,0200", true, false),
        ] {
            assert_eq!(are_decimal(&rows(text), is_titled), expected, "{text}");
        }
        assert!(are_both(&rows("0,001,0,12 0,002,-1,13"), 2));
        assert!(!are_both(&rows("0,001,0,12 0,002,1,-13"), 2));
    }

    #[test]
    fn thousands_are_seen() {
        assert_eq!(thousands(&[b"t;a", b"0;1.012,5", b"1;-1.045.112,5"]), Some(1));
        assert_eq!(thousands(&[b"0;1,012.5", b"1;1,045.5"]), Some(0));
        assert_eq!(thousands(&[b"0;1.012", b"1;1,045"]), None);
        assert_eq!(thousands(&[b"Rate;12.000,0", b"1;0,5"]), None);
    }
}
