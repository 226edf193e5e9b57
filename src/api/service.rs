//! The daemon itself: liveness, readiness, metrics, the API document.

use super::error::ApiError;
use super::exposition;
use super::extract::{Query, State, in_range};
use super::state::{ApiState, newest};
use super::view::SourceState;
use super::wire::problem::ProblemWire;
use super::wire::system::{LiveWire, LogWire, ReadyWire};
use axum::Json;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use std::sync::OnceLock;
use utoipa::IntoParams;

/// Says that the process answers.
#[utoipa::path(get, path = "/livez", tag = "service", responses((status = OK, body = LiveWire)))]
pub(super) async fn livez() -> Json<LiveWire> {
    Json(LiveWire { live: true })
}

/// Says whether every source is open or came to its end and the pipeline moves.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "service",
    responses(
        (status = OK, body = ReadyWire),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not ready; `errors` holds the reasons"),
    )
)]
pub(super) async fn readyz(State(state): State<ApiState>) -> Result<Json<ReadyWire>, ApiError> {
    let mut reasons = (state.readiness)();
    for (id, handle) in state.machines.iter() {
        match &newest(handle).source {
            SourceState::Starting => reasons.push(format!("source of {id:?} is not open yet")),
            SourceState::Failed(why) => reasons.push(format!("source of {id:?} failed: {why}")),
            SourceState::Running | SourceState::Finished => {}
        }
        if handle.view.has_changed().is_err() {
            reasons.push(format!("the shard of {id:?} has ended"));
        }
    }
    if reasons.is_empty() {
        Ok(Json(ReadyWire { ready: true }))
    } else {
        Err(ApiError::NotReady(reasons))
    }
}

/// Which lines.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct LogQuery {
    /// The newest lines, at most so many.
    #[param(minimum = 1, maximum = 1000, default = 200)]
    limit: Option<usize>,
}

/// Gives the newest lines of the log, oldest first. They are held in memory alone.
#[utoipa::path(
    get,
    path = "/api/v1/log",
    tag = "service",
    params(LogQuery),
    responses(
        (status = OK, body = LogWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn log(
    State(state): State<ApiState>,
    Query(query): Query<LogQuery>,
) -> Result<Json<LogWire>, ApiError> {
    let limit = in_range("limit", query.limit, 200, 1, 1000)?;
    Ok(Json(LogWire { lines: (state.log)(limit) }))
}

/// Gives the metrics as OpenMetrics text; in the older format of Prometheus to who accepts text/plain alone.
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "service",
    responses((status = OK, description = "Metrics", content(
        (String = "application/openmetrics-text"),
        (String = "text/plain"),
    )))
)]
pub(super) async fn metrics(State(state): State<ApiState>, headers: HeaderMap) -> Response {
    let accepts =
        headers.get(header::ACCEPT).and_then(|accepts| accepts.to_str().ok()).unwrap_or_default();
    if accepts.contains("text/plain") && !accepts.contains("openmetrics") {
        let text = exposition::classic(&(state.metrics)());
        return ([(header::CONTENT_TYPE, exposition::CONTENT_TYPE)], text).into_response();
    }
    let content_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    ([(header::CONTENT_TYPE, content_type)], (state.metrics)()).into_response()
}

/// Gives this document.
#[utoipa::path(
    get,
    path = "/api/v1/openapi.json",
    tag = "service",
    responses((status = OK, body = Object, description = "OpenAPI 3.1"))
)]
pub(super) async fn openapi_json() -> Response {
    static TEXT: OnceLock<String> = OnceLock::new();
    let text = TEXT.get_or_init(super::openapi_text);
    ([(header::CONTENT_TYPE, "application/json")], text.as_str()).into_response()
}
