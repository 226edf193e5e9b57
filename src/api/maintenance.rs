//! Maintenance of a machine: whatever it raises meanwhile is out of service.

use super::error::ApiError;
use super::extract::{Body, Path, Query, State};
use super::silences::ByQuery;
use super::state::{ApiState, newest};
use super::view::ShardRequest;
use super::wire::maintenance::{MaintenanceBody, MaintenanceStateWire, MaintenanceWire};
use super::wire::problem::ProblemWire;
use axum::Json;
use axum::http::StatusCode;

/// Says whether a machine is maintained, by whom, why and until when.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/maintenance",
    tag = "alarms",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = MaintenanceStateWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn show(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<MaintenanceStateWire>, ApiError> {
    let maintenance = MaintenanceWire::of(&newest(state.machine(&id)?));
    Ok(Json(MaintenanceStateWire { machine: id, maintenance }))
}

/// Begins the maintenance of a machine, or gives it another time and reason.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/maintenance",
    tag = "alarms",
    params(("id" = String, Path, description = "Machine id")),
    request_body = MaintenanceBody,
    responses(
        (status = CREATED, body = MaintenanceWire, description = "It holds, and is stored"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "There are as many silences in advance as may be"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not answered in time, or in effect but not stored yet"),
    )
)]
pub(super) async fn begin(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(mut body): Body<MaintenanceBody>,
) -> Result<(StatusCode, Json<MaintenanceWire>), ApiError> {
    body.author = state.author(body.author);
    let handle = state.machine(&id)?;
    let wanted = body.read().map_err(ApiError::Invalid)?;
    let said = state.ask(handle, |reply| ShardRequest::Announce { wanted, reply }).await??;
    Ok((StatusCode::CREATED, Json(MaintenanceWire::new(&said))))
}

/// Ends the maintenance of a machine before its time.
#[utoipa::path(
    delete,
    path = "/api/v1/machines/{id}/maintenance",
    tag = "alarms",
    params(("id" = String, Path, description = "Machine id"), ByQuery),
    responses(
        (status = NO_CONTENT, description = "It is over, which is stored"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No such machine, or it is not maintained"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not answered in time, or in effect but not stored yet"),
    )
)]
pub(super) async fn end(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Query(by): Query<ByQuery>,
) -> Result<StatusCode, ApiError> {
    let handle = state.machine(&id)?;
    let Some(MaintenanceWire { number, .. }) = MaintenanceWire::of(&newest(handle)) else {
        return Err(ApiError::NotFound(format!("the machine {id:?} is not maintained")));
    };
    let by = by.signed(&state);
    state.ask(handle, |reply| ShardRequest::Revoke { number, by, reply }).await??;
    Ok(StatusCode::NO_CONTENT)
}
