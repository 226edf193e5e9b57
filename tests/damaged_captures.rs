//! Captures as the world hands them in: truncated, with flipped bytes, and written by others.
//!
//! Every call into the reader is weighed: what it allocates in all, freed or not, is an upper
//! bound of its largest allocation. An endless loop shows as a test that does not end.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test may panic; clippy exempts only #[test] functions"
)]
#![expect(clippy::print_stdout, reason = "a skipped test says so")]

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::error::CaptureError;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::writer::{
    CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage,
};
use rotorwatch::signal::{Block, SampleIndex, Timestamp};
use rotorwatch::units::Hz;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes one call may allocate in all.
const ALLOCATION_MAX: usize = 256 << 20;

/// The allocator counts the whole process, so these tests run one at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Does `work` and fails if it allocated too much, or asked for it in vain.
fn weighed<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let region = Region::new(ALLOCATOR);
    let result = work();
    let bytes = region.change().bytes_allocated;
    assert!(bytes <= ALLOCATION_MAX, "{what}: {bytes} bytes allocated by one call");
    result
}

/// Reads everything; whatever is read without an error must agree with what was declared.
fn read(path: &Path, what: &str) -> Result<(CaptureReader, Vec<Block>), CaptureError> {
    let mut reader = weighed(what, || CaptureReader::open(path, None, &Hints::default()))?;
    let declared: u64 = reader.info().channels.iter().map(|channel| channel.n_samples).sum();
    let mut blocks = Vec::new();
    let mut seen = 0;
    while let Some(block) = weighed(what, || reader.next_block())? {
        assert!(block.samples.iter().all(|sample| sample.is_finite()), "{what}");
        assert!(!block.samples.is_empty(), "{what}");
        seen += block.samples.len() as u64;
        assert!(seen <= declared, "{what}: more samples than declared");
        // Huge but legal declarations are read through, not kept.
        if seen < 1 << 20 {
            blocks.push(block);
        }
    }
    let report = reader.report();
    assert_eq!(report.samples_read, seen, "{what}");
    assert_eq!(seen + report.samples_rejected(), declared, "{what}: every sample is accounted for");
    Ok((reader, blocks))
}

fn tone(n: usize) -> Vec<f32> {
    (0..n).map(|k| (k as f32 * 0.3).sin()).collect()
}

/// A small capture with a float and an integer channel, segments and all attributes.
fn write(path: &Path, n: usize, storage: ChannelStorage) {
    let header = CaptureHeader {
        start_time: Some(Timestamp(1_772_366_400_000_000_000)),
        machine: Some("[machine]\nid = \"rig-1\"\n".into()),
        shaft_speed: Some(Hz(10.0)),
    };
    let mut writer = CaptureWriter::create(path, &header).unwrap();
    let channel = |name: &str, rate_hz| ChannelHeader {
        name: name.into(),
        sample_rate: Hz(rate_hz),
        unit: Some("g".into()),
        sensor: Some("accelerometer".into()),
        storage,
    };
    writer.channel(&channel("x", 2000.0), ChannelSamples::F32(&tone(n))).unwrap();
    #[expect(clippy::cast_possible_truncation, reason = "at most 30 000")]
    let counts: Vec<i16> = tone(n / 2).iter().map(|x| (x * 3e4) as i16).collect();
    let counts = ChannelSamples::I16 { counts: &counts, scale: 1e-3, offset: 0.5 };
    writer.channel(&channel("y", 1000.0), counts).unwrap();
    let half = SampleIndex(n as u64 / 2);
    writer.segments(&[SampleIndex(0), half], &[0.0, 60.0]).unwrap();
    writer.finish().unwrap();
}

fn small_captures(folder: &Path) -> Vec<PathBuf> {
    let packed = ChannelStorage::Compressed { chunk_samples: 1000, level: 6 };
    let tiny = ChannelStorage::Compressed { chunk_samples: 64, level: 6 };
    let cases = [
        ("plain.h5", 12_000, ChannelStorage::Contiguous),
        ("gzip.h5", 20_000, packed),
        ("headers.h5", 400, tiny),
    ];
    let make = |(name, n, storage)| {
        let path = folder.join(name);
        write(&path, n, storage);
        path
    };
    cases.into_iter().map(make).collect()
}

#[test]
fn the_scale_sees_a_large_allocation() {
    let _alone = alone();
    let overweight = std::panic::catch_unwind(|| {
        weighed("a large vector", || Vec::<u8>::with_capacity(ALLOCATION_MAX + 1).capacity())
    });
    assert!(overweight.is_err());
}

#[test]
fn a_truncated_capture_is_always_an_error() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for path in small_captures(folder.path()) {
        assert!(read(&path, "whole").is_ok(), "{}", path.display());
        let whole = std::fs::read(&path).unwrap();
        let cut = folder.path().join("cut.h5");
        for length in (0..whole.len()).step_by(4096).chain([whole.len() - 1]) {
            std::fs::write(&cut, &whole[..length]).unwrap();
            let error = read(&cut, &format!("{} at {length}", path.display())).unwrap_err();
            let named = match length {
                0 => matches!(error, CaptureError::NotHdf5 { .. }),
                _ => {
                    matches!(error, CaptureError::Truncated { found, .. } if found == length as u64)
                }
            };
            assert!(named, "{length}: {error}");
        }
    }
}

#[test]
fn flipped_bytes_are_an_error_or_a_consistent_capture() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for path in small_captures(folder.path()) {
        damage(&path, 500, !path.ends_with("plain.h5"));
    }
}

/// Reads `n_flips` variants of a capture, each with one byte changed.
///
/// With `checked` storage (gzip carries a checksum, as do all headers of our own files) whatever
/// is read without an error must be the original.
fn damage(path: &Path, n_flips: usize, checked: bool) {
    let whole = std::fs::read(path).unwrap();
    let original = samples(&read(path, "whole").unwrap().1);
    let mut random = Pcg64Mcg::seed_from_u64(42);
    let damaged = path.with_extension("damaged");
    let mut n_errors = 0;
    for _ in 0..n_flips {
        let at = random.random_range(0..whole.len());
        let mask = random.random_range(1..=255_u8);
        let mut bytes = whole.clone();
        bytes[at] ^= mask;
        std::fs::write(&damaged, &bytes).unwrap();
        let what = format!("{} byte {at} xor {mask:#04x}", path.display());
        match read(&damaged, &what) {
            Ok((_, blocks)) if checked => assert!(samples(&blocks) == original, "{what}"),
            Ok(_) => {}
            Err(error) => {
                assert!(error.to_string().contains("damaged"), "names the file: {error}");
                n_errors += 1;
            }
        }
    }
    assert!(n_errors < n_flips, "{}: not every byte can matter", path.display());
}

/// Samples of each channel, in order.
fn samples(blocks: &[Block]) -> BTreeMap<usize, Vec<f32>> {
    let mut samples: BTreeMap<usize, Vec<f32>> = BTreeMap::new();
    for block in blocks {
        samples.entry(block.channel.0).or_default().extend(&block.samples);
    }
    samples
}

#[test]
fn tables_and_sounds_allocate_no_more_than_their_limits() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let wide = ("1,".repeat(1023) + "1\n").repeat(700);
    let endless = "0.5,1\n0.25,2\n".repeat(10) + &"1".repeat(8 << 20);
    let quoted = "0.5,1\n0.25,2\n".repeat(100_000) + "\"" + &"1,\n".repeat(2 << 20);
    let sound = |n_channels: &[u8; 2], length: &[u8; 4]| {
        let head = b"RIFF\xff\xff\xff\xffWAVEfmt \x10\0\0\0\x01\0".as_slice();
        let rate = b"\xff\xff\xff\x3b\0\0\0\0".as_slice();
        [head, n_channels, rate, b"\0\x08\x10\0data", length, &[0; 6000]].concat()
    };
    for (name, content) in [
        ("wide.csv", wide.as_bytes()),
        ("endless.csv", endless.as_bytes()),
        ("quoted.csv", quoted.as_bytes()),
        ("long.wav", &sound(b"\0\x04", b"\xff\xff\xff\xff")),
        ("many.wav", &sound(b"\xff\xff", b"\xff\xff\xff\xff")),
        ("lying.wav", &sound(b"\0\x04", b"\xff\xff\xff\x7f")),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        match read(&path, name) {
            Ok(_) => assert_eq!(name, "long.wav"),
            Err(error) => assert!(error.to_string().contains(name), "{error}"),
        }
    }
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
                let (reader, _) = read(&file, &what).unwrap();
                assert!(reader.info().shaft_speed.is_some(), "{what}");
                assert_eq!(reader.report().samples_rejected(), 0, "{what}");
                n_files += 1;
            }
        }
    }
    assert!(n_files > 0, "no captures in ROTORWATCH_DATA");
}

fn python() -> std::process::Command {
    std::process::Command::new(std::env::var("PYTHON").unwrap_or_else(|_| "python3".into()))
}

#[test]
#[ignore = "needs python3 with h5py"]
fn h5py_reads_what_we_write() {
    const SCRIPT: &str = "
import sys, h5py, numpy as np
for path, n in zip(sys.argv[1:], (12000, 20000, 400)):
    with h5py.File(path) as f:
        assert f.attrs['format'] == 'rotorwatch-capture' and f.attrs['version'] == 1
        assert f.attrs['machine'].startswith('[machine]') and f.attrs['shaft_speed_hz'] == 10.0
        assert f.attrs['start_time'] == '2026-03-01T12:00:00Z', f.attrs['start_time']
        x, y = f['channels/x'], f['channels/y']
        assert (x.dtype, y.dtype) == ('<f4', '<i2') and y.attrs['scale'] == 1e-3 and y.attrs['offset'] == 0.5
        assert x.attrs['unit'] == 'g' and x.attrs['sample_rate_hz'] == 2000.0
        tone = np.sin(np.arange(n, dtype='f4') * np.float32(0.3))
        assert x.shape == (n,) and np.abs(x[:] - tone).max() < 1e-6
        assert y.shape == (n // 2,) and np.abs(y[:] / 3e4 - tone[: n // 2]).max() < 1e-4
        assert list(f['segments/start_sample']) == [0, n // 2] and list(f['segments/time_s']) == [0, 60]
";
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let files = small_captures(folder.path());
    let output = python().arg("-c").arg(SCRIPT).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Raw sample k of every channel that `tests/make_captures.py` writes.
fn expected(kind: &str, k: u64) -> f64 {
    let count = ((k * 7919) % 65_536) as f64 - 32_768.0;
    if kind == "i4" { count * 0.5 + 3.0 } else { count }
}

#[test]
#[ignore = "needs python3 with h5py"]
fn captures_written_by_h5py_are_read_alike() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let output = python()
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/make_captures.py"))
        .arg(folder.path())
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let files: Vec<PathBuf> =
        String::from_utf8_lossy(&output.stdout).lines().map(PathBuf::from).collect();
    assert_eq!(files.len(), 48, "3 versions, 8 storages, 2 byte orders");
    for file in &files {
        compare(file);
    }
    let (reader, _) = read(&folder.path().join("killed_recording.h5"), "killed").unwrap();
    assert_eq!(reader.report().samples_read, 40_000, "what was flushed is read");
    for word in ["zfp", "link", "external", "virtual", "dimension", "compound"] {
        let file = folder.path().join(format!("refused_{word}.h5"));
        let error = read(&file, word).unwrap_err().to_string();
        assert!(error.replace("refused_", "").replacen(word, "", 1).contains(word), "{error}");
    }
    for libver in ["earliest", "v110", "latest"] {
        damage(&folder.path().join(format!("small_{libver}.h5")), 2000, false);
    }
}

fn compare(file: &Path) {
    let what = file.display().to_string();
    let (reader, blocks) = read(file, &what).unwrap_or_else(|error| panic!("{error:?}"));
    let info = reader.info();
    assert_eq!(info.shaft_speed, Some(Hz(29.95)), "{what}");
    assert_eq!(info.start_time, Some(Timestamp(1_772_366_400_000_000_000)), "{what}");
    assert_eq!(info.machine.as_deref(), Some("[machine]\n".repeat(500).as_str()), "{what}");
    assert_eq!(info.channels.len(), 4, "{what}");
    for (at, channel) in info.channels.iter().enumerate() {
        assert_eq!(channel.unit_text.as_deref(), Some("m/s^2"), "{what}");
        let mut next = 0;
        for block in blocks.iter().filter(|block| block.channel.0 == at) {
            assert_eq!(block.start.0, next, "{what}");
            for sample in &block.samples {
                let physical = f64::from(*sample) + channel.info.offset;
                // Halves of 17-bit integers: exact in f32.
                assert!(
                    (physical - expected(&channel.info.name, next)).abs() < 1e-9,
                    "{what} {next}"
                );
                next += 1;
            }
        }
        assert_eq!(next, 20_000, "{what}");
    }
    let segmented = what.contains("chunked") || what.contains("shuffle");
    assert_eq!(info.segments, segmented.then_some(3), "{what}");
}
