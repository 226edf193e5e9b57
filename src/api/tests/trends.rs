//! Trends from the store: of before a restart, of components, thinned, with their gaps.

use crate::alarms::past::{PastStream, PastVerdict, PastWindow};
use crate::api::handles::{PartSize, StoreSizes, TrendHandle};
use crate::api::support::Service;
use crate::diagnosis::fault::{ComponentKind, FaultMode, State};
use crate::diagnosis::verdict::OperatingState;
use crate::features::{ChannelFeatures, Feature};
use crate::signal::{ChannelIndex, Timestamp};
use crate::store::trends::{
    Holdings, Minute, Retention, SqliteTrendArchive, SqliteTrends, TrendStore,
};
use crate::store::writer::Status;
use crate::units::Unit;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::watch;

/// Start of the stream that runs, of [`crate::api::support::sample_view`].
const START: Timestamp = Timestamp(1_700_000_000_000_000_000);

const PATH: &str = "/api/v1/machines/rig-1/channels/right_x/trend";

/// Seconds before the start at which an older stream began.
const EARLIER_S: f64 = 7200.0;

fn window(time_s: f64, severity: f64) -> PastWindow {
    let state = if severity < 0.5 { State::Warning } else { State::Damaged };
    PastWindow {
        time_s,
        duration_s: 10.0,
        run: START,
        operating: OperatingState::Running,
        speed: None,
        baselines: Vec::new(),
        absent: Vec::new(),
        verdicts: vec![PastVerdict {
            kind: ComponentKind::Bearing,
            id: "right".to_owned(),
            state,
            fault: Some(FaultMode::InnerRace),
            severity: Some(severity),
            confidence: Some(0.9),
            why: "lines".to_owned(),
        }],
    }
}

/// The service with an hour of an older stream, 20 minutes of it missing, an hour before the start.
pub(super) fn stored(service: Service, folder: &Path) -> Service {
    let stream = Arc::new(PastStream {
        machine: "rig-1".to_owned(),
        name: "live 1".to_owned(),
        start: Some(START.plus_seconds(-EARLIER_S)),
        begun: START,
        channels: vec!["right_x".to_owned()],
    });
    let mut store = SqliteTrends::open(folder, Retention::default()).unwrap();
    let mut minutes: Vec<Minute> = Vec::new();
    for n in 1..=720_u32 {
        let time_s = 5.0 * f64::from(n);
        if (1200.0..2400.0).contains(&time_s) {
            continue;
        }
        let minute = Minute::of(&stream, time_s);
        if minutes.last().is_none_or(|last| last.minute != minute) {
            minutes.push(Minute::new(Arc::clone(&stream), minute));
        }
        let value = if n == 600 { 99.0 } else { f64::from(n % 7) };
        let values = vec![Feature { name: "rms".into(), value, unit: Unit::MetrePerSecondSquared }];
        let measured = ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values };
        let severity = if n > 600 { 0.7 } else { 0.3 };
        minutes.last_mut().unwrap().push(window(time_s, severity), &[measured]);
    }
    store.keep(&minutes, START).unwrap();
    let (_, holdings) = watch::channel(Holdings::default());
    let alarms = PartSize { name: "alarms", bytes: Some(4096), ..PartSize::default() };
    let seen = StoreSizes { measured_s: 60.0, parts: vec![alarms], free_bytes: None };
    let (_, sizes) = watch::channel(seen);
    let archive = Arc::new(SqliteTrendArchive::new(folder));
    service.with_trends(TrendHandle {
        archive,
        status: Arc::new(Status::default()),
        holdings,
        sizes,
    })
}

fn numbers(trend: &Value, name: &str) -> Vec<Option<f64>> {
    trend["features"][0][name].as_array().unwrap().iter().map(Value::as_f64).collect()
}

#[tokio::test]
async fn what_was_before_a_restart_counts_from_the_stream_that_runs_and_shows_its_gap() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = stored(Service::new(), folder.path());
    let span = "from=2023-11-14T20:00:00Z&to=2023-11-14T21:13:20Z&features=rms";
    for (tier, step_s, n) in [("raw", 5.0, 720 - 240), ("1min", 60.0, 42)] {
        let trend = service.get(&format!("{PATH}?tier={tier}&{span}")).await.json();
        assert_eq!(trend["tier"], tier);
        assert!(trend["n_windows"].as_u64().unwrap().abs_diff(n) <= 1, "{}", trend["n_windows"]);
        let (times, values) = (numbers(&trend, "time_s"), numbers(&trend, "value"));
        let first = times[0].unwrap();
        assert!((-EARLIER_S - 60.0..=-EARLIER_S + 5.0).contains(&first), "{first}");
        let gaps = trend["gaps"].as_array().unwrap();
        assert_eq!(gaps.len(), 1, "{gaps:?}");
        let length = gaps[0][1].as_f64().unwrap() - gaps[0][0].as_f64().unwrap();
        assert!((length - 1200.0).abs() <= 2.0 * step_s, "{length}");
        let empty: Vec<usize> =
            (0..values.len()).filter(|place| values[*place].is_none()).collect();
        let [empty] = empty[..] else { panic!("one point without a value: {empty:?}") };
        assert!(times[empty].unwrap() > gaps[0][0].as_f64().unwrap());
        assert!(times[empty].unwrap() < gaps[0][1].as_f64().unwrap());
        // What it rests on: windows of an older stream, whose rate nobody knows, and a hole between them.
        assert_eq!(trend["validity"], "gap");
        let windows: Vec<f64> = numbers(&trend, "windows").into_iter().flatten().collect();
        assert!((windows.iter().sum::<f64>() - 480.0).abs() <= 1.0, "{windows:?}");
        assert!(windows[empty].abs() < 1e-9, "no window is behind it");
        assert!(numbers(&trend, "n_samples").iter().all(Option::is_none), "{trend}");
        // Thinned, the one high value is still there, and so is the gap.
        let thin = service.get(&format!("{PATH}?tier={tier}&{span}&max_points=8")).await.json();
        let of = if tier == "raw" { "value" } else { "high" };
        assert!(numbers(&thin, of).contains(&Some(99.0)), "{thin}");
        assert!(numbers(&thin, of).contains(&None) && numbers(&thin, of).len() <= 9, "{thin}");
        assert_eq!(thin["decimated"], true);
    }
}

#[tokio::test]
async fn what_is_not_stored_yet_comes_from_memory() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = stored(Service::new(), folder.path());
    let in_memory = service.get(PATH).await.json();
    let span = "to=2023-11-15T22:13:20Z&from=2023-11-14T20:00:00Z";
    let trend = service.get(&format!("{PATH}?tier=raw&{span}")).await.json();
    let n = trend["n_windows"].as_u64().unwrap();
    assert_eq!(n, 480 + in_memory["n_windows"].as_u64().unwrap());
    let times = numbers(&trend, "time_s");
    let times: Vec<f64> = times.into_iter().flatten().collect();
    assert!(times.is_sorted());
    let n_samples = numbers(&trend, "n_samples");
    assert_eq!(n_samples.last().copied().flatten(), Some(40_960.0), "of this stream");
}

#[tokio::test]
async fn a_component_has_a_history_and_an_unknown_one_names_what_there_is() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = stored(Service::new(), folder.path());
    let of = |component: &str, query: &str| {
        format!("/api/v1/machines/rig-1/components/bearing/{component}/trend?{query}")
    };
    let hours = service.get(&of("right", "tier=1h&features=state")).await.json();
    assert_eq!(hours["features"][0]["name"], "state");
    assert!(numbers(&hours, "high").contains(&Some(3.0)), "the worst: {hours}");
    assert!(numbers(&hours, "low").contains(&Some(2.0)));
    let severity = service.get(&of("right", "features=severity")).await.json();
    assert_eq!(severity["tier"], "raw");
    let worst = numbers(&severity, "value").into_iter().flatten().fold(0.0, f64::max);
    assert!((worst - 0.7).abs() < 1e-6);
    // The newest windows are there before they are stored.
    let newest = numbers(&severity, "value").last().copied().flatten().unwrap();
    assert!((newest - 0.62).abs() < 1e-6, "{severity}");
    assert_eq!(numbers(&severity, "time_s").last().copied().flatten(), Some(5.0));
    let detail = service.get(&of("left", "")).await.problem(404);
    assert!(detail.contains("bearing right"), "{detail}");
    let detail = service.get(&of("right", "from=x")).await.problem(400);
    assert!(detail.contains("from is \"x\""), "{detail}");
    Service::new().get(&of("right", "")).await.problem(404);
}
