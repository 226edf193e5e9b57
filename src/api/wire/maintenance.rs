//! Maintenance of a machine as JSON.

use super::{rfc3339, timestamp};
use crate::alarms::state::Silence;
use crate::alarms::{Advance, Announcement, Ends, Subject};
use crate::api::view::MachineView;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A machine is maintained: whatever it raises is out of service.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct MaintenanceWire {
    /// Its number among the silences in advance of the machine, never used again.
    pub number: u64,
    /// Who said it.
    pub author: String,
    /// Why.
    pub reason: String,
    /// Since when, wall clock.
    pub since: String,
    /// Until when, if the clock is not set and nobody ends it before.
    pub until: Option<String>,
}

/// Whether a machine is maintained.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct MaintenanceStateWire {
    /// Machine id.
    pub machine: String,
    /// The maintenance; null: there is none.
    pub maintenance: Option<MaintenanceWire>,
}

/// A machine is to be maintained: one of `until` and `for_s`.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MaintenanceBody {
    /// Who acts, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// Why, not empty.
    #[schema(max_length = 2000)]
    pub reason: String,
    /// When it ends (RFC 3339), within a year.
    pub until: Option<String>,
    /// For how long, s, up to a year.
    pub for_s: Option<f64>,
}

impl MaintenanceBody {
    /// Reads what is wanted.
    ///
    /// # Errors
    /// What must be said.
    pub fn read(self) -> Result<Announcement, String> {
        let Self { author, reason, until, for_s } = self;
        let ends = match (until, for_s) {
            (Some(until), None) => Ends::At(timestamp(&until).ok_or_else(|| {
                format!("until is {until:?}, allowed is a time such as 2026-05-04T12:00:00Z")
            })?),
            (None, Some(for_s)) => Ends::After(for_s),
            (Some(_), Some(_)) | (None, None) => {
                return Err("say when the maintenance ends: one of until and for_s".to_owned());
            }
        };
        let (subject, silence) = (Subject::Machine, Silence::OutOfService);
        Ok(Announcement { subject, silence, ends, author, comment: reason })
    }
}

impl MaintenanceWire {
    /// Makes the JSON of a maintenance.
    #[must_use]
    pub fn new(one: &Advance) -> Self {
        Self {
            number: one.number,
            author: one.by.author.clone(),
            reason: one.by.comment.clone(),
            since: rfc3339(Some(one.since), 0.0),
            until: one.until.map(|until| rfc3339(Some(until.utc), 0.0)),
        }
    }

    /// That of a machine; `None`: it is not maintained.
    #[must_use]
    pub fn of(view: &MachineView) -> Option<Self> {
        view.advance.iter().find(|one| one.is_maintenance()).map(Self::new)
    }
}
