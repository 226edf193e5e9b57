//! A disk of 16 MB that is full, of the daemon's own raw data and then of somebody else's.

use crate::hook::Hook;
use crate::hook::Message;
use crate::notify;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;
use std::fs;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;
use tempfile::TempDir;

/// A small disk of its own, taken away when dropped.
struct Disk {
    dir: TempDir,
}

impl Disk {
    /// `None`: this user may mount nothing.
    fn mount() -> Option<Self> {
        let dir = TempDir::new().unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", "size=16m", "tmpfs"]).arg(dir.path());
        let is_mounted = mount.output().is_ok_and(|output| output.status.success());
        is_mounted.then_some(Self { dir })
    }

    fn path(&self) -> &Path {
        self.dir.path()
    }

    /// Writes a file until nothing more fits, and goes on doing so until it is told.
    fn fill(&self, over: &AtomicBool) {
        let mut file = File::create(self.path().join("somebody-else")).unwrap();
        let chunk = vec![7_u8; 4096];
        while !over.load(Ordering::SeqCst) {
            if file.write_all(&chunk).is_err() {
                thread::sleep(Duration::from_millis(2));
            }
        }
    }
}

/// Ends the filling, also when a test fails.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _still_there = Command::new("umount").arg(self.path()).status();
    }
}

/// A folder whose daemon has its store on `disk`, records everything and raises alarms twice a second.
fn folder(disk: &Disk, hook: &Hook) -> TempDir {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[store]\ndirectory = {:?}\n[recording]\nenabled = true\n\
         segment_bytes = 1_000_000\n[captures]\nseconds_before = 10\nseconds_after = 5\n[alarms]\n\
         off_delay_s = 0\nhistory_len = 8\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = 40\nloop = true\n\
         [[notify.webhook]]\nname = \"room\"\nurl = \"{}\"\nmax_backoff_s = 1\n",
        disk.path(),
        hook.url
    );
    let limit = |id, above| {
        format!(
            "[[limits.alarm]]\nid = \"{id}\"\nkind = \"feature\"\nfeature = \"rms\"\n\
             warning_above = {above}\n"
        )
    };
    let machine = format!("{}{}{}", support::MACHINE, limit("always", 1e-6), limit("high", 1.5));
    let dir = support::folder(&config, &[("rig.toml", machine.as_bytes())]);
    let sample = |i: u32| {
        let level = if (i / 100_000).is_multiple_of(2) { 0.1 } else { 3.0 };
        level * (f64::from(i) * 0.37).sin()
    };
    let samples: Vec<f64> = (0..400_000).map(sample).collect();
    support::write_samples(&dir, "x.h5", 5000.0, &samples);
    dir
}

/// The alarm of the store, if there is one.
fn of_store(daemon: &Daemon) -> Option<Value> {
    let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1&limit=1000");
    list["items"].as_array().unwrap().iter().find(|item| item["source"] == "store").cloned()
}

fn of_limit(daemon: &Daemon, limit: &str) -> Value {
    support::wait_until(limit, || {
        let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1&limit=1000");
        list["items"].as_array().unwrap().iter().find(|item| item["limit"] == limit).cloned()
    })
}

fn newest(daemon: &Daemon) -> u64 {
    let (_, page) = daemon.get_json("/api/v1/alarms/history?machine=rig-1&limit=1");
    page["items"][0]["sequence"].as_u64().unwrap_or(0)
}

fn recordings(disk: &Disk) -> Vec<String> {
    let entries = fs::read_dir(disk.path().join("recordings/rig-1")).into_iter().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn has(daemon: &Daemon, words: &str) {
    support::wait_until(words, || {
        let alarm = of_store(daemon)?;
        let says = alarm["why"].as_str().unwrap().contains(words);
        (says && alarm["active"] == true).then_some(())
    });
}

#[test]
#[ignore = "15 s, and mounts a file system; .ci/run runs it"]
fn on_a_full_disk_the_oldest_raw_data_give_way_and_alarms_go_on() {
    let Some(disk) = Disk::mount() else {
        #[expect(clippy::print_stdout, reason = "told in the log of tests")]
        {
            println!(
                "SKIPPED on_a_full_disk_the_oldest_raw_data_give_way_and_alarms_go_on: no right to mount a tmpfs"
            );
        }
        return;
    };
    let hook = Hook::start(200);
    let daemon = Daemon::start_in(folder(&disk, &hook));
    let metric = |name: &str| daemon.metric(&format!("rotorwatch_{name}")).unwrap();
    // Its own recordings fill it: the oldest go, one after another, and alarms are stored all the time.
    support::wait_until("recordings to give way", || {
        (metric("recordings_given_up_total") >= 3.0).then_some(())
    });
    has(&daemon, "the disk is full");
    let names = recordings(&disk);
    assert!(!names.is_empty() && !names[0].ends_with("00000001.h5"), "{names:?}");
    support::wait_until("alarms to be stored meanwhile", || {
        (metric("store_failing") + metric("store_events_waiting") == 0.0).then_some(())
    });
    let always = of_limit(&daemon, "always")["id"].as_str().unwrap().to_owned();
    let act = |act: &str| {
        let body = json!({ "author": "M. Ito", "for_s": 60.0 });
        let body = if act == "shelve" { body } else { json!({ "author": "M. Ito" }) };
        daemon.post_json(&format!("/api/v1/alarms/{always}/{act}"), &body)
    };
    assert_eq!(act("ack").0, 200);
    // Somebody else takes all there is.
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| disk.fill(&over));
        let _over = Over(&over);
        support::wait_until("the store to refuse", || {
            (metric("store_failing") > 0.0).then_some(())
        });
        has(&daemon, "alarms cannot be stored");
        assert_eq!(daemon.get_text("/readyz").0, 503);
        // Alarms come, are served and can be acted on; it is said that the act is not stored.
        let before = newest(&daemon);
        support::wait_until("alarms that cannot be stored", || {
            (newest(&daemon) >= before + 4).then_some(())
        });
        let (status, told) = act("shelve");
        assert!(status == 503 && told.to_string().contains("not-stored"), "{status} {told}");
        assert_eq!(of_limit(&daemon, "always")["state"], "shelved");
        // The control room is told of them all the same.
        support::wait_until("messages of what is not stored", || {
            let messages = hook.messages();
            let unstored = messages.iter().map(Message::json).filter(|m| m["stored"] == false);
            (unstored.filter(|message| message["event"] == "raised").count() >= 2).then_some(())
        });
        // Raw data have gone first, and what is lost of them is counted.
        support::wait_until("samples that are not recorded", || {
            (metric("samples_not_recorded_total{machine=\"rig-1\"}") > 0.0).then_some(())
        });
        support::wait_until("events that wait", || {
            (metric("store_events_waiting") > 0.0).then_some(())
        });
    });
    fs::remove_file(disk.path().join("somebody-else")).unwrap();
    // There is room again: everything goes on, without a restart.
    support::wait_until("the store to recover", || {
        let recovered = metric("store_failing") + metric("store_events_waiting");
        (recovered == 0.0).then_some(())
    });
    let recorded = metric("samples_recorded_total{machine=\"rig-1\"}");
    support::wait_until("recordings to go on", || {
        (metric("samples_recorded_total{machine=\"rig-1\"}") > recorded + 200_000.0).then_some(())
    });
    support::wait_until("trends to go on", || (metric("trends_failing") == 0.0).then_some(()));
    assert_eq!(act("unshelve").0, 200);
    assert!(metric("store_events_lost_total") < 0.5);
    support::wait_until("readiness", || (daemon.get_text("/readyz").0 == 200).then_some(()));
    support::wait_until("everything to be told", || {
        let (_, system) = daemon.get_json("/api/v1/system");
        (system["receivers"][0]["delivered"] == newest(&daemon)).then_some(())
    });
    // Whatever was told early is told again under the id it is stored with, and all of it in order.
    let (early, stored): (Vec<Message>, Vec<Message>) =
        hook.messages().into_iter().partition(|message| message.json()["stored"] == false);
    let ids = notify::first_arrivals(&stored);
    let expected: Vec<String> = (1..=ids.len()).map(|n| format!("rig-1#{n}")).collect();
    assert_eq!(ids, expected);
    for message in &early {
        let (id, since) =
            message.id().split_once('@').map(|(a, b)| (a.to_owned(), b.to_owned())).unwrap();
        assert!(ids.contains(&id) && since.parse::<i64>().unwrap() > 0, "{}", message.body);
    }
    #[expect(clippy::print_stdout, reason = "a figure")]
    {
        println!(
            "given up: {} recordings, {} captures, {} files of trends; {} samples not recorded; {} told early",
            metric("recordings_given_up_total"),
            metric("captures_given_up_total"),
            metric("trend_files_given_up_total"),
            metric("samples_not_recorded_total{machine=\"rig-1\"}"),
            early.len()
        );
    }
    let dir = daemon.dir.path().to_owned();
    let config = fs::read_to_string(dir.join("serve.toml")).unwrap();
    assert_eq!(daemon.terminate().status.code(), Some(0));
    // All that happened is in the store.
    let again = support::folder(&config.replace("loop = true", "loop = false"), &[]);
    fs::write(again.path().join("rig.toml"), support::MACHINE).unwrap();
    support::write_ramp(&again, "x.h5", 5000.0, 1000);
    let daemon = Daemon::start_in(again);
    let mut sequences = Vec::new();
    let mut after = String::new();
    loop {
        let (_, page) =
            daemon.get_json(&format!("/api/v1/alarms/history?machine=rig-1&limit=1000{after}"));
        let items = page["items"].as_array().unwrap();
        sequences.extend(items.iter().map(|event| event["sequence"].as_u64().unwrap()));
        let Some(next) = page["next"].as_str() else { break };
        after = format!("&after={next}");
    }
    let expected: Vec<u64> = (1..=sequences.len() as u64).rev().collect();
    assert!(sequences == expected && sequences.len() > 10, "{sequences:?}");
}
