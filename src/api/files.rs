//! Files of the store as downloads.

use super::error::ApiError;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::path::PathBuf;
use tower::ServiceExt;
use tower_http::services::ServeFile;

/// What captures and recordings are.
pub(super) const CONTENT_TYPE: &str = "application/x-hdf5";

/// Answers with a file, or the part of it that is asked for by `Range`, to be saved as `name`; `None`: it is not there
/// any more.
pub(super) async fn attachment(
    file: PathBuf,
    name: &str,
    mut request: Request,
) -> Option<Response> {
    // What is no range of bytes is not looked at (RFC 9110, 14.2), nor are several.
    if let Some(asked) = request.headers_mut().remove(header::RANGE)
        && let Some(range) = one_range(&asked)
    {
        request.headers_mut().insert(header::RANGE, range);
    }
    let mut response = match ServeFile::new(file).oneshot(request).await {
        Ok(response) => response.map(Body::new).into_response(),
        Err(never) => match never {},
    };
    if response.status() == StatusCode::NOT_FOUND {
        return None;
    }
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, const { HeaderValue::from_static(CONTENT_TYPE) });
    if let Ok(named) = HeaderValue::from_str(&format!("attachment; filename=\"{}\"", plain(name))) {
        headers.insert(header::CONTENT_DISPOSITION, named);
    }
    Some(response)
}

/// A range of bytes as it is asked for; `None`: it is of another unit, wrong, or several.
fn one_range(asked: &HeaderValue) -> Option<HeaderValue> {
    let (unit, range) = asked.to_str().ok()?.split_once('=')?;
    let range = range.trim();
    let (first, last) = range.split_once('-')?;
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let number = |text: &str| text.parse::<u64>().ok();
    let is_right = match (first.is_empty(), last.is_empty()) {
        (true, true) => false,
        (true, false) => number(last).is_some(),
        (false, true) => number(first).is_some(),
        (false, false) => number(first)? <= number(last)?,
    };
    let is_range = unit.trim().eq_ignore_ascii_case("bytes")
        && is_number(first)
        && is_number(last)
        && is_right;
    is_range.then(|| HeaderValue::from_str(&format!("bytes={range}")).ok()).flatten()
}

/// A name that a header can hold.
fn plain(name: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.chars().map(safe).collect()
}

/// Reads from the disk beside the event loop.
pub(super) async fn beside<T: Send + 'static>(
    read: impl FnOnce() -> T + Send + 'static,
) -> Result<T, ApiError> {
    tokio::task::spawn_blocking(read).await.map_err(|error| {
        tracing::error!(%error, "reading files panicked");
        ApiError::Internal
    })
}
