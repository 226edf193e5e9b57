//! What a capture may hold beside its channels, and what its reader says of it.

use crate::capture::hdf5::{NewFile, NewStorage, guarded};
use crate::capture::hints::Hints;
use crate::capture::reader::CaptureReader;
use crate::capture::tests::{channel, crafted, machine_with, one_channel, scratch, sensor};
use crate::capture::writer::{CaptureHeader, CaptureWriter, ChannelSamples, ChannelStorage};
use crate::machine::Machine;
use crate::units::Hz;

#[test]
fn a_hint_that_the_file_contradicts_is_told_and_not_used() {
    let (_folder, path) = one_channel(Some(12_000.0), |_| {});
    let hints = Hints { rate: Some(Hz(6000.0)), ..Hints::default() };
    let reader = CaptureReader::open(&path, None, &hints).unwrap();
    let told = "channels/x: the file says 12000 Hz; --rate 6000 is not used";
    assert_eq!(reader.info().notes, [told]);
    assert_eq!(reader.info().channels[0].info.sample_rate, Hz(12_000.0));
    let (_folder, path) = scratch();
    let mut writer = CaptureWriter::create(&path, &CaptureHeader::default()).unwrap();
    for name in ["x", "y"] {
        let header = channel(name, 100.0, ChannelStorage::Contiguous);
        writer.channel(&header, ChannelSamples::F32(&[1.0; 100])).unwrap();
    }
    writer.finish().unwrap();
    let hints = |unit: &str| Hints { unit: Some(unit.into()), ..Hints::default() };
    let notes = |unit| CaptureReader::open(&path, None, &hints(unit)).unwrap().info().notes.clone();
    assert_eq!(notes("mm/s"), ["all 2 channels: the file says m/s^2; --unit mm/s is not used"]);
    assert!(notes("m/s^2").is_empty());
}

#[test]
fn what_is_no_channel_beside_the_channels_is_passed_over_and_told() {
    let (_folder, path) = crafted(|file| {
        let group = guarded(|| file.inner.create_group("channels")).unwrap();
        for name in ["x", "z"] {
            let samples = group.new_dataset::<f32>().shape([100]).create(name).unwrap();
            samples.write_raw(&[0.5_f32; 100]).unwrap();
            if name == "x" {
                samples
                    .new_attr::<f64>()
                    .create("sample_rate_hz")
                    .unwrap()
                    .write_numeric(&10.0)
                    .unwrap();
            }
        }
        let table = group.new_dataset::<f64>().shape([10, 3]).create("tab").unwrap();
        table.write_raw(&[0.0_f64; 30]).unwrap();
        let bytes = group.new_dataset::<u8>().shape([10]).create("notes").unwrap();
        bytes.write_raw(&[0_u8; 10]).unwrap();
    });
    let open = |machine: Option<&Machine>| CaptureReader::open(&path, machine, &Hints::default());
    let text = open(None).unwrap_err().to_string();
    assert!(text.contains("channels/z: attribute sample_rate_hz"), "may be a channel: {text}");
    let machine = machine_with(vec![sensor("x", "g")]);
    let reader = open(Some(&machine)).unwrap();
    let names: Vec<_> = reader.info().channels.iter().map(|c| c.info.name.clone()).collect();
    assert_eq!(names, ["x"]);
    let notes = &reader.info().notes;
    assert_eq!(notes.len(), 3, "{notes:?}");
    assert!(notes[0].starts_with("channels/notes: found "), "{notes:?}");
    assert!(notes[1].starts_with("channels/tab: found shape [10, 3], expected"), "{notes:?}");
    assert!(notes.iter().all(|note| note.ends_with("not a channel, ignored")), "{notes:?}");
    let machine = machine_with(vec![sensor("x", "g"), sensor("tab", "g")]);
    let text = open(Some(&machine)).unwrap_err().to_string();
    assert!(text.contains("channels/tab: found shape [10, 3]"), "a sensor names it: {text}");
}

#[test]
fn a_name_that_is_not_utf_8_is_named() {
    let (_folder, path) = scratch();
    let file = NewFile::create_as_of_1_6(&path);
    for (group, name) in [("channels", "x"), ("more", "grXn")] {
        let group = file.group(group).unwrap();
        let dataset = group.dataset(name, &[0.5_f32; 100], NewStorage::default()).unwrap();
        dataset.number("sample_rate_hz", 10.0).unwrap();
    }
    file.close().unwrap();
    let open = || CaptureReader::open(&path, None, &Hints::default());
    open().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(4).position(|four| four == b"grXn").unwrap();
    bytes[at + 2] = 0xfc;
    std::fs::write(&path, bytes).unwrap();
    let text = open().unwrap_err().to_string();
    assert!(text.contains("a.h5: /more/gr\\xfcn: this name is not UTF-8"), "{text}");
}
