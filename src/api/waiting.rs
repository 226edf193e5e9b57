//! Answers that wait for their readers: how much memory they may hold all together.
//!
//! A connection may be as slow as it likes (`app::connection` cuts it when it takes nothing), and its answer waits that long. Answers in
//! pieces (files, streams of events) hold a piece each and are not counted.

use super::error::ApiError;
use super::state::ApiState;
use axum::body::{Body, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use std::sync::Arc;

/// Most that answers may hold while they wait, KiB: 64 MiB, a hundred seconds of eight channels at 10 kHz as text.
pub(super) const MAX_WAITING_KIB: usize = 64 * 1024;

/// Answers up to this size are free, bytes: as many as there may be connections hold less than those that count.
const FREE_BYTES: u64 = 64 * 1024;

/// Holds a place for what an answer takes until it has been read or given up, and refuses it when there is none.
pub(super) async fn waiting(
    State(state): State<Arc<ApiState>>,
    request: Request,
    next: Next,
) -> Response {
    let response = next.run(request).await;
    let Some(size) = response.body().size_hint().exact().filter(|size| *size > FREE_BYTES) else {
        return response;
    };
    // One that is larger than everything waits alone.
    let wanted = size.div_ceil(1024).min(MAX_WAITING_KIB as u64);
    let Ok(wanted) = u32::try_from(wanted) else { return busy() };
    let Ok(place) = Arc::clone(&state.waiting).try_acquire_many_owned(wanted) else {
        return busy();
    };
    let (mut parts, body) = response.into_parts();
    parts.headers.insert(header::CONTENT_LENGTH, HeaderValue::from(size));
    let held = body.into_data_stream().map(move |piece| {
        let _held = &place;
        piece
    });
    Response::from_parts(parts, Body::from_stream(held))
}

fn busy() -> Response {
    ApiError::Busy("the answers that wait for their readers hold all the memory they may")
        .into_response()
}
