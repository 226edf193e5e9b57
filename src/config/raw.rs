//! The configuration as written, file and environment merged; every key optional, none trusted.

use super::Problem;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The whole.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Raw {
    pub(super) server: Server,
    pub(super) ingest: Ingest,
    pub(super) store: Store,
    pub(super) recording: Recording,
    pub(super) captures: Captures,
    pub(super) pipeline: Pipeline,
    pub(super) diagnosis: Diagnosis,
    pub(super) alarms: Alarms,
    pub(super) log: Log,
    pub(super) machine: Vec<Machine>,
    pub(super) source: Vec<Source>,
    pub(super) notify: Notify,
}

/// `[server]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Server {
    pub(super) bind: Option<String>,
    pub(super) token_file: Option<String>,
    pub(super) hosts: Names,
    pub(super) cors_origins: Names,
    pub(super) max_requests_per_s: Option<f64>,
    pub(super) max_connections: Option<usize>,
    pub(super) max_event_streams: Option<usize>,
    pub(super) tls: Tls,
}

/// `[server.tls]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Tls {
    pub(super) cert_file: Option<String>,
    pub(super) key_file: Option<String>,
    pub(super) ingest: Option<bool>,
}

/// A list of names; in the environment separated by commas.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Names {
    Listed(Vec<String>),
    Joined(String),
}

impl Default for Names {
    fn default() -> Self {
        Self::Listed(Vec::new())
    }
}

impl Names {
    pub(super) fn list(&self) -> Vec<String> {
        match self {
            Self::Listed(names) => names.clone(),
            Self::Joined(text) => {
                let names = text.split(',').map(str::trim).filter(|name| !name.is_empty());
                names.map(str::to_owned).collect()
            }
        }
    }
}

/// `[ingest]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Ingest {
    pub(super) bind: Option<String>,
    pub(super) max_connections: Option<usize>,
}

/// `[store]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Store {
    pub(super) directory: Option<String>,
    pub(super) max_bytes: Option<u64>,
    pub(super) trend_days: Option<u32>,
    pub(super) trend_1min_days: Option<u32>,
    pub(super) trend_1h_days: Option<u32>,
}

/// `[recording]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Recording {
    pub(super) enabled: Option<bool>,
    pub(super) segment_seconds: Option<f64>,
    pub(super) segment_bytes: Option<u64>,
    pub(super) flush_seconds: Option<f64>,
    pub(super) compression: Option<u32>,
}

/// `[captures]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Captures {
    pub(super) enabled: Option<bool>,
    pub(super) seconds_before: Option<f64>,
    pub(super) seconds_after: Option<f64>,
    pub(super) most_per_hour: Option<usize>,
    pub(super) max_bytes: Option<u64>,
}

/// `[pipeline]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Pipeline {
    pub(super) workers: Option<usize>,
    pub(super) ring_seconds: Option<f64>,
    pub(super) memory_limit_bytes: Option<u64>,
    pub(super) window_seconds: Option<f64>,
    pub(super) hop_seconds: Option<f64>,
    pub(super) lengthen_windows: Option<bool>,
}

/// `[diagnosis]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Diagnosis {
    pub(super) false_alarms_per_component_year: Option<f64>,
}

/// `[log]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Log {
    pub(super) level: Option<String>,
}

/// `[alarms]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Alarms {
    pub(super) on_delay_s: Option<f64>,
    pub(super) off_delay_s: Option<f64>,
    pub(super) history_len: Option<usize>,
    pub(super) missing_after_s: Option<f64>,
    pub(super) max_shelving_s: Option<f64>,
}

/// `[[machine]]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Machine {
    pub(super) file: Option<String>,
    pub(super) baseline: Vec<String>,
}

/// `[[source]]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Source {
    pub(super) kind: Option<String>,
    pub(super) machine: Option<String>,
    pub(super) file: Option<String>,
    pub(super) speed: Option<Speed>,
    pub(super) r#loop: Option<bool>,
    pub(super) rate_hz: Option<f64>,
    pub(super) unit: Option<String>,
    pub(super) scene: Option<String>,
    pub(super) scenario: Option<String>,
    pub(super) seed: Option<u64>,
    pub(super) host: Option<String>,
    pub(super) port: Option<u16>,
    pub(super) tls: Option<bool>,
    pub(super) ca_file: Option<String>,
    pub(super) client_id: Option<String>,
    pub(super) user: Option<String>,
    pub(super) password_file: Option<String>,
    pub(super) topics: Vec<String>,
}

/// How a broker is reached: keys of `[[notify.mqtt]]` and of a `[[source]]`.
#[derive(Debug)]
pub(super) struct Reached {
    pub(super) host: Option<String>,
    pub(super) port: Option<u16>,
    pub(super) tls: Option<bool>,
    pub(super) ca_file: Option<String>,
    pub(super) client_id: Option<String>,
    pub(super) user: Option<String>,
    pub(super) password_file: Option<String>,
}

/// `[notify]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Notify {
    pub(super) webhook: Vec<Webhook>,
    pub(super) mqtt: Vec<Mqtt>,
}

/// `[[notify.webhook]]`; not `Debug`: it may hold a secret.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Webhook {
    pub(super) name: Option<String>,
    pub(super) url: Option<String>,
    pub(super) plain_http: Option<bool>,
    pub(super) secret: Option<String>,
    pub(super) secret_file: Option<String>,
    pub(super) headers: Vec<String>,
    pub(super) headers_file: Option<String>,
    pub(super) ca_file: Option<String>,
    pub(super) machines: Vec<String>,
    pub(super) levels: Vec<String>,
    pub(super) transitions: Vec<String>,
    pub(super) timeout_s: Option<f64>,
    pub(super) max_backoff_s: Option<f64>,
    pub(super) max_waiting: Option<usize>,
}

impl std::fmt::Debug for Webhook {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Webhook").field("name", &self.name).finish_non_exhaustive()
    }
}

/// `[[notify.mqtt]]`
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Mqtt {
    pub(super) name: Option<String>,
    pub(super) host: Option<String>,
    pub(super) port: Option<u16>,
    pub(super) tls: Option<bool>,
    pub(super) ca_file: Option<String>,
    pub(super) client_id: Option<String>,
    pub(super) user: Option<String>,
    pub(super) password_file: Option<String>,
    pub(super) prefix: Option<String>,
    pub(super) machines: Vec<String>,
    pub(super) levels: Vec<String>,
    pub(super) transitions: Vec<String>,
    pub(super) max_backoff_s: Option<f64>,
    pub(super) max_waiting: Option<usize>,
}

/// `"max"` or a number.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Speed {
    Factor(f64),
    Word(SpeedWord),
}

/// Speeds that have a name.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum SpeedWord {
    Max,
}

/// Lays the environment over the file's values.
///
/// # Errors
/// When a value does not have its key's type, which the scan before should have found.
pub(super) fn merge(
    file: &toml::Table,
    variables: &BTreeMap<String, String>,
) -> Result<Raw, Problem> {
    let environment = config::Environment::with_prefix("ROTORWATCH")
        .prefix_separator("__")
        .separator("__")
        .source(Some(variables.iter().map(|(k, v)| (k.clone(), v.clone())).collect()));
    let failed = |path: String, error: &dyn std::fmt::Display| Problem {
        place: "configuration".to_owned(),
        message: format!("{path}: {error}"),
    };
    // As text: `config::Config::try_from` drops list items whose tables are empty.
    let text = toml::to_string(file).map_err(|error| failed("file".to_owned(), &error))?;
    let merged = config::Config::builder()
        .add_source(config::File::from_str(&text, config::FileFormat::Toml))
        .add_source(environment)
        .build();
    let merged = merged.map_err(|error| failed("merge".to_owned(), &error))?;
    serde_path_to_error::deserialize(merged)
        .map_err(|error| failed(error.path().to_string(), error.inner()))
}
