//! `rotorwatch restore`: checks a backup as a whole, then puts it in place.

use super::ArchiveError;
use super::CONFIG;
use super::STORE;
use super::archive;
use super::files_below;
use crate::api::wire::rfc3339;
use crate::app;
use crate::store::StoreError;
use crate::store::backup;
use crate::store::backup::BackupError;
use crate::store::backup::Place;
use crate::store::backup::told;
use clap::Args;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch restore monday.tar.gz --store data
  rotorwatch restore monday.tar.gz --store data --config-dir .
  rotorwatch restore monday.tar.gz --store data --force

Everything is unpacked and checked, each file against its SHA-256 and each database as a whole, before anything is put in
place. The daemon must have ended. With --force what is in the store goes into a folder before-restore-… in it. With
--config-dir the configuration is put there; a file that is there already stays, unless --force, which puts it aside.

Exit codes: 0 done; 2 an error, and nothing has changed.";

/// Arguments of `restore`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The archive that `rotorwatch backup` made.
    #[arg(value_name = "BACKUP")]
    pub backup: PathBuf,
    /// Folder of the store, as `store.directory` of the configuration says.
    #[arg(long, value_name = "DIR")]
    pub store: PathBuf,
    /// Folder for the configuration and its machine files; without it they are not restored.
    #[arg(long, value_name = "DIR")]
    pub config_dir: Option<PathBuf>,
    /// Put aside what is there.
    #[arg(long)]
    pub force: bool,
}

/// Why nothing was restored.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error(transparent)]
    Backup(#[from] BackupError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{} is there already: say --force to put it aside, or leave --config-dir out", file.display())]
    Exists { file: PathBuf },
}

/// Restores; exit code 0, or 2 on an error.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match restore(arguments) {
        Ok(text) => crate::cli::print(text.as_bytes()),
        Err(error) => crate::cli::fail(&error),
    }
}

fn restore(arguments: &Arguments) -> Result<String, Failure> {
    let place = Place::take(&arguments.store, arguments.force)?;
    let gathered = place.gather()?;
    let done = checked(arguments, &gathered).and_then(|text| {
        // Everything is there and whole: from here on it is moved.
        let when = rfc3339(Some(app::wall_clock()), 0.0).replace(':', "");
        if let Some(folder) = &arguments.config_dir {
            put_configuration(&gathered.join(CONFIG), folder, &when)?;
        }
        let leave = |name: &str| {
            let folder = gathered.join(name);
            fs::remove_dir_all(&folder).map_err(told("removing", &folder))
        };
        for entry in fs::read_dir(gathered.join(STORE)).map_err(told("reading", &gathered))? {
            let from = entry.map_err(told("reading", &gathered))?.path();
            let to = gathered.join(from.file_name().unwrap_or_default());
            fs::rename(&from, &to).map_err(told("moving", &from))?;
        }
        leave(STORE)?;
        leave(CONFIG)?;
        let aside = place.put(&when)?;
        let aside =
            aside.map_or(String::new(), |folder| format!("put aside: {}\n", folder.display()));
        Ok(format!("{text}{aside}"))
    });
    if done.is_err() && gathered.exists() {
        // What is left of it harms nobody, and the next restore removes it.
        let _left = fs::remove_dir_all(&gathered);
    }
    done
}

/// Unpacks and checks everything; gives what is told at the end.
fn checked(arguments: &Arguments, gathered: &Path) -> Result<String, Failure> {
    let manifest = archive::unpack(&arguments.backup, gathered)?;
    backup::check(&gathered.join(STORE))?;
    let config = gathered.join(CONFIG);
    if let Some(folder) = arguments.config_dir.as_ref().filter(|_| !arguments.force) {
        for name in files_below(&config)? {
            let file = folder.join(name);
            if file.exists() {
                return Err(Failure::Exists { file });
            }
        }
    }
    let mut text =
        format!("restored what version {} kept at {}\n", manifest.version, manifest.made_at);
    for file in &manifest.left_out {
        text += &format!("not in the backup, must be there: {file}\n");
    }
    Ok(text)
}

fn put_configuration(from: &Path, folder: &Path, when: &str) -> Result<(), BackupError> {
    for name in files_below(from)? {
        let (from, to) = (from.join(&name), folder.join(&name));
        let parent = to.parent().unwrap_or(folder);
        fs::create_dir_all(parent).map_err(told("making", parent))?;
        if to.exists() {
            let mut aside = to.as_os_str().to_owned();
            aside.push(format!(".{}{when}", backup::BEFORE));
            fs::rename(&to, &aside).map_err(told("putting aside", &to))?;
        }
        // The configuration may lie on another disk than the store.
        fs::copy(&from, &to).map_err(told("writing", &to))?;
    }
    Ok(())
}
