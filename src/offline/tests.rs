//! What is read of whole captures, and what is told of it.

use super::*;
use crate::capture::writer::CaptureHeader;
use crate::capture::writer::CaptureWriter;
use crate::capture::writer::ChannelHeader;
use crate::capture::writer::ChannelSamples;
use crate::capture::writer::ChannelStorage;

fn capture(folder: &Path, rate: f64, samples: &[f32]) -> PathBuf {
    capture_in(folder, "x.h5", "g", (rate, samples))
}

fn capture_in(folder: &Path, name: &str, unit: &str, (rate, samples): (f64, &[f32])) -> PathBuf {
    let file = folder.join(name);
    let mut writer = CaptureWriter::create(&file, &CaptureHeader::default()).unwrap();
    let header = ChannelHeader {
        name: "x".to_owned(),
        sample_rate: Hz(rate),
        unit: Some(unit.to_owned()),
        sensor: None,
        storage: ChannelStorage::Contiguous,
    };
    writer.channel(&header, ChannelSamples::F32(samples)).unwrap();
    writer.finish().unwrap();
    file
}

#[test]
fn units_that_nobody_knows_and_baselines_in_others_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<f32> = (0..40_000_u32).map(|i| (i * 7919 % 1009) as f32 - 504.0).collect();
    let written =
        |name: &str, unit: &str| capture_in(folder.path(), name, unit, (4000.0, &samples));
    // Our own writer takes no such unit: a table, and what is said of it.
    let odd = folder.path().join("odd.csv");
    let lines: String = samples.iter().map(|x| format!("{x},{}\n", x % 97.0)).collect();
    std::fs::write(&odd, format!("x,y\n{lines}")).unwrap();
    let unit = Some("furlong/s".to_owned());
    let hints = Hints { unit, rate: Some(Hz(4000.0)), ..Hints::default() };
    let said = Reference { hints, ..Reference::default() };
    let found = diagnose(&odd, &said, &mut |_| ()).unwrap();
    let told = "channel `x`: its unit \"furlong/s\" is none of g, m/s^2, ";
    assert!(found.warnings.iter().any(|warning| warning.starts_with(told)), "{found:?}");

    let text = "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\nspeed_hz = 10.0\n[[sensor]]\nchannel = 'x'\n\
                kind = 'accelerometer'\nunit = 'm/s^2'\nat = { shaft = 's' }\n";
    let machine = Arc::new(crate::machine::file::parse(text, "m.toml").unwrap());
    let reference = Reference { machine: Some(machine), ..Reference::default() };
    // The machine file states the unit: the spelling is told as a conflict, and once.
    let described = Reference { hints: said.hints.clone(), ..reference.clone() };
    let found = diagnose(&odd, &described, &mut |_| ()).unwrap();
    let of_unit = found.warnings.iter().filter(|warning| warning.contains("furlong/s"));
    assert_eq!(
        of_unit.collect::<Vec<_>>(),
        ["channel `x`: the data say furlong/s, the machine file m/s^2; the machine file was used"]
    );

    let (healthy, now) = (written("healthy.h5", "g"), written("now.h5", "m/s^2"));
    let records = vec![learn(&healthy, &reference, &mut |_| ()).unwrap()];
    let baseline = Baseline { records, provisional: false };
    let against = Reference { baseline, ..reference };
    let found = diagnose(&now, &against, &mut |_| ()).unwrap();
    let [used] = &found.baselines[..] else { panic!("{:?}", found.baselines) };
    let reason = "its channel `x` is in g by its data and in m/s^2 by the machine file";
    assert_eq!((used.used, used.reason.as_str()), (false, reason));
    let told = format!("baseline {} is not used: {reason}", healthy.display());
    assert!(found.warnings.contains(&told), "{:?}", found.warnings);
    let shaft = found.components.iter().find(|one| one.id == "s").unwrap();
    assert_eq!(shaft.why, format!("no baseline that can be used: {reason}"));
    let found = diagnose(&healthy, &against, &mut |_| ()).unwrap();
    assert!(found.baselines.iter().all(|one| one.used), "what is said alike is wrong alike");
}

#[test]
fn absurd_rates_end_in_a_verdict_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<f32> = (0..40_000_u16).map(|i| f32::from(i % 97) - 48.0).collect();
    for rate in [1e-300, 1e-6, 0.5, 99.0, 1e9, 1e300] {
        let file = capture(folder.path(), rate, &samples);
        // Without a machine the levels alone are judged: nothing is accused.
        match diagnose(&file, &Reference::default(), &mut |_| ()) {
            Ok(found) => assert!(found.components.iter().all(|c| !c.state.is_accusation())),
            Err(error) => assert!(!error.to_string().is_empty(), "{rate}"),
        }
    }
}

#[test]
fn what_holds_no_number_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let file = capture(folder.path(), 1000.0, &[f32::NAN; 5000]);
    let error = diagnose(&file, &Reference::default(), &mut |_| ()).unwrap_err();
    let told = error.to_string();
    assert!(told.contains("5000 of 5000 are no finite numbers"), "{told}");
    assert!(!told.contains("revolutions"), "{told}");
}

#[test]
fn the_samples_of_a_range_are_read_again_and_no_more_than_a_window() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<f32> = (0..5000_u16).map(f32::from).collect();
    let file = capture(folder.path(), 100.0, &samples);
    let read = |first, end| {
        let ranges = [("x".to_owned(), first, end), ("absent".to_owned(), 0, 9)];
        let found = stretches(&file, &Reference::default(), &ranges).unwrap();
        assert_eq!(found.len(), 1);
        let Stretch { start, start_s, samples, info } = found[0].clone();
        (start, start_s, samples.len(), f64::from(samples[0]) + info.offset)
    };
    // g in the file, m/s² here.
    let g = crate::units::STANDARD_GRAVITY_M_PER_S2;
    let (start, start_s, n, first) = read(300, 900);
    assert_eq!((start, n), (300, 600));
    assert!((start_s - 3.0).abs() < 1e-12 && (first / g - 300.0).abs() < 1e-3, "{first}");
    // 12 s at 100 Hz.
    let (start, start_s, n, first) = read(0, 5000);
    assert_eq!((start, n), (3800, 1200));
    assert!((start_s - 38.0).abs() < 1e-9 && (first / g - 3800.0).abs() < 1e-2, "{first}");
}

#[test]
fn a_capture_without_a_machine_is_judged_by_its_data_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = capture(folder.path(), 1000.0, &[0.25; 5000]);
    let found = diagnose(&file, &Reference::default(), &mut |_| ()).unwrap();
    assert!(found.components.iter().any(|c| c.id == "x"), "a dead sensor is told: {found:?}");
    assert_eq!(found.samples_used, 5000);
}

#[test]
fn pictures_of_a_run_up_are_of_equal_angles_as_its_lines_are() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\nspeed_hz = 20.0\n\
                [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'g'\nat = { shaft = 's' }\n\
                [[sensor]]\nchannel = 't'\nkind = 'tacho'\nunit = 'V'\nat = { shaft = 's' }\npulses_per_rev = 1\n";
    let machine = Arc::new(crate::machine::file::parse(text, "m.toml").unwrap());
    let reference = Reference { machine: Some(machine), ..Reference::default() };
    let evened_at = |rise_hz_per_s: f64| {
        let revolutions = |i: u32| {
            let t = f64::from(i) / 4000.0;
            20.0 * t + 0.5 * rise_hz_per_s * t * t
        };
        #[expect(clippy::cast_possible_truncation, reason = "f32 is what a channel holds")]
        let tone = |i| (std::f64::consts::TAU * 3.0 * revolutions(i)).cos() as f32;
        let pulse = |i| f32::from(u8::from(revolutions(i).fract() < 0.1));
        let file = folder.path().join(format!("{rise_hz_per_s}.h5"));
        let mut writer = CaptureWriter::create(&file, &CaptureHeader::default()).unwrap();
        let mut channel = |name: &str, unit: &str, samples: Vec<f32>| {
            let header = ChannelHeader {
                name: name.to_owned(),
                sample_rate: Hz(4000.0),
                unit: Some(unit.to_owned()),
                sensor: None,
                storage: ChannelStorage::Contiguous,
            };
            writer.channel(&header, ChannelSamples::F32(&samples)).unwrap();
        };
        channel("x", "g", (0..40_000).map(tone).collect());
        channel("t", "V", (0..40_000).map(pulse).collect());
        writer.finish().unwrap();
        let ranges = ["x", "t"].map(|name| (name.to_owned(), 0, 40_000));
        let stretches = stretches(&file, &reference, &ranges).unwrap();
        evened(&file, &reference, &stretches).unwrap()
    };
    assert!(evened_at(0.0).is_empty(), "a steady shaft is read as it was sampled");
    let [(name, samples, rate)] = &evened_at(0.5)[..] else { panic!("one channel vibrates") };
    assert_eq!(name, "x");
    // Whole points a revolution of the mean speed, about 22.5 Hz; 1 g is 9.81 m/s².
    let a_point = std::f64::consts::TAU * 3.0 / (4000.0 / 22.5_f64).ceil();
    let (mut re, mut im) = (0.0, 0.0);
    for (x, i) in samples.iter().zip(0_u32..) {
        let (sin, cos) = (a_point * f64::from(i)).sin_cos();
        (re, im) = (re + f64::from(*x) * cos, im + f64::from(*x) * sin);
    }
    let amplitude = 2.0 * f64::hypot(re, im) / samples.len() as f64;
    assert!((amplitude / 9.80665 - 1.0).abs() < 0.01, "{amplitude} at {}", rate.0);
}
