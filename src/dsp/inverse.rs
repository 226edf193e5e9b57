//! Inverse complex transform of any length, and what is made of its results.
//!
//! Lengths with a grid go through [`crate::dsp::grid`], others and processors without vectors through
//! `rustfft`. Must not know what is transformed.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::Fft;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft::FftCache;
use crate::dsp::grid::Grid;
use crate::dsp::grid::GridPlan;
use crate::dsp::lanes::lanes_of;
use crate::dsp::power_sums;
use crate::dsp::power_sums::PowerSums;
use crate::dsp::real::Real;

/// Tables of an inverse transform; the buffers are the caller's ([`Workspace`]).
#[derive(Clone)]
pub(in crate::dsp) enum Inverse<T: Real> {
    Grid(Arc<GridPlan<T>>),
    Library(Arc<dyn Fft<T>>),
}

/// Buffers of an inverse transform, for the longest of those that share them.
#[derive(Debug)]
pub(in crate::dsp) struct Workspace<T: Real> {
    pub(in crate::dsp) grid: Grid<T>,
    /// Points and scratch of transforms by the library.
    points: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> Workspace<T> {
    /// Room for each of `inverses`.
    pub(in crate::dsp) fn new<'a>(inverses: impl Iterator<Item = &'a Inverse<T>>) -> Self {
        let (mut length, mut n_points, mut n_scratch) = (0, 0, 0);
        for inverse in inverses {
            length = length.max(inverse.len());
            if let Inverse::Library(plan) = inverse {
                n_points = n_points.max(plan.len());
                n_scratch = n_scratch.max(plan.get_inplace_scratch_len());
            }
        }
        Self {
            grid: Grid::new(length),
            points: vec![Complex::zero(); n_points],
            scratch: vec![Complex::zero(); n_scratch],
        }
    }
}

impl<T: Real> Inverse<T> {
    /// Plans `length` points.
    pub(in crate::dsp) fn new(length: usize, cache: &mut FftCache<T>) -> Self {
        match cache.grid(length) {
            Some(plan) => Self::Grid(plan),
            None => Self::Library(cache.complex_inverse(length)),
        }
    }

    /// Points.
    pub(in crate::dsp) fn len(&self) -> usize {
        match self {
            Self::Grid(plan) => plan.len(),
            Self::Library(plan) => plan.len(),
        }
    }

    /// Transforms the points in the workspace's grid (sign +, not normalised).
    pub(in crate::dsp) fn run<'a>(&self, workspace: &'a mut Workspace<T>) -> Results<'a, T> {
        match self {
            Self::Grid(plan) => {
                let lanes = plan.lanes();
                Results { list: plan.inverse(&mut workspace.grid), lanes }
            }
            Self::Library(plan) => {
                let Workspace { grid, points, scratch } = workspace;
                let points = &mut points[..plan.len()];
                for ((x, re), im) in points.iter_mut().zip(grid.re.iter()).zip(grid.im.iter()) {
                    *x = Complex::new(*re, *im);
                }
                plan.process_with_scratch(points, scratch);
                let list = grid.singles(plan.len());
                for (pair, x) in list.chunks_exact_mut(2).zip(points) {
                    pair.copy_from_slice(&[x.re, x.im]);
                }
                Results { list, lanes: 1 }
            }
        }
    }
}

impl<T: Real> fmt::Debug for Inverse<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inverse").field("len", &self.len()).finish_non_exhaustive()
    }
}

/// Results of a transform: so many real parts, as many imaginary parts, and again.
#[derive(Debug)]
pub(in crate::dsp) struct Results<'a, T: Real> {
    list: &'a [T],
    lanes: usize,
}

impl<T: Real> Results<'_, T> {
    /// Writes the first results.
    pub(in crate::dsp) fn copy_to(&self, out: &mut [Complex<T>]) {
        self.map_to(out, Complex::new);
    }

    /// Writes what `f` makes of real and imaginary part, for as many results as fit.
    pub(in crate::dsp) fn map_to<U>(&self, out: &mut [U], f: impl Fn(T, T) -> U) {
        Arch::new().dispatch(Map { list: self.list, lanes: self.lanes, out, f });
    }

    /// Writes all results, real and imaginary parts apart, and sums their powers.
    pub(in crate::dsp) fn split_to(&self, re: &mut [T], im: &mut [T]) -> PowerSums {
        power_sums::of_groups(self.list, self.lanes, [re, im])
    }

    /// Writes (|z|² − offset)·weight, for as many results as fit; the sum of |z|² − offset.
    pub(in crate::dsp) fn squares_to(&self, offset: T, weights: &[T], out: &mut [T]) -> f64 {
        let (list, lanes) = (self.list, self.lanes);
        Arch::new().dispatch(Squares { list, lanes, offset, weights, out })
    }

    /// Sums the moduli of the results `range`, in f64.
    pub(in crate::dsp) fn sum_of_moduli(&self, range: Range<usize>) -> f64 {
        let groups = self.list.chunks_exact(2 * self.lanes);
        let pairs = groups.flat_map(|group| {
            let (re, im) = group.split_at(self.lanes);
            re.iter().zip(im)
        });
        let moduli = pairs.skip(range.start).take(range.len());
        moduli.map(|(re, im)| (*re * *re + *im * *im).square_root().to_f64()).sum()
    }
}

struct Map<'a, T, U, F> {
    list: &'a [T],
    lanes: usize,
    out: &'a mut [U],
    f: F,
}

impl<T: Real, U, F: Fn(T, T) -> U> WithSimd for Map<'_, T, U, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { list, lanes, out, f } = self;
        match lanes {
            16 => map::<T, U, 16>(list, out, f),
            8 => map::<T, U, 8>(list, out, f),
            4 => map::<T, U, 4>(list, out, f),
            2 => map::<T, U, 2>(list, out, f),
            _ => map::<T, U, 1>(list, out, f),
        }
    }
}

#[inline(always)]
fn map<T: Real, U, const R: usize>(list: &[T], out: &mut [U], f: impl Fn(T, T) -> U) {
    let whole = out.len() / R * R;
    let (first, rest) = out.split_at_mut(whole);
    let (groups, _) = list.as_chunks::<R>();
    let (outs, _) = first.as_chunks_mut::<R>();
    for (group, out) in groups.chunks_exact(2).zip(outs) {
        let (re, im) = (&group[0], &group[1]);
        for i in 0..R {
            out[i] = f(re[i], im[i]);
        }
    }
    if let Some([re, im]) = groups.get(2 * (whole / R)..2 * (whole / R) + 2) {
        for (i, out) in rest.iter_mut().enumerate() {
            *out = f(re[i], im[i]);
        }
    }
}

/// Vectors summed in `T` before the sum goes on in f64.
const BLOCK: usize = 32;

struct Squares<'a, T> {
    list: &'a [T],
    lanes: usize,
    offset: T,
    weights: &'a [T],
    out: &'a mut [T],
}

impl<T: Real> WithSimd for Squares<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { list, lanes, offset, weights, out } = self;
        let n = out.len();
        let weights = &weights[..n];
        let whole = if lanes == lanes_of::<T, S>() { n / lanes * lanes } else { 0 };
        let (pairs, _) = T::vectors::<S>(&list[..2 * whole]).as_chunks::<2>();
        let factors = T::vectors::<S>(&weights[..whole]);
        let mut total = 0.0;
        {
            let out = T::vectors_mut::<S>(&mut out[..whole]);
            let offset = T::splat(simd, offset);
            let blocks = pairs.chunks(BLOCK).zip(factors.chunks(BLOCK)).zip(out.chunks_mut(BLOCK));
            for ((pairs, factors), out) in blocks {
                let mut sum = T::splat(simd, T::zero());
                for (([re, im], factor), out) in pairs.iter().zip(factors).zip(out) {
                    let square = T::times_plus(simd, *re, *re, T::times(simd, *im, *im));
                    let value = T::minus(simd, square, offset);
                    sum = T::plus(simd, sum, value);
                    *out = T::times(simd, value, *factor);
                }
                total += power_sums::sum_of_lanes::<T, S>(sum);
            }
        }
        // The last, and all of another width of vectors.
        for i in whole..n {
            let at = i / lanes * 2 * lanes + i % lanes;
            let (re, im) = (list[at], list[at + lanes]);
            let value = re * re + im * im - offset;
            total += value.to_f64();
            out[i] = value * weights[i];
        }
        total
    }
}
