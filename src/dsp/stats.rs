//! Order statistics, and the mean; moments stand in [`crate::dsp::moments`].
//!
//! Says how strong and how impulsive a signal is. Must not know what the samples mean.

use std::cmp::Ordering;

use crate::dsp::moments;
pub use crate::dsp::moments::Moments;
use crate::dsp::real::Real;
use crate::dsp::real::floor_index;

/// Ratio of a Gaussian's standard deviation to its median absolute deviation, 1/Φ⁻¹(3/4).
pub const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// Computes the mean in f64; `None` for no samples.
#[must_use]
pub fn mean<T: Real>(x: &[T]) -> Option<f64> {
    let first = x.first()?.to_f64();
    Some(first + moments::sum_shifted(x, first) / x.len() as f64)
}

/// Computes the RMS with the mean removed, u; `None` for no samples.
#[must_use]
pub fn rms<T: Real>(x: &[T]) -> Option<f64> {
    Moments::of(x).rms()
}

/// Computes the quantile `q` (0…1, clamped) with linear interpolation between order statistics
/// (type 7 of Hyndman & Fan 1996); reorders `values`; `None` for no values.
#[must_use]
pub fn quantile<T: Real>(values: &mut [T], q: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = floor_index(position).min(last);
    let (_, &mut low, above) = values.select_nth_unstable_by(below, compare);
    let high = above.iter().copied().fold(None, |least: Option<T>, value| match least {
        Some(least) if compare(&least, &value).is_le() => Some(least),
        _ => Some(value),
    });
    let fraction = position - below as f64;
    let (low, high) = (low.to_f64(), high.unwrap_or(low).to_f64());
    Some(T::rounded(low + fraction * (high - low)))
}

/// Computes the median; reorders `values`; `None` for no values.
#[must_use]
pub fn median<T: Real>(values: &mut [T]) -> Option<T> {
    quantile(values, 0.5)
}

/// Computes the median absolute deviation from the median, in the unit of the values (multiply by
/// [`SIGMA_PER_MAD`] for a Gaussian's standard deviation); overwrites `values`; `None` for none.
#[must_use]
pub fn mad<T: Real>(values: &mut [T]) -> Option<T> {
    let centre = median(values)?;
    for value in &mut *values {
        *value = (*value - centre).abs();
    }
    median(values)
}

fn compare<T: Real>(a: &T, b: &T) -> Ordering {
    a.partial_cmp(b).unwrap_or(Ordering::Equal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_statistics_of_known_sets() {
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(median(&mut [2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(quantile(&mut [5.0, 1.0, 3.0], 0.0), Some(1.0));
        assert_eq!(quantile(&mut [5.0, 1.0, 3.0], 1.0), Some(5.0));
        assert_eq!(quantile(&mut [0.0, 10.0], 0.25), Some(2.5));
        assert_eq!(mad(&mut [1.0, 1.0, 2.0, 2.0, 4.0, 6.0, 9.0]), Some(1.0));
    }
}
