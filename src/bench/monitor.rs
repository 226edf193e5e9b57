//! The whole pipeline: machines with some channels each, from blocks of samples to verdicts.

use super::clock;
use super::signal::recording;
use super::table::{Cell, Column};
use super::{BenchError, Tell};
use crate::machine::Machine;
use crate::machine::file;
use crate::pipeline::{Monitor, Plans, Settings, SpeedHints};
use crate::plot::Words;
use crate::plot::log_log::{self, Series};
use crate::signal::{Block, ChannelIndex, ChannelInfo, SampleIndex};
use crate::units::{Hz, Unit};
use cpu_time::ThreadTime;
use serde_json::{Value, json};
use std::sync::Arc;

/// Channels of a machine, at most.
const PER_MACHINE: usize = 4;

/// Samples a block: a quarter of a second.
const BLOCK: usize = 2500;

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Numbers of channels.
    pub n_channels: &'static [usize],
    /// Length of the stream, s.
    pub seconds: usize,
    /// Repeats of the whole.
    pub n_rounds: usize,
}

impl Effort {
    /// What figures are published with.
    pub const WHOLE: Self = Self { n_channels: &[1, 4, 16, 64], seconds: 30, n_rounds: 5 };

    /// Seconds of work: shows that it works.
    pub const QUICK: Self = Self { n_channels: &[1, 5], seconds: 11, n_rounds: 1 };

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "seconds": self.seconds,
            "rounds": self.n_rounds,
            "samples_a_second": recording::FS_HZ,
            "channels_a_machine": PER_MACHINE,
            "block_s": BLOCK as f64 / recording::FS_HZ,
            "window_s": Settings::default().window_s,
            "hop_s": Settings::default().hop_s,
            "ring_s": Settings::default().ring_s,
        })
    }
}

/// The columns of the table.
pub const COLUMNS: [Column; 10] = [
    Column { name: "channels", width: 8 },
    Column { name: "cpu_ms_a_channel_s", width: 18 },
    Column { name: "yardsticks", width: 10 },
    Column { name: "spread", width: 6 },
    Column { name: "channels_a_core", width: 15 },
    Column { name: "verdicts", width: 8 },
    Column { name: "latency_p50_ms", width: 14 },
    Column { name: "latency_p99_ms", width: 14 },
    Column { name: "ring_kb_a_channel", width: 17 },
    Column { name: "resident_kb_a_channel", width: 21 },
];

/// Processor time of a channel against their number.
#[must_use]
pub fn plot(rows: &[Vec<Cell>]) -> Option<String> {
    let points = rows.iter().filter_map(|row| match &row[..2] {
        [Cell::Plain(channels, _), Cell::Plain(cost_ms, _)] => Some((*channels, *cost_ms)),
        _ => None,
    });
    let series = [Series { name: "whole pipeline".to_owned(), points: points.collect() }];
    let words = Words {
        title: "Pipeline: processor time of a channel",
        x: "channels",
        y: "processor time a channel-second, ms",
    };
    log_log::log_log(&words, &series)
}

/// Measures each number of channels and hands on its row.
///
/// # Errors
///
/// [`BenchError`] when a machine cannot be built or a row not be told.
pub fn run(effort: &Effort, tell: &mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError> {
    let mut rows = Vec::new();
    for n in effort.n_channels {
        let row = row(*n, effort)?;
        tell(&row)?;
        rows.push(row);
    }
    Ok(rows)
}

fn row(n_channels: usize, effort: &Effort) -> Result<Vec<Cell>, BenchError> {
    let seconds = effort.seconds as f64;
    let stream = Stream::new(n_channels, effort.seconds)?;
    let (mut costs_s, mut latencies_s, mut resident_kb) = (Vec::new(), Vec::new(), 0.0_f64);
    for _ in 0..effort.n_rounds {
        let before_kb = resident_kb_now();
        let (cost_s, latencies, monitors) = stream.round()?;
        costs_s.push(cost_s / (seconds * n_channels as f64));
        latencies_s.extend(latencies);
        // Later rounds find the memory of the first.
        resident_kb = resident_kb.max(resident_kb_now() - before_kb);
        drop(monitors);
    }
    let yardstick_s = clock::round_s(&mut clock::Yardstick::new(), 0.02);
    let cost_s = clock::median(&mut costs_s);
    let spread = (costs_s[costs_s.len() - 1] - costs_s[0]) / cost_s;
    latencies_s.sort_by(f64::total_cmp);
    let quantile = |q: usize| latencies_s[(latencies_s.len() - 1) * q / 100];
    let ring_bytes = Monitor::ring_bytes(&channels(n_channels), &Settings::default());
    Ok(vec![
        Cell::Plain(n_channels as f64, 0),
        Cell::Plain(1e3 * cost_s, 3),
        Cell::Plain(cost_s / yardstick_s, 0),
        Cell::Plain(spread, 2),
        Cell::Plain(1.0 / cost_s, 0),
        Cell::Plain((latencies_s.len() / effort.n_rounds) as f64, 0),
        Cell::Plain(1e3 * quantile(50), 2),
        Cell::Plain(1e3 * quantile(99), 2),
        Cell::Plain(ring_bytes as f64 / 1024.0 / n_channels as f64, 0),
        Cell::Plain(resident_kb / n_channels as f64, 0),
    ])
}

/// Machines and the samples of their channels.
struct Stream {
    machines: Vec<(Arc<Machine>, Vec<ChannelInfo>)>,
    /// What every channel hears, each from another place on.
    samples: Vec<f32>,
    n_blocks: usize,
}

impl Stream {
    fn new(n_channels: usize, seconds: usize) -> Result<Self, BenchError> {
        let mut machines = Vec::new();
        let mut left = n_channels;
        while left > 0 {
            let n = left.min(PER_MACHINE);
            let machine = file::parse(&machine_text(n), "bench.toml")
                .map_err(|mistakes| BenchError::Write(Box::new(mistakes)))?;
            machines.push((Arc::new(machine), channels(n)));
            left -= n;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1e4")]
        let n_blocks = seconds * recording::FS_HZ as usize / BLOCK;
        let samples = recording::gearbox((n_blocks + PER_MACHINE) * BLOCK, 2);
        #[expect(clippy::cast_possible_truncation, reason = "they are numbers of f32")]
        let samples = samples.iter().map(|x| *x as f32).collect();
        Ok(Self { machines, samples, n_blocks })
    }

    /// The stream through new monitors: processor time, and from the arrival of the blocks that end a
    /// window to each verdict, s.
    fn round(&self) -> Result<(f64, Vec<f64>, Vec<Monitor>), BenchError> {
        let hints = SpeedHints { option: None, capture: Some(Hz(recording::SHAFT_HZ)) };
        let mut monitors = Vec::new();
        for (machine, channels) in &self.machines {
            let settings = Settings::default();
            let monitor = Monitor::new(Arc::clone(machine), channels.clone(), hints, &settings)
                .map_err(|error| BenchError::Write(Box::new(error)))?;
            monitors.push(monitor);
        }
        let mut latencies_s = Vec::new();
        let mut plans = Plans::new();
        let mut total_s = 0.0;
        for i in 0..self.n_blocks {
            let mut blocks = Vec::new();
            for (_, channels) in &self.machines {
                blocks.push((0..channels.len()).map(|c| self.block(c, i)).collect::<Vec<_>>());
            }
            // All blocks of this quarter of a second are there now.
            let begun = ThreadTime::now();
            for (monitor, blocks) in monitors.iter_mut().zip(&blocks) {
                // As a shard of the daemon does.
                std::mem::swap(monitor.plans_mut(), &mut plans);
                for block in blocks {
                    monitor.step(block, &mut |outcome| {
                        std::hint::black_box(outcome);
                        latencies_s.push(begun.elapsed().as_secs_f64());
                    });
                }
                std::mem::swap(monitor.plans_mut(), &mut plans);
            }
            total_s += begun.elapsed().as_secs_f64();
        }
        Ok((total_s, latencies_s, monitors))
    }

    fn block(&self, channel: usize, i: usize) -> Block {
        let at = (i + channel) * BLOCK;
        Block {
            channel: ChannelIndex(channel),
            start: SampleIndex((i * BLOCK) as u64),
            segment: 0,
            time_s: (i * BLOCK) as f64 / recording::FS_HZ,
            samples: self.samples[at..at + BLOCK].to_vec(),
        }
    }
}

fn channels(n: usize) -> Vec<ChannelInfo> {
    let channel = |i: usize| ChannelInfo {
        name: format!("c{i}"),
        sample_rate: Hz(recording::FS_HZ),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    (0..n).map(channel).collect()
}

/// A shaft, a gear on it and two bearings, to which the sensors are dealt out.
fn machine_text(n_channels: usize) -> String {
    let fixed = "[machine]\nid = \"gearbox\"\n\
         [[shaft]]\nid = \"input\"\nspeed_hz = 29.7\n\
         [[shaft]]\nid = \"output\"\n\
         [[gear]]\nid = \"pair\"\ndriving = { shaft = \"input\", teeth = 23 }\n\
         driven = { shaft = \"output\", teeth = 67 }\n\
         [[bearing]]\nid = \"near\"\nshaft = \"input\"\nelements = 9\n\
         element_diameter_mm = 7.94\npitch_diameter_mm = 39.04\n\
         [[bearing]]\nid = \"far\"\nshaft = \"input\"\nelements = 8\n\
         element_diameter_mm = 6.746\npitch_diameter_mm = 28.499\n";
    let sensor = |i: usize| {
        let bearing = ["near", "far"][i % 2];
        format!(
            "[[sensor]]\nchannel = \"c{i}\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\n\
             at = {{ bearing = \"{bearing}\" }}\n"
        )
    };
    fixed.to_owned() + &(0..n_channels).map(sensor).collect::<String>()
}

/// Resident memory of this process, kB; 0 where it is not told.
fn resident_kb_now() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    number.and_then(|number| number.parse().ok()).unwrap_or(0.0)
}
