//! Sensors, where they sit and which of them form x/y pairs.

use super::{BearingIndex, GearIndex, Machine, ShaftIndex};
use crate::units::{Hz, SourceUnit, Unit};

/// What a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SensorKind {
    /// Acceleration.
    Accelerometer,
    /// Velocity.
    Velocity,
    /// Shaft displacement by proximity probe.
    Proximitor,
    /// Once- or n-per-revolution pulses.
    Tacho,
    /// A speed signal.
    Speed,
    /// Load (operating-state bin).
    Load,
    /// Temperature (operating-state bin).
    Temperature,
    /// Other process value (operating-state bin).
    Process,
}

/// Where a sensor sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Location {
    /// At a bearing's housing (or beside it, for a probe).
    Bearing(BearingIndex),
    /// At a shaft.
    Shaft(ShaftIndex),
    /// At a gear mesh.
    Gear(GearIndex),
}

/// Sensitive direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Normal to the shaft.
    Radial,
    /// Along the shaft.
    Axial,
}

/// Which edge of a tacho pulse marks the angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TachoEdge {
    /// Low to high.
    Rising,
    /// High to low.
    Falling,
}

/// How tacho pulses mark the shaft angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TachoMark {
    /// Pulses a revolution, ≥ 1.
    pub pulses_per_rev: u32,
    /// Marking edge.
    pub edge: TachoEdge,
    /// Shaft angle at the marking edge, degrees.
    pub offset_deg: f64,
}

/// One sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Channel of captures and streams it reads.
    pub channel: String,
    /// What it measures.
    pub kind: SensorKind,
    /// Unit stated by the machine file, with its spelling; [`SourceUnit::UNKNOWN`] for a process
    /// value whose unit the monitor only shows.
    pub unit: Option<(String, SourceUnit)>,
    /// Where it sits; a tacho or speed sensor sits at the shaft it observes.
    pub at: Option<Location>,
    /// Sensitive direction in the plane normal to the shaft, degrees; `None` = unknown, no pair.
    pub axis_deg: Option<f64>,
    /// Radial or axial.
    pub direction: Option<Direction>,
    /// Band in which the sensor may be believed.
    pub usable: Option<(Hz, Hz)>,
    /// Volts per canonical unit of the kind ([`SensorKind::canonical_unit`]); only with unit V,
    /// never 0, negative when the sensor is wired the other way round.
    pub sensitivity_v_per_unit: Option<f64>,
    /// Lowest and highest gap voltage at which a probe may be believed, V; only with unit V.
    pub gap_v: Option<(f64, f64)>,
    /// For tachos.
    pub tacho: Option<TachoMark>,
}

/// Two sensors that measure the same place in two directions at right angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorPair {
    /// Place in [`Machine::sensors`] of the sensor from which the other is reached by +90°.
    pub x: usize,
    /// Place in [`Machine::sensors`] of the other.
    pub y: usize,
}

/// How far from a right angle the axes of a pair may stand, degrees.
pub const PAIR_TOLERANCE_DEG: f64 = 5.0;

impl SensorKind {
    /// Every kind with its spelling in machine files.
    pub const SPELLINGS: &'static [(&'static str, Self)] = &[
        ("accelerometer", Self::Accelerometer),
        ("velocity", Self::Velocity),
        ("proximitor", Self::Proximitor),
        ("tacho", Self::Tacho),
        ("speed", Self::Speed),
        ("load", Self::Load),
        ("temperature", Self::Temperature),
        ("process", Self::Process),
    ];

    /// Spelling in machine files and documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::SPELLINGS.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Canonical unit of the physical quantity: the unit results carry, and the one that
    /// `sensitivity_v_per_unit` counts in. `None` where the monitor knows no such quantity.
    #[must_use]
    pub fn canonical_unit(self) -> Option<Unit> {
        match self {
            Self::Accelerometer => Some(Unit::MetrePerSecondSquared),
            Self::Velocity => Some(Unit::MillimetrePerSecond),
            Self::Proximitor => Some(Unit::Micrometre),
            Self::Speed => Some(Unit::Hertz),
            Self::Tacho | Self::Load | Self::Temperature | Self::Process => None,
        }
    }

    /// Whether it measures vibration, so that a place and a direction belong to it.
    #[must_use]
    pub fn is_vibration(self) -> bool {
        matches!(self, Self::Accelerometer | Self::Velocity | Self::Proximitor)
    }
}

impl Sensor {
    /// Unit of its samples after conversion, as far as the machine file tells: the physical unit,
    /// or [`Unit::Volt`] when uncalibrated; `None` when the file states no unit.
    #[must_use]
    pub fn canonical_unit(&self) -> Option<Unit> {
        let (_, unit) = self.unit.as_ref()?;
        match self.sensitivity_v_per_unit {
            Some(_) => self.kind.canonical_unit(),
            None => Some(unit.canonical),
        }
    }
}

impl Machine {
    /// Pairs the sensors of equal kind, unit and place whose axes stand 90° ± 5° apart.
    ///
    /// In file order; each sensor belongs to one pair at most. Equal sample rates and starts are
    /// for the reader of the data to check.
    #[must_use]
    pub fn sensor_pairs(&self) -> Vec<SensorPair> {
        let mut taken = vec![false; self.sensors.len()];
        let mut pairs = Vec::new();
        for (i, first) in self.sensors.iter().enumerate() {
            let partner =
                (i + 1..self.sensors.len()).filter(|&j| !taken[i] && !taken[j]).find_map(|j| {
                    let quarter = quarter_turn(first, &self.sensors[j])?;
                    Some(if quarter { (j, i, j) } else { (j, j, i) })
                });
            if let Some((j, x, y)) = partner {
                (taken[i], taken[j]) = (true, true);
                pairs.push(SensorPair { x, y });
            }
        }
        pairs
    }
}

/// Whether b lies a quarter turn after a (true) or before it (false); `None`: they are no pair.
fn quarter_turn(a: &Sensor, b: &Sensor) -> Option<bool> {
    let alike = a.kind == b.kind
        && a.kind.is_vibration()
        && a.at.is_some()
        && a.at == b.at
        && a.canonical_unit() == b.canonical_unit();
    if !alike {
        return None;
    }
    let from_a_to_b = (b.axis_deg? - a.axis_deg?).rem_euclid(360.0);
    if (from_a_to_b - 90.0).abs() <= PAIR_TOLERANCE_DEG {
        Some(true)
    } else if (from_a_to_b - 270.0).abs() <= PAIR_TOLERANCE_DEG {
        Some(false)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;

    /// A machine with one sensor per (kind, unit, place, axis in degrees).
    fn machine(sensors: &[(&str, &str, &str, f64)]) -> Machine {
        let mut text = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
                        [[bearing]]\nid='b'\nshaft='s'\ncatalogue='6205'\n"
            .to_owned();
        for (index, (kind, unit, at, axis)) in sensors.iter().enumerate() {
            text.push_str(&format!(
                "[[sensor]]\nchannel='{index}'\nkind='{kind}'\nunit='{unit}'\nat={at}\n\
                 axis_deg={axis}\n"
            ));
        }
        file::parse(&text, "m.toml").unwrap()
    }

    fn pairs(sensors: &[(&str, &str, &str, f64)]) -> Vec<(usize, usize)> {
        machine(sensors).sensor_pairs().iter().map(|pair| (pair.x, pair.y)).collect()
    }

    const BEARING: &str = "{bearing='b'}";
    const SHAFT: &str = "{shaft='s'}";

    fn axes(first: f64, second: f64) -> Vec<(usize, usize)> {
        pairs(&[("proximitor", "um", SHAFT, first), ("proximitor", "um", SHAFT, second)])
    }

    #[test]
    fn x_is_the_one_from_which_y_is_reached_by_a_quarter_turn() {
        assert_eq!(axes(0.0, 90.0), [(0, 1)]);
        assert_eq!(axes(90.0, 0.0), [(1, 0)]);
        // The usual probe mounting, 45° either side of the top, and angles past a full turn.
        assert_eq!(axes(45.0, 135.0), [(0, 1)]);
        assert_eq!(axes(315.0, 45.0), [(0, 1)]);
        assert_eq!(axes(-45.0, -135.0), [(1, 0)]);
    }

    #[test]
    fn five_degrees_off_is_still_a_right_angle() {
        assert_eq!(axes(0.0, 95.0), [(0, 1)]);
        assert_eq!(axes(0.0, 85.0), [(0, 1)]);
        assert_eq!(axes(0.0, 265.0), [(1, 0)]);
        assert!(axes(0.0, 95.5).is_empty());
        assert!(axes(0.0, 84.5).is_empty());
        assert!(axes(0.0, 0.0).is_empty());
        assert!(axes(0.0, 180.0).is_empty());
    }

    #[test]
    fn kind_unit_and_place_must_agree() {
        let x = ("accelerometer", "g", BEARING, 0.0);
        assert_eq!(pairs(&[x, ("accelerometer", "g", BEARING, 90.0)]), [(0, 1)]);
        // Units are equal after conversion.
        assert_eq!(pairs(&[x, ("accelerometer", "m/s^2", BEARING, 90.0)]), [(0, 1)]);
        assert!(pairs(&[x, ("accelerometer", "V", BEARING, 90.0)]).is_empty());
        assert!(pairs(&[x, ("accelerometer", "g", SHAFT, 90.0)]).is_empty());
        let v = ("accelerometer", "V", BEARING, 0.0);
        assert!(pairs(&[v, ("velocity", "V", BEARING, 90.0)]).is_empty());
    }

    #[test]
    fn each_sensor_belongs_to_one_pair_at_most() {
        let at = |axis| ("accelerometer", "g", BEARING, axis);
        assert_eq!(pairs(&[at(0.0), at(90.0), at(180.0), at(270.0)]), [(0, 1), (2, 3)]);
        assert_eq!(pairs(&[at(0.0), at(90.0), at(-90.0)]), [(0, 1)]);
    }
}
