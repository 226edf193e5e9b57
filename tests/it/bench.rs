//! `rotorwatch bench`: what it measures holds, and what it writes can be read.

use crate::support;
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;
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
    let page = fs::read_to_string(out.join("simulator.html")).unwrap();
    assert!(page.contains("<svg ") && page.contains("<th>cpu_s_per_s</th>"));
    methods_are_compared(&out);
    shapes_and_parts_have_their_price(&out);
    let svg = fs::read_to_string(out.join("simulator.svg")).unwrap();
    assert!(svg.starts_with("<svg ") && svg.matches("<polyline ").count() == 2, "{svg}");
}

/// The second table: each method at each step, and what is chosen.
fn methods_are_compared(out: &Path) {
    let rows = rows(out, "methods");
    let of = |name: &str| -> Vec<&Value> {
        rows.iter().filter(|row| row["method"].as_str().unwrap().starts_with(name)).collect()
    };
    for name in ["shipped", "ETDRK4", "RK4", "Newmark", "generalised", "extrapolation", "chosen"] {
        assert!(!of(name).is_empty(), "{name}");
    }
    for row in of("chosen") {
        assert!(row["error"].as_f64() <= row["automatic"].as_f64(), "{row}");
    }
    for row in &rows {
        assert!(row["cost_over_best"].as_f64() >= Some(1.0), "{row}");
    }
    assert!(fs::read_to_string(out.join("methods.html")).unwrap().contains("<svg "));
}

/// The third and the fourth: what shapes left out do, and what parts cost.
fn shapes_and_parts_have_their_price(out: &Path) {
    let shapes = rows(out, "shapes");
    let error = |row: &Value| row["error_sensors"].as_f64().unwrap();
    let with = |n: f64| shapes.iter().find(|row| row["modes"] == 10.0 && row["attachments"] == n);
    assert!(error(with(2.0).unwrap()) < 0.1 * error(with(0.0).unwrap()), "{shapes:?}");
    let chosen: Vec<&Value> = shapes.iter().filter(|row| row["automatic"].is_f64()).collect();
    assert!(!chosen.is_empty());
    for row in chosen {
        assert!(error(row) > 0.0 && Some(error(row)) <= row["automatic"].as_f64(), "{row}");
    }
    let parts = rows(out, "parts");
    assert!(parts.len() == 2 && parts[0]["cost_over_whole"] == 1.0, "{parts:?}");
    assert!(parts[1]["cost_over_whole"].as_f64() > Some(0.0), "{parts:?}");
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
    for row in &rows {
        assert!(!row["reason"].as_str().unwrap().is_empty(), "{row}");
        let (measured, tolerance) = (row["measured"].as_f64(), row["tolerance"].as_f64());
        assert!(measured <= tolerance, "{row}");
    }
    let of =
        |part: &str| rows.iter().filter(|r| r["case"].as_str().unwrap().contains(part)).count();
    assert!(of("at random") >= 2 && of("ends of ranges") >= 2 && of("and back") >= 3, "{rows:?}");
    let page = fs::read_to_string(dir.path().join("stability.html")).unwrap();
    let plot = fs::read_to_string(dir.path().join("stability.svg")).unwrap();
    assert!(plot.starts_with("<svg") && page.contains(&plot), "{plot}");
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("<th>reason</th>"), "{page}");
    assert!(!page.contains("http://") || !page.contains("<script"), "nothing from elsewhere");
}

#[test]
fn one_scene_of_the_search_can_be_had_again() {
    let dir = TempDir::new().unwrap();
    let mut command = support::command();
    command.args(["bench", "stability", "--scenes", "1", "--first-seed", "42", "--out"]);
    let ended = support::run(command.arg(dir.path()));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let rows = rows(dir.path(), "stability");
    assert!(rows.iter().all(|row| row["case"].as_str().unwrap().contains("at random")), "{rows:?}");
    let text = fs::read_to_string(dir.path().join("stability.json")).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(document["settings"]["first_seed"], 42);
    assert!(fs::read_to_string(dir.path().join("scene-42.toml")).unwrap().contains("[scene]"));
}

#[test]
fn every_transform_has_a_time_and_keeps_its_error() {
    let dir = TempDir::new().unwrap();
    let mut command = support::command();
    let ended = support::run(command.args(["bench", "signal", "--quick", "--out"]).arg(dir.path()));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let rows = rows(dir.path(), "signal");
    let mut n_errors = 0;
    for row in &rows {
        assert!(row["cpu_us"].as_f64().unwrap() > 0.0 && row["yardsticks"].as_f64().unwrap() > 0.0);
        let is_coarse = row["mode"].as_str().unwrap().ends_with("1e-3");
        let Some(error) = row["error"].as_f64() else {
            // A job of several transforms, or what f32 is held against.
            assert!(
                row["channels_a_core"].as_f64() > Some(0.0) || row["precision"] == "f64",
                "{row}"
            );
            continue;
        };
        let largest = row["limit"].as_f64().unwrap();
        assert!(
            largest <= if row["precision"] == "f32" || is_coarse { 1e-3 } else { 1e-10 },
            "{row}"
        );
        // One number may be the same in both.
        assert!((error > 0.0 || row["job"] == "speed") && error <= largest, "{row}");
        n_errors += 1;
    }
    assert!(rows.len() > 30 && n_errors > 25, "{}", rows.len());
    let svg = fs::read_to_string(dir.path().join("signal.svg")).unwrap();
    assert!(svg.starts_with("<svg ") && svg.matches("<polyline ").count() > 5, "{svg}");
}

#[test]
fn one_job_is_told_as_an_object() {
    let round = |name: &str| {
        support::run(support::command().args(["bench", "signal", "--quick", "--job", name]))
    };
    let ended = round("hann");
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let object: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(object["call_s"].as_f64().unwrap() > 0.0 && object["yardstick_s"].as_f64() > Some(0.0));
    let ended = round("hamm");
    assert_eq!(ended.status.code(), Some(2));
    assert!(ended.stderr.contains("there is no job hamm") && ended.stderr.contains("hann"));
}

#[test]
fn a_job_does_another_round_for_every_line() {
    let mut command = support::command();
    command.args(["bench", "signal", "--quick", "--job", "envelope"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"\n\n").unwrap();
    let ended = child.wait_with_output().unwrap();
    let told = String::from_utf8(ended.stdout).unwrap();
    assert!(ended.status.success() && told.lines().count() == 3, "{told}");
    for line in told.lines() {
        let round: Value = serde_json::from_str(line).unwrap();
        assert_eq!(round["job"], "envelope");
        assert!(round["call_s"].as_f64() > Some(0.0));
    }
}

#[test]
fn the_pipeline_has_throughput_latency_and_memory() {
    let dir = TempDir::new().unwrap();
    let mut command = support::command();
    let ended =
        support::run(command.args(["bench", "monitor", "--quick", "--out"]).arg(dir.path()));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let rows = rows(dir.path(), "monitor");
    assert_eq!(rows.len(), 2);
    for row in &rows {
        let number = |key: &str| row[key].as_f64().unwrap();
        assert!(number("verdicts") >= 1.0 && number("channels_a_core") > 1.0, "{row}");
        assert!(number("latency_p50_ms") <= number("latency_p99_ms"), "{row}");
        // 30 s of f32 at 10 kHz, and the list of runs.
        assert!(number("ring_kb_a_channel") >= 30.0 * 1e4 * 4.0 / 1024.0, "{row}");
    }
}

#[test]
fn a_streamed_load_is_counted_exactly() {
    for more in [&["--receive-only"][..], &[]] {
        let dir = TempDir::new().unwrap();
        let mut command = support::command();
        command.args(["bench", "monitor", "--channels", "5", "--seconds", "2"]).args(more);
        let ended = support::run(command.arg("--out").arg(dir.path()));
        assert_eq!(ended.status.code(), Some(0), "{}{}", ended.stdout, ended.stderr);
        let rows = rows(dir.path(), "live");
        let number = |key: &str| rows[0][key].as_f64().unwrap();
        // 5 channels of 10 kHz for 2 s.
        assert_eq!((number("sent"), number("used"), number("lost")), (1e5, 1e5, 0.0), "{rows:?}");
        assert_eq!(rows[0]["exact"], true);
        assert!(number("took_s") >= 2.0 && number("verdicts") >= 1.0, "{rows:?}");
    }
}

#[test]
fn a_folder_that_cannot_be_made_ends_with_2() {
    let ended =
        support::run(support::command().args(["bench", "stability", "--out", "/dev/null/x"]));
    assert_eq!(ended.status.code(), Some(2));
    assert!(ended.stderr.contains("/dev/null/x: cannot be made"), "{}", ended.stderr);
}
