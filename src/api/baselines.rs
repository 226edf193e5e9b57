//! Baselines: learn, list, show, activate, remove.
//!
//! An act is in the store before it is answered, and in use: the shard has taken it. Should the shard be
//! busy, it takes it within a second or two, as what the command line writes.

use super::error::ApiError;
use super::extract::{Body, Path, Query, State};
use super::files;
use super::handles::{BaselineHandle, MachineHandle};
use super::state::{ApiState, newest};
use super::view::{Measured, ShardRequest, Span};
use super::wire::alarms::ActBody;
use super::wire::baselines::{
    BaselineDetailWire, BaselineItemWire, BaselineListWire, LearnBody, LearnedWire,
};
use super::wire::problem::ProblemWire;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::robust;
use crate::diagnosis::baseline::signed;
use crate::diagnosis::baseline::signed::Signed;
use crate::signal::Timestamp;
use crate::store;
use crate::store::{Act, BaselineStore, Held, KeepError, active_records};
use axum::Json;
use axum::http::StatusCode;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::sync::Arc;
use utoipa::IntoParams;

/// Windows a baseline may be learned from at once: an hour at the usual hop.
const MAX_WINDOWS: usize = 720;

/// Recordings a baseline may be learned from at once.
const MAX_CAPTURES: usize = 20;

/// Lists the baselines of a machine, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/baselines",
    tag = "baselines",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = BaselineListWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<BaselineListWire>, ApiError> {
    state.machine(&id)?;
    let held = held(&state, &id).await?;
    Ok(Json(BaselineListWire { items: held.iter().map(BaselineItemWire::new).collect() }))
}

/// Gives a baseline with its numbers.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/baselines/{bid}",
    tag = "baselines",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("bid" = String, Path, description = "Baseline id"),
    ),
    responses(
        (status = OK, body = BaselineDetailWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn show(
    State(state): State<ApiState>,
    Path((id, bid)): Path<(String, String)>,
) -> Result<Json<BaselineDetailWire>, ApiError> {
    state.machine(&id)?;
    let held = held(&state, &id).await?;
    let found = held.iter().find(|held| *held.signed.id == *bid);
    found.map(|held| Json(BaselineDetailWire::new(held))).ok_or_else(|| unknown(&id, &bid))
}

/// Learns a baseline of the machine as it ran in a span of time, or of recordings, and uses it.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/baselines",
    tag = "baselines",
    params(("id" = String, Path, description = "Machine id")),
    request_body = LearnBody,
    responses(
        (status = CREATED, body = LearnedWire, description = "The baseline, which is stored and used"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "No windows that can be used, different operating states, or too many baselines"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
         content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Not answered in time, or not stored"),
    )
)]
pub(super) async fn learn(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(mut body): Body<LearnBody>,
) -> Result<(StatusCode, Json<LearnedWire>), ApiError> {
    body.author = state.author(body.author);
    let handle = state.machine(&id)?;
    signed::check_by(&body.author, &body.comment)?;
    let measured = match source(&body, newest(handle).start_time)? {
        Source::Windows(span) => {
            let found = state.ask(handle, |reply| ShardRequest::Measure { span, reply }).await?;
            vec![found.map_err(ApiError::Conflict)?]
        }
        Source::Captures(names) => measure(&state, handle, names).await?,
    };
    let warnings: Vec<String> = measured.iter().flat_map(|found| found.warnings.clone()).collect();
    let records: Vec<Record> = measured.into_iter().map(|found| found.record).collect();
    let load_bins = handle.machine().limits.load_bins.clone();
    let at = (desk(&state)?.wall_clock)();
    let (author, comment) = (&*body.author, &*body.comment);
    let signed = Signed::new(&id, (author, comment), at, records, &load_bins)?;
    let kept = on_store(&state, move |store| store::keep(store, signed, &load_bins));
    let (held, _replaced) = kept.await??;
    hand_out(&state, handle).await?;
    let baseline = BaselineItemWire::new(&held);
    Ok((StatusCode::CREATED, Json(LearnedWire { baseline, warnings })))
}

/// Uses a baseline again, instead of that of its operating state.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/baselines/{bid}/activate",
    tag = "baselines",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("bid" = String, Path, description = "Baseline id"),
    ),
    request_body = ActBody,
    responses(
        (status = OK, body = BaselineItemWire, description = "The baseline, which is used"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "It is not as it was signed"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
         content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn activate(
    State(state): State<ApiState>,
    Path((id, bid)): Path<(String, String)>,
    Body(mut by): Body<ActBody>,
) -> Result<Json<BaselineItemWire>, ApiError> {
    by.author = state.author(by.author);
    let handle = state.machine(&id)?;
    signed::check_by(&by.author, &by.comment)?;
    let at = (desk(&state)?.wall_clock)();
    let load_bins = handle.machine().limits.load_bins.clone();
    let done = on_store(&state, move |store| {
        let act = Act { author: &by.author, comment: &by.comment, at };
        store::use_again(store, (&id, &bid), &load_bins, &act)
    });
    let held = done.await??;
    hand_out(&state, handle).await?;
    Ok(Json(BaselineItemWire::new(&held)))
}

/// Who removes a baseline.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ByQuery {
    /// Who; with a token its label is.
    #[serde(default)]
    author: String,
    /// Why.
    #[serde(default)]
    comment: String,
}

/// Removes a baseline; the audit keeps its id.
#[utoipa::path(
    delete,
    path = "/api/v1/machines/{id}/baselines/{bid}",
    tag = "baselines",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("bid" = String, Path, description = "Baseline id"),
        ByQuery,
    ),
    responses(
        (status = NO_CONTENT, description = "It is gone"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn remove(
    State(state): State<ApiState>,
    Path((id, bid)): Path<(String, String)>,
    Query(mut by): Query<ByQuery>,
) -> Result<StatusCode, ApiError> {
    by.author = state.author(by.author);
    let handle = state.machine(&id)?;
    signed::check_by(&by.author, &by.comment)?;
    let at = (desk(&state)?.wall_clock)();
    let done = on_store(&state, move |store| {
        let act = Act { author: &by.author, comment: &by.comment, at };
        store::take_away(store, (&id, &bid), &act)
    });
    done.await??;
    hand_out(&state, handle).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// What to learn from.
enum Source {
    Windows(Span),
    Captures(Vec<String>),
}

/// Reads what to learn from of a body; `start`: UTC of stream time 0.
fn source(body: &LearnBody, start: Option<Timestamp>) -> Result<Source, ApiError> {
    let invalid = |why: String| Err(ApiError::Invalid(why));
    match (body.windows, body.from.as_deref().zip(body.to.as_deref()), &body.captures) {
        (Some(n), None, None) if body.from.is_none() && body.to.is_none() => {
            if (robust::FEWEST..=MAX_WINDOWS).contains(&n) {
                return Ok(Source::Windows(Span::Last(n)));
            }
            invalid(format!("windows is {n}, allowed are {} to {MAX_WINDOWS}", robust::FEWEST))
        }
        (None, Some((from, to)), None) => {
            let (from, to) = (stream_s("from", from, start)?, stream_s("to", to, start)?);
            if from < to {
                return Ok(Source::Windows(Span::Between(from, to)));
            }
            invalid("from must be before to".to_owned())
        }
        (None, None, Some(names)) if body.from.is_none() && body.to.is_none() => {
            let mut seen = BTreeSet::new();
            if let Some(twice) = names.iter().find(|name| !seen.insert(*name)) {
                let twice: String = twice.chars().take(100).collect();
                return invalid(format!(
                    "captures name {twice:?} twice: one record is one baseline"
                ));
            }
            if (1..=MAX_CAPTURES).contains(&names.len()) {
                return Ok(Source::Captures(names.clone()));
            }
            invalid(format!("captures are {}, allowed are 1 to {MAX_CAPTURES}", names.len()))
        }
        (_, _, _) => {
            invalid("say one of windows, from with to, and captures to learn from".to_owned())
        }
    }
}

/// A time as stream time, s.
fn stream_s(name: &str, text: &str, start: Option<Timestamp>) -> Result<f64, ApiError> {
    let time: jiff::Timestamp = text.parse().map_err(|_| {
        let found: String = text.chars().take(100).collect();
        ApiError::Invalid(format!(
            "{name} is {found:?}, allowed is a time such as 2026-05-04T08:00:00Z"
        ))
    })?;
    let since = time.as_nanosecond() - i128::from(start.unwrap_or_default().0);
    #[expect(clippy::cast_precision_loss, reason = "microseconds are fine enough to find windows")]
    let seconds = since as f64 / 1e9;
    Ok(seconds)
}

/// Measures recordings beside the event loop, those of one request at a time.
async fn measure(
    state: &ApiState,
    handle: &MachineHandle,
    names: Vec<String>,
) -> Result<Vec<Measured>, ApiError> {
    let (measure, machine) = (Arc::clone(&desk(state)?.measure), handle.machine());
    let permit = Arc::clone(&state.learning).try_acquire_owned().map_err(|_| {
        ApiError::Conflict(
            "a baseline is being learned of other recordings: try again when it is there"
                .to_owned(),
        )
    })?;
    let work = move || {
        // Held until the work is done, even when the client has gone.
        let _permit = permit;
        let measured = names.iter().map(|name| measure(&machine, name));
        measured.collect::<Result<_, String>>().map_err(ApiError::Invalid)
    };
    files::beside(work).await?
}

fn desk(state: &ApiState) -> Result<&BaselineHandle, ApiError> {
    let none = || ApiError::NotFound("this daemon keeps no baselines".to_owned());
    state.baselines.as_ref().ok_or_else(none)
}

fn unknown(machine: &str, id: &str) -> ApiError {
    let id: String = id.chars().take(100).collect();
    ApiError::NotFound(format!(
        "no baseline {id:?} of machine {machine:?}; GET …/baselines lists them"
    ))
}

/// Works on the store beside the event loop. What was begun is ended, even when who asked has gone.
async fn on_store<T: Send + 'static>(
    state: &ApiState,
    work: impl FnOnce(&dyn BaselineStore) -> T + Send + 'static,
) -> Result<T, ApiError> {
    let store = Arc::clone(&desk(state)?.store);
    let done = tokio::task::spawn_blocking(move || work(&*store)).await;
    done.map_err(|error| {
        tracing::error!(%error, "working on the store panicked");
        ApiError::Internal
    })
}

async fn held(state: &ApiState, machine: &str) -> Result<Vec<Held>, ApiError> {
    let machine = machine.to_owned();
    Ok(on_store(state, move |store| store.baselines(&machine)).await??)
}

impl From<KeepError> for ApiError {
    /// A store that refuses is told, not only logged.
    fn from(error: KeepError) -> Self {
        match error {
            KeepError::Store(error) => {
                tracing::error!(%error, "a baseline cannot be stored");
                Self::StoreRefused(error.to_string())
            }
            KeepError::TooMany { .. } | KeepError::NotIntact { .. } => {
                Self::Conflict(error.to_string())
            }
            KeepError::Unknown { machine, id } => unknown(&machine, &id),
        }
    }
}

/// Has the shard use what is active now; a busy one is told again soon.
async fn hand_out(state: &ApiState, handle: &MachineHandle) -> Result<(), ApiError> {
    let machine = handle.id.clone();
    let records = on_store(state, move |store| active_records(store, &machine)).await??;
    let told = state.ask(handle, |reply| ShardRequest::UseBaselines { records, reply }).await;
    if told.is_err() {
        tracing::warn!(machine = handle.id, "the shard takes the baselines later");
    }
    Ok(())
}
