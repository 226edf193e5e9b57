//! The diagnosis as data: what is wrong, how badly, how sure, why.

use super::fault::{ComponentKind, Detector, FaultMode, GearSide, State};
use crate::features::speed::SpeedSource;
use crate::units::{Hz, Unit};
use std::sync::Arc;

/// Whether the machine runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OperatingState {
    /// Running at a steady speed.
    Running,
    /// Standing still: nothing is judged.
    Stopped,
    /// Speed changes within the window.
    Transient,
    /// No speed known.
    Unknown,
}

impl OperatingState {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Stopped => "stopped",
            Self::Transient => "transient",
            Self::Unknown => "unknown",
        }
    }
}

/// Worst data quality among the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DataQuality {
    /// All sensors good.
    Ok,
    /// Some sensors bad, the rest judged.
    Degraded,
    /// No usable sensor.
    Bad,
}

impl DataQuality {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Degraded => "degraded",
            Self::Bad => "bad",
        }
    }
}

/// One number behind a verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Indicator's name, e.g. `envelope_line_bpfi`.
    pub indicator: String,
    /// Channel, or `x+y` for a pair.
    pub channel: String,
    /// Detector, for amplitudes.
    pub detector: Option<Detector>,
    /// Where it was read.
    pub frequency: Option<Hz>,
    /// Where kinematics expects it.
    pub expected: Option<Hz>,
    /// `frequency` as a multiple of the component's shaft speed.
    pub order: Option<f64>,
    /// The value.
    pub value: f64,
    /// Its unit.
    pub unit: Unit,
    /// The value it is held against.
    pub threshold: Option<f64>,
    /// After all search corrections.
    pub false_alarm_probability: Option<f64>,
    /// First sample and one past the last.
    pub sample_range: Option<(u64, u64)>,
}

/// Verdict on one component.
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentDiagnosis {
    /// Component's id in the machine file (`channel` for sensors, machine id for the machine).
    pub id: String,
    /// Its kind.
    pub kind: ComponentKind,
    /// Its state.
    pub state: State,
    /// Strongest fault; `None` with warning or damaged: this component, cause not proven.
    pub fault: Option<FaultMode>,
    /// 0…1, monotone in effect size; `None` when undetermined.
    pub severity: Option<f64>,
    /// Probability that state and fault are right, ≤ 0.99; `None` when undetermined.
    pub confidence: Option<f64>,
    /// One plain sentence.
    pub why: String,
    /// The numbers behind it.
    pub evidence: Vec<Evidence>,
    /// Further faults of this component.
    pub other_faults: Vec<OtherFault>,
    /// For gears.
    pub gear: Option<GearFinding>,
}

impl ComponentDiagnosis {
    /// A component that could not be judged, with the reason.
    #[must_use]
    pub fn undetermined(id: &str, kind: ComponentKind, why: String) -> Self {
        Self {
            id: id.to_owned(),
            kind,
            state: State::Undetermined,
            fault: None,
            severity: None,
            confidence: None,
            why,
            evidence: Vec::new(),
            other_faults: Vec::new(),
            gear: None,
        }
    }

    /// Takes the verdict back, for this reason; what was seen stays.
    pub fn leave_open(&mut self, why: String) {
        let evidence = std::mem::take(&mut self.evidence);
        *self = Self { evidence, ..Self::undetermined(&self.id, self.kind, why) };
    }
}

/// A further fault on a component that already has a stronger one.
#[derive(Debug, Clone, PartialEq)]
pub struct OtherFault {
    /// The fault.
    pub fault: FaultMode,
    /// Warning or damaged.
    pub state: State,
    /// Its severity.
    pub severity: f64,
    /// Its confidence.
    pub confidence: f64,
    /// One plain sentence.
    pub why: String,
    /// The numbers behind it.
    pub evidence: Vec<Evidence>,
}

/// What only gears have.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GearFinding {
    /// `None` when both members turn at the same rate.
    pub member: Option<GearSide>,
    /// Shaft angle after the tacho mark at which the damaged tooth is at the pitch point.
    pub angle_deg: Option<f64>,
    /// Tooth number.
    pub tooth: Option<u32>,
    /// Phase of the source's once-a-revolution zero crossing; evidence, never the answer.
    pub source_zero_crossing_deg: Option<f64>,
}

/// How much of the machine was judged.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Number of components judged (healthy, warning or damaged).
    pub judged: usize,
    /// Ids of components that could not be judged.
    pub undetermined: Vec<String>,
}

/// Verdicts over the windows or segments of a capture, in columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timeline {
    /// Start of the window, s from the start of the stream.
    pub time_s: Vec<f64>,
    /// Whole state.
    pub state: Vec<State>,
    /// Worst component's id; `None` when nothing is accused.
    pub component: Vec<Option<String>>,
    /// Its severity.
    pub severity: Vec<Option<f64>>,
}

/// A healthy reference record and whether it was used.
#[derive(Debug, Clone, PartialEq)]
pub struct BaselineUse {
    /// Name of the record (or `first 10 % of segments`).
    pub name: String,
    /// Whether it was used.
    pub used: bool,
    /// Why not, or how.
    pub reason: String,
    /// Id of the signed baseline it belongs to.
    pub id: Option<Arc<str>>,
    /// Windows that went into it.
    pub n_windows: usize,
}

/// The whole diagnosis of a machine over a window or capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// Machine id.
    pub machine: String,
    /// Stream time covered, s.
    pub duration_s: f64,
    /// Samples read, summed over channels.
    pub samples_used: u64,
    /// Samples received but not used, summed over channels.
    pub samples_rejected: u64,
    /// Why, one sentence a reason.
    pub rejected_because: Vec<String>,
    /// Speed of the first shaft; `None` when unknown.
    pub shaft_speed: Option<Hz>,
    /// Speeds of all shafts whose ratio is known, by id.
    pub shaft_speeds: Vec<(String, Hz)>,
    /// Where the speed came from; `None` when unknown.
    pub speed_source: Option<SpeedSource>,
    /// 0…1.
    pub speed_confidence: f64,
    /// Whether the machine ran.
    pub operating_state: OperatingState,
    /// Worst of bearing, shaft, gear, machine; `Undetermined` only if all are.
    pub state: State,
    /// How much was judged.
    pub coverage: Coverage,
    /// Sensor health.
    pub data_quality: DataQuality,
    /// Component verdicts.
    pub components: Vec<ComponentDiagnosis>,
    /// Things the user should know (unit conflicts, absent channels, speeds that disagree).
    pub warnings: Vec<String>,
    /// How the capture was read: what was guessed, assumed, passed over; empty for live data.
    pub notes: Vec<String>,
    /// Baselines offered.
    pub baselines: Vec<BaselineUse>,
    /// Baseline made from the capture's own first segments.
    pub provisional_baseline: Option<String>,
    /// Verdicts over time, for captures of several windows or segments.
    pub timeline: Option<Timeline>,
    /// Start of the first window in warning or worse.
    pub first_warning_s: Option<f64>,
    /// Start of the first window in damaged.
    pub first_damaged_s: Option<f64>,
    /// First sample and one past the last, of the window this verdict rests on, by channel.
    pub sample_ranges: Vec<(String, u64, u64)>,
}

impl Diagnosis {
    /// The diagnosis with what its source knows and no sample shows, such as a clock that runs wrong: warnings, and data that
    /// are degraded at least.
    #[must_use]
    pub fn with_doubts(&self, doubts: &[String]) -> Self {
        let mut doubted = self.clone();
        doubted.warnings.extend_from_slice(doubts);
        if !doubts.is_empty() {
            doubted.data_quality = doubted.data_quality.max(DataQuality::Degraded);
        }
        doubted
    }
}
