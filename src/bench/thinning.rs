//! Verdicts against channels a core: what is lost when the analysis is thinned.
//!
//! Bearing trials of the stand, with their known answers, judged in windows of several lengths, at fractions of their
//! sampling rate, and in fewer demodulation bands. A trial is cut into windows; its verdict is that of all of them.

use super::clock::{self, Yardstick};
use super::table::{Cell, Column};
use super::{BenchError, Tell};
use crate::dsp::fir::Decimator;
use crate::evaluation::score::{self, Outcome};
use crate::features::bands;
use crate::trials::Trial;
use crate::trials::grid::{self, Part, Plan, Task};
use crate::units::Hz;
use cpu_time::ThreadTime;
use serde_json::{Value, json};
use std::ops::ControlFlow;

/// The columns of the table.
pub const COLUMNS: [Column; 13] = [
    Column { name: "window_s", width: 8 },
    Column { name: "rate_part", width: 9 },
    Column { name: "bands", width: 5 },
    Column { name: "trials", width: 6 },
    Column { name: "right", width: 5 },
    Column { name: "detected", width: 8 },
    Column { name: "undetermined", width: 12 },
    Column { name: "missed", width: 6 },
    Column { name: "wrong_cause", width: 11 },
    Column { name: "false_alarm", width: 11 },
    Column { name: "cpu_ms_a_channel_s", width: 18 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "channels_a_core", width: 15 },
];

/// How the analysis is thinned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinned {
    /// Length of a window, s.
    pub window_s: f64,
    /// One sample of so many is kept.
    pub every: u32,
    /// Levels of demodulation bands.
    pub band_levels: usize,
}

/// Not thinned: trials are of this length.
const WHOLE: Thinned = Thinned { window_s: 12.0, every: 1, band_levels: bands::LEVELS };

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Trials of the stand, evenly taken from a seed's.
    pub n_trials: usize,
    /// How the analysis is thinned.
    pub settings: &'static [Thinned],
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self {
        n_trials: 120,
        settings: &[
            WHOLE,
            Thinned { window_s: 6.0, ..WHOLE },
            Thinned { window_s: 3.0, ..WHOLE },
            Thinned { window_s: 1.5, ..WHOLE },
            Thinned { every: 2, ..WHOLE },
            Thinned { every: 4, ..WHOLE },
            Thinned { band_levels: 2, ..WHOLE },
            Thinned { band_levels: 1, ..WHOLE },
            Thinned { window_s: 6.0, every: 2, ..WHOLE },
            Thinned { window_s: 6.0, every: 2, band_levels: 2 },
        ],
    };

    /// Minutes of work, for every change.
    pub const THINNED: Self = Self {
        n_trials: 10,
        settings: &[WHOLE, Thinned { window_s: 6.0, every: 2, band_levels: 2 }],
    };

    /// A second of work: shows that it works.
    pub const QUICK: Self =
        Self { n_trials: 1, settings: &[Thinned { window_s: 3.0, every: 4, band_levels: 1 }] };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({ "trials": self.n_trials, "first_seed": grid::FIRST_REPORTED_SEED })
    }
}

/// Measures every setting and hands on its row.
///
/// # Errors
///
/// [`BenchError`] when a trial cannot be made or judged.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let plan = Plan {
        first_seed: grid::FIRST_REPORTED_SEED,
        n_seeds: 1,
        is_thin: true,
        is_healthy: false,
        part: Some(Part::Stand),
    };
    let tasks = grid::tasks(&plan);
    let every = (tasks.len() / effort.n_trials.max(1)).max(1);
    let mut rows = Vec::new();
    for thinned in effort.settings {
        let taken = tasks.iter().step_by(every).take(effort.n_trials);
        let row = row(taken, *thinned)?;
        tell(&row)?;
        rows.push(row);
    }
    Ok(rows)
}

fn row<'t>(
    tasks: impl Iterator<Item = &'t Task>,
    Thinned { window_s, every, band_levels }: Thinned,
) -> Result<Vec<Cell>, BenchError> {
    let mut outcomes = Vec::new();
    let (mut cpu_s, mut channel_s) = (0.0, 0.0);
    for task in tasks {
        let mut trials = Vec::new();
        let _all = task.each(&mut |trial| {
            trials.push(trial);
            ControlFlow::Continue(())
        });
        for trial in trials {
            let mut trial = trial.map_err(|why| BenchError::Write(why.into()))?;
            thin(&mut trial, every);
            channel_s += seconds(&trial);
            let begun = ThreadTime::now();
            let diagnosis = trial.diagnose_thinned(window_s, band_levels);
            cpu_s += begun.elapsed().as_secs_f64();
            let diagnosis = diagnosis.map_err(|error| BenchError::Write(Box::new(error)))?;
            let scored = diagnosis.map(|d| score::score(&trial.known, &[], &d)).transpose();
            let scored = scored.map_err(|error| BenchError::Write(Box::new(error)))?;
            outcomes.push(scored.map_or(Outcome::Undetermined, |score| score.outcome));
        }
    }
    let count = |outcome: Outcome| {
        Cell::Plain(outcomes.iter().filter(|found| **found == outcome).count() as f64, 0)
    };
    let cost_s = cpu_s / channel_s;
    let yardstick_s = clock::round_s(&mut Yardstick::new(), 0.02);
    Ok(vec![
        Cell::Plain(window_s, 1),
        Cell::Plain(1.0 / f64::from(every), 2),
        // Each as measured and whitened.
        Cell::Plain((2 * ((1 << band_levels) - 1)) as f64, 0),
        Cell::Plain(outcomes.len() as f64, 0),
        count(Outcome::Right),
        count(Outcome::Detected),
        count(Outcome::Undetermined),
        count(Outcome::Missed),
        count(Outcome::WrongCause),
        count(Outcome::FalseAlarm),
        Cell::Plain(1e3 * cost_s, 3),
        Cell::Plain(cost_s / yardstick_s, 0),
        Cell::Plain(1.0 / cost_s, 0),
    ])
}

/// Keeps one sample of so many of every vibration channel, filtered; the tacho stays.
fn thin(trial: &mut Trial, every: u32) {
    if every < 2 {
        return;
    }
    let measured = &mut trial.measured;
    for (info, samples) in measured.channels.iter_mut().zip(&mut measured.samples) {
        let sensor = measured.machine.sensors.iter().find(|sensor| sensor.channel == info.name);
        if !sensor.is_some_and(|sensor| sensor.kind.is_vibration()) {
            continue;
        }
        let mut decimator = Decimator::new(every as usize);
        let mut out = vec![0.0_f32; decimator.out_len(samples.len())];
        decimator.process(samples, &mut out);
        // What the filter holds back, so that time 0 stays where the tacho has it.
        out.drain(..decimator.lag_outputs().min(out.len()));
        *samples = out;
        info.sample_rate = Hz(info.sample_rate.0 / f64::from(every));
    }
}

/// Seconds of all channels.
fn seconds(trial: &Trial) -> f64 {
    let measured = &trial.measured;
    let pairs = measured.channels.iter().zip(&measured.samples);
    pairs.map(|(info, samples)| samples.len() as f64 / info.sample_rate.0).sum()
}
