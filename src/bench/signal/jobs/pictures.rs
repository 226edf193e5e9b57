//! Wavelets other than Morlet's and bilinear distributions that are measured; f32 is held against f64.

use super::wavelets::scales_hz;
use super::{Forward, Job, narrow, relative_real, zeros};
use crate::bench::clock::Work;
use crate::bench::signal::Effort;
use crate::bench::signal::recording::FS_HZ;
use crate::dsp::bilinear::kernel::Kernel;
use crate::dsp::bilinear::{JointPlan, JointSpec};
use crate::dsp::cwt::Part;
use crate::dsp::fft::FftCache;
use crate::dsp::real::Real;
use crate::dsp::wavelet::dwt::DwtPlan;
use crate::dsp::wavelet::picture::WaveletScalogramPlan;
use crate::dsp::wavelet::shape::{Shape, Wavelet};
use crate::dsp::wavelet::taps::FilterBank;

/// What is made of the spectrum of a record.
enum Plan<T: Real> {
    Wavelet(Box<WaveletScalogramPlan<T>>),
    Joint(Box<JointPlan<T>>),
}

/// A picture of a second, its forward transform included.
pub(super) struct Picture<T: Real> {
    forward: Forward<T>,
    plan: Plan<T>,
    out: Vec<T>,
    make: fn(&[f64], &Effort) -> Option<Picture<f64>>,
    effort: Effort,
}

impl<T: Real> Picture<T> {
    /// Mexican hat, 200 columns.
    pub(super) fn hat(x: &[f64], effort: &Effort) -> Option<Self> {
        let shape = Shape::new(Wavelet::MexicanHat)?;
        let record = (x.len(), FS_HZ);
        let f_hz = scales_hz(effort);
        let plan = WaveletScalogramPlan::new(shape, record, &f_hz, 200, &mut FftCache::new())?;
        let out = zeros(plan.out_len());
        let plan = Plan::Wavelet(Box::new(plan));
        Some(Self {
            forward: Forward::new(x),
            plan,
            out,
            make: Picture::<f64>::hat,
            effort: *effort,
        })
    }

    /// Pseudo Wigner–Ville, 200 instants, lags up to an eighth of the record.
    pub(super) fn ville(x: &[f64], effort: &Effort) -> Option<Self> {
        Self::joint(x, effort, Kernel::Delta, Picture::<f64>::ville)
    }

    /// The same, smoothed over a fiftieth of the record.
    pub(super) fn smoothed(x: &[f64], effort: &Effort) -> Option<Self> {
        Self::joint(x, effort, Kernel::Hann(x.len() / 100), Picture::<f64>::smoothed)
    }

    /// Choi–Williams, σ = 1.
    pub(super) fn choi(x: &[f64], effort: &Effort) -> Option<Self> {
        Self::joint(x, effort, Kernel::ChoiWilliams(1.0), Picture::<f64>::choi)
    }

    fn joint(
        x: &[f64],
        effort: &Effort,
        kernel: Kernel,
        make: fn(&[f64], &Effort) -> Option<Picture<f64>>,
    ) -> Option<Self> {
        let n_lags = x.len() / 64;
        let spec = JointSpec {
            kernel,
            n_lags,
            is_lag_windowed: true,
            n_frequencies: 2 * n_lags + 2,
            n_times: 200,
        };
        let plan = JointPlan::new(x.len(), FS_HZ, spec, &mut FftCache::new())?;
        let out = zeros(plan.out_len());
        let plan = Plan::Joint(Box::new(plan));
        Some(Self { forward: Forward::new(x), plan, out, make, effort: *effort })
    }
}

impl<T: Real> Work for Picture<T> {
    fn call(&mut self) {
        self.forward.call();
        match &mut self.plan {
            Plan::Wavelet(plan) => plan.process(&self.forward.x_hat, Part::Modulus, &mut self.out),
            Plan::Joint(plan) => plan.process(&self.forward.x_hat, &mut self.out),
        }
    }
}

impl<T: Real> Job for Picture<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        if size_of::<T>() == size_of::<f64>() {
            return None;
        }
        let mut wide = (self.make)(&x[..self.forward.x.len()], &self.effort)?;
        wide.call();
        relative_real(self.out.iter().copied(), &wide.out)
    }
}

/// Discrete transform by Daubechies' eighth, and back for its error.
pub(super) struct Tree<T: Real> {
    x: Vec<T>,
    plan: DwtPlan,
    out: Vec<T>,
}

impl<T: Real> Tree<T> {
    /// The longest power of two of the record's beginning, 8 levels at most.
    pub(super) fn new(x: &[f64]) -> Option<Self> {
        let levels = x.len().ilog2();
        let n = 1_usize << levels;
        let plan = DwtPlan::new(&FilterBank::daubechies(8)?, n, levels.min(8))?;
        Some(Self { x: narrow(&x[..n]), plan, out: zeros(n) })
    }
}

impl<T: Real> Work for Tree<T> {
    fn call(&mut self) {
        self.plan.analyse(&self.x, &mut self.out);
    }
}

impl<T: Real> Job for Tree<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let mut back = zeros::<T>(self.out.len());
        self.plan.synthesise(&self.out, &mut back);
        relative_real(back.into_iter(), &x[..self.out.len()])
    }
}
