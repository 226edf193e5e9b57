//! `rotorwatch demo`: the real daemon on the simulated rig, with nothing configured.
//!
//! A healthy reference run is computed first, as fast as it goes, and becomes the baseline: whatever
//! the demonstration begins with, it never learns from a damaged rig.

use super::report;
use super::simulate;
use super::simulate::SimulateError;
use crate::api::handles::MachineHandle;
use crate::app::daemon::Daemon;
use crate::app::start_error::StartError;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use crate::simulator::scenario;
use crate::simulator::scenario::ScenarioError;
use crate::simulator::scenario::Wanted;
use crate::simulator::scene::Faults;
use crate::simulator::scene::MachineText;
use crate::simulator::scene::Scene;
use crate::simulator::scene::builtin;
use clap::Args;
use std::fs;
use std::io;
use std::io::Write;
use std::net::Ipv4Addr;
use std::net::SocketAddr;
use std::net::TcpListener;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;
use tempfile::TempDir;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch demo
  rotorwatch demo --scenario GG_BS_BB
  rotorwatch demo --bind 127.0.0.1:9000 --dir demo-files
  curl http://127.0.0.1:8080/api/v1/machines/rig-1/diagnosis
  curl -H 'content-type: application/json' -d '{ \"scenario\": \"GG_GS_BB\" }' \\
    http://127.0.0.1:8080/api/v1/simulation/scenario

A scenario says what is good (G) and bad (B): gear, shaft, bearing, GG_GS_GB to BG_BS_BB. The diagnosis
knows nothing of it; it follows within half a minute. Ctrl-C ends the demonstration.";

/// Port that is tried first; if it is taken, any free one.
const PORT: u16 = 8080;

/// The scene that runs.
const SCENE: &str = "GG_GS_GB";

/// What it begins with unless something else is asked for.
const HEALTHY: &str = "GG_GS_GB";

/// Seed of the reference run: other noise than that of the live scene.
const REFERENCE_SEED: u64 = 1001;

/// Names of the files in the folder.
const SCENE_FILE: &str = "demo-scene.toml";
const MACHINE: &str = "demo-machine.toml";
const REFERENCE: &str = "demo-reference.h5";
const CONFIGURATION: &str = "demo-rotorwatch.toml";

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Address and port of HTTP, loopback only [default: 127.0.0.1:8080, or any free port].
    #[arg(long, value_name = "ADDR", value_parser = loopback)]
    pub bind: Option<SocketAddr>,
    /// What is damaged at first: GG_GS_GB (nothing) to BG_BS_BB; gear, shaft, bearing, good or bad.
    #[arg(long, value_name = "NAME", default_value = HEALTHY)]
    pub scenario: String,
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
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    #[error("the address {address} cannot be bound, choose another with --bind")]
    Bind { address: SocketAddr, source: io::Error },
    #[error("the healthy reference run failed")]
    Reference(#[source] Box<SimulateError>),
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
    let scene = simulate::load(SCENE).map_err(reference)?;
    // What cannot work is told before the reference run takes its seconds.
    scenario::faults(&scene, &Wanted::Combination(arguments.scenario.clone()))?;
    if let Some(address) = arguments.bind {
        TcpListener::bind(address).map_err(|source| DemoError::Bind { address, source })?;
    }
    let folder = Folder::make(arguments.dir.as_deref())?;
    let config = write_files(folder.path(), &scene, &arguments.scenario)?;
    let mut daemon = start(config, arguments.bind)?;
    let url = format!("http://{}", daemon.address());
    say(&format!("listening on {url}"));
    say(&format!(
        "the simulated rig runs live, scenario {}; the dashboard is at {url}/ and Ctrl-C ends it",
        arguments.scenario
    ));
    say(&format!(
        "another scenario: curl -H 'content-type: application/json' -d '{{ \"scenario\": \"GG_GS_BB\" }}' \
         {url}/api/v1/simulation/scenario"
    ));
    for machine in daemon.machines().iter().cloned() {
        tell_verdicts(machine, url.clone());
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

/// Writes scene, machine file, the healthy reference and the configuration, and reads the latter as
/// `serve` would.
fn write_files(folder: &Path, scene: &Scene, scenario: &str) -> Result<Config, DemoError> {
    // The machine file stands beside the scene here, under its own name.
    let (machine, text) = match &scene.machine {
        Some(MachineText::Inline(machine)) => (machine.clone(), scene.text.clone()),
        Some(MachineText::File(file)) => {
            let machine = builtin::machine(file).unwrap_or_default().to_owned();
            (machine, scene.text.replace(file.as_str(), MACHINE))
        }
        None => (String::new(), scene.text.clone()),
    };
    let write = |name: &str, text: &str| {
        let file = folder.join(name);
        fs::write(&file, text).map_err(|source| DemoError::Write { file, source })
    };
    write(SCENE_FILE, &text)?;
    write(MACHINE, &machine)?;
    write(CONFIGURATION, &configuration(scenario))?;
    tracing::info!("computing a healthy reference run of {} s", scene.duration_s);
    let healthy = scenario::with_faults(scene, &Faults::default());
    simulate::record(&healthy, Some(machine), REFERENCE_SEED, &folder.join(REFERENCE))
        .map_err(reference)?;
    // Without the environment: the demonstration is the same everywhere.
    Ok(config::load_with(&folder.join(CONFIGURATION), [])?)
}

fn reference(error: SimulateError) -> DemoError {
    DemoError::Reference(Box::new(error))
}

fn configuration(scenario: &str) -> String {
    format!(
        "# The daemon's configuration of `rotorwatch demo`; `rotorwatch serve --config` takes it too.\n\
         # A window that saw a change of scenario may accuse too much: alarms wait for the next two.\n\
         [alarms]\non_delay_s = 10.0\n\n\
         [[machine]]\nfile = \"{MACHINE}\"\nbaseline = [\"{REFERENCE}\"]\n\n\
         [[source]]\nkind = \"simulated\"\nmachine = \"rig-1\"\nscene = \"{SCENE_FILE}\"\n\
         scenario = \"{scenario}\"\nspeed = 1.0\n"
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

/// Who is accused of what.
type Accused = Vec<(String, State, Option<FaultMode>)>;

/// Prints a line with the machine's first verdict and whenever another fault is named, from a thread
/// of its own, which ends with the daemon.
fn tell_verdicts(machine: MachineHandle, url: String) {
    let waiting = thread::Builder::new().name("demo-verdict".to_owned()).spawn(move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().build() else { return };
        let mut view = machine.view;
        let mut told: Option<Accused> = None;
        loop {
            let judged = runtime.block_on(view.wait_for(|view| {
                let now = view.diagnosis.as_deref().map(accused);
                now.is_some() && now != told
            }));
            // An error: the daemon ended.
            let Some(diagnosis) = judged.ok().and_then(|view| view.diagnosis.clone()) else {
                return;
            };
            say(&verdict_line(&diagnosis, &url));
            told = Some(accused(&diagnosis));
        }
    });
    if let Err(error) = waiting {
        tracing::warn!(%error, "verdicts will not be printed, ask for them");
    }
}

fn accused(diagnosis: &Diagnosis) -> Accused {
    let accused = diagnosis.components.iter().filter(|c| c.state.is_accusation());
    let mut accused: Accused = accused.map(|c| (c.id.clone(), c.state, c.fault)).collect();
    accused.sort_by(|a, b| a.0.cmp(&b.0));
    accused
}

fn verdict_line(diagnosis: &Diagnosis, url: &str) -> String {
    let n_others = accused(diagnosis).len().saturating_sub(1);
    let others = if n_others > 0 { format!(" (and {n_others} more)") } else { String::new() };
    let found =
        report::accusation(diagnosis).map_or(String::new(), |worst| format!(": {worst}{others}"));
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
        Err("can be reached from other hosts, and the demonstration has no access tokens: use \
             127.0.0.1 or [::1]"
            .to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SourceConfig;

    #[test]
    fn the_configuration_is_one_that_serve_accepts() {
        let dir = tempfile::tempdir().unwrap();
        let mut scene = simulate::load(SCENE).unwrap();
        // One second is enough of a reference here.
        scene.duration_s = 1.0;
        let config = write_files(dir.path(), &scene, "GG_BS_BB").unwrap();
        let [machine] = &config.machines[..] else { panic!("one machine") };
        assert_eq!((machine.machine.id.as_str(), machine.baseline.len()), ("rig-1", 1));
        let SourceConfig::Simulated(source) = &machine.source else { panic!("simulated") };
        assert_eq!(source.scenario, Some(Wanted::Combination("GG_BS_BB".to_owned())));
        assert_ne!(source.seed, REFERENCE_SEED);
        assert_eq!(source.scene.faults(), Faults::default());
        assert_eq!(source.scene.machine, Some(MachineText::File(MACHINE.to_owned())));
        let names: Vec<_> = scenario::possible(&source.scene).collect();
        assert_eq!(names, scenario::COMBINATIONS);
        let wanted = Wanted::Combination(HEALTHY.to_owned());
        assert_eq!(scenario::faults(&scene, &wanted), Ok(Faults::default()));
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
