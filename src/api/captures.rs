//! Captures: list, download, ask for one; and which capture an alarm has.

use super::error::ApiError;
use super::extract::{Body, Path, Query, State, cut_page, in_range, page_limit};
use super::files;
use super::handles::CaptureHandle;
use super::state::ApiState;
use super::view::ShardRequest;
use super::wire::alarms::{AlarmWire, parse_alarm_id};
use super::wire::captures::{
    CaptureBegunWire, CaptureBody, CaptureLinkWire, CaptureListWire, CaptureWire, JudgedAgainWire,
};
use super::wire::problem::ProblemWire;
use crate::capture::recording::store::recording;
use crate::diagnosis::baseline::signed;
use crate::store::StoreError;
use crate::store::captures::{CaptureEntry, CaptureIndex, CaptureQuery, CaptureState};
use axum::Json;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;
use utoipa::IntoParams;

/// Stream time an operator may ask for, s, as the configuration may at most.
const MAX_BEFORE_S: f64 = 3600.0;
const MAX_AFTER_S: f64 = 600.0;

/// Largest capture that is judged again here: some seconds of work.
const MAX_JUDGED_BYTES: u64 = 200_000_000;

/// Which captures.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// Of this machine only.
    machine: Option<String>,
    /// Of this alarm only, e.g. `rig-1:12`.
    alarm: Option<String>,
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists captures, those that are gone too.
#[utoipa::path(
    get,
    path = "/api/v1/captures",
    tag = "captures",
    params(ListQuery),
    responses(
        (status = OK, body = CaptureListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Query(query): Query<ListQuery>,
) -> Result<Json<CaptureListWire>, ApiError> {
    let limit = page_limit(query.limit)?;
    let parsed = |id: &str| {
        let wrong = || ApiError::Invalid(format!("{id:?} is no alarm id, e.g. rig-1:12"));
        let (machine, number) = parse_alarm_id(id).ok_or_else(wrong)?;
        Ok::<_, ApiError>((machine.to_owned(), number))
    };
    let of_alarm = query.alarm.as_deref().map(parsed).transpose()?;
    let (machine, alarm) = match (query.machine, of_alarm) {
        (Some(machine), Some((of, _))) if machine != of => {
            return Err(ApiError::Invalid(format!(
                "alarm is of machine {of:?}, machine is {machine:?}"
            )));
        }
        (_, Some((machine, number))) => (Some(machine), Some(number)),
        (machine, None) => (machine, None),
    };
    if let Some(machine) = &machine {
        state.machine(machine)?;
    }
    let after = query.after;
    let machines = machine.map(|machine| vec![machine]).or_else(|| state.visible());
    let wanted = CaptureQuery { machines, alarm, after, limit: limit + 1 };
    let mut found = on_index(&state, move |index| index.list(&wanted)).await?;
    let next = cut_page(&mut found, limit, |item| item.id.clone());
    let root = desk(&state)?.root.clone();
    let found = files::beside(move || {
        found.iter_mut().for_each(|entry| look_for_file(&root, entry));
        found
    });
    let found = found.await?;
    Ok(Json(CaptureListWire { items: found.iter().map(CaptureWire::new).collect(), next }))
}

/// Gives a capture as a file; parts of it by `Range`.
#[utoipa::path(
    get,
    path = "/api/v1/captures/{id}",
    tag = "captures",
    params(("id" = String, Path, description = "Capture id")),
    responses(
        (status = OK, description = "HDF5 (docs/hdf5.md, docs/captures.md), as an attachment", body = Vec<u8>,
         content_type = "application/x-hdf5"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "It is still being written"),
    )
)]
pub(super) async fn download(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    request: Request,
) -> Result<Response, ApiError> {
    let (entry, file) = whole(&state, id).await?;
    let name = format!("{}.h5", entry.id);
    files::attachment(file, &name, request).await.ok_or_else(|| gone(&entry))
}

/// Says of a capture that there should be that its file is not there, as who asks for it is told.
fn look_for_file(root: &std::path::Path, entry: &mut CaptureEntry) {
    let is_ended = entry.state.has_file() && entry.state != CaptureState::Writing;
    let name = format!("{}.h5", entry.id);
    if is_ended && recording(root, &entry.machine, &name).is_none() {
        entry.state = CaptureState::Removed;
        entry.bytes = 0;
        entry.note = Some("its file is not there: somebody took it away".to_owned());
    }
}

fn gone(entry: &CaptureEntry) -> ApiError {
    let note = entry.note.clone().unwrap_or_else(|| "its file is not there".to_owned());
    ApiError::NotFound(format!("capture {} is {}: {note}", entry.id, entry.state.name()))
}

/// A capture that is not being written any more, with its file.
async fn whole(state: &ApiState, id: String) -> Result<(CaptureEntry, PathBuf), ApiError> {
    let root = desk(state)?.root.clone();
    let shown: String = id.chars().take(100).collect();
    let found = on_index(state, move |index| index.find(&id)).await?;
    let unknown =
        || ApiError::NotFound(format!("no capture {shown:?}; GET /api/v1/captures lists them"));
    let entry = found.filter(|entry| state.sees(&entry.machine)).ok_or_else(unknown)?;
    if entry.state == CaptureState::Writing {
        let after_s = entry.trigger_s;
        return Err(ApiError::Conflict(format!(
            "capture {} is being written: it goes on behind its trigger at {after_s:.1} s of stream time; ask \
             again when it is complete",
            entry.id
        )));
    }
    let name = format!("{}.h5", entry.id);
    let file = recording(&root, &entry.machine, &name).filter(|_| entry.state.has_file());
    let Some(file) = file else {
        let mut entry = entry;
        look_for_file(&root, &mut entry);
        return Err(gone(&entry));
    };
    Ok((entry, file))
}

/// Judges a capture again, as `rotorwatch diagnose` does: by the machine and the baseline that it keeps. Changes nothing;
/// one at a time.
#[utoipa::path(
    post,
    path = "/api/v1/captures/{id}/diagnosis",
    tag = "captures",
    params(("id" = String, Path, description = "Capture id")),
    responses(
        (status = OK, body = JudgedAgainWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "It is still being written, too long, cannot be judged, or another one is being judged"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not done in a minute"),
    )
)]
pub(super) async fn judge(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<JudgedAgainWire>, ApiError> {
    let (entry, file) = whole(&state, id).await?;
    if entry.bytes > MAX_JUDGED_BYTES {
        return Err(ApiError::Conflict(format!(
            "capture {} has {} bytes, {MAX_JUDGED_BYTES} at most are judged here: download it, and rotorwatch diagnose judges it",
            entry.id, entry.bytes
        )));
    }
    let permit = Arc::clone(&state.rejudging).try_acquire_owned().map_err(|_| {
        ApiError::Conflict("another capture is being judged: try again when it is done".to_owned())
    })?;
    let judge = Arc::clone(&desk(&state)?.judge);
    let judged = files::beside(move || {
        // Held until the work is done, even when the client has gone.
        let _permit = permit;
        judge(&file)
    });
    let judged = judged.await?.map_err(|why| {
        ApiError::Conflict(format!("capture {} cannot be judged: {why}", entry.id))
    })?;
    Ok(Json(JudgedAgainWire::new(&entry.id, &judged)))
}

/// Asks for a capture of what was just received and what follows.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/captures",
    tag = "captures",
    params(("id" = String, Path, description = "Machine id")),
    request_body = CaptureBody,
    responses(
        (status = CREATED, body = CaptureBegunWire, description = "It is in the list and being written"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "None can be made, with the reason"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
         content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn request(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(mut body): Body<CaptureBody>,
) -> Result<(StatusCode, Json<CaptureBegunWire>), ApiError> {
    body.author = state.author(body.author);
    let handle = state.machine(&id)?;
    signed::check_by(&body.author, &body.comment)?;
    let before_s = body.before_s.map(|s| in_range("before_s", Some(s), s, 0.0, MAX_BEFORE_S));
    let after_s = body.after_s.map(|s| in_range("after_s", Some(s), s, 0.0, MAX_AFTER_S));
    let (before_s, after_s) = (before_s.transpose()?, after_s.transpose()?);
    let CaptureBody { author, comment, .. } = body;
    let ask = |reply| ShardRequest::Capture { author, comment, before_s, after_s, reply };
    let id = state.ask(handle, ask).await?.map_err(ApiError::Conflict)?;
    Ok((StatusCode::CREATED, Json(CaptureBegunWire { id })))
}

/// Adds to alarms which capture they have, or why none.
pub(super) async fn link(state: &ApiState, alarms: &mut [&mut AlarmWire]) -> Result<(), ApiError> {
    if state.captures.is_none() {
        for alarm in alarms {
            let why = "no captures are made: captures.enabled is false".to_owned();
            alarm.capture =
                Some(CaptureLinkWire { id: None, state: None, none_because: Some(why) });
        }
        return Ok(());
    }
    let keys: Vec<(String, u64)> = alarms
        .iter()
        .filter_map(|alarm| parse_alarm_id(&alarm.id))
        .map(|(machine, number)| (machine.to_owned(), number))
        .collect();
    let links = on_index(state, move |index| index.links(&keys)).await?;
    for (alarm, link) in alarms.iter_mut().zip(links) {
        alarm.capture = link.map(CaptureLinkWire::new);
    }
    Ok(())
}

/// Reads the index beside the event loop.
async fn on_index<T: Send + 'static>(
    state: &ApiState,
    read: impl FnOnce(&dyn CaptureIndex) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, ApiError> {
    let index = Arc::clone(&desk(state)?.index);
    Ok(files::beside(move || read(&*index)).await??)
}

fn desk(state: &ApiState) -> Result<&CaptureHandle, ApiError> {
    let none = || ApiError::NotFound("this daemon makes no captures (captures.enabled)".to_owned());
    state.captures.as_ref().ok_or_else(none)
}
