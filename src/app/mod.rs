//! The daemon: builds shards, sources and server from the configuration, joins them, ends them.
//!
//! ```text
//! source thread ──Link──▶ byte queue ──▶ shard thread: Monitor ──watch──▶ HTTP (tokio)
//!                                              ▲ request, one-shot reply ────┘
//! ```
//!
//! The one module, besides the command line, that reads the clock and starts threads. Shards never
//! wait for HTTP; sources wait for shards; everything waits for the stop only.

pub mod stop;
pub mod queue;
pub mod link;
pub mod trend;
mod trouble;
mod room;
mod sizes;
pub mod keeper;
pub mod trending;
mod alarming;
mod capturing;
mod captures;
mod baselines;
mod learning;
mod metering;
pub mod monitored;
mod renewal;
mod silencing;
mod reload;
pub mod shard;
pub mod outlet;
pub mod source;
pub mod simulated;
pub mod live;
pub mod recording;
pub mod client;
mod broker;
pub mod notify;
pub mod tls;
mod access;
mod connection;
mod descriptors;
mod supervisor;
pub mod http;
pub mod start_error;
mod stores;
mod fitted;
mod threads;
pub mod build;
pub mod daemon;

use crate::alarms::Moment;
use crate::config::Config;
use crate::signal::Timestamp;
use crate::telemetry;
use daemon::Daemon;
use start_error::StartError;
use std::io::Write;
use std::path::Path;
use std::time::Instant;
use std::time::SystemTime;

/// Folder of captures in a store.
pub(crate) const CAPTURES: &str = captures::FOLDER;

/// Runs the daemon until SIGTERM or SIGINT, and follows its configuration `file`.
///
/// The first line on `stdout`, once the port is bound, is `listening on http://ADDRESS`; the second, if a source
/// has senders, `ingest on tcp://ADDRESS`; encrypted, `https` and `tls`.
///
/// # Errors
/// When the daemon cannot be started; nothing has been printed then.
pub fn run(config: &Config, file: &Path, stdout: &mut dyn Write) -> Result<(), StartError> {
    telemetry::set_log_level(config.log.name());
    let mut daemon = Daemon::start(config)?;
    daemon.follow(file)?;
    let tls = config.access.tls.as_ref();
    let scheme = if tls.is_some() { "https" } else { "http" };
    let mut lines = format!("listening on {scheme}://{}\n", daemon.address());
    if let Some(address) = daemon.ingest_address() {
        let scheme = if tls.is_some_and(|tls| tls.of_ingest) { "tls" } else { "tcp" };
        lines.push_str(&format!("ingest on {scheme}://{address}\n"));
    }
    let printed = stdout.write_all(lines.as_bytes()).and_then(|()| stdout.flush());
    if let Err(error) = printed {
        tracing::warn!(%error, "the address cannot be printed on stdout");
    }
    supervisor::ready(lines.lines().next().unwrap_or_default());
    daemon.wait_for_signal();
    supervisor::stopping();
    daemon.stop();
    Ok(())
}

/// The clock. Monotonic: it paces, times out and measures; stream time comes from the samples.
#[must_use]
#[expect(clippy::disallowed_methods, reason = "the daemon's one reading of the clock")]
pub fn now() -> Instant {
    Instant::now()
}

/// The clocks of the daemon, for alarms.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    started: Instant,
}

impl Clock {
    /// Begins to count monotonic time.
    #[must_use]
    pub fn start() -> Self {
        Self { started: now() }
    }

    /// This instant, at a stream time.
    #[must_use]
    pub fn moment(self, stream_s: f64) -> Moment {
        let monotonic_s = now().saturating_duration_since(self.started).as_secs_f64();
        Moment { stream_s, monotonic_s, utc: wall_clock() }
    }
}

/// UTC now. For labels only: no delay and no order depends on it.
#[must_use]
#[expect(clippy::disallowed_methods, reason = "the daemon's one reading of the wall clock")]
pub fn wall_clock() -> Timestamp {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod keeper_tests;
