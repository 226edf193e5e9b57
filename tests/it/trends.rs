//! Trends as a user meets them: over a restart and a kill, by HTTP, as files, and through other limits.

use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use std::fs;
use std::process::ExitStatus;
use tempfile::TempDir;

/// Seconds of the capture.
const SECONDS: u32 = 600;

/// Windows of it: every 5 s.
const N_WINDOWS: usize = 120;

fn machine(low: f64) -> String {
    format!(
        "{}[[limits.alarm]]\nid = \"low\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = {low}\n\
         off_delay_s = 0\n",
        support::MACHINE
    )
}

/// A daemon's folder: a capture whose level rises and falls, with a start or without.
fn folder(speed: &str, start: &str) -> TempDir {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
         machine = \"rig-1\"\nfile = \"x.h5\"\n{speed}"
    );
    let dir = support::folder(&config, &[("rig.toml", machine(0.5).as_bytes())]);
    let sample = |i: u32| {
        let level = [0.1, 1.0, 0.2, 3.0][usize::try_from(i / 40_000 % 4).unwrap()];
        level * (f64::from(i) * 0.37).sin()
    };
    let samples: Vec<f64> = (0..1000 * SECONDS).map(sample).collect();
    support::write_started(&dir, "x.h5", (1000.0, start), &samples);
    dir
}

const TREND: &str = "/api/v1/machines/rig-1/channels/right_x/trend";

fn trend(daemon: &Daemon, query: &str) -> Value {
    let (status, trend) = daemon.get_json(&format!("{TREND}?{query}"));
    assert_eq!(status, 200, "{trend}");
    trend
}

/// Waits until so many windows are stored.
fn wait_stored(daemon: &Daemon, n: usize) -> Value {
    support::wait_until("stored windows", || {
        let found = trend(daemon, "tier=1min&features=rms&max_points=200000");
        let windows = trend(daemon, "tier=raw&features=rms&max_points=200000");
        let is_all = windows["n_windows"] == n && found["n_windows"] == SECONDS / 60 + 1;
        is_all.then_some(windows)
    })
}

fn column<'v>(trend: &'v Value, name: &str) -> Vec<&'v Value> {
    trend["features"][0][name].as_array().unwrap().iter().collect()
}

fn command(dir: &TempDir, arguments: &[&str]) -> (ExitStatus, String) {
    let config = dir.path().join("serve.toml");
    let mut command = support::command();
    command.args(arguments).arg("--config").arg(config);
    let ended = support::run(&mut command);
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    (ended.status, ended.stdout)
}

#[test]
fn windows_are_stored_once_over_kills_and_read_alike_everywhere() {
    let mut dir = folder("", "2026-11-22T10:00:00Z");
    let mut windows = Value::Null;
    for round in 0..3 {
        let mut daemon = Daemon::start_in(dir);
        if round == 0 {
            // Somewhere in the middle of the capture.
            support::wait_until("some windows", || {
                let now = trend(&daemon, "tier=raw&features=rms");
                (now["n_windows"].as_u64()? >= 20).then_some(())
            });
        } else {
            daemon.wait_finished("rig-1");
            windows = wait_stored(&daemon, N_WINDOWS);
        }
        daemon.signal("KILL");
        daemon.child.wait().unwrap();
        dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    }
    assert_eq!(windows["gaps"].as_array().unwrap().len(), 0);
    assert_eq!(windows["start_time"], "2026-11-22T10:00:00Z");
    let times: Vec<f64> = column(&windows, "time_s").iter().map(|t| t.as_f64().unwrap()).collect();
    let expected: Vec<f64> = (1..=N_WINDOWS).map(|n| 5.0 * n as f64).collect();
    assert_eq!(times, expected, "none lost, none doubled");
    let values: Vec<f64> = column(&windows, "value").iter().map(|v| v.as_f64().unwrap()).collect();
    // Without the daemon, by the command line: the same numbers.
    let (_, csv) =
        command(&dir, &["export", "--format", "csv", "--channel", "right_x", "--feature", "rms"]);
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("time,machine,kind,name,feature,unit,value"));
    let lines: Vec<&str> = lines.collect();
    assert_eq!(lines.len(), N_WINDOWS);
    assert!(
        lines[0].starts_with("2026-11-22T10:00:05Z,rig-1,channel,right_x,rms,m/s^2,"),
        "{}",
        lines[0]
    );
    for (line, value) in lines.iter().zip(&values) {
        let exported: f32 = line.rsplit(',').next().unwrap().parse().unwrap();
        assert!(f64::from(exported).to_bits() == value.to_bits(), "{line} and {value}");
    }
    let (_, minutes) = command(
        &dir,
        &[
            "export",
            "--format",
            "csv",
            "--tier",
            "1min",
            "--feature",
            "rms",
            "--from",
            "2026-11-22T10:02:00Z",
            "--to",
            "2026-11-22T10:05:00Z",
        ],
    );
    assert_eq!(minutes.lines().count(), 1 + 3, "{minutes}");
    let (_, alarms) = command(&dir, &["export", "--format", "csv", "--alarms"]);
    assert!(
        alarms.lines().any(|line| line.contains(",raised,") && line.contains(",limit,low,")),
        "{alarms}"
    );
    let out = dir.path().join("trends.h5");
    command(&dir, &["export", "--format", "hdf5", "--out", out.to_str().unwrap()]);
    assert!(fs::read(&out).unwrap().starts_with(b"\x89HDF"));
}

#[test]
fn coarser_tiers_gaps_and_components_are_served() {
    let daemon = Daemon::start_in(folder("", "2026-11-22T10:00:00Z"));
    daemon.wait_finished("rig-1");
    let windows = wait_stored(&daemon, N_WINDOWS);
    let minutes = trend(&daemon, "tier=1min&features=rms");
    let of = |trend: &Value, name: &str| -> Vec<f64> {
        column(trend, name).iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (times, values) = (of(&windows, "time_s"), of(&windows, "value"));
    for ((start, low), high) in
        of(&minutes, "time_s").iter().zip(of(&minutes, "low")).zip(of(&minutes, "high"))
    {
        let inside = times.iter().zip(&values).filter(|(t, _)| **t >= *start && **t < start + 60.0);
        let inside: Vec<f64> = inside.map(|(_, v)| *v).collect();
        assert!(inside.iter().all(|v| *v >= low && *v <= high), "{start}: {low} {high}");
        assert!(inside.contains(&low) && inside.contains(&high));
    }
    // Thinned to few points the extremes are still there.
    let thin = trend(&daemon, "tier=raw&features=rms&max_points=10");
    assert_eq!(thin["decimated"], true);
    let highest = values.iter().copied().fold(f64::MIN, f64::max);
    assert!(of(&thin, "value").iter().any(|v| v.to_bits() == highest.to_bits()));
    let span = "from=2026-11-22T10:01:00Z&to=2026-11-22T10:02:00Z&features=rms";
    let part = trend(&daemon, span);
    assert_eq!((&part["tier"], &part["n_windows"]), (&Value::from("raw"), &Value::from(12)));
    let path = "/api/v1/machines/rig-1/components/bearing/right/trend?tier=1min";
    let (status, bearing) = daemon.get_json(path);
    assert_eq!(status, 200, "{bearing}");
    assert_eq!((&bearing["component"], &bearing["kind"]), (&"right".into(), &"bearing".into()));
    let names: Vec<&Value> =
        bearing["features"].as_array().unwrap().iter().map(|f| &f["name"]).collect();
    assert_eq!(names, ["state", "severity", "confidence"]);
    for (path, part) in [
        (format!("{TREND}?from=yesterday"), "2026-05-04T12:00:00Z"),
        (format!("{TREND}?tier=2h"), "`raw`, `1min`, `1h`"),
        (format!("{TREND}?from=2026-11-22T10:02:00Z&to=2026-11-22T10:01:00Z"), "is not before"),
        (format!("{TREND}?tier=raw&features=nothing"), "allowed are"),
    ] {
        let (status, problem) = daemon.get_json(&path);
        assert_eq!(status, 400, "{path}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(part), "{problem}");
    }
    let (status, problem) = daemon.get_json("/api/v1/machines/rig-1/components/bearing/left/trend");
    assert!(
        status == 404 && problem["detail"].as_str().unwrap().contains("bearing right"),
        "{problem}"
    );
    let (_, system) = daemon.get_json("/api/v1/system");
    let trends = &system["trends"];
    assert!(trends["failure"].is_null() && trends["stored"].as_u64().unwrap() > 0, "{system}");
    assert_eq!(daemon.metric("rotorwatch_trends_failing"), Some(0.0));
    assert!(daemon.metric("rotorwatch_trend_points_stored_total").unwrap() >= N_WINDOWS as f64);
    // The daemon runs: the command line reads beside it.
    let dir = &daemon.dir;
    let (_, csv) =
        command(dir, &["export", "--format", "csv", "--component", "right", "--tier", "1min"]);
    assert!(csv.lines().count() > 5, "{csv}");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn the_history_raises_what_was_raised_and_with_other_limits_what_they_would() {
    let daemon = Daemon::start_in(folder("", "2026-11-22T10:00:00Z"));
    daemon.wait_finished("rig-1");
    wait_stored(&daemon, N_WINDOWS);
    let dir = &daemon.dir;
    let rerun = |more: &[&str]| -> Value {
        let arguments = [&["replay-alarms", "--format", "json"], more].concat();
        serde_json::from_str(&command(dir, &arguments).1).unwrap()
    };
    let same = rerun(&[]);
    let list = |document: &Value, name: &str| document[name].as_array().unwrap().len();
    assert!(list(&same, "would") >= 4, "{same}");
    assert_eq!((list(&same, "only_would"), list(&same, "only_was")), (0, 0), "{same}");
    assert_eq!(same["windows"], N_WINDOWS);
    fs::write(dir.path().join("high.toml"), machine(1e3)).unwrap();
    let high = dir.path().join("high.toml");
    let none = rerun(&["--with", high.to_str().unwrap()]);
    let limits = |document: &Value, name: &str| {
        let all = document[name].as_array().unwrap().clone();
        all.iter().filter(|change| change["alarm"]["limit"] == "low").count()
    };
    assert_eq!((limits(&none, "would"), limits(&none, "only_was")), (0, limits(&same, "was")));
    let (_, text) = command(dir, &["replay-alarms", "--with", high.to_str().unwrap()]);
    assert!(
        text.contains("Was raised, and would not have been") && text.contains("limit low"),
        "{text}"
    );
    assert!(text.contains("Not told by the history"), "{text}");
}

#[test]
fn a_stream_without_a_start_is_at_1970_and_a_retention_that_cannot_fit_is_refused() {
    let daemon = Daemon::start_in(folder("", ""));
    daemon.wait_finished("rig-1");
    let windows = wait_stored(&daemon, N_WINDOWS);
    assert!(windows["start_time"].is_null());
    let part = trend(&daemon, "from=1970-01-01T00:01:00Z&to=1970-01-01T00:02:00Z&features=rms");
    assert_eq!(part["n_windows"], 12);
    let dir = folder("[store]\nmax_bytes = 1_000_000\n", "");
    let refused = support::refused_in(&dir);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        refused.stderr.contains("trend_days") && refused.stderr.contains("max_bytes"),
        "{}",
        refused.stderr
    );
}

/// Reads an export as any user of Python would, and prints every number of a channel.
const READ_WITH_H5PY: &str = "import sys, h5py\n\
    with h5py.File(sys.argv[1]) as f:\n\
    \x20   found = {}\n\
    \x20   f.visititems(lambda name, o: found.update({name: o}) if isinstance(o, h5py.Dataset) else None)\n\
    \x20   for name in sorted(found):\n\
    \x20       d = found[name]\n\
    \x20       if d.dtype.kind == 'f' and d.ndim == 1: print(name, d.shape[0], repr(float(d[0])), repr(float(d[-1])), sep='\\t')\n";

#[test]
#[ignore = "needs h5py; .ci/run runs it"]
fn an_export_is_read_by_h5py() {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = std::process::Command::new(&python).args(["-c", "import h5py"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        #[expect(clippy::print_stdout, reason = "told in the log of tests")]
        {
            println!("SKIPPED an_export_is_read_by_h5py: {python} has no h5py");
        }
        return;
    }
    let daemon = Daemon::start_in(folder("", "2026-11-22T10:00:00Z"));
    daemon.wait_finished("rig-1");
    let windows = wait_stored(&daemon, N_WINDOWS);
    let dir = &daemon.dir;
    let out = dir.path().join("trends.h5");
    command(
        dir,
        &["export", "--format", "hdf5", "--feature", "rms", "--out", out.to_str().unwrap()],
    );
    let read = std::process::Command::new(&python)
        .args(["-c", READ_WITH_H5PY])
        .arg(&out)
        .output()
        .unwrap();
    let text = String::from_utf8(read.stdout).unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let values: Vec<f64> = column(&windows, "value").iter().map(|v| v.as_f64().unwrap()).collect();
    let (first, last) = (values[0], values[values.len() - 1]);
    let line = text.lines().find(|line| line.contains("rms")).unwrap_or_else(|| panic!("{text}"));
    let parts: Vec<&str> = line.split('\t').collect();
    let number = |at: usize| parts[at].parse::<f64>().unwrap();
    assert_eq!(parts[1], N_WINDOWS.to_string(), "{text}");
    assert_eq!(
        (number(2).to_bits(), number(3).to_bits()),
        (first.to_bits(), last.to_bits()),
        "{text}"
    );
}
