//! Process values of a broker of MQTT: a thread that subscribes, and is one more sender of its machine.
//!
//! What comes is placed, counted and judged as what senders send; a broker that is away is a sender that is away.

use super::Hub;
use super::Port;
use super::Seat;
use super::port::Became;
use crate::app::broker;
use crate::app::client::ClientError;
use crate::app::stop::Stop;
use crate::causes::with_causes;
use crate::config::Subscription;
use crate::ingest::live::Refusal;
use crate::ingest::live::pace::Pace;
use crate::signal::Timestamp;
use crate::wire;
use crate::wire::Block;
use crate::wire::Channel;
use crate::wire::ErrorCode;
use crate::wire::Hello;
use crate::wire::SampleType;
use crate::wire::Samples;
use rumqttc::AsyncClient;
use rumqttc::Event;
use rumqttc::EventLoop;
use rumqttc::Incoming;
use rumqttc::QoS;
use rumqttc::Transport;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for a message before the clock is looked at.
const POLL: Duration = Duration::from_millis(100);

/// Wait for room in the queue.
const WAIT: Duration = Duration::from_millis(5);

/// First and longest wait before a broker that was lost is tried again.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(30));

/// Requests that wait for the connection: subscriptions and acknowledgements.
const CAPACITY: usize = 512;

/// Credit of a block that waits for room, as everything that a broker gives.
const FRAME_BYTES: usize = 64;

/// What a message says.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Value {
    /// NaN: that there is none.
    value: f64,
    /// When it was taken; `None`: when it came.
    at: Option<Timestamp>,
}

/// Asks one broker.
pub(in crate::app) struct Listener {
    subscription: Subscription,
    transport: Transport,
    feed: Feed,
}

/// The sender that a broker is.
struct Feed {
    hub: Arc<Hub>,
    port: Arc<Port>,
    hello: Hello,
    /// As people know it.
    peer: String,
    topics: Vec<String>,
    paces: Vec<Pace>,
    seat: Option<Seat>,
}

impl Listener {
    /// A listener to a broker of a machine.
    ///
    /// # Errors
    /// When the certificates cannot be read.
    pub(in crate::app) fn new(
        hub: &Arc<Hub>,
        port: &Arc<Port>,
        subscription: &Subscription,
    ) -> Result<Self, ClientError> {
        let transport = broker::transport(&subscription.connection)?;
        let feed = Feed::new(Arc::clone(hub), Arc::clone(port), subscription);
        Ok(Self { subscription: subscription.clone(), transport, feed })
    }

    /// Listens until the stop, and comes back to a broker that was lost.
    pub(in crate::app) fn run(mut self, stop: &Stop) {
        let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
            Ok(runtime) => runtime,
            Err(error) => {
                let (machine, error) = (self.feed.port.machine(), with_causes(&error));
                tracing::error!(machine, error, "no values are taken from a broker");
                return;
            }
        };
        let mut wait = BACK_OFF.0;
        loop {
            let mut was_there = false;
            let ended = runtime.block_on(self.session(stop, &mut was_there));
            self.feed.leave();
            let Err(why) = ended else { return };
            let (machine, broker) = (self.feed.port.machine(), &self.feed.peer);
            tracing::warn!(machine, broker, why, "no values come from a broker; it is tried again");
            wait = if was_there { BACK_OFF.0 } else { (2 * wait).min(BACK_OFF.1) };
            if stop.wait_until(crate::app::now() + wait) {
                return;
            }
        }
    }

    /// One connection from its beginning to its end, or to the stop.
    async fn session(&mut self, stop: &Stop, was_there: &mut bool) -> Result<(), String> {
        let options = broker::options(&self.subscription.connection, self.transport.clone());
        let (client, mut connection) = AsyncClient::builder(options).capacity(CAPACITY).build();
        connection.network_options.set_connection_timeout(broker::CONNECT_S);
        loop {
            let Some(event) = next(&mut connection, stop, &self.feed).await? else { return Ok(()) };
            match event {
                Event::Incoming(Incoming::ConnAck(_)) => {
                    // The channels first: what is retained comes with the subscription.
                    self.feed.greet(stop).map_err(|refusal| refusal.to_string())?;
                    *was_there = true;
                    for topic in &self.feed.topics {
                        let asked = client.try_subscribe(topic.clone(), QoS::AtLeastOnce);
                        asked.map_err(|error| with_causes(&error))?;
                    }
                    let (machine, broker) = (self.feed.port.machine(), &self.feed.peer);
                    tracing::info!(machine, broker, "values come from a broker");
                }
                Event::Incoming(Incoming::Publish(publish)) => {
                    let topic = String::from_utf8_lossy(&publish.topic).into_owned();
                    self.feed.take(&topic, &publish.payload, publish.retain, stop)?;
                }
                Event::Incoming(_) | Event::Outgoing(_) => {}
            }
        }
    }
}

/// The next thing that happens on a connection; `None`: the daemon ends.
async fn next(
    connection: &mut EventLoop,
    stop: &Stop,
    feed: &Feed,
) -> Result<Option<Event>, String> {
    // Kept over the looks at the clock: what has begun to connect or to read is not begun anew.
    let mut event = pin!(connection.poll());
    loop {
        match tokio::time::timeout(POLL, event.as_mut()).await {
            Ok(event) => return event.map(Some).map_err(|error| broker::why(&error).to_owned()),
            Err(_) if stop.is_set() => return Ok(None),
            Err(_) => feed.port.tick(),
        }
    }
}

impl Feed {
    fn new(hub: Arc<Hub>, port: Arc<Port>, subscription: &Subscription) -> Self {
        let rate_hz = subscription.rate.0;
        let channel =
            |(name, _): &(String, String)| Channel::new(name, rate_hz, SampleType::F64, "");
        let at = &subscription.connection;
        let epoch = crate::app::wall_clock().0.cast_unsigned();
        let channels = subscription.topics.iter().map(channel).collect();
        let hello = Hello::new(port.machine(), epoch, channels);
        Self {
            hub,
            port,
            hello,
            peer: format!("mqtt://{}:{}", at.host, at.port),
            topics: subscription.topics.iter().map(|(_, topic)| topic.clone()).collect(),
            paces: vec![Pace::new(rate_hz); subscription.topics.len()],
            seat: None,
        }
    }

    /// Has the channels let in; they go on where they were.
    fn greet(&mut self, stop: &Stop) -> Result<(), Refusal> {
        let seat =
            self.hub.enter().inspect_err(|refusal| self.hub.note_refusal(&self.peer, refusal))?;
        loop {
            let arrived = self.hub.clock.arrived();
            let admitted = self.port.hello(seat.session, (&self.peer, arrived), &self.hello);
            let admitted =
                admitted.inspect_err(|refusal| self.hub.note_refusal(&self.peer, refusal))?;
            if admitted.is_some() {
                self.seat = Some(seat);
                return Ok(());
            }
            if stop.wait_until(crate::app::now() + WAIT) {
                return Err(super::port::stopping());
            }
        }
    }

    /// Takes a message in; what cannot be used is counted by its reason. An error: the channels are lost.
    fn take(
        &mut self,
        topic: &str,
        payload: &[u8],
        is_retained: bool,
        stop: &Stop,
    ) -> Result<(), String> {
        let Some(place) = self.topics.iter().position(|known| known == topic) else {
            return Ok(());
        };
        let taken = value_of(payload).and_then(|value| match value.at {
            None if is_retained => {
                let text = "a retained value without its time \"t\" may be of any age: publish it with one";
                Err(Refusal::new(ErrorCode::Malformed, text))
            }
            at => Ok((value.value, at)),
        });
        let arrived = self.hub.clock.arrived();
        let taken = taken.and_then(|(value, at)| {
            let at = at.unwrap_or(arrived.0);
            // A time of the future would make all that come after it late: looked at before it takes a place.
            crate::ingest::live::check_ahead(at, arrived)?;
            self.hand_on(place, value, at, stop)
        });
        match taken {
            Ok(()) => Ok(()),
            Err(refusal) => {
                self.hub.note_refusal(&format!("{} {topic}", self.peer), &refusal);
                let is_lost = matches!(
                    refusal.code,
                    ErrorCode::ChannelTaken | ErrorCode::Unexpected | ErrorCode::Stopping
                );
                if is_lost { Err(refusal.to_string()) } else { Ok(()) }
            }
        }
    }

    /// Hands a value on as a block of its own.
    fn hand_on(
        &mut self,
        place: usize,
        value: f64,
        at: Timestamp,
        stop: &Stop,
    ) -> Result<(), Refusal> {
        let Some(session) = self.seat.as_ref().map(|seat| seat.session) else { return Ok(()) };
        let index = self.paces[place].place(at);
        let bytes = value.to_le_bytes();
        let Some(samples) = Samples::new(SampleType::F64, &bytes) else { return Ok(()) };
        let stream = u16::try_from(place).unwrap_or(u16::MAX);
        let block = Block { stream, sequence: index, first: index, time_ns: at.0, samples };
        loop {
            let arrived = self.hub.clock.arrived();
            match self.port.block(session, (&block, FRAME_BYTES), arrived, true)? {
                Became::Settled(_) => return Ok(()),
                Became::Wait => {
                    if stop.wait_until(crate::app::now() + WAIT) {
                        return Err(super::port::stopping());
                    }
                }
            }
        }
    }

    /// Gives the channels up, if it has them.
    fn leave(&mut self) {
        if let Some(seat) = self.seat.take() {
            self.port.leave(seat.session, false);
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.leave();
    }
}

/// Reads a number, or an object with `value` and the time `t`: RFC 3339, or seconds since 1970. `null` is a value that is
/// not there.
fn value_of(payload: &[u8]) -> Result<Value, Refusal> {
    use serde_json::Value as Json;
    let wrong =
        |what: &str| Refusal::new(ErrorCode::Malformed, format!("a message of a broker {what}"));
    let number = |json: &Json| if json.is_null() { Some(f64::NAN) } else { json.as_f64() };
    let json: Json = serde_json::from_slice(payload).map_err(|_| {
        wrong("is no JSON: a number, or {\"t\": time, \"value\": number}, is taken")
    })?;
    let Json::Object(fields) = &json else {
        let value = number(&json).ok_or_else(|| wrong("is neither a number nor an object"))?;
        return Ok(Value { value, at: None });
    };
    let value = fields.get("value").and_then(number);
    let value = value.ok_or_else(|| wrong("has no number \"value\""))?;
    let at = match fields.get("t") {
        None => None,
        Some(Json::String(text)) => text.parse().ok().map(|at: jiff::Timestamp| at.as_nanosecond()),
        // The fraction apart: a time in ns has more digits than a float.
        #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
        Some(json) => json.as_f64().map(|seconds| {
            let whole = (seconds.floor() as i128).saturating_mul(1_000_000_000);
            whole.saturating_add((seconds.fract().rem_euclid(1.0) * 1e9).round() as i128)
        }),
    };
    let at = match (fields.contains_key("t"), at.map(i64::try_from)) {
        (false, _) => None,
        (true, Some(Ok(ns))) if ns != wire::NO_TIME => Some(Timestamp(ns)),
        (true, _) => {
            return Err(wrong("has a \"t\" that is neither RFC 3339 nor seconds since 1970"));
        }
    };
    Ok(Value { value, at })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_a_number_or_one_with_its_time() {
        let read = |text: &str| value_of(text.as_bytes());
        assert_eq!(read("12.5"), Ok(Value { value: 12.5, at: None }));
        assert_eq!(read(" -3 "), Ok(Value { value: -3.0, at: None }));
        let at = Some(Timestamp(1_700_000_000_250_000_000));
        assert_eq!(read("{\"t\": 1700000000.25, \"value\": 1e3}"), Ok(Value { value: 1000.0, at }));
        let text = "{\"value\": 7, \"t\": \"2023-11-14T22:13:20.25Z\", \"quality\": \"good\"}";
        assert_eq!(read(text), Ok(Value { value: 7.0, at }));
        assert!(read("null").is_ok_and(|v| v.value.is_nan()));
        for wrong in [
            "",
            "on",
            "[1]",
            "\"3\"",
            "{}",
            "{\"value\": \"3\"}",
            "{\"value\": 1, \"t\": \"noon\"}",
            "1 2",
        ] {
            assert_eq!(read(wrong).unwrap_err().code, ErrorCode::Malformed, "{wrong}");
        }
        assert_eq!(read("{\"value\": 1, \"t\": 1e300}").unwrap_err().code, ErrorCode::Malformed);
    }
}
