//! Rows of the suite's table: what was asked, what is right, what was found, how far apart the two may be and why.

use crate::bench::table::{Cell, Column};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use std::collections::BTreeMap;

/// One comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    name: &'static str,
    parameters: String,
    metric: &'static str,
    right: f64,
    found: f64,
    /// Allowed distance of the two.
    tolerance: f64,
    reason: &'static str,
}

impl Row {
    /// Found within `tolerance` of what is right.
    #[must_use]
    pub fn new(
        name: &'static str,
        parameters: impl Into<String>,
        right: f64,
        found: f64,
        tolerance: f64,
    ) -> Self {
        let metric = "distance from the reference";
        Self { name, parameters: parameters.into(), metric, right, found, tolerance, reason: "" }
    }

    /// An error that must stay below a limit.
    #[must_use]
    pub fn below(
        name: &'static str,
        parameters: impl Into<String>,
        found: f64,
        limit: f64,
    ) -> Self {
        Self { metric: "relative error", ..Self::new(name, parameters, 0.0, found, limit) }
    }

    /// The same, measured in other terms.
    #[must_use]
    pub fn in_terms_of(self, metric: &'static str) -> Self {
        Self { metric, ..self }
    }

    /// The same with the reason of its tolerance.
    #[must_use]
    pub fn because(self, reason: &'static str) -> Self {
        Self { reason, ..self }
    }

    /// The same with this reason unless it has one.
    #[must_use]
    pub fn usually_because(self, reason: &'static str) -> Self {
        if self.reason.is_empty() { self.because(reason) } else { self }
    }

    /// Whether it holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.measured() <= self.tolerance
    }

    fn measured(&self) -> f64 {
        (self.found - self.right).abs()
    }

    /// How many times smaller than allowed; infinite where nothing is off.
    fn margin(&self) -> f64 {
        if self.measured() > 0.0 { self.tolerance / self.measured() } else { f64::INFINITY }
    }

    /// The columns of the table.
    pub const COLUMNS: [Column; 10] = [
        Column { name: "case", width: 40 },
        Column { name: "parameters", width: 40 },
        Column { name: "metric", width: 0 },
        Column { name: "reference", width: 16 },
        Column { name: "found", width: 16 },
        Column { name: "tolerance", width: 8 },
        Column { name: "reason", width: 0 },
        Column { name: "measured", width: 8 },
        Column { name: "margin", width: 7 },
        Column { name: "pass", width: 4 },
    ];

    /// What stands in them.
    #[must_use]
    pub fn cells(&self) -> Vec<Cell> {
        vec![
            Cell::Text(self.name.to_owned()),
            Cell::Text(self.parameters.clone()),
            Cell::Text(self.metric.to_owned()),
            Cell::Number(self.right, 9),
            Cell::Number(self.found, 9),
            Cell::Number(self.tolerance, 1),
            Cell::Text(self.reason.to_owned()),
            Cell::Number(self.measured(), 1),
            Cell::Plain(self.margin(), 1),
            Cell::Flag(self.holds()),
        ]
    }
}

/// The part of what is allowed that rows use up, of each metric in the order of their size; rows that are exact have no
/// place on the axis.
#[must_use]
pub fn plot(rows: &[Vec<Cell>]) -> Option<String> {
    let mut parts: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for row in rows {
        let [
            _,
            _,
            Cell::Text(metric),
            _,
            _,
            Cell::Number(tolerance, _),
            _,
            Cell::Number(measured, _),
            ..,
        ] = &row[..]
        else {
            continue;
        };
        let part = measured / tolerance;
        if part > 0.0 && part.is_finite() {
            parts.entry(metric).or_default().push(part);
        }
    }
    let longest = parts.values().map(Vec::len).max()?;
    let allowed = vec![(1.0, 1.0), (longest as f64, 1.0)];
    let mut series = vec![Series { name: "allowed".to_owned(), points: allowed }];
    for (metric, mut parts) in parts {
        parts.sort_by(f64::total_cmp);
        let points = (1_u32..).map(f64::from).zip(parts).collect();
        series.push(Series { name: metric.to_owned(), points });
    }
    let words = Words {
        title: "Stability: part of what is allowed",
        x: "rows, by their size",
        y: "measured ÷ allowed",
    };
    log_log::log_log(&words, &series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_drawn_by_the_part_they_use_up() {
        let rows = [("b", 0.5), ("a", 2.0), ("exact", 0.0)];
        let rows = rows.map(|(name, found)| Row::below(name, "", found, 1.0).cells());
        let svg = plot(&rows).unwrap();
        assert!(svg.contains("allowed") && svg.contains("relative error"), "{svg}");
        // Two of the limit, two of rows, and one each in the legend.
        assert_eq!(svg.matches("<circle").count(), 6, "{svg}");
        assert_eq!(plot(&rows[2..]), None);
    }
}
