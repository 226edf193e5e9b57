//! What storing trends costs, and a store of any size:
//! `cargo run --release --example fill_store -- rate|year|fill DIR [BYTES]`.
//!
//! `rate`: ten minutes of 10 000 channels (100 machines) with 12 features at 1 s, all of them noise, the worst
//! to compress; processor time a second of stream, bytes a channel and second, time of a commit.
//! `year`: a year of one channel in the 1-h tier, read at 1000 points. `fill`: windows of ten machines
//! into DIR until their files take BYTES (1 GB), for the time of a start.

#![expect(clippy::print_stdout, reason = "an example reports to the terminal")]
#![expect(clippy::unwrap_used, reason = "an example may stop")]

use cpu_time::ThreadTime;
use rotorwatch::alarms::past::PastStream;
use rotorwatch::alarms::past::PastVerdict;
use rotorwatch::alarms::past::PastWindow;
use rotorwatch::diagnosis::fault::ComponentKind;
use rotorwatch::diagnosis::fault::State;
use rotorwatch::diagnosis::verdict::OperatingState;
use rotorwatch::features::ChannelFeatures;
use rotorwatch::features::Feature;
use rotorwatch::plot::decimate;
use rotorwatch::signal::ChannelIndex;
use rotorwatch::signal::Timestamp;
use rotorwatch::store::trends::Minute;
use rotorwatch::store::trends::Retention;
use rotorwatch::store::trends::SqliteTrendArchive;
use rotorwatch::store::trends::SqliteTrends;
use rotorwatch::store::trends::Subject;
use rotorwatch::store::trends::Tier;
use rotorwatch::store::trends::TrendArchive;
use rotorwatch::store::trends::TrendQuery;
use rotorwatch::store::trends::TrendStore;
use rotorwatch::units::Hz;
use rotorwatch::units::Unit;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const N_FEATURES: usize = 12;
const RETENTION: Retention =
    Retention { windows_days: 36_500, minutes_days: 36_500, hours_days: 36_500 };

/// 2026-01-01.
const START: Timestamp = Timestamp(1_767_225_600_000_000_000);

#[expect(clippy::disallowed_methods, reason = "an example that measures")]
fn now() -> Instant {
    Instant::now()
}

/// Uniform noise.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Machines that say noise.
struct Plant {
    machines: Vec<(Arc<PastStream>, Vec<ChannelFeatures>)>,
    noise: Noise,
}

impl Plant {
    fn new(n_machines: usize, n_channels: usize) -> Self {
        let names: Vec<Arc<str>> =
            (0..N_FEATURES).map(|n| Arc::from(format!("feature_{n}").as_str())).collect();
        let machine = |n: usize| {
            let stream = PastStream {
                machine: format!("m{n}"),
                name: "live".to_owned(),
                start: Some(START),
                begun: START,
                channels: (0..n_channels).map(|c| format!("c{c}")).collect(),
            };
            let features = |channel| ChannelFeatures {
                channel: ChannelIndex(channel),
                sample_range: (0, 1),
                values: names
                    .iter()
                    .map(|name| Feature { name: Arc::clone(name), value: 0.0, unit: Unit::One })
                    .collect(),
            };
            (Arc::new(stream), (0..n_channels).map(features).collect())
        };
        Self { machines: (0..n_machines).map(machine).collect(), noise: Noise(1) }
    }

    /// One minute of every machine, a window every `hop_s`; and the processor time it took to gather it.
    fn minute(&mut self, minute: u32, hop_s: f64) -> (Vec<Minute>, f64) {
        let (mut minutes, mut cost_s) = (Vec::new(), 0.0);
        for (stream, features) in &mut self.machines {
            let first_s = 60.0 * f64::from(minute);
            let mut gathered = Minute::new(Arc::clone(stream), Minute::of(stream, first_s));
            let mut time_s = first_s;
            while time_s < first_s + 60.0 {
                for feature in features.iter_mut().flat_map(|channel| &mut channel.values) {
                    feature.value = 1.0 + self.noise.next();
                }
                let started = ThreadTime::now();
                gathered.push(window(time_s), features);
                cost_s += started.elapsed().as_secs_f64();
                time_s += hop_s;
            }
            minutes.push(gathered);
        }
        (minutes, cost_s)
    }
}

fn window(time_s: f64) -> PastWindow {
    let verdict = |n: usize| PastVerdict {
        kind: ComponentKind::Bearing,
        id: format!("bearing-{n}"),
        state: State::Healthy,
        fault: None,
        severity: Some(0.1 + 1e-4 * time_s.sin()),
        confidence: Some(0.9),
        why: String::new(),
    };
    PastWindow {
        time_s,
        duration_s: 10.0,
        run: START,
        operating: OperatingState::Running,
        speed: Some(Hz(10.0 + 0.01 * time_s.cos())),
        baselines: Vec::new(),
        absent: Vec::new(),
        verdicts: (0..6).map(verdict).collect(),
    }
}

/// Bytes of the files in a folder.
fn bytes(folder: &Path) -> u64 {
    let files = std::fs::read_dir(folder.join("trends")).unwrap();
    files.map(|file| file.unwrap().metadata().unwrap().len()).sum()
}

fn rate() {
    let folder = tempfile::tempdir().unwrap();
    let mut store = SqliteTrends::open(folder.path(), RETENTION).unwrap();
    let (mut plant, n_minutes) = (Plant::new(100, 100), 10);
    let (mut cost_s, mut commits_ms) = (0.0, Vec::new());
    for minute in 0..n_minutes {
        let (minutes, gathering_s) = plant.minute(minute, 1.0);
        cost_s += gathering_s;
        let at = START.plus_seconds(60.0 * f64::from(minute + 1));
        // As the daemon groups them: 800 channels a commit.
        for group in minutes.chunks(8) {
            let (started, began) = (ThreadTime::now(), now());
            store.keep(group, at).unwrap();
            commits_ms.push(1e3 * began.elapsed().as_secs_f64());
            cost_s += started.elapsed().as_secs_f64();
        }
        let started = ThreadTime::now();
        while store.tidy(at).unwrap() {}
        cost_s += started.elapsed().as_secs_f64();
    }
    let seconds = 60.0 * f64::from(n_minutes);
    let raw_bytes = bytes(folder.path());
    let started = ThreadTime::now();
    while store.tidy(Timestamp(i64::MAX)).unwrap() {}
    let rolling_s = started.elapsed().as_secs_f64();
    commits_ms.sort_by(f64::total_cmp);
    let at = |percent: usize| commits_ms[percent * (commits_ms.len() - 1) / 100];
    println!("10 000 channels of 12 features at 1 s, {seconds} s");
    println!("processor time a second: {:.4} s", cost_s / seconds);
    println!("  minutes and hours of it beside: {:.4} s", rolling_s / seconds);
    println!("bytes a channel and second: {:.1}", raw_bytes as f64 / (1e4 * seconds));
    println!("  with minutes and hours: {:.1}", bytes(folder.path()) as f64 / (1e4 * seconds));
    println!(
        "commit of 800 channels' minutes: median {:.1} ms, p99 {:.1} ms, worst {:.1} ms",
        at(50),
        at(99),
        at(100)
    );
}

fn year() {
    let folder = tempfile::tempdir().unwrap();
    let mut store = SqliteTrends::open(folder.path(), RETENTION).unwrap();
    let mut plant = Plant::new(1, 2);
    for minute in 0..366 * 24 * 4 {
        // A window every quarter of an hour fills each hour as any other number does.
        let (minutes, _) = plant.minute(15 * minute, 60.0);
        store.keep(&minutes, START).unwrap();
    }
    while store.tidy(Timestamp(i64::MAX)).unwrap() {}
    drop(store);
    let archive = SqliteTrendArchive::new(folder.path());
    let mut times_ms = Vec::new();
    for _ in 0..20 {
        let began = now();
        let table = archive
            .trend(&TrendQuery {
                machine: "m0".to_owned(),
                subject: Subject::Channel("c1".to_owned()),
                from: START,
                to: START.plus_seconds(365.0 * 86_400.0),
                tier: Tier::Hours,
                features: None,
                origin: None,
            })
            .unwrap();
        let points = |low: &[f32]| decimate::min_max(low.len(), 1000, |i| f64::from(low[i])).len();
        let kept: usize = table.columns.iter().map(|column| points(&column.low)).sum();
        times_ms.push(1e3 * began.elapsed().as_secs_f64());
        assert!(table.time_s.len() == 8760 && kept > 0);
    }
    // The first question looks into every day and month, whether all of it is made coarser.
    let first_ms = times_ms.remove(0);
    times_ms.sort_by(f64::total_cmp);
    println!(
        "a year of 12 features from the 1-h tier at 1000 points: first {first_ms:.1} ms, then median {:.1} ms, worst {:.1} ms",
        times_ms[9], times_ms[18]
    );
}

fn fill(folder: &Path, max_bytes: u64) {
    let mut store = SqliteTrends::open(folder, RETENTION).unwrap();
    let mut plant = Plant::new(10, 50);
    let mut minute = 0;
    while bytes(folder) < max_bytes {
        let (minutes, _) = plant.minute(minute, 1.0);
        store.keep(&minutes, START.plus_seconds(60.0 * f64::from(minute))).unwrap();
        store.tidy(START.plus_seconds(60.0 * f64::from(minute))).unwrap();
        minute += 1;
    }
    println!("{minute} minutes, {} bytes", bytes(folder));
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["rate"] => rate(),
        ["year"] => year(),
        ["fill", folder] => fill(Path::new(folder), 1_000_000_000),
        ["fill", folder, bytes] => fill(Path::new(folder), bytes.parse().unwrap()),
        _ => println!("fill_store rate | year | fill DIR [BYTES]"),
    }
}
