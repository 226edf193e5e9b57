//! Alarms: list, show, acknowledge, history.

use super::error::ApiError;
use super::extract::{Body, Path, Query, in_range};
use super::state::{ApiState, newest};
use super::view::{MachineHandle, ShardRequest};
use super::wire::alarms::{
    AcknowledgeBody, AlarmEventWire, AlarmHistoryWire, AlarmListWire, AlarmWire, alarm_id,
    parse_alarm_id,
};
use super::wire::problem::ProblemWire;
use super::wire::{AlarmStateName, LevelName};
use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

/// Items a page holds at most.
const MAX_LIMIT: usize = 1000;

/// Which alarms.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// Of this machine only.
    machine: Option<String>,
    /// Of this component only.
    component: Option<String>,
    /// Of this level only.
    level: Option<LevelName>,
    /// In this state only.
    state: Option<AlarmStateName>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists the alarms that are not back to normal.
#[utoipa::path(
    get,
    path = "/api/v1/alarms",
    tag = "alarms",
    params(ListQuery),
    responses(
        (status = OK, body = AlarmListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Query(query): Query<ListQuery>,
) -> Result<Json<AlarmListWire>, ApiError> {
    let limit = in_range("limit", query.limit, 100, 1, MAX_LIMIT)?;
    let cursor = query.after.as_deref().map(cursor).transpose()?;
    let mut items = Vec::new();
    for (id, handle) in chosen(&state, query.machine.as_deref())? {
        let view = newest(handle);
        items.extend(
            view.alarms
                .iter()
                .filter(|alarm| {
                    query.component.as_ref().is_none_or(|component| *component == alarm.component)
                        && query.level.is_none_or(|level| level == alarm.level.into())
                        && query.state.is_none_or(|state| state == alarm.state.into())
                        && is_behind(cursor, id, alarm.id)
                })
                .map(|alarm| (alarm.id, AlarmWire::new(id, alarm, view.start_time))),
        );
    }
    let next = (items.len() > limit).then(|| items[limit - 1].1.id.clone());
    items.truncate(limit);
    Ok(Json(AlarmListWire { items: items.into_iter().map(|(_, item)| item).collect(), next }))
}

/// Which events.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct HistoryQuery {
    /// Of this machine only.
    machine: Option<String>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists the alarm events held in memory.
#[utoipa::path(
    get,
    path = "/api/v1/alarms/history",
    tag = "alarms",
    params(HistoryQuery),
    responses(
        (status = OK, body = AlarmHistoryWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn history(
    State(state): State<ApiState>,
    Query(query): Query<HistoryQuery>,
) -> Result<Json<AlarmHistoryWire>, ApiError> {
    let limit = in_range("limit", query.limit, 100, 1, MAX_LIMIT)?;
    let cursor = query.after.as_deref().map(cursor).transpose()?;
    let (mut items, mut dropped) = (Vec::new(), 0_u64);
    for (id, handle) in chosen(&state, query.machine.as_deref())? {
        let start = newest(handle).start_time;
        let held = state.ask(handle, |reply| ShardRequest::AlarmHistory { reply }).await?;
        dropped = dropped.saturating_add(held.dropped);
        items.extend(
            held.events
                .iter()
                .rev()
                .filter(|event| is_behind(cursor, id, event.sequence))
                .map(|event| AlarmEventWire::new(id, event, start)),
        );
    }
    let next = (items.len() > limit)
        .then(|| alarm_id(&items[limit - 1].alarm.machine, items[limit - 1].sequence));
    items.truncate(limit);
    Ok(Json(AlarmHistoryWire { items, next, dropped }))
}

/// Shows one alarm, standing or still in the history.
#[utoipa::path(
    get,
    path = "/api/v1/alarms/{id}",
    tag = "alarms",
    params(("id" = String, Path, description = "Alarm id, e.g. `rig-1:12`")),
    responses(
        (status = OK, body = AlarmWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn show(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<AlarmWire>, ApiError> {
    let (machine, number, handle) = find(&state, &id)?;
    let view = newest(handle);
    if let Some(alarm) = view.alarms.iter().find(|alarm| alarm.id == number) {
        return Ok(Json(AlarmWire::new(machine, alarm, view.start_time)));
    }
    let held = state.ask(handle, |reply| ShardRequest::AlarmHistory { reply }).await?;
    held.events
        .iter()
        .rev()
        .find(|event| event.alarm.id == number)
        .map(|event| Json(AlarmWire::new(machine, &event.alarm, view.start_time)))
        .ok_or_else(|| {
            ApiError::NotFound(format!("no alarm {id:?} stands or is held in the history"))
        })
}

/// Acknowledges an alarm.
#[utoipa::path(
    post,
    path = "/api/v1/alarms/{id}/ack",
    tag = "alarms",
    params(("id" = String, Path, description = "Alarm id, e.g. `rig-1:12`")),
    request_body = AcknowledgeBody,
    responses(
        (status = OK, body = AlarmWire, description = "The alarm after the act"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "Already acknowledged"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn acknowledge(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(body): Body<AcknowledgeBody>,
) -> Result<Json<AlarmWire>, ApiError> {
    let (machine, number, handle) = find(&state, &id)?;
    let AcknowledgeBody { author, comment } = body;
    let alarm = state
        .ask(handle, |reply| ShardRequest::Acknowledge { alarm: number, author, comment, reply })
        .await??;
    Ok(Json(AlarmWire::new(machine, &alarm, newest(handle).start_time)))
}

/// The machine asked for, or all.
fn chosen<'s>(
    state: &'s ApiState,
    machine: Option<&'s str>,
) -> Result<Vec<(&'s str, &'s MachineHandle)>, ApiError> {
    match machine {
        Some(id) => Ok(vec![(id, state.machine(id)?)]),
        None => Ok(state.machines.iter().map(|(id, handle)| (id.as_str(), handle)).collect()),
    }
}

fn find<'a>(
    state: &'a ApiState,
    id: &'a str,
) -> Result<(&'a str, u64, &'a MachineHandle), ApiError> {
    let (machine, number) = parse_alarm_id(id).ok_or_else(|| {
        ApiError::Invalid(format!("{id:?} is no alarm id; it is machine:number, e.g. rig-1:12"))
    })?;
    Ok((machine, number, state.machine(machine)?))
}

fn cursor(after: &str) -> Result<(&str, u64), ApiError> {
    parse_alarm_id(after).ok_or_else(|| {
        ApiError::Invalid(format!("after is {after:?}, allowed is the `next` of another page"))
    })
}

/// Whether an item comes behind the cursor, in the order machine rising, number falling. Holds also
/// when the item of the cursor is gone.
fn is_behind(cursor: Option<(&str, u64)>, machine: &str, number: u64) -> bool {
    cursor.is_none_or(|(at_machine, at_number)| {
        machine > at_machine || (machine == at_machine && number < at_number)
    })
}
