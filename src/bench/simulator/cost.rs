//! Processor time of a scene: building it, running it, and writing it into a capture.

use super::Record;
use crate::bench::BenchError;
use crate::bench::clock::{self, Yardstick, median};
use crate::simulator::build::Plan;
use crate::simulator::scene::Scene;
use crate::simulator::simulation::{Samples, Simulation};
use cpu_time::ProcessTime;
use std::convert::Infallible;

/// Shortest and longest part of a record that is measured, s.
const PARTS_S: (f64, f64) = (0.02, 20.0);

/// What a scene costs; medians.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// What was chosen.
    pub plan: Plan,
    /// How much of the record's beginning was measured, s.
    pub seconds: f64,
    /// To build and to choose the step, s.
    pub setup_s: f64,
    /// A simulated second of those measured, with its sensors, their noise, filters and converters, s.
    pub run_s_per_s: f64,
    /// (Slowest − fastest) ÷ median of that.
    pub spread: f64,
    /// The same in yardsticks ([`Yardstick`]) of the same time.
    pub yardsticks: f64,
    /// A simulated second, written into a capture, s.
    pub written_s_per_s: f64,
}

/// Measures so many repeats of about this processor time, s.
pub(super) fn measure(
    scene: &Scene,
    (n_repeats, repeat_s): (usize, f64),
    record: &mut Record<'_>,
) -> Result<Cost, BenchError> {
    let mut trial = Simulation::new(scene, scene.seed)?;
    let plan = trial.plan().clone();
    // The first part fills caches; the second tells how long the others may be.
    let first_s = part(&mut trial, PARTS_S.0)?;
    let second_s = part(&mut trial, PARTS_S.0)?.min(first_s).max(1e-9);
    let seconds = (PARTS_S.0 * repeat_s / second_s).clamp(PARTS_S.0, PARTS_S.1);
    let mut yardstick = Yardstick::new();
    let (mut setups_s, mut runs_s, mut yardsticks) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..n_repeats {
        let begun = ProcessTime::now();
        let mut simulation = Simulation::new(scene, scene.seed)?;
        setups_s.push(begun.elapsed().as_secs_f64());
        let run_s = part(&mut simulation, seconds)? / seconds;
        runs_s.push(run_s);
        yardsticks.push(run_s / clock::round_s(&mut yardstick, 0.1 * repeat_s));
    }
    let mut written_s = Vec::new();
    let mut short = scene.clone();
    short.duration_s = seconds;
    for _ in 0..n_repeats {
        let mut simulation = Simulation::new(&short, scene.seed)?;
        let begun = ProcessTime::now();
        record(&mut simulation).map_err(BenchError::Write)?;
        written_s.push(begun.elapsed().as_secs_f64() / seconds);
    }
    let run_s_per_s = median(&mut runs_s);
    Ok(Cost {
        plan,
        seconds,
        setup_s: median(&mut setups_s),
        run_s_per_s,
        yardsticks: median(&mut yardsticks),
        // Sorted by now.
        spread: (runs_s[runs_s.len() - 1] - runs_s[0]) / run_s_per_s,
        written_s_per_s: median(&mut written_s),
    })
}

/// Processor time of the next `seconds` of every channel, s.
fn part(simulation: &mut Simulation, seconds: f64) -> Result<f64, BenchError> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to 20 s")]
    let n = (seconds * simulation.rate_hz()).round() as u64;
    let begun = ProcessTime::now();
    simulation.advance(n, &mut |_, samples: Samples<'_>| {
        std::hint::black_box(samples);
        Ok::<(), Infallible>(())
    })?;
    Ok(begun.elapsed().as_secs_f64())
}
