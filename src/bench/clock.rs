//! Processor time of short jobs that take turns.

use cpu_time::ThreadTime;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex32;

/// Points of the yardstick.
const YARDSTICK: usize = 8192;

/// Times of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct Timing {
    /// Median of the rounds, s a call.
    pub call_s: f64,
    /// (Slowest − fastest) ÷ median.
    pub spread: f64,
    /// Median of the rounds' calls ÷ that round's yardstick.
    pub yardsticks: f64,
}

/// What is measured.
pub trait Work {
    /// Does it once.
    fn call(&mut self);
}

/// Makes computers comparable: a forward transform of 8192 complex points by `rustfft`, f32.
pub struct Yardstick {
    plan: std::sync::Arc<dyn rustfft::Fft<f32>>,
    points: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

impl Yardstick {
    /// Plans it.
    #[must_use]
    pub fn new() -> Self {
        let plan = FftPlanner::<f32>::new().plan_fft_forward(YARDSTICK);
        let scratch = vec![Complex32::default(); plan.get_inplace_scratch_len()];
        Self { plan, points: vec![Complex32::new(1.0, 0.0); YARDSTICK], scratch }
    }
}

impl Default for Yardstick {
    fn default() -> Self {
        Self::new()
    }
}

impl std::fmt::Debug for Yardstick {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Yardstick").finish_non_exhaustive()
    }
}

impl Work for Yardstick {
    fn call(&mut self) {
        self.points.fill(Complex32::new(1.0, 0.0));
        self.plan.process_with_scratch(&mut self.points, &mut self.scratch);
        std::hint::black_box(&mut self.points);
    }
}

/// Processor time of this thread a call, from as many calls as take about `seconds`.
pub fn round_s(work: &mut dyn Work, seconds: f64) -> f64 {
    let begun = ThreadTime::now();
    work.call();
    let first_s = begun.elapsed().as_secs_f64().max(1e-8);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let n = (seconds / first_s).clamp(1.0, 1e6) as u32;
    let begun = ThreadTime::now();
    for _ in 0..n {
        work.call();
    }
    begun.elapsed().as_secs_f64() / f64::from(n)
}

/// Measures jobs in turn, `n_rounds` times, each about `seconds` a round.
pub fn in_turn(works: &mut [&mut dyn Work], n_rounds: usize, seconds: f64) -> Vec<Timing> {
    let mut yardstick = Yardstick::new();
    let mut rounds = vec![Vec::new(); works.len()];
    for _ in 0..n_rounds {
        let yardstick_s = round_s(&mut yardstick, seconds);
        for (work, rounds) in works.iter_mut().zip(&mut rounds) {
            rounds.push((round_s(&mut **work, seconds), yardstick_s));
        }
    }
    rounds.iter().map(|rounds| timing(rounds)).collect()
}

fn timing(rounds: &[(f64, f64)]) -> Timing {
    let mut calls: Vec<f64> = rounds.iter().map(|(call_s, _)| *call_s).collect();
    let mut ratios: Vec<f64> =
        rounds.iter().map(|(call_s, yardstick_s)| call_s / yardstick_s).collect();
    let call_s = median(&mut calls);
    // Sorted by now.
    let spread = (calls[calls.len() - 1] - calls[0]) / call_s;
    Timing { call_s, spread, yardsticks: median(&mut ratios) }
}

/// Sorts, and gives the middle.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_spread_and_ratios_are_those_of_the_rounds() {
        let found = timing(&[(3.0, 1.0), (1.0, 1.0), (2.0, 4.0)]);
        assert_eq!(found, Timing { call_s: 2.0, spread: 1.0, yardsticks: 1.0 });
    }

    #[test]
    fn twice_the_work_takes_longer() {
        struct Sum(Vec<f64>);
        impl Work for Sum {
            fn call(&mut self) {
                std::hint::black_box(self.0.iter().map(|x| x.sin()).sum::<f64>());
            }
        }
        let (mut short, mut long) = (Sum(vec![0.5; 500]), Sum(vec![0.5; 5000]));
        let found = in_turn(&mut [&mut short, &mut long], 3, 1e-3);
        assert!(found[1].call_s > 3.0 * found[0].call_s, "{found:?}");
    }
}
