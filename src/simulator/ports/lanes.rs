//! Vectors of coordinates as the inner loops want them, and those loops.
//!
//! A vector of K complex numbers is a flat list of groups of 16: eight real parts, eight imaginary
//! parts, filled up with zeros. A real row over it is a list of the same length. Must not know what
//! the numbers mean.

use nalgebra::Complex;
use pulp::Simd;

/// Complex numbers in a group; every vector width divides it.
pub(super) const WIDTH: usize = 8;

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

/// s ← factor·s + Σ columns·amounts. `columns` holds, for every group, one group a column.
#[inline(always)]
pub(super) fn carry<S: Simd>(
    simd: S,
    factor: &[f64],
    columns: &[f64],
    amounts: &[f64],
    list: &mut [f64],
) {
    let groups = list.chunks_exact_mut(GROUP).zip(factor.chunks_exact(GROUP));
    for ((s, factor), columns) in groups.zip(columns.chunks_exact(GROUP * amounts.len())) {
        let (s_re, s_im) = s.split_at_mut(WIDTH);
        let (s_re, _) = S::as_mut_simd_f64s(s_re);
        let (s_im, _) = S::as_mut_simd_f64s(s_im);
        let (f_re, _) = S::as_simd_f64s(&factor[..WIDTH]);
        let (f_im, _) = S::as_simd_f64s(&factor[WIDTH..]);
        for v in 0..WIDTH / S::F64_LANES {
            let mut re = simd.mul_f64s(f_re[v], s_re[v]);
            re = simd.negate_mul_add_e_f64s(f_im[v], s_im[v], re);
            let mut im = simd.mul_f64s(f_re[v], s_im[v]);
            im = simd.mul_add_e_f64s(f_im[v], s_re[v], im);
            for (column, amount) in columns.chunks_exact(GROUP).zip(amounts) {
                let amount = simd.splat_f64s(*amount);
                let (c_re, _) = S::as_simd_f64s(&column[..WIDTH]);
                let (c_im, _) = S::as_simd_f64s(&column[WIDTH..]);
                re = simd.mul_add_e_f64s(c_re[v], amount, re);
                im = simd.mul_add_e_f64s(c_im[v], amount, im);
            }
            (s_re[v], s_im[v]) = (re, im);
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
