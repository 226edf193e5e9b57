//! CSV and WAV through the program: the same verdict as of a native capture, what `check` shows,
//! what is refused, and the replay of one.

use crate::scene;
use crate::support;
use crate::support::Daemon;
use crate::support::Ended;
use hound::SampleFormat;
use hound::WavSpec;
use hound::WavWriter;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Full scale of the sound files, m/s²: the signal stays below half of it.
const FULL_SCALE: f64 = 50.0;

fn run(dir: &TempDir, arguments: &[&str]) -> Ended {
    support::run(support::command().current_dir(dir.path()).args(arguments))
}

/// State, fault and components of each capture named.
fn verdicts(dir: &TempDir, arguments: &[&str]) -> Vec<Value> {
    let fixed = ["diagnose", "--machine", "rig.toml", "--speed", "25", "--format", "json"];
    let ended = run(dir, &[&fixed[..], arguments].concat());
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{arguments:?}");
    let verdict = |line: &str| {
        let document: Value = serde_json::from_str(line).unwrap();
        let of_part = |c: &Value| [c["id"].clone(), c["state"].clone(), c["fault"].clone()];
        let parts = document["components"].as_array().unwrap().iter().map(of_part);
        serde_json::json!({ "state": document["state"], "parts": parts.collect::<Vec<_>>() })
    };
    ended.stdout.lines().map(verdict).collect()
}

/// Writes the channels as a table; `time`: with the times, printed to a microsecond.
fn write_csv(path: &Path, channels: &[Vec<f32>], separator: char, comma: bool, time: bool) {
    let mut text = if time { format!("Time [s]{separator}") } else { String::new() };
    let names: Vec<String> = scene::CHANNELS.iter().map(|(n, _)| format!("{n} [m/s^2]")).collect();
    text.push_str(&names.join(&separator.to_string()));
    text.push('\n');
    for i in 0..scene::N_SAMPLES {
        let mut cells: Vec<String> = channels.iter().map(|x| format!("{:.5}", x[i])).collect();
        if time {
            cells.insert(0, format!("{:.6}", i as f64 / scene::RATE_HZ));
        }
        let row = cells.join(&separator.to_string());
        text.push_str(&if comma { row.replace('.', ",") } else { row });
        text.push('\n');
    }
    fs::write(path, text).unwrap();
}

fn write_wav(path: &Path, channels: &[Vec<f32>], bits: u16, format: SampleFormat) {
    let spec =
        WavSpec { channels: 3, sample_rate: 12_000, bits_per_sample: bits, sample_format: format };
    let mut writer = WavWriter::create(path, spec).unwrap();
    for i in 0..scene::N_SAMPLES {
        for x in channels {
            let fraction = f64::from(x[i]) / FULL_SCALE;
            #[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
            match format {
                SampleFormat::Float => writer.write_sample(fraction as f32).unwrap(),
                SampleFormat::Int => {
                    let counts = (fraction * 2_f64.powi(i32::from(bits) - 1)).round();
                    writer.write_sample(counts as i32).unwrap();
                }
            }
        }
    }
    writer.finalize().unwrap();
}

fn folder() -> TempDir {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("rig.toml"), scene::MACHINE).unwrap();
    dir
}

/// The verdict on the native capture, which accuses the inner race.
fn native(dir: &TempDir, channels: &[Vec<f32>]) -> Value {
    scene::write(&dir.path().join("x.h5"), channels, None);
    let native = verdicts(dir, &["x.h5"]).remove(0);
    assert_eq!(native["state"], "damaged", "{native:#}");
    let right = serde_json::json!(["right", "damaged", "inner_race"]);
    assert!(native["parts"].as_array().unwrap().contains(&right), "{native:#}");
    native
}

#[test]
fn tables_give_the_verdict_of_the_capture() {
    let (dir, channels) = (folder(), scene::samples(1));
    let native = native(&dir, &channels);
    for (name, separator, comma, time) in [
        ("comma.csv", ',', false, true),
        ("decimal.csv", ';', true, true),
        ("rate.csv", ';', false, false),
    ] {
        write_csv(&dir.path().join(name), &channels, separator, comma, time);
    }
    // The suffix does not matter.
    fs::rename(dir.path().join("decimal.csv"), dir.path().join("decimal.dat")).unwrap();
    for verdict in verdicts(&dir, &["comma.csv", "decimal.dat"])
        .iter()
        .chain(&verdicts(&dir, &["--rate", "12000", "rate.csv"]))
    {
        assert_eq!(*verdict, native);
    }
    // What was guessed stands in the report and in the document.
    let ended = run(&dir, &["diagnose", "--machine", "rig.toml", "decimal.dat"]);
    assert!(ended.stdout.contains("\nnote: guessed: separator ';', decimal comma"), "{ended:?}");
    let ended =
        run(&dir, &["diagnose", "--machine", "rig.toml", "--format", "json", "decimal.dat"]);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(document["notes"][0].as_str().unwrap().contains("decimal comma"), "{document:#}");
}

#[test]
fn sound_gives_the_verdict_of_the_capture() {
    let (dir, channels) = (folder(), scene::samples(1));
    let native = native(&dir, &channels);
    for (bits, format, full) in [
        (16, SampleFormat::Int, 32_768.0),
        (24, SampleFormat::Int, 8_388_608.0),
        (32, SampleFormat::Float, 1.0),
    ] {
        write_wav(&dir.path().join("x.wav"), &channels, bits, format);
        let scale = FULL_SCALE / full;
        let map = |(at, (name, _)): (usize, &(&str, f64))| {
            format!("--map={name}=/ch{},unit=m/s^2,scale={scale}", at + 1)
        };
        let maps: Vec<String> = scene::CHANNELS.iter().enumerate().map(map).collect();
        let mut arguments: Vec<&str> = maps.iter().map(String::as_str).collect();
        arguments.push("x.wav");
        let verdict = verdicts(&dir, &arguments).remove(0);
        assert_eq!(verdict, native, "{bits} bits");
    }
}

#[test]
fn check_shows_what_is_inside_what_was_guessed_and_what_is_missing() {
    let dir = folder();
    let mut text = "Logger;7\n\nt [ms];DE [g];note\n".to_owned();
    (0..500).for_each(|i| text.push_str(&format!("{},5;{},25;ok\n", i, i % 7)));
    fs::write(dir.path().join("a b.csv"), &text).unwrap();
    let spec = WavSpec {
        channels: 1,
        sample_rate: 8000,
        bits_per_sample: 16,
        sample_format: SampleFormat::Int,
    };
    let mut writer = WavWriter::create(dir.path().join("x.wav"), spec).unwrap();
    (0..800_i16).for_each(|i| writer.write_sample(i).unwrap());
    writer.finalize().unwrap();
    let ended = run(&dir, &["check", "a b.csv", "x.wav"]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
    for fact in [
        "a b.csv: CSV, ",
        "guessed: separator ';', decimal comma, header in line 3, time in column 1 of 3 (\"t [ms]\"), unit 0.001 s\n",
        "channel DE: 500 samples at 1000 Hz, 0.5 s, float64 (text, column 2), unit g, converted to m/s^2\n",
        "not channels, ignored: note (500 of 500 cells hold no number)\n",
        "all 500 samples can be read\n",
        "rotorwatch diagnose --machine rig.toml --map 'DE=/DE,unit=g' 'a b.csv'\n",
        "x.wav: WAV, 1644 bytes, 0.1 s\n",
        "channel ch1: 800 samples at 8000 Hz, 0.1 s, int16 (16-bit integers), unit unknown\n",
        "missing unit of ch1: none",
        "rotorwatch diagnose --machine rig.toml --map 'ch1=/ch1' x.wav\n",
    ] {
        assert!(ended.stdout.contains(fact), "{fact}\nnot in\n{}", ended.stdout);
    }
    assert!(!ended.stdout.contains("format"), "{}", ended.stdout);
    // The line shown reads the file.
    let shown = run(&dir, &["diagnose", "--map", "DE=/DE,unit=g", "--format", "json", "a b.csv"]);
    assert_eq!((shown.status.code(), shown.stderr.as_str()), (Some(0), ""));
}

#[test]
fn errors_name_the_line_and_the_remedy() {
    let dir = folder();
    let write = |name: &str, content: &[u8]| fs::write(dir.path().join(name), content).unwrap();
    let rows = |from: i32, to: i32| -> String {
        (from..to).map(|i| format!("{}.{:02},{}\n", i / 100, i % 100, i % 5)).collect()
    };
    write("narrow.csv", (rows(0, 50) + "0.50\n" + &rows(51, 100)).as_bytes());
    write("back.csv", ("t,x\n".to_owned() + &rows(0, 50) + &rows(20, 80)).as_bytes());
    write("no-rate.csv", "1.5;2\n1.25;3\n1.75;9\n".repeat(20).as_bytes());
    write("words.csv", b"some words\nand more\n");
    write("x.mat", b"MATLAB 5.0 MAT-file, Platform: PCWIN64\0\0\0");
    write("cut.wav", b"RIFF\x24\x08\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0\x40\x1f\0\0\x80\x3e\0\0\x02\0\x10\0data\0\x08\0\0\0\0");
    let expected = [
        ("narrow.csv", "error: narrow.csv:51: 1 cell where the table has 2; take the line out"),
        (
            "back.csv",
            "error: back.csv:52: the time falls back by 0.290000 s; sort or cut the file; with --rate HZ",
        ),
        ("no-rate.csv", "error: no-rate.csv: no time column, and no rate is given; give --rate HZ"),
        ("words.csv", "error: words.csv: text without a table of numbers"),
        (
            "x.mat",
            "error: x.mat: this is a MATLAB file of version 5, which is not read: save it again with save -v7.3",
        ),
        (
            "cut.wav",
            "error: cut.wav: WAV: the header states 2048 bytes of samples, the file has 2: cut off",
        ),
    ];
    let files = expected.map(|(name, _)| name);
    let ended = run(&dir, &[&["diagnose", "--machine", "rig.toml"], &files[..]].concat());
    assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(2), ""));
    for (_, message) in expected {
        assert!(ended.stderr.contains(message), "{message}\nnot in\n{}", ended.stderr);
    }
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
    let checked = run(&dir, &["check", "x.mat", "words.csv", "back.csv", "no-rate.csv"]);
    assert_eq!(checked.status.code(), Some(2));
    for message in [
        "error: x.mat: this is a MATLAB file of version 5, not a machine file, a scene, a configuration or a capture: save it",
        "error: words.csv: this is a text file without a table",
        "error: back.csv:52: the time falls back",
        "error: no-rate.csv: no time column",
    ] {
        assert!(checked.stderr.contains(message), "{message}\nnot in\n{}", checked.stderr);
    }
    for line in ["separator ';'", "60 rows of ch1, ch2", "--rate HZ --map 'ch1=/ch1' --map 'ch2"] {
        assert!(checked.stdout.contains(line), "{line}\nnot in\n{}", checked.stdout);
    }
    let wrong = run(&dir, &["diagnose", "--machine", "narrow.csv", "x.h5"]);
    assert!(
        wrong.stderr.contains("narrow.csv: this is a capture, not a machine file"),
        "{}",
        wrong.stderr
    );
}

#[test]
fn a_table_is_replayed_with_what_source_and_machine_file_say() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
                  kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.csv\"\nrate_hz = 2000\n";
    let machine = format!("{}[capture.map]\nright_x = \"/DE\"\n", support::MACHINE);
    let mut table = "DE;other\n".to_owned();
    (0..24_000).for_each(|i| table.push_str(&format!("{},{:03};0\n", i / 1000, i % 1000)));
    let files = [("rig.toml", machine.as_bytes()), ("x.csv", table.as_bytes())];
    let daemon = Daemon::start_in(support::folder(config, &files));
    daemon.wait_finished("rig-1");
    let (_, channels) = daemon.get_json("/api/v1/machines/rig-1/channels");
    let shown = &channels["items"][0];
    assert_eq!(
        (&shown["name"], &shown["received"]),
        (&"right_x".into(), &24_000.into()),
        "{shown}"
    );
    let path = "/api/v1/machines/rig-1/channels/right_x/waveform";
    let (_, waveform) = daemon.get_json(path);
    let last = waveform["value"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    assert!((last - 23.999).abs() < 1e-5, "f32 keeps seven digits: {last}");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}
