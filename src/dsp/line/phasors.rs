//! Sums of Hann-weighted samples with phasors, block by block (D9).
//!
//! One table of a block serves a whole record, each block turned to its place. Must not know what is
//! made of the sums.

use std::f64::consts::TAU;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;
use rustfft::num_complex::Complex;

use crate::dsp::real::Real;

/// Samples rotated with one table.
const BLOCK: usize = 256;

/// Lines summed side by side.
pub(super) const TOGETHER: usize = 4;

/// Blocks after which sums go on in f64 and phases begin anew, so that neither drifts.
const FLUSH: usize = 16;

/// Numbers in the widest vector.
const LANES: usize = 16;

/// Cosines and negative sines of one block.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Table<T> {
    re: [T; BLOCK],
    im: [T; BLOCK],
}

impl<T: Real> Table<T> {
    pub(super) const EMPTY: Self = Self { re: [T::ZERO; BLOCK], im: [T::ZERO; BLOCK] };

    /// Fills in e^(−j2πci).
    pub(super) fn fill(&mut self, cycles: f64) {
        Arch::new().dispatch(Fill { cycles, table: self });
    }
}

/// Sums in T of some blocks, lanes side by side.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Partial<T> {
    re: [T; LANES],
    im: [T; LANES],
}

impl<T: Real> Partial<T> {
    pub(super) const EMPTY: Self = Self { re: [T::ZERO; LANES], im: [T::ZERO; LANES] };
}

/// The window of a record.
#[derive(Debug)]
pub(super) struct Hann<T> {
    table: Table<T>,
    turn: Turn,
    weighted: Table<T>,
}

impl<T: Real> Hann<T> {
    /// Of `n` samples.
    pub(super) fn new(n: usize) -> Self {
        let cycles = 1.0 / n as f64;
        let mut table = Table::EMPTY;
        table.fill(cycles);
        Self { table, turn: Turn::new(cycles), weighted: Table::EMPTY }
    }

    /// Weighs a block of x − high − low, zeros behind it.
    #[inline(always)]
    fn weigh(&mut self, block: &[T], (high, low): (T, T)) {
        let seed = self.turn.at;
        let (seed_re, seed_im) = (T::rounded(0.5 * seed.re), T::rounded(0.5 * seed.im));
        let half = T::rounded(0.5);
        let n = block.len();
        let (weighted, rest) = self.weighted.re.split_at_mut(n);
        let (re, im) = (&self.table.re[..n], &self.table.im[..n]);
        for i in 0..n {
            let half_cosine = seed_re * re[i] - seed_im * im[i];
            weighted[i] = (half - half_cosine) * (block[i] - high - low);
        }
        rest.fill(T::zero());
    }
}

/// Tables, turns and sums of some lines, a multiple of [`TOGETHER`].
pub(super) struct Phasors<'a, T: Real> {
    pub(super) tables: &'a [Table<T>],
    pub(super) turns: &'a mut [Turn],
    pub(super) partials: &'a mut [Partial<T>],
    pub(super) sums: &'a mut [Complex<f64>],
}

impl<T: Real> Phasors<'_, T> {
    /// Adds P of every line to its sum and returns C (D9) of x − mean.
    pub(super) fn read(self, x: &[T], mean: f64, hann: &mut Hann<T>) -> f64 {
        Arch::new().dispatch(Read { x, mean, hann, phasors: self })
    }
}

struct Read<'a, T: Real> {
    x: &'a [T],
    mean: f64,
    hann: &'a mut Hann<T>,
    phasors: Phasors<'a, T>,
}

impl<T: Real> WithSimd for Read<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { x, mean, hann, phasors } = self;
        let Phasors { tables, turns, partials, sums } = phasors;
        let high = T::rounded(mean);
        let low = T::rounded(mean - high.to_f64());
        let mut constant = 0.0;
        for (index, block) in x.chunks(BLOCK).enumerate() {
            hann.turn.go_to(index);
            for turn in &mut *turns {
                turn.go_to(index);
            }
            hann.weigh(block, (high, low));
            constant += sum_of(&hann.weighted.re);
            let lists = tables.chunks_exact(TOGETHER).zip(partials.chunks_exact_mut(TOGETHER));
            for ((tables, partials), turns) in lists.zip(turns.chunks_exact(TOGETHER)) {
                four_lines(simd, &hann.weighted.re, tables, turns, partials);
            }
            if index % FLUSH == FLUSH - 1 {
                flush(partials, sums);
            }
        }
        flush(partials, sums);
        constant
    }
}

/// Moves sums in T to those in f64.
#[inline(always)]
fn flush<T: Real>(partials: &mut [Partial<T>], sums: &mut [Complex<f64>]) {
    for (partial, sum) in partials.iter_mut().zip(sums) {
        for (re, im) in partial.re.iter().zip(&partial.im) {
            *sum += Complex::new(re.to_f64(), im.to_f64());
        }
        *partial = Partial::EMPTY;
    }
}

#[inline(always)]
fn sum_of<T: Real>(values: &[T; BLOCK]) -> f64 {
    let mut lanes = [T::zero(); LANES];
    let (chunks, _) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            lanes[i] += chunk[i];
        }
    }
    let mut sum = 0.0;
    for lane in lanes {
        sum += lane.to_f64();
    }
    sum
}

/// Adds a block's phasor sums of four lines, each turned to the block's place. Eight sums side by
/// side keep both multipliers busy.
#[inline(always)]
fn four_lines<T: Real, S: Simd>(
    simd: S,
    weighted: &[T; BLOCK],
    tables: &[Table<T>],
    turns: &[Turn],
    partials: &mut [Partial<T>],
) {
    let [a, b, c, d] = [&tables[0], &tables[1], &tables[2], &tables[3]];
    let zero = T::splat(simd, T::zero());
    let (mut a_re, mut a_im, mut b_re, mut b_im) = (zero, zero, zero, zero);
    let (mut c_re, mut c_im, mut d_re, mut d_im) = (zero, zero, zero, zero);
    let values = T::vectors::<S>(weighted);
    let n = values.len();
    let (at_re, at_im) = (&T::vectors::<S>(&a.re)[..n], &T::vectors::<S>(&a.im)[..n]);
    let (bt_re, bt_im) = (&T::vectors::<S>(&b.re)[..n], &T::vectors::<S>(&b.im)[..n]);
    let (ct_re, ct_im) = (&T::vectors::<S>(&c.re)[..n], &T::vectors::<S>(&c.im)[..n]);
    let (dt_re, dt_im) = (&T::vectors::<S>(&d.re)[..n], &T::vectors::<S>(&d.im)[..n]);
    for i in 0..n {
        let x = values[i];
        a_re = T::times_plus(simd, x, at_re[i], a_re);
        a_im = T::times_plus(simd, x, at_im[i], a_im);
        b_re = T::times_plus(simd, x, bt_re[i], b_re);
        b_im = T::times_plus(simd, x, bt_im[i], b_im);
        c_re = T::times_plus(simd, x, ct_re[i], c_re);
        c_im = T::times_plus(simd, x, ct_im[i], c_im);
        d_re = T::times_plus(simd, x, dt_re[i], d_re);
        d_im = T::times_plus(simd, x, dt_im[i], d_im);
    }
    add_turned(simd, [a_re, a_im], &turns[0], &mut partials[0]);
    add_turned(simd, [b_re, b_im], &turns[1], &mut partials[1]);
    add_turned(simd, [c_re, c_im], &turns[2], &mut partials[2]);
    add_turned(simd, [d_re, d_im], &turns[3], &mut partials[3]);
}

#[inline(always)]
fn add_turned<T: Real, S: Simd>(
    simd: S,
    [re, im]: [T::Vector<S>; 2],
    turn: &Turn,
    to: &mut Partial<T>,
) {
    let cos = T::splat(simd, T::rounded(turn.at.re));
    let sin = T::splat(simd, T::rounded(turn.at.im));
    let to_re = &mut T::vectors_mut::<S>(&mut to.re)[0];
    *to_re = T::less_times(simd, T::times_plus(simd, re, cos, *to_re), im, sin);
    let to_im = &mut T::vectors_mut::<S>(&mut to.im)[0];
    *to_im = T::times_plus(simd, im, cos, T::times_plus(simd, re, sin, *to_im));
}

/// Rotation at the beginning of a block: exact every so many blocks, turned on by a step in between.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turn {
    cycles: f64,
    step: Complex<f64>,
    at: Complex<f64>,
}

impl Turn {
    pub(super) fn new(cycles: f64) -> Self {
        let step = rotation(cycles * BLOCK as f64);
        Self { cycles, step, at: Complex::new(1.0, 0.0) }
    }

    /// To the next block.
    #[inline(always)]
    fn go_to(&mut self, index: usize) {
        self.at = if index.is_multiple_of(FLUSH) {
            rotation(self.cycles * (index * BLOCK) as f64)
        } else {
            self.at * self.step
        };
    }
}

/// e^(−j2πc), exact phase for large c.
pub(super) fn rotation(cycles: f64) -> Complex<f64> {
    let (sin, cos) = (TAU * cycles.fract()).sin_cos();
    Complex::new(cos, -sin)
}

struct Fill<'a, T> {
    cycles: f64,
    table: &'a mut Table<T>,
}

impl<T: Real> WithSimd for Fill<'_, T> {
    type Output = ();

    /// By doubling what is filled: eight products in f64 at most.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { cycles, table } = self;
        let (mut re, mut im) = ([0.0; BLOCK], [0.0; BLOCK]);
        re[0] = 1.0;
        let mut filled = 1;
        while filled < BLOCK {
            let step = rotation(cycles * filled as f64);
            let (from_re, to_re) = re.split_at_mut(filled);
            let (from_im, to_im) = im.split_at_mut(filled);
            let (to_re, to_im) = (&mut to_re[..filled], &mut to_im[..filled]);
            for i in 0..filled {
                to_re[i] = from_re[i] * step.re - from_im[i] * step.im;
                to_im[i] = from_re[i] * step.im + from_im[i] * step.re;
            }
            filled *= 2;
        }
        for i in 0..BLOCK {
            (table.re[i], table.im[i]) = (T::rounded(re[i]), T::rounded(im[i]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_of_1e9_samples_do_not_drift() {
        // Cycles a sample in units of 2^−40, so that integers tell the phase of every block exactly.
        const UNIT_BITS: u32 = 40;
        let n_blocks = 1_000_000_000 / BLOCK;
        for units in [75_109_876_543_u64, 549_000_000_001, 1_234_567] {
            let mut turn = Turn::new(units as f64 * 2f64.powi(-UNIT_BITS.cast_signed()));
            let mut worst = [0.0_f64; 2];
            for index in 0..n_blocks {
                turn.go_to(index);
                let turned = u128::from(units) * (index * BLOCK) as u128 % (1 << UNIT_BITS);
                let (sin, cos) = (TAU * turned as f64 * 2f64.powi(-40)).sin_cos();
                let error = (turn.at - Complex::new(cos, -sin)).norm();
                let half = &mut worst[usize::from(index > n_blocks / 1000)];
                *half = half.max(error);
            }
            let cycles = units as f64 * 2f64.powi(-40) * 1e9;
            // The phase is a product, not a sum: half a last digit of the cycles, whatever came before,
            // and the rounding of up to 16 turns.
            assert!(worst[1] < TAU * cycles * 0.5 * f64::EPSILON + 1e-14, "{units}: {worst:?}");
        }
    }
}
