//! Alarms: list, show, history, load.
//!
//! The newest events are a shard's own, older ones the store's; together they read as one history, also
//! while the store refuses.

use super::captures;
use super::error::ApiError;
use super::extract::{MAX_LIMIT, Path, Query, State, cut_page, page_limit};
use super::handles::MachineHandle;
use super::state::{ApiState, newest};
use super::view::{AlarmHistory, ShardRequest};
use super::wire::alarms::{
    AlarmDetailWire, AlarmEventWire, AlarmHistoryWire, AlarmListWire, AlarmLoadWire, AlarmWire,
    MachineLoadWire, alarm_id, parse_alarm_id,
};
use super::wire::problem::ProblemWire;
use super::wire::{AlarmStateName, LevelName, timestamp};
use crate::alarms::AlarmEvent;
use crate::alarms::load;
use crate::signal::Timestamp;
use crate::store::EventQuery;
use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

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
    /// Changed at this time (RFC 3339) or later.
    since: Option<String>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists the alarms that are not over.
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
    let limit = page_limit(query.limit)?;
    let cursor = query.after.as_deref().map(cursor).transpose()?;
    let since = query.since.as_deref().map(since).transpose()?;
    let mut items = Vec::new();
    for (id, handle) in chosen(&state, query.machine.as_deref())? {
        let view = newest(handle);
        items.extend(
            view.alarms
                .iter()
                .filter(|alarm| {
                    query.component.as_ref().is_none_or(|component| *component == alarm.component)
                        && query.level.is_none_or(|level| level == alarm.level.into())
                        && query.state.is_none_or(|state| state == alarm.shown().into())
                        && is_since(since, view.start_time, alarm.changed_at_s)
                        && is_behind(cursor, id, alarm.id)
                })
                .map(|alarm| (alarm.id, AlarmWire::new(id, alarm, view.start_time))),
        );
    }
    let next = cut_page(&mut items, limit, |(_, item)| item.id.clone());
    let mut items: Vec<AlarmWire> = items.into_iter().map(|(_, item)| item).collect();
    captures::link(&state, &mut items.iter_mut().collect::<Vec<_>>()).await?;
    Ok(Json(AlarmListWire { items, next }))
}

/// Which events.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct HistoryQuery {
    /// Of this machine only.
    machine: Option<String>,
    /// Of this component only.
    component: Option<String>,
    /// At this time (RFC 3339) or later.
    since: Option<String>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists what happened to alarms, also before a restart.
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
    let limit = page_limit(query.limit)?;
    let cursor = query.after.as_deref().map(cursor).transpose()?;
    let since = query.since.as_deref().map(since).transpose()?;
    let (mut items, mut dropped) = (Vec::new(), 0_u64);
    for (id, handle) in chosen(&state, query.machine.as_deref())? {
        let before = match cursor {
            Some((machine, _)) if id < machine => continue,
            Some((machine, number)) if id == machine => number,
            Some(_) | None => u64::MAX,
        };
        let start = newest(handle).start_time;
        let wanted = EventQuery {
            machine: id.to_owned(),
            before,
            since,
            component: query.component.clone(),
            alarm: None,
            limit: (limit + 1).saturating_sub(items.len()),
            start,
        };
        let (events, gone) = events(&state, handle, wanted).await?;
        dropped = dropped.saturating_add(gone);
        items.extend(events.iter().map(|event| AlarmEventWire::new(id, event, start)));
    }
    let next = cut_page(&mut items, limit, |item| alarm_id(&item.alarm.machine, item.sequence));
    Ok(Json(AlarmHistoryWire { items, next, dropped }))
}

/// The events asked for, newest first: the shard's, then the store's older ones; and the number of events
/// that neither holds any more.
async fn events(
    state: &ApiState,
    handle: &MachineHandle,
    query: EventQuery,
) -> Result<(Vec<AlarmEvent>, u64), ApiError> {
    let held: AlarmHistory =
        state.ask(handle, |reply| ShardRequest::AlarmHistory { reply }).await?;
    let fits = |event: &&AlarmEvent| {
        event.sequence < query.before
            && query.component.as_ref().is_none_or(|c| *c == event.alarm.component)
            && query.alarm.is_none_or(|alarm| alarm == event.alarm.id)
            && is_since(query.since, query.start, event.time_s)
    };
    let newer = held.events.iter().rev().filter(fits).take(query.limit);
    let mut found: Vec<AlarmEvent> = newer.cloned().collect();
    let oldest_held = held.events.first().map_or(held.dropped + 1, |event| event.sequence);
    let older = EventQuery {
        before: query.before.min(oldest_held),
        limit: query.limit - found.len(),
        ..query
    };
    let read = state.read_store(move |archive| {
        let oldest = archive.oldest(&older.machine)?;
        let events = if older.limit == 0 { Vec::new() } else { archive.events(&older)? };
        Ok((events, oldest))
    });
    let Some((older, oldest_stored)) = read.await? else { return Ok((found, held.dropped)) };
    found.extend(older);
    let oldest = oldest_stored.map_or(oldest_held, |oldest| oldest.min(oldest_held));
    Ok((found, oldest.saturating_sub(1)))
}

/// Shows one alarm with what happened to it, standing or over.
#[utoipa::path(
    get,
    path = "/api/v1/alarms/{id}",
    tag = "alarms",
    params(("id" = String, Path, description = "Alarm id, e.g. `rig-1:12`")),
    responses(
        (status = OK, body = AlarmDetailWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn show(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<AlarmDetailWire>, ApiError> {
    let (machine, number, handle) = find(&state, &id)?;
    let view = newest(handle);
    let query = EventQuery {
        machine: machine.to_owned(),
        before: u64::MAX,
        alarm: Some(number),
        limit: MAX_LIMIT,
        start: view.start_time,
        ..EventQuery::default()
    };
    let (events, _) = events(&state, handle, query).await?;
    // The snapshot knows the newest words of a standing alarm, the events know its end.
    let standing = view.alarms.iter().find(|alarm| alarm.id == number);
    let Some(alarm) = standing.or(events.first().map(|event| &event.alarm)) else {
        return Err(ApiError::NotFound(format!("no alarm {id:?} stands or is in the history")));
    };
    let mut detail = AlarmDetailWire::new(machine, alarm, &events, view.start_time);
    captures::link(&state, &mut [&mut detail.alarm]).await?;
    Ok(Json(detail))
}

/// Says what the alarms ask of an operator: rate, floods, chatter, stale alarms, which came first.
#[utoipa::path(
    get,
    path = "/api/v1/alarms/load",
    tag = "alarms",
    responses((status = OK, body = AlarmLoadWire))
)]
pub(super) async fn load(State(state): State<ApiState>) -> Json<AlarmLoadWire> {
    let mut whole = AlarmLoadWire {
        last_hour: 0,
        last_ten_minutes: 0,
        flood: false,
        chattering: Vec::new(),
        stale: Vec::new(),
        machines: Vec::new(),
    };
    for (id, handle) in state.machines.iter() {
        let view = newest(handle);
        let load = &view.alarm_load;
        whole.last_hour += load.last_hour;
        whole.last_ten_minutes += load.last_ten_minutes;
        whole.chattering.extend(load.chattering.iter().map(|number| alarm_id(id, *number)));
        whole.stale.extend(load.stale.iter().map(|number| alarm_id(id, *number)));
        whole.machines.push(MachineLoadWire::new(id, load));
    }
    whole.flood = whole.last_ten_minutes > load::FLOOD_ALARMS;
    Json(whole)
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

/// Machine and number of an alarm's id.
pub(super) fn find<'a>(
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

pub(super) fn since(text: &str) -> Result<Timestamp, ApiError> {
    timestamp(text).ok_or_else(|| {
        let message = "allowed is a time such as 2026-05-04T12:00:00Z";
        ApiError::Invalid(format!("since is {text:?}, {message}"))
    })
}

/// Whether a stream time is at `since` or later; without a start it counts from 1970-01-01, as shown.
fn is_since(since: Option<Timestamp>, start: Option<Timestamp>, time_s: f64) -> bool {
    since.is_none_or(|since| start.unwrap_or_default().plus_seconds(time_s) >= since)
}

/// Whether an item comes behind the cursor, in the order machine rising, number falling. Holds also
/// when the item of the cursor is gone.
fn is_behind(cursor: Option<(&str, u64)>, machine: &str, number: u64) -> bool {
    cursor.is_none_or(|(at_machine, at_number)| {
        machine > at_machine || (machine == at_machine && number < at_number)
    })
}
