//! Speed and memory of reading captures: `cargo bench --bench capture_read`.
//!
//! Process CPU time (warm page cache), 9 alternating rounds, median and spread, each also as the
//! time of one 8192-point forward f32 FFT in the same run, so that machines compare. Data: a tone
//! in noise, once as int16 counts (RMS about 700), once as the same values in float32 m/s².
//! Peak memory is `VmHWM` of a child that reads a capture of 1 GB.

#![expect(clippy::print_stdout, reason = "a bench reports to the terminal")]
#![expect(clippy::unwrap_used, reason = "a bench may stop")]

mod yardstick;

use cpu_time::ProcessTime;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::writer::{
    CaptureHeader, CaptureWriter, ChannelHeader, ChannelSamples, ChannelStorage,
};
use rotorwatch::units::Hz;
use std::path::Path;

const ROUNDS: usize = 9;
const N_CHANNELS: usize = 8;
const PLAIN: ChannelStorage = ChannelStorage::Contiguous;
const GZIP: ChannelStorage = ChannelStorage::Compressed { chunk_samples: 65_536, level: 4 };

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, file] = &arguments[..]
        && flag == "--peak"
    {
        println!("{} {}", drain(Path::new(file)), peak_kb());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    speeds(folder.path());
    for (name, storage) in [("contiguous", PLAIN), ("gzip + shuffle", GZIP)] {
        let path = folder.path().join("large.h5");
        write(&path, 33_554_432, storage, true);
        let bytes = std::fs::metadata(&path).unwrap().len();
        let child = std::process::Command::new(std::env::current_exe().unwrap())
            .arg("--peak")
            .arg(&path)
            .output()
            .unwrap();
        let text = String::from_utf8(child.stdout).unwrap();
        let (samples, kb) = text.trim().split_once(' ').unwrap();
        println!("peak memory, {name}, {bytes} bytes, {samples} samples: {kb} kB");
    }
}

/// Measures the reading jobs and the yardstick in turn.
fn speeds(folder: &Path) {
    let jobs = [
        ("contiguous float32", PLAIN, true),
        ("contiguous int16", PLAIN, false),
        ("gzip + shuffle int16", GZIP, false),
        ("gzip + shuffle float32", GZIP, true),
    ];
    let files: Vec<_> = (0..jobs.len()).map(|at| folder.join(format!("{at}.h5"))).collect();
    for (file, (_, storage, float)) in files.iter().zip(jobs) {
        write(file, 2_000_000, storage, float);
        drain(file); // warms the page cache
    }
    let mut times_s = vec![Vec::new(); jobs.len() + 1];
    for _ in 0..ROUNDS {
        for (file, times_s) in files.iter().zip(&mut times_s) {
            let repeats = 3;
            let start = ProcessTime::now();
            let n_samples: u64 = (0..repeats).map(|_| drain(file)).sum();
            times_s.push(start.elapsed().as_secs_f64() / n_samples as f64);
        }
        times_s[jobs.len()].push(yardstick::fft_s());
    }
    let fft_median_s = yardstick::median(&mut times_s[jobs.len()]);
    println!("yardstick: 8192-point FFT {:.1} us", fft_median_s * 1e6);
    for ((name, _, _), times_s) in jobs.iter().zip(&mut times_s) {
        let time_s = yardstick::median(times_s);
        let spread = (times_s[ROUNDS - 1] - times_s[0]) / time_s * 100.0;
        println!(
            "{name}: {:.0} Msamples/s (spread {spread:.0} %), {:.0} samples a yardstick",
            1e-6 / time_s,
            fft_median_s / time_s
        );
    }
}

/// Reads all blocks, gives the number of samples.
fn drain(path: &Path) -> u64 {
    let mut reader = CaptureReader::open(path, None, &Hints::default()).unwrap();
    let mut n_samples = 0;
    while let Some(block) = reader.next_block().unwrap() {
        n_samples += std::hint::black_box(&block.samples).len() as u64;
    }
    n_samples
}

/// Writes `N_CHANNELS` channels of `n` samples at 25.6 kHz.
fn write(path: &Path, n: usize, storage: ChannelStorage, float: bool) {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut writer = CaptureWriter::create(path, &CaptureHeader::default()).unwrap();
    for channel in 0..N_CHANNELS {
        let header = ChannelHeader {
            name: format!("c{channel}"),
            sample_rate: Hz(25_600.0),
            unit: Some("m/s^2".into()),
            sensor: None,
            storage,
        };
        let counts: Vec<i16> = (0..n).map(|k| count(k, &mut random)).collect();
        if float {
            let samples: Vec<f32> = counts.iter().map(|&x| f32::from(x) * 1e-3).collect();
            writer.channel(&header, ChannelSamples::F32(&samples)).unwrap();
        } else {
            let samples = ChannelSamples::I16 { counts: &counts, scale: 1e-3, offset: 0.0 };
            writer.channel(&header, samples).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[expect(clippy::cast_possible_truncation, reason = "at most 2500, well inside int16")]
fn count(k: usize, random: &mut Pcg64Mcg) -> i16 {
    let noise: f32 = (0..4).map(|_| random.random_range(-500.0..500.0_f32)).sum();
    ((k as f32 * 0.05).sin() * 500.0 + noise) as i16
}

/// Highest resident memory of this process so far, kB.
fn peak_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}
