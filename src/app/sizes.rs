//! What the parts of the store take on the disk, how fast they grow, and how long that can go on.
//!
//! Growth is measured from the first look, at the start of the daemon. What was removed meanwhile is taken off, and logs of
//! databases, which are used again and again, are left out. Must not know who asks.

use crate::api::handles::PartSize;
use crate::api::handles::StoreSizes;
use crate::config::Config;
use crate::store::sqlite;
use crate::store::trends::Holdings;
use crate::telemetry::Metrics;
use prometheus_client::metrics::gauge::Gauge;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;
use tokio::sync::watch;

/// Shortest time over which growth is measured, s: a minute of trends and a file of a recording come in steps.
const SHORTEST_S: f64 = 600.0;

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Ends of the names of a database's logs.
const LOGS: [&str; 2] = ["-wal", "-shm"];

/// Looks at the parts.
#[derive(Debug)]
pub(super) struct Sizes {
    /// The database of alarms.
    alarms: PathBuf,
    /// Bytes of captures, and how many they may be; `None`: none are made.
    captures: Option<(Gauge, u64)>,
    /// Bytes that are free on the disk.
    free: Gauge,
    /// When the first look was, and what there was then.
    first: Option<(Instant, [Part; 4])>,
    told: watch::Sender<StoreSizes>,
}

/// What trends and recordings take and may take, bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taken {
    pub(super) trends: Holdings,
    pub(super) trends_limit: u64,
    /// `None`: nothing is recorded.
    pub(super) recordings: Option<u64>,
    pub(super) recordings_limit: u64,
}

/// A part at a look, bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    name: &'static str,
    /// `None`: it is off.
    bytes: Option<u64>,
    /// Of them those of logs.
    log_bytes: u64,
    limit: Option<u64>,
}

impl Sizes {
    /// Makes what looks, and the receiver of what it sees.
    pub(super) fn new(config: &Config, metrics: &Metrics) -> (Self, watch::Receiver<StoreSizes>) {
        let (told, seen) = watch::channel(StoreSizes::default());
        let alarms = config.store.directory.join(sqlite::FILE);
        let captures = config.captures.map(|some| (metrics.captures().bytes, some.max_bytes));
        (Self { alarms, captures, free: metrics.room().free, first: None, told }, seen)
    }

    /// Looks, and tells.
    pub(super) fn look(&mut self, taken: &Taken, now: Instant) {
        let length = |end: &str| {
            let mut name = self.alarms.clone().into_os_string();
            name.push(end);
            fs::metadata(name).map_or(0, |found| found.len())
        };
        let log_bytes = LOGS.iter().map(|end| length(end)).sum();
        let captures = self.captures.as_ref();
        let captured = captures.map(|(bytes, _)| u64::try_from(bytes.get()).unwrap_or(0));
        let part = |name, bytes, limit| Part { name, bytes, log_bytes: 0, limit };
        let recordings_limit = taken.recordings.map(|_| taken.recordings_limit);
        let (trends, trends_limit) = (taken.trends, Some(taken.trends_limit));
        let parts = [
            Part { log_bytes, ..part("alarms", Some(length("") + log_bytes), None) },
            Part {
                log_bytes: trends.log_bytes,
                ..part("trends", Some(trends.bytes), trends_limit)
            },
            part("recordings", taken.recordings, recordings_limit),
            part("captures", captured, captures.map(|(_, limit)| *limit)),
        ];
        let (begun, first) = *self.first.get_or_insert((now, parts));
        let measured_s = now.saturating_duration_since(begun).as_secs_f64();
        self.told.send_replace(StoreSizes {
            measured_s,
            parts: projected(&parts, &first, measured_s),
            free_bytes: u64::try_from(self.free.get()).ok().filter(|free| *free > 0),
        });
    }
}

/// What there is now beside what there was `span_s` before, s.
fn projected(now: &[Part], before: &[Part], span_s: f64) -> Vec<PartSize> {
    let growth = |now: &Part, before: &Part| {
        let lasting = |part: &Part| Some(part.bytes?.saturating_sub(part.log_bytes) as f64);
        let grown = lasting(now)? - lasting(before)?;
        (span_s >= SHORTEST_S).then(|| grown * DAY_S / span_s)
    };
    let both = || now.iter().zip(before);
    let of_trends = both().find(|(part, _)| part.name == "trends");
    let of_trends = of_trends.and_then(|(now, before)| growth(now, before)).unwrap_or(0.0);
    let sized = both().map(|(part, before)| {
        let growth_bytes_per_day = growth(part, before);
        // Recordings give way to trends: these take of their room.
        let taken = if part.name == "recordings" { of_trends.max(0.0) } else { 0.0 };
        PartSize {
            name: part.name,
            bytes: part.bytes,
            limit_bytes: part.limit,
            growth_bytes_per_day,
            days_to_limit: days(part, growth_bytes_per_day.map(|growth| growth + taken)),
        }
    });
    sized.collect()
}

/// Days until a part reaches its limit at so many bytes a day, 0 where it has; `None`: unknown, or never.
fn days(part: &Part, bytes_per_day: Option<f64>) -> Option<f64> {
    let (bytes, limit) = (part.bytes?, part.limit?);
    if bytes >= limit {
        return Some(0.0);
    }
    let rate = bytes_per_day.filter(|rate| *rate > 0.0)?;
    Some((limit - bytes) as f64 / rate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const MB: u64 = 1_000_000;

    fn part(name: &'static str, mb: u64, limit_mb: Option<u64>) -> Part {
        Part { name, bytes: Some(mb * MB), log_bytes: 0, limit: limit_mb.map(|mb| mb * MB) }
    }

    #[test]
    fn what_grows_is_projected_from_ten_minutes_on() {
        let before = [part("trends", 10, Some(100)), part("captures", 7, Some(50))];
        let now = [part("trends", 12, Some(100)), part("captures", 7, Some(50))];
        for one in projected(&now, &before, SHORTEST_S - 1.0) {
            assert_eq!((one.growth_bytes_per_day, one.days_to_limit), (None, None), "{one:?}");
        }
        // 2 MB in half a day are 4 MB a day: 88 MB are reached after 22 days.
        let all = projected(&now, &before, DAY_S / 2.0);
        assert_eq!(all[0].growth_bytes_per_day, Some(4e6));
        assert_eq!(all[0].days_to_limit, Some(22.0));
        assert_eq!((all[1].growth_bytes_per_day, all[1].days_to_limit), (Some(0.0), None));
    }

    #[test]
    fn what_is_full_has_no_days_left_and_what_is_off_or_shrinks_no_number() {
        let full = projected(&[part("captures", 50, Some(50))], &[part("captures", 50, None)], 0.0);
        assert_eq!((full[0].bytes, full[0].days_to_limit), (Some(50 * MB), Some(0.0)));
        let off = Part { bytes: None, ..part("recordings", 0, Some(9)) };
        let off = projected(&[off], &[off], DAY_S);
        assert_eq!((off[0].growth_bytes_per_day, off[0].days_to_limit), (None, None));
        let shrunk = [part("trends", 3, Some(9))];
        let shrunk = projected(&shrunk, &[part("trends", 4, Some(9))], DAY_S);
        assert_eq!(shrunk[0].growth_bytes_per_day, Some(-1e6));
        assert_eq!(shrunk[0].days_to_limit, None);
    }

    #[test]
    fn logs_are_counted_and_no_growth_and_trends_take_the_room_of_recordings() {
        let log = |mb, log_mb| Part { log_bytes: log_mb * MB, ..part("trends", mb, Some(100)) };
        let now = [log(26, 16), part("recordings", 20, Some(50))];
        let before = [log(8, 0), part("recordings", 17, Some(60))];
        let all = projected(&now, &before, DAY_S);
        assert_eq!((all[0].bytes, all[0].growth_bytes_per_day), (Some(26 * MB), Some(2e6)));
        // 30 MB are left; 3 MB a day of their own and 2 MB of trends take them.
        assert_eq!(all[1].growth_bytes_per_day, Some(3e6));
        assert_eq!(all[1].days_to_limit, Some(6.0));
    }

    #[test]
    fn the_parts_of_a_folder_are_seen_from_the_first_look_on() {
        let folder = tempfile::TempDir::new().unwrap();
        let mut config = Config::default();
        config.store.directory = folder.path().to_owned();
        fs::write(folder.path().join(sqlite::FILE), [0; 300]).unwrap();
        fs::write(folder.path().join("state.db-wal"), [0; 40]).unwrap();
        let metrics = Metrics::new();
        let (mut sizes, seen) = Sizes::new(&config, &metrics);
        let trends = Holdings { bytes: 1000, ..Holdings::default() };
        let taken = Taken { trends, trends_limit: 5000, recordings: None, recordings_limit: 4000 };
        let begun = super::super::now();
        sizes.look(&taken, begun);
        let first = seen.borrow().clone();
        let bytes: Vec<_> = first.parts.iter().map(|part| (part.name, part.bytes)).collect();
        assert_eq!(
            bytes[..3],
            [("alarms", Some(340)), ("trends", Some(1000)), ("recordings", None)]
        );
        assert!(first.parts.iter().all(|part| part.growth_bytes_per_day.is_none()));
        fs::write(folder.path().join(sqlite::FILE), [0; 800]).unwrap();
        sizes.look(&taken, begun + Duration::from_secs(86_400));
        let later = seen.borrow().clone();
        assert!((later.measured_s - DAY_S).abs() < 1e-9);
        assert_eq!(later.parts[0].growth_bytes_per_day, Some(500.0));
        assert_eq!(later.parts[0].days_to_limit, None, "nothing of alarms is removed");
    }
}
