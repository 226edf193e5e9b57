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

#[test]
fn the_verdict_follows_the_address_and_http_agrees() {
    let dir = TempDir::new().unwrap();
    let mut running = Demo::start(&mut demo(&dir, &["--bind", "127.0.0.1:0"]));
    let first = running.line();
    let url = first.strip_prefix("listening on ").unwrap().to_owned();
    assert!(url.starts_with("http://127.0.0.1:"), "{first}");
    assert!(running.line().contains("closed-form impulses, not a rig simulation"));
    assert_eq!(n_files(&dir), 1, "the temporary folder");
    let verdict = running.line();
    assert!(
        verdict.starts_with("verdict: machine demo is damaged: bearing drive-end, inner race, "),
        "{verdict}"
    );
    let (_, ask) = verdict.split_once("curl ").unwrap();
    assert_eq!(ask, format!("{url}/api/v1/machines/demo/diagnosis"));
    let answer = ureq::get(ask).call().unwrap().body_mut().read_to_string().unwrap();
    let document: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(document["state"], "damaged");
    assert_eq!(running.signal("INT"), Some(0));
    assert_eq!(n_files(&dir), 0, "the temporary folder is gone");
}

#[test]
fn a_named_folder_keeps_files_that_the_other_commands_take() {
    let dir = TempDir::new().unwrap();
    let files = dir.path().join("files");
    let kept = files.to_str().unwrap();
    let mut running = Demo::start(&mut demo(&dir, &["--bind", "127.0.0.1:0", "--dir", kept]));
    assert!(running.line().starts_with("listening on "));
    assert_eq!(running.signal("TERM"), Some(0));
    let mut check = support::command();
    let names = ["demo-machine.toml", "demo-rotorwatch.toml", "demo-signal.h5"];
    let ended = support::run(check.current_dir(&files).arg("check").args(names));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
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
