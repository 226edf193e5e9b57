//! Captures of alarms: made by the daemon, downloaded, judged again bit by bit, diagnosed as any other, and whole
//! after a kill.

use crate::live;
use crate::live::Sender;
use crate::support;
use crate::support::Daemon;
use rotorwatch::capture::writer::{CaptureHeader, CaptureWriter};
use rotorwatch::capture::writer::{ChannelHeader, ChannelSamples, ChannelStorage};
use rotorwatch::signal::SampleIndex;
use rotorwatch::units::Hz;
use rotorwatch::wire::{Block, Bye, Channel, Hello, Message, SampleType, Samples};
use serde_json::Value;
use serde_json::json;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use tempfile::TempDir;

const RATE_HZ: f64 = 5000.0;

/// 6205-like bearing: BPFI 5.415 times the speed.
const MACHINE: &str = "[machine]\nid = \"rig-1\"\nname = \"Rig\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 20.0\n\
    [[bearing]]\nid = \"right\"\nshaft = \"main\"\nelements = 9\nelement_diameter_mm = 7.94\n\
    pitch_diameter_mm = 39.04\n[[sensor]]\nchannel = \"right_x\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\n\
    at = { bearing = \"right\" }\n";

const CONFIG: &str = "[server]\nbind = \"127.0.0.1:0\"\n[alarms]\non_delay_s = 5.0\n[captures]\n\
    seconds_after = 3.0\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\n\
    file = \"x.h5\"\n";

/// Vibration of a bearing whose inner race is damaged from `damaged_s` on: impacts at BPFI, stronger in the load zone,
/// ringing at 1.4 kHz, in noise.
fn signal(seconds: f64, damaged_s: f64, speed_hz: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut state = 7_u64;
    let mut noise = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    let (mut turns, mut impacts, mut since_s) = (0.0_f64, 0.0_f64, 1.0_f64);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds")]
    let n = (seconds * RATE_HZ).round() as usize;
    (0..n)
        .map(|i| {
            let t = i as f64 / RATE_HZ;
            let speed = speed_hz(t);
            turns += speed / RATE_HZ;
            let passed = impacts.floor();
            impacts += 5.4152 * 0.997 * speed / RATE_HZ;
            since_s = if impacts.floor() > passed { 0.0 } else { since_s + 1.0 / RATE_HZ };
            let load = 1.0 + 0.6 * (TAU * turns).cos();
            let ringing = load * (-since_s / 8e-4).exp() * (TAU * 1400.0 * since_s).sin();
            let size = if t >= damaged_s { 3.0 } else { 0.0 };
            size * ringing + 0.2 * (TAU * turns).cos() + 0.5 * noise()
        })
        .collect()
}

/// Counts of 2 mm/s², on a constant of 0.25 m/s², as an acquisition stores them.
const SCALE: f64 = 0.002;

fn write_counts(file: &Path, samples: &[f64], segments: Option<(&[u64], &[f64])>) {
    #[expect(clippy::cast_possible_truncation, reason = "a few thousand counts")]
    let counts: Vec<i16> = samples.iter().map(|x| (x / SCALE).round() as i16).collect();
    let mut writer = CaptureWriter::create(file, &CaptureHeader::default()).unwrap();
    let header = ChannelHeader {
        name: "right_x".to_owned(),
        sample_rate: Hz(RATE_HZ),
        unit: Some("m/s^2".to_owned()),
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    let samples = ChannelSamples::I16 { counts: &counts, scale: SCALE, offset: 0.25 };
    writer.channel(&header, samples).unwrap();
    if let Some((starts, times_s)) = segments {
        let starts: Vec<SampleIndex> = starts.iter().map(|start| SampleIndex(*start)).collect();
        writer.segments(&starts, times_s).unwrap();
    }
    writer.finish().unwrap();
}

/// A daemon that plays `samples` once.
fn daemon(config: &str, samples: &[f64], segments: Option<(&[u64], &[f64])>) -> Daemon {
    let dir = support::folder(config, &[("rig.toml", MACHINE.as_bytes())]);
    write_counts(&dir.path().join("x.h5"), samples, segments);
    Daemon::start_in(dir)
}

/// The captures that are whole, when there is at least one.
fn complete(daemon: &Daemon) -> Vec<Value> {
    support::wait_until("a capture that is complete", || {
        let (status, list) = daemon.get_json("/api/v1/captures?machine=rig-1");
        assert_eq!(status, 200, "{list}");
        let items = list["items"].as_array().unwrap().clone();
        let is_done = !items.is_empty() && items.iter().all(|item| item["state"] == "complete");
        is_done.then_some(items)
    })
}

/// The alarm of the bearing.
fn bearing_alarm(daemon: &Daemon) -> Value {
    support::wait_until("the alarm of the bearing", || {
        let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1&component=right");
        let items = list["items"].as_array().unwrap();
        items.iter().find(|item| item["source"] == "diagnosis").cloned()
    })
}

/// Downloads a capture to a folder.
fn download(daemon: &Daemon, id: &str, folder: &Path) -> PathBuf {
    let names = ["content-length", "content-disposition", "content-type"];
    let (status, headers, bytes) = daemon.get_binary(&format!("/api/v1/captures/{id}"), &names);
    assert_eq!(status, 200);
    assert_eq!(headers[0], bytes.len().to_string());
    assert_eq!(headers[1], format!("attachment; filename=\"{id}.h5\""));
    assert_eq!(headers[2], "application/x-hdf5");
    let file = folder.join(format!("{id}.h5"));
    fs::write(&file, bytes).unwrap();
    file
}

/// What `diagnose --evidence` says of a file, as a document, with the exit code.
fn again(file: &Path) -> (i32, Value, String) {
    let mut command = support::command();
    command.args(["diagnose", "--evidence", "--format", "json"]).arg(file);
    let ended = support::run(&mut command);
    let document = serde_json::from_str(&ended.stdout).unwrap_or(Value::Null);
    (ended.status.code().unwrap(), document, ended.stderr)
}

/// The verdict of a plain `diagnose` on the bearing.
fn plain(file: &Path) -> Value {
    let ended = support::run(support::command().args(["diagnose", "--format", "json"]).arg(file));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    let components = document["components"].as_array().unwrap();
    components.iter().find(|component| component["id"] == "right").unwrap().clone()
}

/// Checks that every window of a capture is the same, and gives the document.
fn all_equal(file: &Path, at_least: usize) -> Value {
    let (code, document, stderr) = again(file);
    assert_eq!(code, 0, "{stderr}\n{document:#}");
    let windows = document["windows"].as_array().unwrap();
    assert!(windows.len() >= at_least, "{} windows", windows.len());
    for window in windows {
        assert_eq!(window["equal"], true, "{window}");
        assert!(window["features"].as_u64().unwrap() >= 10, "{window}");
    }
    document
}

#[test]
fn an_alarm_has_a_capture_that_is_judged_again_bit_by_bit() {
    let daemon = daemon(CONFIG, &signal(60.0, 0.0, |_| 20.0), None);
    let alarm = bearing_alarm(&daemon);
    let captures = complete(&daemon);
    let (status, detail) =
        daemon.get_json(&format!("/api/v1/alarms/{}", alarm["id"].as_str().unwrap()));
    assert_eq!(status, 200);
    let id = detail["capture"]["id"].as_str().unwrap().to_owned();
    let entry = captures.iter().find(|capture| capture["id"] == *id).unwrap();
    assert!(entry["alarms"].as_array().unwrap().contains(&alarm["id"]), "{entry}");
    assert_eq!((&entry["cause"], &entry["state"]), (&json!("alarm"), &json!("complete")));
    let (from_s, to_s) = (entry["from_s"].as_f64().unwrap(), entry["to_s"].as_f64().unwrap());
    let trigger_s = entry["trigger_s"].as_f64().unwrap();
    assert!(from_s <= (trigger_s - 10.0).max(0.0) && to_s >= trigger_s + 3.0, "{entry}");
    let elsewhere = TempDir::new().unwrap();
    let file = download(&daemon, &id, elsewhere.path());
    // What the daemon's files say now is of no account: the capture is all there is.
    fs::write(daemon.dir.path().join("rig.toml"), MACHINE.replace("7.94", "9.94")).unwrap();
    let document = all_equal(&file, 2);
    let found = document["diagnosis"]["components"].as_array().unwrap();
    let found = found.iter().find(|component| component["id"] == "right").unwrap();
    assert_eq!((&found["state"], &found["fault"]), (&alarm["level"], &json!("inner_race")));
    assert_eq!(found["fault"], alarm["fault"]);
    assert!(document["raised"].as_str().unwrap().contains("bearing right"), "{document}");
    let plain = plain(&file);
    assert_eq!((&plain["state"], &plain["fault"]), (&found["state"], &found["fault"]));
    damaged_files_are_told(&file);
}

#[test]
fn an_alarm_after_a_reload_is_judged_again_bit_by_bit_by_what_was_taken_over() {
    // Damaged from the beginning, but nobody shall be told before a day is over.
    let replay = "loop = true\nspeed = 40\n";
    let config = |on_delay_s: u32| {
        format!(
            "{}{replay}",
            CONFIG.replace("on_delay_s = 5.0", &format!("on_delay_s = {on_delay_s}"))
        )
    };
    let daemon = daemon(&config(86_400), &signal(60.0, 0.0, |_| 20.0), None);
    support::wait_until("a verdict on the bearing", || {
        let (status, diagnosis) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
        (status == 200 && diagnosis["state"] == "damaged").then_some(())
    });
    let (_, alarms) = daemon.get_json("/api/v1/alarms?machine=rig-1&component=right");
    assert_eq!(alarms["items"], json!([]), "{alarms}");
    let (_, before) = daemon.get_json("/api/v1/system");
    fs::write(daemon.dir.path().join("serve.toml"), config(5)).unwrap();
    let described = MACHINE.replace("name = \"Rig\"", "name = \"Rig of now\"");
    fs::write(daemon.dir.path().join("rig.toml"), described).unwrap();
    daemon.signal("HUP");
    let alarm = bearing_alarm(&daemon);
    let (_, system) = daemon.get_json("/api/v1/system");
    assert_ne!(system["configuration_hash"], before["configuration_hash"]);
    let captures = complete(&daemon);
    let entry = captures
        .iter()
        .find(|capture| capture["alarms"].as_array().unwrap().contains(&alarm["id"]));
    let elsewhere = TempDir::new().unwrap();
    let file = download(&daemon, entry.unwrap()["id"].as_str().unwrap(), elsewhere.path());
    let document = all_equal(&file, 1);
    assert!(document["raised"].as_str().unwrap().contains("bearing right"), "{document}");
    // It keeps the settings and the machine of now, and says whose they are.
    let held = |text: &str| {
        let bytes = fs::read(&file).unwrap();
        bytes.windows(text.len()).any(|window| window == text.as_bytes())
    };
    assert!(held("Rig of now") && held(system["configuration_hash"].as_str().unwrap()));
    assert!(!held(before["configuration_hash"].as_str().unwrap()));
}

#[test]
fn windows_beside_a_gap_and_at_another_speed_are_the_same() {
    // 22 s, a hole of 7 s, 38 s; the speed rises by 1.5 % from 45 s to 50 s of the samples.
    let speed_hz = |t: f64| 20.0 + 0.06 * (t - 45.0).clamp(0.0, 5.0);
    let samples = signal(60.0, 25.0, speed_hz);
    let segments: (&[u64], &[f64]) = (&[0, 110_000], &[0.0, 29.0]);
    let config = CONFIG.replace("seconds_after", "seconds_before = 60.0\nseconds_after");
    let daemon = daemon(&config, &samples, Some(segments));
    let alarm = bearing_alarm(&daemon);
    daemon.wait_finished("rig-1");
    complete(&daemon);
    // Asked for at the end: the windows of everything that is held, both segments and both speeds.
    let body = json!({ "author": "M. Ito", "comment": "at the end", "after_s": 0.0 });
    let (status, begun) = daemon.post_json("/api/v1/machines/rig-1/captures", &body);
    assert_eq!(status, 201, "{begun}");
    let captures = complete(&daemon);
    let asked = captures.iter().find(|capture| capture["id"] == begun["id"]).unwrap();
    assert_eq!((&asked["cause"], &asked["author"]), (&json!("operator"), &json!("M. Ito")));
    let elsewhere = TempDir::new().unwrap();
    let file = download(&daemon, begun["id"].as_str().unwrap(), elsewhere.path());
    let document = all_equal(&file, 8);
    let windows = document["windows"].as_array().unwrap();
    let begins = |window: &Value| window["from_s"].as_f64().unwrap();
    assert!(windows.iter().any(|w| begins(w) < 22.0) && windows.iter().any(|w| begins(w) > 29.0));
    let (_, detail) = daemon.get_json(&format!("/api/v1/alarms/{}", alarm["id"].as_str().unwrap()));
    let of_alarm = download(&daemon, detail["capture"]["id"].as_str().unwrap(), elsewhere.path());
    all_equal(&of_alarm, 2);
}

#[test]
fn windows_of_a_live_sender_with_samples_beyond_its_range_are_the_same() {
    let config = CONFIG
        .replace("kind = \"replay\"", "kind = \"tcp\"")
        .replace("file = \"x.h5\"\n", "[ingest]\nbind = \"127.0.0.1:0\"\n");
    let (daemon, address) =
        live::live_in(support::folder(&config, &[("rig.toml", MACHINE.as_bytes())]));
    let described = Channel::new("right_x", RATE_HZ, SampleType::I16, "m/s^2");
    let range = Some((-30_000.0, 30_000.0));
    let channel = Channel { scale: SCALE, offset: 0.25, range, ..described };
    let hello = Hello::new("rig-1", 1, vec![channel]);
    let (mut sender, _) = Sender::greet_with(&address, hello);
    let start_ns = live::ago(60);
    #[expect(clippy::cast_possible_truncation, reason = "a few thousand counts")]
    let mut counts: Vec<i16> =
        signal(40.0, 0.0, |_| 20.0).iter().map(|x| (x / SCALE).round() as i16).collect();
    // The converter was overdriven for a moment, twice within what is captured.
    let overdriven = [12 * 5000 + 77, 13 * 5000, 13 * 5000 + 1];
    overdriven.iter().for_each(|at| counts[*at] = 32_767);
    for (sequence, counts) in (0..).zip(counts.chunks(10_000)) {
        let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
        let samples = Samples::new(SampleType::I16, &bytes).unwrap();
        let first = sequence * 10_000;
        let time_ns = start_ns + i64::try_from(first).unwrap() * 200_000;
        sender.send(Block { stream: 0, sequence, first, time_ns, samples });
    }
    sender.say(&Message::Bye(Bye::End));
    bearing_alarm(&daemon);
    let captures = complete(&daemon);
    let (_, list) = daemon.get_json("/api/v1/machines/rig-1/channels");
    let ledger = &list["items"][0]["ledger"];
    assert_eq!(live::count(ledger, "out_of_range"), 3, "{ledger}");
    let elsewhere = TempDir::new().unwrap();
    let file = download(&daemon, captures[0]["id"].as_str().unwrap(), elsewhere.path());
    all_equal(&file, 2);
}

#[test]
fn too_many_captures_within_an_hour_are_refused_with_the_reason() {
    let limit = |n: u32| {
        let above = f64::from(n) * 1e-3;
        format!(
            "[[limits.alarm]]\nid = \"l{n}\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = {above}\non_delay_s = {}\n",
            10 * n
        )
    };
    let machine = format!("{MACHINE}{}{}{}", limit(1), limit(2), limit(3));
    let config = CONFIG.replace("[captures]", "[captures]\nmost_per_hour = 1");
    let dir = support::folder(&config, &[("rig.toml", machine.as_bytes())]);
    write_counts(&dir.path().join("x.h5"), &signal(60.0, 100.0, |_| 20.0), None);
    let daemon = Daemon::start_in(dir);
    let refused = support::wait_until("an alarm without a capture", || {
        let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1");
        let items = list["items"].as_array().unwrap().clone();
        items.into_iter().find(|item| item["capture"]["none_because"].is_string())
    });
    let why = refused["capture"]["none_because"].as_str().unwrap();
    assert!(why.contains("captures.most_per_hour"), "{why}");
    assert_eq!(complete(&daemon).len(), 1);
    assert!(daemon.metric("rotorwatch_captures_refused_total").unwrap() >= 1.0);
}

#[test]
fn captures_can_be_off() {
    let config = CONFIG.replace("[captures]", "[captures]\nenabled = false");
    let daemon = daemon(&config, &signal(30.0, 0.0, |_| 20.0), None);
    let alarm = bearing_alarm(&daemon);
    assert!(alarm["capture"]["none_because"].as_str().unwrap().contains("captures.enabled"));
    assert_eq!(daemon.get_json("/api/v1/captures").0, 404);
    let body = json!({ "author": "M. Ito" });
    let (status, told) = daemon.post_json("/api/v1/machines/rig-1/captures", &body);
    assert!(
        status == 409 && told["detail"].as_str().unwrap().contains("captures.enabled"),
        "{told}"
    );
}

#[test]
fn a_capture_that_a_kill_cut_off_is_recovered_and_listed() {
    // Played at the pace of the clock, so that the capture is under way for a minute.
    let config = CONFIG.replace("seconds_after = 3.0", "seconds_after = 60.0");
    let config = config.replace("file = \"x.h5\"\n", "file = \"x.h5\"\nspeed = 8\n");
    let config = config.replace("on_delay_s = 5.0", "on_delay_s = 0.0");
    let mut daemon = daemon(&config, &signal(120.0, 0.0, |_| 20.0), None);
    bearing_alarm(&daemon);
    let id = support::wait_until("a capture under way for 2 s", || {
        let (_, list) = daemon.get_json("/api/v1/captures");
        let item = list["items"].as_array().unwrap().first().cloned()?;
        assert_eq!(item["state"], "writing", "{item}");
        let file = format!("data/captures/rig-1/{}.h5", item["id"].as_str().unwrap());
        let bytes = fs::metadata(daemon.dir.path().join(file)).ok()?.len();
        // Counts of 8 times the rate, two bytes each, for a second and more.
        (bytes > 300_000).then(|| item["id"].as_str().unwrap().to_owned())
    });
    let (status, told) = daemon.get_json(&format!("/api/v1/captures/{id}"));
    assert!(status == 409 && told["detail"].as_str().unwrap().contains("being written"), "{told}");
    daemon.child.kill().unwrap();
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    drop(daemon);
    let again_up = Daemon::start_in(dir);
    let (_, list) = again_up.get_json("/api/v1/captures");
    let items = list["items"].as_array().unwrap();
    let item = items.iter().find(|item| item["id"] == *id).unwrap();
    assert_eq!(item["state"], "recovered", "{item}");
    assert!(item["note"].as_str().unwrap().contains("cut off"), "{item}");
    let elsewhere = TempDir::new().unwrap();
    let file = download(&again_up, &id, elsewhere.path());
    all_equal(&file, 1);
    assert_eq!(plain(&file)["fault"], "inner_race");
}

/// A file that is cut or changed is an error with 2 that names it.
fn damaged_files_are_told(file: &Path) {
    let bytes = fs::read(file).unwrap();
    let damaged = file.with_file_name("damaged.h5");
    let text = b"\"schema\":\"rotorwatch.diagnosis/1\"";
    let at = bytes.windows(text.len()).position(|found| found == text).unwrap();
    let mut changed = bytes.clone();
    changed[at + 30] = b'2';
    fs::write(&damaged, &changed).unwrap();
    let (code, _, stderr) = again(&damaged);
    assert!(code == 2 && stderr.contains("checksum"), "{code} {stderr}");
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 0x10;
    fs::write(&damaged, &changed).unwrap();
    let (code, _, stderr) = again(&damaged);
    assert!(code == 2 && stderr.contains("damaged.h5"), "a sample: {code} {stderr}");
    for part in [1, 2, 3] {
        fs::write(&damaged, &bytes[..bytes.len() * part / 4]).unwrap();
        let (code, _, stderr) = again(&damaged);
        assert!(code == 2 && stderr.contains("damaged.h5"), "{code} {stderr}");
    }
}
