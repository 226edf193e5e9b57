//! What stands around every route.

use crate::api::support::{Behaviour, LARGE, Service};
use axum::body::Body;
use axum::http::{Request, StatusCode};
use std::io::Read;
use std::sync::Arc;
use std::time::Duration;

#[tokio::test]
async fn unknown_paths_and_methods_are_problems() {
    let service = Service::new();
    for path in ["/nothing", "/api/v1/", "/api/v2/machines", "/api/v1/machines/"] {
        service.get(path).await.problem(404);
    }
    let answer = service.send(Request::delete("/api/v1/machines")).await;
    answer.problem(405);
    assert_eq!(answer.header("allow"), "GET,HEAD");
    assert_eq!(answer.json()["instance"], "/api/v1/machines");
    service.get("/api/v1/alarms/rig-1:1/ack").await.problem(405);
}

#[tokio::test]
async fn unknown_parameters_and_values_of_another_type_are_refused_everywhere() {
    let service = Service::new();
    let mut seen = 0;
    for (path, methods) in &crate::api::openapi().paths.paths {
        if methods.get.is_none() {
            continue;
        }
        if !path.starts_with("/api/") {
            // Probes add parameters of their own.
            let asked = service.get(&format!("{path}?verbose=1")).await.status;
            assert_eq!(asked, service.get(path).await.status, "{path}");
            continue;
        }
        let path = path.replace("{id}", "rig-1").replace("{name}", "right_x");
        let detail = service.get(&format!("{path}?foo=1")).await.problem(400);
        assert!(detail.starts_with("unknown parameter \"foo\""), "{path}: {detail}");
        seen += 1;
    }
    assert!(seen > 27, "{seen}");
    for (query, allowed) in [
        ("alarms?limit=x", "limit is \"x\", allowed are 1 to 1000"),
        ("alarms?limit=-1", "limit is \"-1\", allowed are 1 to 1000"),
        ("machines?components=1", "components is \"1\", allowed are true and false"),
        (
            "machines/rig-1/channels/right_x/waveform?end=1.5",
            "end is \"1.5\", allowed are whole numbers from 0 on",
        ),
        (
            "machines/rig-1/channels/right_x/cwt?window_s=a",
            "window_s is \"a\", allowed are 0.001 to 60",
        ),
        ("machines/rig-1/channels/right_x/cwt?min_hz=", "min_hz is \"\", allowed is a number"),
        ("system?a=1&b=2", "unknown parameter \"a\": this path takes none"),
    ] {
        assert_eq!(service.get(&format!("/api/v1/{query}")).await.problem(400), allowed);
    }
    let answer = service.send(Request::head("/api/v1/machines?foo=1")).await;
    assert_eq!(answer.status, 400);
    assert_eq!(service.get("/api/v1/machines?components=true").await.status, 200);
}

#[tokio::test]
async fn every_answer_has_the_security_headers() {
    let service = Service::new();
    for path in ["/", "/livez", "/api/v1/machines", "/nothing", "/panics"] {
        let answer = service.get(path).await;
        let policy = answer.header("content-security-policy");
        assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'self'"));
        assert!(!policy.contains("unsafe") && !policy.contains("http"));
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
        assert_eq!(answer.header("referrer-policy"), "no-referrer");
        // The page is tagged, and asked for again each time.
        let held = if path == "/" { "private, no-cache" } else { "no-store" };
        assert_eq!(answer.header("cache-control"), held);
        assert_eq!(answer.header("access-control-allow-origin"), "", "no CORS");
    }
}

#[tokio::test]
async fn foreign_hosts_are_refused_on_every_route() {
    let service = Service::with(Behaviour::Answers, |settings| {
        settings.hosts = vec!["monitor.example.org".to_owned()];
    });
    for path in ["/", "/livez", "/api/v1/machines", "/nothing"] {
        let request = Request::get(path).header("host", "evil.example:8080");
        let detail = service.send(request).await.problem(421);
        assert!(detail.contains("evil.example") && detail.contains("server.hosts"), "{detail}");
        assert!(!detail.contains("monitor"), "its names are not for strangers: {detail}");
    }
    let request = Request::get("/livez").header("host", "localhost:8080");
    assert_eq!(service.send(request).await.status, 200);
}

#[tokio::test]
async fn a_panic_is_a_problem_and_tells_nothing() {
    let service = Service::new();
    let detail = service.get("/panics").await.problem(500);
    assert!(!detail.contains("own fault"), "{detail}");
    assert_eq!(service.get("/livez").await.status, 200);
}

#[tokio::test]
async fn a_request_that_takes_too_long_is_a_problem() {
    let service =
        Service::with(Behaviour::Answers, |s| s.request_timeout = Duration::from_millis(10));
    let answer = service.get("/hangs").await;
    assert!(answer.problem(503).contains("in time"));
    assert_eq!(answer.header("retry-after"), "1");
}

#[tokio::test]
async fn more_requests_than_allowed_are_refused_but_liveness_answers() {
    let service = Service::with(Behaviour::Answers, |settings| settings.max_requests = 1);
    let held = service.state.requests.try_acquire().unwrap();
    let answer = service.get("/api/v1/machines").await;
    answer.problem(503);
    assert_eq!(answer.header("retry-after"), "1");
    service.get("/").await.problem(503);
    assert_eq!(service.get("/livez").await.status, 200);
    drop(held);
    assert_eq!(service.get("/api/v1/machines").await.status, 200);
}

#[tokio::test]
async fn long_answers_are_compressed_when_asked() {
    let service = Arc::new(Service::new());
    let path = "/api/v1/machines/rig-1/channels/right_x/spectrum";
    let plain = service.get(path).await;
    assert_eq!(plain.header("content-encoding"), "");
    let packed = service.send(Request::get(path).header("accept-encoding", "gzip")).await;
    assert_eq!(packed.header("content-encoding"), "gzip");
    assert!(packed.body.len() < plain.body.len() / 2);
    assert_eq!(packed.body.as_ref().bytes().next().unwrap().unwrap(), 0x1f, "gzip's first byte");
}

#[tokio::test]
async fn what_a_client_holds_is_not_sent_again() {
    let service = Service::new();
    for path in [
        "/",
        "/api/v1/machines/rig-1/health",
        "/api/v1/machines/rig-1/diagnosis",
        "/api/v1/machines/rig-1/channels/right_x/spectrum",
    ] {
        let whole = service.get(path).await;
        assert_eq!(
            (whole.status.as_u16(), whole.header("cache-control")),
            (200, "private, no-cache")
        );
        let tag = whole.header("etag").to_owned();
        assert!(tag.starts_with("W/\""), "{tag}");
        for held in [tag.clone(), format!("\"x\", {tag}"), tag[2..].to_owned(), "*".to_owned()] {
            let answer = service.send(Request::get(path).header("if-none-match", held)).await;
            assert_eq!((answer.status.as_u16(), answer.header("etag")), (304, tag.as_str()));
            assert!(answer.body.is_empty());
        }
        for (held, status) in [("\"x\"", 200), (tag.as_str(), 304)] {
            let head = service.send(Request::head(path).header("if-none-match", held)).await;
            assert_eq!(
                (head.status.as_u16(), head.header("etag")),
                (status, tag.as_str()),
                "{path}"
            );
            assert_eq!(head.header("cache-control"), "private, no-cache");
            assert!(head.body.is_empty());
        }
        let other = service.send(Request::get(path).header("if-none-match", "\"x\"")).await;
        assert_eq!((other.status.as_u16(), &other.body), (200, &whole.body));
    }
    let missing =
        service.send(Request::get("/api/v1/machines/rig-9/health").header("if-none-match", "*"));
    missing.await.problem(404);
}

#[tokio::test]
async fn answers_that_nobody_reads_hold_no_more_than_they_may() {
    let service = Service::new();
    let asked = || service.begin(Request::get("/large"), Body::empty());
    let first = asked().await;
    let second = asked().await;
    assert_eq!((first.status(), second.status()), (StatusCode::OK, StatusCode::OK));
    let refused = service.get("/large").await;
    assert!(refused.problem(503).contains("wait for their readers"));
    assert_eq!(refused.header("retry-after"), "1");
    assert_eq!(service.get("/api/v1/machines").await.status, 200, "small ones are free");
    // What has been given up, or read, makes room again.
    drop(first);
    for _ in 0..3 {
        let answer = service.get("/large").await;
        assert_eq!((answer.status.as_u16(), answer.body.len()), (200, LARGE));
        assert_eq!(answer.header("content-length"), LARGE.to_string());
    }
    drop(second);
}
