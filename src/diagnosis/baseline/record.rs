//! One healthy record: its features over its windows, told robustly, and which windows went into it.

use super::direction;
use super::is_ratio;
use super::robust;
use super::state::OperatingPoint;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::run_up;
use crate::features::vector;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::SourceUnit;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is usual of a feature in a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usual {
    /// Median of ln(value) over the windows; of a part of a direction ([`vector::DIRECTION`]) of itself.
    pub log_value: f64,
    /// Standard deviation of the same between windows (C30); `None`: too few to tell.
    pub log_scatter: Option<f64>,
    /// Windows that have it.
    pub n_windows: usize,
}

impl Usual {
    /// Of a single value above 0.
    #[must_use]
    pub fn of_value(value: f64) -> Self {
        Self { log_value: value.ln(), log_scatter: None, n_windows: 1 }
    }

    /// The median itself, of the feature of this name, in its unit.
    #[must_use]
    pub fn value(&self, feature: &str) -> f64 {
        if vector::is_direction(feature) { self.log_value } else { self.log_value.exp() }
    }

    /// Of at least one logarithm.
    fn of_logs(logs: &[f64]) -> Option<Self> {
        let log_value = robust::median(logs)?;
        Some(Self { log_value, log_scatter: robust::scatter(logs), n_windows: logs.len() })
    }
}

/// Features of one healthy record.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    /// Name for people.
    pub name: String,
    /// Id of the signed baseline it belongs to; `None`: of a capture that was only named.
    pub baseline: Option<Arc<str>>,
    /// Speed (median over the windows) and load.
    pub point: OperatingPoint,
    /// By (channel, feature).
    pub usual: BTreeMap<(String, String), Usual>,
    /// Windows that went into it.
    pub n_windows: usize,
    /// Windows that did not, by reason.
    pub left_out: BTreeMap<String, usize>,
    /// Channels of the capture it was measured of, for their units; empty: unknown, or held against the machine when it was
    /// signed. No part of what is kept.
    pub channels: Vec<ChannelInfo>,
}

/// Why a window shows nothing of the machine at a steady speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// The machine stands.
    Stopped,
    /// The speed changes: only what depends on no speed can be learned of it.
    Transient,
    /// No sensor is of use.
    NoSensor,
}

impl Unfit {
    /// For people.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Stopped => "not running",
            Self::Transient => "the speed changes within the window",
            Self::NoSensor => "no usable sensor",
        }
    }
}

/// A window offered to a record.
#[derive(Debug, Clone)]
pub struct Offered<'a> {
    /// Speed and load.
    pub point: OperatingPoint,
    /// Why it cannot be used; `None`: it can.
    pub unfit: Option<Unfit>,
    /// Its features; those of flawed channels are not among them.
    pub features: &'a [ChannelFeatures],
}

impl Record {
    /// Measures a record from windows of known speed; all of them can be used.
    #[must_use]
    pub fn of_windows(
        name: &str,
        windows: &[(Option<Hz>, Vec<ChannelFeatures>)],
        channels: &[ChannelInfo],
    ) -> Self {
        let offered = windows.iter().map(|(speed, features)| Offered {
            point: OperatingPoint { speed: *speed, load: None },
            unfit: None,
            features,
        });
        Self::of_offered(name, &offered.collect::<Vec<_>>(), channels, &[])
    }

    /// Measures a record from windows. Left out are those that cannot be used, and those whose speed or
    /// load is not that of most (the median's). Features that are not positive are left out.
    #[must_use]
    pub fn of_offered(
        name: &str,
        windows: &[Offered<'_>],
        channels: &[ChannelInfo],
        load_bins: &[f64],
    ) -> Self {
        let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
        let mut leave = |why: &str| *left_out.entry(why.to_owned()).or_insert(0) += 1;
        let mut fit: Vec<&Offered<'_>> = Vec::new();
        for window in windows {
            match window.unfit {
                Some(why) => leave(why.reason()),
                None => fit.push(window),
            }
        }
        let point = median_point(&fit);
        let is_alike = |window: &Offered<'_>| window.point.unfit(&point, load_bins).is_none();
        fit.retain(|window| {
            let keeps = is_alike(window);
            if !keeps {
                leave("its speed or load is not that of most windows");
            }
            keeps
        });
        let mut logs: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
        let of_runs = windows.iter().filter(|window| window.unfit == Some(Unfit::Transient));
        let taken = fit.iter().copied().chain(of_runs);
        for (window, features) in taken.flat_map(|w| w.features.iter().map(move |f| (w, f))) {
            let channel = &channels[features.channel.0].name;
            let is_meant = |f: &Feature| window.unfit.is_none() || run_up::is_of_run(&f.name);
            let has_log = |f: &Feature| {
                f.value > 0.0 && !vector::is_part(&f.name) && !vector::is_direction(&f.name)
            };
            let learned = |f: &&Feature| has_log(f) && !is_ratio(&f.name) && is_meant(f);
            for feature in features.values.iter().filter(learned) {
                let key = (channel.clone(), feature.name.to_string());
                logs.entry(key).or_default().push(feature.value.ln());
            }
        }
        logs.extend(direction::learned(&fit, point.speed, channels));
        let usual = logs
            .into_iter()
            .filter_map(|(key, logs)| Some((key, Usual::of_logs(&logs)?)))
            .collect();
        let name = name.to_owned();
        let (n_windows, channels) = (fit.len(), Vec::new());
        Self { name, baseline: None, point, usual, n_windows, left_out, channels }
    }

    /// The record without its values, all of its windows left out for a reason.
    pub(super) fn void(&self, reason: String) -> Self {
        let n_windows = self.n_windows + self.left_out.values().sum::<usize>();
        let (usual, left_out) = (BTreeMap::new(), BTreeMap::from([(reason, n_windows)]));
        Self { usual, n_windows: 0, left_out, ..self.clone() }
    }

    /// Why nothing can be held against it: of none of its windows anything is left. `None`: it can.
    pub(super) fn why_void(&self) -> Option<String> {
        let is_void = self.usual.is_empty() && !self.left_out.is_empty();
        let reasons = || self.left_out.keys().map(String::as_str).collect::<Vec<_>>().join("; ");
        is_void.then(reasons)
    }

    /// Why its values mean something else than those of `channels`: they are in another unit, or its data state one that the
    /// machine file contradicts and that `channels` do not state, too. `None`: nothing says so.
    #[must_use]
    pub(super) fn other_units(&self, channels: &[ChannelInfo]) -> Option<String> {
        let with = |now: &ChannelInfo| self.channels.iter().find(|c| c.name == now.name);
        let mut pairs = channels.iter().filter_map(|now| Some((with(now)?, now)));
        pairs.find_map(|(was, now)| {
            let name = &now.name;
            // A spelling that nobody knows states nothing.
            let stated = |(data, _): &&(String, String)| SourceUnit::parse(data).is_some();
            if let Some((data, machine)) = was.unit_conflict.as_ref().filter(stated) {
                let is_alike = now.unit_conflict.as_ref().is_some_and(|(said, _)| said == data);
                return (!is_alike).then(|| {
                    format!("its channel `{name}` is in {data} by its data and in {machine} by the machine file")
                });
            }
            let is_known = was.unit != Unit::Unknown && now.unit != Unit::Unknown;
            (is_known && was.unit != now.unit).then(|| {
                let (was, now) = (was.unit.symbol(), now.unit.symbol());
                format!("its channel `{name}` is in {was}, that of the data in {now}")
            })
        })
    }

    /// How many windows went into it and which did not, for people.
    #[must_use]
    pub fn windows_text(&self) -> String {
        let n_out: usize = self.left_out.values().sum();
        if n_out == 0 {
            return format!("{} windows", self.n_windows);
        }
        let reasons = self.left_out.iter().map(|(why, n)| format!("{n}: {why}"));
        let reasons = reasons.collect::<Vec<_>>().join("; ");
        format!("{} of {} windows ({reasons})", self.n_windows, self.n_windows + n_out)
    }
}

/// Median speed and load of the windows in which they are known.
fn median_point(windows: &[&Offered<'_>]) -> OperatingPoint {
    let speeds: Vec<f64> = windows.iter().filter_map(|w| Some(w.point.speed?.0)).collect();
    let loads: Vec<f64> = windows.iter().filter_map(|w| w.point.load).collect();
    OperatingPoint { speed: robust::median(&speeds).map(Hz), load: robust::median(&loads) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::ChannelIndex;
    use crate::units::Unit;

    fn channel(name: &str) -> ChannelInfo {
        ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(1000.0),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        }
    }

    fn features(rms: f64) -> Vec<ChannelFeatures> {
        let value = |name: &str| Feature { name: Arc::from(name), value: rms, unit: Unit::One };
        let values = vec![value("rms"), value("cwt_1x_main_ratio")];
        vec![ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values }]
    }

    fn record(windows: &[(f64, f64, Option<Unfit>, f64)]) -> Record {
        let measured: Vec<_> = windows.iter().map(|w| features(w.3)).collect();
        let offered: Vec<Offered<'_>> = windows
            .iter()
            .zip(&measured)
            .map(|(&(speed, load, unfit, _), features)| Offered {
                point: OperatingPoint { speed: Some(Hz(speed)), load: Some(load) },
                unfit,
                features,
            })
            .collect();
        Record::of_offered("r", &offered, &[channel("x")], &[10.0])
    }

    fn rms(record: &Record) -> Usual {
        record.usual[&("x".to_owned(), "rms".to_owned())]
    }

    #[test]
    fn a_few_bad_windows_move_nothing() {
        let good = |value| (10.0, 5.0, None, value);
        let windows: Vec<_> =
            [1.0, 1.1, 0.9, 1.05, 0.95, 1.0, 300.0, 1e-9, 1.0].map(good).into_iter().collect();
        let found = record(&windows);
        assert!(rms(&found).log_value.abs() < 1e-12 && rms(&found).n_windows == 9);
        assert_eq!(found.usual.len(), 1, "a ratio to a baseline is no feature of the machine");
        // Without the two, the standard deviation of ln is 0.066; a mean would have made it 6.
        assert!(rms(&found).log_scatter.unwrap() < 0.15, "{found:?}");
    }

    #[test]
    fn unfit_and_unlike_windows_do_not_enter_and_are_told() {
        let found = record(&[
            (10.0, 5.0, None, 1.0),
            (10.1, 6.0, None, 1.0),
            (10.0, 5.0, Some(Unfit::Stopped), 50.0),
            (13.0, 5.0, None, 50.0),
            (10.0, 15.0, None, 50.0),
            (10.2, 9.9, None, 1.0),
        ]);
        assert_eq!((found.n_windows, rms(&found).n_windows), (3, 3));
        assert!(rms(&found).log_value.abs() < 1e-12);
        assert_eq!(found.left_out["not running"], 1);
        assert_eq!(found.left_out["its speed or load is not that of most windows"], 2);
        assert_eq!(found.point.speed, Some(Hz(10.1)));
        let text = found.windows_text();
        assert!(text.starts_with("3 of 6 windows (") && text.contains("1: not running"), "{text}");
    }

    #[test]
    fn nothing_usable_is_an_empty_record() {
        let found = record(&[(10.0, 5.0, Some(Unfit::Stopped), 1.0)]);
        assert_eq!((found.n_windows, found.usual.len()), (0, 0));
        assert_eq!(found.point, OperatingPoint::default());
    }

    #[test]
    fn a_direction_is_learned_of_windows_that_agree_at_one_speed() {
        let (to, against) = ((-0.6, 0.8), (0.6, -0.8));
        let found = |windows: &[(f64, (f64, f64))]| {
            let windows: Vec<_> = windows.iter().map(|w| (Some(Hz(w.0)), vector_of(w.1))).collect();
            Record::of_windows("r", &windows, &[channel("x")]).usual
        };
        let agreed = found(&[(10.0, to), (10.0, to), (10.0, to), (10.4, against)]);
        assert_eq!(agreed.len(), 2, "parts of the vector have no logarithm");
        let part = |name: &str| agreed[&("x".to_owned(), name.to_owned())];
        let [cos, sin] =
            vector::DIRECTION.map(|name| (part(name).value(name), part(name).n_windows));
        assert_eq!((cos, sin), ((-0.6, 3), (0.8, 3)), "4 % faster is another lag");
        assert!(found(&[(10.0, to), (10.0, to), (10.0, against)]).is_empty(), "they disagree");
    }

    fn vector_of((cos, sin): (f64, f64)) -> Vec<ChannelFeatures> {
        let value = |name: &str, value| Feature { name: Arc::from(name), value, unit: Unit::One };
        let [of_cos, of_sin] = vector::DIRECTION;
        let values = vec![value(of_cos, cos), value(of_sin, sin), value(vector::COS, 9.0 * cos)];
        vec![ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values }]
    }

    #[test]
    fn of_a_window_whose_speed_changes_only_what_depends_on_no_speed_is_learned() {
        let value = |name: String, value| Feature { name: Arc::from(name), value, unit: Unit::One };
        let features = |rms: f64| {
            let values = vec![value("rms".to_owned(), rms), value(run_up::bow_name("s"), 2.0)];
            vec![ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values }]
        };
        let (steady, rising) = (features(1.0), features(9.0));
        let point = OperatingPoint { speed: Some(Hz(10.0)), load: None };
        let offered = |unfit, features| Offered { point, unfit, features };
        let windows = [offered(None, &steady[..]), offered(Some(Unfit::Transient), &rising[..])];
        let found = Record::of_offered("r", &windows, &[channel("x")], &[]);
        assert_eq!((rms(&found).n_windows, rms(&found).log_value), (1, 0.0));
        let bow = found.usual[&("x".to_owned(), run_up::bow_name("s"))];
        assert_eq!(bow.n_windows, 2);
    }
}
