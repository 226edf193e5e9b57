//! Tables of results, as text, CSV and JSON.

use super::computer::Computer;
use serde_json::{Map, Value, json};

/// A column: its name (with the unit), and its width as text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name in every form.
    pub name: &'static str,
    /// Characters in the text; 0: not in the text.
    pub width: usize,
}

/// What stands in a row and a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A number, as text with this many figures after the point.
    Number(f64, usize),
    /// A number of everyday size, with this many decimals in the text.
    Plain(f64, usize),
    /// Yes or no.
    Flag(bool),
}

impl Cell {
    /// As text.
    #[must_use]
    pub fn text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(number, figures) => format!("{number:.figures$e}"),
            Self::Plain(number, decimals) => format!("{number:.decimals$}"),
            Self::Flag(flag) => if *flag { "yes" } else { "NO" }.to_owned(),
        }
    }

    fn csv(&self) -> String {
        match self {
            Self::Text(text) if text.contains(['"', ',', '\n']) => {
                format!("\"{}\"", text.replace('"', "\"\""))
            }
            Self::Text(text) => text.clone(),
            Self::Number(number, _) => format!("{number:e}"),
            Self::Plain(number, _) => number.to_string(),
            Self::Flag(flag) => flag.to_string(),
        }
    }

    /// A number that is none becomes `null`.
    fn json(&self) -> Value {
        match self {
            Self::Text(text) => json!(text),
            Self::Number(number, _) | Self::Plain(number, _) => json!(number),
            Self::Flag(flag) => json!(flag),
        }
    }
}

/// The heading of the text.
#[must_use]
pub fn heading(columns: &[Column]) -> String {
    line(columns, columns.iter().map(|column| (column.name.to_owned(), false)))
}

/// A row as text, numbers to the right.
#[must_use]
pub fn text_row(columns: &[Column], row: &[Cell]) -> String {
    line(
        columns,
        row.iter().map(|cell| (cell.text(), matches!(cell, Cell::Number(..) | Cell::Plain(..)))),
    )
}

fn line(columns: &[Column], cells: impl Iterator<Item = (String, bool)>) -> String {
    let mut line = String::new();
    for (column, (text, is_number)) in columns.iter().zip(cells) {
        let width = column.width.max(column.name.chars().count());
        if column.width == 0 {
            continue;
        }
        line += &if is_number { format!("{text:>width$}  ") } else { format!("{text:<width$}  ") };
    }
    line.trim_end().to_owned() + "\n"
}

/// All rows with a heading (RFC 4180, lines end with a line feed).
#[must_use]
pub fn csv(columns: &[Column], rows: &[Vec<Cell>]) -> String {
    let names: Vec<&str> = columns.iter().map(|column| column.name).collect();
    let mut text = names.join(",") + "\n";
    for row in rows {
        text += &(row.iter().map(Cell::csv).collect::<Vec<_>>().join(",") + "\n");
    }
    text
}

/// All rows as objects, with the computer and what was set.
#[must_use]
pub fn json(
    bench: &str,
    (computer, settings): (&Computer, &Value),
    columns: &[Column],
    rows: &[Vec<Cell>],
) -> String {
    let object = |row: &Vec<Cell>| -> Map<String, Value> {
        columns.iter().zip(row).map(|(c, cell)| (c.name.to_owned(), cell.json())).collect()
    };
    let document = json!({
        "format": "rotorwatch.bench/1",
        "bench": bench,
        "computer": computer.json(),
        "settings": settings,
        "rows": rows.iter().map(object).collect::<Vec<_>>(),
    });
    format!("{document:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: [Column; 3] = [
        Column { name: "name", width: 6 },
        Column { name: "error", width: 8 },
        Column { name: "pass", width: 0 },
    ];

    fn rows() -> Vec<Vec<Cell>> {
        let row = |name: &str, number, flag| {
            vec![Cell::Text(name.to_owned()), Cell::Number(number, 1), Cell::Flag(flag)]
        };
        vec![row("a \"b\", c", 1.25e-3, true), row("µ", f64::NAN, false)]
    }

    #[test]
    fn a_table_reads_the_same_in_every_form() {
        assert_eq!(
            csv(&COLUMNS, &rows()),
            "name,error,pass\n\"a \"\"b\"\", c\",1.25e-3,true\nµ,NaN,false\n"
        );
        let computer = Computer::this();
        let text = json("x", (&computer, &json!({ "seconds": 0.1 })), &COLUMNS, &rows());
        let document: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(
            document["rows"][0],
            json!({ "name": "a \"b\", c", "error": 1.25e-3, "pass": true })
        );
        assert!(document["rows"][1]["error"].is_null());
        assert_eq!(heading(&COLUMNS), "name    error\n");
        assert_eq!(text_row(&COLUMNS, &rows()[1]), "µ            NaN\n");
    }
}
