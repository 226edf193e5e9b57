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
pub(super) async fn attachment(file: PathBuf, name: &str, request: Request) -> Option<Response> {
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
