//! What stands around every route: problem bodies, security headers, host check, limits.

use super::error::ApiError;
use super::state::{ApiState, Settings};
use super::wire::problem::ProblemWire;
use axum::Json;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::any::Any;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tower_http::cors::CorsLayer;

/// How long a browser may keep what it was told of other origins.
const CORS_MAX_AGE: Duration = Duration::from_secs(600);

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
pub(super) async fn host(
    State(state): State<Arc<ApiState>>,
    request: Request,
    next: Next,
) -> Response {
    let named = request
        .headers()
        .get(header::HOST)
        .map(|host| String::from_utf8_lossy(host.as_bytes()).into_owned())
        .or_else(|| request.uri().authority().map(ToString::to_string))
        .unwrap_or_default();
    let settings = &state.settings;
    if is_this_server(&named, settings) {
        return next.run(request).await;
    }
    ApiError::ForeignHost(named.chars().take(100).collect()).into_response()
}

/// Whether `host` is a name or address of this server, with the bound port: loopback, the bound address, a configured
/// name. Where all addresses are bound, every address is one: only names can be made to point here by others.
pub(super) fn is_this_server(host: &str, settings: &Settings) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    if host.contains('@') {
        return false;
    }
    let default = if settings.is_encrypted { 443 } else { 80 };
    let (name, port) = (authority.host(), authority.port_u16().unwrap_or(default));
    let is_configured = |known: &String| match known.parse::<Authority>() {
        Ok(known) => {
            known.host().eq_ignore_ascii_case(name) && known.port_u16().is_none_or(|of| of == port)
        }
        Err(_) => false,
    };
    if settings.hosts.iter().any(is_configured) {
        return true;
    }
    let bound = settings.bound;
    if port != bound.port() {
        return false;
    }
    let literal = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
    match literal.parse::<IpAddr>() {
        Ok(address) => {
            address.is_loopback() || address == bound.ip() || bound.ip().is_unspecified()
        }
        Err(_) => name.eq_ignore_ascii_case("localhost"),
    }
}

/// Refuses what pages of other servers want done: a browser says which page it is.
pub(super) async fn origin(
    State(state): State<Arc<ApiState>>,
    request: Request,
    next: Next,
) -> Response {
    let is_read = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if is_read || is_own_page(request.headers(), &state.settings) {
        return next.run(request).await;
    }
    let why = "a page of another server must not change anything here; server.cors_origins names those that may";
    ApiError::ForeignOrigin(why.to_owned()).into_response()
}

/// Whether a request is none of a page of another server.
pub(super) fn is_own_page(headers: &HeaderMap, settings: &Settings) -> bool {
    let text = |value: &HeaderValue| String::from_utf8_lossy(value.as_bytes()).into_owned();
    if let Some(origin) = headers.get(header::ORIGIN).map(text) {
        // Behind a proxy that encrypts, pages are https and the daemon is not.
        let plain = origin.strip_prefix("http://").filter(|_| !settings.is_encrypted);
        let host = origin.strip_prefix("https://").or(plain).unwrap_or_default();
        return is_this_server(host, settings)
            || settings.cors_origins.iter().any(|known| known.eq_ignore_ascii_case(&origin));
    }
    let site = headers.get("sec-fetch-site").map(text);
    site.is_none_or(|site| matches!(site.as_str(), "same-origin" | "none"))
}

/// Lets pages of configured origins ask, too; `None`: there are none.
pub(super) fn cors(settings: &Settings) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> =
        settings.cors_origins.iter().filter_map(|origin| origin.parse().ok()).collect();
    let asked = [
        header::AUTHORIZATION,
        header::CONTENT_TYPE,
        const { HeaderName::from_static("last-event-id") },
    ];
    let told = [header::ETAG, header::CONTENT_DISPOSITION, header::RETRY_AFTER];
    (!origins.is_empty()).then(|| {
        CorsLayer::new()
            .allow_origin(origins)
            .allow_methods([Method::GET, Method::POST, Method::DELETE])
            .allow_headers(asked)
            .expose_headers(told)
            .max_age(CORS_MAX_AGE)
    })
}

/// Refuses a request when as many as allowed are being answered.
pub(super) async fn concurrency(
    State(state): State<Arc<ApiState>>,
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
        let bound = Settings::new("127.0.0.1:8080".parse().unwrap());
        for host in ["localhost:8080", "LOCALHOST:8080", "127.0.0.1:8080", "127.9.9.9:8080"] {
            assert!(is_this_server(host, &bound), "{host}");
        }
        assert!(is_this_server("[::1]:8080", &bound));
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
            assert!(!is_this_server(host, &bound), "{host}");
        }
        let lan = Settings::new("192.168.1.5:80".parse().unwrap());
        assert!(is_this_server("192.168.1.5", &lan) && is_this_server("localhost", &lan));
        assert!(!is_this_server("192.168.1.6", &lan));
    }

    #[test]
    fn configured_names_and_where_all_are_bound_every_address_are_this_server() {
        let hosts = vec!["monitor.example.org".to_owned(), "gate:9000".to_owned()];
        let all = Settings { hosts, ..Settings::new("0.0.0.0:8080".parse().unwrap()) };
        for host in [
            "monitor.example.org",
            "MONITOR.example.org:8443",
            "gate:9000",
            "10.1.2.3:8080",
            "[fe80::1]:8080",
            "localhost:8080",
        ] {
            assert!(is_this_server(host, &all), "{host}");
        }
        for host in
            ["gate:8080", "gate", "10.1.2.3:81", "evil.example:8080", "x.monitor.example.org"]
        {
            assert!(!is_this_server(host, &all), "{host}");
        }
        let encrypted =
            Settings { is_encrypted: true, ..Settings::new("10.0.0.1:443".parse().unwrap()) };
        assert!(
            is_this_server("10.0.0.1", &encrypted) && !is_this_server("10.0.0.1:80", &encrypted)
        );
    }

    #[test]
    fn a_page_is_own_by_what_its_browser_says() {
        let hosts = vec!["monitor.example.org".to_owned()];
        let cors_origins = vec!["https://dash.example.org".to_owned()];
        let bound = "127.0.0.1:8080".parse().unwrap();
        let settings = Settings { hosts, cors_origins, ..Settings::new(bound) };
        let own = |name: &'static str, value: &'static str| {
            let headers = HeaderMap::from_iter([(
                HeaderName::from_static(name),
                HeaderValue::from_static(value),
            )]);
            is_own_page(&headers, &settings)
        };
        assert!(is_own_page(&HeaderMap::new(), &settings), "no browser");
        for origin in [
            "http://127.0.0.1:8080",
            "http://localhost:8080",
            "https://monitor.example.org",
            "https://dash.example.org",
        ] {
            assert!(own("origin", origin), "{origin}");
        }
        for origin in [
            "null",
            "",
            "http://evil.example",
            "http://localhost:3000",
            "file://",
            "http://dash.example.org",
        ] {
            assert!(!own("origin", origin), "{origin}");
        }
        assert!(own("sec-fetch-site", "same-origin") && own("sec-fetch-site", "none"));
        assert!(!own("sec-fetch-site", "cross-site") && !own("sec-fetch-site", "same-site"));
    }
}
