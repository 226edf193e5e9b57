//! What is stored is read back bit by bit, once, in every tier, whatever happened in between.

#![expect(clippy::cast_possible_truncation, reason = "test values are small")]
#![expect(clippy::cast_sign_loss, reason = "test values are small")]
#![expect(clippy::float_cmp, reason = "counts and whole seconds are exact")]

use super::queue::Queue;
use super::*;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastVerdict;
use crate::alarms::past::PastWindow;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::signal::ChannelIndex;
use crate::store::writer::Status;
use crate::units::Hz;
use crate::units::Unit;
use std::fs;
use std::sync::Arc;
use tempfile::TempDir;

/// 2026-11-22 10:00 UTC.
pub(super) const START: Timestamp = Timestamp(1_795_341_600_000_000_000);

pub(super) fn stream(machine: &str, name: &str, start: Option<Timestamp>) -> Arc<PastStream> {
    Arc::new(PastStream {
        machine: machine.to_owned(),
        name: name.to_owned(),
        start,
        begun: Timestamp(1),
        channels: vec!["a".to_owned(), "b".to_owned()],
    })
}

fn begun(stream: &Arc<PastStream>, at: i64) -> Arc<PastStream> {
    Arc::new(PastStream { begun: Timestamp(at), ..PastStream::clone(stream) })
}

/// A number that looks like noise, of a window and a place.
fn noise(time_s: f64, place: u32) -> f64 {
    let mixed = time_s.to_bits() ^ (u64::from(place) << 32);
    let mixed = mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 11) as f64 / (1_u64 << 53) as f64
}

fn verdict(time_s: f64) -> PastVerdict {
    let severity = noise(time_s, 9);
    let state = [State::Healthy, State::Warning, State::Damaged][(time_s as usize / 1000) % 3];
    PastVerdict {
        kind: ComponentKind::Bearing,
        id: "right".to_owned(),
        state,
        fault: state.is_accusation().then_some(FaultMode::InnerRace),
        severity: Some(severity),
        confidence: Some(0.9),
        why: if state.is_accusation() { format!("severity {severity}") } else { String::new() },
    }
}

fn window(time_s: f64) -> PastWindow {
    PastWindow {
        time_s,
        duration_s: 10.0,
        run: Timestamp(7),
        operating: OperatingState::Running,
        speed: Some(Hz(10.0 + noise(time_s, 0))),
        baselines: vec![(Some("id".to_owned()), "record".to_owned()), (None, "x.h5".to_owned())],
        absent: if noise(time_s, 3) < 0.3 { vec![1] } else { Vec::new() },
        verdicts: vec![
            verdict(time_s),
            PastVerdict {
                kind: ComponentKind::Shaft,
                id: "main".to_owned(),
                state: State::Undetermined,
                fault: None,
                severity: None,
                confidence: None,
                why: String::new(),
            },
        ],
    }
}

fn measured(time_s: f64) -> Vec<ChannelFeatures> {
    let feature = |name: &str, value: f64, unit| Feature { name: Arc::from(name), value, unit };
    let channel = |channel: usize, first: u32| ChannelFeatures {
        channel: ChannelIndex(channel),
        sample_range: (0, 1),
        values: vec![
            feature("rms", noise(time_s, first), Unit::MetrePerSecondSquared),
            feature("kurtosis", 3.0 + noise(time_s, first + 1), Unit::One),
        ],
    };
    let mut all = vec![channel(0, 10)];
    if noise(time_s, 3) >= 0.3 {
        all.push(channel(1, 20));
    }
    all
}

/// The minutes of windows at these stream times.
pub(super) fn minutes(
    stream: &Arc<PastStream>,
    times_s: impl IntoIterator<Item = f64>,
) -> Vec<Minute> {
    let mut found: Vec<Minute> = Vec::new();
    for time_s in times_s {
        let minute = Minute::of(stream, time_s);
        if found.last().is_none_or(|last| last.minute != minute) {
            found.push(Minute::new(Arc::clone(stream), minute));
        }
        found.last_mut().unwrap().push(window(time_s), &measured(time_s));
    }
    found
}

/// Window ends every 5 s.
pub(super) fn every_5_s(n: u32) -> impl Iterator<Item = f64> + Clone {
    (1..=n).map(|i| 5.0 * f64::from(i))
}

pub(super) fn open(folder: &TempDir) -> SqliteTrends {
    SqliteTrends::open(folder.path(), Retention::default()).unwrap()
}

fn archive(folder: &TempDir) -> SqliteTrendArchive {
    SqliteTrendArchive::new(folder.path())
}

pub(super) fn query(tier: Tier) -> TrendQuery {
    TrendQuery {
        machine: "m".to_owned(),
        subject: Subject::Channel("a".to_owned()),
        from: Timestamp(START.0 - 400 * 86_400_000_000_000),
        to: Timestamp(START.0 + 400 * 86_400_000_000_000),
        tier,
        features: None,
        origin: Some(START),
    }
}

/// Does everything that is not urgent, as if all streams were idle.
pub(super) fn tidy(store: &mut SqliteTrends) {
    while store.tidy(Timestamp(i64::MAX)).unwrap() {}
}

fn read_all(folder: &TempDir) -> Vec<Minute> {
    let mut all = Vec::new();
    let span = (Timestamp(0), Timestamp(i64::MAX));
    let told = archive(folder).minutes("m", span, &mut |minute| {
        all.push(minute.clone());
        ControlFlow::Continue(())
    });
    assert_eq!(told.unwrap(), [] as [String; 0]);
    all
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn what_was_stored_is_read_back_bit_by_bit() {
    let folder = TempDir::new().unwrap();
    let stored = minutes(&stream("m", "s", Some(START)), every_5_s(300));
    let kept = open(&folder).keep(&stored, START).unwrap();
    assert_eq!(kept.n_again, 0);
    let read = read_all(&folder);
    assert_eq!(read.len(), stored.len());
    for (read, stored) in read.iter().zip(&stored) {
        assert_eq!((&read.windows, read.minute), (&stored.windows, stored.minute));
        let mut channels = stored.channels.clone();
        channels.sort_by_key(|channel| channel.channel);
        assert_eq!(read.channels.len(), channels.len());
        for (read, stored) in read.channels.iter().zip(&channels) {
            assert_eq!(read.features, stored.features);
            for (read, stored) in read.columns.iter().zip(&stored.columns) {
                assert_eq!(bits(read), bits(stored));
            }
        }
    }
    let table = archive(&folder).trend(&query(Tier::Windows)).unwrap();
    assert_eq!(table.time_s, every_5_s(300).collect::<Vec<_>>(), "stream time of the same stream");
    let rms = table.column("rms").unwrap();
    assert_eq!(rms.unit, Unit::MetrePerSecondSquared);
    let expected: Vec<f32> = every_5_s(300).map(|t| noise(t, 10) as f32).collect();
    assert_eq!(bits(&rms.value), bits(&expected));
}

#[test]
fn what_is_stored_twice_in_whatever_parts_is_there_once() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let whole = minutes(&stream, every_5_s(100));
    // Every third window is missing at first, as if a kill had taken parts of minutes.
    let parts = minutes(&stream, every_5_s(100).filter(|t| !(*t as u32 / 5).is_multiple_of(3)));
    let mut store = open(&folder);
    let first = store.keep(&parts, START).unwrap();
    tidy(&mut store);
    let second = store.keep(&whole, START).unwrap();
    assert!(first.n_new > 0 && second.n_new > 0 && second.n_again > 0);
    assert_eq!(store.keep(&whole, START).unwrap().n_new, 0);
    assert_eq!(store.keep(&parts, START).unwrap().n_new, 0);
    tidy(&mut store);
    let elsewhere = TempDir::new().unwrap();
    let mut once = open(&elsewhere);
    once.keep(&whole, START).unwrap();
    tidy(&mut once);
    for tier in Tier::ALL {
        let in_parts = archive(&folder).trend(&query(tier)).unwrap();
        let at_once = archive(&elsewhere).trend(&query(tier)).unwrap();
        assert_eq!(in_parts.time_s, at_once.time_s);
        assert!(!at_once.time_s.is_empty());
        for (a, b) in in_parts.columns.iter().zip(&at_once.columns) {
            assert_eq!(
                (&a.name, bits(&a.value), bits(&a.low)),
                (&b.name, bits(&b.value), bits(&b.low))
            );
        }
    }
}

#[test]
fn a_kill_loses_what_was_not_stored_and_nothing_else() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let all = minutes(&stream, every_5_s(120));
    let mut store = open(&folder);
    store.keep(&all[..5], START).unwrap();
    // No connection is closed and no log returned: what a killed process leaves behind.
    std::mem::forget(store);
    assert_eq!(read_all(&folder).len(), 5);
    let mut store = open(&folder);
    assert_eq!(store.keep(&all[..5], START).unwrap().n_new, 0, "a replay doubles nothing");
    store.keep(&all[7..], START).unwrap();
    let table = archive(&folder).trend(&query(Tier::Windows)).unwrap();
    let gap = table.time_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!((gap - 125.0).abs() < 1e-9, "two minutes are a gap: {gap}");
    tidy(&mut store);
    let minutes = archive(&folder).trend(&query(Tier::Minutes)).unwrap();
    let gap = minutes.time_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!((gap - 180.0).abs() < 1e-9, "nothing is interpolated: {gap}");
}

#[test]
fn minutes_and_hours_are_those_of_the_windows_made_coarser_or_not() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let n = 12 * 60 * 30;
    let mut store = open(&folder);
    for part in minutes(&stream, every_5_s(n)).chunks(100) {
        store.keep(part, START).unwrap();
    }
    let read = |tier, subject: &Subject| {
        archive(&folder).trend(&TrendQuery { subject: subject.clone(), ..query(tier) }).unwrap()
    };
    let channel = Subject::Channel("b".to_owned());
    let bearing = Subject::Component(ComponentKind::Bearing, "right".to_owned());
    for subject in [&channel, &bearing] {
        let before = [read(Tier::Minutes, subject), read(Tier::Hours, subject)];
        tidy(&mut store);
        let after = [read(Tier::Minutes, subject), read(Tier::Hours, subject)];
        let windows = read(Tier::Windows, subject);
        for ((before, after), step_s) in before.iter().zip(&after).zip([60.0, 3600.0]) {
            assert_eq!(before.time_s, after.time_s);
            assert!(after.time_s.len() >= 30);
            for (before, after) in before.columns.iter().zip(&after.columns) {
                assert_eq!(bits(&before.value), bits(&after.value), "{}", after.name);
                let of = windows.column(&after.name).unwrap();
                for (place, start_s) in before_times(&windows, step_s).into_iter().enumerate() {
                    let inside = |t: f64| t >= start_s && t < start_s + step_s;
                    let values: Vec<f32> = windows
                        .time_s
                        .iter()
                        .zip(&of.value)
                        .filter(|(t, v)| inside(**t) && !v.is_nan())
                        .map(|(_, v)| *v)
                        .collect();
                    assert_eq!(after.n[place], values.len() as f32);
                    let low = values.iter().copied().fold(f32::NAN, f32::min);
                    let high = values.iter().copied().fold(f32::NAN, f32::max);
                    assert_eq!(bits(&[after.low[place], after.high[place]]), bits(&[low, high]));
                    let mean =
                        values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
                    assert!((f64::from(after.value[place]) - mean).abs() < 1e-5);
                }
            }
        }
    }
}

/// Starts of the minutes or hours that hold any window.
fn before_times(windows: &Table, step_s: f64) -> Vec<f64> {
    let mut starts: Vec<f64> =
        windows.time_s.iter().map(|t| (t / step_s).floor() * step_s).collect();
    starts.dedup();
    starts
}

#[test]
fn a_newer_stream_replaces_an_older_one_at_its_times_only() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    let old = stream("m", "first settings", Some(START));
    let new = begun(&stream("m", "other settings", Some(START)), 2);
    store.keep(&minutes(&old, every_5_s(60)), START).unwrap();
    tidy(&mut store);
    store.keep(&minutes(&new, every_5_s(24)), START).unwrap();
    let table = archive(&folder).trend(&query(Tier::Windows)).unwrap();
    assert_eq!(table.time_s.len(), 60, "none is doubled, none is lost");
    tidy(&mut store);
    let minutes_of = archive(&folder).trend(&query(Tier::Minutes)).unwrap();
    assert_eq!(minutes_of.columns[0].n.iter().sum::<f32>(), 60.0);
    // A live stream that starts again in the same minute leaves what was before it.
    let live = begun(&stream("m", "live", Some(START.plus_seconds(305.0))), 3);
    store.keep(&minutes(&live, [1.0, 6.0]), START).unwrap();
    let table = archive(&folder).trend(&query(Tier::Windows)).unwrap();
    assert_eq!(table.time_s.len(), 62);
    assert!(table.time_s.is_sorted());
}

#[test]
fn of_streams_without_a_start_the_newest_is_read_at_1970() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    store.keep(&minutes(&stream("m", "one", None), every_5_s(100)), START).unwrap();
    store.keep(&minutes(&begun(&stream("m", "two", None), 2), every_5_s(20)), START).unwrap();
    let wanted = TrendQuery { from: Timestamp(0), origin: None, ..query(Tier::Windows) };
    let table = archive(&folder).trend(&wanted).unwrap();
    assert_eq!(table.time_s, every_5_s(20).collect::<Vec<_>>());
    assert!(folder.path().join("trends/1970-01-01.db").is_file());
}

#[test]
fn a_clock_that_steps_by_an_hour_moves_labels_and_loses_nothing() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    let live = |name, hours: f64, at| {
        begun(&stream("m", name, Some(START.plus_seconds(hours * 3600.0))), at)
    };
    // The wall clock at the writer jumps to and fro while a stream counts on.
    for (n, minute) in minutes(&live("one", 0.0, 1), every_5_s(48)).iter().enumerate() {
        let now = START.plus_seconds(if n % 2 == 0 { 3600.0 } else { -3600.0 });
        store.keep(std::slice::from_ref(minute), now).unwrap();
        store.tidy(now).unwrap();
    }
    // A restart an hour later and one an hour before, by a clock that was set.
    store.keep(&minutes(&live("two", 1.0, 2), every_5_s(12)), START).unwrap();
    store.keep(&minutes(&live("three", -1.0, 3), every_5_s(12)), START).unwrap();
    tidy(&mut store);
    for tier in [Tier::Windows, Tier::Minutes] {
        let table = archive(&folder).trend(&query(tier)).unwrap();
        assert!(table.time_s.is_sorted());
        let column = table.column("rms").unwrap();
        let n =
            if tier == Tier::Windows { column.value.len() as f32 } else { column.n.iter().sum() };
        assert_eq!(n, 72.0);
    }
}

#[test]
fn a_damaged_file_is_put_aside_and_its_day_goes_on() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let all = minutes(&stream, every_5_s(60));
    let mut store = open(&folder);
    store.keep(&all[..3], START).unwrap();
    drop(store);
    let file =
        folder.path().join("trends").join(period::Period::of(Tier::Windows, all[0].minute).name());
    fs::write(&file, vec![0x5a; 40_000]).unwrap();
    let table = archive(&folder).trend(&query(Tier::Windows)).unwrap();
    assert!(table.time_s.is_empty());
    assert!(table.unreadable[0].contains("is damaged"), "{:?}", table.unreadable);
    let mut store = open(&folder);
    store.keep(&all[3..], START).unwrap();
    assert_eq!(store.n_set_aside(), 1);
    assert_eq!(read_all(&folder).len(), all.len() - 3);
    assert!(fs::read(file.with_extension("db.damaged")).unwrap().iter().all(|byte| *byte == 0x5a));
}

#[test]
fn a_newer_file_is_left_alone_and_holds_up_no_other() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let day = minutes(&stream, every_5_s(24));
    let next_day = minutes(&stream, every_5_s(24).map(|t| t + 86_400.0));
    let mut store = open(&folder);
    store.keep(&day, START).unwrap();
    drop(store);
    let name = period::Period::of(Tier::Windows, day[0].minute).name();
    let file = folder.path().join("trends").join(name);
    let connection = rusqlite::Connection::open(&file).unwrap();
    connection.pragma_update(None, "user_version", 99).unwrap();
    drop(connection);
    let before = fs::read(&file).unwrap();
    let status = Status::default();
    let mut queue = Queue::new(Box::new(open(&folder)), &status);
    for minute in day.iter().chain(&next_day) {
        queue.push(minute.clone());
    }
    queue.flush(START);
    assert!(status.n_lost() > 0 && status.n_stored() > 0 && status.n_waiting() == 0);
    queue.push(day[0].clone());
    assert!(queue.flush(START));
    let why = status.failure().unwrap();
    assert!(why.contains("99") && why.contains("newer program"), "{why}");
    assert_eq!(fs::read(&file).unwrap(), before);
    assert!(queue.store().tidy(Timestamp(i64::MAX)).is_ok());
}

/// Refuses while it is told to.
struct Refusing(SqliteTrends, Arc<std::sync::atomic::AtomicBool>);

impl TrendStore for Refusing {
    fn keep(&mut self, minutes: &[Minute], now: Timestamp) -> Result<Kept, StoreError> {
        if self.1.load(std::sync::atomic::Ordering::SeqCst) {
            return Err(StoreError::Database { doing: "storing", source: "disk is full".into() });
        }
        self.0.keep(minutes, now)
    }

    fn tidy(&mut self, now: Timestamp) -> Result<bool, StoreError> {
        self.0.tidy(now)
    }

    fn prune(&mut self, now: Timestamp, max_bytes: u64) -> Holdings {
        self.0.prune(now, max_bytes)
    }

    fn retain(&mut self, retention: Retention) {
        self.0.retain(retention);
    }
}

#[test]
fn what_is_refused_waits_bounded_and_is_stored_when_there_is_room() {
    let folder = TempDir::new().unwrap();
    let refuses = Arc::new(std::sync::atomic::AtomicBool::new(true));
    let all = minutes(&stream("m", "s", Some(START)), every_5_s(240));
    let status = Status::default();
    let max_bytes: usize = all[10..].iter().map(Minute::bytes).sum();
    let store = Refusing(open(&folder), Arc::clone(&refuses));
    let mut queue = Queue::new(Box::new(store), &status).with_max_bytes(max_bytes);
    all.iter().for_each(|minute| queue.push(minute.clone()));
    assert!(queue.flush(START));
    assert!(status.failure().unwrap().contains("disk is full"));
    let lost: u64 = all[..10].iter().map(Minute::n_points).sum();
    let total: u64 = all.iter().map(Minute::n_points).sum();
    assert_eq!((status.n_lost(), status.n_waiting()), (lost, total - lost));
    refuses.store(false, std::sync::atomic::Ordering::SeqCst);
    assert!(!queue.flush(START));
    assert_eq!((status.failure(), status.n_waiting()), (None, 0));
    assert_eq!(status.n_stored(), total - lost);
    assert_eq!(read_all(&folder).len(), all.len() - 10);
}

#[test]
fn span_and_subjects_tell_what_there_is() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    let stream = stream("m", "s", Some(START));
    store.keep(&minutes(&stream, every_5_s(24)), START).unwrap();
    store.keep(&minutes(&stream, every_5_s(24).map(|t| t + 2.0 * 86_400.0)), START).unwrap();
    tidy(&mut store);
    let archive = archive(&folder);
    let (from, to) = archive.span("m", Tier::Windows).unwrap().unwrap();
    assert_eq!((from, to), (START, START.plus_seconds(2.0 * 86_400.0 + 180.0)));
    let wanted = [
        Subject::Channel("a".to_owned()),
        Subject::Channel("b".to_owned()),
        Subject::Component(ComponentKind::Bearing, "right".to_owned()),
        Subject::Component(ComponentKind::Shaft, "main".to_owned()),
    ];
    assert_eq!(archive.subjects("m").unwrap(), wanted);
    assert_eq!(archive.subjects("other").unwrap(), []);
    assert_eq!(archive.span("other", Tier::Windows).unwrap(), None);
}
