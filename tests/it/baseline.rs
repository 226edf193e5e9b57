//! Baselines as an operator meets them: learned of the running machine, of captures by the command line, named in
//! verdicts, used at once, there after a kill, gone when removed.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use crate::support::Ended;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use tempfile::TempDir;

const PATH: &str = "/api/v1/machines/rig-1/baselines";

/// Noise of a linear congruence, from -`level` to `level`, the same for every level.
fn noise(level: f64, n: u32) -> Vec<f64> {
    let mut state = 1_u64;
    let next = |_| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let high = u32::try_from(state >> 32).unwrap();
        level * (f64::from(high) / f64::from(u32::MAX) * 2.0 - 1.0)
    };
    (0..n).map(next).collect()
}

/// A folder whose daemon plays a noisy capture over and over; beside it the same at a twentieth of the level.
fn folder() -> TempDir {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
                  kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = 100\nloop = true\n";
    let dir = support::folder(config, &[("rig.toml", support::MACHINE.as_bytes())]);
    support::write_samples(&dir, "x.h5", 1000.0, &noise(1.0, 30_000));
    support::write_samples(&dir, "quiet.h5", 1000.0, &noise(0.05, 30_000));
    dir
}

fn baseline(dir: &Path, arguments: &[&str]) -> Ended {
    let mut command = support::command();
    command.current_dir(dir).arg("baseline").args(arguments);
    support::run(&mut command)
}

/// Waits for a verdict of which something is true.
fn verdict(daemon: &Daemon, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
    support::wait_until(what, || {
        let (status, document) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
        (status == 200 && holds(&document)).then_some(document)
    })
}

fn uses(document: &Value, id: &str) -> bool {
    let used = |b: &Value| b["used"] == true && b["id"] == id;
    document["baselines"].as_array().unwrap().iter().any(used)
}

fn machine_state(document: &Value) -> &str {
    let components = document["components"].as_array().unwrap();
    components.iter().find(|c| c["kind"] == "machine").unwrap()["state"].as_str().unwrap()
}

#[test]
fn a_baseline_of_the_running_machine_is_named_used_and_survives_a_kill() {
    let mut daemon = Daemon::start_in(folder());
    verdict(&daemon, "no baseline", |d| machine_state(d) == "undetermined");
    let body = json!({ "author": "M. Ito", "comment": "new bearing", "windows": 6 });
    let learned = support::wait_until("six windows", || {
        let (status, learned) = daemon.post_json(PATH, &body);
        assert!([201, 409].contains(&status), "{learned}");
        (status == 201).then_some(learned)
    });
    let id = learned["id"].as_str().unwrap().to_owned();
    assert_eq!(learned["records"][0]["n_windows"], 6, "{learned}");
    let document = verdict(&daemon, "a verdict against it", |d| uses(d, &id));
    assert_eq!(machine_state(&document), "healthy", "{document}");

    daemon.child.kill().unwrap();
    daemon.child.wait().unwrap();
    let dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    let daemon = Daemon::start_in(dir);
    let (_, list) = daemon.get_json(PATH);
    assert_eq!((&list["items"][0]["id"], &list["items"][0]["active"]), (&json!(id), &json!(true)));
    verdict(&daemon, "a verdict against it after the kill", |d| uses(d, &id));

    // The command line writes beside the daemon: a twentieth of the level makes today's damaged.
    let dir = daemon.dir.path();
    let by = ["--config", "serve.toml", "--author", "A. Berg"];
    let ended = baseline(dir, &[&["learn"], &by[..], &["quiet.h5"]].concat());
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    assert!(ended.stdout.contains(&format!("takes the place of {id}")), "{}", ended.stdout);
    let other = ended.stdout.split(' ').next().unwrap().to_owned();
    let document = verdict(&daemon, "the other baseline", |d| uses(d, &other) && !uses(d, &id));
    assert_eq!(machine_state(&document), "damaged", "{document}");

    let ended = baseline(dir, &[&["remove"], &by[..], &[&other[..6]]].concat());
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    verdict(&daemon, "no baseline again", |d| d["baselines"] == json!([]));
    let ended = baseline(dir, &[&["activate"], &by[..], &[&id[..6]]].concat());
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    verdict(&daemon, "the first again", |d| uses(d, &id) && machine_state(d) == "healthy");
    let shown = baseline(dir, &["show", "--config", "serve.toml", "--format", "json", &id[..6]]);
    let shown: Value = serde_json::from_str(&shown.stdout).unwrap();
    assert!(shown["usual"]["feature"].as_array().unwrap().contains(&json!("rms")), "{shown}");
}

#[test]
fn a_baseline_learned_of_damage_says_what_is_accused() {
    let dir = folder();
    std::fs::write(dir.path().join("rig.toml"), scene::MACHINE).unwrap();
    scene::write(&dir.path().join("damaged.h5"), &scene::samples(1), None);
    let by = ["learn", "--config", "serve.toml", "--author", "A. Berg"];
    let ended = baseline(dir.path(), &[&by[..], &["damaged.h5"]].concat());
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let said = "warning: damaged.h5: right is accused in it (inner_race, damaged): a baseline learned of damage hides it\n";
    assert!(ended.stdout.ends_with(said), "{}", ended.stdout);
}

#[test]
fn what_the_command_line_cannot_do_is_an_error_with_the_remedy() {
    let dir = folder();
    let of = ["--config", "serve.toml"];
    let told = |arguments: &[&str]| {
        let ended = baseline(dir.path(), arguments);
        assert_eq!(ended.status.code(), Some(2), "{}", ended.stdout);
        ended.stderr
    };
    let by = ["--author", "a"];
    let learn = |rest: &[&str]| told(&[&["learn"], &of[..], &by[..], rest].concat());
    assert!(learn(&["gone.h5"]).contains("gone.h5"));
    assert!(learn(&["rig.toml"]).contains("not a capture"));
    assert!(learn(&["--machine", "rig-2", "x.h5"]).contains("there is: rig-1"));
    let empty = told(&[&["learn"], &of[..], &["--author", " ", "x.h5"]].concat());
    assert!(empty.contains("author must not be empty"), "{empty}");
    let unknown = told(&[&["remove"], &of[..], &by[..], &["abc"]].concat());
    assert!(unknown.contains("begins with \"abc\""), "{unknown}");
    let list = baseline(dir.path(), &["list", "--config", "serve.toml"]);
    assert_eq!(list.status.code(), Some(0), "{}", list.stderr);
    assert!(list.stdout.contains("no baselines"));
}
