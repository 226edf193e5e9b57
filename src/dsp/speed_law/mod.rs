//! What turns a shaft's 1× vector with its speed: the part of a bow, the part of an unbalance.
//!
//! A shaft that is bent by b, or whose surface runs out by b, shows b when it turns slowly; an unbalance of eccentricity
//! e shows e·r²/(1 − r²), r the speed over the critical one. Resonance raises the bow with it: b/(1 − r²). From vectors at
//! several speeds both parts follow by least squares, and each is tested by leaving it out. One vector at one speed cannot
//! tell them. Where no mark gives the vectors a phase, their lengths tell the same with one unknown more (`lengths`). Must not
//! know where the vectors come from, nor how large a part matters.

mod lengths;

use rustfft::num_complex::Complex;

/// Speed at which the part of the unbalance is stated, Hz.
pub const REFERENCE_HZ: f64 = 10.0;

/// Vectors are used up to this part of the critical speed: nearer, damping and the rate of the run-up decide.
pub const HIGHEST_RATIO: f64 = 0.7;

/// Fewest vectors, and fewest times the highest speed must be the lowest.
const FEWEST: usize = 6;
const FEWEST_TIMES: f64 = 1.5;

/// A declared critical speed is true to 10 %: an impact test at rest knows no gyroscopic moments.
const NEAR: [f64; 5] = [1.0, 0.95, 1.05, 0.9, 1.1];

/// Critical speeds tried where none is declared, from the lowest that [`HIGHEST_RATIO`] allows: steps, and their ratio.
const STEPS: i32 = 14;
const STEP: f64 = 1.2;

/// A critical speed is implausible if chance lets it fit so much worse than the best no oftener.
pub const IMPLAUSIBLE: f64 = 5e-4;

/// A 1× vector at a speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorAt {
    /// Speed, Hz: the root mean square over what was measured.
    pub speed_hz: f64,
    /// A·e^(jφ), φ the lag behind a mark on the shaft.
    pub vector: Complex<f64>,
    /// Reciprocal variance, to a factor that all vectors share.
    pub weight: f64,
}

/// What is known of the vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Known {
    /// Length and phase behind a mark on the shaft.
    Vectors,
    /// The length alone: the speed was measured without a mark.
    Lengths,
}

/// A part of the vectors and its uncertainty. By lengths alone the bow's lag is stated as 0 and the unbalance's is that between the two,
/// of which the sense is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Its vector; of an unbalance that at [`REFERENCE_HZ`] without resonance.
    pub vector: Complex<f64>,
    /// Standard deviation along any direction.
    pub sigma: f64,
    /// Probability that chance alone makes it so necessary: of leaving it out (D78).
    pub chance: f64,
}

/// Both parts by one critical speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The critical speed, Hz; infinite: far above.
    pub critical_hz: f64,
    /// What is there at standstill.
    pub bow: Part,
    /// What rises with the square of the speed.
    pub unbalance: Part,
    /// Root mean square of what neither explains, over that of the vectors.
    pub unexplained: f64,
}

impl Fit {
    /// Amplitude of the bow's part at a speed below the critical one, and its standard deviation.
    #[must_use]
    pub fn bow_at(&self, speed_hz: f64) -> (f64, f64) {
        let (bow, _) = shapes(speed_hz, self.critical_hz);
        (self.bow.vector.norm() * bow, self.bow.sigma * bow)
    }

    /// Amplitude of both parts together at a speed; `None` from [`HIGHEST_RATIO`] of the critical speed on, as nothing is known there.
    #[must_use]
    pub fn whole_at(&self, speed_hz: f64) -> Option<f64> {
        let (bow, unbalance) = shapes(speed_hz, self.critical_hz);
        let whole = self.bow.vector * bow + self.unbalance.vector * unbalance;
        (speed_hz <= HIGHEST_RATIO * self.critical_hz).then(|| whole.norm())
    }

    /// Amplitude of the unbalance's part at a speed below the critical one, and its standard deviation.
    #[must_use]
    pub fn unbalance_at(&self, speed_hz: f64) -> (f64, f64) {
        let (_, unbalance) = shapes(speed_hz, self.critical_hz);
        (self.unbalance.vector.norm() * unbalance, self.unbalance.sigma * unbalance)
    }
}

/// What the vectors of a run say.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedLaw {
    /// A fit for every critical speed that the vectors allow, the best first; never empty.
    pub fits: Vec<Fit>,
    /// Vectors used.
    pub n_vectors: usize,
    /// Lowest and highest speed of these, Hz.
    pub speeds_hz: (f64, f64),
    /// What was known of them.
    pub known: Known,
}

/// Fits both parts at one critical speed; gives the weighted sum of squares left, too.
type FitAt = fn(&[VectorAt], f64) -> Option<(f64, Fit)>;

/// How bow and unbalance show at a speed, each 1 at its reference without resonance.
fn shapes(speed_hz: f64, critical_hz: f64) -> (f64, f64) {
    let raised = 1.0 / (1.0 - (speed_hz / critical_hz).powi(2));
    (raised, raised * (speed_hz / REFERENCE_HZ).powi(2))
}

/// Reads the parts of bow and unbalance from vectors at several speeds, in any order: by themselves (D78) or by their lengths (D79).
///
/// `critical_hz`: declared critical speed, taken as true to 10 %; without one every critical speed above 1.4 times the
/// highest speed is tried. `None` below six vectors, where the highest speed is not 1.5 times the lowest, or where the
/// vectors are all zero.
#[must_use]
pub fn speed_law(vectors: &[VectorAt], known: Known, critical_hz: Option<f64>) -> Option<SpeedLaw> {
    let highest = critical_hz.map_or(f64::INFINITY, |critical| HIGHEST_RATIO * critical);
    let is_used = |v: &&VectorAt| v.speed_hz > 0.0 && v.speed_hz <= highest && v.weight > 0.0;
    let used: Vec<VectorAt> = vectors.iter().filter(is_used).copied().collect();
    let speeds = used.iter().map(|v| v.speed_hz);
    let low = speeds.clone().fold(f64::INFINITY, f64::min);
    let high = speeds.fold(0.0, f64::max);
    if used.len() < FEWEST || high < FEWEST_TIMES * low {
        return None;
    }
    let (fit, exponent): (FitAt, f64) = match known {
        Known::Vectors => (fit, exponent(used.len())),
        Known::Lengths => (lengths::fit, lengths::exponent(used.len())),
    };
    let mut fits: Vec<(f64, Fit)> =
        candidates(high, critical_hz).filter_map(|critical| fit(&used, critical)).collect();
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = fits.first()?.0;
    fits.retain(|(rest, _)| chance(least, *rest, exponent) > IMPLAUSIBLE);
    let fits: Vec<Fit> = fits.into_iter().map(|(_, fit)| fit).collect();
    Some(SpeedLaw { fits, n_vectors: used.len(), speeds_hz: (low, high), known })
}

/// The critical speeds to be tried.
fn candidates(high_hz: f64, declared_hz: Option<f64>) -> impl Iterator<Item = f64> {
    let near = declared_hz.into_iter().flat_map(|hz| NEAR.map(|factor| factor * hz));
    let n = if declared_hz.is_some() { 0 } else { STEPS };
    let far = (0..n).map(move |i| high_hz / HIGHEST_RATIO * STEP.powi(i));
    near.chain(far).chain(declared_hz.is_none().then_some(f64::INFINITY))
}

/// Probability that two more real unknowns take the sum of squares from `without` to `with` by chance: the F test of
/// 2 and twice `exponent` degrees, whose tail is a power (D78).
fn chance(with: f64, without: f64, exponent: f64) -> f64 {
    if without > 0.0 { (with / without).min(1.0).powf(exponent) } else { 1.0 }
}

/// Half the degrees of freedom that four real unknowns leave of n vectors.
fn exponent(n: usize) -> f64 {
    n as f64 - 2.0
}

/// Least squares of both parts at one critical speed, with the weighted sum of squares they leave.
fn fit(vectors: &[VectorAt], critical_hz: f64) -> Option<(f64, Fit)> {
    let (mut bb, mut bu, mut uu, mut all) = (0.0, 0.0, 0.0, 0.0);
    let (mut b, mut u) = (Complex::new(0.0, 0.0), Complex::new(0.0, 0.0));
    let shaped = |v: &VectorAt| shapes(v.speed_hz, critical_hz);
    for v in vectors {
        let (bow, unbalance) = shaped(v);
        bb += v.weight * bow * bow;
        bu += v.weight * bow * unbalance;
        uu += v.weight * unbalance * unbalance;
        b += v.vector * (v.weight * bow);
        u += v.vector * (v.weight * unbalance);
        all += v.weight * v.vector.norm_sqr();
    }
    let determinant = bb * uu - bu * bu;
    if !(determinant > 1e-9 * bb * uu && all > 0.0) {
        return None;
    }
    let rest = |bow: Complex<f64>, unbalance: Complex<f64>| -> f64 {
        let left = |v: &VectorAt| {
            let (of_bow, of_unbalance) = shaped(v);
            v.weight * (v.vector - bow * of_bow - unbalance * of_unbalance).norm_sqr()
        };
        vectors.iter().map(left).sum()
    };
    let zero = Complex::new(0.0, 0.0);
    let bow = (b * uu - u * bu) / determinant;
    let unbalance = (u * bb - b * bu) / determinant;
    let left = rest(bow, unbalance);
    let exponent = exponent(vectors.len());
    let variance = left / (2.0 * exponent);
    let part = |vector, of_other: f64, without: f64| Part {
        vector,
        sigma: (variance * of_other / determinant).sqrt(),
        chance: chance(left, without, exponent),
    };
    let fit = Fit {
        critical_hz,
        bow: part(bow, uu, rest(zero, u / uu)),
        unbalance: part(unbalance, bb, rest(b / bb, zero)),
        unexplained: (left / all).sqrt(),
    };
    Some((left, fit))
}

#[cfg(test)]
mod tests;
