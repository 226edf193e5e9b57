//! Machines, their description and their health as JSON.

use super::diagnosis::CoverageWire;
use super::maintenance::MaintenanceWire;
use super::names::{DataQualityName, FaultName, KindName, OperatingStateName, StateName};
use super::{finite, finite_column, rfc3339};
use crate::api::view::{MachineView, SourceState};
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::machine::bearing::{Bearing, BearingGeometry, RotatingRing};
use crate::machine::kinematics::frequency_table;
use crate::machine::limits::IsoGroup;
use crate::machine::sensor::{Direction, Sensor};
use crate::machine::shaft::Rotation;
use crate::machine::{Component, Machine, ShaftIndex};
use crate::units::Hz;
use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// All machines.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct MachineListWire {
    /// In the order of their ids.
    pub items: Vec<MachineItemWire>,
}

/// One machine in a list.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct MachineItemWire {
    /// Id.
    pub id: String,
    /// Name for people.
    pub name: String,
    /// State of the whole; undetermined before the first verdict.
    pub state: StateName,
    /// Whether it runs.
    pub operating_state: OperatingStateName,
    /// starting, running, finished or failed.
    pub source: String,
    /// Number of alarms that are not back to normal.
    pub alarms: usize,
    /// Stream time of the newest sample, s.
    pub stream_time_s: Option<f64>,
    /// Time of the newest sample; null before the first.
    pub last_sample_time: Option<String>,
    /// Worst data quality among the sensors; null before the first verdict.
    pub data_quality: Option<DataQualityName>,
    /// Since when it has this state; null before the first verdict.
    pub since: Option<String>,
    /// Why the source failed.
    pub reason: Option<String>,
    /// That it is maintained: its alarms are out of service; null: it is not.
    pub maintenance: Option<MaintenanceWire>,
    /// The components, if asked for; empty before the first verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<Vec<ComponentHealthWire>>,
}

/// A machine's description.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct MachineWire {
    /// Id.
    pub id: String,
    /// Name for people.
    pub name: String,
    /// ISO 20816-3 group and support.
    pub iso_group: Option<String>,
    /// Rated power, kW.
    pub power_kw: Option<f64>,
    /// State of the whole; undetermined before the first verdict.
    pub state: StateName,
    /// That it is maintained: its alarms are out of service; null: it is not.
    pub maintenance: Option<MaintenanceWire>,
    /// Shafts; speeds refer to the first.
    pub shafts: Vec<ShaftWire>,
    /// Rolling bearings.
    pub bearings: Vec<BearingWire>,
    /// Gear meshes.
    pub gears: Vec<GearWire>,
    /// Electric motors.
    pub motors: Vec<MotorWire>,
    /// Sensors.
    pub sensors: Vec<SensorWire>,
    /// Lines the construction may show, at the newest known or the nominal speed.
    pub frequencies: Option<FrequencyTableWire>,
}

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

/// Where a sensor sits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct LocationWire {
    /// bearing, shaft or gear.
    pub kind: String,
    /// Its id.
    pub id: String,
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

/// A machine's health.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct HealthWire {
    /// Machine id.
    pub machine: String,
    /// State of the whole; undetermined before the first verdict.
    pub state: StateName,
    /// Since when; null before the first verdict.
    pub since: Option<String>,
    /// Whether it runs.
    pub operating_state: OperatingStateName,
    /// That it is maintained: its alarms are out of service; null: it is not.
    pub maintenance: Option<MaintenanceWire>,
    /// Components; empty before the first verdict.
    pub components: Vec<ComponentHealthWire>,
    /// The data behind it.
    pub data: HealthDataWire,
}

/// A component's health.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ComponentHealthWire {
    /// Id.
    pub id: String,
    /// Kind.
    pub kind: KindName,
    /// State.
    pub state: StateName,
    /// Strongest fault.
    pub fault: Option<FaultName>,
    /// Since when it has this state.
    pub since: Option<String>,
    /// One plain sentence.
    pub why: String,
    /// Effect size, 0…1.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
}

/// The data behind a machine's health.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct HealthDataWire {
    /// How much of the machine was judged.
    pub coverage: CoverageWire,
    /// Worst data quality among the sensors; null before the first verdict.
    pub data_quality: Option<DataQualityName>,
    /// Time of the newest sample; null before the first.
    pub last_sample_time: Option<String>,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// starting, running, finished or failed.
    pub source: String,
    /// Why the source failed.
    pub reason: Option<String>,
}

/// Gives a source's state and, if it failed, why.
#[must_use]
pub fn source_text(source: &SourceState) -> (&'static str, Option<&str>) {
    match source {
        SourceState::Starting => ("starting", None),
        SourceState::Running => ("running", None),
        SourceState::Finished => ("finished", None),
        SourceState::Failed(reason) => ("failed", Some(reason)),
    }
}

/// Gives the state of the whole and whether it runs; both unknown before the first verdict.
fn whole(view: &MachineView) -> (StateName, OperatingStateName) {
    view.diagnosis
        .as_ref()
        .map_or((StateName::Undetermined, OperatingStateName::Unknown), |diagnosis| {
            (diagnosis.state.into(), diagnosis.operating_state.into())
        })
}

/// Since when the component at `index`, behind the last the machine, has its state.
fn since(view: &MachineView, index: usize) -> Option<String> {
    view.state_since_s.get(index).map(|since_s| rfc3339(view.start_time, *since_s))
}

fn last_sample_time(view: &MachineView) -> Option<String> {
    let received = view.rings.iter().any(|ring| ring.received > 0);
    received.then(|| rfc3339(view.start_time, view.stream_time_s))
}

/// The health of each component; empty before the first verdict.
fn component_healths(view: &MachineView) -> Vec<ComponentHealthWire> {
    let components = view.diagnosis.as_ref().map_or(&[][..], |diagnosis| &diagnosis.components);
    let health = |(index, component): (usize, &ComponentDiagnosis)| ComponentHealthWire {
        id: component.id.clone(),
        kind: component.kind.into(),
        state: component.state.into(),
        fault: component.fault.map(Into::into),
        since: since(view, index),
        why: component.why.clone(),
        severity: component.severity.and_then(finite),
        confidence: component.confidence.and_then(finite),
    };
    components.iter().enumerate().map(health).collect()
}

impl MachineItemWire {
    /// Makes the list entry of a machine.
    #[must_use]
    pub fn new(machine: &Machine, view: &MachineView) -> Self {
        let (state, operating_state) = whole(view);
        let (source, reason) = source_text(&view.source);
        let diagnosis = view.diagnosis.as_ref();
        Self {
            id: machine.id.clone(),
            name: machine.name.clone(),
            state,
            operating_state,
            source: source.to_owned(),
            alarms: view.alarms.len(),
            stream_time_s: finite(view.stream_time_s),
            last_sample_time: last_sample_time(view),
            data_quality: diagnosis.map(|diagnosis| diagnosis.data_quality.into()),
            since: diagnosis.and_then(|diagnosis| since(view, diagnosis.components.len())),
            reason: reason.map(str::to_owned),
            maintenance: MaintenanceWire::of(view),
            components: None,
        }
    }

    /// The same with the health of each component.
    #[must_use]
    pub fn with_components(self, view: &MachineView) -> Self {
        Self { components: Some(component_healths(view)), ..self }
    }
}

impl MachineWire {
    /// Makes the description of a machine.
    #[must_use]
    pub fn new(m: &Machine, view: &MachineView) -> Self {
        let shaft_id = |index: ShaftIndex| m.shaft(index).id.clone();
        let found = view.diagnosis.as_ref().and_then(|diagnosis| diagnosis.shaft_speed);
        let speed = found.or_else(|| m.nominal_speed());
        let member = |gear: &crate::machine::gear::GearMember| GearMemberWire {
            shaft: shaft_id(gear.shaft),
            teeth: gear.teeth,
        };
        Self {
            id: m.id.clone(),
            name: m.name.clone(),
            iso_group: m.iso_group.map(|group| iso_group_text(group).to_owned()),
            power_kw: m.power_kw.and_then(finite),
            state: whole(view).0,
            maintenance: MaintenanceWire::of(view),
            shafts: m.shafts.iter().map(ShaftWire::new).collect(),
            bearings: m.bearings.iter().map(|bearing| BearingWire::new(bearing, m)).collect(),
            gears: m
                .gears
                .iter()
                .map(|gear| GearWire {
                    id: gear.id.clone(),
                    driving: member(&gear.driving),
                    driven: member(&gear.driven),
                })
                .collect(),
            motors: m
                .motors
                .iter()
                .map(|motor| MotorWire {
                    shaft: shaft_id(motor.shaft),
                    poles: motor.poles,
                    line_frequency_hz: motor.line_frequency.and_then(|f| finite(f.0)),
                    synchronous: motor.synchronous,
                })
                .collect(),
            sensors: m.sensors.iter().map(|sensor| SensorWire::new(m, sensor)).collect(),
            frequencies: speed.map(|speed| FrequencyTableWire::new(m, speed)),
        }
    }
}

impl BearingWire {
    fn new(bearing: &Bearing, machine: &Machine) -> Self {
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

impl FrequencyTableWire {
    fn new(machine: &Machine, first_shaft_speed: Hz) -> Self {
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

impl ShaftWire {
    fn new(shaft: &crate::machine::shaft::Shaft) -> Self {
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

impl SensorWire {
    fn new(machine: &Machine, sensor: &Sensor) -> Self {
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

impl LocationWire {
    fn new(at: Component<'_>) -> Self {
        let kind = match at {
            Component::Bearing(_) => "bearing",
            Component::Shaft(_) => "shaft",
            Component::Gear(_) => "gear",
        };
        Self { kind: kind.to_owned(), id: at.id().to_owned() }
    }
}

impl HealthWire {
    /// Makes the health of `machine`.
    #[must_use]
    pub fn new(machine: &Machine, view: &MachineView) -> Self {
        let (state, operating_state) = whole(view);
        let diagnosis = view.diagnosis.as_ref();
        let (source, reason) = source_text(&view.source);
        Self {
            machine: machine.id.clone(),
            state,
            since: diagnosis.and_then(|diagnosis| since(view, diagnosis.components.len())),
            operating_state,
            maintenance: MaintenanceWire::of(view),
            components: component_healths(view),
            data: HealthDataWire {
                coverage: diagnosis.map_or(
                    CoverageWire { judged: 0, undetermined: Vec::new() },
                    |diagnosis| CoverageWire {
                        judged: diagnosis.coverage.judged,
                        undetermined: diagnosis.coverage.undetermined.clone(),
                    },
                ),
                data_quality: diagnosis.map(|diagnosis| diagnosis.data_quality.into()),
                last_sample_time: last_sample_time(view),
                time_unknown: view.start_time.is_none(),
                source: source.to_owned(),
                reason: reason.map(str::to_owned),
            },
        }
    }
}

fn iso_group_text(group: IsoGroup) -> &'static str {
    match group {
        IsoGroup::Group1Rigid => "1-rigid",
        IsoGroup::Group1Flexible => "1-flexible",
        IsoGroup::Group2Rigid => "2-rigid",
        IsoGroup::Group2Flexible => "2-flexible",
    }
}
