//! Live sources: lets senders in, one thread a connection, and hands on what they send.
//!
//! ```text
//! TCP, WebSocket ──▶ conversation: a thread each ──▶ Port: one a machine ──▶ byte queue ──▶ shard
//!                    frames, Session                  Intake, recorder
//! ```
//!
//! A sender that keeps to its credit is waited for and loses nothing; one that does not loses its newest blocks, and the
//! loss is counted.

pub mod client;
mod conversation;
pub(super) mod joining;
pub mod line;
pub mod opening;
pub mod pipe;
mod port;
pub mod tcp;
pub mod values;

pub(super) use port::Port;
pub(super) use port::PortPlan;

use super::client::ClientError;
use super::stop::Stop;
use crate::access::Denied;
use crate::access::Door;
use crate::access::Role;
use crate::access::Token;
use crate::app::tls::Tls;
use crate::config::Ingest;
use crate::ingest::live::Refusal;
use crate::ingest::live::intake::Arrived;
use crate::ingest::replay::StreamInfo;
use crate::signal::Timestamp;
use crate::telemetry::IngestMetrics;
use crate::telemetry::Metrics;
use crate::wire::ErrorCode;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::time::Instant;
use values::Listener;

/// How long before the start of the daemon stream time begins: what senders buffered while it was down has its place.
const BEFORE_START_S: f64 = 86_400.0;

/// What is known of a stream before its senders have said anything.
pub(super) fn unknown_stream() -> StreamInfo {
    StreamInfo {
        channels: Vec::new(),
        start_time: Some(super::wall_clock().plus_seconds(-BEFORE_START_S)),
        shaft_speed: None,
        load: None,
        received: Vec::new(),
    }
}

/// What every connection shares.
pub struct Hub {
    ports: BTreeMap<String, Arc<Port>>,
    door: Arc<Door>,
    /// How senders over TCP are encrypted.
    tls: Option<Tls>,
    max_connections: usize,
    n_connections: AtomicUsize,
    next_session: AtomicU64,
    metrics: IngestMetrics,
    clock: LiveClock,
    stop: Arc<Stop>,
}

impl std::fmt::Debug for Hub {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hub").field("machines", &self.ports.keys()).finish_non_exhaustive()
    }
}

impl Hub {
    /// A hub for these machines.
    #[must_use]
    pub(super) fn new(
        config: &Ingest,
        (door, tls): (Arc<Door>, Option<Tls>),
        ports: Vec<Arc<Port>>,
        metrics: IngestMetrics,
        stop: Arc<Stop>,
    ) -> Self {
        Self {
            ports: ports.into_iter().map(|port| (port.machine().to_owned(), port)).collect(),
            door,
            tls,
            max_connections: config.max_connections,
            n_connections: AtomicUsize::new(0),
            next_session: AtomicU64::new(0),
            metrics,
            clock: LiveClock::start(),
            stop,
        }
    }

    /// The place of a new connection, unless there are too many.
    ///
    /// # Errors
    /// When there are.
    pub(super) fn enter(self: &Arc<Self>) -> Result<Seat, Refusal> {
        let taken = self.n_connections.fetch_add(1, Ordering::AcqRel);
        self.metrics.connections.set(i64::try_from(taken + 1).unwrap_or(i64::MAX));
        let seat = Seat {
            hub: Arc::clone(self),
            session: self.next_session.fetch_add(1, Ordering::Relaxed),
        };
        if taken >= self.max_connections {
            let text = format!(
                "{} senders are connected, as many as [ingest] max_connections allows",
                self.max_connections
            );
            return Err(Refusal::new(ErrorCode::TooManyConnections, text));
        }
        Ok(seat)
    }

    /// Counts and logs why a sender is not listened to.
    pub(super) fn note_refusal(&self, peer: &str, refusal: &Refusal) {
        let name = refusal.code.name();
        // A flood of refusals shall not flood the log: the counter has them all.
        let n = self.metrics.refused(name).inc();
        if n < 10 || n.is_power_of_two() {
            tracing::warn!(peer, code = name, reason = refusal.text, "sender refused");
        }
    }

    /// Counts the samples of a block that was refused.
    pub(super) fn note_lost(&self, refusal: &Refusal, n_samples: u64) {
        if n_samples > 0 {
            self.metrics.refused_samples(refusal.code.name()).inc_by(n_samples);
        }
    }

    /// The machine that a sender names, if its token is of it.
    fn port(&self, machine: &str, who: Option<&Token>) -> Result<&Arc<Port>, Refusal> {
        let is_there = |port: &&Arc<Port>| {
            port.live().listens && who.is_none_or(|token| token.sees(port.machine()))
        };
        // A sender that names none means the only one there is.
        let mut listening = self.ports.values().filter(is_there);
        if let (true, Some(only), None) = (machine.is_empty(), listening.next(), listening.next()) {
            return Ok(only);
        }
        self.ports.get(machine).filter(is_there).ok_or_else(|| {
            let shown: String = machine.chars().take(100).collect();
            let text = format!("no machine {shown:?} has a source of the kind \"tcp\"");
            Refusal::new(ErrorCode::UnknownMachine, text)
        })
    }

    /// Who a sender is by the token it says; every configured one is looked at, whatever it begins with.
    fn authorise(&self, token: &str, peer: Option<IpAddr>) -> Result<Option<Arc<Token>>, Refusal> {
        let refused = |text: String| Err(Refusal::new(ErrorCode::Unauthorised, text));
        let said = (!token.is_empty()).then_some(token);
        match self.door.admit(said, peer) {
            Ok(Some(token)) if !token.role().may(Role::Ingest) => {
                self.door.note_role(&token);
                refused("the token's role does not let it send samples".to_owned())
            }
            Ok(who) => Ok(who),
            Err(Denied::Missing) => refused("a token is needed in the hello".to_owned()),
            Err(denied) => refused(denied.to_string()),
        }
    }

    /// Whether a sender may go on.
    fn check(&self, who: Option<&Arc<Token>>) -> Result<(), Refusal> {
        if self.door.holds(who) {
            return Ok(());
        }
        Err(Refusal::new(ErrorCode::Unauthorised, "the token was revoked, changed or is over"))
    }

    /// Brings the counters of every channel up to date.
    pub(super) fn count(&self, metrics: &Metrics) {
        for port in self.ports.values() {
            port.count(metrics);
        }
    }

    /// What listens to the brokers of all machines, each for a thread of its own.
    ///
    /// # Errors
    /// When certificates cannot be read.
    pub(super) fn listeners(self: &Arc<Self>) -> Result<Vec<Listener>, ClientError> {
        let of_port = |port: &Arc<Port>| {
            let port = Arc::clone(port);
            let brokers = port.live().brokers.clone();
            brokers.into_iter().map(move |broker| Listener::new(self, &port, &broker))
        };
        self.ports.values().flat_map(of_port).collect()
    }

    /// Connections there are.
    pub(super) fn n_connections(&self) -> usize {
        self.n_connections.load(Ordering::Acquire)
    }

    /// Ends what is recorded, once no sender is left.
    pub(super) fn finish(&self) {
        for port in self.ports.values() {
            port.finish_recording();
        }
    }
}

/// A connection's place; given back when dropped.
#[derive(Debug)]
pub(super) struct Seat {
    hub: Arc<Hub>,
    session: u64,
}

impl Drop for Seat {
    fn drop(&mut self) {
        let before = self.hub.n_connections.fetch_sub(1, Ordering::AcqRel);
        self.hub.metrics.connections.set(i64::try_from(before - 1).unwrap_or(i64::MAX));
    }
}

/// The clock that samples of senders are held against: it does not go back when the computer's is set.
#[derive(Debug, Clone, Copy)]
pub(super) struct LiveClock {
    started: Instant,
    utc: Timestamp,
}

impl LiveClock {
    fn start() -> Self {
        Self { started: super::now(), utc: super::wall_clock() }
    }

    /// Seconds since the start.
    pub(super) fn elapsed_s(self) -> f64 {
        super::now().saturating_duration_since(self.started).as_secs_f64()
    }

    /// Now: by the computer's clock, or, if that was set back, by what has passed since the start.
    pub(super) fn arrived(self) -> Arrived {
        Arrived(super::wall_clock().max(self.utc.plus_seconds(self.elapsed_s())))
    }
}

/// Memory that the rings of live streams may take; each takes its part as it is opened.
#[derive(Debug)]
pub(super) struct Room {
    limit_bytes: u64,
    taken: Mutex<BTreeMap<String, u64>>,
}

impl Room {
    pub(super) fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, taken: Mutex::default() }
    }

    /// Takes so much for a machine instead of what it had.
    fn take(&self, machine: &str, bytes: u64) -> Result<(), String> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let of_others: u64 =
            taken.iter().filter(|(id, _)| *id != machine).map(|(_, bytes)| *bytes).sum();
        let free = self.limit_bytes.saturating_sub(of_others);
        if bytes > free {
            return Err(format!(
                "these channels need {bytes} bytes and {free} are left of memory_limit_bytes: raise it, shorten \
                 ring_seconds or captures.seconds_before, or send fewer channels"
            ));
        }
        taken.insert(machine.to_owned(), bytes);
        Ok(())
    }
}

#[cfg(test)]
mod played;
#[cfg(test)]
mod tests;

#[cfg(test)]
mod opening_tests;
