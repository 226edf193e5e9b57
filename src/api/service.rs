//! The daemon itself: liveness, readiness, metrics, the API document.

use super::error::ApiError;
use super::exposition;
use super::extract::{Query, State, in_range};
use super::handles::{IngestView, MachineHandle};
use super::state::{ApiState, newest};
use super::view::{MachineView, SourceState};
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

/// Says whether every source is open or came to its end, live senders are connected, the pipeline moves and the store takes what
/// is to be kept. Not for who ends what does not answer: that is `/livez`.
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
        reasons.extend(missing_source(handle, &newest(handle)));
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

/// Why the samples of a machine cannot come at the moment; `None`: they can, or have come to their end.
fn missing_source(handle: &MachineHandle, view: &MachineView) -> Option<String> {
    let id = &handle.id;
    let senders = handle.ingest.as_ref().map(|status| status());
    match (&view.source, senders) {
        (SourceState::Failed(why), _) => Some(format!("source of {id:?} failed: {why}")),
        (SourceState::Starting, None) => Some(format!("source of {id:?} is not open yet")),
        (SourceState::Starting | SourceState::Running, Some(senders)) => {
            missing_sender(id, &senders, view.source == SourceState::Starting)
        }
        (SourceState::Running, None) | (SourceState::Finished, _) => None,
    }
}

/// Which live sender of a machine is missing, or has sent nothing yet.
fn missing_sender(id: &str, senders: &IngestView, is_starting: bool) -> Option<String> {
    if senders.n_senders == 0 {
        return Some(format!("no sender of {id:?} is connected"));
    }
    let unsent = senders.channels.iter().filter(|channel| channel.sender.is_none());
    let unsent: Vec<&str> = unsent.map(|channel| channel.name.as_str()).collect();
    if !unsent.is_empty() {
        return Some(format!("no sender of {id:?} is connected that sends {}", unsent.join(", ")));
    }
    is_starting.then(|| format!("the senders of {id:?} have sent nothing yet"))
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
