//! `rotorwatch backup` and `restore`: a store as one file, made while its daemon runs, and its way back.

mod archive;
pub mod restore;

pub(crate) use archive::ArchiveError;
pub(crate) use archive::private;

use crate::api::wire::backup::ManifestFileWire;
use crate::api::wire::backup::ManifestWire;
use crate::api::wire::backup::SCHEMA;
use crate::api::wire::rfc3339;
use crate::app;
use crate::capture::recording::store as recordings;
use crate::cli::output::OutputError;
use crate::cli::output::Spared;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::store::backup;
use crate::store::backup::BackupError;
use crate::store::backup::told;
use archive::Writer;
use clap::Args;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch backup --config rotorwatch.toml --out monday.tar.gz
  rotorwatch backup --config rotorwatch.toml --captures --out monday.tar.gz

The daemon may run meanwhile. In it: alarms, history, audit, baselines and feedback as they stood at one moment, trends,
the configuration and its machine files, with --captures the captures; not in it: recordings, and files of tokens,
passwords, keys and certificates, which the manifest names. Where the configuration holds a secret itself, so does the
archive: only this user may read it.

Exit codes: 0 done; 2 an error.";

/// Folders of an archive.
const STORE: &str = "store";
const CONFIG: &str = "config";

/// Arguments of `backup`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Configuration of the daemon whose store is copied.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The archive, which must not be there yet.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// With the captures, which may be large.
    #[arg(long)]
    pub captures: bool,
}

/// Why there is no backup.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error(transparent)]
    Backup(#[from] BackupError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Makes a backup; exit code 0, or 2 on an error.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match back_up(arguments) {
        Ok(manifest) => super::print(summary(&manifest, &arguments.out).as_bytes()),
        Err(Failure::Configuration(mistakes)) => super::fail_lines(&mistakes),
        Err(error) => super::fail(&error),
    }
}

fn summary(manifest: &ManifestWire, out: &Path) -> String {
    let bytes: u64 = manifest.files.iter().map(|file| file.bytes).sum();
    let mut text = format!("{}: {} files, {bytes} bytes\n", out.display(), manifest.files.len());
    for file in &manifest.left_out {
        text += &format!("left out, keep it elsewhere: {file}\n");
    }
    text
}

fn back_up(arguments: &Arguments) -> Result<ManifestWire, Failure> {
    let config = config::load_as(&arguments.config, config::Exposure::Insecure)?;
    Spared::of(&config).refuse(&arguments.out)?;
    let mut writer = Writer::create(&arguments.out)?;
    let beside = arguments.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let beside = beside.unwrap_or(Path::new("."));
    let copied = tempfile::tempdir_in(beside).map_err(told("making a folder in", beside))?;
    backup::copy_databases(&config.store.directory, copied.path())?;
    let found = if arguments.captures {
        backup::captures(copied.path()).map_err(BackupError::from)?
    } else {
        Vec::new()
    };
    for file in files_below(copied.path())? {
        writer.add(&copied.path().join(&file), &format!("{STORE}/{file}"))?;
    }
    let captures = config.store.directory.join(app::CAPTURES);
    for (machine, id) in found {
        let name = format!("{id}.h5");
        // What was too old went meanwhile.
        if let Some(file) = recordings::recording(&captures, &machine, &name) {
            let below = file.strip_prefix(&config.store.directory).unwrap_or(&file);
            writer.add(&file, &format!("{STORE}/{}", below.display()))?;
        }
    }
    let left_out = add_configuration(&mut writer, arguments, &config)?;
    let about = |files: Vec<ManifestFileWire>| ManifestWire {
        schema: SCHEMA.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        made_at: rfc3339(Some(app::wall_clock()), 0.0),
        store_schema: backup::newest_schema(),
        with_captures: arguments.captures,
        files,
        left_out,
    };
    Ok(writer.finish(about)?)
}

/// Adds the configuration and its machine files, under the names by which it names them; gives what is left out.
fn add_configuration(
    writer: &mut Writer,
    arguments: &Arguments,
    config: &Config,
) -> Result<Vec<String>, Failure> {
    let base = arguments.config.parent().unwrap_or(Path::new(""));
    let machines = config.machines.iter().map(|machine| &machine.file);
    let mut left_out = Vec::new();
    let mut added: Vec<&PathBuf> = Vec::new();
    for file in std::iter::once(&arguments.config).chain(machines) {
        let below = file.strip_prefix(base).ok().and_then(|file| file.to_str());
        let is_below = |name: &&str| !name.split('/').any(|part| part == ".." || part.is_empty());
        match below.filter(is_below) {
            _ if added.contains(&file) => {}
            Some(name) => {
                writer.add(file, &format!("{CONFIG}/{name}"))?;
                added.push(file);
            }
            None => left_out.push(file.display().to_string()),
        }
    }
    let others = config.files.0.iter().filter(|file| !added.contains(file));
    left_out.extend(others.map(|file| file.display().to_string()));
    left_out.sort();
    left_out.dedup();
    Ok(left_out)
}

/// Files in a folder and the folders in it, by their path from there.
fn files_below(folder: &Path) -> Result<Vec<String>, BackupError> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        let reading = told("reading", &next);
        for entry in std::fs::read_dir(&next).map_err(&reading)? {
            let path = entry.map_err(&reading)?.path();
            if path.is_dir() {
                folders.push(path);
            } else if let Some(name) = path.strip_prefix(folder).ok().and_then(Path::to_str) {
                found.push(name.to_owned());
            }
        }
    }
    found.sort();
    Ok(found)
}
