//! What the machine is: shafts, bearings, gears, motors and sensors, validated and immutable.
//!
//! Built from a machine file (contract: `docs/machines.md`) by [`file::parse`]; lengths are SI
//! metres, angles degrees or radians as named. Must not know signals, files on disk or faults.

pub mod shaft;
pub mod bearing;
pub mod gear;
pub mod motor;
pub mod sensor;
pub mod limits;
pub mod train;
pub mod kinematics;
pub mod file;

use bearing::Bearing;
use gear::GearMesh;
use limits::Limits;
use motor::Motor;
use sensor::Sensor;
use shaft::Shaft;

/// Place of a shaft in [`Machine::shafts`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ShaftIndex(pub usize);

/// Place of a bearing in [`Machine::bearings`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BearingIndex(pub usize);

/// Place of a gear mesh in [`Machine::gears`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct GearIndex(pub usize);

/// A validated machine: every reference resolved, every shaft's speed ratio known.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Identifier used in paths and documents: letters, digits, `-`, `_`, `.`.
    pub id: String,
    /// Name for people.
    pub name: String,
    /// ISO 20816-3 group, e.g. `2-rigid`.
    pub iso_group: Option<limits::IsoGroup>,
    /// Rated power, kW.
    pub power_kw: Option<f64>,
    /// Shafts; speeds of documents refer to the first.
    pub shafts: Vec<Shaft>,
    /// Rolling bearings.
    pub bearings: Vec<Bearing>,
    /// Electric motors, whose lines are no faults.
    pub motors: Vec<Motor>,
    /// Gear meshes.
    pub gears: Vec<GearMesh>,
    /// Sensors, one a channel.
    pub sensors: Vec<Sensor>,
    /// Optional limits.
    pub limits: Limits,
}
