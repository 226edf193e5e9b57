//! Cross spectrum and coherence of two channels.
//!
//! What two channels have in common, by frequency: for the path from one to the other and for lines
//! that only one of them hears. Must not know what the channels are.

use rustfft::num_complex::Complex;

use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::welch::SegmentTransform;
use crate::dsp::window::Shape;

/// One-sided cross spectral density and magnitude-squared coherence by Welch's method (D28, D29).
#[derive(Debug)]
pub struct CrossPlan<T: Real> {
    x: SegmentTransform<T>,
    y: SegmentTransform<T>,
    sums: Vec<Sums>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    xx: f64,
    yy: f64,
    xy: Complex<f64>,
}

impl<T: Real> CrossPlan<T> {
    /// Plans for segments of `n_segment` samples under a window, a segment every `hop` samples.
    ///
    /// # Panics
    ///
    /// If `n_segment` or `hop` is 0, or a Kaiser window's β is not finite.
    #[must_use]
    pub fn new(shape: Shape, n_segment: usize, hop: usize, cache: &mut FftCache<T>) -> Self {
        let x = SegmentTransform::new(shape, n_segment, hop, cache);
        let y = SegmentTransform::new(shape, n_segment, hop, cache);
        let sums = vec![Sums::default(); x.n_bins()];
        Self { x, y, sums }
    }

    /// Values written per call: ⌊n_segment/2⌋ + 1, at k·fs/n_segment.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.sums.len()
    }

    /// Writes the cross density of `x` and `y` and their coherence; returns the segments averaged.
    ///
    /// `x`, `y`: equally long, units u and v, at `fs_hz`; samples behind the last whole segment are
    /// not used, each segment's own mean is removed. `cross`: u·v/Hz, one-sided; its angle is that by
    /// which y leads x (a delay of y by t seconds: −2πft). `coherence`: 0…1; `None` where one of the
    /// channels is 0, and everywhere with fewer than two segments, whose coherence would be 1
    /// whatever they hold. Independent channels show 1/(independent segments) on average.
    ///
    /// # Panics
    ///
    /// If x and y differ in length or a slice does not have the plan's.
    pub fn process(
        &mut self,
        x: &[T],
        y: &[T],
        fs_hz: f64,
        cross: &mut [Complex<T>],
        coherence: &mut [Option<T>],
    ) -> usize {
        assert_eq!(x.len(), y.len(), "as many samples of either channel");
        assert!(
            cross.len() == self.n_bins() && coherence.len() == self.n_bins(),
            "bins of the plan"
        );
        let n_averages = self.accumulate(x, y);
        for (k, sums) in self.sums.iter().enumerate() {
            let density = sums.xy * self.x.density_factor(k, fs_hz, n_averages);
            cross[k] = Complex::new(T::rounded(density.re), T::rounded(density.im));
            // The roots one by one: the product of two powers may leave f64.
            let root = sums.xx.sqrt() * sums.yy.sqrt();
            let magnitude = sums.xy.norm() / root;
            coherence[k] = (n_averages > 1 && root > 0.0)
                .then(|| T::rounded((magnitude * magnitude).min(1.0)));
        }
        n_averages
    }

    fn accumulate(&mut self, x: &[T], y: &[T]) -> usize {
        self.sums.fill(Sums::default());
        let mut n_averages = 0;
        for (segment_x, segment_y) in self.x.segments(x).zip(self.y.segments(y)) {
            let (x_hat, y_hat) = (self.x.process(segment_x), self.y.process(segment_y));
            for (sums, (x, y)) in self.sums.iter_mut().zip(x_hat.iter().zip(y_hat)) {
                let x = Complex::new(x.re.to_f64(), x.im.to_f64());
                let y = Complex::new(y.re.to_f64(), y.im.to_f64());
                sums.xx += x.norm_sqr();
                sums.yy += y.norm_sqr();
                sums.xy += x.conj() * y;
            }
            n_averages += 1;
        }
        n_averages
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rustfft::num_traits::Zero;

    use super::*;
    use crate::dsp::reference::dft_of_real;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;
    use crate::dsp::welch::WelchPlan;

    struct Result {
        cross: Vec<Complex<f64>>,
        coherence: Vec<Option<f64>>,
        n_averages: usize,
    }

    fn cross<T: Real>(x: &[f64], y: &[f64], shape: Shape, n: usize, hop: usize) -> Result {
        let mut plan = CrossPlan::<T>::new(shape, n, hop, &mut FftCache::new());
        let mut cross = vec![Complex::zero(); plan.n_bins()];
        let mut coherence = vec![None; plan.n_bins()];
        let n_averages = plan.process(&narrow(x), &narrow(y), 1000.0, &mut cross, &mut coherence);
        Result {
            cross: cross.iter().map(|c| Complex::new(c.re.to_f64(), c.im.to_f64())).collect(),
            coherence: coherence.iter().map(|c| c.map(Real::to_f64)).collect(),
            n_averages,
        }
    }

    #[test]
    fn matches_the_definition() {
        // A rectangular window and no overlap: the definition by the plain transform.
        let (x, y) = (gaussian_noise(291, 1), gaussian_noise(291, 2));
        let n = 97;
        let mut sums = vec![Sums::default(); n / 2 + 1];
        for (x, y) in x.chunks(n).zip(y.chunks(n)) {
            for (sums, (x, y)) in sums.iter_mut().zip(dft_of_real(x).iter().zip(dft_of_real(y))) {
                sums.xy += x.conj() * y;
                sums.xx += x.norm_sqr();
                sums.yy += y.norm_sqr();
            }
        }
        let shape = Shape::Kaiser { beta: 0.0 };
        let wide = cross::<f64>(&x, &y, shape, n, n);
        let single = cross::<f32>(&x, &y, shape, n, n);
        assert_eq!(wide.n_averages, 3);
        for (k, sums) in sums.iter().enumerate().skip(1) {
            let exact = sums.xy * (2.0 / (1000.0 * 97.0 * 3.0));
            let coherence = sums.xy.norm_sqr() / (sums.xx * sums.yy);
            // Densities about 2e-3: rounding of a transform in f64 and in f32.
            assert!(
                (wide.cross[k] - exact).norm() < 1e-16 && (single.cross[k] - exact).norm() < 1e-8
            );
            assert!((wide.coherence[k].unwrap() - coherence).abs() < 1e-12);
            assert!((single.coherence[k].unwrap() - coherence).abs() < 1e-5);
        }
    }

    #[test]
    fn a_filtered_copy_is_fully_coherent_and_its_angle_is_the_delay() {
        let noise = gaussian_noise(40_000, 8);
        let delay = 5;
        let x = &noise[delay..];
        let y: Vec<f64> = noise[..noise.len() - delay].iter().map(|v| 3.0 * v).collect();
        let result = cross::<f64>(x, &y, Shape::Hann, 1000, 500);
        let mut auto = vec![0.0; 501];
        WelchPlan::<f64>::new(1000, &mut FftCache::new()).process(x, 1000.0, &mut auto);
        for k in (10..490).step_by(16) {
            // 5 of 1000 samples differ between a segment and its copy: 1 − γ² about 2·0.5 % of the
            // window's slope squared, some 1e-4; each of 79 segments adds its own.
            assert!(result.coherence[k].unwrap() > 0.999, "{k}");
            let gain = result.cross[k] / auto[k];
            let exact = Complex::from_polar(3.0, -TAU * (k * delay) as f64 / 1000.0);
            assert!((gain - exact).norm() < 0.1, "{k}: {gain} {exact}");
        }
    }

    #[test]
    fn coherence_with_noise_has_its_closed_form() {
        // y = x + noise of equal power: γ² = ½. Without a common part: one over the number of
        // independent segments.
        let (x, noise) = (gaussian_noise(200_000, 4), gaussian_noise(200_000, 5));
        let y = sum(&[x.clone(), noise.clone()]);
        let average = |result: &Result| {
            let inner = &result.coherence[8..120];
            inner.iter().map(|c| c.unwrap()).sum::<f64>() / inner.len() as f64
        };
        let half = cross::<f32>(&x, &y, Shape::Hann, 256, 256);
        // 781 segments, 112 bins: scatter √(2γ²(1 − γ²)²/K)/√112 = 0.0017; bias (1 − γ²)²/K.
        assert!((average(&half) - 0.5).abs() < 0.006, "{}", average(&half));
        let none = cross::<f32>(&x, &noise, Shape::Hann, 256, 256);
        // Exponential with mean 1/781 in every bin: ± 10 % over 112 bins.
        assert!((average(&none) * 781.0 - 1.0).abs() < 0.35, "{}", average(&none));
    }

    #[test]
    fn a_common_line_stands_alone() {
        let tone = sine(64_000, 1000.0, 125.0, 1.0, 0.3);
        let x = sum(&[tone.clone(), gaussian_noise(64_000, 1)]);
        let y = sum(&[tone, gaussian_noise(64_000, 2)]);
        let result = cross::<f64>(&x, &y, Shape::Hann, 512, 256);
        // Signal to noise in the bin: (1/4)·512/1.5 = 85 and more: γ² > 0.97.
        assert!(result.coherence[64].unwrap() > 0.95);
        assert!(result.coherence[80].unwrap() < 0.1 && result.coherence[200].unwrap() < 0.1);
    }

    #[test]
    fn hard_cases() {
        let x = gaussian_noise(512, 1);
        // One segment, or none: no coherence; a dead channel: none either, and no NaN.
        assert!(cross::<f64>(&x, &x, Shape::Hann, 512, 256).coherence.iter().all(Option::is_none));
        let none = cross::<f64>(&x, &x, Shape::Hann, 513, 1);
        assert!(none.n_averages == 0 && none.cross.iter().all(|c| c.norm() <= 0.0));
        for dead in [vec![0.0; 512], vec![4.5; 512]] {
            let result = cross::<f32>(&x, &dead, Shape::Hann, 101, 50);
            assert!(result.coherence.iter().all(Option::is_none));
            assert!(result.cross.iter().all(|c| c.norm() <= 0.0));
        }
        // Denormal samples and counts far beyond: coherence does not depend on units.
        let exact = cross::<f64>(&x, &x, Shape::Hann, 64, 32);
        for scale in [1e-160, 1e150] {
            let scaled: Vec<f64> = x.iter().map(|v| v * scale).collect();
            let result = cross::<f64>(&scaled, &scaled, Shape::Hann, 64, 32);
            for (a, b) in result.coherence.iter().zip(&exact.coherence) {
                assert!(a.is_none_or(|a| (a - b.unwrap()).abs() < 1e-9 && a.is_finite()));
            }
        }
        // Gap voltage: 1e6 times the signal on one channel.
        let raised: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
        let result = cross::<f64>(&x, &raised, Shape::Hann, 64, 32);
        assert!(result.coherence[1..].iter().all(|c| (c.unwrap() - 1.0).abs() < 1e-9));
    }
}
