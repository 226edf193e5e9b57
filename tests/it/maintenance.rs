//! A machine that is maintained raises nothing that asks for anybody, over a kill too, until its time or somebody ends it;
//! and what people found of verdicts is kept.

use crate::event_stream::events;
use crate::reload::alarm;
use crate::reload::change;
use crate::reload::limit;
use crate::reload::start;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;
use tempfile::TempDir;

const PATH: &str = "/api/v1/machines/rig-1/maintenance";

/// What was told of maintenance so far, at least `n` times.
fn told(daemon: &Daemon, n: usize) -> Vec<(String, String)> {
    let is_it = |event: &&crate::event_stream::Event| event.name == "maintenance";
    let found = events(daemon, "?last_event_id=0&machine=rig-1", None, |found| {
        found.iter().filter(is_it).count() >= n
    });
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let of = |event: &crate::event_stream::Event| {
        (text(&event.data["event"]), text(&event.data["reason"]))
    };
    found.iter().filter(is_it).map(of).collect()
}

#[test]
fn a_maintained_machine_is_told_everywhere_and_silent_over_a_kill() {
    let mut daemon = start();
    assert_eq!(daemon.get_json(PATH).1["maintenance"], json!(null));
    let body = json!({ "author": "M. Ito", "reason": "new belt", "for_s": 3600.0 });
    let (status, said) = daemon.post_json(PATH, &body);
    assert_eq!(status, 201, "{said}");
    for path in [PATH, "/api/v1/machines/rig-1", "/api/v1/machines/rig-1/health"] {
        assert_eq!(daemon.get_json(path).1["maintenance"], said, "{path}");
    }
    let (_, list) = daemon.get_json("/api/v1/machines");
    let of = |id: &str| {
        let items = list["items"].as_array().unwrap();
        items.iter().find(|item| item["id"] == id).unwrap()["maintenance"].clone()
    };
    assert_eq!((of("rig-1"), of("rig-2")), (said.clone(), json!(null)));
    let gauge =
        |machine: &str| format!("rotorwatch_machine_in_maintenance{{machine=\"{machine}\"}}");
    assert_eq!(daemon.metric(&gauge("rig-1")), Some(1.0));
    assert_eq!(daemon.metric(&gauge("rig-2")), Some(0.0));
    daemon.signal("KILL");
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    let daemon = Daemon::start_in(dir);
    assert_eq!(daemon.get_json(PATH).1["maintenance"], said);
    change(&daemon, "rig.toml", &limit(0.1));
    let raised = support::wait_until("the alarm", || alarm(&daemon));
    assert_eq!((&raised["state"], &raised["active"]), (&json!("out_of_service"), &json!(true)));
    assert_eq!(raised["silenced"]["comment"], "new belt");
    assert_eq!(daemon.delete(&format!("{PATH}?author=A.+Berg&comment=runs")), 204);
    assert_eq!(alarm(&daemon).unwrap()["state"], "unacknowledged");
    assert_eq!(daemon.delete(&format!("{PATH}?author=A.+Berg")), 404);
    assert_eq!(daemon.metric(&gauge("rig-1")), Some(0.0));
    let expected = [("maintenance_began", "new belt"), ("maintenance_ended", "runs")];
    assert_eq!(told(&daemon, 2), expected.map(|(a, b)| (a.to_owned(), b.to_owned())));
    let (_, audit) = daemon.get_json("/api/v1/audit?machine=rig-1");
    let acts: Vec<_> =
        audit["items"].as_array().unwrap().iter().map(|act| &act["action"]).collect();
    assert_eq!(acts, ["maintenance_ended", "returned_to_service", "maintenance_began"], "{audit}");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn a_maintenance_ends_by_its_time_and_says_so() {
    let daemon = start();
    change(&daemon, "rig.toml", &limit(0.1));
    support::wait_until("the alarm", || alarm(&daemon));
    let body = json!({ "author": "M. Ito", "reason": "grease", "for_s": 0.3 });
    assert_eq!(daemon.post_json(PATH, &body).0, 201);
    let state = |wanted: &str| {
        let what = format!("the alarm to be {wanted}");
        support::wait_until(&what, || (alarm(&daemon)?["state"] == wanted).then_some(()));
    };
    state("unacknowledged");
    let expected = [("maintenance_began", "grease"), ("maintenance_over", "grease")];
    assert_eq!(told(&daemon, 2), expected.map(|(a, b)| (a.to_owned(), b.to_owned())));
    assert_eq!(daemon.get_json(PATH).1["maintenance"], json!(null));
    for (body, part) in [
        (json!({ "author": "a", "reason": "b" }), "one of until and for_s"),
        (
            json!({ "author": "a", "reason": "b", "for_s": 1.0, "until": "2100-01-01T00:00:00Z" }),
            "one of",
        ),
        (json!({ "author": "a", "reason": "b", "until": "tomorrow" }), "allowed is a time"),
        (
            json!({ "author": "a", "reason": "b", "until": "2020-01-01T00:00:00Z" }),
            "later than now",
        ),
        (json!({ "author": "a", "reason": "b", "for_s": 4e7 }), "within 31536000 s"),
        (json!({ "author": "a", "reason": " ", "for_s": 1.0 }), "say why"),
        (json!({ "author": "", "reason": "b", "for_s": 1.0 }), "must not be empty"),
    ] {
        let (status, problem) = daemon.post_json(PATH, &body);
        assert_eq!(status, 400, "{body}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(part), "{body}: {problem}");
    }
}

#[test]
fn what_people_found_is_kept_with_the_verdict_listed_and_exported() {
    const PATH: &str = "/api/v1/machines/rig-1/diagnosis/feedback";
    let mut daemon = start();
    let verdict = support::wait_until("a verdict", || {
        let (status, found) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
        (status == 200).then_some(found)
    });
    let one = &verdict["components"][0];
    let of = |outcome: &str| {
        json!({
            "author": "M. Ito", "outcome": outcome, "kind": one["kind"], "component": one["id"], "note": "seen, \"open\""
        })
    };
    let (status, said) = daemon.post_json(PATH, &of("wrong"));
    assert_eq!(status, 201, "{said}");
    assert_eq!((&said["number"], &said["verdict"]["state"]), (&json!(1), &one["state"]));
    let mut other = of("other_cause");
    other["fault"] = json!("misalignment");
    assert_eq!(daemon.post_json(PATH, &other).0, 201);
    for (key, value, status, part) in [
        ("component", json!("none"), 404, "no verdict on a"),
        ("outcome", json!("confirmed"), 400, "other_cause"),
        ("fault", json!("rust"), 400, "unknown variant"),
        ("author", json!(" "), 400, "must not be empty"),
        ("note", json!("x".repeat(2001)), 400, "at most 2000"),
    ] {
        let mut bad = other.clone();
        bad[key] = value;
        let (found, problem) = daemon.post_json(PATH, &bad);
        assert_eq!(found, status, "{key}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(part), "{key}: {problem}");
    }
    daemon.signal("KILL");
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    let daemon = Daemon::start_in(dir);
    let (_, first) = daemon.get_json(&format!("{PATH}?limit=1"));
    assert_eq!(
        (&first["items"][0]["fault"], &first["next"]),
        (&json!("misalignment"), &json!("2"))
    );
    let (_, rest) = daemon.get_json(&format!("{PATH}?limit=1&after=2"));
    assert_eq!((&rest["items"][0], &rest["next"]), (&said, &json!(null)));
    assert_eq!(daemon.get_json("/api/v1/machines/rig-2/diagnosis/feedback").1["items"], json!([]));
    let config = daemon.dir.path().join("serve.toml");
    let exported = support::run(
        support::command()
            .args(["export", "--feedback", "--format", "csv", "--config"])
            .arg(config),
    );
    let lines: Vec<&str> = exported.stdout.lines().collect();
    assert_eq!(lines.len(), 3, "{exported:?}");
    assert!(
        lines[1].contains(",M. Ito,wrong,") && lines[1].contains("\"seen, \"\"open\"\"\""),
        "{lines:?}"
    );
    assert!(lines[2].contains(",other_cause,") && lines[2].contains(",misalignment,"), "{lines:?}");
}
