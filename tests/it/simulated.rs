//! Simulated sources: damage comes and goes over HTTP, the verdict follows, machines and runs do not
//! mix.

use crate::support;
use crate::support::Daemon;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::simulator::scene::Scene;
use rotorwatch::simulator::scene::builtin;
use rotorwatch::simulator::simulation::Samples;
use rotorwatch::simulator::simulation::Simulation;
use serde_json::Value;
use serde_json::json;
use std::convert::Infallible;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const PATH: &str = "/api/v1/simulation/scenario";

/// The rig at 2 Hz on linear bearings, straight: exact, and far faster than real time.
fn straight() -> String {
    let text = builtin::text("seed-bow-2hz").unwrap();
    let bow = "[bow]\nshape = \"half_sine\"\namplitude_mil = 8.0\n";
    assert!(text.contains(bow));
    text.replace(bow, "")
}

/// Its machine file, with another id.
fn machine(id: &str) -> String {
    let text = straight();
    let inside = text.split("\"\"\"").nth(1).unwrap();
    inside.replacen("id = \"rig-1\"", &format!("id = \"{id}\""), 1)
}

/// A configuration with a simulated machine for each id; `first` stands before them.
fn config(first: &str, ids: &[&str]) -> String {
    let machine = |id: &&str| {
        format!(
            "[[machine]]\nfile = \"{id}.toml\"\nbaseline = [\"healthy.h5\"]\n[[source]]\n\
             kind = \"simulated\"\nmachine = \"{id}\"\nscene = \"straight.toml\"\nspeed = \"max\"\n"
        )
    };
    let machines: String = ids.iter().map(machine).collect();
    format!("[server]\nbind = \"127.0.0.1:0\"\n{first}{machines}")
}

/// A folder with scene, machine files, healthy capture and configuration.
pub(crate) fn folder(first: &str, ids: &[&str]) -> TempDir {
    let dir = support::folder(&config(first, ids), &[("straight.toml", straight().as_bytes())]);
    for id in ids {
        fs::write(dir.path().join(format!("{id}.toml")), machine(id)).unwrap();
    }
    let mut simulate = support::command();
    simulate.current_dir(dir.path()).args(["simulate", "straight.toml", "--seed", "9"]);
    let ended = support::run(simulate.args(["--out", "healthy.h5"]));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    dir
}

/// What the scenario path says of a machine.
fn simulation(daemon: &Daemon, id: &str) -> Value {
    let (status, list) = daemon.get_json(PATH);
    assert_eq!(status, 200, "{list}");
    let items = list["items"].as_array().unwrap();
    items.iter().find(|item| item["machine"] == id).unwrap().clone()
}

/// Waits until the shaft of a machine has this state and fault; gives the diagnosis.
pub(crate) fn wait_for_shaft(daemon: &Daemon, id: &str, state: &str, fault: Option<&str>) -> Value {
    support::wait_until(&format!("shaft of {id} {state} {fault:?}"), || {
        let (status, diagnosis) = daemon.get_json(&format!("/api/v1/machines/{id}/diagnosis"));
        let components = diagnosis["components"].as_array().filter(|_| status == 200)?;
        let shaft = components.iter().find(|c| c["kind"] == "shaft").unwrap();
        let found = shaft["state"] == state && shaft["fault"].as_str() == fault;
        found.then(|| diagnosis.clone())
    })
}

#[test]
fn a_bow_that_is_posted_is_named_and_its_alarm_returns_when_it_is_healed() {
    let first = "[alarms]\noff_delay_s = 20.0\n";
    let daemon = Daemon::start_in(folder(first, &["rig-1"]));
    wait_for_shaft(&daemon, "rig-1", "healthy", None);
    assert_eq!(simulation(&daemon, "rig-1")["scenario"], "GG_GS_GB");
    let wanted = json!({ "scenario": "GG_BS_GB", "grow_s": 5.0 });
    let (status, asked) = daemon.post_json(PATH, &wanted);
    assert_eq!((status, &asked["machine"]), (200, &json!("rig-1")), "{asked}");
    assert_eq!(asked["scenarios"], json!(["GG_GS_GB", "GG_BS_GB"]), "no ball bearing");
    assert_eq!(
        asked["faults"],
        json!([{ "fault": "bow", "amplitude_um": 203.2, "angle_deg": 0.0 }])
    );
    assert!(
        (asked["grown_at_s"].as_f64().unwrap() - asked["since_s"].as_f64().unwrap() - 5.0).abs()
            < 1e-9
    );
    let diagnosis = wait_for_shaft(&daemon, "rig-1", "damaged", Some("bow"));
    let told = diagnosis.to_string();
    for truth in ["GG_BS_GB", "scenario", "203.2"] {
        assert!(
            !told.contains(truth),
            "{truth} is the truth, which a diagnosis does not know: {told}"
        );
    }
    let alarm = |state: &str| {
        support::wait_until(state, || {
            let (_, alarms) = daemon.get_json("/api/v1/alarms?machine=rig-1&component=main");
            alarms["items"].as_array().unwrap().iter().find(|a| a["state"] == state).cloned()
        })
    };
    assert_eq!(alarm("unacknowledged")["fault"], "bow");
    let (status, healed) = daemon.post_json(PATH, &json!({ "faults": [] }));
    assert_eq!((status, &healed["scenario"]), (200, &json!("GG_GS_GB")), "{healed}");
    wait_for_shaft(&daemon, "rig-1", "healthy", None);
    assert_eq!(alarm("returned_unacknowledged")["fault"], "bow");
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0));
}

#[test]
fn a_bow_exceeds_the_limit_of_a_shafts_displacement_and_its_alarm_returns() {
    let dir = folder("[alarms]\noff_delay_s = 5.0\n", &["rig-1"]);
    // A bow of 203.2 um at mid-span moves the shaft there by 406.4 um peak to peak; slow, it adds next to nothing.
    let limit = |id: &str, warning: f64, damaged: f64| {
        format!(
            "[[limits.alarm]]\nid = \"{id}\"\nkind = \"shaft_displacement\"\nchannels = [\"mid_x\"]\n\
             warning_above = {warning:?}\ndamaged_above = {damaged:?}\n"
        )
    };
    let below = limit("below", 200.0, 380.0);
    let text = machine("rig-1") + &below + &limit("beyond", 440.0, 500.0);
    fs::write(dir.path().join("rig-1.toml"), text).unwrap();
    let daemon = Daemon::start_in(dir);
    let of_limit = |id: &str| {
        let (_, alarms) = daemon.get_json("/api/v1/alarms?machine=rig-1");
        alarms["items"].as_array().unwrap().iter().find(|alarm| alarm["limit"] == id).cloned()
    };
    wait_for_shaft(&daemon, "rig-1", "healthy", None);
    assert_eq!(of_limit("below"), None, "a straight shaft");
    let wanted = json!({ "scenario": "GG_BS_GB", "grow_s": 5.0 });
    assert_eq!(daemon.post_json(PATH, &wanted).0, 200);
    let alarm = support::wait_until("the limit's alarm", || {
        of_limit("below").filter(|alarm| alarm["level"] == "damaged")
    });
    assert_eq!((&alarm["source"], &alarm["active"]), (&json!("limit"), &json!(true)), "{alarm}");
    assert_eq!((&alarm["kind"], &alarm["component"]), (&json!("shaft"), &json!("main")));
    assert_eq!(daemon.post_json(PATH, &json!({ "faults": [] })).0, 200);
    support::wait_until("its return", || {
        of_limit("below").filter(|alarm| alarm["active"] == false)
    });
    assert_eq!(of_limit("beyond"), None, "never as much");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn machines_are_simulated_independently_and_named_where_there_are_several() {
    let dir = folder("", &["rig-1", "rig-2"]);
    let replayed = "[[machine]]\nfile = \"still.toml\"\n[[source]]\nkind = \"replay\"\n\
                    machine = \"still\"\nfile = \"healthy.h5\"\n";
    fs::write(dir.path().join("still.toml"), machine("still")).unwrap();
    let config = fs::read_to_string(dir.path().join("serve.toml")).unwrap() + replayed;
    fs::write(dir.path().join("serve.toml"), config).unwrap();
    let daemon = Daemon::start_in(dir);
    let (status, told) = daemon.post_json(PATH, &json!({ "scenario": "GG_BS_GB" }));
    assert_eq!(status, 400);
    assert!(told["detail"].as_str().unwrap().ends_with("say which: rig-1, rig-2"), "{told}");
    let bent = json!({ "machine": "rig-2", "scenario": "GG_BS_GB" });
    assert_eq!(daemon.post_json(PATH, &bent).0, 200);
    wait_for_shaft(&daemon, "rig-2", "damaged", Some("bow"));
    wait_for_shaft(&daemon, "rig-1", "healthy", None);
    assert_eq!(simulation(&daemon, "rig-1")["scenario"], "GG_GS_GB");
    assert_eq!(simulation(&daemon, "rig-2")["scenario"], "GG_BS_GB");
    for (id, expected) in [("still", 409), ("rig-3", 404)] {
        let body = json!({ "machine": id, "scenario": "GG_GS_GB" });
        assert_eq!(daemon.post_json(PATH, &body).0, expected, "{id}");
    }
    let simulated = daemon.metric("rotorwatch_simulated_seconds{machine=\"rig-2\"}");
    assert!(simulated.unwrap() > 5.0, "a verdict takes a window of 5 s: {simulated:?}");
    let dropped = daemon.metric("rotorwatch_blocks_dropped_total{machine=\"rig-2\"}");
    assert_eq!(dropped, Some(0.0), "a simulation waits");
    let (_, system) = daemon.get_json("/api/v1/system");
    let streams = system["streams"].as_array().unwrap();
    let lag = |id: &str| {
        streams.iter().find(|s| s["machine"] == id).unwrap()["simulation_lag_given_up_s"].clone()
    };
    assert_eq!((lag("rig-1"), lag("still")), (json!(0.0), Value::Null));
}

#[test]
fn bad_bodies_are_refused_and_change_nothing() {
    let daemon = Daemon::start_in(folder("", &["rig-1"]));
    let defect = json!({ "fault": "inner_race", "bearing": "left", "width_mm": 1, "depth_um": 50 });
    let tooth = json!({ "fault": "tooth_damage", "kind": "missing", "gear": "mesh-1", "tooth": 1 });
    for (body, words) in [
        (json!({ "scenario": "BG_BS_BB" }), "needs a gear"),
        (json!({ "scenario": "GG_GS_BB" }), "needs a ball bearing"),
        (json!({ "scenario": "bent" }), "GG_GS_GB, GG_BS_GB"),
        (json!({ "faults": [defect] }), "the scene has no ball bearings"),
        (json!({ "faults": [tooth] }), "no gear: the scene has none"),
        (json!({ "faults": [{ "fault": "bow", "amplitude_um": -1 }] }), "above 0 and below"),
        (json!({ "faults": [{ "fault": "bow", "amplitude_um": 1e300 }] }), "above 0 and below"),
        (json!({ "scenario": "GG_BS_GB", "grow_s": -1 }), "grow_s is -1"),
        (json!({ "scenario": "GG_BS_GB", "grow": 1 }), "unknown field"),
        (json!({ "machine": "rig-1" }), "neither scenario nor faults"),
        (json!([]), "invalid"),
    ] {
        let (status, told) = daemon.post_json(PATH, &body);
        assert_eq!(status, 400, "{body}: {told}");
        assert_eq!(told["type"], "urn:rotorwatch:problem:invalid-request", "{body}");
        assert!(told["detail"].as_str().unwrap().contains(words), "{body}: {told}");
    }
    let now = simulation(&daemon, "rig-1");
    assert_eq!((&now["scenario"], &now["since_s"]), (&json!("GG_GS_GB"), &json!(0.0)));
}

#[test]
fn without_a_simulated_source_there_is_no_scenario() {
    let config = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
                  machine = \"rig-1\"\nfile = \"x.h5\"\n";
    let dir = support::folder(
        &format!("[server]\nbind = \"127.0.0.1:0\"\n{config}"),
        &[("rig.toml", support::MACHINE.as_bytes())],
    );
    support::write_ramp(&dir, "x.h5", 1000.0, 1000);
    let daemon = Daemon::start_in(dir);
    let (status, told) = daemon.get_json(PATH);
    assert_eq!((status, &told["type"]), (404, &json!("urn:rotorwatch:problem:not-found")));
    assert_eq!(daemon.post_json(PATH, &json!({ "scenario": "GG_GS_GB" })).0, 404);
}

/// The first samples of every channel as the scene's simulation gives them.
fn simulated_counts(n_samples: u64) -> Vec<Vec<i16>> {
    let scene = Scene::parse(&straight(), "straight.toml").unwrap();
    let mut simulation = Simulation::new(&scene, scene.seed).unwrap();
    let mut counts = vec![Vec::new(); simulation.channels().count()];
    let mut keep = |channel: usize, samples: Samples<'_>| {
        if let Samples::Int16(new) = samples {
            counts[channel].extend_from_slice(new);
        }
        Ok::<(), Infallible>(())
    };
    simulation.advance(n_samples, &mut keep).unwrap();
    counts
}

#[test]
fn a_killed_daemon_begins_anew_and_what_it_recorded_is_the_simulation() {
    let first = "[recording]\nenabled = true\nflush_seconds = 0.05\n";
    let mut daemon = Daemon::start_in(folder(first, &["rig-1"]));
    assert_eq!(daemon.post_json(PATH, &json!({ "scenario": "GG_BS_GB", "grow_s": 8e4 })).0, 200);
    support::wait_until("some recorded seconds", || {
        let recorded = daemon.metric("rotorwatch_samples_recorded_total{machine=\"rig-1\"}")?;
        (recorded > 700_000.0).then_some(())
    });
    daemon.signal("KILL");
    // What is copied while it still writes is torn.
    daemon.child.wait().unwrap();
    let dir = TempDir::new().unwrap();
    copy(daemon.dir.path(), dir.path());
    drop(daemon);
    let daemon = Daemon::start_in(dir);
    assert_eq!(simulation(&daemon, "rig-1")["scenario"], "GG_GS_GB", "as configured");
    let recordings = daemon.dir.path().join("data/recordings/rig-1");
    let recording = recordings.join("rig-1-00000001.h5");
    let mut reader = CaptureReader::open(&recording, None, &Hints::default()).unwrap();
    // The scenario came after the first block of a tenth of a second.
    let expected = simulated_counts(1000);
    let names: Vec<String> = reader.info().channels.iter().map(|c| c.info.name.clone()).collect();
    let scene = Scene::parse(&straight(), "straight.toml").unwrap();
    let mut n_compared = 0;
    while n_compared < names.len() {
        let block = reader.next_block().unwrap().unwrap();
        if block.start.0 > 0 {
            continue;
        }
        let name = &names[block.channel.0];
        let place = scene.sensors.iter().position(|s| s.channel == *name).unwrap();
        let scale = reader.info().channels[block.channel.0].scale;
        for (sample, count) in block.samples.iter().zip(&expected[place]) {
            // Counts times their scale, rounded once to f32.
            let exact = f64::from(*count) * scale;
            assert!((f64::from(*sample) - exact).abs() <= 1e-7 * exact.abs(), "{name}");
        }
        n_compared += 1;
    }
}

#[test]
fn a_scene_too_dear_for_real_time_lags_says_so_and_spoils_no_other() {
    let dir = folder("", &["rig-1"]);
    // Contacts as stiff as a scene may have them, touched when the step has been chosen: each step is divided.
    let contact = "conformity = 0.52\nyoung_gpa = 206.8\npoisson = 0.3\n";
    let text = builtin::text("GG_GS_GB").unwrap();
    assert!(text.contains(contact) && text.contains("start = \"rotating\""));
    let stiff = text.replace(contact, "contact_factor_n_per_m1_5 = 1e14\n");
    let stiff =
        stiff.replace("constant_hz = 10.0", "points = [[0.0, 1.0], [0.5, 1.0], [1.0, 60.0]]");
    let stiff = stiff.replace("start = \"rotating\"", "start = \"rest\"");
    let stiff = stiff.replace("clearance_um = 2.0 ", "clearance_um = 1000.0 ");
    let stiff = stiff.replace("gravity = true", "gravity = false");
    fs::write(dir.path().join("stiff.toml"), stiff).unwrap();
    fs::write(dir.path().join("rig-2.toml"), machine("rig-2")).unwrap();
    let second = "[[machine]]\nfile = \"rig-2.toml\"\n[[source]]\nkind = \"simulated\"\n\
                  machine = \"rig-2\"\nscene = \"stiff.toml\"\n";
    let config = fs::read_to_string(dir.path().join("serve.toml")).unwrap() + second;
    fs::write(dir.path().join("serve.toml"), config).unwrap();
    let daemon = Daemon::start_in(dir);
    let behind = || (simulation(&daemon, "rig-2")["keeps_pace"] == false).then_some(());
    support::wait_until("the lag", behind);
    let runs = || (daemon.source_of("rig-2") == "running").then_some(());
    support::wait_until("its first samples", runs);
    assert_eq!(simulation(&daemon, "rig-1")["keeps_pace"], true);
    let bent = json!({ "machine": "rig-1", "scenario": "GG_BS_GB" });
    assert_eq!(daemon.post_json(PATH, &bent).0, 200);
    wait_for_shaft(&daemon, "rig-1", "damaged", Some("bow"));
}

fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            fs::create_dir_all(&target).unwrap();
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn what_a_scene_or_source_gets_wrong_is_told_before_anything_runs() {
    let files: [(&str, &[u8]); 2] =
        [("rig.toml", support::MACHINE.as_bytes()), ("worn.toml", b"[scene]\nname = 3\n")];
    let source = |keys: &str| {
        let config = format!(
            "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"simulated\"\nmachine = \"rig-1\"\n{keys}"
        );
        let ended = support::refused(&config, &files);
        assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(2), ""), "{}", ended.stderr);
        ended.stderr
    };
    for (keys, words) in [
        ("", "source[0]: the key \"scene\" is missing"),
        ("scene = \"none\"\n", "no built-in scene of that name: BG_BS_BB, BG_BS_GB"),
        ("scene = \"worn.toml\"\n", "worn.toml: 2:8: scene.name: "),
        (
            "scene = \"run-up\"\nscenario = \"BG_GS_GB\"\n",
            "source[0].scenario: the scenario BG_GS_GB needs a gear",
        ),
        (
            "scene = \"GG_GS_GB\"\nfile = \"x.h5\"\n",
            "source[0].file: a source of the kind \"simulated\" has no such key",
        ),
        ("scene = \"GG_GS_GB\"\nspeed = 0\n", "source[0].speed"),
        ("scene = \"GG_GS_GB\"\nseed = -1\n", "source[0].seed"),
    ] {
        let told = source(keys);
        assert!(told.contains(words), "{words}\nnot in\n{told}");
    }
}
