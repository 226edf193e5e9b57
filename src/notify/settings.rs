//! What the configuration says of receivers.

use super::Backoff;
use super::Filter;
use super::Secret;
use super::endpoint::Endpoint;
use std::path::PathBuf;

/// Everyone who is told.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Webhooks.
    pub webhooks: Vec<Webhook>,
    /// Brokers of MQTT.
    pub brokers: Vec<Broker>,
}

/// A receiver of JSON by HTTP.
#[derive(Debug, Clone, PartialEq)]
pub struct Webhook {
    /// Its name, unique among all receivers.
    pub name: String,
    /// Where it is.
    pub endpoint: Endpoint,
    /// Key of the signature; `None`: not signed.
    pub secret: Option<Secret>,
    /// Further headers.
    pub headers: Vec<(String, Secret)>,
    /// Certificates of authorities to trust instead of the system's.
    pub ca_file: Option<PathBuf>,
    /// What it is told of.
    pub filter: Filter,
    /// Longest time for one attempt, s.
    pub timeout_s: f64,
    /// Waits between attempts.
    pub backoff: Backoff,
    /// Events that may wait for it.
    pub max_waiting: usize,
}

/// A broker of MQTT.
#[derive(Debug, Clone, PartialEq)]
pub struct Broker {
    /// Its name, unique among all receivers.
    pub name: String,
    /// How it is reached.
    pub connection: Connection,
    /// Beginning of every topic.
    pub prefix: String,
    /// What its events topic is told of.
    pub filter: Filter,
    /// Waits between attempts.
    pub backoff: Backoff,
    /// Events that may wait for it.
    pub max_waiting: usize,
}

/// How a broker is reached.
#[derive(Debug, Clone, PartialEq)]
pub struct Connection {
    /// Host.
    pub host: String,
    /// Port.
    pub port: u16,
    /// Whether the connection is encrypted and the broker's certificate checked.
    pub tls: bool,
    /// Certificates of authorities to trust instead of the system's.
    pub ca_file: Option<PathBuf>,
    /// Name of this client; the broker knows one connection of each.
    pub client_id: String,
    /// User and password.
    pub credentials: Option<(String, Secret)>,
}

impl Settings {
    /// Names of all receivers.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let webhooks = self.webhooks.iter().map(|webhook| webhook.name.as_str());
        webhooks.chain(self.brokers.iter().map(|broker| broker.name.as_str()))
    }
}
