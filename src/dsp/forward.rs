//! Forward transform of real samples into lists of real and imaginary parts.
//!
//! An even length whose half has a grid goes through it two samples a point (D51), a length with a grid
//! as it is, any other and processors without vectors through `realfft`. Must not know what a bin stands
//! for.

use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use realfft::RealToComplex;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::grid::Grid;
use crate::dsp::grid::GridPlan;
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
        pairs: PairTransform<T>,
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
        let way = if let Some(pairs) = PairTransform::new(n, cache) {
            Way::Half { pairs, turns: half_turns(n, 0..n / 2 + 1, 1.0) }
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
            Way::Half { pairs, turns } => {
                pairs.fill(x, (high, low), weights);
                let h = pairs.len();
                let z = pairs.run(0..h + 1);
                arch.dispatch(Unfold { z, turns, x_hat });
            }
            Way::Whole { plan, grid } => {
                let n = plan.len();
                let input = &mut grid.re[..n];
                arch.dispatch(Singles { x, high, low, weights, input });
                grid.im.fill(T::zero());
                let lanes = plan.lanes();
                let groups = plan.forward(grid);
                let (first, second) = (&mut x_hat.im[..], &mut x_hat.re[..]);
                arch.dispatch(Flatten { groups, lanes, first, second });
            }
            Way::Library { plan, input, bins, scratch } => {
                arch.dispatch(Singles { x, high, low, weights, input });
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

/// Transform Z of n real samples two a point (D51), for [`Unfold`] or a band of it.
#[derive(Debug)]
pub(in crate::dsp) struct PairTransform<T: Real> {
    arch: Arch,
    plan: Arc<GridPlan<T>>,
    grid: Grid<T>,
    flat: Split<T>,
}

impl<T: Real> PairTransform<T> {
    /// Plans `n` samples; `None` if n/2 points have no grid.
    pub(in crate::dsp) fn new(n: usize, cache: &mut FftCache<T>) -> Option<Self> {
        let plan = if n.is_multiple_of(2) { cache.grid(n / 2)? } else { return None };
        let (grid, flat) = (Grid::new(n / 2), Split::zeros(n / 2 + 1));
        Some(Self { arch: Arch::new(), plan, grid, flat })
    }

    /// Points: n/2.
    pub(in crate::dsp) fn len(&self) -> usize {
        self.plan.len()
    }

    /// Takes (x − high − low)·weights in, padded with zeros.
    pub(in crate::dsp) fn fill(&mut self, x: &[T], (high, low): (T, T), weights: Option<&[T]>) {
        let (re, im) = self.points();
        let n_pairs = x.len() / 2;
        // The last of an odd number, and the padding.
        re[n_pairs..].fill(T::zero());
        im[n_pairs..].fill(T::zero());
        if let (Some(re), false) = (re.get_mut(n_pairs), x.len().is_multiple_of(2)) {
            let weight = weights.map_or_else(T::one, |weights| weights[x.len() - 1]);
            *re = (x[x.len() - 1] - high - low) * weight;
        }
        Arch::new().dispatch(Pairs { x, high, low, weights, re, im });
    }

    /// Where the points go: the even samples and the odd ones.
    pub(in crate::dsp) fn points(&mut self) -> (&mut [T], &mut [T]) {
        let h = self.plan.len();
        (&mut self.grid.re[..h], &mut self.grid.im[..h])
    }

    /// Transforms the points: Z_k at k, for the k in `wanted` (0…n/2, Z_{n/2} = Z_0) at least; the
    /// others are left of the last call.
    pub(in crate::dsp) fn run(&mut self, wanted: Range<usize>) -> &Split<T> {
        let Self { arch, plan, grid, flat } = self;
        let (h, lanes) = (plan.len(), plan.lanes());
        let groups = plan.forward(grid);
        let from = wanted.start.min(h) / lanes * lanes;
        let part = from..wanted.end.next_multiple_of(lanes).min(h);
        let groups = &groups[2 * from..];
        let (first, second) = (&mut flat.im[part.clone()], &mut flat.re[part]);
        arch.dispatch(Flatten { groups, lanes, first, second });
        if from == 0 {
            (flat.re[h], flat.im[h]) = (flat.re[0], flat.im[0]);
        }
        flat
    }
}

/// `factor`·e^(j2πk/n)/2 for every k of `bins`; half of it: the sums of two points are means.
pub(in crate::dsp) fn half_turns<T: Real>(n: usize, bins: Range<usize>, factor: f64) -> Split<T> {
    let mut turns = Split::zeros(bins.len());
    for (i, k) in bins.enumerate() {
        let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
        (turns.re[i], turns.im[i]) =
            (T::rounded(factor * 0.5 * cos), T::rounded(factor * 0.5 * sin));
    }
    turns
}

/// (x − high − low)·weights, the even samples and the odd ones.
struct Pairs<'a, T> {
    x: &'a [T],
    high: T,
    low: T,
    weights: Option<&'a [T]>,
    re: &'a mut [T],
    im: &'a mut [T],
}

impl<T: Real> WithSimd for Pairs<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { x, high, low, weights, re, im } = self;
        let (x, _) = x.as_chunks::<2>();
        let (re, im) = (&mut re[..x.len()], &mut im[..x.len()]);
        if let Some(weights) = weights {
            let (weights, _) = weights.as_chunks::<2>();
            let weights = &weights[..x.len()];
            for i in 0..x.len() {
                re[i] = (x[i][0] - high - low) * weights[i][0];
                im[i] = (x[i][1] - high - low) * weights[i][1];
            }
        } else {
            for i in 0..x.len() {
                re[i] = x[i][0] - high - low;
                im[i] = x[i][1] - high - low;
            }
        }
    }
}

/// (x − high − low)·weights, then zeros.
struct Singles<'a, T> {
    x: &'a [T],
    high: T,
    low: T,
    weights: Option<&'a [T]>,
    input: &'a mut [T],
}

impl<T: Real> WithSimd for Singles<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { x, high, low, weights, input } = self;
        let (input, padding) = input.split_at_mut(x.len());
        padding.fill(T::zero());
        if let Some(weights) = weights {
            let weights = &weights[..x.len()];
            for i in 0..x.len() {
                input[i] = (x[i] - high - low) * weights[i];
            }
        } else {
            for i in 0..x.len() {
                input[i] = x[i] - high - low;
            }
        }
    }
}

/// Puts groups of `lanes` first and second numbers into two lists, as far as these go.
struct Flatten<'a, T> {
    groups: &'a [T],
    lanes: usize,
    first: &'a mut [T],
    second: &'a mut [T],
}

impl<T: Real> WithSimd for Flatten<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { groups, lanes, first, second } = self;
        match lanes {
            16 => flatten::<T, 16>(groups, first, second),
            8 => flatten::<T, 8>(groups, first, second),
            4 => flatten::<T, 4>(groups, first, second),
            _ => flatten::<T, 2>(groups, first, second),
        }
    }
}

#[inline(always)]
fn flatten<T: Real, const R: usize>(groups: &[T], first: &mut [T], second: &mut [T]) {
    let (groups, _) = groups.as_chunks::<R>();
    let (first, first_rest) = first.as_chunks_mut::<R>();
    let (second, second_rest) = second.as_chunks_mut::<R>();
    let n = first.len();
    for ((group, first), second) in groups.chunks_exact(2).zip(first).zip(second) {
        (*first, *second) = (group[0], group[1]);
    }
    if let Some([a, b]) = groups.get(2 * n..2 * n + 2) {
        first_rest.copy_from_slice(&a[..first_rest.len()]);
        second_rest.copy_from_slice(&b[..second_rest.len()]);
    }
}

/// Bins of n real samples from the transform Z of their pairs (D51): with Z′ = conj Z reversed,
/// X = (Z + Z′)/2 − j·e^(−jθ)·(Z − Z′)/2.
struct Unfold<'a, T: Real> {
    z: &'a Split<T>,
    turns: &'a Split<T>,
    x_hat: &'a mut Split<T>,
}

/// All bins from Z and [`half_turns`] of all of them.
pub(in crate::dsp) fn unfold<T: Real>(z: &Split<T>, turns: &Split<T>, x_hat: &mut Split<T>) {
    Arch::new().dispatch(Unfold { z, turns, x_hat });
}

impl<T: Real> WithSimd for Unfold<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { z, turns, x_hat } = self;
        let z = (&z.re[..], &z.im[..]);
        let turns = (&turns.re[..], &turns.im[..]);
        unfold_lists((z, z), turns, T::rounded(0.5), &mut x_hat.re, &mut x_hat.im);
    }
}

/// Real and imaginary parts.
type Lists<'a, T> = (&'a [T], &'a [T]);

/// Bins from Z at them, Z mirrored to them and their half turns, times 2·`half` as the turns are. A function of
/// its own, so that the lists are known not to overlap.
#[inline(always)]
pub(in crate::dsp) fn unfold_lists<T: Real>(
    ((a_re, a_im), (b_re, b_im)): (Lists<'_, T>, Lists<'_, T>),
    (cos, sin): Lists<'_, T>,
    half: T,
    re: &mut [T],
    im: &mut [T],
) {
    let n = re.len();
    let (a_re, a_im, b_re, b_im) = (&a_re[..n], &a_im[..n], &b_re[..n], &b_im[..n]);
    let (cos, sin, im) = (&cos[..n], &sin[..n], &mut im[..n]);
    for k in 0..n {
        let (a_re, a_im, b_re, b_im) = (a_re[k], a_im[k], b_re[n - 1 - k], b_im[n - 1 - k]);
        let (sum_im, gap_re) = (a_im + b_im, a_re - b_re);
        re[k] = half * (a_re + b_re) + cos[k] * sum_im - sin[k] * gap_re;
        im[k] = half * (a_im - b_im) - cos[k] * gap_re - sin[k] * sum_im;
    }
}
