//! What another writer wrote, every encoding, lying headers, rubbish.

use crate::capture::error::CaptureError;
use crate::capture::hints::Hints;
use crate::capture::info::CaptureInfo;
use crate::capture::map::ChannelMap;
use crate::capture::reader::CaptureReader;
use crate::units::{Hz, Unit};
use hound::{SampleFormat, WavSpec, WavWriter};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::io::Cursor;
use std::path::Path;

fn read_file(path: &Path, hints: &Hints) -> Result<(CaptureInfo, Vec<Vec<f32>>), CaptureError> {
    let mut reader = CaptureReader::open(path, None, hints)?;
    let info = reader.info().clone();
    let mut samples = vec![Vec::new(); info.channels.len()];
    while let Some(block) = reader.next_block()? {
        samples[block.channel.0].extend(&block.samples);
    }
    Ok((info, samples))
}

fn read(bytes: &[u8], hints: &Hints) -> Result<(CaptureInfo, Vec<Vec<f32>>), CaptureError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wav");
    std::fs::write(&path, bytes).unwrap();
    read_file(&path, hints)
}

const N: usize = 5000;

/// Sample `i` of channel `c`, in full scales.
fn tone(i: usize, c: usize) -> f64 {
    0.8 * (0.01 * i as f64 * (c + 1) as f64).sin()
}

/// A file of `n_channels` as an independent writer makes it, at 48 kHz.
fn written(bits: u16, format: SampleFormat, n_channels: u16) -> Vec<u8> {
    let spec = WavSpec {
        channels: n_channels,
        sample_rate: 48_000,
        bits_per_sample: bits,
        sample_format: format,
    };
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = WavWriter::new(&mut bytes, spec).unwrap();
    for i in 0..N {
        for c in 0..usize::from(n_channels) {
            let x = tone(i, c);
            #[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
            match format {
                SampleFormat::Float => writer.write_sample(x as f32).unwrap(),
                SampleFormat::Int => {
                    let counts = (x * 2_f64.powi(i32::from(bits) - 1)).round();
                    writer.write_sample(counts as i32).unwrap();
                }
            }
        }
    }
    writer.finalize().unwrap();
    bytes.into_inner()
}

/// Place of the length of the samples.
fn length_at(bytes: &[u8]) -> usize {
    bytes.windows(4).position(|window| window == b"data").unwrap() + 4
}

#[test]
fn every_encoding_is_read_as_fractions_of_full_scale() {
    for (bits, format, type_name) in [
        (8, SampleFormat::Int, "int16"),
        (16, SampleFormat::Int, "int16"),
        (24, SampleFormat::Int, "int32"),
        (32, SampleFormat::Int, "int32"),
        (32, SampleFormat::Float, "float32"),
    ] {
        for n_channels in [1, 2, 3, 11] {
            let (info, samples) =
                read(&written(bits, format, n_channels), &Hints::default()).unwrap();
            assert_eq!(samples.len(), usize::from(n_channels));
            // Half a count, and a rounding to f32.
            let scatter = if format == SampleFormat::Int {
                0.5 * 2_f64.powi(1 - i32::from(bits))
            } else {
                0.0
            } + 1e-7;
            for channel in &info.channels {
                let at = channel.info.name[2..].parse::<usize>().unwrap() - 1;
                let place =
                    info.channels.iter().position(|c| c.info.name == channel.info.name).unwrap();
                assert_eq!(channel.number_type.name(), type_name);
                assert_eq!(samples[place].len(), N);
                for (i, sample) in samples[place].iter().enumerate() {
                    let found = f64::from(*sample) + channel.info.offset;
                    assert!((found - tone(i, at)).abs() <= scatter, "{bits} bits, {i}: {found}");
                }
                let ends = channel.info.full_scale.map(|(low, high)| {
                    (f64::from(low) + channel.info.offset, f64::from(high) + channel.info.offset)
                });
                match ends {
                    // One count below full scale at the upper end: 1/128 for 8 bits.
                    Some((low, high)) => {
                        assert!((low + 1.0).abs() < 1e-6 && (high - 1.0).abs() < 0.008)
                    }
                    None => assert_eq!(format, SampleFormat::Float),
                }
            }
            assert_eq!(info.channels[0].info.sample_rate, Hz(48_000.0));
        }
    }
}

#[test]
fn the_map_names_and_scales_counts() {
    let bytes = written(16, SampleFormat::Int, 2);
    let map = |entries: &[&str]| Hints {
        map: ChannelMap::of_options(entries).unwrap(),
        ..Hints::default()
    };
    let hints = map(&["right=/ch2,unit=V,scale=0.001,offset=0.25,rate=51200"]);
    let (info, samples) = read(&bytes, &hints).unwrap();
    let right = &info.channels[0];
    assert_eq!((right.info.name.as_str(), right.info.unit), ("right", Unit::Volt));
    assert_eq!((right.info.sample_rate, info.channels.len()), (Hz(51_200.0), 1));
    assert!(info.notes[0].contains("the header says 48000 Hz, --map 51200 Hz"), "{:?}", info.notes);
    let expected = 0.001 * (tone(100, 1) * 32_768.0).round();
    assert!((f64::from(samples[0][100]) - expected).abs() < 1e-5, "{}", samples[0][100]);
    let (_, by_number) = read(&bytes, &map(&["a=/,column=1"])).unwrap();
    assert!((by_number[0][100] * 32.768 - samples[0][100]).abs() < 1e-5);
    let error = read(&bytes, &map(&["a=/ch3"])).unwrap_err().to_string();
    assert!(error.contains("a.wav: --map: a: no column /ch3; there are /ch1, /ch2"), "{error}");
    let hints = Hints { rate: Some(Hz(10.0)), unit: Some("g".to_owned()), ..Hints::default() };
    let (info, _) = read(&bytes, &hints).unwrap();
    assert_eq!((info.channels[0].info.sample_rate, info.notes.len()), (Hz(10.0), 1));
    assert_eq!(info.channels[0].info.unit, Unit::MetrePerSecondSquared);
}

#[test]
fn a_recording_whose_length_was_never_written_is_read_to_its_end() {
    for length in [0, u32::MAX] {
        let mut bytes = written(16, SampleFormat::Int, 2);
        let at = length_at(&bytes);
        bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
        let (info, samples) = read(&bytes, &Hints::default()).unwrap();
        assert_eq!((samples[1].len(), info.notes.len()), (N, 1), "{:?}", info.notes);
        bytes.pop();
        let (info, samples) = read(&bytes, &Hints::default()).unwrap();
        assert_eq!((samples[1].len(), info.notes.len()), (N - 1, 2), "{:?}", info.notes);
    }
}

#[test]
fn headers_that_lie_are_named() {
    let whole = written(16, SampleFormat::Int, 2);
    let refused = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.clone();
        change(&mut bytes);
        let error = read(&bytes, &Hints::default()).unwrap_err().to_string();
        assert!(error.contains("a.wav: "), "{error}");
        error
    };
    let at = length_at(&whole);
    let set = |at: usize, value: &'static [u8]| {
        move |bytes: &mut Vec<u8>| bytes[at..at + value.len()].copy_from_slice(value)
    };
    assert!(refused(&set(at, &[0, 0, 0, 0x7f])).contains("sox --ignore-length"));
    assert!(refused(&|bytes| bytes.truncate(300)).contains("cut off"));
    assert!(refused(&|bytes| bytes.truncate(30)).contains("format"));
    assert!(refused(&|bytes| bytes.truncate(at)).contains("no chunk \"data\""));
    assert!(refused(&set(22, &[0, 0])).contains("0 channels"));
    assert!(refused(&set(22, &[0xff, 0xff])).contains("65535 channels"));
    assert!(refused(&set(32, &[7, 0])).contains("7 bytes for a sample"));
    assert!(refused(&set(20, &[2, 0])).contains("in format 2"));
    assert!(refused(&set(24, &[0; 4])).contains("give --rate"));
    assert!(refused(&set(24, &[0xff; 4])).contains("give --rate"));
    let empty = |bytes: &mut Vec<u8>| {
        bytes.truncate(at + 4);
        bytes[at..].fill(0);
        bytes.extend(b"LIST\x04\0\0\0INFO");
    };
    assert!(refused(&empty).contains("is empty"));
}

#[test]
fn flipped_and_cut_bytes_are_an_error_or_samples() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wav");
    for (bits, format) in [(24, SampleFormat::Int), (32, SampleFormat::Float)] {
        let whole = written(bits, format, 2)[..3000].to_vec();
        let at = length_at(&whole);
        let mut n_read = 0;
        for round in 0..600 {
            let mut bytes = whole.clone();
            let samples_bytes = u32::try_from(whole.len() - at - 4).unwrap();
            bytes[at..at + 4].copy_from_slice(&samples_bytes.to_le_bytes());
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..if round % 2 == 0 { 80 } else { bytes.len() });
                bytes[at] = random.random();
            }
            if round % 5 == 0 {
                bytes.truncate(random.random_range(0..bytes.len()));
            }
            std::fs::write(&path, &bytes).unwrap();
            match read_file(&path, &Hints::default()) {
                Ok((info, _)) => {
                    let declared: u64 = info.channels.iter().map(|c| c.n_samples).sum();
                    assert!(declared <= 3000);
                    n_read += 1;
                }
                Err(error) => assert!(error.to_string().contains("a.wav"), "{error}"),
            }
        }
        assert!(n_read > 100, "{n_read}: not every byte can matter");
    }
}

#[test]
fn samples_behind_the_stated_length_are_told() {
    let mut bytes = written(16, SampleFormat::Int, 2);
    let at = length_at(&bytes);
    let whole = u32::try_from(bytes.len() - at - 4).unwrap();
    for (length, is_read) in [(whole - 400, true), (400, false)] {
        bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
        match read(&bytes, &Hints::default()) {
            Ok((info, _)) => assert!(is_read && info.notes[0].contains("400 more"), "{info}"),
            Err(error) => assert!(!is_read && error.to_string().contains("over 4 GB"), "{error}"),
        }
    }
    bytes[at..at + 4].copy_from_slice(&whole.to_le_bytes());
    bytes.extend(b"LIST\x04\0\0\0INFO");
    assert!(read(&bytes, &Hints::default()).unwrap().0.notes.is_empty());
}
