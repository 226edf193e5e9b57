//! The flow as a whole: windows, gaps, duplicates, block sizes.

use super::Monitor;
use super::MonitorError;
use super::Outcome;
use super::Plans;
use super::Renewal;
use super::Settings;
use super::SpeedHints;
use crate::alarms::Moment;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::rate::FalseAlarms;
use crate::dsp::real::Real;
use crate::machine::file;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::signal::Timestamp;
use crate::units::Hz;
use crate::units::Unit;
use std::f64::consts::TAU;
use std::sync::Arc;

const RATE_HZ: f64 = 5000.0;

/// 6205-like bearing: BPFO 3.585, BPFI 5.415 times 20 Hz.
const MACHINE: &str = "[machine]\nid = \"m\"\nname = \"m\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 20.0\n\
    [[bearing]]\nid = \"b\"\nshaft = \"main\"\nelements = 9\nelement_diameter_mm = 7.94\n\
    pitch_diameter_mm = 39.04\n[[sensor]]\nchannel = \"acc\"\nkind = \"accelerometer\"\n\
    at = { bearing = \"b\" }\n";

/// An inner-race defect in noise: impacts at BPFI, stronger in the load zone, ringing at 1.4 kHz.
fn signal(n: usize) -> Vec<f32> {
    let mut state = 7_u64;
    let mut noise = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    let rate = 5.4152 * 20.0 * 0.997;
    let sample = |i: usize| {
        let t = i as f64 / RATE_HZ;
        let since = (t * rate).fract() / rate;
        let load = 1.0 + 0.6 * (TAU * 20.0 * t).cos();
        let ringing = load * (-since / 8e-4).exp() * (TAU * 1400.0 * since).sin();
        3.0 * ringing + 0.2 * (TAU * 20.0 * t).cos() + 0.5 * noise()
    };
    let mut sample = sample;
    (0..n).map(|i| f32::rounded(sample(i))).collect()
}

fn channel(name: &str) -> ChannelInfo {
    ChannelInfo {
        name: name.to_owned(),
        sample_rate: Hz(RATE_HZ),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    }
}

fn monitor() -> Monitor {
    let machine = Arc::new(file::parse(MACHINE, "m.toml").unwrap());
    let settings = Settings::default();
    Monitor::new(machine, vec![channel("acc")], SpeedHints::default(), &settings).unwrap()
}

/// Cuts samples `range` of `x` into blocks of `size`.
fn blocks(x: &[f32], range: std::ops::Range<usize>, size: usize) -> Vec<Block> {
    range
        .clone()
        .step_by(size)
        .map(|start| Block {
            channel: ChannelIndex(0),
            start: SampleIndex(start as u64),
            segment: 0,
            time_s: start as f64 / RATE_HZ,
            samples: x[start..(start + size).min(range.end)].to_vec(),
        })
        .collect()
}

fn run(blocks: &[Block]) -> (Vec<Outcome>, Monitor) {
    let mut monitor = monitor();
    let mut outcomes = Vec::new();
    for block in blocks {
        monitor.step(block, &mut |o| outcomes.push(o));
    }
    monitor.finish(&mut |o| outcomes.push(o));
    (outcomes, monitor)
}

#[test]
fn a_channel_that_no_sensor_names_neither_ends_nor_begins_windows() {
    let x = signal(60_000);
    let machine = Arc::new(file::parse(MACHINE, "m.toml").unwrap());
    let channels = vec![channel("acc"), channel("oil")];
    let mut monitor =
        Monitor::new(machine, channels, SpeedHints::default(), &Settings::default()).unwrap();
    let mut outcomes = Vec::new();
    for block in blocks(&x, 0..60_000, 1000) {
        // Twenty seconds ahead, and in another run.
        let time_s = block.time_s + 20.0;
        let oil = Block { channel: ChannelIndex(1), time_s, segment: 3, ..block.clone() };
        monitor.step(&oil, &mut |o| outcomes.push(o));
        monitor.step(&block, &mut |o| outcomes.push(o));
    }
    monitor.finish(&mut |o| outcomes.push(o));
    let alone = run(&blocks(&x, 0..60_000, 1000)).0;
    let verdicts = |outcomes: &[Outcome]| -> Vec<_> {
        outcomes.iter().map(|o| o.diagnosis.components.clone()).collect()
    };
    assert_eq!(verdicts(&outcomes), verdicts(&alone));
    assert_eq!(monitor.rings[1].status().newest, SampleIndex(60_000), "kept all the same");
}

#[test]
fn an_inner_race_defect_is_found_and_raises_an_alarm() {
    let x = signal(60_000);
    let (outcomes, _) = run(&blocks(&x, 0..60_000, 1000));
    assert_eq!(outcomes.len(), 2, "hops end at 5 and 10 s; 2 s are less than half a hop");
    let bearing = &outcomes[1].diagnosis.components[0];
    assert!(bearing.state.is_accusation(), "{bearing:?}");
    assert_eq!(bearing.fault, Some(FaultMode::InnerRace));
    assert_eq!(outcomes[0].alarm_events.len(), 1);
    assert_eq!(outcomes[1].diagnosis.samples_used, 50_000);
}

#[test]
fn what_is_less_sure_than_asked_is_neither_accused_nor_acquitted() {
    let x = signal(30_000);
    let judged = |per_decision: f64| {
        let false_alarms = FalseAlarms { per_decision, a_year: Some(0.1) };
        let settings = Settings { false_alarms, ..Settings::default() };
        let machine = Arc::new(file::parse(MACHINE, "m.toml").unwrap());
        let hints = SpeedHints::default();
        let mut monitor = Monitor::new(machine, vec![channel("acc")], hints, &settings).unwrap();
        let mut newest = None;
        for block in blocks(&x, 0..30_000, 1000) {
            monitor.step(&block, &mut |o| newest = Some(o));
        }
        newest.unwrap().diagnosis
    };
    let offline = judged(1e-3);
    assert!(offline.components[0].state.is_accusation() && offline.notes.is_empty());
    // No line is as sure as that.
    let strict = judged(0.0);
    assert_eq!(strict.components[0].state, State::Undetermined, "{:?}", strict.components[0]);
    assert!(strict.components[0].why.contains("accusations are held to"));
    assert!(strict.notes[0].contains("not verified by counting"), "{:?}", strict.notes);
}

#[test]
fn block_size_changes_nothing() {
    let x = signal(60_000);
    let (a, _) = run(&blocks(&x, 0..60_000, 137));
    let (b, _) = run(&blocks(&x, 0..60_000, 20_011));
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(&b) {
        assert_eq!(a.diagnosis, b.diagnosis, "bit for bit");
        assert_eq!(a.features, b.features);
        assert_eq!(a.alarm_events, b.alarm_events);
    }
}

/// Everything an outcome says, to the last digit.
fn told(outcomes: &[Outcome]) -> String {
    let all =
        |o: &Outcome| format!("{:?}\n", (&o.features, &o.diagnosis, &o.judged, &o.alarm_events));
    outcomes.iter().map(all).collect()
}

#[test]
fn kept_plans_change_no_bit() {
    // Windows of 5, 10, 10 and 3 s: plans are used again, and for other lengths between.
    let x = signal(90_000);
    let blocks = blocks(&x, 0..90_000, 1000);
    let (kept, mut other) = run(&blocks);
    let (mut always_new, mut exchanging) = (monitor(), monitor());
    let (mut fresh, mut exchanged) = (Vec::new(), Vec::new());
    for block in &blocks {
        *always_new.plans_mut() = Plans::new();
        always_new.step(block, &mut |o| fresh.push(o));
        // Those that another machine has used, as in a shard.
        std::mem::swap(exchanging.plans_mut(), other.plans_mut());
        exchanging.step(block, &mut |o| exchanged.push(o));
        std::mem::swap(exchanging.plans_mut(), other.plans_mut());
    }
    *always_new.plans_mut() = Plans::new();
    always_new.finish(&mut |o| fresh.push(o));
    exchanging.finish(&mut |o| exchanged.push(o));
    assert!(kept.len() >= 3 && kept.iter().all(|o| !o.diagnosis.components.is_empty()));
    assert_eq!(told(&kept), told(&fresh));
    assert_eq!(told(&kept), told(&exchanged));
}

#[test]
fn duplicated_blocks_are_counted_and_change_nothing() {
    let x = signal(60_000);
    let once = blocks(&x, 0..60_000, 1000);
    let twice: Vec<Block> = once.iter().flat_map(|b| [b.clone(), b.clone()]).collect();
    let ((a, _), (b, monitor)) = (run(&once), run(&twice));
    assert_eq!(a[1].diagnosis, b[1].diagnosis);
    assert_eq!(monitor.ring_status()[0].duplicated, 60_000);
}

#[test]
fn no_window_spans_a_gap() {
    let x = signal(60_000);
    let mut with_gap = blocks(&x, 0..30_000, 1000);
    with_gap.extend(blocks(&x, 32_000..60_000, 1000));
    let (outcomes, monitor) = run(&with_gap);
    assert_eq!(monitor.ring_status()[0].missing, 2000);
    for outcome in &outcomes {
        for (_, start, end) in &outcome.judged.sample_ranges {
            assert!(*end <= 30_000 || *start >= 32_000, "{start}..{end}");
        }
    }
}

#[test]
fn a_new_segment_starts_new_windows() {
    let x = signal(60_000);
    let mut parts = blocks(&x, 0..20_000, 1000);
    let mut later = blocks(&x, 20_000..60_000, 1000);
    for block in &mut later {
        block.segment = 1;
        block.time_s += 100.0;
    }
    parts.extend(later);
    let (outcomes, _) = run(&parts);
    let spans: Vec<(f64, f64)> = outcomes.iter().map(|o| o.time_s).collect();
    assert_eq!(spans, [(0.0, 4.0), (104.0, 109.0), (104.0, 112.0)]);
}

#[test]
fn a_channel_that_ended_early_is_absent_from_later_windows() {
    let second = MACHINE.replace("channel = \"acc\"", "channel = \"late\"");
    let sensor = &second[second.find("[[sensor]]").unwrap()..];
    let machine = Arc::new(file::parse(&format!("{MACHINE}{sensor}"), "m.toml").unwrap());
    let channels = vec![channel("acc"), channel("late")];
    let settings = Settings::default();
    let hints = SpeedHints::default();
    let mut monitor = Monitor::new(machine, channels, hints, &settings).unwrap();
    let x = signal(150_000);
    let mut outcomes = Vec::new();
    for block in blocks(&x, 0..150_000, 5000) {
        if block.start.0 < 50_000 {
            let other = Block { channel: ChannelIndex(1), ..block.clone() };
            monitor.step(&other, &mut |o| outcomes.push(o));
        }
        monitor.step(&block, &mut |o| outcomes.push(o));
    }
    monitor.finish(&mut |o| outcomes.push(o));
    let newest = outcomes.last().unwrap();
    assert_eq!(newest.time_s, (20.0, 30.0));
    let used: Vec<&str> = newest.judged.sample_ranges.iter().map(|r| r.0.as_str()).collect();
    assert_eq!(used, ["acc"], "samples of the first ten seconds are not those of the last");
}

#[test]
fn rejected_samples_are_told_with_their_reason() {
    let x = signal(30_000);
    let mut monitor = monitor();
    monitor.count_rejected(12, "not finite");
    monitor.count_rejected(3, "not finite");
    let mut outcomes = Vec::new();
    for block in blocks(&x, 0..30_000, 1000) {
        monitor.step(&block, &mut |o| outcomes.push(o));
    }
    assert_eq!(outcomes[0].diagnosis.samples_rejected, 15);
    assert_eq!(outcomes[0].diagnosis.rejected_because, ["15 samples: not finite"]);
}

#[test]
fn samples_that_are_set_aside_are_rejected_once_and_not_used() {
    // Evenly spread values in no order.
    let mut x: Vec<f32> = (0..100_000_u32).map(|i| (i * 7919 % 1009) as f32 - 504.0).collect();
    // In the second half of a window and the first of the next.
    x[40_000] = 1e6;
    let mut monitor = monitor();
    let mut outcomes = Vec::new();
    for block in blocks(&x, 0..100_000, 5000) {
        monitor.step(&block, &mut |o| outcomes.push(o));
    }
    let of: Vec<usize> = outcomes.iter().map(|o| o.judged.set_aside.len()).collect();
    let n = of.iter().copied().max().unwrap();
    assert!((1..=200).contains(&n) && of.iter().filter(|len| **len > 0).count() >= 2, "{of:?}");
    let newest = &outcomes.last().unwrap().diagnosis;
    let told: u64 = newest.samples_rejected;
    assert!((n as u64..=2 * n as u64).contains(&told), "{told}, not once a window: {of:?}");
    let because = "samples: set aside with single samples far off, which are no motion";
    assert_eq!(newest.rejected_because, [format!("{told} {because}")]);
    let [first, ..] = &outcomes[..] else { panic!() };
    let (start, end) = (first.judged.sample_ranges[0].1, first.judged.sample_ranges[0].2);
    assert_eq!(first.diagnosis.samples_used, end - start - first.judged.set_aside.len() as u64);
    let judged: Vec<_> = outcomes.into_iter().map(|o| o.judged).collect();
    let whole = monitor.conclude(&judged).unwrap();
    assert_eq!(
        whole.samples_used + whole.samples_rejected,
        end.max(judged.last().unwrap().sample_ranges[0].2)
    );
}

#[test]
fn settings_that_come_again_change_nothing() {
    // At 1 Hz a window is as long as its fewest samples are.
    for rate_hz in [RATE_HZ, 1.0] {
        let (machine, settings) =
            (Arc::new(file::parse(MACHINE, "m.toml").unwrap()), Settings::default());
        let channels = vec![ChannelInfo { sample_rate: Hz(rate_hz), ..channel("acc") }];
        let hints = SpeedHints::default();
        let mut monitor = Monitor::new(Arc::clone(&machine), channels, hints, &settings).unwrap();
        let before = monitor.settings.clone();
        let now = Moment { stream_s: 0.0, monotonic_s: 0.0, utc: Timestamp(0) };
        monitor.renew(&machine, &settings, Renewal::Judged, now);
        assert_eq!(monitor.settings, before, "{rate_hz} Hz");
    }
}

#[test]
fn the_first_windows_become_the_provisional_baseline() {
    let quiet = signal(40_000);
    // Ten revolutions a segment: no bearing is looked at that could explain a level.
    let slow = MACHINE.replace("speed_hz = 20.0", "speed_hz = 12.0");
    let machine = Arc::new(file::parse(&slow, "m.toml").unwrap());
    let settings = Settings { provisional_segments: Some(6), ..Settings::default() };
    let mut monitor =
        Monitor::new(machine, vec![channel("acc")], SpeedHints::default(), &settings).unwrap();
    let mut outcomes = Vec::new();
    for segment in 0..10_u32 {
        let gain = if segment < 8 { 1.0 } else { 30.0 };
        let block = Block {
            channel: ChannelIndex(0),
            start: SampleIndex(u64::from(segment) * 4000),
            segment,
            time_s: f64::from(segment) * 10.0,
            samples: quiet[..4000].iter().map(|v| v * gain).collect(),
        };
        monitor.step(&block, &mut |o| outcomes.push(o));
    }
    monitor.finish(&mut |o| outcomes.push(o));
    let machine_state =
        |o: &Outcome| o.diagnosis.components.iter().find(|c| c.id == "m").unwrap().state;
    let states: Vec<State> = outcomes.iter().map(machine_state).collect();
    assert_eq!(states[..6], [State::Undetermined; 6], "nothing to compare with yet");
    assert_eq!(states[6..8], [State::Healthy; 2]);
    assert_eq!(states[8..], [State::Damaged; 2]);
    assert!(outcomes[9].diagnosis.provisional_baseline.is_some());
}

#[test]
fn a_stream_without_any_channel_of_the_machine_is_refused() {
    let machine = Arc::new(file::parse(MACHINE, "m.toml").unwrap());
    let refused =
        Monitor::new(machine, vec![channel("z")], SpeedHints::default(), &Settings::default());
    assert!(matches!(refused, Err(MonitorError::NoCommonChannel { .. })));
}

/// A load that turns with the shaft and swells at BPFI: x and y show BPFI ± 1×, their absolute
/// vibration BPFI itself (the source's signature).
fn turning_load(swell: f64) -> [Vec<f32>; 2] {
    let mut state = 11_u64;
    let mut noise = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.1 * ((state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5)
    };
    let mut axes = [Vec::new(), Vec::new()];
    for i in 0..50_000 {
        let t = f64::from(i) / RATE_HZ;
        let load = 1.0 + swell * (TAU * 5.4152 * 20.0 * t).cos();
        axes[0].push(f32::rounded(load * (TAU * 20.0 * t).cos() + noise()));
        axes[1].push(f32::rounded(load * (TAU * 20.0 * t).sin() + noise()));
    }
    axes
}

#[test]
fn a_grown_line_of_the_absolute_vibration_names_the_inner_race() {
    let axis = |name: &str, deg: u32| {
        format!(
            "[[sensor]]\nchannel = \"{name}\"\nkind = \"accelerometer\"\n\
             at = {{ bearing = \"b\" }}\naxis_deg = {deg}.0\n"
        )
    };
    let bearing = &MACHINE[..MACHINE.find("[[sensor]]").unwrap()];
    let text = format!("{bearing}{}{}", axis("x", 0), axis("y", 90));
    let machine = Arc::new(file::parse(&text, "m.toml").unwrap());
    let run = |swell: f64, baseline: &Baseline| {
        let settings = Settings { baseline: baseline.clone(), ..Settings::default() };
        let channels = vec![channel("x"), channel("y")];
        let hints = SpeedHints::default();
        let mut monitor = Monitor::new(Arc::clone(&machine), channels, hints, &settings).unwrap();
        let mut newest = None;
        for (c, samples) in turning_load(swell).into_iter().enumerate() {
            let block = Block {
                channel: ChannelIndex(c),
                start: SampleIndex(0),
                segment: 0,
                time_s: 0.0,
                samples,
            };
            monitor.step(&block, &mut |o| newest = Some(o));
        }
        newest.unwrap()
    };
    let healthy = run(0.0, &Baseline::default());
    let window = [(healthy.judged.speed, healthy.features)];
    let record = Record::of_windows("healthy", &window, &[channel("x"), channel("y")]);
    let baseline = Baseline { records: vec![record], provisional: false };
    let same = run(0.0, &baseline).diagnosis;
    assert_eq!(same.components[0].state, State::Healthy, "{:?}", same.components[0]);
    let damaged = run(0.3, &baseline);
    let ratio = damaged.features[0].get("absolute_cwt_1x_main_ratio");
    assert!(ratio.is_some_and(|r| r > 0.0), "the CWT ratio is among the features shown");
    let found = &damaged.diagnosis.components[0];
    assert_eq!(found.fault, Some(FaultMode::InnerRace), "{found:?}");
    let line = found.evidence.iter().find(|e| e.indicator == "absolute_vibration_bpfi").unwrap();
    // |1 + 0.3 cos| swells by 0.3; the noise of 0.03 RMS an axis moves a line by 1e-3.
    assert!((line.value - 0.3).abs() < 0.01, "{line:?}");
}
