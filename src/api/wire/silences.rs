//! Silences in advance as JSON.

use super::names::{AlarmStateName, KindName};
use super::rfc3339;
use crate::alarms::state::{ShownState, Silence};
use crate::alarms::{Advance, Announcement, Ends, Subject};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Silences in advance.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct AdvanceListWire {
    /// Oldest first.
    pub items: Vec<AdvanceWire>,
}

/// A silence in advance.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct AdvanceWire {
    /// Its number within the machine, never used again.
    pub number: u64,
    /// `suppressed` or `out_of_service`.
    pub silence: AlarmStateName,
    /// Kind of the component whose verdicts are silent; null for others.
    pub kind: Option<KindName>,
    /// Id of that component; null for others.
    pub component: Option<String>,
    /// Id of the limit that is silent; null for others.
    pub limit: Option<String>,
    /// Name of the channel whose missing data are silent; null for others.
    pub channel: Option<String>,
    /// Whether everything of the machine is silent: it is maintained.
    pub whole_machine: bool,
    /// Who said it.
    pub author: String,
    /// Why.
    pub comment: String,
    /// Since when, wall clock.
    pub since: String,
    /// Until when, UTC, if the clock is not set; null: until somebody ends it.
    pub until: Option<String>,
}

/// A silence is said in advance, of one of: `kind` with `component`, `limit`, `channel`.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AnnounceBody {
    /// Who acts, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// Why.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub comment: String,
    /// `suppressed` or `out_of_service`.
    pub silence: AlarmStateName,
    /// Kind of a component.
    pub kind: Option<KindName>,
    /// Its id.
    pub component: Option<String>,
    /// Id of a limit of the machine file.
    pub limit: Option<String>,
    /// Name of a channel.
    pub channel: Option<String>,
    /// For how long, s, up to a year; left out: until somebody ends it.
    pub for_s: Option<f64>,
}

impl AnnounceBody {
    /// Reads what is wanted.
    ///
    /// # Errors
    /// What must be said.
    pub fn read(self) -> Result<Announcement, &'static str> {
        let Self { author, comment, silence, kind, component, limit, channel, for_s } = self;
        let subject = match (kind, component, limit, channel) {
            (Some(kind), Some(id), None, None) => Subject::Component(kind.into(), id),
            (None, None, Some(id), None) => Subject::Limit(id),
            (None, None, None, Some(name)) => Subject::Channel(name),
            (_, _, _, _) => {
                return Err("say one of kind with component, limit, and channel to be silent");
            }
        };
        let silence = match ShownState::from(silence) {
            ShownState::Suppressed => Silence::Suppressed,
            ShownState::OutOfService => Silence::OutOfService,
            ShownState::Normal
            | ShownState::Unacknowledged
            | ShownState::Acknowledged
            | ShownState::ReturnedUnacknowledged
            | ShownState::Latched
            | ShownState::Shelved => {
                return Err("silence must be \"suppressed\" or \"out_of_service\"");
            }
        };
        let ends = for_s.map_or(Ends::ByHand, Ends::After);
        Ok(Announcement { subject, silence, ends, author, comment })
    }
}

impl AdvanceWire {
    /// Makes the JSON of a silence in advance.
    #[must_use]
    pub fn new(one: &Advance) -> Self {
        let (kind, component, limit, channel) = match one.subject.clone() {
            Subject::Component(kind, id) => (Some(kind.into()), Some(id), None, None),
            Subject::Limit(id) => (None, None, Some(id), None),
            Subject::Channel(name) => (None, None, None, Some(name)),
            Subject::Machine => (None, None, None, None),
        };
        let shown = match one.silence {
            Silence::Shelved => ShownState::Shelved,
            Silence::Suppressed => ShownState::Suppressed,
            Silence::OutOfService => ShownState::OutOfService,
        };
        Self {
            number: one.number,
            silence: shown.into(),
            kind,
            component,
            limit,
            channel,
            whole_machine: one.is_maintenance(),
            author: one.by.author.clone(),
            comment: one.by.comment.clone(),
            since: rfc3339(Some(one.since), 0.0),
            until: one.until.map(|until| rfc3339(Some(until.utc), 0.0)),
        }
    }
}
