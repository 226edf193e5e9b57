//! The diagnosis document, `rotorwatch.diagnosis/1`.

use super::names::{
    DataQualityName, DetectorName, FaultName, KindName, MemberName, OperatingStateName,
    SpeedSourceName, StateName,
};
use super::{finite, finite_column};
use crate::diagnosis::verdict::{ComponentDiagnosis, Diagnosis, Evidence, GearFinding, Timeline};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Name and version of the document.
pub const SCHEMA: &str = "rotorwatch.diagnosis/1";

/// What is wrong with a machine, how badly, how sure, and why.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct DiagnosisDocument {
    /// `rotorwatch.diagnosis/1`.
    #[schemars(extend("const" = SCHEMA))]
    pub schema: String,
    /// Machine id.
    pub machine: String,
    /// Capture file; null in the daemon.
    pub capture: Option<String>,
    /// Hash of the configuration it was judged by; only in the daemon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judged_by: Option<String>,
    /// End of the window judged, as a time of the stream; only in the daemon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judged_until: Option<String>,
    /// Since when no data come, so that this is a verdict of the past; only in the daemon, absent while they come.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_data: Option<String>,
    /// Stream time covered, s.
    #[schemars(range(min = 0.0))]
    pub duration_s: f64,
    /// Samples read, summed over channels.
    pub samples_used: u64,
    /// Samples received but not used, summed over channels.
    pub samples_rejected: u64,
    /// Why samples were rejected, one sentence a reason.
    pub rejected_because: Vec<String>,
    /// Speed of the machine's first shaft, Hz; null when unknown.
    pub shaft_speed_hz: Option<f64>,
    /// Where the speed came from; null when unknown.
    pub speed_source: Option<SpeedSourceName>,
    /// Trust in the speed, 0…1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub speed_confidence: f64,
    /// Speed of every shaft whose ratio is known, Hz, by shaft id.
    pub shaft_speeds: BTreeMap<String, Option<f64>>,
    /// Whether the machine ran.
    pub operating_state: OperatingStateName,
    /// Worst state of bearings, shafts, gears and machine; undetermined only if all of them are.
    pub state: StateName,
    /// How much of the machine was judged.
    pub coverage: CoverageWire,
    /// Worst data quality among the sensors.
    pub data_quality: DataQualityName,
    /// Verdict on each component.
    pub components: Vec<ComponentWire>,
    /// What the user should know: unit conflicts, absent channels, speeds that disagree.
    pub warnings: Vec<String>,
    /// How the capture was read: what was guessed, assumed or passed over; empty for live data.
    pub notes: Vec<String>,
    /// Healthy reference records offered.
    pub baselines: Vec<BaselineWire>,
    /// Reference made from the capture's own first segments; it can prove change, not health.
    pub provisional_baseline: Option<String>,
    /// Verdicts over time; null for a single window.
    pub timeline: Option<TimelineWire>,
    /// Start of the first window from which warning or worse lasts for three windows, s from the start; where none lasts and `state` is so, of
    /// the first such window; null if never. Single windows are in `timeline`.
    pub first_warning_s: Option<f64>,
    /// The same of damaged.
    pub first_damaged_s: Option<f64>,
    /// Samples this verdict rests on, by channel.
    pub sample_ranges: Vec<SampleRangeWire>,
}

/// How much of the machine was judged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct CoverageWire {
    /// Number of components judged.
    pub judged: usize,
    /// Ids of components that could not be judged.
    pub undetermined: Vec<String>,
}

/// Verdict on one component.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ComponentWire {
    /// Id in the machine file.
    pub id: String,
    /// Kind.
    pub kind: KindName,
    /// State.
    pub state: StateName,
    /// Strongest fault; null with warning or damaged: this component, cause not proven.
    pub fault: Option<FaultName>,
    /// Effect size, 0…1; null when undetermined.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub severity: Option<f64>,
    /// Probability that state and fault are right, at most 0.99; null when undetermined.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub confidence: Option<f64>,
    /// One plain sentence.
    pub why: String,
    /// The numbers behind it.
    pub evidence: Vec<EvidenceWire>,
    /// Weaker faults of the same component.
    pub other_faults: Vec<OtherFaultWire>,
    /// Gears only: the damaged member; null when both turn at the same rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<MemberName>")]
    #[schema(value_type = Option<MemberName>)]
    pub member: Option<Option<MemberName>>,
    /// Gears only: shaft angle after the tacho mark at which the damaged tooth meshes, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
    /// Gears only: number of the damaged tooth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tooth: Option<u32>,
    /// Gears only: phase of the source's once-a-revolution zero crossing, degrees; evidence only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_zero_crossing_deg: Option<f64>,
}

/// A further fault of a component.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct OtherFaultWire {
    /// Id of the component.
    pub id: String,
    /// Its kind.
    pub kind: KindName,
    /// Warning or damaged.
    pub state: StateName,
    /// The fault.
    pub fault: FaultName,
    /// Effect size, 0…1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub severity: Option<f64>,
    /// Probability that it is right, at most 0.99.
    #[schemars(range(min = 0.0, max = 0.99))]
    pub confidence: Option<f64>,
    /// One plain sentence.
    pub why: String,
    /// The numbers behind it.
    pub evidence: Vec<EvidenceWire>,
}

/// One number behind a verdict.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct EvidenceWire {
    /// Indicator's name.
    pub indicator: String,
    /// Channel, or `x+y` for a pair.
    pub channel: String,
    /// Detector, for amplitudes.
    pub detector: Option<DetectorName>,
    /// Where it was read, Hz.
    pub frequency_hz: Option<f64>,
    /// Where kinematics expects it, Hz.
    pub expected_hz: Option<f64>,
    /// `frequency_hz` as a multiple of the component's shaft speed.
    pub order: Option<f64>,
    /// The value; null when it is not a finite number.
    pub value: Option<f64>,
    /// Unit of `value` and `threshold`.
    pub unit: String,
    /// The value it is held against.
    pub threshold: Option<f64>,
    /// After all search corrections.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub false_alarm_probability: Option<f64>,
    /// First sample and one past the last.
    pub sample_range: Option<[u64; 2]>,
}

/// A healthy reference record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct BaselineWire {
    /// Name of the record.
    pub name: String,
    /// Whether it was used.
    pub used: bool,
    /// Why not, or how.
    pub reason: String,
    /// Id of the signed baseline it belongs to.
    pub id: Option<String>,
    /// Windows that went into it.
    pub n_windows: usize,
}

/// Verdicts over time, in columns of equal length.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TimelineWire {
    /// Start of the window, s from the start.
    pub time_s: Vec<Option<f64>>,
    /// State of the whole.
    pub state: Vec<StateName>,
    /// Id of the worst component; null when nothing is accused.
    pub component: Vec<Option<String>>,
    /// Its severity.
    pub severity: Vec<Option<f64>>,
}

/// A run of samples of one channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct SampleRangeWire {
    /// Channel.
    pub channel: String,
    /// First sample.
    pub start_sample: u64,
    /// One past the last sample.
    pub end_sample: u64,
}

impl DiagnosisDocument {
    /// Makes the document of a diagnosis; `capture` names the file it was made from.
    #[must_use]
    pub fn new(diagnosis: &Diagnosis, capture: Option<&str>) -> Self {
        let d = diagnosis;
        Self {
            schema: SCHEMA.to_owned(),
            machine: d.machine.clone(),
            capture: capture.map(str::to_owned),
            judged_by: None,
            judged_until: None,
            no_data: None,
            duration_s: finite(d.duration_s).unwrap_or(0.0),
            samples_used: d.samples_used,
            samples_rejected: d.samples_rejected,
            rejected_because: d.rejected_because.clone(),
            shaft_speed_hz: d.shaft_speed.and_then(|speed| finite(speed.0)),
            speed_source: d.speed_source.map(Into::into),
            speed_confidence: finite(d.speed_confidence).unwrap_or(0.0),
            shaft_speeds: d
                .shaft_speeds
                .iter()
                .map(|(id, speed)| (id.clone(), finite(speed.0)))
                .collect(),
            operating_state: d.operating_state.into(),
            state: d.state.into(),
            coverage: CoverageWire {
                judged: d.coverage.judged,
                undetermined: d.coverage.undetermined.clone(),
            },
            data_quality: d.data_quality.into(),
            components: d.components.iter().map(ComponentWire::new).collect(),
            warnings: d.warnings.clone(),
            notes: d.notes.clone(),
            baselines: d
                .baselines
                .iter()
                .map(|b| BaselineWire {
                    name: b.name.clone(),
                    used: b.used,
                    reason: b.reason.clone(),
                    id: b.id.as_deref().map(str::to_owned),
                    n_windows: b.n_windows,
                })
                .collect(),
            provisional_baseline: d.provisional_baseline.clone(),
            timeline: d.timeline.as_ref().map(TimelineWire::new),
            first_warning_s: d.first_warning_s.and_then(finite),
            first_damaged_s: d.first_damaged_s.and_then(finite),
            sample_ranges: d
                .sample_ranges
                .iter()
                .map(|(channel, start, end)| SampleRangeWire {
                    channel: channel.clone(),
                    start_sample: *start,
                    end_sample: *end,
                })
                .collect(),
        }
    }
}

impl ComponentWire {
    fn new(component: &ComponentDiagnosis) -> Self {
        let c = component;
        let gear = c.gear.as_ref();
        let gear_number =
            |read: fn(&GearFinding) -> Option<f64>| gear.and_then(read).and_then(finite);
        Self {
            id: c.id.clone(),
            kind: c.kind.into(),
            state: c.state.into(),
            fault: c.fault.map(Into::into),
            severity: c.severity.and_then(finite),
            confidence: c.confidence.and_then(finite),
            why: c.why.clone(),
            evidence: c.evidence.iter().map(EvidenceWire::new).collect(),
            other_faults: c
                .other_faults
                .iter()
                .map(|other| OtherFaultWire {
                    id: c.id.clone(),
                    kind: c.kind.into(),
                    state: other.state.into(),
                    fault: other.fault.into(),
                    severity: finite(other.severity),
                    confidence: finite(other.confidence),
                    why: other.why.clone(),
                    evidence: other.evidence.iter().map(EvidenceWire::new).collect(),
                })
                .collect(),
            member: gear.map(|gear| gear.member.map(Into::into)),
            angle_deg: gear_number(|gear| gear.angle_deg),
            tooth: gear.and_then(|gear| gear.tooth),
            source_zero_crossing_deg: gear_number(|gear| gear.source_zero_crossing_deg),
        }
    }
}

impl EvidenceWire {
    fn new(evidence: &Evidence) -> Self {
        let e = evidence;
        Self {
            indicator: e.indicator.clone(),
            channel: e.channel.clone(),
            detector: e.detector.map(Into::into),
            frequency_hz: e.frequency.and_then(|f| finite(f.0)),
            expected_hz: e.expected.and_then(|f| finite(f.0)),
            order: e.order.and_then(finite),
            value: finite(e.value),
            unit: e.unit.symbol().to_owned(),
            threshold: e.threshold.and_then(finite),
            false_alarm_probability: e.false_alarm_probability.and_then(finite),
            sample_range: e.sample_range.map(|(start, end)| [start, end]),
        }
    }
}

impl TimelineWire {
    fn new(timeline: &Timeline) -> Self {
        Self {
            time_s: finite_column(timeline.time_s.iter().copied()),
            state: timeline.state.iter().map(|state| (*state).into()).collect(),
            component: timeline.component.clone(),
            severity: timeline.severity.iter().map(|s| s.and_then(finite)).collect(),
        }
    }
}

/// Gives the JSON Schema (2020-12) of [`DiagnosisDocument`]; unknown keys stay allowed, because
/// additions to the document are.
#[must_use]
pub fn json_schema() -> serde_json::Value {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    let schema = settings.into_generator().into_root_schema_for::<DiagnosisDocument>();
    schema.to_value()
}

#[cfg(test)]
#[path = "diagnosis_tests.rs"]
mod tests;
