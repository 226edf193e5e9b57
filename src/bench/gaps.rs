//! How far results are from what is right. Must not know what they are results of.

/// Largest magnitude, 0 of nothing; infinite if one is no number, which `f64::max` passes over.
#[must_use]
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let magnitude = |x: f64| if x.is_nan() { f64::INFINITY } else { x.abs() };
    values.into_iter().map(magnitude).fold(0.0, f64::max)
}

/// Largest difference of two lists over the largest magnitude of the second; infinite if either holds what is no
/// number, or the first has something where the second is nothing but zeros.
///
/// # Panics
///
/// If they differ in length.
#[must_use]
pub fn relative(found: &[f64], right: &[f64]) -> f64 {
    assert_eq!(found.len(), right.len(), "one result each");
    let gap = largest(found.iter().zip(right).map(|(a, b)| a - b));
    let size = largest(right.iter().copied());
    match (gap > 0.0, size.is_finite()) {
        (_, false) => f64::INFINITY,
        (false, true) => 0.0,
        (true, true) => gap / size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_infinitely_wrong() {
        let nothing: [f64; 0] = [];
        for (found, expected) in [
            (largest([1.0, -3.0, 2.0]), 3.0),
            (largest([1.0, f64::NAN, 2.0]), f64::INFINITY),
            (largest(nothing), 0.0),
            (relative(&[1.0, 2.5], &[1.0, 2.0]), 0.25),
            (relative(&[f64::NAN, 2.0], &[1.0, 2.0]), f64::INFINITY),
            (relative(&[1.0, 2.0], &[f64::NAN, 2.0]), f64::INFINITY),
            (relative(&[1.0, 2.0], &[1.0, f64::INFINITY]), f64::INFINITY),
            (relative(&[0.0], &[0.0]), 0.0),
            (relative(&[1e-9], &[0.0]), f64::INFINITY),
        ] {
            assert_eq!(found.to_bits(), expected.to_bits(), "{found} {expected}");
        }
    }
}
