//! Silence said in advance: of what a component, limit or channel may raise later.

use super::error::ApiError;
use super::extract::{Body, Path, Query, State};
use super::state::{ApiState, newest};
use super::view::{AdvanceFailure, ShardRequest};
use super::wire::problem::ProblemWire;
use super::wire::silences::{AdvanceListWire, AdvanceWire, AnnounceBody};
use crate::alarms::AdvanceError;
use axum::Json;
use axum::http::StatusCode;
use serde::Deserialize;
use utoipa::IntoParams;

/// Who ends a silence, and why.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ByQuery {
    /// Who; with a token its label is.
    #[serde(default)]
    #[param(max_length = 2000)]
    author: String,
    /// Why.
    #[serde(default)]
    #[param(max_length = 2000)]
    comment: String,
}

impl ByQuery {
    /// Who and why, as the token says.
    pub(super) fn signed(self, state: &ApiState) -> (String, String) {
        (state.author(self.author), self.comment)
    }
}

/// Lists the silences said in advance of a machine, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/silences",
    tag = "alarms",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = AdvanceListWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<AdvanceListWire>, ApiError> {
    let view = newest(state.machine(&id)?);
    Ok(Json(AdvanceListWire { items: view.advance.iter().map(AdvanceWire::new).collect() }))
}

/// Suppresses, or takes out of service, what a component, limit or channel may raise from now on.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/silences",
    tag = "alarms",
    params(("id" = String, Path, description = "Machine id")),
    request_body = AnnounceBody,
    responses(
        (status = CREATED, body = AdvanceWire, description = "It holds, and is stored"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "It is silent in advance already, or as many as may be are"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not answered in time, or in effect but not stored yet"),
    )
)]
pub(super) async fn announce(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(mut body): Body<AnnounceBody>,
) -> Result<(StatusCode, Json<AdvanceWire>), ApiError> {
    body.author = state.author(body.author);
    let handle = state.machine(&id)?;
    let wanted = body.read().map_err(|why| ApiError::Invalid(why.to_owned()))?;
    let said = state.ask(handle, |reply| ShardRequest::Announce { wanted, reply }).await??;
    Ok((StatusCode::CREATED, Json(AdvanceWire::new(&said))))
}

/// Ends a silence that was said in advance, and that of the alarms behind it.
#[utoipa::path(
    delete,
    path = "/api/v1/machines/{id}/silences/{number}",
    tag = "alarms",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("number" = u64, Path, description = "Number of the silence"),
        ByQuery,
    ),
    responses(
        (status = NO_CONTENT, description = "It is over, which is stored"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not answered in time, or in effect but not stored yet"),
    )
)]
pub(super) async fn revoke(
    State(state): State<ApiState>,
    Path((id, number)): Path<(String, u64)>,
    Query(by): Query<ByQuery>,
) -> Result<StatusCode, ApiError> {
    let handle = state.machine(&id)?;
    let by = by.signed(&state);
    state.ask(handle, |reply| ShardRequest::Revoke { number, by, reply }).await??;
    Ok(StatusCode::NO_CONTENT)
}

impl From<AdvanceFailure> for ApiError {
    fn from(failure: AdvanceFailure) -> Self {
        match failure {
            AdvanceFailure::Refused(error) => error.into(),
            AdvanceFailure::NotStored(_) => Self::NotStored(failure.to_string()),
        }
    }
}

impl From<AdvanceError> for ApiError {
    fn from(error: AdvanceError) -> Self {
        match error {
            AdvanceError::UnknownSubject(_) | AdvanceError::Unknown { .. } => {
                Self::NotFound(error.to_string())
            }
            AdvanceError::Already { .. } | AdvanceError::TooMany => {
                Self::Conflict(error.to_string())
            }
            AdvanceError::NoAuthor
            | AdvanceError::TextTooLong { .. }
            | AdvanceError::NotAllowed(_) => Self::Invalid(error.to_string()),
        }
    }
}
