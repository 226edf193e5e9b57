//! Optional limits of a machine, and the zone table behind `iso_group`.

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

impl IsoGroup {
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
    fn stated_limits_come_before_zones() {
        let limits = Limits { velocity_rms_warning_mm_per_s: Some(2.0), ..Limits::default() };
        let in_force = limits.or_zones_of(Some(IsoGroup::Group2Rigid));
        // The trap is mixing rows: group 2 rigid ends at 4.5, not at the 7.1 of the flexible row.
        assert_eq!(in_force.velocity_rms_warning_mm_per_s, Some(2.0));
        assert_eq!(in_force.velocity_rms_damaged_mm_per_s, Some(4.5));
        assert_eq!(Limits::default().or_zones_of(None), Limits::default());
    }
}
