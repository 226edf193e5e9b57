//! `rotorwatch serve`: the daemon.

use super::EXIT_ERROR;
use crate::app;
use crate::config;
use clap::Args;
use std::io;
use std::io::Write;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Configuration file (TOML); relative paths in it start from its folder.
    #[arg(long, value_name = "FILE", required_unless_present = "print_config")]
    pub config: Option<PathBuf>,
    /// Print the commented reference of every key with its default, and end.
    #[arg(long)]
    pub print_config: bool,
}

/// Runs the daemon until a signal; exit code 0 then, 2 when it cannot be started.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match &arguments.config {
        Some(file) if !arguments.print_config => serve(file),
        _ => super::print(config::REFERENCE.as_bytes()),
    }
}

fn serve(file: &Path) -> ExitCode {
    let config = match config::load(file) {
        Ok(config) => config,
        Err(errors) => {
            // Without a stderr the exit code has to say it.
            let _no_stderr = writeln!(io::stderr(), "{errors}");
            return ExitCode::from(EXIT_ERROR);
        }
    };
    match app::run(&config, &mut io::stdout()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => super::fail(&error),
    }
}
