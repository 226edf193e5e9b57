//! The step of a motion with contacts, by the error it is measured to make (equation R34).
//!
//! The beginning of the scene is run with a step and with its half; what the sensors see of the
//! difference tells the error, and the largest step that keeps the accuracy asked for is taken.

use crate::simulator::model::Model;
use crate::simulator::ports::{PortRun, Sensed, StateRef};
use crate::simulator::run::{Quantity, Watch};
use crate::simulator::scene::Scene;
use std::f64::consts::TAU;

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
const STEPS_S: (f64, f64) = (20e-6, SHORTEST_S);

/// Shortest step of any way, s.
pub(super) const SHORTEST_S: f64 = 0.5e-6;

/// From a try to the next: by the fourth order, a little more, and by this factor at least.
const SHORTER: (f64, f64) = (0.97, 0.9);

/// Length of a trial, s: some ball passes and the transient of a start; and a turn of the shaft, in which
/// every tooth meets once, up to the second.
const TRIAL_S: (f64, f64) = (0.1, 0.25);

/// Error of a step, of the difference to half of it: for an order of 2.5, the least that contacts
/// leave, 1/(1 − 2^−2.5).
const OF_DIFFERENCE: f64 = 1.22;

/// The same where balls touch or leave: what is left depends on where in its step a touch falls, and
/// neighbouring steps differ by up to twice.
const OF_DIFFERENCE_AT_TOUCHES: f64 = 1.8;

/// Steps that differ by less than this factor are not told apart.
const ALIKE: f64 = 1.08;

/// Largest error that still tells something. Two motions of one size that know nothing of each other, as chaotic ones
/// soon do, are apart by twice that at most; what is further apart grows because the step is too long for its contacts.
const LOST: f64 = 2.0 * OF_DIFFERENCE_AT_TOUCHES;

/// Below this accuracy steps are cut at contacts: it costs more than it saves above.
const CUT_BELOW: f64 = 1e-5;

/// What came of the choice.
pub(super) enum Chosen {
    /// The run with the step chosen, from number `begin_samples` of the fastest channel's samples on.
    Run(Box<PortRun>, Choice),
    /// The longest step does not follow the motion at all: what led up to it needs a shorter one too.
    Lost,
}

/// Chooses among the longest step divided by `divisor`, and shorter ones; `None` where [`PortRun`] is not open.
pub(super) fn choose(
    scene: &Scene,
    model: &Model,
    sensed: &[Sensed],
    (rate_hz, begin_samples, divisor): (f64, i64, u32),
    state: Option<StateRef<'_>>,
) -> Option<Chosen> {
    let mut all = sensed.to_vec();
    for seat in &model.seats {
        all.extend([0.0, std::f64::consts::FRAC_PI_2].map(|axis_rad| {
            let row = seat.row.clone();
            let watch = Watch { row, axis_rad, quantity: Quantity::Displacement };
            Sensed { watch, corner_hz: None }
        }));
    }
    let cuts_at_contact = scene.accuracy < CUT_BELOW;
    let steps_at = |step_s: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 2e6")]
        let steps = (1.0 / (rate_hz * step_s) - 1e-9).ceil().max(1.0) as u32;
        steps
    };
    let first = divisor * steps_at(STEPS_S.0);
    let begin = |steps: u32| begin_samples * i64::from(steps);
    let step_s = |steps: u32| 1.0 / (rate_hz * f64::from(steps));
    let base = PortRun::new(model, step_s(first), begin(first), state)?
        .cutting_at_contact(cuts_at_contact);
    let at = |steps: u32| base.clone().with_step(step_s(steps), begin(steps));
    let turn_s = TAU / model.speed.at(0.0).speed_rad_per_s.abs();
    let needed_s = if model.gears.is_empty() { TRIAL_S.0 } else { turn_s };
    let trial_s = needed_s.clamp(TRIAL_S.0, TRIAL_S.1);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 1e6")]
    let n_samples = (trial_s * rate_hz).ceil() as usize;
    let seen = |steps: u32| {
        let mut run = at(steps).watching(&all, steps);
        let mut lists = vec![Vec::new(); all.len()];
        run.fill(n_samples * steps as usize, &mut lists);
        (lists, run.n_touches())
    };
    let error = |steps: u32| {
        let ((coarse, n_touches), (fine, _)) = (seen(steps), seen(2 * steps));
        let factor = if n_touches > 0 { OF_DIFFERENCE_AT_TOUCHES } else { OF_DIFFERENCE };
        factor * difference(&coarse, &fine)
    };
    let found = error(first);
    if is_lost(found) {
        return Some(Chosen::Lost);
    }
    let tried = (first, found);
    let (steps_per_sample, error) = search(scene.accuracy, tried, steps_at(STEPS_S.1), error);
    let run = at(steps_per_sample).watching(sensed, steps_per_sample);
    Some(Chosen::Run(Box::new(run), Choice { steps_per_sample, cuts_at_contact, error }))
}

/// Whether an error tells of a step that does not follow the motion; NaN does.
fn is_lost(error: f64) -> bool {
    error.is_nan() || error > LOST
}

/// The least number of steps from the first, whose error is given, up to `last` whose error is within the accuracy,
/// or the last that was tried, and its error.
fn search(
    accuracy: f64,
    (first, its_error): (u32, f64),
    last: u32,
    error: impl Fn(u32) -> f64,
) -> (u32, f64) {
    let (mut too_few, mut steps, mut found) = (None, first, its_error);
    // NaN counts as too large.
    while found.is_nan() || found > accuracy {
        let by_order = SHORTER.0 * (accuracy / found).sqrt().sqrt();
        let more = f64::from(steps) / by_order.min(SHORTER.1);
        if more.is_nan() || more > f64::from(last) {
            return (steps, found);
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below last")]
        let more = more.ceil() as u32;
        (too_few, steps) = (Some(steps), more);
        found = error(steps);
    }
    // The order may have been higher than the fourth.
    while let Some(few) = too_few.filter(|few| f64::from(steps) > ALIKE * f64::from(few + 1)) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between both")]
        let between = (f64::from(few) * f64::from(steps)).sqrt().round() as u32;
        let between = between.clamp(few + 1, steps - 1);
        let its = error(between);
        if its <= accuracy {
            (steps, found) = (between, its);
        } else {
            too_few = Some(between);
        }
    }
    (steps, found)
}

/// Largest difference of two sets of lists, of the largest value of a list of the second; NaN if a
/// list holds what is no number.
fn difference(coarse: &[Vec<f64>], fine: &[Vec<f64>]) -> f64 {
    let mut largest = 0.0_f64;
    for (coarse, fine) in coarse.iter().zip(fine) {
        let size = fine.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let gaps = coarse.iter().zip(fine).map(|(a, b)| (a - b).abs());
        if coarse.iter().chain(fine).any(|x| !x.is_finite()) {
            return f64::NAN;
        }
        // What sees nothing has no error.
        if size > 0.0 {
            largest = largest.max(gaps.fold(0.0, f64::max) / size);
        }
    }
    largest
}
