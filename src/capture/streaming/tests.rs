//! What grew is read back, however it was cut; what was damaged is not.

use super::super::hints::Hints;
use super::super::reader::CaptureReader;
use super::*;
use crate::signal::Timestamp;

/// 2023-11-14T22:13:20.25Z.
const START: Timestamp = Timestamp(1_700_000_000_250_000_000);

fn channel(name: &str, number: GrowingType) -> GrowingChannel {
    GrowingChannel {
        name: name.into(),
        sample_rate: Hz(1000.0),
        unit: Some("m/s^2".into()),
        sensor: None,
        number,
    }
}

fn truth() -> Truth {
    Truth { texts: vec![("scene".into(), "[scene]".into())], seed: 7 }
}

fn write(path: &Path, pieces: usize) {
    let header =
        CaptureHeader { start_time: Some(START), machine: Some("text".into()), shaft_speed: None };
    let mut writer = StreamingWriter::create(path, &header, &truth()).unwrap();
    writer.channel(&channel("a", GrowingType::I16 { scale: 0.5, offset: 1.0 })).unwrap();
    writer.channel(&channel("b", GrowingType::F64)).unwrap();
    let counts: Vec<i16> = (0..40_000_u16).map(|i| i16::try_from(i % 1000).unwrap()).collect();
    let values: Vec<f64> = (0..40_000_u32).map(f64::from).collect();
    for (a, b) in counts.chunks(40_000 / pieces).zip(values.chunks(40_000 / pieces)) {
        writer.append(0, GrowingSamples::I16(a)).unwrap();
        writer.append(1, GrowingSamples::F64(b)).unwrap();
    }
    let wrong = writer.append(1, GrowingSamples::F32(&[1.0])).unwrap_err().to_string();
    assert!(wrong.contains("another number type"), "{wrong}");
    writer.finish().unwrap();
}

#[test]
fn what_grew_is_read_back_and_is_the_same_however_it_was_cut() {
    let dir = tempfile::tempdir().unwrap();
    let (one, many) = (dir.path().join("one.h5"), dir.path().join("many.h5"));
    write(&one, 1);
    write(&many, 125);
    let again = dir.path().join("again.h5");
    write(&again, 125);
    assert!(fs::read(&again).unwrap() == fs::read(&many).unwrap(), "bit by bit");
    check_read_back(&one);
    check_read_back(&many);
}

fn check_read_back(path: &Path) {
    let mut reader = CaptureReader::open(path, None, &Hints::default()).unwrap();
    assert_eq!(reader.info().start_time, Some(START));
    // The reader compares the sums it is told of, those of samples as they stream by.
    assert!(reader.info().channels.iter().all(|c| c.storage.ends_with(", checksums")));
    let mut sums = [0.0_f64; 2];
    let mut n = [0_usize; 2];
    while let Some(block) = reader.next_block().unwrap() {
        let i = block.channel.0;
        sums[i] += block.samples.iter().map(|x| f64::from(*x)).sum::<f64>();
        n[i] += block.samples.len();
    }
    assert_eq!(n, [40_000, 40_000]);
    // 40 times 0…999, half of it; the offset of 1 the reader keeps apart. 0…39 999 (whole numbers
    // are exact in f32).
    let expected = [40.0 * 499_500.0 * 0.5, 40_000.0 * 39_999.0 / 2.0];
    for (sum, expected) in sums.iter().zip(expected) {
        assert!((sum / expected - 1.0).abs() < 1e-9, "{sum} {expected}");
    }
}

#[test]
fn a_changed_sample_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.h5");
    write(&path, 1);
    let mut bytes = fs::read(&path).unwrap();
    // The doubles 5000, 5001, 5002 stand once in the file.
    let place = [5000.0_f64, 5001.0, 5002.0].map(f64::to_le_bytes).concat();
    let found: Vec<usize> =
        (0..bytes.len() - 24).filter(|at| bytes[*at..*at + 24] == place[..]).collect();
    assert_eq!(found.len(), 1);
    bytes[found[0] + 3] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let mut reader = CaptureReader::open(&path, None, &Hints::default()).unwrap();
    let error = loop {
        match reader.next_block() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("read to its end"),
            Err(error) => break error,
        }
    };
    let told = error.to_string();
    assert!(told.contains("samples 0 to 39999 differ from their checksum"), "{told}");
}

#[test]
fn nothing_remains_of_what_was_not_finished() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.h5");
    let mut writer = StreamingWriter::create(&path, &CaptureHeader::default(), &truth()).unwrap();
    writer.channel(&channel("a", GrowingType::F32)).unwrap();
    let text = writer.finish().unwrap_err().to_string();
    assert!(text.ends_with("channels/a: no samples"), "{text}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}
