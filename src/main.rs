//! The command: reads its arguments and hands over to the library.

use clap::Parser;
use rotorwatch::cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run(&cli::Cli::parse())
}
