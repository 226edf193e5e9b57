//! The linear maps of one step length (equations R9, R33): how the free motion goes on, and what
//! forces at the ports add to it and to the displacements of the ports.
//!
//! Must not know what makes the forces.

use crate::simulator::lanes::{self, Block, GROUP, Numbers, Rows, WIDTH};
use nalgebra::Complex;
use pulp::Simd;

/// Coordinates with the ports at which forces come in and displacements are read.
#[derive(Debug, Clone)]
pub(super) struct Ported {
    /// Number of ports: forces that come in.
    pub(super) n_in: usize,
    /// Number of motions that are read: the displacement of every port, then what else is asked for.
    pub(super) n_out: usize,
    /// λ of the coordinates, laid out, and behind them the poles of the filters.
    lambda: Vec<f64>,
    /// Length of the list of the coordinates.
    len: usize,
    pub(super) n_poles: usize,
    /// Largest |λ|, rad/s.
    largest: f64,
    /// What a unit force at each port does, laid out.
    inputs: Vec<Vec<f64>>,
    /// What is read: rows 0.. of the first, and again from `n_out` on in the second.
    early: Rows,
    late: Rows,
}

/// The maps of one step length.
#[derive(Debug, Clone, Default)]
pub(super) struct StepMap {
    /// exp(λ·h), laid out, of the coordinates and the poles.
    pub(super) whole: Vec<f64>,
    /// What is read of the free motion in the middle, then at the end.
    pub(super) free: Rows,
    /// For each group, one group a column: forces at the start of every port, those in the middle,
    /// those at the end.
    pub(super) columns: Vec<f64>,
    /// What is read in the middle by a force from the start on: blocks of every port.
    pub(super) stage: Vec<Block>,
    /// What is read at the end by the force that acted over the first half.
    pub(super) carried: Vec<Block>,
    /// What is read at the end by the weighted forces of start, middle and end.
    pub(super) weighted: [Vec<Block>; 3],
    /// Scratch: exp(λ·h/2), effect of a force over half a step, and one column.
    half: Vec<f64>,
    half_force: Vec<f64>,
    column: Vec<f64>,
    sums: Vec<Block>,
    /// Weights of R9 for the forces at start, in the middle and at the end, laid out like `whole`.
    powers: [Vec<f64>; 3],
}

/// 1/n! for the series of φ₃, n = 3 to 20: for |z| ≤ 1 the first term left out is below 1/21!.
const INVERSE_FACTORIALS: [f64; 18] = inverse_factorials();

const fn inverse_factorials() -> [f64; 18] {
    let mut list = [0.0; 18];
    let (mut factorial, mut n) = (2.0, 3);
    while n < 21 {
        factorial *= n as f64;
        list[n - 3] = 1.0 / factorial;
        n += 1;
    }
    list
}

impl Ported {
    /// Coordinates of rates λ with what forces do to them and how they are read, and poles of filters
    /// that the forces drive.
    pub(super) fn new(
        values: &[Complex<f64>],
        inputs: &[Vec<Complex<f64>>],
        outputs: &[Vec<Complex<f64>>],
        poles: &[Complex<f64>],
    ) -> Self {
        let (n_out, len) = (outputs.len(), lanes::list_len(values.len()));
        let (mut early, mut late) = (Rows::zero(2 * n_out, len), Rows::zero(2 * n_out, len));
        for (i, weights) in outputs.iter().enumerate() {
            early.set(i, weights);
            late.set(n_out + i, weights);
        }
        Self {
            n_in: inputs.len(),
            n_out,
            lambda: [lanes::list(values), lanes::list(poles)].concat(),
            len,
            n_poles: poles.len(),
            largest: values.iter().chain(poles).map(|value| value.norm()).fold(0.0, f64::max),
            inputs: inputs.iter().map(|input| lanes::list(input)).collect(),
            early,
            late,
        }
    }

    /// What is read of a free motion, into the first numbers of `out`.
    #[inline(always)]
    pub(super) fn read<S: Simd>(&self, simd: S, list: &[f64], out: &mut [[f64; WIDTH]]) {
        self.early.times(simd, list, &mut out[..self.n_out.div_ceil(WIDTH)]);
    }
}

impl StepMap {
    /// Room for the maps of `ported`.
    pub(super) fn new(ported: &Ported) -> Self {
        let (n_in, n_out, len) = (ported.n_in, ported.n_out, ported.len);
        let table = || vec![[0.0; WIDTH]; n_in * n_out.div_ceil(WIDTH)];
        let all = ported.lambda.len();
        Self {
            whole: vec![0.0; all],
            free: Rows::zero(2 * n_out, ported.early.len()),
            columns: vec![0.0; 3 * n_in * len],
            stage: table(),
            carried: table(),
            weighted: [table(), table(), table()],
            half: vec![0.0; all],
            half_force: vec![0.0; all],
            column: vec![0.0; len],
            sums: vec![[0.0; WIDTH]; (2 * n_out).div_ceil(WIDTH)],
            powers: [vec![0.0; all], vec![0.0; all], vec![0.0; all]],
        }
    }

    /// Carries coordinates and filters over a step by the amounts of force at start, in the middle and
    /// at the end, eight ports a block.
    #[inline(always)]
    pub(super) fn carry<S: Simd>(
        &self,
        simd: S,
        ported: &Ported,
        amounts: [&[Block]; 3],
        (from, to): (&[f64], &mut [f64]),
    ) {
        let (from, from_filters) = from.split_at(ported.len);
        let (to, to_filters) = to.split_at_mut(ported.len);
        let flat = amounts.map(|blocks| blocks.as_flattened());
        lanes::carry(simd, &self.whole, (&self.columns, ported.n_in), flat, (from, to));
        if ported.n_poles == 0 {
            return;
        }
        let each = from_filters.len() / ported.n_poles;
        let [first, second, third] = &self.powers;
        let lists = from_filters.chunks_exact(each).zip(to_filters.chunks_exact_mut(each));
        for (p, (from, to)) in lists.enumerate() {
            let k = ported.len / GROUP * WIDTH + p;
            let weights = [&self.whole, first, second, third].map(|list| number(list, k));
            lanes::carry_alike(simd, weights, amounts, (from, to));
        }
    }

    /// Computes the maps for a step of `step_s`.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, simd: S, ported: &Ported, step_s: f64) {
        self.functions(simd, ported, step_s);
        self.rows(simd, ported);
        for port in 0..ported.n_in {
            self.port(simd, ported, port);
        }
    }

    /// exp, φ₁, φ₂, φ₃ of λ·h by series of a part of it and doubling, and the weights of R9.
    #[inline(always)]
    fn functions<S: Simd>(&mut self, simd: S, ported: &Ported, step_s: f64) {
        // The argument is halved so often that its size is at most 1, at least once.
        let mut doublings = 1;
        let mut scale = 0.5 * step_s;
        while scale * ported.largest > 1.0 {
            scale *= 0.5;
            doublings += 1;
        }
        for (g, lambda) in ported.lambda.chunks_exact(GROUP).enumerate() {
            let at = g * GROUP..(g + 1) * GROUP;
            for v in 0..WIDTH / S::F64_LANES {
                let z = Numbers::<S>::load(lambda, v).times(simd, scale);
                let mut phi = series(simd, z);
                for _ in 1..doublings {
                    phi = doubled(simd, phi);
                }
                phi[0].store(&mut self.half[at.clone()], v);
                phi[1].times(simd, 0.5 * step_s).store(&mut self.half_force[at.clone()], v);
                let [whole, one, two, three] = doubled(simd, phi);
                whole.store(&mut self.whole[at.clone()], v);
                let (one, two) = (one.times(simd, step_s), two.times(simd, step_s));
                let four = three.times(simd, 4.0 * step_s);
                let start = one.plus(simd, two.times(simd, -3.0)).plus(simd, four);
                start.store(&mut self.powers[0][at.clone()], v);
                let middle = two.plus(simd, two).plus(simd, four.times(simd, -1.0));
                middle.store(&mut self.powers[1][at.clone()], v);
                four.plus(simd, two.times(simd, -1.0)).store(&mut self.powers[2][at.clone()], v);
            }
        }
    }

    /// Rows of the free displacements: those of now, with exp(λ·h/2) and exp(λ·h) before them.
    #[inline(always)]
    fn rows<S: Simd>(&mut self, simd: S, ported: &Ported) {
        let given = ported.early.blocks.iter().zip(&ported.late.blocks);
        for (block, (early, late)) in self.free.blocks.iter_mut().zip(given) {
            for g in 0..block.len() / GROUP {
                for k in 0..WIDTH {
                    let (re, im) = (g * GROUP + k, g * GROUP + WIDTH + k);
                    let half_re = simd.splat_f64s(self.half[re]);
                    let half_im = simd.splat_f64s(self.half[im]);
                    let whole_re = simd.splat_f64s(self.whole[re]);
                    let whole_im = simd.splat_f64s(self.whole[im]);
                    let (early_re, _) = S::as_simd_f64s(&early[re]);
                    let (early_im, _) = S::as_simd_f64s(&early[im]);
                    let (late_re, _) = S::as_simd_f64s(&late[re]);
                    let (late_im, _) = S::as_simd_f64s(&late[im]);
                    let mut out = [[0.0; WIDTH]; 2];
                    let [out_re, out_im] = &mut out;
                    let (out_re, _) = S::as_mut_simd_f64s(out_re);
                    let (out_im, _) = S::as_mut_simd_f64s(out_im);
                    for v in 0..WIDTH / S::F64_LANES {
                        // A row holds Re c and −Im c: (c·e) → Re c·Re e − Im c·Im e and so on.
                        let mut a = simd.mul_f64s(early_re[v], half_re);
                        a = simd.mul_add_e_f64s(early_im[v], half_im, a);
                        a = simd.mul_add_e_f64s(late_re[v], whole_re, a);
                        out_re[v] = simd.mul_add_e_f64s(late_im[v], whole_im, a);
                        let mut b = simd.mul_f64s(early_im[v], half_re);
                        b = simd.negate_mul_add_e_f64s(early_re[v], half_im, b);
                        b = simd.mul_add_e_f64s(late_im[v], whole_re, b);
                        out_im[v] = simd.negate_mul_add_e_f64s(late_re[v], whole_im, b);
                    }
                    (block[re], block[im]) = (out[0], out[1]);
                }
            }
        }
    }

    /// What a force at one port does to the coordinates and to all that is read.
    #[inline(always)]
    fn port<S: Simd>(&mut self, simd: S, ported: &Ported, port: usize) {
        let (n_in, n) = (ported.n_in, ported.n_out);
        let input = &ported.inputs[port];
        let place = port * n.div_ceil(WIDTH) * WIDTH;
        let at = place..place + n;
        product(simd, &self.half_force, input, &mut self.column);
        // The later blocks of the rows of now are empty.
        let n_now = n.div_ceil(WIDTH);
        ported.early.times(simd, &self.column, &mut self.sums[..n_now]);
        let sums = self.sums.as_flattened();
        self.stage.as_flattened_mut()[at.clone()].copy_from_slice(&sums[..n]);
        self.free.times(simd, &self.column, &mut self.sums[..n_now]);
        let sums = self.sums.as_flattened();
        self.carried.as_flattened_mut()[at.clone()].copy_from_slice(&sums[..n]);
        for kind in 0..3 {
            product(simd, &self.powers[kind], input, &mut self.column);
            let place = (kind * n_in + port) * GROUP;
            for (g, group) in self.column.chunks_exact(GROUP).enumerate() {
                let start = g * 3 * n_in * GROUP + place;
                self.columns[start..start + GROUP].copy_from_slice(group);
            }
            ported.early.times(simd, &self.column, &mut self.sums[..n_now]);
            let sums = self.sums.as_flattened();
            self.weighted[kind].as_flattened_mut()[at.clone()].copy_from_slice(&sums[..n]);
        }
    }
}

/// The number at place `k` of a list.
fn number(list: &[f64], k: usize) -> [f64; 2] {
    let (re, im) = lanes::places(k);
    [list[re], list[im]]
}

/// Products of two lists, number by number.
#[inline(always)]
fn product<S: Simd>(simd: S, a: &[f64], b: &[f64], out: &mut [f64]) {
    let groups = a.chunks_exact(GROUP).zip(b.chunks_exact(GROUP));
    for ((a, b), out) in groups.zip(out.chunks_exact_mut(GROUP)) {
        for v in 0..WIDTH / S::F64_LANES {
            Numbers::<S>::load(a, v).product(simd, Numbers::load(b, v)).store(out, v);
        }
    }
}

/// [e^z, φ₁, φ₂, φ₃] for |z| ≤ 1: φ₃ = Σ zⁿ/(n+3)!, φₖ = z·φₖ₊₁ + 1/k!.
#[inline(always)]
fn series<S: Simd>(simd: S, z: Numbers<S>) -> [Numbers<S>; 4] {
    let zero = simd.splat_f64s(0.0);
    let mut sum = Numbers { re: zero, im: zero };
    for coefficient in INVERSE_FACTORIALS.iter().rev() {
        sum = sum.product(simd, z).plus_real(simd, *coefficient);
    }
    let two = sum.product(simd, z).plus_real(simd, 0.5);
    let one = two.product(simd, z).plus_real(simd, 1.0);
    [one.product(simd, z).plus_real(simd, 1.0), one, two, sum]
}

/// The same functions of 2z: φₖ(2z) = 2⁻ᵏ·(e^z·φₖ + Σⱼ φⱼ/(k−j)!).
#[inline(always)]
fn doubled<S: Simd>(simd: S, [exp, one, two, three]: [Numbers<S>; 4]) -> [Numbers<S>; 4] {
    let grown = |phi: Numbers<S>| exp.product(simd, phi).plus(simd, phi);
    [
        exp.product(simd, exp),
        grown(one).times(simd, 0.5),
        grown(two).plus(simd, one).times(simd, 0.25),
        grown(three).plus(simd, two).plus(simd, one.times(simd, 0.5)).times(simd, 0.125),
    ]
}
