//! A constant linear system ẏ = A·y in coordinates that do not know of each other (equation R32).
//!
//! A·V = V·diag(λ): in s = V⁻¹·y each coordinate turns and decays by itself. Of a conjugate pair one
//! is kept. Must not know what the system is of.

use nalgebra::{Complex, DMatrix, DVector, Schur};

/// Eigenvalues and both families of eigenvectors of a real matrix.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    /// λ, rad/s: one of each conjugate pair, and the real ones.
    pub(super) values: Vec<Complex<f64>>,
    /// Vectors of `values`, one a column; doubled where a conjugate was left out, so that
    /// y = Re(right·s).
    right: DMatrix<Complex<f64>>,
    /// Rows of V⁻¹.
    left: DMatrix<Complex<f64>>,
}

/// Iterations the Schur form may take for each row.
const ITERATIONS: usize = 300;

/// Largest residual |A·v − λ·v| of a unit vector that is taken for rounding, of the largest λ.
const RESIDUAL: f64 = 1e-11;

/// Largest entry of V⁻¹ for unit vectors: beyond, the matrix hardly has all its vectors and digits
/// are lost.
const LARGEST_INVERSE: f64 = 1e4;

impl Spectrum {
    /// Takes a matrix apart; `None` if it has not all its vectors, or nearly so.
    pub(super) fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        let n = matrix.nrows();
        let complex = matrix.map(|x| Complex::new(x, 0.0));
        let (basis, triangle) =
            Schur::try_new(complex.clone(), f64::EPSILON, ITERATIONS * n)?.unpack();
        let vectors = basis * triangular_vectors(&triangle);
        let inverse = vectors.clone().try_inverse()?;
        let largest = triangle.diagonal().iter().map(|x| x.norm()).fold(0.0, f64::max);
        let image = &complex * &vectors;
        let mut kept: Vec<(usize, Complex<f64>, f64)> = Vec::new();
        for i in 0..n {
            // The two-sided Rayleigh quotient: exact to second order in the errors of both vectors.
            let value = inverse.row(i).transpose().dot(&image.column(i));
            let residual = (image.column(i) - vectors.column(i) * value).norm();
            let inverse_size = inverse.row(i).iter().map(|x| x.norm()).fold(0.0, f64::max);
            if !(residual <= RESIDUAL * largest && inverse_size <= LARGEST_INVERSE) {
                return None;
            }
            if value.im > REAL * largest {
                // It stands for its conjugate too.
                kept.push((i, value, 2.0));
            } else if value.im >= -REAL * largest {
                // An overdamped motion, by itself.
                kept.push((i, Complex::new(value.re, 0.0), 1.0));
            }
        }
        let n_found: f64 = kept.iter().map(|(_, _, times)| times).sum();
        (n_found.total_cmp(&(n as f64)).is_eq()).then(|| Self {
            values: kept.iter().map(|(_, value, _)| *value).collect(),
            right: DMatrix::from_fn(n, kept.len(), |i, k| vectors[(i, kept[k].0)] * kept[k].2),
            left: DMatrix::from_fn(kept.len(), n, |k, j| inverse[(kept[k].0, j)]),
        })
    }

    /// What a real input along `direction` of ẏ does to each coordinate.
    pub(super) fn input(&self, direction: &DVector<f64>) -> Vec<Complex<f64>> {
        (&self.left * direction.map(|x| Complex::new(x, 0.0))).iter().copied().collect()
    }

    /// Weights c with row·y = Re Σ c·s.
    pub(super) fn output(&self, row: &DVector<f64>) -> Vec<Complex<f64>> {
        self.right.tr_mul(&row.map(|x| Complex::new(x, 0.0))).iter().copied().collect()
    }

    /// The state y of coordinates s.
    pub(super) fn state(&self, coordinates: &[Complex<f64>]) -> DVector<f64> {
        (&self.right * DVector::from_row_slice(coordinates)).map(|x| x.re)
    }
}

/// Imaginary parts below this part of the largest eigenvalue are none.
const REAL: f64 = 1e-13;

/// Unit eigenvectors of an upper triangular matrix by back substitution.
fn triangular_vectors(triangle: &DMatrix<Complex<f64>>) -> DMatrix<Complex<f64>> {
    let n = triangle.nrows();
    let largest = triangle.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let smallest = f64::EPSILON * largest;
    let mut vectors = DMatrix::from_element(n, n, Complex::new(0.0, 0.0));
    for k in 0..n {
        vectors[(k, k)] = Complex::new(1.0, 0.0);
        for i in (0..k).rev() {
            let sum: Complex<f64> = (i + 1..=k).map(|j| triangle[(i, j)] * vectors[(j, k)]).sum();
            let gap = triangle[(k, k)] - triangle[(i, i)];
            // Equal eigenvalues: any combination of their vectors will do.
            let gap = if gap.norm() < smallest { Complex::new(smallest, 0.0) } else { gap };
            vectors[(i, k)] = sum / gap;
        }
        let norm = vectors.column(k).norm();
        vectors.column_mut(k).iter_mut().for_each(|x| *x /= norm);
    }
    vectors
}
