//! Silences in advance over HTTP.

use crate::api::support::Service;
use axum::http::Request;
use serde_json::json;

const PATH: &str = "/api/v1/machines/rig-1/silences";

#[tokio::test]
async fn a_silence_in_advance_is_said_listed_and_ended() {
    let service = Service::new();
    let body = json!({
        "author": "M. Ito", "comment": "painted", "silence": "out_of_service", "kind": "bearing",
        "component": "right", "for_s": 60.0
    });
    let answer = service.post(PATH, body.to_string()).await;
    assert_eq!(answer.status, 201);
    let said = answer.json();
    assert_eq!((&said["number"], &said["silence"]), (&json!(1), &json!("out_of_service")));
    assert_eq!((&said["kind"], &said["limit"]), (&json!("bearing"), &json!(null)));
    assert_eq!(said["until"], "1970-01-01T00:01:00Z", "the test's clock stands at 0");
    // What stands is silent at once.
    let events = service.get("/api/v1/alarms/history?limit=1").await.json();
    assert_eq!(events["items"][0]["event"], "removed_from_service");
    let detail = service.post(PATH, body.to_string()).await.problem(409);
    assert!(detail.contains("end silence 1 first"), "{detail}");
    let end = |path: &str| Request::delete(format!("{PATH}/{path}"));
    service.send(end("1?author=%20")).await.problem(400);
    service.send(end("7?author=a")).await.problem(404);
    assert_eq!(service.send(end("1?author=a&comment=dry")).await.status, 204);
    service.send(end("1?author=a")).await.problem(404);
    let list = service.get(PATH).await.json();
    assert_eq!(list["items"], json!([]), "the snapshot of before");
    service.get("/api/v1/machines/rig-2/silences").await.problem(404);
}

#[tokio::test]
async fn what_is_asked_for_badly_is_refused() {
    let service = Service::new();
    for (change, part) in [
        (json!({ "silence": "shelved" }), "silence must be"),
        (json!({ "silence": "acknowledged" }), "silence must be"),
        (json!({ "channel": "right_x" }), "say one of"),
        (json!({ "component": null }), "say one of"),
        (json!({ "for_s": 0.0 }), "later than now"),
        (json!({ "author": "" }), "must not be empty"),
        (json!({ "extra": 1 }), "unknown field `extra`"),
    ] {
        let mut body = json!({
            "author": "a", "silence": "suppressed", "kind": "bearing", "component": "right"
        });
        for (key, value) in change.as_object().unwrap() {
            body[key] = value.clone();
        }
        let detail = service.post(PATH, body.to_string()).await.problem(400);
        assert!(detail.contains(part), "{body}: {detail}");
    }
    let unknown = json!({ "author": "a", "silence": "suppressed", "limit": "none" });
    let detail = service.post(PATH, unknown.to_string()).await.problem(404);
    assert!(detail.contains("limit none"), "{detail}");
}
