//! Evidence of lines: power over the background, and what it says for and against a line (D71).

use rustfft::num_complex::Complex;

use super::CombOrder;
use super::SpeedSearch;
use crate::dsp::fft;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;
use crate::dsp::stats;

/// Bins of a zero-padded spectrum over which one background is taken.
const BLOCK: usize = 128;

/// Mean power of a line over the background, least and most: equally probable per factor between them.
const LEAST: f64 = 4.0;
const MOST: f64 = 1e8;

/// A bin above this is no background: e⁻¹⁰ = 5·10⁻⁵ of noise.
const FOREIGN: f64 = 10.0;

/// Share of bins that hold foreign lines: at least and at most this much is reckoned with.
const FOREIGN_SHARE: (f64, f64) = (0.003, 0.3);

/// Padded bins from a peak at which the side lobes begin, and to which they are followed.
const FIRST_LOBE: usize = 4;
const LAST_LOBE: usize = 200;

/// Background and evidence of one spectrum.
#[derive(Debug)]
pub(in crate::dsp) struct Evidence {
    bin_hz: f64,
    /// Bins the orders can fall on.
    first: usize,
    last: usize,
    power: Vec<f64>,
    ratio: Vec<f64>,
    leak: Vec<f64>,
    /// Twice the power of a Hann window's side lobes, by padded bins from the peak.
    lobes: Vec<f64>,
    block: Vec<f64>,
    floors: Vec<f64>,
}

impl Evidence {
    /// Plans for spectra of `n_padded` samples, Hann-weighted, mean removed, padded about twice.
    pub(in crate::dsp) fn new(n_padded: usize, fs_hz: f64, search: &SpeedSearch) -> Self {
        let bin_hz = fs_hz / n_padded as f64;
        let lowest = search.orders.first().map_or(1.0, |o| o.order) * search.low_hz;
        let highest = search.last_order() * search.high_hz;
        // Nyquist and the bin beside it are no exponential variables.
        let top = fft::n_bins(n_padded).saturating_sub(3);
        let last = ceil_index(highest / bin_hz).saturating_add(1).min(top);
        let first = floor_index(lowest / bin_hz).min(last);
        let n = last + 1;
        Self {
            bin_hz,
            first,
            last,
            power: vec![0.0; n],
            ratio: vec![0.0; n],
            leak: vec![0.0; n],
            lobes: (0..LAST_LOBE).map(lobe).collect(),
            block: Vec::with_capacity(BLOCK),
            floors: vec![0.0; n.div_ceil(BLOCK)],
        }
    }

    /// Reads a spectrum; `false` if it has no background.
    pub(in crate::dsp) fn read<T: Real>(&mut self, x_hat: &[Complex<T>]) -> bool {
        for (power, value) in self.power.iter_mut().zip(x_hat) {
            *power = value.norm_sqr().to_f64();
        }
        if !self.measure_floors() {
            return false;
        }
        for k in 0..self.power.len() {
            self.power[k] /= self.floor_at(k);
        }
        self.discount_lobes();
        let used = &self.power[self.first..];
        let n_foreign = used.iter().filter(|power| **power > FOREIGN).count();
        let share = n_foreign as f64 / used.len() as f64;
        let foreign = share.clamp(FOREIGN_SHARE.0, FOREIGN_SHARE.1);
        for (ratio, power) in self.ratio.iter_mut().zip(&self.power) {
            let line = line_density(*power);
            *ratio = line / ((1.0 - foreign) * (-power).exp() + foreign * line);
        }
        true
    }

    /// Leaves the peaks of lines only: the side lobes of strong ones count as background, and what is
    /// further than a bin of the padded spectrum from a peak is the slope of one.
    fn discount_lobes(&mut self) {
        self.leak.fill(0.0);
        let n = self.power.len();
        let is_peak = |power: &[f64], k: usize| {
            let below = k.checked_sub(1).map_or(0.0, |k| power[k]);
            power[k] >= below && power[k] >= power.get(k + 1).copied().unwrap_or(0.0)
        };
        for k in (0..n).filter(|k| is_peak(&self.power, *k)) {
            for offset in FIRST_LOBE..LAST_LOBE {
                let leaked = self.power[k] * self.lobes[offset];
                if leaked < 0.1 {
                    break;
                }
                for place in [k.checked_sub(offset), Some(k + offset)] {
                    if let Some(leak) = place.and_then(|place| self.leak.get_mut(place)) {
                        *leak += leaked;
                    }
                }
            }
        }
        for k in 0..n {
            let near = k.saturating_sub(1)..(k + 2).min(n);
            let is_line = near.clone().any(|k| is_peak(&self.power, k));
            let power = self.power[k] / (1.0 + self.leak[k]);
            self.leak[k] = if is_line { power } else { power.min(1.0) };
        }
        std::mem::swap(&mut self.power, &mut self.leak);
    }

    /// Background of each block: its median power over ln 2, the mean of an exponential variable.
    fn measure_floors(&mut self) -> bool {
        let mut highest = 0.0;
        for (floor, block) in self.floors.iter_mut().zip(self.power.chunks(BLOCK)) {
            self.block.clear();
            self.block.extend_from_slice(block);
            *floor = stats::median(&mut self.block).unwrap_or(0.0) / std::f64::consts::LN_2;
            highest = f64::max(highest, *floor);
        }
        // A block without any background (a filter's stop band, or silence) takes what rounding would be.
        for floor in &mut self.floors {
            *floor = floor.max(1e-12 * highest);
        }
        highest > 0.0 && highest.is_finite()
    }

    /// Background at a bin, linear between the middles of the blocks.
    fn floor_at(&self, k: usize) -> f64 {
        let place = ((k as f64 + 0.5) / BLOCK as f64 - 0.5).max(0.0);
        let below = floor_index(place).min(self.floors.len() - 1);
        let above = (below + 1).min(self.floors.len() - 1);
        let share = (place - below as f64).min(1.0);
        self.floors[below] + share * (self.floors[above] - self.floors[below])
    }

    fn bin_of(&self, f_hz: f64) -> Option<usize> {
        let k = floor_index(f_hz / self.bin_hz + 0.5);
        (k <= self.last).then_some(k)
    }

    /// Frequency and power over the background of the highest bin within two of a frequency; `None`
    /// above the bins read.
    pub(in crate::dsp) fn peak_near(&self, f_hz: f64) -> Option<(f64, f64)> {
        let k = self.bin_of(f_hz)?;
        let near = k.saturating_sub(2)..(k + 3).min(self.power.len());
        let higher = |a: usize, b: usize| if self.power[b] > self.power[a] { b } else { a };
        let peak = near.fold(k, higher);
        Some((peak as f64 * self.bin_hz, self.power[peak]))
    }

    /// Mean power of the background at a frequency, |X|²; `None` above the bins read.
    pub(in crate::dsp) fn background_at(&self, f_hz: f64) -> Option<f64> {
        self.bin_of(f_hz).map(|k| self.floor_at(k))
    }

    /// Logarithm of how much more probable the spectrum is with the orders of `speed_hz` than without.
    pub(in crate::dsp) fn score(&self, speed_hz: f64, orders: &[CombOrder]) -> f64 {
        let mut score = 0.0;
        for o in orders {
            let Some(k) = self.bin_of(o.order * speed_hz) else { break };
            score += (1.0 - o.presence + o.presence * self.ratio[k]).ln();
        }
        score
    }
}

/// Twice the envelope 1/(πd(d² − 1)) of the side lobes squared, d in bins, half a padded bin nearer: the
/// peak is between two.
fn lobe(offset: usize) -> f64 {
    let d = 0.5 * (offset as f64 - 0.5);
    if offset < FIRST_LOBE {
        return 0.0;
    }
    2.0 / (std::f64::consts::PI * d * (d * d - 1.0)).powi(2)
}

/// Density of the power of a line whose mean power u is log-uniform: ∫e^(−s/u)/u·du/u over its range.
fn line_density(power: f64) -> f64 {
    let s = power.clamp(1e-9, MOST);
    ((-s / MOST).exp() - (-s / LEAST).exp()) / (s * (MOST / LEAST).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_of_a_line_is_one() {
        // Trapezia over ln s: 0.01 wide, error 1e-5; what lies outside is below 1e-7.
        let sum: f64 = (-2000..2200)
            .map(|i| (0.01 * f64::from(i)).exp())
            .map(|s| if s > MOST { 0.0 } else { line_density(s) * s * 0.01 })
            .sum();
        // Powers above the largest mean are cut: e⁻¹ of the last factor of e, of 17 in all.
        assert!((sum - 1.0).abs() < 0.04, "{sum}");
        assert!(line_density(0.0).is_finite() && line_density(1e300).is_finite());
    }
}
