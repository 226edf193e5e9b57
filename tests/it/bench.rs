//! `rotorwatch bench`: what it measures holds, and what it writes can be read.

use crate::support;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Rows of the JSON document, after a look whether the CSV has as many.
fn rows(dir: &Path, name: &str) -> Vec<Value> {
    let text = fs::read_to_string(dir.join(format!("{name}.json"))).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(document["bench"], name);
    assert!(!document["computer"]["processor"].as_str().unwrap().is_empty());
    let rows = document["rows"].as_array().unwrap().clone();
    let csv = fs::read_to_string(dir.join(format!("{name}.csv"))).unwrap();
    assert_eq!(csv.lines().count(), 1 + rows.len(), "{csv}");
    // Keys of the rows are the names of the columns.
    for column in csv.lines().next().unwrap().split(',') {
        assert!(rows.iter().all(|row| row.get(column).is_some()), "{column}");
    }
    rows
}

#[test]
fn the_simulator_keeps_the_accuracy_asked_for() {
    let dir = TempDir::new().unwrap();
    let out = dir.path().join("new");
    let mut command = support::command();
    let ended = support::run(command.args(["bench", "simulator", "--quick", "--out"]).arg(&out));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let rows = rows(&out, "simulator");
    assert!(rows.len() >= 4, "{rows:?}");
    for row in &rows {
        let number = |key: &str| row[key].as_f64().unwrap();
        // Of rounding alone no error is zero.
        let error = number("error");
        assert!(error > 0.0 && error <= number("requested"), "{row}");
        assert!(number("reference_error") < 0.1 * number("requested"), "{row}");
        assert!(number("cpu_s_per_s") > 0.0 && number("setup_cpu_s") > 0.0, "{row}");
    }
    let svg = fs::read_to_string(out.join("simulator.svg")).unwrap();
    assert!(svg.starts_with("<svg ") && svg.matches("<polyline ").count() == 2, "{svg}");
}

#[test]
fn hard_cases_are_a_table() {
    let dir = TempDir::new().unwrap();
    let mut command = support::command();
    let ended =
        support::run(command.args(["bench", "stability", "--quick", "--out"]).arg(dir.path()));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let rows = rows(dir.path(), "stability");
    assert!(rows.len() > 5 && rows.iter().all(|row| row["pass"] == true), "{rows:?}");
    let name = rows[0]["case"].as_str().unwrap();
    assert!(ended.stdout.contains(name), "{}", ended.stdout);
}

#[test]
fn what_cannot_be_measured_yet_ends_with_2() {
    for name in ["signal", "monitor"] {
        let ended = support::run(support::command().args(["bench", name]));
        assert_eq!(ended.status.code(), Some(2));
        assert!(ended.stderr.contains(&format!("bench {name}: not yet")), "{}", ended.stderr);
        assert_eq!(ended.stdout, "");
    }
    let ended =
        support::run(support::command().args(["bench", "stability", "--out", "/dev/null/x"]));
    assert_eq!(ended.status.code(), Some(2));
    assert!(ended.stderr.contains("/dev/null/x: cannot be made"), "{}", ended.stderr);
}
