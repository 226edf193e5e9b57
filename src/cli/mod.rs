//! The command line: one file a command, each with its arguments and its `run`.
//!
//! Results go to stdout, logs and errors to stderr. Exit codes: 0 success, 1 a verdict asked for by
//! an option, 2 an error.

pub mod input;
pub mod hints;
pub mod output;
pub mod terminal;
pub mod progress;
pub mod report;
pub mod page;
pub mod diagnose;
mod replayed;
pub mod replay;
pub mod evaluate;
pub mod check;
pub mod bearings;
pub mod simulate;
pub mod serve;
pub mod demo;
pub mod baseline;
pub mod client;
pub mod status;
mod secret;
pub mod token;
pub mod backup;
pub mod support_bundle;
pub mod alarms;
pub mod export;
pub mod replay_alarms;
pub mod bench;
pub mod bench_live;
pub mod openapi;
pub mod completions;
pub mod man;

use crate::causes::with_causes;
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
  rotorwatch demo
  rotorwatch check --frequencies rig.toml
  rotorwatch diagnose --machine rig.toml run-7.h5
  rotorwatch simulate seed-bearing-40hz --out bad.h5
  rotorwatch serve --config rotorwatch.toml

Environment:
  ROTORWATCH_LOG                   what is logged: a level or module=level, default info
  ROTORWATCH__SECTION__KEY         overrides a key of the daemon's configuration file
  NO_COLOR                         no colours, if not empty

Results go to stdout, logs and errors to stderr. Exit codes: 0 success; 1 a verdict asked for by an
option; 2 an error.";

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
    /// Say what captures show: which part is damaged, how badly, how sure that is and why
    #[command(after_help = diagnose::EXAMPLES)]
    Diagnose(diagnose::Arguments),
    /// Hold verdicts on captures against what is known of them: right, undetermined, missed, wrong
    #[command(after_help = evaluate::EXAMPLES)]
    Evaluate(evaluate::Arguments),
    /// Check machine files, scenes, configurations and captures, and list a machine's frequencies
    #[command(after_help = check::EXAMPLES)]
    Check(check::Arguments),
    /// List bearings by designation: geometry, fault frequencies, how well they are known
    #[command(after_help = bearings::EXAMPLES)]
    Bearings(bearings::Arguments),
    /// Run a scene, a file or a built-in one, and write a capture with its truth
    #[command(after_help = simulate::EXAMPLES)]
    Simulate(simulate::Arguments),
    /// Run the daemon: watch machines and answer over HTTP
    #[command(after_help = serve::EXAMPLES)]
    Serve(serve::Arguments),
    /// Stream a capture into a running daemon, as acquisition hardware would
    #[command(after_help = replay::EXAMPLES)]
    Replay(replay::Arguments),
    /// Run the daemon on the simulated rig, with nothing configured
    #[command(after_help = demo::EXAMPLES)]
    Demo(demo::Arguments),
    /// Learn, list and remove what is normal of a daemon's machines
    #[command(after_help = baseline::EXAMPLES)]
    Baseline(baseline::Arguments),
    /// List the alarms of a daemon, and act on them
    #[command(after_help = alarms::EXAMPLES)]
    Alarms(alarms::Arguments),
    /// Say how a running daemon and its machines are doing
    #[command(after_help = status::EXAMPLES)]
    Status(status::Arguments),
    /// Copy the store of a daemon, which may run, into one file
    #[command(after_help = backup::EXAMPLES)]
    Backup(backup::Arguments),
    /// Check a backup as a whole and put it in place
    #[command(after_help = backup::restore::EXAMPLES)]
    Restore(backup::restore::Arguments),
    /// Gather what others need to know of a daemon, without secrets
    #[command(after_help = support_bundle::EXAMPLES)]
    SupportBundle(support_bundle::Arguments),
    /// Make, list and revoke access tokens of a daemon
    #[command(after_help = token::EXAMPLES)]
    Token(token::Arguments),
    /// Write stored trends and alarms as CSV or HDF5
    #[command(after_help = export::EXAMPLES)]
    Export(export::Arguments),
    /// Say what other limits or delays would have raised in the stored history
    #[command(after_help = replay_alarms::EXAMPLES)]
    ReplayAlarms(replay_alarms::Arguments),
    /// Measure the simulator: speed against error, and its hard cases
    #[command(after_help = bench::EXAMPLES)]
    Bench(bench::Arguments),
    /// Print the document of the HTTP API (OpenAPI 3.1), or a schema
    #[command(after_help = openapi::EXAMPLES)]
    Openapi(openapi::Arguments),
    /// Print the completions of a shell
    #[command(after_help = completions::EXAMPLES)]
    Completions(completions::Arguments),
    /// Print a manual page
    #[command(after_help = man::EXAMPLES)]
    Man(man::Arguments),
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
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::Check(arguments) => check::run(arguments),
        Command::Bearings(arguments) => bearings::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Replay(arguments) => replay::run(arguments),
        Command::Demo(arguments) => demo::run(arguments),
        Command::Baseline(arguments) => baseline::run(arguments),
        Command::Alarms(arguments) => alarms::run(arguments),
        Command::Status(arguments) => status::run(arguments),
        Command::Backup(arguments) => backup::run(arguments),
        Command::Restore(arguments) => backup::restore::run(arguments),
        Command::SupportBundle(arguments) => support_bundle::run(arguments),
        Command::Token(arguments) => token::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::ReplayAlarms(arguments) => replay_alarms::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Openapi(arguments) => openapi::run(arguments),
        Command::Completions(arguments) => completions::run(arguments),
        Command::Man(arguments) => man::run(arguments),
    }
}

/// Tells an error with its causes on stderr and gives the exit code for it.
#[must_use]
pub fn fail(error: &dyn Error) -> ExitCode {
    tell(error);
    ExitCode::from(EXIT_ERROR)
}

/// Tells an error with its causes on stderr.
pub fn tell(error: &dyn Error) {
    // Without a stderr the exit code has to say it.
    let _no_stderr = writeln!(io::stderr(), "error: {}", with_causes(error));
}

/// Tells a list of mistakes on stderr, each line of which names its file.
pub fn tell_lines(mistakes: &dyn Error) {
    // Without a stderr the exit code has to say it.
    let _no_stderr = writeln!(io::stderr(), "{mistakes}");
}

/// Tells a list of mistakes on stderr and gives the exit code for it.
#[must_use]
pub fn fail_lines(mistakes: &dyn Error) -> ExitCode {
    tell_lines(mistakes);
    ExitCode::from(EXIT_ERROR)
}

/// Largest number an option takes, Hz: ten times the fastest machines.
const MAX_HZ: f64 = 10_000.0;

/// Reads a frequency in Hz, above 0.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number <= MAX_HZ => Ok(number),
        Ok(_) | Err(_) => Err(format!("not a number above 0 and up to {MAX_HZ}")),
    }
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

    #[test]
    fn every_command_shows_examples() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let example = format!("Examples:\n  rotorwatch {}", command.get_name());
            assert!(help.contains(&example), "{}: {help}", command.get_name());
        }
    }

    #[test]
    fn a_speed_is_a_number_above_0() {
        assert_eq!(positive("29.5"), Ok(29.5));
        for text in ["0", "-3", "nan", "inf", "1e999", "fast", ""] {
            assert!(positive(text).is_err(), "{text}");
        }
    }
}
