//! `rotorwatch serve`: the daemon.

use crate::app;
use crate::config;
use crate::config::Exposure;
use clap::Args;
use std::io;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch serve --print-config > rotorwatch.toml
  rotorwatch check rotorwatch.toml
  rotorwatch serve --config rotorwatch.toml

The first line on stdout is the address: listening on http://127.0.0.1:8080. SIGTERM or SIGINT ends
it within five seconds. SIGHUP, or a change of the configuration's files, has them read again.";

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Configuration file (TOML); relative paths in it start from its folder.
    #[arg(long, value_name = "FILE", required_unless_present = "print_config")]
    pub config: Option<PathBuf>,
    /// Let everybody in who can reach the address, though it is not of this computer alone and there are no tokens.
    #[arg(long)]
    pub insecure: bool,
    /// Print the commented reference of every key with its default, and end.
    #[arg(long)]
    pub print_config: bool,
}

/// Runs the daemon until a signal; exit code 0 then, 2 when it cannot be started.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match &arguments.config {
        Some(file) if !arguments.print_config => serve(file, arguments.insecure),
        _ => super::print(config::REFERENCE.as_bytes()),
    }
}

fn serve(file: &Path, is_insecure: bool) -> ExitCode {
    let exposure = if is_insecure { Exposure::Insecure } else { Exposure::Guarded };
    let config = match config::load_as(file, exposure) {
        Ok(config) => config,
        Err(errors) => return super::fail_lines(&errors),
    };
    match app::run(&config, file, &mut io::stdout()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => super::fail(&error),
    }
}
