//! `rotorwatch demo`: the real daemon on a generated capture, with nothing configured.

use super::report;
use crate::api::view::MachineHandle;
use crate::app::build::StartError;
use crate::app::daemon::Daemon;
use crate::capture::error::CaptureError;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::demo::files;
use crate::demo::impulses::Defect;
use crate::demo::impulses::Scene;
use crate::diagnosis::verdict::Diagnosis;
use clap::Args;
use std::fs;
use std::io;
use std::io::Write;
use std::net::Ipv4Addr;
use std::net::SocketAddr;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;
use tempfile::TempDir;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch demo
  rotorwatch demo --bind 127.0.0.1:9000
  rotorwatch demo --dir demo-files
  curl http://127.0.0.1:8080/api/v1/machines/demo/diagnosis

The signal is made of closed-form impulses; it is not a simulation of a rig. Ctrl-C ends it.";

/// Port that is tried first; if it is taken, any free one.
const PORT: u16 = 8080;

/// Chance in the signal: the same at every start.
const SEED: u64 = 1;

/// Length of the capture, s; it is replayed again and again.
const DURATION_S: f64 = 60.0;

/// Seconds of signal a second: fast enough for a first verdict within seconds, slow enough to watch.
const SPEED: u8 = 4;

/// Names of the files in the folder.
const CAPTURE: &str = "demo-signal.h5";
const MACHINE: &str = "demo-machine.toml";
const CONFIGURATION: &str = "demo-rotorwatch.toml";

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Address and port of HTTP, loopback only [default: 127.0.0.1:8080, or any free port].
    #[arg(long, value_name = "ADDR", value_parser = loopback)]
    pub bind: Option<SocketAddr>,
    /// Keep the demonstration's files (demo-*) in this folder; without it they are temporary.
    #[arg(long, value_name = "FOLDER")]
    pub dir: Option<PathBuf>,
}

/// Why the demonstration cannot be started.
#[derive(Debug, thiserror::Error)]
enum DemoError {
    #[error("{}: the folder for the demonstration's files cannot be made", folder.display())]
    Folder { folder: PathBuf, source: io::Error },
    #[error("{}: cannot be written", file.display())]
    Write { file: PathBuf, source: io::Error },
    #[error("the demonstration's capture cannot be written")]
    Capture(#[from] CaptureError),
    #[error("the demonstration's configuration is refused")]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Start(#[from] StartError),
}

/// Runs the demonstration until a signal; exit code 0 then, 2 when it cannot be started.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match demonstrate(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => super::fail(&error),
    }
}

fn demonstrate(arguments: &Arguments) -> Result<(), DemoError> {
    let folder = Folder::make(arguments.dir.as_deref())?;
    let config = write_files(folder.path())?;
    let mut daemon = start(config, arguments.bind)?;
    let url = format!("http://{}", daemon.address());
    say(&format!("listening on {url}"));
    say(&format!(
        "demo signal: closed-form impulses, not a rig simulation; replayed at {SPEED} times real \
         time. The dashboard is at {url}/ and Ctrl-C ends it."
    ));
    for machine in daemon.machines().iter().cloned() {
        tell_first_verdict(machine, url.clone());
    }
    daemon.wait_for_signal();
    daemon.stop();
    Ok(())
}

/// Where the files stand; a temporary folder goes with it.
#[derive(Debug)]
enum Folder {
    Kept(PathBuf),
    Temporary(TempDir),
}

impl Folder {
    fn make(kept: Option<&Path>) -> Result<Self, DemoError> {
        let made = match kept {
            Some(folder) => fs::create_dir_all(folder).map(|()| Self::Kept(folder.to_owned())),
            None => {
                tempfile::Builder::new().prefix("rotorwatch-demo-").tempdir().map(Self::Temporary)
            }
        };
        let wanted = kept.map_or_else(std::env::temp_dir, Path::to_owned);
        made.map_err(|source| DemoError::Folder { folder: wanted, source })
    }

    fn path(&self) -> &Path {
        match self {
            Self::Kept(folder) => folder,
            Self::Temporary(folder) => folder.path(),
        }
    }
}

/// Writes capture, machine file and configuration, and reads the latter as `serve` would.
fn write_files(folder: &Path) -> Result<Config, DemoError> {
    let scene = Scene::with(Defect::InnerRace);
    files::write_capture(&folder.join(CAPTURE), &scene, SEED, DURATION_S)?;
    let write = |name: &str, text: &str| {
        let file = folder.join(name);
        fs::write(&file, text).map_err(|source| DemoError::Write { file, source })
    };
    write(MACHINE, files::MACHINE)?;
    write(CONFIGURATION, &configuration())?;
    // Without the environment: the demonstration is the same everywhere.
    Ok(config::load_with(&folder.join(CONFIGURATION), [])?)
}

fn configuration() -> String {
    format!(
        "# The daemon's configuration of `rotorwatch demo`; `rotorwatch serve --config` takes it too.\n\
         [[machine]]\nfile = \"{MACHINE}\"\n\n\
         [[source]]\nkind = \"replay\"\nmachine = \"demo\"\nfile = \"{CAPTURE}\"\n\
         speed = {SPEED}.0\nloop = true\n"
    )
}

/// Starts the daemon on the address asked for; on [`PORT`], or any free one, if none was.
fn start(config: Config, bind: Option<SocketAddr>) -> Result<Daemon, StartError> {
    let on = |port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let config = Config { bind: bind.unwrap_or(on(PORT)), ..config };
    match Daemon::start(&config) {
        Err(StartError::Bind { source, .. })
            if bind.is_none() && source.kind() == io::ErrorKind::AddrInUse =>
        {
            tracing::info!(port = PORT, "the port is taken, any free one is used");
            Daemon::start(&Config { bind: on(0), ..config })
        }
        started => started,
    }
}

/// Prints one line when the machine's first verdict is there, from a thread of its own, which ends
/// with the daemon.
fn tell_first_verdict(machine: MachineHandle, url: String) {
    let waiting = thread::Builder::new().name("demo-verdict".to_owned()).spawn(move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().build() else { return };
        let mut view = machine.view;
        let judged = runtime.block_on(view.wait_for(|view| view.diagnosis.is_some()));
        // An error: the daemon ended first.
        let Some(diagnosis) = judged.ok().and_then(|view| view.diagnosis.clone()) else { return };
        say(&verdict_line(&diagnosis, &url));
    });
    if let Err(error) = waiting {
        tracing::warn!(%error, "the verdict will not be printed, ask for it");
    }
}

fn verdict_line(diagnosis: &Diagnosis, url: &str) -> String {
    let found = report::accusation(diagnosis).map_or(String::new(), |worst| format!(": {worst}"));
    format!(
        "verdict: machine {} is {}{found}; ask with: curl {url}/api/v1/machines/{}/diagnosis",
        diagnosis.machine,
        diagnosis.state.name(),
        diagnosis.machine
    )
}

/// Prints a line. Without a reader the daemon goes on: it is asked over HTTP.
fn say(line: &str) {
    let mut stdout = io::stdout().lock();
    if let Err(error) = writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
        tracing::warn!(%error, line, "cannot be printed on stdout");
    }
}

/// Reads an address that other hosts cannot reach.
fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr =
        text.parse().map_err(|_| "not an address with port, such as 127.0.0.1:8080".to_owned())?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("can be reached from other hosts, and this version has no access tokens: use \
             127.0.0.1 or [::1]"
            .to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::fault::ComponentKind;
    use crate::diagnosis::fault::FaultMode;
    use crate::diagnosis::fault::State;
    use crate::offline;
    use crate::offline::Reference;
    use std::sync::Arc;

    /// Ten seconds of a scene, judged offline.
    fn judge(scene: &Scene, seed: u64) -> Diagnosis {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("x.h5");
        files::write_capture(&file, scene, seed, 10.0).unwrap();
        let machine = crate::machine::file::parse(files::MACHINE, "demo.toml").unwrap();
        let reference = Reference { machine: Some(Arc::new(machine)), ..Reference::default() };
        offline::diagnose(&file, &reference, &mut |_| ()).unwrap()
    }

    fn accused(diagnosis: &Diagnosis) -> Vec<(ComponentKind, Option<FaultMode>)> {
        let accused = diagnosis.components.iter().filter(|c| c.state.is_accusation());
        accused.map(|c| (c.kind, c.fault)).collect()
    }

    #[test]
    fn each_defect_is_named_and_a_healthy_bearing_is_not_accused() {
        for (scene, fault) in [
            (Scene::with(Defect::InnerRace), Some(FaultMode::InnerRace)),
            (Scene::with(Defect::OuterRace), Some(FaultMode::OuterRace)),
            (Scene::healthy(), None),
        ] {
            for seed in [1, 2] {
                let diagnosis = judge(&scene, seed);
                let expected: Vec<_> =
                    fault.iter().map(|f| (ComponentKind::Bearing, Some(*f))).collect();
                assert_eq!(accused(&diagnosis), expected, "{seed} {diagnosis:#?}");
                let bearing = &diagnosis.components[0];
                assert_eq!(bearing.kind, ComponentKind::Bearing);
                if fault.is_none() {
                    assert_eq!(bearing.state, State::Healthy, "{}", bearing.why);
                }
            }
        }
    }

    #[test]
    fn same_seed_same_verdict() {
        let scene = Scene::with(Defect::InnerRace);
        assert_eq!(judge(&scene, 3), judge(&scene, 3));
    }

    #[test]
    fn the_configuration_is_one_that_serve_accepts() {
        let dir = tempfile::tempdir().unwrap();
        let config = write_files(dir.path()).unwrap();
        assert_eq!(config.machines.len(), 1);
        assert_eq!(config.machines[0].machine.id, "demo");
    }

    #[test]
    fn a_temporary_folder_goes_and_a_named_one_stays() {
        let gone = {
            let folder = Folder::make(None).unwrap();
            assert!(folder.path().is_dir());
            folder.path().to_owned()
        };
        assert!(!gone.exists());
        let dir = tempfile::tempdir().unwrap();
        let kept = dir.path().join("a/b");
        drop(Folder::make(Some(&kept)).unwrap());
        assert!(kept.is_dir());
    }

    #[test]
    fn addresses_of_other_hosts_are_refused() {
        assert!(loopback("127.0.0.1:0").is_ok() && loopback("[::1]:80").is_ok());
        assert!(loopback("0.0.0.0:80").unwrap_err().contains("other hosts"));
        assert!(loopback("8080").unwrap_err().contains("127.0.0.1:8080"));
    }
}
