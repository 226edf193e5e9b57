//! Rows of the suite's table: what was asked, what is right, what was found.

/// One comparison.
pub(crate) struct Row {
    name: &'static str,
    parameters: String,
    right: f64,
    found: f64,
    /// Allowed distance of the two.
    tolerance: f64,
}

impl Row {
    pub(crate) fn new(
        name: &'static str,
        parameters: impl Into<String>,
        right: f64,
        found: f64,
        tolerance: f64,
    ) -> Self {
        Self { name, parameters: parameters.into(), right, found, tolerance }
    }

    /// An error that must stay below a limit.
    pub(crate) fn below(
        name: &'static str,
        parameters: impl Into<String>,
        found: f64,
        limit: f64,
    ) -> Self {
        Self::new(name, parameters, 0.0, found, limit)
    }

    fn holds(&self) -> bool {
        (self.found - self.right).abs() <= self.tolerance
    }
}

/// Prints the rows, and fails if one of them does not hold.
#[expect(clippy::print_stdout, reason = "the table is what the suite is for")]
pub(crate) fn hold(rows: &[Row]) {
    println!("{:<44} {:<40} {:>16} {:>16} {:>9}", "case", "parameters", "right", "found", "within");
    for row in rows {
        let Row { name, parameters, right, found, tolerance } = row;
        let mark = if row.holds() { "" } else { "  <-- no" };
        println!(
            "{name:<44} {parameters:<40} {right:>16.9e} {found:>16.9e} {tolerance:>9.1e}{mark}"
        );
    }
    let n_missed = rows.iter().filter(|row| !row.holds()).count();
    assert!(!rows.is_empty() && n_missed == 0, "{n_missed} of {} rows do not hold", rows.len());
}
