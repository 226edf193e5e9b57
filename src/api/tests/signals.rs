//! Waveforms, spectra, scalograms and trends of known signals.

use crate::api::support::{Answer, Behaviour, FS_HZ, HELD_FROM, HELD_S, Service, sample};
use crate::api::view::SourceState;
use axum::http::Request;
use serde_json::Value;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Duration;

const CHANNELS: &str = "/api/v1/machines/rig-1/channels";

fn column(json: &Value, name: &str) -> Vec<f64> {
    json[name].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Frequency and value of the highest line.
fn peak(spectrum: &Value) -> (f64, f64) {
    let (f, v) = (column(spectrum, "frequency_hz"), column(spectrum, "value"));
    assert_eq!(f.len(), v.len());
    f.into_iter().zip(v).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

#[tokio::test]
async fn channels_are_listed_with_their_counts() {
    let list = Service::new().get(CHANNELS).await.json();
    let right_x = &list["items"][0];
    assert_eq!(right_x["name"], "right_x");
    assert_eq!(right_x["unit"], "m/s^2");
    assert_eq!(right_x["sensor"], "accelerometer");
    assert_eq!(right_x["oldest_sample"], HELD_FROM);
    assert_eq!(right_x["gaps"], 1);
    assert!(list["items"][2]["sensor"].is_null(), "no sensor names the probe");
}

#[tokio::test]
async fn binary_waveform_equals_the_samples() {
    let service = Service::new();
    let request = Request::get(format!("{CHANNELS}/right_y/waveform?samples=1000&end=5000"))
        .header("accept", "application/octet-stream");
    let answer = service.send(request).await;
    assert_eq!(answer.status, 200);
    assert_eq!(answer.header("x-rotorwatch-start-sample"), "4000");
    assert_eq!(answer.header("x-rotorwatch-sample-rate-hz"), "4096");
    assert_eq!(answer.header("x-rotorwatch-unit"), "m/s^2");
    assert_eq!(answer.header("x-rotorwatch-validity"), "ok");
    let start_time_s: f64 = answer.header("x-rotorwatch-start-time-s").parse().unwrap();
    assert!((start_time_s - 4000.0 / FS_HZ).abs() < 1e-12);
    let samples: Vec<f32> =
        answer.body.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let expected: Vec<f32> = (4000..5000).map(|i| sample(1, i)).collect();
    assert_eq!(samples, expected);
}

#[tokio::test]
async fn json_waveform_thins_to_extremes_and_keeps_time() {
    let service = Service::new();
    let all = service.get(&format!("{CHANNELS}/right_x/waveform?samples=500")).await.json();
    assert_eq!(all["decimated"], false);
    let expected: Vec<f64> = {
        let end = HELD_FROM + u64::from(4096 * HELD_S);
        (end - 500..end).map(|i| f64::from(sample(0, i))).collect()
    };
    assert_eq!(column(&all, "value"), expected);

    let thin = service
        .get(&format!("{CHANNELS}/right_x/waveform?samples=32768&max_points=100"))
        .await
        .json();
    assert_eq!(thin["decimated"], true);
    assert_eq!(thin["n_samples"], 32_768);
    let (time_s, value) = (column(&thin, "time_s"), column(&thin, "value"));
    assert!(time_s.len() == value.len() && value.len() <= 100);
    assert!(time_s.windows(2).all(|w| w[0] < w[1]));
    for (t, v) in time_s.iter().zip(&value) {
        // f32 samples: half a unit in the last place of 2.0.
        let expected = 2.0 * (2.0 * PI * 64.0 * t).sin();
        assert!((expected - v).abs() < 1e-6);
    }
    // 64 samples a period: every stretch holds an exact crest.
    assert!(value.iter().copied().fold(f64::MIN, f64::max) > 1.999_999);
}

#[tokio::test]
async fn validity_tells_gap_clipping_and_staleness() {
    let service = Service::new();
    let validity = async |path: String| service.get(&path).await.json()["validity"].clone();
    assert_eq!(validity(format!("{CHANNELS}/right_x/waveform")).await, "ok");
    assert_eq!(validity(format!("{CHANNELS}/right_x/waveform?samples=999999")).await, "gap");
    assert_eq!(validity(format!("{CHANNELS}/right_x/waveform?end=999999")).await, "gap");
    assert_eq!(validity(format!("{CHANNELS}/probe/waveform")).await, "clipped");
    assert_eq!(validity(format!("{CHANNELS}/right_x/spectrum?window_s=20")).await, "gap");
    let failed = SourceState::Failed("cable".to_owned());
    service.view.send_modify(|view| Arc::make_mut(view).source = failed);
    assert_eq!(validity(format!("{CHANNELS}/right_x/spectrum")).await, "stale");
    assert_eq!(validity(format!("{CHANNELS}/right_x/waveform?end=6000")).await, "ok");
}

#[tokio::test]
async fn amplitude_is_read_at_the_peak_by_every_detector() {
    let service = Service::new();
    for (detector, factor) in [("0-p", 1.0), ("rms", 0.5_f64.sqrt()), ("p-p", 2.0)] {
        let path = format!("{CHANNELS}/right_x/spectrum?window_s=4&detector={detector}");
        let spectrum = service.get(&path).await.json();
        let (frequency_hz, value) = peak(&spectrum);
        assert!((frequency_hz - 64.0).abs() < 1e-9);
        // The sine lies on a bin; f32 transform of 16,384 samples: relative error below 1e-6.
        assert!((value - 2.0 * factor).abs() < 1e-5, "{detector}: {value}");
        assert_eq!(spectrum["detector"], detector);
        assert_eq!(spectrum["unit"], "m/s^2");
        assert_eq!(spectrum["window"], "hann");
        assert_eq!(spectrum["averages"], 1);
        assert_eq!(spectrum["resolution_hz"], 0.25);
        assert_eq!(spectrum["n_samples"], 16_384);
        assert_eq!(spectrum["kind"], "amplitude");
    }
}

#[tokio::test]
async fn averaging_keeps_the_amplitude_of_a_steady_line() {
    let path = format!("{CHANNELS}/right_x/spectrum?window_s=1&averages=5&max_hz=100");
    let spectrum = Service::new().get(&path).await.json();
    assert_eq!(spectrum["averages"], 5);
    assert_eq!(spectrum["n_samples"], 4096 + 4 * 2048);
    assert_eq!(column(&spectrum, "frequency_hz").len(), 101);
    assert_eq!(spectrum["band_hz"], serde_json::json!([0.0, 100.0]));
    assert!((peak(&spectrum).1 - 2.0).abs() < 1e-5);
}

#[tokio::test]
async fn density_integrates_to_the_variance() {
    let path = format!("{CHANNELS}/right_x/spectrum?kind=psd&window_s=1&max_points=200000");
    let spectrum = Service::new().get(&path).await.json();
    assert_eq!(spectrum["unit"], "(m/s^2)^2/Hz");
    assert!(spectrum["detector"].is_null());
    assert_eq!(spectrum["averages"], 8);
    // A²/2 of the sine; Parseval holds for the windowed record, whole periods in each window.
    let sum: f64 = column(&spectrum, "value").iter().sum();
    let variance = sum * spectrum["bin_width_hz"].as_f64().unwrap();
    assert!((variance - 2.0).abs() < 1e-4, "{variance}");
}

#[tokio::test]
async fn envelope_reads_the_modulation_depth() {
    let service = Service::new();
    let path =
        format!("{CHANNELS}/right_y/spectrum?kind=envelope&band_low_hz=900&band_high_hz=1148");
    let spectrum = service.get(&path).await.json();
    // (1 + m·cos)² = 1 + m²/2 + 2m·cos + …: depth 2m/(1 + m²/2) at 32 Hz with m = 1/2.
    let (frequency_hz, depth) = peak(&spectrum);
    assert!((frequency_hz - 32.0).abs() < 1e-6);
    assert!((depth - 1.0 / 1.125).abs() < 1e-4, "{depth}");
    assert_eq!(spectrum["unit"], "1");
    assert_eq!(spectrum["band_hz"], serde_json::json!([900.0, 1148.0]));
    let usual = service.get(&format!("{CHANNELS}/right_y/spectrum?kind=envelope")).await.json();
    assert_eq!(usual["band_hz"], serde_json::json!([512.0, 0.45 * FS_HZ]));
    assert!((peak(&usual).1 - 1.0 / 1.125).abs() < 1e-4);
}

#[tokio::test]
async fn absolute_vibration_uses_the_pair() {
    let service = Service::new();
    let path = format!("{CHANNELS}/right_x/spectrum?kind=absolute&with=zero");
    let spectrum = service.get(&path).await.json();
    assert_eq!(spectrum["channel"], "right_x+zero");
    // |2·sin| has 2·4/(3π) at twice the frequency; sampled 64 times a period, aliases of its slowly
    // falling harmonics add about (π/64)² of it.
    let (frequency_hz, value) = peak(&spectrum);
    assert!((frequency_hz - 128.0).abs() < 1e-9);
    assert!((value - 8.0 / (3.0 * PI)).abs() < 3e-3, "{value}");
    let pair = service.get(&format!("{CHANNELS}/right_y/spectrum?kind=absolute")).await.json();
    assert_eq!(pair["channel"], "right_y+right_x", "the sensor 90° apart is found");
    let detail = service.get(&format!("{CHANNELS}/zero/spectrum?kind=absolute")).await.problem(400);
    assert!(detail.contains("with="), "{detail}");
    let path = format!("{CHANNELS}/right_x/spectrum?kind=absolute&with=probe");
    assert!(service.get(&path).await.problem(400).contains("one rate"));
}

#[tokio::test]
async fn scalogram_of_a_sine_stands_at_its_frequency_with_its_amplitude() {
    let path = format!(
        "{CHANNELS}/right_x/cwt?window_s=1&min_hz=16&max_hz=256&n_frequencies=5&n_times=20"
    );
    let scalogram = Service::new().get(&path).await.json();
    assert_eq!(scalogram["wavelet"], "morlet");
    let f = column(&scalogram, "frequency_hz");
    for (row, expected) in [16.0, 32.0, 64.0, 128.0, 256.0].into_iter().enumerate() {
        assert!((f[row] - expected).abs() < 1e-9);
    }
    assert_eq!(scalogram["time_s"].as_array().unwrap().len(), 20);
    let magnitude = scalogram["magnitude"].as_array().unwrap();
    let valid = &scalogram["valid_columns"][2];
    let border = |i: usize| usize::try_from(valid[i].as_u64().unwrap()).unwrap();
    let (from, to) = (border(0), border(1));
    assert!(from >= 1 && to <= 19 && from < to, "the cone cuts both ends");
    for value in &magnitude[2].as_array().unwrap()[from..to] {
        // A unit sine reads |W| = 1 at its own frequency; whole periods, so the ends fit.
        assert!((value.as_f64().unwrap() - 2.0).abs() < 1e-3);
    }
    // One octave up the wavelet sees the line at half its frequency: 2·exp(−(ω₀/2)²/2), ω₀ = 2π.
    let octave_up = 2.0 * (-PI * PI / 2.0).exp();
    assert!((magnitude[3][10].as_f64().unwrap() - octave_up).abs() < 1e-4);
    assert_eq!(scalogram["features"][0]["name"], "cwt_ratio_1x_main");
    assert_eq!(scalogram["features"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn every_wavelet_reads_a_sine_at_its_frequency() {
    let service = Service::new();
    for (wavelet, tolerance) in
        [("mexican_hat", 1e-3), ("haar", 1e-3), ("db4", 1e-3), ("bior2.4", 1e-3)]
    {
        let path = format!(
            "{CHANNELS}/right_x/cwt?wavelet={wavelet}&min_hz=64&max_hz=256&n_frequencies=3&n_times=20"
        );
        let scalogram = service.get(&path).await.json();
        assert_eq!(scalogram["wavelet"], wavelet);
        // 2·sin(2π·64t): whole periods of it and of the window.
        let value = scalogram["magnitude"][0][10].as_f64().unwrap();
        assert!((value - 2.0).abs() < tolerance, "{wavelet}: {value}");
        assert!(scalogram["magnitude"][2][10].as_f64().unwrap() < 1.9, "{wavelet}");
    }
    let path = format!("{CHANNELS}/right_x/cwt?wavelet=db3");
    assert!(service.get(&path).await.problem(400).contains("`bior4.4`"));
}

#[tokio::test]
async fn every_distribution_shows_a_sine_at_its_frequency() {
    let service = Service::new();
    for kind in
        ["wigner_ville", "pseudo_wigner_ville", "smoothed_pseudo_wigner_ville", "choi_williams"]
    {
        let path = format!(
            "{CHANNELS}/right_x/joint?kind={kind}&window_s=0.25&n_times=9&n_frequencies=1024"
        );
        let joint = service.get(&path).await.json();
        assert_eq!((&joint["kind"], &joint["unit"]), (&kind.into(), &"(m/s^2)^2/Hz".into()));
        let f = column(&joint, "frequency_hz");
        let rows = joint["value"].as_array().unwrap();
        assert_eq!((rows.len(), column(&joint, "time_s").len()), (f.len(), 9));
        let middle = |row: &Value| row[4].as_f64().unwrap();
        let top = (0..f.len()).max_by(|a, b| middle(&rows[*a]).total_cmp(&middle(&rows[*b])));
        let width = joint["bin_width_hz"].as_f64().unwrap();
        assert!((f[top.unwrap()] - 64.0).abs() <= width, "{kind}: {}", f[top.unwrap()]);
        if joint["decimated"] == false {
            // A line of amplitude 2 has 4: the time marginal is the power of the analytic signal.
            let power: f64 = rows.iter().map(|row| middle(row) * width).sum();
            assert!((power - 4.0).abs() < 1e-3, "{kind}: {power}");
        }
    }
    for (query, part) in [
        ("kind=wigner", "`choi_williams`"),
        ("kind=wigner_ville&lag_s=0.1", "every lag"),
        ("kind=choi_williams&sigma=0", "0.001 to"),
        ("sigma=1", "choi_williams"),
        ("kind=choi_williams&smoothing_s=0.1", "smoothed_pseudo"),
        ("window_s=0.001", "16 to 16384"),
        ("window_s=6", "16 to 16384"),
        ("kind=wigner_ville&window_s=3", "smaller window_s"),
        ("kind=pseudo_wigner_ville&window_s=3&lag_s=2", "smaller lag_s"),
        ("kind=choi_williams&window_s=3&lag_s=1", "smaller window_s or lag_s"),
        ("lag_s=-1", "0 to 60"),
        ("n_times=1", "2 to 512"),
        ("n_frequencies=1025", "2 to 1024"),
        ("min_hz=100.1&max_hz=100.2", "longer lag_s"),
        ("min_hz=100&max_hz=50", "below max_hz"),
    ] {
        let detail = service.get(&format!("{CHANNELS}/right_x/joint?{query}")).await.problem(400);
        assert!(detail.contains(part), "{query}: {detail}");
    }
}

#[tokio::test]
async fn trend_thins_selects_and_keeps_what_is_not_finite_out() {
    let service = Service::new();
    let trend = service.get(&format!("{CHANNELS}/right_x/trend?max_points=10")).await.json();
    assert_eq!(trend["n_windows"], 1000);
    assert_eq!(trend["decimated"], true);
    assert_eq!(trend["validity"], "ok");
    let rms = &trend["features"][0];
    assert_eq!(column(rms, "n_samples"), vec![40_960.0; column(rms, "value").len()]);
    assert_eq!(column(rms, "windows"), vec![1.0; column(rms, "value").len()]);
    assert_eq!(rms["unit"], "m/s^2");
    let value = column(rms, "value");
    assert!(value.len() <= 10 && value.contains(&0.0) && value.contains(&999.0));
    let path = format!("{CHANNELS}/right_x/trend?features=kurtosis");
    let whole = service.get(&path).await.json();
    assert_eq!(whole["features"].as_array().unwrap().len(), 1);
    assert!(whole["features"][0]["value"][777].is_null());
    let detail =
        service.get(&format!("{CHANNELS}/right_x/trend?features=crest")).await.problem(400);
    assert!(detail.contains("rms, kurtosis"), "{detail}");
}

#[tokio::test]
async fn every_number_has_its_limits() {
    let service = Service::new();
    let x = format!("{CHANNELS}/right_x");
    for (path, part) in [
        ("waveform?samples=0", "1 to"),
        ("waveform?samples=4194305", "4194304"),
        ("waveform?samples=-1", "samples"),
        ("waveform?max_points=1", "2 to"),
        (
            "waveform?maxpoints=10",
            "unknown parameter \"maxpoints\", allowed are end, max_points, samples",
        ),
        ("spectrum?window_s=0", "0.001"),
        ("spectrum?window_s=NaN", "0.001 to 120"),
        ("spectrum?window_s=inf", "120"),
        ("spectrum?window_s=0.002", "samples of this channel"),
        ("spectrum?averages=65", "1 to 64"),
        ("spectrum?averages=64&window_s=60", "allowed are 4194304"),
        ("spectrum?kind=zoom", "`amplitude`, `psd`, `envelope`, `absolute`, `order`, `cepstrum`"),
        ("spectrum?detector=peak", "`rms`, `0-p`, `p-p`"),
        ("spectrum?kind=psd&detector=rms", "have none"),
        ("spectrum?band_low_hz=5", "kind=envelope"),
        ("spectrum?with=right_y", "kind=absolute"),
        ("spectrum?kind=envelope&band_low_hz=900&band_high_hz=800", "band_low_hz < band_high_hz"),
        ("spectrum?kind=envelope&band_low_hz=NaN", "band_low_hz"),
        ("spectrum?kind=envelope&band_high_hz=3000", "2048"),
        ("spectrum?kind=envelope&band_low_hz=900.01&band_high_hz=900.02", "no bin"),
        ("spectrum?min_hz=100&max_hz=50", "below max_hz"),
        ("spectrum?max_hz=3000", "0 to 2048"),
        ("cwt?n_frequencies=1", "2 to 256"),
        ("cwt?n_times=2001", "2 to 2000"),
        ("cwt?window_s=0.001", "allowed are 16"),
        ("cwt?min_hz=0.1", "1 to"),
        ("cwt?min_hz=100&max_hz=50", "below max_hz"),
        ("trend?max_points=0", "2 to"),
    ] {
        let detail = service.get(&format!("{x}/{path}")).await.problem(400);
        assert!(detail.contains(part), "{path}: {detail}");
    }
}

#[tokio::test]
async fn unknown_machines_and_channels_name_what_exists() {
    let service = Service::new();
    for part in ["", "/health", "/diagnosis", "/channels", "/channels/right_x/waveform"] {
        let detail = service.get(&format!("/api/v1/machines/rig-2{part}")).await.problem(404);
        assert!(detail.contains("rig-2") && detail.contains("rig-1"), "{detail}");
    }
    for part in ["waveform", "spectrum", "cwt", "joint", "trend"] {
        let detail = service.get(&format!("{CHANNELS}/left_x/{part}")).await.problem(404);
        assert!(detail.contains("right_x, right_y, probe, zero"), "{detail}");
    }
    let path = format!("{CHANNELS}/right_x/waveform?end=500");
    let detail = service.get(&path).await.problem(404);
    assert!(detail.contains("1000 to 33768"), "{detail}");
}

#[tokio::test]
async fn a_form_nobody_has_is_refused() {
    let service = Service::new();
    let ask = async |accept: &str, query: &str| -> Answer {
        let path = format!("{CHANNELS}/right_x/waveform{query}");
        service.send(Request::get(path).header("accept", accept)).await
    };
    ask("text/csv", "").await.problem(406);
    assert_eq!(ask("text/html, */*;q=0.1", "").await.status, 200);
    ask("application/octet-stream", "?max_points=10").await.problem(400);
}

#[tokio::test]
async fn a_shard_that_is_busy_or_silent_gives_503_with_retry_after() {
    for behaviour in [Behaviour::Full, Behaviour::Silent] {
        let service = Service::with(behaviour, |s| s.reply_timeout = Duration::from_millis(10));
        for part in ["waveform", "spectrum", "cwt", "joint", "trend"] {
            let answer = service.get(&format!("{CHANNELS}/right_x/{part}")).await;
            answer.problem(503);
            assert_eq!(answer.header("retry-after"), "1");
        }
        service.get("/api/v1/alarms/history").await.problem(503);
        assert_eq!(service.get("/api/v1/machines/rig-1/health").await.status, 200);
    }
}

#[tokio::test]
async fn spectra_are_refused_while_others_are_computed() {
    let service = Service::new();
    let held = Arc::clone(&service.state.computations).try_acquire_many_owned(2).unwrap();
    for part in ["spectrum", "cwt", "joint"] {
        let answer = service.get(&format!("{CHANNELS}/right_x/{part}")).await;
        assert!(answer.problem(503).contains("other spectra"));
        assert_eq!(answer.header("retry-after"), "1");
    }
    drop(held);
    assert_eq!(service.get(&format!("{CHANNELS}/right_x/spectrum")).await.status, 200);
}
