//! Raw numbers to samples: once, in loops the compiler can vectorise.
//!
//! physical = (raw·scale + offset)·factor, of which the constant [`Conversion::offset`] is left
//! out of the samples: for float32 and int16 it is the attribute's offset, for float64 and int32
//! the value of the first finite sample, so that a small vibration on a large constant keeps its
//! resolution in f32.

use super::received::{NumberType, RawSamples};

/// The affine map from raw elements to samples of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Conversion {
    /// Sample per raw unit.
    gain: f64,
    /// Raw value that becomes sample 0.
    pub(super) raw_zero: f64,
    /// physical = sample + offset, in the channel's canonical unit.
    pub(super) offset: f64,
}

impl Conversion {
    /// Builds the map; `first` holds the channel's first elements (for float64 and int32).
    ///
    /// `None` if scale, offset and factor together leave the range of f32.
    pub(super) fn new(
        kind: NumberType,
        scale: f64,
        offset: f64,
        factor: f64,
        first: Option<&RawSamples>,
    ) -> Option<Self> {
        let gain = scale * factor;
        let raw_zero = match kind {
            NumberType::F32 | NumberType::I16 => 0.0,
            NumberType::F64 | NumberType::I32 => {
                // A wild first sample (damage, a spike) must not push the others out of f32.
                let found = first.and_then(RawSamples::first_finite).unwrap_or(0.0);
                if found.abs() < 1e12 { found } else { 0.0 }
            }
        };
        let kept_out = (raw_zero * scale + offset) * factor;
        let in_range = |x: f64| x.is_finite() && x.abs() < f64::from(f32::MAX);
        let usable =
            in_range(gain) && in_range(kept_out) && gain.abs() > f64::from(f32::MIN_POSITIVE);
        usable.then_some(Self { gain, raw_zero, offset: kept_out })
    }

    /// The samples that the extremes of the number range become, lowest first.
    ///
    /// `ends`: the two extremes as raw elements; `None` where the range has no end (floats).
    pub(super) fn full_scale(self, ends: Option<RawSamples>) -> Option<(f32, f32)> {
        let samples = self.samples(ends?);
        let (low, high) = (*samples.first()?, *samples.last()?);
        Some(if low <= high { (low, high) } else { (high, low) })
    }

    /// Converts; a float32 channel in its canonical unit is passed on as it is.
    #[expect(clippy::cast_possible_truncation, reason = "f64 to f32 rounds, which is meant")]
    pub(super) fn samples(self, raw: RawSamples) -> Vec<f32> {
        let gain_f32 = self.gain as f32;
        match raw {
            RawSamples::F32(mut samples) => {
                #[expect(clippy::float_cmp, reason = "exactly 1 means nothing to do")]
                let changes = gain_f32 != 1.0;
                if changes {
                    for sample in &mut samples {
                        *sample *= gain_f32;
                    }
                }
                samples
            }
            RawSamples::I16(raw) => raw.iter().map(|&x| f32::from(x) * gain_f32).collect(),
            RawSamples::F64(raw) => {
                raw.iter().map(|&x| ((x - self.raw_zero) * self.gain) as f32).collect()
            }
            RawSamples::I32(raw) => {
                raw.iter().map(|&x| ((f64::from(x) - self.raw_zero) * self.gain) as f32).collect()
            }
        }
    }
}

/// Tells whether all samples are finite; branch-free, so that it vectorises.
pub(super) fn all_finite(samples: &[f32]) -> bool {
    // Adding one unit of exponent to an all-ones exponent carries into the sign bit.
    let carried = samples.iter().fold(0_u32, |seen, sample| {
        seen | ((sample.to_bits() & 0x7f80_0000).wrapping_add(0x0080_0000))
    });
    carried & 0x8000_0000 == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_small_vibration_on_a_large_constant_survives() {
        // 1 µV steps on 10 V: f32 alone resolves 1 µV · 0.95 there, this must be exact to 1e-6 of it.
        let raw: Vec<f64> = (0..100).map(|k| 10.0 + 1e-6 * f64::from(k)).collect();
        let map =
            Conversion::new(NumberType::F64, 1.0, 0.0, 1.0, Some(&RawSamples::F64(raw.clone())))
                .unwrap();
        assert!((map.offset - 10.0).abs() < 1e-15);
        for (k, sample) in map.samples(RawSamples::F64(raw)).iter().enumerate() {
            let expected = 1e-6 * k as f64;
            // Rounding of 10 + x in f64 is 1.8e-15; of the f32 sample 6e-8 relative.
            assert!((f64::from(*sample) - expected).abs() < 2e-15 + 6e-8 * expected, "{k}");
        }
    }

    #[test]
    fn integer_extremes_are_where_the_samples_say() {
        let map = Conversion::new(NumberType::I16, -0.5, 3.0, 2.0, None).unwrap();
        assert_eq!(map.full_scale(NumberType::I16.ends()), Some((-32767.0, 32768.0)));
        assert!((map.offset - 6.0).abs() < 1e-15);
        assert_eq!(
            map.samples(RawSamples::I16(vec![i16::MIN, 1, i16::MAX])),
            [32768.0, -1.0, -32767.0]
        );
        assert_eq!(map.full_scale(NumberType::F32.ends()), None);
    }

    #[test]
    fn maps_that_leave_f32_are_refused() {
        for (scale, offset) in [(0.0, 0.0), (1e60, 0.0), (f64::NAN, 0.0), (1.0, f64::INFINITY)] {
            assert_eq!(Conversion::new(NumberType::F32, scale, offset, 1.0, None), None);
        }
    }

    proptest! {
        #[test]
        fn finiteness_agrees_with_the_slow_way(bits in prop::collection::vec(any::<u32>(), 0..40)) {
            let samples: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            prop_assert_eq!(all_finite(&samples), samples.iter().all(|x| x.is_finite()));
        }

        #[test]
        fn the_affine_map_is_the_written_one(raw in any::<i32>(), first in any::<i32>(), scale in 1e-9..1e3_f64, offset in -1e3..1e3_f64) {
            let map = Conversion::new(NumberType::I32, scale, offset, 9.8, Some(&RawSamples::I32(vec![first]))).unwrap();
            let sample = map.samples(RawSamples::I32(vec![raw]))[0];
            let expected = (f64::from(raw) * scale + offset) * 9.8;
            // One f32 rounding of the difference, and f64 rounding of the products.
            let scatter = 6e-8 * f64::from(sample).abs() + 1e-12 * (expected.abs() + map.offset.abs());
            prop_assert!((f64::from(sample) + map.offset - expected).abs() <= scatter);
        }
    }
}
