//! What 10,000 limits add to a verdict, and what storing alarms costs: `cargo bench --bench alarms`.
//!
//! Thread CPU time of `AlarmEngine::observe_window` on a window of 100 channels with 30 features each,
//! median and worst of 200 windows: no limit exceeded, all exceeded and standing, and the one window in
//! which all are raised at once. Then the store: CPU time of commits, and of opening a store that
//! holds as many transitions as it keeps. Results and goal: `docs/performance.md`.

#![expect(clippy::print_stdout, reason = "a bench reports to the terminal")]
#![expect(clippy::unwrap_used, reason = "a bench may stop")]

use cpu_time::ThreadTime;
use rotorwatch::alarms::Alarm;
use rotorwatch::alarms::AlarmEngine;
use rotorwatch::alarms::AlarmEvent;
use rotorwatch::alarms::EventKind;
use rotorwatch::alarms::Moment;
use rotorwatch::alarms::Settings;
use rotorwatch::alarms::limit::Measured;
use rotorwatch::diagnosis::baseline::Baseline;
use rotorwatch::diagnosis::fault::State;
use rotorwatch::diagnosis::verdict::Coverage;
use rotorwatch::diagnosis::verdict::DataQuality;
use rotorwatch::diagnosis::verdict::Diagnosis;
use rotorwatch::diagnosis::verdict::OperatingState;
use rotorwatch::features::ChannelFeatures;
use rotorwatch::features::Feature;
use rotorwatch::machine::Machine;
use rotorwatch::machine::alarm_limit::AlarmLimit;
use rotorwatch::machine::alarm_limit::JudgedIn;
use rotorwatch::machine::alarm_limit::Quantity;
use rotorwatch::machine::alarm_limit::Thresholds;
use rotorwatch::machine::file;
use rotorwatch::signal::ChannelIndex;
use rotorwatch::signal::ChannelInfo;
use rotorwatch::store::Archive;
use rotorwatch::store::Batch;
use rotorwatch::store::StateStore;
use rotorwatch::store::StreamKey;
use rotorwatch::store::sqlite;
use rotorwatch::units::Hz;
use rotorwatch::units::Unit;

const N_CHANNELS: usize = 100;
const N_LIMITS: usize = 10_000;
const N_FEATURES: usize = 30;
const N_WINDOWS: usize = 200;
const N_STORED: usize = 1_000_000;

fn machine() -> Machine {
    let sensor = |n: usize| {
        format!("[[sensor]]\nchannel = 'c{n}'\nkind = 'accelerometer'\nat = {{ shaft = 'main' }}\n")
    };
    let sensors: String = (0..N_CHANNELS).map(sensor).collect();
    let head = "[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n";
    let mut machine = file::parse(&format!("{head}{sensors}"), "m.toml").unwrap();
    let limit = |n: usize| AlarmLimit {
        id: format!("limit-{n}"),
        quantity: Quantity::Feature(format!("feature_{}", n % N_FEATURES)),
        unit: Unit::One,
        relative_to_baseline: false,
        sensors: vec![n % N_CHANNELS],
        thresholds: Thresholds {
            warning_above: Some(1.0),
            damaged_above: Some(10.0),
            ..Thresholds::default()
        },
        by_speed: Vec::new(),
        hysteresis: 0.05,
        votes: 1,
        on_delay_s: None,
        off_delay_s: None,
        latching: false,
        raises: true,
        judged_in: JudgedIn::STEADY,
        startup_multiply: None,
    };
    machine.alarm_limits.limits = (0..N_LIMITS).map(limit).collect();
    machine
}

fn channels() -> Vec<ChannelInfo> {
    let info = |n: usize| ChannelInfo {
        name: format!("c{n}"),
        sample_rate: Hz(1000.0),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    (0..N_CHANNELS).map(info).collect()
}

fn features(value: f64) -> Vec<ChannelFeatures> {
    let feature =
        |n: usize| Feature { name: format!("feature_{n}").into(), value, unit: Unit::One };
    let of_channel = |channel: usize| ChannelFeatures {
        channel: ChannelIndex(channel),
        sample_range: (0, 1),
        values: (0..N_FEATURES).map(feature).collect(),
    };
    (0..N_CHANNELS).map(of_channel).collect()
}

fn silent_verdict() -> Diagnosis {
    Diagnosis {
        machine: "m".to_owned(),
        duration_s: 10.0,
        samples_used: 0,
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: None,
        shaft_speeds: Vec::new(),
        speed_source: None,
        speed_confidence: 0.0,
        operating_state: OperatingState::Running,
        state: State::Undetermined,
        coverage: Coverage::default(),
        data_quality: DataQuality::Ok,
        components: Vec::new(),
        warnings: Vec::new(),
        notes: Vec::new(),
        baselines: Vec::new(),
        provisional_baseline: None,
        timeline: None,
        first_warning_s: None,
        first_damaged_s: None,
        sample_ranges: Vec::new(),
    }
}

/// CPU seconds of so many windows, and the events of all of them.
fn run(engine: &mut AlarmEngine, value: f64, from: usize, n: usize) -> (Vec<f64>, usize) {
    let (features, baseline, nothing) = (features(value), Baseline::default(), silent_verdict());
    let measured = Measured {
        operating: OperatingState::Running,
        speed: Some(Hz(10.0)),
        channels: &features,
        baseline: &baseline,
    };
    let mut n_events = 0;
    let window = |window: usize| {
        let started = ThreadTime::now();
        let events = engine.observe_window(&nothing, 5.0 * window as f64, Some(&measured), &[]);
        n_events += events.len();
        started.elapsed().as_secs_f64()
    };
    let costs = (from..from + n).map(window).collect();
    (costs, n_events)
}

fn report(what: &str, mut costs_s: Vec<f64>, n_events: usize) {
    costs_s.sort_by(f64::total_cmp);
    let (median, worst) = (costs_s[costs_s.len() / 2], costs_s[costs_s.len() - 1]);
    println!("{what:<28} {:>9.3} {:>9.3} {n_events:>8}", 1e3 * median, 1e3 * worst);
}

/// A transition of the first alarm.
fn event(sequence: u64, alarm: &Alarm) -> AlarmEvent {
    let kind = EventKind::Raised;
    AlarmEvent { sequence, kind, time_s: sequence as f64, by: None, alarm: alarm.clone() }
}

fn store(alarm: &Alarm) {
    let folder = tempfile::tempdir().unwrap();
    let (mut store, archive) = sqlite::open(folder.path()).unwrap();
    let mut next = 0;
    let mut events = |n: u64| {
        next += n;
        (next - n + 1..=next).map(|sequence| event(sequence, alarm)).collect::<Vec<_>>()
    };
    println!("\n{:<28} {:>9} {:>9} {:>8}", "store, CPU ms", "median", "worst", "events");
    let mut commit = |n: u64| {
        let batch = Batch::new("m", events(n));
        let started = ThreadTime::now();
        store.keep(&[batch]).unwrap();
        started.elapsed().as_secs_f64()
    };
    let costs = (0..N_WINDOWS).map(|_| commit(1)).collect();
    report("commit of one event", costs, 1);
    let costs = (0..N_STORED / 5000).map(|_| commit(5000)).collect();
    report("commit of 5000 events", costs, 5000);
    drop((store, archive));
    let started = ThreadTime::now();
    let (store, archive) = sqlite::open(folder.path()).unwrap();
    report("opening it again", vec![started.elapsed().as_secs_f64()], 1_000_000);
    let started = ThreadTime::now();
    let kept = archive.load("m", &StreamKey::default(), Moment::of_stream(0.0), 1000).unwrap();
    report("loading a machine", vec![started.elapsed().as_secs_f64()], kept.history.len());
    let bytes = std::fs::metadata(folder.path().join(sqlite::FILE)).unwrap().len();
    println!("{bytes} bytes");
    drop(store);
}

fn main() {
    println!(
        "{N_LIMITS} limits on {N_CHANNELS} channels of {N_FEATURES} features, CPU ms a window"
    );
    println!("{:<28} {:>9} {:>9} {:>8}", "", "median", "worst", "events");
    let settings = Settings { history_len: 1000, ..Settings::default() };
    let mut engine = AlarmEngine::of_machine(&machine(), &channels(), settings);
    let (costs, n) = run(&mut engine, 0.5, 1, N_WINDOWS);
    report("none exceeded", costs, n);
    let (costs, n) = run(&mut engine, 2.0, 1 + N_WINDOWS, 1);
    report("all raised at once", costs, n);
    let (costs, n) = run(&mut engine, 2.0, 2 + N_WINDOWS, N_WINDOWS);
    report("all exceeded and standing", costs, n);
    store(&engine.standing()[0]);
}
