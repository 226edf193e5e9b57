//! Captures written by others: every storage, filter and kind of text, and the real recordings.

use super::tools;
use super::weigh::{Reading, alone, read};
use rotorwatch::signal::Timestamp;
use rotorwatch::units::Hz;
use std::collections::BTreeSet;
use std::path::Path;

/// A channel as h5py reads it back.
struct Stated<'a> {
    file: &'a str,
    channel: &'a str,
    n_samples: u64,
    crc: u32,
    segmented: bool,
}

impl<'a> Stated<'a> {
    /// A line of `make_captures.py`; `None` if it is about a file to be refused.
    fn parse(line: &'a str) -> Option<Self> {
        let [file, channel, n_samples, crc, segmented] = line.split('\t').collect::<Vec<_>>()[..]
        else {
            return None;
        };
        let (n_samples, crc) = (n_samples.parse().unwrap(), crc.parse().unwrap());
        Some(Self { file, channel, n_samples, crc, segmented: segmented == "segmented" })
    }
}

#[test]
#[ignore = "needs python3 with h5py and hdf5plugin"]
fn captures_written_by_h5py_are_read_alike() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = "captures_written_by_h5py_are_read_alike";
    let Some(text) = tools::python(name, "make_captures.py", &[folder.path()]) else { return };
    let stated: Vec<Stated<'_>> = text.lines().filter_map(Stated::parse).collect();
    let files: BTreeSet<&str> = stated.iter().map(|channel| channel.file).collect();
    assert_eq!(files.len(), 96 + 2 * 28 - 3 + 5, "versions × storages × orders, filters, others");
    let mut faults = Vec::new();
    for file in files {
        match read(Path::new(file), file) {
            Ok(reading) => compare(&reading, stated.iter().filter(|s| s.file == file), &mut faults),
            Err(error) => faults.push(format!("{error}: {:?}", std::error::Error::source(&error))),
        }
    }
    for line in text.lines().filter(|line| Stated::parse(line).is_none()) {
        let (file, word) = line.split_once('\t').unwrap();
        let error = read(Path::new(file), word).err().map_or("read".into(), |e| e.to_string());
        if !error.replace(file, "").contains(word) {
            faults.push(format!("{file}: no word of {word}: {error}"));
        }
    }
    let killed = read(&folder.path().join("killed_recording.h5"), "killed").unwrap();
    assert_eq!(killed.content.channels["x"].n_samples, 40_000, "what was flushed is read");
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

/// Compares a file with what h5py read from it and, where they are known, with its attributes.
fn compare<'a>(
    reading: &Reading,
    stated: impl Iterator<Item = &'a Stated<'a>>,
    faults: &mut Vec<String>,
) {
    let mut check = |what: String, holds: bool| {
        if !holds {
            faults.push(format!("{}: {what}", reading.info.file.display()));
        }
    };
    let mut names = Vec::new();
    for channel in stated {
        let found = reading.content.channels.get(channel.channel);
        let right = found
            .is_some_and(|found| (found.n_samples, found.crc) == (channel.n_samples, channel.crc));
        check(format!("channel {} holds something else", channel.channel), right);
        check("segments".into(), reading.info.segments == channel.segmented.then_some(3));
        names.push(channel.channel);
    }
    check("channels".into(), names == reading.content.channels.keys().collect::<Vec<_>>());
    let info = &reading.info;
    if names.len() == 4 {
        check("shaft speed".into(), info.shaft_speed == Some(Hz(29.95)));
        check("start".into(), info.start_time == Some(Timestamp(1_772_366_400_000_000_000)));
        check("machine".into(), info.machine == Some("[machine]\n".repeat(500)));
        for (at, channel) in info.channels.iter().enumerate() {
            let name = &channel.info.name;
            check(format!("unit of {name}"), channel.unit_text.as_deref() == Some("m/s^2"));
            check(format!("sensor of {name}"), channel.sensor.as_deref() == Some("accelerometer"));
            check(format!("values of {name}"), values_are_right(reading, at));
        }
    }
    if info.file.ends_with("texts.h5") {
        check("start".into(), info.start_time == Some(Timestamp(1_772_366_400_000_000_000)));
        check("format".into(), info.format_stated);
        check("unit".into(), info.channels[0].unit_text.as_deref() == Some("m/s^2"));
    }
}

/// Whether a channel's physical values are those `make_captures.py` writes.
fn values_are_right(reading: &Reading, at: usize) -> bool {
    let info = &reading.info.channels[at].info;
    let mut next = 0;
    for block in reading.blocks.iter().filter(|block| block.channel.0 == at) {
        for sample in &block.samples {
            let physical = f64::from(*sample) + info.offset;
            // Halves of 17-bit integers: exact in f32.
            if (physical - expected(&info.name, next)).abs() > 1e-9 {
                return false;
            }
            next += 1;
        }
    }
    next == 20_000
}

/// Sample k of every channel that `make_captures.py` writes.
fn expected(kind: &str, k: u64) -> f64 {
    let count = ((k * 7919) % 65_536) as f64 - 32_768.0;
    if kind == "i4" { count * 0.5 + 3.0 } else { count }
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn every_real_recording_is_read_whole() {
    let Some(root) = std::env::var_os("ROTORWATCH_DATA") else {
        println!("SKIPPED every_real_recording_is_read_whole: ROTORWATCH_DATA is not set");
        return;
    };
    let _alone = alone();
    let mut n_files = 0;
    for folder in std::fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path()) {
        for file in
            std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path())
        {
            if file.extension().is_some_and(|extension| extension == "h5") {
                let what = file.display().to_string();
                let reading = read(&file, &what).unwrap();
                assert!(reading.info.shaft_speed.is_some(), "{what}");
                assert_eq!(reading.rejected, 0, "{what}");
                n_files += 1;
            }
        }
    }
    assert!(n_files > 0, "no captures in ROTORWATCH_DATA");
}
