//! Every example with curl in the README and the documents, run as printed against a demonstration.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::browser::Demo;
use crate::browser::skipped;
use crate::fences::fenced;
use crate::support;
use serde_json::Value;
use std::fs;
use std::process::Command;
use std::process::Output;
use tempfile::TempDir;

/// What an example asks for that a demonstration of a minute does not have: part of the command, and what is said then.
const NOT_THERE: [(&str, &str); 4] = [
    ("\"windows\": 60", "windows"),
    ("\"from\": \"2026-05-04T08:00:00Z\"", "window"),
    ("baselines/343e1662793c64bf6f0d3597ba446f18", "no baseline"),
    ("recordings/rig-1-00000001.h5", "recording"),
];

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

/// Runs a command as a reader of the document would, with another address and in a folder of its own.
fn run(command: &str, url: &str, folder: &TempDir) -> Output {
    let command = command.replace("http://127.0.0.1:8080", url);
    let mut shell = Command::new("sh");
    shell.args(["-c", &command]).current_dir(folder.path());
    shell.env("CURL_HOME", folder.path()).env("TOKEN", "none").output().unwrap()
}

#[test]
#[ignore = "needs curl, and a minute of a simulated rig in real time; run by .ci/run"]
fn every_example_with_curl_does_what_it_says() {
    let test = "every_example_with_curl_does_what_it_says";
    if Command::new("curl").arg("--version").output().is_err() {
        return skipped(test, "no curl");
    }
    let demo = Demo::start("GG_GS_BB");
    let folder = TempDir::new().unwrap();
    // Streams of events do not end; an answer of 400 or above ends curl with 22, and its body is printed all the same.
    fs::write(folder.path().join(".curlrc"), "fail-with-body\nmax-time = 5\n").unwrap();
    let get = |path: &str| -> Value {
        let mut answer = ureq::get(format!("{}{path}", demo.url)).call().unwrap();
        serde_json::from_str(&answer.body_mut().read_to_string().unwrap()).unwrap()
    };
    // What the examples speak of: an alarm, its capture, a verdict, a window on the disk.
    for _ in 0..6 {
        let has_capture = || {
            let captures = get("/api/v1/captures?alarm=rig-1:1");
            (captures["items"][0]["state"] == "complete").then_some(())
        };
        let found = std::panic::catch_unwind(|| {
            support::wait_until("the alarm and its capture", has_capture)
        });
        if found.is_ok() {
            break;
        }
    }
    let mut n = 0;
    let mut documents = vec!["README.md".into()];
    documents.extend(fs::read_dir("docs").unwrap().map(|entry| entry.unwrap().path()));
    documents.retain(|path: &std::path::PathBuf| path.extension().is_some_and(|end| end == "md"));
    documents.sort();
    // The acts of README come last: another scenario changes what the others speak of.
    documents.reverse();
    for document in documents {
        let text = fs::read_to_string(&document).unwrap();
        for command in fenced(&text, "sh").iter().flat_map(|block| commands(block)) {
            let done = run(&command, &demo.url, &folder);
            let told = String::from_utf8_lossy(&done.stdout).into_owned();
            let place = format!(
                "{}: {command}\n{told}{}",
                document.display(),
                String::from_utf8_lossy(&done.stderr)
            );
            let absent = NOT_THERE.iter().find(|(part, _)| command.contains(part));
            let expected = match (absent, command.contains("-sN")) {
                (Some(_), _) => 22,
                // Its time was over: it was still being told.
                (None, true) => 28,
                (None, false) => 0,
            };
            assert_eq!(done.status.code(), Some(expected), "{place}");
            if let Some((_, words)) = absent {
                let problem: Value = serde_json::from_str(&told).unwrap();
                assert!(problem["detail"].as_str().unwrap().contains(words), "{place}");
            } else if expected == 28 {
                assert!(told.contains("event: begin") || told.contains("event: reset"), "{place}");
            }
            n += 1;
        }
    }
    println!("{n} examples with curl");
    assert!(n > 35, "{n}");
}
