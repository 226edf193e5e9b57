//! Where 1× points in good health, behind the tacho's mark. Must not know how large it is: that is a line's.

use super::Offered;
use super::Record;
use super::sigma_of_new;
use crate::features::ChannelFeatures;
use crate::features::vector;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use rustfft::num_complex::Complex;
use std::collections::BTreeMap;

/// Of another speed, by more than this part, the direction says nothing: beside a resonance of quality 20, of which nobody may know, a
/// lag turns by 25° in a hundredth of the speed.
const SAME_SPEED: f64 = 0.01;

/// Mean of unit vectors below which they do not agree: 26° on either side.
const AGREEING: f64 = 0.9;

/// A direction that healthy records agree on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// e^(jφ), φ the lag behind the mark.
    pub unit: Complex<f64>,
    /// Standard deviation of a new record's φ when nothing changed, rad.
    pub sigma: f64,
    /// Records it rests on.
    pub n_records: usize,
}

/// Where the vector of 1× points in a window.
#[must_use]
pub fn of_channel(features: &ChannelFeatures) -> Option<Complex<f64>> {
    let [cos, sin] = vector::DIRECTION.map(|name| features.get(name));
    Some(Complex::new(cos?, sin?))
}

fn is_at(speed: Hz, of: Option<Hz>) -> bool {
    of.is_some_and(|of| (of.0 - speed.0).abs() <= SAME_SPEED * speed.0)
}

/// Parts of the directions of the windows at a speed, by channel and name, of channels in which they agree.
pub(super) fn learned(
    windows: &[&Offered<'_>],
    speed: Option<Hz>,
    channels: &[ChannelInfo],
) -> BTreeMap<(String, String), Vec<f64>> {
    let mut of_channels: BTreeMap<&str, Vec<Complex<f64>>> = BTreeMap::new();
    let at = windows.iter().filter(|w| speed.is_some_and(|speed| is_at(speed, w.point.speed)));
    for features in at.flat_map(|window| window.features) {
        if let Some(to) = of_channel(features) {
            of_channels.entry(&channels[features.channel.0].name).or_default().push(to);
        }
    }
    of_channels.retain(|_, to| mean(to).norm() >= AGREEING);
    let parts = of_channels.into_iter().flat_map(|(channel, to)| {
        let [of_cos, of_sin] = vector::DIRECTION.map(|name| (channel.to_owned(), name.to_owned()));
        let (cos, sin) = to.iter().map(|to| (to.re, to.im)).unzip();
        [(of_cos, cos), (of_sin, sin)]
    });
    parts.collect()
}

fn mean(to: &[Complex<f64>]) -> Complex<f64> {
    to.iter().sum::<Complex<f64>>() / to.len().max(1) as f64
}

impl Direction {
    /// The mean over the records at `speed`, if they agree (J10). Scatter as of other numbers (C6): from five records on their own, of
    /// fewer what is assumed of sizes, or that between windows if it is more.
    pub(super) fn of(records: &[Record], channel: &str, speed: Hz) -> Option<Self> {
        let at = records.iter().filter(|record| is_at(speed, record.point.speed));
        let read = |record: &Record| {
            let part = |name: &str| record.usual.get(&(channel.to_owned(), name.to_owned()));
            let [cos, sin] = vector::DIRECTION.map(part);
            let (cos, sin) = (cos?, sin?);
            let within = [cos, sin].map(|u| u.log_scatter.map_or(0.0, |s| s * s));
            let to = Complex::new(cos.log_value, sin.log_value);
            // Medians of parts, of windows that agree.
            (to.norm() >= AGREEING).then(|| (to / to.norm(), within[0] + within[1]))
        };
        let found: Vec<(Complex<f64>, f64)> = at.filter_map(read).collect();
        let n = found.len() as f64;
        let mean = mean(&found.iter().map(|(to, _)| *to).collect::<Vec<_>>());
        if mean.norm() < AGREEING {
            return None;
        }
        let within = found.iter().map(|(_, square)| square).sum::<f64>() / n;
        // Of the two parts the one along the direction hardly scatters: all of it lies across.
        let between: f64 = found.iter().map(|(to, _)| (to - mean).norm_sqr()).sum();
        let sigma = sigma_of_new(between, within, found.len());
        Some(Self { unit: mean / mean.norm(), sigma, n_records: found.len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::baseline::OperatingPoint;
    use crate::diagnosis::baseline::Usual;

    fn record(lag_deg: f64, speed: f64, length: f64) -> Record {
        let (sin, cos) = lag_deg.to_radians().sin_cos();
        let usual = |part: f64| Usual { log_value: part, log_scatter: None, n_windows: 1 };
        let [of_cos, of_sin] = vector::DIRECTION.map(|name| ("x".to_owned(), name.to_owned()));
        Record {
            point: OperatingPoint { speed: Some(Hz(speed)), load: None },
            usual: [(of_cos, usual(length * cos)), (of_sin, usual(length * sin))].into(),
            ..Record::default()
        }
    }

    fn lag_deg(found: Direction) -> f64 {
        found.unit.arg().to_degrees()
    }

    #[test]
    fn records_at_the_speed_tell_the_direction() {
        let records = [record(350.0, 20.0, 1.0), record(20.0, 20.1, 1.0), record(180.0, 20.5, 1.0)];
        let found = Direction::of(&records, "x", Hz(20.0)).unwrap();
        assert!((lag_deg(found) - 5.0).abs() < 1e-9 && found.n_records == 2);
        assert!((found.sigma - 0.2 * 1.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(Direction::of(&records, "y", Hz(20.0)), None);
        assert_eq!(Direction::of(&records, "x", Hz(25.0)), None);
    }

    #[test]
    fn records_that_point_anywhere_tell_nothing() {
        let scattered = [record(30.0, 20.0, 0.5)];
        assert_eq!(Direction::of(&scattered, "x", Hz(20.0)), None);
        let apart = [record(0.0, 20.0, 1.0), record(90.0, 20.0, 1.0)];
        assert_eq!(Direction::of(&apart, "x", Hz(20.0)), None);
    }

    #[test]
    fn five_records_tell_their_scatter() {
        let records: Vec<Record> =
            [-4.0, -2.0, 0.0, 2.0, 4.0].map(|lag| record(lag, 20.0, 1.0)).to_vec();
        let found = Direction::of(&records, "x", Hz(20.0)).unwrap();
        // Lags of 3.16° standard deviation, in radians.
        let expected = 10.0_f64.sqrt().to_radians() * 1.2_f64.sqrt();
        assert!((found.sigma / expected - 1.0).abs() < 1e-2, "{}", found.sigma);
    }
}
