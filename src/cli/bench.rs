//! `rotorwatch bench`: what the program measures of itself, as a table, CSV, JSON and a plot.

use super::bench_live;
use super::bench_live::LiveError;
use super::output::Output;
use super::output::OutputError;
use super::simulate;
use crate::bench;
use crate::bench::BenchError;
use crate::bench::computer::Computer;
use crate::bench::monitor;
use crate::bench::signal;
use crate::bench::simulator::Effort;
use crate::bench::stability::rows::Row;
use crate::bench::table;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use clap::Args;
use clap::ValueEnum;
use serde_json::Value;
use serde_json::json;
use std::fs;
use std::io;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch bench simulator --out figures
  rotorwatch bench stability
  rotorwatch bench signal --out figures
  rotorwatch bench monitor
  rotorwatch bench monitor --channels 100 --seconds 20

simulator: error and processor time of classes of scenes at several accuracies asked for (minutes).
stability: the simulator's hard cases against what is known of them (a minute).
signal: error and processor time of every transform in f32 and f64, and channels a core (a minute).
monitor: the whole pipeline with 1 to 64 channels: throughput, latency, memory (a minute); with --channels the
daemon itself on what a sender streams in real time, 10 kHz each: processor time, latency, memory, and whether the
ledger is exact.
With --out the tables are also written there as CSV and JSON, simulator and signal as a plot (SVG).
docs/performance.md says what the columns mean.

Exit codes: 0 done; 2 a row of stability does not hold, or a bench could not be run.";

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What is measured.
    #[arg(value_enum, value_name = "BENCH")]
    pub bench: Bench,
    /// Folder for the tables, made if it is not there.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// monitor: stream so many channels into a daemon.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub channels: Option<u32>,
    /// monitor: stream for so long, s.
    #[arg(long, value_name = "S", default_value_t = 20, requires = "channels",
          value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub seconds: u32,
    /// monitor: only receive, buffer and count; one channel of each hundred is judged.
    #[arg(long, requires = "channels")]
    pub receive_only: bool,
    /// One round of one job of `signal` in f32, as an object, and another for every line of stdin: for
    /// comparisons by turns.
    #[arg(long, value_name = "NAME", hide = true)]
    pub job: Option<String>,
    /// A small part, to see that it works.
    #[arg(long, hide = true)]
    pub quick: bool,
}

/// What can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Bench {
    /// Speed against error of the simulator.
    Simulator,
    /// Hard cases of the simulator.
    Stability,
    /// Speed against error of the signal processing.
    Signal,
    /// The whole pipeline.
    Monitor,
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("bench {bench}: there is no job {name}; there are: {}", bench::signal::names().join(", "))]
    NoJob { bench: &'static str, name: String },
    #[error("{}: cannot be made", folder.display())]
    Folder { folder: PathBuf, source: io::Error },
    #[error("stdin: cannot be read")]
    Input(#[source] io::Error),
    #[error(transparent)]
    Live(#[from] LiveError),
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{n} of {total} rows do not hold")]
    Missed { n: usize, total: usize },
}

/// Measures; exit code 0, or 2 on any mistake.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match measure(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => super::fail(&failure),
    }
}

fn measure(arguments: &Arguments) -> Result<(), Failure> {
    let bench = match arguments.bench {
        Bench::Simulator => bench_simulator,
        Bench::Stability => bench_stability,
        Bench::Signal => bench_signal,
        Bench::Monitor => bench_monitor,
    };
    if let Some(name) = &arguments.job {
        return job(name, arguments);
    }
    if let Some(folder) = &arguments.out {
        // Before minutes of work.
        let cannot = |source| Failure::Folder { folder: folder.clone(), source };
        fs::create_dir_all(folder).map_err(cannot)?;
    }
    if let Some(n_channels) = arguments.channels.filter(|_| arguments.bench == Bench::Monitor) {
        let n_channels = usize::try_from(n_channels).unwrap_or(usize::MAX);
        let (seconds, receive_only) = (arguments.seconds, arguments.receive_only);
        let load = bench_live::Load { n_channels, seconds, receive_only };
        return bench_streamed(load, arguments.out.as_deref());
    }
    bench(arguments.out.as_deref(), arguments.quick)
}

fn bench_streamed(load: bench_live::Load, out: Option<&Path>) -> Result<(), Failure> {
    let mut page = Page::begin(&bench_live::COLUMNS)?;
    let row = bench_live::run(load)?;
    page.row(&row)?;
    let is_exact = !row.contains(&Cell::Flag(false));
    page.write("live", out, &bench_live::settings(load), &[row])?;
    if is_exact { Ok(()) } else { Err(Failure::Missed { n: 1, total: 1 }) }
}

fn bench_simulator(out: Option<&Path>, quick: bool) -> Result<(), Failure> {
    let effort = if quick { Effort::QUICK } else { Effort::WHOLE };
    let folder = tempfile::tempdir()
        .map_err(|source| Failure::Folder { folder: std::env::temp_dir(), source })?;
    let capture = folder.path().join("bench.h5");
    let mut page = Page::begin(&bench::simulator::COLUMNS)?;
    let mut record = |simulation: &mut _| {
        let written = simulate::write(simulation, (None, 1), &capture, &mut |_| ());
        written.map_err(Into::into)
    };
    let rows = bench::simulator::run(&effort, &mut record, &mut |row| page.row(row))?;
    page.write("simulator", out, &effort.json(), &rows)?;
    match (out, bench::simulator::plot(&rows)) {
        (Some(folder), Some(svg)) => file(&folder.join("simulator.svg"), &svg),
        (None, _) | (_, None) => Ok(()),
    }
}

fn bench_stability(out: Option<&Path>, quick: bool) -> Result<(), Failure> {
    let n_cases = if quick { 2 } else { usize::MAX };
    let mut page = Page::begin(&Row::COLUMNS)?;
    let rows = bench::stability::run(n_cases, &mut |row| page.row(row))?;
    let cells: Vec<Vec<Cell>> = rows.iter().map(Row::cells).collect();
    page.write("stability", out, &json!({}), &cells)?;
    let n = rows.iter().filter(|row| !row.holds()).count();
    if n > 0 { Err(Failure::Missed { n, total: rows.len() }) } else { Ok(()) }
}

fn bench_signal(out: Option<&Path>, quick: bool) -> Result<(), Failure> {
    let effort = if quick { signal::Effort::QUICK } else { signal::Effort::WHOLE };
    let mut page = Page::begin(&signal::COLUMNS)?;
    let rows = signal::run(&effort, &mut |row| page.row(row))?;
    page.write("signal", out, &effort.json(), &rows)?;
    match (out, signal::plot(&rows)) {
        (Some(folder), Some(svg)) => file(&folder.join("signal.svg"), &svg),
        (None, _) | (_, None) => Ok(()),
    }
}

fn bench_monitor(out: Option<&Path>, quick: bool) -> Result<(), Failure> {
    let effort = if quick { monitor::Effort::QUICK } else { monitor::Effort::WHOLE };
    let mut page = Page::begin(&monitor::COLUMNS)?;
    let rows = monitor::run(&effort, &mut |row| page.row(row))?;
    page.write("monitor", out, &effort.json(), &rows)
}

/// Rounds of one job of `signal`: one, and one for every line of stdin.
fn job(name: &str, arguments: &Arguments) -> Result<(), Failure> {
    let effort = if arguments.quick { signal::Effort::QUICK } else { signal::Effort::TURNS };
    let turns = match arguments.bench {
        Bench::Signal => signal::Turns::new(name, &effort),
        Bench::Simulator | Bench::Stability | Bench::Monitor => None,
    };
    let bench = match arguments.bench {
        Bench::Simulator => "simulator",
        Bench::Stability => "stability",
        Bench::Signal => "signal",
        Bench::Monitor => "monitor",
    };
    let mut turns = turns.ok_or_else(|| Failure::NoJob { bench, name: name.to_owned() })?;
    let mut stdout = Output::open(None)?;
    stdout.write(&format!("{}\n", turns.round()))?;
    for line in io::stdin().lines() {
        line.map_err(Failure::Input)?;
        stdout.write(&format!("{}\n", turns.round()))?;
    }
    Ok(())
}

/// Stdout, and what it shows.
struct Page {
    stdout: Output,
    columns: &'static [Column],
    computer: Computer,
}

impl Page {
    fn begin(columns: &'static [Column]) -> Result<Self, Failure> {
        let (mut stdout, computer) = (Output::open(None)?, Computer::this());
        stdout.write(&format!("{}\n\n{}", computer.line(), table::heading(columns)))?;
        Ok(Self { stdout, columns, computer })
    }

    fn row(&mut self, row: &[Cell]) -> Result<(), BenchError> {
        let text = table::text_row(self.columns, row);
        self.stdout.write(&text).map_err(|error| BenchError::Write(Box::new(error)))
    }

    /// Writes `NAME.csv` and `NAME.json` into the folder, if there is one.
    fn write(
        &self,
        name: &str,
        out: Option<&Path>,
        settings: &Value,
        rows: &[Vec<Cell>],
    ) -> Result<(), Failure> {
        let Some(folder) = out else { return Ok(()) };
        let json = table::json(name, (&self.computer, settings), self.columns, rows);
        file(&folder.join(format!("{name}.csv")), &table::csv(self.columns, rows))?;
        file(&folder.join(format!("{name}.json")), &json)
    }
}

fn file(path: &Path, text: &str) -> Result<(), Failure> {
    let mut output = Output::open(Some(path))?;
    output.write(text)?;
    Ok(output.finish()?)
}
