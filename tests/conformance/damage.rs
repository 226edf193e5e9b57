//! Damaged captures: no crash, no endless loop, bounded memory; and of what this program wrote, an
//! error or the original.

use super::tools;
use super::weigh::{ChannelContent, Content, alone, read};
use super::written::small_captures;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::error::CaptureError;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::machine::Machine;
use rotorwatch::machine::file;
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt;
use std::path::Path;
use std::time::{Duration, Instant};

/// A reading that takes longer has hung: the whole files take milliseconds.
const TIME_MAX: Duration = Duration::from_secs(10);

/// How structures of the format begin.
const SIGNATURES: [&[u8]; 14] = [
    b"\x89HDF", b"OHDR", b"OCHK", b"TREE", b"SNOD", b"HEAP", b"GCOL", b"FRHP", b"FHDB", b"BTHD",
    b"BTLF", b"FAHD", b"FADB", b"EAHD",
];

/// What damage did.
#[derive(Debug, Clone, Default)]
struct Outcome {
    n_files: usize,
    n_errors: usize,
    /// Of the errors: panics of the library, caught.
    n_caught: usize,
    n_same: usize,
    /// Read without an error, and not the original: what differs first.
    silent: BTreeMap<&'static str, usize>,
    /// Of these: a channel is lost that the machine file names, and is told as absent.
    n_absent: usize,
    slowest: Duration,
}

impl Outcome {
    fn n_silent(&self) -> usize {
        self.silent.values().sum()
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} files: {} errors ({} caught panics), {} same, {} silent {:?} ({} told as absent channels), \
             slowest {:?}",
            self.n_files,
            self.n_errors,
            self.n_caught,
            self.n_same,
            self.n_silent(),
            self.silent,
            self.n_absent,
            self.slowest
        )
    }
}

/// One damaged variant and what was done to it.
fn damaged(whole: &[u8], heads: &[usize], random: &mut Pcg64Mcg) -> (Vec<u8>, String) {
    let mut bytes = whole.to_vec();
    let at = random.random_range(0..whole.len());
    let what = match random.random_range(0..5) {
        0 => {
            bytes.truncate(at);
            format!("cut at {at}")
        }
        1 => {
            let bit = random.random_range(0..8);
            bytes[at] ^= 1 << bit;
            format!("bit {bit} of byte {at} flipped")
        }
        2 => {
            let head = heads[random.random_range(0..heads.len())];
            let at = (head + random.random_range(0..96)).min(whole.len() - 1);
            let mask = random.random_range(1..=255_u8);
            bytes[at] ^= mask;
            format!("byte {at}, near the header at {head}, xor {mask:#04x}")
        }
        3 => {
            let end = (at + random.random_range(1..=512)).min(whole.len());
            bytes[at..end].iter_mut().for_each(|byte| *byte = random.random());
            format!("bytes {at}..{end} random")
        }
        _ => {
            let end = (at + random.random_range(1..=4096)).min(whole.len());
            bytes[at..end].fill(0);
            format!("bytes {at}..{end} zero")
        }
    };
    (bytes, what)
}

/// Where structures of the format begin.
fn heads(whole: &[u8]) -> Vec<usize> {
    let begins = |at: &usize| SIGNATURES.iter().any(|head| whole[*at..].starts_with(head));
    (0..whole.len()).filter(begins).collect()
}

/// Reads `n_files` damaged variants of a capture; `checked`: anything silent is a failure.
fn damage(path: &Path, n_files: usize, checked: bool) -> Outcome {
    let whole = std::fs::read(path).unwrap();
    let original = read(path, "whole").unwrap_or_else(|error| panic!("{error}")).content;
    let machine = machine_of(&original);
    let heads = heads(&whole);
    let mut random = Pcg64Mcg::seed_from_u64(42);
    let file = path.with_extension("damaged");
    let mut outcome = Outcome { n_files, ..Outcome::default() };
    for _ in 0..n_files {
        let (bytes, what) = damaged(&whole, &heads, &mut random);
        replace(&file, &bytes);
        let what = format!("{}: {what}", path.display());
        let (result, time) = timed(|| read(&file, &what).map(|reading| reading.content));
        assert!(time < TIME_MAX, "{what}: {time:?}");
        outcome.slowest = outcome.slowest.max(time);
        match result {
            Err(error) => {
                outcome.n_errors += 1;
                outcome.n_caught += usize::from(is_caught_panic(&error));
                assert!(error.to_string().contains("damaged"), "names the file: {error}");
            }
            Ok(content) if content == original => outcome.n_same += 1,
            Ok(content) => {
                assert!(
                    !checked,
                    "{what}: read without an error as\n{content:?}\nnot\n{original:?}"
                );
                *outcome.silent.entry(difference(&content, &original)).or_default() += 1;
                let absent = absent_channels(&file, &machine);
                let found: BTreeSet<String> = content.channels.keys().cloned().collect();
                let lost = original.channels.keys().filter(|name| !found.contains(*name));
                assert_eq!(absent, lost.cloned().collect(), "{what}: each lost channel is named");
                outcome.n_absent += usize::from(!absent.is_empty());
            }
        }
    }
    println!("{}: {outcome}", path.file_name().unwrap().display());
    outcome
}

#[expect(clippy::disallowed_methods, reason = "a limit for a reading that hangs")]
fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    (work(), start.elapsed())
}

/// Writes a new file: some file systems wait for the disk when an old one is overwritten.
fn replace(file: &Path, bytes: &[u8]) {
    let _ = std::fs::remove_file(file);
    std::fs::write(file, bytes).unwrap();
}

/// What differs first between a damaged capture and the original.
fn difference(found: &Content, original: &Content) -> &'static str {
    let names = |content: &Content| content.channels.keys().cloned().collect::<Vec<_>>();
    if names(found) != names(original) {
        return "channels";
    }
    let differs = |of: fn(&ChannelContent) -> String| {
        found.channels.iter().any(|(name, channel)| of(channel) != of(&original.channels[name]))
    };
    match () {
        () if differs(|channel| channel.n_samples.to_string()) => "number of samples",
        () if differs(|channel| channel.segments.len().to_string()) => "number of segments",
        () if differs(|channel| format!("{:?}", channel.segments)) => "times of segments",
        () if differs(|channel| channel.facts.clone()) => "attributes of a channel",
        () if differs(|channel| channel.crc.to_string()) => "samples",
        () => "attributes of the file",
    }
}

fn is_caught_panic(error: &CaptureError) -> bool {
    error.source().is_some_and(|source| source.to_string().contains("gave up"))
}

/// A machine whose sensors name every channel.
fn machine_of(content: &Content) -> Machine {
    let sensor = |name| {
        format!(
            "[[sensor]]\nchannel = \"{name}\"\nkind = \"accelerometer\"\nat = {{ bearing = \"b\" }}\n"
        )
    };
    let text = "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\nspeed_hz = 25.0\n\
        [[bearing]]\nid = \"b\"\nshaft = \"s\"\nelements = 9\nelement_diameter_mm = 7.94\n\
        pitch_diameter_mm = 39.04\n"
        .to_owned();
    let text = content.channels.keys().map(sensor).fold(text, |text, next| text + &next);
    file::parse(&text, "machine.toml").unwrap_or_else(|mistakes| panic!("{mistakes}"))
}

fn absent_channels(file: &Path, machine: &Machine) -> BTreeSet<String> {
    let reader = CaptureReader::open(file, Some(machine), &Hints::default());
    let reader = reader.unwrap_or_else(|error| panic!("{error}"));
    reader.info().absent_channels.iter().cloned().collect()
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
            let what = format!("{} at {length}", path.display());
            let Err(error) = read(&cut, &what) else { panic!("{what}: read") };
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
        let whole = std::fs::read(&path).unwrap();
        let original = read(&path, "whole").unwrap().content;
        let mut random = Pcg64Mcg::seed_from_u64(42);
        let file = path.with_extension("damaged");
        let mut n_errors = 0;
        for _ in 0..300 {
            let at = random.random_range(0..whole.len());
            let mask = random.random_range(1..=255_u8);
            let mut bytes = whole.clone();
            bytes[at] ^= mask;
            replace(&file, &bytes);
            let what = format!("{} byte {at} xor {mask:#04x}", path.display());
            match read(&file, &what) {
                Ok(reading) => assert_eq!(reading.content, original, "{what}"),
                Err(_) => n_errors += 1,
            }
        }
        assert!(n_errors < 300, "{}: not every byte can matter", path.display());
    }
}

#[test]
fn what_we_wrote_is_read_unchanged_or_not_at_all() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for path in small_captures(folder.path()) {
        let outcome = damage(&path, 50, true);
        assert!(outcome.n_errors > 0 && outcome.n_same > 0, "{}: {outcome}", path.display());
    }
}

#[test]
#[ignore = "takes a minute: 3000 damaged variants of each capture"]
fn three_thousand_damaged_captures_of_each_kind() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for path in small_captures(folder.path()) {
        assert_eq!(damage(&path, 3000, true).n_caught, 0, "{}", path.display());
    }
}

#[test]
#[ignore = "needs python3 with h5py and hdf5plugin"]
fn damaged_captures_of_h5py_end_in_order() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = "damaged_captures_of_h5py_end_in_order";
    if tools::python(name, "make_captures.py", &[folder.path()]).is_none() {
        return;
    }
    for libver in ["earliest", "v110", "latest"] {
        let path = folder.path().join(format!("small_{libver}.h5"));
        let outcome = damage(&path, 3000, false);
        // Nothing but gzip's own checksum guards these; the format's, from "v110" on, the headers.
        let silent_max = if libver == "earliest" { 150 } else { 15 };
        assert!(outcome.n_silent() <= silent_max, "{libver}: {outcome}");
    }
}
