//! Speed over time without a tacho.
//!
//! Frames of the record give evidence of every speed in a stated range ([`crate::dsp::comb`]); the most
//! probable way through them, no steeper than stated, is then refined by demodulating the orders along
//! it. Must not know machines.

mod refine;
mod ridge;
#[cfg(test)]
mod tests;

use rustfft::num_complex::Complex;

use crate::dsp::comb::SpeedSearch;
use crate::dsp::comb::evidence::Evidence;
use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::order::PhaseTrack;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::stft::FrameSpec;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;
use refine::Refiner;
use ridge::Ridge;

/// Rounds of refinement: the first is off by what the ridge is off, the second by its square.
const ROUNDS: usize = 2;

/// Values of the ridge at most, frames times speeds.
const MAX_CELLS: usize = 16_000_000;

/// What is looked for and how.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedTrackSpec {
    /// Range and orders.
    pub search: SpeedSearch,
    /// Sampling rate, Hz.
    pub fs_hz: f64,
    /// Samples of a frame: at least eight periods of the lowest line; over a frame the speed should not
    /// change by much more than a bin, fs/n, over a low order.
    pub n_frame: usize,
    /// Steepest change of the speed, Hz/s.
    pub max_rate_hz_s: f64,
}

/// How sure a track is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedSpeed {
    /// Probability that there is a comb, and the mean over the frames of the probability that it is
    /// where the track is, within one bin (D74).
    pub confidence: f64,
    /// Points of the track.
    pub n_points: usize,
    /// Points at which no order was clear: the speed there is that of the ridge, to a grid step.
    pub n_unrefined: usize,
}

/// A point of the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedPoint {
    /// Time from the first sample, s.
    pub time_s: f64,
    /// Speed, Hz.
    pub speed_hz: f64,
    /// Standard error by noise alone, Hz; `None` where no order was clear.
    pub standard_error_hz: Option<f64>,
}

/// Follows the speed of records of n samples (D74, D75).
#[derive(Debug)]
pub struct SpeedTrackPlan<T: Real> {
    spec: SpeedTrackSpec,
    n: usize,
    hop: usize,
    window: Window<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    evidence: Evidence,
    ridge: Ridge,
    refiner: Refiner,
    points: Vec<SpeedPoint>,
    /// Of what was found last.
    confidence: Option<f64>,
}

impl<T: Real> SpeedTrackPlan<T> {
    /// Plans for records of `n` samples; `None` unless a record holds two frames half a frame apart, a
    /// frame eight periods of the lowest line, and range, orders and rate are possible.
    #[must_use]
    pub fn new(spec: SpeedTrackSpec, n: usize, cache: &mut FftCache<T>) -> Option<Self> {
        let hop = spec.n_frame / 2;
        // Twice the periods that a record needs: the refinement halves the frame.
        let is_possible = spec.search.is_possible(spec.n_frame / 2, spec.fs_hz)
            && spec.max_rate_hz_s >= 0.0
            && spec.max_rate_hz_s.is_finite()
            && n >= spec.n_frame + hop;
        if !is_possible {
            return None;
        }
        let n_padded = fft::fast_len_at_least(2 * spec.n_frame);
        let step_hz = 0.5 * spec.fs_hz / n_padded as f64 / spec.search.last_order();
        let range_hz = spec.search.high_hz - spec.search.low_hz;
        let n_states = ceil_index(range_hz / step_hz).saturating_add(1);
        let n_frames = (n - spec.n_frame) / hop + 1;
        if n_states.saturating_mul(n_frames) > MAX_CELLS {
            return None;
        }
        let per_hop = spec.max_rate_hz_s * hop as f64 / spec.fs_hz;
        let reach = ceil_index(per_hop / step_hz).clamp(1, n_states);
        let refiner = Refiner::new(&spec, n, n_frames);
        Some(Self {
            n,
            hop,
            window: Window::new(Shape::Hann, spec.n_frame),
            forward: ForwardPlan::new(n_padded, cache),
            x_hat: vec![Complex::new(T::zero(), T::zero()); fft::n_bins(n_padded)],
            evidence: Evidence::new(n_padded, spec.fs_hz, &spec.search),
            ridge: Ridge::new(n_states, n_frames, reach, spec.search.low_hz, step_hz),
            points: Vec::with_capacity(refiner.max_points()),
            refiner,
            spec,
            confidence: None,
        })
    }

    /// The frames the speed is looked for in.
    #[must_use]
    pub fn frames(&self) -> FrameSpec {
        FrameSpec { shape: Shape::Hann, n_frame: self.spec.n_frame, hop: self.hop }
    }

    /// Follows the speed of `x`, n samples; the track is in [`Self::points`]: [`Self::find`], then
    /// [`Self::refine`].
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn process(&mut self, x: &[T]) -> Option<TrackedSpeed> {
        self.find(x)?;
        self.refine(x)
    }

    /// Finds the most probable way of the speed of `x`, n samples, to a grid step, and how sure it is
    /// (D74). `None` for a record with a frame without any background (silence), or with a sample that
    /// is no number.
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn find(&mut self, x: &[T]) -> Option<f64> {
        assert_eq!(x.len(), self.n, "samples of the plan");
        self.points.clear();
        self.confidence = None;
        if x.iter().any(|value| !value.to_f64().is_finite()) {
            return None;
        }
        for frame in 0..self.ridge.n_frames() {
            self.read_frame(x, frame)?;
            for state in 0..self.ridge.n_states() {
                let speed_hz = self.ridge.speed_hz(state).min(self.spec.search.high_hz);
                let score = self.evidence.score(speed_hz, &self.spec.search.orders);
                self.ridge.set_score(frame, state, score);
            }
        }
        let bin_hz = self.spec.fs_hz / self.spec.n_frame as f64;
        self.confidence = Some(self.ridge.solve(bin_hz));
        self.confidence
    }

    /// Refines what [`Self::find`] found in the same `x` by the phases of its orders (D75); `None` if it found
    /// nothing.
    ///
    /// The track begins a quarter of a frame and half a step of an eighth behind the start of the record
    /// and ends as far before the end of its last frame: nothing is extrapolated.
    ///
    /// # Panics
    ///
    /// If `x` does not have the plan's length.
    pub fn refine(&mut self, x: &[T]) -> Option<TrackedSpeed> {
        assert_eq!(x.len(), self.n, "samples of the plan");
        let confidence = self.confidence?;
        self.begin_refinement(x)?;
        for _ in 0..ROUNDS {
            self.refiner.refine(x, &self.spec, &mut self.points);
        }
        let n_unrefined = self.points.iter().filter(|p| p.standard_error_hz.is_none()).count();
        Some(TrackedSpeed { confidence, n_points: self.points.len(), n_unrefined })
    }

    fn read_frame(&mut self, x: &[T], frame: usize) -> Option<()> {
        let start = frame * self.hop;
        let frame = &x[start..start + self.spec.n_frame];
        self.forward.process_weighted(frame, &self.window.weights, &mut self.x_hat);
        self.evidence.read(&self.x_hat).then_some(())
    }

    /// Hands the ridge, and the background at its orders, to the refinement.
    fn begin_refinement(&mut self, x: &[T]) -> Option<()> {
        self.refiner.begin();
        for frame in 0..self.ridge.n_frames() {
            self.read_frame(x, frame)?;
            let speed_hz = self.ridge.path_hz(frame);
            let middle = (frame * self.hop) as f64 + 0.5 * self.spec.n_frame as f64;
            self.refiner.add_knot(middle / self.spec.fs_hz, speed_hz);
            for o in &self.spec.search.orders {
                let power = self.evidence.background_at(o.order * speed_hz);
                // Mean power of one sample's worth of noise under weights of unit square sum.
                self.refiner.add_background(power.map(|p| p / self.window.sum_of_squares));
            }
        }
        Some(())
    }

    /// The track of the last call, in time; empty if there was none.
    #[must_use]
    pub fn points(&self) -> &[SpeedPoint] {
        &self.points
    }

    /// Shaft angle along the track of the last call, revolution 0 at its first point (D75); the mark of
    /// the shaft is unknown. `None` without a track. Allocates: it is a result to keep.
    #[must_use]
    pub fn phase_track(&self) -> Option<PhaseTrack> {
        let mut turned = 0.0;
        let mut revolutions = vec![0.0];
        for pair in self.points.windows(2) {
            turned +=
                0.5 * (pair[0].speed_hz + pair[1].speed_hz) * (pair[1].time_s - pair[0].time_s);
            revolutions.push(turned);
        }
        let times_s: Vec<f64> = self.points.iter().map(|point| point.time_s).collect();
        PhaseTrack::from_knots(&times_s, &revolutions)
    }
}
