//! Which band an envelope should be taken of: kurtogram and infogram.
//!
//! The kurtogram finds the band with the most impulsive envelope, the infogram the one whose envelope
//! is most ordered in time and in cyclic frequency; a single knock moves the first, not the second's
//! spectral half. Must not know what makes the impulses.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use realfft::RealToComplex;
use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::filter_bank::Band;
use crate::dsp::filter_bank::FilterBank;
use crate::dsp::power_sums::PowerSums;
use crate::dsp::real::Real;

/// Kurtosis of the complex envelope of every band of a tree (D44; Antoni 2007).
///
/// The bands are cut out of the shared spectrum with straight edges, so the tree has no error of a
/// filter's own, and every envelope is sampled at twice its band: the figures are those of the
/// continuous envelope of the periodic record.
#[derive(Debug)]
pub struct KurtogramPlan<T: Real> {
    bank: FilterBank<T>,
}

impl<T: Real> KurtogramPlan<T> {
    /// Plans for the spectra of `n` samples: bands down to Nyquist/2^`depth`, inside the bins `usable`,
    /// each with at least [`crate::dsp::filter_bank::MIN_BINS`] bins.
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, depth: u32, usable: Range<usize>, cache: &mut FftCache<T>) -> Self {
        Self { bank: FilterBank::new(n, depth, usable, cache) }
    }

    /// The bands, broad ones first.
    #[must_use]
    pub fn bands(&self) -> &[Band] {
        self.bank.bands()
    }

    /// Writes ⟨|z|⁴⟩/⟨|z|²⟩² − 2 of each band.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), any unit. `out`: as many values as
    /// bands. Gaussian noise has 0 with a scatter of 2/√(bins), a sine −1, impulses at a part p of the
    /// time about 2/p. `None` where the band holds nothing but rounding (in f32, bins 120 dB below
    /// the mean power of a bin).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Option<f64>]) {
        assert_eq!(out.len(), self.bands().len(), "one value a band");
        self.bank.for_each(x_hat, |index, _, envelope| {
            out[index] = envelope.map(|envelope| {
                let PowerSums { second, fourth } = envelope.sums;
                fourth * envelope.re.len() as f64 / (second * second) - 2.0
            });
        });
    }
}

/// The band with the largest value; the broader of two alike.
#[must_use]
pub fn best_band(bands: &[Band], values: &[Option<f64>]) -> Option<(Band, f64)> {
    let pairs = bands.iter().zip(values).filter_map(|(band, value)| Some((*band, (*value)?)));
    pairs.fold(None, |best: Option<(Band, f64)>, pair| match best {
        Some(best) if best.1 >= pair.1 => Some(best),
        _ => Some(pair),
    })
}

/// Negentropies of the squared envelope of every band and of its spectrum (D45; Antoni 2016).
pub struct InfogramPlan<T: Real> {
    bank: FilterBank<T>,
    /// By length of the envelope, rising.
    forwards: Vec<Arc<dyn RealToComplex<T>>>,
    e2: Vec<T>,
    spectrum: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

/// Information in a band's squared envelope, nats; 0 for a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Negentropy {
    /// Of the envelope over time: impulses. Gaussian noise 1 − γ = 0.423.
    pub time: f64,
    /// Of the envelope's spectrum over cyclic frequency: what repeats. Gaussian noise in a band with
    /// straight edges ½ − γ + ln 2 = 0.616.
    pub cyclic: f64,
}

impl Negentropy {
    /// The mean of both: impulsive and repeating.
    #[must_use]
    pub fn mean(&self) -> f64 {
        0.5 * (self.time + self.cyclic)
    }
}

impl<T: Real> InfogramPlan<T> {
    /// Plans for the spectra of `n` samples, with the bands of [`KurtogramPlan::new`].
    ///
    /// # Panics
    ///
    /// If `n` is 0.
    #[must_use]
    pub fn new(n: usize, depth: u32, usable: Range<usize>, cache: &mut FftCache<T>) -> Self {
        let bank = FilterBank::new(n, depth, usable, cache);
        let mut lengths: Vec<usize> = bank.lengths().collect();
        lengths.sort_unstable();
        lengths.dedup();
        let longest = lengths.last().copied().unwrap_or(0);
        let forwards: Vec<_> = lengths.iter().map(|n| cache.real_forward(*n)).collect();
        let n_scratch = forwards.iter().map(|plan| plan.get_scratch_len()).max().unwrap_or(0);
        Self {
            e2: vec![T::zero(); longest],
            spectrum: vec![Complex::zero(); fft::n_bins(longest)],
            scratch: vec![Complex::zero(); n_scratch],
            bank,
            forwards,
        }
    }

    /// The bands, broad ones first.
    #[must_use]
    pub fn bands(&self) -> &[Band] {
        self.bank.bands()
    }

    /// Writes the negentropies of each band.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), any unit. `out`: as many values as
    /// bands; `None` where the band holds nothing but rounding, or an envelope without any course.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Option<Negentropy>]) {
        assert_eq!(out.len(), self.bands().len(), "one value a band");
        let Self { bank, forwards, e2, spectrum, scratch } = self;
        bank.for_each(x_hat, |index, band, envelope| {
            out[index] = envelope.and_then(|envelope| {
                let length = envelope.re.len();
                let scale = T::rounded(length as f64 / envelope.sums.second);
                for (places, first, step) in envelope.runs() {
                    let parts = envelope.re[places.clone()].iter().zip(&envelope.im[places]);
                    for (e2, (re, im)) in e2[first..length].iter_mut().step_by(step).zip(parts) {
                        *e2 = (*re * *re + *im * *im) * scale;
                    }
                }
                let at = forwards.binary_search_by_key(&length, |plan| plan.len()).ok()?;
                let spectrum = &mut spectrum[..fft::n_bins(length)];
                of_envelope(&mut e2[..length], band.n_bins(), &*forwards[at], spectrum, scratch)
            });
        });
    }
}

/// Both negentropies of a squared envelope of mean 1, of a band of `n_bins`; overwrites it.
fn of_envelope<T: Real>(
    e2: &mut [T],
    n_bins: usize,
    forward: &dyn RealToComplex<T>,
    spectrum: &mut [Complex<T>],
    scratch: &mut [Complex<T>],
) -> Option<Negentropy> {
    let time = negentropy(e2)?;
    e2.iter_mut().for_each(|e2| *e2 -= T::one());
    let done = forward.process_with_scratch(e2, spectrum, scratch);
    debug_assert!(done.is_ok(), "lengths are the plan's own");
    // What rounding of the envelope alone would leave in a bin.
    let least = (T::EPSILON * e2.len() as f64).powi(2);
    // e² has content below the width of its band; the rest of the bins is empty.
    let power = &mut e2[..n_bins - 1];
    for (power, bin) in power.iter_mut().zip(&spectrum[1..]) {
        *power = bin.norm_sqr();
    }
    let mean = power.iter().map(|p| p.to_f64()).sum::<f64>() / power.len() as f64;
    if mean <= least {
        return None;
    }
    let scale = T::rounded(1.0 / mean);
    power.iter_mut().for_each(|p| *p *= scale);
    Some(Negentropy { time, cyclic: negentropy(power)? })
}

impl<T: Real> fmt::Debug for InfogramPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("InfogramPlan").field("bank", &self.bank).finish_non_exhaustive()
    }
}

/// Values summed in `T` before the sum goes on in f64.
const BLOCK: usize = 256;

/// ⟨v·ln v⟩ of values v ≥ 0 of mean 1, after division by the mean they have; `None` if that is 0.
fn negentropy<T: Real>(values: &[T]) -> Option<f64> {
    let (mut sum, mut entropy) = (0.0, 0.0);
    for block in values.chunks(BLOCK) {
        let (mut block_sum, mut block_entropy) = (T::zero(), T::zero());
        for value in block {
            block_sum += *value;
            // v·ln v → 0 for v → 0.
            if *value > T::zero() {
                block_entropy += *value * value.natural_log();
            }
        }
        sum += block_sum.to_f64();
        entropy += block_entropy.to_f64();
    }
    let mean = sum / values.len() as f64;
    (mean > 0.0).then(|| entropy / sum - mean.ln())
}

#[cfg(test)]
#[path = "kurtogram_tests.rs"]
mod tests;
