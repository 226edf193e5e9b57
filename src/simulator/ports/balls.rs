//! The balls of a bearing side by side: the force of [`Contacts`] without damping, for the inner
//! loop (equations R10–R13).
//!
//! Computed in the cage's frame, where the balls stand still: displacement is turned into it and the
//! force back. Must not know shafts.

use super::lanes::WIDTH;
use crate::simulator::contact::Contacts;
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
    factor: f64,
    /// Largest approach of a ball so far, m.
    peak_m: f64,
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
        gap_m[..contacts.seats().len()].fill(contacts.bearing().clearance_m);
        Self {
            is_moving: contacts.has_waves(),
            was_over: false,
            factor: contacts.bearing().contact_factor,
            peak_m: 0.0,
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
        self.factor * self.peak_m * self.peak_m.sqrt()
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

    /// Force on the shaft, N, at a displacement, m; `cage` is cos and sin of the cage's angle.
    #[inline(always)]
    pub(super) fn force<S: Simd>(
        &mut self,
        simd: S,
        shaft_rad: f64,
        cage: (f64, f64),
        [x, y]: [f64; 2],
    ) -> [f64; 2] {
        if self.is_moving {
            self.contacts.gaps_m(shaft_rad, &mut self.gap_m);
        }
        let u = simd.splat_f64s(x * cage.0 + y * cage.1);
        let v = simd.splat_f64s(y * cage.0 - x * cage.1);
        let zero = simd.splat_f64s(0.0);
        let (mut along, mut across, mut peak) = (zero, zero, zero);
        let (cos, _) = S::as_simd_f64s(&self.cos);
        let (sin, _) = S::as_simd_f64s(&self.sin);
        let (gap, _) = S::as_simd_f64s(&self.gap_m);
        for ((&c, &s), &gap) in cos.iter().zip(sin).zip(gap) {
            let mut approach = simd.sub_f64s(simd.mul_f64s(u, c), gap);
            approach = simd.mul_add_e_f64s(v, s, approach);
            approach = simd.max_f64s(approach, zero);
            let load = simd.mul_f64s(approach, simd.sqrt_f64s(approach));
            along = simd.mul_add_e_f64s(load, c, along);
            across = simd.mul_add_e_f64s(load, s, across);
            peak = simd.max_f64s(peak, approach);
        }
        self.peak_m = self.peak_m.max(simd.reduce_max_f64s(peak));
        let along = self.factor * simd.reduce_sum_f64s(along);
        let across = self.factor * simd.reduce_sum_f64s(across);
        [across * cage.1 - along * cage.0, -across * cage.0 - along * cage.1]
    }
}
