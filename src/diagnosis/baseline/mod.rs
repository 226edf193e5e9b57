//! What is normal for this machine: reference features of healthy records, and the test against them.
//!
//! Learned only on request, from records a person calls healthy (or, named as provisional, from the
//! first segments of a run), each for its operating state. A ratio is judged in logarithms against the
//! scatter between and within records (C6). Once learned a record never changes: [`signed`] gives it an
//! id by its content. Must not know where baselines are kept.

mod direction;
mod kept;
mod record;
pub mod robust;
pub mod signed;
mod state;

pub use direction::Direction;
pub use direction::of_channel as direction_of;
pub use record::Offered;
pub use record::Record;
pub use record::Unfit;
pub use record::Usual;
pub use state::LOAD_TOLERANCE;
pub use state::OperatingPoint;
pub use state::SPEED_TOLERANCE;

use super::fault::State;
use super::verdict::BaselineUse;
use super::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::run_up;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Scatter (1σ of the logarithm) assumed when there are too few records to measure it.
pub const ASSUMED_LOG_SCATTER: f64 = 0.2;

/// Records from which scatter is measured.
pub const MIN_RECORDS_FOR_SCATTER: usize = 5;

/// End of the name of a ratio to a baseline: shown beside the features, never learned.
const RATIO: &str = "_ratio";

/// Whether a feature is a ratio to a baseline ([`Baseline::cwt_ratios`]).
#[must_use]
pub fn is_ratio(feature: &str) -> bool {
    feature.contains("cwt_") && feature.ends_with(RATIO)
}

/// Most confidence in the health of what a provisional baseline alone acquits: nothing tells what it was like.
const PROVISIONAL_CONFIDENCE: f64 = 0.5;

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
    /// Adds to the verdict on a component that this baseline acquits what that is worth if it is only the record's own beginning.
    pub fn qualify(&self, verdict: &mut ComponentDiagnosis) {
        if self.provisional && verdict.state == State::Healthy {
            verdict.confidence = verdict.confidence.map(|c| c.min(PROVISIONAL_CONFIDENCE));
            verdict.why.push_str(
                "; the baseline is this record's own beginning, so nothing has changed since, and health is not proven",
            );
        }
    }

    /// The records, but for what is in other units than `channels`: of those nothing is left but the reason, since a ratio of two
    /// units says nothing.
    #[must_use]
    pub fn in_units_of(&self, channels: &[ChannelInfo]) -> Self {
        let fitting = |record: &Record| match record.other_units(channels) {
            None => record.clone(),
            Some(reason) => record.void(reason),
        };
        let records = self.records.iter().map(fitting).collect();
        Self { records, provisional: self.provisional }
    }

    /// The records that fit an operating state, and what to tell the user of each. Where a signed baseline
    /// fits, captures that were only named are not used beside it.
    #[must_use]
    pub fn at(&self, now: &OperatingPoint, load_bins: &[f64]) -> (Self, Vec<BaselineUse>) {
        let why =
            |record: &Record| record.why_void().or_else(|| record.point.unfit(now, load_bins));
        let unfit: Vec<Option<String>> = self.records.iter().map(why).collect();
        let mut with_fit = self.records.iter().zip(&unfit);
        let is_signed = with_fit.any(|(r, why)| why.is_none() && r.baseline.is_some());
        let told = |(record, unfit): (&Record, Option<String>)| {
            let replaced = is_signed && record.baseline.is_none();
            let why = unfit.or_else(|| {
                replaced.then(|| "a baseline that was learned and signed stands for it".to_owned())
            });
            let used = why.is_none();
            let reason = why.unwrap_or_else(|| fitting(record, now));
            let (id, n_windows) = (record.baseline.clone(), record.n_windows);
            BaselineUse { name: record.name.clone(), used, reason, id, n_windows }
        };
        let uses: Vec<BaselineUse> = self.records.iter().zip(unfit).map(told).collect();
        let used = self.records.iter().zip(&uses).filter(|(_, told)| told.used);
        let records = used.map(|(record, _)| record.clone()).collect();
        (Self { records, provisional: self.provisional }, uses)
    }

    /// Why nothing can be held against any of the records, at whatever speed; `None`: something can, or there is none.
    #[must_use]
    pub fn why_void(&self) -> Option<String> {
        let reasons: Option<BTreeSet<String>> = self.records.iter().map(Record::why_void).collect();
        let reasons = reasons.filter(|reasons| !reasons.is_empty())?;
        Some(reasons.into_iter().collect::<Vec<_>>().join("; "))
    }

    /// What does not depend on the speed: the parts of bow and unbalance in the runs of all records.
    #[must_use]
    pub fn of_runs(&self) -> Self {
        let of_run = |record: &Record| {
            let kept = record.usual.iter().filter(|((_, name), _)| run_up::is_of_run(name));
            let usual: BTreeMap<_, _> = kept.map(|(key, usual)| (key.clone(), *usual)).collect();
            let is_there = !usual.is_empty();
            is_there.then(|| Record { point: OperatingPoint::default(), usual, ..record.clone() })
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
            let name = Arc::from(format!("{}{RATIO}", feature.name));
            Some(Feature { name, value: compared.ratio, unit: Unit::One })
        };
        amplitudes.filter_map(ratio).collect()
    }

    /// Compares `value` of a channel's feature (C6); `None` when no record has it or it is not positive.
    #[must_use]
    pub fn compare(&self, channel: &str, feature: &str, value: f64) -> Option<Comparison> {
        let usual = self.usual(channel, feature);
        if usual.is_empty() || value <= 0.0 {
            return None;
        }
        let n = usual.len() as f64;
        let mean = usual.iter().map(|u| u.log_value).sum::<f64>() / n;
        let within = within_square(&usual);
        let between: f64 = usual.iter().map(|u| (u.log_value - mean).powi(2)).sum();
        let sigma = sigma_of_new(between, within, usual.len());
        Some(Comparison { ratio: (value.ln() - mean).exp(), sigma, n_records: usual.len() })
    }

    /// Where the vector of 1× of a channel points by the records at `speed` (J10); `None`: none of them says, or they disagree.
    #[must_use]
    pub fn direction(&self, channel: &str, speed: Hz) -> Option<Direction> {
        Direction::of(&self.records, channel, speed)
    }

    /// What each record that has it says of a channel's feature.
    #[must_use]
    pub fn usual(&self, channel: &str, feature: &str) -> Vec<Usual> {
        let key = (channel.to_owned(), feature.to_owned());
        self.records.iter().filter_map(|r| r.usual.get(&key).copied()).collect()
    }
}

/// Standard deviation of a new record about the mean of `n` (C6): by the sum of their squares about it where there are enough, else by
/// what is assumed; by their mean square `within` beside it.
fn sigma_of_new(between: f64, within: f64, n: usize) -> f64 {
    let scatter = if n >= MIN_RECORDS_FOR_SCATTER {
        (between / (n as f64 - 1.0) + within).sqrt()
    } else {
        ASSUMED_LOG_SCATTER.max(within.sqrt())
    };
    // A new record scatters like the old ones, about a mean known to σ/√n.
    (scatter * (1.0 + 1.0 / n as f64).sqrt()).max(1e-6)
}

/// Mean square of the scatter between windows, over the records that know it; 0 if none does.
fn within_square(usual: &[Usual]) -> f64 {
    let squares: Vec<f64> = usual.iter().filter_map(|u| Some(u.log_scatter?.powi(2))).collect();
    if squares.is_empty() { 0.0 } else { squares.iter().sum::<f64>() / squares.len() as f64 }
}

/// By what scatter a value is held against so many records (C6).
#[must_use]
pub fn scatter_note(n_records: usize) -> Option<String> {
    match n_records {
        0 => None,
        n if n < MIN_RECORDS_FOR_SCATTER => Some(format!(
            "baseline of {n} record{}: how records scatter is not known from fewer than {MIN_RECORDS_FOR_SCATTER}; a scatter of \
             {ASSUMED_LOG_SCATTER} (1σ, of the natural logarithm) is assumed where their windows scatter less",
            if n == 1 { "" } else { "s" }
        )),
        n => Some(format!("baseline of {n} records: their own scatter is used")),
    }
}

/// In what a record fits.
fn fitting(record: &Record, now: &OperatingPoint) -> String {
    let known = |record: bool, now: bool| record && now;
    let speed = known(record.point.speed.is_some(), now.speed.is_some());
    let load = known(record.point.load.is_some(), now.load.is_some());
    let fits = match (speed, load) {
        (true, true) => "speed and load fit",
        (true, false) => "speed fits",
        (false, true) => "load fits, speed unknown",
        (false, false) => "speed unknown",
    };
    if record.n_windows > 1 || !record.left_out.is_empty() {
        format!("{fits}; {}", record.windows_text())
    } else {
        fits.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::fault::ComponentKind;

    fn record(name: &str, speed: f64, value: f64) -> Record {
        let key = ("x".to_owned(), "rms".to_owned());
        Record {
            name: name.into(),
            point: OperatingPoint { speed: Some(Hz(speed)), load: None },
            usual: BTreeMap::from([(key, Usual::of_value(value))]),
            n_windows: 1,
            ..Record::default()
        }
    }

    fn of(records: Vec<Record>) -> Baseline {
        Baseline { records, provisional: false }
    }

    fn at(speed: f64, load: Option<f64>) -> OperatingPoint {
        OperatingPoint { speed: Some(Hz(speed)), load }
    }

    #[test]
    fn a_records_own_beginning_proves_no_health() {
        let verdict = |state: State| ComponentDiagnosis {
            state,
            confidence: Some(0.9),
            why: "1.02 times its baseline".to_owned(),
            ..ComponentDiagnosis::undetermined("s", ComponentKind::Shaft, String::new())
        };
        let qualified = |provisional: bool, state: State| {
            let mut verdict = verdict(state);
            Baseline { records: Vec::new(), provisional }.qualify(&mut verdict);
            verdict
        };
        let acquitted = qualified(true, State::Healthy);
        assert_eq!(acquitted.confidence, Some(0.5));
        assert!(acquitted.why.ends_with("health is not proven"), "{}", acquitted.why);
        assert_eq!(qualified(true, State::Damaged), verdict(State::Damaged), "change is proven");
        assert_eq!(qualified(false, State::Healthy), verdict(State::Healthy));
    }

    #[test]
    fn one_record_gives_a_ratio_and_the_assumed_scatter() {
        let baseline = of(vec![record("a", 10.0, 2.0)]);
        let found = baseline.compare("x", "rms", 6.0).unwrap();
        assert!((found.ratio - 3.0).abs() < 1e-12 && found.n_records == 1);
        assert!((found.sigma - 0.2 * 2.0_f64.sqrt()).abs() < 1e-12);
        assert!(baseline.compare("y", "rms", 6.0).is_none());
        assert!(baseline.compare("x", "rms", 0.0).is_none());
    }

    #[test]
    fn five_records_give_measured_scatter_about_the_geometric_mean() {
        let baseline = of([1.0, 2.0, 4.0, 2.0, 2.0].map(|v| record("r", 10.0, v)).to_vec());
        let found = baseline.compare("x", "rms", 2.0).unwrap();
        assert!((found.ratio - 1.0).abs() < 1e-12);
        let s = (2.0 * 2.0_f64.ln().powi(2) / 4.0).sqrt();
        assert!((found.sigma - s * 1.2_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn scatter_between_windows_counts_beside_that_between_records() {
        let with = |scatter: f64, value: f64| {
            let mut record = record("a", 10.0, value);
            for usual in record.usual.values_mut() {
                (usual.log_scatter, usual.n_windows) = (Some(scatter), 20);
            }
            record
        };
        let sigma = |records| of(records).compare("x", "rms", 6.0).unwrap().sigma;
        // Less than what is assumed between records: nothing is gained by many windows of one record.
        assert!((sigma(vec![with(0.05, 2.0)]) - 0.2 * 2.0_f64.sqrt()).abs() < 1e-12);
        assert!((sigma(vec![with(0.5, 2.0)]) - 0.5 * 2.0_f64.sqrt()).abs() < 1e-12);
        // Five equal records, windows that scatter by 0.3: a new window does too.
        let five = sigma(vec![with(0.3, 2.0); 5]);
        assert!((five - 0.3 * 1.2_f64.sqrt()).abs() < 1e-12, "{five}");
    }

    #[test]
    fn records_in_other_units_are_named_and_not_used() {
        let channel = |unit, said: Option<&str>| ChannelInfo {
            name: "x".to_owned(),
            sample_rate: Hz(1e4),
            unit,
            offset: 0.0,
            unit_conflict: said.map(|data| (data.to_owned(), "m/s^2".to_owned())),
            full_scale: None,
        };
        let (acceleration, velocity) = (Unit::MetrePerSecondSquared, Unit::MillimetrePerSecond);
        let used = |was: ChannelInfo, now: ChannelInfo| {
            let record = Record { channels: vec![was], ..record("a", 10.0, 1.0) };
            let voided = of(vec![record]).in_units_of(&[now]);
            let (left, told) = voided.at(&at(10.0, None), &[]);
            assert_eq!((told.len(), left.records.len()), (1, usize::from(told[0].used)));
            assert_eq!(voided.why_void(), (!told[0].used).then(|| told[0].reason.clone()));
            (!told[0].used).then(|| told[0].reason.clone())
        };
        let plain = || channel(acceleration, None);
        let by_data = "its channel `x` is in g by its data and in m/s^2 by the machine file";
        assert_eq!(used(channel(acceleration, Some("g")), plain()).unwrap(), by_data);
        let other = used(channel(velocity, None), plain()).unwrap();
        assert_eq!(other, "its channel `x` is in mm/s, that of the data in m/s^2");
        // What is said alike is wrong alike, and what nobody knows says nothing.
        let said = || channel(acceleration, Some("g"));
        assert_eq!(used(said(), said()), None);
        assert_eq!(used(channel(acceleration, Some("furlong")), plain()), None);
        assert_eq!(used(channel(Unit::Unknown, None), plain()), None);
        let elsewhere = ChannelInfo { name: "y".to_owned(), ..channel(velocity, None) };
        assert_eq!(used(elsewhere, plain()), None);
    }

    #[test]
    fn records_of_another_speed_or_load_are_listed_but_not_used() {
        let loaded = |name, load| {
            let mut record = record(name, 10.0, 1.0);
            record.point.load = Some(load);
            record
        };
        let baseline = of(vec![
            record("a", 10.0, 1.0),
            record("b", 12.0, 1.0),
            loaded("c", 4.0),
            loaded("d", 6.0),
        ]);
        let (used, told) = baseline.at(&at(10.2, Some(6.5)), &[5.0]);
        let names: Vec<&str> = used.records.iter().map(|r| r.name.as_str()).collect();
        assert_eq!(names, ["a", "d"]);
        assert!(told[0].used && told[0].reason == "speed fits", "{:?}", told[0]);
        assert!(!told[1].used && told[1].reason.contains("12.00 Hz"));
        assert!(!told[2].used && told[2].reason.contains("bin 0"), "{:?}", told[2]);
        assert!(told[3].used && told[3].reason == "speed and load fit");
    }

    #[test]
    fn a_signed_baseline_stands_for_captures_that_were_only_named() {
        let signed = |speed| {
            let mut record = record("signed", speed, 1.0);
            record.baseline = Some(Arc::from("id-1"));
            record
        };
        let baseline = of(vec![record("a", 10.0, 1.0), signed(10.0), signed(20.0)]);
        let (used, told) = baseline.at(&at(10.0, None), &[]);
        assert_eq!(used.records.len(), 1);
        assert!(!told[0].used && told[0].reason.contains("signed"), "{:?}", told[0]);
        assert_eq!((told[1].used, told[1].id.as_deref()), (true, Some("id-1")));
        let mut elsewhere = record("a", 30.0, 1.0);
        elsewhere.name = "b".to_owned();
        let (used, _) = of(vec![elsewhere, signed(10.0)]).at(&at(30.0, None), &[]);
        assert_eq!(used.records[0].name, "b", "where none is signed, what is named holds");
    }
}
