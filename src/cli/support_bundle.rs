//! `rotorwatch support-bundle`: what others need to know of a daemon that does not do what it should, without secrets.

use super::backup::ArchiveError;
use super::backup::private;
use super::client::Api;
use super::client::AskError;
use super::client::DaemonArguments;
use super::output::Spared;
use crate::app;
use crate::causes::with_causes;
use crate::config;
use crate::config::Config;
use crate::store::backup::BackupError;
use crate::store::backup::told;
use clap::Args;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::fs::File;
use std::io;
use std::io::Write as _;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch support-bundle --out support.tar.gz
  rotorwatch support-bundle --config rotorwatch.toml --out support.tar.gz
  rotorwatch support-bundle --config rotorwatch.toml --token-file admin.token --out support.tar.gz

In it: versions, computer, readiness, system, machines with health, channels and ledgers, alarms, the newest events of
alarms, audit and log, metrics; with --config the configuration without values that are or may be secret, the machine
files, and which files the store has. A daemon that does not answer, or a part that its token may not see, is no error:
missing.txt says what is not there. Read it before you send it: names of machines and people are in it.

Exit codes: 0 done; 2 an error.";

/// Folder in the archive.
const FOLDER: &str = "rotorwatch-support";

/// Machines of which health and channels are asked for, at most.
const MAX_MACHINES: usize = 1000;

/// Items of a list, at most.
const NEWEST: usize = 1000;

/// Arguments of `support-bundle`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The daemon.
    #[command(flatten)]
    pub daemon: DaemonArguments,
    /// Its configuration: where it is unless --url says so; shown without secrets.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The archive, which must not be there yet.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Makes the bundle; exit code 0, or 2 on an error.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match bundle(arguments) {
        Ok(text) => super::print(text.as_bytes()),
        Err(error) => super::fail(&error),
    }
}

/// An archive with a list of what is not in it.
struct Bundle {
    out: tar::Builder<GzEncoder<File>>,
    missing: String,
    n_files: usize,
}

impl Bundle {
    fn add(&mut self, name: &str, text: &str) -> io::Result<()> {
        let mut header = tar::Header::new_gnu();
        header.set_mode(0o600);
        header.set_size(text.len() as u64);
        self.n_files += 1;
        self.out.append_data(&mut header, format!("{FOLDER}/{name}"), text.as_bytes())
    }

    /// Adds what there is, or why it is not there.
    fn add_or_tell<E: Error>(&mut self, name: &str, found: Result<String, E>) -> io::Result<()> {
        match found {
            Ok(text) => self.add(name, &text),
            Err(error) => {
                // A String takes everything.
                let _never = writeln!(self.missing, "{name}: {}", with_causes(&error));
                Ok(())
            }
        }
    }
}

fn bundle(arguments: &Arguments) -> Result<String, ArchiveError> {
    let out = &arguments.out;
    if out.exists() {
        return Err(ArchiveError::Exists { file: out.clone() });
    }
    let config = arguments.config.as_deref();
    let config = config.map(|file| config::load_as(file, config::Exposure::Insecure));
    config.and_then(Result::ok).as_ref().map(Spared::of).unwrap_or_default().refuse(out)?;
    let opened = private(out).map_err(told("making", out))?;
    let archive = tar::Builder::new(GzEncoder::new(opened, Compression::default()));
    let mut bundle = Bundle { out: archive, missing: String::new(), n_files: 0 };
    let done = gather(arguments, &mut bundle);
    let writing = told("writing", out);
    done.map_err(&writing)?;
    let gzip = bundle.out.into_inner().map_err(&writing)?;
    gzip.finish().and_then(|mut file| file.flush()).map_err(&writing)?;
    Ok(format!("{}: {} files\n{}", out.display(), bundle.n_files, bundle.missing))
}

fn gather(arguments: &Arguments, bundle: &mut Bundle) -> io::Result<()> {
    bundle.add("about.txt", &about())?;
    let config = match &arguments.config {
        Some(file) => of_configuration(file, bundle)?,
        None => None,
    };
    let mut daemon = arguments.daemon.clone();
    daemon.url = daemon.url.or_else(|| config.as_ref().and_then(own_url));
    match Api::new(&daemon) {
        Ok(api) => of_daemon(&api, bundle)?,
        Err(error) => bundle.add_or_tell("daemon", Err::<String, _>(error))?,
    }
    let missing = bundle.missing.clone();
    bundle.add("missing.txt", &missing)
}

/// Where the daemon of a configuration answers on this computer; `None`: it takes any port.
fn own_url(config: &Config) -> Option<String> {
    let scheme = if config.access.tls.is_some() { "https" } else { "http" };
    let (ip, port) = (config.bind.ip(), config.bind.port());
    let host = if ip.is_unspecified() { "localhost".to_owned() } else { ip.to_string() };
    let host = if ip.is_ipv6() && !ip.is_unspecified() { format!("[{host}]") } else { host };
    (port != 0).then(|| format!("{scheme}://{host}:{port}"))
}

/// The program and the computer.
fn about() -> String {
    let read = |file: &str| fs::read_to_string(file).unwrap_or_default();
    let line = |text: &str, start: &str| {
        text.lines().find(|line| line.starts_with(start)).unwrap_or_default().to_owned()
    };
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "rotorwatch {version} ({} {})\nmade at {}\n{}\n{}cores: {cores}\n{}\n{}\n",
        std::env::consts::ARCH,
        std::env::consts::OS,
        crate::api::wire::rfc3339(Some(app::wall_clock()), 0.0),
        line(&read("/etc/os-release"), "PRETTY_NAME="),
        read("/proc/version"),
        line(&read("/proc/meminfo"), "MemTotal:"),
        line(&read("/proc/cpuinfo"), "model name"),
    )
}

/// The configuration without secrets, its machine files, names of overriding variables, files of the store.
fn of_configuration(file: &Path, bundle: &mut Bundle) -> io::Result<Option<Config>> {
    let told = |file: &Path| {
        let file = file.to_owned();
        move |source| BackupError::File { doing: "reading", file, source }
    };
    let text = fs::read_to_string(file).map(|text| config::redacted(&text)).map_err(told(file));
    bundle.add_or_tell("configuration.toml", text)?;
    let ours = |name: &std::ffi::OsString| name.to_string_lossy().starts_with("ROTORWATCH_");
    let names = std::env::vars_os().map(|(name, _)| name).filter(ours);
    let names: String = names.map(|name| format!("{}\n", name.to_string_lossy())).collect();
    bundle.add("variables.txt", &names)?;
    let config = match config::load_as(file, config::Exposure::Insecure) {
        Ok(config) => config,
        Err(mistakes) => {
            bundle.add("configuration-mistakes.txt", &mistakes.to_string())?;
            return Ok(None);
        }
    };
    for machine in &config.machines {
        let name = format!("machines/{}.toml", machine.machine.id);
        bundle.add(&name, &machine.text.0)?;
    }
    bundle.add("store.txt", &listing(&config.store.directory))?;
    Ok(Some(config))
}

/// Files of a folder and those in it with their sizes.
fn listing(folder: &Path) -> String {
    let mut text = String::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        let entries = fs::read_dir(&next).into_iter().flatten().flatten();
        for entry in entries {
            let path = entry.path();
            match entry.metadata() {
                Ok(found) if found.is_dir() => folders.push(path),
                Ok(found) => {
                    // A String takes everything.
                    let _never = writeln!(text, "{} {}", found.len(), path.display());
                }
                Err(error) => {
                    let _never = writeln!(text, "{}: {error}", path.display());
                }
            }
        }
    }
    text
}

fn of_daemon(api: &Api, bundle: &mut Bundle) -> io::Result<()> {
    let text = |found: Result<Value, AskError>| found.map(|found| format!("{found:#}\n"));
    let ready = api.readiness().map(|(ready, problem)| format!("{ready}\n{problem:#}\n"));
    let answers = ready.is_ok();
    bundle.add_or_tell("daemon/readiness.txt", ready)?;
    if !answers {
        return Ok(());
    }
    let newest = NEWEST.to_string();
    for (name, path, query) in [
        ("system", &["system"][..], &[][..]),
        ("machines", &["machines"], &[("components", "true")]),
        ("alarms", &["alarms"], &[("limit", &*newest)]),
        ("alarm-load", &["alarms", "load"], &[]),
        ("alarm-history", &["alarms", "history"], &[("limit", &newest)]),
        ("audit", &["audit"], &[("limit", &newest)]),
        ("configurations", &["configurations"], &[]),
        ("captures", &["captures"], &[("limit", &newest)]),
    ] {
        bundle.add_or_tell(&format!("daemon/{name}.json"), text(api.get(path, query)))?;
    }
    bundle.add_or_tell("daemon/metrics.txt", api.text("/metrics"))?;
    let lines = api.get(&["log"], &[("limit", &newest)]).map(|found| {
        let lines = found["lines"].as_array().map_or(&[][..], Vec::as_slice);
        lines.iter().filter_map(Value::as_str).map(|line| format!("{line}\n")).collect()
    });
    bundle.add_or_tell::<AskError>("daemon/log.txt", lines)?;
    let machines = api.get(&["machines"], &[]).unwrap_or_default();
    let items = machines["items"].as_array().map_or(&[][..], Vec::as_slice);
    for id in items.iter().filter_map(|one| one["id"].as_str()).take(MAX_MACHINES) {
        for part in ["health", "channels", "silences"] {
            let found = text(api.get(&["machines", id, part], &[]));
            bundle.add_or_tell(&format!("daemon/{id}-{part}.json"), found)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_says_where_its_daemon_answers() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("rotorwatch.toml");
        for (bind, expected) in [
            ("127.0.0.1:9000", Some("http://127.0.0.1:9000")),
            ("[::1]:9000", Some("http://[::1]:9000")),
            ("0.0.0.0:9000", Some("http://localhost:9000")),
            ("127.0.0.1:0", None),
        ] {
            fs::write(&file, format!("[server]\nbind = \"{bind}\"\n")).unwrap();
            let config = config::load_as(&file, config::Exposure::Insecure).unwrap();
            assert_eq!(own_url(&config).as_deref(), expected, "{bind}");
        }
    }
}
