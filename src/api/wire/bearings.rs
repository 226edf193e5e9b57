//! Bearings of the catalogue as JSON: what `rotorwatch bearings --format json` prints.

use super::finite;
use crate::machine::bearing::BearingGeometry;
use crate::machine::bearing::FaultOrders;
use crate::machine::bearing::RotatingRing;
use crate::machine::catalogue::Resolved;
use crate::machine::catalogue::Row;
use crate::machine::catalogue::Status;
use crate::machine::uncertainty::Design;
use crate::machine::uncertainty::OrderBands;
use crate::machine::uncertainty::RelativeBand;
use crate::units::Hz;
use serde::Serialize;

/// Name and version of the document.
const SCHEMA: &str = "rotorwatch.bearings/1";

/// One document: the bearings asked for.
#[derive(Debug, Serialize)]
pub struct Bearings {
    /// `rotorwatch.bearings/1`.
    pub schema: &'static str,
    /// A designation's answer, or the rows of the catalogue.
    pub bearings: Vec<Bearing>,
}

/// One bearing.
#[derive(Debug, Serialize)]
pub struct Bearing {
    /// Basic designation.
    pub designation: String,
    /// Maker named in the question; `null` if none, and for rows.
    pub maker: Option<&'static str>,
    /// `confirmed`, `derived` or `estimated`.
    pub status: &'static str,
    /// Makers whose data it rests on.
    pub makers: Vec<&'static str>,
    /// Keys of `docs/references.bib`.
    pub sources: Vec<&'static str>,
    /// Bore, mm.
    pub bore_mm: Option<f64>,
    /// Outer diameter, mm.
    pub outer_mm: Option<f64>,
    /// Number of rolling elements.
    pub elements: u32,
    /// Their diameter, mm.
    pub element_diameter_mm: Option<f64>,
    /// Pitch diameter, mm.
    pub pitch_diameter_mm: Option<f64>,
    /// Contact angle, degrees.
    pub contact_angle_deg: Option<f64>,
    /// The lines.
    pub lines: Vec<Line>,
    /// What of the designation was ignored, in words.
    pub ignored: Vec<String>,
    /// Choices made, and why the limits are as wide as they are.
    pub remarks: Vec<String>,
}

/// One line, the outer ring standing.
#[derive(Debug, Serialize)]
pub struct Line {
    /// `bpfo`, `bpfi`, `2bsf` or `ftf`.
    pub line: &'static str,
    /// Multiple of the shaft speed.
    pub order: Option<f64>,
    /// Lowest multiple the geometry leaves.
    pub order_min: Option<f64>,
    /// Highest multiple the geometry leaves.
    pub order_max: Option<f64>,
    /// Rate at the speed asked for, Hz; `null` without one.
    pub frequency_hz: Option<f64>,
}

/// The document of a designation that was resolved.
#[must_use]
pub fn resolved(found: &Resolved, speed: Option<Hz>) -> Bearings {
    let first = found.rows.first();
    let makers: std::collections::BTreeSet<&str> =
        found.rows.iter().flat_map(|row| row.makers.clone()).collect();
    let bands = found.bands(RotatingRing::Inner);
    let bearing = Bearing {
        designation: found.designation.clone(),
        maker: found.maker,
        bore_mm: first.and_then(|row| finite(row.bore_mm)),
        outer_mm: first.and_then(|row| finite(row.outer_mm)),
        makers: makers.into_iter().collect(),
        sources: found.sources(),
        ignored: found.ignored.iter().map(|part| part.text.clone()).collect(),
        remarks: found.remarks.clone(),
        ..inside(&found.geometry, found.status(), &bands, speed)
    };
    Bearings { schema: SCHEMA, bearings: vec![bearing] }
}

/// The document of rows of the catalogue.
#[must_use]
pub fn rows(rows: &[&Row], speed: Option<Hz>) -> Bearings {
    let of_row = |row: &&Row| {
        let design = Design {
            geometry: row.geometry,
            elements_pm: row.elements_pm,
            gamma_relative: row.gamma_relative,
        };
        let bands = OrderBands::around(&row.geometry, RotatingRing::Inner, &[design]);
        Bearing {
            designation: row.designation.to_owned(),
            bore_mm: finite(row.bore_mm),
            outer_mm: finite(row.outer_mm),
            makers: row.makers.clone(),
            sources: row.sources.clone(),
            ..inside(&row.geometry, row.status, &bands, speed)
        }
    };
    Bearings { schema: SCHEMA, bearings: rows.iter().map(of_row).collect() }
}

/// What follows from the geometry; the rest empty.
fn inside(
    geometry: &BearingGeometry,
    status: Status,
    bands: &OrderBands,
    speed: Option<Hz>,
) -> Bearing {
    Bearing {
        designation: String::new(),
        maker: None,
        status: status.name(),
        makers: Vec::new(),
        sources: Vec::new(),
        bore_mm: None,
        outer_mm: None,
        elements: geometry.elements(),
        element_diameter_mm: finite(rounded(geometry.element_diameter_m() * 1e3)),
        pitch_diameter_mm: finite(rounded(geometry.pitch_diameter_m() * 1e3)),
        contact_angle_deg: finite(rounded(geometry.contact_angle_rad().to_degrees())),
        lines: lines(&geometry.fault_orders(RotatingRing::Inner), bands, speed),
        ignored: Vec::new(),
        remarks: Vec::new(),
    }
}

/// Takes away what the conversion of units left behind the sixth decimal.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn lines(orders: &FaultOrders, bands: &OrderBands, speed: Option<Hz>) -> Vec<Line> {
    let line = |line, order: f64, band: RelativeBand| Line {
        line,
        order: finite(order),
        order_min: finite(order * (1.0 + band.low)),
        order_max: finite(order * (1.0 + band.high)),
        frequency_hz: speed.and_then(|speed| finite(order * speed.0)),
    };
    vec![
        line("bpfo", orders.bpfo, bands.bpfo),
        line("bpfi", orders.bpfi, bands.bpfi),
        line("2bsf", orders.two_bsf(), bands.two_bsf),
        line("ftf", orders.ftf, bands.ftf),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::catalogue;

    #[test]
    fn a_resolved_bearing_has_lines_with_limits() {
        let found = catalogue::resolve("SKF 6205-2RSH/C3").unwrap();
        let document = serde_json::to_value(resolved(&found, Some(Hz(10.0)))).unwrap();
        assert_eq!(document["schema"], SCHEMA);
        let bearing = &document["bearings"][0];
        assert_eq!(bearing["elements"], 9);
        assert_eq!(bearing["ignored"], serde_json::json!(["2RSH", "C3"]));
        let bpfo = &bearing["lines"][0];
        let number = |key: &str| bpfo[key].as_f64().unwrap();
        assert!(number("order_min") < number("order") && number("order") < number("order_max"));
        assert!((number("frequency_hz") - 10.0 * number("order")).abs() < 1e-9);
    }

    #[test]
    fn rows_are_one_bearing_each() {
        let found = catalogue::beginning_with("62");
        let document = rows(&found, None);
        assert_eq!(document.bearings.len(), found.len());
        assert!(document.bearings.iter().all(|b| b.lines[0].frequency_hz.is_none()));
    }
}
