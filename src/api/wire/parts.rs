//! Parts of a machine as its file describes them: shafts, bearings, gears, motors, sensors, and the lines they may show.

use super::{finite, finite_column};
use crate::machine::bearing::{Bearing, BearingGeometry, RotatingRing};
use crate::machine::kinematics::frequency_table;
use crate::machine::sensor::{Direction, Sensor};
use crate::machine::shaft::Rotation;
use crate::machine::{Component, Machine};
use crate::units::Hz;
use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// A shaft.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ShaftWire {
    /// Id.
    pub id: String,
    /// Speed divided by that of the first shaft; null: not connected to it.
    pub ratio_to_first: Option<f64>,
    /// Nominal speed, Hz.
    pub nominal_speed_hz: Option<f64>,
    /// `ccw` or `cw`, seen from the driver end.
    pub rotation: Option<String>,
    /// First lateral critical speed, Hz.
    pub first_critical_hz: Option<f64>,
    /// It counts as running above this speed, Hz.
    pub running_above_hz: Option<f64>,
}

impl ShaftWire {
    pub(super) fn new(shaft: &crate::machine::shaft::Shaft) -> Self {
        Self {
            id: shaft.id.clone(),
            ratio_to_first: shaft.ratio_to_first.and_then(finite),
            nominal_speed_hz: shaft.nominal_speed.and_then(|f| finite(f.0)),
            rotation: shaft.rotation.map(|rotation| {
                match rotation {
                    Rotation::Ccw => "ccw",
                    Rotation::Cw => "cw",
                }
                .to_owned()
            }),
            first_critical_hz: shaft.first_critical.and_then(|f| finite(f.0)),
            running_above_hz: shaft.running_above.and_then(|f| finite(f.0)),
        }
    }
}

/// A rolling bearing.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct BearingWire {
    /// Id.
    pub id: String,
    /// Shaft it carries.
    pub shaft: String,
    /// Maker's designation.
    pub catalogue: Option<String>,
    /// Number of rolling elements; null, as the next three: geometry unknown.
    pub elements: Option<u32>,
    /// Rolling-element diameter, mm.
    pub element_diameter_mm: Option<f64>,
    /// Pitch diameter, mm.
    pub pitch_diameter_mm: Option<f64>,
    /// Contact angle, degrees.
    pub contact_angle_deg: Option<f64>,
    /// `inner` or `outer`.
    pub rotating_ring: String,
}

impl BearingWire {
    pub(super) fn new(bearing: &Bearing, machine: &Machine) -> Self {
        let geometry = bearing.geometry.as_ref();
        let number = |read: fn(&BearingGeometry) -> f64| geometry.map(read).and_then(finite);
        Self {
            id: bearing.id.clone(),
            shaft: machine.shaft(bearing.shaft).id.clone(),
            catalogue: bearing.catalogue.clone(),
            elements: geometry.map(BearingGeometry::elements),
            element_diameter_mm: number(|g| g.element_diameter_m() * 1e3),
            pitch_diameter_mm: number(|g| g.pitch_diameter_m() * 1e3),
            contact_angle_deg: number(|g| g.contact_angle_rad().to_degrees()),
            rotating_ring: match bearing.rotating_ring {
                RotatingRing::Inner => "inner",
                RotatingRing::Outer => "outer",
            }
            .to_owned(),
        }
    }
}

/// A gear mesh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct GearWire {
    /// Id.
    pub id: String,
    /// The driving gear.
    pub driving: GearMemberWire,
    /// The driven gear.
    pub driven: GearMemberWire,
}

/// One wheel of a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct GearMemberWire {
    /// Shaft it sits on.
    pub shaft: String,
    /// Number of teeth.
    pub teeth: u32,
}

/// An electric motor.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct MotorWire {
    /// Shaft it drives.
    pub shaft: String,
    /// Number of poles.
    pub poles: u32,
    /// Mains or inverter output frequency, Hz.
    pub line_frequency_hz: Option<f64>,
    /// Whether it runs without slip.
    pub synchronous: bool,
}

/// A sensor.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct SensorWire {
    /// Channel it reads.
    pub channel: String,
    /// What it measures.
    pub kind: String,
    /// Unit stated by the machine file, as written.
    pub unit: Option<String>,
    /// Where it sits.
    pub at: Option<LocationWire>,
    /// Sensitive direction in the plane normal to the shaft, degrees.
    pub axis_deg: Option<f64>,
    /// `radial` or `axial`.
    pub direction: Option<String>,
    /// Band in which it may be believed, Hz.
    pub usable_hz: Option<[Option<f64>; 2]>,
}

impl SensorWire {
    pub(super) fn new(machine: &Machine, sensor: &Sensor) -> Self {
        Self {
            channel: sensor.channel.clone(),
            kind: sensor.kind.name().to_owned(),
            unit: sensor.unit.as_ref().map(|(text, _)| text.clone()),
            at: machine.component_at(sensor).map(LocationWire::new),
            axis_deg: sensor.axis_deg.and_then(finite),
            direction: sensor.direction.map(|direction| {
                match direction {
                    Direction::Radial => "radial",
                    Direction::Axial => "axial",
                }
                .to_owned()
            }),
            usable_hz: sensor.usable.map(|(low, high)| [finite(low.0), finite(high.0)]),
        }
    }
}

/// Where a sensor sits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct LocationWire {
    /// bearing, shaft or gear.
    pub kind: String,
    /// Its id.
    pub id: String,
}

impl LocationWire {
    pub(super) fn new(at: Component<'_>) -> Self {
        let kind = match at {
            Component::Bearing(_) => "bearing",
            Component::Shaft(_) => "shaft",
            Component::Gear(_) => "gear",
        };
        Self { kind: kind.to_owned(), id: at.id().to_owned() }
    }
}

/// Lines the construction of a machine may show, in columns of equal length.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct FrequencyTableWire {
    /// Speed of the first shaft, Hz.
    pub shaft_speed_hz: Option<f64>,
    /// Kind of the part a line belongs to.
    pub owner_kind: Vec<String>,
    /// Id of that part.
    pub owner: Vec<String>,
    /// What the line is.
    pub label: Vec<String>,
    /// Where it stands, Hz.
    pub frequency_hz: Vec<Option<f64>>,
    /// As a multiple of the speed of the part's shaft.
    pub order: Vec<Option<f64>>,
}

impl FrequencyTableWire {
    pub(super) fn new(machine: &Machine, first_shaft_speed: Hz) -> Self {
        let lines = frequency_table(machine, first_shaft_speed).lines;
        Self {
            shaft_speed_hz: finite(first_shaft_speed.0),
            owner_kind: lines.iter().map(|line| line.owner.kind_name().to_owned()).collect(),
            owner: lines.iter().map(|line| line.owner_id.clone()).collect(),
            label: lines.iter().map(|line| line.kind.label()).collect(),
            frequency_hz: finite_column(lines.iter().map(|line| line.frequency.0)),
            order: lines.iter().map(|line| line.order.and_then(|order| finite(order.0))).collect(),
        }
    }
}
