//! `rotorwatch bench monitor --channels N`: the daemon itself on what a sender streams in real time, and whether its ledger
//! says exactly what was sent.

use crate::app;
use crate::app::live::client;
use crate::app::live::client::SendError;
use crate::app::live::client::Sender;
use crate::app::live::line::Address;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use crate::wire::Block;
use crate::wire::Bye;
use crate::wire::Channel;
use crate::wire::Hello;
use crate::wire::SampleType;
use crate::wire::Samples;
use cpu_time::ProcessTime;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use serde_json::json;
use std::fs;
use std::io;
use std::io::BufRead;
use std::io::BufReader;
use std::process::Child;
use std::process::Command;
use std::process::Stdio;
use std::time::Duration;

/// Samples a second of a channel, and of a block: a tenth of a second.
const RATE_HZ: u32 = 10_000;
const BLOCK: u32 = 1000;

/// Channels of a machine, at most.
const PER_MACHINE: usize = 100;

/// Bytes that may wait to be settled, a machine.
const MAX_KEPT_BYTES: usize = 4 << 20;

/// Ticks of the kernel's processor times a second.
const TICKS: f64 = 100.0;

/// What is streamed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Channels.
    pub n_channels: usize,
    /// For so long, s.
    pub seconds: u32,
    /// Whether they are only received, buffered and counted.
    pub receive_only: bool,
}

/// The columns of the table.
pub const COLUMNS: [Column; 12] = [
    Column { name: "channels", width: 8 },
    Column { name: "seconds", width: 7 },
    Column { name: "took_s", width: 7 },
    Column { name: "sent", width: 11 },
    Column { name: "used", width: 11 },
    Column { name: "lost", width: 6 },
    Column { name: "exact", width: 5 },
    Column { name: "daemon_cores", width: 12 },
    Column { name: "sender_cores", width: 12 },
    Column { name: "verdicts", width: 8 },
    Column { name: "latency_p99_s", width: 13 },
    Column { name: "resident_kb_a_channel", width: 21 },
];

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// A file or process.
    #[error("the daemon to be measured cannot be run")]
    Io(#[from] io::Error),
    /// The daemon did not start.
    #[error("the daemon to be measured does not start: {said}")]
    Start {
        /// What it said instead of its address.
        said: String,
    },
    /// A sender.
    #[error("sending failed")]
    Send(#[from] SendError),
    /// HTTP.
    #[error("the daemon cannot be asked")]
    Ask(#[from] Box<ureq::Error>),
}

/// The daemon; ended when dropped.
struct Daemon {
    child: Child,
    http: String,
    ingest: String,
    _folder: tempfile::TempDir,
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Already ended: nothing to kill.
        let _ended = self.child.kill();
        let _ended = self.child.wait();
    }
}

/// Streams and gives the row.
///
/// # Errors
/// See [`LiveError`].
pub fn run(load: Load) -> Result<Vec<Cell>, LiveError> {
    let sizes: Vec<usize> = (0..load.n_channels)
        .step_by(PER_MACHINE)
        .map(|first| PER_MACHINE.min(load.n_channels - first))
        .collect();
    let daemon = start(load, &sizes)?;
    let mut senders = Vec::new();
    for (machine, n) in sizes.iter().enumerate() {
        senders.push(Sender::connect(
            &Address::Tcp(daemon.ingest.clone(), false),
            None,
            hello(machine, *n),
        )?);
    }
    let (begun, own, before_s) = (app::now(), ProcessTime::now(), daemon.cpu_s());
    let start = app::wall_clock();
    let noise = noise();
    let n_blocks = load.seconds * RATE_HZ / BLOCK;
    for k in 0..n_blocks {
        // A block is sent when its last sample has been taken.
        client::wait_until(begun + Duration::from_millis(100) * (k + 1));
        let first = u64::from(k) * u64::from(BLOCK);
        let time_ns = start.plus_seconds(first as f64 / f64::from(RATE_HZ)).0;
        for (sender, n) in senders.iter_mut().zip(&sizes) {
            for stream in 0..u16::try_from(*n).unwrap_or(u16::MAX) {
                // Each channel hears another part of the noise.
                let at = usize::from(stream) * 4 + 4 * (k as usize % 7);
                let bytes = &noise[at..at + 4 * BLOCK as usize];
                let Some(samples) = Samples::new(SampleType::F32, bytes) else { continue };
                let block = Block { stream, sequence: k.into(), first, time_ns, samples };
                sender.send(&block, MAX_KEPT_BYTES)?;
            }
        }
    }
    for sender in senders {
        sender.finish(Bye::Pause)?;
    }
    let took_s = app::now().saturating_duration_since(begun).as_secs_f64();
    let (daemon_s, sender_s) = (daemon.cpu_s() - before_s, own.elapsed().as_secs_f64());
    let sent = u64::from(n_blocks) * u64::from(BLOCK) * load.n_channels as u64;
    let counted = daemon.counted(sizes.len(), sent)?;
    let (verdicts, p99_s) = daemon.latency()?;
    Ok(vec![
        Cell::Plain(load.n_channels as f64, 0),
        Cell::Plain(f64::from(load.seconds), 0),
        Cell::Plain(took_s, 1),
        Cell::Plain(sent as f64, 0),
        Cell::Plain(counted.used as f64, 0),
        Cell::Plain(counted.lost as f64, 0),
        Cell::Flag(counted.used == sent && counted.is_exact),
        Cell::Plain(daemon_s / took_s, 3),
        Cell::Plain(sender_s / took_s, 3),
        Cell::Plain(verdicts, 0),
        Cell::Plain(p99_s, 3),
        Cell::Plain(daemon.resident_kb() / load.n_channels as f64, 0),
    ])
}

/// For the documents.
#[must_use]
pub fn settings(load: Load) -> Value {
    json!({
        "samples_a_second": RATE_HZ,
        "block_samples": BLOCK,
        "channels_a_machine": PER_MACHINE,
        "receive_only": load.receive_only,
    })
}

/// Starts a daemon with machines of so many channels.
fn start(load: Load, sizes: &[usize]) -> Result<Daemon, LiveError> {
    let folder = tempfile::tempdir()?;
    let mut config = "[server]\nbind = \"127.0.0.1:0\"\n[ingest]\nbind = \"127.0.0.1:0\"\nmax_connections = 4096\n\
         [captures]\nenabled = false\n[pipeline]\nwindow_seconds = 2\nhop_seconds = 1\nring_seconds = 3\n\
         memory_limit_bytes = 100000000000\n"
        .to_owned();
    for (machine, n) in sizes.iter().enumerate() {
        fs::write(folder.path().join(format!("{machine}.toml")), machine_text(machine, *n, load))?;
        config.push_str(&format!(
            "[[machine]]\nfile = \"{machine}.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"m{machine}\"\n"
        ));
    }
    let path = folder.path().join("rotorwatch.toml");
    fs::write(&path, config)?;
    let mut child = Command::new(std::env::current_exe()?)
        .args(["serve", "--config"])
        .arg(&path)
        .env(crate::telemetry::LOG_VARIABLE, "error")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut lines = [String::new(), String::new()];
    if let Some(stdout) = child.stdout.take() {
        let mut stdout = BufReader::new(stdout);
        for line in &mut lines {
            stdout.read_line(line)?;
        }
    }
    let [http, ingest] = &lines;
    let http = http.trim_end().strip_prefix("listening on ").map(str::to_owned);
    let ingest = ingest.trim_end().strip_prefix("ingest on tcp://").map(str::to_owned);
    match http.zip(ingest) {
        Some((http, ingest)) => {
            tracing::info!("the daemon that is measured answers on {http}");
            Ok(Daemon { child, http, ingest, _folder: folder })
        }
        None => {
            let _ended = child.kill();
            Err(LiveError::Start { said: lines.concat() })
        }
    }
}

/// A shaft and a bearing; every channel has a sensor, or only the first of them.
fn machine_text(machine: usize, n: usize, load: Load) -> String {
    let mut text = format!(
        "[machine]\nid = \"m{machine}\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 29.7\n[[bearing]]\nid = \"near\"\n\
         shaft = \"main\"\nelements = 9\nelement_diameter_mm = 7.94\npitch_diameter_mm = 39.04\n"
    );
    for i in 0..if load.receive_only { 1 } else { n } {
        text.push_str(&format!(
            "[[sensor]]\nchannel = \"c{i}\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\nat = {{ bearing = \"near\" }}\n"
        ));
    }
    text
}

fn hello(machine: usize, n: usize) -> Hello {
    let rate_hz = f64::from(RATE_HZ);
    let channel = |i: usize| Channel::new(&format!("c{i}"), rate_hz, SampleType::F32, "m/s^2");
    Hello::new(&format!("m{machine}"), 1, (0..n).map(channel).collect())
}

/// What the channels hear, as it travels.
fn noise() -> Vec<u8> {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    (0..2 * BLOCK).flat_map(|_| (random.random::<f32>() - 0.5).to_le_bytes()).collect()
}

/// The ledgers of all machines together.
#[derive(Debug, Default)]
struct Counted {
    used: u64,
    lost: u64,
    is_exact: bool,
}

impl Daemon {
    fn get(&self, path: &str) -> Result<String, LiveError> {
        let answer = ureq::get(format!("{}{path}", self.http)).call();
        let text = answer.and_then(|mut answer| answer.body_mut().read_to_string());
        text.map_err(|error| LiveError::Ask(Box::new(error)))
    }

    /// What became of the samples, once the rings have all that is in the queues.
    fn counted(&self, n_machines: usize, sent: u64) -> Result<Counted, LiveError> {
        let deadline = app::now() + Duration::from_secs(60);
        loop {
            let mut counted = Counted { is_exact: true, ..Counted::default() };
            let mut kept = 0;
            for machine in 0..n_machines {
                let text = self.get(&format!("/api/v1/machines/m{machine}/channels"))?;
                let document: Value = serde_json::from_str(&text).unwrap_or_default();
                for channel in document["items"].as_array().into_iter().flatten() {
                    let ledger = &channel["ledger"];
                    let count = |name: &str| ledger[name].as_u64().unwrap_or(0);
                    counted.used += count("used");
                    counted.lost += count("lost");
                    counted.is_exact &= count("received") == count("used");
                    kept += channel["received"].as_u64().unwrap_or(0);
                }
            }
            if kept == sent || app::now() >= deadline {
                counted.is_exact &= kept == sent;
                return Ok(counted);
            }
            client::wait_until(app::now() + Duration::from_millis(100));
        }
    }

    /// Verdicts, and the upper bound of the bin that holds 99 of 100 latencies, s.
    fn latency(&self) -> Result<(f64, f64), LiveError> {
        let text = self.get("/metrics")?;
        let mut bins: Vec<(f64, f64)> = Vec::new();
        for line in
            text.lines().filter(|l| l.starts_with("rotorwatch_verdict_latency_seconds_bucket"))
        {
            let bound = line.split("le=\"").nth(1).and_then(|rest| rest.split('"').next());
            let bound = bound.map_or(f64::INFINITY, |text| text.parse().unwrap_or(f64::INFINITY));
            let count: f64 =
                line.rsplit(' ').next().and_then(|text| text.parse().ok()).unwrap_or(0.0);
            match bins.iter_mut().find(|(known, _)| known.total_cmp(&bound).is_eq()) {
                Some((_, sum)) => *sum += count,
                None => bins.push((bound, count)),
            }
        }
        bins.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all = bins.last().map_or(0.0, |(_, count)| *count);
        let p99 = bins.iter().find(|(_, count)| *count >= 0.99 * all);
        Ok((all, p99.map_or(f64::NAN, |(bound, _)| *bound)))
    }

    /// Processor time so far, s; 0 where it is not told.
    fn cpu_s(&self) -> f64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.child.id()));
        let stat = stat.unwrap_or_default();
        // Behind the name in brackets, which may hold anything.
        let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
        let ticks: f64 =
            fields.skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
        ticks / TICKS
    }

    /// Resident memory, kB; 0 where it is not told.
    fn resident_kb(&self) -> f64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id()));
        let status = status.unwrap_or_default();
        let line = status.lines().find(|line| line.starts_with("VmRSS"));
        let number = line.and_then(|line| line.split_whitespace().nth(1));
        number.and_then(|number| number.parse().ok()).unwrap_or(0.0)
    }
}
