//! `rotorwatch bench`: what the program measures of itself, as a table, CSV, JSON and a plot.

use super::bench_live;
use super::bench_live::LiveError;
use super::output::Output;
use super::output::OutputError;
use super::output::Spared;
use super::simulate;
use crate::bench;
use crate::bench::BenchError;
use crate::bench::Tell;
use crate::bench::computer::Computer;
use crate::bench::signal;
use crate::bench::stability::Search;
use crate::bench::stability::rows::Row;
use crate::bench::table;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use crate::html;
use crate::plot::escaped;
use clap::Args;
use clap::ValueEnum;
use serde_json::Value;
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

simulator: error and processor time of classes of scenes at several accuracies asked for; of several methods and
steps, with what is chosen among them; of numbers of shapes; and what a scene saves that lacks a part (minutes).
stability: hard cases against what is known of them, then 10 000 scenes and 2000 signals at random, and both ends of every
number of a file (half an hour of processor time); --scenes 1 --first-seed N has one scene again, and with
--out its file.
signal: error and processor time of every transform in f32 and f64, and channels a core (a minute).
monitor: the whole pipeline with 1 to 64 channels: throughput, latency, memory; then verdicts on trials with known answers
where windows and rates are thinned (minutes); with --channels the
daemon itself on what a sender streams in real time, 10 kHz each: processor time, latency, memory, and whether the
ledger is exact.
With --out the tables are also written there as CSV, JSON and one page (HTML), of every bench one as a plot (SVG).
docs/performance.md says what the columns mean.

Exit codes: 0 done; 1 a row of stability does not hold, or a ledger is not exact; 2 a bench could not be run.";

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
    /// stability: scenes and signals at random begin with this number.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub first_seed: u64,
    /// stability: so many scenes at random, and nothing else.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=10_000_000))]
    pub scenes: Option<u64>,
    /// A part that takes some minutes, for every change.
    #[arg(long, conflicts_with = "quick")]
    pub thinned: bool,
    /// One round of one job of `signal` in f32, as an object, and another for every line of stdin: for
    /// comparisons by turns.
    #[arg(long, value_name = "NAME", hide = true)]
    pub job: Option<String>,
    /// A small part, to see that it works.
    #[arg(long, hide = true)]
    pub quick: bool,
}

impl Arguments {
    /// The effort asked for: of a second, of minutes, or the whole.
    fn effort<E>(&self, [quick, thinned, whole]: [E; 3]) -> E {
        if self.quick {
            quick
        } else if self.thinned {
            thinned
        } else {
            whole
        }
    }
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

/// An error if rows do not hold.
fn none_missed(n: usize, total: usize) -> Result<(), Failure> {
    if n > 0 { Err(Failure::Missed { n, total }) } else { Ok(()) }
}

/// Measures; exit code 0, 1 if something does not hold, or 2 on any mistake.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match measure(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure @ Failure::Missed { .. }) => {
            super::tell(&failure);
            ExitCode::from(1)
        }
        Err(failure) => super::fail(&failure),
    }
}

fn measure(arguments: &Arguments) -> Result<(), Failure> {
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
    let out = arguments.out.as_deref();
    match arguments.bench {
        Bench::Simulator => bench_simulator(out, arguments),
        Bench::Stability => bench_stability(out, &search(arguments)),
        Bench::Signal => bench_signal(out, arguments),
        Bench::Monitor => bench_monitor(out, arguments),
    }
}

fn search(arguments: &Arguments) -> Search {
    let usual = arguments.effort([Search::QUICK, Search::THINNED, Search::WHOLE]);
    match arguments.scenes {
        Some(n_scenes) => Search::of_scenes(arguments.first_seed, n_scenes),
        None => Search { first_seed: arguments.first_seed, ..usual },
    }
}

fn bench_streamed(load: bench_live::Load, out: Option<&Path>) -> Result<(), Failure> {
    let mut page = Page::begin(&bench_live::COLUMNS)?;
    let row = bench_live::run(load)?;
    page.row(&row)?;
    let is_exact = !row.contains(&Cell::Flag(false));
    page.write("live", out, &bench_live::settings(load), &[row], &[])?;
    none_missed(usize::from(!is_exact), 1)
}

/// Measures the rows of one table, shows each as it comes, writes them all.
fn table(
    (name, out): (&str, Option<&Path>),
    (columns, settings): (&'static [Column], Value),
    run: impl FnOnce(&mut Tell<'_>) -> Result<Vec<Vec<Cell>>, BenchError>,
    plots: impl FnOnce(&[Vec<Cell>]) -> Vec<String>,
) -> Result<Vec<Vec<Cell>>, Failure> {
    let mut page = Page::begin(columns)?;
    let rows = run(&mut |row| page.row(row))?;
    page.write(name, out, &settings, &rows, &plots(&rows))?;
    Ok(rows)
}

/// No plot of a table.
fn bare(_: &[Vec<Cell>]) -> Vec<String> {
    Vec::new()
}

fn bench_simulator(out: Option<&Path>, arguments: &Arguments) -> Result<(), Failure> {
    use bench::simulator::{COLUMNS, Effort, n_missed, parts, plot, precision, run, shapes};
    let effort = arguments.effort([Effort::QUICK, Effort::THINNED, Effort::WHOLE]);
    let folder = tempfile::tempdir()
        .map_err(|source| Failure::Folder { folder: std::env::temp_dir(), source })?;
    let capture = folder.path().join("bench.h5");
    let mut record = |simulation: &mut _| {
        let written = simulate::write(simulation, (None, 1), &capture, &mut |_| ());
        written.map_err(Into::into)
    };
    let plots = |rows: &[_]| plot(rows).into_iter().collect();
    let of = (&COLUMNS[..], effort.json());
    let rows = table(("simulator", out), of, |tell| run(&effort, &mut record, tell), plots)?;
    let (mut missed, mut total) = (n_missed(&rows), rows.len());

    use precision::Effort as OfMethods;
    let effort = arguments.effort([OfMethods::QUICK, OfMethods::THINNED, OfMethods::WHOLE]);
    let of = (&precision::COLUMNS[..], effort.json());
    let run = |tell: &mut Tell<'_>| precision::run(&effort, tell);
    let rows = table(("methods", out), of, run, precision::plots)?;
    (missed, total) = (missed + precision::n_missed(&rows), total + rows.len());

    use shapes::Effort as OfShapes;
    let effort = arguments.effort([OfShapes::QUICK, OfShapes::THINNED, OfShapes::WHOLE]);
    let of = (&shapes::COLUMNS[..], effort.json());
    let plots = |rows: &[_]| shapes::plot(rows).into_iter().collect();
    let rows = table(("shapes", out), of, |tell| shapes::run(&effort, tell), plots)?;
    (missed, total) = (missed + shapes::n_missed(&rows), total + rows.len());

    use parts::Effort as OfParts;
    let effort = arguments.effort([OfParts::QUICK, OfParts::THINNED, OfParts::WHOLE]);
    let of = (&parts::COLUMNS[..], effort.json());
    let rows = table(("parts", out), of, |tell| parts::run(&effort, tell), bare)?;
    none_missed(missed, total + rows.len())
}

fn bench_stability(out: Option<&Path>, search: &Search) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let run = |tell: &mut Tell<'_>| {
        rows = bench::stability::run(search, &mut |row| tell(row))?;
        Ok(rows.iter().map(Row::cells).collect())
    };
    let plots = |rows: &[_]| bench::stability::rows::plot(rows).into_iter().collect();
    table(("stability", out), (&Row::COLUMNS, search.json()), run, plots)?;
    if let (Some(folder), 1) = (out, search.n_scenes) {
        // One that is to be looked at.
        let drawn = bench::stability::drawn::scene(search.first_seed);
        file(&folder.join(format!("scene-{}.toml", search.first_seed)), &drawn.text)?;
    }
    none_missed(rows.iter().filter(|row| !row.holds()).count(), rows.len())
}

fn bench_signal(out: Option<&Path>, arguments: &Arguments) -> Result<(), Failure> {
    use signal::{COLUMNS, Effort};
    let effort = arguments.effort([Effort::QUICK, Effort::THINNED, Effort::WHOLE]);
    let plots = |rows: &[_]| signal::plot(rows).into_iter().collect();
    let run = |tell: &mut Tell<'_>| signal::run(&effort, tell);
    let rows = table(("signal", out), (&COLUMNS, effort.json()), run, plots)?;
    none_missed(signal::n_missed(&rows), rows.len())
}

/// The whole pipeline, then what is lost when the analysis is thinned.
fn bench_monitor(out: Option<&Path>, arguments: &Arguments) -> Result<(), Failure> {
    use bench::{monitor, thinning};
    use monitor::Effort;
    let effort = arguments.effort([Effort::QUICK, Effort::QUICK, Effort::WHOLE]);
    let plots = |rows: &[_]| monitor::plot(rows).into_iter().collect();
    let run = |tell: &mut Tell<'_>| monitor::run(&effort, tell);
    table(("monitor", out), (&monitor::COLUMNS, effort.json()), run, plots)?;

    use thinning::Effort as OfThinning;
    let effort = arguments.effort([OfThinning::QUICK, OfThinning::THINNED, OfThinning::WHOLE]);
    let run = |tell: &mut Tell<'_>| thinning::run(&effort, tell);
    table(("thinning", out), (&thinning::COLUMNS, effort.json()), run, bare)?;
    Ok(())
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
    let mut stdout = Output::stdout();
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
        let (mut stdout, computer) = (Output::stdout(), Computer::this());
        stdout.write(&format!("{}\n\n{}", computer.line(), table::heading(columns)))?;
        Ok(Self { stdout, columns, computer })
    }

    fn row(&mut self, row: &[Cell]) -> Result<(), BenchError> {
        let text = table::text_row(self.columns, row);
        self.stdout.write(&text).map_err(|error| BenchError::Write(Box::new(error)))
    }

    /// Writes `NAME.csv`, `.json`, `.html` and, with plots, `.svg`, `-2.svg` … into the folder, if there is one.
    fn write(
        &self,
        name: &str,
        out: Option<&Path>,
        settings: &Value,
        rows: &[Vec<Cell>],
        plots: &[String],
    ) -> Result<(), Failure> {
        let Some(folder) = out else { return Ok(()) };
        for (i, svg) in plots.iter().enumerate() {
            let number = if i == 0 { String::new() } else { format!("-{}", i + 1) };
            file(&folder.join(format!("{name}{number}.svg")), svg)?;
        }
        let json = table::json(name, (&self.computer, settings), self.columns, rows);
        file(&folder.join(format!("{name}.html")), &self.page(name, plots, rows))?;
        file(&folder.join(format!("{name}.csv")), &table::csv(self.columns, rows))?;
        file(&folder.join(format!("{name}.json")), &json)
    }
}

impl Page {
    /// The table and its plots as one page.
    fn page(&self, name: &str, plots: &[String], rows: &[Vec<Cell>]) -> String {
        let title = format!("rotorwatch bench {name}");
        let heading: Vec<&str> = self.columns.iter().map(|column| column.name).collect();
        let cells = |row: &Vec<Cell>| row.iter().map(|cell| escaped(&cell.text())).collect();
        let body = format!(
            "<h1>{title}</h1>\n<p class=\"soft\">{}</p>\n{}\n{}",
            escaped(&self.computer.line()),
            plots.join("\n"),
            html::table(&heading, rows.iter().map(cells))
        );
        html::document(&title, &body)
    }
}

fn file(path: &Path, text: &str) -> Result<(), Failure> {
    let mut output = Output::open(Some(path), &Spared::nothing())?;
    output.write(text)?;
    Ok(output.finish()?)
}
