//! Every metric has its name, and rules and documents know it.

use super::*;

#[test]
fn every_metric_is_written_under_its_name() {
    let metrics = Metrics::new();
    let channel = metrics.channel("rig-1", "right_x");
    channel.received.inc_by(12);
    metrics.channel("rig-1", "right_x").received.inc_by(30);
    channel.missing.inc_by(2);
    channel.duplicated.inc();
    let machine = metrics.machine("rig-1");
    machine.rejected.inc_by(3);
    machine.blocks_dropped.inc();
    machine.windows_judged.inc();
    machine.alarm_transitions.inc();
    machine.verdict_latency_s.observe(0.015);
    let recording = metrics.recording("rig-1");
    recording.recorded.inc_by(100);
    recording.lost.inc_by(5);
    recording.failures.inc();
    recording.removed.inc_by(2);
    recording.files.set(3);
    recording.bytes.set(4000);
    metrics.shard(0).queue_bytes.set(4096);
    let simulation = metrics.simulation("rig-1");
    simulation.simulated_s.set(12.5);
    simulation.lag_s.set(0.25);
    simulation.given_up_s.set(1.5);
    let load = metrics.alarm_load("rig-1");
    load.standing.set(3);
    load.last_hour.set(7);
    load.flood.set(1);
    let store = metrics.store();
    store.stored.inc_by(9);
    store.lost.inc();
    store.waiting.set(4);
    store.failing.set(1);
    let receiver = metrics.receiver("room");
    receiver.delivered.inc_by(5);
    receiver.refused.inc();
    receiver.given_up.inc_by(2);
    receiver.waiting.set(3);
    receiver.failing.set(1);
    let streams = metrics.streams();
    streams.open.set(2);
    streams.refused.inc();
    streams.stalled.inc_by(4);
    let text = metrics.encode();
    for line in [
        concat!("rotorwatch_build_info{version=\"", env!("CARGO_PKG_VERSION"), "\"} 1"),
        "rotorwatch_samples_received_total{machine=\"rig-1\",channel=\"right_x\"} 42",
        "rotorwatch_samples_missing_total{machine=\"rig-1\",channel=\"right_x\"} 2",
        "rotorwatch_samples_duplicated_total{machine=\"rig-1\",channel=\"right_x\"} 1",
        "rotorwatch_samples_rejected_total{machine=\"rig-1\"} 3",
        "rotorwatch_blocks_dropped_total{machine=\"rig-1\"} 1",
        "rotorwatch_windows_judged_total{machine=\"rig-1\"} 1",
        "rotorwatch_alarm_transitions_total{machine=\"rig-1\"} 1",
        "rotorwatch_verdict_latency_seconds_bucket{le=\"0.01\",machine=\"rig-1\"} 0",
        "rotorwatch_verdict_latency_seconds_bucket{le=\"0.02\",machine=\"rig-1\"} 1",
        "rotorwatch_samples_recorded_total{machine=\"rig-1\"} 100",
        "rotorwatch_samples_not_recorded_total{machine=\"rig-1\"} 5",
        "rotorwatch_recording_failures_total{machine=\"rig-1\"} 1",
        "rotorwatch_recordings_removed_total{machine=\"rig-1\"} 2",
        "rotorwatch_recordings{machine=\"rig-1\"} 3",
        "rotorwatch_recording_bytes{machine=\"rig-1\"} 4000",
        "rotorwatch_queue_bytes{shard=\"0\"} 4096",
        "rotorwatch_simulated_seconds{machine=\"rig-1\"} 12.5",
        "rotorwatch_simulation_lag_seconds{machine=\"rig-1\"} 0.25",
        "rotorwatch_simulation_lag_given_up_seconds{machine=\"rig-1\"} 1.5",
        "rotorwatch_alarms{machine=\"rig-1\",what=\"standing\"} 3",
        "rotorwatch_alarm_load{machine=\"rig-1\",what=\"last_hour\"} 7",
        "rotorwatch_alarm_load{machine=\"rig-1\",what=\"flood\"} 1",
        "rotorwatch_alarm_load{machine=\"rig-1\",what=\"stale\"} 0",
        "rotorwatch_store_events_total 9",
        "rotorwatch_store_events_lost_total 1",
        "rotorwatch_store_events_waiting 4",
        "rotorwatch_store_failing 1",
        "rotorwatch_notifications_total{receiver=\"room\",outcome=\"delivered\"} 5",
        "rotorwatch_notifications_total{receiver=\"room\",outcome=\"refused\"} 1",
        "rotorwatch_notifications_total{receiver=\"room\",outcome=\"given_up\"} 2",
        "rotorwatch_notifications_waiting{receiver=\"room\"} 3",
        "rotorwatch_receiver_failing{receiver=\"room\"} 1",
        "rotorwatch_event_streams 2",
        "rotorwatch_event_streams_refused_total 1",
        "rotorwatch_connections_stalled_total 4",
        "# EOF",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\nnot in\n{text}");
    }
}

/// Names of metrics in a text, up to what cannot be part of one.
fn named(text: &str) -> std::collections::BTreeSet<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let found = text.match_indices("rotorwatch_").map(|(at, _)| {
        let rest = &text[at..];
        rest[..rest.find(|c| !is_part(c)).unwrap_or(rest.len())].to_owned()
    });
    found.collect()
}

#[test]
fn rules_and_documents_name_only_metrics_that_exist_and_the_document_names_all() {
    let metrics = Metrics::new();
    let _channel = metrics.channel("m", "c");
    let machine = metrics.machine("m");
    machine.verdict_latency_s.observe(0.1);
    let _recording = metrics.recording("m");
    let _shard = metrics.shard(0);
    metrics.state_capacity("http_connections", 9);
    metrics.components().show(("m", "bearing", "right"), 3, Some(0.6), 2);
    metrics.http().count(("GET", "/livez", 200), 1e-3);
    let _simulation = metrics.simulation("m");
    let _load = metrics.alarm_load("m");
    let _receiver = metrics.receiver("r");
    let access = metrics.access();
    let (_denied, _open) = (access.denied("missing"), access.insecure("no_tokens"));
    let _fate = metrics.ingested("m", "c", "used");
    let _refusal = metrics.ingest().refused("unauthorised");
    let _lost = metrics.ingest().refused_samples("malformed");
    metrics.clock_drift("m", "c").set(1.0);
    metrics.clock_offset("m", "c").set(1.0);
    let text = metrics.encode();
    let samples: String = text.lines().filter(|line| !line.starts_with('#')).collect();
    let exist = named(&samples);
    assert!(exist.len() > 30, "{exist:?}");
    let rules = include_str!("../../deploy/prometheus-alerts.yml");
    let in_rules = named(rules);
    assert!(in_rules.len() > 10);
    let unknown: Vec<_> = in_rules.difference(&exist).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
    let dashboard: serde_json::Value =
        serde_json::from_str(include_str!("../../deploy/grafana-dashboard.json")).unwrap();
    let panels = dashboard["panels"].as_array().unwrap();
    assert!(panels.len() > 10);
    for panel in panels {
        let queries: Vec<&str> = panel["targets"]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| t["expr"].as_str().unwrap())
            .collect();
        assert!(!queries.is_empty(), "{panel}");
        for query in queries {
            let names = named(query);
            assert!(!names.is_empty(), "{query}");
            let unknown: Vec<_> = names.difference(&exist).collect();
            assert!(unknown.is_empty(), "{unknown:?} in {query}");
        }
    }
    let mut documented = named(include_str!("../../docs/operating.md"));
    // Of a histogram its name is documented, not what it is written as.
    for name in documented.clone().iter().filter(|name| name.ends_with("_seconds")) {
        documented.extend(["bucket", "count", "sum"].map(|part| format!("{name}_{part}")));
    }
    let undocumented: Vec<_> = exist.difference(&documented).collect();
    assert!(undocumented.is_empty(), "{undocumented:?}");
    // Of `rotorwatch_alarms{what="…"}` the rules use words that exist, too.
    for (at, _) in rules.match_indices("what=\"") {
        let word = rules[at + 6..].split('"').next().unwrap();
        assert!(samples.contains(&format!("what=\"{word}\"")), "{word}");
    }
}
