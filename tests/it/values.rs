//! Process values of a real broker, beside samples over TCP.

use crate::live;
use crate::live::Sender;
use crate::mqtt::{Broker, PASSWORD};
use crate::support;
use crate::support::{Daemon, wait_until};
use rumqttc::{Client, Connection, Event, Incoming, MqttOptions, PublishOptions};
use serde_json::{Value, json};
use std::net::TcpListener;
use std::time::Duration;

/// Values a second of each topic.
const RATE_HZ: u32 = 1;

fn folder(port: u16) -> tempfile::TempDir {
    let machine = format!(
        "{}[[sensor]]\nchannel = \"speed\"\nkind = \"speed\"\nunit = \"Hz\"\nat = {{ shaft = \"main\" }}\n\
         [[sensor]]\nchannel = \"load\"\nkind = \"load\"\n",
        support::MACHINE
    );
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[ingest]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n\
         [[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n[[source]]\nkind = \"mqtt\"\nmachine = \"rig-1\"\n\
         host = \"127.0.0.1\"\nport = {port}\nuser = \"watch\"\npassword_file = \"password\"\nrate_hz = {RATE_HZ}\n\
         topics = [\"speed: plant/rig-1/speed\", \"load: plant/rig-1/load\"]\n"
    );
    support::folder(&config, &[("rig.toml", machine.as_bytes()), ("password", PASSWORD.as_bytes())])
}

/// A PLC that publishes.
struct Plc {
    client: Client,
    connection: Connection,
}

impl Plc {
    fn new(port: u16) -> Self {
        let mut options = MqttOptions::new("plc", ("127.0.0.1", port));
        options.set_credentials("watch", PASSWORD).set_keep_alive(30);
        let (client, connection) = Client::builder(options).capacity(100).build();
        Self { client, connection }
    }

    /// Publishes messages below the machine's topic and waits until the broker has all of them.
    fn publish(&mut self, messages: &[(&str, Value)]) {
        self.publish_as(PublishOptions::at_least_once(), messages);
    }

    fn publish_as(&mut self, options: PublishOptions, messages: &[(&str, Value)]) {
        for (topic, payload) in messages {
            let text = payload.as_str().map_or_else(|| payload.to_string(), str::to_owned);
            self.client.try_publish(format!("plant/rig-1/{topic}"), text, options).unwrap();
        }
        let mut n_taken = 0;
        while n_taken < messages.len() {
            let event = self.connection.recv_timeout(Duration::from_secs(20)).unwrap().unwrap();
            n_taken += usize::from(matches!(event, Event::Incoming(Incoming::PubAck(_))));
        }
    }
}

fn ledger(daemon: &Daemon, channel: &str) -> Option<Value> {
    let (_, list) = daemon.get_json("/api/v1/machines/rig-1/channels");
    let items = list["items"].as_array()?;
    Some(items.iter().find(|item| item["name"] == channel)?["ledger"].clone())
}

fn wait_used(daemon: &Daemon, channel: &str, n: u64) {
    wait_until("values of a broker", || {
        let ledger = ledger(daemon, channel)?;
        (live::count(&ledger, "used") == n).then_some(())
    });
}

fn connected(daemon: &Daemon, is_wanted: bool) {
    wait_until("the broker's connection", || {
        (ledger(daemon, "load")?["sender"].is_string() == is_wanted).then_some(())
    });
}

#[test]
fn values_of_a_broker_are_speed_and_load_of_a_machine_whose_samples_come_over_tcp() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let mut broker = Broker::start(port);
    let mut plc = Plc::new(port);
    plc.publish_as(PublishOptions::at_least_once().retained(), &[("load", json!(7))]);
    let (daemon, address) = live::live_in(folder(port));
    connected(&daemon, true);
    let start_ns = live::ago(100);
    let value = |second: u32, value: f64| json!({ "t": start_ns as f64 / 1e9 + f64::from(second), "value": value });
    let (mut sender, _) = Sender::greet(&address, 1);
    let blocks_a_second = live::RATE_HZ / live::N;
    let mut run = |plc: &mut Plc, seconds: std::ops::Range<u32>, speed_hz: &dyn Fn(u32) -> f64| {
        for begin in seconds.clone().step_by(4) {
            let values = (begin..begin + 4)
                .flat_map(|s| [("speed", value(s, speed_hz(s))), ("load", value(s, 40.0))]);
            plc.publish(&values.collect::<Vec<_>>());
            wait_used(&daemon, "speed", u64::from(begin) + 4);
            wait_used(&daemon, "load", u64::from(begin) + 4);
            for block in begin * blocks_a_second..(begin + 4) * blocks_a_second {
                sender.block(block, start_ns);
            }
            sender.settle();
        }
    };
    let judged = |state: &str| {
        wait_until(state, || {
            let (_, document) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
            (document["operating_state"] == state).then_some(document)
        })
    };
    run(&mut plc, 0..24, &|_| 12.5);
    let diagnosis = judged("running");
    assert_eq!(diagnosis["speed_source"], "speed_channel");
    let speed_hz = diagnosis["shaft_speed_hz"].as_f64().unwrap();
    assert!((speed_hz - 12.5).abs() < 1e-6, "{speed_hz}");
    run(&mut plc, 24..40, &|second| 12.5 + 0.5 * f64::from(second - 24));
    judged("transient");
    run(&mut plc, 40..60, &|_| 0.0);
    judged("stopped");
    // What is no value is named and counted, and disturbs none.
    plc.publish(&[
        ("load", json!("on")),
        ("load", value(10_000, 1.0)),
        ("load", json!({ "t": start_ns as f64 / 1e9 + 60.0, "value": null })),
        ("load", value(58, 1.0)),
        ("load", value(63, 1.0)),
    ]);
    wait_used(&daemon, "load", 61);
    let told = ledger(&daemon, "load").unwrap();
    let counts = ["received", "not_finite", "duplicate", "lost", "gaps"]
        .map(|name| live::count(&told, name));
    assert_eq!(counts, [63, 1, 1, 2, 1], "61 and 62 are missing: {told}");
    // What was retained without a time before the daemon began has no place.
    for (reason, n) in [("malformed", 2.0), ("time-ahead", 1.0)] {
        let name = format!("rotorwatch_ingest_refused_total{{reason=\"{reason}\"}}");
        assert_eq!(daemon.metric(&name), Some(n), "{reason}");
    }
    // The broker dies and comes back: a gap, and it goes on.
    drop((broker, plc));
    connected(&daemon, false);
    broker = Broker::start(port);
    connected(&daemon, true);
    Plc::new(port).publish(&[("speed", value(70, 12.5))]);
    wait_used(&daemon, "speed", 61);
    assert_eq!(live::count(&ledger(&daemon, "speed").unwrap(), "lost"), 10);
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0));
    assert!(!ended.stderr.contains(PASSWORD), "{}", ended.stderr);
    drop(broker);
}
