//! Smallest, mean and largest value of each minute of an hour, or of each hour of a day.

use super::FeatureName;
#[cfg(test)]
use crate::units::Unit;
use std::sync::Arc;

/// Columns of a feature: number of values, smallest, mean, largest.
pub(super) const WIDTH: usize = 4;

/// What is known of a feature in a stretch of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    pub(super) n: f64,
    pub(super) min: f32,
    pub(super) sum: f64,
    pub(super) max: f32,
}

impl Cell {
    const EMPTY: Self = Self { n: 0.0, min: f32::INFINITY, sum: 0.0, max: f32::NEG_INFINITY };

    fn of(value: f32) -> Self {
        Self { n: 1.0, min: value, sum: f64::from(value), max: value }
    }

    /// Takes in another stretch; NaN proves nothing.
    fn add(&mut self, other: Self) {
        if other.n > 0.0 && !other.sum.is_nan() {
            self.n += other.n;
            self.sum += other.sum;
            self.min = self.min.min(other.min);
            self.max = self.max.max(other.max);
        }
    }

    /// Number, smallest, mean, largest.
    fn columns(self) -> [f32; WIDTH] {
        if self.n <= 0.0 {
            return [0.0, f32::NAN, f32::NAN, f32::NAN];
        }
        #[expect(clippy::cast_possible_truncation, reason = "what is stored is f32")]
        let (n, mean) = (self.n as f32, (self.sum / self.n) as f32);
        // The mean of equal values is that value, whatever the rounding of the sum.
        [n, self.min, mean.clamp(self.min, self.max), self.max]
    }
}

/// The stretches of a block as they are gathered.
#[derive(Debug, Clone)]
pub(super) struct Gathering {
    n_places: usize,
    features: Vec<FeatureName>,
    /// By feature, then by place.
    cells: Vec<Vec<Cell>>,
}

impl Gathering {
    pub(super) fn new(n_places: usize) -> Self {
        Self { n_places, features: Vec::new(), cells: Vec::new() }
    }

    fn feature(&mut self, (name, unit): &FeatureName) -> &mut [Cell] {
        let known = self.features.iter().position(|(n, u)| n == name && u == unit);
        let at = known.unwrap_or_else(|| {
            self.features.push((Arc::clone(name), *unit));
            self.cells.push(vec![Cell::EMPTY; self.n_places]);
            self.cells.len() - 1
        });
        &mut self.cells[at]
    }

    /// Adds plain values at one place.
    pub(super) fn add_values(&mut self, place: usize, feature: &FeatureName, values: &[f32]) {
        if let Some(cell) = self.feature(feature).get_mut(place) {
            values.iter().filter(|value| !value.is_nan()).for_each(|v| cell.add(Cell::of(*v)));
        }
    }

    /// Adds the stretches of a finer block, all at one place.
    pub(super) fn add_block(
        &mut self,
        place: usize,
        features: &[FeatureName],
        columns: &[Vec<f32>],
    ) {
        for (feature, columns) in features.iter().zip(columns.chunks_exact(WIDTH)) {
            let [n, min, mean, max] = columns else { continue };
            let Some(cell) = self.feature(feature).get_mut(place) else { continue };
            for (((n, min), mean), max) in n.iter().zip(min).zip(mean).zip(max) {
                let n = f64::from(*n);
                cell.add(Cell { n, min: *min, sum: f64::from(*mean) * n, max: *max });
            }
        }
    }

    /// Features and their columns, [`WIDTH`] each.
    pub(super) fn finish(self) -> (Vec<FeatureName>, Vec<Vec<f32>>) {
        let columns = self.cells.iter().flat_map(|cells| {
            let written: Vec<[f32; WIDTH]> = cells.iter().map(|cell| cell.columns()).collect();
            (0..WIDTH).map(move |part| written.iter().map(|cell| cell[part]).collect())
        });
        let columns = columns.collect();
        (self.features, columns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Hours of minutes say what hours of the windows themselves would.
        #[test]
        fn two_steps_keep_extremes_and_number(
            minutes in prop::collection::vec(prop::collection::vec(-1e3_f32..1e3, 0..13), 1..60),
        ) {
            let rms = (Arc::from("rms"), Unit::One);
            let (mut at_once, mut hour) = (Gathering::new(1), Gathering::new(60));
            for (place, values) in minutes.iter().enumerate() {
                at_once.add_values(0, &rms, values);
                hour.add_values(place, &rms, values);
            }
            let (features, columns) = hour.finish();
            let mut day = Gathering::new(24);
            day.add_block(3, &features, &columns);
            let (_, day) = day.finish();
            let (_, once) = at_once.finish();
            if let (Some(day), Some(once)) = (day.get(..4), once.get(..4)) {
                for part in [0, 1, 3] {
                    prop_assert_eq!(day[part][3].to_bits(), once[part][0].to_bits());
                }
                let (a, b) = (day[2][3], once[2][0]);
                prop_assert!(a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-3, "{} {}", a, b);
                prop_assert!(day[0][4] == 0.0 && day[1][4].is_nan());
            }
        }
    }
}
