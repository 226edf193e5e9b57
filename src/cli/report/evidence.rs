//! The numbers behind a verdict: a table where the page is wide enough, else a list.

use super::super::terminal::Page;
use super::super::terminal::clean;
use super::super::terminal::columns;
use super::INDENT;
use crate::diagnosis::verdict::Evidence;
use crate::html::numbers;
use crate::units::Unit;

/// Columns of the table.
const N_COLUMNS: usize = 8;

const HEAD: [&str; N_COLUMNS] =
    ["indicator", "channel", "Hz", "expected Hz", "order", "value", "threshold", "false alarm"];

/// Columns before this one are aligned left, the others right.
const FIRST_NUMBER: usize = 2;

/// Stands where there is no value.
const NOTHING: &str = "-";

type Row = [String; N_COLUMNS];

/// Appends the evidence, if there is any.
pub(super) fn append(out: &mut String, evidence: &[Evidence], page: &Page) {
    if evidence.is_empty() {
        return;
    }
    out.push('\n');
    let rows: Vec<Row> = evidence.iter().map(row).collect();
    let table = table(&rows);
    let width = table.iter().map(|line| columns(line)).max().unwrap_or(0);
    if width <= page.width {
        for line in table {
            out.push_str(&line);
            out.push('\n');
        }
    } else {
        for row in &rows {
            page.hanging(out, 2 * INDENT, 3 * INDENT, &sentence(row));
        }
    }
}

fn row(evidence: &Evidence) -> Row {
    let e = evidence;
    let hertz =
        |f: Option<crate::units::Hz>| f.map_or(NOTHING.to_owned(), |f| format!("{:.2}", f.0));
    let unit = if e.unit == Unit::One { String::new() } else { format!(" {}", e.unit.symbol()) };
    let with_unit = |value: f64| format!("{}{unit}", numbers::significant(value));
    // Ratios and depths are what they are; amplitudes say how they were detected.
    let detector = e.detector.filter(|_| e.unit != Unit::One);
    let detector = detector.map_or(String::new(), |d| format!(" {}", d.name()));
    [
        clean(&e.indicator),
        clean(&e.channel),
        hertz(e.frequency),
        hertz(e.expected),
        e.order.map_or(NOTHING.to_owned(), |order| format!("{order:.3}")),
        format!("{}{detector}", with_unit(e.value)),
        e.threshold.map_or(NOTHING.to_owned(), with_unit),
        e.false_alarm_probability.map_or(NOTHING.to_owned(), numbers::probability),
    ]
}

/// Lines of equal columns, the head first; columns in which nothing stands are left out.
fn table(rows: &[Row]) -> Vec<String> {
    let head = HEAD.map(str::to_owned);
    let mut widths = [0; N_COLUMNS];
    for (i, width) in widths.iter_mut().enumerate() {
        if rows.iter().any(|row| row[i] != NOTHING) {
            *width =
                std::iter::once(&head).chain(rows).map(|row| columns(&row[i])).max().unwrap_or(0);
        }
    }
    let line = |row: &Row| {
        let mut line = " ".repeat(2 * INDENT);
        for (i, (cell, width)) in row.iter().zip(widths).enumerate().filter(|(_, (_, w))| *w > 0) {
            let padding = " ".repeat(width - columns(cell));
            let (before, after) =
                if i < FIRST_NUMBER { ("", &padding[..]) } else { (&padding[..], "") };
            line.push_str(&[before, cell, after, "  "].concat());
        }
        line.trim_end().to_owned()
    };
    std::iter::once(&head).chain(rows).map(line).collect()
}

/// A row in words, for narrow pages.
fn sentence(row: &Row) -> String {
    let [indicator, channel, hz, expected, order, value, threshold, false_alarm] = row;
    let mut text = format!("{indicator} in {channel}: {value}");
    for (cell, part) in [
        (threshold, format!(", threshold {threshold}")),
        (hz, format!(", at {hz} Hz")),
        (order, format!(" ({order} ×)")),
        (expected, format!(", expected {expected} Hz")),
        (false_alarm, format!(", false alarm {false_alarm}")),
    ] {
        if cell != NOTHING {
            text.push_str(&part);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::fault::Detector;
    use crate::units::Hz;

    fn line() -> Evidence {
        Evidence {
            indicator: "absolute_vibration_bpfi".into(),
            channel: "right_x+right_y".into(),
            detector: Some(Detector::ZeroToPeak),
            frequency: Some(Hz(67.9)),
            expected: Some(Hz(68.03)),
            order: Some(6.79),
            value: 0.31,
            unit: Unit::MetrePerSecondSquared,
            threshold: Some(0.04),
            false_alarm_probability: Some(1e-6),
            sample_range: None,
        }
    }

    fn rendered(evidence: &[Evidence], width: usize) -> String {
        let mut out = String::new();
        append(&mut out, evidence, &Page { width, colour: false });
        out
    }

    #[test]
    fn numbers_stand_below_their_heads() {
        let bare = Evidence { detector: None, expected: None, order: None, ..line() };
        let text = rendered(&[line(), bare], 120);
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert_eq!(lines.len(), 3, "{text}");
        assert!(
            lines[1].contains("0.310 m/s^2 0-p") && lines[1].contains("0.0400 m/s^2"),
            "{text}"
        );
        let end = |line: &str, word: &str| line.find(word).map(|at| at + word.len());
        assert_eq!(end(lines[0], " Hz").unwrap(), end(lines[1], "67.90").unwrap(), "{text}");
        assert_eq!(end(lines[0], "false alarm"), end(lines[2], "1e-6"), "{text}");
    }

    #[test]
    fn a_narrow_page_gets_sentences() {
        let text = rendered(&[line()], 50);
        assert!(text.lines().all(|line| columns(line) <= 50), "{text}");
        let joined = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(
            joined,
            "absolute_vibration_bpfi in right_x+right_y: 0.310 m/s^2 0-p, threshold 0.0400 m/s^2, \
             at 67.90 Hz (6.790 ×), expected 68.03 Hz, false alarm 1e-6"
        );
        assert_eq!(rendered(&[], 50), "");
    }

    #[test]
    fn columns_without_a_value_are_left_out_and_ratios_have_no_detector() {
        let ratio =
            Evidence { frequency: None, expected: None, order: None, unit: Unit::One, ..line() };
        let text = rendered(&[ratio], 80);
        assert!(!text.contains("Hz") && !text.contains("0-p"), "{text}");
        assert!(text.ends_with("  0.310     0.0400         1e-6\n"), "{text}");
    }
}
