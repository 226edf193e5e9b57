//! Alarm list, paging, acknowledgement, history.

use crate::alarms::{AlarmEngine, Settings};
use crate::api::support::{Service, sample_diagnosis, sample_view};
use crate::diagnosis::fault::State;
use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};
use std::sync::Arc;

const ACK: &str = r#"{ "author": "M. Ito", "comment": "bearing ordered" }"#;

fn ids(list: &Value) -> Vec<String> {
    let items = list["items"].as_array().unwrap();
    items.iter().map(|item| item["id"].as_str().unwrap().to_owned()).collect()
}

/// A service whose snapshot shows five alarms: damaged on `b0`, warning on `b1`…`b4`.
fn with_five_alarms() -> Service {
    let mut diagnosis = sample_diagnosis();
    let bearing = diagnosis.components[0].clone();
    diagnosis.components = (0..5)
        .map(|n| {
            let mut component = bearing.clone();
            component.id = format!("b{n}");
            component.state = if n == 0 { State::Damaged } else { State::Warning };
            component
        })
        .collect();
    let mut engine = AlarmEngine::new(Settings::default());
    engine.observe(&diagnosis, 10.0);
    engine.acknowledge(2, "a", "", 11.0).unwrap();
    let service = Service::new();
    service.view.send_replace(Arc::new(sample_view(&engine)));
    service
}

#[tokio::test]
async fn alarms_are_listed_with_the_shape_of_the_contract() {
    let list = Service::new().get("/api/v1/alarms").await.json();
    assert!(list["next"].is_null());
    let alarm = &list["items"][0];
    for (key, value) in [
        ("id", "rig-1:1"),
        ("machine", "rig-1"),
        ("component", "right"),
        ("kind", "bearing"),
        ("level", "damaged"),
        ("state", "unacknowledged"),
        ("fault", "inner_race"),
        ("raised_at", "2023-11-14T22:13:30Z"),
        ("why", "right is damaged"),
    ] {
        assert_eq!(alarm[key], value, "{key}");
    }
}

#[tokio::test]
async fn filters_choose() {
    let service = with_five_alarms();
    for (query, expected) in [
        ("", vec!["rig-1:5", "rig-1:4", "rig-1:3", "rig-1:2", "rig-1:1"]),
        ("?level=damaged", vec!["rig-1:1"]),
        ("?state=acknowledged", vec!["rig-1:2"]),
        ("?component=b3", vec!["rig-1:4"]),
        (
            "?machine=rig-1&level=warning&state=unacknowledged",
            vec!["rig-1:5", "rig-1:4", "rig-1:3"],
        ),
        ("?component=none", vec![]),
    ] {
        let list = service.get(&format!("/api/v1/alarms{query}")).await.json();
        assert_eq!(ids(&list), expected, "{query}");
    }
    let detail = service.get("/api/v1/alarms?machine=rig-2").await.problem(404);
    assert!(detail.contains("rig-1"));
    let detail = service.get("/api/v1/alarms?state=open").await.problem(400);
    assert!(detail.contains("`returned_unacknowledged`"), "{detail}");
}

#[tokio::test]
async fn pages_join_to_the_whole_list() {
    let service = with_five_alarms();
    let mut path = "/api/v1/alarms?limit=2".to_owned();
    let mut seen = Vec::new();
    for n_items in [2, 2, 1] {
        let page = service.get(&path).await.json();
        assert_eq!(ids(&page).len(), n_items);
        seen.extend(ids(&page));
        path = format!("/api/v1/alarms?limit=2&after={}", page["next"].as_str().unwrap_or("end"));
    }
    assert!(path.ends_with("end"), "the last page has no next");
    assert_eq!(seen, ["rig-1:5", "rig-1:4", "rig-1:3", "rig-1:2", "rig-1:1"]);
    service.get("/api/v1/alarms?limit=0").await.problem(400);
    service.get("/api/v1/alarms?limit=1001").await.problem(400);
    service.get("/api/v1/alarms?after=xyz").await.problem(400);
}

#[tokio::test]
async fn an_alarm_is_acknowledged_once() {
    let service = Service::new();
    let answer = service.post("/api/v1/alarms/rig-1:1/ack", ACK).await;
    assert_eq!(answer.status, 200);
    let alarm = answer.json();
    assert_eq!(alarm["state"], "acknowledged");
    let expected = json!({
        "author": "M. Ito", "comment": "bearing ordered", "time": "2023-11-14T22:13:32Z"
    });
    assert_eq!(alarm["acknowledgement"], expected);
    let detail = service.post("/api/v1/alarms/rig-1:1/ack", ACK).await.problem(409);
    assert!(detail.contains("M. Ito"), "{detail}");

    let history = service.get("/api/v1/alarms/history").await.json();
    let events: Vec<&Value> = history["items"].as_array().unwrap().iter().collect();
    assert_eq!(events.len(), 2);
    assert_eq!(
        (&events[0]["event"], &events[1]["event"]),
        (&json!("acknowledged"), &json!("raised"))
    );
    assert_eq!(history["dropped"], 0);
    let page = service.get("/api/v1/alarms/history?limit=1").await.json();
    let next = page["next"].as_str().unwrap();
    let page = service.get(&format!("/api/v1/alarms/history?after={next}")).await.json();
    assert_eq!(page["items"][0]["event"], "raised");
    assert!(page["next"].is_null());
}

#[tokio::test]
async fn one_alarm_is_shown_also_from_the_history() {
    let service = Service::new();
    assert_eq!(service.get("/api/v1/alarms/rig-1:1").await.json()["id"], "rig-1:1");
    service.view.send_modify(|view| Arc::make_mut(view).alarms = Arc::default());
    assert_eq!(service.get("/api/v1/alarms/rig-1:1").await.json()["component"], "right");
    service.get("/api/v1/alarms/rig-1:2").await.problem(404);
    service.get("/api/v1/alarms/rig-2:1").await.problem(404);
    service.get("/api/v1/alarms/1").await.problem(400);
}

#[tokio::test]
async fn bad_acknowledgements_are_refused() {
    let service = Service::new();
    let path = "/api/v1/alarms/rig-1:1/ack";
    for (body, part) in [
        ("", "EOF"),
        ("{", "EOF"),
        ("{}", "missing field `author`"),
        (r#"{ "author": "  " }"#, "must not be empty"),
        (r#"{ "author": 5 }"#, "author: invalid type"),
        (r#"{ "author": "a", "comment": "b", "extra": 1 }"#, "unknown field `extra`"),
    ] {
        let detail = service.post(path, body).await.problem(400);
        assert!(detail.contains(part), "{body}: {detail}");
    }
    let long = json!({ "author": "a", "comment": "x".repeat(2001) }).to_string();
    assert!(service.post(path, long).await.problem(400).contains("at most 2000"));
    let huge = json!({ "author": "a", "comment": "x".repeat(65_536) }).to_string();
    assert!(service.post(path, huge).await.problem(413).contains("65536"));
    service.post("/api/v1/alarms/rig-1:9/ack", ACK).await.problem(404);
    service.post("/api/v1/alarms/9/ack", ACK).await.problem(400);
    // A form another page could send without asking first is no JSON.
    for content_type in ["text/plain", "application/x-www-form-urlencoded"] {
        let request = Request::post(path).header("content-type", content_type);
        service.send_body(request, Body::from(ACK)).await.problem(415);
    }
    service.send_body(Request::post(path), Body::from(ACK)).await.problem(415);
    let alarm = service.get("/api/v1/alarms/rig-1:1").await.json();
    assert_eq!(alarm["state"], "unacknowledged", "none of them did anything");
}
