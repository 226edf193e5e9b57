//! What people found of verdicts, as JSON.

use super::names::{FaultName, FindingName, KindName, StateName};
use super::{finite, rfc3339};
use crate::store::feedback::Feedback;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What people found.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct FeedbackListWire {
    /// Newest first.
    pub items: Vec<FeedbackWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

/// What somebody found of a verdict. It is kept, and nothing is learned from it by itself.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct FeedbackWire {
    /// Its number; rises.
    pub number: u64,
    /// Machine id.
    pub machine: String,
    /// When it was stored, wall clock.
    pub at: String,
    /// Who said it.
    pub author: String,
    /// What: `confirmed`, `wrong`, or `other_cause` was found.
    pub outcome: FindingName,
    /// Kind of the component.
    pub kind: KindName,
    /// Its id.
    pub component: String,
    /// The cause that was found, where the program has a name for it.
    pub fault: Option<FaultName>,
    /// In words; may be empty.
    pub note: String,
    /// The verdict as it was then.
    pub verdict: JudgementWire,
}

/// A verdict on a component as it was.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct JudgementWire {
    /// State.
    pub state: StateName,
    /// Strongest fault.
    pub fault: Option<FaultName>,
    /// Effect size, 0…1.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
    /// One plain sentence.
    pub why: String,
    /// Time of the newest sample it rests on; null: the stream's start is unknown.
    pub time: Option<String>,
    /// Hash of the configuration by which it was judged.
    pub judged_by: String,
}

/// What somebody found of the verdict that stands on a component.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedbackBody {
    /// Who, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// `confirmed`, `wrong`, or `other_cause` was found.
    pub outcome: FindingName,
    /// Kind of the component.
    pub kind: KindName,
    /// Its id.
    pub component: String,
    /// With `other_cause`: the cause that was found, where the program has a name for it.
    pub fault: Option<FaultName>,
    /// In words; needed with `other_cause` where `fault` is not said.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub note: String,
}

impl FeedbackWire {
    /// Makes the JSON of an entry.
    #[must_use]
    pub fn new(number: u64, entry: &Feedback) -> Self {
        let then = &entry.judgement;
        Self {
            number,
            machine: entry.machine.clone(),
            at: rfc3339(Some(entry.at), 0.0),
            author: entry.author.clone(),
            outcome: entry.finding.into(),
            kind: entry.component.0.into(),
            component: entry.component.1.clone(),
            fault: entry.found.map(Into::into),
            note: entry.note.clone(),
            verdict: JudgementWire {
                state: then.state.into(),
                fault: then.fault.map(Into::into),
                severity: then.severity.and_then(finite),
                confidence: then.confidence.and_then(finite),
                why: then.why.clone(),
                time: then.at.map(|at| rfc3339(Some(at), 0.0)),
                judged_by: then.judged_by.clone(),
            },
        }
    }
}
