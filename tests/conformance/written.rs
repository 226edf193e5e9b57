//! What this program writes, for its own damage tests and as h5py and h5dump read it.

use super::tools;
use super::weigh::{alone, read};
use rotorwatch::capture::writer::{
    CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage,
};
use rotorwatch::signal::{SampleIndex, Timestamp};
use rotorwatch::units::Hz;
use std::path::{Path, PathBuf};

fn header() -> CaptureHeader {
    CaptureHeader {
        start_time: Some(Timestamp(1_772_366_400_000_000_000)),
        machine: Some("[machine]\nid = \"rig-1\"\n".into()),
        shaft_speed: Some(Hz(10.0)),
    }
}

fn channel(name: &str, rate_hz: f64, storage: ChannelStorage) -> ChannelHeader {
    ChannelHeader {
        name: name.into(),
        sample_rate: Hz(rate_hz),
        unit: Some("g".into()),
        sensor: Some("accelerometer".into()),
        storage,
    }
}

fn tone(n: usize) -> Vec<f32> {
    (0..n).map(|k| (k as f32 * 0.3).sin()).collect()
}

/// A small capture with a float and an integer channel and all attributes.
fn write(path: &Path, n: usize, storage: ChannelStorage, segmented: bool) {
    let mut writer = CaptureWriter::create(path, &header()).unwrap();
    writer.channel(&channel("x", 2000.0, storage), ChannelSamples::F32(&tone(n))).unwrap();
    #[expect(clippy::cast_possible_truncation, reason = "at most 30 000")]
    let counts: Vec<i16> = tone(n / 2).iter().map(|x| (x * 3e4) as i16).collect();
    let counts = ChannelSamples::I16 { counts: &counts, scale: 1e-3, offset: 0.5 };
    writer.channel(&channel("y", 1000.0, storage), counts).unwrap();
    if segmented {
        let half = SampleIndex(n as u64 / 2);
        writer.segments(&[SampleIndex(0), half], &[0.0, 60.0]).unwrap();
    }
    writer.finish().unwrap();
}

/// Captures of a few tens of kilobytes: mostly samples, compressed, mostly headers.
pub(crate) fn small_captures(folder: &Path) -> Vec<PathBuf> {
    let packed = ChannelStorage::Compressed { chunk_samples: 1000, level: 6 };
    let tiny = ChannelStorage::Compressed { chunk_samples: 64, level: 6 };
    let cases = [
        ("plain.h5", 12_000, ChannelStorage::Contiguous, false),
        ("gzip.h5", 20_000, packed, true),
        ("headers.h5", 400, tiny, true),
        ("plain_segments.h5", 300, ChannelStorage::Contiguous, true),
    ];
    let make = |(name, n, storage, segmented)| {
        let path = folder.join(name);
        write(&path, n, storage, segmented);
        path
    };
    cases.into_iter().map(make).collect()
}

/// Count k of every channel of [`every_kind`].
#[expect(clippy::cast_possible_truncation, reason = "within int16")]
fn count(k: usize) -> i16 {
    ((k * 7919 % 65_536) as i32 - 32_768) as i16
}

/// A capture with a channel of each number type, the integers 10 times slower.
fn every_kind(path: &Path, n: usize, storage: ChannelStorage, segmented: bool) {
    let counts: Vec<i16> = (0..n).map(count).collect();
    let floats: Vec<f32> = counts.iter().map(|&x| f32::from(x)).collect();
    let doubles: Vec<f64> = counts.iter().map(|&x| f64::from(x) * 1e-3).collect();
    let wide: Vec<i32> = counts.iter().map(|&x| i32::from(x) * 30_000).collect();
    let slow = n.div_ceil(10);
    let mut writer = CaptureWriter::create(path, &header()).unwrap();
    let (scale, offset) = (1e-3, -0.5);
    for (name, rate_hz, samples) in [
        ("f4", 25_600.0, ChannelSamples::F32(&floats)),
        ("f8", 25_600.0, ChannelSamples::F64(&doubles)),
        ("i2", 2560.0, ChannelSamples::I16 { counts: &counts[..slow], scale, offset }),
        ("i4", 2560.0, ChannelSamples::I32 { counts: &wide[..slow], scale, offset }),
    ] {
        writer.channel(&channel(name, rate_hz, storage), samples).unwrap();
    }
    if segmented {
        let third = SampleIndex(n as u64 / 30 * 10);
        writer.segments(&[SampleIndex(0), third], &[0.0, 60.5]).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
#[ignore = "needs python3 with h5py and hdf5plugin"]
fn h5py_reads_what_we_write() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let packed = |chunk_samples, level| ChannelStorage::Compressed { chunk_samples, level };
    let mut n_files = 0;
    for storage in [
        ChannelStorage::Contiguous,
        packed(64, 1),
        packed(4096, 6),
        packed(65_536, 4),
        packed(1_000_000, 9),
    ] {
        // Less than a block of checksums, one, and two and a bit.
        for n in [1000, 65_536, 150_000] {
            for segmented in [false, true] {
                // A chunk of 64 samples is legal but slow to write.
                if !(storage == packed(64, 1) && n > 1000) {
                    every_kind(&folder.path().join(format!("{n_files}.h5")), n, storage, segmented);
                    n_files += 1;
                }
            }
        }
    }
    let name = "h5py_reads_what_we_write";
    let Some(text) = tools::python(name, "check_captures.py", &[folder.path()]) else { return };
    assert_eq!(text.lines().count(), n_files, "{text}");
}

#[test]
#[ignore = "needs h5dump"]
fn h5dump_reads_what_we_write() {
    let _alone = alone();
    let name = "h5dump_reads_what_we_write";
    let folder = tempfile::tempdir().unwrap();
    for storage in
        [ChannelStorage::Contiguous, ChannelStorage::Compressed { chunk_samples: 64, level: 6 }]
    {
        let path = folder.path().join("a.h5");
        every_kind(&path, 1000, storage, true);
        let dump = |arguments: &[&str]| tools::h5dump(name, arguments, &path);
        let Some(text) = dump(&["-H"]) else { return };
        for word in ["GROUP \"checksums\"", "DATASET \"f8\"", "H5T_STD_I16LE", "\"block_samples\""]
        {
            assert!(text.contains(word), "{word}: {text}");
        }
        let numbers = |arguments: &[&str]| -> Vec<f64> {
            let text = dump(arguments).unwrap();
            let data = text.split("DATA {").nth(1).unwrap().split('}').next().unwrap();
            data.split(',').map(|number| number.trim().parse().unwrap()).collect()
        };
        let counts: Vec<f64> = (0..100).map(|k| f64::from(count(k))).collect();
        assert_eq!(numbers(&["-y", "-d", "/channels/i2"]), counts);
        let wide: Vec<f64> = counts.iter().map(|x| x * 30_000.0).collect();
        assert_eq!(numbers(&["-y", "-d", "/channels/i4"]), wide);
        assert_eq!(numbers(&["-y", "-d", "/segments/time_s"]), [0.0, 60.5]);
        assert_eq!(numbers(&["-y", "-d", "/channels/f4"]).len(), 1000);
        let counted = (0..100).map(count).flat_map(i16::to_le_bytes).collect::<Vec<u8>>();
        let sum = f64::from(crc32fast::hash(&counted));
        assert_eq!(numbers(&["-y", "-d", "/checksums/i2"]), [sum]);
        assert!(
            (numbers(&["-y", "-a", "/channels/i2/scale"])[0] - 1e-3).abs() < 1e-9,
            "printed short"
        );
    }
}

#[test]
fn what_is_written_is_read_with_all_its_facts() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    // Beyond one block of checksums, so that the second, shorter one is compared too.
    every_kind(&path, 70_000, ChannelStorage::Contiguous, true);
    let reading = read(&path, "a.h5").unwrap();
    assert!(reading.info.channels.iter().all(|channel| channel.storage.contains("checksums")));
    let bytes: Vec<u8> = (0..7000).map(count).flat_map(i16::to_le_bytes).collect();
    let found = &reading.content.channels["i2"];
    assert_eq!((found.n_samples, found.crc), (7000, crc32fast::hash(&bytes)));
    assert_eq!(
        found.facts,
        "int16 Hz(2560.0) Some(\"g\") Some(\"accelerometer\") 0.001 -0.5".to_owned()
    );
    assert_eq!(found.segments.len(), 2);
    assert_eq!(
        reading.content.header,
        "Some(Timestamp(1772366400000000000)) Some(\"[machine]\\nid = \\\"rig-1\\\"\\n\") \
         Some(Hz(10.0)) Some(2)"
    );
}
