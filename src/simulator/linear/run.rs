//! A linear motion, sampled: eight samples at a time.
//!
//! All samples of a chunk are weighted sums of a few numbers at its beginning: 1, cos φ and sin φ of the
//! steady motion, and the coordinates of the free motion, each as long as it has not died out.

use super::{LinearSystem, Seen, Steady};
use crate::simulator::lanes::{self, Block, WIDTH};
use crate::simulator::model::Model;
use crate::simulator::run::Watch;
use crate::simulator::spectrum::Spectrum;
use nalgebra::{Complex, DMatrix, DVector};
use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::TAU;

/// Free motions smaller than this part of the steady one are rounding.
const DIED_OUT: f64 = 1e-18;

/// Free motions smaller than this are none: far from what anything shows, and from the least number
/// there is.
const LEAST: f64 = 1e-150;

/// Chunks from one look at what has died out to the next.
const LOOKS: u64 = 32;

/// Chunks from one exact evaluation of the shaft's angle to the next.
const TURNS: u64 = 16;

/// Numbers of the steady motion before those of the free one.
const N_STEADY: usize = 3;

/// A model without contacts in motion at constant speed, sampled at a fixed rate.
#[derive(Debug, Clone)]
pub struct LinearRun {
    arch: Arch,
    system: LinearSystem,
    steady: Steady,
    pub(super) seen: Vec<Seen>,
    free: Free,
    speed_hz: f64,
    rate_hz: f64,
    /// The next sample, and the one from which chunks are counted.
    n_samples: u64,
    origin: u64,
    /// What each watch sees in the present chunk: eight samples a watch.
    chunk: Vec<Block>,
    /// cos and sin of what the shaft turns in a chunk.
    chunk_turn: (f64, f64),
    /// Numbers at the chunk's beginning, and of each the eight samples of every watch it makes.
    amounts: Vec<f64>,
    columns: Vec<Block>,
}

/// The motion beside the steady one.
#[derive(Debug, Clone)]
enum Free {
    /// In coordinates of their own, whose values begin the chunk.
    Spectral { spectrum: Box<Spectrum>, modes: Vec<Mode> },
    /// As a state, with what carries it over a sample.
    Dense { propagator: DMatrix<f64>, state: DVector<f64> },
    /// It has died out.
    Gone,
}

/// A coordinate of the free motion that has not died out.
#[derive(Debug, Clone, Copy)]
struct Mode {
    /// Its number in the spectrum.
    number: usize,
    /// What a chunk makes of it.
    over_chunk: Complex<f64>,
}

impl LinearRun {
    /// A run at the speed of `model`, of one shaft, from the state given or from the steady motion; `None`
    /// if there is no steady motion, or a second shaft.
    #[must_use]
    pub fn new(
        model: &Model,
        speed_hz: f64,
        watches: &[Watch],
        rate_hz: f64,
        state: Option<(&[f64], &[f64])>,
    ) -> Option<Self> {
        if model.shafts.len() > 1 {
            return None;
        }
        let system = LinearSystem::new(model, TAU * speed_hz);
        let steady = system.steady(model)?;
        let mut run = Self {
            arch: Arch::new(),
            seen: watches.iter().map(|watch| Seen::by(&system, &steady, watch)).collect(),
            chunk: vec![[0.0; WIDTH]; watches.len()],
            system,
            steady,
            free: Free::Gone,
            speed_hz,
            rate_hz,
            n_samples: 0,
            origin: 0,
            chunk_turn: {
                let (sin, cos) = (TAU * speed_hz / rate_hz * WIDTH as f64).sin_cos();
                (cos, sin)
            },
            amounts: Vec::new(),
            columns: Vec::new(),
        };
        run.begin_at(state, true);
        Some(run)
    }

    /// Goes on from this state at the next sample; `None`: with the steady motion.
    fn begin_at(&mut self, state: Option<(&[f64], &[f64])>, in_coordinates: bool) {
        self.origin = self.n_samples;
        self.steady_columns();
        let Some((q, v)) = state else {
            self.free = Free::Gone;
            return;
        };
        let free = self.system.state(q, v) - self.steady.state(self.angle_rad(self.n_samples));
        let spectrum = Spectrum::of(self.system.matrix()).filter(|_| in_coordinates);
        self.free = match spectrum {
            Some(spectrum) => {
                let modes = self.free_columns(&spectrum, &free);
                Free::Spectral { spectrum: Box::new(spectrum), modes }
            }
            None => {
                Free::Dense { propagator: self.system.propagator(1.0 / self.rate_hz), state: free }
            }
        };
    }

    /// Columns of the steady motion: constant, and what cos φ and sin φ at a chunk's beginning make.
    fn steady_columns(&mut self) {
        self.columns.clear();
        self.amounts = vec![1.0, 1.0, 0.0];
        let a_sample = TAU * self.speed_hz / self.rate_hz;
        let turn = |j: usize| (a_sample * j as f64).sin_cos();
        self.columns.extend(self.seen.iter().map(|seen| [seen.still[0]; WIDTH]));
        let of_cos = |seen: &Seen| {
            let [_, cos, sin, ..] = seen.still;
            std::array::from_fn(|j| cos * turn(j).1 + sin * turn(j).0)
        };
        let of_sin = |seen: &Seen| {
            let [_, cos, sin, ..] = seen.still;
            std::array::from_fn(|j| sin * turn(j).1 - cos * turn(j).0)
        };
        self.columns.extend(self.seen.iter().map(of_cos));
        self.columns.extend(self.seen.iter().map(of_sin));
    }

    /// Appends numbers and columns of a free motion, real and imaginary part of each coordinate.
    fn free_columns(&mut self, spectrum: &Spectrum, free: &DVector<f64>) -> Vec<Mode> {
        let weights: Vec<_> = self.seen.iter().map(|seen| spectrum.output(&seen.row)).collect();
        let coordinates = spectrum.input(free);
        let mut modes = Vec::new();
        for (number, (start, value)) in coordinates.iter().zip(&spectrum.values).enumerate() {
            let after = |j: usize| (value * (j as f64 / self.rate_hz)).exp();
            let shown = |weights: &Vec<Complex<f64>>| {
                let samples: [_; WIDTH] = std::array::from_fn(|j| weights[number] * after(j));
                samples
            };
            self.amounts.extend([start.re, start.im]);
            self.columns.extend(weights.iter().map(|w| shown(w).map(|sample| sample.re)));
            self.columns.extend(weights.iter().map(|w| shown(w).map(|sample| -sample.im)));
            modes.push(Mode { number, over_chunk: after(WIDTH) });
        }
        modes
    }

    /// Shaft angle at a sample, rad, within a turn.
    fn angle_rad(&self, sample: u64) -> f64 {
        let turns = self.speed_hz * (sample as f64 / self.rate_hz);
        TAU * (turns - turns.round())
    }

    /// Samples of the present chunk that have been taken.
    fn n_taken(&self) -> usize {
        // Below eight.
        usize::try_from((self.n_samples - self.origin) % WIDTH as u64).unwrap_or(0)
    }

    /// Displacements and velocities at the next sample.
    #[must_use]
    pub fn state(&self) -> (Vec<f64>, Vec<f64>) {
        let steady = self.steady.state(self.angle_rad(self.n_samples));
        let whole = match &self.free {
            Free::Gone => steady,
            Free::Dense { state, .. } => steady + state,
            Free::Spectral { spectrum, modes } => {
                let since_s = self.n_taken() as f64 / self.rate_hz;
                let mut coordinates = vec![Complex::new(0.0, 0.0); spectrum.values.len()];
                let parts = self.amounts[N_STEADY..].chunks_exact(2);
                for (mode, parts) in modes.iter().zip(parts) {
                    let grown = (spectrum.values[mode.number] * since_s).exp();
                    coordinates[mode.number] = Complex::new(parts[0], parts[1]) * grown;
                }
                steady + spectrum.state(&coordinates)
            }
        };
        self.system.coordinates(&whole)
    }

    /// Exchanges the loads and keeps the motion; `false` if there is no steady motion under them.
    pub fn set_loads(&mut self, model: &Model, watches: &[Watch]) -> bool {
        let Some(steady) = self.system.steady(model) else { return false };
        let (q, v) = self.state();
        self.seen = watches.iter().map(|watch| Seen::by(&self.system, &steady, watch)).collect();
        self.chunk = vec![[0.0; WIDTH]; watches.len()];
        self.steady = steady;
        self.begin_at(Some((&q, &v)), true);
        true
    }

    /// Writes the next `n` samples of every watch. How they are cut into calls changes no bit.
    ///
    /// # Panics
    ///
    /// If `out` does not have one list a watch.
    pub fn fill(&mut self, n: usize, out: &mut [Vec<f64>]) {
        assert_eq!(out.len(), self.seen.len(), "one list a watch");
        out.iter_mut().for_each(Vec::clear);
        let arch = self.arch;
        arch.dispatch(Fill { run: self, n, out });
        self.add_dense(n, out);
    }

    #[inline(always)]
    fn chunks<S: Simd>(&mut self, simd: S, n: usize, out: &mut [Vec<f64>]) {
        let mut left = n;
        while left > 0 {
            let taken = self.n_taken();
            if taken == 0 {
                self.turn();
                self.chunk.fill([0.0; WIDTH]);
                lanes::push(simd, &self.columns, &self.amounts, &mut self.chunk);
            }
            let n_now = left.min(WIDTH - taken);
            for (list, chunk) in out.iter_mut().zip(&self.chunk) {
                list.extend_from_slice(&chunk[taken..taken + n_now]);
            }
            left -= n_now;
            self.n_samples += n_now as u64;
            if taken + n_now == WIDTH {
                self.carry_free();
            }
        }
    }

    /// Brings cos φ and sin φ to the chunk that begins.
    #[inline(always)]
    fn turn(&mut self) {
        let (cos, sin) = (self.amounts[1], self.amounts[2]);
        let (by_cos, by_sin) = self.chunk_turn;
        let n_chunks = (self.n_samples - self.origin) / WIDTH as u64;
        let (sin, cos) = if n_chunks.is_multiple_of(TURNS) {
            self.angle_rad(self.n_samples).sin_cos()
        } else {
            (sin * by_cos + cos * by_sin, cos * by_cos - sin * by_sin)
        };
        (self.amounts[1], self.amounts[2]) = (cos, sin);
    }

    /// Carries the free motion's coordinates over a chunk.
    #[inline(always)]
    fn carry_free(&mut self) {
        let Free::Spectral { modes, .. } = &mut self.free else { return };
        for (mode, parts) in modes.iter().zip(self.amounts[N_STEADY..].chunks_exact_mut(2)) {
            let Complex { re, im } = Complex::new(parts[0], parts[1]) * mode.over_chunk;
            (parts[0], parts[1]) = (re, im);
        }
        if ((self.n_samples - self.origin) / WIDTH as u64).is_multiple_of(LOOKS) {
            self.forget_what_died();
        }
    }

    /// Takes out coordinates that are rounding beside the steady motion.
    fn forget_what_died(&mut self) {
        let limit = (DIED_OUT * self.steady.largest()).max(LEAST);
        let Free::Spectral { modes, .. } = &mut self.free else { return };
        let n = self.seen.len();
        let mut at = 0;
        while at < modes.len() {
            let parts = N_STEADY + 2 * at..N_STEADY + 2 * (at + 1);
            if self.amounts[parts.clone()].iter().all(|x| x.abs() < limit) {
                self.columns.drain(parts.start * n..parts.end * n);
                self.amounts.drain(parts);
                modes.remove(at);
            } else {
                at += 1;
            }
        }
        if modes.is_empty() {
            self.free = Free::Gone;
        }
    }

    /// Adds a free motion that has no coordinates of its own.
    fn add_dense(&mut self, n: usize, out: &mut [Vec<f64>]) {
        let Free::Dense { propagator, state } = &mut self.free else { return };
        let mut next = state.clone();
        for i in 0..n {
            for (list, seen) in out.iter_mut().zip(&self.seen) {
                list[i] += seen.row.dot(state);
            }
            next.gemv(1.0, propagator, state, 0.0);
            std::mem::swap(&mut next, state);
        }
        if state.amax() < (DIED_OUT * self.steady.largest()).max(LEAST) {
            self.free = Free::Gone;
        }
    }
}

struct Fill<'a> {
    run: &'a mut LinearRun,
    n: usize,
    out: &'a mut [Vec<f64>],
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run.chunks(simd, self.n, self.out);
    }
}

#[cfg(test)]
impl LinearRun {
    /// The same from its present state by the matrix exponential: the slow way.
    pub(super) fn by_propagator(mut self) -> Self {
        let (q, v) = self.state();
        self.begin_at(Some((&q, &v)), false);
        self
    }

    /// Goes on from this state.
    pub(super) fn begin_again(&mut self, q: &[f64], v: &[f64]) {
        self.begin_at(Some((q, v)), true);
    }
}
