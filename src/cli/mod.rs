//! The command line: one file a command, each with its arguments and its `run`.
//!
//! Results go to stdout, logs and errors to stderr. Exit codes: 0 success, 1 a verdict asked for by
//! an option, 2 an error.

pub mod diagnose;
pub mod serve;
pub mod openapi;
pub mod completions;
pub mod man;

use crate::app::source::with_causes;
use crate::telemetry;
use crate::telemetry::LogFormat;
use clap::Parser;
use clap::Subcommand;
use clap::ValueEnum;
use std::error::Error;
use std::io;
use std::io::Write;
use std::process::ExitCode;

/// Exit code of every error.
pub const EXIT_ERROR: u8 = 2;

const EXAMPLES: &str = "\
Examples:
  rotorwatch serve --print-config > rotorwatch.toml
  rotorwatch serve --config rotorwatch.toml
  rotorwatch completions bash > /etc/bash_completion.d/rotorwatch

Environment:
  ROTORWATCH_LOG                   what is logged: a level or module=level, default info
  ROTORWATCH__SECTION__KEY         overrides a key of the configuration file";

/// Says which bearing, shaft or gear of a drivetrain is damaged, how badly, how sure it is and why.
#[derive(Debug, Parser)]
#[command(name = "rotorwatch", version, after_help = EXAMPLES)]
pub struct Cli {
    /// How log lines are written on stderr.
    #[arg(long, global = true, value_enum, default_value = "text", value_name = "FORMAT")]
    pub log_format: LogFormatArgument,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// How log lines are written.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum LogFormatArgument {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Diagnose captures.
    Diagnose(diagnose::Arguments),
    /// Run the daemon.
    Serve(serve::Arguments),
    /// Print the completions of a shell.
    Completions(completions::Arguments),
    /// Print the manual page.
    Man,
}

/// Runs a command line and gives the exit code.
#[must_use]
pub fn run(cli: &Cli) -> ExitCode {
    let format = match cli.log_format {
        LogFormatArgument::Text => LogFormat::Text,
        LogFormatArgument::Json => LogFormat::Json,
    };
    let filter = std::env::var(telemetry::LOG_VARIABLE).ok();
    if let Err(error) = telemetry::start_log(format, filter.as_deref()) {
        return fail(&error);
    }
    match &cli.command {
        Command::Diagnose(arguments) => diagnose::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Completions(arguments) => completions::run(arguments),
        Command::Man => man::run(),
    }
}

/// Tells an error with its causes on stderr and gives the exit code for it.
#[must_use]
pub fn fail(error: &dyn Error) -> ExitCode {
    // Without a stderr the exit code has to say it.
    let _no_stderr = writeln!(io::stderr(), "error: {}", with_causes(error));
    ExitCode::from(EXIT_ERROR)
}

/// Prints a whole text on stdout. A reader that closed early (`| head`) is no error.
#[must_use]
pub fn print(text: &[u8]) -> ExitCode {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => fail(&error),
        Ok(()) | Err(_) => ExitCode::SUCCESS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
