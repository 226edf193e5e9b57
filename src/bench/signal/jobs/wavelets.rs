//! Wavelet transforms that are measured.

use super::{Forward, Job, complex_zeros, narrow, relative, relative_real, wide};
use crate::bench::clock::Work;
use crate::bench::signal::Effort;
use crate::bench::signal::recording::{FS_HZ, MESH_HZ, SHAFT_HZ};
use crate::bench::signal::reference::{self, Morlet};
use crate::dsp::cwt::{DEFAULT_OMEGA0, MorletPlan};
use crate::dsp::cwt_bank::{Accuracy, CwtPlan, Rate, Settings};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::real::Real;
use rustfft::num_complex::Complex;

/// Frequencies of the scales, 5 Hz to 4 kHz by equal ratios.
pub(super) fn scales_hz(effort: &Effort) -> Vec<f64> {
    let last = (effort.n_scales - 1) as f64;
    let lowest = FS_HZ / effort.n_second as f64 * 5.0;
    (0..effort.n_scales).map(|i| lowest * (4000.0 / lowest).powf(i as f64 / last)).collect()
}

pub(super) struct Cwt<T: Real> {
    x: Vec<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    /// Always there with a frequency below Nyquist, as all are.
    plan: Option<CwtPlan<T>>,
    f_hz: Vec<f64>,
    is_rms: bool,
    w: Vec<Complex<T>>,
    rms: Vec<f64>,
}

impl<T: Real> Cwt<T> {
    pub(super) fn new(
        x: &[f64],
        effort: &Effort,
        n_padded: usize,
        (accuracy, rate, is_rms): (Accuracy, Rate, bool),
    ) -> Self {
        let mut cache = FftCache::new();
        let n = effort.n_second;
        let forward = ForwardPlan::new_padded(n, n_padded, &mut cache);
        let settings = Settings { fs_hz: FS_HZ, omega0: DEFAULT_OMEGA0, accuracy, rate };
        let f_hz = scales_hz(effort);
        let plan = if is_rms {
            CwtPlan::of_rms((n, n_padded), &f_hz, &settings)
        } else {
            CwtPlan::new((n, n_padded), &f_hz, &settings, &mut cache)
        };
        let w = complex_zeros(plan.as_ref().map_or(0, CwtPlan::out_len));
        let (x_hat, rms) = (complex_zeros(forward.n_bins()), vec![0.0; f_hz.len()]);
        Self { x: narrow(&x[..n]), forward, x_hat, plan, f_hz, is_rms, w, rms }
    }
}

impl<T: Real> Work for Cwt<T> {
    fn call(&mut self) {
        self.forward.process(&self.x, &mut self.x_hat);
        let Some(plan) = &mut self.plan else { return };
        if self.is_rms {
            plan.rms(&self.x_hat, &mut self.rms);
        } else {
            plan.process(&self.x_hat, &mut self.w);
        }
    }
}

impl<T: Real> Job for Cwt<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        const TIMES: usize = 5;
        let plan = self.plan.as_ref()?;
        let (n, n_padded) = (self.x.len(), self.forward.n_samples());
        let spectrum = reference::spectrum(&x[..n], |_| 1.0, n_padded, 0..self.x_hat.len());
        let exact = Morlet { spectrum: &spectrum, n: n_padded, fs_hz: FS_HZ };
        if self.is_rms {
            let exact: Vec<f64> = self.f_hz.iter().map(|f_hz| exact.rms(*f_hz, n)).collect();
            return relative_real(self.rms.iter().copied(), &exact);
        }
        let pairs = self.f_hz.iter().enumerate().filter_map(|(scale, f_hz)| {
            let (places, step_s) = (plan.places(scale)?, plan.step_s(scale)?);
            let each = places.len().div_ceil(TIMES);
            Some((0..places.len()).step_by(each).map({
                let (w, exact) = (&self.w, &exact);
                move |i| (wide(&w[places.start + i]), exact.at(*f_hz, i as f64 * step_s * FS_HZ))
            }))
        });
        relative(pairs.flatten())
    }
}

/// Mean modulus at shaft and mesh, from a spectrum that is there.
pub(super) struct Pair<T: Real> {
    x_hat: Vec<Complex<T>>,
    plans: Vec<MorletPlan<T>>,
    n: usize,
    found: [f64; 2],
}

impl<T: Real> Pair<T> {
    pub(super) fn new(x: &[f64]) -> Self {
        let mut forward = Forward::<T>::new(x);
        forward.call();
        let plans = morlets(x.len(), &mut FftCache::new());
        Self { x_hat: forward.x_hat, plans, n: x.len(), found: [0.0; 2] }
    }
}

pub(super) fn morlets<T: Real>(n: usize, cache: &mut FftCache<T>) -> Vec<MorletPlan<T>> {
    let shaft_hz = SHAFT_HZ.max(8.0 * FS_HZ / n as f64);
    let plan = |f_hz| MorletPlan::new(n, FS_HZ, f_hz, DEFAULT_OMEGA0, cache);
    [shaft_hz, MESH_HZ].into_iter().filter_map(plan).collect()
}

impl<T: Real> Work for Pair<T> {
    fn call(&mut self) {
        for (plan, found) in self.plans.iter_mut().zip(&mut self.found) {
            *found = plan.mean_magnitude(&self.x_hat).unwrap_or(f64::NAN);
        }
    }
}

impl<T: Real> Job for Pair<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let spectrum = reference::spectrum(&x[..self.n], |_| 1.0, self.n, 0..self.x_hat.len());
        let exact = Morlet { spectrum: &spectrum, n: self.n, fs_hz: FS_HZ };
        let shaft_hz = SHAFT_HZ.max(8.0 * FS_HZ / self.n as f64);
        let mean = |(plan, f_hz): (&MorletPlan<T>, f64)| {
            let (valid, step) = (plan.valid_range(), plan.step_s() * FS_HZ);
            let n = valid.len() as f64;
            valid.map(|i| exact.at(f_hz, i as f64 * step).norm()).sum::<f64>() / n
        };
        let exact: Vec<f64> = self.plans.iter().zip([shaft_hz, MESH_HZ]).map(mean).collect();
        relative_real(self.found.iter().copied(), &exact)
    }
}
