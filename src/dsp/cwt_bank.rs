//! Morlet transform at many scales of one spectrum.
//!
//! All scales share the spectrum, the buffers and the tables of equal lengths. *Decimated* output keeps
//! the bins of each wavelet's support and inverts them at the cheapest length that holds them, so that
//! every scale comes at a rate of its own bandwidth; *full* output has a coefficient a sample at every
//! scale; the RMS of a scale needs no inverse at all (Parseval). Must not know shafts or meshes.

use std::f64::consts::TAU;
use std::ops::Range;

use rustfft::num_complex::Complex;

use crate::dsp::cwt;
use crate::dsp::cwt::Part;
use crate::dsp::fft;
use crate::dsp::fft::Band;
use crate::dsp::fft::FftCache;
use crate::dsp::inverse::Inverse;
use crate::dsp::inverse::Results;
use crate::dsp::inverse::Workspace;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::split::Split;

/// How much of the wavelet is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accuracy {
    /// All that f64 can see: 8.6 standard deviations, 1e-16.
    Reference,
    /// Errors up to 4e-7 of the largest coefficient: 1.6e-7 left out by 5.6 standard deviations, or the rounding of f32,
    /// which is not the same with every set of vector instructions.
    Fine,
    /// Errors up to 1e-3 of the largest coefficient: 3.72 standard deviations.
    Coarse,
}

impl Accuracy {
    /// Standard deviations of ψ̂ kept on either side.
    #[must_use]
    pub fn support_sigmas(self) -> f64 {
        match self {
            Self::Reference => 8.6,
            Self::Fine => cwt::SUPPORT_SIGMA,
            Self::Coarse => 3.72,
        }
    }
}

/// How many coefficients a scale has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rate {
    /// As many as its bandwidth needs.
    Decimated,
    /// One a sample.
    Full,
}

/// What is computed of each scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Samples a second.
    pub fs_hz: f64,
    /// Centre frequency of the wavelet, rad ([`cwt::DEFAULT_OMEGA0`]).
    pub omega0: f64,
    /// How much of the wavelet is kept.
    pub accuracy: Accuracy,
    /// How many coefficients a scale has.
    pub rate: Rate,
}

/// Morlet transform of a record at many frequencies (D13).
#[derive(Debug)]
pub struct CwtPlan<T: Real> {
    n: usize,
    n_padded: usize,
    fs_hz: f64,
    scales: Vec<Scale<T>>,
    x: Split<T>,
    workspace: Workspace<T>,
}

#[derive(Debug)]
struct Scale<T: Real> {
    band: Band<T>,
    /// `None`: RMS only.
    inverse: Option<Inverse<T>>,
    sigma_t_s: f64,
    /// Its coefficients among those of all scales.
    places: Range<usize>,
}

impl<T: Real> CwtPlan<T> {
    /// Plans the frequencies `f_hz` for records of `n` samples that were padded to `n_padded` before
    /// they were transformed ([`fft::ForwardPlan::new_padded`]); without padding the record is treated
    /// as periodic. What a jump between its ends or to zero makes lies outside [`Self::valid_range`].
    ///
    /// `None` if a frequency cannot be planned (see [`cwt::MorletPlan::new`]) or `n_padded` < `n`.
    #[must_use]
    pub fn new(
        (n, n_padded): (usize, usize),
        f_hz: &[f64],
        settings: &Settings,
        cache: &mut FftCache<T>,
    ) -> Option<Self> {
        Self::with_inverses((n, n_padded), f_hz, settings, |width| {
            let length = match settings.rate {
                Rate::Decimated => fft::cheapest_inverse_len::<T>(width),
                Rate::Full => n_padded,
            };
            Some(Inverse::new(length, cache))
        })
    }

    /// As [`Self::new`] for [`Self::rms`] alone: no tables and no room for coefficients.
    #[must_use]
    pub fn of_rms(
        (n, n_padded): (usize, usize),
        f_hz: &[f64],
        settings: &Settings,
    ) -> Option<Self> {
        Self::with_inverses((n, n_padded), f_hz, settings, |_| None)
    }

    fn with_inverses(
        (n, n_padded): (usize, usize),
        f_hz: &[f64],
        &Settings { fs_hz, omega0, accuracy, .. }: &Settings,
        mut inverse: impl FnMut(usize) -> Option<Inverse<T>>,
    ) -> Option<Self> {
        if n_padded < n {
            return None;
        }
        let mut scales = Vec::with_capacity(f_hz.len());
        let mut end = 0;
        for f_hz in f_hz {
            let sigmas = accuracy.support_sigmas();
            let bins = cwt::support(n_padded, fs_hz, *f_hz, omega0, sigmas)?;
            let inverse = inverse(bins.len());
            let length = inverse.as_ref().map_or(0, Inverse::len);
            // Those at times before the end of the record.
            let n_out = ceil_index(length as f64 * (n as f64 / n_padded as f64)).min(length);
            let places = end..end + n_out;
            end = places.end;
            let band = Band::new(n_padded, bins, cwt::gain(n_padded, fs_hz, *f_hz, omega0));
            scales.push(Scale { band, inverse, sigma_t_s: omega0 / (TAU * f_hz), places });
        }
        let workspace = Workspace::new(scales.iter().filter_map(|scale| scale.inverse.as_ref()));
        let x = Split::zeros(fft::n_bins(n_padded));
        Some(Self { n, n_padded, fs_hz, scales, x, workspace })
    }

    /// Coefficients of all scales.
    #[must_use]
    pub fn out_len(&self) -> usize {
        self.scales.last().map_or(0, |scale| scale.places.end)
    }

    /// Scales, in the order of the frequencies.
    #[must_use]
    pub fn n_scales(&self) -> usize {
        self.scales.len()
    }

    /// Where the coefficients of a scale stand among those of all; `None` if there is no such scale.
    #[must_use]
    pub fn places(&self, scale: usize) -> Option<Range<usize>> {
        self.scales.get(scale).map(|scale| scale.places.clone())
    }

    /// Time between two coefficients of a scale, s, the first at the first sample; `None` if it has none.
    #[must_use]
    pub fn step_s(&self, scale: usize) -> Option<f64> {
        let length = self.scales.get(scale)?.inverse.as_ref()?.len();
        Some(self.n_padded as f64 / (self.fs_hz * length as f64))
    }

    /// Coefficients of a scale outside the cone of influence: at least 2.25 σ_t from both ends of the
    /// record, where these make 1 % at most; counted from the scale's first.
    #[must_use]
    pub fn valid_range(&self, scale: usize) -> Range<usize> {
        let Some(step_s) = self.step_s(scale) else { return 0..0 };
        let scale = &self.scales[scale];
        let margin_s = cwt::CONE_SIGMA * scale.sigma_t_s;
        let start = ceil_index(margin_s / step_s);
        let end = ceil_index((self.n as f64 / self.fs_hz - margin_s) / step_s);
        let end = end.min(scale.places.len());
        if start < end { start..end } else { 0..0 }
    }

    /// Writes W of all scales, one behind the other.
    ///
    /// `x_hat`: the spectrum of `n_padded` samples, unit u. `out`: u, true phase.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) {
        self.each(x_hat, out, |results, out| results.copy_to(out));
    }

    /// Writes |W| or |Re W| of all scales, one behind the other, u.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process_part(&mut self, x_hat: &[Complex<T>], part: Part, out: &mut [T]) {
        self.each(x_hat, out, |results, out| part.of_results(results, out));
    }

    fn each<U>(
        &mut self,
        x_hat: &[Complex<T>],
        out: &mut [U],
        write: impl Fn(&Results<'_, T>, &mut [U]),
    ) {
        assert_eq!(x_hat.len(), fft::n_bins(self.n_padded), "bins of the plan");
        assert_eq!(out.len(), self.out_len(), "coefficients of all scales");
        self.x.fill(x_hat);
        for scale in &self.scales {
            let Some(inverse) = &scale.inverse else { continue };
            scale.band.lay_out_split(&self.x, inverse.len(), &mut self.workspace.grid);
            write(&inverse.run(&mut self.workspace), &mut out[scale.places.clone()]);
        }
    }

    /// Writes the RMS over the record of |W| of every scale, u, without an inverse (D52).
    ///
    /// The cone of influence is part of it; what spreads into the padding is counted as if it stood in
    /// the record.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn rms(&mut self, x_hat: &[Complex<T>], rms: &mut [f64]) {
        assert_eq!(x_hat.len(), fft::n_bins(self.n_padded), "bins of the plan");
        assert_eq!(rms.len(), self.scales.len(), "one RMS a scale");
        self.x.fill(x_hat);
        let stretch = self.n_padded as f64 / self.n as f64;
        for (rms, scale) in rms.iter_mut().zip(&self.scales) {
            *rms = (scale.band.power(&self.x) * stretch).sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use rustfft::num_traits::Zero;

    use super::*;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::reference::dft_of_real;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const FS_HZ: f64 = 10_000.0;

    fn settings(accuracy: Accuracy, rate: Rate) -> Settings {
        Settings { fs_hz: FS_HZ, omega0: cwt::DEFAULT_OMEGA0, accuracy, rate }
    }

    fn frequencies(n: usize, low_hz: f64, high_hz: f64) -> Vec<f64> {
        let step = |i: usize| i as f64 / (n - 1) as f64;
        (0..n).map(|i| low_hz * (high_hz / low_hz).powf(step(i))).collect()
    }

    fn transform<T: Real>(
        x: &[f64],
        n_padded: usize,
        f_hz: &[f64],
        settings: &Settings,
    ) -> (CwtPlan<T>, Vec<Complex<T>>, Vec<Complex<T>>) {
        let mut cache = FftCache::new();
        let mut forward = ForwardPlan::new_padded(x.len(), n_padded, &mut cache);
        let mut x_hat = vec![Complex::zero(); forward.n_bins()];
        forward.process(&narrow::<T>(x), &mut x_hat);
        let mut plan = CwtPlan::new((x.len(), n_padded), f_hz, settings, &mut cache).unwrap();
        let mut w = vec![Complex::zero(); plan.out_len()];
        plan.process(&x_hat, &mut w);
        (plan, x_hat, w)
    }

    /// Largest error over all scales against the sums of the definition over all bins, relative to the
    /// largest coefficient, at a few times of each scale.
    fn error<T: Real>(x: &[f64], f_hz: &[f64], settings: &Settings) -> f64 {
        let n = x.len();
        let (plan, _, w) = transform::<T>(x, n, f_hz, settings);
        let spectrum = dft_of_real(&narrow::<T>(x).iter().map(|v| v.to_f64()).collect::<Vec<_>>());
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for (scale, f_hz) in f_hz.iter().enumerate() {
            let gain = cwt::gain(n, FS_HZ, *f_hz, settings.omega0);
            let step = plan.step_s(scale).unwrap() * FS_HZ;
            let w = &w[plan.places(scale).unwrap()];
            for (i, w) in w.iter().enumerate().step_by(1 + w.len() / 37) {
                let side = |k: usize| if 2 * k == n { 1.0 } else { 2.0 };
                let turn = |k: usize| {
                    let cycles = (k as f64 * i as f64 * step / n as f64).fract();
                    Complex::from_polar(gain(k) * side(k) / n as f64, TAU * cycles)
                };
                let exact: Complex<f64> = (1..=n / 2).map(|k| spectrum[k] * turn(k)).sum();
                let found = Complex::new(w.re.to_f64(), w.im.to_f64());
                worst = worst.max((found - exact).norm());
                largest = largest.max(exact.norm());
            }
        }
        worst / largest
    }

    #[test]
    fn errors_are_as_stated_at_both_rates() {
        let n = 2000;
        let noise = gaussian_noise(n, 6);
        // A line above all scales but the last: the largest part that a support can leave out.
        let line = sine(n, FS_HZ, 1200.0, 1.0, 0.3);
        let gear = sum(&[
            sine(n, FS_HZ, 683.1, 1.0, 0.0),
            sine(n, FS_HZ, 29.7, 0.3, 1.0),
            noise.iter().map(|v| 0.2 * v).collect(),
        ]);
        let f_hz = frequencies(40, 20.0, 4000.0);
        for x in [&noise, &line, &gear] {
            for rate in [Rate::Decimated, Rate::Full] {
                let fine = settings(Accuracy::Fine, rate);
                let single = error::<f32>(x, &f_hz, &fine);
                assert!(single < 4e-7, "the stated bound: {single:e}");
                let double = error::<f64>(x, &f_hz, &settings(Accuracy::Reference, rate));
                // Rounding of two transforms, and of the phases of the reference, 1e-13 cycles.
                assert!(double < 1e-12, "{double:e}");
                let coarse = error::<f32>(x, &f_hz, &settings(Accuracy::Coarse, rate));
                assert!(coarse < 1e-3, "the stated bound: {coarse:e}");
            }
        }
        let coarse = error::<f64>(&line, &f_hz, &settings(Accuracy::Coarse, Rate::Decimated));
        assert!(coarse > 1e-6, "what was left out is seen: {coarse:e}");
    }

    #[test]
    fn rms_is_that_of_the_coefficients() {
        let x = gaussian_noise(1000, 2);
        let f_hz = frequencies(12, 50.0, 4500.0);
        for rate in [Rate::Decimated, Rate::Full] {
            let settings = settings(Accuracy::Fine, rate);
            let (mut plan, x_hat, w) = transform::<f64>(&x, 1000, &f_hz, &settings);
            let mut rms = vec![0.0; f_hz.len()];
            plan.rms(&x_hat, &mut rms);
            let (single, x_hat, _) = transform::<f32>(&x, 1000, &f_hz, &settings);
            let mut narrow = vec![0.0; f_hz.len()];
            CwtPlan::<f32>::of_rms((1000, 1000), &f_hz, &settings)
                .unwrap()
                .rms(&x_hat, &mut narrow);
            assert_eq!(single.n_scales(), f_hz.len());
            for (scale, rms) in rms.iter().enumerate() {
                let w = &w[plan.places(scale).unwrap()];
                let mean = w.iter().map(|w| w.norm_sqr()).sum::<f64>() / w.len() as f64;
                // An identity: rounding only, in f32 that of a transform and of short sums.
                assert!((rms / mean.sqrt() - 1.0).abs() < 1e-13);
                assert!((narrow[scale] / rms - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn padding_puts_zeros_behind_the_record() {
        let (n, n_padded, f_hz) = (1500, 2048, [161.3, 683.1]);
        let x = gaussian_noise(n, 8);
        let mean = x.iter().sum::<f64>() / n as f64;
        for rate in [Rate::Decimated, Rate::Full] {
            let settings = settings(Accuracy::Fine, rate);
            let (plan, _, w) = transform::<f64>(&x, n_padded, &f_hz, &settings);
            for (scale, f_hz) in f_hz.iter().enumerate() {
                let step_s = plan.step_s(scale).unwrap();
                let places = plan.places(scale).unwrap();
                assert!((places.len() - 1) as f64 * step_s < n as f64 / FS_HZ);
                assert!(places.len() as f64 * step_s >= n as f64 / FS_HZ * (1.0 - 1e-12));
                // The integral over the record alone, up to 6 σ_t from the end of the padding.
                let a_s = 1.0 / f_hz;
                for (i, w) in w[places].iter().enumerate() {
                    let b_s = i as f64 * step_s;
                    if b_s < 6.0 * a_s {
                        continue;
                    }
                    let norm = 2.0 / TAU.sqrt() / a_s / FS_HZ;
                    let term = |(i, value): (usize, &f64)| {
                        let t = (i as f64 / FS_HZ - b_s) / a_s;
                        Complex::from_polar(norm * (value - mean) * (-0.5 * t * t).exp(), -TAU * t)
                    };
                    let exact: Complex<f64> = x.iter().enumerate().map(term).sum();
                    // 1.6e-7 of support at most, times noise of unit size.
                    assert!((w - exact).norm() < 1e-6, "{f_hz} Hz at {b_s} s: {w} {exact}");
                }
            }
        }
    }

    #[test]
    fn the_cone_is_marked_at_either_rate() {
        let x = sine(10_000, FS_HZ, 100.0, 1.0, 0.2);
        for rate in [Rate::Decimated, Rate::Full] {
            let settings = settings(Accuracy::Fine, rate);
            let (plan, _, w) = transform::<f32>(&x, 16_384, &[100.0, 1.0], &settings);
            let (valid, places) = (plan.valid_range(0), plan.places(0).unwrap());
            let step_s = plan.step_s(0).unwrap();
            // 2.25 σ_t = 22.5 ms on either side of 1 s.
            assert!((valid.start as f64 * step_s - 0.0225).abs() <= step_s);
            assert!((valid.end as f64 * step_s - 0.9775).abs() <= step_s);
            let modulus = |i: usize| f64::from(w[places.start + i].norm());
            for i in valid {
                // 1 %, a little more where the line's mirror is not small beside what is missing.
                assert!((modulus(i) - 1.0).abs() < 1.4e-2, "{i}: {}", modulus(i));
            }
            assert!(modulus(0) < 0.6, "the edge reads half");
            assert!(plan.valid_range(1).is_empty() && plan.valid_range(2).is_empty());
        }
    }

    #[test]
    fn what_cannot_be_planned_is_none() {
        let mut cache = FftCache::<f32>::new();
        let settings = settings(Accuracy::Fine, Rate::Full);
        for f_hz in [0.0, 5000.0, f64::NAN] {
            assert!(CwtPlan::new((100, 100), &[f_hz], &settings, &mut cache).is_none());
        }
        assert!(CwtPlan::new((100, 99), &[500.0], &settings, &mut cache).is_none());
        let none = CwtPlan::new((100, 100), &[], &settings, &mut cache).unwrap();
        assert_eq!((none.n_scales(), none.out_len()), (0, 0));
    }
}
