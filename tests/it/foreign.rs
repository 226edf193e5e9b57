//! Files of other layouts: what `check` prints reads them, and the verdict is that of a capture.

use crate::scene;
use crate::support;
use crate::support::{Daemon, Ended};
use hdf5::{H5File, H5Group};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The samples of all tests.
fn samples() -> &'static [Vec<f32>] {
    static SAMPLES: OnceLock<Vec<Vec<f32>>> = OnceLock::new();
    SAMPLES.get_or_init(|| scene::samples(1))
}

/// A folder with `rig.toml` and the capture `native.h5`.
fn folder() -> TempDir {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("rig.toml"), scene::MACHINE).unwrap();
    scene::write(&dir.path().join("native.h5"), samples(), None);
    dir
}

fn run(dir: &TempDir, arguments: &[&str]) -> Ended {
    support::run(support::command().current_dir(dir.path()).args(arguments))
}

/// State, faults and components of a diagnosis with these arguments. The speed is given, because
/// how sure a verdict is depends on who states it, and only a capture states it itself.
fn verdict(dir: &TempDir, arguments: &[&str]) -> Value {
    let head = ["diagnose", "--format", "json", "--speed", "25", "--machine", "rig.toml"];
    let ended = run(dir, &[&head[..], arguments].concat());
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
    part(&ended.stdout)
}

/// What two verdicts about the same samples share.
fn part(text: &str) -> Value {
    let document: Value = serde_json::from_str(text).unwrap();
    let parts = ["state", "faults", "components"].map(|key| document[key].clone());
    assert_eq!(parts[0], "damaged", "{document}");
    Value::Array(parts.to_vec())
}

/// N × C, or C × N, in order of `scene::CHANNELS`.
fn table(by_rows: bool) -> Vec<f32> {
    let (n, channels) = (scene::N_SAMPLES, samples());
    if by_rows {
        (0..n).flat_map(|k| channels.iter().map(move |x| x[k])).collect()
    } else {
        channels.concat()
    }
}

fn write(path: &Path, build: impl FnOnce(&H5File, &H5Group)) {
    let file = H5File::create(path).unwrap();
    build(&file, &file.root_group());
    file.close().unwrap();
}

/// The options that map a table's columns to the machine's channels.
fn columns(path: &str, rate: &str) -> Vec<String> {
    let option = |(k, (name, _)): (usize, &(&str, f64))| format!("{name}={path},column={k},{rate}");
    let options = scene::CHANNELS.iter().enumerate().map(option);
    options.flat_map(|option| ["--map".to_owned(), option]).collect()
}

fn with<'a>(options: &'a [String], file: &'a str) -> Vec<&'a str> {
    options.iter().map(String::as_str).chain([file]).collect()
}

#[test]
fn the_verdict_is_that_of_a_capture() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    let native = verdict(&dir, &["native.h5"]);
    let n = scene::N_SAMPLES;
    write(&at("rows.h5"), |file, _| {
        let data = file.new_dataset::<f32>().shape([n, 3]).create("data").unwrap();
        data.write_raw(&table(true)).unwrap();
        data.new_attr::<f64>().create("fs").unwrap().write_numeric(&scene::RATE_HZ).unwrap();
    });
    assert_eq!(verdict(&dir, &with(&columns("/data", "rate=@fs"), "rows.h5")), native);
    write(&at("columns.h5"), |file, _| {
        let data = file.new_dataset::<f32>().shape([3, n]).chunk(&[2, 5000]).shuffle_deflate(1);
        data.create("data").unwrap().write_raw(&table(false)).unwrap();
        let fs = file.new_dataset::<f64>().shape([1, 1]).create("fs").unwrap();
        fs.write_raw(&[scene::RATE_HZ]).unwrap();
    });
    assert_eq!(verdict(&dir, &with(&columns("/data", "rate=/fs"), "columns.h5")), native);
    write(&at("labview.h5"), |_, root| {
        let group = root.create_group("run 1").unwrap();
        for ((name, _), x) in scene::CHANNELS.iter().zip(samples()) {
            let data = group.new_dataset::<f32>().shape([n]).create(name).unwrap();
            data.write_raw(x).unwrap();
            let interval = data.new_attr::<f64>().create("wf_increment").unwrap();
            interval.write_numeric(&(1.0 / scene::RATE_HZ)).unwrap();
        }
    });
    let options: Vec<String> = scene::CHANNELS
        .iter()
        .map(|(name, _)| format!("--map={name}=/run 1/{name},interval=@wf_increment"))
        .collect();
    assert_eq!(verdict(&dir, &with(&options, "labview.h5")), native);
    // The same by the machine file, on which the file of our own layout is read as ever.
    let map = columns("/data", "rate=@fs").into_iter().filter(|option| option != "--map");
    let lines: String = map
        .map(|option| option.split_once('=').map(|(k, v)| format!("{k} = \"{v}\"\n")).unwrap())
        .collect();
    fs::write(at("rig.toml"), format!("{}[capture.map]\n{lines}", scene::MACHINE)).unwrap();
    assert_eq!(verdict(&dir, &["rows.h5"]), native);
    assert_eq!(verdict(&dir, &["native.h5"]), native);
}

#[test]
fn the_command_that_check_prints_diagnoses() {
    let dir = folder();
    write(&dir.path().join("my export.h5"), |file, _| {
        let data =
            file.new_dataset::<f32>().shape([scene::N_SAMPLES, 3]).create("signals").unwrap();
        data.write_raw(&table(true)).unwrap();
        file.set_attr_string("fault_label", "inner race").unwrap();
    });
    let ended = run(&dir, &["check", "my export.h5"]);
    assert_eq!(ended.status.code(), Some(2), "{}", ended.stdout);
    assert!(ended.stderr.contains("not of rotorwatch's own layout"), "{}", ended.stderr);
    assert!(ended.stdout.contains("@fault_label: not read"), "{}", ended.stdout);
    assert!(!ended.stdout.contains("inner race"), "{}", ended.stdout);
    let command =
        ended.stdout.lines().find(|line| line.starts_with("rotorwatch diagnose")).unwrap();
    let mut command =
        command.replace("RIG.toml", "rig.toml --speed 25 --format json").replace("HZ", "12000");
    for (k, (name, _)) in scene::CHANNELS.iter().enumerate() {
        command = command.replace(&format!("signals_{k}="), &format!("{name}="));
    }
    let program = env!("CARGO_BIN_EXE_rotorwatch");
    let command = command.replacen("rotorwatch", &format!("'{program}'"), 1);
    let mut shell = std::process::Command::new("sh");
    let ended = support::run(shell.current_dir(dir.path()).args(["-c", &command]));
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{command}");
    assert_eq!(part(&ended.stdout), verdict(&dir, &["native.h5"]));
    let options = columns("/signals", "rate=12000");
    let ended = run(&dir, &[&["check"][..], &with(&options, "my export.h5")].concat());
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
    assert!(ended.stdout.contains("all 432000 samples can be read"), "{}", ended.stdout);
    let ended = run(&dir, &["diagnose", "my export.h5"]);
    assert!(ended.stderr.contains("`rotorwatch check my export.h5`"), "{}", ended.stderr);
}

#[test]
fn a_wrong_map_of_a_machine_file_is_told_by_check() {
    let dir = folder();
    let text = format!("{}[capture.map]\nright_x = \"/data,colum=1\"\n", scene::MACHINE);
    fs::write(dir.path().join("rig.toml"), text).unwrap();
    let ended = run(&dir, &["check", "rig.toml"]);
    assert_eq!(ended.status.code(), Some(2));
    let words = "[capture.map] of rig.toml: right_x = \"/data,colum=1\": unknown option \"colum\"";
    assert!(ended.stderr.contains(words), "{}", ended.stderr);
}

#[test]
fn a_channel_without_a_rate_is_read_by_the_rate_given() {
    let dir = folder();
    write(&dir.path().join("bare.h5"), |_, root| {
        let group = root.create_group("channels").unwrap();
        let data = group.new_dataset::<f32>().shape([scene::N_SAMPLES]).create("right_x").unwrap();
        data.write_raw(&samples()[0]).unwrap();
    });
    let ended = run(&dir, &["check", "bare.h5"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(
        ended.stderr.contains("sample_rate_hz") && ended.stderr.contains("--rate HZ"),
        "{}",
        ended.stderr
    );
    assert!(ended.stdout.contains("--map right_x=/channels/right_x,rate=HZ"), "{}", ended.stdout);
    let ended = run(&dir, &["check", "--rate", "12000", "bare.h5"]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""));
}

#[test]
fn a_replay_of_a_mapped_file_delivers_every_sample() {
    let map = "[capture.map]\nright_x = \"/data,column=1,rate=2000\"\n";
    let machine = format!("{}{map}", support::MACHINE);
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
                  kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"export.h5\"\nspeed = \"max\"\n";
    let dir = support::folder(config, &[("rig.toml", machine.as_bytes())]);
    let ramp: Vec<f64> = (0..24_000_u32).flat_map(|k| [0.0, f64::from(k) / 1e3]).collect();
    write(&dir.path().join("export.h5"), |file, _| {
        let data = file.new_dataset::<f64>().shape([24_000, 2]).create("data").unwrap();
        data.write_raw(&ramp).unwrap();
    });
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    let channels = daemon.get_json("/api/v1/machines/rig-1/channels").1;
    assert_eq!(channels["items"][0]["received"], 24_000, "{channels}");
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
}

/// Each component's id, state, fault and severity to 5 digits: float64 is read less its first
/// sample, which moves what is measured by roundings of float32 (6e-8).
fn gist(verdict: &Value) -> Vec<String> {
    let text = |c: &Value| {
        let severity = c["severity"].as_f64().unwrap_or(-1.0);
        format!("{} {} {} {severity:.5}", c["id"], c["state"], c["fault"])
    };
    verdict[2].as_array().unwrap().iter().map(text).collect()
}

/// Makes a file as MATLAB's `save(…, '-v7.3')` does, of the capture given.
const MATLAB: &str = r"
import sys, h5py, numpy as np
def put(group, name, data, kind='double', **options):
    data = group.create_dataset(name, data=data, **options)
    data.attrs.create('MATLAB_class', np.bytes_(kind))
    return data
with h5py.File(sys.argv[1]) as native, h5py.File(sys.argv[2], 'w', userblock_size=512) as f:
    x = np.stack([native['channels'][name][:].astype('f8') for name in sys.argv[3:]])
    put(f, 'data', x, chunks=(1, 2048), compression='gzip', compression_opts=3)
    put(f, 'one', x[:1])
    put(f, 'fs', np.array([[12000.0]]))
    put(f, 'rpm', np.array([[1500.0]]))
    text = lambda t: np.array([[ord(c)] for c in t], dtype='u2')
    put(f, 'unit', text('m/s^2'), 'char').attrs['MATLAB_int_decode'] = np.int32(2)
    put(f, 'start', text('2026-03-01T12:00:00Z'), 'char')
    s = f.create_group('s'); s.attrs.create('MATLAB_class', np.bytes_('struct'))
    put(s, 'left', x[2:])
    refs = f.create_group('#refs#'); cell = refs.create_dataset('a', data=x[:1])
    put(f, 'cells', np.array([[cell.ref]], dtype=h5py.ref_dtype), 'cell')
with open(sys.argv[2], 'r+b') as f:
    f.write(b'MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .'.ljust(124) + b'\x00\x02IM')
";

#[test]
#[ignore = "needs python3 with h5py"]
fn a_matlab_file_is_diagnosed_like_a_capture() {
    let dir = folder();
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".into());
    let names = scene::CHANNELS.map(|(name, _)| name);
    let mut command = std::process::Command::new(python);
    command.current_dir(dir.path()).args(["-c", MATLAB, "native.h5", "run.mat"]).args(names);
    let made = support::run(&mut command);
    assert!(made.status.success(), "{}", made.stderr);
    let native = gist(&verdict(&dir, &["native.h5"]));
    let facts = ["--map", "@shaft_speed=/rpm,unit=rpm", "--map", "@start_time=/start"];
    let options = columns("/data", "rate=/fs,unit=/unit");
    assert_eq!(gist(&verdict(&dir, &[&facts[..], &with(&options, "run.mat")].concat())), native);
    let apart = [
        "--map=right_x=/one,rate=/fs",
        "--map=right_y=/data,row=1,rate=/fs",
        "--map=left_x=/s/left,rate=/fs",
    ];
    assert_eq!(gist(&verdict(&dir, &[&facts[..], &apart, &["run.mat"]].concat())), native);
    let cell = ["diagnose", "--machine", "rig.toml", "--map", "right_x=/cells,rate=1", "run.mat"];
    let ended = run(&dir, &cell);
    assert!(ended.stderr.contains("a MATLAB cell array"), "{}", ended.stderr);
    let ended = run(&dir, &["check", "run.mat"]);
    let words = "--map data_2=/data,column=2,rate=/fs,unit=/unit";
    assert!(ended.stdout.contains(words), "{}", ended.stdout);
}
