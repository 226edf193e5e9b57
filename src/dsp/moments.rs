//! Central moments that can be merged, up to the eighth.
//!
//! A history is kept as the moments of its blocks, so that a new block costs only itself. Nothing is
//! ever taken out of a sum again, so nothing drifts. Must not know what the samples mean.

use std::collections::VecDeque;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;

use crate::dsp::real::Real;

/// Samples summed before merging: short enough that plain f64 sums lose nothing that matters.
const BLOCK: usize = 1024;

/// Parallel accumulators, so that the additions of a block do not wait for one another.
const LANES: usize = 16;

/// Highest order.
const ORDER: usize = 8;

/// Deviations between 2^−60 and 2^60 are summed in their own unit: nothing of order 8 leaves f64.
const PLAIN_EXPONENT: i32 = 60;

/// Binomial coefficients, row p column k.
const BINOMIAL: [[f64; ORDER + 1]; ORDER + 1] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 3.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 4.0, 6.0, 4.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 5.0, 10.0, 10.0, 5.0, 1.0, 0.0, 0.0, 0.0],
    [1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0, 0.0, 0.0],
    [1.0, 7.0, 21.0, 35.0, 35.0, 21.0, 7.0, 1.0, 0.0],
    [1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0],
];

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
    /// Smallest sample, u.
    pub min: f64,
    /// Largest sample, u.
    pub max: f64,
    /// Σ((x − mean)·2^−exponent)^p, p = 0…8.
    sums: [f64; ORDER + 1],
    /// Not 0 only where deviations are so large or so small that their powers are no numbers of f64.
    exponent: i32,
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
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        sums: [0.0; ORDER + 1],
        exponent: 0,
    };

    /// Computes the moments of `x` (any length, any unit).
    ///
    /// Each block of 1024 is shifted by its first sample before it is summed, so a constant gives
    /// exactly 0 central sums and a DC offset of 10⁶ times the signal costs nothing beyond the
    /// rounding of the samples themselves (f32: 6e-8 of the offset, i.e. 6 % of such a signal;
    /// remove the mean before converting to f32). Raw counts of any width and denormal samples have
    /// all moments.
    #[must_use]
    pub fn of<T: Real>(x: &[T]) -> Self {
        Arch::new().dispatch(Blocks { x })
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
        let (n_a, n_b) = (self.n as f64, other.n as f64);
        let n = n_a + n_b;
        let delta = other.mean - self.mean;
        let exponent = exponent_of(delta.abs()).max(self.own_exponent()).max(other.own_exponent());
        let exponent = exponent.unwrap_or(0);
        let (a, b) = (self.sums_at(exponent), other.sums_at(exponent));
        let scaled = delta * power_of_two(-exponent);
        // From the common mean to that of each set.
        let (from_a, from_b) = (-scaled * (n_b / n), scaled * (n_a / n));
        let mut sums = [0.0; ORDER + 1];
        for (p, sum) in sums.iter_mut().enumerate() {
            let (mut power_a, mut power_b) = (1.0, 1.0);
            for k in 0..=p {
                *sum += BINOMIAL[p][k] * (power_a * a[p - k] + power_b * b[p - k]);
                (power_a, power_b) = (power_a * from_a, power_b * from_b);
            }
        }
        sums[1] = 0.0;
        Self {
            n: self.n + other.n,
            mean: self.mean + delta * (n_b / n),
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            sums,
            exponent,
        }
    }

    /// Exponent of the sums; `None` for a constant, whose sums are 0 with any.
    fn own_exponent(&self) -> Option<i32> {
        (self.sums[2] > 0.0).then_some(self.exponent)
    }

    /// The sums with another exponent.
    fn sums_at(&self, exponent: i32) -> [f64; ORDER + 1] {
        let mut sums = self.sums;
        if exponent != self.exponent {
            let factor = power_of_two(self.exponent.saturating_sub(exponent));
            let mut power = 1.0;
            for sum in &mut sums {
                *sum *= power;
                power *= factor;
            }
        }
        sums
    }

    /// Population variance, u²; `None` for no samples.
    #[must_use]
    pub fn variance(&self) -> Option<f64> {
        self.rms().map(|rms| rms * rms)
    }

    /// RMS of the signal with its mean removed, u; `None` for no samples (D3).
    #[must_use]
    pub fn rms(&self) -> Option<f64> {
        let unit = power_of_two(self.exponent);
        (self.n > 0).then(|| (self.sums[2] / self.n as f64).sqrt() * unit)
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
        let [_, _, m2, m3, ..] = self.sums;
        let denominator = m2 * m2.sqrt();
        (denominator > 0.0).then(|| (self.n as f64).sqrt() * m3 / denominator)
    }

    /// Pearson kurtosis N·m4/m2² (a Gaussian has 3, a sine 1.5); `None` for no samples or a
    /// constant (D3). Source: Dyer & Stewart 1978.
    #[must_use]
    pub fn kurtosis(&self) -> Option<f64> {
        self.normalised(4)
    }

    /// Sixth moment N²·m6/m2³ (a Gaussian has 15, a sine 2.5); `None` for no samples or a constant
    /// (D3). Source: Martin 1989.
    #[must_use]
    pub fn m6(&self) -> Option<f64> {
        self.normalised(6)
    }

    /// Eighth moment N³·m8/m2⁴ (a Gaussian has 105, a sine 4.375); `None` for no samples or a
    /// constant (D3). Source: Martin 1989.
    #[must_use]
    pub fn m8(&self) -> Option<f64> {
        self.normalised(8)
    }

    /// Mean of (x − mean)^p over variance^(p/2), p even.
    fn normalised(&self, p: usize) -> Option<f64> {
        let n = self.n as f64;
        let variance = self.sums[2] / n;
        let mut denominator = n;
        for _ in 0..p / 2 {
            denominator *= variance;
        }
        (self.n > 0 && denominator > 0.0).then(|| self.sums[p] / denominator)
    }
}

/// Exponent with which deviations up to `largest` are summed; `None` for 0.
fn exponent_of(largest: f64) -> Option<i32> {
    if largest <= 0.0 || !largest.is_finite() {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, reason = "between −1074 and 1023")]
    let exponent = largest.log2().floor() as i32;
    // Beyond 1000 the power of two itself would be no number.
    let is_plain = exponent.abs() <= PLAIN_EXPONENT;
    Some(if is_plain { 0 } else { exponent.clamp(-1000, 1000) })
}

/// 2^e; 0 and ∞ where f64 ends.
fn power_of_two(exponent: i32) -> f64 {
    if exponent == 0 { 1.0 } else { 2f64.powi(exponent) }
}

/// Moments of the newest blocks of a signal, as many as a history has (D2).
///
/// A block costs only its own samples; the history is merged anew from its blocks each time it is asked
/// for.
#[derive(Debug, Clone)]
pub struct MomentHistory {
    blocks: VecDeque<Moments>,
    n_blocks: usize,
}

impl MomentHistory {
    /// A history of `n_blocks` blocks (at least 1).
    #[must_use]
    pub fn new(n_blocks: usize) -> Self {
        let n_blocks = n_blocks.max(1);
        Self { blocks: VecDeque::with_capacity(n_blocks), n_blocks }
    }

    /// Takes the next block in; the oldest goes when there are too many.
    pub fn push<T: Real>(&mut self, block: &[T]) {
        if self.blocks.len() == self.n_blocks {
            self.blocks.pop_front();
        }
        self.blocks.push_back(Moments::of(block));
    }

    /// Forgets all blocks: behind a gap.
    pub fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Blocks held.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// The moments of all samples held.
    #[must_use]
    pub fn moments(&self) -> Moments {
        self.blocks.iter().fold(Moments::EMPTY, |sum, block| sum.merge(block))
    }
}

/// Σ(x − shift), by blocks.
pub(in crate::dsp) fn sum_shifted<T: Real>(x: &[T], shift: f64) -> f64 {
    Arch::new().dispatch(SumShifted { x, shift })
}

struct SumShifted<'a, T> {
    x: &'a [T],
    shift: f64,
}

impl<T: Real> WithSimd for SumShifted<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut sum = 0.0;
        for block in self.x.chunks(BLOCK) {
            let mut lanes = [0.0; LANES];
            let (chunks, rest) = block.as_chunks::<LANES>();
            for chunk in chunks {
                for (lane, value) in lanes.iter_mut().zip(chunk) {
                    *lane += value.to_f64() - self.shift;
                }
            }
            for (lane, value) in lanes.iter_mut().zip(rest) {
                *lane += value.to_f64() - self.shift;
            }
            sum += total(&lanes);
        }
        sum
    }
}

#[inline(always)]
fn total(lanes: &[f64; LANES]) -> f64 {
    let mut sum = 0.0;
    for lane in lanes {
        sum += lane;
    }
    sum
}

struct Blocks<'a, T> {
    x: &'a [T],
}

impl<T: Real> WithSimd for Blocks<'_, T> {
    type Output = Moments;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Moments {
        let mut deviations = [0.0; BLOCK];
        let mut all = Moments::EMPTY;
        for block in self.x.chunks(BLOCK) {
            all = all.merge(&of_block(simd, block, &mut deviations));
        }
        all
    }
}

/// Moments of up to [`BLOCK`] samples.
#[inline(always)]
fn of_block<T: Real, S: Simd>(simd: S, x: &[T], deviations: &mut [f64; BLOCK]) -> Moments {
    let n = x.len();
    let shift = x[0].to_f64();
    let mut lanes = [0.0; LANES];
    let (mut min, mut max) = ([x[0]; LANES], [x[0]; LANES]);
    let (chunks, rest) = x.as_chunks::<LANES>();
    let (places, _) = deviations.as_chunks_mut::<LANES>();
    for (chunk, place) in chunks.iter().zip(places) {
        for i in 0..LANES {
            let value = chunk[i];
            let deviation = value.to_f64() - shift;
            place[i] = deviation;
            lanes[i] += deviation;
            min[i] = if value < min[i] { value } else { min[i] };
            max[i] = if value > max[i] { value } else { max[i] };
        }
    }
    let mut sum = total(&lanes);
    let (mut least, mut most) = (x[0], x[0]);
    for (least_of, most_of) in min.iter().zip(&max) {
        least = if *least_of < least { *least_of } else { least };
        most = if *most_of > most { *most_of } else { most };
    }
    for (value, place) in rest.iter().zip(&mut deviations[n - rest.len()..n]) {
        *place = value.to_f64() - shift;
        sum += *place;
        least = if *value < least { *value } else { least };
        most = if *value > most { *value } else { most };
    }
    let centre = sum / n as f64;
    let (min, max) = (least.to_f64(), most.to_f64());
    let largest = (max - shift - centre).max(centre - (min - shift));
    let exponent = exponent_of(largest).unwrap_or(0);
    let mut sums = power_sums(simd, &deviations[..n], centre, power_of_two(-exponent));
    sums[0] = n as f64;
    Moments { n: n as u64, mean: shift + centre, min, max, sums, exponent }
}

/// Σ((d − centre)·unit)^p, p = 2…8.
#[inline(always)]
fn power_sums<S: Simd>(simd: S, deviations: &[f64], centre: f64, unit: f64) -> [f64; ORDER + 1] {
    let mut sums = [0.0; ORDER + 1];
    let (vectors, rest) = S::as_simd_f64s(deviations);
    let zero = simd.splat_f64s(0.0);
    let (mut s2, mut s3, mut s4, mut s5) = (zero, zero, zero, zero);
    let (mut s6, mut s7, mut s8) = (zero, zero, zero);
    let (centres, units) = (simd.splat_f64s(centre), simd.splat_f64s(unit));
    for vector in vectors {
        let d = simd.mul_f64s(simd.sub_f64s(*vector, centres), units);
        let d2 = simd.mul_f64s(d, d);
        let (d3, d4) = (simd.mul_f64s(d2, d), simd.mul_f64s(d2, d2));
        s2 = simd.add_f64s(s2, d2);
        s3 = simd.add_f64s(s3, d3);
        s4 = simd.add_f64s(s4, d4);
        s5 = simd.mul_add_e_f64s(d3, d2, s5);
        s6 = simd.mul_add_e_f64s(d3, d3, s6);
        s7 = simd.mul_add_e_f64s(d4, d3, s7);
        s8 = simd.mul_add_e_f64s(d4, d4, s8);
    }
    for (sum, lanes) in sums[2..].iter_mut().zip([s2, s3, s4, s5, s6, s7, s8]) {
        *sum = simd.reduce_sum_f64s(lanes);
    }
    for value in rest {
        let d = (value - centre) * unit;
        let mut power = d;
        for sum in &mut sums[2..] {
            power *= d;
            *sum += power;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dsp::real::floor_index;
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

    /// Mean, RMS, skewness, kurtosis, M6, M8 as the definition says, on values divided by `unit`.
    fn slow_figures(x: &[f64], unit: f64) -> [f64; 6] {
        let x: Vec<f64> = x.iter().map(|v| v / unit).collect();
        let n = x.len() as f64;
        let mean = x.iter().sum::<f64>() / n;
        let central = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>() / n;
        let rms = central(2).sqrt();
        let ratio = |p: i32| central(p) / rms.powi(p);
        [mean * unit, rms * unit, ratio(3), ratio(4), ratio(6), ratio(8)]
    }

    fn figures(m: &Moments) -> [f64; 6] {
        [
            m.mean,
            m.rms().unwrap(),
            m.skewness().unwrap(),
            m.kurtosis().unwrap(),
            m.m6().unwrap(),
            m.m8().unwrap(),
        ]
    }

    /// RMS relative to itself, ratios to themselves or 1.
    fn assert_close(found: &[f64; 6], exact: &[f64; 6], tolerance: f64) {
        assert!((found[1] / exact[1] - 1.0).abs() <= tolerance, "{found:?} {exact:?}");
        for (found, exact) in found[2..].iter().zip(&exact[2..]) {
            assert!((found - exact).abs() <= tolerance * exact.abs().max(1.0), "{found} {exact}");
        }
    }

    #[test]
    fn sixth_and_eighth_moments_have_their_closed_forms() {
        // A sine: (2p)!/(p!)²/2^p: 20/8 and 70/16; all periods whole.
        let m = Moments::of(&sine(10_000, 10_000.0, 100.0, 3.0, 0.3));
        assert!((m.m6().unwrap() - 2.5).abs() < 1e-12);
        assert!((m.m8().unwrap() - 4.375).abs() < 1e-12);
        // Two values: every even moment is 1.
        let two: Vec<f32> = (0..4096).map(|i| if i % 2 == 0 { 2.0 } else { -2.0 }).collect();
        let m = Moments::of(&two);
        assert!((m.m6().unwrap() - 1.0).abs() < 1e-12 && (m.m8().unwrap() - 1.0).abs() < 1e-12);
        // White noise: 15 ± 2.4·√(1000/n), 105 ± 36·√(1000/n) (one standard deviation).
        let m = Moments::of(&gaussian_noise(200_000, 21));
        assert!((m.m6().unwrap() - 15.0).abs() < 0.6 && (m.m8().unwrap() - 105.0).abs() < 10.0);
    }

    #[test]
    fn one_sample_impulse_has_its_closed_form() {
        // One 1 among n − 1 zeros at p = 1/n: central moments p(1 − p)^k + (1 − p)(−p)^k.
        for place in [0, 1, 1023, 1024, 5000, 9999] {
            let mut x = vec![0.0_f32; 10_000];
            x[place] = 1.0;
            let m = Moments::of(&x);
            let p = 1e-4_f64;
            let central = |k: i32| p * (1.0 - p).powi(k) + (1.0 - p) * (-p).powi(k);
            let ratio = |k: i32| central(k) / central(2).powi(k / 2);
            for (found, k) in [(m.kurtosis(), 4), (m.m6(), 6), (m.m8(), 8)] {
                // Rounding of a few thousand additions.
                assert!((found.unwrap() / ratio(k) - 1.0).abs() < 1e-12, "{place} {k}");
            }
            assert!((m.crest().unwrap() - (1.0 - p) / central(2).sqrt()).abs() < 1e-9);
        }
    }

    #[test]
    fn raw_counts_denormals_and_huge_numbers_have_all_moments() {
        let noise = gaussian_noise(5000, 12);
        let plain = slow_figures(&noise, 1.0);
        // 24-bit counts at full scale: 8 388 607⁸ is no number of f32.
        let counts: Vec<f32> = noise.iter().map(|v| f32::rounded((v * 2e6).round())).collect();
        let wide: Vec<f64> = counts.iter().map(|v| f64::from(*v)).collect();
        assert_close(&figures(&Moments::of(&counts)), &slow_figures(&wide, 1.0), 1e-12);
        // Powers of two change no digit of f64, whether or not the eighth power is a number.
        for unit in [2f64.powi(-1000), 2f64.powi(-200), 2f64.powi(300), 2f64.powi(1000)] {
            let x: Vec<f64> = noise.iter().map(|v| v * unit).collect();
            let found = figures(&Moments::of(&x));
            assert_close(&found, &slow_figures(&x, unit), 1e-12);
            assert!((found[4] - plain[4]).abs() < 1e-11 * plain[4]);
            // Merged with plain numbers it vanishes in them, or they in it, but no figure is lost.
            let both = Moments::of(&x).merge(&Moments::of(&noise));
            assert!(figures(&both).iter().all(|value| value.is_finite()), "{unit:e}");
        }
        // Denormal f32, a few hundred steps of 1.4e-45.
        let tiny: Vec<f32> = noise.iter().map(|v| f32::rounded(v * 1e-42)).collect();
        assert!(tiny.iter().all(|v| v.abs() < f32::MIN_POSITIVE));
        let wide: Vec<f64> = tiny.iter().map(|v| f64::from(*v)).collect();
        assert_close(&figures(&Moments::of(&tiny)), &slow_figures(&wide, 1e-42), 1e-12);
    }

    #[test]
    fn offset_of_a_million_leaves_the_eighth_moment() {
        let x: Vec<f64> = gaussian_noise(20_000, 7).iter().map(|v| v + 1e6).collect();
        // Against the very samples, from which the offset can be taken without rounding.
        let exact: Vec<f64> = x.iter().map(|v| v - 1e6).collect();
        // The means of the blocks are numbers near 1e6: 1e-10 of a deviation each.
        assert_close(&figures(&Moments::of(&x)), &slow_figures(&exact, 1.0), 1e-10);
    }

    #[test]
    fn a_history_is_that_of_its_newest_samples() {
        let x: Vec<f32> = gaussian_noise(20_000, 5).iter().map(|v| f32::rounded(*v)).collect();
        let mut history = MomentHistory::new(10);
        assert_eq!(history.moments(), Moments::EMPTY);
        for (i, block) in x.chunks(1000).enumerate() {
            history.push(block);
            let held = &x[(i + 1).saturating_sub(10) * 1000..(i + 1) * 1000];
            let (found, exact) = (history.moments(), Moments::of(held));
            assert_eq!((found.n, found.min, found.max), (exact.n, exact.min, exact.max));
            // Other blocks, other roundings.
            assert_close(&figures(&found), &figures(&exact), 1e-12);
        }
        assert_eq!(history.n_blocks(), 10);
        history.clear();
        assert_eq!(history.moments().n, 0);
        // Zeros, then a constant: no variance, then that of two levels.
        let mut history = MomentHistory::new(2);
        history.push(&[0.0_f32; 500]);
        assert_eq!(history.moments().m8(), None);
        history.push(&[4.0_f32; 500]);
        let two = history.moments();
        assert_eq!((two.rms(), two.m8()), (Some(2.0), Some(1.0)));
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
            prop_assert!((merged.sums[2] - m2).abs() < 1e-11 * n * 200f64.powi(2));
            prop_assert!((merged.sums[3] - m3).abs() < 1e-11 * n * 200f64.powi(3));
            prop_assert!((merged.sums[4] - m4).abs() < 1e-11 * n * 200f64.powi(4));
            prop_assert_eq!(merged.n, x.len() as u64);
        }
    }
}
