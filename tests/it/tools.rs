//! What others say of the built daemon: Prometheus of its metrics and rules, Schemathesis of its interface.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use std::io::Write;
use std::process::Command;
use std::process::Stdio;

/// A machine with a verdict and alarms.
fn daemon() -> Daemon {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n\
                  [[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = \"max\"\n";
    let dir = support::folder(config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    daemon
}

/// Whether a tool is there; says so if not.
#[expect(clippy::print_stdout, reason = "says that it skips")]
fn is_there(test: &str, tool: &str, advice: &str) -> bool {
    let found =
        Command::new(tool).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if found.is_err() {
        println!("SKIPPED {test}: {tool} is not installed; {advice}");
    }
    found.is_ok()
}

#[test]
#[ignore = "needs promtool, of Debian's package prometheus"]
fn promtool_finds_nothing_against_metrics_and_rules() {
    let name = "promtool_finds_nothing_against_metrics_and_rules";
    if !is_there(name, "promtool", "apt-get install prometheus") {
        return;
    }
    let rules = support::run(
        Command::new("promtool")
            .args(["check", "rules", "deploy/prometheus-alerts.yml"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped()),
    );
    assert!(rules.status.success(), "{}{}", rules.stdout, rules.stderr);
    let daemon = daemon();
    // promtool reads the older format, which is given to who asks for it.
    let metrics = daemon.get_text_as("/metrics", "text/plain");
    let mut child = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(metrics.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    assert_eq!(told.trim(), "", "{told}");
}

#[test]
#[ignore = "needs schemathesis, of Python's package index, and takes minutes"]
fn schemathesis_finds_no_fault_of_the_daemon_and_no_answer_beside_the_document() {
    let name = "schemathesis_finds_no_fault_of_the_daemon_and_no_answer_beside_the_document";
    let tool = std::env::var("SCHEMATHESIS").unwrap_or_else(|_| "schemathesis".to_owned());
    if !is_there(name, &tool, "pip install schemathesis, or name it in SCHEMATHESIS") {
        return;
    }
    let daemon = daemon();
    let document = format!("{}/api/v1/openapi.json", daemon.base_url);
    let ran = support::run(
        Command::new(tool)
            .args([
                "run",
                "--checks",
                "not_a_server_error,response_schema_conformance,content_type_conformance",
            ])
            .args([
                "--max-examples",
                "20",
                "--seed",
                "1",
                "--request-timeout",
                "15",
                "--workers",
                "1",
            ])
            // Streams that do not end, and a protocol that is not HTTP.
            .args(["--exclude-path", "/api/v1/events", "--exclude-path", "/api/v1/ingest"])
            .arg(document)
            // It keeps what it found where it runs.
            .current_dir(daemon.dir.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped()),
    );
    assert!(ran.status.success(), "{}{}", ran.stdout, ran.stderr);
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
#[ignore = "needs systemd-analyze, of Debian's package systemd"]
fn systemd_takes_the_unit_and_finds_it_hardened() {
    let name = "systemd_takes_the_unit_and_finds_it_hardened";
    if !is_there(name, "systemd-analyze", "apt-get install systemd") {
        return;
    }
    let dir = tempfile::TempDir::new().unwrap();
    let unit = dir.path().join("rotorwatch.service");
    let text = std::fs::read_to_string("deploy/rotorwatch.service").unwrap();
    // The program is looked for where it would be installed.
    let text = text.replace("/usr/local/bin/rotorwatch", env!("CARGO_BIN_EXE_rotorwatch"));
    std::fs::write(&unit, text).unwrap();
    let analyze = |arguments: &[&str]| {
        let mut command = Command::new("systemd-analyze");
        command.args(arguments).arg(&unit).stdout(Stdio::piped()).stderr(Stdio::piped());
        support::run(&mut command)
    };
    let verified = analyze(&["verify", "--man=no"]);
    assert!(verified.status.success(), "{}", verified.stderr);
    assert_eq!(verified.stderr.trim(), "");
    // Exposure of 10 is a unit without any guard; 2 and below is called well protected.
    let secured = analyze(&["security", "--offline=true", "--threshold=20"]);
    assert!(secured.status.success(), "{}", secured.stdout);
}
