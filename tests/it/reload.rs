//! Settings that change while the built daemon runs: taken over, refused, waiting for a restart.

use crate::event_stream::Event;
use crate::event_stream::events;
use crate::live;
use crate::live::Sender;
use crate::support;
use crate::support::Daemon;
use crate::support::MACHINE;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use serde_json::Value;
use serde_json::json;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const RATE_HZ: f64 = 1000.0;

/// Two machines, each with a sine of amplitude 1 that is played on and on, 50 times as fast as it was.
const CONFIG: &str = r#"
[server]
bind = "127.0.0.1:0"
[[machine]]
file = "rig.toml"
[[source]]
kind = "replay"
machine = "rig-1"
file = "x.h5"
loop = true
speed = 50
[[machine]]
file = "other.toml"
[[source]]
kind = "replay"
machine = "rig-2"
file = "x.h5"
loop = true
speed = 50
"#;

pub(crate) fn limit(warning_above: f64) -> String {
    format!(
        "{MACHINE}[[limits.alarm]]\nid = \"level\"\nkind = \"feature\"\nfeature = \"rms\"\noff_delay_s = 0\n\
         warning_above = {warning_above:?}\n"
    )
}

pub(crate) fn start() -> Daemon {
    let other = MACHINE.replace("rig-1", "rig-2");
    let machine = limit(5.0);
    let files = [("rig.toml", machine.as_bytes()), ("other.toml", other.as_bytes())];
    let dir = support::folder(CONFIG, &files);
    let samples: Vec<f64> =
        (0..40_000).map(|i| (TAU * 10.0 * f64::from(i) / RATE_HZ).sin()).collect();
    support::write_samples(&dir, "x.h5", RATE_HZ, &samples);
    Daemon::start_in(dir)
}

fn write(daemon: &Daemon, name: &str, text: &str) {
    fs::write(daemon.dir.path().join(name), text).unwrap();
}

fn hash(daemon: &Daemon) -> String {
    daemon.get_json("/api/v1/system").1["configuration_hash"].as_str().unwrap().to_owned()
}

/// Writes a file, asks for the configuration to be read, and waits for another hash.
pub(crate) fn change(daemon: &Daemon, name: &str, text: &str) {
    let before = hash(daemon);
    write(daemon, name, text);
    daemon.signal("HUP");
    support::wait_until("the new configuration", || (hash(daemon) != before).then_some(()));
}

/// The limit's alarm, if it stands.
pub(crate) fn alarm(daemon: &Daemon) -> Option<Value> {
    let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1");
    list["items"].as_array().unwrap().iter().find(|item| item["limit"] == "level").cloned()
}

fn channel(daemon: &Daemon, machine: &str) -> Value {
    let (_, list) = daemon.get_json(&format!("/api/v1/machines/{machine}/channels"));
    list["items"][0].clone()
}

/// What was told of configurations so far.
fn told(daemon: &Daemon, n: usize) -> Vec<(String, Value, String)> {
    let of = |found: &[Event]| {
        found.iter().filter(|event| event.name == "configuration").cloned().collect::<Vec<_>>()
    };
    let found = of(&events(daemon, "?last_event_id=0", None, |found| of(found).len() >= n));
    let text = |event: &Event, key: &str| event.data[key].as_str().unwrap().to_owned();
    found.iter().map(|e| (text(e, "event"), e.data["machine"].clone(), text(e, "why"))).collect()
}

fn judged(daemon: &Daemon) {
    support::wait_until("a verdict", || {
        (daemon.get_json("/api/v1/machines/rig-1/diagnosis").0 == 200).then_some(())
    });
}

#[test]
fn other_limits_raise_end_and_remove_alarms_at_once() {
    let daemon = start();
    judged(&daemon);
    assert_eq!(alarm(&daemon), None);
    change(&daemon, "rig.toml", &limit(0.1));
    let raised = support::wait_until("the alarm", || alarm(&daemon));
    assert_eq!((&raised["active"], &raised["source"]), (&json!(true), &json!("limit")));
    // The verdict says by which configuration it was judged.
    support::wait_until("a verdict by the new configuration", || {
        let (_, diagnosis) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
        (diagnosis["judged_by"] == hash(&daemon).as_str()).then_some(())
    });
    change(&daemon, "rig.toml", &limit(5.0));
    support::wait_until("its return", || (alarm(&daemon)?["active"] == false).then_some(()));
    change(&daemon, "rig.toml", &limit(0.1));
    support::wait_until("it again", || (alarm(&daemon)?["active"] == true).then_some(()));
    change(&daemon, "rig.toml", MACHINE);
    assert_eq!(alarm(&daemon), None, "without its limit it is over");
    let (_, history) = daemon.get_json("/api/v1/alarms/history?machine=rig-1&limit=1");
    assert_eq!(history["items"][0]["event"], "configuration_removed", "{history}");
    assert_eq!(history["items"][0]["alarm"]["id"], raised["id"]);
    let told = told(&daemon, 4);
    assert!(told.iter().all(|(event, machine, _)| event == "config_applied" && machine.is_null()));
    assert_eq!(told[0].2, "in effect: machine \"rig-1\" (limits.alarm)");
    let (_, ran) = daemon.get_json("/api/v1/configurations");
    assert_eq!(ran["items"][0]["hash"], hash(&daemon).as_str());
    assert_eq!(ran["items"].as_array().unwrap().len(), 5);
    assert_eq!(daemon.metric("rotorwatch_config_applied_total"), Some(4.0));
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn what_is_refused_changes_nothing_and_is_told_until_it_is_mended() {
    let daemon = start();
    let before = hash(&daemon);
    write(
        &daemon,
        "rig.toml",
        &limit(0.1).replace("warning_above = 0.1", "warning_above = \"high\""),
    );
    daemon.signal("HUP");
    support::wait_until("the refusal", || {
        (daemon.metric("rotorwatch_config_failing") == Some(1.0)).then_some(())
    });
    let (_, system) = daemon.get_json("/api/v1/system");
    assert_eq!(system["configuration_hash"], before.as_str());
    let why = system["configuration"]["rejected_because"][0].as_str().unwrap();
    assert!(why.contains("rig.toml") && why.contains("warning_above"), "{why}");
    assert!(system["configuration"]["rejected_at"].is_string());
    let told = told(&daemon, 1);
    assert_eq!(told[0].0, "config_rejected");
    assert!(told[0].2.starts_with(why), "{}", told[0].2);
    assert_eq!(daemon.metric("rotorwatch_config_rejected_total"), Some(1.0));
    // What waits for a restart is named, the rest holds.
    let port = CONFIG.replace("127.0.0.1:0", "127.0.0.1:1");
    write(&daemon, "rig.toml", &limit(0.1));
    change(&daemon, "serve.toml", &format!("[alarms]\noff_delay_s = 7\n{port}"));
    let (_, system) = daemon.get_json("/api/v1/system");
    let state = &system["configuration"];
    assert_eq!(state["waiting_for_restart"], json!(["server.bind"]), "{state}");
    assert_eq!(state["rejected_at"], Value::Null);
    assert_eq!(daemon.metric("rotorwatch_config_failing"), Some(0.0));
    assert_eq!(daemon.metric("rotorwatch_config_waiting_for_restart"), Some(1.0));
    support::wait_until("the alarm of the mended file", || alarm(&daemon));
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn a_machine_that_is_described_otherwise_is_rebuilt_and_no_other_notices() {
    let daemon = start();
    let body = json!({ "author": "M. Ito", "windows": 5 });
    let learned = support::wait_until("five windows", || {
        let (status, learned) = daemon.post_json("/api/v1/machines/rig-1/baselines", &body);
        (status == 201).then_some(learned)
    });
    let before = [channel(&daemon, "rig-1"), channel(&daemon, "rig-2")];
    // As an editor does: written beside, and renamed. Nobody asks for it to be read.
    let beside = daemon.dir.path().join("rig.toml~");
    fs::write(&beside, limit(5.0).replace("elements = 11", "elements = 9")).unwrap();
    fs::rename(&beside, daemon.dir.path().join("rig.toml")).unwrap();
    let told = told(&daemon, 2);
    assert_eq!(told[0].0, "config_applied");
    let (event, machine, why) = &told[1];
    assert_eq!((event.as_str(), machine), ("machine_rebuilt", &json!("rig-1")));
    assert_eq!(why, "described otherwise: bearing; its baselines are stale");
    let (_, machine) = daemon.get_json("/api/v1/machines/rig-1");
    assert!(machine.to_string().contains("\"elements\":9"), "{machine}");
    let id = learned["id"].as_str().unwrap();
    let (_, baseline) = daemon.get_json(&format!("/api/v1/machines/rig-1/baselines/{id}"));
    assert_eq!(baseline["active"], false, "{baseline}");
    let (_, audit) = daemon.get_json("/api/v1/audit?machine=rig-1&limit=1");
    assert_eq!(audit["items"][0]["action"], "baseline_stale", "{audit}");
    // Rings and sources go on: no sample of either stream is lost, doubled or begun anew.
    for (machine, before) in ["rig-1", "rig-2"].into_iter().zip(before) {
        let now = support::wait_until("more samples", || {
            let now = channel(&daemon, machine);
            (now["end_sample"].as_u64() > before["end_sample"].as_u64()).then_some(now)
        });
        let received = |channel: &Value| channel["end_sample"].as_u64().unwrap();
        assert_eq!(received(&now), now["received"].as_u64().unwrap(), "{now}");
        assert_eq!((&now["gaps"], &now["duplicated"]), (&before["gaps"], &before["duplicated"]));
        assert_eq!(now["missing"], 0);
    }
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn what_was_described_otherwise_while_nobody_ran_makes_baselines_stale() {
    let mut daemon = start();
    let body = json!({ "author": "M. Ito", "windows": 5 });
    let learned = support::wait_until("five windows", || {
        let (status, learned) = daemon.post_json("/api/v1/machines/rig-1/baselines", &body);
        (status == 201).then_some(learned)
    });
    let path = format!("/api/v1/machines/rig-1/baselines/{}", learned["id"].as_str().unwrap());
    let restart = |mut daemon: Daemon, text: &str| {
        daemon.signal("KILL");
        daemon.child.wait().unwrap();
        let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
        fs::write(dir.path().join("rig.toml"), text).unwrap();
        Daemon::start_in(dir)
    };
    let is_active = |daemon: &Daemon| daemon.get_json(&path).1["active"] == true;
    // Another limit, a restart: the baseline holds. Noticing that it is used takes the daemon a second.
    daemon = restart(daemon, &limit(5.0));
    assert!(is_active(&daemon));
    daemon = restart(daemon, &limit(5.0).replace("elements = 11", "elements = 9"));
    assert!(!is_active(&daemon));
    let (_, audit) = daemon.get_json("/api/v1/audit?machine=rig-1&limit=1");
    let line = &audit["items"][0];
    assert_eq!(line["action"], "baseline_stale", "{audit}");
    assert_eq!(line["comment"], "stale: described otherwise: bearing");
    // Whoever says that it still holds is believed, over restarts too.
    let activate = format!("{path}/activate");
    let (status, told) = daemon.post_json(&activate, &json!({ "author": "M. Ito", "comment": "" }));
    assert_eq!(status, 200, "{told}");
    daemon = restart(daemon, &limit(5.0).replace("elements = 11", "elements = 9"));
    assert!(is_active(&daemon));
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn the_log_tells_less_from_the_next_reload_on() {
    let daemon = start();
    judged(&daemon);
    change(&daemon, "rig.toml", &limit(0.1));
    support::wait_until("the alarm", || alarm(&daemon));
    let config = fs::read_to_string(daemon.dir.path().join("serve.toml")).unwrap();
    change(&daemon, "serve.toml", &format!("{config}[log]\nlevel = \"error\"\n"));
    assert_eq!(told(&daemon, 2)[1].0, "config_applied");
    change(&daemon, "rig.toml", &limit(5.0));
    assert_eq!(told(&daemon, 3)[2].0, "config_applied");
    let ended = daemon.terminate();
    let lines = |text: &str| ended.stderr.matches(text).count();
    assert_eq!(lines("the configuration is taken over"), 1, "{}", ended.stderr);
}

#[test]
fn receivers_are_exchanged_and_none_that_stays_notices() {
    let (stays, comes) = (crate::hook::Hook::start(200), crate::hook::Hook::start(200));
    let hook = |name: &str, url: &str| {
        format!("[[notify.webhook]]\nname = \"{name}\"\nurl = \"{url}\"\nmax_backoff_s = 1\n")
    };
    let daemon = start();
    change_receivers(&daemon, &format!("{CONFIG}{}", hook("stays", &stays.url)), &["stays"]);
    change(&daemon, "rig.toml", &limit(0.1));
    support::wait_until("a message", || (!stays.taken().is_empty()).then_some(()));
    let both = format!("{CONFIG}{}{}", hook("stays", &stays.url), hook("comes", &comes.url));
    change_receivers(&daemon, &both, &["comes", "stays"]);
    change(&daemon, "rig.toml", &limit(5.0));
    support::wait_until("a message to both", || {
        (stays.taken().len() == 2 && comes.taken().len() == 1).then_some(())
    });
    change_receivers(&daemon, &format!("{CONFIG}{}", hook("comes", &comes.url)), &["comes"]);
    change(&daemon, "rig.toml", &limit(0.1));
    support::wait_until("a message to one", || (comes.taken().len() == 2).then_some(()));
    assert_eq!(stays.taken().len(), 2, "no longer told");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

/// Writes a configuration, asks for it to be read, and waits until these receivers are shown.
fn change_receivers(daemon: &Daemon, text: &str, names: &[&str]) {
    write(daemon, "serve.toml", text);
    daemon.signal("HUP");
    support::wait_until("the receivers", || {
        let (_, system) = daemon.get_json("/api/v1/system");
        let shown = system["receivers"].as_array().unwrap().clone();
        (shown.iter().map(|one| one["name"].as_str().unwrap()).eq(names.iter().copied()))
            .then_some(())
    });
}

#[test]
fn a_restart_goes_on_with_what_was_taken_over() {
    let mut daemon = start();
    judged(&daemon);
    change(&daemon, "rig.toml", &limit(0.1));
    let raised = support::wait_until("the alarm", || alarm(&daemon));
    // What is told as an event is stored; an alarm that is only shown may be lost in a kill (ADR 11).
    let is_told =
        |event: &Event| event.name == "alarm" && event.data["alarm"]["id"] == raised["id"];
    events(&daemon, "?last_event_id=0", None, |found| found.iter().any(is_told));
    let taken_over = hash(&daemon);
    daemon.signal("KILL");
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    let again = Daemon::start_in(dir);
    assert_eq!(hash(&again), taken_over);
    assert_eq!(alarm(&again).unwrap()["id"], raised["id"]);
    assert_eq!(again.terminate().status.code(), Some(0));
}

/// Whether a capture has the text of a machine file in it.
fn says(file: &Path, text: &str) -> bool {
    let reader = CaptureReader::open(file, None, &Hints::default()).unwrap();
    reader.info().machine.as_ref().unwrap().contains(text)
}

#[test]
fn what_is_kept_after_a_change_says_what_holds_and_what_is_gone_is_listed_no_more() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[ingest]\nbind = \"127.0.0.1:0\"\n[recording]\nenabled = true\n\
                  [[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n";
    let files = [("rig.toml", MACHINE.as_bytes())];
    let (daemon, address) = live::live_in(support::folder(config, &files));
    let start_ns = live::ago(120);
    let (mut sender, _) = Sender::greet(&address, 1);
    (0..160).for_each(|sequence| sender.block(sequence, start_ns));
    sender.settle();
    judged(&daemon);
    change(&daemon, "rig.toml", &MACHINE.replace("\"right\"", "\"drive-end\""));
    // No sample has come since.
    let (_, health) = daemon.get_json("/api/v1/machines/rig-1/health");
    let all = health["components"].as_array().unwrap();
    let bearings: Vec<&Value> = all.iter().filter(|one| one["kind"] == "bearing").collect();
    assert_eq!(bearings.len(), 1, "{health:#}");
    assert_eq!(
        (&bearings[0]["id"], &bearings[0]["state"]),
        (&"drive-end".into(), &"undetermined".into())
    );
    let body = json!({ "author": "M. Ito", "comment": "after the change", "after_s": 0.0 });
    let (status, begun) = daemon.post_json("/api/v1/machines/rig-1/captures", &body);
    assert_eq!(status, 201, "{begun}");
    (160..170).for_each(|sequence| sender.block(sequence, start_ns));
    sender.settle();
    drop(sender);
    let finished = |n: usize| {
        support::wait_until("recordings that are finished", || {
            let (_, list) = daemon.get_json("/api/v1/machines/rig-1/recordings");
            let items = list["items"].as_array().unwrap().clone();
            let is_done = items.len() == n && items.iter().all(|item| item["state"] == "finished");
            is_done.then(|| {
                items
                    .iter()
                    .map(|item| item["file"].as_str().unwrap().to_owned())
                    .collect::<Vec<_>>()
            })
        })
    };
    finished(1);
    let (mut sender, _) = Sender::greet(&address, 1);
    (170..180).for_each(|sequence| sender.block(sequence, start_ns));
    sender.settle();
    drop(sender);
    let data = daemon.dir.path().join("data");
    let [newer, older] = &finished(2)[..] else { panic!("two recordings") };
    assert!(says(&data.join("recordings/rig-1").join(older), "\"right\""), "it was open");
    assert!(says(&data.join("recordings/rig-1").join(newer), "\"drive-end\""));
    support::wait_until("the capture", || {
        let (_, list) = daemon.get_json("/api/v1/captures?machine=rig-1");
        (list["items"][0]["state"] == "complete").then_some(())
    });
    let capture = format!("captures/rig-1/{}.h5", begun["id"].as_str().unwrap());
    assert!(says(&data.join(capture), "\"drive-end\""));
    assert_eq!(daemon.terminate().status.code(), Some(0));
}
