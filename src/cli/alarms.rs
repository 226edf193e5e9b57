//! `rotorwatch alarms`: the alarms of a running daemon, over its HTTP API.

use super::client::Api;
use super::client::AskError;
use super::client::DaemonArguments;
use super::client::shown;
use clap::Args;
use clap::Subcommand;
use clap::ValueEnum;
use serde_json::Value;
use serde_json::json;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch alarms list
  rotorwatch alarms history --machine rig-1 --limit 20
  rotorwatch alarms show rig-1:12
  rotorwatch alarms ack rig-1:12 --author 'M. Ito' --comment 'bearing ordered'
  rotorwatch alarms shelve rig-1:12 rig-1:13 --for 8h --author 'M. Ito' --comment 'until the shift ends'
  rotorwatch alarms ack rig-1:12 --token-file ito.token --comment 'bearing ordered'
  rotorwatch alarms list --url https://monitor.example.org --state unacknowledged --format json

Exit codes: 0 success, 2 an error; of several alarms every one is tried.";

/// Most alarms that are listed.
const MAX_LISTED: usize = 100_000;

/// Arguments of `alarms`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The daemon.
    #[command(flatten)]
    pub daemon: DaemonArguments,
    /// How the answer is written.
    #[arg(long, global = true, value_enum, default_value = "text", value_name = "FORMAT")]
    pub format: Format,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// How the answer is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
}

/// What to do with alarms.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the alarms that are not over
    List(ListArguments),
    /// List what happened to alarms, newest first
    History(HistoryArguments),
    /// Show one alarm with all that happened to it
    Show {
        /// The alarm's id, such as rig-1:12.
        id: String,
    },
    /// Acknowledge alarms
    Ack(ActArguments),
    /// Put alarms on the shelf for a time
    Shelve(ShelveArguments),
    /// Take alarms off the shelf before their time
    Unshelve(ActArguments),
    /// Suppress alarms that mean nothing by design
    Suppress(ActArguments),
    /// End the suppression of alarms
    Unsuppress(ActArguments),
    /// Take alarms out of service for maintenance
    OutOfService(ActArguments),
    /// Return alarms to service
    Return(ActArguments),
    /// Reset alarms that latched
    Reset(ActArguments),
}

/// Which alarms.
#[derive(Debug, Args)]
pub struct ListArguments {
    /// Of this machine only.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
    /// Of this component only.
    #[arg(long, value_name = "ID")]
    pub component: Option<String>,
    /// Of this level only: warning, damaged.
    #[arg(long, value_name = "LEVEL")]
    pub level: Option<String>,
    /// In this state only, such as unacknowledged or shelved.
    #[arg(long, value_name = "STATE")]
    pub state: Option<String>,
    /// Changed at this time (RFC 3339) or later.
    #[arg(long, value_name = "TIME")]
    pub since: Option<String>,
}

/// Which events.
#[derive(Debug, Args)]
pub struct HistoryArguments {
    /// Of this machine only.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
    /// Of this component only.
    #[arg(long, value_name = "ID")]
    pub component: Option<String>,
    /// At this time (RFC 3339) or later.
    #[arg(long, value_name = "TIME")]
    pub since: Option<String>,
    /// At most so many.
    #[arg(long, value_name = "N", default_value_t = 100,
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub limit: u32,
}

/// Which alarms, who and why.
#[derive(Debug, Args)]
pub struct ActArguments {
    /// Ids of the alarms, such as rig-1:12.
    #[arg(required = true, value_name = "ID")]
    pub ids: Vec<String>,
    /// Who acts; kept with the act. With a token its label is who, and this is not needed.
    #[arg(long, value_name = "NAME", env = "ROTORWATCH_AUTHOR", default_value = "")]
    pub author: String,
    /// Why, or what was done.
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub comment: String,
}

/// As [`ActArguments`], and for how long.
#[derive(Debug, Args)]
pub struct ShelveArguments {
    /// The act.
    #[command(flatten)]
    pub act: ActArguments,
    /// For how long: a number with s, min, h or d, such as 8h.
    #[arg(long = "for", value_name = "TIME", value_parser = seconds)]
    pub for_s: f64,
}

/// Runs the command; exit code 2 when anything of it failed.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let api = match Api::new(&arguments.daemon) {
        Ok(api) => api,
        Err(error) => return super::fail(&error),
    };
    let is_text = arguments.format == Format::Text;
    let done = match &arguments.command {
        Command::List(which) => {
            list(&api, which).map(|found| (lines(&found["items"], alarm_line), found))
        }
        Command::History(which) => {
            history(&api, which).map(|found| (lines(&found["items"], event_line), found))
        }
        Command::Show { id } => api.get(&["alarms", id], &[]).map(|alarm| (detail(&alarm), alarm)),
        Command::Ack(act) => return acts(&api, "ack", act, None, is_text),
        Command::Shelve(shelve) => {
            return acts(&api, "shelve", &shelve.act, Some(shelve.for_s), is_text);
        }
        Command::Unshelve(act) => return acts(&api, "unshelve", act, None, is_text),
        Command::Suppress(act) => return acts(&api, "suppress", act, None, is_text),
        Command::Unsuppress(act) => return acts(&api, "unsuppress", act, None, is_text),
        Command::OutOfService(act) => return acts(&api, "out-of-service", act, None, is_text),
        Command::Return(act) => return acts(&api, "return", act, None, is_text),
        Command::Reset(act) => return acts(&api, "reset", act, None, is_text),
    };
    match done {
        Ok((text, _)) if is_text => super::print(text.as_bytes()),
        Ok((_, document)) => super::print(format!("{document:#}\n").as_bytes()),
        Err(error) => super::fail(&error),
    }
}

/// Acts on every alarm, also when one is refused. JSON is one document: the alarms after the act.
fn acts(
    api: &Api,
    action: &str,
    act: &ActArguments,
    for_s: Option<f64>,
    is_text: bool,
) -> ExitCode {
    let mut body = json!({ "author": act.author, "comment": act.comment });
    if let Some(for_s) = for_s {
        body["for_s"] = json!(for_s);
    }
    let (mut after, mut failed) = (Vec::new(), false);
    for id in &act.ids {
        match api.post(&["alarms", id, action], &body) {
            Ok(alarm) => after.push(alarm),
            Err(error) => {
                super::tell(&error);
                failed = true;
            }
        }
    }
    let items = Value::Array(after);
    let text = if is_text {
        lines(&items, alarm_line)
    } else {
        format!("{:#}\n", json!({ "items": items }))
    };
    let printed = super::print(text.as_bytes());
    if failed { ExitCode::from(super::EXIT_ERROR) } else { printed }
}

fn list(api: &Api, which: &ListArguments) -> Result<Value, AskError> {
    let filters = [
        ("machine", which.machine.as_ref()),
        ("component", which.component.as_ref()),
        ("level", which.level.as_ref()),
        ("state", which.state.as_ref()),
        ("since", which.since.as_ref()),
    ];
    api.pages(&["alarms"], &filters, MAX_LISTED)
}

fn history(api: &Api, which: &HistoryArguments) -> Result<Value, AskError> {
    let filters = [
        ("machine", which.machine.as_ref()),
        ("component", which.component.as_ref()),
        ("since", which.since.as_ref()),
    ];
    let limit = usize::try_from(which.limit).unwrap_or(usize::MAX);
    api.pages(&["alarms", "history"], &filters, limit)
}

/// Reads a time such as `8h`.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let units = [("min", 60.0), ("h", 3600.0), ("d", 86_400.0), ("s", 1.0)];
    let read = units.iter().find_map(|(unit, unit_s)| {
        let number: f64 = text.strip_suffix(unit)?.trim().parse().ok()?;
        Some(number * unit_s)
    });
    read.filter(|time_s| *time_s > 0.0 && time_s.is_finite())
        .ok_or_else(|| "write a number above 0 with s, min, h or d, such as 8h".to_owned())
}

fn lines(items: &Value, line: fn(&Value) -> String) -> String {
    let items = items.as_array().map_or(&[][..], Vec::as_slice);
    if items.is_empty() {
        return "none\n".to_owned();
    }
    items.iter().map(line).collect()
}

/// The fault, or what raised the alarm.
fn cause(alarm: &Value) -> String {
    match (alarm["fault"].as_str(), alarm["limit"].as_str()) {
        (Some(fault), _) => fault.to_owned(),
        (None, Some(_)) => shown(&alarm["limit"]),
        (None, None) => shown(&alarm["source"]),
    }
}

fn alarm_line(alarm: &Value) -> String {
    let [id, level, state, component, time, why] =
        ["id", "level", "state", "component", "changed_at", "why"].map(|key| shown(&alarm[key]));
    format!("{id:<14} {level:<8} {state:<22} {component} {}  {time}  {why}\n", cause(alarm))
}

fn event_line(event: &Value) -> String {
    let alarm = &event["alarm"];
    let [time, name, author, comment] =
        ["time", "event", "author", "comment"].map(|key| shown(&event[key]));
    let [id, level, component] = ["id", "level", "component"].map(|key| shown(&alarm[key]));
    let by = if author.is_empty() { String::new() } else { format!("  by {author}") };
    let why = if comment.is_empty() { String::new() } else { format!(": {comment}") };
    format!("{time}  {id:<14} {name:<20} {level:<8} {component} {}{by}{why}\n", cause(alarm))
}

fn detail(alarm: &Value) -> String {
    let mut text = alarm_line(alarm);
    let silenced = &alarm["silenced"];
    if silenced.is_object() {
        let until =
            silenced["until"].as_str().map_or(String::new(), |until| format!(" until {until}"));
        text.push_str(&format!(
            "  silenced by {}{until}: {}\n",
            shown(&silenced["author"]),
            shown(&silenced["comment"])
        ));
    }
    for transition in alarm["transitions"].as_array().map_or(&[][..], Vec::as_slice) {
        let acts = alarm["actions"].as_array().map_or(&[][..], Vec::as_slice);
        let act = acts.iter().find(|act| act["sequence"] == transition["sequence"]);
        let by = act.map_or(String::new(), |act| {
            format!("  by {}: {}", shown(&act["author"]), shown(&act["comment"]))
        });
        let [time, name, state] = ["time", "event", "state"].map(|key| shown(&transition[key]));
        text.push_str(&format!("  {time}  {name:<20} {state}{by}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_numbers_with_a_unit() {
        for (text, time_s) in
            [("8h", 28_800.0), ("30min", 1800.0), ("90 s", 90.0), ("1.5d", 129_600.0)]
        {
            assert_eq!(seconds(text), Ok(time_s), "{text}");
        }
        for wrong in ["8", "h", "-1h", "0s", "nan h", "inf d", "8 hours", ""] {
            assert!(seconds(wrong).is_err(), "{wrong}");
        }
    }
}
