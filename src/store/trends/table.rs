//! A trend as it is read: times, and columns as long as they.

use super::FeatureName;
use super::block::WIDTH;
use crate::units::Unit;
use std::sync::Arc;

/// Most values (points times features) of one answer.
pub(super) const MAX_VALUES: usize = 8_000_000;

/// A trend.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Ends of windows, or starts of minutes or hours, s from the origin asked for, rising.
    pub time_s: Vec<f64>,
    /// Length of each window, s, NaN for those of other streams than that whose origin was asked for; empty for minutes and hours.
    pub duration_s: Vec<f64>,
    /// One a feature.
    pub columns: Vec<Column>,
    /// Files whose part is missing because they cannot be read, with the reason.
    pub unreadable: Vec<String>,
}

/// A point that is taken of a block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Its place in the block.
    pub(super) place: usize,
    /// Its time.
    pub(super) time_s: f64,
    /// Length of the window; `None`: a minute or an hour.
    pub(super) duration_s: Option<f64>,
}

/// One feature over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name.
    pub name: Arc<str>,
    /// Unit.
    pub unit: Unit,
    /// The value of each window, or the mean of each minute or hour; NaN where there is none.
    pub value: Vec<f32>,
    /// Smallest value of each minute or hour; empty for windows.
    pub low: Vec<f32>,
    /// Largest value of each minute or hour; empty for windows.
    pub high: Vec<f32>,
    /// Number of values of each minute or hour; empty for windows.
    pub n: Vec<f32>,
}

impl Table {
    /// Column of a feature.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| *column.name == *name)
    }

    /// Adds the points of a later table.
    pub fn extend(&mut self, later: &Self) {
        let (n_before, n_more) = (self.time_s.len(), later.time_s.len());
        self.time_s.extend(&later.time_s);
        self.duration_s.extend(&later.duration_s);
        for column in &later.columns {
            let width = if column.n.is_empty() { 1 } else { WIDTH };
            let at = self.columns.iter().position(|held| held.name == column.name);
            let at = at.unwrap_or_else(|| {
                self.columns.push(Column::empty(&column.name, column.unit));
                self.columns.len() - 1
            });
            let held = &mut self.columns[at];
            held.fill(n_before, width);
            held.value.extend(&column.value);
            held.low.extend(&column.low);
            held.high.extend(&column.high);
            held.n.extend(&column.n);
        }
        for column in &mut self.columns {
            let width = if column.n.is_empty() { 1 } else { WIDTH };
            column.fill(n_before + n_more, width);
        }
    }

    /// Adds points. `columns`: `width` a feature, of which `wanted` says which are taken.
    pub(super) fn append(
        &mut self,
        points: &[Point],
        (layout, columns): (&[FeatureName], &[Vec<f32>]),
        width: usize,
        wanted: Option<&[String]>,
    ) {
        let n_before = self.time_s.len();
        self.time_s.extend(points.iter().map(|point| point.time_s));
        self.duration_s.extend(points.iter().filter_map(|point| point.duration_s));
        for ((name, unit), parts) in layout.iter().zip(columns.chunks_exact(width)) {
            if wanted.is_some_and(|wanted| !wanted.iter().any(|w| **w == **name)) {
                continue;
            }
            let at = self.columns.iter().position(|column| column.name == *name);
            let at = at.unwrap_or_else(|| {
                self.columns.push(Column::empty(name, *unit));
                self.columns.len() - 1
            });
            let column = &mut self.columns[at];
            column.fill(n_before, width);
            let take = |into: &mut Vec<f32>, from: &[f32]| {
                let values = points.iter().map(|point| from.get(point.place).copied());
                into.extend(values.map(|value| value.unwrap_or(f32::NAN)));
            };
            match parts {
                [value] => take(&mut column.value, value),
                [n, low, mean, high] => {
                    take(&mut column.n, n);
                    take(&mut column.low, low);
                    take(&mut column.value, mean);
                    take(&mut column.high, high);
                }
                _ => {}
            }
        }
        for column in &mut self.columns {
            column.fill(self.time_s.len(), width);
        }
    }

    /// Lays points by rising time; those of several streams in the same minute or hour become one.
    pub(super) fn settle(&mut self) {
        let mut order: Vec<usize> = (0..self.time_s.len()).collect();
        if self.time_s.is_sorted_by(|a, b| a < b) {
            return;
        }
        order.sort_by(|a, b| self.time_s[*a].total_cmp(&self.time_s[*b]));
        let groups: Vec<Vec<usize>> = order
            .chunk_by(|a, b| self.time_s[*a].total_cmp(&self.time_s[*b]).is_eq())
            .map(<[usize]>::to_vec)
            .collect();
        self.time_s = groups.iter().map(|group| self.time_s[group[0]]).collect();
        // Of several streams the later one holds, as its values do.
        let duration_s = groups.iter().filter_map(|group| self.duration_s.get(*group.last()?));
        self.duration_s = duration_s.copied().collect();
        for column in &mut self.columns {
            column.regroup(&groups);
        }
    }
}

impl Column {
    fn empty(name: &Arc<str>, unit: Unit) -> Self {
        let (value, low, high, n) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { name: Arc::clone(name), unit, value, low, high, n }
    }

    /// Makes the column `n` long.
    fn fill(&mut self, n: usize, width: usize) {
        self.value.resize(n, f32::NAN);
        if width == WIDTH {
            self.low.resize(n, f32::NAN);
            self.high.resize(n, f32::NAN);
            self.n.resize(n, 0.0);
        }
    }

    fn regroup(&mut self, groups: &[Vec<usize>]) {
        let is_coarse = !self.n.is_empty();
        let old = self.clone();
        let fold = |from: &[f32], with: fn(f32, f32) -> f32| -> Vec<f32> {
            if from.is_empty() {
                return Vec::new();
            }
            groups.iter().map(|g| g.iter().map(|p| from[*p]).fold(f32::NAN, with)).collect()
        };
        self.low = fold(&old.low, f32::min);
        self.high = fold(&old.high, f32::max);
        let last = |a: f32, b: f32| if b.is_nan() { a } else { b };
        if !is_coarse {
            self.value = fold(&old.value, last);
            return;
        }
        self.n = groups.iter().map(|g| g.iter().map(|p| old.n[*p]).sum()).collect();
        let mean = |group: &Vec<usize>| {
            let known = group.iter().filter(|p| old.n[**p] > 0.0);
            let (n, sum) = known.fold((0.0, 0.0), |(n, sum), p| {
                let weight = f64::from(old.n[*p]);
                (n + weight, sum + weight * f64::from(old.value[*p]))
            });
            #[expect(clippy::cast_possible_truncation, reason = "columns are f32")]
            let mean = (sum / n) as f32;
            mean
        };
        self.value = groups.iter().map(mean).collect();
    }
}
