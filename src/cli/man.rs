//! `rotorwatch man`: the manual pages.

use super::Cli;
use clap::Args;
use clap::Command;
use clap::CommandFactory;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch man | man -l -
  rotorwatch man > /usr/local/share/man/man1/rotorwatch.1
  rotorwatch man diagnose > /usr/local/share/man/man1/rotorwatch-diagnose.1";

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The page of a command; without it the page of the whole program.
    pub command: Option<String>,
}

/// Prints a manual page (roff).
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let mut program = Cli::command();
    // Gives the commands the names they have below the program's.
    program.build();
    let page = match &arguments.command {
        None => program,
        Some(name) => match program.find_subcommand(name) {
            Some(command) => command.clone(),
            None => {
                let known: Vec<_> = program.get_subcommands().map(Command::get_name).collect();
                return super::fail(&UnknownCommand {
                    name: name.clone(),
                    known: known.join(", "),
                });
            }
        },
    };
    let mut text = Vec::new();
    match clap_mangen::Man::new(page).render(&mut text) {
        Ok(()) => super::print(&text),
        Err(error) => super::fail(&error),
    }
}

#[derive(Debug, thiserror::Error)]
#[error("no command {name:?}, there are: {known}")]
struct UnknownCommand {
    name: String,
    known: String,
}
