//! Who did what, and which configurations ran, as JSON.

use super::alarms::alarm_id;
use super::rfc3339;
use crate::store::ConfigurationEntry;
use crate::store::audit::AuditEntry;
use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// Acts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct AuditListWire {
    /// Newest first.
    pub items: Vec<AuditItemWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

/// One act.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct AuditItemWire {
    /// Its number; rises.
    pub number: u64,
    /// When it was stored, wall clock.
    pub at: String,
    /// Who.
    pub author: String,
    /// What: the transition of an alarm (`acknowledged`, `shelved`, …), or what was done to a baseline.
    pub action: String,
    /// Machine id.
    pub machine: Option<String>,
    /// Id of the alarm.
    pub alarm: Option<String>,
    /// Id of the baseline.
    pub baseline: Option<String>,
    /// Why.
    pub comment: String,
}

/// Configurations that ran.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ConfigurationListWire {
    /// Newest first.
    pub items: Vec<ConfigurationWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

/// A configuration that ran.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ConfigurationWire {
    /// Hash of the configuration as it was resolved, the machine files included.
    pub hash: String,
    /// Version of the program.
    pub version: String,
    /// Since when, wall clock; until the next.
    pub since: String,
}

impl AuditItemWire {
    /// Makes the JSON of an act.
    #[must_use]
    pub fn new(entry: &AuditEntry) -> Self {
        let machine = entry.machine.clone();
        Self {
            number: entry.number,
            at: rfc3339(Some(entry.at), 0.0),
            author: entry.author.clone(),
            action: entry.action.clone(),
            alarm: machine.as_deref().zip(entry.alarm).map(|(machine, n)| alarm_id(machine, n)),
            machine,
            baseline: entry.baseline.clone(),
            comment: entry.comment.clone(),
        }
    }
}

impl ConfigurationWire {
    /// Makes the JSON of a configuration.
    #[must_use]
    pub fn new(entry: &ConfigurationEntry) -> Self {
        Self {
            hash: entry.hash.clone(),
            version: entry.version.clone(),
            since: rfc3339(Some(entry.since), 0.0),
        }
    }
}
