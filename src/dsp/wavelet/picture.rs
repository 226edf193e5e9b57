//! Continuous wavelet transform with wavelets that are real in time.
//!
//! W(a, b) = (1/a)∫x(t)·ψ((t − b)/a)dt (L1), ψ scaled so that a unit sine reads |W| = 1 at f, the frequency
//! of the largest |ψ̂| (D100). Computed with ω > 0 alone: Re W is the coefficient, |W| its envelope. Must
//! not know shafts or meshes.

use std::f64::consts::TAU;
use std::ops::Range;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::cwt::Part;
use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::inverse::Inverse;
use crate::dsp::inverse::Workspace;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::wavelet::shape::Shape;

/// Picture: rows of frequencies, columns of equal times (D100).
#[derive(Debug)]
pub struct WaveletScalogramPlan<T: Real> {
    shape: Shape,
    n: usize,
    fs_hz: f64,
    f_hz: Vec<f64>,
    n_columns: usize,
    inverse: Inverse<T>,
    workspace: Workspace<T>,
    /// Room for a value a coefficient.
    w: Vec<T>,
}

impl<T: Real> WaveletScalogramPlan<T> {
    /// Plans one row per frequency of `f_hz`, each of `n_columns` columns over `n` samples.
    ///
    /// `None` unless all are positive and every frequency is below fs/2.
    #[must_use]
    pub fn new(
        shape: Shape,
        (n, fs_hz): (usize, f64),
        f_hz: &[f64],
        n_columns: usize,
        cache: &mut FftCache<T>,
    ) -> Option<Self> {
        if n < 2 || n_columns == 0 || !f_hz.iter().all(|f| *f > 0.0 && *f < 0.5 * fs_hz) {
            return None;
        }
        // As many coefficients as samples, rounded up to whole columns.
        let length = n_columns * n.div_ceil(n_columns);
        let inverse = Inverse::new(length, cache);
        let workspace = Workspace::new(std::iter::once(&inverse));
        let w = vec![T::zero(); length];
        Some(Self { shape, n, fs_hz, f_hz: f_hz.to_vec(), n_columns, inverse, workspace, w })
    }

    /// Values per call: rows × columns.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.f_hz.len() * self.n_columns
    }

    /// Columns of row `row` in which the wavelet lies wholly inside the record.
    #[must_use]
    pub fn valid_columns(&self, row: usize) -> Option<Range<usize>> {
        let scale_s = self.shape.peak_rad() / (TAU * self.f_hz.get(row)?);
        let column_s = self.n as f64 / (self.fs_hz * self.n_columns as f64);
        let margin = ceil_index(self.shape.reach() * scale_s / column_s);
        let end = self.n_columns.saturating_sub(margin);
        Some(if margin < end { margin..end } else { 0..0 })
    }

    /// Writes the picture row by row; a column holds the largest value of its share of the record, which is
    /// taken as periodic.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), unit u. `out`: u.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], part: Part, out: &mut [T]) {
        assert_eq!(x_hat.len(), fft::n_bins(self.n), "bins of the plan");
        assert_eq!(out.len(), self.out_len(), "rows times columns");
        let per_column = self.w.len() / self.n_columns;
        for (f_hz, out) in self.f_hz.iter().zip(out.chunks_mut(self.n_columns)) {
            self.workspace.grid.re.fill(T::zero());
            self.workspace.grid.im.fill(T::zero());
            let omega_of_bin = self.shape.peak_rad() * self.fs_hz / (self.n as f64 * f_hz);
            for (k, x) in x_hat.iter().enumerate().skip(1) {
                // The analytic factor, and 1 at an even n's Nyquist.
                let factor = if 2 * k == self.n { 1.0 } else { 2.0 } / self.n as f64;
                let gain = self.shape.at(omega_of_bin * k as f64).conj() * factor;
                let gain = Complex::new(T::rounded(gain.re), T::rounded(gain.im));
                let value: Complex<T> = if x.is_zero() { *x } else { *x * gain };
                (self.workspace.grid.re[k], self.workspace.grid.im[k]) = (value.re, value.im);
            }
            part.of_results(&self.inverse.run(&mut self.workspace), &mut self.w);
            for (value, share) in out.iter_mut().zip(self.w.chunks(per_column)) {
                let larger = |a: T, b: T| if b > a { b } else { a };
                *value = share.iter().copied().fold(T::zero(), larger);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::wavelet::shape::Wavelet;

    const FS_HZ: f64 = 1000.0;
    const ALL: [Wavelet; 6] = [
        Wavelet::MexicanHat,
        Wavelet::Haar,
        Wavelet::Daubechies(2),
        Wavelet::Daubechies(8),
        Wavelet::Biorthogonal(2, 4),
        Wavelet::NineSeven,
    ];

    fn picture<T: Real>(
        wavelet: Wavelet,
        x: &[f64],
        f_hz: &[f64],
        n_columns: usize,
        part: Part,
    ) -> (Vec<f64>, WaveletScalogramPlan<T>) {
        let mut cache = FftCache::new();
        let mut forward = ForwardPlan::new(x.len(), &mut cache);
        let mut x_hat = vec![Complex::zero(); forward.n_bins()];
        forward.process(&narrow::<T>(x), &mut x_hat);
        let shape = Shape::new(wavelet).unwrap();
        let record = (x.len(), FS_HZ);
        let mut plan =
            WaveletScalogramPlan::new(shape, record, f_hz, n_columns, &mut cache).unwrap();
        let mut out = vec![T::zero(); plan.out_len()];
        plan.process(&x_hat, part, &mut out);
        (out.iter().map(|v| v.to_f64()).collect(), plan)
    }

    #[test]
    fn a_unit_sine_reads_one_at_its_frequency_with_every_wavelet() {
        let x = sine(4000, FS_HZ, 50.0, 1.0, 0.4);
        for wavelet in ALL {
            let (w, plan) = picture::<f64>(wavelet, &x, &[50.0, 20.0], 4000, Part::Modulus);
            let valid = plan.valid_columns(0).unwrap();
            assert!(valid.len() > 3000);
            for value in &w[valid] {
                assert!((value - 1.0).abs() < 1e-5, "{wavelet:?}: {value}");
            }
            assert!(w[6000] < 0.999, "{wavelet:?}: less beside it");
        }
    }

    /// (1/a)∫x(t)ψ((t − b)/a)dt with the wavelet in time, for samples of a smooth signal.
    #[test]
    fn the_real_part_is_the_transform_in_time() {
        let n = 2000;
        // Smooth and short of the ends, so that the integral is a sum.
        let pulse = |t: f64| (-(t - 1.0) * (t - 1.0) / 0.005).exp() * (TAU * 40.0 * t).cos();
        let x: Vec<f64> = (0..n).map(|i| pulse(i as f64 / FS_HZ)).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        let hat = |t: f64| (1.0 - t * t) * (-0.5 * t * t).exp();
        let haar = |t: f64| if t.abs() >= 0.5 { 0.0 } else { -t.signum() };
        let f_hz = 40.0;
        let shapes: [&dyn Fn(f64) -> f64; 2] = [&hat, &haar];
        let kinds = [(Wavelet::MexicanHat, 1e-9), (Wavelet::Haar, 1e-3)];
        for ((wavelet, tolerance), psi) in kinds.into_iter().zip(shapes) {
            let (w, plan) = picture::<f64>(wavelet, &x, &[f_hz], n, Part::Real);
            let a = plan.shape.peak_rad() / (TAU * f_hz);
            // Largest |∫ψe^(−jωt)dt| of the wavelet as written.
            let fine = 20_000;
            let reach = 8.0;
            let largest = {
                let (mut re, mut im) = (0.0, 0.0);
                for i in 0..fine {
                    let t = reach * (2.0 * (i as f64 + 0.5) / fine as f64 - 1.0);
                    re += psi(t) * (plan.shape.peak_rad() * t).cos();
                    im += psi(t) * (plan.shape.peak_rad() * t).sin();
                }
                re.hypot(im) * 2.0 * reach / fine as f64
            };
            for b in [950, 1000, 1013, 1100] {
                let b_s = b as f64 / FS_HZ;
                let right: f64 = (0..fine)
                    .map(|i| {
                        let u = reach * (2.0 * (i as f64 + 0.5) / fine as f64 - 1.0);
                        (pulse(b_s + a * u) - mean) * psi(u)
                    })
                    .sum::<f64>()
                    * (2.0 * reach / fine as f64)
                    / largest;
                assert!((w[b] - right.abs()).abs() < tolerance, "{wavelet:?}: {} {right}", w[b]);
            }
        }
    }

    #[test]
    fn single_precision_agrees_with_double() {
        let x = gaussian_noise(1001, 4);
        for wavelet in ALL {
            let f_hz = [5.0, 60.0, 400.0];
            let (wide, _) = picture::<f64>(wavelet, &x, &f_hz, 77, Part::Modulus);
            let (single, _) = picture::<f32>(wavelet, &x, &f_hz, 77, Part::Modulus);
            for (a, b) in wide.iter().zip(&single) {
                // Rounding of f32 in a transform of 1001 points.
                assert!((a - b).abs() < 3e-6, "{wavelet:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn an_impulse_shows_where_it_is_at_every_scale() {
        let mut x = vec![0.0; 2048];
        x[1000] = 1.0;
        for wavelet in ALL {
            let f_hz = [20.0, 60.0, 180.0];
            let (w, plan) = picture::<f64>(wavelet, &x, &f_hz, 2048, Part::Modulus);
            for (row, f_hz) in w.chunks(2048).zip(f_hz) {
                let top = (0..2048).max_by(|a, b| row[*a].total_cmp(&row[*b])).unwrap();
                let reach = plan.shape.reach() * plan.shape.peak_rad() / (TAU * f_hz) * FS_HZ;
                assert!((top as f64 - 1000.0).abs() < reach, "{wavelet:?}, {f_hz}: {top}");
            }
        }
    }

    #[test]
    fn frequencies_out_of_range_are_not_planned() {
        let shape = || Shape::new(Wavelet::Haar).unwrap();
        let mut cache = FftCache::<f64>::new();
        for f_hz in [0.0, -1.0, 500.0, f64::NAN] {
            let plan = WaveletScalogramPlan::new(shape(), (100, FS_HZ), &[f_hz], 10, &mut cache);
            assert!(plan.is_none(), "{f_hz}");
        }
        assert!(WaveletScalogramPlan::new(shape(), (100, FS_HZ), &[9.0], 0, &mut cache).is_none());
        assert!(WaveletScalogramPlan::new(shape(), (1, FS_HZ), &[9.0], 9, &mut cache).is_none());
    }
}
