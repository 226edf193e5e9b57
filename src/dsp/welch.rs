//! Power spectral density by averaging over segments.
//!
//! For noise levels: what a line's amplitude is comes from [`crate::dsp::line`]. Must not know which
//! frequencies matter.

use std::slice::Windows;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::Real;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Weighted transforms of overlapping segments, each with its own mean removed.
#[derive(Debug)]
pub(in crate::dsp) struct SegmentTransform<T: Real> {
    window: Window<T>,
    hop: usize,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
}

impl<T: Real> SegmentTransform<T> {
    pub(in crate::dsp) fn new(
        shape: Shape,
        n_segment: usize,
        hop: usize,
        cache: &mut FftCache<T>,
    ) -> Self {
        assert!(n_segment > 0 && hop > 0, "segments of samples, one behind another");
        Self {
            window: Window::new(shape, n_segment),
            hop,
            forward: ForwardPlan::new(n_segment, cache),
            x_hat: vec![Complex::zero(); fft::n_bins(n_segment)],
        }
    }

    pub(in crate::dsp) fn n_bins(&self) -> usize {
        self.x_hat.len()
    }

    /// Whole segments of `x`, in order.
    pub(in crate::dsp) fn segments<'a>(&self, x: &'a [T]) -> std::iter::StepBy<Windows<'a, T>> {
        x.windows(self.forward.n_samples()).step_by(self.hop)
    }

    /// Returns the spectrum of (segment − mean)·w.
    pub(in crate::dsp) fn process(&mut self, segment: &[T]) -> &[Complex<T>] {
        self.forward.process_weighted(segment, &self.window.weights, &mut self.x_hat);
        &self.x_hat
    }

    /// Factor from a sum of |X_k|² over `n_averages` segments to a one-sided density, 1/Hz.
    pub(in crate::dsp) fn density_factor(&self, k: usize, fs_hz: f64, n_averages: usize) -> f64 {
        let sides = if k == 0 || 2 * k == self.forward.n_samples() { 1.0 } else { 2.0 };
        sides / (fs_hz * self.window.sum_of_squares * n_averages.max(1) as f64)
    }
}

/// One-sided power spectral density by Welch's method (D8).
#[derive(Debug)]
pub struct WelchPlan<T: Real> {
    transform: SegmentTransform<T>,
    power: Vec<f64>,
}

impl<T: Real> WelchPlan<T> {
    /// Plans for segments of `n_segment` samples under a Hann window, overlapping by half.
    ///
    /// # Panics
    ///
    /// If `n_segment` is 0.
    #[must_use]
    pub fn new(n_segment: usize, cache: &mut FftCache<T>) -> Self {
        Self::with_window(Shape::Hann, n_segment, (n_segment / 2).max(1), cache)
    }

    /// Plans for segments of `n_segment` samples under any window, a segment every `hop` samples.
    ///
    /// A hop of `n_segment` does not overlap. Half is right for Hann; a narrower window in time
    /// (flat-top, Blackman-Harris) wants a quarter, or samples between segments hardly count.
    ///
    /// # Panics
    ///
    /// If `n_segment` or `hop` is 0, or a Kaiser window's β is not finite.
    #[must_use]
    pub fn with_window(
        shape: Shape,
        n_segment: usize,
        hop: usize,
        cache: &mut FftCache<T>,
    ) -> Self {
        let transform = SegmentTransform::new(shape, n_segment, hop, cache);
        let power = vec![0.0; transform.n_bins()];
        Self { transform, power }
    }

    /// Densities written per call: ⌊n_segment/2⌋ + 1, at k·fs/n_segment.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.power.len()
    }

    /// Writes the density of `x` into `out` and returns the number of segments averaged.
    ///
    /// `x`: any length, unit u, at `fs_hz`; samples behind the last whole segment are not used.
    /// `out`: u²/Hz, one-sided; its sum times fs/n_segment is the variance. With a record shorter
    /// than a segment, 0 is returned and `out` is 0.
    ///
    /// # Panics
    ///
    /// If `out` does not have the plan's length.
    pub fn process(&mut self, x: &[T], fs_hz: f64, out: &mut [T]) -> usize {
        assert_eq!(out.len(), self.n_bins(), "bins of the plan");
        self.power.fill(0.0);
        let mut n_averages = 0;
        for segment in self.transform.segments(x) {
            let x_hat = self.transform.process(segment);
            for (power, value) in self.power.iter_mut().zip(x_hat) {
                // Squared in f64: counts of a 24-bit converter leave f32 in long segments.
                let (re, im) = (value.re.to_f64(), value.im.to_f64());
                *power += re * re + im * im;
            }
            n_averages += 1;
        }
        for (k, (density, power)) in out.iter_mut().zip(&self.power).enumerate() {
            *density = T::rounded(power * self.transform.density_factor(k, fs_hz, n_averages));
        }
        n_averages
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::reference::dft;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::stats::Moments;

    fn density<T: Real>(x: &[f64], shape: Shape, n: usize, hop: usize) -> (Vec<T>, usize) {
        let mut plan = WelchPlan::<T>::with_window(shape, n, hop, &mut FftCache::new());
        let mut out = vec![T::zero(); plan.n_bins()];
        let n_averages = plan.process(&narrow(x), 1000.0, &mut out);
        (out, n_averages)
    }

    /// The definition, with the weights of the window as given.
    fn slow_density(x: &[f64], weights: &[f64], hop: usize) -> Vec<f64> {
        let n = weights.len();
        let power: f64 = weights.iter().map(|w| w * w).sum();
        let mut sums = vec![0.0; n / 2 + 1];
        let mut n_averages = 0.0;
        for start in (0..=x.len() - n).step_by(hop) {
            let segment = &x[start..start + n];
            let mean = segment.iter().sum::<f64>() / n as f64;
            let weighted =
                segment.iter().zip(weights).map(|(x, w)| Complex::new((x - mean) * w, 0.0));
            for (sum, value) in sums.iter_mut().zip(dft(&weighted.collect::<Vec<_>>())) {
                *sum += value.norm_sqr();
            }
            n_averages += 1.0;
        }
        let sides = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let scale = 1.0 / (1000.0 * power * n_averages);
        sums.iter().enumerate().map(|(k, sum)| sides(k) * sum * scale).collect()
    }

    #[test]
    fn matches_the_definition_for_any_window_and_overlap() {
        let shapes =
            [Shape::Hann, Shape::FlatTop, Shape::BlackmanHarris, Shape::Kaiser { beta: 9.0 }];
        for (shape, (n, hop)) in shapes.into_iter().zip([(64, 32), (97, 24), (60, 60), (50, 7)]) {
            let x = gaussian_noise(400, 3);
            let exact = slow_density(&x, &Window::<f64>::new(shape, n).weights, hop);
            let scale = exact.iter().copied().fold(0.0, f64::max);
            let (wide, n_averages) = density::<f64>(&x, shape, n, hop);
            assert_eq!(n_averages, (400 - n) / hop + 1);
            // f64: rounding of the transform; f32: 1e-7 of the largest line, squared and summed.
            assert!(largest_difference(&wide, &exact) < 1e-14 * scale * 10.0, "{shape:?}");
            assert!(
                largest_difference(&density::<f32>(&x, shape, n, hop).0, &exact) < 1e-6 * scale
            );
        }
    }

    #[test]
    fn a_sine_holds_its_power_in_any_window() {
        // Σ S·fs/n = A²/2 whatever the window, on a bin far from 0 and Nyquist: the window's power
        // weights the sine's phase too, by its transform at 2f, below −60 dB here.
        let x = sine(4000, 1000.0, 125.0, 3.0, 0.4);
        for shape in [Shape::Hann, Shape::FlatTop, Shape::BlackmanHarris] {
            let (out, _) = density::<f64>(&x, shape, 400, 100);
            let power = out.iter().sum::<f64>() * 1000.0 / 400.0;
            assert!((power / 4.5 - 1.0).abs() < 1e-12, "{shape:?}: {power}");
        }
    }

    #[test]
    fn density_integrates_to_the_variance() {
        let x = gaussian_noise(100_000, 9);
        let fs_hz = 1000.0;
        let mut plan = WelchPlan::<f32>::new(1024, &mut FftCache::new());
        let mut out = vec![0.0; plan.n_bins()];
        let n_averages = plan.process(&narrow(&x), fs_hz, &mut out);
        assert_eq!(n_averages, (100_000 - 1024) / 512 + 1);
        let total: f64 = out.iter().map(|p| f64::from(*p)).sum::<f64>() * fs_hz / 1024.0;
        let variance = Moments::of(&x).variance().unwrap();
        // Segment means take 1/1024 away; the estimate scatters by √(2/1e5·~1.1) = 0.5 %.
        assert!((total / variance - 1.0).abs() < 0.015, "{total} {variance}");
        // White: a flat 2σ²/fs; an average over 100 bins × 190 averages scatters by 1 %.
        let level = out[100..200].iter().map(|p| f64::from(*p)).sum::<f64>() / 100.0;
        assert!((level * fs_hz / 2.0 / variance - 1.0).abs() < 0.05);
    }

    #[test]
    fn an_impulse_is_flat_and_an_offset_invisible() {
        // One sample a in the middle of one segment: |X|² = (w·a)² in every bin but for the mean.
        let n = 256;
        let mut x = vec![0.0; n];
        x[n / 2] = 2.0;
        let (out, n_averages) = density::<f64>(&x, Shape::Hann, n, n);
        assert_eq!(n_averages, 1);
        let power: f64 =
            (0..n).map(|i| (0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()).powi(2)).sum();
        for density in &out[2..n / 2] {
            assert!((density / (2.0 * 4.0 / (1000.0 * power)) - 1.0).abs() < 1e-12);
        }
        // 1e6 times the signal: its samples are rounded to 1e-10 of it, its sums to some of that.
        let signal = sine(1024, 1000.0, 125.0, 1.0, 0.0);
        let raised: Vec<f64> = signal.iter().map(|x| x + 1e6).collect();
        let (clean, _) = density::<f64>(&signal, Shape::Hann, 256, 128);
        let (offset, _) = density::<f64>(&raised, Shape::Hann, 256, 128);
        assert!(largest_difference(&offset, &clean) < 1e-9 * clean[32]);
        for x in [vec![0.0; 300], vec![1e6; 300], vec![1e-310; 300]] {
            let (out, _) = density::<f64>(&x, Shape::Hann, 64, 32);
            assert!(out.iter().all(|p| p.abs() <= 0.0));
            let (out, _) = density::<f32>(&x, Shape::FlatTop, 63, 5);
            assert!(out.iter().all(|p| p.abs() <= 0.0));
        }
    }

    #[test]
    fn counts_of_a_converter_do_not_overflow() {
        // 24 bits at the rail, alternately: |X|² = (8.4e6·2·1e5)² would leave f32 at 1e5 samples.
        let x: Vec<f64> =
            (0..8192).map(|i| if i % 2 == 0 { 8_388_607.0 } else { -8_388_608.0 }).collect();
        let (out, _) = density::<f32>(&x, Shape::Hann, 4096, 2048);
        // All of it at Nyquist: S·fs/n summed over the lobe is the variance.
        let power = out.iter().map(|p| f64::from(*p)).sum::<f64>() * 1000.0 / 4096.0;
        assert!((power / 8_388_607.5_f64.powi(2) - 1.0).abs() < 1e-6, "{power}");
    }

    #[test]
    fn a_record_shorter_than_a_segment_has_no_density() {
        let mut plan = WelchPlan::<f64>::new(64, &mut FftCache::new());
        let mut out = vec![1.0; plan.n_bins()];
        assert_eq!(plan.process(&[1.0; 63], 100.0, &mut out), 0);
        assert!(out.iter().all(|p| *p <= 0.0));
    }
}
