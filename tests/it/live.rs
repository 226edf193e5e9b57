//! Samples over a network: what a sender streams is judged as what lies in a file, and whatever happens on the way changes
//! counters, not truth.

use crate::scene;
use crate::support::{self, Daemon, wait_until};
use rotorwatch::wire;
use rotorwatch::wire::{Block, Bye, Channel, Frames, Hello, Message, SampleType, Samples, Wanted};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tempfile::TempDir;
use tungstenite::client::IntoClientRequest;

pub(crate) const RATE_HZ: u32 = 2000;

/// Samples of a block.
pub(crate) const N: u32 = 200;

fn config(more: &str) -> String {
    format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[ingest]\nbind = \"127.0.0.1:0\"\n{more}[[machine]]\nfile = \"rig.toml\"\n\
         [[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n"
    )
}

/// A daemon with live senders, and where it listens to them.
fn live(machine: &str, more: &str) -> (Daemon, String) {
    live_in(support::folder(&config(more), &[("rig.toml", machine.as_bytes())]))
}

pub(crate) fn live_in(dir: TempDir) -> (Daemon, String) {
    let (daemon, line) = Daemon::start_with_second_line(dir);
    let address = line.strip_prefix("ingest on tcp://").unwrap_or_else(|| panic!("{line:?}"));
    (daemon, address.to_owned())
}

fn replay(dir: &TempDir, address: &str, more: &[&str]) -> Command {
    let mut command = support::command();
    command.arg("replay").arg(dir.path().join("x.h5")).arg("--to").arg(format!("tcp://{address}"));
    command.args(more);
    command
}

/// A connection that sends what it is told to.
pub(crate) struct Sender {
    stream: TcpStream,
    frames: Frames,
    /// The last sequence sent.
    last: u64,
}

impl Sender {
    /// Says hello as the sender of channel `right_x`, whose sample i is i / 1000.
    pub(crate) fn greet(address: &str, epoch: u64) -> (Self, Wanted) {
        let described = Channel::new("right_x", f64::from(RATE_HZ), SampleType::F64, "m/s^2");
        let hello = Hello::new("rig-1", epoch, vec![Channel { scale: 1e-3, ..described }]);
        Self::greet_with(address, hello)
    }

    /// Says this hello; gives the place of the first channel.
    pub(crate) fn greet_with(address: &str, hello: Hello) -> (Self, Wanted) {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let mut sender = Self { stream, frames: Frames::default(), last: 0 };
        sender.say(&Message::Hello(hello));
        let wanted = sender.until(|message| {
            let Message::Welcome(welcome) = message else { return None };
            Some(welcome.wanted[0])
        });
        (sender, wanted)
    }

    pub(crate) fn say(&mut self, message: &Message<'_>) {
        let mut frame = Vec::new();
        wire::encode(message, &mut frame).unwrap();
        self.stream.write_all(&frame).unwrap();
    }

    pub(crate) fn block(&mut self, sequence: u32, start_ns: i64) {
        self.stream.write_all(&frame(sequence, start_ns)).unwrap();
        self.last = sequence.into();
    }

    /// Sends a block and waits until it is settled, as its credit wants it.
    pub(crate) fn send(&mut self, block: Block<'_>) {
        self.last = block.sequence;
        self.say(&Message::Block(block));
        self.settle();
    }

    fn until<T>(&mut self, is_it: impl Fn(&Message<'_>) -> Option<T>) -> T {
        loop {
            while let Some((message, _)) = self.frames.take().unwrap() {
                if let Some(found) = is_it(&message) {
                    return found;
                }
            }
            let n = self.stream.read(self.frames.space()).unwrap();
            assert!(n > 0, "the daemon has closed");
            self.frames.filled(n);
        }
    }

    /// Waits until everything sent is settled.
    pub(crate) fn settle(&mut self) {
        self.say(&Message::Ping);
        let last = self.last;
        self.until(|message| {
            let Message::Ack(ack) = message else { return None };
            ack.progress.iter().any(|progress| progress.sequence > last).then_some(())
        });
    }
}

fn frame(sequence: u32, start_ns: i64) -> Vec<u8> {
    let first = sequence * N;
    let bytes: Vec<u8> = (first..first + N).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let samples = Samples::new(SampleType::F64, &bytes).unwrap();
    let time_ns = start_ns + i64::from(first) * 1_000_000_000 / i64::from(RATE_HZ);
    let (sequence, first) = (sequence.into(), first.into());
    let block = Block { stream: 0, sequence, first, time_ns, samples };
    let mut frame = Vec::new();
    wire::encode(&Message::Block(block), &mut frame).unwrap();
    frame
}

/// UTC so many seconds ago, ns.
pub(crate) fn ago(seconds: u64) -> i64 {
    #[expect(clippy::disallowed_methods, reason = "a sender's clock")]
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    i64::try_from((now - Duration::from_secs(seconds)).as_nanos()).unwrap()
}

fn channel(daemon: &Daemon) -> Value {
    daemon.get_json("/api/v1/machines/rig-1/channels").1["items"][0].clone()
}

pub(crate) fn count(ledger: &Value, name: &str) -> u64 {
    ledger[name].as_u64().unwrap_or_else(|| panic!("{name} in {ledger}"))
}

/// Everything that came is accounted for, and what the ring holds is what was used.
fn assert_accounted(daemon: &Daemon) -> Value {
    let shown = wait_until("the shard to take all of it", || {
        let shown = channel(daemon);
        (shown["received"] == shown["ledger"]["used"]).then_some(shown)
    });
    let ledger = shown["ledger"].clone();
    let fates = ["used", "late", "duplicate", "not_finite", "out_of_range", "dropped"];
    let sum: u64 = fates.iter().map(|fate| count(&ledger, fate)).sum();
    assert_eq!(count(&ledger, "received"), sum, "{ledger}");
    ledger
}

#[test]
fn a_capture_that_is_streamed_is_judged_as_one_that_is_played() {
    let dir = support::folder(&config(""), &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    let played = support::folder(
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
         machine = \"rig-1\"\nfile = \"x.h5\"\n",
        &[("rig.toml", scene::MACHINE.as_bytes())],
    );
    std::fs::copy(dir.path().join("x.h5"), played.path().join("x.h5")).unwrap();
    let capture = TempDir::new().unwrap();
    std::fs::copy(dir.path().join("x.h5"), capture.path().join("x.h5")).unwrap();
    let (daemon, address) = live_in(dir);
    assert_eq!(daemon.source_of("rig-1"), "starting");
    let sent = support::run(&mut replay(&capture, &address, &["--speed", "max"]));
    assert_eq!(sent.status.code(), Some(0), "{}", sent.stderr);
    assert!(sent.stdout.contains("432000 samples of 3 channels"), "{}", sent.stdout);
    daemon.wait_finished("rig-1");
    let other = Daemon::start_in(played);
    other.wait_finished("rig-1");
    let verdict = |daemon: &Daemon| {
        let (status, document) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
        assert_eq!(status, 200, "{document}");
        document
    };
    let (live, file) = (verdict(&daemon), verdict(&other));
    assert_eq!(live["components"], file["components"]);
    for key in ["state", "shaft_speed_hz", "samples_used", "samples_rejected", "data_quality"] {
        assert_eq!(live[key], file[key], "{key}");
    }
    let right = live["components"].as_array().unwrap().iter().find(|c| c["id"] == "right").unwrap();
    assert_eq!((&right["state"], &right["fault"]), (&"damaged".into(), &"inner_race".into()));
    let ledger = assert_accounted(&daemon);
    let expected = u64::try_from(scene::N_SAMPLES).unwrap();
    assert_eq!((count(&ledger, "used"), count(&ledger, "lost")), (expected, 0));
    // The alarm's capture holds what was sent, bit by bit the samples of the file.
    let (_, alarms) = daemon.get_json("/api/v1/alarms");
    assert_eq!(alarms["items"].as_array().unwrap().len(), 1, "{alarms:#}");
    assert!(alarms["items"][0]["capture"]["none_because"].is_null(), "{alarms:#}");
}

#[test]
fn lost_doubled_and_late_blocks_change_counters_and_no_sample() {
    let (daemon, address) = live(support::MACHINE, "");
    let start_ns = ago(60);
    let (mut sender, wanted) = Sender::greet(&address, 1);
    assert_eq!((wanted.sequence, wanted.index), (0, 0));
    // 5 and 6 do not come, 9 comes twice, 12 after 13, 13 again.
    for sequence in [0, 1, 2, 3, 4, 7, 8, 9, 9, 10, 11, 13, 12, 13, 14, 15] {
        sender.block(sequence, start_ns);
    }
    sender.settle();
    let ledger = assert_accounted(&daemon);
    let n = u64::from(N);
    let shown = channel(&daemon);
    assert_eq!(count(&ledger, "received"), 16 * n);
    assert_eq!((count(&ledger, "used"), count(&ledger, "lost")), (13 * n, 3 * n));
    assert_eq!((count(&ledger, "late"), count(&ledger, "duplicate")), (n, 2 * n));
    assert_eq!((count(&ledger, "gaps"), count(&ledger, "blocks_lost")), (2, 3));
    assert_eq!((&shown["missing"], &shown["gaps"]), (&(3 * n).into(), &2.into()), "{shown}");
    for (fate, expected) in [("used", 13 * n), ("late", n), ("lost", 3 * n)] {
        let labels = format!("{{machine=\"rig-1\",channel=\"right_x\",fate=\"{fate}\"}}");
        let counted = daemon.metric(&format!("rotorwatch_ingest_samples_total{labels}"));
        assert_eq!(counted, Some(expected as f64), "{fate}");
    }
    // What is held is what was sent, at its index.
    for end in [n * 5, n * 12, n * 16] {
        let path = format!("/api/v1/machines/rig-1/channels/right_x/waveform?samples=10&end={end}");
        let (_, waveform) = daemon.get_json(&path);
        let first = waveform["start_sample"].as_u64().unwrap();
        assert_eq!(first, end - 10, "{waveform}");
        for (i, value) in (first..).zip(waveform["value"].as_array().unwrap()) {
            // Single precision keeps seven digits.
            assert!((value.as_f64().unwrap() - i as f64 / 1e3).abs() < 1e-6, "{i}: {value}");
        }
    }
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn a_sender_whose_plug_was_pulled_goes_on_where_it_was() {
    let (daemon, address) = live(support::MACHINE, "");
    let start_ns = ago(60);
    let (mut sender, _) = Sender::greet(&address, 7);
    for sequence in 0..20 {
        sender.block(sequence, start_ns);
    }
    sender.settle();
    // A part of the next one, and the plug is pulled; a second plug is in before the first is missed.
    sender.stream.write_all(&frame(20, start_ns)[..333]).unwrap();
    let (mut again, wanted) = Sender::greet(&address, 7);
    assert_eq!((wanted.sequence, wanted.index), (20, u64::from(20 * N)));
    for sequence in 20..40 {
        again.block(sequence, start_ns);
    }
    again.settle();
    again.say(&Message::Bye(Bye::End));
    daemon.wait_finished("rig-1");
    let ledger = assert_accounted(&daemon);
    assert_eq!((count(&ledger, "used"), count(&ledger, "lost")), (u64::from(40 * N), 0));
    let shown = channel(&daemon);
    assert_eq!((&shown["missing"], &shown["gaps"]), (&0.into(), &0.into()), "{shown}");
    // Another sender of the channel is refused while one is there, with the reason.
    let (_third, _) = Sender::greet(&address, 8);
    let dir = TempDir::new().unwrap();
    support::write_ramp(&dir, "x.h5", f64::from(RATE_HZ), 1000);
    let refused = support::run(&mut replay(&dir, &address, &["--machine", "rig-1"]));
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        refused.stderr.contains("channel-taken") && refused.stderr.contains("right_x"),
        "{}",
        refused.stderr
    );
}

#[test]
fn a_daemon_that_stands_still_or_is_killed_costs_a_sender_that_buffers_nothing() {
    let (daemon, address) = live(support::MACHINE, "");
    let dir = TempDir::new().unwrap();
    let n_samples = 40 * RATE_HZ;
    support::write_ramp(&dir, "x.h5", f64::from(RATE_HZ), n_samples);
    let mut child = replay(&dir, &address, &["--speed", "20"]).spawn().unwrap();
    wait_until("the first samples", || (channel(&daemon)["received"].as_u64()? > 0).then_some(()));
    daemon.signal("STOP");
    std::thread::sleep(Duration::from_millis(700));
    daemon.signal("CONT");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    daemon.wait_finished("rig-1");
    let ledger = assert_accounted(&daemon);
    assert_eq!(count(&ledger, "used"), u64::from(n_samples), "{ledger}");
    assert_eq!((count(&ledger, "lost"), count(&ledger, "dropped")), (0, 0), "{ledger}");
    // A killed sender: what it had sent is used; the next one begins anew behind it.
    let mut child = replay(&dir, &address, &["--speed", "1"]).spawn().unwrap();
    let before = count(&ledger, "used");
    let used = |daemon: &Daemon| count(&channel(daemon)["ledger"], "used");
    wait_until("more samples", || (used(&daemon) > before).then_some(()));
    child.kill().unwrap();
    child.wait().unwrap();
    wait_until("the killed sender to be missed", || {
        channel(&daemon)["ledger"]["sender"].is_null().then_some(())
    });
    let sent = support::run(&mut replay(&dir, &address, &["--speed", "max"]));
    assert_eq!(sent.status.code(), Some(0), "{}", sent.stderr);
    let ledger = assert_accounted(&daemon);
    assert_eq!(count(&ledger, "lost"), 0, "{ledger}");
    assert!(count(&ledger, "used") > before + u64::from(n_samples), "{ledger}");
}

#[test]
fn rubbish_gets_a_name_and_a_counter() {
    let (daemon, address) = live(support::MACHINE, "");
    let told = |bytes: &[u8]| {
        let mut stream = TcpStream::connect(&address).unwrap();
        stream.write_all(bytes).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let mut frames = Frames::default();
        loop {
            let n = stream.read(frames.space()).unwrap();
            assert!(n > 0, "closed without a word");
            frames.filled(n);
            if let Some((Message::Problem(problem), _)) = frames.take().unwrap() {
                return problem.code.name();
            }
        }
    };
    assert_eq!(told(b"\0\0\0\0\0\0"), "malformed");
    let (mut sender, _) = Sender::greet(&address, 1);
    sender.block(0, ago(60));
    sender.settle();
    // A time of the future ends the connection, and nothing else.
    sender.stream.write_all(&frame(1, ago(60) + 3_600_000_000_000)).unwrap();
    let code = sender.until(|message| {
        let Message::Problem(problem) = message else { return None };
        Some(problem.code.name())
    });
    assert_eq!(code, "time-ahead");
    for (code, n) in [("malformed", 1.0), ("time-ahead", 1.0)] {
        let name = format!("rotorwatch_ingest_refused_total{{reason=\"{code}\"}}");
        assert_eq!(daemon.metric(&name), Some(n), "{code}");
    }
    let ledger = assert_accounted(&daemon);
    assert_eq!((count(&ledger, "used"), count(&ledger, "lost")), (u64::from(N), 0));
}

#[test]
fn a_small_sender_speaks_json_over_a_websocket() {
    let (daemon, _) = live(support::MACHINE, "");
    let url = format!("{}/api/v1/ingest", daemon.base_url.replace("http://", "ws://"));
    let (mut socket, _) = tungstenite::connect(&url).unwrap();
    let mut say = |text: String| socket.send(tungstenite::Message::text(text)).unwrap();
    say(r#"{"type":"hello","machine":"rig-1","epoch":3,"channels":[{"name":"right_x","rate_hz":100.0,"unit":"g"}]}"#.to_owned());
    for sequence in 0..5 {
        let samples: Vec<u32> = (0..10).map(|i| sequence * 10 + i).collect();
        say(format!(
            r#"{{"type":"block","channel":"right_x","sequence":{sequence},"first":{},"samples":{samples:?}}}"#,
            sequence * 10
        ));
    }
    say(r#"{"type":"bye","end":true}"#.to_owned());
    let told = told(&mut socket);
    assert_eq!(told[0]["type"], "welcome", "{told:?}");
    let settled = told.iter().filter_map(|told| told["wanted"][0]["sequence"].as_u64()).max();
    assert_eq!(settled, Some(5), "{told:?}");
    daemon.wait_finished("rig-1");
    assert_eq!(count(&assert_accounted(&daemon), "used"), 50);
    assert_eq!(channel(&daemon)["unit"], "m/s^2");
    // Frames go over it as well.
    let dir = TempDir::new().unwrap();
    support::write_ramp(&dir, "x.h5", 100.0, 3000);
    let sent = support::run(support::command().arg("replay").arg(dir.path().join("x.h5")).args([
        "--to",
        &daemon.base_url,
        "--speed",
        "max",
    ]));
    assert_eq!(sent.status.code(), Some(0), "{}", sent.stderr);
    let ledger = wait_until("the samples of the capture", || {
        let ledger = channel(&daemon)["ledger"].clone();
        (count(&ledger, "used") == 3050).then_some(ledger)
    });
    assert_eq!((count(&ledger, "received"), count(&ledger, "lost")), (3050, 0));
    assert_cut_off_is_counted(&daemon, &url);
    // What is no hello is told in JSON too; a page of elsewhere is let in nowhere.
    let (mut socket, _) = tungstenite::connect(&url).unwrap();
    socket.send(tungstenite::Message::text("{}")).unwrap();
    let told = socket.read().unwrap().into_text().unwrap();
    assert!(told.contains("malformed"), "{told}");
    let mut request = url.as_str().into_client_request().unwrap();
    request.headers_mut().insert("origin", "http://evil.example".parse().unwrap());
    let Err(tungstenite::Error::Http(answer)) = tungstenite::connect(request) else {
        panic!("a page of elsewhere was let in");
    };
    assert_eq!(answer.status().as_u16(), 403);
}

/// What is said in JSON until the connection ends.
fn told(socket: &mut tungstenite::WebSocket<impl std::io::Read + std::io::Write>) -> Vec<Value> {
    let heard = std::iter::from_fn(|| socket.read().ok());
    let texts = heard.filter_map(|message| {
        let tungstenite::Message::Text(text) = message else { return None };
        Some(serde_json::from_str(&text).unwrap())
    });
    texts.collect()
}

/// A block of no channel right behind the hello: welcomed first, then told, and counted with its samples.
fn assert_cut_off_is_counted(daemon: &Daemon, url: &str) {
    let (mut socket, _) = tungstenite::connect(url).unwrap();
    for text in [
        r#"{"type":"hello","machine":"rig-1","epoch":4,"channels":[{"name":"right_x","rate_hz":100.0,"unit":"g"}]}"#,
        r#"{"type":"block","channel":"left_x","sequence":0,"first":0,"samples":[1,2,3]}"#,
    ] {
        socket.send(tungstenite::Message::text(text)).unwrap();
    }
    let told = told(&mut socket);
    let last = &told[told.len() - 1];
    assert_eq!((&told[0]["type"], &last["type"]), (&json!("welcome"), &json!("error")), "{told:?}");
    assert_eq!(last["code"], "unexpected");
    let metrics = daemon.get_text("/metrics").1;
    for (what, n) in [("refused", 1), ("refused_samples", 3)] {
        let line = format!("rotorwatch_ingest_{what}_total{{reason=\"unexpected\"}} {n}\n");
        assert!(metrics.contains(&line), "{line}: {metrics}");
    }
    // A message that is too long is not read; who sends it may be cut off before it is sent.
    let (mut socket, _) = tungstenite::connect(url).unwrap();
    let _cut_off = socket.send(tungstenite::Message::text("x".repeat(3 << 20)));
    wait_until("the count of a message that is too long", || {
        let name = "rotorwatch_ingest_refused_total{reason=\"too-large\"}";
        (daemon.metric(name) == Some(1.0)).then_some(())
    });
}

#[test]
fn a_small_sender_speaks_cbor_over_a_websocket() {
    let (daemon, _) = live(support::MACHINE, "");
    let url = format!("{}/api/v1/ingest", daemon.base_url.replace("http://", "ws://"));
    let (mut socket, _) = tungstenite::connect(&url).unwrap();
    let mut say = |value: Value| {
        let mut bytes = Vec::new();
        ciborium::into_writer(&value, &mut bytes).unwrap();
        socket.send(tungstenite::Message::binary(bytes)).unwrap();
    };
    let channel_of_it = json!({ "name": "right_x", "rate_hz": 100.0, "unit": "g" });
    say(json!({ "type": "hello", "machine": "rig-1", "epoch": 3, "channels": [channel_of_it] }));
    let samples: Vec<f64> = (0..1000).map(f64::from).collect();
    say(
        json!({ "type": "block", "channel": "right_x", "sequence": 0, "first": 0, "samples": samples }),
    );
    say(json!({ "type": "bye", "end": true }));
    let mut told: Vec<Value> = Vec::new();
    while let Ok(message) = socket.read() {
        if let tungstenite::Message::Binary(bytes) = message {
            told.push(ciborium::from_reader(&bytes[..]).unwrap());
        }
    }
    assert_eq!(told[0]["type"], "welcome", "{told:?}");
    daemon.wait_finished("rig-1");
    assert_eq!(count(&assert_accounted(&daemon), "used"), 1000);
}

#[test]
fn an_address_that_others_can_reach_needs_tokens() {
    let open =
        config("").replace("[ingest]\nbind = \"127.0.0.1:0\"", "[ingest]\nbind = \"0.0.0.0:0\"");
    let refused = support::refused(&open, &[("rig.toml", support::MACHINE.as_bytes())]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(refused.stderr.contains("server.token_file"), "{}", refused.stderr);
}

#[test]
#[ignore = "takes 10 s, and needs the examples: cargo test builds them, cargo test --test it does not"]
fn the_rust_example_streams_ten_seconds_and_loses_nothing() {
    let (daemon, address) = live(support::MACHINE, "");
    let example = std::path::Path::new(env!("CARGO_BIN_EXE_rotorwatch")).with_file_name("examples");
    let streamed =
        support::run(Command::new(example.join("stream")).args([&address, "rig-1", "right_x"]));
    assert_eq!(streamed.status.code(), Some(0), "{}", streamed.stderr);
    daemon.wait_finished("rig-1");
    let ledger = assert_accounted(&daemon);
    assert_eq!((count(&ledger, "used"), count(&ledger, "lost")), (100_000, 0));
}

#[test]
#[ignore = "needs Python with numpy and h5py"]
fn the_python_example_streams_a_capture_and_gets_its_diagnosis() {
    let dir = support::folder(&config(""), &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    let capture = dir.path().join("x.h5");
    let (daemon, address) = live_in(dir);
    let (host, port) = address.split_once(':').unwrap();
    let mut child = Command::new(std::env::var("PYTHON").unwrap_or("python3".to_owned()))
        .arg("examples/stream.py")
        .arg(capture)
        .args([host, port, "rig-1", &daemon.base_url])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines: Vec<String> =
        BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(lines.iter().any(|line| line.starts_with("right: damaged:")), "{lines:?}");
    let ledger = assert_accounted(&daemon);
    assert_eq!(count(&ledger, "used"), u64::try_from(scene::N_SAMPLES).unwrap());
}
