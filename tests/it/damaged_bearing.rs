//! The main job over HTTP: a recording of a damaged inner race, asked for in every way.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;

const MACHINE: &str = "/api/v1/machines/rig-1";
const RIGHT_X: &str = "/api/v1/machines/rig-1/channels/right_x";

/// A daemon that replays the scene.
fn daemon(speed: &str) -> Daemon {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = {speed}\n"
    );
    let dir = support::folder(&config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    Daemon::start_in(dir)
}

/// A daemon that has replayed all of it.
fn finished(speed: &str) -> Daemon {
    let daemon = daemon(speed);
    daemon.wait_finished("rig-1");
    daemon
}

/// An answer that must be 200.
fn ok(daemon: &Daemon, path: &str) -> Value {
    let (status, document) = daemon.get_json(path);
    assert_eq!(status, 200, "{path}: {document}");
    document
}

fn component<'d>(document: &'d Value, id: &str) -> &'d Value {
    let components = document["components"].as_array().unwrap();
    components.iter().find(|c| c["id"] == id).unwrap_or_else(|| panic!("no {id} in {document:#}"))
}

fn numbers(column: &Value) -> Vec<f64> {
    column.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Frequency and value of the highest line.
fn highest(spectrum: &Value) -> (f64, f64) {
    let lines = numbers(&spectrum["frequency_hz"]).into_iter().zip(numbers(&spectrum["value"]));
    lines.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

#[test]
fn the_damaged_race_is_named_and_nothing_else() {
    let daemon = finished("\"max\"");
    let health = ok(&daemon, &format!("{MACHINE}/health"));
    assert_eq!(health["state"], "damaged", "{health:#}");
    let diagnosis = ok(&daemon, &format!("{MACHINE}/diagnosis"));
    for document in [&health, &diagnosis] {
        let right = component(document, "right");
        assert_eq!(right["state"], "damaged", "{document:#}");
        assert_eq!(right["fault"], "inner_race", "{document:#}");
        assert_eq!(component(document, "left")["state"], "healthy", "{document:#}");
    }
    let evidence = component(&diagnosis, "right")["evidence"].as_array().unwrap();
    // The jitter of 0.5 % leaves the mean rate of 1350 impacts uncertain by 0.014 %, the window of
    // 10 s resolves 0.1 Hz.
    let at_bpfi =
        |e: &&Value| (e["frequency_hz"].as_f64().unwrap_or(0.0) - scene::BPFI_HZ).abs() < 0.15;
    assert!(evidence.iter().any(|e| at_bpfi(&e)), "{evidence:#?}");

    let schema = include_str!("../../docs/schemas/diagnosis-1.schema.json");
    let validator = jsonschema::draft202012::new(&serde_json::from_str(schema).unwrap()).unwrap();
    let mistakes: Vec<String> = validator.iter_errors(&diagnosis).map(|e| e.to_string()).collect();
    assert!(mistakes.is_empty(), "{mistakes:#?}");
}

#[test]
fn the_daemon_is_alive_ready_and_documented() {
    let daemon = finished("\"max\"");
    assert_eq!(daemon.get_text("/livez").0, 200);
    let (status, ready) = daemon.get_text("/readyz");
    assert_eq!(status, 200, "a finished replay is no fault: {ready}");
    for (name, _) in scene::CHANNELS {
        let of = |what: &str| {
            let labels = format!("{{machine=\"rig-1\",channel=\"{name}\"}}");
            daemon.metric(&format!("rotorwatch_samples_{what}_total{labels}"))
        };
        assert_eq!(of("received"), Some(scene::N_SAMPLES as f64), "{name}");
        assert_eq!((of("missing"), of("duplicated")), (Some(0.0), Some(0.0)), "{name}");
    }
    assert_eq!(daemon.metric("rotorwatch_blocks_dropped_total{machine=\"rig-1\"}"), Some(0.0));
    let golden: Value = serde_json::from_str(include_str!("../golden/openapi.json")).unwrap();
    assert!(ok(&daemon, "/api/v1/openapi.json") == golden, "openapi.json differs from its golden");
    let (status, page) = daemon.get_text("/");
    assert!(status == 200 && page.contains("<html"), "{status} {page}");
}

#[test]
fn an_alarm_is_raised_and_acknowledged_once() {
    let daemon = finished("\"max\"");
    let alarms = ok(&daemon, "/api/v1/alarms");
    let [alarm] = &alarms["items"].as_array().unwrap()[..] else { panic!("{alarms:#}") };
    assert_eq!(alarm["component"], "right", "{alarm:#}");
    assert_eq!((&alarm["level"], &alarm["fault"]), (&json!("damaged"), &json!("inner_race")));
    assert_eq!(alarm["state"], "unacknowledged", "{alarm:#}");
    assert!(!alarm["why"].as_str().unwrap().is_empty());

    let ack = format!("/api/v1/alarms/{}/ack", alarm["id"].as_str().unwrap());
    let who = json!({ "author": "M. Ito", "comment": "bearing ordered" });
    let (status, nobody) = daemon.post_json(&ack, &json!({ "author": "" }));
    assert_eq!(status, 400, "{nobody:#}");
    let (status, acknowledged) = daemon.post_json(&ack, &who);
    assert_eq!((status, &acknowledged["state"]), (200, &json!("acknowledged")), "{acknowledged:#}");
    let (status, refused) = daemon.post_json(&ack, &who);
    assert_eq!((status, &refused["type"]), (409, &json!("urn:rotorwatch:problem:conflict")));
    let (status, unknown) = daemon.post_json("/api/v1/alarms/rig-1:99/ack", &who);
    assert_eq!(status, 404, "{unknown:#}");

    let listed = &ok(&daemon, "/api/v1/alarms")["items"];
    assert_eq!(listed.as_array().unwrap().len(), 1, "it stands until the condition is gone");
    assert_eq!(listed[0]["acknowledgement"]["author"], "M. Ito", "{listed:#}");
    let history = ok(&daemon, "/api/v1/alarms/history");
    let events: Vec<&Value> =
        history["items"].as_array().unwrap().iter().map(|e| &e["event"]).collect();
    assert_eq!(events.first().unwrap().as_str(), Some("acknowledged"), "{history:#}");
    assert_eq!(events.last().unwrap().as_str(), Some("raised"), "{history:#}");
}

#[test]
fn spectra_show_the_lines_at_their_amplitudes() {
    let daemon = finished("\"max\"");
    let line = |window_s: f64| {
        let query = format!("kind=amplitude&window_s={window_s}&min_hz=20&max_hz=30");
        let spectrum = ok(&daemon, &format!("{RIGHT_X}/spectrum?{query}"));
        assert_eq!((&spectrum["unit"], &spectrum["detector"]), (&json!("m/s^2"), &json!("0-p")));
        assert_eq!(spectrum["validity"], "ok");
        highest(&spectrum)
    };
    // 100 revolutions fill 4 s: the line lies on a bin, which reads its amplitude; noise of 0.3 RMS
    // adds 0.3·√(2·1.5/48000) = 0.0024 a bin, 0.5 %.
    let (frequency, on_bin) = line(4.0);
    assert!((frequency - scene::SPEED_HZ).abs() < 1e-9, "{frequency}");
    assert!((on_bin / scene::LINE_1X - 1.0).abs() < 0.01, "{on_bin}");
    // 100.5 revolutions fill 4.02 s: midway between two bins Hann reads sinc(½)/(1 − ¼) = 8/(3π).
    let (frequency, between) = line(4.02);
    assert!((frequency - scene::SPEED_HZ).abs() <= 0.5 / 4.02 + 1e-9, "{frequency}");
    let scalloping = 8.0 / (3.0 * std::f64::consts::PI);
    assert!((between / (scalloping * scene::LINE_1X) - 1.0).abs() < 0.01, "{between}");

    let query = "kind=envelope&band_low_hz=2000&band_high_hz=4000&min_hz=30&max_hz=500";
    let envelope = ok(&daemon, &format!("{RIGHT_X}/spectrum?{query}"));
    let (frequency, depth) = highest(&envelope);
    // Bins of 0.25 Hz; see above for the jitter.
    assert!((frequency - scene::BPFI_HZ).abs() < 0.26, "{frequency}");
    // Impacts far above the noise: the first line of a train of them has a depth near 2.
    assert!(depth > 1.0 && depth < 2.0, "{depth}");
    assert_eq!(envelope["unit"], "1");
}

#[test]
fn samples_features_and_wavelets_can_be_had() {
    let daemon = finished("\"max\"");
    let path = format!("{RIGHT_X}/waveform?samples={}", scene::N_SAMPLES);
    let names = ["x-rotorwatch-start-sample", "x-rotorwatch-unit", "x-rotorwatch-validity"];
    let (status, headers, bytes) = daemon.get_binary(&path, &names);
    assert_eq!((status, headers), (200, ["0", "m/s^2", "ok"].map(str::to_owned).to_vec()));
    let sent: Vec<u32> =
        bytes.chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
    let written: Vec<u32> = scene::samples(1)[0].iter().map(|x| x.to_bits()).collect();
    assert!(sent == written, "the samples of the file, bit for bit");

    let trend = ok(&daemon, &format!("{RIGHT_X}/trend"));
    assert_eq!(trend["n_windows"], 2, "windows end at 5 s and 10 s: {trend:#}");
    let rms = ok(&daemon, &format!("{RIGHT_X}/trend?features=rms"));
    assert_eq!(rms["features"][0]["time_s"], json!([5.0, 10.0]), "{rms:#}");
    let rms = numbers(&rms["features"][0]["value"]);
    let last = &scene::samples(1)[0][..120_000];
    let truth = last.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / last.len() as f64;
    // The RMS of the same samples; 1e-5 for sums in f32.
    assert!((rms[1] / truth.sqrt() - 1.0).abs() < 1e-5, "{rms:?} {}", truth.sqrt());

    let cwt = ok(&daemon, &format!("{RIGHT_X}/cwt?window_s=0.5&n_frequencies=32&n_times=50"));
    assert_eq!(cwt["magnitude"].as_array().unwrap().len(), 32);
    assert!(!cwt["features"].as_array().unwrap().is_empty(), "CWT at shaft rate: {cwt:#}");
    let rows = cwt["magnitude"].as_array().unwrap().iter();
    let level: Vec<f64> = rows.map(|row| numbers(row).iter().sum()).collect();
    let strongest = (0..32).max_by(|a, b| level[*a].total_cmp(&level[*b])).unwrap();
    let frequency = cwt["frequency_hz"][strongest].as_f64().unwrap();
    // The resonance; a row is a tenth higher than the one before.
    assert!((frequency / 3000.0 - 1.0).abs() < 0.15, "{frequency}");
}

#[test]
fn the_speed_of_a_replay_does_not_change_its_alarms() {
    let alarms = |speed: &str| {
        let history = ok(&finished(speed), "/api/v1/alarms/history");
        let items = history["items"].as_array().unwrap().clone();
        assert!(!items.is_empty());
        items
    };
    assert_eq!(alarms("\"max\""), alarms("20"));
}
