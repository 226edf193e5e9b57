//! Forward transform of real samples into lists of real and imaginary parts.
//!
//! An even length whose half has a grid goes through it two samples a point (D28), a length with a grid
//! as it is, any other and processors without vectors through `realfft`. Must not know what a bin stands
//! for.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use pulp::Arch;
use realfft::RealToComplex;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::grid::Grid;
use crate::dsp::grid::GridPlan;
use crate::dsp::lanes::Aligned;
use crate::dsp::real::Real;
use crate::dsp::split::Split;

/// Transform of n real samples.
pub(in crate::dsp) struct RealTransform<T: Real> {
    arch: Arch,
    n: usize,
    way: Way<T>,
    x_hat: Split<T>,
}

enum Way<T: Real> {
    Half {
        plan: Arc<GridPlan<T>>,
        grid: Grid<T>,
        flat: Split<T>,
        turns: Split<T>,
    },
    Whole {
        plan: Arc<GridPlan<T>>,
        grid: Grid<T>,
    },
    Library {
        plan: Arc<dyn RealToComplex<T>>,
        input: Vec<T>,
        bins: Vec<Complex<T>>,
        scratch: Vec<Complex<T>>,
    },
}

impl<T: Real> RealTransform<T> {
    /// Plans `n` > 0 samples.
    pub(in crate::dsp) fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        let half = if n.is_multiple_of(2) { cache.grid(n / 2) } else { None };
        let way = if let Some(plan) = half {
            let h = n / 2;
            let mut turns = Split::zeros(h + 1);
            for k in 0..=h {
                // Half of it: the sums of two points are means.
                let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
                (turns.re[k], turns.im[k]) = (T::rounded(0.5 * cos), T::rounded(0.5 * sin));
            }
            Way::Half { plan, grid: Grid::new(h), flat: Split::zeros(h + 1), turns }
        } else if let Some(plan) = cache.grid(n) {
            Way::Whole { plan, grid: Grid::new(n) }
        } else {
            let plan = cache.real_forward(n);
            let scratch = plan.make_scratch_vec();
            let bins = vec![Complex::zero(); fft::n_bins(n)];
            Way::Library { plan, input: vec![T::zero(); n], bins, scratch }
        };
        Self { arch: Arch::new(), n, way, x_hat: Split::zeros(fft::n_bins(n)) }
    }

    pub(in crate::dsp) fn n_samples(&self) -> usize {
        self.n
    }

    /// Transforms (x − offset)·weights, padded with zeros to n samples; without weights x − offset.
    ///
    /// The offset is subtracted in two parts, so that its rounding to T does not stay in the result.
    pub(in crate::dsp) fn process(
        &mut self,
        x: &[T],
        offset: f64,
        weights: Option<&[T]>,
    ) -> &Split<T> {
        let high = T::rounded(offset);
        let low = T::rounded(offset - high.to_f64());
        let Self { arch, way, x_hat, .. } = self;
        match way {
            Way::Half { plan, grid, flat, turns } => {
                let h = plan.len();
                let odd = x.len() % 2;
                let (pairs, last) = x.split_at(x.len() - odd);
                let (re, im) = (&mut grid.re[..h], &mut grid.im[..h]);
                let m = pairs.len() / 2;
                arch.dispatch(
                    #[inline(always)]
                    || match weights {
                        Some(weights) => {
                            let (re, im) = (&mut re[..m], &mut im[..m]);
                            for i in 0..m {
                                re[i] = (pairs[2 * i] - high - low) * weights[2 * i];
                                im[i] = (pairs[2 * i + 1] - high - low) * weights[2 * i + 1];
                            }
                        }
                        None => {
                            let (re, im) = (&mut re[..m], &mut im[..m]);
                            for i in 0..m {
                                re[i] = pairs[2 * i] - high - low;
                                im[i] = pairs[2 * i + 1] - high - low;
                            }
                        }
                    },
                );
                re[m..].fill(T::zero());
                im[m..].fill(T::zero());
                if let ([value], Some(re)) = (last, re.get_mut(m)) {
                    let weight = weights.and_then(|w| w.last()).copied();
                    *re = (*value - high - low) * weight.unwrap_or_else(T::one);
                }
                let lanes = plan.lanes();
                let results = plan.forward(grid);
                flatten(results, lanes, (&mut flat.im, &mut flat.re));
                (flat.re[h], flat.im[h]) = (flat.re[0], flat.im[0]);
                unfold(*arch, flat, turns, x_hat);
            }
            Way::Whole { plan, grid } => {
                let n = plan.len();
                fill(*arch, x, (high, low), weights, &mut grid.re[..n]);
                grid.im.fill(T::zero());
                let lanes = plan.lanes();
                let results = plan.forward(grid);
                flatten(results, lanes, (&mut x_hat.im, &mut x_hat.re));
            }
            Way::Library { plan, input, bins, scratch } => {
                fill(*arch, x, (high, low), weights, input);
                let done = plan.process_with_scratch(input, bins, scratch);
                debug_assert!(done.is_ok(), "lengths were checked");
                x_hat.fill(bins);
            }
        }
        x_hat
    }
}

impl<T: Real> fmt::Debug for RealTransform<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RealTransform").field("n", &self.n).finish_non_exhaustive()
    }
}

fn fill<T: Real>(arch: Arch, x: &[T], (high, low): (T, T), weights: Option<&[T]>, input: &mut [T]) {
    let (input, padding) = input.split_at_mut(x.len());
    arch.dispatch(
        #[inline(always)]
        || match weights {
            Some(weights) => {
                for ((input, value), weight) in input.iter_mut().zip(x).zip(weights) {
                    *input = (*value - high - low) * *weight;
                }
            }
            None => {
                for (input, value) in input.iter_mut().zip(x) {
                    *input = *value - high - low;
                }
            }
        },
    );
    padding.fill(T::zero());
}

/// Puts groups of `lanes` first and second numbers into two lists, as far as these go.
fn flatten<T: Real>(
    groups: &[T],
    lanes: usize,
    (first, second): (&mut Aligned<T>, &mut Aligned<T>),
) {
    let mut groups = groups.chunks_exact(lanes);
    for (first, second) in first.chunks_mut(lanes).zip(second.chunks_mut(lanes)) {
        let (Some(a), Some(b)) = (groups.next(), groups.next()) else { return };
        first.copy_from_slice(&a[..first.len()]);
        second.copy_from_slice(&b[..second.len()]);
    }
}

/// Bins of n real samples from the transform Z of their pairs (D28): with Z′ = conj Z reversed,
/// X = (Z + Z′)/2 − j·e^(−jθ)·(Z − Z′)/2.
fn unfold<T: Real>(arch: Arch, z: &Split<T>, turns: &Split<T>, x_hat: &mut Split<T>) {
    let n = x_hat.re.len();
    let half = T::rounded(0.5);
    let (z_re, z_im) = (&z.re[..n], &z.im[..n]);
    let (cos, sin) = (&turns.re[..n], &turns.im[..n]);
    let (re, im) = (&mut x_hat.re[..n], &mut x_hat.im[..n]);
    arch.dispatch(
        #[inline(always)]
        || {
            for k in 0..n {
                let (a_re, a_im, b_re, b_im) = (z_re[k], z_im[k], z_re[n - 1 - k], z_im[n - 1 - k]);
                let (sum_im, gap_re) = (a_im + b_im, a_re - b_re);
                re[k] = half * (a_re + b_re) + cos[k] * sum_im - sin[k] * gap_re;
                im[k] = half * (a_im - b_im) - cos[k] * gap_re - sin[k] * sum_im;
            }
        },
    );
}
