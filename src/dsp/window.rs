//! Windows and their gains.
//!
//! Periodic (DFT-even) windows; sums in f64, because a gain summed in f32 costs 4e-6 of every
//! amplitude at 100,000 samples. Must not know transforms.

use std::f64::consts::TAU;

use crate::dsp::real::Real;

/// Shape of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Hann, w = ½ − ½cos(2πn/N): the default; resolution 2 bins, side lobes fall with 18 dB/octave.
    Hann,
    /// Flat-top, five terms (ISO 18431-2 coefficients): a peak bin reads within 0.12 %; wide lobe.
    FlatTop,
    /// Blackman-Harris, four terms: side lobes below −92 dB (Harris 1978).
    BlackmanHarris,
    /// Kaiser, w = I₀(β√(1 − (2n/N − 1)²))/I₀(β): β = 0 is rectangular, 8.6 has side lobes of a
    /// Blackman, 14 below −100 dB (D27; Kaiser 1974).
    Kaiser {
        /// Parameter β, finite; its sign does not matter.
        beta: f64,
    },
}

impl Shape {
    /// Signed cosine-series coefficients a_i of `w[n] = Σ a_i cos(2πin/N)` (D4); `None` for a Kaiser
    /// window, which is no such series.
    #[must_use]
    pub fn coefficients(self) -> Option<&'static [f64]> {
        match self {
            Self::Hann => Some(&[0.5, -0.5]),
            Self::FlatTop => {
                Some(&[0.215_578_95, -0.416_631_58, 0.277_263_158, -0.083_578_947, 0.006_947_368])
            }
            Self::BlackmanHarris => Some(&[0.358_75, -0.488_29, 0.141_28, -0.011_68]),
            Self::Kaiser { .. } => None,
        }
    }

    fn weights(self, n: usize) -> Vec<f64> {
        match self {
            _ if n < 3 => vec![1.0; n],
            Self::Kaiser { beta } => kaiser_weights(beta, n),
            Self::Hann | Self::FlatTop | Self::BlackmanHarris => {
                cosine_weights(self.coefficients().unwrap_or(&[1.0]), n)
            }
        }
    }
}

/// A window of fixed length with its gains.
#[derive(Debug, Clone, PartialEq)]
pub struct Window<T> {
    /// Weights w[0…n−1].
    pub weights: Vec<T>,
    /// Σw: divides a sum to give the amplitude of a line (coherent gain times n).
    pub sum: f64,
    /// Σw²: divides a power sum to give a density.
    pub sum_of_squares: f64,
}

impl<T: Real> Window<T> {
    /// Builds the periodic window of `n` samples (D4, D27). A length below 3 gives a window of ones:
    /// a Hann window of one sample would be zero.
    ///
    /// # Panics
    ///
    /// If a Kaiser window's β is not finite.
    #[must_use]
    pub fn new(shape: Shape, n: usize) -> Self {
        let exact = shape.weights(n);
        Self {
            weights: exact.iter().map(|w| T::rounded(*w)).collect(),
            sum: exact.iter().sum(),
            sum_of_squares: exact.iter().map(|w| w * w).sum(),
        }
    }

    /// Coherent gain Σw/n (Hann ½); `None` for length 0.
    #[must_use]
    pub fn coherent_gain(&self) -> Option<f64> {
        (!self.weights.is_empty()).then(|| self.sum / self.weights.len() as f64)
    }

    /// Equivalent noise bandwidth n·Σw²/(Σw)² in bins (Hann 1.5); `None` for length 0.
    #[must_use]
    pub fn enbw_bins(&self) -> Option<f64> {
        let square = self.sum * self.sum;
        (square > 0.0).then(|| self.weights.len() as f64 * self.sum_of_squares / square)
    }

    /// What a line half-way between two bins reads of its amplitude, |Σw·e^(−jπi/n)|/Σw (D27): Hann
    /// 0.849 (−1.42 dB), flat-top 0.999, Blackman-Harris 0.909; `None` for length 0.
    #[must_use]
    pub fn scalloping(&self) -> Option<f64> {
        let step = 0.5 * TAU / self.weights.len() as f64;
        let (mut re, mut im) = (0.0, 0.0);
        for (i, weight) in self.weights.iter().enumerate() {
            let (sin, cos) = (step * i as f64).sin_cos();
            re += weight.to_f64() * cos;
            im -= weight.to_f64() * sin;
        }
        (self.sum > 0.0).then(|| re.hypot(im) / self.sum)
    }
}

/// Kaiser's β for a stop band of `attenuation_db` below the pass band, in filters by windows (D27).
#[must_use]
pub fn kaiser_beta(attenuation_db: f64) -> f64 {
    if attenuation_db > 50.0 {
        0.1102 * (attenuation_db - 8.7)
    } else if attenuation_db > 21.0 {
        0.5842 * (attenuation_db - 21.0).powf(0.4) + 0.07886 * (attenuation_db - 21.0)
    } else {
        0.0
    }
}

/// Kaiser weight at `r` (−1…1, the middle 0) of the window's half length.
pub(in crate::dsp) fn kaiser(beta: f64, r: f64) -> f64 {
    let (beta, inner) = (beta.abs(), beta.abs() * (1.0 - r * r).max(0.0).sqrt());
    // Scaled by e^−x: I₀ itself overflows from β = 714.
    scaled_bessel_i0(inner) / scaled_bessel_i0(beta) * (inner - beta).exp()
}

/// e^−x·I₀(x), x ≥ 0: power series of positive terms, from 40 on the asymptotic one, whose smallest
/// term is e^−80 there.
fn scaled_bessel_i0(x: f64) -> f64 {
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    if x < 40.0 {
        while term > f64::EPSILON * 1e-2 * sum {
            term *= 0.25 * x * x / (k * k);
            sum += term;
            k += 1.0;
        }
        sum * (-x).exp()
    } else {
        while term > f64::EPSILON * 1e-2 {
            let odd = 2.0 * k - 1.0;
            term *= odd * odd / (8.0 * k * x);
            sum += term;
            k += 1.0;
        }
        sum / (TAU * x).sqrt()
    }
}

fn kaiser_weights(beta: f64, n: usize) -> Vec<f64> {
    assert!(beta.is_finite(), "a finite beta");
    (0..n).map(|i| kaiser(beta, 2.0 * i as f64 / n as f64 - 1.0)).collect()
}

/// The angle is exact every so many samples and turned on by one step in between: a plan of 100,000
/// samples would spend more time on cosines than on transforms. 64 roundings are 1e-14 at most.
const EXACT_EVERY: usize = 64;

fn cosine_weights(coefficients: &[f64], n: usize) -> Vec<f64> {
    let (step_sin, step_cos) = (TAU / n as f64).sin_cos();
    let mut weights = Vec::with_capacity(n);
    for start in (0..n).step_by(EXACT_EVERY) {
        let (mut sin, mut cos) = (TAU * start as f64 / n as f64).sin_cos();
        for _ in start..n.min(start + EXACT_EVERY) {
            weights.push(cosine_series(coefficients, cos));
            (sin, cos) = (sin * step_cos + cos * step_sin, cos * step_cos - sin * step_sin);
        }
    }
    weights
}

/// Σ aᵢ·cos(iθ) from cos θ, by cos((i+1)θ) = 2·cos θ·cos(iθ) − cos((i−1)θ).
fn cosine_series(coefficients: &[f64], cos: f64) -> f64 {
    let (mut term, mut next) = (1.0, cos);
    let mut sum = 0.0;
    for a in coefficients {
        sum += a * term;
        (term, next) = (next, 2.0 * cos * next - term);
    }
    sum
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn weights_are_those_of_the_series() {
        let shapes = [
            (Shape::Hann, 3),
            (Shape::Hann, 10_007),
            (Shape::FlatTop, 4096),
            (Shape::BlackmanHarris, 4099),
        ];
        for (shape, n) in shapes {
            let window = Window::<f64>::new(shape, n);
            for (i, weight) in window.weights.iter().enumerate() {
                let angle = TAU * i as f64 / n as f64;
                let terms = shape.coefficients().unwrap().iter().enumerate();
                let exact: f64 = terms.map(|(order, a)| a * (angle * order as f64).cos()).sum();
                // 64 roundings, sixteenfold in the fourth order.
                assert!((weight - exact).abs() < 1e-13, "{shape:?} {n} {i}: {weight} {exact}");
            }
        }
    }

    /// I₀(x) = (1/π)∫₀^π e^(x·cos t)dt, scaled: the trapezoidal rule converges geometrically.
    fn bessel_by_integral(x: f64) -> f64 {
        let n = 2000;
        let at = |i: i32| (x * ((PI * f64::from(i) / f64::from(n)).cos() - 1.0)).exp();
        ((1..n).map(at).sum::<f64>() + 0.5 * (at(0) + at(n))) / f64::from(n)
    }

    #[test]
    fn bessel_series_are_the_integral() {
        // Across the change of series at 40, and where I₀ itself overflows.
        for x in [0.0, 1e-3, 1.0, 8.0, 39.9, 40.1, 100.0, 713.0, 2000.0] {
            let (series, integral) = (scaled_bessel_i0(x), bessel_by_integral(x));
            // Rounding of 2000 terms and of e^−x (x·2⁻⁵³ relative).
            assert!((series / integral - 1.0).abs() < 1e-12, "{x}: {series} {integral}");
        }
    }

    #[test]
    fn gains_have_their_closed_forms() {
        let hann = Window::<f32>::new(Shape::Hann, 100_000);
        // Exact for the periodic window; 1e-12 is the rounding of 1e5 additions.
        assert!((hann.coherent_gain().unwrap() - 0.5).abs() < 1e-12);
        assert!((hann.enbw_bins().unwrap() - 1.5).abs() < 1e-12);
        // Between two bins 8/(3π), the limit for large n.
        let half_way = Window::<f64>::new(Shape::Hann, 100_000).scalloping().unwrap();
        assert!((half_way - 8.0 / (3.0 * PI)).abs() < 1e-9);
        for shape in [Shape::Hann, Shape::FlatTop, Shape::BlackmanHarris] {
            let a = shape.coefficients().unwrap();
            let window = Window::<f64>::new(shape, 64);
            // Coherent gain a₀; ENBW of a cosine series 1 + ½Σ(a_i/a₀)².
            let enbw = 1.0 + 0.5 * a[1..].iter().map(|a_i| (a_i / a[0]).powi(2)).sum::<f64>();
            assert!((window.coherent_gain().unwrap() - a[0]).abs() < 1e-14, "{shape:?}");
            assert!((window.enbw_bins().unwrap() - enbw).abs() < 1e-13, "{shape:?}");
        }
    }

    #[test]
    fn kaiser_gains_have_their_closed_forms() {
        for beta in [0.5, 5.0, 8.6, 3.0 * PI, 14.0, 100.0, 1000.0] {
            let window = Window::<f64>::new(Shape::Kaiser { beta }, 20_000);
            // The integral of the window is sinh β/(β·I₀(β)); the sum differs by half the step at the
            // ends, 1/(n·I₀(β)) to first order, whole for the periodic form.
            let sinh_over_i0 = 0.5 * (1.0 - (-2.0 * beta).exp()) / scaled_bessel_i0(beta);
            let error = window.coherent_gain().unwrap() - sinh_over_i0 / beta;
            assert!(error.abs() < 1e-8, "{beta}: {error}");
            // Its transform half a bin away: sinh√(β² − (π/2)²)/√(β² − (π/2)²) over sinh β/β; below
            // β = π/2 the sine of the imaginary root.
            let square = beta * beta - 0.25 * PI * PI;
            let root = square.abs().sqrt();
            let lobe = if square < 0.0 {
                root.sin() / root / (beta.sinh() / beta)
            } else {
                let ratio = (1.0 - (-2.0 * root).exp()) / (1.0 - (-2.0 * beta).exp());
                (root - beta).exp() * ratio * beta / root
            };
            let error = window.scalloping().unwrap() - lobe;
            assert!(error.abs() < 1e-8, "{beta}: {error}");
        }
    }

    #[test]
    fn gains_are_those_of_the_tables() {
        // Harris 1978, table 1: coherent gain, ENBW in bins, scalloping in dB, to the digits there.
        let kaiser = |alpha: f64| Shape::Kaiser { beta: alpha * PI };
        let table = [
            (Shape::Hann, 0.50, 1.50, 1.42),
            (Shape::BlackmanHarris, 0.36, 2.00, 0.83),
            (kaiser(2.0), 0.49, 1.50, 1.46),
            (kaiser(2.5), 0.44, 1.65, 1.20),
            (kaiser(3.0), 0.40, 1.80, 1.02),
            (kaiser(3.5), 0.37, 1.93, 0.89),
            (kaiser(0.0), 1.00, 1.00, 3.92),
        ];
        for (shape, gain, enbw, scalloping_db) in table {
            let window = Window::<f64>::new(shape, 4096);
            assert!((window.coherent_gain().unwrap() - gain).abs() < 0.0051, "{shape:?}");
            assert!((window.enbw_bins().unwrap() - enbw).abs() < 0.0051, "{shape:?}");
            let db = -20.0 * window.scalloping().unwrap().log10();
            // The table's windows have some 50 samples and both ends: up to one digit.
            assert!((db - scalloping_db).abs() < 0.01, "{shape:?}: {db}");
        }
        let flat = Window::<f64>::new(Shape::FlatTop, 4096);
        // 3.7702 bins, −0.0098 dB.
        assert!((flat.enbw_bins().unwrap() - 3.7702).abs() < 1e-4);
        assert!((-20.0 * flat.scalloping().unwrap().log10() - 0.0098).abs() < 1e-4);
    }

    #[test]
    fn betas_of_stop_bands() {
        // Kaiser 1974: 60 dB 5.65, 80 dB 7.86; continuous to 0.1 where the formulas meet.
        assert!(
            (kaiser_beta(60.0) - 5.653).abs() < 1e-3 && (kaiser_beta(80.0) - 7.857).abs() < 1e-3
        );
        assert!((kaiser_beta(50.01) - kaiser_beta(49.99)).abs() < 0.1);
        assert!(kaiser_beta(20.0).abs() <= 0.0);
    }

    #[test]
    fn short_windows_do_not_vanish() {
        let shapes =
            [Shape::Hann, Shape::FlatTop, Shape::BlackmanHarris, Shape::Kaiser { beta: 8.0 }];
        for shape in shapes {
            let empty = Window::<f64>::new(shape, 0);
            assert_eq!(
                (empty.coherent_gain(), empty.enbw_bins(), empty.scalloping()),
                (None, None, None)
            );
            assert_eq!(Window::<f64>::new(shape, 1).weights, vec![1.0]);
            assert_eq!(Window::<f64>::new(shape, 2).sum.to_bits(), 2f64.to_bits());
        }
    }
}
