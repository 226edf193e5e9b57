//! Complex numbers as a list of real and a list of imaginary parts, and loops over them.
//!
//! The loops are plain; `pulp` has them compiled for the widest vectors of the processor. Must not
//! know what the numbers are.

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::num_complex::Complex;

use crate::dsp::lanes::Aligned;
use crate::dsp::real::Real;

/// A list of complex numbers.
#[derive(Debug)]
pub(in crate::dsp) struct Split<T: Real> {
    arch: Arch,
    pub(in crate::dsp) re: Aligned<T>,
    pub(in crate::dsp) im: Aligned<T>,
}

impl<T: Real> Split<T> {
    /// `n` zeros.
    pub(in crate::dsp) fn zeros(n: usize) -> Self {
        Self { arch: Arch::new(), re: Aligned::zeros(n), im: Aligned::zeros(n) }
    }

    /// Takes a list in.
    pub(in crate::dsp) fn fill(&mut self, list: &[Complex<T>]) {
        self.arch.dispatch(Fill { list, re: &mut self.re, im: &mut self.im });
    }

    /// Writes the list out.
    pub(in crate::dsp) fn copy_to(&self, list: &mut [Complex<T>]) {
        self.arch.dispatch(Copy { re: &self.re, im: &self.im, list });
    }

    /// Writes `factor` times the moduli.
    pub(in crate::dsp) fn moduli(&self, factor: T, moduli: &mut [T]) {
        self.arch.dispatch(Moduli { re: &self.re, im: &self.im, factor, moduli });
    }
}

struct Fill<'a, T> {
    list: &'a [Complex<T>],
    re: &'a mut [T],
    im: &'a mut [T],
}

impl<T: Real> WithSimd for Fill<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.list.len();
        let (re, im) = (&mut self.re[..n], &mut self.im[..n]);
        for i in 0..n {
            (re[i], im[i]) = (self.list[i].re, self.list[i].im);
        }
    }
}

struct Copy<'a, T> {
    re: &'a [T],
    im: &'a [T],
    list: &'a mut [Complex<T>],
}

impl<T: Real> WithSimd for Copy<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.list.len();
        let (re, im) = (&self.re[..n], &self.im[..n]);
        for i in 0..n {
            self.list[i] = Complex::new(re[i], im[i]);
        }
    }
}

struct Moduli<'a, T> {
    re: &'a [T],
    im: &'a [T],
    factor: T,
    moduli: &'a mut [T],
}

impl<T: Real> WithSimd for Moduli<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.moduli.len();
        let (re, im) = (&self.re[..n], &self.im[..n]);
        for i in 0..n {
            self.moduli[i] = (re[i] * re[i] + im[i] * im[i]).square_root() * self.factor;
        }
    }
}
