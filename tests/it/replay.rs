//! A capture through the daemon: everything arrives, is shown, and a signal ends it at any time.

use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use std::io::BufRead;
use std::io::BufReader;
use tempfile::TempDir;

const RATE_HZ: f64 = 2000.0;
const N_SAMPLES: u32 = 24_000; // 12 s

fn folder(source: &str) -> TempDir {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"ramp.h5\"\n{source}"
    );
    let dir = support::folder(&config, &[("rig.toml", support::MACHINE.as_bytes())]);
    support::write_ramp(&dir, "ramp.h5", RATE_HZ, N_SAMPLES);
    dir
}

fn channel(daemon: &Daemon) -> Value {
    daemon.get_json("/api/v1/machines/rig-1/channels").1["items"][0].clone()
}

#[test]
fn a_finished_replay_keeps_serving_every_sample() {
    let daemon = Daemon::start_in(folder("speed = \"max\"\n"));
    daemon.wait_finished("rig-1");
    let shown = channel(&daemon);
    assert_eq!(shown["received"], N_SAMPLES, "{shown}");
    assert_eq!((&shown["missing"], &shown["duplicated"]), (&0.into(), &0.into()), "{shown}");
    let path = "/api/v1/machines/rig-1/channels/right_x/waveform";
    let (status, waveform) = daemon.get_json(path);
    assert_eq!(status, 200, "{waveform}");
    let last = waveform["value"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    // sample 23,999 is 23.999; f32 keeps seven digits
    assert!((last - 23.999).abs() < 1e-5, "{last}");
    let (_, metrics) = daemon.get_text("/metrics");
    let line = "rotorwatch_samples_received_total{machine=\"rig-1\",channel=\"right_x\"} 24000";
    assert!(metrics.contains(line), "{metrics}");
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
}

#[test]
fn a_long_waveform_is_not_cut() {
    let n_samples = 1_200_000; // 10 min, more than 2^20
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[pipeline]\nring_seconds = 700\n[[machine]]\n\
                  file = \"rig.toml\"\n[[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\n\
                  file = \"ramp.h5\"\n";
    let dir = support::folder(config, &[("rig.toml", support::MACHINE.as_bytes())]);
    support::write_ramp(&dir, "ramp.h5", RATE_HZ, n_samples);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    let path = format!("/api/v1/machines/rig-1/channels/right_x/waveform?samples={n_samples}");
    let (status, headers, bytes) = daemon.get_binary(&path, &["x-rotorwatch-validity"]);
    assert_eq!((status, headers), (200, vec!["ok".to_owned()]));
    assert_eq!(bytes.len(), 4 * n_samples as usize);
}

#[test]
fn a_signal_ends_a_replay_that_waits_for_its_time() {
    let daemon = Daemon::start_in(folder("speed = 0.01\n"));
    assert_eq!(daemon.get_text("/livez").0, 200);
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn a_signal_ends_a_replay_under_way() {
    let daemon = Daemon::start_in(folder("speed = 1\n"));
    support::wait_until("the first samples", || {
        (channel(&daemon)["received"].as_u64()? > 0).then_some(())
    });
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
}

#[test]
fn a_repeated_replay_goes_on_as_one_stream() {
    let daemon = Daemon::start_in(folder("speed = \"max\"\nloop = true\n"));
    let twice = u64::from(2 * N_SAMPLES);
    support::wait_until("the third pass", || {
        let shown = channel(&daemon);
        assert_eq!((&shown["missing"], &shown["duplicated"]), (&0.into(), &0.into()), "{shown}");
        (shown["received"].as_u64()? > twice).then_some(())
    });
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
}

#[test]
fn a_daemon_that_is_not_there_is_told_at_once() {
    let dir = TempDir::new().unwrap();
    support::write_ramp(&dir, "x.h5", 100.0, 300);
    let mut command = support::command();
    command.arg("replay").arg(dir.path().join("x.h5")).args(["--to", "tcp://127.0.0.1:1"]);
    let mut sender = command.spawn().unwrap();
    // Ends with the line, or when the sender gives up a minute later.
    let lines = BufReader::new(sender.stderr.take().unwrap()).lines();
    let said: Vec<String> = lines
        .map(Result::unwrap)
        .take_while(|line| !line.contains("tried again for 60 s"))
        .filter(|line| line.contains("no connection for"))
        .collect();
    let is_running = sender.try_wait().unwrap().is_none();
    sender.kill().unwrap();
    sender.wait().unwrap();
    assert!(is_running && said.is_empty(), "{said:?}");
}
