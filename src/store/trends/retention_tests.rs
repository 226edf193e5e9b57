//! What is too old or too much goes file by file, and nothing else.

#![expect(clippy::cast_possible_truncation, reason = "test values are small")]
#![expect(clippy::float_cmp, reason = "counts are exact")]

use super::retention::files;
use super::tests::START;
use super::tests::every_5_s;
use super::tests::minutes;
use super::tests::open;
use super::tests::query;
use super::tests::stream;
use super::tests::tidy;
use super::*;
use std::fs;
use std::fs::File;
use std::path::Path;
use std::time::Duration;
use std::time::UNIX_EPOCH;
use tempfile::TempDir;

const DAY_S: f64 = 86_400.0;

/// Stores two minutes a day, gives the files the times of their days.
fn fill(folder: &TempDir, n_days: u32) -> SqliteTrends {
    let mut store = open(folder);
    let stream = stream("m", "s", Some(START));
    for day in 0..n_days {
        let times = every_5_s(24).map(|t| t + DAY_S * f64::from(day));
        store.keep(&minutes(&stream, times), START).unwrap();
    }
    tidy(&mut store);
    drop(store);
    for (period, path) in files(&folder.path().join("trends")) {
        let end = Duration::from_nanos(period.end().0.cast_unsigned());
        File::open(&path).unwrap().set_modified(UNIX_EPOCH + end).unwrap();
    }
    SqliteTrends::open(folder.path(), RETENTION).unwrap()
}

const RETENTION: Retention = Retention { windows_days: 5, minutes_days: 40, hours_days: 100 };

fn names(folder: &TempDir, tier: Tier) -> Vec<String> {
    let all = files(&folder.path().join("trends")).into_iter();
    all.filter(|(period, _)| period.tier == tier).map(|(period, _)| period.name()).collect()
}

fn at_day(day: f64) -> Timestamp {
    START.plus_seconds(day * DAY_S)
}

#[test]
fn what_is_too_old_goes_in_whole_files_tier_by_tier() {
    let folder = TempDir::new().unwrap();
    let mut store = fill(&folder, 10);
    let held = store.prune(at_day(9.0), u64::MAX);
    // The file of day 3 ended on 2026-11-26 00:00, 5 days and 10 hours before.
    assert_eq!(names(&folder, Tier::Windows).first().map(String::as_str), Some("2026-11-26.db"));
    assert_eq!((names(&folder, Tier::Windows).len(), held.n_removed), (6, 4));
    assert_eq!(names(&folder, Tier::Minutes), ["2026-11.db", "2026-12.db"]);
    let archive = SqliteTrendArchive::new(folder.path());
    let days = |tier| {
        let table = archive.trend(&query(tier)).unwrap();
        let mut days: Vec<i64> = table.time_s.iter().map(|t| (t / DAY_S) as i64).collect();
        days.dedup();
        days.len()
    };
    assert_eq!((days(Tier::Windows), days(Tier::Minutes), days(Tier::Hours)), (6, 10, 10));
    store.prune(at_day(60.0), u64::MAX);
    assert_eq!(names(&folder, Tier::Windows), ["2026-12-01.db"], "the newest of a tier stays");
    assert_eq!(names(&folder, Tier::Minutes), ["2026-12.db"]);
    assert_eq!(names(&folder, Tier::Hours), ["2026.db"]);
}

#[test]
fn what_is_removed_was_made_coarser_before() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    let stream = stream("m", "s", Some(START));
    for day in [0.0, 1.0] {
        store.keep(&minutes(&stream, every_5_s(24).map(|t| t + DAY_S * day)), START).unwrap();
    }
    // Nothing has been made coarser yet; written now, the files are old by age only far ahead.
    store.prune(at_day(100_000.0), u64::MAX);
    assert_eq!(names(&folder, Tier::Windows).len(), 1);
    let archive = SqliteTrendArchive::new(folder.path());
    let table = archive.trend(&query(Tier::Minutes)).unwrap();
    assert_eq!(table.column("rms").unwrap().n.iter().sum::<f32>(), 48.0);
}

#[test]
fn a_capture_of_long_ago_is_new_when_it_is_played() {
    let folder = TempDir::new().unwrap();
    let mut store = SqliteTrends::open(folder.path(), RETENTION).unwrap();
    let old = stream("m", "s", Some(Timestamp(0)));
    for day in 0..3 {
        let times = every_5_s(24).map(|t| t + DAY_S * f64::from(day));
        store.keep(&minutes(&old, times), at_day(0.0)).unwrap();
    }
    let now = fs::metadata(folder.path().join("trends/1970-01-01.db")).unwrap().modified().unwrap();
    let now = Timestamp(i64::try_from(now.duration_since(UNIX_EPOCH).unwrap().as_nanos()).unwrap());
    store.prune(now.plus_seconds(4.0 * DAY_S), u64::MAX);
    assert_eq!(names(&folder, Tier::Windows).len(), 3);
    store.prune(now.plus_seconds(6.0 * DAY_S), u64::MAX);
    assert_eq!(names(&folder, Tier::Windows).len(), 1);
}

#[test]
fn above_the_limit_the_oldest_windows_go_first() {
    let folder = TempDir::new().unwrap();
    let mut store = fill(&folder, 8);
    let length = |path: &Path| fs::metadata(path).unwrap().len();
    let all = files(&folder.path().join("trends"));
    let total: u64 = all.iter().map(|(_, path)| length(path)).sum();
    let first: u64 = all[..2].iter().map(|(_, path)| length(path)).sum();
    let held = store.prune(at_day(1.0), total - first);
    assert_eq!((names(&folder, Tier::Windows).len(), held.n_removed), (6, 2));
    assert!(held.bytes <= total - first, "{} of {total}", held.bytes);
    // A limit that nothing keeps leaves what is being written.
    store.prune(at_day(1.0), 1);
    assert_eq!(names(&folder, Tier::Windows), ["2026-11-29.db"]);
    assert_eq!(names(&folder, Tier::Hours), ["2026.db"]);
}

#[test]
fn the_projection_holds_what_noise_takes() {
    let folder = TempDir::new().unwrap();
    let mut store = open(&folder);
    let stream = stream("m", "s", Some(START));
    for part in minutes(&stream, every_5_s(12 * 60 * 12)).chunks(200) {
        store.keep(part, START).unwrap();
    }
    drop(store);
    let features = features_per_channel(folder.path()).unwrap();
    assert!((features - 2.0).abs() < 1e-9, "{features}");
    let (_, bytes, _) = retention::held(&folder.path().join("trends"));
    let retention = Retention { windows_days: 1, minutes_days: 1, hours_days: 1 };
    // Half a day of two channels is stored, two days are projected.
    let projected = project(&retention, 2, 5.0, Some(features)).windows_bytes / 4;
    assert!(bytes <= projected && projected < 20 * bytes, "{bytes} of {projected}");
    let more = project(&Retention::default(), 4, 5.0, None).total();
    assert!(more < 20_000_000_000, "the defaults fit a small machine: {more}");
}

#[test]
fn a_file_that_was_made_coarser_is_read_again_when_it_changes() {
    let folder = TempDir::new().unwrap();
    let stream = stream("m", "s", Some(START));
    let mut store = open(&folder);
    store.keep(&minutes(&stream, every_5_s(24)), START).unwrap();
    tidy(&mut store);
    drop(store);
    let archive = SqliteTrendArchive::new(folder.path());
    let ask = || archive.trend(&query(Tier::Hours)).unwrap();
    let first = ask();
    assert!(!first.time_s.is_empty());
    assert_eq!(ask(), first, "from what is known of the files");
    // More comes to the same day: made coarser on the way out, then stored.
    let mut store = open(&folder);
    store.keep(&minutes(&stream, every_5_s(24).map(|t| t + 7200.0)), START).unwrap();
    let more = ask();
    assert!(more.time_s.len() > first.time_s.len(), "{more:?}");
    tidy(&mut store);
    assert_eq!(ask(), more);
    drop(store);
    assert_eq!(ask(), more);
    assert_eq!(ask(), more);
}
