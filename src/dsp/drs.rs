//! Separation of what is periodic from what is random: gears from bearings.
//!
//! A periodic part can be predicted from samples long ago, noise and the slipping impacts of a bearing
//! cannot. Must not know the periods.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::Real;
use crate::dsp::stats;
use crate::dsp::synthesis::SynthesisPlan;
use crate::dsp::welch::SegmentTransform;
use crate::dsp::window::Shape;

/// Discrete/random separation in the frequency domain (D46, D47; Antoni & Randall 2004).
///
/// The transfer function from x delayed by Δ to x is estimated over Hann segments of N samples and
/// applied as a filter of N taps around the delay: what comes out is the periodic part. It predicts
/// forward and, for the start of the record, backward; where both are possible their mean is taken, so
/// no end is lost. A line of amplitude A in noise of density S (u²/Hz) comes out with the gain
/// ρ/(1 + ρ), ρ = A²·N/(3·S·fs): long segments for weak lines. Of the noise about N/(2n) leaks into the
/// periodic part, spread over all frequencies.
#[derive(Debug)]
pub struct DrsPlan<T: Real> {
    n: usize,
    n_segment: usize,
    delay: usize,
    x: SegmentTransform<T>,
    delayed: SegmentTransform<T>,
    sums: Vec<Sums>,
    convolution: Convolution<T>,
}

/// Sums over segments of one bin: delayed power, power, x·delayed*.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    delayed: f64,
    power: f64,
    cross: Complex<f64>,
}

/// Which way a prediction looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Forward,
    Backward,
}

impl<T: Real> DrsPlan<T> {
    /// Plans for `n` samples, segments of `n_segment` (even) and a delay of `delay` samples.
    ///
    /// The delay must be at least half a segment plus the time in which the random part forgets
    /// itself, such as the ringing of a resonance. `None` if it is less than half a segment, the
    /// segment odd or below 4, or the record shorter than two delays and two segments.
    #[must_use]
    pub fn new(n: usize, n_segment: usize, delay: usize, cache: &mut FftCache<T>) -> Option<Self> {
        let is_segment = n_segment >= 4 && n_segment.is_multiple_of(2);
        let least = delay.checked_add(n_segment)?.checked_mul(2)?;
        if !is_segment || 2 * delay < n_segment || n < least {
            return None;
        }
        let segments =
            |cache: &mut _| SegmentTransform::new(Shape::Hann, n_segment, n_segment / 2, cache);
        Some(Self {
            n,
            n_segment,
            delay,
            x: segments(cache),
            delayed: segments(cache),
            sums: vec![Sums::default(); fft::n_bins(n_segment)],
            convolution: Convolution::new(n_segment, cache),
        })
    }

    /// Writes the periodic part, mean included, and the rest; their sum is `x` but for rounding.
    ///
    /// `x`: n samples, unit u; `discrete`, `random`: as many, u. A record that is all constant is
    /// periodic.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn process(&mut self, x: &[T], discrete: &mut [T], random: &mut [T]) {
        let n = self.n;
        assert!(x.len() == n && discrete.len() == n && random.len() == n, "samples of the plan");
        self.estimate(x);
        // `random` holds x without its mean meanwhile.
        let mean = stats::mean(x).unwrap_or(0.0);
        for (centred, x) in random.iter_mut().zip(x) {
            *centred = T::rounded(x.to_f64() - mean);
        }
        discrete.fill(T::zero());
        for direction in [Direction::Forward, Direction::Backward] {
            self.set_filter(direction);
            self.add_prediction(random, discrete, direction);
        }
        for ((discrete, random), x) in discrete.iter_mut().zip(&mut *random).zip(x) {
            *random -= *discrete;
            *discrete = T::rounded(x.to_f64() - random.to_f64());
        }
    }

    /// Sums of all pairs of segments a delay apart.
    fn estimate(&mut self, x: &[T]) {
        self.sums.fill(Sums::default());
        let (early, late) = (&x[..x.len() - self.delay], &x[self.delay..]);
        for (late, early) in self.x.segments(late).zip(self.delayed.segments(early)) {
            let (late, early) = (self.x.process(late), self.delayed.process(early));
            for (sums, (x, d)) in self.sums.iter_mut().zip(late.iter().zip(early)) {
                let x = Complex::new(x.re.to_f64(), x.im.to_f64());
                let d = Complex::new(d.re.to_f64(), d.im.to_f64());
                sums.delayed += d.norm_sqr();
                sums.power += x.norm_sqr();
                sums.cross += x * d.conj();
            }
        }
    }

    /// H = S_xd/S_dd forward, its counterpart S_dx/S_xx backward; bin 0 without: the mean is apart.
    fn set_filter(&mut self, direction: Direction) {
        self.convolution.set(self.sums.iter().enumerate().map(|(k, sums)| {
            let (cross, power) = match direction {
                Direction::Forward => (sums.cross, sums.delayed),
                Direction::Backward => (sums.cross.conj(), sums.power),
            };
            let is_nothing = k == 0 || power <= 0.0;
            if is_nothing { Complex::zero() } else { cross / power }
        }));
    }

    /// Adds the prediction from a delay before, or behind, to `sum`: half where both are possible.
    fn add_prediction(&mut self, x: &[T], sum: &mut [T], direction: Direction) {
        let (n, half) = (self.n, self.n_segment / 2);
        // The filter's newest sample for output i is x[i ± Δ + N/2], its oldest N − 1 before.
        let forward_from = self.delay + half - 1;
        let backward_to = n - self.delay - half;
        let outputs = match direction {
            Direction::Forward => forward_from..n,
            Direction::Backward => 0..backward_to,
        };
        let mut start = outputs.start;
        while start < outputs.end {
            let newest = match direction {
                Direction::Forward => start - self.delay + half,
                Direction::Backward => start + self.delay + half,
            };
            let out = self.convolution.process(x, newest);
            let end = outputs.end.min(start + self.n_segment);
            for (i, (sum, value)) in (start..end).zip(sum[start..end].iter_mut().zip(out)) {
                let are_both = i >= forward_from && i < backward_to;
                *sum += if are_both { *value * T::rounded(0.5) } else { *value };
            }
            start = end;
        }
    }
}

/// Filter of N taps by transforms of 2N samples.
#[derive(Debug)]
struct Convolution<T: Real> {
    n_taps: usize,
    /// From N bins to N taps.
    taps: SynthesisPlan<T>,
    response: Vec<Complex<T>>,
    filter: Vec<Complex<T>>,
    forward: ForwardPlan<T>,
    inverse: SynthesisPlan<T>,
    samples: Vec<T>,
    spectrum: Vec<Complex<T>>,
}

impl<T: Real> Convolution<T> {
    fn new(n_taps: usize, cache: &mut FftCache<T>) -> Self {
        Self {
            n_taps,
            taps: SynthesisPlan::new(n_taps),
            response: vec![Complex::zero(); fft::n_bins(n_taps)],
            filter: vec![Complex::zero(); fft::n_bins(2 * n_taps)],
            forward: ForwardPlan::new(2 * n_taps, cache),
            inverse: SynthesisPlan::new(2 * n_taps),
            samples: vec![T::zero(); 2 * n_taps],
            spectrum: vec![Complex::zero(); fft::n_bins(2 * n_taps)],
        }
    }

    /// Takes the response at N bins: its taps around 0 move half the length on, so that they are causal.
    fn set(&mut self, response: impl Iterator<Item = Complex<f64>>) {
        for (to, from) in self.response.iter_mut().zip(response) {
            *to = Complex::new(T::rounded(from.re), T::rounded(from.im));
        }
        let (taps, padding) = self.samples.split_at_mut(self.n_taps);
        self.taps.process(&self.response, taps);
        taps.rotate_right(self.n_taps / 2);
        padding.fill(T::zero());
        // The transform takes out the mean of the taps. It is that of bin 0, which is 0 already.
        self.forward.process(&self.samples, &mut self.filter);
    }

    /// The N outputs whose newest samples are x[newest…newest + N − 1]; zeros beyond the ends of x. The
    /// mean of the samples taken is left out: the filter has no gain for it.
    fn process(&mut self, x: &[T], newest: usize) -> &[T] {
        let from = |m: usize| (newest + m).checked_sub(self.n_taps).and_then(|i| x.get(i));
        for (m, sample) in self.samples.iter_mut().enumerate() {
            *sample = from(m).copied().unwrap_or(T::zero());
        }
        self.forward.process(&self.samples, &mut self.spectrum);
        for (bin, filter) in self.spectrum.iter_mut().zip(&self.filter) {
            *bin = *bin * *filter;
        }
        self.inverse.process(&self.spectrum, &mut self.samples);
        &self.samples[self.n_taps..]
    }
}

#[cfg(test)]
#[path = "drs_tests.rs"]
mod tests;
