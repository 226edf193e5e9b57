//! Baselines over a real store and the small shard: learned, listed, used, removed, refused.

use crate::api::handles::BaselineHandle;
use crate::api::support::{Behaviour, Service};
use crate::api::view::{Measured, Span};
use crate::diagnosis::baseline::{OperatingPoint, Record, Usual};
use crate::signal::Timestamp;
use crate::store::SqliteBaselines;
use crate::units::Hz;
use axum::http::Request;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;

const PATH: &str = "/api/v1/machines/rig-1/baselines";

/// A record of windows at 10 Hz; nothing is held before 0 s.
pub(crate) fn sample_measured(span: Span) -> Result<Measured, String> {
    if matches!(span, Span::Between(from, _) if from < 0.0) {
        return Err("no window lies there".to_owned());
    }
    let usual = Usual { log_value: 2.0_f64.ln(), log_scatter: Some(0.05), n_windows: 12 };
    let record = Record {
        name: format!("{span:?}"),
        point: OperatingPoint { speed: Some(Hz(10.0)), load: None },
        usual: [(("right_x".to_owned(), "rms".to_owned()), usual)].into(),
        n_windows: 12,
        left_out: [("not running".to_owned(), 2)].into(),
        ..Record::default()
    };
    Ok(Measured { record, warnings: vec!["right is accused in 1 of 14 windows".to_owned()] })
}

/// A service that keeps baselines in a folder; it has a recording `a.h5` at 30 Hz.
pub(super) fn service(folder: &Path) -> Service {
    let measure = |_: &_, name: &str| match (name, sample_measured(Span::Last(5))) {
        ("a.h5", Ok(found)) => {
            let point = OperatingPoint { speed: Some(Hz(30.0)), load: None };
            let record = Record { name: name.to_owned(), point, ..found.record };
            Ok(Measured { record, warnings: vec!["a.h5: right is accused in it".to_owned()] })
        }
        (_, _) => Err(format!("no recording {name:?}")),
    };
    Service::new().with_baselines(BaselineHandle {
        store: Arc::new(SqliteBaselines::open(folder).unwrap()),
        measure: Arc::new(measure),
        wall_clock: || Timestamp(1_700_000_000_000_000_000),
    })
}

pub(super) async fn learn(service: &Service, body: &Value) -> Value {
    let answer = service.post(PATH, body.to_string()).await;
    assert_eq!(answer.status.as_u16(), 201, "{}", String::from_utf8_lossy(&answer.body));
    answer.json()
}

#[tokio::test]
async fn recordings_may_take_longer_than_a_request_and_are_learned_one_request_at_a_time() {
    let folder = tempfile::TempDir::new().unwrap();
    let (begun, begins) = std::sync::mpsc::sync_channel(1);
    let (go, may_go) = std::sync::mpsc::sync_channel(1);
    let may_go = std::sync::Mutex::new(may_go);
    let measure = move |_: &_, _: &str| {
        begun.send(()).unwrap();
        may_go.lock().unwrap().recv().unwrap();
        sample_measured(Span::Last(5))
    };
    // Shorter than the work, and nothing may be computed.
    let service = Service::with(Behaviour::Answers, |settings| {
        settings.request_timeout = Duration::from_millis(50);
        settings.max_computations = 0;
    });
    let service = service.with_baselines(BaselineHandle {
        store: Arc::new(SqliteBaselines::open(folder.path()).unwrap()),
        measure: Arc::new(measure),
        wall_clock: || Timestamp(0),
    });
    let body = json!({ "author": "a", "captures": ["a.h5"] });
    let meanwhile = async {
        tokio::task::spawn_blocking(move || begins.recv().unwrap()).await.unwrap();
        let refused = service.post(PATH, body.to_string()).await.problem(409);
        assert!(refused.contains("being learned"), "{refused}");
        assert_eq!(service.get(PATH).await.json()["items"], json!([]));
        tokio::time::sleep(Duration::from_millis(200)).await;
        go.send(()).unwrap();
    };
    let (learned, ()) = tokio::join!(learn(&service, &body), meanwhile);
    assert_eq!(learned["records"][0]["n_windows"], 12, "{learned}");
}

async fn ids(service: &Service) -> Vec<(String, bool)> {
    let list = service.get(PATH).await.json();
    let items = list["items"].as_array().unwrap();
    let of = |item: &Value| (item["id"].as_str().unwrap().to_owned(), item["active"] == true);
    items.iter().map(of).collect()
}

#[tokio::test]
async fn a_baseline_is_learned_listed_shown_and_replaced_in_its_state_only() {
    let folder = TempDir::new().unwrap();
    let service = service(folder.path());
    assert!(ids(&service).await.is_empty());
    let first =
        learn(&service, &json!({ "author": "A. Berg", "windows": 12, "comment": "new" })).await;
    assert_eq!(first["learned_at"], "2023-11-14T22:13:20Z");
    assert_eq!((&first["speed_hz"], &first["active"]), (&json!(10.0), &json!(true)));
    assert_eq!(first["warnings"][0], "right is accused in 1 of 14 windows");
    assert_eq!(first["records"][0]["left_out"][0], json!({ "reason": "not running", "n": 2 }));
    let captures = json!({ "author": "A. Berg", "captures": ["a.h5"] });
    let other = learn(&service, &captures).await;
    assert_eq!(other["warnings"][0], "a.h5: right is accused in it");
    let span = json!({
        "author": "M. Ito", "from": "2023-11-14T22:13:20Z", "to": "2023-11-14T22:14:20Z" });
    let second = learn(&service, &span).await;
    assert_eq!(second["records"][0]["name"], "Between(0.0, 60.0)");
    let id = |of: &Value| of["id"].as_str().unwrap().to_owned();
    let active = |all: Vec<(String, bool)>| -> Vec<String> {
        let mut on: Vec<String> = all.into_iter().filter(|(_, on)| *on).map(|(id, _)| id).collect();
        on.sort();
        on
    };
    let mut expected = vec![id(&other), id(&second)];
    expected.sort();
    assert_eq!(
        active(ids(&service).await),
        expected,
        "the first gave way, the other speed did not"
    );
    let path = format!("{PATH}/{}/activate", id(&first));
    let back = service.post(&path, r#"{ "author": "M. Ito" }"#).await.json();
    assert_eq!(back["active"], true);
    let mut expected = vec![id(&other), id(&first)];
    expected.sort();
    assert_eq!(active(ids(&service).await), expected);
    let shown = service.get(&format!("{PATH}/{}", id(&first))).await.json();
    let usual = &shown["usual"];
    assert_eq!(usual["feature"], json!(["rms"]));
    assert!((usual["value"][0].as_f64().unwrap() - 2.0).abs() < 1e-12);
    let gone = format!("{PATH}/{}?author=M.+Ito&comment=moved", id(&first));
    assert_eq!(service.send(Request::delete(&gone)).await.status.as_u16(), 204);
    assert!(service.send(Request::delete(&gone)).await.problem(404).contains("no baseline"));
    assert_eq!(ids(&service).await.len(), 2);
}

#[tokio::test]
async fn what_cannot_be_learned_is_refused_with_the_reason() {
    let folder = TempDir::new().unwrap();
    let service = service(folder.path());
    let ask = async |body: Value| service.post(PATH, body.to_string()).await;
    for (body, status, words) in [
        (json!({}), 400, "author"),
        (json!({ "author": " ", "windows": 12 }), 400, "author must not be empty"),
        (json!({ "author": "a" }), 400, "say one of windows"),
        (json!({ "author": "a", "windows": 12, "captures": ["a.h5"] }), 400, "say one of windows"),
        (json!({ "author": "a", "windows": 12, "from": "x" }), 400, "say one of windows"),
        (json!({ "author": "a", "windows": 4 }), 400, "5 to 720"),
        (json!({ "author": "a", "windows": -1 }), 400, "windows"),
        (json!({ "author": "a", "windows": 5, "color": 1 }), 400, "color"),
        (json!({ "author": "a", "captures": [] }), 400, "1 to 20"),
        (json!({ "author": "a", "captures": ["a.h5", "a.h5"] }), 400, "twice"),
        (json!({ "author": "a", "captures": ["../x.h5"] }), 400, "no recording"),
        (json!({ "author": "a", "from": "noon", "to": "x" }), 400, "from is \"noon\""),
        (
            json!({ "author": "a", "from": "2024-01-02T00:00:00Z", "to": "2024-01-01T00:00:00Z" }),
            400,
            "before",
        ),
        (
            json!({ "author": "a", "from": "2000-01-01T00:00:00Z", "to": "2000-01-02T00:00:00Z" }),
            409,
            "no window lies there",
        ),
    ] {
        let detail = ask(body.clone()).await.problem(status);
        assert!(detail.contains(words), "{body}: {detail}");
    }
    assert!(ids(&service).await.is_empty(), "nothing was learned");
    service.post(PATH, "{").await.problem(400);
    service.get("/api/v1/machines/rig-2/baselines").await.problem(404);
    service.get(&format!("{PATH}/nothing")).await.problem(404);
    let activate = format!("{PATH}/nothing/activate");
    service.post(&activate, r#"{ "author": "a" }"#).await.problem(404);
    service.send(Request::delete(format!("{PATH}/nothing"))).await.problem(400);
    Service::new().get(PATH).await.problem(404);
}

#[tokio::test]
async fn a_busy_shard_learns_nothing_and_removing_does_not_need_it() {
    let folder = TempDir::new().unwrap();
    let kept = service(folder.path());
    let first = learn(&kept, &json!({ "author": "a", "windows": 12 })).await;
    drop(kept);
    let full = Service::with(Behaviour::Full, |_| {});
    let store = Arc::new(SqliteBaselines::open(folder.path()).unwrap());
    let measure = Arc::new(|_: &_, _: &str| Err("none".to_owned()));
    let wall_clock = || Timestamp(0);
    let full = full.with_baselines(BaselineHandle { store, measure, wall_clock });
    full.post(PATH, r#"{ "author": "a", "windows": 12 }"#).await.problem(503);
    assert_eq!(ids(&full).await.len(), 1);
    let gone = format!("{PATH}/{}?author=a", first["id"].as_str().unwrap());
    assert_eq!(full.send(Request::delete(&gone)).await.status.as_u16(), 204);
    assert!(ids(&full).await.is_empty());
}
