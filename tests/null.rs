//! Honesty: records without any fault accuse nothing, and probabilities mean what they say.
//!
//! Seeded noise of several kinds, as a two-channel machine might give it in good health, goes
//! through `features::Extractor` and `diagnosis::assess`, 10 s at 12 kHz each.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]
#![expect(clippy::print_stdout, reason = "a calibration shows its figures")]

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::diagnosis;
use rotorwatch::diagnosis::Context;
use rotorwatch::diagnosis::baseline::{Baseline, Record};
use rotorwatch::diagnosis::confidence::{band_probability, harmonic_tail};
use rotorwatch::features::bands::Band;
use rotorwatch::features::speed::SpeedHints;
use rotorwatch::features::{ChannelWindow, Extractor, Window, WindowFeatures};
use rotorwatch::machine::Machine;
use rotorwatch::machine::file;
use rotorwatch::signal::ChannelInfo;
use rotorwatch::units::{Hz, Unit};
use std::f64::consts::TAU;
use std::sync::Arc;

const RATE_HZ: f64 = 12_000.0;
/// 10 s.
const N_SAMPLES: usize = 120_000;
/// For counts of very many, unless `ROTORWATCH_SECONDS` says otherwise. The floor rests on 190 bins there; of fewer the F
/// tail is fatter than that of a median.
const FEW_SECONDS: f64 = 4.0;
const SPEED_HZ: f64 = 29.95;

const MACHINE: &str = r#"
[machine]
id = "stand"
name = "Motor test stand"
[[shaft]]
id = "motor"
speed_hz = 29.5
[[motor]]
shaft = "motor"
poles = 4
line_frequency_hz = 60.0
[[bearing]]
id = "drive-end"
shaft = "motor"
elements = 9
element_diameter_mm = 7.94
pitch_diameter_mm = 39.04
[[bearing]]
id = "fan-end"
shaft = "motor"
elements = 8
element_diameter_mm = 6.746
pitch_diameter_mm = 28.499
[[sensor]]
channel = "DE"
kind = "accelerometer"
at = { bearing = "drive-end" }
[[sensor]]
channel = "FE"
kind = "accelerometer"
at = { bearing = "fan-end" }
"#;

/// Kinds of vibration without a fault.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// White noise.
    White,
    /// Noise of equal power an octave.
    Pink,
    /// Noise with ringing impacts at random times, 30 a second: cavitation, chips, rain.
    Impacts,
    /// Noise with mains hum, shaft harmonics and twelve tones anywhere.
    Tones,
    /// Noise with a ringing knock at each turn: a key, a coupling.
    Knocks,
}

const KINDS: [Kind; 5] = [Kind::White, Kind::Pink, Kind::Impacts, Kind::Tones, Kind::Knocks];

impl Kind {
    /// How much oftener than nominal a fundamental may undercut a level in the mean. The lowest band of pink noise has
    /// most of its power in its first octave: so few degrees of freedom that cells are not quite exponential (1.09 counted).
    const fn slack(self) -> f64 {
        match self {
            Self::Pink => 1.15,
            Self::White | Self::Impacts | Self::Tones | Self::Knocks => 1.0,
        }
    }

    /// One channel of `n` samples, m/s².
    fn channel(self, n: usize, random: &mut Pcg64Mcg) -> Vec<f32> {
        let mut x: Vec<f64> = (0..n).map(|_| gaussian(random)).collect();
        match self {
            Self::White => {}
            Self::Pink => make_pink(&mut x),
            Self::Impacts => {
                let mut time_s = 0.0;
                while time_s < n as f64 / RATE_HZ {
                    let strength = -10.0 * (1.0 - random.random::<f64>()).ln();
                    ring(&mut x, time_s, strength);
                    time_s -= (1.0 - random.random::<f64>()).ln() / 30.0;
                }
            }
            Self::Tones => {
                let harmonics = (1..=4).map(|h| f64::from(h) * SPEED_HZ);
                let hum = (1..=4).map(|h| f64::from(h) * 60.0);
                let known: Vec<f64> = harmonics.chain(hum).collect();
                let anywhere = (0..12).map(|_| SPEED_HZ * random.random_range(0.3..40.0));
                let tones: Vec<f64> = known.into_iter().chain(anywhere).collect();
                for frequency_hz in tones {
                    let amplitude = 10.0_f64.powf(random.random_range(-1.5..0.5));
                    let phase = random.random_range(0.0..TAU);
                    for (i, value) in x.iter_mut().enumerate() {
                        let turn = TAU * frequency_hz * i as f64 / RATE_HZ;
                        *value += amplitude * (turn + phase).cos();
                    }
                }
            }
            Self::Knocks => {
                let n_turns = n as f64 / RATE_HZ * SPEED_HZ;
                for turn in (0..).map(f64::from).take_while(|turn| *turn < n_turns) {
                    ring(&mut x, turn / SPEED_HZ, 10.0);
                }
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "f32 is what a channel holds")]
        x.iter().map(|v| *v as f32).collect()
    }
}

/// Filters white noise to −3 dB an octave from 10 Hz up: three first-order low-passes (P. Kellet's
/// economy filter).
fn make_pink(x: &mut [f64]) {
    let mut poles = [0.0; 3];
    for value in x {
        for (pole, (a, b)) in
            poles.iter_mut().zip([(0.99765, 0.0990460), (0.96300, 0.2965164), (0.57000, 1.0526913)])
        {
            *pole = a * *pole + b * *value;
        }
        *value = poles.iter().sum::<f64>() + 0.1848 * *value;
    }
}

/// Adds the ring-down of a 3 kHz resonance with a damping ratio of 0.05.
fn ring(x: &mut [f64], time_s: f64, strength: f64) {
    let omega = TAU * 3000.0;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 120000")]
    let first = (time_s * RATE_HZ).ceil() as usize;
    for (i, value) in x.iter_mut().enumerate().skip(first).take(200) {
        let t = i as f64 / RATE_HZ - time_s;
        *value += strength * (-0.05 * omega * t).exp() * (omega * t).sin();
    }
}

/// A number of mean 0 and variance 1, nearly normal: the sum of twelve uniform ones.
fn gaussian(random: &mut Pcg64Mcg) -> f64 {
    (0..12).map(|_| random.random_range(-0.5..0.5)).sum()
}

/// The machine with its stream, ready to judge.
struct Bench {
    machine: Arc<Machine>,
    channels: Vec<ChannelInfo>,
    extractor: Extractor,
}

impl Bench {
    fn new() -> Self {
        let machine = Arc::new(file::parse(MACHINE, "stand.toml").unwrap());
        let channel = |name: &str| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(RATE_HZ),
            unit: Unit::MetrePerSecondSquared,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let channels = vec![channel("DE"), channel("FE")];
        let hints = SpeedHints { option: None, capture: Some(Hz(SPEED_HZ)) };
        let extractor = Extractor::new(Arc::clone(&machine), channels.clone(), hints);
        Self { machine, channels, extractor }
    }

    /// Features of the record of this kind and seed.
    fn measure(&mut self, kind: Kind, seed: u64) -> WindowFeatures {
        self.measure_n(kind, seed, N_SAMPLES)
    }

    /// The same of a record of `n` samples.
    fn measure_n(&mut self, kind: Kind, seed: u64, n: usize) -> WindowFeatures {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let samples = [kind.channel(n, &mut random), kind.channel(n, &mut random)];
        let window = |samples| Some(ChannelWindow { start: 0, time_s: 0.0, samples });
        let channels = samples.iter().map(|samples| window(&samples[..])).collect();
        self.extractor.extract(&Window { time_s: (0.0, n as f64 / RATE_HZ), channels })
    }

    /// What is accused, as text.
    fn accused(&self, features: &WindowFeatures, baseline: &Baseline) -> Vec<String> {
        let context = Context {
            machine: &self.machine,
            channels: &self.channels,
            channel_of_sensor: self.extractor.channel_of_sensor(),
            baseline,
            runs: baseline,
            offered_baselines: 1,
            void_baselines: None,
            false_alarm_probability: rotorwatch::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
        };
        let verdicts = diagnosis::assess(features, &context);
        let accused = verdicts.iter().filter(|c| c.state.is_accusation());
        accused.map(|c| format!("{} {:?}: {}", c.id, c.fault, c.why)).collect()
    }

    /// A baseline of `n` records of a kind.
    fn baseline(&mut self, kind: Kind, n: u64) -> Baseline {
        let record = |seed| {
            let features = self.measure(kind, 1_000_000 + seed);
            let windows = [(features.speed.first, features.channels)];
            Record::of_windows(&format!("healthy {seed}"), &windows, &self.channels)
        };
        let records = (0..n).map(record).collect();
        Baseline { records, provisional: false }
    }
}

/// Judges records of a kind; gives every accusation.
fn accusations(kind: Kind, seeds: std::ops::Range<u64>) -> Vec<String> {
    let mut bench = Bench::new();
    let mut found = Vec::new();
    for seed in seeds {
        let features = bench.measure(kind, seed);
        let accused = bench.accused(&features, &Baseline::default());
        found.extend(accused.iter().map(|text| format!("{kind:?} {seed}: {text}")));
    }
    found
}

fn assert_nothing_is_accused(kind: Kind) {
    let found = accusations(kind, 0..8);
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn white_noise_accuses_nothing() {
    assert_nothing_is_accused(Kind::White);
}

#[test]
fn pink_noise_accuses_nothing() {
    assert_nothing_is_accused(Kind::Pink);
}

#[test]
fn impacts_at_random_times_accuse_nothing() {
    assert_nothing_is_accused(Kind::Impacts);
}

#[test]
fn hum_and_tones_accuse_nothing() {
    assert_nothing_is_accused(Kind::Tones);
}

#[test]
fn a_knock_a_turn_accuses_nothing() {
    assert_nothing_is_accused(Kind::Knocks);
}

#[test]
fn more_of_the_same_is_not_abnormal() {
    // One record for a baseline: assumed scatter. Five: measured scatter.
    for n_records in [1, 5] {
        let mut bench = Bench::new();
        let baseline = bench.baseline(Kind::White, n_records);
        for seed in 0..4 {
            let features = bench.measure(Kind::White, seed);
            let accused = bench.accused(&features, &baseline);
            assert!(accused.is_empty(), "{n_records} records, seed {seed}: {accused:#?}");
        }
    }
}

#[test]
#[ignore = "long: 1000 noise records"]
fn a_thousand_records_accuse_nothing() {
    let found: Vec<String> =
        KINDS.iter().flat_map(|kind| accusations(*kind, 10_000..10_200)).collect();
    println!("{} accusations in 1000 records", found.len());
    assert!(found.is_empty(), "{found:#?}");
}

/// How often each of `LEVELS` is undercut by the probabilities of bands and of their fundamentals.
struct Exceedance {
    n: usize,
    band: [usize; LEVELS.len()],
    fundamental: [usize; LEVELS.len()],
}

const LEVELS: [f64; 3] = [1e-1, 1e-2, 1e-3];

fn exceedance(kind: Kind, seeds: std::ops::Range<u64>) -> Exceedance {
    let mut bench = Bench::new();
    let mut found = Exceedance { n: 0, band: [0; LEVELS.len()], fundamental: [0; LEVELS.len()] };
    for seed in seeds {
        let features = bench.measure(kind, seed);
        let readings = features.bearing_lines.iter().flat_map(|s| s.outcome.iter().flatten());
        for reading in readings {
            let fundamental = reading.harmonics[0].map_or(1.0, |h| harmonic_tail(&h));
            found.n += 1;
            for (at, level) in LEVELS.iter().enumerate() {
                found.band[at] += usize::from(band_probability(reading) <= *level);
                found.fundamental[at] += usize::from(fundamental <= *level);
            }
        }
    }
    found
}

/// How much oftener than nominal a fundamental alone may undercut its level: the scatter of about 2240 dependent bands.
const FUNDAMENTAL_SLACK: f64 = 2.0;

/// Bands must never promise more than they hold.
fn check_calibration(kind: Kind, seeds: std::ops::Range<u64>) {
    let found = exceedance(kind, seeds);
    for (at, level) in LEVELS.iter().enumerate() {
        let part = |count: [usize; LEVELS.len()]| count[at] as f64 / found.n as f64;
        let (band, fundamental) = (part(found.band), part(found.fundamental));
        println!(
            "{kind:?}, {} bands, nominal {level}: bands {band:.5}, fundamentals {fundamental:.5}",
            found.n
        );
        assert!(found.n > 1000, "the bands of this machine are read");
        assert!(band <= *level, "{kind:?}: bands at {level}: {band}");
        assert!(
            fundamental <= FUNDAMENTAL_SLACK * level,
            "{kind:?}: fundamentals at {level}: {fundamental}"
        );
    }
}

#[test]
fn probabilities_of_noise_are_nominal_or_conservative() {
    check_calibration(Kind::White, 0..20);
}

#[test]
#[ignore = "long: 300 noise records"]
fn probabilities_of_every_noise_are_nominal_or_conservative() {
    for kind in [Kind::White, Kind::Pink, Kind::Impacts] {
        check_calibration(kind, 0..100);
    }
}

/// Levels of a false alarm, and one deeper: what is asked of a line before several are searched.
const RARE: [f64; 3] = [1e-3, 1e-4, 1e-5];

/// Readings that are counted a kind of noise, unless ROTORWATCH_READINGS says otherwise.
const ENOUGH: usize = 100_000;

/// What lies outside of a 99 % interval at either end.
const OUTSIDE_99: f64 = 0.005;

/// Probabilities that at most and at least so many of rare events happen of which `mean` are expected (Poisson).
fn tails(count: usize, mean: f64) -> (f64, f64) {
    let mut ln_term = -mean;
    let mut below = 0.0;
    for k in 0..count {
        below += ln_term.exp();
        ln_term += (mean / (k + 1) as f64).ln();
    }
    (below + ln_term.exp(), 1.0 - below)
}

/// Counts how often the line of noise undercuts each of `RARE`, over bands that share no frequency and lines of both
/// bearings and channels: of one band and line with its search paid for, and of the least over the harmonics.
fn rare(
    kind: Kind,
    enough: usize,
    n_samples: usize,
) -> (usize, [usize; RARE.len()], [usize; RARE.len()]) {
    let mut bench = Bench::new();
    let (mut n, mut fundamentals, mut bands) = (0, [0; RARE.len()], [0; RARE.len()]);
    for seed in 50_000.. {
        let features = bench.measure_n(kind, seed, n_samples);
        let readings = features.bearing_lines.iter().flat_map(|s| s.outcome.iter().flatten());
        let narrowest = readings.clone().map(|r| r.band.high.0 - r.band.low.0);
        let narrowest = narrowest.fold(f64::INFINITY, f64::min);
        let is_apart = |b: &Band| !b.whitened && b.high.0 - b.low.0 < 1.2 * narrowest;
        for reading in readings.filter(|r| is_apart(&r.band)) {
            n += 1;
            let fundamental = reading.harmonics[0].map_or(1.0, |h| harmonic_tail(&h));
            for (at, level) in RARE.iter().enumerate() {
                fundamentals[at] += usize::from(fundamental <= *level);
                bands[at] += usize::from(band_probability(reading) <= *level);
            }
        }
        if n >= enough {
            break;
        }
    }
    (n, fundamentals, bands)
}

#[test]
#[ignore = "long: many readings of noise; white, or the kinds named in ROTORWATCH_NOISE, and ROTORWATCH_READINGS of it in records of ROTORWATCH_SECONDS"]
fn readings_of_noise_undercut_rare_levels_as_often_as_nominal() {
    let enough = std::env::var("ROTORWATCH_READINGS").map_or(ENOUGH, |n| n.parse().unwrap());
    let seconds = std::env::var("ROTORWATCH_SECONDS").map_or(FEW_SECONDS, |s| s.parse().unwrap());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds")]
    let n_samples = (seconds * RATE_HZ).round() as usize;
    let wanted = std::env::var("ROTORWATCH_NOISE").unwrap_or_else(|_| "White".to_owned());
    let kinds = [Kind::White, Kind::Pink, Kind::Impacts];
    let kinds = kinds.into_iter().filter(|kind| wanted.contains(&format!("{kind:?}")));
    for kind in kinds {
        let (n, fundamentals, bands) = rare(kind, enough, n_samples);
        for (at, level) in RARE.iter().enumerate() {
            let nominal = level * n as f64;
            let (fundamental, band) = (fundamentals[at], bands[at]);
            let (at_most, at_least) =
                (tails(fundamental, nominal).0, tails(fundamental, nominal * kind.slack()).1);
            println!(
                "{kind:?}, {n} readings, nominal {nominal:.0}: fundamentals {fundamental}, bands {band}; so few by chance {at_most:.3}, \
                 so many {at_least:.3}"
            );
            assert!(at_least >= OUTSIDE_99, "{kind:?}: fundamentals at {level}: {fundamental}");
            // Few impacts in a record make cells that are not exponential, but bounded: conservative.
            let is_exact = !matches!(kind, Kind::Impacts);
            assert!(!is_exact || at_most >= OUTSIDE_99, "{kind:?} at {level}: {fundamental}");
            // A band asks for a harmonic too: it may only be conservative.
            assert!(tails(band, nominal).1 >= OUTSIDE_99, "{kind:?}: bands at {level}: {band}");
        }
    }
}
