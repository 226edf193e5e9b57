//! Vectors of coordinates as the inner loops want them, and those loops.
//!
//! A vector of K complex numbers is a flat list of groups of 16: eight real parts, eight imaginary
//! parts, filled up with zeros. A real row over it is a list of the same length. Must not know what
//! the numbers mean.

use nalgebra::Complex;
use pulp::Simd;

/// Complex numbers in a group; every vector width divides it.
pub(super) const WIDTH: usize = 8;

/// Real numbers side by side.
pub(super) type Block = [f64; WIDTH];

/// Numbers in a group.
pub(super) const GROUP: usize = 2 * WIDTH;

/// Length of the list for `n` complex numbers.
pub(super) fn list_len(n: usize) -> usize {
    n.div_ceil(WIDTH) * GROUP
}

/// Places of the real and the imaginary part of number `k`.
pub(super) fn places(k: usize) -> (usize, usize) {
    let re = k / WIDTH * GROUP + k % WIDTH;
    (re, re + WIDTH)
}

/// Lays complex numbers out.
pub(super) fn list(numbers: &[Complex<f64>]) -> Vec<f64> {
    let mut list = vec![0.0; list_len(numbers.len())];
    for (k, number) in numbers.iter().enumerate() {
        let (re, im) = places(k);
        (list[re], list[im]) = (number.re, number.im);
    }
    list
}

/// The numbers of a list.
pub(super) fn numbers(list: &[f64], n: usize) -> Vec<Complex<f64>> {
    (0..n).map(places).map(|(re, im)| Complex::new(list[re], list[im])).collect()
}

/// Rows Re Σ c·s over coordinates, eight side by side: entry [place][row].
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Rows {
    /// Blocks of eight rows, each with one entry a place of the list.
    pub(super) blocks: Vec<Vec<[f64; WIDTH]>>,
}

impl Rows {
    /// Room for `n_rows` rows over lists of `len`.
    pub(super) fn zero(n_rows: usize, len: usize) -> Self {
        Self { blocks: vec![vec![[0.0; WIDTH]; len]; n_rows.div_ceil(WIDTH)] }
    }

    /// Length of the lists it can be applied to, or more.
    pub(super) fn len(&self) -> usize {
        self.blocks.first().map_or(0, Vec::len)
    }

    /// Sets one row from its weights c.
    pub(super) fn set(&mut self, row: usize, weights: &[Complex<f64>]) {
        let block = &mut self.blocks[row / WIDTH];
        for (k, weight) in weights.iter().enumerate() {
            let (re, im) = places(k);
            block[re][row % WIDTH] = weight.re;
            block[im][row % WIDTH] = -weight.im;
        }
    }

    /// All rows times the beginning of a list, into `out`, eight numbers a block.
    #[inline(always)]
    pub(super) fn times<S: Simd>(&self, simd: S, list: &[f64], out: &mut [[f64; WIDTH]]) {
        for (block, out) in self.blocks.iter().zip(out) {
            *out = eight_rows(simd, block, list);
        }
    }
}

/// Sums of eight products side by side, in four interleaved parts so that one addition need not
/// wait for the one before.
#[inline(always)]
fn eight_rows<S: Simd>(simd: S, block: &[[f64; WIDTH]], list: &[f64]) -> [f64; WIDTH] {
    const PARTS: usize = 4;
    let n_vectors = WIDTH / S::F64_LANES;
    let mut sums = [[simd.splat_f64s(0.0); WIDTH]; PARTS];
    for (rows, values) in block.chunks_exact(PARTS).zip(list.chunks_exact(PARTS)) {
        for part in 0..PARTS {
            let value = simd.splat_f64s(values[part]);
            let (weights, _) = S::as_simd_f64s(&rows[part]);
            for v in 0..n_vectors {
                sums[part][v] = simd.mul_add_e_f64s(weights[v], value, sums[part][v]);
            }
        }
    }
    let mut out = [0.0; WIDTH];
    let (vectors, _) = S::as_mut_simd_f64s(&mut out);
    for v in 0..n_vectors {
        let low = simd.add_f64s(sums[0][v], sums[1][v]);
        let high = simd.add_f64s(sums[2][v], sums[3][v]);
        vectors[v] = simd.add_f64s(low, high);
    }
    out
}

/// Numbers that change with the angles φ of the shafts: constant + Σ cos φ·c + sin φ·s, eight side by side.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Turning {
    constant: Vec<Block>,
    /// cos and sin part of every shaft.
    shafts: Vec<[Vec<Block>; 2]>,
}

impl Turning {
    /// Lays out constant, then cos and sin part of each of `n_shafts`, of each number.
    pub(super) fn new<const N: usize>(numbers: &[[f64; N]], n_shafts: usize) -> Self {
        let part = |part: usize| {
            let mut blocks = vec![[0.0; WIDTH]; numbers.len().div_ceil(WIDTH)];
            let places = blocks.as_flattened_mut().iter_mut();
            places.zip(numbers).for_each(|(place, number)| *place = number[part]);
            blocks
        };
        let shafts = (0..n_shafts).map(|k| [part(1 + 2 * k), part(2 + 2 * k)]);
        Self { constant: part(0), shafts: shafts.collect() }
    }

    /// The numbers at this cos and sin of every shaft, and as many others added.
    #[inline(always)]
    pub(super) fn plus<S: Simd>(
        &self,
        simd: S,
        angles: &[(f64, f64)],
        others: &[f64],
        out: &mut [Block],
    ) {
        let blocks = others.chunks_exact(WIDTH).zip(out).zip(&self.constant).enumerate();
        for (b, ((others, out), constant)) in blocks {
            let (constant, _) = S::as_simd_f64s(constant);
            let (others, _) = S::as_simd_f64s(others);
            let (out, _) = S::as_mut_simd_f64s(out);
            for v in 0..WIDTH / S::F64_LANES {
                out[v] = simd.add_f64s(constant[v], others[v]);
            }
            for ([of_cos, of_sin], (cos, sin)) in self.shafts.iter().zip(angles) {
                let (cos, sin) = (simd.splat_f64s(*cos), simd.splat_f64s(*sin));
                let (of_cos, _) = S::as_simd_f64s(&of_cos[b]);
                let (of_sin, _) = S::as_simd_f64s(&of_sin[b]);
                for v in 0..WIDTH / S::F64_LANES {
                    out[v] = simd.mul_add_e_f64s(of_cos[v], cos, out[v]);
                    out[v] = simd.mul_add_e_f64s(of_sin[v], sin, out[v]);
                }
            }
        }
    }
}

/// out ← out + Σ columns·amounts; `columns` holds as many blocks a column as `out` has.
#[inline(always)]
pub(super) fn push<S: Simd>(simd: S, columns: &[Block], amounts: &[f64], out: &mut [Block]) {
    let n_blocks = out.len().max(1);
    for (b, out) in out.iter_mut().enumerate() {
        let (out, _) = S::as_mut_simd_f64s(out);
        // Two sums, so that one addition need not wait for the one before.
        let mut sums = [[simd.splat_f64s(0.0); WIDTH]; 2];
        for (pair, amounts) in columns.chunks(2 * n_blocks).zip(amounts.chunks(2)) {
            for ((column, amount), sum) in pair.chunks_exact(n_blocks).zip(amounts).zip(&mut sums) {
                let amount = simd.splat_f64s(*amount);
                let (column, _) = S::as_simd_f64s(&column[b]);
                for v in 0..WIDTH / S::F64_LANES {
                    sum[v] = simd.mul_add_e_f64s(column[v], amount, sum[v]);
                }
            }
        }
        for v in 0..WIDTH / S::F64_LANES {
            out[v] = simd.add_f64s(out[v], simd.add_f64s(sums[0][v], sums[1][v]));
        }
    }
}

/// to = factor·from + Σ columns·amounts. `columns` holds, for every group, one group a column: first
/// those of the first of the three lists of amounts, and so on. Lists of amounts may be longer.
#[inline(always)]
pub(super) fn carry<S: Simd>(
    simd: S,
    factor: &[f64],
    (columns, n): (&[f64], usize),
    amounts: [&[f64]; 3],
    (from, to): (&[f64], &mut [f64]),
) {
    let groups = from.chunks_exact(GROUP).zip(to.chunks_exact_mut(GROUP));
    let maps = factor.chunks_exact(GROUP).zip(columns.chunks_exact((3 * n * GROUP).max(1)));
    for ((from, to), (factor, columns)) in groups.zip(maps) {
        let (first, rest) = columns.split_at(n * GROUP);
        let (second, third) = rest.split_at(n * GROUP);
        for v in 0..WIDTH / S::F64_LANES {
            let factor = Numbers::<S>::load(factor, v);
            // Three sums, so that one addition need not wait for the one before.
            let mut sums = [
                Numbers::load(from, v).product(simd, factor),
                Numbers::zero(simd),
                Numbers::zero(simd),
            ];
            let columns = first
                .chunks_exact(GROUP)
                .zip(second.chunks_exact(GROUP))
                .zip(third.chunks_exact(GROUP));
            let forces = amounts[0].iter().zip(amounts[1]).zip(amounts[2]);
            for (((a, b), c), ((fa, fb), fc)) in columns.zip(forces) {
                sums[0] = sums[0].plus_scaled(simd, Numbers::load(a, v), *fa);
                sums[1] = sums[1].plus_scaled(simd, Numbers::load(b, v), *fb);
                sums[2] = sums[2].plus_scaled(simd, Numbers::load(c, v), *fc);
            }
            sums[0].plus(simd, sums[1].plus(simd, sums[2])).store(to, v);
        }
    }
}

/// to = factor·from + Σ weights·amounts for groups that have one factor and three weights in
/// common: [re, im] of factor and weights, and eight amounts a group of each. Groups beyond the
/// amounts get none.
#[inline(always)]
pub(super) fn carry_alike<S: Simd>(
    simd: S,
    [factor, first, second, third]: [[f64; 2]; 4],
    amounts: [&[Block]; 3],
    (from, to): (&[f64], &mut [f64]),
) {
    let factor = Numbers::<S>::splat(simd, factor);
    let weights = [
        Numbers::<S>::splat(simd, first),
        Numbers::<S>::splat(simd, second),
        Numbers::<S>::splat(simd, third),
    ];
    let groups = from.chunks_exact(GROUP).zip(to.chunks_exact_mut(GROUP));
    for (g, (from, to)) in groups.enumerate() {
        for v in 0..WIDTH / S::F64_LANES {
            let mut sum = Numbers::load(from, v).product(simd, factor);
            for (weight, amounts) in weights.iter().zip(amounts) {
                if let Some(amounts) = amounts.get(g) {
                    let (amounts, _) = S::as_simd_f64s(amounts);
                    sum.re = simd.mul_add_e_f64s(weight.re, amounts[v], sum.re);
                    sum.im = simd.mul_add_e_f64s(weight.im, amounts[v], sum.im);
                }
            }
            sum.store(to, v);
        }
    }
}

/// A vector of complex numbers in registers.
#[derive(Clone, Copy)]
pub(super) struct Numbers<S: Simd> {
    pub(super) re: S::f64s,
    pub(super) im: S::f64s,
}

impl<S: Simd> Numbers<S> {
    /// Vector `v` of a group.
    #[inline(always)]
    pub(super) fn load(group: &[f64], v: usize) -> Self {
        let (re, _) = S::as_simd_f64s(&group[..WIDTH]);
        let (im, _) = S::as_simd_f64s(&group[WIDTH..GROUP]);
        Self { re: re[v], im: im[v] }
    }

    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        Self::splat(simd, [0.0; 2])
    }

    /// The same number in all places.
    #[inline(always)]
    pub(super) fn splat(simd: S, [re, im]: [f64; 2]) -> Self {
        Self { re: simd.splat_f64s(re), im: simd.splat_f64s(im) }
    }

    /// Plus others times a real number.
    #[inline(always)]
    pub(super) fn plus_scaled(self, simd: S, other: Self, factor: f64) -> Self {
        let factor = simd.splat_f64s(factor);
        Self {
            re: simd.mul_add_e_f64s(other.re, factor, self.re),
            im: simd.mul_add_e_f64s(other.im, factor, self.im),
        }
    }

    /// Writes to vector `v` of a group.
    #[inline(always)]
    pub(super) fn store(self, group: &mut [f64], v: usize) {
        let (re, im) = group.split_at_mut(WIDTH);
        S::as_mut_simd_f64s(re).0[v] = self.re;
        S::as_mut_simd_f64s(&mut im[..WIDTH]).0[v] = self.im;
    }

    #[inline(always)]
    pub(super) fn product(self, simd: S, other: Self) -> Self {
        let re = simd.mul_f64s(self.re, other.re);
        let im = simd.mul_f64s(self.re, other.im);
        Self {
            re: simd.negate_mul_add_e_f64s(self.im, other.im, re),
            im: simd.mul_add_e_f64s(self.im, other.re, im),
        }
    }

    #[inline(always)]
    pub(super) fn plus(self, simd: S, other: Self) -> Self {
        Self { re: simd.add_f64s(self.re, other.re), im: simd.add_f64s(self.im, other.im) }
    }

    #[inline(always)]
    pub(super) fn times(self, simd: S, factor: f64) -> Self {
        let factor = simd.splat_f64s(factor);
        Self { re: simd.mul_f64s(self.re, factor), im: simd.mul_f64s(self.im, factor) }
    }

    /// Adds a real number.
    #[inline(always)]
    pub(super) fn plus_real(self, simd: S, number: f64) -> Self {
        Self { re: simd.add_f64s(self.re, simd.splat_f64s(number)), im: self.im }
    }
}
