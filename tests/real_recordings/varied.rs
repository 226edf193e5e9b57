//! The recordings changed in ways that change no truth: shorter, louder, noisier, coarser, faster, struck once.
//!
//! A verdict may be lost that way, and an unsure one is; none may become a wrong one. Rules that hold for one length, level, rate or
//! speed only show here.

use super::MUST_BE_HEALTHY;
use super::MUST_BE_RIGHT;
use super::WITH_BEARINGS;
use super::data;
use super::recording::Recording;
use super::recording::rms;
use super::truth;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::dsp::fir::Decimator;
use rotorwatch::dsp::real;
use rotorwatch::evaluation::score;
use rotorwatch::evaluation::score::Outcome;
use rotorwatch::evaluation::truth::TruthRow;
use rotorwatch::machine::file;
use rotorwatch::offline;
use rotorwatch::offline::Reference;
use rotorwatch::trials::vibration;
use rotorwatch::units::Hz;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt;
use std::fs;
use std::sync::Arc;

/// How a recording is changed.
#[derive(Debug, Clone, Copy)]
enum Change {
    /// One of so many equal parts, the first being 0.
    Part { at: usize, of: usize },
    /// So many revolutions at the stated speed, from so many quarters on.
    Few { revolutions: u32, quarter: u32 },
    /// From its end to its start: structures ring before they are struck.
    Reversed,
    /// With the sensors the other way round.
    Inverted,
    /// As by sensors of another sensitivity.
    Gain(f64),
    /// White noise so much over each channel's RMS.
    Noise(f64),
    /// Steps of so much of each channel's RMS.
    Coarse(f64),
    /// Held at so many times each channel's RMS.
    Clipped(f64),
    /// Played so much faster: the same orders at other frequencies.
    Faster(f64),
    /// Its stated speed off by this part.
    Misstated(f64),
    /// Without its stated speed: the machine file's is left.
    Unstated,
    /// Sampled at half the rate.
    HalfRate,
    /// Its first channel alone.
    Alone,
    /// One sample of so many times each channel's RMS in the middle.
    Lost(f64),
    /// One blow of so many times each channel's RMS in the middle, which rings at a fifth of the sampling rate for some milliseconds.
    Knocked(f64),
}

/// Speed taken for recordings that state none, near that of the others.
const USUAL_HZ: f64 = 25.0;

impl Change {
    const ALL: [Self; 36] = [
        Self::Part { at: 0, of: 2 },
        Self::Part { at: 1, of: 2 },
        Self::Part { at: 0, of: 4 },
        Self::Part { at: 1, of: 4 },
        Self::Part { at: 2, of: 4 },
        Self::Part { at: 3, of: 4 },
        Self::Few { revolutions: 15, quarter: 0 },
        Self::Few { revolutions: 15, quarter: 1 },
        Self::Few { revolutions: 15, quarter: 2 },
        Self::Few { revolutions: 15, quarter: 3 },
        Self::Few { revolutions: 40, quarter: 0 },
        Self::Few { revolutions: 40, quarter: 1 },
        Self::Few { revolutions: 40, quarter: 2 },
        Self::Few { revolutions: 40, quarter: 3 },
        Self::Reversed,
        Self::Inverted,
        Self::Gain(0.05),
        Self::Gain(20.0),
        Self::Noise(0.3),
        Self::Noise(1.0),
        Self::Coarse(0.05),
        Self::Coarse(0.5),
        Self::Clipped(3.0),
        Self::Faster(0.5),
        Self::Faster(1.5),
        Self::Faster(3.0),
        Self::Misstated(-0.006),
        Self::Misstated(0.006),
        Self::Unstated,
        Self::HalfRate,
        Self::Alone,
        Self::Lost(30.0),
        Self::Lost(300.0),
        Self::Lost(1e5),
        Self::Knocked(50.0),
        Self::Knocked(1000.0),
    ];

    /// The changed recording.
    fn of(self, recording: &Recording, random: &mut Pcg64Mcg) -> Recording {
        let mut changed = recording.clone();
        let stated = |factor: f64| recording.stated.map(|speed| Hz(speed.0 * factor));
        match self {
            Self::Part { at, of } => changed.each(|x| {
                let n = x.len() / of;
                *x = x[at * n..(at + 1) * n].to_vec();
            }),
            Self::Few { revolutions, quarter } => {
                let speed_hz = recording.stated.map_or(USUAL_HZ, |speed| speed.0);
                let seconds = f64::from(revolutions) / speed_hz;
                let n = real::ceil_index(seconds * recording.rate_hz);
                changed.each(|x| {
                    let start = x.len() * quarter as usize / 4;
                    *x = x[start..(start + n).min(x.len())].to_vec();
                });
            }
            Self::Reversed => changed.each(|x| x.reverse()),
            Self::Inverted => changed.each(|x| x.iter_mut().for_each(|v| *v = -*v)),
            Self::Gain(gain) => changed.each(|x| x.iter_mut().for_each(|v| *v *= gain)),
            Self::Noise(part) => changed.each(|x| {
                let noise = part * rms(x);
                x.iter_mut().for_each(|v| *v += noise * vibration::normal(random));
            }),
            Self::Coarse(part) => changed.each(|x| {
                let step = part * rms(x);
                x.iter_mut().for_each(|v| *v = (*v / step).round() * step);
            }),
            Self::Clipped(times) => changed.each(|x| {
                let most = times * rms(x);
                x.iter_mut().for_each(|v| *v = v.clamp(-most, most));
            }),
            Self::Faster(factor) => {
                changed.rate_hz *= factor;
                changed.stated = stated(factor);
            }
            Self::Misstated(part) => changed.stated = stated(1.0 + part),
            Self::Unstated => changed.stated = None,
            Self::HalfRate => {
                changed.rate_hz /= 2.0;
                changed.each(|x| *x = halved(x));
            }
            Self::Alone => changed.channels.truncate(1),
            Self::Lost(times) => changed.each(|x| {
                let (height, middle) = (times * rms(x), x.len() / 2);
                x[middle] += height;
            }),
            Self::Knocked(times) => changed.each(|x| {
                let (height, middle) = (times * rms(x), x.len() / 2);
                let rate_hz = recording.rate_hz;
                for (i, value) in x[middle..].iter_mut().enumerate().take(400) {
                    let decay = (-(i as f64) / (1.5e-3 * rate_hz)).exp();
                    *value += height * decay * (0.4 * PI * i as f64).sin();
                }
            }),
        }
        changed
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Part { at, of } => write!(f, "part {} of {of}", at + 1),
            Self::Few { revolutions, quarter } => {
                write!(f, "{revolutions} turns from {quarter}/4")
            }
            Self::Reversed => f.write_str("reversed"),
            Self::Inverted => f.write_str("inverted"),
            Self::Gain(gain) => write!(f, "gain {gain}"),
            Self::Noise(part) => write!(f, "noise of {part} RMS"),
            Self::Coarse(part) => write!(f, "steps of {part} RMS"),
            Self::Clipped(times) => write!(f, "clipped at {times} RMS"),
            Self::Faster(factor) => write!(f, "{factor} times as fast"),
            Self::Misstated(part) => write!(f, "speed {:+.1} %", 100.0 * part),
            Self::Unstated => f.write_str("speed not stated"),
            Self::HalfRate => f.write_str("half the rate"),
            Self::Alone => f.write_str("first channel alone"),
            Self::Lost(times) => write!(f, "a sample of {times} RMS"),
            Self::Knocked(times) => write!(f, "a blow of {times} RMS"),
        }
    }
}

/// Every other sample behind a filter that keeps the rest from folding.
fn halved(x: &[f64]) -> Vec<f64> {
    let mut decimator = Decimator::new(2);
    let mut out = vec![0.0; decimator.out_len(x.len())];
    decimator.process(x, &mut out);
    out.split_off(decimator.n_starting())
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn no_change_that_leaves_the_truth_makes_a_wrong_verdict() {
    let Some(data) = data("no_change_that_leaves_the_truth_makes_a_wrong_verdict") else { return };
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("changed.h5");
    let (mut mistakes, mut counts) = (Vec::new(), BTreeMap::<_, [usize; 2]>::new());
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let rows = truth(&data);
    let is_of_bearings =
        |row: &&TruthRow| row.baseline.is_empty() && WITH_BEARINGS.contains(&&*row.dataset);
    for row in rows.iter().filter(is_of_bearings) {
        let machine_file = data.join("machines").join(format!("{}.toml", row.dataset));
        let text = fs::read_to_string(machine_file).unwrap();
        let machine = Some(Arc::new(file::parse(&text, &row.dataset).unwrap()));
        let reference = Reference { machine, ..Reference::default() };
        let is_told = MUST_BE_RIGHT.iter().chain(&MUST_BE_HEALTHY).any(|file| **file == row.file);
        let recording = Recording::read(&data.join(&row.file));
        for change in Change::ALL {
            let changed = change.of(&recording, &mut random);
            changed.write(&capture);
            let diagnosis = offline::diagnose(&capture, &reference, &mut |_| ()).unwrap();
            fs::remove_file(&capture).unwrap();
            let scored = score::score(&row.known, &row.acceptable, &diagnosis).unwrap();
            let count: &mut [usize; 2] = counts.entry(change.to_string()).or_default();
            if is_told {
                count[0] += usize::from(scored.outcome == Outcome::Right);
                count[1] += 1;
            }
            // What happens once must hide no damage that is told without it.
            let once = matches!(change, Change::Lost(_) | Change::Knocked(_));
            if once && is_told && scored.outcome == Outcome::Missed {
                mistakes.push(format!("{}, {change}: called healthy", row.file));
            }
            for wrong in scored.accusations.iter().filter(|a| a.stray) {
                mistakes.push(format!("{}, {change}: {wrong:?}", row.file));
            }
        }
    }
    for (change, [right, n]) in &counts {
        println!("{change:<20} {right} of {n} right of those that are told");
    }
    let (right, n) =
        counts.values().fold((0, 0), |(right, n), [of_right, of_n]| (right + of_right, n + of_n));
    println!(
        "{right} of {n} right of those that are told, {} accused wrongly of all",
        mistakes.len()
    );
    assert!(n > 0 && mistakes.is_empty(), "{}", mistakes.join("\n"));
    // A quarter of a record, fifteen revolutions of it, or noise as loud as it, takes some.
    assert!(5 * right >= 4 * n, "{right} of {n}");
}
