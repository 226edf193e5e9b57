//! `rotorwatch diagnose`: verdicts on stdout, trouble on stderr, and what the exit code says.

use crate::impulses::Defect;
use crate::impulses::Scene;
use crate::impulses::files;
use crate::scene;
use crate::support;
use crate::support::Ended;
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

/// A folder with `machine.toml`, the damaged `inner.h5` and the `healthy.h5`, 5 s each.
fn folder() -> TempDir {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("machine.toml"), files::MACHINE).unwrap();
    for (name, scene) in
        [("inner.h5", Scene::with(Defect::InnerRace)), ("healthy.h5", Scene::healthy())]
    {
        files::write_capture(&dir.path().join(name), &scene, 1, 5.0).unwrap();
    }
    dir
}

/// `rotorwatch diagnose` in the folder.
fn diagnose(dir: &TempDir, arguments: &[&str]) -> Ended {
    let mut command = support::command();
    support::run(command.current_dir(dir.path()).arg("diagnose").args(arguments))
}

fn code(ended: &Ended) -> i32 {
    ended.status.code().unwrap()
}

/// The lines of stdout as documents, each valid by the published schema.
fn documents(ended: &Ended) -> Vec<Value> {
    let schema = include_str!("../../docs/schemas/diagnosis-1.schema.json");
    let schema: Value = serde_json::from_str(schema).unwrap();
    let validator = jsonschema::draft202012::new(&schema).unwrap();
    let lines = ended.stdout.lines();
    let documents: Vec<Value> = lines.map(|line| serde_json::from_str(line).unwrap()).collect();
    for document in &documents {
        let faults: Vec<String> = validator
            .iter_errors(document)
            .map(|e| format!("{}: {e}", e.instance_path()))
            .collect();
        assert!(faults.is_empty(), "{faults:#?}");
    }
    documents
}

#[test]
fn the_text_says_what_is_wrong_and_why() {
    let ended = diagnose(&folder(), &["--machine", "machine.toml", "inner.h5"]);
    assert_eq!((code(&ended), ended.stderr.as_str()), (0, ""), "{}", ended.stderr);
    for fact in [
        "inner.h5: DAMAGED\n",
        "machine: demo, 5 s, ",
        "from the tacho",
        "bearing drive-end: DAMAGED, inner race\n  severity ",
        "envelope_line_bpfi",
        "not judged: main",
        "shaft main: undetermined\n  no proximity probe",
    ] {
        assert!(ended.stdout.contains(fact), "{fact}\nnot in\n{}", ended.stdout);
    }
    assert!(!ended.stdout.contains('\u{1b}'), "no colour in a pipe");
    assert!(ended.stdout.lines().all(|line| line.chars().count() <= 100), "{}", ended.stdout);
}

#[test]
fn json_is_one_valid_document_a_line_and_nothing_else() {
    let arguments = ["--format", "json", "--machine", "machine.toml", "inner.h5", "healthy.h5"];
    let ended = diagnose(&folder(), &arguments);
    assert_eq!((code(&ended), ended.stderr.as_str()), (0, ""));
    let documents = documents(&ended);
    assert_eq!(documents.len(), 2);
    let bearing = |document: &Value| {
        let mut components = document["components"].as_array().unwrap().iter();
        components.find(|c| c["kind"] == "bearing").unwrap().clone()
    };
    assert_eq!(documents[0]["capture"], "inner.h5");
    assert_eq!(documents[0]["state"], "damaged");
    assert_eq!(bearing(&documents[0])["fault"], "inner_race");
    assert_eq!(documents[1]["capture"], "healthy.h5");
    assert_eq!(documents[1]["state"], "healthy");
    assert_eq!(bearing(&documents[1])["fault"], Value::Null);
}

#[test]
fn fail_on_decides_between_0_and_1() {
    let dir = folder();
    let with = |fail_on: &str, capture: &str| {
        let arguments = ["--machine", "machine.toml", "--fail-on", fail_on, capture];
        code(&diagnose(&dir, &arguments))
    };
    assert_eq!(with("damaged", "inner.h5"), 1);
    assert_eq!(with("warning", "inner.h5"), 1);
    assert_eq!(with("warning", "healthy.h5"), 0);
}

#[test]
fn one_bad_capture_does_not_hold_up_the_others() {
    let dir = folder();
    fs::write(dir.path().join("broken.h5"), b"\x89HDF\r\n\x1a\n and no more").unwrap();
    let captures = ["missing.h5", "inner.h5", "broken.h5", "healthy.h5"];
    let arguments = ["--format", "json", "--machine", "machine.toml", "--fail-on", "damaged"];
    let ended = diagnose(&dir, &[&arguments[..], &captures[..]].concat());
    assert_eq!(code(&ended), 2, "an error outranks --fail-on");
    let named: Vec<_> = documents(&ended).iter().map(|d| d["capture"].clone()).collect();
    assert_eq!(named, ["inner.h5", "healthy.h5"]);
    let errors: Vec<&str> = ended.stderr.lines().collect();
    assert_eq!(errors.len(), 2, "{}", ended.stderr);
    assert!(errors[0].starts_with("error: missing.h5: "), "{}", errors[0]);
    assert!(errors[0].contains("No such file"), "{}", errors[0]);
    assert!(errors[1].starts_with("error: broken.h5: "), "{}", errors[1]);
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn without_a_machine_only_levels_and_sensors_are_told() {
    let ended = diagnose(&folder(), &["--format", "json", "inner.h5"]);
    assert_eq!(code(&ended), 0, "{}", ended.stderr);
    let document = &documents(&ended)[0];
    assert_eq!(document["state"], "undetermined");
    assert_eq!(document["data_quality"], "ok");
}

#[test]
fn a_baseline_is_used_and_listed() {
    let dir = folder();
    let arguments = ["--machine", "machine.toml", "--baseline", "healthy.h5", "inner.h5"];
    let ended = diagnose(&dir, &arguments);
    assert_eq!(code(&ended), 0, "{}", ended.stderr);
    assert!(ended.stdout.contains("baselines\n  healthy.h5: used"), "{}", ended.stdout);
    let ended = diagnose(&dir, &["--baseline", "missing.h5", "inner.h5"]);
    assert_eq!((code(&ended), ended.stdout.as_str()), (2, ""));
    assert!(
        ended.stderr.contains("error: the baseline missing.h5 cannot be used: "),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_record_is_one_baseline_however_often_it_is_named_and_never_unseen_its_own() {
    let dir = folder();
    std::os::unix::fs::symlink(dir.path().join("healthy.h5"), dir.path().join("link.h5")).unwrap();
    let baselines = ["healthy.h5", "./healthy.h5", "link.h5", "healthy.h5"];
    let mut arguments = vec!["--format", "json", "--machine", "machine.toml"];
    arguments.extend(baselines.iter().flat_map(|file| ["--baseline", file]));
    let ended = diagnose(&dir, &[&arguments[..], &["inner.h5", "link.h5"]].concat());
    assert_eq!(code(&ended), 0, "{}", ended.stderr);
    let [other, own] = &documents(&ended)[..] else { panic!("{}", ended.stdout) };
    let listed = other["baselines"].as_array().unwrap();
    assert_eq!(listed.len(), 4, "{other}");
    assert!(!other["notes"].to_string().contains("baseline of 4 records"), "{other}");
    for again in &listed[1..] {
        assert_eq!(
            (&again["used"], &again["reason"]),
            (&false.into(), &"the same record as healthy.h5".into())
        );
    }
    assert!(!other["warnings"].to_string().contains("its own baseline"), "{other}");
    assert!(own["warnings"].to_string().contains("link.h5 is its own baseline"), "{own}");
}

#[test]
fn out_is_written_whole_and_stdout_stays_empty() {
    let dir = folder();
    let arguments =
        ["--format", "json", "--machine", "machine.toml", "--out", "verdict.jsonl", "inner.h5"];
    let ended = diagnose(&dir, &arguments);
    assert_eq!((code(&ended), ended.stdout.as_str()), (0, ""), "{}", ended.stderr);
    let text = fs::read_to_string(dir.path().join("verdict.jsonl")).unwrap();
    assert_eq!(text.lines().count(), 1);
    assert_eq!(serde_json::from_str::<Value>(&text).unwrap()["state"], "damaged");

    let ended = diagnose(&dir, &["--out", "verdict.jsonl", "missing.h5"]);
    assert_eq!(code(&ended), 2);
    let kept = fs::read_to_string(dir.path().join("verdict.jsonl")).unwrap();
    assert_eq!(kept, text, "nothing was diagnosed, nothing is replaced");
    let n_files = fs::read_dir(dir.path()).unwrap().count();
    assert_eq!(n_files, 4, "no temporary file remains");
}

#[test]
fn out_never_replaces_what_is_read() {
    let dir = folder();
    let before = fs::read(dir.path().join("inner.h5")).unwrap();
    let ended = diagnose(&dir, &["--out", "./inner.h5", "inner.h5"]);
    assert_eq!(code(&ended), 2);
    assert!(ended.stderr.contains("--out would replace a file that is read"), "{}", ended.stderr);
    assert_eq!(fs::read(dir.path().join("inner.h5")).unwrap(), before);
}

#[test]
fn every_mistake_of_the_machine_file_is_told_at_once() {
    let dir = folder();
    let text = "[machine]\nid = \"m\"\ncolour = 1\n[[shaft]]\nid = \"s\"\nspeed_hz = -3\n";
    fs::write(dir.path().join("bad.toml"), text).unwrap();
    let ended = diagnose(&dir, &["--machine", "bad.toml", "inner.h5"]);
    assert_eq!((code(&ended), ended.stdout.as_str()), (2, ""));
    for place in ["bad.toml:3:", "bad.toml:6:"] {
        assert!(ended.stderr.contains(place), "{place}\nnot in\n{}", ended.stderr);
    }
}

#[test]
fn files_given_for_each_other_are_told_apart() {
    let dir = folder();
    let ended = diagnose(&dir, &["--machine", "inner.h5", "healthy.h5"]);
    assert_eq!(code(&ended), 2);
    assert!(ended.stderr.contains("inner.h5: this is a capture, not a machine file"));
    let ended = diagnose(&dir, &["machine.toml"]);
    assert_eq!(code(&ended), 2);
    let hint = "error: machine.toml: this is a machine file, not a capture: name it with --machine";
    assert!(ended.stderr.contains(hint), "{}", ended.stderr);
}

#[test]
fn a_speed_that_is_none_is_refused() {
    let dir = folder();
    for speed in ["0", "-10", "nan", "inf", "fast"] {
        let ended = diagnose(&dir, &[&format!("--speed={speed}"), "inner.h5"]);
        assert_eq!((code(&ended), ended.stdout.as_str()), (2, ""), "{speed}");
        assert!(ended.stderr.contains("not a number above 0"), "{}", ended.stderr);
    }
}

#[test]
fn a_reader_that_is_gone_is_no_error() {
    let dir = folder();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = support::command();
    let command = command.current_dir(dir.path()).stdout(writer);
    let ended = command.args(["diagnose", "inner.h5", "missing.h5"]).output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!((ended.status.code(), stderr.as_str()), (Some(0), ""), "it stops, as `head` asks");
}

#[test]
fn a_speed_that_nothing_confirms_acquits_no_bearing_of_which_another_speed_shows_a_line() {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("rig.toml"), scene::MACHINE).unwrap();
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    // One line at 1x is no comb, so the speed stays as it is said.
    let right_at = |speed: f64| {
        let said = speed.to_string();
        let ended = diagnose(
            &dir,
            &["--format", "json", "--machine", "rig.toml", "--speed", &said, "x.h5"],
        );
        let document = documents(&ended).remove(0);
        let components = document["components"].as_array().unwrap();
        components.iter().find(|c| c["id"] == "right").unwrap().clone()
    };
    let low = right_at(0.975 * scene::SPEED_HZ);
    assert_eq!(low["state"], "undetermined", "{low:#}");
    let why = low["why"].as_str().unwrap();
    assert!(why.contains("measure the speed") && why.contains("BPFI"), "{why}");
    let evidence = low["evidence"].as_array().unwrap();
    assert!(evidence.iter().any(|e| e["value"].as_f64().is_some_and(|v| v > 1.0)), "{low:#}");
    // Slip reaches 2 % down.
    for near in [scene::SPEED_HZ, 1.015 * scene::SPEED_HZ] {
        assert_eq!(right_at(near)["fault"], "inner_race", "{near} Hz");
    }
}
