//! Captures: listed, given as files, linked from alarms, asked for; what is gone or still written is told.

use crate::api::handles::CaptureHandle;
use crate::api::support::Service;
use crate::signal::Timestamp;
use crate::store::captures::CaptureEntry;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureState;
use crate::store::captures::SqliteCaptures;
use crate::store::sqlite;
use axum::http::Request;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// A capture that is whole.
pub(in crate::api) const ID: &str = "rig-1-00000001";

/// An index with a capture that is whole, one being written and one that is gone; and the file of the first.
pub(in crate::api) fn handle(folder: &Path) -> CaptureHandle {
    // The writing connection makes the schema; it is closed again.
    if !folder.join(sqlite::FILE).exists() {
        drop(sqlite::open(folder).unwrap());
    }
    let index = SqliteCaptures::join(folder).unwrap();
    let states = [CaptureState::Complete, CaptureState::Writing, CaptureState::Removed];
    for (number, state) in (1..).zip(states) {
        let alarms = if number == 1 { vec![1] } else { Vec::new() };
        let entry = CaptureEntry {
            id: format!("rig-1-{number:08}"),
            machine: "rig-1".to_owned(),
            number,
            by: None,
            requested: Timestamp(0),
            start: None,
            trigger_s: 10.0,
            span_s: (Some(0.0), None),
            state,
            note: Some("as noted".to_owned()),
            bytes: 9,
            n_windows: 2,
            alarms,
        };
        index.begin(&entry).unwrap();
    }
    let root = folder.join("captures");
    fs::create_dir_all(root.join("rig-1")).unwrap();
    fs::write(root.join("rig-1").join(format!("{ID}.h5")), "123456789").unwrap();
    let judge = Arc::new(|_: &Path| Err("no window is kept".to_owned()));
    CaptureHandle { index: Arc::new(index), root, judge }
}

#[tokio::test]
async fn captures_are_listed_linked_and_given() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = Service::new().with_captures(handle(folder.path()));
    let page = service.get("/api/v1/captures?limit=2").await.json();
    assert_eq!(
        (&page["items"][0]["state"], &page["next"]),
        (&json!("removed"), &json!("rig-1-00000002"))
    );
    let last = service.get("/api/v1/captures?limit=2&after=rig-1-00000002").await.json();
    assert_eq!((&last["items"][0]["id"], &last["next"]), (&json!(ID), &json!(null)));
    let of_alarm = service.get("/api/v1/captures?alarm=rig-1:1").await.json();
    assert_eq!(of_alarm["items"].as_array().unwrap().len(), 1);
    assert_eq!(of_alarm["items"][0]["alarms"], json!(["rig-1:1"]));
    let alarm = service.get("/api/v1/alarms/rig-1:1").await.json();
    assert_eq!(alarm["capture"], json!({ "id": ID, "state": "complete", "none_because": null }));
    let given = service.get(&format!("/api/v1/captures/{ID}")).await;
    assert_eq!((given.status.as_u16(), &given.body[..]), (200, &b"123456789"[..]));
    fs::remove_file(folder.path().join(format!("captures/rig-1/{ID}.h5"))).unwrap();
    let last = &service.get("/api/v1/captures?alarm=rig-1:1").await.json()["items"][0];
    assert_eq!((&last["state"], &last["bytes"]), (&json!("removed"), &json!(0)), "{last}");
    let told = service.get(&format!("/api/v1/captures/{ID}")).await.problem(404);
    let note = last["note"].as_str().unwrap();
    assert!(note.contains("not there") && told.contains(note), "{note}\n{told}");
}

#[tokio::test]
async fn a_part_is_given_and_what_is_no_range_is_not_looked_at() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = Service::new().with_captures(handle(folder.path()));
    for (range, status, body) in [
        ("bytes=2-4", 206, "345"),
        ("Bytes=7-", 206, "89"),
        ("bytes=-2", 206, "89"),
        ("bytes=20-30", 416, ""),
        ("foo", 200, "123456789"),
        ("lines=1-2", 200, "123456789"),
        ("bytes=9-3", 200, "123456789"),
        ("bytes=-", 200, "123456789"),
        ("bytes=+1-2", 200, "123456789"),
        ("bytes=0-1,3-4", 200, "123456789"),
    ] {
        let path = format!("/api/v1/captures/{ID}");
        let given = service.send(Request::get(path).header("range", range)).await;
        assert_eq!(given.status.as_u16(), status, "{range}");
        if status != 416 {
            assert_eq!(given.body, body.as_bytes(), "{range}");
        }
    }
}

#[tokio::test]
async fn what_cannot_be_given_or_asked_for_is_told() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = Service::new().with_captures(handle(folder.path()));
    for (path, status, words) in [
        ("/api/v1/captures/rig-1-00000002", 409, "being written"),
        ("/api/v1/captures/rig-1-00000003", 404, "removed: as noted"),
        ("/api/v1/captures/rig-1-00000009", 404, "no capture"),
        ("/api/v1/captures/..%2f..%2fstate", 404, "no capture"),
        ("/api/v1/captures?alarm=seven", 400, "no alarm id"),
        ("/api/v1/captures?machine=other", 404, "no machine"),
    ] {
        let answer = service.get(path).await;
        assert_eq!(answer.status.as_u16(), status, "{path}: {:?}", answer.body);
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains(words), "{path}: {detail}");
    }
    let path = "/api/v1/machines/rig-1/captures";
    let asked = service.post(path, json!({ "author": "M. Ito", "after_s": 5 }).to_string()).await;
    assert_eq!((asked.status.as_u16(), &asked.json()["id"]), (201, &json!("rig-1-00000007")));
    for body in [json!({ "author": " " }), json!({ "author": "a", "after_s": 1e9 })] {
        assert_eq!(service.post(path, body.to_string()).await.status.as_u16(), 400, "{body}");
    }
    let off = Service::new();
    assert_eq!(off.get("/api/v1/captures").await.status.as_u16(), 404);
    let alarm = off.get("/api/v1/alarms/rig-1:1").await.json();
    assert!(alarm["capture"]["none_because"].as_str().unwrap().contains("captures.enabled"));
}

#[tokio::test]
async fn a_capture_is_judged_again_or_refused_with_the_reason() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = Service::new().with_captures(handle(folder.path()));
    for (id, status, words) in [
        (ID, 409, "cannot be judged: no window is kept"),
        ("rig-1-00000002", 409, "being written"),
        ("rig-1-00000003", 404, "removed: as noted"),
        ("rig-1-00000009", 404, "no capture"),
    ] {
        let path = format!("/api/v1/captures/{id}/diagnosis");
        let told = service.post(&path, "").await.problem(status);
        assert!(told.contains(words), "{id}: {told}");
    }
}
