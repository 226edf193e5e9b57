//! The stream of events over a real log; it ends here because its store has.

use super::super::handles::EventsHandle;
use super::super::support::{Behaviour, Service};
use crate::alarms::{AlarmEngine, Moment, Settings};
use crate::api::support::sample_diagnosis;
use crate::notify::HealthWatch;
use crate::store::events::SqliteEvents;
use crate::store::{Batch, StateStore, sqlite};
use axum::http::Request;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use tokio::sync::watch;

/// The log of a store; streams of it end when the sender is dropped.
pub(super) fn handle(directory: &Path) -> (EventsHandle, watch::Sender<u64>) {
    let log = Arc::new(SqliteEvents::join(directory).unwrap());
    let (told, stored) = watch::channel(0);
    let handle = EventsHandle {
        log: Arc::clone(&log) as Arc<dyn crate::store::events::EventLog>,
        audit: log,
        stored,
        open: Gauge::default(),
        refused: Counter::default(),
        stalled: Counter::default(),
        receivers: watch::channel(Arc::from([])).1,
    };
    (handle, told)
}

/// A service over a log with the events of a first verdict on each of two machines.
fn service() -> (TempDir, Service, EventsHandle, watch::Sender<u64>) {
    let dir = TempDir::new().unwrap();
    let (mut store, _) = sqlite::open(dir.path()).unwrap();
    let mut engine = AlarmEngine::new("rig-1", Settings::default());
    let events = engine.observe(&sample_diagnosis(), 10.0);
    let health = HealthWatch::default().observe(&sample_diagnosis(), 10.0);
    let batch = |machine: &str| Batch {
        now: Moment::of_stream(10.0),
        health: health.clone(),
        ..Batch::new(machine, events.clone())
    };
    store.keep(&[batch("rig-1"), batch("rig-2")]).unwrap();
    let (handle, told) = handle(dir.path());
    let service = Service::with(Behaviour::Answers, |settings| settings.max_streams = 1);
    (dir, service.with_events(handle.clone()), handle, told)
}

/// Names, ids and data of the events of an answer.
fn events(body: &[u8]) -> Vec<(String, u64, Value)> {
    let text = std::str::from_utf8(body).unwrap();
    let field = |block: &str, name: &str| {
        let found = block.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
        found.unwrap_or_default().to_owned()
    };
    let of_block = |block: &str| {
        let data = field(block, "data");
        let data = serde_json::from_str(&data).unwrap_or_else(|e| panic!("{e}: {block}"));
        (field(block, "event"), field(block, "id").parse().unwrap(), data)
    };
    text.split("\n\n").filter(|block| !block.trim().is_empty()).map(of_block).collect()
}

fn names(events: &[(String, u64, Value)]) -> Vec<String> {
    events.iter().map(|(name, id, _)| format!("{name} {id}")).collect()
}

#[tokio::test]
async fn a_stream_begins_after_the_place_asked_for_and_tells_of_one_machine() {
    let (_dir, service, handle, told) = service();
    drop(told);
    let all = service.get("/api/v1/events?last_event_id=0").await;
    assert_eq!(all.header("content-type"), "text/event-stream");
    let found = events(&all.body);
    // One alarm and the health of the machine and its three components, of two machines.
    let n = found.len() as u64 - 1;
    assert_eq!(n, 10, "{found:?}");
    assert_eq!(names(&found[..3]), ["begin 0", "alarm 1", "health 2"]);
    let (_, _, alarm) = &found[1];
    assert_eq!(
        (&alarm["id"], &alarm["event"], &alarm["place"]),
        (&"rig-1#1".into(), &"raised".into(), &1.into())
    );
    let (_, _, whole) = &found[2];
    assert_eq!((&whole["component"], &whole["state"]), (&Value::Null, &"damaged".into()));
    assert!(
        found
            .iter()
            .any(|(_, _, data)| data["component"] == "right" && data["fault"] == "inner_race")
    );
    let one = events(&service.get("/api/v1/events?last_event_id=0&machine=rig-1").await.body);
    assert_eq!(one.len(), 6, "{one:?}");
    let header = Request::get("/api/v1/events?last_event_id=0").header("last-event-id", "9");
    let rest = events(&service.send(header).await.body);
    assert_eq!(names(&rest), ["begin 9", "health 10"], "the header wins");
    assert_eq!(names(&events(&service.get("/api/v1/events").await.body)), ["begin 10"]);
    let beyond = events(&service.get("/api/v1/events?last_event_id=11").await.body);
    assert_eq!(names(&beyond), ["reset 10"]);
    assert_eq!(handle.open.get(), 0, "every stream has ended");
}

#[tokio::test]
async fn too_many_streams_and_wrong_places_are_refused() {
    let (_dir, service, handle, told) = service();
    drop(told);
    for wrong in ["x", "-1", "1.5", "99999999999999999999"] {
        let answer = service.get(&format!("/api/v1/events?last_event_id={wrong}")).await;
        assert!(answer.problem(400).contains(wrong), "{wrong}");
    }
    service.get("/api/v1/events?machine=none").await.problem(404);
    let held = Arc::clone(&service.state.streams).try_acquire_owned().unwrap();
    assert!(service.get("/api/v1/events").await.problem(503).contains("streams"));
    assert_eq!(handle.refused.get(), 1);
    drop(held);
    assert_eq!(service.get("/api/v1/events").await.status, 200);
}

#[tokio::test]
async fn a_service_without_a_store_has_no_events_and_no_audit() {
    let service = Service::new();
    for path in ["/api/v1/events", "/api/v1/audit", "/api/v1/configurations"] {
        service.get(path).await.problem(404);
    }
}
