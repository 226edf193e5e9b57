//! What a daemon received is on the disk as it was received, however the daemon ended.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::reader::Piece;
use rotorwatch::capture::received::RawSamples;
use rotorwatch::capture::writer::{CaptureHeader, CaptureWriter};
use rotorwatch::capture::writer::{ChannelHeader, ChannelSamples, ChannelStorage};
use rotorwatch::signal::SampleIndex;
use rotorwatch::units::Hz;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use tempfile::TempDir;

const SOURCE: &str = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
                      machine = \"rig-1\"\nfile = \"x.h5\"\n";

/// The scene as a recorder meets it: counts with a scale, floats, a slow channel, two segments.
fn write_capture(path: &Path) {
    let header =
        CaptureHeader { shaft_speed: Some(Hz(scene::SPEED_HZ)), ..CaptureHeader::default() };
    let mut writer = CaptureWriter::create(path, &header).unwrap();
    let channel = |name: &str, rate_hz| ChannelHeader {
        name: name.to_owned(),
        sample_rate: Hz(rate_hz),
        unit: Some("m/s^2".to_owned()),
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    let scene = scene::samples(5);
    #[expect(clippy::cast_possible_truncation, reason = "below 30 m/s²: within 16 bits")]
    let counts: Vec<i16> = scene[0].iter().map(|x| (x * 1000.0).round() as i16).collect();
    let counts = ChannelSamples::I16 { counts: &counts, scale: 1e-3, offset: 0.0 };
    writer.channel(&channel("right_x", scene::RATE_HZ), counts).unwrap();
    let doubles: Vec<f64> = scene[1].iter().map(|&x| f64::from(x)).collect();
    writer.channel(&channel("right_y", scene::RATE_HZ), ChannelSamples::F64(&doubles)).unwrap();
    let slow: Vec<f32> = scene[2].iter().step_by(4).copied().collect();
    writer.channel(&channel("left_x", scene::RATE_HZ / 4.0), ChannelSamples::F32(&slow)).unwrap();
    // The first second stands alone, a minute before the rest.
    writer.segments(&[SampleIndex(0), SampleIndex(12_000)], &[0.0, 60.0]).unwrap();
    writer.finish().unwrap();
}

/// A folder with the scene and a configuration that records it.
fn folder(settings: &str, source: &str) -> TempDir {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[recording]\nenabled = true\n{settings}{SOURCE}{source}"
    );
    let dir = support::folder(&config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    write_capture(&dir.path().join("x.h5"));
    dir
}

fn recordings(dir: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(dir.join("data/recordings/rig-1")) else { return Vec::new() };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Each channel's samples in each segment: the first one's number and time, and all bits.
fn received(file: &Path) -> BTreeMap<(usize, u32), (u64, f64, Vec<u64>)> {
    let mut reader = CaptureReader::open(file, None, &Hints::default()).unwrap();
    reader.keep_received();
    let mut parts = BTreeMap::new();
    while let Some(piece) = reader.next_piece().unwrap() {
        let Piece::Received(run) = piece else { continue };
        let bits: Vec<u64> = match run.raw {
            RawSamples::I16(raw) => raw.iter().map(|x| u64::from(x.cast_unsigned())).collect(),
            RawSamples::I32(raw) => raw.iter().map(|x| u64::from(x.cast_unsigned())).collect(),
            RawSamples::F32(raw) => raw.iter().map(|x| u64::from(x.to_bits())).collect(),
            RawSamples::F64(raw) => raw.iter().map(|x| x.to_bits()).collect(),
        };
        let part = parts.entry((run.channel.0, run.segment));
        let part = part.or_insert((run.start.0, run.time_s, Vec::new()));
        part.2.extend(bits);
    }
    parts
}

/// What `diagnose` says of a capture: state, fault and severity of every component.
fn diagnosed(dir: &Path, file: &Path) -> Vec<Value> {
    let mut command = support::command();
    command.arg("diagnose").args(["--format", "json", "--machine"]);
    let ended = support::run(command.arg(dir.join("rig.toml")).arg(file));
    let document: Value = serde_json::from_str(ended.stdout.lines().next().unwrap()).unwrap();
    document["components"].as_array().unwrap().clone()
}

#[test]
fn a_recorded_replay_is_the_capture_again() {
    let daemon = Daemon::start_in(folder("", ""));
    daemon.wait_finished("rig-1");
    let (_, system) = daemon.get_json("/api/v1/system");
    let recording = &system["streams"][0]["recording"];
    assert_eq!(recording["recorded"], 2 * 144_000 + 36_000, "{system:#}");
    assert_eq!((&recording["lost"], &recording["files"]), (&0.into(), &1.into()), "{system:#}");
    let recorded = daemon.metric("rotorwatch_samples_recorded_total{machine=\"rig-1\"}");
    assert_eq!(recorded, Some(324_000.0));
    let dir = daemon.dir.path().to_owned();
    let [file] = &recordings(&dir)[..] else { panic!("one file") };
    let (found, sent) = (received(file), received(&dir.join("x.h5")));
    assert_eq!(found.len(), 6, "three channels, two segments");
    assert!(found == sent, "samples, places and times are those of the capture");
    let told = CaptureReader::open(file, None, &Hints::default()).unwrap().info().to_string();
    assert!(!told.contains("left open") && told.contains("machine file inside"), "{told}");
    assert_eq!(diagnosed(&dir, file), diagnosed(&dir, &dir.join("x.h5")));
    let (_, listed) = daemon.get_json("/api/v1/machines/rig-1/recordings");
    let name = file.file_name().unwrap().to_str().unwrap();
    assert_eq!(
        (&listed["items"][0]["file"], &listed["items"][0]["state"]),
        (&name.into(), &"finished".into())
    );
    let path = format!("/api/v1/machines/rig-1/recordings/{name}");
    let (status, _, given) = daemon.get_binary(&path, &[]);
    assert!(status == 200 && given == fs::read(file).unwrap(), "{status}: the file as it is");
    assert!(diagnosed(&dir, file).iter().any(|c| c["fault"] == "inner_race"));
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn a_signal_closes_the_recording() {
    let daemon = Daemon::start_in(folder("flush_seconds = 0.05\n", "speed = 10\nloop = true\n"));
    let dir = daemon.dir.path().to_owned();
    support::wait_until("a recording", || recordings(&dir).into_iter().find(|f| is_named(f)));
    // The folder goes with the daemon: what is in it is kept by a link.
    let kept = TempDir::new().unwrap();
    let [file] = &recordings(&dir)[..] else { panic!("one file") };
    let link = kept.path().join("kept.h5");
    fs::hard_link(file, &link).unwrap();
    assert_eq!(daemon.terminate().status.code(), Some(0));
    let reader = CaptureReader::open(&link, None, &Hints::default()).unwrap();
    assert!(reader.info().notes.is_empty(), "{}", reader.info());
    assert!(!received(&link).is_empty());
}

fn is_named(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension == "h5")
}

#[test]
fn after_a_kill_the_next_start_recovers_the_recording() {
    let mut daemon =
        Daemon::start_in(folder("flush_seconds = 0.05\n", "speed = 10\nloop = true\n"));
    let dir = daemon.dir.path().to_owned();
    support::wait_until("a recording", || recordings(&dir).into_iter().find(|f| is_named(f)));
    daemon.signal("KILL");
    support::wait_until("the end of the process", || daemon.child.try_wait().unwrap());
    // A second folder stands for the same one after the restart.
    let after = folder("", "");
    let store = after.path().join("data/recordings/rig-1");
    fs::create_dir_all(&store).unwrap();
    let [file] = &recordings(&dir)[..] else { panic!("one file") };
    let moved = store.join(file.file_name().unwrap());
    fs::copy(file, &moved).unwrap();
    let told = CaptureReader::open(&moved, None, &Hints::default()).unwrap().info().to_string();
    assert!(told.contains("left open"), "{told}");
    let before = received(&moved);
    fs::write(store.join(".rig-1-00000009.h5.1.part"), "").unwrap();

    let daemon = Daemon::start_in(after);
    let told = CaptureReader::open(&moved, None, &Hints::default()).unwrap().info().to_string();
    assert!(!told.contains("left open"), "{told}");
    assert!(received(&moved) == before, "the repair changed what is there");
    daemon.wait_finished("rig-1");
    assert_eq!(recordings(daemon.dir.path()).len(), 2, "the new one has a name of its own");
    let ended = daemon.terminate();
    assert!(ended.stderr.contains("recording left open was recovered"), "{}", ended.stderr);
    assert!(ended.stderr.contains("never complete"), "{}", ended.stderr);
}

#[test]
fn what_was_left_open_is_recovered_even_if_nothing_is_recorded_any_more() {
    let mut daemon =
        Daemon::start_in(folder("flush_seconds = 0.05\n", "speed = 10\nloop = true\n"));
    let dir = daemon.dir.path().to_owned();
    support::wait_until("a recording", || recordings(&dir).into_iter().find(|f| is_named(f)));
    daemon.signal("KILL");
    support::wait_until("the end of the process", || daemon.child.try_wait().unwrap());
    let [file] = &recordings(&dir)[..] else { panic!("one file") };
    let after = support::folder(
        &format!("[server]\nbind = \"127.0.0.1:0\"\n{SOURCE}"),
        &[("rig.toml", scene::MACHINE.as_bytes())],
    );
    write_capture(&after.path().join("x.h5"));
    let store = after.path().join("data/recordings/rig-1");
    fs::create_dir_all(&store).unwrap();
    let moved = store.join(file.file_name().unwrap());
    fs::copy(file, &moved).unwrap();
    let daemon = Daemon::start_in(after);
    let told = CaptureReader::open(&moved, None, &Hints::default()).unwrap().info().to_string();
    assert!(!told.contains("left open"), "{told}");
    daemon.wait_finished("rig-1");
    assert_eq!(recordings(daemon.dir.path()).len(), 1, "nothing new");
}

#[test]
fn a_disk_that_refuses_stops_the_recording_and_not_the_analysis() {
    let dir = folder("", "");
    fs::create_dir(dir.path().join("data")).unwrap();
    fs::write(dir.path().join("data/recordings"), "a file where a folder should be").unwrap();
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    let (_, system) = daemon.get_json("/api/v1/system");
    let recording = &system["streams"][0]["recording"];
    assert!(recording["failure"].as_str().unwrap().contains("folder"), "{system:#}");
    assert_eq!(recording["lost"], 324_000, "{system:#}");
    let (_, health) = daemon.get_json("/api/v1/machines/rig-1/health");
    assert!(health["components"].as_array().is_some_and(|c| !c.is_empty()), "{health:#}");
    let ended = daemon.terminate();
    assert!(ended.stderr.contains("recording failed"), "{}", ended.stderr);
}

#[test]
fn check_repair_says_what_there_is() {
    let dir = TempDir::new().unwrap();
    write_capture(&dir.path().join("x.h5"));
    let mut command = support::command();
    let ended = support::run(command.args(["check", "--repair"]).arg(dir.path().join("x.h5")));
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    assert!(ended.stdout.contains("nothing to do"), "{}", ended.stdout);
    let broken = dir.path().join("broken.h5");
    fs::write(&broken, "no HDF5 at all\n").unwrap();
    let ended = support::run(support::command().args(["check", "--repair"]).arg(broken));
    assert_eq!(ended.status.code(), Some(2), "{}", ended.stdout);
    assert!(ended.stderr.contains("without a table of numbers"), "{}", ended.stderr);
}
