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

/// Tag of an answer's content, beside an answer that is given again and again: it is not made anew each time. Weak: the
/// same content may be sent compressed or not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tag(HeaderValue);

impl Tag {
    /// The first half of the content's SHA-256.
    pub(super) fn of(content: &[u8]) -> Self {
        let digest = Sha256::digest(content);
        let digest: String = digest.iter().take(16).map(|b| format!("{b:02x}")).collect();
        // Digits and quotes are a header's value.
        let value = HeaderValue::from_str(&format!("W/\"{digest}\""));
        Self(value.unwrap_or(const { HeaderValue::from_static("W/\"\"") }))
    }

    /// Whether a client says that it holds this.
    fn is_held(&self, said: &HeaderValue) -> bool {
        let bare = |one: &str| one.trim_start_matches("W/").to_owned();
        let (Ok(said), Ok(own)) = (said.to_str(), self.0.to_str()) else { return false };
        said.split(',').map(str::trim).any(|one| one == "*" || bare(one) == bare(own))
    }
}

/// Whether answers of a path have a tag: the page, and what changes with a verdict only.
fn is_tagged(path: &str) -> bool {
    path == "/" || path.starts_with("/dashboard/") || PATHS.iter().any(|end| path.ends_with(end))
}

/// Tags an answer, or says that the client holds it.
pub(super) async fn conditional(request: Request, next: Next) -> Response {
    // The head of an answer is that of the whole.
    let is_read = [Method::GET, Method::HEAD].contains(request.method());
    if !is_read || !is_tagged(request.uri().path()) {
        return next.run(request).await;
    }
    let held = request.headers().get(header::IF_NONE_MATCH).cloned();
    let response = next.run(request).await;
    let is_whole = response.body().size_hint().exact().is_some_and(|n| n <= MAX_BYTES as u64);
    if response.status() != StatusCode::OK || !is_whole {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let (tag, body) = match parts.extensions.remove::<Tag>() {
        Some(tag) => (tag, body),
        None => match to_bytes(body, MAX_BYTES).await {
            Ok(bytes) => (Tag::of(&bytes), Body::from(bytes)),
            Err(_) => return StatusCode::INTERNAL_SERVER_ERROR.into_response(),
        },
    };
    let is_held = held.is_some_and(|held| tag.is_held(&held));
    parts.headers.insert(header::ETAG, tag.0);
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
    Response::from_parts(parts, body)
}
