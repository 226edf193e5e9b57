//! Scenarios: shown, changed, refused.

use crate::api::support::{Behaviour, Service};
use axum::body::Body;
use axum::http::Request;

const PATH: &str = "/api/v1/simulation/scenario";

#[tokio::test]
async fn a_scenario_is_shown_and_changed() {
    let service = Service::new();
    let shown = service.get(PATH).await.json();
    let item = &shown["items"][0];
    assert_eq!((&item["machine"], &item["scenario"]), (&"rig-1".into(), &"GG_GS_GB".into()));
    assert_eq!(item["since"], "2023-11-14T22:13:22Z");
    assert_eq!((&item["lag_s"], &item["keeps_pace"]), (&0.0.into(), &true.into()));
    // The document describes the faults it shows.
    let mut schema: serde_json::Value = serde_json::from_str(&crate::api::openapi_text()).unwrap();
    schema["$ref"] = "#/components/schemas/FaultWire".into();
    let validator = jsonschema::validator_for(&schema).unwrap();
    for fault in [
        r#"{ "fault": "inner_race", "bearing": "right", "width_mm": 1, "depth_um": 20, "angle_deg": 0 }"#,
        r#"{ "fault": "bow", "shaft": "main", "amplitude_um": 4.0 }"#,
    ] {
        let fault = serde_json::from_str(fault).unwrap();
        let errors: Vec<String> = validator.iter_errors(&fault).map(|e| e.to_string()).collect();
        assert!(errors.is_empty(), "{fault}: {errors:?}");
    }
    let body = r#"{ "machine": "rig-1", "scenario": "GG_GS_BB", "grow_s": 3 }"#;
    let changed = service.post(PATH, body).await.json();
    assert_eq!((&changed["scenario"], &changed["grown_at_s"]), (&"GG_GS_BB".into(), &15.0.into()));
    let turned = service.post(PATH, r#"{ "shaft_speed_hz": 15 }"#).await.json();
    assert_eq!(turned["shaft_speed_hz"], 15.0);
    let fast = service.post(PATH, r#"{ "shaft_speed_hz": 61 }"#).await.problem(400);
    assert!(fast.contains("allowed: 1 to 60"), "{fast}");
}

#[tokio::test]
async fn what_cannot_be_is_refused_with_its_status() {
    let service = Service::new();
    let bad = r#"{ "scenario": "BG_GS_BB" }"#;
    assert_eq!(service.post(PATH, bad).await.problem(400), "not this one");
    let nobody = r#"{ "machine": "rig-9", "scenario": "GG_GS_BB" }"#;
    assert!(service.post(PATH, nobody).await.problem(404).contains("rig-1"));
    let form = Request::post(PATH).header("content-type", "application/x-www-form-urlencoded");
    let answer = service.send_body(form, Body::from("scenario=GG_GS_BB")).await;
    answer.problem(415);
    let elsewhere = Request::post(PATH)
        .header("host", "evil.example:8080")
        .header("content-type", "application/json");
    let answer = service.send_body(elsewhere, Body::from(r#"{ "scenario": "GG_GS_BB" }"#)).await;
    answer.problem(421);
    let full = Service::with(Behaviour::Full, |_| {});
    let good = r#"{ "scenario": "GG_GS_BB" }"#;
    assert!(full.post(PATH, good).await.problem(503).contains("other scenarios"));
    let ended = Service::with(Behaviour::Silent, |_| {});
    assert_eq!(ended.post(PATH, good).await.problem(409), "the simulation of \"rig-1\" has ended");
}
