//! `rotorwatch export`: stored trends, alarm events and what people found of verdicts, as CSV or HDF5.
//!
//! Reads the store of a configuration, beside its daemon or without. CSV is in long form, one value a line.

mod feedback;

use super::baseline::NoSuchMachine;
use super::output::Output;
use super::output::OutputError;
use super::output::Spared;
use super::replay_alarms::time;
use crate::alarms::AlarmEvent;
use crate::api::wire::rfc3339;
use crate::capture::error::CaptureError;
use crate::capture::trend::TrendColumn;
use crate::capture::trend::TrendWriter;
use crate::config;
use crate::config::Config;
use crate::config::ConfigErrors;
use crate::signal::Timestamp;
use crate::store::Archive;
use crate::store::EventQuery;
use crate::store::StoreError;
use crate::store::sqlite;
use crate::store::trends::SqliteTrendArchive;
use crate::store::trends::Subject;
use crate::store::trends::Table;
use crate::store::trends::Tier;
use crate::store::trends::TrendArchive;
use crate::store::trends::TrendQuery;
use clap::Args;
use clap::ValueEnum;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch export --config rotorwatch.toml --format csv --out trends.csv
  rotorwatch export --config rotorwatch.toml --machine rig-1 --channel right_x --feature rms --tier 1h --format csv
  rotorwatch export --config rotorwatch.toml --from 2026-11-01T00:00:00Z --format hdf5 --out november.h5
  rotorwatch export --config rotorwatch.toml --alarms --format csv
  rotorwatch export --config rotorwatch.toml --feedback --format csv

CSV has one value a line: time (RFC 3339), machine, kind (channel, or that of a component), name, feature, unit,
value; of minutes and hours the mean, then smallest and largest value. HDF5 has a group a machine, in it one a channel
or component, with the times (seconds since 1970) and a data set a feature. --alarms writes what happened to alarms,
--feedback what people found of verdicts, as CSV. Streams without a start count from 1970-01-01. The daemon may run meanwhile; the minute that is
under way is not stored yet.

Exit codes: 0 done; 2 an error.";

/// Length of what is read at a time, s.
const CHUNK_S: [(Tier, f64); 3] = [
    (Tier::Windows, 6.0 * 3600.0),
    (Tier::Minutes, 10.0 * 86_400.0),
    (Tier::Hours, 366.0 * 86_400.0),
];

/// Events read at a time.
const PAGE: usize = 1000;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Configuration of the daemon whose store is read.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Machine id; every machine by default.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
    /// Channel; may be repeated. Every channel and component by default.
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Component, by its id; may be repeated.
    #[arg(long, value_name = "ID")]
    pub component: Vec<String>,
    /// Feature; may be repeated. Every one by default.
    #[arg(long, value_name = "NAME")]
    pub feature: Vec<String>,
    /// From this time on (RFC 3339); from the beginning by default.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub from: Option<Timestamp>,
    /// Before this time (RFC 3339); to the end by default.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub to: Option<Timestamp>,
    /// How finely.
    #[arg(long, value_enum, default_value = "raw", value_name = "TIER")]
    pub tier: TierArgument,
    /// What happened to alarms, instead of trends.
    #[arg(long, conflicts_with_all = ["channel", "component", "feature", "tier"])]
    pub alarms: bool,
    /// What people found of verdicts, instead of trends.
    #[arg(long, conflicts_with_all = ["channel", "component", "feature", "tier", "alarms"])]
    pub feedback: bool,
    /// How to write.
    #[arg(long, value_enum)]
    pub format: Format,
    /// Where to write; stdout by default, which HDF5 cannot be written to.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// How finely.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TierArgument {
    /// Every window.
    Raw,
    /// Minutes.
    #[value(name = "1min")]
    Minutes,
    /// Hours.
    #[value(name = "1h")]
    Hours,
}

/// How to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// One value a line.
    Csv,
    /// Data sets.
    Hdf5,
}

/// Why it was not done.
#[derive(Debug, thiserror::Error)]
enum ExportError {
    #[error(transparent)]
    Configuration(#[from] ConfigErrors),
    #[error(transparent)]
    Machine(#[from] NoSuchMachine),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Hdf5(#[from] CaptureError),
    #[error("HDF5 needs a file: name one with --out")]
    NoFile,
    #[error("alarms and feedback are written as CSV: --format csv")]
    OnlyText,
    #[error("no {what} {name:?} of {machine:?} is stored; there is: {there}")]
    Unknown { what: &'static str, name: String, machine: String, there: String },
    #[error("part of the store cannot be read: {0}")]
    Unreadable(String),
}

/// Exports; exit code 0, or 2 on an error.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match export(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(ExportError::Configuration(mistakes)) => super::fail_lines(&mistakes),
        Err(error) => super::fail(&error),
    }
}

fn export(arguments: &Arguments) -> Result<(), ExportError> {
    let config = config::load(&arguments.config)?;
    let machines: Vec<String> = match &arguments.machine {
        Some(id) => vec![super::baseline::machine(&config, Some(id))?.machine.id.clone()],
        None => config.machines.iter().map(|entry| entry.machine.id.clone()).collect(),
    };
    match arguments.format {
        Format::Csv if arguments.alarms => alarms(arguments, &config, &machines),
        Format::Csv if arguments.feedback => feedback::write(arguments, &config, &machines),
        Format::Csv => csv(arguments, &config, &machines),
        Format::Hdf5 if arguments.alarms || arguments.feedback => Err(ExportError::OnlyText),
        Format::Hdf5 => hdf5(arguments, &config, &machines),
    }
}

fn tier(arguments: &Arguments) -> Tier {
    match arguments.tier {
        TierArgument::Raw => Tier::Windows,
        TierArgument::Minutes => Tier::Minutes,
        TierArgument::Hours => Tier::Hours,
    }
}

/// What is wanted of a machine.
fn subjects(
    arguments: &Arguments,
    archive: &SqliteTrendArchive,
    machine: &str,
) -> Result<Vec<Subject>, ExportError> {
    let all = archive.subjects(machine)?;
    if arguments.channel.is_empty() && arguments.component.is_empty() {
        return Ok(all);
    }
    let is = |subject: &Subject, what: &'static str, name: &str| match subject {
        Subject::Channel(channel) => what == "channel" && channel == name,
        Subject::Component(_, id) => what == "component" && id == name,
    };
    let channels = arguments.channel.iter().map(|name| ("channel", name));
    let components = arguments.component.iter().map(|name| ("component", name));
    let mut wanted = Vec::new();
    for (what, name) in channels.chain(components) {
        let found = all.iter().filter(|subject| is(subject, what, name));
        let found: Vec<Subject> = found.cloned().collect();
        if found.is_empty() {
            let there = all.iter().map(|subject| names(subject).1.to_owned());
            return Err(ExportError::Unknown {
                what,
                name: name.clone(),
                machine: machine.to_owned(),
                there: there.collect::<Vec<_>>().join(", "),
            });
        }
        wanted.extend(found);
    }
    Ok(wanted)
}

/// Kind and name of a subject.
fn names(subject: &Subject) -> (&'static str, &str) {
    match subject {
        Subject::Channel(name) => ("channel", name),
        Subject::Component(kind, id) => (kind.name(), id),
    }
}

/// Reads a subject piece by piece in the order of time.
fn pieces(
    arguments: &Arguments,
    archive: &SqliteTrendArchive,
    (machine, subject): (&str, &Subject),
    each: &mut dyn FnMut(&Table) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let tier = tier(arguments);
    // What is not made coarser yet is read from the windows: they may reach further than the tier.
    let mut held: Option<(Timestamp, Timestamp)> = None;
    for one in Tier::ALL.into_iter().filter(|one| *one <= tier) {
        if let Some((from, to)) = archive.span(machine, one)? {
            held = Some(held.map_or((from, to), |(a, b)| (a.min(from), b.max(to))));
        }
    }
    let Some(held) = held else { return Ok(()) };
    let from = arguments.from.unwrap_or(held.0).max(held.0);
    let to = arguments.to.unwrap_or(held.1).min(held.1);
    let length_s = CHUNK_S.iter().find(|(of, _)| *of == tier).map_or(3600.0, |(_, length)| *length);
    let features = (!arguments.feature.is_empty()).then(|| arguments.feature.clone());
    let mut begin = from;
    while begin < to {
        let end = begin.plus_seconds(length_s).min(to);
        let table = archive.trend(&TrendQuery {
            machine: machine.to_owned(),
            subject: subject.clone(),
            from: begin,
            to: end,
            tier,
            features: features.clone(),
            origin: None,
        })?;
        if let Some(why) = table.unreadable.first() {
            return Err(ExportError::Unreadable(why.clone()));
        }
        // A minute or hour that reaches into two pieces is of the one that it begins in.
        let begin_s = begin.0 as f64 * 1e-9;
        let is_first = begin == from;
        let first = table.time_s.partition_point(|time_s| *time_s < begin_s - 1e-7 && !is_first);
        each(&cut(table, first))?;
        begin = end;
    }
    Ok(())
}

/// A table without its first points.
fn cut(mut table: Table, first: usize) -> Table {
    if first > 0 {
        table.time_s.drain(..first);
        table.duration_s.drain(..first.min(table.duration_s.len()));
        for column in &mut table.columns {
            for part in [&mut column.value, &mut column.low, &mut column.high, &mut column.n] {
                part.drain(..first.min(part.len()));
            }
        }
    }
    table
}

fn at(time_s: f64) -> Timestamp {
    Timestamp(0).plus_seconds(time_s)
}

/// A text as a field of a CSV file.
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// A number as a field: nothing where there is none.
fn number(value: Option<&f32>) -> String {
    value.filter(|value| value.is_finite()).map_or(String::new(), ToString::to_string)
}

fn csv(arguments: &Arguments, config: &Config, machines: &[String]) -> Result<(), ExportError> {
    let archive = SqliteTrendArchive::new(&config.store.directory);
    let mut output = Output::open(arguments.out.as_deref(), &Spared::of(config))?;
    let is_coarse = tier(arguments) != Tier::Windows;
    let more = if is_coarse { ",low,high" } else { "" };
    output.write(&format!("time,machine,kind,name,feature,unit,value{more}\n"))?;
    for machine in machines {
        for subject in subjects(arguments, &archive, machine)? {
            let (kind, name) = names(&subject);
            let of = format!("{},{kind},{}", field(machine), field(name));
            pieces(arguments, &archive, (machine, &subject), &mut |table| {
                Ok(output.write(&lines(table, &of, is_coarse))?)
            })?;
        }
    }
    Ok(output.finish()?)
}

/// The lines of a table.
fn lines(table: &Table, of: &str, is_coarse: bool) -> String {
    let mut text = String::new();
    for (place, time_s) in table.time_s.iter().enumerate() {
        let time = rfc3339(Some(at(*time_s)), 0.0);
        for column in &table.columns {
            let value = column.value.get(place);
            if value.is_none_or(|value| value.is_nan()) {
                continue;
            }
            let (feature, unit) = (field(&column.name), column.unit.symbol());
            // A String takes everything.
            let _never = write!(text, "{time},{of},{feature},{unit},{}", number(value));
            if is_coarse {
                let (low, high) = (column.low.get(place), column.high.get(place));
                let _never = write!(text, ",{},{}", number(low), number(high));
            }
            text.push('\n');
        }
    }
    text
}

fn hdf5(arguments: &Arguments, config: &Config, machines: &[String]) -> Result<(), ExportError> {
    let archive = SqliteTrendArchive::new(&config.store.directory);
    let out = arguments.out.as_ref().ok_or(ExportError::NoFile)?;
    Spared::of(config).refuse(out)?;
    let mut writer = TrendWriter::create(out, tier(arguments).name())?;
    for machine in machines {
        for subject in subjects(arguments, &archive, machine)? {
            let mut whole = Table::default();
            pieces(arguments, &archive, (machine, &subject), &mut |table| {
                whole.extend(table);
                Ok(())
            })?;
            let columns = whole.columns.iter().map(|column| TrendColumn {
                name: &column.name,
                unit: column.unit.symbol(),
                value: &column.value,
                low: &column.low,
                high: &column.high,
            });
            let columns: Vec<_> = columns.collect();
            writer.subject(machine, names(&subject), &whole.time_s, &columns)?;
        }
    }
    Ok(writer.finish()?)
}

/// The columns of the alarm events.
const EVENT_COLUMNS: &str = "time,machine,sequence,event,alarm,source,limit,kind,component,level,state,fault,\
                             severity,confidence,author,comment,why\n";

fn alarms(arguments: &Arguments, config: &Config, machines: &[String]) -> Result<(), ExportError> {
    let mut output = Output::open(arguments.out.as_deref(), &Spared::of(config))?;
    output.write(EVENT_COLUMNS)?;
    let Some(archive) = sqlite::read_only(&config.store.directory)? else {
        return Ok(output.finish()?);
    };
    for machine in machines {
        let mut before = u64::MAX;
        let mut pages = Vec::new();
        loop {
            let query = EventQuery {
                machine: machine.clone(),
                before,
                since: arguments.from,
                limit: PAGE,
                start: Some(Timestamp(0)),
                ..EventQuery::default()
            };
            let page = archive.events(&query)?;
            let Some(last) = page.last() else { break };
            before = last.sequence;
            let is_before = |e: &&AlarmEvent| arguments.to.is_none_or(|to| at(e.time_s) < to);
            let kept = page.iter().filter(is_before);
            pages.extend(kept.map(|event| event_line(machine, event)));
        }
        pages.iter().rev().try_for_each(|line| output.write(line))?;
    }
    Ok(output.finish()?)
}

/// An event on one line.
fn event_line(machine: &str, event: &AlarmEvent) -> String {
    let alarm = &event.alarm;
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let by = event.by.as_ref();
    let fields = [
        rfc3339(Some(at(event.time_s)), 0.0),
        field(machine),
        event.sequence.to_string(),
        event.kind.name().to_owned(),
        alarm.id.to_string(),
        alarm.source.name().to_owned(),
        field(alarm.source.limit().unwrap_or_default()),
        alarm.kind.name().to_owned(),
        field(&alarm.component),
        alarm.level.name().to_owned(),
        alarm.state.name().to_owned(),
        alarm.fault.map_or(String::new(), |fault| fault.name().to_owned()),
        optional(alarm.severity),
        optional(alarm.confidence),
        field(by.map_or("", |by| &by.author)),
        field(by.map_or("", |by| &by.comment)),
        field(&alarm.why),
    ];
    fields.join(",") + "\n"
}
