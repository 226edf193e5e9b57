//! Answers that a client holds already are not sent again: `ETag` and `If-None-Match`, by content.
//!
//! For what is asked for again and again and changes with a verdict only (health, diagnosis, spectra), and for the
//! page, which changes with the program only.

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

/// Last parts of the paths that have a tag.
const PATHS: [&str; 3] = ["/health", "/diagnosis", "/spectrum"];

/// Longest body that is looked at, bytes.
const MAX_BYTES: usize = 4 << 20;

/// Whether answers of a path have a tag: the page, and what changes with a verdict only.
fn is_tagged(path: &str) -> bool {
    path == "/" || path.starts_with("/dashboard/") || PATHS.iter().any(|end| path.ends_with(end))
}

/// Tags an answer, or says that the client holds it.
pub(super) async fn conditional(request: Request, next: Next) -> Response {
    if request.method() != Method::GET || !is_tagged(request.uri().path()) {
        return next.run(request).await;
    }
    let held = request.headers().get(header::IF_NONE_MATCH).cloned();
    let response = next.run(request).await;
    let is_whole = response.body().size_hint().exact().is_some_and(|n| n <= MAX_BYTES as u64);
    if response.status() != StatusCode::OK || !is_whole {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let Ok(bytes) = to_bytes(body, MAX_BYTES).await else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let digest: String =
        Sha256::digest(&bytes).iter().take(16).map(|b| format!("{b:02x}")).collect();
    // Weak: the same content may be sent compressed or not.
    let tag = format!("W/\"{digest}\"");
    let is_held = held.as_ref().and_then(|held| held.to_str().ok()).is_some_and(|held| {
        held.split(',')
            .map(str::trim)
            .any(|one| one == "*" || one.trim_start_matches("W/") == &tag[2..])
    });
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        parts.headers.insert(header::ETAG, tag);
    }
    // It may be held by who asked, and is asked for again each time.
    let private = const { HeaderValue::from_static("private, no-cache") };
    parts.headers.insert(header::CACHE_CONTROL, private);
    if is_held {
        parts.status = StatusCode::NOT_MODIFIED;
        for name in [header::CONTENT_LENGTH, header::CONTENT_TYPE] {
            parts.headers.remove(name);
        }
        return Response::from_parts(parts, Body::empty());
    }
    Response::from_parts(parts, Body::from(bytes))
}
