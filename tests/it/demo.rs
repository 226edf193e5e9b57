//! `rotorwatch demo`: address first, then the verdict, over HTTP too, until a signal.

use crate::support;
use serde_json::Value;
use std::fs;
use std::io::BufRead;
use std::io::BufReader;
use std::net::TcpListener;
use std::process::Child;
use std::process::ChildStdout;
use std::process::Command;
use tempfile::TempDir;

/// A demonstration that is killed if a test fails.
struct Demo {
    child: Child,
    lines: std::io::Lines<BufReader<ChildStdout>>,
}

impl Demo {
    fn start(command: &mut Command) -> Self {
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    /// The next line; ends by itself: with the line, or with the process.
    fn line(&mut self) -> String {
        self.lines.next().unwrap().unwrap()
    }

    /// Sends a signal and waits for the end.
    fn signal(mut self, name: &str) -> Option<i32> {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &pid]).status().unwrap().success());
        support::wait_until("the end", || self.child.try_wait().unwrap()).code()
    }
}

impl Drop for Demo {
    fn drop(&mut self) {
        // Already ended: nothing to kill.
        let _ended = self.child.kill();
        let _ended = self.child.wait();
    }
}

/// `rotorwatch demo` whose temporary files come into `dir`; the log is not read.
fn demo(dir: &TempDir, arguments: &[&str]) -> Command {
    let mut command = support::command();
    command.env("TMPDIR", dir.path()).stderr(std::process::Stdio::null());
    command.arg("demo").args(arguments);
    command
}

fn n_files(dir: &TempDir) -> usize {
    fs::read_dir(dir.path()).unwrap().count()
}

/// The demonstration's address, and what its first lines say.
fn address(running: &mut Demo) -> String {
    let first = running.line();
    let url = first.strip_prefix("listening on ").unwrap().to_owned();
    assert!(url.starts_with("http://127.0.0.1:"), "{first}");
    assert!(running.line().contains("the simulated rig runs live, scenario "));
    let command = running.line();
    assert!(command.ends_with(&format!("{url}/api/v1/simulation/scenario")), "{command}");
    url
}

fn get(url: &str) -> Value {
    let answer = ureq::get(url).call().unwrap().body_mut().read_to_string().unwrap();
    serde_json::from_str(&answer).unwrap()
}

#[test]
fn the_address_comes_first_and_a_named_folder_keeps_what_the_other_commands_take() {
    let dir = TempDir::new().unwrap();
    let files = dir.path().join("files");
    let kept = files.to_str().unwrap();
    let arguments = ["--bind", "127.0.0.1:0", "--dir", kept, "--scenario", "BG_BS_BB"];
    let mut running = Demo::start(&mut demo(&dir, &arguments));
    let url = address(&mut running);
    let list = get(&format!("{url}/api/v1/simulation/scenario"));
    let simulation = &list["items"][0];
    assert_eq!(
        (&simulation["machine"], &simulation["scenario"]),
        (&"rig-1".into(), &"BG_BS_BB".into())
    );
    assert_eq!(simulation["scenarios"].as_array().unwrap().len(), 8, "{simulation}");
    let faults: Vec<_> =
        simulation["present"].as_array().unwrap().iter().map(|f| f["fault"].clone()).collect();
    assert_eq!(faults, ["inner_race", "bow", "tooth_damage"]);
    assert_eq!(simulation["speed"], 1.0);
    assert_eq!(running.signal("TERM"), Some(0));
    let mut check = support::command();
    let names = ["demo-machine.toml", "demo-rotorwatch.toml", "demo-reference.h5"];
    let ended = support::run(check.current_dir(&files).arg("check").args(names));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    assert!(
        ended.stdout.contains("simulated scene GG_GS_GB at 1 times real time"),
        "{}",
        ended.stdout
    );
}

#[test]
fn a_scenario_that_is_none_is_an_error_at_once() {
    let dir = TempDir::new().unwrap();
    let mut command = demo(&dir, &["--scenario", "BG_GS"]);
    let ended = support::run(command.stderr(std::process::Stdio::piped()));
    assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(2), ""));
    assert!(
        ended.stderr.contains("GG_BS_BB, BG_GS_GB, BG_GS_BB, BG_BS_GB, BG_BS_BB"),
        "{}",
        ended.stderr
    );
    assert_eq!(n_files(&dir), 0);
}

/// Waits for the next verdict that is printed and for HTTP to agree; gives the accused, sorted.
fn next_accused(running: &mut Demo, url: &str) -> Vec<(String, String)> {
    let line = running.line();
    assert!(line.starts_with("verdict: machine rig-1 is "), "{line}");
    let document = get(&format!("{url}/api/v1/machines/rig-1/diagnosis"));
    let components = document["components"].as_array().unwrap().iter();
    let accused =
        components.filter(|c| ["warning", "damaged"].contains(&c["state"].as_str().unwrap()));
    let text = |value: &Value| value.as_str().unwrap_or("unknown").to_owned();
    let mut accused: Vec<_> = accused.map(|c| (text(&c["id"]), text(&c["fault"]))).collect();
    accused.sort();
    accused
}

#[test]
#[ignore = "takes four minutes: the rig runs in real time"]
fn the_verdict_follows_the_scenario_within_half_a_minute_and_heals() {
    let dir = TempDir::new().unwrap();
    let mut running = Demo::start(&mut demo(&dir, &["--bind", "127.0.0.1:0"]));
    let url = address(&mut running);
    assert_eq!(n_files(&dir), 1, "the temporary folder");
    assert_eq!(next_accused(&mut running, &url), []);
    let path = format!("{url}/api/v1/simulation/scenario");
    let bearing = ("right".to_owned(), "inner_race".to_owned());
    let bow = ("main".to_owned(), "bow".to_owned());
    let tooth = ("mesh-1".to_owned(), "tooth_damage".to_owned());
    for (scenario, expected) in [
        ("GG_GS_BB", vec![bearing.clone()]),
        ("GG_BS_BB", vec![bow.clone(), bearing.clone()]),
        ("GG_BS_GB", vec![bow.clone()]),
        ("GG_GS_GB", vec![]),
        ("BG_GS_GB", vec![tooth.clone()]),
        ("BG_BS_GB", vec![bow.clone(), tooth.clone()]),
        ("BG_BS_BB", vec![bow, tooth.clone(), bearing.clone()]),
        ("BG_GS_BB", vec![tooth, bearing]),
        ("GG_GS_GB", vec![]),
    ] {
        let body = serde_json::json!({ "scenario": scenario });
        let mut answer = ureq::post(&path).send_json(&body).unwrap();
        let text = answer.body_mut().read_to_string().unwrap();
        let asked: Value = serde_json::from_str(&text).unwrap();
        // What is said on the way, of windows that saw both, may be less than the whole.
        while next_accused(&mut running, &url) != expected {}
        let now = get(&path)["items"][0].clone();
        let took_s = now["simulated_s"].as_f64().unwrap() - asked["since_s"].as_f64().unwrap();
        assert!(took_s < 30.0, "{scenario} after {took_s} s of the stream");
    }
    assert_eq!(running.signal("INT"), Some(0));
    assert_eq!(n_files(&dir), 0, "the temporary folder is gone");
}

#[test]
fn a_taken_default_port_gives_way_to_a_free_one() {
    let dir = TempDir::new().unwrap();
    // Fails if somebody else has it: then it is taken as well.
    let _taken = TcpListener::bind("127.0.0.1:8080");
    let mut running = Demo::start(&mut demo(&dir, &[]));
    let first = running.line();
    let port = first.strip_prefix("listening on http://127.0.0.1:").unwrap();
    assert_ne!(port, "8080");
    assert_eq!(running.signal("TERM"), Some(0));
}

#[test]
fn an_address_asked_for_that_is_taken_is_an_error() {
    let dir = TempDir::new().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut command = demo(&dir, &["--bind", &address]);
    let ended = support::run(command.stderr(std::process::Stdio::piped()));
    assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(2), ""));
    assert!(ended.stderr.contains(&address), "{}", ended.stderr);
    assert_eq!(n_files(&dir), 0);
}
