//! The stream of events of the running daemon: resumed over restarts and kills, nothing lost, nothing twice.

use crate::notify::alarms;
use crate::notify::folder;
use crate::notify::history;
use crate::notify::operate;
use crate::page;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::BufRead;
use std::io::BufReader;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;
use std::thread;
use tempfile::TempDir;

/// An event of a stream.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) data: Value,
}

/// Reads events of a stream until `enough`, or its end.
pub(crate) fn events(
    daemon: &Daemon,
    query: &str,
    last: Option<u64>,
    enough: impl Fn(&[Event]) -> bool,
) -> Vec<Event> {
    let agent: ureq::Agent = ureq::Agent::config_builder().build().into();
    let mut request = agent.get(format!("{}/api/v1/events{query}", daemon.base_url));
    if let Some(last) = last {
        request = request.header("last-event-id", last.to_string());
    }
    let response = request.call().unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let lines = BufReader::new(response.into_body().into_reader()).lines();
    let mut found = Vec::new();
    let (mut id, mut name, mut data) = (0, String::new(), None);
    for line in lines {
        let Ok(line) = line else { return found };
        match line.split_once(':').map(|(field, value)| (field, value.trim_start())) {
            Some(("id", value)) => id = value.parse().unwrap(),
            Some(("event", value)) => name = value.to_owned(),
            Some(("data", value)) => data = Some(serde_json::from_str(value).unwrap()),
            Some(_) => {}
            None => {
                if let Some(data) = data.take() {
                    found.push(Event { id, name: std::mem::take(&mut name), data });
                }
                if enough(&found) {
                    return found;
                }
            }
        }
    }
    found
}

#[test]
fn a_stream_of_events_goes_on_over_restarts_without_loss_or_duplicate() {
    let mut dir = folder(&[]);
    let (mut received, mut last): (Vec<Event>, _) = (Vec::new(), 0);
    for round in 0..4 {
        let mut daemon = Daemon::start_in(dir);
        let standing = alarms(&daemon);
        let n_wanted = 3 + 4 * round;
        let n_answers = AtomicU64::new(0);
        let got = Mutex::new(Vec::new());
        thread::scope(|scope| {
            for (id, state) in standing {
                let (url, n_answers) = (&daemon.base_url, &n_answers);
                scope.spawn(move || operate(url, &id, state, n_answers));
            }
            // The first round has nothing to go on from; the place may be in the header or in the query.
            let from = match round {
                0 => events(&daemon, "?last_event_id=0", None, |found| found.len() > n_wanted),
                1 => events(&daemon, "", Some(last), |found| found.len() > n_wanted),
                _ => events(
                    &daemon,
                    &format!("?last_event_id={last}&machine=rig-1"),
                    None,
                    |found| found.len() > n_wanted,
                ),
            };
            *got.lock().unwrap() = from;
            daemon.signal(if round == 1 { "TERM" } else { "KILL" });
        });
        daemon.child.wait().unwrap();
        dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
        let got = got.into_inner().unwrap();
        assert_eq!((got[0].name.as_str(), got[0].id), ("begin", last), "{got:?}");
        last = got.last().unwrap().id;
        received.extend(got.into_iter().skip(1));
    }
    let daemon = Daemon::start_in(dir);
    let expected = history(&daemon);
    // What happened since the last one that was received, and nothing else.
    let of_alarms = |events: &[Event]| -> Vec<String> {
        let alarms = events.iter().filter(|event| event.name == "alarm");
        alarms.map(|event| event.data["id"].as_str().unwrap().to_owned()).collect()
    };
    let n_missing = expected.len() - of_alarms(&received).len();
    let rest = events(&daemon, &format!("?last_event_id={last}"), None, |found| {
        of_alarms(found).len() >= n_missing
    });
    received.extend(rest.into_iter().skip(1));
    assert_eq!(of_alarms(&received), expected);
    let places: Vec<u64> = received.iter().map(|event| event.id).collect();
    assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "{places:?}");
    assert!(received.iter().any(|event| event.name == "health"), "{received:?}");
    // A restart is no news of health: each state of a component is told once.
    let mut states: BTreeMap<String, Value> = BTreeMap::new();
    for event in received.iter().filter(|event| event.name == "health") {
        let key = format!("{} {}", event.data["kind"], event.data["component"]);
        let state = json!([event.data["state"], event.data["fault"]]);
        assert_ne!(states.insert(key, state.clone()), Some(state), "told twice: {event:?}");
    }
    // A place that the store does not have.
    let reset = events(&daemon, "?last_event_id=99999999", None, |found| !found.is_empty());
    assert_eq!(reset[0].name, "reset");
    let (status, problem) = daemon.get_json("/api/v1/events?last_event_id=x");
    assert_eq!(status, 400, "{problem}");
    assert_eq!(daemon.get_json("/api/v1/events?machine=none").0, 404);
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn live_features_of_a_machine_come_beside_its_events_and_are_those_of_the_trend() {
    let daemon = page::damaged_bearing();
    let query = "?machine=rig-1&features=rms,kurtosis&last_event_id=0";
    let is_measured = |one: &Event| one.name == "features";
    let found = events(&daemon, query, None, |found| {
        found.iter().any(is_measured) && found.iter().any(|one| one.name == "health")
    });
    let measured = &found.iter().find(|one| is_measured(one)).unwrap().data;
    assert_eq!((&measured["machine"], &measured["time_unknown"]), (&json!("rig-1"), &json!(true)));
    let channel = &measured["channels"][0];
    assert_eq!(channel["name"], json!(["rms", "kurtosis"]));
    let path = format!(
        "/api/v1/machines/rig-1/channels/{}/trend?features=rms",
        channel["channel"].as_str().unwrap()
    );
    let (_, trend) = daemon.get_json(&path);
    let newest =
        |name: &str| trend["features"][0][name].as_array().unwrap().last().unwrap().clone();
    assert_eq!(
        (newest("time_s"), newest("value")),
        (measured["time_s"].clone(), channel["value"][0].clone())
    );
    let (status, problem) = daemon.get_json("/api/v1/events?features=rms");
    assert_eq!(
        (status, problem["detail"].as_str()),
        (400, Some("features are those of one machine: name it"))
    );
}
