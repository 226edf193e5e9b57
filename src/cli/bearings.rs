//! `rotorwatch bearings`: the catalogue, and what a designation resolves to.

use crate::api::wire::bearings;
use crate::machine::bearing::FaultOrders;
use crate::machine::bearing::RotatingRing;
use crate::machine::catalogue;
use crate::machine::catalogue::Resolved;
use crate::machine::catalogue::Row;
use crate::machine::catalogue::Unresolved;
use crate::units::Hz;
use clap::Args;
use clap::ValueEnum;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch bearings
  rotorwatch bearings NU2
  rotorwatch bearings --speed 29.5 'SKF 6205-2RSH/C3'
  rotorwatch bearings --format json 7205 BEP

A whole designation is resolved: prefixes and suffixes as printed on the bearing. The beginning of one
lists those that begin so. A machine file names a bearing the same way: catalogue = \"SKF 6205\".

Multiples hold for a turning inner ring, without slip; their limits say how well the inside is known.
Exit codes: 0 found; 2 not in the catalogue.";

/// Arguments of `bearings`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A designation or its beginning; all bearings without one.
    #[arg(value_name = "DESIGNATION")]
    pub query: Vec<String>,
    /// Shaft speed, Hz: rates in Hz beside the multiples.
    #[arg(long, value_name = "HZ", value_parser = super::positive)]
    pub speed: Option<f64>,
    /// What is printed.
    #[arg(long, value_enum, default_value = "text", value_name = "FORMAT")]
    pub format: Format,
}

/// Forms of the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
}

/// What was asked for and is not there.
#[derive(Debug, thiserror::Error)]
#[error(
    "`{query}`: {why}; state elements, element_diameter_mm and pitch_diameter_mm in the machine file"
)]
struct NotFound {
    query: String,
    why: Unresolved,
}

/// What a query finds.
enum Answer {
    One(Box<Resolved>),
    Rows(Vec<&'static Row>),
}

/// Prints what the query finds; exit code 2 if that is nothing.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let query = arguments.query.join(" ");
    let speed = arguments.speed.map(Hz);
    let answer = match find(&query) {
        Ok(answer) => answer,
        Err(error) => return super::fail(&error),
    };
    let text = match (arguments.format, &answer) {
        (Format::Text, Answer::One(found)) => one(found, speed),
        (Format::Text, Answer::Rows(rows)) => list(rows, speed),
        (Format::Json, answer) => {
            let document = match answer {
                Answer::One(found) => bearings::resolved(found, speed),
                Answer::Rows(rows) => bearings::rows(rows, speed),
            };
            match serde_json::to_string_pretty(&document) {
                Ok(text) => text + "\n",
                Err(error) => return super::fail(&error),
            }
        }
    };
    super::print(text.as_bytes())
}

/// Resolves a designation, or lists those that begin like it.
fn find(query: &str) -> Result<Answer, NotFound> {
    if query.trim().is_empty() {
        return Ok(Answer::Rows(catalogue::rows().iter().collect()));
    }
    match catalogue::resolve(query) {
        Ok(found) => Ok(Answer::One(Box::new(found))),
        Err(why) => {
            let rows = catalogue::beginning_with(query);
            if rows.is_empty() || matches!(why, Unresolved::DesignNotStated { .. }) {
                Err(NotFound { query: query.to_owned(), why })
            } else {
                Ok(Answer::Rows(rows))
            }
        }
    }
}

/// One bearing in full.
fn one(found: &Resolved, speed: Option<Hz>) -> String {
    let g = &found.geometry;
    let mut text = match found.maker {
        Some(maker) => format!("{maker} {}\n", found.designation),
        None => format!("{}\n", found.designation),
    };
    let mut line = |name: &str, value: String| text.push_str(&format!("  {name:<16}  {value}\n"));
    if let Some(row) = found.rows.first() {
        line("bore, outer", format!("{} mm, {} mm", row.bore_mm, row.outer_mm));
    }
    line("elements", format!("{} of {:.3} mm", g.elements(), g.element_diameter_m() * 1e3));
    line("pitch diameter", format!("{:.3} mm", g.pitch_diameter_m() * 1e3));
    line("contact angle", format!("{:.0}°", g.contact_angle_rad().to_degrees()));
    let orders = g.fault_orders(RotatingRing::Inner);
    let bands = found.bands(RotatingRing::Inner);
    for (name, order, band) in [
        ("BPFO", orders.bpfo, bands.bpfo),
        ("BPFI", orders.bpfi, bands.bpfi),
        ("2·BSF", orders.two_bsf(), bands.two_bsf),
        ("FTF", orders.ftf, bands.ftf),
    ] {
        let rate = speed.map_or(String::new(), |speed| format!("  {:10.3} Hz", order * speed.0));
        line(name, format!("{order:8.4} ×{rate}  {}", catalogue::percent(band)));
    }
    line("status", found.status().name().to_owned());
    line("sources", found.sources().join(", "));
    if !found.ignored.is_empty() {
        line("ignored", found.ignored());
    }
    for remark in &found.remarks {
        line("remark", remark.clone());
    }
    text
}

/// Rows as a table, one line each.
fn list(rows: &[&Row], speed: Option<Hz>) -> String {
    let unit = if speed.is_some() { "Hz" } else { "multiples" };
    let mut text = format!(
        "{:<11} {:>5} {:>5} {:>6} {:>8} {:>8} {:>6}  {:>9} {:>9} {:>9} {:>9}  {:<9} {}\n",
        "designation",
        "bore",
        "outer",
        "n",
        "d mm",
        "D mm",
        "angle",
        "BPFO",
        "BPFI",
        "2·BSF",
        "FTF",
        "status",
        "makers"
    );
    let factor = speed.map_or(1.0, |speed| speed.0);
    for row in rows {
        let g = &row.geometry;
        let FaultOrders { ftf, bpfo, bpfi, .. } = g.fault_orders(RotatingRing::Inner);
        let two_bsf = g.fault_orders(RotatingRing::Inner).two_bsf();
        let n = match row.elements_pm {
            0 => g.elements().to_string(),
            pm => format!("{}±{pm}", g.elements()),
        };
        text.push_str(&format!(
            "{:<11} {:>5} {:>5} {n:>6} {:>8.3} {:>8.3} {:>5.0}°  {:>9.4} {:>9.4} {:>9.4} {:>9.4}  {:<9} {}\n",
            row.designation,
            row.bore_mm,
            row.outer_mm,
            g.element_diameter_m() * 1e3,
            g.pitch_diameter_m() * 1e3,
            g.contact_angle_rad().to_degrees(),
            bpfo * factor,
            bpfi * factor,
            two_bsf * factor,
            ftf * factor,
            row.status.name(),
            row.makers.join(", "),
        ));
    }
    text.push_str(&format!(
        "{} designs; lines as {unit}; rotorwatch bearings DESIGNATION gives limits and sources\n",
        rows.len()
    ));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(query: &str) -> usize {
        match find(query) {
            Ok(Answer::Rows(rows)) => rows.len(),
            Ok(Answer::One(_)) | Err(_) => 0,
        }
    }

    #[test]
    fn a_whole_designation_is_resolved_and_a_beginning_lists() {
        let Ok(Answer::One(found)) = find("SKF 6205-2RSH/C3") else { panic!("not resolved") };
        let text = one(&found, Some(Hz(10.0)));
        for words in
            ["SKF 6205\n", "9 of 7.938 mm", "±0.4 %", "35.722 Hz", "2RSH (seal)", "confirmed"]
        {
            assert!(text.contains(words), "{words}: {text}");
        }
        assert_eq!(rows(""), catalogue::rows().len());
        assert!(rows("62") > 20 && rows("NU2") > 20 && rows("nu 3") > 10);
    }

    #[test]
    fn what_is_not_there_names_what_is_near() {
        let error = find("6225").err().unwrap().to_string();
        assert!(error.starts_with("`6225`: not in the catalogue (nearest: "), "{error}");
        assert!(find("NU 205").err().unwrap().to_string().contains("NU205E"));
    }

    #[test]
    fn a_list_is_one_line_a_design() {
        let found = catalogue::beginning_with("6203");
        let text = list(&found, None);
        assert_eq!(text.lines().count(), found.len() + 2);
        assert!(text.lines().nth(1).unwrap().ends_with("SKF"), "{text}");
    }
}
