//! The step of a motion with contacts, by the error it is measured to make (equation R34).
//!
//! The first moments of the scene are run with a step and with its half; what the sensors see of
//! the difference tells the error, and the largest step that keeps the accuracy asked for is taken.

use crate::simulator::model::Model;
use crate::simulator::ports::PortRun;
use crate::simulator::run::{Quantity, Watch};
use crate::simulator::scene::{Scene, SensorKind};
use crate::simulator::sensor::{Chain, SensorModel};

/// What was chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Choice {
    /// Steps a sample of the fastest channel.
    pub(super) steps_per_sample: u32,
    /// Whether steps are cut where balls touch or leave.
    pub(super) cuts_at_contact: bool,
    /// Measured relative error of what sensors see and bearings do.
    pub(super) error: f64,
}

/// Longest and shortest step, s. The longest also bounds what a fault injected later can cost: 1e-4
/// on set A.
const STEPS_S: (f64, f64) = (20e-6, 0.5e-6);

/// From a try to the next: fourth order makes the error a quarter.
const SHORTER: f64 = std::f64::consts::SQRT_2;

/// Length of a trial, s: some ball passes, and the transient of a start.
const TRIAL_S: f64 = 0.05;

/// Error of a step, of the difference to half of it: for an order of 2.5, the least that contacts
/// leave, 1/(1 − 2^−2.5).
const OF_DIFFERENCE: f64 = 1.22;

/// Below this accuracy steps are cut at contacts: it costs more than it saves above.
const CUT_BELOW: f64 = 1e-5;

/// The run with the step chosen, from number `begin_samples` of the fastest channel's samples on.
pub(super) fn choose(
    scene: &Scene,
    model: &Model,
    watches: &[Watch],
    (rate_hz, begin_samples): (f64, i64),
    state: Option<(&[f64], &[f64])>,
) -> Option<(PortRun, Choice)> {
    let trial = Trial { scene, rate_hz, n_seen: watches.len() };
    let mut all = watches.to_vec();
    for seat in &model.seats {
        all.extend([0.0, std::f64::consts::FRAC_PI_2].map(|axis_rad| Watch {
            row: seat.row.clone(),
            axis_rad,
            quantity: Quantity::Displacement,
        }));
    }
    let cuts_at_contact = scene.accuracy < CUT_BELOW;
    let steps_at = |step_s: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 2e6")]
        let steps = (1.0 / (rate_hz * step_s) - 1e-9).ceil().max(1.0) as u32;
        steps
    };
    let first = steps_at(STEPS_S.0);
    let begin = |steps: u32| begin_samples * i64::from(steps);
    let step_s = |steps: u32| 1.0 / (rate_hz * f64::from(steps));
    let base = PortRun::new(model, &all, step_s(first), begin(first), state)?
        .cutting_at_contact(cuts_at_contact);
    let mut at_s = STEPS_S.0;
    loop {
        let steps = steps_at(at_s);
        let run = |steps: u32| base.clone().with_step(step_s(steps), begin(steps));
        let error = trial.error(run(steps), run(2 * steps), steps);
        // NaN counts as too large.
        let is_enough = error <= scene.accuracy;
        let shorter_s = (scene.accuracy / error).sqrt().sqrt().min(1.0 / SHORTER) * at_s;
        if is_enough || !(shorter_s >= STEPS_S.1) {
            let run = base.watching(watches).with_step(step_s(steps), begin(steps));
            return Some((run, Choice { steps_per_sample: steps, cuts_at_contact, error }));
        }
        at_s = shorter_s;
    }
}

/// How the error is measured.
struct Trial<'a> {
    scene: &'a Scene,
    rate_hz: f64,
    /// The first of the watches are the sensors'.
    n_seen: usize,
}

impl Trial<'_> {
    /// Largest error of what is watched, of its largest value.
    fn error(&self, mut coarse: PortRun, mut fine: PortRun, steps: u32) -> f64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 1e6")]
        let n_samples = (TRIAL_S * self.rate_hz).ceil() as usize;
        let n = n_samples * steps as usize;
        let n_watches = coarse.n_watches();
        let mut lists = [vec![Vec::new(); n_watches], vec![Vec::new(); n_watches]];
        coarse.fill(n, &mut lists[0]);
        fine.fill(2 * n, &mut lists[1]);
        let [coarse, fine] = lists;
        let watching = self.scene.sensors.iter().filter(|s| s.kind != SensorKind::Tacho);
        let corners: Vec<f64> = watching.map(|sensor| sensor.corner_hz).collect();
        let mut largest = 0.0_f64;
        for (i, (coarse, fine)) in coarse.iter().zip(&fine).enumerate() {
            let fine: Vec<f64> = fine.iter().step_by(2).copied().collect();
            let corner_hz = corners.get(i).copied().filter(|_| i < self.n_seen);
            let [coarse, fine] =
                [coarse, &fine].map(|list| filtered(list, (self.rate_hz, steps), corner_hz));
            let size = fine.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let gap = coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let error = OF_DIFFERENCE * gap / size;
            // A watch that sees nothing has no error; one that sees no number has every error.
            if size > 0.0 || size.is_nan() {
                largest = if error.is_nan() { f64::NAN } else { largest.max(error) };
            }
        }
        largest
    }
}

/// What the anti-alias filter lets through, at the rate of the samples.
fn filtered(list: &[f64], (rate_hz, steps): (f64, u32), corner_hz: Option<f64>) -> Vec<f64> {
    let Some(corner_hz) = corner_hz else { return list.to_vec() };
    let model = SensorModel {
        oversampling: steps,
        rate_hz,
        corner_hz: Some(corner_hz),
        noise_density: 0.0,
        drift_per_s: 0.0,
        rest: 0.0,
        converter: None,
        dropouts_s: Vec::new(),
    };
    let mut chain = Chain::new(model, 0, 0);
    list.iter().filter_map(|x| chain.push(*x)).collect()
}
