//! `rotorwatch completions`: what a shell needs to complete our commands.

use super::Cli;
use clap::Args;
use clap::CommandFactory;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch completions bash > /etc/bash_completion.d/rotorwatch
  rotorwatch completions zsh > /usr/local/share/zsh/site-functions/_rotorwatch";

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
