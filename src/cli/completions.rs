//! `rotorwatch completions`: what a shell needs to complete our commands.

use super::Cli;
use clap::Args;
use clap::CommandFactory;
use std::process::ExitCode;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The shell.
    pub shell: clap_complete::Shell,
}

/// Prints the completions.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "rotorwatch", &mut text);
    super::print(&text)
}
