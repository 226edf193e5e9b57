//! A webhook: a thread that posts.

use super::carrier::Due;
use super::carrier::Follower;
use crate::api::wire::events::HappenedWire;
use crate::app::Clock;
use crate::app::client;
use crate::app::client::ClientError;
use crate::notify::Answer;
use crate::notify::settings::Webhook;
use crate::notify::signature;
use crate::signal::Timestamp;
use crate::store::events::LogEntry;
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use ureq::Agent;

/// Most of an answer's body that is read; it is not looked at.
const MAX_ANSWER_BYTES: u64 = 64 * 1024;

/// Posts to one webhook.
pub(super) struct Sender {
    post: Post,
    follower: Follower,
    stored: watch::Receiver<u64>,
    clock: Clock,
}

/// What a post needs.
struct Post {
    settings: Webhook,
    agent: Agent,
}

/// What posts to a webhook.
pub(super) fn agent(settings: &Webhook) -> Result<Agent, ClientError> {
    let encrypts = settings.endpoint.encrypts();
    client::agent(encrypts, settings.ca_file.as_deref(), settings.timeout_s)
}

impl Sender {
    pub(super) fn new(
        settings: Webhook,
        follower: Follower,
        stored: watch::Receiver<u64>,
        clock: Clock,
    ) -> Result<Self, ClientError> {
        let agent = agent(&settings)?;
        Ok(Self { post: Post { settings, agent }, follower, stored, clock })
    }

    /// Posts until the stop; an attempt under way then is waited for.
    pub(super) fn run(self, runtime: &Handle, stop: &CancellationToken) {
        let Self { post, mut follower, mut stored, clock } = self;
        let now = || {
            let moment = clock.moment(0.0);
            (moment.monotonic_s, moment.utc)
        };
        loop {
            stored.mark_unchanged();
            let due = follower.carry(
                &now,
                &mut |entry| post.send(entry, now().1),
                &mut rand::random::<f64>,
                &|| stop.is_cancelled(),
            );
            if stop.is_cancelled() {
                follower.keep(true);
                return;
            }
            let until = match due {
                Due::Stored => Duration::MAX,
                Due::At(at_s) => Duration::try_from_secs_f64(at_s - now().0).unwrap_or_default(),
            };
            let is_over = runtime.block_on(async {
                tokio::select! {
                    () = stop.cancelled() => true,
                    changed = stored.changed() => changed.is_err(),
                    () = tokio::time::sleep(until) => false,
                }
            });
            if is_over {
                follower.keep(true);
                return;
            }
        }
    }
}

impl Post {
    /// Posts one transition at `utc`.
    fn send(&self, entry: &LogEntry, utc: Timestamp) -> Answer {
        let message = HappenedWire::new(entry);
        let HappenedWire::Alarm(transition) = &message else {
            return Answer::Status(204, None);
        };
        let Ok(body) = message.text() else {
            return Answer::Failed("the event has no JSON form".to_owned());
        };
        let id = &transition.id;
        let timestamp_s = utc.0.div_euclid(1_000_000_000);
        let mut request = self
            .agent
            .post(self.settings.endpoint.uri())
            .header("content-type", "application/json")
            .header("webhook-id", header_text(id))
            .header("webhook-timestamp", timestamp_s.to_string());
        if let Some(key) = &self.settings.secret {
            let signature = signature::sign(key, &header_text(id), timestamp_s, &body);
            request = request.header("webhook-signature", signature);
        }
        for (name, value) in &self.settings.headers {
            request = request.header(name, value.reveal());
        }
        match request.send(body.as_bytes()) {
            Ok(mut response) => {
                let status = response.status().as_u16();
                let asked = response.headers().get("retry-after");
                let asked_s = asked.and_then(|value| value.to_str().ok()?.trim().parse().ok());
                // Read, so that the connection can be used again.
                let read = response.body_mut().with_config().limit(MAX_ANSWER_BYTES).read_to_vec();
                drop(read);
                Answer::Status(status, asked_s)
            }
            Err(error) => Answer::Failed(client::why(&error).to_owned()),
        }
    }
}

/// An id as a header can hold it: machine ids may be any text.
fn header_text(id: &str) -> String {
    let mut text = String::with_capacity(id.len());
    for byte in id.bytes() {
        if byte.is_ascii_graphic() && byte != b'%' {
            text.push(char::from(byte));
        } else {
            text.push_str(&format!("%{byte:02X}"));
        }
    }
    text
}
