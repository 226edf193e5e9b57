//! First figures of the whole program: `cargo bench --bench first_figures`.
//!
//! Process CPU time, 9 alternating rounds, median and spread, each also as a number of 8192-point
//! forward f32 FFTs of the same run, so that computers compare. Peak memory is `VmHWM` of a child
//! that runs the command `diagnose` on a capture of 1 GB. Results and goals: `docs/performance.md`.

#![expect(clippy::print_stdout, reason = "a bench reports to the terminal")]
#![expect(clippy::unwrap_used, reason = "a bench may stop")]

mod yardstick;

use clap::Parser;
use cpu_time::ProcessTime;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::writer::{
    CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage,
};
use rotorwatch::cli;
use rotorwatch::machine::Machine;
use rotorwatch::machine::file;
use rotorwatch::offline;
use rotorwatch::offline::Reference;
use rotorwatch::pipeline::{Monitor, Settings, SpeedHints};
use rotorwatch::signal::{Block, ChannelInfo, SampleIndex};
use rotorwatch::units::Hz;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

const ROUNDS: usize = 9;

/// Commands a round: the CPU time of children is told in hundredths of a second.
const COMMANDS: u32 = 10;

/// Hundredths of a second: `USER_HZ` of Linux on every architecture.
const TICKS_PER_S: f64 = 100.0;

const SPEED_HZ: f64 = 25.0;

/// A recording: channels, rate and length.
#[derive(Clone, Copy)]
struct Shape {
    n_channels: usize,
    rate_hz: f64,
    n_samples: usize,
}

/// What the goals speak of: 10 s, 3 channels, 12 kHz.
const SHORT: Shape = Shape { n_channels: 3, rate_hz: 12_000.0, n_samples: 120_000 };

/// A minute of the same, for the daemon's windows.
const MINUTE: Shape = Shape { n_channels: 3, rate_hz: 12_000.0, n_samples: 720_000 };

/// 1 GB: 22 min of 8 channels at 25.6 kHz.
const LARGE: Shape = Shape { n_channels: 8, rate_hz: 25_600.0, n_samples: 31_250_000 };

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, machine, capture] = &arguments[..]
        && flag == "--peak"
    {
        let words = ["rotorwatch", "diagnose", "--machine", machine, capture];
        let _exit_code = cli::run(&cli::Cli::parse_from(words));
        println!("\n{} {}", peak_kb(), ProcessTime::now().as_duration().as_secs_f64());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    speeds(folder.path());
    if !arguments.iter().any(|a| a == "--no-peak") {
        peak(folder.path());
    }
}

/// Measures the jobs and the yardstick in turn.
fn speeds(folder: &Path) {
    let (machine_file, short) = prepare(folder, "short", SHORT);
    let (_, minute) = prepare(folder, "minute", MINUTE);
    let machine = Arc::new(machine_of(SHORT));
    let (channels, blocks) = load(&minute, &machine);
    let channel_seconds = MINUTE.n_channels as f64 * MINUTE.n_samples as f64 / MINUTE.rate_hz;
    let names = ["diagnose, process", "diagnose, library", "monitor, a channel-second"];
    let mut times_s = vec![Vec::new(); names.len() + 1];
    for _ in 0..ROUNDS {
        times_s[0].push(commands_s(&machine_file, &short));
        times_s[1].push(library_s(&machine, &short));
        times_s[2].push(monitor_s(&machine, &channels, &blocks) / channel_seconds);
        times_s[3].push(yardstick::fft_s());
    }
    let fft_median_s = yardstick::median(&mut times_s[3]);
    println!("yardstick: 8192-point FFT {:.1} us", fft_median_s * 1e6);
    for (name, times_s) in names.iter().zip(&mut times_s) {
        let time_s = yardstick::median(times_s);
        let spread = (times_s[ROUNDS - 1] - times_s[0]) / time_s * 100.0;
        let yardsticks = time_s / fft_median_s;
        println!(
            "{name}: {:.3} ms (spread {spread:.0} %), {yardsticks:.0} yardsticks",
            time_s * 1e3
        );
    }
}

/// CPU time of one run of the built program, start and end included, s.
fn commands_s(machine_file: &Path, capture: &Path) -> f64 {
    let before = children_s();
    for _ in 0..COMMANDS {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rotorwatch"));
        command.arg("diagnose").arg("--machine").arg(machine_file).arg(capture);
        let status = command.stdin(Stdio::null()).stdout(Stdio::null()).status().unwrap();
        assert!(status.success());
    }
    (children_s() - before) / f64::from(COMMANDS)
}

/// CPU time of the children that have ended so far, user and system, s: fields 16 and 17 of `stat`.
fn children_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    // The name in parentheses may hold spaces; fields are counted behind it, from the third on.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    let ticks = |field: usize| fields[field - 3].parse::<f64>().unwrap();
    (ticks(16) + ticks(17)) / TICKS_PER_S
}

/// CPU time of one diagnosis in this process, s.
fn library_s(machine: &Arc<Machine>, capture: &Path) -> f64 {
    let reference = Reference { machine: Some(Arc::clone(machine)), ..Reference::default() };
    let repeats = 5;
    let start = ProcessTime::now();
    for _ in 0..repeats {
        let diagnosis = offline::diagnose(capture, &reference, &mut |_| ()).unwrap();
        std::hint::black_box(diagnosis);
    }
    start.elapsed().as_secs_f64() / f64::from(repeats)
}

/// CPU time of a daemon's monitor on all blocks, with the default windows, s.
fn monitor_s(machine: &Arc<Machine>, channels: &[ChannelInfo], blocks: &[Block]) -> f64 {
    let hints = SpeedHints { option: None, capture: Some(Hz(SPEED_HZ)) };
    let settings = Settings::default();
    let start = ProcessTime::now();
    let mut monitor =
        Monitor::new(Arc::clone(machine), channels.to_vec(), hints, &settings).unwrap();
    let mut n_windows = 0;
    for block in blocks {
        monitor.step(block, &mut |outcome| {
            n_windows += 1;
            std::hint::black_box(outcome);
        });
    }
    let elapsed_s = start.elapsed().as_secs_f64();
    assert_eq!(n_windows, 12, "one window each 5 s");
    elapsed_s
}

/// Reads a capture into blocks of a quarter of a second, as the daemon's replay does.
fn load(capture: &Path, machine: &Machine) -> (Vec<ChannelInfo>, Vec<Block>) {
    let mut reader = CaptureReader::open(capture, Some(machine), &Hints::default()).unwrap();
    let channels: Vec<ChannelInfo> =
        reader.info().channels.iter().map(|c| c.info.clone()).collect();
    let mut blocks = Vec::new();
    while let Some(block) = reader.next_block().unwrap() {
        let rate_hz = channels[block.channel.0].sample_rate.0;
        for (i, samples) in block.samples.chunks(3000).enumerate() {
            let offset = i * 3000;
            blocks.push(Block {
                start: SampleIndex(block.start.0 + offset as u64),
                time_s: block.time_s + offset as f64 / rate_hz,
                samples: samples.to_vec(),
                ..block.clone()
            });
        }
    }
    blocks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    (channels, blocks)
}

/// Peak memory of `diagnose` on 1 GB.
fn peak(folder: &Path) {
    let (machine_file, capture) = prepare(folder, "large", LARGE);
    let bytes = std::fs::metadata(&capture).unwrap().len();
    let child = Command::new(std::env::current_exe().unwrap())
        .arg("--peak")
        .args([&machine_file, &capture])
        .output()
        .unwrap();
    let text = String::from_utf8(child.stdout).unwrap();
    let (kb, cpu_s) = text.lines().last().unwrap().split_once(' ').unwrap();
    println!("peak memory of diagnose on {bytes} bytes: {kb} kB, in {cpu_s} s of CPU time");
}

/// A motor with two bearings (SKF 6205, SKF 6203), channels dealt out to them in turn.
fn machine_text(shape: Shape) -> String {
    let sensors = (0..shape.n_channels).map(|channel| {
        let bearing = ["drive-end", "fan-end"][channel % 2];
        format!(
            "[[sensor]]\nchannel = \"c{channel}\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\n\
             at = {{ bearing = \"{bearing}\" }}\n"
        )
    });
    let fixed = "[machine]\nid = \"motor\"\nname = \"Motor\"\n\
         [[shaft]]\nid = \"main\"\nspeed_hz = 25.0\n\
         [[bearing]]\nid = \"drive-end\"\nshaft = \"main\"\nelements = 9\n\
         element_diameter_mm = 7.94\npitch_diameter_mm = 39.04\n\
         [[bearing]]\nid = \"fan-end\"\nshaft = \"main\"\nelements = 8\n\
         element_diameter_mm = 6.746\npitch_diameter_mm = 28.499\n";
    fixed.to_owned() + &sensors.collect::<String>()
}

fn machine_of(shape: Shape) -> Machine {
    file::parse(&machine_text(shape), "motor.toml").unwrap()
}

/// Writes machine file and capture of a shape.
fn prepare(folder: &Path, name: &str, shape: Shape) -> (PathBuf, PathBuf) {
    let machine_file = folder.join(format!("{name}.toml"));
    std::fs::write(&machine_file, machine_text(shape)).unwrap();
    let capture = folder.join(format!("{name}.h5"));
    let header = CaptureHeader { shaft_speed: Some(Hz(SPEED_HZ)), ..CaptureHeader::default() };
    let mut writer = CaptureWriter::create(&capture, &header).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for channel in 0..shape.n_channels {
        let header = ChannelHeader {
            name: format!("c{channel}"),
            sample_rate: Hz(shape.rate_hz),
            unit: Some("m/s^2".to_owned()),
            sensor: None,
            storage: ChannelStorage::Contiguous,
        };
        let samples = vibration(shape, &mut random);
        writer.channel(&header, ChannelSamples::F32(&samples)).unwrap();
    }
    writer.finish().unwrap();
    (machine_file, capture)
}

/// Noise, a 1× line, and ringing impacts at BPFI of the first bearing.
fn vibration(shape: Shape, random: &mut Pcg64Mcg) -> Vec<f32> {
    let turn = TAU * SPEED_HZ / shape.rate_hz;
    #[expect(clippy::cast_possible_truncation, reason = "f32 is what a channel holds")]
    let mut x: Vec<f32> = (0..shape.n_samples)
        .map(|i| (0.5 * (turn * i as f64).cos()) as f32 + random.random_range(-1.0..1.0_f32))
        .collect();
    let bpfi_hz = 4.5 * (1.0 + 7.94 / 39.04) * SPEED_HZ;
    let period = shape.rate_hz / bpfi_hz;
    let ring: Vec<f32> = (0..100_u16)
        .map(|i| 5.0 * (-0.08 * f32::from(i)).exp() * (1.6 * f32::from(i)).sin())
        .collect();
    let mut at = 0.0;
    while at < shape.n_samples as f64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
        let first = at as usize;
        for (value, ring) in x[first..].iter_mut().zip(&ring) {
            *value += ring;
        }
        at += period;
    }
    x
}

/// Highest resident memory of this process so far, kB.
fn peak_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}
