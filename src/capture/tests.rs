//! Write → read over every type, byte order, storage and segmentation; and every refusal.

use super::error::CaptureError;
use super::hdf5::{NewFile, NewStorage};
use super::hints::Hints;
use super::reader::{CaptureReader, ReadReport};
use super::writer::{CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage};
use crate::machine::Machine;
use crate::machine::limits::Limits;
use crate::machine::sensor::{Sensor, SensorKind};
use crate::signal::{Block, SampleIndex, Timestamp};
use crate::units::{Hz, SourceUnit, Unit};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

pub(super) fn channel(name: &str, rate_hz: f64, storage: ChannelStorage) -> ChannelHeader {
    ChannelHeader {
        name: name.into(),
        sample_rate: Hz(rate_hz),
        unit: Some("m/s^2".into()),
        sensor: Some("accelerometer".into()),
        storage,
    }
}

fn read_all(path: &Path) -> (CaptureReader, Vec<Block>, ReadReport) {
    let mut reader = CaptureReader::open(path, None, &Hints::default()).unwrap();
    let mut blocks = Vec::new();
    while let Some(block) = reader.next_block().unwrap() {
        blocks.push(block);
    }
    let report = reader.report();
    (reader, blocks, report)
}

/// A file in a folder that vanishes with the value.
pub(super) fn scratch() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    (folder, path)
}

/// Writes a file with bare library calls, for what [`CaptureWriter`] refuses to make.
pub(super) fn crafted(build: impl FnOnce(&NewFile)) -> (tempfile::TempDir, PathBuf) {
    let (folder, path) = scratch();
    let file = NewFile::create(&path).unwrap();
    build(&file);
    file.close().unwrap();
    (folder, path)
}

fn refused(path: &Path) -> String {
    let error = CaptureReader::open(path, None, &Hints::default()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("a.h5"), "names the file: {text}");
    text
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    F32,
    F64,
    I16,
    I32,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn what_is_written_is_read(
        kind in prop_oneof![Just(Kind::F32), Just(Kind::F64), Just(Kind::I16), Just(Kind::I32)],
        big_endian in any::<bool>(),
        chunk in prop_oneof![Just(None), (1..3000_usize).prop_map(Some)],
        counts in prop::collection::vec(any::<i16>(), 1..20_000),
        rate_hz in prop_oneof![Just(50.0), Just(1000.0), Just(25_600.0)],
        scale in 1e-3..10.0_f64,
        offset in -100.0..100.0_f64,
        cuts in prop::collection::btree_set(1..20_000_u64, 0..5),
    ) {
        let (_folder, path) = scratch();
        // A chunk of one sample is legal but slow to write; a few thousand of them suffice.
        let counts = if chunk.is_some_and(|n| n < 20) { &counts[..counts.len().min(500)] } else { &counts[..] };
        let storage = chunk.map_or(ChannelStorage::Contiguous, |chunk_samples| {
            ChannelStorage::Compressed { chunk_samples, level: 1 }
        });
        let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
        if big_endian {
            writer.store_big_endian();
        }
        let header = channel("x", rate_hz, storage);
        let physical: Vec<f64> = counts.iter().map(|&n| f64::from(n) * scale + offset).collect();
        #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
        let f32s: Vec<f32> = physical.iter().map(|&x| x as f32).collect();
        let wide: Vec<i32> = counts.iter().map(|&n| i32::from(n) * 60_000).collect();
        match kind {
            Kind::F32 => writer.channel(&header, ChannelSamples::F32(&f32s)),
            Kind::F64 => writer.channel(&header, ChannelSamples::F64(&physical)),
            Kind::I16 => writer.channel(&header, ChannelSamples::I16 { counts, scale, offset }),
            Kind::I32 => writer.channel(
                &header,
                ChannelSamples::I32 { counts: &wide, scale: scale / 60_000.0, offset },
            ),
        }
        .unwrap();
        let starts: Vec<SampleIndex> = std::iter::once(0)
            .chain(cuts.into_iter().filter(|&at| at < counts.len() as u64))
            .map(SampleIndex)
            .collect();
        let times_s: Vec<f64> = (0..starts.len()).map(|k| k as f64 * 1000.0).collect();
        writer.segments(&starts, &times_s).unwrap();
        writer.finish().unwrap();

        let (reader, blocks, report) = read_all(&path);
        let info = &reader.info().channels[0].info;
        prop_assert_eq!(report.samples_read, counts.len() as u64);
        prop_assert_eq!(report.samples_rejected(), 0);
        let mut at = 0_usize;
        for block in &blocks {
            prop_assert_eq!(block.start, SampleIndex(at as u64));
            prop_assert!(block.samples.len() as f64 <= rate_hz);
            let segment = starts.iter().rposition(|start| *start <= block.start).unwrap();
            prop_assert_eq!(block.segment as usize, segment);
            let end = starts.get(segment + 1).map_or(u64::MAX, |next| next.0);
            prop_assert!(block.end().0 <= end, "no block spans a segment");
            let time_s = times_s[segment] + (at as u64 - starts[segment].0) as f64 / rate_hz;
            prop_assert!((block.time_s - time_s).abs() < 1e-9);
            for sample in &block.samples {
                let found = f64::from(*sample) + info.offset;
                // f32 rounding of the value written and of the product read: three of 6e-8.
                let scatter = 2e-7 * (f64::from(*sample).abs() + physical[at].abs());
                prop_assert!((found - physical[at]).abs() <= scatter + 1e-12, "{} {}", found, physical[at]);
                at += 1;
            }
        }
        prop_assert_eq!(at, counts.len());
    }
}

#[test]
fn channels_of_different_rates_come_interleaved_in_time() {
    let (_folder, path) = scratch();
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let fast: Vec<f32> = (0..50_000_u16).map(f32::from).collect();
    let packed = ChannelStorage::Compressed { chunk_samples: 30_000, level: 4 };
    writer.channel(&channel("fast", 10_000.0, packed), ChannelSamples::F32(&fast)).unwrap();
    let plain = ChannelStorage::Contiguous;
    writer.channel(&channel("slow", 10.0, plain), ChannelSamples::F32(&fast[..70])).unwrap();
    writer.finish().unwrap();
    let (reader, blocks, report) = read_all(&path);
    assert_eq!(report.samples_read, 50_070);
    // Ends at the later of 5 s and 7 s; division of integers by their rates, exact.
    assert!((reader.info().duration_s - 7.0).abs() < 1e-12);
    assert!(blocks.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
    let rejoined: Vec<f32> =
        blocks.iter().filter(|b| b.channel.0 == 0).flat_map(|b| b.samples.clone()).collect();
    assert_eq!(rejoined, fast);
}

#[test]
fn the_header_comes_back() {
    let (_folder, path) = scratch();
    let header = CaptureHeader {
        start_time: Some(Timestamp(1_772_366_400_123_000_000)),
        machine: Some("[machine]\nid = \"größe\"\n".repeat(4000)),
        shaft_speed: Some(Hz(29.95)),
    };
    let mut writer = CaptureWriter::create(&path, &header).unwrap();
    let plain = ChannelStorage::Contiguous;
    writer.channel(&channel("x", 100.0, plain), ChannelSamples::F32(&[1.0; 10])).unwrap();
    writer.finish().unwrap();
    let reader = CaptureReader::open(&path, None, &Hints::default()).unwrap();
    let info = reader.info();
    assert_eq!(info.start_time, header.start_time);
    assert_eq!(info.machine, header.machine);
    assert_eq!(info.shaft_speed, header.shaft_speed);
    assert!(info.format_stated && info.other_attributes.is_empty() && info.missing().is_empty());
    assert_eq!(info.channels[0].info.unit, Unit::MetrePerSecondSquared);
    assert!(info.to_string().contains("channel x: 10 samples at 100 Hz"), "{info}");
}

#[test]
fn samples_that_are_no_numbers_leave_counted_gaps() {
    let (_folder, path) = scratch();
    let mut samples = vec![1.0_f32; 100];
    for (at, bad) in [(0, f32::NAN), (40, f32::INFINITY), (41, f32::NEG_INFINITY), (99, f32::NAN)] {
        samples[at] = bad;
    }
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let plain = ChannelStorage::Contiguous;
    writer.channel(&channel("x", 1000.0, plain), ChannelSamples::F32(&samples)).unwrap();
    writer.finish().unwrap();
    let (_, blocks, report) = read_all(&path);
    let runs: Vec<(u64, u64)> = blocks.iter().map(|b| (b.start.0, b.end().0)).collect();
    assert_eq!(runs, [(1, 40), (42, 99)]);
    assert_eq!((report.samples_read, report.samples_rejected()), (96, 4));
    assert_eq!(report.reasons(), ["not finite numbers"]);
}

#[test]
fn an_abandoned_capture_leaves_nothing_and_a_finished_one_replaces() {
    let (folder, path) = scratch();
    std::fs::write(&path, "old").unwrap();
    drop(CaptureWriter::create(&path, &CaptureHeader::default()).unwrap());
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let plain = ChannelStorage::Contiguous;
    writer.channel(&channel("x", 1.0, plain), ChannelSamples::F32(&[0.0])).unwrap();
    writer.finish().unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(read_all(&path).2.samples_read, 1);
}

#[test]
fn the_writer_refuses_what_no_reader_would_accept() {
    let (_folder, path) = scratch();
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let plain = ChannelStorage::Contiguous;
    let mut refuse = |header: &ChannelHeader, samples| {
        let error = writer.channel(header, samples).unwrap_err();
        assert!(matches!(error, CaptureError::Content { .. }), "{error}");
    };
    refuse(&channel("a/b", 1.0, plain), ChannelSamples::F32(&[0.0]));
    refuse(&channel("x", 0.0, plain), ChannelSamples::F32(&[0.0]));
    refuse(&channel("x", 1.0, plain), ChannelSamples::F32(&[]));
    let unit = ChannelHeader { unit: Some("furlong".into()), ..channel("x", 1.0, plain) };
    refuse(&unit, ChannelSamples::F32(&[0.0]));
    let flat = ChannelSamples::I16 { counts: &[1], scale: 0.0, offset: 0.0 };
    refuse(&channel("x", 1.0, plain), flat);
}

#[test]
fn files_that_are_no_captures_say_what_they_are() {
    let (_folder, path) = scratch();
    std::fs::write(&path, "").unwrap();
    assert!(refused(&path).contains("it is empty"));
    std::fs::write(&path, vec![1; 5000]).unwrap();
    assert!(refused(&path).contains("no HDF5 signature"));
    std::fs::write(&path, vec![b'x'; 5000]).unwrap();
    assert!(refused(&path).contains("text without a table of numbers"));
    std::fs::write(&path, b"MATLAB 5.0 MAT-file, Platform: GLNXA64").unwrap();
    assert!(refused(&path).contains("save -v7.3"));
    assert!(matches!(
        CaptureReader::open(&path.with_extension("no"), None, &Hints::default()).unwrap_err(),
        CaptureError::Io { .. }
    ));
    let (_folder, path) = crafted(|file| {
        file.group("measurement").unwrap();
    });
    assert!(refused(&path).contains("it holds measurement"));
    let (_folder, path) = crafted(|file| {
        file.group("channels").unwrap();
    });
    assert!(refused(&path).contains("no data set under /channels"));
}

/// A file with one float32 channel `x`, and what `more` adds to it.
pub(super) fn one_channel(
    rate: Option<f64>,
    more: impl FnOnce(&NewFile),
) -> (tempfile::TempDir, PathBuf) {
    crafted(|file| {
        let group = file.group("channels").unwrap();
        let dataset = group.dataset("x", &[0.5_f32; 100], NewStorage::default()).unwrap();
        if let Some(rate) = rate {
            dataset.number("sample_rate_hz", rate).unwrap();
        }
        more(file);
    })
}

#[test]
fn wrong_root_attributes_are_named_and_others_ignored() {
    let (_folder, path) = one_channel(Some(10.0), |file| file.text("format", "hdf-eos").unwrap());
    let text = refused(&path);
    assert!(text.contains("attribute format: found \"hdf-eos\""), "{text}");
    let (_folder, path) = one_channel(Some(10.0), |file| file.number("version", 2_u8).unwrap());
    assert!(refused(&path).contains("attribute version: found 2, expected 1"));
    let (_folder, path) = one_channel(Some(10.0), |file| file.text("start_time", "noon").unwrap());
    assert!(refused(&path).contains("RFC 3339"));
    let (_folder, path) =
        one_channel(Some(10.0), |file| file.number("shaft_speed_hz", f64::NAN).unwrap());
    assert!(refused(&path).contains("shaft_speed_hz: found NaN"));
    let load = |path| CaptureReader::open(path, None, &Hints::default()).unwrap().info().load;
    let (_folder, path) = one_channel(Some(10.0), |file| file.number("load", 2_u8).unwrap());
    assert_eq!(load(&path), Some(2.0));
    let (_folder, path) = one_channel(Some(10.0), |file| file.text("load", "2 hp").unwrap());
    assert_eq!(load(&path), None, "a note, not a number");
    let (_folder, path) = one_channel(Some(10.0), |file| {
        for k in 0..20_u16 {
            file.number(&format!("load_{k:02}"), k).unwrap(); // 20: dense attribute storage
        }
        file.number("version", 1.0_f32).unwrap();
        file.number("shaft_speed_hz", 25_i16).unwrap();
        file.group("truth").unwrap();
    });
    let reader = CaptureReader::open(&path, None, &Hints::default()).unwrap();
    assert_eq!(reader.info().shaft_speed, Some(Hz(25.0)));
    assert_eq!(reader.info().other_attributes.len(), 20);
    assert!(reader.info().missing().iter().any(|line| line.starts_with("format")));
}

#[test]
fn wrong_channels_are_named() {
    let (_folder, path) = one_channel(None, |_| {});
    let text = refused(&path);
    assert!(text.contains("channels/x: attribute sample_rate_hz: found none"), "{text}");
    let (_folder, path) = one_channel(Some(-1.0), |_| {});
    assert!(refused(&path).contains("found -1"));
    let hints = Hints { rate: Some(Hz(50.0)), ..Hints::default() };
    let reader = CaptureReader::open(&path, None, &hints).unwrap();
    assert_eq!(
        reader.info().channels[0].info.sample_rate,
        Hz(50.0),
        "the remedy that is named helps"
    );
    let told = "channels/x: attribute sample_rate_hz is -1: not used, 50 Hz of --rate are";
    assert_eq!(reader.info().notes, [told]);
    let (_folder, path) = crafted(|file| {
        let group = file.group("channels").unwrap();
        let dataset = group.dataset("x", &[0_i16; 100], NewStorage::default()).unwrap();
        dataset.text("sample_rate_hz", "2 kHz").unwrap();
    });
    assert!(refused(&path).contains("found \"2 kHz\", expected samples a second, a number"));
    let reader = CaptureReader::open(&path, None, &hints).unwrap();
    assert_eq!(reader.info().channels[0].info.sample_rate, Hz(50.0));
    let (_folder, path) = crafted(|file| {
        let group = file.group("channels").unwrap();
        let dataset = group.dataset("x", &[0_u8; 100], NewStorage::default()).unwrap();
        dataset.number("sample_rate_hz", 1.0).unwrap();
    });
    assert!(refused(&path).contains("expected float32, float64, int16 or int32"));
    let (_folder, path) = crafted(|file| {
        let group = file.group("channels").unwrap();
        let dataset = group.dataset("x", &[0_i16; 100], NewStorage::default()).unwrap();
        dataset.number("sample_rate_hz", 1.0).unwrap();
        dataset.number("scale", 0.0).unwrap();
    });
    assert!(refused(&path).contains("attribute scale: found scale 0"));
}

#[test]
fn oversized_chunks_and_broken_segments_are_named() {
    let (_folder, path) = crafted(|file| {
        let group = file.group("channels").unwrap();
        let storage = NewStorage { compressed: Some((9 << 20, 1)), big_endian: false };
        let dataset = group.dataset("x", &vec![0_f64; 9 << 20], storage).unwrap();
        dataset.number("sample_rate_hz", 1.0).unwrap();
    });
    let text = refused(&path);
    assert!(text.contains("over the limit of 67108864") && text.contains("h5repack"), "{text}");
    let segments = |starts: &[i64], times: &[f64]| {
        let (_folder, path) = one_channel(Some(10.0), |file| {
            let group = file.group("segments").unwrap();
            group.dataset("start_sample", starts, NewStorage::default()).unwrap();
            group.dataset("time_s", times, NewStorage::default()).unwrap();
        });
        refused(&path)
    };
    assert!(segments(&[0, 100], &[0.0, 1.0]).contains("outside the 100 samples"));
    assert!(segments(&[0, 9, 9], &[0.0, 1.0, 2.0]).contains("start_sample[2]"));
    assert!(segments(&[0], &[0.0, 1.0]).contains("same number"));
    let (_folder, path) = one_channel(Some(10.0), |file| {
        file.group("segments").unwrap();
    });
    assert!(refused(&path).contains("/segments/start_sample"));
}

/// A capture of 100 samples with a table of checksums and the attribute `checksum` as given.
fn with_sums(sums: &[u32], samples: Option<u64>, statement: Option<u32>) -> String {
    let (_folder, path) = one_channel(Some(10.0), |file| {
        let group = file.group("checksums").unwrap();
        let table = group.dataset("x", sums, NewStorage::default()).unwrap();
        table.number("block_samples", 64_u64).unwrap();
        if let Some(samples) = samples {
            table.number("samples", samples).unwrap();
        }
        if let Some(statement) = statement {
            file.number("checksum", statement).unwrap();
        }
    });
    match CaptureReader::open(&path, None, &Hints::default()) {
        Err(error) => error.to_string(),
        Ok(mut reader) => loop {
            match reader.next_block() {
                Ok(Some(_)) => {}
                Ok(None) => return "read".into(),
                Err(error) => return error.to_string(),
            }
        },
    }
}

#[test]
fn checksums_that_do_not_fit_are_named() {
    let bytes = [0.5_f32; 100].map(f32::to_le_bytes).concat();
    let right = [crc32fast::hash(&bytes[..256]), crc32fast::hash(&bytes[256..])];
    let contains = |text: String, word: &str| assert!(text.contains(word), "{word}: {text}");
    contains(with_sums(&right, Some(99), Some(0)), "for 99 samples, and /channels/x has 100");
    contains(with_sums(&right[..1], Some(100), Some(0)), "need another number");
    contains(with_sums(&right, Some(100), None), "no attribute checksum");
    contains(with_sums(&right, Some(100), Some(7)), "attributes or segments differ");
    // Being recorded: complete blocks only, the rest unverified.
    assert_eq!(with_sums(&right[..1], None, None), "read");
    contains(with_sums(&right, None, None), "the channel has only 100");
    contains(with_sums(&[7], None, None), "samples 0 to 63 differ from their checksum");
    let missing = |group: Option<&str>| {
        let (_folder, path) = one_channel(Some(10.0), |file| {
            file.number("checksum", 7_u32).unwrap();
            if let Some(table) = group {
                let group = file.group("checksums").unwrap();
                group.dataset(table, &right, NewStorage::default()).unwrap();
            }
        });
        refused(&path)
    };
    contains(missing(None), "/checksums: missing");
    contains(missing(Some("y")), "checksums/y: checksums of a channel that is missing");
    contains(missing(Some("x")), "no attribute block_samples");
}

pub(super) fn machine_with(sensors: Vec<Sensor>) -> Machine {
    Machine {
        id: "rig-1".into(),
        name: "rig".into(),
        iso_group: None,
        power_kw: None,
        shafts: Vec::new(),
        bearings: Vec::new(),
        motors: Vec::new(),
        gears: Vec::new(),
        sensors,
        limits: Limits::default(),
        alarm_limits: crate::machine::alarm_limit::AlarmLimits::default(),
        capture_map: std::collections::BTreeMap::new(),
        notes: Vec::new(),
    }
}

pub(super) fn sensor(channel: &str, unit: &str) -> Sensor {
    Sensor {
        channel: channel.into(),
        kind: SensorKind::Accelerometer,
        unit: SourceUnit::parse(unit).map(|parsed| (unit.to_owned(), parsed)),
        at: None,
        axis_deg: None,
        direction: None,
        usable: None,
        sensitivity_v_per_unit: None,
        gap_v: None,
        tacho: None,
    }
}

#[test]
fn a_unit_that_an_option_gives_is_none_that_the_checksum_covers() {
    let (_folder, path) = scratch();
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let unstated = ChannelHeader { unit: None, ..channel("x", 100.0, ChannelStorage::Contiguous) };
    writer.channel(&unstated, ChannelSamples::F32(&[1.0, -2.0])).unwrap();
    writer.finish().unwrap();
    let hints = Hints { unit: Some("g".to_owned()), ..Hints::default() };
    let mut reader = CaptureReader::open(&path, None, &hints).unwrap();
    assert_eq!(reader.info().channels[0].info.unit, Unit::MetrePerSecondSquared);
    assert_eq!(reader.next_block().unwrap().unwrap().samples, [9.806_65, -19.613_3]);
}

#[test]
fn the_machine_files_unit_scales_the_samples_and_absent_channels_are_listed() {
    let (_folder, path) = scratch();
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    let plain = ChannelStorage::Contiguous;
    writer.channel(&channel("x", 100.0, plain), ChannelSamples::F32(&[1.0, -2.0])).unwrap();
    writer.finish().unwrap();
    let machine = machine_with(vec![sensor("x", "g"), sensor("z", "g")]);
    let mut reader = CaptureReader::open(&path, Some(&machine), &Hints::default()).unwrap();
    let info = reader.info();
    assert_eq!(info.absent_channels, ["z"]);
    let conflict = Some(("m/s^2".to_owned(), "g".to_owned()));
    assert_eq!(info.channels[0].info.unit_conflict, conflict);
    assert!(info.to_string().contains("channel z: named by a sensor"), "{info}");
    // 1 g = 9.80665 m/s², rounded to f32 once.
    assert_eq!(reader.next_block().unwrap().unwrap().samples, [9.806_65, -19.613_3]);
    assert_eq!(reader.next_block().unwrap(), None);
}
