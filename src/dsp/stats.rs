//! Moments that can be merged, and order statistics.
//!
//! Says how strong and how impulsive a signal is. Must not know what the samples mean.

use std::cmp::Ordering;

use crate::dsp::real::Real;
use crate::dsp::real::floor_index;

/// Samples summed before merging: short enough that plain f64 sums lose nothing that matters.
const BLOCK: usize = 1024;

/// Parallel accumulators, so that the additions of a block do not wait for one another.
const LANES: usize = 8;

/// Ratio of a Gaussian's standard deviation to its median absolute deviation, 1/Φ⁻¹(3/4).
pub const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// Count, mean and central power sums of a set of samples (D1).
///
/// Held in f64 whatever the samples are, so sets can be merged without loss. The values of an
/// empty set are 0, its extremes +∞ and −∞.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Number of samples.
    pub n: u64,
    /// Mean, unit u.
    pub mean: f64,
    /// Σ(x − mean)², u².
    pub m2: f64,
    /// Σ(x − mean)³, u³.
    pub m3: f64,
    /// Σ(x − mean)⁴, u⁴.
    pub m4: f64,
    /// Smallest sample, u.
    pub min: f64,
    /// Largest sample, u.
    pub max: f64,
}

impl Default for Moments {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Moments {
    /// The moments of no samples: neutral in [`Self::merge`].
    pub const EMPTY: Self = Self {
        n: 0,
        mean: 0.0,
        m2: 0.0,
        m3: 0.0,
        m4: 0.0,
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
    };

    /// Computes the moments of `x` (any length, any unit).
    ///
    /// Each block of 1024 is shifted by its first sample before it is summed, so a constant gives
    /// exactly 0 central sums and a DC offset of 10⁶ times the signal costs nothing beyond the
    /// rounding of the samples themselves (f32: 6e-8 of the offset, i.e. 6 % of such a signal;
    /// remove the mean before converting to f32).
    #[must_use]
    pub fn of<T: Real>(x: &[T]) -> Self {
        x.chunks(BLOCK).fold(Self::EMPTY, |sum, block| sum.merge(&of_block(block)))
    }

    /// Combines the moments of two disjoint sets; exact but for rounding (D2).
    ///
    /// Source: Pébay, SAND2008-6212, 2008 (pairwise update of arbitrary-order central moments).
    #[must_use]
    pub fn merge(&self, other: &Self) -> Self {
        if self.n == 0 {
            return *other;
        }
        if other.n == 0 {
            return *self;
        }
        let (a, b) = (self, other);
        let (na, nb) = (a.n as f64, b.n as f64);
        let n = na + nb;
        let delta = b.mean - a.mean;
        let delta_n = delta / n;
        let cross = delta * delta_n * na * nb;
        Self {
            n: a.n + b.n,
            mean: a.mean + delta_n * nb,
            m2: a.m2 + b.m2 + cross,
            m3: a.m3 + b.m3 + cross * delta_n * (na - nb) + 3.0 * delta_n * (na * b.m2 - nb * a.m2),
            m4: a.m4
                + b.m4
                + cross * delta_n * delta_n * (na * na - na * nb + nb * nb)
                + 6.0 * delta_n * delta_n * (na * na * b.m2 + nb * nb * a.m2)
                + 4.0 * delta_n * (na * b.m3 - nb * a.m3),
            min: a.min.min(b.min),
            max: a.max.max(b.max),
        }
    }

    /// Population variance, u²; `None` for no samples.
    #[must_use]
    pub fn variance(&self) -> Option<f64> {
        (self.n > 0).then(|| self.m2 / self.n as f64)
    }

    /// RMS of the signal with its mean removed, u; `None` for no samples (D3).
    #[must_use]
    pub fn rms(&self) -> Option<f64> {
        self.variance().map(f64::sqrt)
    }

    /// Largest deviation from the mean, max|x − mean|, u; `None` for no samples.
    #[must_use]
    pub fn peak(&self) -> Option<f64> {
        (self.n > 0).then(|| (self.max - self.mean).max(self.mean - self.min))
    }

    /// Span max − min, u; `None` for no samples.
    #[must_use]
    pub fn peak_to_peak(&self) -> Option<f64> {
        (self.n > 0).then_some(self.max - self.min)
    }

    /// Crest factor peak/RMS; `None` for no samples or a constant (D3).
    #[must_use]
    pub fn crest(&self) -> Option<f64> {
        let rms = self.rms().filter(|rms| *rms > 0.0)?;
        self.peak().map(|peak| peak / rms)
    }

    /// Skewness √N·m3/m2^1.5; `None` for no samples or a constant (D3).
    #[must_use]
    pub fn skewness(&self) -> Option<f64> {
        let denominator = self.m2 * self.m2.sqrt();
        (denominator > 0.0).then(|| (self.n as f64).sqrt() * self.m3 / denominator)
    }

    /// Pearson kurtosis N·m4/m2² (a Gaussian has 3, a sine 1.5); `None` for no samples or a
    /// constant (D3). Source: Dyer & Stewart 1978.
    #[must_use]
    pub fn kurtosis(&self) -> Option<f64> {
        let denominator = self.m2 * self.m2;
        (denominator > 0.0).then(|| self.n as f64 * self.m4 / denominator)
    }
}

/// Computes the mean in f64; `None` for no samples.
#[must_use]
pub fn mean<T: Real>(x: &[T]) -> Option<f64> {
    let first = x.first()?.to_f64();
    let shifted: f64 = x.chunks(BLOCK).map(|block| sum_shifted(block, first)).sum();
    Some(first + shifted / x.len() as f64)
}

/// Computes the RMS with the mean removed, u; `None` for no samples.
#[must_use]
pub fn rms<T: Real>(x: &[T]) -> Option<f64> {
    Moments::of(x).rms()
}

/// Computes the quantile `q` (0…1, clamped) with linear interpolation between order statistics
/// (type 7 of Hyndman & Fan 1996); reorders `values`; `None` for no values.
#[must_use]
pub fn quantile<T: Real>(values: &mut [T], q: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = floor_index(position).min(last);
    let (_, &mut low, above) = values.select_nth_unstable_by(below, compare);
    let high = above.iter().copied().fold(None, |least: Option<T>, value| match least {
        Some(least) if compare(&least, &value).is_le() => Some(least),
        _ => Some(value),
    });
    let fraction = position - below as f64;
    let (low, high) = (low.to_f64(), high.unwrap_or(low).to_f64());
    Some(T::rounded(low + fraction * (high - low)))
}

/// Computes the median; reorders `values`; `None` for no values.
#[must_use]
pub fn median<T: Real>(values: &mut [T]) -> Option<T> {
    quantile(values, 0.5)
}

/// Computes the median absolute deviation from the median, in the unit of the values (multiply by
/// [`SIGMA_PER_MAD`] for a Gaussian's standard deviation); overwrites `values`; `None` for none.
#[must_use]
pub fn mad<T: Real>(values: &mut [T]) -> Option<T> {
    let centre = median(values)?;
    for value in &mut *values {
        *value = (*value - centre).abs();
    }
    median(values)
}

fn compare<T: Real>(a: &T, b: &T) -> Ordering {
    a.partial_cmp(b).unwrap_or(Ordering::Equal)
}

fn sum_shifted<T: Real>(x: &[T], shift: f64) -> f64 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = x.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value.to_f64() - shift;
        }
    }
    lanes.iter().sum::<f64>() + rest.iter().map(|value| value.to_f64() - shift).sum::<f64>()
}

fn of_block<T: Real>(x: &[T]) -> Moments {
    let Some(first) = x.first() else { return Moments::EMPTY };
    let shift = first.to_f64();
    let centre = sum_shifted(x, shift) / x.len() as f64;
    let (mut m2, mut m3, mut m4) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let (mut min, mut max) = ([*first; LANES], [*first; LANES]);
    let mut add = |lane: usize, value: T| {
        let d = (value.to_f64() - shift) - centre;
        let square = d * d;
        m2[lane] += square;
        m3[lane] += square * d;
        m4[lane] += square * square;
        min[lane] = if value < min[lane] { value } else { min[lane] };
        max[lane] = if value > max[lane] { value } else { max[lane] };
    };
    let (chunks, rest) = x.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, value) in chunk.iter().enumerate() {
            add(lane, *value);
        }
    }
    for (lane, value) in rest.iter().enumerate() {
        add(lane, *value);
    }
    Moments {
        n: x.len() as u64,
        mean: shift + centre,
        m2: m2.iter().sum(),
        m3: m3.iter().sum(),
        m4: m4.iter().sum(),
        min: min.iter().map(|v| v.to_f64()).fold(f64::INFINITY, f64::min),
        max: max.iter().map(|v| v.to_f64()).fold(f64::NEG_INFINITY, f64::max),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::sine;

    /// Two-pass moments as the definition says, without blocks or shifts.
    fn slow_moments(x: &[f64]) -> [f64; 4] {
        let n = x.len() as f64;
        let mean = x.iter().sum::<f64>() / n;
        let central = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>();
        [mean, central(2), central(3), central(4)]
    }

    #[test]
    fn sine_has_its_closed_form() {
        // 100 whole periods: RMS A/√2, crest √2, kurtosis 1.5, skewness 0; the peak is missed by
        // at most 1 − cos(π·f/fs) = 5e-5 because the samples may straddle it.
        let x = sine(10_000, 10_000.0, 100.0, 3.0, 0.3);
        let m = Moments::of(&x);
        assert!((m.rms().unwrap() - 3.0 / 2f64.sqrt()).abs() < 1e-12);
        assert!((m.crest().unwrap() - 2f64.sqrt()).abs() < 1e-3);
        assert!((m.kurtosis().unwrap() - 1.5).abs() < 1e-12);
        assert!(m.skewness().unwrap().abs() < 1e-12);
    }

    #[test]
    fn zero_denominators_give_none() {
        let empty = Moments::of::<f64>(&[]);
        assert_eq!(empty.n, 0);
        assert_eq!((empty.rms(), empty.peak(), empty.crest()), (None, None, None));
        for constant in [vec![0.1_f64; 5000], vec![7.3], vec![0.0; 3]] {
            let m = Moments::of(&constant);
            // Exactly zero by the shift, not merely small.
            assert_eq!((m.rms(), m.peak()), (Some(0.0), Some(0.0)));
            assert_eq!((m.crest(), m.kurtosis(), m.skewness()), (None, None, None));
        }
    }

    #[test]
    fn a_huge_offset_costs_only_input_rounding() {
        let x = gaussian_noise(20_000, 7);
        let plain = Moments::of(&x);
        let shifted: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
        let with_dc = Moments::of(&shifted);
        // Adding 1e6 rounds each sample by up to 6e-11.
        assert!((with_dc.rms().unwrap() - plain.rms().unwrap()).abs() < 1e-10);
        assert!((with_dc.kurtosis().unwrap() - plain.kurtosis().unwrap()).abs() < 1e-9);
        // In f32 a DC of 100 RMS rounds samples by up to 4e-6 of the RMS.
        let narrow: Vec<f32> = x.iter().map(|v| f32::rounded(v + 100.0)).collect();
        assert!((Moments::of(&narrow).rms().unwrap() - plain.rms().unwrap()).abs() < 1e-6);
    }

    #[test]
    fn f32_agrees_with_f64() {
        let x = gaussian_noise(10_007, 3);
        let narrow: Vec<f32> = x.iter().map(|v| f32::rounded(*v)).collect();
        let (a, b) = (Moments::of(&x), Moments::of(&narrow));
        // All sums are f64; only the rounding of the samples (6e-8) is left.
        assert!((a.rms().unwrap() - b.rms().unwrap()).abs() < 1e-7);
        assert!((a.kurtosis().unwrap() - b.kurtosis().unwrap()).abs() < 1e-5);
    }

    #[test]
    fn order_statistics_of_known_sets() {
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(median(&mut [2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(quantile(&mut [5.0, 1.0, 3.0], 0.0), Some(1.0));
        assert_eq!(quantile(&mut [5.0, 1.0, 3.0], 1.0), Some(5.0));
        assert_eq!(quantile(&mut [0.0, 10.0], 0.25), Some(2.5));
        assert_eq!(mad(&mut [1.0, 1.0, 2.0, 2.0, 4.0, 6.0, 9.0]), Some(1.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn merging_equals_computing_at_once(
            x in prop::collection::vec(-100.0..100.0_f64, 2..3000),
            cut in 0.0..1.0_f64,
            offset in -1e3..1e3_f64,
        ) {
            let x: Vec<f64> = x.iter().map(|v| v + offset).collect();
            let at = floor_index(cut * x.len() as f64);
            let merged = Moments::of(&x[..at]).merge(&Moments::of(&x[at..]));
            let [mean, m2, m3, m4] = slow_moments(&x);
            // Rounding of 3000 additions of terms up to 200^p, relative to the sum of magnitudes.
            let n = x.len() as f64;
            prop_assert!((merged.mean - mean).abs() < 1e-11 * 1e3);
            prop_assert!((merged.m2 - m2).abs() < 1e-11 * n * 200f64.powi(2));
            prop_assert!((merged.m3 - m3).abs() < 1e-11 * n * 200f64.powi(3));
            prop_assert!((merged.m4 - m4).abs() < 1e-11 * n * 200f64.powi(4));
            prop_assert_eq!(merged.n, x.len() as u64);
        }
    }
}
