//! Captures as JSON.

use super::alarms::alarm_id;
use super::diagnosis::DiagnosisDocument;
use super::{finite, rfc3339};
use crate::api::handles::JudgedAgain;
use crate::store::captures::{CaptureEntry, CaptureLink};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A capture.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct CaptureWire {
    /// Its id; the file is downloaded as `id.h5`.
    pub id: String,
    /// Machine id.
    pub machine: String,
    /// Why it was made: `alarm` or `operator`.
    pub cause: String,
    /// Ids of the alarms it was made for.
    pub alarms: Vec<String>,
    /// Who asked for it; null: an alarm did.
    pub author: Option<String>,
    /// Why.
    pub comment: Option<String>,
    /// When it was asked for, UTC.
    pub requested_at: String,
    /// Stream time of the alarm or the request.
    pub trigger: String,
    /// The same in seconds of stream time.
    pub trigger_s: Option<f64>,
    /// Whether the stream's start is unknown, so that `trigger` counts from 1970-01-01.
    pub time_unknown: bool,
    /// First instant it holds, s of stream time.
    pub from_s: Option<f64>,
    /// Last instant it holds, s of stream time; null while it is written, and where that is not known.
    pub to_s: Option<f64>,
    /// `writing`, `complete`, `recovered` (cut off, what had reached the disk is there), `removed` or `failed`.
    pub state: String,
    /// What is to be known of it.
    pub note: Option<String>,
    /// Bytes of its file.
    pub bytes: u64,
    /// Windows it holds with everything needed to judge them again (`rotorwatch diagnose --evidence`).
    pub windows: u64,
}

/// Captures.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct CaptureListWire {
    /// Newest first.
    pub items: Vec<CaptureWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

/// An operator asks for a capture.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureBody {
    /// Who asks, not empty; with a token its label is who, whatever stands here.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub author: String,
    /// Why.
    #[serde(default)]
    #[schema(max_length = 2000)]
    pub comment: String,
    /// Stream time of the past, s, at most what is held (`captures.seconds_before`); null: that.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 3600)]
    pub before_s: Option<f64>,
    /// Stream time to come, s; null: `captures.seconds_after`.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 600)]
    pub after_s: Option<f64>,
}

/// A capture that was judged again, beside the verdict of then.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct JudgedAgainWire {
    /// Its id.
    pub capture: String,
    /// The verdict on all of it, as it is found now: by the machine and the baseline that it keeps.
    pub diagnosis: DiagnosisDocument,
    /// The verdict of then on the newest window it keeps, as `diagnosis`; null: it keeps none.
    #[schema(value_type = Option<Object>)]
    pub then: Option<serde_json::Value>,
    /// Windows it keeps to be judged again bit by bit.
    pub windows: usize,
    /// Those of them of which features, verdict and levels are the same now, bit by bit.
    pub equal: usize,
    /// Why bits may differ: another program or processor made the capture; null: neither.
    pub made_elsewhere: Option<String>,
}

/// A capture that is being made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct CaptureBegunWire {
    /// Its id.
    pub id: String,
}

/// The capture of an alarm, or why it has none.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct CaptureLinkWire {
    /// Its id.
    pub id: Option<String>,
    /// How it is doing, as in the list of captures.
    pub state: Option<String>,
    /// Why there is none.
    pub none_because: Option<String>,
}

impl CaptureWire {
    /// Makes the JSON of a capture.
    #[must_use]
    pub fn new(entry: &CaptureEntry) -> Self {
        let (author, comment) = entry.by.clone().unzip();
        Self {
            id: entry.id.clone(),
            machine: entry.machine.clone(),
            cause: if author.is_some() { "operator" } else { "alarm" }.to_owned(),
            alarms: entry.alarms.iter().map(|number| alarm_id(&entry.machine, *number)).collect(),
            author,
            comment,
            requested_at: rfc3339(Some(entry.requested), 0.0),
            trigger: rfc3339(entry.start, entry.trigger_s),
            trigger_s: finite(entry.trigger_s),
            time_unknown: entry.start.is_none(),
            from_s: entry.span_s.0.and_then(finite),
            to_s: entry.span_s.1.and_then(finite),
            state: entry.state.name().to_owned(),
            note: entry.note.clone(),
            bytes: entry.bytes,
            windows: entry.n_windows,
        }
    }
}

impl JudgedAgainWire {
    /// Makes the JSON of a capture judged again.
    #[must_use]
    pub fn new(id: &str, again: &JudgedAgain) -> Self {
        Self {
            capture: id.to_owned(),
            diagnosis: DiagnosisDocument::new(&again.diagnosis, Some(id)),
            then: again.then.as_deref().and_then(|then| serde_json::from_str(then).ok()),
            windows: again.windows.0,
            equal: again.windows.1,
            made_elsewhere: again.made_elsewhere.clone(),
        }
    }
}

impl CaptureLinkWire {
    /// Makes the JSON of a link.
    #[must_use]
    pub fn new(link: CaptureLink) -> Self {
        match link {
            CaptureLink::Has(id, state) => {
                Self { id: Some(id), state: Some(state.name().to_owned()), none_because: None }
            }
            CaptureLink::None(why) => Self { id: None, state: None, none_because: Some(why) },
        }
    }
}
