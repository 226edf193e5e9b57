//! Windows of a capture that were judged again, as a document.

use super::diagnosis::DiagnosisDocument;
use serde::Serialize;

/// What `rotorwatch diagnose --evidence` finds in a capture that keeps the windows of an alarm.
#[derive(Debug, Clone, Serialize)]
pub struct EvidenceDocument {
    /// `rotorwatch.evidence/1`.
    pub schema: &'static str,
    /// The capture.
    pub capture: String,
    /// Whether all windows are the same, bit by bit.
    pub equal: bool,
    /// Why bits may differ: another program or processor made the capture; null: neither.
    pub made_elsewhere: Option<String>,
    /// The windows, oldest first.
    pub windows: Vec<EvidenceWindowWire>,
    /// What stands above its alarm level after the newest window.
    pub raised: String,
    /// The verdict on the newest window as it is found now; null: no window is kept.
    pub diagnosis: Option<DiagnosisDocument>,
}

/// A window judged again.
#[derive(Debug, Clone, Serialize)]
pub struct EvidenceWindowWire {
    /// Start, s of stream time.
    pub from_s: f64,
    /// End, s of stream time.
    pub to_s: f64,
    /// Whether features, verdict and alarm levels are the same, bit by bit.
    pub equal: bool,
    /// Features held against each other.
    pub features: usize,
    /// Features whose bits differ.
    pub different: usize,
    /// In what it differs, for people.
    pub differences: Vec<String>,
}

impl EvidenceDocument {
    /// Its schema.
    pub const SCHEMA: &'static str = "rotorwatch.evidence/1";
}
