//! Refines a track by the phases of its orders (D75).
//!
//! Along the angle of the track found so far, each order is turned down to a constant; what its phase
//! still advances from block to block is the track's error. Every phase factor is computed by itself:
//! nothing recurs, nothing drifts.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use super::SpeedPoint;
use super::SpeedTrackSpec;
use crate::dsp::real::Real;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// Power over the background below which a phase says nothing.
const CLEAR: f64 = 6.0;

/// Knots over which the acceleration beyond an end is taken.
const END_KNOTS: usize = 3;

/// Working memory of the refinement.
#[derive(Debug)]
pub(super) struct Refiner {
    fs_hz: f64,
    n_block: usize,
    hop: usize,
    n_blocks: usize,
    weights: Window<f64>,
    /// Speed at times, linear between them; revolutions up to each.
    times_s: Vec<f64>,
    speeds_hz: Vec<f64>,
    turned: Vec<f64>,
    /// Of the ridge, for the background, which does not change from round to round.
    ridge_times_s: Vec<f64>,
    background: Vec<f64>,
    phasors: Vec<Complex<f64>>,
    previous: Vec<Complex<f64>>,
    /// e^(−j2πoθ) of the samples of a block, order by order for each: what the next block shares is kept.
    turns: Vec<Complex<f64>>,
}

impl Refiner {
    pub(super) fn new(spec: &SpeedTrackSpec, n: usize, n_frames: usize) -> Self {
        let n_block = spec.n_frame / 2;
        let hop = (n_block / 4).max(1);
        // Blocks lie inside the frames.
        let covered = (n_frames - 1) * (spec.n_frame / 2) + spec.n_frame;
        let n_blocks = (covered.min(n) - n_block) / hop + 1;
        let n_orders = spec.search.orders.len();
        let n_knots = n_frames.max(n_blocks);
        Self {
            fs_hz: spec.fs_hz,
            n_block,
            hop,
            n_blocks,
            weights: Window::new(Shape::Hann, n_block),
            times_s: Vec::with_capacity(n_knots),
            speeds_hz: Vec::with_capacity(n_knots),
            turned: Vec::with_capacity(n_knots),
            ridge_times_s: Vec::with_capacity(n_frames),
            background: Vec::with_capacity(n_frames * n_orders),
            phasors: vec![Complex::zero(); n_orders],
            previous: vec![Complex::zero(); n_orders],
            turns: vec![Complex::zero(); n_block * n_orders],
        }
    }

    pub(super) fn max_points(&self) -> usize {
        self.n_blocks
    }

    pub(super) fn begin(&mut self) {
        for list in [
            &mut self.times_s,
            &mut self.speeds_hz,
            &mut self.turned,
            &mut self.ridge_times_s,
            &mut self.background,
        ] {
            list.clear();
        }
    }

    pub(super) fn add_knot(&mut self, time_s: f64, speed_hz: f64) {
        let before = self.times_s.last().zip(self.speeds_hz.last()).zip(self.turned.last());
        let turned =
            before.map_or(0.0, |((t, f), turned)| turned + 0.5 * (f + speed_hz) * (time_s - t));
        self.times_s.push(time_s);
        self.speeds_hz.push(speed_hz);
        self.turned.push(turned);
    }

    /// Background at the next order of the knot added last; infinite where it is not known.
    pub(super) fn add_background(&mut self, power: Option<f64>) {
        self.background.push(power.unwrap_or(f64::INFINITY));
        if let Some(time_s) = self.times_s.last().filter(|t| self.ridge_times_s.last() != Some(t)) {
            self.ridge_times_s.push(*time_s);
        }
    }

    /// Turns since the first knot; beyond the ends with the acceleration of the last knots there.
    fn turned_at(&self, time_s: f64) -> f64 {
        let last = self.times_s.len() - 1;
        let above = self.times_s.partition_point(|knot| *knot <= time_s);
        let near = above.saturating_sub(1);
        let (from, to) = match above {
            0 => (0, END_KNOTS.min(last)),
            _ if above > last => (last.saturating_sub(END_KNOTS), last),
            _ => (above - 1, above),
        };
        let span_s = self.times_s[to] - self.times_s[from];
        let change_hz = self.speeds_hz[to] - self.speeds_hz[from];
        let rate = if span_s > 0.0 { change_hz / span_s } else { 0.0 };
        let t = time_s - self.times_s[near];
        self.turned[near] + t * (self.speeds_hz[near] + 0.5 * rate * t)
    }

    /// One round: writes the new track into `points` and goes on from it.
    pub(super) fn refine<T: Real>(
        &mut self,
        x: &[T],
        spec: &SpeedTrackSpec,
        points: &mut Vec<SpeedPoint>,
    ) {
        points.clear();
        let step_s = self.hop as f64 / self.fs_hz;
        for block in 0..self.n_blocks {
            std::mem::swap(&mut self.phasors, &mut self.previous);
            self.turn_to(block, spec);
            self.demodulate(x, block * self.hop);
            if block == 0 {
                continue;
            }
            let middle_s = ((block * self.hop) as f64 + 0.5 * self.n_block as f64) / self.fs_hz;
            let advance = self.turned_at(middle_s) - self.turned_at(middle_s - step_s);
            let time_s = middle_s - 0.5 * step_s;
            let (error_turns, information) = self.advance_error(time_s, spec);
            let standard_error_hz =
                (information > 0.0).then(|| 1.0 / (TAU * step_s * information.sqrt()));
            let speed_hz = (advance + error_turns) / step_s;
            points.push(SpeedPoint { time_s, speed_hz, standard_error_hz });
        }
        let (times_s, speeds_hz) = (&mut self.times_s, &mut self.speeds_hz);
        times_s.clear();
        speeds_hz.clear();
        self.turned.clear();
        for point in points.iter() {
            self.add_knot(point.time_s, point.speed_hz);
        }
    }

    /// Phase factors of a block's samples: those the block before had too are moved, three quarters.
    fn turn_to(&mut self, block: usize, spec: &SpeedTrackSpec) {
        let orders = &spec.search.orders;
        let kept = if block == 0 { 0 } else { self.n_block - self.hop };
        self.turns.copy_within((self.n_block - kept) * orders.len().., 0);
        for i in kept..self.n_block {
            let turned = self.turned_at((block * self.hop + i) as f64 / self.fs_hz);
            for (o, at) in orders.iter().zip(&mut self.turns[i * orders.len()..]) {
                let (sin, cos) = (TAU * (o.order * turned).fract()).sin_cos();
                *at = Complex::new(cos, -sin);
            }
        }
    }

    /// Σ w·(x − mean)·e^(−j2πoθ) of each order over a block.
    fn demodulate<T: Real>(&mut self, x: &[T], start: usize) {
        let block = &x[start..start + self.n_block];
        let weighted = block.iter().zip(&self.weights.weights).map(|(x, w)| x.to_f64() * w);
        let mean = weighted.sum::<f64>() / self.weights.sum;
        self.phasors.fill(Complex::zero());
        let n_orders = self.phasors.len();
        let turns = self.turns.chunks_exact(n_orders);
        for ((value, weight), turns) in block.iter().zip(&self.weights.weights).zip(turns) {
            let value = weight * (value.to_f64() - mean);
            for (phasor, turn) in self.phasors.iter_mut().zip(turns) {
                *phasor += turn * value;
            }
        }
    }

    /// Turns by which the shaft advanced more than the track from the block before to this one, by
    /// weighted least squares over the orders that are clear; and the sum of weights, 1/rad².
    fn advance_error(&self, time_s: f64, spec: &SpeedTrackSpec) -> (f64, f64) {
        let n_orders = self.phasors.len();
        let knot = self.ridge_times_s.partition_point(|knot| *knot <= time_s);
        let background = &self.background[knot.saturating_sub(1) * n_orders..];
        let (mut numerator, mut denominator) = (0.0, 0.0);
        for (((now, before), o), background) in
            self.phasors.iter().zip(&self.previous).zip(&spec.search.orders).zip(background)
        {
            let product = now * before.conj();
            let power = product.norm() / (background * self.weights.sum_of_squares);
            // Written so that a background of 0 or infinity takes no part.
            if power > CLEAR && power.is_finite() {
                numerator += power * o.order * product.arg();
                denominator += power * o.order * o.order;
            }
        }
        if denominator > 0.0 { (numerator / denominator / TAU, denominator) } else { (0.0, 0.0) }
    }
}
