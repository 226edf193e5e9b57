//! The log of the process: lines for people or machines on stderr. Must not know what is logged.

use std::io;
use std::sync::OnceLock;
use tracing_log::LogTracer;
use tracing_subscriber::EnvFilter;

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
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr);
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
