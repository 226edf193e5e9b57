//! Receivers of notifications: raw → validated. Secrets are read here and shown nowhere.

use super::MachineConfig;
use super::raw;
use super::resolve::Resolver;
use crate::alarms::EventKind;
use crate::alarms::Level;
use crate::notify::Backoff;
use crate::notify::Filter;
use crate::notify::Secret;
use crate::notify::endpoint::Endpoint;
use crate::notify::settings::Broker;
use crate::notify::settings::Connection;
use crate::notify::settings::Settings;
use crate::notify::settings::Webhook;
use crate::notify::signature;
use std::fs;
use std::path::PathBuf;

/// Receivers of each kind, at most: each has a thread or task.
const MAX_RECEIVERS: usize = 16;

/// Longest name, secret or header line.
const MAX_CHARS: usize = 4096;

/// Largest file of secrets, bytes.
const MAX_FILE_BYTES: u64 = 64 * 1024;

/// Longest time for one attempt unless said otherwise, s.
const TIMEOUT_S: f64 = 10.0;

/// Events that may wait unless said otherwise.
const MAX_WAITING: usize = 10_000;

/// Ports of MQTT without and with TLS.
const PORT: u16 = 1883;
const PORT_TLS: u16 = 8883;

/// Headers that are ours.
const OWN_HEADERS: [&str; 8] = [
    "content-type",
    "content-length",
    "transfer-encoding",
    "host",
    "user-agent",
    "webhook-id",
    "webhook-timestamp",
    "webhook-signature",
];

impl Resolver<'_> {
    /// Makes the receivers; mistakes are reported.
    pub(super) fn receivers(&mut self, raw: raw::Notify, machines: &[MachineConfig]) -> Settings {
        let mut settings = Settings::default();
        for (list, n) in [("webhook", raw.webhook.len()), ("mqtt", raw.mqtt.len())] {
            if n > MAX_RECEIVERS {
                let message = format!("there are {n}, at most {MAX_RECEIVERS} are allowed");
                self.report(&format!("notify.{list}"), message);
            }
        }
        for (i, webhook) in raw.webhook.into_iter().enumerate() {
            let path = format!("notify.webhook[{i}]");
            self.check_name(&path, webhook.name.as_deref(), &settings);
            settings.webhooks.extend(self.webhook(&path, webhook, machines));
        }
        for (i, broker) in raw.mqtt.into_iter().enumerate() {
            let path = format!("notify.mqtt[{i}]");
            self.check_name(&path, broker.name.as_deref(), &settings);
            settings.brokers.extend(self.broker(&path, broker, machines));
        }
        settings
    }

    /// Names are labels of metrics and keys of the store.
    fn check_name(&mut self, path: &str, name: Option<&str>, before: &Settings) {
        let Some(name) = name else { return };
        let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        if name.is_empty() || name.len() > 64 || !name.chars().all(fits) {
            let message =
                format!("{name:?} is not a name of 1 to 64 letters, digits, '-', '_' or '.'");
            self.report(&format!("{path}.name"), message);
        } else if before.names().any(|other| other == name) {
            self.report(&format!("{path}.name"), format!("the name {name:?} is used above"));
        }
    }

    fn webhook(
        &mut self,
        path: &str,
        raw: raw::Webhook,
        machines: &[MachineConfig],
    ) -> Option<Webhook> {
        let name = self.required(path, "name", raw.name);
        let url = self.required(path, "url", raw.url);
        let endpoint = url.and_then(|url| {
            let endpoint = Endpoint::parse(&url, raw.plain_http.unwrap_or(false));
            endpoint.map_err(|message| self.report(&format!("{path}.url"), message)).ok()
        });
        let secret = match (raw.secret, raw.secret_file) {
            (Some(_), Some(_)) => {
                let message = "secret and secret_file are both set, one is allowed".to_owned();
                self.report(&format!("{path}.secret_file"), message);
                None
            }
            (Some(text), None) => self.key(&format!("{path}.secret"), &text),
            (None, Some(file)) => {
                let place = format!("{path}.secret_file");
                self.secret_text(&place, &file).and_then(|text| self.key(&place, text.trim()))
            }
            (None, None) => None,
        };
        let mut headers = self.headers(&format!("{path}.headers"), &raw.headers);
        if let Some(file) = raw.headers_file {
            let place = format!("{path}.headers_file");
            let text = self.secret_text(&place, &file).unwrap_or_default();
            let lines: Vec<String> =
                text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect();
            headers.extend(self.headers(&place, &lines));
        }
        let filter = self.filter(path, (raw.machines, raw.levels, raw.transitions), machines);
        Some(Webhook {
            name: name?,
            endpoint: endpoint?,
            secret,
            headers,
            ca_file: self.ca_file(path, raw.ca_file),
            filter,
            timeout_s: raw.timeout_s.unwrap_or(TIMEOUT_S),
            backoff: backoff(raw.max_backoff_s),
            max_waiting: raw.max_waiting.unwrap_or(MAX_WAITING),
        })
    }

    fn broker(&mut self, path: &str, raw: raw::Mqtt, machines: &[MachineConfig]) -> Option<Broker> {
        let name = self.required(path, "name", raw.name);
        let prefix = raw.prefix.unwrap_or_else(|| "rotorwatch".to_owned());
        if prefix.trim_matches('/').is_empty()
            || prefix.contains(['+', '#', '\0'])
            || prefix.starts_with('$')
        {
            let message =
                format!("{prefix:?} cannot begin a topic: no '+', '#' or leading '$', not empty");
            self.report(&format!("{path}.prefix"), message);
        }
        let filter = self.filter(path, (raw.machines, raw.levels, raw.transitions), machines);
        let client_id = raw.client_id.or_else(|| Some(format!("rotorwatch-{}", name.as_ref()?)));
        let reached = raw::Reached {
            host: raw.host,
            port: raw.port,
            tls: raw.tls,
            ca_file: raw.ca_file,
            client_id,
            user: raw.user,
            password_file: raw.password_file,
        };
        let connection = self.connection(path, reached);
        Some(Broker {
            name: name?,
            connection: connection?,
            prefix,
            filter,
            backoff: backoff(raw.max_backoff_s),
            max_waiting: raw.max_waiting.unwrap_or(MAX_WAITING),
        })
    }

    /// How a broker is reached.
    pub(super) fn connection(&mut self, path: &str, raw: raw::Reached) -> Option<Connection> {
        let host = self.required(path, "host", raw.host);
        let tls = raw.tls.unwrap_or(false);
        let credentials = match (raw.user, raw.password_file) {
            (None, None) => None,
            (Some(user), None) => Some((user, Secret::new(""))),
            (Some(user), Some(file)) => {
                let text = self.secret_text(&format!("{path}.password_file"), &file);
                text.map(|text| (user, Secret::new(text.trim_end_matches(['\r', '\n']))))
            }
            (None, Some(_)) => {
                let message = "a password needs a user".to_owned();
                self.report(&format!("{path}.password_file"), message);
                None
            }
        };
        let ca_file = self.ca_file(path, raw.ca_file);
        let port = raw.port.unwrap_or(if tls { PORT_TLS } else { PORT });
        Some(Connection { host: host?, port, tls, ca_file, client_id: raw.client_id?, credentials })
    }

    fn key(&mut self, place: &str, text: &str) -> Option<Secret> {
        signature::read_key(text).map_err(|why| self.report(place, why.to_owned())).ok()
    }

    /// Reads a file of secrets; a message names the file alone.
    fn secret_text(&mut self, place: &str, name: &str) -> Option<String> {
        let file = self.base.join(name);
        let too_long = fs::metadata(&file).is_ok_and(|file| file.len() > MAX_FILE_BYTES);
        let text = if too_long { None } else { self.read(&file).ok() };
        if text.is_none() {
            let message = format!(
                "{} cannot be read as text of at most {MAX_FILE_BYTES} bytes",
                file.display()
            );
            self.report(place, message);
        }
        text
    }

    fn ca_file(&mut self, path: &str, name: Option<String>) -> Option<PathBuf> {
        let file = self.base.join(name?);
        if !file.is_file() {
            self.report(&format!("{path}.ca_file"), format!("there is no file {}", file.display()));
        }
        Some(file)
    }

    /// Headers written as `Name: value`; a message says the number, never the text.
    fn headers(&mut self, place: &str, lines: &[String]) -> Vec<(String, Secret)> {
        let mut headers = Vec::new();
        for (i, line) in lines.iter().enumerate() {
            let found = line.split_once(':').map(|(name, value)| (name.trim(), value.trim()));
            let found = found.filter(|(name, value)| {
                http::HeaderName::try_from(*name).is_ok()
                    && http::HeaderValue::try_from(*value).is_ok()
                    && line.len() <= MAX_CHARS
            });
            match found {
                None => {
                    self.report(
                        place,
                        format!("header {} is not written as \"Name: value\"", i + 1),
                    );
                }
                Some((name, _)) if OWN_HEADERS.contains(&name.to_ascii_lowercase().as_str()) => {
                    self.report(place, format!("the header {name} is set by the program itself"));
                }
                Some((name, value)) => headers.push((name.to_owned(), Secret::new(value))),
            }
        }
        headers
    }

    fn filter(
        &mut self,
        path: &str,
        (ids, levels, transitions): (Vec<String>, Vec<String>, Vec<String>),
        machines: &[MachineConfig],
    ) -> Filter {
        for id in ids.iter().filter(|id| !machines.iter().any(|known| known.machine.id == **id)) {
            let known = machines.iter().map(|entry| entry.machine.id.as_str());
            self.unknown_machine(&format!("{path}.machines"), id, known);
        }
        let known_levels = [Level::Warning, Level::Damaged].map(|level| (level.name(), level));
        let known_kinds = EventKind::ALL.map(|kind| (kind.name(), kind));
        Filter {
            machines: ids,
            levels: self.named(&format!("{path}.levels"), &levels, &known_levels),
            transitions: self.named(&format!("{path}.transitions"), &transitions, &known_kinds),
        }
    }

    fn named<T: Copy>(&mut self, place: &str, texts: &[String], known: &[(&str, T)]) -> Vec<T> {
        let mut found = Vec::new();
        for text in texts {
            match known.iter().find(|(name, _)| name == text) {
                Some((_, value)) => found.push(*value),
                None => {
                    let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
                    self.report(place, format!("{text:?} is none of {}", names.join(", ")));
                }
            }
        }
        found
    }
}

fn backoff(max_s: Option<f64>) -> Backoff {
    let default = Backoff::default();
    Backoff { max_s: max_s.unwrap_or(default.max_s), ..default }
}
