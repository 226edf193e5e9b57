//! Complex numbers as a list of real and a list of imaginary parts, and loops over them.
//!
//! The loops are plain; `pulp` has them compiled for the widest vectors of the processor. Must not
//! know what the numbers are.

use pulp::Arch;
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
        let Self { arch, re, im } = self;
        arch.dispatch(
            #[inline(always)]
            || {
                for ((re, im), x) in re.iter_mut().zip(im.iter_mut()).zip(list) {
                    (*re, *im) = (x.re, x.im);
                }
            },
        );
    }

    /// Writes the list out.
    pub(in crate::dsp) fn copy_to(&self, list: &mut [Complex<T>]) {
        let Self { arch, re, im } = self;
        arch.dispatch(
            #[inline(always)]
            || {
                for ((x, re), im) in list.iter_mut().zip(re.iter()).zip(im.iter()) {
                    *x = Complex::new(*re, *im);
                }
            },
        );
    }

    /// Writes `factor` times the moduli.
    pub(in crate::dsp) fn moduli(&self, factor: T, moduli: &mut [T]) {
        let Self { arch, re, im } = self;
        arch.dispatch(
            #[inline(always)]
            || {
                for ((x, re), im) in moduli.iter_mut().zip(re.iter()).zip(im.iter()) {
                    *x = (*re * *re + *im * *im).square_root() * factor;
                }
            },
        );
    }
}
