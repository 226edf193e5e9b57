//! What is missing is counted, shown, and never bridged.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;

/// Replays a capture of the scene's machine to its end.
fn replayed(channels: &[Vec<f32>], segments: Option<(&[u64], &[f64])>) -> Daemon {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
                  kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\n";
    let dir = support::folder(config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), channels, segments);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    daemon
}

fn diagnosis(daemon: &Daemon) -> Value {
    let (status, document) = daemon.get_json("/api/v1/machines/rig-1/diagnosis");
    assert_eq!(status, 200, "{document:#}");
    document
}

/// Sample ranges of the evidence read in `channel`.
fn ranges(diagnosis: &Value, channel: &str) -> Vec<(u64, u64)> {
    let components = diagnosis["components"].as_array().unwrap().iter();
    let evidence = components.flat_map(|c| c["evidence"].as_array().into_iter().flatten());
    let of_channel = evidence.filter(|e| e["channel"] == channel);
    of_channel
        .filter_map(|e| Some((e["sample_range"][0].as_u64()?, e["sample_range"][1].as_u64()?)))
        .collect()
}

#[test]
fn samples_that_are_no_numbers_are_counted_and_not_bridged() {
    let mut channels = scene::samples(2);
    channels[0][84_000..84_100].fill(f32::NAN);
    channels[0][84_050] = f32::INFINITY;
    let daemon = replayed(&channels, None);

    let (_, listed) = daemon.get_json("/api/v1/machines/rig-1/channels");
    let (right_x, right_y) = (&listed["items"][1], &listed["items"][2]);
    assert_eq!(right_x["received"], scene::N_SAMPLES - 100, "{listed:#}");
    assert_eq!((&right_x["missing"], &right_x["gaps"]), (&100.into(), &1.into()), "{listed:#}");
    assert_eq!((&right_y["missing"], &right_y["gaps"]), (&0.into(), &0.into()), "{listed:#}");
    let missing = "rotorwatch_samples_missing_total{machine=\"rig-1\",channel=\"right_x\"}";
    assert_eq!(daemon.metric(missing), Some(100.0));
    assert_eq!(daemon.metric("rotorwatch_samples_rejected_total{machine=\"rig-1\"}"), Some(100.0));

    let diagnosis = diagnosis(&daemon);
    assert_eq!(diagnosis["samples_rejected"], 100, "{diagnosis:#}");
    let because = diagnosis["rejected_because"].to_string();
    assert!(because.contains("not finite") && because.matches("100").count() == 1, "{because}");
    let ranges = ranges(&diagnosis, "right_x");
    assert!(!ranges.is_empty(), "{diagnosis:#}");
    for (start, end) in ranges {
        assert!(end <= 84_000 || start >= 84_100, "{start} to {end} spans the gap");
    }
    let query = "waveform?samples=70000&end=140000";
    let (_, wave) = daemon.get_json(&format!("/api/v1/machines/rig-1/channels/right_x/{query}"));
    assert_eq!((&wave["start_sample"], &wave["validity"]), (&84_100.into(), &"gap".into()));
}

#[test]
fn nothing_is_judged_across_two_segments() {
    let daemon = replayed(&scene::samples(3), Some((&[0, 72_000], &[0.0, 10.0])));
    let (_, listed) = daemon.get_json("/api/v1/machines/rig-1/channels");
    for channel in listed["items"].as_array().unwrap() {
        assert_eq!(channel["received"], scene::N_SAMPLES, "{channel:#}");
        // The second segment begins 10 s after the first and lasts 6 s.
        assert_eq!(channel["end_time_s"], 16.0, "{channel:#}");
    }
    let diagnosis = diagnosis(&daemon);
    let ranges = ranges(&diagnosis, "right_x");
    assert!(!ranges.is_empty(), "{diagnosis:#}");
    for (start, end) in ranges {
        assert!(start >= 72_000 && end <= 144_000, "{start} to {end} is not in the newest segment");
    }
    let path = "/api/v1/machines/rig-1/channels/right_x/waveform?samples=144000";
    let (_, waveform) = daemon.get_json(path);
    assert_eq!(
        (&waveform["start_sample"], &waveform["n_samples"]),
        (&72_000.into(), &72_000.into())
    );
    let (_, trend) = daemon.get_json("/api/v1/machines/rig-1/channels/right_x/trend?features=rms");
    // A window 5 s after each beginning, none over the pause.
    assert_eq!(trend["features"][0]["time_s"], serde_json::json!([5.0, 15.0]), "{trend:#}");
}
