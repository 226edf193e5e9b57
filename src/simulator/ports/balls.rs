//! The balls of a bearing side by side: the force of [`Contacts`] without damping, for the inner
//! loop (equations R10–R13).
//!
//! Computed in the cage's frame, where the balls stand still: displacement is turned into it and the
//! force back. Must not know shafts.

use crate::simulator::contact::Contacts;
use crate::simulator::lanes::{Block, WIDTH};
use pulp::Simd;

/// A bearing's balls.
#[derive(Debug, Clone)]
pub(super) struct Balls {
    contacts: Contacts,
    /// Direction of every ball in the cage; filled up with balls that never touch.
    cos: Vec<f64>,
    sin: Vec<f64>,
    /// Displacement along a ball's direction from which it carries load, m.
    gap_m: Vec<f64>,
    /// Whether `gap_m` changes inside a step.
    is_moving: bool,
    /// Whether a ball was over a defect when `gap_m` was last set.
    was_over: bool,
    /// 2^j of ball j, 0 of what fills up.
    code: Vec<f64>,
    /// Sums of the codes of the balls that carried load at the start of the step, side by side, and the
    /// largest differences to them later in it.
    loaded: Block,
    changed: Block,
    /// Scratch: the same at three moments.
    gaps_m: [Vec<f64>; 3],
    factor: f64,
    /// Largest approaches of balls so far, m.
    peak_m: Block,
}

impl Balls {
    /// Takes over a bearing.
    pub(super) fn new(contacts: Contacts) -> Self {
        let n = contacts.seats().len().next_multiple_of(WIDTH);
        let (mut cos, mut sin) = (vec![0.0; n], vec![0.0; n]);
        for (j, (c, s)) in contacts.seats().iter().enumerate() {
            (cos[j], sin[j]) = (*c, *s);
        }
        let mut gap_m = vec![f64::INFINITY; n];
        let code: Vec<f64> =
            (0..n).scan(1.0, |code, _| Some(std::mem::replace(code, *code * 2.0))).collect();
        gap_m[..contacts.seats().len()].fill(contacts.bearing().clearance_m);
        Self {
            is_moving: contacts.has_waves(),
            was_over: false,
            code,
            loaded: [0.0; WIDTH],
            changed: [0.0; WIDTH],
            gaps_m: Default::default(),
            factor: contacts.bearing().contact_factor,
            peak_m: [0.0; WIDTH],
            contacts,
            cos,
            sin,
            gap_m,
        }
    }

    /// The bearing.
    pub(super) fn contacts(&self) -> &Contacts {
        &self.contacts
    }

    /// Exchanges the bearing for one with the same balls; the largest load so far stays.
    pub(super) fn exchange(&mut self, contacts: Contacts) {
        let peak_m = self.peak_m;
        *self = Self::new(contacts);
        self.peak_m = peak_m;
    }

    /// Largest load of a ball so far, N.
    pub(super) fn peak_force_n(&self) -> f64 {
        let peak_m = self.peak_m.iter().fold(0.0_f64, |most, peak| most.max(*peak));
        self.factor * peak_m * peak_m.sqrt()
    }

    /// Decides which balls are over which defects for a step whose middle has this shaft angle.
    pub(super) fn set_side(&mut self, shaft_rad: f64) {
        self.contacts.set_side(shaft_rad);
        let is_over = self.contacts.is_over_defect();
        if is_over || self.was_over {
            self.contacts.gaps_m(shaft_rad, &mut self.gap_m);
        }
        self.is_moving = self.contacts.has_waves() || self.contacts.is_over_slope();
        self.was_over = is_over;
    }

    /// Force on the shaft, N, at a displacement, m; `cage` is cos and sin of the cage's angle,
    /// `is_start` whether a step begins here.
    #[inline(always)]
    pub(super) fn force<S: Simd>(
        &mut self,
        simd: S,
        shaft_rad: f64,
        cage: (f64, f64),
        [x, y]: [f64; 2],
        is_start: bool,
    ) -> [f64; 2] {
        if self.is_moving {
            self.contacts.gaps_m(shaft_rad, &mut self.gap_m);
        }
        let u = simd.splat_f64s(x * cage.0 + y * cage.1);
        let v_across = simd.splat_f64s(y * cage.0 - x * cage.1);
        let zero = simd.splat_f64s(0.0);
        let (mut along, mut across) = (zero, zero);
        let (code, _) = S::as_simd_f64s(&self.code);
        let (cos, _) = S::as_simd_f64s(&self.cos);
        let (sin, _) = S::as_simd_f64s(&self.sin);
        let (gap, _) = S::as_simd_f64s(&self.gap_m);
        let (peak, _) = S::as_mut_simd_f64s(&mut self.peak_m);
        let (at_start, _) = S::as_mut_simd_f64s(&mut self.loaded);
        let (changed, _) = S::as_mut_simd_f64s(&mut self.changed);
        for v in 0..WIDTH / S::F64_LANES {
            let mut loaded = zero;
            let step = WIDTH / S::F64_LANES;
            for i in (v..cos.len()).step_by(step) {
                let mut approach = simd.sub_f64s(simd.mul_f64s(u, cos[i]), gap[i]);
                approach = simd.mul_add_e_f64s(v_across, sin[i], approach);
                let is_loaded = simd.less_than_f64s(zero, approach);
                loaded = simd.add_f64s(loaded, simd.select_f64s(is_loaded, code[i], zero));
                approach = simd.max_f64s(approach, zero);
                let load = simd.mul_f64s(approach, simd.sqrt_f64s(approach));
                along = simd.mul_add_e_f64s(load, cos[i], along);
                across = simd.mul_add_e_f64s(load, sin[i], across);
                peak[v] = simd.max_f64s(peak[v], approach);
            }
            if is_start {
                (at_start[v], changed[v]) = (loaded, zero);
            } else {
                let change = simd.abs_f64s(simd.sub_f64s(loaded, at_start[v]));
                changed[v] = simd.max_f64s(changed[v], change);
            }
        }
        let along = self.factor * simd.reduce_sum_f64s(along);
        let across = self.factor * simd.reduce_sum_f64s(across);
        [across * cage.1 - along * cage.0, -across * cage.0 - along * cage.1]
    }

    /// Tangent stiffness −∂F/∂u at a displacement, N/m: xx, xy, yy.
    pub(super) fn stiffness_n_per_m(&self, cage: (f64, f64), [x, y]: [f64; 2]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for ((c, s), gap) in self.cos.iter().zip(&self.sin).zip(&self.gap_m) {
            let (cos, sin) = (cage.0 * c - cage.1 * s, cage.1 * c + cage.0 * s);
            let approach = x * cos + y * sin - gap;
            if approach > 0.0 {
                let stiffness = 1.5 * self.factor * approach.sqrt();
                sum[0] += stiffness * cos * cos;
                sum[1] += stiffness * cos * sin;
                sum[2] += stiffness * sin * sin;
            }
        }
        sum
    }

    /// Whether a ball touched or left since the step's start, as far as the stages saw.
    pub(super) fn has_touched(&self) -> bool {
        self.changed.iter().any(|change| *change > 0.0)
    }

    /// The part of a step after which a ball first touches or leaves, from angle of the shaft, that
    /// of the cage and displacement at its start, middle and end; `None` if none does, or so
    /// close to an end that it does not matter.
    pub(super) fn first_touch(&mut self, looks: [Look; 3]) -> Option<f64> {
        let mut first: Option<f64> = None;
        let n = self.contacts.seats().len();
        if self.is_moving {
            for (look, gaps) in looks.iter().zip(&mut self.gaps_m) {
                gaps.resize(n, 0.0);
                self.contacts.gaps_m(look.0, gaps);
            }
        }
        let turned = looks.map(|(_, (cos, sin), [x, y])| (x * cos + y * sin, y * cos - x * sin));
        for j in 0..n {
            let approach = |k: usize| {
                let gap = if self.is_moving { self.gaps_m[k][j] } else { self.gap_m[j] };
                turned[k].0 * self.cos[j] + turned[k].1 * self.sin[j] - gap
            };
            let [a, b, c] = [approach(0), approach(1), approach(2)];
            let changes = (a > 0.0) != (b > 0.0) || (b > 0.0) != (c > 0.0);
            if let Some(part) = changes.then(|| first_zero(a, b, c)).flatten() {
                first = Some(first.map_or(part, |first| first.min(part)));
            }
        }
        first
    }
}

/// Angle of the shaft, cos and sin of the cage's, displacement.
pub(super) type Look = (f64, (f64, f64), [f64; 2]);

/// A touch this close to the ends of a step is left in it: what the force misses there goes with
/// the 2.5th power of the time.
const MARGIN: f64 = 0.02;

/// First zero well inside (0, 1) of the parabola with these values at 0, 1/2 and 1.
fn first_zero(start: f64, middle: f64, end: f64) -> Option<f64> {
    let square = 2.0 * (start - 2.0 * middle + end);
    let linear = 4.0 * middle - 3.0 * start - end;
    let root = (linear * linear - 4.0 * square * start).max(0.0).sqrt();
    // Both zeros without cancellation.
    let q = -0.5 * (linear + root.copysign(linear));
    let inside = |x: &f64| (MARGIN..=1.0 - MARGIN).contains(x);
    [q / square, start / q].into_iter().filter(inside).min_by(f64::total_cmp)
}
