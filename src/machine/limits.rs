//! Optional limits of a machine.

/// ISO 20816-3 machine group and support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum IsoGroup {
    /// Group 1 on a rigid support.
    Group1Rigid,
    /// Group 1 on a flexible support.
    Group1Flexible,
    /// Group 2 on a rigid support.
    Group2Rigid,
    /// Group 2 on a flexible support.
    Group2Flexible,
}

/// Limits of the `[limits]` table; all optional.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Limits {
    /// Velocity RMS 10–1000 Hz that raises a warning, mm/s.
    pub velocity_rms_warning_mm_per_s: Option<f64>,
    /// Velocity RMS 10–1000 Hz that counts as damaged (danger), mm/s.
    pub velocity_rms_damaged_mm_per_s: Option<f64>,
}
