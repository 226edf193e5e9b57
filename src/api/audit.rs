//! The audit: who did what, and which configurations ran.

use super::alarms::since;
use super::error::ApiError;
use super::events::read;
use super::extract::{PageQuery, Query, State, cursor, cut_page, page_limit};
use super::handles::EventsHandle;
use super::state::ApiState;
use super::wire::audit::{AuditItemWire, AuditListWire, ConfigurationListWire, ConfigurationWire};
use super::wire::problem::ProblemWire;
use crate::store::audit::AuditQuery;
use axum::Json;
use serde::Deserialize;
use std::sync::Arc;
use utoipa::IntoParams;

/// Which acts.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// On this machine only.
    machine: Option<String>,
    /// By this author only.
    author: Option<String>,
    /// At this time (RFC 3339) or later.
    since: Option<String>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists what operators did, newest first, also before a restart.
#[utoipa::path(
    get,
    path = "/api/v1/audit",
    tag = "audit",
    params(ListQuery),
    responses(
        (status = OK, body = AuditListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Query(query): Query<ListQuery>,
) -> Result<Json<AuditListWire>, ApiError> {
    let limit = page_limit(query.limit)?;
    // A machine that is no longer configured is asked for by its name, too.
    let machines = match query.machine {
        Some(machine) if !state.sees(&machine) => Some(Vec::new()),
        Some(machine) => Some(vec![machine]),
        None => state.visible(),
    };
    let wanted = AuditQuery {
        before: cursor(query.after.as_deref())?,
        machines,
        author: query.author,
        since: query.since.as_deref().map(since).transpose()?,
        limit: limit + 1,
    };
    let audit = Arc::clone(&events(&state)?.audit);
    let mut found = read(&audit, move |audit| audit.audit(&wanted)).await?;
    let next = cut_page(&mut found, limit, |item| item.number.to_string());
    Ok(Json(AuditListWire { items: found.iter().map(AuditItemWire::new).collect(), next }))
}

/// Lists the configurations that ran, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/configurations",
    tag = "audit",
    params(PageQuery),
    responses(
        (status = OK, body = ConfigurationListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn configurations(
    State(state): State<ApiState>,
    Query(query): Query<PageQuery>,
) -> Result<Json<ConfigurationListWire>, ApiError> {
    let (before, limit) = query.page()?;
    let audit = Arc::clone(&events(&state)?.audit);
    let mut found = read(&audit, move |audit| audit.configurations(before, limit + 1)).await?;
    let next = cut_page(&mut found, limit, |(number, _)| number.to_string());
    let items = found.iter().map(|(_, entry)| ConfigurationWire::new(entry)).collect();
    Ok(Json(ConfigurationListWire { items, next }))
}

fn events(state: &ApiState) -> Result<&EventsHandle, ApiError> {
    let none = || ApiError::NotFound("this service has no store".to_owned());
    state.events.as_ref().ok_or_else(none)
}
