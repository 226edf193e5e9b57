//! Features of the last windows, in memory and bounded.

use crate::api::view::Trend;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::store::trends::numbers_of;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::sync::Arc;

/// Windows kept for each channel: four hours at the default hop of 5 s.
pub const MAX_POINTS: usize = 2880;

/// Most features kept for each channel; what comes beyond is left out of the trend.
pub const MAX_COLUMNS: usize = 256;

/// Windows of which the verdicts are kept until the store has them: twenty minutes at the default hop.
const MAX_VERDICTS: usize = 240;

/// Verdicts on the components of a machine; the oldest give way.
#[derive(Debug, Clone, Default)]
pub struct VerdictStore {
    components: BTreeMap<(ComponentKind, String), VecDeque<(f64, Numbers)>>,
}

type Numbers = [(&'static str, f32); 3];

impl VerdictStore {
    /// Adds what was found in a window that ended at `time_s`.
    pub fn push(&mut self, time_s: f64, found: &[ComponentDiagnosis]) {
        for one in found {
            let numbers = numbers_of(one.state, one.severity, one.confidence);
            let of = self.components.entry((one.kind, one.id.clone())).or_default();
            if of.len() == MAX_VERDICTS {
                of.pop_front();
            }
            of.push_back((time_s, numbers));
        }
    }

    /// Copies what was found of a component.
    #[must_use]
    pub fn of(&self, kind: ComponentKind, component: &str) -> Trend {
        let Some(held) = self.components.get(&(kind, component.to_owned())) else {
            return Trend::default();
        };
        let names = held.front().map(|(_, numbers)| numbers.map(|(name, _)| name));
        let column = |(at, name): (usize, &'static str)| {
            let values = held.iter().map(|(_, numbers)| f64::from(numbers[at].1)).collect();
            (name.to_owned(), Unit::One, values)
        };
        Trend {
            time_s: held.iter().map(|(time_s, _)| *time_s).collect(),
            columns: names.into_iter().flatten().enumerate().map(column).collect(),
            n_samples: Vec::new(),
        }
    }
}

/// The trend of one channel; the oldest window gives way.
#[derive(Debug, Clone, Default)]
pub struct TrendStore {
    time_s: VecDeque<f64>,
    /// Samples of each window.
    n_samples: VecDeque<u64>,
    columns: Vec<Column>,
}

/// One feature over time.
#[derive(Debug, Clone)]
struct Column {
    name: Arc<str>,
    unit: Unit,
    /// NaN for a window without the feature.
    values: VecDeque<f64>,
}

impl TrendStore {
    /// Adds the features of a window that ended at `time_s`.
    pub fn push(&mut self, time_s: f64, features: &ChannelFeatures) {
        if self.time_s.len() == MAX_POINTS {
            self.time_s.pop_front();
            self.n_samples.pop_front();
            for column in &mut self.columns {
                column.values.pop_front();
            }
        }
        for feature in &features.values {
            self.add_column(feature);
        }
        self.time_s.push_back(time_s);
        let (first, end) = features.sample_range;
        self.n_samples.push_back(end.saturating_sub(first));
        for column in &mut self.columns {
            let feature = features.values.iter().find(|feature| feature.name == column.name);
            column.values.push_back(feature.map_or(f64::NAN, |feature| feature.value));
        }
    }

    /// The features of the window that ended at `time_s`; `None`: it is not held.
    pub(super) fn at(&self, time_s: f64) -> Option<Vec<Feature>> {
        let place = self.time_s.partition_point(|held| *held < time_s);
        self.time_s.get(place).filter(|held| held.total_cmp(&time_s).is_eq())?;
        let columns = self.columns.iter().map(|column| (column, column.values.get(place)));
        let known =
            columns.filter_map(|(c, value)| Some((c, *value?))).filter(|(_, v)| !v.is_nan());
        Some(
            known
                .map(|(c, value)| Feature { name: Arc::clone(&c.name), value, unit: c.unit })
                .collect(),
        )
    }

    /// Copies the whole trend.
    #[must_use]
    pub fn copy(&self) -> Trend {
        let columns = self.columns.iter();
        Trend {
            time_s: self.time_s.iter().copied().collect(),
            columns: columns
                .map(|c| (c.name.to_string(), c.unit, c.values.iter().copied().collect()))
                .collect(),
            n_samples: self.n_samples.iter().copied().collect(),
        }
    }

    /// Makes a column for a feature that is new, without values before.
    fn add_column(&mut self, feature: &Feature) {
        let is_known = self.columns.iter().any(|column| column.name == feature.name);
        if !is_known && self.columns.len() < MAX_COLUMNS {
            self.columns.push(Column {
                name: Arc::clone(&feature.name),
                unit: feature.unit,
                values: self.time_s.iter().map(|_| f64::NAN).collect(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::ChannelIndex;

    fn window(names_values: &[(&str, f64)]) -> ChannelFeatures {
        let values = names_values
            .iter()
            .map(|&(name, value)| Feature { name: name.into(), value, unit: Unit::One })
            .collect();
        ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values }
    }

    #[test]
    fn columns_stay_as_long_as_time() {
        let mut store = TrendStore::default();
        store.push(5.0, &window(&[("rms", 1.0)]));
        store.push(10.0, &window(&[("rms", 2.0), ("crest", 3.0)]));
        store.push(15.0, &window(&[("crest", 4.0)]));
        let trend = store.copy();
        assert_eq!(trend.time_s, [5.0, 10.0, 15.0]);
        assert_eq!(trend.n_samples, [1; 3]);
        let [(rms, _, rms_values), (crest, _, crest_values)] = &trend.columns[..] else {
            panic!("two columns")
        };
        assert_eq!((rms.as_str(), crest.as_str()), ("rms", "crest"));
        assert_eq!(rms_values[..2], [1.0, 2.0]);
        assert!(rms_values[2].is_nan() && crest_values[0].is_nan());
        assert_eq!(crest_values[1..], [3.0, 4.0]);
    }

    #[test]
    fn verdicts_of_the_newest_windows_are_held_by_component() {
        let found = |id: &str, severity: Option<f64>| ComponentDiagnosis {
            severity,
            ..ComponentDiagnosis::undetermined(id, ComponentKind::Bearing, String::new())
        };
        let mut store = VerdictStore::default();
        for n in 1..=300_u32 {
            let right = found("right", (n != 299).then_some(0.5));
            store.push(f64::from(n), &[right, found("left", Some(0.1))]);
        }
        let trend = store.of(ComponentKind::Bearing, "right");
        assert_eq!((trend.time_s.len(), trend.time_s[0]), (MAX_VERDICTS, 61.0));
        let names: Vec<&str> = trend.columns.iter().map(|(name, ..)| name.as_str()).collect();
        assert_eq!(names, ["state", "severity", "confidence"]);
        let severity = &trend.columns[1].2;
        assert!(severity[MAX_VERDICTS - 2].is_nan(), "not judged");
        assert!((severity[MAX_VERDICTS - 1] - 0.5).abs() < 1e-12);
        assert_eq!(store.of(ComponentKind::Shaft, "right"), Trend::default());
    }

    #[test]
    fn a_window_is_found_by_its_end_with_the_features_it_had() {
        let mut store = TrendStore::default();
        store.push(5.0, &window(&[("rms", 1.0)]));
        store.push(10.0, &window(&[("rms", 2.0), ("crest", 3.0)]));
        let at = |time_s: f64| -> Option<Vec<(String, f64)>> {
            let found = store.at(time_s)?;
            Some(found.iter().map(|f| (f.name.to_string(), f.value)).collect())
        };
        assert_eq!(at(5.0), Some(vec![("rms".to_owned(), 1.0)]));
        assert_eq!(at(10.0).map(|found| found.len()), Some(2));
        assert_eq!((at(4.0), at(7.5), at(11.0)), (None, None, None));
    }

    #[test]
    fn the_oldest_window_gives_way() {
        let mut store = TrendStore::default();
        for i in 0..MAX_POINTS + 10 {
            store.push(i as f64, &window(&[("rms", i as f64)]));
        }
        let trend = store.copy();
        assert_eq!((trend.time_s.len(), trend.n_samples.len()), (MAX_POINTS, MAX_POINTS));
        assert!((trend.time_s[0] - 10.0).abs() < 1e-12);
        assert_eq!(trend.columns[0].2, trend.time_s);
    }

    #[test]
    fn the_number_of_columns_is_bounded() {
        let mut store = TrendStore::default();
        for i in 0..2 * MAX_COLUMNS {
            store.push(i as f64, &window(&[(&format!("f{i}"), 1.0)]));
        }
        assert_eq!(store.copy().columns.len(), MAX_COLUMNS);
    }
}
