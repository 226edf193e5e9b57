//! Why the daemon does not start: each with what to do about it.

use super::client::ClientError;
use crate::ingest::simulated;
use crate::offline::OfflineError;
use crate::pipeline::MonitorError;
use crate::store::StoreError;
use crate::store::trends::Projection;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Why the daemon cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The rings do not fit.
    #[error(
        "the rings, queues and what is held for captures need {needed_bytes} bytes and memory_limit_bytes is \
         {limit_bytes}: raise it, shorten ring_seconds or captures.seconds_before, or monitor fewer channels \
         ({largest})"
    )]
    Memory {
        /// What they need.
        needed_bytes: u64,
        /// What is allowed.
        limit_bytes: u64,
        /// The machine that needs most, and how much.
        largest: String,
    },
    /// A machine cannot be monitored with its source.
    #[error("machine {machine:?} cannot be monitored")]
    Monitor {
        /// Machine id.
        machine: String,
        /// Why.
        source: MonitorError,
    },
    /// A scene cannot be simulated.
    #[error("the source of machine {machine:?} cannot be simulated")]
    Scene {
        /// Machine id.
        machine: String,
        /// Why.
        source: Box<simulated::OpenError>,
    },
    /// The certificates of a broker that a source asks cannot be read.
    #[error("a source of the kind \"mqtt\" cannot be used")]
    Broker(#[from] ClientError),
    /// Connections cannot be encrypted.
    #[error("TLS cannot be set up as server.tls says")]
    Tls(#[from] rustls::Error),
    /// A healthy capture cannot be measured.
    #[error("the baseline {} of machine {machine:?} cannot be used", file.display())]
    Baseline {
        /// Machine id.
        machine: String,
        /// The capture.
        file: PathBuf,
        /// Why.
        source: Box<OfflineError>,
    },
    /// The trends that are to be kept do not fit.
    #[error(
        "the trends of {n_channels} channels will take about {} bytes ({} for trend_days, {} for trend_1min_days, \
         {} for trend_1h_days) and {limit_bytes} of store.max_bytes are for them: raise max_bytes, keep trends for \
         fewer days, or lengthen hop_seconds",
        needed.total(),
        needed.windows_bytes,
        needed.minutes_bytes,
        needed.hours_bytes
    )]
    Trends {
        /// Channels.
        n_channels: usize,
        /// What they will take.
        needed: Projection,
        /// What is allowed.
        limit_bytes: u64,
    },
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A receiver of notifications cannot be told.
    #[error("{receiver:?} cannot be notified")]
    Notify {
        /// Its name.
        receiver: String,
        /// Why.
        source: ClientError,
    },
    /// The port cannot be bound.
    #[error("the address {address} cannot be bound, choose another in [server] bind")]
    Bind {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The port of senders cannot be bound.
    #[error("the address {address} cannot be bound, choose another in [ingest] bind")]
    BindSenders {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The system does not give a thread or a signal handler.
    #[error("the system refused {what}")]
    System {
        /// What was asked for.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
}
