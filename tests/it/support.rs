//! A daemon in a folder of its own, and questions to it.

use rotorwatch::capture::writer::{CaptureHeader, CaptureWriter};
use rotorwatch::capture::writer::{ChannelHeader, ChannelSamples, ChannelStorage};
use rotorwatch::units::Hz;
use serde_json::Value;
use std::fs;
use std::io::BufRead;
use std::io::BufReader;
use std::io::Read;
use std::io::Write;
use std::net::Shutdown;
use std::net::TcpStream;
use std::process::Child;
use std::process::ChildStdout;
use std::process::Command;
use std::process::ExitStatus;
use std::process::Stdio;
use std::thread;
use std::time::Duration;
use std::time::Instant;
use tempfile::TempDir;

/// Longest wait for anything: far beyond what a loaded computer needs.
const LIMIT: Duration = Duration::from_secs(30);

/// Time between two looks.
const POLL: Duration = Duration::from_millis(20);

/// A machine file without any limits.
pub(crate) const MACHINE: &str = r#"
[machine]
id = "rig-1"
name = "Rig"
[[shaft]]
id = "main"
speed_hz = 10.0
[[bearing]]
id = "right"
shaft = "main"
elements = 11
element_diameter_mm = 7.9375
pitch_diameter_mm = 33.5
[[sensor]]
channel = "right_x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
"#;

/// A running daemon; killed when dropped.
#[derive(Debug)]
pub(crate) struct Daemon {
    /// Such as `http://127.0.0.1:40123`.
    pub(crate) base_url: String,
    /// The process.
    pub(crate) child: Child,
    /// Its folder, with the configuration as `serve.toml`.
    pub(crate) dir: TempDir,
    /// Ends with the process.
    stderr: Option<thread::JoinHandle<String>>,
}

/// What a process left behind.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// Makes a folder with the configuration `serve.toml` and other files, by name and content.
pub(crate) fn folder(config: &str, files: &[(&str, &[u8])]) -> TempDir {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("serve.toml"), config).unwrap();
    for (name, content) in files {
        fs::write(dir.path().join(name), content).unwrap();
    }
    dir
}

/// Writes a capture of channel `right_x`, m/s², whose sample i is i / 1000, as `name` in `dir`.
pub(crate) fn write_ramp(dir: &TempDir, name: &str, rate_hz: f64, n_samples: u32) {
    let samples: Vec<f64> = (0..n_samples).map(|i| f64::from(i) / 1e3).collect();
    write_samples(dir, name, rate_hz, &samples);
}

/// Writes a capture of channel `right_x`, m/s², as `name` in `dir`.
pub(crate) fn write_samples(dir: &TempDir, name: &str, rate_hz: f64, samples: &[f64]) {
    write_started(dir, name, (rate_hz, ""), samples);
}

/// Writes a capture of channel `right_x`, m/s², that began at a time (RFC 3339), or does not say when.
pub(crate) fn write_started(
    dir: &TempDir,
    name: &str,
    (rate_hz, start): (f64, &str),
    samples: &[f64],
) {
    let start_time = start
        .parse::<jiff::Timestamp>()
        .ok()
        .map(|time| rotorwatch::signal::Timestamp(i64::try_from(time.as_nanosecond()).unwrap()));
    let header = CaptureHeader { start_time, ..CaptureHeader::default() };
    let mut writer = CaptureWriter::create(&dir.path().join(name), &header).unwrap();
    let header = ChannelHeader {
        name: "right_x".to_owned(),
        sample_rate: Hz(rate_hz),
        unit: Some("m/s^2".to_owned()),
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    writer.channel(&header, ChannelSamples::F64(samples)).unwrap();
    writer.finish().unwrap();
}

/// `rotorwatch serve` in a folder, without our variables from outside.
fn serve(dir: &TempDir) -> Command {
    let mut command = command();
    command.arg("serve").arg("--config").arg(dir.path().join("serve.toml"));
    command
}

/// `rotorwatch`, without our variables from outside.
pub(crate) fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rotorwatch"));
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("ROTORWATCH_") {
            command.env_remove(name);
        }
    }
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs a command that ends by itself.
pub(crate) fn run(command: &mut Command) -> Ended {
    let output = command.output().unwrap();
    Ended {
        status: output.status,
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs a daemon that is expected not to start.
pub(crate) fn refused(config: &str, files: &[(&str, &[u8])]) -> Ended {
    refused_in(&folder(config, files))
}

/// Runs a daemon in a folder made by [`folder`]; it is expected not to start.
pub(crate) fn refused_in(dir: &TempDir) -> Ended {
    run(&mut serve(dir))
}

impl Daemon {
    /// Starts the daemon on port 0 (`config` must not have a `[server]` section) and waits for its
    /// first line.
    pub(crate) fn start(config: &str, files: &[(&str, &[u8])]) -> Self {
        Self::start_in(folder(&format!("[server]\nbind = \"127.0.0.1:0\"\n{config}"), files))
    }

    /// Starts the daemon in a folder made by [`folder`].
    pub(crate) fn start_in(dir: TempDir) -> Self {
        let command = serve(&dir);
        Self::spawn(command, dir)
    }

    /// As [`Self::start_in`], with another command line or environment.
    pub(crate) fn start_with(dir: TempDir, change: impl FnOnce(&mut Command)) -> Self {
        let mut command = serve(&dir);
        change(&mut command);
        Self::spawn(command, dir)
    }

    /// As [`Self::start_in`], with the log at `level`.
    pub(crate) fn start_logging(dir: TempDir, level: &str) -> Self {
        let mut command = serve(&dir);
        command.env(rotorwatch::telemetry::LOG_VARIABLE, level);
        Self::spawn(command, dir)
    }

    /// As [`Self::start_in`], with the second line on stdout.
    pub(crate) fn start_with_second_line(dir: TempDir) -> (Self, String) {
        let command = serve(&dir);
        let (daemon, mut stdout) = Self::spawn_reading(command, dir);
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        (daemon, line.trim_end().to_owned())
    }

    fn spawn(command: Command, dir: TempDir) -> Self {
        Self::spawn_reading(command, dir).0
    }

    /// As [`Self::start_with`], but the daemon may refuse to start.
    pub(crate) fn try_with(dir: TempDir, change: impl FnOnce(&mut Command)) -> Result<Self, Ended> {
        let mut command = serve(&dir);
        change(&mut command);
        Self::try_spawn(command, dir).map(|(daemon, _)| daemon)
    }

    fn spawn_reading(command: Command, dir: TempDir) -> (Self, BufReader<ChildStdout>) {
        Self::try_spawn(command, dir).unwrap_or_else(|ended| {
            panic!("first line {:?}, stderr:\n{}", ended.stdout, ended.stderr)
        })
    }

    fn try_spawn(
        mut command: Command,
        dir: TempDir,
    ) -> Result<(Self, BufReader<ChildStdout>), Ended> {
        let mut child = command.spawn().unwrap();
        let mut stderr_pipe = child.stderr.take().unwrap();
        let stderr = thread::spawn(move || {
            let mut text = String::new();
            stderr_pipe.read_to_string(&mut text).unwrap();
            text
        });
        // Ends by itself: with the line, or with the process.
        let mut line = String::new();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        stdout.read_line(&mut line).unwrap();
        let Some(url) = line.strip_prefix("listening on ") else {
            // Already ended, unless its first line was another one.
            let _ended = child.kill();
            let status = child.wait().unwrap();
            return Err(Ended { status, stdout: line, stderr: stderr.join().unwrap() });
        };
        let base_url = url.trim_end().to_owned();
        Ok((Self { base_url, child, dir, stderr: Some(stderr) }, stdout))
    }

    /// Status and text of a `GET`, whatever the status.
    pub(crate) fn get_text(&self, path: &str) -> (u16, String) {
        let mut response = agent().get(format!("{}{path}", self.base_url)).call().unwrap();
        (response.status().as_u16(), response.body_mut().read_to_string().unwrap())
    }

    /// Text of a `GET` of a content type.
    pub(crate) fn get_text_as(&self, path: &str, accept: &str) -> String {
        let request = agent().get(format!("{}{path}", self.base_url)).header("accept", accept);
        request.call().unwrap().body_mut().read_to_string().unwrap()
    }

    /// Status and document of a `GET`, whatever the status.
    pub(crate) fn get_json(&self, path: &str) -> (u16, Value) {
        let (status, text) = self.get_text(path);
        (status, serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}: {text}")))
    }

    /// Status and document of a `POST`, whatever the status.
    pub(crate) fn post_json(&self, path: &str, body: &Value) -> (u16, Value) {
        let url = format!("{}{path}", self.base_url);
        let mut response = agent().post(url).send_json(body).unwrap();
        let text = response.body_mut().read_to_string().unwrap();
        let status = response.status().as_u16();
        (status, serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}: {text}")))
    }

    /// Status of a `DELETE`.
    pub(crate) fn delete(&self, path: &str) -> u16 {
        let response = agent().delete(format!("{}{path}", self.base_url)).call().unwrap();
        response.status().as_u16()
    }

    /// Status, headers `names` and bytes of a `GET` of binary content.
    pub(crate) fn get_binary(&self, path: &str, names: &[&str]) -> (u16, Vec<String>, Vec<u8>) {
        let request = agent().get(format!("{}{path}", self.base_url));
        let mut response = request.header("accept", "application/octet-stream").call().unwrap();
        let header = |name: &&str| {
            response.headers().get(*name).map_or("", |value| value.to_str().unwrap()).to_owned()
        };
        let headers = names.iter().map(header).collect();
        (response.status().as_u16(), headers, response.body_mut().read_to_vec().unwrap())
    }

    /// Value of a sample in `/metrics`, by name and labels as written there.
    pub(crate) fn metric(&self, sample: &str) -> Option<f64> {
        let (_, text) = self.get_text("/metrics");
        let value = text.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' '));
        value.map(|value| value.parse().unwrap())
    }

    /// How the source of a machine is doing.
    pub(crate) fn source_of(&self, machine: &str) -> String {
        let (_, machines) = self.get_json("/api/v1/machines");
        let items = machines["items"].as_array().unwrap();
        let item = items.iter().find(|item| item["id"] == machine).unwrap();
        item["source"].as_str().unwrap().to_owned()
    }

    /// Waits until the replay of a machine has come to its end.
    pub(crate) fn wait_finished(&self, machine: &str) {
        wait_until("the end of the replay", || {
            let source = self.source_of(machine);
            assert!(!source.starts_with("failed"), "{source}");
            (source == "finished").then_some(())
        });
    }

    /// Sends bytes and then nothing more; gives what comes back, nothing if the daemon hangs up.
    pub(crate) fn send_raw(&self, bytes: &[u8]) -> Vec<u8> {
        let mut stream =
            TcpStream::connect(self.base_url.strip_prefix("http://").unwrap()).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        // A refusal may come, and the connection be cut, before everything is sent.
        let _cut = stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write));
        let mut answer = Vec::new();
        let _cut = stream.read_to_end(&mut answer);
        answer
    }

    /// Sends a signal, such as `TERM`.
    pub(crate) fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let sent = Command::new("kill").args(["-s", name, &pid]).status().unwrap();
        assert!(sent.success(), "kill -s {name} {pid}");
    }

    /// Waits for the end of the process.
    pub(crate) fn wait(mut self) -> Ended {
        let status = wait_until("the daemon to end", || self.child.try_wait().unwrap());
        let stderr = self.stderr.take().unwrap().join().unwrap();
        Ended { status, stdout: String::new(), stderr }
    }

    /// Sends SIGTERM and waits for the end.
    pub(crate) fn terminate(self) -> Ended {
        self.signal("TERM");
        self.wait()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Already ended: nothing to kill.
        let _ended = self.child.kill();
        let _ended = self.child.wait();
    }
}

fn agent() -> ureq::Agent {
    let config = ureq::Agent::config_builder();
    config.http_status_as_error(false).timeout_global(Some(LIMIT)).build().into()
}

/// Looks every 20 ms until `look` gives something; fails after 30 s.
pub(crate) fn wait_until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    wait_within(LIMIT, what, look)
}

/// Looks every 20 ms until `look` gives something; fails after `limit`.
pub(crate) fn wait_within<T>(
    limit: Duration,
    what: &str,
    mut look: impl FnMut() -> Option<T>,
) -> T {
    #[expect(clippy::disallowed_methods, reason = "a limit for a test that hangs")]
    let now = Instant::now;
    let started = now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(now().duration_since(started) < limit, "waited in vain for {what}");
        thread::sleep(POLL);
    }
}
