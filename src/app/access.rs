//! The door of the daemon and what stands open of it.

use super::Clock;
use super::tls::Tls;
use crate::access::Counters;
use crate::access::Door;
use crate::config::Config;
use crate::telemetry::AccessMetrics;
use std::net::SocketAddr;
use std::sync::Arc;

/// How the daemon is guarded.
pub(super) struct Guard {
    pub(super) door: Arc<Door>,
    pub(super) tls: Option<Tls>,
    /// What is open that should not be, for people.
    pub(super) warnings: Vec<String>,
}

/// Builds it.
///
/// # Errors
/// When TLS refuses its settings.
pub(super) fn guard(
    config: &Config,
    (http, ingest): (SocketAddr, Option<SocketAddr>),
    metrics: &AccessMetrics,
) -> Result<Guard, rustls::Error> {
    let access = &config.access;
    let counters = Counters {
        missing: metrics.denied("missing"),
        unknown: metrics.denied("unknown"),
        expired: metrics.denied("expired"),
        role: metrics.denied("role"),
        limited: metrics.denied("too_many"),
        fast: metrics.denied("too_fast"),
    };
    let clock = Clock::start();
    let now = move || {
        let moment = clock.moment(0.0);
        (moment.utc, moment.monotonic_s)
    };
    let tokens = access.tokens.clone().map(|list| list.0);
    let door = Door::new(tokens, counters, Arc::new(now));
    let door = Arc::new(door.with_requests(access.limits.max_requests_per_s));
    let tls = access.tls.as_ref().map(|tls| Tls::new(&tls.identity)).transpose()?;
    let is_encrypted = [tls.is_some(), access.tls.as_ref().is_some_and(|tls| tls.of_ingest)];
    let exposed: Vec<(SocketAddr, bool)> = [Some(http), ingest]
        .into_iter()
        .zip(is_encrypted)
        .filter_map(|(address, is_encrypted)| Some((address?, is_encrypted)))
        .filter(|(address, _)| !address.ip().is_loopback())
        .collect();
    let mut warnings = Vec::new();
    for (address, is_encrypted) in &exposed {
        if door.is_open() {
            warnings.push(format!(
                "{address} can be reached from other hosts and nobody needs a token: whoever reaches it may do everything"
            ));
        }
        if !is_encrypted {
            warnings.push(format!(
                "{address} can be reached from other hosts and is not encrypted: tokens and data can be read on the way"
            ));
        }
    }
    for warning in &warnings {
        tracing::warn!(warning, "INSECURE");
    }
    let is_open = !exposed.is_empty() && door.is_open();
    metrics.insecure("no_tokens").set(i64::from(is_open));
    let is_plain = exposed.iter().any(|(_, is_encrypted)| !is_encrypted);
    metrics.insecure("plain_text").set(i64::from(is_plain));
    Ok(Guard { door, tls, warnings })
}
