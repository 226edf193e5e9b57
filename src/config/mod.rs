//! Configuration of the daemon: raw TOML and environment → validated [`Config`].
//!
//! The file is first read alone, so that every mistake has its line and column and all of them are
//! reported at once; then the environment is merged over it by the `config` crate. Past this
//! module nothing is checked twice. Must not start anything.

pub mod keys;
mod log;
mod redact;
pub mod change;
mod scan;
mod raw;
mod resolve;
mod machines;
mod notify;
mod access;
mod ingest;
mod live;

pub use access::Access;
pub use access::Exposure;
pub use access::Identity;
pub use access::Limits;
pub use access::Tls;
pub use access::TokenList;
pub use ingest::Ingest;
pub use live::Live;
pub use live::Subscription;
pub use log::LogLevel;
pub use redact::redacted;

use crate::capture::recording::machine as recording;
use crate::diagnosis::rate;
use crate::diagnosis::rate::FalseAlarms;
use crate::ingest::replay;
use crate::ingest::simulated;
use crate::machine::Machine;
use crate::notify::settings as receivers;
use crate::pipeline;
use crate::pipeline::SpeedHints;
use crate::pipeline::windows;
use crate::signal::ChannelInfo;
use crate::store::trends::Retention;
use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::net::Ipv4Addr;
use std::net::SocketAddr;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// The commented reference of every key, printed by `serve --print-config`.
pub const REFERENCE: &str = include_str!("../../config/default.toml");

/// The validated configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Where HTTP is served. Port 0: any free port.
    pub bind: SocketAddr,
    /// Who may reach it.
    pub access: Access,
    /// How senders of samples are let in.
    pub ingest: Ingest,
    /// Where recordings are kept.
    pub store: Store,
    /// Shard threads; 0: one fewer than there are cores, at least 1.
    pub workers: usize,
    /// Most bytes the rings and queues may need together.
    pub memory_limit_bytes: u64,
    /// How what is received is recorded; `None`: not at all.
    pub recording: Option<recording::Settings>,
    /// What is kept of the raw data of an alarm; `None`: nothing.
    pub captures: Option<Captures>,
    /// How windows are laid and alarms raised.
    pub monitor: pipeline::Settings,
    /// Whether windows are longer for machines that turn slowly ([`pipeline::windows::lengthened`]).
    pub lengthen_windows: bool,
    /// Who is told of alarms.
    pub notify: receivers::Settings,
    /// The least that is logged.
    pub log: LogLevel,
    /// The machines, each with its source.
    pub machines: Vec<MachineConfig>,
    /// Every file it was read from.
    pub files: Files,
}

/// Files that a configuration was read from. They are no part of what it says, nor of its hash.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct Files(pub Vec<PathBuf>);

impl fmt::Debug for Files {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Files")
    }
}

/// The text of a file as it was read. It says nothing that was not parsed, and is no part of a hash.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct FileText(pub Arc<str>);

impl fmt::Debug for FileText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("FileText")
    }
}

impl Config {
    /// What recordings and trends may take together: what captures leave of the store, bytes.
    #[must_use]
    pub fn bytes_beside_captures(&self) -> u64 {
        let of_captures = self.captures.map_or(0, |captures| captures.max_bytes);
        self.store.max_bytes.saturating_sub(of_captures)
    }

    /// Settings of the monitor of a machine whose stream has these channels: with longer windows where it turns slowly, unless they
    /// shall stay as stated.
    #[must_use]
    pub fn monitor_of(
        &self,
        (machine, hints): (&Machine, SpeedHints),
        channels: &[ChannelInfo],
    ) -> pipeline::Settings {
        if self.lengthen_windows {
            windows::lengthened(&self.monitor, (machine, hints), channels)
        } else {
            self.monitor.clone()
        }
    }
}

/// Where recordings and trends are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    /// Folder.
    pub directory: PathBuf,
    /// Most bytes of recordings and trends in it.
    pub max_bytes: u64,
    /// How long trends are kept.
    pub trends: Retention,
}

impl Default for Store {
    fn default() -> Self {
        let directory = PathBuf::from("data");
        Self { directory, max_bytes: 20_000_000_000, trends: Retention::default() }
    }
}

/// What is kept of the raw data of an alarm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Captures {
    /// Stream time before the alarm, s.
    pub before_s: f64,
    /// Stream time after it, s.
    pub after_s: f64,
    /// Captures of a machine an hour, at most.
    pub most_per_hour: usize,
    /// Bytes of all captures together, at most.
    pub max_bytes: u64,
}

/// Longest stretch of the past that is held for captures without being asked for, s.
const MAX_SECONDS_BEFORE: f64 = 600.0;

impl Captures {
    /// The same, with every window of `monitor` that raises an alarm, as far as ten minutes hold them.
    #[must_use]
    pub fn holding(self, monitor: &pipeline::Settings) -> Self {
        let needed_s = monitor.window_s + monitor.hop_s + monitor.alarms.on_delay_s;
        Self { before_s: self.before_s.max(needed_s.min(MAX_SECONDS_BEFORE)), ..self }
    }
}

/// What is kept of the raw data of an alarm unless the configuration says otherwise.
pub const CAPTURES: Captures =
    Captures { before_s: 30.0, after_s: 10.0, most_per_hour: 12, max_bytes: 2_000_000_000 };

/// How recordings are cut and stored unless the configuration says otherwise.
pub const RECORDING: recording::Settings =
    recording::Settings { segment_s: 600.0, segment_bytes: 500_000_000, flush_s: 1.0, gzip: None };

/// One machine to be monitored.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineConfig {
    /// The machine file.
    pub file: PathBuf,
    /// Its text, which captures keep.
    pub text: FileText,
    /// What it says.
    pub machine: Arc<Machine>,
    /// Healthy captures of the same machine.
    pub baseline: Vec<PathBuf>,
    /// Where its samples come from.
    pub source: SourceConfig,
}

/// Where samples come from.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceConfig {
    /// A capture, played back.
    Replay(replay::Settings),
    /// A scene, simulated as long as the daemon runs.
    Simulated(Box<simulated::Settings>),
    /// Senders on a network, and brokers.
    Live(Live),
}

impl Config {
    /// Every file that it was read from, or that a daemon with it reads.
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        let played = self.machines.iter().filter_map(|machine| match &machine.source {
            SourceConfig::Replay(settings) => Some(&settings.file),
            SourceConfig::Simulated(_) | SourceConfig::Live(_) => None,
        });
        let baselines = self.machines.iter().flat_map(|machine| &machine.baseline);
        let machines = self.machines.iter().map(|machine| &machine.file);
        let files = self.files.0.iter().chain(machines).chain(baselines).chain(played);
        files.map(PathBuf::as_path)
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            bind: SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)),
            access: Access::default(),
            ingest: Ingest::default(),
            store: Store::default(),
            recording: None,
            captures: Some(CAPTURES),
            workers: 0,
            memory_limit_bytes: 2_000_000_000,
            monitor: held_to(pipeline::Settings::default(), rate::A_COMPONENT_YEAR),
            lengthen_windows: false,
            notify: receivers::Settings::default(),
            log: LogLevel::default(),
            machines: Vec::new(),
            files: Files::default(),
        }
    }
}

/// Settings of which the false alarms a component and year are so many.
fn held_to(settings: pipeline::Settings, a_year: f64) -> pipeline::Settings {
    let windows = (settings.window_s, settings.hop_s);
    let false_alarms = FalseAlarms::a_year(a_year, windows, settings.alarms.on_delay_s);
    pipeline::Settings { false_alarms, ..settings }
}

/// One mistake in the configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where: `file:line:column`, `file` or `environment`.
    pub place: String,
    /// What was found, what is allowed.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.message)
    }
}

/// Why a configuration was refused: every mistake found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigErrors(pub Vec<Problem>);

impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.0.iter().enumerate() {
            let separator = if i == 0 { "" } else { "\n" };
            write!(f, "{separator}{problem}")?;
        }
        Ok(())
    }
}

impl std::error::Error for ConfigErrors {}

/// Reads and validates the configuration file at `path` with the process's environment over it.
///
/// # Errors
/// With every mistake found, each with its place.
pub fn load(path: &Path) -> Result<Config, ConfigErrors> {
    load_as(path, Exposure::Guarded)
}

/// As [`load`], for a daemon that was started so.
///
/// # Errors
/// With every mistake found, each with its place.
pub fn load_as(path: &Path, exposure: Exposure) -> Result<Config, ConfigErrors> {
    read(path, std::env::vars_os().filter_map(|(k, v)| Some((k.into_string().ok()?, v))), exposure)
}

/// Reads and validates the configuration file at `path` with `environment` over it.
///
/// # Errors
/// With every mistake found, each with its place.
pub fn load_with(
    path: &Path,
    environment: impl IntoIterator<Item = (String, std::ffi::OsString)>,
) -> Result<Config, ConfigErrors> {
    read(path, environment, Exposure::Guarded)
}

/// Names the file of tokens of a configuration, whatever else is wrong with it; `None`: it has none.
///
/// # Errors
/// When the configuration cannot be read.
pub fn token_file(path: &Path) -> Result<Option<PathBuf>, ConfigErrors> {
    let environment = std::env::vars_os();
    let environment = environment.filter_map(|(k, v)| Some((k.into_string().ok()?, v)));
    let (merged, ..) = merged(path, environment)?;
    let base = path.parent().unwrap_or(Path::new(""));
    Ok(merged.server.token_file.filter(|file| !file.is_empty()).map(|file| base.join(file)))
}

fn read(
    path: &Path,
    environment: impl IntoIterator<Item = (String, std::ffi::OsString)>,
    exposure: Exposure,
) -> Result<Config, ConfigErrors> {
    let (merged, mut scan, variables) = merged(path, environment)?;
    let base = path.parent().unwrap_or(Path::new(""));
    let mut config = resolve::config(merged, base, &mut scan, &variables, exposure);
    config.files.0.push(path.to_owned());
    if scan.problems.is_empty() { Ok(config) } else { Err(ConfigErrors(scan.problems)) }
}

/// What stands in the file with the environment over it, and the mistakes so far.
fn merged(
    path: &Path,
    environment: impl IntoIterator<Item = (String, std::ffi::OsString)>,
) -> Result<(raw::Raw, scan::Scan, BTreeMap<String, String>), ConfigErrors> {
    let text = fs::read_to_string(path).map_err(|error| {
        ConfigErrors(vec![Problem {
            place: path.display().to_string(),
            message: format!("the configuration cannot be read: {error}"),
        }])
    })?;
    let mut scan = scan::file(path, &text)?;
    let variables = scan::environment(environment, &mut scan.problems);
    let merged = match raw::merge(&scan.values, &variables) {
        Ok(merged) => merged,
        Err(problem) => {
            scan.problems.push(problem);
            return Err(ConfigErrors(scan.problems));
        }
    };
    Ok((merged, scan, variables))
}

#[cfg(test)]
mod tests;
