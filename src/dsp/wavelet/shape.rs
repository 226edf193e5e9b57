//! ψ̂(ω) of each wavelet: what its transform multiplies a spectrum by.
//!
//! Must not know records and their lengths.

use std::f64::consts::FRAC_1_SQRT_2;
use std::f64::consts::SQRT_2;
use std::f64::consts::TAU;
use std::fmt;

use rustfft::num_complex::Complex;

use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;
use crate::dsp::wavelet::taps::FilterBank;
use crate::dsp::wavelet::taps::Taps;

/// Beyond this multiple of 2π rad the transform of a tabulated wavelet is taken as 0.
const MAX_CYCLES: usize = 512;

/// Places of the table in 2π/(length of the wavelet): cubic interpolation errs by 3e-6 of the maximum.
const PLACES_A_CYCLE: usize = 32;

/// A mother wavelet other than Morlet's, real in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wavelet {
    /// (1 − t²)·e^(−t²/2), also Ricker's or Marr's: second derivative of a Gaussian.
    MexicanHat,
    /// 1, then −1: the difference of two means.
    Haar,
    /// Daubechies' with so many vanishing moments.
    Daubechies(usize),
    /// The analysis wavelet of a spline bank: order of the synthesis spline (its vanishing moments) and
    /// zeros of its own low pass at π.
    Biorthogonal(usize, usize),
    /// The analysis wavelet of the bank of 9 and 7 taps.
    NineSeven,
}

/// ψ̂ with |ψ̂| at most 1, the frequency where it is 1, and how far ψ reaches.
pub struct Shape {
    kind: Kind,
    /// ω where |ψ̂| is largest, rad.
    peak_rad: f64,
    /// Half width about time 0, in units of the scale.
    reach: f64,
}

enum Kind {
    MexicanHat,
    Haar { largest: f64 },
    Table(Table),
}

/// ψ̂ at equal distances from ω = 0 on.
struct Table {
    step_rad: f64,
    values: Vec<Complex<f64>>,
}

impl Shape {
    /// Makes ψ̂ of a wavelet (D101, D102); `None` for an order without a filter bank, and for those whose
    /// wavelet is no function of finite energy (a spline of order 3 with one zero).
    #[must_use]
    pub fn new(wavelet: Wavelet) -> Option<Self> {
        match wavelet {
            // 0.8 % of ∫|ψ| lies further out.
            Wavelet::MexicanHat => {
                Some(Self { kind: Kind::MexicanHat, peak_rad: SQRT_2, reach: 3.2 })
            }
            Wavelet::Haar | Wavelet::Daubechies(1) | Wavelet::Biorthogonal(1, 1) => {
                // sin²x/x is largest where tan x = 2x, x = ω/4.
                let x = (0..60).fold(1.165_f64, |x, _| (2.0 * x).atan());
                let largest = x.sin().powi(2) / x;
                Some(Self { kind: Kind::Haar { largest }, peak_rad: 4.0 * x, reach: 0.5 })
            }
            Wavelet::Daubechies(order) => Some(Self::of_bank(&FilterBank::daubechies(order)?)),
            Wavelet::Biorthogonal(synthesis, analysis) => {
                let has_energy = analysis + 1 >= synthesis && (synthesis, analysis) != (2, 1);
                let has_energy = has_energy && (synthesis, analysis) != (3, 1);
                let bank = FilterBank::spline(synthesis, analysis).filter(|_| has_energy)?;
                Some(Self::of_bank(&bank))
            }
            Wavelet::NineSeven => Some(Self::of_bank(&FilterBank::nine_seven())),
        }
    }

    fn of_bank(bank: &FilterBank) -> Self {
        let (low, high) = (&bank.analysis_low, &bank.analysis_high);
        let (first, last) =
            (0.5 * (low.first + high.first) as f64, 0.5 * (low.last() + high.last()) as f64);
        let (middle, length) = (0.5 * (first + last), last - first);
        let n_low = low.taps.len() as f64;
        // Fine enough for the scaling function, where that is longer, and for the bend of the maximum.
        let n_cycles = ceil_index(length.max(n_low)).max(8);
        let n_places = PLACES_A_CYCLE * n_cycles;
        let mut table = Table { step_rad: TAU / n_places as f64, values: Vec::new() };
        let scaling = scaling_table(low, 0.5 * table.step_rad, n_places * MAX_CYCLES);
        let centre = 0.5 * (low.first + low.last()) as f64;
        let wavelet = |(i, phi): (usize, &Complex<f64>)| {
            // v = ω/2; both factors about their own middles, so that the product is about ψ's.
            let v = 0.5 * table.step_rad * i as f64;
            phi * transfer(high, v, 2.0 * middle - centre)
        };
        table.values = scaling.iter().enumerate().map(wavelet).collect();
        let (peak_rad, largest) = table.peak();
        let shift = table.centroid();
        for (i, value) in table.values.iter_mut().enumerate() {
            let omega = table.step_rad * i as f64;
            *value *= Complex::from_polar(1.0 / largest, omega * shift);
        }
        Self { kind: Kind::Table(table), peak_rad, reach: 0.5 * length + shift.abs() }
    }

    /// ω at which |ψ̂| is 1, rad; a scale a stands for the frequency ω/(2πa).
    #[must_use]
    pub fn peak_rad(&self) -> f64 {
        self.peak_rad
    }

    /// Half width of ψ about time 0, in units of the scale.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// ψ̂(ω), ω ≥ 0; beyond the table (512·2π) 0.
    #[must_use]
    pub fn at(&self, omega: f64) -> Complex<f64> {
        match &self.kind {
            Kind::MexicanHat => {
                // ω²/2·e^(1 − ω²/2): 1 at √2.
                let half = 0.5 * omega * omega;
                Complex::new(half * (1.0 - half).exp(), 0.0)
            }
            Kind::Haar { largest } => {
                let x = 0.25 * omega;
                let value = if x > 0.0 { x.sin().powi(2) / x } else { 0.0 };
                // +1 before 0 and −1 behind it: ψ is odd.
                Complex::new(0.0, value / largest)
            }
            Kind::Table(table) => table.at(omega),
        }
    }
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shape")
            .field("peak_rad", &self.peak_rad)
            .field("reach", &self.reach)
            .finish_non_exhaustive()
    }
}

/// H(ω)·e^(jω·centre), H = Σ taps·e^(−jωn)/√2.
fn transfer(taps: &Taps, omega: f64, centre: f64) -> Complex<f64> {
    let step = Complex::from_polar(1.0, -omega);
    let sum = taps.taps.iter().rev().fold(Complex::new(0.0, 0.0), |sum, tap| sum * step + tap);
    sum * Complex::from_polar(FRAC_1_SQRT_2, omega * (centre - taps.first as f64))
}

/// φ̂ at i·step about the middle of φ: Π_j H(ω/2^j), each place from one at half its frequency.
fn scaling_table(low: &Taps, step_rad: f64, n: usize) -> Vec<Complex<f64>> {
    let centre = 0.5 * (low.first + low.last()) as f64;
    let mut table: Vec<Complex<f64>> = Vec::with_capacity(n);
    for i in 0..n {
        let omega = step_rad * i as f64;
        let value = if i < 64 {
            // 60 halvings: what is left differs from 1 by less than rounding.
            (1..=60).map(|j| transfer(low, omega / 2f64.powi(j), centre)).product()
        } else {
            let half = i / 2;
            let below = if i.is_multiple_of(2) {
                table[half]
            } else {
                // Six points: 1e-9, so that errors do not grow over the octaves.
                let [a, b, c] = [(2, 3), (1, 2), (0, 1)]
                    .map(|(before, behind)| table[half - before] + table[half + behind]);
                (a * 3.0 - b * 25.0 + c * 150.0) / 256.0
            };
            below * transfer(low, 0.5 * omega, centre)
        };
        table.push(value);
    }
    table
}

impl Table {
    /// Cubic interpolation.
    fn at(&self, omega: f64) -> Complex<f64> {
        let place = omega / self.step_rad;
        let i = floor_index(place);
        let Some([b, c, d]) = self.values.get(i..).and_then(|rest| rest.first_chunk::<3>()) else {
            return Complex::new(0.0, 0.0);
        };
        // ψ is real: ψ̂(−ω) = ψ̂*(ω).
        let a = if i == 0 { c.conj() } else { self.values[i - 1] };
        let t = place - i as f64;
        let weights = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        a * weights[0] + b * weights[1] + c * weights[2] + d * weights[3]
    }

    /// ω and |ψ̂| of the maximum, between places by a parabola.
    fn peak(&self) -> (f64, f64) {
        let square = |i: usize| self.values[i].norm_sqr();
        let last = self.values.len() - 1;
        let top = (1..last).max_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or(1);
        let (a, b, c) = (square(top - 1), square(top), square(top + 1));
        let bend = a - 2.0 * b + c;
        let offset = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
        let largest = (b - 0.25 * (a - c) * offset).sqrt();
        ((top as f64 + offset) * self.step_rad, largest)
    }

    /// ∫t|ψ|²dt/∫|ψ|²dt from the phase's slope.
    fn centroid(&self) -> f64 {
        let (mut sum, mut energy) = (0.0, 0.0);
        for pair in self.values.windows(2) {
            let product = pair[1] * pair[0].conj();
            // |ψ̂|²·Δphase, as Im of neighbours' product: the phase turns little from place to place.
            sum -= product.im;
            energy += product.re;
        }
        if energy > 0.0 { sum / (energy * self.step_rad) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABULATED: [Wavelet; 6] = [
        Wavelet::Daubechies(2),
        Wavelet::Daubechies(6),
        Wavelet::Daubechies(10),
        Wavelet::Biorthogonal(2, 4),
        Wavelet::Biorthogonal(3, 5),
        Wavelet::NineSeven,
    ];

    #[test]
    fn the_maximum_is_one_at_the_peak() {
        for wavelet in [Wavelet::MexicanHat, Wavelet::Haar].into_iter().chain(TABULATED) {
            let shape = Shape::new(wavelet).unwrap();
            let peak = shape.at(shape.peak_rad()).norm();
            // The tables: cubic interpolation and a parabola through three places.
            assert!((peak - 1.0).abs() < 1e-5, "{wavelet:?}: {peak}");
            for k in 0..4000 {
                let value = shape.at(k as f64 * 0.01).norm();
                assert!(value <= 1.0 + 1e-5, "{wavelet:?}");
            }
        }
    }

    #[test]
    fn no_wavelet_sees_a_constant() {
        for wavelet in [Wavelet::MexicanHat, Wavelet::Haar].into_iter().chain(TABULATED) {
            assert!(Shape::new(wavelet).unwrap().at(0.0).norm() < 1e-11, "{wavelet:?}");
        }
    }

    /// Π H(ω/2^j) with a factor each, against the table.
    #[test]
    fn tables_are_the_infinite_product() {
        for wavelet in TABULATED {
            let bank = match wavelet {
                Wavelet::Daubechies(n) => FilterBank::daubechies(n).unwrap(),
                Wavelet::Biorthogonal(s, a) => FilterBank::spline(s, a).unwrap(),
                Wavelet::NineSeven | Wavelet::MexicanHat | Wavelet::Haar => {
                    FilterBank::nine_seven()
                }
            };
            let product = |omega: f64| {
                let low: Complex<f64> = (2..60)
                    .map(|j| transfer(&bank.analysis_low, omega / 2f64.powi(j), 0.0))
                    .product();
                (transfer(&bank.analysis_high, 0.5 * omega, 0.0) * low).norm()
            };
            let shape = Shape::new(wavelet).unwrap();
            let largest = product(shape.peak_rad());
            for k in 1..400 {
                let omega = 0.317 * k as f64;
                let (found, right) = (shape.at(omega).norm(), product(omega) / largest);
                assert!((found - right).abs() < 2e-5, "{wavelet:?} {omega}: {found} {right}");
            }
        }
    }

    #[test]
    fn the_table_of_haar_is_its_closed_form() {
        let table = Shape::of_bank(&FilterBank::daubechies(1).unwrap());
        let closed = Shape::new(Wavelet::Haar).unwrap();
        // A parabola through three places, 0.02 rad apart.
        assert!((table.peak_rad() / closed.peak_rad() - 1.0).abs() < 1e-5);
        for k in 0..2000 {
            let omega = 0.1 * k as f64;
            assert!((table.at(omega) - closed.at(omega)).norm() < 2e-5, "{omega}");
        }
    }

    #[test]
    fn symmetric_wavelets_have_their_centre_at_zero() {
        // Linear phase: ψ̂ real or imaginary everywhere.
        for wavelet in [Wavelet::Biorthogonal(2, 4), Wavelet::NineSeven] {
            let shape = Shape::new(wavelet).unwrap();
            for k in 1..300 {
                assert!(shape.at(0.1 * k as f64).im.abs() < 1e-4, "{wavelet:?}, {k}");
            }
        }
        for wavelet in [Wavelet::Biorthogonal(1, 3), Wavelet::Biorthogonal(3, 5)] {
            let shape = Shape::new(wavelet).unwrap();
            for k in 1..300 {
                assert!(shape.at(0.1 * k as f64).re.abs() < 1e-4, "{wavelet:?}, {k}");
            }
        }
    }

    #[test]
    fn what_is_no_wavelet_has_no_shape() {
        for (synthesis, analysis) in [(3, 1), (2, 1), (0, 2), (4, 2), (5, 1)] {
            assert!(Shape::new(Wavelet::Biorthogonal(synthesis, analysis)).is_none());
        }
        assert!(Shape::new(Wavelet::Daubechies(0)).is_none());
    }
}
