//! Ranges of numbers and their wording.

use std::fmt;
use std::ops::Bound;

/// Numbers that a key allows; never NaN or infinite.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NumberRange {
    low: Bound<f64>,
    high: Bound<f64>,
}

impl NumberRange {
    /// 0 < x ≤ `high`.
    pub(crate) const fn positive_up_to(high: f64) -> Self {
        Self { low: Bound::Excluded(0.0), high: Bound::Included(high) }
    }

    /// `low` ≤ x ≤ `high`.
    pub(crate) const fn closed(low: f64, high: f64) -> Self {
        Self { low: Bound::Included(low), high: Bound::Included(high) }
    }

    /// `low` ≤ x < `high`.
    pub(crate) const fn from_to_below(low: f64, high: f64) -> Self {
        Self { low: Bound::Included(low), high: Bound::Excluded(high) }
    }

    pub(crate) fn contains(self, value: f64) -> bool {
        let above = match self.low {
            Bound::Included(low) => value >= low,
            Bound::Excluded(low) => value > low,
            Bound::Unbounded => true,
        };
        let below = match self.high {
            Bound::Included(high) => value <= high,
            Bound::Excluded(high) => value < high,
            Bound::Unbounded => true,
        };
        value.is_finite() && above && below
    }
}

impl fmt::Display for NumberRange {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("a number")?;
        match self.low {
            Bound::Included(low) => write!(out, " from {low}")?,
            Bound::Excluded(low) => write!(out, " above {low}")?,
            Bound::Unbounded => {}
        }
        match (self.low, self.high) {
            (Bound::Excluded(_), Bound::Included(high)) => write!(out, " and up to {high}"),
            (_, Bound::Included(high)) => write!(out, " to {high}"),
            (_, Bound::Excluded(high)) => write!(out, " to below {high}"),
            (_, Bound::Unbounded) => Ok(()),
        }
    }
}
