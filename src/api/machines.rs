//! Machines: list, description, health, diagnosis.

use super::error::ApiError;
use super::extract::{Path, Query, State};
use super::state::{ApiState, newest};
use super::view::{MachineView, accusations};
use super::wire::diagnosis::DiagnosisDocument;
use super::wire::machines::{
    HealthWire, MachineItemWire, MachineListWire, MachineWire, no_data_reason, source_and_reason,
};
use super::wire::problem::ProblemWire;
use super::wire::rfc3339;
use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

/// What of each machine.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// With the health of each component.
    #[serde(default)]
    components: bool,
}

/// Lists the machines.
#[utoipa::path(
    get,
    path = "/api/v1/machines",
    tag = "machines",
    params(ListQuery),
    responses(
        (status = OK, body = MachineListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Query(query): Query<ListQuery>,
) -> Json<MachineListWire> {
    let item = |handle| {
        let view = newest(handle);
        let item = MachineItemWire::new(&view.machine, &view);
        if query.components { item.with_components(&view) } else { item }
    };
    Json(MachineListWire { items: state.machines.values().map(item).collect() })
}

/// Describes a machine, with the lines its construction may show.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}",
    tag = "machines",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = MachineWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn describe(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<MachineWire>, ApiError> {
    let handle = state.machine(&id)?;
    Ok(Json(MachineWire::new(&handle.machine(), &newest(handle))))
}

/// Gives the state of each component and since when.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/health",
    tag = "machines",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = HealthWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn health(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<HealthWire>, ApiError> {
    let handle = state.machine(&id)?;
    Ok(Json(HealthWire::new(&handle.machine(), &newest(handle))))
}

/// Gives the newest diagnosis.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/diagnosis",
    tag = "machines",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = DiagnosisDocument),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No such machine, or no window judged yet: `detail` says when, and where to look meanwhile; `errors` what \
                        stands accused from before"),
    )
)]
pub(super) async fn diagnosis(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<DiagnosisDocument>, ApiError> {
    let view = newest(state.machine(&id)?);
    match &view.diagnosis {
        Some(diagnosis) => {
            let document = DiagnosisDocument::new(diagnosis, None);
            Ok(Json(DiagnosisDocument {
                judged_by: Some(view.judged_by.to_string()),
                judged_until: view.window_end_s.map(|end_s| rfc3339(view.start_time, end_s)),
                no_data: no_data_reason(&view),
                ..document
            }))
        }
        None => Err(not_judged(&id, &view)),
    }
}

/// Why there is no verdict yet, when there will be one, where to look meanwhile, and what stands accused from before.
fn not_judged(id: &str, view: &MachineView) -> ApiError {
    let awaited = match source_and_reason(view) {
        (_, Some(reason)) => format!("once data come again ({reason})"),
        (source, None) => {
            format!("with the first whole window of samples (its source is {source})")
        }
    };
    let detail = format!(
        "no window of {id:?} has been judged since the start; it will be {awaited}. Until then /api/v1/machines/{id}/health says \
         its state and what stands accused from before, and /api/v1/alarms?machine={id} since when and why"
    );
    let standing = accusations(&view.alarms).into_iter().map(|alarm| {
        let cause = alarm.fault.map_or("cause not proven", |fault| fault.name());
        format!(
            "{} {:?} stands accused since {}: {}, {cause}: {}",
            alarm.kind.name(),
            alarm.component,
            rfc3339(view.start_time, alarm.active_since_s),
            alarm.level.name(),
            alarm.why
        )
    });
    ApiError::NotJudged { detail, standing: standing.collect() }
}
