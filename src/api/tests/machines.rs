//! Machines, health, diagnosis, service pages.

use crate::alarms::{self, AlarmEngine, DataFlow, Moment};
use crate::api::handles::{FeedbackHandle, IngestView};
use crate::api::openapi_text;
use crate::api::support::{Behaviour, Service, golden, sample_diagnosis};
use crate::api::tests::{baselines, captures, events, recordings, trends};
use crate::api::view::SourceState;
use crate::api::wire::diagnosis::json_schema;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Coverage;
use crate::ingest::live::intake::ChannelStatus;
use crate::ingest::live::ledger::Ledger;
use crate::signal::{ChannelIndex, Timestamp};
use crate::store::feedback::SqliteFeedback;
use serde_json::{Value, json};
use std::sync::Arc;

#[tokio::test]
async fn machines_are_listed_and_described() {
    let service = Service::new();
    let list = service.get("/api/v1/machines").await.json();
    assert_eq!(list["items"][0]["id"], "rig-1");
    assert_eq!(list["items"][0]["name"], "Test rig");
    assert_eq!(list["items"][0]["state"], "damaged");
    assert_eq!(list["items"][0]["alarms"], 1);

    let rig = service.get("/api/v1/machines/rig-1").await.json();
    assert_eq!(rig["bearings"][0]["elements"], 11);
    assert!((rig["bearings"][0]["pitch_diameter_mm"].as_f64().unwrap() - 33.5).abs() < 1e-9);
    assert_eq!(rig["sensors"][1]["at"], json!({ "kind": "bearing", "id": "right" }));
    let table = &rig["frequencies"];
    let labels = table["label"].as_array().unwrap();
    let at = |label: &str| labels.iter().position(|l| l == label).unwrap();
    // BPFI = n/2·f·(1 + d/D) = 5.5·10·(1 + 7.9375/33.5); the diagnosed speed is 10 Hz.
    let bpfi = table["frequency_hz"][at("BPFI")].as_f64().unwrap();
    assert!((bpfi - 55.0 * (1.0 + 7.9375 / 33.5)).abs() < 1e-9);
    assert_eq!(table["owner"][at("BPFI")], "right");
    assert_eq!(table["frequency_hz"].as_array().unwrap().len(), labels.len());
}

#[tokio::test]
async fn health_gives_state_since_and_coverage() {
    let service = Service::new();
    let health = service.get("/api/v1/machines/rig-1/health").await.json();
    assert_eq!(health["machine"], "rig-1");
    assert_eq!(health["state"], "damaged");
    assert_eq!(health["since"], "2023-11-14T22:13:30Z");
    let right = &health["components"][0];
    for (key, value) in [("id", "right"), ("kind", "bearing"), ("fault", "inner_race")] {
        assert_eq!(right[key], value);
    }
    assert_eq!(right["since"], "2023-11-14T22:13:30Z");
    assert_eq!(health["components"][1]["since"], "2023-11-14T22:13:20Z");
    assert_eq!(health["data"]["coverage"]["undetermined"], json!(["main"]));
    assert_eq!(health["data"]["time_unknown"], false);
}

#[tokio::test]
async fn nothing_is_called_healthy_while_no_data_come() {
    let mut healthy = sample_diagnosis();
    healthy.state = State::Healthy;
    healthy.components.truncate(2);
    healthy.components[0].state = State::Healthy;
    healthy.components[1].state = State::Warning;
    healthy.coverage = Coverage { judged: 2, undetermined: Vec::new() };
    let mut engine = AlarmEngine::new("rig-1", alarms::Settings::default());
    let silent_s = engine.settings().missing_after_s + 1.0;
    let now = Moment { stream_s: 12.0, monotonic_s: 99.0, utc: Timestamp::default() };
    assert_eq!(engine.tick(now, DataFlow::SilentFor(silent_s), None).len(), 1);
    let service = Service::over(engine, Behaviour::Answers, |_| {});
    service.view.send_modify(|view| Arc::make_mut(view).diagnosis = Some(Arc::new(healthy)));

    let health = service.get("/api/v1/machines/rig-1/health").await.json();
    for (key, value) in [("state", "undetermined"), ("operating_state", "unknown")] {
        assert_eq!(health[key], value, "{health}");
    }
    assert_eq!(health["since"], "2023-11-14T22:13:32Z", "since the alarm");
    let [was_healthy, accused] = [0, 1].map(|i| &health["components"][i]);
    assert_eq!(
        (&was_healthy["state"], &accused["state"]),
        (&json!("undetermined"), &json!("warning"))
    );
    assert!(was_healthy["severity"].is_null() && was_healthy["confidence"].is_null());
    assert!(
        was_healthy["why"].as_str().unwrap().starts_with("no data have come since 2023-"),
        "{health}"
    );
    let data = &health["data"];
    assert_eq!(
        (&data["data_quality"], &data["coverage"]["judged"]),
        (&json!("degraded"), &json!(1))
    );
    let item = &service.get("/api/v1/machines").await.json()["items"][0];
    assert_eq!(
        (&item["state"], &item["data_quality"]),
        (&json!("undetermined"), &json!("degraded"))
    );
    assert!(item["reason"].as_str().unwrap().starts_with("no data have come"), "{item}");
    let stream = &service.get("/api/v1/system").await.json()["streams"][0];
    assert_eq!(stream["reason"], item["reason"]);
    for signal in ["waveform?samples=1000", "spectrum"] {
        let path = format!("/api/v1/machines/rig-1/channels/right_x/{signal}");
        assert_eq!(service.get(&path).await.json()["validity"], "stale", "{signal}");
    }
    // The last verdict is there to be read, with its time.
    let verdict = service.get("/api/v1/machines/rig-1/diagnosis").await.json();
    assert_eq!(
        (&verdict["state"], &verdict["judged_until"]),
        (&json!("healthy"), &json!("2023-11-14T22:13:30Z"))
    );
    assert_eq!(verdict["no_data"], item["reason"]);
}

#[tokio::test]
async fn of_a_machine_that_never_sent_it_is_told_since_when_data_are_missed() {
    let mut engine = AlarmEngine::new("rig-1", alarms::Settings::default());
    let now = Moment { stream_s: 12.0, monotonic_s: 99.0, utc: Timestamp::default() };
    assert_eq!(engine.tick(now, DataFlow::SilentFor(60.0), None).len(), 1);
    let service = Service::over(engine, Behaviour::Answers, |_| {});
    service.view.send_modify(|view| Arc::make_mut(view).rings.clear());
    let item = &service.get("/api/v1/machines").await.json()["items"][0];
    assert_eq!(item["reason"], "no data have come since 2023-11-14T22:13:32Z");
    assert!(item["stream_time_s"].is_null() && item["last_sample_time"].is_null(), "{item}");
}

#[tokio::test]
async fn after_a_restart_what_was_accused_stays_so_as_its_alarm_does() {
    let service = Service::new();
    service.view.send_modify(|view| {
        let view = Arc::make_mut(view);
        view.diagnosis = None;
        view.state_since_s.clear();
        view.rings.clear();
    });
    let health = service.get("/api/v1/machines/rig-1/health").await.json();
    assert_eq!(
        (&health["state"], &health["since"]),
        (&json!("damaged"), &json!("2023-11-14T22:13:30Z"))
    );
    let components = health["components"].as_array().unwrap();
    assert_eq!(components.len(), 1, "{health}");
    for (key, value) in
        [("id", "right"), ("kind", "bearing"), ("fault", "inner_race"), ("state", "damaged")]
    {
        assert_eq!(components[0][key], value);
    }
    assert!(components[0]["severity"].is_number());
    let item = &service.get("/api/v1/machines").await.json()["items"][0];
    assert_eq!((&item["state"], &item["operating_state"]), (&json!("damaged"), &json!("unknown")));
}

#[tokio::test]
async fn before_the_first_verdict_its_place_says_when_it_comes_and_what_stands_accused() {
    let service = Service::new();
    service.view.send_modify(|view| Arc::make_mut(view).diagnosis = None);
    let answer = service.get("/api/v1/machines/rig-1/diagnosis").await;
    let detail = answer.problem(404);
    for part in ["first whole window", "/machines/rig-1/health", "/alarms?machine=rig-1"] {
        assert!(detail.contains(part), "{detail}");
    }
    let problem = answer.json();
    let standing = problem["errors"].as_array().unwrap();
    assert_eq!(standing.len(), 1, "{problem}");
    let told = standing[0].as_str().unwrap();
    assert!(
        told.starts_with("bearing \"right\" stands accused since 2023-11-14T22:13:30"),
        "{told}"
    );
    assert!(told.contains("damaged, inner_race"), "{told}");
}

#[tokio::test]
async fn before_the_first_verdict_nothing_is_claimed() {
    let service = Service::new();
    service.view.send_modify(|view| {
        let view = Arc::make_mut(view);
        view.diagnosis = None;
        view.alarms = Arc::default();
        view.state_since_s.clear();
        view.start_time = None;
        view.rings.clear();
        view.channels = Arc::new(Vec::new());
        view.source = SourceState::Starting;
    });
    let health = service.get("/api/v1/machines/rig-1/health").await.json();
    assert_eq!(health["state"], "undetermined");
    assert!(health["since"].is_null() && health["data"]["last_sample_time"].is_null());
    assert_eq!(health["data"]["time_unknown"], true);
    assert_eq!(health["data"]["source"], "starting");
    let detail = service.get("/api/v1/machines/rig-1/diagnosis").await.problem(404);
    assert!(detail.contains("judged") && detail.contains("its source is starting"), "{detail}");
    let detail = service.get("/api/v1/machines/rig-1/channels/right_x/waveform").await.problem(404);
    assert!(detail.contains("there is none yet"), "{detail}");
    let rig = service.get("/api/v1/machines/rig-1").await.json();
    assert_eq!(rig["frequencies"]["shaft_speed_hz"], 10.0, "nominal speed");
}

#[tokio::test]
async fn diagnosis_validates_against_the_published_schema() {
    let doc = Service::new().get("/api/v1/machines/rig-1/diagnosis").await.json();
    assert_eq!(doc["schema"], "rotorwatch.diagnosis/1");
    assert!(jsonschema::draft202012::new(&json_schema()).unwrap().is_valid(&doc));
}

#[tokio::test]
async fn readiness_names_what_is_wrong() {
    let service = Service::new();
    assert_eq!(service.get("/livez").await.json(), json!({ "live": true }));
    assert_eq!(service.get("/readyz").await.json(), json!({ "ready": true }));
    let set = |source| service.view.send_modify(|view| Arc::make_mut(view).source = source);
    set(SourceState::Finished);
    assert_eq!(service.get("/readyz").await.status, 200, "a finished replay keeps serving");
    set(SourceState::Starting);
    service.get("/readyz").await.problem(503);
    set(SourceState::Failed("no such file".to_owned()));
    let answer = service.get("/readyz").await;
    answer.problem(503);
    assert_eq!(answer.json()["errors"], json!(["source of \"rig-1\" failed: no such file"]));
    assert_eq!(answer.header("retry-after"), "1");
    assert_eq!(service.get("/livez").await.status, 200, "alive all the same");
}

#[tokio::test]
async fn readiness_needs_the_senders_of_a_live_machine() {
    let channel = |name: &str, is_sent: bool| ChannelStatus {
        name: name.to_owned(),
        channel: ChannelIndex(0),
        ledger: Ledger::default(),
        counted_since: Timestamp(0),
        clock: None,
        offset_s: None,
        doubt: None,
        stated_until: None,
        rate_hz: 1e4,
        sender: is_sent.then(|| ("tcp://10.0.0.7:4711".to_owned(), Timestamp(0))),
    };
    let ready = async |source: SourceState, n_senders, channels: Vec<ChannelStatus>| {
        let mut service = Service::new();
        let mut handle = service.state.machine("rig-1").unwrap().clone();
        let senders = IngestView { n_senders, channels, at: Timestamp(0) };
        handle.ingest = Some(Arc::new(move || senders.clone()));
        service.state.machines = Arc::new([("rig-1".to_owned(), handle)].into());
        let service = service.renewed();
        service.view.send_modify(|view| Arc::make_mut(view).source = source);
        let answer = service.get("/readyz").await;
        assert_eq!(service.get("/livez").await.status, 200, "alive all the same");
        if answer.status == 200 {
            Vec::new()
        } else {
            answer.json()["errors"].as_array().unwrap().clone()
        }
    };
    let both = |second| vec![channel("x", true), channel("speed", second)];
    let (starting, running) = (SourceState::Starting, SourceState::Running);
    let nobody = [json!("no sender of \"rig-1\" is connected")];
    assert_eq!(ready(starting.clone(), 0, Vec::new()).await, nobody);
    let silent = json!("the senders of \"rig-1\" have sent nothing yet");
    assert_eq!(ready(starting, 2, both(true)).await, [silent]);
    assert!(ready(running.clone(), 2, both(true)).await.is_empty());
    let one = json!("no sender of \"rig-1\" is connected that sends speed");
    assert_eq!(ready(running.clone(), 1, both(false)).await, [one]);
    assert_eq!(ready(running, 0, both(false)).await, nobody);
    let ended = ready(SourceState::Finished, 0, both(false)).await;
    assert!(ended.is_empty(), "a stream that came to its end keeps serving");
}

#[tokio::test]
async fn a_shard_that_ended_is_not_ready() {
    let Service { view, state, .. } = Service::new();
    drop(view);
    let service = Service::new();
    assert_eq!(service.get("/readyz").await.status, 200);
    let handle = state.machine("rig-1").unwrap();
    assert!(handle.view.has_changed().is_err());
}

#[tokio::test]
async fn metrics_and_system_are_served() {
    let service = Service::new();
    let metrics = service.get("/metrics").await;
    assert!(metrics.header("content-type").starts_with("application/openmetrics-text"));
    assert_eq!(metrics.body, "# EOF\n");
    let system = service.get("/api/v1/system").await.json();
    assert_eq!(system["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(system["streams"][0]["source"], "running");
    let stream = &system["streams"][0];
    assert_eq!(stream["gaps"], 4);
    assert_eq!(stream["queue_wait_s"], 0.25);
    let end_s = service.view.borrow().stream_time_s - 1.5;
    service.view.send_modify(|view| Arc::make_mut(view).window_end_s = Some(end_s));
    let system = service.get("/api/v1/system").await.json();
    assert_eq!(system["streams"][0]["verdict_lag_s"], 1.5);
    for unknown in ["clock_drift_ppm", "clock_offset_s", "sample_age_s"] {
        assert_eq!(stream[unknown], Value::Null, "{unknown} of a source that has no senders");
    }
    service.view.send_modify(|view| Arc::make_mut(view).window_end_s = None);
    let system = service.get("/api/v1/system").await.json();
    assert_eq!(system["streams"][0]["verdict_lag_s"], Value::Null, "nothing is judged");
}

#[tokio::test]
async fn what_the_store_takes_is_told_with_what_is_not_known_as_null() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = trends::stored(Service::new(), folder.path());
    let sizes = service.get("/api/v1/system").await.json()["sizes"].clone();
    let alarms = json!({
        "name": "alarms", "bytes": 4096, "limit_bytes": null, "growth_bytes_per_day": null, "days_to_limit": null,
    });
    assert_eq!(sizes, json!({ "measured_s": 60.0, "free_bytes": null, "parts": [alarms] }));
}

#[tokio::test]
async fn committed_openapi_document_is_current_and_served() {
    golden("tests/golden/openapi.json", &openapi_text());
    let served = Service::new().get("/api/v1/openapi.json").await;
    assert_eq!(served.body, openapi_text());
    let doc: Value = served.json();
    assert_eq!(doc["openapi"].as_str().unwrap().split('.').take(2).collect::<Vec<_>>(), ["3", "1"]);
}

/// Every GET of the document answers over the real router, so that none is only described.
#[tokio::test]
async fn every_described_path_is_served() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = baselines::service(folder.path()).with_captures(captures::handle(folder.path()));
    let service = recordings::kept(trends::stored(service, folder.path()), folder.path());
    // A stream of events ends with its store.
    let service = service.with_events(events::handle(folder.path()).0);
    let store = Arc::new(SqliteFeedback::join(folder.path()).unwrap());
    let wall_clock = || Timestamp(0);
    let service = service.with_feedback(FeedbackHandle { store, wall_clock });
    let body = serde_json::json!({ "author": "a", "windows": 12 });
    let learned = baselines::learn(&service, &body).await;
    let doc = service.get("/api/v1/openapi.json").await.json();
    let mut n_paths = 0;
    for (path, methods) in doc["paths"].as_object().unwrap() {
        let id = match path {
            _ if path.contains("/alarms/") => "rig-1:1",
            _ if path.contains("/captures/") => captures::ID,
            _ => "rig-1",
        };
        let path = path.replace("{id}", id).replace("{name}", "right_x");
        let path = path
            .replace("{kind}", "bearing")
            .replace("{file}", recordings::FILE)
            .replace("{component}", "right");
        let path = path.replace("{bid}", learned["id"].as_str().unwrap());
        if methods.get("get").is_some() {
            let answer = service.get(&path).await;
            if path == "/api/v1/ingest" {
                // A WebSocket, of which there is none without a source that takes samples.
                assert_eq!(answer.status, 404, "{path}: {:?}", answer.body);
                let detail = answer.json()["detail"].to_string();
                assert!(detail.contains("takes samples"), "{detail}");
            } else {
                assert_eq!(answer.status, 200, "{path}: {:?}", answer.body);
            }
        }
        n_paths += 1;
    }
    assert_eq!(n_paths, 48);
}

#[test]
fn the_document_has_the_words_that_are_sent() {
    fn words(value: &serde_json::Value, found: &mut Vec<String>) {
        if let Some(list) = value["enum"].as_array() {
            found.extend(list.iter().filter_map(|word| word.as_str()).map(str::to_owned));
        }
        let below = value.as_object().into_iter().flat_map(|map| map.values());
        below.chain(value.as_array().into_iter().flatten()).for_each(|inner| words(inner, found));
    }
    let document = serde_json::from_str(&crate::api::openapi_text()).unwrap();
    let mut found = Vec::new();
    words(&document, &mut found);
    assert!(found.iter().any(|word| word == "inner_race"), "{found:?}");
    let wrong: Vec<_> = found.iter().filter(|word| word.starts_with(char::is_uppercase)).collect();
    assert!(wrong.is_empty(), "names of the code, not of the interface: {wrong:?}");
}

#[test]
fn the_document_is_what_openapi_asks_for() {
    let document: serde_json::Value = serde_json::from_str(&crate::api::openapi_text()).unwrap();
    let mut ids = std::collections::BTreeSet::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let id = operation["operationId"].as_str().unwrap_or_default();
            assert!(!id.is_empty() && ids.insert(id.to_owned()), "{method} {path}: {id:?}");
            for (status, answer) in operation["responses"].as_object().unwrap() {
                let described = answer["description"].as_str().unwrap_or_default();
                assert!(!described.is_empty(), "{method} {path}: {status}");
            }
        }
    }
    assert!(ids.contains("get_machines_id_health"), "{ids:?}");
}
