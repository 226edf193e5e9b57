//! What is shown over the angle of a shaft, and by its spacing: orbits, orders, revolutions of a scalogram, cepstra.

use crate::api::support::{Behaviour, HELD_FROM, Service};
use crate::machine::file;
use serde_json::{Value, json};
use std::sync::Arc;

const MACHINE: &str = "/api/v1/machines/rig-1";

/// A shaft at 16 r/s, told by a tacho: the channel `probe` is a square wave of 16 Hz, at half the rate of the others.
const WATCHED: &str = r#"
[machine]
id = "rig-1"
[[shaft]]
id = "main"
speed_hz = 15.0
rotation = "ccw"
[[bearing]]
id = "right"
shaft = "main"
elements = 11
element_diameter_mm = 7.9375
pitch_diameter_mm = 33.5
[[sensor]]
channel = "right_y"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 90.0
[[sensor]]
channel = "right_x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 0.0
[[sensor]]
channel = "probe"
kind = "tacho"
at = { shaft = "main" }
"#;

/// A service whose machine has the tacho.
fn watched() -> Service {
    let service = Service::new();
    let machine = Arc::new(file::parse(WATCHED, "rig.toml").unwrap());
    service.view.send_modify(|view| Arc::make_mut(view).machine = machine);
    service
}

fn column(json: &Value, name: &str) -> Vec<f64> {
    json[name].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Place and height of the largest value.
fn top(json: &Value, place: &str) -> (f64, f64) {
    let pairs = column(json, place).into_iter().zip(column(json, "value"));
    pairs.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

#[tokio::test]
async fn an_orbit_is_whole_revolutions_from_mark_to_mark_of_the_pair_in_its_order() {
    let service = watched();
    // Named by its y, it is the same pair.
    for query in ["?revolutions=3", "?revolutions=3&x=right_y"] {
        let orbit = service.get(&format!("{MACHINE}/orbit{query}")).await.json();
        assert_eq!(orbit["x_channel"], "right_x", "y stands first in the file");
        assert_eq!(orbit["y_channel"], "right_y");
        assert_eq!(orbit["angle_from"], "mark");
        assert_eq!((&orbit["shaft"], &orbit["rotation"]), (&json!("main"), &json!("ccw")));
        // 3·256 samples; where the wave of the tacho crosses zero at one of its samples, which is two of ours, rounding decides its
        // sign, at either end.
        let n = orbit["n_samples"].as_u64().unwrap();
        assert!(n.abs_diff(768) <= 4, "{n}");
        assert!((orbit["shaft_speed_hz"].as_f64().unwrap() - 16.0).abs() < 16.0 * 4.0 / 768.0);
        assert_eq!(orbit["revolutions"], 3.0);
        let (x, angle_deg) = (column(&orbit, "x"), column(&orbit, "angle_deg"));
        assert_eq!(x.len(), angle_deg.len());
        // 64 samples a period: each crest is a sample; up to four samples of a period more or less move the mean.
        assert!((x.iter().copied().fold(f64::MIN, f64::max) - 2.0).abs() < 4.0 * 2.0 / 764.0);
        // One sample is 1.4°.
        assert!(angle_deg[0].abs() < 1.5 && (angle_deg[x.len() - 1] - 1080.0).abs() < 3.0);
        let marks = orbit["marks"].as_array().unwrap();
        let at: Vec<u64> = marks.iter().map(|mark| mark.as_u64().unwrap()).collect();
        assert!(at.len() == 3 && at[0] == 0 && at[1].abs_diff(256) <= 4, "{at:?}");
    }
    let thin = service.get(&format!("{MACHINE}/orbit?revolutions=3&max_points=100")).await.json();
    assert_eq!(thin["step"], 8);
    assert!(column(&thin, "x").len() <= 100);
    assert_eq!(thin["validity"], "ok");
}

#[tokio::test]
async fn probes_of_two_senders_are_joined_by_their_times() {
    let orbit = async |service: Service| {
        let machine = Arc::new(file::parse(WATCHED, "rig.toml").unwrap());
        service.view.send_modify(|view| Arc::make_mut(view).machine = machine);
        service.get(&format!("{MACHINE}/orbit?revolutions=3")).await.json()
    };
    let one = orbit(Service::new()).await;
    let two = orbit(Service::with(Behaviour::TwoSenders, |_| {})).await;
    assert_eq!((&two["validity"], &two["angle_from"]), (&json!("ok"), &json!("mark")), "{two}");
    // The newest that both hold: some samples earlier, so maybe a revolution.
    let at = |orbit: &Value| orbit["start_sample"].as_u64().unwrap();
    assert!((0..=356 + 4).contains(&(at(&one) - at(&two))), "{} {}", at(&one), at(&two));
    assert_eq!(two["revolutions"], 3.0);
    let path = format!("{MACHINE}/channels/right_x/spectrum?kind=absolute");
    let service = Service::with(Behaviour::TwoSenders, |_| {});
    let spectrum = service.get(&path).await.json();
    assert_eq!(spectrum["channel"], "right_x+right_y", "{spectrum}");
}

#[tokio::test]
async fn without_a_tacho_revolutions_are_those_of_the_speed_and_have_no_mark() {
    let service = Service::new();
    let orbit = service.get(&format!("{MACHINE}/orbit?revolutions=2")).await.json();
    assert_eq!(orbit["angle_from"], "speed");
    assert_eq!(orbit["marks"], json!([]));
    // 10 r/s at 4096 samples a second.
    assert!(orbit["n_samples"].as_u64().unwrap().abs_diff(819) <= 1);
    // More than the 8 s held: what there is, and that it is less.
    let all = service.get(&format!("{MACHINE}/orbit?revolutions=64&end=5096")).await.json();
    assert_eq!(all["validity"], "gap");
    assert!(all["start_sample"].as_u64().unwrap() >= HELD_FROM);
}

#[tokio::test]
async fn what_has_no_orbit_says_why() {
    let service = Service::new();
    for (query, status, part) in [
        ("?revolutions=65", 400, "1 to 64"),
        ("?x=probe", 400, "90°"),
        ("?x=right_x&y=probe", 400, "one unit and one rate"),
        ("?x=left", 404, "right_x"),
        ("?end=1100", 404, "no whole revolution"),
    ] {
        let detail = service.get(&format!("{MACHINE}/orbit{query}")).await.problem(status);
        assert!(detail.contains(part), "{query}: {detail}");
    }
    service.view.send_modify(|view| {
        let view = Arc::make_mut(view);
        let text = "[machine]\nid = \"rig-1\"\n[[shaft]]\nid = \"main\"\n";
        view.machine = Arc::new(file::parse(text, "rig.toml").unwrap());
        view.diagnosis = None;
    });
    let detail = service.get(&format!("{MACHINE}/orbit")).await.problem(404);
    assert!(detail.contains("no two sensors"), "{detail}");
    for path in ["orbit?x=right_x&y=right_y", "channels/right_x/spectrum?kind=order"] {
        let detail = service.get(&format!("{MACHINE}/{path}")).await.problem(409);
        assert!(detail.contains("speed of the shaft"), "{detail}");
    }
}

#[tokio::test]
async fn an_order_spectrum_has_its_lines_at_multiples_of_the_measured_speed() {
    let path = format!("{MACHINE}/channels/right_x/spectrum?kind=order&window_s=4");
    let spectrum = watched().get(&path).await.json();
    let (order, amplitude) = top(&spectrum, "order");
    // 64 Hz at 16 r/s; the tacho's edges are placed within a sample of 1/128 revolution: the line leans by less.
    assert!((order - 4.0).abs() < 0.02, "{order}");
    assert!((amplitude - 2.0).abs() < 0.02, "{amplitude}");
    assert_eq!(spectrum["unit"], "m/s^2");
    assert_eq!(spectrum["angle_from"], "mark");
    let (frequency_hz, _) = top(&spectrum, "frequency_hz");
    assert!((frequency_hz - 64.0).abs() < 0.5);
    assert!(spectrum["quefrency_s"].is_null());
}

#[tokio::test]
async fn lines_at_one_spacing_are_a_peak_of_the_cepstrum() {
    let path =
        format!("{MACHINE}/channels/probe/spectrum?kind=cepstrum&window_s=4&min_hz=12&max_hz=200");
    let cepstrum = Service::new().get(&path).await.json();
    // Odd harmonics of 16 Hz: a comb of 32 Hz shifted by half, so the first multiple that adds up is 1/16 s.
    let (quefrency_s, _) = top(&cepstrum, "quefrency_s");
    // Within a sample: where the wave crosses zero at one, rounding decides its sign.
    assert!((quefrency_s - 1.0 / 16.0).abs() < 1.01 / 2048.0, "{quefrency_s}");
    assert_eq!(cepstrum["unit"], "1");
    assert!(cepstrum["detector"].is_null() && cepstrum["bin_width_hz"].is_null());
    let pairs = column(&cepstrum, "frequency_hz").into_iter();
    for (hz, s) in pairs.zip(column(&cepstrum, "quefrency_s")) {
        assert!((hz * s - 1.0).abs() < 1e-12 && (12.0..=200.0).contains(&hz));
    }
    let refused = format!("{path}&detector=rms");
    assert!(Service::new().get(&refused).await.problem(400).contains("have none"));
}

#[tokio::test]
async fn a_scalogram_of_revolutions_lies_outside_the_cone_and_knows_its_angle() {
    let service = watched();
    let path = format!("{MACHINE}/channels/right_x/cwt");
    let picture =
        service.get(&format!("{path}?revolutions=2&min_hz=48&max_hz=96&n_times=200")).await.json();
    let angle_deg = column(&picture, "angle_deg");
    // 720° in about 200 columns.
    assert!(angle_deg.len().abs_diff(200) <= 1);
    assert!(angle_deg[0].abs() < 4.0 && (angle_deg[angle_deg.len() - 1] - 720.0).abs() < 8.0);
    assert_eq!(picture["angle_from"], "mark");
    assert_eq!(picture["shaft"], "main");
    let frequency_hz = column(&picture, "frequency_hz");
    let row = frequency_hz.iter().position(|hz| *hz >= 64.0).unwrap();
    for (row, columns) in picture["valid_columns"].as_array().unwrap().iter().enumerate() {
        assert_eq!(*columns, json!([0, angle_deg.len()]), "row {row}");
    }
    // The row beside 64 Hz, steady over both revolutions; the wavelet is 10 Hz wide there.
    for value in picture["magnitude"][row].as_array().unwrap() {
        assert!((value.as_f64().unwrap() - 2.0).abs() < 0.05, "{value}");
    }
    for (query, part) in [("revolutions=17", "1 to 16"), ("revolutions=1&window_s=1", "exclude")] {
        let detail = service.get(&format!("{path}?{query}")).await.problem(400);
        assert!(detail.contains(part), "{detail}");
    }
}

#[tokio::test]
async fn the_list_of_machines_has_their_components_if_asked_for() {
    let service = Service::new();
    let plain = service.get("/api/v1/machines").await.json();
    assert!(plain["items"][0].get("components").is_none());
    assert_eq!(plain["items"][0]["since"], "2023-11-14T22:13:30Z");
    assert_eq!(plain["items"][0]["data_quality"], "ok");
    let list = service.get("/api/v1/machines?components=true").await.json();
    let health = service.get(&format!("{MACHINE}/health")).await.json();
    assert_eq!(list["items"][0]["components"], health["components"]);
    assert_eq!(list["items"][0]["last_sample_time"], health["data"]["last_sample_time"]);
    service.get("/api/v1/machines?parts=true").await.problem(400);
}
