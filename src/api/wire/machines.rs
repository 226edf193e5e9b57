//! Machines, their description and their health as JSON.

use super::diagnosis::CoverageWire;
use super::maintenance::MaintenanceWire;
use super::names::{DataQualityName, FaultName, KindName, OperatingStateName, StateName};
use super::parts::{
    BearingWire, FrequencyTableWire, GearMemberWire, GearWire, MotorWire, SensorWire, ShaftWire,
};
use super::{finite, rfc3339};
use crate::alarms::Alarm;
use crate::api::view::{MachineView, SourceState, accusations, accused_state};
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::{ComponentDiagnosis, DataQuality};
use crate::machine::limits::IsoGroup;
use crate::machine::{Machine, ShaftIndex};
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
    /// State of the whole; before the first verdict that of the alarms that stand, or undetermined.
    pub state: StateName,
    /// Whether it runs.
    pub operating_state: OperatingStateName,
    /// starting, running, finished or failed.
    pub source: String,
    /// Number of alarms that are not back to normal.
    pub alarms: usize,
    /// Stream time of the newest sample, s; null before the first.
    pub stream_time_s: Option<f64>,
    /// Time of the newest sample; null before the first.
    pub last_sample_time: Option<String>,
    /// Whether the stream's start is unknown, so that times count from 1970-01-01.
    pub time_unknown: bool,
    /// Worst data quality among the sensors; null before the first verdict.
    pub data_quality: Option<DataQualityName>,
    /// Since when it has this state; null while nothing is known.
    pub since: Option<String>,
    /// Why the source failed, or since when it has delivered nothing: what was healthy is undetermined then.
    pub reason: Option<String>,
    /// That it is maintained: its alarms are out of service; null: it is not.
    pub maintenance: Option<MaintenanceWire>,
    /// The components, if asked for; before the first verdict those that alarms accuse.
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
    /// State of the whole; before the first verdict that of the alarms that stand, or undetermined.
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

/// A machine's health.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct HealthWire {
    /// Machine id.
    pub machine: String,
    /// State of the whole; before the first verdict that of the alarms that stand, or undetermined.
    pub state: StateName,
    /// Since when; null while nothing is known.
    pub since: Option<String>,
    /// Whether it runs.
    pub operating_state: OperatingStateName,
    /// That it is maintained: its alarms are out of service; null: it is not.
    pub maintenance: Option<MaintenanceWire>,
    /// Components; before the first verdict those that alarms accuse.
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
    /// Why the source failed, or since when it has delivered nothing: what was healthy is undetermined then.
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

/// Why no data come, in words; `None`: they come, or are not expected.
#[must_use]
pub fn no_data_reason(view: &MachineView) -> Option<String> {
    let alarm = view.no_data()?;
    if matches!(view.source, SourceState::Failed(_)) {
        return Some(alarm.why.clone());
    }
    // Of a source that has sent nothing since the start it is known since when it is missed.
    let since_s = if has_samples(view) { view.stream_time_s } else { alarm.active_since_s };
    Some(match view.start_time {
        Some(_) => format!("no data have come since {}", rfc3339(view.start_time, since_s)),
        None => format!("no data have come since {since_s:.1} s of stream time"),
    })
}

/// Gives how a source is doing and what is wrong with it: that it failed, or delivers nothing more.
#[must_use]
pub fn source_and_reason(view: &MachineView) -> (&'static str, Option<String>) {
    let (source, failure) = source_text(&view.source);
    (source, failure.map(str::to_owned).or_else(|| no_data_reason(view)))
}

/// What a state found then says of now: nobody knows whether it is still healthy when no data come; what was accused stays so, as
/// its alarm does.
fn now(view: &MachineView, state: State) -> State {
    match state {
        State::Healthy if view.no_data().is_some() => State::Undetermined,
        State::Healthy | State::Undetermined | State::Warning | State::Damaged => state,
    }
}

/// Gives the state of the whole and whether it runs. Before the first verdict what was accused before the start stays so, as its
/// alarm does; whether it runs is unknown then, and while no data come.
fn whole(view: &MachineView) -> (StateName, OperatingStateName) {
    let Some(diagnosis) = &view.diagnosis else {
        let state = worst_accusation(view).map(|alarm| accused_state(alarm.level));
        return (state.unwrap_or(State::Undetermined).into(), OperatingStateName::Unknown);
    };
    let runs = match view.no_data() {
        Some(_) => OperatingStateName::Unknown,
        None => diagnosis.operating_state.into(),
    };
    (now(view, diagnosis.state).into(), runs)
}

/// Of the alarms of verdicts that stand the worst; of these the oldest.
fn worst_accusation(view: &MachineView) -> Option<&Alarm> {
    let worse = |a: &&Alarm, b: &&Alarm| {
        a.level.cmp(&b.level).then(b.active_since_s.total_cmp(&a.active_since_s))
    };
    accusations(&view.alarms).into_iter().max_by(worse)
}

/// Worst data quality; at best degraded while no data come.
fn data_quality(view: &MachineView) -> Option<DataQualityName> {
    let found = view.diagnosis.as_ref()?.data_quality;
    Some(match (found, view.no_data()) {
        (DataQuality::Ok, Some(_)) => DataQualityName::Degraded,
        (DataQuality::Ok | DataQuality::Degraded | DataQuality::Bad, _) => found.into(),
    })
}

/// How much of the machine is judged: what was found healthy is not, while no data come.
fn coverage(view: &MachineView) -> CoverageWire {
    let Some(diagnosis) = &view.diagnosis else {
        return CoverageWire { judged: 0, undetermined: Vec::new() };
    };
    let is_lost = |one: &&ComponentDiagnosis| now(view, one.state) != one.state;
    let lost: Vec<&ComponentDiagnosis> = diagnosis.components.iter().filter(is_lost).collect();
    let undetermined = lost.iter().map(|one| &one.id).chain(&diagnosis.coverage.undetermined);
    CoverageWire {
        judged: diagnosis.coverage.judged.saturating_sub(lost.len()),
        undetermined: undetermined.cloned().collect(),
    }
}

/// Since when the component at `index`, behind the last the machine, has the state that it was found in.
fn since(view: &MachineView, index: usize, state: State) -> Option<String> {
    let found = view.state_since_s.get(index).copied();
    let since_s = match view.no_data() {
        Some(alarm) if now(view, state) != state => Some(alarm.active_since_s),
        Some(_) | None => found,
    };
    since_s.map(|since_s| rfc3339(view.start_time, since_s))
}

fn since_of_whole(view: &MachineView) -> Option<String> {
    let Some(diagnosis) = &view.diagnosis else {
        let since_s = worst_accusation(view)?.active_since_s;
        return Some(rfc3339(view.start_time, since_s));
    };
    since(view, diagnosis.components.len(), diagnosis.state)
}

fn has_samples(view: &MachineView) -> bool {
    view.rings.iter().any(|ring| ring.received > 0)
}

fn last_sample_time(view: &MachineView) -> Option<String> {
    has_samples(view).then(|| rfc3339(view.start_time, view.stream_time_s))
}

/// The health of each component; before the first verdict of those that were accused before the start.
fn component_healths(view: &MachineView) -> Vec<ComponentHealthWire> {
    let Some(diagnosis) = &view.diagnosis else {
        return accusations(&view.alarms).into_iter().map(|alarm| accused(view, alarm)).collect();
    };
    let no_data = no_data_reason(view);
    let health = |(index, component): (usize, &ComponentDiagnosis)| {
        let is_known = now(view, component.state) == component.state;
        let why = match &no_data {
            Some(reason) if is_known => format!("{}; {reason}", component.why),
            Some(reason) => format!("{reason}; found healthy before"),
            None => component.why.clone(),
        };
        ComponentHealthWire {
            id: component.id.clone(),
            kind: component.kind.into(),
            state: now(view, component.state).into(),
            fault: component.fault.map(Into::into),
            since: since(view, index, component.state),
            why,
            severity: component.severity.filter(|_| is_known).and_then(finite),
            confidence: component.confidence.filter(|_| is_known).and_then(finite),
        }
    };
    diagnosis.components.iter().enumerate().map(health).collect()
}

/// The health of a component by its alarm, before the first verdict.
fn accused(view: &MachineView, alarm: &Alarm) -> ComponentHealthWire {
    let reason = no_data_reason(view);
    ComponentHealthWire {
        id: alarm.component.clone(),
        kind: alarm.kind.into(),
        state: accused_state(alarm.level).into(),
        fault: alarm.fault.map(Into::into),
        since: Some(rfc3339(view.start_time, alarm.active_since_s)),
        why: reason.map_or(alarm.why.clone(), |reason| format!("{}; {reason}", alarm.why)),
        severity: alarm.severity.and_then(finite),
        confidence: alarm.confidence.and_then(finite),
    }
}

impl MachineItemWire {
    /// Makes the list entry of a machine.
    #[must_use]
    pub fn new(machine: &Machine, view: &MachineView) -> Self {
        let (state, operating_state) = whole(view);
        let (source, reason) = source_and_reason(view);
        Self {
            id: machine.id.clone(),
            name: machine.name.clone(),
            state,
            operating_state,
            source: source.to_owned(),
            alarms: view.alarms.len(),
            stream_time_s: finite(view.stream_time_s).filter(|_| has_samples(view)),
            last_sample_time: last_sample_time(view),
            time_unknown: view.start_time.is_none(),
            data_quality: data_quality(view),
            since: since_of_whole(view),
            reason,
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

impl HealthWire {
    /// Makes the health of `machine`.
    #[must_use]
    pub fn new(machine: &Machine, view: &MachineView) -> Self {
        let (state, operating_state) = whole(view);
        let (source, reason) = source_and_reason(view);
        Self {
            machine: machine.id.clone(),
            state,
            since: since_of_whole(view),
            operating_state,
            maintenance: MaintenanceWire::of(view),
            components: component_healths(view),
            data: HealthDataWire {
                coverage: coverage(view),
                data_quality: data_quality(view),
                last_sample_time: last_sample_time(view),
                time_unknown: view.start_time.is_none(),
                source: source.to_owned(),
                reason,
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
