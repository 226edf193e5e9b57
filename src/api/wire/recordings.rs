//! Recordings as JSON.

use crate::capture::recording::store::Recorded;
use schemars::JsonSchema;
use serde::Serialize;
use std::time::SystemTime;
use utoipa::ToSchema;

/// A recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct RecordedFileWire {
    /// Name of the file, which is also what baselines are learned by.
    pub file: String,
    /// `writing` or `finished`.
    pub state: String,
    /// Bytes of its file.
    pub bytes: u64,
    /// When it was written last, UTC; null if the file system does not say.
    pub written_at: Option<String>,
}

/// Recordings of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct RecordedListWire {
    /// Newest first.
    pub items: Vec<RecordedFileWire>,
    /// Value of `after` for the next page; null on the last one.
    pub next: Option<String>,
}

impl RecordedFileWire {
    pub(in crate::api) fn new(file: &Recorded, is_growing: bool) -> Self {
        let state = if is_growing { "writing" } else { "finished" };
        Self {
            file: file.name.clone(),
            state: state.to_owned(),
            bytes: file.bytes,
            written_at: file.written.and_then(utc),
        }
    }
}

fn utc(at: SystemTime) -> Option<String> {
    jiff::Timestamp::try_from(at).ok().map(|at| at.to_string())
}
