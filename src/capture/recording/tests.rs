//! Recordings, from aligner to folder: nothing lost, nothing invented, whatever happens.

use super::align::{Act, Aligner};
use super::file::{Recorder, RecordingHeader};
use super::machine::{Event, MachineRecorder, RETRY_S, Settings};
use super::repair::{self, Repair};
use super::store::{Store, StoreEvent};
use crate::capture::hints::Hints;
use crate::capture::reader::{CaptureReader, Piece};
use crate::capture::received::{NumberType, RawSamples, Received, ReceivedChannel};
use crate::capture::writer::{CaptureHeader, CaptureWriter, ChannelHeader};
use crate::capture::writer::{ChannelSamples, ChannelStorage};
use crate::signal::{ChannelIndex, SampleIndex};
use crate::units::Hz;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use tempfile::TempDir;

const FAST_HZ: f64 = 2000.0;
const SLOW_HZ: f64 = 100.0;

/// Count of sample `index`: no two neighbours alike, and every index another.
fn count(index: u64) -> i16 {
    i16::try_from(index * 7 % 30_011).unwrap()
}

fn fast(range: std::ops::Range<u64>, segment: u32, time_s: f64) -> Received {
    let raw = RawSamples::I16(range.clone().map(count).collect());
    Received { channel: ChannelIndex(0), start: SampleIndex(range.start), segment, time_s, raw }
}

fn slow(range: std::ops::Range<u64>, segment: u32, time_s: f64) -> Received {
    let value = |i: u64| if i == 7 { f64::NAN } else { i as f64 / 3.0 };
    let raw = RawSamples::F64(range.clone().map(value).collect());
    Received { channel: ChannelIndex(1), start: SampleIndex(range.start), segment, time_s, raw }
}

fn channels() -> Vec<ReceivedChannel> {
    let channel = |name: &str, rate_hz, number_type, scale| ReceivedChannel {
        name: name.into(),
        sample_rate: Hz(rate_hz),
        number_type,
        scale,
        offset: 0.25,
        raw_zero: 0.0,
        unit: Some("g".into()),
        sensor: None,
    };
    vec![
        channel("fast", FAST_HZ, NumberType::I16, 0.5),
        channel("slow", SLOW_HZ, NumberType::F64, 1.0),
    ]
}

fn settings() -> Settings {
    Settings { segment_s: 1e6, segment_bytes: 1 << 40, flush_s: 1.0, gzip: None }
}

fn recorder(root: &Path, settings: Settings, max_bytes: u64) -> MachineRecorder {
    let store = Arc::new(Mutex::new(Store::open(root, max_bytes).0));
    MachineRecorder::new("rig-1", RecordingHeader::default(), channels(), settings, store)
}

/// `seconds` of both channels, a second at a time, the slow one late.
fn stream(seconds: std::ops::Range<u64>) -> Vec<Received> {
    let mut runs = Vec::new();
    for second in seconds {
        runs.push(fast(second * 2000..(second + 1) * 2000, 0, second as f64));
        runs.push(slow(second * 100..(second + 1) * 100, 0, second as f64));
    }
    runs
}

/// What a file holds: each channel's runs as (stream time of the first sample, samples).
fn contents(path: &Path) -> Vec<Received> {
    let mut reader = CaptureReader::open(path, None, &Hints::default()).unwrap();
    reader.keep_received();
    let mut runs = Vec::new();
    while let Some(piece) = reader.next_piece().unwrap() {
        if let Piece::Received(run) = piece {
            runs.push(run);
        }
    }
    runs
}

/// All int16 samples of the first channel, and bits of all float64 samples of the second.
fn samples(path: &Path) -> (Vec<i16>, Vec<u64>) {
    let (mut counts, mut bits) = (Vec::new(), Vec::new());
    for run in contents(path) {
        match run.raw {
            RawSamples::I16(raw) => counts.extend(raw),
            RawSamples::F64(raw) => bits.extend(raw.iter().map(|x| x.to_bits())),
            RawSamples::F32(_) | RawSamples::I32(_) => panic!("no such channel"),
        }
    }
    (counts, bits)
}

fn files(root: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(root.join("rig-1")) else { return Vec::new() };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_file_that_is_begun_after_a_change_says_what_holds_and_one_that_is_open_stays() {
    let root = TempDir::new().unwrap();
    let settings = Settings { segment_s: 5.0, ..settings() };
    let mut recorder = recorder(root.path(), settings, u64::MAX);
    recorder.renew("first".to_owned(), "crc32:1".to_owned());
    for (i, run) in stream(0..10).into_iter().enumerate() {
        if i == 6 {
            recorder.renew("second".to_owned(), "crc32:2".to_owned());
        }
        recorder.take(run, i as f64);
    }
    recorder.finish(20.0);
    let told = files(root.path()).into_iter().map(|file| {
        let reader = CaptureReader::open(&file, None, &Hints::default()).unwrap();
        reader.info().machine.clone().unwrap()
    });
    assert_eq!(told.collect::<Vec<_>>(), ["first", "second"]);
}

#[test]
fn what_was_received_is_read_back_bit_by_bit() {
    for gzip in [None, Some(1)] {
        let root = TempDir::new().unwrap();
        let mut recorder = recorder(root.path(), Settings { gzip, ..settings() }, u64::MAX);
        for (i, run) in stream(0..5).into_iter().enumerate() {
            recorder.take(run, i as f64);
        }
        recorder.finish(10.0);
        let [file] = &files(root.path())[..] else { panic!("one file") };
        let (counts, bits) = samples(file);
        assert_eq!(counts, (0..10_000).map(count).collect::<Vec<_>>());
        let expected = stream(0..5).into_iter().filter_map(|run| match run.raw {
            RawSamples::F64(raw) => Some(raw.iter().map(|x| x.to_bits()).collect::<Vec<_>>()),
            RawSamples::F32(_) | RawSamples::I16(_) | RawSamples::I32(_) => None,
        });
        assert_eq!(bits, expected.flatten().collect::<Vec<_>>(), "a NaN in between");
        let reader = CaptureReader::open(file, None, &Hints::default()).unwrap();
        let info = reader.info();
        assert!(info.notes.is_empty() && info.other_attributes.is_empty(), "{info}");
        let first = &info.channels[0];
        assert_eq!((first.scale, first.offset), (0.5, 0.25));
        assert_eq!(first.unit_text.as_deref(), Some("g"));
        assert_eq!(recorder.counts().n_recorded, 10_500);
        assert_eq!(recorder.counts().n_lost, 0);
    }
}

#[test]
fn a_gap_of_the_source_is_a_segment() {
    let root = TempDir::new().unwrap();
    let mut recorder = recorder(root.path(), settings(), u64::MAX);
    let later = |mut run: Received| {
        run.segment = 4;
        run.time_s += 60.0;
        run
    };
    let runs = stream(0..2).into_iter().chain(stream(2..4).into_iter().map(later));
    for run in runs {
        recorder.take(run, 0.0);
    }
    recorder.finish(0.0);
    let [file] = &files(root.path())[..] else { panic!("one file") };
    let runs = contents(file);
    assert_eq!(samples(file).0, (0..8000).map(count).collect::<Vec<_>>());
    let starts: Vec<_> =
        runs.iter().map(|run| (run.channel.0, run.segment, run.start.0, run.time_s)).collect();
    assert!(starts.contains(&(0, 1, 4000, 62.0)), "{starts:?}");
    assert!(starts.contains(&(1, 1, 200, 62.0)), "{starts:?}");
}

#[test]
fn a_seam_the_layout_cannot_express_begins_a_file() {
    let root = TempDir::new().unwrap();
    let mut recorder = recorder(root.path(), settings(), u64::MAX);
    // The slow channel has 3 samples more than the fast one's length allows.
    recorder.take(fast(0..2000, 0, 0.0), 0.0);
    recorder.take(slow(0..103, 0, 0.0), 0.0);
    recorder.take(fast(2000..4000, 1, 9.0), 0.0);
    recorder.take(slow(103..203, 1, 9.0), 0.0);
    recorder.finish(0.0);
    let [first, second] = &files(root.path())[..] else { panic!("two files") };
    assert_eq!((samples(first).0.len(), samples(first).1.len()), (2000, 103));
    assert_eq!((samples(second).0.len(), samples(second).1.len()), (2000, 100));
    assert!(contents(second).iter().all(|run| (run.time_s - 9.0).abs() < 1.0));
    assert_eq!(recorder.counts().n_lost, 0);
}

#[test]
fn lost_samples_begin_a_file_that_all_channels_begin_together() {
    let root = TempDir::new().unwrap();
    let mut recorder = recorder(root.path(), settings(), u64::MAX);
    for run in stream(0..2) {
        recorder.take(run, 0.0);
    }
    // Samples 4000..4500 of the fast channel never came.
    recorder.take(fast(4500..6000, 0, 2.25), 0.0);
    recorder.take(slow(200..300, 0, 2.0), 0.0);
    for run in stream(3..5) {
        recorder.take(run, 0.0);
    }
    recorder.finish(0.0);
    let [first, second] = &files(root.path())[..] else { panic!("two files") };
    assert_eq!(samples(first).0, (0..4000).map(count).collect::<Vec<_>>());
    assert_eq!(samples(first).1.len(), 300);
    assert_eq!(samples(second).0, (6000..10_000).map(count).collect::<Vec<_>>());
    assert_eq!(samples(second).1.len(), 200);
    assert_eq!(contents(second)[0].time_s.to_bits(), 3.0_f64.to_bits());
    // Between the loss and the next second the fast channel has no place.
    assert_eq!(recorder.counts().n_lost, 1500);
}

#[test]
fn files_roll_by_time_and_size_and_lose_nothing() {
    for (segment_s, segment_bytes) in [(2.0, u64::MAX), (1e6, 60_000)] {
        let root = TempDir::new().unwrap();
        let settings = Settings { segment_s, segment_bytes, ..settings() };
        let mut recorder = recorder(root.path(), settings, u64::MAX);
        for (i, run) in stream(0..40).into_iter().enumerate() {
            recorder.take(run, i as f64);
        }
        recorder.finish(100.0);
        let files = files(root.path());
        assert!(files.len() > 2, "{files:?}");
        let all: Vec<i16> = files.iter().flat_map(|file| samples(file).0).collect();
        assert_eq!(all, (0..80_000).map(count).collect::<Vec<_>>());
        let n_slow: usize = files.iter().map(|file| samples(file).1.len()).sum();
        assert_eq!(n_slow, 4000);
        for file in &files {
            let firsts: Vec<f64> = [0, 1]
                .iter()
                .map(|&c| contents(file).iter().find(|r| r.channel.0 == c).unwrap().time_s)
                .collect();
            assert_eq!(firsts[0].to_bits(), firsts[1].to_bits(), "both channels begin together");
        }
        assert_eq!(recorder.counts().n_lost, 0);
    }
}

#[test]
fn names_go_on_after_a_restart_and_nothing_is_overwritten() {
    let root = TempDir::new().unwrap();
    for _ in 0..2 {
        let mut recorder = recorder(root.path(), settings(), u64::MAX);
        stream(0..1).into_iter().for_each(|run| drop(recorder.take(run, 0.0)));
        recorder.finish(0.0);
    }
    fs::write(root.path().join("rig-1/rig-1-00000009.h5.damaged"), "x").unwrap();
    let mut last = recorder(root.path(), settings(), u64::MAX);
    stream(0..1).into_iter().for_each(|run| drop(last.take(run, 0.0)));
    last.finish(0.0);
    let names: Vec<_> = files(root.path())
        .iter()
        .map(|file| file.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let expected = [
        "rig-1-00000001.h5",
        "rig-1-00000002.h5",
        "rig-1-00000009.h5.damaged",
        "rig-1-00000010.h5",
    ];
    assert_eq!(names, expected);
    let taken = root.path().join("rig-1/rig-1-00000010.h5");
    let refused = Recorder::create(&taken, &RecordingHeader::default(), &channels(), None);
    assert!(refused.unwrap_err().to_string().contains("cannot record to it"));
}

#[test]
fn the_oldest_finished_recording_gives_way() {
    let root = TempDir::new().unwrap();
    let settings = Settings { segment_s: 2.0, ..settings() };
    let max_bytes = 120_000;
    let mut recorder = recorder(root.path(), settings, max_bytes);
    let mut removed = Vec::new();
    for (i, run) in stream(0..40).into_iter().enumerate() {
        for event in recorder.take(run, i as f64) {
            if let Event::Store(StoreEvent::Removed { file, .. }) = event {
                removed.push(file);
            }
        }
        let total: u64 = files(root.path()).iter().map(|f| fs::metadata(f).unwrap().len()).sum();
        assert!(total <= max_bytes + 40_000, "{total}: a second more than at the last flush");
    }
    recorder.finish(100.0);
    assert!(removed.len() > 5 && removed.is_sorted(), "{removed:?}");
    assert_eq!(recorder.counts().n_removed, removed.len() as u64);
    let left = files(root.path());
    assert!(!left.is_empty() && left.iter().all(|file| !removed.contains(file)));
    assert!(removed.last() < left.first(), "the newest stay: {left:?}");
    assert_eq!(recorder.counts().holdings.n_files, left.len() as u64);
    assert_eq!(samples(left.last().unwrap()).0.last(), Some(&count(79_999)));
}

#[test]
fn a_folder_that_cannot_be_written_is_told_counted_and_tried_again() {
    let root = TempDir::new().unwrap();
    let blocked = root.path().join("rig-1");
    fs::write(&blocked, "a file where the folder should be").unwrap();
    let mut recorder = recorder(root.path(), settings(), u64::MAX);
    let failed = |events: &[Event]| events.iter().any(|e| matches!(e, Event::Failed { .. }));
    let told: Vec<bool> =
        stream(0..3).into_iter().map(|run| failed(&recorder.take(run, 0.5))).collect();
    assert_eq!(told.iter().filter(|told| **told).count(), 1, "once a pause: {told:?}");
    assert_eq!(recorder.counts().n_lost, 3 * 2100);
    assert!(recorder.counts().failure.unwrap().contains("make a folder"));
    fs::remove_file(&blocked).unwrap();
    for run in stream(3..9) {
        recorder.take(run, 1.0 + RETRY_S);
    }
    assert_eq!(recorder.counts().failure, None);
    recorder.finish(20.0);
    let [file] = &files(root.path())[..] else { panic!("one file") };
    let (counts, bits) = samples(file);
    let counted = recorder.counts();
    assert_eq!(counted.n_recorded, (counts.len() + bits.len()) as u64);
    assert_eq!(counted.n_recorded + counted.n_lost, 9 * 2100);
    assert_eq!(counts.last(), Some(&count(17_999)));
    assert_eq!(contents(file)[0].time_s.fract().to_bits(), 0.0_f64.to_bits());
}

/// Leaves a recording as a kill does: flushed, and never closed.
fn killed(root: &Path) -> PathBuf {
    let folder = root.join("rig-1");
    fs::create_dir_all(&folder).unwrap();
    let (live, path) = (folder.join("live.h5"), folder.join("rig-1-00000003.h5"));
    let header = RecordingHeader::default();
    let mut file = Recorder::create(&live, &header, &channels(), None).unwrap();
    assert!(file.begin(&[Some(0), Some(0)], 5.0).unwrap());
    file.write(&fast(0..3000, 0, 5.0)).unwrap();
    file.write(&slow(0..120, 0, 5.0)).unwrap();
    file.flush().unwrap();
    // Taken, not flushed: a kill takes it.
    file.write(&fast(3000..3010, 0, 6.5)).unwrap();
    fs::copy(&live, &path).unwrap();
    file.close().unwrap();
    fs::remove_file(&live).unwrap();
    path
}

#[test]
fn a_recording_left_open_reads_before_and_after_the_repair() {
    let root = TempDir::new().unwrap();
    let path = killed(root.path());
    let told = CaptureReader::open(&path, None, &Hints::default()).unwrap().info().to_string();
    assert!(told.contains("left open") && told.contains("--repair"), "{told}");
    let before = contents(&path);
    assert_eq!(samples(&path).0, (0..3000).map(count).collect::<Vec<_>>());
    let expected = vec![("fast".to_owned(), 3000), ("slow".to_owned(), 120)];
    assert_eq!(repair::repair(&path).unwrap(), Repair::Repaired { samples: expected });
    assert_eq!(format!("{:?}", contents(&path)), format!("{before:?}"), "NaN is not itself");
    assert!(CaptureReader::open(&path, None, &Hints::default()).unwrap().info().notes.is_empty());
    let bytes = fs::read(&path).unwrap();
    assert_eq!(repair::repair(&path).unwrap(), Repair::NothingToDo);
    assert_eq!(fs::read(&path).unwrap(), bytes, "a file that is closed is not touched");
}

#[test]
fn a_recording_being_written_is_not_repaired() {
    let root = TempDir::new().unwrap();
    let path = root.path().join("live.h5");
    let mut file = Recorder::create(&path, &RecordingHeader::default(), &channels(), None).unwrap();
    file.begin(&[Some(0), Some(0)], 0.0).unwrap();
    file.write(&fast(0..3000, 0, 0.0)).unwrap();
    file.flush().unwrap();
    assert!(CaptureReader::open(&path, None, &Hints::default()).is_ok(), "read while written");
    let error = repair::repair(&path).unwrap_err().to_string();
    assert!(error.contains("a recorder is writing it"), "{error}");
    file.close().unwrap();
    assert_eq!(repair::repair(&path).unwrap(), Repair::NothingToDo);
}

#[test]
fn the_store_recovers_at_start_and_deletes_nothing_it_cannot_read() {
    let root = TempDir::new().unwrap();
    let path = killed(root.path());
    let folder = root.path().join("rig-1");
    let broken = folder.join("rig-1-00000001.h5");
    let mut bytes = fs::read(&path).unwrap();
    bytes.truncate(1000);
    fs::write(&broken, &bytes).unwrap();
    fs::write(folder.join("rig-1-00000002.h5"), "").unwrap();
    fs::write(folder.join(".rig-1-00000004.h5.77.part"), "never complete").unwrap();
    let (store, events) = Store::open(root.path(), u64::MAX);
    let told: Vec<String> = events
        .iter()
        .map(|event| match event {
            StoreEvent::Recovered { samples, .. } => format!("recovered {samples:?}"),
            StoreEvent::Damaged { aside, .. } => {
                format!("damaged {}", aside.file_name().unwrap().display())
            }
            StoreEvent::TemporaryRemoved { .. } => "temporary".to_owned(),
            StoreEvent::Removed { .. } | StoreEvent::Unusable { .. } => panic!("{event:?}"),
        })
        .collect();
    let expected = [
        "temporary",
        "damaged rig-1-00000001.h5.damaged",
        "damaged rig-1-00000002.h5.damaged",
        "recovered [(\"fast\", 3000), (\"slow\", 120)]",
    ];
    assert_eq!(told, expected);
    assert_eq!(fs::read(folder.join("rig-1-00000001.h5.damaged")).unwrap(), bytes);
    assert_eq!(store.holdings("rig-1").n_files, 1);
    assert!(store.next_file("rig-1").unwrap().ends_with("rig-1-00000004.h5"));
}

#[test]
fn the_store_takes_and_removes_nothing_but_recordings() {
    let root = TempDir::new().unwrap();
    let folder = root.path().join("rig-1");
    fs::create_dir_all(&folder).unwrap();
    let header = CaptureHeader::default();
    let mut finished = CaptureWriter::create(&folder.join("rig-1-00000001.h5"), &header).unwrap();
    let channel = ChannelHeader {
        name: "x".to_owned(),
        sample_rate: Hz(FAST_HZ),
        unit: None,
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    finished.channel(&channel, ChannelSamples::F32(&[0.0; 1000])).unwrap();
    finished.finish().unwrap();
    let ours = [".rig-1-00000007.h5.77.part"];
    let others = ["archive.h5", ".sync.part", "rig-1-notes.h5", "rig-2-00000001.h5"];
    for name in ours.iter().chain(&others) {
        fs::write(folder.join(name), "x").unwrap();
    }
    let outside = TempDir::new().unwrap();
    fs::write(outside.path().join("linked-00000001.h5"), "x").unwrap();
    std::os::unix::fs::symlink(outside.path(), root.path().join("linked")).unwrap();
    // Another recorder is at work here: what it has not yet named stays.
    let live = Recorder::create(
        &folder.join("rig-1-00000008.h5"),
        &RecordingHeader::default(),
        &channels(),
        None,
    )
    .unwrap();
    let (_, events) = Store::open(root.path(), 0);
    assert!(matches!(events[..], [StoreEvent::TemporaryRemoved { .. }]), "{events:?}");
    for name in others.iter().chain(&["rig-1-00000001.h5"]) {
        assert!(folder.join(name).exists(), "{name}");
    }
    assert!(outside.path().join("linked-00000001.h5").exists());
    drop(live);
    assert!(!folder.join(ours[0]).exists());
}

#[test]
fn a_repair_changes_nothing_but_the_flag() {
    let root = TempDir::new().unwrap();
    let path = killed(root.path());
    let before = fs::metadata(&path).unwrap().modified().unwrap();
    let bytes = fs::read(&path).unwrap();
    assert!(matches!(repair::repair(&path).unwrap(), Repair::Repaired { .. }));
    assert_eq!(fs::metadata(&path).unwrap().modified().unwrap(), before, "keeps its age");
    assert!(fs::read(&path).unwrap()[48..] == bytes[48..], "behind the superblock");
    let table = root.path().join("x.csv");
    fs::write(&table, "t,x\n0,1\n1,2\n2,3\n3,4\n").unwrap();
    let error = repair::repair(&table).unwrap_err().to_string();
    assert!(error.contains("no recording of the daemon"), "{error}");
}

#[test]
fn a_channel_that_stays_away_does_not_hold_the_others_for_ever() {
    let mut aligner = Aligner::new(vec![FAST_HZ, SLOW_HZ]);
    let mut n_written = 0;
    for second in 0..20_u64 {
        for act in aligner.take(fast(second * 2000..(second + 1) * 2000, 0, second as f64)) {
            if let Act::Write(run) = act {
                n_written += run.raw.len();
            }
        }
    }
    assert!(n_written >= 30_000, "{n_written}");
    let ended = aligner.finish();
    assert!(ended.is_empty(), "nothing is held any longer");
}
