//! `rotorwatch check`, `openapi`, `completions`, `man`: what they print and how they end.

use crate::impulses::Scene;
use crate::impulses::files;
use crate::support;
use crate::support::Ended;
use std::fs;
use tempfile::TempDir;

fn check(dir: &TempDir, arguments: &[&str]) -> Ended {
    let mut command = support::command();
    support::run(command.current_dir(dir.path()).arg("check").args(arguments))
}

/// A folder with a right machine file, capture and configuration.
fn folder() -> TempDir {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"machine.toml\"\n\
                  [[source]]\nkind = \"replay\"\nmachine = \"demo\"\nfile = \"x.h5\"\nspeed = 2\n";
    let dir = support::folder(config, &[("machine.toml", files::MACHINE.as_bytes())]);
    files::write_capture(&dir.path().join("x.h5"), &Scene::healthy(), 1, 1.0).unwrap();
    dir
}

#[test]
fn content_decides_what_a_file_is() {
    let dir = folder();
    let ended = check(&dir, &["machine.toml", "x.h5", "serve.toml"]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
    for fact in [
        "machine.toml: machine file\n  demo: 1 shaft, 1 bearing, 3 sensors, 1 x/y pair\n",
        "x.h5: capture, ",
        "channel drive_x: 12000 samples at 12000 Hz",
        "all 36000 samples can be read",
        "serve.toml: configuration, http on 127.0.0.1:0, 1 machine\n",
        "x.h5 at 2 times real time",
    ] {
        assert!(ended.stdout.contains(fact), "{fact}\nnot in\n{}", ended.stdout);
    }
}

#[test]
fn rings_that_do_not_fit_are_refused_as_serve_refuses_them() {
    let dir = folder();
    let config = fs::read_to_string(dir.path().join("serve.toml")).unwrap();
    let small = format!("[pipeline]\nmemory_limit_bytes = 1000000\n{config}");
    fs::write(dir.path().join("small.toml"), small).unwrap();
    let checked = check(&dir, &["small.toml"]);
    assert_eq!(checked.status.code(), Some(2), "{}", checked.stderr);
    let told = "memory_limit_bytes is 1000000: raise it, shorten ring_seconds";
    assert!(checked.stderr.contains(told), "{}", checked.stderr);
    let mut serve = support::command();
    let served =
        support::run(serve.current_dir(dir.path()).args(["serve", "--config", "small.toml"]));
    assert_eq!(served.status.code(), Some(2));
    assert!(served.stderr.contains(checked.stderr.trim()), "{}", served.stderr);
}

#[test]
fn trends_that_do_not_fit_are_refused_as_serve_refuses_them() {
    let dir = folder();
    let config = fs::read_to_string(dir.path().join("serve.toml")).unwrap();
    let small = format!("[captures]\nenabled = false\n[store]\nmax_bytes = 10000000\n{config}");
    fs::write(dir.path().join("small.toml"), small).unwrap();
    let checked = check(&dir, &["small.toml"]);
    assert_eq!(checked.status.code(), Some(2), "{}", checked.stderr);
    let told = "the trends of 3 channels will take about";
    assert!(checked.stderr.contains(told), "{}", checked.stderr);
    assert!(!dir.path().join("data").exists(), "checking makes nothing");
    let mut serve = support::command();
    let served =
        support::run(serve.current_dir(dir.path()).args(["serve", "--config", "small.toml"]));
    assert_eq!(served.status.code(), Some(2));
    assert!(served.stderr.contains(checked.stderr.trim()), "{}", served.stderr);
}

#[test]
fn every_mistake_in_every_file_is_told_with_its_place() {
    let dir = folder();
    let write = |name: &str, text: &[u8]| fs::write(dir.path().join(name), text).unwrap();
    write("bad.toml", b"[machine]\nid = 'm'\n[[shaft]]\nid = 's'\nspeed_hz = -3\nx = 1\n");
    write("serve-bad.toml", b"[server]\nport = 1\n[pipeline]\nworkers = 'all'\n");
    write("cut.h5", &fs::read(dir.path().join("x.h5")).unwrap()[..30_000]);
    write("notes.txt", b"no TOML of ours\n");
    let files = ["bad.toml", "serve-bad.toml", "cut.h5", "notes.txt", "none", "machine.toml"];
    let ended = check(&dir, &files);
    assert_eq!(ended.status.code(), Some(2));
    for mistake in [
        "bad.toml:5:12: shaft[0].speed_hz: found -3, allowed: a number above 0",
        "bad.toml:6:",
        "serve-bad.toml:2:1: server.port: unknown key",
        "serve-bad.toml:4:1: pipeline.workers",
        "error: cut.h5: truncated",
        "error: notes.txt: this is a text file without a table",
        "error: none: cannot be read: No such file",
    ] {
        assert!(ended.stderr.contains(mistake), "{mistake}\nnot in\n{}", ended.stderr);
    }
    assert!(ended.stdout.starts_with("machine.toml: machine file"), "{}", ended.stdout);
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn frequencies_are_listed_at_the_speed_asked_for() {
    let dir = folder();
    let ended = check(&dir, &["--frequencies", "machine.toml"]);
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    assert!(ended.stdout.contains("lines at 25.0000 Hz (1500.0 r/min) of main"));
    assert!(ended.stdout.contains("0.1 Hz is the bin width of a record of 10.000 s"));
    let arguments = ["--frequencies", "--speed", "10", "--resolution", "0.5", "machine.toml"];
    let ended = check(&dir, &arguments);
    let bpfi = ended.stdout.lines().find(|line| line.contains("  BPFI ")).unwrap();
    // SKF 6205: 5.4152 ×.
    assert!(bpfi.contains("54.15") && bpfi.contains("5.4152"), "{bpfi}");
    assert!(ended.stdout.contains("0.5 Hz"), "{}", ended.stdout);
    let text = "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\n";
    fs::write(dir.path().join("slow.toml"), text).unwrap();
    let ended = check(&dir, &["--frequencies", "slow.toml"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(ended.stderr.contains("slow.toml: no speed is known"), "{}", ended.stderr);
}

#[test]
fn the_committed_documents_are_those_printed() {
    let print = |arguments: &[&str]| {
        let ended = support::run(support::command().arg("openapi").args(arguments));
        assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
        ended.stdout
    };
    assert_eq!(print(&[]), include_str!("../golden/openapi.json"));
    let schema = include_str!("../../docs/schemas/diagnosis-1.schema.json");
    assert_eq!(print(&["--schema", "diagnosis"]), schema);
}

#[test]
fn bearings_are_found_or_end_with_2() {
    let of = |arguments: &[&str]| support::run(support::command().arg("bearings").args(arguments));
    let found = of(&["--speed", "10", "SKF 6205-2RSH/C3"]);
    assert!(found.status.success() && found.stdout.contains("35.722 Hz"), "{}", found.stdout);
    let json = of(&["--format", "json", "NTN", "7205B"]);
    let document: serde_json::Value = serde_json::from_str(&json.stdout).unwrap();
    assert_eq!(document["bearings"][0]["designation"], "7205B");
    let none = of(&["6225"]);
    assert_eq!((none.status.code(), none.stdout.as_str()), (Some(2), ""));
    assert!(none.stderr.contains("nearest: 6205, 6215, 6220"), "{}", none.stderr);
}

#[test]
fn every_command_has_help_a_page_and_completions() {
    let of = |arguments: &[&str]| support::run(support::command().args(arguments));
    for command in
        ["diagnose", "check", "bearings", "serve", "demo", "openapi", "completions", "man"]
    {
        let help = of(&[command, "--help"]);
        assert!(help.status.success() && help.stdout.contains("Examples:"), "{}", help.stdout);
        let page = of(&["man", command]);
        assert!(page.status.success(), "{}", page.stderr);
        assert!(page.stdout.contains(&format!("rotorwatch\\-{command}")), "{}", page.stdout);
    }
    let bash = of(&["completions", "bash"]);
    assert!(bash.status.success() && bash.stdout.contains("--fail-on"), "{}", bash.stdout);
    let none = of(&["man", "fly"]);
    assert_eq!(none.status.code(), Some(2));
    assert!(none.stderr.contains("no command \"fly\", there are: diagnose, "), "{}", none.stderr);
}
