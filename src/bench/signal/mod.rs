//! Speed against error of the signal processing: each transform and precision, and channels a core.
//!
//! `jobs` and `further` have what is measured, `reference` the sums of the definitions, `recording` the signal.

mod further;
mod jobs;
pub(super) mod recording;
mod reference;

use super::clock::{self, Timing, Work};
use super::table::{Cell, Column};
use super::{BenchError, Tell};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use jobs::Named;
use serde_json::{Value, json};

/// Seconds of history.
const HISTORY_S: usize = 10;

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Samples of a second.
    pub n_second: usize,
    /// The same with zeros behind them.
    pub n_padded: usize,
    /// Samples of a spectrum.
    pub n_spectrum: usize,
    /// Scales of the wavelet transform.
    pub n_scales: usize,
    /// Channels with histories of their own.
    pub n_channels: usize,
    /// Rounds in which the jobs take turns.
    pub n_rounds: usize,
    /// Processor time of a job in a round, s, about.
    pub round_s: f64,
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self {
        n_second: 10_000,
        n_padded: 16_384,
        n_spectrum: 8192,
        n_scales: 128,
        n_channels: 64,
        n_rounds: 9,
        round_s: 0.02,
    };

    /// The same with rounds as long as those of the programs that take turns.
    pub const TURNS: Self = Self { round_s: 0.1, ..Self::WHOLE };

    /// The same errors with times that mean little, for every change.
    pub const THINNED: Self = Self { n_channels: 4, n_rounds: 1, round_s: 1e-4, ..Self::WHOLE };

    /// A second of work: shows that it works.
    pub const QUICK: Self = Self {
        n_second: 1000,
        n_padded: 1024,
        n_spectrum: 512,
        n_scales: 8,
        n_channels: 2,
        n_rounds: 3,
        round_s: 1e-4,
    };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "samples_a_second": self.n_second,
            "padded": self.n_padded,
            "spectrum": self.n_spectrum,
            "scales": self.n_scales,
            "channels": self.n_channels,
            "rounds": self.n_rounds,
            "round_s": self.round_s,
        })
    }
}

/// The columns of the table.
pub const COLUMNS: [Column; 10] = [
    Column { name: "job", width: 16 },
    Column { name: "what", width: 25 },
    Column { name: "mode", width: 14 },
    Column { name: "precision", width: 9 },
    Column { name: "cpu_us", width: 9 },
    Column { name: "spread", width: 6 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "error", width: 8 },
    Column { name: "limit", width: 0 },
    Column { name: "channels_a_core", width: 8 },
];

/// Measures all and hands on each row.
///
/// # Errors
///
/// [`BenchError`] when a row cannot be told.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let x = recording::gearbox(HISTORY_S * effort.n_second, 1);
    let single = jobs::names().filter_map(|name| jobs::prepare::<f32>(name, &x, effort));
    let double = jobs::names().filter_map(|name| jobs::prepare::<f64>(name, &x, effort));
    let mut named: Vec<(Named, &str)> = single.map(|job| (job, "f32")).collect();
    named.extend(double.map(|job| (job, "f64")));
    let mut works: Vec<&mut dyn Work> =
        named.iter_mut().map(|(named, _)| &mut *named.job as &mut dyn Work).collect();
    let timings = clock::in_turn(&mut works, effort.n_rounds, effort.round_s);
    let mut rows = Vec::new();
    for ((named, precision), timing) in named.iter_mut().zip(&timings) {
        let row = row(named, precision, timing, &x);
        tell(&row)?;
        rows.push(row);
    }
    Ok(rows)
}

fn row(named: &mut Named, precision: &str, timing: &Timing, x: &[f64]) -> Vec<Cell> {
    let none = || Cell::Text(String::new());
    let channels = 1.0 / timing.call_s;
    vec![
        Cell::Text(named.name.to_owned()),
        Cell::Text(named.what.to_owned()),
        Cell::Text(named.mode.to_owned()),
        Cell::Text(precision.to_owned()),
        Cell::Plain(1e6 * timing.call_s, 2),
        Cell::Plain(timing.spread, 2),
        Cell::Plain(timing.yardsticks, 3),
        named.job.error(x).map_or_else(none, |error| Cell::Number(error, 1)),
        Cell::Number(limit(named, precision), 0),
        if named.is_channel { Cell::Plain(channels, 0) } else { none() },
    ]
}

/// Largest error of a job: of f32 the rounding, and of an envelope its square and a division; f64 far below, but for the
/// mode that leaves out on purpose.
fn limit(named: &Named, precision: &str) -> f64 {
    let is_coarse = named.mode.ends_with("1e-3");
    match (is_coarse, precision) {
        (true, _) => 1e-3,
        // A difference of logarithms near 0.
        (false, "f32") if named.name == "infogram" => 1e-5,
        (false, "f32") => 1e-6,
        // Its support is cut at the same place in both precisions; this recording has little there.
        (false, _) if named.name == "morlet" => 1e-10,
        (false, _) => 1e-11,
    }
}

/// Rows whose error is above its limit.
#[must_use]
pub fn n_missed(rows: &[Vec<Cell>]) -> usize {
    let is_missed = |row: &&Vec<Cell>| match &row[7..9] {
        [Cell::Number(error, _), Cell::Number(limit, _)] => error.is_nan() || error > limit,
        _ => false,
    };
    rows.iter().filter(is_missed).count()
}

/// Names of the jobs that [`Turns`] knows.
#[must_use]
pub fn names() -> Vec<&'static str> {
    jobs::names().collect()
}

/// Rounds of one job in f32, for comparisons in which another program takes turns.
pub struct Turns {
    named: Named,
    yardstick: clock::Yardstick,
    round_s: f64,
}

impl std::fmt::Debug for Turns {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Turns").field("job", &self.named.name).finish_non_exhaustive()
    }
}

impl Turns {
    /// Prepares the job, and does one round that is not told: it fills caches. `None` if there is no such job.
    #[must_use]
    pub fn new(name: &str, effort: &Effort) -> Option<Self> {
        let x = recording::gearbox(HISTORY_S * effort.n_second, 1);
        let mut named = jobs::prepare::<f32>(name, &x, effort)?;
        let _warm = clock::round_s(&mut *named.job, effort.round_s);
        Some(Self { named, yardstick: clock::Yardstick::new(), round_s: effort.round_s })
    }

    /// A round: an object with the processor time of a call and of a yardstick, s.
    pub fn round(&mut self) -> Value {
        let call_s = clock::round_s(&mut *self.named.job, self.round_s);
        let yardstick_s = clock::round_s(&mut self.yardstick, self.round_s);
        json!({ "job": self.named.name, "call_s": call_s, "yardstick_s": yardstick_s })
    }
}

/// Error against cost, a line a transform.
#[must_use]
pub fn plot(rows: &[Vec<Cell>]) -> Option<String> {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let [_, Cell::Text(what), .., Cell::Plain(cpu_us, _), _, _, Cell::Number(error, _), _, _] =
            &row[..]
        else {
            continue;
        };
        let known = series.iter().position(|series| series.name == *what);
        let at = known.unwrap_or_else(|| {
            series.push(Series { name: what.clone(), points: Vec::new() });
            series.len() - 1
        });
        series[at].points.push((*cpu_us, *error));
    }
    for series in &mut series {
        series.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let words = Words {
        title: "Signal processing: error against cost, f32 and f64",
        x: "processor time a call, µs",
        y: "largest error ÷ largest value",
    };
    log_log::log_log(&words, &series)
}
