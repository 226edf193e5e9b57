//! Windows of a capture that were judged again, as a document.

use super::diagnosis::DiagnosisDocument;
use schemars::JsonSchema;
use serde::Serialize;

/// What `rotorwatch diagnose --evidence` finds in a capture that keeps the windows of an alarm.
#[derive(Debug, Clone, Serialize, JsonSchema)]
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
#[derive(Debug, Clone, Serialize, JsonSchema)]
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

/// Makes the JSON Schema of [`EvidenceDocument`].
#[must_use]
pub fn json_schema() -> serde_json::Value {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    settings.into_generator().into_root_schema_for::<EvidenceDocument>().to_value()
}

#[cfg(test)]
mod tests {
    use super::json_schema;
    use crate::api::support::golden;

    #[test]
    fn committed_schema_is_current() {
        let text = serde_json::to_string_pretty(&json_schema()).unwrap() + "\n";
        golden("docs/schemas/evidence-1.schema.json", &text);
    }
}
