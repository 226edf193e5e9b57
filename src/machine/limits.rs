//! Optional limits of a machine, and the zone table behind `iso_group`.

use crate::units::Hz;

/// ISO 20816-3 machine group and support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum IsoGroup {
    /// Group 1 on a rigid support.
    Group1Rigid,
    /// Group 1 on a flexible support.
    Group1Flexible,
    /// Group 2 on a rigid support.
    Group2Rigid,
    /// Group 2 on a flexible support.
    Group2Flexible,
}

/// Boundaries of the evaluation zones, velocity RMS 10–1000 Hz on the housing, mm/s.
///
/// A value exactly on a boundary belongs to the better zone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityZones {
    /// Newly commissioned below, unrestricted operation above.
    pub a_b_mm_per_s: f64,
    /// Unrestricted operation below, limited operation above.
    pub b_c_mm_per_s: f64,
    /// Limited operation below, damage likely above.
    pub c_d_mm_per_s: f64,
}

/// Boundaries of the evaluation zones, displacement RMS 10–1000 Hz on the housing, µm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplacementZones {
    /// Newly commissioned below, unrestricted operation above.
    pub a_b_um: f64,
    /// Unrestricted operation below, limited operation above.
    pub b_c_um: f64,
    /// Limited operation below, damage likely above.
    pub c_d_um: f64,
}

/// One row of a zone table.
type ZoneRow = (IsoGroup, VelocityZones);

/// Edition the zone table is taken from.
pub const ZONE_EDITION: &str = "ISO 20816-3:2022";

/// Velocity zones of [`ZONE_EDITION`]; ISO 10816-3:2009 carries the same values.
pub const ZONES: &[ZoneRow] = &[
    (IsoGroup::Group1Rigid, zones(2.3, 4.5, 7.1)),
    (IsoGroup::Group1Flexible, zones(3.5, 7.1, 11.0)),
    (IsoGroup::Group2Rigid, zones(1.4, 2.8, 4.5)),
    (IsoGroup::Group2Flexible, zones(2.3, 4.5, 7.1)),
];

const fn zones(a_b_mm_per_s: f64, b_c_mm_per_s: f64, c_d_mm_per_s: f64) -> VelocityZones {
    VelocityZones { a_b_mm_per_s, b_c_mm_per_s, c_d_mm_per_s }
}

/// Edition the displacement zones are taken from. Not held against a copy of ISO 20816-3:2022; each follows from its
/// velocity zone at the corner of 12.5 Hz (group 1) or 10 Hz (group 2) within rounding.
pub const DISPLACEMENT_EDITION: &str = "ISO 10816-3:2009, tables A.1 and A.2";

/// Displacement zones of [`DISPLACEMENT_EDITION`].
pub const DISPLACEMENT_ZONES: &[(IsoGroup, DisplacementZones)] = &[
    (IsoGroup::Group1Rigid, displacements(29.0, 57.0, 90.0)),
    (IsoGroup::Group1Flexible, displacements(45.0, 90.0, 140.0)),
    (IsoGroup::Group2Rigid, displacements(22.0, 45.0, 71.0)),
    (IsoGroup::Group2Flexible, displacements(37.0, 71.0, 113.0)),
];

const fn displacements(a_b_um: f64, b_c_um: f64, c_d_um: f64) -> DisplacementZones {
    DisplacementZones { a_b_um, b_c_um, c_d_um }
}

/// Edition the zones of a shaft are taken from. Not held against a copy of ISO 20816-3:2022, which took its place.
pub const SHAFT_EDITION: &str = "ISO 7919-3:2009, annex A";

/// Boundaries A/B, B/C and C/D of the displacement of a shaft relative to its bearing, peak to peak, times the root of
/// the speed: µm·√(r/min), of [`SHAFT_EDITION`].
pub const SHAFT_ZONES: [f64; 3] = [4800.0, 9000.0, 13_200.0];

/// Speeds at which [`SHAFT_ZONES`] hold, r/min.
pub const SHAFT_ZONES_RPM: (f64, f64) = (1000.0, 30_000.0);

/// Zones of a shaft's relative displacement, peak to peak, at its highest speed of normal operation; `None` outside of
/// [`SHAFT_ZONES_RPM`]. The clearance of a bearing may ask for less.
#[must_use]
pub fn shaft_zones(speed: Hz) -> Option<DisplacementZones> {
    let rpm = speed.to_rpm().0;
    let (lowest, highest) = SHAFT_ZONES_RPM;
    let [a_b, b_c, c_d] = SHAFT_ZONES.map(|boundary| boundary / rpm.sqrt());
    (rpm >= lowest && rpm <= highest).then(|| displacements(a_b, b_c, c_d))
}

impl IsoGroup {
    /// Displacement zones of the group, from [`DISPLACEMENT_ZONES`].
    #[must_use]
    pub fn displacement_zones(self) -> Option<DisplacementZones> {
        DISPLACEMENT_ZONES.iter().find(|(group, _)| *group == self).map(|&(_, zones)| zones)
    }

    /// Every group with its spelling in machine files.
    pub const SPELLINGS: &'static [(&'static str, Self)] = &[
        ("1-rigid", Self::Group1Rigid),
        ("1-flexible", Self::Group1Flexible),
        ("2-rigid", Self::Group2Rigid),
        ("2-flexible", Self::Group2Flexible),
    ];

    /// Velocity zones of the group, from [`ZONES`].
    #[must_use]
    pub fn velocity_zones(self) -> Option<VelocityZones> {
        ZONES.iter().find(|(group, _)| *group == self).map(|&(_, zones)| zones)
    }
}

/// Limits of the `[limits]` table; all optional.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Limits {
    /// Velocity RMS 10–1000 Hz that raises a warning, mm/s.
    pub velocity_rms_warning_mm_per_s: Option<f64>,
    /// Velocity RMS 10–1000 Hz that counts as damaged (danger), mm/s.
    pub velocity_rms_damaged_mm_per_s: Option<f64>,
    /// Inner edges of the bins of load, rising, in the unit of the load sensor: a baseline holds in its
    /// bin only. Empty: loads within a fifth of the larger are one bin.
    pub load_bins: Vec<f64>,
}

impl Limits {
    /// Limits in force: each as stated, else the boundary B/C (warning) or C/D (damaged) of the
    /// ISO group, else none.
    #[must_use]
    pub fn or_zones_of(&self, group: Option<IsoGroup>) -> Self {
        let zones = group.and_then(IsoGroup::velocity_zones);
        Self {
            velocity_rms_warning_mm_per_s: self
                .velocity_rms_warning_mm_per_s
                .or(zones.map(|zones| zones.b_c_mm_per_s)),
            velocity_rms_damaged_mm_per_s: self
                .velocity_rms_damaged_mm_per_s
                .or(zones.map(|zones| zones.c_d_mm_per_s)),
            load_bins: self.load_bins.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_group_has_ascending_zones() {
        for (spelling, group) in IsoGroup::SPELLINGS {
            let zones = group.velocity_zones().unwrap();
            assert!(zones.a_b_mm_per_s < zones.b_c_mm_per_s, "{spelling}");
            assert!(zones.b_c_mm_per_s < zones.c_d_mm_per_s, "{spelling}");
        }
    }

    #[test]
    fn displacement_zones_are_velocity_zones_at_the_corner_of_the_group() {
        for (spelling, group) in IsoGroup::SPELLINGS {
            let corner_hz = if spelling.starts_with('1') { 12.5 } else { 10.0 };
            let (velocity, found) =
                (group.velocity_zones().unwrap(), group.displacement_zones().unwrap());
            let um = |mm_per_s: f64| 1e3 * mm_per_s / (std::f64::consts::TAU * corner_hz);
            for (mm_per_s, found) in [
                (velocity.a_b_mm_per_s, found.a_b_um),
                (velocity.b_c_mm_per_s, found.b_c_um),
                (velocity.c_d_mm_per_s, found.c_d_um),
            ] {
                // Both tables are rounded to two digits: 1.5 %.
                assert!((um(mm_per_s) / found - 1.0).abs() < 0.015, "{spelling}: {found}");
            }
        }
    }

    #[test]
    fn zones_of_a_shaft_fall_with_the_root_of_its_speed() {
        // 3600 r/min: the root is 60.
        let zones = shaft_zones(Hz(60.0)).unwrap();
        assert!((zones.a_b_um - 80.0).abs() < 1e-9 && (zones.b_c_um - 150.0).abs() < 1e-9);
        assert!((zones.c_d_um - 220.0).abs() < 1e-9);
        assert_eq!((shaft_zones(Hz(16.0)), shaft_zones(Hz(501.0))), (None, None));
    }

    #[test]
    fn stated_limits_come_before_zones() {
        let limits = Limits { velocity_rms_warning_mm_per_s: Some(2.0), ..Limits::default() };
        let in_force = limits.or_zones_of(Some(IsoGroup::Group2Rigid));
        // The trap is mixing rows: group 2 rigid ends at 4.5, not at the 7.1 of the flexible row.
        assert_eq!(in_force.velocity_rms_warning_mm_per_s, Some(2.0));
        assert_eq!(in_force.velocity_rms_damaged_mm_per_s, Some(4.5));
        assert_eq!(Limits::default().or_zones_of(None), Limits::default());
    }
}
