//! A broker of MQTT: a task that keeps retained topics as things stand and publishes transitions.
//!
//! Everything has quality of service 1. A transition is settled when the broker has acknowledged it. A session
//! that breaks is thrown away and begun anew: states are published again as they stand, transitions from
//! the one that was not acknowledged.

use super::carrier::Due;
use super::carrier::Follower;
use super::states::Retained;
use super::states::States;
use crate::api::handles::MachineHandle;
use crate::api::wire::events::HappenedWire;
use crate::app::Clock;
use crate::app::broker;
use crate::app::client::ClientError;
use crate::notify::Answer;
use crate::notify::settings::Broker;
use crate::notify::topics::Topics;
use crate::signal::Timestamp;
use rumqttc::AsyncClient;
use rumqttc::Event;
use rumqttc::EventLoop;
use rumqttc::Incoming;
use rumqttc::LastWill;
use rumqttc::MqttOptions;
use rumqttc::PublishOptions;
use rumqttc::QoS;
use rumqttc::Transport;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::sync::watch;
use tokio::task::block_in_place;
use tokio_util::sync::CancellationToken;

/// Requests that wait for the connection.
const CAPACITY: usize = 64;

/// Retained alarms of before that may wait to be looked at.
const MAX_FOUND: usize = 1024;

/// Longest time for an acknowledgement.
const ACKNOWLEDGE: Duration = Duration::from_secs(30);

/// Time between two looks at the states.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Longest time to say goodbye.
const GOODBYE: Duration = Duration::from_millis(800);

/// Whether a session ended because the daemon does.
struct Stopped;

/// Publishes to one broker.
pub(super) struct Publisher {
    settings: Broker,
    transport: Transport,
    topics: Topics,
    follower: Follower,
    stored: watch::Receiver<u64>,
    clock: Clock,
}

impl Publisher {
    pub(super) fn new(
        settings: Broker,
        follower: Follower,
        stored: watch::Receiver<u64>,
        clock: Clock,
    ) -> Result<Self, ClientError> {
        let transport = broker::transport(&settings.connection)?;
        let topics = Topics::new(&settings.prefix);
        Ok(Self { settings, transport, topics, follower, stored, clock })
    }

    fn now(&self) -> (f64, Timestamp) {
        let moment = self.clock.moment(0.0);
        (moment.monotonic_s, moment.utc)
    }

    /// Publishes until the stop.
    pub(super) async fn run(mut self, machines: &[MachineHandle], stop: &CancellationToken) {
        loop {
            let ended = self.session(machines, stop).await;
            let why = match ended {
                Ok(Stopped) => break,
                Err(_) if stop.is_cancelled() => break,
                Err(why) => why,
            };
            self.follower.answered(&Answer::Failed(why), self.now(), rand::random());
            block_in_place(|| {
                if let Err(error) = self.follower.read_on() {
                    tracing::error!(receiver = self.follower.name(), %error, "the events cannot be read");
                }
                self.follower.keep(false);
            });
            let wait_s = self.follower.retry_at_s() - self.now().0;
            let wait = Duration::try_from_secs_f64(wait_s).unwrap_or_default();
            tokio::select! {
                () = stop.cancelled() => break,
                () = tokio::time::sleep(wait) => {}
            }
        }
        block_in_place(|| self.follower.keep(true));
    }

    fn options(&self) -> MqttOptions {
        let mut options = broker::options(&self.settings.connection, self.transport.clone());
        let will = LastWill::new(self.topics.availability(), "offline", QoS::AtLeastOnce, true);
        options.set_last_will(will);
        options
    }

    /// One connection, from its beginning to its end.
    async fn session(
        &mut self,
        machines: &[MachineHandle],
        stop: &CancellationToken,
    ) -> Result<Stopped, String> {
        let (client, mut connection) =
            AsyncClient::builder(self.options()).capacity(CAPACITY).build();
        connection.network_options.set_connection_timeout(broker::CONNECT_S);
        tokio::select! {
            () = stop.cancelled() => return Ok(Stopped),
            connected = connect(&mut connection) => connected?,
        }
        self.follower.connected();
        let (found, finds) = mpsc::channel(MAX_FOUND);
        tokio::select! {
            why = drive(&mut connection, &found) => Err(why),
            ended = self.publish(&client, machines, finds, stop) => ended,
        }
    }

    /// Publishes what stands and what happens until the stop, or until the connection does not do its work.
    async fn publish(
        &mut self,
        client: &AsyncClient,
        machines: &[MachineHandle],
        mut finds: mpsc::Receiver<String>,
        stop: &CancellationToken,
    ) -> Result<Stopped, String> {
        put(client, &self.topics.availability(), "online", true).await?;
        client
            .subscribe(self.topics.all_alarms(), QoS::AtLeastOnce)
            .await
            .map_err(|_| "cannot be subscribed to".to_owned())?;
        let mut states = States::default();
        let mut look_at = tokio::time::interval(LOOK_EVERY);
        look_at.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            self.stored.mark_unchanged();
            let standing = Retained::of(machines, &self.topics).map_err(|_| no_json())?;
            for (topic, payload) in states.due(standing, self.now().0) {
                put(client, &topic, &payload, true).await?;
            }
            let retry_at_s = self.send_events(client).await?;
            let wait_s = (retry_at_s - self.now().0).max(0.0);
            let wait = Duration::try_from_secs_f64(wait_s).unwrap_or(Duration::MAX);
            tokio::select! {
                () = stop.cancelled() => {
                    let goodbye = async {
                        put(client, &self.topics.availability(), "offline", true).await?;
                        client.disconnect().await.map_err(|_| "is gone".to_owned())?;
                        // The connection ends this session when it has said goodbye.
                        std::future::pending::<Result<Stopped, String>>().await
                    };
                    return tokio::time::timeout(GOODBYE, goodbye).await.unwrap_or(Ok(Stopped));
                }
                changed = self.stored.changed() => {
                    // The store ends before the tasks: what it still told is sent.
                    if changed.is_err() {
                        tokio::select! {
                            () = stop.cancelled() => {}
                            () = tokio::time::sleep(LOOK_EVERY) => {}
                        }
                    }
                }
                Some(topic) = finds.recv() => {
                    if states.is_of_nobody(&topic, machines, &self.topics) {
                        put(client, &topic, "", true).await?;
                    }
                }
                _ = look_at.tick() => {}
                () = tokio::time::sleep(wait) => {}
            }
        }
    }

    /// Publishes every transition that is due, in order; gives when to try again, s.
    async fn send_events(&mut self, client: &AsyncClient) -> Result<f64, String> {
        let name = self.follower.name().to_owned();
        let read = block_in_place(|| self.follower.read_on());
        if let Err(error) = read {
            tracing::error!(receiver = name, %error, "the events cannot be read");
            return Ok(self.now().0 + 1.0);
        }
        loop {
            let now_s = self.now().0;
            let entry = match block_in_place(|| self.follower.due(now_s)) {
                Ok(entry) => entry,
                Err(due) => {
                    block_in_place(|| self.follower.keep(false));
                    return Ok(match due {
                        Due::Stored => f64::INFINITY,
                        Due::At(at_s) => at_s,
                    });
                }
            };
            let body = HappenedWire::new(&entry).text().map_err(|_| no_json())?;
            put(client, &self.topics.events(&entry.machine), &body, false).await?;
            self.follower.answered(&Answer::Status(200, None), self.now(), 0.0);
            block_in_place(|| self.follower.keep(false));
        }
    }
}

fn no_json() -> String {
    "a message has no JSON form".to_owned()
}

/// Waits for the broker to accept the connection.
async fn connect(connection: &mut EventLoop) -> Result<(), String> {
    loop {
        match connection.poll().await {
            Ok(Event::Incoming(Incoming::ConnAck(_))) => return Ok(()),
            Ok(_) => {}
            Err(error) => return Err(broker::why(&error).to_owned()),
        }
    }
}

/// Keeps the connection going until it breaks; topics of retained alarms go to `found`.
async fn drive(connection: &mut EventLoop, found: &mpsc::Sender<String>) -> String {
    loop {
        match connection.poll().await {
            Ok(Event::Incoming(Incoming::Publish(publish))) => {
                if publish.retain && !publish.payload.is_empty() {
                    let topic = String::from_utf8_lossy(&publish.topic).into_owned();
                    if found.try_send(topic).is_err() {
                        tracing::warn!(
                            "too many retained alarms of before, some are left at the broker"
                        );
                    }
                }
            }
            Ok(_) => {}
            Err(error) => return broker::why(&error).to_owned(),
        }
    }
}

/// Publishes and waits for the acknowledgement.
async fn put(
    client: &AsyncClient,
    topic: &str,
    payload: &str,
    is_retained: bool,
) -> Result<(), String> {
    let options = PublishOptions::at_least_once().retain(is_retained);
    let sent = client.publish_tracked(topic, payload.to_owned(), options).await;
    let notice = sent.map_err(|_| "does not take a message".to_owned())?;
    match tokio::time::timeout(ACKNOWLEDGE, notice.wait_async()).await {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(_)) => Err("the connection broke".to_owned()),
        Err(_) => Err("does not acknowledge in time".to_owned()),
    }
}
