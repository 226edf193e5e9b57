//! Whatever is sent: no fault of the server, no silence afterwards.

use crate::support::Daemon;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::thread;

/// Status of an HTTP answer; `None` when the daemon hung up instead.
fn status_of(answer: &[u8]) -> Option<u16> {
    let text = String::from_utf8_lossy(answer);
    text.strip_prefix("HTTP/1.1 ").or(text.strip_prefix("HTTP/1.0 "))?.get(..3)?.parse().ok()
}

/// Refused by hanging up or by any status but a fault of the server; 503 says "busy".
fn is_refusal(answer: &[u8]) -> bool {
    status_of(answer).is_none_or(|status| status < 500 || status == 503)
}

#[test]
fn rubbish_is_refused_and_the_daemon_answers_on() {
    let daemon = Daemon::start("", &[]);
    let host = daemon.base_url.strip_prefix("http://").unwrap();
    let long = "x".repeat(1 << 20);
    let mut rubbish: Vec<Vec<u8>> = [
        String::new(),
        "\r\n\r\n\r\n".to_owned(),
        format!("GET / HTTP/9.9\r\nHost: {host}\r\n\r\n"),
        format!("GET /{long} HTTP/1.1\r\nHost: {host}\r\n\r\n"),
        format!("GET /livez HTTP/1.1\r\nHost: {host}\r\nX-Long: {long}\r\n\r\n"),
        format!("GET /livez HTTP/1.1\r\nHost: {host}\r\n{}\r\n", "A: b\r\n".repeat(5000)),
        format!(
            "GET /%00%ff/../../etc/passwd HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        ),
        "GET /livez HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_owned(),
        "GET /livez HTTP/1.1\r\nConnection: close\r\n\r\n".to_owned(),
        format!(
            "POST /api/v1/alarms/a:1/ack HTTP/1.1\r\nHost: {host}\r\nContent-Length: -5\r\n\r\n"
        ),
        format!(
            "POST /api/v1/alarms/a:1/ack HTTP/1.1\r\nHost: {host}\r\n\
             Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\nfffffffffffff\r\n"
        ),
        format!("CONNECT {host} HTTP/1.1\r\nHost: {host}\r\n\r\n"),
        format!("GET {} HTTP/1.1\r\nHost: {host}\r\nUpgrade: h2c\r\n\r\n", "http://[::1"),
    ]
    .map(String::into_bytes)
    .to_vec();
    let mut random = Pcg64Mcg::seed_from_u64(7);
    for _ in 0..50 {
        let n = random.random_range(1..2000);
        rubbish.push((0..n).map(|_| random.random::<u8>()).collect());
    }
    for bytes in rubbish {
        let answer = daemon.send_raw(&bytes);
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(80)]).into_owned();
        assert!(is_refusal(&answer), "{shown}\n{}", String::from_utf8_lossy(&answer));
        assert_ne!(status_of(&answer), Some(200), "{shown}");
    }
    assert_eq!(daemon.get_text("/livez").0, 200);
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0));
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn bodies_are_read_up_to_a_limit_only() {
    let daemon = Daemon::start("", &[]);
    let host = daemon.base_url.strip_prefix("http://").unwrap();
    let head = "POST /api/v1/alarms/rig-1:1/ack HTTP/1.1\r\nContent-Type: application/json\r\n\
                Connection: close\r\n";
    let declared = format!("{head}Host: {host}\r\nContent-Length: 1000000000000\r\n\r\n");
    let mut sent = format!("{head}Host: {host}\r\nContent-Length: 8000000\r\n\r\n").into_bytes();
    sent.extend(vec![b'['; 8_000_000]);
    for request in [declared.into_bytes(), sent] {
        // Hung up on, or told so.
        let status = status_of(&daemon.send_raw(&request));
        assert!(status.is_none_or(|status| [400, 413].contains(&status)), "{status:?}");
    }
    assert_eq!(daemon.get_text("/livez").0, 200);
}

#[test]
fn unknown_paths_and_methods_are_problems_with_a_type() {
    let daemon = Daemon::start("", &[]);
    for path in ["/api/v1/nothing", "/api/v1/machines/none/health", "/api/v2/machines", "/x"] {
        let (status, problem) = daemon.get_json(path);
        assert_eq!((status, &problem["status"]), (404, &404.into()), "{path}: {problem}");
        assert_eq!(problem["type"], "urn:rotorwatch:problem:not-found", "{path}");
    }
    let (status, problem) = daemon.post_json("/livez", &serde_json::json!({}));
    assert_eq!((status, &problem["status"]), (405, &405.into()), "{problem}");
}

#[test]
fn two_hundred_requests_at_once_are_answered_or_told_to_wait() {
    let daemon = Daemon::start("", &[]);
    let paths = ["/livez", "/metrics", "/api/v1/machines", "/api/v1/openapi.json"];
    let statuses: Vec<u16> = thread::scope(|scope| {
        let daemon = &daemon;
        let asked: Vec<_> =
            (0..200).map(|i| scope.spawn(move || daemon.get_text(paths[i % 4]).0)).collect();
        asked.into_iter().map(|answer| answer.join().unwrap()).collect()
    });
    assert!(statuses.iter().all(|status| [200, 503].contains(status)), "{statuses:?}");
    assert!(statuses.contains(&200));
    assert_eq!(daemon.get_text("/livez").0, 200);
}
