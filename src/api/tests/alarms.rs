//! Alarm list, paging, acknowledgement, history.

use crate::alarms::{Act, Action, AlarmEngine, Kept, Moment, Settings};
use crate::api::handles::StoreHandle;
use crate::api::support::{Behaviour, Service, sample_diagnosis, sample_view};
use crate::diagnosis::fault::State;
use crate::store::writer::Status;
use crate::store::{Batch, StateStore, StreamKey, sqlite};
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
    let mut engine = AlarmEngine::new("rig-1", Settings::default());
    engine.observe(&diagnosis, 10.0);
    let (author, comment) = ("a".to_owned(), String::new());
    let act = Act { alarm: 2, action: Action::Acknowledge, author, comment };
    engine.act(&act, Moment::of_stream(11.0)).unwrap();
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
        ("{}", "must not be empty"),
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

#[tokio::test]
async fn an_alarm_is_silenced_and_its_transitions_and_actions_are_shown() {
    let service = Service::new();
    let path = |act: &str| format!("/api/v1/alarms/rig-1:1/{act}");
    let shelve = json!({ "author": "M. Ito", "comment": "shift", "for_s": 60.0 }).to_string();
    let alarm = service.post(&path("shelve"), shelve.clone()).await.json();
    assert_eq!((&alarm["state"], &alarm["active"]), (&json!("shelved"), &json!(true)));
    assert_eq!(alarm["silenced"]["author"], "M. Ito");
    assert_eq!(alarm["silenced"]["until"], "1970-01-01T00:01:00Z", "the test's clock stands at 0");
    for (body, part) in [
        (json!({ "author": "a" }), "missing field `for_s`"),
        (json!({ "author": "a", "for_s": 0.0 }), "at most 86400 s"),
        (json!({ "author": "a", "for_s": 1e9 }), "at most 86400 s"),
        (json!({ "author": "", "for_s": 1.0 }), "must not be empty"),
    ] {
        let detail = service.post(&path("shelve"), body.to_string()).await.problem(400);
        assert!(detail.contains(part), "{body}: {detail}");
    }
    for (act, state) in [
        ("suppress", "suppressed"),
        ("out-of-service", "out_of_service"),
        ("return", "unacknowledged"),
        ("ack", "acknowledged"),
    ] {
        let answer = service.post(&path(act), ACK).await;
        assert_eq!(
            (answer.status.as_u16(), &answer.json()["state"]),
            (200, &json!(state)),
            "{act}"
        );
    }
    for (act, part) in [
        ("unshelve", "is not shelved"),
        ("unsuppress", "is not suppressed"),
        ("return", "is not out of service"),
        ("reset", "condition is present"),
    ] {
        let detail = service.post(&path(act), ACK).await.problem(409);
        assert!(detail.contains(part), "{act}: {detail}");
    }
    let shown = service.get("/api/v1/alarms/rig-1:1").await.json();
    let names = |key: &str, of: &str| -> Vec<String> {
        let items = shown[key].as_array().unwrap();
        items.iter().map(|item| item[of].as_str().unwrap().to_owned()).collect()
    };
    let acts =
        ["acknowledged", "returned_to_service", "removed_from_service", "suppressed", "shelved"];
    assert_eq!(names("actions", "event"), acts);
    assert_eq!(names("actions", "comment")[4], "shift");
    assert_eq!(names("transitions", "event"), [&acts[..], &["raised"]].concat());
    assert_eq!(names("transitions", "state")[0], "acknowledged");
}

#[tokio::test]
async fn what_changed_since_a_time_is_chosen() {
    let service = with_five_alarms();
    // Raised at 10 s of a stream that began at 22:13:20, the second acknowledged at 11 s.
    for (since, expected) in [
        ("2023-11-14T22:13:30Z", vec!["rig-1:5", "rig-1:4", "rig-1:3", "rig-1:2", "rig-1:1"]),
        ("2023-11-14T22:13:30.5Z", vec!["rig-1:2"]),
        ("2023-11-14T23:13:31%2B01:00", vec!["rig-1:2"]),
        ("2023-11-14T22:13:32Z", vec![]),
    ] {
        let list = service.get(&format!("/api/v1/alarms?since={since}")).await.json();
        assert_eq!(ids(&list), expected, "{since}");
    }
    let detail = service.get("/api/v1/alarms?since=yesterday").await.problem(400);
    assert!(detail.contains("2026-05-04T12:00:00Z"), "{detail}");
    let events = service.get("/api/v1/alarms/history?since=2023-11-14T22:13:31Z").await.json();
    assert_eq!(
        events["items"].as_array().unwrap().len(),
        0,
        "the shard's own history ends at 10 s"
    );
}

#[tokio::test]
async fn the_load_is_shown_by_machine_and_as_a_whole() {
    let load = with_five_alarms().get("/api/v1/alarms/load").await.json();
    assert_eq!((&load["last_hour"], &load["flood"]), (&json!(5), &json!(false)));
    assert_eq!(load["machines"][0]["machine"], "rig-1");
    assert_eq!(load["machines"][0]["first_out"], "rig-1:1");
}

#[tokio::test]
async fn older_events_come_from_the_store_as_one_history() {
    let folder = tempfile::tempdir().unwrap();
    let (mut store, archive) = sqlite::open(folder.path()).unwrap();
    // Twelve events, of which the first seven are in the store only.
    let mut before = AlarmEngine::new("rig-1", Settings::default());
    before.observe(&sample_diagnosis(), 10.0);
    for n in 0..11 {
        let action = if n % 2 == 0 { Action::Shelve { for_s: 60.0 } } else { Action::Unshelve };
        let (author, comment) = ("a".to_owned(), format!("act {n}"));
        let act = Act { alarm: 1, action, author, comment };
        before.act(&act, Moment::of_stream(20.0 + f64::from(n))).unwrap();
    }
    let events: Vec<_> = before.history().iter().cloned().collect();
    let start = sample_view(&before).start_time;
    let stream = StreamKey { start, ..StreamKey::default() };
    let batch = Batch { stream, ..Batch::new("rig-1", events[..7].to_vec()) };
    store.keep(&[batch]).unwrap();
    let mut engine = AlarmEngine::new("rig-1", Settings::default());
    let (alarms, history) = (before.standing(), events[7..].to_vec());
    let kept = Kept { alarms, history, last_id: 1, last_sequence: 12, ..Kept::default() };
    engine.restore(kept, Moment::of_stream(0.0));
    let service = Service::over(engine, Behaviour::Answers, |_| {});
    let held = service.get("/api/v1/alarms/history").await.json();
    assert_eq!((held["items"].as_array().unwrap().len(), &held["dropped"]), (5, &json!(7)));
    let store = StoreHandle { archive: Arc::new(archive), status: Arc::new(Status::default()) };
    let service = service.with_store(store);
    for limit in [1, 3, 5, 7, 100] {
        let mut path = format!("/api/v1/alarms/history?limit={limit}");
        let mut sequences = Vec::new();
        loop {
            let page = service.get(&path).await.json();
            assert_eq!(page["dropped"], 0);
            let items = page["items"].as_array().unwrap();
            sequences.extend(items.iter().map(|item| item["sequence"].as_u64().unwrap()));
            let Some(next) = page["next"].as_str() else { break };
            path = format!("/api/v1/alarms/history?limit={limit}&after={next}");
        }
        assert_eq!(sequences, (1..=12).rev().collect::<Vec<u64>>(), "{limit} a page");
    }
    let shown = service.get("/api/v1/alarms/rig-1:1").await.json();
    assert_eq!(shown["transitions"].as_array().unwrap().len(), 12);
    assert_eq!(shown["transitions"][11]["time"], "2023-11-14T22:13:30Z");
}

#[tokio::test]
async fn a_store_that_refuses_is_told_with_the_act() {
    use crate::api::view::{ActFailure, ShardRequest};
    let mut service = Service::new();
    let state = &mut service.state;
    let mut machines = (*state.machines).clone();
    for handle in machines.values_mut() {
        handle.submit = Arc::new(|request| {
            if let ShardRequest::Act { reply, .. } = request {
                drop(reply.send(Err(ActFailure::NotStored("the disk is full".to_owned()))));
            }
            Ok(())
        });
    }
    state.machines = Arc::new(machines);
    let service = service.renewed();
    let answer = service.post("/api/v1/alarms/rig-1:1/ack", ACK).await;
    assert_eq!(answer.json()["type"], "urn:rotorwatch:problem:not-stored");
    let detail = answer.problem(503);
    assert!(detail.contains("in effect") && detail.contains("disk is full"), "{detail}");
}
