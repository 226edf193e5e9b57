//! What is kept is read back bit by bit, and judged again as it was; what was changed is found.

use super::again;
use super::kept;
use super::kept::Judged;
use crate::alarms;
use crate::capture::live::LiveChannel;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::capture::recording::file::RecordingHeader;
use crate::capture::recording::triggered::Plan;
use crate::capture::writer::CaptureHeader;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::diagnosis::rate::FalseAlarms;
use crate::features::run_up::RunUp;
use crate::machine::file as machine_file;
use crate::pipeline::Carried;
use crate::pipeline::Monitor;
use crate::pipeline::Passed;
use crate::pipeline::Run;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::SampleIndex;
use crate::units::Hz;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use toml::Table;

const RATE_HZ: f64 = 2000.0;

/// A limit with hysteresis and a delay, a probe with a mark for the run-up, a slower channel.
const MACHINE: &str = "[machine]\nid = \"m\"\nname = \"m\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 10.0\n\
    [[bearing]]\nid = \"b\"\nshaft = \"main\"\nelements = 9\nelement_diameter_mm = 7.94\n\
    pitch_diameter_mm = 39.04\n[[sensor]]\nchannel = \"acc\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\n\
    at = { bearing = \"b\" }\n[[sensor]]\nchannel = \"probe\"\nkind = \"proximitor\"\nunit = \"um\"\n\
    at = { shaft = \"main\" }\n[[sensor]]\nchannel = \"mark\"\nkind = \"tacho\"\npulses_per_rev = 1\n\
    at = { shaft = \"main\" }\n[[limits.alarm]]\nid = \"l\"\nkind = \"feature\"\nfeature = \"rms\"\n\
    channels = [\"acc\"]\nwarning_above = 0.9\non_delay_s = 4.0\nhysteresis_percent = 10.0\n\
    states = [\"running\", \"transient\", \"unknown\"]\n";

fn channels() -> Vec<ReceivedChannel> {
    let channel = |name: &str, rate_hz, number_type, scale, unit: &str, raw_zero| ReceivedChannel {
        name: name.to_owned(),
        sample_rate: Hz(rate_hz),
        number_type,
        scale,
        offset: 0.5,
        raw_zero,
        unit: Some(unit.to_owned()),
        sensor: None,
    };
    vec![
        channel("acc", RATE_HZ, NumberType::I16, 1e-3, "m/s^2", 0.0),
        channel("probe", RATE_HZ / 2.0, NumberType::F64, 1.0, "um", 250.0),
        channel("mark", RATE_HZ, NumberType::I32, 1.0, "", 3.0),
    ]
}

/// A second of a channel: a run-up from 5 Hz to 15 Hz within 40 s, the vibration growing with time.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small numbers")]
fn second(channel: usize, second: u64, segment: u32, shift_s: f64) -> Received {
    let rate_hz = channels()[channel].sample_rate.0;
    let n = rate_hz as u64;
    let turns = |t: f64| 5.0 * t + 0.125 * t * t;
    let values = (0..n).map(|i| {
        let t = second as f64 + i as f64 / rate_hz;
        let noise = f64::from((i * 7919 + second * 104_729) as u32 % 1000) / 500.0 - 1.0;
        let phase = std::f64::consts::TAU * turns(t);
        match channel {
            0 => 1000.0 * (0.06 * t * phase.sin() + 0.3 * noise),
            1 => 250.0 + 20.0 * phase.cos() + noise,
            _ => {
                if turns(t).fract() < 0.1 {
                    9.0
                } else {
                    3.0
                }
            }
        }
    });
    let raw = match channel {
        0 => RawSamples::I16(values.map(|x| x as i16).collect()),
        1 => RawSamples::F64(values.collect()),
        _ => RawSamples::I32(values.map(|x| x as i32).collect()),
    };
    Received {
        channel: ChannelIndex(channel),
        start: SampleIndex(second * n),
        segment,
        time_s: second as f64 + shift_s,
        raw,
    }
}

/// Two segments with a hole of 5 s between them.
fn stream() -> Vec<Arc<Received>> {
    let seconds = (0..40).flat_map(|s| {
        let (segment, shift_s) = if s < 18 { (0, 0.1) } else { (1, 5.3) };
        (0..3).map(move |c| Arc::new(second(c, s, segment, shift_s)))
    });
    seconds.collect()
}

fn settings() -> Settings {
    let usual = Usual { log_value: -1.5, log_scatter: Some(0.1), n_windows: 7 };
    let record = Record {
        name: "healthy\u{e4}".to_owned(),
        baseline: Some(Arc::from("id-1")),
        point: OperatingPoint { speed: Some(Hz(10.0)), load: None },
        usual: [(("acc".to_owned(), "rms".to_owned()), usual)].into(),
        n_windows: 7,
        left_out: [("not running".to_owned(), 2)].into(),
        channels: Vec::new(),
    };
    Settings {
        window_s: 6.0,
        hop_s: 2.0,
        baseline: Baseline { records: vec![record], provisional: false },
        alarms: alarms::Settings { on_delay_s: 3.0, ..alarms::Settings::default() },
        false_alarms: FalseAlarms::a_year(0.1, (6.0, 2.0), 3.0),
        ..Settings::default()
    }
}

/// The windows of the stream, and how it was judged.
fn judged() -> (Vec<Arc<Passed>>, Judged) {
    let machine = Arc::new(machine_file::parse(MACHINE, "m.toml").unwrap());
    let received = channels();
    let live: Vec<_> =
        received.iter().map(|channel| LiveChannel::new(channel, &machine).unwrap()).collect();
    let channels: Vec<_> = live.iter().map(|(_, info)| info.clone()).collect();
    let hints = SpeedHints { option: None, capture: Some(Hz(10.0)) };
    let settings = settings();
    let mut monitor = Monitor::new(machine, channels.clone(), hints, &settings).unwrap();
    monitor.keep_trail(100);
    for run in stream() {
        let samples = live[run.channel.0].0.samples(run.raw.clone());
        let Received { channel, start, segment, time_s, .. } = *run;
        monitor.step(&Block { channel, start, segment, time_s, samples }, &mut drop);
    }
    monitor.finish(&mut drop);
    let settings = Settings { baseline: Baseline::default(), ..settings };
    (monitor.trail(), Judged { received, channels, hints, settings })
}

/// Writes a capture of the stream from `from_s` on; `change` may change what was received.
fn capture(folder: &Path, from_s: f64, change: impl Fn(&mut Received)) -> (PathBuf, usize) {
    capture_with(folder, from_s, &change, &Carried::clone)
}

/// The same; `carry` may change what the windows carried.
fn capture_with(
    folder: &Path,
    from_s: f64,
    change: &dyn Fn(&mut Received),
    carry: &dyn Fn(&Carried) -> Carried,
) -> (PathBuf, usize) {
    let (windows, judged) = judged();
    let carried =
        |w: Arc<Passed>| Arc::new(Passed { before: carry(&w.before), ..Passed::clone(&w) });
    let windows: Vec<Arc<Passed>> = windows.into_iter().map(carried).collect();
    let runs = stream().into_iter().map(|run| {
        let mut run = Received::clone(&run);
        change(&mut run);
        Arc::new(run)
    });
    let runs: Vec<_> = runs.collect();
    let plan = Plan::new(&runs, &judged.received, from_s).unwrap();
    let place = |channel: usize, segment: u32, run: &Run| {
        plan.place(channel, segment, run.start, run.n_samples as u64)
    };
    let windows = kept::placed(&windows, &place);
    let mut about = Table::new();
    about.insert("version".to_owned(), env!("CARGO_PKG_VERSION").into());
    about.insert("processor".to_owned(), super::processor().into());
    let header = RecordingHeader {
        capture: CaptureHeader { machine: Some(MACHINE.to_owned()), ..CaptureHeader::default() },
        configuration: None,
        evidence: kept::lists(&about, &judged, windows, &place),
    };
    let file = folder.join("m-00000001.h5");
    let _none_yet = std::fs::remove_file(&file);
    plan.create(&file, &header, &judged.received).unwrap().close().unwrap();
    (file, windows.len())
}

#[test]
fn windows_of_two_segments_a_run_up_and_three_rates_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (file, n) = capture(folder.path(), 7.0, |_| ());
    let found = again::judge(&file).unwrap().unwrap();
    assert_eq!(found.windows.len(), n);
    assert!(n >= 14, "{n}");
    for window in &found.windows {
        assert!(window.is_equal() && window.n_features > 10, "{window:?}");
    }
    assert_eq!(found.made_elsewhere(), None);
    assert!(found.raised.contains("limit l warning"), "{}", found.raised);
    let kept = kept::read(&file).unwrap().unwrap();
    assert_ne!(kept.before.run_up, RunUp::default(), "a run is under way");
    assert_eq!(*kept.before.baseline, settings().baseline);
    assert_eq!(again::baseline(&file).unwrap(), Some(settings().baseline));
    let (_, judged) = judged();
    assert_eq!(kept.settings, judged.settings);
    assert_eq!(kept.hints, judged.hints);
}

#[test]
fn the_state_before_the_first_window_decides() {
    // At 30 s a run is under way and the limit's delay has begun: whoever forgets that finds something else.
    let folder = tempfile::tempdir().unwrap();
    let forget = |carried: &Carried| Carried {
        baseline: Arc::clone(&carried.baseline),
        ..Carried::default()
    };
    let (file, _) = capture_with(folder.path(), 30.0, &|_| (), &forget);
    let error = again::judge(&file).unwrap_err().to_string();
    assert!(error.contains("of another machine"), "limits without a state: {error}");
    let forget = |carried: &Carried| Carried { run_up: RunUp::default(), ..carried.clone() };
    let (file, _) = capture_with(folder.path(), 30.0, &|_| (), &forget);
    let found = again::judge(&file).unwrap().unwrap();
    assert!(!found.is_equal(), "{:?}", found.windows);
}

#[test]
fn one_count_that_is_another_one_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = capture(folder.path(), 7.0, |run| {
        if let (RawSamples::I16(raw), 30) = (&mut run.raw, run.start.0 / 2000) {
            raw[700] += 1;
        }
    });
    let found = again::judge(&file).unwrap().unwrap();
    let different: Vec<_> = found.windows.iter().filter(|w| !w.is_equal()).collect();
    assert!(!found.is_equal() && !different.is_empty());
    for window in &different {
        // The sample lies at 35.65 s.
        assert!(window.time_s.0 < 35.66 && window.n_different > 0, "{window:?}");
    }
    assert!(found.windows.iter().any(again::Compared::is_equal), "the windows before it");
}

#[test]
fn a_capture_of_another_kind_keeps_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (_, judged) = judged();
    let plan = Plan::new(&stream(), &judged.received, 7.0).unwrap();
    let file = folder.path().join("m-00000002.h5");
    plan.create(&file, &RecordingHeader::default(), &judged.received).unwrap().close().unwrap();
    assert!(again::judge(&file).unwrap().is_none());
}
