//! Every key of the configuration with what it may hold: the one table that the reader, the error
//! messages, the environment and the reference are checked against.

/// What a key may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A string.
    Text,
    /// A list of strings.
    Texts,
    /// `true` or `false`.
    Flag,
    /// A whole number in a range, both ends allowed.
    Whole(u64, u64),
    /// A number in a range, both ends allowed.
    Number(f64, f64),
    /// A number above 0, or `"max"`.
    Speed,
}

/// One key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Section it stands in.
    pub section: &'static str,
    /// Its name.
    pub name: &'static str,
    /// What it may hold.
    pub kind: Kind,
}

/// Sections that stand once; one with a point stands inside another.
pub const SECTIONS: &[&str] = &[
    "server",
    "server.tls",
    "ingest",
    "store",
    "recording",
    "captures",
    "pipeline",
    "diagnosis",
    "alarms",
    "log",
];

/// Sections that may be repeated, as `[[machine]]`; one with a point stands below a section of its own.
pub const LISTS: &[&str] = &["machine", "source", "notify.webhook", "notify.mqtt"];

/// Most bytes a limit may state: 2⁵³, beyond which a number in JSON is no longer exact.
const MAX_BYTES: u64 = 1 << 53;

/// Every key.
pub const KEYS: &[Key] = &[
    key("server", "bind", Kind::Text),
    key("server", "token_file", Kind::Text),
    key("server", "hosts", Kind::Texts),
    key("server", "cors_origins", Kind::Texts),
    key("server", "max_requests_per_s", Kind::Number(1.0, 1e6)),
    key("server", "max_connections", Kind::Whole(8, 65_536)),
    key("server", "max_event_streams", Kind::Whole(1, 65_536)),
    key("server.tls", "cert_file", Kind::Text),
    key("server.tls", "key_file", Kind::Text),
    key("server.tls", "ingest", Kind::Flag),
    key("ingest", "bind", Kind::Text),
    key("ingest", "max_connections", Kind::Whole(1, 4096)),
    key("store", "directory", Kind::Text),
    key("store", "max_bytes", Kind::Whole(1_000_000, MAX_BYTES)),
    key("store", "trend_days", Kind::Whole(1, 36_500)),
    key("store", "trend_1min_days", Kind::Whole(1, 36_500)),
    key("store", "trend_1h_days", Kind::Whole(1, 36_500)),
    key("recording", "enabled", Kind::Flag),
    key("recording", "segment_seconds", Kind::Number(1.0, 86_400.0)),
    key("recording", "segment_bytes", Kind::Whole(100_000, MAX_BYTES)),
    key("recording", "flush_seconds", Kind::Number(0.05, 60.0)),
    key("recording", "compression", Kind::Whole(0, 9)),
    key("captures", "enabled", Kind::Flag),
    key("captures", "seconds_before", Kind::Number(1.0, 3_600.0)),
    key("captures", "seconds_after", Kind::Number(0.0, 600.0)),
    key("captures", "most_per_hour", Kind::Whole(1, 1_000)),
    key("captures", "max_bytes", Kind::Whole(100_000, MAX_BYTES)),
    key("pipeline", "workers", Kind::Whole(0, 256)),
    key("pipeline", "ring_seconds", Kind::Number(1.0, 3_600.0)),
    key("pipeline", "memory_limit_bytes", Kind::Whole(1_000_000, MAX_BYTES)),
    key("pipeline", "window_seconds", Kind::Number(1.0, 600.0)),
    key("pipeline", "hop_seconds", Kind::Number(0.5, 600.0)),
    key("pipeline", "lengthen_windows", Kind::Flag),
    key("diagnosis", "false_alarms_per_component_year", Kind::Number(1e-6, 1e6)),
    key("alarms", "on_delay_s", Kind::Number(0.0, 86_400.0)),
    key("alarms", "off_delay_s", Kind::Number(0.0, 86_400.0)),
    key("alarms", "history_len", Kind::Whole(1, 100_000)),
    key("alarms", "missing_after_s", Kind::Number(0.5, 86_400.0)),
    key("alarms", "max_shelving_s", Kind::Number(1.0, 31_536_000.0)),
    key("log", "level", Kind::Text),
    key("machine", "file", Kind::Text),
    key("machine", "baseline", Kind::Texts),
    key("source", "kind", Kind::Text),
    key("source", "machine", Kind::Text),
    key("source", "file", Kind::Text),
    key("source", "speed", Kind::Speed),
    key("source", "loop", Kind::Flag),
    key("source", "rate_hz", Kind::Number(1e-6, 1e9)),
    key("source", "unit", Kind::Text),
    key("source", "scene", Kind::Text),
    key("source", "scenario", Kind::Text),
    key("source", "seed", Kind::Whole(0, 1 << 53)),
    key("source", "host", Kind::Text),
    key("source", "port", Kind::Whole(1, 65_535)),
    key("source", "tls", Kind::Flag),
    key("source", "ca_file", Kind::Text),
    key("source", "client_id", Kind::Text),
    key("source", "user", Kind::Text),
    key("source", "password_file", Kind::Text),
    key("source", "topics", Kind::Texts),
    key("notify.webhook", "name", Kind::Text),
    key("notify.webhook", "url", Kind::Text),
    key("notify.webhook", "plain_http", Kind::Flag),
    key("notify.webhook", "secret", Kind::Text),
    key("notify.webhook", "secret_file", Kind::Text),
    key("notify.webhook", "headers", Kind::Texts),
    key("notify.webhook", "headers_file", Kind::Text),
    key("notify.webhook", "ca_file", Kind::Text),
    key("notify.webhook", "machines", Kind::Texts),
    key("notify.webhook", "levels", Kind::Texts),
    key("notify.webhook", "transitions", Kind::Texts),
    key("notify.webhook", "timeout_s", Kind::Number(0.1, 60.0)),
    key("notify.webhook", "max_backoff_s", Kind::Number(1.0, 3_600.0)),
    key("notify.webhook", "max_waiting", Kind::Whole(1, 100_000)),
    key("notify.mqtt", "name", Kind::Text),
    key("notify.mqtt", "host", Kind::Text),
    key("notify.mqtt", "port", Kind::Whole(1, 65_535)),
    key("notify.mqtt", "tls", Kind::Flag),
    key("notify.mqtt", "ca_file", Kind::Text),
    key("notify.mqtt", "client_id", Kind::Text),
    key("notify.mqtt", "user", Kind::Text),
    key("notify.mqtt", "password_file", Kind::Text),
    key("notify.mqtt", "prefix", Kind::Text),
    key("notify.mqtt", "machines", Kind::Texts),
    key("notify.mqtt", "levels", Kind::Texts),
    key("notify.mqtt", "transitions", Kind::Texts),
    key("notify.mqtt", "max_backoff_s", Kind::Number(1.0, 3_600.0)),
    key("notify.mqtt", "max_waiting", Kind::Whole(1, 100_000)),
];

const fn key(section: &'static str, name: &'static str, kind: Kind) -> Key {
    Key { section, name, kind }
}

/// Finds a key.
#[must_use]
pub fn find(section: &str, name: &str) -> Option<&'static Key> {
    KEYS.iter().find(|key| key.section == section && key.name == name)
}

/// What to do about a key that was one once.
#[must_use]
pub fn moved(section: &str, name: &str) -> Option<&'static str> {
    ((section, name) == ("ingest", "token_file")).then_some(
        "senders have the tokens of everybody now: `rotorwatch token create --role ingest`, and name their file in \
         server.token_file",
    )
}

/// Names of a section's keys, for messages.
#[must_use]
pub fn names_of(section: &str) -> String {
    let names: Vec<_> =
        KEYS.iter().filter(|key| key.section == section).map(|key| key.name).collect();
    names.join(", ")
}

impl Key {
    /// Environment variable that overrides the key; `None` inside the repeated sections.
    #[must_use]
    pub fn variable(&self) -> Option<String> {
        SECTIONS
            .contains(&self.section)
            .then(|| format!("ROTORWATCH__{}__{}", self.section, self.name))
            .map(|name| name.replace('.', "__").to_uppercase())
    }

    /// Checks a value read from the file.
    ///
    /// # Errors
    /// What is allowed and what was found, as one clause.
    pub fn check(&self, value: &toml::Value) -> Result<(), String> {
        let fits = match self.kind {
            Kind::Text => value.is_str(),
            Kind::Flag => value.is_bool(),
            Kind::Texts => value.as_array().is_some_and(|list| list.iter().all(|v| v.is_str())),
            Kind::Whole(low, high) => value
                .as_integer()
                .and_then(|n| u64::try_from(n).ok())
                .is_some_and(|n| (low..=high).contains(&n)),
            Kind::Number(low, high) => number(value).is_some_and(|x| (low..=high).contains(&x)),
            Kind::Speed => {
                value.as_str() == Some("max")
                    || number(value).is_some_and(|x| x > 0.0 && x.is_finite())
            }
        };
        match (fits, self.is_secret()) {
            (true, _) => Ok(()),
            (false, true) => Err(format!("the value is not {}", self.allowed())),
            (false, false) => Err(format!("{value} is not {}", self.allowed())),
        }
    }

    /// Whether a message must not say what the key holds.
    #[must_use]
    pub fn is_secret(&self) -> bool {
        matches!(self.name, "secret" | "headers" | "url")
    }

    /// Checks a value read from the environment.
    ///
    /// # Errors
    /// What is allowed and what was found, as one clause.
    pub fn check_text(&self, text: &str) -> Result<(), String> {
        let value = match self.kind {
            // A list is a text with commas there.
            Kind::Texts => return Ok(()),
            Kind::Text | Kind::Speed => None,
            Kind::Flag => text.parse().ok().map(toml::Value::Boolean),
            Kind::Whole(..) => text.parse().ok().map(toml::Value::Integer),
            Kind::Number(..) => text.parse().ok().map(toml::Value::Float),
        };
        self.check(&value.unwrap_or_else(|| toml::Value::String(text.to_owned())))
    }

    /// What the key may hold, for messages.
    #[must_use]
    pub fn allowed(&self) -> String {
        match self.kind {
            Kind::Text => "a string".to_owned(),
            Kind::Texts => "a list of strings".to_owned(),
            Kind::Flag => "true or false".to_owned(),
            Kind::Whole(low, high) => format!("a whole number from {low} to {high}"),
            Kind::Number(low, high) => format!("a number from {low} to {high}"),
            Kind::Speed => "\"max\" or a number above 0".to_owned(),
        }
    }
}

/// A number, written with or without a decimal point.
fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|n| n as f64))
}
