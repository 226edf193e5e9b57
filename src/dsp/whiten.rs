//! Spectral whitening that limits discrete lines.
//!
//! Flattens resonances and transfer paths and suppresses the steady lines of shafts and gears, so
//! that what is left of an impact train decides the envelope. Must not know bearings or gears.

use rustfft::num_complex::Complex;

use crate::dsp::fft;
use crate::dsp::real::Real;
use crate::dsp::real::floor_index;
use crate::dsp::stats;

/// RMS of a Rayleigh magnitude (the bins of Gaussian noise) over its median: 1/√(ln 2).
const RMS_PER_MEDIAN: f64 = 1.201_122_408_786_449_8;

/// Divides each bin by the local noise level and limits what stands above it (D17).
///
/// The level is the median magnitude of blocks of 2·half-width bins, scaled to the RMS of noise,
/// linear between block centres: a line narrower than half a block does not move it.
#[derive(Debug)]
pub struct WhitenPlan<T: Real> {
    n: usize,
    clip: f64,
    squares: Vec<T>,
    levels: Vec<f64>,
}

impl<T: Real> WhitenPlan<T> {
    /// Plans for the spectra of `n` samples; levels over ± `half_width_bins` (at least 8), bins above
    /// `clip` (> 0) times the level are set to that limit, phase kept.
    ///
    /// # Panics
    ///
    /// If `n` is 0 or `clip` is not positive.
    #[must_use]
    pub fn new(n: usize, half_width_bins: usize, clip: f64) -> Self {
        assert!(n > 0 && clip > 0.0, "samples and a limit");
        let n_bins = fft::n_bins(n);
        let block = half_width_bins.max(8).saturating_mul(2).min(n_bins);
        let n_blocks = (n_bins / block).max(1);
        Self {
            n,
            clip,
            squares: Vec::with_capacity(n_bins.div_ceil(n_blocks)),
            levels: vec![0.0; n_blocks],
        }
    }

    /// Writes the whitened spectrum into `out` and returns the number of bins that were limited.
    ///
    /// `x_hat`: the spectrum of n samples ([`fft::ForwardPlan`]), any unit. `out`: as many bins,
    /// dimensionless: noise of any colour becomes noise of unit variance (|out|² = n on average).
    /// Where the level is 0 (no signal), the bins become 0.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x_hat: &[Complex<T>], out: &mut [Complex<T>]) -> usize {
        assert_eq!(x_hat.len(), fft::n_bins(self.n), "bins of the plan");
        assert_eq!(out.len(), x_hat.len(), "one bin per bin");
        let n_blocks = self.levels.len();
        for (block, level) in self.levels.iter_mut().enumerate() {
            // Blocks as equal as whole bins allow: no short one at the end with a scattered median.
            let first = block * x_hat.len() / n_blocks;
            let end = (block + 1) * x_hat.len() / n_blocks;
            self.squares.clear();
            self.squares.extend(x_hat[first..end].iter().map(|x| x.norm_sqr()));
            let median = stats::median(&mut self.squares);
            *level = median.map_or(0.0, |median| median.to_f64().sqrt() * RMS_PER_MEDIAN);
        }
        let unit = (self.n as f64).sqrt();
        let mut n_limited = 0;
        for (k, (out, x)) in out.iter_mut().zip(x_hat).enumerate() {
            let square = x.norm_sqr().to_f64();
            let level = self.level_at(k);
            let limit = self.clip * level;
            let gain = if level <= 0.0 {
                0.0
            } else if square > limit * limit {
                n_limited += 1;
                unit * self.clip / square.sqrt()
            } else {
                unit / level
            };
            *out = x.scale(T::rounded(gain));
        }
        n_limited
    }

    /// Interpolates the level at bin `k`; constant outside the first and last block centres.
    fn level_at(&self, k: usize) -> f64 {
        let n_bins = fft::n_bins(self.n) as f64;
        let position = (k as f64 + 0.5) * self.levels.len() as f64 / n_bins - 0.5;
        let last = self.levels.len() - 1;
        let below = floor_index(position.max(0.0)).min(last);
        let above = (below + 1).min(last);
        let fraction = (position - below as f64).clamp(0.0, 1.0);
        self.levels[below] + fraction * (self.levels[above] - self.levels[below])
    }
}

/// Half width of what a line of a transform without window covers, bins: beyond it less than a tenth of its height is
/// left.
const LINE_HALF_WIDTH: f64 = 3.0;

/// Most of the spectrum that lines at multiples may cover, to either side of each: more is no line any more.
const COVERED: f64 = 0.1;

/// Limits the bins of a whitened spectrum around all multiples of a rate to the noise (D82): what repeats with each
/// turn of a shaft is gone, what strikes at another rate stays but for the tenth of its lines, or less, that lie there.
///
/// `whitened`: [`WhitenPlan::process`]'s of `n` samples; `rate_bins`: the rate, bins (rate·n/f_s); `precision`: its
/// relative error, which widens the places of the higher multiples until they would cover a tenth to either side; there
/// it ends.
pub fn limit_multiples<T: Real>(
    whitened: &mut [Complex<T>],
    n: usize,
    rate_bins: f64,
    precision: f64,
) {
    let noise = (n as f64).sqrt();
    let mut centre = rate_bins;
    loop {
        let half_width = LINE_HALF_WIDTH + centre * precision;
        let top = centre + half_width;
        // Also ends where the rate is no number, or none.
        if !(half_width <= COVERED * rate_bins && top < whitened.len() as f64) {
            return;
        }
        for bin in &mut whitened[floor_index((centre - half_width).ceil())..=floor_index(top)] {
            let magnitude = bin.norm_sqr().to_f64().sqrt();
            if magnitude > noise {
                *bin = bin.scale(T::rounded(noise / magnitude));
            }
        }
        centre += rate_bins;
    }
}

#[cfg(test)]
mod tests {
    use rustfft::num_traits::Zero;

    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    fn spectrum<T: Real>(x: &[f64]) -> Vec<Complex<T>> {
        let mut forward = ForwardPlan::new(x.len(), &mut FftCache::new());
        let mut x_hat = vec![Complex::zero(); forward.n_bins()];
        forward.process(&narrow::<T>(x), &mut x_hat);
        x_hat
    }

    fn whitened<T: Real>(x: &[f64]) -> (Vec<Complex<T>>, usize) {
        let x_hat = spectrum::<T>(x);
        let mut out = vec![Complex::zero(); x_hat.len()];
        let n_limited = WhitenPlan::new(x.len(), 50, 4.0).process(&x_hat, &mut out);
        (out, n_limited)
    }

    /// Mean square of the time signal behind a spectrum, bins `range` only.
    fn power<T: Real>(bins: &[Complex<T>], n: usize) -> f64 {
        bins.iter().map(|x| x.norm_sqr().to_f64()).sum::<f64>() / bins.len() as f64 / n as f64
    }

    #[test]
    fn white_noise_stays_flat_at_unit_level() {
        let n = 20_000;
        let (out, n_limited) = whitened::<f32>(&gaussian_noise(n, 6));
        // A bin above 4 RMS has probability e^−16; 100 medians of 100 bins scatter by 10 % each.
        assert!(n_limited <= 1);
        for part in out.chunks_exact(2000) {
            assert!((power(part, n) - 1.0).abs() < 0.15, "{}", power(part, n));
        }
    }

    #[test]
    fn coloured_noise_becomes_flat() {
        // x[i] + x[i−1]: magnitude 2cos(πf/fs), a fall of 20 dB and more over the band.
        let n = 20_000;
        let white = gaussian_noise(n, 3);
        let coloured: Vec<f64> = (0..n).map(|i| white[i] + white[(i + n - 1) % n]).collect();
        let (out, _) = whitened::<f64>(&coloured);
        for part in out[..9000].chunks(1500) {
            assert!((power(part, n) - 1.0).abs() < 0.15, "{}", power(part, n));
        }
    }

    #[test]
    fn a_tone_is_limited_and_keeps_its_phase() {
        let n = 20_000;
        let x = sum(&[sine(n, n as f64, 3000.0, 10.0, 0.7), gaussian_noise(n, 12)]);
        let before = spectrum::<f64>(&x);
        let (out, n_limited) = whitened::<f64>(&x);
        assert!(before[3000].norm() > 500.0 * before[3001].norm().min(200.0));
        assert!(n_limited >= 1);
        // Set to four levels: 4·√n exactly.
        assert!((out[3000].norm() / (n as f64).sqrt() - 4.0).abs() < 1e-12);
        assert!((out[3000].arg() - before[3000].arg()).abs() < 1e-12);
        let (single, _) = whitened::<f32>(&x);
        // f32 FFT: 1e-7 of the largest line, 1e5, against a floor of 140.
        assert!((f64::from(single[3010].re) - out[3010].re).abs() < 0.1);
    }

    #[test]
    fn levels_reach_the_last_bin_whatever_the_lengths() {
        // 16-bin blocks in 1000 bins: 62 of them, none whole.
        for n in [1998, 1999, 2000, 2001] {
            let x_hat = spectrum::<f64>(&gaussian_noise(n, 17));
            let mut out = vec![Complex::zero(); x_hat.len()];
            WhitenPlan::new(n, 8, 4.0).process(&x_hat, &mut out);
            let top = power(&out[out.len() - 200..], n);
            // Twelve medians of 16 bins, each scattered by 25 %, and a bias of 1/median² of as much.
            assert!((top - 1.0).abs() < 0.3, "n = {n}: {top}");
        }
    }

    #[test]
    fn silence_and_tiny_records_stay_finite() {
        for x in [vec![0.0; 64], vec![2.0; 7], vec![1.0], vec![1.0, -1.0]] {
            let (out, _) = whitened::<f32>(&x);
            assert!(out.iter().all(|x| x.re.is_finite() && x.im.is_finite()));
        }
    }
    #[test]
    fn multiples_of_a_rate_come_down_to_the_noise_and_nothing_else_moves() {
        // 20 s at 1 kHz: a blow every 0.25 s (4 Hz, 80 bins) beside a line between its harmonics.
        let n = 20_000;
        let mut x = gaussian_noise(n, 3);
        for start in (0..n).step_by(250) {
            x[start] += 60.0;
        }
        let beside = sine(n, 1000.0, 42.0, 5.0, 0.3);
        let before: Vec<Complex<f64>> = spectrum(&sum(&[x, beside]));
        let mut white = vec![Complex::zero(); before.len()];
        WhitenPlan::new(n, 400, 10.0).process(&before, &mut white);
        let kept = white.clone();
        limit_multiples(&mut white, n, 80.0, 0.0);
        let noise = (n as f64).sqrt();
        for (k, (bin, was)) in white.iter().zip(&kept).enumerate() {
            let from_multiple = (k % 80).min(80 - k % 80);
            if from_multiple <= 3 && (77..9_997).contains(&k) {
                assert!(bin.norm() <= noise * (1.0 + 1e-12), "{k}");
            } else {
                assert_eq!(bin, was, "{k}");
            }
        }
        assert!(kept[800].norm() > 5.0 * noise && white[840].norm() > 5.0 * noise);
        // A rate that is known to 1 % only: up to the place where ± 5 bins more would cover too much.
        let mut vague = kept.clone();
        limit_multiples(&mut vague, n, 80.0, 0.01);
        assert!(vague[480].norm() <= noise * (1.0 + 1e-12) && vague[560] == kept[560]);
        for nothing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            limit_multiples(&mut vague.clone(), n, nothing, 0.0);
        }
    }
}
