//! Every JSON type of the program, and no other module derives `Serialize`.
//!
//! Each type is made from domain values in its own file. Numbers that are not finite never reach
//! JSON: [`finite`] turns them into an explicit `null`. Columns, not rows: series are arrays of
//! equal length. Times are RFC 3339 in documents and seconds of stream time in arrays.

mod names;
pub mod diagnosis;
pub mod evidence;
pub mod evaluation;
pub mod bearings;
pub mod maintenance;
pub mod machines;
pub mod parts;
pub mod signals;
pub mod joint;
pub mod orbit;
pub mod alarms;
pub mod audit;
pub mod events;
pub mod backup;
pub mod captures;
pub mod feedback;
pub mod baselines;
pub mod problem;
pub mod recordings;
pub mod silences;
pub mod system;
pub mod simulation;
pub mod ingest;
pub mod rerun;
mod tooth;

pub use names::*;

use crate::signal::Timestamp;

/// Gives the number as JSON can hold it; `None` (`null`) for NaN and infinities.
#[must_use]
pub fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Does [`finite`] for a column.
#[must_use]
pub fn finite_column(values: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
    values.into_iter().map(finite).collect()
}

/// Gives stream time as RFC 3339; counted from 1970-01-01 when the start of the stream is unknown.
#[must_use]
pub fn rfc3339(start: Option<Timestamp>, stream_time_s: f64) -> String {
    let time = start.unwrap_or_default().plus_seconds(stream_time_s);
    // Every i64 of nanoseconds lies inside jiff's years −9999…9999.
    jiff::Timestamp::from_nanosecond(i128::from(time.0)).unwrap_or_default().to_string()
}

/// Reads RFC 3339; `None`: it is none, or of another age.
#[must_use]
pub fn timestamp(text: &str) -> Option<Timestamp> {
    let time = text.parse::<jiff::Timestamp>().ok()?;
    i64::try_from(time.as_nanosecond()).ok().map(Timestamp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_finite_is_null() {
        let column = finite_column([1.5, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
        assert_eq!(serde_json::to_string(&column).unwrap(), "[1.5,null,null,null]");
    }

    #[test]
    fn stream_time_becomes_rfc3339() {
        assert_eq!(rfc3339(None, 90.5), "1970-01-01T00:01:30.5Z");
        let start = Timestamp(1_700_000_000_000_000_000);
        assert_eq!(rfc3339(Some(start), 0.25), "2023-11-14T22:13:20.25Z");
        // Both ends of the range are still dates.
        assert!(rfc3339(Some(Timestamp(i64::MAX)), 1e300).starts_with("2262-"));
        assert!(rfc3339(Some(Timestamp(i64::MIN)), -1e300).starts_with("1677-"));
    }
}
