//! Sensors and where they sit.

use super::{BearingIndex, GearIndex, ShaftIndex};
use crate::units::{Hz, SourceUnit};

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
    /// Unit stated by the machine file, with its spelling.
    pub unit: Option<(String, SourceUnit)>,
    /// Where it sits; a tacho or speed sensor sits at the shaft it observes.
    pub at: Option<Location>,
    /// Sensitive direction in the plane normal to the shaft, degrees; `None` = unknown, no pair.
    pub axis_deg: Option<f64>,
    /// Radial or axial.
    pub direction: Option<Direction>,
    /// Band in which the sensor may be believed.
    pub usable: Option<(Hz, Hz)>,
    /// Volts per canonical physical unit, when the unit is V: (factor, physical unit by kind).
    pub sensitivity_v_per_unit: Option<f64>,
    /// For tachos.
    pub tacho: Option<TachoMark>,
}
