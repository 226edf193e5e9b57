//! What is silenced before it has raised anything stays silent, over a kill too, until somebody ends it.

use crate::reload::alarm;
use crate::reload::change;
use crate::reload::limit;
use crate::reload::start;
use crate::support;
use crate::support::Daemon;
use serde_json::json;
use tempfile::TempDir;

const PATH: &str = "/api/v1/machines/rig-1/silences";

#[test]
fn what_is_suppressed_in_advance_is_raised_silent_after_a_kill() {
    let mut daemon = start();
    let body = json!({
        "author": "M. Ito", "comment": "known", "silence": "suppressed", "limit": "level"
    });
    let (status, said) = daemon.post_json(PATH, &body);
    assert_eq!(status, 201, "{said}");
    daemon.signal("KILL");
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    let daemon = Daemon::start_in(dir);
    let (_, list) = daemon.get_json(PATH);
    assert_eq!(list["items"], json!([said]));
    change(&daemon, "rig.toml", &limit(0.1));
    let raised = support::wait_until("the alarm", || alarm(&daemon));
    assert_eq!((&raised["state"], &raised["active"]), (&json!("suppressed"), &json!(true)));
    assert_eq!(raised["silenced"]["author"], "M. Ito");
    assert_eq!(daemon.delete(&format!("{PATH}/{}?author=A.+Berg&comment=no", said["number"])), 204);
    assert_eq!(alarm(&daemon).unwrap()["state"], "unacknowledged");
    let (_, audit) = daemon.get_json("/api/v1/audit?machine=rig-1");
    let acts: Vec<_> =
        audit["items"].as_array().unwrap().iter().map(|act| &act["action"]).collect();
    assert_eq!(acts, ["silence_ended", "unsuppressed", "silence_announced"], "{audit}");
    assert_eq!(audit["items"][2]["comment"], "limit level: known");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}
