//! Sources of samples from a network: senders that connect, and brokers that are asked for process values.

use super::SourceConfig;
use super::raw;
use super::resolve::Resolver;
use crate::notify::settings::Connection;
use crate::units::Hz;

/// Topics of one source, at most.
const MAX_TOPICS: usize = 256;

/// Values a second of a topic, at most: MQTT is for what changes slowly.
const MAX_RATE_HZ: f64 = 100.0;

/// Fewest values a second of a topic.
const MIN_RATE_HZ: f64 = 1e-3;

/// Brokers of one machine, at most: each has a thread.
const MAX_BROKERS: usize = 16;

/// From where a machine's samples come over a network.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Live {
    /// Whether senders may connect, over TCP or a WebSocket.
    pub listens: bool,
    /// What brokers are asked for.
    pub brokers: Vec<Subscription>,
}

/// Values that a broker is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Subscription {
    /// How it is reached.
    pub connection: Connection,
    /// Channels and their topics.
    pub topics: Vec<(String, String)>,
    /// Values a second of each.
    pub rate: Hz,
}

impl Live {
    /// Whether senders may connect, and no broker is asked.
    #[must_use]
    pub fn listening() -> Self {
        Self { listens: true, brokers: Vec::new() }
    }
}

impl Resolver<'_> {
    /// Adds another source of a machine to the one there is; `None`: one that was reported.
    pub(super) fn join(
        &mut self,
        path: &str,
        there: &mut Option<SourceConfig>,
        other: Option<SourceConfig>,
    ) {
        match (there, other) {
            (Some(SourceConfig::Live(one)), Some(SourceConfig::Live(two)))
                if !(one.listens && two.listens)
                    && one.brokers.len() + two.brokers.len() <= MAX_BROKERS =>
            {
                one.listens |= two.listens;
                one.brokers.extend(two.brokers);
            }
            (Some(_), Some(_)) => {
                let message = format!(
                    "the machine already has a source: one of the kind \"tcp\" and {MAX_BROKERS} of the kind \"mqtt\" may \
                     stand together, else one is allowed"
                );
                self.report(&format!("{path}.machine"), message);
            }
            (None, _) | (_, None) => {}
        }
    }

    /// A source of the kind `mqtt`.
    pub(super) fn subscription(&mut self, path: &str, raw: raw::Source) -> Option<SourceConfig> {
        let rate_hz = self.required(path, "rate_hz", raw.rate_hz);
        if rate_hz.is_some_and(|rate| !(MIN_RATE_HZ..=MAX_RATE_HZ).contains(&rate)) {
            let message = format!(
                "a topic gives {MIN_RATE_HZ} to {MAX_RATE_HZ} values a second: what is faster is sent over TCP (docs/wire.md)"
            );
            self.report(&format!("{path}.rate_hz"), message);
        }
        let topics = self.topics(&format!("{path}.topics"), &raw.topics);
        let machine = raw.machine.unwrap_or_default();
        let reached = raw::Reached {
            host: raw.host,
            port: raw.port,
            tls: raw.tls,
            ca_file: raw.ca_file,
            client_id: Some(
                raw.client_id.unwrap_or_else(|| format!("rotorwatch-{machine}-{path}")),
            ),
            user: raw.user,
            password_file: raw.password_file,
        };
        let connection = self.connection(path, reached)?;
        let subscription = Subscription { connection, topics, rate: Hz(rate_hz?) };
        Some(SourceConfig::Live(Live { listens: false, brokers: vec![subscription] }))
    }

    /// Reads `channel: topic` lines.
    fn topics(&mut self, place: &str, lines: &[String]) -> Vec<(String, String)> {
        if lines.is_empty() || lines.len() > MAX_TOPICS {
            let message = format!("{} are given, 1 to {MAX_TOPICS} are needed", lines.len());
            self.report(place, message);
        }
        let mut topics: Vec<(String, String)> = Vec::new();
        for line in lines {
            let parts = line.split_once(':').map(|(channel, topic)| (channel.trim(), topic.trim()));
            let Some((channel, topic)) = parts.filter(|(c, t)| !c.is_empty() && is_topic(t)) else {
                let message = format!(
                    "{line:?} is not of the form \"channel: topic\", the topic without '+' and '#'"
                );
                self.report(place, message);
                continue;
            };
            if topics.iter().any(|(c, t)| c == channel || t == topic) {
                self.report(place, format!("{line:?} has a channel or topic of a line before it"));
                continue;
            }
            topics.push((channel.to_owned(), topic.to_owned()));
        }
        topics
    }
}

/// Whether a text is one topic and no filter.
fn is_topic(text: &str) -> bool {
    !text.is_empty() && text.len() <= 1024 && !text.contains(['+', '#', '\0'])
}
