//! Modal reduction with static attachment shapes (equation R7).
//!
//! A few low modes carry the dynamics; one static shape per force station carries what the cut
//! modes would answer statically, without which motion at a stiff support comes out too small. The
//! basis is made orthonormal as a whole, so that every coordinate is an oscillator of its own.

use super::rotor::Plane;
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

/// A basis in which one plane is a set of oscillators: Φᵀ·M·Φ = 1, Φᵀ·K·Φ = diag(ω²).
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    /// Natural angular frequencies ω, rad/s, rising.
    pub omega_rad_per_s: Vec<f64>,
    /// Shapes Φ, one a column, by the degrees of freedom of the plane, 1/√kg.
    pub shapes: DMatrix<f64>,
    /// Gyroscopic matrix Φᵀ·H·Φ, 1/(rad/s) of speed.
    pub gyroscopic: DMatrix<f64>,
}

/// Why a plane could not be reduced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BasisError {
    /// The stiffness is not positive definite.
    #[error("the shaft is free to move: it needs two supports of stiffness above 0")]
    Free,
    /// More shapes than degrees of freedom.
    #[error("{asked} modes and attachment shapes of {available} degrees of freedom")]
    TooMany {
        /// Asked for.
        asked: usize,
        /// There are.
        available: usize,
    },
}

impl Basis {
    /// Reduces a plane to its lowest `n_modes` modes and one attachment shape for each of the
    /// `stations`, degrees of freedom at which forces act.
    ///
    /// # Errors
    ///
    /// [`BasisError`] for a free shaft, or more shapes than degrees of freedom.
    pub fn new(plane: &Plane, n_modes: usize, stations: &[usize]) -> Result<Self, BasisError> {
        let (asked, available) = (n_modes + stations.len(), plane.n_dof());
        if asked > available {
            return Err(BasisError::TooMany { asked, available });
        }
        let stiffness = Cholesky::new(plane.stiffness.clone()).ok_or(BasisError::Free)?;
        let (_, modes) = oscillators(&plane.mass, &stiffness);
        let mut shapes = modes.columns(0, n_modes).into_owned();
        for &station in stations {
            let mut unit = DVector::zeros(available);
            unit[station] = 1.0;
            let residual = without(&plane.mass, &shapes, stiffness.solve(&unit));
            // A station whose static answer the basis holds already adds nothing.
            let Some(residual) = residual else { continue };
            let at = shapes.ncols();
            shapes = shapes.insert_column(at, 0.0);
            shapes.set_column(at, &residual);
        }
        let mass = shapes.transpose() * &plane.mass * &shapes;
        let reduced = Cholesky::new(symmetric(shapes.transpose() * &plane.stiffness * &shapes));
        let (omega_rad_per_s, turn) =
            oscillators(&symmetric(mass), &reduced.ok_or(BasisError::Free)?);
        let shapes = shapes * turn;
        let gyroscopic = shapes.transpose() * &plane.gyroscopic * &shapes;
        Ok(Self { omega_rad_per_s, shapes, gyroscopic })
    }

    /// Number of coordinates.
    #[must_use]
    pub fn len(&self) -> usize {
        self.omega_rad_per_s.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.omega_rad_per_s.is_empty()
    }

    /// The row of Φ at a degree of freedom: what a unit of each coordinate moves it, and what a
    /// unit force there pushes each coordinate.
    #[must_use]
    pub fn row(&self, dof: usize) -> Vec<f64> {
        self.shapes.row(dof).iter().copied().collect()
    }

    /// Φᵀ·f: a force on every degree of freedom, as seen by the coordinates.
    #[must_use]
    pub fn project(&self, force: &DVector<f64>) -> Vec<f64> {
        (self.shapes.transpose() * force).iter().copied().collect()
    }
}

/// Solves K·φ = ω²·M·φ through the Cholesky factor of K, so that the lowest modes are the most
/// accurate: ω rising, and shapes with φᵀ·M·φ = 1.
fn oscillators(
    mass: &DMatrix<f64>,
    stiffness: &Cholesky<f64, nalgebra::Dyn>,
) -> (Vec<f64>, DMatrix<f64>) {
    let factor = stiffness.l();
    let half = factor.solve_lower_triangular(mass).unwrap_or_else(|| mass.clone());
    let flexibility =
        factor.solve_lower_triangular(&half.transpose()).unwrap_or_else(|| mass.clone());
    let eigen = SymmetricEigen::new(symmetric(flexibility));
    let mut order: Vec<usize> = (0..mass.nrows()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let mut omega = Vec::with_capacity(order.len());
    let mut shapes = DMatrix::zeros(mass.nrows(), order.len());
    for (column, &k) in order.iter().enumerate() {
        // μ = 1/ω² and φ = L⁻ᵀ·y, which has φᵀ·M·φ = μ for a unit y.
        let inverse_square = eigen.eigenvalues[k].max(f64::MIN_POSITIVE);
        omega.push(1.0 / inverse_square.sqrt());
        let y = eigen.eigenvectors.column(k) / inverse_square.sqrt();
        let shape = factor.tr_solve_lower_triangular(&y).unwrap_or(y);
        // The sign of an eigenvector is free: fix it, so that results do not depend on it.
        let sign = if shape[shape.icamax()] < 0.0 { -1.0 } else { 1.0 };
        shapes.set_column(column, &(shape * sign));
    }
    (omega, shapes)
}

/// What of a shape the others lack, with unit modal mass; `None` if nothing is left.
fn without(
    mass: &DMatrix<f64>,
    others: &DMatrix<f64>,
    shape: DVector<f64>,
) -> Option<DVector<f64>> {
    let norm = |x: &DVector<f64>| x.dot(&(mass * x)).max(0.0).sqrt();
    let whole = norm(&shape);
    let mut rest = shape;
    for _ in 0..2 {
        // Twice: the first pass leaves rounding of the size of what it removed.
        let parts = others.transpose() * (mass * &rest);
        rest -= others * parts;
    }
    let left = norm(&rest);
    (left > 1e-9 * whole).then(|| rest / left)
}

/// Takes out what rounding made asymmetric.
fn symmetric(matrix: DMatrix<f64>) -> DMatrix<f64> {
    (&matrix + matrix.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::super::rotor::tests::rig;
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn the_rig_has_its_natural_frequencies() {
        // Independent reference, given to 5e-6 Hz and 5e-4 Hz.
        let table = [
            (6, [117.001_85, 367.065_09, 699.931, 873.868]),
            (12, [117.000_20, 367.009_14, 699.411, 872.766]),
            (24, [117.000_01, 367.002_63, 699.348, 872.618]),
            (48, [116.999_98, 367.001_55, 699.337, 872.593]),
        ];
        for (n_elements, expected_hz) in table {
            let plane = rig(n_elements).assemble();
            assert_eq!(plane.nodes_m.len(), n_elements as usize + 1);
            let basis = Basis::new(&plane, 4, &[]).unwrap();
            for (omega, expected) in basis.omega_rad_per_s.iter().zip(expected_hz) {
                // 1e-6 is asked for; the table is rounded to 4e-8 and 6e-7 of its values, and its
                // shear coefficient and disc bore were not given to more figures.
                let relative = omega / TAU / expected - 1.0;
                assert!(relative.abs() < 2e-6, "{n_elements}: {} {expected}", omega / TAU);
            }
        }
    }

    #[test]
    fn the_basis_is_orthonormal_and_static_at_its_stations() {
        let plane = rig(24).assemble();
        let station = plane.displacement_at(3.5148 * 0.0254);
        let basis = Basis::new(&plane, 8, &[station]).unwrap();
        let mass = basis.shapes.transpose() * &plane.mass * &basis.shapes;
        let identity = DMatrix::<f64>::identity(9, 9);
        // Rounding grows with the spread of the frequencies, 1e4 here.
        assert!((mass - identity).amax() < 1e-9);
        let mut force = DVector::zeros(plane.n_dof());
        force[station] = 1.0;
        let exact = plane.stiffness.clone().cholesky().unwrap().solve(&force)[station];
        let modal = |basis: &Basis| -> f64 {
            let row = basis.row(station);
            row.iter().zip(&basis.omega_rad_per_s).map(|(phi, w)| phi * phi / (w * w)).sum()
        };
        assert!((modal(&basis) / exact - 1.0).abs() < 1e-9, "{} {exact}", modal(&basis));
        let cut = Basis::new(&plane, 8, &[]).unwrap();
        assert!(modal(&cut) < 0.7 * exact, "without the shape the support is too stiff");
    }

    #[test]
    fn a_free_shaft_is_refused() {
        let mut rotor = rig(6);
        rotor.supports.truncate(1);
        assert_eq!(Basis::new(&rotor.assemble(), 2, &[]), Err(BasisError::Free));
        assert!(matches!(
            Basis::new(&rig(6).assemble(), 20, &[]),
            Err(BasisError::TooMany { asked: 20, available: 14 })
        ));
    }
}
