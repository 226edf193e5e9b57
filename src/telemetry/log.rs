//! The log of the process: lines for people or machines on stderr. Must not know what is logged.

use std::collections::VecDeque;
use std::io;
use std::io::Write;
use std::sync::Mutex;
use std::sync::OnceLock;
use std::sync::PoisonError;
use tracing_log::LogTracer;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::fmt::writer::MakeWriterExt;

/// Environment variable that says what is logged, such as `debug` or `rotorwatch::app=trace`.
pub const LOG_VARIABLE: &str = "ROTORWATCH_LOG";

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// Beginnings of the names of libraries whose log would tell secrets: they log whole addresses and messages.
const TALKATIVE: [&str; 4] = ["ureq", "rustls", "rumqtt", "mqttbytes"];

/// Puts another filter in place; false: the log has ended.
type Change = Box<dyn Fn(EnvFilter) -> bool + Send + Sync>;

/// Of the log of this process, if its filter was not stated at the start.
static CHANGE: OnceLock<Change> = OnceLock::new();

/// The newest lines of the log, for whoever asks what has happened.
static NEWEST: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());

/// Lines kept of the log, and bytes of each.
const MAX_LINES: usize = 1000;
const MAX_LINE_BYTES: usize = 2000;

/// Keeps what is logged.
#[derive(Debug, Clone, Copy)]
struct Keep;

impl Write for Keep {
    /// A line of the log comes as a whole.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let kept = line.get(..MAX_LINE_BYTES).unwrap_or(line);
        let text = String::from_utf8_lossy(kept).trim_end().to_owned();
        let mut newest = NEWEST.lock().unwrap_or_else(PoisonError::into_inner);
        if newest.len() >= MAX_LINES {
            newest.pop_front();
        }
        newest.push_back(text);
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Keep {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        *self
    }
}

/// The newest lines of the log, oldest first, at most `n`.
#[must_use]
pub fn newest_log_lines(n: usize) -> Vec<String> {
    let newest = NEWEST.lock().unwrap_or_else(PoisonError::into_inner);
    newest.iter().skip(newest.len().saturating_sub(n)).cloned().collect()
}

/// Logs from `level` on (`error`, `warn`, `info`, `debug`, `trace`); nothing happens where [`LOG_VARIABLE`] says what is
/// logged, or there is no log.
pub fn set_log_level(level: &str) {
    if let (Some(change), Ok(filter)) = (CHANGE.get(), EnvFilter::builder().parse(level)) {
        change(filter);
    }
}

/// Why the log cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The filter cannot be read.
    #[error("{LOG_VARIABLE} is no log filter, write a level (warn, info, debug) or module=level")]
    Filter(#[source] tracing_subscriber::filter::ParseError),
    /// A log is set up already.
    #[error("the log was set up twice")]
    Twice(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// Starts the log on stderr with the filter `filter` (`None`: `info`).
///
/// # Errors
/// When the filter cannot be read, or there is a log already.
pub fn start_log(format: LogFormat, filter: Option<&str>) -> Result<(), LogError> {
    let is_stated = filter.is_some();
    let filter = EnvFilter::builder().parse(filter.unwrap_or("info")).map_err(LogError::Filter)?;
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr.and(Keep));
    let (started, change): (_, Change) = match format {
        LogFormat::Text => {
            let log = log.with_ansi(false).with_filter_reloading();
            let handle = log.reload_handle();
            let started = tracing::subscriber::set_global_default(log.finish());
            (started, Box::new(move |filter| handle.reload(filter).is_ok()))
        }
        LogFormat::Json => {
            let log = log.json().with_filter_reloading();
            let handle = log.reload_handle();
            let started = tracing::subscriber::set_global_default(log.finish());
            (started, Box::new(move |filter| handle.reload(filter).is_ok()))
        }
    };
    if !is_stated {
        CHANGE.get_or_init(|| change);
    }
    started.map_err(|error| LogError::Twice(error.into()))?;
    // What libraries log by other means; at no level what clients say of addresses and messages.
    let others = TALKATIVE.iter().fold(LogTracer::builder(), |log, name| log.ignore_crate(*name));
    others.init().map_err(|error| LogError::Twice(error.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_lines_are_kept_and_no_more() {
        for n in 0..MAX_LINES + 5 {
            Keep.write_all(format!("line {n}\n").as_bytes()).unwrap();
        }
        Keep.write_all(&[b'x'; 5000]).unwrap();
        let lines = newest_log_lines(usize::MAX);
        assert_eq!((lines.len(), lines.last().map(String::len)), (MAX_LINES, Some(MAX_LINE_BYTES)));
        let two = newest_log_lines(2);
        assert_eq!(two[0], format!("line {}", MAX_LINES + 4));
    }
}
