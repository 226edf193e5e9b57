//! `rotorwatch man`: the manual page.

use super::Cli;
use clap::CommandFactory;
use std::process::ExitCode;

/// Prints the manual page (roff).
#[must_use]
pub fn run() -> ExitCode {
    let mut text = Vec::new();
    match clap_mangen::Man::new(Cli::command()).render(&mut text) {
        Ok(()) => super::print(&text),
        Err(error) => super::fail(&error),
    }
}
