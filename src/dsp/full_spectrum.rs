//! Full spectrum of a pair of sensors: what turns one way and what turns the other.
//!
//! x and y are 90° apart, y counter-clockwise from x. A motion that turns counter-clockwise is at +f,
//! one that turns clockwise at −f; a vibration along a line is half in either. Must not know which way
//! the shaft turns, so neither what is forward.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::line::Line;
use crate::dsp::real::Real;
use crate::dsp::stats;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Amplitudes of the two senses of rotation, by frequency (D32).
pub struct FullSpectrumPlan<T: Real> {
    window: Window<T>,
    plan: Arc<dyn Fft<T>>,
    z: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> FullSpectrumPlan<T> {
    /// Plans for `n` samples of either sensor under a window.
    ///
    /// # Panics
    ///
    /// If `n` is 0 or a Kaiser window's β is not finite.
    #[must_use]
    pub fn new(n: usize, shape: Shape, cache: &mut FftCache<T>) -> Self {
        assert!(n > 0, "a transform needs at least one sample");
        let plan = cache.complex_forward(n);
        let scratch = vec![Complex::zero(); plan.get_inplace_scratch_len()];
        Self { window: Window::new(shape, n), plan, z: vec![Complex::zero(); n], scratch }
    }

    /// Amplitudes of one sense per call: ⌊n/2⌋ + 1, at k·fs/n.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        fft::n_bins(self.z.len())
    }

    /// Writes the amplitudes of `x` + j·`y`, each one's mean removed.
    ///
    /// `x`, `y`: n samples, one unit. `counter_clockwise[k]`, `clockwise[k]`: radius of the circle in
    /// which the motion at k·fs/n turns, in that unit; an ellipse has the half axes sum and difference
    /// of the two. At Nyquist the senses cannot be told apart: half in each. Between two bins a line
    /// reads low as in any spectrum.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], y: &[T], counter_clockwise: &mut [T], clockwise: &mut [T]) {
        let n = self.z.len();
        assert!(x.len() == n && y.len() == n, "samples of the plan");
        let n_bins = self.n_bins();
        assert!(counter_clockwise.len() == n_bins && clockwise.len() == n_bins, "bins of the plan");
        let (mean_x, mean_y) = (stats::mean(x).unwrap_or(0.0), stats::mean(y).unwrap_or(0.0));
        for (((z, x), y), w) in self.z.iter_mut().zip(x).zip(y).zip(&self.window.weights) {
            let re = T::rounded(x.to_f64() - mean_x);
            *z = Complex::new(re, T::rounded(y.to_f64() - mean_y)).scale(*w);
        }
        self.plan.process_with_scratch(&mut self.z, &mut self.scratch);
        let scale = 1.0 / self.window.sum;
        let negative = self.z[..1].iter().chain(self.z[1..].iter().rev());
        let senses = counter_clockwise.iter_mut().zip(clockwise);
        for (k, ((up, down), (plus, minus))) in senses.zip(self.z.iter().zip(negative)).enumerate()
        {
            let scale = T::rounded(if k == 0 || 2 * k == n { 0.5 * scale } else { scale });
            *up = plus.norm_sqr().square_root() * scale;
            *down = minus.norm_sqr().square_root() * scale;
        }
    }
}

impl<T: Real> fmt::Debug for FullSpectrumPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FullSpectrumPlan").field("n", &self.z.len()).finish_non_exhaustive()
    }
}

/// The ellipse that a point runs through at one frequency (D33).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Radius of the part that turns counter-clockwise (from x to y), unit of the samples.
    pub counter_clockwise: f64,
    /// Radius of the part that turns clockwise.
    pub clockwise: f64,
    /// Direction of the long axis, rad from x towards y, 0…π; `None` for a circle.
    pub inclination_rad: Option<f64>,
}

impl Orbit {
    /// Joins the lines of two sensors at one frequency; y lies a quarter turn counter-clockwise of x.
    #[must_use]
    pub fn of_lines(x: Line, y: Line) -> Self {
        let phasor = |line: Line| Complex::from_polar(line.amplitude, -line.phase_lag_rad);
        let (x, y) = (phasor(x), phasor(y) * Complex::i());
        let (plus, minus) = ((x + y) * 0.5, (x - y).conj() * 0.5);
        // Where one of the two is rounding of the other, the axes are equal and have no direction.
        let least = 8.0 * f64::EPSILON * plus.norm().max(minus.norm());
        let is_ellipse = plus.norm() > least && minus.norm() > least;
        let direction = (0.5 * (plus.arg() + minus.arg())).rem_euclid(PI);
        Self {
            counter_clockwise: plus.norm(),
            clockwise: minus.norm(),
            inclination_rad: is_ellipse.then_some(direction),
        }
    }

    /// Half length of the long axis.
    #[must_use]
    pub fn major(&self) -> f64 {
        self.counter_clockwise + self.clockwise
    }

    /// Half length of the short axis; negative if the point runs clockwise, 0 on a straight line.
    #[must_use]
    pub fn minor(&self) -> f64 {
        self.counter_clockwise - self.clockwise
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::line::line_at;
    use crate::dsp::reference::dft;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;

    const FS_HZ: f64 = 1000.0;

    /// An ellipse with half axes a, b (b < 0: clockwise), its long axis at `tilt` from x.
    fn ellipse(n: usize, f_hz: f64, a: f64, b: f64, tilt: f64) -> (Vec<f64>, Vec<f64>) {
        let at = |i: usize| {
            let (sin, cos) = (TAU * f_hz * i as f64 / FS_HZ + 0.4).sin_cos();
            Complex::new(a * cos, b * sin) * Complex::from_polar(1.0, tilt)
        };
        ((0..n).map(|i| at(i).re).collect(), (0..n).map(|i| at(i).im).collect())
    }

    fn full<T: Real>(x: &[f64], y: &[f64], shape: Shape) -> (Vec<T>, Vec<T>) {
        let mut plan = FullSpectrumPlan::<T>::new(x.len(), shape, &mut FftCache::new());
        let (mut up, mut down) = (vec![T::zero(); plan.n_bins()], vec![T::zero(); plan.n_bins()]);
        plan.process(&narrow(x), &narrow(y), &mut up, &mut down);
        (up, down)
    }

    #[test]
    fn an_ellipse_has_its_closed_form() {
        for (a, b) in [(3.0, 1.0), (3.0, -1.0), (2.0, 2.0), (2.0, -2.0), (1.0, 0.0)] {
            for shape in [Shape::Hann, Shape::FlatTop] {
                let (x, y) = ellipse(1000, 50.0, a, b, 0.7);
                let (up, down) = full::<f64>(&x, &y, shape);
                // On a bin: (a + b)/2 counter-clockwise, (a − b)/2 clockwise, to rounding.
                assert!((up[50] - 0.5 * (a + b)).abs() < 1e-13, "{a} {b}");
                assert!((down[50] - 0.5 * (a - b)).abs() < 1e-13, "{a} {b}");
                assert!(up[300] < 1e-13 && down[300] < 1e-13);
                let (single, _) = full::<f32>(&x, &y, shape);
                assert!(largest_difference(&single, &up) < 1e-6);
            }
        }
    }

    #[test]
    fn matches_the_definition() {
        for n in [1, 2, 3, 50, 97] {
            let (x, y) = (gaussian_noise(n, 1), gaussian_noise(n, 2));
            let (mean_x, mean_y) =
                (x.iter().sum::<f64>() / n as f64, y.iter().sum::<f64>() / n as f64);
            let z: Vec<_> =
                x.iter().zip(&y).map(|(x, y)| Complex::new(x - mean_x, y - mean_y)).collect();
            let exact = dft(&z);
            let half = |k: usize| if k == 0 || 2 * k == n { 0.5 } else { 1.0 };
            let at = |k: usize, bin: usize| half(k) * exact[bin].norm() / n as f64;
            let plus: Vec<f64> = (0..=n / 2).map(|k| at(k, k)).collect();
            let minus: Vec<f64> = (0..=n / 2).map(|k| at(k, (n - k) % n)).collect();
            let rectangular = Shape::Kaiser { beta: 0.0 };
            let (up, down) = full::<f64>(&x, &y, rectangular);
            assert!(
                largest_difference(&up, &plus) < 1e-14 && largest_difference(&down, &minus) < 1e-14
            );
            let (up, down) = full::<f32>(&x, &y, rectangular);
            assert!(
                largest_difference(&up, &plus) < 1e-6 && largest_difference(&down, &minus) < 1e-6
            );
        }
    }

    #[test]
    fn hard_cases() {
        // Gap voltage of 1e6 times the orbit.
        let (x, y) = ellipse(1000, 50.0, 3.0, 1.0, 0.2);
        let raised: Vec<f64> = x.iter().map(|v| v + 3e6).collect();
        let (up, down) = full::<f64>(&raised, &y, Shape::Hann);
        assert!((up[50] - 2.0).abs() < 1e-9 && (down[50] - 1.0).abs() < 1e-9 && up[0] < 1e-9);
        for silent in [vec![0.0; 37], vec![-7.5; 37]] {
            let (up, down) = full::<f32>(&silent, &silent, Shape::Hann);
            assert!(up.iter().chain(&down).all(|a| a.abs() <= 0.0));
        }
        // Nyquist: x alternates by ±1: a motion of 1, half in each sense.
        let x: Vec<f64> = (0..16).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let (up, down) = full::<f64>(&x, &[0.0; 16], Shape::Hann);
        assert!((up[8] - 0.5).abs() < 1e-15 && (down[8] - 0.5).abs() < 1e-15);
        let mut impulse = vec![0.0; 64];
        impulse[32] = 1e-40;
        let (up, down) = full::<f32>(&impulse, &impulse, Shape::Hann);
        assert!(up.iter().chain(&down).all(|a| a.is_finite()));
    }

    #[test]
    fn orbits_of_lines_at_any_frequency() {
        for (a, b, tilt) in [(3.0, 1.0, 0.7), (3.0, -1.0, 2.5), (1.0, 0.0, 0.1), (5.0, -4.0, 1.6)] {
            let (x, y) = ellipse(2000, 47.31, a, b, tilt);
            let read = |x: &[f64]| line_at(x, FS_HZ, 47.31).unwrap();
            let orbit = Orbit::of_lines(read(&x), read(&y));
            // The lines are exact to 1e-9 of their size.
            assert!((orbit.major() - a).abs() < 1e-8 && (orbit.minor() - b).abs() < 1e-8);
            assert!((orbit.inclination_rad.unwrap() - tilt).abs() < 1e-8, "{orbit:?}");
        }
        let line = |amplitude, phase_lag_rad| Line { amplitude, phase_lag_rad };
        let circle = Orbit::of_lines(line(2.0, 0.3), line(2.0, 0.3 + 0.5 * PI));
        assert_eq!(circle.inclination_rad, None);
        assert!((circle.minor() - 2.0).abs() < 1e-15, "x leads y: counter-clockwise");
        let nothing = Orbit::of_lines(line(0.0, 0.0), line(0.0, 0.0));
        assert!(nothing.inclination_rad.is_none() && nothing.major().abs() <= 0.0);
    }
}
