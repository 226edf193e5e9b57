//! What others would integrate a scene with: classical methods on the same model, for comparison alone.
//!
//! A step of the grid is cut at the edges of the load, or not. Nothing here is fast on purpose or slow on purpose: each
//! evaluates the same load as the reference does. Must not be used by the simulator.

use crate::bench::records::steps;
use crate::simulator::etd::Load;
use crate::simulator::model::Model;
use crate::simulator::reference::scene::Setting;
use crate::simulator::run::Watch;

/// A classical method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Method {
    /// Runge and Kutta's of fourth order.
    RungeKutta4,
    /// Newmark's, average acceleration (β = ¼, γ = ½).
    Newmark,
    /// Chung and Hulbert's generalised α of this spectral radius at infinity.
    GeneralisedAlpha(f64),
}

/// Most iterations of an implicit step, and the relative change of the load at which they end.
const MAX_ITERATIONS: usize = 40;
const SAME_LOAD: f64 = 1e-11;

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-9;

/// Displacements of the bearings every `step_s`, as [`crate::bench::records`] has them: each at the beginning of its step.
#[must_use]
pub(super) fn displacements(
    setting: &Setting,
    method: Method,
    (step_s, seconds): (f64, f64),
    is_aligned: bool,
) -> Vec<Vec<f64>> {
    let mut stepper = Stepper::new(setting.model.clone(), method, setting.state.clone());
    let mut lists = vec![Vec::new(); setting.bearings.len()];
    let mut cuts_s = Vec::new();
    let mut angles = Vec::new();
    for i in 0..steps(seconds, step_s) {
        for (list, watch) in lists.iter_mut().zip(&setting.bearings) {
            list.push(stepper.displacement(watch));
        }
        let (from_s, to_s) = (i as f64 * step_s, (i + 1) as f64 * step_s);
        cuts_s.clear();
        if is_aligned {
            stepper.model.edges(from_s, to_s, &mut angles, &mut cuts_s);
        }
        let apart = SAME_TIME * step_s;
        cuts_s.retain(|cut_s| *cut_s > from_s + apart && *cut_s < to_s - apart);
        cuts_s.push(to_s);
        cuts_s.sort_by(f64::total_cmp);
        let mut at_s = from_s;
        for cut_s in &cuts_s {
            if cut_s - at_s > apart {
                if at_s > from_s {
                    // Behind an edge the acceleration is another one.
                    stepper.carried = None;
                }
                stepper.step(at_s, cut_s - at_s);
                at_s = *cut_s;
            }
        }
    }
    lists
}

/// A model between two steps.
struct Stepper {
    model: Model,
    method: Method,
    omega: Vec<f64>,
    damping: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    /// The acceleration that an implicit step hands to the next: not that of the state, but of a time between.
    carried: Option<Vec<f64>>,
}

impl Stepper {
    fn new(model: Model, method: Method, state: Option<(Vec<f64>, Vec<f64>)>) -> Self {
        let oscillators = model.oscillators();
        let (q, v) = model.beginning(state);
        let (omega, damping) = (oscillators.omega_rad_per_s, oscillators.damping);
        Self { model, method, omega, damping, q, v, carried: None }
    }

    fn displacement(&self, watch: &Watch) -> f64 {
        let n = self.model.basis.len();
        let (sin, cos) = watch.axis_rad.sin_cos();
        let along = |offset: usize| -> f64 {
            watch.row.iter().zip(&self.q[offset..]).map(|(phi, q)| phi * q).sum()
        };
        along(0) * cos + along(n) * sin
    }

    fn load(&mut self, time_s: f64, q: &[f64], v: &[f64]) -> Vec<f64> {
        let mut force = vec![0.0; q.len()];
        self.model.force(time_s, q, v, &mut force);
        force
    }

    /// q̈ = f − 2ζωq̇ − ω²q.
    fn acceleration(&mut self, time_s: f64, q: &[f64], v: &[f64]) -> Vec<f64> {
        let mut out = self.load(time_s, q, v);
        for (i, out) in out.iter_mut().enumerate() {
            *out -= self.omega[i] * (self.omega[i] * q[i] + 2.0 * self.damping[i] * v[i]);
        }
        out
    }

    fn step(&mut self, at_s: f64, h: f64) {
        self.model.set_side(at_s + 0.5 * h);
        match self.method {
            Method::RungeKutta4 => self.runge_kutta(at_s, h),
            Method::Newmark => self.alpha(at_s, h, [0.0, 0.0]),
            Method::GeneralisedAlpha(radius) => {
                let of = |x: f64| x / (radius + 1.0);
                self.alpha(at_s, h, [of(2.0 * radius - 1.0), of(radius)]);
            }
        }
    }

    fn runge_kutta(&mut self, at_s: f64, h: f64) {
        let (q, v) = (self.q.clone(), self.v.clone());
        let along = |x: &[f64], part: f64, slope: &[f64]| -> Vec<f64> {
            x.iter().zip(slope).map(|(x, slope)| x + part * h * slope).collect()
        };
        let a1 = self.acceleration(at_s, &q, &v);
        let (q2, v2) = (along(&q, 0.5, &v), along(&v, 0.5, &a1));
        let a2 = self.acceleration(at_s + 0.5 * h, &q2, &v2);
        let (q3, v3) = (along(&q, 0.5, &v2), along(&v, 0.5, &a2));
        let a3 = self.acceleration(at_s + 0.5 * h, &q3, &v3);
        let (q4, v4) = (along(&q, 1.0, &v3), along(&v, 1.0, &a3));
        let a4 = self.acceleration(at_s + h, &q4, &v4);
        for i in 0..q.len() {
            self.q[i] += h / 6.0 * (v[i] + 2.0 * (v2[i] + v3[i]) + v4[i]);
            self.v[i] += h / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]);
        }
    }

    /// Generalised α; α_m = α_f = 0 is Newmark's. The linear part is solved at once, the load by iteration.
    fn alpha(&mut self, at_s: f64, h: f64, [of_mass, of_force]: [f64; 2]) {
        let gamma = 0.5 - of_mass + of_force;
        let beta = 0.25 * (1.0 - of_mass + of_force) * (1.0 - of_mass + of_force);
        let (q, v) = (self.q.clone(), self.v.clone());
        let a = self.carried.take().unwrap_or_else(|| self.acceleration(at_s, &q, &v));
        let mut next = a.clone();
        let before = self.load(at_s, &q, &v);
        let mut after = before.clone();
        for _ in 0..MAX_ITERATIONS {
            for i in 0..q.len() {
                let (omega, damping) = (self.omega[i], 2.0 * self.damping[i] * self.omega[i]);
                let q_free = q[i] + h * v[i] + (0.5 - beta) * h * h * a[i];
                let v_free = v[i] + (1.0 - gamma) * h * a[i];
                let held = (1.0 - of_force) * (damping * v_free + omega * omega * q_free)
                    + of_force * (damping * v[i] + omega * omega * q[i])
                    + of_mass * a[i];
                let force = (1.0 - of_force) * after[i] + of_force * before[i];
                let inertia = 1.0 - of_mass
                    + (1.0 - of_force) * (gamma * h * damping + beta * h * h * omega * omega);
                next[i] = (force - held) / inertia;
                self.q[i] = q_free + beta * h * h * next[i];
                self.v[i] = v_free + gamma * h * next[i];
            }
            let (q, v) = (self.q.clone(), self.v.clone());
            let found = self.load(at_s + h, &q, &v);
            let size = found.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let gap = found.iter().zip(&after).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
            after = found;
            if gap <= SAME_LOAD * size {
                break;
            }
        }
        self.carried = Some(next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::records::{Exact, worst};
    use crate::bench::scenes::{A3, Rig};

    /// Errors of two steps, one half of the other, without a defect and pressed together, so that nothing jumps.
    fn errors(method: Method) -> [f64; 2] {
        let rig = Rig { defect: None, fit: "interference_um = 2.0", eccentricity_um: 25.0, ..A3 };
        let scene = rig.scene().unwrap();
        let setting = Setting::new(&scene).unwrap();
        let exact = Exact::new(&setting, 5e-6, 2e-3, 1e-11);
        [1e-5, 5e-6].map(|step_s| {
            let found = displacements(&setting, method, (step_s, 2e-3), true);
            worst(&found, &exact.at(step_s).bearings)
        })
    }

    #[test]
    fn each_method_has_its_order() {
        for (method, order) in [
            (Method::RungeKutta4, 4.0),
            (Method::Newmark, 2.0),
            (Method::GeneralisedAlpha(0.8), 2.0),
        ] {
            let [coarse, fine] = errors(method);
            let found = (coarse / fine).log2();
            // Two steps only: the next order still counts.
            assert!((found - order).abs() < 0.7, "{method:?}: {coarse:e} {fine:e}");
        }
    }
}
