//! What stands around every route: problem bodies, security headers, host check, limits.

use super::error::ApiError;
use super::state::ApiState;
use super::wire::problem::ProblemWire;
use axum::Json;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::any::Any;
use std::net::{IpAddr, SocketAddr};

/// Headers of every answer: nothing from elsewhere is loaded, sniffed, framed or told.
const SECURITY_HEADERS: [(HeaderName, HeaderValue); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        HeaderValue::from_static(
            "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
             img-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
        ),
    ),
    (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
    (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        HeaderValue::from_static("same-origin"),
    ),
];

/// Adds the security headers, and forbids keeping answers that do not say otherwise.
pub(super) async fn headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.extend(SECURITY_HEADERS);
    headers.entry(header::CACHE_CONTROL).or_insert(const { HeaderValue::from_static("no-store") });
    response
}

/// Writes a problem+json body into every answer from status 400.
pub(super) async fn problems(request: Request, next: Next) -> Response {
    let instance = request.uri().path().to_owned();
    let response = next.run(request).await;
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let (mut parts, _) = response.into_parts();
    let error = parts.extensions.remove().unwrap_or_else(|| ApiError::of_status(status));
    let (kind, title) = error.kind();
    let body = Json(ProblemWire {
        kind: format!("urn:rotorwatch:problem:{kind}"),
        title: title.to_owned(),
        status: status.as_u16(),
        detail: error.to_string(),
        instance,
        errors: error.errors().to_vec(),
    });
    parts.headers.remove(header::CONTENT_LENGTH);
    let mut response = (status, body).into_response();
    for (name, value) in &parts.headers {
        if name != header::CONTENT_TYPE {
            response.headers_mut().append(name, value.clone());
        }
    }
    let problem_json = const { HeaderValue::from_static("application/problem+json") };
    response.headers_mut().insert(header::CONTENT_TYPE, problem_json);
    if status == StatusCode::SERVICE_UNAVAILABLE {
        let one_second = const { HeaderValue::from_static("1") };
        response.headers_mut().insert(header::RETRY_AFTER, one_second);
    }
    response
}

/// Refuses requests whose host is not this server: a page elsewhere that points its own name here
/// (DNS rebinding) must not read machines.
pub(super) async fn host(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    let bound = state.settings.bound;
    let named = request
        .headers()
        .get(header::HOST)
        .map(|host| String::from_utf8_lossy(host.as_bytes()).into_owned())
        .or_else(|| request.uri().authority().map(ToString::to_string))
        .unwrap_or_default();
    if is_this_server(&named, bound) {
        return next.run(request).await;
    }
    let port = bound.port();
    let allowed = format!("localhost:{port}, 127.0.0.1:{port}, [::1]:{port}, {bound}");
    ApiError::ForeignHost { host: named.chars().take(100).collect(), allowed }.into_response()
}

/// Whether `host` is a loopback name or address, or the bound address, with the bound port.
pub(super) fn is_this_server(host: &str, bound: SocketAddr) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    if host.contains('@') || authority.port_u16().unwrap_or(80) != bound.port() {
        return false;
    }
    let name = authority.host();
    let literal = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
    match literal.parse::<IpAddr>() {
        Ok(address) => address.is_loopback() || address == bound.ip(),
        Err(_) => name.eq_ignore_ascii_case("localhost"),
    }
}

/// Refuses a request when as many as allowed are being answered.
pub(super) async fn concurrency(
    State(state): State<ApiState>,
    request: Request,
    next: Next,
) -> Response {
    match state.requests.try_acquire() {
        Ok(_permit) => next.run(request).await,
        Err(_) => ApiError::Busy("too many requests are being answered").into_response(),
    }
}

/// Answers 500 for a request whose handler panicked; the rest goes on.
pub(super) fn panicked(cause: Box<dyn Any + Send + 'static>) -> Response {
    let cause = cause
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| cause.downcast_ref::<&'static str>().copied())
        .unwrap_or("unknown");
    tracing::error!(cause, "request handler panicked");
    StatusCode::INTERNAL_SERVER_ERROR.into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_and_the_bound_address_with_the_bound_port_are_this_server() {
        let bound: SocketAddr = "127.0.0.1:8080".parse().unwrap();
        for host in ["localhost:8080", "LOCALHOST:8080", "127.0.0.1:8080", "127.9.9.9:8080"] {
            assert!(is_this_server(host, bound), "{host}");
        }
        assert!(is_this_server("[::1]:8080", bound));
        for host in [
            "",
            "localhost",
            "localhost:80",
            "localhost:80800",
            "evil.example:8080",
            "localhost.evil.example:8080",
            "evil.example@localhost:8080",
            "192.168.1.5:8080",
            "0.0.0.0:8080",
            "[::2]:8080",
            "a b:8080",
        ] {
            assert!(!is_this_server(host, bound), "{host}");
        }
        let lan: SocketAddr = "192.168.1.5:80".parse().unwrap();
        assert!(is_this_server("192.168.1.5", lan) && is_this_server("localhost", lan));
        assert!(!is_this_server("192.168.1.6", lan));
    }
}
