//! The involute of a spur gear without profile shift, and the path of contact of two (R18, R19).

use std::f64::consts::PI;

/// A spur gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearShape {
    /// Number of teeth z.
    pub teeth: u32,
    /// Module, m.
    pub module_m: f64,
    /// Pressure angle α of the rack, rad.
    pub pressure_rad: f64,
    /// Face width, m.
    pub face_m: f64,
    /// Bore, m.
    pub bore_m: f64,
    /// Addendum, modules.
    pub addendum: f64,
    /// Dedendum, modules.
    pub dedendum: f64,
}

/// The path of contact, m along the line of action from the pitch point: a pair meets at `begin`
/// and parts at `end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// Below 0.
    pub begin_m: f64,
    /// Above 0.
    pub end_m: f64,
    /// Distance of two pairs p_b.
    pub pitch_m: f64,
}

impl Path {
    /// Contact ratio ε.
    #[must_use]
    pub fn contact_ratio(self) -> f64 {
        (self.end_m - self.begin_m) / self.pitch_m
    }

    /// The path shortened at both ends to this contact ratio, as tip relief does.
    #[must_use]
    pub fn with_contact_ratio(self, ratio: f64) -> Self {
        let part = ratio / self.contact_ratio();
        Self { begin_m: part * self.begin_m, end_m: part * self.end_m, ..self }
    }
}

impl GearShape {
    /// A gear with the addendum of one module and the dedendum of 1.25.
    #[must_use]
    pub fn standard(
        teeth: u32,
        module_m: f64,
        pressure_rad: f64,
        face_m: f64,
        bore_m: f64,
    ) -> Self {
        Self { teeth, module_m, pressure_rad, face_m, bore_m, addendum: 1.0, dedendum: 1.25 }
    }

    /// Number of teeth.
    #[must_use]
    pub fn z(&self) -> f64 {
        f64::from(self.teeth)
    }

    /// Pitch radius, m.
    #[must_use]
    pub fn pitch_radius_m(&self) -> f64 {
        0.5 * self.z() * self.module_m
    }

    /// Base radius, m.
    #[must_use]
    pub fn base_radius_m(&self) -> f64 {
        self.pitch_radius_m() * self.pressure_rad.cos()
    }

    /// Tip radius, m.
    #[must_use]
    pub fn tip_radius_m(&self) -> f64 {
        self.pitch_radius_m() + self.addendum * self.module_m
    }

    /// Root radius, m.
    #[must_use]
    pub fn root_radius_m(&self) -> f64 {
        self.pitch_radius_m() - self.dedendum * self.module_m
    }

    /// Roll angle (tangent of the pressure angle) of the involute at a radius, rad; 0 inside the base
    /// circle.
    #[must_use]
    pub fn roll_at(&self, radius_m: f64) -> f64 {
        let ratio = radius_m / self.base_radius_m();
        (ratio * ratio - 1.0).max(0.0).sqrt()
    }

    /// Half of the angle a tooth takes on the base circle, rad: π/(2z) + inv α.
    #[must_use]
    pub fn half_base_rad(&self) -> f64 {
        0.5 * PI / self.z() + self.pressure_rad.tan() - self.pressure_rad
    }

    /// Point of the flank at a roll angle: along the centre line of the tooth from the gear's centre,
    /// and across it, m (R18).
    #[must_use]
    pub fn flank(&self, roll_rad: f64) -> (f64, f64) {
        let (sin, cos) = (self.half_base_rad() - roll_rad).sin_cos();
        let base = self.base_radius_m();
        (base * (cos - roll_rad * sin), base * (sin + roll_rad * cos))
    }

    /// Half thickness of a tooth where it grows out of the body, m: on the base circle, or on the
    /// root circle if that is larger.
    #[must_use]
    pub fn half_root_m(&self) -> f64 {
        self.flank(self.roll_at(self.root_radius_m())).1
    }

    /// Half of the angle a tooth takes on its root circle, rad.
    #[must_use]
    pub fn half_root_rad(&self) -> f64 {
        (self.half_root_m() / self.root_radius_m()).clamp(-1.0, 1.0).asin()
    }

    /// The path of contact with a mate on the nominal centre distance; this gear is the driven one,
    /// so its tip meets first (R19). Contact inside a base circle is cut off.
    #[must_use]
    pub fn path(&self, mate: &Self) -> Path {
        let side = |gear: &Self, other: &Self| {
            let base = gear.base_radius_m();
            let addendum = base * (gear.roll_at(gear.tip_radius_m()) - gear.pressure_rad.tan());
            addendum.min(other.base_radius_m() * other.pressure_rad.tan())
        };
        Path {
            begin_m: -side(self, mate),
            end_m: side(mate, self),
            pitch_m: PI * self.module_m * self.pressure_rad.cos(),
        }
    }
}
