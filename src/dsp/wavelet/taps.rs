//! Filter banks of compactly supported wavelets, from their definition.
//!
//! Both families divide the one polynomial P_K(y), y = sin²(ω/2), that makes
//! cos^{2K}(ω/2)·P_K(sin²(ω/2)) a half-band filter (D103). Must not know signals.

use nalgebra::DMatrix;
use rustfft::num_complex::Complex;

/// Taps of a filter; the first stands at index `first`.
#[derive(Debug, Clone, PartialEq)]
pub struct Taps {
    /// Index of the first tap.
    pub first: isize,
    /// The taps.
    pub taps: Vec<f64>,
}

impl Taps {
    /// Index of the last tap.
    #[must_use]
    pub fn last(&self) -> isize {
        self.first + self.taps.len().cast_signed() - 1
    }

    /// Index and value of each tap.
    pub fn iter(&self) -> impl Iterator<Item = (isize, f64)> {
        (self.first..).zip(self.taps.iter().copied())
    }

    /// (−1)^n·h[1 − n]: the high pass that belongs to the other bank's low pass.
    fn alternated(&self) -> Self {
        let first = 1 - self.last();
        let signed = |(i, tap): (isize, &f64)| if i.rem_euclid(2) == 0 { *tap } else { -*tap };
        Self { first, taps: (first..).zip(self.taps.iter().rev()).map(signed).collect() }
    }
}

/// A perfectly reconstructing pair of two-channel banks (D103).
///
/// Analysis: `a[k] = Σ h̃[n]·x[n + 2k]`, `d[k] = Σ g̃[n]·x[n + 2k]`; synthesis:
/// `x[n] = Σ h[n − 2k]·a[k] + g[n − 2k]·d[k]`. Low passes sum to √2.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterBank {
    /// h̃.
    pub analysis_low: Taps,
    /// g̃.
    pub analysis_high: Taps,
    /// h.
    pub synthesis_low: Taps,
    /// g.
    pub synthesis_high: Taps,
}

impl FilterBank {
    fn new(analysis_low: Taps, synthesis_low: Taps) -> Self {
        Self {
            analysis_high: synthesis_low.alternated(),
            synthesis_high: analysis_low.alternated(),
            analysis_low,
            synthesis_low,
        }
    }

    /// Daubechies' orthogonal bank with `order` vanishing moments and 2·`order` taps, of least phase;
    /// 1 is Haar's. `None` unless 1 ≤ `order` ≤ [`MAX_ORDER`].
    #[must_use]
    pub fn daubechies(order: usize) -> Option<Self> {
        if !(1..=MAX_ORDER).contains(&order) {
            return None;
        }
        let mut product = vec![Complex::new(1.0, 0.0)];
        for y in roots(&half_band(order)) {
            // y = (2 − z − 1/z)/4: of the two z the one inside the unit circle.
            let middle = 1.0 - 2.0 * y;
            let distance = (middle * middle - 1.0).sqrt();
            let (one, other) = (middle + distance, middle - distance);
            let z = if one.norm_sqr() < 1.0 { one } else { other };
            let scale = 1.0 / (1.0 - z);
            product = times(&product, &[scale, -z * scale]);
        }
        let real: Vec<f64> = product.iter().map(|c| c.re).collect();
        let low = Taps { first: 0, taps: times(&real, &low_pass(order)) };
        Some(Self::new(low.clone(), low))
    }

    /// The bank of a spline of order `synthesis` and its shortest dual with `analysis` zeros at π
    /// (Cohen, Daubechies & Feauveau's symmetric family); the analysis wavelet has `synthesis`
    /// vanishing moments. `None` unless both are at least 1, their sum is even, and at most
    /// 2·[`MAX_ORDER`].
    #[must_use]
    pub fn spline(synthesis: usize, analysis: usize) -> Option<Self> {
        let sum = synthesis + analysis;
        if synthesis == 0 || analysis == 0 || !sum.is_multiple_of(2) || sum > 2 * MAX_ORDER {
            return None;
        }
        let mut dual = low_pass(analysis);
        let mut remainder = vec![0.0];
        let mut power = vec![1.0];
        for coefficient in half_band(sum / 2) {
            // In z, centred: longer powers reach one tap further on either side.
            remainder = plus_centred(&remainder, &power, coefficient);
            power = times(&power, &Y);
        }
        dual = times(&dual, &remainder);
        let reach = remainder.len() / 2;
        Some(Self::new(
            Taps { first: -(analysis / 2 + reach).cast_signed(), taps: dual },
            Taps { first: -(synthesis / 2).cast_signed(), taps: low_pass(synthesis) },
        ))
    }

    /// Cohen, Daubechies & Feauveau's bank of 9 analysis and 7 synthesis taps: four zeros at π each, the
    /// real zero of P_4 in the shorter filter, the two others in the longer.
    #[must_use]
    pub fn nine_seven() -> Self {
        let (mut longer, mut shorter) =
            (vec![Complex::new(1.0, 0.0)], vec![Complex::new(1.0, 0.0)]);
        let roots = roots(&half_band(4));
        let real = roots.iter().map(|y| y.im.abs()).fold(f64::INFINITY, f64::min);
        for y in roots {
            let factor = [0.25 / y, 1.0 - 0.5 / y, 0.25 / y];
            let filter = if y.im.abs() > real { &mut longer } else { &mut shorter };
            *filter = times(filter, &factor);
        }
        let taps = |product: &[Complex<f64>]| {
            let real: Vec<f64> = product.iter().map(|c| c.re).collect();
            let taps = times(&real, &low_pass(4));
            Taps { first: -(taps.len() / 2).cast_signed(), taps }
        };
        Self::new(taps(&longer), taps(&shorter))
    }
}

/// Highest order: rounding of the roots keeps the banks orthogonal to 1e-11 up to it.
pub const MAX_ORDER: usize = 12;

/// y = sin²(ω/2) as taps about 0.
const Y: [f64; 3] = [-0.25, 0.5, -0.25];

/// Coefficients of P_K(y) = Σ_{k<K} C(K − 1 + k, k)·y^k.
fn half_band(order: usize) -> Vec<f64> {
    let mut coefficient = 1.0;
    (0..order)
        .map(|k| {
            let this = coefficient;
            coefficient *= (order + k) as f64 / (k + 1) as f64;
            this
        })
        .collect()
}

/// √2·((1 + z)/2)^order.
fn low_pass(order: usize) -> Vec<f64> {
    (0..order).fold(vec![std::f64::consts::SQRT_2], |taps, _| times(&taps, &[0.5, 0.5]))
}

fn times<C>(a: &[C], b: &[C]) -> Vec<C>
where
    C: Copy + Default + std::ops::Add<Output = C> + std::ops::Mul<Output = C>,
{
    let mut out = vec![C::default(); a.len() + b.len() - 1];
    for (i, a) in a.iter().enumerate() {
        for (k, b) in b.iter().enumerate() {
            out[i + k] = out[i + k] + *a * *b;
        }
    }
    out
}

/// a + factor·b, both of odd length, their middles on each other.
fn plus_centred(a: &[f64], b: &[f64], factor: f64) -> Vec<f64> {
    let mut out = vec![0.0; a.len().max(b.len())];
    for (list, factor) in [(a, 1.0), (b, factor)] {
        let before = (out.len() - list.len()) / 2;
        for (out, value) in out[before..].iter_mut().zip(list) {
            *out += factor * value;
        }
    }
    out
}

/// Roots of Σ c_k·y^k: eigenvalues of the companion matrix, each made exact by Newton's method.
fn roots(coefficients: &[f64]) -> Vec<Complex<f64>> {
    let degree = coefficients.len() - 1;
    if degree == 0 {
        return Vec::new();
    }
    let leading = coefficients[degree];
    let companion = DMatrix::from_fn(degree, degree, |row, column| {
        if column + 1 == degree {
            -coefficients[row] / leading
        } else if row == column + 1 {
            1.0
        } else {
            0.0
        }
    });
    let polished = |y: &nalgebra::Complex<f64>| {
        let mut y = Complex::new(y.re, y.im);
        for _ in 0..8 {
            let (mut value, mut slope) = (Complex::new(0.0, 0.0), Complex::new(0.0, 0.0));
            for coefficient in coefficients.iter().rev() {
                slope = slope * y + value;
                value = value * y + coefficient;
            }
            if slope.norm_sqr() > 0.0 {
                y -= value / slope;
            }
        }
        y
    };
    companion.complex_eigenvalues().iter().map(polished).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn banks() -> Vec<(String, FilterBank, usize)> {
        let mut banks: Vec<_> = (1..=MAX_ORDER)
            .map(|n| (format!("db{n}"), FilterBank::daubechies(n).unwrap(), n))
            .collect();
        for synthesis in 1..=6 {
            for analysis in 1..=9 {
                if let Some(bank) = FilterBank::spline(synthesis, analysis) {
                    banks.push((format!("bior{synthesis}.{analysis}"), bank, synthesis));
                }
            }
        }
        banks.push(("9/7".to_owned(), FilterBank::nine_seven(), 4));
        banks
    }

    fn at(taps: &Taps, i: isize) -> f64 {
        usize::try_from(i - taps.first).ok().and_then(|i| taps.taps.get(i)).copied().unwrap_or(0.0)
    }

    #[test]
    fn every_bank_reconstructs() {
        for (name, bank, _) in banks() {
            let pairs = [
                (&bank.analysis_low, &bank.synthesis_low, 1.0),
                (&bank.analysis_high, &bank.synthesis_high, 1.0),
                (&bank.analysis_low, &bank.synthesis_high, 0.0),
                (&bank.analysis_high, &bank.synthesis_low, 0.0),
            ];
            for (a, b, at_zero) in pairs {
                for shift in -12..=12 {
                    let sum: f64 = a.iter().map(|(i, tap)| tap * at(b, i + 2 * shift)).sum();
                    let right = if shift == 0 { at_zero } else { 0.0 };
                    // Taps up to 10 in the longest duals; the roots of P_12 are known to 1e-12.
                    assert!((sum - right).abs() < 1e-11, "{name}, {shift}: {sum:e}");
                }
            }
        }
    }

    #[test]
    fn high_passes_have_their_vanishing_moments() {
        for (name, bank, moments) in banks() {
            let (taps, middle) = (&bank.analysis_high, {
                let high = &bank.analysis_high;
                0.5 * (high.first + high.last()) as f64
            });
            let half = 0.5 * (taps.taps.len() as f64);
            let moment = |p: usize| -> f64 {
                let power = i32::try_from(p).unwrap();
                taps.iter().map(|(i, tap)| tap * ((i as f64 - middle) / half).powi(power)).sum()
            };
            for p in 0..moments {
                assert!(moment(p).abs() < 1e-11, "{name}, {p}: {:e}", moment(p));
            }
            // And no more.
            assert!(moment(moments).abs() > 1e-9, "{name}: {:e}", moment(moments));
        }
    }

    #[test]
    fn daubechies_second_is_known_in_closed_form() {
        let root = 3.0_f64.sqrt();
        let right = [1.0 + root, 3.0 + root, 3.0 - root, 1.0 - root].map(|v| v / 32.0_f64.sqrt());
        let found = FilterBank::daubechies(2).unwrap().analysis_low.taps;
        assert!(found.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}");
    }

    #[test]
    fn the_bank_of_9_and_7_taps_is_that_of_jpeg_2000() {
        // ISO/IEC 15444-1, table F.4 (scaled by √2): the middle taps.
        let bank = FilterBank::nine_seven();
        let root = std::f64::consts::SQRT_2;
        assert_eq!((bank.analysis_low.taps.len(), bank.synthesis_low.taps.len()), (9, 7));
        assert!((at(&bank.analysis_low, 0) / root - 0.602_949_018_236_36).abs() < 1e-12);
        assert!((at(&bank.analysis_low, 4) / root - 0.026_748_757_410_81).abs() < 1e-12);
        assert!((at(&bank.synthesis_low, 0) * root - 1.115_087_052_456_994).abs() < 1e-12);
    }

    #[test]
    fn orders_out_of_range_have_no_bank() {
        assert!(FilterBank::daubechies(0).is_none() && FilterBank::daubechies(13).is_none());
        assert!(FilterBank::spline(0, 2).is_none() && FilterBank::spline(2, 3).is_none());
        assert!(FilterBank::spline(13, 13).is_none());
    }
}
