//! A rotor without contacts at constant speed, exactly: steady motion by a complex solve, free
//! motion by the matrix exponential (equations R15, R16).
//!
//! The state is (ω·q, q̇) of both planes, so that all entries of the system are of one size. Must not
//! know scenes.

mod run;

use super::etd::Load;
use super::model::{MAX_SHAFTS, Model, TurningLoads};
use super::run::{Quantity, Watch};
use nalgebra::{DMatrix, DVector};
pub use run::LinearRun;
use std::f64::consts::TAU;

/// The system ẏ = A·y + b + Σ Re(c·e^{iφ}), φ = Ω·t of every shaft, of a model at constant speed.
///
/// Ball bearings and gears are taken as what is in the shapes for them.
#[derive(Debug, Clone)]
pub struct LinearSystem {
    matrix: DMatrix<f64>,
    omega: Vec<f64>,
    /// Shapes of a plane.
    n_plane: usize,
    speed_rad_per_s: f64,
}

/// A steady motion: constant part of the state, and what turns with each shaft.
#[derive(Debug, Clone)]
pub struct Steady {
    constant: DVector<f64>,
    turning: Vec<Phasor>,
}

/// What turns with a shaft: Re(Y·e^{i·turns·φ}), φ the angle of the first.
#[derive(Debug, Clone)]
struct Phasor {
    turns: f64,
    re: DVector<f64>,
    im: DVector<f64>,
}

/// What is seen of a steady motion: constant part, and cos and sin part of each shaft.
pub(super) type Still = [f64; 1 + 2 * MAX_SHAFTS];

impl LinearSystem {
    /// Takes the system out of a model that turns at `speed_rad_per_s`.
    #[must_use]
    pub fn new(model: &Model, speed_rad_per_s: f64) -> Self {
        let n = model.basis.len();
        let mut bare = model.clone();
        bare.seats.clear();
        bare.gears.clear();
        bare.torsion.iter_mut().for_each(|torsion| torsion.torque.fill(0.0));
        bare.shafts.clear();
        bare.constant = [vec![0.0; n], vec![0.0; n]];
        bare.speed = super::speed::SpeedProfile::Constant(speed_rad_per_s / TAU);
        let oscillators = bare.oscillators();
        let omega = oscillators.omega_rad_per_s.clone();
        let size = bare.n_coordinates();
        let mut matrix = DMatrix::zeros(2 * size, 2 * size);
        let (mut q, mut v, mut force) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        for j in 0..size {
            // A unit of ω·q.
            q[j] = 1.0 / omega[j];
            bare.force(0.0, &q, &v, &mut force);
            q[j] = 0.0;
            for i in 0..size {
                matrix[(size + i, j)] = force[i];
            }
            matrix[(size + j, j)] -= omega[j];
            // A unit of velocity.
            v[j] = 1.0;
            bare.force(0.0, &q, &v, &mut force);
            v[j] = 0.0;
            for i in 0..size {
                matrix[(size + i, size + j)] = force[i];
            }
            matrix[(size + j, size + j)] -= 2.0 * oscillators.damping[j] * omega[j];
            matrix[(j, size + j)] = omega[j];
        }
        Self { matrix, omega, n_plane: n, speed_rad_per_s }
    }

    /// Largest real part of the eigenvalues of A, rad/s: above 0, motions grow.
    #[must_use]
    pub fn growth_rad_per_s(&self) -> f64 {
        self.matrix.complex_eigenvalues().iter().map(|z| z.re).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The steady motion under the model's loads (R15): `None` where it would be infinite.
    #[must_use]
    pub fn steady(&self, model: &Model) -> Option<Steady> {
        let turning = model.shafts.iter().map(|shaft| self.phasor(shaft));
        let torque = model.torsion.as_ref().map_or(&[][..], |torsion| &torsion.torque[..]);
        let constant = [&model.constant[0][..], &model.constant[1][..], torque].concat();
        let turning = turning.collect::<Option<Vec<_>>>()?;
        let constant = (-&self.matrix).lu().solve(&self.lower(&constant))?;
        constant.iter().all(|x| x.is_finite()).then_some(Steady { constant, turning })
    }

    /// A force on the coordinates as a rate of the state.
    fn lower(&self, force: &[f64]) -> DVector<f64> {
        let size = self.omega.len();
        let at = |i: usize| force.get(i).copied().unwrap_or(0.0);
        DVector::from_fn(2 * size, |i, _| if i < size { 0.0 } else { at(i - size) })
    }

    /// (iΩ − A)·Y = c as one real system of twice the size, Ω the speed of this shaft.
    fn phasor(&self, shaft: &TurningLoads) -> Option<Phasor> {
        let speed = shaft.turns * self.speed_rad_per_s;
        let (re, im) = Model::turning_force(shaft, speed);
        let n = 2 * self.omega.len();
        let mut both = DMatrix::zeros(2 * n, 2 * n);
        both.view_mut((0, 0), (n, n)).copy_from(&(-&self.matrix));
        both.view_mut((n, n), (n, n)).copy_from(&(-&self.matrix));
        for i in 0..n {
            both[(i, n + i)] = -speed;
            both[(n + i, i)] = speed;
        }
        let (re, im) = (self.lower(&re), self.lower(&im));
        let right = DVector::from_fn(2 * n, |i, _| if i < n { re[i] } else { im[i - n] });
        let phasor = both.lu().solve(&right)?;
        let (re, im) = (phasor.rows(0, n).into_owned(), phasor.rows(n, n).into_owned());
        let is_finite = phasor.iter().all(|x| x.is_finite());
        is_finite.then_some(Phasor { turns: shaft.turns, re, im })
    }

    /// exp(A·h): carries a free motion over `step_s` (R16).
    #[must_use]
    pub fn propagator(&self, step_s: f64) -> DMatrix<f64> {
        (&self.matrix * step_s).exp()
    }

    /// A, in rad/s.
    pub(super) fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// What a unit force along a row over all coordinates does to ẏ.
    pub(super) fn input(&self, row: &[f64]) -> DVector<f64> {
        let size = self.omega.len();
        DVector::from_fn(2 * size, |i, _| if i < size { 0.0 } else { row[i - size] })
    }

    /// The displacement along a row over all coordinates, as a row over y.
    pub(super) fn displacement(&self, row: &[f64]) -> DVector<f64> {
        let size = self.omega.len();
        DVector::from_fn(2 * size, |i, _| if i < size { row[i] / self.omega[i] } else { 0.0 })
    }

    /// The velocity along a row over all coordinates, as a row over y.
    pub(super) fn velocity(&self, row: &[f64]) -> DVector<f64> {
        self.input(row)
    }

    /// Adds a spring, N/m, and a damper, N·s/m, which see the motion along one row over all
    /// coordinates and push against it along another.
    pub(super) fn stiffen(&mut self, push: &[f64], see: &[f64], spring: f64, damper: f64) {
        let size = self.omega.len();
        for (i, push) in push.iter().enumerate() {
            for (j, see) in see.iter().enumerate() {
                self.matrix[(size + i, j)] -= push * see * spring / self.omega[j];
                self.matrix[(size + i, size + j)] -= push * see * damper;
            }
        }
    }

    /// What a unit force along a row over all coordinates shows at once to a watch.
    pub(super) fn direct(&self, watch: &Watch, row: &[f64]) -> f64 {
        match watch.quantity {
            Quantity::Displacement => 0.0,
            Quantity::Acceleration => {
                let weights = self.weights(watch);
                weights.zip(row).map(|(weight, row)| weight * row).sum()
            }
        }
    }

    /// A watch's weights of all coordinates.
    fn weights(&self, watch: &Watch) -> impl Iterator<Item = f64> {
        let n = self.n_plane;
        let (sin, cos) = watch.axis_rad.sin_cos();
        let weight = move |i: usize| match i / n {
            0 => watch.row[i] * cos,
            1 => watch.row[i - n] * sin,
            _ => 0.0,
        };
        (0..self.omega.len()).map(weight)
    }

    /// Displacements and velocities of a state.
    pub(super) fn coordinates(&self, state: &DVector<f64>) -> (Vec<f64>, Vec<f64>) {
        let size = self.omega.len();
        let q = (0..size).map(|i| state[i] / self.omega[i]).collect();
        (q, state.rows(size, size).iter().copied().collect())
    }

    /// The state of displacements and velocities.
    pub(super) fn state(&self, q: &[f64], v: &[f64]) -> DVector<f64> {
        let size = self.omega.len();
        DVector::from_fn(2 * size, |i, _| if i < size { q[i] * self.omega[i] } else { v[i - size] })
    }

    /// What a watch makes of a free state: one row.
    fn row(&self, watch: &Watch) -> DVector<f64> {
        let weights: Vec<f64> = self.weights(watch).collect();
        match watch.quantity {
            Quantity::Displacement => self.displacement(&weights),
            Quantity::Acceleration => {
                let size = self.omega.len();
                self.matrix.rows(size, size).transpose() * DVector::from_vec(weights)
            }
        }
    }
}

impl Steady {
    /// Constant, cos and sin parts of what a row over the state sees.
    pub(super) fn seen_by(&self, row: &DVector<f64>) -> Still {
        let mut still = [0.0; 1 + 2 * MAX_SHAFTS];
        still[0] = row.dot(&self.constant);
        for (parts, phasor) in still[1..].chunks_exact_mut(2).zip(&self.turning) {
            parts.copy_from_slice(&[row.dot(&phasor.re), -row.dot(&phasor.im)]);
        }
        still
    }

    /// Number of shafts.
    pub(super) fn n_shafts(&self) -> usize {
        self.turning.len()
    }

    /// Speed of every shaft, rad/s.
    pub(super) fn speeds_rad_per_s(&self, system: &LinearSystem) -> impl Iterator<Item = f64> {
        self.turning.iter().map(|phasor| phasor.turns * system.speed_rad_per_s)
    }

    /// Largest part of the state.
    fn largest(&self) -> f64 {
        let turning = self.turning.iter().map(|phasor| phasor.re.amax().max(phasor.im.amax()));
        turning.fold(self.constant.amax(), f64::max)
    }

    /// Displacements and velocities at angle φ of the first shaft.
    #[must_use]
    pub fn at(&self, system: &LinearSystem, angle_rad: f64) -> (Vec<f64>, Vec<f64>) {
        system.coordinates(&self.state(angle_rad))
    }

    pub(super) fn state(&self, angle_rad: f64) -> DVector<f64> {
        let mut state = self.constant.clone();
        for Phasor { turns, re, im } in &self.turning {
            let (sin, cos) = (turns * angle_rad).sin_cos();
            state += re * cos - im * sin;
        }
        state
    }
}

/// What is seen of a linear motion by one watch.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub(super) row: DVector<f64>,
    pub(super) still: Still,
}

impl Seen {
    /// What `watch` sees.
    pub(super) fn by(system: &LinearSystem, steady: &Steady, watch: &Watch) -> Self {
        let row = system.row(watch);
        let still = match watch.quantity {
            Quantity::Displacement => steady.seen_by(&row),
            Quantity::Acceleration => {
                // −Ω² times the displacement: the loads of the steady motion are not in the row.
                let still = Watch { quantity: Quantity::Displacement, ..watch.clone() };
                let mut seen = steady.seen_by(&system.row(&still));
                seen[0] = 0.0;
                for (parts, phasor) in seen[1..].chunks_exact_mut(2).zip(&steady.turning) {
                    let speed = phasor.turns * system.speed_rad_per_s;
                    parts.iter_mut().for_each(|part| *part *= -speed * speed);
                }
                seen
            }
        };
        Self { row, still }
    }
}

#[cfg(test)]
mod tests;
