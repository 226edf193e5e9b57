//! Compliance of a tooth by the potential-energy method (R20–R22).
//!
//! The tooth is a short cantilever of varying section. The load acts along the line of action, at an
//! angle that the place on the flank decides.

use super::gear::GearShape;
use super::quadrature::Rule;
use std::f64::consts::PI;

/// Elastic constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steel {
    /// Young's modulus E, Pa.
    pub young_pa: f64,
    /// Poisson's ratio ν.
    pub poisson: f64,
}

/// Where the cantilever is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Root {
    /// On the base circle, whatever the root circle: the plain geometry of the first papers.
    BaseCircle,
    /// On the root circle; between it and a larger base circle the tooth is as thick as on that.
    RootCircle,
}

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToothModel {
    /// Material.
    pub steel: Steel,
    /// Where the tooth is held.
    pub root: Root,
    /// Whether the gear body under the tooth yields.
    pub foundation: bool,
}

/// A crack from the root of a tooth on the loaded side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crack {
    /// Length, m.
    pub depth_m: f64,
    /// Angle to the centre line of the tooth, rad.
    pub angle_rad: f64,
}

/// What a tooth has lost.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToothState {
    /// Layer gone from the flank, m, normal to it.
    pub worn_m: f64,
    /// Crack.
    pub crack: Option<Crack>,
}

/// Compliances of a tooth along the line of action, m/N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// Compression along the tooth 1/k_a.
    pub axial: f64,
    /// Bending 1/k_b.
    pub bending: f64,
    /// Shear 1/k_s.
    pub shear: f64,
    /// Body of the gear under the tooth 1/k_f.
    pub foundation: f64,
}

impl Compliance {
    /// All together, m/N.
    #[must_use]
    pub fn sum(self) -> f64 {
        self.axial + self.bending + self.shear + self.foundation
    }
}

/// Coefficients A to F of L*, M*, P*, Q* (R22).
const FOUNDATION: [[f64; 6]; 4] = [
    [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045],
    [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086],
    [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236],
    [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904],
];

/// Where the polynomials of the foundation hold: root radius ÷ bore radius, and half of the angle of
/// a tooth on its root circle, rad.
pub(super) const FOUNDATION_VALID: ([f64; 2], [f64; 2]) = ([1.4, 7.0], [0.01, 0.12]);

/// L*, M*, P*, Q* for h = root radius ÷ bore radius and the half angle of the tooth at its root.
pub(super) fn foundation_factors(h: f64, half_rad: f64) -> [f64; 4] {
    FOUNDATION.map(|[a, b, c, d, e, f]| {
        a / (half_rad * half_rad) + b * h * h + c * h / half_rad + d / half_rad + e * h + f
    })
}

/// Integrals over a tooth, with the rule they are done by.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tooth {
    gear: GearShape,
    model: ToothModel,
    rule: Rule,
}

/// A load on a flank: lever arm from the gear's centre and from the centre line, m, and its direction.
#[derive(Clone, Copy)]
struct Loaded {
    along_m: f64,
    across_m: f64,
    sin: f64,
    cos: f64,
}

impl Tooth {
    pub(super) fn new(gear: GearShape, model: ToothModel) -> Self {
        Self { gear, model, rule: Rule::new() }
    }

    /// Distance of a crack's tip from the centre line, m; below 0 beyond it.
    fn crack_tip_m(&self, crack: Crack) -> f64 {
        self.gear.half_root_m() - crack.depth_m * crack.angle_rad.sin()
    }

    /// Roll angle at which a flank comes as near to the centre line as a crack's tip: from there
    /// outwards the tooth is whole. `None`: nowhere on the flank.
    pub(super) fn crack_ends(&self, crack: Crack) -> Option<f64> {
        let tip_m = self.crack_tip_m(crack);
        let over = |roll: f64| self.gear.flank(roll).1 - tip_m;
        let (mut low, mut high) = (self.first_roll(), self.gear.roll_at(self.gear.tip_radius_m()));
        if over(low) <= 0.0 || over(high) >= 0.0 {
            return None;
        }
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if over(middle) > 0.0 { low = middle } else { high = middle }
        }
        Some(high)
    }

    /// Roll angle at which the involute begins to be part of the cantilever.
    fn first_roll(&self) -> f64 {
        match self.model.root {
            Root::BaseCircle => 0.0,
            Root::RootCircle => self.gear.roll_at(self.gear.root_radius_m()),
        }
    }

    /// Compliances at a roll angle (R20, R21, R22).
    pub(super) fn compliance(&self, state: ToothState, roll_rad: f64) -> Compliance {
        let gear = &self.gear;
        let (along_m, half_m) = gear.flank(roll_rad);
        let (sin, cos) = (roll_rad - gear.half_base_rad()).sin_cos();
        let load = Loaded { along_m, across_m: half_m - state.worn_m / cos, sin, cos };
        let mut sum = [0.0; 3];
        let mut add = |part: [f64; 3]| sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        // The straight part below the base circle.
        let (base, root) = (gear.base_radius_m(), gear.root_radius_m());
        if self.model.root == Root::RootCircle && root < base {
            let (from_base, half_base) = gear.flank(0.0);
            let from_root = (root * root - half_base * half_base).max(0.0).sqrt();
            let thickness = self.thickness(half_base, 0.0, state.crack);
            add(self.rule.integrate(from_root, from_base, |x| self.energy(load, x, thickness)));
        }
        // The involute, cut where a crack ends.
        let first = self.first_roll();
        let cut = state.crack.and_then(|crack| self.crack_ends(crack)).unwrap_or(first);
        let cut = cut.clamp(first, roll_rad.max(first));
        for (from, to) in [(first, cut), (cut, roll_rad)] {
            add(self.rule.integrate(from, to, |roll| {
                let (x, half) = gear.flank(roll);
                let tau_cos = (gear.half_base_rad() - roll).cos();
                let thickness = self.thickness(half, state.worn_m / tau_cos, state.crack);
                // dx = R_b·roll·cos τ·d(roll)
                let stretch = base * roll * tau_cos;
                self.energy(load, x, thickness).map(|part| part * stretch)
            }));
        }
        let foundation = if self.model.foundation { self.foundation(load) } else { 0.0 };
        Compliance { axial: sum[0], bending: sum[1], shear: sum[2], foundation }
    }

    /// Thickness that carries, m: two halves less wear; on the side of a crack no more than up to the
    /// height of its tip.
    fn thickness(&self, half_m: f64, worn_m: f64, crack: Option<Crack>) -> f64 {
        let loaded = crack.map_or(half_m, |crack| half_m.min(self.crack_tip_m(crack)));
        half_m + loaded - worn_m
    }

    /// Integrands of 1/k_a, 1/k_b, 1/k_s at `x` from the gear's centre (R20, R21).
    fn energy(&self, load: Loaded, x: f64, thickness_m: f64) -> [f64; 3] {
        let Steel { young_pa, poisson } = self.model.steel;
        let shear_pa = 0.5 * young_pa / (1.0 + poisson);
        let area = thickness_m * self.gear.face_m;
        let inertia = area * thickness_m * thickness_m / 12.0;
        let moment = (load.along_m - x) * load.cos - load.across_m * load.sin;
        [
            load.sin * load.sin / (young_pa * area),
            moment * moment / (young_pa * inertia),
            1.2 * load.cos * load.cos / (shear_pa * area),
        ]
    }

    /// 1/k_f (R22).
    fn foundation(&self, load: Loaded) -> f64 {
        let gear = &self.gear;
        let (root, half_rad) = (gear.root_radius_m(), gear.half_root_rad());
        let [l, m, p, q] = foundation_factors(2.0 * root / gear.bore_m, half_rad);
        // The line of action crosses the centre line at R_b/cos α₁ from the centre.
        let height = (gear.base_radius_m() / load.cos - root) / (2.0 * root * half_rad);
        let tan = load.sin / load.cos;
        load.cos * load.cos / (self.model.steel.young_pa * gear.face_m)
            * (l * height * height + m * height + p * (1.0 + q * tan * tan))
    }

    /// Smallest thickness of the worn or cracked tooth, m: below 0 it is gone.
    pub(super) fn least_thickness_m(&self, state: ToothState) -> f64 {
        let tip = self.gear.roll_at(self.gear.tip_radius_m());
        let at = |roll: f64| {
            let tau_cos = (self.gear.half_base_rad() - roll).cos();
            self.thickness(self.gear.flank(roll).1, state.worn_m / tau_cos, state.crack)
        };
        // Monotone from base to tip but for wear, which is almost even.
        (0..=32).map(|k| at(tip * f64::from(k) / 32.0)).fold(f64::INFINITY, f64::min)
    }
}

/// Hertzian compliance of two equal materials over a face, m/N: 1/k_h = 4(1 − ν²)/(πEL) (R20).
pub(super) fn hertz(steel: Steel, face_m: f64) -> f64 {
    4.0 * (1.0 - steel.poisson * steel.poisson) / (PI * steel.young_pa * face_m)
}
