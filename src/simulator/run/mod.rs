//! A run: steps on a regular grid, cut at every edge of the load, observed at the grid's points.

use super::etd::{Etdrk4, Load};
use super::model::Model;

/// A point and direction of the rotor that is watched.
#[derive(Debug, Clone, PartialEq)]
pub struct Watch {
    /// Row of Φ at the point.
    pub row: Vec<f64>,
    /// Sensitive direction, rad from x towards y.
    pub axis_rad: f64,
    /// Displacement or acceleration.
    pub quantity: Quantity,
}

/// What is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// m.
    Displacement,
    /// m/s².
    Acceleration,
}

/// A model in motion.
#[derive(Debug, Clone)]
pub struct Run {
    model: Model,
    plan: Etdrk4,
    step_s: f64,
    is_aligned: bool,
    n_steps: i64,
    q: Vec<f64>,
    v: Vec<f64>,
    start: Before,
    /// The state before a trial.
    before: Before,
    angles: Vec<f64>,
    cuts_s: Vec<f64>,
}

/// The state before a step, for its observation.
#[derive(Debug, Clone, Default)]
struct Before {
    q: Vec<f64>,
    v: Vec<f64>,
    force: Vec<f64>,
}

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-9;

/// Most times teeth may meet or part between two edges; beyond, the step is taken as it is.
const MOST_CROSSINGS: u32 = 32;

/// Largest step × frequency of a contact, rad. A classical Runge–Kutta step of order 4, which the contacts see, grows from
/// 2.83 on.
const STIFFEST: f64 = 2.0;

/// Most parts of a step: contacts that have become stiffer than that by far are no scene of this world, and would take the processor for
/// hours; what grows beyond it is told to grow.
const MOST_PARTS: u32 = 16;

impl Run {
    /// A run from rest, or from the state given, in steps of `step_s`. Of a state of both planes alone
    /// the torsion rests under its torque.
    ///
    /// # Panics
    ///
    /// If the state does not have one entry a coordinate.
    #[must_use]
    pub fn new(model: Model, step_s: f64, state: Option<(Vec<f64>, Vec<f64>)>) -> Self {
        let n = model.n_coordinates();
        let (q, v) = model.beginning(state);
        Self {
            plan: Etdrk4::new(model.oscillators()),
            model,
            step_s,
            is_aligned: true,
            n_steps: 0,
            start: Before { q: q.clone(), v: v.clone(), force: vec![0.0; n] },
            before: Before { q: q.clone(), v: v.clone(), force: Vec::new() },
            q,
            v,
            angles: Vec::new(),
            cuts_s: Vec::new(),
        }
    }

    /// Counts the steps from this one on: time 0 comes after as many steps as it lies below 0.
    #[must_use]
    pub fn beginning_at(mut self, first_step: i64) -> Self {
        self.n_steps = first_step;
        self
    }

    /// Does not cut steps at edges: what falls into a step happens at its nearer end. Only to show what
    /// the cuts are worth.
    #[must_use]
    pub fn without_cuts(mut self) -> Self {
        self.is_aligned = false;
        self
    }

    /// Exchanges loads and contacts; the motion goes on. The basis must stay the same.
    pub fn change(&mut self, change: impl FnOnce(&mut Model)) {
        change(&mut self.model);
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
        self.start.q.copy_from_slice(&self.q);
        self.start.v.copy_from_slice(&self.v);
        self.cuts_s.clear();
        let mut cuts_s = std::mem::take(&mut self.cuts_s);
        if self.is_aligned {
            self.model.edges(from_s, to_s, &mut self.angles, &mut cuts_s);
        }
        cuts_s.push(to_s);
        cuts_s.sort_by(f64::total_cmp);
        let (mut at_s, mut first) = (from_s, true);
        for &cut_s in &cuts_s {
            let last = cut_s >= to_s;
            let length_s = if first && last { self.step_s } else { cut_s - at_s };
            let near_end = !last && to_s - cut_s < SAME_TIME * self.step_s;
            if length_s < SAME_TIME * self.step_s || near_end {
                continue;
            }
            self.model.set_side(at_s + 0.5 * length_s);
            let n_parts = self.n_parts(length_s);
            let part_s = length_s / f64::from(n_parts);
            for part in 0..n_parts {
                self.smooth(at_s + f64::from(part) * part_s, part_s, first && part == 0);
            }
            first = false;
            at_s = cut_s;
            if last {
                break;
            }
        }
        self.cuts_s = cuts_s;
    }

    /// Into how many parts a step is divided so that it follows the contacts as stiff as they are now (R37): one, where
    /// loads stay near what the step was chosen for; a power of two, so that few lengths come up.
    fn n_parts(&self, length_s: f64) -> u32 {
        let angle = length_s * self.model.contact_rate_bound((&self.q, &self.v), length_s);
        let mut n_parts = 1;
        while n_parts < MOST_PARTS && angle > STIFFEST * f64::from(n_parts) {
            n_parts *= 2;
        }
        n_parts
    }

    /// A step without an edge that is known beforehand, cut where teeth meet or part.
    fn smooth(&mut self, from_s: f64, length_s: f64, mut is_first: bool) {
        let shortest_s = SAME_TIME * self.step_s;
        let (mut at_s, mut left_s) = (from_s, length_s);
        self.model.hold((at_s, &self.q, &self.v));
        for _ in 0..MOST_CROSSINGS {
            self.before.q.copy_from_slice(&self.q);
            self.before.v.copy_from_slice(&self.v);
            self.plan.step(&mut self.model, at_s, left_s, &mut self.q, &mut self.v);
            if is_first {
                self.start.force.copy_from_slice(self.plan.start_force());
            }
            let before = (at_s, &self.before.q[..], &self.before.v[..]);
            let after = (at_s + left_s, &self.q[..], &self.v[..]);
            let Some((gear, crossing)) = self.model.crossing(before, after) else { return };
            let part_s = crossing.part * left_s;
            if left_s - part_s <= shortest_s {
                // The next step begins with what touches then.
                return;
            }
            self.q.copy_from_slice(&self.before.q);
            self.v.copy_from_slice(&self.before.v);
            if part_s > shortest_s {
                self.plan.step(&mut self.model, at_s, part_s, &mut self.q, &mut self.v);
                is_first = false;
                at_s += part_s;
                left_s -= part_s;
            }
            self.model.gears[gear].mesh.cross(crossing);
        }
        self.plan.step(&mut self.model, at_s, left_s, &mut self.q, &mut self.v);
    }

    /// What is watched, at the beginning of the last step.
    #[must_use]
    pub fn observe(&self, watch: &Watch) -> f64 {
        let n = self.model.basis.len();
        let (sin, cos) = watch.axis_rad.sin_cos();
        let [x, y] = [0, n].map(|offset| {
            let value = |(i, phi): (usize, &f64)| phi * self.coordinate(offset + i, watch.quantity);
            watch.row.iter().enumerate().map(value).sum::<f64>()
        });
        x * cos + y * sin
    }

    fn coordinate(&self, i: usize, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Displacement => self.start.q[i],
            Quantity::Acceleration => {
                let oscillators = self.plan.oscillators();
                let (omega, zeta) = (oscillators.omega_rad_per_s[i], oscillators.damping[i]);
                self.start.force[i]
                    - 2.0 * zeta * omega * self.start.v[i]
                    - omega * omega * self.start.q[i]
            }
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

    /// The load at the present state; for tests and references.
    pub fn load(&mut self) -> &mut impl Load {
        &mut self.model
    }
}

#[cfg(test)]
pub(super) mod tests;

#[cfg(test)]
mod gear_tests;
