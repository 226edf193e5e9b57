//! Recordings: what was received and kept without a cause, file by file, for download and to learn baselines from.

use super::error::ApiError;
use super::extract::{Path, Query, State, cut_page, page_limit};
use super::files;
use super::state::ApiState;
use super::wire::problem::ProblemWire;
use super::wire::recordings::{RecordedFileWire, RecordedListWire};
use crate::capture::recording::store::{self, Recorded};
use axum::Json;
use axum::extract::Request;
use axum::response::Response;
use serde::Deserialize;
use std::path::PathBuf;
use utoipa::IntoParams;

/// Which recordings.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// Lists the recordings of a machine that are in the store, of earlier runs too.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/recordings",
    tag = "captures",
    params(("id" = String, Path, description = "Machine id"), ListQuery),
    responses(
        (status = OK, body = RecordedListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Query(query): Query<ListQuery>,
) -> Result<Json<RecordedListWire>, ApiError> {
    state.machine(&id)?;
    let limit = page_limit(query.limit)?;
    let growing = growing(&state, &id)?;
    let root = root(&state)?;
    let mut found = files::beside(move || store::recorded(&root, &id)).await?.map_err(|error| {
        ApiError::StoreRefused(format!("the folder of recordings cannot be read: {error}"))
    })?;
    if let Some(after) = &query.after {
        found.retain(|file| (file.name.len(), &file.name) < (after.len(), after));
    }
    found.truncate(limit + 1);
    let next = cut_page(&mut found, limit, |file| file.name.clone());
    let wire = |file: &Recorded| RecordedFileWire::new(file, growing.as_ref() == Some(&file.name));
    Ok(Json(RecordedListWire { items: found.iter().map(wire).collect(), next }))
}

/// Gives a recording as a file; parts of it by `Range`.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/recordings/{file}",
    tag = "captures",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("file" = String, Path, description = "Name of the recording"),
    ),
    responses(
        (status = OK, description = "HDF5 (docs/hdf5.md), as an attachment", body = Vec<u8>,
         content_type = "application/x-hdf5"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "It is still being written"),
    )
)]
pub(super) async fn download(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    request: Request,
) -> Result<Response, ApiError> {
    state.machine(&id)?;
    let shown: String = name.chars().take(100).collect();
    if growing(&state, &id)?.as_ref() == Some(&name) {
        return Err(ApiError::Conflict(format!(
            "recording {shown} is being written; it is complete after recording.segment_seconds"
        )));
    }
    let unknown = || {
        ApiError::NotFound(format!(
            "no recording {shown:?} of machine {id:?}; GET /api/v1/machines/{id}/recordings lists them"
        ))
    };
    let file = store::recording(&root(&state)?, &id, &name).ok_or_else(unknown)?;
    files::attachment(file, &name, request).await.ok_or_else(unknown)
}

fn root(state: &ApiState) -> Result<PathBuf, ApiError> {
    let none = || ApiError::NotFound("this daemon has no store for recordings".to_owned());
    state.recordings.clone().ok_or_else(none)
}

/// Name of the machine's file being written.
fn growing(state: &ApiState, id: &str) -> Result<Option<String>, ApiError> {
    let view = state.machine(id)?.recording.as_ref();
    Ok(view.and_then(|view| view.borrow().file.clone()))
}
