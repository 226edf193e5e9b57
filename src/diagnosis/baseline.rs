//! What is normal for this machine: reference features of healthy records, and the test against them.
//!
//! Learned only on request, from records a person calls healthy (or, named as provisional, from the
//! first segments of a run). A ratio is judged in logarithms against the scatter between records
//! (C6).

use super::verdict::BaselineUse;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::run_up;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Scatter (1σ of the logarithm) assumed when there are too few records to measure it.
pub const ASSUMED_LOG_SCATTER: f64 = 0.2;

/// Records from which scatter is measured.
pub const MIN_RECORDS_FOR_SCATTER: usize = 5;

/// Records whose speed differs by more than this, relative, are listed and not used.
pub const SPEED_TOLERANCE: f64 = 0.05;

/// Features of one healthy record: (channel, feature) → mean of ln(value) over its windows.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name for people.
    pub name: String,
    /// Speed of the first shaft.
    pub speed: Option<Hz>,
    /// ln(value) by (channel, feature).
    pub log_values: BTreeMap<(String, String), f64>,
}

impl Record {
    /// Averages the windows of a record, each with its speed; features that are not positive are
    /// left out.
    #[must_use]
    pub fn of_windows(
        name: &str,
        windows: &[(Option<Hz>, Vec<ChannelFeatures>)],
        channels: &[ChannelInfo],
    ) -> Self {
        let mut sums: BTreeMap<(String, String), (f64, f64)> = BTreeMap::new();
        for features in windows.iter().flat_map(|(_, features)| features) {
            let channel = &channels[features.channel.0].name;
            for feature in features.values.iter().filter(|f| f.value > 0.0) {
                let key = (channel.clone(), feature.name.to_string());
                let slot = sums.entry(key).or_insert((0.0, 0.0));
                slot.0 += feature.value.ln();
                slot.1 += 1.0;
            }
        }
        let log_values = sums.into_iter().map(|(key, (sum, n))| (key, sum / n)).collect();
        let speed = windows.iter().find_map(|(speed, _)| *speed);
        Self { name: name.to_owned(), speed, log_values }
    }
}

/// The healthy records of a machine.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Baseline {
    /// The records.
    pub records: Vec<Record>,
    /// Whether it was made from the judged record's own beginning: proves change, not health.
    pub provisional: bool,
}

/// A value against the baseline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// value ÷ geometric mean of the reference values.
    pub ratio: f64,
    /// Standard deviation of ln(ratio) when nothing changed.
    pub sigma: f64,
    /// Reference records used.
    pub n_records: usize,
}

impl Comparison {
    /// ln(ratio) in standard deviations.
    #[must_use]
    pub fn z(&self) -> f64 {
        self.ratio.ln() / self.sigma
    }
}

impl Baseline {
    /// The records whose speed fits `speed`, and what to tell the user of each.
    #[must_use]
    pub fn at_speed(&self, speed: Option<Hz>) -> (Self, Vec<BaselineUse>) {
        let fits = |record: &Record| match (record.speed, speed) {
            (Some(a), Some(b)) => (a.0 / b.0 - 1.0).abs() <= SPEED_TOLERANCE,
            (None, _) | (_, None) => true,
        };
        let told = |record: &Record| {
            let used = fits(record);
            let reason = if used {
                "speed fits".to_owned()
            } else {
                let hz = record.speed.map_or(0.0, |s| s.0);
                format!("its speed of {hz:.2} Hz differs by more than 5 %")
            };
            BaselineUse { name: record.name.clone(), used, reason }
        };
        let uses = self.records.iter().map(told).collect();
        let records = self.records.iter().filter(|r| fits(r)).cloned().collect();
        (Self { records, provisional: self.provisional }, uses)
    }

    /// What does not depend on the speed: the parts of bow and unbalance in the runs of all records.
    #[must_use]
    pub fn of_runs(&self) -> Self {
        let of_run = |record: &Record| {
            let kept = record.log_values.iter().filter(|((_, name), _)| run_up::is_of_run(name));
            let log_values: BTreeMap<_, _> = kept.map(|(k, v)| (k.clone(), *v)).collect();
            let is_there = !log_values.is_empty();
            is_there.then(|| Record { name: record.name.clone(), speed: None, log_values })
        };
        let records = self.records.iter().filter_map(of_run).collect();
        Self { records, provisional: self.provisional }
    }

    /// Normalised CWT amplitude ratios R(f) of a channel, one a CWT amplitude that the baseline has
    /// (docs/theory.md, J3): what trends and the API show beside the amplitudes.
    #[must_use]
    pub fn cwt_ratios(&self, channel: &str, features: &ChannelFeatures) -> Vec<Feature> {
        let amplitudes = features.values.iter().filter(|f| f.name.contains("cwt_"));
        let ratio = |feature: &Feature| {
            let compared = self.compare(channel, &feature.name, feature.value)?;
            let name = Arc::from(format!("{}_ratio", feature.name));
            Some(Feature { name, value: compared.ratio, unit: Unit::One })
        };
        amplitudes.filter_map(ratio).collect()
    }

    /// Compares `value` of a channel's feature; `None` when no record has it or it is not positive.
    #[must_use]
    pub fn compare(&self, channel: &str, feature: &str, value: f64) -> Option<Comparison> {
        let key = (channel.to_owned(), feature.to_owned());
        let logs: Vec<f64> =
            self.records.iter().filter_map(|r| r.log_values.get(&key).copied()).collect();
        if logs.is_empty() || value <= 0.0 {
            return None;
        }
        let n = logs.len() as f64;
        let mean = logs.iter().sum::<f64>() / n;
        let scatter = if logs.len() >= MIN_RECORDS_FOR_SCATTER {
            (logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
        } else {
            ASSUMED_LOG_SCATTER
        };
        // A new record scatters like the old ones, about a mean known to σ/√n.
        let sigma = (scatter * (1.0 + 1.0 / n).sqrt()).max(1e-6);
        Some(Comparison { ratio: (value.ln() - mean).exp(), sigma, n_records: logs.len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, speed: f64, value: f64) -> Record {
        let key = ("x".to_owned(), "rms".to_owned());
        Record {
            name: name.into(),
            speed: Some(Hz(speed)),
            log_values: BTreeMap::from([(key, value.ln())]),
        }
    }

    #[test]
    fn one_record_gives_a_ratio_and_the_assumed_scatter() {
        let baseline = Baseline { records: vec![record("a", 10.0, 2.0)], provisional: false };
        let found = baseline.compare("x", "rms", 6.0).unwrap();
        assert!((found.ratio - 3.0).abs() < 1e-12 && found.n_records == 1);
        assert!((found.sigma - 0.2 * 2.0_f64.sqrt()).abs() < 1e-12);
        assert!(baseline.compare("y", "rms", 6.0).is_none());
        assert!(baseline.compare("x", "rms", 0.0).is_none());
    }

    #[test]
    fn five_records_give_measured_scatter_about_the_geometric_mean() {
        let records = [1.0, 2.0, 4.0, 2.0, 2.0].iter().map(|v| record("r", 10.0, *v)).collect();
        let baseline = Baseline { records, provisional: false };
        let found = baseline.compare("x", "rms", 2.0).unwrap();
        assert!((found.ratio - 1.0).abs() < 1e-12);
        let s = (2.0 * 2.0_f64.ln().powi(2) / 4.0).sqrt();
        assert!((found.sigma - s * 1.2_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn records_at_another_speed_are_listed_but_not_used() {
        let baseline = Baseline {
            records: vec![record("a", 10.0, 1.0), record("b", 12.0, 1.0)],
            provisional: false,
        };
        let (used, told) = baseline.at_speed(Some(Hz(10.2)));
        assert_eq!(used.records.len(), 1);
        assert!(told[0].used && !told[1].used && told[1].reason.contains("12.00 Hz"));
    }
}
