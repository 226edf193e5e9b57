//! What a shard remembers of judged windows so that a baseline can be learned from them; bounded.

use super::trend::MAX_POINTS;
use super::trend::TrendStore;
use crate::api::view::Measured;
use crate::api::view::Span;
use crate::diagnosis::baseline::Offered;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Unfit;
use crate::features::ChannelFeatures;
use crate::machine::Machine;
use crate::pipeline::Outcome;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use std::collections::BTreeMap;
use std::collections::VecDeque;

/// The windows whose features the trends hold.
#[derive(Debug, Clone, Default)]
pub(super) struct Seen {
    windows: VecDeque<Window>,
}

#[derive(Debug, Clone)]
struct Window {
    time_s: (f64, f64),
    point: OperatingPoint,
    unfit: Option<Unfit>,
    /// Components accused in it.
    accused: Vec<String>,
}

impl Seen {
    /// Remembers a window.
    pub(super) fn push(&mut self, outcome: &Outcome) {
        if self.windows.len() == MAX_POINTS {
            self.windows.pop_front();
        }
        let judged = &outcome.judged;
        let accused = judged.components.iter().filter(|component| component.state.is_accusation());
        self.windows.push_back(Window {
            time_s: outcome.time_s,
            point: judged.point(),
            unfit: judged.unfit_for_baseline(),
            accused: accused.map(|component| component.id.clone()).collect(),
        });
    }

    /// Measures a record of the windows of a span; or says why there is none.
    pub(super) fn measure(
        &self,
        span: Span,
        machine: &Machine,
        channels: &[ChannelInfo],
        trends: &[TrendStore],
    ) -> Result<Measured, String> {
        let windows = self.of_span(span)?;
        let features: Vec<Vec<ChannelFeatures>> =
            windows.iter().map(|window| features(window, trends)).collect();
        let offered: Vec<Offered<'_>> = windows
            .iter()
            .zip(&features)
            .map(|(window, features)| Offered {
                point: window.point,
                unfit: window.unfit,
                features,
            })
            .collect();
        let (first, last) = (windows[0].time_s.0, windows[windows.len() - 1].time_s.1);
        let name = format!("windows from {first:.0} s to {last:.0} s of stream time");
        let record = Record::of_offered(&name, &offered, channels, &machine.limits.load_bins);
        Ok(Measured { record, warnings: accusations(&windows) })
    }

    fn of_span(&self, span: Span) -> Result<Vec<&Window>, String> {
        let n_seen = self.windows.len();
        match span {
            Span::Last(n) if n > n_seen => {
                Err(format!("{n} windows are asked for and {n_seen} have been judged so far"))
            }
            Span::Last(n) => Ok(self.windows.iter().skip(n_seen - n).collect()),
            Span::Between(from, to) => {
                let inside = |w: &&Window| w.time_s.0 >= from && w.time_s.1 <= to;
                let found: Vec<&Window> = self.windows.iter().filter(inside).collect();
                if found.is_empty() {
                    let held = match (self.windows.front(), self.windows.back()) {
                        (Some(a), Some(b)) => {
                            format!("held are {:.0} s to {:.0} s", a.time_s.0, b.time_s.1)
                        }
                        (_, _) => "none has been judged yet".to_owned(),
                    };
                    return Err(format!(
                        "no window lies between {from:.0} s and {to:.0} s of stream time; {held}"
                    ));
                }
                Ok(found)
            }
        }
    }
}

/// The features of a window, as the trends hold them.
fn features(window: &Window, trends: &[TrendStore]) -> Vec<ChannelFeatures> {
    let of_channel = |(channel, trend): (usize, &TrendStore)| {
        let values = trend.at(window.time_s.1)?;
        let channel = ChannelIndex(channel);
        Some(ChannelFeatures { channel, sample_range: (0, 0), values })
    };
    trends.iter().enumerate().filter_map(of_channel).collect()
}

/// A baseline of damage would hide it: who is accused in the windows.
fn accusations(windows: &[&Window]) -> Vec<String> {
    let mut by_component: BTreeMap<&str, usize> = BTreeMap::new();
    for id in windows.iter().flat_map(|window| &window.accused) {
        *by_component.entry(id).or_insert(0) += 1;
    }
    let of = windows.len();
    let told = by_component.into_iter().map(|(id, n)| {
        format!("{id} is accused in {n} of {of} windows: a baseline learned of damage hides it")
    });
    told.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::Feature;
    use crate::machine::file;
    use crate::units::Hz;
    use crate::units::Unit;
    use std::sync::Arc;

    /// Windows of 10 s every 5 s whose RMS is their number, from 1; the third is unfit, the fourth accuses.
    fn seen(n: usize) -> (Seen, Vec<TrendStore>) {
        let (mut seen, mut trend) = (Seen::default(), TrendStore::default());
        for i in 1..=n {
            let end_s = 5.0 + 5.0 * i as f64;
            let feature = Feature { name: Arc::from("rms"), value: i as f64, unit: Unit::One };
            let values = vec![feature];
            let channel = ChannelIndex(0);
            trend.push(end_s, &ChannelFeatures { channel, sample_range: (0, 1), values });
            seen.windows.push_back(Window {
                time_s: (end_s - 10.0, end_s),
                point: OperatingPoint { speed: Some(Hz(10.0)), load: None },
                unfit: (i == 3).then_some(Unfit::Stopped),
                accused: if i == 4 { vec!["right".to_owned()] } else { Vec::new() },
            });
        }
        (seen, vec![trend])
    }

    fn measure(span: Span) -> Result<Measured, String> {
        let (seen, trends) = seen(9);
        let machine = file::parse("[machine]\nid='m'\n[[shaft]]\nid='s'\n", "m.toml").unwrap();
        let channel = ChannelInfo {
            name: "x".to_owned(),
            sample_rate: Hz(100.0),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        seen.measure(span, &machine, &[channel], &trends)
    }

    fn rms(found: &Measured) -> f64 {
        found.record.usual[&("x".to_owned(), "rms".to_owned())].log_value.exp()
    }

    #[test]
    fn the_newest_windows_are_measured() {
        let found = measure(Span::Last(5)).unwrap();
        assert!((rms(&found) - 7.0).abs() < 1e-12 && found.warnings.is_empty(), "{found:?}");
        assert_eq!(found.record.name, "windows from 20 s to 50 s of stream time");
        let why = measure(Span::Last(10)).unwrap_err();
        assert!(why.contains("9 have been judged"), "{why}");
    }

    #[test]
    fn windows_wholly_in_a_span_are_measured_and_accusations_told() {
        // Windows 2 to 5: 5…15 s to 20…30 s.
        let found = measure(Span::Between(5.0, 34.9)).unwrap();
        assert_eq!(found.record.n_windows, 3);
        assert!((rms(&found) - 4.0).abs() < 1e-12, "the median of 2, 4 and 5");
        assert_eq!(found.record.left_out["not running"], 1);
        assert!(found.warnings[0].starts_with("right is accused in 1 of 4 windows"));
        let why = measure(Span::Between(100.0, 200.0)).unwrap_err();
        assert!(why.contains("held are 0 s to 50 s"), "{why}");
    }
}
