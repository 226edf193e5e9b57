//! Vectors of numbers for the inner loops, f32 or f64, as wide as the processor has them.
//!
//! Loops over vectors in registers are written out: a closure or a rolled loop puts them into memory.
//! Must not know transforms.

use std::fmt;
use std::ops::Deref;
use std::ops::DerefMut;

use pulp::Simd;

/// Bytes in a line of the cache, and in the widest vector.
const LINE: usize = 64;

/// A list that begins at a cache line: a vector that crosses a line costs twice.
pub(in crate::dsp) struct Aligned<T> {
    list: Vec<T>,
    first: usize,
}

impl<T: Lanes> Aligned<T> {
    /// Zeros.
    pub(in crate::dsp) fn zeros(n: usize) -> Self {
        let spare = LINE / size_of::<T>();
        let list = vec![T::zeroed(); n + spare];
        // "Cannot be aligned" does not happen to numbers; the list would begin anywhere then.
        let first = list.as_ptr().align_offset(LINE).min(spare);
        Self { list, first }
    }

    /// A copy of `values`.
    pub(in crate::dsp) fn of(values: &[T]) -> Self {
        let mut list = Self::zeros(values.len());
        list[..].copy_from_slice(values);
        list
    }
}

impl<T: Lanes> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        let n = self.list.len() - LINE / size_of::<T>();
        &self.list[self.first..self.first + n]
    }
}

impl<T: Lanes> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        let n = self.list.len() - LINE / size_of::<T>();
        &mut self.list[self.first..self.first + n]
    }
}

impl<T> fmt::Debug for Aligned<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Aligned").field("room", &self.list.len()).finish_non_exhaustive()
    }
}

/// A number that `pulp` has vectors of.
///
/// Products and sums are fused where the processor can: results differ between processors in the last
/// digit, never between runs on one.
pub trait Lanes: Copy + bytemuck::Pod + Send + Sync {
    /// Numbers in the widest vector; every vector width divides it.
    const WIDTH: usize;

    /// Numbers in 128 bits.
    const BLOCK: usize;

    /// A vector.
    type Vector<S: Simd>: bytemuck::Pod;

    /// Repeats `x`.
    fn splat<S: Simd>(simd: S, x: Self) -> Self::Vector<S>;

    /// a + b.
    fn plus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// a − b.
    fn minus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// a·b.
    fn times<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// a·b + c.
    fn times_plus<S: Simd>(
        simd: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;

    /// c − a·b.
    fn less_times<S: Simd>(
        simd: S,
        c: Self::Vector<S>,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
    ) -> Self::Vector<S>;

    /// √a.
    fn root<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;

    /// The smaller of each two.
    fn least<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// The larger of each two.
    fn most<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// The whole vectors of a list.
    fn vectors<S: Simd>(list: &[Self]) -> &[Self::Vector<S>];

    /// The whole vectors of a list.
    fn vectors_mut<S: Simd>(list: &mut [Self]) -> &mut [Self::Vector<S>];

    /// Transposes the 4 × 4 numbers (f32) in every 128 bits of four vectors.
    fn quads<S: Simd>(simd: S, rows: [Self::Vector<S>; 4]) -> [Self::Vector<S>; 4];

    /// Transposes the 2 × 2 numbers (f64) in every 128 bits of two vectors.
    fn pairs<S: Simd>(simd: S, rows: [Self::Vector<S>; 2]) -> [Self::Vector<S>; 2];
}

/// Numbers in a vector.
pub(in crate::dsp) const fn lanes_of<T: Lanes, S: Simd>() -> usize {
    size_of::<T::Vector<S>>() / size_of::<T>()
}

macro_rules! lanes {
    ($number:ty, $width:literal, $block:literal, $vector:ident, $simd_of:ident, $simd_of_mut:ident,
     $splat:ident, $add:ident, $sub:ident, $mul:ident, $mul_add:ident, $negate_mul_add:ident,
     $sqrt:ident, $min:ident, $max:ident, $deinterleave:ident) => {
        impl Lanes for $number {
            const WIDTH: usize = $width;
            const BLOCK: usize = $block;
            type Vector<S: Simd> = S::$vector;

            #[inline(always)]
            fn splat<S: Simd>(simd: S, x: Self) -> S::$vector {
                simd.$splat(x)
            }

            #[inline(always)]
            fn plus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$add(a, b)
            }

            #[inline(always)]
            fn minus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$sub(a, b)
            }

            #[inline(always)]
            fn times<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$mul(a, b)
            }

            #[inline(always)]
            fn times_plus<S: Simd>(
                simd: S,
                a: S::$vector,
                b: S::$vector,
                c: S::$vector,
            ) -> S::$vector {
                simd.$mul_add(a, b, c)
            }

            #[inline(always)]
            fn less_times<S: Simd>(
                simd: S,
                c: S::$vector,
                a: S::$vector,
                b: S::$vector,
            ) -> S::$vector {
                simd.$negate_mul_add(a, b, c)
            }

            #[inline(always)]
            fn root<S: Simd>(simd: S, a: S::$vector) -> S::$vector {
                simd.$sqrt(a)
            }

            #[inline(always)]
            fn least<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$min(a, b)
            }

            #[inline(always)]
            fn most<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$max(a, b)
            }

            #[inline(always)]
            fn vectors<S: Simd>(list: &[Self]) -> &[S::$vector] {
                S::$simd_of(list).0
            }

            #[inline(always)]
            fn vectors_mut<S: Simd>(list: &mut [Self]) -> &mut [S::$vector] {
                S::$simd_of_mut(list).0
            }

            #[inline(always)]
            fn quads<S: Simd>(simd: S, rows: [S::$vector; 4]) -> [S::$vector; 4] {
                simd.$deinterleave(rows)
            }

            #[inline(always)]
            fn pairs<S: Simd>(simd: S, rows: [S::$vector; 2]) -> [S::$vector; 2] {
                simd.$deinterleave(rows)
            }
        }
    };
}

lanes!(
    f32,
    16,
    4,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    mul_add_e_f32s,
    negate_mul_add_e_f32s,
    sqrt_f32s,
    min_f32s,
    max_f32s,
    deinterleave_shfl_f32s
);
lanes!(
    f64,
    8,
    2,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    mul_add_e_f64s,
    negate_mul_add_e_f64s,
    sqrt_f64s,
    min_f64s,
    max_f64s,
    deinterleave_shfl_f64s
);
