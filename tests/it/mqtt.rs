//! MQTT of the running daemon against a real broker in a process of its own, which is killed and comes back.

use crate::hook;
use crate::support;
use crate::support::Daemon;
use rumqttc::Client;
use rumqttc::Event;
use rumqttc::Incoming;
use rumqttc::MqttOptions;
use rumqttc::QoS;
use serde_json::Value;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::io::Read;
use std::io::Write;
use std::net::TcpListener;
use std::net::TcpStream;
use std::process::Child;
use std::process::Command;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;
use tempfile::TempDir;

/// Says to this binary that it is a broker, and where.
const PORT: &str = "ROTORWATCH_TEST_BROKER_PORT";

pub(crate) const PASSWORD: &str = "p4ss-0f-the-br0ker";

/// The broker's process: this binary again, with the test below.
pub(crate) struct Broker(Child);

impl Broker {
    pub(crate) fn start(port: u16) -> Self {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--ignored", "--exact", "mqtt::a_broker", "--nocapture"])
            .env(PORT, port.to_string())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        support::wait_until("the broker", || TcpStream::connect(("127.0.0.1", port)).ok());
        Self(child)
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _ended = self.0.wait();
    }
}

#[test]
#[ignore = "no test but the broker's process of the others"]
fn a_broker() {
    let Ok(port) = std::env::var(PORT) else { return };
    let config = format!(
        "id = 0\n[router]\nmax_connections = 100\nmax_outgoing_packet_count = 200\n\
         max_segment_size = 104857600\nmax_segment_count = 10\n[v4.1]\nname = \"v4\"\n\
         listen = \"127.0.0.1:{port}\"\nnext_connection_delay_ms = 1\n[v4.1.connections]\n\
         connection_timeout_ms = 60000\nmax_payload_size = 262144\nmax_inflight_count = 100\n\
         dynamic_filters = true\n[v4.1.connections.auth]\nwatch = \"{PASSWORD}\"\nreader = \"r\"\n"
    );
    rumqttd::Broker::new(toml::from_str(&config).unwrap()).start().unwrap();
}

/// What a reader of all topics sees: what is retained now, and the transitions that came.
#[derive(Debug, Default)]
struct Seen {
    retained: BTreeMap<String, String>,
    events: Vec<String>,
}

/// A reader that stays over the broker's restarts.
struct Reader {
    seen: Arc<Mutex<Seen>>,
    over: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Reader {
    fn start(port: u16, name: &str) -> Self {
        let (seen, over) =
            (Arc::new(Mutex::new(Seen::default())), Arc::new(AtomicBool::new(false)));
        let (into, end, name) = (Arc::clone(&seen), Arc::clone(&over), name.to_owned());
        let thread = thread::spawn(move || {
            while !end.load(Ordering::SeqCst) {
                let mut options = MqttOptions::new(name.clone(), ("127.0.0.1", port));
                options.set_credentials("reader", "r").set_keep_alive(5);
                options.set_max_packet_size(262_144, 262_144);
                let (client, mut connection) = Client::builder(options).capacity(10).build();
                client.try_subscribe("plant/#", QoS::AtLeastOnce).unwrap();
                while !end.load(Ordering::SeqCst) {
                    match connection.recv_timeout(std::time::Duration::from_millis(200)) {
                        Ok(Ok(Event::Incoming(Incoming::Publish(publish)))) => {
                            let topic = String::from_utf8(publish.topic.to_vec()).unwrap();
                            let payload = String::from_utf8(publish.payload.to_vec()).unwrap();
                            let mut seen = into.lock().unwrap();
                            if topic.ends_with("/events") {
                                seen.events.push(payload);
                            } else if payload.is_empty() {
                                seen.retained.remove(&topic);
                            } else {
                                seen.retained.insert(topic, payload);
                            }
                        }
                        Ok(Ok(_)) | Err(rumqttc::RecvTimeoutError::Timeout { .. }) => {}
                        Ok(Err(_)) | Err(_) => break,
                    }
                }
                thread::sleep(std::time::Duration::from_millis(50));
            }
        });
        Self { seen, over, thread: Some(thread) }
    }

    /// A retained document, when it fits.
    fn wait_for(&self, topic: &str, fits: impl Fn(Option<&str>) -> bool) {
        support::wait_until(topic, || {
            let seen = self.seen.lock().unwrap();
            fits(seen.retained.get(topic).map(String::as_str)).then_some(())
        });
    }

    /// Ids of transitions in the order of their first arrival.
    fn ids(&self) -> Vec<String> {
        let mut ids = Vec::new();
        for event in &self.seen.lock().unwrap().events {
            let event: Value = serde_json::from_str(event).unwrap();
            let id = event["id"].as_str().unwrap().to_owned();
            if !ids.contains(&id) {
                ids.push(id);
            }
        }
        ids
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        let _ended = self.thread.take().map(thread::JoinHandle::join);
    }
}

fn folder(port: u16) -> TempDir {
    let machine = format!(
        "{}[[limits.alarm]]\nid = \"low\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = 1e-6\n",
        support::MACHINE
    );
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
         machine = \"rig-1\"\nfile = \"x.h5\"\n[[notify.mqtt]]\nname = \"plant\"\nhost = \"127.0.0.1\"\n\
         port = {port}\nprefix = \"plant\"\nuser = \"watch\"\npassword_file = \"password\"\nmax_backoff_s = 1\n"
    );
    let files: [(&str, &[u8]); 2] =
        [("rig.toml", machine.as_bytes()), ("password", PASSWORD.as_bytes())];
    let dir = support::folder(&config, &files);
    support::write_ramp(&dir, "x.h5", 1000.0, 30_000);
    dir
}

fn state_of(payload: Option<&str>) -> String {
    let document: Value = payload.map_or(Value::Null, |text| serde_json::from_str(text).unwrap());
    document["state"].as_str().unwrap_or_default().to_owned()
}

#[test]
fn topics_hold_what_stands_and_every_transition_comes_over_kills_of_broker_and_daemon() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let mut broker = Broker::start(port);
    let reader = Reader::start(port, "reader");
    let mut daemon = Daemon::start_in(folder(port));
    reader.wait_for("plant/availability", |payload| payload == Some("online"));
    reader.wait_for("plant/rig-1/state", |payload| !state_of(payload).is_empty());
    reader
        .wait_for("plant/rig-1/components/bearing/right", |payload| !state_of(payload).is_empty());
    let id = support::wait_until("the alarm", || {
        let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1");
        let found =
            list["items"].as_array().unwrap().iter().find(|alarm| alarm["limit"] == "low").cloned();
        found.map(|alarm| alarm["id"].as_str().unwrap().to_owned())
    });
    let topic = format!("plant/rig-1/alarms/{}", id.strip_prefix("rig-1:").unwrap());
    reader.wait_for(&topic, |payload| state_of(payload) == "unacknowledged");
    let act = |daemon: &Daemon, act: &str| {
        let body = match act {
            "shelve" => json!({ "author": "M. Ito", "for_s": 3600.0 }),
            _ => json!({ "author": "M. Ito" }),
        };
        let (status, answer) = daemon.post_json(&format!("/api/v1/alarms/{id}/{act}"), &body);
        assert_eq!(status, 200, "{answer}");
    };
    act(&daemon, "ack");
    reader.wait_for(&topic, |payload| state_of(payload) == "acknowledged");
    // The broker dies, forgets everything, and comes back.
    drop(broker);
    act(&daemon, "shelve");
    act(&daemon, "unshelve");
    act(&daemon, "suppress");
    support::wait_until("a failure", || {
        let (_, system) = daemon.get_json("/api/v1/system");
        let told = &system["receivers"][0];
        // The acknowledgement before may not have been taken yet: it waits too.
        let waits = told["waiting"].as_u64() >= Some(3);
        (told["kind"] == "mqtt" && told["failure"].is_string() && waits).then_some(())
    });
    reader.seen.lock().unwrap().retained.clear();
    broker = Broker::start(port);
    reader.wait_for(&topic, |payload| state_of(payload) == "suppressed");
    reader.wait_for("plant/availability", |payload| payload == Some("online"));
    // The daemon dies: the broker tells it by the will.
    daemon.signal("KILL");
    daemon.child.wait().unwrap();
    reader.wait_for("plant/availability", |payload| payload == Some("offline"));
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    // While it is away its limit is taken out of the machine file: the alarm is over at the start, silent as it was.
    std::fs::write(dir.path().join("rig.toml"), support::MACHINE).unwrap();
    let daemon = Daemon::start_in(dir);
    reader.wait_for("plant/availability", |payload| payload == Some("online"));
    reader.wait_for(&topic, |payload| payload.is_none());
    let history = |daemon: &Daemon| -> Vec<String> {
        let (_, page) = daemon.get_json("/api/v1/alarms/history?machine=rig-1&limit=1000");
        let events = page["items"].as_array().unwrap();
        events.iter().rev().map(|event| format!("rig-1#{}", event["sequence"])).collect()
    };
    let expected = history(&daemon);
    assert!(expected.len() >= 6, "{expected:?}");
    support::wait_until("every transition", || {
        (reader.ids().len() >= expected.len()).then_some(())
    });
    assert_eq!(reader.ids(), expected, "in order, none lost");
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0));
    assert!(!ended.stderr.contains(PASSWORD), "{}", ended.stderr);
    reader.wait_for("plant/availability", |payload| payload == Some("offline"));
    drop(broker);
}

#[test]
fn a_wrong_password_is_told_as_such_and_not_shown() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let _broker = Broker::start(port);
    let dir = folder(port);
    std::fs::write(dir.path().join("password"), "wr0ng-passw0rd").unwrap();
    let daemon = Daemon::start_logging(dir, "trace");
    let told = support::wait_until("a failure", || {
        let (_, system) = daemon.get_json("/api/v1/system");
        system["receivers"][0]["failure"].as_str().map(str::to_owned)
    });
    assert!(!told.is_empty());
    let metrics = daemon.get_text("/metrics").1;
    assert!(metrics.contains("rotorwatch_receiver_failing{receiver=\"plant\"} 1"), "{metrics}");
    let ended = daemon.terminate();
    assert!(!ended.stderr.contains("wr0ng-passw0rd"), "{}", ended.stderr);
}

/// Copies what there is from one to the other; false: it is over.
fn pass_on(from: &mut impl Read, to: &mut impl Write) -> bool {
    let mut bytes = [0; 4096];
    match from.read(&mut bytes) {
        Ok(0) => false,
        Ok(n) => to.write_all(&bytes[..n]).and_then(|()| to.flush()).is_ok(),
        Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
    }
}

/// Stands before a broker and speaks TLS 1.2 or 1.3 to clients; gives its port and certificate. What passes is the broker's own.
fn encrypted(broker: u16) -> (u16, String) {
    let (config, certificate) = hook::tls();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for client in listener.incoming() {
            let (client, config) = (client.unwrap(), Arc::clone(&config));
            thread::spawn(move || {
                let mut broker = TcpStream::connect(("127.0.0.1", broker)).unwrap();
                for stream in [&client, &broker] {
                    stream.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
                }
                let connection = rustls::ServerConnection::new(config).unwrap();
                let mut client = rustls::StreamOwned::new(connection, client);
                while pass_on(&mut client, &mut broker) && pass_on(&mut broker, &mut client) {}
            });
        }
    });
    (port, certificate)
}

#[test]
fn an_encrypted_broker_is_told_only_by_who_trusts_its_certificate() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let _broker = Broker::start(port);
    let (encrypted, certificate) = encrypted(port);
    let reader = Reader::start(port, "reader");
    let dir = folder(encrypted);
    let config = std::fs::read_to_string(dir.path().join("serve.toml")).unwrap();
    let config = config
        .replace("host = \"127.0.0.1\"", "host = \"localhost\"\ntls = true\nca_file = \"ca.pem\"");
    std::fs::write(dir.path().join("serve.toml"), config).unwrap();
    // Another certificate of the same name is not that of the broker.
    std::fs::write(dir.path().join("ca.pem"), hook::tls().1).unwrap();
    let mut daemon = Daemon::start_in(dir);
    let told = support::wait_until("a failure", || {
        let (_, system) = daemon.get_json("/api/v1/system");
        system["receivers"][0]["failure"].as_str().map(str::to_owned)
    });
    assert!(!told.is_empty() && reader.seen.lock().unwrap().retained.is_empty(), "{told}");
    daemon.signal("TERM");
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    std::fs::write(dir.path().join("ca.pem"), certificate).unwrap();
    let daemon = Daemon::start_in(dir);
    reader.wait_for("plant/availability", |payload| payload == Some("online"));
    reader.wait_for("plant/rig-1/state", |payload| !state_of(payload).is_empty());
    assert_eq!(daemon.terminate().status.code(), Some(0));
    reader.wait_for("plant/availability", |payload| payload == Some("offline"));
}
