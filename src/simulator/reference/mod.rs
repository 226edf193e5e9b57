//! The slow reference of a run: the same model, integrated to a tolerance and not by steps.
//!
//! [`Reference`] is asked like [`Run`](super::run::Run) and gives the same quantities at the same grid
//! points, but follows the motion between them by [`extrapolation`], restarted at every edge of the
//! load; where contact is lost or made, the step control finds its way. Tests and `bench` hold
//! the fast paths against it; [`scene`] makes the model of a scene for both. No fast path may know it.

pub mod extrapolation;
pub mod scene;

use self::extrapolation::Extrapolation;
use super::etd::Load;
use super::model::Model;
use super::run::{Quantity, Watch};

/// A model in motion, followed to a tolerance.
#[derive(Debug, Clone)]
pub struct Reference {
    model: Model,
    plan: Extrapolation,
    step_s: f64,
    n_steps: i64,
    q: Vec<f64>,
    v: Vec<f64>,
    /// Displacement, velocity and load at the beginning of the last step.
    before: [Vec<f64>; 3],
    angles: Vec<f64>,
    cuts_s: Vec<f64>,
}

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-12;

impl Reference {
    /// A reference from rest, or from the state given (of both planes alone: the torsion then rests
    /// under its torque), that can be observed every `step_s`, with an error of at most `tolerance` of
    /// the largest state in each step.
    ///
    /// # Panics
    ///
    /// If the state does not have one entry a coordinate.
    #[must_use]
    pub fn new(
        model: Model,
        step_s: f64,
        state: Option<(Vec<f64>, Vec<f64>)>,
        tolerance: f64,
    ) -> Self {
        let n = model.n_coordinates();
        let (q, v) = model.beginning(state);
        Self {
            plan: Extrapolation::new(model.oscillators(), tolerance),
            model,
            step_s,
            n_steps: 0,
            before: [q.clone(), v.clone(), vec![0.0; n]],
            q,
            v,
            angles: Vec::new(),
            cuts_s: Vec::new(),
        }
    }

    /// Time at which the next step begins, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.n_steps as f64 * self.step_s
    }

    /// Takes one step of the grid; observations then refer to its beginning.
    pub fn step(&mut self) {
        let from_s = self.time_s();
        self.n_steps += 1;
        let to_s = self.time_s();
        let mut cuts_s = std::mem::take(&mut self.cuts_s);
        cuts_s.clear();
        self.model.edges(from_s, to_s, &mut self.angles, &mut cuts_s);
        let apart = SAME_TIME * self.step_s;
        cuts_s.retain(|cut_s| *cut_s > from_s + apart && *cut_s < to_s - apart);
        cuts_s.push(to_s);
        cuts_s.sort_by(f64::total_cmp);
        cuts_s.dedup_by(|later, earlier| *later - *earlier < apart);
        let [q, v, force] = &mut self.before;
        q.copy_from_slice(&self.q);
        v.copy_from_slice(&self.v);
        self.model.set_side(0.5 * (from_s + cuts_s[0]));
        self.model.force(from_s, q, v, force);
        let mut at_s = from_s;
        for &cut_s in &cuts_s {
            self.model.set_side(0.5 * (at_s + cut_s));
            self.plan.carry(&mut self.model, (at_s, cut_s), &mut self.q, &mut self.v);
            at_s = cut_s;
        }
        self.cuts_s = cuts_s;
    }

    /// What is watched, at the beginning of the last step.
    #[must_use]
    pub fn observe(&self, watch: &Watch) -> f64 {
        let n = self.model.basis.len();
        let (sin, cos) = watch.axis_rad.sin_cos();
        let along = |offset: usize| -> f64 {
            let part = |(i, phi): (usize, &f64)| phi * self.coordinate(offset + i, watch.quantity);
            watch.row.iter().enumerate().map(part).sum()
        };
        along(0) * cos + along(n) * sin
    }

    fn coordinate(&self, i: usize, quantity: Quantity) -> f64 {
        let [q, v, force] = &self.before;
        let oscillators = self.plan.oscillators();
        let (omega, zeta) = (oscillators.omega_rad_per_s[i], oscillators.damping[i]);
        match quantity {
            Quantity::Displacement => q[i],
            Quantity::Acceleration => force[i] - omega * (omega * q[i] + 2.0 * zeta * v[i]),
        }
    }

    /// The model, with its contacts.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Displacements and velocities of the coordinates after the last step.
    #[must_use]
    pub fn state(&self) -> (&[f64], &[f64]) {
        (&self.q, &self.v)
    }

    /// The same, which gives up after so many evaluations of the load, in the middle of a step if need be.
    #[must_use]
    pub fn within(mut self, max_forces: u64) -> Self {
        self.plan = self.plan.within(max_forces);
        self
    }

    /// Whether it has given up: what is observed then means nothing.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.plan.is_spent()
    }

    /// Evaluations of the load so far.
    #[must_use]
    pub fn n_forces(&self) -> u64 {
        self.plan.n_forces()
    }
}

#[cfg(test)]
mod tests;
