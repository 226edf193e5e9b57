//! The diagnosis document against its contract and its published schema.

use super::*;
use crate::api::support::{golden, sample_diagnosis};
use crate::diagnosis::fault::{ComponentKind, GearSide};
use serde_json::{Value, json};

fn document() -> Value {
    serde_json::to_value(DiagnosisDocument::new(&sample_diagnosis(), Some("x.h5"))).unwrap()
}

#[test]
fn document_has_the_names_of_the_contract() {
    let doc = document();
    assert_eq!(doc["schema"], "rotorwatch.diagnosis/1");
    assert_eq!(doc["capture"], "x.h5");
    assert_eq!(doc["shaft_speed_hz"], 10.0);
    assert_eq!(doc["speed_source"], "estimated");
    assert_eq!(doc["coverage"], json!({ "judged": 2, "undetermined": ["main"] }));
    let right = &doc["components"][0];
    assert_eq!(right["kind"], "bearing");
    assert_eq!(right["fault"], "inner_race");
    assert_eq!(right["evidence"][0]["frequency_hz"], 68.0);
    assert_eq!(right["evidence"][0]["sample_range"], json!([0, 120_000]));
    assert_eq!(right["evidence"][0]["detector"], "0-p");
    assert!(right.get("member").is_none(), "gear fields belong to gears");
    let main = &doc["components"][1];
    for key in ["fault", "severity", "confidence"] {
        assert!(main[key].is_null() && main.get(key).is_some(), "{key} is there and null");
    }
    assert_eq!(doc["timeline"]["state"], json!(["healthy", "damaged"]));
    assert_eq!(doc["first_damaged_s"], 10.0);
    assert_eq!(doc["shaft_speeds"], json!({ "main": 10.0 }));
}

#[test]
fn gear_member_is_null_when_the_rates_coincide() {
    let doc = document();
    let gear = &doc["components"][2];
    assert_eq!(gear["kind"], "gear");
    assert!(gear.get("member").is_some_and(Value::is_null));
    assert_eq!(gear["angle_deg"], 123.0);

    let mut driven = sample_diagnosis();
    driven.components[2].gear =
        Some(GearFinding { member: Some(GearSide::Driven), ..GearFinding::default() });
    let doc = serde_json::to_value(DiagnosisDocument::new(&driven, None)).unwrap();
    assert_eq!(doc["components"][2]["member"], "driven");
    assert!(doc["components"][2].get("angle_deg").is_none());
    assert!(doc["capture"].is_null());
}

#[test]
fn numbers_that_are_not_finite_become_null_and_the_document_stays_valid() {
    let mut diagnosis = sample_diagnosis();
    diagnosis.components[0].evidence[0].value = f64::INFINITY;
    diagnosis.components[0].evidence[0].threshold = Some(f64::NAN);
    diagnosis.components[0].severity = Some(f64::NAN);
    diagnosis.duration_s = f64::NAN;
    let doc = serde_json::to_value(DiagnosisDocument::new(&diagnosis, None)).unwrap();
    assert!(doc["components"][0]["evidence"][0]["value"].is_null());
    assert!(doc["components"][0]["severity"].is_null());
    assert_eq!(doc["duration_s"], 0.0);
    assert_valid(&doc);
}

#[test]
fn document_validates_against_the_published_schema() {
    assert_valid(&document());
}

#[test]
fn published_schema_refuses_what_the_contract_forbids() {
    let validator = jsonschema::draft202012::new(&json_schema()).unwrap();
    for (pointer, wrong) in [
        ("/schema", json!("rotorwatch.diagnosis/2")),
        ("/state", json!("ok")),
        ("/components/0/fault", json!("rust")),
        ("/components/0/severity", json!(1.5)),
        ("/components/0/confidence", json!(1.0)),
        ("/coverage", json!(null)),
        ("/samples_used", json!(-1)),
    ] {
        let mut doc = document();
        *doc.pointer_mut(pointer).unwrap() = wrong;
        assert!(!validator.is_valid(&doc), "{pointer}");
    }
    let mut short = document();
    short.as_object_mut().unwrap().remove("operating_state");
    assert!(!validator.is_valid(&short));
    let mut longer = document();
    longer["an_addition"] = json!(1);
    assert!(validator.is_valid(&longer), "additions are free");
}

#[test]
fn committed_schema_is_current() {
    let text = serde_json::to_string_pretty(&json_schema()).unwrap() + "\n";
    golden("docs/schemas/diagnosis-1.schema.json", &text);
}

#[test]
fn every_kind_of_component_is_covered_by_the_sample() {
    let kinds: Vec<_> = sample_diagnosis().components.iter().map(|c| c.kind).collect();
    assert_eq!(kinds, [ComponentKind::Bearing, ComponentKind::Shaft, ComponentKind::Gear]);
}

fn assert_valid(doc: &Value) {
    let validator = jsonschema::draft202012::new(&json_schema()).unwrap();
    let faults: Vec<String> =
        validator.iter_errors(doc).map(|e| format!("{}: {e}", e.instance_path())).collect();
    assert!(faults.is_empty(), "{faults:#?}");
}
