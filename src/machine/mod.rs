//! What the machine is: shafts, bearings, gears, motors and sensors, validated and immutable.
//!
//! Built from a machine file (contract: `docs/machines.md`) by [`file::parse`]; lengths are SI
//! metres, angles degrees or radians as named. Must not know signals, files on disk or faults.

pub mod shaft;
pub mod bearing;
pub mod uncertainty;
pub mod catalogue;
mod nearest;
pub mod gear;
pub mod motor;
pub mod sensor;
pub mod limits;
pub mod alarm_limit;
pub mod train;
pub mod kinematics;
pub mod file;
pub mod report;

use std::collections::BTreeMap;

use alarm_limit::AlarmLimits;
use bearing::Bearing;
use gear::GearMesh;
use limits::Limits;
use motor::Motor;
use sensor::{Location, Sensor};
use shaft::Shaft;

use crate::units::Hz;

/// Place of a shaft in [`Machine::shafts`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ShaftIndex(pub usize);

/// Place of a bearing in [`Machine::bearings`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BearingIndex(pub usize);

/// Place of a gear mesh in [`Machine::gears`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct GearIndex(pub usize);

/// Place of a motor in [`Machine::motors`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MotorIndex(pub usize);

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
    /// Shafts, at least one; speeds of documents refer to the first.
    pub shafts: Vec<Shaft>,
    /// Rolling bearings.
    pub bearings: Vec<Bearing>,
    /// Electric motors, whose lines are no faults.
    pub motors: Vec<Motor>,
    /// Gear meshes.
    pub gears: Vec<GearMesh>,
    /// Sensors, one a channel.
    pub sensors: Vec<Sensor>,
    /// Optional limits of the diagnosis.
    pub limits: Limits,
    /// Limits that raise alarms of their own.
    pub alarm_limits: AlarmLimits,
    /// `[capture.map]`: channel name to the place of its samples in foreign captures
    /// (`/path[,column=K][,rate=HZ][,unit=U]`), not yet read.
    pub capture_map: BTreeMap<String, String>,
    /// Remarks of the file's reader that are no mistakes, e.g. a catalogue designation beside a
    /// geometry; each names its line and key.
    pub notes: Vec<String>,
}

/// A part of the machine at which a sensor sits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Component<'m> {
    /// A shaft.
    Shaft(&'m Shaft),
    /// A bearing.
    Bearing(&'m Bearing),
    /// A gear mesh.
    Gear(&'m GearMesh),
}

impl Component<'_> {
    /// Identifier in the machine file.
    #[must_use]
    pub fn id(&self) -> &str {
        match self {
            Self::Shaft(shaft) => &shaft.id,
            Self::Bearing(bearing) => &bearing.id,
            Self::Gear(gear) => &gear.id,
        }
    }
}

impl Machine {
    /// The shaft at `index`.
    ///
    /// # Panics
    ///
    /// If the index comes from another machine.
    #[must_use]
    pub fn shaft(&self, index: ShaftIndex) -> &Shaft {
        &self.shafts[index.0]
    }

    /// The bearing at `index`.
    ///
    /// # Panics
    ///
    /// If the index comes from another machine.
    #[must_use]
    pub fn bearing(&self, index: BearingIndex) -> &Bearing {
        &self.bearings[index.0]
    }

    /// The gear mesh at `index`.
    ///
    /// # Panics
    ///
    /// If the index comes from another machine.
    #[must_use]
    pub fn gear(&self, index: GearIndex) -> &GearMesh {
        &self.gears[index.0]
    }

    /// Speed of a shaft when the first one turns at `first`; `None` when nothing connects them.
    ///
    /// # Panics
    ///
    /// If the index comes from another machine.
    #[must_use]
    pub fn shaft_speed(&self, index: ShaftIndex, first: Hz) -> Option<Hz> {
        self.shaft(index).ratio_to_first.map(|ratio| Hz(ratio * first.0))
    }

    /// Nominal speed of the first shaft, to which the speeds of documents refer.
    #[must_use]
    pub fn nominal_speed(&self) -> Option<Hz> {
        self.shafts.first().and_then(|shaft| shaft.nominal_speed)
    }

    /// The part a sensor of this machine sits at; `None` when the file names none.
    ///
    /// # Panics
    ///
    /// If the sensor comes from another machine.
    #[must_use]
    pub fn component_at(&self, sensor: &Sensor) -> Option<Component<'_>> {
        Some(match sensor.at? {
            Location::Shaft(index) => Component::Shaft(self.shaft(index)),
            Location::Bearing(index) => Component::Bearing(self.bearing(index)),
            Location::Gear(index) => Component::Gear(self.gear(index)),
        })
    }

    /// The shaft whose turns a sensor hears first: that of its place; of a mesh, the driving one.
    ///
    /// # Panics
    ///
    /// If the sensor comes from another machine.
    #[must_use]
    pub fn shaft_at(&self, sensor: &Sensor) -> Option<ShaftIndex> {
        Some(match sensor.at? {
            Location::Shaft(index) => index,
            Location::Bearing(index) => self.bearing(index).shaft,
            Location::Gear(index) => self.gear(index).driving.shaft,
        })
    }

    /// Limits in force: those of `[limits]`, else the zones of the ISO group.
    #[must_use]
    pub fn limits_in_force(&self) -> Limits {
        self.limits.or_zones_of(self.iso_group)
    }
}
