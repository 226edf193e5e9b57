//! `kill -9` at seeded moments while everything is under way: data, trends, alarms that come and go, operators,
//! captures, a receiver that is up or down.
//!
//! The oracle is what the outside was told: the acts that HTTP answered with 200, the transitions that a receiver
//! was sent, the samples that were received a second before.

use crate::hook::Hook;
use crate::hook::Message;
use crate::kill;
use crate::kill::Answered;
use crate::notify;
use crate::support;
use crate::support::Daemon;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::reader::Piece;
use serde_json::Value;
use serde_json::json;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;
use std::thread;
use std::time::Duration;
use std::time::Instant;
use tempfile::TempDir;

/// How many kills; 20 if it is not set.
const KILLS: &str = "ROTORWATCH_KILLS";

/// Limits that are always exceeded: one stays shelved, one is shelved for a moment, the others have an operator each.
const ALWAYS: [&str; 4] = ["kept", "moment", "first", "second"];

/// Samples a second of stream time.
const RATE_HZ: f64 = 1000.0;

/// Between two acts of an operator, so that the receiver keeps up.
const PACE: Duration = Duration::from_millis(20);

/// What a flush may take: samples older than that survive.
const FLUSHED_AFTER: Duration = Duration::from_secs(1);

/// How late a busy computer may run what is due.
const LATE: Duration = Duration::from_secs(1);

/// What is known from outside, over all lives of the daemon.
#[derive(Debug, Default)]
struct Oracle {
    answered: Mutex<Vec<Answered>>,
    /// History by number, checked so far.
    events: BTreeMap<u64, Value>,
    /// Messages compared with the history so far.
    n_compared: usize,
    /// Acts of operators found in the history.
    acts: BTreeSet<(String, String)>,
    /// When the shelving that stays ends.
    kept_until: Option<String>,
    /// The capture that was under way, and the stream time that had been received a second before the kill.
    capture: Option<(String, f64)>,
    captures_read: BTreeSet<String>,
}

fn machine(id: &str, limits: &str) -> String {
    format!("{}{limits}", support::MACHINE.replace("rig-1", id))
}

fn limit(id: &str, above: f64) -> String {
    format!(
        "[[limits.alarm]]\nid = \"{id}\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = {above}\n"
    )
}

/// A folder with a machine whose level rises and falls every second of the clock, and one that is only load.
fn folder(hook: &Hook) -> TempDir {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[alarms]\noff_delay_s = 0\nhistory_len = 8\n[captures]\n\
         seconds_before = 20\nmost_per_hour = 3\nmax_bytes = 50_000_000\n[[machine]]\nfile = \"rig.toml\"\n\
         [[machine]]\nfile = \"load.toml\"\n[[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\n\
         file = \"x.h5\"\nspeed = 20\nloop = true\n[[source]]\nkind = \"replay\"\nmachine = \"rig-2\"\n\
         file = \"x.h5\"\nspeed = 200\nloop = true\n[[notify.webhook]]\nname = \"room\"\nurl = \"{}\"\n\
         machines = [\"rig-1\"]\nmax_backoff_s = 1\n",
        hook.url
    );
    let always: String = ALWAYS.iter().map(|id| limit(id, 1e-6)).collect();
    let rig = machine("rig-1", &format!("{always}{}{}", limit("low", 0.5), limit("high", 1.5)));
    let load = machine("rig-2", "");
    let files = [("rig.toml", rig.as_bytes()), ("load.toml", load.as_bytes())];
    let dir = support::folder(&config, &files);
    let sample = |i: u32| {
        let level = [0.1, 1.0, 0.1, 3.0][usize::try_from(i / 20_000 % 4).unwrap()];
        level * (f64::from(i) * 0.37).sin()
    };
    let samples: Vec<f64> = (0..600_000).map(sample).collect();
    support::write_samples(&dir, "x.h5", RATE_HZ, &samples);
    dir
}

/// The alarms that stand of limits, by limit.
fn standing(daemon: &Daemon) -> BTreeMap<String, Value> {
    let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1&limit=1000");
    let items = list["items"].as_array().unwrap().iter();
    let of_limits =
        items.filter_map(|item| Some((item["limit"].as_str()?.to_owned(), item.clone())));
    of_limits.collect()
}

fn text<'v>(document: &'v Value, key: &str) -> &'v str {
    document[key].as_str().unwrap_or_default()
}

impl Oracle {
    /// Reads the history after what was checked already, and checks it.
    fn read_history(&mut self, daemon: &Daemon) {
        let known = self.events.last_key_value().map_or(0, |(last, _)| *last);
        let mut fresh: BTreeMap<u64, Value> = BTreeMap::new();
        let mut after = String::new();
        'pages: loop {
            let path = format!("/api/v1/alarms/history?machine=rig-1&limit=1000{after}");
            let (status, page) = daemon.get_json(&path);
            assert_eq!((status, &page["dropped"]), (200, &json!(0)), "{page}");
            for event in page["items"].as_array().unwrap() {
                let sequence = event["sequence"].as_u64().unwrap();
                if sequence <= known {
                    break 'pages;
                }
                assert!(fresh.insert(sequence, event.clone()).is_none(), "twice: {event}");
            }
            let Some(next) = page["next"].as_str() else { break };
            after = format!("&after={next}");
        }
        let sequences: Vec<u64> = fresh.keys().copied().collect();
        let expected: Vec<u64> = (known + 1..=known + fresh.len() as u64).collect();
        assert_eq!(sequences, expected, "no number is missing");
        for event in fresh.values().filter(|event| !event["author"].is_null()) {
            let key = (text(&event["alarm"], "id").to_owned(), text(event, "comment").to_owned());
            assert!(self.acts.insert(key), "an act is there twice: {event}");
        }
        self.events.extend(fresh);
    }

    /// Everything that was answered and everything that was sent is in the history as it was told.
    fn check_told(&mut self, messages: &[Message]) {
        for answer in &*self.answered.lock().unwrap() {
            let key = (answer.alarm.clone(), answer.comment.clone());
            assert!(self.acts.contains(&key), "answered and lost: {answer:?}");
        }
        for message in &messages[self.n_compared..] {
            let told = message.json();
            assert_eq!(told["stored"], true, "nothing refused here: {told}");
            let event = self.events.get(&told["sequence"].as_u64().unwrap());
            let event = event.unwrap_or_else(|| panic!("told and lost: {told}"));
            for key in ["event", "time", "author", "comment"] {
                assert_eq!(told[key], event[key], "{key}: sent {told}, stored {event}");
            }
            for key in ["id", "limit", "state", "level", "occurrences", "silenced"] {
                assert_eq!(told["alarm"][key], event["alarm"][key], "{key}: {told}, {event}");
            }
        }
        self.n_compared = messages.len();
    }

    /// No alarm was raised twice, none lost: of a limit there is one at a time.
    fn check_lives(&self) {
        let mut alive: BTreeMap<&str, (&str, u64)> = BTreeMap::new();
        for event in self.events.values().filter(|e| e["alarm"]["limit"].is_string()) {
            let (limit, id) = (text(&event["alarm"], "limit"), text(&event["alarm"], "id"));
            let n = event["alarm"]["occurrences"].as_u64().unwrap();
            let before = alive.get(limit).copied();
            assert!(before.is_none_or(|(other, _)| other == id), "{before:?} stands: {event}");
            let n_before = before.map_or(0, |(_, n)| n);
            let is_raised = text(event, "event") == "raised";
            assert_eq!(
                n,
                n_before + u64::from(is_raised),
                "came twice, or out of nothing: {event}"
            );
            if text(event, "event") == "cleared" {
                alive.remove(limit);
            } else {
                alive.insert(limit, (id, n));
            }
        }
        assert!(ALWAYS.iter().all(|limit| alive.contains_key(limit)), "{alive:?}");
    }

    /// What must stand stands as it was left, and shelvings run on.
    fn check_standing(&self, alarms: &BTreeMap<String, Value>) {
        for limit in ALWAYS {
            assert_eq!(alarms[limit]["active"], true, "{limit}: {}", alarms[limit]);
        }
        let kept = &alarms["kept"];
        assert_eq!(kept["state"], "shelved", "{kept}");
        let time = |text: &str| text.parse::<jiff::Timestamp>().unwrap();
        let now = time(text(&kept["silenced"], "until"));
        let before = time(self.kept_until.as_ref().unwrap());
        let moved_s = now.duration_since(before).as_secs_f64();
        assert!(moved_s.abs() < 1.0, "shelved until {now} now, {before} before");
        let answered = self.answered.lock().unwrap();
        for limit in ["first", "second"] {
            let (alarm, id) = (&alarms[limit], text(&alarms[limit], "id"));
            let last = self.events.values().rfind(|event| event["alarm"]["id"] == id).unwrap();
            for key in ["state", "level", "acknowledgement", "silenced", "raised_at"] {
                assert_eq!(alarm[key], last["alarm"][key], "{key} of {limit}");
            }
            let newest = answered.iter().rfind(|answer| answer.alarm == id);
            if let Some(newest) = newest.filter(|newest| last["comment"] == *newest.comment) {
                assert_eq!(alarm["state"], newest.after["state"], "{limit}: as it was answered");
            }
        }
    }

    /// Every capture that has a file is read to its end; that which was under way has all but the last second, and its
    /// windows are judged again.
    fn check_captures(&mut self, daemon: &Daemon, killed_at: jiff::Timestamp) {
        let (_, list) = daemon.get_json("/api/v1/captures?machine=rig-1&limit=1000");
        let entries = list["items"].as_array().unwrap();
        for entry in entries {
            let (id, requested) = (text(entry, "id"), text(entry, "requested_at"));
            let requested: jiff::Timestamp = requested.parse().unwrap();
            if requested > killed_at || !self.captures_read.insert(id.to_owned()) {
                continue;
            }
            match text(entry, "state") {
                "complete" | "recovered" => {
                    let file = format!("data/captures/rig-1/{id}.h5");
                    assert!(samples(&daemon.dir.path().join(file)) > 0, "{entry}");
                }
                "failed" => {
                    let age_s = killed_at.duration_since(requested).as_secs_f64();
                    let limit_s = (FLUSHED_AFTER + LATE).as_secs_f64();
                    assert!(age_s <= limit_s, "nothing of it is there after {age_s} s: {entry}");
                }
                state => assert_eq!(state, "removed", "{entry}"),
            }
        }
        let Some((id, received_s)) = self.capture.take() else { return };
        let entry = entries.iter().find(|entry| entry["id"] == *id).unwrap();
        assert_eq!(entry["state"], "recovered", "{entry}");
        let file = daemon.dir.path().join(format!("data/captures/rig-1/{id}.h5"));
        let ends_s = entry["from_s"].as_f64().unwrap() + samples(&file) as f64 / RATE_HZ;
        assert!(
            ends_s >= received_s,
            "{ends_s} s are there, {received_s} s had been received: {entry}"
        );
        let mut command = support::command();
        command.args(["diagnose", "--evidence"]).arg(&file);
        let again = support::run(&mut command);
        assert_eq!(again.status.code(), Some(0), "{}{}", again.stdout, again.stderr);
    }
}

/// Reads a capture to its end; gives its number of samples.
fn samples(file: &Path) -> usize {
    let mut reader = CaptureReader::open(file, None, &Hints::default()).unwrap();
    reader.keep_received();
    let mut n = 0;
    while let Some(piece) = reader.next_piece().unwrap() {
        if let Piece::Received(run) = piece {
            n += run.raw.len();
        }
    }
    n
}

/// Acknowledges the alarms that come and go, so that they end and are raised anew, until the daemon is gone.
fn acknowledge(base_url: &str, name: &str, answered: &Mutex<Vec<Answered>>) {
    let config = ureq::Agent::config_builder().http_status_as_error(false).build();
    let agent: ureq::Agent = config.into();
    for n in 0_u64.. {
        let list = agent.get(format!("{base_url}/api/v1/alarms?machine=rig-1&limit=1000")).call();
        let Some(list) = list.ok().and_then(|mut l| l.body_mut().read_json::<Value>().ok()) else {
            return;
        };
        let open = list["items"].as_array().unwrap().iter().filter(|item| {
            let state = text(item, "state");
            ["low", "high"].contains(&text(item, "limit"))
                && ["unacknowledged", "returned_unacknowledged"].contains(&state)
        });
        for alarm in open {
            let (id, comment) = (text(alarm, "id"), format!("{name}-{n}"));
            let body = json!({ "author": name, "comment": comment });
            let url = format!("{base_url}/api/v1/alarms/{id}/ack");
            let Ok(mut response) = agent.post(url).send_json(&body) else { return };
            let Ok(after) = response.body_mut().read_json::<Value>() else { return };
            // It may have moved on since it was listed.
            if response.status() == 200 {
                let alarm = id.to_owned();
                answered.lock().unwrap().push(Answered { alarm, comment, after });
            }
        }
        thread::sleep(PACE);
    }
}

/// Shelves an alarm and notes the answer.
fn shelve(daemon: &Daemon, oracle: &Oracle, (id, comment): (&str, String), for_s: f64) -> Value {
    let body = json!({ "author": "M. Ito", "comment": comment, "for_s": for_s });
    let (status, after) = daemon.post_json(&format!("/api/v1/alarms/{id}/shelve"), &body);
    assert_eq!(status, 200, "{after}");
    let (alarm, answer) = (id.to_owned(), after.clone());
    oracle.answered.lock().unwrap().push(Answered { alarm, comment, after });
    answer
}

/// One life of the daemon, from a start to a kill; gives its folder and when it was killed.
fn live(
    mut daemon: Daemon,
    oracle: &mut Oracle,
    round: u64,
    more: Duration,
) -> (TempDir, jiff::Timestamp) {
    let alarms = support::wait_until("the alarms", || {
        let found = standing(&daemon);
        ALWAYS.iter().all(|limit| found.contains_key(*limit)).then_some(found)
    });
    let id = |limit: &str| text(&alarms[limit], "id").to_owned();
    if oracle.kept_until.is_none() {
        let shelved = shelve(&daemon, oracle, (&id("kept"), "for two hours".to_owned()), 7200.0);
        oracle.kept_until = Some(text(&shelved["silenced"], "until").to_owned());
    }
    // What was shelved for a moment before the kill comes back by itself.
    support::wait_until("the end of a short shelving", || {
        (standing(&daemon)["moment"]["state"] != "shelved").then_some(())
    });
    shelve(&daemon, oracle, (&id("moment"), format!("round-{round}")), 2.5);
    support::wait_until("windows", || {
        let judged = daemon.metric("rotorwatch_windows_judged_total{machine=\"rig-1\"}")?;
        (judged >= 2.0).then_some(())
    });
    let body = json!({ "author": "M. Ito", "comment": "before the kill", "after_s": 600.0 });
    let (status, begun) = daemon.post_json("/api/v1/machines/rig-1/captures", &body);
    assert_eq!(status, 201, "{begun}");
    thread::scope(|scope| {
        let (url, answered) = (&daemon.base_url, &oracle.answered);
        for limit in ["first", "second"] {
            let (id, state) = (id(limit), text(&alarms[limit], "state").to_owned());
            let name = format!("round-{round}-{limit}");
            scope.spawn(move || {
                kill::operate(url, (&id, state), &name, (answered, &AtomicU64::new(0)), PACE);
            });
        }
        let janitor = format!("round-{round}-janitor");
        scope.spawn(move || acknowledge(url, &janitor, answered));
        let metric = "rotorwatch_samples_received_total{machine=\"rig-1\",channel=\"right_x\"}";
        let received_s = daemon.metric(metric).unwrap() / RATE_HZ;
        oracle.capture = Some((text(&begun, "id").to_owned(), received_s));
        thread::sleep(FLUSHED_AFTER + LATE + more);
        daemon.signal("KILL");
    });
    assert!(daemon.child.wait().unwrap().code().is_none(), "killed");
    (std::mem::replace(&mut daemon.dir, TempDir::new().unwrap()), jiff::Timestamp::now())
}

fn kill_and_restart(n_rounds: u64, seed: u64) {
    let hook = Hook::start(200);
    let mut oracle = Oracle::default();
    let mut daemon = Daemon::start_in(folder(&hook));
    let mut random = seed;
    for round in 0..n_rounds {
        random =
            random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        hook.answer(if round % 3 == 1 { 503 } else { 200 });
        let more = Duration::from_micros((random >> 33) % 1_000_000);
        let (dir, killed_at) = live(daemon, &mut oracle, round, more);
        daemon = Daemon::start_in(dir);
        let alarms = standing(&daemon);
        // Before the history: the daemon that runs tells of what happens after it was read.
        let messages = hook.messages();
        oracle.read_history(&daemon);
        oracle.check_told(&messages);
        oracle.check_lives();
        oracle.check_standing(&alarms);
        oracle.check_captures(&daemon, killed_at);
    }
    hook.answer(200);
    // The end of the data: nothing new comes, and the receiver can be told of everything.
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    assert_eq!(daemon.terminate().status.code(), Some(0));
    let config = std::fs::read_to_string(dir.path().join("serve.toml")).unwrap();
    std::fs::write(dir.path().join("serve.toml"), config.replace("speed = 20\nloop = true\n", ""))
        .unwrap();
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    support::wait_until("everything to be told", || {
        let (_, newest) = daemon.get_json("/api/v1/alarms/history?machine=rig-1&limit=1");
        let (_, system) = daemon.get_json("/api/v1/system");
        let told = &system["receivers"][0];
        (told["delivered"] == newest["items"][0]["sequence"]).then_some(())
    });
    oracle.read_history(&daemon);
    oracle.check_told(&hook.messages());
    oracle.check_lives();
    let expected: Vec<String> = oracle.events.keys().map(|n| format!("rig-1#{n}")).collect();
    assert_eq!(notify::first_arrivals(&hook.messages()), expected, "in order, none lost");
    let taken = hook.taken();
    let n_doubled = taken.len() - taken.iter().collect::<BTreeSet<_>>().len();
    assert!(n_doubled as u64 <= n_rounds + 1, "{n_doubled} of {}", expected.len());
    #[expect(clippy::print_stdout, reason = "a figure")]
    {
        println!(
            "{n_rounds} kills: {} transitions, {n_doubled} sent twice, {} acts answered, {} captures read",
            expected.len(),
            oracle.answered.lock().unwrap().len(),
            oracle.captures_read.len()
        );
    }
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
#[ignore = "a minute and a half for 20 kills; .ci/run runs it, .ci/nightly with ROTORWATCH_KILLS=200"]
fn kills_under_load_lose_and_double_nothing_that_was_told() {
    let n_rounds = std::env::var(KILLS).map_or(20, |n| n.parse().unwrap());
    #[expect(clippy::disallowed_methods, reason = "a figure")]
    let now = Instant::now;
    let started = now();
    kill_and_restart(n_rounds, 5);
    #[expect(clippy::print_stdout, reason = "a figure")]
    {
        println!("{n_rounds} kills: {:.0} s", now().duration_since(started).as_secs_f64());
    }
}
