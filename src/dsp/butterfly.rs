//! Discrete Fourier transforms of a few points, many side by side in the lanes of vectors.
//!
//! Sign + (inverse), not normalised: `b_i = Σ_k a_k·e^(j2πik/R)`. With real and imaginary parts
//! exchanged on both sides the same code is the forward transform. Must not know where the points
//! come from.

use std::f64::consts::FRAC_1_SQRT_2;

use pulp::Simd;

use crate::dsp::lanes::Lanes;
use crate::dsp::lanes::lanes_of;
use crate::dsp::real::Real;

/// A vector of complex numbers.
#[derive(Debug)]
pub(in crate::dsp) struct Numbers<T: Lanes, S: Simd> {
    pub(in crate::dsp) re: T::Vector<S>,
    pub(in crate::dsp) im: T::Vector<S>,
}

impl<T: Lanes, S: Simd> Clone for Numbers<T, S> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: Lanes, S: Simd> Copy for Numbers<T, S> {}

impl<T: Real, S: Simd> Numbers<T, S> {
    /// The first vectors of two lists.
    #[inline(always)]
    pub(in crate::dsp) fn load(re: &[T], im: &[T]) -> Self {
        let lanes = lanes_of::<T, S>();
        Self { re: T::vectors::<S>(&re[..lanes])[0], im: T::vectors::<S>(&im[..lanes])[0] }
    }

    #[inline(always)]
    pub(in crate::dsp) fn of([re, im]: Pair<T, S>) -> Self {
        Self { re, im }
    }

    #[inline(always)]
    pub(in crate::dsp) fn pair(self) -> Pair<T, S> {
        [self.re, self.im]
    }

    #[inline(always)]
    fn plus(self, simd: S, other: Self) -> Self {
        Self { re: T::plus(simd, self.re, other.re), im: T::plus(simd, self.im, other.im) }
    }

    #[inline(always)]
    fn minus(self, simd: S, other: Self) -> Self {
        Self { re: T::minus(simd, self.re, other.re), im: T::minus(simd, self.im, other.im) }
    }

    /// self + j·other.
    #[inline(always)]
    fn plus_turned(self, simd: S, other: Self) -> Self {
        Self { re: T::minus(simd, self.re, other.im), im: T::plus(simd, self.im, other.re) }
    }

    /// self − j·other.
    #[inline(always)]
    fn minus_turned(self, simd: S, other: Self) -> Self {
        Self { re: T::plus(simd, self.re, other.im), im: T::minus(simd, self.im, other.re) }
    }

    /// self·(re + j·im).
    #[inline(always)]
    pub(in crate::dsp) fn times(self, simd: S, re: T::Vector<S>, im: T::Vector<S>) -> Self {
        let (a, b) = (T::times(simd, self.re, re), T::times(simd, self.im, re));
        Self { re: T::less_times(simd, a, self.im, im), im: T::times_plus(simd, self.re, im, b) }
    }

    #[inline(always)]
    pub(in crate::dsp) fn times_number(self, simd: S, re: T, im: T) -> Self {
        self.times(simd, T::splat(simd, re), T::splat(simd, im))
    }

    /// self·factor, real.
    #[inline(always)]
    fn scaled(self, simd: S, factor: f64) -> Self {
        let factor = T::splat(simd, T::rounded(factor));
        Self { re: T::times(simd, self.re, factor), im: T::times(simd, self.im, factor) }
    }

    /// e^(jπ/4)·self.
    #[inline(always)]
    fn turned_eighth(self, simd: S) -> Self {
        self.plus_turned(simd, self).scaled(simd, FRAC_1_SQRT_2)
    }

    /// e^(j3π/4)·self.
    #[inline(always)]
    fn turned_three_eighths(self, simd: S) -> Self {
        let sum = self.plus_turned(simd, self);
        let plus = T::splat(simd, T::rounded(FRAC_1_SQRT_2));
        let minus = T::splat(simd, T::rounded(-FRAC_1_SQRT_2));
        Self { re: T::times(simd, sum.im, minus), im: T::times(simd, sum.re, plus) }
    }

    /// j·self.
    #[inline(always)]
    fn turned_quarter(self, simd: S) -> Self {
        Self { re: T::minus(simd, T::splat(simd, T::zero()), self.im), im: self.re }
    }

    /// self·(re + j·im), constants.
    #[inline(always)]
    fn turned_by(self, simd: S, re: f64, im: f64) -> Self {
        self.times_number(simd, T::rounded(re), T::rounded(im))
    }

    /// self + factor·j·other, factor real.
    #[inline(always)]
    fn plus_turned_scaled(self, simd: S, factor: f64, other: Self) -> Self {
        let plus = T::splat(simd, T::rounded(factor));
        let minus = T::splat(simd, T::rounded(-factor));
        Self {
            re: T::times_plus(simd, other.im, minus, self.re),
            im: T::times_plus(simd, other.re, plus, self.im),
        }
    }

    /// self + factor·other, real.
    #[inline(always)]
    fn plus_scaled(self, simd: S, factor: f64, other: Self) -> Self {
        let factor = T::splat(simd, T::rounded(factor));
        Self {
            re: T::times_plus(simd, other.re, factor, self.re),
            im: T::times_plus(simd, other.im, factor, self.im),
        }
    }
}

/// Number of points R with a transform below.
pub(in crate::dsp) trait Transform<T: Real, S: Simd>: Sized {
    /// The transform.
    fn transformed(self, simd: S) -> Self;
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 2] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        let [a, b] = self;
        [a.plus(simd, b), a.minus(simd, b)]
    }
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 3] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        const SIN: f64 = 0.866_025_403_784_438_6;
        let [a, b, c] = self;
        let sum = b.plus(simd, c);
        let turned = b.minus(simd, c).scaled(simd, SIN);
        let middle = a.plus_scaled(simd, -0.5, sum);
        [a.plus(simd, sum), middle.plus_turned(simd, turned), middle.minus_turned(simd, turned)]
    }
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 4] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        let [a, b, c, d] = self;
        let (even, odd) = (a.plus(simd, c), b.plus(simd, d));
        let (even_gap, odd_gap) = (a.minus(simd, c), b.minus(simd, d));
        [
            even.plus(simd, odd),
            even_gap.plus_turned(simd, odd_gap),
            even.minus(simd, odd),
            even_gap.minus_turned(simd, odd_gap),
        ]
    }
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 5] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        // cos and sin of 2π/5 and 4π/5.
        const COS: [f64; 2] = [0.309_016_994_374_947_45, -0.809_016_994_374_947_5];
        const SIN: [f64; 2] = [0.951_056_516_295_153_5, 0.587_785_252_292_473_1];
        let [a, b, c, d, e] = self;
        let (sum1, gap1) = (b.plus(simd, e), b.minus(simd, e));
        let (sum2, gap2) = (c.plus(simd, d), c.minus(simd, d));
        let middle1 = a.plus_scaled(simd, COS[0], sum1).plus_scaled(simd, COS[1], sum2);
        let middle2 = a.plus_scaled(simd, COS[1], sum1).plus_scaled(simd, COS[0], sum2);
        let turned1 = gap1.scaled(simd, SIN[0]).plus_scaled(simd, SIN[1], gap2);
        let turned2 = gap1.scaled(simd, SIN[1]).plus_scaled(simd, -SIN[0], gap2);
        [
            a.plus(simd, sum1).plus(simd, sum2),
            middle1.plus_turned(simd, turned1),
            middle2.plus_turned(simd, turned2),
            middle2.minus_turned(simd, turned2),
            middle1.minus_turned(simd, turned1),
        ]
    }
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 8] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        let [a0, a1, a2, a3, a4, a5, a6, a7] = self;
        let [e0, e1, e2, e3] = [a0, a2, a4, a6].transformed(simd);
        let [o0, o1, o2, o3] = [a1, a3, a5, a7].transformed(simd);
        // e^(jπ/4)·o = (o + j·o)/√2, e^(j3π/4)·o = j·(o + j·o)/√2.
        let o1 = o1.plus_turned(simd, o1);
        let o3 = o3.plus_turned(simd, o3);
        let h = FRAC_1_SQRT_2;
        let (b1, b5) = (e1.plus_scaled(simd, h, o1), e1.plus_scaled(simd, -h, o1));
        let (b3, b7) = (e3.plus_turned_scaled(simd, h, o3), e3.plus_turned_scaled(simd, -h, o3));
        [
            e0.plus(simd, o0),
            b1,
            e2.plus_turned(simd, o2),
            b3,
            e0.minus(simd, o0),
            b5,
            e2.minus_turned(simd, o2),
            b7,
        ]
    }
}

impl<T: Real, S: Simd> Transform<T, S> for [Numbers<T, S>; 16] {
    #[inline(always)]
    fn transformed(self, simd: S) -> Self {
        // cos and sin of π/8.
        const COS: f64 = 0.923_879_532_511_286_7;
        const SIN: f64 = 0.382_683_432_365_089_8;
        let a = self;
        let r0 = [a[0], a[4], a[8], a[12]].transformed(simd);
        let r1 = [a[1], a[5], a[9], a[13]].transformed(simd);
        let r2 = [a[2], a[6], a[10], a[14]].transformed(simd);
        let r3 = [a[3], a[7], a[11], a[15]].transformed(simd);
        let c0 = [r0[0], r1[0], r2[0], r3[0]].transformed(simd);
        let c1 = [
            r0[1],
            r1[1].turned_by(simd, COS, SIN),
            r2[1].turned_eighth(simd),
            r3[1].turned_by(simd, SIN, COS),
        ]
        .transformed(simd);
        let c2 = [
            r0[2],
            r1[2].turned_eighth(simd),
            r2[2].turned_quarter(simd),
            r3[2].turned_three_eighths(simd),
        ]
        .transformed(simd);
        let c3 = [
            r0[3],
            r1[3].turned_by(simd, SIN, COS),
            r2[3].turned_three_eighths(simd),
            r3[3].turned_by(simd, -COS, -SIN),
        ]
        .transformed(simd);
        [
            c0[0], c1[0], c2[0], c3[0], c0[1], c1[1], c2[1], c3[1], c0[2], c1[2], c2[2], c3[2],
            c0[3], c1[3], c2[3], c3[3],
        ]
    }
}

/// A real and an imaginary vector in memory.
pub(in crate::dsp) type Pair<T, S> = [<T as Lanes>::Vector<S>; 2];

/// R points between pairs in memory and registers.
pub(in crate::dsp) trait Points<T: Real, S: Simd>: Transform<T, S> {
    /// Point i is pair `at` of list i.
    fn of_pairs(lists: &[&[Pair<T, S>]], at: usize) -> Self;

    /// All but the first times their factors, cosine and sine; as they are without factors.
    fn turned(self, simd: S, factors: &[T]) -> Self;

    /// Point i becomes pair `at` of list i.
    fn put_pairs(self, lists: &mut [&mut [Pair<T, S>]], at: usize);

    /// Point i becomes pair i.
    fn put_row(self, row: &mut [Pair<T, S>]);
}

/// As many points as there are lanes, between lists and registers.
pub(in crate::dsp) trait Square<T: Real, S: Simd>: Transform<T, S> {
    /// Point i is the vector at `i·stride + at` of two lists.
    fn of_rows(re: &[T], im: &[T], stride: usize, at: usize) -> Self;

    /// All but the first times their vectors of factors.
    fn turned_by_rows(self, simd: S, factors: &[Pair<T, S>]) -> Self;

    /// Point i becomes vector i of two lists, 128 by 128 bits transposed ([`Lanes::quads`],
    /// [`Lanes::pairs`]).
    fn put_blocks(self, simd: S, re: &mut [T::Vector<S>], im: &mut [T::Vector<S>]);
}

macro_rules! points {
    ($points:literal: $first:literal $($i:literal)*) => {
        impl<T: Real, S: Simd> Points<T, S> for [Numbers<T, S>; $points] {
            #[inline(always)]
            fn of_pairs(lists: &[&[Pair<T, S>]], at: usize) -> Self {
                [Numbers::of(lists[$first][at]), $(Numbers::of(lists[$i][at])),*]
            }

            #[inline(always)]
            fn turned(self, simd: S, factors: &[T]) -> Self {
                match factors.get(..2 * $points - 2) {
                    Some(f) => [
                        self[0],
                        $(self[$i].times_number(simd, f[2 * $i - 2], f[2 * $i - 1])),*
                    ],
                    None => self,
                }
            }

            #[inline(always)]
            fn put_pairs(self, lists: &mut [&mut [Pair<T, S>]], at: usize) {
                lists[$first][at] = self[$first].pair();
                $(lists[$i][at] = self[$i].pair();)*
            }

            #[inline(always)]
            fn put_row(self, row: &mut [Pair<T, S>]) {
                let row = &mut row[..$points];
                row[$first] = self[$first].pair();
                $(row[$i] = self[$i].pair();)*
            }
        }
    };
}

macro_rules! square {
    ($points:literal: $first:literal $($i:literal)*;
     $([$a:literal $b:literal $c:literal $d:literal])*; $([$e:literal $f:literal])*) => {
        impl<T: Real, S: Simd> Square<T, S> for [Numbers<T, S>; $points] {
            #[inline(always)]
            fn of_rows(re: &[T], im: &[T], stride: usize, at: usize) -> Self {
                [
                    Numbers::load(&re[at..], &im[at..]),
                    $(Numbers::load(&re[$i * stride + at..], &im[$i * stride + at..])),*
                ]
            }

            #[inline(always)]
            fn turned_by_rows(self, simd: S, factors: &[Pair<T, S>]) -> Self {
                let f = &factors[..$points];
                [self[$first], $(self[$i].times(simd, f[$i][0], f[$i][1])),*]
            }

            #[inline(always)]
            fn put_blocks(self, simd: S, re: &mut [T::Vector<S>], im: &mut [T::Vector<S>]) {
                let (re, im) = (&mut re[..$points], &mut im[..$points]);
                if T::BLOCK == 4 {
                    $(
                        let quad = T::quads(
                            simd, [self[$a].re, self[$b].re, self[$c].re, self[$d].re]);
                        re[$a..$d + 1].copy_from_slice(&quad);
                        let quad = T::quads(
                            simd, [self[$a].im, self[$b].im, self[$c].im, self[$d].im]);
                        im[$a..$d + 1].copy_from_slice(&quad);
                    )*
                } else {
                    $(
                        let pair = T::pairs(simd, [self[$e].re, self[$f].re]);
                        re[$e..$f + 1].copy_from_slice(&pair);
                        let pair = T::pairs(simd, [self[$e].im, self[$f].im]);
                        im[$e..$f + 1].copy_from_slice(&pair);
                    )*
                }
            }
        }
    };
}

points!(2: 0 1);
points!(3: 0 1 2);
points!(4: 0 1 2 3);
points!(5: 0 1 2 3 4);
points!(8: 0 1 2 3 4 5 6 7);
points!(16: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);

// Blocks of two points hold two numbers of 64 bits only.
square!(2: 0 1; ; [0 1]);
square!(4: 0 1 2 3; [0 1 2 3]; [0 1] [2 3]);
square!(8: 0 1 2 3 4 5 6 7; [0 1 2 3] [4 5 6 7]; [0 1] [2 3] [4 5] [6 7]);
square!(16: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15;
    [0 1 2 3] [4 5 6 7] [8 9 10 11] [12 13 14 15];
    [0 1] [2 3] [4 5] [6 7] [8 9] [10 11] [12 13] [14 15]);
