//! Speed without a tacho: which speed's orders stand out of a spectrum, and how sure that is.
//!
//! [`CombSpeedPlan`] weighs every speed of a stated range by the evidence of its orders (shaft and mesh
//! harmonics) against the background, then reads the speed from the orders found. A comb that is not
//! there must not be found: the confidence is a posterior with "no comb" as the other hypothesis. Must not
//! know machines.

pub(in crate::dsp) mod evidence;
#[cfg(test)]
mod tests;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::line;
use crate::dsp::line::Line;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;
use evidence::Evidence;

/// An order a shaft may show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CombOrder {
    /// Times the shaft's speed.
    pub order: f64,
    /// Probability that the line stands out if the shaft is there, 0…1 exclusive.
    pub presence: f64,
}

/// Orders 1…`n` of a shaft, each less to be expected than the one before: 0.85ⁿ. What lacks the low
/// orders is then the comb of a faster shaft.
#[must_use]
pub fn shaft_orders(n: u32) -> Vec<CombOrder> {
    let order = |k: u32| CombOrder { order: f64::from(k), presence: 0.85_f64.powf(f64::from(k)) };
    (1..=n).map(order).collect()
}

/// Where a speed is looked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedSearch {
    /// Lowest speed, Hz.
    pub low_hz: f64,
    /// Highest speed, Hz.
    pub high_hz: f64,
    /// Orders looked for, ascending; those above Nyquist take no part.
    pub orders: Vec<CombOrder>,
}

impl SpeedSearch {
    /// Whether speeds and orders can be looked for in `n` samples at `fs_hz`: at least four revolutions,
    /// the highest speed below Nyquist.
    pub(in crate::dsp) fn is_possible(&self, n: usize, fs_hz: f64) -> bool {
        let is_order = |o: &CombOrder| {
            o.order > 0.0 && o.order.is_finite() && o.presence > 0.0 && o.presence < 1.0
        };
        let ascends = self.orders.windows(2).all(|pair| pair[1].order > pair[0].order);
        let first = self.orders.first().map_or(f64::NAN, |o| o.order);
        let in_range = self.low_hz > 0.0 && self.high_hz >= self.low_hz && fs_hz.is_finite();
        let enough = self.low_hz * first * n as f64 >= MIN_PERIODS * fs_hz;
        let below_nyquist = self.high_hz * first < 0.5 * fs_hz;
        in_range && enough && below_nyquist && ascends && self.orders.iter().all(is_order)
    }

    pub(in crate::dsp) fn last_order(&self) -> f64 {
        self.orders.last().map_or(1.0, |o| o.order)
    }
}

/// Periods of the lowest line a record must hold.
const MIN_PERIODS: f64 = 4.0;

/// Variance of a line's frequency by a Hann window, bins², times its power over the background: ½·Σw²t²·
/// (Σw)²/((Σwt²)²·Σw²)/4π² (D73).
const FREQUENCY_VARIANCE: f64 = 0.237;

/// Power over the background of an order that is used to read the speed.
const CLEAR: f64 = 12.0;

/// Distances, in bins, at which the peak of an order is searched, one after another.
const STEPS_BINS: [f64; 3] = [0.3, 0.15, 0.1];

/// Widening of lines by a speed that is not quite constant, bins.
const WIDENING_BINS: f64 = 0.1;

/// Speeds tried at most.
const MAX_CANDIDATES: usize = 4_000_000;

/// A speed read from a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CombSpeed {
    /// Mean speed over the record (Hann-weighted), Hz.
    pub speed_hz: f64,
    /// Standard error by noise alone, Hz; `None` if no order was clear enough and the speed is the best
    /// of those tried.
    pub standard_error_hz: Option<f64>,
    /// Probability that there is a comb and that it is the one at this speed, within one bin (D72).
    pub confidence: f64,
    /// Orders the speed was read from.
    pub n_orders: usize,
}

/// Looks for the speed of records of n samples (D71, D72, D73).
#[derive(Debug)]
pub struct CombSpeedPlan<T: Real> {
    search: SpeedSearch,
    fs_hz: f64,
    step_hz: f64,
    window: Window<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    evidence: Evidence,
    scores: Vec<f64>,
    /// Per order: frequency, three frequencies around, what is read there, its power over background.
    lines_hz: Vec<f64>,
    around_hz: Vec<f64>,
    around: Vec<Option<Line>>,
    power: Vec<f64>,
}

impl<T: Real> CombSpeedPlan<T> {
    /// Plans for `n` samples at `fs_hz`; `None` if they hold less than four periods of the first order
    /// at the lowest speed, if that order reaches Nyquist at the highest, if orders or speeds are out of
    /// order, or if more than four million speeds were to be tried.
    #[must_use]
    pub fn new(search: SpeedSearch, n: usize, fs_hz: f64, cache: &mut FftCache<T>) -> Option<Self> {
        if !search.is_possible(n, fs_hz) {
            return None;
        }
        let n_padded = fft::fast_len_at_least(2 * n);
        let bin_hz = fs_hz / n_padded as f64;
        let step_hz = 0.5 * bin_hz / search.last_order();
        let n_candidates = ceil_index((search.high_hz - search.low_hz) / step_hz).saturating_add(1);
        if n_candidates > MAX_CANDIDATES {
            return None;
        }
        let n_orders = search.orders.len();
        Some(Self {
            fs_hz,
            step_hz,
            window: Window::new(Shape::Hann, n),
            forward: ForwardPlan::new(n_padded, cache),
            x_hat: vec![Complex::zero(); fft::n_bins(n_padded)],
            evidence: Evidence::new(n_padded, fs_hz, &search),
            scores: vec![0.0; n_candidates],
            lines_hz: vec![0.0; n_orders],
            around_hz: vec![0.0; 3 * n_orders],
            around: vec![None; 3 * n_orders],
            power: vec![0.0; n_orders],
            search,
        })
    }

    /// Reads the speed of `x`, n samples.
    ///
    /// The best speed is always given; whether to believe it is what the confidence says. `None` for a
    /// constant and if a sample is no number. A speed that changes by more than a bin over the highest
    /// order, fs/n, smears that order: then use [`crate::dsp::speed_track::SpeedTrackPlan`].
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn process(&mut self, x: &[T]) -> Option<CombSpeed> {
        if x.iter().any(|value| !value.to_f64().is_finite()) {
            return None;
        }
        self.forward.process_weighted(x, &self.window.weights, &mut self.x_hat);
        if !self.evidence.read(&self.x_hat) {
            return None;
        }
        let mut best = 0;
        for i in 0..self.scores.len() {
            let speed_hz = self.candidate_hz(i);
            self.scores[i] = self.evidence.score(speed_hz, &self.search.orders);
            best = if self.scores[i] > self.scores[best] { i } else { best };
        }
        let confidence = self.confidence(best);
        let speed_hz = self.candidate_hz(best);
        Some(self.refined(x, speed_hz, confidence))
    }

    fn candidate_hz(&self, i: usize) -> f64 {
        (self.search.low_hz + i as f64 * self.step_hz).min(self.search.high_hz)
    }

    /// Posterior of the speeds within one bin of the best, "no comb" being as probable beforehand as all
    /// combs together (D72).
    fn confidence(&self, best: usize) -> f64 {
        let reach = self.fs_hz / self.window.weights.len() as f64 / self.step_hz;
        let top = self.scores[best].max(0.0);
        let (mut near, mut all) = (0.0, 0.0);
        for (i, score) in self.scores.iter().enumerate() {
            let weight = (score - top).exp();
            all += weight;
            near += if (i as f64 - best as f64).abs() <= reach { weight } else { 0.0 };
        }
        near / (all + self.scores.len() as f64 * (-top).exp())
    }

    /// Weighted least squares over the orders that are clear (D73).
    fn refined(&mut self, x: &[T], speed_hz: f64, confidence: f64) -> CombSpeed {
        self.read_orders(x, speed_hz);
        let bin_hz = self.fs_hz / x.len() as f64;
        let mut found = CombSpeed { speed_hz, standard_error_hz: None, confidence, n_orders: 0 };
        // Everything near first, then what agrees with what was found.
        for pass in 0..2 {
            let (mut numerator, mut denominator, mut n_orders) = (0.0, 0.0, 0);
            for ((o, line_hz), power) in
                self.search.orders.iter().zip(&self.lines_hz).zip(&self.power)
            {
                if *power < CLEAR {
                    continue;
                }
                let sigma_bins = (FREQUENCY_VARIANCE / power).sqrt();
                let limit_bins = if pass == 0 { 0.5 } else { 4.0 * sigma_bins + WIDENING_BINS };
                if (line_hz - o.order * found.speed_hz).abs() > limit_bins * bin_hz {
                    continue;
                }
                let weight = power / FREQUENCY_VARIANCE;
                numerator += weight * o.order * line_hz;
                denominator += weight * o.order * o.order;
                n_orders += 1;
            }
            if denominator > 0.0 {
                found.speed_hz = numerator / denominator;
                found.standard_error_hz = Some(bin_hz / denominator.sqrt());
                found.n_orders = n_orders;
            }
        }
        found
    }

    /// Finds the peak of each order near its place at `speed_hz`, and its power over the background.
    fn read_orders(&mut self, x: &[T], speed_hz: f64) {
        let bin_hz = self.fs_hz / x.len() as f64;
        for (i, o) in self.search.orders.iter().enumerate() {
            let expected_hz = o.order * speed_hz;
            let peak = self.evidence.peak_near(expected_hz);
            (self.lines_hz[i], self.power[i]) = peak.unwrap_or((expected_hz, 0.0));
        }
        for step_bins in STEPS_BINS {
            let step_hz = step_bins * bin_hz;
            for (place, line_hz) in self.around_hz.chunks_mut(3).zip(&self.lines_hz) {
                place.copy_from_slice(&[line_hz - step_hz, *line_hz, line_hz + step_hz]);
            }
            line::lines_at(x, self.fs_hz, &self.around_hz, &mut self.around);
            for (i, read) in self.around.chunks(3).enumerate() {
                let shift = match read {
                    [Some(low), Some(middle), Some(high)] => {
                        peak_of_parabola(low.amplitude, middle.amplitude, high.amplitude)
                    }
                    _ => None,
                };
                match shift {
                    Some(shift) => self.lines_hz[i] += shift * step_hz,
                    None => self.power[i] = 0.0,
                }
            }
        }
    }
}

/// Place of the peak through three heights one step apart, in steps, at most one; `None` if there is
/// none.
fn peak_of_parabola(low: f64, middle: f64, high: f64) -> Option<f64> {
    let curvature = low - 2.0 * middle + high;
    (curvature < 0.0).then(|| (0.5 * (low - high) / curvature).clamp(-1.0, 1.0))
}
