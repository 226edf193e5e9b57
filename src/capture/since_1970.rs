//! Times counted from 1970 on: which unit numbers of their size are in.

/// Numbers from here on are no seconds: as such they would lie beyond the year 5000.
const LEAST: f64 = 1e11;

/// Powers of ten that a time of this century has in each unit, and the unit, ns.
const UNITS: [(f64, i64); 3] = [(1e14, 1_000_000), (1e17, 1_000), (1e20, 1)];

/// Nanoseconds in the unit of a time since 1970, told by its magnitude: ms, µs or ns.
///
/// `stated_s`: the unit that is written beside the times, s; one that does not fit the magnitude
/// makes it a time since another event. `None` for that, and for numbers that may be seconds.
pub(super) fn unit_ns(time: f64, stated_s: Option<f64>) -> Option<i64> {
    let unit = |limit: &&(f64, i64)| time < limit.0;
    let (_, unit_ns) = UNITS.iter().find(unit).filter(|_| time >= LEAST)?;
    let fits = |stated_s: f64| (stated_s * 1e9 / *unit_ns as f64 - 1.0).abs() < 1e-6;
    stated_s.is_none_or(fits).then_some(*unit_ns)
}

/// Name of a unit of [`unit_ns`].
pub(super) fn name(unit_ns: i64) -> &'static str {
    match unit_ns {
        1_000_000 => "ms",
        1_000 => "µs",
        _ => "ns",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_magnitude_tells_the_unit() {
        for (time, stated_s, unit) in [
            (1.7e12, None, Some(1_000_000)),
            (1.7e15, None, Some(1_000)),
            (1.7e18, None, Some(1)),
            (1.7e18, Some(1e-9), Some(1)),
            (1.7e9, None, None),
            (f64::NAN, None, None),
            (2e11, Some(1e-9), None), // 200 s, counted from anywhere
        ] {
            assert_eq!(unit_ns(time, stated_s), unit, "{time}");
        }
    }
}
