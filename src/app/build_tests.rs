//! What is refused before anything starts.

use super::super::tests::machine;
use super::*;
use crate::capture::hints::Hints;
use crate::capture::writer::CaptureHeader;
use crate::capture::writer::CaptureWriter;
use crate::capture::writer::ChannelHeader;
use crate::capture::writer::ChannelSamples;
use crate::capture::writer::ChannelStorage;
use crate::config::FileText;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use std::path::PathBuf;

fn entry(id: &str) -> MachineConfig {
    MachineConfig {
        file: PathBuf::new(),
        text: FileText::default(),
        machine: machine(id),
        baseline: Vec::new(),
        source: SourceConfig::Replay(replay::Settings {
            hints: Hints::default(),
            file: PathBuf::new(),
            speed: replay::Speed::Max,
            repeat: false,
        }),
    }
}

fn stream(n_channels: usize) -> Result<Stream, String> {
    let channel = ChannelInfo {
        name: "x".to_owned(),
        sample_rate: Hz(10_000.0),
        unit: Unit::Unknown,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    let channels = vec![channel; n_channels];
    let info = StreamInfo {
        channels,
        start_time: None,
        shaft_speed: None,
        load: None,
        received: Vec::new(),
    };
    Ok(Stream { info, simulated: None })
}

#[test]
fn a_baseline_that_is_named_twice_is_one() {
    let folder = tempfile::TempDir::new().unwrap();
    let [file, link] = ["healthy.h5", "again.h5"].map(|name| folder.path().join(name));
    let samples: Vec<f64> = (0..12_000).map(|i| (0.3 * f64::from(i)).sin()).collect();
    let mut writer = CaptureWriter::create(&file, &CaptureHeader::default()).unwrap();
    let header = ChannelHeader {
        name: "x".to_owned(),
        sample_rate: Hz(1000.0),
        unit: Some("m/s^2".to_owned()),
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    writer.channel(&header, ChannelSamples::F64(&samples)).unwrap();
    writer.finish().unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    let baseline = vec![file.clone(), link, file];
    let named = baselines::named(&MachineConfig { baseline, ..entry("rig-1") }).unwrap();
    assert_eq!(named.records.len(), 1);
}

#[test]
fn rings_beyond_the_limit_are_refused_with_numbers() {
    let streams = [stream(1), stream(3), Err("broken".to_owned())];
    let machines = vec![entry("small"), entry("large"), entry("broken")];
    // 30 s of 10,000 four-byte samples for each of four channels, their lists, and one queue
    let lists = 4
        * (Monitor::ring_bytes(&stream(1).unwrap().info.channels, &Config::default().monitor)
            - 1_200_000);
    let needed = 4 * 1_200_000 + lists + QUEUE_BYTES;
    let config = |limit: usize| Config {
        machines: machines.clone(),
        memory_limit_bytes: limit as u64,
        ..Config::default()
    };
    assert!(check_memory(&config(needed), &streams, 1).is_ok());
    let text = check_memory(&config(needed - 1), &streams, 1).unwrap_err().to_string();
    assert!(text.contains(&format!("need {needed} bytes")), "{text}");
    assert!(text.contains("most for machine \"large\""), "{text}");
}
