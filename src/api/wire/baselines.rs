//! Baselines as JSON.

use super::{finite, rfc3339};
use crate::diagnosis::baseline::Record;
use crate::store::Held;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Baselines of a machine.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct BaselineListWire {
    /// Newest first.
    pub items: Vec<BaselineItemWire>,
}

/// A baseline: frozen, signed, of one operating state.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct BaselineItemWire {
    /// 32 hexadecimal digits, from the content.
    pub id: String,
    /// Machine id.
    pub machine: String,
    /// Whether windows of its operating state are held against it.
    pub active: bool,
    /// Whether it is as it was signed; one that is not is never used.
    pub intact: bool,
    /// Who learned it.
    pub author: String,
    /// Why, or of what.
    pub comment: String,
    /// When, UTC.
    pub learned_at: String,
    /// Speed of the first shaft it holds for, ± 5 %; null: any.
    pub speed_hz: Option<f64>,
    /// Load it holds for; null: any.
    pub load: Option<f64>,
    /// The records it was learned from.
    pub records: Vec<BaselineRecordWire>,
}

/// A record of a baseline.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct BaselineRecordWire {
    /// Name.
    pub name: String,
    /// Speed of the first shaft.
    pub speed_hz: Option<f64>,
    /// Load.
    pub load: Option<f64>,
    /// Windows that went into it.
    pub n_windows: usize,
    /// Windows that did not, by reason.
    pub left_out: Vec<LeftOutWire>,
    /// Number of features known.
    pub n_features: usize,
}

/// Windows that did not go into a record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct LeftOutWire {
    /// Why.
    pub reason: String,
    /// How many.
    pub n: usize,
}

/// A baseline with its numbers.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct BaselineDetailWire {
    /// The baseline.
    #[serde(flatten)]
    pub baseline: BaselineItemWire,
    /// Its numbers, in columns.
    pub usual: UsualWire,
}

/// What is usual, in columns of equal length.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema, ToSchema)]
pub struct UsualWire {
    /// Place of the record in `records`.
    pub record: Vec<usize>,
    /// Channel.
    pub channel: Vec<String>,
    /// Feature.
    pub feature: Vec<String>,
    /// Median over the windows, in the feature's unit.
    pub value: Vec<Option<f64>>,
    /// Standard deviation of the natural logarithm between windows, of `direction_1x_cos` and `_sin` of themselves; null: too few windows.
    pub log_scatter: Vec<Option<f64>>,
    /// Windows that have the feature.
    pub n_windows: Vec<usize>,
}

/// A baseline that was learned, and what speaks against it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct LearnedWire {
    /// The baseline.
    #[serde(flatten)]
    pub baseline: BaselineItemWire,
    /// What should be looked at before it is relied on.
    pub warnings: Vec<String>,
}

/// From what to learn: one of `windows`, `from` with `to`, and `captures`.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnBody {
    /// Who calls the machine healthy; with a token its label is who, whatever stands here.
    #[serde(default)]
    pub author: String,
    /// Why, or of what.
    #[serde(default)]
    pub comment: String,
    /// The newest so many windows, 5 to 720.
    pub windows: Option<usize>,
    /// Windows from this time (RFC 3339) …
    pub from: Option<String>,
    /// … to this time.
    pub to: Option<String>,
    /// Names of recordings in the store, such as `rig-1-00000007.h5`.
    pub captures: Option<Vec<String>>,
}

impl BaselineItemWire {
    /// Makes the JSON of a baseline.
    #[must_use]
    pub fn new(held: &Held) -> Self {
        let signed = &held.signed;
        let point = signed.point();
        Self {
            id: signed.id.to_string(),
            machine: signed.machine.clone(),
            active: held.is_active,
            intact: held.is_intact,
            author: signed.author.clone(),
            comment: signed.comment.clone(),
            learned_at: rfc3339(Some(signed.at), 0.0),
            speed_hz: point.speed.and_then(|speed| finite(speed.0)),
            load: point.load.and_then(finite),
            records: signed.records.iter().map(BaselineRecordWire::new).collect(),
        }
    }
}

impl BaselineRecordWire {
    fn new(record: &Record) -> Self {
        let left_out =
            |(reason, n): (&String, &usize)| LeftOutWire { reason: reason.clone(), n: *n };
        Self {
            name: record.name.clone(),
            speed_hz: record.point.speed.and_then(|speed| finite(speed.0)),
            load: record.point.load.and_then(finite),
            n_windows: record.n_windows,
            left_out: record.left_out.iter().map(left_out).collect(),
            n_features: record.usual.len(),
        }
    }
}

impl BaselineDetailWire {
    /// Makes the JSON of a baseline with its numbers.
    #[must_use]
    pub fn new(held: &Held) -> Self {
        let mut usual = UsualWire::default();
        for (place, record) in held.signed.records.iter().enumerate() {
            for ((channel, feature), found) in &record.usual {
                usual.record.push(place);
                usual.channel.push(channel.clone());
                usual.feature.push(feature.clone());
                usual.value.push(finite(found.value(feature)));
                usual.log_scatter.push(found.log_scatter.and_then(finite));
                usual.n_windows.push(found.n_windows);
            }
        }
        Self { baseline: BaselineItemWire::new(held), usual }
    }
}
