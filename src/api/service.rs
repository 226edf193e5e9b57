//! The daemon itself: liveness, readiness, metrics, system, the API document.

use super::error::ApiError;
use super::exposition;
use super::extract::{Query, State, in_range};
use super::handles::ReceiverStatus;
use super::state::{ApiState, newest};
use super::view::{ConfigurationView, RecordingView, SourceState};
use super::wire::finite;
use super::wire::machines::source_and_reason;
use super::wire::problem::ProblemWire;
use super::wire::rfc3339;
use super::wire::system::{
    ConfigurationStateWire, EventStreamsWire, LiveWire, LogWire, ReadyWire, ReceiverWire,
    RecordingWire, SecurityWire, StoreWire, StreamWire, SystemWire, TrendStoreWire,
};
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

/// Gives version, configuration and the losses of every stream.
#[utoipa::path(
    get,
    path = "/api/v1/system",
    tag = "service",
    responses((status = OK, body = SystemWire))
)]
pub(super) async fn system(State(state): State<ApiState>) -> Json<SystemWire> {
    let streams = state.machines.iter().map(|(id, handle)| {
        let view = newest(handle);
        let (source, reason) = source_and_reason(&view);
        let lag = handle.simulation.as_ref().map(|simulation| simulation.view.borrow().lag);
        let sum = |count: fn(&crate::buffer::RingStatus) -> u64| view.rings.iter().map(count).sum();
        StreamWire {
            machine: id.clone(),
            source: source.to_owned(),
            reason,
            queue_bytes: view.queue_bytes,
            dropped_blocks: view.dropped.0,
            dropped_samples: view.dropped.1,
            received: sum(|ring| ring.received),
            missing: sum(|ring| ring.missing),
            gaps: sum(|ring| ring.gaps),
            duplicated: sum(|ring| ring.duplicated),
            clipped: sum(|ring| ring.clipped),
            simulation_lag_s: lag.and_then(|lag| finite(lag.now_s)),
            simulation_lag_given_up_s: lag.and_then(|lag| finite(lag.given_up_s)),
            recording: handle.recording.as_ref().map(|view| recording(&view.borrow())),
        }
    });
    let mut configuration = state.configuration.as_ref().map(|view| view.borrow().clone());
    // What waits or was refused may name any machine, and so may receivers.
    if state.is_restricted() {
        configuration = configuration.map(|view| ConfigurationView {
            restart: Vec::new(),
            rejected: view.rejected.map(|(at, _)| (at, Vec::new())),
            ..view
        });
    }
    let receivers = state.events.iter().filter(|_| !state.is_restricted());
    let caller = state.caller.as_ref();
    Json(SystemWire {
        name: env!("CARGO_PKG_NAME").to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        configuration_hash: configuration.as_ref().map(|view| view.hash.clone()),
        configuration: configuration.as_ref().map(configuration_wire),
        started_at: state.settings.started_at.map(|started| rfc3339(Some(started), 0.0)),
        store: state.store.as_ref().map(|store| StoreWire {
            failure: store.status.failure(),
            stored: store.status.n_stored(),
            waiting: store.status.n_waiting(),
            lost: store.status.n_lost(),
        }),
        security: SecurityWire {
            tokens: !state.door.is_open(),
            encrypted: state.settings.is_encrypted,
            warnings: state.settings.warnings.clone(),
            you: caller.map(|token| token.label().to_owned()),
            role: caller.map(|token| token.role().name().to_owned()),
        },
        receivers: receivers
            .flat_map(|events| events.receivers.borrow().iter().map(receiver).collect::<Vec<_>>())
            .collect(),
        event_streams: state.events.as_ref().map(|events| EventStreamsWire {
            open: events.open.get(),
            refused: events.refused.get(),
            stalled: events.stalled.get(),
        }),
        trends: state.trends.as_ref().map(|trends| {
            let holdings = *trends.holdings.borrow();
            TrendStoreWire {
                failure: trends.status.failure(),
                stored: trends.status.n_stored(),
                waiting: trends.status.n_waiting(),
                lost: trends.status.n_lost(),
                files: holdings.n_files,
                bytes: holdings.bytes,
                removed: holdings.n_removed,
                set_aside: holdings.n_set_aside,
            }
        }),
        streams: streams.collect(),
    })
}

fn configuration_wire(view: &ConfigurationView) -> ConfigurationStateWire {
    ConfigurationStateWire {
        since: rfc3339(Some(view.since), 0.0),
        waiting_for_restart: view.restart.clone(),
        rejected_at: view.rejected.as_ref().map(|(at, _)| rfc3339(Some(*at), 0.0)),
        rejected_because: view.rejected.iter().flat_map(|(_, why)| why.iter().cloned()).collect(),
    }
}

fn receiver(status: &ReceiverStatus) -> ReceiverWire {
    let view = status.view.borrow().clone();
    ReceiverWire {
        name: status.name.clone(),
        kind: status.kind.to_owned(),
        failure: view.failure,
        waiting: view.n_waiting,
        delivered: view.progress.n_delivered,
        refused: view.progress.n_refused,
        given_up: view.progress.n_given_up,
        last_delivered_at: view.last_delivered.map(|at| rfc3339(Some(at), 0.0)),
    }
}

fn recording(view: &RecordingView) -> RecordingWire {
    RecordingWire {
        file: view.file.clone(),
        failure: view.failure.clone(),
        files: view.n_files,
        bytes: view.bytes,
        recorded: view.n_recorded,
        lost: view.n_lost,
        failures: view.n_failures,
        removed: view.n_removed,
    }
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
