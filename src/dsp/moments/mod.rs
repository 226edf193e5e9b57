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
mod tests;
