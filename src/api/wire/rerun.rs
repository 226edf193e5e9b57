//! What other limits would have raised, as a document.

use super::LevelName;
use super::finite;
use super::{FaultName, KindName};
use crate::alarms::Alarm;
use schemars::JsonSchema;
use serde::Serialize;

/// What `replay-alarms --format json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RerunDocument {
    /// `rotorwatch.replay-alarms/1`.
    pub schema: String,
    /// Machine id.
    pub machine: String,
    /// Beginning of the span, RFC 3339.
    pub from: String,
    /// Its end.
    pub to: String,
    /// Windows in it.
    pub windows: usize,
    /// Alarms that would stand at its beginning.
    pub standing: Vec<RerunAlarmWire>,
    /// What would have happened.
    pub would: Vec<RerunChangeWire>,
    /// What happened.
    pub was: Vec<RerunChangeWire>,
    /// What would have happened and did not.
    pub only_would: Vec<RerunChangeWire>,
    /// What happened and would not have.
    pub only_was: Vec<RerunChangeWire>,
    /// Stretches without windows.
    pub gaps: Vec<[String; 2]>,
    /// What the history cannot tell.
    pub notes: Vec<String>,
}

/// A change of a condition.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RerunChangeWire {
    /// When, RFC 3339; counted from 1970-01-01 in a stream without a start.
    pub at: String,
    /// raised, escalated, de_escalated or went.
    pub event: String,
    /// Of which alarm.
    pub alarm: RerunAlarmWire,
}

/// An alarm of a rerun: it has no number, as no operator ever saw it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RerunAlarmWire {
    /// diagnosis, limit or data.
    pub source: String,
    /// The limit's id.
    pub limit: Option<String>,
    /// Component's kind.
    pub kind: KindName,
    /// Component's id.
    pub component: String,
    /// Level.
    pub level: LevelName,
    /// Fault of the verdict.
    pub fault: Option<FaultName>,
    /// Severity of the verdict.
    pub severity: Option<f64>,
    /// Sentence.
    pub why: String,
}

impl RerunAlarmWire {
    /// Makes the JSON of an alarm.
    #[must_use]
    pub fn new(alarm: &Alarm) -> Self {
        Self {
            source: alarm.source.name().to_owned(),
            limit: alarm.source.limit().map(str::to_owned),
            kind: alarm.kind.into(),
            component: alarm.component.clone(),
            level: alarm.level.into(),
            fault: alarm.fault.map(Into::into),
            severity: alarm.severity.and_then(finite),
            why: alarm.why.clone(),
        }
    }
}

/// Makes the JSON Schema of [`RerunDocument`].
#[must_use]
pub fn json_schema() -> serde_json::Value {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    settings.into_generator().into_root_schema_for::<RerunDocument>().to_value()
}

#[cfg(test)]
mod tests {
    use super::json_schema;
    use crate::api::support::golden;

    #[test]
    fn committed_schema_is_current() {
        let text = serde_json::to_string_pretty(&json_schema()).unwrap() + "\n";
        golden("docs/schemas/replay-alarms-1.schema.json", &text);
    }
}
