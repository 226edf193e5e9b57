//! `rotorwatch status`: how a running daemon and its machines are doing, on one screen.

use super::alarms::Format;
use super::client::Api;
use super::client::AskError;
use super::client::DaemonArguments;
use super::client::shown;
use clap::Args;
use serde_json::Value;
use serde_json::json;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch status
  rotorwatch status --url https://monitor.example.org:8080 --ca-file plant-ca.pem --token-file wall.token
  rotorwatch status --format json

Exit codes: 0 the daemon does its work; 2 it does not, no data come of a machine, or it does not answer.";

/// Arguments of `status`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The daemon.
    #[command(flatten)]
    pub daemon: DaemonArguments,
    /// How the answer is written.
    #[arg(long, value_enum, default_value = "text", value_name = "FORMAT")]
    pub format: Format,
}

/// Asks and prints.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match ask(&arguments.daemon) {
        Ok(status) => {
            let is_well = is_well(&status);
            let text = match arguments.format {
                Format::Text => text(&status),
                Format::Json => format!("{status:#}\n"),
            };
            let printed = super::print(text.as_bytes());
            if is_well { printed } else { ExitCode::from(super::EXIT_ERROR) }
        }
        Err(error) => super::fail(&error),
    }
}

fn ask(daemon: &DaemonArguments) -> Result<Value, AskError> {
    let api = Api::new(daemon)?;
    let (ready, problem) = api.readiness()?;
    let system = api.get(&["system"], &[])?;
    let machines = api.get(&["machines"], &[])?;
    Ok(json!({
        "ready": ready, "not_ready_because": problem["errors"], "system": system, "machines": machines["items"],
    }))
}

fn items(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// Whether the daemon does its work and data come.
fn is_well(status: &Value) -> bool {
    status["ready"] == true && silent(status).is_empty()
}

/// Streams that failed or deliver nothing, with the reason.
fn silent(status: &Value) -> Vec<&Value> {
    items(&status["system"]["streams"]).iter().filter(|one| one["reason"].is_string()).collect()
}

/// What is wrong, as far as the daemon knows, a line each.
fn troubles(status: &Value) -> Vec<String> {
    let system = &status["system"];
    let said = |place: &'static str, list: &Value| {
        items(list).iter().map(|one| format!("{place}: {}", shown(one))).collect::<Vec<_>>()
    };
    let mut found = said("not ready", &status["not_ready_because"]);
    for part in ["store", "trends"] {
        if system[part]["failure"].is_string() {
            found.push(format!("{part}: {}", shown(&system[part]["failure"])));
        }
    }
    found.extend(said("configuration refused", &system["configuration"]["rejected_because"]));
    found.extend(said("waits for a restart", &system["configuration"]["waiting_for_restart"]));
    found.extend(said("security", &system["security"]["warnings"]));
    for receiver in items(&system["receivers"]) {
        if receiver["failure"].is_string() {
            found.push(format!(
                "receiver {}: {}",
                shown(&receiver["name"]),
                shown(&receiver["failure"])
            ));
        }
    }
    for stream in silent(status) {
        found.push(format!("machine {}: {}", shown(&stream["machine"]), shown(&stream["reason"])));
    }
    found
}

fn text(status: &Value) -> String {
    let system = &status["system"];
    let ready = if status["ready"] == true { "ready" } else { "NOT READY" };
    let [name, version, since] = ["name", "version", "started_at"].map(|key| shown(&system[key]));
    let hash = shown(&system["configuration_hash"]);
    let mut text = format!("{name} {version}: {ready}, since {since}, configuration {hash}\n");
    for machine in items(&status["machines"]) {
        let [id, state, runs, source] =
            ["id", "state", "operating_state", "source"].map(|key| shown(&machine[key]));
        let alarms = &machine["alarms"];
        text.push_str(&format!(
            "  {id:<20} {state:<12} {runs:<10} source {source}, {alarms} alarms\n"
        ));
    }
    for trouble in troubles(status) {
        text.push_str(&format!("! {trouble}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_without_data_is_not_well() {
        let status = |ready: bool, reason: Option<&str>| json!({ "ready": ready, "system": { "streams": [{ "machine": "rig-1", "reason": reason }] } });
        assert!(is_well(&status(true, None)));
        assert!(!is_well(&status(false, None)));
        let silent = status(true, Some("no data have come since t"));
        assert!(!is_well(&silent));
        assert_eq!(troubles(&silent), ["machine rig-1: no data have come since t"]);
    }

    #[test]
    fn what_is_wrong_is_told_a_line_each() {
        let status = json!({
            "ready": false,
            "not_ready_because": ["shard 0 has not moved for 12 s"],
            "machines": [{ "id": "rig-1", "state": "damaged", "operating_state": "running", "source": "failed", "alarms": 2 }],
            "system": {
                "name": "rotorwatch", "version": "1", "started_at": "t", "configuration_hash": "h",
                "store": { "failure": "disk full" }, "trends": null,
                "configuration": { "rejected_because": ["a.toml:1:1: x"], "waiting_for_restart": ["server.bind"] },
                "security": { "warnings": ["open"] },
                "receivers": [{ "name": "room", "failure": "no answer" }, { "name": "other", "failure": null }],
                "streams": [{ "machine": "rig-1", "reason": "no\u{1b}[2J file" }],
            },
        });
        let text = text(&status);
        assert!(
            text.starts_with("rotorwatch 1: NOT READY, since t, configuration h\n  rig-1 "),
            "{text}"
        );
        let troubles: Vec<&str> = text.lines().filter(|line| line.starts_with("! ")).collect();
        assert_eq!(
            troubles,
            [
                "! not ready: shard 0 has not moved for 12 s",
                "! store: disk full",
                "! configuration refused: a.toml:1:1: x",
                "! waits for a restart: server.bind",
                "! security: open",
                "! receiver room: no answer",
                "! machine rig-1: no [2J file",
            ]
        );
    }
}
