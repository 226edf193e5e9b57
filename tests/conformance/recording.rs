//! Recordings whose daemon is killed at a random moment: what was flushed is there, is right, and
//! opens everywhere once it is repaired.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test may panic; clippy exempts only #[test] functions"
)]
#![expect(clippy::print_stdout, reason = "a skipped test says so")]

use hdf5::H5File;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::{CaptureReader, Piece};
use rotorwatch::capture::received::RawSamples;
use rotorwatch::capture::writer::{
    CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage,
};
use rotorwatch::units::Hz;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;
use tempfile::TempDir;

/// Name, samples a second, elements in a pass of the capture.
const CHANNELS: [(&str, u64); 3] = [("counts", 8000), ("slow", 500), ("wide", 4000)];

/// Length of a pass, s.
const PASS_S: u64 = 20;

const MACHINE: &str = r#"
[machine]
id = "rig-1"
name = "Rig"
[[shaft]]
id = "main"
speed_hz = 10.0
[[sensor]]
channel = "slow"
kind = "process"
"#;

const CHECK: &str = r#"
import sys, zlib, h5py
path, swmr = sys.argv[1], sys.argv[2] == "swmr"
with h5py.File(path, "r", libver="latest", swmr=True) if swmr else h5py.File(path, "r") as file:
    for name, channel in file["channels"].items():
        samples, sums = channel[:], file["checksums"][name]
        block = int(sums.attrs["block_samples"])
        assert len(sums) == len(samples) // block or swmr, (name, len(sums), len(samples))
        for k, expected in enumerate(sums[:]):
            found = zlib.crc32(samples[k * block:(k + 1) * block].astype(samples.dtype.newbyteorder("<")).tobytes())
            assert found == expected, (name, k)
        print(name, len(samples))
"#;

/// Value of sample `i` of a pass; as a count it fits 16 bits.
fn value(i: u64) -> i16 {
    i16::try_from(i * 31 % 32_003).unwrap()
}

fn write_capture(path: &Path) {
    let mut writer = CaptureWriter::create(path, &CaptureHeader::default()).unwrap();
    for (name, rate) in CHANNELS {
        let header = ChannelHeader {
            name: name.into(),
            sample_rate: Hz(rate as f64),
            unit: Some("m/s^2".into()),
            sensor: None,
            storage: ChannelStorage::Contiguous,
        };
        let counts: Vec<i16> = (0..rate * PASS_S).map(value).collect();
        let doubles: Vec<f64> = counts.iter().map(|&x| f64::from(x) / 7.0).collect();
        let wide: Vec<i32> = counts.iter().map(|&x| i32::from(x) * 65_537).collect();
        let samples = match name {
            "counts" => ChannelSamples::I16 { counts: &counts, scale: 1e-3, offset: 0.5 },
            "slow" => ChannelSamples::F64(&doubles),
            _ => ChannelSamples::I32 { counts: &wide, scale: 2.0, offset: 0.0 },
        };
        writer.channel(&header, samples).unwrap();
    }
    writer.finish().unwrap();
}

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rotorwatch"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// A daemon that records a capture again and again, files of `segment_s` of stream time.
fn start(dir: &TempDir, segment_s: u64, compression: u64) -> Child {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[recording]\nenabled = true\nsegment_seconds = {segment_s}\n\
         flush_seconds = 0.05\ncompression = {compression}\n[[machine]]\nfile = \"rig.toml\"\n\
         [[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = 20\nloop = true\n"
    );
    fs::write(dir.path().join("serve.toml"), config).unwrap();
    let mut child =
        program().arg("serve").arg("--config").arg(dir.path().join("serve.toml")).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with("listening on"), "{line:?}");
    child
}

fn recordings(dir: &TempDir) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(dir.path().join("data/recordings/rig-1")) else {
        return Vec::new();
    };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "h5"));
    files.sort();
    files
}

/// Samples of each channel that a reader sees, by name; `None` while there is nothing to read.
fn lengths(file: &Path) -> Option<Vec<u64>> {
    let reader = CaptureReader::open(file, None, &Hints::default()).ok()?;
    Some(reader.info().channels.iter().map(|channel| channel.n_samples).collect())
}

/// Compares every sample with the generator, by its stream time, and every checksum.
fn verify(file: &Path) -> u64 {
    let mut reader = CaptureReader::open(file, None, &Hints::default())
        .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    reader.keep_received();
    let mut seen = 0;
    while let Some(piece) = reader.next_piece().unwrap() {
        let Piece::Received(run) = piece else { continue };
        let (name, rate) = CHANNELS[run.channel.0];
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small times")]
        let at = (run.time_s * rate as f64).round() as u64;
        let expected = |i: usize| value((at + i as u64) % (rate * PASS_S));
        let right = |i: usize| match &run.raw {
            RawSamples::I16(raw) => raw[i] == expected(i),
            RawSamples::F64(raw) => raw[i].to_bits() == (f64::from(expected(i)) / 7.0).to_bits(),
            RawSamples::I32(raw) => raw[i] == i32::from(expected(i)) * 65_537,
            RawSamples::F32(_) => false,
        };
        let wrong = (0..run.raw.len()).find(|&i| !right(i));
        assert_eq!(wrong, None, "{}: {name} from {} s", file.display(), run.time_s);
        seen += run.raw.len() as u64;
    }
    let inside = H5File::open(file).unwrap();
    for (name, _) in CHANNELS {
        let sums = inside.dataset(&format!("checksums/{name}")).unwrap();
        let block: i64 = sums.attr("block_samples").unwrap().read_numeric().unwrap();
        let samples = inside.dataset(&format!("channels/{name}")).unwrap();
        let bytes: Vec<u8> = match name {
            "counts" => le(&samples.read_raw::<i16>().unwrap(), |x| x.to_le_bytes()),
            "slow" => le(&samples.read_raw::<f64>().unwrap(), |x| x.to_le_bytes()),
            _ => le(&samples.read_raw::<i32>().unwrap(), |x| x.to_le_bytes()),
        };
        let width = bytes.len() / samples.shape()[0].max(1);
        let block_bytes = usize::try_from(block).unwrap() * width.max(1);
        let expected: Vec<u32> = bytes.chunks_exact(block_bytes).map(crc32fast::hash).collect();
        let found = sums.read_raw::<u32>().unwrap();
        // A kill between samples and their checksum leaves the newest rows out, never a wrong one.
        assert!(found.len() <= expected.len(), "{}: {name}", file.display());
        assert_eq!(found, expected[..found.len()], "{}: {name}", file.display());
    }
    seen
}

fn le<T: Copy, const N: usize>(samples: &[T], bytes: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    samples.iter().flat_map(|&x| bytes(x)).collect()
}

/// `python3` and what it says when it checks a file.
fn h5py(file: &Path, mode: &str) {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let output = Command::new(python)
        .args(["-c", CHECK, &file.display().to_string(), mode])
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{mode} {}: {told}", file.display());
}

fn h5dump(file: &Path) {
    match Command::new("h5dump").arg("-H").arg(file).output() {
        Ok(output) => assert!(output.status.success(), "h5dump {}", file.display()),
        Err(_) => println!("SKIPPED h5dump: not installed"),
    }
}

/// Kills `n` daemons at random moments and looks at what they leave.
fn kill_and_look(n: u64, seed: u64, with_h5py: bool) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (mut total, mut n_left_open) = (0, 0);
    for run in 0..n {
        let dir = TempDir::new().unwrap();
        fs::write(dir.path().join("rig.toml"), MACHINE).unwrap();
        write_capture(&dir.path().join("x.h5"));
        // Every other one in a single file, so that the kill finds it open; else a file each 0.2 s.
        let mut child = start(&dir, if run % 2 == 0 { 600 } else { 4 }, run.div_ceil(2) % 2);
        while recordings(&dir).is_empty() {
            thread::sleep(Duration::from_millis(2));
        }
        // The moment itself is what is random here.
        thread::sleep(Duration::from_micros(random.random_range(0..400_000)));
        let before = recordings(&dir).last().map(|file| (file.clone(), lengths(file)));
        thread::sleep(Duration::from_micros(random.random_range(0..30_000)));
        child.kill().unwrap();
        child.wait().unwrap();
        let files = recordings(&dir);
        for file in &files {
            let left = verify(file);
            if with_h5py {
                h5py(file, "swmr");
            }
            let repaired = program().args(["check", "--repair"]).arg(file).output().unwrap();
            let told = String::from_utf8(repaired.stdout).unwrap();
            assert!(repaired.status.success(), "run {run}: {}: {told}", file.display());
            n_left_open += u64::from(told.contains("left open"));
            assert_eq!(verify(file), left, "run {run}: the repair changed what is there");
            if with_h5py {
                h5py(file, "plain");
                h5dump(file);
            }
            total += left;
        }
        let (file, before) = before.unwrap();
        let after = lengths(&file).unwrap();
        for (before, after) in before.unwrap_or_default().iter().zip(&after) {
            assert!(after >= before, "run {run}: {after} samples of {before} that were flushed");
        }
        assert!(!files.is_empty(), "run {run}");
    }
    assert!(n_left_open * 2 >= n, "{n_left_open} of {n} kills hit an open file");
    assert!(total > n * 1000, "{total} samples in {n} runs prove nothing");
}

#[test]
fn a_killed_recording_keeps_every_flushed_sample() {
    kill_and_look(2, 1, false);
}

#[test]
#[ignore = "takes a minute"]
fn forty_kills_leave_no_wrong_sample() {
    kill_and_look(40, 2, false);
}

#[test]
#[ignore = "needs python3 with h5py"]
fn h5py_and_h5dump_read_what_a_kill_leaves() {
    kill_and_look(4, 3, true);
}
