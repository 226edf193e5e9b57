//! Slow change: whether the broad levels have risen against the baseline, window by window.
//!
//! One window scatters; many windows of the same state together prove much less. Said, never accused: a
//! rise of a fifth is no fault. Must not know the clock.

pub mod page;

use super::baseline::Baseline;
use super::baseline::MIN_RECORDS_FOR_SCATTER;
use super::baseline::Usual;
use crate::features::ChannelFeatures;
use crate::features::overall;
use crate::signal::ChannelInfo;
use crate::tape::Reader;
use crate::tape::Tape;
use page::Sum;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Features watched.
const WATCHED: [&str; 3] = [overall::RMS, overall::VELOCITY_RMS, overall::KURTOSIS];

/// Rise that is no change, in the logarithm: a factor of 1.22, what one record may be beside the next (C6).
const TOLERATED: f64 = 0.2;

/// Rise that the stated rate of false alarms allows for: half of it.
const ALLOWED_FOR: f64 = 0.5 * TOLERATED;

/// Least scatter between windows that is believed.
const LEAST_SCATTER: f64 = 0.1;

/// Statements without a change that a machine makes in a year, at most.
pub const FALSE_STATEMENTS_A_YEAR: f64 = 0.1;

/// Seconds of a year.
const YEAR_S: f64 = 31_557_600.0;

/// A window as the watch sees it.
#[derive(Debug, Clone, Copy)]
pub struct Window<'a> {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Its features.
    pub features: &'a [ChannelFeatures],
    /// Whether it is one that a baseline could be learned from.
    pub is_fit: bool,
}

/// A level that has risen.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// Channel.
    pub channel: String,
    /// Feature.
    pub feature: &'static str,
    /// Geometric mean of its ratio to the baseline since the rise began.
    pub ratio: f64,
    /// When the rise began, s of stream time.
    pub since_s: f64,
    /// Windows since, none overlapping.
    pub n_windows: usize,
}

/// Watches the levels of one machine.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Watch {
    sums: BTreeMap<(usize, &'static str), Sum>,
    /// What the sums are against: names and ids of the records.
    against: Vec<(String, Option<Arc<str>>)>,
    /// End of the last window taken in, s.
    taken_to_s: f64,
}

impl Watch {
    /// Takes a window in, judged against `baseline`, the records of its operating state. Windows that overlap
    /// the last one taken, and those that are not fit, say nothing.
    pub fn observe(&mut self, window: &Window<'_>, baseline: &Baseline, channels: &[ChannelInfo]) {
        let against = baseline.records.iter().map(|r| (r.name.clone(), r.baseline.clone()));
        let against: Vec<_> = against.collect();
        // Of another operating state nothing is known: what was proven stands.
        if !window.is_fit || against.is_empty() || window.time_s.0 < self.taken_to_s - 1e-6 {
            return;
        }
        if against != self.against {
            (self.sums, self.against) = (BTreeMap::new(), against);
        }
        self.taken_to_s = window.time_s.1;
        let duration_s = (window.time_s.1 - window.time_s.0).max(1e-3);
        let n_tests = (WATCHED.len() * window.features.len().max(1)) as f64;
        let run_length = YEAR_S / duration_s * n_tests / FALSE_STATEMENTS_A_YEAR;
        for features in window.features {
            let name = &channels[features.channel.0].name;
            for feature in WATCHED {
                let usual = baseline.usual(name, feature);
                let value = features.get(feature).filter(|value| *value > 0.0);
                let (Some(value), Some(normal)) = (value, Normal::of(&usual)) else { continue };
                let x = value.ln() - normal.mean;
                let k = (TOLERATED - ALLOWED_FOR) / normal.scatter;
                let step = (x - TOLERATED) / normal.scatter;
                let threshold = page::threshold(k, run_length);
                let sum = self.sums.entry((features.channel.0, feature)).or_default();
                sum.add((window.time_s.0, x), step, threshold);
            }
        }
    }

    /// Writes all of it.
    pub fn write(&self, tape: &mut Tape) {
        tape.write(&[self.taken_to_s]);
        tape.write_count(self.against.len());
        for (name, id) in &self.against {
            tape.write_word(name);
            tape.write_flag(id.is_some());
            if let Some(id) = id {
                tape.write_word(id);
            }
        }
        tape.write_count(self.sums.len());
        for ((channel, feature), sum) in &self.sums {
            tape.write_count(*channel);
            tape.write_word(feature);
            sum.write(tape);
        }
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Self> {
        let taken_to_s = tape.number()?;
        let against = tape.list(|tape| {
            let name = tape.word()?.to_owned();
            let id = if tape.flag()? { Some(Arc::from(tape.word()?)) } else { None };
            Some((name, id))
        })?;
        let sums = tape.list(|tape| {
            let (channel, name) = (tape.count()?, tape.word()?);
            let feature = WATCHED.into_iter().find(|watched| *watched == name)?;
            Some(((channel, feature), Sum::read(tape)?))
        })?;
        Some(Self { sums: sums.into_iter().collect(), against, taken_to_s })
    }

    /// The levels that have risen.
    #[must_use]
    pub fn drifts(&self, channels: &[ChannelInfo]) -> Vec<Drift> {
        let proven = self.sums.iter().filter_map(|(key, sum)| Some((key, sum.proven()?)));
        let drift = |(&(channel, feature), rise): (&(usize, &'static str), page::Rise)| Drift {
            channel: channels[channel].name.clone(),
            feature,
            ratio: (rise.total / rise.n.max(1) as f64).exp(),
            since_s: rise.since_s,
            n_windows: rise.n,
        };
        proven.map(drift).collect()
    }
}

impl Drift {
    /// One plain sentence.
    #[must_use]
    pub fn text(&self) -> String {
        format!(
            "{} of {} drifts against its baseline: {:.2} times it in {} windows since {:.0} s of stream time",
            self.feature, self.channel, self.ratio, self.n_windows, self.since_s
        )
    }
}

/// A feature without a change: ln(value) of a window is normal about the baseline.
struct Normal {
    mean: f64,
    scatter: f64,
}

impl Normal {
    /// Scatter between windows as the records tell it, or between records of one window each; `None`: unknown.
    fn of(usual: &[Usual]) -> Option<Self> {
        let n = usual.len() as f64;
        let mean = usual.iter().map(|u| u.log_value).sum::<f64>() / n;
        let within: Vec<f64> = usual.iter().filter_map(|u| u.log_scatter).collect();
        let square = if !within.is_empty() {
            within.iter().map(|s| s * s).sum::<f64>() / within.len() as f64
        } else if usual.len() >= MIN_RECORDS_FOR_SCATTER {
            usual.iter().map(|u| (u.log_value - mean).powi(2)).sum::<f64>() / (n - 1.0)
        } else {
            return None;
        };
        Some(Self { mean, scatter: square.sqrt().max(LEAST_SCATTER) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::baseline::OperatingPoint;
    use super::super::baseline::Record;
    use super::*;
    use crate::features::Feature;
    use crate::signal::ChannelIndex;
    use crate::units::Hz;
    use crate::units::Unit;
    use rand::SeedableRng;
    use rand_distr::Distribution;
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64Mcg;

    fn channels() -> [ChannelInfo; 1] {
        [ChannelInfo {
            name: "x".to_owned(),
            sample_rate: Hz(1000.0),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        }]
    }

    fn baseline(scatter: Option<f64>) -> Baseline {
        let usual = Usual { log_value: 0.0, log_scatter: scatter, n_windows: 60 };
        let record = Record {
            name: "healthy".to_owned(),
            point: OperatingPoint { speed: Some(Hz(10.0)), load: None },
            usual: [(("x".to_owned(), "rms".to_owned()), usual)].into(),
            n_windows: 60,
            ..Record::default()
        };
        Baseline { records: vec![record], provisional: false }
    }

    /// Lets windows of 10 s every `hop_s` pass whose ln RMS is `log_rms(i)`; gives the number of the first that states
    /// a drift.
    fn first(
        hop_s: f64,
        n: usize,
        mut log_rms: impl FnMut(usize) -> f64,
    ) -> Option<(usize, Drift)> {
        let (mut watch, baseline) = (Watch::default(), baseline(Some(0.15)));
        for i in 0..n {
            let value = log_rms(i).exp();
            let values = vec![Feature { name: Arc::from("rms"), value, unit: Unit::One }];
            let channel = ChannelIndex(0);
            let features = [ChannelFeatures { channel, sample_range: (0, 1), values }];
            let start_s = hop_s * i as f64;
            let window =
                Window { time_s: (start_s, start_s + 10.0), features: &features, is_fit: true };
            watch.observe(&window, &baseline, &channels());
            if let Some(drift) = watch.drifts(&channels()).pop() {
                return Some((i, drift));
            }
        }
        None
    }

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        move || {
            let z: f64 = StandardNormal.sample(&mut random);
            0.15 * z
        }
    }

    #[test]
    fn months_without_a_change_and_beside_the_baseline_state_nothing() {
        // Ten records of a month of independent windows each, a tenth above the baseline: 0.8 machine-years, of which
        // 0.1 false statements a year are promised at most, for all three features together.
        let n_stated = (0..10)
            .filter(|seed| {
                let mut noise = noise(*seed);
                first(10.0, 26_000, |_| 0.1 + noise()).is_some()
            })
            .count();
        // Poisson with a mean of 0.03 of the one feature: more than one has a probability of 4e-4.
        assert!(n_stated <= 1, "{n_stated}");
    }

    #[test]
    fn a_slow_rise_is_stated_before_it_doubles_and_dated() {
        let mut noise = noise(3);
        // From window 1000 on by 1 % each.
        let rise = |i: usize| 0.01 * (i as f64 - 1000.0).max(0.0);
        let (at, drift) = first(10.0, 2000, |i| rise(i) + noise()).unwrap();
        assert!((1010..1069).contains(&at), "{at}: doubled at 1069");
        assert!((9_900.0..10_500.0).contains(&drift.since_s), "{drift:?}");
        assert!(drift.ratio > 1.1 && drift.ratio < 1.8, "{drift:?}");
        assert!(drift.text().starts_with("rms of x drifts against its baseline: 1."));
    }

    #[test]
    fn overlapping_windows_count_once() {
        // A step to twice the level; of windows that overlap by half every second one counts.
        let (alone, _) = first(10.0, 100, |_| 0.7).unwrap();
        let (overlapping, _) = first(5.0, 100, |_| 0.7).unwrap();
        assert_eq!(overlapping, 2 * alone);
    }

    #[test]
    fn a_fall_and_an_unknown_scatter_state_nothing() {
        assert!(first(10.0, 1000, |_| -2.0).is_none(), "run-in");
        assert!(Normal::of(&baseline(None).usual("x", "rms")).is_none());
        let single = |value: f64| Usual::of_value(value);
        assert!(Normal::of(&[1.0, 1.1, 0.9, 1.0].map(single)).is_none());
        assert!(Normal::of(&[1.0, 1.1, 0.9, 1.0, 2.0].map(single)).is_some());
    }
}
