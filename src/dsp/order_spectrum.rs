//! Order spectrum: amplitudes over orders of the shaft.
//!
//! Reads what [`crate::dsp::order_track`] made; the height of a bin between two orders is low by the
//! window's scalloping, so an amplitude at a known order comes from [`crate::dsp::line::line_at`] with the
//! points of a revolution as sampling rate. Must not know which orders matter.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::Real;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Single-sided zero-to-peak amplitude spectrum over orders (D70).
#[derive(Debug)]
pub struct OrderSpectrumPlan<T: Real> {
    points_per_rev: usize,
    window: Window<T>,
    forward: ForwardPlan<T>,
    y_hat: Vec<Complex<T>>,
}

impl<T: Real> OrderSpectrumPlan<T> {
    /// Plans for `revolutions` whole revolutions of `points_per_rev` points: then whole orders fall on
    /// bins.
    ///
    /// # Panics
    ///
    /// If either is 0.
    #[must_use]
    pub fn new(
        points_per_rev: usize,
        revolutions: usize,
        shape: Shape,
        cache: &mut FftCache<T>,
    ) -> Self {
        let n = points_per_rev * revolutions;
        assert!(n > 0, "points of revolutions");
        Self {
            points_per_rev,
            window: Window::new(shape, n),
            forward: ForwardPlan::new(n, cache),
            y_hat: vec![Complex::zero(); fft::n_bins(n)],
        }
    }

    /// Points per call.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.window.weights.len()
    }

    /// Amplitudes written per call; bin k is at order k/revolutions.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.y_hat.len()
    }

    /// Distance of two bins, orders: one over the revolutions.
    #[must_use]
    pub fn bin_width_orders(&self) -> f64 {
        self.points_per_rev as f64 / self.n_points() as f64
    }

    /// Writes the amplitudes of `y` (points at equal angles, unit u, mean removed here) into `out`, u.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, y: &[T], out: &mut [T]) {
        assert_eq!(out.len(), self.n_bins(), "bins of the plan");
        let n = self.n_points();
        self.forward.process_weighted(y, &self.window.weights, &mut self.y_hat);
        let line = T::rounded(2.0 / self.window.sum);
        for (amplitude, value) in out.iter_mut().zip(&self.y_hat) {
            *amplitude = value.norm_sqr().square_root() * line;
        }
        let half = T::rounded(0.5);
        out[0] *= half;
        if n.is_multiple_of(2) {
            out[n / 2] *= half;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::order::PhaseTrack;
    use crate::dsp::order_track::OrderTrackPlan;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    fn spectrum<T: Real>(y: &[f64], points: usize, shape: Shape) -> Vec<T> {
        let mut plan =
            OrderSpectrumPlan::new(points, y.len() / points, shape, &mut FftCache::new());
        let mut out = vec![T::zero(); plan.n_bins()];
        plan.process(&narrow::<T>(y), &mut out);
        out
    }

    #[test]
    fn orders_read_their_amplitudes() {
        let (points, revolutions) = (64, 50);
        let n = points * revolutions;
        let y: Vec<f64> = sine(n, points as f64, 3.0, 2.0, 0.4)
            .iter()
            .zip(sine(n, points as f64, 10.51, 1.0, 0.0))
            .map(|(a, b)| a + b + 1e6)
            .collect();
        let hann = spectrum::<f64>(&y, points, Shape::Hann);
        // Rounding of an offset of 1e6; the other line leaks less than 1e-7 over 375 bins.
        assert!((hann[150] - 2.0).abs() < 1e-6);
        // Order 10.51 is half a bin off: Hann reads 8/(3π), flat-top within 0.12 %.
        assert!((hann[525].max(hann[526]) - 8.0 / (1.5 * TAU)).abs() < 1e-3);
        let flat = spectrum::<f64>(&y, points, Shape::FlatTop);
        assert!((flat[525].max(flat[526]) - 1.0).abs() < 1.2e-3);
        assert!((flat[150] - 2.0).abs() < 1e-5);
    }

    #[test]
    fn a_run_up_with_known_orders_reads_them() {
        let fs_hz = 10_000.0;
        let turned = |t: f64| 12.0 * t + 1.1 * t * t;
        let times_s: Vec<f64> = (0..=100).map(|i| 0.1 * f64::from(i)).collect();
        let revolutions: Vec<f64> = times_s.iter().map(|t| turned(*t)).collect();
        let track = PhaseTrack::from_knots(&times_s, &revolutions).unwrap();
        let orders = [(1_u16, 5.0), (2, 1.0), (28, 0.5), (29, 0.05)];
        let x: Vec<f32> = (0..100_001)
            .map(|i| TAU * turned(i as f64 / fs_hz))
            .map(|a| {
                orders.iter().map(|(k, amplitude)| amplitude * (f64::from(*k) * a).cos()).sum()
            })
            .map(|value: f64| f32::rounded(value + 3.0))
            .collect();
        let (points, turns) = (128, 200);
        let mut resample = OrderTrackPlan::new(points, fs_hz, 12.0).unwrap();
        let mut y = vec![0.0_f32; points * turns];
        let found = resample.process(&x, fs_hz, &track, &mut y).unwrap();
        assert_eq!(found.n_points, y.len());
        let mut plan =
            OrderSpectrumPlan::<f32>::new(points, turns, Shape::Hann, &mut FftCache::new());
        assert!((plan.bin_width_orders() - 0.005).abs() < 1e-15);
        let mut out = vec![0.0; plan.n_bins()];
        plan.process(&y, &mut out);
        for (order, exact) in orders {
            let read = f64::from(out[usize::from(order) * turns]);
            // Asked 1e-3; the kernels leave 1e-4 of the line, and of order 1 1e-5 elsewhere.
            assert!((read - exact).abs() < 2e-4 * exact + 1e-5, "order {order}: {read}");
        }
        // Between the orders there is nothing: a spectrum over time would be smeared all over.
        let floor = (10 * turns..20 * turns).map(|k| out[k]).fold(0.0, f32::max);
        assert!(floor < 5e-5, "{floor}");
    }

    #[test]
    fn constants_and_prime_lengths() {
        assert!(spectrum::<f32>(&[4.0; 97], 97, Shape::Hann).iter().all(|a| a.abs() <= 0.0));
        let y = sine(97 * 3, 97.0, 5.0, 1.0, 0.2);
        assert!((spectrum::<f64>(&y, 97, Shape::Hann)[15] - 1.0).abs() < 1e-13);
    }
}
