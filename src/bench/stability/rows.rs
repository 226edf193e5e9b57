//! Rows of the suite's table: what was asked, what is right, what was found.

use crate::bench::table::{Cell, Column};

/// One comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    name: &'static str,
    parameters: String,
    right: f64,
    found: f64,
    /// Allowed distance of the two.
    tolerance: f64,
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
        Self { name, parameters: parameters.into(), right, found, tolerance }
    }

    /// An error that must stay below a limit.
    #[must_use]
    pub fn below(
        name: &'static str,
        parameters: impl Into<String>,
        found: f64,
        limit: f64,
    ) -> Self {
        Self::new(name, parameters, 0.0, found, limit)
    }

    /// Whether it holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        (self.found - self.right).abs() <= self.tolerance
    }

    /// The columns of the table.
    pub const COLUMNS: [Column; 6] = [
        Column { name: "case", width: 40 },
        Column { name: "parameters", width: 40 },
        Column { name: "reference", width: 16 },
        Column { name: "found", width: 16 },
        Column { name: "tolerance", width: 8 },
        Column { name: "pass", width: 4 },
    ];

    /// What stands in them.
    #[must_use]
    pub fn cells(&self) -> Vec<Cell> {
        vec![
            Cell::Text(self.name.to_owned()),
            Cell::Text(self.parameters.clone()),
            Cell::Number(self.right, 9),
            Cell::Number(self.found, 9),
            Cell::Number(self.tolerance, 1),
            Cell::Flag(self.holds()),
        ]
    }
}
