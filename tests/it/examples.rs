//! Every example with curl in the README, the documents and the help of `demo`, run as printed against the demonstration.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::browser::Demo;
use crate::browser::skipped;
use crate::fences::fenced;
use crate::support;
use crate::support::Daemon;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use std::process::Command;
use std::process::Output;
use std::time::Duration;
use tempfile::TempDir;

/// What the examples speak of and a demonstration does not have in a minute: 60 windows, a recording that has ended.
const MORE: &str = "\n[server]\nbind = \"127.0.0.1:0\"\n[pipeline]\nhop_seconds = 0.5\n\
                    [recording]\nenabled = true\nsegment_seconds = 20.0\n";

/// Longest wait for it, on a loaded computer too.
const LIMIT: Duration = Duration::from_secs(180);

/// How curl ends when its time is over.
const TIME_IS_OVER: i32 = 28;

/// Commands of a block that begin with `curl`, each with its further lines.
fn commands(block: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut is_open = false;
    for line in block.lines() {
        if line.starts_with("curl ") {
            found.push(line.to_owned());
            is_open = true;
        } else if line.is_empty() || line.starts_with("rotorwatch ") || line.starts_with('#') {
            is_open = false;
        } else if let Some(last) = found.last_mut().filter(|_| is_open) {
            last.push('\n');
            last.push_str(line);
        }
    }
    found
}

/// Everything that is printed, with its place; the README last: another scenario changes what the rest speaks of.
fn examples() -> Vec<(String, String)> {
    let mut files: Vec<PathBuf> =
        fs::read_dir("docs").unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|end| end == "md"));
    files.sort();
    files.push("README.md".into());
    let mut found = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let blocks = fenced(&text, "sh");
        let all = blocks.iter().flat_map(|block| commands(block));
        found.extend(all.map(|command| (file.display().to_string(), command)));
    }
    let help = support::run(support::command().args(["demo", "--help"])).stdout;
    let lines: Vec<&str> = help.lines().map(|line| line.strip_prefix("  ").unwrap_or("")).collect();
    found.extend(commands(&lines.join("\n")).into_iter().map(|c| ("demo --help".to_owned(), c)));
    found
}

/// The demonstration, with what the examples need, after a minute of it.
fn demonstration() -> Daemon {
    let dir = TempDir::new().unwrap();
    drop(Demo::kept(dir.path(), "GG_GS_BB"));
    let file = dir.path().join("demo-rotorwatch.toml");
    fs::write(dir.path().join("serve.toml"), fs::read_to_string(file).unwrap() + MORE).unwrap();
    // What it found before it was ended is not this one's.
    fs::remove_dir_all(dir.path().join("data")).unwrap();
    let daemon = Daemon::start_in(dir);
    support::wait_within(LIMIT, "the capture of the first alarm", || {
        let (_, captures) = daemon.get_json("/api/v1/captures?alarm=rig-1:1");
        (captures["items"][0]["state"] == "complete").then_some(())
    });
    support::wait_within(LIMIT, "60 windows", || {
        let n = daemon.metric("rotorwatch_windows_judged_total{machine=\"rig-1\"}")?;
        (n >= 60.0).then_some(())
    });
    support::wait_within(LIMIT, "a recording that has ended", || {
        let (_, list) = daemon.get_json("/api/v1/machines/rig-1/recordings");
        list["items"].as_array()?.iter().find(|one| one["state"] == "finished").map(|_| ())
    });
    daemon
}

/// Runs a command as a reader would, in a folder, with another address.
fn run(command: &str, url: &str, folder: &Path) -> Output {
    // An answer of 400 or above ends curl with 22, its body is shown all the same; a stream of events has no end.
    let seconds = if is_endless(command) { 2 } else { 60 };
    let settings = format!("fail-with-body\nshow-error\nmax-time = {seconds}\n");
    fs::write(folder.join(".curlrc"), settings).unwrap();
    // The README's own daemon listens beside the demonstration's port.
    let command = ["http://127.0.0.1:8080", "http://127.0.0.1:8081"]
        .iter()
        .fold(command.to_owned(), |command, printed| command.replace(printed, url));
    let mut shell = Command::new("sh");
    shell.args(["-c", &command]).current_dir(folder);
    shell.env("CURL_HOME", folder).env("TOKEN", "none").output().unwrap()
}

fn is_endless(command: &str) -> bool {
    command.starts_with("curl -sN ")
}

#[test]
#[ignore = "needs curl and jq, and a minute of a simulated rig in real time; run by .ci/run"]
fn every_example_with_curl_does_what_it_says() {
    let test = "every_example_with_curl_does_what_it_says";
    for tool in ["curl", "jq"] {
        if Command::new(tool).arg("--version").output().is_err() {
            return skipped(test, &format!("no {tool}"));
        }
    }
    let daemon = demonstration();
    let folder = TempDir::new().unwrap();
    let examples = examples();
    for (place, command) in &examples {
        let done = run(command, &daemon.base_url, folder.path());
        let told = String::from_utf8_lossy(&done.stdout);
        let why = format!("{place}: {command}\n{told}{}", String::from_utf8_lossy(&done.stderr));
        let expected = if is_endless(command) { TIME_IS_OVER } else { 0 };
        assert_eq!(done.status.code(), Some(expected), "{why}");
        if is_endless(command) {
            assert!(told.contains("event: begin") || told.contains("event: reset"), "{why}");
        }
    }
    println!("{} examples with curl", examples.len());
    assert!(examples.len() > 35, "{}", examples.len());
    for file in ["samples.f32", "rig-1-00000001.h5", "recording.h5"] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 10_000, "{file}");
    }
}
