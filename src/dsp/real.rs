//! The number a kernel works in: `f32` or `f64`, nothing else.
//!
//! The trait is sealed so that a kernel's accuracy needs to be shown for two types only. Must not
//! know any kernel.

use std::ops::{AddAssign, MulAssign, SubAssign};

use rustfft::FftNum;

use crate::dsp::lanes::Lanes;

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A floating-point number of the numeric core.
///
/// Sums, gains, phases and time are f64 in every kernel; `Self` is what samples and spectra are
/// stored in.
pub trait Real:
    sealed::Sealed + Lanes + FftNum + Default + PartialOrd + AddAssign + SubAssign + MulAssign
{
    /// Distance from 1 to the next number.
    const EPSILON: f64;
    /// 0, for constants.
    const ZERO: Self;

    /// Rounds to the nearest representable number (the identity for f64).
    fn rounded(x: f64) -> Self;

    /// Widens exactly.
    fn to_f64(self) -> f64;

    /// Takes the square root in this precision.
    fn square_root(self) -> Self;

    /// Takes the natural logarithm in this precision.
    fn natural_log(self) -> Self;
}

impl Real for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;
    const ZERO: Self = 0.0;

    fn rounded(x: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
        let rounded = x as f32;
        rounded
    }

    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    fn square_root(self) -> Self {
        self.sqrt()
    }

    fn natural_log(self) -> Self {
        self.ln()
    }
}

impl Real for f64 {
    const EPSILON: f64 = f64::EPSILON;
    const ZERO: Self = 0.0;

    fn rounded(x: f64) -> Self {
        x
    }

    fn to_f64(self) -> f64 {
        self
    }

    fn square_root(self) -> Self {
        self.sqrt()
    }

    fn natural_log(self) -> Self {
        self.ln()
    }
}

/// Rounds a non-negative position down to an index; negative and NaN give 0, too large saturates.
pub(crate) fn floor_index(position: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, which is the stated behaviour"
    )]
    let index = position.floor() as usize;
    index
}

/// The integer nearest below x·2^`bits`: exact while x has no finer bits; negative and NaN give 0.
pub(in crate::dsp) fn scaled_to_u128(x: f64, bits: i32) -> u128 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, which is the stated behaviour"
    )]
    let scaled = (x * 2f64.powi(bits)) as u128;
    scaled
}

/// Rounds a non-negative position up to an index; negative and NaN give 0, too large saturates.
#[must_use]
pub fn ceil_index(position: f64) -> usize {
    floor_index(position.ceil())
}
