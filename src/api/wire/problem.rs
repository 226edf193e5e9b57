//! Errors as RFC 9457 problem details.

use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// A problem (RFC 9457), sent as `application/problem+json` with every status from 400.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
pub struct ProblemWire {
    /// Which kind of problem, stable: `urn:rotorwatch:problem:…`.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// What was wrong with this request and what is allowed.
    pub detail: String,
    /// Path of the request.
    pub instance: String,
    /// Single faults, where there are several; of a machine that nothing was judged of yet, what stands accused from before.
    pub errors: Vec<String>,
}
