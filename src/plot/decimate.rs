//! Thinning of long columns for pictures, so that no extreme is lost.

/// Gives the places to keep so that at most `max_points` (≥ 2) are left and each stretch keeps its
/// smallest and its largest value; rising. Values that are not finite are passed over.
#[must_use]
pub fn min_max(n: usize, max_points: usize, value: impl Fn(usize) -> f64) -> Vec<usize> {
    if n <= max_points {
        return (0..n).collect();
    }
    stretches(n, max_points / 2)
        .flat_map(|stretch| {
            let lowest = extreme(stretch.clone(), |i| -value(i));
            let highest = extreme(stretch, &value);
            match (lowest, highest) {
                (Some(a), Some(b)) if a != b => [Some(a.min(b)), Some(a.max(b))],
                (one, _) => [one, None],
            }
        })
        .flatten()
        .collect()
}

/// Gives the place of the largest value of each of at most `max_points` (≥ 1) stretches.
#[must_use]
pub fn peaks(n: usize, max_points: usize, value: impl Fn(usize) -> f64) -> Vec<usize> {
    if n <= max_points {
        return (0..n).collect();
    }
    stretches(n, max_points).filter_map(|stretch| extreme(stretch, &value)).collect()
}

/// Splits `0..n` into `count` stretches whose lengths differ by at most one.
fn stretches(n: usize, count: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    let (short, longer) = (n / count, n % count);
    let border = move |i: usize| i * short + i.min(longer);
    (0..count).map(move |i| border(i)..border(i + 1))
}

/// Gives the place of the first largest finite value.
fn extreme(stretch: std::ops::Range<usize>, value: impl Fn(usize) -> f64) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for i in stretch {
        let candidate = value(i);
        if candidate.is_finite() && best.is_none_or(|(_, v)| candidate > v) {
            best = Some((i, candidate));
        }
    }
    best.map(|(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn short_columns_stay_whole() {
        assert_eq!(min_max(3, 3, |_| f64::NAN), [0, 1, 2]);
        assert_eq!(peaks(0, 5, |_| 0.0), [] as [usize; 0]);
    }

    #[test]
    fn a_single_spike_survives_any_thinning() {
        let spike = |i: usize| if i == 54_321 { 1.0 } else { 0.0 };
        assert!(min_max(100_000, 200, spike).contains(&54_321));
        assert!(min_max(100_000, 200, |i| -spike(i)).contains(&54_321));
        assert!(peaks(100_000, 7, spike).contains(&54_321));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn places_rise_fit_and_keep_both_extremes(
            values in prop::collection::vec(-1e3_f64..1e3, 1..500),
            max_points in 2_usize..100,
        ) {
            let kept = min_max(values.len(), max_points, |i| values[i]);
            prop_assert!(kept.len() <= max_points);
            prop_assert!(kept.windows(2).all(|w| w[0] < w[1]));
            let highest = values.iter().copied().fold(f64::MIN, f64::max);
            let lowest = values.iter().copied().fold(f64::MAX, f64::min);
            prop_assert!(kept.iter().any(|i| values[*i] >= highest));
            prop_assert!(kept.iter().any(|i| values[*i] <= lowest));
            let tops = peaks(values.len(), max_points, |i| values[i]);
            prop_assert!(tops.len() <= max_points && tops.iter().any(|i| values[*i] >= highest));
        }
    }
}
