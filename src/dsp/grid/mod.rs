//! Complex Fourier transform of L = W·M points in the lanes of vectors, W numbers wide (D50).
//!
//! The points stand in W rows of M. First the W points of every column are transformed, columns side
//! by side in the lanes; each is turned by its twiddle; the grid is transposed; then M points are
//! transformed (Stockham's way), the W results of the first step side by side. Nothing is ever shuffled within
//! a vector but in the transposition. Must not know what is transformed.

use std::f64::consts::TAU;
use std::fmt;
use std::marker::PhantomData;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;

use crate::dsp::butterfly::Numbers;
use crate::dsp::butterfly::Pair;
use crate::dsp::butterfly::Points;
use crate::dsp::butterfly::Square;
use crate::dsp::butterfly::Transform;
use crate::dsp::lanes::Aligned;
use crate::dsp::lanes::lanes_of;
use crate::dsp::real::Real;

/// Largest number of columns: beyond it tables and buffers leave the caches.
const MAX_COLUMNS: usize = 1 << 14;

/// Radices of the second step with the time of a pass for a vector of points, and the time of all
/// else: ns, measured at lengths of 1000 to 10 000 with vectors of 512 bits. Only their ratios matter.
const RADICES: [(usize, f64); 6] = [(16, 5.0), (8, 3.7), (5, 3.5), (4, 2.6), (3, 2.6), (2, 2.0)];
const BESIDE_PASSES: f64 = 12.0;

/// Tables of the inverse transform of one length; the buffers are the caller's ([`Grid`]).
pub(in crate::dsp) struct GridPlan<T: Real> {
    arch: Arch,
    /// Numbers in a vector: rows of the grid.
    lanes: usize,
    n_columns: usize,
    /// For every W columns, for every row: W cosines, W sines.
    turns: Aligned<T>,
    stages: Vec<Stage<T>>,
}

/// One pass of the second step.
struct Stage<T> {
    radix: usize,
    /// Groups between two points that differ by one in the current index.
    stride: usize,
    /// For every point but those of the last pass: cosine and sine of each factor but the first.
    twiddles: Vec<T>,
    /// How what is read lies.
    from: Parts,
    /// How what is written lies.
    to: Parts,
}

/// A list of pairs in parts, between which there may be a gap: parts a power of two apart would share a few
/// sets of the cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Parts {
    /// Pairs in a part.
    len: usize,
    /// Pairs from one part to the next.
    pitch: usize,
}

impl Parts {
    fn new(len: usize, lanes: usize) -> Self {
        Self { len, pitch: if len.is_multiple_of(lanes) { len + 1 } else { len } }
    }
}

/// Buffers of a transform, for the longest of the plans that share them.
#[derive(Debug)]
pub(in crate::dsp) struct Grid<T: Real> {
    /// Real parts of the points, by rows, and some room behind them.
    pub(in crate::dsp) re: Aligned<T>,
    /// Imaginary parts.
    pub(in crate::dsp) im: Aligned<T>,
    block: Aligned<T>,
    ping: Aligned<T>,
    pong: Aligned<T>,
}

impl<T: Real> Grid<T> {
    /// Room for transforms of up to `length` points.
    pub(in crate::dsp) fn new(length: usize) -> Self {
        Self {
            re: Aligned::zeros(length + T::WIDTH),
            im: Aligned::zeros(length + T::WIDTH),
            block: Aligned::zeros(2 * T::WIDTH * T::WIDTH),
            // Whole squares, the last filled with what is not used, and gaps between parts.
            ping: Aligned::zeros(2 * (length + (T::WIDTH + 16) * T::WIDTH)),
            pong: Aligned::zeros(2 * (length + 16 * T::WIDTH)),
        }
    }
}

impl<T: Real> Grid<T> {
    /// Room for the results of a transform that was done elsewhere.
    pub(in crate::dsp) fn singles(&mut self, length: usize) -> &mut [T] {
        &mut self.ping[..2 * length]
    }
}

/// Time and radices of the passes for 2^a points, by the best of all choices.
fn binary_passes(a: usize) -> (f64, Vec<usize>) {
    let mut best: Vec<(f64, Vec<usize>)> = vec![(0.0, Vec::new())];
    for bits in 1..=a {
        let mut least = (f64::INFINITY, Vec::new());
        for (radix, time) in RADICES.iter().filter(|(radix, _)| radix.is_power_of_two()) {
            let own = radix.trailing_zeros() as usize;
            if own <= bits && best[bits - own].0 + time < least.0 {
                let mut radices = best[bits - own].1.clone();
                radices.push(*radix);
                least = (best[bits - own].0 + time, radices);
            }
        }
        best.push(least);
    }
    best.pop().unwrap_or_default()
}

/// Exponents of 2, 3 and 5 in `m`; `None` if there is another prime.
fn exponents(mut m: usize) -> Option<[usize; 3]> {
    let mut exponents = [0; 3];
    if m == 0 {
        return None;
    }
    for (exponent, prime) in exponents.iter_mut().zip([2, 3, 5]) {
        while m.is_multiple_of(prime) {
            m /= prime;
            *exponent += 1;
        }
    }
    (m == 1).then_some(exponents)
}

/// Time and radices of the passes for `m` points; `None` if a prime factor is above 5.
fn passes(m: usize) -> Option<(f64, Vec<usize>)> {
    let [twos, threes, fives] = exponents(m)?;
    let (mut time, mut radices) = binary_passes(twos);
    for (radix, n) in [(3, threes), (5, fives)] {
        let each = RADICES.iter().find(|(known, _)| *known == radix)?.1;
        time += each * n as f64;
        radices.extend(std::iter::repeat_n(radix, n));
    }
    radices.sort_unstable();
    Some((time, radices))
}

/// Whether a length has a grid on every processor with vectors.
pub(in crate::dsp) fn is_possible<T: Real>(length: usize) -> bool {
    // Half a vector of the widest is a vector everywhere, or several.
    let narrow = T::WIDTH / 2;
    let m = length / narrow;
    length.is_multiple_of(narrow) && m <= 2 * MAX_COLUMNS && exponents(m).is_some()
}

/// The cheapest length, whole rows of the widest vector, that is at least `n`; `None` if there is none.
/// The same on every processor.
pub(in crate::dsp) fn cheapest_length<T: Real>(n: usize) -> Option<usize> {
    let least = n.div_ceil(T::WIDTH).max(1);
    let mut best: Option<(f64, usize)> = None;
    // Of numbers with as many threes and fives the least that is enough is the cheapest.
    let mut fives = 1;
    while fives < 2 * least {
        let mut odd = fives;
        while odd < 2 * least {
            let m = odd * least.div_ceil(odd).next_power_of_two();
            if let Some((passes, _)) = passes(m).filter(|_| m <= MAX_COLUMNS) {
                let time = m as f64 * (BESIDE_PASSES + passes);
                if best.is_none_or(|(least_time, _)| time < least_time) {
                    best = Some((time, m));
                }
            }
            odd *= 3;
        }
        fives *= 5;
    }
    best.map(|(_, m)| m * T::WIDTH)
}

/// The processor's vectors for a length: the widest whose lanes divide it.
fn arch_for<T: Real>(length: usize) -> Arch {
    let widest = Arch::new();
    #[cfg(target_arch = "x86_64")]
    if !length.is_multiple_of(lanes_here::<T>(widest))
        && let Some(narrower) = pulp::x86::V3::try_new()
    {
        return Arch::V3(narrower);
    }
    widest
}

impl<T: Real> GridPlan<T> {
    /// Plans `length` points; `None` if that [is not possible](is_possible) or the processor has no
    /// vectors.
    pub(in crate::dsp) fn new(length: usize) -> Option<Self> {
        Self::on(arch_for::<T>(length), length)
    }

    fn on(arch: Arch, length: usize) -> Option<Self> {
        let lanes = lanes_here::<T>(arch);
        if lanes < T::BLOCK || !is_possible::<T>(length) || !length.is_multiple_of(lanes) {
            return None;
        }
        let n_columns = length / lanes;
        let (_, radices) = passes(n_columns)?;
        let mut stages = Vec::new();
        let (mut n, mut stride) = (n_columns, 1);
        for (i, &radix) in radices.iter().enumerate() {
            let mut twiddles = Vec::new();
            if n > radix {
                for p in 0..n / radix {
                    for i in 1..radix {
                        twiddles.extend(turn::<T>(i * p, n));
                    }
                }
            }
            let from = Parts::new(n_columns / radix, lanes);
            let to = match radices.get(i + 1) {
                Some(next) => Parts::new(n_columns / next, lanes),
                None => Parts { len: n_columns, pitch: n_columns },
            };
            stages.push(Stage { radix, stride, twiddles, from, to });
            (n, stride) = (n / radix, stride * radix);
        }
        let mut turns = Vec::with_capacity(2 * length);
        for first in (0..n_columns).step_by(lanes) {
            for row in 0..lanes {
                let factors: Vec<[T; 2]> =
                    (first..first + lanes).map(|column| turn(row * column, length)).collect();
                turns.extend(factors.iter().map(|[re, _]| *re));
                turns.extend(factors.iter().map(|[_, im]| *im));
            }
        }
        Some(Self { arch, lanes, n_columns, turns: Aligned::of(&turns), stages })
    }

    /// Points.
    pub(in crate::dsp) fn len(&self) -> usize {
        self.n_columns * self.lanes
    }

    /// Results of one kind that stand together: so many real parts, then so many imaginary parts.
    pub(in crate::dsp) fn lanes(&self) -> usize {
        self.lanes
    }

    /// Transforms the points in `grid.re` and `grid.im` (which are left as they are) with the sign +
    /// and returns groups of results: [`lanes`](Self::lanes) real parts, as many imaginary parts.
    pub(in crate::dsp) fn inverse<'a>(&self, grid: &'a mut Grid<T>) -> &'a mut [T] {
        let Grid { re, im, block, ping, pong } = grid;
        self.run((&re[..], &im[..]), block, ping, pong)
    }

    /// As [`Self::inverse`] with the sign −: the imaginary parts come first.
    pub(in crate::dsp) fn forward<'a>(&self, grid: &'a mut Grid<T>) -> &'a mut [T] {
        let Grid { re, im, block, ping, pong } = grid;
        self.run((&im[..], &re[..]), block, ping, pong)
    }

    fn run<'a>(
        &self,
        (re, im): (&[T], &[T]),
        block: &mut [T],
        ping: &'a mut [T],
        pong: &'a mut [T],
    ) -> &'a mut [T] {
        let n = self.len();
        let rows = (&re[..n + T::WIDTH], &im[..n + T::WIDTH]);
        self.arch.dispatch(Run { plan: self, rows, block, ping, pong });
        let results = if self.stages.len().is_multiple_of(2) { ping } else { pong };
        &mut results[..2 * n]
    }
}

impl<T: Real> fmt::Debug for GridPlan<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GridPlan").field("n_columns", &self.n_columns).finish_non_exhaustive()
    }
}

/// e^(j2πk/n), cosine and sine.
fn turn<T: Real>(k: usize, n: usize) -> [T; 2] {
    let (sin, cos) = (TAU * (k % n) as f64 / n as f64).sin_cos();
    [T::rounded(cos), T::rounded(sin)]
}

struct Run<'a, T: Real> {
    plan: &'a GridPlan<T>,
    rows: (&'a [T], &'a [T]),
    block: &'a mut [T],
    ping: &'a mut [T],
    pong: &'a mut [T],
}

impl<T: Real> WithSimd for Run<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Run { plan, rows, block, ping, pong } = self;
        match lanes_of::<T, S>() {
            16 => columns::<T, S, 16>(simd, plan, rows, block, ping),
            8 => columns::<T, S, 8>(simd, plan, rows, block, ping),
            4 => columns::<T, S, 4>(simd, plan, rows, block, ping),
            2 => columns::<T, S, 2>(simd, plan, rows, block, ping),
            _ => return,
        }
        let (from, _) = T::vectors_mut::<S>(ping).as_chunks_mut::<2>();
        let (to, _) = T::vectors_mut::<S>(pong).as_chunks_mut::<2>();
        let (mut from, mut to) = (from, to);
        for stage in &plan.stages {
            match stage.radix {
                16 => pass::<T, S, 16>(simd, stage, from, to),
                8 => pass::<T, S, 8>(simd, stage, from, to),
                5 => pass::<T, S, 5>(simd, stage, from, to),
                4 => pass::<T, S, 4>(simd, stage, from, to),
                3 => pass::<T, S, 3>(simd, stage, from, to),
                _ => pass::<T, S, 2>(simd, stage, from, to),
            }
            std::mem::swap(&mut from, &mut to);
        }
    }
}

/// The first step: transforms R points of every column, turns them and lays the grid down transposed.
#[inline(always)]
fn columns<T: Real, S: Simd, const R: usize>(
    simd: S,
    plan: &GridPlan<T>,
    (re, im): (&[T], &[T]),
    block: &mut [T],
    out: &mut [T],
) where
    [Numbers<T, S>; R]: Square<T, S>,
{
    let (block_re, block_im) = block[..2 * R * R].split_at_mut(R * R);
    let (turns, _) = T::vectors::<S>(&plan.turns).as_chunks::<2>();
    let parts = plan.stages.first().map(|stage| stage.from);
    for (i, turns) in turns.chunks_exact(R).enumerate() {
        // Where there is a gap, parts are whole squares.
        let at = parts.map_or(0, |parts| i * R + i * R / parts.len * (parts.pitch - parts.len));
        let out = &mut out[2 * R * at..][..2 * R * R];
        let points = <[Numbers<T, S>; R]>::of_rows(re, im, plan.n_columns, i * R);
        points.transformed(simd).turned_by_rows(simd, turns).put_blocks(
            simd,
            T::vectors_mut::<S>(block_re),
            T::vectors_mut::<S>(block_im),
        );
        if T::BLOCK == 4 {
            blocks::<T, 4, R>(block_re, block_im, out);
        } else {
            blocks::<T, 2, R>(block_re, block_im, out);
        }
    }
}

/// Puts the blocks of B numbers where the transposition has them.
#[inline(always)]
fn blocks<T: Real, const B: usize, const R: usize>(re: &[T], im: &[T], out: &mut [T]) {
    let (re, _) = re.as_chunks::<B>();
    let (im, _) = im.as_chunks::<B>();
    let (out, _) = out.as_chunks_mut::<B>();
    let (re, im, out) = (&re[..R * R / B], &im[..R * R / B], &mut out[..2 * R * R / B]);
    for upper in 0..R / B {
        for b in 0..R / B {
            for j in 0..B {
                let from = (upper * B + j) * (R / B) + b;
                let to = (b * B + j) * 2 * (R / B) + upper;
                out[to] = re[from];
                out[to + R / B] = im[from];
            }
        }
    }
}

/// A pass of the second step: points `p + i·n/R`, n the current length, give `R·p + i`.
#[inline(always)]
fn pass<T: Real, S: Simd, const R: usize>(
    simd: S,
    stage: &Stage<T>,
    from: &[Pair<T, S>],
    to: &mut [Pair<T, S>],
) where
    [Numbers<T, S>; R]: Points<T, S>,
{
    let mut inputs: [&[Pair<T, S>]; R] = [&[]; R];
    for (input, part) in inputs.iter_mut().zip(from.chunks_exact(stage.from.pitch)) {
        *input = &part[..stage.from.len];
    }
    let run = stage.stride;
    let mut factors = stage.twiddles.chunks_exact(2 * (R - 1));
    let mut p = 0;
    let n_parts = stage.from.len * R / stage.to.len;
    for part in to.chunks_exact_mut(stage.to.pitch).take(n_parts) {
        for to in part[..stage.to.len].chunks_exact_mut(R * run) {
            let factors = factors.next().unwrap_or_default();
            if run == 1 {
                // One pair a point.
                let points = <[Numbers<T, S>; R]>::of_pairs(&inputs, p);
                points.transformed(simd).turned(simd, factors).put_row(to);
            } else {
                run_of_pairs(simd, &inputs, p * run, factors, to);
            }
            p += 1;
        }
    }
}

/// As many transforms as `to` has room for, with the same factors.
#[inline(always)]
fn run_of_pairs<T: Real, S: Simd, const R: usize>(
    simd: S,
    inputs: &[&[Pair<T, S>]; R],
    first: usize,
    factors: &[T],
    to: &mut [Pair<T, S>],
) where
    [Numbers<T, S>; R]: Points<T, S>,
{
    let run = to.len() / R;
    let mut sources: [&[Pair<T, S>]; R] = [&[]; R];
    for (source, input) in sources.iter_mut().zip(inputs) {
        *source = &input[first..][..run];
    }
    let mut outputs: [&mut [Pair<T, S>]; R] = std::array::from_fn(|_| Default::default());
    let mut rest = to;
    for output in &mut outputs {
        let (first, others) = rest.split_at_mut(run);
        (*output, rest) = (first, others);
    }
    for at in 0..run {
        let points = <[Numbers<T, S>; R]>::of_pairs(&sources, at);
        points.transformed(simd).turned(simd, factors).put_pairs(&mut outputs, at);
    }
}

/// Numbers side by side in a vector of this processor; 1 where there are none.
fn lanes_here<T: Real>(arch: Arch) -> usize {
    struct Ask<T>(PhantomData<T>);
    impl<T: Real> WithSimd for Ask<T> {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            lanes_of::<T, S>()
        }
    }
    arch.dispatch(Ask::<T>(PhantomData))
}

#[cfg(test)]
mod tests;
